"""One goal of a RosDrive while it runs: what the joint states say, what ends it, and the certified stop that replaces it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.cell.drives.base import Execution, ExecutionStatus, Fault, FaultKind, Moment, Watcher
from planners.cell.setpoints import Setpoints
from planners.cell.transports._messages import NANOSECONDS, Feedback, GoalState, time_of
from planners.cell.transports.base import Goal
from planners.controller import states
from planners.files._ros.export import JointNames, ros_message
from planners.plan import Plan
from planners.replan import replan
from planners.splice import joined, start_of
from planners.trajectory import Trajectory

if TYPE_CHECKING:
    from planners.cell.drives.ros import RosDrive

POLL = 0.01
"""How often a running goal is looked at [s]: twice as often as joint states usually come."""
DESIRED = 1e-3
"""Largest distance of a controller's desired state from the motion that was sent [rad, m]. Farther off it executes
something else, and nothing is known of where it is."""
NEAR = 0.5
"""How far from the expected instant the controller's desired state is looked for [s]: it starts late, or is slowed."""
TOLERANCES = {-4: "it left its path tolerance", -5: "it missed its goal tolerance"}
"""Error codes of ``FollowJointTrajectory`` that mean that a joint does not follow, in words."""


def message_for(plan: Plan, joint_names: JointNames) -> tuple[Plan, dict[str, Any]]:
    """Make the message of a plan, and certify what the controller makes of it.

    Parameters
    ----------
    plan : Plan
        One with a motion that ends at rest.
    joint_names : mapping or sequence, optional
        As for `planners.to_ros`.

    Returns
    -------
    sent : Plan
        The plan with the motion that the controller interpolates, certified now.
    message : dict
        A ``trajectory_msgs/JointTrajectory`` as plain data.

    Raises
    ------
    NoSolution
        A plan without a motion, or one whose certificate does not hold as the controller interpolates.
    InvalidInput
        A motion that the controller refuses.
    """
    message, sent = ros_message(plan, joint_names=joint_names)
    moved = plan.moved(sent.trajectory, plan.slowed * sent.factor)
    if not moved:
        assert moved.stop is not None
        why = f"as the controller interpolates it, the certificate does not hold: {moved.stop.reason}"
        raise NoSolution(why, s=moved.stop.s, joint=moved.stop.joint, advice=moved.stop.advice)
    return moved, message


@dataclass
class Run:
    """The state of one execution.

    Attributes
    ----------
    drive : RosDrive
        The drive.
    plan : Plan
        What was sent, as the controller interpolates it.
    goal : Goal
        The goal that runs: that of the plan, or of its stop.
    stop_takes : float
        How long a stop takes to compute [s].
    notes : tuple of str
        What the reader must know.
    """

    drive: RosDrive
    plan: Plan
    goal: Goal
    stop_takes: float
    notes: tuple[str, ...]
    stop: Plan | None = None
    fault: Fault | None = None
    requested: bool = False
    cancelled: str = ""
    samples: list[tuple[int, float, Array, Array]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.sent = time.monotonic()
        self.motion = self.plan.trajectory
        self.begun: float | None = None
        """Start of the motion, by this machine's clock [s]; None as long as no feedback told."""
        self.stamp: int | None = None
        """The same by the controller's clock [ns]."""
        self._located: Feedback | None = None

    # ------------------------------------------------------------ the loop

    def follow(self, asking: Callable[[float], bool], watch: Watcher | None) -> Execution:
        """Follow the goal until it has ended, listening to a request to stop.

        Parameters
        ----------
        asking : callable
            Whether to stop, at a time [s].
        watch : callable, optional
            Told of every joint state.

        Returns
        -------
        Execution
            What the arm did.
        """
        if self._taken(self.goal):
            while not self.goal.ended and not self.drive.transport.lost:
                self.goal.wait(lambda: self.goal.ended, POLL)
                self._look(watch)
                if self.now > self.motion.end + self.drive.timing.grace and not self.cancelled:
                    self._fail(FaultKind.STALL, *_too_long(self.motion.end, self.drive.timing.grace))
                    self._cancel("it did not end in time")
                elif self.cancelled and self.now > self._give_up:
                    break
                elif not self._stopping and asking(max(self.now, 0.0)):
                    self.requested = True
                    self._stop()
            self._settle(watch)
        return self._report()

    @property
    def now(self) -> float:
        """Time since the start of the motion, as far as it is known [s]."""
        return time.monotonic() - (self.sent if self.begun is None else self.begun)

    @property
    def _stopping(self) -> bool:
        return self.requested or self.fault is not None

    def _taken(self, goal: Goal) -> bool:
        """Wait until the controller has accepted a goal; where it has not, say why and see that it is not taken later."""
        patience, transport = self.drive.timing.patience, self.drive.transport
        until = time.monotonic() + patience
        while not (goal.accepted or goal.ended or transport.lost) and time.monotonic() < until:
            goal.wait(lambda: goal.accepted or goal.ended, POLL)
            self._look(None)
        if goal.accepted:
            return True
        if goal is not self.goal:  # a stop, whose failure is not that of the whole
            return False
        if goal.refused and not transport.lost:
            said = f"; it says: {transport.odd}" if transport.odd else ""
            advice = "its log, which says why; its name, its joints and that it is active"
            self._fail(FaultKind.CONTROLLER, f"the controller did not take the goal: {goal.refused}{said}", advice)
        elif not transport.lost:
            transport.cancel(goal)
            what = f"the controller did not say within {patience:g} s that it takes the goal, which was cancelled"
            self._fail(FaultKind.CONNECTION, f"{what}; it may take it later all the same", "see that the arm stands")
        else:
            self._broken()
        return False

    def _look(self, watch: Watcher | None) -> None:
        """Note a new joint state, where the controller is, and joint states that no longer come."""
        feedback = self.goal.feedback
        if feedback is not None and feedback is not self._located:
            self._locate(feedback, self.goal.heard)
        q, dq = self.drive.measured()
        readings = [self.drive.transport.readings.get(name) for name in self.drive.columns]
        if np.isfinite(q).all():
            stamp, at = min((r.stamp, r.at) for r in readings if r is not None)
            if not self.samples or at > self.samples[-1][1]:
                self.samples.append((stamp, at, q, dq))
                if watch is not None:
                    t = max(self.now, 0.0)
                    watch(Moment(t, self.motion(min(t, self.motion.end)), q.copy(), q.copy()))
        elif not self._stopping and not self.drive.transport.lost and self.begun is not None and not self.goal.ended:
            names, lost = self.drive.robot.joint_names, np.flatnonzero(~np.isfinite(q))
            what = f"the joint state of {names[lost[0]]} is no number, or older than {self.drive.timing.state_age:g} s"
            advice = "see that the encoders and their broadcaster work; then resume"
            self._fail(FaultKind.ENCODER, what, advice, names[lost[0]])
            self._stop()

    def _locate(self, feedback: Feedback, heard: float) -> None:
        """Find the instant of the motion that the controller is at, from the state that it desires."""
        self._located = feedback
        order = [feedback.names.index(name) if name in feedback.names else -1 for name in self._names]
        if min(order) < 0 or self.goal.odd:
            return
        q, dq = feedback.positions[order], np.nan_to_num(feedback.velocities[order])
        t = instant_of(self.motion, q, dq, heard - (self.sent if self.begun is None else self.begun))
        if t is None or t <= 0.0 or t >= self.motion.end:
            return
        self.begun = heard - t
        self.stamp = feedback.stamp - round(t * NANOSECONDS) if feedback.stamp else None

    @property
    def _names(self) -> list[str]:
        """The controller's names of the joints, in the order of the robot's."""
        return sorted(self.drive.columns, key=lambda name: self.drive.columns[name])

    # ------------------------------------------------------------ stopping

    def _stop(self) -> None:
        """Replace the goal by a certified stop; where there is none, or the controller does not take it, cancel."""
        why = "no feedback tells where the controller is"
        for attempt in (1, 2):
            if self.begun is None or self.stamp is None:
                break
            t = self.now + attempt * (self.drive.timing.latency + 2.0 * self.stop_takes)
            if t >= self.motion.end:
                self.notes += ("the motion ended before a stop could begin",)
                return
            try:
                found, message = message_for(replan(self.plan, t, stop=True), self.drive.joint_names)
            except (NoSolution, InvalidInput) as error:
                why = f"no stop could be certified: {error}"
                break
            if self.now + self.drive.timing.latency > t:
                why = "computing the stop took longer than the time to its beginning"
                continue
            message["header"]["stamp"] = time_of(self.stamp + round(t * NANOSECONDS))
            goal = self.drive.transport.send(message)
            if self._taken(goal):
                self.goal, self.stop = goal, found
                self.motion = joined(start_of(self.motion, t), found.trajectory)
                return
            self.drive.transport.cancel(goal)
            why = f"the controller did not take the stop{f': {goal.refused}' if goal.refused else ''}"
            break
        self._cancel(why)

    def _cancel(self, why: str) -> None:
        """Ask the controller to cancel the goal, and wait for that for a while only."""
        self.cancelled, self._give_up = why, self.now + self.drive.timing.patience
        self.drive.transport.cancel(self.goal)
        self.notes += (f"the goal was cancelled ({why}): how the arm stopped then is the controller's own",)

    def _settle(self, watch: Watcher | None) -> None:
        """Wait until the joint states say that the arm stands, and note that one."""
        until, count = time.monotonic() + self.drive.timing.patience, len(self.samples)
        while time.monotonic() < until and not self.drive.transport.lost:
            self._look(watch)
            if len(self.samples) > count + 1 and self._stands():
                return
            time.sleep(POLL)

    def _stands(self) -> bool:
        """Whether the last two joint states are those of an arm at rest."""
        (_, t, q, _), (_, t_after, q_after, dq) = self.samples[-2:]
        slow = self.drive.start_tolerance / 10.0
        return bool((np.abs(q_after - q) <= slow * max(t_after - t, 1.0)).all() and not (np.abs(dq) > slow * 10.0).any())

    # ------------------------------------------------------------ the report

    def _fail(self, kind: FaultKind, reason: str, advice: str, joint: str | None = None) -> None:
        if self.fault is None:
            self.fault = Fault(kind, max(self.now, 0.0), joint, reason, advice)

    def _broken(self) -> None:
        what = f"{self.drive.transport.lost} while a goal ran: whether the arm still moves is not known"
        self._fail(FaultKind.CONNECTION, what, "see that the arm stands; connect again, then resume")

    def _judge(self) -> None:
        """Turn the goal's end into a fault where it is one."""
        result, robot = self.goal.result, self.drive.robot
        if self.drive.transport.lost and result is None:
            self._broken()
        if self.fault is not None:
            return
        at = self.samples[-1][2] if self.samples else np.full(robot.n, np.nan)
        off = np.nan_to_num(np.abs(at - self.motion(min(max(self.now, 0.0), self.motion.end))), nan=np.inf)
        joint = robot.joint_names[int(off.argmax())]
        if result is None:
            what = f"the goal was cancelled, and its end was not told: {self.cancelled}"
            self._fail(FaultKind.CONNECTION, what, "see that the arm stands")
        elif result.state is GoalState.SUCCEEDED or (result.state is GoalState.CANCELED and self.cancelled):
            if off.max() > self.drive.start_tolerance:
                what = f"{joint} stands {off.max():.3g} from where the motion ends" if not self.cancelled else self._astray(at)
                if what:
                    self._fail(FaultKind.STALL, what, "see what holds it; then a new plan from where it stands", joint)
        elif result.code in TOLERANCES:
            what = f"the controller ended the goal: {TOLERANCES[result.code]} ({result.words or result.code})"
            what += f"; {joint} is {off.max():.3g} off its set-point, the most of all"
            self._fail(FaultKind.STALL, what, "see what holds the joint; then resume", joint)
        else:
            what = f"the controller ended the goal, {result.state.name.lower()}, with code {result.code}"
            self._fail(FaultKind.CONTROLLER, f"{what}: {result.words or 'no words'}", "its log; then resume")

    def _astray(self, at: Array) -> str:
        """Why an arm whose goal was cancelled does not stand on the path; empty where it does."""
        grid = np.linspace(0.0, self.plan.joint_path.end, 2001)
        off = np.abs(self.plan.joint_path(grid) - at).max(axis=1).min()
        return "" if off <= self.drive.start_tolerance else f"the arm came to rest {off:.3g} off the path ({self.cancelled})"

    def _report(self) -> Execution:
        """What the arm did."""
        if self.fault is None:
            self._judge()
        status, reason, advice = ExecutionStatus.DONE, "", ""
        if self.fault is not None:
            status, reason, advice = ExecutionStatus.FAULT, self.fault.reason, self.fault.advice
        elif self.stop is not None or self.cancelled:
            begun = self.motion.end - self.stop.trajectory.end if self.stop is not None else self.now
            status, advice = ExecutionStatus.STOPPED, "resume goes on"
            reason = f"stopped on request; the stop began at t = {begun:.6g} s" if self.stop else f"stopped: {self.cancelled}"
        t, q, dq = self._recorded()
        period = float(np.median(np.diff(t))) if t.size > 1 else self.drive.period
        stream = Setpoints(period, t, *states(self.motion, np.minimum(t, self.motion.end)))
        return Execution(
            self.drive.name, self.drive.robot, status, reason, advice, self.plan, self.stop, self.motion, stream,
            t, q, dq, None, q, fault=self.fault, notes=self.notes,
        )  # fmt: skip

    def _recorded(self) -> tuple[Array, Array, Array]:
        """Times since the start, positions and velocities of the joint states, by the robot's clock where it is known."""
        rows = []
        for stamp, at, q, dq in self.samples:
            by_robot = stamp and self.stamp is not None
            t = (stamp - self.stamp) / NANOSECONDS if by_robot and self.stamp else at - (self.begun or self.sent)
            rows.append((t, q, dq))
        rows = [row for i, row in enumerate(rows) if row[0] > 0.0 and (i == 0 or row[0] > rows[i - 1][0])]
        first = (0.0, self.samples[0][2] if self.samples else self.drive.measure(), np.zeros(self.drive.robot.n))
        t, q, dq = zip(first, *rows, strict=True)
        return np.array(t), np.array(q), np.array(dq)


def instant_of(motion: Trajectory, q: Array, dq: Array, near: float) -> float | None:
    """Find the instant of a motion at which it has a state.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    q, dq : (n,) arrays
        Position [rad, m] and velocity [rad/s, m/s].
    near : float
        About when [s].

    Returns
    -------
    float or None
        Time [s]; None where the motion is not there around that time.
    """
    low, high = max(near - NEAR, 0.0), min(near + NEAR, motion.end)
    if low >= high:
        return None
    for _ in range(6):  # a grid that is narrowed to a picosecond: the motion is smooth, but may stand for a while
        grid = np.linspace(low, high, 101)
        off = np.abs(motion(grid) - q).max(axis=1) + 0.01 * np.abs(motion(grid, 1) - dq).max(axis=1)
        best = int(off.argmin())
        step = float(grid[1] - grid[0])
        low, high = max(float(grid[best]) - step, 0.0), min(float(grid[best]) + step, motion.end)
    t = float(grid[best])
    return t if float(np.abs(motion(t) - q).max()) <= DESIRED else None


def _too_long(seconds: float, grace: float) -> tuple[str, str]:
    """Reason and advice for a goal that did not end."""
    what = f"no result came within {grace:g} s after the {seconds:.6g} s of the motion"
    return what, "see what holds the arm, and the controller's goal tolerances; then resume"
