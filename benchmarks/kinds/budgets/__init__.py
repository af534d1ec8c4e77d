"""IK problems at iteration budgets: one attempt of every method from one start, looked at after each budget."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds.base import BlockRows, Compared, Kind, Part, Section, Table, Winner
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
    compared = (
        Compared("solved", "%", "more", "solved"),
        Compared("iterations (both solved)", "", "less", "iterations", only="solved"),
    )

    @property
    def parts_folder(self) -> str:
        """Folder of its parts in a run."""
        return "ik"

    def compared_rows(self, block: BudgetBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Rows at the largest budget."""
        last = rows.filter(pl.col("budget") == block.budgets[-1])
        return last.with_columns(label="method", solved=pl.col("status") == "solved")

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

    def winners(self, run: Run) -> Sequence[Winner]:
        from benchmarks.kinds.budgets.report.best import winners

        return winners(run)

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.budgets.report.best import tables

        return tables(run)

    def findings(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.budgets.report.head import findings

        return findings(run)

    def limitations(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.budgets.report.head import limitations

        return limitations(run)


METHOD = _Budgets
