"""The relative pose of two tools that hold one workpiece: proved bounds over a motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners.certificate.bounds import Instants, MotionBounds
from planners.certificate.path_error import ERROR_FLOOR, ERROR_ROUNDING, PathErrors, PieceBounds, compare_with_path
from planners.certificate.projection import PathPositions
from planners.trajectory import Trajectory


class HeldPose(NamedTuple):
    """Proved bounds on the distance [m] and the angle [rad] between two tools that carry a workpiece, and the largest found.

    `distance_per_ms` and `angle_per_ms` bound what a millisecond between the clocks of both controllers adds.
    """

    distance: float
    angle: float
    found_distance: float
    found_angle: float
    distance_per_ms: float
    angle_per_ms: float

    def __str__(self) -> str:
        rest = f"at most {1e3 * self.distance:.3g} mm and {self.angle:.3g} rad between the tools"
        return f"{rest}; {1e3 * self.distance_per_ms:.3g} mm and {self.angle_per_ms:.3g} rad more per ms between the clocks"


class _IdentityPath:
    """The reference path of a relative pose: the identity at every instant, onto which nothing has to be projected."""

    asked = "pose"

    def places(self, instants: Instants, guess: Array) -> PathPositions:
        """Return the pose at instants."""
        k = instants.t.size
        return PathPositions(
            np.zeros(k), np.zeros(k), np.tile(np.eye(4), (k, 1, 1)), np.zeros((k, 6)), np.empty((k, 0, 0))
        )


def prove_held(chain: Robot, trajectory: Trajectory, speeds: Array) -> HeldPose:
    """Return bounds on the relative pose error of two tools, and on its growth with the offset of two clocks.

    The pose of the chain's tool should be the identity. speeds: bounds (2,) on the speed of either tool [m/s, rad/s].
    """
    still: Any
    bounds, still = MotionBounds(chain, trajectory), _IdentityPath()
    at, off = compare_with_path(bounds.ends, still.places(bounds.ends, np.empty(0)), "pose")
    path = PieceBounds(np.array([0.0, 1.0]), np.zeros((1, 2, 4)))
    errors = PathErrors(bounds, path, 1.0, still, np.full(2, ERROR_FLOOR), None)
    proved = errors.bound(np.arange(trajectory.knots.size - 1), at, off) + ERROR_ROUNDING
    return HeldPose(*proved.tolist(), *errors.found.tolist(), *(1e-3 * speeds).tolist())
