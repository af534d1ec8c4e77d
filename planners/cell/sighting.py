"""Measurements of a pan-tilt laser: a plane that its beam meets, a reading of a spot, and a sighting with its status."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.check import format_value, real_array
from optik.errors import InvalidInput
from optik.se3 import FARTHEST, check_pose
from optik.types import Array

COVARIANCE_ROUNDING = 1e-9
"""Largest asymmetry and negative eigenvalue of a covariance that count as rounding, over its largest entry [1]."""

Limits = tuple[float, float]
"""A lower and an upper limit."""


def copy_read_only(array: ArrayLike) -> Array:
    """Return a read-only copy, for the fields of immutable objects."""
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def check_vectors(value: ArrayLike, argument: str) -> Array:
    """Return points or directions as an array, checked."""
    array = real_array(value, argument, "an array of shape (3,) or (..., 3)")
    if array.shape[-1:] != (3,):
        raise InvalidInput(argument, f"shape {array.shape}", "an array of shape (3,) or (..., 3)")
    if not (np.abs(array) <= FARTHEST).all():  # false for NaN
        raise InvalidInput(argument, "NaN, infinity or more than 1e6 in it", "finite numbers within 1e6")
    return array


def check_one_vector(value: ArrayLike, argument: str) -> Array:
    """Return one point or direction as an array, checked."""
    array = check_vectors(value, argument)
    if array.shape != (3,):
        raise InvalidInput(argument, f"shape {array.shape}", "an array of shape (3,)")
    return array


def check_readings(pan: ArrayLike, tilt: ArrayLike, range: ArrayLike) -> tuple[Array, Array, Array]:
    """Return angles and ranges as arrays of one shape, checked."""
    given = []
    for value, name, unit in ((pan, "pan", "[rad]"), (tilt, "tilt", "[rad]"), (range, "range", "[m], not below 0")):
        array = real_array(value, name, f"finite numbers {unit}")
        if not np.isfinite(array).all() or (name == "range" and (array < 0.0).any()):
            raise InvalidInput(name, format_value(value), f"finite numbers {unit}")
        given.append(array)
    try:
        pan, tilt, range = np.broadcast_arrays(*given)
    except ValueError:
        shapes = ", ".join(str(a.shape) for a in given)
        raise InvalidInput("pan, tilt, range", f"shapes {shapes}", "shapes that broadcast") from None
    return pan, tilt, range


def check_limits(value: object, argument: str, least: float, most: float, inside: str) -> Limits:
    """Return a lower and an upper limit, checked."""
    expected = f"a lower limit below an upper one, within {inside}"
    pair = real_array(value, argument, expected)
    if pair.shape != (2,) or not least <= pair[0] < pair[1] <= most:  # false for NaN
        raise InvalidInput(argument, format_value(value), expected)
    return float(pair[0]), float(pair[1])


def check_covariance(value: ArrayLike) -> Array:
    """Return the covariance of a pose's twist, checked, exactly symmetric and read-only."""
    expected = "a symmetric positive semi-definite matrix of shape (6, 6)"
    matrix = real_array(value, "pose_covariance", expected)
    if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
        raise InvalidInput("pose_covariance", f"shape {matrix.shape}, or NaN or infinity in it", expected)
    size = float(np.abs(matrix).max())
    if np.abs(matrix - matrix.T).max() > COVARIANCE_ROUNDING * size:
        raise InvalidInput("pose_covariance", "a matrix that is not symmetric", expected)
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < -COVARIANCE_ROUNDING * size:
        raise InvalidInput("pose_covariance", f"the eigenvalue {least:.3g}", expected)
    return copy_read_only((matrix + matrix.T) / 2.0)


SHORTEST_NORMAL = 1e-9
"""Shortest vector that is accepted as a plane's normal [1]: a shorter one is a difference of equal vectors, mostly rounding."""


class SightStatus(StrEnum):
    """Whether a unit sees a point, or where its beam meets a plane. Only FOUND is success.

    OUTSIDE_ANGLES: pan or tilt would have to leave its limits. OUT_OF_RANGE: nearer or farther than the unit measures.
    PARALLEL: the beam is parallel to the plane. BEHIND: the plane, or the point, is behind the unit, where its beam cannot
    turn. AT_UNIT: the point is the unit's own origin.
    """

    FOUND = "found"
    OUTSIDE_ANGLES = "outside_angles"
    OUT_OF_RANGE = "out_of_range"
    PARALLEL = "parallel"
    BEHIND = "behind"
    AT_UNIT = "at_unit"


class Spot(NamedTuple):
    """A reading of a spot: pan [rad], tilt [rad] and range [m]; scalars, or arrays of one shape."""

    pan: float | Array
    tilt: float | Array
    range: float | Array


class SimulatedSpot(Spot):
    """A reading of a simulated unit, with the true point (3,) in the arm's base frame [m]; see `Cell.read`."""

    true_point: Array | None = None


Follow = Callable[[float], Spot]
"""Returns a reading of the spot; called at every tick with the time for which the arm has been moving [s]."""
Look = Callable[[], Spot]
"""Returns a reading of the tool at rest."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A spot and its point, or the reason why there is none. ``bool(sighting)`` is success.

    Attributes
    ----------
    status : SightStatus
        FOUND, or another status.
    reason, advice : str
        Why there is no point, with numbers, and what to change; empty for FOUND.
    point : (3,) array or None
        Position of the spot in the arm's base frame [m].
    spot : Spot or None
        Its reading by the unit without noise [rad, rad, m].
    covariance : (3, 3) array or None
        Covariance of the point from the noise of angles, range and calibration, to first order [m²].
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
    """A plane in the arm's base frame, such as the graph paper; it is assumed exact.

    Methods raise InvalidInput for invalid arrays.

    Parameters
    ----------
    point : (3,) array
        A point on it [m].
    normal : (3,) array
        Normal of the plane, to either side, of any length [1].

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
        normal = check_one_vector(self.normal, "normal")
        length = float(np.linalg.norm(normal))
        if length < SHORTEST_NORMAL:
            raise InvalidInput(
                "normal", f"a vector of length {length:.3g}", f"a vector longer than {SHORTEST_NORMAL:g}"
            )
        object.__setattr__(self, "point", copy_read_only(check_one_vector(self.point, "point")))
        object.__setattr__(self, "normal", copy_read_only(normal / length))

    def transform(self, T: ArrayLike) -> Plane:
        """Return the plane moved by a pose: from the coordinates of one frame to those of another.

        Parameters
        ----------
        T : (4, 4) array
            Pose T_ab, where the plane is given in frame b and returned in frame a [1, m].

        Returns
        -------
        Plane
            The plane in frame a.
        """
        T = check_pose(T, "T")
        return Plane(T[:3, :3] @ self.point + T[:3, 3], T[:3, :3] @ self.normal)

    def distance(self, points: ArrayLike) -> Array:
        """Return the signed distances of points, positive on the side of the normal.

        Parameters
        ----------
        points : (3,) or (..., 3) array
            In the frame of the plane [m].

        Returns
        -------
        scalar or (...,) array
            Distances [m].
        """
        return np.asarray((check_vectors(points, "points") - self.point) @ self.normal)
