"""Settings of blocks of recorded answers."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import model_validator

from benchmarks.blocks._entries import Method
from benchmarks.blocks._problems import ProblemBlock
from benchmarks.blocks.base import Entry
from benchmarks.blocks.ik.answers.measures import MEASURES
from benchmarks.settings import Count, Entries, key
from benchmarks.targets import Measure
from optik.errors import InvalidInput

DRAWN_AT_ONCE = 1000
"""Problems that are drawn together, with a seed of their own: any part of a block can be drawn without the rest."""

ANSWERS_PART = 50_000
"""Default number of problems in one part: a second of work, and a megabyte of rows."""


class AnswersBlock(ProblemBlock):
    """One problem set on one robot, solved by some methods in batches, every answer recorded."""

    noun = "answers"
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    count: Count = key("Number of problems, up to many millions.")
    part: Count = key("Number of problems in one part of the work.", ANSWERS_PART)
    methods: Annotated[tuple[Entry, ...], Entries(Method)] = key("IK methods, which solve in batches.")

    @model_validator(mode="after")
    def _counts_once(self) -> AnswersBlock:
        if "count" in self.options:
            raise InvalidInput("options", "count", "the key `count` of the block in its place")
        return self

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods."""
        return self.methods
