"""The executed cell: spots on graph paper, cycles of ISO 9283 and time laws, on a simulated drive."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import polars as pl

from benchmarks.blocks.base import Compared, Kind, Part
from benchmarks.blocks.cell import iso, laws, spots
from benchmarks.blocks.cell.settings import ISO, LAWS, SPOTS, CellBlock, read_block
from benchmarks.blocks.cell.trials import check_drive, drive_name
from benchmarks.records import RunFolder

EXECUTED = {SPOTS: spots, ISO: iso, LAWS: laws}
"""Modules by type of motion: each prepares a block, and divides its work into parts."""


class _Cell(Kind):
    """Blocks of the executed cell: ``[[cell]]`` of a suite."""

    name = "cell"
    title = "The executed cell"
    block = CellBlock
    order = 45
    alone = False
    compared = (
        Compared("position error", "mm", "less", "position_error", 1e3),
        Compared("tracking error of the tool", "mm", "less", "tracking_m", 1e3),
        Compared("energy", "J", "less", "energy"),
        Compared("duration", "s", "less", "duration"),
    )

    def compared_rows(self, block: CellBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared: one problem is one spot, cycle or line."""
        keys = [key for key in ("problem", "repeat", "test", "cycle", "timed") if key in rows.columns]
        named = pl.concat_str([pl.col(key).cast(pl.String) for key in keys], separator=" ", ignore_nulls=True)
        return rows.with_columns(problem=named)

    def settings(self, data: Any) -> CellBlock:
        return read_block(data)

    def prepare(self, block: CellBlock, seed: int) -> tuple[Any, ...]:
        drive = drive_name(block)
        check_drive(block, drive)
        return EXECUTED[block.what].prepare(block, seed), drive, seed

    def parts(self, block: CellBlock, prepared: tuple[Any, ...], folder: RunFolder) -> Iterable[Part]:
        for name, work in EXECUTED[block.what].parts(block, *prepared, folder):
            yield self.part(block, name, block.title, work)


METHOD = _Cell
