"""First use: what importing and the first solve cost a fresh process, with and without what an earlier one compiled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import polars as pl

from benchmarks.blocks.base import Block, Compared, Kind, Tell
from benchmarks.blocks.ik.first_use.measures import MEASURES, median
from benchmarks.blocks.ik.first_use.run import FILE, run_first_use
from benchmarks.records import RunFolder
from benchmarks.settings import Target, all_of, check_keys, check_known
from benchmarks.targets import read_target
from optik.check import check_count
from optik.registry import short_name


@dataclass(frozen=True, kw_only=True)
class FirstUse(Block):
    """What starting costs.

    Attributes
    ----------
    robot : str
        Name of the arm.
    solver : str
        Name of the IK method.
    repeats : int
        Processes timed after the one that compiles.
    """

    robot: str
    solver: str
    repeats: int

    @property
    def robots(self) -> tuple[str, ...]:
        """The one arm."""
        return (self.robot,)


class _FirstUse(Kind):
    """First use: the table ``[first_use]`` of a suite."""

    name = "first_use"
    title = "First use"
    measures = MEASURES
    single = True
    order = 50
    compared = (Compared("time in a fresh process", "s", "less", "seconds"),)

    def compared_rows(self, block: FirstUse, rows: pl.DataFrame) -> pl.DataFrame:
        """Processes by what they measured."""
        return rows.with_columns(label="measure", problem=pl.lit("a process"))

    def settings(self, data: Any) -> FirstUse:
        where = "first_use"
        check_keys(data, {"robot", "solver", "repeats", "targets"}, where, need={"robot", "solver"})
        robot = check_known(data["robot"], "optik.robots", "robot")
        solver = check_known(data["solver"], "optik.ik", "IK method")
        check_count(data.get("repeats", 3), f"{where}: repeats", 1)
        return FirstUse(
            id="first-use",
            title=f"First use in a fresh process ({short_name(solver)}, {short_name(robot)})",
            targets=all_of(data.get("targets"), f"{where}: targets", lambda t: read_target(t, where, MEASURES)),
            robot=robot,
            solver=solver,
            repeats=data.get("repeats", 3),
        )

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
