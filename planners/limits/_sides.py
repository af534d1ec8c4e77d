"""Pairs of limits (lower, upper) in place of one bound on the absolute value."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np

from optik.arm.limits import freeze
from optik.check import real_array
from optik.errors import InvalidInput
from optik.types import Array

PAIR = "a pair (lower, upper), lower < 0 < upper, each a finite number or one for each joint"
"""Description of a valid pair in error messages; both sides may be infinite where a joint is free."""


def is_pair(value: Any) -> bool:
    """Return whether a bound is a pair (lower, upper), and not one number for each of two joints."""
    several = (list, tuple, np.ndarray)
    if not isinstance(value, several) or (isinstance(value, np.ndarray) and value.ndim == 0) or len(value) != 2:
        return False
    first, second = value
    if isinstance(first, several) or isinstance(second, several):
        return True
    return isinstance(first, Real) and bool(first < 0.0)


def check_pair(value: Any, argument: str) -> Array | float:
    """Return a pair as `MotionLimits` stores it: a number or (n,) array if its sides are equal, or a (2,) or (2, n) array."""
    lower, upper = (real_array(x, argument, PAIR) for x in value)
    if max(lower.ndim, upper.ndim) > 1 or (lower.ndim == upper.ndim == 1 and lower.shape != upper.shape):
        raise InvalidInput(argument, f"a pair of shapes {lower.shape} and {upper.shape}", PAIR)
    lower, upper = np.broadcast_arrays(lower, upper)
    if not ((lower < 0.0) & (upper > 0.0)).all():
        came = f"({', '.join(np.array2string(x, precision=6, threshold=8) for x in (lower, upper))})"
        raise InvalidInput(argument, came, PAIR)
    if (np.isinf(lower) != np.isinf(upper)).any():
        raise InvalidInput(argument, "a pair with one infinite side", PAIR)
    if (lower == -upper).all():
        return freeze(upper, argument) if upper.ndim else float(upper)
    return freeze(np.stack([lower, upper]), argument)


def sides(bound: Array) -> tuple[Array, Array]:
    """Return the lower and the upper side of a bound."""
    return (-bound, bound) if bound.ndim == 1 else (bound[0], bound[1])


def symmetric_bound(bound: Array) -> Array:
    """Return the largest symmetric bound that both sides allow."""
    return bound if bound.ndim == 1 else np.minimum(-bound[0], bound[1])


def ratio_to_limit(values: Array, bound: Array) -> Array:
    """Return the ratios of values to the bound on their side."""
    if bound.ndim == 1:
        return np.asarray(np.abs(values) / bound)
    return np.asarray(values / np.where(values < 0.0, bound[0], bound[1]))


def center_rows(rows: Array, bound: Array) -> Array:
    """Return rows over a bound with two sides; the limit is respected where |rows · monomials| ≤ 1."""
    lower, upper = sides(bound)
    free = np.isinf(upper)
    low, high = np.where(free, 0.0, lower), np.where(free, 0.0, upper)
    half = np.where(free, np.inf, 0.5 * (high - low))
    out: Array = rows / half[:, None]
    out[..., 3] -= 0.5 * (low + high) / half
    return out
