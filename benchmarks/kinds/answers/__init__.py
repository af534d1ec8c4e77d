"""Recorded answers: any number of IK problems by batch methods, drawn part by part, every answer judged and kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.kinds._shown import Table, Winner
from benchmarks.kinds.answers.measures import MEASURES, compared_answers, distribution, summary
from benchmarks.kinds.answers.run import AnswersWork, check, parts, solve
from benchmarks.kinds.answers.settings import AnswersBlock, read_block
from benchmarks.kinds.base import BlockRows, Compared, Kind, Part, Section, Target
from benchmarks.records import RunFolder

if TYPE_CHECKING:
    from benchmarks.report.run import Run


class _Answers(Kind):
    """Blocks of recorded answers: ``[[answers]]`` of a suite. Their `rows` are sums over the answers, a row a method."""

    name = "answers"
    title = "Recorded answers"
    measures = MEASURES
    order = 15
    alone = False
    compared = (
        Compared("solved within 1e-6", "%", "more", "good"),
        Compared("time of a problem, part by part", "µs", "less", "seconds", 1e6),
    )

    def rows_to_compare(self, folder: RunFolder, block: AnswersBlock) -> pl.DataFrame | None:
        """Every answer, and the time of every part."""
        answers = self._answers(folder, block)
        return None if answers is None else compared_answers(answers, block.part)

    @property
    def folder(self) -> str:
        """Its folder in a run."""
        return "answers"

    def settings(self, data: Any) -> AnswersBlock:
        return read_block(data)

    def prepare(self, block: AnswersBlock, seed: int) -> int:
        check(block, seed)
        return seed

    def parts(self, block: AnswersBlock, prepared: int, folder: RunFolder) -> Iterable[Part]:
        return parts(block, prepared, self.folder)

    def solve(self, work: AnswersWork) -> pl.DataFrame:
        return solve(work)

    def rows(self, folder: RunFolder, block: AnswersBlock) -> pl.DataFrame | None:
        answers = self._answers(folder, block)
        return None if answers is None else summary(answers)

    def read(self, folder: RunFolder, block: AnswersBlock) -> BlockRows | None:
        answers = self._answers(folder, block)
        if answers is None:
            return None
        return BlockRows(block, summary(answers), folder, {"distribution": distribution(answers), "answers": answers})

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        value, note = super().judge(rows, target)
        if rows is None:
            return value, note
        return value, f"{rows.filter(pl.col('method') == target.method)['count'].sum():,} answers"

    def sections(self) -> Sequence[Section]:
        from benchmarks.kinds.answers.report import SECTIONS

        return SECTIONS

    def subjects(self, blocks: Sequence[Any]) -> Sequence[str]:
        return ("inverse kinematics",)

    def tables(self, run: Run) -> Sequence[Table]:
        from benchmarks.kinds.answers.shown import tables

        return tables(run)

    def winners(self, run: Run) -> Sequence[Winner]:
        from benchmarks.kinds.answers.shown import winners

        return winners(run)

    def _answers(self, folder: RunFolder, block: AnswersBlock) -> pl.LazyFrame | None:
        """All answers of a block, to be read piece by piece."""
        names = folder.part_names(self.folder, block.id)
        return folder.scan(names) if names else None


METHOD = _Answers
