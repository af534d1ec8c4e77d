"""Choice of a path's free coefficients: gradient, initial guesses, and the fastest motion that is proved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array, Flags
from planners.choice.programme import FreeProgramme, Statics, ToolCoordinates, is_known
from planners.choice.rows import ViaLimits, pass_through
from planners.choice.solve import LEAST_P_DAMPING, FreeSolution, solve_coefficients
from planners.following.joint_path import JointPath
from planners.following.resolve.freedoms import FreeWay
from planners.paths.control_curve import Basis, ControlBounds
from planners.paths.coordinates import NullSpace
from planners.paths.free_path import FreePath
from planners.paths.point_to_point import PointToPoint
from planners.planning.result import FreedomResult, Plan
from planners.timing.interior_point.newton import Iterate
from planners.timing.optimal import Optimum

WORTHLESS = 1e-4
"""Least relative decrease of the duration per radian or metre of its coordinates, predicted by the gradient, for which a
freedom is used."""
LEAST_GAIN = 1e-4
"""Least fraction by which a chosen path must shorten the motion to be used."""
NEARLY, TRAVEL_SAMPLES = 1.002, 1001
"""Ratio to the shortest duration below which motions count as equally fast; among them the one with the least joint travel is
taken. Number of samples of a motion."""
SAME_GUESS, SLOW_GUESS = 0.02, 1.2
"""Guesses whose joints stay nearer than this [rad, m] are one; ratio to the least time of a guess up to which one is tried."""
REPORT_POINTS = 101
"""Points along the path at which a result shows the coordinates."""
SHAPE_DAMPING = 1e-2
"""Curvature that is added in each control point of a joint path [1/rad²]: motion along the path changes only its parameter."""
POINTS_PER_COEFFICIENT = 3
"""Grid points for each coefficient of the default number: with fewer the path bends between them, where nothing limits it."""
MORE_COEFFICIENTS = (1.5, 2.5, 5.0)
"""Numbers of coefficients, over the default one, that are tried where nothing is found around obstacles."""
CHOSEN = "chosen"
"""Outcome of a plan along another path than the initial one."""
NULL_STATIONS = 25
"""Configurations along the path whose null spaces are averaged."""


Parts = tuple[Basis, Flags, int, ToolCoordinates | None]
"""Arguments of `FreeProgramme` after the given programme."""


class Choice:
    """The choice of the coefficients of a path that a joint path follows, from the optimum along it."""

    damping = LEAST_P_DAMPING
    statics: tuple[Statics, ...] = ()
    ways: Sequence[FreeWay] = ()

    def __init__(
        self, path: FreePath, joint_path: JointPath, optimum: Optimum, *, held: bool, ways: Sequence[FreeWay] = ()
    ) -> None:
        robot, s = joint_path.robot, optimum.programme.s
        if path.spline.count > s.size:
            allowed = f"at most {s.size}, the number of grid points of the law"
            raise InvalidInput("coefficients", path.spline.count, allowed)
        self.path, self.robot, self.joint_path, self.optimum, self.held = path, robot, joint_path, optimum, held
        self.ways = ways
        self.initial: FreePath | PointToPoint = path
        rows = _null_rows(robot, joint_path)
        elbow = path.spline.fit(joint_path.knots, joint_path.q @ rows.T)
        self.rows, self.tool_count = rows, len(path.screws)
        self.p: Array = np.concatenate([path.coefficients, elbow], axis=1)
        self.bounds, free = self._bound()
        twists = np.stack([path.given(s, order) for order in (1, 2, 3)], axis=1)
        tool = ToolCoordinates(path.screws, np.ascontiguousarray(path.given(s)), twists, rows)
        self.parts: Parts = path.spline.basis(s), free.ravel(), self.p.shape[1], tool
        self.programme = FreeProgramme(optimum.programme, *self.parts)
        self.near: Array = np.stack([joint_path(s, order) for order in range(4)])

    def _bound(self) -> tuple[ControlBounds, Flags]:
        """Return the bounds of the coefficients, and which of them are free."""
        lower, upper = np.full(self.p.shape, -np.inf), np.full(self.p.shape, np.inf)
        free, column, tool = np.ones(self.p.shape, np.bool_), self.tool_count, self.path.control_bounds
        lower[:, :column], upper[:, :column] = tool.lower, tool.upper
        if "elbow" in self.path.bounds:
            low, high = self.path.bounds["elbow"]
            lower[:, column:], upper[:, column:] = self.p[:, column:] + low, self.p[:, column:] + high
        else:
            free[:, column:] = False
        if self.held:
            free[0] = False
        return ControlBounds(lower, upper, tool.discs), free

    def gradient(self) -> Array:
        """Return dT/dp (C, D) at the initial path, from the multipliers of the optimum along it."""
        free, (fixed, at) = self.programme, self.optimum
        place = free.place(self.p, self.near)
        if place is None:
            return np.full(self.p.shape, np.nan)
        counts, m = free.scales.counts, fixed.problem.node.shape[1]
        problem = free.problem(place)
        duals, y = at.dual[:, 0] - at.dual[:, 1], np.zeros((free.K + 1, free.rows + 2 * problem.edge.shape[2]))
        duals[0, :m], duals[-1] = 0.0, 0.0  # not limited there
        first, rows = free.speeds, fixed.rows
        nodes, edges = duals[:, :m], duals[:, m:].reshape(len(duals), 2, -1)
        second, third = (sum(names.values()) for names in rows.others)  # which the choice does not know
        nodes = np.delete(nodes, slice(counts[2], counts[2] + second), axis=1)
        edges = np.delete(edges, slice(rows.joints, rows.joints + third), axis=2)
        y[:, first : first + counts[2] + counts[3]] = nodes[:, : counts[2] + counts[3]]
        y[:, free.rows :] = edges.reshape(len(duals), -1)
        self._spread_speeds(problem.node, at, y)
        border = free.make_border()
        free.fill(place, at.z, y, border)
        slope = free.gather(y, border).reshape(self.p.shape) * fixed.units[1]
        return slope * free.window.free.reshape(self.p.shape)

    def _spread_speeds(self, node: Array, at: Iterate, y: Array) -> None:
        """Add the multipliers of the greatest speeds to those of the joint or tool limit that bounds each."""
        free = self.programme
        counts, top = free.scales.counts, self.optimum.programme.problem.top
        further = node[:, free.speeds - counts[7] : free.speeds, 2]
        linear = np.abs(np.concatenate([node[:, : counts[0], 2], further], axis=1))
        begin = free.rows - int(counts[5] + counts[6]) - bin(counts[4]).count("1")
        square = np.sqrt(node[:, begin : begin + bin(counts[4]).count("1"), 1])
        active = np.concatenate([linear, square], axis=1).argmax(axis=1)
        for k in range(1, free.K):
            i = int(active[k])
            force = at.bound[k, 1] * top[k]
            if i < linear.shape[1]:
                row = i if i < counts[0] else free.speeds - linear.shape[1] + i
                y[k, row] += force * np.sign(node[k, row, 2])
            else:
                y[k, begin + i - linear.shape[1]] += 0.5 * force

    def solve(self) -> Iterator[FreeSolution]:
        """Yield the optima from the initial guesses."""
        for p, near in self.guesses():
            found = solve_coefficients(self.programme, p, self.bounds, near, damping=self.damping)
            if found is not None:
                yield found

    def guesses(self) -> Iterator[tuple[Array, Array]]:
        """Yield initial coefficients and configurations that differ and need little time: of the path, and of sequences."""
        found = [(self.p, self.near)]
        for way in self.ways:
            q = scipy.interpolate.make_interp_spline(way.s, way.q, k=min(5, len(way.s) - 1))
            p = np.concatenate([way.fit(self.path), self.path.spline.fit(way.s, way.q @ self.rows.T)], axis=1)
            near = np.stack([q(self.optimum.programme.s, order) for order in range(4)])
            place = self.programme.place(p, near)
            if place is None or not self.robot.limits.contains(place.path[0]).all():
                continue
            if all(np.abs(place.path[0] - other[0]).max() > SAME_GUESS for _, other in found):
                found.append((p, place.path))
        times = [measure_time(self.robot, near[0]) for _, near in found]
        yield from (one for one, time in zip(found, times, strict=True) if time <= SLOW_GUESS * min(times))

    def refine(self) -> Iterator[Choice]:
        """Yield choices with more coefficients, unless their number was given."""
        for factor in MORE_COEFFICIENTS:
            count = int(factor * self.path.spline.count)
            if self.path.counts_itself and count <= self.optimum.programme.s.size // POINTS_PER_COEFFICIENT:
                yield Choice(self.path.with_count(count), self.joint_path, self.optimum, held=self.held, ways=self.ways)

    def path_of(self, p: Array) -> FreePath | PointToPoint:
        """Return the path with the coefficients of a solution."""
        p, d = self.bounds.clip(p), self.tool_count  # the iteration may end outside by its last residual
        null = NullSpace(self.rows, p[:, d:], self.p[:, d:]) if len(self.rows) else None
        return self.path.with_coefficients(p[:, :d], null)


class JointChoice(Choice):
    """The choice of the control points of a path in joint space."""

    def __init__(self, path: PointToPoint, joint_path: JointPath, optimum: Optimum) -> None:
        robot, s = joint_path.robot, optimum.programme.s
        self.joints, self.robot, self.joint_path, self.optimum = path, robot, joint_path, optimum
        self.initial = path
        self.p = path.coefficients
        lower, upper = (np.tile(x, (len(self.p), 1)) for x in (robot.limits.lower, robot.limits.upper))
        self.bounds, free = ControlBounds(lower, upper), np.ones(self.p.shape, np.bool_)
        free[[0, -1]] = False
        free[:, robot.limits.lower == robot.limits.upper] = False
        self.parts = path.spline.basis(s), free.ravel(), robot.n, None
        self.statics = (ViaLimits(robot, path, s),) if path.vias else ()
        self.programme = FreeProgramme(optimum.programme, *self.parts, *self.statics)
        self.near = np.stack([joint_path(s, order) for order in range(4)])
        self.damping = SHAPE_DAMPING

    def refine(self) -> Iterator[Choice]:
        """Yield nothing: the path around obstacles has its own number of control points."""
        return iter(())

    def path_of(self, p: Array) -> PointToPoint:
        """Return the path with the control points of a solution, through the via points."""
        return self.joints.with_coefficients(pass_through(self.joints, p))


def _null_rows(robot: Robot, joint_path: JointPath) -> Array:
    """Return the directions (r, n) nearest to the null spaces of the Jacobian along a joint path."""
    if robot.n <= 6:
        return np.empty((0, robot.n))
    q = joint_path(np.linspace(0.0, joint_path.end, NULL_STATIONS))
    basis = np.linalg.svd(robot.jacobian(q))[2][:, 6:]
    mean = np.einsum("kri,krj->ij", basis, basis)
    return np.ascontiguousarray(np.linalg.eigh(mean)[1][:, : 5 - robot.n : -1].T)


def make_choice(
    path: FreePath | PointToPoint, joint_path: JointPath, optimum: Optimum, *, held: bool, ways: Sequence[FreeWay] = ()
) -> Choice:
    """Return the choice of a path's coefficients, after checking that the arm has its freedoms."""
    if not isinstance(path, FreePath):
        return JointChoice(path, joint_path, optimum)
    path = path.asking(joint_path.robot)
    most = optimum.programme.s.size // POINTS_PER_COEFFICIENT
    if path.counts_itself and path.spline.count > most:
        path = path.with_count(most)
    return Choice(path, joint_path, optimum, held=held and path.hold_start, ways=ways)


class ChoiceReport(NamedTuple):
    """What a choice did: in words, Σ|dT/dp| at the initial path, initial guesses, and Newton steps in all."""

    outcome: str
    gradient: float = float("nan")
    starts: int = 0
    steps: int = 0


FIXED = ChoiceReport("the initial coefficients: only the law optimal chooses them")
"""That of a plan by another law."""


def measure_time(robot: Robot, q: Array) -> float:
    """Return the sum of the largest steps of configurations (k, n), each over its joint's greatest speed if there are some."""
    steps = np.abs(np.diff(q, axis=0))
    return float((steps if robot.limits.velocity is None else steps / robot.limits.velocity).max(axis=1).sum())


def measure_travel(q: Array) -> float:
    """Return the sum over the joints of ∫|q̇| dt [rad, m], from configurations (k, n) along a motion."""
    return float(np.abs(np.diff(q, axis=0)).sum())


def pick_plan(plans: Sequence[Plan]) -> Plan:
    """Return the plan with the least joint travel among those at most 0.2 % longer than the shortest."""
    motions = [plan.trajectory for plan in plans]
    most, u = NEARLY * min(motion.duration for motion in motions), np.linspace(0.0, 1.0, TRAVEL_SAMPLES)
    travels = [measure_travel(m(u * m.duration)) if m.duration <= most else np.inf for m in motions]
    return plans[int(np.argmin(travels))]


def choose_coefficients(
    path: FreePath | PointToPoint, joint_path: JointPath, optimum: Optimum | None, fixed: Plan, *, held: bool,
    plan_along: Callable[[FreePath | PointToPoint, Array], Plan | None], ways: Sequence[FreeWay] = (),
) -> tuple[list[Plan], ChoiceReport]:  # fmt: skip
    """Return plans along chosen paths, shorter than that along the initial one, and what was done.

    They are the fastest one, and of those nearly as fast the one with the least travel. plan_along makes a plan along a path
    from a start configuration (n,), or returns None if it is not valid.
    """
    if optimum is None:
        return [], FIXED
    duration, choice = fixed.trajectory.duration, make_choice(path, joint_path, optimum, held=held, ways=ways)
    gradient = float(np.abs(choice.gradient()).sum())
    if gradient <= WORTHLESS * duration and not ways:
        return [], ChoiceReport("the initial path: the freedoms cannot shorten the motion", gradient)
    solutions, most = list(choice.solve()), (1.0 - LEAST_GAIN) * duration
    fast = sorted((one for one in solutions if one.duration < most), key=lambda one: one.duration)
    near = [one for one in fast if one.duration <= NEARLY * fast[0].duration]
    outcome = f"the initial path: {'no other is shorter in time' if solutions else 'the iteration found no other'}"
    tried = dict[tuple[float, float], Plan | None]()
    for order in (fast, sorted(near, key=lambda one: measure_travel(one.path[0]))):
        for solution in order:
            like = round(solution.duration, 5), round(measure_travel(solution.path[0]), 2)
            if like not in tried:
                plan = plan_along(choice.path_of(solution.p), solution.path[0, 0])
                tried[like] = plan if plan is not None and plan.trajectory.duration < most else None
            if tried[like] is not None:
                break
    plans = [plan for plan in tried.values() if plan is not None]
    if tried:
        outcome = CHOSEN if plans else "the initial path: no other is proved and shorter in time"
    return plans, ChoiceReport(outcome, gradient, len(solutions), sum(one.steps for one in solutions))


def report(best: Plan, made: ChoiceReport = FIXED, fixed: float | None = None) -> FreedomResult:
    """Return the result for a plan, chosen or not, beside the duration along the initial path [s], its own by default."""
    path, duration = best.path, best.trajectory.duration
    assert isinstance(path, FreePath | PointToPoint)
    s = np.linspace(0.0, path.end, REPORT_POINTS)
    values = path.values_of_ranges(s) if isinstance(path, FreePath) else path.coordinates(s)[:, 0]
    most, off = path.most_deviation if isinstance(path, FreePath) else (np.nan, np.nan), best.certificate.path_error
    near = off.distance + most[0], off.angle + most[1]
    unknown = tuple(name for name in best.certificate.extra if not is_known(name))
    fixed = duration if fixed is None else fixed
    gain = 1.0 - duration / fixed
    return FreedomResult(fixed, gain, made.outcome, path.ranges, s, values, *made[1:], *near, unknown)
