"""The time optimum under velocity, acceleration, jerk and tool-speed limits: a nonlinear programme on the path's s."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from optik.check import check_count, check_number
from optik.errors import NoSolution
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.following.follow import JointPath
from planners.limits import ALL_LIMITS, DERIVATIVES, MotionLimits, kind_of
from planners.limits.motion_limits import tool_limits_between
from planners.motion.motion import FIRST_MARGIN, is_within, match_start, stretch_analysed, stretch_to_limits
from planners.timing.base import QUIET, PathState, TimeLaw, refit
from planners.timing.interior_point import iteration
from planners.timing.interior_point.newton import Iterate, Problem
from planners.timing.interior_point.programme import (
    TimingProblem,
    briefest,
    halve_intervals,
    moving_programme,
    quintic_programme,
    start,
)
from planners.timing.interior_point.rows import derivatives, distances, dynamic_excess, torque_excess
from planners.trajectory import Trajectory
from planners.trajectory.curve import apply_chain_rule, quintic_through

# ---------------- a motion that leaves an elastic mode at rest: s(t) averaged over one period of the mode

# The mean over w = 1/f is a filter with zeros at f and its multiples. s̄̇ = (s(t) − s(t − w)) / w, and so for each derivative.


BASES = ((7.0, "acceleration"), (1.0, "jerk"))
"""Jerk limits of the base motions over the given ones, and the limit that is reduced where the jerk exceeds its own: after the
mean it is at most the change of the acceleration within w, over w."""
MEAN_APART = 1e-4
"""Least time [s] between knots of the mean: in shorter pieces rounding dominates the jerk."""
ROUNDS, SPARE, CLOSE = 8, 0.999, 1.002
"""Most rounds in which the limits of the base motion are scaled, the fraction of a limit that is aimed at, and the excess at
which they end: a stretch by it moves the zero of the filter as little."""
Run = Callable[[JointPath, MotionLimits], tuple[MotionAnalysis, Any]]
"""The law of the base motion."""


def plan_quiet(
    run: Run, joint_path: JointPath, limits: MotionLimits, enforced: tuple[str, ...], frequency: float
) -> tuple[MotionAnalysis, Any]:
    """Return the shortest averaged motion of the base motions, and the optimum of its base motion."""
    best: tuple[MotionAnalysis, Any] | None = None
    for factor, reduced in BASES:
        base = limits.scale(factor, ("jerk",))
        found = _fit_base(run, joint_path, (limits, base), enforced, 1.0 / frequency, reduced)
        if found is not None and (best is None or found[0].trajectory.end < best[0].trajectory.end):
            best = found
    if best is None:
        raise NoSolution(
            f"no motion averaged over {1.0 / frequency:.4g} s respects the limits",
            advice="a higher frequency, higher limits, or no quiet=",
        )
    return best


def _fit_base(
    run: Run,
    joint_path: JointPath,
    both: tuple[MotionLimits, MotionLimits],
    enforced: tuple[str, ...],
    w: float,
    reduced: str,
) -> tuple[MotionAnalysis, Any] | None:
    """Return the averaged motion whose base limits are scaled until it respects the limits; None if they cannot be."""
    (limits, base), bounds = both, both[0].bounds(joint_path.robot.n)
    kinds = [kind for kind in limits.kinds if kind.name in enforced and kind.is_given(bounds[kind.name])]
    for _ in range(ROUNDS):
        try:
            analysis, optimum = run(joint_path, base)
        except NoSolution:
            return None
        law = average(joint_path, analysis.trajectory, w)
        motion = MotionAnalysis(
            joint_path.robot, refit(joint_path, law, limits.arrays(joint_path.robot.n)["jerk"]), joint_path.path
        )
        ratios = {kind.name: float(np.nanmax(kind.judge(motion, bounds[kind.name]).ratio)) for kind in kinds}
        if max(ratios.values()) <= CLOSE:
            return stretch_analysed(motion, limits, enforced) if max(ratios.values()) > 1.0 else motion, optimum
        for name, ratio in ratios.items():
            if ratio > 1.0:
                base = base.scale(SPARE / ratio, (reduced if name == "jerk" else name,))
    return None


def average(joint_path: JointPath, motion: Trajectory, w: float) -> Any:
    """Return the piecewise quintic s̄(t), the mean of the path parameter of a motion over the last w seconds."""
    t, s, end = motion.knots, motion.s, motion.end
    assert s is not None
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    square = np.einsum("ki,ki->k", q1, q1)
    v = np.einsum("ki,ki->k", q1, motion(t, 1)) / square
    a = np.einsum("ki,ki->k", q1, motion(t, 2) - q2 * v[:, None] ** 2) / square
    v[[0, -1]], a[[0, -1]] = 0.0, 0.0
    along = quintic_through(t, s[:, None], v[:, None], a[:, None])
    total = along.antiderivative()

    def at(x: Array, order: int) -> Array:
        """Return the integral of s, s, or ṡ, which is constant before and after the motion."""
        inside = np.clip(x, 0.0, end)
        if order < 0:
            return np.asarray(total(inside)[:, 0] + np.maximum(x - end, 0.0) * s[-1])
        return np.asarray(along(inside, order)[:, 0])

    knots = np.unique(np.concatenate([t, t + w]))
    knots = knots[np.diff(knots, prepend=-1.0) > MEAN_APART]
    knots[-1] = end + w
    p, v, a = ((at(knots, order) - at(knots - w, order)) / w for order in (-1, 0, 1))
    p[0], p[-1], v[[0, -1]], a[[0, -1]] = s[0], s[-1], 0.0, 0.0
    mean = quintic_through(knots, *(x[:, None] for x in (np.clip(p, s[0], s[-1]), v, a)))
    return scipy.interpolate.PPoly(mean.c[:, :, 0], knots)


# ---------------- the time optimum


GAP = 1e-5
"""Optimality gap of the programme, as a fraction of the duration: far below the gain of a finer grid."""
TIGHTENINGS = 4
"""Largest number of rounds that tighten limits where exact extrema exceed them, before the motion is stretched uniformly."""
LIMIT_ROUNDING = 5e-13
"""Accepted excess of a limit if the motion is not slowed afterwards: half of what a certificate accepts as rounding."""
FIRST_BARRIER, WARM_BARRIER = 0.01, 5e-4
"""Initial barrier weights, cold and warm start, relative to the mean interval duration."""
START_ATTEMPTS = ((1.0, 1.0), (1.0, 1.4), (1.0, 0.75), (100.0, 1.0), (1.0, 0.3), (10.0, 1.7), (1.0, 0.15), (1.0, 3.0))
"""Initial barrier weights and numbers of intervals, relative to the usual ones, that are tried in turn: if the iteration fails
on one grid, it rarely fails on another."""
GENTLE = (1.0, 100.0)
"""First barrier weights, over the usual one, for an initial guess of one quintic in s, where every other one failed."""
GENTLER = 0.5
"""Fraction of asymmetric acceleration limits that the second initial guess of a stop uses, where the first one fails."""
SLOWER = 1.5
"""Largest factor by which an initial guess is slowed as a whole: one bad point should not slow a long path."""
MOST_ITERATIONS, WARM_ITERATIONS = 200, 50
"""Largest number of iterations, cold and warm start (if the latter fails, its motion is used); 12 to 22 are usual."""
STOP_INTERVALS, STOP_ITERATIONS = 48, 50
"""Number of intervals of a stop, and most iterations for it: a stop that exists takes 10 (median), 36 at most."""
PROOF_EXCESS = 2e-5
"""Fraction of the limits on torque and its rate that is reserved for the proof, whose bounds exceed the peaks by half of it."""
SLOWDOWN_LEFT, SLOWDOWN_LOADED = 2e-4, 5e-4
"""Fractions of the duration that are left to the uniform stretch, the second with torque limits."""
OFF_JOINT_PATH = 1e-7
"""Largest distance of a joint from q(s) between grid points [rad or m]; intervals that exceed it are halved."""
COARSE, WORSE, INTERVAL_HALVINGS = 1.05, 1.2, 2
"""Intervals in which a limit is exceeded by these factors, early and later, are halved too, at most `INTERVAL_HALVINGS` times;
those that leave the joint path four times as often."""
FINEST_INTERVALS = 100_000
"""Number of intervals from which on none is halved: minutes of computing."""
BETWEEN_SAMPLES = 1.00005
"""Largest ratio of the tool speed inside a piece to that at the four instants where it is sampled."""


class Optimal(TimeLaw):
    """Time-optimal with jerk limits: s⃛ is constant on intervals between fixed path parameters, whose durations are free.

    The initial guess is a motion that nearly respects all limits, from two sweeps. An interior-point iteration solves the
    programme (`planners.timing.interior_point`). Then the motion is refitted. Where its exact extrema exceed a limit, the
    limit is tightened and the programme is solved again with a warm start. The last 2e-4 is a uniform stretch, so that
    every limit is respected exactly. The computing time grows linearly with the length of the path.

    Parameters
    ----------
    intervals : int, optional
        Number of intervals of s. The default is about 130 on a line and grows with the breaks of the path, to over 1,000 on
        long polylines. Fewer intervals make the motion longer. With the default, it is about 0.1 % longer than the optimum
        on lines, and up to 5 % longer on polylines with sharp corners; more intervals help there.

    quiet : float, optional
        Frequency of an elastic mode [1/s] that the motion leaves at rest: s(t) is averaged over its period, of a motion that is
        planned with a higher jerk. Stops, and motions that start while the arm moves, are not averaged.

    Raises
    ------
    InvalidInput
        Fewer than 8 intervals, or a frequency that is not above 0.
    """

    name: ClassVar[str] = "optimal"
    enforced: ClassVar[tuple[str, ...]] = ALL_LIMITS
    counts_torque: ClassVar[bool] = True

    def __init__(self, *, intervals: int | None = None, quiet: float | None = None) -> None:
        if intervals is not None:
            check_count(intervals, "intervals", 8)
        if quiet is not None:
            quiet = check_number(quiet, "quiet", "a frequency above 0 [1/s]", above=0.0)
            self.name = f"{type(self).name}{QUIET}{quiet:.9g} Hz"  # type: ignore[misc]
        self.intervals, self.quiet = intervals, quiet

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> MotionAnalysis:
        return self.run_with_optimum(joint_path, limits)[0]

    def run_with_optimum(
        self, joint_path: JointPath, limits: MotionLimits, density: float = 1.0
    ) -> tuple[MotionAnalysis, Optimum]:
        """Return the motion with its analysis, and the optimum with its multipliers.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.
        density : float
            Number of intervals over the default.

        Returns
        -------
        tuple
            The motion, and the solved programme.

        Raises
        ------
        NoSolution
            The iteration found no motion.
        """
        self.check(joint_path, limits)
        if self.quiet is None:
            return self._run(joint_path, limits, density)
        base = partial(self._run, density=density)
        return plan_quiet(base, joint_path, limits, self.list_enforced(limits), self.quiet)

    def _run(self, joint_path: JointPath, limits: MotionLimits, density: float = 1.0) -> tuple[MotionAnalysis, Optimum]:
        """Return the motion without an average, with its analysis, and the optimum."""
        enforced = self.list_enforced(limits)
        loaded = limits.torque is not None or limits.torque_rate is not None
        inside = limits.scale(1.0 - PROOF_EXCESS, ("torque", "torque_rate")) if loaded else limits
        for problem, weight in _problems(joint_path, inside, self.intervals, density):
            loaded = problem.rows.loaded
            solution = _solve(problem, SLOWDOWN_LOADED if loaded else SLOWDOWN_LEFT, weight)
            if solution is None:
                continue
            motion = MotionAnalysis(joint_path.robot, solution.motion, joint_path.path)
            if loaded:  # after slowing by the estimated factor, one proof is usually enough
                stretched = motion.stretched(max(solution.slower, 1.0) * (1.0 + FIRST_MARGIN))
                if is_within(stretched, limits, enforced):
                    return stretched, solution.optimum
            return stretch_analysed(motion, limits, enforced), solution.optimum
        limit, joint, place, ratio = _find_worst_violation(start(joint_path, limits, self.intervals))
        raise NoSolution(
            f"the interior-point iteration found no motion; its start has {ratio:.4g} times the {limit} limit of {joint} at "
            f"s = {place:.6g}",
            s=place, joint=joint, advice="another number of intervals, or another law",
        )  # fmt: skip

    def run_from(self, joint_path: JointPath, limits: MotionLimits, state: PathState) -> Trajectory:
        """Time the remaining joint path from a moving state; a motion that starts at rest is slowed as in `run`."""
        self.check(joint_path, limits)
        at_rest = state.speed == 0.0 and state.acceleration == 0.0
        problem = moving_programme(joint_path, limits, self.intervals, state, joint_path.end)
        found = None if problem is None else _solve(problem, SLOWDOWN_LOADED if at_rest else 0.0)
        if found is not None and at_rest:
            return stretch_to_limits(
                joint_path.robot, found.motion, limits, self.list_enforced(limits), joint_path.path
            )
        if found is not None:
            return found.motion
        raise NoSolution(
            "no motion from this state ends at rest on the path within the limits",
            s=state.s,
            advice="stop=True, or higher limits",
        )

    def run_to(self, joint_path: JointPath, limits: MotionLimits, state: PathState, end: float) -> Trajectory | None:
        """Time the part of the joint path from a moving state to a path parameter at which the motion comes to rest.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.
        state : PathState
            State at the start of the motion.
        end : float
            Path parameter at which it ends [m, rad].

        Returns
        -------
        Trajectory or None
            The motion; None if none is found.
        """
        gentler = limits.scale(GENTLER, ("acceleration",))
        pairs = any(np.ndim(bound) > 1 for bound in limits.bounds(joint_path.robot.n).values())
        for guessed in (limits, gentler) if pairs else (limits,):
            try:
                problem = moving_programme(joint_path, limits, self.intervals or STOP_INTERVALS, state, end, guessed)
                solution = None if problem is None else _solve(problem, 0.0, most=STOP_ITERATIONS)
            except NoSolution:
                return None
            if solution is not None:
                return solution.motion
        return None


def _problems(
    joint_path: JointPath, limits: MotionLimits, intervals: int | None, density: float
) -> Iterator[tuple[TimingProblem, float]]:  # fmt: skip
    """Yield programmes with initial guesses and barrier weights, the most promising first."""
    density = density if intervals is None else 1.0
    for weight, more in START_ATTEMPTS:
        yield _refine(start(joint_path, limits, intervals, density * more)), weight
    for weight in GENTLE:
        yield quintic_programme(joint_path, limits, intervals), weight


def _find_worst_violation(given: TimingProblem) -> tuple[str, str, float, float]:
    """Return limit, joint, path parameter and ratio of the largest violation of a guess, a likely reason of failure."""
    K, n, joints = given.problem.ds.size, given.joint_path.robot.n, given.joint_path.robot.joint_names
    m, c = given.problem.node.shape[1], _limit_ratios(given.problem, given.start)
    k, i = np.unravel_index(int(np.abs(c).argmax()), c.shape)
    accelerations = given.rows.node.shape[1] - given.rows.static.shape[1] - sum(given.rows.others[0].values())
    if i < m:
        names, place = _name_rows("acceleration", accelerations, given.rows.others[0], "torque", m), given.s[k]
    else:
        end, i = divmod(i - m, given.problem.edge.shape[2])
        count = given.problem.edge.shape[2]
        names, place = _name_rows("jerk", n, given.rows.others[1], "torque rate", count), given.s[min(k, K - 1) + end]
    limit, row, rows = names[i]
    subject = kind_of(limit).subject if limit in (given.limits.extra or ()) else None
    joint = joints[row % n if subject is None and rows % n else row * n // rows] if subject is None else subject
    return limit.replace("_", " "), joint, float(place), float(np.abs(c[k]).max())


def _name_rows(first: str, count: int, others: dict[str, int], last: str, rows: int) -> list[tuple[str, int, int]]:
    """Return the limit of each of so many rows, the number of the row among those of the limit, and how many it has."""
    counts = {first: count} | others
    counts[last] = rows - sum(counts.values())
    return [(name, row, most) for name, most in counts.items() for row in range(most)]


def _limit_ratios(problem: Problem, z: Array) -> Array:
    """Return the ratios of a motion to all limits (K + 1, m + 2 e): at grid points, and at both ends of the intervals."""
    K = problem.ds.size
    g, c = np.zeros((K, 3)), np.zeros((K + 1, problem.node.shape[1] + 2 * problem.edge.shape[2]))
    iteration.values(problem, z, g, c)
    return c


class Optimum(NamedTuple):
    """Solution of the time-optimal programme on a fixed path: the programme, and the iterate with its multipliers."""

    programme: TimingProblem
    at: Iterate


class _Solution(NamedTuple):
    """A motion, the factor by which it must be stretched to respect every limit, and the optimum that it is."""

    motion: Trajectory
    slower: float
    optimum: Optimum


def _solve(timing: TimingProblem, close: float, weight: float = 1.0, most: int = MOST_ITERATIONS) -> _Solution | None:
    """Return the motion whose exact extrema exceed the limits by the fraction `close`, or by more if stretched later."""
    z = timing.start if timing.moving is not None else _slow_down(timing.problem, timing.start, 0.9, SLOWER)
    brief = briefest(timing.limits.arrays(timing.joint_path.robot.n)["jerk"])
    weight, halvings, again = weight * FIRST_BARRIER, 0, 0
    solution: _Solution | None = None
    while again < (TIGHTENINGS if close else 2 * TIGHTENINGS):
        problem = timing.problem
        K, rows = problem.ds.size, problem.node.shape[1] + 2 * problem.edge.shape[2]
        at = iteration.make_iterate(K, rows)
        if (
            iteration.solve_barrier(
                problem, z, weight, GAP / (2.0 * rows), most if solution is None else WARM_ITERATIONS, at
            )
            < 0
        ):
            break
        motion = _motion(timing, z)
        coarse = _find_departures(timing, z) & (halvings < 4 * INTERVAL_HALVINGS)
        if timing.moving is not None and timing.moving.joints is not None:
            motion = match_start(motion, timing.moving.joints, timing.limits)
        excess = _excess(timing, motion, z)
        # Where nothing is slowed afterwards.
        often = 2 * INTERVAL_HALVINGS if timing.moving is not None else INTERVAL_HALVINGS
        coarse |= (excess.worst > (COARSE if 2 * halvings < often else WORSE)) & (halvings < often)
        coarse &= z[:-1, 2] * timing.units[1] > 2.0 * brief
        if coarse.any() and K < FINEST_INTERVALS:
            timing, halvings = halve_intervals(timing, z, coarse), halvings + 1
            z = timing.start if timing.moving is not None else _slow_down(timing.problem, timing.start, 0.98)
            weight, solution = FIRST_BARRIER if timing.moving is not None else WARM_BARRIER, None
            continue
        tool = _tool_ratios(timing, motion) * (1.0 if close else BETWEEN_SAMPLES)
        solution, again = _Solution(motion, excess.slower(tool), Optimum(timing, at)), again + 1
        if solution.slower <= 1.0 + max(close, LIMIT_ROUNDING):
            return solution
        _tighten(problem, excess, tool, 0.0 if close else 1e-6)
        if timing.moving is None:
            z = _slow_down(problem, z, 0.995)
        weight = WARM_BARRIER if timing.moving is None else 4.0 * WARM_BARRIER  # which is not moved inside the limits
    return solution if close else None


def _refine(given: TimingProblem) -> TimingProblem:
    """Return the programme with those intervals halved in which its initial guess leaves the joint path."""
    for _ in range(INTERVAL_HALVINGS):
        z = given.start
        coarse = _find_departures(given, z)
        coarse &= z[:-1, 2] * given.units[1] > 2.0 * briefest(given.limits.arrays(given.joint_path.robot.n)["jerk"])
        if not coarse.any():
            break
        given = halve_intervals(given, z, coarse)
    return given


def _find_departures(given: TimingProblem, z: Array) -> NDArray[np.bool_]:
    """Return the intervals (K,) in which the motion leaves the joint path by more than `OFF_JOINT_PATH`."""
    state, tau = _states(given, z)
    ends = derivatives(given.joint_path, given.s)[:3]
    return distances(given.joint_path, given.s, state, tau, ends) > OFF_JOINT_PATH


def _slow_down(problem: Problem, z: Array, share: float, most: float = np.inf) -> Array:
    """Return the motion z, stretched by at most `most` until it uses at most a fraction of every limit."""
    m, c = problem.node.shape[1], _limit_ratios(problem, z)
    factor = max(
        1.0,
        float((z[1:-1, 0] / problem.top[1:-1]).max()) / share,
        np.sqrt(dynamic_excess(c[:, :m], problem.node[:, :, 3]).max(initial=0.0) / share),
        np.cbrt(np.abs(c[:, m:]).max() / share),
    )
    factor = min(factor, most)
    slower: Array = z / np.array([factor, factor**2, 1.0 / factor, factor**3])
    return slower


def _states(given: TimingProblem, z: Array) -> tuple[Array, Array]:
    """Return ṡ and s̈ at the grid points (K + 1, 2), and the durations (K,) between."""
    length, time = given.units
    state = np.vstack([z[:-1, :2], given.problem.goal])  # which the optimum meets to its own tolerance only
    return state * np.array([length / time, length / time**2]), z[:-1, 2] * time


def _motion(given: TimingProblem, z: Array) -> Trajectory:
    """Return the quintic Hermite trajectory through exact q, q̇, q̈ at the grid points."""
    state, tau = _states(given, z)
    v, a = state[:, :1], state[:, 1:]
    t = np.concatenate([[0.0], np.cumsum(tau)])
    q, q1, q2, _ = derivatives(given.joint_path, given.s)
    return Trajectory(quintic_through(t, q, *apply_chain_rule((q1, q2), (v, a))), given.s)


def _tighten(problem: Problem, excess: _Excess, tool: Array, spare: float) -> None:
    """Tighten the limits in intervals where they are exceeded, by a fraction `spare` more."""
    speed, node, edge = (np.where(o > 1.0, o * (1.0 + spare), 1.0) for o in excess)
    m = node.shape[1]
    problem.node[:-1, :m, :3] *= node[:, :, None]  # not the static part, which no tightening changes
    problem.node[1:, :m, :3] *= node[:, :, None]
    problem.edge[...] *= edge[:, None, :, None]
    slow = np.maximum(speed.max(axis=1), np.where(tool > 1.0, 1.0 + 1.2 * (tool - 1.0), 1.0))
    problem.top[:-1] /= slow
    problem.top[1:] /= slow


class _Excess(NamedTuple):
    """Factors by which a motion exceeds the limits in every interval.

    Velocities (K, n), rows at grid points (K, m), and rows in intervals (K, e); exact for joints, sampled for torques.
    """

    speed: Array
    node: Array
    edge: Array

    @property
    def worst(self) -> Array:
        """Largest factor of every interval (K,)."""
        return np.asarray(np.concatenate([self.speed, self.node, self.edge], axis=1).max(axis=1))

    def slower(self, tool: Array) -> float:
        """Return the stretch factor that meets all limits; `tool` (K,) are the ratios of the tool's speed to its limit."""
        node, edge = self.node.max(initial=0.0) ** (1.0 / 2.0), self.edge.max() ** (1.0 / 3.0)
        return float(max(self.speed.max(), node, edge, tool.max()))


def _excess(given: TimingProblem, motion: Trajectory, z: Array) -> _Excess:
    """Return the factors by which a motion exceeds the limits in the intervals."""
    robot, limits = given.joint_path.robot, given.limits
    bounds, analysis = limits.bounds(robot.n), MotionAnalysis(robot, motion)
    speed, acceleration, jerk = (kind_of(field).piece_ratios(analysis, bounds[field]) for field in DERIVATIVES)
    if not given.rows.loaded:
        return _Excess(speed, acceleration[:, : given.rows.node.shape[1]], jerk)
    m, c = given.problem.node.shape[1], _limit_ratios(given.problem, z)
    torque, rate = torque_excess(given.joint_path, limits, given.rows, motion, (c[:, :m], c[:, m:]))
    second, third = ([kind_of(name).excess(analysis, bounds[name]) for name in names] for names in given.rows.others)
    if not np.isfinite(bounds["acceleration"]).any():
        acceleration = np.empty((torque.shape[0], 0))
    node, edge = np.concatenate([acceleration, *second, torque], axis=1), np.concatenate([jerk, *third, rate], axis=1)
    return _Excess(speed, node, edge)


def _tool_ratios(given: TimingProblem, trajectory: Trajectory) -> Array:
    """Return the largest ratios (K,) of sampled tool speeds, and of further values of first order, to their limits."""
    t, limits, path, robot = trajectory.knots, given.limits, given.joint_path.path, given.joint_path.robot
    most, bounds, analysis = np.zeros(t.size - 1), limits.bounds(robot.n), MotionAnalysis(robot, trajectory)
    for name in limits.extra or ():
        if kind_of(name).order == 1:
            most = np.maximum(most, kind_of(name).piece_ratios(analysis, bounds[name]).max(axis=1))
    if not np.isfinite(limits.tool).any():
        return most
    at = (t[:-1, None] + np.diff(t)[:, None] * np.array([0.2, 0.4, 0.6, 0.8])).ravel()
    twist = np.einsum("kij,kj->ki", robot.jacobian(trajectory(at)), trajectory(at, 1))
    norms = np.linalg.norm(twist.reshape(-1, 4, 2, 3), axis=3) / tool_limits_between(limits, path, given.s)[:, None]
    return np.asarray(np.maximum(most, norms.max(axis=(1, 2))))


METHOD = Optimal
