"""One trial of the cell: the arm as planned and the true arm, the laser unit, a drive, and facts on an execution."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from benchmarks.blocks.arms import arm_with
from benchmarks.blocks.base import NUMBER, TEXT, WHOLE, Field
from benchmarks.blocks.cell.settings import AUTO_DRIVE, CellBlock, Noise
from benchmarks.blocks.contest import trial_seed
from optik import se3
from optik.arm.robot import Robot
from optik.types import Array
from planners.cell.drives import Drive, make_drive
from planners.cell.drives.base import Execution
from planners.cell.laser import PanTiltLaser
from planners.plan import Plan

EXECUTION = {
    "drive": TEXT, "status": Field(pl.String, "crashed"),
    "reason": Field(pl.String, "the process ended, or an error was raised"),
    "duration": Field(pl.Float64, None, "duration", "s", "less"),
    "tracking_m": Field(pl.Float64, None, "tracking error of the tool", "mm", "less", 1e3), "tracking_rad": NUMBER,
    "tracking_joint": TEXT, "torque_ratio": NUMBER, "torque_joint": TEXT,
    "energy": Field(pl.Float64, None, "energy", "J", "less"), "late": WHOLE,
}  # fmt: skip
"""Fields of every execution."""

EXECUTED_TO_END = "executed"
"""Status of a completely executed motion; other statuses are those of the plan, the drive or the cell."""


def facts_of(execution: Execution) -> dict[str, Any]:
    """Return the facts on an execution."""
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
        peak = np.abs(execution.torque).max(axis=0)
        bound = np.abs(np.asarray(execution.plan.certificate.torque.value, dtype=float))
        if np.isfinite(bound).all() and (bound > 0.0).all():
            worst = int(np.argmax(peak / bound))
            found |= {"torque_ratio": float(peak[worst] / bound[worst]), "torque_joint": names[worst]}
    return found


def failure(drive: str, status: str, reason: str) -> dict[str, Any]:
    """Return the facts on a motion that was not executed."""
    return dict.fromkeys(EXECUTION) | {"drive": drive, "status": status, "reason": reason}


def execute(block: CellBlock, planned: Plan, drive: Callable[[], Drive]) -> tuple[dict[str, Any], Execution | None]:
    """Execute a motion; return the facts on it, and the execution if there is a motion."""
    if not planned:
        why = str(planned.status) if planned.failure is None else planned.failure.reason
        return failure(block.drive, str(planned.status), why), None
    execution = drive().execute(planned)
    return facts_of(execution), execution


class Trial(NamedTuple):
    """Objects of one trial."""

    robot: Robot  # the arm as it is planned for
    plant: Robot  # the arm as it truly is: other friction and another payload
    seed: int  # of the encoders' noise
    rng: np.random.Generator  # for the laser's noise


def with_drive(block: Any) -> Any:
    """Return a block with the drive that it has on this machine."""
    if block.drive != AUTO_DRIVE:
        return block
    return block.model_copy(update={"drive": "mujoco" if find_spec("mujoco") is not None else "ideal"})


def trial_of(block: CellBlock, seed: int, number: int, repeat: int) -> Trial:
    """Sample the random quantities of a trial. They depend only on the arguments, not on the process or on other work."""
    robot = _arm(block.robot, block.payload)
    drawn = trial_seed(seed, number, "cell spot", repeat)
    rng = np.random.default_rng(drawn)
    return Trial(robot, plant_of(robot, block.noise, rng), drawn % 2**31, rng)


@lru_cache(maxsize=8)
def _arm(robot: str, payload: float | None) -> Robot:
    """Load an arm with its payload; reading its file takes as long as planning a motion."""
    return arm_with(robot, payload)


def plant_of(robot: Robot, noise: Noise, rng: np.random.Generator) -> Robot:
    """Return the true arm."""
    friction, payload = (
        1.0 + noise.friction * rng.uniform(-1.0, 1.0, robot.n),
        1.0 + noise.payload * rng.uniform(-1.0, 1.0),
    )
    if robot.inertia is None:
        return robot
    plant = robot.with_inertia(viscous=robot.inertia.viscous * friction, coulomb=robot.inertia.coulomb * friction)
    if robot.payload is None:
        return plant
    held = robot.payload
    return plant.with_payload(held.masses[-1] * payload, held.com, held.inertia * payload)


def drive_of(block: CellBlock, trial: Trial, q: Array) -> Drive:
    """Return a drive whose arm is at rest."""
    options = {"plant": trial.plant} if block.drive == "mujoco" else {}
    return make_drive(
        block.drive, trial.robot, q=q, period=block.period, seed=trial.seed, encoder=block.noise.encoder_counts,
        encoder_noise=block.noise.encoder_angle, **options,
    )  # fmt: skip


def lasers(
    robot: Robot, q: Array, position: tuple[float, ...], noise: Noise, rng: np.random.Generator
) -> tuple[PanTiltLaser, PanTiltLaser]:
    """Return the calibrated and the true pose of the laser unit."""
    pose = _looking(np.array(position), robot.fk(q)[:3, 3], -robot.gravity)
    spread = np.repeat([noise.laser_position, noise.laser_rotation], 3)
    laser = PanTiltLaser(
        pose, angle_noise=noise.laser_angle, range_noise=noise.laser_range, pose_covariance=np.diag(spread**2)
    )
    twist = spread * rng.normal(size=6)
    true = pose.copy()
    true[:3, 3] += twist[:3]
    true[:3, :3] = se3.exp_so3(twist[3:]) @ pose[:3, :3]
    return laser, laser.with_pose(true)


def _looking(position: Array, at: Array, up: Array) -> Array:
    """Return a pose whose x axis points to a point, and whose z axis is as close to vertical as possible."""
    x = at - position
    x /= np.linalg.norm(x)
    z = up - (up @ x) * x
    z /= np.linalg.norm(z)
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), position)
