"""TOPP-RA: the time-optimal motion along the path under velocity and acceleration limits; jerk is not limited."""

from __future__ import annotations

import logging
from typing import Any, ClassVar

import numpy as np
import toppra
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly
from toppra.interpolator import AbstractGeometricPath

from optik.check import check_count
from optik.errors import NoSolution
from planners.follow import JointPath
from planners.timing.base import MotionLimits, TimeLaw, refit
from planners.trajectory import Trajectory

Array = NDArray[np.float64]


class Toppra(TimeLaw):
    """Reachability analysis on a grid over s (Pham and Pham, IEEE T-RO 2018), constant s̈ between grid points.

    The limits are set at the grid points; between them they may be exceeded a little, and the acceleration jumps at
    every grid point. The certificate shows both exactly.

    Parameters
    ----------
    grid : int
        Number of intervals over s.
    """

    name: ClassVar[str] = "toppra"
    keeps: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")

    def __init__(self, *, grid: int = 200) -> None:
        check_count(grid, "grid", 10)
        self.grid = grid

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Time the joint path.

        Raises
        ------
        InvalidInput
            Velocity or acceleration limits are missing.
        NoSolution
            TOPP-RA finds no motion.
        """
        bound = self.need(limits, joint_path.robot)
        logging.getLogger("toppra").setLevel(logging.CRITICAL)  # it prints warnings of its own otherwise
        v, a = bound["velocity"], bound["acceleration"]
        s = np.linspace(0.0, joint_path.end, self.grid + 1)
        algorithm = toppra.algorithm.TOPPRA(
            [
                toppra.constraint.JointVelocityConstraint(np.stack([-v, v], axis=1)),
                toppra.constraint.JointAccelerationConstraint(np.stack([-a, a], axis=1)),
            ],
            _Geometry(joint_path),
            gridpoints=s,
        )
        _, speed, _ = algorithm.compute_parameterization(0.0, 0.0)
        if speed is None or not np.isfinite(speed).all():
            raise NoSolution("TOPP-RA found no motion from rest to rest", advice="higher limits, or a finer grid")
        return refit(joint_path, constant_acceleration(s, np.maximum(speed, 0.0)))


def constant_acceleration(s: Array, speed: Array) -> Any:
    """s(t) through grid points (k,) with speeds ṡ (k,): piecewise quadratic, its s̈ constant between them."""
    h = 2.0 * np.diff(s) / (speed[:-1] + speed[1:])
    t = np.concatenate([[0.0], np.cumsum(h)])
    return PPoly(np.stack([0.5 * np.diff(speed) / h, speed[:-1], s[:-1]]), t, extrapolate=True)


class _Geometry(AbstractGeometricPath):  # type: ignore[misc]
    """A joint path as TOPP-RA wants it."""

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
