"""First use: times of the import and the first solve in a fresh process, with and without a compiled cache."""

from __future__ import annotations

from tempfile import TemporaryDirectory
from typing import Any

import polars as pl

from benchmarks.blocks.base import Block, Compared, Kind, Target, Tell
from benchmarks.blocks.columns import Column, median
from benchmarks.blocks.contest import fresh
from benchmarks.settings import Count, RobotName, SolverName, key
from optik.registry import short_name

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


MEASURES = (
    Column("import_s", "import optik", "s", of=median("seconds")),
    Column("first_solve_s", "first solve after import, cached code", "s", of=median("seconds")),
    Column("compile_s", "first solve after import, with compilation", "s", of=median("seconds")),
)
"""Measures that a target of first use can name: medians over fresh processes."""


class FirstUse(Block):
    """Times of a fresh process."""

    noun = "first_use"
    fixed = frozenset({"id", "title"})
    measures = MEASURES

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
    single = True
    order = 50
    compared = (Compared("time in a fresh process", "s", "less", "seconds"),)

    def measure(self, block: FirstUse, seed: int, tell: Tell) -> pl.DataFrame:
        """Time fresh processes: one with an empty cache, then some with the cache that it filled."""
        tell("first use")
        command = ["-c", FIRST_USE_CODE, block.robot, block.solver]
        with TemporaryDirectory() as cache:
            compiling, *warm = (fresh(command, "first use", NUMBA_CACHE_DIR=cache) for _ in range(1 + block.repeats))
        rows = [("compile_s", "a process", compiling[1])]
        rows += [("import_s", "a process", imported) for imported, _ in warm]
        rows += [("first_solve_s", "a process", solved) for _, solved in warm]
        return pl.DataFrame(rows, schema=["method", "problem", "seconds"], orient="row")

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        own = rows.filter(pl.col("method") == target.measure)
        return own, f"{len(own)} process{'es' if len(own) != 1 else ''}"


METHOD = _FirstUse
