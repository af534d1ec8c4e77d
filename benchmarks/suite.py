"""Suites: what a TOML file asks for, checked before anything runs."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.methods import Method, method_of
from benchmarks.problems.base import SETS
from benchmarks.records import slug
from benchmarks.settings import all_of, check_different, check_keys, check_known, check_list
from benchmarks.speed_suite import BatchBlock, FirstUse, SpeedBlock, batch_block, first_use, speed_block
from benchmarks.timing_suite import TimingBlock, timing_block
from optik.check import check_count, real_array
from optik.errors import InvalidInput
from optik.registry import data_file

SUITES = "benchmarks.suites"


@dataclass(frozen=True)
class Block:
    """One problem set on one robot, solved by some methods at some iteration budgets, one attempt each.

    ``sweep`` says that it varies options instead of comparing methods; by default, that all methods are one solver.
    """

    id: str
    title: str
    robot: str
    set: str
    options: dict[str, Any]
    budgets: tuple[int, ...]
    methods: tuple[Method, ...]
    sweep: bool = False


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
    """A comparison: blocks of IK problems at budgets, a line, what speed is asked of, and lines to time."""

    name: str
    title: str
    seed: int
    blocks: tuple[Block, ...]
    line: LineTask | None
    speed: tuple[SpeedBlock, ...]
    batch: tuple[BatchBlock, ...]
    first_use: FirstUse | None
    timing: tuple[TimingBlock, ...]
    settings: dict[str, Any]

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of all arms, in the order of their first use."""
        found = [b.robot for b in self.blocks] + [b.robot for b in self.speed] + [b.robot for b in self.batch]
        found += [self.line.robot] if self.line is not None else []
        found += [self.first_use.robot] if self.first_use is not None else []
        found += [name for b in self.timing for name in b.robots]
        return tuple(dict.fromkeys(found))

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
    check_keys(data, {"title", "seed", "blocks", "line", "speed", "batch", "first_use", "timing"}, "the suite")
    blocks = tuple(_block(b) for b in data.get("blocks", []))
    speed = all_of(data.get("speed"), "speed", speed_block)
    batch = all_of(data.get("batch"), "batch", batch_block)
    timing = all_of(data.get("timing"), "timing", timing_block)
    ids = [b.id for part in (blocks, speed, batch, timing) for b in part]
    check_different(ids, "blocks", "id")
    _check_files(ids)
    line = _line(data["line"]) if "line" in data else None
    first = first_use(data["first_use"]) if "first_use" in data else None
    if not (blocks or speed or batch or timing) and line is None and first is None:
        raise InvalidInput(
            f"suite {name!r}", "neither blocks nor a line, speed, batch, first_use or timing", "something to run"
        )
    check_count(data.get("seed", 0), "seed", 0)
    title = str(data.get("title", name))
    return Suite(name, title, int(data.get("seed", 0)), blocks, line, speed, batch, first, timing, data)


def _check_files(ids: list[str]) -> None:
    """Refuse ids that would not have files of their own: their names tell letters and digits apart, and no more."""
    named: dict[str, str] = {}
    for one in ids:
        name = slug(one)
        if not name:
            raise InvalidInput("blocks", f"the id {one!r}", "an id with a letter a–z or a digit, which names its files")
        if name in named:
            expected = "ids that differ in more than case, punctuation and letters other than a–z: they name files"
            raise InvalidInput("blocks", f"the ids {named[name]!r} and {one!r}", expected)
        named[name] = one


def _block(data: dict[str, Any]) -> Block:
    where = f"block {data.get('id', '?')!r}"
    check_keys(
        data,
        {"id", "title", "robot", "set", "options", "budgets", "methods", "sweep"},
        where,
        need={"id", "robot", "set", "methods"},
    )
    check_known(data["robot"], "optik.robots", "robot")
    check_known(data["set"], SETS, "problem set")
    budgets = tuple(check_list(data.get("budgets", [100]), f"{where}: budgets"))
    for budget in budgets:
        check_count(budget, f"{where}: budgets", 1)
    if list(budgets) != sorted(set(budgets)):
        raise InvalidInput(f"{where}: budgets", budgets, "whole numbers, each larger than the one before")
    methods = tuple(_budgeted(m, where) for m in check_list(data["methods"], f"{where}: methods"))
    check_different([m.label for m in methods], f"{where}: methods", "label")
    sweep = data.get("sweep", len(methods) > 1 and len({m.solver for m in methods}) == 1)
    if not isinstance(sweep, bool):
        raise InvalidInput(f"{where}: sweep", repr(sweep)[:60], "true or false")
    return Block(
        str(data["id"]), str(data.get("title", data["id"])), data["robot"], data["set"],
        dict(data.get("options", {})), budgets, methods, sweep,
    )  # fmt: skip


def _budgeted(data: Any, where: str) -> Method:
    """A method that budgets stop: it has no other end of its own."""
    method = method_of(data, where)
    for fixed in ("max_iterations", "max_restarts", "time_limit"):
        if fixed in method.options:
            raise InvalidInput(
                f"{where}: methods", fixed, "budgets in place of it: one attempt, stopped at each budget"
            )
    return method


def _line(data: dict[str, Any]) -> LineTask:
    keys = {"robot", "start_deg", "move_m", "ik", "laws", "samples"}
    check_keys(data, keys, "the line", need=keys - {"samples"})
    check_known(data["robot"], "optik.robots", "robot")
    for method in check_list(data["ik"], "the line: ik"):
        check_known(method, "optik.ik", "IK method")
    for law in check_list(data["laws"], "the line: laws"):
        check_known(law, "planners.timing", "time law")
    check_count(data.get("samples", 151), "the line: samples", 2)
    move = real_array(data["move_m"], "the line: move_m", "three numbers [m]")
    if move.shape != (3,):
        raise InvalidInput("the line: move_m", data["move_m"], "three numbers [m]")
    return LineTask(
        data["robot"], tuple(data["start_deg"]), tuple(data["move_m"]), tuple(data["ik"]), tuple(data["laws"]),
        int(data.get("samples", 151)),
    )  # fmt: skip
