"""Fingerprint of everything on which machine code depends: bytecode, values and functions that a function reaches.

Numba compiles called functions and named globals into a function. So the walk follows names: to compiled functions, to
helpers, through modules to their attributes, to closures and default values.
Docstrings, comments, annotations, line numbers and other functions of a file do not affect the machine code and are left
out. A value that the walk cannot analyse is represented by the text of the file that defines its type. Not seen are
Numba extensions for methods and attributes of foreign types (`overload_method`, `overload_attribute`).
"""

from __future__ import annotations

import dis
import enum
import hashlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodDescriptorType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import config
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
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
LOADS_CONSTANT = {dis.opmap[name] for name in ("LOAD_CONST", "RETURN_CONST") if name in dis.opmap}
"""Bytecode instructions that load a constant by its index; which of them exist depends on the version of Python."""
PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), range, np.generic)
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
    walk.note("versions", *VERSIONS, f"OPT {level}", *(f"{name} {getattr(config, name, None)}" for name in SETTINGS))
    try:
        walk.value(kernel)
        for kind in signature:
            walk.argument(kind)
    except RecursionError as error:  # a list that holds itself
        raise Opaque(repr(kernel)) from error
    return walk.digest.hexdigest()


def variant(kernel: Dispatcher, signature: tuple[Any, ...]) -> str:
    """Return a short name of one kernel of a function, from its types of arguments and the plain values in its closure."""
    closed = (_cell(c) for c in kernel.py_func.__closure__ or ())
    parts = [ADDRESS.sub("", str(kind)) for kind in signature] + [repr(v) for v in closed if isinstance(v, PLAIN)]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


class _Walk:
    """One traversal of everything that a function reaches; an object that was visited before is represented by its number."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.met: dict[int, int] = {}
        self.modules: set[tuple[str, frozenset[str]]] = set()

    def note(self, *parts: str | bytes) -> None:
        """Add words to the fingerprint, each with its length, so that different lists of words always differ."""
        for part in parts:
            data = part.encode(errors="surrogatepass") if isinstance(part, str) else part
            self.digest.update(len(data).to_bytes(8, "little") + data)

    def value(self, v: Any, names: Iterable[str] = ()) -> None:
        """Add a value; of a module, only the attributes that the code names."""
        if isinstance(v, enum.Enum):  # before numbers: some enumerations are numbers
            self.note("member", v.name)
            self.value(type(v))
        elif isinstance(v, PLAIN):
            self.note("plain", type(v).__qualname__, repr(v))
        elif isinstance(v, CodeType):
            self._code(v)
        elif isinstance(v, tuple | list):
            self.note("items", type(v).__qualname__, str(len(v)))
            if type(v) not in (tuple, list):
                self.value(type(v))
            for item in v:
                self.value(item)
        elif isinstance(v, frozenset | set | dict):
            self._unordered(v)
        elif isinstance(v, ModuleType):
            self._module(v, frozenset(names))
        elif isinstance(v, NAMED):
            self.note("named", str(type(v)), ADDRESS.sub("", repr(v)))
        elif not self._again(v):
            self._object(v)

    def _object(self, v: Any) -> None:
        """Add the contents of an object on its first visit; later visits add only its number."""
        if isinstance(v, np.ndarray) and not v.dtype.hasobject:
            self.note("array", repr(v.dtype), str(v.shape), str(v.strides), v.tobytes())
        elif is_jitted(v):
            self.note("compiled", repr(sorted(v.targetoptions.items())), repr(v.locals))
            self._function(v.py_func)
        elif isinstance(v, FunctionType):
            self._plain_function(v)
        elif isinstance(v, type):
            self._class(v)
        else:
            self._other(v)

    def argument(self, kind: Any) -> None:
        """Add the type of an argument; functions that are passed and the order of named fields are compiled in."""
        self.note("argument", type(kind).__qualname__, ADDRESS.sub("", str(kind)), repr(getattr(kind, "fields", ())))
        if isinstance(kind, types.Dispatcher):
            self.value(kind.dispatcher)
        elif ADDRESS.search(str(kind)):
            raise Opaque(str(kind))

    def _again(self, v: Any) -> bool:
        """Return whether an object was visited before, because functions may call each other recursively."""
        number = len(self.met)
        known = self.met.setdefault(id(v), number)
        if known != number:
            self.note("again", str(known))
        return known != number

    def _function(self, f: FunctionType) -> None:
        self.note("function", str(f.__module__))
        self._code(f.__code__)
        self.value(f.__defaults__)
        self.value(f.__kwdefaults__)
        for cell in f.__closure__ or ():
            self.value(_cell(cell))
        named = list(_names(f.__code__))
        for name in named:
            if name in f.__globals__:
                self.note("global", name)
                self.value(f.__globals__[name], named)

    def _code(self, code: CodeType) -> None:
        starred = code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS)  # Numba changes others under a profiler
        arguments = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, starred)
        self.note("code", code.co_name, repr(arguments), code.co_code, code.co_exceptiontable)
        for names in (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars):
            self.note(str(len(names)), *names)
        for constant in code.co_consts[1:] if _starts_with_docstring(code) else code.co_consts:
            self.value(constant)

    def _module(self, module: ModuleType, names: frozenset[str]) -> None:
        self.note("module", module.__name__)
        if (module.__name__, names) in self.modules:  # modules hold each other
            return
        self.modules.add((module.__name__, names))
        foreign = _foreign(module.__name__)
        for name in sorted(names):
            # NumPy creates some attributes on access, with warnings; those that compiled code can use exist already.
            attribute = vars(module).get(name, _MISSING) if foreign else getattr(module, name, _MISSING)
            if attribute is not _MISSING:
                self.note("attribute", name)
                self.value(attribute, names)

    def _plain_function(self, f: FunctionType) -> None:
        """Add the Numba overloads (`overload`, `register_jitable`) of a function that is not compiled."""
        self.note("plain function", str(f.__module__), f.__qualname__)
        if _foreign(f.__module__):
            return
        for taught in _overloads(f):
            self.note("overload", _text(taught.__module__))
            self._function(taught)

    def _class(self, c: type) -> None:
        self.note("class", c.__module__, c.__qualname__)
        if _foreign(c.__module__) or issubclass(c, BaseException):  # of an exception, machine code holds the name only
            return
        if hasattr(c, "class_type"):
            raise Opaque(repr(c))  # a `jitclass`: its methods are compiled elsewhere
        if issubclass(c, tuple) and hasattr(c, "_fields"):  # a named tuple: compiled code sees its fields only
            self.value(c._fields)
            self.value(getattr(c, "_field_defaults", {}))
        elif issubclass(c, enum.Enum):
            self.value({name: member.value for name, member in c.__members__.items()})
        else:
            self.note(*(_text(base.__module__) for base in c.__mro__ if not _foreign(base.__module__)))

    def _unordered(self, v: Any) -> None:
        """Add a set or dictionary, sorted by the digests of its items: the hash order of strings differs in every process."""
        parts = []
        for item in v.items() if isinstance(v, dict) else v:
            alone = _Walk()
            alone.value(item)
            parts.append(alone.digest.digest())
        self.note("unordered", type(v).__qualname__, *sorted(parts))

    def _other(self, v: Any) -> None:
        """Add any other object: an intrinsic by its definition, others by their pickle, both with the text of their file."""
        made = getattr(v, "_defn", None)
        self.note("other", type(v).__module__, type(v).__qualname__)
        if isinstance(made, FunctionType):
            self.note(repr(getattr(v, "_prefer_literal", None)), repr(getattr(v, "_ctor_kwargs", None)))
            self.note(_text(made.__module__))
            self._function(made)
            return
        try:
            self.note(dumps(v))
        except Exception as error:  # whatever a foreign object's pickling raises
            raise Opaque(repr(v)) from error
        for module in {type(v).__module__, str(getattr(v, "__module__", type(v).__module__))}:
            if not _foreign(module):
                self.note(_text(module))


_MISSING = object()
"""Value of an attribute that a module lacks, because None may be a value."""


def _foreign(module: str | None) -> bool:
    return (module or "").partition(".")[0] in FOREIGN


def _cell(cell: Any) -> Any:
    """Return the value of a closure's cell; None if it is not yet bound."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def _names(code: CodeType) -> dict[str, None]:
    """Return the names of globals and attributes in a function and its inner functions, in the order of the code."""
    names = dict.fromkeys(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names(constant)
    return names


@cache
def _starts_with_docstring(code: CodeType) -> bool:
    """Return whether the first constant is a docstring: a text that no instruction loads."""
    if not (code.co_consts and isinstance(code.co_consts[0], str)):
        return False
    instructions = zip(code.co_code[::2], code.co_code[1::2], strict=True)
    return not any(argument == 0 and operation in LOADS_CONSTANT for operation, argument in instructions)


def _overloads(f: FunctionType) -> list[FunctionType]:
    """Return the overloads that Numba compiles in place of a plain function."""
    kinds = [kind for known, kind in builtin_registry.globals if known is f]
    found = [getattr(template, "_overload_func", None) for kind in kinds for template in getattr(kind, "templates", ())]
    return [taught for taught in found if isinstance(taught, FunctionType)]


def _text(module: str | None) -> bytes:
    """Return the text of a module's file."""
    try:
        return Path(str(getattr(sys.modules.get(str(module)), "__file__", None))).read_bytes()
    except OSError as error:
        raise Opaque(str(module)) from error
