"""Sheets of graph paper: which there are, and the plot of one plane."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import polars as pl

from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.problems.base import start_of
from benchmarks.report.board import Json, Plot
from benchmarks.report.figures import HOVER, axis, lean, line
from optik.arm.robot import Robot
from optik.types import Array

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
        """Read a sheet from the name of its group."""
        found = _NAME.match(group)
        return Sheet(group, found["u"], found["v"], found["normal"], int(found["offset"])) if found else None

    @property
    def plane(self) -> str:
        """Its two axes."""
        return f"{self.u}–{self.v}"


def sheets_of(b: BudgetRows) -> list[Sheet]:
    """Sheets of graph paper of a block."""
    return [s for g in b.rows["group"].unique(maintain_order=True) if (s := Sheet.of(g))]


def sheet_plot(name: str, b: BudgetRows, sheet: Sheet, robot: Robot) -> Plot:
    """Return an empty plot of a plane with equal scales [mm], with the tool of the robot at the start."""
    tool = dict(zip("XYZ", 1e3 * robot.fk(start_of(robot, b.block.options["start_deg"]))[:3, 3], strict=True))
    plot = Plot(
        f"{name}-{b.block.id}-{sheet.u}{sheet.v}".lower(), f"{sheet.plane} sheet (offset along {sheet.normal.upper()})",
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
        """One column over the squares; None where there is no row."""
        out = np.full((len(self.vs), len(self.us)), np.nan)
        out[rows["row"].to_numpy(), rows["col"].to_numpy()] = rows[column].to_numpy()
        return [lean(row, digits) for row in out]


def laid_out(rows: pl.DataFrame, sheet: Sheet) -> tuple[pl.DataFrame, Squares]:
    """Rows of a sheet with the square of each."""
    rows = rows.filter(pl.col("group") == sheet.group)
    across = [np.round(1e3 * rows[axis_.lower()].to_numpy(), 3) for axis_ in (sheet.u, sheet.v)]
    squares = Squares(*(np.unique(values) for values in across))
    places = {
        "col": pl.Series(np.searchsorted(squares.us, across[0])), "row": pl.Series(np.searchsorted(squares.vs, across[1]))
    }  # fmt: skip
    return rows.with_columns(**places), squares
