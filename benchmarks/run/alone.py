"""Work in the first process: a mark tells the next session what it died in, and then that is done in a process apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from benchmarks.kinds.base import load_kind
from benchmarks.records import RunFolder
from benchmarks.run.pool import ending, interrupts_held_back
from benchmarks.run.work import Failure, words_of_error
from optik.errors import OptikError
from optik.plugins.files import expect

MARK = ".working"
"""File of the mark in the run folder."""

DEATHS = 2
"""How often the first process may die in the same work: once may be a kill, so it is tried a second time."""


class Mark:
    """What the first process has in hand: a file that is left only where the process died in the middle of it.

    Parameters
    ----------
    folder : RunFolder
        The run.
    """

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        try:
            left = folder.read_json(MARK) or {}
        except OptikError:
            left = {}
        self._left = (str(left.get("work", "")), int(left.get("deaths", 0) or 0)) if isinstance(left, dict) else ("", 0)

    def deadly(self, work: str) -> bool:
        """Whether the first process died in some work as often as it may.

        Parameters
        ----------
        work : str
            Name of the file that it is to write.

        Returns
        -------
        bool
            True where it is better done in a process apart.
        """
        return self._left[0] == work and self._left[1] >= DEATHS

    def set(self, work: str) -> None:
        """Say what is begun now.

        Parameters
        ----------
        work : str
            Name of the file that it is to write.
        """
        deaths = self._left[1] + 1 if self._left[0] == work else 1
        self._folder.write_json(MARK, {"work": work, "deaths": deaths})

    def clear(self) -> None:
        """Say that nothing is in hand."""
        (self._folder.path / MARK).unlink(missing_ok=True)


def run_apart(
    kind: str, block: Any, seed: int, folder: RunFolder, recorded: Sequence[Mapping[str, str]]
) -> Failure | None:
    """Do what a block lacks in a process of its own, which may die.

    Parameters
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

    Returns
    -------
    Failure or None
        Why it failed.

    Raises
    ------
    OptikError
        One that the work raised.
    """
    context = get_context("spawn")
    pipe, other = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(other, kind, block, seed, str(folder.path), list(recorded)))
    try:
        with interrupts_held_back():
            process.start()
        other.close()
        try:
            error = pipe.recv()
        except EOFError:
            process.join()
            return Failure(f"its process ended: {ending(process.exitcode)}", again=False)
    finally:
        process.kill()
        process.join()
    if isinstance(error, OptikError):
        raise error
    return None if error is None else Failure(str(error), again=False)


def _run(pipe: Connection, kind: str, block: Any, seed: int, folder: str, recorded: list[Mapping[str, str]]) -> None:
    """The process: tell the error that was raised, or None."""
    told: Any = None
    try:
        expect(recorded)
        load_kind(kind).run(block, seed, RunFolder(folder), lambda what: None)
    except OptikError as error:
        told = error
    except Exception as error:  # a method or a peer may raise any
        told = words_of_error(error)
    pipe.send(told)
