"""TOPP-RA: the time-optimal motion along the path under velocity, acceleration and torque limits; jerk is not limited."""

from __future__ import annotations

import logging
from typing import Any, ClassVar

import numpy as np
import toppra
from numpy.typing import ArrayLike
from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
from toppra.interpolator import AbstractGeometricPath

from optik.check import check_count
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import TOOL_SPEEDS, MotionLimits, PathPoints, kind_of, sides
from planners.timing.base import TimeLaw, refit, speed_bound
from planners.timing.smooth import least_duration
from planners.trajectory import Trajectory
from planners.trajectory.curve import constant_acceleration

GRID_EXCESS = 1e-5
"""Excess of a limit between grid points above which the grid is refined there."""
REFINEMENTS = 5
"""Most refinements of a grid."""
GRID_APART = 1e-5
"""Least distance of grid points over the path's length: nearer ones make TOPP-RA's steps ill-conditioned."""
BRIEFEST_PIECE = 2e-5
"""Least mean time [s] between grid points: in shorter pieces rounding in q dominates the accelerations."""
GRIDS = (1.0, 2.37, 0.53, 5.11)
"""Numbers of intervals, relative to the requested one, that are tried in turn if TOPP-RA finds no motion."""
VISCOUS_ROUNDS, SAME_SPEEDS, SLOWER_TANGENT = 10, 1e-3, 0.7
"""Largest number of linearisations of viscous friction; the change of ṡ, as a fraction of the greatest, at
which they end; and the factor on the speeds if there is no solution around them."""
SLOWEST_TANGENT = 0.02
"""Fraction of the greatest ṡ below which √x is not linearised: its slope grows without bound."""
UNBOUNDED = 1e12
"""Bound on the acceleration of a free joint [rad/s², m/s²]: an infinite one makes NaN of TOPP-RA's arithmetic."""


class Toppra(TimeLaw):
    """Reachability analysis on a grid over s (Pham and Pham, IEEE T-RO 2018), constant s̈ between grid points.

    Limits on velocities, of the joints and of the tool, are bounds on ṡ² at the grid points. Torques are linear in s̈ and
    ṡ², but for viscous friction, which goes with ṡ: it is linearised around the speeds of the solution before, and the
    problem solved again until they stay. Between grid points limits may be exceeded a little: the grid is refined where that
    happens, and a plan slows the motion by what remains. The acceleration jumps at every grid point.

    Parameters
    ----------
    grid : int
        Number of intervals over s to begin with.

    Attributes
    ----------
    retries : int
        Number of grids without a solution before the one that gave the last run's motion.
    """

    name: ClassVar[str] = "toppra"
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration", *TOOL_SPEEDS, "torque")
    counts_torque: ClassVar[bool] = True

    def __init__(self, *, grid: int = 200) -> None:
        check_count(grid, "grid", 10)
        self.grid = grid
        self.retries = 0

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        bounded = limits.select(tuple(kind.name for kind in limits.kinds if kind.order <= 2))
        most = least_duration(joint_path, bounded) / BRIEFEST_PIECE
        sizes = [max(10, round(min(self.grid * factor, most * factor))) for factor in GRIDS]
        for self.retries, size in enumerate(sizes):
            s = _grid(joint_path, size)
            speed = _solve_with_friction(joint_path, bounded, s)
            if speed is not None:
                return refit(joint_path, constant_acceleration(*_refine(joint_path, bounded, s, speed)))
        raise NoSolution(
            f"TOPP-RA found no motion from rest to rest on grids of {', '.join(map(str, sizes))} intervals",
            s=0.0, advice="another grid=, or the law 'ruckig' or 'smooth'",
        )  # fmt: skip


def _grid(joint_path: JointPath, intervals: int) -> Array:
    """Return an equally spaced grid with the path's breaks, without points that nearly coincide."""
    end = joint_path.end
    s = np.union1d(np.linspace(0.0, end, intervals + 1), joint_path.path.breaks[1:-1])
    s = s[(s > GRID_APART * end) & (s < (1.0 - GRID_APART) * end)]
    s = s[np.diff(s, prepend=0.0) > GRID_APART * end]
    return np.concatenate([[0.0], s, [end]])


def _solve_with_friction(joint_path: JointPath, limits: MotionLimits, s: Array) -> Array | None:
    """Return ṡ at the grid points, with viscous friction linearised repeatedly; None if there is no motion."""
    speed = _solve(joint_path, limits, s)
    viscous = limits.torque is not None and any(load.viscous.any() for load in joint_path.robot.loads)
    if not viscous and not _second_order(limits):
        return speed
    around = speed
    for _ in range(VISCOUS_ROUNDS):
        after = None if around is None else _solve(joint_path, limits, s, around)
        if around is None:
            break
        if after is None:  # at far too high speeds friction alone exceeds a limit
            around = SLOWER_TANGENT * around
            continue
        change, speed, around = float(np.abs(after - around).max()), after, after
        if change <= SAME_SPEEDS * after.max():
            break
    return speed


def _solve(joint_path: JointPath, limits: MotionLimits, s: Array, around: Array | None = None) -> Array | None:
    """Return ṡ at the grid points, with viscous friction linearised around given ṡ; None if TOPP-RA finds no motion."""
    logging.getLogger("toppra").setLevel(logging.CRITICAL)  # it prints warnings of its own otherwise
    acceleration = np.stack(sides(limits.bounds(joint_path.robot.n)["acceleration"]), axis=1)
    constraints = [
        _Speed(speed_bound(joint_path, limits, s)),
        toppra.constraint.JointAccelerationConstraint(np.clip(acceleration, -UNBOUNDED, UNBOUNDED)),
    ]
    names = ["torque"] * (limits.torque is not None) + _second_order(limits)
    constraints += [_Torque(limits.rows(name, PathPoints(joint_path, s)), around) for name in names]
    try:
        with np.errstate(all="ignore"):
            algorithm = toppra.algorithm.TOPPRA(constraints, _Geometry(joint_path), gridpoints=s)
            _, speed, _ = algorithm.compute_parameterization(0.0, 0.0)
    except (ValueError, RuntimeError, ArithmeticError, AssertionError, IndexError):  # as it fails on rare grids
        return None
    if speed is None or not np.isfinite(speed).all():
        return None
    speed = np.maximum(speed, 0.0)
    return None if (speed[:-1] + speed[1:] <= 0.0).any() else speed


def _second_order(limits: MotionLimits) -> list[str]:
    """Return the names of the further limits of second order."""
    return [name for name in limits.extra or () if kind_of(name).order == 2]


def _refine(joint_path: JointPath, limits: MotionLimits, s: Array, speed: Array) -> tuple[Array, Array]:
    """Bisect the intervals that exceed a limit; return the last grid and speeds that TOPP-RA solved."""
    for _ in range(REFINEMENTS):
        wrong = (_peak_ratios(joint_path, limits, s, speed) > 1.0 + GRID_EXCESS) & (
            np.diff(s) > 2.0 * GRID_APART * s[-1]
        )
        if not wrong.any():
            break
        wrong |= np.roll(wrong, 1) | np.roll(wrong, -1)  # its neighbours decide what happens at its ends
        finer = np.sort(np.concatenate([s, (0.5 * (s[:-1] + s[1:]))[wrong & (np.diff(s) > 2.0 * GRID_APART * s[-1])]]))
        found = _solve(joint_path, limits, finer, np.interp(finer, s, speed))
        if found is None:
            break
        s, speed = finer, found
    return s, speed


def _peak_ratios(joint_path: JointPath, limits: MotionLimits, s: Array, speed: Array) -> Array:
    """Return the largest ratio to a limit within each interval, at three points: ṡ² is linear in s for constant s̈."""
    u = np.array([0.25, 0.5, 0.75])
    at = (s[:-1, None] + np.diff(s)[:, None] * u).ravel()
    square = (speed[:-1, None] ** 2 + np.diff(speed**2)[:, None] * u).ravel()
    acceleration = np.repeat(0.5 * np.diff(speed**2) / np.diff(s), u.size)
    rates = np.sqrt(square), acceleration
    points = PathPoints(joint_path, at)
    names = ("acceleration", "torque", *_second_order(limits))
    asked = [limits.ratios(name, points, rates).max(axis=1) for name in names]
    ratio = np.maximum(np.maximum.reduce(asked), rates[0] / speed_bound(joint_path, limits, at))
    return np.asarray(ratio.reshape(-1, u.size).max(axis=1))


class _Speed(toppra.constraint.LinearConstraint):  # type: ignore[misc]
    """ṡ² ≤ bound² at the grid points, in double precision (TOPP-RA's own velocity limits are computed in single)."""

    def __init__(self, bound: Array) -> None:
        super().__init__()
        self._bound = np.stack([np.zeros(bound.size), np.minimum(bound, 1e9) ** 2], axis=1)

    def compute_constraint_params(self, path: Any, gridpoints: Array, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        return None, None, None, None, None, None, self._bound


class _Torque(toppra.constraint.LinearConstraint):  # type: ignore[misc]
    """|a s̈ + b ṡ² + f ṡ + c| ≤ 1 at the grid points, and with the s̈ before each of them.

    With x = ṡ², f ṡ is f √x, whose tangent at the given speeds takes its place. At rest it is exactly 0.
    """

    def __init__(self, rows: Array, around: Array | None) -> None:
        super().__init__()
        self.identical = True
        a, b, f, c = (rows[..., i] if i < rows.shape[2] else 0.0 * rows[..., 0] for i in range(4))
        if around is not None:
            v = np.maximum(around, SLOWEST_TANGENT * around.max())[:, None]
            f = np.where((around > 0.0)[:, None], f, 0.0)
            b, c = b + 0.5 * f / v, c + 0.5 * f * v
        self._rows = a, b, c

    def compute_constraint_params(self, path: Any, gridpoints: Array, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        count = self._rows[0].shape[1]
        both = np.vstack([np.eye(count), -np.eye(count)])
        rows = (*self._rows, both, np.ones(2 * count))
        return canlinear_colloc_to_interpolate(*rows, None, None, gridpoints, identical=True)  # type: ignore[no-any-return]


class _Geometry(AbstractGeometricPath):  # type: ignore[misc]
    """A joint path with TOPP-RA's interface."""

    def __init__(self, joint_path: JointPath) -> None:
        self._joint_path = joint_path

    def __call__(self, path_positions: ArrayLike, order: int = 0) -> Array:
        return self._joint_path(path_positions, order)

    @property
    def dof(self) -> int:
        return self._joint_path.robot.n

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self._joint_path.end])

    @property
    def waypoints(self) -> tuple[Array, Array]:
        return self._joint_path.knots, self._joint_path.q


METHOD = Toppra
