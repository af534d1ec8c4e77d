"""Equal numbers of iterations: every method that can be told one, by one attempt that ends there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from benchmarks.kinds.base import Entry, Tell, timed
from benchmarks.kinds.calls.callers import build_ours
from benchmarks.kinds.calls.judgement import judged
from benchmarks.kinds.calls.settings import CallBlock
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import Absent, build_peer
from benchmarks.problems.base import ProblemSet
from benchmarks.records import RunFolder, slug
from optik.arm.robot import Robot
from optik.registry import load_method
from optik.types import Array

Built = tuple[Callable[..., Any], bool, Callable[[Any], Array]]
"""What is called, whether it takes a start, and the answers (k, n) of what it returned."""


def evaluations_file(block: CallBlock) -> str:
    """Name of the file of answers at equal numbers of iterations.

    Parameters
    ----------
    block : CallBlock
        The block.

    Returns
    -------
    str
        In the run folder.
    """
    return f"speed/{slug(block.id)}.iterations.parquet"


def run_evaluations(block: CallBlock, robot: Robot, problems: ProblemSet, folder: RunFolder, tell: Tell) -> None:
    """Answer every problem at every number of iterations, unless that is done already or not asked for.

    Parameters
    ----------
    block : CallBlock
        The block.
    robot : Robot
        The arm.
    problems : ProblemSet
        Its problems.
    folder : RunFolder
        The run.
    tell : callable
        Called with what is next.
    """
    if not block.evaluation_budgets or folder.has(evaluations_file(block)):
        return
    frames = []
    for budget in block.evaluation_budgets:
        for entry in block.entries:
            tell(f"{block.id}: {entry.label}, {budget} iterations")
            built = built_with(entry, robot, budget)
            if built is not None:
                frames.append(_answered(built, robot, problems, entry).with_columns(budget=pl.lit(budget)))
    folder.write(evaluations_file(block), pl.concat(frames))


def built_with(entry: Entry, robot: Robot, budget: int) -> Built | None:
    """A method that ends after a number of iterations, without restarts.

    Parameters
    ----------
    entry : Entry
        A method of ours, or a peer.
    robot : Robot
        The arm.
    budget : int
        The number.

    Returns
    -------
    Built or None
        None for a peer that cannot be told one, and for any that is absent or refuses.
    """
    if entry.role != "peer":
        ended = entry.options | {"max_iterations": budget, "max_restarts": 0}
        solver = build_ours(replace(entry, options=ended), robot)
        return None if isinstance(solver, Absent) else (solver.solve, True, lambda raw: raw.q[None])
    if not getattr(load_method(PEERS, entry.name, "peer"), "budgeted", False):
        return None
    peer = build_peer(entry.name, robot, iterations=budget)
    return None if isinstance(peer, Absent) else (peer.call, peer.takes_start, peer.answers)


def _answered(built: Built, robot: Robot, problems: ProblemSet, entry: Entry) -> pl.DataFrame:
    """Rows of one method at one number of iterations; a call that raises is a call without an answer."""
    call, takes_start, answers = built
    mine = problems.chosen(entry.most)
    given = [(problems.targets[i].copy(), problems.starts[i].copy())[: 1 + takes_start] for i in mine]

    def caught(*arguments: Any) -> Any:
        try:
            return call(*arguments)
        except Exception:  # whatever a peer raises: it has no answer
            return None

    ns, raws = timed(caught, given)
    found = [np.empty((0, robot.n)) if raw is None else answers(raw) for raw in raws]
    return judged(robot, problems.targets[mine], found, wraps=entry.role == "peer").with_columns(
        problem=pl.Series(mine), ns=pl.Series(ns), method=pl.lit(entry.label)
    )


def read_evaluations(folder: RunFolder, block: CallBlock) -> pl.DataFrame | None:
    """Answers at equal numbers of iterations.

    Parameters
    ----------
    folder : RunFolder
        The run.
    block : CallBlock
        The block.

    Returns
    -------
    DataFrame or None
        None where none were asked for, or they were not run yet.
    """
    return folder.read(evaluations_file(block)) if block.evaluation_budgets else None
