"""Contact between samples: the proof for every instant beside sampling by coal, on motions through the same scene."""

from __future__ import annotations

import polars as pl

from benchmarks.blocks._scenes import scene_named
from benchmarks.blocks.base import Compared, Kind, Tell
from benchmarks.blocks.timing.clearance.measures import MEASURES
from benchmarks.blocks.timing.clearance.run import measure
from benchmarks.blocks.timing.clearance.settings import ClearanceBlock
from optik.arm.library import load


class _Clearance(Kind):
    """Blocks of motions through a scene: ``[[clearance]]`` of a suite."""

    name = "clearance"
    title = "Contact between samples"
    block = ClearanceBlock
    measures = MEASURES
    order = 65
    compared = (
        Compared("missed contacts", "%", "less", "missed", only="contact"),
        Compared("time of a judgement", "ms", "less", "ms"),
    )

    def compared_rows(self, block: ClearanceBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """One problem is one motion."""
        return rows.rename({"method": "label", "motion": "problem"})

    def prepare(self, block: ClearanceBlock, seed: int) -> None:
        scene_named(block.scene).pair_mask(load(block.robot))

    def measure(self, block: ClearanceBlock, seed: int, tell: Tell) -> pl.DataFrame:
        return measure(block, seed, tell)


METHOD = _Clearance
