"""One execution on a simulated drive while it runs: its set-points, what stops it, and the record of what the arm did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from optik.types import Array
from planners.cell.drives._setpoints import Setpoints, make_setpoints
from planners.cell.drives._stop import ends_at_goal, plan_stop
from planners.cell.drives.base import Fault
from planners.plan import Plan, PlanStatus
from planners.splice import cut_after, join
from planners.trajectory import Trajectory


class EncoderMonitor:
    """A monitor of frozen encoders: how long each reading has been the same, and how far its set-point moved meanwhile."""

    def __init__(self) -> None:
        self._read = self._low = self._high = self._since = np.array(np.nan)

    def update(self, read: Array, asked: Array, t: float) -> Array:
        """Return how far each set-point moved since the reading of its joint last changed (n,) [rad, m]."""
        fresh = read != self._read  # NaN always counts as a new reading
        self._read = read.copy()
        self._since = np.where(fresh, t, self._since)
        self._low = np.where(fresh, asked, np.minimum(self._low, asked))
        self._high = np.where(fresh, asked, np.maximum(self._high, asked))
        moved: Array = self._high - self._low
        return moved

    def seconds(self, t: float) -> Array:
        """Return for how long each reading has been the same (n,) [s], at a time [s]."""
        seconds: Array = t - self._since
        return seconds


class Commands(NamedTuple):
    """The commands to the servo at the plant's steps of one period, its start and its end included.

    Attributes
    ----------
    t : (m + 1,) array
        Times since the period's start, 0 first, the period last [s].
    q, dq, ddq : (m + 1, n) arrays
        Commanded positions [rad, m], velocities [rad/s, m/s] and accelerations [rad/s², m/s²].
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array


class Steps(NamedTuple):
    """The state of the arm in one period, after each of the plant's steps.

    Attributes
    ----------
    q, dq : (m, n) arrays
        Positions [rad, m] and velocities [rad/s, m/s].
    torque : (m, n) array or None
        Torques of the motors [N·m, N], where the plant has torques.
    """

    q: Array
    dq: Array
    torque: Array | None = None


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
    # the cubic from (q, v) to (q, v) of the next set-point, by powers of the share u of the period
    d, w = stream.q[k + 1] - q, stream.dq[k + 1] * period
    c2, c3 = 3.0 * d - 2.0 * v - w, v + w - 2.0 * d
    position = q + u * (v + u * (c2 + u * c3))
    position[-1] = stream.q[k + 1]
    velocity = (v + u * (2.0 * c2 + 3.0 * u * c3)) / period
    return Commands(u[:, 0] * period, position, velocity, (2.0 * c2 + 6.0 * u * c3) / period**2)


@dataclass
class Run:
    """The state of a running execution.

    Attributes
    ----------
    plan : Plan
        What is executed.
    motion : Trajectory
        What is sent: that of the plan; once it is stopped, up to the stop and the stop.
    stream : Setpoints
        Its set-points.
    stop : Plan or None
        The stop; certified, but perhaps after a fault.
    stopping : bool
        Whether a stop was begun, or looked for in vain.
    requested : bool
        Whether it was requested.
    fault : Fault or None
        What went wrong.
    stuck : int or None
        Index of the joint that did not follow.
    late : int
        Late ticks.
    notes : list of str
        What the reader must know.
    encoders : EncoderMonitor
        Encoders whose readings do not change.
    allow : tuple of str
        Which violations of the plan and of its stop are permitted.
    """

    plan: Plan
    motion: Trajectory
    stream: Setpoints
    stop: Plan | None = None
    stopping: bool = False
    requested: bool = False
    fault: Fault | None = None
    stuck: int | None = None
    late: int = 0
    notes: list[str] = field(default_factory=list)
    encoders: EncoderMonitor = field(default_factory=EncoderMonitor)
    allow: tuple[str, ...] = ()
    t: list[Array] = field(default_factory=list)
    q: list[Array] = field(default_factory=list)
    dq: list[Array] = field(default_factory=list)
    torque: list[Array] = field(default_factory=list)
    measured: list[Array] = field(default_factory=list)

    @property
    def last(self) -> int:
        """Number of the tick at which the last set-point is due."""
        return len(self.stream.t) - 1

    @property
    def at_goal(self) -> bool:
        """Whether what is sent ends at the end of the plan: there was no stop, or the shortest one ends there."""
        return self.stop is None or ends_at_goal(self.stop)

    def stop_at(self, tick: int) -> None:
        """Replace the set-points after a tick by a stop; where none is certified the arm goes on to the end.

        After a fault the stop that passes the limits least is better than going on: it is sent, and the notes say so.
        """
        if self.stopping:
            return
        self.stopping = True
        t = tick * self.stream.period
        if tick >= self.last or t >= self.motion.end:
            self.notes.append(
                "the set-points that the drive held already reached the end of the plan: no stop was needed"
            )
            return
        found = plan_stop(self.plan, t, allow=self.allow)
        if not found:
            assert found.failure is not None
            why = f"no stop from t = {t:.6g} s could be certified: {found.failure.reason}"
            if self.fault is None or found.status is not PlanStatus.NOT_PROVED:
                self.notes.append(f"{why}; so the plan was ended")
                return
            self.notes.append(f"{why}; it was sent all the same, because of the fault")
        self.stop = found
        self.motion = join(cut_after(self.motion, t), found.trajectory)
        self.stream = make_setpoints(self.motion, self.stream.period)
        if ends_at_goal(found):
            self.notes.append("the shortest stop within the limits ends at the end of the path")

    def fail(self, fault: Fault, tick: int) -> None:
        """Note a fault, the first one only, and stop."""
        if self.fault is None:
            self.fault = fault
        self.stop_at(tick)

    def extend(self, ticks: int) -> None:
        """Hold the last set-point up to a tick, so that there is one set-point for each reading."""
        more = ticks - self.last
        if more <= 0:
            return
        period, t, q, dq, ddq = self.stream
        still = np.zeros((more, q.shape[1]))
        t = np.append(t, period * np.arange(self.last + 1, ticks + 1))
        held = (np.repeat(q[-1:], more, axis=0), still, still)
        self.stream = Setpoints(period, t, *(np.concatenate([x, y]) for x, y in zip((q, dq, ddq), held, strict=True)))

    def record(self, start: float, times: Array, steps: Steps) -> None:
        """Append what the arm did in one period."""
        self.t.append(start + times)
        self.q.append(steps.q)
        self.dq.append(steps.dq)
        if steps.torque is not None:
            self.torque.append(steps.torque)
