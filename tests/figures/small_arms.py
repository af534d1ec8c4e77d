"""Lines of 100 mm by arms with three to five joints: only the tool's point follows, or its point and axis.

The environment variable ARMS names a folder of files NAME.urdf; arms whose file is missing are left out. The oracle is a
plain continuation of the same rows with steps of least norm, in NumPy, from the same start: what it follows inside the limits
must be solved. Each motion is evaluated at 20 kHz by our own product of transforms: deviation of what is asked, and all limits.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np

import planners
from optik import Robot
from optik.types import Array
from planners import Line, MotionLimits
from tests.figures.figure import Row, Value, main

SEED, PLACES, STEPS, LENGTH, RATE = 20261129, 20, 1000, 0.1, 20_000.0
TIPS = {
    "m430ia2f": "tool0", "lrmate200ic5f": "tool0", "xarm5": "link_eef", "j2n4s300": "j2n4s300_end_effector",
    "p3020": "link_6", "so100": "gripper", "so101": "gripper_frame_link", "wx250": "wx250/ee_gripper_link",
    "px100": "px100/ee_gripper_link", "mypalletizer": "link5", "ultraArm": "link3", "om_x": "end_effector_link",
}  # fmt: skip
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
EXCESS = 1e-9


@cache
def arm(name: str) -> Robot:
    return Robot.from_urdf(Path(os.environ["ARMS"]) / f"{name}.urdf", tip=TIPS[name])


def poses(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Return the tool's poses (k, 4, 4) and Jacobians (k, 6, n) of configurations (k, n), by products of transforms."""
    T, axes, points = np.tile(np.eye(4), (len(q), 1, 1)), [], []
    for i, slides in enumerate(robot.prismatic):
        T, move = T @ robot.fixed[i], np.tile(np.eye(4), (len(q), 1, 1))
        c, s = np.cos(q[:, i]), np.sin(q[:, i])
        if slides:
            move[:, 2, 3] = q[:, i]
        else:
            move[:, 0, 0], move[:, 0, 1], move[:, 1, 0], move[:, 1, 1] = c, -s, s, c
        T = T @ move
        axes.append(T[:, :3, 2])
        points.append(T[:, :3, 3])
    T = T @ robot.tool
    columns = [
        np.concatenate([z, 0.0 * z] if slides else [np.cross(z, T[:, :3, 3] - p), z], axis=1)
        for z, p, slides in zip(axes, points, robot.prismatic, strict=True)
    ]
    return T, np.stack(columns, axis=2)


def is_followed(robot: Robot, q: Array, goal: Array, axis: bool) -> bool:
    """Return whether least-norm steps for the point's three rows, or also the axis' two, follow the line inside the limits."""
    start = poses(robot, q[None])[0][0]
    across = start[:3, :2].T
    for u in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        for _ in range(5):
            (T,), (J,) = poses(robot, q[None])
            error = start[:3, 3] + u * (goal - start[:3, 3]) - T[:3, 3]
            rows = J[:3]
            if axis:
                error = np.append(error, across @ np.cross(T[:3, 2], start[:3, 2]))
                rows = np.concatenate([rows, across @ J[3:]])
            step = np.linalg.lstsq(rows, error, rcond=1e-6)[0]
            if not np.abs(step).max() < 0.2:
                return False
            q = q + step
        if np.abs(error).max() > 1e-9 or not robot.limits.contains(q):
            return False
    return True


def measure(case: int) -> Row:
    name, rng = list(TIPS)[case // PLACES], np.random.default_rng([SEED, case])
    if not (Path(os.environ["ARMS"]) / f"{name}.urdf").exists():
        return {"arm": name, "missing": True}
    robot = arm(name)
    q = robot.limits.middle + 0.6 * (robot.limits.sample(rng, 1)[0] - robot.limits.middle)
    start, way = robot.fk(q), rng.normal(size=3)
    goal = start.copy()
    goal[:3, 3] += LENGTH * way / np.linalg.norm(way)
    row: Row = {"arm": name, "missing": False}
    for axis in (False, True) if robot.n == 5 else (False,):
        freed = planners.free(Line(start, goal), turn=True, **({} if axis else {"tilt": True}))
        plan = planners.plan(robot, freed, q, limits=LIMITS)
        word = "axis" if axis else "point"
        row |= {f"{word}_possible": is_followed(robot, q, goal[:3, 3], axis), f"{word}_solved": bool(plan)}
        if not plan:
            row[f"{word}_why"] = "" if plan.failure is None else plan.failure.reason[:300]
            continue
        row[f"{word}_violations"] = count_violations(robot, plan, start, goal, axis)
        row[f"{word}_proved"] = plan.certificate.is_valid
    return row


def count_violations(robot: Robot, plan: planners.Plan, start: Array, goal: Array, axis: bool) -> int:
    """Return the number of instants at 20 kHz at which a limit or the proved deviation is exceeded."""
    motion, proof = plan.trajectory, plan.certificate.path_error
    t = np.append(np.arange(0.0, motion.duration, 1.0 / RATE), motion.duration)
    T = poses(robot, motion(t))[0]
    along = (goal - start)[:3, 3] / LENGTH
    off = T[:, :3, 3] - start[:3, 3]
    off -= np.clip(off @ along, 0.0, LENGTH)[:, None] * along
    wrong = np.linalg.norm(off, axis=1) > proof.distance + 1e-12
    if axis:
        wrong |= 2.0 * np.arcsin(0.5 * np.linalg.norm(T[:, :3, 2] - start[:3, 2], axis=1)) > proof.angle + 1e-12
    wrong |= ~robot.limits.contains(motion(t))
    for order, most in ((1, 2.0), (2, 10.0), (3, 100.0)):
        wrong |= (np.abs(motion(t, order)) > most * (1.0 + EXCESS)).any(axis=1)
    return int(wrong.sum())


def judge(rows: list[Row]) -> list[Value]:
    found = [row for row in rows if not row["missing"]]
    values = [Value("arms with a file", "12", str(len({row["arm"] for row in found})), len(found) == len(rows))]
    for word in ("point", "axis"):
        possible = [row for row in found if row.get(f"{word}_possible")]
        solved = sum(row[f"{word}_solved"] for row in possible)
        share = solved / max(1, len(possible))
        more = sum(bool(row.get(f"{word}_solved")) for row in found) - solved
        measured = f"{solved} of {len(possible)}, and {more} others"
        values.append(Value(f"{word}: solved of those that continuation follows", "95 %", measured, share >= 0.95))
        done = [row for row in found if row.get(f"{word}_solved")]
        proved, wrong = sum(row[f"{word}_proved"] for row in done), sum(row[f"{word}_violations"] for row in done)
        values.append(Value(f"{word}: certificates", f"{len(done)}", f"{proved}", proved == len(done)))
        values.append(Value(f"{word}: violations at 20 kHz", "0", f"{wrong}", wrong == 0))
    return values


if __name__ == "__main__":
    main("small_arms", measure, len(TIPS) * PLACES, judge)
