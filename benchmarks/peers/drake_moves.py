"""Drake's KinematicTrajectoryOptimization as a peer of blocks ``[[freedom]]``: moves between two configurations."""

from __future__ import annotations

from math import factorial

import numpy as np
from scipy.interpolate import BSpline, PPoly

from benchmarks.peers.ik.drake import METHOD as DRAKE
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.types import Array
from planners.limits import DERIVATIVES, MotionLimits
from planners.paths.base import Path
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint
from planners.plan import plan
from planners.trajectory import Trajectory

TAKEN = (*DERIVATIVES, "torque")
"""Names of the limits that the programme has."""
END_POINTS = 3
"""Control points at each end that are equal: velocity and acceleration are 0 there."""


def solve_by_drake(robot: Robot, path: Path, limits: MotionLimits) -> tuple[Trajectory, float]:
    """Return Drake's motion, from the straight joint line with the duration of ours as initial guess, and its time [ms]."""
    limited = [name for name in limits.names if limits.value(name) is not None]
    if not set(limited) <= set(TAKEN) or "velocity" not in limited:
        raise NoSolution(f"it takes limits of velocity, acceleration, jerk and torque; got {', '.join(limited)}")
    if not isinstance(path, PointToPoint) or path.vias:
        raise NoSolution("it takes only moves between two configurations")
    ends = path.coefficients[[0, -1]]
    line = plan(robot, JointLine(robot, *ends), limits=limits)
    model = {
        "limits": {"position": _pair([robot.limits.lower, robot.limits.upper])}
        | {name: _pair(limits.bounds(robot.n)[name]) for name in limited},
        "joints": list(robot.joint_names), "gravity": (robot.gravity_magnitude * robot.gravity).tolist(),
    }  # fmt: skip
    if "torque" in limited:
        model["urdf"] = robot.to_urdf()
    duration = line.trajectory.duration if line else 1.0
    answer = DRAKE.start("drake_moves", model, keep=True).ask(ends.tolist(), duration)
    if not answer.raw["success"]:
        raise NoSolution(f"SNOPT ended with {answer.raw['status']}")
    points = np.array(answer.raw["points"])
    points[:END_POINTS], points[-END_POINTS:] = ends  # up to SNOPT's tolerance
    spline = BSpline(np.array(answer.raw["knots"]), points, answer.raw["degree"])
    t = np.unique(spline.t)
    c = np.stack([spline(t[:-1], nu=m) / factorial(m) for m in range(spline.k, -1, -1)])
    return Trajectory(PPoly(c, t - t[0])), answer.ns / 1e6


def _pair(bound: Array | list[Array]) -> list[list[float]]:
    """Return lower and upper bounds (2, n) as plain data, from a pair or from greatest values (n,)."""
    both = np.asarray(bound)
    lower, upper = both if both.ndim == 2 else (-both, both)
    return [lower.tolist(), upper.tolist()]
