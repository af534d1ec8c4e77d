"""IK problems at iteration budgets: one attempt of every method from one initial guess, evaluated after each budget."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import polars as pl
import pydantic
from numpy.typing import NDArray

from benchmarks.blocks.base import TEXT, WHOLE, BlockRows, Field, Kind, Session, Shard, Work, chunks, fields_of
from benchmarks.blocks.block import Entry, count_of
from benchmarks.blocks.contest import reseed
from benchmarks.blocks.entries import JUDGED_AT, BudgetedMethod, ProblemBlock, need_problems, store_problems, within
from benchmarks.problems.base import ProblemSet
from benchmarks.records import slug
from benchmarks.settings import Budgets, Entries, Flag, key, naming
from benchmarks.statistics import percentage
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.ik import IKResult, IKStatus, make_solver
from optik.registry import own_names, short_name
from optik.types import Array

SUCCESS_LEVELS = JUDGED_AT[:2]
"""Tolerances [m and rad] at which success is judged: a coarse one, and that of a solved problem."""

PER_RADIAN = float(np.rad2deg(1.0))
"""Degrees in a radian: rotation errors are shown in degrees."""

BUDGET_PART = 500
"""Number of problems in one part: small for resuming, large enough to hide the start of a worker."""

CRASHED = "crashed"
"""Status of a problem in which a method crashed its process, raised an error, or did not end; in addition to `IKStatus`."""

FIELDS = {
    "method": TEXT, "problem": WHOLE, "budget": WHOLE,
    **fields_of(Field(pl.Float64, np.inf), "error_x error_y error_z position_error rotation_error"),
    "iterations": Field(pl.Int64, 0, "iterations (both solved)", "", "less", only="solved"),
    "status": Field(pl.String, CRASHED), "rises": Field(pl.Int64, 0), "peak": Field(pl.Float64, np.inf),
    "solver": TEXT, "method_index": WHOLE,
    "solved": Field(pl.Boolean, None, "solved", "%", "more", stored=False),
}  # fmt: skip
"""Fields of the rows."""

_RESULTS = (
    "error_x",
    "error_y",
    "error_z",
    "position_error",
    "rotation_error",
    "iterations",
    "status",
    "rises",
    "peak",
)
"""Fields that a method gives."""

RISE = 1e-12
"""Growth of the error between iterations [m and rad] that is counted; less is rounding."""

# ---------------------------------------------------------------- measures, on the rows of one method at one budget


def succeeded(tolerance: float) -> pl.Expr:
    """Say whether BOTH errors of a row are within a tolerance, with every joint inside its limits."""
    return within(tolerance) & ~pl.col("status").is_in(["outside_limits", "rejected"])


def success(rows: pl.DataFrame, tolerance: float) -> tuple[float, float, float]:
    """Return the percentage of successes and its Wilson 95 % interval."""
    return percentage(count_of(rows, succeeded(tolerance)), len(rows))


@dataclass(frozen=True)
class BudgetRows(BlockRows):
    """A block with iteration budgets, and its rows."""

    @cached_property
    def methods(self) -> list[str]:
        """Labels of the methods that have rows, in the suite's order."""
        return self.rows["method"].unique(maintain_order=True).to_list()

    @cached_property
    def whole(self) -> list[str]:
        """Labels of the methods with default settings, without a budget."""
        found = {m.label for m in self.block.methods if m.whole}
        return [label for label in self.methods if label in found]

    @cached_property
    def budgeted(self) -> list[str]:
        """Labels of the methods that make one attempt, evaluated after every budget."""
        return [label for label in self.methods if label not in self.whole]

    @cached_property
    def budget(self) -> int:
        """The largest budget."""
        return int(self.block.budgets[-1])

    @cached_property
    def last(self) -> pl.DataFrame:
        """Return the rows at the largest budget."""
        return self.rows.filter(pl.col("budget") == self.budget)

    @cached_property
    def known(self) -> pl.DataFrame:
        """Rows of the problems with a known solution."""
        return self.rows.filter("known")

    def problems(self) -> tuple[int, int]:
        """Return the number of problems, and of those with a known solution."""
        first = self.rows.unique("problem")
        return len(first), int(first["known"].sum())


# ---------------------------------------------------------------- work


def _varies_options(given: dict[str, Any]) -> bool:
    methods = given["methods"]
    return len(methods) > 1 and len({method.name for method in methods}) == 1


class BudgetBlock(ProblemBlock):
    """One problem set on one robot, solved by some methods at some iteration budgets, one attempt each.

    A method that is ``whole`` has no budget: it is called once with default settings, including restarts.
    """

    budgets: Budgets = key("Iterations at which every run is judged, increasing.", (100,))
    methods: Annotated[tuple[Entry, ...], Entries(BudgetedMethod)] = key("The IK methods.")
    sweep: Flag = pydantic.Field(
        default_factory=_varies_options,
        description="Whether it varies options of one method; by default, if all methods are one solver.",
    )


@dataclass(frozen=True)
class BudgetWork(Work):
    """One part: some problems of a block by one method; all that a worker needs.

    Targets (k, 4, 4) are poses of the tool [m, 1], starts (k, n) initial guesses [rad, m]. What is random in a method is
    keyed by the seed, the problem and the method. Nothing is timed: times come from blocks of single calls, which have the
    processor to themselves.
    """

    lists = ("problems", "targets", "starts")

    robot: str
    method: Entry
    method_index: int
    budgets: tuple[int, ...]
    problems: NDArray[np.int64]
    targets: Array
    starts: Array
    seed: int = 0

    @property
    def looked_at(self) -> tuple[int, ...]:
        """Budgets that have a row: of a method with default settings only the largest."""
        return self.budgets[-1:] if self.method.whole else self.budgets

    def crashed(self) -> pl.DataFrame:
        """Return rows of problems in which the method crashed its process, raised an error, or did not end."""
        return self._labelled({name: pl.lit(FIELDS[name].lost, FIELDS[name].type) for name in _RESULTS})

    def solve(self) -> pl.DataFrame:
        """Solve the problems: at all budgets, or once by a method with default settings."""
        robot, method = load(self.robot), self.method
        solver = make_solver(robot, method.name, **method.ending_after(self.budgets[-1]).options)
        foreign = method.name not in own_names("optik.ik")  # ours use no random numbers
        rows = []
        for problem, target, start in zip(self.problems, self.targets, self.starts, strict=True):
            if foreign:
                reseed(solver, self.seed, int(problem), method.label)
            result = solver.solve(target, start, trace=not method.whole)
            rows.append(_at_end(robot, target, result) if method.whole else at_budgets(result, self.budgets))
        return self._labelled({name: pl.Series(np.concatenate([row[name] for row in rows])) for name in rows[0]})

    def _labelled(self, columns: Mapping[str, pl.Series | pl.Expr]) -> pl.DataFrame:
        """Return the rows of all problems at all budgets with some columns."""
        method, budgets = self.method, self.looked_at
        keys = {
            "problem": np.repeat(self.problems, len(budgets)),
            "budget": np.tile(np.array(budgets, dtype=np.int64), len(self.problems)),
        }
        return pl.DataFrame(keys).with_columns(
            **{name: columns[name] for name in _RESULTS},
            method=pl.lit(method.label), solver=pl.lit(short_name(method.name)), method_index=pl.lit(self.method_index),
        )  # fmt: skip


def at_budgets(result: IKResult, budgets: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Return the results of runs that stop at some budgets, from the trace of a run with the largest one.

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


def _at_end(robot: Robot, target: Array, result: IKResult) -> dict[str, NDArray[Any]]:
    """Return the result of one call of a method with default settings."""
    return _errors(robot.pose_errors(result.q[None], target[None])) | {
        "iterations": np.array([result.iterations], dtype=np.int64),
        "status": np.array([str(result.status)]),
        "rises": np.zeros(1, dtype=np.int64),
        "peak": np.array([np.nan]),
    }


def _errors(twists: Array) -> dict[str, NDArray[Any]]:
    """Return the columns of some error twists (k, 6) in the base frame [m, rad]."""
    columns = {f"error_{axis}": twists[:, i] for i, axis in enumerate("xyz")}
    position, rotation = np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)
    return columns | {"position_error": position, "rotation_error": rotation}


# ---------------------------------------------------------------- the kind


class _Budgets(Kind):
    """Blocks of IK problems at iteration budgets."""

    name = "budgets"
    title = "Methods"
    block = BudgetBlock
    read_as = BudgetRows
    order = 10
    alone = False
    on_paper = True
    fields = FIELDS

    def complete(self, rows: pl.DataFrame, block: BudgetBlock) -> pl.DataFrame:
        return need_problems(rows, block)

    def compared_rows(self, block: BudgetBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows at the largest budget."""
        last = rows.filter(pl.col("budget") == block.budgets[-1])
        return last.with_columns(solved=pl.col("status") == "solved")

    def prepare(self, block: BudgetBlock, seed: int) -> tuple[Robot, ProblemSet]:
        """Check the options of every method, and sample the problems."""
        robot = load(block.robot)
        for method in block.methods:
            make_solver(robot, method.name, **method.ending_after(block.budgets[-1]).options)
        with naming(f"block {block.id!r}: options"):
            return block.draw(seed)

    def shards(self, block: BudgetBlock, session: Session) -> Iterator[Shard]:
        """Write the problems, and divide the work."""
        robot, problems = session.prepared
        store_problems(session.folder, block, robot, problems)
        for index, method in enumerate(block.methods):
            for part, i in enumerate(chunks(problems.chosen(method.most), BUDGET_PART)):
                at = problems.targets[i], problems.starts[i]
                work = BudgetWork(block.robot, method, index, block.budgets, i, *at, session.seed)
                yield Shard(f"{index:02d}-{slug(method.label)}--{part:03d}", work, method.label)


METHOD = _Budgets
