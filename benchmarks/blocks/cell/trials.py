"""One trial of the cell: the arm as it is planned for, the arm and the laser unit as they truly are, and a drive."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from benchmarks.blocks._arms import arm_with
from benchmarks.blocks._seeds import trial_seed
from benchmarks.blocks.cell.settings import AUTO_DRIVE, CellBlock, Noise
from optik import se3
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives import Drive, make_drive
from planners.cell.laser import PanTiltLaser


class Trial(NamedTuple):
    """What one trial has.

    Attributes
    ----------
    robot : Robot
        The arm as it is planned for.
    plant : Robot
        The arm as it truly is: other friction and another payload.
    seed : int
        Of the encoders' noise.
    rng : Generator
        For what else is drawn, the laser's noise.
    """

    robot: Robot
    plant: Robot
    seed: int
    rng: np.random.Generator


def drive_name(block: CellBlock) -> str:
    """Name of the drive of a block on this machine."""
    if block.drive != AUTO_DRIVE:
        return block.drive
    return "mujoco" if find_spec("mujoco") is not None else "ideal"


def check_drive(block: CellBlock, name: str) -> None:
    """Refuse a drive that cannot be built here, before anything is run."""
    trial = trial_of(block, 0, 0, "check", 0, noise=False)
    drive_of(block, name, trial, trial.robot.limits.clip(np.zeros(trial.robot.n)))


def trial_of(block: CellBlock, seed: int, number: int, what: str, repeat: int, *, noise: bool = True) -> Trial:
    """Draw what varies in a trial. It depends on its arguments alone, not on the process or on what else is run."""
    robot = _arm(block.robot, block.payload)
    drawn = trial_seed(seed, number, f"cell {what}", repeat)
    rng = np.random.default_rng(drawn)
    return Trial(robot, plant_of(robot, block.noise, rng) if noise else robot, drawn % 2**31, rng)


@lru_cache(maxsize=8)
def _arm(robot: str, payload: float | None) -> Robot:
    """An arm with its payload; reading its file takes as long as a planned motion."""
    return arm_with(robot, payload)


def plant_of(robot: Robot, noise: Noise, rng: np.random.Generator) -> Robot:
    """The arm as it truly is."""
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


def drive_of(block: CellBlock, name: str, trial: Trial, q: Array, *, noise: bool = True) -> Drive:
    """A drive whose arm stands at rest."""
    options = {"plant": trial.plant} if name == "mujoco" else {}
    return make_drive(
        name, trial.robot, q=q, period=block.period, seed=trial.seed, encoder=block.noise.encoder_counts,
        encoder_noise=block.noise.encoder_angle if noise else 0.0, **options,
    )  # fmt: skip


def lasers(
    robot: Robot, q: Array, position: tuple[float, ...], noise: Noise, rng: np.random.Generator
) -> tuple[PanTiltLaser, PanTiltLaser]:
    """The laser unit as it was calibrated, and as it truly stands."""
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
    """A pose whose x axis goes to a point, and whose z axis is as far up as it can be."""
    x = at - position
    x /= np.linalg.norm(x)
    z = up - (up @ x) * x
    z /= np.linalg.norm(z)
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), position)


def start_configuration(robot: Robot, start_deg: tuple[float, ...], where: str) -> Array:
    """Start of a block in radians and metres."""
    if len(start_deg) != robot.n:
        raise InvalidInput(
            f"{where}: start_deg", f"{len(start_deg)} numbers", f"{robot.n}, one a joint of {robot.name}"
        )
    q = np.array(start_deg) / unit_factors(robot)
    if not robot.limits.contains(q):
        raise InvalidInput(f"{where}: start_deg", list(start_deg), f"a configuration inside the limits of {robot.name}")
    return q
