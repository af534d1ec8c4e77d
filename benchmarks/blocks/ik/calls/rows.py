"""A block of single calls as the report reads it: rows by method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.ik.calls.evaluations import read_evaluations


@dataclass(frozen=True)
class CallRows(BlockRows):
    """A block of single calls with its rows; the methods that have none are among its entries."""

    @cached_property
    def by_method(self) -> dict[str, pl.DataFrame]:
        """Rows of every method that has some, in the order of the suite."""
        parts = {str(key[0]): part for key, part in self.rows.partition_by("method", as_dict=True).items()}
        return {label: parts[label] for label in self.entries if label in parts}

    @property
    def unreachable(self) -> bool:
        """Whether it is proved that no problem of the block has a solution: then nobody can win by solving."""
        return "unreachable" in self.rows.columns and bool(self.rows["unreachable"].all())

    @cached_property
    def evaluations(self) -> pl.DataFrame | None:
        """Answers at equal numbers of iterations; None where none were asked for, or they were not run yet."""
        return read_evaluations(self.folder, self.block)

    def why_not(self, label: str) -> tuple[str, str]:
        """Why an entry has no rows."""
        if label in self.by_method:
            return "", ""
        about = self.entries[label]
        if "refused" in about:
            return "refused", str(about["refused"])
        if "absent" in about:
            return str(about.get("outcome", "absent")), str(about["absent"])
        return "not run yet", ""
