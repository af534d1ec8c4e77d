"""Section: whether the default is better than the paper's iteration, on the same targets from the same start."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.budgets.measures import SUCCESS_LEVELS, level_words, success
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.base import Column, Table
from benchmarks.report.board import Board, Plot
from benchmarks.report.figures import HOVER, axis, lean, line
from benchmarks.report.ik.budgets.pair import Pair, pairs
from benchmarks.report.numbers import number, p_value, percent
from benchmarks.report.run import Run
from benchmarks.statistics import SIGNIFICANT

DEFAULT_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("success", "solved", "%", "more", "share"),
    Column("alone", "solved by this method only", show="count"),
    Column("lost", "solved by the paper's only", show="count"),
    Column("p", "McNemar's p", show="p"),
    Column("iterations", "median iterations, solved", show="count"),
    Column("solved_us", "median time, solved", "µs", "less"),
    Column("failed_us", "median time, not solved", "µs", "less"),
    Column("both", "solved by both", show="count", aside=True),
    Column("neither", "solved by neither", show="count", aside=True),
)
"""Columns of the comparison of the default with the paper's iteration."""


def default(run: Run) -> dict[str, Any] | None:
    """An answer, a plot and a table for the first block that has both methods."""
    found = pairs(run)
    if not found:
        return None
    first = found[0]
    return {
        "lead": answer(first, run),
        "boards": [_board(first, run)],
        "tables": [default_table(pair, run) for pair in found],
        "how": "",
        "prose": [
            "The paper's iteration is damped least squares (eq. 11 and 12, corrected) with constant λ and α, clamped to the "
            f"joint limits. {first.attempt} also makes one attempt. {first.whole or 'The default with default settings'} "
            "restarts from other initial guesses until it succeeds. All get the same targets and the same start.",
            f"Solved means both errors within {level_words(SUCCESS_LEVELS[-1])} m and rad inside the joint limits, by optik's "
            "forward kinematics. McNemar's exact test compares the two methods on the problems that only one of them solves; "
            f"below p = {SIGNIFICANT} the difference is significant. Times are those of whole calls from Python, alternating "
            "in one process, on the problems that all of these methods were given there.",
        ],
    }


def answer(pair: Pair, run: Run) -> str:
    """Whether one attempt of the default is better than the paper's iteration, and by how much, in a few sentences."""
    test = pair.against_paper(pair.attempt)
    count = test.both + test.first + test.second + test.neither
    word = "No significant difference"
    if test.p < SIGNIFICANT:
        word = "Yes" if test.first > test.second else "No"
    shares = {label: percent(100.0 * float(pair.solved(label).mean())) for label in pair.labels}
    shown = p_value(test.p)
    text = (
        f"{word}: of {count:,} targets with a known solution, one attempt of the default ({pair.attempt}) solves "
        f"{shares[pair.attempt]}, the paper's iteration ({pair.paper}) {shares[pair.paper]}. {test.first:,} are "
        f"solved by the default only, {test.second:,} by the paper's only "
        f"(McNemar's p {'' if shown.startswith('<') else '= '}{shown})."
    )
    if pair.whole:
        text += (
            f" With default settings, which include restarts, the default ({pair.whole}) solves {shares[pair.whole]}."
        )
    times = pair.times(run)
    if times:
        mine, other = times[pair.attempt][0], times[pair.paper][0]
        text += (
            f" The median solved call takes {number(mine)} µs against {number(other)} µs: "
            f"{number(max(mine, other) / min(mine, other), 2)} times {'less' if mine < other else 'more'}."
        )
    return text


def default_table(pair: Pair, run: Run) -> Table:
    """The comparison as a table."""
    times = pair.times(run)
    rows = []
    for label in pair.labels:
        part = pair.given.filter(pl.col("method") == label)
        took = part.filter(pl.col("status") == "solved")["iterations"].to_numpy()
        solved, failed = times.get(label, (None, None))
        row: dict[str, Any] = {
            "label": label, "success": success(part, SUCCESS_LEVELS[-1]), "solved_us": solved, "failed_us": failed,
            "iterations": float(np.median(took)) if len(took) else None,
        }  # fmt: skip
        if label != pair.paper:
            test = pair.against_paper(label)
            row |= {"both": test.both, "neither": test.neither, "alone": test.first, "lost": test.second, "p": test.p}
        rows.append(row)
    b = pair.rows
    return Table(
        f"default-{b.block.id}", f"The default and the paper's iteration: {b.block.title}", DEFAULT_COLUMNS, tuple(rows),
        f"{len(pair.given) // len(pair.labels):,} targets with a known solution that all of these methods were given; one "
        f"attempt has at most {b.budget} iterations. Wilson 95 % intervals.",
    )  # fmt: skip


def _board(pair: Pair, run: Run) -> Board:
    """Return success against the iteration budget, and a level line for the default with default settings."""
    b = pair.rows
    plot = Plot(
        "default-success", f"Targets solved within {level_words(SUCCESS_LEVELS[-1])} m and rad",
        {
            "xaxis": axis("iteration budget", type="log", tickvals=[1, 2, 5, 10, 20, 50, 100, 200, 500]),
            "yaxis": axis("targets solved [%]", range=[-2, 102]),
        },
    )  # fmt: skip
    problems = pair.given["problem"].unique()
    for label in pair.labels:
        part = b.rows.filter((pl.col("method") == label) & pl.col("problem").is_in(problems.implode()))
        plot.add(success_line(part, label, b, run))
    legend = tuple(run.key(label, marked=label not in b.whole) for label in pair.labels)
    return Board(
        "default-board", (plot,), (), legend,
        f"{b.block.title}: {len(problems):,} targets with a known solution, the same for all; bars are Wilson 95 % intervals."
        + (f" {pair.whole} has no budget: its level line is its success rate with default settings." if pair.whole else ""),
    )  # fmt: skip


def success_line(
    rows: pl.DataFrame, label: str, b: BudgetRows, run: Run, level: float = SUCCESS_LEVELS[-1]
) -> dict[str, Any]:
    """Success of one method against the iteration budget, with intervals; a level line where it has no budget."""
    budgets, whole = b.block.budgets, label in b.whole
    rates = [success(rows.filter(pl.col("budget") == n), level) for n in (budgets[-1:] if whole else budgets)]
    rates *= 2 if whole else 1
    words = "default settings" if whole else "budget %{x}"
    return line(
        x=[budgets[0], budgets[-1]] if whole else list(budgets), y=lean([r[0] for r in rates]), name=label,
        mode="lines" if whole else "lines+markers", marker={"symbol": run.symbol(label), "size": 7},
        line={"color": run.colour(label), "width": 2, "dash": run.dash(label)},
        error_y={
            "type": "data", "symmetric": False, "array": lean([r[2] - r[0] for r in rates]), "thickness": 1,
            "arrayminus": lean([max(r[0] - r[1], 0.0) for r in rates]), "width": 3,
        },
        hovertemplate=f"{label}<br>{words}: %{{y:.1f}} %{HOVER}",
    )  # fmt: skip
