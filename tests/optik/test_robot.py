"""The arm: conventions against matrix products, limits, identity, and what is refused."""

import pickle
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, JointLimits, Robot
from optik.errors import InvalidInput, OptikError, RobotModelError
from tests import forks, oracles
from tests.robots import built

BUILD = {"mdh": Robot.from_mdh, "dh": Robot.from_dh}


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


def test_rows_may_be_mappings_with_the_names_of_the_columns():
    limits = JointLimits([-1], [1])
    assert Robot.from_mdh([{"a": 0.1, "alpha": 0.2}], limits) == Robot.from_mdh([DHRow(a=0.1, alpha=0.2)], limits)


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
    e = robot.pose_errors(q, target)
    assert e.shape == (*shape, 6)
    for i in np.ndindex(shape):
        assert np.abs(e[i] - oracles.error(robot.fk(q[i]), target)).max() < 1e-14


def test_errors_of_many_targets_are_those_of_each():
    robot = optik.load("paper6r")
    q = oracles.configurations(oracles.table("paper6r"), 5, 1)
    targets = robot.fk(oracles.configurations(oracles.table("paper6r"), 5, 2))
    expected = np.array([oracles.error(T, goal) for T, goal in zip(robot.fk(q), targets, strict=True)])
    assert np.abs(robot.pose_errors(q, targets) - expected).max() < 1e-13


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
    assert forks.start(code)().stdout.strip() == optik.load("puma560").fingerprint


def changed(robot, **changes):
    return Robot(**{f.name: getattr(robot, f.name) for f in fields(robot)} | changes)


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
    for name in ("lower", "upper", "velocity", "acceleration", "jerk", "torque"):
        others.append(changed(robot, limits=replace(limits, **{name: nudged(getattr(limits, name))})))
    for name in ("velocity", "acceleration", "jerk", "torque"):
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
    for function in (robot.fk, robot.frames, robot.jacobian, lambda q: robot.pose_errors(q, np.eye(4))):
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
        pytest.param(
            lambda: optik.load("paper6r").pose_errors(np.zeros(6), np.eye(3)), id="a target that is a rotation"
        ),
        pytest.param(
            lambda: optik.load("paper6r").pose_errors(np.zeros((3, 6)), np.zeros((2, 4, 4))),
            id="targets of another batch",
        ),
        pytest.param(lambda: optik.load("paper6r").pose_errors(np.zeros(6), "there"), id="a target that is a word"),
    ],
)
def test_misuse_is_answered_by_optiks_own_error(misuse):
    with pytest.raises(OptikError):
        misuse()


def test_a_bad_last_row_of_a_standard_table_is_blamed_on_the_table():
    with pytest.raises(RobotModelError):
        Robot.from_dh([DHRow(a=np.nan)], ONE)


def test_a_complex_configuration_is_refused():
    with pytest.raises(InvalidInput):
        optik.load("paper6r").fk(np.full(6, 0.1j))
