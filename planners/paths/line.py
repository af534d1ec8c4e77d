"""The straight line with the shortest rotation, both at constant rate (eq. 14, corrected)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.robot import Robot
from optik.types import Array
from planners.paths.base import Path, fields
from planners.paths.poses import NO_LENGTH, angle_about, make_poses, rotations_along, shortest_turn


class Line(Path):
    """Straight line from one pose to another; s is the distance [m], or the angle [rad] where the tool only turns.

    The paper's eq. 14 without its misprints: T(s) = [exp(s ω) R₀, P₀ + s v; 0 1]. The rotation
    is the shortest one, about a fixed axis; the paper's own line keeps its orientation. Equal poses make a line of
    length 0, which no motion follows.

    Parameters
    ----------
    start, goal : (4, 4) array
        T_base_tool at both ends; their rotations are replaced by the nearest orthonormal ones.

    Raises
    ------
    InvalidInput
        An argument that is not a pose, or a turn within 1e-6 rad of 180°, whose direction is not determined.
    """

    name: ClassVar[str] = "line"

    def __init__(self, start: ArrayLike, goal: ArrayLike) -> None:
        self.start = se3.nearest_pose(se3.check_pose(start, "start")).copy()
        self.goal = se3.nearest_pose(se3.check_pose(goal, "goal")).copy()
        e = np.concatenate([self.goal[:3, 3] - self.start[:3, 3], shortest_turn(self.start, self.goal, "goal")])
        chord, angle = float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))
        # where a turn is much larger than the chord, s in metres would be dominated by round-off
        self.turns_only = chord <= NO_LENGTH or (chord <= 1e-6 and angle > chord)
        self.unit = "rad" if self.turns_only else "m"
        length = angle if self.turns_only else chord
        self._end = length if length > NO_LENGTH else 0.0
        self._twist: Array = e / self._end if self._end else np.zeros(6)

    @property
    def end(self) -> float:
        """Length [m, or rad for a pure rotation]; 0 if the poses are equal."""
        return self._end

    def _evaluate(self, x: Array, order: int) -> Array:
        if order == 0:
            R = rotations_along(self.start[:3, :3], self._twist[3:], x)
            return make_poses(R, self.start[:3, 3] + x[:, None] * self._twist[:3])
        if order == 1:
            return np.tile(self._twist, (x.size, 1))
        return np.zeros((x.size, 6))  # v and ω are constant in the base frame

    def _nearest(self, poses: Array) -> Array:
        """Return s nearest by position, or by rotation if the tool only turns, in closed form."""
        # from the middle, all angles are below a half turn, at which they change sign
        middle = 0.5 * self._end
        T = self.pose(middle)
        if self.turns_only:
            axis = self._twist[3:] / np.linalg.norm(self._twist[3:])
            offset = angle_about(axis, poses[:, :3, :3] @ T[:3, :3].T) / np.linalg.norm(self._twist[3:])
        else:
            v = self._twist[:3]
            offset = (poses[:, :3, 3] - T[:3, 3]) @ v / (v @ v)
        return np.clip(middle + offset, 0.0, self._end)

    def derivative_bounds(self) -> Array:
        """Return bounds (2, 4) on the derivatives of position and rotation: constant velocity, constant turning."""
        speed, turning = np.linalg.norm(self._twist[:3]), np.linalg.norm(self._twist[3:])
        return np.array([[speed, 0.0, 0.0, 0.0], turning ** np.arange(1, 5)])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files."""
        return {"path": self.name, "start": self.start.tolist(), "goal": self.goal.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the line that `to_dict` wrote."""
        return cls(*fields(data, cls.name, "start", "goal"))


METHOD = Line
