"""Drake's TOPP-RA: the optimum of its grid, with constant acceleration in s between grid points, in a worker process."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.ik.base import Failed, NotInstalled
from benchmarks.peers.ik.drake import METHOD as DRAKE
from benchmarks.peers.ik.worker import WORKERS, Worker
from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.timing.base import refit
from planners.trajectory import Trajectory

MOST_DRAKES = 4
"""Number of worker processes of this peer, one for each set of limits: a block has few, and each holds Drake in memory."""


class DrakeToppra(TimingPeer):
    """``pydrake.multibody.optimization.Toppra`` on a cubic spline through the samples; Drake's environment, as for its IK."""

    distribution = "drake"
    package = "pydrake"
    settings = (
        "PiecewisePolynomial.CubicWithContinuousSecondDerivatives through the samples of the joint path, Toppra on 500 equal "
        "grid intervals, AddJointVelocityLimit, AddJointAccelerationLimit (interpolation scheme, its default); no jerk limits. "
        "On its own grid of 130 to 190 points (CalcGridPoints) a call takes a quarter of the time, and motions exceed their "
        "accelerations by up to 1.6 % instead of 0.2 %. In a worker process, whose times leave out the pipe"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration")

    def __init__(self, limits: dict[str, Array]) -> None:
        if why := self.missing():
            raise NotInstalled(why)
        self._jerk = limits["jerk"]
        self._worker = _worker(*(tuple(limits[name].tolist()) for name in self.enforced))

    @classmethod
    def missing(cls) -> str:
        """Return why the peer cannot run here; empty if it can."""
        return DRAKE.missing()

    @classmethod
    def version(cls) -> str | None:
        """Return the version of Drake in its environment."""
        return DRAKE.version()

    def call(self, joint_path: JointPath) -> Any:
        """Compute the spline through the samples and the optimum along it, in the worker process."""
        (answer,) = self._worker.solve([(joint_path.knots.tolist(), joint_path(joint_path.knots).tolist())])
        if isinstance(answer.raw, Failed):
            raise NoSolution(f"{answer.raw.outcome}: {answer.raw.error}")
        if answer.raw["t"] is None:
            raise NoSolution("Drake's Toppra found no motion from rest to rest")
        return answer.raw

    def took_ms(self, raw: Any) -> float | None:
        """Time of a call in the worker process."""
        return float(raw["ns"]) / 1e6

    def trajectory(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory of its s(t), which has a constant s̈ between grid points, along the joint path."""
        t, s, speed = (np.array(raw[name]) for name in ("t", "s", "speed"))
        pieces = np.stack([0.5 * np.diff(speed) / np.diff(t), speed[:-1], s[:-1]])
        return refit(joint_path, PPoly(pieces, t - t[0], extrapolate=True), self._jerk)


@lru_cache(MOST_DRAKES)
def _worker(velocity: tuple[float, ...], acceleration: tuple[float, ...]) -> Worker:
    """Return the worker process for some limits: importing Drake takes a second, and every motion requests a new peer."""
    limits = {"velocity": velocity, "acceleration": acceleration}
    return Worker(DRAKE.python(), WORKERS / "drake_toppra.py", {"limits": limits})


METHOD = DrakeToppra
