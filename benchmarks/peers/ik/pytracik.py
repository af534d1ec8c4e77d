"""TRAC-IK by its bindings pytracik: two solvers race, one restarts at random (Beeson and Ames 2015)."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from benchmarks.peers.ik._urdf import urdf
from benchmarks.peers.ik.base import Peer, need_revolute, none, one
from optik.arm.robot import Robot
from optik.types import Array

SECONDS, CLOSE = 0.02, 1e-7


class PyTracIK(Peer):
    """``pytracik.ik(solver, q0, x, y, z, quaternion)`` in Speed mode."""

    distribution = "pytracik"
    package = "pytracik"
    settings = (
        f"URDF of the arm with its limits; Speed mode, eps {CLOSE:g} (its default, 1e-5, misses 1e-6), at most "
        f"{1e3 * SECONDS:g} ms; it races two threads of its own; the matrix becomes its quaternion inside the timed call"
    )

    def __init__(self, robot: Robot) -> None:
        import pytracik

        need_revolute(robot, 1, 9)
        self.robot = robot
        solver = pytracik.TRAC_IK("link0", "tool", urdf(robot), SECONDS, CLOSE, pytracik.SolveType.Speed)
        ik = pytracik.ik

        def call(target: Array, q0: Array) -> Any:
            x, y, z, w = _quaternion(target.tolist())
            return ik(solver, q0, target[0, 3], target[1, 3], target[2, 3], x, y, z, w)

        self.call = call

    def answers(self, raw: Any) -> Array:
        """Its one answer, after the code in front of it; none where the code is negative."""
        values = np.asarray(raw, dtype=np.float64).ravel()
        return one(values[-self.robot.n :]) if values.size > self.robot.n and values[0] >= 0 else none(self.robot)


def _quaternion(T: list[list[float]]) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) of the rotation in T, from its largest component (Shepperd 1978)."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = T
    trace = a + e + i
    if trace > max(a, e, i):
        s = 0.5 / sqrt(1.0 + trace)
        return (h - f) * s, (c - g) * s, (d - b) * s, 0.25 / s
    if a >= max(e, i):
        s = 0.5 / sqrt(1.0 + a - e - i)
        return 0.25 / s, (b + d) * s, (c + g) * s, (h - f) * s
    if e >= i:
        s = 0.5 / sqrt(1.0 + e - a - i)
        return (b + d) * s, 0.25 / s, (f + h) * s, (c - g) * s
    s = 0.5 / sqrt(1.0 + i - a - e)
    return (c + g) * s, (f + h) * s, 0.25 / s, (d - b) * s


METHOD = PyTracIK
