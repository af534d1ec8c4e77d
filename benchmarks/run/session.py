"""Run a suite: first parts in any process, then blocks that are timed alone."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import closing, contextmanager, nullcontext, suppress
from functools import partial
from typing import Any

from benchmarks.blocks.base import Kind, Part, add_keys, hash_problems
from benchmarks.provenance import time_reference
from benchmarks.records import JOURNAL, Journal, RunFolder, failures, record_failures, update_manifest
from benchmarks.run.cluster import Cluster
from benchmarks.run.manifest import Lock, begun, new_manifest, resumed
from benchmarks.run.pool import IN_FLIGHT, Child, Failure, Pool, Processes, ThisProcess, solve_parts, words_of_error
from benchmarks.suite import Suite, suite_of
from optik.arm.library import load
from optik.check import check_count, check_number
from optik.errors import InvalidInput, OptikError
from optik.plugins.files import expect
from optik.plugins.usage import check_allowed
from optik.registry import own_names, short_name

Progress = Callable[[int, int, str], None]
"""Type of a callback with (finished parts, number of parts, name of the next one)."""

MOST_WORKERS = 4096
"""Largest number of processes: more than the cores of a machine."""

PART_SECONDS = 1800.0
"""Default time limit of a part in a worker process [s]: a part of the slowest method takes minutes."""


DEATHS = 2
"""Crashes in the same work after which it is not repeated: a single one may be a kill."""

WAIT_SECONDS = 600.0
"""Longest wait for `compiled_aside` before timed work [s]; the main process compiles the remaining kernels."""


def run_suite(
    suite: Suite,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    executor: Executor | None = None,
    dask: str = "",
    part_timeout: float | None = None,
    progress: Progress | None = None,
    command: str = "",
) -> RunFolder:
    """Run a suite, or resume an interrupted run.

    Parameters
    ----------
    suite : Suite
        The suite.
    out : path
        Folder of the run: new, empty, or with an interrupted run of the same suite and settings.
    workers : int
        Number of processes. More than one affects measured times, not results.
    executor : concurrent.futures.Executor, optional
        Executor that runs the parts in place of processes; the caller shuts it down.
    dask : str
        Address of a Dask scheduler whose workers run the parts in place of processes; empty for none.
    part_timeout : float, optional
        Time limit of a part in a worker process [s]; by default `PART_SECONDS` if there are several processes. With a limit,
        parts run in a worker process even if there is only one.
    progress : callable, optional
        Callback with (finished parts, number of parts, name of the next one).
    command : str
        Command that repeats the run, for the report.

    Returns
    -------
    RunFolder
        The finished run. ``failed`` of its manifest lists crashes; ``complete`` is true if every part has its rows.

    Raises
    ------
    OutputError
        The folder cannot be written, contains something else, or another process writes to it.
    InvalidInput
        An unknown option of a set or a method; a plug-in that is not allowed, or has changed since the start of the run; a
        damaged or foreign table in the folder; no cluster at that address.
    """
    check_allowed(suite.plugins, suite.allow_plugins)
    folder, manifest = RunFolder(out), new_manifest(suite, workers, command)
    resumed(folder, manifest)
    recorded = manifest["plugins"]
    with closing(_pool(workers, executor, dask, part_timeout, recorded)) as pool, begun(folder, manifest) as lock:
        expect(recorded)
        run = _Session(suite, folder, lock, recorded, progress or (lambda done, total, what: None))
        with compiled_aside(suite) if isinstance(pool, Processes) else nullcontext():
            run.prepare()
            run.do_parts(pool)
        pool.close()  # timed blocks share this machine with no worker
        run.do_alone()
        run.finish()
    return folder


def _pool(
    workers: int, executor: Executor | None, dask: str, limit: float | None, recorded: list[dict[str, str]]
) -> Pool:
    """Return the pool that runs the parts."""
    check_count(workers, "workers", 1, MOST_WORKERS)
    if limit is not None and check_number(limit, "part_timeout", "a time [s] above 0") <= 0.0:
        raise InvalidInput("part_timeout", limit, "a time [s] above 0")
    if executor is not None:
        return Pool(executor, IN_FLIGHT, recorded)
    if dask:
        return Cluster(dask, recorded)
    if workers == 1 and limit is None:
        return ThisProcess(recorded)
    return Processes(workers, recorded, limit or PART_SECONDS)


class _Session:
    """A run in progress."""

    def __init__(
        self, suite: Suite, folder: RunFolder, lock: Lock, recorded: list[dict[str, str]], tell: Progress
    ) -> None:
        self._suite, self._folder, self._lock, self._recorded, self._tell = suite, folder, lock, recorded, tell
        self._prepared: list[tuple[Kind, Any, Any]] = []
        self._alone = [(kind, block) for kind, block in suite.pairs() if kind.alone]
        self._done = self._total = 0
        self._reference: list[dict[str, float | None]] = []
        self._lacking: set[str] = set()

    def prepare(self) -> None:
        """Prepare every block, and record the robots that do not come with optik, so that a report needs no other files."""
        self._tell(0, 1, "problem sets")
        suite = self._suite
        self._prepared = [(kind, block, kind.prepare(block, suite.seed)) for kind, block in suite.pairs()]
        hashes = {f"{kind.name}/{block.id}": hash_problems(block, suite.seed) for kind, block in suite.pairs()}
        update_manifest(self._folder, problems=hashes)
        outside = [name for name in suite.robots if name not in own_names("optik.robots")]
        if outside:
            update_manifest(self._folder, robots={short_name(name): load(name).to_dict() for name in outside})

    def do_parts(self, pool: Pool) -> None:
        """Run all unfinished parts; a part that crashed the main process runs in a worker process."""
        self._total = len(self._alone)
        deadly = []
        for kind, part in self._todo():
            self._total += 1
            if pool.is_here and self._lock.crashes(part.file) >= DEATHS:
                deadly.append((kind, part))
        with closing(self._process(PART_SECONDS)) as apart:
            self._solve(deadly, apart)
        self._solve(self._marked() if pool.is_here else self._todo(), pool)

    def _process(self, limit: float | None) -> Processes:
        """Return a pool with one worker process, which starts with its first work."""
        return Processes(1, self._recorded, limit)

    def _todo(self) -> Iterator[tuple[Kind, Part]]:
        """Yield unfinished parts one by one, because each holds its problems in memory."""
        for kind, block, given in self._prepared:
            for part in kind.parts(block, given, self._folder):
                if not self._folder.has(part.file) and part.file not in self._lacking:
                    yield kind, part

    def _marked(self) -> Iterator[tuple[Kind, Part]]:
        """Yield parts for this process, and record each while it runs."""
        for kind, part in self._todo():
            self._tell(self._done, self._total, part.label)
            with self._lock.at_work(part.file):
                yield kind, part

    def _solve(self, parts: Iterable[tuple[Kind, Part]], pool: Pool) -> None:
        """Run parts, and write their rows and failures."""
        with closing(solve_parts(parts, pool)) as results:  # so that a second Ctrl-C, from Polars, is not lost in it
            for part, rows, crashes in results:
                if rows is None:
                    self._lacking.add(part.file)
                else:
                    self._folder.write(part.file, add_keys(part.block, rows))
                record_failures(self._folder, part.file, part.label, crashes)
                self._done += 1
                self._tell(self._done, self._total, part.label)

    def do_alone(self) -> None:
        """Run the blocks that are timed alone, one after another, in this process."""
        for kind, block in self._alone:
            self._reference.append(time_reference())
            failure = self._timed(kind, block)
            if failure is not None:
                self._lacking.add(kind.file(block))
            record_failures(self._folder, kind.file(block), block.title, [failure.why] if failure else [])
            self._done += 1
        self._tell(self._done, self._total, "done")

    def _timed(self, kind: Kind, block: Any) -> Failure | None:
        """Complete a block; return its failure, or None. A block that has failed may crash: it runs in another process."""
        name, seed, folder = kind.file(block), self._suite.seed, self._folder
        failed = (name, block.title) in [(one["file"], one["label"]) for one in failures(folder)]
        apart = failed or self._lock.crashes(name) > 0
        with self._lock.at_work(name):
            if apart:
                self._tell(self._done, self._total, f"{block.title}, in a separate process")
                with closing(self._process(None)) as pool:
                    return run_block_apart(pool, kind, block, seed, folder)
            try:
                kind.run(block, seed, folder, partial(self._tell, self._done, self._total))
            except OptikError:
                raise
            except Exception as error:  # a method or a peer may raise any
                return Failure(words_of_error(error), again=False)
        return None

    def finish(self) -> None:
        """Record whether the run is complete."""
        manifest = self._folder.manifest()
        if not manifest["complete"] or self._lacking:  # of the sessions before, and of this one
            times = [*manifest.get("reference", []), *self._reference, time_reference()]
            update_manifest(self._folder, complete=not self._lacking, reference=times)


# ---------------------------------------------------------------- blocks that are timed alone


def run_block_apart(pool: Pool, kind: Kind, block: Any, seed: int, folder: RunFolder) -> Failure | None:
    """Complete a block without the methods that crash their process; return the failure, or None.

    A method that crashed is tried a second time, because the first crash may have another cause. After the second crash it is
    recorded as crashed, and the block continues with the other methods.
    """
    name = kind.file(block, JOURNAL)
    ends = Counter([Journal(folder, name).left])
    while True:
        failure: Failure | None = pool.run_apart(_complete, kind, block, seed, folder)
        if failure is None or not failure.again:
            return failure
        journal = Journal(folder, name)
        label = journal.left
        if not label or label in journal.crashed:  # no method was at work
            return failure
        ends[label] += 1
        if ends[label] >= DEATHS:
            journal.blame(label, failure.why)


def _complete(kind: Kind, block: Any, seed: int, folder: RunFolder) -> None:
    """Complete a block in a worker process."""
    kind.run(block, seed, folder, lambda what: None)


@contextmanager
def compiled_aside(suite: Suite) -> Iterator[None]:
    """Run the first calls of all blocks that are timed alone in a second process, which ends with the context.

    The main process samples problems meanwhile. The only result are compiled kernels in the cache on disk. If the second
    process fails, the main process compiles them.
    """
    if suite.plugins or not any(kind.warms for kind in suite.kinds):
        yield
        return
    aside = Child(target=_first_calls, args=(suite.name, dict(suite.settings)), daemon=True)
    aside.start()
    try:
        yield
        aside.join(WAIT_SECONDS)
    finally:
        aside.kill()
        aside.join()


def _first_calls(name: str, settings: dict[str, object]) -> None:
    """Run the first calls."""
    with suppress(Exception):  # the main process reports errors
        for kind, block in suite_of(name, settings).pairs():
            kind.warm(block)
