"""First use: what importing and the first solve cost a fresh process, with and without what an earlier one compiled."""

from __future__ import annotations

from typing import Any, ClassVar

import polars as pl

from benchmarks.blocks.base import Block, Compared, Kind, Tell
from benchmarks.blocks.ik.first_use.measures import MEASURES, median
from benchmarks.blocks.ik.first_use.run import FILE, run_first_use
from benchmarks.records import RunFolder
from benchmarks.settings import Count, RobotName, SolverName, key
from benchmarks.targets import Measure, Target
from optik.registry import short_name


class FirstUse(Block):
    """What starting costs."""

    noun = "first_use"
    fixed = frozenset({"id", "title"})
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    id: str = "first-use"
    title: str = "First use"
    robot: RobotName = key("The arm.")
    solver: SolverName = key("The IK method.")
    repeats: Count = key("Processes timed after the one that compiles.", 3)

    @classmethod
    def read(cls, data: Any) -> FirstUse:
        """Check the table; the title names what is measured."""
        block = super().read(data)
        title = f"First use in a fresh process ({short_name(block.solver)}, {short_name(block.robot)})"
        return block.model_copy(update={"title": title})


class _FirstUse(Kind):
    """First use: the table ``[first_use]`` of a suite."""

    name = "first_use"
    title = "First use"
    block = FirstUse
    measures = MEASURES
    single = True
    order = 50
    compared = (Compared("time in a fresh process", "s", "less", "seconds"),)

    def compared_rows(self, block: FirstUse, rows: pl.DataFrame) -> pl.DataFrame:
        """Processes by what they measured."""
        return rows.with_columns(label="measure", problem=pl.lit("a process"))

    def run(self, block: FirstUse, seed: int, folder: RunFolder, tell: Tell) -> None:
        if not folder.has(FILE):
            tell("first use")
            run_first_use(block.robot, block.solver, block.repeats, folder)

    def rows(self, folder: RunFolder, block: FirstUse) -> pl.DataFrame | None:
        seconds: dict[str, list[float]] | None = folder.read_json(FILE)
        if seconds is None:
            return None
        flat = [(measure, value) for measure, values in seconds.items() for value in values]
        return pl.DataFrame(flat, schema={"measure": pl.String, "seconds": pl.Float64}, orient="row")

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        own = None if rows is None else rows.filter(pl.col("measure") == target.measure)
        if own is None or own.is_empty():
            return float("nan"), "it was not run"
        return median(own), f"{len(own)} process{'es' if len(own) != 1 else ''}"


METHOD = _FirstUse
