"""Compile kernels in a second process while the main process samples problems, which shortens the first run on a machine."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context

from benchmarks.run.pool import start
from benchmarks.suite import Suite, suite_of

WAIT_SECONDS = 600.0
"""Longest wait for the second process before timed work [s]; the main process compiles the remaining kernels."""


@contextmanager
def compiled_aside(suite: Suite, *, wanted: bool) -> Iterator[None]:
    """Run the first calls of all blocks that are timed alone in a second process, which ends with the context.

    The only result are compiled kernels in the cache on disk. If the second process fails, this process compiles them.
    """
    if not wanted or suite.plugins or not any(kind.warms for kind in suite.kinds):
        yield
        return
    aside = get_context("spawn").Process(target=_first_calls, args=(suite.name, dict(suite.settings)), daemon=True)
    start(aside)
    try:
        yield
        aside.join(WAIT_SECONDS)
    finally:
        if aside.is_alive():
            aside.terminate()
        aside.join()


def _first_calls(name: str, settings: dict[str, object]) -> None:
    """Run the first calls; ignore Ctrl-C, because the main process ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(Exception):  # the main process reports errors
        for kind, block in suite_of(name, settings).pairs():
            kind.warm(block)
