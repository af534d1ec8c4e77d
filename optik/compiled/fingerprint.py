"""Fingerprint of everything on which machine code depends: bytecode, values and functions that a kernel reaches by name.

Numba compiles called functions and named globals into a kernel. So the walk follows names: to compiled functions, to helpers,
through modules to their attributes, to closures and default values. It reads no file: what counts is what was imported.
Docstrings, comments, annotations, line numbers and other functions of a file do not affect the machine code and are left
out. Not seen are Numba extensions of foreign functions and types (`overload_method`, `overload_attribute`).
"""

from __future__ import annotations

import dis
import enum
import hashlib
import importlib.util
import inspect
import re
import sys
from functools import cache
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, MethodDescriptorType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import config
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.typing.templates import builtin_registry
from numba.extending import is_jitted

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
