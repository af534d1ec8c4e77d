"""Blocks with iteration budgets as the report takes them: which of them compare methods."""

from __future__ import annotations

from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.run import Run


def budget_blocks(run: Run) -> list[BudgetRows]:
    """All blocks that have rows."""
    return run.of("budgets")


def comparisons(run: Run) -> list[BudgetRows]:
    """Blocks that compare methods; all blocks where each varies the options of one method."""
    return [b for b in budget_blocks(run) if not b.sweep] or budget_blocks(run)
