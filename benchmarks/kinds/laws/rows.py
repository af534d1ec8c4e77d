"""Rows of a block of timed lines, with T / T* of every motion."""

from __future__ import annotations

from dataclasses import dataclass

import polars as pl

from benchmarks.kinds.base import BlockRows
from benchmarks.kinds.laws.run import example_file
from benchmarks.kinds.laws.settings import LawBlock
from benchmarks.records import RunFolder

ON_THE_LINE = 1e-5
"""Deviation [m, rad] up to which a motion is one along the line: laws stay within 1e-6, joint moves leave it by 1e-2."""


@dataclass(frozen=True)
class LawRows(BlockRows):
    """A block of timed lines, its rows, and the facts on who took part; the reference is none of its entries."""

    def example(self, name: str) -> pl.DataFrame | None:
        """A part of the detailed view.

        Parameters
        ----------
        name : str
            ``motions``, ``binding`` or ``curve``.

        Returns
        -------
        DataFrame or None
            None where it was not run.
        """
        return self.folder.read(example_file(self.block, name))


def read_rows(folder: RunFolder, block: LawBlock) -> pl.DataFrame | None:
    """All rows of a block, with ``optimum`` T* [s] and ``over_optimum`` T / T*.

    T* is the least duration on that line within those limits of the reference and of every motion that keeps all
    limits exactly and stays on the line within `ON_THE_LINE`. ``kept_over_optimum`` is the same ratio after the motion was
    slowed, uniformly, until it keeps them.

    Parameters
    ----------
    folder : RunFolder
        The run.
    block : LawBlock
        The block.

    Returns
    -------
    DataFrame or None
        None where nothing was run.
    """
    rows = folder.parts("timing", block.id)
    if rows is None:
        return None
    solved = (pl.col("status") == "solved").alias("solved")
    keeps = (pl.col("status") == "solved") & (pl.col("breaks") == "")
    stays = (pl.col("distance") <= ON_THE_LINE) & (pl.col("angle") <= ON_THE_LINE)
    counts = (keeps & stays) | ((pl.col("entry") == "reference") & (pl.col("status") == "solved"))
    optimum = pl.when(counts).then(pl.col("duration")).min().over("line", "limits")
    return (
        rows.with_columns(solved, keeps_all=keeps, optimum=optimum)
        .with_columns(
            over_optimum=pl.col("duration") / pl.col("optimum"),
            kept_over_optimum=pl.max_horizontal("duration", "least_duration") / pl.col("optimum"),
        )
        .sort("line", "limits", maintain_order=True)
    )
