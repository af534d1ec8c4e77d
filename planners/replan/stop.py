"""Stops: the arm brakes along its path as hard as the limits allow."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np

from planners.motion.fit import match_start
from planners.planning.request import PlanRequest
from planners.planning.result import Plan
from planners.replan.request import certify_motion, explain_infeasible
from planners.replan.state import MovingState, build_moving_state, s_at
from planners.timing.base import StopKind
from planners.timing.brake import Brake, BrakingMotion, RunningMotion
from planners.timing.optimal import Optimal
from planners.trajectory import cut_after, join

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
    checked = _find_stop(replace(request, start_error=None), build_moving_state(plan, plan.trajectory, t), 0.0)
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
    return best or request.infeasible(start.plan.joint_path, explain_infeasible(request, start, True))


def _sweep_stops(request: PlanRequest, start: MovingState) -> Iterator[Plan]:
    """Yield sweeps to rest: at once, the shortest first; then after a part of the remaining motion."""
    plan, rate = start.plan, start.clock[0]
    running = plan.trajectory
    brake = _brake(request, plan)
    found: list[BrakingMotion] = []
    for fraction in LIMIT_FRACTIONS:
        found.append(brake.run(start.t, start.clock, fraction))
        if found[-1].smooth or found[-1].end > running.end:
            break
    stops = [(braking.motion, braking.end) for braking in found if braking.motion is not None]
    for motion, end in sorted(stops, key=lambda stop: stop[0].end):
        matched = match_start(motion, start.joints, request.limits)
        yield certify_motion(request, start, matched, StopKind.SWEEP, s_at(plan, end))
    if found[-1].end > running.end:
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
    low, high, factor, found = 0.0, 1.0, FIRST_END, []
    while high - low > CLOSE_ENDS:
        began = perf_counter()
        if began + longest > until:
            break
        end = start.at.s + way * factor
        motion = law.run_to(joints, request.limits, start.at, end)
        if motion is not None and motion.duration < best.trajectory.duration:
            found.append((motion, end))
            high = factor
        else:
            low = factor
        factor = high * FIRST_END if low == 0.0 else 0.5 * (low + high)
        longest = max(longest, perf_counter() - began)
    kind, brake = StopKind.OPTIMUM, _brake(request, start.plan)
    for fraction in () if found else MORE_FRACTIONS:
        if perf_counter() > until:
            break
        motion, end, _ = brake.run(start.t, start.clock, fraction)
        if motion is not None and motion.duration < best.trajectory.duration:
            found.append((motion, s_at(start.plan, end)))
            kind = StopKind.SWEEP
    found.sort(key=lambda each: each[0].duration)
    stops = (certify_motion(request, start, match_start(m, start.joints, request.limits), kind, s) for m, s in found)
    return next((stop for stop in stops if stop), best)
