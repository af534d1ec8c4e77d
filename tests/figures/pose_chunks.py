"""Chunks of poses from known joint motions: joints that `retarget` resolves, against the known ones, and the motions' limits.

The known motions are sums of two sinusoids of each joint inside its range, from random configurations, singular ones too. The
running motion is the known one at the entry. Motions are judged by `tests/figures/chunks.py` at 20 kHz.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from optik.types import Array
from planners import Chunk, Trajectory
from planners.retarget.engine import Retargeter
from planners.retarget.poses import resolve_poses
from tests.figures import chunks
from tests.figures.figure import Row, Value, main
from tests.figures.retarget import judge_motion

SEED, CASES = 20261130, 500
ARMS = ("ur5e", "kr6", "irb120", "panda", "iiwa14", "fr3")
REGULAR = 0.02
"""Smallest singular value along a known motion from which it counts as regular."""


def known(robot: Any, box: chunks.Box, rng: np.random.Generator) -> tuple[Array, float]:
    """Joint targets (m, n) inside the ranges, at most at half of the limits on velocity and acceleration, and their rate."""
    low, high = chunks.span(robot)
    m, rate = int(rng.integers(8, 51)), float(rng.choice([10.0, 15.0, 20.0, 30.0]))
    t, w, phase = np.arange(m) / rate, rng.uniform(0.5, 4.0, (2, robot.n)), rng.uniform(0.0, 2.0 * np.pi, (2, robot.n))
    size = rng.uniform(-0.4, 0.4, (2, robot.n))
    most = np.minimum(0.5 * box.values[1, 1] / w, 0.5 * box.values[2, 1] / w**2) / 2.0
    size = np.clip(size, -most, most)
    wave = (size * np.sin(t[:, None, None] * w + phase)).sum(axis=1)
    wave *= np.minimum(1.0, 0.9 * (high - low) / np.maximum(np.ptp(wave, axis=0), 1e-9))
    return wave + rng.uniform(low - wave.min(axis=0) + 0.02, high - wave.max(axis=0) - 0.02), rate


def measure(case: int) -> Row:
    name, rng = ARMS[case % len(ARMS)], np.random.default_rng([SEED, case])
    robot = chunks.robot_of(name)
    box = chunks.box_of(robot, rng, skewed=False)
    q, rate = known(robot, box, rng)
    spline = scipy.interpolate.CubicSpline(np.arange(len(q)) / rate, q)
    at = float(rng.uniform(0.0, min(0.3, 0.9 * spline.x[-1])))
    running = Trajectory(scipy.interpolate.PPoly(spline.c, spline.x))
    state = np.array([running(at, k) for k in range(3)])
    chunk = Chunk(robot.fk(q), rate, 0.0)
    found, cut = resolve_poses(robot, chunk, state, at)
    smallest = float(np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1].min())
    row: Row = {"arm": name, "six": robot.n == 6, "m": len(q), "resolved": 0, "cut": cut, "regular": smallest > REGULAR}
    if found is not None:
        points, first = np.asarray(found.points), round(found.observed * rate)
        same = q[first : first + len(points)]
        steps = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (points, same)]
        row |= {
            "resolved": len(points), "off": float(np.abs(points - same).max()),
            "fk": float(np.abs(robot.fk(points) - robot.fk(same)).max()), "step": float(steps[0].max() / steps[1].max()),
        }  # fmt: skip
    motion = Retargeter(robot, box.limits).run(running, at, chunk)
    row |= {"status": str(motion.status), "reason": motion.reason}
    return row | (judge_motion(motion, running, at, box) if motion else {})


def judge(rows: list[Row]) -> list[Value]:
    out = []
    for six in (True, False):
        mine = [row for row in rows if row["six"] == six]
        solved, regular = [r for r in mine if r["resolved"]], [r for r in mine if r["regular"]]
        what = "six joints" if six else "seven joints"
        parts = [f"{sum(r['resolved'] for r in x)} of {sum(r['m'] for r in x)}" for x in (mine, regular)]
        print(f"  {what}: {len(mine)} chunks, poses resolved {parts[0]}, of {len(regular)} regular ones {parts[1]}")
        off, fk = max(r["off"] for r in solved), max(r["fk"] for r in solved)
        if six:
            out.append(Value(f"{what}, distance from the known joints [rad]", "≤ 1e-6", f"{off:.2g}", off <= 1e-6))
            continue
        long = [r for r in solved if r["step"] > 2.0]
        print(f"  largest step over the known one: {max(r['step'] for r in solved):.3g}; regular ones above 2: "
              f"{sum(r['regular'] for r in long)}")  # fmt: skip
        out += [
            Value(f"{what}, distance of the tool [m, or entries of the rotation]", "≤ 1e-6", f"{fk:.2g}", fk <= 1e-6),
            Value(f"{what}, chunks with a step above twice the largest known one", "0", f"{len(long)} of {len(solved)}",
                  not long),
        ]  # fmt: skip
    joined = [row for row in rows if row["status"] == "joined"]
    for reason in sorted({r["reason"].split("which")[-1] for r in rows if r["status"] == "kept"}):
        print(f"  kept: {sum(r['reason'].endswith(reason) for r in rows)} × {reason}")
    over = np.max([r["over"] for r in joined], axis=0)
    jump = max(max(max(r[k]) for k in ("begin", "inside", "end")) for r in joined)
    return [
        *out,
        Value("excess over limits on q … q⃛ at 20 kHz", "≤ 1e-9", ", ".join(f"{x:.2g}" for x in over),
              bool((over <= 1e-9).all())),
        Value("discontinuity of q, q̇, q̈", "≤ 1e-12", f"{jump:.2g} of {len(joined)}", jump <= 1e-12),
    ]  # fmt: skip


if __name__ == "__main__":
    main("pose_chunks", measure, CASES, judge)
