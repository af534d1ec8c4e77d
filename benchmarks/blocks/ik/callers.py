"""Methods and peers of a block of single calls, ready to be called; and the others, with the reason."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.blocks._contest import facts_on
from benchmarks.blocks._seeds import reseed
from benchmarks.blocks.base import Block, Entry
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik._worker import WorkerPeer
from benchmarks.peers.ik.base import Absent, Answer, build_peer, version_of
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
