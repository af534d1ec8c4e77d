"""Results of an experiment: the finding on a claim, and the evidence for a misprint."""

from __future__ import annotations

from dataclasses import dataclass

HOLDS, FAILS, PARTLY, UNTESTED = "holds", "does not hold", "holds when", "not tested"
"""Verdicts on a claim; "holds when" is followed by the condition."""


@dataclass(frozen=True)
class Finding:
    """A claim of the paper and its verdict.

    Attributes
    ----------
    key : str
        Letter of the claim.
    claim : str
        The claim of the paper.
    verdict : str
        "holds", "does not hold", "holds when …" or "not tested".
    summary : str
        The result, with figures.
    rule : str
        The rule that decides the verdict.
    figures : tuple of (str, str)
        Names and values with units.
    """

    key: str
    claim: str
    verdict: str
    summary: str
    rule: str
    figures: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Misprint:
    """A misprint of the paper and the evidence for its correction.

    Attributes
    ----------
    place : str
        Equation or table.
    printed : str
        The printed text.
    corrected : str
        The corrected text.
    evidence : str
        The computed evidence, with figures.
    """

    place: str
    printed: str
    corrected: str
    evidence: str
