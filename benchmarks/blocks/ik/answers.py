"""Recorded answers: any number of IK problems, sampled and solved in batches; every answer is verified and stored."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import polars as pl
from pydantic import model_validator

from benchmarks.blocks.base import Compared, Entry, Kind, Part, Target, Work, chunks
from benchmarks.blocks.columns import Column, Of, largest, mean
from benchmarks.blocks.contest import reseed, trial_seed
from benchmarks.blocks.entries import Method, ProblemBlock, record_hash
from benchmarks.blocks.ik.judgement import JUDGED_AT, judge_configurations, level_name, level_words, solved_at
from benchmarks.problems.base import SETS, ProblemSet
from benchmarks.records import RunFolder, slug
from benchmarks.settings import Count, Entries, key
from benchmarks.statistics import percentage
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import IKBatch, IKSolver, IKStatus, make_solver
from optik.registry import build_method, own_names
from optik.types import Array, Flags

DRAWN_AT_ONCE = 1000
"""Number of problems that are sampled together, with a separate seed: any part can be sampled without the others."""

ANSWERS_PART = 50_000
"""Default number of problems in one part: a second of work, and a megabyte of rows."""

QUANTILES = {"median": 0.5, "p95": 0.95, "p99": 0.99}
"""Quantiles of the errors."""

BINS_A_DECADE = 10
"""Steps of the distribution of the errors: as fine as a curve of a few hundred pixels shows."""

EXACT = 1e-16
"""Errors [m] below this count in the first step of their distribution: rounding, and exact zeros."""

STATUSES = pl.Enum([*map(str, IKStatus), "crashed"])
"""Endings of an answer: the statuses of our methods, and ``crashed`` if a process ended or raised an error."""

ANSWER_TYPES: Mapping[str, Any] = {
    "inside": pl.Boolean, "position_error": pl.Float32, "rotation_error": pl.Float32, "iterations": pl.UInt32,
    "restarts": pl.UInt16, "status": STATUSES, "distance": pl.Float32, "seconds": pl.Float32,
}  # fmt: skip
"""Columns of the rows: errors [m, rad] by our forward kinematics, distance of start and target [m], time a problem [s]."""

# ---------------------------------------------------------------- measures, on one row a method


def success_within(tolerance: float) -> Of:
    """Return the computation of the percentage within a tolerance, with its Wilson 95 % interval."""
    return lambda row: percentage(int(row[f"at {level_name(tolerance)}"].sum()), int(row["count"].sum()))


def solved_a_second(row: pl.DataFrame) -> float:
    """Return the problems solved a second and core."""
    return float(row["at 1e-6"][0] / max(row["seconds"][0], 1e-9))


MEASURES = (
    *(
        Column(
            f"success at {level_words(at)}", f"success at {level_words(at)}", "%", show="share", of=success_within(at)
        )
        for at in JUDGED_AT
    ),
    Column("position error", "position error", "mm", of=largest("position median", 1e3)),
    Column("rotation error", "rotation error", "rad", of=largest("rotation median")),
    Column("mean iterations", "mean iterations", of=mean("iterations")),
    Column("solved_per_second", "solved per second and core", "1/s", of=solved_a_second),
    Column("crashed", "crashed", show="count", of=largest("crashed")),
)
"""Measures that a target of recorded answers can name."""


def summary(rows: pl.LazyFrame) -> pl.DataFrame:
    """Return counts, quantiles and sums of each method; the rows of the answers are never all in memory."""
    columns = [
        pl.len().alias("count"),
        pl.col("solved").sum().alias("claimed"),
        (pl.col("status") == "crashed").sum().alias("crashed"),
        *(solved_at(tolerance).sum().alias(f"at {level_name(tolerance)}") for tolerance in JUDGED_AT),
        *(
            pl.col(f"{kind}_error").quantile(level, interpolation="linear").alias(f"{kind} {name}")
            for kind in ("position", "rotation")
            for name, level in QUANTILES.items()
        ),
        pl.col("iterations").cast(pl.Float64).mean(),
        pl.col("restarts").cast(pl.Float64).mean(),
        pl.col("seconds").cast(pl.Float64).sum(),
    ]
    found = rows.group_by("method").agg(*columns).sort("method").collect(engine="streaming")
    return found.with_columns(pl.col("method").cast(pl.String))


def distribution(rows: pl.LazyFrame) -> pl.DataFrame:
    """Return how many answers of each method have a position error in each step of a logarithmic scale."""
    usable = rows.filter(pl.col("inside") & pl.col("position_error").is_finite())
    step = (pl.col("position_error").clip(lower_bound=EXACT).log10() * BINS_A_DECADE).ceil().cast(pl.Int32)
    found = usable.group_by("method", step=step).agg(pl.len().alias("count")).sort("method", "step")
    upper = pl.lit(10.0).pow(pl.col("step") / BINS_A_DECADE)
    return found.collect(engine="streaming").select(pl.col("method").cast(pl.String), upper.alias("upper"), "count")


def compared_answers(rows: pl.LazyFrame, part: int) -> pl.DataFrame:
    """Return the answers as two runs are compared on them."""
    number, method = pl.col("problem").cast(pl.Int64), pl.col("method").cast(pl.String)
    each = rows.select(method, number, good=solved_at(1e-6), seconds=pl.lit(None, dtype=pl.Float64))
    times = rows.group_by(method, problem=-1 - number // part).agg(seconds=pl.col("seconds").cast(pl.Float64).mean())
    times = times.select("method", "problem", good=pl.lit(None, dtype=pl.Boolean), seconds="seconds")
    return pl.concat([each, times]).collect(engine="streaming")


def solved_by_all(rows: pl.LazyFrame, labels: Sequence[str]) -> dict[str, Flags]:
    """Return which problems each method solved within 1e-6, of those that all of them were given."""
    found = {}
    for label in labels:
        own = rows.filter(pl.col("method") == label).select("problem", good=solved_at(1e-6)).collect(engine="streaming")
        number = own["problem"].to_numpy()
        found[label] = np.full(int(number.max(initial=0)) + 1, -1, dtype=np.int8)  # -1: not given, or not run yet
        found[label][number] = own["good"].to_numpy()
    count = min(map(len, found.values()))
    given = np.logical_and.reduce([x[:count] >= 0 for x in found.values()])
    return {label: x[:count][given] == 1 for label, x in found.items()}


# ---------------------------------------------------------------- work


class AnswersBlock(ProblemBlock):
    """One problem set on one robot, solved by some methods in batches, every answer recorded."""

    noun = "answers"
    measures = MEASURES

    count: Count = key("Number of problems, up to many millions.")
    part: Count = key("Number of problems in one part of the work.", ANSWERS_PART)
    methods: Annotated[tuple[Entry, ...], Entries(Method)] = key("IK methods, which solve in batches.")

    @model_validator(mode="after")
    def _counts_once(self) -> AnswersBlock:
        if "count" in self.options:
            raise InvalidInput("options", "count", "the key `count` of the block in its place")
        return self


@dataclass(frozen=True)
class AnswersWork(Work):
    """One part: some problems of a block by one method, identified by their numbers; a worker samples them."""

    lists = ("numbers",)

    robot: str
    set: str
    options: dict[str, Any]
    seed: int
    method: Entry
    labels: tuple[str, ...]
    numbers: range

    def crashed(self) -> pl.DataFrame:
        """Return rows of problems in which the method crashed its process, raised an error, or did not end."""
        none = {"iterations": 0, "restarts": 0, "seconds": 0.0, "inside": False, "status": "crashed"}
        far = {"position_error": float("inf"), "rotation_error": float("inf"), "distance": float("nan")}
        return self._rows({name: [value] * len(self.numbers) for name, value in (none | far).items()})

    def _rows(self, columns: Mapping[str, Any]) -> pl.DataFrame:
        """Return the rows of this part, in compact types."""
        numbers = pl.Series("problem", self.numbers, dtype=pl.UInt32)
        given = pl.DataFrame({"problem": numbers} | {name: columns[name] for name in ANSWER_TYPES})
        return given.with_columns(pl.col(name).cast(kind) for name, kind in ANSWER_TYPES.items()).with_columns(
            method=pl.lit(self.method.label, dtype=pl.Enum(self.labels)), solved=pl.col("status") == "solved"
        )

    def draw(self, robot: Robot) -> tuple[Array, Array]:
        """Sample the targets and initial guesses of this part."""
        first, last = self.numbers[0] // DRAWN_AT_ONCE, self.numbers[-1] // DRAWN_AT_ONCE
        drawn = [_draw(robot, self.set, self.options, self.seed, number) for number in range(first, last + 1)]
        begin = self.numbers[0] - first * DRAWN_AT_ONCE
        here = slice(begin, begin + len(self.numbers))
        targets, starts = ([getattr(one, name) for one in drawn] for name in ("targets", "starts"))
        return np.ascontiguousarray(np.concatenate(targets)[here]), np.ascontiguousarray(np.concatenate(starts)[here])

    def solve(self) -> pl.DataFrame:
        """Sample the problems, solve them in a batch, and return the verified answers."""
        robot, method, count = load(self.robot), self.method, len(self.numbers)
        targets, starts = self.draw(robot)
        solver = make_solver(robot, method.name, **method.options)
        called = (self.robot, method.name, str(method.options))
        if called not in _warmed:
            solver.solve_batch(targets[:1], starts[:1], threads=1)
            _warmed.add(called)
        begin = time.perf_counter()
        if method.name in own_names("optik.ik"):
            batch = solver.solve_batch(targets, starts, threads=1)
        else:
            batch = self._solve_one_by_one(solver, targets, starts)
        seconds = time.perf_counter() - begin
        inside, position, rotation = judge_configurations(robot, targets, batch.q)
        return self._rows(
            {
                "inside": inside, "position_error": position, "rotation_error": rotation,
                "iterations": batch.iterations, "restarts": batch.restarts,
                "status": np.asarray(STATUSES.categories.to_numpy())[batch.status],
                "distance": np.linalg.norm(robot.fk(starts)[:, :3, 3] - targets[:, :3, 3], axis=1),
                "seconds": np.full(count, seconds / count),
            }
        )  # fmt: skip

    def _solve_one_by_one(self, solver: IKSolver, targets: Array, starts: Array) -> IKBatch:
        """Solve by a method from outside, which may use random numbers: each problem gets its own."""
        batch = IKBatch.empty(len(targets), solver.robot.n)
        for i, (target, start) in enumerate(zip(targets, starts, strict=True)):
            reseed(solver, self.seed, self.numbers[i], self.method.label)
            result = solver.solve(target, start)
            batch.q[i], batch.status[i] = result.q, list(IKStatus).index(result.status)
            batch.iterations[i], batch.restarts[i] = result.iterations, result.restarts
        return batch


_warmed: set[tuple[str, ...]] = set()
"""Methods that this process has called: their first call compiles, and is not timed."""


def _draw(robot: Robot, name: str, options: dict[str, Any], seed: int, number: int) -> ProblemSet:
    """Sample the group of problems with a given number, which has its own random seed."""
    own = trial_seed(seed, number, "problems")
    drawn: ProblemSet = build_method(SETS, name, "problem set", robot, own, **options, count=DRAWN_AT_ONCE)
    return drawn


# ---------------------------------------------------------------- the kind


class _Answers(Kind):
    """Blocks of recorded answers: ``[[answers]]`` of a suite. `rows` returns sums over the answers, one row per method."""

    name = "answers"
    title = "Recorded answers"
    block = AnswersBlock
    order = 15
    alone = False
    compared = (
        Compared("solved within 1e-6", "%", "more", "good"),
        Compared("time of a problem, part by part", "µs", "less", "seconds", 1e6),
    )

    def prepare(self, block: AnswersBlock, seed: int) -> tuple[int, str]:
        robot = load(block.robot)
        for method in block.methods:
            make_solver(robot, method.name, **method.options)
        drawn = _draw(robot, block.set, block.options, seed, 0)
        if len(drawn) != DRAWN_AT_ONCE:
            expected = f"a set with {DRAWN_AT_ONCE} problems at count = {DRAWN_AT_ONCE}"
            raise InvalidInput(f"answers {block.id!r}: set", f"{block.set}, which gave {len(drawn)}", expected)
        return seed, drawn.sha256

    def parts(self, block: AnswersBlock, prepared: tuple[int, str], folder: RunFolder) -> Iterable[Part]:
        """Record the hash of the first problems, or check that of a continued run, and divide the work.

        The workers draw all others when they solve them, each thousand from a seed of its own.
        """
        seed, sha256 = prepared
        record_hash(
            folder, block, {"sha256": sha256, "problems": block.count, "sha256_of": f"the first {DRAWN_AT_ONCE:,}"}
        )
        for index, method in enumerate(block.methods):
            numbers = range(min(block.count, method.most or block.count))
            for part, here in enumerate(chunks(numbers, block.part)):
                work = AnswersWork(block.robot, block.set, block.options, seed, method, block.labels, here)
                yield self.part(block, f"{index:02d}-{slug(method.label)}--{part:06d}", method.label, work)

    def rows(self, folder: RunFolder, block: AnswersBlock) -> pl.DataFrame | None:
        answers = self._answers(folder, block)
        return None if answers is None else summary(answers)

    def rows_to_compare(self, folder: RunFolder, block: AnswersBlock) -> pl.DataFrame | None:
        """Return every answer, and the time of every part."""
        answers = self._answers(folder, block)
        return None if answers is None else compared_answers(answers, block.part)

    def facts(self, folder: RunFolder, block: AnswersBlock) -> dict[str, Any]:
        answers = self._answers(folder, block)
        assert answers is not None
        return {"distribution": distribution(answers), "answers": answers}

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        return rows, f"{rows['count'].sum():,} answers"

    def _answers(self, folder: RunFolder, block: AnswersBlock) -> pl.LazyFrame | None:
        """Return all answers of a block, to be read in pieces."""
        names = folder.part_names(self.name, block.id)
        return folder.scan(names) if names else None


METHOD = _Answers
