"""What an execution did: how far it was from its plan, what torques and energy it took; the same columns in all rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from optik.types import Array
from planners.cell.drives.base import Execution
from planners.plan import Plan

EXECUTION_TYPES: dict[str, Any] = {
    "drive": pl.String, "status": pl.String, "reason": pl.String, "duration": pl.Float64, "tracking_m": pl.Float64,
    "tracking_rad": pl.Float64, "tracking_joint": pl.String, "torque_ratio": pl.Float64, "torque_joint": pl.String,
    "energy": pl.Float64, "late": pl.Int64,
}  # fmt: skip
"""Columns that every execution has."""

EXECUTED_TO_END = "executed"
"""Status of a motion that was executed to its end; others are those of the plan, the drive or the cell."""


def facts_of(execution: Execution) -> dict[str, Any]:
    """Facts on an execution."""
    found = failure(execution.drive, EXECUTED_TO_END if execution else str(execution.status), execution.reason)
    if execution.motion is None or len(execution.t) < 2:
        return found
    motion, names = execution.motion, execution.robot.joint_names
    planned = motion(np.minimum(execution.t, motion.end))
    off = np.abs(execution.q - planned)
    joint = int(off.max(axis=0).argmax())
    tools = execution.robot.fk(execution.q)[:, :3, 3] - execution.robot.fk(planned)[:, :3, 3]
    found |= {
        "duration": float(execution.plan.trajectory.duration), "tracking_rad": float(off.max()),
        "tracking_joint": names[joint], "tracking_m": float(np.linalg.norm(tools, axis=1).max()), "late": execution.late,
    }  # fmt: skip
    if execution.torque is not None:
        found["energy"] = float(np.trapezoid(np.maximum(execution.torque * execution.dq, 0.0).sum(axis=1), execution.t))
        peak, bound = peaks(execution)
        if bound is not None:
            worst = int(np.argmax(peak / bound))
            found |= {"torque_ratio": float(peak[worst] / bound[worst]), "torque_joint": names[worst]}
    return found


def peaks(execution: Execution) -> tuple[Array, Array | None]:
    """Largest torque of each motor as the plant had it, and the certificate's bound on it."""
    assert execution.torque is not None
    bound = np.abs(np.asarray(execution.plan.certificate.torque.value, dtype=float))
    known = np.isfinite(bound).all() and (bound > 0.0).all()
    return np.abs(execution.torque).max(axis=0), bound if known else None


def why_not(planned: Plan) -> str:
    """Why a plan has no motion."""
    return str(planned.status) if planned.failure is None else planned.failure.reason


def failure(drive: str, status: str, reason: str) -> dict[str, Any]:
    """Facts on a motion that was not executed."""
    return dict.fromkeys(EXECUTION_TYPES) | {"drive": drive, "status": status, "reason": reason}
