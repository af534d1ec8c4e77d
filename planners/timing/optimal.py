"""The time optimum under velocity, acceleration, jerk and tool-speed limits: a nonlinear programme on the path's s."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
import ruckig
from numpy.typing import NDArray

from optik.check import check_count
from optik.errors import NoSolution
from planners.fit import fitted
from planners.follow import JointPath
from planners.hermite import through
from planners.timing import _optimum, _reach
from planners.timing.base import ALL_LIMITS, DERIVATIVES, MotionLimits, PathState, TimeLaw, speed_bound
from planners.trajectory import Trajectory

Array = NDArray[np.float64]

UNITS = 64.0
"""The programme counts time and s in 64ths of the motion, so that its numbers are near 1."""
GAP = 1e-5
"""How far from the optimum of the programme its answer may be, as a share of the duration."""
INTERVALS = 160
"""Of a path without breaks; each break adds four."""
SHORTEST = 0.02
"""No interval lasts less than this share of its first guess."""
PASSES = 4
"""How often limits are tightened where the exact extrema pass them; what is left is a uniform slow-down."""
FIRST, AGAIN = 0.1, 1.5e-3
"""First barrier weights, from the start and from a motion that is nearly the answer, over the mean duration of intervals."""
STARTS = ((1.0, 1.0), (0.5, 1.0), (2.0, 1.0), (1.0, 10.0), (1.0, 0.1), (0.25, 10.0), (4.0, 10.0))
"""Widths of the start's filter over the usual one, and first barrier weights over the usual one, tried in turn."""
MOST = 100
"""Iterations; 12 to 22 are usual."""
CLOSE = 1e-4
"""What may be left to the slow-down: a share of the limits."""

WIDER = (1.0, 1.001, 1.003, 1.01)
"""Shares of the limits that are tried from a moving state."""


class Optimal(TimeLaw):
    """Time-optimal with jerk limits: s⃛ constant on intervals between fixed places, their durations free.

    Start is the velocity–acceleration optimum, box-filtered in time so that its jerk is finite; the programme is solved
    by an interior-point iteration of its own (`planners.timing._optimum`). Then the motion is refitted, and where its
    exact extrema pass a limit between the places, the limit is tightened there and the programme solved again from
    where it stands. The last 1e-4 is a uniform slow-down, so every limit is kept exactly.

    Parameters
    ----------
    intervals : int, optional
        Of s; by default so many that the motion is within about 0.1 % of the optimum.

    Raises
    ------
    InvalidInput
        Fewer than 8 intervals.
    """

    name: ClassVar[str] = "optimal"
    keeps: ClassVar[tuple[str, ...]] = ALL_LIMITS

    def __init__(self, *, intervals: int | None = None) -> None:
        if intervals is not None:
            check_count(intervals, "intervals", 8)
        self.intervals = intervals

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Time the joint path from rest to rest.

        Raises
        ------
        InvalidInput
            Velocity, acceleration or jerk limits are missing.
        NoSolution
            The iteration found no motion.
        """
        self.need(limits, joint_path.robot)
        for width, weight in STARTS:
            programme = _programme(joint_path, limits, self.intervals, width=width)
            trajectory = None if programme is None else _solved(joint_path, programme, limits, CLOSE, weight)
            if trajectory is not None:
                return fitted(joint_path.robot, trajectory, limits, self.keeps)
        raise NoSolution(
            "the interior-point iteration found no motion", advice="another number of intervals, or another law"
        )

    def run_from(self, joint_path: JointPath, limits: MotionLimits, state: PathState, *, stop: bool) -> Trajectory:
        """Time the rest of the joint path from a moving state to its end, or to rest on it as soon as may be.

        A motion that starts in motion cannot be slowed as a whole, so limits are tightened until they are kept exactly. Where
        the state leaves no such motion (one at its limits often misses them by rounding), limits up to 1 % wider are tried:
        the certificate shows what is passed.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Which the state itself must keep.
        state : PathState
            Where and how fast the motion is.
        stop : bool
            Stop on the path: the shortest way to rest of some that are tried, 10 % apart at first.

        Raises
        ------
        InvalidInput
            Velocity, acceleration or jerk limits are missing.
        NoSolution
            No motion from that state keeps the limits.
        """
        self.need(limits, joint_path.robot)
        ends = _stopping_places(joint_path, limits, state) if stop else [joint_path.end]
        for share in WIDER:
            wider = limits.scaled(share)
            for end in ends:
                programme = _programme(joint_path, wider, self.intervals, state, end)
                trajectory = None if programme is None else _solved(joint_path, programme, wider, 0.0)
                if trajectory is not None:
                    return trajectory
        raise NoSolution(
            f"no motion from this state {'comes to rest' if stop else 'ends at rest'} on the path within the limits",
            s=state.s,
            advice="higher limits" if stop else "stop=True, or higher limits",
        )


def _stopping_places(joint_path: JointPath, limits: MotionLimits, state: PathState) -> list[float]:
    """Places at which a motion might come to rest, from what the limits would allow on a straight joint path."""
    bound = limits.arrays(joint_path.robot.n)
    q1 = np.maximum(np.abs(joint_path(state.s, 1)), 1e-12)
    a, j = float((bound["acceleration"] / q1).min()), float((bound["jerk"] / q1).min())
    problem, answer = ruckig.InputParameter(1), ruckig.Trajectory(1)
    problem.control_interface = ruckig.ControlInterface.Velocity
    problem.current_velocity, problem.current_acceleration = [state.speed], [state.acceleration]
    problem.target_velocity, problem.max_acceleration, problem.max_jerk = [0.0], [max(a, 1e-9)], [max(j, 1e-9)]
    ruckig.Ruckig(1).calculate(problem, answer)
    distance = max(answer.at_time(answer.duration)[0][0], 1e-6 * joint_path.end)
    places = [state.s + distance * factor for factor in (1.02, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 6.0)]
    return [s for s in places if s < joint_path.end] + [joint_path.end]


def _solved(
    joint_path: JointPath, programme: _Programme, limits: MotionLimits, close: float, weight: float = 1.0
) -> Trajectory | None:
    """The motion whose exact extrema pass the limits by a share `close` at most, or by more where it is slowed anyhow."""
    problem = programme.problem
    K, n = problem.ds.size, problem.node.shape[1]
    z = programme.start if programme.moving else _inside(problem, programme.start, 0.9)
    mu, trajectory = weight * FIRST * UNITS / K, None
    for _ in range(PASSES if close else 2 * PASSES):
        if _optimum.solve(problem, z, mu, GAP * UNITS / (6.0 * n * K), MOST) < 0:
            return trajectory if close else None
        trajectory = _motion(joint_path, programme, z)
        if not _tighten(joint_path, programme, trajectory, limits, close):
            return trajectory
        if not programme.moving:
            z = _inside(problem, z, 0.98)
        mu = AGAIN * UNITS / K
    return trajectory if close else None


class _Programme(NamedTuple):
    """A nonlinear programme: its numbers, the places s (K + 1,), a start (K + 1, 4), and units of length and time."""

    problem: _optimum.Problem
    s: Array
    start: Array
    units: tuple[float, float]
    moving: bool


def _programme(
    joint_path: JointPath, limits: MotionLimits, intervals: int | None, state: PathState | None = None, end: float = 0.0,
    *, width: float = 1.0,
) -> _Programme | None:  # fmt: skip
    """The programme from rest to rest, or from a moving state to rest at `end`; None where that is too fast to stop."""
    bound = limits.arrays(joint_path.robot.n)
    begin, first, end = (0.0, 0.0, joint_path.end) if state is None else (state.s, state.speed, end)
    s = np.linspace(begin, end, 2 * max(100, joint_path.knots.size) + 1)
    x, t = np.empty(s.size), np.empty(s.size)
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    peak, acceleration, ramp = _ramps(joint_path, bound, q1, s)
    with np.errstate(divide="ignore"):
        speed = np.fmin(speed_bound(joint_path, limits, s), (peak / np.abs(q1)).min(axis=1))
    if not _reach.fastest(s, q1, q2, speed, acceleration, first * first, 0.0, x):
        return None
    _reach.in_time(s, x, t)
    width *= max(ramp, 1e-4 * float(t[-1]))
    v, since = np.sqrt(x), 0.0
    if first > 0.0:  # the filter looks back on a motion that came in at its speed
        t, s, v = np.append(0.0, t + width), np.append(begin - first * width, s), np.append(first, v)
        since = _when(t, s, v, width, begin)
    count = intervals or min(INTERVALS + 4 * (joint_path.path.breaks.size - 2), 1000)
    when = _spread(t, s, v, width, since, count)
    at, v, a = _filtered(t, s, v, width, when)
    at[0], at[-1] = begin, end
    v[-1] = a[-1] = 0.0
    v[0], a[0] = (0.0, 0.0) if state is None else (state.speed, state.acceleration)
    units = (end - begin) / UNITS, (when[-1] - when[0]) / UNITS
    return _numbers(joint_path, limits, at, v, a, np.diff(when), units, state is not None)


def _spread(t: Array, s: Array, v: Array, width: float, since: float, count: int) -> Array:
    """Times (count + 1,) of the filtered motion, half of them spread evenly, half where its acceleration changes."""
    end = float(t[-1]) + width
    fine = np.unique(np.concatenate([t, t + width, np.linspace(since, end, 401)]))
    fine = fine[(fine >= since) & (fine <= end)]
    fine[0], fine[-1] = since, end
    change = np.abs(np.diff(_filtered(t, s, v, width, fine)[2]))
    weight = np.diff(fine) / (end - since) + change / max(float(change.sum()), 1e-300)
    share = np.append(0.0, np.cumsum(weight))
    return np.asarray(np.interp(np.linspace(0.0, share[-1], count + 1), share, fine))


def _filtered(t: Array, s: Array, v: Array, width: float, when: Array) -> Array:
    """s, ṡ and s̈ (3, k) of a motion through a box filter, at times."""
    out = np.empty((3, when.size))
    _reach.filtered(t, s, v, width, when, out)
    return out


def _ramps(joint_path: JointPath, bound: dict[str, Array], q1: Array, s: Array) -> tuple[Array, Array, float]:
    """Velocities and accelerations (n,) that the joints can reach on the path at all, and the width of the filter [s].

    A joint that moves by D in all never gets beyond the velocities (A D)^½ and (J D²)^⅓ from rest to rest, and with a
    velocity V and a jerk J never beyond the acceleration (J V)^½; a little room is left.
    """
    V, A, J = (bound[field] for field in DERIVATIVES)
    D = np.sum(0.5 * (np.abs(q1[1:]) + np.abs(q1[:-1])) * np.diff(s)[:, None], axis=0)
    moving = 1e-6 * D.max() < D
    most = np.fmin(2.0 * np.sqrt(A * D), 2.0 * np.cbrt(J * D * D))
    peak = np.where(np.isinf(V) & moving, most, np.inf)
    if not np.isfinite(np.fmin(V, peak)[moving]).any():
        names = ", ".join(joint_path.robot.joint_names[i] for i in np.flatnonzero(moving))
        raise NoSolution("no limit bounds a joint that moves", s=0.0, advice=f"finite limits on one of {names}")
    least = np.fmin(A, np.sqrt(J * np.fmin(V, most)))
    with np.errstate(invalid="ignore"):
        ramps = np.where(np.isfinite(J) & moving, least / J, 0.0)
    return peak, least, 1.2 * float(ramps.max())


def _when(t: Array, s: Array, v: Array, width: float, place: float) -> float:
    """When the filtered motion passes a place."""
    low, high = 0.0, float(t[-1]) + width
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _filtered(t, s, v, width, np.array([middle]))[0, 0] < place else (low, middle)
    return high


def _numbers(
    joint_path: JointPath, limits: MotionLimits, s: Array, v: Array, a: Array, tau: Array, units: tuple[float, float],
    moving: bool,
) -> _Programme:  # fmt: skip
    bound = limits.arrays(joint_path.robot.n)
    A, J = bound["acceleration"], bound["jerk"]
    length, time = units
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    beside = 1e-9 * (s[-1] - s[0])  # q''' may jump at a node of the path: each interval has its own
    q3 = np.stack([joint_path(s[:-1] + beside, 3), joint_path(s[1:] - beside, 3)], axis=1)
    ends1, ends2 = np.stack([q1[:-1], q1[1:]], axis=1), np.stack([q2[:-1], q2[1:]], axis=1)
    v1, v2, v3 = length / time, length**2 / time**2, length**3 / time**3
    node = np.stack([q1 * (v1 / time / A), q2 * (v2 / A)], axis=-1)
    edge = np.stack([ends1 * (v1 / time**2 / J), ends2 * (3.0 * v2 / time / J), q3 * (v3 / J)], axis=-1)
    start = np.zeros((s.size, 4))
    start[:, 0], start[:, 1], start[:-1, 2] = v / v1, a * (time / v1), tau / time
    start[:-1, 3] = np.diff(start[:, 1]) / start[:-1, 2]
    top = np.minimum(speed_bound(joint_path, limits, s) / v1, 1e6)
    problem = _optimum.Problem(np.diff(s) / length, SHORTEST * tau / time, top, node, edge, np.zeros(2))
    return _Programme(problem, s, start, units, moving)


def _inside(problem: _optimum.Problem, z: Array, share: float) -> Array:
    """The motion z, so much slower that it uses at most a share of every limit."""
    K, n = problem.ds.size, problem.node.shape[1]
    g, c = np.zeros((K, 3)), np.zeros((K + 1, 3 * n))
    _optimum.values(problem, z, g, c)
    factor = max(
        1.0,
        float((z[1:-1, 0] / problem.top[1:-1]).max()) / share,
        np.sqrt(np.abs(c[:, :n]).max() / share),
        np.cbrt(np.abs(c[:, n:]).max() / share),
    )
    slower: Array = z / np.array([factor, factor**2, 1.0 / factor, factor**3])
    return slower


def _motion(joint_path: JointPath, programme: _Programme, z: Array) -> Trajectory:
    """Quintic Hermite in time through exact q, q̇, q̈ at the places."""
    length, time = programme.units
    s, v, a = programme.s, z[:, :1] * (length / time), z[:, 1:2] * (length / time**2)
    t = np.concatenate([[0.0], np.cumsum(z[:-1, 2] * time)])
    q, q1, q2 = (joint_path(s, order) for order in (0, 1, 2))
    return Trajectory(through(t, q, q1 * v, q1 * a + q2 * v * v))


def _tighten(
    joint_path: JointPath, programme: _Programme, trajectory: Trajectory, limits: MotionLimits, close: float
) -> bool:
    """Tighten limits of intervals whose exact extrema pass them; whether any had to be."""
    bound = limits.arrays(joint_path.robot.n)
    over = [trajectory.piece_worst(order) / bound[field] for order, field in enumerate(DERIVATIVES, start=1)]
    if max(float(o.max()) for o in over) <= 1.0 + close:
        return False
    spare = 0.0 if close else 1e-6  # where nothing is slowed afterwards
    speed, acceleration, jerk = (np.where(o > 1.0, o * (1.0 + spare), 1.0) for o in over)
    problem = programme.problem
    problem.node[:-1] *= acceleration[:, :, None]
    problem.node[1:] *= acceleration[:, :, None]
    problem.edge[...] *= jerk[:, None, :, None]
    slow = speed.max(axis=1)
    problem.top[:-1] /= slow
    problem.top[1:] /= slow
    return True


METHOD = Optimal
