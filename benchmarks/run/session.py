"""Run a suite into a run folder: parts that any process may do, then blocks that are timed by themselves."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks.kinds._stored import store_table
from benchmarks.kinds.base import Kind, Part
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
"""Called with (parts done, parts in all, what is next)."""

MOST_WORKERS = 4096
"""Processes: more than a machine has cores, and more than the operating system's queues can count."""

PART_SECONDS = 1800.0
"""Time within which a worker must have done a part [s]: a part of the slowest method takes minutes."""


@dataclass(frozen=True)
class Where:
    """Where the parts of a run are done.

    Attributes
    ----------
    workers : int
        Processes.
    executor : Executor or None
        In place of them.
    dask : str
        Address of a scheduler, in place of them; empty for none.
    limit : float or None
        Time within which a worker must have done a part [s].
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
        """Start what is needed."""
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
    """Run a suite, or continue it where it stopped.

    Parameters
    ----------
    suite : Suite
        What to run.
    out : path
        Folder of the run: new, empty, or of the same suite and settings.
    workers : int
        Processes. More than one disturb each other's times; the answers are the same for any number.
    executor : concurrent.futures.Executor, optional
        Where to do the parts instead; the caller's to shut down.
    dask : str
        Address of a Dask scheduler on whose workers to do the parts instead; empty for none.
    part_timeout : float, optional
        Time within which a worker process must have done a part [s]; `PART_SECONDS` where there are several processes.
        With a limit, one worker is a process of its own, too.
    progress : callable, optional
        Called with (parts done, parts in all, what is next).
    command : str
        How to run this again, for the report.

    Returns
    -------
    RunFolder
        The finished run: ``failed`` of its manifest says what crashed; it is ``complete`` where all has its rows.

    Raises
    ------
    OutputError
        The folder cannot be written, holds something else, or another process works in it.
    InvalidInput
        An option that a set or a method does not have; a plug-in that is not allowed, or not the one that the run began
        with; a table in the folder that is damaged or of another run; no cluster at that address.
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
    """A run folder with its manifest, locked; as it was before, where a new run fails before its first part."""
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
    """A run while one process works on it."""

    def __init__(self, suite: Suite, folder: RunFolder, manifest: dict[str, Any], tell: Progress) -> None:
        self._suite, self._folder, self._tell = suite, folder, tell
        self._manifest = {"failed": []} | manifest
        self._prepared: list[tuple[Kind, Any, Any]] = []
        self._alone = [(kind, block) for kind, block in suite.pairs() if kind.alone]
        self._done = self._total = 0
        self._lacking: set[str] = set()
        self._mark, self._recorded = Mark(folder), record_plugins(suite.plugins)

    def prepare(self) -> None:
        """Check what only trying shows, and write the arms that do not come with optik: a report needs no files of theirs."""
        self._tell(0, 1, "problem sets")
        suite = self._suite
        self._prepared = [(kind, block, kind.prepare(block, suite.seed)) for kind, block in suite.pairs()]
        outside = [name for name in suite.robots if name not in own_names("optik.robots")]
        if outside:
            self._folder.write_json(ARMS, {short_name(name): load(name).to_dict() for name in outside})

    def _todo(self) -> Iterator[tuple[str, Part]]:
        """Parts that are not done: drawn one by one, since they bring their problems with them."""
        for kind, block, given in self._prepared:
            for part in kind.parts(block, given, self._folder):
                if not self._folder.has(part.file):
                    yield self._suite.sources[kind.name], part

    def do_parts(self, place: Place) -> None:
        """Do all parts that are not done; in a process apart the one that the first process has died in."""
        deadly = [(kind, part) for kind, part in self._counted() if self._mark.deadly(part.file)]
        if deadly and isinstance(place, Here):
            with closing(Workers(1, self._recorded, PART_SECONDS)) as apart:
                self._keep(solved(deadly, apart))
        rest = ((kind, part) for kind, part in self._todo() if part.file not in self._lacking)
        self._keep(solved(self._marked(rest) if isinstance(place, Here) else rest, place))
        self._mark.clear()

    def _counted(self) -> Iterator[tuple[str, Part]]:
        """Parts that are not done, while they are counted."""
        self._total = len(self._alone)
        for kind, part in self._todo():
            self._total += 1
            yield kind, part

    def _marked(self, parts: Iterable[tuple[str, Part]]) -> Iterator[tuple[str, Part]]:
        """Parts for this process, each marked before it is done."""
        for kind, part in parts:
            self._mark.set(part.file)
            self._tell(self._done, self._total, part.label)
            yield kind, part

    def _keep(self, parts: Iterable[Done]) -> None:
        """Write what comes of parts."""
        for done in parts:
            if done.rows is None:
                self._lacking.add(done.part.file)
            else:
                self._folder.write(done.part.file, done.rows)
            self._record(done.part.file, done.part.label, done.crashes)
            self._done += 1
            self._tell(self._done, self._total, done.part.label)

    def do_alone(self) -> None:
        """Do what is timed alone, one block after another, in this process."""
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
        """Do what a block lacks; why it failed, where it did."""
        name, source = kind.file(block), self._suite.sources[kind.name]
        failed = any(one["file"] == name for one in self._manifest["failed"])  # so it may end this process again
        apart = failed or self._mark.died_in(name)
        self._mark.set(name)
        try:
            if apart:
                work = Apart(source, block, self._suite.seed, self._folder, self._recorded)
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
        """Keep in ``run.json`` what crashed."""
        before = [one for one in self._manifest["failed"] if (one["file"], one["label"]) != (file, label)]
        now = [{"file": file, "label": label, "why": why, "times": n} for why, n in Counter(crashes).items()]
        if now or len(before) < len(self._manifest["failed"]):
            self._manifest["failed"] = before + now
            self._folder.write_json("run.json", self._manifest)

    def finish(self) -> None:
        """Store the tables of kinds that are not ours, and say whether the run is complete."""
        for kind, block in self._suite.pairs():
            store_table(kind, block, self._folder)
        self._folder.write_json("run.json", self._manifest | {"complete": not self._lacking})


def _manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Content of ``run.json`` at the start of a run."""
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
