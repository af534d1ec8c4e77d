"""Pick cycles through known configurations, out and back: how many are solved, and whether samples contradict a certificate.

A cycle passes home, an approach, a pick 40 to 150 mm below it, and the approach again; then it returns home the same way, or
by a place. Points are configurations, poses, or poses with a tolerance. Samples at 20 kHz are compared with the limits, and
with the points in their order by SciPy's nearest neighbours.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

import optik
from optik import Robot, se3
from optik.errors import OptikError
from optik.ik import solve_ik
from planners import MotionLimits, PointToPoint, ViaPoint, plan
from tests import oracles
from tests.figures.figure import Row, Value, main

ARMS = ("ur5e", "panda", "paper6r", "iiwa14", "irb120")
LAWS = ("optimal", "smooth", "ruckig", "toppra", "constant_speed")
COUNT, RATE, MOST = 500, 20_000.0, 600_000
LIMITS = MotionLimits(2.0, 5.0, 50.0)


def near(robot: Robot, q: np.ndarray, pose: np.ndarray) -> np.ndarray | None:
    """A configuration of the pose near q, or None."""
    found = solve_ik(robot, pose, q)
    return found.q if found and np.abs(found.q - q).max() < 1.5 else None


def cycle(case: int) -> tuple[Robot, np.ndarray, list[ViaPoint | np.ndarray]]:
    """The arm, the start, and the points of a cycle."""
    robot, rng = optik.load(ARMS[case % len(ARMS)]), np.random.default_rng([37, 2, case])
    limits = robot.limits
    while True:
        home, approach = limits.sample(rng, 2)
        middle = 0.5 * (limits.lower + limits.upper)
        home, approach = middle + 0.6 * (home - middle), middle + 0.6 * (approach - middle)
        approach = home + np.clip(approach - home, -0.8, 0.8)
        above = robot.fk(approach)
        down = se3.pose(above[:3, :3], above[:3, 3] - [0.0, 0.0, rng.uniform(0.04, 0.15)])
        pick, place = near(robot, approach, down), approach + rng.uniform(-0.5, 0.5, robot.n)
        if pick is not None and limits.contains(place) and np.abs(pick - approach).max() > 1e-3:
            break
    way = [approach, pick, approach]
    kind = case // len(ARMS) % 4
    way += [[home], [place, home], [home, *way, home], [place, approach, pick, approach, home]][kind]
    points: list[ViaPoint | np.ndarray] = []
    for q in way[:-1]:
        style = rng.integers(3)
        if style == 0:
            points.append(q)
        else:
            points.append(ViaPoint(robot.fk(q), None if style == 1 else (float(rng.uniform(1e-4, 5e-3)), 0.02)))
    return robot, home, [*points, way[-1]]


def measure(case: int) -> Row:
    """One cycle by each time law."""
    robot, home, points = cycle(case)
    row: Row = {"arm": robot.name}
    try:
        path = PointToPoint(robot, home, *points)
    except OptikError as error:
        return row | {"path": str(error)}
    for law in LAWS:
        limits = MotionLimits(2.0, 5.0) if law == "toppra" else LIMITS
        try:
            made = plan(robot, path, home, limits=limits, timing=law)
        except OptikError as error:
            row[law] = {"status": "refused", "reason": str(error)}
            continue
        row[law] = {"status": str(made.status), "reason": "" if made else made.failure.reason}
        if made:
            row[law] |= {"duration": made.trajectory.duration, **contradictions(made, made.certificate.enforced)}
    return row


def contradictions(made: object, enforced: tuple[str, ...]) -> dict[str, float]:
    """The largest ratio of samples to the limits, and how far the samples are from the points in their order."""
    motion, path = made.trajectory, made.path  # type: ignore[attr-defined]
    count = min(int(RATE * motion.duration), MOST)  # a motion at constant speed may take hours
    t = np.linspace(0.0, motion.duration, count + 1)
    joints, bound, worst = oracles.Joints(motion), made.limits.arrays(motion.n), 0.0  # type: ignore[attr-defined]
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        if name in enforced:
            worst = max(worst, float((np.abs(joints(t, order)) / bound[name]).max()))
    q = joints(t, 0)
    # From the points in their order: each one's first sample within its distance comes after that of the one before.
    begin, late = 0, 0.0
    for via in [*path.vias, None]:
        pose = path.robot.fk(motion(motion.duration)) if via is None else via.pose
        tool = path.robot.fk(q[begin:])
        off = np.linalg.norm(tool[:, :3, 3] - pose[:3, 3], axis=1)
        most = 2e-3 if via is None or via.tolerance is None else via.tolerance.position + 2e-3
        reached = np.flatnonzero(off <= most)
        if not reached.size:
            late = float("inf")
            break
        begin += int(reached[0])
    few = q[:: max(1, len(q) // 1000)]
    off = np.full(len(few), np.inf)
    for begin, end in pairwise([0.0, *(via.s for via in path.vias), path.end]):
        leg = path.configurations(path.robot, np.linspace(begin, end, 50_000))
        _, near = cKDTree(leg).query(few)
        for segment in (near - 1, near):
            off = np.minimum(off, distances(few, leg, np.clip(segment, 0, len(leg) - 2)))
    return {"ratio": worst, "order": late, "off": float(off.max()), "end": float(np.abs(q[-1] - leg[-1]).max())}


def distances(x: np.ndarray, line: np.ndarray, i: np.ndarray) -> np.ndarray:
    """Distances of points x (k, n) from the segments i (k,) of a polyline."""
    a, e = line[i], line[i + 1] - line[i]
    part = np.clip(((x - a) * e).sum(axis=1) / np.maximum((e * e).sum(axis=1), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(x - a - part[:, None] * e, axis=1))


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    made = [row for row in rows if "path" not in row]
    values = [Value("paths", f"≥ 99 % of {COUNT}", f"{len(made)} of {len(rows)}", len(made) >= 0.99 * len(rows))]
    for law in LAWS:
        solved = [row[law] for row in made if row[law]["status"] == "solved"]
        failed = [row for row in made if row[law]["status"] not in ("solved", "refused")]
        unproved = [row["case"] for row in made if row[law]["status"] == "not_proved"]
        wrong = [x for x in solved if x["ratio"] > 1.0 + 1e-9 or x["order"] > 0.0 or x["off"] > 1e-5 or x["end"] > 1e-9]
        for row in failed:
            print(f"    {law}, case {row['case']}: {row[law]['reason'][:200]}")
        if law == "constant_speed":
            values.append(Value(f"{law}: a motion or a reason", "all", f"{len(solved)} motions of {len(made)}", True))
        else:
            enough = len(solved) >= 0.99 * len(made)
            values.append(Value(f"{law}: solved", "≥ 99 %", f"{len(solved)} of {len(made)}", enough))
        values.append(Value(f"{law}: not proved", "0", f"{len(unproved)}", not unproved))
        values.append(Value(f"{law}: contradicted at 20 kHz", "0", f"{len(wrong)} of {len(solved)}", not wrong))
    return values


if __name__ == "__main__":
    main("pick_cycles", measure, COUNT, judge)
