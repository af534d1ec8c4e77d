"""One straight line, planned by every IK method and time law, in detail."""

from __future__ import annotations

import polars as pl

from benchmarks.blocks.base import BlockRows, Compared, Kind, Tell
from benchmarks.blocks.timing.plans.rows import LinePlans, compared_plans
from benchmarks.blocks.timing.plans.run import PLANS, check_line, plan_once, run_line
from benchmarks.blocks.timing.plans.settings import LineTask
from benchmarks.records import RunFolder
from optik.registry import short_name as short_name


class _Plans(Kind):
    """The line of a suite: its table ``[line]``."""

    name = "plans"
    title = "The line"
    block = LineTask
    single = True
    order = 40
    on_paper = True
    warms = True
    compared = (
        Compared("motion found", "%", "more", "solved", exact=True),
        Compared("duration", "s", "less", "duration", exact=True),
        Compared("time of a whole plan", "ms", "less", "seconds", 1e3),
    )

    def rows_to_compare(self, folder: RunFolder, block: LineTask) -> pl.DataFrame | None:
        """Each plan by itself; times of all plans together, as each was made once."""
        plans = folder.read_json(PLANS)
        return compared_plans(plans) if plans else None

    def prepare(self, block: LineTask, seed: int) -> None:
        check_line(block)

    def warm(self, block: LineTask) -> None:
        plan_once(block)

    def run(self, block: LineTask, seed: int, folder: RunFolder, tell: Tell) -> None:
        if not folder.has(PLANS):
            tell(block.title)
            run_line(block, folder)

    def rows(self, folder: RunFolder, block: LineTask) -> pl.DataFrame | None:
        plans = folder.read_json(PLANS)
        return (
            pl.DataFrame([{key: p[key] for key in ("solver", "law", "status", "seconds")} for p in plans])
            if plans
            else None
        )

    def read(self, folder: RunFolder, block: LineTask) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else LinePlans(block, rows, folder, {"plans": folder.read_json(PLANS)})


METHOD = _Plans
