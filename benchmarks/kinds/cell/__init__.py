"""The executed cell: spots on graph paper, cycles of ISO 9283 and time laws, on a simulated drive."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds.base import Block, Compared, Kind, Part, Section, Table
from benchmarks.kinds.cell.iso import IsoWork, iso_parts, prepare_iso, solve_iso
from benchmarks.kinds.cell.measures import ALL_MEASURES
from benchmarks.kinds.cell.settings import CellBlock, IsoBlock, LawsBlock, SpotsBlock, read_block
from benchmarks.kinds.cell.spots import SpotsWork, prepare_spots, solve_spots, spots_parts
from benchmarks.kinds.cell.timelaws import LawsWork, laws_parts, prepare_laws, solve_laws
from benchmarks.kinds.cell.trials import check_drive, drive_name
from benchmarks.records import RunFolder

if TYPE_CHECKING:
    from benchmarks.report.run import Run


class _Cell(Kind):
    """Blocks of the executed cell: ``[[cell]]`` of a suite."""

    name = "cell"
    title = "The executed cell"
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

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.cell.report import SECTIONS

        return SECTIONS

    def subjects(self, blocks: Sequence[Block]) -> Sequence[str]:
        return ("executed motions of the laser cell",)

    def labels(self, block: Block) -> Sequence[str]:
        return [m.label for m in block.methods] if isinstance(block, SpotsBlock) else block.labels

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.cell.report.tables import tables

        return tables(run)

    def findings(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.cell.report.head import findings

        return findings(run)

    def limitations(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.cell.report.head import limitations

        return limitations(run)


METHOD = _Cell
