"""Processes for the parts of a run; work that crashes is repeated apart, then divided to find the cause."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, NamedTuple

import polars as pl

from benchmarks.blocks.base import Shard, Work
from optik.errors import OptikError
from optik.plugins.files import expect

# ---------------- processes that do the parts of a run


IN_FLIGHT = 64
"""Largest number of parts submitted at once to an executor that the caller gave: enough workers, and arrays fit in memory."""

START_SECONDS = 300.0
"""Time limit for a worker to import optik [s]: a loaded machine may take tens of seconds."""

MOST_STARTS = 3
"""Attempts to start the workers: a loaded machine may end a process that starts."""

_one_at_a_time = threading.Lock()
"""A lock, because the executor of the caller may have several threads, and methods need not be thread-safe."""


class PoolLost(OptikError, RuntimeError):
    """The loss of an executor or of the ability to start worker processes."""


@dataclass(frozen=True)
class Failure:
    """Reason why some work has no result: a crashed process, a time limit, or an error."""

    why: str
    again: bool  # a second attempt may succeed: after a crash or a time limit, which other work may have caused


def attempt(recorded: Sequence[Mapping[str, str]], function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in this process, if plug-ins are as recorded; return its result, or the error.

    An OptikError ends the run, because the user can correct it. Any other error is a `Failure`.
    """
    try:
        with _one_at_a_time:
            expect(recorded)
            return function(*arguments)
    except OptikError as error:
        return error
    except (Exception, SystemExit) as error:  # a method or a peer may raise any
        return Failure(words_of_error(error), again=False)


def words_of_error(error: BaseException) -> str:
    """Format an error on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300].rstrip(": ")


class Pool:
    """An executor, and the number of parts that it has at a time."""

    is_here = False
    """Whether work runs in this process."""

    def __init__(self, executor: Any, room: int, recorded: Sequence[Mapping[str, str]]) -> None:
        self._executor, self.room, self._recorded = executor, room, list(recorded)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit work."""
        future: Future[Any] = self._executor.submit(attempt, self._recorded, function, *arguments)
        return future

    def wait(self, futures: Collection[Future[Any]]) -> Collection[Future[Any]]:
        """Wait until some of these futures are done, and return them."""
        return wait(futures, return_when=FIRST_COMPLETED).done

    def outcome(self, future: Future[Any]) -> Any:
        """Return the result of work, or its `Failure`; raise its OptikError."""
        try:
            result = future.result()
        except (BrokenExecutor, CancelledError) as error:
            raise PoolLost(f"lost the executor ({words_of_error(error)}); repeat the command to resume") from None
        if isinstance(result, OptikError):
            raise result
        return result

    def run_apart(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the outcome of work that shares no worker process with other work."""
        future = self.submit(function, *arguments)
        self.wait([future])
        return self.outcome(future)

    def close(self) -> None:
        """End all processes that this pool started; unfinished work is lost."""


class ThisProcess(Pool):
    """The main process, which runs one part at a time, when it is submitted."""

    is_here = True

    def __init__(self, recorded: Sequence[Mapping[str, str]]) -> None:
        super().__init__(None, 1, recorded)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run work."""
        future: Future[Any] = Future()
        future.set_result(attempt(self._recorded, function, *arguments))
        return future


# ---------------------------------------------------------------- worker processes


class Processes(Pool):
    """Worker processes. All of them are started anew after one has crashed, or after the time limit of some work.

    The crash of a process does not tell whose work caused it. All work in hand then fails, for a second attempt apart.
    """

    def __init__(self, room: int, recorded: Sequence[Mapping[str, str]], limit: float | None = None) -> None:
        super().__init__(None, room, recorded)
        self._limit = limit
        self._due: dict[Future[Any], float] = {}
        self._why = ""
        self._apart: Processes | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit work to the workers, of which at least one is idle."""
        if self._executor is None:
            self._start()
        try:
            future = super().submit(function, *arguments)
        except BrokenProcessPool:  # an idle worker has ended
            self._end()
            return self.submit(function, *arguments)
        self._due[future] = time.monotonic() + (self._limit or threading.TIMEOUT_MAX)
        return future

    def wait(self, futures: Collection[Future[Any]]) -> Collection[Future[Any]]:
        """Wait until some of these futures are done, or until the time limit of one of them, which ends all."""
        left = min(self._due[future] for future in futures) - time.monotonic()
        done = wait(futures, min(max(left, 0.0), threading.TIMEOUT_MAX), FIRST_COMPLETED).done
        if done and not any(isinstance(future.exception(), BrokenProcessPool) for future in done):
            return done
        self._end("" if done else f"no result within {self._limit:g} s")
        return futures

    def outcome(self, future: Future[Any]) -> Any:
        """Return the result of work, or its `Failure`; raise its OptikError."""
        del self._due[future]
        if isinstance(future.exception(), BrokenProcessPool):
            return Failure(self._why, again=True)
        return super().outcome(future)

    def run_apart(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the outcome of work that shares no worker process with other work."""
        if self.room == 1:
            return super().run_apart(function, *arguments)
        self._apart = self._apart or Processes(1, self._recorded, self._limit)
        return self._apart.run_apart(function, *arguments)

    def close(self) -> None:
        """Kill all workers; they hold no files."""
        self._end()
        if self._apart is not None:
            self._apart.close()

    def _start(self) -> None:
        """Start all workers, so that the time limit of work does not include imports."""
        for _ in range(MOST_STARTS):
            with _safe_start():
                self._executor = ProcessPoolExecutor(self.room, _Spawn())
            try:
                for future in [self._executor.submit(bool) for _ in range(self.room)]:
                    future.result(START_SECONDS)
                return
            except BrokenProcessPool:
                self._end()
            except TimeoutError:
                self._end(f"not ready within {START_SECONDS:g} s")
        raise PoolLost(f"a worker process could not start: {self._why}")

    def _end(self, why: str = "") -> None:
        """Kill all workers, and keep why they have ended."""
        if self._executor is None:
            return
        processes = [*self._executor._processes.values()]
        for process in processes:
            process.kill()
        self._executor._result_queue._writer.close()  # a thread may wait for the rest of a result
        self._executor.shutdown()
        for process in processes:
            process.join()
        self._executor = None
        self._why = why or f"its process ended: {_ending(max((p.exitcode for p in processes), default=0))}"


def _ending(status: int) -> str:
    """Describe how a process ended."""
    try:
        return signal.Signals(-status).name if status < 0 else f"exit status {status}"
    except ValueError:
        return f"signal {-status}"


class Child(SpawnProcess):
    """A process that ends with the main one, imports nothing from the working folder and does not receive Ctrl-C."""

    def start(self) -> None:
        """Start the process."""
        with _safe_start():
            super().start()

    def run(self) -> None:
        """Run the work of the process, in it."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=_end_with_parent, daemon=True).start()
        super().run()


class _Spawn(SpawnContext):
    """The way in which a pool starts its processes."""

    Process = Child


def _end_with_parent() -> None:
    """Wait for the main process to end, then end this process."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _safe_start() -> Iterator[None]:
    """Block Ctrl-C for processes that start in this context, and let them import nothing from the working folder."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    masks = hasattr(signal, "pthread_sigmask")
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else set()
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


MOST_CRASHES = 3
"""Largest number of crashing problems to find per method; later failures of the method are not divided."""


class Done(NamedTuple):
    """The result of a shard."""

    shard: Shard
    rows: pl.DataFrame | None  # None if it failed and its work defines no rows for crashes
    crashes: list[str]  # reasons of failures
    repeated: str = ""  # why the work was repeated, with success


def solve_shards(shards: Iterable[Shard], pool: Pool) -> Generator[Done]:
    """Run shards, and yield their results.

    Work that crashes its process or exceeds its time limit is repeated apart. If it fails again, or raises an error, it is
    divided until the problems that cause the failure are found. These get the rows of the method `crashed` of the work.
    """
    source, division = iter(shards), _Division(pool)
    in_hand: dict[Future[Any], Shard] = {}
    try:
        while True:
            for shard in islice(source, pool.room - len(in_hand)):
                in_hand[pool.submit(solve, shard.work)] = shard
            if not in_hand:
                return
            for future in [*pool.wait(in_hand)]:
                yield division.done(in_hand.pop(future), pool.outcome(future))
    finally:
        for future in in_hand:
            future.cancel()


def solve(work: Work) -> pl.DataFrame:
    """Return the rows of some work."""
    rows: Any = work.solve()
    if not isinstance(rows, pl.DataFrame):
        raise TypeError(f"solve() returned a {type(rows).__name__} instead of a DataFrame")
    return rows


class _Division:
    """The division of shards that failed."""

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._crashes: Counter[tuple[str, str]] = Counter()

    def done(self, shard: Shard, outcome: pl.DataFrame | Failure) -> Done:
        """Return the result of a shard."""
        first = outcome.why if isinstance(outcome, Failure) and outcome.again else ""
        if first:
            outcome = self._pool.run_apart(solve, shard.work)
        crashes: list[str] = []
        frames = self._rows(shard, shard.work, outcome, crashes)
        rows = frames[0] if len(frames) == 1 else pl.concat(frames, how="vertical_relaxed") if frames else None
        return Done(shard, rows, crashes, "" if crashes else first)

    def _rows(self, shard: Shard, work: Any, outcome: Any, crashes: list[str]) -> list[pl.DataFrame]:
        """Return the rows of work in the order of its problems, divided if it failed, and add the reasons of failures."""
        if isinstance(outcome, pl.DataFrame):
            return [outcome]
        owner = work.owner
        method = shard.block, owner or shard.label
        halves = work.halves() if self._crashes[method] < MOST_CRASHES else ()
        if halves:
            pairs = ((half, self._pool.run_apart(solve, half)) for half in halves)
            return [frame for half, came in pairs for frame in self._rows(shard, half, came, crashes)]
        self._crashes[method] += 1
        crashes.append(f"{owner}: {outcome.why}" if owner else outcome.why)
        rows = work.crashed()
        return [] if rows is None else [rows]
