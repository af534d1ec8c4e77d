"""Run one part in any process; the outcome is its rows, or a failure with the reason."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import polars as pl

from benchmarks.blocks.base import Kind
from optik.errors import OptikError
from optik.plugins.files import expect

_one_at_a_time = threading.Lock()
"""A lock, because a worker of a cluster may have several threads, and methods need not be thread-safe."""


@dataclass(frozen=True)
class Failure:
    """Why some work has no rows.

    Attributes
    ----------
    why : str
        The reason: a crashed process, a time limit, or an error.
    again : bool
        Whether a second attempt may succeed: after a crash or a hang, which may have another cause.
    """

    why: str
    again: bool


Outcome = pl.DataFrame | Failure | OptikError
"""Outcome of some work; an OptikError ends the run, because the user can correct it."""


class Place(Protocol):
    """What runs work: this process, worker processes, an executor, or a cluster."""

    @property
    def room(self) -> int:
        """Number of parts that it holds at a time."""

    def submit(self, ticket: int, kind: Kind, work: Any) -> None:
        """Submit work."""

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Wait for outcomes; at least one, if there is work."""

    def close(self) -> None:
        """End all processes that it started; unfinished work is lost."""


def attempt(kind: Kind, work: Any, recorded: Sequence[Mapping[str, str]] = ()) -> Outcome:
    """Run work in this process; return its rows, or the error."""
    try:
        with _one_at_a_time:
            expect(recorded)
            rows: Any = kind.solve(work)
    except OptikError as error:
        return error
    except Exception as error:  # a method or a peer may raise any
        return Failure(words_of_error(error), again=False)
    if isinstance(rows, pl.DataFrame):
        return rows
    return Failure(f"solve() returned a {type(rows).__name__} instead of a DataFrame", again=False)


def words_of_error(error: BaseException) -> str:
    """Format an error on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300].rstrip(": ")
