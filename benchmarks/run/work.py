"""Do one part of a run in any process, and say what came of it: rows, or why there are none."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import polars as pl

from benchmarks.kinds.base import load_kind
from optik.errors import OptikError
from optik.plugins.files import expect

_one_at_a_time = threading.Lock()
"""A worker of a cluster may have several threads; methods and peers need not be fit for that."""


@dataclass(frozen=True)
class Failure:
    """Why some work brought no rows.

    Attributes
    ----------
    why : str
        In words: how its process ended, that the time was over, or the error that was raised.
    again : bool
        Whether a second attempt may go better: where the process died or hung, which may be the machine's fault.
    """

    why: str
    again: bool


Outcome = pl.DataFrame | Failure | OptikError
"""What comes of some work; an error of ours is the user's to mend, and ends the run."""


class Place(Protocol):
    """Where work is done: this process, others, an executor, or a cluster."""

    @property
    def room(self) -> int:
        """How many pieces of work it takes at a time."""

    def submit(self, ticket: int, kind: str, work: Any) -> None:
        """Take a piece of work."""

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Wait for outcomes; at least one, where there is work."""

    def close(self) -> None:
        """End all processes that were started; work in hand is lost."""


def attempt(kind: str, work: Any, recorded: Sequence[Mapping[str, str]] = ()) -> Outcome:
    """Do some work in this process; whatever is raised is returned."""
    try:
        with _one_at_a_time:
            expect(recorded)
            rows: Any = load_kind(kind).solve(work)
    except OptikError as error:
        return error
    except Exception as error:  # a method or a peer may raise any
        return Failure(words_of_error(error), again=False)
    if isinstance(rows, pl.DataFrame):
        return rows
    return Failure(f"solve() returned {type(rows).__name__}, no table", again=False)


def words_of_error(error: BaseException) -> str:
    """An error on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300].rstrip(": ")
