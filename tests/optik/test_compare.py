"""Two models of an arm: what differs is found, said in words, and true when it is applied with the oracle's kinematics."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, JointLimits, Robot
from optik.arm.compare import ArmComparison
from optik.errors import InvalidInput
from tests import oracles
from tests.robots import built

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
TOOL = oracles.pose((0.1, -0.3, 0.2), (0.02, 0.03, 0.1))
BASE = oracles.pose((0.4, 0.2, -0.7), (0.3, -0.2, 0.5))


def remodelled(robot, *, base=None, tool=None, signs=None, offsets=None):
    """The arm with fk'(q) = base fk(signs q + offsets) tool, from its joints: half a turn about x before and after."""
    n = robot.n
    signs = np.ones(n) if signs is None else np.asarray(signs)
    offsets = np.zeros(n) if offsets is None else np.asarray(offsets)
    fixed, before = [], np.eye(4) if base is None else base
    for i in range(n):
        zero = oracles.trans(z=offsets[i]) if robot.prismatic[i] else oracles.rot_z(offsets[i])
        after = FLIP if signs[i] < 0 else np.eye(4)
        fixed.append(before @ robot.fixed[i] @ zero @ after)
        before = after
    end = before @ robot.tool @ (np.eye(4) if tool is None else tool)
    free = JointLimits(np.full(n, -3.0), np.full(n, 3.0))
    return Robot("other", np.array(fixed), robot.prismatic, end, free)


def holds(comparison, arm, other):
    """Whether the explanation is true, by the oracle's kinematics of the first and optik's of the other."""
    for q in np.random.default_rng(5).uniform(-2, 2, (20, arm.n)):
        T = comparison.base @ oracles.fk(arm, comparison.signs * q + comparison.offsets) @ comparison.tool
        if np.abs(T - other.fk(q)).max() > 1e-9:
            return False
    return True


@pytest.mark.parametrize("name", optik.robots())
def test_an_arm_agrees_with_itself_and_with_itself_through_urdf(name):
    robot = optik.load(name)
    for other in (robot, Robot.from_urdf(robot.to_urdf(), name="again")):
        found = robot.compare(other)
        assert found
        assert found.agree
        assert found.explained
        assert found.position < 1e-12
        assert found.rotation < 1e-12
        assert found.reasons == ()
    assert "agree" in str(found)
    assert "again" in str(found)


CAUSES = {
    "a longer tool": ({"tool": oracles.trans(z=0.1)}, ["the tools differ by 0.1 m along z of the tool"]),
    "another tool": (
        {"tool": oracles.trans(x=0.03, z=0.04)},
        ["the tools differ by 0.05 m along (0.6, 0, 0.8) of the tool"],
    ),
    "a turned base": (
        {"base": oracles.trans(z=0.3) @ oracles.rot_x(0.5)},
        ["the bases differ by 0.3 m along z of the base and by a turn of 28.6479° about x"],
    ),
    "a sign": ({"signs": [1, 1, -1]}, ["joint 3 {moves} the other way"]),
    "a zero": ({"offsets": [0, np.pi / 2]}, ["joint 2 has its zero offset by 90°"]),
    "two signs and a zero": (
        {"signs": [1, -1, -1], "offsets": [0, 0.5]},
        ["joint 2 turns the other way", "joint 2 has its zero offset by 28.6479°", "joint 3 {moves} the other way"],
    ),
    "a base upside down and a tool": (
        {"base": FLIP, "tool": oracles.trans(y=-0.1)},
        ["the bases differ by a turn of 180° about x", "the tools differ by -0.1 m along y of the tool"],
    ),
    "a base and a tool": (
        {"base": oracles.trans(x=0.2) @ oracles.rot_x(1.0), "tool": oracles.trans(y=-0.1)},
        [
            "the bases differ by 0.2 m along x of the base and by a turn of 57.2958° about x",
            "the tools differ by -0.1 m along y of the tool",
        ],
    ),
}


@pytest.mark.parametrize(("changes", "words"), CAUSES.values(), ids=CAUSES.keys())
@pytest.mark.parametrize("name", optik.robots())
def test_the_cause_is_named_and_true(name, changes, words):
    robot, arm = optik.load(name), oracles.table(name)
    changes = {k: np.resize(v + [v[0]] * 9, robot.n) if isinstance(v, list) else v for k, v in changes.items()}
    other = remodelled(robot, **changes)
    found = robot.compare(other)
    assert not found
    assert found.explained
    assert found.position_left < 1e-12
    assert found.rotation_left < 1e-12
    assert max(found.position, found.rotation) > 0.01
    assert holds(found, arm, other)
    text = str(found)
    if name != "irb910sc":  # where all axes are parallel, there is more than one way to say it
        assert list(found.reasons) == [w.format(moves="turns") for w in words]
        assert all(reason in text for reason in found.reasons)
        assert np.abs(found.tool - changes.get("tool", np.eye(4))).max() < 1e-12
        assert np.abs(found.base - changes.get("base", np.eye(4))).max() < 1e-12
        assert (found.signs == changes.get("signs", np.ones(robot.n))).all()
        assert np.abs(found.offsets - changes.get("offsets", np.zeros(robot.n))).max() < 1e-12


@given(st.data())
def test_any_base_tool_zeros_and_signs_together_are_found(data):
    seed = data.draw(st.integers(0, 10**6))
    rng = np.random.default_rng(seed)
    n = data.draw(st.integers(1, 7))
    arm = oracles.random_arm(rng, n, prismatic=data.draw(st.booleans()))
    robot = built(arm)
    changes = {
        "base": data.draw(st.sampled_from([None, BASE])),
        "tool": data.draw(st.sampled_from([None, TOOL])),
        "signs": data.draw(st.sampled_from([None, rng.choice([-1.0, 1.0], n)])),
        "offsets": data.draw(st.sampled_from([None, rng.uniform(-1, 1, n)])),
    }
    other = remodelled(robot, **changes)
    found = robot.compare(other)
    assert found.explained
    assert holds(found, arm, other)
    assert found.agree == all(
        value is None or np.abs(value - (k == "signs")).max() == 0 for k, value in changes.items()
    )


@pytest.mark.parametrize("name", optik.robots())
def test_everything_at_once_is_explained_on_arms_with_right_angles(name):
    robot, arm = optik.load(name), oracles.table(name)
    rng = np.random.default_rng(3)
    for _ in range(3):
        offsets = rng.uniform(-1, 1, robot.n) * np.where(robot.prismatic, 0.1, 1.0)
        other = remodelled(robot, base=BASE, tool=TOOL, signs=rng.choice([-1.0, 1.0], robot.n), offsets=offsets)
        found = robot.compare(other)
        assert found.explained
        assert holds(found, arm, other)


@pytest.mark.parametrize("name", ["paper6r", "panda"])
def test_a_modified_table_read_as_a_standard_one_is_explained_by_nothing(name):
    arm = oracles.table(name)
    rows = [DHRow(r.a, r.alpha, r.d, r.theta) for r in arm.rows]
    limits = optik.load(name).limits
    found = Robot.from_mdh(rows, limits, name="modified").compare(Robot.from_dh(rows, limits, name="standard"))
    assert not found.explained
    assert found.position_left == found.position > 0.1
    assert "no base, tool, zero or sign explains it" in str(found)
    assert any("axes of joints" in reason for reason in found.reasons)
    assert (found.base == np.eye(4)).all()
    assert (found.signs == 1).all()
    assert (found.offsets == 0).all()


def test_the_angle_or_distance_that_differs_is_named():
    robot = optik.load("puma560")
    longer, twisted = robot.fixed.copy(), robot.fixed.copy()
    longer[2] = longer[2] @ oracles.trans(x=0.01)
    twisted[3] = twisted[3] @ oracles.rot_x(np.radians(2))
    found = robot.compare(replace(robot, fixed=longer))
    assert found.reasons == ("the axes of joints 2 and 3 are 0.4318 m apart in one and 0.4418 m in the other",)
    assert "90° to each other in one and 88° in the other" in str(robot.compare(replace(robot, fixed=twisted)))
    along = robot.fixed.copy()
    along[3] = along[3] @ oracles.trans(z=0.01)  # a d: no distance between neighbours shows it
    found = robot.compare(replace(robot, fixed=along))
    assert not found.explained
    assert "lengths along the axes may differ" in found.reasons[0]


def test_a_calibrated_arm_is_near_and_said_to_be_so():
    robot = optik.load("ur5e")
    noise = np.random.default_rng(4)
    fixed = np.array([T @ oracles.pose(noise.normal(0, 1e-4, 3), noise.normal(0, 1e-4, 3)) for T in robot.fixed])
    measured = replace(robot, fixed=fixed, name="measured")
    assert not robot.compare(measured).explained
    assert robot.compare(measured, position=5e-3, rotation=5e-3).agree
    moved = remodelled(measured, tool=oracles.trans(z=0.1), signs=[1, 1, -1, 1, 1, 1])
    found = robot.compare(moved, position=5e-3, rotation=5e-3)
    assert found.explained
    assert 1e-6 < found.position_left < 5e-3
    assert [r.split(" by ")[0] for r in found.reasons] == ["the tools differ", "joint 3 turns the other way"]


def test_arms_of_other_joints_are_an_answer_and_no_crash():
    found = optik.load("panda").compare(optik.load("ur5e"))
    assert not found
    assert not found.explained
    assert found.position == found.rotation == np.inf
    assert str(found) == "panda and ur5e cannot be compared: 7 joints and 6"
    scara = optik.load("irb910sc")
    found = scara.compare(replace(scara, prismatic=[False, False, False, True]))
    assert found.reasons == (
        "joint 3 slides in one and turns in the other",
        "joint 4 turns in one and slides in the other",
    )


@pytest.mark.parametrize("pair", [("ur5e", "ur10e"), ("irb120", "kr6"), ("panda", "iiwa14"), ("paper6r", "gen3lite")])
def test_different_arms_are_explained_by_nothing(pair):
    assert not optik.load(pair[0]).compare(optik.load(pair[1])).explained


def test_gantries_and_free_and_locked_joints_are_compared_too():
    rows = [
        DHRow(prismatic=True),
        DHRow(alpha=np.pi / 2, prismatic=True),
        DHRow(alpha=np.pi / 2, a=0.1),
        DHRow(alpha=1.0, d=0.2),
    ]
    limits = JointLimits([-np.inf, 0, -np.inf, 0.5], [np.inf, 1, 1, 0.5])
    robot = Robot.from_mdh(rows, limits)
    assert robot.compare(robot).agree
    other = remodelled(robot, offsets=[0.1, 0.2, 0.3, 0.0], tool=TOOL)
    found = robot.compare(other)
    assert found.explained
    assert np.abs(found.position_left) < 1e-12


def test_the_same_question_has_the_same_answer():
    robot, other = optik.load("puma560"), remodelled(optik.load("puma560"), tool=TOOL)
    assert str(robot.compare(other)) == str(robot.compare(other))


@pytest.mark.parametrize("other", [None, "ur5e", np.eye(4)])
def test_what_is_no_robot_is_refused(other):
    with pytest.raises(InvalidInput, match=r"^other: "):
        optik.load("ur5e").compare(other)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf, "small", None, True])
@pytest.mark.parametrize("name", ["position", "rotation"])
def test_a_tolerance_is_a_number_above_zero(name, tolerance):
    with pytest.raises(InvalidInput, match=rf"^{name}: "):
        optik.load("ur5e").compare(optik.load("ur5e"), **{name: tolerance})


def test_a_comparison_cannot_be_written():
    found = optik.load("ur5e").compare(optik.load("ur5e"))
    assert isinstance(found, ArmComparison)
    with pytest.raises(AttributeError):
        found.agree = False
