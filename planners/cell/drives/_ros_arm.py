"""RosArm: the arm of a RosDrive, measured by the joint states of its transport."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from optik.types import Array
from planners.cell.drives.base import Drive
from planners.following.failure import joint_unit
from planners.ros.transport import Transport

REST_SPEED = 0.02
"""Largest velocity of a joint at rest [rad/s, m/s]: measured velocities are noisy."""


class Timing(NamedTuple):
    """The waiting times of a drive, and the largest age of a joint state.

    Attributes
    ----------
    state_age : float
        Largest age of a joint state [s].
    patience : float
        Longest wait for joint states, for the acceptance of a goal, and for the arm to come to rest [s].
    grace : float
        Time that a goal may take beyond its motion [s].
    latency : float
        Time from sending a stop to its first instant [s].
    stops_every : float
        Spacing of the instants of stops [s].
    """

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
    """The base of `RosDrive`: an arm whose joints are measured by the joint states of a transport.

    Attributes
    ----------
    transport : Transport
        Connection to the controller.
    columns : dict of str to int
        Index of the joint of each name of the controller.
    start_tolerance : float
        Largest distance of each measured joint from the start of a plan [rad, m].
    timing : Timing
        Waiting times and the largest age of a joint state.
    """

    transport: Transport
    columns: dict[str, int]
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
