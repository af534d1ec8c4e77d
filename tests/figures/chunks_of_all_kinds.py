"""Random chunks of all kinds on five arms, two of them with continuous joints: nothing raises, what cannot be meant is kept.

Kinds: usual ones, in degrees, wrapped at π, with stamps off by 10⁻³ to 10⁹ s, with repeated targets, alternating between the
ends of the ranges, random, and beyond the ranges. Two to 1,000 targets. The judge computes the excess
over the ranges and the age itself. CPU times are those of the second of two calls.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

import optik
import planners
from optik.types import Array
from planners import MotionLimits
from planners.streams import Chunk, RetargetStatus
from tests.figures import chunks
from tests.figures.figure import Row, Value, main
from tests.figures.retarget import call

SEED, CASES, PER_CASE = 20261129, 100, 20
ARMS = ("panda", "ur5e", "kr6", "ur5e continuous", "iiwa14 continuous")
KINDS = ("usual", "degrees", "wrapped", "clock", "repeated", "alternating", "random", "beyond")
NUMBERS = re.compile(r"-?[0-9.]+(e[+-]?[0-9]+)?|joint[0-9]")
"""What differs in reasons of one kind."""
GRACE = (0.1, 0.005)
"""Asked: excess over a range up to which targets are clipped [rad, m]."""
REASONS = (
    "outside its range",
    "of another clock",
    "not found within the budget",
    "no motion of",
    "of its limit",
    "of joint",
)


def robot_of(name: str) -> optik.Robot:
    """An arm; the continuous ones have no limits on every second joint."""
    robot = optik.load(name.split()[0])
    if "continuous" in name:
        free = np.arange(robot.n) % 2 == (robot.n + 1) % 2
        limits = robot.limits
        robot = replace(robot, limits=replace(limits, lower=np.where(free, -np.inf, limits.lower),
                                              upper=np.where(free, np.inf, limits.upper)))  # fmt: skip
    return robot


def span(robot: optik.Robot) -> tuple[Array, Array]:
    """Finite ends of the ranges."""
    return np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)


def random_chunk(kind: str, q: Array, at: float, robot: optik.Robot, rng: np.random.Generator) -> Chunk:
    """A chunk of a kind, from the joints at an instant on."""
    m = int(np.exp(rng.uniform(np.log(2.0), np.log(1000.0)))) if rng.random() < 0.5 else int(rng.integers(2, 101))
    rate, (low, high) = float(rng.choice([10.0, 20.0, 30.0, 50.0])), span(robot)
    t = np.arange(m)[:, None] / rate
    size, speed = rng.uniform(-1.0, 1.0, robot.n) * (high - low) * 0.2, rng.uniform(0.3, 3.0, robot.n)
    points = q + size * np.sin(t * speed) + rng.choice([0.0, 1e-3, 4e-3]) * rng.normal(size=(m, robot.n))
    observed = at - float(rng.uniform(0.0, 0.15))
    points = np.clip(points, low, high)
    if kind == "degrees":
        points = np.degrees(points)
    elif kind == "wrapped":
        points = (points + np.cumsum(np.full_like(points, 0.02), axis=0) + np.pi) % (2.0 * np.pi) - np.pi
    elif kind == "clock":
        observed = at + float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3.0, 9.0))
    elif kind == "repeated":
        points = points[np.sort(rng.integers(0, m, m))]
    elif kind == "alternating":
        points = np.where(np.arange(m)[:, None] % 2, low, high)
    elif kind == "random":
        points = rng.uniform(low, high, (m, robot.n))
    elif kind == "beyond":
        points[int(rng.integers(m)), int(rng.integers(robot.n))] += float(
            rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 4.0)
        )
    return Chunk(points, rate, observed)


def judge_motion(found: planners.Retargeted, running: Any, at: float, limits: MotionLimits) -> Row:
    """Discontinuities, and excess over the limits at nine instants of each piece."""
    motion, bounds, n = found.trajectory, limits.bounds(found.robot.n), found.robot.n
    knots, c = motion.knots, chunks.trim(motion.coefficients)
    piece = np.repeat(np.arange(len(knots) - 1), 9)
    u = np.tile(np.linspace(0.0, 1.0, 9), len(knots) - 1) * np.diff(knots)[piece]
    most = np.array([np.full(n, np.inf), *(bounds[k] * np.ones(n) for k in ("velocity", "acceleration", "jerk"))])
    values = np.array([chunks.horner(c, piece, u, order) for order in range(4)])
    over = (np.abs(values) / most[:, None] - 1.0).max(axis=(1, 2))
    over[0] = np.maximum(values[0] - found.robot.limits.upper, found.robot.limits.lower - values[0]).max()
    jump = max(float(np.max(each)) for each in chunks.jumps(motion, running, at))
    return {"jump": jump, "over": over.tolist()}


def one(
    running: planners.Plan, at: float, kind: str, loaded: bool, limits: MotionLimits, rng: np.random.Generator
) -> Row:
    """A chunk, and what the judge sees of it."""
    robot, align = running.robot, str(rng.choice(["nearest", "clock"]))
    chunk = random_chunk(kind, running.trajectory(at), at, robot, rng)
    P, lower, upper = np.asarray(chunk.points), robot.limits.lower, robot.limits.upper
    excess = np.maximum(lower - P, P - upper)
    row: Row = {"kind": kind, "loaded": loaded, "m": len(P), "align": align, "excess": float(excess.max())}
    row |= {
        "outside": int((excess > 0.0).any(axis=1).sum()),
        "meant": bool((excess <= np.where(robot.prismatic, *GRACE[::-1])).all()),
    }
    age, lasts = at - chunk.observed, (len(P) - 1) / chunk.rate
    row["wrong clock"] = (age > lasts or age < -10.0) if align == "clock" else age > 2.0 * lasts + 10.0
    try:
        found, row["ms"] = call(running, at, chunk, limits=limits, align=align)
    except Exception as error:
        return row | {"raised": repr(error)}
    row |= {
        "status": str(found.status),
        "reason": found.reason,
        "clipped": found.clipped,
        "duration": found.trajectory.end,
    }
    if found:
        row["judged"] = judge_motion(found, running.trajectory, at, limits)
    free = ~np.isfinite(lower)
    if found and kind == "wrapped":
        steps = np.abs((np.diff(P[:, free], axis=0) + np.pi) % (2.0 * np.pi) - np.pi).sum(axis=0)
        q = found.trajectory(np.linspace(0.0, found.trajectory.end, 4000))[:, free]
        row["turned"] = float((np.abs(np.diff(q, axis=0)).sum(axis=0) - steps).max(initial=0.0))
    return row


def measure(case: int) -> Row:
    rng, name = np.random.default_rng([SEED, case]), ARMS[case % len(ARMS)]
    robot = robot_of(name)
    low, high = span(robot)
    plain = MotionLimits(
        velocity=rng.uniform(1.0, 3.0), acceleration=rng.uniform(4.0, 15.0), jerk=10.0 ** rng.uniform(2.0, 3.7)
    )
    loaded = case % 3 == 0 and robot.limits.torque is not None
    limits = (
        MotionLimits(plain.velocity, plain.acceleration, plain.jerk, torque=robot.limits.torque) if loaded else plain
    )
    while True:
        q = rng.uniform(low + 0.3 * (high - low), high - 0.3 * (high - low))
        running: Any = planners.plan(robot, q + rng.uniform(-0.2, 0.2, robot.n) * (high - low), q, limits=limits)
        if running:
            break
    call(running, 0.1, Chunk(np.array([q] * 8), 20.0), limits=limits)
    rows = []
    for i in range(PER_CASE):
        at = float(rng.uniform(0.02, 0.98) * running.trajectory.duration)
        rows.append(one(running, at, KINDS[i % len(KINDS)], loaded, limits, rng))
    return {"arm": name, "rows": rows}


def quantiles(rows: list[Row], what: str, most: float, largest: float) -> Value:
    """CPU times: the 99 % quantile and the largest."""
    ms = np.array([row["ms"] for row in rows])
    got = np.quantile(ms, (0.5, 0.99, 1.0)) if ms.size else np.zeros(3)
    words = f"{got[1]:.2f} (median {got[0]:.2f}, largest {got[2]:.1f}) of {ms.size}"
    return Value(f"CPU [ms], {what}", f"p99 ≤ {most:g}" + (f", largest ≤ {largest:g}" if largest < np.inf else ""), words,
                 bool(got[1] <= most and got[2] <= largest))  # fmt: skip


def judge(cases: list[Row]) -> list[Value]:
    rows = [row for case in cases for row in case["rows"]]
    raised = [row for row in rows if "raised" in row]
    for row in raised[:5]:
        print("  raised:", row["raised"], row["kind"], row["m"])
    rows = [row for row in rows if "raised" not in row]
    joined = [row for row in rows if row["status"] == RetargetStatus.JOINED]
    kept = [row for row in rows if row["status"] == RetargetStatus.KEPT]
    untrue = [row for row in kept if "outside its range" in row["reason"] and row["meant"]]
    untrue += [row for row in kept if "of another clock" in row["reason"] and not row["wrong clock"]]
    untrue += [row for row in kept if not any(words in row["reason"] for words in REASONS)]
    for row in untrue[:5]:
        print("  untrue:", row["kind"], row["reason"])
    why = Counter(f"{row['kind']}: {NUMBERS.sub('…', row['reason'])[:60]}" for row in kept)
    for words, count in sorted(why.items()):
        print(f"  kept: {count} x {words}")
    uncounted = sum(row["clipped"] != row["outside"] and row["kind"] != "wrapped" for row in joined)
    jump = max(row["judged"]["jump"] for row in joined)
    over = np.max([row["judged"]["over"] for row in joined], axis=0)
    turned = max((row["turned"] for row in joined if "turned" in row), default=0.0)
    plain, loaded = ([row for row in rows if row["loaded"] == x] for x in (False, True))
    short = [[row for row in each if row["m"] <= 100] for each in (plain, loaded)]
    unmeant = sum(not row["meant"] or row["wrong clock"] for row in joined)
    return [
        Value("chunks that raised", "0", f"{len(raised)} of {len(rows) + len(raised)}", not raised),
        Value("joined though beyond its range, or by a wrong clock", "0", f"{unmeant} of {len(joined)}", not unmeant),
        Value("joined, clipped targets not counted", "0", str(uncounted), not uncounted),
        Value("kept with a reason that is not true", "0", f"{len(untrue)} of {len(kept)}", not untrue),
        Value("joined, discontinuity of q, q̇, q̈", "≤ 1e-10", f"{jump:.2g}", jump <= 1e-10),
        Value("joined, excess over limits on q … q⃛", "≤ 1e-9", ", ".join(f"{x:.2g}" for x in over), max(over) <= 1e-9),
        Value("wrapped, way of a continuous joint over the shortest [rad]", "≤ 2", f"{turned:.3g}", turned <= 2.0),
        quantiles(short[0], "≤ 100 targets", 3.0, np.inf), quantiles(plain, "all", np.inf, 50.0),
        quantiles(short[1], "torque limits, ≤ 100 targets", 10.0, np.inf),
        quantiles(loaded, "torque limits, all", np.inf, 50.0),
    ]  # fmt: skip


if __name__ == "__main__":
    main("chunks_of_all_kinds", measure, CASES, judge)
