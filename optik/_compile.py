"""The one way a hot loop is compiled: Numba, cached on disk, division errors as IEEE values, no fast-math."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a plain function over arrays on first use; the type checker keeps its signature."""
    result: F = numba.njit(cache=True, error_model="numpy")(function)
    return result
