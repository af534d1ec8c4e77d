"""Compilation of hot loops by Numba: machine code cached on disk, IEEE values for division by zero, no fast-math."""

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
from numba.core import config
from numba.core.caching import CompileResultCacheImpl, _Cache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.extending import is_jitted

from optik.fingerprint import Opaque, fingerprint, variant

config._config_fname = os.devnull  # a .numba_config.yaml in the working folder could name a folder of code to run
config.reload_config()

F = TypeVar("F", bound=Callable[..., Any])
"""Type of the function: the type checker sees the signature of what is compiled."""

SHA256_DIGITS = 64
"""Hexadecimal digits of a SHA-256; a cached file begins with two: fingerprint and checksum."""


def compiled(function: F) -> F:
    """Compile a function over arrays on its first call.

    Parameters
    ----------
    function : callable
        The Python function.

    Returns
    -------
    callable
        The compiled function, with the signature of the Python function.
    """
    return _jit(function, False)


def parallel(function: F) -> F:
    """Compile as `compiled` does, into code that releases Python's global lock, so that threads can run it in parallel.

    Parameters
    ----------
    function : callable
        The Python function.

    Returns
    -------
    callable
        The compiled function, with the signature of the Python function.
    """
    return _jit(function, True)


def _jit(function: F, nogil: bool) -> F:
    kernel: Any = numba.njit(error_model="numpy", nogil=nogil)(function)
    if is_jitted(kernel):  # NUMBA_DISABLE_JIT leaves functions as they are
        kernel._cache = KernelCache(kernel)  # what njit(cache=True) would put there
    result: F = kernel
    return result


def inlined(function: F) -> F:
    """Compile a helper into every kernel that calls it: it sees the kernel's constants, and is cached with the kernel.

    There is no fast-math here either: LLVM would fuse products and sums differently for one lane and for many.

    Parameters
    ----------
    function : callable
        The Python function.

    Returns
    -------
    callable
        The function for kernels, with the signature of the Python function.
    """
    result: F = numba.njit(error_model="numpy", forceinline=True)(function)
    return result


class KernelCache(_Cache):  # type: ignore[misc]
    """Machine code of one function on disk, valid as long as everything that it depends on is unchanged.

    Numba's own cache is invalidated by any change of a function's file, even of a docstring, but not by a change of a
    helper in another file. Here one file holds the code for one set of argument types and one processor, and begins
    with the fingerprint of what the code depends on. Outdated code is overwritten, so the folder does not grow with the
    versions of a source; files of a deleted function stay until the folder is deleted. A file is written under a
    temporary name and then renamed, so processes that compile at the same time never read a partial file. The disk is
    not accessed before the first call.
    """

    def __init__(self, kernel: Dispatcher) -> None:
        self._kernel = kernel
        self._qualname = kernel.py_func.__code__.co_qualname
        self._enabled = True

    @property
    def cache_path(self) -> str | None:
        """Folder of the cached code, or None if no folder can be written."""
        place = _place(self._kernel.py_func)
        return None if place is None else str(place.locator.get_cache_path())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached code for types of arguments.

        Parameters
        ----------
        sig : tuple or numba signature
            Types of the arguments.
        target_context : numba target context
            Numba's description of the processor.

        Returns
        -------
        compile result or None
            None if the function must be compiled.
        """
        target_context.refresh()
        found = self._find(sig, target_context.codegen())
        if found is None:
            return None
        place, file, depends = found
        try:
            data = file.read_bytes()
        except OSError:
            return None
        payload = data[2 * SHA256_DIGITS :]
        if data[: 2 * SHA256_DIGITS] != (depends + hashlib.sha256(payload).hexdigest()).encode():
            return None
        return place.rebuild(target_context, pickle.loads(payload))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write compiled code to the cache; if the disk is full, nothing is cached and no error is raised.

        Parameters
        ----------
        sig : tuple or numba signature
            Types of the arguments.
        data : compile result
            What Numba compiled.
        """
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
        """Use the cache again."""
        self._enabled = True

    def disable(self) -> None:
        """Neither read nor write the cache."""
        self._enabled = False

    def flush(self) -> None:
        """Delete the cached code of the function."""
        place = _place(self._kernel.py_func)
        if place is not None:
            for file in Path(place.locator.get_cache_path()).glob(f"{self._stem()}-*.nbk"):
                file.unlink(missing_ok=True)

    def _stem(self) -> str:
        module = Path(self._kernel.py_func.__code__.co_filename).stem
        return f"{module}.{self._qualname}".replace("<", "").replace(">", "")

    def _find(self, sig: Any, codegen: Any) -> tuple[_Place, Path, str] | None:
        """Place and file of the code for types of arguments, and the fingerprint of what it depends on."""
        place = _place(self._kernel.py_func) if self._enabled else None
        if place is None:
            return None
        types = tuple(getattr(sig, "args", sig))
        try:
            depends = fingerprint(self._kernel, types)
        except Opaque:
            return None
        # Symbols contain the function's name: two versions of it, or two closures, must not be confused when they are
        # linked into a third function.
        self._kernel.py_func.__qualname__ = f"{self._qualname}_{depends[:12]}"
        processor = hashlib.sha256(repr((codegen.magic_tuple(), sys.version_info[:2])).encode()).hexdigest()[:8]
        file = f"{self._stem()}-{variant(self._kernel, types)}-{processor}.nbk"
        return place, Path(place.locator.get_cache_path()) / file, depends


class _PrivateFolder(_CacheLocator):  # type: ignore[misc]
    """A temporary folder, for when neither a function's own folder nor the user's cache can be written."""

    def __init__(self, py_file: str) -> None:
        self._py_file = py_file
        self._folder = str(_private_folder() / self.get_suitable_cache_subpath(py_file))

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _PrivateFolder | None:
        """Return the place for a function, or None if no folder at all can be written."""
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
        """Modification times of sources are not used."""

    def get_disambiguator(self) -> str:
        """File names are composed by `KernelCache`."""
        return ""


class _Place(CompileResultCacheImpl):  # type: ignore[misc]
    """Folder in which Numba caches a function (NUMBA_CACHE_DIR, else beside the source, else the user's cache)."""

    _locator_classes = (*CompileResultCacheImpl._locator_classes, _PrivateFolder)


def _place(function: Callable[..., Any]) -> _Place | None:
    """Place of a function's code; None if it has no file, as at a prompt, or if no folder can be written."""
    try:
        return _Place(function)
    except RuntimeError:
        if Path(function.__code__.co_filename).exists():
            _warn("no folder can be written, so every process compiles again")
        return None


@cache
def _private_folder() -> Path:
    """Return this user's temporary folder: code in it is executed, so no other user may be able to write to it."""
    user = os.getuid() if hasattr(os, "getuid") else "kernels"  # elsewhere the temporary folder is the user's own
    folder = Path(tempfile.gettempdir()) / f"optik-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    ours = stat.S_ISDIR(found.st_mode) and (user == "kernels" or (found.st_uid == user and not found.st_mode & 0o077))
    if not ours:
        folder = Path(tempfile.mkdtemp(prefix="optik-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _warn(
        f"compiled code is cached in {folder}, since neither the package's folder nor the user's cache can be written"
    )
    return folder


@cache
def _warn(what: str) -> None:
    """Warn once in a process, in one line: a warning that names a line of source would print that line too."""
    warnings.warn_explicit(f"{what}; NUMBA_CACHE_DIR names another", RuntimeWarning, "optik", 1)
