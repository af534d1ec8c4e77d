"""Section: maps of iterations and error over the sheets of graph paper."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.kinds.budgets.report.look import comparisons
from benchmarks.kinds.budgets.rows import BudgetRows
from benchmarks.problems.base import start_of
from benchmarks.report.board import Board, Control, Json, Key, Plot
from benchmarks.report.figures import HOVER, axis, heatmap, iterations, lean, line
from benchmarks.report.run import Run
from optik.arm.library import load
from optik.types import Array

MAP_ITERATIONS, MAP_ERROR = "iterations to 1e−6 m and rad", "position error"
"""What a map can show."""

ITERATION_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers on the scale of iterations."""

GREY = [[0, "var(--unknown)"], [1, "var(--unknown)"]]
"""Colours of a square without a known solution."""

_NAME = re.compile(r"^(?P<u>[XYZ])–(?P<v>[XYZ]) at (?P<normal>[xyz]) (?P<offset>[+-]\d+) mm$")
"""Name of the group of a sheet of graph paper."""


@dataclass(frozen=True)
class Sheet:
    """One sheet of graph paper: the two axes that span it, and its place along the third."""

    group: str
    u: str
    v: str
    normal: str
    offset: int

    @staticmethod
    def of(group: str) -> Sheet | None:
        """Read a sheet from the name of its group.

        Parameters
        ----------
        group : str
            Name of the group of problems.

        Returns
        -------
        Sheet or None
            None where the group is no sheet.
        """
        found = _NAME.match(group)
        return Sheet(group, found["u"], found["v"], found["normal"], int(found["offset"])) if found else None

    @property
    def plane(self) -> str:
        """Its two axes."""
        return f"{self.u}–{self.v}"


def maps(run: Run) -> dict[str, Any] | None:
    """One board for every block of graph paper.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where the run has no data for it.
    """
    boards = [_board(b) for b in comparisons(run) if b.block.set == "graph_paper"]
    return {"boards": boards} if boards else None


def _board(b: BudgetRows) -> Board:
    sheets = [s for g in b.rows["group"].unique(maintain_order=True) if (s := Sheet.of(g))]
    planes = list(dict.fromkeys(s.plane for s in sheets))
    offsets = sorted({s.offset for s in sheets})
    plots = []
    for plane in planes:
        plot = _empty(b, plane, next(s for s in sheets if s.plane == plane))
        for sheet in (s for s in sheets if s.plane == plane):
            _sheet(plot, b, sheet)
        plots.append(plot)
    where = tuple((str(o), f"{o:+d} mm from the tool" if o else "through the tool") for o in offsets)
    budgets = tuple((str(n), iterations(n)) for n in b.block.budgets)
    controls = (
        Control.of("quantity", "Show", (MAP_ITERATIONS, MAP_ERROR)),
        Control.of("method", "Method", b.methods),
        Control("budget", "After", budgets, str(_middle(b.block.budgets)), {"quantity": [MAP_ERROR]}),
        Control("offset", "Sheet", where, str(min(offsets, key=abs))),
    )
    legend = (
        Key("no known solution", "var(--unknown)", "fill"),
        Key("not solved within the largest budget", "var(--alarm)", "cross", {"quantity": [MAP_ITERATIONS]}),
        Key("tool at the start", "#fff", "ring"),
    )
    return Board(
        f"maps-{b.block.id}", tuple(plots), controls, legend,
        "Base frame, equal scales. Blank: the method was not run on this target. Iterations are those of a run of at most "
        f"{b.budget}.",
    )  # fmt: skip


def _middle(budgets: tuple[int, ...]) -> int:
    return budgets[min(len(budgets) - 1, 3)]


def _empty(b: BudgetRows, plane: str, sheet: Sheet) -> Plot:
    """Axes, and where the tool stands at the start."""
    robot = load(b.block.robot)
    tool = dict(zip("XYZ", 1e3 * robot.fk(start_of(robot, b.block.options["start_deg"]))[:3, 3], strict=True))
    plot = Plot(
        f"map-{b.block.id}-{plane.replace('–', '').lower()}", f"{plane} sheet (offset along {sheet.normal.upper()})",
        {
            "xaxis": axis(f"{sheet.u} [mm]", constrain="domain", showgrid=False, zeroline=False),
            "yaxis": axis(f"{sheet.v} [mm]", scaleanchor="x", constrain="domain", showgrid=False, zeroline=False),
        },
        height=0,
    )  # fmt: skip
    plot.add(
        line(
            x=lean([tool[sheet.u]]), y=lean([tool[sheet.v]]), mode="markers",
            marker={"symbol": "circle", "size": 12, "color": "#fff", "line": {"width": 3, "color": "#000"}},
            hovertemplate=f"tool at the start{HOVER}",
        )
    )  # fmt: skip
    return plot


@dataclass(frozen=True)
class Squares:
    """The squares of a sheet [mm], and rows laid out on them."""

    us: Array
    vs: Array

    @property
    def options(self) -> Json:
        """Where a heat map stands."""

        def step(ticks: Array) -> float:
            return float(round((ticks[-1] - ticks[0]) / (len(ticks) - 1), 4)) if len(ticks) > 1 else 1.0

        us, vs = self.us, self.vs
        return {"x0": float(us[0]), "dx": step(us), "y0": float(vs[0]), "dy": step(vs), "xgap": 1, "ygap": 1}

    def matrix(self, rows: pl.DataFrame, column: str, digits: int = 4) -> list[list[float | None]]:
        """One column over the squares; None where there is no row.

        Parameters
        ----------
        rows : DataFrame
            With the columns ``row`` and ``col`` of each square.
        column : str
            Which one.
        digits : int
            Significant digits.

        Returns
        -------
        list of list
            A value a square, row by row.
        """
        out = np.full((len(self.vs), len(self.us)), np.nan)
        out[rows["row"].to_numpy(), rows["col"].to_numpy()] = rows[column].to_numpy()
        return [lean(row, digits) for row in out]


def _sheet(plot: Plot, b: BudgetRows, sheet: Sheet) -> None:
    """Draw a sheet: what has no known solution, and every method's iterations and errors."""
    rows = b.rows.filter(pl.col("group") == sheet.group)
    across = [np.round(1e3 * rows[axis_.lower()].to_numpy(), 3) for axis_ in (sheet.u, sheet.v)]
    squares = Squares(*(np.unique(values) for values in across))
    rows = rows.with_columns(
        col=pl.Series(np.searchsorted(squares.us, across[0])), row=pl.Series(np.searchsorted(squares.vs, across[1]))
    )
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
    for label in b.methods:
        part = rows.filter((pl.col("method") == label) & pl.col("known"))
        last = part.filter(pl.col("budget") == b.budget)
        when = here | {"method": [label]}
        _iterations(plot, last, squares, where, when | {"quantity": [MAP_ITERATIONS]}, b.budget)
        for budget in b.block.budgets:
            at = part.filter(pl.col("budget") == budget).with_columns(mm=1e3 * pl.col("position_error"))
            plot.add(
                heatmap(
                    customdata=squares.matrix(at, "mm", 3), meta="log10", **squares.options, colorscale="Viridis",
                    zmin=-6, zmax=3,
                    colorbar=_bar("position error [mm]", tickvals=[-6, -3, 0, 3], ticktext=["10⁻⁶", "10⁻³", "1", "10³"]),
                    hovertemplate=f"{where}%{{customdata:.3g}} mm after {iterations(budget)}{HOVER}",
                ),
                when | {"quantity": [MAP_ERROR], "budget": [str(budget)]},
            )  # fmt: skip


def _iterations(plot: Plot, rows: pl.DataFrame, squares: Squares, where: str, when: Json, most: int) -> None:
    """Draw iterations of the solved, and crosses for the others."""
    ticks = [n for n in ITERATION_TICKS if n <= most]
    solved, failed = (rows.filter((pl.col("status") == "solved") == ok) for ok in (True, False))
    plot.add(
        heatmap(
            customdata=squares.matrix(solved, "iterations"), meta="log10", **squares.options, colorscale="Viridis",
            zmin=0, zmax=float(np.log10(max(most, 2))),
            colorbar=_bar("iterations", tickvals=lean(np.log10(ticks)), ticktext=[str(n) for n in ticks]),
            hovertemplate=f"{where}solved in %{{customdata}} iterations{HOVER}",
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
