"""Checks of what a laser unit is given: vectors, readings, limits and a covariance; a wrong one raises InvalidInput."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.check import real_array, shown
from optik.errors import InvalidInput
from optik.se3 import FARTHEST
from optik.types import Array

COVARIANCE_ROUNDING = 1e-9
"""Asymmetry and negative eigenvalues of a covariance that count as rounding, over its largest entry [1]."""

Limits = tuple[float, float]
"""A lower and an upper limit."""


def fixed(array: ArrayLike) -> Array:
    """Return a copy that cannot be written to, for the fields of immutable objects."""
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def vectors(value: ArrayLike, argument: str) -> Array:
    """Return points or directions as an array, checked."""
    array = real_array(value, argument, "an array of shape (3,) or (..., 3)")
    if array.shape[-1:] != (3,):
        raise InvalidInput(argument, f"shape {array.shape}", "an array of shape (3,) or (..., 3)")
    if not (np.abs(array) <= FARTHEST).all():  # false for NaN
        raise InvalidInput(argument, "NaN, infinity or more than 1e6 in it", "finite numbers within 1e6")
    return array


def vector(value: ArrayLike, argument: str) -> Array:
    """Return one point or direction as an array, checked."""
    array = vectors(value, argument)
    if array.shape != (3,):
        raise InvalidInput(argument, f"shape {array.shape}", "an array of shape (3,)")
    return array


def check_readings(pan: ArrayLike, tilt: ArrayLike, range: ArrayLike) -> tuple[Array, Array, Array]:
    """Return angles and ranges as arrays of one shape, checked."""
    given = []
    for value, name, unit in ((pan, "pan", "[rad]"), (tilt, "tilt", "[rad]"), (range, "range", "[m], not below 0")):
        array = real_array(value, name, f"finite numbers {unit}")
        if not np.isfinite(array).all() or (name == "range" and (array < 0.0).any()):
            raise InvalidInput(name, shown(value), f"finite numbers {unit}")
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
        raise InvalidInput(argument, shown(value), expected)
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
    return fixed((matrix + matrix.T) / 2.0)
