"""Single IK calls: every problem is one timed call of every method and peer, in one process, in rounds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import AfterValidator

from benchmarks.blocks.base import BlockRows, Kind, Session, Shard, chunks
from benchmarks.blocks.block import Column, Entry, Target
from benchmarks.blocks.contest import FIELDS, Contestant, Rounds, build_ours, callers_of, clock_cost, timed_part
from benchmarks.blocks.entries import IKPeer, Method, ProblemBlock, check_set, need_problems, shared, store_problems
from benchmarks.records import RunFolder
from benchmarks.settings import LISTED, Count, Entries, check_different, key
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


def _us(statistic: Callable[[Any], Any]) -> Callable[[pl.DataFrame], float]:
    """Return a statistic of the times of calls [µs]."""
    return lambda rows: float(statistic(rows["ns"].to_numpy() / 1e3))


MEASURES = (
    Column("success", "solved", "%", show="exact", of=lambda rows: 100.0 * int(rows["solved"].sum()) / len(rows)),
    Column("median_us", "median time of a call", "µs", of=_us(np.median)),
    Column("mean_us", "mean time of a call", "µs", of=_us(np.mean)),
    Column("p90_us", "90th percentile of a call", "µs", of=_us(lambda us: np.quantile(us, 0.90))),
    Column("p99_us", "99th percentile of a call", "µs", of=_us(lambda us: np.quantile(us, 0.99))),
    Column("max_us", "longest call", "µs", of=_us(np.max)),
    Column("median_ratio", "median time of all calls, as a ratio to", of=median_ratio, relative=True),
)
"""Measures that a target of single calls can name."""


# ---------------------------------------------------------------- settings


def _sorted(counts: tuple[int, ...]) -> tuple[int, ...]:
    check_different([str(count) for count in counts], "", "number")
    return tuple(sorted(counts))


class CallBlock(ProblemBlock):
    """One problem set on one robot, every problem one timed call of every method and peer, in rounds."""

    noun = "calls block"
    measures = MEASURES

    rounds: Count = key("Timed rounds; the time of a problem is their median.", 3)
    methods: Annotated[tuple[Entry, ...], Entries(Method)] = key("Methods of ours; ratios are taken to the first.")
    peers: Annotated[tuple[Entry, ...], Entries(IKPeer)] = key("IK peers.", ())
    evaluation_budgets: Annotated[tuple[Count, ...], LISTED, AfterValidator(_sorted)] = key(
        "Numbers of iterations at which the methods that accept one are also compared.", ()
    )

    @property
    def reference(self) -> str:
        """Label of the reference of ratios: the first method."""
        return self.methods[0].label

    def ending_after(self, budget: int | None) -> CallBlock:
        """Return a block whose methods end after a number of iterations, without restarts."""
        methods, peers = (tuple(e.ending_after(budget) for e in entries) for entries in (self.methods, self.peers))
        return self.model_copy(update={"methods": methods, "peers": peers})


# ---------------------------------------------------------------- reading


def timed_by_first_round(rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows in which a method whose later rounds are far faster than its first is timed by its first round.

    Every round has the same problems, so a method that stores its answers computes in the first only. What counts is the
    median over the problems of the ratio of the first call to the median call: medians of all times would differ as well
    where a few problems move between two groups of times.
    """
    # null: all calls crashed
    ratio = (pl.col("first_ns") / pl.col("ns")).median().over("method").fill_null(float("nan"))
    slower = (ratio > FIRST_ROUND_FROM) & ratio.is_not_nan()
    ns = pl.when(slower).then(pl.col("first_ns").cast(pl.Float64)).otherwise(pl.col("ns"))
    return rows.with_columns(first_round=ratio, ns=ns)


@dataclass(frozen=True)
class CallRows(BlockRows):
    """A block of single calls with its rows; methods without rows are among its entries."""

    @property
    def unreachable(self) -> bool:
        """Whether all problems of the block are proved unsolvable; then there is no winner."""
        return bool(self.rows["unreachable"].all())

    @cached_property
    def evaluations(self) -> pl.DataFrame | None:
        """Answers at equal numbers of iterations; None if none were requested, or they were not run yet."""
        rows = self.folder.rows(self.kind, self.block.id) if self.block.evaluation_budgets else None
        found = None if rows is None else rows.filter(pl.col("budget").is_not_null())
        return None if found is None or found.is_empty() else found

    def why_not(self, label: str) -> tuple[str, str]:
        """Return why an entry has no rows."""
        if label in self.by_method:
            return "", ""
        about = self.entries[label]
        if "absent" in about:
            return str(about.get("outcome", "absent")), str(about["absent"])
        return "not run yet", ""


# ---------------------------------------------------------------- the kind


def _parts(budget: int | None, count: int) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Yield name and problems of the parts of a block, at one number of iterations."""
    for part, here in enumerate(chunks(np.arange(count), CALL_PART)):
        yield f"{part:04d}" if budget is None else f"{budget}-{part:04d}", here


class _Calls(Kind):
    """Blocks of single calls."""

    name = "calls"
    title = "Speed of one call"
    block = CallBlock
    fields = FIELDS
    read_as = CallRows
    has_facts = True
    order = 20

    def prepare(self, block: CallBlock, seed: int) -> None:
        check_set(block)
        for entry in block.methods:
            build_ours(entry, load(block.robot))

    def shards(self, block: CallBlock, session: Session) -> Iterator[Shard]:
        """Yield the timed calls, then those that end after each number of iterations, part by part."""
        folder, budgets = session.folder, (None, *block.evaluation_budgets)
        facts = folder.read_json(self.file(block, "json"))
        names = [name for budget in budgets for name, _ in _parts(budget, facts["count"])] if facts else []
        if names and all(folder.has(self.file(block, "parquet", name)) for name in names):
            return
        session.tell(f"{block.id}: problems")
        robot, problems = block.draw(session.seed)
        store_problems(folder, block, robot, problems, poses=False)
        for budget in budgets:
            lacking = [
                (n, i) for n, i in _parts(budget, len(problems)) if not folder.has(self.file(block, "parquet", n))
            ]
            if not lacking:
                continue
            session.tell(f"{block.id}: building" if budget is None else f"{block.id}: {budget} iterations")
            callers, absent = callers_of(block.ending_after(budget), robot, session.journal)
            if budget is None:
                self._write_facts(folder, block, len(problems), callers, absent)
            for name, here in lacking:
                rounds, kept = block.rounds if budget is None else 1, Rounds(session.journal, name)
                work = partial(
                    timed_part, robot, problems, here, callers, rounds, seed=session.seed, kept=kept, budget=budget
                )
                yield Shard(name, work, f"{block.id}: {here[0]:,} of {len(problems):,}")

    def _write_facts(
        self, folder: RunFolder, block: CallBlock, count: int, callers: list[Contestant], absent: dict[str, Any]
    ) -> None:
        """Write the facts on a block; those of an earlier session are kept for a method that is not built again."""
        file = self.file(block, "json")
        known = (folder.read_json(file) or {"entries": {}})["entries"]
        entries = {c.label: known.get(c.label, c.about) if c.ended else c.about for c in callers} | absent
        folder.write_json(file, {"count": count, "clock_ns": clock_cost(), "entries": entries})

    def complete(self, rows: pl.DataFrame, block: CallBlock) -> pl.DataFrame:
        timed = need_problems(rows, block).filter(pl.col("budget").is_null()).drop("budget")
        return timed_by_first_round(timed).with_columns(any_ns="ns")

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        chosen = shared(rows)
        if target.to:
            return chosen, f"{chosen['problem'].n_unique():,} problems, both"
        lost = len(chosen) - int(chosen["solved"].sum())
        note = f", {lost:,} not solved" if target.measure == "success" else ""
        return chosen, f"{len(chosen):,} calls{note}"


METHOD = _Calls
