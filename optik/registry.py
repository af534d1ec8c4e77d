"""Methods, laws, robots and suites by name: the files of a folder, and plug-ins."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, NamedTuple

from optik.check import check_kind
from optik.errors import InvalidInput, MissingDependency, UnknownName
from optik.plugins import files
from optik.plugins.files import UsedPlugin

GROUPS = (
    "optik.ik",
    "optik.robots",
    "planners.timing",
    "planners.limits",
    "planners.paths",
    "planners.freedom",
    "planners.search",
    "planners.files",
    "planners.cell.drives",
    "benchmarks.problems",
    "benchmarks.peers.ik",
    "benchmarks.peers.laws",
    "benchmarks.blocks",
    "benchmarks.suites",
)
"""All groups: names of packages and of groups of entry points. For listings only."""
DIGITS = 6
"""Digits of the SHA-256 of a file in labels."""
METHOD_LINE = re.compile(r"^METHOD\b", re.MULTILINE)
"""What a module with a method contains; other files of a folder are shared between its methods."""
_DATA_GROUPS = ("optik.robots", "benchmarks.suites")
"""Groups of data files; importing them would hide `optik.robots()` behind a module."""
_OURS = ("optik", "planners", "benchmarks")
"""Our packages: if one of their modules is missing, no dependency is."""
_loaded: dict[tuple[str, str], tuple[str, Any]] = {}
"""Plug-ins that this process has loaded, by group and name: the source, and the method."""


class ClassName:
    """Default ``name`` of a class: its own in lower case, and not stored, so that its file can give it another one."""

    def __get__(self, method: object, kind: type) -> str:
        return kind.__name__.lower()


class RefusedEntryPoint(NamedTuple):
    """An entry point that cannot be used: its registration, the object (module:object), its package, and the reason."""

    group: str
    name: str
    value: str
    distribution: str
    reason: str


# ---------------------------------------------------------------- names


def names(group: str) -> tuple[str, ...]:
    """Return the sorted names in a group, of optik and of installed packages, without importing them."""
    return tuple(sorted({*own_names(group), *find_installed(group)}))


def find_installed(group: str) -> dict[str, EntryPoint]:
    """Return the usable entry points of a group by name, without importing them."""
    return {name: points[0] for name, points in entry_points(group).items() if not _reason(group, name, len(points))}


def find_refused(group: str) -> tuple[RefusedEntryPoint, ...]:
    """Return the entry points of a group that cannot be used, with the reasons."""
    return tuple(
        RefusedEntryPoint(group, name, point.value, describe_distribution(point), reason)
        for name, points in sorted(entry_points(group).items())
        if (reason := _reason(group, name, len(points)))
        for point in points
    )


def check_name(group: str, name: Any, kind: str) -> str:
    """Check a name without running code; return it, a path as an absolute one."""
    if files.in_finished_run() and isinstance(name, str | os.PathLike):
        return str(os.fspath(name))  # its file may be gone, its package not installed
    if files.is_path(name):
        text = str(os.fspath(name))
        file = files.resolve_file(text, kind)
        _check_stem(group, file, kind)
        files.note(UsedPlugin(group, file.stem, file))
        return f"{file}{text[len(files.split_links(text)[0]) :]}"
    point = _entry_point(group, name, kind)
    if point is not None:
        files.note(UsedPlugin(group, name, point))
    return str(name)


def label(method: Any) -> str:
    """Return the name of a built method in results; that of a file has the first digits of the file's SHA-256 behind it."""
    digits = getattr(type(method), "__sha256__", "")[:DIGITS]
    return f"{method.name}@{digits}" if digits else str(method.name)


def short_name(name: Any) -> str:
    """Return the name of a method or robot in reports: its name, or the stem of its file."""
    if not isinstance(name, str | os.PathLike):
        return str(name.name)
    text = os.fspath(name)
    if not files.is_path(name):
        return text
    file, links = files.split_links(text)
    words = links.replace("=", " ").replace("&", ", ")
    own = Path(file).stem in own_names("optik.robots")  # the suffix tells a vendor's ur5e.urdf from our ur5e
    short = Path(file).name if own else Path(file).stem
    return f"{short} ({words})" if words else short


def find_loaded(group: str, name: str) -> Any | None:
    """Return a method by its name without running a file, or None: built in, an entry point, or loaded in this process.

    Files of motions and runs contain names of methods; reading them must not run code of their choice.
    """
    if not isinstance(name, str) or files.is_path(name):
        return None
    if name in own_names(group) or name in find_installed(group):
        return load_method(group, name)
    found = _loaded.get((group, name))
    return None if found is None else found[1]


# ---------------------------------------------------------------- what the names mean


def data_file(group: str, name: str | os.PathLike[str], kind: str) -> Path:
    """Return the path of a data file: built in, of an entry point, or the given path."""
    if files.is_path(name):
        file = files.resolve_file(name, kind)
        _check_stem(group, file, kind)
        return file
    point = _entry_point(group, name, kind)
    if point is None:
        return _folder(group) / f"{name}.toml"
    value = _value(point, kind)
    check_kind(value, _where(point), str | os.PathLike, "the path of a file")
    return files.resolve_file(Path(value).absolute(), kind)


def load_method(group: str, name: str | os.PathLike[str] | type, kind: str = "method") -> Any:
    """Return a method: a class, the ``METHOD`` of a module or of a file, or the object of an entry point."""
    if isinstance(name, type):
        where = f"class {name.__name__}"
        return _check_method(group, name, str(getattr(name, "name", name.__name__)), where)
    if files.is_path(name):
        return _from_file(group, files.resolve_file(name, kind), kind)
    point = _entry_point(group, name, kind)
    if point is not None:
        method = _check_method(group, _value(point, kind), str(name), _where(point))
        _loaded[group, str(name)] = _where(point), method
        return method
    with _name_dependency(kind, str(name)):
        module = importlib.import_module(f"{group}.{name}")
    return files.name_method(module.METHOD, module.__name__, str(name))


def build_method(group: str, name: str | os.PathLike[str] | type, kind: str, *arguments: Any, **options: Any) -> Any:
    """Call a method, given by name, file or class; raise InvalidInput for wrong options."""
    method = load_method(group, name, kind)
    try:
        return method(*arguments, **options)
    except TypeError as error:
        wrong = re.search(r"(got an unexpected keyword|missing \d+ required|takes no argument).*", str(error))
        if wrong is None:
            raise
        given, known = ", ".join(options) or "none", files.defaults(method)
        expected = f"options of the {kind} {short_name(name)!r}"
        meant = [near for option in options if option not in known and (near := files.find_nearest_name(option, known))]
        expected += f", such as {', '.join(meant)}" if meant else ""
        raise InvalidInput("options", f"{given} ({wrong[0]})", expected) from None


# ---------------------------------------------------------------- ours


@cache
def _folder(package: str) -> Path:
    top, *inner = package.split(".")
    spec = importlib.util.find_spec(top)  # for a subpackage, it would import the parents
    locations = spec.submodule_search_locations if spec is not None else None
    folder = Path(next(iter(locations))).joinpath(*inner) if locations else Path()
    if not locations or not folder.is_dir():
        raise ValueError(f"{package} is not a package")
    return folder


def own_names(group: str) -> set[str]:
    """Return the names of the built-in methods or data of a group."""
    return set(_find_own(_folder(group)))


@cache
def _find_own(folder: Path) -> frozenset[str]:
    """Return the stems of the data files in a folder, and of the modules and packages that define a ``METHOD``."""
    found = {file.stem for file in folder.glob("*.toml")}
    for file in [*folder.glob("*.py"), *folder.glob("*/__init__.py")]:
        name = file.stem if file.parent == folder else file.parent.name
        if name != "base" and not name.startswith("_") and METHOD_LINE.search(file.read_text("utf-8")):
            found.add(name)
    return frozenset(found)


# ---------------------------------------------------------------- from outside


def entry_points(group: str) -> Mapping[str, Sequence[EntryPoint]]:
    """Return the entry points of installed packages in a group by name, without importing them."""
    found: dict[str, list[EntryPoint]] = {}
    for point in _installed(group, tuple(sys.path)):
        found.setdefault(point.name, []).append(point)
    return found


@lru_cache(maxsize=64)
def _installed(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group along ``sys.path``; cached, because the search takes milliseconds."""
    return tuple(importlib.metadata.entry_points(group=group))


def describe_distribution(point: EntryPoint) -> str:
    """Return the name and version of an entry point's package."""
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "an unknown package"


def _entry_point(group: str, name: Any, kind: str) -> EntryPoint | None:
    """Return the entry point of a name, None for a built-in name."""
    if not isinstance(name, str):
        raise InvalidInput(kind, repr(name)[:60], f"a name, one of: {', '.join(names(group))}")
    if name in own_names(group):
        return None
    points = entry_points(group).get(name, ())
    if not points:
        file = files.suggest_file(name, files.SUFFIXES if group in _DATA_GROUPS else (".py",))
        raise UnknownName(kind, name, names(group), f"for a file write ./{file}" if file else "")
    reason = _reason(group, name, len(points))
    if reason:
        both = " and ".join(describe_distribution(point) for point in points)
        raise InvalidInput(kind, f"{name!r} of {both}", f"a name that can be used: this one is refused, {reason}")
    return points[0]


def _reason(group: str, name: str, count: int) -> str:
    """Return why the entry points of a name cannot be used, or an empty string."""
    if name in own_names(group):
        return f"it has the name of one of ours, {group}.{name}, which cannot be replaced"
    if count > 1:
        return f"{count} packages register it"
    return "it means a path" if files.is_path(name) else ""


def _value(point: EntryPoint, kind: str) -> Any:
    """Import the object of an entry point."""
    with _name_dependency(kind, point.name):
        value: Any = importlib.import_module(point.module)
    for part in filter(None, (point.attr or "").split(".")):
        if not hasattr(value, part):
            raise InvalidInput(_where(point), f"no {part} in it", "the name of an object that exists")
        value = getattr(value, part)
    return value


def _where(point: EntryPoint) -> str:
    return f"entry point {point.name} = {point.value} of {describe_distribution(point)}"


def _check_stem(group: str, file: Path, kind: str) -> None:
    """Raise InvalidInput if a built-in method, an entry point or another loaded file has the name of a file."""
    name, other = file.stem, ""
    if name in own_names(group):
        if (
            group == "optik.robots" and file.suffix.lower() != ".py"
        ):  # a vendor's ur5e.urdf: `short_name` tells both apart
            return
        other = f"one of ours, {group}.{name}"
    elif points := entry_points(group).get(name, ()):
        other = f"an entry point of {' and '.join(describe_distribution(point) for point in points)}"
    elif _loaded.get((group, name), (str(file),))[0] != str(file):
        other = f"another file, {_loaded[group, name][0]}"
    if other:
        raise InvalidInput(kind, f"{str(file)!r}, which is called {name} as is {other}", "a file of another name")


def _from_file(group: str, file: Path, kind: str) -> Any:
    _check_stem(group, file, kind)
    if file.suffix.lower() != ".py":
        raise InvalidInput(kind, repr(str(file)), "a Python file (.py)")
    with _name_dependency(kind, file.stem):
        module = files.import_file(file)
    if not hasattr(module, "METHOD"):
        raise InvalidInput(str(file), "no METHOD", f"a line METHOD = …, {_describe_base(_find_base(group))}")
    method = _check_method(group, module.METHOD, file.stem, f"METHOD of {file}")
    _loaded[group, file.stem] = str(file), method
    return method


# ---------------------------------------------------------------- what a METHOD must be


def _find_base(group: str) -> Any:
    """Return the base class of a group's methods, ``METHOD_BASE`` of its module ``base``; None for data and functions."""
    return None if group in _DATA_GROUPS else getattr(importlib.import_module(f"{group}.base"), "METHOD_BASE", None)


def _describe_base(base: Any) -> str:
    """Describe the METHOD that a group requires."""
    if base is None:
        return "a function or a class"
    places = (base.__module__.removesuffix(".base"), base.__module__.partition(".")[0], base.__module__)
    known = (place for place in places if getattr(sys.modules.get(place), base.__name__, None) is base)
    return f"a subclass of {next(known)}.{base.__name__}"


def _check_method(group: str, method: Any, name: str, where: str) -> Any:
    """Check the type and name of a plug-in's method, and return the method."""
    base = _find_base(group)
    if base is None:
        if not callable(method) and group != "optik.robots":
            raise InvalidInput(where, repr(method)[:60], _describe_base(base))
        return method
    if isinstance(method, base):
        kind_name = type(method).__name__
        raise InvalidInput(where, f"an object of the class {kind_name}", f"the class, METHOD = {kind_name}")
    if not (isinstance(method, type) and issubclass(method, base)):
        raise InvalidInput(where, repr(method)[:60], _describe_base(base))
    kind: Any = method
    asked = {a for k in base.__mro__ for a, t in vars(k).get("__annotations__", {}).items() if "ClassVar" in str(t)}
    if "name" in asked and getattr(kind, "name", name) != name:
        raise InvalidInput(where, f"the name {kind.name!r}", f"name = {name!r} in the class")
    missing = sorted({*getattr(kind, "__abstractmethods__", ()), *(a for a in asked if not hasattr(kind, a))})
    if missing:
        raise InvalidInput(
            where, f"{kind.__name__} without {', '.join(missing)}", f"{_describe_base(base)} that defines them"
        )
    return kind


@contextmanager
def _name_dependency(kind: str, name: str) -> Iterator[None]:
    """Raise `MissingDependency` for a package that is missing during the import of a method."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if not package or package in _OURS or package.startswith(files.MODULES):
            raise
        raise MissingDependency(package, f"{kind} {name!r}", _extra_with(package)) from error


def _extra_with(package: str) -> str | None:
    """Return the extra of this distribution that installs a package, or None."""
    wanted = re.sub(r"[-_.]+", "-", package).lower()
    try:
        requires = importlib.metadata.requires("optik-toolkit") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    for line in requires:
        named = re.match(r"[A-Za-z0-9_.-]+", line)
        extra = re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", line)
        if named and extra and re.sub(r"[-_.]+", "-", named[0]).lower() == wanted:
            return extra[1]
    return None
