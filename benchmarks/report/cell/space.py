"""Section: spots, planned and executed paths of the tool, and the laser's beam, in space."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.records import slug
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.cell.look import after_control, done, settings_of, shown_at, spots_blocks
from benchmarks.report.figures import HOVER, INK_COLOUR, MUTED_COLOUR, lean, line_3d
from benchmarks.report.run import Run
from benchmarks.report.timing.plans.space import axes_in_space
from optik.types import Array

SPOT_COLOUR, PLANNED_COLOUR, BEAM_COLOUR = "var(--c1)", "var(--c2)", "var(--alarm)"
"""Colours of the spot, the planned path and the beam; the executed path is in the colour of ink."""


EYE = {"x": 1.7, "y": -2.0, "z": 1.0}
"""Where the eye is, in units of the scene: far enough that the laser unit and all spots are in view."""


def space(run: Run) -> dict[str, Any] | None:
    """A picture in space of every block of spots."""
    boards = [_board(b, run) for b in spots_blocks(run) if not _kept(b).is_empty()]
    return {"words": (), "boards": boards, "tables": ()} if boards else None


def _kept(b: BlockRows) -> pl.DataFrame:
    return done(b).filter(pl.col("planned").is_not_null()).sort("distance")


def _everywhere(rows: pl.DataFrame, labels: list[str]) -> list[int]:
    """Spots to which every method has a path, the nearest first; all spots where there is none."""
    every = rows.group_by("problem", maintain_order=True).agg(pl.col("setting").n_unique())
    found: list[int] = every.filter(pl.col("setting") == len(labels))["problem"].to_list()
    return found or every["problem"].to_list()


def _points(values: Any) -> Array:
    """Flat numbers as points (k, 3) [mm]."""
    return 1e3 * np.array(values, dtype=float).reshape(-1, 3)


def _board(b: BlockRows, run: Run) -> Board:
    rows, name, labels = _kept(b), slug(b.block.id), settings_of([b])
    everything = np.vstack([_points(v) for column in ("planned", "tool", "beam") for v in rows[column]])
    all_spots = 1e3 * done(b).unique("problem").sort("problem").select("x", "y", "z").to_numpy()
    scene = axes_in_space(run.robot(b.block.robot).gravity, np.vstack([everything, all_spots]))
    scene["camera"] |= {"eye": EYE, "center": dict.fromkeys("xyz", 0.0)}
    plot = Plot(
        f"cell-space-{name}",
        "Planned and executed paths of the tool",
        {"scene": scene, "margin": dict.fromkeys("lrtb", 0)},
        560,
    )
    plot.add(_spots(all_spots))
    problems = _everywhere(rows, labels)
    for row in rows.iter_rows(named=True):
        when = shown_at(row["setting"], row["after"]) | {"spot": [str(row["problem"])]}
        for column, words, colour, width in (
            ("beam", "laser beam", BEAM_COLOUR, 2), ("planned", "planned path", PLANNED_COLOUR, 7),
            ("tool", "executed path", INK_COLOUR, 3),
        ):  # fmt: skip
            plot.add(_curve(_points(row[column]), words, colour, width), when)
    for (problem,), part in rows.group_by("problem", maintain_order=True):
        spot = 1e3 * np.array(part.select("x", "y", "z").row(0))
        plot.add(_spot(spot), {"spot": [str(problem)]})
    far = dict(rows.select("problem", "distance").iter_rows())
    spots = Control("spot", "Spot", tuple((str(p), f"{1e3 * far[p]:.0f} mm away") for p in problems), str(problems[-1]))
    legend = (
        Key("true spot", SPOT_COLOUR, "dot"), Key("other spots", MUTED_COLOUR, "dot"),
        Key("laser beam, measured", BEAM_COLOUR), Key("planned path", PLANNED_COLOUR),
        Key("executed path", INK_COLOUR),
    )  # fmt: skip
    methods = Control.of("method", "Method", labels, next(iter(settings_of([b], whole=True)), labels[0]))
    return Board(
        f"cell-space-board-{name}", (plot,), (methods, after_control(b), spots), legend,
        "Base frame, equal scales; drag to turn. With a budget of iterations the planned path is a move in joint space to the "
        "answer, so it is not straight.",
    )  # fmt: skip


def _spots(points: Array) -> dict[str, Any]:
    x, y, z = (lean(points[:, i], 5) for i in range(3))
    marker = {"size": 2, "color": MUTED_COLOUR}
    return line_3d(x=x, y=y, z=z, mode="markers", name="spots", marker=marker, hovertemplate=f"another spot{HOVER}")


def _curve(points: Array, words: str, colour: str, width: int) -> dict[str, Any]:
    x, y, z = (lean(points[:, i], 5) for i in range(3))
    return line_3d(x=x, y=y, z=z, name=words, line={"color": colour, "width": width}, hovertemplate=f"{words}{HOVER}")


def _spot(at: Array) -> dict[str, Any]:
    x, y, z = (lean([value], 5) for value in at)
    marker = {"size": 6, "color": SPOT_COLOUR, "symbol": "diamond", "line": {"color": MUTED_COLOUR, "width": 1}}
    return line_3d(x=x, y=y, z=z, mode="markers", name="true spot", marker=marker, hovertemplate=f"true spot{HOVER}")
