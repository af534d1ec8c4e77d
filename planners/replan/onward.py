"""Motions from a moving state to the end of the path, also within limits that the state exceeds."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from optik.errors import NoSolution
from planners.following.joint_path import JointPath
from planners.motion.fit import fit_to_limits, match_start, stretch_factor
from planners.planning.request import PlanRequest
from planners.planning.result import Plan
from planners.replan.request import certify_motion, explain_infeasible, run_law
from planners.replan.state import ENDED, MovingState, path_state, s_at
from planners.replan.stop import DELAYS, LIMIT_FRACTIONS, compute_limit_scales
from planners.timing.base import PathState, refit
from planners.timing.brake import Brake, RunningMotion
from planners.timing.smooth import QUINTIC
from planners.trajectory import Trajectory, cut_after, cut_before, join

WIDENED = (1.001, 1.003, 1.01)
"""Factors on the limits with which a law is tried from rest; its motion can be slowed as a whole afterwards."""
CLOCK_SLOWER = 1.0 + 1e-9
"""Factor by which a motion is slowed more than lower limits require, because of rounding."""


def plan_onward(request: PlanRequest, start: MovingState) -> Plan:
    """Return the certified motion that ends first; or else one that respects lower limits only later."""
    touching: Plan | None = None
    for motion in _propose_motions(request, start):
        found = certify_motion(request, start, motion)
        if found:
            return found
        if found.certificate.clearance is not None and found.certificate.clearance.touches:
            touching = found if touching is None else touching  # without success it is false
    if start.still and (slowed := _slow_down(request, start)) is not None:
        return slowed
    if start.rest is not None and (later := _meet_limits_later(request, start)) is not None:
        return later
    if touching is not None:
        return touching
    return request.infeasible(start.plan.joint_path, explain_infeasible(request, start, False))


def _propose_motions(request: PlanRequest, start: MovingState) -> Iterator[Trajectory]:
    """Return candidates in the order in which they come to rest: the law's motion and the remaining running motion."""
    plan, joints = start.plan, start.plan.joint_path
    rests = joints.end if plan.span is None else plan.span[1]
    free = "jerk" not in request.enforced  # then a motion with limited jerk is not faster
    if free and rests >= joints.end and start.rest is not None:
        yield start.rest
    found = [run_law(request, joints, request.limits, start.at)]
    found += [start.rest] if rests >= joints.end and not free else []
    yield from sorted((motion for motion in found if motion is not None), key=lambda motion: motion.duration)
    # The running motion stops before the path's end; the law continues there.
    if rests < joints.end and start.rest is not None:
        end, still = start.rest.end, np.zeros(joints.robot.n)
        at = PathState(rests, 0.0, 0.0, (start.rest(end), still, still))
        second = run_law(request, joints, request.limits, at)
        if second is not None:
            yield join(start.rest, second)


def _meet_limits_later(request: PlanRequest, start: MovingState) -> Plan | None:
    """Return a motion that slows down within the plan's own limits until it can respect the new ones, at the latest at rest."""
    plan, rest, limits = start.plan, start.rest, start.plan_limits
    running = plan.trajectory
    old = replace(request, limits=limits)
    if rest is None or start.rest_analysis is None or request.limits == limits or request.limits.names != limits.names:
        return None
    if plan.span is not None and plan.span[1] < plan.joint_path.end:
        return None
    slower = stretch_factor(start.rest_analysis, request.limits, request.enforced)
    if not np.isfinite(slower):
        return None
    rate = start.clock[0]
    brake = Brake(RunningMotion(plan.robot, running), limits, compute_limit_scales(old, plan))
    usual = brake.stop_time(start.t, start.clock)
    for delay, fraction in itertools.product((0.0, *(usual * np.array(DELAYS))), LIMIT_FRACTIONS[:2]):
        t, clock = start.t + delay * rate, start.clock if delay == 0.0 else (rate, 0.0)
        if slower <= 1.0 or t >= running.end:
            break
        goal = rate / (slower * CLOCK_SLOWER)
        braking = brake.run(t, clock, fraction, goal)
        if braking.motion is None or braking.end >= running.end - ENDED:
            continue
        s = s_at(plan, braking.end)
        slow = cut_before(running, braking.end, s).slowed(1.0 / goal)
        first = match_start(braking.motion, start.joints, limits) if delay == 0.0 else braking.motion
        first = join(cut_after(rest, delay), first) if delay else first
        found = _continue_slowly(request, start, first, s, slow)
        if found is not None:
            return found
    found = certify_motion(replace(request, before=(limits, rest.end)), start, rest)
    return found or None


def _continue_slowly(
    request: PlanRequest, start: MovingState, first: Trajectory, s: float, slow: Trajectory
) -> Plan | None:
    """Return the plan of a motion that has braked and continues by the law, or by the slowed running motion."""
    later = replace(request, before=(start.plan_limits, first.end))
    joints = start.plan.joint_path
    at = path_state(joints, s, (slow(0.0), slow(0.0, 1), slow(0.0, 2)))
    quick = run_law(request, joints, request.limits, at)
    for second in (quick, slow):
        if second is not None and second.duration <= slow.duration:
            found = certify_motion(later, start, join(first, second))
            if found:
                return found
    return None


def _slow_down(request: PlanRequest, start: MovingState) -> Plan | None:
    """Return a motion from rest, slowed as a whole until it respects the limits: the law's, or else a quintic in s."""
    enforced = request.enforced
    for found in _start_from_rest(request, start.plan.joint_path, start.at):
        try:
            slower = fit_to_limits(request.robot, found, request.limits, enforced, request.path)
        except NoSolution:
            continue
        solved = certify_motion(request, start, match_start(slower, start.joints, request.limits))
        if solved:
            return solved
    return None


def _start_from_rest(request: PlanRequest, joints: JointPath, at: PathState) -> Iterator[Trajectory]:
    """Return motions to the path's end that may exceed the limits: the law's with wider limits, and a quintic in s."""
    for factor in WIDENED:
        found = run_law(request, joints, request.limits.scale(factor), at)
        if found is not None:
            yield found
            break
    if at.s < joints.end:
        c = (joints.end - at.s) * QUINTIC
        c[-1] = at.s
        yield refit(joints, scipy.interpolate.PPoly(c[:, None], np.array([0.0, 1.0]), extrapolate=True))
