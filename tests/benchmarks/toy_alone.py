"""The kind of block of `toy`, timed alone in the first process."""

from __future__ import annotations

from typing import Any

from benchmarks.blocks.base import Part
from benchmarks.records import RunFolder
from tests.benchmarks.toy import Toy, ToyBlock


class Alone(Toy):
    name = "alone"
    alone = True

    def parts(self, block: ToyBlock, prepared: Any, folder: RunFolder) -> tuple[Part, ...]:  # type: ignore[override]
        return ()


METHOD = Alone
