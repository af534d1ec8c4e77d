"""Solve problems at iteration budgets: what a run has reached at each of them, read from one traced run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks._problems import store_problems
from benchmarks.blocks._seeds import reseed
from benchmarks.blocks.base import Entry, Part
from benchmarks.blocks.ik.budgets.measures import SUCCESS_LEVELS
from benchmarks.blocks.ik.budgets.settings import BudgetBlock
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.records import RunFolder, slug
from benchmarks.settings import naming
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.ik import IKResult, IKStatus, make_solver
from optik.registry import own_names, short_name
from optik.types import Array

BUDGET_PART = 500
"""Problems in one part of the work: small enough to continue from, large enough to hide the start of a worker."""

CRASHED = "crashed"
"""Status of a problem in which a method crashed its process, raised an error, or found no end; beside those of `IKStatus`."""

COLUMN_ORDER = (
    "problem", "budget", "error_x", "error_y", "error_z", "position_error", "rotation_error", "iterations", "status",
    "rises", "peak",
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

    @property
    def looked_at(self) -> tuple[int, ...]:
        """Budgets that have a row: of a method as it comes only the largest."""
        return self.budgets[-1:] if self.method.whole else self.budgets

    def crashed(self) -> pl.DataFrame:
        """Rows of problems in which the method crashed its process, raised an error, or found no end."""
        far = ("error_x", "error_y", "error_z", "position_error", "rotation_error", "peak")
        blank = dict.fromkeys(far, float("inf")) | {"iterations": 0, "status": CRASHED, "rises": 0}
        pairs = [(int(problem), budget) for problem in self.problems for budget in self.looked_at]
        return self.labelled(pl.DataFrame([{"problem": problem, "budget": b} | blank for problem, b in pairs]))

    def labelled(self, rows: pl.DataFrame) -> pl.DataFrame:
        """Rows with the columns that say whose they are, in one order of columns."""
        method = self.method
        return rows.select(*COLUMN_ORDER).with_columns(
            method=pl.lit(method.label), solver=pl.lit(short_name(method.name)), method_index=pl.lit(self.method_index)
        )


def prepare(block: BudgetBlock, seed: int) -> tuple[Robot, ProblemSet, int]:
    """Check the options of every method, and draw the problems."""
    robot = load(block.robot)
    for method in block.methods:
        make_solver(robot, method.name, **_options(method, block.budgets))
    with naming(f"block {block.id!r}: options"):
        return (*problem_set(block, seed), seed)


def parts(folder: RunFolder, block: BudgetBlock, robot: Robot, problems: ProblemSet, seed: int) -> Iterator[Part]:
    """Write the problems, and divide the work."""
    store_problems(folder, block, robot, problems)
    for index, method in enumerate(block.methods):
        chosen = problems.chosen(method.most)
        for part, first in enumerate(range(0, len(chosen), BUDGET_PART)):
            i = chosen[first : first + BUDGET_PART]
            work = Work(block.robot, method, index, block.budgets, i, problems.targets[i], problems.starts[i], seed)
            file = f"ik/{slug(block.id)}--{index:02d}-{slug(method.label)}--{part:03d}.parquet"
            yield Part(file, method.label, work)


def _options(method: Entry, budgets: tuple[int, ...]) -> dict[str, Any]:
    """Options of a method: one attempt of as many iterations as the largest budget, or as it comes."""
    return method.options if method.whole else method.options | {"max_restarts": 0, "max_iterations": budgets[-1]}


def solve_problems(work: Work) -> pl.DataFrame:
    """Solve the problems of one part: at all budgets, or, by a method that is called as it comes, once.

    Nothing is timed: times come from blocks of single calls, which have the processor to themselves.
    """
    robot, method = load(work.robot), work.method
    solver = make_solver(robot, method.name, **_options(method, work.budgets))
    foreign = method.name not in own_names("optik.ik")  # ours use no random numbers
    rows = []
    for problem, target, start in zip(work.problems, work.targets, work.starts, strict=True):
        if foreign:
            reseed(solver, work.seed, int(problem), method.label)
        result = solver.solve(target, start, trace=not method.whole)
        rows.append(as_it_comes(robot, target, result) if method.whole else at_budgets(result, work.budgets))
    budgets = work.looked_at
    columns = {key: np.concatenate([row[key] for row in rows]) for key in rows[0]}
    return work.labelled(
        pl.DataFrame(
            {
                "problem": np.repeat(work.problems, len(budgets)),
                "budget": np.tile(np.array(budgets, dtype=np.int64), len(rows)),
                **columns,
            }
        )
    )


def at_budgets(result: IKResult, budgets: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """What runs that stop at some budgets have reached, from the trace of a run that is as long as the largest.

    The errors are those of the iterate that each has reached; the status is that of the stopped run. Where the longest
    run ends outside the limits, its iterates within the coarsest tolerance of the target are outside too, and say so.
    """
    assert result.trace is not None
    trace = result.trace
    i = np.minimum(budgets, len(trace) - 1)
    size = np.linalg.norm(trace, axis=1)
    rises = np.concatenate([[0], np.cumsum(np.diff(size) > RISE)])
    peak = np.maximum.accumulate(size) / size[0] if size[0] > 0.0 else np.ones(len(size))
    errors = _errors(trace[i])
    ended = np.asarray(budgets) >= result.iterations
    if result.status is IKStatus.OUTSIDE_LIMITS:
        ended |= np.maximum(errors["position_error"], errors["rotation_error"]) <= max(SUCCESS_LEVELS)
    return errors | {
        "iterations": i.astype(np.int64),
        "status": np.where(ended, str(result.status), str(IKStatus.MAX_ITERATIONS)),
        "rises": rises[i].astype(np.int64),
        "peak": peak[i],
    }


def as_it_comes(robot: Robot, target: Array, result: IKResult) -> dict[str, NDArray[Any]]:
    """What one call of a method as it comes has reached."""
    return _errors(robot.pose_errors(result.q[None], target[None])) | {
        "iterations": np.array([result.iterations], dtype=np.int64),
        "status": np.array([str(result.status)]),
        "rises": np.zeros(1, dtype=np.int64),
        "peak": np.array([np.nan]),
    }


def _errors(twists: Array) -> dict[str, NDArray[Any]]:
    """Columns of some error twists (k, 6) in the base frame [m, rad]."""
    columns = {f"error_{axis}": twists[:, i] for i, axis in enumerate("xyz")}
    position, rotation = np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)
    return columns | {"position_error": position, "rotation_error": rotation}
