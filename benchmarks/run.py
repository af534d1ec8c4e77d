"""Run a suite into a run folder: parts that any process may do, then blocks that are timed by themselves."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from typing import Any

import polars as pl

from benchmarks.kinds._stored import store_table
from benchmarks.kinds.base import Part, load_kind
from benchmarks.provenance import provenance
from benchmarks.records import FORMAT, RunFolder
from benchmarks.suite import Suite
from optik.check import check_count

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
        An option that a set or a method does not have.
    """
    check_count(workers, "workers", 1, MOST_WORKERS)
    tell = progress or (lambda done, total, what: None)
    folder = RunFolder(out)
    manifest = _manifest(suite, workers, command)
    folder.checked(manifest)
    tell(0, 1, "problem sets")
    prepared = [(kind, block, kind.prepare(block, suite.seed)) for kind, block in suite.pairs()]
    manifest = folder.create(manifest)
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
    for done, (part, rows) in enumerate(_solved(todo, *where, tell, total), start=1):
        folder.write(part.file, rows)
        tell(done, total, part.label)
    for done, (kind, block) in enumerate(alone, start=len(todo)):
        kind.run(block, suite.seed, folder, partial(tell, done, total))
    tell(total, total, "done")


def _manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Content of ``run.json`` at the start of a run."""
    return {
        "format": FORMAT,
        "suite": suite.name,
        "title": suite.title,
        "fingerprint": suite.fingerprint,
        "settings": suite.settings,
        "command": command,
        "provenance": provenance(suite.seed, workers),
        "continued": [],
        "complete": False,
    }


def _solved(
    todo: list[tuple[str, Part]],
    workers: int,
    executor: Executor | None,
    tell: Progress,
    total: int,
) -> Iterator[tuple[Part, pl.DataFrame]]:
    """Parts with their rows as they are solved: here, in processes, or wherever the executor runs them."""
    if executor is None and workers == 1:
        for done, (kind, part) in enumerate(todo):
            tell(done, total, part.label)
            yield part, solve_part(kind, part.work)
        return
    with ExitStack() as stack:
        pool = executor or stack.enter_context(ProcessPoolExecutor(workers, mp_context=get_context("spawn")))
        futures = {pool.submit(solve_part, kind, part.work): part for kind, part in todo}
        for future in as_completed(futures):
            yield futures[future], future.result()


def solve_part(kind: str, work: Any) -> pl.DataFrame:
    """Do one part, in any process.

    Parameters
    ----------
    kind : str
        What its kind is found by: a name, or the path of a file.
    work : object
        What the kind's `solve` is given.

    Returns
    -------
    DataFrame
        Its rows.
    """
    return load_kind(kind).solve(work)
