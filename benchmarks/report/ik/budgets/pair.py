"""The paper's iteration and the default side by side: their rows on the same problems, and their times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl

from benchmarks.blocks.ik.budgets.measures import SUCCESS_LEVELS, succeeded
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.blocks.ik.calls.measures import shared
from benchmarks.report.ik.budgets.look import comparisons
from benchmarks.report.run import Run
from benchmarks.statistics import McNemar, mcnemar
from optik.registry import short_name
from optik.types import Flags

PAPER_SOLVER, DEFAULT_SOLVER = "dls", "lm"
"""Names of the paper's iteration and of the method that is used where none is named."""


@dataclass(frozen=True)
class Pair:
    """The paper's iteration and the default on one block.

    Attributes
    ----------
    rows : BudgetRows
        The block.
    paper : str
        Label of the paper's iteration: the first `dls` of the block.
    attempt : str
        Label of the default with one attempt, as the paper's iteration has it.
    whole : str
        Label of the default as it comes, with restarts; empty where the block does not have it.
    """

    rows: BudgetRows
    paper: str
    attempt: str
    whole: str

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels, the paper's first."""
        return tuple(label for label in (self.paper, self.attempt, self.whole) if label)

    @cached_property
    def given(self) -> pl.DataFrame:
        """Rows at the largest budget on the problems with a known solution that all of them were given."""
        return self.rows.given(self.labels)

    def solved(self, label: str) -> Flags:
        """Which of these problems (k,) a method solved, in the order of their numbers."""
        part = self.given.filter(pl.col("method") == label)
        found: Flags = part.select(succeeded(SUCCESS_LEVELS[-1]))[:, 0].to_numpy().astype(bool)
        return found

    def against_paper(self, label: str) -> McNemar:
        """Which of the problems a method and the paper's iteration solved, and McNemar's test."""
        return mcnemar(self.solved(label), self.solved(self.paper))

    def times(self, run: Run) -> dict[str, tuple[float, float]]:
        """Median time of a solved and of an unsolved call, on the problems that all were given in a block of single calls."""
        mine = self.rows.block
        for calls in run.of("calls"):
            other = calls.block
            same = (other.robot, other.set, other.options) == (mine.robot, mine.set, mine.options)
            if same and set(self.labels) <= set(calls.rows["method"].unique()):
                rows = shared(calls.rows, self.labels)
                return {label: _medians(rows.filter(pl.col("method") == label)) for label in self.labels}
        return {}


def _medians(rows: pl.DataFrame) -> tuple[float, float]:
    """Median time of the solved and of the others [µs]."""
    solved, failed = (rows.filter(pl.col("solved") == ok)["ns"].to_numpy() / 1e3 for ok in (True, False))
    return (
        float(np.median(solved)) if len(solved) else float("nan"),
        float(np.median(failed)) if len(failed) else float("nan"),
    )


def pairs(run: Run) -> list[Pair]:
    """Every block that compares methods and has both the paper's iteration and one attempt of the default."""
    return [pair for b in comparisons(run) if (pair := _pair(b)) is not None and len(pair.given)]


def _pair(b: BudgetRows) -> Pair | None:
    entries = [m for m in b.block.methods if m.label in b.methods]

    def first(solver: str, whole: bool) -> str:
        return next((m.label for m in entries if short_name(m.name) == solver and m.whole == whole), "")

    paper, attempt = first(PAPER_SOLVER, False), first(DEFAULT_SOLVER, False)
    return Pair(b, paper, attempt, first(DEFAULT_SOLVER, True)) if paper and attempt else None
