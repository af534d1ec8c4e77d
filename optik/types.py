"""Array types of signatures, whose shapes and units the documentation of each array gives; and values by their content."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Real numbers in double precision."""
Flags: TypeAlias = NDArray[np.bool_]
"""Truth values."""
Indices: TypeAlias = NDArray[np.int64]
"""Integers: indices, counts or status codes."""
T = TypeVar("T", bound=tuple[Any, ...])
"""Type of a named tuple."""


def content(value: Any) -> Any:
    """Return a hashable value that is equal for equal contents of one type, to the last bit.

    Arrays are compared by dtype, shape and bytes; sequences, sets and mappings by their items, mappings regardless of
    order. Types count, because 1 == 1.0 == True. Any other value is compared as it is.
    """
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return np.ndarray, value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return type(value), frozenset((content(k), content(v)) for k, v in value.items())
    if isinstance(value, list | tuple):
        return type(value), tuple(content(v) for v in value)
    if isinstance(value, Set):
        return type(value), frozenset(content(v) for v in value)
    return type(value), value


def compare_by_content(kind: type[T]) -> type[T]:
    """Make the instances of a named tuple equal if their contents are; a decorator."""

    def equal(one: T, other: object) -> bool:
        return type(one) is type(other) and content(one) == content(other)

    methods = {"__eq__": equal, "__ne__": lambda a, b: not equal(a, b), "__hash__": lambda one: hash(content(one))}
    for name, method in methods.items():
        setattr(kind, name, method)
    return kind
