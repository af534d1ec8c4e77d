"""Calls timed side by side: in rounds, in turn, each as a whole, with the garbage collector off."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.kinds._block import Entry
from benchmarks.records import RunFolder
from optik.errors import InvalidInput
from optik.plugins.files import is_path

Item = TypeVar("Item")

CLOCK_CALLS = 2000
"""Calls of nothing by which the cost of timing itself is found: enough for a median that repeats to a few nanoseconds."""


def timed(
    call: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    *,
    keep_errors: bool = False,
    before: Callable[[int], None] | None = None,
) -> tuple[NDArray[np.int64], list[Any]]:
    """Time one call for each tuple of arguments.

    Parameters
    ----------
    call : callable
        What is timed.
    arguments : sequence of k tuples
        Of each call.
    keep_errors : bool
        Whether an exception of a call takes the place of its result; otherwise it ends all calls.
    before : callable, optional
        Called with the number of each call before it; its time does not count.

    Returns
    -------
    took : (k,) array of int
        Time of each call [ns].
    raws : list of k objects
        What each returned, or the exception that it raised.
    """
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
    """Who is called when: in every round each contestant once, another one first each time.

    Parameters
    ----------
    contestants : sequence
        Those that are compared.
    rounds : int
        How many rounds.

    Yields
    ------
    tuple
        Number of the round, and the contestant.
    """
    for turn in range(rounds):
        for k in range(len(contestants)):
            yield turn, contestants[(turn + k) % len(contestants)]


def clock_cost() -> float:
    """Time that timing itself adds to a call [ns], the median for a call that does nothing; it is left in all times."""
    took, _ = timed(lambda target, q0: None, [(None, None)] * CLOCK_CALLS)
    return float(np.median(took))


def facts_on(entry: Entry, **more: Any) -> dict[str, Any]:
    """What a run keeps on an entry of ours, for the report.

    Parameters
    ----------
    entry : Entry
        The entry.
    **more
        Further facts.

    Returns
    -------
    dict
        ``kind``, ``name``, ``version``, ``settings``, and what else was given.
    """
    words = entry.words or "as it comes"
    return {"kind": entry.role, "name": entry.name, "version": None, "settings": words} | more


def version_words(about: Mapping[str, Any]) -> str:
    """What a report says as the version of an entry.

    Parameters
    ----------
    about : dict
        Facts on the entry, from `facts_on`.

    Returns
    -------
    str
        The version of its package, ``own file NAME.py``, ``this one`` for what comes with optik, or ``–``.
    """
    name = str(about.get("name", ""))
    if about["version"]:
        return str(about["version"])
    if about["kind"] == "peer":
        return "–"
    return f"own file {Path(name).name}" if is_path(name) else "this one"


def read_facts(folder: RunFolder, file: str, block: str) -> dict[str, Any]:
    """What is known of a block beside its rows: ``clock_ns``, and ``entries`` by label.

    Parameters
    ----------
    folder : RunFolder
        The run.
    file : str
        Where they are.
    block : str
        Id of the block, for errors.

    Returns
    -------
    dict
        The facts.

    Raises
    ------
    InvalidInput
        They are not there though rows are.
    """
    facts: dict[str, Any] | None = folder.read_json(file)
    if facts is None:
        top = file.partition("/")[0]
        raise InvalidInput("run", f"no facts on {block!r}", f"whole parts; delete {top}/ and run again")
    return facts
