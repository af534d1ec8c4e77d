"""Contestants and side-by-side timing: calls in turn without garbage collection, fresh processes, seeds of random methods."""

from __future__ import annotations

import gc
import hashlib
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.blocks.block import Entry
from benchmarks.peers.base import Absent, Answer
from benchmarks.provenance import ROOT
from benchmarks.records import Journal
from optik.errors import OptikError
from optik.plugins.files import is_path
from optik.registry import load_method
from optik.types import Array

Item = TypeVar("Item")

CLOCK_CALLS = 2000
"""Number of empty calls that measure the cost of timing itself: enough for a median that repeats to a few nanoseconds."""


def _never(*given: Any) -> Any:
    raise AssertionError("a contestant that is absent or ended its process is not called")


@dataclass(frozen=True)
class Contestant:
    """A built entry: ready to be called, absent, or one that ended its process."""

    entry: Entry
    about: dict[str, Any]  # facts for the report; `absent` is the reason why it is not run
    call: Callable[..., Any] = _never  # the timed part
    read: Callable[..., Any] = _never  # from what a call returned to the answer; not timed
    method: Any = None  # the method, law or peer itself
    many: Callable[[Sequence[tuple[Any, ...]]], list[Answer]] | None = (
        None  # calls that another process makes and times
    )
    ended: str = ""  # how it ended the process in this block; such a contestant is not called again

    @property
    def label(self) -> str:
        """Its name in reports."""
        return self.entry.label


def facts_on(entry: Entry, **more: Any) -> dict[str, Any]:
    """Return the facts on one of our entries that a run stores for the report."""
    words = entry.words or "default settings"
    return {"kind": entry.role, "name": entry.name, "version": None, "settings": words} | more


def enter(
    entry: Entry,
    journal: Journal,
    build: Callable[[Entry], Contestant],
    facts: Callable[[Entry], dict[str, Any]] = facts_on,
) -> Contestant:
    """Build a contestant. One that crashed the process is not built again, because building may be the cause."""
    if entry.label in journal.crashed:
        return Contestant(entry, facts(entry), ended=journal.crashed[entry.label])
    with journal.at_work(entry.label):
        return build(entry)


def enter_peer(entry: Entry, group: str, given: Any) -> Contestant:
    """Build a peer of a folder for a robot or for limits."""
    kind = load_method(group, entry.name, "peer")
    about = facts_on(entry) | kind.facts(**entry.options)
    begin = time.perf_counter()
    try:
        peer = kind.build(given, **entry.options)
    except Absent as absent:
        return Contestant(entry, about | {"absent": absent.why, "outcome": absent.outcome})
    about["build_seconds"] = time.perf_counter() - begin
    return Contestant(entry, about, peer.call, peer.read, peer, peer.many)


class Calls(NamedTuple):
    """Timed calls: times and processor times of all threads [ns], and what they returned, or their exceptions."""

    ns: NDArray[np.int64]
    cpu_ns: Array
    raws: list[Any]


def timed_calls(
    contestant: Contestant,
    arguments: Sequence[tuple[Any, ...]],
    failures: tuple[type[Exception], ...],
    before: Callable[[int], None] | None = None,
) -> Calls:
    """Time one call for each tuple of arguments, by the clock of the process that makes them.

    The processor time is the mean over the calls. In a worker process it is measured for each call.
    """
    if contestant.many is not None:
        answers = contestant.many(arguments)
        ns = np.array([a.ns for a in answers], dtype=np.int64)
        cpu = np.array([np.nan if a.cpu_ns is None else a.cpu_ns for a in answers], dtype=np.float64)
        return Calls(ns, cpu, [a.raw for a in answers])
    begin = time.process_time_ns()
    ns, raws = timed(contestant.call, arguments, failures=failures, before=before)
    return Calls(ns, np.full(len(ns), (time.process_time_ns() - begin) / max(len(ns), 1)), raws)


def timed(
    call: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    *,
    failures: tuple[type[Exception], ...] = (),
    before: Callable[[int], None] | None = None,
) -> tuple[NDArray[np.int64], list[Any]]:
    """Time one call for each tuple of arguments; exceptions that are failures take the place of results."""
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
            except failures as error:
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


def version_words(about: Mapping[str, Any]) -> str:
    """Return the version of an entry for the report."""
    name = str(about.get("name", ""))
    if about["version"]:
        return str(about["version"])
    if about["kind"] == "peer":
        return "–"
    return f"own file {Path(name).name}" if is_path(name) else "this version"


class ProcessFailed(OptikError, RuntimeError):
    """A fresh process ended with an error; the message is its last line."""


def fresh(arguments: list[str], what: str, **environment: str) -> Any:
    """Run ``python ARGUMENTS`` and read what it prints as JSON. Nothing is imported from the working folder."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": path, "PYTHONSAFEPATH": "1"} | environment,
    )
    if done.returncode != 0:
        raise ProcessFailed(
            f"{what}: {(done.stderr.strip().splitlines() or ['the process ended without a message'])[-1]}"
        )
    return json.loads(done.stdout)


def trial_seed(seed: int, problem: int, method: str, trial: int = 0) -> int:
    """Seed of one trial of a method on a problem."""
    named = int.from_bytes(hashlib.blake2b(method.encode(), digest_size=8).digest(), "little")
    return int(np.random.SeedSequence((seed, problem, named, trial)).generate_state(1)[0])


def reseed(method: Any, seed: int, problem: int, label: str, trial: int = 0) -> None:
    """Seed all random number generators that a method may use, before one trial of it.

    These are Python's `random`, NumPy's global generator, and whatever the method's own ``reseed(number)`` sets, where it
    has one.
    """
    number = trial_seed(seed, problem, label, trial)
    random.seed(number)  # both generators are global: older packages use them
    np.random.seed(number)  # noqa: NPY002
    own = getattr(method, "reseed", None)
    if callable(own):
        own(number)
