"""Results of an experiment: the finding on a claim, and the evidence for a misprint."""

from __future__ import annotations

from dataclasses import dataclass

HOLDS, FAILS, PARTLY, UNTESTED = "holds", "does not hold", "holds when", "not tested"
"""Verdicts on a claim; "holds when" is followed by the condition."""


@dataclass(frozen=True)
class Finding:
    """A claim of the paper and its verdict."""

    key: str  # letter of the claim
    claim: str
    verdict: str  # "holds", "does not hold", "holds when …" or "not tested"
    summary: str  # the result, with figures
    rule: str  # by which the verdict is decided
    figures: tuple[tuple[str, str], ...] = ()  # names and values with units


@dataclass(frozen=True)
class Misprint:
    """A misprint of the paper and the evidence for its correction."""

    place: str  # equation or table
    printed: str
    corrected: str
    evidence: str  # computed, with figures
