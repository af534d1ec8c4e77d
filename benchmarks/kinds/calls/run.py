"""Time single calls: every problem by every method and peer in one process, in rounds, each call as a whole."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.kinds._contest import clock_cost, facts_on, timed, turns
from benchmarks.kinds._problems import store_problems
from benchmarks.kinds.base import Entry, Tell
from benchmarks.kinds.calls.evaluations import evaluations_file, run_evaluations
from benchmarks.kinds.calls.judgement import judged
from benchmarks.kinds.calls.rounds import changed_inputs, round_times
from benchmarks.kinds.calls.settings import CallBlock
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import Absent, build_peer, version_of
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.records import RunFolder, slug
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.registry import load_method
from optik.types import Array

CALL_PART = 2000
"""Problems in one part: each method takes them in a row, so a disturbance that lasts longer affects all methods alike."""

FIRST_CALLS = 20
"""Calls before the first timed one of each method in a part: they compile, and fill caches."""


@dataclass(frozen=True)
class Caller:
    """One of our methods or a peer, built and ready to be called.

    Attributes
    ----------
    label : str
        What reports call it.
    call : callable
        The timed part: (target, q0), or (target) where it takes no initial guess.
    takes_start : bool
        Which of the two.
    answers : callable
        From what a call returned to configurations (k, n) [rad, m].
    counts : callable
        From what a call returned to iterations and restarts, None where it does not say.
    wraps : bool
        Whether full turns may be added to bring an answer inside the limits.
    most : int or None
        How many problems it is given.
    about : dict
        Facts for the report.
    """

    label: str
    call: Callable[..., Any]
    takes_start: bool
    answers: Callable[[Any], Array]
    counts: Callable[[Any], tuple[int | None, int | None]]
    wraps: bool
    most: int | None
    about: dict[str, Any] = field(default_factory=dict)


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


def run_calls(block: CallBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
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
    """
    facts = facts_file(block)
    count = folder.read_json(facts)["count"] if folder.has(facts) else None
    if count is not None and all(folder.has(part) for part in _all_files(block, count)):
        return
    tell(f"{block.id}: problems")
    robot, problems = problem_set(block, seed)
    store_problems(folder, block, robot, problems, poses=False)
    tell(f"{block.id}: building")
    callers, absent = callers_of(block, robot)
    entries = {c.label: c.about for c in callers} | absent
    folder.write_json(facts, {"count": len(problems), "clock_ns": clock_cost(), "entries": entries})
    for part, file in enumerate(part_files(block, len(problems))):
        if not folder.has(file):
            tell(f"{block.id}: {part * CALL_PART:,} of {len(problems):,}")
            here = np.arange(part * CALL_PART, min((part + 1) * CALL_PART, len(problems)))
            folder.write(file, timed_part(robot, problems, here, callers, block.rounds))
    run_evaluations(block, robot, problems, folder, tell)


def _all_files(block: CallBlock, count: int) -> list[str]:
    """All files of rows: a block that has them is done."""
    return part_files(block, count) + ([evaluations_file(block)] if block.evaluation_budgets else [])


# ---------------------------------------------------------------- who takes part


def callers_of(block: CallBlock, robot: Robot) -> tuple[list[Caller], dict[str, dict[str, Any]]]:
    """Build every method and peer.

    Parameters
    ----------
    block : CallBlock
        The block.
    robot : Robot
        The arm.

    Returns
    -------
    ready : list of Caller
        All that could be built.
    absent : dict
        Facts on those that could not, by label.
    """
    ready = [_ours(entry, robot) for entry in block.methods]
    absent: dict[str, dict[str, Any]] = {}
    for entry in block.peers:
        built = _peer(entry, robot)
        if isinstance(built, Caller):
            ready.append(built)
        else:
            absent[entry.label] = built
    return ready, absent


def _ours(entry: Entry, robot: Robot) -> Caller:
    begin = time.perf_counter()
    built = make_solver(robot, entry.name, **entry.options)
    about = facts_on(entry, build_seconds=time.perf_counter() - begin)

    def counts(raw: Any) -> tuple[int | None, int | None]:
        return raw.iterations, raw.restarts

    return Caller(entry.label, built.solve, True, lambda raw: raw.q[None], counts, False, entry.most, about)


def _peer(entry: Entry, robot: Robot) -> Caller | dict[str, Any]:
    """A peer; facts on it where it could not be built."""
    begin = time.perf_counter()
    peer = build_peer(entry.name, robot)
    seconds = time.perf_counter() - begin
    settings = load_method(PEERS, entry.name, "peer").settings
    about = facts_on(entry) | {"version": version_of(entry.name), "settings": settings}
    if isinstance(peer, Absent):
        return about | {"absent": peer.why}

    def counts(raw: Any) -> tuple[int | None, int | None]:
        return peer.iterations(raw), None

    about |= {"build_seconds": seconds}
    return Caller(entry.label, peer.call, peer.takes_start, peer.answers, counts, True, entry.most, about)


# ---------------------------------------------------------------- timing


def timed_part(
    robot: Robot, problems: ProblemSet, here: NDArray[np.int64], callers: list[Caller], rounds: int
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

    Returns
    -------
    DataFrame
        One row for each problem and caller: the time of a call is the median of its rounds, the answer is that of the
        first round.
    """
    mine = {c.label: np.intersect1d(here, problems.chosen(c.most)) for c in callers}
    ready = [c for c in callers if len(mine[c.label])]
    times: dict[str, list[NDArray[np.int64]]] = {c.label: [] for c in ready}
    raws: dict[str, list[Any]] = {}
    changed = {c.label: np.zeros(len(mine[c.label]), dtype=bool) for c in ready}
    for caller in ready:
        for arguments in _arguments(caller, problems, mine[caller.label][:FIRST_CALLS]):
            caller.call(*arguments)
    for _, caller in turns(ready, rounds):
        # copies for every round: what a call changes in its arguments must not help, or harm, a later one
        given = _arguments(caller, problems, mine[caller.label])
        took, raw = timed(caller.call, given)
        times[caller.label].append(took)
        raws.setdefault(caller.label, raw)
        changed[caller.label] |= changed_inputs(given, problems, mine[caller.label])
    frames = [
        _rows(robot, problems, mine[c.label], c, raws[c.label]).with_columns(
            **round_times(times[c.label]),
            mutated=pl.Series(changed[c.label]),
            method=pl.lit(c.label),
            method_index=pl.lit(callers.index(c)),
        )
        for c in ready
    ]
    return pl.concat(frames)


def _arguments(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    if caller.takes_start:
        return [(problems.targets[i].copy(), problems.starts[i].copy()) for i in mine]
    return [(problems.targets[i].copy(),) for i in mine]


def _rows(robot: Robot, problems: ProblemSet, mine: NDArray[np.int64], caller: Caller, raws: list[Any]) -> pl.DataFrame:
    """Rows of one caller, without its times."""
    answers = [caller.answers(raw) for raw in raws]
    counts = [caller.counts(raw) for raw in raws]
    return judged(robot, problems.targets[mine], answers, wraps=caller.wraps).with_columns(
        problem=pl.Series(mine),
        iterations=pl.Series([c[0] for c in counts], dtype=pl.Int64),
        restarts=pl.Series([c[1] for c in counts], dtype=pl.Int64),
    )


# ---------------------------------------------------------------- reading


def read_rows(folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
    """All rows of a block with the group of each problem.

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
    return rows.join(problems.select("problem", "group", "sigma", "known"), on="problem").sort(
        "method_index", "problem"
    )
