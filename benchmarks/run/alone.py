"""Work in the first process: a mark tells the next session what it died in, and then that is done in a process apart."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from benchmarks.kinds.base import Tell, load_kind
from benchmarks.records import Journal, RunFolder
from benchmarks.run.pool import end_with_parent, ending, start
from benchmarks.run.work import Failure, words_of_error
from optik.errors import OptikError
from optik.plugins.files import expect

MARK = ".working"
"""File of the mark in the run folder."""

DEATHS = 2
"""How often a process may die in the same work: once may be a kill, so it is tried a second time."""


class Mark:
    """What the first process has in hand: a file that is left only where the process died in the middle of it."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder, self._set = folder, False
        try:
            left = folder.read_json(MARK) or {}
        except OptikError:
            left = {}
        self._left = (str(left.get("work", "")), int(left.get("deaths", 0) or 0)) if isinstance(left, dict) else ("", 0)

    def deadly(self, work: str) -> bool:
        """Whether the first process died in some work as often as it may."""
        return self._left[0] == work and self._left[1] >= DEATHS

    def died_in(self, work: str) -> bool:
        """Whether the first process died in some work."""
        return self._left[0] == work

    def set(self, work: str) -> None:
        """Say what is begun now."""
        deaths = self._left[1] + 1 if self._left[0] == work else 1
        self._folder.write_json(MARK, {"work": work, "deaths": deaths})
        self._set = True

    def clear(self) -> None:
        """Say that nothing is in hand, where anything was said; what an earlier process has left stays."""
        if self._set:
            (self._folder.path / MARK).unlink(missing_ok=True)


class Apart(NamedTuple):
    """A block that is done in a process of its own, which may die.

    Attributes
    ----------
    kind : str
        What its kind is found by.
    block : Block
        The block.
    seed : int
        Of the suite.
    folder : RunFolder
        The run.
    recorded : sequence of mapping
        Plug-ins as the run has recorded them.
    """

    kind: str
    block: Any
    seed: int
    folder: RunFolder
    recorded: Sequence[Mapping[str, str]]


def finish_apart(work: Apart, journal: str, tell: Tell) -> Failure | None:
    """Do what a block lacks without the methods that end their process.

    A method in whose work a process ended is tried a second time, since the first may have been the machine's fault. Then
    it is recorded as crashed, and the block goes on with the others.
    """
    ends = Counter([Journal(work.folder, journal).left])
    while True:
        failure = run_apart(work, tell)
        if failure is None or not failure.again:
            return failure
        after = Journal(work.folder, journal)
        if not after.left or after.left in after.crashed:  # in no method's work
            return failure
        ends[after.left] += 1
        if ends[after.left] >= DEATHS:
            after.blame(after.left, failure.why)


def run_apart(work: Apart, tell: Tell) -> Failure | None:
    """Do what a block lacks in a process of its own."""
    context = get_context("spawn")
    pipe, other = context.Pipe(duplex=False)
    given = (work.kind, work.block, work.seed, str(work.folder.path), list(work.recorded))
    process = context.Process(target=_run, args=(other, *given))
    try:
        start(process)
        other.close()
        try:
            while isinstance(told := pipe.recv(), _Next):
                tell(told.what)
        except EOFError:
            process.join()
            return Failure(f"its process ended: {ending(process.exitcode)}", again=True)
    finally:
        process.kill()
        process.join()
    if isinstance(told, OptikError):
        raise told
    return None if told is None else Failure(str(told), again=False)


@dataclass(frozen=True)
class _Next:
    """What the process does next, for the progress bar."""

    what: str


def _run(pipe: Connection, kind: str, block: Any, seed: int, folder: str, recorded: list[Mapping[str, str]]) -> None:
    """The process: tell what is next, and at last the error that was raised, or None."""
    threading.Thread(target=end_with_parent, daemon=True).start()
    told: Any = None
    try:
        expect(recorded)
        load_kind(kind).run(block, seed, RunFolder(folder), lambda what: pipe.send(_Next(what)))
    except OptikError as error:
        told = error
    except Exception as error:  # a method or a peer may raise any
        told = words_of_error(error)
    pipe.send(told)
