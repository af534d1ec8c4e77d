"""The arm of a RosDrive, measured by joint states, and its goal while it runs: its end, and the stop that replaces it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from optik.scene.messages import NANOSECONDS
from optik.types import Array
from planners.cell.drives._checks import RESUME_ADVICE
from planners.cell.drives._ros_goals import Stops, find_instant
from planners.cell.drives._run import EncoderMonitor
from planners.cell.drives.base import Drive, Execution, ExecutionStatus, Fault, FaultKind, Moment, Watcher
from planners.cell.drives.setpoints import Setpoints
from planners.following.failure import joint_unit
from planners.plan import Plan
from planners.ros.replies import Feedback, GoalState, write_time
from planners.ros.transport import Goal, Transport
from planners.trajectory import cut_after, join
from planners.trajectory.controller import sample_states

REST_SPEED = 0.02
"""Largest velocity of a joint at rest [rad/s, m/s]: measured velocities are noisy."""
POLL = 0.01
"""Polling interval of a running goal [s]: half the usual interval of joint states."""
CONFIRMED = 0.3
"""Longest time from the instant of a stop to its first feedback [s]; controllers send feedback at 20 Hz by default."""
FROZEN = "repair the encoder or its driver, or see what blocks the joint; then resume"
"""Advice for a joint whose reading does not change while its set-point does."""
TOLERANCES = {-4: "its path tolerance was violated", -5: "its goal tolerance was violated"}
"""Error codes of ``FollowJointTrajectory`` for a joint that does not follow, in words."""


class Timing(NamedTuple):
    """The waiting times of a drive and the largest age of a joint state, as of `RosDrive` [s]."""

    state_age: float
    patience: float
    grace: float
    latency: float
    stops_every: float


class Measurement(NamedTuple):
    """The states of all joints: positions (n,) [rad, m], velocities (n,) [rad/s, m/s], and two times.

    ``stamp`` is the robot's time of the oldest joint state [ns]; ``at`` is the time of its arrival by `time.monotonic` [s].
    """

    q: Array
    dq: Array
    stamp: int
    at: float


class RosArm(Drive):
    """The base of `RosDrive`: an arm whose joints are measured by the joint states of a transport."""

    transport: Transport
    columns: dict[str, int]  # index of the joint of each name of the controller
    start_tolerance: float
    timing: Timing

    def measure(self) -> Array:
        """Return the positions of the latest joint states (n,) [rad, m]; NaN for a joint without a fresh state."""
        return self.read_states().q

    def read_states(self) -> Measurement:
        """Return the latest joint states; NaN for a joint without a fresh state."""
        q, dq = np.full((2, self.robot.n), np.nan)
        stamp, at = 0, time.monotonic()
        oldest, readings = at - self.timing.state_age, self.transport.readings
        for name, i in self.columns.items():
            reading = readings.get(name)
            if reading is not None and reading.fresh and reading.at >= oldest:
                q[i], dq[i] = reading.position, reading.velocity
                stamp, at = (reading.stamp, reading.at) if reading.at <= at else (stamp, at)
        return Measurement(q, dq, stamp, at)

    def wait_for_rest(self) -> tuple[str, str]:
        """Return reason and advice if the joint states do not show the arm at rest in time; empty strings otherwise."""
        until = time.monotonic() + self.timing.patience
        while time.monotonic() < until and not self.transport.lost:
            q, dq = self.read_states()[:2]
            if np.isfinite(q).all() and (np.abs(dq) <= REST_SPEED).all():
                return "", ""
            time.sleep(0.01)
        if self.transport.lost:
            return self.transport.lost, "make sure that the other side runs, and connect again"
        q, dq = self.read_states()[:2]
        if np.isfinite(q).all():
            mute = [name for name, unknown in zip(self.robot.joint_names, ~np.isfinite(dq), strict=True) if unknown]
            if mute:
                what = f"the joint states have no velocity of {', '.join(mute)}: it is not known whether the arm is at rest"
                return what, "use a joint state broadcaster that sends velocities"
            i = int(np.nanargmax(np.abs(dq)))
            what = (
                f"{self.robot.joint_names[i]} moves at {dq[i]:.3g} {joint_unit(self.robot, i)}/s; a plan begins at rest"
            )
            return what, "wait until the arm is at rest"
        return self.explain_unknown(q, self.timing.patience)

    def explain_unknown(self, q: Array, seconds: float) -> tuple[str, str]:
        """Return the reason why joints of q (n,) [rad, m] are NaN after a wait [s], and advice."""
        readings, waited = self.transport.readings, f"within {seconds:g} s"
        odd = f"; the latest message that could not be read: {self.transport.odd}" if self.transport.odd else ""
        if not readings:
            return f"no joint states arrived {waited}{odd}", "check that the joint state broadcaster runs"
        names = [name for name, i in self.columns.items() if not np.isfinite(q[i])]
        absent = [name for name in names if name not in readings]
        if absent:
            what = f"the joint states have no {', '.join(absent)}; they have {', '.join(readings)}"
            return what[:300], "pass joint_names, a mapping from the robot's joint names to the controller's"
        empty = [name for name in names if not np.isfinite(readings[name].position)]
        if empty:
            return f"the position of {', '.join(empty)} is NaN or infinite", "repair the encoder or its driver"
        what = f"the joint states of {', '.join(names)} are stale: none with a new stamp arrived {waited}{odd}"
        return what, "check that the joint state broadcaster and the robot's clock run"


@dataclass
class RosRun:
    """The state of a running execution."""

    drive: RosArm
    plan: Plan  # with the motion after controller interpolation
    goal: Goal  # of the plan, or of its stop
    stops: Stops
    notes: tuple[str, ...]
    stop: Plan | None = None
    fault: Fault | None = None
    requested: bool = False
    cancelled: str = ""
    samples: list[tuple[int, float, Array, Array]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.sent = time.monotonic()
        self.motion = self.plan.trajectory
        self.ended = 0.0  # time of the motion at which the goal ended or was given up [s]
        self.begun: float | None = None  # start of the motion by this machine's clock [s]; None before feedback
        self.stamp: int | None = None  # start of the motion on the controller's clock [ns]; None while it is unknown
        self._stop_stamp = 0  # instant of the stop on the controller's clock [ns]
        self._located: Feedback | None = None
        self._fastest = self._give_up = 0.0
        self._trips = (np.inf, 0.0)  # shortest and longest total travel time of the goal and a feedback message [s]
        self._encoders = EncoderMonitor()

    # ------------------------------------------------------------ the loop

    def follow(self, stop_test: Callable[[float], bool], watch: Watcher | None) -> Execution:
        """Follow the goal until it has ended, and return the record of the execution."""
        try:
            self._loop(stop_test, watch)
        except BaseException:  # from the caller's functions, or Ctrl-C: the arm must not go on unattended
            if not self._stopping and not self.goal.ended:
                self._stop()
            raise
        result, patience = self.goal.result, self.drive.timing.patience
        if result is not None and result.state is GoalState.UNKNOWN and not self.cancelled:
            what = f"the end of the goal is not known ({result.words})"
            advice = "make sure that the arm is at rest, and read the controller's log; then resume"
            self._fail(FaultKind.CONTROLLER, what, advice)
            self._cancel("its end is not known")
            # if the cancellation is not accepted, the motion continues to its end
            patience += max(self.motion.end - self.now, 0.0)
        self.ended = max(self.now, 0.0)
        if self.goal.refused:
            self.drive.transport.cancel(self.goal)
        if self.goal.accepted:
            self._settle(watch, patience)
        return self._report()

    def _loop(self, stop_test: Callable[[float], bool], watch: Watcher | None) -> None:
        """Poll the goal until it has ended or its connection is lost."""
        patience, grace = self.drive.timing.patience, self.drive.timing.grace
        while not (self.goal.ended or self.drive.transport.lost or (self.cancelled and self.now > self._give_up)):
            self.goal.wait(lambda: self.goal.ended, POLL)
            self._look(watch)
            if self.cancelled:
                continue
            if not self.goal.accepted and self.now > patience:
                self._fail(FaultKind.CONNECTION, *_describe_silence(patience))
                self._cancel("it was not accepted in time")
            elif self.now > self.motion.end + grace:
                self._fail(FaultKind.STALL, *_describe_delay(self.motion.end, grace))
                self._cancel("it did not end in time")
            elif not self._stopping and stop_test(max(self.now, 0.0)):
                self.requested = True
                self._stop()

    @property
    def now(self) -> float:
        """Time since the start of the motion, or since its goal was sent while the start is unknown [s]."""
        return time.monotonic() - self._start

    @property
    def _start(self) -> float:
        """Start of the motion on this machine's clock [s]; while it is unknown, the time at which its goal was sent."""
        return self.sent if self.begun is None else self.begun

    @property
    def _stopping(self) -> bool:
        return self.requested or self.fault is not None

    def _wait_for_acceptance(self, stop: Goal, until: float) -> bool:
        """Return whether the controller accepts the goal of a stop before a time of the motion [s]."""
        while not (stop.accepted or stop.ended or self.drive.transport.lost) and self.now < until:
            stop.wait(lambda: stop.accepted or stop.ended, POLL)
            self._look(None)
        return stop.accepted

    def _look(self, watch: Watcher | None) -> None:
        """Record a new joint state and the position of the controller; stop if joint states no longer arrive."""
        feedback = self.goal.feedback
        if feedback is not None and feedback is not self._located:
            self._locate(feedback, self.goal.heard)
        q, dq, stamp, at = self.drive.read_states()
        if np.isfinite(q).all() and (not self.samples or at > self.samples[-1][1]):
            self.samples.append((stamp, at, q, dq))
            if watch is not None:
                t = max(self.now, 0.0)
                watch(Moment(t, self.motion(min(t, self.motion.end)), q.copy(), q.copy()))
        if not self._stopping and not self.drive.transport.lost and self.begun is not None and not self.goal.ended:
            self._check_encoders(q, at)

    def _check_encoders(self, q: Array, at: float) -> None:
        """Stop if a joint is no longer measured, or if its reading does not change for too long while it should move."""
        names, lost, age = self.drive.robot.joint_names, np.flatnonzero(~np.isfinite(q)), self.drive.timing.state_age
        if lost.size:
            self._fail(FaultKind.ENCODER, *self.drive.explain_unknown(q, age), names[lost[0]])
            self._stop()
            return
        t = at - self._start
        moved = self._encoders.update(q, self.motion(min(max(t, 0.0), self.motion.end)), at)
        frozen = np.flatnonzero((moved > self.drive.start_tolerance) & (self._encoders.seconds(at) > age))
        if frozen.size:
            i = int(frozen[0])
            name, unit = names[i], joint_unit(self.drive.robot, i)
            what = f"{name} reads {q[i]:.6g} {unit} for more than {age:g} s while its set-point moved by {moved[i]:.3g} {unit}"
            self._fail(FaultKind.ENCODER, f"{what}: its encoder is frozen, or it is blocked", FROZEN, name)
            self._stop()

    def _locate(self, feedback: Feedback, heard: float) -> None:
        """Estimate the start of the motion from the desired state in a feedback message."""
        self._located = feedback
        order = [feedback.names.index(name) if name in feedback.names else -1 for name in self._names]
        if min(order) < 0:
            return
        q, dq = feedback.positions[order], np.nan_to_num(feedback.velocities[order])
        t = find_instant(self.motion, q, dq, heard - self._start)
        speed = float(np.abs(dq).max())
        if t is None or t <= 0.0 or t >= self.motion.end or speed < 0.5 * self._fastest:
            return  # near rest a small difference in position is a long time
        self._fastest = max(speed, self._fastest)
        self.begun = heard - t
        self.stamp = feedback.stamp - round(t * NANOSECONDS) if feedback.stamp else None
        trip = max(self.begun - self.sent, 0.0)
        self._trips = min(self._trips[0], trip), max(self._trips[1], trip)

    @property
    def _names(self) -> list[str]:
        """The controller's names of the joints in the order of the robot."""
        return sorted(self.drive.columns, key=lambda name: self.drive.columns[name])

    # ------------------------------------------------------------ stopping

    def _stop(self) -> None:
        """Replace the goal by the next certified stop; cancel it if there is no stop or the stop is not accepted."""
        if self.begun is None or self.stamp is None:
            self._cancel("no feedback has shown the controller's position on the motion")
            return
        # The delay of the feedback is unknown. The goal did not begin before it was sent, which bounds the time of the motion.
        # The stop is assumed to travel no longer than the goal and its fastest feedback together.
        latest, latency = time.monotonic() - self.sent, max(self.drive.timing.latency, self._trips[0])
        stop = next((each for each in self.stops.found if each.t >= latest + latency), None)
        if stop is None:
            if self.motion.end - self.now <= self.drive.timing.latency + 2.0 * self.stops.every:
                self.notes += ("the motion ends at about the time of the earliest stop: it is not replaced",)
            elif self.stops.found and latency > self.drive.timing.latency:
                self._cancel(
                    f"every certified stop may arrive too late: goal and feedback take at least {latency:.3g} s"
                )
            else:
                self._cancel("no stop from here could be certified")
            return
        stamp = self.stamp + round(stop.t * NANOSECONDS)
        header = stop.message["header"] | {"stamp": write_time(stamp)}
        goal = self.drive.transport.send(stop.message | {"header": header})
        if self._wait_for_acceptance(goal, stop.t + CONFIRMED + self._trips[1]):
            self.goal, self.stop, self._stop_stamp = goal, stop.plan, stamp
            self.motion = join(cut_after(self.motion, stop.t), stop.plan.trajectory)
            return
        self.drive.transport.cancel(goal)
        self._cancel(f"the controller did not accept the stop{f': {goal.refused}' if goal.refused else ''}")

    def _cancel(self, why: str) -> None:
        """Ask the controller to cancel the goal."""
        self.cancelled, self._give_up = why, self.now + self.drive.timing.patience
        self.drive.transport.cancel(self.goal)
        self.notes += (f"the goal was cancelled ({why}): the stop that followed was the controller's own",)

    def _settle(self, watch: Watcher | None, patience: float) -> None:
        """Wait until the joint states show the arm at rest; after `patience` [s] note that it moves."""
        until, count = time.monotonic() + patience, len(self.samples)
        while time.monotonic() < until and not self.drive.transport.lost:
            self._look(watch)
            if len(self.samples) > count + 1 and self._is_at_rest():
                return
            time.sleep(POLL)
        self.notes += ("the joint states do not show the arm at rest",)

    def _is_at_rest(self) -> bool:
        """Return whether the last two joint states show an arm at rest."""
        (_, t, q, _), (_, t_after, q_after, dq) = self.samples[-2:]
        slow = self.drive.start_tolerance / 10.0
        return bool(
            (np.abs(q_after - q) <= slow * max(t_after - t, 1.0)).all() and not (np.abs(dq) > slow * 10.0).any()
        )

    # ------------------------------------------------------------ the report

    def _fail(self, kind: FaultKind, reason: str, advice: str, joint: str | None = None) -> None:
        if self.fault is None:
            self.fault = Fault(kind, max(self.now, 0.0), joint, reason, advice)

    def _judge(self) -> None:
        """Record a fault if the goal did not end as it should."""
        result, refused = self.goal.result, self.goal.refused
        if self.drive.transport.lost and result is None:
            what = f"{self.drive.transport.lost} while a goal ran: it is not known whether the arm still moves"
            self._fail(FaultKind.CONNECTION, what, "make sure that the arm is at rest; connect again, then resume")
        elif refused:
            said = f"; it says: {self.drive.transport.odd}" if self.drive.transport.odd else ""
            advice = "read the controller's log; check the name of its action, its joints, and that it is active"
            self._fail(FaultKind.CONTROLLER, f"the controller did not accept the goal: {refused}{said}", advice)
        elif result is None:
            what = f"the goal was cancelled ({self.cancelled}), and no result arrived"
            self._fail(FaultKind.CONNECTION, what, "make sure that the arm is at rest")
        elif result.state is GoalState.SUCCEEDED or (result.state is GoalState.CANCELED and self.cancelled):
            self._judge_rest(result.state is GoalState.SUCCEEDED)
        else:
            joint, off = self._find_farthest(self.ended)
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
        near, robot = self.drive.start_tolerance, self.drive.robot
        if at_end and self._deviations(self.motion.end).max() > near:
            joint, off = self._find_farthest(self.motion.end)
            what = f"the controller reports success, but {joint} is {off} from the end of the motion"
            advice = f"find out what blocks {joint}; then plan from the arm's present configuration"
            self._fail(FaultKind.STALL, what, advice, joint)
        elif not at_end and self.samples:
            grid = np.linspace(0.0, self.plan.joint_path.end, 2001)
            away = np.abs(self.plan.joint_path(grid) - self.samples[-1][2])
            k = int(away.max(axis=1).argmin())
            if away[k].max() > near:
                i = int(away[k].argmax())
                off = f"{robot.joint_names[i]} {away[k, i]:.3g} {joint_unit(robot, i)} off the path"
                what = f"the goal was cancelled ({self.cancelled}), and the arm came to rest with {off}"
                self._fail(FaultKind.CONTROLLER, what, "plan from the arm's present configuration")

    def _deviations(self, t: float) -> Array:
        """Return the deviations of the joints (n,) from the motion at a time [rad, m]; infinite where unknown."""
        at = self.samples[-1][2] if self.samples else np.full(self.drive.robot.n, np.nan)
        return np.nan_to_num(np.abs(at - self.motion(min(t, self.motion.end))), nan=np.inf)

    def _find_farthest(self, t: float) -> tuple[str, str]:
        """Return the joint with the largest deviation from the motion at a time, and that deviation with its unit."""
        off = self._deviations(t)
        i = int(off.argmax())
        return self.drive.robot.joint_names[i], f"{off[i]:.3g} {joint_unit(self.drive.robot, i)}"

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
        t, q, dq = self._collect_samples()
        whole = result is not None and result.state is GoalState.SUCCEEDED
        count = t.size if whole else max(int(np.searchsorted(t, self.ended, side="right")), 1)
        period = float(np.median(np.diff(t))) if t.size > 1 else self.drive.period
        stream = Setpoints(period, t[:count], *sample_states(self.motion, np.minimum(t[:count], self.motion.end)))
        sent = self.goal.accepted
        return Execution(
            self.drive.name, self.drive.robot, status, reason, advice, self.plan, self.stop,
            self.motion if sent else None, stream if sent else None,
            t, q, dq, None, q[:count], fault=self.fault, notes=self.notes,
        )  # fmt: skip

    def _collect_samples(self) -> tuple[Array, Array, Array]:
        """Return times since the start, positions and velocities of the joint states, by the robot's clock if it is known."""
        rows = []
        for stamp, at, q, dq in self.samples:
            by_robot = stamp and self.stamp is not None
            t = (stamp - self.stamp) / NANOSECONDS if by_robot and self.stamp else at - self._start
            rows.append((t, q, dq))
        rows = [row for i, row in enumerate(rows) if row[0] > 0.0 and (i == 0 or row[0] > rows[i - 1][0])]
        first = (0.0, self.samples[0][2] if self.samples else self.drive.measure(), np.zeros(self.drive.robot.n))
        rows.insert(0, first)
        times, positions, velocities = (np.array(column) for column in zip(*rows, strict=True))
        return times, positions, velocities


def _describe_silence(patience: float) -> tuple[str, str]:
    """Return reason and advice for a goal without any answer."""
    what = f"the controller did not accept the goal within {patience:g} s; it may still accept it later"
    return what, "make sure that the arm is at rest, and read the controller's log"


def _describe_delay(seconds: float, grace: float) -> tuple[str, str]:
    """Return reason and advice for a goal that did not end in time."""
    what = f"no result arrived within {grace:g} s after the {seconds:.6g} s of the motion"
    return what, "find out what blocks the arm, check the controller's goal tolerances; then resume"
