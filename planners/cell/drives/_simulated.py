"""SimulatedDrive: the loop over the servo's ticks of every simulated arm, with stop, resume and faults."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from math import ceil
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_count, check_kind, real_array
from optik.errors import InvalidInput
from optik.types import Array, Flags
from planners.cell.drives import _run, base
from planners.cell.drives._run import Commands, DriveRun, Steps, resume_execution
from planners.cell.drives.base import Drive, Execution, Moment, Setpoints, StopRequest, StreamRecord, Watcher
from planners.certificate.violation import Allow, check_allow
from planners.plan import Plan
from planners.streams.stream import Stream

BRAKING = 10.0
"""Largest time in which the brakes must bring the arm to rest [s]."""


class SimulatedDrive(Drive):
    """A drive with a simulated arm. A plant is a subclass with `_place`, `_advance` and `_actual`.

    At tick k the drive has the set-points up to k + ahead, and the certified stop from the last of them. After a request or a
    fault, the arm continues to that set-point and then along that stop.

    Parameters
    ----------
    robot : Robot
        The arm of the plans.
    q : (n,) array, optional
        Initial configuration [rad, m]; by default the start of the first plan.
    step : float
        Largest step of the plant [s]; the period is a whole number of steps.
    seed : int
        Seed of the encoder noise.
    **others
        Options of `planners.cell.drives.base.make_options`.

    Raises
    ------
    InvalidInput
        An argument is out of range.
    """

    simulated: ClassVar[bool] = True
    settling: float = 0.0
    """Time for which the last set-point is held after its tick, so that the arm comes to rest [s]."""

    def __init__(
        self, robot: Robot, q: ArrayLike | None = None, *, step: float = 0.0005, seed: int = 0, **others: Any
    ) -> None:
        check_kind(robot, "robot", Robot)
        self.robot = robot
        self.options = base.make_options(robot, **others)
        self.period = self.options.period
        if not isinstance(step, int | float) or not 0.0 < step <= self.period:
            raise InvalidInput("step", repr(step)[:60], f"seconds above 0, at most the period, {self.period:g}")
        self.steps = ceil(self.period / step * (1.0 - 1e-9))
        check_count(seed, "seed", 0)
        self.clock = 0.0
        """Total time of all executions so far [s]."""
        self._noise = np.random.default_rng(seed)
        self._stuck: int | None = None  # the joint that does not follow, because of which the execution is stopped
        self._placed = False
        if q is not None:
            self._put(q)

    # ------------------------------------------------------------ the plant

    @abstractmethod
    def _place(self, q: Array) -> None:
        """Put the arm at rest at q (n,) [rad, m]."""

    @abstractmethod
    def _advance(self, commands: Commands, stalled: Flags) -> Steps:
        """Simulate one period and return the states of the arm; stalled joints (n,) do not move."""

    @abstractmethod
    def _actual(self) -> Array:
        """Return the true configuration of the arm (n,) [rad, m]."""

    def _torque(self) -> Array | None:
        """Return the present torques of the motors (n,) [N·m, N]; None if the plant has no torques."""
        return None

    def _put_brakes_on(self) -> None:
        """Apply the brakes to all joints from now on, if the plant has brakes."""

    def _find_blocked(self) -> Flags:
        """Return which joints do not move now (n,); a subclass may have such faults."""
        return np.zeros(self.robot.n, dtype=np.bool_)

    def _misread(self, read: Array) -> Array:
        """Return readings (n,) with those of false encoders replaced, NaN for a lost one; a subclass may have such faults."""
        return read

    def _remarks(self) -> tuple[str, ...]:
        """Return the notes of every execution on this plant: defaults used for unknown values."""
        return ()

    # ------------------------------------------------------------ executing

    def measure(self) -> Array:
        """Return the encoders' configuration now (n,) [rad, m]; NaN for a joint whose encoder is lost."""
        if not self._placed:
            raise InvalidInput("q", "none, and no plan executed yet", "the arm's initial configuration")
        return self._misread(_run.read_encoders(self._actual(), self.options, self._noise))

    def execute(
        self, plan: Plan, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Take the arm along a valid plan; see `Drive.execute`."""
        _run.check_plan(plan, self.robot)
        refusal = _run.find_violation(plan, allow)
        if refusal is not None:
            return self._refused(plan, *refusal)
        given, plan = plan, base.fit_periods(plan, self.period)
        refusal = _run.find_violation(plan, allow, plan.motion.certify() if plan is given else None)
        if refusal is not None:
            return self._refused(plan, *refusal)
        if not self._placed:
            self._put(plan.trajectory(0.0))
        refusal = _run.find_refusal(plan, self.measure(), self.options)
        if refusal is not None:
            return self._refused(plan, *refusal)
        run = DriveRun(plan, self.options, check_allow(allow))
        self._loop(run, _run.make_stop_test(stop), watch)
        return self._report(run)

    def resume(
        self, execution: Execution, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Move the arm from its present configuration to the goal of a stopped execution; see `Drive.resume`.

        If a fault left the arm off the path, it first moves straight in joint space to its intended stopping point; that
        execution is `Execution.before` of the result.
        """
        return resume_execution(self, execution, self.options.start, {"stop": stop, "watch": watch, "allow": allow})

    def follow(self, stream: Stream) -> StreamRecord:
        """Take the arm along the set-points of a stream; see `Drive.follow`."""
        if abs(stream.rate * self.period - 1.0) > 1e-9:
            expected = f"{1.0 / self.period:g}: one for each period of the drive"
            raise InvalidInput("stream", f"{stream.rate:g} set-points per second", expected)
        before = next(stream)
        if not self._placed:
            self._put(before.q)
        rows, fault = [(before.t, before.q, self.measure())], ""
        off = np.nan_to_num(np.abs(rows[0][2] - before.q), nan=np.inf)
        i = int((off / self.options.start).argmax())
        if off[i] > self.options.start[i]:
            where = _run.describe_start(self.robot, i, rows[0][2][i], before.q[i], self.options.start[i])
            raise InvalidInput("stream", where, "a stream that begins at the arm's present configuration")
        for now in iter(stream.advance, None):
            pair = (np.stack(two) for two in zip(before[1:4], now[1:4], strict=True))
            periods = round((now.t - before.t) / self.period)  # more than one if the loop missed a tick
            both = Setpoints(now.t - before.t, np.zeros(2), *pair)
            step = _run.interpolate_setpoints(both, 0, self.steps * periods, self.options.hold)
            for k in range(0, self.steps * periods, self.steps):
                self._advance(Commands(*(x[k : k + self.steps + 1] for x in step)), self._find_blocked())
            rows.append((now.t, now.q, self.measure()))
            off = np.nan_to_num(np.abs(rows[-1][2] - now.q), nan=np.inf)
            i = int((off / self.options.following).argmax())
            if off[i] > self.options.following[i] and not fault:
                fault = f"{self.robot.joint_names[i]} is {off[i]:.3g} off its set-point at t = {now.t:.6g} s"
                stream.stop()
            before = now
        return base.make_record(rows, stream, fault)

    def _loop(self, run: DriveRun, stop_test: Callable[[float], bool], watch: Watcher | None) -> None:
        """Run all ticks: read the encoders, check for faults and stop requests, simulate one period."""
        began, since = time.monotonic(), self.clock
        torque = self._torque()
        first = Steps(self._actual()[None], np.zeros((1, self.robot.n)), None if torque is None else torque[None])
        run.record(0.0, np.zeros(1), first)
        k = 0
        while True:
            t = k * self.period
            self._wait(run, began, t)
            self.clock = since + t
            reading = self.measure()
            run.measured.append(reading)
            events = run.events.raise_until(t)
            if watch is not None:
                watch(Moment(t, run.stream.q[min(k, run.last)].copy(), reading.copy(), self._actual().copy(), events))
            if k >= run.last + self._held_ticks() and self._comes_to_rest(run, k, reading):
                break
            run.check_encoders(k, reading)
            self._stuck = run.stuck
            if not run.stopping and stop_test(t):
                run.requested = True
                run.stop_at(k + self.options.ahead)
            now = _run.interpolate_setpoints(run.stream, k, self.steps, self.options.hold)
            run.record(t, now.t[1:], self._advance(now, self._find_blocked()))
            k += 1
        run.extend(k)
        run.judge_rest(k, reading, self._actual())

    def _comes_to_rest(self, run: DriveRun, k: int, reading: Array) -> bool:
        """Return whether the arm is at rest when the set-points end; apply the brakes if it moves, and after a fault."""
        if run.judge_standing(k, reading, self._actual()):
            return True
        self._put_brakes_on()
        if k < run.last + self._held_ticks() + BRAKING / self.period:
            return False
        run.notes.append(
            f"the arm still moved after {BRAKING:g} s with all brakes applied: they are too weak for its load"
        )
        return True

    def _held_ticks(self) -> int:
        """Return the number of periods for which the last set-point is held after its tick."""
        return max(ceil(self.settling / self.period - 1e-9), int(self.options.hold))

    def _wait(self, run: DriveRun, began: float, t: float) -> None:
        """Wait for the tick if a pace is set; count a tick that is a period late."""
        if self.options.pace is None:
            return
        early = began + t / self.options.pace - time.monotonic()
        if early > 0.0:
            time.sleep(early)
        elif -early > self.period / self.options.pace:
            run.late += 1

    def _put(self, q: ArrayLike) -> None:
        """Put the arm at rest at a configuration inside its limits."""
        expected = f"{self.robot.n} finite numbers inside the position limits"
        at = real_array(q, "q", expected)
        if at.shape != (self.robot.n,) or not np.isfinite(at).all() or not self.robot.limits.contains(at):
            raise InvalidInput("q", repr(q)[:80], expected)
        self._place(at.copy())
        self._placed = True

    # ------------------------------------------------------------ the report

    def _refused(self, plan: Plan, reason: str, advice: str) -> Execution:
        """Return the record of a refused execution with the plant's notes."""
        return replace(_run.refuse(self, plan, reason, advice, placed=self._placed), notes=self._remarks())

    def _report(self, run: DriveRun) -> Execution:
        """Return the record of an execution; after a fault the servo's set-point is the arm's true configuration."""
        if run.fault is not None:
            self._place(self._actual())
        status, reason, advice = run.judge_end()
        return Execution(
            self.name, self.robot, status, reason, advice, run.plan, run.stop, run.motion, run.stream,
            np.concatenate(run.t), np.concatenate(run.q), np.concatenate(run.dq),
            np.concatenate(run.torque) if run.torque else None, np.array(run.measured),
            run.late, run.fault, (*self._remarks(), *run.notes), events=tuple(run.events.raised),
        )  # fmt: skip
