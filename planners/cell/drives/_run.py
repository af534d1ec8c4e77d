"""An execution on a simulated drive while it runs: its set-points, its stop, and the record of the arm's motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from optik.types import Array
from planners.cell.drives._stop import ends_at_goal, is_at_rest, plan_hold, plan_stop
from planners.cell.drives.base import Fault
from planners.cell.drives.setpoints import Setpoints, make_setpoints
from planners.motion.event import Event
from planners.plan import Plan, PlanStatus
from planners.trajectory import Trajectory, cut_after, join


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


def interpolate(stream: Setpoints, k: int, steps: int, hold: bool) -> Commands:
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
        found = plan_hold(self.plan, t, self.stream.period) if resting else plan_stop(self.plan, t, allow=self.allow)
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
