"""Constant speed along random seams: no exception, no motion without a proof, every refusal true from both sides, the time.

A seam is a polyline as CAM and scanners write them: 10 to 5,000 points, 0.05 to 20 mm apart, straight runs, zigzags, curves,
noise of 0.01 to 0.1 mm, at most 1 m in all, at a random place of the arm. A case is a seam on one of four arms with three
random speeds. The oracle differentiates q(s) and p(s) by finite differences; where a refusal names a ramp, it stops the tool
from the same speed by the law `optimal`, from either end.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import optik
import planners
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.types import Array
from planners.timing.base import PathState
from planners.timing.optimal import Optimal
from tests.figures.figure import Row, Value, main

SEED = 21
SEAMS = 200
ARMS = ("paper6r", "ur5e", "panda", "irb120")
TRIES = 60
PER_PIECE, STEP, LEAST = 13, 0.01, 1e-6
"""Places of the finite differences in each piece, its middle among them; their step over its length, and at least [m]."""
ZOOMS, LOWEST, CLOSE, ROUNDING = 2, 20, 41, 1e-13
"""How often places are added around the lowest speeds, around how many, how many each; and 100 times the rounding of q."""
TRUE = 0.95


def seam(rng: np.random.Generator) -> tuple[str, Array]:
    """Points (k, 3) of a random seam in its own frame, from the origin on [m]."""
    kind = str(rng.choice(["run", "noise", "zigzag", "curve", "mixed"]))
    count = int(np.exp(rng.uniform(np.log(10), np.log(5000))))
    gap = np.clip(np.exp(rng.uniform(np.log(5e-5), np.log(2e-2))), 5e-5, max(0.7 / count, 5e-5))
    steps = np.clip(gap * np.exp(rng.normal(0.0, rng.choice([0.0, 0.3]), count - 1)), 5e-5, 2e-2)
    heading = np.zeros(count - 1)
    if kind == "zigzag":
        heading = (np.arange(count - 1) // rng.integers(1, 12)) % 2 * np.radians(rng.uniform(20.0, 150.0))
    elif kind == "curve":
        heading = np.cumsum(steps) * rng.uniform(-6.0, 6.0)
    elif kind == "mixed":
        leg = int(rng.integers(2, 40))
        turns = rng.uniform(-1.0, 1.0, count // leg + 1) * (rng.random(count // leg + 1) < 0.6)
        heading = np.repeat(np.cumsum(turns), leg)[: count - 1]
    points = np.zeros((count, 3))
    points[1:, 0], points[1:, 1] = np.cumsum(steps * np.cos(heading)), np.cumsum(steps * np.sin(heading))
    if kind == "noise" or (kind != "run" and rng.random() < 0.4):
        points += rng.normal(size=points.shape) * np.exp(rng.uniform(np.log(1e-5), np.log(1e-4))) / np.sqrt(3.0)
    return kind, points - points[0]


def placed(arm: str, points: Array, rng: np.random.Generator) -> tuple[planners.Polyline, Array, Any] | None:
    """A polyline on which the arm can follow the seam, its start and its joint path; None where none was found."""
    robot = optik.load(arm)
    middle, width = 0.5 * (robot.limits.lower + robot.limits.upper), robot.limits.upper - robot.limits.lower
    for _ in range(TRIES):
        q = np.clip(middle, -1.5, 1.5) + rng.uniform(-1.0, 1.0, robot.n) * np.minimum(0.4 * width, 1.2)
        q = robot.limits.clip(q)
        if robot.singular_values(q)[-1] < 0.05:
            continue
        poses = np.tile(robot.fk(q), (len(points), 1, 1))
        poses[:, :3, 3] += points @ optik.se3.exp_so3(1.5 * rng.normal(size=3)).T
        try:
            path = planners.Polyline(poses)
        except InvalidInput:  # a reversal
            return None
        ends = planners.Line(
            poses[0], poses[np.linalg.norm(points, axis=1).argmax()]
        )  # quick: mostly this is out of reach
        if not planners.follow(make_solver(robot, "lm"), ends, q):
            continue
        followed = planners.follow(make_solver(robot, "lm"), path, q)
        if followed:
            return path, q, followed.joint_path
    return None


def differences(f: Any, s: Array, h: Array) -> tuple[Array, Array, Array]:
    """First, second and third derivative of f (k, n) at s by central differences of five points."""
    a, b, c, d, e = (f(s + k * h) for k in (-2, -1, 0, 1, 2))
    h = h[:, None]
    return (
        (a - 8.0 * b + 8.0 * d - e) / (12.0 * h),
        (-a + 16.0 * b - 30.0 * c + 16.0 * d - e) / (12.0 * h**2),
        (-a + 2.0 * b - 2.0 * d + e) / (2.0 * h**3),
    )


def speeds(joint_path: Any, limits: planners.MotionLimits, s: Array, h: Array) -> Array:
    """Speeds of the tool (k,) at which q', q'' or q''' over its distance reaches a limit, by steps h [m/s]."""
    q1, q2, q3 = differences(joint_path, s, h)
    p1, p2, p3 = differences(lambda x: joint_path.path.pose(x)[:, :3, 3], s, h)
    c = np.linalg.norm(p1, axis=1)
    c1 = (p1 * p2).sum(axis=1) / c
    c2 = ((p2 * p2).sum(axis=1) + (p1 * p3).sum(axis=1) - c1**2) / c
    s1, s2, s3 = (y[:, None] for y in (1.0 / c, -c1 / c**3, (3.0 * c1**2 - c * c2) / c**5))
    orders = q1 * s1, q1 * s2 + q2 * s1**2, q1 * s3 + 3.0 * q2 * s1 * s2 + q3 * s1**3
    own = (np.asarray(limits.velocity), np.asarray(limits.acceleration), np.asarray(limits.jerk))
    each = [((b / np.abs(y)).min(axis=1)) ** (1.0 / k) for k, (y, b) in enumerate(zip(orders, own, strict=True), 1)]
    return np.asarray(np.min(each, axis=0))


def bound(joint_path: Any, limits: planners.MotionLimits) -> tuple[float, float]:
    """The least of these speeds over the whole path, and over its middle half [m/s]."""
    path, end = joint_path.path, joint_path.end
    breaks = path.breaks[np.append(True, np.diff(path.breaks) > 1e-6 * end)]
    pieces = np.diff(np.append(breaks[:-1], end))
    s = (breaks[:-1, None] + pieces[:, None] * (np.arange(PER_PIECE) + 0.5) / PER_PIECE).ravel()
    wide = np.repeat(pieces, PER_PIECE) / PER_PIECE
    h = np.minimum(np.maximum(STEP * PER_PIECE * wide, LEAST), 1e-4)
    places, found = np.empty(0), np.empty(0)
    for _ in range(ZOOMS + 1):
        inner = (s > 2.0 * h) & (s < end - 2.0 * h)
        s, wide, h = s[inner], wide[inner], h[inner]
        v = speeds(joint_path, limits, s, h)
        places, found = np.append(places, s), np.append(found, v)
        low = np.argsort(v)[:LOWEST]  # closer around the lowest, by the shortest steps in which rounding is no jerk
        rounding = v[low] * np.cbrt(ROUNDING / float(np.min(np.asarray(limits.jerk))))
        s = (s[low, None] + wide[low, None] * np.linspace(-1.0, 1.0, CLOSE)).ravel()
        h = np.repeat(np.minimum(h[low], np.maximum(rounding, 0.02 * wide[low])), CLOSE)
        wide = np.repeat(wide[low] * 4.0 / CLOSE, CLOSE)
    middle = np.abs(places - 0.5 * end) < 0.24 * end
    return float(found.min()), float(found[middle].min())


def stops(joint_path: Any, limits: planners.MotionLimits, speed: float) -> bool:
    """Whether `optimal` comes to rest in the last quarter from this speed of the tool."""
    path, end = joint_path.path, joint_path.end
    s = np.linspace(0.0, end, 20001)
    steps = np.linalg.norm(np.diff(path.pose(s)[:, :3, 3], axis=0), axis=1)
    x = np.concatenate([[0.0], np.cumsum(steps)])
    place = float(np.interp(0.75 * x[-1], x, s))
    v, v1 = (path.twist(np.array([place]), k)[0, :3] for k in (1, 2))
    c = float(np.linalg.norm(v))
    state = PathState(place, speed / c, -(speed**2) * float(v @ v1) / c**4)
    return Optimal().run_to(joint_path, limits, state, joint_path.end) is not None


WARM: set[str] = set()
"""Arms with which this process has planned already, so that no kernel is loaded while a plan is timed."""


def measure(case: int) -> Row:
    """One seam on one arm, with three speeds."""
    arm, rng = ARMS[case % len(ARMS)], np.random.default_rng([SEED, case // len(ARMS)])
    found = None
    while found is None:
        kind, points = seam(rng)
        found = placed(arm, points, np.random.default_rng([SEED, case, len(points)]))
    path, q, joint_path = found
    robot = joint_path.robot
    limits = planners.MotionLimits(*(float(np.exp(rng.uniform(*np.log(r)))) for r in ((1, 3), (5, 20), (50, 500))))
    low, middle = bound(joint_path, limits)
    rows = []
    for speed in () if arm in WARM else (1e-3, 10.0):
        attempt(robot, path, q, speed, limits)
    WARM.add(arm)
    for speed in np.exp(rng.uniform(np.log(2e-3), np.log(0.2), 3)):
        row = attempt(robot, path, q, float(speed), limits)
        if row["status"] == "timing_infeasible":
            row["slower"] = attempt(robot, path, q, TRUE * row["named"], limits)["status"]
            if row["ramp"]:
                back = planners.Polyline(path.waypoints[::-1])
                other = planners.follow(make_solver(robot, "lm"), back, joint_path.q[-1]).joint_path
                fast = row["named"] / TRUE
                row["pessimistic"] = fast < middle and stops(joint_path, limits, fast) and stops(other, limits, fast)
        rows.append(row)
    return {"arm": arm, "kind": kind, "points": len(points), "length": joint_path.end, "bound": low, "plans": rows}


def attempt(robot: Any, path: Any, q: Array, speed: float, limits: planners.MotionLimits) -> Row:
    """What one plan says, and its CPU time."""
    law = planners.make_law("constant_speed", speed=speed)
    begin = time.process_time()
    try:
        plan = planners.plan(robot, path, q, timing=law, limits=limits)
    except Exception as error:
        return {"status": f"{type(error).__name__}: {error}"[:200], "speed": speed}
    row: Row = {"status": str(plan.status), "speed": speed, "seconds": time.process_time() - begin}
    if plan.failure is not None:
        row["reason"] = plan.failure.reason
        most = re.match(r"a speed of at most ([0-9.e+-]+);", plan.failure.advice)
        row |= {"named": float(most[1]) if most else 0.0, "ramp": "in a ramp" in plan.failure.reason}
    return row


def judge(rows: list[Row]) -> Sequence[Value]:
    """What was asked beside what was measured."""
    plans = [(row, p) for row in rows for p in row["plans"]]
    status = [p["status"] for _, p in plans]
    known = ("solved", "not_proved", "timing_infeasible")
    errors = [s for s in status if s not in known]
    refused = [(row, p) for row, p in plans if p["status"] == "timing_infeasible"]
    slower = sum(p["slower"] != "solved" for _, p in refused)
    corner = [p["named"] / row["bound"] for row, p in refused if not p["ramp"]]
    ramp = [p["pessimistic"] and p["named"] < TRUE * row["bound"] for row, p in refused if p["ramp"]]
    late = [p["seconds"] / (0.030 + 0.003 * row["points"]) for row, p in plans if "seconds" in p]
    low = sum(x < TRUE for x in corner)
    return (
        Value(f"exceptions and other failures in {len(plans)} plans", "0", f"{len(errors)} {errors[:3]}", not errors),
        Value("not_proved", "0", str(status.count("not_proved")), "not_proved" not in status),
        Value(f"refusals of {len(refused)} without a motion at {TRUE} of the named speed", "0", str(slower), not slower),
        Value(
            f"refusals by corners of {len(corner)} that name less than {TRUE} of the bound from q', q'', q'''", "0",
            f"{low} (least {min(corner, default=np.nan):.3f}, median {np.median(corner or [np.nan]):.3f})", low == 0,
        ),
        Value(
            f"refusals by ramps of {len(ramp)} where `optimal` stops from {1 / TRUE:.3f} of the named speed", "0",
            str(sum(ramp)), not any(ramp),
        ),
        Value(
            "CPU time of a plan over 30 ms + 3 ms per waypoint", "at most 1",
            f"largest {max(late):.2f}, median {np.median(late):.2f}, {sum(x > 1 for x in late)} above", max(late) <= 1.0,
        ),
    )  # fmt: skip


if __name__ == "__main__":
    main("constant_speed", measure, SEAMS * len(ARMS), judge, part=0.2)
