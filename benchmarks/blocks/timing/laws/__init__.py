"""Time laws on many straight lines: every law and peer times the same joint paths, and every motion is certified."""

from __future__ import annotations

import polars as pl

from benchmarks.blocks._contest import read_facts
from benchmarks.blocks.base import BlockRows, Compared, Kind, Tell
from benchmarks.blocks.timing.laws.lines import LINE_KINDS as LINE_KINDS
from benchmarks.blocks.timing.laws.measures import MEASURES, judge
from benchmarks.blocks.timing.laws.rows import LawRows, read_rows
from benchmarks.blocks.timing.laws.run import check_laws, facts_file, run_laws
from benchmarks.blocks.timing.laws.settings import LawBlock
from benchmarks.records import JOURNAL, Journal, RunFolder
from benchmarks.targets import Target


class _Laws(Kind):
    """Blocks of timed lines: ``[[timing]]`` of a suite."""

    name = "laws"
    title = "Time laws on many lines"
    block = LawBlock
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


METHOD = _Laws
