"""IK problems at iteration budgets: one attempt of every method from one start, looked at after each budget."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds.base import BlockRows, Kind, Part, Section
from benchmarks.kinds.budgets.measures import MEASURES
from benchmarks.kinds.budgets.rows import BudgetRows
from benchmarks.kinds.budgets.run import Work, parts, prepare, solve_problems
from benchmarks.kinds.budgets.settings import BudgetBlock, read_block
from benchmarks.problems.base import ProblemSet
from benchmarks.records import RunFolder
from optik.arm.robot import Robot

if TYPE_CHECKING:
    from benchmarks.report.run import Run


class _Budgets(Kind):
    """Blocks of IK problems at iteration budgets: ``[[blocks]]`` of a suite."""

    name = "budgets"
    title = "Methods"
    measures = MEASURES
    order = 10
    alone = False
    on_paper = True

    def settings(self, data: Any) -> BudgetBlock:
        return read_block(data)

    def prepare(self, block: BudgetBlock, seed: int) -> tuple[Robot, ProblemSet, int]:
        return prepare(block, seed)

    def parts(self, block: BudgetBlock, prepared: Any, folder: RunFolder) -> Iterable[Part]:
        return parts(folder, block, *prepared)

    def solve(self, work: Work) -> pl.DataFrame:
        return solve_problems(work)

    def rows(self, folder: RunFolder, block: BudgetBlock) -> pl.DataFrame | None:
        return folder.rows(block.id)

    def read(self, folder: RunFolder, block: BudgetBlock) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else BudgetRows(block, rows, folder, {})

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.budgets.report import SECTIONS

        return SECTIONS

    def subjects(self, blocks: Sequence[Any]) -> Sequence[str]:
        return ("inverse kinematics",)

    def findings(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.budgets.report.head import findings

        return findings(run)

    def limitations(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.budgets.report.head import limitations

        return limitations(run)


METHOD = _Budgets
