"""Worker processes, each with a pipe of its own, which attributes a crash or a hang to the work that caused it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.process import BaseProcess
from typing import Any

from benchmarks.blocks.base import Kind
from benchmarks.run.work import Failure, Outcome, attempt
from optik.errors import OptikError

START_SECONDS = 300.0
"""Time limit for a worker to import optik [s]: a loaded machine may take tens of seconds."""


class WorkerFailed(OptikError, RuntimeError):
    """A worker process that ended before its first work."""


class Workers:
    """A pool of worker processes."""

    def __init__(self, count: int, recorded: Sequence[Mapping[str, str]], limit: float) -> None:
        self.room = count
        self._recorded, self._limit = list(recorded), limit
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []

    def submit(self, ticket: int, kind: Kind, work: Any) -> None:
        """Give work to an idle worker, or to a new one."""
        worker = self._idle.pop() if self._idle else _Worker(self._recorded)
        self._busy.append(worker)
        worker.give(ticket, (kind, work), self._limit)

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Wait for outcomes."""
        found: list[tuple[int, Outcome]] = []
        while not found:
            until = min(worker.until for worker in self._busy)
            ready = wait([worker.pipe for worker in self._busy], timeout=max(until - time.monotonic(), 0.0))
            for worker in list(self._busy):
                outcome = worker.outcome() if worker.pipe in ready else worker.overdue()
                if outcome is None:
                    continue
                self._busy.remove(worker)
                if worker.process.is_alive():
                    self._idle.append(worker)
                found.append((worker.ticket, outcome))
        return found

    def close(self) -> None:
        """Kill all workers; they hold no files."""
        for worker in (*self._busy, *self._idle):
            worker.end()
        self._busy, self._idle = [], []


class _Worker:
    """One process, its pipe and its current work."""

    def __init__(self, recorded: list[Mapping[str, str]]) -> None:
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process: SpawnProcess = context.Process(target=_serve, args=(other, recorded))
        start(self.process)
        other.close()  # the end of the process then ends the pipe
        self.ticket, self.ready, self._limit = -1, False, 0.0
        self.until = time.monotonic() + START_SECONDS

    def give(self, ticket: int, work: tuple[Kind, Any], limit: float) -> None:
        self.ticket, self._limit = ticket, limit
        if self.ready:
            self.until = time.monotonic() + limit
        with suppress(OSError):  # it has crashed: `outcome` reports that
            self.pipe.send(work)

    def outcome(self) -> Outcome | None:
        """Return what the process sent; None for the message that it has started."""
        try:
            came = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(timeout=5.0)
            how = ending(self.process.exitcode)
            self.end()
            if not self.ready:
                raise WorkerFailed(f"a worker process could not start: {how}") from None
            return Failure(f"its process ended: {how}", again=True)
        if self.ready:
            return came  # type: ignore[no-any-return]
        self.ready, self.until = True, time.monotonic() + self._limit
        return None

    def overdue(self) -> Outcome | None:
        """End the process if its time is over."""
        if time.monotonic() < self.until:
            return None
        self.end()
        if not self.ready:
            raise WorkerFailed(f"a worker process did not start within {START_SECONDS:.0f} s")
        return Failure(f"no result within {self._limit:g} s", again=True)

    def end(self) -> None:
        self.process.kill()
        self.process.join(timeout=5.0)
        self.pipe.close()


def ending(status: int | None) -> str:
    """Describe how a process ended."""
    if status is not None and status < 0:
        try:
            return signal.Signals(-status).name
        except ValueError:
            return f"signal {-status}"
    return f"exit status {status}"


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Block Ctrl-C for processes that start in this context; only the main process handles it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start(process: BaseProcess) -> None:
    """Start a process that imports nothing from the working folder and does not receive Ctrl-C."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        with interrupts_held_back():
            process.start()
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


# ---------------------------------------------------------------- in the worker's process


def _serve(pipe: Connection, recorded: Sequence[Mapping[str, str]]) -> None:
    """Run work until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()
    try:
        pipe.send("ready")
        while True:
            kind, work = pipe.recv()
            pipe.send(attempt(kind, work, recorded))
    except (EOFError, OSError):
        return


def end_with_parent() -> None:
    """Wait for the main process to end, then end this process."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
