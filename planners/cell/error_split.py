"""The tool's error as the sum of the errors of laser, inverse kinematics, path and servo."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.ik import IKSolver
from optik.types import Array
from planners.cell.drives.base import Execution


class ErrorSplit(NamedTuple):
    """Executed tool minus true spot, e = e_laser + e_ik + e_path + e_servo, at one or several instants, in the base frame.

    Attributes
    ----------
    laser : (3,) or (k, 3) array
        Target minus true spot: noise and calibration of the laser unit [m].
    ik : (3,) or (k, 3) array
        Tool at the IK method's own answer, before Newton polishing, minus target [m].
    path : (3,) or (k, 3) array
        Tool at the planned configuration minus tool at the IK method's answer [m].
    servo : (3,) or (k, 3) array
        Tool at the executed configuration minus tool at the planned one [m].
    total : (3,) or (k, 3) array
        Executed tool minus true spot [m]: the sum, to rounding.
    """

    laser: Array
    ik: Array
    path: Array
    servo: Array
    total: Array

    @property
    def norms(self) -> dict[str, Array]:
        """Lengths of the five vectors by name [m]."""
        return {name: np.linalg.norm(part, axis=-1) for name, part in self._asdict().items()}

    def at(self, k: int) -> Self:
        """Return the split at one instant.

        Parameters
        ----------
        k : int
            Number of the instant.

        Returns
        -------
        ErrorSplit
            Its vectors (3,) [m].
        """
        return type(self)(*(part[k] for part in self))

    def to_dict(self) -> dict[str, list[float]]:
        """Return the vectors by name as plain data [m]."""
        return {name: part.tolist() for name, part in self._asdict().items()}


class PathSplit(NamedTuple):
    """The error split along the path: instants t (k,) [s], path parameters s (k,) [m, or rad], and vectors (k, 3)."""

    t: Array
    s: Array
    error: ErrorSplit


def split_errors(
    spot: ArrayLike, target: ArrayLike, answer: ArrayLike, planned: ArrayLike, executed: ArrayLike
) -> ErrorSplit:
    """Split the tool's error by points, at one or several instants.

    Parameters
    ----------
    spot : (3,) or (k, 3) array
        The true spot, or the point of the line to it at each instant [m].
    target : (3,) or (k, 3) array
        The spot by the laser unit [m].
    answer : (3,) or (k, 3) array
        Tool at the configuration that the IK method returned [m].
    planned : (3,) or (k, 3) array
        Tool at the planned configuration [m].
    executed : (3,) or (k, 3) array
        Tool at the true configuration of the arm [m].

    Returns
    -------
    ErrorSplit
        Its parts, in the shape to which the points broadcast.

    Raises
    ------
    InvalidInput
        No points, or NaN or infinity in them.
    """
    given = {"spot": spot, "target": target, "answer": answer, "planned": planned, "executed": executed}
    points = [_check_points(value, name) for name, value in given.items()]
    try:
        a, b, c, d, e = np.broadcast_arrays(*points)
    except ValueError:
        got = ", ".join(f"{name} {p.shape}" for name, p in zip(given, points, strict=True))
        raise InvalidInput(
            "spot, target, answer, planned, executed", f"shapes {got}", "shapes that broadcast"
        ) from None
    return ErrorSplit(b - a, c - b, d - c, e - d, e - a)


def split_configurations(
    robot: Robot, spot: ArrayLike, target: ArrayLike, answer: ArrayLike, planned: ArrayLike, executed: ArrayLike
) -> ErrorSplit:
    """Split the tool's error by configurations: `split_errors` of the tool's positions at them.

    Parameters
    ----------
    robot : Robot
        The arm.
    spot, target : (3,) or (k, 3) array
        The true spot, and the spot by the laser unit [m].
    answer, planned, executed : (n,) or (k, n) array
        The IK method's own answer, the planned and the executed configuration [rad, m].

    Returns
    -------
    ErrorSplit
        Its parts.

    Raises
    ------
    InvalidInput
        Wrong shapes, NaN or infinity.
    """
    tools = (robot.fk(q)[..., :3, 3] for q in (answer, planned, executed))
    return split_errors(spot, target, *tools)


def _check_points(value: ArrayLike, name: str) -> Array:
    """Return checked points as an array."""
    points = real_array(value, name, "a point (3,) or points (k, 3)")
    if points.ndim not in (1, 2) or points.shape[-1] != 3:
        raise InvalidInput(name, f"shape {points.shape}", "a point (3,) or points (k, 3)")
    if not np.isfinite(points).all():
        raise InvalidInput(name, "NaN or infinity in it", "finite numbers")
    return points


def solve_poses(solver: IKSolver, poses: Array, q: Array) -> Array:
    """Return the answers to poses in order, each solved from the previous answer, as in the paper."""
    limits = solver.robot.limits
    answers = np.empty((len(poses), solver.robot.n))
    for k, pose in enumerate(poses):
        q = answers[k] = solver.solve(pose, np.clip(q, limits.lower, limits.upper)).q
    return answers


def split_along(execution: Execution, solver: IKSolver, true_spot: Array, samples: int) -> PathSplit:
    """Split the tool's error at the steps of the plant that are nearest to the samples of the path.

    The path parameter of each instant is that of the path point nearest to the planned tool. The desired point of the executed
    tool is at the same fraction of the line to the true spot.
    """
    robot, path, t = execution.robot, execution.plan.path, execution.t
    motion = execution.plan.trajectory if execution.motion is None else execution.motion
    proof = execution.plan.certificate
    wanted = np.interp(np.linspace(0.0, path.end, samples), proof.s, proof.t)
    chosen = np.unique(np.append(np.clip(np.searchsorted(t, wanted), 0, t.size - 1), t.size - 1))
    # without a motion of its own, the arm stood at the end of the plan already
    planned = motion(
        np.minimum(t[chosen], motion.end) if execution.motion is not None else motion.end * np.ones(chosen.size)
    )
    s = path.nearest(robot.fk(planned))
    s[-1] = path.end  # an execution ends where its motion does, and that is the end of the path
    poses = path.pose(s)
    answers = solve_poses(solver, poses, planned[0])
    off = true_spot - path.pose(path.end)[:3, 3]
    desired = poses[:, :3, 3] + (s / path.end)[:, None] * off
    split = split_configurations(robot, desired, poses[:, :3, 3], answers, planned, execution.q[chosen])
    return PathSplit(t[chosen], s, split)
