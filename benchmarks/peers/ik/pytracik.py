"""TRAC-IK through pytracik: two solvers run concurrently, one with random restarts (Beeson and Ames 2015)."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Solutions, SolverPeer, need_revolute, none, one
from benchmarks.peers.models import urdf
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.types import Array

TRACIK_SECONDS = 0.1
"""Time limit of a call [s], long enough for its restarts also on a busy machine, where 0.02 ended 4 % of the calls."""
TRACIK_TOLERANCE = 1e-7
"""Tolerance of TRAC-IK: its default of 1e-5 is above the 1e-6 m and rad that every method must reach."""


class PyTracIK(SolverPeer):
    """``pytracik.ik(solver, q0, x, y, z, quaternion)`` in Speed mode."""

    distribution = "pytracik"
    package = "pytracik"
    clocked = True
    random = True
    settings = (
        "URDF of the arm with its limits, rounded inwards to single precision, in which the package keeps them: else answers "
        f"at a limit are 5e-9 rad outside; Speed mode, eps {TRACIK_TOLERANCE:g} (its default, 1e-5, does not reach 1e-6), "
        f"at most {1e3 * TRACIK_SECONDS:g} ms; runs two threads of its own; the timed call includes the conversion of the "
        "matrix to a quaternion"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        import pytracik

        need_revolute(robot, 1, 9)
        self.robot = robot
        solver = pytracik.TRAC_IK(
            "link0",
            "tool",
            urdf(robot, _single(robot.limits)),
            TRACIK_SECONDS,
            TRACIK_TOLERANCE,
            pytracik.SolveType.Speed,
        )
        self.module: Any = pytracik
        self.solver: Any = solver
        ik = pytracik.ik

        def call(target: Array, q0: Array) -> Any:
            x, y, z, w = _quaternion(target.tolist())
            return ik(solver, q0, target[0, 3], target[1, 3], target[2, 3], x, y, z, w)

        self.call = call

    def read(self, raw: Any) -> Solutions:
        """Return the configuration after the return code; none if the code is negative."""
        values = np.asarray(raw, dtype=np.float64).ravel()
        claimed = bool(values.size) and float(values[0]) >= 0.0
        q = one(values[-self.robot.n :]) if claimed and values.size > self.robot.n else none(self.robot)
        return Solutions(q, claimed)

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the KDL chain that TRAC-IK read from the URDF."""
        return np.asarray(self.module.fk(self.solver, q)).reshape(4, 4)


def _single(limits: JointLimits) -> JointLimits:
    """Return the limits in single precision, which the package uses, just inside the given ones."""
    lower, upper = limits.lower.astype(np.float32), limits.upper.astype(np.float32)
    lower = np.where(lower < limits.lower, np.nextafter(lower, np.float32(np.inf)), lower)
    upper = np.where(upper > limits.upper, np.nextafter(upper, np.float32(-np.inf)), upper)
    return JointLimits(lower.astype(np.float64), upper.astype(np.float64))


def _quaternion(T: list[list[float]]) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of the rotation in T, from its largest component (Shepperd 1978)."""
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
