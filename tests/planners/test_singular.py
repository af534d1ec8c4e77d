"""Singular configurations on the way: what the joints can do smoothly is followed and proved, what they cannot is refused."""

from itertools import count

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import optik
from optik import Robot, newton
from optik.arm.library import load
from optik.ik import Tolerance, make_solver
from optik.types import Array
from planners import Line, follow
from planners.following import march
from planners.following.failure import FollowStatus
from planners.following.follow import FollowResult
from planners.following.joint_path import SMALL_DEVIATION, JointPath, deviation_bounds
from tests import oracles

ARMS = ("irb120", "paper6r", "puma560", "kr6")


def middle(robot: Robot, rng: np.random.Generator) -> Array:
    lower, upper = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    return lower + (upper - lower) * rng.uniform(0.35, 0.65, robot.n)


def check_proved(followed: FollowResult, tolerance: float = 1e-5) -> JointPath:
    """The whole path, proved; densely sampled within the proof, inside the limits, and without a jump."""
    assert followed, followed.failure
    joint_path = followed.joint_path
    assert joint_path is not None and joint_path.end == joint_path.path.end
    s = np.linspace(0.0, joint_path.end, 501)
    q, poses = joint_path(s), joint_path.path.pose(s)
    T = joint_path.robot.fk(q)
    turned = Rotation.from_matrix(T[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)).magnitude().max()
    assert np.linalg.norm(T[:, :3, 3] - poses[:, :3, 3], axis=1).max() <= joint_path.bound[0] + 1e-13
    assert turned <= joint_path.bound[1] + 1e-13
    assert max(joint_path.bound) <= tolerance
    assert joint_path.robot.limits.contains(q).all()
    assert np.abs(np.diff(joint_path(joint_path.nodes), axis=0)).max() <= 0.25 + 1e-9
    return joint_path


# ---------------------------------------------------------------- through a straight wrist in the arm's plane
def planar_end(robot: Robot, line: Line, q: Array, steps: int = 150) -> Array | None:
    """Where joints 2, 3 and 5 alone follow the line to, in so many steps; None where they do not."""
    x, lower, upper = q.copy(), robot.limits.lower, robot.limits.upper
    for pose in line.pose(np.linspace(0.0, line.end, steps + 1)[1:]):
        for _ in range(5):
            step = np.linalg.lstsq(robot.jacobian(x)[:, [1, 2, 4]], robot.pose_errors(x, pose), rcond=None)[0]
            if np.abs(step).max() > 0.5:
                return None
            x[[1, 2, 4]] += step
        if np.abs(robot.pose_errors(x, pose)).max() > 1e-9 or (x < lower).any() or (x > upper).any():
            return None
    return x


def passage(robot: Robot, rng: np.random.Generator) -> tuple[Line, Array, Array]:
    """A line through a straight wrist that the arm follows in its own plane, where it starts and where it ends."""
    while True:
        q = middle(robot, rng)
        q[3] = q[5] = 0.0
        q[4] = rng.uniform(0.05, 0.3) * rng.choice([-1, 1])
        g = q.copy()
        g[4] = -q[4] * rng.uniform(0.5, 1.5)
        g[1:3] += rng.uniform(-0.15, 0.15, 2)
        if robot.limits.contains(q) and robot.limits.contains(g):
            line = Line(robot.fk(q), robot.fk(g))
            end = planar_end(robot, line, q)
            if end is not None:
                return line, q, end


def check_passages(name: str, how_many: int) -> None:
    robot, rng = load(name), np.random.default_rng(5)
    solver = make_solver(robot, "lm")
    for _ in range(how_many):
        line, q, end = passage(robot, rng)
        joint_path = check_proved(follow(solver, line, q))
        np.testing.assert_allclose(joint_path.q[-1], end, atol=1e-6)
        assert np.abs(joint_path(np.linspace(0.0, line.end, 401))[:, [0, 3, 5]] - q[[0, 3, 5]]).max() < 1e-6
        assert follow(solver, line), "and with a start chosen for it"


@pytest.mark.parametrize("name", ARMS)
def test_a_straight_wrist_is_passed_in_the_arms_plane(name: str) -> None:
    check_passages(name, 2)


@pytest.mark.soak
@pytest.mark.parametrize("name", ARMS)
def test_two_hundred_straight_wrists_are_passed(name: str) -> None:
    check_passages(name, 50)


@pytest.mark.parametrize("samples", [2, 31, 150, 151])
def test_where_samples_fall_does_not_matter(samples: int) -> None:
    robot = load("kr6")
    line, q, end = passage(robot, np.random.default_rng(2))
    for tolerance in (1e-5, 1e-8):
        found = follow(make_solver(robot, "lm"), line, q, samples=samples, tolerance=Tolerance(tolerance, tolerance))
        np.testing.assert_allclose(check_proved(found, tolerance).q[-1], end, atol=1e-6)


def test_a_passage_is_as_smooth_as_the_joints_alone_would_be() -> None:
    robot = load("irb120")
    line, q, _ = passage(robot, np.random.default_rng(3))
    joint_path = check_proved(follow(make_solver(robot, "lm"), line, q))
    s, h = np.linspace(0.0, line.end, 400), 1e-3 * line.end

    def alone(at: float) -> Array:
        end = planar_end(robot, Line(line.start, line.pose(at)), q, 30) if at > 0 else q
        assert end is not None
        return end

    k = int(np.argmin(np.abs(joint_path(s)[:, 4])))
    for order, rate in ((1, lambda x: (alone(x + h) - alone(x - h)) / (2 * h)),
                        (2, lambda x: (alone(x + h) - 2 * alone(x) + alone(x - h)) / h**2)):  # fmt: skip
        for at in s[k - 6 : k + 7 : 3]:
            scale = np.abs(joint_path(s, order)).max()
            np.testing.assert_allclose(joint_path(at, order), rate(at), atol=2e-3 * scale)


# ---------------------------------------------------------------- from a singular start, and beside
def in_plane(robot: Robot, q: Array, rng: np.random.Generator) -> Array:
    """A direction in the plane in which the joints 2, 3 and 5 move the tool."""
    u, normal = rng.normal(size=3), robot.jacobian(q)[3:, 1]
    u -= normal * (normal @ u)
    return np.asarray(u / np.linalg.norm(u))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("back", [False, True])
def test_a_line_in_the_plane_from_or_to_a_straight_wrist_is_followed(name: str, back: bool) -> None:
    robot, rng, seen = load(name), np.random.default_rng(3), 0
    while seen < 1:
        q = middle(robot, rng)
        q[[3, 4, 5]] = 0.0
        line = Line(robot.fk(q), oracles.moved(robot.fk(q), rng.uniform(0.05, 0.15) * in_plane(robot, q, rng)))
        end = planar_end(robot, line, q)
        if end is None:
            continue
        seen += 1
        start, goal = (end, q) if back else (q, end)
        if back:
            line = Line(line.goal, line.start)
        joint_path = check_proved(follow(make_solver(robot, "lm"), line, start))
        np.testing.assert_allclose(joint_path.q[0], start, atol=1e-6)
        np.testing.assert_allclose(joint_path.q[-1], goal, atol=1e-6)
        assert max(oracles.off_by(robot.fk(joint_path.q[0]), line.start)) < 1e-12
        best = check_proved(follow(make_solver(robot, "lm"), line))
        assert best.end == line.end


def test_a_singular_start_whose_wrist_would_have_to_turn_first_is_refused() -> None:
    robot = load("paper6r")
    start = robot.fk(np.zeros(6))
    followed = follow(make_solver(robot, "lm"), Line(start, oracles.moved(start, [0.0, 0.05, 0.02])), np.zeros(6))
    assert followed.joint_path is None and followed.failure is not None
    assert (followed.failure.status, followed.failure.s) == (FollowStatus.SINGULAR, 0.0)


def goes_on(robot: Robot, line: Line, q: Array) -> str:
    """Whether own continuation follows a line: Newton in halved steps, four places in each on the path or solved near it."""
    s, h, x = 0.0, line.end / 200, q.copy()

    def onto(y: Array, at: float) -> bool:
        for _ in range(8):
            e = robot.pose_errors(y, line.pose(at))
            if np.abs(e).max() < 1e-11:
                return True
            y += np.linalg.pinv(robot.jacobian(y), rcond=1e-9) @ e
        return bool(np.abs(robot.pose_errors(y, line.pose(at))).max() < 1e-10)

    for _ in count():
        h = min(h, line.end - s, line.end / 400)
        y = x.copy()
        good = onto(y, s + h) and np.abs(y - x).max() < 0.05
        for u in (0.2, 0.4, 0.6, 0.8):
            if good:
                between = straight = x + u * (y - x)
                if np.abs(robot.pose_errors(straight, line.pose(s + u * h))).max() > 3e-6:
                    between = straight.copy()
                    good = onto(between, s + u * h) and bool(np.abs(between - straight).max() < 0.004)
        if good:
            s, x, h = s + h, y, 1.6 * h
            if (x < robot.limits.lower).any() or (x > robot.limits.upper).any():
                return "limit"
        else:
            h *= 0.5
        if s >= line.end:
            return "followed"
        if h < 1e-9 * line.end:
            return "lost"
    raise AssertionError


def beside(robot: Robot, rng: np.random.Generator, d: float) -> tuple[Line, Array] | None:
    """A line past a pose with a straight wrist, d away from it, and where the arm starts."""
    q = middle(robot, rng)
    q[4] = 0.0
    T, u, w = robot.fk(q), rng.normal(size=3), rng.normal(size=3)
    u /= np.linalg.norm(u)
    w = np.cross(u, w) / np.linalg.norm(np.cross(u, w))
    length = rng.uniform(0.05, 0.15)
    line = Line(oracles.moved(T, d * w - length * u), oracles.moved(T, d * w + length * u))
    result = make_solver(robot, "lm").solve(line.start, robot.limits.clip(q))
    if not result:
        return None
    x = result.q[None].copy()
    newton.polish_batch(robot.chain, x, line.start[None], 10)
    return (line, x[0]) if robot.limits.contains(x[0]) else None


def check_beside(name: str, distances: tuple[float, ...], how_many: int) -> int:
    robot, rng, seen = load(name), np.random.default_rng(3), 0
    for d in distances:
        for _ in range(how_many):
            drawn = beside(robot, rng, d)
            if drawn is None or goes_on(robot, *drawn) != "followed":
                continue
            check_proved(follow(make_solver(robot, "lm"), *drawn))
            seen += 1
    return seen


def test_lines_beside_a_straight_wrist_are_followed_if_own_continuation_does() -> None:
    assert check_beside("paper6r", (1e-1, 1e-4, 1e-6), 2) >= 3


@pytest.mark.soak
@pytest.mark.parametrize("name", ARMS)
def test_lines_from_a_tenth_of_a_metre_to_a_micrometre_beside_a_straight_wrist_are_followed(name: str) -> None:
    assert check_beside(name, (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6), 6) >= 6


# ---------------------------------------------------------------- the proof of nodes that are off the path
@pytest.mark.parametrize("off", [0.0, 1e-7, 1e-5, 1e-3])
def test_the_bound_counts_what_nodes_are_off_in_pose_and_twist(off: float) -> None:
    robot, rng = load("ur5e"), np.random.default_rng(1)
    q = np.deg2rad([15.0, -80.0, 95.0, -60.0, -70.0, 20.0])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), np.array([0.1, -0.05, 0.08]), np.array([0.2, 0.1, -0.3])))
    exact = follow(make_solver(robot, "lm"), line, q, samples=5).joint_path
    nodes = np.isin(exact.knots, exact.nodes)
    x = exact.q[nodes] + off * rng.normal(size=exact.q[nodes].shape)
    d = exact.derivatives[nodes] + 30.0 * off * rng.normal(size=exact.derivatives[nodes].shape)
    joint_path = JointPath(robot, line, exact.nodes, x, d, exact.ik, np.ones(len(x), np.bool_))
    out, plainly = deviation_bounds(robot, line, exact.nodes, x, d), np.empty((len(x) - 1, 2))
    fourth = np.tile(line.derivative_bounds()[:, 3], (len(x), 1))
    march.pieces_bound(
        robot.chain, exact.nodes, x, d, line.pose(exact.nodes), line.twist(exact.nodes),
        fourth, plainly,
    )  # fmt: skip
    for i in range(len(x) - 1):
        s = np.linspace(exact.nodes[i], exact.nodes[i + 1], 201)
        worst = np.array([oracles.off_by(robot.fk(joint_path(at)), line(at)) for at in s]).max(axis=0)
        assert (worst <= out[i] + 1e-14).all()
        assert (out[i] <= plainly[i]).all()
        assert (out[i] <= np.maximum(3.0 * worst + 2e-7, SMALL_DEVIATION)).all(), "and looked at closely it is near"


def test_derivatives_of_samples_that_are_stepped_over_are_those_of_the_joint_path() -> None:
    robot = optik.load("paper6r")
    q = np.deg2rad([20.0, -35.0, 40.0, 25.0, 0.0, -30.0])
    speed = np.array([0.2, 0.1, -0.1, 0.05, 0.5, 0.1])
    middle, twist = robot.fk(q), 0.1 * robot.jacobian(q) @ speed
    line = Line(oracles.moved(middle, -twist[:3], -twist[3:]), oracles.moved(middle, twist[:3], twist[3:]))
    start = optik.solve_ik(robot, line.start, q - 0.1 * speed, tolerance=optik.Tolerance(1e-12, 1e-12)).q
    joint_path = follow(make_solver(robot, "lm"), line, start).joint_path
    assert joint_path.knots.size > joint_path.nodes.size, "a sample at the singular pose is no node"
    slopes = joint_path(joint_path.knots, 1)
    np.testing.assert_allclose(joint_path.derivatives[:, 0], slopes, rtol=0.0, atol=1e-3 * np.abs(slopes).max())


@pytest.mark.parametrize("bend", [2e-2, 2e-3, 2e-4])
def test_steps_are_divided_on_the_shortest_path_too(bend: float) -> None:
    """Joint 4 turns by a radian beside a straight wrist, where the tool turns by no more than its bend."""
    robot = optik.load("paper6r")
    q = np.deg2rad([20.0, -35.0, 40.0, 0.0, 0.0, -30.0])
    q[3:] = -0.5, bend, 0.5
    goal = q.copy()
    goal[3], goal[5] = 0.5, -0.5
    followed = follow(make_solver(robot, "lm"), Line(robot.fk(q), robot.fk(goal)), q, samples=2)
    assert followed, followed.failure
    assert np.abs(followed.joint_path.q[-1] - goal).max() < 1e-6
