"""Where the spots are and where the tool comes to stand, the paper's Fig. 10."""

from __future__ import annotations

from itertools import product

import numpy as np
import polars as pl

from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.board import Board, Control, Json, Key, Plot
from benchmarks.report.figures import HOVER, INK_COLOUR, iterations, lean, line
from benchmarks.report.ik.budgets.accuracy import chosen
from benchmarks.report.ik.budgets.sheets import Sheet, sheet_plot
from optik.arm.robot import Robot

POSITION_METHODS = 2
"""Methods whose positions are shown: the paper's iteration and the default; more would only repeat them."""

POSITION_BUDGETS = 4
"""Budgets after which positions are shown."""


def positions(b: BudgetRows, sheets: list[Sheet], robot: Robot) -> Board:
    """Plot the spots on the graph paper, and where the tool is when the budget ends a run."""
    methods, budgets = _methods(b), chosen(b.block.budgets, POSITION_BUDGETS)
    plots = []
    for plane in dict.fromkeys(s.plane for s in sheets):
        of_plane = [s for s in sheets if s.plane == plane]
        plot = sheet_plot("positions", b, of_plane[0], robot)
        for sheet in of_plane:
            _sheet(plot, b.known.filter(pl.col("group") == sheet.group), sheet, methods, budgets)
        plots.append(plot)
    offsets = sorted({s.offset for s in sheets})
    controls = (
        Control.of("method", "Method", methods),
        Control("budget", "After", tuple((str(n), iterations(n)) for n in budgets), str(budgets[len(budgets) // 3])),
        Control(
            "offset", "Sheet", tuple((str(o), f"{o:+d} mm from the tool" if o else "through the tool") for o in offsets),
            str(min(offsets, key=abs)),
        ),
    )  # fmt: skip
    legend = (
        Key("laser spot", "var(--c1)", "ring"), Key("tool", INK_COLOUR, "dot"), Key("tool at the start", "#fff", "ring"),
    )  # fmt: skip
    return Board(
        f"positions-{b.block.id}", tuple(plots), controls, legend,
        "Fig. 10: laser spots with a known solution, and the tool at the last iterate within the budget, seen along the "
        "normal of the sheet. A line connects each spot with its tool.",
    )  # fmt: skip


def _methods(b: BudgetRows) -> list[str]:
    """The first of the paper's methods and one attempt of the default, where the block has them; else the first ones."""
    solvers = dict(b.rows.select("method", "solver").unique().iter_rows())
    preferred = [next((m for m in b.budgeted if solvers[m] == name), "") for name in ("dls", "lm")]
    return list(dict.fromkeys([*(m for m in preferred if m), *b.budgeted]))[:POSITION_METHODS]


def _sheet(plot: Plot, rows: pl.DataFrame, sheet: Sheet, methods: list[str], budgets: list[int]) -> None:
    """Draw the spots of a sheet and the tools of every method after every budget."""
    here: Json = {"offset": [str(sheet.offset)]}
    u, v = sheet.u.lower(), sheet.v.lower()
    spots = rows.unique("problem").sort("problem")
    plot.add(
        line(
            x=lean(1e3 * spots[u]), y=lean(1e3 * spots[v]), mode="markers",
            marker={"symbol": "circle-open", "size": 8, "color": "var(--c1)"},
            hovertemplate=f"spot at %{{x}}, %{{y}} mm{HOVER}",
        ),
        here,
    )  # fmt: skip
    parts = rows.sort("problem").partition_by("method", "budget", as_dict=True)
    for method, budget in product(methods, budgets):
        if (method, budget) in parts:
            for trace in _tools(parts[method, budget], u, v):
                plot.add(trace, here | {"method": [method], "budget": [str(budget)]})


def _tools(part: pl.DataFrame, u: str, v: str) -> list[Json]:
    """The tools as points, and a line from each spot to its tool where they can be told apart."""
    spots = 1e3 * part.select(u, v).to_numpy()
    tools = spots - 1e3 * part.select(f"error_{u}", f"error_{v}").to_numpy()
    apart = np.linalg.norm(tools - spots, axis=1) > 1.0
    joined = [np.stack([spots[apart, i], tools[apart, i], np.full(int(apart.sum()), np.nan)], axis=1) for i in (0, 1)]
    lines = line(
        x=lean(joined[0].ravel()), y=lean(joined[1].ravel()), mode="lines", hoverinfo="skip",
        line={"color": "var(--muted)", "width": 1},
    )  # fmt: skip
    points = line(
        x=lean(tools[:, 0]), y=lean(tools[:, 1]), mode="markers", marker={"size": 4, "color": INK_COLOUR},
        hovertemplate=f"tool at %{{x}}, %{{y}} mm{HOVER}",
    )  # fmt: skip
    return [lines, points]
