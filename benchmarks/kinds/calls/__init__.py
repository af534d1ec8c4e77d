"""Single IK calls: every problem one timed call of every method and peer, in one process, in rounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds._contest import read_facts
from benchmarks.kinds._problems import check_set
from benchmarks.kinds.base import BlockRows, Compared, Kind, Section, Table, Target, Tell, Winner
from benchmarks.kinds.calls.callers import build_ours
from benchmarks.kinds.calls.evaluations import run_evaluations
from benchmarks.kinds.calls.measures import MEASURES, judge
from benchmarks.kinds.calls.rounds import without_memory
from benchmarks.kinds.calls.rows import CallRows
from benchmarks.kinds.calls.run import facts_file, read_rows, run_calls
from benchmarks.kinds.calls.settings import CallBlock, read_block
from benchmarks.records import JOURNAL, Journal, RunFolder
from optik.arm.library import load

if TYPE_CHECKING:
    from benchmarks.report.run import Run


class _Calls(Kind):
    """Blocks of single calls: ``[[speed]]`` of a suite."""

    name = "calls"
    title = "Speed of one call"
    measures = MEASURES
    order = 20
    compared = (
        Compared("solved", "%", "more", "solved"),
        Compared("time (both solved)", "µs", "less", "ns", 1e-3, "solved", ("least_ns", "most_ns")),
        Compared("time of any call", "µs", "less", "ns", 1e-3, "", ("least_ns", "most_ns")),
    )

    def settings(self, data: Any) -> CallBlock:
        return read_block(data)

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

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.calls.report import SECTIONS

        return SECTIONS

    def winners(self, run: Run) -> Sequence[Winner]:
        from benchmarks.kinds.calls.report.winners import winners

        return winners(run)

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.calls.report.section import all_tables

        return all_tables(run)

    def subjects(self, blocks: Sequence[Any]) -> Sequence[str]:
        return ("inverse kinematics, call by call",)

    def limitations(self, run: Run) -> Sequence[str]:
        return (
            "Calls are timed in a loop over different targets, with code and tables in the processor's caches. A single call "
            "after other work takes longer. The garbage collector is off during timing.",
            "Every round has the same problems. If the first round of a method is far slower than the others, it may cache "
            "answers: its time is then that of the first round, and the note below the table names it.",
            "Closed-form peers compute every branch, our methods one solution near the start. A peer that starts threads is "
            "timed with them. Peers have the settings that served them best on the paper's arm; their rows state them.",
        )


METHOD = _Calls
