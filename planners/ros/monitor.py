"""What is heard of an arm: its joints from the joint states, and a sent motion from feedback and joint states."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.scene.files import NANOSECONDS
from optik.types import Array
from planners.following.failure import joint_unit
from planners.ros.transport import Feedback, Goal, Transport
from planners.trajectory import Trajectory

REST_SPEED = 0.02
"""Largest velocity of a joint at rest [rad/s, m/s]: measured velocities are noisy."""
DESIRED = 1e-3
"""Largest distance of a controller's desired state from the sent motion [rad, m]; beyond it the controller executes
something else, and its time on the motion is unknown."""
WINDOW = 1.0
"""Half-width of the time window in which the controller's desired state is searched [s]: feedback may be late, or the
controller slowed."""


class Measurement(NamedTuple):
    """The states of all joints: positions (n,) [rad, m], velocities (n,) [rad/s, m/s], and two times.

    ``stamp`` is the robot's time of the oldest joint state [ns]; ``at`` is the time of its arrival by `time.monotonic` [s].
    """

    q: Array
    dq: Array
    stamp: int
    at: float


class JointStates(NamedTuple):
    """The joint states of an arm as they arrive by a transport."""

    robot: Robot
    transport: Transport
    names: tuple[str, ...]  # the controller's, in the order of the robot's joints
    age: float  # largest age of a state that counts as a present measurement [s]

    def read(self) -> Measurement:
        """Return the latest joint states; NaN for a joint without a fresh state."""
        q, dq = np.full((2, self.robot.n), np.nan)
        stamp, at = 0, time.monotonic()
        oldest, readings = at - self.age, self.transport.readings
        for i, name in enumerate(self.names):
            reading = readings.get(name)
            if reading is not None and reading.fresh and reading.at >= oldest:
                q[i], dq[i] = reading.position, reading.velocity
                stamp, at = (reading.stamp, reading.at) if reading.at <= at else (stamp, at)
        return Measurement(q, dq, stamp, at)

    def wait_for_rest(self, seconds: float) -> tuple[str, str]:
        """Return reason and advice if the joint states do not show the arm at rest in time; empty strings otherwise."""
        until = time.monotonic() + seconds
        while time.monotonic() < until and not self.transport.lost:
            q, dq = self.read()[:2]
            if np.isfinite(q).all() and (np.abs(dq) <= REST_SPEED).all():
                return "", ""
            time.sleep(0.01)
        if self.transport.lost:
            return self.transport.lost, "make sure that the other side runs, and connect again"
        q, dq = self.read()[:2]
        if not np.isfinite(q).all():
            return self.explain_unknown(q, seconds)
        mute = [name for name, unknown in zip(self.robot.joint_names, ~np.isfinite(dq), strict=True) if unknown]
        if mute:
            what = f"the joint states have no velocity of {', '.join(mute)}: it is not known whether the arm is at rest"
            return what, "use a joint state broadcaster that sends velocities"
        i = int(np.abs(dq).argmax())
        what = f"{self.robot.joint_names[i]} moves at {dq[i]:.3g} {joint_unit(self.robot, i)}/s; a plan begins at rest"
        return what, "wait until the arm is at rest"

    def explain_unknown(self, q: Array, seconds: float) -> tuple[str, str]:
        """Return the reason why joints of q (n,) [rad, m] are NaN after a wait [s], and advice."""
        readings, waited = self.transport.readings, f"within {seconds:g} s"
        odd = f"; the latest message that could not be read: {self.transport.odd}" if self.transport.odd else ""
        if not readings:
            return f"no joint states arrived {waited}{odd}", "check that the joint state broadcaster runs"
        names = [name for name, position in zip(self.names, q, strict=True) if not np.isfinite(position)]
        absent = [name for name in names if name not in readings]
        if absent:
            what = f"the joint states have no {', '.join(absent)}; they have {', '.join(readings)}"
            return what[:300], "pass joint_names, a mapping from the robot's joint names to the controller's"
        empty = [name for name in names if not np.isfinite(readings[name].position)]
        if empty:
            return f"the position of {', '.join(empty)} is NaN or infinite", "repair the encoder or its driver"
        what = f"the joint states of {', '.join(names)} are stale: none with a new stamp arrived {waited}{odd}"
        return what, "check that the joint state broadcaster and the robot's clock run"


class MotionRecord:
    """The record of a sent motion: its start on both clocks, and the joint states since it was sent."""

    def __init__(self, joints: JointStates) -> None:
        self.joints, self.sent = joints, time.monotonic()
        self.begun: float | None = None  # start of the motion by this machine's clock [s]; None before feedback
        self.stamp: int | None = None  # start of the motion on the controller's clock [ns]; None while it is unknown
        self.trips = (np.inf, 0.0)  # shortest and longest total travel time of the goal and a feedback message [s]
        self.samples: list[Measurement] = []
        self._located: Feedback | None = None
        self._fastest = 0.0

    @property
    def start(self) -> float:
        """Start of the motion on this machine's clock [s]; while it is unknown, the time at which its goal was sent."""
        return self.sent if self.begun is None else self.begun

    @property
    def now(self) -> float:
        """Time since the start of the motion, or since its goal was sent while the start is unknown [s]."""
        return time.monotonic() - self.start

    def listen(self, goal: Goal, motion: Trajectory) -> tuple[Measurement, bool]:
        """Record feedback and joint states; return the latest joint states, and whether they are complete and new."""
        self._locate(goal, motion)
        state = self.joints.read()
        new = bool(np.isfinite(state.q).all()) and (not self.samples or state.at > self.samples[-1].at)
        if new:
            self.samples.append(state)
        return state, new

    def _locate(self, goal: Goal, motion: Trajectory) -> None:
        """Estimate the start of the motion from the desired state in the latest feedback."""
        feedback, names = goal.feedback, self.joints.names
        if feedback is None or feedback is self._located:
            return
        self._located = feedback
        if not set(names) <= set(feedback.names):
            return
        order, heard = [feedback.names.index(name) for name in names], goal.heard
        q, dq = feedback.positions[order], np.nan_to_num(feedback.velocities[order])
        t = _find_instant(motion, q, dq, heard - self.start)
        speed = float(np.abs(dq).max())
        if t is None or t <= 0.0 or t >= motion.end or speed < 0.5 * self._fastest:
            return  # near rest a small difference in position is a long time
        self._fastest = max(speed, self._fastest)
        self.begun = heard - t
        self.stamp = feedback.stamp - round(t * NANOSECONDS) if feedback.stamp else None
        trip = max(self.begun - self.sent, 0.0)
        self.trips = min(self.trips[0], trip), max(self.trips[1], trip)

    def is_at_rest(self, tolerance: float) -> bool:
        """Return whether the last two joint states show an arm at rest, to a tolerance [rad, m]."""
        before, after = self.samples[-2:]
        most = tolerance / 10.0 * max(after.at - before.at, 1.0)
        return bool((np.abs(after.q - before.q) <= most).all() and not (np.abs(after.dq) > tolerance).any())

    def collect(self) -> tuple[Array, Array, Array]:
        """Return times since the start, positions and velocities of the joint states, by the robot's clock if it is known."""
        start = self.samples[0].q if self.samples else self.joints.read().q
        rows, last = [(0.0, start, np.zeros(start.size))], 0.0
        for q, dq, stamp, at in self.samples:
            t = (stamp - self.stamp) / NANOSECONDS if stamp and self.stamp else at - self.start
            if t > max(last, 0.0):
                rows.append((t, q, dq))
            last = t
        times, positions, velocities = (np.array(column) for column in zip(*rows, strict=True))
        return times, positions, velocities


def _find_instant(motion: Trajectory, q: Array, dq: Array, near: float) -> float | None:
    """Return the instant near a time at which a motion has a state; None if there is none."""
    low, high = max(near - WINDOW, 0.0), min(near + WINDOW, motion.end)
    if low >= high:
        return None
    for _ in range(6):  # a grid refined to a picosecond; the motion may rest for a while, where Newton's method fails
        grid = np.linspace(low, high, 201)
        off = np.abs(motion(grid) - q).max(axis=1) + 0.01 * np.abs(motion(grid, 1) - dq).max(axis=1)
        best = int(off.argmin())
        step = float(grid[1] - grid[0])
        low, high = max(float(grid[best]) - step, 0.0), min(float(grid[best]) + step, motion.end)
    t = float(grid[best])
    return t if float(np.abs(motion(t) - q).max()) <= DESIRED else None
