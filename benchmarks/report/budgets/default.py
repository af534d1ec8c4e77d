"""Section: comparison of the default method with the paper's iteration, on the same targets from the same initial guess."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.budgets import SUCCESS_LEVELS, BudgetRows, succeeded
from benchmarks.blocks.entries import ProblemBlock, level_words, shared
from benchmarks.report.base import Run
from benchmarks.report.page import MethodRanking, rank_methods
from benchmarks.report.tables import number, p_value, percent
from benchmarks.statistics import SIGNIFICANT, McNemar, is_too_few, mcnemar
from optik.registry import short_name
from optik.types import Flags

if TYPE_CHECKING:
    pass

PAPER_SOLVER, DEFAULT_SOLVER = "dls", "lm"
"""Names of the paper's iteration and of the default method."""


def comparisons(run: Run) -> list[BudgetRows]:
    """Return the blocks that compare methods; all blocks if each varies the options of one method."""
    blocks: list[BudgetRows] = run.of("budgets")
    return [b for b in blocks if not b.block.is_sweep] or blocks


COMPARED_PROBLEMS = (
    "Targets with a known solution that all ranked methods were given; of a method that was given far fewer, its own."
)
"""The problems of all figures that compare methods."""


def compared_rows(b: BudgetRows) -> tuple[pl.DataFrame, MethodRanking]:
    """Return the rows from which every section takes the figures of a method, and which methods are ranked.

    They are those of the targets with a known solution that all ranked methods were given, and the other methods' own.
    """
    who = rank_methods({label: b.known.filter(pl.col("method") == label)["problem"].n_unique() for label in b.methods})
    others = b.known.filter(~pl.col("method").is_in(who.labels))
    return pl.concat([shared(b.known, who.labels), others]).sort("problem"), who


@dataclass(frozen=True)
class Pair:
    """One block of budgets, and the labels of the methods that it compares.

    They are the paper's iteration, the default method with one attempt, and the default method with default settings. The
    last label is empty if the block does not have this method.
    """

    rows: BudgetRows
    paper: str
    attempt: str
    whole: str

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the compared methods; the first is the paper's iteration."""
        return tuple(label for label in (self.paper, self.attempt, self.whole) if label)

    @cached_property
    def given(self) -> pl.DataFrame:
        """Rows at the largest iteration budget, on the targets that all of these methods were given."""
        rows, _ = compared_rows(self.rows)
        return shared(rows.filter(pl.col("budget") == self.rows.budget), self.labels)

    def solved(self, label: str) -> Flags:
        """Return which problems (k,) of `given` a method solved, in the order of their numbers."""
        part = self.given.filter(pl.col("method") == label)
        found: Flags = part.select(succeeded(SUCCESS_LEVELS[-1]))[:, 0].to_numpy().astype(bool)
        return found

    def against_paper(self, label: str) -> McNemar:
        """Return McNemar's test of a method against the paper's iteration, on the problems of `given`."""
        return mcnemar(self.solved(label), self.solved(self.paper))

    def times(self, run: Run) -> dict[str, float]:
        """Return the median times of solved calls [µs], from a block of single calls with the same problems."""
        for calls in run.of("calls"):
            same = has_same_problems(calls.block, self.rows.block)
            if same and set(self.labels) <= set(calls.rows["method"].unique()):
                rows = shared(calls.rows, self.labels).filter("solved")
                return {label: _median_us(rows.filter(pl.col("method") == label)) for label in self.labels}
        return {}


def has_same_problems(a: ProblemBlock, b: ProblemBlock) -> bool:
    """Return whether two blocks have the same problems."""
    return (a.robot, a.set, a.options) == (b.robot, b.set, b.options)


def _median_us(rows: pl.DataFrame) -> float:
    """Return the median time of calls [µs]; NaN without any."""
    return float(np.median(rows["ns"].to_numpy() / 1e3)) if len(rows) else float("nan")


def pairs(run: Run) -> list[Pair]:
    """Return every block that compares methods and has both the paper's iteration and one attempt of the default method."""
    return [pair for b in comparisons(run) if (pair := _pair(b)) is not None and len(pair.given)]


def _pair(b: BudgetRows) -> Pair | None:
    entries = [m for m in b.block.methods if m.label in b.methods]

    def first(solver: str, whole: bool) -> str:
        return next((m.label for m in entries if short_name(m.name) == solver and m.whole == whole), "")

    paper, attempt = first(PAPER_SOLVER, False), first(DEFAULT_SOLVER, False)
    return Pair(b, paper, attempt, first(DEFAULT_SOLVER, True)) if paper and attempt else None


def default(run: Run) -> dict[str, Any] | None:
    """Answer the question for the first block that has the default method and the paper's iteration."""
    found = pairs(run)
    if not found:
        return None
    first = found[0]
    return {
        "lead": answer(first, run),
        "points": [(pair.rows.block.title, answer(pair, run)) for pair in found[1:]],
        "prose": [
            "The paper's iteration is damped least squares (eq. 11 and 12, corrected) with constant λ and α, clamped to the "
            f"joint limits. {first.attempt} also makes one attempt. {first.whole or 'The default with default settings'} "
            "restarts from other initial guesses until it succeeds. All get the same targets and the same start.",
            f"Solved means both errors within {level_words(SUCCESS_LEVELS[-1])} m and rad inside the joint limits, by optik's "
            "forward kinematics. McNemar's exact test compares the two methods on the problems that only one of them solves; "
            f"below p = {SIGNIFICANT} the difference is significant. Times are those of whole calls from Python, alternating "
            "in one process, on the problems that all of these methods were given there.",
        ],
    }


def answer(pair: Pair, run: Run) -> str:
    """Return sentences on whether one attempt of the default method solves more targets than the paper's iteration."""
    test = pair.against_paper(pair.attempt)
    count = test.both + test.first + test.second + test.neither
    word = f"Too few targets for a test (n = {count})" if is_too_few(count, 1) else "No significant difference"
    if test.p < SIGNIFICANT:
        word = "Yes" if test.first > test.second else "No"
    rates = {label: percent(100.0 * float(pair.solved(label).mean())) for label in pair.labels}
    shown = p_value(test.p)
    text = (
        f"{word}: of {count:,} targets with a known solution, one attempt of the default ({pair.attempt}) solves "
        f"{rates[pair.attempt]}, the paper's iteration ({pair.paper}) {rates[pair.paper]}. {test.first:,} are "
        f"solved by the default only, {test.second:,} by the paper's only "
        f"(McNemar's p {'' if shown.startswith('<') else '= '}{shown})."
    )
    if pair.whole:
        text += (
            f" With default settings, which include restarts, the default ({pair.whole}) solves {rates[pair.whole]}."
        )
    times = pair.times(run)
    if times:
        mine, other = times[pair.attempt], times[pair.paper]
        text += (
            f" The median solved call takes {number(mine)} µs against {number(other)} µs: "
            f"{number(max(mine, other) / min(mine, other), 2)} times {'less' if mine < other else 'more'}."
        )
    return text
