"""Goals for a joint_trajectory_controller: a plan with its stops while it runs, and the motions of a stream."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from optik.errors import InvalidInput, NoSolution
from optik.scene.files import NANOSECONDS
from optik.types import Array
from planners.cell.drives import base
from planners.cell.drives._run import RESUME_ADVICE, EncoderMonitor, EventQueue, plan_stop_at
from planners.cell.drives.base import Drive, Execution, ExecutionStatus, Fault, FaultKind, Setpoints
from planners.certificate.violation import Allow
from planners.following.failure import joint_unit
from planners.motion import Motion
from planners.plan import Plan
from planners.ros.export import Form, JointNames, message_of, ros_message
from planners.ros.monitor import JointStates, MotionRecord
from planners.ros.transport import Goal, GoalState, write_time
from planners.streams.result import Retargeted
from planners.streams.stream import Stream
from planners.trajectory import cut_after, join
from planners.trajectory.trajectory import sample_states

# ---------------- goals for a joint_trajectory_controller


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
    return plan.with_motion(sent.trajectory, sent.certificate), message


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
    """Return the plan stretched by `ROOM`, or the plan itself if it has a requested tool speed."""
    return plan if plan.speed is not None else plan.with_motion(plan.trajectory.stretched(1.0 + ROOM))


def make_stops(sent: Plan, every: float, joint_names: JointNames, allow: Allow = ()) -> Stops:
    """Return the stops from equally spaced instants of a motion; they are computed before it is sent."""
    found: list[TimedStop] = []
    reason, took = "", 0.0
    t = min(every, 0.5 * sent.trajectory.end)
    while t < sent.trajectory.end - 0.5 * every:
        since = perf_counter()
        try:
            stop = replace(plan_stop_at(sent, t, 1.0 - 0.5 * ROOM, allow), limits=sent.limits)
            found.append(TimedStop(t, *make_message(stop, joint_names, allow)))
        except (NoSolution, InvalidInput) as error:
            reason = reason or f"at t = {t:.6g} s: {error}"
        last, took = took, perf_counter() - since
        if last:  # the first one of a process compiles
            every = max(every, min(last, took) * sent.trajectory.end / PREPARING)
        t += every
    return Stops(found, every, reason)


# ---------------- a goal of a RosDrive while it runs


POLL = 0.01
"""Polling interval of a running goal [s]: half the usual interval of joint states."""
CONFIRMED = 0.3
"""Longest time from the instant of a stop to its first feedback [s]; controllers send feedback at 20 Hz by default."""
FROZEN = "repair the encoder or its driver, or see what blocks the joint; then resume"
"""Advice for a joint whose reading does not change while its set-point does."""
TOLERANCES = {-4: "its path tolerance was violated", -5: "its goal tolerance was violated"}
"""Error codes of ``FollowJointTrajectory`` for a joint that does not follow, in words."""


class RosOptions(NamedTuple):
    """The largest distance from the start [rad, m], the largest age of a joint state and waiting times [s]; see `RosDrive`."""

    start_tolerance: float
    state_age: float
    patience: float
    grace: float
    latency: float
    stops_every: float


@dataclass
class RosRun:
    """The state of a running execution."""

    drive: Drive
    joints: JointStates
    options: RosOptions
    plan: Plan  # with the motion after controller interpolation
    goal: Goal  # of the plan, or of its stop
    stops: Stops
    notes: tuple[str, ...]
    stop: Plan | None = None
    fault: Fault | None = None
    requested: bool = False
    cancelled: str = ""

    def __post_init__(self) -> None:
        self.robot, self.transport = self.drive.robot, self.joints.transport
        self.motion, self.events = self.plan.trajectory, EventQueue(self.plan)
        self.record = MotionRecord(self.joints)
        self.ended = 0.0  # time of the motion at which the goal ended or was given up [s]
        self._stop_stamp = 0  # instant of the stop on the controller's clock [ns]
        self._give_up = 0.0
        self._encoders = EncoderMonitor()

    # ------------------------------------------------------------ the loop

    def follow(self, stop_test: Callable[[float], bool], watch: base.Watcher | None) -> Execution:
        """Follow the goal until it has ended, and return the record of the execution."""
        try:
            self._loop(stop_test, watch)
        except BaseException:  # from the caller's functions, or Ctrl-C: the arm must not go on unattended
            if not self._stopping and not self.goal.ended:
                self._stop()
            raise
        result, patience = self.goal.result, self.options.patience
        if result is not None and result.state is GoalState.UNKNOWN and not self.cancelled:
            what = f"the end of the goal is not known ({result.words})"
            advice = "make sure that the arm is at rest, and read the controller's log; then resume"
            self._fail(FaultKind.CONTROLLER, what, advice)
            self._cancel("its end is not known")
            # if the cancellation is not accepted, the motion continues to its end
            patience += max(self.motion.end - self.record.now, 0.0)
        self.ended = max(self.record.now, 0.0)
        if self.goal.refused:
            self.transport.cancel(self.goal)
        if self.goal.accepted:
            self._settle(watch, patience)
        return self._report()

    def _loop(self, stop_test: Callable[[float], bool], watch: base.Watcher | None) -> None:
        """Poll the goal until it has ended or its connection is lost."""
        patience, grace = self.options.patience, self.options.grace
        while not (self.goal.ended or self.transport.lost or (self.cancelled and self.record.now > self._give_up)):
            self.goal.wait(lambda: self.goal.ended, POLL)
            self._look(watch)
            if self.cancelled:
                continue
            if not self.goal.accepted and self.record.now > patience:
                what = f"the controller did not accept the goal within {patience:g} s; it may still accept it later"
                advice = "make sure that the arm is at rest, and read the controller's log"
                self._fail(FaultKind.CONNECTION, what, advice)
                self._cancel("it was not accepted in time")
            elif self.record.now > self.motion.end + grace:
                what = f"no result arrived within {grace:g} s after the {self.motion.end:.6g} s of the motion"
                advice = "find out what blocks the arm, check the controller's goal tolerances; then resume"
                self._fail(FaultKind.STALL, what, advice)
                self._cancel("it did not end in time")
            elif not self._stopping and stop_test(max(self.record.now, 0.0)):
                self.requested = True
                self._stop()

    @property
    def _stopping(self) -> bool:
        return self.requested or self.fault is not None

    def _wait_for_acceptance(self, stop: Goal, until: float) -> bool:
        """Return whether the controller accepts the goal of a stop before a time of the motion [s]."""
        while not (stop.accepted or stop.ended or self.transport.lost) and self.record.now < until:
            stop.wait(lambda: stop.accepted or stop.ended, POLL)
            self._look(None)
        return stop.accepted

    def _look(self, watch: base.Watcher | None) -> None:
        """Record what is heard; stop if joint states no longer arrive, or no longer change."""
        (q, _, _, at), new = self.record.listen(self.goal, self.motion)
        t = max(self.record.now, 0.0)
        events = self.events.raise_until(t) if self.record.begun is not None else ()
        if (new or events) and watch is not None:
            watch(base.Moment(t, self.motion(min(t, self.motion.end)), q.copy(), q.copy(), events))
        begun = self.record.begun is not None
        if begun and not (self._stopping or self.transport.lost or self.goal.ended):
            self._check_encoders(q, at)

    def _check_encoders(self, q: Array, at: float) -> None:
        """Stop if a joint is no longer measured, or if its reading does not change for too long while it should move."""
        names, lost, age = self.robot.joint_names, np.flatnonzero(~np.isfinite(q)), self.joints.age
        if lost.size:
            self._fail(FaultKind.ENCODER, *self.joints.explain_unknown(q, age), names[lost[0]])
            self._stop()
            return
        t = at - self.record.start
        moved = self._encoders.update(q, self.motion(min(max(t, 0.0), self.motion.end)), at)
        frozen = np.flatnonzero((moved > self.options.start_tolerance) & (self._encoders.seconds(at) > age))
        if frozen.size:
            i = int(frozen[0])
            name, unit = names[i], joint_unit(self.robot, i)
            what = f"{name} reads {q[i]:.6g} {unit} for more than {age:g} s while its set-point moved by {moved[i]:.3g} {unit}"
            self._fail(FaultKind.ENCODER, f"{what}: its encoder is frozen, or it is blocked", FROZEN, name)
            self._stop()

    # ------------------------------------------------------------ stopping

    def _stop(self) -> None:
        """Replace the goal by the next certified stop; cancel it if there is no stop or the stop is not accepted."""
        if self.record.begun is None or self.record.stamp is None:
            self._cancel("no feedback has shown the controller's position on the motion")
            return
        # The delay of the feedback is unknown. The goal did not begin before it was sent, which bounds the time of the motion.
        # The stop is assumed to travel no longer than the goal and its fastest feedback together.
        latest, latency = time.monotonic() - self.record.sent, max(self.options.latency, self.record.trips[0])
        stop = next((each for each in self.stops.found if each.t >= latest + latency), None)
        if stop is None:
            if self.motion.end - self.record.now <= self.options.latency + 2.0 * self.stops.every:
                self.notes += ("the motion ends at about the time of the earliest stop: it is not replaced",)
            elif self.stops.found and latency > self.options.latency:
                late = "every certified stop may arrive too late"
                self._cancel(f"{late}: goal and feedback take at least {latency:.3g} s")
            else:
                self._cancel("no stop from here could be certified")
            return
        stamp = self.record.stamp + round(stop.t * NANOSECONDS)
        header = stop.message["header"] | {"stamp": write_time(stamp)}
        goal = self.transport.send(stop.message | {"header": header})
        if self._wait_for_acceptance(goal, stop.t + CONFIRMED + self.record.trips[1]):
            self.goal, self.stop, self._stop_stamp = goal, stop.plan, stamp
            self.motion = join(cut_after(self.motion, stop.t), stop.plan.trajectory)
            self.events.replace_after(stop.t, stop.plan)
            return
        self.transport.cancel(goal)
        self._cancel(f"the controller did not accept the stop{f': {goal.refused}' if goal.refused else ''}")

    def _cancel(self, why: str) -> None:
        """Ask the controller to cancel the goal."""
        self.cancelled, self._give_up = why, self.record.now + self.options.patience
        self.transport.cancel(self.goal)
        self.notes += (f"the goal was cancelled ({why}): the stop that followed was the controller's own",)

    def _settle(self, watch: base.Watcher | None, patience: float) -> None:
        """Wait until the joint states show the arm at rest; after `patience` [s] note that it moves."""
        until, count = time.monotonic() + patience, len(self.record.samples)
        while time.monotonic() < until and not self.transport.lost:
            self._look(watch)
            if len(self.record.samples) > count + 1 and self.record.is_at_rest(self.options.start_tolerance):
                return
            time.sleep(POLL)
        self.notes += ("the joint states do not show the arm at rest",)

    # ------------------------------------------------------------ the report

    def _fail(self, kind: FaultKind, reason: str, advice: str, joint: str | None = None) -> None:
        if self.fault is None:
            self.fault = Fault(kind, max(self.record.now, 0.0), joint, reason, advice)

    def _judge(self) -> None:
        """Record a fault if the goal did not end as it should."""
        result, refused = self.goal.result, self.goal.refused
        if self.transport.lost and result is None:
            what = f"{self.transport.lost} while a goal ran: it is not known whether the arm still moves"
            self._fail(FaultKind.CONNECTION, what, "make sure that the arm is at rest; connect again, then resume")
        elif refused:
            said = f"; it says: {self.transport.odd}" if self.transport.odd else ""
            advice = "read the controller's log; check the name of its action, its joints, and that it is active"
            self._fail(FaultKind.CONTROLLER, f"the controller did not accept the goal: {refused}{said}", advice)
        elif result is None:
            what = f"the goal was cancelled ({self.cancelled}), and no result arrived"
            self._fail(FaultKind.CONNECTION, what, "make sure that the arm is at rest")
        elif result.state is GoalState.SUCCEEDED or (result.state is GoalState.CANCELED and self.cancelled):
            self._judge_rest(result.state is GoalState.SUCCEEDED)
        else:
            joint, _, off = self._find_farthest(self.ended)
            if result.code in TOLERANCES:
                what = f"the controller ended the goal: {TOLERANCES[result.code]} ({result.words or result.code})"
                what += f"; {joint} was the farthest from its set-point, by {off}"
                self._fail(FaultKind.STALL, what, "find out what blocks the joint; then resume", joint)
            else:
                what = f"the controller ended the goal, {result.state.name.lower()}, with code {result.code}"
                advice = "read the controller's log; then resume"
                self._fail(FaultKind.CONTROLLER, f"{what}: {result.words or 'no message'}", advice)

    def _judge_rest(self, at_end: bool) -> None:
        """Record a fault if the arm is not at the end of the motion, or after a cancellation not on the path."""
        near, robot = self.options.start_tolerance, self.robot
        joint, distance, off = self._find_farthest(self.motion.end)
        if at_end and distance > near:
            what = f"the controller reports success, but {joint} is {off} from the end of the motion"
            advice = f"find out what blocks {joint}; then plan from the arm's present configuration"
            self._fail(FaultKind.STALL, what, advice, joint)
        elif not at_end and self.record.samples:
            grid = np.linspace(0.0, self.plan.joint_path.end, 2001)
            away = np.abs(self.plan.joint_path(grid) - self.record.samples[-1].q)
            k = int(away.max(axis=1).argmin())
            if away[k].max() > near:
                i = int(away[k].argmax())
                off = f"{robot.joint_names[i]} {away[k, i]:.3g} {joint_unit(robot, i)} off the path"
                what = f"the goal was cancelled ({self.cancelled}), and the arm came to rest with {off}"
                self._fail(FaultKind.CONTROLLER, what, "plan from the arm's present configuration")

    def _find_farthest(self, t: float) -> tuple[str, float, str]:
        """Return the joint with the largest deviation from the motion at a time, the deviation [rad, m], and in words."""
        at = self.record.samples[-1].q if self.record.samples else np.full(self.robot.n, np.nan)
        off = np.nan_to_num(np.abs(at - self.motion(min(t, self.motion.end))), nan=np.inf)
        i = int(off.argmax())
        return self.robot.joint_names[i], float(off[i]), f"{off[i]:.3g} {joint_unit(self.robot, i)}"

    def _report(self) -> Execution:
        """Return the record of the execution."""
        if self.fault is None:
            self._judge()
        status, reason, advice = ExecutionStatus.DONE, "", ""
        result = self.goal.result
        if self.fault is not None:
            status, reason, advice = ExecutionStatus.FAULT, self.fault.reason, self.fault.advice
        elif self.stop is not None:
            begun = self.motion.end - self.stop.trajectory.end
            status, advice = ExecutionStatus.STOPPED, RESUME_ADVICE
            reason = f"stopped on request; the stop began at t = {begun:.6g} s"
        elif self.cancelled and result is not None and result.state is not GoalState.SUCCEEDED:
            status, reason, advice = ExecutionStatus.STOPPED, f"stopped: {self.cancelled}", RESUME_ADVICE
        first = self.goal.first if self.stop is not None else None
        if first is not None and self._stop_stamp and first.stamp > self._stop_stamp:
            after = (first.stamp - self._stop_stamp) / NANOSECONDS
            note = f"the stop was first confirmed {after:.3g} s after its first instant"
            self.notes += (f"{note}: if it also arrived after that instant, the set-point jumped",)
        t, q, dq = self.record.collect()
        whole = result is not None and result.state is GoalState.SUCCEEDED
        count = t.size if whole else max(int(np.searchsorted(t, self.ended, side="right")), 1)
        period = float(np.median(np.diff(t))) if t.size > 1 else self.drive.period
        stream = Setpoints(period, t[:count], *sample_states(self.motion, np.minimum(t[:count], self.motion.end)))
        sent = self.goal.accepted
        return Execution(
            self.drive.name, self.robot, status, reason, advice, self.plan, self.stop,
            self.motion if sent else None, stream if sent else None,
            t, q, dq, None, q[:count], fault=self.fault, notes=self.notes, events=tuple(self.events.raised),
        )  # fmt: skip


# ---------------- a stream on a joint_trajectory_controller


SHORTEST_STEP = 1000
"""Least time between two points of a goal [ns]."""


def follow_by_goals(
    joints: JointStates, options: RosOptions, columns: dict[str, int], stream: Stream
) -> base.StreamRecord:
    """Send each motion of a stream before it begins; take no more targets if one is refused or the connection is lost."""
    if stream.budget < options.latency:
        expected = f"at least the latency of the drive, {options.latency:g} s"
        raise InvalidInput("budget", f"{stream.budget:g} s", expected)
    if not stream.realtime:
        raise InvalidInput("realtime", False, "True: the controller has its own clock")
    reason, advice = joints.wait_for_rest(options.patience)
    if reason:
        raise NoSolution(reason, advice=advice)
    transport, goals = joints.transport, list[Goal]()
    first, _, stamp, at = joints.read()
    before = next(stream)
    began = stamp + round((time.monotonic() - at) * NANOSECONDS)  # of the stream, on the robot's clock [ns]
    off = np.abs(first - before.q)
    if before.dq.any():
        raise InvalidInput("stream", "one that begins with a motion", "a stream that begins at rest")
    if not off.max() <= options.start_tolerance:
        where = f"{joints.robot.joint_names[int(off.argmax())]} is {off.max():.3g} off its start"
        raise InvalidInput("stream", where, "a stream that begins at the arm's present configuration")

    faults: list[str] = []

    def send(motion: Retargeted, begin: float) -> None:
        if faults:  # it would begin where a refused motion would have gone
            return
        times = np.round(motion.trajectory.knots * NANOSECONDS).astype(np.int64)
        times = times[np.append(np.diff(times) >= SHORTEST_STEP, True)]
        message = message_of(motion.trajectory, times, Form("quintic", columns))
        header = message["header"] | {"stamp": write_time(began + round(begin * NANOSECONDS))}
        goals.append(transport.send(message | {"header": header}))

    stream.announce, rows = send, [(before.t, before.q, first)]
    for now in iter(stream.advance, None):
        rows.append((now.t, now.q, joints.read().q))
        k = next((k for k, goal in enumerate(goals) if goal.refused), None)
        if (transport.lost or k is not None) and not faults:
            faults.append(transport.lost or f"the controller refused a motion: {goals[k or 0].refused}")
            stream.stop()
            for goal in goals[k + 1 :] if k is not None else ():
                transport.cancel(goal)
    return base.make_record(rows, stream, "; ".join(faults))
