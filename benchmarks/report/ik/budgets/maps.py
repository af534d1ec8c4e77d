"""Section: maps over the sheets of graph paper: error of each axis (the paper's Fig. 11 to 13), and iterations."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.board import Board, Control, Json, Key, Plot
from benchmarks.report.figures import HOVER, heatmap, iterations, lean, line
from benchmarks.report.ik.budgets.accuracy import chosen
from benchmarks.report.ik.budgets.look import comparisons
from benchmarks.report.ik.budgets.positions import positions
from benchmarks.report.ik.budgets.sheets import GREY, Sheet, Squares, laid_out, sheet_plot, sheets_of
from benchmarks.report.run import Run
from optik.arm.robot import Robot

MAP_ITERATIONS = "iterations to 1e−6 m and rad"
"""What a map can show beside the errors."""

MAP_ERRORS = {"error_x": "error in X (Fig. 11)", "error_y": "error in Y (Fig. 12)", "error_z": "error in Z (Fig. 13)"}
"""Columns of the errors that a map can show, and what the control calls them."""

MAP_BUDGETS = 4
"""Budgets after which errors are shown: the first, the last and two between, as neighbours look alike."""

ERROR_DECADES = (-9, 3)
"""Range of the errors' colours, as powers of ten of 1 mm: from 10⁻¹² m, below which all is rounding, to 1 m."""

ITERATION_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers on the scale of iterations."""


def maps(run: Run) -> dict[str, Any] | None:
    """One board for every block of graph paper."""
    found = [b for b in comparisons(run) if b.block.set == "graph_paper" and b.budgeted]
    boards = [board for b in found for board in _both(b, run.robot(b.block.robot))]
    return {"boards": boards} if boards else None


def _both(b: BudgetRows, robot: Robot) -> tuple[Board, Board]:
    return positions(b, sheets_of(b), robot), _board(b, robot)


def _board(b: BudgetRows, robot: Robot) -> Board:
    sheets = sheets_of(b)
    planes = list(dict.fromkeys(s.plane for s in sheets))
    offsets = sorted({s.offset for s in sheets})
    plots = []
    for plane in planes:
        plot = sheet_plot("map", b, next(s for s in sheets if s.plane == plane), robot)
        for sheet in (s for s in sheets if s.plane == plane):
            _sheet(plot, b, sheet)
        plots.append(plot)
    where = tuple((str(o), f"{o:+d} mm from the tool" if o else "through the tool") for o in offsets)
    shown = chosen(b.block.budgets, MAP_BUDGETS)
    budgets = tuple((str(n), iterations(n)) for n in shown)
    errors = list(MAP_ERRORS.values())
    controls = (
        Control.of("quantity", "Show", (*errors, MAP_ITERATIONS)),
        Control.of("method", "Method", b.budgeted),
        Control("budget", "After", budgets, str(shown[len(shown) // 3]), {"quantity": errors}),
        Control("offset", "Sheet", where, str(min(offsets, key=abs))),
    )
    legend = (
        Key("no known solution", "var(--unknown)", "fill"),
        Key("not solved within the largest budget", "var(--alarm)", "cross", {"quantity": [MAP_ITERATIONS]}),
        Key("tool at the start", "#fff", "ring"),
    )
    return Board(
        f"maps-{b.block.id}", tuple(plots), controls, legend,
        "Base frame, equal scales; |target − tool| on each axis at the last iterate within the budget. Errors up to "
        "10⁻⁹ mm (10⁻¹² m) are rounding and have one colour. Blank: the method was not given this target. The iteration "
        f"limit of the map of iterations is {b.budget}.",
    )  # fmt: skip


def _sheet(plot: Plot, b: BudgetRows, sheet: Sheet) -> None:
    """Draw a sheet: what has no known solution, and every method's iterations and errors."""
    rows, squares = laid_out(b.rows, sheet)
    here = {"offset": [str(sheet.offset)]}
    where = f"{sheet.u} %{{x:.0f}} mm, {sheet.v} %{{y:.0f}} mm<br>"
    unknown = rows.unique("problem").filter(~pl.col("known")).with_columns(one=pl.lit(1.0))
    plot.add(
        heatmap(
            z=squares.matrix(unknown, "one"), **squares.options, colorscale=GREY, showscale=False,
            hovertemplate=f"{where}no known solution{HOVER}",
        ),
        here,
    )  # fmt: skip
    shown = {str(n) for n in chosen(b.block.budgets, MAP_BUDGETS)}
    for (label, budget), part in rows.filter("known").partition_by("method", "budget", as_dict=True).items():
        when = here | {"method": [str(label)]}
        if budget == b.budget and label in b.budgeted:
            _iterations(plot, part, squares, where, when | {"quantity": [MAP_ITERATIONS]}, b.budget)
        if str(budget) in shown and label in b.budgeted:
            _errors(plot, part, squares, where, when | {"budget": [str(budget)]})


def _errors(plot: Plot, rows: pl.DataFrame, squares: Squares, where: str, when: Json) -> None:
    """Draw the error of each axis after one budget."""
    low, high = ERROR_DECADES
    ticks = list(range(low, high + 1, 3))
    words = [f"≤ 10{_raised(k)}" if k == low else "1" if k == 0 else f"10{_raised(k)}" for k in ticks]
    at = rows.with_columns((pl.col(column).abs() * 1e3).clip(10.0**low) for column in MAP_ERRORS)
    for column, name in MAP_ERRORS.items():
        plot.add(
            heatmap(
                customdata=squares.matrix(at, column, 2), meta="log10", **squares.options, colorscale="Viridis",
                zmin=low, zmax=high, colorbar=_bar("|error| [mm]", tickvals=ticks, ticktext=words),
                hovertemplate=f"{where}%{{customdata:.2g}} mm{HOVER}",
            ),
            when | {"quantity": [name]},
        )  # fmt: skip


def _raised(power: int) -> str:
    """A power of ten as HTML."""
    return f"<sup>{str(power).replace('-', '−')}</sup>"


def _iterations(plot: Plot, rows: pl.DataFrame, squares: Squares, where: str, when: Json, most: int) -> None:
    """Draw iterations of the solved, and crosses for the others."""
    ticks = [n for n in ITERATION_TICKS if n <= most]
    solved, failed = (rows.filter((pl.col("status") == "solved") == ok) for ok in (True, False))
    plot.add(
        heatmap(
            customdata=squares.matrix(solved, "iterations"), meta="log10", **squares.options, colorscale="Viridis",
            zmin=0, zmax=float(np.log10(max(most, 2))),
            colorbar=_bar("iterations", tickvals=lean(np.log10(ticks)), ticktext=[str(n) for n in ticks]),
            hovertemplate=f"{where}iterations until solved: %{{customdata}}{HOVER}",
        ),
        when,
    )  # fmt: skip
    plot.add(
        line(
            x=lean(squares.us[failed["col"].to_numpy()]), y=lean(squares.vs[failed["row"].to_numpy()]), mode="markers",
            marker={"symbol": "x-thin", "size": 8, "line": {"width": 2, "color": "var(--alarm)"}},
            customdata=failed["status"].str.replace("_", " ").to_list(),
            hovertemplate=f"{where}not solved: %{{customdata}}{HOVER}",
        ),
        when,
    )  # fmt: skip


def _bar(title: str, **options: Any) -> Json:
    return {"title": {"text": title, "side": "right"}, "thickness": 12, "outlinewidth": 0, "len": 0.9, **options}
