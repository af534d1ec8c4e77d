"""Sections of the report on the executed cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.iso9283 import POSE_FRACTION, SIMULATED, PoseFigures, describe_cube
from benchmarks.blocks.cell.laws import OWN_TIME, SAME_TIME
from benchmarks.blocks.cell.settings import (
    MEASURES,
    NOISY,
    POSE_TEST,
    IsoBlock,
    LawsBlock,
    SpotsBlock,
    figures_of,
)
from benchmarks.blocks.cell.settings import (
    Noise as Noise,
)
from benchmarks.experiments.executed import executed_claims
from benchmarks.records import slug
from benchmarks.report.base import QUESTION, KindReport, Run, Section
from benchmarks.report.boards import Board, Control
from benchmarks.report.cell.spots import axes, space, split
from benchmarks.report.cell.tables import (
    cell_blocks,
    drives_of,
    iso_table,
    law_tables,
    noise_words,
    spots_blocks,
    tables,
)
from benchmarks.report.figures import add, axis, figure, line
from benchmarks.report.numbers import number
from benchmarks.report.sections import claims_of


def claims(run: Run) -> dict[str, Any] | None:
    """Show the paper's claims as executed, for every block of spots."""
    found = [f for b in spots_blocks(run) for f in executed_claims(b.rows)]
    return claims_of(found) if found else None


def findings(run: Run) -> Sequence[str]:
    """Return verdicts as executed, accuracy and repeatability, and the laws' costs, one sentence for each block."""
    found = [
        f"As executed, claim ({f.key}) {f.verdict}: {f.summary}"
        for b in spots_blocks(run)
        for f in executed_claims(b.rows)
    ]
    found += [_iso_sentence(b) for b in cell_blocks(run, IsoBlock)]
    return [words for words in (*found, *(_laws_sentence(b) for b in cell_blocks(run, LawsBlock))) if words]


def _iso_sentence(b: BlockRows) -> str:
    found = {m.key: m.value(b.rows.filter(b.rows["method"] == NOISY)) for m in MEASURES["iso"][:4]}
    poses = [f for f in figures_of(b.rows.filter(b.rows["method"] == NOISY)) if isinstance(f, PoseFigures)]
    if not poses:
        return ""
    words = ", ".join(f"{name[:2].upper()} {number(value)} mm" for name, value in found.items() if value == value)
    cycles = "1 cycle" if poses[0].cycles == 1 else f"{poses[0].cycles} cycles"
    return f"In the manner of ISO 9283, {SIMULATED}, worst of five poses over {cycles} and of one line: {words}."


def _laws_sentence(b: BlockRows) -> str:
    rows = b.rows.filter((b.rows["timed"] == OWN_TIME) & (b.rows["repeat"] == 0) & b.rows["tracking_m"].is_not_null())
    if rows.is_empty():
        return ""
    each = rows.group_by("method", maintain_order=True).agg(pl.col("tracking_m", "duration").max())
    words = [f"{law} {number(1e3 * off)} mm in {number(T)} s" for law, off, T in each.iter_rows()]
    return f"{b.block.title}: largest tracking error of the tool, and longest duration: {'; '.join(words)}."


def limitations(run: Run) -> Sequence[str]:
    """Describe the simulation and its random quantities."""
    found = ["Every execution is simulated; nothing was measured on a real arm."]
    for b in run.of("cell"):
        varies = noise_words(b.block.noise)
        load = "" if b.block.payload is None else f" {b.block.payload:g} kg in the tool."
        found.append(
            f"{b.block.title}: executed on the drive {drives_of(b)}, set-points every {1e3 * b.block.period:g} ms.{load} "
            f"What varies: {varies or 'nothing'}."
        )
    return found


COSTS = (("tracking_m", 1e3, "tracking error of the tool [mm]"), ("energy", 1.0, "energy [J]"))
"""Quantities that are plotted against the duration, with the factor to their unit."""


def iso(run: Run) -> dict[str, Any] | None:
    """Show accuracy and repeatability of every block of cycles."""
    blocks = cell_blocks(run, IsoBlock)
    words = [
        f"{b.block.title}: {_cube(b)} Executed on the drive {drives_of(b)}. What varies from cycle to cycle: "
        f"{noise_words(b.block.noise) or 'nothing'}."
        for b in blocks
    ]
    return {"words": words, "boards": (), "tables": [iso_table(b) for b in blocks]} if blocks else None


def _cube(b: BlockRows) -> str:
    """Describe the cube; its edge is computed from the poses of the rows."""
    poses = b.rows.filter(pl.col("test") == POSE_TEST).unique("problem").drop_nulls("problem").sort("problem")
    points = poses.select("x", "y", "z").to_numpy()
    if len(points) < 2:
        return "Five poses in a diagonal plane of a cube around the tool at the start."
    return describe_cube(float(np.linalg.norm(points[1] - points[0])) / (0.5 * POSE_FRACTION * 3.0**0.5))


def laws(run: Run) -> dict[str, Any] | None:
    """Show tracking error, torque and energy of the laws on the plant."""
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
    boards = [board for b in blocks if (board := _board(b, run)).figures]
    return {"words": words, "boards": boards, "tables": found}


def _board(b: BlockRows, run: Run) -> Board:
    """Plot tracking error and energy against the duration, one point for each law and line."""
    rows, name = b.rows.filter(pl.col("duration").is_not_null()), slug(b.block.id)
    plots = []
    for column, scale, title in COSTS:
        if rows[column].drop_nulls().is_empty() or not np.any(rows[column].drop_nulls().to_numpy()):
            continue
        axes = axis("duration [s]", rangemode="tozero"), axis(title, rangemode="tozero")
        plot = figure(
            f"cell-laws-{column.removesuffix('_m')}-{name}", title.partition(" [")[0].capitalize(), *axes, 360
        )
        for law in b.block.labels:
            for timed in (OWN_TIME, SAME_TIME):
                part = rows.filter(
                    (pl.col("method") == law) & (pl.col("timed") == timed) & pl.col(column).is_not_null()
                )
                trace = line(
                    part["duration"], scale * part[column].to_numpy(), mode="markers",
                    marker={"size": 10, "color": run.colour(law), "symbol": run.symbol(law)}, name=law,
                    hover=f"{law}<br>%{{x:.3g}} s: %{{y:.3g}}",
                )  # fmt: skip
                add(plot, trace, {"timed": [timed]})
        plots.append(plot)
    both = (b.rows["timed"] == SAME_TIME).any()
    options = (
        ((OWN_TIME, "each law's own"), (SAME_TIME, "that of the slowest")) if both else ((OWN_TIME, "each law's own"),)
    )
    return Board(
        f"cell-laws-{name}", tuple(plots), (Control("timed", "Duration", options),),
        "One point for each line and trial, with and without noise.",
    )  # fmt: skip


REPORT = KindReport(
    (
        Section("The paper's claims, as executed", "cell-claims", claims, QUESTION.with_name("claims.html.j2"), 61),
        Section("The task in space", "cell-space", space, order=62),
        Section("Sources of the error", "cell-split", split, order=63),
        Section("Spot and tool, as executed (Fig. 10 to 13)", "cell-axes", axes, order=64),
        Section("ISO 9283, simulated", "cell-iso", iso, order=65),
        Section("Time laws on the plant", "cell-laws", laws, order=66),
    ),
    lambda blocks: ("executed motions of the laser cell",),
    tables=tables,
    findings=findings,
    limitations=limitations,
    labels=lambda block: [m.label for m in block.methods] if isinstance(block, SpotsBlock) else block.labels,
)
