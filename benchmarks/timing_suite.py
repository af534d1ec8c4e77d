"""What a suite asks of time laws: lines, limits, laws and peers, what they are held to, and one line looked at closely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.lines import KINDS
from benchmarks.settings import (
    Target,
    all_of,
    bounds,
    check_different,
    check_keys,
    check_known,
    optional_count,
)
from optik.check import check_count
from optik.errors import InvalidInput
from planners.limits import ALL_LIMITS, MotionLimits

LAWS = "planners.timing"
TIMING_PEERS = "benchmarks.peers.laws"

TIMING_MEASURES = {
    "solved": ("lines with a motion", "%"),
    "kept": ("motions with every exact ratio at most 1", "%"),
    "holds": ("motions whose certificate holds", "%"),
    "worst_ratio": ("worst value over limit, exact", ""),
    "worst_velocity": ("worst velocity over limit, exact", ""),
    "worst_acceleration": ("worst acceleration over limit, exact", ""),
    "worst_jerk": ("worst jerk over limit, exact", ""),
    "median_optimum": ("median of T / T*", ""),
    "worst_optimum": ("worst T / T*", ""),
    "median_ms": ("median time of the law", "ms"),
    "p95_ms": ("95th percentile of the law's time", "ms"),
    "plan_ms": ("median time of a whole plan", "ms"),
    "deviation_um": ("worst certified distance from the line", "µm"),
    "truth_over_bound": ("largest deviation found by brute force over the certified one", ""),
    "bound_over_truth": ("largest certified deviation over max(brute force, 1 nm or nrad)", ""),
}
"""What each measure is called, and its unit."""


@dataclass(frozen=True)
class LineSet:
    """So many lines of a kind on a robot."""

    robot: str
    kind: str
    count: int


@dataclass(frozen=True)
class LimitSet:
    """Limits of a motion, and what reports call them."""

    label: str
    limits: MotionLimits


@dataclass(frozen=True)
class LawEntry:
    """A time law with its options."""

    label: str
    law: str
    options: dict[str, Any]


@dataclass(frozen=True)
class TimingPeerEntry:
    """An outside time law; slow ones are given the first lines of each set only."""

    label: str
    peer: str
    max_lines: int | None


@dataclass(frozen=True)
class Example:
    """The line that the report looks at closely."""

    robot: str
    kind: str
    index: int
    limits: str


@dataclass(frozen=True)
class TimingBlock:
    """Lines × limits × laws.

    Attributes
    ----------
    reference : LawEntry or None
        The law whose duration stands for the optimum T*, where no other that keeps every limit is shorter.
    plan : str
        Label of the law with which whole plans are timed, the first where none is named.
    ik : str
        The IK method of the plans.
    samples : int
        Of a line.
    rounds : int
        Calls timed of each law on each line, after one that is not.
    """

    id: str
    title: str
    lines: tuple[LineSet, ...]
    limits: tuple[LimitSet, ...]
    laws: tuple[LawEntry, ...]
    peers: tuple[TimingPeerEntry, ...]
    reference: LawEntry | None
    plan: str
    ik: str
    samples: int
    rounds: int
    example: Example
    targets: tuple[Target, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the laws, then of the peers."""
        return (*(law.label for law in self.laws), *(peer.label for peer in self.peers))

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms, in their order."""
        return tuple(dict.fromkeys(part.robot for part in self.lines))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of lines, in their order."""
        return tuple(dict.fromkeys(part.kind for part in self.lines))


def timing_block(data: Any) -> TimingBlock:
    """Check the settings of a block of timed lines."""
    where = f"timing block {data.get('id', '?')!r}" if isinstance(data, dict) else "timing block"
    keys = {
        "id", "title", "lines", "limits", "laws", "peers", "reference", "plan", "ik", "samples", "rounds", "example",
        "targets",
    }  # fmt: skip
    check_keys(data, keys, where, need={"id", "lines", "limits", "laws"})
    lines = all_of(data["lines"], f"{where}: lines", lambda part: _lines(part, where))
    check_different([f"{part.kind} of {part.robot}" for part in lines], f"{where}: lines", "set")
    limits = all_of(data["limits"], f"{where}: limits", lambda part: _limits(part, where))
    check_different([part.label for part in limits], f"{where}: limits", "label")
    laws = all_of(data["laws"], f"{where}: laws", lambda law: _law(law, f"{where}: laws"))
    peers = all_of(data.get("peers"), f"{where}: peers", lambda peer: _peer(peer, where))
    labels = [law.label for law in laws] + [peer.label for peer in peers]
    check_different(labels, f"{where}: laws", "label")
    reference = _law(data["reference"], f"{where}: reference") if "reference" in data else None
    plan = data.get("plan", laws[0].label)
    if plan not in [law.label for law in laws]:
        raise InvalidInput(f"{where}: plan", repr(plan), f"a label of its laws: {', '.join(x.label for x in laws)}")
    check_known(data.get("ik", "lm"), "optik.ik", "IK method")
    check_count(data.get("samples", 151), f"{where}: samples", 2)
    check_count(data.get("rounds", 3), f"{where}: rounds", 1)
    example = _example(data.get("example", {}), where, lines, limits)
    groups = [*dict.fromkeys([part.kind for part in lines] + [part.robot for part in lines])]
    targets = all_of(data.get("targets"), f"{where}: targets", lambda t: _target(t, where, labels, groups))
    return TimingBlock(
        str(data["id"]), str(data.get("title", data["id"])), lines, limits, laws, peers, reference, plan,
        data.get("ik", "lm"), data.get("samples", 151), data.get("rounds", 3), example, targets,
    )  # fmt: skip


def _lines(data: Any, where: str) -> LineSet:
    check_keys(data, {"robot", "kind", "count"}, f"{where}: lines", need={"robot", "kind", "count"})
    check_known(data["robot"], "optik.robots", "robot")
    if data["kind"] not in KINDS:
        raise InvalidInput(f"{where}: lines", f"kind {data['kind']!r}", f"one of {', '.join(KINDS)}")
    check_count(data["count"], f"{where}: lines: count", 1)
    return LineSet(data["robot"], data["kind"], data["count"])


def _limits(data: Any, where: str) -> LimitSet:
    check_keys(data, {"label", *ALL_LIMITS}, f"{where}: limits")
    given = {field: data[field] for field in ALL_LIMITS if field in data}
    if not given:
        raise InvalidInput(f"{where}: limits", "none", f"some of {', '.join(ALL_LIMITS)}")
    return LimitSet(str(data.get("label", ", ".join(str(v) for v in given.values()))), MotionLimits(**given))


def _law(data: Any, where: str) -> LawEntry:
    check_keys(data, {"label", "law", "options"}, where, need={"law"})
    check_known(data["law"], LAWS, "time law")
    return LawEntry(str(data.get("label", data["law"])), data["law"], dict(data.get("options", {})))


def _peer(data: Any, where: str) -> TimingPeerEntry:
    check_keys(data, {"label", "peer", "max_lines"}, f"{where}: peers", need={"peer"})
    check_known(data["peer"], TIMING_PEERS, "peer of timing")
    most = optional_count(data.get("max_lines"), f"{where}: max_lines")
    return TimingPeerEntry(str(data.get("label", data["peer"].replace("_", " "))), data["peer"], most)


def _example(data: Any, where: str, lines: tuple[LineSet, ...], limits: tuple[LimitSet, ...]) -> Example:
    at = f"{where}: example"
    check_keys(data, {"robot", "kind", "index", "limits"}, at)
    chosen = next((part for part in lines if part.kind == "near_singular"), lines[0])
    robot, kind = data.get("robot", chosen.robot), data.get("kind", chosen.kind)
    check_known(robot, "optik.robots", "robot")
    if kind not in KINDS:
        raise InvalidInput(at, f"kind {kind!r}", f"one of {', '.join(KINDS)}")
    check_count(data.get("index", 0), f"{at}: index", 0)
    label = data.get("limits", limits[0].label)
    if label not in [part.label for part in limits]:
        raise InvalidInput(at, f"limits {label!r}", f"a label of its limits: {', '.join(x.label for x in limits)}")
    return Example(robot, kind, data.get("index", 0), label)


def _target(data: Any, where: str, labels: list[str], groups: list[str]) -> Target:
    at = f"{where}: targets"
    check_keys(data, {"measure", "law", "group", "at_most", "at_least", "goal"}, at, need={"measure", "law"})
    if data["measure"] not in TIMING_MEASURES:
        raise InvalidInput(at, f"measure {data['measure']!r}", f"one of {', '.join(TIMING_MEASURES)}")
    if data["law"] not in labels:
        raise InvalidInput(at, repr(data["law"]), f"a label of the block: {', '.join(labels)}")
    group = data.get("group", "")
    if group and group not in groups:
        raise InvalidInput(at, f"group {group!r}", f"one of {', '.join(groups)}")
    return Target(data["measure"], data["law"], group=group, **bounds(data, at))
