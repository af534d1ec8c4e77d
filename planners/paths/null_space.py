"""Null-space coordinates of an arm with more than six joints along a path with freedoms, and their plain data."""

from __future__ import annotations

from typing import Any, NamedTuple

from optik.arm.plain import read_numbers
from optik.errors import InvalidInput
from optik.types import Array


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
