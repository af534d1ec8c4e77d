"""Batches: many problems in one call, timed in a fresh process, where its own memory can be told from the rest.

``python -m benchmarks.batch SETTINGS`` is that process: it prints its rows as JSON.
"""

from __future__ import annotations

import ctypes
import gc
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.fresh import fresh
from benchmarks.problems.base import SETS
from benchmarks.records import RunFolder, slug
from benchmarks.speed_suite import BatchBlock
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.registry import build_method

WARM_UP = 256
"""Problems solved before the first timed batch: the call compiles, and threads start."""


def batch_file(block: BatchBlock) -> str:
    """Name of a block's part."""
    return f"speed/{slug(block.id)}.batch.parquet"


def run_batch(block: BatchBlock, seed: int, folder: RunFolder) -> None:
    """Run a batch in a process of its own, unless it was.

    Raises
    ------
    ProcessFailed
        The process ended without rows; its last words are told.
    """
    if folder.has(batch_file(block)):
        return
    settings = {
        "robot": block.robot, "set": block.set, "options": block.options, "solver": block.solver, "seed": seed,
        "solver_options": block.solver_options, "threads": block.threads, "repeats": block.repeats,
    }  # fmt: skip
    rows = fresh(["-m", "benchmarks.batch", json.dumps(settings)], f"batch {block.id!r}")
    folder.write(batch_file(block), pl.DataFrame(rows))


def batch_rows(folder: RunFolder, block: BatchBlock) -> pl.DataFrame | None:
    """One row for each number of threads and repeat; None where it was not run."""
    return folder.read(batch_file(block))


# ---------------------------------------------------------------- in the fresh process


def measure(settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Time every batch and what memory it takes beyond its inputs and outputs."""
    robot = load(settings["robot"])
    problems = build_method(SETS, settings["set"], "problem set", robot, settings["seed"], **settings["options"])
    targets, starts = np.ascontiguousarray(problems.targets), np.ascontiguousarray(problems.starts)
    del problems
    solver = make_solver(robot, settings["solver"], **settings["solver_options"])
    rows = []
    for threads in settings["threads"]:
        solver.solve_batch(targets[:WARM_UP], starts[:WARM_UP], threads=threads)
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
                }
            )
            del answer
    return rows


def _solved(robot: Robot, targets: Any, q: Any, chunk: int = 50_000) -> int:
    """How many answers meet their targets inside the limits, by our own forward kinematics."""
    count = 0
    for first in range(0, len(q), chunk):
        here = slice(first, first + chunk)
        e = robot.errors(q[here], targets[here])
        near = (np.linalg.norm(e[:, :3], axis=1) <= 1e-6) & (np.linalg.norm(e[:, 3:], axis=1) <= 1e-6)
        count += int((near & robot.limits.contains(q[here])).sum())
    return count


def _size(answer: Any) -> int:
    return sum(part.nbytes for part in answer if isinstance(part, np.ndarray))


def reset_peak() -> float | None:
    """Give back what is free and forget the peak so far; the memory now in use [MB], None where nobody says."""
    gc.collect()
    try:
        ctypes.CDLL(None).malloc_trim(
            0
        )  # glibc keeps freed memory: arrays that move into it would seem to cost nothing
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except (OSError, AttributeError):
        return None
    return memory("VmRSS")


def memory(field: str) -> float | None:
    """A figure of this process in /proc/self/status [MB], None where there is none."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    found = [line for line in lines if line.startswith(f"{field}:")]
    return float(found[0].split()[1]) * 1.024e-3 if found else None


if __name__ == "__main__":
    print(json.dumps(measure(json.loads(sys.argv[1]))))
