"""The interface of blocks: settings, targets, parts of work and rows of a kind of block, found by its name."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import polars as pl
from pydantic import Field, model_validator

from benchmarks.blocks.columns import Column
from benchmarks.records import JOURNAL, Journal, RunFolder, rows_file
from benchmarks.settings import LISTED, Flag, Settings, check_different, key, numbered, read
from optik.arm.library import load
from optik.errors import InvalidInput, UnknownName
from optik.plugins.files import is_path, split_links


def measure_named(measures: Sequence[Column], name: str, where: str) -> Column:
    """Find a measure by its name."""
    found = next((measure for measure in measures if measure.key == name), None)
    if found is None:
        raise InvalidInput(where, f"measure {name!r}", f"one of {', '.join(measure.key for measure in measures)}")
    return found


class Target(Settings):
    """A bound on a measure of a block."""

    measure: str = key("Measure of the block; the end of its name is the unit.")
    method: str = key("Label of the entry that the bound applies to; by default the first.", "")
    to: str = key("Label of the entry whose value is the denominator of a ratio.", "")
    group: str = key("Part of the problems: a kind of motions, a robot, or the label of limits; by default all.", "")
    at_most: Annotated[float | None, numbered("a number")] = key("Largest value; give one of the two bounds.", None)
    at_least: Annotated[float | None, numbered("a number")] = key("Least value; give one of the two bounds.", None)
    goal: Flag = key("Whether a missed bound is no failure.", False)

    @model_validator(mode="after")
    def _one_bound(self) -> Target:
        if (self.at_most is None) == (self.at_least is None):
            others = sorted(self.model_fields_set - {"measure"})
            raise InvalidInput("", f"{self.measure} with {others}", "either at_most or at_least")
        return self

    def fitted(
        self, where: str, measures: tuple[Column, ...], labels: tuple[str, ...], groups: tuple[str, ...]
    ) -> Target:
        """Check a target against its block and return it; without a named entry it applies to the first."""
        at = f"{where}: targets"
        measure = measure_named(measures, self.measure, at)
        method = self.method or (labels[0] if labels and "method" not in self.model_fields_set else "")
        if (self.to != "") != measure.relative:
            relative = ", ".join(m.key for m in measures if m.relative) or "no measure of this block"
            came = f"{measure.key} with `to` = {self.to!r}" if self.to else f"{measure.key} without `to`"
            raise InvalidInput(at, came, f"`to` for {relative}, and only there")
        for name in (method, self.to):
            if name and name not in labels:
                raise InvalidInput(at, repr(name), f"a label of the block: {', '.join(labels) or 'it has none'}")
        if self.group and self.group not in groups:
            raise InvalidInput(at, f"group {self.group!r}", f"one of {', '.join(groups) or 'none: it has no groups'}")
        return self.model_copy(update={"method": method})


@dataclass(frozen=True)
class Outcome:
    """One target of a block, with its id and title, and its outcome."""

    block: str
    where: str
    target: Target
    measure: Column
    value: float  # NaN where there is none
    note: str  # how many rows the value is computed from, or why there is none

    @property
    def held(self) -> bool | None:
        """Whether the bound is met; None if nothing was measured."""
        if np.isnan(self.value):
            return None
        if self.target.at_most is not None:
            return self.value <= self.target.at_most
        assert self.target.at_least is not None
        return self.value >= self.target.at_least

    @property
    def asked(self) -> str:
        """The bound: ≤ 8 or ≥ 99.99."""
        bound = self.target.at_most if self.target.at_most is not None else self.target.at_least
        return f"{'≤' if self.target.at_most is not None else '≥'} {bound:g}"

    @property
    def what(self) -> str:
        """The measure in words, with the entry and the group of problems that the target names."""
        of = f"{self.target.method}: " if self.target.method else ""
        group = f", {self.target.group.replace('_', '-')}" if self.target.group else ""
        return f"{of}{self.measure.words}{' ' + self.target.to if self.target.to else ''}{group}"

    @property
    def unit(self) -> str:
        """Unit of the value and of the bound."""
        return self.measure.unit


Tell = Callable[[str], None]
"""Called with a description of the next work, for the progress bar."""

KINDS = {
    **{name: f"benchmarks.blocks.ik.{name}" for name in ("budgets", "calls", "batch")},
    **{name: f"benchmarks.blocks.timing.{name}" for name in ("plans", "laws", "freedom", "motion", "clearance")},
    "cell": "benchmarks.blocks.cell",
}
"""Every kind of block with its module."""


class Block(Settings):
    """One block of a suite, as its file defines it."""

    noun: ClassVar[str] = "block"
    """Name of the block in errors, before its id."""
    measures: ClassVar[tuple[Column, ...]] = ()
    """Measures that its targets can name."""
    not_problems: ClassVar[frozenset[str]] = frozenset()
    """Further settings that do not change its problems."""

    id: str = key("Names the block's files.")
    title: str = Field(default_factory=lambda given: given["id"], description="Name of the block in reports.")
    targets: Annotated[tuple[Target, ...], LISTED] = key("Bounds that the report checks.", ())

    @classmethod
    def read(cls, data: Any) -> Self:
        """Check the table of a suite's file."""
        where = f"{cls.noun} {data.get('id', '')!r}".removesuffix(" ''") if isinstance(data, dict) else cls.noun
        block = read(cls, data, where)
        check_different(list(block.labels), where, "label")
        targets = tuple(target.fitted(where, block.measures, block.labels, block.groups) for target in block.targets)
        return block.model_copy(update={"targets": targets})

    @property
    def is_sweep(self) -> bool:
        """Whether the block varies the options of one method; its entries then take no colour of a method."""
        return bool(getattr(self, "sweep", False))

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms of the block."""
        return (self.robot,) if hasattr(self, "robot") else ()

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Methods, laws and peers that the block compares, in the order of the suite."""
        given = (entry for group in ("methods", "laws", "peers") for entry in getattr(self, group, ()))
        return tuple(entry for entry in given if isinstance(entry, Entry))

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all entries."""
        return tuple(entry.label for entry in self.entries)

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of its problems that a target can name."""
        return ()


NOT_PROBLEMS = frozenset({
    "id", "title", "targets", "methods", "laws", "peers", "solvers", "budgets", "sweep", "rounds", "repeats", "reference",
    "evaluation_budgets", "example",
})  # fmt: skip
"""Settings of blocks that do not change their problems."""


def hash_problems(block: Block, seed: int) -> str:
    """Return the SHA-256 of what makes the problems of a block: its settings, the content of its arms and files, the seed."""
    given = block.model_dump(mode="json", exclude=set(NOT_PROBLEMS | block.not_problems))
    content = [block.noun, seed, _with_content(given), [load(name).to_dict() for name in block.robots]]
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def _with_content(value: Any) -> Any:
    """Return settings with the digest of each file in place of its path."""
    if isinstance(value, dict):
        return {key: _with_content(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_with_content(inner) for inner in value]
    if isinstance(value, str) and is_path(value) and (file := Path(split_links(value)[0])).is_file():
        return hashlib.sha256(file.read_bytes()).hexdigest() + split_links(value)[1]
    return value


@dataclass(frozen=True)
class Entry:
    """One competitor of a block: a method or law of ours, or a peer."""

    label: str  # name in reports
    name: str  # by which it is found, or the path of its file
    options: dict[str, Any]
    most: int | None = None  # number of problems that a slow one is given; None for all
    role: str = "ours"  # ours, law, peer or reference
    whole: bool = False  # each problem is one call with restarts, where others make one attempt
    along: bool = False  # a method iterates at each pose of a line, each from the pose before
    without: tuple[str, ...] = ()  # limits that a law does not know

    @property
    def words(self) -> str:
        """Its options in words."""
        told = [f"without the limits on {' and '.join(self.without).replace('_', ' ')}"] if self.without else []
        return ", ".join([f"{key} = {value}" for key, value in self.options.items()] + told)

    def ending_after(self, budget: int | None) -> Entry:
        """Return the entry with one attempt of some iterations for each problem; itself where it keeps its own settings."""
        if self.whole or budget is None:
            return self
        limit = {"iterations": budget} if self.role == "peer" else {"max_iterations": budget, "max_restarts": 0}
        return replace(self, options=self.options | limit)


@dataclass(frozen=True)
class Work:
    """Work of one part, which can be pickled; a subclass is divided along its lists."""

    lists: ClassVar[tuple[str, ...]] = ()
    """Fields with one value for each problem."""

    def solve(self) -> pl.DataFrame:
        """Do the work, and return its rows."""
        raise NotImplementedError

    def crashed(self) -> pl.DataFrame:
        """Return rows of problems in which a method crashed its process, raised an error, or did not end."""
        raise NotImplementedError

    def halves(self) -> tuple[Self, ...]:
        """Divide the work in two, to find the problem that crashes a process; return nothing for a single problem."""
        count = len(getattr(self, self.lists[0])) if self.lists else 1
        cuts = (slice(count // 2), slice(count // 2, count)) if count > 1 else ()
        return tuple(replace(self, **{name: getattr(self, name)[cut] for name in self.lists}) for cut in cuts)


def chunks(values: Any, size: int) -> Iterator[Any]:
    """Yield slices of a sequence, all of a size but for the last."""
    for first in range(0, len(values), size):
        yield values[first : first + size]


@dataclass(frozen=True)
class Part:
    """Work that any process may do, in any order; a part whose file exists is done."""

    file: str  # of its rows, in the run folder
    label: str  # for the progress bar
    work: Any  # argument of `Kind.solve`
    block: str = ""  # id of the block


def add_keys(block: str, rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows as every file has them: block, method and problem first, then the columns of the kind."""
    keys = [key for key in ("method", "problem") if key in rows.columns]
    return rows.select(pl.lit(block).alias("block"), *keys, pl.exclude("block", *keys))


@dataclass(frozen=True)
class Compared:
    """A measure on which two runs are compared, problem by problem."""

    words: str  # its name in the comparison
    unit: str  # % for a share
    better: str  # more or less
    column: str  # of the rows: truth values for a share, else positive numbers
    scale: float = 1.0  # from the column to the unit
    only: str = ""  # column of truth values: problems are compared where it is true in both runs
    rounds: tuple[str, str] | tuple[()] = ()  # columns of the least and the largest value of a call's rounds
    clock: bool = False  # a time of computing, which depends on the machine and its load
    exact: bool = False  # every run gives the same value up to rounding: any change counts, without a test

    @property
    def is_share(self) -> bool:
        """Whether the values are truth values, whose rates are compared."""
        return self.unit == "%"


@dataclass(frozen=True)
class BlockRows:
    """A block with its rows and facts; the facts on each entry are in ``entries`` by label."""

    block: Any
    rows: pl.DataFrame
    folder: RunFolder
    facts: dict[str, Any]
    kind: str = ""  # by which other tables of the block are found

    @cached_property
    def entries(self) -> dict[str, dict[str, Any]]:
        """Facts on every entry by label, in the order of the suite."""
        known = self.facts.get("entries", {})
        return {label: known[label] for label in self.block.labels if label in known}

    def table(self, name: str) -> pl.DataFrame | None:
        """Return another table of the block than its rows; None if it was not written."""
        return self.folder.read(rows_file(self.kind, self.block.id, f"{name}.parquet"))


class Kind:
    """A kind of block: it reads the settings, divides or does the work, and reads the rows. Its module names it ``METHOD``."""

    name: ClassVar[str]  # also of its folder of rows in a run
    title: ClassVar[str]  # for people
    block: ClassVar[type[Block]]
    compared: ClassVar[tuple[Compared, ...]] = ()  # on which two runs are compared
    read_as: ClassVar[type[BlockRows]] = BlockRows
    has_facts: ClassVar[bool] = False  # a file of facts on its blocks, besides their rows
    single: ClassVar[bool] = False  # one block of a suite, a table, instead of a list of tables
    order: ClassVar[int] = 100  # position in a run and in lists: smaller first
    alone: ClassVar[bool] = True  # timed by itself in the first process
    on_paper: ClassVar[bool] = False  # its rows bear on the paper's claims
    warms: ClassVar[bool] = False  # its first calls compile so much that `warm` is worth a process

    # ------------------------------------------------------------ work

    def settings(self, data: Any) -> Block:
        """Check the settings of one block, as the suite's file has them."""
        return self.block.read(data)

    def prepare(self, block: Any, seed: int) -> Any:
        """Check before anything is written what needs a trial; the result is passed to `parts`."""
        return None

    def warm(self, block: Any) -> None:
        """Make the first calls of a block, in another process, so that compiled kernels are in the cache before its run."""
        return

    def parts(self, block: Any, prepared: Any, folder: RunFolder) -> Iterable[Part]:
        """Return all parts of a block, including finished ones; none if the block is only timed alone."""
        return ()

    def part(self, block: Any, name: str, label: str, work: Any) -> Part:
        """Return one part of a block, whose name orders its rows."""
        return Part(self.file(block, "parquet", name), label, work, block.id)

    def solve(self, work: Any) -> pl.DataFrame:
        """Do one part, in any process, and return its rows."""
        rows: pl.DataFrame = work.solve()
        return rows

    def run(self, block: Any, seed: int, folder: RunFolder, tell: Tell) -> None:
        """Do the unfinished parts of a block that is timed alone."""
        with Journal(folder, self.file(block, JOURNAL)) as journal:
            for name, work in self.timed(block, seed, folder, tell, journal):
                file = self.file(block, "parquet", name)
                if not folder.has(file):
                    folder.write(file, add_keys(block.id, work()))

    def timed(
        self, block: Any, seed: int, folder: RunFolder, tell: Tell, journal: Journal
    ) -> Iterator[tuple[str, Callable[[], pl.DataFrame]]]:
        """Yield name and work of each part of a block that is timed alone: by default one, the result of `measure`."""
        yield "0000", partial(self.measure, block, seed, tell)

    def measure(self, block: Any, seed: int, tell: Tell) -> pl.DataFrame:
        """Do all work of a block that is timed alone, and return its rows with the label of the entry in ``method``."""
        raise NotImplementedError(f"{type(self).__name__} has neither measure() nor timed()")

    # ------------------------------------------------------------ what came of it

    def file(self, block: Any, ending: str = "parquet", part: str = "") -> str:
        """Name of a file of a block in the run folder: of a part of its rows, or another one."""
        return rows_file(self.name, block.id, ending, part)

    def rows(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """Return all rows of a block with the columns that follow from them; None if it was not run."""
        rows = folder.rows(self.name, block.id)
        return None if rows is None else self.complete(rows, block)

    def complete(self, rows: pl.DataFrame, block: Any) -> pl.DataFrame:
        """Return the stored rows of a block with the columns that follow from them."""
        return rows

    def compared_rows(self, block: Any, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared, method by method and problem by problem."""
        return rows

    def rows_to_compare(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """Return the rows of `compared_rows`; None if the block was not run."""
        rows = self.rows(folder, block)
        return None if rows is None else self.compared_rows(block, rows)

    def read(self, folder: RunFolder, block: Any) -> BlockRows | None:
        """Return a block with its rows for the report; None if it was not run."""
        rows = self.rows(folder, block)
        return None if rows is None else self.read_as(block, rows, folder, self.facts(folder, block), self.name)

    def facts(self, folder: RunFolder, block: Any) -> dict[str, Any]:
        """Return the facts on a block besides its rows."""
        facts: dict[str, Any] | None = folder.read_json(self.file(block, "json")) if self.has_facts else {}
        if facts is None:
            files = self.file(block, "parquet", "*")
            raise InvalidInput("run", f"no facts on {block.id!r}", f"complete parts; delete {files} and run again")
        return facts

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        """Return the value of a target and the number of rows that it was computed on, or NaN and the reason for no value."""
        if rows is None:
            return float("nan"), "it was not run"
        measure = measure_named(self.block.measures, target.measure, "measure")
        wanted = [label for label in (target.method, target.to) if label]
        for label in wanted:
            if rows.filter(pl.col("method") == label).is_empty():
                return float("nan"), f"{label} was not run"
        chosen, note = self.judged_rows(rows.filter(pl.col("method").is_in(wanted)) if wanted else rows, target)
        if chosen.is_empty():
            return float("nan"), note
        return measure.value(chosen, *(wanted if measure.relative else ())), note

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        """Return the rows of the entries of a target on which it is judged, and their number in words."""
        return rows, f"{len(rows):,} rows"

    def outcomes(self, block: Any, folder: RunFolder) -> list[Outcome]:
        """Return the outcome of every target of a block."""
        rows = self.rows(folder, block) if block.targets else None
        return [
            Outcome(
                block.id, block.title, target, measure_named(self.block.measures, target.measure, "measure"),
                *self.judge(rows, target),
            )
            for target in block.targets
        ]  # fmt: skip


@cache
def load_kind(name: str) -> Kind:
    """Find a kind of block by its name."""
    if name not in KINDS:
        raise UnknownName("kind of block", name, tuple(KINDS))
    kind: Kind = import_module(KINDS[name]).METHOD()
    return kind
