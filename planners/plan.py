"""plan(): a path, an arm and a start become joints, then time, then a certificate, in one call."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.errors import InvalidInput, NoSolution
from optik.files import write_whole
from optik.ik import IKSolver, make_solver
from optik.registry import build_method, names
from optik.robot import Robot
from planners.certificate import Certificate, certify, plain
from planners.follow import FollowStatus, JointPath, Stop, follow
from planners.paths.base import Path
from planners.timing.base import MotionLimits, TimeLaw
from planners.trajectory import Trajectory

Array = NDArray[np.float64]


class PlanStatus(StrEnum):
    """How planning ended: as following the path did, or in timing."""

    SOLVED = FollowStatus.SOLVED
    NO_IK = FollowStatus.NO_IK
    OUTSIDE_LIMITS = FollowStatus.OUTSIDE_LIMITS
    BRANCH_JUMP = FollowStatus.BRANCH_JUMP
    SINGULAR = FollowStatus.SINGULAR
    TIMING_INFEASIBLE = "timing_infeasible"


@dataclass(frozen=True)
class Plan:
    """The result of `plan`. ``bool(plan)`` is success.

    Attributes
    ----------
    robot, path, limits
        What was planned, and within what.
    status : PlanStatus
        How it ended.
    ik : str
        The IK method.
    law : str
        The time law.
    prefix : JointPath or None
        The joint path, or on failure the good part of it.
    stop : Stop or None
        Where and why it failed: s, joint, reason, advice.
    """

    robot: Robot
    path: Path
    limits: MotionLimits
    status: PlanStatus
    ik: str
    law: str
    prefix: JointPath | None
    stop: Stop | None
    _trajectory: Trajectory | None
    _certificate: Certificate | None

    def __bool__(self) -> bool:
        return self.status is PlanStatus.SOLVED

    def _there(self) -> None:
        if self.stop is not None:
            raise NoSolution(self.stop.reason, s=self.stop.s, joint=self.stop.joint, advice=self.stop.advice)

    @property
    def joint_path(self) -> JointPath:
        """The whole joint path; raises `NoSolution` where there is none."""
        self._there()
        assert self.prefix is not None
        return self.prefix

    @property
    def trajectory(self) -> Trajectory:
        """The timed motion; raises `NoSolution` with s, joint, reason and advice where there is none."""
        self._there()
        assert self._trajectory is not None
        return self._trajectory

    @property
    def certificate(self) -> Certificate:
        """What the trajectory keeps; raises `NoSolution` where there is none."""
        self._there()
        assert self._certificate is not None
        return self._certificate

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files and programs: the trajectory at its knots, the certificate, or why there is none."""
        out: dict[str, Any] = {
            "format": "optik-plan/1",
            "robot": self.robot.name,
            "robot_fingerprint": self.robot.fingerprint,
            "status": str(self.status),
            "ik": self.ik,
            "law": self.law,
            "limits": {k: plain(v) for k, v in self.limits.arrays(self.robot.n).items()},
            "path": getattr(self.path, "to_dict", dict)(),
        }
        if self.stop is not None:
            return out | {
                "s": self.stop.s,
                "joint": self.stop.joint,
                "reason": self.stop.reason,
                "advice": self.stop.advice,
            }
        motion = self.trajectory
        t = motion.knots
        return out | {
            "duration": motion.duration,
            "joint_names": list(self.robot.joint_names),
            "knots": {"t": t.tolist(), **{k: motion(t, i).tolist() for i, k in enumerate(("q", "dq", "ddq"))}},
            "coefficients": motion.coefficients.tolist(),
            "certificate": self.certificate.to_dict(),
        }

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write `to_dict` as JSON, whole or not at all.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        write_whole(file, lambda part: part.write_text(json.dumps(self.to_dict(), allow_nan=False)))


def laws() -> tuple[str, ...]:
    """Names of all time laws."""
    return names("planners.timing")


def make_law(law: str, **options: Any) -> TimeLaw:
    """Build a time law by name.

    Raises
    ------
    UnknownName
        No such law; the nearest names are offered.
    InvalidInput
        An option that the law does not have, or out of range.
    """
    built: TimeLaw = build_method("planners.timing", law, "time law", **options)
    return built


def plan(
    robot: Robot,
    path: Path,
    q_start: ArrayLike,
    *,
    ik: str | IKSolver = "dls",
    timing: str | TimeLaw = "ruckig",
    limits: MotionLimits | None = None,
    samples: int = 151,
) -> Plan:
    """Plan the joint motion that takes the tool along a path.

    Parameters
    ----------
    robot : Robot
        The arm.
    path : Path
        Where the tool goes.
    q_start : (n,) array
        Configuration at the path's start.
    ik : str or IKSolver
        Method, by name or built.
    timing : str or TimeLaw
        Law, by name or built.
    limits : MotionLimits, optional
        The robot's own by default.
    samples : int
        Of the path, equally spaced.

    Returns
    -------
    Plan
        On failure with the reason, the place and what would work.

    Raises
    ------
    InvalidInput
        Arguments that cannot be meant, or a limit that the law needs and nobody gave.
    UnknownName
        No such method or law.
    """
    solver = make_solver(robot, ik) if isinstance(ik, str) else ik
    law = make_law(timing) if isinstance(timing, str) else timing
    limits = MotionLimits.of(robot) if limits is None else limits
    for argument, value, kind in (
        ("path", path, Path), ("ik", solver, IKSolver), ("timing", law, TimeLaw), ("limits", limits, MotionLimits),
    ):  # fmt: skip
        if not isinstance(value, kind):
            raise InvalidInput(argument, repr(value)[:60], f"a {kind.__name__}")
    if solver.robot != robot:
        raise InvalidInput("ik", f"a solver built for {solver.robot.name}", f"one built for this {robot.name}")
    law.need(limits, robot)
    followed = follow(solver, path, q_start, samples=samples)
    if followed.stop is not None:
        status = PlanStatus(followed.stop.status)
        return Plan(robot, path, limits, status, solver.name, law.name, followed.joint_path, followed.stop, None, None)
    assert followed.joint_path is not None
    return _timed(robot, path, limits, solver.name, law, followed.joint_path)


def _timed(robot: Robot, path: Path, limits: MotionLimits, ik: str, law: TimeLaw, joints: JointPath) -> Plan:
    try:
        trajectory = law.run(joints, limits)
    except NoSolution as error:
        stop = Stop(PlanStatus.TIMING_INFEASIBLE, error.s or 0.0, error.joint, error.reason, error.advice)
        return Plan(robot, path, limits, PlanStatus.TIMING_INFEASIBLE, ik, law.name, joints, stop, None, None)
    proof = certify(robot, path, trajectory, limits, law=law.name, keeps=law.keeps)
    return Plan(robot, path, limits, PlanStatus.SOLVED, ik, law.name, joints, None, trajectory, proof)
