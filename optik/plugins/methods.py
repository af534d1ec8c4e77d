"""Checks of the METHOD of a plug-in."""

from __future__ import annotations

import importlib
import importlib.metadata
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from optik.errors import InvalidInput, MissingDependency

DATA_GROUPS = ("optik.robots", "benchmarks.suites")
"""Groups of data files; importing them would hide `optik.robots()` behind a module."""

_OURS = ("optik", "planners", "benchmarks")
"""Our packages: if one of their modules is missing, no dependency is."""


def find_base(group: str) -> Any:
    """Return the base class of a group's methods, ``METHOD_BASE`` of its module ``base``, or None."""
    if group in DATA_GROUPS:
        return None
    try:
        return getattr(importlib.import_module(f"{group}.base"), "METHOD_BASE", None)
    except ModuleNotFoundError as error:
        if error.name != f"{group}.base":
            raise
        return None


def describe_base(base: Any) -> str:
    """Describe the METHOD that a group requires."""
    if base is None:
        return "a function or a class"
    places = (base.__module__.removesuffix(".base"), base.__module__.partition(".")[0], base.__module__)
    known = (place for place in places if getattr(sys.modules.get(place), base.__name__, None) is base)
    return f"a subclass of {next(known)}.{base.__name__}"


def check_method(group: str, method: Any, name: str, where: str) -> Any:
    """Check the type and name of a plug-in's method, and return the method."""
    base = find_base(group)
    if base is None:
        if not callable(method) and group != "optik.robots":
            raise InvalidInput(where, repr(method)[:60], describe_base(base))
        return method
    if isinstance(method, base):
        found = type(method).__name__
        raise InvalidInput(where, f"an object of the class {found}", f"the class, METHOD = {found}")
    if not (isinstance(method, type) and issubclass(method, base)):
        raise InvalidInput(where, repr(method)[:60], describe_base(base))
    kind: Any = method
    asked = {a for k in base.__mro__ for a, t in vars(k).get("__annotations__", {}).items() if "ClassVar" in str(t)}
    if "name" in asked and getattr(kind, "name", name) != name:
        raise InvalidInput(where, f"the name {kind.name!r}", f"name = {name!r} in the class")
    missing = sorted({*getattr(kind, "__abstractmethods__", ()), *(a for a in asked if not hasattr(kind, a))})
    if missing:
        raise InvalidInput(
            where, f"{kind.__name__} without {', '.join(missing)}", f"{describe_base(base)} that defines them"
        )
    return kind


@contextmanager
def name_dependency(kind: str, name: str) -> Iterator[None]:
    """Raise `MissingDependency` for a package that is missing during the import of a method."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if not package or package in _OURS:
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
