"""Targets of speed and of timing: what was measured, held against what was asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.batch import batch_rows
from benchmarks.first_use import first_use_rows
from benchmarks.records import RunFolder
from benchmarks.settings import Target
from benchmarks.speed import shared, speed_rows
from benchmarks.speed_suite import BatchBlock, FirstUse, SpeedBlock
from benchmarks.suite import Suite
from benchmarks.timing_rows import measure_timing, timing_rows
from benchmarks.timing_suite import TIMING_MEASURES, TimingBlock
from optik.types import Array

WORDS = {
    "success": ("solved", "%"),
    "median_us": ("median time of a call", "µs"),
    "mean_us": ("mean time of a call", "µs"),
    "p90_us": ("90th percentile of a call", "µs"),
    "p99_us": ("99th percentile of a call", "µs"),
    "max_us": ("longest call", "µs"),
    "median_ratio": ("median time over that of", ""),
    "million_per_second": ("solved a second", "million"),
    "extra_memory_mb": ("memory beyond inputs and outputs", "MB"),
    "import_s": ("import optik", "s"),
    "first_solve_s": ("first solve after import, compiled before", "s"),
    "compile_s": ("first solve after import, nothing compiled", "s"),
    **TIMING_MEASURES,
}
"""What each measure is called, and its unit."""

_TIMES: dict[str, Callable[[Array], Any]] = {
    "median_us": np.median,
    "mean_us": np.mean,
    "p90_us": lambda us: np.quantile(us, 0.90),
    "p99_us": lambda us: np.quantile(us, 0.99),
    "max_us": np.max,
}


@dataclass(frozen=True)
class Outcome:
    """One target and what came of it.

    Attributes
    ----------
    block, where : str
        Id and title of the block.
    target : Target
        What was asked.
    value : float
        What was measured, NaN where it was not.
    note : str
        On what: how many problems, threads or processes; why not, where it was not measured.
    """

    block: str
    where: str
    target: Target
    value: float
    note: str

    @property
    def held(self) -> bool | None:
        """Whether the bound is kept; None where nothing was measured."""
        if np.isnan(self.value):
            return None
        if self.target.at_most is not None:
            return self.value <= self.target.at_most
        assert self.target.at_least is not None
        return self.value >= self.target.at_least

    @property
    def asked(self) -> str:
        """The bound: ≤ 8 or ≥ 99.99."""
        bound = self.target.at_most if self.target.at_most is not None else self.target.at_least
        return f"{'≤' if self.target.at_most is not None else '≥'} {bound:g}"

    @property
    def what(self) -> str:
        """The measure in words, of whom, with its unit apart."""
        words = WORDS[self.target.measure][0]
        of = f"{self.target.method}: " if self.target.method else ""
        group = f", {self.target.group.replace('_', '-')}" if self.target.group else ""
        return f"{of}{words}{' ' + self.target.to if self.target.to else ''}{group}"

    @property
    def unit(self) -> str:
        """Of the value and of the bound."""
        return WORDS[self.target.measure][1]


def outcomes(suite: Suite, folder: RunFolder) -> list[Outcome]:
    """Every target of a suite, in its order."""
    timing = [o for block in suite.timing for o in timing_outcomes(block, folder)]
    return speed_outcomes(suite, folder) + timing


def speed_outcomes(suite: Suite, folder: RunFolder) -> list[Outcome]:
    """Every target of single calls, batches and first use."""
    found = [o for block in suite.speed for o in _calls(block, folder)]
    found += [o for batch in suite.batch for o in _batch(batch, folder)]
    return found + (_first(suite.first_use, folder) if suite.first_use is not None else [])


def timing_outcomes(block: TimingBlock, folder: RunFolder) -> list[Outcome]:
    """Every target of a block of timed lines."""
    rows = timing_rows(folder, block)
    return [Outcome(block.id, block.title, target, *measure_timing(rows, target)) for target in block.targets]


def _calls(block: SpeedBlock, folder: RunFolder) -> list[Outcome]:
    rows = speed_rows(folder, block)
    return [Outcome(block.id, block.title, target, *measure_calls(rows, target)) for target in block.targets]


def measure_calls(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Value of a target on the rows of a block, and how many problems it stands on.

    A ratio is of the medians on the problems that both were given.
    """
    wanted = (target.method, target.to) if target.to else (target.method,)
    for label in wanted:
        if rows is None or rows.filter(pl.col("method") == label).is_empty():
            return float("nan"), f"{label} was not run"
    assert rows is not None
    chosen = shared(rows, wanted)
    own = chosen.filter(pl.col("method") == target.method)
    note = f"{len(own):,} calls" if not target.to else f"{len(own):,} problems, both"
    if target.measure == "success":
        failed = len(own) - int(own["solved"].sum())
        return 100.0 * (len(own) - failed) / len(own), f"{note}, {failed:,} not solved"
    if target.measure == "median_ratio":
        return median_ratio(chosen, target.method, target.to), note
    return float(_TIMES[target.measure](own["ns"].to_numpy() / 1e3)), note


def median_ratio(rows: pl.DataFrame, method: str, to: str) -> float:
    """Median time of one over median time of another, on the problems that both were given; NaN where there are none."""
    both = shared(rows, (method, to))
    mine, other = (both.filter(pl.col("method") == label)["ns"].to_numpy() for label in (method, to))
    return float(np.median(mine) / np.median(other)) if len(mine) and len(other) else float("nan")


def _batch(block: BatchBlock, folder: RunFolder) -> list[Outcome]:
    rows = batch_rows(folder, block)
    return [Outcome(block.id, block.title, target, *measure_batch(rows, target)) for target in block.targets]


def measure_batch(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Value of a target at the largest number of threads: the median of the repeats, of memory the largest."""
    if rows is None or rows.is_empty():
        return float("nan"), "it was not run"
    most = rows.filter(pl.col("threads") == pl.col("threads").max())
    solved, count, seconds = (most[column].to_numpy() for column in ("solved", "count", "seconds"))
    note = f"{most['count'][0]:,} problems, {most['threads'][0]} threads, {len(most)} times"
    if target.measure == "success":
        return 100.0 * float(np.min(solved / count)), note
    if target.measure == "million_per_second":
        return 1e-6 * float(np.median(solved / seconds)), note
    extra = most["extra_memory_mb"].cast(pl.Float64).drop_nulls().to_numpy()
    return (float(extra.max()), note) if len(extra) else (float("nan"), "the system does not say")


def _first(task: FirstUse, folder: RunFolder) -> list[Outcome]:
    rows = first_use_rows(folder)
    where = f"First use in a fresh process ({task.solver}, {task.robot})"
    found = []
    for target in task.targets:
        seconds = (rows or {}).get(target.measure, [])
        note = f"{len(seconds)} process{'es' if len(seconds) != 1 else ''}" if seconds else "it was not run"
        found.append(Outcome("first-use", where, target, float(np.median(seconds)) if seconds else float("nan"), note))
    return found
