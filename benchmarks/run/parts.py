"""Parts of a run: work that crashes or hangs is repeated apart, then divided to find the problems that cause it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable
from concurrent.futures import Future
from itertools import islice
from typing import Any, NamedTuple

import polars as pl

from benchmarks.blocks.base import Kind, Part
from benchmarks.run.pool import Failure, Pool

MOST_CRASHES = 3
"""Largest number of crashing problems to find per method; later failures of the method are not divided."""


class Done(NamedTuple):
    """The result of a part."""

    part: Part
    rows: pl.DataFrame | None  # None if it failed and its work defines no rows for crashes
    crashes: list[str]  # reasons of failures


def solve_parts(parts: Iterable[tuple[Kind, Part]], pool: Pool) -> Generator[Done]:
    """Run parts, and yield their results.

    Work that crashes its process or exceeds its time limit is repeated apart. If it fails again, or raises an error, it is
    divided until the problems that cause the failure are found. These get the rows of the method `crashed` of the work.
    """
    source, division = iter(parts), _Division(pool)
    in_hand: dict[Future[Any], tuple[Kind, Part]] = {}
    try:
        while True:
            for kind, part in islice(source, pool.room - len(in_hand)):
                in_hand[pool.submit(solve, kind, part.work)] = kind, part
            if not in_hand:
                return
            for future in [*pool.wait(in_hand)]:
                kind, part = in_hand.pop(future)
                yield division.done(kind, part, pool.outcome(future))
    finally:
        for future in in_hand:
            future.cancel()


def solve(kind: Kind, work: Any) -> pl.DataFrame:
    """Return the rows of some work."""
    rows: Any = kind.solve(work)
    if not isinstance(rows, pl.DataFrame):
        raise TypeError(f"solve() returned a {type(rows).__name__} instead of a DataFrame")
    return rows


class _Division:
    """The division of parts that failed."""

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._crashes: Counter[tuple[str, str]] = Counter()

    def done(self, kind: Kind, part: Part, outcome: pl.DataFrame | Failure) -> Done:
        """Return the result of a part."""
        if isinstance(outcome, Failure) and outcome.again:
            outcome = self._pool.run_apart(solve, kind, part.work)
        crashes: list[str] = []
        frames = self._rows(kind, part, part.work, outcome, crashes)
        rows = frames[0] if len(frames) == 1 else pl.concat(frames, how="vertical_relaxed") if frames else None
        return Done(part, rows, crashes)

    def _rows(self, kind: Kind, part: Part, work: Any, outcome: Any, crashes: list[str]) -> list[pl.DataFrame]:
        """Return the rows of work in the order of its problems, divided if it failed, and add the reasons of failures."""
        if isinstance(outcome, pl.DataFrame):
            return [outcome]
        method, dividable = (kind.name, part.label), hasattr(work, "crashed")
        halves = work.halves() if dividable and self._crashes[method] < MOST_CRASHES else ()
        if halves:
            pairs = ((half, self._pool.run_apart(solve, kind, half)) for half in halves)
            return [frame for half, came in pairs for frame in self._rows(kind, part, half, came, crashes)]
        self._crashes[method] += 1
        crashes.append(outcome.why)
        return [work.crashed()] if dividable else []
