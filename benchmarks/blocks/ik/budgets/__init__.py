"""IK problems at iteration budgets: one attempt of every method from one start, looked at after each budget."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows, Compared, Kind, Part
from benchmarks.blocks.ik.budgets.measures import MEASURES
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.blocks.ik.budgets.run import Work, parts, prepare, solve_problems
from benchmarks.blocks.ik.budgets.settings import BudgetBlock
from benchmarks.problems.base import ProblemSet
from benchmarks.records import RunFolder
from optik.arm.robot import Robot


class _Budgets(Kind):
    """Blocks of IK problems at iteration budgets: ``[[blocks]]`` of a suite."""

    name = "budgets"
    title = "Methods"
    block = BudgetBlock
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


METHOD = _Budgets
