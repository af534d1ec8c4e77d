"""Methods from outside: what a METHOD must be in its group, checked before anybody builds it."""

from __future__ import annotations

import importlib
import importlib.metadata
import re
import sys
from typing import Any

from optik.errors import InvalidInput, MissingDependency

DATA_GROUPS = ("optik.robots", "benchmarks.suites")
"""Groups of data: folders that are not imported, which would put the module in the place of `optik.robots()`."""

_OURS = ("optik", "planners", "benchmarks")
"""Our packages: a module of theirs that is missing is a bug of ours, not a missing dependency."""


def find_base(group: str) -> Any:
    """Return the class that the methods of a group are subclasses of: ``METHOD_BASE`` of the group's module ``base``."""
    if group in DATA_GROUPS:
        return None
    try:
        return getattr(importlib.import_module(f"{group}.base"), "METHOD_BASE", None)
    except ModuleNotFoundError as error:
        if error.name != f"{group}.base":
            raise
        return None


def describe_base(base: Any) -> str:
    """Return what a METHOD must be, in words."""
    if base is None:
        return "a function or a class"
    places = (base.__module__.removesuffix(".base"), base.__module__.partition(".")[0], base.__module__)
    known = (place for place in places if getattr(sys.modules.get(place), base.__name__, None) is base)
    return f"a subclass of {next(known)}.{base.__name__}"


def check_method(group: str, method: Any, name: str, where: str) -> Any:
    """Return a method from outside once it is of the kind that the group needs and bears its name."""
    base = find_base(group)
    if base is None:
        if not callable(method) and group != "optik.robots":
            raise InvalidInput(where, repr(method)[:60], describe_base(base))
        return method
    if isinstance(method, base):
        found = type(method).__name__
        raise InvalidInput(where, f"an object of the class {found}", f"the class itself, METHOD = {found}")
    if not (isinstance(method, type) and issubclass(method, base)):
        raise InvalidInput(where, repr(method)[:60], describe_base(base))
    kind: Any = method
    asked = {a for k in base.__mro__ for a, t in vars(k).get("__annotations__", {}).items() if "ClassVar" in str(t)}
    if "name" in asked and getattr(kind, "name", name) != name:
        raise InvalidInput(where, f"the name {kind.name!r}", f"name = {name!r} in the class, by which it is asked for")
    missing = sorted({*getattr(kind, "__abstractmethods__", ()), *(a for a in asked if not hasattr(kind, a))})
    if missing:
        raise InvalidInput(
            where, f"{kind.__name__} without {', '.join(missing)}", f"{describe_base(base)} that defines them"
        )
    return kind


class NamedDependency:
    """Turns a package that is missing while a method is imported into `MissingDependency`; all else shows itself."""

    def __init__(self, kind: str, name: str) -> None:
        self._what = f"{kind} {name!r}"

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if isinstance(error, ModuleNotFoundError):
            package = (error.name or "").partition(".")[0]
            if package and package not in _OURS:
                raise MissingDependency(package, self._what, _extra_with(package)) from error


def _extra_with(package: str) -> str | None:
    """Name of the extra of this distribution that installs a package, if one does."""
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
