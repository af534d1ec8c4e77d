"""What a block of timed lines has shown: its rows with T / T*, and the value of every target on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl

from benchmarks.records import RunFolder, slug
from benchmarks.settings import Target
from benchmarks.timing_suite import TimingBlock
from optik.errors import InvalidInput
from planners.limits import DERIVATIVES

NANO = 1e-9
"""Deviations below a nanometre or nanoradian are rounding."""

MEASURES: dict[str, Callable[[pl.DataFrame], Any]] = {
    "kept": lambda rows: 100.0 * rows["keeps_all"].to_numpy().mean(),
    "holds": lambda rows: 100.0 * rows["holds"].to_numpy().mean(),
    "worst_ratio": lambda rows: max(rows[field].to_numpy().max() for field in DERIVATIVES),
    "worst_velocity": lambda rows: rows["velocity"].to_numpy().max(),
    "worst_acceleration": lambda rows: rows["acceleration"].to_numpy().max(),
    "worst_jerk": lambda rows: rows["jerk"].to_numpy().max(),
    "median_optimum": lambda rows: np.median(rows["over_optimum"].to_numpy()),
    "worst_optimum": lambda rows: rows["over_optimum"].to_numpy().max(),
    "median_ms": lambda rows: np.median(rows["ms_law"].to_numpy()),
    "p95_ms": lambda rows: np.quantile(rows["ms_law"].to_numpy(), 0.95),
    "plan_ms": lambda rows: np.median(rows["ms_plan"].to_numpy()),
    "deviation_um": lambda rows: 1e6 * rows["distance"].to_numpy().max(),
    "truth_over_bound": lambda rows: _deviations(rows, lambda true, bound: true / np.maximum(bound, 1e-12)),
    "bound_over_truth": lambda rows: _deviations(rows, lambda true, bound: bound / np.maximum(true, NANO)),
}
"""Each measure on the rows of one law that have a motion; ``solved`` is on all of them."""


def _deviations(rows: pl.DataFrame, ratio: Callable[[Any, Any], Any]) -> float:
    pairs = (("true_distance", "distance"), ("true_angle", "angle"))
    return float(max(ratio(rows[true].to_numpy(), rows[bound].to_numpy()).max() for true, bound in pairs))


def timing_facts(folder: RunFolder, block: TimingBlock) -> dict[str, Any]:
    """What is known of a block beside its rows: ``clock_ns``, and ``entries`` by label.

    Raises
    ------
    InvalidInput
        They are not there though rows are.
    """
    facts: dict[str, Any] | None = folder.read_json(f"timing/{slug(block.id)}.json")
    if facts is None:
        raise InvalidInput("run", f"no facts on {block.id!r}", "whole parts; delete timing/ and run again")
    return facts


def timing_rows(folder: RunFolder, block: TimingBlock) -> pl.DataFrame | None:
    """All rows of a block, with ``optimum`` T* [s] and ``over_optimum`` T / T*; None where nothing was run.

    T* is the least duration on that line within those limits of the reference and of every motion that keeps all
    limits exactly. ``kept_over_optimum`` is the same ratio after the motion was slowed, uniformly, until it keeps them.
    """
    files = sorted((folder.path / "timing").glob(f"{slug(block.id)}--*.parquet"))
    frames = [part for file in files if (part := folder.read(f"timing/{file.name}")) is not None]
    if not frames:
        return None
    rows = pl.concat(frames, how="vertical_relaxed")
    solved = (pl.col("status") == "solved").alias("solved")
    keeps = (pl.col("status") == "solved") & (pl.col("breaks") == "")
    counts = keeps | ((pl.col("entry") == "reference") & (pl.col("status") == "solved"))
    optimum = pl.when(counts).then(pl.col("duration")).min().over("line", "limits")
    return (
        rows.with_columns(solved, keeps_all=keeps, optimum=optimum)
        .with_columns(
            over_optimum=pl.col("duration") / pl.col("optimum"),
            kept_over_optimum=pl.max_horizontal("duration", "least_duration") / pl.col("optimum"),
        )
        .sort("line", "limits", maintain_order=True)
    )


def in_group(rows: pl.DataFrame, group: str) -> pl.DataFrame:
    """Rows of a kind of line or of a robot; all where none is named."""
    return rows.filter((pl.col("kind") == group) | (pl.col("robot") == group)) if group else rows


def measure_timing(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Value of a target, and how many motions it stands on."""
    if rows is None or rows.filter(pl.col("law") == target.method).is_empty():
        return float("nan"), f"{target.method} was not run"
    own = in_group(rows.filter(pl.col("law") == target.method), target.group)
    good = own.filter("solved")
    note = f"{len(own):,} motions" if len(good) == len(own) else f"{len(good):,} motions of {len(own):,} asked"
    if target.measure == "solved":
        return (100.0 * len(good) / len(own), note) if len(own) else (float("nan"), "no such lines")
    if target.measure == "plan_ms":
        good = good.filter(pl.col("ms_plan").is_not_null())
    if good.is_empty():
        return float("nan"), "no motions" if target.measure != "plan_ms" else "its whole plans were not timed"
    return float(MEASURES[target.measure](good)), note
