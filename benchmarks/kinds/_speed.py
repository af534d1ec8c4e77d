"""What the kinds that measure speed have in common in the report: the rules of timing, and one table of targets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.kinds.base import Section
from benchmarks.report.run import Run
from benchmarks.report.tables import target_row


def _speed(run: Run) -> dict[str, Any]:
    """Targets of all kinds that stand in this section."""
    outcomes = [
        outcome
        for kind, block in run.suite.pairs()
        if SPEED in kind.sections()
        for outcome in kind.outcomes(block, run.folder)
    ]
    return {"targets": [target_row(outcome) for outcome in outcomes]}


SPEED = Section("Speed of one call", "speed", _speed, Path(__file__).with_name("_speed.html.j2"), 10)
"""The head of the section on speed; every kind that stands in it names it among its sections."""
