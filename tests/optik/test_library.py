"""Robots from TOML files: a user's own arm, and every file that describes none is refused by the name of what is wrong."""

import copy
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, JointLimits, Robot
from optik.arm import library
from optik.arm.library import robot_from_toml
from optik.errors import DegreesWarning, InvalidInput, OptikError, RobotModelError, UnknownName
from tests import oracles
from tests.robots import BOUNDED

ARM = {
    "convention": "dh",
    "source": "a sketch",
    "joint_names": ["turn", "slide"],
    "gravity": [0.0, 0.0, -9.81],
    "base": {"xyz_mm": [0.0, 0.0, 500.0], "rpy_deg": [0.0, 0.0, 90.0]},
    "tool": {"xyz_mm": [0.0, 0.0, 120.0]},
    "joints": [
        {
            "a_mm": 100.0, "alpha_deg": -90.0, "d_mm": 290.0, "theta_deg": 30.0, "range_deg": [-165.0, 165.0],
            "speed_deg": 250.0,
        },
        {"type": "prismatic", "a_mm": 250.0, "range_mm": [0.0, 180.0], "speed_mm": 1020.0},
    ],
    "dynamic_limits": {"acceleration": [10.0, 20.0], "jerk": 100.0},
}  # fmt: skip


def toml(value):
    """A value as TOML writes it inside a line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def written(tmp_path, data, name="mine.toml"):
    file = tmp_path / name
    text = data if isinstance(data, str) else "".join(f"{json.dumps(k)} = {toml(v)}\n" for k, v in data.items())
    file.write_text(text, encoding="utf-8")
    return file


def changed(*keys, value):
    """The arm with one value set by the way to it, or removed where the value is `...`."""
    data = copy.deepcopy(ARM)
    inner = data
    for key in keys[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    return data


def test_a_users_own_file_is_the_arm_that_it_describes(tmp_path):
    rows = [DHRow(0.1, -math.pi / 2, 0.29, math.pi / 6), DHRow(a=0.25, prismatic=True)]
    turn = np.radians(165.0)
    limits = JointLimits([-turn, 0.0], [turn, 0.18], [np.radians(250.0), 1.02], [10.0, 20.0], 100.0)
    base = oracles.pose((0.0, 0.0, math.pi / 2), (0.0, 0.0, 0.5))
    expected = Robot.from_dh(rows, limits, base=base, tool=oracles.trans(z=0.12))
    robot = robot_from_toml(written(tmp_path, ARM))
    q = limits.sample(np.random.default_rng(0), 20)
    assert np.abs(robot.fk(q) - expected.fk(q)).max() < 1e-14
    for field in ("lower", "upper", "velocity", "acceleration", "jerk"):
        assert np.abs(getattr(robot.limits, field) - getattr(limits, field)).max() < 1e-14
    assert (robot.name, robot.source, robot.joint_names) == ("mine", "a sketch", ("turn", "slide"))
    assert (robot.gravity == (0, 0, -1)).all()


def test_what_may_be_left_out_has_the_stated_value(tmp_path):
    short = {"convention": "mdh", "joints": [{"range_rad": [-math.inf, math.inf]}]}
    robot = robot_from_toml(written(tmp_path, short))
    free = JointLimits([-np.inf], [np.inf])
    assert robot == Robot.from_mdh([{}], free, name="mine")
    assert robot.source == "mine.toml"


def test_radians_that_seem_to_be_degrees_are_named(tmp_path):
    rows = [{"range_rad": [-170.0, 10.0]}, {"range_deg": [-7200.0, 7200.0]}, {"range_rad": [-62.8, 62.8]}]
    file = written(tmp_path, {"convention": "dh", "joints": rows})
    with pytest.warns(DegreesWarning, match=r"at joint 'joint1' \(170\); were degrees meant") as caught:
        robot_from_toml(file)
    assert len(caught) == 1


def test_the_documented_example_is_read(tmp_path):
    text = library.__doc__.partition("table:\n")[2].partition("A row names")[0]
    text = "\n".join(line[4:] for line in text.splitlines()).replace("velocity = 2.0", "# ")
    robot = robot_from_toml(written(tmp_path, text))
    assert robot.n == 2
    assert robot.limits.jerk.tolist() == [100.0, 100.0]
    assert robot.joint_names == ("elbow", "slide")


BROKEN = {
    "no convention": (changed("convention", value=...), "convention missing"),
    "another convention": (changed("convention", value="urdf"), "convention"),
    "a convention that is no word": (changed("convention", value=["dh"]), "convention"),
    "no joints": (changed("joints", value=...), "joints missing"),
    "joints of none": (changed("joints", value=[]), "joints"),
    "joints that are a table": (changed("joints", value={"a_mm": 1.0}), "joints"),
    "a joint that is no table": (changed("joints", 1, value=3), r"joints\[1\]"),
    "an unknown key": (changed("payload_kg", value=3.0), "payload_kg unknown"),
    "an unknown key of a joint": (changed("joints", 0, "alpha", value=1.0), r"joints\[0\].*alpha unknown"),
    "an unknown kind of joint": (changed("joints", 0, "type", value="ball"), r"joints\[0\]\.type"),
    "a length in words": (changed("joints", 0, "a_mm", value="long"), r"joints\[0\]\.a_mm"),
    "a length that is true": (changed("joints", 0, "a_mm", value=True), r"joints\[0\]\.a_mm"),
    "a length that is NaN": (changed("joints", 0, "d_mm", value=math.nan), r"joints\[0\]\.d_mm"),
    "a length beyond all arms": (changed("joints", 0, "d_mm", value=1e12), "joint 1"),
    "no range": (changed("joints", 0, "range_deg", value=...), r"joints\[0\].*range_deg or range_rad"),
    "two ranges": (changed("joints", 0, "range_rad", value=[-1, 1]), r"joints\[0\].*range_deg and range_rad"),
    "a range in the wrong unit": (changed("joints", 1, "type", value=...), r"joints\[1\].*range_mm"),
    "a range of one number": (changed("joints", 0, "range_deg", value=[1.0]), r"joints\[0\]\.range_deg"),
    "a range of words": (changed("joints", 0, "range_deg", value=["-1", "1"]), r"joints\[0\]\.range_deg"),
    "a range with NaN": (changed("joints", 0, "range_deg", value=[math.nan, 1.0]), r"joints\[0\]\.range_deg"),
    "a range with more than a float": (changed("joints", 0, "range_deg", value=[0, 10**400]), r"joints\[0\]\.range_deg"),
    "a crossed range": (changed("joints", 0, "range_deg", value=[9.0, -9.0]), "limits"),
    "a speed in one row only": (changed("joints", 0, "speed_deg", value=...), r"joints\[0\].*speed_deg"),
    "a speed of 0": (changed("joints", 0, "speed_deg", value=0), r"joints\[0\]\.speed_deg"),
    "speeds in two places": (changed("dynamic_limits", "velocity", value=1.0), r"dynamic_limits\.velocity"),
    "dynamic limits that are no table": (changed("dynamic_limits", value=[1.0]), "dynamic_limits"),
    "an unknown dynamic limit": (changed("dynamic_limits", "snap", value=1.0), "snap unknown"),
    "dynamic limits of three joints": (changed("dynamic_limits", "jerk", value=[1.0, 2.0, 3.0]), r"dynamic_limits\.jerk"),
    "a limit below 0": (changed("dynamic_limits", "jerk", value=-1.0), r"dynamic_limits\.jerk"),
    "a tool of two numbers": (changed("tool", "xyz_mm", value=[0.0, 0.0]), r"tool\.xyz_mm"),
    "a tool in metres": (changed("tool", value={"xyz": [0.0, 0.0, 0.1]}), "xyz unknown"),
    "a base that is a list": (changed("base", value=[0.0, 0.0, 0.0]), "base"),
    "gravity of nothing": (changed("gravity", value=[0.0, 0.0, 0.0]), "gravity"),
    "gravity in words": (changed("gravity", value="down"), "gravity"),
    "a name too few": (changed("joint_names", value=["one"]), "different names"),
    "a name that is a number": (changed("joint_names", value=["one", 2]), "joint_names"),
    "a source that is a number": (changed("source", value=3), "source"),
    "no TOML": ("convention = ", "TOML"),
}  # fmt: skip


@pytest.mark.parametrize(("data", "word"), BROKEN.values(), ids=BROKEN.keys())
def test_a_file_that_describes_no_arm_is_refused_by_name(data, word, tmp_path):
    with pytest.raises((InvalidInput, RobotModelError), match=word) as caught:
        robot_from_toml(written(tmp_path, data))
    assert "mine" in str(caught.value)


def test_files_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "latin.toml").write_bytes(b'source = "\xe9"')
    (tmp_path / "large.toml").write_bytes(b"#" * (library.MOST_TOML_BYTES + 1))
    for name in ("missing.toml", "latin.toml", "large.toml", "no\0name.toml", ""):
        with pytest.raises(InvalidInput):
            robot_from_toml(tmp_path / name)


WAYS = [(key,) for key in ARM] + [
    ("joints", 0), *(("joints", i, key) for i in (0, 1) for key in library.JOINT_KEYS), ("joints", 0, "range_deg", 0),
    ("base", "xyz_mm"), ("base", "rpy_deg", 1), ("tool", "xyz_mm", 2), ("dynamic_limits", "velocity"), ("gravity", 1),
]  # fmt: skip
single = st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=3)
tables = st.dictionaries(st.sampled_from(["a_mm", "range_deg", "x"]), single, max_size=2)
values = st.just(...) | single | st.lists(single | st.lists(single, max_size=2), max_size=3) | tables


@given(way=st.sampled_from(WAYS), value=values)
def test_one_value_of_any_kind_makes_an_arm_or_a_named_error(way, value, tmp_path):
    try:
        data = changed(*way, value=value)
    except KeyError:  # nothing to remove
        return
    try:
        robot = robot_from_toml(written(tmp_path, data))
    except OptikError:
        return
    assert np.isfinite(robot.fk(robot.limits.middle)).all()


# ---------------------------------------------------------------- the robots that come with optik
def test_the_papers_arm_at_zero_has_its_tool_where_the_paper_puts_it():
    T = optik.load("paper6r").fk(np.zeros(6))
    assert np.abs(T[:3, 3] - (0.527, 0.731, 0.0)).max() < 1e-12
    assert np.abs(T[:3, :3] - [[1, 0, 0], [0, 0, 1], [0, -1, 0]]).max() < 1e-15


def test_the_default_line_begins_and_ends_at_the_papers_notes():
    robot = optik.load("paper6r")
    start, end = np.radians([[20, -35, 40, 25, 50, -30], [52.74, -34.83, 37.15, 57.57, 53.29, -29.81]])
    T, goal = robot.fk(start), robot.fk(end)
    assert np.abs(T[:3, 3] - (0.1640, 0.3536, 0.1496)).max() < 0.5e-4
    # the end's angles are given to 0.01°, which is 2e-4 m at this reach
    assert np.abs(goal[:3, 3] - T[:3, 3] - (-0.12, 0.0, 0.20)).max() < 2e-4
    assert np.abs(robot.pose_errors(end, T)[3:]).max() < 5e-4
    assert robot.limits.contains(np.array([start, end])).all()


def test_the_papers_arm_has_the_papers_ranges_and_gravity_along_plus_y():
    robot = optik.load("paper6r")
    assert np.abs(np.degrees(robot.limits.upper) - [180, 85, 90, 90, 90, 120]).max() < 1e-12
    assert (robot.limits.lower == -robot.limits.upper).all()
    assert (robot.gravity == (0, 1, 0)).all()
    assert [set(x) for x in (robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)] == [{2}, {10}, {100}]


@pytest.mark.parametrize("name", BOUNDED)
def test_a_robot_is_its_file(name):
    robot, arm = optik.load(name), oracles.table(name)
    assert robot.name == name
    assert robot.n == arm.n
    assert robot.source
    assert np.abs(robot.limits.lower - arm.lower).max() < 1e-15
    assert np.abs(robot.limits.upper - arm.upper).max() < 1e-15
    assert abs(np.linalg.norm(robot.gravity) - 1.0) < 1e-15
    for q in oracles.configurations(arm, 20, 3):
        assert np.abs(robot.fk(q) - oracles.fk(arm, q)).max() < 1e-14


def test_a_robots_speeds_are_those_of_its_data_sheet():
    def degrees(name):
        return np.degrees(optik.load(name).limits.velocity)

    assert np.abs(degrees("ur10e") - [120, 120, 180, 180, 180, 180]).max() < 1e-12
    assert np.abs(degrees("iiwa14") - [85, 85, 100, 75, 130, 135, 135]).max() < 1e-12
    assert np.abs(degrees("irb910sc")[[0, 1, 3]] - [415, 659, 2400]).max() < 1e-11
    assert optik.load("irb910sc").limits.velocity[2] == 1.02
    panda = optik.load("panda").limits
    assert panda.velocity.tolist() == [2.175] * 4 + [2.61] * 3
    assert panda.acceleration.tolist() == [15, 7.5, 10, 12.5, 15, 20, 20]
    assert panda.jerk.tolist() == [7500, 3750, 5000, 6250, 7500, 10000, 10000]


FLANGE_X = oracles.rot_z(0.0)[:, [2, 1, 0, 3]] @ np.diag([-1.0, 1.0, 1.0, 1.0])  # x of link_6 is z of tool0
EE_LINK = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)  # x is outwards
SSIK = {
    # name: module, before its base, after its tip, and how far its file rounds right angles
    "puma560": ("unimation.puma560_ik", np.eye(4), np.eye(4), 1e-12),
    "ur5e": ("universal_robots.ur5e_ik", np.diag([-1.0, -1.0, 1.0, 1.0]), np.eye(4), 2e-9),
    "ur10e": ("universal_robots.ur10e_ik", np.diag([-1.0, -1.0, 1.0, 1.0]), np.eye(4), 2e-9),
    "panda": ("franka.panda_ik", np.eye(4), np.eye(4), 1e-12),
    "ur5": ("universal_robots.ur5_ik", np.diag([-1.0, -1.0, 1.0, 1.0]), EE_LINK, 2e-9),
    "iiwa14": ("kuka.iiwa14_ik", np.eye(4), np.eye(4), 1e-12),
    "irb120": ("abb.irb120_ik", np.eye(4), FLANGE_X, 1e-12),
    "kr6": ("kuka.kr6_r900_ik", np.eye(4), FLANGE_X, 1e-12),
    "gen3lite": ("kinova.gen3_lite_ik", np.eye(4), np.eye(4), 2e-5),
}


@pytest.mark.parametrize("name", SSIK)
def test_a_robots_table_is_ssiks(name):
    module, base, tool, tolerance = SSIK[name]
    theirs = pytest.importorskip(f"ssik.prebuilt.{module}")
    q = oracles.configurations(oracles.table(name), 30, 15)
    assert np.abs(optik.load(name).fk(q) - base @ [theirs.fk(x) for x in q] @ tool).max() < tolerance


def test_the_wx200_is_its_urdf():
    # interbotix_xsarm_descriptions/urdf/wx200.urdf.xacro: where each joint stands in the one before, and its axis
    steps = [
        ((0, 0, 0.072), "z"), ((0, 0, 0.03865), "y"), ((0.05, 0, 0.2), "y"), ((0.2, 0, 0), "y"), ((0.065, 0, 0), "x"),
    ]  # fmt: skip
    robot = optik.load("wx200")
    for q in oracles.configurations(oracles.table("wx200"), 20, 16):
        T = np.eye(4)
        for (position, axis), angle in zip(steps, q, strict=True):
            T = T @ oracles.pose(angle * np.eye(3)["xyz".index(axis)], position)
        assert np.abs(robot.fk(q) - T @ oracles.trans(x=0.043)).max() < 1e-15


def test_the_scara_reaches_its_arms_lengths_and_goes_down_as_it_slides():
    robot = optik.load("irb910sc")
    assert robot.prismatic.tolist() == [False, False, True, False]
    T = robot.fk([0, 0, 0, 0])
    assert np.abs(T[:3, 3] - (0.65, 0, 0)).max() < 1e-15
    assert np.abs(T[:3, 2] - (0, 0, -1)).max() < 1e-15  # the tool points down
    assert np.abs(robot.fk([0, 0, 0.18, 0])[:3, 3] - (0.65, 0, -0.18)).max() < 1e-15
    elbow = robot.fk([np.pi / 2, -np.pi / 2, 0, 0])[:3, 3]
    assert np.abs(elbow - (0.25, 0.4, 0)).max() < 1e-15
    assert np.abs(robot.fk([0, 0, 0, np.pi / 2])[:3, 0] - (0, -1, 0)).max() < 1e-15  # seen from above, clockwise


def axes_of(name):
    frames = optik.load(name).frames(np.zeros(6))[:-1]
    return frames[:, :3, 3], frames[:, :3, 2]


def meet(points, directions):
    """How far three lines are from one common point: the residual of the point nearest to them."""
    across = [np.eye(3) - np.outer(d, d) for d in directions]
    A, b = np.vstack(across), np.concatenate([a @ p for a, p in zip(across, points, strict=True)])
    return np.linalg.norm(A @ np.linalg.lstsq(A, b, rcond=None)[0] - b)


def parallel(directions):
    return max(np.linalg.norm(np.cross(directions[0], d)) for d in directions[1:]) < 1e-9


PIEPER = {
    "paper6r": True,
    "puma560": True,
    "irb120": True,
    "kr6": True,
    "ur5": True,
    "ur5e": True,
    "ur10e": True,
    "gen3lite": False,
}


@pytest.mark.parametrize(("name", "expected"), PIEPER.items())
def test_only_the_general_arm_has_no_three_axes_that_meet_or_are_parallel(name, expected):
    points, directions = axes_of(name)
    triples = [slice(i, i + 3) for i in range(4)]
    special = [parallel(directions[t]) or meet(points[t], directions[t]) < 1e-9 for t in triples]
    assert any(special) == expected
    if not expected:  # nor nearly
        assert min(meet(points[t], directions[t]) for t in triples) > 0.02


def test_an_unknown_robot_is_answered_with_the_nearest_names():
    with pytest.raises(UnknownName) as caught:
        optik.load("paper6")
    error = caught.value
    assert error.nearest[0] == "paper6r"
    assert error.known == optik.robots()
    assert error.kind == "robot"
    assert "did you mean paper6r" in str(error)
    assert isinstance(error, LookupError)
    assert "paper6r" not in UnknownName("robot", "zzz", ["paper6r"]).nearest
