"""One straight line, planned by every IK method and time law, in detail."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds.base import Block, BlockRows, Compared, Kind, Section, Table, Tell, Winner
from benchmarks.kinds.plans.rows import LinePlans, compared_plans
from benchmarks.kinds.plans.run import PLANS, check_line, plan_once, run_line
from benchmarks.kinds.plans.settings import LineTask, read_task
from benchmarks.records import RunFolder
from optik.registry import short_name

if TYPE_CHECKING:
    from benchmarks.report.run import Run


class _Plans(Kind):
    """The line of a suite: its table ``[line]``."""

    name = "plans"
    title = "The line"
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

    def settings(self, data: Any) -> LineTask:
        return read_task(data)

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

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.plans.report import SECTIONS

        return SECTIONS

    def subjects(self, blocks: Sequence[Any]) -> Sequence[str]:
        return ("inverse kinematics", "time laws along a straight line")

    def labels(self, block: Block) -> Sequence[str]:
        assert isinstance(block, LineTask)
        return [short_name(law) for law in block.laws]

    def winners(self, run: Run) -> Sequence[Winner]:
        from benchmarks.kinds.plans.report.best import winners

        return winners(run)

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.plans.report.best import tables

        return tables(run)

    def findings(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.plans.report.head import findings

        return findings(run)

    def limitations(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.plans.report.head import limitations

        return limitations(run)


METHOD = _Plans
