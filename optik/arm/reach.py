"""Reach of an arm: proved bounds for every configuration inside the limits."""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.task import Task
from optik.types import Array

REACH_ROUNDING = 1e-9
"""Slack for rounding errors of the bound and the distance [m]."""

FARTHEST_REACH = 3.0
"""Largest plausible distance of a point in a file, as a multiple of the reach."""
MILLIMETRES = 20.0
"""Multiple of the reach from which a distance is probably in millimetres: then it is at least a fiftieth of the reach."""


def reach_bound(robot: Robot, task: Task) -> Array:
    """Return a point of the base (3,), a point of the tool (3,), and the least and largest distance between them [m].

    One point is chosen on every joint axis. The distance of consecutive points is constant (a range for a prismatic joint).
    By the polygon inequality, the distance from the first to the last point is at most the sum of all distances, and at
    least the longest less all others. The points minimise the sum. If the task fixes the rotation, the last point is on the
    last axis; else it is the tool point. A task with a free position component has no bound: (…, 0, ∞).
    """
    if not all(task.mask[:3]):
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.inf])
    whole = all(task.mask[3:])
    robot = robot.axes
    t = _shortest(robot, whole)
    z = np.zeros((robot.n, 4))
    z[:, 2], z[:, 3] = t, 1.0
    low, high = np.zeros(robot.n + 1), np.zeros(robot.n + 1)
    for i in range(robot.n):
        # in the frame before joint i: from the point of joint i − 1 (for the first joint, its own at q = 0) to that of i
        before = z[i - 1] if i else robot.fixed[0] @ z[0]
        low[i], high[i] = _distances(robot, i, robot.fixed[i] @ z[i] - before)
    if not whole:
        low[-1] = high[-1] = np.linalg.norm(robot.tool[:3, 3] - z[-1, :3])
    largest = high.sum()
    least = max(0.0, float(np.max(low - (largest - high)))) if np.isfinite(largest) else 0.0
    A = robot.fixed[0] @ z[0]
    c = np.linalg.solve(robot.tool, z[-1]) if whole else np.array([0.0, 0.0, 0.0, 1.0])
    # largest distance of the tool's point from the target's point inside the tolerance box
    room = float(np.linalg.norm(task.box[:3]) + np.linalg.norm(task.box[3:]) * np.linalg.norm(c[:3]))
    least, largest = least - room, largest + room
    return np.array([*A[:3], *c[:3], least, largest])


def _distances(robot: Robot, i: int, v: Array) -> tuple[float, float]:
    """Return the least and largest length of v (4,), in the frame before joint i, as the joint moves inside its limits."""
    if not robot.prismatic[i]:
        length = float(np.linalg.norm(v[:3]))
        return length, length
    axis = robot.fixed[i, :3, 2]
    low, high = robot.limits.lower[i], robot.limits.upper[i]
    ends = [float(np.linalg.norm(v[:3] + q * axis)) if np.isfinite(q) else np.inf for q in (low, high)]
    nearest = float(np.clip(-(v[:3] @ axis), low, high))
    return float(np.linalg.norm(v[:3] + nearest * axis)), max(ends)


def ask_unit(distance: float, most: float) -> str:
    """Return a question about the unit of a point at a distance [m] far beyond the reach; empty for a nearer point."""
    far = distance > MILLIMETRES * most
    return "; coordinates are in metres: are these in millimetres?" if far else ""


@lru_cache(maxsize=64)  # shared by an arm's solvers: it takes 10 ms
def _shortest(robot: Robot, whole: bool) -> Array:
    """Return the positions (n,) of the points on the joint axes [m] that minimise the sum of their distances."""
    # Least squares with weights 1 / distance (Weiszfeld 1937). Any points give a valid bound; the smallest sum gives the
    # tightest.
    n, middle = robot.n, robot.limits.middle
    rows = n - 1 + (not whole)
    A, b = np.zeros((3 * rows, n)), np.zeros(3 * rows)
    for k in range(rows):
        A[3 * k + 2, k] = -1.0
        if k + 1 < n:
            shift = middle[k + 1] if robot.prismatic[k + 1] else 0.0
            A[3 * k : 3 * k + 3, k + 1] += robot.fixed[k + 1, :3, 2]
            b[3 * k : 3 * k + 3] = -(robot.fixed[k + 1, :3, 3] + shift * robot.fixed[k + 1, :3, 2])
        else:
            b[3 * k : 3 * k + 3] = -robot.tool[:3, 3]
    t = np.zeros(n)
    for _ in range(100):
        d = np.linalg.norm((A @ t - b).reshape(rows, 3), axis=1)
        w = np.repeat(1.0 / np.sqrt(d + 1e-9), 3)
        t = np.linalg.lstsq(np.vstack([A * w[:, None], 1e-9 * np.eye(n)]), np.concatenate([b * w, np.zeros(n)]))[0]
    return np.asarray(t)


@compiled
def outside_reach(reach: Array, target: Array, tolerance_p: float, tolerance_r: float) -> float:
    """Return the distance of the tool's point from the base's if no pose within the tolerance is in reach, else −1.

    Shapes and units: reach (8,) [m], target (4, 4) [1, m], tolerance_p [m], tolerance_r [rad]. Returns [m].
    """
    square, lever = 0.0, 0.0
    for i in range(3):
        v = target[i, 3] - reach[i]
        for j in range(3):
            v += target[i, j] * reach[3 + j]
        square += v * v
        lever += reach[3 + i] * reach[3 + i]
    d = sqrt(square)
    # largest distance of the tool's point from the target's point within the tolerances
    slack = tolerance_p + min(tolerance_r, 2.0) * sqrt(lever) + REACH_ROUNDING
    return d if d > reach[7] + slack or d < reach[6] - slack else -1.0
