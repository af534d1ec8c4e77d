"""Reasons why there is no motion from a moving state."""

from __future__ import annotations

import numpy as np

from optik.errors import NoSolution
from planners.fit import check_statics
from planners.limits import DERIVATIVES, TOOL_SPEEDS, ratio_to_limit
from planners.plan import Plan, PlanRequest
from planners.replan.request import certify_motion
from planners.replan.state import MovingState
from planners.timing.base import StopKind


def explain_infeasible(request: PlanRequest, plan: Plan, start: MovingState, stop: bool) -> NoSolution:
    """Return why there is no motion: the state itself exceeds a limit, or the running motion does later."""
    limits, robot = request.limits, plan.robot
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
    allowed = limits.tool_at(plan.path, np.array([start.at.s]))[0]
    speeds = (float(np.linalg.norm(part)) / limit for part, limit in zip((twist[:3], twist[3:]), allowed, strict=True))
    here += [(f, np.array([x]), ("tool",)) for f, x in zip(TOOL_SPEEDS, speeds, strict=True)]
    field, ratios, names = max(here, key=lambda each: float(each[1].max()))
    ratio, joint = float(ratios.max()), names[int(ratios.argmax())]
    advice = "higher limits" if stop else "stop=True, or higher limits"
    if ratio > 1.0 + 1e-9:
        what = f"the state itself has {ratio:.6g} times the allowed {field.replace('_', ' ')} of {joint}"
        return NoSolution(f"{none}: {what}", s=start.at.s, joint=joint, advice=f"limits {ratio:.6g} times as high")
    if start.rest is None:
        return NoSolution(f"{none} was found", s=start.at.s, advice=advice)
    proof = certify_motion(request, plan, start, start.rest, StopKind.END, analysis=start.rest_analysis).certificate
    if not proof.enforced:
        return NoSolution(f"{none} was found: {'; '.join(proof.reasons)}", s=start.at.s, advice=advice)
    field = max(proof.enforced, key=lambda f: float(np.nan_to_num(proof.worst(f)[0], posinf=np.inf)))
    ratio, joint, t = proof.worst(field)
    s = float(np.interp(t, proof.binding.t, proof.binding.s))
    what = f"the running motion reaches {ratio:.6g} times the {field.replace('_', ' ')} limit of {joint} at s = {s:.6g}"
    return NoSolution(f"{none} was found; {what}", s=s, joint=joint, advice=advice)
