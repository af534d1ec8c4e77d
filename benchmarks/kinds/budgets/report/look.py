"""Blocks with iteration budgets as the report takes them: which compare methods, and the colour of each method."""

from __future__ import annotations

from benchmarks.kinds.budgets.rows import BudgetRows
from benchmarks.report.figures import colour
from benchmarks.report.run import Run


def budget_blocks(run: Run) -> list[BudgetRows]:
    """All blocks that have rows.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    list of BudgetRows
        In the order of the suite.
    """
    return run.of("budgets")


def comparisons(run: Run) -> list[BudgetRows]:
    """Blocks that compare methods; all blocks where each varies the options of one method.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    list of BudgetRows
        In the order of the suite.
    """
    return [b for b in budget_blocks(run) if not b.sweep] or budget_blocks(run)


def method_index(run: Run, label: str) -> int:
    """Number of a method's colour and symbol, the same wherever it is shown.

    Parameters
    ----------
    run : Run
        The run.
    label : str
        Of the method.

    Returns
    -------
    int
        From 0.
    """
    labels = dict.fromkeys(name for b in (*comparisons(run), *budget_blocks(run)) for name in b.block.labels)
    return list(labels).index(label)


def method_colour(run: Run, label: str) -> str:
    """Colour of a method.

    Parameters
    ----------
    run : Run
        The run.
    label : str
        Of the method.

    Returns
    -------
    str
        A variable of the page's style.
    """
    return colour(method_index(run, label))
