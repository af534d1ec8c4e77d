"""Straight line in joint space: all joints move at constant rates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import newton, se3
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import solve_ik
from optik.ik.problem import check_start
from optik.types import Array
from planners.paths.base import Path, check_arm, check_recorded, check_robot, fields
from planners.paths.joint_curve import bound_tool_derivatives, tool_twists
from planners.trajectory.curve import Curve

BOUND_SAMPLES = 32
"""Least number of samples for the bounds on derivatives, and their number in a radian or metre. Between samples a bound grows
by half their distance times the bound of the next derivative."""


class _Joints(Curve):
    """q(s) = q_start + s q'."""

    parameter = "s"

    def __init__(self, q: Array, rate: Array, end: float) -> None:
        self.q, self.rate, self._end = q, rate, end

    @property
    def end(self) -> float:
        return self._end

    def _evaluate(self, x: Array, order: int) -> Array:
        if order == 0:
            return self.q + x[:, None] * self.rate
        return np.tile(self.rate if order == 1 else np.zeros_like(self.rate), (x.size, 1))


class JointLine(Path):
    """Straight line between configurations; s is its length in joint space [rad; m if only sliding joints move].

    q(s) = q_start + s q' with a constant q' of length 1, in which a radian counts as much as a metre; `configurations`
    gives it. Poses and twists are exact, by forward kinematics. Equal configurations make a path of length 0, which no
    motion follows.

    Parameters
    ----------
    robot : Robot
        The arm.
    q_start, q_goal : (n,) array
        Configurations inside the limits [rad, m]; all configurations between them are inside too.

    Raises
    ------
    InvalidInput
        An invalid arm, wrong lengths, NaN, a configuration outside the limits.
    """

    name: ClassVar[str] = "joint_line"
    in_joints = True

    def __init__(self, robot: Robot, q_start: ArrayLike, q_goal: ArrayLike) -> None:
        check_robot(robot)
        self.robot = robot
        self.q_start = check_start(robot, q_start, "q_start").copy()
        self.q_goal = check_start(robot, q_goal, "q_goal").copy()
        move = self.q_goal - self.q_start
        end = float(np.linalg.norm(move))
        self.unit = "m" if end and not move[~robot.prismatic].any() else "rad"
        self._joints = _Joints(self.q_start, move / end if end else np.zeros(robot.n), end)

    @classmethod
    def to_pose(cls, robot: Robot, q_start: ArrayLike, pose: ArrayLike, *, solver: str = "lm", **options: Any) -> Self:
        """Return the line from a configuration to one that reaches a pose, found by an IK method from the start.

        Parameters
        ----------
        robot : Robot
            The arm.
        q_start : (n,) array
            Configuration inside the limits [rad, m].
        pose : (4, 4) array
            T_base_tool at the goal [m].
        solver : str
            A name from `optik.ik.solvers`.
        **options
            Options of that method.

        Returns
        -------
        JointLine
            The path.

        Raises
        ------
        NoSolution
            The method found no configuration; the error has its status and its pose error.
        InvalidInput
            An invalid argument.
        UnknownName
            No such method.
        """
        check_robot(robot)
        q = check_start(robot, q_start, "q_start")
        target = se3.nearest_pose(se3.check_pose(pose, "pose"))
        result = solve_ik(robot, target, q, solver, **options)
        if not result:
            away = f"{1e3 * result.position_error:.3g} mm and {np.degrees(result.rotation_error):.3g}° away"
            reason = f"{solver} found no configuration for the pose ({result.status}: {away})"
            raise NoSolution(reason, advice="another pose, or a q_start nearer to it")
        exact = np.ascontiguousarray(result.q[None]).copy()
        newton.polish_batch(robot.chain, exact, target[None], 6)
        # at a singular configuration, rounding in the last Newton step may move the joints far
        near = np.abs(exact[0] - result.q).max() <= 1e-3 and bool(robot.limits.contains(exact[0]))
        return cls(robot, q, robot.limits.clip(exact[0]) if near else result.q)

    @property
    def end(self) -> float:
        """Length in joint space [rad, or m]."""
        return self._joints.end

    def configurations(self, robot: Robot, s: ArrayLike, order: int = 0) -> Array:
        """Return configurations at s, or their derivatives: q' is constant."""
        check_arm(robot, self.robot)
        return self._joints(s, order)

    def _evaluate(self, x: Array, order: int) -> Array:
        robot, q, rate = self.robot, self._joints(x), self._joints.rate
        if order == 0:
            return robot.fk(q)
        if order == 1:
            return np.asarray(robot.jacobian(q) @ rate)
        return tool_twists(robot, self._joint_derivatives(q))[:, order - 1]

    def _joint_derivatives(self, q: Array) -> Array:
        """Return configurations (k, n) of the path with their first three derivatives (k, 4, n)."""
        joints = np.zeros((len(q), 4, self.robot.n))
        joints[:, 0], joints[:, 1] = q, self._joints.rate
        return joints

    def derivative_bounds(self) -> Array:
        """Return bounds (2, 4) on the derivatives of position and rotation."""
        return self._bounds.copy()

    def joint_bounds(self) -> Array:
        """Return bounds (1, 4, n) on the derivatives of the joints: q' is constant."""
        bounds = np.zeros((1, 4, self.robot.n))
        bounds[0, 0] = np.abs(self._joints.rate)
        return bounds

    @cached_property
    def _bounds(self) -> Array:
        cells = int(np.clip(np.ceil(BOUND_SAMPLES * self.end), BOUND_SAMPLES, 64 * BOUND_SAMPLES))
        joints = self._joint_derivatives(self._joints(np.linspace(0.0, self.end, cells + 1)))
        most = np.zeros((1, 5, self.robot.n))
        most[0, 0], most[0, 1] = np.abs([self.q_start, self.q_goal]).max(axis=0), np.abs(self._joints.rate)
        return np.asarray(
            bound_tool_derivatives(self.robot, most, np.array([self.end]), tool_twists(self.robot, joints))[0]
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files, with the name and fingerprint of the arm."""
        return {
            "path": self.name, "robot": self.robot.name, "fingerprint": self.robot.fingerprint,
            "q_start": self.q_start.tolist(), "q_goal": self.q_goal.tolist(),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote, for the arm that it belongs to."""
        name, fingerprint, start, goal = fields(data, cls.name, "robot", "fingerprint", "q_start", "q_goal")
        return cls(check_recorded(robot, name, fingerprint), start, goal)


METHOD = JointLine
