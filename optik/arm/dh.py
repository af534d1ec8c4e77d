"""Rows of Denavit–Hartenberg tables, and their transforms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from optik import se3
from optik.check import check_flag
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array


class DHRow(NamedTuple):
    """One row of a Denavit–Hartenberg table.

    Lengths in metres, angles in radians. ``theta`` (revolute) or ``d`` (prismatic) is the joint's offset at q = 0.
    """

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False


def screw_x(angle: float, length: float) -> Array:
    """Return the transform Rot(x, angle) Trans(x, length)."""
    return se3.pose(se3.exp_so3([angle, 0.0, 0.0]), (length, 0.0, 0.0))


def screw_z(angle: float, length: float) -> Array:
    """Return the transform Rot(z, angle) Trans(z, length)."""
    return se3.pose(se3.exp_so3([0.0, 0.0, angle]), (0.0, 0.0, length))


def check_rows(rows: Iterable[DHRow | Mapping[str, Any]]) -> list[DHRow]:
    """Check the rows of a table; return them as `DHRow`."""
    table = []
    if not isinstance(rows, Iterable):
        raise InvalidInput("rows", repr(rows)[:60], "a list of DHRow or of mappings")
    for i, row in enumerate(rows):
        try:
            named = row if isinstance(row, DHRow) else DHRow(**row)
        except TypeError:
            wanted = "a DHRow, or a mapping with a, alpha, d, theta, prismatic"
            raise InvalidInput(f"rows[{i}]", repr(row)[:80], wanted) from None
        for field in ("a", "alpha", "d", "theta"):
            value = getattr(named, field)
            real = isinstance(value, int | float | np.integer | np.floating)
            if not real or not np.isfinite(value):
                raise RobotModelError("table", f"joint {i + 1}: {field} is {value!r}, expected a finite number")
        check_flag(named.prismatic, f"rows[{i}].prismatic")
        table.append(named)
    return table
