"""Side-by-side timing of calls: in rounds, in turn, each call as a whole, with the garbage collector off."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.blocks.base import Entry
from optik.plugins.files import is_path

Item = TypeVar("Item")

CLOCK_CALLS = 2000
"""Number of empty calls that measure the cost of timing itself: enough for a median that repeats to a few nanoseconds."""


def timed(
    call: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    *,
    keep_errors: bool = False,
    before: Callable[[int], None] | None = None,
) -> tuple[NDArray[np.int64], list[Any]]:
    """Time one call for each tuple of arguments."""
    clock = time.perf_counter_ns
    took = np.empty(len(arguments), dtype=np.int64)
    raws: list[Any] = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        for i, given in enumerate(arguments):
            if before is not None:
                before(i)
            begin = clock()
            try:  # costs no time where nothing is raised
                raw = call(*given)
            except Exception as error:
                if not keep_errors:
                    raise
                raw = error
            end = clock()
            took[i] = end - begin
            raws.append(raw)
    finally:
        if collecting:
            gc.enable()
    return took, raws


def turns(contestants: Sequence[Item], rounds: int) -> Iterator[tuple[int, Item]]:
    """Return the order of calls: every round calls each contestant once and begins with a different one."""
    for turn in range(rounds):
        for k in range(len(contestants)):
            yield turn, contestants[(turn + k) % len(contestants)]


def clock_cost() -> float:
    """Return the time that timing itself adds to a call [ns]: the median for an empty call. It is included in all times."""
    took, _ = timed(lambda target, q0: None, [(None, None)] * CLOCK_CALLS)
    return float(np.median(took))


def facts_on(entry: Entry, **more: Any) -> dict[str, Any]:
    """Return the facts on one of our entries that a run stores for the report."""
    words = entry.words or "default settings"
    return {"kind": entry.role, "name": entry.name, "version": None, "settings": words} | more


def version_words(about: Mapping[str, Any]) -> str:
    """Return the version of an entry for the report."""
    name = str(about.get("name", ""))
    if about["version"]:
        return str(about["version"])
    if about["kind"] == "peer":
        return "–"
    return f"own file {Path(name).name}" if is_path(name) else "this version"
