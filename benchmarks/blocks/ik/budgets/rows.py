"""Rows of a block with iteration budgets, as the report reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.ik.budgets.measures import paired


@dataclass(frozen=True)
class BudgetRows(BlockRows):
    """A block with iteration budgets, and its rows."""

    @property
    def sweep(self) -> bool:
        """Whether it varies the options of one method instead of comparing methods."""
        return bool(self.block.sweep)

    @cached_property
    def methods(self) -> list[str]:
        """Labels of the methods that have rows, in the suite's order."""
        return self.rows["method"].unique(maintain_order=True).to_list()

    @cached_property
    def whole(self) -> list[str]:
        """Labels of the methods that are called as they come, without a budget."""
        found = {m.label for m in self.block.methods if m.whole}
        return [label for label in self.methods if label in found]

    @cached_property
    def budgeted(self) -> list[str]:
        """Labels of the methods that make one attempt, looked at after every budget."""
        return [label for label in self.methods if label not in self.whole]

    @cached_property
    def budget(self) -> int:
        """The largest budget."""
        return int(self.block.budgets[-1])

    @cached_property
    def last(self) -> pl.DataFrame:
        """Rows at the largest budget."""
        return self.rows.filter(pl.col("budget") == self.budget)

    @cached_property
    def paired(self) -> pl.DataFrame:
        """Rows of the problems that every method was run on."""
        return paired(self.rows)

    @cached_property
    def known(self) -> pl.DataFrame:
        """Rows of the problems with a known solution."""
        return self.rows.filter("known")

    def given(self, labels: Sequence[str]) -> pl.DataFrame:
        """Rows at the largest budget of some methods, on the problems with a known solution that all of them were given."""
        return paired(self.last.filter(pl.col("method").is_in(labels) & pl.col("known"))).sort("problem")

    def problems(self) -> tuple[int, int]:
        """How many problems, and how many of them have a known solution."""
        first = self.rows.unique("problem")
        return len(first), int(first["known"].sum())
