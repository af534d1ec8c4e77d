"""Motions from moving states onto random chunks, joints and other plans: limits, continuity, closeness, durations, CPU time.

A case takes one arm and one pair of plans. Running motions are a plan, a stop of it, or the motion of an earlier retarget, each
at a random instant. The judge of `tests/figures/chunks.py` evaluates the polynomials; Ruckig is called directly.
"""

from __future__ import annotations

import gc
from dataclasses import replace
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

import planners
from optik.types import Array
from planners.paths.joint_curve import JointCurve
from planners.streams import RetargetStatus
from planners.trajectory import make_rest
from tests.figures import chunks
from tests.figures.chunks import ARMS, Box, Case, evaluate
from tests.figures.figure import Row, Value, main

SEED, PAIRS, PER_CASE = 20261127, 40_000, 20
AFTER, NEAR = 0.6, 0.25
"""Time at which the distance from the chunk is taken, and the chunk's time around the paced place [s]."""
GOALS, CALLS = 4, 5000
"""Goals and plans of a case, and the calls of the first case of each arm, after which time and memory must not have grown."""
LONGEST = {0.03: 1.03, 0.04: 1.06}
"""Longest pieces [s], and the durations asked over the optimal one."""


def call(*given: Any, **options: Any) -> tuple[planners.Retargeted, float]:
    """A result, and its CPU time in the second of two calls [ms]: the judge's arrays have emptied the caches."""
    planners.retarget(*given, **options)
    begin = thread_time()
    found = planners.retarget(*given, **options)
    return found, 1e3 * (thread_time() - begin)


def distance_from(chunk: planners.streams.Chunk, found: planners.Retargeted) -> float | None:
    """Least distance [rad] over the chunk's polyline near the paced place, of the largest joint difference."""
    assert found.reference is not None
    place = float(np.interp(AFTER, found.reference.when, found.reference.s))
    q, points = evaluate(found.trajectory, AFTER, 0), np.asarray(chunk.points)
    s = np.unique(np.concatenate([np.linspace(place - NEAR, place + NEAR, 2001), np.arange(len(points)) / chunk.rate]))
    s = np.clip(s[np.abs(s - place) <= NEAR], 0.0, (len(points) - 1) / chunk.rate)
    line = np.stack([np.interp(s * chunk.rate, np.arange(len(points)), p) for p in points.T], axis=1)
    return float(np.abs(line - q).max(axis=1).min())


def judge_motion(found: planners.Retargeted, running: Any, at: float, box: Box) -> Row:
    """What the judge sees of a motion."""
    begin, inside, end = chunks.jumps(found.trajectory, running, at)
    over = chunks.excess(chunks.sample(found.trajectory)[1], box)
    return {"begin": begin.tolist(), "inside": inside.tolist(), "end": end.tolist(), "over": over.tolist()}


def stop_then_go(state: Array, at: float, case: Case, found: planners.Retargeted, box: Box) -> float | None:
    """Duration of a stop of each joint as soon as possible, and of the same chunk from rest [s]."""
    stop = chunks.fastest(state, np.zeros_like(state), box, stop=True)
    q = np.array(stop.at_time(stop.duration)[0])
    still, chunk = replace(found, curve=make_rest(q, 0.01)), case.chunk
    if (q < box.values[0, 0]).any() or (q > box.values[0, 1]).any():
        return None
    later = planners.streams.Chunk(chunk.points, chunk.rate, chunk.observed - at)
    onward = planners.retarget(still, 0.0, later, tolerance=case.tolerance, pace=10.0)
    return float(stop.duration + onward.trajectory.duration) if onward else None


def beside_optimal(found: planners.Retargeted, case: Case, box: Box) -> Row:
    """Durations from rest along the same reference over the time-optimal one: to rest, and to within 1 mrad of its end."""
    reference, robot = found.reference, found.robot
    assert reference is not None
    spans = len(reference.c) - 5
    spline = BSpline(reference.h * np.arange(-5, spans + 6), reference.c, 5)
    s = reference.h * np.arange(spans + 1)
    path = JointCurve(robot, s, spline(s), np.stack([spline(s, order) for order in (1, 2, 3)], axis=1))
    best = planners.plan(robot, path, spline(0.0), limits=box.limits, timing="optimal")
    row: Row = {}
    for longest in LONGEST if best else ():
        still, chunk = replace(found, curve=make_rest(spline(0.0), 0.01)), replace(case.chunk, observed=0.0)
        own = planners.retarget(still, 0.0, chunk, tolerance=case.tolerance, pace=10.0, longest=longest)
        times = []
        for curve in (own.trajectory, best.trajectory):
            t = np.arange(0.0, curve.duration, 1e-3)
            far = np.abs(evaluate(curve, t, 0) - spline(s[-1])).max(axis=1) > 1e-3
            times.append((curve.duration, float(t[np.flatnonzero(far)[-1]]) if far.any() else 1e-3))
        row[f"optimal {longest}"] = [a / b for a, b in zip(*times, strict=True)]
    return row


def grow(running: Any, box: Box, rng: np.random.Generator) -> Row:
    """CPU times of the first and the last of many calls [ms], and the memory that they keep [MiB]."""
    curve = running.trajectory
    cases = [chunks.random_chunk(curve, 0.1, box, rng, running.robot) for _ in range(50)]
    ms, kept = [], []
    for i in range(CALLS):
        if i in (500, CALLS - 1):
            gc.collect()
            kept.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20)
        begin = thread_time()
        planners.retarget(running, 0.1, cases[i % 50].chunk)
        ms.append(1e3 * (thread_time() - begin))
    return {"first": float(np.median(ms[500:1500])), "last": float(np.median(ms[-1000:])), "memory": kept[1] - kept[0],
            "quantiles": np.quantile(ms[500:], (0.5, 0.99, 1.0)).tolist()}  # fmt: skip


def pair(running: Any, at: float, box: Box, rng: np.random.Generator) -> tuple[Row, planners.Retargeted]:
    """One chunk, at its own pace and as fast as possible."""
    robot, curve = running.robot, running.trajectory
    case = chunks.random_chunk(curve, at, box, rng, robot)
    found, ms = call(running, at, case.chunk, tolerance=case.tolerance)
    row = {"status": str(found.status), "reason": found.reason, "ms": ms, "joined_after": found.joined_after}
    row |= judge_motion(found, curve, at, box)
    if found:
        row["distance"] = distance_from(case.chunk, found)
    fast, row["fast_ms"] = call(running, at, case.chunk, tolerance=case.tolerance, pace=10.0)
    row |= {"fast_status": str(fast.status)} | {f"fast_{k}": v for k, v in judge_motion(fast, curve, at, box).items()}
    state = np.array([evaluate(curve, at, order) for order in range(3)])
    if fast and (other := stop_then_go(state, at, case, fast, box)):
        row |= {"fast": fast.trajectory.duration, "stop_then_go": other}
    if fast and robot.name == "panda" and rng.random() < 0.1:
        row |= beside_optimal(fast, case, box)
    return row, found


def goals(running: Any, onto: planners.Plan, box: Box, rng: np.random.Generator) -> Row:
    """Random joints, and another plan."""
    robot, curve, at = running.robot, running.trajectory, float(rng.uniform(0.02, 0.98) * running.trajectory.duration)
    state = np.array([evaluate(curve, at, order) for order in range(3)])
    low, high = chunks.span(robot)
    goal = np.zeros((3, robot.n))
    goal[0] = rng.uniform(low, high)
    found, ms = call(running, at, goal[0])
    best = chunks.fastest(state, goal, box)
    miss = float(np.abs(evaluate(found.trajectory, found.trajectory.duration, 0) - goal[0]).max())
    row: Row = {"goal": str(found.status), "goal_ms": ms, "T": found.trajectory.duration, "ruckig": best.duration}
    row |= {"possible": chunks.stays_inside(best, box), "miss": miss, "goal_reason": found.reason}
    row |= {f"goal_{k}": v for k, v in judge_motion(found, curve, at, box).items()}
    joined, ms = call(running, at, onto)
    goal[0] = evaluate(onto.trajectory, 0.0, 0)
    whole = chunks.fastest(state, goal, box).duration + onto.trajectory.duration
    row |= {"plan": str(joined.status), "plan_ms": ms, "plan_ratio": joined.trajectory.duration / whole}
    row |= {f"plan_{k}": v for k, v in judge_motion(joined, curve, at, box).items()}
    end = evaluate(onto.trajectory, onto.trajectory.duration, 0)
    row["plan_miss"] = float(np.abs(evaluate(joined.trajectory, joined.trajectory.duration, 0) - end).max())
    return row


def measure(case: int) -> Row:
    """Twenty chunks on one pair of plans, and some goals."""
    rng, name = np.random.default_rng([SEED, case]), ARMS[case % len(ARMS)]
    robot = chunks.robot_of(name)
    box = chunks.box_of(robot, rng, case // len(ARMS) % 3 == 0)
    first, other = (chunks.random_plan(robot, box, rng) for _ in range(2))
    stopped = planners.replan(first, float(rng.uniform(0.2, 0.6) * first.trajectory.duration), stop=True)
    last: Any = first
    call(first, 0.1, np.asarray(first.trajectory(0.0)))
    call(first, 0.1, chunks.random_chunk(first.trajectory, 0.1, box, rng, robot).chunk)
    rows = []
    for _ in range(PER_CASE):
        which = int(rng.choice(3, p=[0.5, 0.15, 0.35]))
        running = (first, stopped, last)[which]
        at = float(rng.uniform(0.02, 0.98) * running.trajectory.duration)
        row, found = pair(running, at, box, rng)
        rows.append(row | {"from": ("plan", "stop", "retarget")[which]})
        last = found if found else last
    more = {"growth": grow(first, box, rng)} if case < len(ARMS) else {}
    return {"arm": name, "rows": rows, "goals": [goals(first, other, box, rng) for _ in range(GOALS)]} | more


# ------------------------------------------------------------ the figures


def clean(rows: list[Row], what: str, prefix: str = "") -> list[Value]:
    """Continuity and limits, as the judge sees them."""
    if not rows:
        return []
    jump = np.max([np.concatenate([r[prefix + k] for k in ("begin", "inside", "end")]) for r in rows])
    over = np.max([r[prefix + "over"] for r in rows], axis=0)
    over_words = ", ".join(f"{x:.2g}" for x in over)
    return [
        Value(f"{what}, discontinuity of q, q̇, q̈", "≤ 1e-12", f"{jump:.2g} of {len(rows)}", bool(jump <= 1e-12)),
        Value(f"{what}, excess over limits on q … q⃛", "≤ 1e-9", over_words, bool((over <= 1e-9).all())),
    ]


def times(ms: Any, what: str, asked: tuple[float, ...]) -> Value:
    """CPU times beside the asked median, 99 % quantile and largest value."""
    return times_of(np.quantile(ms, (0.5, 0.99, 1.0)), what, asked)


def times_of(got: Any, what: str, asked: tuple[float, ...]) -> Value:
    """Three quantiles of CPU times beside those asked."""
    words = " / ".join(f"{x:.3g}" for x in got)
    fine = all(g <= a for g, a in zip(got, asked, strict=False))
    return Value(f"{what}, CPU [ms], median / p99 / max", " / ".join(f"≤ {a:g}" for a in asked), words, fine)


def judge_arm(name: str, rows: list[Row], goals: list[Row]) -> list[Value]:
    """The figures of one arm."""
    joined = [row for row in rows if row["status"] == RetargetStatus.JOINED]
    unsaid = sum(row["status"] != RetargetStatus.JOINED and not row["reason"] for row in rows)
    share, after = len(joined) / len(rows), np.mean([row["joined_after"] is not None for row in joined])
    asked = {"panda": (0.95, 0.006), "ur5e": (0.85, 0.015)}.get(name, (0.0, np.inf))
    far = float(np.median([row["distance"] for row in joined]))
    out = [
        Value(f"{name}, joined", "≥ 99.9 %, others with a reason",
              f"{100 * share:.2f} % of {len(rows)}, {unsaid} without", share >= 0.999 and not unsaid),
        Value(f"{name}, within 10 mrad from some time", f"≥ {asked[0]:.0%}", f"{after:.1%}", bool(after >= asked[0])),
        Value(f"{name}, distance after {AFTER} s, median [rad]", f"≤ {asked[1]}", f"{far:.4f}", far <= asked[1]),
        *clean(joined, f"{name}, chunks"),
        *clean([r for r in rows if r["fast_status"] == RetargetStatus.JOINED], f"{name}, chunks, pace 10", "fast_"),
        times([row["ms"] for row in rows], f"{name}, chunks", (1.0, 3.0, 10.0)),
        times([row["fast_ms"] for row in rows], f"{name}, chunks, pace 10", (1.0, 3.0, 10.0)),
    ]  # fmt: skip
    ratio = {kind: [row["fast"] / row["stop_then_go"] for row in rows if "fast" in row and row["from"] == kind]
             for kind in ("plan", "stop", "retarget")}  # fmt: skip
    median = {kind: float(np.median(found)) for kind, found in ratio.items()}
    words = ", ".join(f"{x:.3f} of {len(ratio[kind])} from a {kind}" for kind, x in median.items())
    out.append(Value(f"{name}, over stop-then-go, median, from a plan", "≤ 0.88", words, median["plan"] <= 0.88))
    for longest, most in LONGEST.items():
        if found := [row[f"optimal {longest}"] for row in rows if f"optimal {longest}" in row]:
            rest, near = np.median(found, axis=0)
            out.append(Value(f"{name}, from rest over the optimal law, pieces of {longest} s, median, to 1 mrad", f"≤ {most}",
                             f"{near:.3f}, to rest {rest:.3f}, of {len(found)}", bool(near <= most)))  # fmt: skip
    return out + judge_goals(name, goals)


def judge_goals(name: str, goals: list[Row]) -> list[Value]:
    """The figures of bare goals and of other plans."""
    reached = [row for row in goals if row["goal"] == RetargetStatus.GOAL]
    ratio = np.array([row["T"] / row["ruckig"] for row in reached if row["possible"]])
    miss = max(row["miss"] for row in reached)
    possible = sum(row["possible"] for row in goals)
    entered = [row for row in goals if row["plan"] == RetargetStatus.JOINED]
    whole = float(np.median([row["plan_ratio"] for row in entered]))
    plan_miss = max(row["plan_miss"] for row in entered)
    return [
        Value(f"{name}, goals reached where Ruckig stays inside", "all", f"{len(ratio)} of {possible}; {len(reached)} of "
              f"{len(goals)} in all", len(ratio) == possible),
        Value(f"{name}, goals, duration over Ruckig's", "≤ 1.001", f"{ratio.max():.6f}", bool(ratio.max() <= 1.001)),
        Value(f"{name}, goals and plans, distance at the end [rad]", "≤ 1e-9", f"{max(miss, plan_miss):.2g}",
              max(miss, plan_miss) <= 1e-9),
        *clean(reached, f"{name}, goals", "goal_"),
        times([row["goal_ms"] for row in goals], f"{name}, goals", (0.2,)),
        Value(f"{name}, plans entered", "≥ 99.9 %", f"{len(entered)} of {len(goals)}", len(entered) >= 0.999 * len(goals)),
        Value(f"{name}, plans, over going to the start", "≤ 0.76", f"{whole:.3f}", whole <= 0.76),
        *clean(entered, f"{name}, plans", "plan_"),
        times([row["plan_ms"] for row in goals], f"{name}, plans", (0.5,)),
    ]  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    out: list[Value] = []
    for name in ARMS:
        mine = [row for row in rows if row["arm"] == name]
        if mine:
            flat = [[one for row in mine for one in row[key]] for key in ("rows", "goals")]
            out += judge_arm(name, flat[0], flat[1])
            for grown in [row["growth"] for row in mine if "growth" in row]:
                words = f"{grown['first']:.3f} to {grown['last']:.3f} ms, {grown['memory']:.2f} MiB in {CALLS} calls"
                fine = grown["last"] <= 1.2 * grown["first"] and grown["memory"] <= 1.0
                out.append(Value(f"{name}, growth of time and memory", "≤ 20 %, ≤ 1 MiB", words, fine))
                out.append(times_of(grown["quantiles"], f"{name}, chunks in a loop", (1.0, 3.0, 10.0)))
            for row in mine:
                for i, one in enumerate(row["rows"]):
                    if one["status"] == RetargetStatus.KEPT:
                        print(f"  case {row['case']}.{i}, {name}: {one['reason']}")
    return out


if __name__ == "__main__":
    main("retarget", measure, PAIRS // PER_CASE, judge, part=0.2)
