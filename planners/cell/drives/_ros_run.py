"""One goal of a RosDrive while it runs: what the joint states say, what ends it, and the certified stop that replaces it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from optik.types import Array
from planners.cell.drives._ros_goals import Stops, find_instant
from planners.cell.drives._run import EncoderMonitor
from planners.cell.drives.base import Execution, ExecutionStatus, Fault, FaultKind, Moment, Watcher
from planners.cell.setpoints import Setpoints
from planners.controller import states
from planners.plan import Plan
from planners.ros.replies import NANOSECONDS, Feedback, GoalState, write_time
from planners.ros.transport import Goal
from planners.splice import cut_after, join

if TYPE_CHECKING:
    from planners.cell.drives.ros import RosDrive

POLL = 0.01
"""How often a running goal is looked at [s]: twice as often as joint states usually come."""
CONFIRMED = 0.3
"""How long after its instant a stop may be confirmed [s]: by its first feedback, which controllers send at 20 Hz by default."""
FROZEN = "repair the encoder or its driver, or see what blocks the joint; then resume"
"""Advice for a joint whose reading does not change while its set-point does."""
TOLERANCES = {-4: "it left its path tolerance", -5: "it missed its goal tolerance"}
"""Error codes of ``FollowJointTrajectory`` that mean that a joint does not follow, in words."""


@dataclass
class Run:
    """The state of a running execution.

    Attributes
    ----------
    drive : RosDrive
        The drive.
    plan : Plan
        What was sent, as the controller interpolates it.
    goal : Goal
        The goal that runs: that of the plan, or of its stop.
    stops : Stops
        What can replace it.
    notes : tuple of str
        What the reader must know.
    """

    drive: RosDrive
    plan: Plan
    goal: Goal
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
        self.ended = 0.0
        """When the goal had ended, or nothing more was to be expected [s]."""
        self.begun: float | None = None
        """Start of the motion, by this machine's clock [s]; None as long as no feedback told."""
        self.stamp: int | None = None
        """The same by the controller's clock [ns]."""
        self._stop_stamp = 0
        """Instant of the stop by the controller's clock [ns]."""
        self._located: Feedback | None = None
        self._fastest = self._give_up = 0.0
        self._trips = (np.inf, 0.0)
        """Shortest and longest total travel time of the goal and a feedback message [s]."""
        self._encoders = EncoderMonitor()

    # ------------------------------------------------------------ the loop

    def follow(self, asking: Callable[[float], bool], watch: Watcher | None) -> Execution:
        """Follow the goal until it has ended or a stop is requested."""
        try:
            self._loop(asking, watch)
        except BaseException:  # from the caller's functions, or Ctrl-C: the arm must not go on unattended
            if not self._stopping and not self.goal.ended:
                self._stop()
            raise
        result, patience = self.goal.result, self.drive.timing.patience
        if result is not None and result.state is GoalState.UNKNOWN and not self.cancelled:
            what = f"how the goal ended is not known ({result.words})"
            self._fail(
                FaultKind.CONTROLLER,
                what,
                "make sure that the arm is at rest, and read the controller's log; then resume",
            )
            self._cancel("its end is not known")
            patience += max(
                self.motion.end - self.now, 0.0
            )  # if the cancellation is not accepted, the motion continues to its end
        self.ended = max(self.now, 0.0)
        if self.goal.refused:
            self.drive.transport.cancel(self.goal)
        if self.goal.accepted:
            self._settle(watch, patience)
        return self._report()

    def _loop(self, asking: Callable[[float], bool], watch: Watcher | None) -> None:
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
            elif not self._stopping and asking(max(self.now, 0.0)):
                self.requested = True
                self._stop()

    @property
    def now(self) -> float:
        """Time since the start of the motion, as far as it is known [s]."""
        return time.monotonic() - (self.sent if self.begun is None else self.begun)

    @property
    def _stopping(self) -> bool:
        return self.requested or self.fault is not None

    def _taken(self, stop: Goal, until: float) -> bool:
        """Wait until the controller has accepted the goal of a stop, to a time of the motion [s] at most."""
        while not (stop.accepted or stop.ended or self.drive.transport.lost) and self.now < until:
            stop.wait(lambda: stop.accepted or stop.ended, POLL)
            self._look(None)
        return stop.accepted

    def _look(self, watch: Watcher | None) -> None:
        """Record a new joint state and the position of the controller; stop if joint states no longer arrive."""
        feedback = self.goal.feedback
        if feedback is not None and feedback is not self._located:
            self._locate(feedback, self.goal.heard)
        q, dq, stamp, at = self.drive.measured()
        if np.isfinite(q).all() and (not self.samples or at > self.samples[-1][1]):
            self.samples.append((stamp, at, q, dq))
            if watch is not None:
                t = max(self.now, 0.0)
                watch(Moment(t, self.motion(min(t, self.motion.end)), q.copy(), q.copy()))
        if not self._stopping and not self.drive.transport.lost and self.begun is not None and not self.goal.ended:
            self._look_at_encoders(q, at)

    def _look_at_encoders(self, q: Array, at: float) -> None:
        """Stop if a joint is no longer measured, or if its reading does not change for too long while it should move."""
        names, lost, age = self.drive.robot.joint_names, np.flatnonzero(~np.isfinite(q)), self.drive.timing.state_age
        if lost.size:
            self._fail(FaultKind.ENCODER, *self.drive.unknown(q, age), names[lost[0]])
            self._stop()
            return
        t = at - (self.begun or self.sent)
        moved = self._encoders.update(q, self.motion(min(max(t, 0.0), self.motion.end)), at)
        frozen = np.flatnonzero((moved > self.drive.start_tolerance) & (self._encoders.seconds(at) > age))
        if frozen.size:
            name, i = names[frozen[0]], frozen[0]
            what = f"{name} reads {q[i]:.6g} for more than {age:g} s while its set-point moved by {moved[i]:.3g}"
            self._fail(FaultKind.ENCODER, f"{what}: its encoder is frozen, or it is blocked", FROZEN, name)
            self._stop()

    def _locate(self, feedback: Feedback, heard: float) -> None:
        """Find the instant of the motion at which the controller is, from its desired state."""
        self._located = feedback
        order = [feedback.names.index(name) if name in feedback.names else -1 for name in self._names]
        if min(order) < 0:
            return
        q, dq = feedback.positions[order], np.nan_to_num(feedback.velocities[order])
        t = find_instant(self.motion, q, dq, heard - (self.sent if self.begun is None else self.begun))
        speed = float(np.abs(dq).max())
        if t is None or t <= 0.0 or t >= self.motion.end or speed < 0.5 * self._fastest:
            return  # near rest a small distance is a long time
        self._fastest = max(speed, self._fastest)
        self.begun = heard - t
        self.stamp = feedback.stamp - round(t * NANOSECONDS) if feedback.stamp else None
        trip = max(self.begun - self.sent, 0.0)
        self._trips = min(self._trips[0], trip), max(self._trips[1], trip)

    @property
    def _names(self) -> list[str]:
        """Return the controller's names of the joints in the order of the robot."""
        return sorted(self.drive.columns, key=lambda name: self.drive.columns[name])

    # ------------------------------------------------------------ stopping

    def _stop(self) -> None:
        """Replace the goal by the next certified stop; where there is none, or the controller does not take it, cancel."""
        if self.begun is None or self.stamp is None:
            self._cancel("no feedback tells where the controller is")
            return
        # The delay of the feedback is not known, but the goal did not begin before it was sent: the controller is at most
        # here on its motion. The stop is not expected to travel longer than the goal and its fastest answer did together.
        latest, latency = time.monotonic() - self.sent, max(self.drive.timing.latency, self._trips[0])
        stop = next((each for each in self.stops.found if each.t >= latest + latency), None)
        if stop is None:
            if self.motion.end - self.now <= self.drive.timing.latency + 2.0 * self.stops.every:
                self.notes += ("the motion ends about when a stop could: it is not replaced",)
            elif self.stops.found and latency > self.drive.timing.latency:
                self._cancel(f"every certified stop might arrive too late: an answer takes at least {latency:.3g} s")
            else:
                self._cancel("no stop from here could be certified")
            return
        stamp = self.stamp + round(stop.t * NANOSECONDS)
        header = stop.message["header"] | {"stamp": write_time(stamp)}
        goal = self.drive.transport.send(stop.message | {"header": header})
        if self._taken(goal, stop.t + CONFIRMED + self._trips[1]):
            self.goal, self.stop, self._stop_stamp = goal, stop.plan, stamp
            self.motion = join(cut_after(self.motion, stop.t), stop.plan.trajectory)
            return
        self.drive.transport.cancel(goal)
        self._cancel(f"the controller did not take the stop{f': {goal.refused}' if goal.refused else ''}")

    def _cancel(self, why: str) -> None:
        """Ask the controller to cancel the goal; that is waited for, for a while only."""
        self.cancelled, self._give_up = why, self.now + self.drive.timing.patience
        self.drive.transport.cancel(self.goal)
        self.notes += (f"the goal was cancelled ({why}): how the arm stopped then is the controller's own",)

    def _settle(self, watch: Watcher | None, patience: float) -> None:
        """Wait until the joint states show the arm at rest, and note that state; after `patience` [s] note that it moves."""
        until, count = time.monotonic() + patience, len(self.samples)
        while time.monotonic() < until and not self.drive.transport.lost:
            self._look(watch)
            if len(self.samples) > count + 1 and self._stands():
                return
            time.sleep(POLL)
        self.notes += ("whether the arm is at rest is not known: its joint states do not show it",)

    def _stands(self) -> bool:
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
        """Turn the goal's end into a fault where it is one."""
        result, refused = self.goal.result, self.goal.refused
        if self.drive.transport.lost and result is None:
            what = f"{self.drive.transport.lost} while a goal ran: whether the arm still moves is not known"
            self._fail(FaultKind.CONNECTION, what, "see that the arm stands; connect again, then resume")
        elif refused:
            said = f"; it says: {self.drive.transport.odd}" if self.drive.transport.odd else ""
            advice = "the controller's log; the name of its action, its joints, and that it is active"
            self._fail(FaultKind.CONTROLLER, f"the controller did not take the goal: {refused}{said}", advice)
        elif result is None:
            what = f"the goal was cancelled ({self.cancelled}), and its end was not told"
            self._fail(FaultKind.CONNECTION, what, "see that the arm stands")
        elif result.state is GoalState.SUCCEEDED or (result.state is GoalState.CANCELED and self.cancelled):
            self._judge_rest(result.state is GoalState.SUCCEEDED)
        else:
            joint, off = self._farthest(self.ended)
            if result.code in TOLERANCES:
                what = f"the controller ended the goal: {TOLERANCES[result.code]} ({result.words or result.code})"
                what += f"; {joint} was {off:.3g} off its set-point, the most of all"
                self._fail(FaultKind.STALL, what, "see what holds the joint; then resume", joint)
            else:
                what = f"the controller ended the goal, {result.state.name.lower()}, with code {result.code}"
                self._fail(FaultKind.CONTROLLER, f"{what}: {result.words or 'no words'}", "its log; then resume")

    def _judge_rest(self, at_end: bool) -> None:
        """Record a fault if the arm is not at the end of the motion, or after a cancellation not on the path."""
        near = self.drive.start_tolerance
        joint, off = self._farthest(self.motion.end)
        if at_end and off > near:
            what = f"the controller says that it is there, and {joint} stands {off:.3g} from the motion's end"
            self._fail(FaultKind.STALL, what, "see what holds it; then a new plan from where it stands", joint)
        elif not at_end and self.samples:
            grid = np.linspace(0.0, self.plan.joint_path.end, 2001)
            away = float(np.abs(self.plan.joint_path(grid) - self.samples[-1][2]).max(axis=1).min())
            if away > near:
                what = f"the goal was cancelled ({self.cancelled}), and the arm came to rest {away:.3g} off the path"
                self._fail(FaultKind.CONTROLLER, what, "a new plan from where it stands")

    def _farthest(self, t: float) -> tuple[str, float]:
        """Return the joint with the largest deviation from the motion at a time, and its deviation."""
        at = self.samples[-1][2] if self.samples else np.full(self.drive.robot.n, np.nan)
        off = np.nan_to_num(np.abs(at - self.motion(min(t, self.motion.end))), nan=np.inf)
        return self.drive.robot.joint_names[int(off.argmax())], float(off.max())

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
            status, advice = ExecutionStatus.STOPPED, "resume goes on"
            reason = f"stopped on request; the stop began at t = {begun:.6g} s"
        elif self.cancelled and result is not None and result.state is not GoalState.SUCCEEDED:
            status, reason, advice = ExecutionStatus.STOPPED, f"stopped: {self.cancelled}", "resume goes on"
        first = self.goal.first if self.stop is not None else None
        if first is not None and self._stop_stamp and first.stamp > self._stop_stamp:
            after = (first.stamp - self._stop_stamp) / NANOSECONDS
            note = f"the stop was first confirmed {after:.3g} s after it should have begun"
            self.notes += (f"{note}: if it also arrived after that, the set-point jumped",)
        t, q, dq = self._recorded()
        whole = result is not None and result.state is GoalState.SUCCEEDED
        count = t.size if whole else max(int(np.searchsorted(t, self.ended, side="right")), 1)
        period = float(np.median(np.diff(t))) if t.size > 1 else self.drive.period
        stream = Setpoints(period, t[:count], *states(self.motion, np.minimum(t[:count], self.motion.end)))
        sent = self.goal.accepted
        return Execution(
            self.drive.name, self.drive.robot, status, reason, advice, self.plan, self.stop,
            self.motion if sent else None, stream if sent else None,
            t, q, dq, None, q[:count], fault=self.fault, notes=self.notes,
        )  # fmt: skip

    def _recorded(self) -> tuple[Array, Array, Array]:
        """Return times since the start, positions and velocities of the joint states, by the robot's clock if it is known."""
        rows = []
        for stamp, at, q, dq in self.samples:
            by_robot = stamp and self.stamp is not None
            t = (stamp - self.stamp) / NANOSECONDS if by_robot and self.stamp else at - (self.begun or self.sent)
            rows.append((t, q, dq))
        rows = [row for i, row in enumerate(rows) if row[0] > 0.0 and (i == 0 or row[0] > rows[i - 1][0])]
        first = (0.0, self.samples[0][2] if self.samples else self.drive.measure(), np.zeros(self.drive.robot.n))
        rows.insert(0, first)
        return (
            np.array([row[0] for row in rows]),
            np.array([row[1] for row in rows]),
            np.array([row[2] for row in rows]),
        )


def _describe_silence(patience: float) -> tuple[str, str]:
    """Return reason and advice for a goal without any answer."""
    what = f"the controller did not say within {patience:g} s that it takes the goal; it may take it later all the same"
    return what, "see that the arm stands, and the controller's log"


def _describe_delay(seconds: float, grace: float) -> tuple[str, str]:
    """Return reason and advice for a goal that did not end in time."""
    what = f"no result came within {grace:g} s after the {seconds:.6g} s of the motion"
    return what, "see what holds the arm, and the controller's goal tolerances; then resume"
