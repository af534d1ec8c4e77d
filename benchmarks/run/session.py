"""Run a suite: first parts for any process, then blocks that are timed alone."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks.blocks.base import Kind, Part
from benchmarks.provenance import provenance
from benchmarks.records import ARMS, FORMAT, JOURNAL, Journal, RunFolder
from benchmarks.run.alone import Apart, Mark, finish_apart
from benchmarks.run.aside import compiled_aside
from benchmarks.run.cluster import OnDask
from benchmarks.run.lock import locked
from benchmarks.run.parts import Done, solved
from benchmarks.run.places import Here, OnExecutor
from benchmarks.run.pool import Workers
from benchmarks.run.work import Failure, Place, words_of_error
from benchmarks.suite import Suite
from optik.arm.library import load
from optik.check import check_count, check_number
from optik.errors import InvalidInput, OptikError
from optik.plugins.files import expect
from optik.plugins.usage import check_allowed, record_plugins
from optik.registry import own_names, short_name

Progress = Callable[[int, int, str], None]
"""Type of a callback with (finished parts, number of parts, name of the next one)."""

MOST_WORKERS = 4096
"""Largest number of processes: more than the cores of a machine."""

PART_SECONDS = 1800.0
"""Default time limit of a part in a worker process [s]: a part of the slowest method takes minutes."""


@dataclass(frozen=True)
class Where:
    """What runs the parts of a run.

    Attributes
    ----------
    workers : int
        Number of processes.
    executor : Executor or None
        An executor in place of processes.
    dask : str
        Address of a Dask scheduler in place of processes; empty for none.
    limit : float or None
        Time limit of a part in a worker process [s].
    """

    workers: int = 1
    executor: Executor | None = None
    dask: str = ""
    limit: float | None = None

    def __post_init__(self) -> None:
        check_count(self.workers, "workers", 1, MOST_WORKERS)
        if self.limit is not None and check_number(self.limit, "part_timeout", "a time [s] above 0") <= 0.0:
            raise InvalidInput("part_timeout", self.limit, "a time [s] above 0")

    def place(self, recorded: list[dict[str, str]]) -> Place:
        """Start the processes, or connect to the cluster."""
        if self.executor is not None:
            return OnExecutor(self.executor, recorded)
        if self.dask:
            return OnDask(self.dask, recorded)
        if self.workers == 1 and self.limit is None:
            return Here()
        return Workers(self.workers, recorded, self.limit or PART_SECONDS)


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
    where = Where(workers, executor, dask, part_timeout)
    folder = RunFolder(out)
    manifest = _manifest(suite, workers, command)
    folder.checked(manifest)
    with _begun(folder, manifest) as begun, closing(where.place(manifest["plugins"])) as place:
        expect(manifest["plugins"])
        run = _Session(suite, folder, begun, progress or (lambda done, total, what: None))
        with compiled_aside(suite, wanted=isinstance(place, Workers)):
            run.prepare()
            run.do_parts(place)
        run.do_alone()
        run.finish()
    return folder


@contextmanager
def _begun(folder: RunFolder, manifest: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Lock and create a run folder; undo that if a new run fails before its first part."""
    existed, fresh = folder.path.exists(), folder.empty
    try:
        with locked(folder.path):
            now = folder.create(manifest)
            try:
                yield now
            except Exception:
                if fresh and not folder.begun:
                    folder.discard()
                raise
    finally:
        if not existed and folder.path.is_dir() and not any(folder.path.iterdir()):
            folder.path.rmdir()


class _Session:
    """A run in progress."""

    def __init__(self, suite: Suite, folder: RunFolder, manifest: dict[str, Any], tell: Progress) -> None:
        self._suite, self._folder, self._tell = suite, folder, tell
        self._manifest = {"failed": []} | manifest
        self._prepared: list[tuple[Kind, Any, Any]] = []
        self._alone = [(kind, block) for kind, block in suite.pairs() if kind.alone]
        self._done = self._total = 0
        self._lacking: set[str] = set()
        self._mark, self._recorded = Mark(folder), record_plugins(suite.plugins)

    def prepare(self) -> None:
        """Prepare every block, and write the robots that do not come with optik, so that a report needs no other files."""
        self._tell(0, 1, "problem sets")
        suite = self._suite
        self._prepared = [(kind, block, kind.prepare(block, suite.seed)) for kind, block in suite.pairs()]
        outside = [name for name in suite.robots if name not in own_names("optik.robots")]
        if outside:
            self._folder.write_json(ARMS, {short_name(name): load(name).to_dict() for name in outside})

    def _todo(self) -> Iterator[tuple[Kind, Part]]:
        """Yield unfinished parts one by one, because each holds its problems in memory."""
        for kind, block, given in self._prepared:
            for part in kind.parts(block, given, self._folder):
                if not self._folder.has(part.file):
                    yield kind, part

    def do_parts(self, place: Place) -> None:
        """Run all unfinished parts; a part that crashed the main process runs in a worker process."""
        deadly = [(kind, part) for kind, part in self._counted() if self._mark.deadly(part.file)]
        if deadly and isinstance(place, Here):
            with closing(Workers(1, self._recorded, PART_SECONDS)) as apart:
                self._keep(solved(deadly, apart))
        rest = ((kind, part) for kind, part in self._todo() if part.file not in self._lacking)
        self._keep(solved(self._marked(rest) if isinstance(place, Here) else rest, place))
        self._mark.clear()

    def _counted(self) -> Iterator[tuple[Kind, Part]]:
        """Yield unfinished parts, and count them."""
        self._total = len(self._alone)
        for kind, part in self._todo():
            self._total += 1
            yield kind, part

    def _marked(self, parts: Iterable[tuple[Kind, Part]]) -> Iterator[tuple[Kind, Part]]:
        """Yield parts for this process, each marked before it runs."""
        for kind, part in parts:
            self._mark.set(part.file)
            self._tell(self._done, self._total, part.label)
            yield kind, part

    def _keep(self, parts: Iterable[Done]) -> None:
        """Write the rows and failures of parts."""
        for done in parts:
            if done.rows is None:
                self._lacking.add(done.part.file)
            else:
                self._folder.write(done.part.file, done.rows)
            self._record(done.part.file, done.part.label, done.crashes)
            self._done += 1
            self._tell(self._done, self._total, done.part.label)

    def do_alone(self) -> None:
        """Run the blocks that are timed alone, one after another, in this process."""
        for kind, block in self._alone:
            tell = partial(self._tell, self._done, self._total)
            failure = self._timed(kind, block, tell)
            if failure is not None:
                self._lacking.add(kind.file(block))
            self._record(kind.file(block), block.title, [] if failure is None else [failure.why])
            journal = Journal(self._folder, kind.file(block, JOURNAL))
            for label, why in journal.crashed.items():
                self._record(journal.crashes, f"{block.title}: {label}", [why])
            self._done += 1
        self._tell(self._done, self._total, "done")

    def _timed(self, kind: Kind, block: Any, tell: Callable[[str], None]) -> Failure | None:
        """Complete a block; return its failure, or None."""
        name = kind.file(block)
        failed = any(one["file"] == name for one in self._manifest["failed"])  # it may crash this process again
        apart = failed or self._mark.died_in(name)
        self._mark.set(name)
        try:
            if apart:
                work = Apart(kind, block, self._suite.seed, self._folder, self._recorded)
                return finish_apart(work, kind.file(block, JOURNAL), tell)
            kind.run(block, self._suite.seed, self._folder, tell)
        except OptikError:
            raise
        except Exception as error:  # a method or a peer may raise any
            return Failure(words_of_error(error), again=False)
        finally:
            self._mark.clear()
        return None

    def _record(self, file: str, label: str, crashes: list[str]) -> None:
        """Record crashes in ``run.json``."""
        before = [one for one in self._manifest["failed"] if (one["file"], one["label"]) != (file, label)]
        now = [{"file": file, "label": label, "why": why, "times": n} for why, n in Counter(crashes).items()]
        if now or len(before) < len(self._manifest["failed"]):
            self._manifest["failed"] = before + now
            self._folder.write_json("run.json", self._manifest)

    def finish(self) -> None:
        """Record whether the run is complete."""
        self._folder.write_json("run.json", self._manifest | {"complete": not self._lacking})


def _manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Return the content of ``run.json`` at the start of a run."""
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
