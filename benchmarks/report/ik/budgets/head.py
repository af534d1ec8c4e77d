"""Iteration budgets at the head of the report: what solved means, what was run, key findings, limitations."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.blocks.ik.budgets.measures import SUCCESS_LEVELS, level_words, success
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.ik.budgets.default import answer
from benchmarks.report.ik.budgets.look import budget_blocks, comparisons
from benchmarks.report.ik.budgets.pair import pairs
from benchmarks.report.numbers import percent
from benchmarks.report.run import Run
from optik.registry import short_name


def terms(run: Run) -> dict[str, Any] | None:
    """Tolerances of a solved problem; None where no block has rows."""
    return {"levels": [level_words(level) for level in SUCCESS_LEVELS]} if budget_blocks(run) else None


def summary(run: Run) -> dict[str, Any] | None:
    """Problems, robot and methods of every block; None where no block has rows."""
    return {"blocks": [_block(b, run) for b in budget_blocks(run)]} if budget_blocks(run) else None


def _block(b: BudgetRows, run: Run) -> dict[str, Any]:
    total, known = b.problems()
    ran = {m: b.last.filter(pl.col("method") == m).height for m in b.methods}
    methods = []
    for m in b.block.methods:
        part = "" if ran.get(m.label, 0) == total else f"; {ran.get(m.label, 0):,} of the problems"
        part += "; default settings" if m.whole else ""
        what = f"{short_name(m.name)}, {m.words or 'no options'}{part}"
        methods.append({"label": m.label, "colour": run.colour(m.label), "what": what})
    return {
        "id": b.block.id, "title": b.block.title, "set": short_name(b.block.set).replace("_", " "),
        "robot": short_name(b.block.robot),
        "total": total, "known": known, "methods": methods, "budgets": b.block.budgets,
    }  # fmt: skip


def findings(run: Run) -> list[str]:
    """Whether the default is better than the paper's iteration; elsewhere, the share that every method solves."""
    answered = pairs(run)
    rest = [b for b in comparisons(run) if b.block.id not in {pair.rows.block.id for pair in answered}]
    found = [f"Is the default better than the paper's iteration? {answer(pair, run)}" for pair in answered[:1]]
    return found + [words for b in rest if (words := _rates(b))]


def _rates(b: BudgetRows) -> str:
    known = b.given(b.methods)
    if known.is_empty():
        return ""
    words = []
    for label in b.methods:
        share, low, high = success(known.filter(pl.col("method") == label), SUCCESS_LEVELS[-1])
        words.append(f"{label} {percent(share)} ({low:.1f} to {high:.1f} %)")
    count = known["problem"].n_unique()
    return f"{b.block.title}, {count:,} targets, at most {b.budget} iterations; solved: {'; '.join(words)}."


def limitations(run: Run) -> list[str]:
    """What a reader should know before quoting rates and iterations."""
    items = [
        "In blocks with iteration budgets every method gets one attempt from the given start, without restarts: the paper's "
        "iteration has none. A method that runs with default settings is marked. These blocks are not timed: times come "
        "from single calls.",
    ]
    if any(b.block.set == "graph_paper" for b in budget_blocks(run)):
        items.append(
            "Known solutions of graph-paper targets were searched before the comparison, by lm with 100 restarts and by all "
            "branches of closed_form. It is therefore expected that these two, with default settings, solve all of them. "
            "Random targets are reachable by construction. “No known solution” means that neither the search nor any method "
            "found one; it does not prove that the target is out of reach. All graph-paper targets have the start's "
            "orientation."
        )
    if any(b.paired["problem"].n_unique() < b.problems()[0] for b in budget_blocks(run)):
        items.append(
            "Some methods were run on a subset of the problems. The tables compare on the problems common to all methods; "
            "plots with other problems say so."
        )
    return items
