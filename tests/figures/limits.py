"""Limits as makers and goods state them: random motions of several arms, judged by formulas of their own at 20 kHz.

The cases of one kind follow each other, so that a part of each runs by default. Body speeds are those of 400 points on the end
spheres of each capsule at 2 kHz; the other values are evaluated at 20 kHz with SciPy's polynomials and our oracles' kinematics.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import scipy

import optik
from optik.arm.robot import Robot
from optik.types import Array
from planners import JointLine, Line, MotionLimits, plan
from planners.limits import AccelerationByVelocity, Grip, OpenContainer, Suction, Tray, kind_of
from planners.trajectory import Trajectory
from tests.figures.figure import Row, Value, main

COUNTS = {
    "velocity_by_position": 1000,
    "acceleration_by_velocity": 300,
    "body_speed": 300,
    "open_container": 200,
    "grip": 200,
    "tray": 50,
    "suction": 50,
}
"""Number of motions of each limit."""
LAWS = ("optimal", "toppra")
BOX: dict[str, Any] = {"acceleration": 10.0, "jerk": 100.0, "torque": None, "torque_rate": None}
SHAPED = ("ur5e", "panda", "paper6r", "ur10e")
PART = 5
"""One of so many motions runs by default."""


def cases() -> list[tuple[str, int]]:
    return [(name, i) for name, count in COUNTS.items() for i in range(count)]


def value_of(name: str, robot: Robot) -> Any:
    up = tuple(float(x) for x in (0.0, 0.0, 1.0))
    return {
        "velocity_by_position": robot.limits.velocity_by_position,
        "acceleration_by_velocity": AccelerationByVelocity(10.0, 14.0, 4.0),
        "body_speed": 0.25,
        "open_container": OpenContainer(np.deg2rad(15.0), up, (0.0, 0.0, 0.05)),
        "grip": Grip(0.4, 13.0, 1.0, "y", (0.0, 0.0, 0.08)),
        "tray": Tray(0.3, 3.0, up, (0.0, 0.0, 0.05)),
        "suction": Suction(0.5, 30.0, 1.0, "-z", (0.0, 0.0, -0.05)),
    }[name]


def draw(name: str, i: int) -> tuple[Robot, Any, Array] | None:
    """A motion: a joint line over the whole range, or a line of the tool with its z axis up."""
    rng = np.random.default_rng([i, len(name)])
    robot = optik.load("fr3" if name == "velocity_by_position" else SHAPED[i % len(SHAPED)])
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    if name == "velocity_by_position":
        slowed = robot.limits.velocity_by_position
        gap = slowed.offset**2 / (2.0 * slowed.deceleration) + 1e-3
        ends = rng.uniform(lower + gap, upper - gap, (2, robot.n))
        return robot, JointLine(robot, *ends), ends[0]
    if name in ("acceleration_by_velocity", "body_speed") and i % 8 < 4:
        ends = rng.uniform(0.8 * lower, 0.8 * upper, (2, robot.n))
        return robot, JointLine(robot, *ends), ends[0]
    g = -np.asarray(robot.gravity) / np.linalg.norm(robot.gravity)
    for _ in range(200):
        T = robot.fk(rng.uniform(0.8 * lower, 0.8 * upper)).copy()
        if name not in ("acceleration_by_velocity", "body_speed"):
            x = np.cross(g, rng.normal(size=3))
            x /= np.linalg.norm(x)
            T[:3, :3] = np.stack([x, np.cross(g, x), g], axis=1)
        found = optik.solve_ik(robot, T, 0.5 * (lower + upper))
        goal, step = T.copy(), rng.normal(size=3)
        goal[:3, 3] += rng.uniform(0.2, 0.5) * step / np.linalg.norm(step)
        if found and robot.singular_values(found.q[None])[0].min() > 0.08:
            limits = MotionLimits.of(robot, **BOX | {"velocity": _speeds(robot)})
            if plan(robot, Line(T, goal), found.q, limits=limits):
                return robot, Line(T, goal), found.q
    return None


def _speeds(robot: Robot) -> Array:
    return np.full(robot.n, 2.0) if robot.limits.velocity is None else robot.limits.velocity


def dense(name: str, robot: Robot, value: Any, motion: Trajectory) -> float:
    """The largest ratio at dense instants."""
    own = scipy.interpolate.PPoly(motion.coefficients, motion.knots)
    t = np.arange(0.0, motion.end, 1.0 / 20_000)
    q, v, a = own(t), own(t, 1), own(t, 2)
    if name == "velocity_by_position":
        room = np.where(v > 0.0, robot.limits.upper - q, q - robot.limits.lower)
        most = np.minimum(robot.limits.velocity, np.sqrt(2.0 * value.deceleration * room) - value.offset)
        return float((np.abs(v) / most).max())
    if name == "acceleration_by_velocity":
        y = np.where(np.abs(v) > 1e-9, np.sign(v), 0.0) * a
        return float(np.maximum((y + 2.5 * np.abs(v)) / 10.0, -y / 14.0).max())
    if name == "body_speed":
        return _body(robot, own, motion.end) / value
    h, com = 1e-4, np.array(value.com)
    t = t[(t > h) & (t < motion.end - h)]
    T = [robot.fk(own(t + d)) for d in (-h, 0.0, h)]
    place = [x[:, :3, 3] + x[:, :3, :3] @ com for x in T]
    g = robot.gravity_magnitude * np.asarray(robot.gravity) / np.linalg.norm(robot.gravity)
    f = np.einsum("kji,kj->ki", T[1][:, :3, :3], g - (place[2] - 2.0 * place[1] + place[0]) / h**2)
    axis = np.array(value.axis)
    along, across = f @ axis, np.linalg.norm(np.cross(f, axis), axis=1)
    if name in ("open_container", "tray"):
        most = value.angle if name == "open_container" else np.arctan(min(value.friction, 1.0 / value.slenderness))
        return float((np.arctan2(across, -along) / most).max())
    if name == "grip":
        return float(np.maximum(across / (2.0 * value.friction * value.force), np.abs(along) / value.force).max())
    return float((across / value.friction + along).max() / value.force)


def _body(robot: Robot, own: Any, end: float) -> float:
    rng, most = np.random.default_rng(1), 0.0
    t = np.arange(0.0, end - 1e-6, 1.0 / 2000)
    now, then = robot.frames(own(t)), robot.frames(own(t + 1e-6))
    for link, first, second, radius in zip(*robot.shapes.capsules, strict=True):
        for centre in (first, second) if link else ():
            n = rng.normal(size=(200, 3))
            p = centre + radius * n / np.linalg.norm(n, axis=1)[:, None]
            moved = [x[:, link - 1, :3, :3] @ p.T + x[:, link - 1, :3, 3:] for x in (now, then)]
            most = max(most, float(np.linalg.norm(moved[1] - moved[0], axis=1).max()) / 1e-6)
    return most


def measure(case: int) -> Row:
    name, i = cases()[case]
    if i % PART:
        return {"name": name, "skipped": True}
    found = draw(name, i)
    if found is None:
        return {"name": name, "skipped": True}
    robot, path, q = found
    value, box = (
        value_of(name, robot),
        MotionLimits.of(robot, **BOX | {"velocity": _speeds(robot), "velocity_by_position": None}),
    )
    if name == "velocity_by_position":
        box = MotionLimits.of(robot, velocity_by_position=None)
    given = MotionLimits.of(
        robot,
        extra={**dict(box.extra or {}), name: value},
        **{k: box.value(k) for k in ("velocity", "acceleration", "jerk", "torque", "torque_rate")},
    )
    row: Row = {"name": name, "skipped": False, "arm": robot.name}
    for law in LAWS:
        free = plan(robot, path, q, limits=box, timing=law, allow="jerk")
        begin = time.process_time()
        one = plan(robot, path, q, limits=given, timing=law, allow="jerk")
        row[f"{law}_cpu"] = time.process_time() - begin
        begin = time.process_time()
        plan(robot, path, q, limits=box, timing=law, allow="jerk")
        row[f"{law}_box_cpu"] = time.process_time() - begin
        row[f"{law}_ok"], row[f"{law}_why"] = bool(one), "" if one else str(one.failure.reason)[:120]
        if free and law == "optimal":
            row["box"] = dense(name, robot, value, free.trajectory)
            slowed = kind_of(name).stretch_factor(free.certificate.analysis, given.bounds(robot.n)[name])
            row["uniform"] = slowed if np.isfinite(slowed) else None
        if one and free:
            row |= {
                f"{law}_dense": dense(name, robot, value, one.trajectory),
                f"{law}_proof": one.certificate.worst(name)[0],
                f"{law}_over": one.duration / free.duration,
            }
    return row


def judge(rows: list[Row]) -> list[Value]:
    values = []
    for name in COUNTS:
        mine = [row for row in rows if row["name"] == name and not row["skipped"]]
        held = [row for row in mine if "at rest" not in row["optimal_why"]]
        ok = [row for row in held if row["optimal_ok"] and "optimal_dense" in row]
        if not ok:
            continue
        binding = [row for row in ok if row.get("box", 0.0) > 1.0 and row.get("uniform")]
        values.append(
            Value(f"{name}: certified", "all that hold at rest", f"{len(ok)} of {len(held)}", len(ok) == len(held))
        )
        worst = max(row["optimal_dense"] for row in ok)
        values.append(Value(f"{name}: largest ratio found", "≤ 1", f"{worst:.9f}", worst <= 1.0 + 2e-6))
        tight = max(row["optimal_proof"] / row["optimal_dense"] for row in ok if row["optimal_dense"] > 0.5)
        asked = 1.01 if name == "body_speed" else 1.001
        values.append(Value(f"{name}: proof over the largest found", f"≤ {asked}", f"{tight:.6f}", tight <= asked))
        if binding:
            share, over = len(binding) / len(ok), [row["box"] for row in binding]
            values.append(
                Value(
                    f"{name}: box alone exceeds it",
                    "stated",
                    f"{share:.0%} by {np.median(over):.2f} (median), {max(over):.2f}",
                    True,
                )
            )
            ratio = float(np.median([row["optimal_over"] / row["uniform"] for row in binding]))
            asked = 0.92 if name in ("open_container", "grip") else 0.9
            values.append(
                Value(f"{name}: duration over uniform slow-down", f"≤ {asked} (median)", f"{ratio:.3f}", ratio <= asked)
            )
        cpu = 1e3 * float(np.median([row["optimal_cpu"] - row["optimal_box_cpu"] for row in ok]))
        values.append(
            Value(
                f"{name}: CPU more, median",
                "≤ 20 ms" if name == "velocity_by_position" else "stated",
                f"{cpu:.1f} ms",
                cpu <= 20.0 or name != "velocity_by_position",
            )
        )
        if name == "acceleration_by_velocity":
            over = float(np.median([row["toppra_over"] for row in ok if "toppra_over" in row]))
            values.append(
                Value(f"{name}: toppra over its duration without", "≤ 1.10 (median)", f"{over:.3f}", over <= 1.1)
            )
        other = [row for row in held if row["toppra_ok"] and "toppra_dense" in row]
        values.append(
            Value(
                f"{name}: toppra certified",
                "all",
                f"{len(other)} of {len(held)}, {max(row['toppra_dense'] for row in other):.9f}",
                len(other) == len(held),
            )
        )
    return values


if __name__ == "__main__":
    main("limits", measure, len(cases()), judge)
