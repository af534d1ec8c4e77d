"""Timing of a line: every law and peer times the same joint path and is certified."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.blocks.block import Entry
from benchmarks.blocks.contest import timed, turns
from benchmarks.blocks.timing.motions import DrawnLine
from benchmarks.blocks.timing.rows import facts_of
from benchmarks.blocks.timing.settings import LawBlock, told
from benchmarks.peers.ik.base import Absent
from benchmarks.peers.laws.base import build_timing_peer, peer_limits
from benchmarks.records import UNKEPT, Journal
from optik import se3
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, make_solver
from optik.registry import short_name
from planners.certificate.certification import certify
from planners.certificate.violation import LIMIT_WORDS
from planners.following.follow import FollowResult, JointPath, follow
from planners.limits import MotionLimits
from planners.plan import Plan, PlanStatus, make_law, plan
from planners.timing.base import TimeLaw
from planners.trajectory import Trajectory


@dataclass(frozen=True)
class Timer:
    """A law or a peer, ready to time joint paths within some limits."""

    label: str
    role: str  # law, peer or reference
    enforced: tuple[str, ...]  # limits that it enforces
    call: Callable[[JointPath], Any]  # the timed function of a joint path
    motion: Callable[[JointPath, Any], Trajectory]  # from a joint path and the result of `call`; not timed
    law: TimeLaw | None  # for whole plans, if it is a law of optik
    told: MotionLimits  # limits that the law receives: all but those of `without`; the certificate judges all limits
    took_ms: Callable[[Any], float | None] = lambda raw: None  # time of a call that another process measured, else None
    ended: str = ""  # how the law crashed the process in this block; it is not called again


def line_rows(block: LawBlock, line: DrawnLine, journal: Journal = UNKEPT) -> list[dict[str, Any]]:
    """Return the rows of one line, for every IK method and every set of limits."""
    return [row for name in block.solvers for row in _rows_by(name, block, line, journal)]


def _rows_by(name: str, block: LawBlock, line: DrawnLine, journal: Journal) -> list[dict[str, Any]]:
    """Return the rows of one line that an IK method follows."""
    solver = make_solver(line.robot, name)

    def follow_it() -> FollowResult:
        return follow(solver, line.path, line.q_start, samples=block.samples)

    ms, followed = _median_ms(follow_it, block.rounds)
    ends = line.path(np.array([0.0, line.path.end]))
    about = {
        "robot": line.arm, "kind": line.kind, "index": line.index, "length": line.path.end,
        "turn": float(np.linalg.norm(se3.error(ends[0], ends[1])[3:])), "draws": line.draws,
        "start": line.q_start.tolist(), "ms_follow": ms, "solver": short_name(name),
    }  # fmt: skip
    if (joints := followed.joint_path) is not None:
        about["ik_position_error"] = float(joints.ik.position_error.max())
        about["ik_rotation_error"] = float(joints.ik.rotation_error.max())
    own = f" {short_name(name)}" if len(block.solvers) > 1 else ""
    rows = []
    for limits in block.limits:
        within = limits.of(line.robot)
        timers = timers_of(block, line, within, journal)
        if followed.failure is not None:
            found = [
                _row_of(c) | {"status": str(followed.failure.status), "reason": followed.failure.reason} for c in timers
            ]
        else:
            assert joints is not None
            found = _timed_rows(block, line, within, solver, joints, timers, journal)
        problem = f"{line.arm} {line.kind} {line.index} {limits.label}{own}"
        rows += [row | about | {"problem": problem, "limits": limits.label} for row in found]
    return rows


def _row_of(c: Timer) -> dict[str, Any]:
    return {"method": c.label, "entry": c.role, "status": "solved", "reason": ""}


def timers_of(block: LawBlock, line: DrawnLine, limits: MotionLimits, journal: Journal = UNKEPT) -> list[Timer]:
    """Return all laws, the installed peers that take this line, and the reference."""
    found: list[Timer | None] = []
    for entry in (*block.laws, *block.peers, *([block.reference] if block.reference else [])):
        if entry.role == "peer" and entry.most is not None and line.index >= entry.most:
            continue
        if entry.label in journal.crashed:
            found.append(_crashed(entry, journal.crashed[entry.label]))
            continue
        with journal.at_work(entry.label):
            found.append(_peer(entry, limits, line.robot.n) if entry.role == "peer" else _ours(entry, limits))
    return [timer for timer in found if timer is not None]


def _peer(entry: Entry, limits: MotionLimits, n: int) -> Timer | None:
    """Return a peer; None if it is not installed."""
    peer = build_timing_peer(entry.name, peer_limits(limits, n))
    if isinstance(peer, Absent):
        return None
    return Timer(entry.label, "peer", peer.enforced, peer.call, peer.trajectory, None, limits, peer.took_ms)


def _crashed(entry: Entry, why: str) -> Timer:
    """Return a law or a peer that has crashed the process, and is not called again."""

    def never(*given: Any) -> Any:
        raise AssertionError(f"{entry.label} is not called again")

    return Timer(entry.label, entry.role, (), never, never, None, MotionLimits(), ended=why)


def _ours(entry: Entry, limits: MotionLimits) -> Timer:
    law, within = make_law(entry.name, **entry.options), told(limits, entry)
    enforced = tuple(name for name in law.enforced if name not in entry.without)
    return Timer(entry.label, entry.role, enforced, lambda q: law.run(q, within), lambda q, raw: raw, law, within)


def _times(
    timers: Sequence[Timer], joints: JointPath, rounds: int, journal: Journal
) -> tuple[dict[str, list[float]], dict[str, Any]]:
    """Return the times of all calls [ms], and the last result of each law or peer; the first round does not count."""
    times: dict[str, list[float]] = {c.label: [] for c in timers}
    raws: dict[str, Any] = {}
    for turn, c in turns(timers, rounds + 1):
        failed = isinstance(raws.get(c.label), NoSolution)  # it would fail again, and some take seconds to
        if not failed and (
            c.role != "reference" or turn == rounds
        ):  # the reference is slow, and its time is not compared
            # each call has a copy of its own: what another call has computed on the path must not save it time
            with journal.at_work(c.label):
                ms, raws[c.label] = _once_ms(lambda c=c: _caught(c.call, copy.copy(joints)))  # type: ignore[misc]
            own = None if isinstance(raws[c.label], NoSolution) else c.took_ms(raws[c.label])
            times[c.label].append(ms if own is None else own)
    return times, raws


def _timed_rows(
    block: LawBlock,
    line: DrawnLine,
    limits: MotionLimits,
    solver: IKSolver,
    joints: JointPath,
    timers: Sequence[Timer],
    journal: Journal,
) -> list[dict[str, Any]]:
    """Return the rows of one line within some limits."""
    times, raws = _times([c for c in timers if not c.ended], joints, block.rounds, journal)
    rows = []
    for c in timers:
        row = _row_of(c)
        if c.ended:
            rows.append({"method": c.label, "entry": c.role, "status": "crashed", "reason": c.ended})
            continue
        row["ms_law"] = float(np.median(times[c.label][1:] or times[c.label]))
        with journal.at_work(c.label):
            rows.append(row | _judged(block, line, limits, solver, joints, c, raws[c.label]))
    return rows


def _judged(
    block: LawBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, joints: JointPath, c: Timer, raw: Any
) -> dict[str, Any]:
    """Return the columns on the motion of a law or a peer, by its certificate."""
    motion = _motion(c, joints, raw)
    if isinstance(motion, str):
        return {"status": "timing_infeasible", "reason": motion}
    ms, proof = _median_ms(  # the first call of a path prepares what all later ones use
        lambda: certify(line.robot, line.path, motion, limits, law=c.label, enforced=c.enforced), 1
    )
    if c.law is None:
        facts = facts_of(line.robot, line.path, motion, proof, limits)
    else:  # what `plan` returns: slowed until it keeps what the law promises
        facts = _planned_row(block, line, limits, solver, c)
    return {"ms_certificate": ms} | facts


def _planned_row(block: LawBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, c: Timer) -> dict[str, Any]:
    """Return the columns of a whole plan by a law of ours, and its time for the law whose plans are timed."""

    def plan_it() -> Plan:
        assert c.law is not None
        return plan(
            line.robot, line.path, line.q_start, solver=solver, timing=c.law, limits=c.told, allow=LIMIT_WORDS,
            **block.plan_options,
        )  # fmt: skip

    if c.role == "law" and (block.detail or c.label == block.plan):
        ms, planned = _median_ms(plan_it, block.rounds)
        timed_plan = {"ms_plan": ms}
    else:
        planned, timed_plan = plan_it(), {}
    if (
        planned.failure is not None and planned.status is not PlanStatus.NOT_PROVED
    ):  # one that is not proved is a motion
        return timed_plan | {"status": str(planned.status), "reason": planned.failure.reason}
    proof = planned.certificate
    if c.told is not limits:
        proof = certify(
            line.robot, line.path, planned.trajectory, limits, law=c.label, enforced=c.enforced, scene=planned.scene
        )
    facts = facts_of(line.robot, line.path, planned.trajectory, proof, limits)
    end = np.abs(planned.trajectory(planned.trajectory.end) - planned.joint_path(planned.joint_path.end)).max()
    return timed_plan | facts | {"slowed": planned.slowed, "end_error": float(end)}


def _motion(c: Timer, joints: JointPath, raw: Any) -> Trajectory | str:
    """Return the motion of a call, or the reason why there is none."""
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
    """Return the median of some calls without the first, and the last result."""
    ns, raws = timed(call, [()] * (rounds + 1))
    return float(np.median(ns[1:])) / 1e6, raws[-1]
