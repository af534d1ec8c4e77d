"""Blocks that are timed alone: in the main process, and after a crash in a process of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from benchmarks.blocks.base import Kind
from benchmarks.records import JOURNAL, Journal, RunFolder
from benchmarks.run.pool import Child, Failure, Pool
from benchmarks.suite import Suite, suite_of

DEATHS = 2
"""Crashes in the same work after which it is not repeated: a single one may be a kill."""

WAIT_SECONDS = 600.0
"""Longest wait for `compiled_aside` before timed work [s]; the main process compiles the remaining kernels."""


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
