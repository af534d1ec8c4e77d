"""Equal numbers of iterations: every method that can be told one, by one attempt that ends there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl

from benchmarks.blocks.base import Entry, Tell
from benchmarks.blocks.ik.calls.callers import callers_of
from benchmarks.blocks.ik.calls.run import CALL_PART, Rounds, timed_part
from benchmarks.blocks.ik.calls.settings import CallBlock
from benchmarks.problems.base import problem_set
from benchmarks.records import Journal, RunFolder, slug


def evaluations_file(block: CallBlock) -> str:
    """Name of the file of answers at equal numbers of iterations."""
    return f"speed/{slug(block.id)}.iterations.parquet"


def run_evaluations(block: CallBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal) -> None:
    """Answer every problem at every number of iterations, unless that is done already or not asked for."""
    if not block.evaluation_budgets or folder.has(evaluations_file(block)):
        return
    robot, problems = problem_set(block, seed)
    frames = []
    for budget in block.evaluation_budgets:
        tell(f"{block.id}: {budget} iterations")
        callers, _ = callers_of(ending_after(block, budget), robot, journal)
        for first in range(0, len(problems), CALL_PART):
            here = np.arange(first, min(first + CALL_PART, len(problems)))
            kept = Rounds(journal, f"{budget}-{first // CALL_PART:04d}")
            rows = timed_part(robot, problems, here, callers, 1, seed=seed, kept=kept)
            frames.append(rows.with_columns(budget=pl.lit(budget)))
    folder.write(evaluations_file(block), pl.concat(frames))


def ending_after(block: CallBlock, budget: int) -> CallBlock:
    """A block whose methods end after a number of iterations, without restarts."""

    def ours(entry: Entry) -> Entry:
        return replace(entry, options=entry.options | {"max_iterations": budget, "max_restarts": 0})

    def theirs(entry: Entry) -> Entry:
        return replace(entry, options=entry.options | {"iterations": budget})

    return block.model_copy(
        update={"methods": tuple(map(ours, block.methods)), "peers": tuple(map(theirs, block.peers))}
    )


def read_evaluations(folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
    """Answers at equal numbers of iterations."""
    return folder.read(evaluations_file(block)) if block.evaluation_budgets else None
