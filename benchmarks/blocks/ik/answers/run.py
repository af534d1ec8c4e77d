"""Draw and solve the problems of one part, and judge every answer by our own forward kinematics."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks._problems import about_file, check_same
from benchmarks.blocks._seeds import reseed, trial_seed
from benchmarks.blocks.base import Entry, Part
from benchmarks.blocks.ik.answers.settings import DRAWN_AT_ONCE, AnswersBlock
from benchmarks.problems.base import SETS, ProblemSet
from benchmarks.records import RunFolder, slug
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import IKBatch, IKSolver, IKStatus, make_solver
from optik.registry import build_method, own_names
from optik.types import Array

STATUSES = pl.Enum([*map(str, IKStatus), "crashed"])
"""How an answer came about: the statuses of our methods, and ``crashed`` where a process died or raised an error."""


ANSWER_TYPES: Mapping[str, Any] = {
    "inside": pl.Boolean, "position_error": pl.Float32, "rotation_error": pl.Float32, "iterations": pl.UInt32,
    "restarts": pl.UInt16, "status": STATUSES, "distance": pl.Float32, "seconds": pl.Float32,
}  # fmt: skip
"""Columns of the rows: errors [m, rad] by our forward kinematics, distance of start and target [m], time a problem [s]."""


@dataclass(frozen=True)
class AnswersWork:
    """One part: some problems of a block by one method, named by their numbers; a worker draws them.

    Attributes
    ----------
    robot, set : str
        Names of the arm and of the problem set.
    options : dict
        Of the problem set.
    seed : int
        Of the suite.
    method : Entry
        The method.
    labels : tuple of str
        Of all methods of the block.
    first, count : int
        The problems.
    """

    robot: str
    set: str
    options: dict[str, Any]
    seed: int
    method: Entry
    labels: tuple[str, ...]
    first: int
    count: int

    def halves(self) -> tuple[AnswersWork, ...]:
        """Itself in two, to find the problem that kills a process; nothing where there is one problem."""
        half = self.count // 2
        return () if half == 0 else (
            replace(self, count=half), replace(self, first=self.first + half, count=self.count - half)
        )  # fmt: skip

    def crashed(self) -> pl.DataFrame:
        """Rows of problems in which the method crashed its process, raised an error, or found no end."""
        none = {"iterations": 0, "restarts": 0, "seconds": 0.0, "inside": False, "status": "crashed"}
        far = {"position_error": float("inf"), "rotation_error": float("inf"), "distance": float("nan")}
        return self.rows({key: [value] * self.count for key, value in (none | far).items()})

    def rows(self, columns: Mapping[str, Any]) -> pl.DataFrame:
        """Rows of this part, in types that take little room."""
        numbers = pl.Series("problem", range(self.first, self.first + self.count), dtype=pl.UInt32)
        given = pl.DataFrame({"problem": numbers} | {key: columns[key] for key in ANSWER_TYPES})
        return given.with_columns(pl.col(key).cast(kind) for key, kind in ANSWER_TYPES.items()).with_columns(
            method=pl.lit(self.method.label, dtype=pl.Enum(self.labels)), solved=pl.col("status") == "solved"
        )


def check(block: AnswersBlock, seed: int) -> str:
    """Check the options of every method and of the set, by drawing problems."""
    robot = load(block.robot)
    for method in block.methods:
        make_solver(robot, method.name, **method.options)
    drawn = _drawn(robot, block.set, block.options, seed, 0)
    if len(drawn) != DRAWN_AT_ONCE:
        expected = f"a set of which {DRAWN_AT_ONCE} problems can be drawn at a time"
        raise InvalidInput(f"answers {block.id!r}: set", f"{block.set}, which gave {len(drawn)}", expected)
    return drawn.sha256


def store_hash(folder: RunFolder, block: AnswersBlock, sha256: str) -> None:
    """Record the hash of the first problems, or check that those of a continued run are the same.

    The workers draw all others when they solve them, each thousand from a seed of its own.
    """
    before = folder.read_json(about_file(block))
    check_same(block, None if before is None else str(before.get("sha256")), sha256)
    if before is None:
        about = {"sha256": sha256, "problems": block.count, "sha256_of": f"the first {DRAWN_AT_ONCE:,}"}
        folder.write_json(about_file(block), about)


def parts(block: AnswersBlock, seed: int, top: str) -> Iterator[Part]:
    """Divide the work."""
    for index, method in enumerate(block.methods):
        all_of_them = min(block.count, method.most or block.count)
        for part, first in enumerate(range(0, all_of_them, block.part)):
            count = min(block.part, all_of_them - first)
            work = AnswersWork(
                block.robot, block.set, block.options, seed, method, block.labels, first, count
            )  # fmt: skip
            file = f"{top}/{slug(block.id)}--{index:02d}-{slug(method.label)}--{part:06d}.parquet"
            yield Part(file, method.label, work)


def solve(work: AnswersWork) -> pl.DataFrame:
    """Draw, solve and judge the problems of one part."""
    robot, method = load(work.robot), work.method
    targets, starts = _problems(robot, work)
    solver = make_solver(robot, method.name, **method.options)
    _warm(work.robot, method.name, str(method.options), lambda: solver.solve_batch(targets[:1], starts[:1], threads=1))
    begin = time.perf_counter()
    if method.name in own_names("optik.ik"):
        batch = solver.solve_batch(targets, starts, threads=1)
    else:
        batch = _one_by_one(solver, work, targets, starts)
    seconds = time.perf_counter() - begin
    e = robot.pose_errors(batch.q, targets)
    return work.rows(
        {
            "inside": robot.limits.contains(batch.q),
            "position_error": np.linalg.norm(e[:, :3], axis=1),
            "rotation_error": np.linalg.norm(e[:, 3:], axis=1),
            "iterations": batch.iterations,
            "restarts": batch.restarts,
            "status": np.asarray(STATUSES.categories.to_numpy())[batch.status],
            "distance": np.linalg.norm(robot.fk(starts)[:, :3, 3] - targets[:, :3, 3], axis=1),
            "seconds": np.full(work.count, seconds / work.count),
        }
    )


def _one_by_one(solver: IKSolver, work: AnswersWork, targets: Array, starts: Array) -> IKBatch:
    """Answers of a method from outside, which may use random numbers: each problem gets its own."""
    batch = IKBatch.empty(len(targets), solver.robot.n)
    for i, (target, start) in enumerate(zip(targets, starts, strict=True)):
        reseed(solver, work.seed, work.first + i, work.method.label)
        result = solver.solve(target, start)
        batch.q[i], batch.status[i] = result.q, list(IKStatus).index(result.status)
        batch.iterations[i], batch.restarts[i] = result.iterations, result.restarts
    return batch


_warmed: set[tuple[str, ...]] = set()
"""Methods that this process has called: their first call compiles, and is not timed."""


def _warm(robot: str, method: str, options: str, call: Any) -> None:
    key = (robot, method, options)
    if key not in _warmed:
        call()
        _warmed.add(key)


def _problems(robot: Robot, work: AnswersWork) -> tuple[Array, Array]:
    """Targets and starts of a part."""
    last = work.first + work.count
    draws = range(work.first // DRAWN_AT_ONCE, (last - 1) // DRAWN_AT_ONCE + 1)
    drawn = [_drawn(robot, work.set, work.options, work.seed, number) for number in draws]
    here = slice(work.first - draws[0] * DRAWN_AT_ONCE, last - draws[0] * DRAWN_AT_ONCE)
    targets, starts = ([getattr(one, name) for one in drawn] for name in ("targets", "starts"))
    return np.ascontiguousarray(np.concatenate(targets)[here]), np.ascontiguousarray(np.concatenate(starts)[here])


def _drawn(robot: Robot, name: str, options: dict[str, Any], seed: int, number: int) -> ProblemSet:
    """The problems of one draw."""
    own = trial_seed(seed, number, "problems")
    drawn: ProblemSet = build_method(SETS, name, "problem set", robot, own, **options, count=DRAWN_AT_ONCE)
    return drawn
