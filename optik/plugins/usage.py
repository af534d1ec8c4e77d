"""The plug-ins in a suite's settings: permission to run them, and their records in a run's manifest."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import NamedTuple

from optik.errors import InvalidInput
from optik.plugins.files import CODE, SUFFIXES, digest, split_links


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
        expected = "--allow-plugins (allow_plugins=True): the suite runs Python code from these files"
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
            advice = "restore it, or use another --out"
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
