"""Twelve kinds of linkages as URDFs: kinematics against a plain evaluation, ranges, velocities, torques and ROS messages."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import optik
from planners import JointLine, load_trajectory, plan, to_ros
from tests.figures.figure import Row, Value, main
from tests.oracles.linkages import KINDS

COUNT, CONFIGURATIONS, RATE = len(KINDS), 500, 20_000


def measure(case: int) -> Row:
    name, linkage = list(KINDS.items())[case]
    rng, robot = np.random.default_rng([case, 7]), optik.Robot.from_urdf(linkage.urdf(), "tool0")
    robot = robot.with_limits(acceleration=8.0, jerk=80.0)

    def named(q: np.ndarray) -> dict[str, float]:
        return dict(zip(robot.joint_names, q.tolist(), strict=True))

    drawn = robot.limits.sample(rng, CONFIGURATIONS)
    fk = max(float(np.abs(robot.fk(q) - linkage.fk(named(q))).max()) for q in drawn)
    start, goal = robot.limits.middle, robot.limits.sample(rng, 1)[0]
    found = plan(robot, JointLine(robot, start, goal), start)
    row: Row = {
        "kind": name,
        "fk": fk,
        "drivers": sorted(robot.joint_names) == sorted(linkage.drivers),
        "ok": bool(found),
    }
    t = np.arange(0.0, found.duration, 1.0 / RATE)
    M = np.array([linkage.values(named(e)) for e in np.eye(robot.n)]) - linkage.values(named(np.zeros(robot.n)))
    x = found.trajectory(t) @ M + linkage.values(named(np.zeros(robot.n)))
    low, high, fast = np.array([(*axis.span, axis.speed) for axis in linkage.axes]).T
    row |= {
        "outside": float(np.maximum(low - x, x - high).max()),
        "velocity": float((np.abs(found.trajectory(t, 1) @ M) / fast).max()),
        "torque": _torque_error(linkage.urdf(mimic=False), robot, M, drawn[:100], rng),
    }
    effort = np.array([axis.effort for axis in (*linkage.axes, *linkage.beside)])
    names = [axis.name for axis in (*linkage.axes, *linkage.beside)]
    most = effort[[names.index(joint) for joint in robot.joint_names]]
    states = (found.trajectory(t[::20], order) for order in range(3))
    row["effort"] = float((np.abs(robot.torques(*states)) / most).max())
    with TemporaryDirectory() as folder:
        file = Path(folder) / "a.yaml"
        to_ros(found, file)
        read = load_trajectory(file, robot)
        lines = file.read_text().splitlines()
        at = lines.index("joint_names:") + 1
        row["message"] = [line.strip('- "') for line in lines[at : at + robot.n]] == [*robot.joint_names]
        s = np.linspace(0.0, min(read.end, found.duration), 300)
        row["read"] = float(np.abs(read(s) - found.trajectory(s)).max())
    return row


def _torque_error(text: str, robot: optik.Robot, M: np.ndarray, q: np.ndarray, rng: np.random.Generator) -> float:
    """Return the largest difference from Pinocchio's torques of all axes at the joints [N·m], with friction."""
    import pinocchio

    model, worst = pinocchio.buildModelFromXML(text), 0.0
    model.gravity.linear = robot.gravity_magnitude * robot.gravity
    data, k = model.createData(), np.arange(len(M.T))
    offset = robot.spread(np.zeros(robot.n))
    for one in q:
        v, a = rng.normal(size=(2, robot.n))
        torque = pinocchio.rnea(model, data, one @ M + offset, v @ M, a @ M)
        torque += (0.3 + 0.1 * k) * (v @ M) + (0.2 + 0.05 * k) * np.sign(v @ M)
        worst = max(worst, float(np.abs(robot.torques(one, v, a) - M @ torque).max()))
    return worst


def judge(rows: list[Row]) -> list[Value]:
    def top(key: str) -> float:
        return max(row[key] for row in rows)

    good = sum(row["ok"] and row["drivers"] and row["message"] for row in rows)
    return [
        Value("fk against a plain evaluation [m, 1]", "≤ 1e-12", f"{top('fk'):.2g}", top("fk") <= 1e-12),
        Value("planned, with the driving joints in the message", f"{len(rows)}", f"{good}", good == len(rows)),
        Value("axes outside their ranges [rad, m]", "≤ 1e-9", f"{top('outside'):.2g}", top("outside") <= 1e-9),
        Value("velocity of an axis / limit, at 20 kHz", "≤ 1", f"{top('velocity'):.9f}", top("velocity") <= 1.0 + 1e-9),
        Value("torque of a joint / effort", "≤ 1", f"{top('effort'):.6f}", top("effort") <= 1.0 + 1e-9),
        Value("torques against Pinocchio [N·m, N]", "≤ 1e-9", f"{top('torque'):.2g}", top("torque") <= 1e-9),
        Value("ROS message read back [rad, m]", "≤ 1e-6", f"{top('read'):.2g}", top("read") <= 1e-6),
    ]


if __name__ == "__main__":
    main("linkages", measure, COUNT, judge)
