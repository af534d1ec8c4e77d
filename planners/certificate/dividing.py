"""Proved bounds over a motion: its intervals are subdivided until the bound is close to the largest value found."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from optik.types import Array, Flags, Indices

MOST_PARTS = 8
"""Largest number of parts into which an interval is divided at once."""
NARROWEST_SHARE = 1e-9
"""Fraction of a motion's duration below which an interval is not divided: rounding in t is near."""

Side = TypeVar("Side", bound=Any)
"""A NamedTuple of arrays (k, ...) that begins with the times ``t`` (k,): the motion at the left or right ends of intervals."""


class Closeness(NamedTuple):
    """Accuracy of a bound: at most `factor` times the largest value found, or times `floor` if that is larger.

    ``most`` is the largest number of intervals; a motion that needs more keeps a looser bound.
    """

    factor: float
    floor: Array
    most: int


def select_ends(side: Side, which: Flags) -> Side:
    """Return the selected ends of intervals."""
    some: Side = type(side)(*(x[which] for x in side))
    return some


def join_ends(first: Side, second: Side) -> Side:
    """Return two arrays of ends of intervals as one."""
    both: Side = type(first)(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))
    return both


def repeat_ends(x: Any, times: int) -> Any:
    """Return an array repeated several times."""
    return x if times == 1 else np.concatenate([x] * times)


class SubdivisionBound(ABC, Generic[Side]):
    """Proved bounds on two values of a motion over time, such as distance and angle.

    A subclass bounds the values within intervals, and computes them at instants.

    Parameters
    ----------
    duration : float
        Of the motion [s].
    close : Closeness
        Required accuracy of the bounds.

    Attributes
    ----------
    found, when : (2,) array
        Largest values found, and their times [s].
    """

    def __init__(self, duration: float, close: Closeness) -> None:
        self._shortest, self._close = NARROWEST_SHARE * duration, close
        self.found, self.when = np.zeros(2), np.zeros(2)

    @abstractmethod
    def between(self, left: Side, right: Side) -> Array:
        """Return bounds on both values within intervals."""

    @abstractmethod
    def within(self, piece: Indices, left: Side, right: Side, shares: Array) -> Side:
        """Return the motion inside intervals, at fractions `shares` of their durations."""

    @abstractmethod
    def values(self, side: Side) -> Array:
        """Return both values at instants."""

    def record_closed(self, which: Flags, left: Side) -> None:
        """Record the intervals of the last `between` that are not divided further."""

    def bound(self, piece: Indices, left: Side, right: Side) -> Array:
        """Return the bounds on both values, by subdividing intervals until the bounds are close enough."""
        for side in (left, right):
            _keep_largest(side.t, self.values(side), self.found, self.when)
        proved, count = np.zeros(2), 0
        while True:
            between = self.between(left, right)
            over = (between / (self._close.factor * np.maximum(self.found, self._close.floor))).max(axis=1)
            loose = (over > 1.0) & (right.t - left.t > self._shortest)
            loose &= np.count_nonzero(loose) <= self._close.most - count
            np.maximum(proved, between[~loose].max(axis=0, initial=0.0), out=proved)
            self.record_closed(~loose, left)
            if not loose.any():
                return np.maximum(proved, self.found)
            count += loose.size - int(np.count_nonzero(loose))
            piece, left, right = piece[loose], select_ends(left, loose), select_ends(right, loose)
            parts = _count_parts(over[loose])
            shares = np.arange(1, parts).repeat(piece.size) / parts
            middle = self.within(piece, left, right, shares)
            _keep_largest(middle.t, self.values(middle), self.found, self.when)
            piece, left, right = repeat_ends(piece, parts), join_ends(left, middle), join_ends(middle, right)


def _keep_largest(t: Array, values: Array, found: Array, when: Array) -> None:
    """Update the largest values (2,) found, and their times, with values (k, 2) at instants (k,)."""
    for i, k in enumerate(values.argmax(axis=0)):
        if values[k, i] > found[i]:
            found[i], when[i] = values[k, i], t[k]


def _count_parts(over: Array) -> int:
    """Return the number of parts for intervals from their bounds over the target: errors of cubics fall with parts⁴."""
    if over.max() <= 2.0**4:
        return 2
    return int(np.clip(np.ceil(np.median(over) ** 0.25), 2, MOST_PARTS))
