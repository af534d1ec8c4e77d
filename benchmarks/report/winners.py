"""Winners: one row for each question that the kinds of the run answer."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.report.base import Cell, Column, Table, Winner, load_report
from benchmarks.report.run import Run
from benchmarks.report.shown import written
from benchmarks.report.words import listed

MOST_TIED = 3
"""Number of ties that are named; of more only their number is given."""

WINNER_COLUMNS = (
    Column("question", "Question", show="text"),
    Column("best", "Best", show="text"),
    Column("value", "Value", show="mixed"),
    Column("unit", "Unit", show="text"),
    Column("tied", "Not significantly different", show="text"),
    Column("second", "Next best", show="text"),
    Column("second_value", "Value of the next best", show="mixed"),
    Column("note", "Problems", show="text"),
)
"""Columns of the winners as a table."""


@dataclass(frozen=True)
class Place:
    """One entry of a question, as the page shows it."""

    label: str
    colour: str
    value: str
    interval: str


@dataclass(frozen=True)
class Won:
    """One question with its winner, as the page shows it."""

    question: str
    anchor: str
    note: str
    how: str
    best: Place
    tied: tuple[str, ...]
    remark: str
    second: Place | None


def winners(run: Run) -> list[Winner]:
    """Return every question with its entries, in the order of the kinds."""
    return [winner for kind in run.suite.kinds for winner in load_report(kind).winners(run) if winner.entries]


def won(run: Run) -> list[Won]:
    """Return the winners as the first screen of the page shows them."""
    return [_won(winner, run) for winner in winners(run)]


def _won(winner: Winner, run: Run) -> Won:
    places = [_place(winner, entry, run) for entry in winner.entries]
    tied, second = _order(winner)
    return Won(
        winner.question,
        winner.anchor,
        winner.note,
        winner.how,
        places[0],
        tied,
        _remark(winner, tied),
        places[second] if second is not None else None,
    )


def _remark(winner: Winner, tied: tuple[str, ...]) -> str:
    """Name the entries tied with the best, and say if there are too few values for a test."""
    if not tied:
        return f"ranked by value{winner.sample}" if winner.is_too_few else ""
    words = "same value" if winner.is_too_few else "not significantly different"
    return f"{words}{winner.sample}: {tied_words(tied)}"


def _order(winner: Winner) -> tuple[tuple[str, ...], int | None]:
    """Return the labels tied with the best, and the first entry that is not; None if all are tied."""
    level = winner.tied
    tied = tuple(label for label in level if label != winner.entries[0][0])
    rest = [k for k, entry in enumerate(winner.entries) if entry[0] not in level]
    return tied, rest[0] if rest else None


def _place(winner: Winner, entry: tuple[str, float, float, float], run: Run) -> Place:
    label, middle, low, high = entry
    share = winner.unit == "%"
    value, interval = written("share" if share else "precise" if low == high else "number", middle, low, high)
    unit = f" {winner.unit}" if winner.unit else ""
    return Place(label, run.colour(label) if label in run.labels else "", f"{value}{unit}", interval)


def tied_words(labels: tuple[str, ...]) -> str:
    """Name the entries tied with the best."""
    return listed(labels) if len(labels) <= MOST_TIED else f"{listed(labels[:2])} and {len(labels) - 2} more"


def winners_table(run: Run) -> Table | None:
    """Return the winners as a table for other formats."""
    rows: list[dict[str, Cell]] = []
    for winner in winners(run):
        label, *value = winner.entries[0]
        tied, second = _order(winner)
        few = f"ranked by value{winner.sample}" if winner.is_too_few else ""
        row: dict[str, Cell] = {
            "question": winner.question, "best": label, "value": (value[0], value[1], value[2]), "unit": winner.unit,
            "tied": listed(tied),
            "note": "; ".join(words for words in (winner.note, winner.how, few) if words),
        }  # fmt: skip
        if second is not None:
            other, *ends = winner.entries[second]
            row |= {"second": other, "second_value": (ends[0], ends[1], ends[2])}
        rows.append(row)
    return Table("winners", "Best method by question", WINNER_COLUMNS, tuple(rows)) if rows else None
