"""Stops over ROS while feedback comes 0 to 0.5 s late: what the controller's stand-in commands, step by step.

The stand-in (`tests/planners/rosbridge_server.py`) runs in another process, continues along the motion until a stop's instant
and writes down every trajectory that it installs. Arm, motion, range of the delays and time of the request are random.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import uuid
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import optik
import planners
from planners.cell.drives.ros import RosDrive
from planners.ros.rosbridge import RosbridgeTransport
from tests.figures.figure import Row, Value, main
from tests.planners import rosbridge_server

SEED, PERIOD, LATEST = 21, 0.004, 0.5
ARMS = ("irb120", "ur5e", "paper6r", "gen3lite")


def motion(rng: np.random.Generator) -> planners.Plan:
    """A joint move of about two seconds at the velocity limit of some joint."""
    robot = optik.load(str(rng.choice(ARMS))).with_payload(None)
    low, high = np.maximum(robot.limits.lower, -2.0), np.minimum(robot.limits.upper, 2.0)
    while True:
        a, b = rng.uniform(low, high, (2, robot.n))
        speed = float(np.abs(b - a).max() / rng.uniform(1.5, 2.5))
        limits = planners.MotionLimits(velocity=speed, acceleration=8.0 * speed, jerk=100.0 * speed)
        found = planners.plan(robot, b, a, timing="ruckig", limits=limits)
        if found:
            return found


def measure(case: int) -> Row:
    """Execute one motion, stop it, and compare every step of what was commanded with the velocity limit."""
    rng = np.random.default_rng([SEED, case])
    plan = motion(rng)
    least, most = np.sort(rng.uniform(0.0, LATEST, 2))
    request = float(rng.uniform(0.1, 0.8) * plan.trajectory.end)
    server = subprocess.Popen([sys.executable, rosbridge_server.__file__], stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    with tempfile.TemporaryDirectory() as folder, server:
        trace = Path(folder) / "trace.jsonl"
        words: dict[str, Any] = {
            "id": uuid.uuid4(), "names": ",".join(plan.robot.joint_names), "trace": trace, "seed": case,
            "q": ",".join(map(str, plan.trajectory(0.0))), "least": least, "late": most,
        }  # fmt: skip
        query = "&".join(f"{key}={value}" for key, value in words.items())
        url = f"ws://127.0.0.1:{int(server.stdout.readline())}/ok?{query}"
        with RosbridgeTransport(url, timeout=20.0) as transport:
            done = RosDrive(plan.robot, transport, execute=True, patience=20.0).execute(plan, stop=request)
        server.kill()
        q = rosbridge_server.commanded(trace, PERIOD)
    step = np.abs(np.diff(q, axis=0)) / (np.asarray(plan.limits.arrays(plan.robot.n)["velocity"]) * PERIOD)
    return {
        "least": least, "late": most, "request": request, "end": plan.trajectory.end, "status": str(done.status),
        "how": "stop" if done.stop_plan is not None else "to the end" if done else "cancelled", "reason": done.reason,
        "step": float(step.max()), "jump_noted": any("jumped" in note for note in done.notes),
    }  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    """The largest step of all cases."""
    worst = max(rows, key=lambda row: row["step"])
    how = ", ".join(f"{count} {name}" for name, count in Counter(row["how"] for row in rows).most_common())
    faults = [row["case"] for row in rows if row["status"] not in ("stopped", "done")]
    return [
        Value("step of the commanded position over velocity limit x period", "<= 1 in all", f"{worst['step']:.6g} in the "
              f"worst of {len(rows)} ({how})", worst["step"] <= 1.0 + 1e-9),
        Value("executions that ended with a fault", "0", f"{len(faults)} {faults[:5]}", not faults),
    ]  # fmt: skip


if __name__ == "__main__":
    main("ros_late", measure, 200, judge)
