"""What the rounds of a block of single calls say beside one time a call: spread, first round, and changed inputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.problems.base import ProblemSet
from optik.types import Flags

REMEMBERS_FROM = 3.0
"""A first round this many times as slow as the median of all rounds: the method may remember answers, or compile late."""


def round_times(times: list[NDArray[np.int64]]) -> dict[str, pl.Series]:
    """Columns of the times of every call over its rounds.

    The first round stands apart: a method that remembers earlier answers is fast in all others only.

    Parameters
    ----------
    times : list of (k,) arrays of int
        Times of each round [ns].

    Returns
    -------
    dict
        ``ns``, the median, ``ns_first``, ``ns_min`` and ``ns_max`` [ns].
    """
    return {
        "ns": pl.Series(np.median(times, axis=0)),
        "ns_first": pl.Series(times[0]),
        "ns_min": pl.Series(np.min(times, axis=0)),
        "ns_max": pl.Series(np.max(times, axis=0)),
    }


def changed_inputs(given: list[tuple[Any, ...]], problems: ProblemSet, mine: NDArray[np.int64]) -> Flags:
    """Whether a call has changed the target or the start that it was given: its own copies.

    Parameters
    ----------
    given : list of k tuples
        Arguments of each call, after it.
    problems : ProblemSet
        All problems of the block.
    mine : (k,) array of int
        Number of the problem of each call.

    Returns
    -------
    (k,) array of bool
        True where anything differs.
    """
    wanted = (problems.targets, problems.starts)
    return np.array(
        [
            any(not np.array_equal(now, before[i]) for now, before in zip(arguments, wanted, strict=False))
            for arguments, i in zip(given, mine, strict=True)
        ],
        dtype=bool,
    )


def without_memory(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows in which a method whose later rounds are far faster than its first is timed by its first round.

    Every round has the same problems, so a method that remembers its answers has to compute in the first only.

    Parameters
    ----------
    rows : DataFrame
        Of a block.

    Returns
    -------
    DataFrame
        The rows, ``ns`` replaced for these methods; those of a run without ``ns_first`` as they are.
    """
    if "ns_first" not in rows.columns:
        return rows
    first, typical = (pl.col(name).median().over("method") for name in ("ns_first", "ns"))
    by_first = (first > REMEMBERS_FROM * typical).fill_null(value=False)
    ns = pl.when(by_first).then(pl.col("ns_first").cast(pl.Float64)).otherwise(pl.col("ns"))
    return rows.with_columns(first_round=first / typical, ns=ns)
