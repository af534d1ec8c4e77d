"""Greatest speed of the tool's point and of its rotation along a trajectory: proved upper bounds, not samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.robot import Robot
from planners.trajectory import Trajectory


class ToolSpeed(NamedTuple):
    """Bounds on |v| [m/s] and |ω| [rad/s] of the tool, and when they are nearly reached [s]."""

    speed: float
    rotation: float
    t_speed: float
    t_rotation: float


def tool_speed(robot: Robot, trajectory: Trajectory, instants: int = 3001) -> ToolSpeed:
    """Find the greatest tool speeds."""
    t = np.linspace(0.0, trajectory.end, instants)
    twist = np.einsum("kij,kj->ki", robot.jacobian(trajectory(t)), trajectory(t, 1))
    v, w = np.linalg.norm(twist[:, :3], axis=1), np.linalg.norm(twist[:, 3:], axis=1)
    i, j = int(v.argmax()), int(w.argmax())
    return ToolSpeed(float(v[i]), float(w[j]), float(t[i]), float(t[j]))
