"""The one way a hot loop is compiled: Numba, kept on disk, division errors as IEEE values, no fast-math."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
import uuid
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, _Cache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.extending import is_jitted

from optik.fingerprint import Opaque, fingerprint, variant

F = TypeVar("F", bound=Callable[..., Any])

DIGITS = 64
"""Hexadecimal digits of a SHA-256, which a kept file starts with twice."""


def compiled(function: F) -> F:
    """Compile a plain function over arrays on first use; the type checker keeps its signature."""
    return _jit(function, False)


def parallel(function: F) -> F:
    """Compile as `compiled` does, into code that other threads run beside: it lets go of Python's lock."""
    return _jit(function, True)


def _jit(function: F, nogil: bool) -> F:
    kernel: Any = numba.njit(error_model="numpy", nogil=nogil)(function)
    if is_jitted(kernel):  # NUMBA_DISABLE_JIT leaves functions as they are
        kernel._cache = KernelCache(kernel)  # what njit(cache=True) would put there
    result: F = kernel
    return result


def inlined(function: F) -> F:
    """Compile a helper into whatever kernel calls it: it sees the kernel's constants, and is kept with it.

    No fast-math here either: LLVM would fuse products and sums differently for one lane and for many.
    """
    result: F = numba.njit(error_model="numpy", forceinline=True)(function)
    return result


class KernelCache(_Cache):  # type: ignore[misc]
    """Machine code of one function on disk, used for as long as everything that it depends on is the same.

    Numba's own cache asks whether a function's file has changed: too much for a docstring, too little for a helper in
    another file. Here one file holds the code for one set of argument types and one processor, beginning with the
    fingerprint of what it depends on; code that is no longer right is written over, so the folder does not grow with
    the versions of a source, and what a function that is gone has left goes with the folder. A file is written whole
    and then renamed: processes that compile at once do not see each other's halves, and what they write is the same or
    says what it is. Nothing is looked for before the first call.
    """

    def __init__(self, kernel: Dispatcher) -> None:
        self._kernel = kernel
        self._qualname = kernel.py_func.__code__.co_qualname
        self._enabled = True

    @property
    def cache_path(self) -> str | None:
        """Folder of the kept code, or None where none can be written."""
        place = _place(self._kernel.py_func)
        return None if place is None else str(place.locator.get_cache_path())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for some types of arguments, or None where it must be compiled."""
        target_context.refresh()
        found = self._find(sig, target_context.codegen())
        if found is None:
            return None
        place, file, depends = found
        try:
            data = file.read_bytes()
        except OSError:
            return None
        payload = data[2 * DIGITS :]
        if data[: 2 * DIGITS] != (depends + hashlib.sha256(payload).hexdigest()).encode():
            return None
        return place.rebuild(target_context, pickle.loads(payload))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; a disk that is full only means that the next process compiles again."""
        found = self._find(sig, data.codegen)
        if found is None or not found[0].check_cachable(data):
            return
        place, file, depends = found
        payload = dumps(place.reduce(data))
        part = file.with_name(f"{file.name}.{uuid.uuid4().hex}")
        try:
            place.locator.ensure_cache_path()
            part.write_bytes((depends + hashlib.sha256(payload).hexdigest()).encode() + payload)
            part.replace(file)
        except OSError:
            with contextlib.suppress(OSError):
                part.unlink()

    def enable(self) -> None:
        """Use the kept code again."""
        self._enabled = True

    def disable(self) -> None:
        """Compile without asking for kept code, and keep none."""
        self._enabled = False

    def flush(self) -> None:
        """Forget what is kept of the function."""
        place = _place(self._kernel.py_func)
        if place is not None:
            for file in Path(place.locator.get_cache_path()).glob(f"{self._stem()}-*.nbk"):
                file.unlink(missing_ok=True)

    def _stem(self) -> str:
        module = Path(self._kernel.py_func.__code__.co_filename).stem
        return f"{module}.{self._qualname}".replace("<", "").replace(">", "")

    def _find(self, sig: Any, codegen: Any) -> tuple[_Place, Path, str] | None:
        """Where the code for some types of arguments lies or would lie, and what it depends on."""
        place = _place(self._kernel.py_func) if self._enabled else None
        if place is None:
            return None
        types = tuple(getattr(sig, "args", sig))
        try:
            depends = fingerprint(self._kernel, types)
        except Opaque:
            return None
        # Symbols bear the function's name: two versions of it, or two closures, must not be taken for one another where
        # they are linked into a third function.
        self._kernel.py_func.__qualname__ = f"{self._qualname}_{depends[:12]}"
        processor = hashlib.sha256(repr((codegen.magic_tuple(), sys.version_info[:2])).encode()).hexdigest()[:8]
        file = f"{self._stem()}-{variant(self._kernel, types)}-{processor}.nbk"
        return place, Path(place.locator.get_cache_path()) / file, depends


class _PrivateFolder(_CacheLocator):  # type: ignore[misc]
    """The last resort, where neither a function's own folder nor the user's cache can be written: a temporary folder."""

    def __init__(self, py_file: str) -> None:
        self._py_file = py_file
        self._folder = str(_private_folder() / self.get_suitable_cache_subpath(py_file))

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _PrivateFolder | None:
        """Return the place for a function, or None where no folder at all can be written."""
        with contextlib.suppress(OSError):
            if not Path(py_file).exists():
                return None
            place = cls(py_file)
            place.ensure_cache_path()
            return place
        return None

    def get_cache_path(self) -> str:
        """Return the folder."""
        return self._folder

    def get_source_stamp(self) -> None:
        """Sources are not asked for their time."""

    def get_disambiguator(self) -> str:
        """File names are made elsewhere."""
        return ""


class _Place(CompileResultCacheImpl):  # type: ignore[misc]
    """Where Numba keeps a function's code (NUMBA_CACHE_DIR, else beside the source, else the user's cache), and how."""

    _locator_classes = (*CompileResultCacheImpl._locator_classes, _PrivateFolder)


def _place(function: Callable[..., Any]) -> _Place | None:
    """Where a function's code is kept; nowhere where it has no file, as at a prompt, or no folder can be written."""
    try:
        return _Place(function)
    except RuntimeError:
        if Path(function.__code__.co_filename).exists():
            _warn("no folder can be written, so every process compiles anew")
        return None


@cache
def _private_folder() -> Path:
    """Return this user's folder among the temporary ones: what lies there is run, so nobody else may write to it."""
    user = os.getuid() if hasattr(os, "getuid") else "kernels"  # elsewhere the temporary folder is the user's own
    folder = Path(tempfile.gettempdir()) / f"optik-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    ours = stat.S_ISDIR(found.st_mode) and (user == "kernels" or (found.st_uid == user and not found.st_mode & 0o077))
    if not ours:
        folder = Path(tempfile.mkdtemp(prefix="optik-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _warn(f"compiled code is kept in {folder}, since neither the package's folder nor the user's cache can be written")
    return folder


@cache
def _warn(what: str) -> None:
    """Warn once in a process, in one line: a warning that names a line of source would print that line too."""
    warnings.warn_explicit(f"{what}; NUMBA_CACHE_DIR names another", RuntimeWarning, "optik", 1)
