"""Random plans of all arms, paths and laws, for the figures on motions that are stopped or replanned while they run."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

import optik
from optik.arm.robot import Robot
from optik.errors import OptikError
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Path, Plan, Polyline, make_law, plan, replan

ARMS = ("gen3lite", "iiwa14", "irb120", "kr6", "panda", "paper6r", "puma560", "ur10e", "ur5e", "wx200")
LOADED = {"panda": 2.0, "ur5e": 3.0, "puma560": 1.5, "iiwa14": 5.0, "ur10e": 5.0, "paper6r": 0.5}
"""Arms with masses, and payloads [kg]."""
LAWS = ("optimal", "optimal", "ruckig", "smooth", "constant_speed", "toppra", "quintic")
STOPS_PER_PLAN = 10


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


@lru_cache(maxsize=2)
def valid_plan(case: int, steps: int = 40) -> Plan | None:
    """A valid plan, the same for the same case; every fifth one is replanned from a moving state."""
    rng = np.random.default_rng([20261122, case])
    for _ in range(steps):
        law, torque = str(rng.choice(LAWS)), case % 2 == 0
        robot = optik.load(str(rng.choice(tuple(LOADED) if torque else ARMS)))
        if torque:
            robot = robot.with_payload(LOADED[robot.name] * float(rng.uniform(0.2, 1.0)))
            torque = robot.limits.torque is not None
        low, high = span(robot)
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        try:
            made = plan(
                robot,
                path_on(robot, q, case % 3, rng),
                q,
                limits=limits_of(robot, law, torque, rng),
                timing=make_law(law),
            )
            if made and case % 5 == 0:
                made = replan(made, float(rng.uniform(0.05, 0.6)) * made.trajectory.duration)
        except OptikError:
            continue
        if made and made.trajectory.duration < 1000.0:
            return made
    return None
