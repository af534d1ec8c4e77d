"""The arm: conventions against matrix products, limits, identity, and what is refused."""

import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, JointLimits, Robot
from optik.arm.limits import positive
from optik.errors import InvalidInput, OptikError, RobotModelError, UnknownName
from tests import oracles

BUILD = {"mdh": Robot.from_mdh, "dh": Robot.from_dh}


def built(arm, **options):
    rows = [DHRow(r.a, r.alpha, r.d, r.theta, r.prismatic) for r in arm.rows]
    limits = JointLimits(np.full(arm.n, -3.0), np.full(arm.n, 3.0))
    return BUILD[arm.convention](rows, limits, base=arm.base, tool=arm.tool, **options)


def one_joint(**changes):
    given = {
        "name": "slider",
        "fixed": [np.eye(4)],
        "prismatic": [True],
        "tool": np.eye(4),
        "limits": JointLimits([0.0], [1.0]),
    }
    return Robot(**given | changes)


lengths = st.floats(-1, 1)
turns = st.floats(-7, 7)
rows = st.builds(oracles.Row, a=lengths, alpha=turns, d=lengths, theta=turns, prismatic=st.booleans())
placements = st.builds(oracles.pose, st.tuples(turns, turns, turns), st.tuples(lengths, lengths, lengths))


@st.composite
def arms_and_configurations(draw):
    arm = oracles.Arm(
        draw(st.sampled_from(["mdh", "dh"])),
        tuple(draw(st.lists(rows, min_size=1, max_size=8))),
        draw(placements),
        draw(placements),
    )
    return arm, np.array(draw(st.lists(turns, min_size=arm.n, max_size=arm.n)))


# ---------------------------------------------------------------- conventions


@given(arms_and_configurations())
def test_forward_kinematics_is_the_product_of_the_link_matrices(case):
    arm, q = case
    assert np.abs(built(arm).fk(q) - oracles.fk(arm, q)).max() < 1e-13


@given(arms_and_configurations())
def test_jacobian_is_the_derivative_of_the_product(case):
    arm, q = case
    assert np.abs(built(arm).jacobian(q) - oracles.jacobian(arm, q)).max() < 1e-12


@given(arms_and_configurations())
def test_frames_end_at_the_tool_and_each_moves_with_its_own_joint(case):
    arm, q = case
    robot = built(arm)
    frames = robot.frames(q)
    assert frames.shape == (arm.n + 1, 4, 4)
    assert (frames[-1] == robot.fk(q)).all()
    for i in range(arm.n):
        moved = q.copy()
        moved[i] += 0.5
        after = robot.frames(moved)
        own = oracles.trans(z=0.5) if arm.rows[i].prismatic else oracles.rot_z(0.5)
        assert (after[:i] == frames[:i]).all()
        assert np.abs(after[i] - frames[i] @ own).max() < 1e-13


def test_mdh_frame_i_is_the_tables_frame_i():
    arm = oracles.random_arm(np.random.default_rng(4), prismatic=True)
    q = np.linspace(-1, 1, 6)
    frames, T = built(arm).frames(q), arm.base
    for i in range(6):
        T = T @ oracles.link(arm, i, q[i])
        assert np.abs(frames[i] - T).max() < 1e-14


def test_modified_and_standard_tables_of_the_same_numbers_are_different_arms():
    arm = oracles.random_arm(np.random.default_rng(7))
    q = np.linspace(-1, 1, 6)
    other = replace(arm, convention="dh")
    assert built(arm) != built(other)
    assert np.abs(built(arm).fk(q) - built(other).fk(q)).max() > 0.1


@pytest.mark.parametrize("convention", ["mdh", "dh"])
def test_a_prismatic_joint_slides_along_its_z_from_its_d(convention):
    row = oracles.Row(a=0.3, alpha=0.4, d=0.2, theta=0.7, prismatic=True)
    robot = built(oracles.Arm(convention, (row,)))
    turned = built(oracles.Arm(convention, (replace(row, prismatic=False),)))
    assert (robot.fk([0.0]) == turned.fk([0.0])).all()
    moved = robot.fk([0.25])
    assert (moved[:3, :3] == robot.fk([0.0])[:3, :3]).all()
    axis = robot.frames([0.0])[0][:3, 2]
    assert np.abs(moved[:3, 3] - robot.fk([0.0])[:3, 3] - 0.25 * axis).max() < 1e-15
    assert np.abs(robot.jacobian([0.1])[:, 0] - [*axis, 0, 0, 0]).max() < 1e-15


def test_rows_may_be_mappings_with_the_names_of_the_columns():
    limits = JointLimits([-1], [1])
    assert Robot.from_mdh([{"a": 0.1, "alpha": 0.2}], limits) == Robot.from_mdh([DHRow(a=0.1, alpha=0.2)], limits)


def test_base_stands_before_the_chain_and_tool_after_it():
    arm = oracles.random_arm(np.random.default_rng(8))
    bare = built(replace(arm, base=np.eye(4), tool=np.eye(4)))
    q = np.linspace(-1, 1, 6)
    assert np.abs(built(arm).fk(q) - arm.base @ bare.fk(q) @ arm.tool).max() < 1e-14


@pytest.mark.parametrize("name", optik.robots())
def test_with_tool_replaces_the_tool_and_nothing_else(name):
    robot = optik.load(name)
    q = robot.limits.clip(np.linspace(-0.4, 0.5, robot.n))
    T = oracles.pose((0.1, 0.2, 0.3), (0.0, 0.05, 0.2))
    longer = robot.with_tool(robot.tool @ T)
    assert np.abs(longer.fk(q) - robot.fk(q) @ T).max() < 1e-14
    assert (longer.frames(q)[:-1] == robot.frames(q)[:-1]).all()
    assert longer.limits is robot.limits
    assert (longer.name, longer.joint_names, longer.source) == (robot.name, robot.joint_names, robot.source)
    assert longer != robot
    assert longer.with_tool(robot.tool) == robot
    with pytest.raises(InvalidInput, match=r"^tool: "):
        robot.with_tool(np.eye(3))


@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 3), (0,)])
def test_batches_have_the_shape_of_their_parts(shape):
    robot = optik.load("puma560")
    q = np.random.default_rng(0).uniform(-0.7, 0.7, (*shape, 6))
    target = oracles.pose((0.1, 0.2, 0.3), (0.2, 0.3, 0.4))
    parts = {robot.fk: (4, 4), robot.frames: (7, 4, 4), robot.jacobian: (6, 6)}
    for function, part in parts.items():
        together = function(q)
        assert together.shape == (*shape, *part)
        for i in np.ndindex(shape):
            assert (together[i] == function(q[i])).all()
    e = robot.errors(q, target)
    assert e.shape == (*shape, 6)
    for i in np.ndindex(shape):
        assert np.abs(e[i] - oracles.error(robot.fk(q[i]), target)).max() < 1e-14


def test_errors_of_many_targets_are_those_of_each():
    robot = optik.load("paper6r")
    q = oracles.configurations(oracles.table("paper6r"), 5, 1)
    targets = robot.fk(oracles.configurations(oracles.table("paper6r"), 5, 2))
    expected = np.array([oracles.error(T, goal) for T, goal in zip(robot.fk(q), targets, strict=True)])
    assert np.abs(robot.errors(q, targets) - expected).max() < 1e-13


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
    assert np.abs(robot.errors(end, T)[3:]).max() < 5e-4
    assert robot.limits.contains(np.array([start, end])).all()


def test_the_papers_arm_has_the_papers_ranges_and_gravity_along_plus_y():
    robot = optik.load("paper6r")
    assert np.abs(np.degrees(robot.limits.upper) - [180, 85, 90, 90, 90, 120]).max() < 1e-12
    assert (robot.limits.lower == -robot.limits.upper).all()
    assert (robot.gravity == (0, 1, 0)).all()
    assert [set(x) for x in (robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)] == [{2}, {10}, {100}]


def test_the_papers_arm_is_singular_at_zero():
    assert np.linalg.svd(optik.load("paper6r").jacobian(np.zeros(6)))[1][-1] < 1e-14


@pytest.mark.parametrize("name", optik.robots())
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
SSIK = {
    # name: module, before its base, after its tip, and how far its file rounds right angles
    "ur10e": ("universal_robots.ur10e_ik", np.diag([-1.0, -1.0, 1.0, 1.0]), np.eye(4), 2e-9),
    "panda": ("franka.panda_ik", np.eye(4), np.eye(4), 1e-12),
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
        ((0, 0, 0.072), "z"),
        ((0, 0, 0.03865), "y"),
        ((0.05, 0, 0.2), "y"),
        ((0.2, 0, 0), "y"),
        ((0.065, 0, 0), "x"),
    ]
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


PIEPER = {"paper6r": True, "puma560": True, "irb120": True, "kr6": True, "ur5e": True, "ur10e": True, "gen3lite": False}


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


# ---------------------------------------------------------------- identity


def test_equal_content_is_an_equal_robot():
    a, b = optik.load("paper6r"), optik.load("paper6r")
    assert a is not b
    assert a == b
    assert hash(a) == hash(b)
    assert a.fingerprint == b.fingerprint
    assert len({a, b, optik.load("ur5e")}) == 2
    assert a != "paper6r"


def test_the_fingerprint_is_the_same_in_another_process(tmp_path):
    code = "import optik; print(optik.load('puma560').fingerprint)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=oracles.REPOSITORY
    )
    assert run.stdout.strip() == optik.load("puma560").fingerprint


def changed(robot, **changes):
    names = ("name", "fixed", "prismatic", "tool", "limits", "joint_names", "gravity", "source")
    return Robot(**{n: getattr(robot, n) for n in names} | changes)


def nudged(array):
    array = array.copy()
    array.flat[-2] = np.nextafter(array.flat[-2], 9.0)
    return array


def test_any_change_of_content_is_another_robot():
    robot = optik.load("paper6r")
    limits = robot.limits
    changes = {
        "name": "other",
        "fixed": robot.fixed @ oracles.trans(z=1e-12),
        "prismatic": ~robot.prismatic,
        "tool": oracles.trans(z=0.1),
        "joint_names": tuple("abcdef"),
        "gravity": (0, 0, -1),
    }
    others = [changed(robot, **{k: v}) for k, v in changes.items()]
    for name in ("lower", "upper", "velocity", "acceleration", "jerk"):
        others.append(changed(robot, limits=replace(limits, **{name: nudged(getattr(limits, name))})))
    for name in ("velocity", "acceleration", "jerk"):
        others.append(changed(robot, limits=replace(limits, **{name: None})))
    assert changed(robot) == robot
    assert len({robot, *others}) == len(others) + 1


def test_velocity_and_acceleration_of_the_same_figures_are_not_the_same():
    a = one_joint(limits=JointLimits([0], [1], velocity=2.0))
    b = one_joint(limits=JointLimits([0], [1], acceleration=2.0))
    assert a != b


@pytest.mark.parametrize("name", optik.robots())
def test_a_pickled_robot_comes_back_equal_and_read_only(name):
    robot = optik.load(name)
    back = pickle.loads(pickle.dumps(robot))
    assert back == robot
    assert back.source == robot.source
    assert not back.fixed.flags.writeable
    assert not back.limits.lower.flags.writeable


@pytest.mark.parametrize("name", optik.robots())
def test_nothing_of_a_robot_can_be_written(name):
    robot = optik.load(name)
    arrays = [robot.fixed, robot.prismatic, robot.tool, robot.gravity, robot.limits.lower, robot.limits.upper]
    arrays += [x for x in (robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk) if x is not None]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(FrozenInstanceError):
        robot.name = "other"
    with pytest.raises(FrozenInstanceError):
        robot.limits.lower = np.zeros(6)


def test_a_robot_keeps_no_hold_of_the_arrays_it_was_made_of():
    fixed, tool, lower = np.array([np.eye(4)]), np.eye(4), np.array([0.0])
    robot = one_joint(fixed=fixed, tool=tool, limits=JointLimits(lower, [1.0]))
    fixed[0, 0, 3] = tool[0, 3] = lower[0] = 0.5
    assert (robot.fk([0.0]) == np.eye(4)).all()
    assert robot.limits.lower[0] == 0.0
    assert fixed.flags.writeable


@pytest.mark.parametrize("slides", ["no", "revolute", "", np.nan, 1.0, None, 2])
def test_what_is_no_yes_or_no_is_no_sliding_joint(slides):
    for build in (
        lambda: one_joint(prismatic=[slides]),
        lambda: Robot.from_mdh([DHRow(prismatic=slides)], JointLimits([0.0], [1.0])),
        lambda: Robot.from_dh([{"d": 0.1, "prismatic": slides}], JointLimits([0.0], [1.0])),
    ):
        with pytest.raises(InvalidInput, match=r"prismatic.*: expected True or False"):
            build()


@pytest.mark.parametrize("slides", [[True], [0], np.array([1]), (np.False_,)])
def test_sliding_joints_are_told_by_true_and_false_or_their_numbers(slides):
    assert one_joint(prismatic=slides).prismatic.tolist() == [bool(slides[0])]


@pytest.mark.parametrize("names", ["a", "abcdef", [1], [None], [["a"]], 3])
def test_what_are_no_words_are_no_names_of_joints(names):
    with pytest.raises(InvalidInput, match="joint_names"):
        one_joint(joint_names=names)
    with pytest.raises(InvalidInput, match="source"):
        one_joint(source=3)


def test_gravity_is_a_direction():
    assert (one_joint(gravity=(0, 9.81, 0)).gravity == (0, 1, 0)).all()
    assert (one_joint().gravity == (0, 0, -1)).all()


def test_joints_are_named_from_one_unless_named():
    assert optik.load("paper6r").joint_names == tuple(f"joint{i}" for i in range(1, 7))
    assert one_joint(joint_names=["rail"]).joint_names == ("rail",)


# ---------------------------------------------------------------- limits


def test_contains_is_true_at_the_limits_and_a_billionth_past_and_no_further():
    limits = JointLimits([-1, -2], [1, 2])
    assert limits.contains([1, -2])
    assert limits.contains([1 + 0.9e-9, -2 - 0.9e-9])
    assert not limits.contains([1 + 1.1e-9, 0])
    assert not limits.contains([0, -2 - 1.1e-9])
    assert limits.contains([[0, 0], [0, 3]]).tolist() == [True, False]
    assert not limits.contains([np.nan, 0.0])


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=2))
def test_clip_gives_the_nearest_configuration_inside(q):
    limits = JointLimits([-1, -np.inf], [1, 2])
    inside = limits.clip(q)
    assert limits.contains(inside)
    assert inside.tolist() == [min(max(q[0], -1), 1), min(q[1], 2)]


def test_a_locked_joint_and_a_free_one_are_limits():
    limits = JointLimits([0.5, -np.inf], [0.5, np.inf])
    assert limits.contains([0.5, 1e9])
    assert not limits.contains([0.6, 0.0])


def test_one_figure_stands_for_every_joint():
    limits = JointLimits([-1, -1], [1, 1], velocity=2, jerk=[3, np.inf])
    assert limits.velocity.tolist() == [2, 2]
    assert limits.acceleration is None
    assert limits.jerk.tolist() == [3, np.inf]


BAD_LIMITS = {
    "NaN below": (([np.nan, 0], [1, 1]), {}, "limits", "NaN"),
    "NaN above": (([0, 0], [1, np.nan]), {}, "limits", "NaN"),
    "crossed": (([0, 2], [1, 1]), {}, "limits", "joint 2"),
    "lengths": (([0, 0], [1, 1, 1]), {}, "limits", "length"),
    "none": (([], []), {}, "limits", "n ≥ 1"),
    "scalars": ((0, 1), {}, "limits", "length"),
    "tables": (([[0, 0]], [[1, 1]]), {}, "limits", "length"),
    **{
        f"{name} {label}": (([0, 0], [1, 1]), {name: value}, name, word)
        for name in ("velocity", "acceleration", "jerk")
        for label, value, word in (
            ("zero", 0.0, "above 0"),
            ("negative", [1, -1], "above 0"),
            ("NaN", [1, np.nan], "above 0"),
            ("minus infinity", -np.inf, "above 0"),
            ("too long", [1, 1, 1], "2 of them"),
            ("a table", [[1, 1]], "2 of them"),
            ("a word", "fast", "2 of them"),
        )
    },
}


@pytest.mark.parametrize(("limits", "options", "argument", "word"), BAD_LIMITS.values(), ids=BAD_LIMITS.keys())
def test_limits_that_cannot_be_meant_are_refused_by_name(limits, options, argument, word):
    with pytest.raises(InvalidInput) as caught:
        JointLimits(*limits, **options)
    assert caught.value.argument == argument
    assert word in str(caught.value)


def test_pickled_limits_come_back_the_same():
    limits = JointLimits([-1, -2], [1, np.inf], velocity=[1, 2])
    back = pickle.loads(pickle.dumps(limits))
    assert (back.lower == limits.lower).all()
    assert (back.upper == limits.upper).all()
    assert (back.velocity == limits.velocity).all()
    assert back.acceleration is None
    assert back.jerk is None


def test_positive_gives_one_figure_a_joint_and_no_hold_of_the_callers():
    mine = np.array([1.0, 2.0])
    limit = positive(mine, 2, "speed")
    mine[0] = 7.0
    assert limit.tolist() == [1, 2]
    assert not limit.flags.writeable


# ---------------------------------------------------------------- what is refused

ONE = JointLimits([-1.0], [1.0])
REFLECTION = np.diag([1.0, 1.0, -1.0, 1.0])
BAD_ROBOTS = {
    "one transform": ({"fixed": np.eye(4)}, "(n, 4, 4)"),
    "no transforms": ({"fixed": np.zeros((0, 4, 4))}, "(n, 4, 4)"),
    "rotations": ({"fixed": [np.eye(3)]}, "(n, 4, 4)"),
    "a reflection": ({"fixed": [REFLECTION]}, "joint 1"),
    "NaN": ({"fixed": [np.full((4, 4), np.nan)]}, "joint 1"),
    "limits of another": ({"limits": JointLimits([0, 0], [1, 1])}, "limits for 2"),
    "kinds of another": ({"prismatic": [True, False]}, "prismatic"),
    "two names": ({"joint_names": ("a", "b")}, "names"),
    "no gravity": ({"gravity": (0, 0, 0)}, "gravity"),
    "gravity NaN": ({"gravity": (0, np.nan, 0)}, "gravity"),
    "gravity flat": ({"gravity": (0, 1)}, "gravity"),
}


@pytest.mark.parametrize(("changes", "word"), BAD_ROBOTS.values(), ids=BAD_ROBOTS.keys())
def test_what_is_no_arm_is_refused_with_the_robots_name(changes, word):
    with pytest.raises(RobotModelError) as caught:
        one_joint(**changes)
    assert caught.value.robot == "slider"
    assert "'slider'" in str(caught.value)
    assert word in str(caught.value)
    assert isinstance(caught.value, ValueError)


def test_joints_of_one_name_are_refused():
    with pytest.raises(RobotModelError, match="different names"):
        Robot("two", [np.eye(4)] * 2, [False] * 2, np.eye(4), JointLimits([0, 0], [1, 1]), ("a", "a"))


@pytest.mark.parametrize("build", BUILD.values())
def test_a_table_that_cannot_be_meant_is_refused_by_name(build):
    with pytest.raises(RobotModelError, match="no joints"):
        build([], ONE)
    with pytest.raises(RobotModelError, match="2 joints but limits for 1"):
        build([DHRow(), DHRow()], ONE)
    with pytest.raises(RobotModelError, match="joint 1: d is nan"):
        build([DHRow(d=np.nan)], ONE)
    with pytest.raises(InvalidInput, match=r"^rows\[0\]: "):
        build([{"length": 1.0}], ONE)
    with pytest.raises(InvalidInput, match=r"^rows\[0\]: "):
        build([(0.1, 0.0, 0.0, 0.0)], ONE)  # which column is which?
    with pytest.raises(InvalidInput, match=r"^base: "):
        build([DHRow()], ONE, base=np.eye(3))
    with pytest.raises(InvalidInput, match=r"^tool: "):
        build([DHRow()], ONE, tool=REFLECTION)
    with pytest.raises(InvalidInput, match=r"^options: .*got toool"):
        build([DHRow()], ONE, toool=np.eye(4))


BAD_CONFIGURATIONS = {
    "short": [0.0] * 5,
    "long": [0.0] * 7,
    "NaN": [0, 0, np.nan, 0, 0, 0],
    "infinite": [0, 0, np.inf, 0, 0, 0],
    "a number": 0.0,
    "a word": "home",
    "None": None,
    "ragged": [[1, 2], [3]],
}


@pytest.mark.parametrize("q", BAD_CONFIGURATIONS.values(), ids=BAD_CONFIGURATIONS.keys())
def test_what_is_no_configuration_is_refused_by_name(q):
    robot = optik.load("paper6r")
    for function in (robot.fk, robot.frames, robot.jacobian, lambda q: robot.errors(q, np.eye(4))):
        with pytest.raises(InvalidInput, match=r"^q: "):
            function(q)
    with pytest.raises(InvalidInput, match=r"^here: "):
        robot.configuration(q, "here")


def test_one_configuration_is_not_a_batch_of_them():
    robot = optik.load("paper6r")
    assert robot.configuration(np.zeros((2, 6)), batch=True).shape == (2, 6)
    with pytest.raises(InvalidInput, match=r"shape \(6,\)"):
        robot.configuration(np.zeros((2, 6)))


@pytest.mark.parametrize(
    "misuse",
    [
        pytest.param(lambda: JointLimits(["a"], ["b"]), id="limits that are words"),
        pytest.param(lambda: JointLimits([[0], [0, 1]], [1]), id="ragged limits"),
        pytest.param(lambda: Robot.from_mdh([DHRow(a="long")], ONE), id="a length that is a word"),
        pytest.param(lambda: Robot.from_mdh(5, ONE), id="rows that are a number"),
        pytest.param(lambda: one_joint(fixed="abc"), id="transforms that are a word"),
        pytest.param(lambda: one_joint(limits=None), id="no limits"),
        pytest.param(lambda: one_joint(gravity="down"), id="gravity that is a word"),
        pytest.param(lambda: optik.load(None), id="a name that is None"),
        pytest.param(lambda: optik.load("paper6r").errors(np.zeros(6), np.eye(3)), id="a target that is a rotation"),
        pytest.param(
            lambda: optik.load("paper6r").errors(np.zeros((3, 6)), np.zeros((2, 4, 4))), id="targets of another batch"
        ),
        pytest.param(lambda: optik.load("paper6r").errors(np.zeros(6), "there"), id="a target that is a word"),
    ],
)
def test_misuse_is_answered_by_optiks_own_error(misuse):
    with pytest.raises(OptikError):
        misuse()


@pytest.mark.parametrize("bound", [np.inf, -np.inf])
def test_limits_that_no_finite_configuration_meets_are_refused(bound):
    with pytest.raises(InvalidInput):
        JointLimits([bound], [bound])


def test_a_bad_last_row_of_a_standard_table_is_blamed_on_the_table():
    with pytest.raises(RobotModelError):
        Robot.from_dh([DHRow(a=np.nan)], ONE)


def test_a_complex_configuration_is_refused():
    with pytest.raises(InvalidInput):
        optik.load("paper6r").fk(np.full(6, 0.1j))
