"""Machine code of compiled functions: cached on this machine, or shipped in an archive."""

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
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl, _Cache, _CacheLocator
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

from optik.compiled import archive
from optik.compiled.fingerprint import VERSIONS, Opaque, fingerprint, variant

SHA256_DIGITS = 64
"""Hexadecimal digits of a SHA-256; a cached file begins with two: fingerprint and checksum."""


class KernelCache(_Cache):  # type: ignore[misc]
    """Machine code of one function on disk, valid as long as everything that it depends on is unchanged.

    Numba's own cache is invalidated by any change of a function's file, even of a docstring, but not by a change of a
    helper in another file. Here a file contains the code for one set of argument types and one processor, after the
    fingerprint of its dependencies. New code overwrites outdated code. Files of deleted functions stay until the folder is
    deleted. Files are written atomically, for processes that compile at the same time. The disk is not accessed before the
    first call.
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
        """Return the machine code for the argument types, from this machine's cache or the shipped archive; None without it."""
        target_context.refresh()
        codegen = target_context.codegen()
        if depends := self._depends(sig):
            for read in (self._read_cached, self._read_shipped):
                with contextlib.suppress(Exception):  # code that cannot be loaded, for whatever reason, is compiled
                    if (found := read(sig, codegen, depends)) is not None:
                        return rebuild(target_context, *found)
        if os.environ.get("OPTIK_COMPILES") == "error":
            raise RuntimeError(
                f"OPTIK_COMPILES=error forbids to compile {self._stem()}{sig}: run `optik kernels --compile`, or unset it"
            )
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write compiled code to the cache; if the disk is full, nothing is cached and no error is raised."""
        depends, place = self._depends(sig), _place(self._kernel.py_func)
        if not depends or place is None or not place.check_cachable(data):
            return
        # The annotation would be a third of the file.
        (name, kind, (binary, bitcode)), *others = place.reduce(data._replace(type_annotation=""))
        payload = pickle.dumps((dumps(((name, kind, binary), *others)), bitcode))
        file = self._file(place, sig, data.codegen)
        part = file.with_name(f"{file.name}.{uuid.uuid4().hex}")
        try:
            place.locator.ensure_cache_path()
            part.write_bytes(f"{depends}{hashlib.sha256(payload).hexdigest()}".encode() + payload)
            part.replace(file)
        except OSError:
            with contextlib.suppress(OSError):
                part.unlink()

    def enable(self) -> None:
        """Use the cache again."""
        self._enabled = True

    def disable(self) -> None:
        """Disable the cache: kernels are neither read from it nor written to it."""
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

    def _depends(self, sig: Any) -> str:
        """Return the fingerprint of the code for given argument types; empty if the code can be neither cached nor shipped."""
        if not self._enabled:
            return ""
        try:
            depends = fingerprint(self._kernel, _types(sig))
        except Opaque:
            return ""
        # Symbols contain the function's name: two versions of it, or two closures, must not be confused when they are
        # linked into a third function.
        self._kernel.py_func.__qualname__ = f"{self._qualname}_{depends[:12]}"
        return depends

    def _file(self, place: _Place, sig: Any, codegen: Any) -> Path:
        processor = hashlib.sha256(repr((codegen.magic_tuple(), sys.version_info[:2])).encode()).hexdigest()[:8]
        file = f"{self._stem()}-{variant(self._kernel, _types(sig))}-{processor}.nbk"
        return Path(place.locator.get_cache_path()) / file

    def _read_cached(self, sig: Any, codegen: Any, depends: str) -> tuple[bytes, Callable[[], Any]] | None:
        """Read code from the machine's cache, and how to parse its LLVM module."""
        place = _place(self._kernel.py_func)
        found = {} if place is None else read_code(self._file(place, sig, codegen))
        if depends not in found:
            return None
        code, bitcode = pickle.loads(found[depends])
        return code, partial(llvm.parse_bitcode, bitcode)

    def _read_shipped(self, sig: Any, codegen: Any, depends: str) -> tuple[bytes, Callable[[], Any]] | None:
        """Read code from the archive, and how to parse its LLVM module."""
        shipped = archive.open_archive()
        if isinstance(shipped, str) or os.environ.get("OPTIK_COMPILES") == "native":
            return None
        return (
            None if shipped.refusal(VERSIONS, archive.CompileTarget(*codegen.magic_tuple())) else shipped.read(depends)
        )


def read_code(file: Path) -> dict[str, bytes]:
    """Read the code in a cached file, by its fingerprint; return no code if the file is missing or damaged."""
    try:
        data = file.read_bytes()
    except OSError:
        return {}
    head, payload = data[: 2 * SHA256_DIGITS].decode(errors="replace"), data[2 * SHA256_DIGITS :]
    whole = head[SHA256_DIGITS:] == hashlib.sha256(payload).hexdigest()
    return {head[:SHA256_DIGITS]: payload} if whole else {}


def rebuild(context: Any, code: bytes, module: Callable[[], Any]) -> Any:
    """Load code; its LLVM module is parsed when a caller is compiled."""
    (name, kind, binary), described, *others = pickle.loads(code)
    symbols = context.codegen()._engine._defined_symbols
    symbols.add(described.llvm_cpython_wrapper_name)  # Numba would find this name in the module
    empty = llvm.parse_assembly("").as_bitcode()
    result = CompileResult._rebuild(context, (name, kind, (binary, empty)), described, *others)
    result.library._get_module_for_linking = cache(module)
    return result


def _types(sig: Any) -> tuple[Any, ...]:
    return tuple(getattr(sig, "args", sig))


class _PrivateFolder(_CacheLocator):  # type: ignore[misc]
    """Temporary folder, used if neither the folder of the source nor the user's cache can be written."""

    def __init__(self, py_file: str) -> None:
        self._py_file = py_file
        self._folder = str(_private_folder() / self.get_suitable_cache_subpath(py_file))

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _PrivateFolder | None:
        """Return the folder for a function, or None if no folder can be written."""
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
        """Return nothing: modification times of sources are not used."""

    def get_disambiguator(self) -> str:
        """Return nothing: `KernelCache` composes the file names."""
        return ""


class _Place(CompileResultCacheImpl):  # type: ignore[misc]
    """Folder in which Numba caches a function (NUMBA_CACHE_DIR, else beside the source, else the user's cache)."""

    _locator_classes = (*CompileResultCacheImpl._locator_classes, _PrivateFolder)


def _place(function: Callable[..., Any]) -> _Place | None:
    """Return the cache folder of a function; None if it has no file, as at a prompt, or if no folder can be written."""
    try:
        return _Place(function)
    except RuntimeError:
        if Path(function.__code__.co_filename).exists():
            _warn("no folder can be written, so every process compiles again")
        return None


@cache
def _private_folder() -> Path:
    """Return a temporary folder to which only this user can write, because code in it is executed."""
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
