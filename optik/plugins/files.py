"""Files of plug-ins: recognition of paths, import of Python files, and SHA-256.

A Python file is imported only if its path is given. Its module has a name of its own, derived from the absolute path, and
may import the files beside it relatively. A file that has changed since its import is imported anew; if that fails, its
last version stays in use and a warning says so. A run of a suite refuses changed files.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import os
import pickle
import re
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from optik.errors import AssumptionWarning, InvalidInput, OptikError
from optik.file_io import read_bytes

SUFFIXES = (".py", ".toml", ".urdf", ".xml", ".xacro", ".json")
"""Suffixes of plug-ins' files; a name with one of them is a path."""
CODE = (".py", ".xacro")
"""Suffixes of files that are run: a xacro file has expressions."""
MODULES = "optik_plugin_"
"""Begin of the names of the modules of files."""
_FRAGMENT = re.compile(r"(.*\.(?:urdf|xml|xacro)|robot_descriptions:\w+)#(.*)", re.IGNORECASE | re.DOTALL)
"""A URDF file with options behind it: ``arm.urdf#tip=tool0&base=base_link``."""
_importing = threading.RLock()
"""Lock of imports: no thread may get the module of a file that another thread is running."""

_code_forbidden: ContextVar[bool] = ContextVar("code_forbidden", default=False)
_expected: dict[str, str] = {}
"""SHA-256 of files in the recorded run, by absolute path."""


# ---------------------------------------------------------------- paths and their content


def is_path(name: Any) -> bool:
    """Return whether a name is a path: it contains a separator or has the suffix of a plug-in's file."""
    if isinstance(name, os.PathLike):
        return True
    if not isinstance(name, str):
        return False
    text = split_links(name)[0]
    return "/" in text or os.sep in text or Path(text).suffix.lower() in SUFFIXES


def split_links(name: str) -> tuple[str, str]:
    """Split ``arm.urdf#tip=tool0`` into the file and the options, which are empty for any other name."""
    found = _FRAGMENT.fullmatch(name)
    return (found[1], found[2]) if found else (name, "")


def digest(file: Path) -> str:
    """Return the SHA-256 of a file, with the files beside it that it imports: ``sha256sum a.py b.py | sha256sum``."""
    return _digest(_read_with_neighbours(file))


def _digest(sources: Mapping[Path, bytes]) -> str:
    sums = [(hashlib.sha256(source).hexdigest(), file.name) for file, source in sources.items()]
    lines = "".join(f"{found}  {name}\n" for found, name in sums)
    return sums[0][0] if len(sums) == 1 else hashlib.sha256(lines.encode()).hexdigest()


def _read_with_neighbours(file: Path) -> dict[Path, bytes]:
    """Read a file and, for Python, the files beside it that it imports, directly or through each other."""
    found: dict[Path, bytes] = {}
    remaining = [file]
    while remaining:
        one = remaining.pop(0)
        if one in found:
            continue
        found[one] = read_bytes(one, argument=str(one))
        if one.suffix.lower() == ".py":
            beside = (one.with_name(f"{name}.py") for name in _relative_imports(found[one]))
            remaining += [neighbour for neighbour in beside if neighbour.is_file()]
    return found


@lru_cache(maxsize=64)
def _relative_imports(source: bytes) -> tuple[str, ...]:
    """Return the names that Python code imports from its own folder; none if the code cannot be parsed."""
    try:
        nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom) and node.level == 1]
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return ()
    names = (name for node in nodes for name in ([node.module] if node.module else [a.name for a in node.names]))
    return tuple(dict.fromkeys(name.partition(".")[0] for name in names))


# ---------------------------------------------------------------- import


def import_file(file: Path) -> ModuleType:
    """Import a Python file, or return its module if this process has imported this version of it."""
    stem = re.sub(r"\W", "_", file.stem)
    name = f"{MODULES}{stem}_{hashlib.sha256(os.fsencode(file)).hexdigest()[:16]}"
    with _importing:
        module = sys.modules.get(name)
        if module is None:
            return exec_module(file, name)
        if digest(file) == module.__sha256__:
            return module
        before = {key: loaded for key, loaded in sys.modules.items() if key.partition(".")[0] == name}
        for key in before:
            del sys.modules[key]
        try:
            return exec_module(file, name)
        except Exception as error:
            if isinstance(error, OptikError):
                raise
            sys.modules.update(before)
            where = f", line {error.lineno}" if isinstance(error, SyntaxError) else ""
            warnings.warn(
                f"{file.name} has changed and fails ({type(error).__name__}: {error}{where}); its last version stays in use",
                AssumptionWarning, stacklevel=2,
            )  # fmt: skip
            return module


def exec_module(file: Path, name: str) -> ModuleType:
    """Run exactly the bytes of a file's SHA-256, without a bytecode cache, as the module of a name."""
    check_code_allowed(file)
    sources = _read_with_neighbours(file)
    found = _digest(sources)
    _check_expected(file, found)
    spec = ModuleSpec(name, SourceFileLoader(name, str(file)), origin=str(file), is_package=True)
    spec.has_location, spec.submodule_search_locations = True, [str(file.parent)]  # where relative imports search
    module = sys.modules[name] = module_from_spec(spec)
    values = vars(module)
    values["__sha256__"] = found
    importlib.invalidate_caches()  # a neighbour may be newer than the last look at the folder
    try:
        exec(compile(sources[file], str(file), "exec", dont_inherit=True), values)
    except BaseException:
        for loaded in [key for key in sys.modules if key.partition(".")[0] == name]:
            del sys.modules[loaded]
        raise
    for kind in values.values():
        own = isinstance(kind, type) and kind.__module__.partition(".")[0] == name
        if own:
            kind.__sha256__ = found
        if own and kind.__reduce_ex__ is object.__reduce_ex__:
            kind.__reduce_ex__ = _reduce
    name_method(values.get("METHOD"), name, file.stem)
    return module


def name_method(method: Any, module: str, name: str) -> Any:
    """Return a METHOD; a class of this module that states no name gets this one."""
    if isinstance(method, type) and method.__module__ == module and "name" not in vars(method):
        method.name = name  # type: ignore[attr-defined]
    return method


def _reduce(self: Any, protocol: Any) -> Any:
    """Pickle an object of a plug-in's class behind the path of the file, which another process imports first."""
    made = object.__reduce_ex__(self, protocol)
    if isinstance(made, str):
        return made
    file = sys.modules[type(self).__module__.partition(".")[0]].__file__
    return (_rebuild, (file, pickle.dumps(made[:2], protocol)), *made[2:])


def _rebuild(file: str, made: bytes) -> Any:
    """Import the file of a plug-in, and return the object that `_reduce` has pickled, without its state."""
    import_file(Path(file))
    function, arguments = pickle.loads(made)
    return function(*arguments)


@contextmanager
def forbid_code() -> Iterator[None]:
    """Forbid the import of plug-ins' files, for reports and comparisons."""
    token = _code_forbidden.set(True)
    try:
        yield
    finally:
        _code_forbidden.reset(token)


def check_code_allowed(file: Path) -> None:
    """Raise InvalidInput for a file that is run where none may be."""
    if _code_forbidden.get():
        raise InvalidInput(str(file), "a file that is run", "none, because reading a run or a plan runs no code")


def expect(recorded: Iterable[Mapping[str, str]]) -> None:
    """Check that Python files have the recorded SHA-256, now and whenever this process imports them."""
    for row in recorded:
        file = Path(row.get("path", ""))
        if file.suffix.lower() in CODE:
            _expected[str(file)] = row["sha256"]
            _check_expected(file, digest(file))


@contextmanager
def expected(recorded: Iterable[Mapping[str, str]]) -> Iterator[None]:
    """Check that Python files have the recorded SHA-256 until the end of a run."""
    try:
        expect(recorded)
        yield
    finally:
        _expected.clear()


def _check_expected(file: Path, found: str) -> None:
    if _expected.get(str(file), found) != found:
        raise InvalidInput(str(file), "a file that has changed", "the file with the recorded SHA-256")
