"""A stream on a joint_trajectory_controller: each motion is a goal that begins at its time on the robot's clock."""

from __future__ import annotations

import time

import numpy as np

from optik.errors import InvalidInput, NoSolution
from optik.scene.messages import NANOSECONDS
from planners.cell.drives._ros_run import RosOptions
from planners.cell.drives._stream_record import StreamRecord, make_record
from planners.retarget.result import Retargeted
from planners.retarget.stream import Stream
from planners.ros.message import Form, message_of
from planners.ros.monitor import JointStates
from planners.ros.replies import write_time
from planners.ros.transport import Goal

SHORTEST_STEP = 1000
"""Least time between two points of a goal [ns]."""


def follow_by_goals(joints: JointStates, options: RosOptions, columns: dict[str, int], stream: Stream) -> StreamRecord:
    """Send each motion of a stream before it begins; take no more targets if one is refused or the connection is lost."""
    if stream.budget < options.latency:
        expected = f"at least the latency of the drive, {options.latency:g} s"
        raise InvalidInput("budget", f"{stream.budget:g} s", expected)
    if not stream.realtime:
        raise InvalidInput("realtime", False, "True: the controller has its own clock")
    reason, advice = joints.wait_for_rest(options.patience)
    if reason:
        raise NoSolution(reason, advice=advice)
    transport, goals = joints.transport, list[Goal]()
    first, _, stamp, at = joints.read()
    before = next(stream)
    began = stamp + round((time.monotonic() - at) * NANOSECONDS)  # of the stream, on the robot's clock [ns]
    off = np.abs(first - before.q)
    if before.dq.any():
        raise InvalidInput("stream", "one that begins with a motion", "a stream that begins at rest")
    if not off.max() <= options.start_tolerance:
        where = f"{joints.robot.joint_names[int(off.argmax())]} is {off.max():.3g} off its start"
        raise InvalidInput("stream", where, "a stream that begins at the arm's present configuration")

    faults: list[str] = []

    def send(motion: Retargeted, begin: float) -> None:
        if faults:  # it would begin where a refused motion would have gone
            return
        times = np.round(motion.trajectory.knots * NANOSECONDS).astype(np.int64)
        times = times[np.append(np.diff(times) >= SHORTEST_STEP, True)]
        message = message_of(motion.trajectory, times, Form("quintic", columns))
        header = message["header"] | {"stamp": write_time(began + round(begin * NANOSECONDS))}
        goals.append(transport.send(message | {"header": header}))

    stream.announce, rows = send, [(before.t, before.q, first)]
    for now in iter(stream.advance, None):
        rows.append((now.t, now.q, joints.read().q))
        k = next((k for k, goal in enumerate(goals) if goal.refused), None)
        if (transport.lost or k is not None) and not faults:
            faults.append(transport.lost or f"the controller refused a motion: {goals[k or 0].refused}")
            stream.stop()
            for goal in goals[k + 1 :] if k is not None else ():
                transport.cancel(goal)
    return make_record(rows, stream, "; ".join(faults))
