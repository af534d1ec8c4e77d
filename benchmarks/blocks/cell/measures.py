"""Measures of executed motions: each on the rows of one entry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl

from benchmarks.blocks.cell.isorows import figures_of
from benchmarks.statistics import wilson
from benchmarks.targets import Measure
from planners.cell.iso9283 import PathFigures, PoseFigures

WITHIN_M = 2e-3
"""Accuracy on each axis that the paper claims [m]."""

AXES = ("x", "y", "z")
"""Axes of the base frame, as columns of the rows end."""


def within(rows: pl.DataFrame) -> pl.Series:
    """Whether each executed tool is within the paper's accuracy on each axis; a trial without an execution is not."""
    found = rows.select(ok=pl.max_horizontal(*(pl.col(f"error_{a}").abs() for a in AXES)) <= WITHIN_M)["ok"]
    return found.fill_null(False)


def _within(rows: pl.DataFrame) -> tuple[float, float, float]:
    ok = within(rows)
    low, high = wilson(int(ok.sum()), len(ok))
    return 100.0 * float(ok.sum()) / len(ok), 100.0 * low, 100.0 * high


def _executed(rows: pl.DataFrame) -> float:
    return 100.0 * float((rows["status"] == "executed").to_numpy().mean())


def _quantile(column: str, share: float, scale: float = 1.0) -> Callable[[pl.DataFrame], float]:
    def value(rows: pl.DataFrame) -> float:
        found = rows[column].drop_nulls().to_numpy()
        return scale * float(np.quantile(found, share)) if len(found) else float("nan")

    return value


def _iso(what: type, field: str) -> Callable[[pl.DataFrame], float]:
    """The largest of one figure of ISO 9283, over the poses or the path; NaN where it is not applicable."""

    def value(rows: pl.DataFrame) -> float:
        found = [getattr(f, field) for f in figures_of(rows) if isinstance(f, what)]
        return 1e3 * max(found) if found and None not in found else float("nan")

    return value


OF_EXECUTIONS = (
    Measure("executed", "%", _executed, "executed to the end"),
    Measure("tracking_mm", "mm", _quantile("tracking_m", 1.0, 1e3), "largest tracking error of the tool"),
    Measure("tracking_mrad", "mrad", _quantile("tracking_rad", 1.0, 1e3), "largest tracking error of a joint"),
    Measure("torque_ratio", "", _quantile("torque_ratio", 1.0), "largest torque / certificate's bound", show="exact"),
    Measure("median_energy_j", "J", _quantile("energy", 0.5), "median energy"),
    Measure("median_duration_s", "s", _quantile("duration", 0.5), "median duration"),
)  # fmt: skip
"""What every executed motion has."""

OF_SPOTS = (
    Measure("within_2mm", "%", _within, "within 2 mm on each axis", parts=("value", "low", "high"), show="share"),
    Measure("median_error_mm", "mm", _quantile("position_error", 0.5, 1e3), "median position error"),
    Measure("p95_error_mm", "mm", _quantile("position_error", 0.95, 1e3), "95th percentile of the position error"),
    Measure("worst_servo_mm", "mm", _quantile("servo_error", 1.0, 1e3), "largest servo error at the end"),
    Measure("worst_split_m", "m", _quantile("split_rest", 1.0), "largest |total − sum of its parts|"),
)
"""What spots have beside."""

OF_ISO = (
    Measure("ap_mm", "mm", _iso(PoseFigures, "accuracy"), "AP, largest of the five poses (simulated)"),
    Measure("rp_mm", "mm", _iso(PoseFigures, "repeatability"), "RP, largest of the five poses (simulated)"),
    Measure("at_mm", "mm", _iso(PathFigures, "accuracy"), "AT (simulated)"),
    Measure("rt_mm", "mm", _iso(PathFigures, "repeatability"), "RT (simulated)"),
)
"""What cycles of ISO 9283 have beside."""

MEASURES = {"spots": (*OF_SPOTS, *OF_EXECUTIONS), "iso": (*OF_ISO, *OF_EXECUTIONS), "laws": OF_EXECUTIONS}
"""What a target of a block may ask for, by what the block executes."""

ALL_MEASURES = (*OF_SPOTS, *OF_ISO, *OF_EXECUTIONS)
"""All of them, each once."""
