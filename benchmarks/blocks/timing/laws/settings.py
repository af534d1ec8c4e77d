"""Settings of blocks of timed lines: lines, limits, laws and peers, and one line for a detailed view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.blocks._arms import read_payload
from benchmarks.blocks._entries import check_labels, read_law, read_peers
from benchmarks.blocks._problems import named
from benchmarks.blocks.base import Block, Entry
from benchmarks.blocks.timing.laws.measures import MEASURES
from benchmarks.blocks.timing.laws.motions import MOTION_KINDS
from benchmarks.blocks.timing.laws.sets import LimitSet, LineSet, read_limits, read_lines
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.settings import all_of, check_different, check_keys, check_known
from benchmarks.targets import read_target
from optik.check import check_count
from optik.errors import InvalidInput


@dataclass(frozen=True)
class Example:
    """The motion of which the report has a detailed view.

    Attributes
    ----------
    robot : str
        The arm: a name, or the path of a file.
    kind : str
        Kind of motions, or the name of a file.
    index : int
        Which one of its kind, from 0.
    limits : str
        Label of the limits.
    path : str
        The file, for the kind ``file``.
    payload : float or pair of floats
        Mass in the tool [kg], or [lightest, heaviest]; by default that of the first such set.
    """

    robot: str
    kind: str
    index: int
    limits: str
    path: str = ""
    payload: float | tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class LawBlock(Block):
    """Lines × limits × laws.

    Attributes
    ----------
    lines : tuple of LineSet
        Sets of motions: straight lines and others.
    limits : tuple of LimitSet
        Limits of the joints and of the tool; each motion is timed within each.
    laws : tuple of Entry
        Time laws of ours.
    peers : tuple of Entry
        Outside time laws.
    reference : Entry or None
        The law whose duration is taken as the optimum T*, unless another motion that keeps every limit is shorter.
    plan : str
        Label of the law with which whole plans are timed, the first where none is named.
    solver : str
        The IK method that follows the paths.
    samples : int
        Samples of each path at which the IK method solves.
    rounds : int
        Timed calls of each law on each motion, after one that is not counted.
    example : Example
        The motion of the detailed view.
    """

    lines: tuple[LineSet, ...]
    limits: tuple[LimitSet, ...]
    laws: tuple[Entry, ...]
    peers: tuple[Entry, ...]
    reference: Entry | None
    plan: str
    solver: str
    samples: int
    rounds: int
    example: Example

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The laws, then the peers; the reference is none of them."""
        return (*self.laws, *self.peers)

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms, in their order."""
        return tuple(dict.fromkeys(part.robot for part in self.lines))

    @property
    def arms(self) -> tuple[str, ...]:
        """What reports call the arms: each with each of its payloads."""
        return tuple(dict.fromkeys(part.arm for part in self.lines))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions as reports call them, in their order."""
        return tuple(dict.fromkeys(part.label for part in self.lines))


def read_block(data: Any) -> LawBlock:
    """Check the settings of a block of timed lines and return it."""
    where = named(data, "timing block")
    keys = {
        "id", "title", "lines", "limits", "laws", "peers", "reference", "plan", "solver", "samples", "rounds", "example",
        "targets",
    }  # fmt: skip
    check_keys(data, keys, where, need={"id", "lines", "limits", "laws"})
    lines = all_of(data["lines"], f"{where}: lines", lambda part: read_lines(part, where))
    check_different([f"{part.label} of {part.arm}" for part in lines], f"{where}: lines", "set")
    limits = all_of(data["limits"], f"{where}: limits", lambda part: read_limits(part, where))
    check_different([part.label for part in limits], f"{where}: limits", "label")
    laws = all_of(data["laws"], f"{where}: laws", lambda law: read_law(law, f"{where}: laws"))
    peers = read_peers(data.get("peers"), where, TIMING_PEERS, word="peer of timing", most="max_lines")
    labels = check_labels((*laws, *peers), f"{where}: laws")
    plan = data.get("plan", laws[0].label)
    if plan not in [law.label for law in laws]:
        raise InvalidInput(f"{where}: plan", repr(plan), f"a label of its laws: {', '.join(x.label for x in laws)}")
    method = check_known(data.get("solver", "lm"), "optik.ik", "IK method")
    check_count(data.get("samples", 151), f"{where}: samples", 2)
    check_count(data.get("rounds", 3), f"{where}: rounds", 1)
    groups = [*dict.fromkeys([x.label for x in lines] + [x.arm for x in lines] + [x.label for x in limits])]

    def target(one: Any) -> Any:
        return read_target(one, where, MEASURES, labels=labels, groups=groups, key="law", required=True)

    return LawBlock(
        id=str(data["id"]),
        title=str(data.get("title", data["id"])),
        lines=lines,
        limits=limits,
        laws=laws,
        peers=peers,
        reference=read_law(data["reference"], f"{where}: reference", "reference") if "reference" in data else None,
        plan=plan,
        solver=method,
        samples=data.get("samples", 151),
        rounds=data.get("rounds", 3),
        example=_example(data.get("example", {}), where, lines, limits),
        targets=all_of(data.get("targets"), f"{where}: targets", target),
    )


def _example(data: Any, where: str, lines: tuple[LineSet, ...], limits: tuple[LimitSet, ...]) -> Example:
    at = f"{where}: example"
    check_keys(data, {"robot", "kind", "index", "limits", "payload"}, at)
    chosen = next((part for part in lines if part.kind == "near_singular"), lines[0])
    robot = check_known(data.get("robot", chosen.robot), "optik.robots", "robot")
    kind = data.get("kind", chosen.label)
    if kind not in MOTION_KINDS and kind not in [part.label for part in lines]:
        raise InvalidInput(at, f"kind {kind!r}", f"one of {', '.join(dict.fromkeys(part.label for part in lines))}")
    path = next((part.path for part in lines if part.label == kind), "")
    payload = read_payload(data.get("payload"), f"{at}: payload")
    if payload is None:
        payload = next((part.payload for part in lines if (part.robot, part.label) == (robot, kind)), None)
    check_count(data.get("index", 0), f"{at}: index", 0)
    label = data.get("limits", limits[0].label)
    if label not in [part.label for part in limits]:
        raise InvalidInput(at, f"limits {label!r}", f"a label of its limits: {', '.join(x.label for x in limits)}")
    return Example(robot, "file" if path else kind, data.get("index", 0), label, path, payload)
