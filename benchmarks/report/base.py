"""The interface of the report: sections, winners, and the report of a kind of block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.blocks.base import KINDS, Kind
from benchmarks.report.tables import Table
from benchmarks.statistics import is_too_few

if TYPE_CHECKING:
    from benchmarks.report.run import Run

QUESTION = Path(__file__).parent / "templates" / "question.html.j2"
"""Template of a section that answers a question: an answer, plots, tables, then text."""


@dataclass(frozen=True)
class Winner:
    """The winner of a question and the other entries, for the first screen of the page."""

    question: str
    """As a reader asks it: "Solves the most targets, from one fixed start"."""
    unit: str
    better: str
    """``more`` or ``less``."""
    entries: tuple[tuple[str, float, float, float], ...]
    """Label, value, and the ends of its 95 % interval, of all that took part; the best first."""
    anchor: str
    """Section of the page that has the rest."""
    note: str = ""
    """Which problems, how many, and who is not ranked and why."""
    how: str = ""
    """What the intervals are, and by which test ties are found; the page shows it on request."""
    level: tuple[str, ...] | None = None
    """Labels of the best and of those that a paired test does not tell from it, where one was made."""
    count: int | None = None
    """Number of problems or motions in the paired test."""

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
    """One section of the report, or one piece of a section: pieces with the same anchor have a common heading."""

    title: str
    anchor: str
    build: Callable[[Run], dict[str, Any] | None]
    """From the run to what the template shows (its ``c``); None where the run has no data for it."""
    template: Path = QUESTION
    order: int = 95
    """Position on the page, smaller first: 10 to 19 single calls, 20 time laws on many lines, 30 to 60 iteration budgets,
    70 to 90 one line planned, from 100 what closes the page."""
    place: str = "section"
    """``section``; or ``top`` for a picture on the first screen, ``terms`` for what counts as solved, ``summary`` for what
    was run."""


def _nothing(run: Run) -> Sequence[Any]:
    return ()


@dataclass(frozen=True)
class KindReport:
    """The report of one kind of block. The kind's module in `report` names it ``REPORT``."""

    sections: tuple[Section, ...]
    subjects: Callable[[Sequence[Any]], Sequence[str]]
    """From its blocks to what they compare, for the first sentence of the report."""
    winners: Callable[[Run], Sequence[Winner]] = _nothing
    """Who is best at what, for the first screen."""
    tables: Callable[[Run], Sequence[Table]] = _nothing
    findings: Callable[[Run], Sequence[str]] = _nothing
    """Key findings for the head of the report, computed."""
    limitations: Callable[[Run], Sequence[str]] = _nothing
    """What a reader should know before quoting its figures."""
    labels: Callable[[Any], Sequence[str]] = lambda block: block.labels
    """What of a block has a colour on the page."""


def load_report(kind: Kind) -> KindReport:
    """Find the report of a kind of block."""
    found: KindReport = import_module(KINDS[kind.name].replace(".blocks.", ".report.")).REPORT
    return found
