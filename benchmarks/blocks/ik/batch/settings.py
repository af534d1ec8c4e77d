"""Settings of batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.blocks._problems import ProblemBlock, named, read_problems
from benchmarks.blocks.ik.batch.measures import MEASURES
from benchmarks.settings import all_of, check_known, check_list, check_table
from benchmarks.targets import read_target
from optik.check import check_count


@dataclass(frozen=True, kw_only=True)
class BatchBlock(ProblemBlock):
    """One problem set on one robot, solved as one batch with some numbers of threads.

    Attributes
    ----------
    solver : str
        Name of the IK method.
    solver_options : dict
        Of the method.
    threads : tuple of int
        Numbers of threads, one after another.
    repeats : int
        How often each is timed.
    """

    solver: str
    solver_options: dict[str, Any]
    threads: tuple[int, ...]
    repeats: int


def read_block(data: Any) -> BatchBlock:
    """Check the settings of a batch and return it."""
    where = named(data, "batch")
    shared = read_problems(data, where, {"solver", "solver_options", "threads", "repeats", "targets"}, {"solver"})
    solver = check_known(data["solver"], "optik.ik", "IK method")
    threads = check_list(data.get("threads", [1]), f"{where}: threads")
    for count in threads:
        check_count(count, f"{where}: threads", 1)
    check_count(data.get("repeats", 3), f"{where}: repeats", 1)
    return BatchBlock(
        **shared,
        solver=solver,
        solver_options=dict(check_table(data.get("solver_options", {}), f"{where}: solver_options")),
        threads=tuple(threads),
        repeats=data.get("repeats", 3),
        targets=all_of(data.get("targets"), f"{where}: targets", lambda t: read_target(t, where, MEASURES)),
    )
