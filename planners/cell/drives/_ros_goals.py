"""Goals for a joint_trajectory_controller: messages of a plan and of its stops, certified after controller interpolation."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

from optik.errors import InvalidInput, NoSolution
from planners.cell.drives._stop import plan_stop
from planners.certificate.violation import Allow
from planners.motion import Motion
from planners.plan import Plan
from planners.ros.export import JointNames, ros_message

PREPARING = 5.0
"""Approximate limit on the time to compute the stops of a motion [s]; if they take longer, their instants get farther apart."""
MOTORS = ("velocity", "acceleration", "torque")
"""Limits of the motors, which a real arm always enforces; the others state how smooth a motion is."""
ROOM = 1e-4
"""Relative slowing of a motion before it is sent [1], so that a stop from any of its states exists within the limits: the
times of points are whole nanoseconds, and this rounding makes a motion at its limits exceed them."""


class TimedStop(NamedTuple):
    """A stop from an instant of a motion [s]; its plan has the certified motion after controller interpolation."""

    t: float
    plan: Plan
    message: dict[str, Any]  # its first point is the state at t


class Stops(NamedTuple):
    """The stops of a motion in the order of their instants, the spacing of the instants [s], and why a stop was not found."""

    found: list[TimedStop]
    every: float
    reason: str


def make_message(plan: Plan, joint_names: JointNames, allow: Allow = ()) -> tuple[Plan, dict[str, Any]]:
    """Return a plan with the certified motion after controller interpolation, and its message as plain data.

    Raises InvalidMotion, NoSolution or InvalidInput as `planners.to_ros` does.
    """
    message, sent = ros_message(motor_motion(plan), joint_names=joint_names, allow=allow)
    slowed = plan.slowed * sent.factor
    return replace(plan, _trajectory=sent.trajectory, _certificate=sent.certificate, slowed=slowed), message


def motor_motion(plan: Plan) -> Motion:
    """Return the motion of a plan; it must also respect the limits on velocity, acceleration and torque."""
    motion = plan.motion
    return replace(motion, enforced=tuple(n for n in motion.limits.names if n in MOTORS or n in motion.enforced))


def describe_exceeded(plan: Plan) -> str:
    """Return a note on limits that a motion exceeds and its law does not enforce."""
    proof = plan.certificate
    found = {name: proof.worst(name)[0] for name in plan.limits.names if name not in proof.enforced}
    words = [f"{name.replace('_', ' ')} by {100 * (x - 1):.3g} %" for name, x in found.items() if x > 1.0]
    return f"limits that {plan.law} does not enforce are exceeded: {', '.join(words)}" if words else ""


def add_room(plan: Plan) -> Plan:
    """Return the plan slowed by `ROOM`, or the plan itself if it has a requested tool speed."""
    if plan.speed is not None:
        return plan
    return replace(plan, _trajectory=plan.trajectory.slowed(1.0 + ROOM), slowed=plan.slowed * (1.0 + ROOM))


def make_stops(sent: Plan, every: float, joint_names: JointNames, allow: Allow = ()) -> Stops:
    """Return the stops from equally spaced instants of a motion; they are computed before it is sent."""
    found: list[TimedStop] = []
    reason, took = "", 0.0
    t = min(every, 0.5 * sent.trajectory.end)
    while t < sent.trajectory.end - 0.5 * every:
        since = perf_counter()
        try:
            stop = replace(plan_stop(sent, t, 1.0 - 0.5 * ROOM, allow), limits=sent.limits)
            found.append(TimedStop(t, *make_message(stop, joint_names, allow)))
        except (NoSolution, InvalidInput) as error:
            reason = reason or f"at t = {t:.6g} s: {error}"
        last, took = took, perf_counter() - since
        if last:  # the first one of a process compiles
            every = max(every, min(last, took) * sent.trajectory.end / PREPARING)
        t += every
    return Stops(found, every, reason)
