"""Blocks of timed lines: every line by every law and peer in one process, each call timed, each motion certified."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.lines import DrawnLine, draw_line
from benchmarks.peers.ik.base import Absent, version_of
from benchmarks.peers.laws.base import build_timing_peer
from benchmarks.records import RunFolder, slug
from benchmarks.speed import clock_cost, timed
from benchmarks.timing_example import run_example
from benchmarks.timing_facts import SCHEMA, blank, facts_of
from benchmarks.timing_suite import TIMING_PEERS, LawEntry, TimingBlock
from optik import se3
from optik.arm.library import load
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, make_solver
from optik.registry import load_method
from planners.certificate.certificate import certify
from planners.following.follow import Followed, JointPath, follow
from planners.limits import MotionLimits
from planners.plan import Plan, PlanStatus, make_law, plan
from planners.timing.base import TimeLaw
from planners.trajectory import Trajectory

Tell = Callable[[str], None]

PART = 5
"""Lines in one part: a run that was stopped repeats at most so many."""


@dataclass(frozen=True)
class Contestant:
    """A law or a peer, ready to time joint paths within some limits.

    Attributes
    ----------
    label : str
        What reports call it.
    kind : str
        ``law``, ``peer`` or ``reference``.
    keeps : tuple of str
        What it promises.
    call : callable
        The timed part, from a joint path.
    motion : callable
        From the joint path and what a call returned to the trajectory.
    law : TimeLaw or None
        Ours, for whole plans.
    """

    label: str
    kind: str
    keeps: tuple[str, ...]
    call: Callable[[JointPath], Any]
    motion: Callable[[JointPath, Any], Trajectory]
    law: TimeLaw | None


# ---------------------------------------------------------------- parts


def all_lines(block: TimingBlock) -> list[tuple[str, str, int]]:
    """Robot, kind and index of every line, in their order."""
    return [(part.robot, part.kind, index) for part in block.lines for index in range(part.count)]


def timing_parts(block: TimingBlock) -> list[str]:
    """Names of all parts of a block."""
    count = len(all_lines(block))
    return [f"timing/{slug(block.id)}--{part:04d}.parquet" for part in range(-(-count // PART))]


def example_part(block: TimingBlock, name: str) -> str:
    """Name of a part of the line that is looked at closely."""
    return f"timing/{slug(block.id)}.example-{name}.parquet"


def check_timing(block: TimingBlock) -> None:
    """Refuse wrong options, and limits that a law needs and nobody gave, before anything is written.

    Raises
    ------
    InvalidInput
        An option that a law does not have, limits of another length, or a missing one.
    """
    entries = [*block.laws, *([block.reference] if block.reference else [])]
    for name in block.robots:
        for entry in entries:
            law = make_law(entry.law, **entry.options)
            for limits in block.limits:
                law.need(limits.limits, load(name))
    for peer in block.peers:
        load_method(TIMING_PEERS, peer.peer, "peer of timing")


def run_timing(block: TimingBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
    """Run what a block still lacks; `tell` hears what is next."""
    lines, parts = all_lines(block), timing_parts(block)
    facts = f"timing/{slug(block.id)}.json"
    if not folder.has(facts):
        folder.write_json(facts, {"clock_ns": clock_cost(), "entries": _entries(block)})
    for part, file in enumerate(parts):
        if folder.has(file):
            continue
        rows: list[dict[str, Any]] = []
        for number in range(part * PART, min((part + 1) * PART, len(lines))):
            robot, kind, index = lines[number]
            tell(f"{block.id}: line {number + 1:,} of {len(lines):,}")
            line = draw_line(robot, kind, index, seed=seed)
            rows += [row | {"line": number} for row in line_rows(block, line)]
        folder.write(file, pl.DataFrame(rows, schema_overrides=SCHEMA, infer_schema_length=None))
    if not folder.has(example_part(block, "curve")):
        tell(f"{block.id}: the example")
        chosen = block.example
        line = draw_line(chosen.robot, chosen.kind, chosen.index, seed=seed)
        run_example(block, line, folder, lambda name: example_part(block, name))


def _entries(block: TimingBlock) -> dict[str, dict[str, Any]]:
    """Facts on every law and peer by label, for the report."""
    laws = [(law, "law") for law in block.laws] + ([(block.reference, "reference")] if block.reference else [])
    found: dict[str, dict[str, Any]] = {}
    for entry, kind in laws:
        words = ", ".join(f"{k} = {v}" for k, v in entry.options.items()) or "as it comes"
        keeps = list(make_law(entry.law, **entry.options).keeps)
        found[entry.label] = {"kind": kind, "name": entry.law, "version": None, "settings": words, "keeps": keeps}
    for peer in block.peers:
        kind_ = load_method(TIMING_PEERS, peer.peer, "peer of timing")
        built = build_timing_peer(peer.peer, block.limits[0].limits.arrays(load(block.robots[0]).n))
        found[peer.label] = {
            "kind": "peer", "name": peer.peer, "version": version_of(peer.peer, TIMING_PEERS),
            "settings": kind_.settings, "keeps": list(kind_.keeps),
        } | ({"absent": built.why} if isinstance(built, Absent) else {})  # fmt: skip
    return found


# ---------------------------------------------------------------- one line


def line_rows(block: TimingBlock, line: DrawnLine) -> list[dict[str, Any]]:
    """Rows of one line: one for each limits and contestant."""
    solver = make_solver(line.robot, block.ik)

    def follow_it() -> Followed:
        return follow(solver, line.path, line.q_start, samples=block.samples)

    ms, followed = _median_ms(follow_it, block.rounds)
    about = {
        "robot": line.robot.name, "kind": line.kind, "index": line.index, "length": line.path.end,
        "turn": float(np.linalg.norm(se3.error(line.path.start, line.path.goal)[3:])), "draws": line.draws,
        "start": line.q_start.tolist(), "ms_follow": ms,
    }  # fmt: skip
    rows = []
    for limits in block.limits:
        contestants = contestants_of(block, line, limits.limits)
        if followed.stop is not None:
            found = [
                blank(c.label, c.kind) | {"status": str(followed.stop.status), "reason": followed.stop.reason}
                for c in contestants
            ]
        else:
            assert followed.joint_path is not None
            found = _timed_rows(block, line, limits.limits, solver, followed.joint_path, contestants)
        rows += [row | about | {"limits": limits.label} for row in found]
    return rows


def contestants_of(block: TimingBlock, line: DrawnLine, limits: MotionLimits) -> list[Contestant]:
    """All laws, the peers that are here and are given this line, and the reference."""
    found = [_ours(entry, "law", limits) for entry in block.laws]
    for entry in block.peers:
        if entry.max_lines is None or line.index < entry.max_lines:
            peer = build_timing_peer(entry.peer, limits.arrays(line.robot.n))
            if not isinstance(peer, Absent):
                found.append(Contestant(entry.label, "peer", peer.keeps, peer.call, peer.trajectory, None))
    return found + ([_ours(block.reference, "reference", limits)] if block.reference else [])


def _ours(entry: LawEntry, kind: str, limits: MotionLimits) -> Contestant:
    law = make_law(entry.law, **entry.options)
    return Contestant(entry.label, kind, law.keeps, lambda q: law.run(q, limits), lambda q, raw: raw, law)


def _timed_rows(
    block: TimingBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, joints: JointPath,
    contestants: list[Contestant],
) -> list[dict[str, Any]]:  # fmt: skip
    """Rows of one line within some limits.

    In every round each contestant takes its turn, another one first each time, on a joint path that nobody has used yet;
    the first round is not timed. The reference is slow, and nobody asks how fast it is: it is called once.
    """
    times: dict[str, list[float]] = {c.label: [] for c in contestants}
    raws: dict[str, Any] = {}
    for turn in range(block.rounds + 1):
        for k in range(len(contestants)):
            c = contestants[(turn + k) % len(contestants)]
            failed = isinstance(raws.get(c.label), NoSolution)  # it would fail again, and some take seconds to
            if not failed and (c.kind != "reference" or turn == block.rounds):
                ms, raws[c.label] = _once_ms(lambda c=c: _caught(c.call, copy.copy(joints)))  # type: ignore[misc]
                times[c.label].append(ms)
    rows = []
    for c in contestants:
        row = blank(c.label, c.kind) | {"ms_law": float(np.median(times[c.label][1:] or times[c.label]))}
        motion = _motion(c, joints, raws[c.label])
        if isinstance(motion, str):
            row |= {"status": "timing_infeasible", "reason": motion}
        else:
            row["ms_certificate"], proof = _once_ms(
                lambda c=c, motion=motion: certify(line.robot, line.path, motion, limits, law=c.label, keeps=c.keeps)  # type: ignore[misc]
            )
            if c.law is None:
                row |= facts_of(line.robot, line.path, motion, proof, limits)
            else:  # what the user gets: slowed until it keeps what the law promises
                row |= _planned_row(block, line, limits, solver, c)
        rows.append(row)
    return rows


def _planned_row(
    block: TimingBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, c: Contestant
) -> dict[str, Any]:
    def plan_it() -> Plan:
        assert c.law is not None
        return plan(line.robot, line.path, line.q_start, ik=solver, timing=c.law, limits=limits, samples=block.samples)

    if c.kind == "law" and c.label == block.plan:
        ms, planned = _median_ms(plan_it, block.rounds)
        timed_plan = {"ms_plan": ms}
    else:
        planned, timed_plan = plan_it(), {}
    if planned.stop is not None and planned.status is not PlanStatus.NOT_PROVED:  # one that is not proved is a motion
        return timed_plan | {"status": str(planned.status), "reason": planned.stop.reason}
    facts = facts_of(line.robot, line.path, planned.trajectory, planned.certificate, limits)
    return timed_plan | facts | {"slowed": getattr(planned, "slowed", None)}


def _motion(c: Contestant, joints: JointPath, raw: Any) -> Trajectory | str:
    """What came of a call, or why it is no motion."""
    if isinstance(raw, NoSolution):
        return raw.reason
    try:
        return c.motion(joints, raw)
    except InvalidInput as error:  # an answer with NaN, or with times that run back
        return f"its answer is no motion: {error}"


def _caught(call: Callable[[JointPath], Any], joints: JointPath) -> Any:
    try:
        return call(joints)
    except NoSolution as error:
        return error


def _once_ms(call: Callable[[], Any]) -> tuple[float, Any]:
    ns, raws = timed(call, [()])
    return float(ns[0]) / 1e6, raws[0]


def _median_ms(call: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Median of some calls, the first left out, and what the last returned."""
    ns, raws = timed(call, [()] * (rounds + 1))
    return float(np.median(ns[1:])) / 1e6, raws[-1]
