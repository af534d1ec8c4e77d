"""TOPP-RA with ParametrizeConstAccel: the optimum of its grid, with constant acceleration in s between grid points."""

from __future__ import annotations

import logging
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.timing.base import refit
from planners.trajectory import Trajectory

TOPPRA_INTERVALS = 500
"""Number of grid intervals in s: with 100 a call takes a third of the time, and the motion is about as long."""


class ToppraConstAccel(TimingPeer):
    """``SplineInterpolator`` through the samples, velocity and acceleration limits, ``ParametrizeConstAccel``."""

    distribution = "toppra"
    package = "toppra"
    settings = (
        f"SplineInterpolator through the samples of the joint path, {TOPPRA_INTERVALS} equal grid intervals, "
        "JointVelocityConstraint, JointAccelerationConstraint (interpolation scheme), ParametrizeConstAccel; no jerk limits"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")

    def __init__(self, limits: dict[str, Array]) -> None:
        import toppra

        logging.getLogger("toppra").setLevel(logging.CRITICAL)  # silences its own warnings
        self._toppra: Any = toppra
        self._jerk = limits["jerk"]
        ranges = {field: np.stack([-limits[field], limits[field]], axis=1) for field in ("velocity", "acceleration")}
        kinds = toppra.constraint
        self._constraints = [kinds.JointVelocityConstraint(ranges["velocity"])]
        if np.isfinite(limits["acceleration"]).all():
            scheme = kinds.DiscretizationType.Interpolation
            self._constraints.append(
                kinds.JointAccelerationConstraint(ranges["acceleration"], discretization_scheme=scheme)
            )

    def call(self, joint_path: JointPath) -> Any:
        """Compute the spline through the samples and the optimum along it."""
        path = self._toppra.SplineInterpolator(joint_path.knots, joint_path(joint_path.knots))
        first, last = path.path_interval
        grid = np.linspace(float(first), float(last), TOPPRA_INTERVALS + 1)
        problem = self._toppra.algorithm.TOPPRA(
            self._all_constraints(joint_path), path, gridpoints=grid, parametrizer="ParametrizeConstAccel"
        )
        found = problem.compute_trajectory(0.0, 0.0)
        if found is None:
            raise NoSolution("TOPP-RA found no motion from rest to rest")
        return problem.problem_data

    def _all_constraints(self, joint_path: JointPath) -> list[Any]:
        """Return the constraints for a joint path: those that apply to every path."""
        return self._constraints

    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory of its s(t), which has a constant s̈ between grid points, along the joint path."""
        s, speed = np.asarray(raw.gridpoints), np.asarray(raw.sd_vec)
        steps = 2.0 * np.diff(s) / (speed[:-1] + speed[1:])
        pieces = np.stack([0.5 * np.diff(speed) / steps, speed[:-1], s[:-1]])
        return refit(joint_path, PPoly(pieces, np.r_[0.0, np.cumsum(steps)], extrapolate=True), self._jerk)


METHOD = ToppraConstAccel
