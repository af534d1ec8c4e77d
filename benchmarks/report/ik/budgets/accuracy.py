"""Section: the error of each axis against the distance of the target and against the iteration budget."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import HOVER, axis, iterations, lean, line, log_axis, shades
from benchmarks.report.ik.budgets.look import comparisons
from benchmarks.report.run import Run
from benchmarks.statistics import binned, quantiles

ERROR_AXES = {"error_x": "X", "error_y": "Y", "error_z": "Z"}
"""Columns of the errors, and the axes of the base frame that they belong to."""

FLOOR_MM = 1e-9
"""Errors up to this, 10⁻¹² m, are rounding: they are drawn here, as no smaller ones are results."""

MOST_LINES = 5
"""Budgets that one plot shows: more lines cannot be told apart."""

DECADES = (-9.4, 3.4)
"""Range of all error axes, as powers of ten: the same for every axis, method and set of problems."""


def accuracy(run: Run) -> dict[str, Any] | None:
    """Error against distance by budget, and against budget by method."""
    blocks = [b for b in comparisons(run) if not b.known.is_empty()]
    if not blocks:
        return None
    counts = []
    for b in blocks:
        total, known = b.problems()
        counts.append({"title": b.block.title, "known": known, "unknown": total - known})
    return {"counts": counts, "boards": [_distance_board(blocks), _budget_board(blocks, run)]}


def chosen(budgets: tuple[int, ...], count: int = MOST_LINES) -> list[int]:
    """A limited number of budgets, spread evenly through the list, with the first and the last."""
    if len(budgets) <= count:
        return list(budgets)
    return [budgets[round(i * (len(budgets) - 1) / (count - 1))] for i in range(count)]


def _controls(blocks: list[BudgetRows]) -> Control:
    return Control("block", "Problems", tuple((b.block.id, b.block.title) for b in blocks))


def _millimetres(column: str) -> pl.Expr:
    return (pl.col(column).abs() * 1e3).clip(FLOOR_MM).alias("mm")


def _distance_board(blocks: list[BudgetRows]) -> Board:
    plots = []
    for column, name in ERROR_AXES.items():
        plot = Plot(
            f"distance-{column}", f"{name} axis",
            {"xaxis": axis("distance from the start [mm]"), "yaxis": log_axis(f"|error in {name}| [mm]", range=DECADES)},
        )  # fmt: skip
        for b in blocks:
            _distance_lines(plot, b, column)
        plots.append(plot)
    methods = dict.fromkeys(m for b in blocks for m in b.budgeted)
    legend = [
        Key(iterations(budget), shade, "solid", {"block": [b.block.id]})
        for b in blocks
        for budget, shade in zip(chosen(b.block.budgets), shades(len(chosen(b.block.budgets))), strict=True)
    ]
    legend += [Key("median", "var(--ink)"), Key("95th percentile", "var(--ink)", "dashed")]
    return Board(
        "by-distance", tuple(plots), (_controls(blocks), Control.of("method", "Method", list(methods))), tuple(legend),
        "Bins of 50 mm with at least 10 targets. All targets with a known solution are counted, also those where the method "
        "fails: they make the 95th percentile. Errors up to 10⁻⁹ mm (10⁻¹² m) are rounding: all are drawn there, as ≤ 10⁻⁹.",
    )  # fmt: skip


def _distance_lines(plot: Plot, b: BudgetRows, column: str) -> None:
    budgets = chosen(b.block.budgets)
    for label in b.budgeted:
        part = b.known.filter(pl.col("method") == label).with_columns(
            _millimetres(column), far=pl.col("distance") * 1e3
        )
        by_budget = part.partition_by("budget", as_dict=True)
        for budget, shade in zip(budgets, shades(len(budgets)), strict=True):
            table = binned(by_budget[budget,] if (budget,) in by_budget else part.clear(), "far", "mm", width=50.0)
            for quantile, words, dash in (("q0.5", "median", "solid"), ("q0.95", "95th percentile", "dot")):
                plot.add(
                    line(
                        x=lean(table["middle"]), y=lean(table[quantile]), customdata=table["count"].to_list(),
                        mode="lines+markers" if dash == "solid" else "lines", marker={"size": 4},
                        line={"color": shade, "dash": dash, "width": 2 if dash == "solid" else 1.3},
                        hovertemplate=f"{iterations(budget)}, {words}<br>%{{x:.0f}} mm away: %{{y:.3g}} mm "
                        f"(%{{customdata}} targets){HOVER}",
                    ),
                    {"block": [b.block.id], "method": [label]},
                )  # fmt: skip


def _budget_board(blocks: list[BudgetRows], run: Run) -> Board:
    plots = []
    for column, name in ERROR_AXES.items():
        plot = Plot(
            f"budget-{column}", f"{name} axis",
            {
                "xaxis": axis("iteration budget", type="log", tickvals=[1, 2, 5, 10, 20, 50, 100, 200, 500]),
                "yaxis": log_axis(f"|error in {name}| [mm]", range=DECADES),
            },
        )  # fmt: skip
        for b in blocks:
            for label in b.budgeted:
                _budget_lines(plot, b, label, run.colour(label), column)
        plots.append(plot)
    legend = [Key(m, run.colour(m), "solid", {"block": [b.block.id]}) for b in blocks for m in b.budgeted]
    legend += [Key("median", "var(--ink)"), Key("95th percentile", "var(--ink)", "dashed"), Key("2 mm", "var(--alarm)")]
    for plot in plots:
        plot.layout["shapes"] = [
            {
                "type": "line",
                "xref": "paper",
                "x0": 0,
                "x1": 1,
                "y0": 2,
                "y1": 2,
                "line": {"color": "var(--alarm)", "width": 1},
            }
        ]
    differ = ""
    if any(b.known.group_by("method").agg(pl.col("problem").n_unique())["problem"].n_unique() > 1 for b in blocks):
        differ = (
            " (each method's own: not all methods were run on the same targets; for paired figures see the table above)"
        )
    return Board(
        "by-budget", tuple(plots), (_controls(blocks),), tuple(legend),
        f"Targets with a known solution{differ}. Thin line: the paper's 2 mm.",
    )  # fmt: skip


def _budget_lines(plot: Plot, b: BudgetRows, label: str, colour: str, column: str) -> None:
    part = b.known.filter(pl.col("method") == label).with_columns(_millimetres(column))
    if part.is_empty():
        return
    found = {n: rows["mm"].to_numpy() for (n,), rows in part.partition_by("budget", as_dict=True).items()}
    values = [quantiles(found.get(n, []), (0.5, 0.95)) for n in b.block.budgets]
    for k, (words, dash) in enumerate((("median", "solid"), ("95th percentile", "dot"))):
        plot.add(
            line(
                x=list(b.block.budgets), y=lean([v[k] for v in values]), marker={"size": 5},
                mode="lines+markers" if dash == "solid" else "lines",
                line={"color": colour, "dash": dash, "width": 2 if dash == "solid" else 1.3},
                hovertemplate=f"{label}, {words}<br>budget %{{x}}: %{{y:.3g}} mm{HOVER}",
            ),
            {"block": [b.block.id]},
        )  # fmt: skip
