"""Who wins: ranking on equal problems, one row for each question of the run, and the head of the page with its findings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.experiments.base import PAPER_METHOD, PAPER_TITLE, PARTLY
from benchmarks.report.base import Run, Winner, load_report
from benchmarks.report.numbers import listed, quoted
from benchmarks.report.sections import failure_words
from benchmarks.report.tables import Cell, Column, Table, written
from benchmarks.statistics import mcnemar, not_told_apart, percentage
from optik.errors import UnknownName
from optik.registry import short_name
from optik.types import Flags

RANKED_PROBLEMS = 1000
"""Number of problems that suffices for a ranking: Wilson's interval of a rate is then 6 points wide, 0.4 near 100 %."""

MOST_TIED = 3
"""Number of ties that are named; of more only their number is given."""

WINNER_COLUMNS = (
    Column("question", "Question", show="text"),
    Column("best", "Best", show="text"),
    Column("value", "Value", show="mixed"),
    Column("unit", "Unit", show="text"),
    Column("tied", "Not significantly different", show="text"),
    Column("second", "Next", show="text"),
    Column("second_value", "Value of the next", show="mixed"),
    Column("note", "Problems", show="text"),
)
"""Columns of the winners as a table."""


# ---------------------------------------------------------------- ranking


@dataclass(frozen=True)
class Ranked:
    """The ranked methods, and the others with how many problems they were given, in words that end a note."""

    labels: tuple[str, ...]
    left_out: str


def ranked(given: Mapping[str, int]) -> Ranked:
    """Rank methods that were given `RANKED_PROBLEMS`, or half the largest number: all are compared on the fewest of the ranked.

    Where that leaves fewer than two, all are ranked.
    """
    most = max(given.values(), default=0)
    asked = tuple(label for label, count in given.items() if count)
    many = tuple(label for label in asked if given[label] >= min(RANKED_PROBLEMS, most / 2))
    labels = many if len(many) > 1 else asked
    out = [f"{quoted(label)} ({count:,})" for label, count in given.items() if label not in labels]
    return Ranked(labels, f"; not ranked (fewer problems): {', '.join(out)}" if out else "")


def most_solved(question: str, anchor: str, solved: Mapping[str, Flags], note: str) -> Winner:
    """Return the method that solved the most of the same problems, and those not significantly different (McNemar's test)."""
    entries = sorted(((label, *percentage(int(x.sum()), len(x))) for label, x in solved.items()), key=lambda e: -e[1])
    best = entries[0][0]
    p_values = {label: mcnemar(solved[best], x).p for label, x in solved.items() if label != best}
    return Winner(
        question, "%", "more", tuple(entries), anchor, note, "Wilson 95 % intervals; differences by McNemar's test",
        not_told_apart(best, p_values), len(solved[best]),
    )  # fmt: skip


# ---------------------------------------------------------------- questions


@dataclass(frozen=True)
class Place:
    """One entry of a question, as the page shows it."""

    label: str
    value: str
    interval: str


@dataclass(frozen=True)
class Won:
    """One question with its winner, as the page shows it."""

    asked: Winner
    best: Place
    level: tuple[str, ...]
    """The best and those that stand beside it; of many only the first are named."""
    remark: str
    second: Place | None


def winners(run: Run) -> list[Winner]:
    """Return every question with its entries, in the order of the kinds."""
    return [winner for kind in run.suite.kinds for winner in load_report(kind).winners(run) if winner.entries]


def won(run: Run) -> list[Won]:
    """Return the winners as the first screen of the page shows them."""
    found = []
    for winner in winners(run):
        tied, second = _order(winner)
        other = None if second is None else _place(winner, second)
        level = (winner.entries[0][0], *(tied if len(tied) <= MOST_TIED else tied[: MOST_TIED - 1]))
        found.append(Won(winner, _place(winner, 0), level, _remark(winner, tied), other))
    return found


def _remark(winner: Winner, tied: tuple[str, ...]) -> str:
    """Say why entries stand beside the best, how many are not named, and if there are too few values for a test."""
    if not tied:
        return f"ranked by value{winner.sample}" if winner.is_too_few else ""
    words = "same value" if winner.is_too_few else "no significant difference"
    more = f"and {len(tied) - MOST_TIED + 1} more: " if len(tied) > MOST_TIED else ""
    return f"{more}{words}{winner.sample}"


def _order(winner: Winner) -> tuple[tuple[str, ...], int | None]:
    """Return the labels tied with the best, and the first entry that is not; None if all are tied."""
    level = winner.tied
    tied = tuple(label for label in level if label != winner.entries[0][0])
    rest = [k for k, entry in enumerate(winner.entries) if entry[0] not in level]
    return tied, rest[0] if rest else None


def _place(winner: Winner, rank: int) -> Place:
    label, middle, low, high = winner.entries[rank]
    share = winner.unit == "%"
    value, interval = written("share" if share else "precise" if low == high else "number", middle, low, high)
    return Place(label, f"{value} {winner.unit}".rstrip(), interval)


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


# ---------------------------------------------------------------- the head of the page


def overview(run: Run) -> dict[str, Any]:
    """Return subjects, scope and key findings of the comparison."""
    begun = [b.block for b in run.begun]
    # A kind that says who wins has its findings in that table.
    shown = [load_report(kind) for kind in run.suite.kinds]
    own = [words for kind in shown if not kind.winners(run) for words in kind.findings(run)]
    return {
        "title": run.suite.title,
        "suite": run.suite.name,
        "complete": bool(run.manifest.get("complete")),
        "failed": failure_words(run),
        "created": run.manifest["provenance"].get("created", ""),
        "robots": [(short_name(name), _axes(run, name)) for name in run.suite.robots],
        "subjects": _subjects(run),
        "missing": [block.title for _, block in run.suite.pairs() if block not in begun],
        "findings": [words for words in own if words],
        "paper": {"title": PAPER_TITLE, "method": PAPER_METHOD, "verdict": _verdicts(run)} if run.on_paper else None,
        "won": won(run),
    }


def _axes(run: Run, name: str) -> str:
    try:
        return f"{run.robot(name).n} joints"
    except UnknownName:  # a robot that this version has no longer
        return "not in this version"


def _subjects(run: Run) -> str:
    """Describe the compared subjects; one that is part of a more specific subject is left out."""
    found = dict.fromkeys(
        words for kind in run.suite.kinds for words in load_report(kind).subjects(run.suite.of(kind.name))
    )
    own = [words for words in found if not any(other != words and other.startswith(words) for other in found)]
    return ", and ".join(own) + ("," if len(own) > 1 else "")


def _verdicts(run: Run) -> str:
    """Describe how many claims hold."""
    verdicts = Counter(PARTLY if f.verdict.startswith(PARTLY) else f.verdict for f in run.findings)
    words = {
        "holds": ("holds", "hold"), PARTLY: ("holds under a condition", "hold under a condition"),
        "does not hold": ("does not hold", "do not hold"), "not tested": ("is not tested here", "are not tested here"),
    }  # fmt: skip
    parts = [f"{verdicts[v]} {one if verdicts[v] == 1 else many}" for v, (one, many) in words.items() if v in verdicts]
    return f"of its {sum(verdicts.values())} claims, " + ", ".join(parts) + "."
