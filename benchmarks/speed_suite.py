"""What a suite asks of speed: blocks of single calls, batches, first use, and the targets they are held to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.methods import Method, method_of
from benchmarks.problems.base import SETS
from benchmarks.settings import (
    Target,
    all_of,
    bounds,
    check_different,
    check_keys,
    check_known,
    check_list,
    optional_count,
)
from optik.check import check_count
from optik.errors import InvalidInput

PEERS = "benchmarks.peers.ik"

CALL_MEASURES = ("success", "median_us", "mean_us", "p90_us", "p99_us", "max_us", "median_ratio")
BATCH_MEASURES = ("success", "million_per_second", "extra_memory_mb")
FIRST_MEASURES = ("import_s", "first_solve_s", "compile_s")


@dataclass(frozen=True)
class PeerEntry:
    """One outside method."""

    peer: str
    label: str
    max_problems: int | None = None


@dataclass(frozen=True)
class SpeedBlock:
    """One problem set on one robot, every problem one timed call of every method and peer, in rounds."""

    id: str
    title: str
    robot: str
    set: str
    options: dict[str, Any]
    rounds: int
    methods: tuple[Method, ...]
    peers: tuple[PeerEntry, ...]
    targets: tuple[Target, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the methods, then of the peers."""
        return (*(m.label for m in self.methods), *(p.label for p in self.peers))

    @property
    def reference(self) -> str:
        """Label that ratios are taken to: the first method."""
        return self.methods[0].label


@dataclass(frozen=True)
class BatchBlock:
    """One problem set on one robot, solved as one batch with some numbers of threads."""

    id: str
    title: str
    robot: str
    set: str
    options: dict[str, Any]
    solver: str
    solver_options: dict[str, Any]
    threads: tuple[int, ...]
    repeats: int
    targets: tuple[Target, ...]


@dataclass(frozen=True)
class FirstUse:
    """What starting costs: import, and the first solve with and without what an earlier process compiled."""

    robot: str
    solver: str
    repeats: int
    targets: tuple[Target, ...]


def speed_block(data: Any) -> SpeedBlock:
    """Check the settings of a block of single calls."""
    where = _where(data, "speed block")
    keys = {"id", "title", "robot", "set", "options", "rounds", "methods", "peers", "targets"}
    check_keys(data, keys, where, need={"id", "robot", "set", "methods"})
    _check_set(data)
    check_count(data.get("rounds", 3), f"{where}: rounds", 1)
    methods = all_of(data["methods"], f"{where}: methods", lambda m: method_of(m, where))
    peers = all_of(data.get("peers"), f"{where}: peers", lambda p: _peer(p, where))
    labels = [m.label for m in methods] + [p.label for p in peers]
    check_different(labels, f"{where}: methods", "label")
    targets = all_of(data.get("targets"), f"{where}: targets", lambda t: _target(t, where, CALL_MEASURES, labels))
    return SpeedBlock(
        str(data["id"]), str(data.get("title", data["id"])), data["robot"], data["set"], dict(data.get("options", {})),
        data.get("rounds", 3), methods, peers, targets,
    )  # fmt: skip


def batch_block(data: Any) -> BatchBlock:
    """Check the settings of a batch."""
    where = _where(data, "batch")
    keys = {
        "id", "title", "robot", "set", "options", "solver", "solver_options", "threads", "repeats", "targets",
    }  # fmt: skip
    check_keys(data, keys, where, need={"id", "robot", "set", "solver"})
    _check_set(data)
    check_known(data["solver"], "optik.ik", "IK method")
    threads = check_list(data.get("threads", [1]), f"{where}: threads")
    for count in threads:
        check_count(count, f"{where}: threads", 1)
    check_count(data.get("repeats", 3), f"{where}: repeats", 1)
    targets = all_of(data.get("targets"), f"{where}: targets", lambda t: _target(t, where, BATCH_MEASURES, []))
    return BatchBlock(
        str(data["id"]), str(data.get("title", data["id"])), data["robot"], data["set"], dict(data.get("options", {})),
        data["solver"], dict(data.get("solver_options", {})), tuple(threads), data.get("repeats", 3), targets,
    )  # fmt: skip


def first_use(data: Any) -> FirstUse:
    """Check the settings of first use."""
    where = "first_use"
    check_keys(data, {"robot", "solver", "repeats", "targets"}, where, need={"robot", "solver"})
    check_known(data["robot"], "optik.robots", "robot")
    check_known(data["solver"], "optik.ik", "IK method")
    check_count(data.get("repeats", 3), f"{where}: repeats", 1)
    targets = all_of(data.get("targets"), f"{where}: targets", lambda t: _target(t, where, FIRST_MEASURES, []))
    return FirstUse(data["robot"], data["solver"], data.get("repeats", 3), targets)


def _where(data: Any, kind: str) -> str:
    return f"{kind} {data.get('id', '?')!r}" if isinstance(data, dict) else kind


def _check_set(data: dict[str, Any]) -> None:
    check_known(data["robot"], "optik.robots", "robot")
    check_known(data["set"], SETS, "problem set")


def _peer(data: Any, where: str) -> PeerEntry:
    check_keys(data, {"label", "peer", "max_problems"}, f"{where}: peers", need={"peer"})
    check_known(data["peer"], PEERS, "peer")
    most = optional_count(data.get("max_problems"), f"{where}: max_problems")
    return PeerEntry(data["peer"], str(data.get("label", data["peer"].replace("_", " "))), most)


def _target(data: Any, where: str, measures: tuple[str, ...], labels: list[str]) -> Target:
    at = f"{where}: targets"
    check_keys(data, {"measure", "method", "to", "at_most", "at_least", "goal"}, at, need={"measure"})
    measure = data["measure"]
    if measure not in measures:
        raise InvalidInput(at, f"measure {measure!r}", f"one of {', '.join(measures)}")
    method, to = str(data.get("method", labels[0] if labels else "")), str(data.get("to", ""))
    if (to != "") != (measure == "median_ratio"):
        raise InvalidInput(
            at, f"{measure} {'to ' + repr(to) if to else 'to nothing'}", "`to` for median_ratio, and only there"
        )
    for name in (method, to):
        if name and name not in labels:
            raise InvalidInput(at, repr(name), f"a label of the block: {', '.join(labels) or 'it has none'}")
    return Target(measure, method, to, **bounds(data, at))
