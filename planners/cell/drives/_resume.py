"""The rest of the way after a stop or a fault: back to the path where the arm stands off it, and on to the goal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives._stop import ends_at_goal, limits_of, relaxed
from planners.cell.drives.base import Drive, Execution, ExecutionStatus
from planners.cell.setpoints import slowed_to
from planners.limits import MotionLimits
from planners.plan import Plan, plan
from planners.replan import replan


def resumed(drive: Drive, execution: Execution, near: Array, options: dict[str, Any]) -> Execution:
    """Move the arm from its configuration to the goal of a stopped execution; the options are those of `execute`.

    The status is REFUSED if the arm is farther than `near` (n,) [rad, m] from its intended stopping point.
    """
    check_stopped(execution)
    assert execution.motion is not None
    rest, running = execution.motion(execution.motion.end), relaxed(execution.plan, options["allow"])
    measured = drive.measure()
    if np.isnan(measured).any():
        i = int(np.isnan(measured).argmax())
        name = drive.robot.joint_names[i]
        return nothing_sent(
            drive, execution.plan, f"the encoder of {name} is lost", "repair the encoder, and measure again"
        )
    before = None
    if (np.abs(measured - rest) > near).any():
        if execution.status is ExecutionStatus.STOPPED:
            i = int((np.abs(measured - rest) / near).argmax())
            name = drive.robot.joint_names[i]
            moved = f"{name} stands at {measured[i]:.6g}, and it was stopped at {rest[i]:.6g}"
            why = f"the arm was moved since: {moved}"
            return nothing_sent(drive, execution.plan, why, "a new plan from where it stands")
        back = way_back(running, measured, rest)
        if not back:
            assert back.stop is not None
            why = f"there is no way back to the path: {back.stop.reason}"
            return nothing_sent(drive, execution.plan, why, back.stop.advice)
        before = drive.execute(long_enough(back, drive.period), **options)
        if not before or execution.stop_plan is None or ends_at_goal(execution.stop_plan):
            return before
    if execution.stop_plan is None or ends_at_goal(execution.stop_plan):
        there = nothing_sent(drive, execution.plan, "", "")
        return replace(there, status=ExecutionStatus.DONE, notes=("the arm stood at the goal already",))
    stop = relaxed(execution.stop_plan, options["allow"])
    onward = long_enough(
        replan(stop, stop.trajectory.end, limits=limits_of(running)[0], timing="optimal"), drive.period
    )
    onward = replace(onward, scene=execution.plan.scene, margin=execution.plan.margin)
    return replace(drive.execute(onward, **options), before=before)


def check_stopped(execution: Execution) -> None:
    """Raise InvalidInput unless an execution was stopped on its way."""
    if not isinstance(execution, Execution):
        raise InvalidInput("execution", repr(execution)[:60], "an Execution")
    if execution.status not in (ExecutionStatus.STOPPED, ExecutionStatus.FAULT) or execution.motion is None:
        raise InvalidInput(
            "execution", f"one that ended with {execution.status}", "one that was stopped, or by a fault"
        )


def way_back(running: Plan, measured: Array, rest: Array) -> Plan:
    """Plan the straight way in joint space from where the arm stands back to where it was to stop."""
    limits = limits_of(running)[0]
    joints = MotionLimits(limits.velocity, limits.acceleration, limits.jerk, torque=limits.torque)
    return plan(
        running.robot,
        rest,
        running.robot.limits.clip(measured),
        limits=joints,
        scene=running.scene,
        margin=running.margin,
    )


def long_enough(found: Plan, period: float) -> Plan:
    """Slow a plan that is shorter than the servo's period to it: what is left of a way may be some micrometres."""
    return slowed_to(found, period) if found and found.trajectory.end < period else found


def nothing_sent(drive: Drive, plan: Plan, reason: str, advice: str, *, placed: bool = True) -> Execution:
    """Return the record of an execution for which nothing was sent: REFUSED."""
    at = drive.measure() if placed else np.full(drive.robot.n, np.nan)
    return Execution(
        drive.name, drive.robot, ExecutionStatus.REFUSED, reason, advice, plan, None, None, None,
        np.zeros(1), at[None], np.zeros((1, at.size)), None, at[None],
    )  # fmt: skip
