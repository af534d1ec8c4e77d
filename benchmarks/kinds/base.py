"""What a kind of suite block is: its settings, its work, its rows, its measures and its sections of the report."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import cache
from typing import Any, ClassVar

import polars as pl

from benchmarks.kinds._block import Block, BlockRows, Entry, Part, Section
from benchmarks.kinds._compared import Compared
from benchmarks.kinds._contest import timed, turns
from benchmarks.kinds._shown import Column, Shown, Table, Winner
from benchmarks.records import RunFolder, slug
from benchmarks.settings import NAMED_KEYS, Target, all_of, check_keys, check_known
from benchmarks.targets import Measure, Outcome, measure_named, read_target
from optik.registry import load_method

__all__ = [
    "KINDS", "Block", "BlockRows", "Column", "Compared", "Entry", "Kind", "Measure", "Outcome", "Part", "Section", "Table",
    "Target", "Tell", "Winner", "load_kind", "read_target", "timed", "turns",
]  # fmt: skip

KINDS = "benchmarks.kinds"
"""The package in which a kind is found by its name."""

Tell = Callable[[str], None]
"""Called with what is done next, for the progress bar."""


class Kind(Shown, ABC):
    """A kind of suite block. Its file, or the ``__init__.py`` of its folder, names its class ``METHOD``.

    Needed are `settings`, and `measure` or, where that is too simple, `run` or `parts` with `solve`. All else has a
    default: rows are read from one file a block, each measure is computed on the rows whose column ``method`` is the
    entry's label, and the report shows a table of all entries and measures and its targets at the end.

    Attributes
    ----------
    name : str
        By which a suite asks for it; also names its folder in a run.
    measures : tuple of Measure
        What a target of its blocks may ask for.
    single : bool
        Whether a suite has one block of it, a table, or any number, a list of tables.
    order : int
        When it runs, and where its blocks stand in lists: smaller first.
    alone : bool
        Whether it has work of its own beside its parts, timed by itself in the first process.
    on_paper : bool
        Whether its rows bear on the paper's claims.
    warms : bool
        Whether its first calls compile so much that `warm` is worth a process of its own.
    """

    name: ClassVar[str]
    measures: ClassVar[tuple[Measure, ...]] = ()
    single: ClassVar[bool] = False
    order: ClassVar[int] = 100
    alone: ClassVar[bool] = True
    on_paper: ClassVar[bool] = False
    warms: ClassVar[bool] = False

    # ------------------------------------------------------------ settings

    @abstractmethod
    def settings(self, data: Any) -> Block:
        """Check the settings of one block and return it.

        Parameters
        ----------
        data : object
            What the suite's file has under the name of this kind: a table, where the author made no mistake.

        Returns
        -------
        Block
            The block, of this kind's own class.

        Raises
        ------
        InvalidInput, UnknownName
            A wrong key, value or name.
        """

    def common(self, data: Any, known: Collection[str] = (), need: Collection[str] = ()) -> dict[str, Any]:
        """Check the keys of a block, and read its id, its title and what is found by a name.

        Parameters
        ----------
        data : object
            What the suite's file has.
        known : collection of str
            Keys of this kind, beside ``id``, ``title`` and ``targets``.
        need : collection of str
            Those of them that must be there.

        Returns
        -------
        dict
            Arguments of a `Block`: ``id``, ``title``, and what of `NAMED_KEYS` it has: a name or a file's absolute path.

        Raises
        ------
        InvalidInput
            No table, an unknown key, one that is missing, or a file that does not exist.
        UnknownName
            As `check_known`.
        """
        check_keys(data, {"id", "title", "targets", *known}, self._where(data), need={"id", *need})
        named = {key: check_known(data[key], *where) for key, where in NAMED_KEYS.items() if key in data}
        return {"id": str(data["id"]), "title": str(data.get("title", data["id"]))} | named

    def targets(self, data: dict[str, Any], labels: Sequence[str] = ()) -> tuple[Target, ...]:
        """Read the targets of a block.

        Parameters
        ----------
        data : dict
            What the suite's file has.
        labels : sequence of str
            Labels of the block's entries; a target that names none asks the first.

        Returns
        -------
        tuple of Target
            Empty where there are none.

        Raises
        ------
        InvalidInput
            A measure that the kind does not have, a label that the block does not have, or not exactly one bound.
        """
        at = self._where(data)
        return all_of(
            data.get("targets"), f"{at}: targets", lambda one: read_target(one, at, self.measures, labels=labels)
        )

    def _where(self, data: Any) -> str:
        """How errors call a block."""
        return f"{self.name} {data.get('id', '?')!r}" if isinstance(data, dict) else self.name

    def prepare(self, block: Any, seed: int) -> Any:
        """Check what only trying shows, before anything is written.

        Parameters
        ----------
        block : Block
            The block.
        seed : int
            Of the suite.

        Returns
        -------
        object
            What `parts` is given: problems that were drawn here need not be drawn again.

        Raises
        ------
        InvalidInput
            Options that a method or a problem set does not have.
        """
        return None

    # ------------------------------------------------------------ work

    def warm(self, block: Any) -> None:
        """Make the first calls of a block, in another process, so that compiled kernels are in the cache when it is run.

        Parameters
        ----------
        block : Block
            The block.
        """
        return

    def parts(self, block: Any, prepared: Any, folder: RunFolder) -> Iterable[Part]:
        """Work that any process may do: none, where a block is only timed by itself.

        Parameters
        ----------
        block : Block
            The block.
        prepared : object
            What `prepare` returned.
        folder : RunFolder
            The run.

        Returns
        -------
        iterable of Part
            The parts, those that are done already among them.
        """
        return ()

    def solve(self, work: Any) -> pl.DataFrame:
        """Do one part; in a process of its own where the run has several.

        Parameters
        ----------
        work : object
            Of the part.

        Returns
        -------
        DataFrame
            Its rows.

        Raises
        ------
        NotImplementedError
            A kind that has parts must define it.
        """
        raise NotImplementedError(f"{type(self).__name__} has parts and no solve()")

    def measure(self, block: Any, seed: int, tell: Tell) -> pl.DataFrame:
        """Do all work of a block, timed by itself.

        Parameters
        ----------
        block : Block
            The block.
        seed : int
            Of the suite.
        tell : callable
            Called with what is done next.

        Returns
        -------
        DataFrame
            Its rows, with the label of the entry in the column ``method`` where the block has entries.

        Raises
        ------
        NotImplementedError
            A kind whose `run` is not its own must define it.
        """
        raise NotImplementedError(f"{type(self).__name__} has neither measure() nor run()")

    def run(self, block: Any, seed: int, folder: RunFolder, tell: Tell) -> None:
        """Do what a block still lacks, timed by itself: by default, write what `measure` returns.

        Parameters
        ----------
        block : Block
            The block.
        seed : int
            Of the suite.
        folder : RunFolder
            The run.
        tell : callable
            Called with what is done next.
        """
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
        """Folder of its parts in a run, by which failures are told from those of another kind's block of the same name."""
        return self.folder

    def file(self, block: Any, ending: str = "parquet") -> str:
        """Name of a file of a block in the run folder.

        Parameters
        ----------
        block : Block
            The block.
        ending : str
            Of the name.

        Returns
        -------
        str
            ``kinds/KIND/BLOCK.ENDING``.
        """
        return f"{self.folder}/{slug(block.id)}.{ending}"

    def rows(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """All rows of a block.

        Parameters
        ----------
        folder : RunFolder
            The run.
        block : Block
            The block.

        Returns
        -------
        DataFrame or None
            None where nothing was run.
        """
        return folder.read(self.file(block))

    def rows_to_compare(self, folder: RunFolder, block: Any) -> pl.DataFrame | None:
        """Rows of a block as two runs are compared on them.

        Parameters
        ----------
        folder : RunFolder
            The run.
        block : Block
            The block.

        Returns
        -------
        DataFrame or None
            As `compared_rows` has them; None where nothing was run.
        """
        rows = self.rows(folder, block)
        return None if rows is None else self.compared_rows(block, rows)

    def read(self, folder: RunFolder, block: Any) -> BlockRows | None:
        """A block with its rows for the report.

        Parameters
        ----------
        folder : RunFolder
            The run.
        block : Block
            The block.

        Returns
        -------
        BlockRows or None
            None where nothing was run.
        """
        rows = self.rows(folder, block)
        return None if rows is None else BlockRows(block, rows, folder, {})

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        """Value of a target on the rows of a block.

        Parameters
        ----------
        rows : DataFrame or None
            All rows of the block.
        target : Target
            What was asked.

        Returns
        -------
        value : float
            NaN where there are no rows.
        note : str
            How many rows it is computed from, or why there is none.
        """
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
        """The outcome of every target of a block.

        Parameters
        ----------
        block : Block
            The block.
        folder : RunFolder
            The run.

        Returns
        -------
        list of Outcome
            In the order of the targets.
        """
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


def load_kind(name: str) -> Kind:
    """Find a kind of block by its name."""
    return _built(load_method(KINDS, name, "kind of block"))


@cache
def _built(kind: type[Kind]) -> Kind:
    """The one instance of a kind."""
    return kind()


METHOD_BASE = Kind
"""What the METHOD of every kind, ours or a plug-in's, is a subclass of."""
