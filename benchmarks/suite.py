"""Suites: content of a TOML file, checked before anything runs."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from benchmarks.blocks.base import GROUP, Kind, kind_names, load_kind
from benchmarks.blocks.block import Block
from benchmarks.records import slug
from benchmarks.settings import check_different
from optik.check import check_count
from optik.errors import InvalidInput, UnknownName
from optik.plugins.files import UsedPlugin, collect_plugins, is_path
from optik.registry import check_name, data_file

SUITES = "benchmarks.suites"
"""The package in which a suite is found by its name."""

REMOVED = {
    "answers": "[[budgets]] with a single budget, which stores every answer, too",
    "first_use": "`python -X importtime -c 'import optik'`, or a timer of processes",
    "blocks": "[[budgets]]",
    "speed": "[[calls]]",
    "line": '[[timing]] with lines = [{ kind = "line", … }] and detail = true',
}
"""Keys of earlier versions, and what replaces them."""

REMOVED_MOTIONS = {
    "iso": "spots, or a program that executes its cycles with planners.cell.make_drive('mujoco', robot)",
    "laws": "spots, or [[timing]] for time laws; planners.cell.make_drive('mujoco', robot) executes their plans",
}
"""Values of `what` in [[cell]] of earlier versions, and what replaces them."""

OWN_KEYS = {
    "title": ("Heading of the report.", "the suite's name"),
    "seed": ("Seed of all random numbers, 0 or more.", "0"),
}
"""Keys of a suite that are no kind of block: meaning and default."""


@dataclass(frozen=True)
class Suite:
    """A comparison: some blocks, each of a kind.

    Attributes
    ----------
    name, title : str
        Name, and heading of the report.
    seed : int
        Of everything that is drawn.
    kinds : tuple of Kind
        Those that it has blocks of, in the order in which they run.
    asked : dict
        Blocks by the name of their kind.
    settings : dict
        All settings as they were read.
    plugins : tuple of Used
        Files and entry points that the settings name.
    allow_plugins : bool
        Whether the code in those files may be run.
    """

    name: str
    title: str
    seed: int
    kinds: tuple[Kind, ...]
    asked: dict[str, tuple[Any, ...]]
    settings: dict[str, Any]
    plugins: tuple[UsedPlugin, ...] = ()
    allow_plugins: bool = False

    def of(self, kind: str) -> tuple[Any, ...]:
        """Return all blocks of a kind.

        Parameters
        ----------
        kind : str
            Its name.

        Returns
        -------
        tuple of Block
            In the order of the suite; empty where it has none.
        """
        return self.asked.get(kind, ())

    def pairs(self) -> Iterator[tuple[Kind, Any]]:
        """Return every block with its kind, in the order of execution."""
        for kind in self.kinds:
            for block in self.of(kind.name):
                yield kind, block

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of all arms, in the order of their first use."""
        return tuple(dict.fromkeys(robot for _, block in self.pairs() for robot in block.robots))

    @property
    def fingerprint(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of all settings."""
        return hashlib.sha256(json.dumps(self.settings, sort_keys=True).encode()).hexdigest()[:16]


def load_suite(name: str, *, allow_plugins: bool = False) -> Suite:
    """Read a suite by name, or from a TOML file.

    Parameters
    ----------
    name : str
        Of a suite, or the path of a file that ends in ``.toml``.
    allow_plugins : bool
        Whether the code in files that the suite names may be run. Where it may not, the suite can be looked at, not run.

    Returns
    -------
    Suite
        The suite, checked.

    Raises
    ------
    UnknownName
        Neither a suite nor a file; or a kind, robot, set, method or law in it that does not exist.
    InvalidInput
        A file that is no suite: the key is named.
    """
    file = data_file(SUITES, name, "suite")
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"suite {file.name}", str(error), "a TOML file") from None
    with collect_plugins(file.parent) as used:
        called = file.stem if is_path(name) else name
        suite = suite_of(called, data)
    return replace(suite, plugins=tuple(used), allow_plugins=allow_plugins)


def suite_of(name: str, data: dict[str, Any]) -> Suite:
    """Check the settings of a suite and return it."""
    kinds = sorted(map(_kind, (key for key in data if key not in OWN_KEYS)), key=lambda kind: (kind.order, kind.name))
    asked = {kind.name: _blocks(kind, data[kind.name]) for kind in kinds}
    if not any(asked.values()):
        raise InvalidInput(f"suite {name!r}", "no blocks", f"something to run: {', '.join(kind_names())}")
    ids = [block.id for blocks in asked.values() for block in blocks]
    check_different(ids, "blocks", "id")
    _check_files(ids)
    check_count(data.get("seed", 0), "seed", 0)
    return Suite(name, str(data.get("title", name)), int(data.get("seed", 0)), tuple(kinds), asked, data)


def _kind(key: str) -> Kind:
    """Return the kind of block that a key of a suite names."""
    if key in REMOVED:
        raise InvalidInput("the suite", f"the key {key!r} of an earlier version", f"use {REMOVED[key]}")
    if is_path(key):
        raise InvalidInput("the suite", f"the key {key!r}", "a kind of block of an installed package, not a file")
    try:
        return load_kind(check_name(GROUP, key, "kind of block"))
    except UnknownName:
        raise UnknownName("key of a suite", key, (*OWN_KEYS, *kind_names())) from None


def _blocks(kind: Kind, data: Any) -> tuple[Block, ...]:
    """Return all blocks of a kind."""
    if not isinstance(data, list):
        raise InvalidInput(f"the suite: {kind.name}", repr(data)[:60], f"a list of tables: [[{kind.name}]]")
    for item in data:
        if _is_removed(kind.name, item):
            came = f"{item['what']!r} of an earlier version"
            raise InvalidInput(f"{kind.name} {item.get('id', '')!r}: what", came, REMOVED_MOTIONS[item["what"]])
    return tuple(kind.settings(item) for item in data)


def _is_removed(key: str, item: Any) -> bool:
    """Return whether a block is of a type of an earlier version."""
    return key == "cell" and isinstance(item, dict) and item.get("what") in REMOVED_MOTIONS


def drop_removed(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of a run without keys and blocks of earlier versions, so that the others can be shown."""
    kept = {key: value for key, value in settings.items() if key not in REMOVED}
    return kept | {key: [b for b in kept[key] if not _is_removed(key, b)] for key in ("cell",) if key in kept}


def _check_files(ids: list[str]) -> None:
    """Raise InvalidInput for ids that would share files: file names distinguish only letters a–z and digits."""
    named: dict[str, str] = {}
    for one in ids:
        name = slug(one)
        if not name:
            raise InvalidInput("blocks", f"the id {one!r}", "an id with a letter a–z or a digit, which names its files")
        if name in named:
            expected = "ids that differ in more than case, punctuation and letters other than a–z: they name files"
            raise InvalidInput("blocks", f"the ids {named[name]!r} and {one!r}", expected)
        named[name] = one
