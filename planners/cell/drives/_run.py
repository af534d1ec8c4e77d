"""An execution on a simulated drive while it runs: its set-points, its stop, and the record of the arm's motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_kind, check_number
from optik.errors import InvalidInput, InvalidMotion
from optik.types import Array
from planners.cell.drives import base
from planners.cell.drives.base import Drive, Execution, ExecutionStatus, Fault, FaultKind, Setpoints
from planners.certificate.analysis import AT_REST
from planners.certificate.certificate import Certificate, check_valid
from planners.certificate.violation import Allow, check_allow, required_limits
from planners.following.failure import joint_unit
from planners.limits import MotionLimits
from planners.motion.motion import Event
from planners.plan import Plan, PlanStatus, plan
from planners.replan import replan
from planners.replan.state import SPEED_MARGIN, keep_speed, s_at
from planners.timing.base import StopKind
from planners.trajectory import Trajectory, cut_after, join, make_rest

# ---------------- checks before the start


GREATEST_STEP = 1.0 + 1e-6
"""Largest step between set-points, over the velocity limit times the period [1]: a motion at its limit is accepted."""
START_ADVICE = "plan from the arm's present configuration, drive.measure()"
"""Advice for an arm that is not at the start of a plan."""
Refusal = tuple[str, str]
"""The reason why nothing is sent, and advice."""


def check_plan(plan: Plan, robot: Robot) -> None:
    """Raise InvalidInput unless the argument is a plan of this arm."""
    check_kind(plan, "plan", Plan)
    if plan.robot != robot:
        raise InvalidInput("plan", f"a plan of {plan.robot.name}", f"a plan of this drive's arm, {robot.name}")


def find_violation(plan: Plan, allow: Allow = (), proof: Certificate | None = None) -> Refusal | None:
    """Return why a plan must not be executed: no motion, violations that `allow` does not permit, or a start in motion.

    ``proof`` is the certificate that is judged; by default the plan's own.
    """
    if plan.failure is not None and (not plan.has_motion or (not plan and plan.certificate.is_valid)):
        return f"the plan did not succeed ({plan.status}): {plan.failure.reason}", plan.failure.advice
    proof = plan.certificate if proof is None else proof
    try:
        check_valid(proof, allow)
    except InvalidMotion as error:
        status = "" if plan else f" ({plan.status})"
        return f"the certificate of the plan{status} is not valid: {error.reason}", error.advice
    if not proof.rest[0]:
        return "the plan begins in motion, but the arm is at rest", START_ADVICE
    return None


def find_refusal(plan: Plan, measured: Array, options: base.Options) -> Refusal | None:
    """Return why a plan must not be sent: the arm is not at its start, or set-points exceed the arm's velocity limits."""
    names, start = plan.robot.joint_names, plan.trajectory(0.0)
    lost = np.flatnonzero(np.isnan(measured))
    if lost.size:
        return f"the encoder of {names[lost[0]]} is lost", "repair the encoder, and measure again"
    off = np.abs(measured - start) / options.start
    i = int(off.argmax())
    if off[i] > 1.0:
        return describe_start(plan.robot, i, measured[i], start[i], options.start[i]), START_ADVICE
    fastest, known = plan.trajectory.extrema(1).worst, plan.robot.limits.velocity
    most = np.full(fastest.size, np.inf) if known is None else np.broadcast_to(known, fastest.shape) * GREATEST_STEP
    i = int((fastest / most).argmax())
    if fastest[i] > most[i]:
        unit = f"{joint_unit(plan.robot, i)}/s"
        what = f"{names[i]} moves at {fastest[i]:.6g} {unit}, above the arm's own limit of {most[i]:.6g} {unit}"
        return f"the drive would refuse the set-points: {what}", "plan within the limits of the robot"
    return None


def describe_start(robot: Robot, i: int, q: float, start: float, tolerance: float) -> str:
    """Return the reason for an arm that is not at the start of a plan: joint i is farther from it than the tolerance."""
    unit = joint_unit(robot, i)
    at = f"{robot.joint_names[i]} is at {q:.6g} {unit}, but the plan starts at {start:.6g} {unit}"
    return f"{at}; the tolerance is {tolerance:g} {unit}"


def make_stop_test(stop: base.StopRequest | None) -> Callable[[float], bool]:
    """Return the function that decides at every tick whether to stop."""
    if stop is None:
        return lambda t: False
    if callable(stop):
        return stop
    when = check_number(stop, "stop", "a time [s] of at least 0, or a function of the time", least=0.0)
    return lambda t: t >= when - 1e-9


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
    check_kind(execution, "execution", Execution, "an Execution")
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
    return base.stretch_to_duration(found, period) if found and found.trajectory.end < period else found


def refuse(drive: Drive, plan: Plan, reason: str, advice: str, *, placed: bool = True) -> Execution:
    """Return the record of a refused execution: nothing was sent. A simulated arm has no position before it is placed."""
    nowhere = np.full(drive.robot.n, np.nan)
    at, measured = (drive._actual(), drive.measure()) if placed else (nowhere, nowhere)
    return Execution(
        drive.name, drive.robot, ExecutionStatus.REFUSED, reason, advice, plan, None, None, None,
        np.zeros(1), at[None], np.zeros((1, at.size)), None, measured[None],
    )  # fmt: skip


# ---------------- an execution on a simulated drive while it runs


COUNTS = 4.0
"""Encoder counts beyond the tolerance that a set-point must move before an unchanged reading is a fault [1]."""
NOISE_SPREADS = 6.0
"""Noise that no reading exceeds, in standard deviations [1]."""
AT_STANDSTILL = (0.02, 0.002)
"""Largest velocity of a joint at rest [rad/s, m/s]; a servo that follows encoder noise is slower."""
BRAKED = (1e-4, 1e-5)
"""Largest velocity of a joint at rest with its brake applied [rad/s, m/s]."""
ENCODER_ADVICE = "repair the encoder; then resume"
"""Advice for a false reading."""
RESUME_ADVICE = "drive.resume continues to the goal"
"""Advice after a stop on request."""


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


def read_encoders(actual: Array, options: base.Options, noise: np.random.Generator) -> Array:
    """Return the readings of the encoders."""
    read = actual + options.noise * noise.standard_normal(actual.size) if options.noise else actual.copy()
    counts = np.where(options.resolution > 0.0, options.resolution, 1.0)
    return np.asarray(np.where(options.resolution > 0.0, np.round(read / counts) * counts, read))


def find_false_reading(read: Array, actual: Array, options: base.Options) -> int | None:
    """Return the index of a joint whose encoder is lost or reads a false position; None if there is no such joint."""
    lost = np.flatnonzero(np.isnan(read))
    if lost.size:
        return int(lost[0])
    off = np.abs(read - actual) / (options.end + COUNTS * options.resolution + NOISE_SPREADS * options.noise)
    return int(off.argmax()) if off.max() > 1.0 else None


@dataclass
class DriveRun:
    """The state of a running execution."""

    plan: Plan
    options: base.Options
    allow: tuple[str, ...] = ()  # permitted violations of the plan and of its stop
    motion: Trajectory = field(init=False)  # that is sent: the plan's, or the plan's up to a stop and then the stop
    stream: Setpoints = field(init=False)  # of that motion
    stop: Plan | None = None  # certified, except for some stops after a fault
    stopping: bool = False  # whether a stop was started, or was searched without result
    requested: bool = False  # whether the stop was requested
    fault: Fault | None = None  # the first one
    stuck: int | None = None  # index of the joint that did not follow
    late: int = 0  # number of late ticks
    notes: list[str] = field(default_factory=list)
    encoders: EncoderMonitor = field(default_factory=EncoderMonitor)
    events: EventQueue = field(init=False)
    t: list[Array] = field(default_factory=list)
    q: list[Array] = field(default_factory=list)
    dq: list[Array] = field(default_factory=list)
    torque: list[Array] = field(default_factory=list)
    measured: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.robot, self.motion, self.events = self.plan.robot, self.plan.trajectory, EventQueue(self.plan)
        self.stream = base.make_setpoints(self.motion, self.options.period)

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
        stop = plan_hold(self.plan, t, self.stream.period) if resting else plan_stop_at(self.plan, t, allow=self.allow)
        if not stop and not resting:
            assert stop.failure is not None
            why = f"no stop from t = {t:.6g} s could be certified: {stop.failure.reason}"
            if self.fault is None or stop.status is not PlanStatus.NOT_PROVED:
                self.notes.append(f"{why}; the plan was executed to its end")
                return
            self.notes.append(f"{why}; it was sent anyway, because of the fault")
        self.stop = stop
        self.events.replace_after(t, stop)
        self.motion = join(cut_after(self.motion, t), stop.trajectory) if tick else stop.trajectory
        self.stream = base.make_setpoints(self.motion, self.stream.period)
        if ends_at_goal(stop):
            self.notes.append("the shortest stop within the limits ends at the end of the path")

    def fail(self, kind: FaultKind, i: int, what: str, advice: str, tick: int, ahead: int = 0) -> None:
        """Record the fault of joint i at a tick, which is the first one, and stop some ticks ahead."""
        self.fault = Fault(kind, tick * self.options.period, self.robot.joint_names[i], what, advice)
        self.stop_at(tick + ahead)

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

    def check_encoders(self, k: int, read: Array) -> None:
        """Check the encoders at tick k: none may be lost, and every joint must follow its set-points."""
        if self.fault is not None:
            return
        names, ahead, most = self.robot.joint_names, self.options.ahead, self.options.following
        lost, setpoint = np.isnan(read), self.stream.q[min(k, self.last)]
        if lost.any():
            i = int(lost.argmax())
            what = f"the encoder of {names[i]} is lost; the joint went on by its set-points until it was at rest"
            self.fail(FaultKind.ENCODER, i, what, ENCODER_ADVICE, k, ahead)
            return
        behind = np.abs(read - setpoint)
        i = int((behind / most).argmax())
        unit = joint_unit(self.robot, i)
        if behind[i] > most[i]:
            what = f"{names[i]} reads {behind[i]:.3g} {unit} off its set-point, more than {most[i]:g} {unit}"
            why = "the joint is blocked or too weak, or its encoder is frozen"
            advice = f"check what blocks {names[i]} and its encoder; then resume, which first returns to the path"
            self.stuck = i
            self.fail(FaultKind.STALL, i, f"{what}: {why}", advice, k, ahead)
            return
        moved = self.encoders.update(read, setpoint, k * self.options.period)
        moved = moved / (most + COUNTS * self.options.resolution)
        i = int(moved.argmax())
        if moved[i] > 1.0:
            unit = joint_unit(self.robot, i)
            what = f"{names[i]} reads {read[i]:.6g} {unit} while its set-point moved by more than {most[i]:g} {unit}"
            self.stuck = i
            self.fail(
                FaultKind.ENCODER, i, f"{what}: its encoder is frozen, or it is blocked", ENCODER_ADVICE, k, ahead
            )

    def judge_rest(self, k: int, read: Array, actual: Array) -> None:
        """Check the final position of the arm at the last tick k by its encoders and by the true state of the simulated arm."""
        if self.fault is not None:
            return
        false, off = find_false_reading(read, actual, self.options), np.abs(read - self.stream.q[-1])
        i = int((off / self.options.end).argmax()) if false is None else false
        joint, unit, most = self.robot.joint_names[i], joint_unit(self.robot, i), self.options.end[i]
        if false is not None:
            what = f"{joint} is at {actual[i]:.6g} {unit}, but its encoder reads {read[i]:.6g} {unit}"
            what = f"the encoder of {joint} is lost" if np.isnan(read[i]) else what
            self.fail(FaultKind.ENCODER, i, what, ENCODER_ADVICE, k)
        elif off[i] > most:
            what = f"{joint} came to rest {off[i]:.3g} {unit} off its last set-point, more than {most:g} {unit}"
            advice = f"find out what blocks {joint}; then resume, which first returns to the path"
            self.fail(FaultKind.STALL, i, f"{what}: it was blocked or is too weak", advice, k)

    def judge_standing(self, k: int, read: Array, actual: Array) -> bool:
        """Return whether the arm is at rest when the set-points end; if it moves, record a fault.

        After a fault, and with a false encoder, it is at rest only as far as its brakes hold it.
        """
        dq, false = np.abs(self.dq[-1][-1]), find_false_reading(read, actual, self.options)
        slowest = AT_STANDSTILL if self.fault is None and false is None else BRAKED
        speed = dq / np.where(self.robot.prismatic, *reversed(slowest))
        i = int(speed.argmax())
        if speed[i] <= 1.0:
            return True
        joint = self.robot.joint_names[i]
        what = f"{joint} moves at {dq[i]:.3g} {joint_unit(self.robot, i)}/s when its set-points end"
        kind, why, advice = FaultKind.STALL, "it is too weak", f"find out what moves {joint}; then resume"
        if false is not None:
            i, kind, advice = false, FaultKind.ENCODER, ENCODER_ADVICE
            why = f"the encoder of {self.robot.joint_names[i]} reads a false position"
        if self.fault is None:
            self.fail(kind, i, f"{what}: {why}; the brakes were applied", advice, k)
        return False

    def judge_end(self) -> tuple[ExecutionStatus, str, str]:
        """Return status, reason and advice of an execution that has come to rest."""
        if self.fault is not None:
            return ExecutionStatus.FAULT, self.fault.reason, self.fault.advice
        if self.requested and self.stop is not None and not self.at_goal:
            begun = self.motion.end - self.stop.trajectory.end
            return ExecutionStatus.STOPPED, f"stopped on request; the stop began at t = {begun:.6g} s", RESUME_ADVICE
        return ExecutionStatus.DONE, "", ""
