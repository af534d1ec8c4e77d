"""A stop: the arm brakes along its path as hard as the limits allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np

from planners.plan import Asked, Plan, StopKind
from planners.replan.reason import reason
from planners.replan.request import judged
from planners.replan.state import MovingState, s_at
from planners.splice import begun, joined, start_of
from planners.timing._brake import brake
from planners.timing.optimal import Optimal

SHARES = (0.995, 0.96, 0.88)
"""Fractions of the limits that a sweep uses, tried in turn: it exceeds them a little between its knots."""
DELAYS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.6)
"""Fractions of what is left of the motion that are followed before the arm brakes, where it cannot brake at once."""
SHORTEST = 1e-6
"""Distance to rest, over the length of the path, below which the sweep alone is tried: the joint path is straight there."""
ENDS = (0.97, 0.9, 1.0, 0.8, 1.08)
"""Distances to rest, over that of the sweep, at which the optimum is tried."""


def stopped_plan(asked: Asked, plan: Plan, start: MovingState, time_limit: float) -> Plan:
    """The stop: the optimum's, the sweep's, or the end of the motion, whichever is first and certified."""
    best = next((p for p in _swept_stops(asked, plan, start) if p), None)
    if best is None and asked.limits != plan.limits:
        best = next((p for p in _swept_stops(replace(asked, limits=plan.limits), plan, start, asked) if p), None)
    if best is not None and time_limit > 0.0:
        best = _refined(asked, plan, start, best, perf_counter() + time_limit)
    rest = start.rest
    if rest is None or (best is not None and best.trajectory.duration <= rest.duration):
        return best or asked.infeasible(plan.joint_path, reason(asked, plan, start, True))
    end = judged(asked, plan, start, rest, StopKind.END)
    if end or best is not None:
        return end if end else best  # type: ignore[return-value]
    touches = end.certificate.clearance is not None and end.certificate.clearance.touches
    return end if touches else asked.infeasible(plan.joint_path, reason(asked, plan, start, True))


def _swept_stops(asked: Asked, plan: Plan, start: MovingState, later: Asked | None = None) -> Iterator[Plan]:
    """Sweeps to rest at once, under ever smaller fractions of the limits; then after a part of what is left of the motion.

    With `later`, the limits of `asked` hold until the end of the stop, where those of `later` are met.
    """
    running, scales = plan.trajectory, scales_of(asked, plan)
    left, rest = running.end - start.t, start.rest
    tried = [(0.0, share) for share in SHARES]
    tried += [(delay * left, share) for delay in DELAYS if rest is not None for share in SHARES[1:3]]
    for delay, share in tried:
        t, clock = start.t + delay, start.clock if delay == 0.0 else (1.0, 0.0)
        braking = brake(plan.robot, running, asked.limits, t, clock, scales, share)
        if braking is None:
            continue
        motion = begun(braking.motion, start.joints, asked.limits) if delay == 0.0 else braking.motion
        if rest is not None and delay:
            motion = joined(start_of(rest, delay), motion)
        end = s_at(plan, braking.end)
        if later is None:
            yield judged(asked, plan, start, motion, StopKind.SWEEP, end)
        else:
            yield judged(replace(later, before=(asked.limits, motion.end)), plan, start, motion, StopKind.SWEEP, end)


def scales_of(asked: Asked, plan: Plan) -> dict[str, float]:
    """Limits of a sweep and by what they are multiplied: 1 where they are enforced, else what the running motion reaches."""
    scales = dict.fromkeys(asked.keeps, 1.0)
    if asked.limits == plan.limits:
        for name in asked.limits.names:
            if name not in scales and np.isfinite(reached := plan.certificate.worst(name)[0]):
                scales[name] = max(1.0, reached)
    return scales


def _refined(asked: Asked, plan: Plan, start: MovingState, best: Plan, until: float) -> Plan:
    """The best of a stop and of optima that end near it, as many as there is time for."""
    law, joints = asked.law if isinstance(asked.law, Optimal) else Optimal(), plan.joint_path
    if best.span is None or best.within_limits_from or set(law.keeps) - set(asked.keeps):
        return best
    way, longest = best.span[1] - start.at.s, 0.0
    if way < SHORTEST * joints.end:
        return best
    for factor in ENDS:
        began = perf_counter()
        if began + longest > until:
            break
        end = start.at.s + way * factor
        motion = law.run_to(joints, asked.limits, start.at, end) if end < joints.end else None
        if motion is not None and motion.duration < best.trajectory.duration:
            found = judged(asked, plan, start, begun(motion, start.joints, asked.limits), StopKind.OPTIMUM, end)
            best = found if found else best
        longest = max(longest, perf_counter() - began)
    return best
