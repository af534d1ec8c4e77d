"""Run a suite in a locked folder with a manifest: first shards in any process, then blocks that are timed alone."""

from __future__ import annotations

import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import records
from benchmarks.blocks.base import Session, Shard, Tell, add_keys, silent
from benchmarks.blocks.block import hash_problems
from benchmarks.provenance import provenance, time_reference
from benchmarks.records import FORMAT, JOURNAL, LEDGER, MANIFEST, Journal, RunFolder, record_failures, update_manifest
from benchmarks.run.pool import IN_FLIGHT, Failure, Pool, Processes, ThisProcess, solve_shards, words_of_error
from benchmarks.suite import Suite
from optik.arm.library import load
from optik.check import check_count, check_number
from optik.errors import InvalidInput, OptikError, OutputError
from optik.file_io import LOCK, Lock, locked
from optik.plugins.files import check_allowed, check_same_plugins, expected, record_plugins
from optik.registry import own_names, short_name

# ---------------- the beginning of a run


_LEFT_AT_START = re.compile(rf"{re.escape(LOCK)}|\.[0-9a-f]{{12}}\.part")
"""Names of the files of a run that was killed at its start."""


def new_manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Return the manifest at the start of a run."""
    return {
        "format": FORMAT,
        "suite": suite.name,
        "title": suite.title,
        "fingerprint": suite.fingerprint,
        "settings": suite.settings,
        "plugins": record_plugins(suite.plugins),
        "command": command,
        "provenance": provenance(suite.seed, workers),
        "continued": [],
        "failed": [],
        "complete": False,
    }


def resumed(folder: RunFolder, manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of the run in this folder. If the run is resumed, it lists all sessions."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise OutputError(path, "is a file; choose a folder for the run")
    if _is_empty(folder):
        return manifest
    if not folder.has(MANIFEST):
        raise OutputError(path, "contains something else; choose a new or empty folder for the run")
    old = folder.manifest()
    if old["fingerprint"] != manifest["fingerprint"]:
        raise OutputError(path, f"contains a run of {old['suite']!r} with other settings; choose another folder")
    check_same_plugins(old.get("plugins", []), manifest["plugins"])
    return old if old["complete"] else old | {"continued": _with_session(old["continued"], manifest["provenance"])}


def _with_session(sessions: list[dict[str, Any]], now: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the sessions of a run with one more; if it equals the last one, increase the count ``sessions`` of that."""
    apart = ("created", "sessions")
    if sessions and all(sessions[-1].get(key) == now[key] for key in now if key not in apart):
        return [*sessions[:-1], sessions[-1] | {"sessions": sessions[-1].get("sessions", 1) + 1}]
    return [*sessions, now]


@contextmanager
def begin_run(folder: RunFolder, manifest: dict[str, Any]) -> Iterator[Lock]:
    """Lock a folder and begin or resume a run in it, with its plug-ins; remove a run that fails before its first other file."""
    existed, fresh = folder.path.exists(), _is_empty(folder)
    try:
        with locked(folder.path) as lock, expected(manifest["plugins"]):
            try:
                _begin(folder, manifest)
                yield lock
            except Exception:
                begun_with = (folder.path / MANIFEST, folder.path / LEDGER)
                if fresh and all(file in begun_with or _LEFT_AT_START.fullmatch(file.name) for file in _files(folder)):
                    for file in begun_with:
                        file.unlink(missing_ok=True)
                raise
    finally:
        if not existed and folder.path.is_dir() and not any(folder.path.iterdir()):
            folder.path.rmdir()


def _begin(folder: RunFolder, manifest: dict[str, Any]) -> None:
    """Write the manifest, remove the remains of a killed process, and check all tables."""
    try:
        folder.write_json(MANIFEST, resumed(folder, manifest))
        for left in folder.path.rglob(".*.part"):
            left.unlink(missing_ok=True)
        folder.verify()
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(folder.path, f"cannot be written ({error.strerror})") from None


def _files(folder: RunFolder) -> Iterator[Path]:
    return (file for file in folder.path.rglob("*") if file.is_file())


def _is_empty(folder: RunFolder) -> bool:
    """Say whether a folder has no files, except those of a run that was killed at its start."""
    return not folder.path.is_dir() or all(_LEFT_AT_START.fullmatch(one.name) for one in folder.path.iterdir())


# ---------------- run a suite


Progress = Callable[[int, int, str], None]
"""Type of a callback with (finished parts, number of parts, name of the next one)."""

MOST_WORKERS = 4096
"""Largest number of processes: more than the cores of a machine."""

PART_SECONDS = 1800.0
"""Default time limit of a part in a worker process [s]: a part of the slowest method takes minutes."""


DEATHS = 2
"""Crashes in the same work after which it is not repeated: a single one may be a kill."""

REFERENCE_SECONDS = 1.0
"""Least time between two reference computations of a block [s]: they take 0.06 s."""


def run_suite(
    suite: Suite, out: str | os.PathLike[str], *, workers: int = 1, executor: Executor | None = None,
    part_timeout: float | None = None, progress: Progress | None = None, command: str = "",
) -> RunFolder:  # fmt: skip
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
        damaged or foreign table in the folder.
    """
    check_allowed(suite.plugins, suite.allow_plugins)
    folder, manifest = RunFolder(out), new_manifest(suite, workers, command)
    resumed(folder, manifest)
    recorded = manifest["plugins"]
    with closing(_pool(workers, executor, part_timeout, recorded)) as pool, begin_run(folder, manifest) as lock:
        run = _Run(suite, folder, lock, recorded, progress or (lambda done, total, what: None))
        run.prepare()
        run.do_shards(pool)
        pool.close()  # timed blocks share this machine with no worker
        run.do_alone()
        run.finish()
    return folder


def _pool(workers: int, executor: Executor | None, limit: float | None, recorded: list[dict[str, str]]) -> Pool:
    """Return the pool that runs the parts."""
    check_count(workers, "workers", 1, MOST_WORKERS)
    if limit is not None and check_number(limit, "part_timeout", "a time [s] above 0") <= 0.0:
        raise InvalidInput("part_timeout", limit, "a time [s] above 0")
    if executor is not None:
        return Pool(executor, IN_FLIGHT, recorded)
    if workers == 1 and limit is None:
        return ThisProcess(recorded)
    return Processes(workers, recorded, limit or PART_SECONDS)


class _Run:
    """A run in progress."""

    def __init__(
        self, suite: Suite, folder: RunFolder, lock: Lock, recorded: list[dict[str, str]], tell: Progress
    ) -> None:
        self._suite, self._folder, self._lock, self._recorded, self._tell = suite, folder, lock, recorded, tell
        self._sessions: list[Session] = []
        self._done = self._total = 0
        self._lacking: set[str] = set()

    def prepare(self) -> None:
        """Prepare every block, and record the robots that do not come with optik, so that a report needs no other files."""
        self._tell(0, 1, "problem sets")
        suite, folder = self._suite, self._folder
        self._sessions = [
            Session(kind, block, suite.seed, folder, kind.prepare(block, suite.seed)) for kind, block in suite.pairs()
        ]
        hashes = {f"{kind.name}/{block.id}": hash_problems(block, suite.seed) for kind, block in suite.pairs()}
        update_manifest(folder, problems=hashes)
        outside = [name for name in suite.robots if name not in own_names("optik.robots")]
        if outside:
            update_manifest(folder, robots={short_name(name): load(name).to_dict() for name in outside})

    def do_shards(self, pool: Pool) -> None:
        """Run the unfinished shards that any process may do; one that crashed the main process runs in a worker process."""
        self._total = sum(one.kind.alone for one in self._sessions)
        deadly = []
        for shard in self._todo():
            self._total += 1
            if pool.is_here and self._lock.crashes(shard.file) >= DEATHS:
                deadly.append(shard)
        with closing(self._process(PART_SECONDS)) as apart:
            self._solve(deadly, apart)
        self._solve(self._marked() if pool.is_here else self._todo(), pool)

    def _process(self, limit: float | None) -> Processes:
        """Return a pool with one worker process, which starts with its first work."""
        return Processes(1, self._recorded, limit)

    def _todo(self) -> Iterator[Shard]:
        """Yield unfinished shards one by one, because each holds its problems in memory."""
        for session in (one for one in self._sessions if not one.kind.alone):
            for shard in unfinished(session):
                if shard.file not in self._lacking:
                    yield shard

    def _marked(self) -> Iterator[Shard]:
        """Yield shards for this process, and record each while it runs."""
        for shard in self._todo():
            self._tell(self._done, self._total, shard.label)
            with self._lock.at_work(shard.file):
                yield shard

    def _solve(self, shards: Iterable[Shard], pool: Pool) -> None:
        """Run shards, and write their rows and failures."""
        with closing(solve_shards(shards, pool)) as results:  # a second Ctrl-C, during clean-up, is not lost
            for shard, rows, crashes, repeated in results:
                if repeated:
                    before = self._folder.manifest().get("repeated", [])
                    update_manifest(self._folder, repeated=[*before, {"file": shard.file, "why": repeated}])
                if rows is None:
                    self._lacking.add(shard.file)
                else:
                    self._folder.write(shard.file, add_keys(shard.block, rows))
                record_failures(self._folder, shard.file, shard.label, crashes)
                self._done += 1
                self._tell(self._done, self._total, shard.label)

    def do_alone(self) -> None:
        """Run the blocks that are timed alone, one after another, in this process."""
        for session in (one for one in self._sessions if one.kind.alone):
            file, title = session.kind.file(session.block), session.block.title
            failure = self._timed(session, file, title)
            if failure is not None:
                self._lacking.add(file)
            record_failures(self._folder, file, title, [failure.why] if failure else [])
            self._done += 1
        self._tell(self._done, self._total, "done")

    def _timed(self, session: Session, file: str, title: str) -> Failure | None:
        """Complete a block; return its failure, or None. A block that has failed may crash: it runs in another process."""
        failed = (file, title) in [(one["file"], one["label"]) for one in records.failures(self._folder)]
        apart = failed or self._lock.crashes(file) > 0
        with self._lock.at_work(file):
            if apart:
                self._tell(self._done, self._total, f"{title}, in a separate process")
                with closing(self._process(None)) as pool:
                    return run_block_apart(pool, session)
            try:
                complete(session, partial(self._tell, self._done, self._total))
            except OptikError:
                raise
            except Exception as error:  # a method or a peer may raise any
                return Failure(words_of_error(error), again=False)
        return None

    def finish(self) -> None:
        """Record whether the run is complete."""
        manifest = self._folder.manifest()
        if not manifest["complete"] or self._lacking:  # of the sessions before, and of this one
            update_manifest(self._folder, complete=not self._lacking)


def unfinished(session: Session) -> Iterator[Shard]:
    """Yield the shards of a block whose file does not exist."""
    kind, block = session.kind, session.block
    for shard in kind.shards(block, session):
        file = kind.file(block, "parquet", shard.name)
        if not session.folder.has(file):
            yield replace(shard, file=file, block=block.id)


# ---------------------------------------------------------------- blocks that are timed alone


def complete(session: Session, tell: Tell) -> None:
    """Do the unfinished shards of a block that is timed alone, and time the reference computation beside them."""
    folder, file = session.folder, session.kind.file(session.block)
    known = folder.manifest().get("reference", {})
    times, last = list(known.get(file, ())), -REFERENCE_SECONDS
    with Journal(folder, session.kind.file(session.block, JOURNAL)) as journal:
        for shard in unfinished(replace(session, journal=journal, tell=tell)):
            if time.monotonic() - last >= REFERENCE_SECONDS:
                times.append(time_reference())
                last = time.monotonic()
            tell(shard.label)
            folder.write(shard.file, add_keys(shard.block, shard.solve()))
    if last > 0.0:
        update_manifest(folder, reference=known | {file: [*times, time_reference()]})


def run_block_apart(pool: Pool, session: Session) -> Failure | None:
    """Complete a block without the methods that crash their process; return the failure, or None.

    A method that crashed is tried a second time, because the first crash may have another cause. After the second crash it is
    recorded as crashed, and the block continues with the other methods.
    """
    folder, name = session.folder, session.kind.file(session.block, JOURNAL)
    ends = Counter([Journal(folder, name).left])
    while True:
        failure: Failure | None = pool.run_apart(complete, session, silent)
        if failure is None or not failure.again:
            return failure
        journal = Journal(folder, name)
        label = journal.left
        if not label or label in journal.crashed:  # no method was at work
            return failure
        ends[label] += 1
        if ends[label] >= DEATHS:
            journal.blame(label, failure.why)
