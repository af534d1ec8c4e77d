"""The bound on the reach: never broken by a configuration, sharp where a closed form knows the reach, and well said."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, IKStatus, JointLimits, Robot, Tolerance
from optik.arm.reach import outside_reach, reach_bound
from optik.ik import DLS, LM
from optik.task import Task, as_task
from tests import oracles
from tests.robots import BOUNDED, built

PAPER, ARM = optik.load("paper6r"), oracles.table("paper6r")
seeds = st.integers(0, 10**6)


def planar(lengths):
    """An arm of parallel axes, the last link the tool's."""
    rows = [DHRow(a=a) for a in (0.0, *lengths[:-1])]
    n = len(lengths)
    return Robot.from_mdh(rows, JointLimits([-3.2] * n, [3.2] * n), tool=oracles.trans(x=lengths[-1]))


def proved(robot, target, task="pose", tolerance=(0.0, 0.0)):
    return outside_reach(reach_bound(robot, as_task(task)), np.ascontiguousarray(target), *tolerance) >= 0.0


# ---------------------------------------------------------------- never a false proof
@given(
    seeds,
    st.integers(1, 12),
    st.booleans(),
    st.sampled_from(["mdh", "dh"]),
    st.sampled_from(["pose", "position", "axis_z"]),
)
def test_no_configuration_breaks_the_bound(seed, n, prismatic, convention, task):
    rng = np.random.default_rng(seed)
    arm = oracles.random_arm(rng, n, prismatic=prismatic, convention=convention)
    if prismatic:  # sliding one way only, or about zero
        shift = rng.uniform(-4, 4)
        arm = oracles.Arm(convention, arm.rows, arm.base, arm.tool, arm.lower + shift, arm.upper + shift)
    reach = reach_bound(built(arm), as_task(task))
    q = rng.uniform(arm.lower, arm.upper, (80, n))
    ends = rng.random(q.shape) < 0.3
    q[ends] = np.where(rng.random(q.shape) < 0.5, arm.lower, arm.upper)[ends]
    for T in oracles.fk(arm, q):
        assert outside_reach(reach, np.ascontiguousarray(T), 0.0, 0.0) < 0.0


@pytest.mark.parametrize("task", ["pose", "position", "axis_x"])
@pytest.mark.parametrize("name", BOUNDED)
def test_no_configuration_of_a_robot_breaks_its_bound(name, task):
    arm, reach = oracles.table(name), reach_bound(optik.load(name), as_task(task))
    rng = np.random.default_rng(301)
    q = rng.uniform(arm.lower, arm.upper, (1000, arm.n))
    q[rng.random(q.shape) < 0.3] = 0.0  # straight arms
    q = np.clip(q, arm.lower, arm.upper)
    for T in oracles.fk(arm, q):
        assert outside_reach(reach, np.ascontiguousarray(T), 0.0, 0.0) < 0.0


@given(seeds, st.booleans())
def test_the_tolerance_is_left_as_room(seed, far):
    """Targets that a configuration meets only within the tolerance are not proved out, at the very edge of the reach."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.1, 1.0, 3) if far else np.array([1.0, 0.2, 0.3])
    robot = planar(lengths)
    q = np.array([rng.uniform(-3, 3), 0.0, rng.uniform(-3, 3) if far else 0.0])
    T = robot.fk(q)
    position, rotation = 10.0 ** rng.uniform(-6, -1, 2)
    away, turn = rng.normal(size=3), rng.normal(size=3)
    off = oracles.pose(rotation * turn / np.linalg.norm(turn), (0, 0, 0))
    target = oracles.trans(*(position * away / np.linalg.norm(away))) @ T
    target[:3, :3] = off[:3, :3] @ target[:3, :3]
    assert not proved(robot, target, tolerance=(position, rotation))


@given(seeds, st.integers(2, 7), st.booleans())
def test_what_a_solver_was_asked_and_can_be_met_is_never_called_unreachable(seed, n, prismatic):
    rng = np.random.default_rng(seed)
    arm = oracles.random_arm(rng, n, prismatic=prismatic)
    for task in ("pose", "position", "rotation", "axis_y"):
        solver = DLS(built(arm), task=task, max_iterations=3)
        q = rng.uniform(arm.lower, arm.upper)
        result = solver.solve(oracles.fk(arm, q), rng.uniform(arm.lower, arm.upper))
        assert result.status is not IKStatus.UNREACHABLE


# ---------------------------------------------------------------- sharp
@pytest.mark.parametrize("lengths", [(1.0, 0.7), (0.3, 0.9), (1.0, 0.5, 0.4), (0.2, 0.3, 0.9)], ids=str)
@pytest.mark.parametrize("task", ["pose", "position"])
def test_a_planar_arm_is_proved_out_just_beyond_its_closed_form(lengths, task):
    robot, lengths = planar(lengths), np.array(lengths)
    counted = lengths[:-1] if task == "pose" else lengths  # of a pose the last joint's axis is known
    most = counted.sum()
    least = max(0.0, 2.0 * counted.max() - most)
    rng, reach = np.random.default_rng(302), reach_bound(robot, as_task(task))

    def out(target):
        return outside_reach(reach, np.ascontiguousarray(target), 0.0, 0.0) >= 0.0

    def target(distance):
        """The point that counts at so far from the base, in some direction of the plane."""
        a, b = rng.uniform(-3, 3, 2)
        T = oracles.rot_z(a) @ oracles.trans(x=distance) @ oracles.rot_z(b)
        return T @ oracles.trans(x=lengths[-1]) if task == "pose" else T

    for _ in range(50):
        assert out(target(most + 1e-6))
        assert not out(target(most - 1e-12))
        assert not out(target(rng.uniform(least, most)))
        if least > 0.0:
            assert out(target(least - 1e-6))
            assert not out(target(least + 1e-12))


def test_a_slider_is_proved_out_at_both_its_ends():
    robot = Robot.from_mdh([DHRow(prismatic=True)], JointLimits([0.5], [2.0]))
    for z, out in ((0.4, True), (0.5, False), (1.0, False), (2.0, False), (2.1, True), (-0.4, True), (-2.1, True)):
        assert proved(robot, oracles.trans(z=z)) is out
    free = Robot.from_mdh([DHRow(prismatic=True)], JointLimits([0.5], [np.inf]))
    assert not proved(free, oracles.trans(z=1e5))


@pytest.mark.parametrize("name", BOUNDED)
def test_the_bound_is_within_a_quarter_of_what_is_found(name):
    arm = oracles.table(name)
    A, c, _, most = np.split(reach_bound(optik.load(name), as_task("pose")), [3, 6, 7])
    T = oracles.fk(arm, oracles.configurations(arm, 20_000, 303))
    far = np.linalg.norm(T[:, :3, :3] @ c + T[:, :3, 3] - A, axis=1).max()
    assert far <= most[0] <= 1.35 * far


# ---------------------------------------------------------------- what the solvers say
@pytest.mark.parametrize("method", [LM, DLS])
@pytest.mark.parametrize("task", ["pose", "position", "axis_z"])
def test_a_far_target_is_proved_out_and_the_message_has_the_bound(method, task):
    solver = method(PAPER, task=task)
    rng = np.random.default_rng(304)
    bound = reach_bound(PAPER, as_task(task))
    for _ in range(10):
        target = oracles.pose(rng.uniform(-3, 3, 3), rng.choice([-1, 1], 3) * rng.uniform(2, 20, 3))
        result = solver.solve(target, rng.uniform(ARM.lower, ARM.upper))
        assert result.status is IKStatus.UNREACHABLE
        assert result.restarts == 0
        numbers = [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", result.message)]
        distance, A, allowed = numbers[0], numbers[1:4], numbers[-1]
        point = target[:3, :3] @ bound[3:6] + target[:3, 3]
        assert distance == pytest.approx(np.linalg.norm(point - bound[:3]), rel=1e-5)
        assert pytest.approx(bound[:3], rel=1e-3, abs=1e-4) == A
        assert allowed == pytest.approx(bound[7], rel=1e-5)
        assert "at most" in result.message
        far = oracles.fk(ARM, oracles.configurations(ARM, 300, 305))
        reached = np.linalg.norm(far[:, :3, :3] @ bound[3:6] + far[:, :3, 3] - bound[:3], axis=1).max()
        assert reached <= allowed * (1.0 + 1e-6) < distance * (1.0 + 1e-6)


def test_too_near_is_said_as_such():
    robot = planar((1.0, 0.2, 0.1, 0.1))  # of four joints, for which the kernel is compiled already
    result = LM(robot).solve(oracles.trans(x=0.2), np.full(4, 0.1))
    assert result.status is IKStatus.UNREACHABLE
    assert "at least 0.7 m" in result.message


def test_without_a_position_nothing_is_proved():
    for task in ("rotation", Task((1, 1, 0, 1, 1, 1)), Task((0, 0, 1, 0, 0, 0), "base")):
        assert not proved(PAPER, oracles.trans(x=1e5), task)


def test_a_wide_tolerance_reaches_what_the_arm_does_not():
    target = oracles.trans(x=1.0) @ oracles.fk(ARM, np.zeros(6))
    assert LM(PAPER).solve(target, np.zeros(6)).status is IKStatus.UNREACHABLE
    assert LM(PAPER, tolerance=Tolerance(2.0, 1e-6)).solve(target, np.zeros(6))
