"""Path and time together: durations over those of the fixed path, proofs and CPU seconds, of lines, seams, moves, cycles.

A case is one problem of one set. The fixed plan is that of the given path (of the straight joint line; of stops at every via
point). Every motion is certified; the oracle samples it at 2,000 instants: limits, distance from the given path, ranges.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

import optik
from optik.arm.robot import Robot
from optik.errors import OptikError
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Path, Plan, PointToPoint, Polyline, ViaPoint, free, plan
from tests.figures.figure import Row, Value, main
from tests.figures.moving import span

SEED = 20261123
LIMITS = MotionLimits(2.0, 10.0, 100.0)
SETS = {
    "line turn start free": ("torch", 100), "line turn start held": ("torch", 100), "line turn ur5e": ("ur5e", 100),
    "line turn kr6": ("kr6", 100), "line tilt turn": ("torch", 50), "seam 4": ("torch", 50), "seam 40": ("torch", 10),
    "seam 200": ("torch", 3), "line elbow panda": ("panda", 50), "line elbow iiwa14": ("iiwa14", 50),
    "seam elbow": ("panda", 30), "move v j torque": ("loaded", 100), "move all limits": ("loaded", 100),
    "cycle panda": ("panda", 25), "cycle ur5e": ("ur5e", 25),
}  # fmt: skip
"""Arms and numbers of problems."""
CASES = [(name, i) for name, (_arm, count) in SETS.items() for i in range(count)]
HOME = {"panda": [0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.78], "ur5e": [0.2, -1.4, 1.7, -1.9, -1.57, 0.1]}
ROUNDING = 1e-9


def arm_of(name: str) -> Robot:
    """The paper's arm with a torch that leans by 45°, panda with 3 kg, or an arm by its name."""
    if name == "loaded":
        return optik.load("panda").with_payload(3.0)
    if name != "torch":
        return optik.load(name)
    c = float(np.sqrt(0.5))
    return optik.load("paper6r").with_tool([[c, 0, c, 0.05], [0, 1, 0, 0], [-c, 0, c, 0.1], [0, 0, 0, 1]])


def cartesian(robot: Robot, kind: str, rng: np.random.Generator) -> tuple[Path, Array]:
    """A random line of 0.25 m, or a seam of segments of 0.12 m (shorter for many), and its start."""
    low, high = span(robot)
    q = low + (high - low) * rng.uniform(0.25, 0.75, robot.n)
    T, way = robot.fk(q), rng.normal(size=3)
    if kind.startswith("line"):
        goal = T.copy()
        goal[:3, 3] += 0.25 * way / np.linalg.norm(way)
        return Line(T, goal), q
    count = int(kind.split()[1]) if kind.split()[1].isdigit() else 4
    poses, length = [T], min(0.12, 2.0 / count)
    for _ in range(count):
        way = way / np.linalg.norm(way) + 0.6 * rng.normal(size=3) - 3.0 * (poses[-1][:3, 3] - T[:3, 3])
        poses.append(poses[-1].copy())
        poses[-1][:3, 3] += length * way / np.linalg.norm(way)
    return Polyline(np.array(poses), blend=min(5e-3, 0.2 * length)), q


def judge_motion(found: Plan, given: Path | None) -> Row:
    """Sample a motion: the largest ratio to a limit of the joints, and the tool's distance from the given path [m]."""
    t = np.linspace(0.0, found.trajectory.duration, 2000)
    bounds = found.limits.arrays(found.robot.n)
    ratio = max(
        float((np.abs(found.trajectory(t, order)) / bounds[name]).max())
        for order, name in enumerate(("velocity", "acceleration", "jerk"), 1)
    )
    away = 0.0
    if given is not None:
        tool = found.robot.fk(found.trajectory(t))
        away = float(np.linalg.norm(tool[:, :3, 3] - given.pose(given.nearest(tool))[:, :3, 3], axis=1).max())
    ranges = True if found.freedom is None else all(
        r.allowed[0] - ROUNDING <= r.reached[0] and r.reached[1] <= r.allowed[1] + ROUNDING for r in found.freedom.ranges
    )  # fmt: skip
    return {"ratio": ratio, "away": away, "ranges": ranges}


def timed(*arguments: Any, **options: Any) -> tuple[Plan, float]:
    """A plan and its CPU seconds."""
    begin = time.process_time()
    found = plan(*arguments, **options)
    return found, time.process_time() - begin


def on_path(name: str, robot: Robot, rng: np.random.Generator) -> Row:
    """A given path with a freedom against the same path without."""
    while True:
        path, q = cartesian(robot, name, rng)
        fixed, seconds_fixed = timed(robot, path, q, limits=LIMITS)
        if fixed:
            break
    freedoms: dict[str, Any] = {"elbow": True} if "elbow" in name else {"turn": True}
    if "tilt" in name:
        freedoms = {"tilt": 0.2, "turn": (-1.0, 1.0)}
    found, seconds = timed(robot, free(path, hold_start="held" in name, **freedoms), q, limits=LIMITS)
    row = {"status": str(found.status), "seconds": seconds, "seconds_fixed": seconds_fixed}
    if not found:
        return row
    assert found.freedom is not None
    row |= {"gain": found.freedom.gain, "steps": found.freedom.steps, "starts": found.freedom.starts}
    row |= {"outcome": found.freedom.outcome, "segments": path.segments}
    return row | {"T": found.trajectory.duration / fixed.trajectory.duration} | judge_motion(found, path)


def move(name: str, robot: Robot, rng: np.random.Generator) -> Row:
    """A direct move against the straight joint line."""
    own = MotionLimits.of(robot)
    limits = own if "all" in name else MotionLimits(own.velocity, None, own.jerk, torque=own.torque)
    low, high = robot.limits.lower, robot.limits.upper
    while True:
        q, goal = (low + (high - low) * rng.uniform(0.2, 0.8, robot.n) for _ in range(2))
        fixed, _seconds = timed(robot, JointLine(robot, q, goal), q, limits=limits)
        if fixed:
            break
    found, seconds = timed(robot, PointToPoint(robot, q, goal), limits=limits)
    row = {"status": str(found.status), "seconds": seconds}
    if not found:
        return row
    return row | {"T": found.trajectory.duration / fixed.trajectory.duration} | judge_motion(found, None)


def cycle(name: str, robot: Robot, rng: np.random.Generator) -> Row:
    """Pick and place through six via poses against stops at each."""
    home = np.array(HOME[name.split()[1]])
    home[0] += rng.uniform(-1.0, 1.0)
    T, poses = robot.fk(home), []
    for reach in (0.1, 0.15):
        at = T.copy()
        at[:3, 3] += np.append(rng.uniform(-reach, reach, 2), rng.uniform(-0.15, -0.05))
        before, after = at.copy(), at.copy()
        before[:3, 3] += np.append(rng.uniform(-0.04, 0.04, 2), 0.1)
        after[:3, 3] += np.append(rng.uniform(-0.04, 0.04, 2), 0.1)
        poses += [before, at, after]
    begin = time.process_time()
    path = PointToPoint(robot, home, *(ViaPoint(pose, (5e-3, 0.09)) for pose in poses), home)
    found = plan(robot, path, limits=LIMITS)
    row: Row = {"status": str(found.status), "seconds": time.process_time() - begin}
    blended = plan(robot, Polyline(np.array([T, *poses, T]), blend=5e-3), home, limits=LIMITS)
    q = [home, *(via.q for via in path.vias), home]
    stops = [plan(robot, JointLine(robot, a, b), limits=LIMITS) for a, b in pairwise(q)]
    if not found or not all(stops):
        return row
    row["T"] = found.trajectory.duration / sum(one.trajectory.duration for one in stops)
    row["blends"] = found.trajectory.duration / blended.trajectory.duration if blended else None
    return row | {"vias": count_passed(found, poses)} | judge_motion(found, None)


def count_passed(found: Plan, poses: list[Array]) -> int:
    """How many of the poses the tool passes within 5 mm and 0.09 rad, in order: the nearest of 5,000 instants, refined."""

    def miss(t: float, pose: Array) -> float:
        tool = found.robot.fk(found.trajectory(t))
        turned = np.arccos(np.clip((np.vdot(tool[:3, :3], pose[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
        return max(float(np.linalg.norm(tool[:3, 3] - pose[:3, 3])) / 5e-3, float(turned) / 0.09)

    t, after, count = np.linspace(0.0, found.trajectory.duration, 5000), 0, 0
    tools = found.robot.fk(found.trajectory(t))
    for pose in poses:
        off = np.linalg.norm(tools[after:, :3, 3] - pose[:3, 3], axis=1)
        cosine = (np.einsum("kij,ij->k", tools[after:, :3, :3], pose[:3, :3]) - 1.0) / 2.0
        most = np.maximum(off / 5e-3, np.arccos(np.clip(cosine, -1.0, 1.0)) / 0.09)
        for k in np.flatnonzero(most <= 1.05):
            ends = t[max(after + k - 1, 0)], t[min(after + k + 1, t.size - 1)]
            if (
                minimize_scalar(miss, bounds=ends, args=(pose,), method="bounded", options={"xatol": 1e-9}).fun
                <= 1.0 + ROUNDING
            ):
                count, after = count + 1, after + int(k)
                break
    return count


def measure(case: int) -> Row:
    """One problem."""
    name, i = CASES[case]
    robot, rng = arm_of(SETS[name][0]), np.random.default_rng([SEED, list(SETS).index(name), i])
    kind = {"move": move, "cycle": cycle}.get(name.split()[0], on_path)
    try:
        return {"set": name, **kind(name, robot, rng)}
    except OptikError as error:
        return {"set": name, "status": f"{type(error).__name__}: {error}"[:200]}


ASKED = {
    "line turn start free": (0.90, 0.15), "seam 4": (0.95, 0.4), "elbow": (0.95, 0.3), "move v j torque": (0.98, 0.3),
    "move all limits": (0.985, 0.6), "cycle": (0.75, 1.0),
}  # fmt: skip
"""Largest median of the duration's ratio, and of the CPU seconds, of the sets whose names have the words in common."""


def judge_set(name: str, some: list[Row]) -> list[Value]:
    """The figures of one set, or of several."""
    valid = [row for row in some if "T" in row]
    T, worst = np.array([row["T"] for row in valid]), max(row["ratio"] for row in valid)
    most, least = ASKED.get(name, (np.inf, np.inf))
    good = len(valid) == len(some) and T.max() <= 1.0 + 1e-6 and worst <= 1.0 + 1e-8
    good &= all(row["ranges"] for row in valid) and all(row.get("vias", 6) == 6 for row in valid)
    good &= max(row["away"] for row in valid) <= 2e-5
    said = f"{len(valid)} of {len(some)}; T {np.median(T):.4f} ({T.min():.4f} to {T.max():.6f})"
    said += f", a quarter below {np.quantile(T, 0.25):.3f}"
    asked = f"all valid, T ≤ 1, median ≤ {most:g}" if np.isfinite(most) else "all valid, T ≤ 1"
    found = [Value(name, asked, said, bool(good and np.median(T) <= most))]
    if np.isfinite(least):
        seconds = float(np.median([row["seconds"] for row in valid]))
        found.append(Value(f"{name}, CPU", f"median ≤ {least:g} s", f"{seconds:.3f} s", seconds <= least))
    blends = np.array([row["blends"] for row in valid if row.get("blends")])
    if blends.size:
        said = f"{np.quantile(blends, 0.9):.3f}, at most {blends.max():.3f}, of {blends.size}"
        asked = "90 % ≤ 0.9, all ≤ 1"
        fine = np.quantile(blends, 0.9) <= 0.9 and blends.max() <= 1.0
        found.append(
            Value(f"{name}, over straight tool lines with corners rounded within 5 mm", asked, said, bool(fine))
        )
    return found


def judge(rows: list[Row]) -> Sequence[Value]:
    """The figures, set by set."""
    found: list[Value] = []
    for name in [*SETS, "elbow", "cycle"]:
        some = [row for row in rows if row["set"] == name or (name not in SETS and name in row["set"])]
        if some:
            found += judge_set(name, some)
    told = [row["seconds"] / row["seconds_fixed"] for row in rows if "cannot shorten" in row.get("outcome", "")]
    if told:
        said = f"{np.median(told):.2f}, median of {len(told)}"
        found.append(Value("a worthless freedom, CPU over the fixed plan", "≤ 1.2", said, bool(np.median(told) <= 1.2)))
    each = [
        float(np.median([row["seconds"] / n for row in rows if row["set"] == f"seam {n}" and "T" in row] or [np.nan]))
        for n in (4, 40, 200)
    ]
    said = ", ".join(f"{1e3 * x:.1f} ms" for x in each)
    found.append(
        Value(
            "CPU a segment of 4, 40, 200",
            "constant within 30 %, or less for more",
            said,
            max(each[1:]) <= 1.3 * each[0],
        )
    )
    return found


if __name__ == "__main__":
    main("freedom", measure, len(CASES), judge)
