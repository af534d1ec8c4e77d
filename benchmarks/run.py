"""Run a suite into a run folder: parts that any process may do, then blocks that are timed by themselves."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from typing import Any

import polars as pl

from benchmarks.kinds._stored import store_table
from benchmarks.kinds.base import Part, load_kind
from benchmarks.provenance import provenance
from benchmarks.records import ARMS, FORMAT, RunFolder
from benchmarks.suite import Suite
from optik.arm.library import load
from optik.check import check_count
from optik.plugins.files import expect
from optik.plugins.used import check_allowed, record
from optik.registry import own_names, short_name

Progress = Callable[[int, int, str], None]
"""Called with (parts done, parts in all, what is next)."""

MOST_WORKERS = 4096
"""Processes: more than a machine has cores, and more than the operating system's queues can count."""


def run_suite(
    suite: Suite,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    executor: Executor | None = None,
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
        Where to run the parts instead; the caller's to shut down.
    progress : callable, optional
        Called with (parts done, parts in all, what is next).
    command : str
        How to run this again, for the report.

    Returns
    -------
    RunFolder
        The finished run.

    Raises
    ------
    OutputError
        The folder cannot be written or holds something else.
    InvalidInput
        An option that a set or a method does not have; a plug-in that is not allowed, or not the one that the run began with.
    """
    check_allowed(suite.plugins, suite.allow_plugins)
    check_count(workers, "workers", 1, MOST_WORKERS)
    tell = progress or (lambda done, total, what: None)
    folder = RunFolder(out)
    manifest = _manifest(suite, workers, command)
    folder.checked(manifest)
    tell(0, 1, "problem sets")
    prepared = [(kind, block, kind.prepare(block, suite.seed)) for kind, block in suite.pairs()]
    manifest = folder.create(manifest)
    expect(manifest["plugins"])
    _store_arms(suite, folder)
    todo = [
        (suite.sources[kind.name], part)
        for kind, block, given in prepared
        for part in kind.parts(block, given, folder)
        if not folder.has(part.file)
    ]
    _work(suite, folder, todo, (workers, executor), tell)
    for kind, block in suite.pairs():
        store_table(kind, block, folder)
    folder.write_json("run.json", manifest | {"complete": True})
    return folder


def _work(
    suite: Suite,
    folder: RunFolder,
    todo: list[tuple[str, Part]],
    where: tuple[int, Executor | None],
    tell: Progress,
) -> None:
    """Do all parts, in some workers or by an executor; then what is timed alone, one block after another."""
    alone = [(kind, block) for kind, block in suite.pairs() if kind.alone]
    total = len(todo) + len(alone)
    recorded = record(suite.plugins)
    for done, (part, rows) in enumerate(_solved(todo, recorded, where, tell, total), start=1):
        folder.write(part.file, rows)
        tell(done, total, part.label)
    for done, (kind, block) in enumerate(alone, start=len(todo)):
        kind.run(block, suite.seed, folder, partial(tell, done, total))
    tell(total, total, "done")


def _store_arms(suite: Suite, folder: RunFolder) -> None:
    """Write the arms that do not come with optik, so that a report needs none of their files."""
    outside = [name for name in suite.robots if name not in own_names("optik.robots")]
    if outside:
        folder.write_json(ARMS, {short_name(name): load(name).to_dict() for name in outside})


def _manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Content of ``run.json`` at the start of a run."""
    return {
        "format": FORMAT,
        "suite": suite.name,
        "title": suite.title,
        "fingerprint": suite.fingerprint,
        "settings": suite.settings,
        "plugins": record(suite.plugins),
        "command": command,
        "provenance": provenance(suite.seed, workers),
        "continued": [],
        "complete": False,
    }


def _solved(
    todo: list[tuple[str, Part]],
    recorded: list[dict[str, str]],
    where: tuple[int, Executor | None],
    tell: Progress,
    total: int,
) -> Iterator[tuple[Part, pl.DataFrame]]:
    """Parts with their rows as they are solved: here, in processes, or wherever the executor runs them."""
    workers, executor = where
    if executor is None and workers == 1:
        for done, (kind, part) in enumerate(todo):
            tell(done, total, part.label)
            yield part, solve_part(kind, part.work)
        return
    with ExitStack() as stack:
        pool = executor or stack.enter_context(ProcessPoolExecutor(workers, mp_context=get_context("spawn")))
        futures = {pool.submit(solve_part, kind, part.work, recorded): part for kind, part in todo}
        for future in as_completed(futures):
            yield futures[future], future.result()


def solve_part(kind: str, work: Any, recorded: Sequence[Mapping[str, str]] = ()) -> pl.DataFrame:
    """Do one part, in any process.

    Parameters
    ----------
    kind : str
        What its kind is found by: a name, or the path of a file.
    work : object
        What the kind's `solve` is given.
    recorded : sequence of mapping
        Plug-ins as the run has recorded them: this process refuses files that have changed since.

    Returns
    -------
    DataFrame
        Its rows.
    """
    expect(recorded)
    return load_kind(kind).solve(work)
