"""The validated arguments of a plan, and the plans that can result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik.base import Tolerance
from optik.registry import label
from optik.scene import Scene
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import required_limits, words_for
from planners.following.failure import PlanFailure
from planners.following.joint_path import JointPath
from planners.limits import MotionLimits
from planners.motion import PlanStatus
from planners.paths.base import Path
from planners.planning.result import Plan, PlanSeconds
from planners.search.base import SearchLike
from planners.timing import TimeLaw
from planners.timing.base import StopKind
from planners.trajectory import Trajectory


def judge_certificate(
    proof: Certificate, enforced: tuple[str, ...] | None = None
) -> tuple[PlanStatus, PlanFailure | None]:
    """Return the status of a plan with this certificate, and its first violation; the law enforces these limits."""
    if proof.is_valid:
        return PlanStatus.SOLVED, None
    status = PlanStatus.NOT_PROVED
    advice = "another law, or a wider tolerance; plan.trajectory and plan.certificate show where"
    if proof.clearance is not None and proof.clearance.touches:
        status = PlanStatus.CONTACT
        advice = "another start, goal or path, or a smaller margin; plan.certificate.clearance shows where"
    elif enforced is not None and replace(proof, enforced=enforced).is_valid:
        status = PlanStatus.LIMITS_EXCEEDED
        advice = f"another law, as {proof.law} does not enforce this limit; or allow={words_for(proof.violations)!r}"
    first = proof.violations[0]
    reason = f"the certificate is not valid: {'; '.join(proof.reasons)}"
    return status, PlanFailure(status, proof.s_at(first.t), first.joint, reason, advice)


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
        self, joints: JointPath, trajectory: Trajectory, slowed: float = 1.0, analysis: MotionAnalysis | None = None
    ) -> Plan:
        """Certify the law's motion, slowed by a factor, and return its plan, which is solved if the certificate is valid."""
        started = perf_counter()
        proof = certify(
            self.robot, self.path, trajectory, self.limits, law=label(self.law), enforced=self.enforced, rate=self.rate,
            tolerance=self.tolerance, span=self.span, scene=self.scene, before=self.before, analysis=analysis,
        )  # fmt: skip
        seconds = PlanSeconds(certificate=perf_counter() - started)
        status, failure = judge_certificate(proof, self.law.list_enforced(self.limits))
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, label(self.law), joints, failure, trajectory, proof,
            slowed, self.span, self.law.speed, self.scene, seconds, self.before, self.start_error, self.stop_kind,
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
        what = f"the {field.replace('_', ' ')} of {joint} is {ratio:.9g} of its limit at t = {t:.6g} s"
        if not ratio > 1.0:
            what = proof.reasons[0]
        failure = PlanFailure(PlanStatus.LIMITS_EXCEEDED, s, joint, f"{what}, and strict=True", advice)
        return self.fail(PlanStatus.LIMITS_EXCEEDED, joints, failure)
