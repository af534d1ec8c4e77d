"""The line as the report takes it: its plans."""

from __future__ import annotations

from benchmarks.kinds.plans.rows import LinePlans
from benchmarks.report.run import Run


def line_plans(run: Run) -> LinePlans | None:
    """The plans of the line.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    LinePlans or None
        None where the run has no plans.
    """
    found: list[LinePlans] = run.of("plans")
    return found[0] if found else None
