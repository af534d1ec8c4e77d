"""Chunks that lead back while an arm brakes onto an end of its ranges: how many are joined, and why others are kept.

Four arms, jerks of 50, 500 and 5,000 rad/s³, ten motions each that end where some joints' ranges end, and 40 instants of the
second half of each. The oracle of the limits is `tests/figures/chunks.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import optik
import planners
from planners import Chunk, MotionLimits
from tests.figures import chunks
from tests.figures.figure import Row, Value, main

SEED, ARMS, JERKS, MOTIONS, INSTANTS = 20261130, ("kr6", "irb120", "ur5e", "panda"), (50.0, 500.0, 5000.0), 10, 40


def measure(case: int) -> Row:
    """One motion of one arm with one jerk."""
    rng = np.random.default_rng([SEED, case])
    robot, jerk = optik.load(ARMS[case % 4]), JERKS[case // 4 % 3]
    low, high, n = robot.limits.lower, robot.limits.upper, robot.n
    limits = MotionLimits(velocity=rng.uniform(1.0, 3.0), acceleration=rng.uniform(5.0, 15.0), jerk=jerk)
    values = np.stack([np.stack([low, high])] + [np.outer([-1.0, 1.0], limits.bounds(n)[name] * np.ones(n))
                                                 for name in ("velocity", "acceleration", "jerk")])  # fmt: skip
    running: Any = None
    while not running:
        start = rng.uniform(low + 0.3 * (high - low), high - 0.3 * (high - low))
        goal, moved = start.copy(), rng.permutation(n)[: rng.integers(1, n + 1)]
        goal[moved] = np.where(rng.random(moved.size) < 0.5, low[moved], high[moved])
        running = planners.retarget(planners.plan(robot, start + 1e-3, start, limits=limits), 0.0, goal)
    end, kept, over, worst = running.trajectory.end, [], np.full(4, -np.inf), 0.0
    for at in np.linspace(0.5, 1.0 - 1e-9, INSTANTS) * end:
        q, v, t = running.trajectory(at), running.trajectory(at, 1), np.arange(20)[:, None] / 20.0
        points = q + 0.2 * v * np.minimum(t, 0.1) + rng.uniform(0.1, 0.5) * (start - q) * t
        found = planners.retarget(running, float(at), Chunk(robot.limits.clip(points), 20.0, float(at)))
        if not found:
            kept.append(f"{robot.name}, {jerk:g} rad/s³, {at / end:.3f} of the motion: {found.reason}")
            continue
        over = np.maximum(over, chunks.excess(chunks.sample(found.trajectory)[1], chunks.Box(values, limits)))
        worst = max(worst, *(float(x.max()) for x in chunks.jumps(found.trajectory, running.trajectory, float(at))))
    return {"arm": robot.name, "jerk": jerk, "kept": kept, "over": over.tolist(), "jump": worst}


def judge(rows: list[Row]) -> list[Value]:
    kept, count = [words for row in rows for words in row["kept"]], INSTANTS * len(rows)
    for words in kept:
        print("  kept:", words)
    share, over, jump = (
        1.0 - len(kept) / count,
        np.max([row["over"] for row in rows], axis=0),
        max(r["jump"] for r in rows),
    )
    return [
        Value("chunks that lead back, joined", "≥ 98 %", f"{100.0 * share:.2f} % of {count}", share >= 0.98),
        Value("excess over limits on q … q⃛", "≤ 1e-9", ", ".join(f"{x:.2g}" for x in over), bool((over <= 1e-9).all())),
        Value("discontinuity of q, q̇, q̈", "≤ 1e-12", f"{jump:.2g}", jump <= 1e-12),
    ]


if __name__ == "__main__":
    main("chunks_lead_back", measure, len(ARMS) * len(JERKS) * MOTIONS, judge)
