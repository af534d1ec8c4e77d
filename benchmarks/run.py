"""Run a suite into a run folder: problem sets, IK methods at every budget, and the line by every method and law."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.batch import run_batch
from benchmarks.first_use import run_first_use
from benchmarks.line import check_line, run_line
from benchmarks.methods import Method
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.provenance import provenance
from benchmarks.records import FORMAT, RunFolder, slug
from benchmarks.speed import check_set, run_speed
from benchmarks.suite import Block, Suite
from benchmarks.timing import check_timing, run_timing
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.check import check_count
from optik.ik import IKResult, IKSolver, IKStatus, make_solver
from optik.types import Array

Progress = Callable[[int, int, str], None]

MOST_WORKERS = 4096
"""Processes: more than a machine has cores, and more than the operating system's queues can count."""

PART = 500
"""Problems in one part of the work: small enough to continue from, large enough to hide the start of a worker."""


@dataclass(frozen=True)
class Work:
    """One part: some problems of a block by one method. It is all that a worker needs."""

    file: str
    robot: str
    method: Method
    method_index: int
    budgets: tuple[int, ...]
    problems: NDArray[np.int64]
    targets: Array
    starts: Array


def run_suite(
    suite: Suite,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
    command: str = "",
) -> RunFolder:
    """Run a suite, or continue it where it stopped.

    Parameters
    ----------
    suite : Suite
        What to run.
    out : path
        Folder of the run: new, empty, or of the same suite and settings.
    workers : int
        Processes. More than one disturb each other's times; the answers are the same for any number.
    executor : concurrent.futures.Executor, optional
        Where to run the parts instead; the caller's to shut down.
    progress : callable, optional
        Called with (parts done, parts in all, what is next).
    command : str
        How to run this again, for the report.

    Returns
    -------
    RunFolder
        The finished run.

    Raises
    ------
    OutputError
        The folder cannot be written or holds something else.
    InvalidInput
        An option that a set or a method does not have.
    """
    check_count(workers, "workers", 1, MOST_WORKERS)
    tell = progress or (lambda done, total, what: None)
    _check_methods(suite)
    folder = RunFolder(out)
    manifest = {
        "format": FORMAT,
        "suite": suite.name,
        "title": suite.title,
        "fingerprint": suite.fingerprint,
        "settings": suite.settings,
        "command": command,
        "provenance": provenance(suite.seed, workers),
        "continued": [],
        "complete": False,
    }
    folder.checked(manifest)
    tell(0, 1, "problem sets")
    sets = [problem_set(block, suite.seed) for block in suite.blocks]
    if suite.line is not None:
        check_line(suite.line)
    manifest = folder.create(manifest)
    work = [
        part
        for block, (robot, problems) in zip(suite.blocks, sets, strict=True)
        for part in _parts(folder, block, robot, problems)
        if not folder.has(part.file)
    ]
    apart = len(suite.speed) + len(suite.batch) + (suite.first_use is not None) + len(suite.timing)
    total = len(work) + (suite.line is not None) + apart
    for done, (part, frame) in enumerate(_solved(work, workers, executor, tell, total), start=1):
        folder.write(part.file, frame)
        tell(done, total, part.method.label)
    if suite.line is not None and not folder.has("line/plans.json"):
        tell(len(work), total, "the line")
        run_line(suite.line, folder)
    _run_timed(suite, folder, tell, total - apart, total)
    tell(total, total, "done")
    folder.write_json("run.json", manifest | {"complete": True})
    return folder


def _run_timed(suite: Suite, folder: RunFolder, tell: Progress, done: int, total: int) -> None:
    """Everything that is timed by itself: here, one after another, whatever the number of workers."""
    if suite.first_use is not None:
        tell(done, total, "first use")
        run_first_use(suite.first_use, folder)
        done += 1
    for block in suite.speed:
        run_speed(block, suite.seed, folder, partial(tell, done, total))
        done += 1
    for batch in suite.batch:
        tell(done, total, f"{batch.id}: in a process of its own")
        run_batch(batch, suite.seed, folder)
        done += 1
    for lines in suite.timing:
        run_timing(lines, suite.seed, folder, partial(tell, done, total))
        done += 1


def _check_methods(suite: Suite) -> None:
    """Refuse wrong options before anything is written."""
    for block in suite.blocks:
        robot = load(block.robot)
        for method in block.methods:
            make_solver(robot, method.solver, **method.options, max_restarts=0)
    for timed in suite.speed:
        check_set(timed)
        for entry in timed.methods:
            make_solver(load(timed.robot), entry.solver, **entry.options)
    for batch in suite.batch:
        check_set(batch)
        make_solver(load(batch.robot), batch.solver, **batch.solver_options)
    for lines in suite.timing:
        check_timing(lines)


def _parts(folder: RunFolder, block: Block, robot: Robot, problems: ProblemSet) -> Iterator[Work]:
    name = f"problems/{slug(block.id)}.parquet"
    if not folder.has(name):
        folder.write(name, problems.frame(robot))
    for index, method in enumerate(block.methods):
        chosen = problems.chosen(method.max_problems)
        for part, first in enumerate(range(0, len(chosen), PART)):
            i = chosen[first : first + PART]
            yield Work(
                f"ik/{slug(block.id)}--{index:02d}-{slug(method.label)}--{part:03d}.parquet",
                block.robot, method, index, block.budgets, i, problems.targets[i], problems.starts[i],
            )  # fmt: skip


def _solved(
    work: list[Work], workers: int, executor: Executor | None, tell: Progress, total: int
) -> Iterator[tuple[Work, pl.DataFrame]]:
    """Parts as they are solved: here, in processes, or wherever the executor runs them."""
    if executor is None and workers == 1:
        for done, part in enumerate(work):
            tell(done, total, part.method.label)
            yield part, solve_part(part)
        return
    with ExitStack() as stack:
        pool = executor or stack.enter_context(ProcessPoolExecutor(workers, mp_context=get_context("spawn")))
        futures = {pool.submit(solve_part, part): part for part in work}
        for future in as_completed(futures):
            yield futures[future], future.result()


def solve_part(work: Work) -> pl.DataFrame:
    """Solve the problems of one part at all budgets: one row for each problem and budget.

    Errors, iterations and status at every budget come from one traced run. Times come from untraced runs, each really
    stopped at its budget; a run that ends by itself before its budget is the same run for all larger ones and is timed
    once.
    """
    robot = load(work.robot)
    solver = make_solver(
        robot, work.method.solver, **work.method.options, max_restarts=0, max_iterations=work.budgets[-1]
    )
    stopped = {b: solver.with_options(max_iterations=b) for b in work.budgets}
    for warm in (solver, *stopped.values()):
        warm.solve(work.targets[0], work.starts[0])
    columns: dict[str, list[Any]] = {}
    for problem, target, start in zip(work.problems, work.targets, work.starts, strict=True):
        result = solver.solve(target, start, trace=True)
        seconds = _times(stopped, result, target, start)
        for budget in work.budgets:
            row = {
                "problem": int(problem),
                "budget": budget,
                **at_budget(result, solver, budget),
                "seconds": seconds[budget],
            }
            for key, value in row.items():
                columns.setdefault(key, []).append(value)
    method = work.method
    return pl.DataFrame(columns).with_columns(
        method=pl.lit(method.label), solver=pl.lit(method.solver), method_index=pl.lit(work.method_index)
    )


def at_budget(result: IKResult, solver: IKSolver, budget: int) -> dict[str, Any]:
    """What a run stopped after so many iterations has reached, from the trace of a longer one.

    The errors are those of the iterate it stands at; the status is that of the stopped run.
    """
    assert result.trace is not None
    trace = result.trace[: budget + 1]
    size = np.linalg.norm(trace, axis=1)
    ended = result.iterations <= budget
    last = trace[-1]
    position, rotation = float(np.linalg.norm(last[:3])), float(np.linalg.norm(last[3:]))
    return {
        "error_x": float(last[0]),
        "error_y": float(last[1]),
        "error_z": float(last[2]),
        "position_error": position,
        "rotation_error": rotation,
        "iterations": len(trace) - 1,
        "status": str(result.status if ended else IKStatus.MAX_ITERATIONS),
        "rises": int((np.diff(size) > 1e-12).sum()),
        "peak": float(size.max() / size[0]) if size[0] > 0.0 else 1.0,
    }


def _times(stopped: dict[int, IKSolver], result: IKResult, target: Array, start: Array) -> dict[int, float]:
    seconds: dict[int, float] = {}
    measured = None
    for budget, solver in stopped.items():
        if measured is None:
            begin = time.perf_counter()
            solver.solve(target, start)
            seconds[budget] = time.perf_counter() - begin
            if result.iterations <= budget:
                measured = seconds[budget]
        else:
            seconds[budget] = measured
    return seconds
