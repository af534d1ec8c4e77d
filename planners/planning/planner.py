"""The planner of one path: it follows the path, times the motion and certifies it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from optik import newton
from optik.arm.robot import Robot
from optik.check import check_kind, check_number, describe_ratio
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, SolverLike
from optik.ik.base import Tolerance
from optik.registry import label
from optik.scene import Scene
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import Allow, required_limits
from planners.following.failure import PlanFailure
from planners.following.follow import DEFAULT_TOLERANCE, START_TOLERANCE, FollowResult, FollowStatus, make_follower
from planners.following.joint_path import JointPath
from planners.following.resolve.graph import Sequence
from planners.limits import SAME_SPEED, MotionLimits
from planners.motion import PlanStatus
from planners.motion.motion import check_statics, find_stretch_factor, stretch_analysed
from planners.paths.base import Path
from planners.planning.result import Plan, PlanSeconds, judge_certificate
from planners.search.base import SearchLike
from planners.timing import LawLike, TimeLaw
from planners.timing.base import StopKind
from planners.timing.optimal import Optimal, Optimum
from planners.trajectory import Trajectory

# ---------------- the validated arguments of a plan, and the plans that can result


@dataclass(frozen=True)
class PlanOptions:
    """The arguments of `planners.plan` besides the arm, the path and the start."""

    limits: MotionLimits
    solver: SolverLike = "lm"
    timing: LawLike = "optimal"
    samples: int = 151
    branch: str | None = None
    rate: float = 1000.0
    duration: float | None = None
    strict: bool = False
    tolerance: Tolerance = DEFAULT_TOLERANCE
    allow: Allow = ()
    scene: Scene | None = None
    avoid: bool | SearchLike = False
    winding: str = "nearest"
    resolve: str = "auto"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_kind(self.limits, "limits", MotionLimits, "an object of the class MotionLimits")
        if self.duration is not None:
            check_number(self.duration, "duration", "seconds above 0", above=0.0)
        check_kind(self.strict, "strict", bool, "True or False")


@dataclass(frozen=True)
class PlanRequest:
    """The validated arguments of a plan, and the plans that can result."""

    robot: Robot
    path: Path
    limits: MotionLimits
    solver: str
    law: TimeLaw
    tolerance: Tolerance
    rate: float
    span: tuple[float, float] | None = None
    scene: Scene | None = None
    before: tuple[MotionLimits, float] | None = None
    start_error: tuple[float, float, float] | None = None
    stop_kind: StopKind | None = None
    allow: tuple[str, ...] = ()
    avoid: bool | SearchLike = False
    winding: str = "exact"
    unreachable: NoSolution | None = None

    @property
    def enforced(self) -> tuple[str, ...]:
        """The limits that the motion must respect: those that its law enforces, and given ones that ``allow`` does not name."""
        enforced = self.law.list_enforced(self.limits)
        given = tuple(name for name in self.limits.given_names if name not in enforced)
        return (*enforced, *required_limits(given, self.allow))

    def certify_motion(
        self, joints: JointPath, trajectory: Trajectory, stretch_factor: float = 1.0, analysis: MotionAnalysis | None = None,
        limit_factor: float = 1.0,
    ) -> Plan:  # fmt: skip
        """Certify the law's motion, stretched by a factor, and return its plan, which is solved if the certificate is valid."""
        started = perf_counter()
        proof = certify(
            self.robot, self.path, trajectory, self.limits, law=label(self.law), enforced=self.enforced, rate=self.rate,
            tolerance=self.tolerance, span=self.span, scene=self.scene, before=self.before, analysis=analysis,
        )  # fmt: skip
        seconds = PlanSeconds(certificate=perf_counter() - started)
        status, failure = judge_certificate(proof, self.law.list_enforced(self.limits))
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, label(self.law), joints, failure, trajectory, proof,
            stretch_factor, self.span, self.law.speed, self.scene, seconds, self.before, self.start_error, self.stop_kind,
            limit_factor=limit_factor,
        )  # fmt: skip

    def infeasible(
        self, joints: JointPath | None, error: NoSolution, status: PlanStatus = PlanStatus.TIMING_INFEASIBLE
    ) -> Plan:
        """Return the plan without a motion, for the reason of an error."""
        return self.fail(status, joints, PlanFailure.from_error(status, error))

    def fail(self, status: PlanStatus, joints: JointPath | None, failure: PlanFailure) -> Plan:
        """Return a plan without a motion; its joint path ends where following failed."""
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, label(self.law), joints, failure, None, None,
            scene=self.scene,
        )  # fmt: skip

    def refuse(self, joints: JointPath, proof: Certificate, advice: str) -> Plan:
        """Return the plan of a motion that exceeds a limit, for ``strict=True``."""
        field = max(proof.enforced, key=lambda f: np.nan_to_num(proof.worst(f)[0]))
        ratio, joint, t = proof.worst(field)
        s = proof.s_at(t)
        what = f"the {field.replace('_', ' ')} of {joint} is {describe_ratio(ratio)} at t = {t:.6g} s"
        if not ratio > 1.0:
            what = proof.reasons[0]
        failure = PlanFailure(PlanStatus.LIMITS_EXCEEDED, s, joint, f"{what}, and strict=True", advice)
        return self.fail(PlanStatus.LIMITS_EXCEEDED, joints, failure)


# ---------------- a path: follow, time, certify


PATH_FRACTION = 0.95
"""Fraction of the tolerance that the joint path may use. The law's polynomials in time use the remaining part."""
START_STEPS = 4
"""Newton steps that move a computed start onto the path."""
MOST_SECONDS = 1e9
"""Longest duration that can be requested [s], 30 years: powers of much longer ones overflow."""


@dataclass(frozen=True)
class PathPlanner:
    """Follows, times and certifies paths under one request."""

    solver: IKSolver
    request: PlanRequest
    samples: int
    strict: bool
    time_limit: float

    def follow(
        self, path: Path, q: ArrayLike | None, branch: str | None, scene: Scene | None, way: Sequence | None = None,
        time_limit: float | None = None,
    ) -> FollowResult:  # fmt: skip
        """Return the joint path along a path, by the sequence of its resolution if there is one."""
        allowed = self.request.tolerance.scale(PATH_FRACTION)
        seconds = self.time_limit if time_limit is None else time_limit
        return make_follower(self.solver, path, q, branch, self.samples, allowed, scene, seconds, way).run()

    def follow_from(self, path: Path, q: Array, scene: Scene | None, way: Sequence | None = None) -> FollowResult:
        """Return the joint path from a computed start, which is first corrected onto the path and clipped to the limits."""
        robot, pose, start = self.request.robot, path.pose(np.zeros(1)), np.array(q[None])
        newton.polish_batch(robot.chain, start, pose, START_STEPS)
        start = robot.limits.clip(start)
        if np.abs(robot.pose_errors(start, pose)).max() <= START_TOLERANCE and robot.limits.contains(start).all():
            return self.follow(path, start[0], "start", scene, way)
        why = "the chosen path has no start configuration inside the limits"
        return FollowResult(None, PlanFailure(FollowStatus.OUTSIDE_LIMITS, 0.0, None, why, ""))

    def time(
        self, path: Path, followed: FollowResult, duration: float | None, density: float = 1.0
    ) -> tuple[Plan, Optimum | None]:
        """Return the plan of a joint path that is timed and certified, or its failure; and the optimum if the law has one."""
        request = self.request if path is self.request.path else replace(self.request, path=path)
        if followed.failure is not None:
            return request.fail(PlanStatus(followed.failure.status), followed.joint_path, followed.failure), None
        assert followed.joint_path is not None
        return self.time_joints(path, followed.joint_path, duration, density)

    def time_joints(
        self, path: Path, joints: JointPath, duration: float | None, density: float = 1.0
    ) -> tuple[Plan, Optimum | None]:
        """Return the plan of a joint path along a path, and the optimum if the law has one."""
        request = self.request if path is self.request.path else replace(self.request, path=path)
        law, optimum = request.law, None
        enforced = law.list_enforced(request.limits)
        try:
            check_statics(joints, request.limits, enforced)
            if isinstance(law, Optimal):
                raw, optimum = law.run_with_optimum(joints, request.limits, density)
            else:
                raw = law.run_with_analysis(joints, request.limits)
            factor = find_stretch_factor(raw, request.limits, enforced)
            if factor > 1.0 and self.strict:
                proof = certify(request.robot, path, raw.trajectory, request.limits, enforced=enforced)
                advice = f"strict=False, which stretches the motion by {factor:.9g}; or another law"
                return request.refuse(joints, proof, advice), None
            motion = stretch_analysed(raw, request.limits, enforced) if factor > 1.0 else raw
            trajectory = motion.trajectory if duration is None else _scale_to_duration(motion.trajectory, duration, law)
        except NoSolution as error:
            return request.infeasible(joints, error), None
        stretch = trajectory.duration / raw.trajectory.duration
        analysis, limited = (motion, stretch) if duration is None else (None, 1.0)
        return request.certify_motion(joints, trajectory, stretch, analysis, limited), optimum


def _scale_to_duration(trajectory: Trajectory, duration: float, law: TimeLaw) -> Trajectory:
    """Return a motion scaled to a duration: not faster if the law enforces limits, and at its tool speed if it has one."""
    if duration > MOST_SECONDS:
        raise InvalidInput("duration", f"{duration:.3g} s", f"at most {MOST_SECONDS:g} s")
    if law.speed is not None and abs(duration / trajectory.duration - 1.0) > SAME_SPEED:
        raise NoSolution(
            f"a duration of {duration:.6g} s makes the tool speed {law.speed * trajectory.duration / duration:.6g}, and "
            f"the law's speed is {law.speed:.6g}, which takes {trajectory.duration:.9g} s",
            advice=f"omit duration, or use {law.name} without a speed, so that the speed follows from the duration",
        )
    if getattr(law, "quiet", None) and abs(duration / trajectory.duration - 1.0) > SAME_SPEED:
        raise InvalidInput("duration", f"{duration:.6g} s with the law {law.name}", "none: it moves the frequency")
    if law.enforced and duration < trajectory.duration:
        least = np.ceil(1e4 * trajectory.duration) / 1e4
        raise NoSolution(
            f"a duration of {duration:.6g} s is too short: the shortest motion of {law.name} takes {least:.4f} s",
            advice="a longer duration, or higher limits",
        )
    return trajectory.stretched(duration / trajectory.duration)
