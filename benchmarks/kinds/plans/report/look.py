"""The line as the report takes it: its plans, and the colour of each time law."""

from __future__ import annotations

from benchmarks.kinds.plans.rows import LinePlans
from benchmarks.report.figures import colour
from benchmarks.report.run import Run

FIRST_COLOUR = 4
"""Number of the first law's colour: laws are told apart from the first IK methods."""


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


def law_colour(line: LinePlans, law: str) -> str:
    """Colour of a time law.

    Parameters
    ----------
    line : LinePlans
        The plans of the line.
    law : str
        Name of the law.

    Returns
    -------
    str
        A variable of the page's style.
    """
    return colour(FIRST_COLOUR + line.laws.index(law))
