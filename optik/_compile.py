"""The one way a hot loop is compiled: Numba, cached on disk, division errors as IEEE values, no fast-math."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a plain function over arrays on first use; the type checker keeps its signature.

    Numba looks only at a function's own file to see whether its cached code is stale, but the code of whatever it calls
    is compiled into it. So the cache is keyed by the sources of the function's whole package and of optik, through the
    function's name.
    """
    return _jit(function, False)


def parallel(function: F) -> F:
    """Compile as `compiled` does, into code that other threads run beside: it lets go of Python's lock."""
    return _jit(function, True)


def _jit(function: F, nogil: bool) -> F:
    function.__qualname__ += f"_{_sources(_package(Path(function.__code__.co_filename)))}"
    result: F = numba.njit(cache=True, error_model="numpy", nogil=nogil)(function)
    return result


def inlined(function: F) -> F:
    """Compile a helper into whatever kernel calls it: it sees the kernel's constants, and is cached with it.

    No fast-math here either: LLVM would fuse products and sums differently for one lane and for many.
    """
    result: F = numba.njit(error_model="numpy", forceinline=True)(function)
    return result


def _package(file: Path) -> Path:
    """Topmost package that holds a file: kernels may call others anywhere in it."""
    folder = file.parent
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


@cache
def _sources(folder: Path) -> str:
    """Fingerprint of optik's sources, and of those in the function's package."""
    digest = hashlib.sha256()
    for root in sorted({Path(__file__).parent, folder}):
        for file in sorted(root.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
