"""The line as the report takes it: its plans."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.blocks.timing.plans import LinePlans
from benchmarks.report.board import Control
from benchmarks.report.run import Run

DEFAULT_LAW = "optimal"
"""The law that a control selects first: the default of `planners.plan`."""


def law_control(laws: Sequence[str], *more: str) -> Control:
    """Return the control of laws; it selects the default law first, if the run has it."""
    return Control.of("law", "Time law", (*laws, *more), DEFAULT_LAW if DEFAULT_LAW in laws else "")


def line_plans(run: Run) -> LinePlans | None:
    """The plans of the line."""
    found: list[LinePlans] = run.of("plans")
    return found[0] if found else None
