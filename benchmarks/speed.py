"""Blocks of single calls: every problem by every method and peer in one process, in rounds, each call timed as a whole."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.judgement import judged
from benchmarks.peers.ik.base import Absent, build_peer, version_of
from benchmarks.problems.base import ProblemSet, problem_set
from benchmarks.records import RunFolder, slug
from benchmarks.speed_suite import PEERS, BatchBlock, SpeedBlock
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.registry import load_method
from optik.types import Array

Tell = Callable[[str], None]

PART = 2000
"""Problems in one part: each method takes them in a row, so noise that lasts longer hits all methods alike."""
FEW = 5
WARM_UP = 20
"""Calls before the first timed one of each method in a part."""


@dataclass(frozen=True)
class Contestant:
    """One of our methods or a peer, built and ready to be called.

    Attributes
    ----------
    label : str
        What reports call it.
    call : callable
        The timed part: (target, q0), or (target) where it takes no start.
    takes_start : bool
        Which of the two.
    answers : callable
        From what a call returned to configurations (k, n).
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


def speed_parts(block: SpeedBlock, count: int) -> list[str]:
    """Names of all parts of a block."""
    return [f"speed/{slug(block.id)}--{part:04d}.parquet" for part in range(-(-count // PART))]


def run_speed(block: SpeedBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
    """Run what a block still lacks; `tell` hears what is next."""
    facts, name = f"speed/{slug(block.id)}.json", f"problems/{slug(block.id)}.parquet"
    count = folder.read_json(facts)["count"] if folder.has(facts) else None
    if count is not None and all(folder.has(part) for part in speed_parts(block, count)):
        return
    tell(f"{block.id}: problems")
    robot, problems = problem_set(block, seed)
    if not folder.has(name):
        folder.write(name, problems.frame(robot).drop("target", "start"))
    tell(f"{block.id}: building")
    contestants, absent = contestants_of(block, robot)
    folder.write_json(
        facts,
        {
            "count": len(problems),
            "clock_ns": clock_cost(),
            "entries": {c.label: c.about for c in contestants} | absent,
        },
    )
    for part, file in enumerate(speed_parts(block, len(problems))):
        if not folder.has(file):
            tell(f"{block.id}: {part * PART:,} of {len(problems):,}")
            here = np.arange(part * PART, min((part + 1) * PART, len(problems)))
            folder.write(file, timed_part(robot, problems, here, contestants, block.rounds))


def check_set(block: SpeedBlock | BatchBlock) -> None:
    """Refuse wrong options of a problem set, by drawing a few problems of it.

    Raises
    ------
    InvalidInput
        An option that the set does not have, or out of range.
    """
    if "count" in block.options:
        check_count(block.options["count"], "count", FEW)
        block = replace(block, options=block.options | {"count": FEW})
    problem_set(block, 0)


# ---------------------------------------------------------------- who takes part


def contestants_of(block: SpeedBlock, robot: Robot) -> tuple[list[Contestant], dict[str, dict[str, Any]]]:
    """All that could be built, and facts on those that could not."""
    ready = [_ours(m.label, robot, m.solver, m.options, m.max_problems) for m in block.methods]
    absent: dict[str, dict[str, Any]] = {}
    for entry in block.peers:
        begin = time.perf_counter()
        peer = build_peer(entry.peer, robot)
        seconds = time.perf_counter() - begin
        about = {
            "kind": "peer",
            "name": entry.peer,
            "version": version_of(entry.peer),
            "settings": load_method(PEERS, entry.peer, "peer").settings,
        }
        if isinstance(peer, Absent):
            absent[entry.label] = about | {"absent": peer.why}
            continue

        def counts(raw: Any, peer: Any = peer) -> tuple[int | None, int | None]:
            return peer.iterations(raw), None

        ready.append(
            Contestant(
                entry.label, peer.call, peer.takes_start, peer.answers, counts, True, entry.max_problems,
                about | {"build_seconds": seconds},
            )
        )  # fmt: skip
    return ready, absent


def _ours(label: str, robot: Robot, solver: str, options: dict[str, Any], most: int | None) -> Contestant:
    begin = time.perf_counter()
    built = make_solver(robot, solver, **options)
    seconds = time.perf_counter() - begin
    words = ", ".join(f"{k} = {v}" for k, v in options.items()) or "as it comes"
    about = {"kind": "ours", "name": solver, "version": None, "settings": words, "build_seconds": seconds}
    return Contestant(
        label,
        built.solve,
        True,
        lambda raw: raw.q[None],
        lambda raw: (raw.iterations, raw.restarts),
        False,
        most,
        about,
    )


# ---------------------------------------------------------------- timing


def timed_part(
    robot: Robot, problems: ProblemSet, here: NDArray[np.int64], contestants: list[Contestant], rounds: int
) -> pl.DataFrame:
    """Rows of some problems: the time of each call is the median of its rounds; the answers are the first round's.

    In every round each contestant takes all of the problems, one after another, another one first each time, with the
    garbage collector off.
    """
    mine = {c.label: np.intersect1d(here, problems.chosen(c.most)) for c in contestants}
    ready = [c for c in contestants if len(mine[c.label])]
    arguments = {c.label: _arguments(c, problems, mine[c.label]) for c in ready}
    times: dict[str, list[NDArray[np.int64]]] = {c.label: [] for c in ready}
    raws: dict[str, list[Any]] = {}
    for contestant in ready:
        for given in arguments[contestant.label][:WARM_UP]:
            contestant.call(*given)
    for turn in range(rounds):
        for k in range(len(ready)):
            contestant = ready[(turn + k) % len(ready)]
            took, raw = timed(contestant.call, arguments[contestant.label])
            times[contestant.label].append(took)
            raws.setdefault(contestant.label, raw)
    frames = [
        _rows(robot, problems, mine[c.label], c, raws[c.label]).with_columns(
            ns=pl.Series(np.median(times[c.label], axis=0)),
            method=pl.lit(c.label),
            method_index=pl.lit(contestants.index(c)),
        )
        for c in ready
    ]
    return pl.concat(frames)


def _arguments(contestant: Contestant, problems: ProblemSet, mine: NDArray[np.int64]) -> list[tuple[Any, ...]]:
    if contestant.takes_start:
        return [(problems.targets[i].copy(), problems.starts[i].copy()) for i in mine]
    return [(problems.targets[i].copy(),) for i in mine]


def _rows(
    robot: Robot, problems: ProblemSet, mine: NDArray[np.int64], contestant: Contestant, raws: list[Any]
) -> pl.DataFrame:
    """Rows of one contestant, without its times."""
    answers = [contestant.answers(raw) for raw in raws]
    counts = [contestant.counts(raw) for raw in raws]
    return judged(robot, problems.targets[mine], answers, wraps=contestant.wraps).with_columns(
        problem=pl.Series(mine),
        iterations=pl.Series([c[0] for c in counts], dtype=pl.Int64),
        restarts=pl.Series([c[1] for c in counts], dtype=pl.Int64),
    )


def timed(call: Callable[..., Any], arguments: list[tuple[Any, ...]]) -> tuple[NDArray[np.int64], list[Any]]:
    """Nanoseconds of each call, and what each returned."""
    clock = time.perf_counter_ns
    took = np.empty(len(arguments), dtype=np.int64)
    raws: list[Any] = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        for i, given in enumerate(arguments):
            begin = clock()
            raw = call(*given)
            end = clock()
            took[i] = end - begin
            raws.append(raw)
    finally:
        if collecting:
            gc.enable()
    return took, raws


def clock_cost() -> float:
    """Nanoseconds that timing itself adds to a call that does nothing, median; it is left in all times."""
    took, _ = timed(lambda target, q0: None, [(None, None)] * 2000)
    return float(np.median(took))


# ---------------------------------------------------------------- reading


def speed_facts(folder: RunFolder, block: SpeedBlock) -> dict[str, Any]:
    """What is known of a block beside its rows: ``count``, ``clock_ns``, and ``entries`` by label.

    Raises
    ------
    InvalidInput
        They are not there though rows are.
    """
    facts: dict[str, Any] | None = folder.read_json(f"speed/{slug(block.id)}.json")
    if facts is None:
        raise InvalidInput("run", f"no facts on {block.id!r}", "whole parts; delete speed/ and run again")
    return facts


def speed_rows(folder: RunFolder, block: SpeedBlock) -> pl.DataFrame | None:
    """All rows of a block with the group of each problem; None where nothing was run."""
    problems = folder.read(f"problems/{slug(block.id)}.parquet")
    found = sorted((folder.path / "speed").glob(f"{slug(block.id)}--*.parquet"))
    frames = [part for file in found if (part := folder.read(f"speed/{file.name}")) is not None]
    if problems is None or not frames:
        return None
    rows = pl.concat(frames).join(problems.select("problem", "group"), on="problem")
    return rows.sort("method_index", "problem")


def shared(rows: pl.DataFrame, labels: tuple[str, ...]) -> pl.DataFrame:
    """Rows of some methods on the problems that all of them were given."""
    chosen = rows.filter(pl.col("method").is_in(labels))
    return chosen.filter(pl.col("method").n_unique().over("problem") == chosen["method"].n_unique())
