"""Judgement of answers by our own forward kinematics and limits, never by a method's own claim."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.statistics import percentage
from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.types import Array, Flags

JUDGED_AT = (1e-3, 1e-6, 1e-9)
"""Tolerances [m and rad] for judging answers: coarse, that of a solved problem, and near the precision of a double.

The forward kinematics agrees with extended precision to 1e-15 m and rad on all arms of optik, six orders of magnitude below the
finest tolerance.
"""


def level_name(tolerance: float) -> str:
    """Return a tolerance as keys and names of measures have it: 1e-6."""
    return f"{tolerance:.0e}".replace("e-0", "e-")


def level_words(tolerance: float) -> str:
    """Return a tolerance as reports write it: 1e−6."""
    return level_name(tolerance).replace("-", "−")


def solved_at(tolerance: float) -> pl.Expr:
    """Say whether the answer of a row meets its target within a tolerance, with every joint inside its limits."""
    return pl.col("inside") & within(tolerance)


def within(tolerance: float) -> pl.Expr:
    """Say whether BOTH errors of a row are within a tolerance."""
    return (pl.col("position_error") <= tolerance) & (pl.col("rotation_error") <= tolerance)


def rate(rows: pl.DataFrame, condition: pl.Expr) -> tuple[float, float, float]:
    """Return the percentage of the rows that meet a condition, with its Wilson 95 % interval."""
    return percentage(int(rows.select(condition.sum()).item()) if len(rows) else 0, len(rows))


def shared(rows: pl.DataFrame, labels: tuple[str, ...] | None = None) -> pl.DataFrame:
    """Return the rows of some methods, or of all, on the problems given to all of them."""
    chosen = rows if labels is None else rows.filter(pl.col("method").is_in(labels))
    return chosen.filter(pl.col("method").n_unique().over("problem") == chosen["method"].n_unique())


def judge_configurations(robot: Robot, targets: Array, q: Array) -> tuple[Flags, Array, Array]:
    """Return which configurations are inside the limits, and their position and rotation errors [m, rad]."""
    e = robot.pose_errors(q, targets) if len(q) else np.empty((0, 6))
    return robot.limits.contains(q), np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1)


def judged(robot: Robot, targets: Array, answers: list[Array], *, wraps: bool) -> pl.DataFrame:
    """Judge the answers of calls: one row per target, of its best answer.

    A target is solved if any answer meets it within `Tolerance()` inside the limits. Of several answers, one inside the
    limits counts before one outside, then the smaller error.
    """
    owner = np.repeat(np.arange(len(answers)), [len(a) for a in answers])
    q = np.concatenate([np.empty((0, robot.n)), *answers])
    keep = np.isfinite(q).all(axis=1)
    q, owner = q[keep], owner[keep]
    if wraps:
        q = wrapped(robot, q)
    inside, position, rotation = judge_configurations(robot, targets[owner], q)
    tolerance = Tolerance()
    size = np.maximum(position / tolerance.position, rotation / tolerance.rotation)
    order = np.lexsort((size, ~inside, owner))
    first = order[np.unique(owner[order], return_index=True)[1]]  # the best answer of each target that has one
    k = len(answers)
    rows: dict[str, NDArray[Any]] = {
        "solved": np.zeros(k, dtype=bool),
        "inside": np.zeros(k, dtype=bool),
        "position_error": np.full(k, np.nan),
        "rotation_error": np.full(k, np.nan),
    }
    at = owner[first]
    rows["solved"][at] = inside[first] & (size[first] <= 1.0)
    rows["inside"][at] = inside[first]
    rows["position_error"][at], rows["rotation_error"][at] = position[first], rotation[first]
    return pl.DataFrame(rows)


def wrapped(robot: Robot, q: Array) -> Array:
    """Add full turns to revolute joints outside their limits, to bring them inside if possible."""
    lower, upper = robot.limits.lower, robot.limits.upper
    turn = 2.0 * np.pi
    up = q + turn * np.ceil(np.maximum(lower - 1e-9 - q, 0.0) / turn)
    moved = up - turn * np.ceil(np.maximum(up - upper - 1e-9, 0.0) / turn)
    return np.where(robot.prismatic, q, moved)
