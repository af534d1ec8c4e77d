"""The circular arc through three points or about an axis, with rotation at constant rate."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, pi
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.paths.base import Path, fields
from planners.paths.poses import TURN_WEIGHT, make_poses, rotations_along, shortest_turn
from planners.paths.waypoints import check_rotation

SAME_POINT = 1e-9
"""Points nearer to each other than this [m] count as equal and give no direction."""
DEGENERATE = 1e-6
"""Sides shorter than this fraction of the longest, and angles below this [rad], are measurement noise."""
MOST_TURNS = 10
"""Largest angle of an arc, in turns: a larger one was probably given in degrees."""


class Circle(NamedTuple):
    """An arc of a circle from its start: unit vectors (3,) along it and to its centre, radius [m], angle [rad] > 0."""

    along: Array
    inward: Array
    radius: float
    angle: float


class Arc(Path):
    """Part of a circle, built by `through` or `about`; s is the length of the arc [m].

    p(s) = p₀ + r sin(s/r) t + 2 r sin²(s/2r) m with t along the arc and m to the centre at the start: exact for large
    radii too, where p = centre + … would cancel. R(s) = exp(s ω) R₀ with constant ω in the base frame.

    Attributes
    ----------
    start : (4, 4) array
        T_base_tool at s = 0.
    circle : Circle
        Its shape.
    """

    name: ClassVar[str] = "arc"

    def __init__(self, start: Array, circle: Circle, turn: Array, source: dict[str, Any]) -> None:
        self.start, self.circle, self._source = start, circle, source
        self._w: Array = turn / self.end

    @classmethod
    def through(cls, start: ArrayLike, via: ArrayLike, goal: ArrayLike) -> Self:
        """Return the arc from start to goal through a point; the rotation is the shortest one from start to goal.

        Parameters
        ----------
        start, goal : (4, 4) array
            T_base_tool at both ends [m].
        via : (3,) or (4, 4) array
            A point [m] on the arc; of a pose, only the position counts.

        Returns
        -------
        Arc
            The arc.

        Raises
        ------
        InvalidInput
            An invalid pose or point, two equal points, three points on a straight line, or a half turn.
        """
        first, last = (se3.nearest_pose(se3.check_pose(T, n)).copy() for T, n in ((start, "start"), (goal, "goal")))
        array = real_array(via, "via", "a point [m]")
        point = se3.check_pose(via, "via")[:3, 3] if array.shape == (4, 4) else _vector(array, "via", "a point [m]")
        circle = _circle_through(first[:3, 3], point, last[:3, 3])
        data = {"start": first.tolist(), "via": point.tolist(), "goal": last.tolist()}
        return cls(first, circle, shortest_turn(first, last, "goal"), data)

    @classmethod
    def about(
        cls, start: ArrayLike, centre: ArrayLike, axis: ArrayLike, angle: float, *, orientation: ArrayLike = "fixed"
    ) -> Self:
        """Return the arc from start about an axis, by an angle that may be several turns.

        Parameters
        ----------
        start : (4, 4) array
            T_base_tool at s = 0 [m].
        centre : (3,) array
            A point [m] on the axis.
        axis : (3,) array
            Direction of the axis, of any length [1]; the arc turns about it by the right hand.
        angle : float
            Angle [rad], negative for the other direction, at most 10 turns.
        orientation : str or (3, 3) array
            ``"fixed"``: the tool keeps its orientation. ``"arc"``: it turns with the arc, as if held by the axis. A
            rotation matrix [1]: that of the goal, reached by the shortest rotation from the start's.

        Returns
        -------
        Arc
            The arc.

        Raises
        ------
        InvalidInput
            An invalid pose, point or direction, a start on the axis, an angle of 0 or above 10 turns, a half turn to the
            goal's orientation.
        """
        first = se3.nearest_pose(se3.check_pose(start, "start")).copy()
        point, direction = _vector(centre, "centre", "a point [m]"), _vector(axis, "axis", "a direction")
        size = float(np.abs(direction).max())
        if not size > 0.0:
            raise InvalidInput("axis", "a vector of length 0", "a direction")
        check_number(angle, "angle", "a finite angle")
        if not 0.0 < abs(angle) <= 2.0 * pi * MOST_TURNS:
            raise InvalidInput("angle", angle, f"an angle other than 0, of at most {MOST_TURNS} turns", unit="rad")
        unit = direction / size
        unit /= np.copysign(np.linalg.norm(unit), angle)
        outward = first[:3, 3] - point
        outward = outward - (outward @ unit) * unit
        radius = float(np.linalg.norm(outward))
        if radius <= SAME_POINT:
            expected = "a start off the axis: a Line turns on the spot"
            raise InvalidInput("start", f"{radius:.3g} m from the axis", expected)
        inward = -outward / radius
        circle = Circle(np.cross(inward, unit), inward, radius, abs(float(angle)))
        turn, kept = _check_orientation(first, orientation, circle.angle * unit)
        data = {"start": first.tolist(), "centre": point.tolist(), "axis": direction.tolist(), "angle": float(angle)}
        return cls(first, circle, turn, data | {"orientation": kept})

    @property
    def end(self) -> float:
        """Length of the arc [m]."""
        return self.circle.radius * self.circle.angle

    def _evaluate(self, x: Array, order: int) -> Array:
        along, inward, r, _ = self.circle
        turn = (x / r)[:, None]
        if order == 0:
            p = self.start[:3, 3] + (r * np.sin(turn)) * along + (2.0 * r * np.sin(0.5 * turn) ** 2) * inward
            return make_poses(rotations_along(self.start[:3, :3], self._w, x), p)
        out = np.zeros((x.size, 6))
        if order == 1:
            out[:, 3:] = self._w
            out[:, :3] = np.cos(turn) * along + np.sin(turn) * inward
        elif order == 2:
            out[:, :3] = (np.cos(turn) * inward - np.sin(turn) * along) / r
        else:
            out[:, :3] = (np.cos(turn) * along + np.sin(turn) * inward) / -(r * r)
        return out

    def _nearest(self, poses: Array) -> Array:
        """Return s nearest by position, in closed form; among equally near ones that of the nearest rotation, or the first."""
        along, inward, r, angle = self.circle
        offset = poses[:, :3, 3] - self.start[:3, 3]
        a, b = offset @ along, offset @ inward
        first = np.arctan2(a, r - b) % (2.0 * pi)
        first[first > 2.0 * pi - 1e-12] = 0.0
        turns = first + 2.0 * pi * np.arange(ceil(angle / (2.0 * pi)))[:, None]
        theta = np.concatenate([np.minimum(turns, angle), np.tile([[0.0], [angle]], len(poses))])
        # half the squared distance, without the terms that do not depend on s
        cost = 2.0 * r * np.sin(0.5 * theta) ** 2 * (r - b) - r * np.sin(theta) * a
        if self._w.any():
            R = rotations_along(self.start[:3, :3], self._w, r * theta.ravel()).reshape(*theta.shape, 3, 3)
            cost -= 0.5 * TURN_WEIGHT**2 * np.einsum("tkij,kij->tk", R, poses[:, :3, :3])
        cost[: len(turns)][turns > angle] = np.inf
        # the ends come last, so that rounding in the cost does not move an s near an end onto it
        rounding = 1e-14 * ((r * min(angle, 2.0)) ** 2 + np.einsum("ki,ki->k", offset, offset))
        chosen = np.argmax(cost <= cost.min(axis=0) + rounding, axis=0)
        return np.asarray(r * theta[chosen, np.arange(len(poses))])

    def derivative_bounds(self) -> Array:
        """Return bounds (2, 4) on the derivatives of position and rotation: curvature 1/r, constant turning."""
        k = np.arange(1, 5)
        return np.array([self.circle.radius ** (1.0 - k), np.linalg.norm(self._w) ** k])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files: the arguments that the arc was built from."""
        return {"path": self.name} | self._source

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the arc that `to_dict` wrote."""
        if isinstance(data, Mapping) and "via" in data:
            return cls.through(*fields(data, cls.name, "start", "via", "goal"))
        *given, orientation = fields(data, cls.name, "start", "centre", "axis", "angle", "orientation")
        return cls.about(*given, orientation=orientation)


def _circle_through(start: Array, via: Array, goal: Array) -> Circle:
    """Return the circle by the angle δ between the chords start–via and via–goal: the arc is 2δ, the chord 2 r sin δ."""
    first, second, chord = via - start, goal - via, goal - start
    sides = np.array([np.linalg.norm(v) for v in (first, second, chord)])
    least = max(SAME_POINT, DEGENERATE * sides.max())
    for side, argument, other in zip(sides, ("via", "via", "goal"), ("start", "goal", "start"), strict=True):
        if side <= least:
            full = "; a full circle is Arc.about" if argument == "goal" else ""
            raise InvalidInput(argument, f"a point {side:.3g} m from {other}", f"three different points{full}")
    normal = np.cross(first, second)
    area = float(np.linalg.norm(normal))
    delta = float(np.arctan2(area, first @ second))
    if not DEGENERATE <= delta <= pi - DEGENERATE:
        got = f"three points on a straight line (within {DEGENERATE:g} rad)"
        raise InvalidInput("via", got, "a point off the line from start to goal; use Line for a straight path")
    normal /= area
    chord /= sides[2]
    along = np.cos(delta) * chord - np.sin(delta) * np.cross(normal, chord)
    return Circle(along, np.cross(normal, along), float(sides[2] / (2.0 * np.sin(delta))), 2.0 * delta)


def _check_orientation(start: Array, orientation: ArrayLike, with_arc: Array) -> tuple[Array, Any]:
    """Return the rotation vector (3,) of the whole arc, and the orientation as plain data."""
    expected = "'fixed', 'arc' or a rotation matrix (3, 3)"
    if isinstance(orientation, str):
        if orientation not in ("fixed", "arc"):
            raise InvalidInput("orientation", repr(orientation)[:60], expected)
        return (with_arc if orientation == "arc" else np.zeros(3)), orientation
    R = check_rotation(orientation, expected)
    return shortest_turn(start, R, "orientation"), R.tolist()


def _vector(value: ArrayLike, argument: str, what: str) -> Array:
    vector = real_array(value, argument, f"{what} of shape (3,)", (3,))
    if not (np.abs(vector) <= se3.FARTHEST).all():
        raise InvalidInput(argument, vector.tolist(), f"{what} of finite numbers up to 1e6")
    return vector.copy()


METHOD = Arc
