"""Compilation of hot loops by Numba: machine code is cached or shipped, IEEE values for division by zero, no fast-math."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

from numba.core import config

from optik.compiled.cache import KernelCache
from optik.compiled.kernel import Helper, Kernel

config._config_fname = os.devnull  # a .numba_config.yaml in the working folder could name a folder of code to run
config.reload_config()

F = TypeVar("F", bound=Callable[..., Any])
"""Type of the function: the type checker sees the signature of what is compiled."""


def compiled(function: F) -> F:
    """Compile a function over arrays on its first call."""
    return _jit(function, False)


def parallel(function: F) -> F:
    """Compile like `compiled`, into code that releases Python's global lock, so that threads can run it in parallel."""
    return _jit(function, True)


def _jit(function: F, nogil: bool) -> F:
    if config.DISABLE_JIT:
        return function
    kernel: Any = Kernel(function, targetoptions={"nogil": nogil})
    kernel._cache = KernelCache(kernel)  # what njit(cache=True) would put there
    result: F = kernel
    return result


def inlined(function: F) -> F:
    """Compile a helper into every kernel that calls it, without fast-math.

    With fast-math, LLVM fuses products and sums differently for one lane and for many.
    """
    helper: Any = function if config.DISABLE_JIT else Helper(function)
    result: F = helper
    return result
