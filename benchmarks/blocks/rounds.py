"""Methods and peers ready to be called, and rounds of single calls, whose answers are read and judged."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks.base import TEXT, TRUTH, WHOLE, Field, fields_of
from benchmarks.blocks.block import Block, Entry
from benchmarks.blocks.contest import facts_on, reseed, timed, turns
from benchmarks.blocks.judgement import judged
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import Absent, Answer, Failed, build_peer, version_of
from benchmarks.peers.ik.worker import WorkerPeer
from benchmarks.problems.base import ProblemSet
from benchmarks.records import UNKEPT, Journal
from optik.arm.robot import Robot
from optik.errors import MissingDependency, Unsupported
from optik.ik import IKSolver, make_solver
from optik.registry import load_method
from optik.types import Array


@dataclass(frozen=True)
class Caller:
    """One of our methods or a peer, ready to be called."""

    label: str
    call: Callable[..., Any]  # the timed part: (target, q0), or (target) where it takes no initial guess
    takes_start: bool
    answers: Callable[[Any], Array]  # from what a call returned to configurations (k, n) [rad, m]
    counts: Callable[[Any], tuple[int | None, int | None]]  # to iterations and restarts, None where it does not say
    wraps: bool  # whether full turns may be added to bring an answer inside the limits
    most: int | None  # how many problems it is given
    about: dict[str, Any] = field(default_factory=dict)  # facts for the report
    claims: Callable[[Any], bool | None] = lambda raw: (
        None
    )  # whether it says that it succeeded, None where it does not say
    many: Callable[[Sequence[tuple[Any, ...]]], list[Answer]] | None = None  # calls that are timed in a worker process
    # sets the random numbers of one trial: (seed of the suite, number of the problem, trial); None for a method that draws
    # none, since setting them costs it its caches
    reseed: Callable[[int, int, int], None] | None = None
    ended: str = ""  # how it ended the process in this block; such a method is not called again


def callers_of(block: Block, robot: Robot, journal: Journal = UNKEPT) -> tuple[list[Caller], dict[str, dict[str, Any]]]:
    """Build every method and peer of a block; return those that are ready, and facts on the others."""
    ready: list[Caller] = []
    absent: dict[str, dict[str, Any]] = {}
    for entry in block.entries:
        if entry.label in journal.crashed:
            ready.append(_crashed(entry, journal.crashed[entry.label]))
            continue
        with journal.at_work(entry.label):
            built = (_peer if entry.role == "peer" else _ours)(entry, robot)
        if isinstance(built, Caller):
            ready.append(built)
        else:
            absent[entry.label] = built
    return ready, absent


def _crashed(entry: Entry, why: str) -> Caller:
    """Return a method that has ended the process: it is not even built again, since it may have been that."""

    def never(*given: Any) -> Any:
        raise AssertionError(f"{entry.label} is not called again")

    about = facts_on(entry) | {"clocked": False, "random": False}
    return Caller(entry.label, never, True, never, never, False, entry.most, about, ended=why)


def build_ours(entry: Entry, robot: Robot) -> IKSolver | Absent:
    """Build a method of ours."""
    try:
        return make_solver(robot, entry.name, **entry.options)
    except Unsupported as error:
        return Absent(str(error), "refused")
    except MissingDependency as error:
        return Absent(str(error))


def _ours(entry: Entry, robot: Robot) -> Caller | dict[str, Any]:
    """Return a method of ours, or the facts on it if it is not run."""
    begin = time.perf_counter()
    built = build_ours(entry, robot)
    about = facts_on(entry, build_seconds=time.perf_counter() - begin, clocked="time_limit" in entry.options)
    if isinstance(built, Absent):
        return about | {"absent": built.why, "outcome": built.outcome}

    def counts(raw: Any) -> tuple[int | None, int | None]:
        return raw.iterations, raw.restarts

    return Caller(entry.label, built.solve, True, lambda raw: raw.q[None], counts, False, entry.most, about, bool)


def _peer(entry: Entry, robot: Robot) -> Caller | dict[str, Any]:
    """Return a peer, or the facts on it if it is not run."""
    budget = entry.options.get("iterations")
    begin = time.perf_counter()
    peer = build_peer(entry.name, robot, iterations=budget)
    seconds = time.perf_counter() - begin
    kind = load_method(PEERS, entry.name, "peer")
    settings = kind.settings
    if budget is not None:
        settings = f"at most {budget:,} iterations; otherwise {settings}"
    about = facts_on(entry) | {"version": version_of(entry.name), "settings": settings}
    about |= {"clocked": kind.clocked, "random": kind.random}
    if isinstance(peer, Absent):
        return about | {"absent": peer.why, "outcome": peer.outcome}

    def counts(raw: Any) -> tuple[int | None, int | None]:
        return peer.iterations(raw), None

    def again(seed: int, problem: int, trial: int) -> None:
        reseed(peer, seed, problem, entry.label, trial)

    return Caller(
        entry.label, peer.call, peer.takes_start, peer.answers, counts, True, entry.most, about | {"build_seconds": seconds},
        peer.claims, peer.many if isinstance(peer, WorkerPeer) else None, again if kind.random else None,
    )  # fmt: skip


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


class Round(NamedTuple):
    """One caller's k calls of one round: times [ns], results, and whether it changed its arguments.

    The processor time is that of all threads of the process, the mean over the round; of each call in a worker process.
    """

    ns: NDArray[np.int64]
    cpu_ns: Array
    raws: list[Any]
    changed: NDArray[np.bool_]

    @property
    def times(self) -> pl.DataFrame:
        """Times, and which calls changed their arguments."""
        return pl.DataFrame({"round_ns": self.ns, "round_cpu_ns": self.cpu_ns, "changed": self.changed})


@dataclass(frozen=True)
class Rounds:
    """Rounds of one part; the journal of the block has the caller of the current round and the finished rows."""

    journal: Journal = UNKEPT
    part: str = ""

    def done(self, caller: Caller, index: int, turn: int, work: Callable[[], pl.DataFrame]) -> pl.DataFrame:
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
    robot: Robot,
    problems: ProblemSet,
    here: NDArray[np.int64],
    callers: list[Caller],
    rounds: int,
    *,
    seed: int = 0,
    kept: Rounds | None = None,
    budget: int | None = None,
) -> pl.DataFrame:
    """Time some problems: in every round each caller takes all of them, one after another; their rows name the budget."""
    kept = kept or Rounds()
    mine = [np.intersect1d(here, problems.chosen(c.most)) for c in callers]
    given = [i for i in range(len(callers)) if len(mine[i])]
    ready = [i for i in given if not callers[i].ended]
    done: dict[int, list[pl.DataFrame]] = {i: [] for i in ready}
    for i in ready:
        with kept.journal.at_work(callers[i].label):
            one_round(callers[i], problems, mine[i][:FIRST_CALLS], (seed, 0))
    for turn, i in turns(ready, rounds):

        def work(turn: int = turn, i: int = i) -> pl.DataFrame:
            found = one_round(callers[i], problems, mine[i], (seed, turn))
            # of later rounds only the times are kept: what calls returned would fill the memory
            return _first_round_rows(robot, problems, mine[i], callers[i], found) if turn == 0 else found.times

        done[i].append(kept.done(callers[i], i, turn, work))
    frames = [
        (_all_rounds_rows(done[i]) if i in done else _crashed_rows(mine[i], callers[i].ended)).with_columns(
            method=pl.lit(callers[i].label), method_index=pl.lit(i, pl.Int64), budget=pl.lit(budget, pl.Int64)
        )
        for i in given
    ]
    stored = [name for name, field in FIELDS.items() if field.stored]
    return pl.concat(frame.select(stored) for frame in frames)


def one_round(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64], trial: tuple[int, int]) -> Round:
    """Call one caller once for each problem, with copies of the target and the initial guess."""
    arguments = _arguments(caller, problems, mine)
    if caller.many is not None:
        answers = caller.many(arguments)
        ns = np.array([a.ns for a in answers], dtype=np.int64)
        cpu = np.array([np.nan if a.cpu_ns is None else a.cpu_ns for a in answers], dtype=np.float64)
        raws = [a.raw for a in answers]
    else:
        again, (seed, turn) = caller.reseed, trial
        before = None if again is None else lambda i: again(seed, int(mine[i]), turn)
        begin = time.process_time_ns()
        ns, raws = timed(caller.call, arguments, keep_errors=True, before=before)
        cpu = np.full(len(mine), (time.process_time_ns() - begin) / max(len(mine), 1))
        raws = [_failed(raw) if isinstance(raw, Exception) else raw for raw in raws]
    fresh = _arguments(caller, problems, mine)
    changed = [
        any(not np.array_equal(a, b) for a, b in zip(*pair, strict=True)) for pair in zip(arguments, fresh, strict=True)
    ]
    return Round(ns, cpu, raws, np.array(changed, dtype=bool))


def _arguments(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    if caller.takes_start:
        return [(problems.targets[i].copy(), problems.starts[i].copy()) for i in mine]
    return [(problems.targets[i].copy(),) for i in mine]


# ---------------------------------------------------------------- what calls returned


def _failed(error: Exception) -> Failed:
    """Return an exception of a call: a refusal where the method says that it does not support the problem."""
    outcome = "refused" if isinstance(error, Unsupported) else "raised"
    return Failed(outcome, f"{type(error).__name__}: {error}"[:LONGEST_ERROR])


class Reading(NamedTuple):
    """The result of one call, read by its caller."""

    q: Array
    outcome: str
    error: str | None = None
    claimed: bool | None = None
    iterations: int | None = None
    restarts: int | None = None
    answers_ns: int = 0


def _read(caller: Caller, raw: Any, n: int) -> Reading:
    """Read the result of one call; a caller that cannot read it counts as failed."""
    empty = np.empty((0, n))
    if isinstance(raw, Failed):
        return Reading(empty, raw.outcome, raw.error)
    begin = time.perf_counter_ns()
    try:
        q = np.asarray(caller.answers(raw), dtype=np.float64)
        took = time.perf_counter_ns() - begin
        if q.ndim != 2 or q.shape[1] != n:
            return Reading(empty, "raised", f"answers of shape {q.shape}, not (k, {n})", answers_ns=took)
        claimed, counts = caller.claims(raw), caller.counts(raw)
    except Exception as error:
        return Reading(empty, "raised", _failed(error).error, answers_ns=time.perf_counter_ns() - begin)
    outcome = "answered" if np.isfinite(q).all(axis=1).any() else "none"
    return Reading(q, outcome, None, claimed, *counts, took)


_READ = ("outcome", "error", "claimed", "iterations", "restarts", "answers_ns")
"""Fields that a caller reads."""


def _first_round_rows(
    robot: Robot, problems: ProblemSet, mine: NDArray[np.int64], caller: Caller, found: Round
) -> pl.DataFrame:
    """Return the first round of one caller: judged answers, and times."""
    read = [_read(caller, raw, robot.n) for raw in found.raws]
    judgement = judged(robot, problems.targets[mine], [r.q for r in read], wraps=caller.wraps)
    columns = {name: pl.Series([getattr(r, name) for r in read], dtype=FIELDS[name].type) for name in _READ}
    return judgement.with_columns(problem=pl.Series(mine), **columns, **found.times.to_dict())


def _all_rounds_rows(rounds: list[pl.DataFrame]) -> pl.DataFrame:
    """Return the rows of one caller: judged answers of the first round, times of all."""
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
    """Return the rows of a caller that has ended the process: it answered nothing, and never returned."""
    lost = {name: pl.lit(field.lost, field.type) for name, field in FIELDS.items() if field.stored}
    lost |= {"problem": pl.col("problem"), "error": pl.lit(why[:LONGEST_ERROR])}
    return pl.DataFrame({"problem": pl.Series(mine)}).with_columns(**lost)
