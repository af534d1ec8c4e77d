"""Random paths and limits of all arms."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Path, Polyline

LOADED = {"panda": 2.0, "ur5e": 3.0, "puma560": 1.5, "iiwa14": 5.0, "ur10e": 5.0, "paper6r": 0.5}
"""Arms with masses, and payloads [kg]."""


def near(robot: Robot, q: Array, size: float, rng: np.random.Generator) -> Array:
    """A configuration near q, inside the limits."""
    return np.clip(q + rng.normal(0.0, size, robot.n), *span(robot))


def span(robot: Robot) -> tuple[Array, Array]:
    return np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)


def seam(T: Array, count: int, length: float, rng: np.random.Generator) -> Array:
    """Poses (count, 4, 4) of a random walk of a given length from a pose, its turns smooth."""
    way, poses = rng.normal(size=3), [T]
    for _ in range(count - 1):
        way = way + 0.5 * rng.normal(size=3) - 5.0 * (poses[-1][:3, 3] - T[:3, 3])
        way /= np.linalg.norm(way)
        poses.append(poses[-1].copy())
        poses[-1][:3, 3] += way * length / (count - 1)
    return np.array(poses)


def path_on(robot: Robot, q: Array, kind: int, rng: np.random.Generator) -> Path:
    """A line, a polyline of 3 to 150 points, or a move of the joints."""
    if kind == 0:
        return Line(robot.fk(q), robot.fk(near(robot, q, 0.2, rng)))
    if kind == 1:
        count = int(np.exp(rng.uniform(np.log(3), np.log(150.5))))
        return Polyline(seam(robot.fk(q), count, 0.2, rng), blend=0.001, blend_rotation=0.01)
    return JointLine(robot, q, near(robot, q, 0.4, rng))


def limits_of(robot: Robot, law: str, torque: bool, rng: np.random.Generator) -> MotionLimits:
    """Random limits; of an arm with masses and a payload those on its torques too."""
    own = np.full(robot.n, 2.0) if robot.limits.velocity is None else robot.limits.velocity
    v, a, j = np.array([2.0, 10.0, 100.0]) * 10.0 ** rng.uniform(-0.5, 0.5, 3)
    speed = float(rng.uniform(0.1, 0.5)) if rng.random() < 0.3 else None
    if not torque:
        return MotionLimits(np.minimum(v, own), a, j, tool_speed=speed)
    return MotionLimits(own, None if law == "optimal" else a, 10.0 * j, tool_speed=speed, torque=robot.limits.torque)
