"""Stops along the path as hard as the limits allow, and motions to its end from states that exceed the limits."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np
import scipy

from optik.errors import NoSolution
from planners.following.joint_path import JointPath
from planners.motion.motion import find_stretch_factor, match_start, stretch_to_limits
from planners.planning.planner import PlanRequest
from planners.planning.result import Plan
from planners.replan import state
from planners.replan.state import MovingState, certify_motion, run_law, s_at
from planners.timing.base import PathState, StopKind, refit
from planners.timing.brake import Brake, BrakingMotion, RunningMotion
from planners.timing.optimal import Optimal
from planners.timing.smooth import QUINTIC
from planners.trajectory import Trajectory, cut_after, cut_before, join

# ---------------- stops


LIMIT_FRACTIONS = (0.995, 0.8, 0.6)
"""Fractions of the limits for a sweep, tried in turn until one is smooth: a sweep exceeds its limits between its knots, and on
a motion of many short pieces it is shorter with more room."""
MORE_FRACTIONS = (0.99, 0.97, 0.9)
"""Fractions that are also tried if the optimum is not found in time: a larger one does not always give a shorter stop."""
DELAYS = (0.15, 0.35, 0.7, 1.2, 2.0, 3.5, 7.0)
"""Times for which the arm follows the motion if it cannot brake at once, as multiples of the time of a usual stop."""
SHORTEST = 1e-6
"""Braking distance, relative to the path length, below which only the sweep is tried: the joint path is straight there."""
FIRST_END, CLOSE_ENDS = 0.85, 0.01
"""Braking distance, relative to the sweep's, at which the optimum is tried first, and the interval that ends the search."""


def plan_stop(request: PlanRequest, start: MovingState, time_limit: float) -> Plan:
    """Return the first certified stop: of the optimum, of the sweep, or the end of the motion.

    If no stop respects lower limits, the plan's own limits hold until the arm is at rest.
    """
    first, limits = _find_stop(request, start, time_limit), start.plan_limits
    first = _stop_later(request, start, first)
    if first or request.limits == limits or request.limits.names != limits.names:
        return first
    old = _find_stop(replace(request, limits=limits), start, time_limit)
    if not old:
        return first
    later = replace(request, before=(limits, old.trajectory.end))
    assert old.span is not None
    return certify_motion(later, start, old.trajectory, old.stop_kind, old.span[1])


def _stop_later(request: PlanRequest, start: MovingState, first: Plan) -> Plan:
    """Return a stop, or the shorter one from the next instant whose stop `Plan.slowed_to` checked."""
    step, plan = start.plan.stop_step, start.plan
    t = np.inf if step is None else step * (np.floor(start.t / step + 1e-9) + 1.0)
    if step is None or start.rest is None or start.error is not None or t - start.t >= start.rest.end:
        return first
    checked = _find_stop(replace(request, start_error=None), state.build_moving_state(plan, plan.trajectory, t), 0.0)
    if not checked or (first and first.duration <= t - start.t + checked.duration):
        return first
    motion = join(cut_after(start.rest, t - start.t), checked.trajectory.without_s)
    later = certify_motion(request, start, motion, checked.stop_kind, None if checked.span is None else checked.span[1])
    return later or first


def _find_stop(request: PlanRequest, start: MovingState, time_limit: float) -> Plan:
    """Return the best stop with the limits of the request, or the failure."""
    best = next((p for p in _sweep_stops(request, start) if p), None)
    if best is not None and time_limit > 0.0:
        best = _refine_stop(request, start, best, perf_counter() + time_limit)
    if best is not None and (start.time_left is None or best.trajectory.duration <= start.time_left):
        return best
    if start.rest is not None:
        end = certify_motion(request, start, start.rest, StopKind.END)
        if end or (end.certificate.clearance is not None and end.certificate.clearance.touches):
            return end
    return best or request.infeasible(start.plan.joint_path, state.explain_infeasible(request, start, True))


def _sweep_stops(request: PlanRequest, start: MovingState) -> Iterator[Plan]:
    """Yield sweeps to rest: at once, the shortest first; then after a part of the remaining motion."""
    plan, rate = start.plan, start.clock[0]
    running = plan.trajectory
    brake = _brake(request, plan)
    brakings: list[BrakingMotion] = []
    for fraction in LIMIT_FRACTIONS:
        brakings.append(brake.run(start.t, start.clock, fraction))
        if brakings[-1].smooth or brakings[-1].end > running.end:
            break
    stops = [(braking.motion, braking.end) for braking in brakings if braking.motion is not None]
    for motion, end in sorted(stops, key=lambda stop: stop[0].end):
        matched = match_start(motion, start.joints, request.limits)
        yield certify_motion(request, start, matched, StopKind.SWEEP, s_at(plan, end))
    if brakings[-1].end > running.end:
        return
    rest = start.rest
    if rest is None:
        return
    usual = brake.stop_time(start.t, start.clock)
    for delay, fraction in itertools.product(usual * np.array(DELAYS), LIMIT_FRACTIONS[:2]):
        t = start.t + delay * rate
        if t >= running.end:
            return
        braking = brake.run(t, (rate, 0.0), fraction)
        if braking.end > running.end:
            return
        if braking.motion is not None:
            motion = join(cut_after(rest, delay), braking.motion)
            yield certify_motion(request, start, motion, StopKind.SWEEP, s_at(plan, braking.end))


def _brake(request: PlanRequest, plan: Plan) -> Brake:
    return Brake(RunningMotion(plan.robot, plan.trajectory), request.limits, compute_limit_scales(request, plan))


def compute_limit_scales(request: PlanRequest, plan: Plan) -> dict[str, float]:
    """Return the factor on each limit of a sweep: 1 if it is enforced, else the ratio that the running motion reaches."""
    scales = dict.fromkeys(request.enforced, 1.0)
    if request.limits == plan.limits:
        for name in request.limits.names:
            if name not in scales and np.isfinite(reached := plan.certificate.worst(name)[0]):
                scales[name] = max(1.0, reached)
    return scales


def _refine_stop(request: PlanRequest, start: MovingState, best: Plan, until: float) -> Plan:
    """Return the best of a stop and of as many optima near its end as the time allows."""
    law, joints = request.law if isinstance(request.law, Optimal) else Optimal(), start.plan.joint_path
    if best.span is None or best.within_limits_from or set(law.enforced) - set(request.enforced):
        return best
    way, longest = best.span[1] - start.at.s, 0.0
    if way < SHORTEST * joints.end:
        return best
    low, high, factor, shorter = 0.0, 1.0, FIRST_END, []
    while high - low > CLOSE_ENDS:
        began = perf_counter()
        if began + longest > until:
            break
        end = start.at.s + way * factor
        motion = law.run_to(joints, request.limits, start.at, end)
        if motion is not None and motion.duration < best.trajectory.duration:
            shorter.append((motion, end))
            high = factor
        else:
            low = factor
        factor = high * FIRST_END if low == 0.0 else 0.5 * (low + high)
        longest = max(longest, perf_counter() - began)
    kind, brake = StopKind.OPTIMUM, _brake(request, start.plan)
    for fraction in () if shorter else MORE_FRACTIONS:
        if perf_counter() > until:
            break
        motion, end, _ = brake.run(start.t, start.clock, fraction)
        if motion is not None and motion.duration < best.trajectory.duration:
            shorter.append((motion, s_at(start.plan, end)))
            kind = StopKind.SWEEP
    shorter.sort(key=lambda each: each[0].duration)
    stops = (certify_motion(request, start, match_start(m, start.joints, request.limits), kind, s) for m, s in shorter)
    return next((stop for stop in stops if stop), best)


# ---------------- motions from a moving state to the end of the path


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
    if start.still and (stretched := _slow_down(request, start)) is not None:
        return stretched
    if start.rest is not None and (later := _meet_limits_later(request, start)) is not None:
        return later
    if touching is not None:
        return touching
    return request.infeasible(start.plan.joint_path, state.explain_infeasible(request, start, False))


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
    slower = find_stretch_factor(start.rest_analysis, request.limits, request.enforced)
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
        if braking.motion is None or braking.end >= running.end - state.ENDED:
            continue
        s = s_at(plan, braking.end)
        slow = cut_before(running, braking.end, s).stretched(1.0 / goal)
        first = match_start(braking.motion, start.joints, limits) if delay == 0.0 else braking.motion
        first = join(cut_after(rest, delay), first) if delay else first
        answer = _continue_slowly(request, start, first, s, slow)
        if answer is not None:
            return answer
    answer = certify_motion(replace(request, before=(limits, rest.end)), start, rest)
    return answer or None


def _continue_slowly(
    request: PlanRequest, start: MovingState, first: Trajectory, s: float, slow: Trajectory
) -> Plan | None:
    """Return the plan of a motion that has braked and continues by the law, or by the slowed running motion."""
    later = replace(request, before=(start.plan_limits, first.end))
    joints = start.plan.joint_path
    at = state.path_state(joints, s, (slow(0.0), slow(0.0, 1), slow(0.0, 2)))
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
            slower = stretch_to_limits(request.robot, found, request.limits, enforced, request.path)
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
