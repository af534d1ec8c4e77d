"""Parts of a run: work that crashes or hangs is tried again, then divided to find the problems that cause it."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import polars as pl

from benchmarks.blocks.base import Kind, Part
from benchmarks.run.work import Failure, Outcome, Place

MOST_CRASHES = 3
"""Largest number of crashing problems to find per method; later failures of the method are not divided."""


@dataclass
class Done:
    """The result of a part.

    Attributes
    ----------
    part : Part
        The part.
    rows : DataFrame or None
        Its rows; None if it failed and its work defines no rows for crashes.
    crashes : list of str
        Reasons of failures in the part.
    """

    part: Part
    rows: pl.DataFrame | None
    crashes: list[str] = field(default_factory=list)


@dataclass
class _Task:
    """A part with the results of its pieces so far."""

    kind: Kind
    part: Part
    rows: dict[tuple[int, ...], pl.DataFrame] = field(default_factory=dict)
    crashes: list[str] = field(default_factory=list)
    open: int = 0
    lost: bool = False

    def done(self) -> Done:
        frames = [self.rows[order] for order in sorted(self.rows)]
        rows = frames[0] if len(frames) == 1 else pl.concat(frames, how="vertical_relaxed") if frames else None
        return Done(self.part, None if self.lost else rows, self.crashes)


@dataclass
class _Piece:
    """The work of a part, or of a piece of it after repeated halving."""

    task: _Task
    work: Any
    order: tuple[int, ...] = ()
    tries: int = 0


def solved(parts: Iterable[tuple[Kind, Part]], place: Place) -> Iterator[Done]:
    """Run parts, and yield their results.

    Work that crashes its process or hangs is tried a second time. If it fails again, or raises an error, it is divided until
    the problems that cause the failure are found. These get the rows of the method `crashed` of the work.
    """
    runner = _Runner(place)
    source = iter(parts)
    for kind, part in source:
        runner.start(_Piece(_Task(kind, part), part.work))
        while runner.full:
            yield from runner.wait()
    while runner.busy:
        yield from runner.wait()


class _Runner:
    """Running pieces of work, and those that wait."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._waiting: deque[_Piece] = deque()
        self._at_work: dict[int, _Piece] = {}
        self._tickets = 0
        self._crashes: Counter[tuple[str, str]] = Counter()

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self._at_work)

    @property
    def full(self) -> bool:
        return len(self._at_work) >= self._place.room or bool(self._waiting)

    def start(self, piece: _Piece) -> None:
        piece.task.open += 1
        self._waiting.appendleft(piece)  # halves first, to find the crashing problems soon
        self._fill()

    def _fill(self) -> None:
        while self._waiting and len(self._at_work) < self._place.room:
            piece = self._waiting.popleft()
            piece.tries += 1
            self._tickets += 1
            self._at_work[self._tickets] = piece
            self._place.submit(self._tickets, piece.task.kind, piece.work)

    def wait(self) -> Iterator[Done]:
        for ticket, outcome in self._place.wait():
            piece = self._at_work.pop(ticket)
            piece.task.open -= 1
            self._take(piece, outcome)
            self._fill()
            if not piece.task.open:
                yield piece.task.done()

    def _take(self, piece: _Piece, outcome: Outcome) -> None:
        """Keep the rows of a piece, or handle its failure."""
        if isinstance(outcome, pl.DataFrame):
            piece.task.rows[piece.order] = outcome
        elif isinstance(outcome, Failure):
            self._failed(piece, outcome)
        else:
            raise outcome

    def _failed(self, piece: _Piece, failure: Failure) -> None:
        """Try a piece again, divide it, or record it as crashed."""
        if failure.again and piece.tries == 1 and not piece.order:
            self.start(piece)
            return
        task, method = piece.task, (piece.task.kind.name, piece.task.part.label)
        if not hasattr(piece.work, "crashed"):
            task.lost = True
            task.crashes.append(failure.why)
            return
        halves = piece.work.halves() if self._crashes[method] < MOST_CRASHES else ()
        for index, half in reversed(list(enumerate(halves))):
            self.start(_Piece(task, half, (*piece.order, index)))
        if not halves:
            self._crashes[method] += 1
            task.rows[piece.order] = piece.work.crashed()
            task.crashes.append(failure.why)
