"""Facts on one timed motion: what it keeps by its certificate, and what brute force finds beside that."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from optik import se3
from optik.robot import LIMIT_TOLERANCE, Robot
from planners.certificate import Certificate
from planners.fit import stretch
from planners.paths.base import Path
from planners.timing.base import DERIVATIVES, TOOL_SPEEDS, MotionLimits
from planners.trajectory import Trajectory

INSTANTS = 4999
"""Of the brute force beside the certificate: others than those that it looks at itself."""
SOLVED = "solved"
COLUMNS = (
    "law", "entry", "status", "reason", "duration", "velocity", "velocity_joint", "velocity_time", "acceleration",
    "acceleration_joint", "acceleration_time", "jerk", "jerk_joint", "jerk_time", "sampled_jerk", "tool_speed",
    "rotation_speed", "holds", "broken", "breaks", "slowed", "least_duration", "distance", "angle", "true_distance",
    "true_angle", "singular_value", "continuous", "ms_law", "ms_certificate", "ms_plan",
)  # fmt: skip
"""Of a row, beside those of its line. Ratios are worst values over limits, exact."""
WORDS = {"law", "entry", "status", "reason", "broken", "breaks", "velocity_joint", "acceleration_joint", "jerk_joint"}
SCHEMA = {
    name: pl.String
    if name in WORDS
    else pl.Boolean
    if name == "holds"
    else pl.Int64
    if name == "continuous"
    else pl.Float64
    for name in COLUMNS
}


def blank(law: str, entry: str) -> dict[str, Any]:
    """A row with every column, of a law or peer that has no motion."""
    return dict.fromkeys(COLUMNS) | {"law": law, "entry": entry, "status": SOLVED, "reason": ""}


def facts_of(robot: Robot, path: Path, motion: Trajectory, proof: Certificate, limits: MotionLimits) -> dict[str, Any]:
    """What a motion keeps, by its certificate, and what brute force finds of its deviation."""
    facts: dict[str, Any] = {
        "status": SOLVED, "duration": motion.duration, "holds": proof.holds, "broken": "; ".join(proof.broken),
        "breaks": ", ".join(breaks(proof, limits)), "tool_speed": proof.tool_speed,
        "rotation_speed": proof.rotation_speed, "distance": proof.path_error.distance,
        "angle": proof.path_error.angle, "singular_value": proof.singular_value, "continuous": proof.continuous,
        "sampled_jerk": float(proof.sampled_jerk.max()),
        "least_duration": motion.duration * stretch(robot, motion, limits),
    }  # fmt: skip
    for field in DERIVATIVES:
        facts[field], facts[f"{field}_joint"], facts[f"{field}_time"] = proof.worst(field)
    facts["true_distance"], facts["true_angle"] = off_path(robot, path, motion)
    return facts


def breaks(proof: Certificate, limits: MotionLimits) -> list[str]:
    """The limits that a motion exceeds, promised or not."""
    found = [field for field in DERIVATIVES if proof.worst(field)[0] > 1.0]
    found += [field for field, limit in zip(TOOL_SPEEDS, limits.tool, strict=True) if getattr(proof, field) > limit]
    return found + (["position"] if proof.position_margin.min() < -LIMIT_TOLERANCE else [])


def off_path(robot: Robot, path: Path, motion: Trajectory, instants: int = INSTANTS) -> tuple[float, float]:
    """Largest distance [m] and angle [rad] between tool and path at many instants."""
    tool = robot.fk(motion(np.linspace(0.0, motion.end, instants)))
    e = se3.error(tool, path.pose(path.nearest(tool)))
    return float(np.linalg.norm(e[:, :3], axis=1).max()), float(np.linalg.norm(e[:, 3:], axis=1).max())
