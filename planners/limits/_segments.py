"""Limits with one bound for each segment of a path: which bound holds where."""

from __future__ import annotations

import numpy as np

from optik.errors import InvalidInput
from optik.types import Array
from planners.paths.base import Path

AT_BREAK = 1e-9
"""Share of the path around a break within which the lesser of both bounds holds: a law's places are exact to rounding only."""


def bounds_on_pieces(path: Path, bound: Array, name: str) -> Array:
    """Bounds on the pieces between a path's breaks; of a piece that is part of two segments the lesser one."""
    if bound.size != path.segments:
        several = f"{path.segments} numbers, one for each segment of the {path.name}, or one number"
        one = f"one number: a {path.name} has one segment"
        raise InvalidInput(f"limits.{name}", f"{bound.size} numbers", several if path.segments > 1 else one)
    return path.least_on_pieces(bound)


def bound_at(path: Path, bound: Array, s: Array, name: str) -> Array:
    """Bounds at places of a path; at a break the lesser of both sides."""
    pieces, inner, near = bounds_on_pieces(path, bound, name), path.breaks[1:-1], AT_BREAK * path.end
    return np.minimum(pieces[np.searchsorted(inner, s - near)], pieces[np.searchsorted(inner, s + near)])


def inside_ends(path: Path, bound: Array, s: Array, name: str) -> tuple[Array, Array]:
    """Bounds that hold just after the begins of intervals of a path, and just before their ends."""
    pieces, inner, near = bounds_on_pieces(path, bound, name), path.breaks[1:-1], AT_BREAK * path.end
    return pieces[np.searchsorted(inner, s[:-1] + near)], pieces[np.searchsorted(inner, s[1:] - near)]
