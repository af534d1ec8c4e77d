"""RosDrive: certified plans as FollowJointTrajectory goals for the joint_trajectory_controller of ROS 2."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_flag, check_kind, check_number
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.cell.drives import _ros_run, _run
from planners.cell.drives._ros_run import RosOptions, RosRun, Stops
from planners.cell.drives._run import find_violation
from planners.cell.drives.base import PERIOD, Drive, Execution, ExecutionStatus, StopRequest, StreamRecord, Watcher
from planners.certificate.violation import Allow
from planners.following.failure import joint_unit
from planners.following.joint_path import find_nearest_s
from planners.plan import Plan
from planners.program.planner import ProgramPlan
from planners.replan import replan
from planners.ros.export import JointNames, find_columns
from planners.ros.monitor import JointStates
from planners.ros.transport import Transport
from planners.streams.stream import Stream

STATE_AGE = 0.5
"""Default of the largest age of a joint state [s]: 25 messages of a broadcaster at 50 Hz."""
START_WITHIN = 0.01
"""Default of the largest distance of each measured joint from the start [rad, m]: that of MoveIt."""
WAITING = 2.0
"""Default of the longest wait for joint states, for the acceptance of a goal, and for the arm to come to rest [s]."""
GRACE = 5.0
"""Default of the time that a goal may take beyond its motion [s]: the controller waits until its goal tolerance is met."""
LATENCY = 0.1
"""Default of the time from sending a stop to its first instant [s]: longer than a message takes on a local network."""
STOPS_EVERY = 0.1
"""Default spacing of the instants of stops [s]: equal to the latency."""
NOTED_SLOWING = 1e-3
"""Smallest relative slowing for the controller that is noted [1]."""
CONTROLLER_NOTES = (
    "after a goal the controller acts by its own settings; by default it holds the last point",
    "the controller is assumed to interpolate its points by quintics; late cycles of its loop are not known here",
)
"""Notes of every execution that was sent."""


class RosDrive(Drive):
    """A drive that sends certified goals to a joint_trajectory_controller. By default it checks everything and sends nothing.

    Before it sends, it certifies the motion after controller interpolation, and it measures the joints. To stop, it replaces
    the goal by a certified stop, or cancels the goal if the stop is not accepted. It sends nothing twice, and starts nothing
    by itself.

    Parameters
    ----------
    robot : Robot
        The arm.
    transport : Transport
        Connection to the controller (`planners.ros`).
    execute : bool
        Whether to send goals.
    joint_names : mapping or sequence, optional
        Mapping from the robot's joint names to the controller's, or the robot's names in another order.
    start_tolerance : float
        Largest distance of each measured joint from the start of a plan [rad, m].
    state_age : float
        Largest age of a joint state that counts as a present measurement [s].
    patience : float
        Longest wait for joint states, and for the acceptance of a goal [s].
    grace : float
        Time that a goal may take beyond its motion [s].
    latency : float
        Time from sending a stop to its first instant [s].
    stops_every : float
        Spacing of the instants from which stops are computed before a motion is sent [s].

    Raises
    ------
    InvalidInput
        An argument is out of range.
    """

    name: ClassVar[str] = "ros"
    simulated: ClassVar[bool] = False

    def __init__(
        self, robot: Robot, transport: Transport, *, execute: bool = False, joint_names: JointNames = None,
        start_tolerance: float = START_WITHIN, state_age: float = STATE_AGE, patience: float = WAITING,
        grace: float = GRACE, latency: float = LATENCY, stops_every: float = STOPS_EVERY,
    ) -> None:  # fmt: skip
        for argument, value, kind in (("robot", robot, Robot), ("transport", transport, Transport)):
            check_kind(value, argument, kind)
        self.robot, self.transport, self.period = robot, transport, PERIOD
        self.sends = check_flag(execute, "execute")
        if robot.motors is not None:
            raise InvalidInput(
                "robot", f"{robot.name} with coupled motors", "an arm whose joints are its axes; see to_ros"
            )
        self.joint_names, columns = joint_names, find_columns(robot, joint_names)
        wanted = {"start_tolerance": "rad or m, above 0"}
        options = RosOptions(start_tolerance, state_age, patience, grace, latency, stops_every)._asdict()
        checked = {k: check_number(v, k, wanted.get(k, "seconds above 0"), above=0.0) for k, v in options.items()}
        self.options = RosOptions(**checked)
        names = tuple(sorted(columns, key=columns.__getitem__))
        self.joints = JointStates(robot, transport, names, self.options.state_age)

    def measure(self) -> Array:
        """Return the positions of the latest joint states (n,) [rad, m]; NaN for a joint without a fresh state."""
        return self.joints.read().q

    # ------------------------------------------------------------ executing

    def execute(
        self, plan: Plan, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Check a plan and the arm; with ``execute=True`` send it and follow it to the end; see `Drive.execute`."""
        _run.check_plan(plan, self.robot)
        stop_test = _run.make_stop_test(stop)
        refusal = find_violation(plan, allow) or find_violation(plan, allow, _ros_run.motor_motion(plan).certify())
        if refusal is not None:
            return _run.refuse(self, plan, *refusal)
        try:
            sent, message = _ros_run.make_message(_ros_run.add_room(plan), self.joint_names, allow)
        except (NoSolution, InvalidInput) as error:
            advice = error.advice if isinstance(error, NoSolution) else error.expected
            return _run.refuse(self, plan, str(error), advice)
        notes = tuple(filter(None, (_describe_slowing(plan, sent), _ros_run.describe_exceeded(sent))))
        stops, (reason, advice) = Stops([], 0.0, ""), self._check_start(sent)
        if self.sends and not reason:
            stops = _ros_run.make_stops(sent, self.options.stops_every, self.joint_names, allow)
            reason, advice = self._check_start(sent)  # again, because the computation of the stops takes time
        if reason:
            return _run.refuse(self, sent, reason, advice)
        if not self.sends:
            description = _describe_message(sent, message, self.transport.address)
            return replace(_run.refuse(self, sent, *description), status=ExecutionStatus.DRY_RUN, notes=notes)
        notes = (*CONTROLLER_NOTES, *notes, self._describe_stops(stops))
        goal = self.transport.send(message)
        return RosRun(self, self.joints, self.options, sent, goal, stops, notes).follow(stop_test, watch)

    def resume(
        self, execution: Execution, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Move the arm from its present configuration on the path to the goal of a stopped execution; see `Drive.resume`."""
        _run.check_stopped(execution)
        plan = execution.plan
        _run.check_plan(plan, self.robot)
        reason, advice = self.joints.wait_for_rest(self.options.patience)
        if reason:
            return _run.refuse(self, plan, reason, advice)
        q, joints = self.measure(), plan.joint_path
        s = find_nearest_s(joints, q, _find_position(execution))
        off = np.abs(joints(s) - q)
        i = int(off.argmax())
        if off[i] > self.options.start_tolerance:
            name, unit = self.robot.joint_names[i], joint_unit(self.robot, i)
            reason = f"the arm is no longer on the path: {name} is {off[i]:.3g} {unit} off it"
            return _run.refuse(self, plan, reason, "plan from the arm's present configuration")
        if s >= joints.end * (1.0 - 1e-9):
            reason = "the arm is already at the end of the path"
            return _run.refuse(self, plan, reason, "nothing to do: the goal is reached")
        still = np.zeros(self.robot.n)
        running = execution.stop_plan if isinstance(execution.stop_plan, ProgramPlan) else plan  # it knows its section
        onward = replan(_run.without_permitted(running, allow), (joints(s), still, still))
        onward = replace(onward, scene=plan.scene)
        return self.execute(onward, stop=stop, watch=watch, allow=allow)

    def follow(self, stream: Stream) -> StreamRecord:
        """Send each motion of a stream to the controller, to begin at its time; see `Drive.follow`.

        Each motion is sent before it begins, with its time on the robot's clock, so ``budget`` of the stream must be at least
        the latency of the drive.
        """
        if not self.sends:
            raise InvalidInput("execute", False, "True, because a stream has no dry run")
        return _ros_run.follow_by_goals(self.joints, self.options, find_columns(self.robot, self.joint_names), stream)

    # ------------------------------------------------------------ before the start

    def _check_start(self, plan: Plan) -> tuple[str, str]:
        """Return reason and advice if the arm is not at the start of a plan; empty strings otherwise."""
        reason, advice = self.joints.wait_for_rest(self.options.patience)
        if reason:
            return reason, advice
        q, start = self.measure(), plan.trajectory(0.0)
        off = np.abs(q - start)
        i = int(np.nan_to_num(off, nan=np.inf).argmax())
        if off[i] <= self.options.start_tolerance:
            return "", ""
        return _run.describe_start(self.robot, i, q[i], start[i], self.options.start_tolerance), _run.START_ADVICE

    def _describe_stops(self, stops: Stops) -> str:
        """Return a note on the time from a request to the stop."""
        latency = self.options.latency
        note = f"a stop begins {latency:.3g} to {latency + stops.every:.3g} s after its request, plus the delay of the feedback"
        if stops.reason:
            note += f"; {len(stops.found)} stops were found; from other instants the goal is cancelled ({stops.reason})"
        return note


def _find_position(execution: Execution) -> float:
    """Return the approximate position on the path at which an execution ended [m, or rad]."""
    if execution.stop_plan is not None and execution.stop_plan.span is not None:
        return execution.stop_plan.span[1]
    return execution.plan.certificate.s_at(float(execution.t[-1]))


def _describe_slowing(plan: Plan, sent: Plan) -> str:
    """Return a note on a motion that is sent slower than planned, or an empty string."""
    factor = sent.trajectory.end / plan.trajectory.end
    slower = f"duration stretched by {100.0 * (factor - 1.0):.3g} % to meet the limits after controller interpolation"
    return slower if factor > 1.0 + NOTED_SLOWING else ""


def _describe_message(plan: Plan, message: dict[str, Any], address: str) -> tuple[str, str]:
    """Return a description of the message, and advice how to send it."""
    first, last = (", ".join(f"{x:.6g}" for x in message["points"][i]["positions"]) for i in (0, -1))
    what = (
        f"nothing was sent: {len(message['points'])} points of {plan.trajectory.end:.6g} s to {address}, for the joints "
        f"{', '.join(message['joint_names'])}, from ({first}) to ({last}) [rad, m]"
    )
    return what, "execute=True sends it"


METHOD = RosDrive
