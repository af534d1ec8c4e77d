"""The stop of a plan during its execution, also for laws without a jerk limit and for incomplete limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives.base import Drive, Execution, ExecutionStatus
from planners.cell.drives.setpoints import slow_to
from planners.certificate.checks import AT_REST
from planners.certificate.violation import Allow, check_allow, required_limits
from planners.following.failure import joint_unit
from planners.limits import MotionLimits
from planners.plan import Plan, plan
from planners.replan import replan
from planners.replan.request import SPEED_MARGIN, keep_speed
from planners.replan.state import s_at
from planners.timing.base import StopKind
from planners.trajectory import Trajectory, make_rest

END_FRACTION = 2e-9
"""Fraction of the path length from its end that counts as its end [1]: `replan` plans nothing from half of that."""
ONSETS = (0.04, 0.004)
"""Times in which a stop may reach the largest acceleration if the plan's law enforces no jerk limit [s], the longer first."""
LEAST_FRACTION = 0.1
"""Least limit of a joint without a stated limit, as a fraction of the largest value of all joints in the plan [1]."""


def relax(plan: Plan, allow: Allow) -> Plan:
    """Return a plan that can be stopped and replanned despite the permitted violations.

    It has no scene if contact is permitted. Limits that may be exceeded are not enforced.
    """
    allowed = check_allow(allow)
    if not allowed:
        return plan
    proof = replace(plan.certificate, enforced=required_limits(plan.certificate.enforced, allowed))
    scene = None if "contact" in allowed else plan.scene
    return replace(plan, _certificate=proof, scene=scene)


def plan_stop(running: Plan, t: float, fraction: float = 1.0, allow: Allow = ()) -> Plan:
    """Return the stop of a plan from a time of its motion within a fraction of the limits.

    The first of the limits of `find_stop_limits` that gives a valid certificate is used.
    """
    stops, plan = [], relax(running, allow)
    for limits in find_stop_limits(plan):
        limits = limits if fraction == 1.0 else limits.scale(fraction)
        found = replan(plan, t, stop=True, limits=limits, timing="optimal")
        if found:
            return replace(found, scene=running.scene)
        stops.append(found)
    # a law without jerk limits may stop with any jerk
    found = replan(plan, t, stop=True) if fraction == 1.0 else stops[-1]
    return replace(found, scene=running.scene) if found else stops[-1]


def plan_hold(running: Plan, t: float, period: float) -> Plan:
    """Return the stop of a plan from a time at which the arm is at rest: it stays there for one period."""
    place = s_at(running, t)
    motion = make_rest(running.trajectory(t), period, place)
    held = replace(running.motion, trajectory=motion, span=(place, place), before=None)
    return replace(
        running, _trajectory=motion, _certificate=held.certify(rate=running.certificate.rate), span=held.span, before=None,
        stop_kind=StopKind.SWEEP,
    )  # fmt: skip


def is_at_rest(motion: Trajectory, t: float) -> bool:
    """Return whether a motion that begins at rest stands still at a time, within rounding error."""
    return t == 0.0 or bool((np.abs(motion(t, 1)) <= AT_REST * motion.extrema(1).worst).all())


def ends_at_goal(plan: Plan) -> bool:
    """Return whether a plan or a stop ends at the end of its path."""
    return plan.span is None or plan.span[1] >= plan.joint_path.end * (1.0 - END_FRACTION)


def find_stop_limits(running: Plan) -> tuple[MotionLimits, ...]:
    """Return the limits of a stop and of the remaining motion, the lowest jerk limit first: those that the plan enforces.

    A quantity that is not limited, or whose limit the law does not enforce, may be as large as in the plan. Without an
    enforced jerk limit, the jerk may reach the largest acceleration within one of `ONSETS`. A requested constant tool speed
    is one more limit.
    """
    proof, limits = running.certificate, keep_speed(running, running.limits)
    changed: dict[str, Any] = {}
    enforced, known = set(proof.enforced), limits.arrays(running.robot.n)
    loaded = limits.torque is not None and "torque" in enforced
    if limits.velocity is None or "velocity" not in enforced:
        changed["velocity"] = _largest_values(proof.velocity.value, known["velocity"])
    if "acceleration" not in enforced or (limits.acceleration is None and not loaded):
        changed["acceleration"] = _largest_values(proof.acceleration.value, known["acceleration"])
    if limits.jerk is not None and "jerk" in enforced:
        return (replace(limits, **changed),)
    hardest = _largest_values(proof.acceleration.value, known["acceleration"])
    return tuple(replace(limits, **changed, jerk=hardest / onset) for onset in ONSETS)


def _largest_values(reached: Array, limit: Array) -> Array:
    """Return the largest values (n,) of a motion, or the finite limits (n,) that are higher."""
    reached = np.maximum(reached, LEAST_FRACTION * reached.max()) * (1.0 + SPEED_MARGIN)
    return np.maximum(reached, np.where(np.isfinite(limit), limit, 0.0))


def resume_execution(drive: Drive, execution: Execution, near: Array, options: dict[str, Any]) -> Execution:
    """Move the arm from its configuration to the goal of a stopped execution; the options are those of `execute`.

    The status is REFUSED if the arm is farther than `near` (n,) [rad, m] from its intended stopping point.
    """
    check_stopped(execution)
    assert execution.motion is not None
    rest, running = execution.motion(execution.motion.end), relax(execution.plan, options["allow"])
    measured = drive.measure()
    if np.isnan(measured).any():
        i = int(np.isnan(measured).argmax())
        name = drive.robot.joint_names[i]
        return refuse(drive, execution.plan, f"the encoder of {name} is lost", "repair the encoder, and measure again")
    before = None
    if (np.abs(measured - rest) > near).any():
        if execution.status is ExecutionStatus.STOPPED:
            i = int((np.abs(measured - rest) / near).argmax())
            name, unit = drive.robot.joint_names[i], joint_unit(drive.robot, i)
            moved = f"{name} is at {measured[i]:.6g} {unit}, but it was stopped at {rest[i]:.6g} {unit}"
            why = f"the arm has moved since the stop: {moved}"
            return refuse(drive, execution.plan, why, "plan from the arm's present configuration")
        back = plan_way_back(running, measured, rest)
        if not back:
            assert back.failure is not None
            why = f"no motion back to the path was found: {back.failure.reason}"
            return refuse(drive, execution.plan, why, back.failure.advice)
        before = drive.execute(fill_period(back, drive.period), **options)
        if not before or execution.stop_plan is None or ends_at_goal(execution.stop_plan):
            return before
    if execution.stop_plan is None or ends_at_goal(execution.stop_plan):
        there = refuse(drive, execution.plan, "", "")
        return replace(there, status=ExecutionStatus.DONE, notes=("the arm was already at the goal",))
    stop = relax(execution.stop_plan, options["allow"])
    onward = replan(stop, stop.trajectory.end, limits=find_stop_limits(running)[0], timing="optimal")
    onward = replace(fill_period(onward, drive.period), scene=execution.plan.scene)
    return replace(drive.execute(onward, **options), before=before)


def check_stopped(execution: Execution) -> None:
    """Raise InvalidInput unless an execution was stopped during its motion."""
    if not isinstance(execution, Execution):
        raise InvalidInput("execution", repr(execution)[:60], "an Execution")
    if execution.status not in (ExecutionStatus.STOPPED, ExecutionStatus.FAULT) or execution.motion is None:
        got = f"one with status {execution.status}"
        raise InvalidInput("execution", got, "one that was stopped on request or by a fault")


def plan_way_back(running: Plan, measured: Array, rest: Array) -> Plan:
    """Return a plan of the straight motion in joint space from the measured configuration to the intended stopping point."""
    limits = find_stop_limits(running)[0]
    joints = MotionLimits(limits.velocity, limits.acceleration, limits.jerk, torque=limits.torque)
    return plan(running.robot, rest, running.robot.limits.clip(measured), limits=joints, scene=running.scene)


def fill_period(found: Plan, period: float) -> Plan:
    """Return a plan of at least one servo period: the remaining motion may be some micrometres."""
    return slow_to(found, period) if found and found.trajectory.end < period else found


def refuse(drive: Drive, plan: Plan, reason: str, advice: str, *, placed: bool = True) -> Execution:
    """Return the record of a refused execution: nothing was sent. A simulated arm has no position before it is placed."""
    nowhere = np.full(drive.robot.n, np.nan)
    at, measured = (drive._actual(), drive.measure()) if placed else (nowhere, nowhere)
    return Execution(
        drive.name, drive.robot, ExecutionStatus.REFUSED, reason, advice, plan, None, None, None,
        np.zeros(1), at[None], np.zeros((1, at.size)), None, measured[None],
    )  # fmt: skip
