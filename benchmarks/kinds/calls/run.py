"""Time single calls: every problem by every method and peer in one process, in rounds, each call as a whole."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.kinds._contest import clock_cost, timed, turns
from benchmarks.kinds._problems import store_problems
from benchmarks.kinds.base import Tell
from benchmarks.kinds.calls.callers import Caller, callers_of
from benchmarks.kinds.calls.judgement import judged
from benchmarks.kinds.calls.settings import CallBlock
from benchmarks.peers.ik.base import Failed
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.records import UNKEPT, Journal, RunFolder, slug
from optik.arm.robot import Robot
from optik.errors import Unsupported
from optik.types import Array

CALL_PART = 2000
"""Problems in one part: each method takes them in a row, so a disturbance that lasts longer affects all methods alike."""

FIRST_CALLS = 20
"""Calls before the first timed one of each method in a part: they compile, and fill caches."""

LONGEST_ERROR = 200
"""Characters of an exception that a row keeps."""


# ---------------------------------------------------------------- parts


def facts_file(block: CallBlock) -> str:
    """Name of the file of facts on a block.

    Parameters
    ----------
    block : CallBlock
        The block.

    Returns
    -------
    str
        In the run folder.
    """
    return f"speed/{slug(block.id)}.json"


def part_files(block: CallBlock, count: int) -> list[str]:
    """Names of all parts of a block.

    Parameters
    ----------
    block : CallBlock
        The block.
    count : int
        Of its problems.

    Returns
    -------
    list of str
        In the run folder.
    """
    return [f"speed/{slug(block.id)}--{part:04d}.parquet" for part in range(-(-count // CALL_PART))]


def run_calls(block: CallBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal) -> None:
    """Run what a block still lacks.

    Parameters
    ----------
    block : CallBlock
        The block.
    seed : int
        Of the suite.
    folder : RunFolder
        The run.
    tell : callable
        Called with what is next.
    journal : Journal
        Of the block.
    """
    facts = facts_file(block)
    before = folder.read_json(facts) or {"count": None, "entries": {}}
    count = before["count"]
    if count is not None and all(folder.has(part) for part in part_files(block, count)):
        return
    tell(f"{block.id}: problems")
    robot, problems = problem_set(block, seed)
    store_problems(folder, block, robot, problems, poses=False)
    tell(f"{block.id}: building")
    callers, absent = callers_of(block, robot, journal)
    known = before["entries"]  # of a method that is not built again
    entries = {c.label: known.get(c.label, c.about) if c.ended else c.about for c in callers} | absent
    folder.write_json(facts, {"count": len(problems), "clock_ns": clock_cost(), "entries": entries})
    for part, file in enumerate(part_files(block, len(problems))):
        if not folder.has(file):
            tell(f"{block.id}: {part * CALL_PART:,} of {len(problems):,}")
            here = np.arange(part * CALL_PART, min((part + 1) * CALL_PART, len(problems)))
            kept = Rounds(journal, f"{part:04d}")
            folder.write(file, timed_part(robot, problems, here, callers, block.rounds, seed=seed, kept=kept))


# ---------------------------------------------------------------- timing


class Round(NamedTuple):
    """One caller's calls of one round.

    Attributes
    ----------
    ns : (k,) array of int
        Time of each call [ns].
    cpu_ns : (k,) array
        Processor time of all threads of the process [ns], the mean over the round; of each call, in a worker process.
    raws : list of k objects
        What each returned, or `Failed`.
    changed : (k,) array of bool
        Whether the call changed its target or its initial guess.
    """

    ns: NDArray[np.int64]
    cpu_ns: Array
    raws: list[Any]
    changed: NDArray[np.bool_]


@dataclass(frozen=True)
class Rounds:
    """Rounds of one part, in the journal of its block.

    Attributes
    ----------
    journal : Journal
        Says whose round it is while it lasts, and keeps what is finished.
    part : str
        Name of the part.
    """

    journal: Journal = UNKEPT
    part: str = ""

    def done(self, caller: Caller, index: int, turn: int, work: Callable[[], pl.DataFrame]) -> pl.DataFrame:
        """Do a round, unless it is kept.

        Parameters
        ----------
        caller : Caller
            Whose round.
        index : int
            Its place.
        turn : int
            Number of the round.
        work : callable
            Does it.

        Returns
        -------
        DataFrame
            What the work returned.
        """
        name = f"{self.part}-{index:02d}-{turn:02d}"
        rows = self.journal.kept(name)
        if rows is None:
            begin = time.perf_counter()
            with self.journal.at_work(caller.label):
                rows = work()
            self.journal.keep(name, rows, time.perf_counter() - begin)
        return rows


def timed_part(
    robot: Robot,
    problems: ProblemSet,
    here: NDArray[np.int64],
    callers: list[Caller],
    rounds: int,
    *,
    seed: int = 0,
    kept: Rounds | None = None,
) -> pl.DataFrame:
    """Time some problems: in every round each caller takes all of them, one after another.

    Parameters
    ----------
    robot : Robot
        The arm.
    problems : ProblemSet
        All problems of the block.
    here : (k,) array of int
        Numbers of those in this part.
    callers : list of Caller
        Methods and peers.
    rounds : int
        How often each problem is solved.
    seed : int
        Of the suite, for methods that draw random numbers.
    kept : Rounds, optional
        Rounds of this part that an earlier process has finished.

    Returns
    -------
    DataFrame
        One row for each problem and caller: the time of a call is the median of its rounds, the answer is that of the
        first round. All calls of a caller that has ended the process count as crashed.
    """
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
            return _answers(robot, problems, mine[i], callers[i], found) if turn == 0 else _times(found)

        done[i].append(kept.done(callers[i], i, turn, work))
    frames = [
        (_rows(done[i]) if i in done else crashed_rows(mine[i], callers[i].ended)).with_columns(
            method=pl.lit(callers[i].label), method_index=pl.lit(i)
        )
        for i in given
    ]
    return pl.concat(frames)


def one_round(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64], trial: tuple[int, int]) -> Round:
    """Call one caller once for each problem, with copies of its own of the target and the initial guess.

    Parameters
    ----------
    caller : Caller
        The caller.
    problems : ProblemSet
        All problems of the block.
    mine : (k,) array of int
        Numbers of the problems that it is given.
    trial : tuple of int
        Seed of the suite and number of the round, which key random numbers.

    Returns
    -------
    Round
        What came of it.
    """
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


def _failed(error: Exception) -> Failed:
    """An exception of a call: a refusal where the method says that it does not support the problem."""
    outcome = "refused" if isinstance(error, Unsupported) else "raised"
    return Failed(outcome, f"{type(error).__name__}: {error}"[:LONGEST_ERROR])


def _arguments(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    if caller.takes_start:
        return [(problems.targets[i].copy(), problems.starts[i].copy()) for i in mine]
    return [(problems.targets[i].copy(),) for i in mine]


# ---------------------------------------------------------------- rows


class Reading(NamedTuple):
    """What one call returned, read by its caller."""

    q: Array
    outcome: str
    error: str | None
    claimed: bool | None
    iterations: int | None
    restarts: int | None
    answers_ns: int


def reading(caller: Caller, raw: Any, n: int) -> Reading:
    """Read what one call returned; a caller that cannot read it has raised.

    Parameters
    ----------
    caller : Caller
        Whose call it was.
    raw : object
        What it returned, or `Failed`.
    n : int
        Number of joints.

    Returns
    -------
    Reading
        Its configurations, outcome, claim and counts.
    """
    empty = np.empty((0, n))
    if isinstance(raw, Failed):
        return Reading(empty, raw.outcome, raw.error, None, None, None, 0)
    begin = time.perf_counter_ns()
    try:
        q = np.asarray(caller.answers(raw), dtype=np.float64)
        took = time.perf_counter_ns() - begin
        if q.ndim != 2 or q.shape[1] != n:
            return Reading(empty, "raised", f"answers of shape {q.shape}, not (k, {n})", None, None, None, took)
        claimed, (iterations, restarts) = caller.claims(raw), caller.counts(raw)
    except Exception as error:
        return Reading(empty, "raised", _failed(error).error, None, None, None, time.perf_counter_ns() - begin)
    outcome = "answered" if np.isfinite(q).all(axis=1).any() else "none"
    return Reading(q, outcome, None, claimed, iterations, restarts, took)


OUTCOMES = pl.Enum(["answered", "none", "raised", "crashed", "refused"])
"""How a call ended: with a configuration, with none, with an exception, with its process, or it was refused."""


def _answers(robot: Robot, problems: ProblemSet, mine: NDArray[np.int64], caller: Caller, found: Round) -> pl.DataFrame:
    """The first round of one caller: judged answers, and times."""
    read = [reading(caller, raw, robot.n) for raw in found.raws]
    judgement = judged(robot, problems.targets[mine], [r.q for r in read], wraps=caller.wraps)
    return judgement.with_columns(
        problem=pl.Series(mine),
        outcome=pl.Series([r.outcome for r in read], dtype=OUTCOMES),
        error=pl.Series([r.error for r in read], dtype=pl.String),
        claimed=pl.Series([r.claimed for r in read], dtype=pl.Boolean),
        iterations=pl.Series([r.iterations for r in read], dtype=pl.Int64),
        restarts=pl.Series([r.restarts for r in read], dtype=pl.Int64),
        answers_ns=pl.Series([r.answers_ns for r in read], dtype=pl.Int64),
        **_times(found).to_dict(),
    )


def _times(found: Round) -> pl.DataFrame:
    """Times of one round, and which calls changed their arguments."""
    return pl.DataFrame({"round_ns": found.ns, "round_cpu_ns": found.cpu_ns, "changed": found.changed})


def _rows(rounds: list[pl.DataFrame]) -> pl.DataFrame:
    """Rows of one caller: judged answers of the first round, times of all."""
    ns, cpu_ns, changed = (
        np.stack([one[name].to_numpy() for one in rounds]) for name in ("round_ns", "round_cpu_ns", "changed")
    )
    return rounds[0].select(
        *JUDGED,
        changed_input=pl.Series(changed.any(axis=0)),
        ns=pl.Series(np.median(ns, axis=0)),
        first_ns=pl.Series(ns[0]),
        least_ns=pl.Series(ns.min(axis=0)),
        most_ns=pl.Series(ns.max(axis=0)),
        cpu_ns=pl.Series(np.median(cpu_ns, axis=0)),
        answers_ns=pl.col("answers_ns"),
    )


JUDGED = (
    "solved", "inside", "position_error", "rotation_error", "problem", "outcome", "error", "claimed", "iterations",
    "restarts",
)  # fmt: skip
"""Columns on the answer of a call, beside those on its times."""


def crashed_rows(mine: NDArray[np.int64], why: str) -> pl.DataFrame:
    """Rows of a caller that has ended the process: it answered nothing, and never returned.

    Parameters
    ----------
    mine : (k,) array of int
        Numbers of its problems.
    why : str
        How the process ended.

    Returns
    -------
    DataFrame
        Columns as of any other caller; the times are infinite, and missing where they are whole numbers.
    """
    return pl.DataFrame({"problem": pl.Series(mine)}).select(
        solved=pl.lit(False),
        inside=pl.lit(False),
        position_error=pl.lit(np.nan),
        rotation_error=pl.lit(np.nan),
        problem=pl.col("problem"),
        outcome=pl.lit("crashed", dtype=OUTCOMES),
        error=pl.lit(why[:LONGEST_ERROR]),
        claimed=pl.lit(None, dtype=pl.Boolean),
        iterations=pl.lit(None, dtype=pl.Int64),
        restarts=pl.lit(None, dtype=pl.Int64),
        changed_input=pl.lit(False),
        ns=pl.lit(np.inf),
        **{name: pl.lit(None, dtype=pl.Int64) for name in ("first_ns", "least_ns", "most_ns")},
        cpu_ns=pl.lit(np.inf),
        answers_ns=pl.lit(None, dtype=pl.Int64),
    )


# ---------------------------------------------------------------- reading


def read_rows(folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
    """All rows of a block with what is known of each problem: group, singular value, whether a solution is known.

    Parameters
    ----------
    folder : RunFolder
        The run.
    block : CallBlock
        The block.

    Returns
    -------
    DataFrame or None
        None where nothing was run.
    """
    problems = folder.read(f"problems/{slug(block.id)}.parquet")
    rows = folder.parts("speed", block.id)
    if problems is None or rows is None:
        return None
    facts = ("problem", "group", "sigma", "known", "unreachable")  # the last is missing in runs of older versions
    return rows.join(problems.select(name for name in facts if name in problems.columns), on="problem").sort(
        "method_index", "problem"
    )
