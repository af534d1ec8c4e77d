"""Batches: many IK problems in one call, timed in a fresh process.

``python -m benchmarks.blocks.batch SETTINGS`` is that process: it prints its rows as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import NUMBER, TEXT, WHOLE, Field, Kind, Session, Shard, fields_of
from benchmarks.blocks.block import Column, Target, median_with_range
from benchmarks.blocks.contest import fresh
from benchmarks.blocks.entries import ProblemBlock, check_set, judge_configurations
from benchmarks.problems.base import SETS
from benchmarks.settings import LISTED, Count, Options, SolverName, key
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.registry import build_method
from optik.types import Array

FIRST_PROBLEMS = 256
"""Problems solved before the first timed batch: the call compiles, and threads start."""

JUDGED_AT_ONCE = 50_000
"""Answers that are judged at a time, so that judging needs little memory."""

# ---------------------------------------------------------------- measures


def solved_rate(rows: pl.DataFrame) -> float:
    """Return the problems solved a second [million], the median of the repeats."""
    return 1e-6 * float(np.median(rows["solved"].to_numpy() / rows["seconds"].to_numpy()))


MEASURES = (
    Column("success", "solved", "%", show="exact",
           of=lambda rows: 100.0 * (rows["solved"].to_numpy() / rows["count"].to_numpy()).min()),
    Column("million_per_second", "solved per second", "million", "more", of=solved_rate),
    Column("seconds", "median time", "s", "less", of=median_with_range("seconds")),
    Column("count", "problems", show="count", of=lambda rows: int(rows["count"][0])),
)  # fmt: skip
"""Measures that a target of a batch can name, on the rows with its largest number of threads."""

# ---------------------------------------------------------------- the fresh process


def measure(settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Time every batch."""
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
            begin = time.perf_counter()
            answer = solver.solve_batch(targets, starts, threads=threads)
            seconds = time.perf_counter() - begin
            rows.append(
                {
                    "method": f"{threads} threads",
                    "problem": "the batch",
                    "threads": threads,
                    "repeat": repeat,
                    "count": len(targets),
                    "seconds": seconds,
                    "solved": _count_solved(robot, targets, answer.q),
                    "claimed": int(np.asarray(answer.solved).sum()),
                    "iterations": float(np.mean(answer.iterations)),
                    "problems_sha256": sha256,
                }
            )
            del answer
    return rows


def _count_solved(robot: Robot, targets: Array, q: Array) -> int:
    """Count the answers that meet their targets inside the limits, by our own forward kinematics."""
    count = 0
    for first in range(0, len(q), JUDGED_AT_ONCE):
        here = slice(first, first + JUDGED_AT_ONCE)
        inside, position, rotation = judge_configurations(robot, targets[here], q[here])
        count += int((inside & (position <= 1e-6) & (rotation <= 1e-6)).sum())
    return count


# ---------------------------------------------------------------- the kind


class BatchBlock(ProblemBlock):
    """One problem set on one robot, solved as one batch with some numbers of threads."""

    noun = "batch"
    measures = MEASURES
    not_problems = frozenset({"solver", "solver_options", "threads"})

    solver: SolverName = key("The IK method.")
    solver_options: Options = key("Options of the method.", {})
    threads: Annotated[tuple[Count, ...], LISTED] = key("Numbers of threads, one after another.", (1,))
    repeats: Count = key("Timed repeats of each.", 3)


FIELDS = {
    "method": TEXT, "problem": TEXT, **fields_of(WHOLE, "threads repeat count"),
    "seconds": Field(pl.Float64, None, "time of a batch", "s", "less", clock="wall"),
    **fields_of(WHOLE, "solved claimed"), "iterations": NUMBER, "problems_sha256": TEXT,
}  # fmt: skip
"""Fields of the rows."""


class _Batch(Kind):
    """Batches."""

    name = "batch"
    title = "Batches"
    block = BatchBlock
    fields = FIELDS
    order = 30

    def prepare(self, block: BatchBlock, seed: int) -> None:
        check_set(block)
        make_solver(load(block.robot), block.solver, **block.solver_options)

    def shards(self, block: BatchBlock, session: Session) -> Iterator[Shard]:
        """Yield all batches as one shard, in a process of its own."""
        keys = ("robot", "set", "options", "solver", "solver_options", "threads", "repeats")
        asked = json.dumps({name: getattr(block, name) for name in keys} | {"seed": session.seed})
        label = f"{block.id}: in a process of its own"
        yield Shard("0000", lambda: self.frame(fresh(["-m", __name__, asked], f"batch {block.id!r}")), label)

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        """Return the repeats with the largest number of threads."""
        most = rows.filter(pl.col("threads") == pl.col("threads").max())
        return most, f"{most['count'][0]:,} problems, {most['threads'][0]} threads, {len(most)} times"


METHOD = _Batch

if __name__ == "__main__":
    print(json.dumps(measure(json.loads(sys.argv[1]))))
