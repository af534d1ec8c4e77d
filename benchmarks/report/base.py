"""The interface of the report: sections, tables, winners, and the report of a kind of block."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.blocks.base import KINDS, Kind
from benchmarks.statistics import is_too_few

if TYPE_CHECKING:
    from benchmarks.report.run import Run

QUESTION = Path(__file__).parent / "templates" / "question.html.j2"
"""Template of a section that answers a question: an answer, plots, tables, then text."""

Cell = str | float | int | None | tuple[float, float, float]
"""A value of a table: text, a number, None if there is none, or a value with the ends of its interval."""


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
    """The winner of a question and the other entries, for the first screen of the page.

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
    def is_too_few(self) -> bool:
        """Whether the paired test cannot find a difference in so few values."""
        return self.count is not None and is_too_few(self.count, len(self.entries) - 1)

    @property
    def sample(self) -> str:
        """Number of values in the paired test, with a note if they are too few; empty without a test."""
        few = ": too few for a test" if self.is_too_few else ""
        return "" if self.count is None else f" (n = {self.count:,}{few})"

    @property
    def tied(self) -> tuple[str, ...]:
        """Labels of the best and of all not significantly different from it, by the paired test or overlapping intervals.

        With too few values for a test, entries are ranked by value: only those with the best value are tied.
        """
        _, best, low, high = self.entries[0]
        if self.is_too_few:
            return tuple(label for label, value, *_ in self.entries if value == best)
        if self.level is not None:
            return self.level
        return tuple(label for label, _, a, b in self.entries if a <= high and b >= low)


@dataclass(frozen=True)
class Section:
    """One section of the report, or one piece of a section: pieces with the same anchor have a common heading.

    Attributes
    ----------
    title, anchor : str
        Heading, and its address on the page.
    build : callable
        From the run to what the template shows (its ``c``); None where the run has no data for it.
    template : Path
        A Jinja template.
    order : int
        Position on the page, smaller first: 10 to 19 single calls, 20 time laws on many lines, 30 to 60 iteration budgets,
        70 to 90 one line planned, from 100 what closes the page.
    place : str
        ``section``; or ``top`` for a picture on the first screen, ``terms`` for what counts as solved, ``summary`` for what
        was run.
    """

    title: str
    anchor: str
    build: Callable[[Run], dict[str, Any] | None]
    template: Path = QUESTION
    order: int = 95
    place: str = "section"


def _nothing(run: Run) -> Sequence[Any]:
    return ()


@dataclass(frozen=True)
class KindReport:
    """The report of one kind of block. The kind's module in `report` names it ``REPORT``.

    Attributes
    ----------
    sections : tuple of Section
        Its sections of the page.
    subjects : callable
        From its blocks to what they compare, for the first sentence of the report.
    winners : callable
        Who is best at what, for the first screen.
    tables : callable
        Tables that a reader takes out of the report.
    findings : callable
        Key findings for the head of the report, computed.
    limitations : callable
        What a reader should know before quoting its figures.
    labels : callable
        What of a block has a colour on the page.
    """

    sections: tuple[Section, ...]
    subjects: Callable[[Sequence[Any]], Sequence[str]]
    winners: Callable[[Run], Sequence[Winner]] = _nothing
    tables: Callable[[Run], Sequence[Table]] = _nothing
    findings: Callable[[Run], Sequence[str]] = _nothing
    limitations: Callable[[Run], Sequence[str]] = _nothing
    labels: Callable[[Any], Sequence[str]] = lambda block: block.labels


def load_report(kind: Kind) -> KindReport:
    """Find the report of a kind of block."""
    found: KindReport = import_module(KINDS[kind.name].replace(".blocks.", ".report.")).REPORT
    return found
