"""Section: positions of spots and executed tools, and the error on each axis, the paper's Fig. 10 to 13 as executed."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.settings import AXES, WITHIN_M
from benchmarks.records import slug
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.cell.look import after_control, done, millimetres, settings_of, spots_blocks
from benchmarks.report.figures import HOVER, INK_COLOUR, axis, iterations, lean, line, shades
from benchmarks.report.run import Run

FIGURES = {"x": 11, "y": 12, "z": 13}
"""The paper's figure of each axis."""

FINE_SCALE, WHOLE_SCALE = "near", "all"
"""Choices of the scale of errors."""

NEAR_MM = 6.0
"""End of the fine scale: three times the paper's 2 mm [mm]."""

MOST_BUDGETS = 5
"""Budgets that one plot shows: more markers cannot be told apart."""


def axes(run: Run) -> dict[str, Any] | None:
    """Fig. 10, and Fig. 11 to 13, of every block of spots."""
    blocks = [b for b in spots_blocks(run) if not done(b).is_empty() and settings_of([b], whole=False)]
    if not blocks:
        return None
    words = [
        "The paper plots the positions of laser point and robot end (Fig. 10), and their difference on X, Y and Z for several "
        "numbers of iterations over the workspace (Fig. 11 to 13). It prints no values. These plots have the same axes and the "
        "values of this simulation: executed tool − spot, in the base frame."
    ]
    return {"words": words, "boards": [board for b in blocks for board in (_positions(b), _errors(b))], "tables": ()}


def _positions(b: BlockRows) -> Board:
    """Spots and executed tools, seen along each base axis."""
    rows, name, labels = done(b), slug(b.block.id), settings_of([b], whole=False)
    plots = []
    for normal in AXES:
        u, v = (a for a in AXES if a != normal)
        plot = Plot(
            f"cell-positions-{normal}-{name}", f"Seen along {normal.upper()}",
            {
                "xaxis": axis(f"{u.upper()} [mm]", constrain="domain"),
                "yaxis": axis(f"{v.upper()} [mm]", scaleanchor="x", constrain="domain"),
            }, 0,
        )  # fmt: skip
        spots = rows.unique("problem").sort("problem")
        plot.add(
            line(
                x=lean(millimetres(spots[u])), y=lean(millimetres(spots[v])), mode="markers",
                marker={"symbol": "circle-open", "size": 8, "color": "var(--c1)"},
                hovertemplate=f"spot at %{{x}}, %{{y}} mm{HOVER}",
            )
        )  # fmt: skip
        for (setting, after), part in rows.filter(pl.col("budget").is_not_null()).group_by(
            "setting", "after", maintain_order=True
        ):
            tools = line(
                x=lean(millimetres(part[u] + part[f"error_{u}"])), y=lean(millimetres(part[v] + part[f"error_{v}"])),
                mode="markers", marker={"size": 4, "color": INK_COLOUR},
                hovertemplate=f"executed tool at %{{x}}, %{{y}} mm{HOVER}",
            )  # fmt: skip
            plot.add(tools, {"method": [str(setting)], "after": [str(after)]})
        plots.append(plot)
    legend = (Key("laser spot", "var(--c1)", "ring"), Key("executed tool", INK_COLOUR, "dot"))
    return Board(
        f"cell-positions-{name}", tuple(plots), (Control.of("method", "Method", labels), after_control(b)), legend,
        "Fig. 10 as executed: laser spots with a known solution and the final positions of the tool, in the base frame.",
    )  # fmt: skip


def _errors(b: BlockRows) -> Board:
    """Error on each axis against the distance, for several budgets."""
    rows, name, labels = done(b), slug(b.block.id), settings_of([b], whole=False)
    budgets = list(b.block.budgets)
    if len(budgets) > MOST_BUDGETS:
        budgets = [budgets[round(i * (len(budgets) - 1) / (MOST_BUDGETS - 1))] for i in range(MOST_BUDGETS)]
    colours = dict(zip(budgets, shades(len(budgets)), strict=True))
    plots = []
    for a, figure in FIGURES.items():
        plot = Plot(
            f"cell-error-{a}-{name}", f"{a.upper()} error (Fig. {figure})",
            {
                "xaxis": axis("distance from the start [mm]", rangemode="tozero"),
                "yaxis": axis(f"error in {a.upper()} [mm]"), "shapes": [_bound(s * 1e3 * WITHIN_M) for s in (-1, 1)],
            }, 360,
        )  # fmt: skip
        plot.vary({"scale": [FINE_SCALE]}, {"yaxis": {"range": [-NEAR_MM, NEAR_MM]}})
        for label in labels:
            for budget in budgets:
                part = rows.filter((pl.col("setting") == label) & (pl.col("budget") == budget))
                trace = line(
                    x=lean(millimetres(part["distance"])), y=lean(millimetres(part[f"error_{a}"])), mode="markers",
                    marker={"size": 5, "color": colours[budget]},
                    hovertemplate=f"{iterations(budget)}<br>%{{x:.0f}} mm away: %{{y:.3g}} mm{HOVER}",
                )  # fmt: skip
                plot.add(trace, {"method": [label]})
        plots.append(plot)
    scale = Control("scale", "Scale", ((FINE_SCALE, f"± {NEAR_MM:g} mm"), (WHOLE_SCALE, "all errors")))
    legend = [Key(iterations(n), c, "dot") for n, c in colours.items()] + [Key("± 2 mm", "var(--alarm)")]
    return Board(
        f"cell-errors-{name}", tuple(plots), (Control.of("method", "Method", labels), scale), tuple(legend),
        "Fig. 11, 12 and 13 as executed, one point for each trial. The fine scale clips larger errors.",
    )  # fmt: skip


def _bound(at: float) -> dict[str, Any]:
    look = {"color": "var(--alarm)", "width": 1}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": at, "y1": at, "line": look}
