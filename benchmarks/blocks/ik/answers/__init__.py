"""Recorded answers: any number of IK problems by batch methods, drawn part by part, every answer judged and kept."""

from __future__ import annotations

from collections.abc import Iterable

import polars as pl

from benchmarks.blocks.base import BlockRows, Compared, Kind, Part
from benchmarks.blocks.ik.answers.measures import MEASURES, compared_answers, distribution, summary
from benchmarks.blocks.ik.answers.run import AnswersWork, check, parts, solve, store_hash
from benchmarks.blocks.ik.answers.settings import AnswersBlock
from benchmarks.records import RunFolder
from benchmarks.targets import Target


class _Answers(Kind):
    """Blocks of recorded answers: ``[[answers]]`` of a suite. Their `rows` are sums over the answers, a row a method."""

    name = "answers"
    title = "Recorded answers"
    block = AnswersBlock
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

    def prepare(self, block: AnswersBlock, seed: int) -> tuple[int, str]:
        return seed, check(block, seed)

    def parts(self, block: AnswersBlock, prepared: tuple[int, str], folder: RunFolder) -> Iterable[Part]:
        seed, sha256 = prepared
        store_hash(folder, block, sha256)
        return parts(block, seed, self.folder)

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

    def _answers(self, folder: RunFolder, block: AnswersBlock) -> pl.LazyFrame | None:
        """All answers of a block, to be read piece by piece."""
        names = folder.part_names(self.folder, block.id)
        return folder.scan(names) if names else None


METHOD = _Answers
