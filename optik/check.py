"""Checks of arguments, which raise InvalidInput with the argument's name."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np

from optik.errors import InvalidInput
from optik.types import Array


def real_array(value: Any, argument: str, expected: str, shape: tuple[Any, ...] = (...,)) -> Array:
    """Check that a value is an array of real numbers; return it as C-contiguous float64, itself if it is one.

    A `shape` that begins with ``...`` is that of the last axes.
    """
    array = value
    if not (type(value) is np.ndarray and value.dtype == np.float64 and value.flags.c_contiguous):
        try:
            array = np.asarray(value)
        except (TypeError, ValueError):
            raise InvalidInput(argument, repr(value)[:60], expected) from None
        if array.dtype.kind not in "iuf":
            raise InvalidInput(argument, repr(value)[:60], expected)
        array = np.asarray(array, dtype=np.float64, order="C")
    last = shape[1:] if shape[:1] == (...,) else shape
    if array.shape[array.ndim - len(last) if last is not shape else 0 :] != last:
        raise InvalidInput(argument, f"shape {array.shape}", expected)
    return array  # type: ignore[no-any-return]


def finite_array(value: Any, argument: str, expected: str, shape: tuple[Any, ...] = (...,)) -> Array:
    """Check that a value is an array of finite numbers; return it as `real_array` does."""
    array = real_array(value, argument, expected, shape)
    if not np.isfinite(array).all():
        raise InvalidInput(argument, "NaN or infinity in it", expected)
    return array


def format_value(value: Any, most: int = 80) -> str:
    """Return a value as one short line, for errors."""
    return " ".join(repr(value).split())[:most]


def format_count(number: int, noun: str) -> str:
    """Return a number of things in words: 1 part, 2 parts."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def format_ratio(ratio: float, digits: int = 9) -> str:
    """Return a ratio with so many digits, or with as many as tell it from 1."""
    texts = (f"{ratio:.{d}g}" for d in range(digits, 17))
    return next((text for text in texts if float(text) != 1.0), "1")


def check_number(
    value: Any, argument: str, expected: str, *, above: float | None = None, least: float | None = None
) -> float:
    """Check that a value is a finite number inside a range, and return it."""
    good = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if (
        not good
        or (isinstance(value, int) and abs(value) > sys.float_info.max)
        or not math.isfinite(value)
        or (above is not None and value <= above)
        or (least is not None and value < least)
    ):
        raise InvalidInput(argument, repr(value)[:60], expected)
    return float(value)


def check_count(value: Any, argument: str, least: int, most: int | None = None) -> None:
    """Raise InvalidInput unless a value is an integer inside a range."""
    good = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not good or value < least or (most is not None and value > most):
        expected = f"a whole number ≥ {least}" if most is None else f"a whole number from {least} to {most:,}"
        raise InvalidInput(argument, repr(value)[:60], expected)


def check_kind(value: Any, argument: str, kind: Any, expected: str = "") -> None:
    """Raise InvalidInput unless a value is an instance of a class, or of one of several."""
    if not isinstance(value, kind):
        raise InvalidInput(argument, format_value(value, 60), expected or f"a {kind.__name__}")


def check_choice(value: Any, argument: str, known: Iterable[str]) -> str:
    """Check that a value is one of some words, and return it."""
    if not isinstance(value, str) or value not in known:
        raise InvalidInput(argument, format_value(value, 60), " or ".join(f'"{word}"' for word in known))
    return value


def check_flag(value: Any, argument: str) -> bool:
    """Check that a value is True, False, 1 or 0; return it as bool."""
    if not isinstance(value, bool | np.bool_ | int | np.integer) or value not in (0, 1):
        raise InvalidInput(argument, repr(value)[:60], "True or False")
    return bool(value)


def locate_error(where: object, error: InvalidInput) -> InvalidInput:
    """Return an error that names the location of its argument, such as a file, first."""
    return InvalidInput(f"{where}: {error.argument}", error.got, error.expected, advice=error.advice)


def check_words(value: Any, argument: str) -> tuple[str, ...]:
    """Check that a value is a sequence of strings; return it as a tuple."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise InvalidInput(argument, repr(value)[:60], "a list of strings")
    words = tuple(np.atleast_1d(value).tolist()) if isinstance(value, np.ndarray) else tuple(value)
    for word in words:
        check_kind(word, argument, str, "strings")
    return words
