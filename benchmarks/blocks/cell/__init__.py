"""The executed cell: spots on graph paper, cycles of ISO 9283 and time laws, on a simulated drive."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import polars as pl

from benchmarks.blocks.base import Compared, Kind, Part
from benchmarks.blocks.cell.iso import IsoWork, iso_parts, prepare_iso, solve_iso
from benchmarks.blocks.cell.measures import ALL_MEASURES
from benchmarks.blocks.cell.settings import CellBlock, IsoBlock, LawsBlock, SpotsBlock, read_block
from benchmarks.blocks.cell.spots import SpotsWork, prepare_spots, solve_spots, spots_parts
from benchmarks.blocks.cell.timelaws import LawsWork, laws_parts, prepare_laws, solve_laws
from benchmarks.blocks.cell.trials import check_drive, drive_name
from benchmarks.records import RunFolder


class _Cell(Kind):
    """Blocks of the executed cell: ``[[cell]]`` of a suite."""

    name = "cell"
    title = "The executed cell"
    block = CellBlock
    measures = ALL_MEASURES
    order = 45
    alone = False
    compared = (
        Compared("position error", "mm", "less", "position_error", 1e3),
        Compared("tracking error of the tool", "mm", "less", "tracking_m", 1e3),
        Compared("energy", "J", "less", "energy"),
        Compared("duration", "s", "less", "duration"),
    )

    def compared_rows(self, block: CellBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """One problem is one spot, cycle or line; what a block does not have is empty."""
        keys = [
            key for key in ("problem", "repeat", "test", "cycle", "point", "motion", "timed") if key in rows.columns
        ]
        named = pl.concat_str([pl.col(key).cast(pl.String) for key in keys], separator=" ", ignore_nulls=True)
        kept = [c.column for c in self.compared if c.column in rows.columns]
        lacking = {c.column: pl.lit(None, dtype=pl.Float64) for c in self.compared if c.column not in rows.columns}
        return rows.select(pl.col("method").alias("label"), named.alias("problem"), *kept).with_columns(**lacking)

    def settings(self, data: Any) -> CellBlock:
        return read_block(data)

    def prepare(self, block: CellBlock, seed: int) -> tuple[Any, ...]:
        drive = drive_name(block)
        check_drive(block, drive)
        if isinstance(block, SpotsBlock):
            return (*prepare_spots(block, seed), drive, seed)
        if isinstance(block, IsoBlock):
            prepare_iso(block)
        elif isinstance(block, LawsBlock):
            prepare_laws(block)
        return drive, seed

    def parts(self, block: CellBlock, prepared: tuple[Any, ...], folder: RunFolder) -> Iterable[Part]:
        if isinstance(block, SpotsBlock):
            return spots_parts(folder, block, prepared, self.folder)
        if isinstance(block, IsoBlock):
            return iso_parts(block, prepared, self.folder)
        assert isinstance(block, LawsBlock)
        return laws_parts(block, prepared, self.folder)

    def solve(self, work: SpotsWork | IsoWork | LawsWork) -> pl.DataFrame:
        if isinstance(work, SpotsWork):
            return solve_spots(work)
        return solve_iso(work) if isinstance(work, IsoWork) else solve_laws(work)

    def rows(self, folder: RunFolder, block: CellBlock) -> pl.DataFrame | None:
        return folder.parts(self.folder, block.id)


METHOD = _Cell
