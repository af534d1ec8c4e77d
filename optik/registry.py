"""Methods, laws, robots and suites by name: a file in its folder is a name; nothing is listed twice."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import re
from functools import cache
from pathlib import Path
from typing import Any

from optik.errors import InvalidInput, MissingDependency, UnknownName

_OURS = ("optik", "planners", "benchmarks")


@cache
def _folder(package: str) -> Path:
    top, *inner = package.split(".")
    spec = importlib.util.find_spec(top)  # of a package inside, it would import those around it
    locations = spec.submodule_search_locations if spec is not None else None
    folder = Path(next(iter(locations))).joinpath(*inner) if locations else Path()
    if not locations or not folder.is_dir():
        raise ValueError(f"{package} is no package")
    return folder


def names(folder: str) -> tuple[str, ...]:
    """Names in a folder of methods or of TOML data, sorted, without importing any of them.

    Parameters
    ----------
    folder : str
        Dotted name of a package, such as ``"optik.ik"`` or ``"optik.robots"``.

    Returns
    -------
    tuple of str
        Stems of its ``.py`` and ``.toml`` files, and names of its packages; ``base`` and names with a leading ``_`` are
        not methods.
    """
    stems = {f.stem for f in _folder(folder).iterdir() if f.suffix in (".py", ".toml") or (f / "__init__.py").is_file()}
    return tuple(sorted(s for s in stems if s != "base" and not s.startswith("_")))


def data_file(folder: str, name: str, kind: str) -> Path:
    """Path of a TOML file by name.

    Raises
    ------
    UnknownName
        No such file; the nearest names are offered.
    """
    _named(folder, name, kind)
    return _folder(folder) / f"{name}.toml"


def load_method(folder: str, name: str, kind: str = "method") -> Any:
    """Import one method: the ``METHOD`` of the module ``folder.name``.

    Raises
    ------
    UnknownName
        No such module; the nearest names are offered.
    MissingDependency
        The module needs an optional package that is not installed. A broken import of our own shows itself.
    """
    _named(folder, name, kind)
    try:
        return importlib.import_module(f"{folder}.{name}").METHOD
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if not package or package in _OURS:
            raise
        raise MissingDependency(package, f"{kind} {name!r}", _extra_with(package)) from error


def _named(folder: str, name: str, kind: str) -> None:
    if not isinstance(name, str):
        raise InvalidInput(kind, repr(name)[:60], f"a name, one of: {', '.join(names(folder))}")
    if name not in names(folder):
        raise UnknownName(kind, name, names(folder))


def build_method(folder: str, name: str, kind: str, *arguments: Any, **options: Any) -> Any:
    """Call one method with options that people wrote.

    Raises
    ------
    UnknownName, MissingDependency
        As `load_method`.
    InvalidInput
        An option that the method does not have, or one that it needs and nobody gave.
    """
    method = load_method(folder, name, kind)
    try:
        return method(*arguments, **options)
    except TypeError as error:
        wrong = re.search(r"(got an unexpected keyword|missing \d+ required|takes no argument).*", str(error))
        if wrong is None:
            raise
        given = ", ".join(options) or "none"
        raise InvalidInput("options", f"{given} ({wrong[0]})", f"options of the {kind} {name!r}") from None


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
