"""Time laws on many straight lines: every law and peer times the same joint paths, and every motion is certified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds._contest import read_facts
from benchmarks.kinds.base import BlockRows, Compared, Kind, Section, Table, Target, Tell, Winner
from benchmarks.kinds.laws.lines import LINE_KINDS
from benchmarks.kinds.laws.measures import MEASURES, judge
from benchmarks.kinds.laws.rows import LawRows, read_rows
from benchmarks.kinds.laws.run import check_laws, facts_file, run_laws
from benchmarks.kinds.laws.settings import LawBlock, read_block
from benchmarks.records import JOURNAL, Journal, RunFolder

if TYPE_CHECKING:
    from benchmarks.report.run import Run


OF_MODELS = (
    "Torques are those of the arms' models: what motors deliver at a speed or a temperature, and the elasticity of gears, are "
    "not in them."
)
"""What every report with torques says."""


class _Laws(Kind):
    """Blocks of timed lines: ``[[timing]]`` of a suite."""

    name = "laws"
    title = "Time laws on many lines"
    measures = MEASURES
    order = 60
    compared = (
        Compared("motions found", "%", "more", "solved"),
        Compared("within every limit", "%", "more", "keeps_all", only="solved"),
        Compared("duration", "s", "less", "duration", only="solved"),
        Compared("time of the law", "ms", "less", "ms_law", only="solved"),
    )

    def compared_rows(self, block: LawBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """One problem is one line within one set of limits."""
        problem = pl.concat_str("robot", "kind", "index", "limits", separator=" ").alias("problem")
        return rows.filter(pl.col("entry") != "reference").with_columns(problem, label="law")

    def settings(self, data: Any) -> LawBlock:
        return read_block(data)

    def prepare(self, block: LawBlock, seed: int) -> None:
        check_laws(block)

    def run(self, block: LawBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
        with Journal(folder, self.file(block, JOURNAL)) as journal:
            run_laws(block, seed, folder, tell, journal)

    def rows(self, folder: RunFolder, block: LawBlock) -> pl.DataFrame | None:
        return read_rows(folder, block)

    def read(self, folder: RunFolder, block: LawBlock) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else LawRows(block, rows, folder, read_facts(folder, facts_file(block), block.id))

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        return judge(rows, target)

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.laws.report import SECTIONS

        return SECTIONS

    def subjects(self, blocks: Sequence[LawBlock]) -> Sequence[str]:
        parts = [part for block in blocks for part in block.lines]
        words = "straight lines" if all(part.kind in LINE_KINDS for part in parts) else "paths"
        return (f"time laws along {sum(part.count for part in parts)} {words}",)

    def winners(self, run: Run) -> Sequence[Winner]:
        from benchmarks.kinds.laws.report.winners import winners

        return winners(run)

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.laws.report.tables import all_tables

        return all_tables(run)

    def findings(self, run: Run) -> Sequence[str]:
        from benchmarks.kinds.laws.report.section import findings

        return findings(run)

    def limitations(self, run: Run) -> Sequence[str]:
        sets = [part for b in run.of("laws") for part in b.block.limits]
        return (
            "T* is the shortest known duration, not a proved optimum.",
            "Lines are sampled such that the whole line can be followed inside the joint limits. The smallest singular value "
            "along a line is never below 0.02."
            + ("" if any(part.own for part in sets) else " The limits are the suite's, not the robots' own."),
            "Peers time the joint path that optik follows, with its exact derivatives if they accept them. Their motions are "
            "shown unchanged, and compared after the same uniform time scaling to the limits as those of optik.",
            *([OF_MODELS] if any(part.counts_torque for part in sets) else []),
        )


METHOD = _Laws
