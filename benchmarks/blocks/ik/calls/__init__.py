"""Single IK calls: every problem one timed call of every method and peer, in one process, in rounds."""

from __future__ import annotations

import polars as pl

from benchmarks.blocks._contest import read_facts
from benchmarks.blocks._problems import check_set
from benchmarks.blocks.base import BlockRows, Compared, Kind, Tell
from benchmarks.blocks.ik.calls.callers import build_ours
from benchmarks.blocks.ik.calls.evaluations import run_evaluations
from benchmarks.blocks.ik.calls.measures import MEASURES, judge
from benchmarks.blocks.ik.calls.rounds import without_memory
from benchmarks.blocks.ik.calls.rows import CallRows
from benchmarks.blocks.ik.calls.run import facts_file, read_rows, run_calls
from benchmarks.blocks.ik.calls.settings import CallBlock
from benchmarks.records import JOURNAL, Journal, RunFolder
from benchmarks.targets import Target
from optik.arm.library import load


class _Calls(Kind):
    """Blocks of single calls: ``[[speed]]`` of a suite."""

    name = "calls"
    title = "Speed of one call"
    block = CallBlock
    measures = MEASURES
    order = 20
    compared = (
        Compared("solved", "%", "more", "solved"),
        Compared("time (both solved)", "µs", "less", "ns", 1e-3, "solved", ("least_ns", "most_ns")),
        Compared("time of any call", "µs", "less", "ns", 1e-3, "", ("least_ns", "most_ns")),
    )

    def prepare(self, block: CallBlock, seed: int) -> None:
        check_set(block)
        for entry in block.methods:
            build_ours(entry, load(block.robot))

    def run(self, block: CallBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
        with Journal(folder, self.file(block, JOURNAL)) as journal:
            run_calls(block, seed, folder, tell, journal)
            run_evaluations(block, seed, folder, tell, journal)

    def rows(self, folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
        rows = read_rows(folder, block)
        return None if rows is None else without_memory(rows)

    def read(self, folder: RunFolder, block: CallBlock) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else CallRows(block, rows, folder, read_facts(folder, facts_file(block), block.id))

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        return judge(rows, target)


METHOD = _Calls
