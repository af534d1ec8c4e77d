"""TOPP-RA as in its documentation: a spline through waypoints, and a spline in time through its result."""

from __future__ import annotations

from typing import Any

from scipy.interpolate import PPoly

from benchmarks.peers.laws.toppra_const_accel import ToppraConstAccel
from optik.errors import NoSolution
from planners.following.follow import JointPath
from planners.trajectory import Trajectory


class ToppraSpline(ToppraConstAccel):
    """``SplineInterpolator`` through the samples, the limits of `ToppraConstAccel`, and ``ParametrizeSpline`` (default)."""

    settings = (
        "SplineInterpolator through the samples of the joint path, JointVelocityConstraint and "
        "JointAccelerationConstraint, TOPPRA on its automatic grid, ParametrizeSpline: all as in its documentation; "
        "no jerk limits"
    )

    def call(self, joint_path: JointPath) -> Any:
        """Compute the spline through the samples, the optimum along it, and the spline in time."""
        path = self._toppra.SplineInterpolator(joint_path.knots, joint_path(joint_path.knots))
        found = self._toppra.algorithm.TOPPRA(
            self._constraints, path, parametrizer="ParametrizeSpline"
        ).compute_trajectory(0.0, 0.0)
        if found is None:
            raise NoSolution("TOPP-RA found no motion from rest to rest")
        return found

    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return TOPP-RA's cubic spline in time, unchanged."""
        return Trajectory(PPoly(raw.cspl.c, raw.cspl.x - raw.cspl.x[0], extrapolate=True))


METHOD = ToppraSpline
