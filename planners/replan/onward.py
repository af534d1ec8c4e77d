"""On to the path's end from a moving state, also within limits that the state exceeds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from optik.errors import NoSolution
from planners.fit import fitted, stretch
from planners.following.joint_path import JointPath
from planners.plan import Asked, Plan
from planners.replan.reason import reason
from planners.replan.request import Enforced, by_law, judged, mover
from planners.replan.state import ENDED, MovingState, path_state, s_at
from planners.replan.stop import SHARES, scales_of
from planners.splice import begun, joined, rest_of
from planners.timing._brake import Braking, brake
from planners.timing.base import PathState, refit
from planners.timing.smooth import QUINTIC
from planners.trajectory import Trajectory

WIDENED = (1.001, 1.003, 1.01)
"""Factors on the limits within which a law is tried from rest, where a motion can be slowed as a whole afterwards."""
SLOWER = 1.0 + 1e-9
"""By how much slower than needed the clock of a motion runs that is to meet lower limits: rounding."""


def onward_plan(asked: Asked, plan: Plan, start: MovingState) -> Plan:
    """The motion that is first at the path's end and certified; else one that meets lower limits later."""
    touching: Plan | None = None
    for motion in _motions(asked, plan, start):
        found = judged(asked, plan, start, motion, None)
        if found:
            return found
        if found.certificate.clearance is not None and found.certificate.clearance.touches:
            touching = touching or found
    if start.still and (slowed := _slowed(asked, plan, start)) is not None:
        return slowed
    if start.rest is not None and (later := _later(asked, plan, start)) is not None:
        return later
    return touching or asked.infeasible(plan.joint_path, reason(asked, plan, start, False))


def _motions(asked: Asked, plan: Plan, start: MovingState) -> Iterator[Trajectory]:
    """Candidates from the state, the one that is first at rest first: the law's motion and the rest of the running one."""
    joints = plan.joint_path
    rests = joints.end if plan.span is None else plan.span[1]
    own = isinstance(asked.law, Enforced)
    if own and rests >= joints.end and start.rest is not None:
        yield start.rest
    law = mover(asked)
    found = [by_law(law, asked, joints, asked.limits, start.at)]
    found += [start.rest] if rests >= joints.end and not own else []
    yield from sorted((motion for motion in found if motion is not None), key=lambda motion: motion.duration)
    if (
        rests < joints.end and start.rest is not None
    ):  # the running motion stops before the path's end; the law continues there
        end, still = start.rest.end, np.zeros(joints.robot.n)
        second = by_law(law, asked, joints, asked.limits, PathState(rests, 0.0, 0.0, (start.rest(end), still, still)))
        if second is not None:
            yield joined(start.rest, second)


def _later(asked: Asked, plan: Plan, start: MovingState) -> Plan | None:
    """A motion that slows down under the plan's own limits until it can respect the new ones, and then does."""
    running, rest, old = plan.trajectory, start.rest, replace(asked, limits=plan.limits)
    assert rest is not None
    if asked.limits == plan.limits or (plan.span is not None and plan.span[1] < plan.joint_path.end):
        return None
    try:
        slower = stretch(plan.robot, rest, asked.limits, asked.law.promises(asked.limits), plan.path)
    except NoSolution:
        return None
    for share in SHARES:
        if not np.isfinite(slower) or slower <= 1.0:
            return None
        goal = 1.0 / (slower * SLOWER)
        braking = brake(plan.robot, running, plan.limits, start.t, start.clock, scales_of(old, plan), share, goal)
        if braking is None or braking.end >= running.end - ENDED:
            continue
        s = s_at(plan, braking.end)
        slow = rest_of(running, braking.end, s).slowed(slower * SLOWER)
        found = _from_slow(asked, plan, start, braking, s, slow)
        if found is not None:
            return found
    return None


def _from_slow(
    asked: Asked, plan: Plan, start: MovingState, braking: Braking, s: float, slow: Trajectory
) -> Plan | None:
    """The plan of a motion that has braked: on by the law, or by the running motion run slower."""
    first = begun(braking.motion, start.joints, plan.limits)
    later = replace(asked, before=(plan.limits, first.end))
    at = path_state(plan.joint_path, s, tuple(slow(0.0, order) for order in range(3)))  # type: ignore[arg-type]
    law = mover(asked)
    quick = by_law(law, asked, plan.joint_path, asked.limits, at) if law.keeps else None
    for second in (quick, slow):
        if second is not None and second.duration <= slow.duration:
            found = judged(later, plan, start, joined(first, second), None)
            if found:
                return found
    return None


def _slowed(asked: Asked, plan: Plan, start: MovingState) -> Plan | None:
    """A motion from a state at rest, slowed as a whole until it respects the limits: the law's, or else a quintic in s."""
    enforced = asked.law.promises(asked.limits)
    for found in _from_rest(asked, plan.joint_path, start.at):
        try:
            slower = fitted(asked.robot, found, asked.limits, enforced, asked.path)
        except NoSolution:
            continue
        solved = judged(asked, plan, start, begun(slower, start.joints, asked.limits), None)
        if solved:
            return solved
    return None


def _from_rest(asked: Asked, joints: JointPath, at: PathState) -> Iterator[Trajectory]:
    """Motions to the path's end that may exceed the limits: the law's within wider ones, and a quintic in s."""
    law = mover(asked)
    for factor in WIDENED:
        found = by_law(law, asked, joints, asked.limits.scaled(factor), at)
        if found is not None:
            yield found
            break
    if at.s < joints.end:
        c = (joints.end - at.s) * QUINTIC
        c[-1] = at.s
        yield refit(joints, PPoly(c[:, None], np.array([0.0, 1.0]), extrapolate=True))
