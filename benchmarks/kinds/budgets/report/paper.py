"""Section: the paper's figures, equations and claims beside the sections that answer them."""

from __future__ import annotations

from typing import Any

from benchmarks.experiments.base import UNTESTED
from benchmarks.experiments.counterparts import COUNTERPARTS, PAPER_TITLE
from benchmarks.report.run import Run


def paper(run: Run) -> dict[str, Any] | None:
    """The table of counterparts; the page links what it has.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where the run does not bear on the paper.
    """
    verdicts = {f.key: f.verdict for f in run.findings}
    if all(verdict == UNTESTED for verdict in verdicts.values()):
        return None
    rows = [(c, verdicts.get(c.what[-2:-1], "") if c.what.startswith("claim") else "") for c in COUNTERPARTS]
    return {"title": PAPER_TITLE, "rows": rows}
