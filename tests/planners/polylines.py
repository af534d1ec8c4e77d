"""Polylines drawn by seed: tiny and repeated segments among long ones, near-reversals, sharp and wide corners, eight arms."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import optik
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Path, Polyline

ARMS = ("iiwa14", "irb120", "kr6", "panda", "paper6r", "puma560", "ur5e", "ur10e")
REDRAWN = 200
"""Most draws in which a path cannot be built at all: one that returns the way it came, or turns by 180°."""


class Drawn(NamedTuple):
    """A task for the planner."""

    robot: Robot
    path: Polyline
    q_start: Array
    limits: MotionLimits


def draw(seed: int) -> Drawn:
    """The polyline of a seed, the same on every machine."""
    rng = np.random.default_rng([20261121, seed])
    for _ in range(REDRAWN):
        robot = optik.load(ARMS[int(rng.integers(len(ARMS)))])
        low, high = np.maximum(robot.limits.lower, -2.8), np.minimum(robot.limits.upper, 2.8)
        q = low + (high - low) * rng.uniform(0.25, 0.75, robot.n)
        waypoints = (_joint_walk if rng.random() < 0.6 else _pose_walk)(robot, q, low, high, rng)
        waypoints = _disturbed(waypoints, rng)
        blend = 10.0 ** rng.uniform(-5.0, np.log10(0.05))
        try:
            path = Polyline(np.array(waypoints), blend=blend, blend_rotation=10.0 * blend)
        except InvalidInput:
            continue
        return Drawn(robot, path, q, _limits(robot, rng))
    raise AssertionError(f"seed {seed}: no polyline could be built")


def _joint_walk(robot: Robot, q: Array, low: Array, high: Array, rng: np.random.Generator) -> list[Array]:
    """Poses of a random walk in the joints, steps of 1e-6 to 0.2 rad; some go back along the way they came, nearly."""
    walk = [q]
    for _ in range(int(rng.integers(2, 12))):
        step = 10.0 ** rng.uniform(-6.0, np.log10(0.2)) if rng.random() < 0.5 else rng.uniform(0.03, 0.2)
        if len(walk) > 1 and rng.random() < 0.12:  # nearly the way back
            after = walk[-2] + 10.0 ** rng.uniform(-4.0, -1.0) * _direction(robot.n, rng)
        else:
            after = walk[-1] + step * _direction(robot.n, rng)
        walk.append(np.clip(after, low, high))
    return [robot.fk(x) for x in walk]


def _pose_walk(robot: Robot, q: Array, low: Array, high: Array, rng: np.random.Generator) -> list[Array]:
    """Poses displaced and turned at random from one to the next; some only moved, some only turned."""
    T = robot.fk(q)
    walk = [T]
    scale = 10.0 ** rng.uniform(-4.0, -1.0)
    for _ in range(int(rng.integers(2, 12))):
        T = T.copy()
        size = scale * 10.0 ** rng.uniform(-1.0, 0.0)
        kind = rng.random()
        if kind < 0.85:
            T[:3, 3] += size * _direction(3, rng)
        if kind > 0.3:
            T[:3, :3] = Rotation.from_rotvec(rng.uniform(0.0, 4.0) * size * _direction(3, rng)).as_matrix() @ T[:3, :3]
        walk.append(T)
    return walk


def _disturbed(waypoints: list[Array], rng: np.random.Generator) -> list[Array]:
    """Some waypoints repeated, but for 1e-9 to 1e-4; at most twelve in all."""
    out: list[Array] = []
    for T in waypoints:
        out.append(T)
        if rng.random() < 0.12:
            again = T.copy()
            again[:3, 3] += 10.0 ** rng.uniform(-9.0, -4.0) * _direction(3, rng)
            out.append(again)
    return out[:12] if len(out) > 2 else [*out, out[0]]


def _direction(n: int, rng: np.random.Generator) -> Array:
    x = rng.normal(size=n)
    return np.asarray(x / np.linalg.norm(x))


def _limits(robot: Robot, rng: np.random.Generator) -> MotionLimits:
    """The arm's own where it has them all, the usual ones, or random ones over two decades."""
    own, kind = robot.limits, rng.random()
    usual: dict[str, Any] = {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}
    if kind < 0.3:
        mine = {f: getattr(own, f) for f in usual if getattr(own, f) is not None}
        return MotionLimits(**(usual | mine))
    if kind < 0.7:
        return MotionLimits(**usual)
    return MotionLimits(**{f: x * 10.0 ** rng.uniform(-1.0, 1.0, robot.n) for f, x in usual.items()})


def keeps_on(robot: Robot, path: Path, q: Array) -> bool:
    """Whether dense Newton steps of least joint motion follow a path inside the limits."""
    u = np.arange(12) / 12.0
    within = path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * u
    x = q.copy()
    for pose in path.pose(np.union1d(np.linspace(0.0, path.end, 600), within.ravel())):
        y = x.copy()
        for _ in range(6):
            J = robot.jacobian(y)
            y = y + J.T @ np.linalg.solve(J @ J.T + 1e-15 * np.eye(6), robot.pose_errors(y, pose))
        if np.abs(robot.pose_errors(y, pose)).max() > 1e-9 or np.abs(y - x).max() > 0.1 or not robot.limits.contains(y):
            return False
        x = y
    return True
