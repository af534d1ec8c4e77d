"""The stop of a plan that is executed, also of one whose law keeps no jerk or whose limits are incomplete."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from optik.types import Array
from planners.certificate.failure import Allow, check_allow, required_limits
from planners.limits import MotionLimits
from planners.plan import Plan
from planners.replan import replan

END_SHARE = 2e-9
"""Share of a path before its end that counts as its end: `replan` plans nothing from half of that."""
SPEED_SPARE = 1e-6
"""Share by which a stop may exceed a constant tool speed that was asked: what rounding makes of a motion at that speed."""
ONSETS = (0.04, 0.004)
"""Times [s] in which a stop may reach the greatest acceleration, where the plan's law keeps no jerk: the gentle one first."""
LEAST_SHARE = 0.1
"""Share of the greatest value of all joints that each may reach, where nothing but the plan itself says how much."""


def relaxed(plan: Plan, allow: Allow) -> Plan:
    """Return a plan that can be stopped and replanned despite violations that these words permit.

    It has no scene if contact is permitted. Limits that may be exceeded are not enforced.
    """
    allowed = check_allow(allow)
    if not allowed:
        return plan
    proof = replace(plan.certificate, keeps=required_limits(plan.certificate.keeps, allowed))
    scene = None if "contact" in allowed else plan.scene
    return replace(plan, _certificate=proof, scene=scene, margin=0.0 if scene is None else plan.margin)


def stop_from(running: Plan, t: float, share: float = 1.0, allow: Allow = ()) -> Plan:
    """Return the stop of a plan from a time of its motion, for the first jerk limit that gives a valid certificate."""
    stops, plan = [], relaxed(running, allow)
    for limits in limits_of(plan):
        limits = limits if share == 1.0 else limits.scaled(share)
        found = replan(plan, t, stop=True, limits=limits, timing="optimal")
        if found:
            return replace(found, scene=running.scene, margin=running.margin)
        stops.append(found)
    found = (
        replan(plan, t, stop=True) if share == 1.0 else stops[-1]
    )  # a law without jerk limits may stop with any jerk
    return replace(found, scene=running.scene, margin=running.margin) if found else stops[-1]


def ends_at_goal(plan: Plan) -> bool:
    """Whether a plan or a stop ends at the end of its path."""
    return plan.span is None or plan.span[1] >= plan.joint_path.end * (1.0 - END_SHARE)


def limits_of(running: Plan) -> tuple[MotionLimits, ...]:
    """Limits of a stop and of the rest of the way, the gentlest first: those of the plan, where it promises to keep them.

    What the plan's law does not keep, or what is not limited, may be as large as in the plan itself. A jerk that it does
    not keep may be what reaches the greatest acceleration within one of `ONSETS`. A constant tool speed that was asked
    is one more limit.
    """
    proof, limits = running.certificate, running.limits
    changed: dict[str, Any] = _speed(running)
    kept, known = set(proof.keeps), limits.arrays(running.robot.n)
    loaded = limits.torque is not None and "torque" in kept
    if limits.velocity is None or "velocity" not in kept:
        changed["velocity"] = _reached(proof.velocity.value, known["velocity"])
    if "acceleration" not in kept or (limits.acceleration is None and not loaded):
        changed["acceleration"] = _reached(proof.acceleration.value, known["acceleration"])
    if limits.jerk is not None and "jerk" in kept:
        return (replace(limits, **changed),)
    hardest = _reached(proof.acceleration.value, known["acceleration"])
    return tuple(replace(limits, **changed, jerk=hardest / onset) for onset in ONSETS)


def _speed(running: Plan) -> dict[str, Any]:
    """The constant tool speed that was asked, as a limit on the tool or on its rotation where it only turns."""
    if running.speed is None:
        return {}
    most, moves = running.speed * (1.0 + SPEED_SPARE), running.certificate.tool_speed.value > 0.5 * running.speed
    name = "tool_speed" if moves else "rotation_speed"
    known = getattr(running.limits, name)
    return {name: most if known is None else np.minimum(known, most)}


def _reached(reached: Array, limit: Array) -> Array:
    """The largest values (n,) of a motion, or a finite limit (n,) where that is higher."""
    reached = np.maximum(reached, LEAST_SHARE * reached.max()) * (1.0 + SPEED_SPARE)
    return np.maximum(reached, np.where(np.isfinite(limit), limit, 0.0))
