"""TOPP-RA as in its documentation: a spline through waypoints, and a spline in time through its result."""

from __future__ import annotations

import logging
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.trajectory import Trajectory


class ToppraSpline(TimingPeer):
    """``SplineInterpolator`` through the samples with velocity and acceleration limits, and ``ParametrizeSpline`` (default)."""

    distribution = "toppra"
    package = "toppra"
    settings = (
        "SplineInterpolator through the samples of the joint path, JointVelocityConstraint and "
        "JointAccelerationConstraint, TOPPRA on its automatic grid, ParametrizeSpline: all as in its documentation; "
        "no jerk limits"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")

    def __init__(self, limits: dict[str, Array]) -> None:
        import toppra

        logging.getLogger("toppra").setLevel(logging.CRITICAL)  # silences its own warnings
        self._toppra: Any = toppra
        self._constraints = [
            toppra.constraint.JointVelocityConstraint(_range(limits["velocity"])),
            toppra.constraint.JointAccelerationConstraint(_range(limits["acceleration"])),
        ]

    def call(self, joint_path: JointPath) -> Any:
        """Compute the spline through the samples, the optimum along it, and the spline in time."""
        path = self._toppra.SplineInterpolator(joint_path.knots, joint_path(joint_path.knots))
        found = self._toppra.algorithm.TOPPRA(
            self._constraints, path, parametrizer="ParametrizeSpline"
        ).compute_trajectory(0.0, 0.0)
        if found is None:
            raise NoSolution("TOPP-RA found no motion from rest to rest")
        return found

    def trajectory(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return TOPP-RA's cubic spline in time, unchanged."""
        return Trajectory(PPoly(raw.cspl.c, raw.cspl.x - raw.cspl.x[0], extrapolate=True))


def _range(limit: Array) -> Array:
    return np.stack([-limit, limit], axis=1)


METHOD = ToppraSpline
