"""The free motion of arms with more than six joints: its kernels against dense algebra, and paths that it must follow."""

import numpy as np
import pytest

from optik import Robot, newton
from optik.arm.library import load
from optik.arm.limits import JointLimits
from optik.arm.robot import DHRow
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.se3 import exp_so3
from optik.types import Array
from planners import Line, MotionLimits, follow, plan
from planners.following import smoothing
from planners.following.failure import FollowStatus
from planners.following.redundancy import NullSpaceMotion, find_null_space_motions
from planners.paths.arc import Arc
from tests import oracles
from tests.planners.chains import draw_seam, two_arms
from tests.planners.polylines import keeps_on


@pytest.mark.parametrize("d", [1, 2, 3])
def test_a_block_tridiagonal_system_is_solved_as_a_dense_one(d: int) -> None:
    rng, k = np.random.default_rng(d), 9
    L = np.zeros((k * d, k * d))
    for i in range(k):
        at = slice(i * d, (i + 1) * d)
        L[at, at] = np.tril(rng.normal(size=(d, d))) + 3.0 * np.eye(d)
        if i:
            L[at, slice((i - 1) * d, i * d)] = rng.normal(size=(d, d))
    A, b = L @ L.T, rng.normal(size=k * d)
    D = np.array([A[i * d : (i + 1) * d, i * d : (i + 1) * d] for i in range(k)])
    C = np.array([A[i * d : (i + 1) * d, max(i - 1, 0) * d : max(i, 1) * d] for i in range(k)])
    x = b.reshape(k, d).copy()
    smoothing.solve_block_tridiagonal(D, C, x)
    np.testing.assert_allclose(x.ravel(), np.linalg.solve(A, b), rtol=1e-9)


@pytest.mark.parametrize("n", [7, 8, 9])
def test_free_directions_are_an_orthonormal_null_space_turned_little(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        J = rng.normal(size=(6, n))
        null = np.linalg.svd(J)[2][6:].T
        before = null @ np.linalg.qr(rng.normal(size=(n - 6, n - 6)))[0] + 0.05 * rng.normal(size=(n, n - 6))
        N = np.empty((n, n - 6))
        smoothing.find_null_space(J, before, N)
        np.testing.assert_allclose(N.T @ N, np.eye(n - 6), atol=1e-12)
        np.testing.assert_allclose(J @ N, 0.0, atol=1e-12)
        np.testing.assert_allclose(N, before, atol=0.5)


def cost(robot: Robot, way: Array, shares: Array) -> float:
    """½ Σ |Δq|² / Δs and the trapezoid of the room to the limits."""
    middle, half = 0.5 * (robot.limits.lower + robot.limits.upper), 0.5 * (robot.limits.upper - robot.limits.lower)
    room = -np.log(1.0 - ((way - middle) / half) ** 2).sum(axis=1)
    h = np.diff(shares)
    return float(
        0.5 * (np.diff(way, axis=0) ** 2 / h[:, None]).sum()
        + smoothing.BARRIER_WEIGHT * (0.5 * (room[1:] + room[:-1]) * h).sum()
    )


@pytest.mark.parametrize("held", [False, True])
def test_the_smooth_free_motion_is_a_minimum_of_its_cost(held: bool) -> None:
    robot, rng = load("panda"), np.random.default_rng(1)
    q = np.array([0.2, -0.3, 0.1, -2.0, 0.2, 1.8, 0.5])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), np.array([0.1, 0.2, -0.1])))
    motion = next(find_null_space_motions(robot, line, q, "start" if held else "best"))
    if held:
        np.testing.assert_allclose(motion.way[0], q, atol=1e-9)
    shares, least = motion.s / line.end, cost(robot, motion.way, motion.s / line.end)
    poses = line.pose(motion.s)
    for k in rng.integers(1 if held else 0, len(motion.s), 12):
        for step in (-1e-3, 1e-3):  # along the curve of solutions of one station, back onto it
            other = motion.way.copy()
            x = other[k : k + 1] + step * motion.N[k, :, 0]
            newton.polish_batch(robot.chain, x, poses[k : k + 1], 12)
            other[k] = x[0]
            assert cost(robot, other, shares) > least


# ---------------------------------------------------------------- arcs that a continuous motion follows
def check_arcs(name: str, how_many: int) -> None:
    robot, rng, seen = load(name), np.random.default_rng(17), 0
    lower, upper = robot.limits.lower, robot.limits.upper
    while seen < how_many:
        q = lower + (upper - lower) * rng.uniform(0.02, 0.98, 7)
        T, size = robot.fk(q), rng.uniform(0.03, 0.25)
        via, goal = T[:3, 3] + size * rng.normal(size=3) / 1.7, oracles.moved(T, size * rng.normal(size=3) / 1.2)
        goal[:3, :3] = goal[:3, :3] @ exp_so3(0.3 * rng.normal(size=3) * (rng.random() < 0.5))
        try:
            path = Arc.through(T, via, goal)
        except InvalidInput:
            continue
        if keeps_on(robot, path, q):
            seen += 1
            for branch in ("start", "best"):
                followed = follow(make_solver(robot, "lm"), path, q, branch=branch)
                assert followed and followed.joint_path is not None, followed.failure
                assert max(followed.joint_path.bound) <= 1e-5


@pytest.mark.parametrize("name", ["iiwa14", "panda"])
def test_arcs_that_a_continuous_motion_follows_are_followed(name: str) -> None:
    check_arcs(name, 2)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["iiwa14", "panda"])
def test_a_hundred_arcs_that_a_continuous_motion_follows_are_followed(name: str) -> None:
    check_arcs(name, 100)


def test_a_station_that_needs_a_nearer_one_before_it_does_not_end_the_way() -> None:
    robot = load("iiwa14")  # the elbow is nearly straight: the first station is too far for one step
    q = np.array(
        [
            1.2185039422, 0.421206905659, -1.3460362172736, 0.038769288011781, -0.3394059302775, 0.57660290789375,
            0.20626421936,
        ]
    )  # fmt: skip
    start = robot.fk(q)
    goal = oracles.moved(start, np.array([0.11718277, 0.08913643, -0.23533859]), np.array([-0.06, -0.15, -0.09]))
    path = Arc.through(start, start[:3, 3] + np.array([0.1291949, 0.00960465, -0.09201861]), goal)
    assert keeps_on(robot, path, q)
    motion = next(find_null_space_motions(robot, path, q, "start"))
    assert motion.s[-1] == path.end and len(motion.s) > 25
    assert follow(make_solver(robot, "lm"), path, q)


# ---------------------------------------------------------------- arms of lower rank
@pytest.mark.parametrize("joints", [6, 7])
@pytest.mark.parametrize("branch", ["start", "best"])
def test_an_arm_of_lower_rank_is_told_its_rank(joints: int, branch: str) -> None:
    rows = [DHRow(a=0.2, alpha=0.0, d=0.0, prismatic=i == 3) for i in range(joints)]  # all axes vertical: rank 4
    robot = Robot.from_dh(rows, JointLimits(np.full(joints, -3.0), np.full(joints, 3.0)), name="flat")
    q = np.linspace(0.3, 0.9, joints)
    followed = follow(
        make_solver(robot, "lm"),
        Line(robot.fk(q), oracles.moved(robot.fk(q), np.array([0.02, 0.0, 0.0]))),
        q,
        branch=branch,
    )
    assert followed.joint_path is None and followed.failure is not None
    assert followed.failure.status is FollowStatus.SINGULAR
    assert "rank 4 of 6" in followed.failure.reason


# ---------------------------------------------------------------- sequences that end before the path does
def test_the_guide_has_no_kink_behind_its_last_station() -> None:
    robot, q = load("iiwa14"), np.array([0.2, 0.5, 0.1, -1.2, 0.2, 0.9, 0.5])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), np.array([0.1, 0.2, -0.1])))
    motion = next(find_null_space_motions(robot, line, q, "start"))
    motion.s, motion.way = motion.s[:12], motion.way[:12]
    guide, end, h = motion.guide(), float(motion.s[11]), 1e-5
    s = end + h * np.arange(-400.0, 401.0)
    for orders in guide(s):
        assert np.abs(orders[:, 1]).max() > 0.01  # it moves there
        for order in range(3):
            slope = np.gradient(orders[:, order], h, axis=0)[1:-1]
            np.testing.assert_allclose(
                slope, orders[1:-1, order + 1], atol=1e-3 * np.abs(orders[:, order + 1]).max() + 1e-6
            )


def test_a_sequence_that_ends_early_is_continued_to_the_end_of_the_path() -> None:
    robot, q = load("iiwa14"), np.array([0.2, 0.5, 0.1, -1.2, 0.2, 0.9, 0.5])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), np.array([0.1, 0.2, -0.1])))
    whole = next(find_null_space_motions(robot, line, q, "start"))
    begun = NullSpaceMotion(robot, line, whole.s[:10], whole.way[:10].copy(), held=True)
    assert begun.s[-1] == line.end
    np.testing.assert_allclose(begun.way, whole.way, atol=1e-3)


@pytest.mark.parametrize("seed", [7, 12])
def test_a_seam_of_two_arms_takes_no_minutes_where_the_search_is_stuck(seed: int) -> None:
    robot = two_arms()
    limits, path = MotionLimits.of(robot), draw_seam(np.random.default_rng([7, seed]), 0.6)
    found = plan(robot, path, limits=limits)
    assert found and found.resolution is not None and found.resolution.stuck is not None
    s = np.linspace(0.0, path.end, 2000)
    speed = np.abs(found.joint_path(s, 1))
    fastest = float((speed / robot.limits.velocity).max(axis=1).mean()) * path.end
    assert found.duration <= 3.0 * (fastest + 0.3)
    assert np.abs(np.diff(speed, axis=0)).max() <= 0.1 * speed.max()
    assert found.slowness is None


def test_a_plan_says_where_it_is_far_slower_than_its_velocities_require() -> None:
    robot, q = load("ur5e"), np.array([0.1, -1.5, 1.5, -1.2, -1.5, 0.3])
    pose = oracles.moved(robot.fk(q), np.array([0.1, 0.2, -0.1]))
    limits = MotionLimits(velocity=1.0, acceleration=5.0, jerk=50.0)
    assert "slow:" not in str(plan(robot, pose, q, limits=limits))
    assert "slow: 1" in str(plan(robot, pose, q, limits=limits, duration=150.0))


def test_smoothing_is_undone_where_a_configuration_leaves_the_path() -> None:
    robot = load("panda")
    q = robot.limits.middle + 0.1 * np.arange(7.0)
    path = Line(robot.fk(q), oracles.moved(robot.fk(q), [0.0, 0.1, 0.0], np.zeros(3)))
    motion = find_null_space_motions(robot, path, q, "start")
    found = next(motion)
    before, poses = found.way.copy(), path.pose(found.s)
    poses[3, :3, 3] += 5.0  # out of reach: no fraction of the smoothing is on the path
    found.way = before + 0.01
    found._retreat(before, poses, lambda way: np.ones(len(way)))
    on = [k for k in range(len(poses)) if k != 3]
    off = robot.pose_errors(found.way[on], poses[on])
    assert np.abs(off).max() < 1e-6
    np.testing.assert_allclose(found.way[on], before[on], atol=1e-6)  # the last fraction is 0
