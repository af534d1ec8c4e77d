"""What a kind of block shows: sections of the page, tables that leave it, and who wins on what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import polars as pl

from benchmarks.kinds._block import Block, Section
from benchmarks.kinds._compared import Compared
from benchmarks.statistics import is_too_few

if TYPE_CHECKING:
    from benchmarks.report.run import Run

Cell = str | float | int | None | tuple[float, float, float]
"""A value of a table: text, a number, None where there is none, or a value with the ends of its interval."""


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    key : str
        By which rows have their values.
    words : str
        Its heading, without the unit.
    unit : str
        Of its values; empty for text, counts and ratios.
    better : str
        ``more`` or ``less``, where one value is better than another; else empty.
    show : str
        ``number`` (three digits), ``precise`` (four), ``exact`` (seven), ``limit`` (a value over its limit: above 1 with as
        many digits as show it), ``p`` (a p-value), ``count``, ``share`` (a percentage), ``text``, or ``mixed`` (a share
        where the row's ``unit`` is %, else a number).
    aside : bool
        Whether the page shows it only on request: for columns that few readers ask for.
    among : str
        Key of what a row must have (a value that is neither None nor empty) to be the best in this column; any row may
        where this is empty. A motion that breaks a limit must not be called the shortest.
    """

    key: str
    words: str
    unit: str = ""
    better: str = ""
    show: str = "number"
    aside: bool = False
    among: str = ""


@dataclass(frozen=True)
class Table:
    """A table of the report, as the page shows it and as it is written as CSV, Markdown and LaTeX.

    Attributes
    ----------
    id : str
        Unique in the report; names its files.
    title : str
        Its caption.
    columns : tuple of Column
        Their order is that of the page.
    rows : tuple of mapping
        Values by the keys of the columns; ``label`` is the first column's, a method or law, whose colour the row has.
    note : str
        What a reader must know to quote it.
    """

    id: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Mapping[str, Cell], ...]
    note: str = ""


@dataclass(frozen=True)
class Winner:
    """Who is best at something, with the others, for the first screen of the page.

    Attributes
    ----------
    question : str
        What was asked, as a reader asks it: "Solves the most targets, from one fixed start".
    unit : str
        Of the values.
    better : str
        ``more`` or ``less``.
    entries : tuple of (str, float, float, float)
        Label, value, and the ends of its 95 % interval, of all that took part; the best first.
    anchor : str
        Section of the page that has the rest.
    note : str
        Which problems, how many, and who is not ranked and why.
    how : str
        What the intervals are, and by which test ties are found; the page shows it on request.
    level : tuple of str, optional
        Labels of the best and of those that a paired test does not tell from it, where one was made.
    count : int, optional
        Number of problems or motions in the paired test.
    """

    question: str
    unit: str
    better: str
    entries: tuple[tuple[str, float, float, float], ...]
    anchor: str
    note: str = ""
    how: str = ""
    level: tuple[str, ...] | None = None
    count: int | None = None

    @property
    def sample(self) -> str:
        """Number of values in the paired test, and whether they are too few for it; empty without a test."""
        if self.count is None:
            return ""
        few = ": too few for a test" if is_too_few(self.count, len(self.entries) - 1) else ""
        return f" (n = {self.count:,}{few})"

    @property
    def tied(self) -> tuple[str, ...]:
        """Labels of the best and of all that the paired test does not tell from it, or whose interval overlaps with its own."""
        if self.level is not None:
            return self.level
        _, _, low, high = self.entries[0]
        return tuple(label for label, _, a, b in self.entries if a <= high and b >= low)


class Shown:
    """The part of a kind that the report asks.

    Attributes
    ----------
    title : str
        Heading of its section.
    compared : tuple of Compared
        What two runs are compared on; a kind that names nothing is left out of comparisons.
    """

    title: ClassVar[str]
    compared: ClassVar[tuple[Compared, ...]] = ()

    def compared_rows(self, block: Any, rows: pl.DataFrame) -> pl.DataFrame:
        """Rows of a block as two runs are compared on them."""
        return rows.rename({"method": "label"})

    def sections(self) -> Sequence[Section]:
        """Its sections of the report; where there are none, the page has a table of its rows' measures."""
        return ()

    def subjects(self, blocks: Sequence[Any]) -> Sequence[str]:
        """What its blocks compare, for the first sentence of the report."""
        return (self.title[:1].lower() + self.title[1:],)

    def labels(self, block: Block) -> Sequence[str]:
        """What of a block has a colour on the page: by default all its entries."""
        return block.labels

    def winners(self, run: Run) -> Sequence[Winner]:
        """Who is best at what, for the first screen of the page."""
        return ()

    def tables(self, run: Run) -> Sequence[Table]:
        """Tables that a reader takes out of the report."""
        return ()

    def findings(self, run: Run) -> Sequence[str]:
        """Key findings for the head of the report, computed."""
        return ()

    def limitations(self, run: Run) -> Sequence[str]:
        """What a reader should know before quoting its figures."""
        return ()
