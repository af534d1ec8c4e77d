"""Measures of time laws on many lines: each on the rows of one law that have a motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks._torques import JOINT_LIMITS
from benchmarks.targets import Measure, Target, measure_named

NANO = 1e-9
"""Deviations below a nanometre or nanoradian are round-off."""

LEAST_BOUND = 1e-12
"""Certified deviations [m, rad] are taken as at least this where something is divided by them."""


def _column(name: str, statistic: Callable[[Any], Any], scale: float = 1.0) -> Callable[[pl.DataFrame], float]:
    """A statistic of a column."""
    return lambda rows: scale * float(statistic(rows[name].to_numpy()))


def _deviations(ratio: Callable[[Any, Any], Any]) -> Callable[[pl.DataFrame], float]:
    """The largest ratio of a sampled deviation and a certified one, of distances and of angles."""
    pairs = (("true_distance", "distance"), ("true_angle", "angle"))
    return lambda rows: float(max(ratio(rows[true].to_numpy(), rows[bound].to_numpy()).max() for true, bound in pairs))


def _largest(*columns: str) -> Callable[[pl.DataFrame], float]:
    """The largest value of some columns, in which limits that are free have none."""

    def compute(rows: pl.DataFrame) -> float:
        most = rows.select(pl.max_horizontal(columns)).to_series().max()
        return float("nan") if most is None else float(most)  # type: ignore[arg-type]

    return compute


def _paired(column: str, statistic: Callable[[Any], Any]) -> Callable[..., float]:
    """A statistic of the ratio of a column of one law to that of another, on the motions that both have."""

    def compute(rows: pl.DataFrame, law: str, to: str) -> float:
        mine, theirs = (rows.filter(pl.col("law") == label).select("line", "limits", column) for label in (law, to))
        both = mine.join(theirs, on=["line", "limits"], suffix="_to").drop_nulls()
        ratios = both[column].to_numpy() / both[f"{column}_to"].to_numpy()
        ratios = ratios[np.isfinite(ratios)]
        return float(statistic(ratios)) if ratios.size else float("nan")

    return compute


MEASURES = (
    Measure("solved", "%", _column("solved", np.mean, 100.0), "lines with a motion"),
    Measure("kept", "%", _column("keeps_all", np.mean, 100.0), "motions within every limit, exactly"),
    Measure("nearly", "%", _column("nearly", np.mean, 100.0), "motions that exceed no limit by more than 0.1 %"),
    Measure("holds", "%", _column("holds", np.mean, 100.0), "motions with a valid certificate"),
    Measure("worst_ratio", "", _largest(*JOINT_LIMITS), "largest peak / limit, exact", show="exact"),
    Measure("worst_velocity", "", _column("velocity", np.max), "largest velocity / limit, exact", show="exact"),
    Measure("worst_acceleration", "", _column("acceleration", np.max), "largest acceleration / limit, exact", show="exact"),
    Measure("worst_jerk", "", _column("jerk", np.max), "largest jerk / limit, exact", show="exact"),
    Measure("worst_torque", "", _largest("torque"), "largest torque / limit, proved bound", show="exact"),
    Measure("worst_torque_rate", "", _largest("torque_rate"), "largest torque rate / limit, proved bound", show="exact"),
    Measure("over_torque", "%", _column("over_torque", np.mean, 100.0), "motions over a torque limit"),
    Measure("median_optimum", "", _column("over_optimum", np.median), "median T / T*", show="exact"),
    Measure("worst_optimum", "", _column("over_optimum", np.max), "largest T / T*", show="exact"),
    Measure("median_kept", "", _column("kept_over_optimum", np.median), "median T / T*, stretched to the limits", show="exact"),
    Measure("worst_kept", "", _column("kept_over_optimum", np.max), "largest T / T*, stretched to the limits", show="exact"),
    Measure("median_ms", "ms", _column("ms_law", np.median), "median time of the law"),
    Measure("p95_ms", "ms", _column("ms_law", lambda ms: np.quantile(ms, 0.95)), "95th percentile of the law's time"),
    Measure("plan_ms", "ms", _column("ms_plan", np.median), "median time of a whole plan"),
    Measure("median_ms_ratio", "", _paired("ms_law", np.median), "median time of the law, as a ratio to", relative=True),
    Measure(
        "median_duration_ratio", "", _paired("slowed_duration", np.median),
        "median duration, both stretched to meet the limits, as a ratio to", show="exact", relative=True,
    ),
    Measure(
        "worst_duration_ratio", "", _paired("slowed_duration", np.max),
        "largest duration, both stretched to meet the limits, as a ratio to", show="exact", relative=True,
    ),
    Measure("deviation_um", "µm", _column("distance", np.max, 1e6), "largest certified distance from the line"),
    Measure(
        "truth_over_bound", "", _deviations(lambda true, bound: true / np.maximum(bound, LEAST_BOUND)),
        "largest deviation by dense sampling / certified one",
    ),
    Measure(
        "bound_over_truth", "", _deviations(lambda true, bound: bound / np.maximum(true, NANO)),
        "largest certified deviation / max(dense sampling, 1 nm or nrad)",
    ),
)  # fmt: skip
"""What a target of timed lines may ask for; ``solved`` is computed on all rows of a law, with a motion or without."""


def in_group(rows: pl.DataFrame, group: str) -> pl.DataFrame:
    """Rows of a kind of line, of a robot, or within a set of limits."""
    if not group:
        return rows
    return rows.filter(pl.any_horizontal(pl.col(name) == group for name in ("kind", "robot", "limits")))


def judge(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Value of a target on the rows of a block."""
    if rows is None or rows.filter(pl.col("law") == target.method).is_empty():
        return float("nan"), f"{target.method} was not run"
    own = in_group(rows.filter(pl.col("law") == target.method), target.group)
    good = own.filter("solved")
    note = f"{len(own):,} motions" if len(good) == len(own) else f"{len(good):,} of {len(own):,} motions"
    measure = measure_named(MEASURES, target.measure, "measure")
    if measure.relative:
        chosen = in_group(rows.filter(pl.col("law").is_in([target.method, target.to]) & pl.col("solved")), target.group)
        return float(measure.compute(chosen, target.method, target.to)), note
    if measure.name == "solved":
        return (measure.values(own)[0], note) if len(own) else (float("nan"), "no such lines")
    if measure.name == "plan_ms":
        good = good.filter(pl.col("ms_plan").is_not_null())
    if good.is_empty():
        return float("nan"), "no motions" if measure.name != "plan_ms" else "its whole plans were not timed"
    return measure.values(good)[0], note
