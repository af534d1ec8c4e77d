"""Files of plug-ins: what is a path, and the modules that are made of Python files."""

from __future__ import annotations

import hashlib
import importlib
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import quote, unquote

from optik.errors import InvalidInput

PARENT = "optik.plugins"
"""Package whose submodules the modules of files are."""

SUFFIXES = (".py", ".toml", ".urdf", ".xml", ".json")
"""Endings by which a name without a separator is a path: those of the files that plug-ins are."""

_FRAGMENT = re.compile(r"(.*\.(?:urdf|xml))#(.*)", re.IGNORECASE | re.DOTALL)
"""A URDF file with the links of the arm behind it: ``arm.urdf#tip=tool0&base=base_link``."""


_code_forbidden: ContextVar[bool] = ContextVar("code_forbidden", default=False)
_expected: dict[str, str] = {}
"""SHA-256 that a file must have in this process, by its absolute path, where a run has recorded one."""


def is_path(name: Any) -> bool:
    """Return whether a name means a file: it has a separator or the suffix of a plug-in; a bare name never does."""
    if isinstance(name, os.PathLike):
        return True
    if not isinstance(name, str):
        return False
    text = split_links(name)[0]
    return "/" in text or os.sep in text or Path(text).suffix.lower() in SUFFIXES


def split_links(name: str) -> tuple[str, str]:
    """Split ``arm.urdf#tip=tool0`` into the file and the links; the links of any other name are empty."""
    found = _FRAGMENT.fullmatch(name)
    return (found[1], found[2]) if found else (name, "")


def digest(file: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(_read(file)).hexdigest()


def import_file(file: Path) -> ModuleType:
    """Import a Python file, or return its module where this process has imported it."""
    name = f"{PARENT}.{quote(file.as_posix(), safe='/ ').replace('.', '%2E')}"
    module = sys.modules.get(name)
    if module is None:
        module = importlib.import_module(name)
    elif digest(file) != module.__sha256__:
        expected = "the file as this process imported it; start a new process to use the new one"
        raise InvalidInput(str(file), "a file that has changed", expected)
    return module


class _Finder(MetaPathFinder):
    """Finds the file of a module whose name `import_file` made."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> ModuleSpec | None:
        place = fullname.removeprefix(f"{PARENT}.")
        file = Path(unquote(place))
        if place == fullname or not file.is_absolute() or not file.is_file():
            return None
        return spec_from_file_location(fullname, file, loader=_FileLoader(file))


class _FileLoader(Loader):
    """Runs the very bytes whose SHA-256 the module states; keeps no bytecode, which could be that of another version."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def exec_module(self, module: ModuleType) -> None:
        file = self._file
        if _code_forbidden.get():
            raise InvalidInput(str(file), "a file with code", "no such file here: reading a run or a plan runs no code")
        source = _read(file)
        found = hashlib.sha256(source).hexdigest()
        if _expected.get(str(file), found) != found:
            raise InvalidInput(str(file), "a file that has changed", "the file as the run recorded it")
        module.__dict__["__sha256__"] = found
        exec(compile(source, str(file), "exec", dont_inherit=True), module.__dict__)
        method = vars(module).get("METHOD")
        if isinstance(method, type) and method.__module__ == module.__name__ and "name" not in vars(method):
            method.name = file.stem  # type: ignore[attr-defined] # here, where unpickling comes by, too


sys.meta_path.append(_Finder())


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InvalidInput(str(file), error.strerror or str(error), "a file that can be read") from None


@contextmanager
def forbid_code() -> Iterator[None]:
    """Refuse to import files of plug-ins: for reports and comparisons, which only read."""
    token = _code_forbidden.set(True)
    try:
        yield
    finally:
        _code_forbidden.reset(token)


def expect(recorded: Iterable[Mapping[str, str]]) -> None:
    """Have this process refuse files that are not as a run has recorded them: called in every worker before its work."""
    _expected.update({row["path"]: row["sha256"] for row in recorded if "path" in row})
