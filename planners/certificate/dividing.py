"""Proved bounds over a motion: its intervals are divided until the bound is close to the largest value found."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Flags, Indices

MOST_PARTS = 8
"""Parts that an interval is divided into at most at once."""
NARROWEST_SHARE = 1e-9
"""Share of a motion's duration below which an interval is not divided any more: rounding in t is near."""

Side = TypeVar("Side", bound=Any)
"""A NamedTuple of arrays (k, ...) that begins with the times ``t`` (k,): the motion at the left or right ends of intervals."""


class Closeness(NamedTuple):
    """When a bound is close enough: at most `factor` times the largest value found, or times `floor` where that is larger.

    ``most`` is how many intervals there may be; a motion that needs more keeps the bound it has then.
    """

    factor: float
    floor: Array
    most: int


def taken(side: Side, which: Flags) -> Side:
    """Return some of the ends of intervals.

    Parameters
    ----------
    side : NamedTuple of (k, ...) arrays
        Ends of intervals.
    which : (k,) array of bool
        Which of them.

    Returns
    -------
    NamedTuple of arrays
        Those.
    """
    some: Side = type(side)(*(x[which] for x in side))
    return some


def joined(first: Side, second: Side) -> Side:
    """Return ends of intervals, and others behind them.

    Parameters
    ----------
    first, second : NamedTuple of (k, ...) arrays
        Ends of intervals.

    Returns
    -------
    NamedTuple of arrays
        All of them.
    """
    both: Side = type(first)(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))
    return both


def tiled(x: Any, times: int) -> Any:
    """Return an array several times behind one another.

    Parameters
    ----------
    x : (k, ...) array
        Of any kind and unit.
    times : int
        How often.

    Returns
    -------
    (times · k, ...) array
        The same object for once: `numpy.tile` takes longer than most of what is done with the result.
    """
    return x if times == 1 else np.concatenate([x] * times)


class Divided(ABC, Generic[Side]):
    """Bounds on two values of a motion at every instant, such as distance and angle.

    A subclass says how the values are bounded within intervals, and finds them at instants.

    Parameters
    ----------
    duration : float
        Of the motion [s].
    close : Closeness
        When a bound is close enough.

    Attributes
    ----------
    found, when : (2,) array
        The largest values found, and at which times [s].
    """

    def __init__(self, duration: float, close: Closeness) -> None:
        self._shortest, self._close = NARROWEST_SHARE * duration, close
        self.found, self.when = np.zeros(2), np.zeros(2)

    @abstractmethod
    def between(self, left: Side, right: Side) -> Array:
        """Bounds on both values within intervals.

        Parameters
        ----------
        left, right : NamedTuple of (k, ...) arrays
            The motion at the ends of the intervals.

        Returns
        -------
        (k, 2) array
            [as the values].
        """

    @abstractmethod
    def within(self, piece: Indices, left: Side, right: Side, shares: Array) -> Side:
        """The motion inside intervals.

        Parameters
        ----------
        piece : (k,) array of int
            Pieces of the motion that hold them.
        left, right : NamedTuple of (k, ...) arrays
            The motion at the ends of the intervals.
        shares : (m · k,) array
            Shares of the durations: all intervals' first instants, then their second ones [1].

        Returns
        -------
        NamedTuple of (m · k, ...) arrays
            The motion there.
        """

    @abstractmethod
    def note(self, side: Side) -> None:
        """Keep the largest values at instants, and their times, in `found` and `when`.

        Parameters
        ----------
        side : NamedTuple of (k, ...) arrays
            The motion at the instants.
        """

    def closed(self, which: Flags, left: Side) -> None:
        """Take note of the intervals of the last `between` that are not divided any more.

        Parameters
        ----------
        which : (k,) array of bool
            Those intervals.
        left : NamedTuple of (k, ...) arrays
            The motion at the left ends of all.
        """

    def bound(self, piece: Indices, left: Side, right: Side) -> Array:
        """Divide intervals until the bounds are close.

        Parameters
        ----------
        piece : (k,) array of int
            Pieces of the motion that hold the intervals.
        left, right : NamedTuples of (k, ...) arrays
            The motion at their ends.

        Returns
        -------
        (2,) array
            The bounds, at least as large as `found` [as the values].
        """
        for side in (left, right):
            self.note(side)
        proved, count = np.zeros(2), 0
        while True:
            between = self.between(left, right)
            over = np.empty(piece.size)
            target = self._close.factor * np.maximum(self.found, self._close.floor)
            loose = _judged(between, right.t - left.t, target, self._shortest, self._close.most - count, proved, over)
            self.closed(~loose, left)
            if not loose.any():
                return np.maximum(proved, self.found)
            count += loose.size - int(np.count_nonzero(loose))
            piece, left, right = piece[loose], taken(left, loose), taken(right, loose)
            parts = _parts(over[loose])
            shares = np.arange(1, parts).repeat(piece.size) / parts
            middle = self.within(piece, left, right, shares)
            self.note(middle)
            piece, left, right = tiled(piece, parts), joined(left, middle), joined(middle, right)


@compiled
def _judged(between: Array, h: Array, target: Array, shortest: float, room: int, proved: Array, over: Array) -> Flags:
    """Intervals (k,) that are divided: their bounds (k, 2) exceed the target (2,); the bounds of the others count.

    Into over (k,), by what factor. None is divided where there were more than there is room for.

    Returns
    -------
    (k,) array of bool
        Those intervals.
    """
    count = over.shape[0]
    loose, number = np.empty(count, np.bool_), 0
    for k in range(count):
        over[k] = max(between[k, 0] / target[0], between[k, 1] / target[1])
        loose[k] = over[k] > 1.0 and h[k] > shortest
        number += loose[k]
    for k in range(count):
        loose[k] = loose[k] and number <= room
        if not loose[k]:
            for i in range(2):
                proved[i] = max(proved[i], between[k, i])
    return loose


def _parts(over: Array) -> int:
    """Parts to divide intervals into, from their bounds over the target: errors of cubics fall by parts⁴."""
    if over.max() <= 2.0**4:
        return 2
    return int(np.clip(np.ceil(np.median(over) ** 0.25), 2, MOST_PARTS))
