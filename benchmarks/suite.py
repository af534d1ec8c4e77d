"""Suites: what a TOML file asks for, checked before anything runs."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optik.check import check_count, real_array
from optik.errors import InvalidInput, UnknownName
from optik.registry import data_file, names

SUITES = "benchmarks.suites"
SETS = "benchmarks.problems"


@dataclass(frozen=True)
class Method:
    """One IK method with its options, and what reports call it."""

    label: str
    solver: str
    options: dict[str, Any]
    max_problems: int | None = None


@dataclass(frozen=True)
class Block:
    """One problem set on one robot, solved by some methods at some iteration budgets."""

    id: str
    title: str
    robot: str
    set: str
    options: dict[str, Any]
    budgets: tuple[int, ...]
    methods: tuple[Method, ...]


@dataclass(frozen=True)
class LineTask:
    """One straight line, planned by some IK methods and time laws."""

    robot: str
    start_deg: tuple[float, ...]
    move_m: tuple[float, float, float]
    ik: tuple[str, ...]
    laws: tuple[str, ...]
    samples: int


@dataclass(frozen=True)
class Suite:
    """A comparison: blocks of IK problems, and a line."""

    name: str
    title: str
    seed: int
    blocks: tuple[Block, ...]
    line: LineTask | None
    settings: dict[str, Any]

    @property
    def fingerprint(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of all settings."""
        return hashlib.sha256(json.dumps(self.settings, sort_keys=True).encode()).hexdigest()[:16]


def load_suite(name: str) -> Suite:
    """Read a suite by name, or from a TOML file.

    Raises
    ------
    UnknownName
        Neither a suite nor a file; or a robot, set, method or law in it that does not exist.
    InvalidInput
        A file that is no suite: the key is named.
    """
    file = Path(name) if name.endswith(".toml") and Path(name).is_file() else data_file(SUITES, name, "suite")
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"suite {file.name}", str(error), "a TOML file") from None
    return suite_of(file.stem, data)


def suite_of(name: str, data: dict[str, Any]) -> Suite:
    """Check the settings of a suite and return it."""
    _keys(data, {"title", "seed", "blocks", "line"}, "the suite")
    blocks = tuple(_block(b) for b in data.get("blocks", []))
    ids = [b.id for b in blocks]
    if len(set(ids)) != len(ids):
        raise InvalidInput("blocks", f"ids {ids}", "an id of its own for every block")
    line = _line(data["line"]) if "line" in data else None
    if not blocks and line is None:
        raise InvalidInput(f"suite {name!r}", "neither blocks nor a line", "something to run")
    check_count(data.get("seed", 0), "seed", 0)
    return Suite(name, str(data.get("title", name)), int(data.get("seed", 0)), blocks, line, data)


def _block(data: dict[str, Any]) -> Block:
    where = f"block {data.get('id', '?')!r}"
    _keys(
        data,
        {"id", "title", "robot", "set", "options", "budgets", "methods"},
        where,
        need={"id", "robot", "set", "methods"},
    )
    _known(data["robot"], "optik.robots", "robot")
    _known(data["set"], SETS, "problem set")
    budgets = tuple(_list(data.get("budgets", [100]), f"{where}: budgets"))
    for budget in budgets:
        check_count(budget, f"{where}: budgets", 1)
    if list(budgets) != sorted(set(budgets)):
        raise InvalidInput(f"{where}: budgets", budgets, "whole numbers, each larger than the one before")
    methods = tuple(_method(m, where) for m in _list(data["methods"], f"{where}: methods"))
    labels = [m.label for m in methods]
    if len(set(labels)) != len(labels):
        raise InvalidInput(f"{where}: methods", f"labels {labels}", "a label of its own for every method")
    return Block(
        str(data["id"]), str(data.get("title", data["id"])), data["robot"], data["set"],
        dict(data.get("options", {})), budgets, methods,
    )  # fmt: skip


def _method(data: dict[str, Any], where: str) -> Method:
    _keys(data, {"label", "solver", "options", "max_problems"}, f"{where}: methods", need={"solver"})
    _known(data["solver"], "optik.ik", "IK method")
    options = dict(data.get("options", {}))
    for fixed in ("max_iterations", "max_restarts", "time_limit"):
        if fixed in options:
            raise InvalidInput(
                f"{where}: methods", fixed, "budgets in place of it: one attempt, stopped at each budget"
            )
    most = data.get("max_problems")
    if most is not None:
        check_count(most, f"{where}: max_problems", 1)
    return Method(str(data.get("label", data["solver"])), data["solver"], options, most)


def _line(data: dict[str, Any]) -> LineTask:
    keys = {"robot", "start_deg", "move_m", "ik", "laws", "samples"}
    _keys(data, keys, "the line", need=keys - {"samples"})
    _known(data["robot"], "optik.robots", "robot")
    for method in _list(data["ik"], "the line: ik"):
        _known(method, "optik.ik", "IK method")
    for law in _list(data["laws"], "the line: laws"):
        _known(law, "planners.timing", "time law")
    check_count(data.get("samples", 151), "the line: samples", 2)
    move = real_array(data["move_m"], "the line: move_m", "three numbers [m]")
    if move.shape != (3,):
        raise InvalidInput("the line: move_m", data["move_m"], "three numbers [m]")
    return LineTask(
        data["robot"], tuple(data["start_deg"]), tuple(data["move_m"]), tuple(data["ik"]), tuple(data["laws"]),
        int(data.get("samples", 151)),
    )  # fmt: skip


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise InvalidInput(where, repr(value)[:60], "a list that is not empty")
    return value


def _known(name: Any, folder: str, kind: str) -> None:
    if name not in names(folder):
        raise UnknownName(kind, str(name), names(folder))


def _keys(data: dict[str, Any], known: set[str], where: str, need: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    if not isinstance(data, dict):
        raise InvalidInput(where, type(data).__name__, "a table")
    if unknown := sorted(set(data) - known):
        raise InvalidInput(where, f"the key {unknown[0]!r}", f"keys out of {', '.join(sorted(known))}")
    if missing := sorted(need - set(data)):
        raise InvalidInput(where, f"no {missing[0]!r}", f"the keys {', '.join(sorted(need))}")
