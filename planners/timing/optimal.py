"""The time optimum under velocity, acceleration, jerk and tool-speed limits: a nonlinear programme on the path's s."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.check import check_count
from optik.errors import NoSolution
from planners.fit import fitted
from planners.follow import JointPath
from planners.hermite import through
from planners.timing import _optimum, _reach
from planners.timing.base import ALL_LIMITS, DERIVATIVES, MotionLimits, TimeLaw, speed_bound
from planners.trajectory import Trajectory

Array = NDArray[np.float64]

UNITS = 64.0
"""The programme counts time and s in 64ths of the motion, so that its numbers are near 1."""
GAP = 1e-5
"""How far from the optimum of the programme its answer may be, as a share of the duration."""
PASSES = 4
"""How often limits are tightened where the exact extrema pass them; what is left is a uniform slow-down."""
CLOSE = 1e-4
"""What may be left to the slow-down: a share of the limits."""


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
        programme = _programme(joint_path, limits, self.intervals)
        z = _inside(programme, programme.start, 0.9)
        mu = 6.4 / programme.ds.size
        for _ in range(PASSES):
            if not _solve(programme, z, mu):
                raise NoSolution(
                    "the interior-point iteration found no motion", advice="another number of intervals, or another law"
                )
            trajectory = _motion(joint_path, programme, z)
            if not _tighten(joint_path, programme, trajectory, limits):
                break
            z = _inside(programme, z, 0.98)
            mu = 0.1 / programme.ds.size
        return fitted(joint_path.robot, trajectory, limits, self.keeps)


class _Programme(NamedTuple):
    """The numbers of the nonlinear programme; see `planners.timing._optimum`."""

    s: Array
    ds: Array
    top: Array
    node: Array
    edge: Array
    start: Array
    units: tuple[float, float]


def _programme(joint_path: JointPath, limits: MotionLimits, intervals: int | None) -> _Programme:
    bound = limits.arrays(joint_path.robot.n)
    end = joint_path.end
    s = np.linspace(0.0, end, 2 * max(100, joint_path.knots.size) + 1)
    x, t = np.empty(s.size), np.empty(s.size)
    speed = speed_bound(joint_path, limits, s)
    _reach.fastest(s, joint_path(s, 1), joint_path(s, 2), speed, bound["acceleration"], 0.0, 0.0, x)
    _reach.in_time(s, x, t)
    with np.errstate(invalid="ignore"):
        ramps = bound["acceleration"] / bound["jerk"]
    width = 1.2 * float(ramps[np.isfinite(ramps)].max(initial=1e-3 * t[-1]))
    duration = float(t[-1]) + width
    count = intervals or int(np.clip(round(14.0 * duration / width), 160, 2000))
    smooth = np.empty((3, count + 1))
    _reach.filtered(t, s, np.sqrt(x), width, np.linspace(0.0, duration, count + 1), smooth)
    at, v, a = smooth
    at[0], at[-1] = 0.0, end
    v[0] = v[-1] = a[0] = a[-1] = 0.0
    units = end / UNITS, duration / UNITS
    return _numbers(joint_path, limits, at, v, a, np.full(count, duration / count), units)


def _numbers(
    joint_path: JointPath, limits: MotionLimits, s: Array, v: Array, a: Array, tau: Array, units: tuple[float, float]
) -> _Programme:
    bound = limits.arrays(joint_path.robot.n)
    A, J = bound["acceleration"], bound["jerk"]
    length, time = units
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    beside = 1e-9 * joint_path.end  # q''' may jump at a node of the path: each interval has its own
    q3 = np.stack([joint_path(s[:-1] + beside, 3), joint_path(s[1:] - beside, 3)], axis=1)
    ends1, ends2 = np.stack([q1[:-1], q1[1:]], axis=1), np.stack([q2[:-1], q2[1:]], axis=1)
    v1, v2, v3 = length / time, length**2 / time**2, length**3 / time**3
    node = np.stack([q1 * (v1 / time / A), q2 * (v2 / A)], axis=-1)
    edge = np.stack([ends1 * (v1 / time**2 / J), ends2 * (3.0 * v2 / time / J), q3 * (v3 / J)], axis=-1)
    start = np.zeros((s.size, 4))
    start[:, 0], start[:, 1], start[:-1, 2] = v / v1, a * (time / v1), tau / time
    start[:-1, 3] = np.diff(start[:, 1]) / start[:-1, 2]
    top = np.minimum(speed_bound(joint_path, limits, s) / v1, 1e6)
    return _Programme(s, np.diff(s) / length, top, node, edge, start, units)


def _inside(programme: _Programme, z: Array, share: float) -> Array:
    """The motion z, so much slower that it uses at most a share of every limit."""
    K, n = programme.ds.size, programme.node.shape[1]
    g, c = np.zeros((K, 3)), np.zeros((K + 1, 3 * n))
    _optimum.values(z, programme.ds, programme.node, programme.edge, g, c)
    factor = max(
        1.0,
        float((z[1:-1, 0] / programme.top[1:-1]).max()) / share,
        np.sqrt(np.abs(c[:, :n]).max() / share),
        np.cbrt(np.abs(c[:, n:]).max() / share),
    )
    slower: Array = z / np.array([factor, factor**2, 1.0 / factor, factor**3])
    return slower


def _solve(programme: _Programme, z: Array, mu: float) -> bool:
    K, n = programme.ds.size, programme.node.shape[1]
    least = GAP * UNITS / (6.0 * n * K)
    taken: int = _optimum.solve(
        z, np.zeros(2), programme.ds, programme.top, programme.node, programme.edge, mu, least, 100
    )
    return taken > 0


def _motion(joint_path: JointPath, programme: _Programme, z: Array) -> Trajectory:
    """Quintic Hermite in time through exact q, q̇, q̈ at the places."""
    length, time = programme.units
    s, v, a = programme.s, z[:, :1] * (length / time), z[:, 1:2] * (length / time**2)
    t = np.concatenate([[0.0], np.cumsum(z[:-1, 2] * time)])
    q, q1, q2 = (joint_path(s, order) for order in (0, 1, 2))
    return Trajectory(through(t, q, q1 * v, q1 * a + q2 * v * v))


def _tighten(joint_path: JointPath, programme: _Programme, trajectory: Trajectory, limits: MotionLimits) -> bool:
    """Tighten limits of intervals whose exact extrema pass them; whether any had to be."""
    bound = limits.arrays(joint_path.robot.n)
    over = [trajectory.piece_worst(order) / bound[field] for order, field in enumerate(DERIVATIVES, start=1)]
    if max(float(o.max()) for o in over) <= 1.0 + CLOSE:
        return False
    speed, acceleration, jerk = (np.maximum(o, 1.0) for o in over)
    joints = np.maximum(acceleration, 1.0)
    programme.node[:-1] *= joints[:, :, None]
    programme.node[1:] *= joints[:, :, None]
    programme.edge[...] *= jerk[:, None, :, None]
    slow = speed.max(axis=1)
    programme.top[:-1] /= slow
    programme.top[1:] /= slow
    return True


METHOD = Optimal
