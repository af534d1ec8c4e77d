"""Checks of the capsules, points and lengths of shapes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import freeze
from optik.check import check_count, check_number, format_value, real_array
from optik.errors import InvalidInput
from optik.types import Array, Indices

Capsules: TypeAlias = tuple[Indices, Array, Array, Array]
"""Capsules as kernels take them: link (m,), 0 for the base and i for the frame of joint i, a and b (m, 3), the ends of the
segments in those frames [m], and radius (m,) [m]. A sphere has a = b."""
LONGEST_LINK = 10.0
"""Largest coordinate and radius of a capsule of an arm [m]: larger values look like millimetres."""
MOST_CAPSULES = 4096
"""Most capsules of an arm: all pairs of them fit in memory."""


def check_capsules(value: Any, least: int = 1) -> Capsules:
    """Check capsules and their least number; return them in the form of the kernels."""
    if isinstance(value, tuple) and len(value) == 4 and all(isinstance(part, np.ndarray) for part in value):
        if len({part.shape[:1] for part in value}) != 1 or not value[0].ndim:
            raise InvalidInput(
                "shapes.capsules", f"arrays of shapes {[p.shape for p in value]}", "one row for each capsule"
            )
        value = list(zip(*(part.tolist() for part in value), strict=True))
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InvalidInput("shapes.capsules", format_value(value), "a list of (link, a, b, radius)")
    rows = [_check_row(row, f"shapes.capsules[{i}]") for i, row in enumerate(value)]
    if not least <= len(rows) <= MOST_CAPSULES:
        raise InvalidInput("shapes.capsules", f"{len(rows)} of them", f"1 to {MOST_CAPSULES} capsules")
    links, a, b, radii = zip(*rows, strict=True) if rows else ((), np.empty((0, 3)), np.empty((0, 3)), ())
    link = np.array(links, dtype=np.int64)
    link.setflags(write=False)
    return link, freeze(np.array(a), "a"), freeze(np.array(b), "b"), freeze(np.array(radii), "radius")


def _check_row(row: Any, where: str) -> tuple[int, Array, Array, float]:
    """Check a capsule; return its link, ends and radius. Both ends of a sphere are its centre."""
    if not isinstance(row, list | tuple) or len(row) not in (3, 4):
        raise InvalidInput(where, format_value(row), "(link, a, b, radius), or (link, centre, radius) of a sphere")
    check_count(row[0], f"{where}: link", 0)
    ends = [check_point(end, where, LONGEST_LINK) for end in row[1:-1]]
    return int(row[0]), ends[0], ends[-1], check_length(row[-1], f"{where}: radius", LONGEST_LINK)


def check_excess(value: ArrayLike, count: int, where: str) -> Array:
    """Check the excess of shapes, the largest distance of their surfaces from the enclosed bodies; return it as (count,)."""
    excess = real_array(value, where, f"a number, or {count} of them")
    if excess.shape not in ((), (count,)) or (excess < 0.0).any() or np.isinf(excess).any():
        raise InvalidInput(where, format_value(value), f"{count} lengths ≥ 0 (NaN where unknown)")
    return freeze(np.broadcast_to(excess, (count,)), where)


def check_point(value: ArrayLike, where: str, farthest: float) -> Array:
    """Check a point (3,) [m], and return it."""
    point = freeze(value, where)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InvalidInput(where, format_value(value), "points of three finite numbers")
    if (far := float(np.abs(point).max())) > farthest:
        raise InvalidInput(
            where, f"a coordinate of {far:.6g} m", f"metres (within {farthest:g}): looks like millimetres"
        )
    return point


def check_length(value: Any, where: str, largest: float) -> float:
    """Check a length above 0 [m], and return it."""
    length = check_number(value, where, "a length above 0", above=0.0)
    if length > largest:
        raise InvalidInput(where, f"{length:.6g} m", f"metres (up to {largest:g}): looks like millimetres")
    return length
