"""Timed blocks in the main process, and in a process of their own after a crash, which a mark in the run folder records."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from benchmarks.blocks.base import Kind, Tell
from benchmarks.records import Journal, RunFolder
from benchmarks.run.pool import end_with_parent, ending, start
from benchmarks.run.work import Failure, words_of_error
from optik.errors import OptikError
from optik.plugins.files import expect

MARK = ".working"
"""File of the mark in the run folder."""

DEATHS = 2
"""Crashes in the same work after which it is not repeated: a single one may be a kill."""


class Mark:
    """A file that names the current work of the main process; it remains only after a crash."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder, self._set = folder, False
        try:
            left = folder.read_json(MARK) or {}
        except OptikError:
            left = {}
        self._left = (str(left.get("work", "")), int(left.get("deaths", 0) or 0)) if isinstance(left, dict) else ("", 0)

    def deadly(self, work: str) -> bool:
        """Say whether the main process crashed in some work `DEATHS` times."""
        return self._left[0] == work and self._left[1] >= DEATHS

    def died_in(self, work: str) -> bool:
        """Say whether the main process crashed in some work."""
        return self._left[0] == work

    def set(self, work: str) -> None:
        """Record the start of some work."""
        deaths = self._left[1] + 1 if self._left[0] == work else 1
        self._folder.write_json(MARK, {"work": work, "deaths": deaths})
        self._set = True

    def clear(self) -> None:
        """Remove the mark of this process; keep that of an earlier one."""
        if self._set:
            (self._folder.path / MARK).unlink(missing_ok=True)


class Apart(NamedTuple):
    """A block that runs in a process of its own, which may crash.

    Attributes
    ----------
    kind : Kind
        Its kind.
    block : Block
        The block.
    seed : int
        Seed of the suite.
    folder : RunFolder
        Folder of the run.
    recorded : sequence of mapping
        Plug-ins that the run has recorded.
    """

    kind: Kind
    block: Any
    seed: int
    folder: RunFolder
    recorded: Sequence[Mapping[str, str]]


def finish_apart(work: Apart, journal: str, tell: Tell) -> Failure | None:
    """Complete a block without the methods that crash their process; return the failure, or None.

    A method that crashed is tried a second time, because the first crash may have another cause. After the second crash it is
    recorded as crashed, and the block continues with the other methods.
    """
    ends = Counter([Journal(work.folder, journal).left])
    while True:
        failure = run_apart(work, tell)
        if failure is None or not failure.again:
            return failure
        after = Journal(work.folder, journal)
        if not after.left or after.left in after.crashed:  # no method was at work
            return failure
        ends[after.left] += 1
        if ends[after.left] >= DEATHS:
            after.blame(after.left, failure.why)


def run_apart(work: Apart, tell: Tell) -> Failure | None:
    """Complete a block in a process of its own; return the failure, or None."""
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
    """A message with the next work of the process, for the progress bar."""

    what: str


def _run(pipe: Connection, kind: Kind, block: Any, seed: int, folder: str, recorded: list[Mapping[str, str]]) -> None:
    """Run a block in this process; send each next work, then the error or None."""
    threading.Thread(target=end_with_parent, daemon=True).start()
    told: Any = None
    try:
        expect(recorded)
        kind.run(block, seed, RunFolder(folder), lambda what: pipe.send(_Next(what)))
    except OptikError as error:
        told = error
    except Exception as error:  # a method or a peer may raise any
        told = words_of_error(error)
    pipe.send(told)
