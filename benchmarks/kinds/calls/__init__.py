"""Single IK calls: every problem one timed call of every method and peer, in one process, in rounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl

from benchmarks.kinds._contest import read_facts
from benchmarks.kinds._problems import check_set
from benchmarks.kinds.base import BlockRows, Kind, Section, Target, Tell
from benchmarks.kinds.calls.callers import build_ours
from benchmarks.kinds.calls.measures import MEASURES, judge
from benchmarks.kinds.calls.run import facts_file, read_rows, run_calls
from benchmarks.kinds.calls.settings import CallBlock, read_block
from benchmarks.records import RunFolder
from optik.arm.library import load


class _Calls(Kind):
    """Blocks of single calls: ``[[speed]]`` of a suite."""

    name = "calls"
    title = "Speed of one call"
    measures = MEASURES
    order = 20

    def settings(self, data: Any) -> CallBlock:
        return read_block(data)

    def prepare(self, block: CallBlock, seed: int) -> None:
        check_set(block)
        for entry in block.methods:
            build_ours(entry, load(block.robot))

    def run(self, block: CallBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
        run_calls(block, seed, folder, tell)

    def rows(self, folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
        return read_rows(folder, block)

    def read(self, folder: RunFolder, block: CallBlock) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else BlockRows(block, rows, folder, read_facts(folder, facts_file(block), block.id))

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        return judge(rows, target)

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.calls.report import SECTIONS

        return SECTIONS

    def subjects(self, blocks: Sequence[Any]) -> Sequence[str]:
        return ("inverse kinematics, call by call",)

    def limitations(self, run: Any) -> Sequence[str]:
        return (
            "Calls are timed in a loop over different targets, with code and tables in the processor's caches: a call that "
            "comes alone after other work takes longer. Timing runs with the garbage collector off.",
            "Closed-form peers look for every branch, ours for one answer near the start; a peer that races threads of its own "
            "is timed with them. Peers have the settings that served them best on the paper's arm, as their rows say.",
        )


METHOD = _Calls
