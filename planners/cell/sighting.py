"""What a pan-tilt laser measures: a plane that its beam meets, a spot as it is read, and a sighting with its status."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.errors import InvalidInput
from optik.se3 import check_pose
from optik.types import Array
from planners.cell._checks import fixed, vector, vectors

SHORTEST_NORMAL = 1e-9
"""Shortest vector that is accepted as a plane's normal [1]: a shorter one is a difference of equal vectors, mostly rounding."""


class SightStatus(StrEnum):
    """Whether a unit sees a point, or where its beam meets a plane. Only FOUND is success.

    OUTSIDE_ANGLES: pan or tilt would have to leave its limits. OUT_OF_RANGE: nearer or farther than the unit measures.
    PARALLEL: the beam is parallel to the plane. BEHIND: the plane, or the point, lies behind the unit, where its beam cannot
    turn. AT_UNIT: the point is the unit's own origin, to which no direction leads.
    """

    FOUND = "found"
    OUTSIDE_ANGLES = "outside_angles"
    OUT_OF_RANGE = "out_of_range"
    PARALLEL = "parallel"
    BEHIND = "behind"
    AT_UNIT = "at_unit"


class Spot(NamedTuple):
    """What the unit reads of a spot: pan [rad], tilt [rad] and range [m]; scalars, or arrays of one shape."""

    pan: float | Array
    tilt: float | Array
    range: float | Array


@dataclass(frozen=True, eq=False)
class Sighting:
    """A spot and its point, or why there is none. ``bool(sighting)`` is success.

    Attributes
    ----------
    status : SightStatus
        FOUND, or why not.
    reason, advice : str
        Why it was not found, with numbers, and what to change; empty where it was.
    point : (3,) array or None
        Where the spot is, in the arm's base frame [m].
    spot : Spot or None
        What the unit reads there, without noise [rad, rad, m].
    covariance : (3, 3) array or None
        Of the point: angle, range and calibration noise carried to it, to first order [m²].
    """

    status: SightStatus
    reason: str = ""
    advice: str = ""
    point: Array | None = None
    spot: Spot | None = None
    covariance: Array | None = None

    def __bool__(self) -> bool:
        return self.status is SightStatus.FOUND


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in the arm's base frame, such as the graph paper. It is taken as known exactly.

    Parameters
    ----------
    point : (3,) array
        A point on it [m].
    normal : (3,) array
        Perpendicular to it, to either side; of any length [1].

    Attributes
    ----------
    point : (3,) array
        As given [m].
    normal : (3,) array
        Of length 1 [1].

    Raises
    ------
    InvalidInput
        Wrong shape, NaN or infinity, or a normal without length.
    """

    point: Array
    normal: Array

    def __post_init__(self) -> None:
        normal = vector(self.normal, "normal")
        length = float(np.linalg.norm(normal))
        if length < SHORTEST_NORMAL:
            raise InvalidInput(
                "normal", f"a vector of length {length:.3g}", f"a vector longer than {SHORTEST_NORMAL:g}"
            )
        object.__setattr__(self, "point", fixed(vector(self.point, "point")))
        object.__setattr__(self, "normal", fixed(normal / length))

    def moved(self, T: ArrayLike) -> Plane:
        """Return the plane moved by a pose: from the coordinates of one frame to those of another.

        Parameters
        ----------
        T : (4, 4) array
            Pose T_ab of the frame b that the plane is given in, in the frame a that it is wanted in [1, m].

        Returns
        -------
        Plane
            The plane in frame a.

        Raises
        ------
        InvalidInput
            Not a pose.
        """
        T = check_pose(T, "T")
        return Plane(T[:3, :3] @ self.point + T[:3, 3], T[:3, :3] @ self.normal)

    def distance(self, points: ArrayLike) -> Array:
        """Signed distances of points, positive on the side that the normal points to.

        Parameters
        ----------
        points : (3,) or (..., 3) array
            In the frame of the plane [m].

        Returns
        -------
        scalar or (...,) array
            Distances [m].

        Raises
        ------
        InvalidInput
            Wrong shape, NaN or infinity.
        """
        return np.asarray((vectors(points, "points") - self.point) @ self.normal)
