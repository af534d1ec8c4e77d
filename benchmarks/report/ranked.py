"""Ranking of methods: winners are decided on problems that all ranked methods were given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from benchmarks.report.base import Winner
from benchmarks.report.words import quoted
from benchmarks.statistics import mcnemar, not_told_apart, percentage
from optik.types import Flags

RANKED_PROBLEMS = 1000
"""Number of problems that suffices for a ranking: Wilson's interval of a rate is then 6 points wide, 0.4 near 100 %."""


@dataclass(frozen=True)
class Ranked:
    """The ranked methods and the problems of their comparison.

    Attributes
    ----------
    labels : tuple of str
        Those that are ranked, on the problems that all of them were given.
    left_out : str
        Names of the others with how many they were given, in words that end a note; empty where there are none.
    """

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
