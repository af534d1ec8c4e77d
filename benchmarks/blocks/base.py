"""The interface of a kind of block: declared fields, shards of work, and the reading of rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Self

import polars as pl

from benchmarks.blocks.block import Block, Target, TargetOutcome, measure_named
from benchmarks.records import UNKEPT, Journal, RunFolder, rows_file
from optik.errors import InvalidInput
from optik.registry import load_method, names

Tell = Callable[[str], None]
"""Called with a description of the next work, for the progress bar."""


def silent(what: str) -> None:
    """Show nothing of the work."""


GROUP = "benchmarks.blocks"
"""The folder of the kinds of block, and the group of entry points of packages that add some."""


# ---------------------------------------------------------------- rows


@dataclass(frozen=True)
class Field:
    """A column of the rows of a kind: its type, its value where a method crashed, and how two runs are compared on it.

    Two runs are compared on the fields that have `better`, problem by problem.
    """

    type: Any  # of Polars
    lost: Any = None  # its value in the row of a method that crashed its process
    words: str = ""  # its name in a comparison
    unit: str = ""  # % for a rate
    better: str = ""  # "more" or "less": which values are better; empty if neither
    scale: float = 1.0  # from the column to the unit
    only: str = ""  # field of truth values: problems are compared where it is true in both runs
    rounds: tuple[str, str] | tuple[()] = ()  # fields of the least and the largest value of a call's rounds
    clock: str = ""  # of a computing time, which depends on the machine and its load: wall or cpu
    exact: bool = False  # every run gives the same value up to rounding: any change counts, without a test
    stored: bool = True  # false where it follows from the other fields when the rows are read

    @property
    def is_share(self) -> bool:
        """Whether the values are truth values, whose rates are compared."""
        return self.unit == "%"


TEXT, NUMBER, WHOLE, TRUTH = Field(pl.String), Field(pl.Float64), Field(pl.Int64), Field(pl.Boolean)
"""Fields that only have a type."""


def fields_of(field: Field, names: str) -> dict[str, Field]:
    """Return a field under each of some names, which are separated by spaces."""
    return dict.fromkeys(names.split(), field)


def add_keys(block: str, rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows as every file has them: block, method and problem first, then the columns of the kind."""
    keys = [key for key in ("method", "problem") if key in rows.columns]
    return rows.select(pl.lit(block).alias("block"), *keys, pl.exclude("block", *keys))


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

    @cached_property
    def by_method(self) -> dict[str, pl.DataFrame]:
        """Rows of every method that has some, in the order of the suite."""
        parts = self.rows.partition_by("method", as_dict=True)
        return {label: parts[(label,)] for label in self.block.labels if (label,) in parts}

    def table(self, name: str) -> pl.DataFrame | None:
        """Return another table of the block than its rows; None if it was not written."""
        return self.folder.read(rows_file(self.kind, self.block.id, f"{name}.parquet"))


# ---------------------------------------------------------------- work


@dataclass(frozen=True)
class Session:
    """What the shards of a block need of the run in progress."""

    kind: Kind
    block: Any
    seed: int
    folder: RunFolder
    prepared: Any = None  # the result of `Kind.prepare`
    journal: Journal = UNKEPT  # of a block that is timed alone: the method at work, and those that crashed
    tell: Tell = silent  # shows the next work in the progress bar

    @cached_property
    def shared(self) -> Any:
        """The result of `Kind.share`, made once."""
        return self.kind.share(self)


def chunks(values: Any, size: int) -> Iterator[Any]:
    """Yield slices of a sequence, all of a size but for the last."""
    for first in range(0, len(values), size):
        yield values[first : first + size]


@dataclass(frozen=True)
class Work:
    """The work of a shard. It can be pickled, unless its kind is timed alone; a subclass is divided along its lists."""

    lists: ClassVar[tuple[str, ...]] = ()
    """Fields with one value for each problem."""
    owner: ClassVar[str] = ""
    """Label of the only method of the work; empty if there are several."""

    def solve(self) -> pl.DataFrame:
        """Do the work, and return its rows."""
        raise NotImplementedError

    def crashed(self) -> pl.DataFrame | None:
        """Return the rows of problems in which a method crashed its process, raised an error, or did not end; None for none."""
        return None

    def halves(self) -> tuple[Self, ...]:
        """Divide the work in two, to find the problem that crashes a process; return nothing for a single problem."""
        count = len(getattr(self, self.lists[0])) if self.lists else 1
        cuts = (slice(count // 2), slice(count // 2, count)) if count > 1 else ()
        return tuple(replace(self, **{name: getattr(self, name)[cut] for name in self.lists}) for cut in cuts)


@dataclass(frozen=True)
class Trials(Work):
    """Some problems of a block by some of its methods, which are solved by `Kind.solve`."""

    lists: ClassVar[tuple[str, ...]] = ("numbers",)

    kind: Kind
    block: Any
    seed: int
    numbers: tuple[int, ...]
    labels: tuple[str, ...]
    session: Session | None = None  # None where the kind is not timed alone

    @property
    def owner(self) -> str:  # type: ignore[override]
        """Label of the only method of the work; empty if there are several."""
        return self.labels[0] if len(self.labels) == 1 else ""

    def solve(self) -> pl.DataFrame:
        """Solve the problems, and return their rows."""
        return self.kind.frame(self.kind.solve(self))

    def crashed(self) -> pl.DataFrame:
        """Return the rows of a method that crashed."""
        return self.kind.frame(self.kind.lost(**keys) for keys in self.kind.keys(self))

    def halves(self) -> tuple[Self, ...]:
        """Divide the work among its methods first, so that one that crashes a process costs its own rows."""
        if len(self.labels) <= 1:
            return super().halves()
        half = len(self.labels) // 2
        return tuple(replace(self, labels=some) for some in (self.labels[:half], self.labels[half:]))


@dataclass(frozen=True)
class Shard:
    """One part of a block: a file of rows, and the work that writes it. A part whose file exists is done."""

    name: str  # orders its rows in the block
    work: Work | Callable[[], pl.DataFrame]  # a function where the kind is timed alone
    label: str = ""  # for the progress bar
    file: str = ""  # in the run folder
    block: str = ""  # id of the block

    def solve(self) -> pl.DataFrame:
        """Do the work, and return its rows."""
        return self.work.solve() if isinstance(self.work, Work) else self.work()


# ---------------------------------------------------------------- kinds


class Kind:
    """A kind of block: it declares the fields of its rows, solves its problems, and reads the rows.

    A simple kind has `count` and `solve`: then each shard has `size` problems, by all methods. Others yield their own
    `shards`. Its module names it ``METHOD``, and the section of the report ``REPORT`` if the kind has one of its own.
    """

    name: ClassVar[str]  # key of a suite, folder of rows in a run, and anchor of the section in a report
    title: ClassVar[str]  # for people
    block: ClassVar[type[Block]]
    fields: ClassVar[Mapping[str, Field]] = {}  # of the rows, in their order
    size: ClassVar[int] = 1  # problems of a shard
    read_as: ClassVar[type[BlockRows]] = BlockRows
    has_facts: ClassVar[bool] = False  # a file of facts on its blocks, besides their rows
    order: ClassVar[int] = 100  # position in a run and in lists: smaller first
    alone: ClassVar[bool] = True  # timed by itself in the first process
    on_paper: ClassVar[bool] = False  # its rows bear on the paper's claims

    # ------------------------------------------------------------ work

    def settings(self, data: Any) -> Block:
        """Check the settings of one block, as the suite's file has them."""
        return self.name_block(self.block.read(data))

    def name_block(self, block: Block) -> Block:
        """Give a block without a title the title of its kind with the id."""
        return block if block.title else block.model_copy(update={"title": f"{self.title}: {block.id}"})

    def prepare(self, block: Any, seed: int) -> Any:
        """Check what only a trial can show, before anything is written. The result is `Session.prepared`."""
        return None

    def share(self, session: Session) -> Any:
        """Return the data that all shards of a block that is timed alone use, after first calls that compile."""
        return None

    def shards(self, block: Any, session: Session) -> Iterable[Shard]:
        """Yield every shard of a block, also those that are done: by default `size` problems each, by all methods."""
        here, count = session if self.alone else None, self.count(block, session)
        for number, some in enumerate(chunks(range(count), self.size)):
            label = f"{block.id}: problem {some[0] + 1:,} of {count:,}" if self.alone else block.title
            work = Trials(self, block, session.seed, tuple(some), block.labels, here)
            yield Shard(f"{number:04d}", work, label)

    def count(self, block: Any, session: Session) -> int:
        """Return the number of problems of a block."""
        raise NotImplementedError(f"{type(self).__name__} has neither count() and solve() nor shards()")

    def solve(self, trials: Trials) -> Iterable[Mapping[str, Any]]:
        """Solve some problems, and yield a mapping of fields by name for each row. Missing fields are None."""
        raise NotImplementedError(f"{type(self).__name__} has neither count() and solve() nor shards()")

    def keys(self, trials: Trials) -> Iterable[Mapping[str, Any]]:
        """Yield the fields that identify each row of some trials, for those that were lost."""
        return ({"method": label, "problem": number} for number in trials.numbers for label in trials.labels)

    def lost(self, **given: Any) -> dict[str, Any]:
        """Return the row of a method that crashed its process: the given fields, and `Field.lost` for all others."""
        return {name: field.lost for name, field in self.fields.items() if field.stored} | given

    def frame(self, rows: Iterable[Mapping[str, Any]]) -> pl.DataFrame:
        """Return rows as a table with the declared fields."""
        schema = {name: field.type for name, field in self.fields.items() if field.stored}
        return pl.DataFrame(list(rows), schema=schema)

    # ------------------------------------------------------------ results

    def file(self, block: Any, ending: str = "parquet", part: str = "") -> str:
        """Name of a file of a block in the run folder: of a shard of its rows, or another one."""
        return rows_file(self.name, block.id, ending, part)

    def rows(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """Return all rows of a block with the columns that follow from them; None if it was not run."""
        rows = folder.rows(self.name, block.id)
        return None if rows is None else self.complete(rows, block)

    def complete(self, rows: pl.DataFrame, block: Any) -> pl.DataFrame:
        """Return the stored rows of a block with the columns that follow from them."""
        return rows

    @property
    def compared(self) -> dict[str, Field]:
        """Fields on which two runs are compared."""
        return {name: field for name, field in self.fields.items() if field.better}

    def compared_rows(self, block: Any, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared, method by method and problem by problem."""
        return rows

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

    def outcomes(self, block: Any, folder: RunFolder) -> list[TargetOutcome]:
        """Return the outcome of every target of a block."""
        rows = self.rows(folder, block) if block.targets else None
        return [
            TargetOutcome(
                block.id, block.title, target, measure_named(self.block.measures, target.measure, "measure"),
                *self.judge(rows, target),
            )
            for target in block.targets
        ]  # fmt: skip


METHOD_BASE = Kind
"""Class of every kind of block."""


def kind_names() -> tuple[str, ...]:
    """Return the names of all kinds of block, in the order in which they run."""
    return tuple(sorted(names(GROUP), key=lambda name: (load_kind(name).order, name)))


@cache
def load_kind(name: str) -> Kind:
    """Find a kind of block by its name: one of ours, or one of an installed package."""
    kind: Kind = load_method(GROUP, name, "kind of block")()
    return kind
