"""Sections: accuracy and repeatability in the manner of ISO 9283, and what the time laws cost on the plant."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.laws import OWN_TIME, SAME_TIME
from benchmarks.blocks.cell.settings import POSE_TEST, IsoBlock, LawsBlock
from benchmarks.records import slug
from benchmarks.report.board import Board, Control, Plot
from benchmarks.report.cell.head import drives_of, noise_words
from benchmarks.report.cell.look import cell_blocks
from benchmarks.report.cell.tables import iso_table, law_tables
from benchmarks.report.figures import HOVER, axis, lean, line
from benchmarks.report.run import Run
from planners.cell.iso9283 import POSE_FRACTION, describe_cube

COSTS = (("tracking_m", 1e3, "tracking error of the tool [mm]"), ("energy", 1.0, "energy [J]"))
"""What is drawn against the duration, with the factor to its unit."""


def iso(run: Run) -> dict[str, Any] | None:
    """Accuracy and repeatability of every block of cycles."""
    blocks = cell_blocks(run, IsoBlock)
    words = [
        f"{b.block.title}: {_cube(b)} Executed on the drive {drives_of(b)}. What varies from cycle to cycle: "
        f"{noise_words(b.block.noise) or 'nothing'}."
        for b in blocks
    ]
    return {"words": words, "boards": (), "tables": [iso_table(b) for b in blocks]} if blocks else None


def _cube(b: BlockRows) -> str:
    """The cube in words, its edge from the poses of the rows."""
    poses = b.rows.filter(pl.col("test") == POSE_TEST).unique("point").drop_nulls("point").sort("point")
    points = poses.select("x", "y", "z").to_numpy()
    if len(points) < 2:
        return "Five poses in a diagonal plane of a cube around the tool at the start."
    return describe_cube(float(np.linalg.norm(points[1] - points[0])) / (0.5 * POSE_FRACTION * 3.0**0.5))


def laws(run: Run) -> dict[str, Any] | None:
    """What the laws cost on the plant."""
    blocks = cell_blocks(run, LawsBlock)
    if not blocks:
        return None
    words = [
        f"{b.block.title}: the same lines under every law, executed on the drive {drives_of(b)}. The paper's quintic has "
        "constant speed, so it reaches full speed within the first sample. The other laws enforce the limits on velocity, "
        "acceleration and, except TOPP-RA, jerk."
        for b in blocks
    ]
    found = [table for b in blocks for table in law_tables(b, run)]
    boards = [board for b in blocks if (board := _board(b, run)).plots]
    return {"words": words, "boards": boards, "tables": found}


def _board(b: BlockRows, run: Run) -> Board:
    """Tracking error and energy against the duration, a point a law and line."""
    rows, name = b.rows.filter(pl.col("duration").is_not_null()), slug(b.block.id)
    plots = []
    for column, scale, title in COSTS:
        if rows[column].drop_nulls().is_empty() or not np.any(rows[column].drop_nulls().to_numpy()):
            continue
        frame = {"xaxis": axis("duration [s]", rangemode="tozero"), "yaxis": axis(title, rangemode="tozero")}
        plot = Plot(f"cell-laws-{column.removesuffix('_m')}-{name}", title.partition(" [")[0].capitalize(), frame, 360)
        for law in b.block.labels:
            for timed in (OWN_TIME, SAME_TIME):
                part = rows.filter(
                    (pl.col("method") == law) & (pl.col("timed") == timed) & pl.col(column).is_not_null()
                )
                trace = line(
                    x=lean(part["duration"]), y=lean(scale * part[column].to_numpy()), mode="markers",
                    marker={"size": 10, "color": run.colour(law), "symbol": run.symbol(law)},
                    hovertemplate=f"{law}<br>%{{x:.3g}} s: %{{y:.3g}}{HOVER}",
                )  # fmt: skip
                plot.add(trace, {"timed": [timed]})
        plots.append(plot)
    both = (b.rows["timed"] == SAME_TIME).any()
    options = (
        ((OWN_TIME, "each law's own"), (SAME_TIME, "that of the slowest")) if both else ((OWN_TIME, "each law's own"),)
    )
    legend = tuple(run.key(law) for law in b.block.labels)
    return Board(
        f"cell-laws-{name}", tuple(plots), (Control("timed", "Duration", options),), legend,
        "One point for each line and trial, with and without noise.",
    )  # fmt: skip
