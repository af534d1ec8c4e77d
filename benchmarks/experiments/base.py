"""What an experiment says: a finding on a claim, and the evidence for a misprint."""

from __future__ import annotations

from dataclasses import dataclass

HOLDS, FAILS, PARTLY, UNTESTED = "holds", "does not hold", "holds when", "not tested"


@dataclass(frozen=True)
class Finding:
    """A claim and what the run says of it.

    Attributes
    ----------
    key : str
        Letter of the claim.
    claim : str
        What the paper says.
    verdict : str
        "holds", "does not hold", "holds when …" or "not tested".
    summary : str
        What was found, with figures.
    rule : str
        How it was judged.
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
    """A misprint of the paper, and what computing it shows.

    Attributes
    ----------
    place : str
        Equation or table.
    printed : str
        What is printed.
    corrected : str
        What must be meant.
    evidence : str
        What was computed, with figures.
    """

    place: str
    printed: str
    corrected: str
    evidence: str
