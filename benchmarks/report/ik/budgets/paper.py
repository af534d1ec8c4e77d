"""Section: the paper's figures, equations and claims beside the sections that answer them."""

from __future__ import annotations

from typing import Any

from benchmarks.experiments.base import UNTESTED
from benchmarks.experiments.counterparts import COUNTERPARTS, PAPER_TITLE
from benchmarks.report.ik.budgets.damping import DAMPING_BLOCK
from benchmarks.report.ik.budgets.look import budget_blocks, comparisons
from benchmarks.report.ik.budgets.sheets import sheets_of
from benchmarks.report.run import Run


def paper(run: Run) -> dict[str, Any] | None:
    """The table of counterparts; the page links what it has."""
    verdicts = {f.key: f.verdict for f in run.findings}
    if all(verdict == UNTESTED for verdict in verdicts.values()):
        return None
    there = _there(run)
    rows = [
        (c._replace(anchor=c.anchor if c.anchor in there else ""), verdicts.get(_claim(c.what), ""))
        for c in COUNTERPARTS
    ]
    return {"title": PAPER_TITLE, "rows": rows}


def _claim(what: str) -> str:
    """Letter of the claim that a counterpart is about; empty where it is about none."""
    return what.removeprefix("claim (").removesuffix(")") if what.startswith("claim (") else ""


def _there(run: Run) -> set[str]:
    """Sections that this page has, of those that the counterparts name."""
    found = {"misprints", "claims"}
    blocks = budget_blocks(run)
    if blocks:
        found |= {"methods", "error"}
    if any(b.block.id == DAMPING_BLOCK for b in blocks):
        found.add("damping")
    if any(sheets_of(b) for b in comparisons(run)):
        found.add("maps")
    if any(plans.solved for plans in run.of("plans")):
        found |= {"line", "motion", "laws"}
    return found
