"""Single IK calls: every problem is one timed call of every method and peer, in one process, in rounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
import polars as pl
from pydantic import AfterValidator

from benchmarks.blocks._contest import clock_cost, read_facts
from benchmarks.blocks._entries import IKPeer, Method
from benchmarks.blocks._problems import ProblemBlock, check_set, store_problems
from benchmarks.blocks.base import BlockRows, Compared, Entry, Kind, Tell
from benchmarks.blocks.ik.callers import build_ours, callers_of
from benchmarks.blocks.ik.judgement import JUDGED_AT, level_name, shared, solved_at
from benchmarks.blocks.ik.rounds import Rounds, timed_part
from benchmarks.problems.base import problem_set
from benchmarks.records import JOURNAL, Journal, RunFolder, slug
from benchmarks.settings import LISTED, Count, Entries, check_different, key
from benchmarks.statistics import shifted_geometric_mean
from benchmarks.targets import Measure, Target, measure_named
from optik.arm.library import load

CALL_PART = 2000
"""Number of problems in one part: each method takes them in a row, so a longer disturbance affects all methods equally."""

SHIFT_US = 10.0
"""Shift of the shifted geometric mean of times [µs]: differences far below it do not decide the mean."""

FIRST_ROUND_FROM = 3.0
"""Ratio of the first call of a problem to the median call, from which a method is timed by its first round."""

# ---------------------------------------------------------------- measures


def median_ratio(rows: pl.DataFrame, method: str, to: str) -> float:
    """Return the median time of all calls of one method over that of another, on the problems that both were given.

    A target asks for it; tables show the ratio on the problems that both solved (`ratio_where_solved`).
    """
    both = shared(rows, (method, to))
    mine, other = (both.filter(pl.col("method") == label)["ns"].to_numpy() for label in (method, to))
    return float(np.median(mine) / np.median(other)) if len(mine) and len(other) else float("nan")


def ratio_where_solved(rows: pl.DataFrame, method: str, to: str) -> float:
    """Return the median time of one method over that of another, on the problems that both were given and both solved."""
    return median_ratio(rows.filter("solved"), method, to)


def _solved_at(tolerance: float) -> Callable[[pl.DataFrame], float]:
    """Return the percentage solved at a tolerance; failures and missing answers count among the problems."""
    return lambda rows: 100.0 * int(rows.select(solved_at(tolerance).sum()).item()) / len(rows)


def _us(statistic: Callable[[Any], Any]) -> Callable[[pl.DataFrame], float]:
    """Return a statistic of the times of calls [µs]."""
    return lambda rows: float(statistic(rows["ns"].to_numpy() / 1e3))


MEASURES = (
    Measure("success", "%", lambda rows: 100.0 * int(rows["solved"].sum()) / len(rows), "solved", show="exact"),
    *(
        Measure(
            f"success_{level_name(at)}", "%", _solved_at(at), f"solved within {level_name(at)} m and rad", show="exact"
        )
        for at in JUDGED_AT
    ),
    Measure("median_us", "µs", _us(np.median), "median time of a call"),
    Measure("mean_us", "µs", _us(np.mean), "mean time of a call"),
    Measure("p90_us", "µs", _us(lambda us: np.quantile(us, 0.90)), "90th percentile of a call"),
    Measure("p99_us", "µs", _us(lambda us: np.quantile(us, 0.99)), "99th percentile of a call"),
    Measure(
        "sgm_us", "µs", _us(lambda us: shifted_geometric_mean(us, SHIFT_US)), "shifted geometric mean time of a call"
    ),
    Measure("max_us", "µs", _us(np.max), "longest call"),
    Measure("median_ratio", "", median_ratio, "median time of all calls, as a ratio to", relative=True),
)
"""Measures that a target of single calls can name."""


def judge(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Return the value of a target on the rows of a block, and from how many calls."""
    measure = measure_named(MEASURES, target.measure, "measure")
    wanted = (target.method, target.to) if target.to else (target.method,)
    for label in wanted:
        if rows is None or rows.filter(pl.col("method") == label).is_empty():
            return float("nan"), f"{label} was not run"
    assert rows is not None
    chosen = shared(rows, wanted)
    if measure.relative:
        count = chosen["problem"].n_unique()
        return float(measure.compute(chosen, *wanted)), f"{count:,} problems, both"
    note = f"{len(chosen):,} calls"
    if target.measure == "success":
        note += f", {len(chosen) - int(chosen['solved'].sum()):,} not solved"
    return measure.values(chosen)[0], note


# ---------------------------------------------------------------- settings


def _sorted(counts: tuple[int, ...]) -> tuple[int, ...]:
    check_different([str(count) for count in counts], "", "number")
    return tuple(sorted(counts))


class CallBlock(ProblemBlock):
    """One problem set on one robot, every problem one timed call of every method and peer, in rounds."""

    noun = "speed block"
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    rounds: Count = key("Timed rounds; the time of a problem is their median.", 3)
    methods: Annotated[tuple[Entry, ...], Entries(Method)] = key("Methods of ours; ratios are taken to the first.")
    peers: Annotated[tuple[Entry, ...], Entries(IKPeer)] = key("Methods of other packages.", ())
    evaluation_budgets: Annotated[tuple[Count, ...], LISTED, AfterValidator(_sorted)] = key(
        "Numbers of iterations at which the methods that accept one are also compared.", ()
    )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods, then the peers."""
        return (*self.methods, *self.peers)

    @property
    def reference(self) -> str:
        """Label of the reference of ratios: the first method."""
        return self.methods[0].label

    def ending_after(self, budget: int) -> CallBlock:
        """Return a block whose methods end after a number of iterations, without restarts."""
        ours = (replace(e, options=e.options | {"max_iterations": budget, "max_restarts": 0}) for e in self.methods)
        theirs = (replace(e, options=e.options | {"iterations": budget}) for e in self.peers)
        return self.model_copy(update={"methods": tuple(ours), "peers": tuple(theirs)})


# ---------------------------------------------------------------- work


def facts_file(block: CallBlock) -> str:
    """Name of the file of facts on a block."""
    return f"speed/{slug(block.id)}.json"


def _evaluations_file(block: CallBlock) -> str:
    """Return the name of the file of answers at equal numbers of iterations."""
    return f"speed/{slug(block.id)}.iterations.parquet"


def _part_files(block: CallBlock, count: int) -> list[str]:
    """Return the names of all parts of a block."""
    return [f"speed/{slug(block.id)}--{part:04d}.parquet" for part in range(-(-count // CALL_PART))]


def _run_calls(block: CallBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal) -> None:
    """Run the unfinished work of a block."""
    before = folder.read_json(facts_file(block)) or {"count": None, "entries": {}}
    count = before["count"]
    if count is not None and all(folder.has(part) for part in _part_files(block, count)):
        return
    tell(f"{block.id}: problems")
    robot, problems = problem_set(block, seed)
    store_problems(folder, block, robot, problems, poses=False)
    tell(f"{block.id}: building")
    callers, absent = callers_of(block, robot, journal)
    known = before["entries"]  # of a method that is not built again
    entries = {c.label: known.get(c.label, c.about) if c.ended else c.about for c in callers} | absent
    folder.write_json(facts_file(block), {"count": len(problems), "clock_ns": clock_cost(), "entries": entries})
    for part, file in enumerate(_part_files(block, len(problems))):
        if not folder.has(file):
            tell(f"{block.id}: {part * CALL_PART:,} of {len(problems):,}")
            here = np.arange(part * CALL_PART, min((part + 1) * CALL_PART, len(problems)))
            kept = Rounds(journal, f"{part:04d}")
            folder.write(file, timed_part(robot, problems, here, callers, block.rounds, seed=seed, kept=kept))


def _run_evaluations(block: CallBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal) -> None:
    """Answer every problem by one attempt with each iteration limit, unless that is done or not requested."""
    if not block.evaluation_budgets or folder.has(_evaluations_file(block)):
        return
    robot, problems = problem_set(block, seed)
    frames = []
    for budget in block.evaluation_budgets:
        tell(f"{block.id}: {budget} iterations")
        callers, _ = callers_of(block.ending_after(budget), robot, journal)
        for first in range(0, len(problems), CALL_PART):
            here = np.arange(first, min(first + CALL_PART, len(problems)))
            kept = Rounds(journal, f"{budget}-{first // CALL_PART:04d}")
            rows = timed_part(robot, problems, here, callers, 1, seed=seed, kept=kept)
            frames.append(rows.with_columns(budget=pl.lit(budget)))
    folder.write(_evaluations_file(block), pl.concat(frames))


# ---------------------------------------------------------------- reading


def read_rows(folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
    """Return all rows of a block with the columns of each problem: group, singular value, whether a solution is known."""
    problems = folder.read(f"problems/{slug(block.id)}.parquet")
    rows = folder.parts("speed", block.id)
    if problems is None or rows is None:
        return None
    facts = ("problem", "group", "sigma", "known", "unreachable")  # the last is missing in runs of older versions
    return rows.join(problems.select(name for name in facts if name in problems.columns), on="problem").sort(
        "method_index", "problem"
    )


def timed_by_first_round(rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows in which a method whose later rounds are far faster than its first is timed by its first round.

    Every round has the same problems, so a method that stores its answers computes in the first only. What counts is the
    median over the problems of the ratio of the first call to the median call: medians of all times would differ as well
    where a few problems move between two groups of times.
    """
    if "first_ns" not in rows.columns:
        return rows
    ratio = (
        (pl.col("first_ns") / pl.col("ns")).median().over("method").fill_null(float("nan"))
    )  # null: all calls crashed
    slower = (ratio > FIRST_ROUND_FROM) & ratio.is_not_nan()
    ns = pl.when(slower).then(pl.col("first_ns").cast(pl.Float64)).otherwise(pl.col("ns"))
    return rows.with_columns(first_round=ratio, ns=ns)


@dataclass(frozen=True)
class CallRows(BlockRows):
    """A block of single calls with its rows; methods without rows are among its entries."""

    @cached_property
    def by_method(self) -> dict[str, pl.DataFrame]:
        """Rows of every method that has some, in the order of the suite."""
        parts = {str(label): part for (label,), part in self.rows.partition_by("method", as_dict=True).items()}
        return {label: parts[label] for label in self.entries if label in parts}

    @property
    def unreachable(self) -> bool:
        """Whether all problems of the block are proved unsolvable; then there is no winner."""
        return "unreachable" in self.rows.columns and bool(self.rows["unreachable"].all())

    @cached_property
    def evaluations(self) -> pl.DataFrame | None:
        """Answers at equal numbers of iterations; None if none were requested, or they were not run yet."""
        return self.folder.read(_evaluations_file(self.block)) if self.block.evaluation_budgets else None

    def why_not(self, label: str) -> tuple[str, str]:
        """Return why an entry has no rows."""
        if label in self.by_method:
            return "", ""
        about = self.entries[label]
        if "refused" in about:
            return "refused", str(about["refused"])
        if "absent" in about:
            return str(about.get("outcome", "absent")), str(about["absent"])
        return "not run yet", ""


# ---------------------------------------------------------------- the kind


class _Calls(Kind):
    """Blocks of single calls: ``[[speed]]`` of a suite."""

    name = "calls"
    title = "Speed of one call"
    block = CallBlock
    measures = MEASURES
    order = 20
    compared = (
        Compared("solved", "%", "more", "solved"),
        Compared("time (both solved)", "µs", "less", "ns", 1e-3, "solved", ("least_ns", "most_ns")),
        Compared("time of any call", "µs", "less", "ns", 1e-3, "", ("least_ns", "most_ns")),
    )

    def prepare(self, block: CallBlock, seed: int) -> None:
        check_set(block)
        for entry in block.methods:
            build_ours(entry, load(block.robot))

    def run(self, block: CallBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
        with Journal(folder, self.file(block, JOURNAL)) as journal:
            _run_calls(block, seed, folder, tell, journal)
            _run_evaluations(block, seed, folder, tell, journal)

    def rows(self, folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
        rows = read_rows(folder, block)
        return None if rows is None else timed_by_first_round(rows)

    def read(self, folder: RunFolder, block: CallBlock) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else CallRows(block, rows, folder, read_facts(folder, facts_file(block), block.id))

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        return judge(rows, target)


METHOD = _Calls
