"""Facts on one timed motion: what it keeps by its certificate, and what sampling finds beside that."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks._torques import JOINT_LIMITS
from optik import se3
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import Certificate
from planners.fit import stretch_factor
from planners.limits import ALL_LIMITS, DERIVATIVES, MotionLimits
from planners.paths.base import Path
from planners.trajectory import Trajectory

CHECK_INSTANTS = 4999
"""Instants at which the deviation is sampled beside the certificate: others than those that it looks at itself."""

COLUMNS = (
    "law", "entry", "status", "reason", "duration", "velocity", "velocity_joint", "velocity_time", "acceleration",
    "acceleration_joint", "acceleration_time", "jerk", "jerk_joint", "jerk_time", "torque", "torque_joint", "torque_time",
    "torque_rate", "torque_rate_joint", "torque_rate_time", "sampled_jerk", "tool_speed",
    "rotation_speed", "worst", "holds", "broken", "breaks", "follows", "slowed", "least_duration", "distance", "angle",
    "true_distance", "true_angle", "singular_value", "continuous", "ms_law", "ms_certificate", "ms_plan",
)  # fmt: skip
"""Columns of a row, beside those of its line. Ratios are worst values over limits: exact, of torques proved bounds."""

FACT_TYPES = {
    pl.String: ("law", "entry", "status", "reason", "broken", "breaks", *(f"{field}_joint" for field in JOINT_LIMITS)),
    pl.Boolean: ("holds", "follows"),
    pl.Int64: ("continuous",),
}
"""Types of the columns that are no real numbers."""

SCHEMA = {name: next((kind for kind, some in FACT_TYPES.items() if name in some), pl.Float64) for name in COLUMNS}
"""Type of every column."""

RATIO_DECIMALS = 11
"""Decimals that are kept of a ratio: round-off takes 1e-12 from a ratio of exactly 1."""


def blank(law: str, entry: str) -> dict[str, Any]:
    """A row with every column, of a law or peer that has no motion yet."""
    return dict.fromkeys(COLUMNS) | {"law": law, "entry": entry, "status": "solved", "reason": ""}


def facts_of(robot: Robot, path: Path, motion: Trajectory, proof: Certificate, limits: MotionLimits) -> dict[str, Any]:
    """What a motion keeps, by its certificate, and what sampling finds of its deviation."""
    facts: dict[str, Any] = {
        "status": "solved", "duration": motion.duration, "holds": proof.is_valid, "broken": "; ".join(proof.reasons),
        "breaks": ", ".join(breaks(proof)), "tool_speed": proof.tool_speed.value,
        "rotation_speed": proof.rotation_speed.value, "distance": proof.path_error.distance,
        "angle": proof.path_error.angle, "singular_value": proof.singular_value, "continuous": proof.continuous,
        "sampled_jerk": float(proof.sampled_jerk.max()),
        "least_duration": least_duration(robot, path, motion, proof, limits),
    }  # fmt: skip
    for field in JOINT_LIMITS:
        ratio, joint, when = proof.worst(field)
        if not np.isnan(ratio):
            facts |= {field: round(ratio, RATIO_DECIMALS), f"{field}_joint": joint, f"{field}_time": when}
    facts["worst"] = round(float(np.nanmax([proof.worst(field)[0] for field in ALL_LIMITS])), RATIO_DECIMALS)
    # all of the path, forwards, from rest to rest, in range, no jumps: without promises, so the same for laws and peers
    facts["follows"] = replace(proof, enforced=(), tolerance=None).is_valid
    facts["true_distance"], facts["true_angle"] = off_path(robot, path, motion)
    return facts


def least_duration(robot: Robot, path: Path, motion: Trajectory, proof: Certificate, limits: MotionLimits) -> float:
    """Duration at which the same motion, scaled in time uniformly, just keeps every limit."""
    if any(np.isinf(proof.worst(field)[0]) for field in DERIVATIVES):
        return float("inf")
    return motion.duration * stretch_factor(MotionAnalysis(robot, motion, path), limits)


def breaks(proof: Certificate) -> list[str]:
    """The limits that a motion violates, promised or not."""
    found = [field for field in ALL_LIMITS if round(proof.worst(field)[0], RATIO_DECIMALS) > 1.0]
    return found + (["position"] if proof.position_margin.min() < -LIMIT_TOLERANCE else [])


def off_path(robot: Robot, path: Path, motion: Trajectory, instants: int = CHECK_INSTANTS) -> tuple[float, float]:
    """Largest distance and angle between tool and path at many instants."""
    tool = robot.fk(motion(np.linspace(0.0, motion.end, instants)))
    e = se3.error(tool, path.pose(path.nearest(tool)))
    return float(np.linalg.norm(e[:, :3], axis=1).max()), float(np.linalg.norm(e[:, 3:], axis=1).max())
