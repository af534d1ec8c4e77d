"""What stands for a value in a key or a comparison: its content, so that arrays and mappings take part."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

import numpy as np


def content(value: Any) -> Any:
    """Return something hashable that is equal for equal contents of one type, to the last bit.

    Arrays are told by their bytes, sequences and mappings by what is in them, the order of a mapping aside. Types count,
    since 1 == 1.0 == True; what is none of these stands for itself.
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


def equal(one: tuple[Any, ...], other: object) -> bool:
    """Whether two records that hold arrays are of one type and one content."""
    return type(one) is type(other) and content(one) == content(other)
