"""RosDrive: certified plans as FollowJointTrajectory goals for the joint_trajectory_controller of ROS 2."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_flag, check_number
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.cell.drives._checks import check_plan, find_violation, make_stop_test
from planners.cell.drives._ros_goals import Stops, add_room, describe_exceeded, make_message, make_stops, motor_motion
from planners.cell.drives._ros_run import Run
from planners.cell.drives._stop import relax
from planners.cell.drives.base import Drive, Execution, ExecutionStatus, StopRequest, Watcher
from planners.cell.setpoints import PERIOD
from planners.certificate.violation import Allow
from planners.following.projection import find_nearest_s
from planners.plan import Plan
from planners.replan import replan
from planners.ros.export import JointNames, find_columns
from planners.ros.transport import Transport

STATE_AGE = 0.5
"""Oldest joint state by default [s]: 25 messages of a broadcaster at 50 Hz."""
START_WITHIN = 0.01
"""Largest distance of the measured joints from the start by default [rad, m], as MoveIt allows it."""
STANDS = 0.02
"""Fastest joint that counts as standing [rad/s, m/s]: velocities of encoders are noisy."""
WAITING = 2.0
"""How long to wait for joint states, for the controller to accept a goal, and for an arm to stand [s]."""
GRACE = 5.0
"""How much longer than its motion a goal may take by default [s]: the controller waits until its goal tolerance is met."""
LATENCY = 0.1
"""How long before the instant of a stop its goal is sent by default [s], more than a message takes on a network of
machines beside each other."""
STOPS_EVERY = 0.1
"""Spacing of the instants of stops by default [s]: as much again as the latency."""
SAID_FROM = 1e-3
"""By how much more a motion must be slowed for the controller before that is said [1]."""
SAID = (
    "what the controller does after a goal is its own: it holds the last point, or what its settings say",
    "between its points the controller is taken to interpolate by quintics; late cycles of its loop are not known here",
)
"""What every execution says that was sent."""


class Timing(NamedTuple):
    """How long a drive waits, and how old a joint state may be.

    Attributes
    ----------
    state_age : float
        Oldest joint state [s].
    patience : float
        For joint states, for a goal to be accepted, for an arm to stand [s].
    grace : float
        How much longer than its motion a goal may take [s].
    latency : float
        How long before the instant of a stop its goal is sent [s].
    stops_every : float
        Spacing of the instants of stops [s].
    """

    state_age: float
    patience: float
    grace: float
    latency: float
    stops_every: float


class Measurement(NamedTuple):
    """Joint states of all joints: positions (n,) [rad, m], velocities (n,) [rad/s, m/s], and the oldest joint's times.

    The stamp is by the robot's clock [ns], the arrival by `time.monotonic` [s].
    """

    q: Array
    dq: Array
    stamp: int
    at: float


class RosDrive(Drive):
    """Sends certified goals to a joint_trajectory_controller. By default it checks everything and sends nothing.

    Before it sends, the certificate of what the controller will execute is computed again, and the joints are measured.
    A stop replaces the goal by a certified stop; where that is not taken the goal is cancelled. Nothing is sent twice, and
    nothing starts by itself.

    Parameters
    ----------
    robot : Robot
        The arm.
    transport : Transport
        How the controller is reached (`planners.ros`).
    execute : bool
        Whether to send goals.
    joint_names : mapping or sequence, optional
        From the robot's joint names to the controller's; or the robot's in another order.
    start_tolerance : float
        Largest distance of each measured joint from the start of a plan [rad, m].
    state_age : float
        Oldest joint state that counts as measured now [s].
    patience : float
        How long to wait for joint states and for the controller to accept a goal [s].
    grace : float
        How much longer than its motion a goal may take [s].
    latency : float
        How long before the instant of a stop its goal is sent [s].
    stops_every : float
        Spacing of the instants from which stops are computed, before a motion is sent [s].

    Raises
    ------
    InvalidInput
        One of them out of range.
    """

    name: ClassVar[str] = "ros"
    simulated: ClassVar[bool] = False

    def __init__(
        self, robot: Robot, transport: Transport, *, execute: bool = False, joint_names: JointNames = None,
        start_tolerance: float = START_WITHIN, state_age: float = STATE_AGE, patience: float = WAITING,
        grace: float = GRACE, latency: float = LATENCY, stops_every: float = STOPS_EVERY,
    ) -> None:  # fmt: skip
        for argument, value, kind in (("robot", robot, Robot), ("transport", transport, Transport)):
            if not isinstance(value, kind):
                raise InvalidInput(argument, repr(value)[:60], f"a {kind.__name__}")
        self.robot, self.transport, self.period = robot, transport, PERIOD
        self.sends = check_flag(execute, "execute")
        self.joint_names, self.columns = joint_names, find_columns(robot, joint_names)
        self.start_tolerance = check_number(start_tolerance, "start_tolerance", "rad or m, above 0", above=0.0)
        given = {"state_age": state_age, "patience": patience, "grace": grace, "latency": latency}
        given["stops_every"] = stops_every
        self.timing = Timing(**{k: check_number(v, k, "seconds above 0", above=0.0) for k, v in given.items()})

    # ------------------------------------------------------------ measuring

    def measure(self) -> Array:
        """Return the joints of the latest joint states (n,) [rad, m]; NaN for one that is unknown or not fresh."""
        return self.measured().q

    def measured(self) -> Measurement:
        """Return the latest joint states.

        Returns
        -------
        Measured
            NaN where unknown or not fresh.
        """
        q, dq = np.full((2, self.robot.n), np.nan)
        stamp, at = 0, time.monotonic()
        oldest, readings = at - self.timing.state_age, self.transport.readings
        for name, i in self.columns.items():
            reading = readings.get(name)
            if reading is not None and reading.fresh and reading.at >= oldest:
                q[i], dq[i] = reading.position, reading.velocity
                stamp, at = (reading.stamp, reading.at) if reading.at <= at else (stamp, at)
        return Measurement(q, dq, stamp, at)

    def unmeasured(self) -> tuple[str, str]:
        """Say why the joints are not known to stand still now, after waiting for that for a while.

        Returns
        -------
        reason, advice : str
            Empty where they are.
        """
        until = time.monotonic() + self.timing.patience
        while time.monotonic() < until and not self.transport.lost:
            q, dq = self.measured()[:2]
            if np.isfinite(q).all() and (np.abs(dq) <= STANDS).all():
                return "", ""
            time.sleep(0.01)
        if self.transport.lost:
            return self.transport.lost, "make sure that the other side runs, and connect again"
        q, dq = self.measured()[:2]
        if np.isfinite(q).all():
            mute = [name for name, unknown in zip(self.robot.joint_names, ~np.isfinite(dq), strict=True) if unknown]
            if mute:
                what = (
                    f"the joint states have no velocity of {', '.join(mute)}: whether the arm is at rest is not known"
                )
                return what, "use a joint state broadcaster that sends velocities"
            i = int(np.nanargmax(np.abs(dq)))
            what = f"{self.robot.joint_names[i]} moves at {dq[i]:.3g}, and a plan begins at rest"
            return what, "wait until the arm stands"
        return self.unknown(q, self.timing.patience)

    def unknown(self, q: Array, seconds: float) -> tuple[str, str]:
        """Say why the position of a joint is not known.

        Parameters
        ----------
        q : (n,) array
            What is known [rad, m].
        seconds : float
            For how long it was waited for [s].

        Returns
        -------
        reason, advice : str
            What is wrong, and what to do.
        """
        readings, waited = self.transport.readings, f"within {seconds:g} s"
        odd = f"; the latest message that could not be read: {self.transport.odd}" if self.transport.odd else ""
        if not readings:
            return f"no joint states came {waited}{odd}", "see that the broadcaster of the joint states runs"
        names = [name for name, i in self.columns.items() if not np.isfinite(q[i])]
        absent = [name for name in names if name not in readings]
        if absent:
            what = f"the joint states have no {', '.join(absent)}; they have {', '.join(readings)}"
            return what[:300], "joint_names, a mapping from the robot's joint names to the controller's"
        empty = [name for name in names if not np.isfinite(readings[name].position)]
        if empty:
            return f"the position of {', '.join(empty)} is no number", "repair the encoder or its driver"
        what = f"the joint states of {', '.join(names)} are not fresh: none came with a new stamp {waited}{odd}"
        return what, "see that the broadcaster of the joint states runs, and that the robot's clock does"

    # ------------------------------------------------------------ executing

    def execute(
        self, plan: Plan, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Check a plan and the arm; with ``execute=True`` send it and follow it to the end; see `Drive.execute`."""
        check_plan(plan, self.robot)
        asking = make_stop_test(stop)
        refusal = find_violation(plan, allow) or find_violation(plan, allow, motor_motion(plan).certify())
        if refusal is not None:
            return self._unsent(plan, ExecutionStatus.REFUSED, *refusal)
        try:
            sent, message = make_message(add_room(plan), self.joint_names, allow)
        except (NoSolution, InvalidInput) as error:
            advice = error.advice if isinstance(error, NoSolution) else error.expected
            return self._unsent(plan, ExecutionStatus.REFUSED, str(error), advice)
        notes = tuple(filter(None, (_describe_slowing(plan, sent), describe_exceeded(sent))))
        stops, (reason, advice) = Stops([], 0.0, ""), self._not_at_start(sent)
        if self.sends and not reason:
            stops = make_stops(sent, self.timing.stops_every, self.joint_names, allow)
            reason, advice = self._not_at_start(sent)  # measured anew: the stops took a while
        if reason:
            return self._unsent(sent, ExecutionStatus.REFUSED, reason, advice)
        if not self.sends:
            dry = self._unsent(sent, ExecutionStatus.DRY_RUN, *_describe_message(sent, message, self.transport.place))
            return replace(dry, notes=notes)
        said = (*SAID, *notes, self._stopping(stops))
        return Run(self, sent, self.transport.send(message), stops, said).follow(asking, watch)

    def resume(
        self, execution: Execution, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Go on to the goal from where the arm stands now, if that is on the path; see `Drive.resume`."""
        ended = (ExecutionStatus.STOPPED, ExecutionStatus.FAULT)
        if not isinstance(execution, Execution) or execution.status not in ended or execution.motion is None:
            came = (
                f"one that ended with {execution.status}" if isinstance(execution, Execution) else repr(execution)[:60]
            )
            raise InvalidInput("execution", came, "one that was stopped, or by a fault")
        plan = execution.plan
        check_plan(plan, self.robot)
        reason, advice = self.unmeasured()
        if reason:
            return self._unsent(plan, ExecutionStatus.REFUSED, reason, advice)
        q, joints = self.measure(), plan.joint_path
        s = find_nearest_s(joints, q, _find_position(execution))
        off = np.abs(joints(s) - q)
        i = int(off.argmax())
        if off[i] > self.start_tolerance:
            what = f"the arm no longer stands on the path: {self.robot.joint_names[i]} is {off[i]:.3g} off it"
            return self._unsent(plan, ExecutionStatus.REFUSED, what, "a new plan from where the arm stands")
        if s >= joints.end * (1.0 - 1e-9):
            what = "the arm stands at the end of the path already"
            return self._unsent(plan, ExecutionStatus.REFUSED, what, "nothing: the goal is reached")
        still = np.zeros(self.robot.n)
        onward = replan(relax(plan, allow), (joints(s), still, still))
        onward = replace(onward, scene=plan.scene)
        return self.execute(onward, stop=stop, watch=watch, allow=allow)

    # ------------------------------------------------------------ before the start

    def _not_at_start(self, plan: Plan) -> tuple[str, str]:
        """Reason and advice where the arm is not known to stand at the start of a plan; empty where it does."""
        reason, advice = self.unmeasured()
        if reason:
            return reason, advice
        q, start = self.measure(), plan.trajectory(0.0)
        off = np.abs(q - start)
        i = int(np.nan_to_num(off, nan=np.inf).argmax())
        if off[i] <= self.start_tolerance:
            return "", ""
        where = f"{self.robot.joint_names[i]} stands at {q[i]:.6g} and the plan begins at {start[i]:.6g}"
        return f"{where}, more than {self.start_tolerance:g} away", "a plan that begins where the arm stands"

    def _stopping(self, stops: Stops) -> str:
        """Return a note on how long after a request a stop begins."""
        latency = self.timing.latency
        note = f"a stop begins {latency:.3g} to {latency + stops.every:.3g} s after its request, plus the delay of the feedback"
        if stops.reason:
            note += f"; {len(stops.found)} were found, and from other instants the goal is cancelled ({stops.reason})"
        return note

    def _unsent(self, plan: Plan, status: ExecutionStatus, reason: str, advice: str) -> Execution:
        """Record an execution for which nothing was sent."""
        at = self.measure()[None]
        return Execution(
            self.name, self.robot, status, reason, advice, plan, None, None, None,
            np.zeros(1), at, np.zeros_like(at), None, at,
        )  # fmt: skip


def _find_position(execution: Execution) -> float:
    """Return the approximate position on the path at which an execution ended [m, or rad]."""
    if execution.stop_plan is not None and execution.stop_plan.span is not None:
        return execution.stop_plan.span[1]
    binding = execution.plan.certificate.binding
    return float(np.interp(execution.t[-1], binding.t, binding.s))


def _describe_slowing(plan: Plan, sent: Plan) -> str:
    """Return a note on a motion that is sent slower than planned; empty for any other."""
    factor = sent.trajectory.end / plan.trajectory.end
    return f"slowed by {factor:.6g}, so that the controller keeps its limits" if factor > 1.0 + SAID_FROM else ""


def _describe_message(plan: Plan, message: dict[str, Any], place: str) -> tuple[str, str]:
    """Return a description of the message, and how to send it."""
    first, last = (", ".join(f"{x:.6g}" for x in message["points"][i]["positions"]) for i in (0, -1))
    what = (
        f"nothing was sent: {len(message['points'])} points of {plan.trajectory.end:.6g} s to {place}, for the joints "
        f"{', '.join(message['joint_names'])}, from ({first}) to ({last}) rad or m"
    )
    return what, "execute=True sends it (--execute on the command line)"


METHOD = RosDrive
