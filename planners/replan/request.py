"""The plan request of a motion from a moving state, and its timing and certification."""

from __future__ import annotations

import os
from dataclasses import replace

from optik.errors import InvalidInput, NoSolution
from optik.ik.base import Tolerance
from optik.scene import Scene
from optik.scene.contact import check_scene
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.violation import word_of_limit
from planners.fit import match_start
from planners.following.joint_path import JointPath
from planners.limits import MotionLimits
from planners.plan import Plan, PlanRequest
from planners.replan.state import MovingState
from planners.timing import TimeLaw, law_for, laws
from planners.timing.base import PathState, StopKind, check_motion
from planners.timing.optimal import Optimal
from planners.trajectory import Trajectory


class RecordedLaw(TimeLaw):
    """A stand-in for the law of a plan: its name, the limits that it enforces, and the requested speed."""

    enforced = ()

    def __init__(self, plan: Plan) -> None:
        self.name, self.speed, self._enforced = plan.law, plan.speed, plan.certificate.enforced  # type: ignore[misc]

    def list_enforced(self, limits: MotionLimits) -> tuple[str, ...]:
        """Return the limits that the plan's certificate enforces."""
        return tuple(name for name in self._enforced if name in limits.names)

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Refuse, because the law itself is not available."""
        raise NoSolution(f"{self.name} starts from rest only")


def build_request(
    plan: Plan,
    timing: str | os.PathLike[str] | TimeLaw | None,
    limits: MotionLimits | None,
    options: tuple[Tolerance, float, Scene | None],
) -> PlanRequest:
    """Build the request: construct a law given by name, and check that it can enforce these limits."""
    tolerance, rate, scene = options
    scene = plan.scene if scene is None else scene
    check_scene(plan.robot, scene)
    law = law_for(timing) if timing is not None else _own_law(plan)
    allow: tuple[str, ...] = ()
    limits, enforced = plan.limits if limits is None else limits, plan.certificate.enforced
    if not isinstance(limits, MotionLimits):
        raise InvalidInput("limits", repr(limits)[:60], "a MotionLimits")
    if timing is None:  # limits that the plan was allowed to exceed
        allow = tuple({word_of_limit(name) for name in plan.limits.given_names if name not in enforced})
    if timing is not None:
        law.need(limits, plan.robot)
    limits.check_path(plan.path)
    return PlanRequest(plan.robot, plan.path, limits, plan.solver, law, tolerance, rate, scene=scene, allow=allow)


def _own_law(plan: Plan) -> TimeLaw:
    """Return the plan's own law if it can start from a moving state; else a stand-in that enforces the same limits."""
    if plan.law in laws() and plan.speed is None:
        law = law_for(plan.law)
        if type(law).run_from is not TimeLaw.run_from:
            return law
    return RecordedLaw(plan)


def choose_law(request: PlanRequest) -> TimeLaw:
    """Return the law that continues from a moving state."""
    return Optimal() if isinstance(request.law, RecordedLaw) else request.law


def certify_motion(
    request: PlanRequest,
    plan: Plan,
    start: MovingState,
    motion: Trajectory,
    kind: StopKind | None,
    end: float | None = None,
    analysis: MotionAnalysis | None = None,
) -> Plan:
    """Return the plan of a certified motion, with the part of the path that it covers."""
    last = plan.joint_path.end if plan.span is None else plan.span[1]
    end = (last if kind is StopKind.END else plan.joint_path.end) if end is None else end
    covering = replace(request, span=(start.at.s, max(start.at.s, end)), stop_kind=kind)
    return covering.certify_motion(plan.joint_path, motion, analysis=analysis)


def run_law(
    law: TimeLaw, request: PlanRequest, joints: JointPath, limits: MotionLimits, at: PathState
) -> Trajectory | None:
    """Return the law's motion from exactly this state; None if the law finds none."""
    if at.s >= joints.end * (1.0 - 1e-9):  # no path left
        return None
    try:
        motion = check_motion(law, law.run_from(joints, limits, at), request.robot)
    except (NoSolution, InvalidInput) as error:
        if isinstance(error, InvalidInput) and law is request.law:
            raise
        return None
    assert at.joints is not None
    return match_start(motion, at.joints, limits)
