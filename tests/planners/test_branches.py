from functools import cache
from itertools import product
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import comb

from optik import Robot
from optik.arm.library import load
from optik.arm.limits import JointLimits
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.ik.closed_form import ClosedForm
from optik.types import Array
from planners import Line, follow
from planners.following.branches import find_branches
from planners.following.failure import FollowStatus
from planners.following.joint_path import LEAST_SPACING, JointPath, thin_knots
from planners.following.march import find_exit, piece_bound
from planners.following.smoothing import BARRIER_WEIGHT
from tests import oracles
from tests.oracles import PAPER
from tests.planners.cases import START, default_line, paper6r, wide
from tests.robots import marked
from tests.seeds import shift_seed

ROBOTS = ("paper6r", "ur5e", "puma560", "gen3lite", "panda", "iiwa14")


def drawn_line(robot: Robot, rng: np.random.Generator, length: float = 0.15) -> tuple[Line, Array]:
    """A line from a configuration in the middle of the limits, which it may or may not be possible to follow."""
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    q = 0.5 * (lower + upper) + 0.35 * (upper - lower) * rng.uniform(-1.0, 1.0, robot.n)
    start = robot.fk(q)
    move = rng.normal(size=3)
    return Line(start, oracles.moved(start, length * move / np.linalg.norm(move), 0.2 * rng.normal(size=3))), q


@cache
def followed_lines(name: str, count: int = 3, branch: str = "start") -> tuple[JointPath, ...]:
    robot, rng = load(name), np.random.default_rng(11)
    solver, kept = make_solver(robot, "lm"), []
    while len(kept) < count:
        line, q = drawn_line(robot, rng)
        joint_path = follow(solver, line, q, branch=branch).joint_path
        if joint_path is not None and joint_path.end == line.end and joint_path.singular_values.min() > 0.02:
            kept.append(joint_path)
    return tuple(kept)


def off(joint_path: JointPath, s: Array) -> tuple[float, float]:
    """Worst distance and angle to the path, pose by pose, by SciPy's rotations."""
    poses = zip(joint_path.robot.fk(joint_path(s)), joint_path.path.pose(s), strict=True)
    worst = np.array([oracles.off_by(T, wanted) for T, wanted in poses]).max(axis=0)
    return float(worst[0]), float(worst[1])


# ---------------------------------------------------------------- the bound between nodes
@pytest.mark.parametrize("name", [*ROBOTS, "irb910sc", marked("wx200", "wx200")])
def test_the_bound_is_never_below_the_deviation_and_few_nodes_are_enough(name: str) -> None:
    robot = load(name)
    solver = make_solver(robot, "lm")
    if robot.n < 6:
        paths = [line_of_few(name)]
    else:
        paths = [(p.path, p.q[0]) for p in followed_lines(name, 2)]
    for path, q in paths:
        joint_path = follow(solver, path, q, samples=4).joint_path
        s = np.linspace(0.0, joint_path.end, 40 * len(joint_path.nodes) + 1)
        distance, angle = off(joint_path, s)
        assert distance <= joint_path.bound[0] + 1e-14
        assert angle <= joint_path.bound[1] + 2e-14
        assert max(joint_path.bound) <= 1e-5
        assert len(joint_path.nodes) <= 60


def test_equal_samples_on_a_short_path_are_knots_but_not_all_nodes() -> None:
    start = paper6r().fk(START)
    line = Line(start, oracles.moved(start, np.array([0.001, 0.0, 0.0])))
    joint_path = follow(make_solver(paper6r(), "lm"), line, START).joint_path
    assert len(joint_path.knots) == 151
    assert np.diff(joint_path.nodes).min() >= LEAST_SPACING - 1e-12
    for i in (0, 1, 77, 150):
        exact = oracles.derivatives_along(PAPER, line.start, line.goal, joint_path.knots[i], line.end, joint_path.q[i])
        for order in (1, 2, 3):
            np.testing.assert_allclose(joint_path.derivatives[i, order - 1], exact[order], rtol=1e-9, atol=1e-8)


class Broken(Line):
    """A line with a place that must be a node."""

    breaks = np.array([0.0, 0.1234567, default_line().end])


def test_the_breaks_of_a_path_are_nodes() -> None:
    path = Broken(default_line().start, default_line().goal)
    joint_path = follow(make_solver(paper6r(), "lm"), path, START).joint_path
    assert 0.1234567 in joint_path.nodes
    assert len(joint_path.knots) == 152
    assert len(joint_path.ik.iterations) == 151


def test_a_break_next_to_a_sample_is_the_node_of_the_two() -> None:
    grid = np.linspace(0.0, 0.1, 101)
    knots = np.union1d(grid, [0.05001])
    chosen = knots[thin_knots(knots, [0.05001])]
    assert 0.05001 in chosen
    assert grid[50] not in chosen
    assert len(chosen) == 101
    assert np.diff(chosen).min() >= LEAST_SPACING


def test_the_bound_of_a_slider_is_the_fourth_derivative_of_its_motion() -> None:
    fixed, tool = np.eye(4)[None], np.eye(4)
    tool[2, 3] = 5.0
    h, points = 0.5, np.array([[0.0, 0.0, 0.0, 0.0, 0.3, 0.4]])
    # of Σ bₖ Bₖ(u) the fourth derivative is linear between 5! times the fourth differences
    ends = 120.0 * np.abs([points[0, :5] @ [1, -4, 6, -4, 1], points[0, 1:] @ [1, -4, 6, -4, 1]]) / h**4
    distance, angle = piece_bound((fixed, np.array([True]), tool), h, points, np.zeros(2))
    assert distance == pytest.approx(h**4 / 384.0 * ends.max(), rel=1e-12)
    assert angle == 0.0


def test_the_bound_of_a_slider_that_turns_counts_both() -> None:
    # r(s) e^{iωs} with r = r0 + v s: the fourth derivative is at most r ω⁴ + 4 v ω³
    fixed, tool, h, r0, v, w = np.tile(np.eye(4), (2, 1, 1)), np.eye(4), 0.5, 0.3, 0.2, 1.5
    fixed[1, :3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]  # slides along the turning x
    u = np.linspace(0.0, h, 6)  # the control points of what is linear are equally spaced
    distance, angle = piece_bound((fixed, np.array([False, True]), tool), h, np.array([w * u, r0 + v * u]), np.zeros(2))
    assert distance == pytest.approx(h**4 / 384.0 * ((r0 + v * h) * w**4 + 4.0 * v * w**3), rel=1e-12)
    assert angle == pytest.approx(h**4 / 384.0 * w**4, rel=1e-4)


@pytest.mark.parametrize("place", [[0.4, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.4], [-0.2, 0.1, 0.3]])
def test_the_bound_counts_each_component_of_a_link(place: list[float]) -> None:
    # the second joint, at a distance r from the turning first one, and its axis through the tool: at most r ω⁴
    fixed, h, w = np.tile(np.eye(4), (2, 1, 1)), 0.5, 1.5
    fixed[1, :3, 3] = place
    points = np.array([w * np.linspace(0.0, h, 6), np.zeros(6)])
    distance, _ = piece_bound((fixed, np.array([False, False]), np.eye(4)), h, points, np.zeros(2))
    assert distance == pytest.approx(h**4 / 384.0 * np.linalg.norm(place) * w**4, rel=1e-12)


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.floats(0.05, 1.0))
def test_the_first_exit_of_a_quintic_is_that_of_a_fine_grid(points: list[float], high: float) -> None:
    b = np.array(points)
    u = np.linspace(0.0, 1.0, 4001)
    value = sum(comb(5, k) * b[k] * u**k * (1.0 - u) ** (5 - k) for k in range(6))
    found = find_exit(b, -high, high)
    outside = np.flatnonzero(np.abs(value) > high)
    if outside.size:
        assert found <= u[outside[0]]
        assert found >= u[max(outside[0] - 1, 0)] - 1e-9
    elif np.abs(value).max() < high - 1e-6:
        assert found == 2.0


# ---------------------------------------------------------------- branches and windings
@pytest.mark.parametrize("name", ["paper6r", "ur5e", "puma560"])
def test_every_branch_of_the_start_is_tracked_and_the_best_is_the_cheapest_that_goes_all_the_way(name: str) -> None:
    robot, path = load(name), followed_lines(name)[0].path
    found = find_branches(robot, path)
    other = ClosedForm(robot, backend="enumeration").branches(path.pose(0.0))
    turns = np.exp(1j * other.q)
    distinct = [q for i, q in enumerate(turns) if all(np.abs(q - p).max() > 1e-3 for p in turns[:i])]
    assert len(found) == len(distinct)
    for branch in found:
        assert max(oracles.off_by(robot.fk(branch.q), path.pose(0.0))) < 1e-8
    whole = [branch for branch in found if branch.ended is None]
    assert whole == sorted(whole, key=lambda branch: branch.cost)
    assert found[: len(whole)] == whole
    solver = make_solver(robot, "lm")
    for branch in found:  # one by one, as a user would
        alone = follow(solver, path, branch.q)
        assert bool(alone) is (branch.ended is None)
        if alone.failure is not None:
            assert alone.failure.s == pytest.approx(branch.s, abs=1e-4 * path.end)
    best = follow(solver, path)
    assert best and best.joint_path is not None
    np.testing.assert_allclose(best.joint_path.q[0], whole[0].q, atol=1e-8)


def spinning(turn: float) -> tuple[Robot, Line, Array]:
    """An arm whose last joint has a turn and a half of room, and a line that turns it far."""
    robot = paper6r()
    room = np.where(np.arange(6) == 5, 1.5 * np.pi, np.pi)
    robot = Robot("roomy", robot.fixed, robot.prismatic, robot.tool, JointLimits(-room, room))
    start = robot.fk(START)
    return robot, Line(start, oracles.moved(start, np.zeros(3), turn * start[:3, 2])), START


@pytest.mark.parametrize("turn", [2.5, -2.5])
def test_the_winding_is_one_that_lets_the_whole_path_fit(turn: float) -> None:
    robot, line, q = spinning(turn)
    q = q + np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.sign(turn) * np.deg2rad(210.0)])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), np.zeros(3), turn * robot.fk(q)[:3, 2]))
    kept = follow(make_solver(robot, "lm"), line, q)
    assert (kept.failure.status, kept.failure.joint) == (FollowStatus.OUTSIDE_LIMITS, "joint6")
    assert "best" in kept.failure.advice
    best = follow(make_solver(robot, "lm"), line, q, branch="best").joint_path
    assert best is not None and best.end == line.end
    # by brute force: of all whole turns of all joints exactly those fit whose every instant is inside
    dense = best(np.linspace(0.0, line.end, 2001))
    lower, upper = robot.limits.lower, robot.limits.upper
    fits = [
        k
        for k in product((-1, 0, 1), repeat=6)
        if (dense + 2 * np.pi * np.array(k) >= lower - 1e-9).all()
        and (dense + 2 * np.pi * np.array(k) <= upper + 1e-9).all()
    ]
    assert (0,) * 6 in fits
    free = wide(robot)
    for branch in find_branches(robot, line, q):
        way = follow(make_solver(free, "lm"), line, branch.q).joint_path
        assert way is not None and way.end == line.end
        q6 = way(np.linspace(0.0, line.end, 2001))[:, 5] + 2 * np.pi * np.arange(-2, 3)[:, None]
        fits6 = ((q6 >= lower[5]) & (q6 <= upper[5])).all(axis=1)
        others = (way.q[:, :5] >= lower[:5]).all() and (way.q[:, :5] <= upper[:5]).all()
        assert (branch.ended is None) is bool(fits6.any() and others)
        if branch.ended is None:
            assert fits6[2], "it is given with a winding that fits"
    starts = [best.q[0] + 2 * np.pi * np.array(k) for k in fits]
    assert np.linalg.norm(best.q[0] - q) <= min(np.linalg.norm(x - q) for x in starts) + 1e-9


def test_a_start_anywhere_asks_for_the_nearest_branch() -> None:
    robot, path = load("ur5e"), followed_lines("ur5e")[0].path
    whole = [branch for branch in find_branches(robot, path) if branch.ended is None]
    assert len(whole) > 2
    near = whole[-1].q + 0.05
    found = follow(make_solver(robot, "lm"), path, near, branch="best").joint_path
    assert np.linalg.norm(found.q[0] - near) <= min(np.linalg.norm(branch.q - near) for branch in whole) + 1e-6


def test_advice_of_another_branch_is_true() -> None:
    robot, rng, seen, count = load("ur5e"), np.random.default_rng(shift_seed(2)), 0, 0
    solver = make_solver(robot, "lm")
    while count < 25 or (seen < 1 and count < 150):
        count += 1
        line, q = drawn_line(robot, rng, 0.3)
        failure = follow(solver, line, q).failure
        if failure is None:
            continue
        best = follow(solver, line)
        assert bool(best) is (
            "reaches the end of the path" in failure.advice and "no branch that was found" not in failure.advice
        )
        assert f"a path that ends before s = {failure.s:.6g} m" in failure.advice and "; a path" not in failure.advice
        assert (best.status == "solved") is bool(best)
        seen += bool(best)
        if failure.status is FollowStatus.UNREACHABLE:
            beyond = solver.solve(line.pose(min(failure.s + 1e-3 * line.end, line.end)), robot.limits.clip(q))
            assert not beyond
    assert seen >= 1


def test_no_branch_at_the_start_is_said_so() -> None:
    robot = load("ur5e")
    far = np.eye(4)
    far[0, 3] = 3.0
    failure = follow(make_solver(robot, "lm"), Line(far, oracles.moved(far, np.array([0.1, 0.0, 0.0])))).failure
    assert (failure.status, failure.s) == (FollowStatus.UNREACHABLE, 0.0)


# ---------------------------------------------------------------- fewer joints than six
def line_of_few(name: str) -> tuple[Line, Array]:
    robot = load(name)
    if name == "wx200":  # in the vertical plane of its arm
        q = np.array([0.3, 0.2, 0.1, -0.3, 0.4])
        move, turn = np.array([0.05 * np.cos(0.3), 0.05 * np.sin(0.3), 0.04]), np.zeros(3)
    else:  # SCARA: anywhere, turning about the vertical
        q = np.array([0.3, 0.8, 0.08, 0.2])
        move, turn = np.array([0.05, -0.1, -0.03]), np.array([0.0, 0.0, 0.5])
    return Line(robot.fk(q), oracles.moved(robot.fk(q), move, turn)), q


@pytest.mark.parametrize("name", ["wx200", "irb910sc"])
@pytest.mark.parametrize("branch", ["start", "best"])
def test_what_few_joints_can_follow_is_followed(name: str, branch: str) -> None:
    line, q = line_of_few(name)
    joint_path = follow(make_solver(load(name), "lm"), line, q, branch=branch).joint_path
    assert joint_path is not None and joint_path.end == line.end
    assert max(off(joint_path, np.linspace(0.0, line.end, 301))) < 1e-12
    h = 1e-4 * line.end
    at = joint_path.knots[1:-1]
    for order in (1, 2):
        slope = (joint_path(at + h, order) - joint_path(at - h, order)) / (2.0 * h)
        scale = max(np.abs(joint_path.derivatives[:, order]).max(), 1.0)
        np.testing.assert_allclose(slope, joint_path.derivatives[1:-1, order], atol=1e-3 * scale)


@pytest.mark.parametrize(("name", "turn"), [("wx200", [0.0, 0.0, 0.4]), ("irb910sc", [0.2, 0.0, 0.0])])
@pytest.mark.parametrize("branch", ["start", "best"])
def test_what_few_joints_cannot_follow_is_said_with_the_reason(name: str, turn: list[float], branch: str) -> None:
    robot, (line, q) = load(name), line_of_few(name)
    goal = oracles.moved(line.start, np.array([0.02, 0.01, -0.02]), np.array(turn))
    followed = follow(make_solver(robot, "lm"), Line(line.start, goal), q, branch=branch)
    assert followed.joint_path is None and followed.failure is not None
    assert (followed.failure.status, followed.failure.s) == (FollowStatus.UNREACHABLE, 0.0)
    assert f"{robot.n} joints" in followed.failure.reason


def test_a_sliding_joint_at_its_end_is_said_in_metres() -> None:
    robot, (line, q) = load("irb910sc"), line_of_few("irb910sc")
    up = Line(line.start, oracles.moved(line.start, np.array([0.0, 0.0, 0.15])))
    followed = follow(make_solver(robot, "lm"), up, q)
    assert followed.failure is not None and followed.joint_path is not None
    assert (followed.failure.status, followed.failure.joint) == (FollowStatus.OUTSIDE_LIMITS, "joint3")
    assert followed.failure.s == pytest.approx(0.08, abs=1e-9)
    assert followed.joint_path.end == pytest.approx(0.08, abs=1e-9)
    assert "0.18] m " in followed.failure.reason


# ---------------------------------------------------------------- more joints than six
@pytest.mark.parametrize("name", ["panda", "iiwa14"])
@pytest.mark.parametrize("branch", ["start", "best"])
def test_a_redundant_arm_follows_with_exact_derivatives_inside_its_limits(name: str, branch: str) -> None:
    for joint_path in followed_lines(name, 2, branch):
        robot, end = joint_path.robot, joint_path.end
        assert max(off(joint_path, np.linspace(0.0, end, 301))) < 1e-9
        assert robot.limits.contains(joint_path(np.linspace(0.0, end, 2001))).all()
        # the three derivatives are those of one curve: differences of a finer solve of the same choice, knot by knot
        x, d = joint_path.nodes, joint_path.derivatives
        h = x[1] - x[0]
        for order in (0, 1):
            slope = (d[:-4, order] - 8 * d[1:-3, order] + 8 * d[3:-1, order] - d[4:, order]) / (12.0 * h)
            scale = np.abs(d[:, order + 1]).max()
            np.testing.assert_allclose(slope, d[2:-2, order + 1], atol=2e-3 * scale)


def test_a_redundant_arm_starts_where_it_is_told_or_where_it_is_best() -> None:
    (joint_path,) = followed_lines("panda", 1)
    robot, line = joint_path.robot, joint_path.path
    again = follow(make_solver(robot, "lm"), line, joint_path.q[0])
    np.testing.assert_allclose(again.joint_path.q[0], joint_path.q[0], atol=1e-9)
    best = follow(make_solver(robot, "lm"), line).joint_path
    assert np.abs(best.q[0] - joint_path.q[0]).max() > 0.05

    def cost(p: JointPath) -> float:
        middle, half = 0.5 * (robot.limits.lower + robot.limits.upper), 0.5 * (robot.limits.upper - robot.limits.lower)
        q = p(np.linspace(0.0, p.end, 400))
        room = -np.log(1.0 - ((q - middle) / half) ** 2).sum(axis=1).mean()
        return float(0.5 * np.linalg.norm(np.diff(q, axis=0), axis=1).sum() ** 2 + BARRIER_WEIGHT * room)

    assert cost(best) < cost(joint_path)


def test_a_redundant_arm_stops_where_its_reach_ends() -> None:
    robot = load("panda")
    q = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.5])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), np.array([0.9, 0.0, 0.0])))
    followed = follow(make_solver(robot, "lm"), line, q)
    assert followed.failure is not None and followed.joint_path is not None
    assert followed.failure.status in (FollowStatus.UNREACHABLE, FollowStatus.OUTSIDE_LIMITS)
    assert 0.0 < followed.joint_path.end <= followed.failure.s < line.end
    assert max(followed.joint_path.bound) <= 1e-5


# ---------------------------------------------------------------- paths given in the joints
class Given(Line):
    """The way of the tool of joints that move evenly, straight or not: for the joints alone."""

    speed: ClassVar[Array] = np.array([0.5, -0.3, 0.4, 0.2, 1.0, -0.1])
    begin: ClassVar[Array] = np.array([0.1, -0.4, 0.3, 0.2, -0.5, 0.3])

    def __init__(self, length: float) -> None:
        super().__init__(np.eye(4), oracles.moved(np.eye(4), np.array([length, 0.0, 0.0])))

    def configurations(self, robot: Robot, s: Any, order: int = 0) -> Array | None:
        s = np.asarray(s)[:, None]
        return np.asarray(
            (self.begin + s * self.speed, np.ones_like(s) * self.speed, 0.0 * s * self.speed)[min(order, 2)]
        )

    def pose(self, s: Any) -> Array:
        return paper6r().fk(self.begin + np.asarray(s)[..., None] * self.speed)


def test_a_path_in_the_joints_is_taken_as_it_is_through_singularities_too() -> None:
    path = Given(1.0)
    joint_path = follow(make_solver(paper6r(), "lm"), path, Given.begin).joint_path
    assert joint_path is not None and joint_path.end == 1.0
    s = np.linspace(0.0, 1.0, 77)
    np.testing.assert_allclose(joint_path(s), Given.begin + s[:, None] * Given.speed, atol=1e-14)
    np.testing.assert_allclose(joint_path(s, 1), np.tile(Given.speed, (77, 1)), atol=1e-12)
    assert joint_path.singular_values[75] < 1e-12, "the wrist is straight half-way"
    assert not joint_path.ik.iterations.any()


def test_a_path_in_the_joints_ends_at_a_limit_and_starts_where_it_does() -> None:
    followed = follow(make_solver(paper6r(), "lm"), Given(3.0))
    limit = (paper6r().limits.upper[4] - Given.begin[4]) / Given.speed[4]
    assert followed.failure is not None and followed.joint_path is not None
    assert (followed.failure.status, followed.failure.joint) == (FollowStatus.OUTSIDE_LIMITS, "joint5")
    assert followed.failure.s == pytest.approx(limit, abs=1e-8)
    assert limit - 3.0 / 150 <= followed.joint_path.end <= limit
    with pytest.raises(InvalidInput, match="joint2"):
        follow(make_solver(paper6r(), "lm"), Given(1.0), Given.begin + np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0]))
