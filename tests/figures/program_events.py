"""Times of events of programs: 10,000 random places on lines, also replanned, against roots found by bisection in space.

A case is a random program of lines and joint lines on one of three arms with zones of 2 to 50 mm. The oracle is the tool's
distance along the programmed line, by forward kinematics; inside rounded corners, the path parameter of the place.
"""

from __future__ import annotations

import numpy as np
import scipy

import optik
import planners
from optik import se3
from planners import MotionLimits, Part, PathEvent, Program
from tests.figures.figure import Row, Value, main

SEED = 41
CASES, EVENTS = 100, 100
ARMS = ("ur5e", "panda", "paper6r")


def draw(robot: optik.Robot, rng: np.random.Generator) -> planners.ProgramPlan:
    """A random program of 3 to 8 parts, planned."""
    while True:
        low, high = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
        q = 0.5 * (low + high) + 0.3 * (high - low) * rng.uniform(-1.0, 1.0, robot.n)
        parts, pose = [], robot.fk(q)
        for _ in range(int(rng.integers(3, 9))):
            way = rng.normal(size=3)
            turn = se3.exp_so3(0.3 * rng.normal(size=3))
            pose = se3.pose(turn @ pose[:3, :3], pose[:3, 3] + rng.uniform(0.05, 0.2) * way / np.linalg.norm(way))
            parts.append(Part(pose, blend=float(rng.choice([0.0, 0.002, 0.01, 0.05]))))
        parts[-1] = Part(pose)
        limits = MotionLimits.of(robot, velocity=2.0, acceleration=10.0, jerk=100.0)
        found = planners.plan(robot, Program(parts), q, limits=limits)
        if found:
            return found


def measure(case: int) -> Row:
    """The largest error of the times of a program's events."""
    rng = np.random.default_rng([SEED, case])
    robot = optik.load(ARMS[case % len(ARMS)])
    motion = draw(robot, rng)
    if case % 3 == 1:
        motion = planners.replan(motion, rng.uniform(0.0, 0.5) * motion.duration)
    worst, inside, count = 0.0, 0, 0
    for _i in range(EVENTS):
        part = int(rng.integers(len(motion.parts)))
        record = motion.parts[part]
        place = float(rng.uniform(0.0, record.path.end))
        for event in motion.schedule([PathEvent(part, place, "s")]).events:
            s = record.s_at(place)
            rounded = any(c.begin < s < c.end for c in motion.corners)
            inside, count = inside + rounded, count + 1
            worst = max(worst, abs(event.t - oracle(robot, motion, part, None if rounded else place, event.s)))
    return {"worst": worst, "inside": inside, "events": count}


def oracle(robot: optik.Robot, motion: planners.ProgramPlan, part: int, place: float | None, s: float) -> float:
    """The time at which the tool passes the plane across its path at a place of a line, or at s of the rounded path."""
    section = motion.parts[part].section
    begin, rest, _ = motion.times[motion.moving_sections.index(section)]
    path, at = (motion.path, s) if place is None else (motion.parts[part].path, place)
    point, along = path.pose(at)[:3, 3], path.twist(at)[:3]

    def off(t: float) -> float:
        return float((robot.fk(motion.trajectory(t))[:3, 3] - point) @ along)

    near = float(np.interp(s, motion.certificate.s, motion.certificate.t))
    for wide in (1e-5, 1e-4, 1e-3, 1e-2, 1e-1):
        low, high = max(near - wide, begin), min(near + wide, rest)
        if off(low) < 0.0 < off(high):
            return float(scipy.optimize.brentq(off, low, high, xtol=1e-14))
    return low if off(low) >= 0.0 else high


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    count, inside = sum(row["events"] for row in rows), sum(row["inside"] for row in rows)
    worst = max(row["worst"] for row in rows)
    return [
        Value(f"error of {count} events, {inside} in rounded corners", "≤ 1 µs", f"{1e6 * worst:.3g} µs", worst <= 1e-6)
    ]


if __name__ == "__main__":
    main("program_events", measure, CASES, judge)
