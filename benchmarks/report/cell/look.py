"""Blocks of the executed cell as the report takes them, and what its boards share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.settings import CellBlock, SpotsBlock
from benchmarks.report.board import Control
from benchmarks.report.figures import INK_COLOUR, colour, iterations
from benchmarks.report.run import Run

PART_WORDS = {
    "laser": "laser: target − spot", "ik": "IK: its answer − target", "path": "path: planned − answer",
    "servo": "servo: executed − planned",
}  # fmt: skip
"""Parts of the error in words."""

PART_COLOURS = dict(zip(PART_WORDS, (colour(0), colour(1), colour(2), colour(3)), strict=True))
"""Their colours."""

TOTAL_COLOUR = INK_COLOUR
"""Colour of the whole error."""

WHOLE = "whole"
"""In place of a budget, of methods that are called as they come."""


def cell_blocks(run: Run, kind: type[CellBlock]) -> list[BlockRows]:
    """Blocks of one class that have rows."""
    return [b for b in run.of("cell") if isinstance(b.block, kind)]


def spots_blocks(run: Run) -> list[BlockRows]:
    """Blocks of spots that have rows."""
    return cell_blocks(run, SpotsBlock)


def done(b: BlockRows) -> pl.DataFrame:
    """Rows of spots with a known solution that were executed."""
    rows = b.rows.filter(pl.col("known") & pl.col("position_error").is_not_null())
    return rows.with_columns(after=pl.col("budget").cast(pl.String).fill_null(WHOLE))


def settings_of(blocks: Sequence[BlockRows], *, whole: bool | None = None) -> list[str]:
    """Labels of the methods of some blocks, each once."""
    return list(dict.fromkeys(m.label for b in blocks for m in b.block.methods if whole is None or m.whole is whole))


def after_control(b: BlockRows) -> Control:
    """The choice of a budget, where a method is chosen that has one."""
    options = tuple((str(k), iterations(k)) for k in b.block.budgets)
    return Control("after", "After", options, when={"method": settings_of([b], whole=False)})


def shown_at(setting: str, after: str) -> dict[str, list[str]]:
    """Values of the controls at which one method is shown at one budget."""
    return {"method": [setting]} | ({} if after == WHOLE else {"after": [after]})


def millimetres(values: pl.Series) -> np.ndarray:
    """Lengths for a plot."""
    return 1e3 * values.to_numpy()
