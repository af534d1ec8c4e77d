"""The plug-ins that a suite's settings name: whether they may run, and what the manifest of a run says of them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import NamedTuple

from optik.errors import InvalidInput
from optik.plugins.files import SUFFIXES, digest, split_links


class UsedPlugin(NamedTuple):
    """A plug-in that settings name.

    Attributes
    ----------
    group : str
        Dotted name of the group, such as ``"optik.ik"``.
    name : str
        What reports call it.
    source : Path or EntryPoint
        The file, or the entry point of an installed package.
    """

    group: str
    name: str
    source: Path | EntryPoint


class _Reading(NamedTuple):
    """Settings that are being read: where their relative paths start, and which plug-ins they have named so far."""

    folder: Path | None
    used: list[UsedPlugin]


_reading: ContextVar[_Reading | None] = ContextVar("reading", default=None)


DATA = "files"
"""Group under which files of data that settings name are noted: poses and motions, which no method is found in."""


def resolve_data_file(name: str, kind: str) -> str:
    """Return the absolute path of a file of data, which exists, and note it: a run records its SHA-256."""
    if not isinstance(name, str) or not name:
        raise InvalidInput(kind, repr(name)[:60], "the path of a file")
    file = resolve_file(name, kind, "a file; its path starts at the suite's folder")
    if not in_finished_run():
        note(UsedPlugin(DATA, file.name, file))
    return str(file)


def resolve_file(name: str | os.PathLike[str], kind: str, expected: str = "") -> Path:
    """Return the absolute path of a plug-in's file, which exists."""
    text = split_links(os.fspath(name))[0]
    reading = _reading.get()
    if reading is not None and reading.folder is None:
        return Path(text)  # a finished run: its files are not looked at
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
    """Return a name with the suffix that makes it an existing file, for advice where the suffix was forgotten."""
    reading = _reading.get()
    folder = (reading and reading.folder) or Path()
    try:
        return next((name + suffix for suffix in suffixes if (folder / (name + suffix)).is_file()), "")
    except (OSError, ValueError):  # ValueError: a NUL in the name
        return ""


@contextmanager
def collect_plugins(folder: Path | None) -> Iterator[list[UsedPlugin]]:
    """Read settings: relative paths in them start at a folder, and every plug-in that they name is noted."""
    used: list[UsedPlugin] = []
    token = _reading.set(_Reading(folder, used))
    try:
        yield used
    finally:
        _reading.reset(token)


def note(plugin: UsedPlugin) -> None:
    """Note a plug-in that settings name, where settings are being read."""
    current = _reading.get()
    if current is None or plugin in current.used:
        return
    for other in current.used:
        if other[:2] == plugin[:2]:
            both = f"{other.source} and {plugin.source}, both called {plugin.name}"
            raise InvalidInput(plugin.group, both, "files of different names: reports tell them apart by these")
    current.used.append(plugin)


def in_finished_run() -> bool:
    """Return whether the settings of a finished run are being read, whose files are not looked at."""
    current = _reading.get()
    return current is not None and current.folder is None


def has_code(plugin: UsedPlugin) -> bool:
    """Return whether using a plug-in runs code out of a file: robots in TOML, URDF or JSON, and tables, are data."""
    return isinstance(plugin.source, Path) and plugin.source.suffix.lower() == ".py"


def check_allowed(used: Iterable[UsedPlugin], allowed: bool) -> None:
    """Refuse Python files in a suite unless they are allowed: running them is running code. Files of data are not."""
    files = sorted({str(u.source) for u in used if has_code(u)})
    if files and not allowed:
        expected = "--allow-plugins (allow_plugins=True), since running the suite runs the code in these files"
        raise InvalidInput("suite", f"the plug-ins {', '.join(files)}", expected)


def record_plugins(used: Iterable[UsedPlugin]) -> list[dict[str, str]]:
    """Return what a run's manifest says of its plug-ins, as plain data."""
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
    """Refuse to continue a run with other plug-ins than those that it began with."""
    before, after = ({(row["group"], row["name"]): row for row in rows} for rows in (recorded, now))
    for key in sorted(before.keys() | after.keys()):
        if _content(before.get(key)) != _content(after.get(key)):
            advice = "restore it, or use another --out"
            expected = f"{_words(before.get(key))}, as when the run began; {advice}"
            what = f"file {key[1]}" if key[0] == DATA else f"plug-in {key[1]} ({key[0]})"
            raise InvalidInput(what, _words(after.get(key)), expected)


def _content(row: Mapping[str, str] | None) -> dict[str, str] | None:
    """What must be the same in all of a run: everything but where a file lies."""
    return None if row is None else {key: value for key, value in row.items() if key != "path"}


def _words(row: Mapping[str, str] | None) -> str:
    if row is None:
        return "none"
    if "sha256" in row:
        return f"{row['path']} with SHA-256 {row['sha256'][:16]}…"
    return f"{row['distribution']} {row['version']}"
