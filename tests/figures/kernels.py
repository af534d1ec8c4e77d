"""CPU time and bits of calls with the kernels of `make kernels` against kernels compiled for this processor, interleaved.

Needs `make kernels` and `optik kernels --compile --native`; each case is a process for each of the two, one after the other.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np

import optik
import planners
from tests.figures.figure import ROOT, Row, Value, main

COUNT, REPEATS = 12, 5
REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def problems(kind: str, count: int) -> tuple[Any, Any]:
    """Targets that paper6r reaches, and starts; hard ones are at a limit and near a singular wrist."""
    robot, rng = optik.load("paper6r"), np.random.default_rng([len(kind), count])
    low, high = robot.limits.lower.clip(-3.0), robot.limits.upper.clip(max=3.0)
    q = low + (high - low) * rng.uniform(0.1, 0.9, (count, robot.n))
    if kind == "hard":
        q[:, 1], q[:, 4] = low[1], 1e-4 * rng.uniform(-1.0, 1.0, count)
    start = q + rng.uniform(-0.3, 0.3, q.shape) if kind == "near" else rng.uniform(low, high, q.shape)
    return robot.fk(q), np.clip(start, low, high)


def calls() -> dict[str, tuple[Callable[[], Any], int]]:
    """What is timed, and how often."""
    robot, q0 = optik.load("paper6r"), np.deg2rad([20, -35, 40, 25, 50, -30])
    solve, start = optik.ik.LM(robot).solve, optik.load("paper6r").fk(q0)
    line = planners.Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + [-0.12, 0.0, 0.20]))
    plan, arm = planners.plan(robot, line, q0), optik.load("panda")
    loaded, faster = arm.with_payload(3.0), planners.MotionLimits(2.0, 12.0, 120.0, tool_speed=0.6)
    box = (optik.se3.pose(p=[0.6, 0.0, 0.1]), (0.3, 0.6, 0.2))
    scene = optik.Scene(margin=0.02, boxes=[box], planes=[((0.0, 0.0, -0.05), (0.0, 0.0, 1.0))])
    goal = REST + np.array([0.5, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0])
    many = problems("far", 4000)
    out: dict[str, tuple[Callable[[], Any], int]] = {
        kind: (lambda T=T, q=q: [solve(*pair).q for pair in zip(T, q, strict=True)], REPEATS)
        for kind, (T, q) in ((kind, problems(kind, 1000)) for kind in ("near", "far", "hard"))
    }
    return out | {
        "batch": (lambda: optik.solve_ik_batch(robot, *many, threads=1).q, REPEATS),
        "plan": (lambda: planners.plan(robot, line, q0), 3 * REPEATS),
        "torque plan": (lambda: planners.plan(loaded, goal, REST), REPEATS),
        "clearance": (lambda: planners.plan(arm, goal, REST, scene=scene), REPEATS),
        "replan": (lambda: planners.replan(plan, 0.15, limits=faster), REPEATS),
    }


def worker() -> None:
    """Print the least CPU time of every call, and a digest of the bits of its result."""
    times, digests = {}, {}
    for name, (call, repeats) in calls().items():
        times[name] = np.inf
        for _ in range(repeats):
            begin = process_time()
            result = call()
            times[name] = min(times[name], process_time() - begin)
        if isinstance(result, planners.Plan):
            t = np.linspace(0.0, result.trajectory.duration, 200)
            proof = result.certificate
            clearance = [proof.clearance.scene.value] if proof.clearance and proof.clearance.scene else []
            result = np.concatenate([result.trajectory(t).ravel(), proof.path_error.distance * np.ones(1), clearance])
        digests[name] = hashlib.sha256(np.ascontiguousarray(result).tobytes()).hexdigest()
    print(json.dumps([times, digests]))


def measure(case: int) -> Row:
    """Both in turn; which is first changes."""
    found: dict[str, Any] = {}
    with TemporaryDirectory() as empty:
        kinds = {
            "shipped": {"NUMBA_CACHE_DIR": empty, "OPTIK_COMPILES": "error"},
            "native": {"OPTIK_COMPILES": "native"},
        }
        for kind in sorted(kinds, reverse=case % 2 == 0):
            code = "from tests.figures.kernels import worker; worker()"
            one = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            done = subprocess.run(
                [sys.executable, "-c", code],
                env=os.environ | one | kinds[kind],
                capture_output=True,
                text=True,
                check=True,
            )
            found[kind] = json.loads(done.stdout)
    return found


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    out = []
    for name in rows[0]["native"][0]:
        times = {kind: min(row[kind][0][name] for row in rows) for kind in ("shipped", "native")}
        ratio = times["shipped"] / times["native"]
        equal = len({row[kind][1][name] for row in rows for kind in times}) == 1
        words = f"{ratio:.3f} ({1e3 * times['shipped']:.3g} ms), bits {'equal' if equal else 'differ'}"
        out.append(Value(f"{name}, shipped over native", "≤ 1.10, equal bits", words, ratio <= 1.10 and equal))
    return out


if __name__ == "__main__":
    main("kernels", measure, COUNT, judge)
