"""Drake's TOPP-RA: the optimum of its grid, with constant acceleration in s between grid points, in a worker process."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.laws.base import TimingPeer
from benchmarks.peers.worker import WorkerPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.timing.base import refit
from planners.trajectory import Trajectory


class DrakeToppra(WorkerPeer, TimingPeer):
    """``pydrake.multibody.optimization.Toppra`` on a cubic spline through the samples; Drake's environment, as for its IK."""

    environment = distribution = "drake"
    package = "pydrake"
    settings = (
        "PiecewisePolynomial.CubicWithContinuousSecondDerivatives through the samples of the joint path, Toppra on 500 equal "
        "grid intervals, AddJointVelocityLimit, AddJointAccelerationLimit (interpolation scheme, its default); no jerk limits. "
        "On its own grid of 130 to 190 points (CalcGridPoints) a call takes a quarter of the time, and motions exceed their "
        "accelerations by up to 1.6 % instead of 0.2 %. In a worker process, whose times leave out the pipe"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")

    def __init__(self, limits: dict[str, Array]) -> None:
        self._jerk = limits["jerk"]
        given = {name: limits[name].tolist() for name in self.enforced}
        self.worker = self.start("drake_toppra", {"limits": given}, keep=True)

    def plain(self, joint_path: JointPath) -> tuple[Any, ...]:
        """Return the path parameters of the samples, and the configurations there."""
        return joint_path.knots.tolist(), joint_path(joint_path.knots).tolist()

    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory of its s(t), which has a constant s̈ between grid points, along the joint path."""
        if raw is None:
            raise NoSolution("Drake's Toppra found no motion from rest to rest")
        t, s, speed = (np.array(raw[name]) for name in ("t", "s", "speed"))
        pieces = np.stack([0.5 * np.diff(speed) / np.diff(t), speed[:-1], s[:-1]])
        return refit(joint_path, PPoly(pieces, t - t[0], extrapolate=True), self._jerk)


METHOD = DrakeToppra
