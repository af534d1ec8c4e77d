"""Files of plug-ins: recognition of paths, and import of Python files."""

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
"""Package of the modules of files."""

SUFFIXES = (".py", ".toml", ".urdf", ".xml", ".json")
"""Suffixes of plug-ins' files; a name with one of them is a path."""

_FRAGMENT = re.compile(r"(.*\.(?:urdf|xml))#(.*)", re.IGNORECASE | re.DOTALL)
"""A URDF file with options behind it: ``arm.urdf#tip=tool0&base=base_link``."""


_code_forbidden: ContextVar[bool] = ContextVar("code_forbidden", default=False)
_expected: dict[str, str] = {}
"""SHA-256 of files in the recorded run, by absolute path."""


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
    """Return the SHA-256 of a file."""
    return hashlib.sha256(_read(file)).hexdigest()


def import_file(file: Path) -> ModuleType:
    """Import a Python file, or return its module if this process has imported it."""
    name = f"{PARENT}.{quote(file.as_posix(), safe='/ ').replace('.', '%2E')}"
    module = sys.modules.get(name)
    if module is None:
        module = importlib.import_module(name)
    elif digest(file) != module.__sha256__:
        changed = "a file that has changed since it was imported; start a new process to use it"
        raise InvalidInput(str(file), changed, "the imported version")
    return module


class _Finder(MetaPathFinder):
    """Finder of the modules of `import_file`."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> ModuleSpec | None:
        place = fullname.removeprefix(f"{PARENT}.")
        file = Path(unquote(place))
        if place == fullname or not file.is_absolute() or not file.is_file():
            return None
        return spec_from_file_location(fullname, file, loader=_FileLoader(file))


class _FileLoader(Loader):
    """Loader that runs exactly the bytes of the module's SHA-256, without a bytecode cache."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def exec_module(self, module: ModuleType) -> None:
        file = self._file
        if _code_forbidden.get():
            raise InvalidInput(str(file), "a Python file", "none, because reading a run or a plan runs no code")
        source = _read(file)
        found = hashlib.sha256(source).hexdigest()
        if _expected.get(str(file), found) != found:
            raise InvalidInput(str(file), "a file that has changed", "the file with the recorded SHA-256")
        module.__dict__["__sha256__"] = found
        exec(compile(source, str(file), "exec", dont_inherit=True), module.__dict__)
        method = vars(module).get("METHOD")
        if isinstance(method, type) and method.__module__ == module.__name__ and "name" not in vars(method):
            method.name = file.stem  # type: ignore[attr-defined] # here, because unpickling imports too


sys.meta_path.append(_Finder())


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InvalidInput(str(file), error.strerror or str(error), "a readable file") from None


@contextmanager
def forbid_code() -> Iterator[None]:
    """Forbid the import of plug-ins' files, for reports and comparisons."""
    token = _code_forbidden.set(True)
    try:
        yield
    finally:
        _code_forbidden.reset(token)


def expect(recorded: Iterable[Mapping[str, str]]) -> None:
    """Make this process refuse files whose SHA-256 differs from the recorded one."""
    _expected.update({row["path"]: row["sha256"] for row in recorded if "path" in row})
