"""Batches: many IK problems in one call, timed in a fresh process, where its memory can be told from all other."""

from __future__ import annotations

import json

import polars as pl

from benchmarks.blocks._fresh import fresh
from benchmarks.blocks._problems import check_set
from benchmarks.blocks.base import Compared, Kind, Tell
from benchmarks.blocks.ik.batch.measures import MEASURES, judge
from benchmarks.blocks.ik.batch.settings import BatchBlock
from benchmarks.records import slug
from benchmarks.targets import Target
from optik.arm.library import load
from optik.ik import make_solver


class _Batch(Kind):
    """Batches: ``[[batch]]`` of a suite."""

    name = "batch"
    title = "Batches"
    block = BatchBlock
    measures = MEASURES
    order = 30
    compared = (Compared("time of a batch", "s", "less", "seconds"),)

    def compared_rows(self, block: BatchBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Repeats by number of threads."""
        return rows.with_columns(label=pl.format("{} threads", "threads"), problem=pl.lit("the batch"))

    def prepare(self, block: BatchBlock, seed: int) -> None:
        check_set(block)
        make_solver(load(block.robot), block.solver, **block.solver_options)

    def file(self, block: BatchBlock, ending: str = "parquet") -> str:
        return f"speed/{slug(block.id)}.batch.{ending}"

    def measure(self, block: BatchBlock, seed: int, tell: Tell) -> pl.DataFrame:
        tell(f"{block.id}: in a process of its own")
        keys = ("robot", "set", "options", "solver", "solver_options", "threads", "repeats")
        settings = {key: getattr(block, key) for key in keys} | {"seed": seed}
        rows = fresh(["-m", "benchmarks.blocks.ik.batch.process", json.dumps(settings)], f"batch {block.id!r}")
        return pl.DataFrame(rows)

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        return judge(rows, target)


METHOD = _Batch
