"""Contact between samples: the proof for every instant beside sampling by coal, on motions through the same scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds._scenes import scene_named
from benchmarks.kinds.base import Compared, Kind, Section, Table, Tell
from benchmarks.kinds.clearance.measures import MEASURES
from benchmarks.kinds.clearance.run import measure
from benchmarks.kinds.clearance.settings import ClearanceBlock, read_block
from optik.arm.library import load

if TYPE_CHECKING:
    from benchmarks.report.run import Run


class _Clearance(Kind):
    """Blocks of motions through a scene: ``[[clearance]]`` of a suite."""

    name = "clearance"
    title = "Contact between samples"
    measures = MEASURES
    order = 65
    compared = (
        Compared("missed contacts", "%", "less", "missed", only="contact"),
        Compared("time of a judgement", "ms", "less", "ms"),
    )

    def compared_rows(self, block: ClearanceBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """One problem is one motion."""
        return rows.rename({"method": "label", "motion": "problem"})

    def settings(self, data: Any) -> ClearanceBlock:
        return read_block(data)

    def prepare(self, block: ClearanceBlock, seed: int) -> None:
        scene_named(block.scene).pair_mask(load(block.robot))

    def measure(self, block: ClearanceBlock, seed: int, tell: Tell) -> pl.DataFrame:
        return measure(block, seed, tell)

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.clearance.report import SECTIONS

        return SECTIONS

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.clearance.report import tables

        return tables(run)

    def findings(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.clearance.report import findings

        return findings(run)

    def subjects(self, blocks: Sequence[ClearanceBlock]) -> Sequence[str]:
        return (f"proofs of clearance over {sum(block.count for block in blocks):,} motions",)

    def limitations(self, run: Run) -> Sequence[str]:
        return (
            "Clearance is that of the capsules around the arm's links, which stand out beyond the real surface: a contact of "
            "the shapes need not be one of the arm. Pairs of links that always touch are not examined.",
        )


METHOD = _Clearance
