"""Section: the methods side by side, on the problems that all of them were run on."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.blocks.ik.budgets.measures import MEASURES, SUCCESS_LEVELS, level_words, success
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.base import Column, Table
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import HOVER, axis, bars, lean
from benchmarks.report.ik.budgets.default import success_line
from benchmarks.report.ik.budgets.look import budget_blocks, comparisons
from benchmarks.report.run import Run
from benchmarks.report.words import listed

ENDINGS = {
    "solved": ("solved", "var(--c2)"),
    "max_iterations": ("iteration limit", "var(--c4)"),
    "stalled": ("stalled", "var(--c1)"),
    "time_limit": ("time limit", "var(--c5)"),
    "outside_limits": ("outside joint limits", "var(--c3)"),
    "unreachable": ("proved unreachable", "var(--c6)"),
    "rejected": ("wrong claim of success", "var(--c7)"),
}
"""Ways in which a solve ends: in words, and the colour of each."""


METHOD_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("fine", f"solved at {level_words(SUCCESS_LEVELS[-1])}", "%", "more", "share"),
    Column("coarse", f"within {level_words(SUCCESS_LEVELS[0])}", "%", "more", "share"),
    Column("position", "median position error", "mm", "less"),
    Column("position_95", "p95 position error", "mm", "less"),
    Column("iterations", "median iterations, solved", show="count"),
    Column("rotation", "median rotation error", "°", "less", aside=True),
    Column("rotation_95", "p95 rotation error", "°", "less", aside=True),
    Column("iterations_95", "p95 iterations, solved", show="count", aside=True),
    Column("own", f"solved at {level_words(SUCCESS_LEVELS[-1])}, all problems given", "%", show="share", aside=True),
    Column("known", "problems with a known solution", show="count", aside=True),
    Column("unknown", "problems without one", show="count", aside=True),
)
"""Columns of a table of methods."""


def methods(run: Run) -> dict[str, Any] | None:
    """Tables of all blocks, success against budget, and how the solves ended."""
    if not budget_blocks(run):
        return None
    open_ones = {b.block.id for b in comparisons(run)}
    return {
        "tables": [{"table": method_table(b), "open": b.block.id in open_ones} for b in budget_blocks(run)],
        "boards": [_success_board(run), _status_board(run)],
    }


def method_table(b: BudgetRows) -> Table:
    """All methods of a block on the same problems, at the largest budget."""
    known = b.given(b.methods)
    rows = []
    for label in b.methods:
        own = b.last.filter(pl.col("method") == label)
        part = known.filter(pl.col("method") == label)
        coarse, fine, position, rotation, took = (metric.compute(part) for metric in MEASURES)
        rows.append(
            {
                "label": label, "coarse": coarse, "fine": fine, "position": position[0], "position_95": position[1],
                "rotation": rotation[0], "rotation_95": rotation[1], "iterations": took[0], "iterations_95": took[1],
                "own": success(own.filter("known"), SUCCESS_LEVELS[-1]),
                "known": int(own["known"].sum()), "unknown": int((~own["known"]).sum()),
            }
        )  # fmt: skip
    total, total_known = b.problems()
    whole = f" {listed(b.whole)}: default settings, with restarts." if b.whole else ""
    return Table(
        f"methods-{b.block.id}", b.block.title, METHOD_COLUMNS, tuple(rows),
        f"{known['problem'].n_unique():,} problems with a known solution that all methods were given, of {total_known:,} with "
        f"one and {total:,} in all; at most {b.budget} iterations from the given start.{whole} Errors include failures. "
        "Intervals are Wilson's, 95 %.",
    )  # fmt: skip


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
        run.key(label, {"block": [b.block.id]}, marked=label not in b.whole)
        for b in budget_blocks(run)
        for label in b.methods
    )
    return Board(
        "success", tuple(plots), (blocks,), legend,
        "Problems with a known solution that all methods were given; bars are Wilson 95 % intervals. A run that its budget "
        "stops is judged at its last iterate. Level line: a method with default settings, which has no budget.",
    )  # fmt: skip


def _success_lines(plot: Plot, b: BudgetRows, run: Run, level: float) -> None:
    known = b.paired.filter("known")
    for label in b.methods:
        part = known.filter(pl.col("method") == label)
        if part.is_empty():
            continue
        trace = success_line(part, label, b, run, level)
        plot.add(trace, {"block": [b.block.id]})


def _status_board(run: Run) -> Board:
    plot = Plot(
        "status", "Final status at the largest budget, on the problems that all methods were given",
        {
            "barmode": "stack", "bargap": 0.35,
            "xaxis": axis("problems [%]", range=[0, 100]),
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
    """Share and count of every ending for each method, on the same problems: by status, or no known solution."""
    last = b.paired.filter(pl.col("budget") == b.budget)
    total = max(last["problem"].n_unique(), 1)
    out = []
    kinds = [(s, True) for s in (*ENDINGS, *sorted(set(last["status"]) - set(ENDINGS)))] + [("", False)]
    for status, known in kinds:
        part = last.filter((pl.col("known") & (pl.col("status") == status)) if known else ~pl.col("known"))
        counts = [part.filter(pl.col("method") == m).height for m in b.methods]
        if any(counts):
            out.append((status, known, [100.0 * c / total for c in counts], counts))
    return out
