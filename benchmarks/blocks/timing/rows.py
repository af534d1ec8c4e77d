"""Rows of timed lines: columns of a motion, T / T* of all, and the measures that a target may name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import NUMBER, TEXT, TRUTH, WHOLE, Field, fields_of
from benchmarks.blocks.block import Column, largest, mean, median, quantile
from benchmarks.blocks.entries import JOINT_LIMITS
from optik import se3
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from planners.certificate.analysis import MotionAnalysis, find_discontinuities
from planners.certificate.certificate import Certificate
from planners.limits import ALL_LIMITS, DERIVATIVES, MotionLimits
from planners.motion.motion import find_stretch_factor
from planners.paths.base import Path
from planners.trajectory import Trajectory

CHECK_INSTANTS = 4999
"""Number of instants at which the deviation is sampled; they differ from those of the certificate."""

FIELDS = {
    "method": TEXT, "problem": TEXT, "entry": TEXT, "status": Field(pl.String, "crashed"), "reason": Field(pl.String, ""),
    "duration": Field(pl.Float64, None, "duration", "s", "less", only="solved"),
    **{name: field for limit in JOINT_LIMITS
       for name, field in ((limit, NUMBER), (f"{limit}_joint", TEXT), (f"{limit}_time", NUMBER))},
    **fields_of(NUMBER, "sampled_jerk tool_speed rotation_speed worst further"), "holds": TRUTH, "broken": TEXT, "breaks": TEXT,
    "follows": TRUTH, **fields_of(NUMBER, "slowed least_duration distance angle true_distance true_angle singular_value"),
    "continuous": WHOLE, "ms_law": Field(pl.Float64, None, "time of the law", "ms", "less", only="solved", clock="wall"),
    "ms_certificate": NUMBER, "ms_plan": Field(pl.Float64, None, "time of a whole plan", "ms", "less", clock="wall"),
    **fields_of(NUMBER, "distance_time angle_time energy power clearance own_clearance end_error"), "rest": TEXT,
    "jumps": Field(pl.List(pl.Float64)), **fields_of(TEXT, "robot kind"), "index": WHOLE,
    **fields_of(NUMBER, "length turn"), "draws": WHOLE, "start": Field(pl.List(pl.Float64)), "ms_follow": NUMBER,
    **fields_of(NUMBER, "ik_position_error ik_rotation_error"), **fields_of(TEXT, "solver limits"), "line": WHOLE,
    "solved": Field(pl.Boolean, None, "motions found", "%", "more", stored=False),
    "keeps_all": Field(pl.Boolean, None, "within every limit", "%", "more", only="solved", stored=False),
}  # fmt: skip
"""Fields of a row. Ratios are peak / limit: exact, for torques proved bounds."""

RATIO_DECIMALS = 11
"""Number of stored decimals of a ratio: rounding changes a ratio of exactly 1 by 1e-12."""


def plan_facts(
    robot: Robot, path: Path, motion: Trajectory, proof: Certificate, limits: MotionLimits
) -> dict[str, Any]:
    """Return the certified figures of a motion, and its sampled deviation."""
    facts: dict[str, Any] = {
        "status": "solved", "duration": motion.duration, "holds": proof.is_valid, "broken": "; ".join(proof.reasons),
        "breaks": ", ".join(breaks(proof)), "tool_speed": proof.tool_speed.value,
        "rotation_speed": proof.rotation_speed.value, "distance": proof.path_error.distance,
        "angle": proof.path_error.angle, "singular_value": proof.singular_value, "continuous": proof.continuous,
        "sampled_jerk": float(proof.sampled_jerk.max()),
        "least_duration": stretched_duration(robot, path, motion, proof, limits),
    }  # fmt: skip
    off = proof.path_error
    facts |= {"distance_time": off.t_distance, "angle_time": off.t_angle}
    facts["rest"] = ", ".join("yes" if rests else "no" for rests in proof.rest)
    facts["jumps"] = [float(np.abs(find_discontinuities(motion, order)).max()) for order in range(4)]
    if proof.energy is not None:
        facts |= {"energy": proof.energy.drawn, "power": proof.energy.power}
    near = proof.clearance
    for name, kind in () if near is None else (("clearance", near.scene), ("own_clearance", near.own)):
        facts[name] = kind.value if kind is not None and np.isfinite(kind.value) else None
    for field in JOINT_LIMITS:
        ratio, joint, when = proof.worst(field)
        if not np.isnan(ratio):
            facts |= {field: round(ratio, RATIO_DECIMALS), f"{field}_joint": joint, f"{field}_time": when}
    ratios = {field: proof.worst(field)[0] for field in (*ALL_LIMITS, *proof.extra)}
    facts["worst"] = round(float(np.nanmax([*ratios.values()])), RATIO_DECIMALS)
    if proof.extra:
        facts["further"] = round(max(ratios[field] for field in proof.extra), RATIO_DECIMALS)
    # all of the path, forwards, from rest to rest, in range, no jumps: without promises, so the same for laws and peers
    facts["follows"] = replace(proof, enforced=(), tolerance=None).is_valid
    facts["true_distance"], facts["true_angle"] = off_path(robot, path, motion)
    return facts


def stretched_duration(robot: Robot, path: Path, motion: Trajectory, proof: Certificate, limits: MotionLimits) -> float:
    """Return the duration at which the motion, scaled uniformly in time, respects every limit."""
    if any(np.isinf(proof.worst(field)[0]) for field in DERIVATIVES):
        return float("inf")
    return motion.duration * find_stretch_factor(MotionAnalysis(robot, motion, path), limits)


def breaks(proof: Certificate) -> list[str]:
    """Return the limits that a motion violates, enforced or not."""
    found = [field for field in (*ALL_LIMITS, *proof.extra) if round(proof.worst(field)[0], RATIO_DECIMALS) > 1.0]
    return found + (["position"] if proof.position_margin.min() < -LIMIT_TOLERANCE else [])


def off_path(robot: Robot, path: Path, motion: Trajectory, instants: int = CHECK_INSTANTS) -> tuple[float, float]:
    """Return the largest distance and angle between tool and path at many instants."""
    tool = robot.fk(motion(np.linspace(0.0, motion.end, instants)))
    e = se3.error(tool, path.pose(path.nearest(tool)))
    return float(np.linalg.norm(e[:, :3], axis=1).max()), float(np.linalg.norm(e[:, 3:], axis=1).max())


NEARLY = 1.001
"""Largest ratio to a limit that counts as within 0.1 %: a discretised method may exceed it between its grid points."""

ON_PATH_M, ON_PATH_RAD = 1e-4, 1e-4
"""Largest certified distance [m] and angle [rad] from the path for a motion that counts: far above any law's (3e-6)."""


def with_optimum(rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows with ``optimum`` T* [s] and ``over_optimum`` T / T*.

    T* is the least duration on that line within those limits of any motion, the reference's included, after the uniform
    stretch in time that ours get, too: as much as it needs to meet all limits. ``kept_over_optimum`` is the ratio after the
    stretch. Both ratios are infinite where there is no motion, and the second also where no stretch suffices or the motion
    is not on its path or does not cover it (``follows``). ``keeps_all`` says whether a motion meets all limits unchanged,
    ``nearly`` whether it exceeds none by more than 0.1 %.
    """
    on_path = (pl.col("distance") <= ON_PATH_M) & (pl.col("angle") <= ON_PATH_RAD)
    inside = ~pl.col("breaks").str.contains("position")
    rows = rows.with_columns(
        solved=pl.col("status") == "solved",
        follows=pl.col("follows").fill_null(value=True) & on_path.fill_null(value=True) & inside.fill_null(value=True),
    )
    follows = pl.col("solved") & pl.col("follows")
    return (
        rows.with_columns(
            keeps_all=pl.col("solved") & (pl.col("breaks") == ""),
            nearly=follows & (pl.col("worst") <= NEARLY),
            over_torque=pl.col("solved") & (pl.col("torque") > 1.0).fill_null(value=False),
            slowed_duration=pl.when(follows).then(pl.max_horizontal("duration", "least_duration")),
        )
        .with_columns(
            optimum=pl.when(pl.col("slowed_duration").is_finite()).then("slowed_duration").min().over("problem")
        )
        .with_columns(
            over_optimum=(pl.col("duration") / pl.col("optimum")).fill_null(np.inf),
            kept_over_optimum=(pl.col("slowed_duration") / pl.col("optimum")).fill_null(np.inf),
        )
        .sort("line", "limits", maintain_order=True)
    )


NANO = 1e-9
"""Deviations below a nanometre or nanoradian are rounding."""

LEAST_BOUND = 1e-12
"""Least certified deviation [m, rad] that is used as a divisor."""


def _deviations(ratio: Callable[[Any, Any], Any]) -> Callable[[pl.DataFrame], float]:
    """Return the largest ratio of a sampled deviation to a certified one, of distances and of angles."""
    pairs = (("true_distance", "distance"), ("true_angle", "angle"))
    return lambda rows: float(max(ratio(rows[true].to_numpy(), rows[bound].to_numpy()).max() for true, bound in pairs))


def _paired(column: str, statistic: Callable[[Any], Any]) -> Callable[..., float]:
    """Return a statistic of the ratio of a column between two laws, on the motions that both have."""

    def compute(rows: pl.DataFrame, law: str, to: str) -> float:
        mine, theirs = (rows.filter(pl.col("method") == label).select("problem", column) for label in (law, to))
        both = mine.join(theirs, on="problem", suffix="_to").drop_nulls()
        ratios = both[column].to_numpy() / both[f"{column}_to"].to_numpy()
        ratios = ratios[np.isfinite(ratios)]
        return float(statistic(ratios)) if ratios.size else float("nan")

    return compute


OF_EVERY_MOTION = ("solved", "median_optimum", "worst_optimum")
"""Measures of all requested motions; the others are of those that were found."""

MEASURES = (
    Column("solved", "lines with a motion", "%", of=mean("solved", 100.0)),
    Column("kept", "motions within every limit, exactly", "%", of=mean("keeps_all", 100.0)),
    Column("nearly", "motions that exceed no limit by more than 0.1 %", "%", of=mean("nearly", 100.0)),
    Column("holds", "motions with a valid certificate", "%", of=mean("holds", 100.0)),
    Column("worst_ratio", "largest peak / limit, exact", show="exact", of=largest(pl.max_horizontal(JOINT_LIMITS))),
    Column("worst_velocity", "largest velocity / limit, exact", show="exact", of=largest("velocity")),
    Column("worst_acceleration", "largest acceleration / limit, exact", show="exact", of=largest("acceleration")),
    Column("worst_jerk", "largest jerk / limit, exact", show="exact", of=largest("jerk")),
    Column("over_torque", "motions over a torque limit", "%", of=mean("over_torque", 100.0)),
    Column("median_optimum", "median duration / shortest known (T*)", show="exact", of=median("over_optimum")),
    Column("worst_optimum", "largest duration / shortest known (T*)", show="exact", of=largest("over_optimum")),
    Column("median_ms", "median time of the law", "ms", of=median("ms_law")),
    Column("p95_ms", "95th percentile of the law's time", "ms", of=quantile("ms_law", 0.95)),
    Column("plan_ms", "median time of a whole plan", "ms", of=median("ms_plan")),
    Column("median_ms_ratio", "median time of the law, as a ratio to", of=_paired("ms_law", np.median), relative=True),
    Column("median_duration_ratio", "median duration, both stretched to meet the limits, as a ratio to",
           show="exact", of=_paired("slowed_duration", np.median), relative=True),
    Column("worst_duration_ratio", "largest duration, both stretched to meet the limits, as a ratio to",
           show="exact", of=_paired("slowed_duration", np.max), relative=True),
    Column("deviation_um", "largest certified distance from the line", "µm", of=largest("distance", 1e6)),
    Column("truth_over_bound", "largest deviation by dense sampling / certified one",
           of=_deviations(lambda true, bound: true / np.maximum(bound, LEAST_BOUND))),
    Column("bound_over_truth", "largest certified deviation / max(dense sampling, 1 nm or nrad)",
           of=_deviations(lambda true, bound: bound / np.maximum(true, NANO))),
)  # fmt: skip
"""Measures that a target of timed lines can name."""


def in_group(rows: pl.DataFrame, group: str) -> pl.DataFrame:
    """Return the rows of a kind of line, of a robot, or within a set of limits."""
    if not group:
        return rows
    return rows.filter(pl.any_horizontal(pl.col(name) == group for name in ("kind", "robot", "limits")))
