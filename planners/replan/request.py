"""The plan request of a motion from a moving state, its timing and certification, and the reasons why there is none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from optik.errors import InvalidInput, NoSolution
from optik.ik.base import Tolerance
from optik.scene import Scene
from optik.scene.contact import check_scene
from planners.certificate.violation import word_of_limit
from planners.following.joint_path import JointPath
from planners.limits import DERIVATIVES, TOOL_SPEEDS, MotionLimits, check_path, ratio_to_limit, tool_limits_at
from planners.motion.fit import check_statics, match_start
from planners.planning.request import PlanRequest
from planners.planning.result import Plan
from planners.replan.state import MovingState
from planners.timing import LawLike, TimeLaw, laws, make_law
from planners.timing.base import QUIET, PathState, StopKind, check_motion
from planners.timing.optimal import Optimal
from planners.trajectory import Trajectory

SPEED_MARGIN = 1e-6
"""Fraction by which a motion may exceed a requested constant tool speed [1], for rounding of a motion at that speed."""


class RecordedLaw(TimeLaw):
    """A record of the law of a plan, or of `optimal` in its place: its name, its speed, and the limits that it enforces."""

    enforced = ()

    def __init__(self, name: str, speed: float | None, enforced: tuple[str, ...]) -> None:
        self.name, self.speed, self._enforced = name, speed, enforced  # type: ignore[misc]

    def list_enforced(self, limits: MotionLimits) -> tuple[str, ...]:
        """Return the limits that the plan's certificate enforces."""
        return tuple(name for name in self._enforced if name in limits.names)

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        raise NoSolution(f"{self.name} starts from rest only")


def build_request(
    plan: Plan,
    timing: LawLike | None,
    limits: MotionLimits | None,
    options: tuple[Tolerance, float, Scene | None],
) -> PlanRequest:
    """Build the request: construct a law given by name, and check that it can enforce these limits."""
    tolerance, rate, scene = options
    scene = plan.scene if scene is None else scene
    check_scene(plan.robot, scene)
    law = make_law(timing) if timing is not None else _own_law(plan)
    allow: tuple[str, ...] = ()
    limits, enforced = plan.limits if limits is None else limits, plan.certificate.enforced
    if not isinstance(limits, MotionLimits):
        raise InvalidInput("limits", repr(limits)[:60], "a MotionLimits")
    if timing is None:  # limits that the plan was allowed to exceed
        limits = keep_speed(plan, limits)
        allow = tuple({word_of_limit(name) for name in plan.limits.given_names if name not in enforced})
    if timing is not None:
        law.need(limits, plan.robot)
    check_path(limits, plan.path)
    return PlanRequest(plan.robot, plan.path, limits, plan.solver, law, tolerance, rate, scene=scene, allow=allow)


def _own_law(plan: Plan) -> TimeLaw:
    """Return the plan's own law if it can start from a moving state; else a record that enforces the same limits."""
    name = plan.law.partition(QUIET)[0]  # from a moving state nothing is averaged
    if name in laws() and plan.speed is None:
        law = make_law(name)
        known = set(law.list_enforced(plan.limits)) <= set(plan.certificate.enforced)
        if known and type(law).run_from is not TimeLaw.run_from:
            return law
    kept = () if plan.speed is None else TOOL_SPEEDS
    return RecordedLaw(plan.law, plan.speed, tuple(dict.fromkeys((*plan.certificate.enforced, *kept))))


def keep_speed(plan: Plan, limits: MotionLimits) -> MotionLimits:
    """Return limits with the constant speed of a plan's law as a limit on the tool's speed, or on its rotation."""
    if plan.speed is None:
        return limits
    name = TOOL_SPEEDS[int(plan.certificate.tool_speed.value <= 0.5 * plan.speed)]
    most = max(plan.speed * (1.0 + SPEED_MARGIN), float(plan.certificate.extreme(name).value))
    bound: Any = {name: most if limits.value(name) is None else np.minimum(limits.value(name), most)}
    return replace(limits, **bound)


def certify_motion(
    request: PlanRequest, start: MovingState, motion: Trajectory, kind: StopKind | None = None, end: float | None = None
) -> Plan:
    """Return the plan of a certified motion, with the part of the path that it covers."""
    plan, analysis = start.plan, start.rest_analysis if motion is start.rest else None
    last = plan.joint_path.end if plan.span is None else plan.span[1]
    end = (last if kind is StopKind.END else plan.joint_path.end) if end is None else end
    if isinstance(request.law, RecordedLaw) and motion is not start.rest:
        request = replace(request, law=RecordedLaw(Optimal.name, None, request.law.list_enforced(request.limits)))
    covering = replace(request, span=(start.at.s, max(start.at.s, end)), stop_kind=kind)
    return covering.certify_motion(plan.joint_path, motion, analysis=analysis)


def run_law(request: PlanRequest, joints: JointPath, limits: MotionLimits, at: PathState) -> Trajectory | None:
    """Return the law's motion from exactly this state; None if the law finds none. `optimal` replaces a recorded law."""
    law = Optimal() if isinstance(request.law, RecordedLaw) else request.law
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


def explain_infeasible(request: PlanRequest, start: MovingState, stop: bool) -> NoSolution:
    """Return why there is no motion: the state itself exceeds a limit, or the running motion does later."""
    plan, limits, robot = start.plan, request.limits, start.plan.robot
    try:
        check_statics(plan.joint_path, request.limits, request.enforced, start.at.s)
    except NoSolution as error:
        if not stop:
            return error
    goal = "comes to rest" if stop else "ends at rest"
    none = f"no motion from this state {goal} on the path within the limits"
    assert start.at.joints is not None
    _, dq, ddq = start.at.joints
    bound = limits.bounds(robot.n)
    twist = robot.jacobian(start.at.joints[0]) @ dq
    here = [(f, ratio_to_limit(x, bound[f]), robot.joint_names) for f, x in zip(DERIVATIVES, (dq, ddq), strict=False)]
    allowed = tool_limits_at(limits, plan.path, np.array([start.at.s]))[0]
    speeds = (float(np.linalg.norm(part)) / limit for part, limit in zip((twist[:3], twist[3:]), allowed, strict=True))
    here += [(f, np.array([x]), ("tool",)) for f, x in zip(TOOL_SPEEDS, speeds, strict=True)]
    field, ratios, names = max(here, key=lambda each: float(each[1].max()))
    ratio, joint = float(ratios.max()), names[int(ratios.argmax())]
    advice = "higher limits" if stop else "stop=True, or higher limits"
    if ratio > 1.0 + 1e-9:
        what = f"the state itself has {ratio:.6g} times the allowed {field.replace('_', ' ')} of {joint}"
        what += _name_both(start, limits, field, joint)
        return NoSolution(f"{none}: {what}", s=start.at.s, joint=joint, advice=f"limits {ratio:.6g} times as high")
    if start.rest is None:
        return NoSolution(f"{none} was found", s=start.at.s, advice=advice)
    proof = certify_motion(request, start, start.rest, StopKind.END).certificate
    if not proof.enforced:
        return NoSolution(f"{none} was found: {'; '.join(proof.reasons)}", s=start.at.s, advice=advice)
    field = max(proof.enforced, key=lambda f: float(np.nan_to_num(proof.worst(f)[0], posinf=np.inf)))
    ratio, joint, t = proof.worst(field)
    s = proof.s_at(t)
    what = f"the running motion reaches {ratio:.6g} times the {field.replace('_', ' ')} limit of {joint} at s = {s:.6g}"
    what += _name_both(start, limits, field, joint)
    return NoSolution(f"{none} was found; {what}", s=s, joint=joint, advice=advice)


def _name_both(start: MovingState, limits: MotionLimits, field: str, joint: str) -> str:
    """Return a text with the requested limit of a joint and that of the plan, if the limits differ."""
    robot = start.plan.robot
    if field not in DERIVATIVES or start.plan_limits == limits:
        return ""
    i = robot.joint_names.index(joint)
    low, high = (x.arrays(robot.n)[field][i] for x in (limits, start.plan_limits))
    unit = next(kind.units[int(robot.prismatic[i])] for kind in limits.kinds if kind.name == field)
    return f" (limit {low:.6g} {unit}; in the plan {high:.6g} {unit})"
