"""Sections on the sheets of graph paper: reached spots, tool positions (Fig. 10), errors (Fig. 11 to 13), iterations."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.budgets import SUCCESS_LEVELS, BudgetRows, succeeded
from benchmarks.problems.base import start_of
from benchmarks.report import boards
from benchmarks.report.base import Run
from benchmarks.report.boards import ALARM_COLOUR, Board, Control, Json, add, axis, colour, heatmap, line
from benchmarks.report.budgets.accuracy import chosen
from benchmarks.report.budgets.default import Pair, comparisons, pairs
from optik.arm.robot import Robot
from optik.types import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Heatmap, Scatter

MAP_ITERATIONS = "iterations to 1e−6 m and rad"
"""Quantities of a map besides the errors."""

MAP_ERRORS = {"error_x": "error in X (Fig. 11)", "error_y": "error in Y (Fig. 12)", "error_z": "error in Z (Fig. 13)"}
"""Columns of the errors of a map, and their names in the control."""

MAP_BUDGETS = 4
"""Budgets after which positions and errors are shown: the first, the last and two between, as neighbours look alike."""

ERROR_DECADES = (-9, 3)
"""Range of the errors' colours, as powers of ten of 1 mm: from 10⁻¹² m, below which all is rounding, to 1 m."""

ITERATION_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers on the scale of iterations."""

POSITION_METHODS = 2
"""Methods whose positions are shown: the paper's iteration and the default. More methods would look the same."""

_NAME = re.compile(r"^(?P<u>[XYZ])–(?P<v>[XYZ]) at (?P<normal>[xyz]) (?P<offset>[+-]\d+) mm$")
"""Name of the group of a sheet of graph paper."""


@dataclass(frozen=True)
class Sheet:
    """One sheet of graph paper: its group, the axes u and v that span it, its normal, and its offset along it [mm]."""

    group: str
    u: str
    v: str
    normal: str
    offset: int

    @property
    def plane(self) -> str:
        """Names of the two axes that span the sheet."""
        return f"{self.u}–{self.v}"

    @property
    def hover(self) -> str:
        """Return a square of the sheet in the words of a tooltip."""
        return f"{self.u} %{{x:.0f}} mm, {self.v} %{{y:.0f}} mm<br>"


def sheets_of(b: BudgetRows) -> list[Sheet]:
    """Return the sheets of graph paper of a block."""
    found = [_NAME.match(group) for group in b.rows["group"].unique(maintain_order=True)]
    return [Sheet(m[0], m["u"], m["v"], m["normal"], int(m["offset"])) for m in found if m]


def _sheet_plot(name: str, b: BudgetRows, sheet: Sheet, robot: Robot) -> Figure:
    """Return an empty plot of a plane with equal scales [mm], with the tool of the robot at the start."""
    tool = dict(zip("XYZ", 1e3 * robot.fk(start_of(robot, b.block.options["start_deg"]))[:3, 3], strict=True))
    plot = boards.figure(
        f"{name}-{b.block.id}-{sheet.u}{sheet.v}".lower(), f"{sheet.plane} sheet (offset along {sheet.normal.upper()})",
        axis(f"{sheet.u} [mm]", constrain="domain", showgrid=False, zeroline=False),
        axis(f"{sheet.v} [mm]", scaleanchor="x", constrain="domain", showgrid=False, zeroline=False), height=0,
    )  # fmt: skip
    add(plot, line(
        [tool[sheet.u]], [tool[sheet.v]], mode="markers", name="tool at the start",
        marker={"symbol": "circle", "size": 12, "color": "#fff", "line": {"width": 3, "color": "#000"}},
        hover="tool at the start",
    ))  # fmt: skip
    return plot


@dataclass(frozen=True)
class Squares:
    """Rows of a sheet, each with the row and column of its square, and the coordinates of the squares [mm]."""

    rows: pl.DataFrame
    us: Array
    vs: Array

    @staticmethod
    def of(rows: pl.DataFrame, sheet: Sheet) -> Squares:
        """Lay out the rows of a sheet."""
        rows = rows.filter(pl.col("group") == sheet.group)
        u, v = (np.round(1e3 * rows[axis_.lower()].to_numpy(), 3) for axis_ in (sheet.u, sheet.v))
        us, vs = np.unique(u), np.unique(v)
        places = {"col": pl.Series(np.searchsorted(us, u)), "row": pl.Series(np.searchsorted(vs, v))}
        return Squares(rows.with_columns(**places), us, vs)

    @property
    def options(self) -> Json:
        """Options that place a heat map."""

        def step(ticks: Array) -> float:
            return float(round((ticks[-1] - ticks[0]) / (len(ticks) - 1), 4)) if len(ticks) > 1 else 1.0

        us, vs = self.us, self.vs
        return {"x0": float(us[0]), "dx": step(us), "y0": float(vs[0]), "dy": step(vs), "xgap": 1, "ygap": 1}

    def matrix(self, rows: pl.DataFrame, column: str, digits: int = 4) -> Array:
        """Return one column over the squares; NaN where there is no row."""
        out = np.full((len(self.vs), len(self.us)), np.nan)
        out[rows["row"].to_numpy(), rows["col"].to_numpy()] = rows[column].to_numpy()
        return boards.lean(out.ravel(), digits).reshape(out.shape)

    def filled(self, rows: pl.DataFrame, look: str, hover: str, name: str) -> Heatmap:
        """Return some squares in one colour."""
        return heatmap(
            z=self.matrix(rows.with_columns(one=pl.lit(1.0)), "one"), **self.options, showscale=False, name=name,
            colorscale=[[0, look], [1, look]], hover=f"{hover}{name}",
        )  # fmt: skip


# ---------------------------------------------------------------- who reaches which spots


def picture(run: Run) -> dict[str, Any] | None:
    """Show which spots the default method and the paper's iteration reach, on the sheet nearest to the tool's start."""
    found = [pair for pair in pairs(run) if sheets_of(pair.rows)]
    return {"boards": [_picture_board(found[0], run)]} if found else None


def _picture_board(pair: Pair, run: Run) -> Board:
    b = pair.rows
    sheet = min(sheets_of(b), key=lambda s: abs(s.offset))
    plot = _sheet_plot("picture", b, sheet, run.robot(b.block.robot))
    squares = Squares.of(b.last.filter(pl.col("method").is_in([pair.paper, pair.attempt])), sheet)
    ok = succeeded(SUCCESS_LEVELS[-1]) & pl.col("known")
    solved = squares.rows.group_by("problem", "row", "col", "known").agg(
        mine=(ok & (pl.col("method") == pair.attempt)).any(), other=(ok & (pl.col("method") == pair.paper)).any()
    )
    mine, other, known = pl.col("mine"), pl.col("other"), pl.col("known")
    categories = (
        ("reached by both", colour(2), mine & other),
        (f"by {pair.attempt} only", run.colour(pair.attempt), mine & ~other),
        (f"by {pair.paper} only", run.colour(pair.paper), other & ~mine),
        ("by neither", ALARM_COLOUR, known & ~mine & ~other),
        ("no known solution", boards.UNKNOWN_COLOUR, ~known),
    )
    for words, look, wanted in categories:
        rows = solved.filter(wanted)
        if not rows.is_empty():
            add(plot, squares.filled(rows, look, sheet.hover, words))
    return Board(
        f"picture-{b.block.id}", (plot,), (),
        f"{sheet.plane} sheet through the tool, base frame; at most {b.budget} iterations, one attempt each.",
    )  # fmt: skip


# ---------------------------------------------------------------- positions and maps


def maps(run: Run) -> dict[str, Any] | None:
    """Show positions and errors of every block of graph paper."""
    found = [b for b in comparisons(run) if b.block.set == "graph_paper" and b.budgeted]
    shown = [board(b, run.robot(b.block.robot)) for b in found for board in (_positions_board, _maps_board)]
    return {"boards": shown} if shown else None


def _plane_plots(name: str, b: BudgetRows, robot: Robot) -> tuple[dict[str, Figure], Control, Control]:
    """Return an empty plot of each plane, the choice of a budget, and the choice of a sheet."""
    sheets, shown = sheets_of(b), chosen(b.block.budgets, MAP_BUDGETS)
    first = {sheet.plane: sheet for sheet in reversed(sheets)}
    planes = dict.fromkeys(sheet.plane for sheet in sheets)
    offsets = sorted({sheet.offset for sheet in sheets})
    where = tuple((str(o), f"{o:+d} mm from the tool" if o else "through the tool") for o in offsets)
    return (
        {plane: _sheet_plot(name, b, first[plane], robot) for plane in planes},
        Control("budget", "After", tuple((str(n), boards.iterations(n)) for n in shown), str(shown[len(shown) // 3])),
        Control("offset", "Sheet", where, str(min(offsets, key=abs))),
    )


def _positions_board(b: BudgetRows, robot: Robot) -> Board:
    """Plot the spots on the graph paper, and the tool's position when the budget ends a run."""
    solvers = dict(b.rows.select("method", "solver").unique().iter_rows())
    preferred = [next((m for m in b.budgeted if solvers[m] == name), "") for name in ("dls", "lm")]
    methods = list(dict.fromkeys([*(m for m in preferred if m), *b.budgeted]))[:POSITION_METHODS]
    plots, after, sheet_control = _plane_plots("positions", b, robot)
    for sheet in sheets_of(b):
        rows = b.known.filter(pl.col("group") == sheet.group)
        _add_positions(plots[sheet.plane], rows, sheet, methods, [int(n) for n, _ in after.options])
    return Board(
        f"positions-{b.block.id}", tuple(plots.values()), (Control.of("method", "Method", methods), after, sheet_control),
        "Fig. 10: laser spots with a known solution, and the tool at the last iterate within the budget, seen along the "
        "normal of the sheet. A line connects each spot with its tool.",
    )  # fmt: skip


def _add_positions(plot: Figure, rows: pl.DataFrame, sheet: Sheet, methods: list[str], budgets: list[int]) -> None:
    """Draw the spots of a sheet and the tools of every method after every budget."""
    here: Json = {"offset": [str(sheet.offset)]}
    u, v = sheet.u.lower(), sheet.v.lower()
    spots = rows.unique("problem").sort("problem")
    add(plot, line(
        1e3 * spots[u], 1e3 * spots[v], mode="markers", marker={"symbol": "circle-open", "size": 8, "color": colour(1)},
        name="laser spot", hover="spot at %{x}, %{y} mm",
    ), here)  # fmt: skip
    parts = rows.sort("problem").partition_by("method", "budget", as_dict=True)
    for method, budget in product(methods, budgets):
        if (method, budget) in parts:
            for trace in _tools(parts[method, budget], u, v):
                add(plot, trace, here | {"method": [method], "budget": [str(budget)]})


def _tools(part: pl.DataFrame, u: str, v: str) -> list[Scatter]:
    """Return the tools as points, and a line from each spot to its tool where they can be told apart."""
    spots = 1e3 * part.select(u, v).to_numpy()
    tools = spots - 1e3 * part.select(f"error_{u}", f"error_{v}").to_numpy()
    apart = np.linalg.norm(tools - spots, axis=1) > 1.0
    joined = [np.stack([spots[apart, i], tools[apart, i], np.full(int(apart.sum()), np.nan)], axis=1) for i in (0, 1)]
    lines = line(
        joined[0].ravel(), joined[1].ravel(), mode="lines", hoverinfo="skip", line={"color": boards.MUTED_COLOUR, "width": 1},
    )  # fmt: skip
    points = line(
        tools[:, 0], tools[:, 1], mode="markers", marker={"size": 4, "color": boards.INK_COLOUR}, name="tool",
        hover="tool at %{x}, %{y} mm",
    )  # fmt: skip
    return [lines, points]


def _maps_board(b: BudgetRows, robot: Robot) -> Board:
    plots, after, sheet_control = _plane_plots("map", b, robot)
    for sheet in sheets_of(b):
        _add_maps(plots[sheet.plane], b, sheet, [n for n, _ in after.options])
    errors = list(MAP_ERRORS.values())
    controls = (
        Control.of("quantity", "Show", (*errors, MAP_ITERATIONS)),
        Control.of("method", "Method", b.budgeted),
        replace(after, when={"quantity": errors}),
        sheet_control,
    )
    return Board(
        f"maps-{b.block.id}", tuple(plots.values()), controls,
        "Base frame, equal scales; |target − tool| on each axis at the last iterate within the budget. Errors up to "
        "10⁻⁹ mm (10⁻¹² m) are rounding and have one colour. Blank: the method was not given this target. The iteration "
        f"limit of the map of iterations is {b.budget}.",
    )  # fmt: skip


def _add_maps(plot: Figure, b: BudgetRows, sheet: Sheet, budgets: list[str]) -> None:
    """Draw a sheet: squares without a known solution, and every method's iterations and errors."""
    squares, here = Squares.of(b.rows, sheet), {"offset": [str(sheet.offset)]}
    unknown = squares.rows.unique("problem").filter(~pl.col("known"))
    add(plot, squares.filled(unknown, boards.UNKNOWN_COLOUR, sheet.hover, "no known solution"), here)
    for (label, budget), part in squares.rows.filter("known").partition_by("method", "budget", as_dict=True).items():
        when = here | {"method": [str(label)]}
        if budget == b.budget and label in b.budgeted:
            _add_iterations(plot, part, squares, sheet.hover, when | {"quantity": [MAP_ITERATIONS]}, b.budget)
        if str(budget) in budgets and label in b.budgeted:
            _add_errors(plot, part, squares, sheet.hover, when | {"budget": [str(budget)]})


def _add_errors(plot: Figure, rows: pl.DataFrame, squares: Squares, where: str, when: Json) -> None:
    """Draw the error of each axis after one budget."""
    low, high = ERROR_DECADES
    ticks = list(range(low, high + 1, 3))
    powers = {k: f"10<sup>{str(k).replace('-', '−')}</sup>" for k in ticks}
    words = [f"≤ {powers[k]}" if k == low else "1" if k == 0 else powers[k] for k in ticks]
    at = rows.with_columns((pl.col(column).abs() * 1e3).clip(10.0**low) for column in MAP_ERRORS)
    for column, name in MAP_ERRORS.items():
        trace = _coloured(
            squares.matrix(at, column, 2), squares, (low, high), "|error| [mm]", dict(zip(ticks, words, strict=True))
        )
        trace.update(hovertemplate=f"{where}%{{customdata:.2g}} mm{boards.HOVER}")
        add(plot, trace, when | {"quantity": [name]})


def _add_iterations(plot: Figure, rows: pl.DataFrame, squares: Squares, where: str, when: Json, most: int) -> None:
    """Draw iterations of the solved spots, and crosses for the others."""
    ticks = [n for n in ITERATION_TICKS if n <= most]
    solved, failed = (rows.filter((pl.col("status") == "solved") == ok) for ok in (True, False))
    high = float(np.log10(max(most, 2)))
    marks = {float(np.log10(n)): str(n) for n in ticks}
    trace = _coloured(squares.matrix(solved, "iterations"), squares, (0, high), "iterations", marks)
    trace.update(hovertemplate=f"{where}iterations until solved: %{{customdata}}{boards.HOVER}")
    add(plot, trace, when)
    add(plot, line(
        squares.us[failed["col"].to_numpy()], squares.vs[failed["row"].to_numpy()], mode="markers",
        marker={"symbol": "x-thin", "size": 8, "line": {"width": 2, "color": ALARM_COLOUR}},
        name="not solved within the largest budget", customdata=failed["status"].str.replace("_", " ").to_list(),
        hover=f"{where}not solved: %{{customdata}}",
    ), when)  # fmt: skip


def _coloured(
    values: Array, squares: Squares, ends: tuple[float, float], title: str, marks: dict[float, str]
) -> Heatmap:
    """Return a map with logarithmic colours."""
    bar = {"title": {"text": title, "side": "right"}, "thickness": 12, "outlinewidth": 0, "len": 0.9}
    return heatmap(
        z=np.log10(np.maximum(values, boards.NOISE)), customdata=values, meta={"log10": True}, **squares.options,
        colorscale="Viridis", zmin=ends[0], zmax=ends[1],
        colorbar=bar | {"tickvals": list(marks), "ticktext": list(marks.values())},
    )  # fmt: skip
