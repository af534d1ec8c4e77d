from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.optimize import brentq

from optik import Robot
from optik.arm.library import load
from optik.arm.limits import JointLimits
from optik.errors import InvalidInput
from optik.ik import IKSolver, Tolerance, make_solver
from optik.ik.base import Attempt, IKStatus
from optik.ik.dls import DLS
from optik.types import Array
from planners import Line, follow
from planners.following.failure import FollowStatus
from planners.following.follow import FollowResult
from planners.following.joint_path import JointPath
from tests import oracles
from tests.oracles import PAPER
from tests.planners import cases
from tests.planners.cases import MOVE, START, default_joint_path, default_line, paper6r, random_joint_paths, wide
from tests.robots import built

ROBOT = paper6r()
LIMITS = ROBOT.limits
REACH = 0.472 + np.hypot(0.055, 0.470)
"""From the crossing of the first axes to the crossing of the last three, with the elbow stretched."""
STRETCHED = -np.arctan2(0.470, 0.055)
"""The elbow angle where it is."""


def line_from_start(direction: Any, length: float = 1.2) -> Line:
    direction = np.asarray(direction, dtype=float)
    start = ROBOT.fk(START)
    return Line(start, oracles.moved(start, direction / np.linalg.norm(direction) * length))


def wrist(q: Array) -> Array:
    T = oracles.fk(PAPER, q)
    return np.asarray(T[:3, 3] - 0.261 * T[:3, 2])


def check_good(joint_path: JointPath, start: Array, goal: Array) -> None:
    """What every accepted sample, and all between them, must be, by plain forward kinematics."""
    path_end = joint_path.path.end
    lower, upper = joint_path.robot.limits.lower, joint_path.robot.limits.upper
    assert (joint_path.q >= lower - 1e-9).all()
    assert (joint_path.q <= upper + 1e-9).all()
    for s, q in zip(joint_path.knots, joint_path.q, strict=True):
        distance, angle = oracles.off_by(oracles.fk(PAPER, q), oracles.line_pose(start, goal, s / path_end))
        assert distance <= 1e-12
        assert angle <= 1e-12
    for s in 0.5 * (joint_path.knots[:-1] + joint_path.knots[1:]):
        distance, angle = oracles.off_by(oracles.fk(PAPER, joint_path(s)), oracles.line_pose(start, goal, s / path_end))
        assert max(distance, angle) <= 1e-5
    assert np.abs(np.diff(joint_path.q, axis=0)).max() <= 0.25


# ---------------------------------------------------------------- the paper's line
def test_the_default_line_starts_where_the_paper_does_and_ends_where_it_was_computed() -> None:
    joint_path = default_joint_path()
    np.testing.assert_allclose(joint_path.q[0], START, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(joint_path.q[-1]), cases.END_DEG, rtol=0.0, atol=5e-3)
    assert joint_path.knots.shape == (151,)
    np.testing.assert_allclose(joint_path.knots, np.arange(151) * np.hypot(0.12, 0.20) / 150, rtol=1e-13)
    assert joint_path.end == joint_path.path.end


def test_the_default_line_keeps_clear_of_singularities() -> None:
    joint_path = default_joint_path()
    mine = [np.linalg.svd(oracles.jacobian(PAPER, q), compute_uv=False)[-1] for q in joint_path.q[::10]]
    np.testing.assert_allclose(joint_path.singular_values[::10], mine, rtol=1e-8)
    assert joint_path.singular_values.min() > 0.22


def test_every_sample_is_polished_inside_the_limits_and_on_the_line() -> None:
    line = default_line()
    check_good(default_joint_path(), line.start, line.goal)


def test_no_joint_of_the_default_line_is_faster_than_the_notes_say() -> None:
    speed = np.hypot(0.12, 0.20) / 3.0
    assert np.abs(default_joint_path().derivatives[:, 0]).max() * speed < 0.22


@pytest.mark.parametrize("k", range(7))
def test_derivatives_at_the_samples_are_those_of_an_independently_solved_power_series(k: int) -> None:
    joint_path, most = (default_joint_path(), *random_joint_paths(6))[k], 1e-10 if k else 1e-11
    line = joint_path.path
    for i in (0, 1, 40, 75, 149, 150):
        exact = oracles.derivatives_along(PAPER, line.start, line.goal, joint_path.knots[i], line.end, joint_path.q[i])
        np.testing.assert_allclose(joint_path.q[i], exact[0], rtol=0.0, atol=1e-13)
        for order in (1, 2, 3):
            size = np.abs(exact[order]).max()
            np.testing.assert_allclose(joint_path.derivatives[i, order - 1], exact[order], rtol=0.0, atol=most * size)


def test_the_power_series_agree_with_differences_of_configurations_solved_one_by_one() -> None:
    line, h = default_line(), 2e-3
    s = 0.1
    guess = default_joint_path()(s)
    solved = {k: oracles.met(PAPER, line(s + k * h), guess) for k in range(-4, 5)}
    exact = oracles.derivatives_along(PAPER, line.start, line.goal, s, line.end, guess)
    first = sum(w * (solved[k] - solved[-k]) for k, w in ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))) / h
    second = (
        sum(w * (solved[k] + solved[-k]) for k, w in ((1, 8 / 5), (2, -1 / 5), (3, 8 / 315), (4, -1 / 560)))
        - 205 / 72 * solved[0]
    ) / h**2
    third = sum(w * (solved[k] - solved[-k]) for k, w in ((1, -61 / 30), (2, 169 / 120), (3, -3 / 10), (4, 7 / 240)))
    for order, (differences, tolerance) in enumerate(((first, 1e-11), (second, 1e-8), (third / h**3, 1e-5)), start=1):
        np.testing.assert_allclose(exact[order], differences, rtol=0.0, atol=tolerance * np.abs(exact[order]).max())


def test_between_samples_the_joint_path_and_its_derivatives_stay_with_the_line() -> None:
    joint_path, line = default_joint_path(), default_line()
    for i in (0, 37, 75, 149):
        s = 0.5 * (joint_path.knots[i] + joint_path.knots[i + 1])
        exact = oracles.derivatives_along(PAPER, line.start, line.goal, s, line.end, joint_path(s))
        for order, tolerance in enumerate((1e-13, 1e-11, 1e-8, 1e-5)):
            size = max(np.abs(exact[order]).max(), 1.0)
            np.testing.assert_allclose(joint_path(s, order), exact[order], rtol=0.0, atol=tolerance * size)


def test_the_joint_path_takes_its_values_and_two_derivatives_at_the_samples() -> None:
    joint_path = default_joint_path()
    np.testing.assert_allclose(joint_path(joint_path.knots), joint_path.q, rtol=0.0, atol=1e-14)
    for order in (1, 2):
        at_knots = joint_path(joint_path.knots, order)
        scale = np.abs(at_knots).max()
        np.testing.assert_allclose(at_knots, joint_path.derivatives[:, order - 1], rtol=0.0, atol=1e-9 * scale)


@pytest.mark.parametrize("samples", [15, 31, 151])
def test_the_deviation_is_the_worst_of_seven_points_between_any_two_samples(samples: int) -> None:
    joint_path, line = default_joint_path("dls", samples), default_line()
    worst = np.zeros(2)
    for a, b in zip(joint_path.knots[:-1], joint_path.knots[1:], strict=True):
        for u in np.arange(1, 8) / 8.0:
            s = a + u * (b - a)
            off = oracles.off_by(
                oracles.fk(PAPER, joint_path(s)), oracles.line_pose(line.start, line.goal, s / line.end)
            )
            worst = np.maximum(worst, off)
    np.testing.assert_allclose(joint_path.deviation, worst, rtol=1e-3, atol=3e-15)
    assert max(joint_path.deviation) <= {15: 3e-9, 31: 1e-10, 151: 1e-13}[samples]


# ---------------------------------------------------------------- methods, records, starts
@pytest.mark.parametrize("ik", ["dls", "ipopt"])
def test_the_joint_path_does_not_depend_on_the_ik_method(ik: str) -> None:
    one, other = default_joint_path("dls"), default_joint_path(ik)
    np.testing.assert_allclose(other.q, one.q, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(other.derivatives, one.derivatives, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("ik", ["dls", "ipopt"])
def test_the_record_is_what_the_method_did_before_the_polish(ik: str) -> None:
    line, solver = default_line(), make_solver(ROBOT, ik)
    record = follow(solver, line, START, samples=31).joint_path.ik
    q = START
    for i, s in enumerate(np.linspace(0.0, line.end, 31)):
        result = solver.solve(line(s), q)
        q = result.q
        assert record.iterations[i] == result.iterations
        off = oracles.off_by(oracles.fk(PAPER, q), line(s))
        assert record.position_error[i] == pytest.approx(off[0], rel=1e-6, abs=1e-14)
        assert record.rotation_error[i] == pytest.approx(off[1], rel=1e-6, abs=1e-14)
    assert record.iterations[1:].min() >= 1
    assert record.position_error.max() <= 1e-6
    if ik == "dls":
        assert record.position_error.max() > 1e-12, "errors after the polish would be at rounding"


OTHER_ARMS = {
    "sliding": (built(oracles.SLIDING, name="sliding"), oracles.SLIDING, [0.3, -0.8, 0.5, 0.4, 0.9, -0.2]),
    "ur5e": (load("ur5e"), oracles.UR5E, np.deg2rad([15.0, -80.0, 95.0, -60.0, -70.0, 20.0])),
}
"""A joint that slides, and a table of another convention."""


@pytest.mark.parametrize("name", OTHER_ARMS)
def test_other_arms_are_followed_with_exact_derivatives(name: str) -> None:
    robot, table, q = OTHER_ARMS[name]
    start = robot.fk(q)
    np.testing.assert_allclose(start, oracles.fk(table, np.array(q)), rtol=0.0, atol=1e-14)
    line = Line(start, oracles.moved(start, np.array([0.1, 0.08, -0.06]), np.array([0.2, -0.1, 0.3])))
    joint_path = follow(make_solver(robot, "dls"), line, np.array(q)).joint_path
    assert np.ptp(joint_path.q[:, 2]) > 0.02, "the sliding joint takes part"
    for i in (0, 60, 150):
        exact = oracles.derivatives_along(table, line.start, line.goal, joint_path.knots[i], line.end, joint_path.q[i])
        np.testing.assert_allclose(joint_path.q[i], exact[0], rtol=0.0, atol=1e-12)
        for order in (1, 2, 3):
            size = np.abs(exact[order]).max()
            np.testing.assert_allclose(joint_path.derivatives[i, order - 1], exact[order], rtol=0.0, atol=1e-10 * size)


def test_a_start_within_a_reading_of_the_path_is_put_on_it() -> None:
    line = default_line()
    off = START + 2e-5
    assert 1e-6 < oracles.off_by(oracles.fk(PAPER, off), line.start)[0] < 1e-4
    joint_path = follow(make_solver(ROBOT, "dls"), line, off).joint_path
    assert joint_path is not None
    check_good(joint_path, line.start, line.goal)


def test_a_pure_rotation_is_followed_in_radians() -> None:
    start = ROBOT.fk(START)
    line = Line(start, oracles.moved(start, np.zeros(3), np.array([0.1, 0.2, -0.15])))
    joint_path = follow(make_solver(ROBOT, "dls"), line, START).joint_path
    assert joint_path.end == pytest.approx(np.linalg.norm([0.1, 0.2, -0.15]))
    check_good(joint_path, line.start, line.goal)


# ---------------------------------------------------------------- failures: where, why, and the good part
def check_stopped(followed: FollowResult, status: FollowStatus, s: float, line: Line) -> None:
    """It stopped at the sample s, for that reason, and all before that sample is kept and good."""
    assert not followed
    assert followed.failure.status is status
    assert followed.failure.s == pytest.approx(s, abs=1e-12)
    assert followed.failure.reason
    assert followed.failure.advice
    step = line.end / 150
    assert followed.joint_path.end == pytest.approx(s - step, abs=1e-12), "the good part ends one sample before"
    assert len(followed.joint_path.ik.iterations) == len(followed.joint_path.q) == len(followed.joint_path.knots)
    assert len(followed.joint_path.derivatives) == len(followed.joint_path.q)
    check_good(followed.joint_path, line.start, line.goal)


def check_ended(followed: FollowResult, status: FollowStatus, s: float, line: Line, within: float = 2e-6) -> None:
    """The arm itself ended there, for that reason, and all up to that place is kept and good."""
    assert not followed
    assert followed.failure.status is status
    assert followed.failure.s == pytest.approx(s, abs=within * line.end)
    assert followed.failure.reason
    assert followed.failure.advice
    joint_path = followed.joint_path
    assert followed.failure.s - 1.1e-6 * line.end <= joint_path.end <= followed.failure.s
    np.testing.assert_allclose(joint_path.ik.s, np.linspace(0.0, line.end, 151)[: len(joint_path.ik.s)], atol=1e-15)
    assert joint_path.end - joint_path.ik.s[-1] < line.end / 150
    assert np.isin(joint_path.ik.s, joint_path.knots).all()
    assert max(joint_path.bound) <= 1e-5
    check_good(joint_path, line.start, line.goal)


@pytest.mark.parametrize("direction", [(-0.25, -0.23, 0.94), (-0.69, -0.23, 0.69), (0.17, 0.97, -0.18)])
def test_a_line_that_leaves_the_workspace_stops_where_the_arm_is_stretched(direction: Any) -> None:
    line = line_from_start(direction)
    w, v = wrist(START), line(0.0, 1)[:3]
    leaves = -w @ v + np.sqrt((w @ v) ** 2 + REACH**2 - w @ w)  # |w + s v| = reach; the orientation does not change
    robot = wide(ROBOT)
    followed = follow(make_solver(robot, "dls"), line, START)
    check_ended(followed, FollowStatus.UNREACHABLE, leaves, line)
    assert followed.failure.singular_value < 2e-3
    assert followed.failure.joint is None


@cache
def crossing(direction: tuple[float, float, float]) -> tuple[float, int]:
    """Where the first joint leaves its range, and which: by plain Newton on a grid, with no limits, and a root search."""
    line, before = line_from_start(direction), START
    for s in np.linspace(0.0, line.end, 101)[1:]:
        q = oracles.met(PAPER, line(s), before)
        out = np.flatnonzero((q < LIMITS.lower) | (q > LIMITS.upper))
        if out.size:
            break
        before = q
    roots = {}
    for j in out:
        limit = LIMITS.upper[j] if q[j] > LIMITS.upper[j] else LIMITS.lower[j]

        def margin(w: float, j: int = j, limit: float = limit) -> float:
            return float(oracles.met(PAPER, line(w), before)[j] - limit)

        roots[brentq(margin, s - line.end / 100, s, xtol=1e-7)] = int(j)
    return min(roots), roots[min(roots)]


THROUGH_LIMITS = [
    (0.62, -0.78, 0.13), (0.98, -0.2, 0.02), (-0.25, -0.93, 0.27), (-0.75, 0.47, 0.47), (-0.75, -0.6, -0.28),
    (-0.9, 0.32, -0.3), (-0.38, -0.92, 0.02),
]  # fmt: skip


@pytest.mark.parametrize("direction", THROUGH_LIMITS)
def test_a_line_through_a_joint_limit_stops_at_the_limit(direction: Any) -> None:
    line = line_from_start(direction)
    s, joint = crossing(direction)
    followed = follow(make_solver(ROBOT, "dls"), line, START)
    check_ended(followed, FollowStatus.OUTSIDE_LIMITS, s, line)
    assert followed.failure is not None and followed.joint_path is not None
    assert followed.failure.joint == ROBOT.joint_names[joint]
    at = followed.joint_path.q[-1, joint]
    assert min(abs(at - LIMITS.lower[joint]), abs(at - LIMITS.upper[joint])) < 1e-6


class Free(IKSolver):
    """Solves the pose and looks at no limit."""

    name: ClassVar[str] = "free"

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        return Attempt(oracles.met(PAPER, target, start), IKStatus.SOLVED, 1)


@pytest.mark.parametrize("solver", [Free(ROBOT), DLS(ROBOT, tolerance=Tolerance(3e-3, 1e-2))], ids=["free", "loose"])
def test_a_method_that_minds_no_limit_or_a_loose_one_carries_no_joint_past_its_limit(solver: IKSolver) -> None:
    line = line_from_start(THROUGH_LIMITS[0])
    s, joint = crossing(THROUGH_LIMITS[0])
    followed = follow(solver, line, START)
    check_ended(followed, FollowStatus.OUTSIDE_LIMITS, s, line)
    assert followed.failure.joint == ROBOT.joint_names[joint]


HALF = 75.5 / 150
"""Between the samples 75 and 76."""


class Lying(DLS):
    """Claims success without moving, from half-way on."""

    name: ClassVar[str] = "lying"
    line: ClassVar[Line] = default_line()

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        if self.line.nearest(target[None])[0] > HALF * self.line.end:
            return Attempt(start, IKStatus.SOLVED, 0)
        return super().attempt(target, start, trace, time_limit)


def test_a_method_that_claims_what_is_not_so_is_stopped() -> None:
    line = default_line()
    followed = follow(Lying(ROBOT), line, START)
    check_stopped(followed, FollowStatus.NO_IK, 76 / 150 * line.end, line)
    assert "rejected" in followed.failure.reason


def test_too_few_iterations_stop_at_the_first_sample_that_needs_them() -> None:
    followed = follow(DLS(ROBOT, max_iterations=0), default_line(), START)
    assert followed.joint_path is None
    assert followed.failure.status is FollowStatus.NO_IK
    assert followed.failure.s == pytest.approx(default_line().end / 150)


def test_a_start_that_no_iteration_puts_on_the_path_stops_at_zero() -> None:
    followed = follow(DLS(ROBOT, max_iterations=0), default_line(), START + 2e-5)
    assert followed.joint_path is None
    assert (followed.failure.status, followed.failure.s) == (FollowStatus.NO_IK, 0.0)


def test_a_start_that_is_met_only_outside_the_limits_is_said_to_be_so() -> None:
    limits = JointLimits(ROBOT.limits.lower, np.where(np.arange(6) == 0, -0.5, ROBOT.limits.upper))
    robot = replace(ROBOT, limits=limits)  # its first joint cannot turn to where the line is
    followed = follow(make_solver(robot, "dls"), default_line())
    assert followed.joint_path is None
    assert followed.failure.status is FollowStatus.OUTSIDE_LIMITS
    far = default_line().start.copy()
    far[:3, 3] *= 10.0
    followed = follow(make_solver(robot, "dls"), Line(far, oracles.moved(far, MOVE)))
    assert followed.failure.status is FollowStatus.UNREACHABLE


# ---------------------------------------------------------------- singular
@pytest.mark.parametrize("ik", ["dls", "lm", "closed_form"])
def test_a_line_through_a_singular_pose_is_followed_where_the_joints_move_smoothly(ik: str) -> None:
    q = np.deg2rad([20.0, -35.0, 40.0, 25.0, 0.0, -30.0])  # axes 4 and 6 in line
    speed = np.array([0.2, 0.1, -0.1, 0.05, 0.5, 0.1])
    middle, twist = oracles.fk(PAPER, q), 0.1 * oracles.jacobian(PAPER, q) @ speed
    line = Line(oracles.moved(middle, -twist[:3], -twist[3:]), oracles.moved(middle, twist[:3], twist[3:]))
    start = oracles.met(PAPER, line.start, q - 0.1 * speed)
    joint_path = follow(make_solver(ROBOT, ik), line, start).joint_path
    assert joint_path is not None and joint_path.end == line.end
    assert max(joint_path.deviation) <= max(joint_path.bound) <= 1e-5
    assert joint_path.q[0, 4] * joint_path.q[-1, 4] < 0.0
    assert np.abs(joint_path(0.5 * line.end) - q).max() < 1e-3
    assert np.abs(joint_path(np.linspace(0.0, line.end, 300), 1)).max() < 3.0 * 0.1 * 0.5 / (0.5 * line.end)


def test_a_jump_is_still_caught_beside_a_straight_wrist() -> None:
    """Just before the wrist is straight its two configurations are near each other in all but joints 4 and 6."""
    robot = wide(ROBOT)
    q = np.deg2rad([20.0, -35.0, 40.0, 0.0, 4.0, 0.0])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), [0.0, 0.0, -0.02]))
    solver = flip(robot, line, turned_wrist)
    assert follow(make_solver(robot, "dls"), line, q)
    followed = follow(solver, line, q)
    check_stopped(followed, FollowStatus.BRANCH_JUMP, 76 / 150 * line.end, line)


# ---------------------------------------------------------------- branch jumps
class Flip(DLS):
    """Goes over to another configuration of the same pose half-way: wrist, a full turn, or the elbow."""

    name: ClassVar[str] = "flip"
    line: Line
    other: Callable[[Array, Array], Array]

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        found = super().attempt(target, start, trace, time_limit)
        if self.line.nearest(target[None])[0] <= HALF * self.line.end or self.flipped:
            return found
        self.flipped = True
        return found._replace(q=self.other(target, found.q))

    flipped = False


def flip(robot: Robot, line: Line, other: Callable[[Array, Array], Array]) -> Flip:
    solver = Flip(robot)
    solver.line, solver.other = line, other
    return solver


def turned_wrist(target: Array, q: Array) -> Array:
    return q + np.array([0.0, 0.0, 0.0, np.pi, -2.0 * q[4], np.pi])


def full_turn(target: Array, q: Array) -> Array:
    return q + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * np.pi])


def other_elbow(target: Array, q: Array) -> Array:
    bend = q[2] - STRETCHED
    return oracles.met(PAPER, target, q + np.array([0.0, bend, -2.0 * bend, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize(("other", "joint"), [(turned_wrist, "joint4"), (full_turn, "joint6")])
def test_a_jump_to_another_branch_is_caught(other: Any, joint: str) -> None:
    line, robot = default_line(), wide(ROBOT)
    middle = default_joint_path()(0.6 * line.end)
    assert max(oracles.off_by(oracles.fk(PAPER, other(None, middle)), oracles.fk(PAPER, middle))) < 1e-14, (
        "the other branch is valid"
    )
    assert follow(make_solver(robot, "dls"), line, START), "without the jump the line is followed"
    followed = follow(flip(robot, line, other), line, START)
    check_stopped(followed, FollowStatus.BRANCH_JUMP, 76 / 150 * line.end, line)
    assert followed.failure.joint == joint


@pytest.mark.parametrize(("length", "bend"), [(0.04, 0.06), (0.001, 0.06), (0.001, 0.02)])
def test_a_small_jump_is_caught(length: float, bend: float) -> None:
    q = np.array([0.3, -0.4, STRETCHED + bend, 0.4, 0.8, 0.2])
    start, w = ROBOT.fk(q), wrist(q)
    aside = np.cross(w, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(w, [0.0, 0.0, 1.0]))
    angle = 2.0 * np.arcsin(
        0.5 * length / np.linalg.norm(w)
    )  # a chord: the elbow is as bent at its end as at its start
    line = Line(start, oracles.moved(start, (np.cos(angle) - 1.0) * w + np.sin(angle) * np.linalg.norm(w) * aside))
    assert line.end == pytest.approx(length)
    assert follow(make_solver(ROBOT, "dls"), line, q)
    followed = follow(flip(ROBOT, line, other_elbow), line, q)
    assert followed.failure is not None
    check_stopped(followed, FollowStatus.BRANCH_JUMP, 76 / 150 * line.end, line)
    jump = np.abs(other_elbow(line(0.5 * line.end), followed.joint_path.q[-1]) - followed.joint_path.q[-1]).max()
    assert bend < jump < 4.0 * bend, "small enough for a step of the joints"


@pytest.mark.parametrize("samples", [2, 3, 7])
def test_too_few_samples_are_filled_up_until_the_bound_holds(samples: int) -> None:
    line = default_line()
    joint_path = follow(make_solver(ROBOT, "dls"), line, START, samples=samples).joint_path
    assert len(joint_path.ik.iterations) == len(joint_path.ik.s) == samples < len(joint_path.knots) < 40
    assert max(joint_path.deviation) <= max(joint_path.bound) <= 1e-5
    tight = follow(make_solver(ROBOT, "dls"), line, START, samples=samples, tolerance=Tolerance(1e-9, 1e-9)).joint_path
    assert len(tight.knots) > len(joint_path.knots)
    assert max(tight.deviation) <= max(tight.bound) <= 1e-9
    check_good(joint_path, line.start, line.goal)


# ---------------------------------------------------------------- misuse
@pytest.mark.parametrize(
    ("argument", "change"),
    [
        (
            "q_start: .*3 mm",
            {"path": Line(oracles.moved(default_line().start, [0.0, 0.003, 0.0]), default_line().goal)},
        ),
        (
            r"q_start: .*\] rad; got joint5 = 2.87266 rad",
            {"q_start": START + np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0])},
        ),  # outside its limits
        ("q_start", {"q_start": START * np.nan}),
        ("q_start", {"q_start": START[:5]}),
        ("samples", {"samples": 1}),
        ("samples", {"samples": 0}),
        ("samples", {"samples": -5}),
        ("samples", {"samples": 10.0}),
        ("samples", {"samples": True}),
        ("branch", {"branch": "other"}),
        ("q_start", {"q_start": None, "branch": "start"}),
        ("tolerance", {"tolerance": 1e-5}),
        (r"solver: expected an IKSolver, such as optik.ik.get_solver\(robot\)", {"solver": default_line()}),
        ("solver", {"solver": "lm"}),
        ("solver", {"solver": DLS}),
        ("path", {"path": "line"}),
        ("path", {"path": np.eye(4)}),
    ],
)
def test_misuse_is_an_error_that_names_the_argument(argument: str, change: dict[str, Any]) -> None:
    given = {"solver": make_solver(ROBOT, "dls"), "path": default_line(), "q_start": START, "samples": 151} | change
    with pytest.raises(InvalidInput, match=rf"^{argument}"):
        follow(given.pop("solver"), given.pop("path"), given.pop("q_start"), **given)
