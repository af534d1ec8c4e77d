"""Checks of what people pass: arrays, numbers and counts, refused by name before anything is computed from them."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

import numpy as np

from optik.errors import InvalidInput
from optik.types import Array


def real_array(value: Any, argument: str, expected: str) -> Array:
    """Return a C-contiguous float64 array of what came.

    Raises
    ------
    InvalidInput
        Words, complex numbers, ragged lists, objects.
    """
    if type(value) is np.ndarray and value.dtype == np.float64 and value.flags.c_contiguous:
        return value
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise InvalidInput(argument, repr(value)[:60], expected) from None
    if array.dtype.kind not in "iuf":
        raise InvalidInput(argument, repr(value)[:60], expected)
    return np.asarray(array, dtype=np.float64, order="C")


def check_number(
    value: Any, argument: str, expected: str, *, above: float | None = None, least: float | None = None
) -> float:
    """Return a finite number, above or at least so much.

    Raises
    ------
    InvalidInput
        Another kind of thing, NaN, infinity, or out of range.
    """
    good = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if (
        not good
        or (isinstance(value, int) and abs(value) > sys.float_info.max)
        or not np.isfinite(value)
        or (above is not None and value <= above)
        or (least is not None and value < least)
    ):
        raise InvalidInput(argument, repr(value)[:60], expected)
    return float(value)


def check_count(value: Any, argument: str, least: int, most: int | None = None) -> None:
    """Refuse what is no whole number of at least and at most so many.

    Raises
    ------
    InvalidInput
        Another kind of thing (True and 2.0 among them), too few or too many.
    """
    good = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not good or value < least or (most is not None and value > most):
        expected = f"a whole number ≥ {least}" if most is None else f"a whole number from {least} to {most:,}"
        raise InvalidInput(argument, repr(value)[:60], expected)


def check_flag(value: Any, argument: str) -> bool:
    """Return a yes or no: True and False, or 1 and 0 as arrays and tables of numbers write them.

    Raises
    ------
    InvalidInput
        Anything else: "no" and NaN count as true in Python.
    """
    if not isinstance(value, bool | np.bool_ | int | np.integer) or value not in (0, 1):
        raise InvalidInput(argument, repr(value)[:60], "True or False")
    return bool(value)


def check_words(value: Any, argument: str) -> tuple[str, ...]:
    """Return a sequence of words, none by default.

    Raises
    ------
    InvalidInput
        A single word, whose letters would be taken apart, or what are no words.
    """
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise InvalidInput(argument, repr(value)[:60], "a list of words")
    words = tuple(value)
    for word in words:
        if not isinstance(word, str):
            raise InvalidInput(argument, repr(word)[:60], "words")
    return words
