"""Section: the methods side by side, on the problems that all of them were run on."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.kinds.budgets.measures import MEASURES, SUCCESS_LEVELS, level_words, success, success_at
from benchmarks.kinds.budgets.report.look import budget_blocks, comparisons
from benchmarks.kinds.budgets.rows import BudgetRows
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import HOVER, SYMBOLS, axis, bars, lean, line
from benchmarks.report.run import Run
from benchmarks.report.tables import cells

ENDINGS = {
    "solved": ("solved", "var(--c2)"),
    "max_iterations": ("iterations used up", "var(--c4)"),
    "stalled": ("stalled", "var(--c1)"),
    "time_limit": ("time used up", "var(--c5)"),
    "outside_limits": ("outside joint limits", "var(--c3)"),
    "unreachable": ("proved unreachable", "var(--c6)"),
    "rejected": ("claim rejected", "var(--c7)"),
}
"""Ways in which a solve ends: in words, and the colour of each."""


def methods(run: Run) -> dict[str, Any] | None:
    """Tables of all blocks, success against budget, and how the solves ended.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where the run has no data for it.
    """
    if not budget_blocks(run):
        return None
    open_ones = {b.block.id for b in comparisons(run)}
    return {
        "metrics": MEASURES,
        "tables": [_table(b, run) | {"open": b.block.id in open_ones} for b in budget_blocks(run)],
        "boards": [_success_board(run), _status_board(run)],
    }


def _table(b: BudgetRows, run: Run) -> dict[str, Any]:
    last = b.paired.filter(pl.col("budget") == b.budget)
    known = last.filter("known")
    count = last["problem"].n_unique()
    pairs = known["problem"].n_unique()
    total, total_known = b.problems()
    rows = []
    for label in b.methods:
        own = b.last.filter(pl.col("method") == label)
        part = known.filter(pl.col("method") == label)
        unknown = own.filter(~pl.col("known"))
        values = [metric.compute(part) for metric in MEASURES]
        rows.append(
            {
                "label": label,
                "colour": run.colour(label),
                "cells": [cells(metric, v) for metric, v in zip(MEASURES, values, strict=True)],
                "values": values,
                "known": len(own) - len(unknown),
                "own": cells(success_at(SUCCESS_LEVELS[-1]), success(own.filter("known"), SUCCESS_LEVELS[-1])),
                "unknown": len(unknown),
            }
        )
    return {
        "id": b.block.id, "title": b.block.title, "budget": b.budget, "rows": rows, "pairs": pairs,
        "pairs_unknown": count - pairs, "total": total, "total_known": total_known,
        "groups": b.rows["group"].n_unique(), "budgets": b.block.budgets,
    }  # fmt: skip


def _success_board(run: Run) -> Board:
    plots = []
    for level in SUCCESS_LEVELS:
        plot = Plot(
            f"success-{level:.0e}", f"Success at {level_words(level)} m and rad",
            {
                "xaxis": axis("iteration budget", type="log", tickvals=[1, 2, 5, 10, 20, 50, 100, 200, 500]),
                "yaxis": axis("problems solved [%]", range=[-2, 102]),
            },
        )  # fmt: skip
        for b in budget_blocks(run):
            _success_lines(plot, b, run, level)
        plots.append(plot)
    blocks = Control("block", "Problems", tuple((b.block.id, b.block.title) for b in budget_blocks(run)))
    legend = tuple(
        Key(label, run.colour(label), "dot", {"block": [b.block.id]}) for b in budget_blocks(run) for label in b.methods
    )
    return Board(
        "success", tuple(plots), (blocks,), legend,
        "Paired problems with a known solution; bars are Wilson 95 % intervals. A run stopped at a budget is judged at the "
        "iterate it has reached.",
    )  # fmt: skip


def _success_lines(plot: Plot, b: BudgetRows, run: Run, level: float) -> None:
    known = b.paired.filter("known")
    for label in b.methods:
        part = known.filter(pl.col("method") == label)
        if part.is_empty():
            continue
        rates = [success(part.filter(pl.col("budget") == budget), level) for budget in b.block.budgets]
        share = [r[0] for r in rates]
        i = run.labels.index(label)
        plot.add(
            line(
                x=list(b.block.budgets), y=lean(share), mode="lines+markers", name=label,
                line={"color": run.colour(label), "width": 2},
                marker={"symbol": SYMBOLS[i % len(SYMBOLS)], "size": 7},
                error_y={
                    "type": "data", "symmetric": False, "array": lean([r[2] - r[0] for r in rates]), "thickness": 1,
                    "arrayminus": lean([max(r[0] - r[1], 0.0) for r in rates]), "width": 3,
                },
                hovertemplate=f"{label}<br>%{{x}} iterations: %{{y:.1f}} %{HOVER}",
            ),
            {"block": [b.block.id]},
        )  # fmt: skip


def _status_board(run: Run) -> Board:
    plot = Plot(
        "status", "How the solves ended at the largest budget, all problems that the method was run on",
        {
            "barmode": "stack", "bargap": 0.35,
            "xaxis": axis("share of problems [%]", range=[0, 100]),
            "yaxis": axis("", autorange="reversed", ticks="", type="category"),
        },
    )  # fmt: skip
    seen: dict[str, list[str]] = {}
    for b in budget_blocks(run):
        plot.vary({"block": [b.block.id]}, {"height": 64 + 36 * len(b.methods)})
        for status, known, values, counts in _endings(b):
            words, colour = (
                ENDINGS.get(status, (status, "var(--c7)")) if known else ("no known solution", "var(--unknown)")
            )
            seen.setdefault(words, []).append(b.block.id)
            plot.add(
                bars(
                    y=b.methods, x=lean(values), customdata=counts, name=words, marker={"color": colour},
                    hovertemplate=f"%{{y}}<br>{words}: %{{customdata}} problems, %{{x:.1f}} %{HOVER}",
                ),
                {"block": [b.block.id]},
            )  # fmt: skip
    blocks = Control("block", "Problems", tuple((b.block.id, b.block.title) for b in budget_blocks(run)))
    colours = dict(ENDINGS.values()) | {"no known solution": "var(--unknown)"}
    legend = tuple(Key(w, colours.get(w, "var(--c7)"), "fill", {"block": seen[w]}) for w in colours if w in seen)
    return Board("statuses", (plot,), (blocks,), legend)


def _endings(b: BudgetRows) -> list[tuple[str, bool, list[float], list[int]]]:
    """Share and count of every ending for each method: by status where a solution is known, together where not."""
    totals = {m: b.last.filter(pl.col("method") == m).height for m in b.methods}
    out = []
    kinds = [(s, True) for s in (*ENDINGS, *sorted(set(b.last["status"]) - set(ENDINGS)))] + [("", False)]
    for status, known in kinds:
        part = b.last.filter((pl.col("known") & (pl.col("status") == status)) if known else ~pl.col("known"))
        counts = [part.filter(pl.col("method") == m).height for m in b.methods]
        if any(counts):
            out.append((status, known, [100.0 * c / totals[m] for c, m in zip(counts, b.methods, strict=True)], counts))
    return out
