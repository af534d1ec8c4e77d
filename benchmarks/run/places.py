"""Places that run parts: this process, and any executor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any

from benchmarks.blocks.base import Kind
from benchmarks.run.work import Outcome, attempt

IN_FLIGHT = 64
"""Parts that an executor holds at a time: enough for as many workers, with arrays that fit in memory."""


class Here:
    """The main process, which runs one part at a time."""

    room = 1

    def __init__(self) -> None:
        self._work: list[tuple[int, Kind, Any]] = []

    def submit(self, ticket: int, kind: Kind, work: Any) -> None:
        """Keep work until `wait`."""
        self._work.append((ticket, kind, work))

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Run the work."""
        ticket, kind, work = self._work.pop(0)
        return [(ticket, attempt(kind, work))]

    def close(self) -> None:
        """Do nothing, because no process was started."""


class OnExecutor:
    """An executor of the caller, such as one of `concurrent.futures`."""

    room = IN_FLIGHT

    def __init__(self, executor: Executor, recorded: Sequence[Mapping[str, str]]) -> None:
        self._submit: Callable[..., Future[Outcome]] = executor.submit
        self._recorded = list(recorded)
        self._tickets: dict[Future[Outcome], int] = {}

    def submit(self, ticket: int, kind: Kind, work: Any) -> None:
        """Submit work."""
        self._tickets[self._submit(attempt, kind, work, self._recorded)] = ticket

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Wait for outcomes."""
        done = wait(self._tickets, return_when=FIRST_COMPLETED).done
        return [(self._tickets.pop(future), future.result()) for future in done]

    def close(self) -> None:
        """Cancel work that has not started."""
        for future in self._tickets:
            future.cancel()
