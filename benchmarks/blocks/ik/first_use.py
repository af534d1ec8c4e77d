"""First use: times of the import and the first solve in a fresh process, with and without a compiled cache."""

from __future__ import annotations

from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np
import polars as pl

from benchmarks.blocks._fresh import fresh
from benchmarks.blocks.base import Block, Compared, Kind, Tell
from benchmarks.records import RunFolder
from benchmarks.settings import Count, RobotName, SolverName, key
from benchmarks.targets import Measure, Target
from optik.registry import short_name

FIRST_USE_FILE = "speed/first-use.json"
"""Seconds of every process by measure."""

FIRST_USE_CODE = """
import json, sys, time
begin = time.perf_counter()
import optik
imported = time.perf_counter()
robot = optik.load(sys.argv[1])
q = 0.75 * robot.limits.lower.clip(-3) + 0.25 * robot.limits.upper.clip(max=3)
result = optik.solve_ik(robot, robot.fk(q), robot.limits.clip(q + 0.1), solver=sys.argv[2])
solved = time.perf_counter()
print(json.dumps([imported - begin, solved - imported]))
"""
"""Code of a fresh process: it prints the seconds of importing and of the first solve."""


def _median(rows: pl.DataFrame) -> float:
    """Return the median over processes."""
    return float(np.median(rows["seconds"].to_numpy())) if len(rows) else float("nan")


MEASURES = (
    Measure("import_s", "s", _median, "import optik"),
    Measure("first_solve_s", "s", _median, "first solve after import, cached code"),
    Measure("compile_s", "s", _median, "first solve after import, with compilation"),
)
"""Measures that a target of first use can name: medians over fresh processes."""


class FirstUse(Block):
    """Times of a fresh process."""

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
        """Check the table; the title names the measurement."""
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
        """Return the processes by their measure."""
        return rows.with_columns(label="measure", problem=pl.lit("a process"))

    def run(self, block: FirstUse, seed: int, folder: RunFolder, tell: Tell) -> None:
        """Time fresh processes: one with an empty cache, then some with the cache that it filled."""
        if folder.has(FIRST_USE_FILE):
            return
        tell("first use")
        command = ["-c", FIRST_USE_CODE, block.robot, block.solver]
        with TemporaryDirectory() as cache:
            compiling, *warm = (fresh(command, "first use", NUMBA_CACHE_DIR=cache) for _ in range(1 + block.repeats))
        seconds = {
            "compile_s": [compiling[1]],
            "import_s": [imported for imported, _ in warm],
            "first_solve_s": [solved for _, solved in warm],
        }
        folder.write_json(FIRST_USE_FILE, seconds)

    def rows(self, folder: RunFolder, block: FirstUse) -> pl.DataFrame | None:
        seconds: dict[str, list[float]] | None = folder.read_json(FIRST_USE_FILE)
        if seconds is None:
            return None
        flat = [(measure, value) for measure, values in seconds.items() for value in values]
        return pl.DataFrame(flat, schema={"measure": pl.String, "seconds": pl.Float64}, orient="row")

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        own = None if rows is None else rows.filter(pl.col("measure") == target.measure)
        if own is None or own.is_empty():
            return float("nan"), "it was not run"
        return _median(own), f"{len(own)} process{'es' if len(own) != 1 else ''}"


METHOD = _FirstUse
