"""Compiled kinematics against Pinocchio, other sources of the robots' tables, differences and power series."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, JointLimits, Robot, kinematics, newton
from optik.task import POSE, judge
from tests import oracles
from tests.robots import BOUNDED, built
from tests.seeds import shift_seed

COUNT = 1000
each_robot = pytest.mark.parametrize("name", BOUNDED)
six = [name for name in BOUNDED if optik.load(name).n == 6]
six_or_more = [name for name in BOUNDED if optik.load(name).n >= 6]
random_arms = st.builds(
    lambda seed, n, prismatic, convention: oracles.random_arm(
        np.random.default_rng(seed), n, prismatic=prismatic, convention=convention
    ),
    st.integers(0, 10**6),
    st.integers(1, 8),
    st.booleans(),
    st.sampled_from(["mdh", "dh"]),
)


def motion(robot, q, dq):
    """`tool_motion_batch` for one or many."""
    q, dq = np.atleast_2d(q), np.asarray(dq, dtype=float).reshape(-1, 3, robot.n)
    out = np.full((len(q), 3, 6), np.nan)
    kinematics.tool_motion_batch(robot.chain, q, dq, out)
    return out


def derivatives(robot, q, twists):
    """`derivatives_at` of many (k, 3, n), with free motion where n > 6 held along random rows; and the least rank."""
    d = max(robot.n - 6, 0)
    out, rows, values = np.full((len(q), 3, robot.n), np.nan), np.zeros((4, d, robot.n)), np.zeros((4, d))
    rows[0] = np.random.default_rng(39).normal(size=(d, robot.n))
    ranks = [newton.derivatives_at(robot.chain, q[k], twists[k], rows, values, out[k])[0] for k in range(len(q))]
    return out, min(ranks)


def polished(robot, q, targets, steps=10):
    q = np.array(q)
    newton.polish_batch(robot.chain, q, targets, steps)
    return q


def size(e):
    return np.linalg.norm(e, axis=-1)


# ---------------------------------------------------------------- other libraries
def are_pinocchios(robot, arm, q):
    """Compare with Pinocchio's model of the rows; the base turns its Jacobian, and a tool would move its point."""
    theirs = oracles.Pinocchio(arm)
    assert np.abs(robot.fk(q) - arm.base @ [theirs.fk(x) for x in q] @ arm.tool).max() < 1e-12
    bare = robot.with_tool(robot.tool @ np.linalg.inv(arm.tool))
    turned = np.kron(np.eye(2), arm.base[:3, :3])
    assert np.abs(bare.jacobian(q) - turned @ [theirs.jacobian(x) for x in q]).max() < 1e-12


@each_robot
def test_forward_kinematics_and_jacobian_are_pinocchios(name):
    pytest.importorskip("pinocchio")
    arm = oracles.table(name)
    are_pinocchios(optik.load(name), arm, oracles.configurations(arm, COUNT, 11))


@pytest.mark.parametrize("convention", ["mdh", "dh"])
@pytest.mark.parametrize("n", [1, 5, 7])
def test_arms_with_a_sliding_joint_are_pinocchios(convention, n):
    pytest.importorskip("pinocchio")
    rng = np.random.default_rng(n)
    for _ in range(5):
        arm = oracles.random_arm(rng, n, prismatic=True, convention=convention)
        are_pinocchios(built(arm), arm, rng.uniform(-3, 3, (20, n)))


# ---------------------------------------------------------------- Jacobian

# Sixth-order central differences: the truncation at this step is about h⁶/140 = 1e-13, the rounding about 1e-14.
STEP = 0.01
STENCIL = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}


@each_robot
def test_jacobian_is_the_central_difference_of_forward_kinematics(name):
    robot = optik.load(name)
    q = oracles.configurations(oracles.table(name), COUNT, 14)
    R, J = robot.fk(q)[:, :3, :3], robot.jacobian(q)
    for i in range(robot.n):
        slope = np.zeros((COUNT, 4, 4))
        for k, weight in STENCIL.items():
            e = STEP * k * np.eye(robot.n)[i]
            slope += weight / STEP * (robot.fk(q + e) - robot.fk(q - e))
        turn = oracles.vee(slope[:, :3, :3] @ np.swapaxes(R, 1, 2))
        assert np.abs(J[:, :3, i] - slope[:, :3, 3]).max() < 1e-8
        assert np.abs(J[:, 3:, i] - turn).max() < 1e-8


# ---------------------------------------------------------------- motion of the tool
@given(random_arms, st.integers(0, 10**6))
def test_tool_motion_is_the_power_series_of_the_link_matrices(arm, seed):
    rng = np.random.default_rng(seed)
    q, dq = rng.uniform(-3, 3, arm.n), rng.uniform(-2, 2, (3, arm.n))
    expected = oracles.tool_motion(arm, q, dq)
    assert np.abs(motion(built(arm), q, dq)[0] - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("prismatic", [False, True])
def test_tool_motion_is_the_difference_of_the_oracles_jacobian_along_the_motion(prismatic):
    # a second oracle, by differences alone: V = J(q(t)) q̇(t), its slope and its curvature at t = 0
    arm = oracles.random_arm(np.random.default_rng(20), prismatic=prismatic)
    rng = np.random.default_rng(21)
    q, dq = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, (3, 6))

    def twist(t):
        x = q + dq[0] * t + dq[1] * t**2 / 2 + dq[2] * t**3 / 6
        return oracles.jacobian(arm, x) @ (dq[0] + dq[1] * t + dq[2] * t**2 / 2)

    h = 0.01
    slope = sum(w / h * (twist(k * h) - twist(-k * h)) for k, w in STENCIL.items())
    second = {1: 3 / 2, 2: -3 / 20, 3: 1 / 90}
    bend = sum(w / h**2 * (twist(k * h) - 2 * twist(0) + twist(-k * h)) for k, w in second.items())
    made = motion(built(arm), q, dq)[0]
    assert np.abs(made[0] - twist(0)).max() < 1e-13
    assert np.abs(made[1] - slope).max() < 1e-9
    assert np.abs(made[2] - bend).max() < 1e-8


def test_tool_motion_of_a_batch_is_that_of_each():
    robot = optik.load("paper6r")
    rng = np.random.default_rng(22)
    q, dq = rng.uniform(-1, 1, (7, 6)), rng.uniform(-1, 1, (7, 3, 6))
    together = motion(robot, q, dq)
    for k in range(7):
        assert (together[k] == motion(robot, q[k], dq[k])[0]).all()


def regular(name, count, seed):
    """Configurations whose Jacobian is far from losing rank."""
    robot = optik.load(name)
    q = oracles.configurations(oracles.table(name), 10 * count, seed)
    return q[np.linalg.svd(robot.jacobian(q))[1][:, -1] > 0.05][:count]


@pytest.mark.parametrize("name", six_or_more)
def test_derivatives_follow_the_twists_they_are_given(name):
    robot, q = optik.load(name), regular(name, 100, 23)
    twists = np.random.default_rng(24).uniform(-1, 1, (len(q), 3, 6))
    dq, rank = derivatives(robot, q, twists)
    assert rank > 1e-4
    scale = np.abs(dq).max(axis=(1, 2))
    arm = oracles.table(name)
    made = np.array([oracles.tool_motion(arm, *x) for x in zip(q, dq, strict=True)])
    assert (np.abs(made - twists).max(axis=(1, 2)) < 1e-12 * np.maximum(1.0, scale**3)).all()


@pytest.mark.parametrize("name", six)
def test_derivatives_undo_tool_motion(name):
    robot, q = optik.load(name), regular(name, 100, 25)
    dq = np.random.default_rng(26).uniform(-1, 1, (len(q), 3, robot.n))
    back, rank = derivatives(robot, q, motion(robot, q, dq))
    assert rank > 1e-4
    assert np.abs(back - dq).max() < 1e-9


def test_derivatives_of_an_arm_without_rank_are_none():
    # parallel sliding joints: the Jacobian is singular exactly, without rounding
    arm = Robot.from_mdh([DHRow(prismatic=True)] * 3, JointLimits([-1] * 3, [1] * 3))
    dq, rank = derivatives(arm, np.zeros((1, 3)), np.ones((1, 3, 6)))
    assert rank == 0.0
    assert (dq == 0.0).all()


def test_a_lost_rank_is_seen_wherever_the_wrist_is_straight():
    robot = optik.load("paper6r")
    q = oracles.configurations(oracles.table("paper6r"), 100, 34)
    q[:, 4] = 0.0  # axes 4 and 6 in line
    assert np.linalg.svd(robot.jacobian(q))[1][:, -1].max() < 1e-15
    assert all(derivatives(robot, x[None], np.ones((1, 3, 6)))[1] < 1e-12 for x in q)


def test_derivatives_of_a_line_are_the_differences_of_its_joint_path():
    # q(s) solved by Newton along a line and differenced, beside the exact derivatives at its middle
    robot = optik.load("paper6r")
    q0 = np.radians([20, -35, 40, 25, 50, -30])
    T0, h, way = robot.fk(q0), 0.005, np.array([-0.12, 0.0, 0.2]) / np.hypot(0.12, 0.2)
    targets = np.array([oracles.trans(*(k * h * way)) @ T0 for k in range(-3, 4)])
    q = polished(robot, np.repeat(q0[None], 7, axis=0), targets)
    assert size(robot.pose_errors(q, targets)).max() < 1e-13
    twists = np.zeros((1, 3, 6))
    twists[0, 0, :3] = way
    dq = derivatives(robot, q[3:4], twists)[0][0]
    slope = sum(w / h * (q[3 + k] - q[3 - k]) for k, w in STENCIL.items())
    bend = sum(w / h**2 * (q[3 + k] - 2 * q[3] + q[3 - k]) for k, w in {1: 3 / 2, 2: -3 / 20, 3: 1 / 90}.items())
    third = sum(w / h**3 * (q[3 + k] - q[3 - k]) for k, w in {1: -13 / 8, 2: 1, 3: -1 / 8}.items())
    assert np.abs(dq[0] - slope).max() < 1e-8
    assert np.abs(dq[1] - bend).max() < 1e-5
    assert np.abs(dq[2] - third).max() < 1e-1
    assert np.abs(dq[2]).max() > 10.0  # so that the line above says something


# ---------------------------------------------------------------- polishing
@pytest.mark.parametrize("name", six_or_more)
def test_polish_reaches_rounding_from_a_solvers_tolerance(name):
    robot, q = optik.load(name), regular(name, 200, 28)
    targets = robot.fk(q)
    near = q + np.random.default_rng(29).uniform(-1e-3, 1e-3, q.shape)
    assert size(robot.pose_errors(near, targets)).min() > 1e-6
    better = polished(robot, near, targets)
    errors = [oracles.error(T, goal) for T, goal in zip(robot.fk(better), targets, strict=True)]
    assert size(np.array(errors)).max() < 1e-12
    assert robot.n > 6 or np.abs(better - q).max() < 1e-11


@each_robot
def test_polish_never_makes_an_error_larger(name):
    robot = optik.load(name)
    arm = oracles.table(name)
    q = np.vstack([oracles.configurations(arm, 200, 30), np.zeros((1, robot.n))])
    targets = robot.fk(np.vstack([oracles.configurations(arm, 200, 31), np.full((1, robot.n), 0.3)]))
    before = size(robot.pose_errors(q, targets))
    after = size(robot.pose_errors(polished(robot, q, targets), targets))
    assert (after <= before).all()
    assert np.isfinite(after).all()


def test_polish_of_no_steps_changes_nothing():
    robot = optik.load("paper6r")
    q = regular("paper6r", 3, 32)
    assert (polished(robot, q, robot.fk(q + 0.01), steps=0) == q).all()


def test_polish_converges_quadratically():
    robot, q = optik.load("paper6r"), regular("paper6r", 50, shift_seed(33))
    targets, near = robot.fk(q), q + 1e-3
    sizes = [size(robot.pose_errors(polished(robot, near, targets, k), targets)) for k in range(4)]
    assert np.median(sizes[1] / sizes[0]) < 1e-2
    assert np.median(sizes[2] / sizes[0]) < 1e-6


# ---------------------------------------------------------------- the judge
@given(random_arms, st.integers(0, 10**6))
def test_the_judge_sees_what_errors_sees_and_the_limits(arm, seed):
    robot, rng = built(arm), np.random.default_rng(seed)
    q, target = rng.uniform(-3.3, 3.3, arm.n), oracles.fk(arm, rng.uniform(-3, 3, arm.n))
    lower, upper = robot.limits.lower, robot.limits.upper
    position, rotation, inside = judge(robot.chain, (lower, upper), (POSE.flags, target), 1e-9, q)
    e = oracles.error(oracles.fk(arm, q), target)
    assert abs(position - np.linalg.norm(e[:3])) < 1e-13
    assert abs(rotation - np.linalg.norm(e[3:])) < 1e-12
    assert inside == bool((np.abs(q) <= 3.0).all())
