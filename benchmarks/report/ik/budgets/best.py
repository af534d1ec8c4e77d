"""Who solves most at iteration budgets, and the tables that leave the report."""

from __future__ import annotations

import polars as pl

from benchmarks.blocks.ik.budgets.measures import SUCCESS_LEVELS, level_words, succeeded, success
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.base import Table, Winner
from benchmarks.report.ik.budgets.damping import damping_table
from benchmarks.report.ik.budgets.default import default_table
from benchmarks.report.ik.budgets.look import budget_blocks, comparisons
from benchmarks.report.ik.budgets.methods import method_table
from benchmarks.report.ik.budgets.pair import pairs
from benchmarks.report.ranked import ranked
from benchmarks.report.run import Run
from benchmarks.statistics import not_beaten


def winners(run: Run) -> list[Winner]:
    """Who solves most targets in one attempt, for each block that compares methods."""
    return [winner for b in comparisons(run) if (winner := _winner(b)) is not None]


def _winner(b: BudgetRows) -> Winner | None:
    """Methods with one attempt, on the problems with a known solution that all of them were given."""
    known = b.last.filter("known")
    who = ranked({label: known.filter(pl.col("method") == label).height for label in b.budgeted})
    labels = who.labels
    rows = b.given(labels)
    if rows.is_empty():
        return None
    entries = [(label, *success(rows.filter(pl.col("method") == label), SUCCESS_LEVELS[-1])) for label in labels]
    entries.sort(key=lambda entry: -entry[1])
    judged = rows.select("problem", "method", good=succeeded(SUCCESS_LEVELS[-1]))
    solved = {
        label: dict(judged.filter(pl.col("method") == label).select("problem", "good").iter_rows()) for label in labels
    }
    return Winner(
        f"Highest success rate in one attempt: {b.block.title}", "%", "more",
        tuple(entries), "methods",
        f"{rows['problem'].n_unique():,} targets with a known solution, the same for all, at most {b.budget} iterations, "
        f"within {level_words(SUCCESS_LEVELS[-1])} m and rad{who.left_out}",
        "Wilson 95 % intervals; differences by McNemar's test",
        not_beaten(entries[0][0], solved),
        rows["problem"].n_unique(),
    )  # fmt: skip


def tables(run: Run) -> list[Table]:
    """The default beside the paper's iteration, and all methods of every block."""
    found = [default_table(pair, run) for pair in pairs(run)] + [method_table(b) for b in budget_blocks(run)]
    damping = damping_table(run)
    return found if damping is None else [*found, damping]
