"""Plug-in files: paths, imports and SHA-256; permission and records in a run's manifest; options of methods.

A Python file is imported only if its path is given. Its module has a name of its own, derived from the absolute path, and
may import the files beside it relatively. A file that has changed since its import is imported anew; if that fails, its
last version stays in use and a warning says so. A run of a suite refuses changed files.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import inspect
import os
import pickle
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from difflib import get_close_matches
from functools import lru_cache
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.metadata import EntryPoint
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from optik.errors import AssumptionWarning, InvalidInput, OptikError
from optik.file_io import read_bytes

# ---------------- files of plug-ins


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
    digest = _digest(sources)
    _check_expected(file, digest)
    spec = ModuleSpec(name, SourceFileLoader(name, str(file)), origin=str(file), is_package=True)
    spec.has_location, spec.submodule_search_locations = True, [str(file.parent)]  # where relative imports search
    module = sys.modules[name] = module_from_spec(spec)
    values = vars(module)
    values["__sha256__"] = digest
    importlib.invalidate_caches()  # a neighbour may be newer than the last look at the folder
    try:
        exec(compile(sources[file], str(file), "exec", dont_inherit=True), values)
    except BaseException:
        for loaded in [key for key in sys.modules if key.partition(".")[0] == name]:
            del sys.modules[loaded]
        raise
    for kind in values.values():
        is_inside = isinstance(kind, type) and kind.__module__.partition(".")[0] == name
        if is_inside:
            kind.__sha256__ = digest
        if is_inside and kind.__reduce_ex__ is object.__reduce_ex__:
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


# ---------------- the plug-ins in a suite's settings


class UsedPlugin(NamedTuple):
    """A plug-in in settings: its group, its name in reports, and the file or entry point that it comes from."""

    group: str
    name: str
    source: Path | EntryPoint


class _Reading(NamedTuple):
    """Settings that are being read: the folder of relative paths, and the plug-ins found so far."""

    folder: Path | None
    used: list[UsedPlugin]


_reading: ContextVar[_Reading | None] = ContextVar("reading", default=None)


DATA = "files"
"""Group of data files in settings: poses and motions."""


def resolve_data_file(name: str, kind: str) -> str:
    """Return the absolute path of an existing data file, and note the file for the manifest."""
    if not isinstance(name, str) or not name:
        raise InvalidInput(kind, repr(name)[:60], "the path of a file")
    file = resolve_file(name, kind, "a file; its path starts at the suite's folder")
    if not in_finished_run():
        note(UsedPlugin(DATA, file.name, file))
    return str(file)


def resolve_data_files(name: str, find: Callable[[Path], list[Path]]) -> tuple[str, ...]:
    """Return the absolute paths of the files that belong to a file or a folder, and note them for the manifest."""
    reading = _reading.get()
    if in_finished_run():
        return (name,)
    files = find(Path((reading and reading.folder) or Path(), name).resolve())
    for file in files:
        note(UsedPlugin(DATA, file.name, file))
    return tuple(map(str, files))


def resolve_file(name: str | os.PathLike[str], kind: str, expected: str = "") -> Path:
    """Return the absolute path of an existing file of a plug-in."""
    text = split_links(os.fspath(name))[0]
    reading = _reading.get()
    if reading is not None and reading.folder is None:
        return Path(text)  # a finished run: its files are not read
    try:
        file = ((reading.folder or Path()) / text if reading else Path(text)).resolve()
        there = file.is_file()
    except (OSError, ValueError):  # ValueError: a NUL in the name
        file, there = Path(text), False
    if not there:
        beside = suggest_file(text)
        expected = expected or f"a file, because a name with a separator or one of {', '.join(SUFFIXES)} is a path"
        raise InvalidInput(kind, f"{text!r}, which is no file", f"{beside}, which is one" if beside else expected)
    return file


def suggest_file(name: str, suffixes: Iterable[str] = SUFFIXES) -> str:
    """Return an existing file whose name lacks only the suffix, or an empty string."""
    reading = _reading.get()
    folder = (reading and reading.folder) or Path()
    try:
        return next((name + suffix for suffix in suffixes if (folder / (name + suffix)).is_file()), "")
    except (OSError, ValueError):  # ValueError: a NUL in the name
        return ""


@contextmanager
def collect_plugins(folder: Path | None) -> Iterator[list[UsedPlugin]]:
    """Collect the plug-ins of settings that are read inside this context; relative paths start at a folder."""
    used: list[UsedPlugin] = []
    token = _reading.set(_Reading(folder, used))
    try:
        yield used
    finally:
        _reading.reset(token)


def note(plugin: UsedPlugin) -> None:
    """Add a plug-in to those of the settings that are being read."""
    current = _reading.get()
    if current is None or plugin in current.used:
        return
    for other in current.used:
        if other[:2] == plugin[:2]:
            both = f"{other.source} and {plugin.source}, both called {plugin.name}"
            raise InvalidInput(plugin.group, both, "files of different names")
    current.used.append(plugin)


def in_finished_run() -> bool:
    """Return whether the settings of a finished run are being read."""
    current = _reading.get()
    return current is not None and current.folder is None


def check_allowed(used: Iterable[UsedPlugin], allowed: bool) -> None:
    """Raise InvalidInput for files that are run in a suite unless they are allowed."""
    sources = {source for *_, source in used if isinstance(source, Path)}
    files = sorted(str(source) for source in sources if source.suffix.lower() in CODE)
    if files and not allowed:
        expected = "allow_plugins=True: the suite runs Python code from these files"
        raise InvalidInput("suite", f"the plug-ins {', '.join(files)}", expected)


def record_plugins(used: Iterable[UsedPlugin]) -> list[dict[str, str]]:
    """Return the plug-ins as plain data for a run's manifest."""
    rows = []
    for group, name, source in used:
        if isinstance(source, Path):
            about = {"path": str(source), "sha256": digest(source)}
        else:
            dist = source.dist
            about = {"distribution": dist.name if dist else "", "version": dist.version if dist else ""}
        rows.append({"group": group, "name": name} | about)
    return sorted(rows, key=lambda row: (row["group"], row["name"]))


def check_same_plugins(recorded: Sequence[Mapping[str, str]], now: Sequence[Mapping[str, str]]) -> None:
    """Raise InvalidInput if the plug-ins differ from those of the run's begin."""
    before, after = ({(row["group"], row["name"]): row for row in rows} for rows in (recorded, now))
    for key in sorted(before.keys() | after.keys()):
        if _content(before.get(key)) != _content(after.get(key)):
            advice = "restore it, or begin a run in another folder"
            expected = f"{_words(before.get(key))}, as when the run began; {advice}"
            what = f"file {key[1]}" if key[0] == DATA else f"plug-in {key[1]} ({key[0]})"
            raise InvalidInput(what, _words(after.get(key)), expected)


def _content(row: Mapping[str, str] | None) -> dict[str, str] | None:
    """Return a record without the path of the file."""
    return None if row is None else {key: value for key, value in row.items() if key != "path"}


def _words(row: Mapping[str, str] | None) -> str:
    if row is None:
        return "none"
    if "sha256" in row:
        return f"{row['path']} with SHA-256 {row['sha256'][:16]}…"
    return f"{row['distribution']} {row['version']}"


# ---------------- options of methods


NO_DEFAULT = inspect.Parameter.empty
"""Default of a required option."""
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
"""Heading of a section of a NumPy docstring."""
_UNIT = re.compile(r"\[((?:rad|m|s|kg|N|deg|degrees|mm|µs|ms|Hz|1|1/s)(?:[/,^·², ³](?:\w|[/²³^,· ])*)?)\]")
"""A unit in square brackets."""


class ParameterDoc(NamedTuple):
    """The documentation of one parameter: its type as written, its description on one line, and the first unit in it or ""."""

    type: str
    meaning: str
    unit: str


def read_parameter_docs(kinds: type | Any) -> dict[str, ParameterDoc]:
    """Return the documentation of a function's or class's parameters and attributes by name."""
    found: dict[str, ParameterDoc] = {}
    for one in inspect.getmro(kinds) if inspect.isclass(kinds) else (kinds,):
        doc = vars(one).get("__doc__") if inspect.isclass(one) else one.__doc__
        for name, value in _entries(inspect.cleandoc(doc or "")):
            found.setdefault(name, value)
    return found


def _entries(doc: str) -> Iterable[tuple[str, ParameterDoc]]:
    """List the entries of the sections Parameters and Attributes of a docstring."""
    parts = _SECTION.split(doc)
    for title, body in zip(parts[1::2], parts[2::2], strict=True):
        if title not in ("Parameters", "Attributes"):
            continue
        for entry in re.split(r"\n(?=\S)", body.strip("\n")):
            head, _, text = entry.partition("\n")
            names, _, kind = head.partition(" : ")
            meaning = " ".join(text.split())
            unit = _UNIT.search(f"{meaning} {kind}")
            for name in names.split(","):
                yield name.strip(), ParameterDoc(kind.strip(), meaning, unit[1] if unit else "")


def defaults(method: Any) -> dict[str, Any]:
    """Return the options of a method with their defaults: keyword arguments of a function, or of a class's ``__init__``."""
    found: dict[str, Any] = {}
    for one in inspect.getmro(method) if inspect.isclass(method) else (method,):
        function = vars(one).get("__init__") if inspect.isclass(one) else one
        if function is None or one is object:
            continue
        parameters = inspect.signature(function).parameters.values()
        for parameter in parameters:
            if parameter.kind is parameter.KEYWORD_ONLY:
                found.setdefault(parameter.name, parameter.default)
        if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            break
    return found


def find_nearest_name(name: str, known: Iterable[str]) -> str:
    """Return the known name with the most similar spelling, or an empty string."""
    return next(iter(get_close_matches(name, list(known), n=1)), "")
