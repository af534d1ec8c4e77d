"""Rows of a block of timed lines, with T / T* of every motion."""

from __future__ import annotations

from dataclasses import dataclass

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.timing.laws.run import example_file
from benchmarks.blocks.timing.laws.settings import LawBlock
from benchmarks.records import RunFolder
from planners.limits import DERIVATIVES

NEARLY = 1.001
"""Values over limits up to this are within 0.1 %: what a discretised method exceeds between its grid points is not a jump."""

ON_PATH_M, ON_PATH_RAD = 1e-4, 1e-4
"""Certified distance [m] and angle [rad] from the path up to which a motion counts: far more than any law leaves (3e-6)."""


@dataclass(frozen=True)
class LawRows(BlockRows):
    """A block of timed lines, its rows, and the facts on who took part; the reference is none of its entries."""

    def example(self, name: str) -> pl.DataFrame | None:
        """A part of the detailed view."""
        return self.folder.read(example_file(self.block, name))


def read_rows(folder: RunFolder, block: LawBlock) -> pl.DataFrame | None:
    """All rows of a block, with ``optimum`` T* [s] and ``over_optimum`` T / T*.

    A motion that exceeds a limit is compared after the uniform slow-down that ours get, too: as much slower as it must be
    to keep all limits. T* is the least duration on that line within those limits of any motion after that, the reference's
    included. ``kept_over_optimum`` is the ratio after the slow-down, infinite where none suffices. ``keeps_all`` says
    whether a motion keeps all limits as it is, ``nearly`` whether it exceeds none by more than 0.1 %. A motion that is not
    on its path, or does not run through it, counts as none (``follows``).
    """
    rows = folder.parts("timing", block.id)
    if rows is None:
        return None
    solved = pl.col("status") == "solved"
    rows = _with_judgement(rows.with_columns(solved=solved))
    follows = pl.col("solved") & pl.col("follows")
    slowed = pl.when(follows).then(pl.max_horizontal("duration", "least_duration"))
    return (
        rows.with_columns(
            keeps_all=pl.col("solved") & (pl.col("breaks") == ""),
            nearly=follows & (pl.col("worst") <= NEARLY),
            over_torque=pl.col("solved") & (pl.col("torque") > 1.0).fill_null(value=False),
            slowed_duration=slowed,
        )
        .with_columns(
            optimum=pl.when(pl.col("slowed_duration").is_finite()).then("slowed_duration").min().over("line", "limits")
        )
        .with_columns(
            over_optimum=pl.col("duration") / pl.col("optimum"),
            kept_over_optimum=pl.col("slowed_duration") / pl.col("optimum"),
        )
        .sort("line", "limits", maintain_order=True)
    )


def _with_judgement(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows with the worst ratio of all limits, and with ``follows`` false for motions that are not on their path."""
    if "torque" not in rows.columns:  # a run of an older version
        rows = rows.with_columns(torque=pl.lit(None, dtype=pl.Float64), torque_rate=pl.lit(None, dtype=pl.Float64))
    if "worst" not in rows.columns:  # a run of an older version
        rows = rows.with_columns(worst=pl.max_horizontal(DERIVATIVES), follows=pl.lit(None, dtype=pl.Boolean))
    on_path = (pl.col("distance") <= ON_PATH_M) & (pl.col("angle") <= ON_PATH_RAD)
    inside = ~pl.col("breaks").str.contains("position")
    return rows.with_columns(
        follows=pl.col("follows").fill_null(value=True) & on_path.fill_null(value=True) & inside.fill_null(value=True)
    )
