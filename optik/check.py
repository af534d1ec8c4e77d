"""Checks of arguments, which raise InvalidInput with the argument's name."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable
from functools import wraps
from inspect import CO_VARKEYWORDS
from typing import Any, TypeVar

import numpy as np

from optik.errors import InvalidInput, UnknownName
from optik.types import Array

Callable_ = TypeVar("Callable_", bound=Callable[..., Any])


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


def check_keywords(function: Callable_) -> Callable_:
    """Let a function, or a class, answer an unknown keyword with the nearest one, or an example of its docstring."""
    start = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    code = start.__code__
    known, kinds = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount], code.co_flags & CO_VARKEYWORDS

    names = [name for name in known if name != "self"]

    @wraps(start)
    def call(*args: Any, **given: Any) -> Any:
        for word in given.keys() - known:
            example = re.search(rf"``([^`]*\([^`]*\b{word}[^`]*)``", " ".join((function.__doc__ or "").split()))
            typed = [name for name in names if word.lower() in str(start.__annotations__.get(name)).lower()]
            raise UnknownName(
                f"argument of {function.__name__}()", word, names, similar=[example[1]] if example else typed
            )
        try:
            return start(*args, **given)
        except TypeError as error:
            if not str(error).startswith(f"{start.__qualname__}() "):
                raise
            raise TypeError(f"{error}; the arguments begin with {', '.join(names[:4])}") from None

    if kinds:
        return function
    if isinstance(function, type):
        function.__init__ = call  # type: ignore[misc]
        return function
    return call  # type: ignore[return-value]


AT_LIMIT = (-1e-6, 1e-12)
"""Smallest and largest difference from 1 of a ratio that is printed as 1: it is below its limit by less than anybody reads, or
above it by rounding."""


def format_ratio(ratio: float) -> str:
    """Return a ratio to a limit with three digits, or with as many as tell it from 1; and of infinity a word."""
    texts = (f"{ratio:.{digits}g}" for digits in range(3, 17))
    if AT_LIMIT[0] < ratio - 1.0 <= AT_LIMIT[1]:
        return "1"
    return "unbounded" if ratio == math.inf else next(text for text in texts if float(text) != 1.0)


def describe_ratio(ratio: float) -> str:
    """Return a ratio to a limit in words: 1.0004 of its limit, 2.89 times its limit, unbounded."""
    return format_ratio(ratio) + ("" if ratio == math.inf else " times its limit" if ratio >= 2.0 else " of its limit")


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
