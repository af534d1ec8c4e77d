"""A kind of block of an installed package, for the tests of runs: squares, and problems that kill, hang or raise."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl
from pydantic import Field

from benchmarks.blocks.base import Kind, Session, Shard, Work
from benchmarks.blocks.block import Block

PACKAGE = str(Path(__file__).with_name("toy_dist"))
if PACKAGE not in sys.path:
    sys.path.append(PACKAGE)


@dataclass(frozen=True)
class ToyWork(Work):
    problems: tuple[int, ...]
    bad: dict[int, str]
    once: str

    def solve(self) -> pl.DataFrame:
        for problem in self.problems:
            act(self.bad.get(problem, ""), self.once)
        return pl.DataFrame({"problem": self.problems, "square": [float(p * p) for p in self.problems]})


@dataclass(frozen=True)
class Divisible(ToyWork):
    def halves(self) -> tuple[Divisible, ...]:
        half = len(self.problems) // 2
        both = (self.problems[:half], self.problems[half:])
        return tuple(replace(self, problems=p) for p in both) if half else ()

    def crashed(self) -> pl.DataFrame:
        return pl.DataFrame({"problem": self.problems, "square": [float("inf")] * len(self.problems)})


def act(how: str, once: str) -> None:
    if how == "dies":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "dies once" and not Path(once).exists():
        Path(once).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "hangs":
        time.sleep(3600)
    if how == "raises":
        raise ZeroDivisionError("on purpose")
    if how == "exits":
        sys.exit(3)
    if how == "waits":
        time.sleep(0.05)


class ToyBlock(Block):
    count: int = 12
    part: int = 4
    bad: dict[int, str] = Field(default_factory=dict)
    divisible: bool = True
    once: str = ""


class Toy(Kind):
    name = "toy"
    title = "Squares"
    block = ToyBlock
    alone = False

    def shards(self, block: ToyBlock, session: Session) -> Iterator[Shard]:
        made = Divisible if block.divisible else ToyWork
        for number, first in enumerate(range(0, block.count, block.part)):
            problems = tuple(range(first, min(first + block.part, block.count)))
            yield Shard(f"{number:03d}", made(problems, block.bad, block.once), block.id)


class Alone(Toy):
    """Timed alone in the first process."""

    name = "alone"
    alone = True

    def shards(self, block: ToyBlock, session: Session) -> Iterator[Shard]:
        def solve() -> pl.DataFrame:
            for problem in range(block.count):
                act(block.bad.get(problem, ""), block.once)
            return pl.DataFrame({"problem": range(block.count)})

        yield Shard("0000", solve, block.id)


TOY_COMMAND = [sys.executable, "-c", "import tests.benchmarks.toy; from benchmarks.cli.app import main; main()"]
"""`optik` with the toy kinds, run in the repository."""
