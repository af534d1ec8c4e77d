"""Side-by-side timing of methods and peers: rounds of calls without garbage collection, fresh processes, seeds."""

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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks.base import TEXT, TRUTH, WHOLE, Field, fields_of
from benchmarks.blocks.block import Block, Entry
from benchmarks.blocks.entries import judged
from benchmarks.peers.base import Absent, Answer, Failed
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import Solutions
from benchmarks.problems.base import ProblemSet
from benchmarks.provenance import ROOT
from benchmarks.records import UNKEPT, Journal
from optik.arm.robot import Robot
from optik.errors import MissingDependency, OptikError, Unsupported
from optik.ik import make_solver
from optik.plugins.files import is_path
from optik.registry import load_method
from optik.types import Array

# ---------------- contestants and side-by-side timing


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
    entry: Entry, journal: Journal, build: Callable[[Entry], Contestant],
    facts: Callable[[Entry], dict[str, Any]] = facts_on,
) -> Contestant:  # fmt: skip
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
    contestant: Contestant, arguments: Sequence[tuple[Any, ...]], failures: tuple[type[Exception], ...],
    before: Callable[[int], None] | None = None,
) -> Calls:  # fmt: skip
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
    call: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], *, failures: tuple[type[Exception], ...] = (),
    before: Callable[[int], None] | None = None,
) -> tuple[NDArray[np.int64], list[Any]]:  # fmt: skip
    """Time one call for each tuple of arguments; exceptions that are failures take the place of results."""
    clock = time.perf_counter_ns
    took = np.empty(len(arguments), dtype=np.int64)
    raws: list[Any] = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        for i, values in enumerate(arguments):
            if before is not None:
                before(i)
            begin = clock()
            try:  # costs no time where nothing is raised
                raw = call(*values)
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
    """Run ``python ARGUMENTS`` with this code and read what it prints as JSON."""
    return json.loads(run_python(sys.executable, arguments, what, **environment))


def run_python(python: str, arguments: list[str], what: str, **environment: str) -> str:
    """Run ``python ARGUMENTS``, and return its output: this interpreter with this code, another one with its own.

    Nothing is imported from the working folder, by another interpreter also not from this process's ``PYTHONPATH``.
    """
    path = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])] if python == sys.executable else []
    env = os.environ | {"PYTHONPATH": os.pathsep.join(path), "PYTHONSAFEPATH": "1"} | environment
    done = subprocess.run([python, *arguments], capture_output=True, text=True, check=False, env=env)
    if done.returncode != 0:
        raise ProcessFailed(
            f"{what}: {(done.stderr.strip().splitlines() or ['the process ended without a message'])[-1]}"
        )
    return done.stdout


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


# ---------------- methods and peers ready to be called, and rounds of single calls


def callers_of(
    block: Block, robot: Robot, journal: Journal = UNKEPT
) -> tuple[list[Contestant], dict[str, dict[str, Any]]]:
    """Build every method and peer of a block; return those that are ready, and facts on the others."""

    def build(entry: Entry) -> Contestant:
        return enter_peer(entry, PEERS, robot) if entry.role == "peer" else build_ours(entry, robot)

    found = [enter(entry, journal, build) for entry in block.entries]
    return [c for c in found if "absent" not in c.about], {c.label: c.about for c in found if "absent" in c.about}


def build_ours(entry: Entry, robot: Robot) -> Contestant:
    """Build a method of ours."""
    begin, about = time.perf_counter(), facts_on(entry, clocked="time_limit" in entry.options)
    try:
        solver = make_solver(robot, entry.name, **entry.options)
    except (Unsupported, MissingDependency) as error:
        outcome = "refused" if isinstance(error, Unsupported) else "absent"
        return Contestant(entry, about | {"absent": str(error), "outcome": outcome})
    about["build_seconds"] = time.perf_counter() - begin
    return Contestant(
        entry, about, solver.solve, lambda raw: Solutions(raw.q[None], bool(raw), raw.iterations, raw.restarts), solver
    )


FIRST_CALLS = 20
"""Number of calls before the first timed one of each method in a part: they compile, and fill caches."""

LONGEST_ERROR = 200
"""Largest number of characters of an exception in a row."""

OUTCOMES = pl.Enum(["answered", "none", "raised", "crashed", "refused"])
"""Endings of a call: a configuration, none, an exception, the end of its process, or a refusal."""

_time = Field(
    pl.Float64, np.inf, "time (both solved)", "µs", "less", 1e-3, "solved", ("least_ns", "most_ns"), clock="wall"
)

FIELDS = {
    "method": TEXT, "problem": WHOLE, "solved": Field(pl.Boolean, False, "solved", "%", "more"),
    "inside": Field(pl.Boolean, False), **fields_of(Field(pl.Float64, np.nan), "position_error rotation_error"),
    "outcome": Field(OUTCOMES, "crashed"), "error": TEXT, "claimed": TRUTH, **fields_of(WHOLE, "iterations restarts"),
    "changed_input": Field(pl.Boolean, False), "ns": _time, **fields_of(WHOLE, "first_ns least_ns most_ns"),
    "cpu_ns": Field(pl.Float64, np.inf), **fields_of(WHOLE, "answers_ns method_index budget"),
    "any_ns": replace(_time, words="time of any call", only="", stored=False),
}  # fmt: skip
"""Fields of the rows."""


class CallRound(NamedTuple):
    """One contestant's k calls of one round, and whether it changed its arguments."""

    calls: Calls
    changed: NDArray[np.bool_]

    @property
    def times(self) -> pl.DataFrame:
        """Times, and which calls changed their arguments."""
        return pl.DataFrame({"round_ns": self.calls.ns, "round_cpu_ns": self.calls.cpu_ns, "changed": self.changed})


@dataclass(frozen=True)
class Rounds:
    """Rounds of one part; the journal of the block has the contestant of the current round and the finished rows."""

    journal: Journal = UNKEPT
    part: str = ""

    def done(self, caller: Contestant, index: int, turn: int, work: Callable[[], pl.DataFrame]) -> pl.DataFrame:
        """Do a round, unless its rows are stored."""
        name = f"{self.part}-{index:02d}-{turn:02d}"
        rows = self.journal.kept(name)
        if rows is None:
            begin = time.perf_counter()
            with self.journal.at_work(caller.label):
                rows = work()
            self.journal.keep(name, rows, time.perf_counter() - begin)
        return rows


# ---------------------------------------------------------------- timing


def timed_part(
    robot: Robot, problems: ProblemSet, here: NDArray[np.int64], callers: list[Contestant], rounds: int, *,
    seed: int = 0, kept: Rounds | None = None, budget: int | None = None,
) -> pl.DataFrame:  # fmt: skip
    """Time some problems: in every round each contestant takes all of them in turn; their rows name the budget."""
    kept = kept or Rounds()
    mine = [np.intersect1d(here, problems.chosen(c.entry.most)) for c in callers]
    asked = [i for i in range(len(callers)) if len(mine[i])]
    ready = [i for i in asked if not callers[i].ended]
    done: dict[int, list[pl.DataFrame]] = {i: [] for i in ready}
    for i in ready:
        with kept.journal.at_work(callers[i].label):
            one_round(callers[i], problems, mine[i][:FIRST_CALLS], (seed, 0))
    for turn, i in turns(ready, rounds):

        def work(turn: int = turn, i: int = i) -> pl.DataFrame:
            answers = one_round(callers[i], problems, mine[i], (seed, turn))
            # of later rounds only the times are kept: what calls returned would fill the memory
            return _first_round_rows(robot, problems, mine[i], callers[i], answers) if turn == 0 else answers.times

        done[i].append(kept.done(callers[i], i, turn, work))
    frames = [
        (_all_rounds_rows(done[i]) if i in done else _crashed_rows(mine[i], callers[i].ended)).with_columns(
            method=pl.lit(callers[i].label), method_index=pl.lit(i, pl.Int64), budget=pl.lit(budget, pl.Int64)
        )
        for i in asked
    ]
    stored = [name for name, field in FIELDS.items() if field.stored]
    return pl.concat(frame.select(stored) for frame in frames)


def one_round(caller: Contestant, problems: ProblemSet, mine: NDArray[np.int64], trial: tuple[int, int]) -> CallRound:
    """Call one contestant once for each problem, with copies of the target and the initial guess."""
    arguments, (seed, turn) = _arguments(caller, problems, mine), trial

    def again(i: int) -> None:
        reseed(caller.method, seed, int(mine[i]), caller.label, turn)

    # reseeding would clear the caches of a method that uses no random numbers
    calls = timed_calls(caller, arguments, (Exception,), again if caller.about.get("random") else None)
    fresh = _arguments(caller, problems, mine)
    changed = [
        any(not np.array_equal(a, b) for a, b in zip(*pair, strict=True)) for pair in zip(arguments, fresh, strict=True)
    ]
    return CallRound(calls, np.array(changed, dtype=bool))


def _arguments(caller: Contestant, problems: ProblemSet, mine: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    if getattr(caller.method, "takes_start", True):
        return [(problems.targets[i].copy(), problems.starts[i].copy()) for i in mine]
    return [(problems.targets[i].copy(),) for i in mine]


# ---------------------------------------------------------------- what calls returned


def _failure(error: Exception) -> tuple[str, str]:
    """Return how a call failed, and what it said: a refusal where the method says that it does not support the problem."""
    if isinstance(error, Failed):
        return error.outcome, error.error
    outcome = "refused" if isinstance(error, Unsupported) else "raised"
    return outcome, f"{type(error).__name__}: {error}"[:LONGEST_ERROR]


class Reading(NamedTuple):
    """The result of one call, read by its contestant."""

    q: Array
    outcome: str
    error: str | None = None
    claimed: bool | None = None
    iterations: int | None = None
    restarts: int | None = None
    answers_ns: int = 0


def _read(caller: Contestant, raw: Any, n: int) -> Reading:
    """Read the result of one call; a contestant that cannot read it counts as failed."""
    empty = np.empty((0, n))
    if isinstance(raw, Exception):
        return Reading(empty, *_failure(raw))
    begin = time.perf_counter_ns()
    try:
        found: Solutions = caller.read(raw)
        q = np.asarray(found.q, dtype=np.float64)
    except Exception as error:
        return Reading(empty, "raised", _failure(error)[1], answers_ns=time.perf_counter_ns() - begin)
    took = time.perf_counter_ns() - begin
    if q.ndim != 2 or q.shape[1] != n:
        return Reading(empty, "raised", f"answers of shape {q.shape}, not (k, {n})", answers_ns=took)
    outcome = "answered" if np.isfinite(q).all(axis=1).any() else "none"
    return Reading(q, outcome, None, *found[1:], took)


_READ = ("outcome", "error", "claimed", "iterations", "restarts", "answers_ns")
"""Fields that a contestant reads."""


def _first_round_rows(
    robot: Robot, problems: ProblemSet, mine: NDArray[np.int64], caller: Contestant, found: CallRound
) -> pl.DataFrame:
    """Return the first round of one contestant: judged answers, and times."""
    read = [_read(caller, raw, robot.n) for raw in found.calls.raws]
    judgement = judged(robot, problems.targets[mine], [r.q for r in read], wraps=caller.entry.role == "peer")
    columns = {name: pl.Series([getattr(r, name) for r in read], dtype=FIELDS[name].type) for name in _READ}
    return judgement.with_columns(problem=pl.Series(mine), **columns, **found.times.to_dict())


def _all_rounds_rows(rounds: list[pl.DataFrame]) -> pl.DataFrame:
    """Return the rows of one contestant: judged answers of the first round, times of all."""
    ns, cpu_ns, changed = (
        np.stack([one[name].to_numpy() for one in rounds]) for name in ("round_ns", "round_cpu_ns", "changed")
    )
    return rounds[0].with_columns(
        changed_input=pl.Series(changed.any(axis=0)),
        ns=pl.Series(np.median(ns, axis=0)),
        first_ns=pl.Series(ns[0]),
        least_ns=pl.Series(ns.min(axis=0)),
        most_ns=pl.Series(ns.max(axis=0)),
        cpu_ns=pl.Series(np.median(cpu_ns, axis=0)),
    )


def _crashed_rows(mine: NDArray[np.int64], why: str) -> pl.DataFrame:
    """Return the rows of a contestant that has ended the process: it answered nothing, and never returned."""
    lost = {name: pl.lit(field.lost, field.type) for name, field in FIELDS.items() if field.stored}
    lost |= {"problem": pl.col("problem"), "error": pl.lit(why[:LONGEST_ERROR])}
    return pl.DataFrame({"problem": pl.Series(mine)}).with_columns(**lost)
