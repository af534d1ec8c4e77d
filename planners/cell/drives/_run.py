"""An execution on a simulated drive while it runs: its set-points, its stop, and the record of the arm's motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives.base import (
    Drive,
    Execution,
    ExecutionStatus,
    Fault,
    Setpoints,
    make_setpoints,
    stretch_to_duration,
)
from planners.certificate.analysis import AT_REST
from planners.certificate.violation import Allow, check_allow, required_limits
from planners.following.failure import joint_unit
from planners.limits import MotionLimits
from planners.motion.motion import Event
from planners.plan import Plan, PlanStatus, plan
from planners.replan import replan
from planners.replan.state import SPEED_MARGIN, keep_speed, s_at
from planners.timing.base import StopKind
from planners.trajectory import Trajectory, cut_after, join, make_rest

# ---------------- the stop of a plan during its execution


END_FRACTION = 2e-9
"""Fraction of the path length from its end that counts as its end [1]: `replan` plans nothing from half of that."""
ONSETS = (0.04, 0.004)
"""Times in which a stop may reach the largest acceleration if the plan's law enforces no jerk limit [s], the longer first."""
LEAST_FRACTION = 0.1
"""Least limit of a joint without a stated limit, as a fraction of the largest value of all joints in the plan [1]."""


def without_permitted(plan: Plan, allow: Allow) -> Plan:
    """Return a plan that can be stopped and replanned despite the permitted violations.

    It has no scene if contact is permitted. Limits that may be exceeded are not enforced.
    """
    allowed = check_allow(allow)
    if not allowed:
        return plan
    proof = replace(plan.certificate, enforced=required_limits(plan.certificate.enforced, allowed))
    scene = None if "contact" in allowed else plan.scene
    return replace(plan, _certificate=proof, scene=scene)


def plan_stop_at(running: Plan, t: float, fraction: float = 1.0, allow: Allow = ()) -> Plan:
    """Return the stop of a plan from a time of its motion within a fraction of the limits.

    The first of the limits of `find_stop_limits` that gives a valid certificate is used.
    """
    stops, plan = [], without_permitted(running, allow)
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
    return running.with_motion(motion, span=(place, place), before=None, stop_kind=StopKind.SWEEP)


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
    rest, running = execution.motion(execution.motion.end), without_permitted(execution.plan, options["allow"])
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
    stop = without_permitted(execution.stop_plan, options["allow"])
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
    return stretch_to_duration(found, period) if found and found.trajectory.end < period else found


def refuse(drive: Drive, plan: Plan, reason: str, advice: str, *, placed: bool = True) -> Execution:
    """Return the record of a refused execution: nothing was sent. A simulated arm has no position before it is placed."""
    nowhere = np.full(drive.robot.n, np.nan)
    at, measured = (drive._actual(), drive.measure()) if placed else (nowhere, nowhere)
    return Execution(
        drive.name, drive.robot, ExecutionStatus.REFUSED, reason, advice, plan, None, None, None,
        np.zeros(1), at[None], np.zeros((1, at.size)), None, measured[None],
    )  # fmt: skip


# ---------------- an execution on a simulated drive while it runs


class EventQueue:
    """The events of a plan while it is executed: those that came, and those that have not come yet."""

    def __init__(self, plan: Plan) -> None:
        self.waiting, self.raised = list(plan.events), list[Event]()

    def raise_until(self, t: float) -> tuple[Event, ...]:
        """Return the events that come until a time [s] and have not come yet."""
        come = tuple(event for event in self.waiting if event.t <= t)
        self.waiting = self.waiting[len(come) :]
        self.raised += come
        return come

    def replace_after(self, t: float, stop: Plan) -> None:
        """Replace the events after a time [s] by those of the stop that begins there."""
        kept = [event for event in self.waiting if event.t <= t]
        self.waiting = kept + [event._replace(t=event.t + t) for event in stop.events]


class EncoderMonitor:
    """A monitor of frozen encoders: the time since each reading last changed, and the motion of its set-point since then."""

    def __init__(self) -> None:
        self._read = self._low = self._high = self._since = np.array(np.nan)

    def update(self, read: Array, setpoint: Array, t: float) -> Array:
        """Return how far each set-point moved since the reading of its joint last changed (n,) [rad, m]."""
        fresh = read != self._read  # NaN always counts as a new reading
        self._read = read.copy()
        self._since = np.where(fresh, t, self._since)
        self._low = np.where(fresh, setpoint, np.minimum(self._low, setpoint))
        self._high = np.where(fresh, setpoint, np.maximum(self._high, setpoint))
        moved: Array = self._high - self._low
        return moved

    def seconds(self, t: float) -> Array:
        """Return the time since each reading last changed (n,) [s], at a time [s]."""
        seconds: Array = t - self._since
        return seconds


class Commands(NamedTuple):
    """The commands to the servo at the plant's steps of one period, including its start and its end: m + 1 rows."""

    t: Array  # (m + 1,) from 0 to the period [s]
    q: Array  # (m + 1, n) [rad, m]
    dq: Array  # (m + 1, n) [rad/s, m/s]
    ddq: Array  # (m + 1, n) [rad/s², m/s²]


class Steps(NamedTuple):
    """The state of the arm in one period, after each of the plant's m steps."""

    q: Array  # (m, n) [rad, m]
    dq: Array  # (m, n) [rad/s, m/s]
    torque: Array | None = None  # (m, n) of the motors [N·m, N]; None if the plant has no torques


def interpolate_setpoints(stream: Setpoints, k: int, steps: int, hold: bool) -> Commands:
    """Interpolate set-points k and k + 1 by cubics through position and velocity, or hold the first of them."""
    last, period = len(stream.t) - 1, stream.period
    u = np.linspace(0.0, 1.0, steps + 1)[:, None]
    if hold or k >= last:
        at = min(k, last)
        still = 0.0 if k >= last else 1.0
        rows = (np.repeat(x[at : at + 1], steps + 1, axis=0) for x in (stream.q, still * stream.dq, still * stream.ddq))
        return Commands(u[:, 0] * period, *rows)
    q, v = stream.q[k], stream.dq[k] * period
    # the cubic from (q, v) to the next set-point, in powers of the fraction u of the period
    d, w = stream.q[k + 1] - q, stream.dq[k + 1] * period
    c2, c3 = 3.0 * d - 2.0 * v - w, v + w - 2.0 * d
    position = q + u * (v + u * (c2 + u * c3))
    position[-1] = stream.q[k + 1]
    velocity = (v + u * (2.0 * c2 + 3.0 * u * c3)) / period
    return Commands(u[:, 0] * period, position, velocity, (2.0 * c2 + 6.0 * u * c3) / period**2)


@dataclass
class DriveRun:
    """The state of a running execution."""

    plan: Plan
    motion: Trajectory  # the motion that is sent: the plan's, or the plan's up to a stop and then the stop
    stream: Setpoints  # of that motion
    stop: Plan | None = None  # certified, except for some stops after a fault
    stopping: bool = False  # whether a stop was started, or was searched without result
    requested: bool = False  # whether the stop was requested
    fault: Fault | None = None  # the first one
    stuck: int | None = None  # index of the joint that did not follow
    late: int = 0  # number of late ticks
    notes: list[str] = field(default_factory=list)
    encoders: EncoderMonitor = field(default_factory=EncoderMonitor)
    allow: tuple[str, ...] = ()  # permitted violations of the plan and of its stop
    events: EventQueue = field(init=False)
    t: list[Array] = field(default_factory=list)
    q: list[Array] = field(default_factory=list)
    dq: list[Array] = field(default_factory=list)
    torque: list[Array] = field(default_factory=list)
    measured: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.events = EventQueue(self.plan)

    @property
    def last(self) -> int:
        """Index of the tick of the last set-point."""
        return len(self.stream.t) - 1

    @property
    def at_goal(self) -> bool:
        """Whether the sent motion ends at the end of the plan: there is no stop, or the shortest stop ends there."""
        return self.stop is None or ends_at_goal(self.stop)

    def stop_at(self, tick: int) -> None:
        """Replace the set-points after a tick by a certified stop; without one the arm continues to the end of the plan.

        After a fault, a stop that exceeds limits is better than continuing: it is sent, and a note says so.
        """
        if self.stopping:
            return
        self.stopping = True
        t = tick * self.stream.period
        if tick >= self.last or t >= self.motion.end:
            self.notes.append("the drive already had the set-points up to the end of the plan: no stop was needed")
            return
        resting = is_at_rest(self.motion, t)
        found = plan_hold(self.plan, t, self.stream.period) if resting else plan_stop_at(self.plan, t, allow=self.allow)
        if not found and not resting:
            assert found.failure is not None
            why = f"no stop from t = {t:.6g} s could be certified: {found.failure.reason}"
            if self.fault is None or found.status is not PlanStatus.NOT_PROVED:
                self.notes.append(f"{why}; the plan was executed to its end")
                return
            self.notes.append(f"{why}; it was sent anyway, because of the fault")
        self.stop = found
        self.events.replace_after(t, found)
        self.motion = join(cut_after(self.motion, t), found.trajectory) if tick else found.trajectory
        self.stream = make_setpoints(self.motion, self.stream.period)
        if ends_at_goal(found):
            self.notes.append("the shortest stop within the limits ends at the end of the path")

    def fail(self, fault: Fault, tick: int) -> None:
        """Record the fault if it is the first one, and stop."""
        if self.fault is None:
            self.fault = fault
        self.stop_at(tick)

    def extend(self, ticks: int) -> None:
        """Hold the last set-point up to a tick, so that each reading has a set-point."""
        more = ticks - self.last
        if more <= 0:
            return
        period, t, q, dq, ddq = self.stream
        still = np.zeros((more, q.shape[1]))
        t = np.append(t, period * np.arange(self.last + 1, ticks + 1))
        held = (np.repeat(q[-1:], more, axis=0), still, still)
        self.stream = Setpoints(period, t, *(np.concatenate([x, y]) for x, y in zip((q, dq, ddq), held, strict=True)))

    def record(self, start: float, times: Array, steps: Steps) -> None:
        """Append the motion of the arm in one period."""
        self.t.append(start + times)
        self.q.append(steps.q)
        self.dq.append(steps.dq)
        if steps.torque is not None:
            self.torque.append(steps.torque)
