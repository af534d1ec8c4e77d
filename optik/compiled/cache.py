"""Machine code of compiled functions: cached on this machine by a fingerprint of what it depends on, or from an archive."""

from __future__ import annotations

import atexit
import contextlib
import dis
import enum
import hashlib
import importlib.util
import inspect
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
import uuid
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, MethodDescriptorType, ModuleType
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba import types
from numba.core import config
from numba.core.caching import CompileResultCacheImpl, _Cache, _CacheLocator
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.serialize import dumps
from numba.core.typing.templates import builtin_registry
from numba.extending import is_jitted

from optik.compiled import archive

# ---------------- fingerprint of everything on which machine code depends


FOREIGN = {"numpy", "numba", "llvmlite"} | set(sys.stdlib_module_names)
"""Packages whose functions are identified by name; `VERSIONS` holds their releases, of NumPy the major version only."""
VERSIONS = (
    f"numba {numba.__version__}",
    f"llvmlite {llvmlite.__version__}",
    f"numpy {np.__version__.partition('.')[0]}",
    f"Python {sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')} {importlib.util.MAGIC_NUMBER.hex()}",
)
"""Versions that the machine code depends on: a patch of Python or a minor release of NumPy changes neither bytecode nor ABI."""
MOST_OPT = 1
"""Highest LLVM optimisation level of serial kernels. Parallel kernels use Numba's: only they are faster at a higher one."""
SETTINGS = ("BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")
"""Settings of Numba, beside the optimisation level, that change the machine code of a function."""
LOADS_CONSTANT = [dis.opmap[name] for name in ("LOAD_CONST", "RETURN_CONST") if name in dis.opmap]
"""Bytecode instructions that load a constant by its index; which of them exist depends on the version of Python."""
PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), range, slice, enum.Enum, np.generic)
"""Types whose values are described completely by their `repr`."""
NAMED = (BuiltinFunctionType, MethodDescriptorType, np.ufunc, np.dtype, types.Type)
"""Types whose values are identified by name, because `VERSIONS` holds the release of their code."""
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
"""Memory address in a `repr`: it differs in every process."""


class Opaque(Exception):
    """A value cannot be fingerprinted, so the function must be compiled again in every process."""


def fingerprint(kernel: Dispatcher, signature: tuple[Any, ...]) -> str:
    """Return the fingerprint of everything that the machine code of a kernel depends on."""
    walk = _Walk()
    level = int(config.OPT if kernel.targetoptions.get("nogil") else min(config.OPT, MOST_OPT))
    walk.note(VERSIONS, level, [getattr(config, name, None) for name in SETTINGS])
    walk.value(kernel)
    for kind in signature:
        walk.argument(kind)
    return walk.digest.hexdigest()


def variant(kernel: Dispatcher, signature: tuple[Any, ...]) -> str:
    """Return a short name of one kernel of a function, from its types of arguments and the plain values in its closure."""
    closed = _closure_of(kernel.py_func)
    parts = [ADDRESS.sub("", str(kind)) for kind in signature] + [repr(v) for v in closed if isinstance(v, PLAIN)]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


class _Walk:
    """One traversal of everything that a kernel reaches; what was visited before is represented by its number."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.met: dict[Any, int] = {}

    def note(self, *words: Any) -> None:
        """Add plain values to the fingerprint, so that different lists of them always differ."""
        self.digest.update(ascii(words).encode())

    def value(self, v: Any, names: frozenset[str] = frozenset()) -> None:
        """Add a value; of a module, only the attributes that the code names."""
        if isinstance(v, PLAIN):
            self.note(type(v).__qualname__, v)
        elif isinstance(v, tuple):
            self.note("items", len(v))
            for item in v if type(v) is tuple else (type(v), *v):
                self.value(item)
        elif isinstance(v, frozenset):  # the hash order of strings differs in every process
            self.note("set", sorted(map(repr, v)))
        elif isinstance(v, np.ndarray) and not v.dtype.hasobject:
            self.note("array", repr(v.dtype), v.shape, v.strides, v.tobytes())
        elif isinstance(v, CodeType):
            self._code(v)
        elif isinstance(v, NAMED) or _foreign(v):
            name = (
                v.__name__ if isinstance(v, ModuleType) else ADDRESS.sub("", repr(v))
            )  # a module's repr has its folder
            self.note("named", type(v).__qualname__, getattr(v, "__module__", ""), name)
        else:
            number = len(self.met)
            known = self.met.setdefault((id(v), names if isinstance(v, ModuleType) else None), number)
            self.note("object", known)
            if known == number:  # functions and modules may reach each other in a circle
                self._object(v, names)

    def argument(self, kind: Any) -> None:
        """Add the type of an argument; functions that are passed and the order of named fields are compiled in."""
        self.note("argument", type(kind).__qualname__, ADDRESS.sub("", str(kind)), getattr(kind, "fields", ()))
        if isinstance(kind, types.Dispatcher):
            self.value(kind.dispatcher)
        elif ADDRESS.search(str(kind)):
            raise Opaque(str(kind))

    def _object(self, v: Any, names: frozenset[str]) -> None:
        """Add the contents of an object on its first visit."""
        if isinstance(v, ModuleType):
            self._globals({name: getattr(v, name) for name in names if hasattr(v, name)}, names)
        elif is_jitted(v):
            self.note("compiled", repr(sorted(v.targetoptions.items())), repr(v.locals))
            self._function(v.py_func)
        elif isinstance(v, _Intrinsic):
            self.note("intrinsic", v._prefer_literal, repr(v._ctor_kwargs))
            self._function(v._defn)
        elif isinstance(v, FunctionType):
            self._function(v)
            for taught in _overloads(v):
                self.value(taught)
        elif isinstance(v, type) and issubclass(v, BaseException | enum.Enum | tuple):  # compiled code sees no methods
            self.note("class", v.__qualname__, repr(getattr(v, "__members__", "")), getattr(v, "_fields", ""))
            self.value(tuple(getattr(v, "_field_defaults", {}).items()))
        else:
            raise Opaque(repr(v))

    def _function(self, f: FunctionType) -> None:
        self.note("function", f.__module__)
        names = _names(f.__code__)
        for v in (f.__code__, f.__defaults__, tuple((f.__kwdefaults__ or {}).items()), *_closure_of(f)):
            self.value(v, names)
        self._globals({name: f.__globals__[name] for name in names & f.__globals__.keys()}, names)

    def _globals(self, found: dict[str, Any], names: frozenset[str]) -> None:
        """Add values by their names."""
        self.note(sorted(found))
        for name in sorted(found):
            self.value(found[name], names)

    def _code(self, code: CodeType) -> None:
        starred = code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS)  # Numba changes others under a profiler
        self.note(code.co_name, code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, starred)
        self.note(code.co_code, code.co_exceptiontable, code.co_names)
        self.note(code.co_varnames, code.co_freevars, code.co_cellvars)
        self.value(code.co_consts[_starts_with_docstring(code) :])


def _foreign(v: Any) -> bool:
    """Return whether a function, class or module is of a foreign package."""
    module = v.__name__ if isinstance(v, ModuleType) else getattr(v, "__module__", None)
    return hasattr(v, "__name__") and (module or "").partition(".")[0] in FOREIGN


def _closure_of(f: Any) -> list[Any]:
    """Return the values of a function's closure; of a cell that is not yet bound, nothing."""
    return [c.cell_contents for c in f.__closure__ or () if c != CellType()]


def _names(code: CodeType) -> frozenset[str]:
    """Return the names of globals and attributes in a function and its inner functions."""
    return frozenset(code.co_names).union(*(_names(c) for c in code.co_consts if isinstance(c, CodeType)))


@cache
def _starts_with_docstring(code: CodeType) -> bool:
    """Return whether the first constant is a docstring: a text that no instruction loads."""
    if not (code.co_consts and isinstance(code.co_consts[0], str)):
        return False
    instructions = zip(code.co_code[::2], code.co_code[1::2], strict=True)
    return not any(argument == 0 and operation in LOADS_CONSTANT for operation, argument in instructions)


def _overloads(f: FunctionType) -> list[FunctionType]:
    """Return the functions that Numba compiles in place of a plain function (`overload`, `register_jitable`)."""
    kinds = [kind for known, kind in builtin_registry.globals if known is f]
    found = [getattr(template, "_overload_func", None) for kind in kinds for template in getattr(kind, "templates", ())]
    return [taught for taught in found if isinstance(taught, FunctionType)]


# ---------------- machine code of compiled functions


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
                f"OPTIK_COMPILES=error forbids to compile {self._stem()}{sig}: see the command `optik kernels`, or unset it"
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
