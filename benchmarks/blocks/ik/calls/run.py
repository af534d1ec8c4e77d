"""Time single calls: every problem by every method and peer in one process, in rounds, each call as a whole."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks._contest import clock_cost, timed, turns
from benchmarks.blocks._problems import store_problems
from benchmarks.blocks.base import Tell
from benchmarks.blocks.ik.calls.callers import Caller, callers_of
from benchmarks.blocks.ik.calls.returned import Round, all_rounds_rows, crashed_rows, failed, first_round_rows, times_of
from benchmarks.blocks.ik.calls.settings import CallBlock
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.records import UNKEPT, Journal, RunFolder, slug
from optik.arm.robot import Robot

CALL_PART = 2000
"""Problems in one part: each method takes them in a row, so a disturbance that lasts longer affects all methods alike."""

FIRST_CALLS = 20
"""Calls before the first timed one of each method in a part: they compile, and fill caches."""

# ---------------------------------------------------------------- parts


def facts_file(block: CallBlock) -> str:
    """Name of the file of facts on a block."""
    return f"speed/{slug(block.id)}.json"


def part_files(block: CallBlock, count: int) -> list[str]:
    """Names of all parts of a block."""
    return [f"speed/{slug(block.id)}--{part:04d}.parquet" for part in range(-(-count // CALL_PART))]


def run_calls(block: CallBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal) -> None:
    """Run what a block still lacks."""
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
        """Do a round, unless it is kept."""
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
    """Time some problems: in every round each caller takes all of them, one after another."""
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
            return first_round_rows(robot, problems, mine[i], callers[i], found) if turn == 0 else times_of(found)

        done[i].append(kept.done(callers[i], i, turn, work))
    frames = [
        (all_rounds_rows(done[i]) if i in done else crashed_rows(mine[i], callers[i].ended)).with_columns(
            method=pl.lit(callers[i].label), method_index=pl.lit(i)
        )
        for i in given
    ]
    return pl.concat(frames)


def one_round(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64], trial: tuple[int, int]) -> Round:
    """Call one caller once for each problem, with copies of its own of the target and the initial guess."""
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
        raws = [failed(raw) if isinstance(raw, Exception) else raw for raw in raws]
    fresh = _arguments(caller, problems, mine)
    changed = [
        any(not np.array_equal(a, b) for a, b in zip(*pair, strict=True)) for pair in zip(arguments, fresh, strict=True)
    ]
    return Round(ns, cpu, raws, np.array(changed, dtype=bool))


def _arguments(caller: Caller, problems: ProblemSet, mine: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    if caller.takes_start:
        return [(problems.targets[i].copy(), problems.starts[i].copy()) for i in mine]
    return [(problems.targets[i].copy(),) for i in mine]


# ---------------------------------------------------------------- reading


def read_rows(folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
    """All rows of a block with what is known of each problem: group, singular value, whether a solution is known."""
    problems = folder.read(f"problems/{slug(block.id)}.parquet")
    rows = folder.parts("speed", block.id)
    if problems is None or rows is None:
        return None
    facts = ("problem", "group", "sigma", "known", "unreachable")  # the last is missing in runs of older versions
    return rows.join(problems.select(name for name in facts if name in problems.columns), on="problem").sort(
        "method_index", "problem"
    )
