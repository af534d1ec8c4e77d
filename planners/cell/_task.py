"""The steps of a task of the cell, from a reading of the laser unit to the true position of the tool."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from math import inf
from time import perf_counter
from typing import Any

import numpy as np

from optik import se3
from optik.arm.motors import find_outside
from optik.arm.reach import ask_unit, outside_reach, reach_bound
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import IKSolver
from optik.scene import Scene
from optik.task import POSE
from optik.types import Array
from planners.cell.drives.base import MOST_PERIODS, Drive, Execution, ExecutionStatus, StopRequest, Watcher
from planners.cell.laser import PanTiltLaser, find_truth, find_variance, locate_spot, read_point
from planners.cell.outcome import CellStatus, Outcome, PathSplit, Round, Step, split_along
from planners.cell.sighting import Follow, Look, Plane, Sighting, Spot
from planners.following.failure import joint_unit
from planners.limits import MotionLimits
from planners.paths.line import Line
from planners.plan import Plan, PlanStatus, plan
from planners.timing import TimeLaw

NO_MOVE = 1e-9
"""Largest length of a line for which the tool counts as at its target [m, or rad]: a thousandth of the encoders' resolution."""

FAILED_STEPS = {
    PlanStatus.TIMING_INFEASIBLE: "timing",
    PlanStatus.LIMITS_EXCEEDED: "timing",
    PlanStatus.NOT_PROVED: "certificate",
}
"""The step at which a plan failed, by its status; with any other status it is the step "joints"."""

EXECUTION_ENDS = {
    ExecutionStatus.STOPPED: CellStatus.STOPPED,
    ExecutionStatus.FAULT: CellStatus.FAULT,
    ExecutionStatus.REFUSED: CellStatus.REFUSED,
    ExecutionStatus.DRY_RUN: CellStatus.DRY_RUN,
}
"""Status of a task by the status of its execution."""

MOST_SPREADS = 6.0
"""Largest error of a measured tool position, in standard deviations of noise and calibration [1]."""
ARM_OFF = 0.005
"""Largest distance of the tool from its position by the encoders [m]: the absolute accuracy of uncalibrated arms."""
UNSTATED = 0.05
"""Largest distance of the tool from its position by the encoders [m] if the covariance of the laser unit's pose is not stated:
the accuracy of a pose that was measured by hand."""

TAKEN_AS_EXACT = (
    "the true spot is not known: the reading is taken as exact, so the laser's error is that of its pose only"
)
"""Note on an outcome whose reading was not made by `Cell.read`."""


class Equipment:
    """What a task uses of its cell."""

    robot: Robot
    drive: Drive
    limits: MotionLimits
    scene: Scene | None
    laser: PanTiltLaser  # the calibrated unit
    unit: PanTiltLaser  # the true unit of a simulation
    rng: np.random.Generator  # of the noise of its readings
    base: Array


class StepFailure(Exception):
    """Raised inside a task when a step fails; it carries the status of the task."""

    def __init__(self, status: CellStatus) -> None:
        self.status = status


@dataclass(eq=False)
class CellTask:
    """A running task: its settings, as `Cell.move_to_spot` describes them, and its steps so far with their results."""

    cell: Equipment
    law: TimeLaw
    solver: IKSolver
    notes: list[str]
    stop: StopRequest | None = None
    watch: Watcher | None = None
    orientation: Array | None = None
    corrections: int = 0
    readings: int = 1
    samples: int = 151
    plane: Plane | None = None
    stated_spot: Array | None = None
    follow: Follow | None = None
    moved: float = inf
    most_replans: int = 0
    look: Look | None = None

    steps: list[Step] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)
    along: list[PathSplit] = field(default_factory=list)
    spot: Array | None = None
    true_spot: Array | None = None
    target: Array | None = None
    variance: float = 0.0
    floor: float | None = None
    clock: float = 0.0
    _stopped_by_spot: bool = False

    # ------------------------------------------------------------ steps

    def _add(self, name: str, reason: str, result: Any, since: float) -> None:
        self.steps.append(Step(name, True, reason, "", result, perf_counter() - since))

    def _fail(
        self, name: str, status: CellStatus, reason: str, advice: str, result: Any = None, since: float | None = None
    ) -> StepFailure:
        seconds = 0.0 if since is None else perf_counter() - since
        self.steps.append(Step(name, False, reason, advice, result, seconds))
        return StepFailure(status)

    def run(self, spot: Spot) -> Outcome:
        """Move the tool to a spot as the unit read it, and correct the remaining error."""
        status = CellStatus.ARRIVED
        try:
            self._locate(spot)
            self._aim()
            self._reach()
            for _ in range(self.corrections):
                self._correct()
        except StepFailure as ended:
            status = ended.status
        return self._outcome(status)

    def resume(self, outcome: Outcome) -> Outcome:
        """Resume a task whose last execution was stopped; return the outcome of the remaining motion."""
        self.spot, self.true_spot, self.target = outcome.spot, outcome.true_spot, outcome.target
        since, status = perf_counter(), CellStatus.ARRIVED
        try:
            execution = self.cell.drive.resume(outcome.executions[-1], stop=self.stop, watch=self.watch)
            self._check_end(execution, since)
            self._measure_arrival(execution.plan, execution)
        except StepFailure as ended:
            status = ended.status
        return self._outcome(status)

    def _outcome(self, status: CellStatus) -> Outcome:
        cell = self.cell
        beam = None if self.spot is None else (cell.laser.pose[:3, 3], self.spot)
        said = [note for step in self.steps if isinstance(step.result, Execution) for note in step.result.notes]
        notes = tuple(dict.fromkeys(self.notes + said))
        return Outcome(
            cell.robot, status, tuple(self.steps), tuple(self.rounds),
            self.along[-1].error.at(-1) if self.along else None, self.along[0] if self.along else None,
            self.target, self.spot, self.true_spot, beam, self.floor, cell.base, cell.scene, notes,
        )  # fmt: skip

    # ------------------------------------------------------------ laser and target

    def _locate(self, reading: Spot) -> None:
        """Run the step "laser": compute the point of a reading."""
        since, cell = perf_counter(), self.cell
        try:
            seen = locate_spot(cell.laser, reading, self.plane)
            if not seen:
                raise self._fail("laser", CellStatus.NO_SPOT, f"{seen.status}: {seen.reason}", seen.advice, seen, since)
            self.true_spot, known = self.stated_spot, True
            if self.true_spot is None:
                self.true_spot, known = find_truth(cell.unit, reading, self.plane)
        except InvalidInput as error:
            raise self._fail("laser", CellStatus.NO_SPOT, str(error), "read the spot again") from None
        if not known:
            self.notes.append(TAKEN_AS_EXACT)
        self.spot, self.variance = seen.point, find_variance(cell.laser, reading, self.plane)
        off = 0.0 if seen.covariance is None else float(np.sqrt(np.trace(seen.covariance)))
        noise = f", ± {_mm(off)} (RMS)" if off else ""
        self._add("laser", f"the spot is at {_metres(seen.point)}{noise}", seen, since)

    def _measured_start(self) -> Array:
        """Return the configuration that the encoders measure, clipped to the position limits."""
        q = self.cell.drive.measure()
        robot = self.cell.robot
        if not np.isfinite(q).all():
            joint = robot.joint_names[int(np.argmin(np.isfinite(q)))]
            reason, advice = f"the encoder of {joint} gives no position", "repair the encoder, then start again"
            raise self._fail("target", CellStatus.FAULT, reason, advice)
        if not robot.limits.contains(q):
            name, value, low, high, i = find_outside(robot, q)
            unit = joint_unit(robot, i)
            reason = f"{name} is at {value:.6g} {unit}, outside its range [{low:.6g}, {high:.6g}] {unit}"
            advice = f"move {name} into its range by hand, then start again"
            raise self._fail("target", CellStatus.NO_PLAN, reason, advice)
        return np.clip(q, robot.limits.lower, robot.limits.upper)

    def _aim(self) -> None:
        """Run the step "target": compute the goal pose of the tool."""
        since = perf_counter()
        R = self.cell.robot.fk(self._measured_start())[:3, :3] if self.orientation is None else self.orientation
        assert self.spot is not None
        self.target = se3.pose(R, self.spot)
        reach = reach_bound(self.cell.robot, POSE)
        away = float(outside_reach(reach, self.target, 0.0, 0.0))
        if away >= 0.0:
            reason = f"out of reach: {away:.4g} m away; the arm reaches at most from {reach[6]:.4g} to {reach[7]:.4g} m"
            reason += ask_unit(away, reach[7])
            raise self._fail(
                "target", CellStatus.NO_PLAN, reason, "choose a spot nearer to the arm", self.target, since
            )
        orientation = "present orientation of the tool" if self.orientation is None else "requested orientation"
        self._add("target", f"with the {orientation}", self.target, since)

    # ------------------------------------------------------------ from the line to its execution

    def _plan_line(self, law: TimeLaw) -> Plan | None:
        """Run the steps "line", "joints", "timing" and "certificate"; return None if the tool is at its target already."""
        since, cell, robot = perf_counter(), self.cell, self.cell.robot
        q = self._measured_start()
        assert self.target is not None
        try:
            line = Line(robot.fk(q), self.target)
        except InvalidInput as error:
            advice = "move to an orientation between the two first"
            raise self._fail("line", CellStatus.NO_PLAN, str(error), advice) from None
        if line.end <= NO_MOVE:
            self._add("line", "the tool is already there", line, since)
            return None
        self._add("line", f"{_length(line)} long", line, since)
        planned = self._plan(line, q, law)
        if planned and planned.trajectory.duration < cell.drive.period and planned.speed is None:
            planned = self._plan(line, q, law, cell.drive.period)
        self._add_planned(planned)
        if planned.trajectory.duration < cell.drive.period:
            took = f"the motion takes {planned.trajectory.duration:.3g} s at the requested tool speed"
            reason = f"{took}, less than the servo period of {cell.drive.period:g} s"
            raise self._fail("execution", CellStatus.REFUSED, reason, "lower the tool speed, or use a law without one")
        if planned.trajectory.duration > MOST_PERIODS * cell.drive.period:
            reason = f"the motion takes {planned.trajectory.duration:.3g} s, more than {MOST_PERIODS:,} periods"
            raise self._fail("execution", CellStatus.REFUSED, reason, "raise the limits")
        return planned

    def _plan(self, line: Line, q: Array, law: TimeLaw, duration: float | None = None) -> Plan:
        return plan(
            self.cell.robot, line, q, solver=self.solver, timing=law, limits=self.cell.limits, samples=self.samples,
            duration=duration, scene=self.cell.scene,
        )  # fmt: skip

    def _add_planned(self, planned: Plan) -> None:
        """Record the steps of a plan, up to the one that failed."""
        failed = None if planned else FAILED_STEPS.get(planned.status, "joints")
        if planned.status is PlanStatus.CONTACT and planned.has_motion:
            failed = "certificate"
        passed: dict[str, tuple[str, Any]] = {"joints": (f"followed with {planned.solver}", planned.prefix)}
        if failed != "joints":
            passed["timing"] = (planned.law, planned.trajectory if planned.has_motion else None)
        if failed not in ("joints", "timing"):
            T = planned.trajectory.duration
            passed["timing"] = (f"{planned.law}, {T:.3f} s", planned.trajectory)
            passed["certificate"] = ("valid", planned.certificate)
        for (name, (said, result)), seconds in zip(passed.items(), planned.seconds, strict=False):
            if name == failed:
                assert planned.failure is not None
                at = "" if "s = " in planned.failure.reason else f" (s = {planned.failure.s:.6g})"
                reason = f"{planned.status}: {planned.failure.reason}{at}"
                self.steps.append(Step(name, False, reason, planned.failure.advice, result, seconds))
                raise StepFailure(CellStatus.NO_PLAN)
            self.steps.append(Step(name, True, said, "", result, seconds))

    def _execute(self, planned: Plan, stop: StopRequest | None) -> Execution:
        """Execute the plan and record the step: "execution", or "stop" if a moving spot stopped the arm."""
        since = perf_counter()
        return self._check_end(self.cell.drive.execute(planned, stop=stop, watch=self.watch), since)

    def _check_end(self, execution: Execution, since: float) -> Execution:
        """Record the step of an execution by its status."""
        if execution.t.size:
            self.clock += float(execution.t[-1])
        if execution:
            late = f", {execution.late} late" if execution.late else ""
            self._add("execution", f"{execution.drive}, {execution.t[-1]:.3f} s{late}", execution, since)
        elif execution.status is not ExecutionStatus.STOPPED or not self._stopped_by_spot:
            status = EXECUTION_ENDS[execution.status]
            reason = f"{execution.status}: {execution.reason}" if execution.reason else str(execution.status)
            raise self._fail("execution", status, reason, execution.advice, execution, since)
        else:
            self._add("stop", f"the spot moved; at rest on the path after {execution.t[-1]:.3f} s", execution, since)
        return execution

    def _measure_arrival(self, planned: Plan, execution: Execution) -> None:
        """Run the step "tool": compute the true position of the tool, and measure it for a correction."""
        since, robot = perf_counter(), self.cell.robot
        assert self.true_spot is not None
        pose = robot.fk(execution.q[-1])
        tool, error = pose[:3, 3], pose[:3, 3] - self.true_spot
        self.along.append(split_along(execution, self.solver, self.true_spot, self.samples))
        residual, said = None, f"{_mm(np.linalg.norm(error))} from the spot"
        if self.corrections:
            residual = self._measure_residual(tool, robot.fk(execution.measured[-1])[:3, 3])
            said += f"; {_mm(np.linalg.norm(residual))} as measured"
        self.rounds.append(Round(planned, execution, tool, residual, error))
        self._add("tool", said, pose, since)

    def _measure_residual(self, tool: Array, encoders: Array) -> Array:
        """Return the measured spot minus the measured tool, so that the error of the calibration cancels.

        A measurement is rejected if noise and calibration do not explain its distance from the position by the encoders.
        """
        try:
            read = self._read_tool(tool) if self.look is None else self.look()
            seen = read if isinstance(read, Sighting) else locate_spot(self.cell.laser, read, self.plane)
        except InvalidInput as error:
            raise self._fail("tool", CellStatus.NOT_MEASURED, str(error), "read the tool again") from None
        if not seen:
            reason = f"the laser unit cannot measure the tool: {seen.status}: {seen.reason}"
            raise self._fail("tool", CellStatus.NOT_MEASURED, reason, seen.advice, seen)
        assert seen.point is not None and self.spot is not None and isinstance(read, Spot)
        off = float(np.linalg.norm(seen.point - encoders))
        stated = self.cell.laser.pose_covariance is not None
        spread = 0.0 if seen.covariance is None else float(np.sqrt(np.trace(seen.covariance)))
        most = MOST_SPREADS * spread + (ARM_OFF if stated else UNSTATED)
        if off > most:
            why = f"the laser unit measures the tool {_mm(off)} from its position by the encoders"
            reason = f"{why}, but noise and calibration explain at most {_mm(most)}"
            advice = "check the reading of the unit there" + ("" if stated else "; or state the covariance of its pose")
            raise self._fail("tool", CellStatus.NOT_MEASURED, reason, advice, seen)
        # the variance of the readings of spot and tool remains after a correction
        self.floor = float(np.sqrt(self.variance + find_variance(self.cell.laser, read, self.plane)))
        return self.spot - seen.point

    def _read_tool(self, tool: Array) -> Spot | Sighting:
        """Return a simulated reading of the tool, or the failed sighting if the true unit cannot see it."""
        visible = self.cell.unit.angles(tool)
        return read_point(self.cell.unit, tool, self.readings, self.cell.rng) if visible else visible

    # ------------------------------------------------------------ the loop: a spot that moves, and corrections

    def _reach(self) -> None:
        """Move to the target; if the spot moves, stop and move to its new position."""
        follow, most = self.follow, self.most_replans
        for replans in range(most + 1):
            self._stopped_by_spot = False
            planned = self._plan_line(self.law)
            execution = None if planned is None else self._execute(planned, self._make_stop_test())
            if follow is not None:
                self._locate(follow(self.clock))
            if not self._stopped_by_spot and not self._is_away(self.spot):
                if planned is not None and execution is not None:
                    self._measure_arrival(planned, execution)
                return
            if replans < most:
                self._turn_to_spot()
        reason = f"the spot moved on {most + 1} times"
        raise self._fail("replan", CellStatus.SPOT_MOVES, reason, "wait until it is at rest, or raise most_replans")

    def _turn_to_spot(self) -> None:
        """Run the step "replan": the new position of the spot becomes the target."""
        since = perf_counter()
        assert self.spot is not None and self.target is not None
        by = float(np.linalg.norm(self.spot - self.target[:3, 3]))
        self.target = se3.pose(self.target[:3, :3], self.spot)
        self._add("replan", f"the spot moved by {_mm(by)}", self.target, since)

    def _is_away(self, point: Array | None) -> bool:
        """Return whether a point is farther from the target than the tolerance `moved`."""
        assert self.target is not None
        return point is None or float(np.linalg.norm(point - self.target[:3, 3])) > self.moved

    def _make_stop_test(self) -> StopRequest | None:
        """Return the stop condition of the execution: the caller's request, or a motion of the laser spot during the task."""
        stop, follow, since = self.stop, self.follow, self.clock
        if follow is None:
            return stop

        def request(t: float) -> bool:
            if stop is not None and (stop(t) if callable(stop) else t >= stop):
                return True
            self._stopped_by_spot = self._has_moved(follow, since + t)
            return self._stopped_by_spot

        return request

    def _has_moved(self, follow: Follow, t: float) -> bool:
        """Return whether the spot has left the target or can no longer be seen; called while the arm moves."""
        try:
            return self._is_away(locate_spot(self.cell.laser, follow(t), self.plane).point)
        except Exception:  # after any failed reading the arm must come to rest first; then the spot is read again
            return True

    def _correct(self) -> None:
        """Move the target by the measured residual, and execute a motion to it."""
        assert self.target is not None
        residual = self.rounds[-1].residual if self.rounds else None
        if residual is None:
            return
        self.target = se3.pose(self.target[:3, :3], self.target[:3, 3] + residual)
        self._stopped_by_spot = False
        law = self.law
        if law.speed is not None:  # a correction is too short to reach the requested tool speed
            law = copy(law)
            law.speed = None
        planned = self._plan_line(law)
        if planned is not None:
            self._measure_arrival(planned, self._execute(planned, self.stop))


def _mm(metres: Any) -> str:
    return f"{1e3 * float(metres):.3g} mm" if metres >= 1e-9 else "less than 1e-6 mm"


def _metres(point: Any) -> str:
    return "(" + ", ".join(f"{x:.4f}" for x in point) + ") m"


def _length(line: Line) -> str:
    return _mm(line.end) if line.unit == "m" and line.end < 0.1 else f"{line.end:.4g} {line.unit}"
