"""The plot of active limits along a path, which all lines in detail share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import polars as pl

from benchmarks.report.figures import add, axis, colour, figure, line
from planners.limits import ALL_LIMITS

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ACTIVE = 0.99
"""Distance to a limit up to which a constraint counts as active, relative to the limit [1]."""

LIMIT_COLOURS = {
    "velocity": 0, "acceleration": 1, "jerk": 2, "tool_speed": 3, "rotation_speed": 4, "torque": 5, "torque_rate": 6,
}  # fmt: skip
"""Number of the colour of each limit."""


def active_plot(name: str, near: pl.DataFrame, laws: Sequence[str], scale: float, unit: str) -> Figure:
    """Return a plot of the active limits along the path, with one row for each joint and limit."""
    rows = sorted(
        {(joint, limit) for joint, limit in near.select("joint", "limit").iter_rows()},
        key=lambda row: (ALL_LIMITS.index(row[1]), row[0]),
    )
    names = [f"{joint} {limit.replace('_', ' ')}" for joint, limit in rows]
    across = axis("", type="category", categoryorder="array", categoryarray=names[::-1], range=[-0.6, len(names) - 0.4])
    plot = figure(name, "Active constraint along the path", f"s [{unit}]", across, max(220, 90 + 26 * len(names)))
    for law in laws:
        for (joint, limit), part in near.filter(pl.col("law") == law).group_by("joint", "limit", maintain_order=True):
            x: list[float | None] = []
            for start, end in part.select("from", "to").iter_rows():
                x += [scale * start, scale * end, None]
            words = f"{joint} {str(limit).replace('_', ' ')}"
            trace = line(
                x, [words] * len(x), digits=5, name=str(limit).replace("_", " "),
                line={"color": limit_colour(str(limit)), "width": 9}, hover=f"{words} at %{{x:.4g}} {unit}",
            )  # fmt: skip
            add(plot, trace, {"law": [law]})
    return plot


def limit_colour(limit: str) -> str:
    """Return the colour of a limit."""
    return colour(LIMIT_COLOURS[limit])
