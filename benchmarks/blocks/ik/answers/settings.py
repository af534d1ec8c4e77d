"""Settings of blocks of recorded answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.blocks._entries import check_labels, read_method
from benchmarks.blocks._problems import ProblemBlock, named, read_problems
from benchmarks.blocks.base import Entry
from benchmarks.blocks.ik.answers.measures import MEASURES
from benchmarks.settings import all_of, check_list
from benchmarks.targets import read_target
from optik.check import check_count
from optik.errors import InvalidInput

DRAWN_AT_ONCE = 1000
"""Problems that are drawn together, with a seed of their own: any part of a block can be drawn without the rest."""

ANSWERS_PART = 50_000
"""Problems in one part where the suite does not say: a second of work, and a megabyte of rows."""


@dataclass(frozen=True, kw_only=True)
class AnswersBlock(ProblemBlock):
    """One problem set on one robot, solved by some methods in batches, every answer recorded.

    Attributes
    ----------
    count : int
        How many problems.
    part : int
        How many in one part of the work.
    methods : tuple of Entry
        The IK methods.
    """

    count: int
    part: int
    methods: tuple[Entry, ...]

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods."""
        return self.methods


def read_block(data: Any) -> AnswersBlock:
    """Check the settings of a block of recorded answers and return it."""
    where = named(data, "answers")
    shared = read_problems(data, where, {"count", "part", "methods", "targets"}, {"count", "methods"})
    if "count" in shared["options"]:
        raise InvalidInput(f"{where}: options", "count", "the key `count` of the block in its place")
    part = data.get("part", ANSWERS_PART)
    check_count(data["count"], f"{where}: count", 1)
    check_count(part, f"{where}: part", 1)
    methods = tuple(read_method(one, where) for one in check_list(data["methods"], f"{where}: methods"))
    labels = check_labels(methods, f"{where}: methods")
    targets = all_of(data.get("targets"), where, lambda one: read_target(one, where, MEASURES, labels=labels))
    return AnswersBlock(**shared, count=data["count"], part=part, methods=methods, targets=targets)
