"""What calls did and returned, as rows: each answer judged, each time kept, and those that never returned."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks.ik.calls.callers import Caller
from benchmarks.blocks.ik.calls.judgement import judged
from benchmarks.peers.ik.base import Failed
from benchmarks.problems.base import ProblemSet
from optik.arm.robot import Robot
from optik.errors import Unsupported
from optik.types import Array

LONGEST_ERROR = 200
"""Characters of an exception that a row keeps."""

OUTCOMES = pl.Enum(["answered", "none", "raised", "crashed", "refused"])
"""How a call ended: with a configuration, with none, with an exception, with its process, or it was refused."""

JUDGED = (
    "solved", "inside", "position_error", "rotation_error", "problem", "outcome", "error", "claimed", "iterations",
    "restarts",
)  # fmt: skip
"""Columns on the answer of a call, beside those on its times."""


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


def failed(error: Exception) -> Failed:
    """An exception of a call: a refusal where the method says that it does not support the problem."""
    outcome = "refused" if isinstance(error, Unsupported) else "raised"
    return Failed(outcome, f"{type(error).__name__}: {error}"[:LONGEST_ERROR])


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
    """Read what one call returned; a caller that cannot read it has raised."""
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
        return Reading(empty, "raised", failed(error).error, None, None, None, time.perf_counter_ns() - begin)
    outcome = "answered" if np.isfinite(q).all(axis=1).any() else "none"
    return Reading(q, outcome, None, claimed, iterations, restarts, took)


def first_round_rows(
    robot: Robot, problems: ProblemSet, mine: NDArray[np.int64], caller: Caller, found: Round
) -> pl.DataFrame:
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
        **times_of(found).to_dict(),
    )


def times_of(found: Round) -> pl.DataFrame:
    """Times of one round, and which calls changed their arguments."""
    return pl.DataFrame({"round_ns": found.ns, "round_cpu_ns": found.cpu_ns, "changed": found.changed})


def all_rounds_rows(rounds: list[pl.DataFrame]) -> pl.DataFrame:
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


def crashed_rows(mine: NDArray[np.int64], why: str) -> pl.DataFrame:
    """Rows of a caller that has ended the process: it answered nothing, and never returned."""
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
