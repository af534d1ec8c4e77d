"""Coordinates of a path's freedoms: their ranges, those in the null space of an arm, and whether they leave only a point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from optik.arm.plain import read_numbers
from optik.errors import InvalidInput
from optik.types import Array
from planners.freedom.base import Bounds
from planners.paths.base import Path


class CoordinateRange(NamedTuple):
    """Range of one coordinate of a freedom along the path [as unit].

    Attributes
    ----------
    name, unit : str
        Name of the freedom, and unit of the coordinate.
    allowed : tuple of float
        Least and greatest allowed value; of a ``round`` freedom [0, greatest norm].
    reached : tuple of float
        Proved bounds: the least and the greatest coefficient of the spline; of a ``round`` freedom of their norms, of an elbow
        of their distances from the initial joint path.
    """

    name: str
    unit: str
    allowed: tuple[float, float]
    reached: tuple[float, float]


class NullSpace(NamedTuple):
    """Null-space coordinates: rows (r, n) with rows · q(s) equal to the spline of coefficients (C, r); those at first."""

    rows: Array
    coefficients: Array
    initial: Array

    @property
    def change(self) -> Array:
        """Coefficients (C, r) of the distance from the initial joint path, which the bounds of an elbow limit."""
        return self.coefficients - self.initial


def read_null_space(data: Any, count: int) -> NullSpace | None:
    """Return the null-space coordinates from plain data."""
    if data is None:
        return None
    if not isinstance(data, list) or len(data) != 3 or not all(isinstance(x, list) and x for x in data):
        raise InvalidInput("null_space", repr(data)[:60], "None, or rows, coefficients and initial coefficients")
    rows, *coefficients = data
    n = len(rows[0]) if isinstance(rows[0], list) else 0
    pair = (read_numbers(x, (count, len(rows)), "null_space") for x in coefficients)
    return NullSpace(read_numbers(rows, (len(rows), n), "null_space"), *pair)


def frees_rotation(path: Path, bounds: Mapping[str, Bounds]) -> bool:
    """Return whether only the tool's point is asked; raise InvalidInput for a free tilt that is not alone with a free turn."""
    if bounds.get("tilt", (0.0, 0.0))[1] < np.inf:
        return False
    if bounds.get("turn") != (-np.inf, np.inf):
        expected = "turn=True, tilt=True, of which only the tool's point follows; or a half-angle"
        raise InvalidInput("tilt", "True without turn=True", expected)
    if len(bounds) > 2:
        others = ", ".join(sorted(bounds.keys() - {"turn", "tilt"}))
        raise InvalidInput(
            "freedoms", f"{others} with turn=True, tilt=True", "these two alone: the joints follow a point"
        )
    if path.turns_only:
        raise InvalidInput(
            "path", f"a {path.name} whose point does not move", "a path of points for turn=True, tilt=True"
        )
    return True
