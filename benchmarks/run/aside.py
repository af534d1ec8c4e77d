"""Kernels compiled by a second process while the first draws the problems: the first run on a machine is then shorter."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context

from benchmarks.run.pool import start
from benchmarks.suite import Suite, suite_of

WAIT_SECONDS = 600.0
"""Longest wait for the second process before what is timed [s]: what it has not compiled by then is compiled here."""


@contextmanager
def compiled_aside(suite: Suite, *, wanted: bool) -> Iterator[None]:
    """Let a second process do the first calls of all blocks that are timed alone; it has ended when the context ends.

    Compiled kernels go to the cache on disk, where this process finds them. Nothing else comes of it: where it fails, this
    process compiles by itself.
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
    """Do the first calls; Ctrl-C is for the first process, which ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(Exception):  # the first process tells the user of what goes wrong
        for kind, block in suite_of(name, settings).pairs():
            kind.warm(block)
