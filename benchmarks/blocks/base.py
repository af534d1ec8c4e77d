"""The interface of a block of a suite: its settings, its entries, the parts of its work, and its rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from typing import Annotated, Any, ClassVar, Self

import polars as pl
from pydantic import Field

from benchmarks.records import RunFolder, slug
from benchmarks.settings import LISTED, Settings, check_different, key, read
from benchmarks.targets import Measure, Outcome, Target, measure_named
from optik.errors import UnknownName

Tell = Callable[[str], None]
"""Called with a description of the next work, for the progress bar."""

KINDS = {
    **{name: f"benchmarks.blocks.ik.{name}" for name in ("budgets", "answers", "calls", "batch", "first_use")},
    **{name: f"benchmarks.blocks.timing.{name}" for name in ("plans", "laws", "clearance")},
    "cell": "benchmarks.blocks.cell",
}
"""Every kind of block with its module."""


class Block(Settings):
    """One block of a suite, as its file defines it."""

    noun: ClassVar[str] = "block"
    """Name of the block in errors, before its id."""
    measures: ClassVar[tuple[Measure, ...]] = ()
    """Measures that its targets can name."""

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
        return False

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms of the block."""
        return (self.robot,) if hasattr(self, "robot") else ()

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Methods, laws and peers that the block compares, in the order of the suite."""
        return ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all entries."""
        return tuple(entry.label for entry in self.entries)

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of its problems that a target can name."""
        return ()


@dataclass(frozen=True)
class Entry:
    """One competitor of a block: a method or law of ours, or a peer.

    Attributes
    ----------
    label : str
        Name in reports.
    name : str
        Name, or the path of a file, by which it is found.
    options : dict
        Its options.
    most : int or None
        Number of problems that a slow one is given; all where None.
    role : str
        ``ours``, ``law``, ``peer`` or ``reference``.
    whole : bool
        Whether each problem is one call with restarts, where others make one attempt.
    along : bool
        Whether a method makes its iterations at each pose of a line, each from the pose before.
    without : tuple of str
        Limits that a law does not know.
    """

    label: str
    name: str
    options: dict[str, Any]
    most: int | None = None
    role: str = "ours"
    whole: bool = False
    along: bool = False
    without: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Its options in words."""
        told = [f"without the limits on {' and '.join(self.without).replace('_', ' ')}"] if self.without else []
        return ", ".join([f"{key} = {value}" for key, value in self.options.items()] + told)


@dataclass(frozen=True)
class Part:
    """Work that any process may do, in any order; a part whose file exists is done.

    Attributes
    ----------
    file : str
        File of its rows in the run folder.
    label : str
        Words for the progress bar.
    work : object
        Argument of `Kind.solve`; it can be pickled. With ``halves()`` and ``crashed()``, work that ends its process costs
        only the rows of the problems that end it.
    """

    file: str
    label: str
    work: Any


@dataclass(frozen=True)
class Compared:
    """A measure on which two runs are compared, problem by problem.

    Attributes
    ----------
    words, unit : str
        Its name in the comparison, and the unit; ``%`` for a share.
    better : str
        ``more`` or ``less``.
    column : str
        Column of the rows: truth values for a share, else positive numbers.
    scale : float
        Factor from the column to the unit.
    only : str
        Column of truth values: problems are compared where it is true in both runs; all where empty.
    rounds : tuple of str
        Columns of the least and the largest value of the rounds of a timed call; empty where there are none.
    exact : bool
        Whether every run gives the same value, rounding aside: then any change is better or worse, without a test.
    """

    words: str
    unit: str
    better: str
    column: str
    scale: float = 1.0
    only: str = ""
    rounds: tuple[str, str] | tuple[()] = ()
    exact: bool = False

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

    @cached_property
    def entries(self) -> dict[str, dict[str, Any]]:
        """Facts on every entry by label, in the order of the suite."""
        known = self.facts.get("entries", {})
        return {label: known[label] for label in self.block.labels if label in known}


class Kind:
    """A kind of block: it reads the settings, divides or does the work, and reads the rows. Its module names it ``METHOD``.

    Attributes
    ----------
    name, title : str
        Name, also of its folder in a run, and words for people.
    block : type
        Its blocks.
    measures : tuple of Measure
        Measures that a target of its blocks may name.
    compared : tuple of Compared
        Measures on which two runs are compared.
    single : bool
        Whether a suite has one block of it, a table, or any number, a list of tables.
    order : int
        Position in a run and in lists: smaller first.
    alone : bool
        Whether it has work that is timed by itself in the first process, beside its parts.
    on_paper : bool
        Whether its rows bear on the paper's claims.
    warms : bool
        Whether its first calls compile so much that `warm` is worth a process of its own.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    block: ClassVar[type[Block]]
    measures: ClassVar[tuple[Measure, ...]] = ()
    compared: ClassVar[tuple[Compared, ...]] = ()
    single: ClassVar[bool] = False
    order: ClassVar[int] = 100
    alone: ClassVar[bool] = True
    on_paper: ClassVar[bool] = False
    warms: ClassVar[bool] = False

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

    def solve(self, work: Any) -> pl.DataFrame:
        """Do one part, in any process, and return its rows."""
        raise NotImplementedError(f"{type(self).__name__} has parts and no solve()")

    def measure(self, block: Any, seed: int, tell: Tell) -> pl.DataFrame:
        """Do all work of a block that is timed alone, and return its rows with the label of the entry in ``method``."""
        raise NotImplementedError(f"{type(self).__name__} has neither measure() nor run()")

    def run(self, block: Any, seed: int, folder: RunFolder, tell: Tell) -> None:
        """Do the unfinished work of a block that is timed alone: by default, write the result of `measure`."""
        if not folder.has(self.file(block)):
            tell(block.id)
            folder.write(self.file(block), self.measure(block, seed, tell))

    # ------------------------------------------------------------ what came of it

    @property
    def folder(self) -> str:
        """Its folder in a run."""
        return f"kinds/{slug(self.name)}"

    @property
    def parts_folder(self) -> str:
        """Folder of its parts in a run; it separates their failures from those of another kind's block with the same name."""
        return self.folder

    def file(self, block: Any, ending: str = "parquet") -> str:
        """Name of a file of a block in the run folder."""
        return f"{self.folder}/{slug(block.id)}.{ending}"

    def rows(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """Return all rows of a block; None if it was not run."""
        return folder.read(self.file(block))

    def compared_rows(self, block: Any, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared, with the columns ``label`` and ``problem``."""
        return rows.rename({"method": "label"})

    def rows_to_compare(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """Return the rows of `compared_rows`; None if the block was not run."""
        rows = self.rows(folder, block)
        return None if rows is None else self.compared_rows(block, rows)

    def read(self, folder: RunFolder, block: Any) -> BlockRows | None:
        """Return a block with its rows for the report; None if it was not run."""
        rows = self.rows(folder, block)
        return None if rows is None else BlockRows(block, rows, folder, {})

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        """Return the value of a target and the number of rows that it was computed on, or NaN and the reason for no value."""
        if rows is None:
            return float("nan"), "it was not run"
        measure = measure_named(self.measures, target.measure, "measure")
        wanted = [label for label in (target.method, target.to) if label]
        chosen = rows.filter(pl.col("method").is_in(wanted)) if wanted else rows
        for label in wanted:
            if chosen.filter(pl.col("method") == label).is_empty():
                return float("nan"), f"{label} was not run"
        value = measure.compute(chosen, *wanted) if measure.relative else measure.values(chosen)[0]
        return float(value), f"{len(chosen):,} rows"

    def outcomes(self, block: Any, folder: RunFolder) -> list[Outcome]:
        """Return the outcome of every target of a block."""
        if not block.targets:
            return []
        rows = self.rows(folder, block)
        return [
            Outcome(
                block.id, block.title, target, measure_named(self.measures, target.measure, "measure"),
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
