"""The fresh process of a batch: ``python -m benchmarks.blocks.ik.batch.process SETTINGS`` prints its rows as JSON."""

from __future__ import annotations

import ctypes
import gc
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.problems.base import SETS
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.registry import build_method
from optik.types import Array

FIRST_PROBLEMS = 256
"""Problems solved before the first timed batch: the call compiles, and threads start."""

JUDGED_AT_ONCE = 50_000
"""Answers that are judged at a time, so that judging needs little memory."""


def measure(settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Time every batch, and what memory it takes beyond its inputs and outputs."""
    robot = load(settings["robot"])
    problems = build_method(SETS, settings["set"], "problem set", robot, settings["seed"], **settings["options"])
    targets, starts = np.ascontiguousarray(problems.targets), np.ascontiguousarray(problems.starts)
    sha256 = problems.sha256
    del problems
    solver = make_solver(robot, settings["solver"], **settings["solver_options"])
    rows = []
    for threads in settings["threads"]:
        solver.solve_batch(targets[:FIRST_PROBLEMS], starts[:FIRST_PROBLEMS], threads=threads)
        for repeat in range(settings["repeats"]):
            before = reset_peak()
            begin = time.perf_counter()
            answer = solver.solve_batch(targets, starts, threads=threads)
            seconds = time.perf_counter() - begin
            peak = memory("VmHWM")
            extra = None if before is None or peak is None else peak - before - _size(answer) / 1e6
            solved = _solved(robot, targets, answer.q)
            rows.append(
                {
                    "threads": threads,
                    "repeat": repeat,
                    "count": len(targets),
                    "seconds": seconds,
                    "solved": solved,
                    "claimed": int(np.asarray(answer.solved).sum()),
                    "iterations": float(np.mean(answer.iterations)),
                    "extra_memory_mb": extra,
                    "problems_sha256": sha256,
                }
            )
            del answer
    return rows


def _solved(robot: Robot, targets: Array, q: Array) -> int:
    """How many answers meet their targets inside the limits, by our own forward kinematics."""
    count = 0
    for first in range(0, len(q), JUDGED_AT_ONCE):
        here = slice(first, first + JUDGED_AT_ONCE)
        e = robot.pose_errors(q[here], targets[here])
        near = (np.linalg.norm(e[:, :3], axis=1) <= 1e-6) & (np.linalg.norm(e[:, 3:], axis=1) <= 1e-6)
        count += int((near & robot.limits.contains(q[here])).sum())
    return count


def _size(answer: Any) -> int:
    return sum(part.nbytes for part in answer if isinstance(part, np.ndarray))


def reset_peak() -> float | None:
    """Return free memory to the system and reset its peak; the memory now in use [MB], None where it is not known."""
    gc.collect()
    try:
        # glibc keeps freed memory: arrays that are put there would seem to cost nothing
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except (OSError, AttributeError):
        return None
    return memory("VmRSS")


def memory(field: str) -> float | None:
    """A figure of this process in ``/proc/self/status``."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    found = [line for line in lines if line.startswith(f"{field}:")]
    return float(found[0].split()[1]) * 1.024e-3 if found else None


if __name__ == "__main__":
    print(json.dumps(measure(json.loads(sys.argv[1]))))
