"""Solve problems at iteration budgets: errors from one traced run, times from runs that really stop there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.kinds._seeds import reseed
from benchmarks.kinds.base import Entry, Part
from benchmarks.kinds.budgets.settings import BudgetBlock
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.records import RunFolder, slug
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.ik import IKResult, IKSolver, IKStatus, make_solver
from optik.registry import own_names, short_name
from optik.types import Array

BUDGET_PART = 500
"""Problems in one part of the work: small enough to continue from, large enough to hide the start of a worker."""

CRASHED = "crashed"
"""Status of a problem in which a method crashed its process, raised an error, or found no end; beside those of `IKStatus`."""

COLUMN_ORDER = (
    "problem", "budget", "error_x", "error_y", "error_z", "position_error", "rotation_error", "iterations", "status",
    "rises", "peak", "seconds",
)  # fmt: skip
"""Columns of the rows, before those that say whose they are."""

RISE = 1e-12
"""Growth of the error from one iteration to the next [m and rad] that is counted; less is round-off."""


@dataclass(frozen=True)
class Work:
    """One part: some problems of a block by one method. It is all that a worker needs.

    Attributes
    ----------
    robot : str
        Name of the arm.
    method : Entry
        The method.
    method_index : int
        Its place in the block.
    budgets : tuple of int
        Iterations at which it is looked at.
    problems : (k,) array of int
        Numbers of the problems.
    targets : (k, 4, 4) array
        Poses of the tool [m, 1].
    starts : (k, n) array
        Initial guesses [rad, m].
    seed : int
        Of the suite: what is random in a method is keyed by it, the problem and the method.
    """

    robot: str
    method: Entry
    method_index: int
    budgets: tuple[int, ...]
    problems: NDArray[np.int64]
    targets: Array
    starts: Array
    seed: int = 0

    def halves(self) -> tuple[Work, ...]:
        """Itself in two, to find the problem that kills a process; nothing where there is one problem."""
        count = len(self.problems)
        parts = (slice(count // 2), slice(count // 2, count)) if count > 1 else ()
        return tuple(
            replace(self, problems=self.problems[i], targets=self.targets[i], starts=self.starts[i]) for i in parts
        )

    def crashed(self) -> pl.DataFrame:
        """Rows of problems in which the method crashed its process, raised an error, or found no end."""
        far = ("error_x", "error_y", "error_z", "position_error", "rotation_error", "peak", "seconds")
        blank = dict.fromkeys(far, float("inf")) | {"iterations": 0, "status": CRASHED, "rises": 0}
        pairs = [(int(problem), budget) for problem in self.problems for budget in self.budgets]
        return self.labelled(pl.DataFrame([{"problem": problem, "budget": b} | blank for problem, b in pairs]))

    def labelled(self, rows: pl.DataFrame) -> pl.DataFrame:
        """Rows with the columns that say whose they are, in one order of columns.

        Parameters
        ----------
        rows : DataFrame
            The rows.

        Returns
        -------
        DataFrame
            With the method's label, solver and place.
        """
        method = self.method
        return rows.select(*COLUMN_ORDER).with_columns(
            method=pl.lit(method.label), solver=pl.lit(short_name(method.name)), method_index=pl.lit(self.method_index)
        )


def prepare(block: BudgetBlock, seed: int) -> tuple[Robot, ProblemSet, int]:
    """Check the options of every method, and draw the problems.

    Parameters
    ----------
    block : BudgetBlock
        The block.
    seed : int
        Of the suite.

    Returns
    -------
    robot : Robot
        The arm.
    problems : ProblemSet
        The problems.
    seed : int
        Of the suite.

    Raises
    ------
    InvalidInput
        An option that a method or the set does not have.
    """
    robot = load(block.robot)
    for method in block.methods:
        make_solver(robot, method.name, **method.options, max_restarts=0)
    return (*problem_set(block, seed), seed)


def parts(folder: RunFolder, block: BudgetBlock, robot: Robot, problems: ProblemSet, seed: int) -> Iterator[Part]:
    """Write the problems, and divide the work.

    Parameters
    ----------
    folder : RunFolder
        The run.
    block : BudgetBlock
        The block.
    robot : Robot
        The arm.
    problems : ProblemSet
        The problems.
    seed : int
        Of the suite.

    Yields
    ------
    Part
        Some problems by one method.
    """
    name = f"problems/{slug(block.id)}.parquet"
    if not folder.has(name):
        folder.write(name, problems.frame(robot))
    for index, method in enumerate(block.methods):
        chosen = problems.chosen(method.most)
        for part, first in enumerate(range(0, len(chosen), BUDGET_PART)):
            i = chosen[first : first + BUDGET_PART]
            work = Work(block.robot, method, index, block.budgets, i, problems.targets[i], problems.starts[i], seed)
            file = f"ik/{slug(block.id)}--{index:02d}-{slug(method.label)}--{part:03d}.parquet"
            yield Part(file, method.label, work)


def solve_problems(work: Work) -> pl.DataFrame:
    """Solve the problems of one part at all budgets.

    Errors, iterations and status at every budget come from one traced run. Times come from untraced runs, each really
    stopped at its budget; a run that ends by itself before its budget is the same run for all larger ones and is timed
    once.

    Parameters
    ----------
    work : Work
        The part.

    Returns
    -------
    DataFrame
        One row for each problem and budget.
    """
    robot = load(work.robot)
    method = work.method
    solver = make_solver(robot, method.name, **method.options, max_restarts=0, max_iterations=work.budgets[-1])
    stopped = {b: solver.with_options(max_iterations=b) for b in work.budgets}
    for warm in (solver, *stopped.values()):
        warm.solve(work.targets[0], work.starts[0])
    columns: dict[str, list[Any]] = {}
    foreign = method.name not in own_names("optik.ik")
    for problem, target, start in zip(work.problems, work.targets, work.starts, strict=True):
        fresh = partial(_set_random, work, foreign, int(problem))
        result = fresh(solver).solve(target, start, trace=True)
        seconds = _times(stopped, result, target, start, fresh)
        for budget in work.budgets:
            row = {
                "problem": int(problem),
                "budget": budget,
                **at_budget(result, budget),
                "seconds": seconds[budget],
            }
            for key, value in row.items():
                columns.setdefault(key, []).append(value)
    return work.labelled(pl.DataFrame(columns))


def at_budget(result: IKResult, budget: int) -> dict[str, Any]:
    """What a run that stops at a budget has reached, from the trace of a longer run.

    The errors are those of the iterate that it has reached; the status is that of the stopped run.

    Parameters
    ----------
    result : IKResult
        Of the longer run, with its trace.
    budget : int
        Iterations after which the run stops.

    Returns
    -------
    dict
        Columns of one row: errors [m, rad], iterations, status, how often the error rose, and its peak over its first value.
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
        "rises": int((np.diff(size) > RISE).sum()),
        "peak": float(size.max() / size[0]) if size[0] > 0.0 else 1.0,
    }


def _set_random(work: Work, foreign: bool, problem: int, solver: IKSolver) -> IKSolver:
    """A solver with its random numbers set for a problem, where it is not ours: ours have none."""
    if foreign:
        reseed(solver, work.seed, problem, work.method.label)
    return solver


def _times(
    stopped: dict[int, IKSolver], result: IKResult, target: Array, start: Array, fresh: Callable[[IKSolver], IKSolver]
) -> dict[int, float]:
    """Seconds of a run that is really stopped at each budget."""
    seconds: dict[int, float] = {}
    measured = None
    for budget, solver in stopped.items():
        if measured is None:
            fresh(solver)
            begin = time.perf_counter()
            solver.solve(target, start)
            seconds[budget] = time.perf_counter() - begin
            if result.iterations <= budget:
                measured = seconds[budget]
        else:
            seconds[budget] = measured
    return seconds
