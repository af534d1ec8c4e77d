"""Timing of a line: every law and peer times the same joint path and is certified."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.blocks.block import Entry
from benchmarks.blocks.contest import Contestant, enter, enter_peer, facts_on, timed, timed_calls, turns
from benchmarks.blocks.timing.motions import DrawnLine
from benchmarks.blocks.timing.rows import facts_of
from benchmarks.blocks.timing.settings import LawBlock, told
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.peers.laws.base import TimingPeer, peer_limits
from benchmarks.records import UNKEPT, Journal
from optik import se3
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, make_solver
from optik.registry import load_method, short_name
from planners.certificate.certification import certify
from planners.certificate.violation import LIMIT_WORDS
from planners.following.follow import FollowResult, JointPath, follow
from planners.limits import MotionLimits
from planners.plan import Plan, PlanStatus, make_law, plan
from planners.trajectory import Trajectory


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
        entered = enter_laws(block, line.robot.n, within, journal, line.index)
        timers = [c for c in entered if "absent" not in c.about]
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


def _row_of(c: Contestant) -> dict[str, Any]:
    return {"method": c.label, "entry": c.entry.role, "status": "solved", "reason": ""}


def enter_laws(
    block: LawBlock, n: int, limits: MotionLimits, journal: Journal = UNKEPT, index: int = 0
) -> list[Contestant]:
    """Build all laws, the peers that take motions with this index, and the reference."""

    def build(entry: Entry) -> Contestant:
        if entry.role == "peer":
            return enter_peer(entry, TIMING_PEERS, peer_limits(limits, n))
        law, within = make_law(entry.name, **entry.options), told(limits, entry)
        return Contestant(entry, _facts(entry), lambda q: law.run(q, within), lambda q, raw: raw, law)

    entries = (*block.laws, *block.peers, *([block.reference] if block.reference else []))
    given = [entry for entry in entries if entry.role != "peer" or entry.most is None or index < entry.most]
    return [enter(entry, journal, build, _facts) for entry in given]


def _facts(entry: Entry) -> dict[str, Any]:
    """Return the facts on a law or a peer, for the report."""
    if entry.role == "peer":
        peer: type[TimingPeer] = load_method(TIMING_PEERS, entry.name, "peer of time laws")
        return facts_on(entry) | peer.facts()
    enforced = [name for name in make_law(entry.name, **entry.options).enforced if name not in entry.without]
    return facts_on(entry, enforced=enforced)


def _times(
    timers: Sequence[Contestant], joints: JointPath, rounds: int, journal: Journal
) -> tuple[dict[str, list[float]], dict[str, Any]]:
    """Return the times of all calls [ms], and the last result of each law or peer; the first round does not count."""
    times: dict[str, list[float]] = {c.label: [] for c in timers}
    raws: dict[str, Any] = {}
    for turn, c in turns(timers, rounds + 1):
        failed = isinstance(raws.get(c.label), NoSolution)  # it would fail again, and some take seconds to
        if not failed and (
            c.entry.role != "reference" or turn == rounds
        ):  # the reference is slow, and its time is not compared
            # each call has a copy of its own: what another call has computed on the path must not save it time
            with journal.at_work(c.label):
                ns, _, (raws[c.label],) = timed_calls(c, [(copy.copy(joints),)], (NoSolution,))
            times[c.label].append(float(ns[0]) / 1e6)
    return times, raws


def _timed_rows(
    block: LawBlock,
    line: DrawnLine,
    limits: MotionLimits,
    solver: IKSolver,
    joints: JointPath,
    timers: Sequence[Contestant],
    journal: Journal,
) -> list[dict[str, Any]]:
    """Return the rows of one line within some limits."""
    times, raws = _times([c for c in timers if not c.ended], joints, block.rounds, journal)
    rows = []
    for c in timers:
        row = _row_of(c)
        if c.ended:
            rows.append({"method": c.label, "entry": c.entry.role, "status": "crashed", "reason": c.ended})
            continue
        row["ms_law"] = float(np.median(times[c.label][1:] or times[c.label]))
        with journal.at_work(c.label):
            rows.append(row | _judged(block, line, limits, solver, joints, c, raws[c.label]))
    return rows


def _judged(
    block: LawBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, joints: JointPath, c: Contestant, raw: Any
) -> dict[str, Any]:
    """Return the columns on the motion of a law or a peer, by its certificate."""
    motion = _motion(c, joints, raw)
    if isinstance(motion, str):
        return {"status": "timing_infeasible", "reason": motion}
    ms, proof = _median_ms(  # the first call of a path prepares what all later ones use
        lambda: certify(line.robot, line.path, motion, limits, law=c.label, enforced=tuple(c.about["enforced"])), 1
    )
    if c.entry.role == "peer":
        facts = facts_of(line.robot, line.path, motion, proof, limits)
    else:  # what `plan` returns: slowed until it keeps what the law promises
        facts = _planned_row(block, line, limits, solver, c)
    return {"ms_certificate": ms} | facts


def _planned_row(
    block: LawBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, c: Contestant
) -> dict[str, Any]:
    """Return the columns of a whole plan by a law of ours, and its time for the law whose plans are timed."""
    within = told(limits, c.entry)

    def plan_it() -> Plan:
        return plan(
            line.robot, line.path, line.q_start, solver=solver, timing=c.method, limits=within, allow=LIMIT_WORDS,
            **block.plan_options,
        )  # fmt: skip

    if c.entry.role == "law" and (block.detail or c.label == block.plan):
        ms, planned = _median_ms(plan_it, block.rounds)
        timed_plan = {"ms_plan": ms}
    else:
        planned, timed_plan = plan_it(), {}
    if (
        planned.failure is not None and planned.status is not PlanStatus.NOT_PROVED
    ):  # one that is not proved is a motion
        return timed_plan | {"status": str(planned.status), "reason": planned.failure.reason}
    proof = planned.certificate
    if within is not limits:
        enforced = tuple(c.about["enforced"])
        scene = planned.scene
        proof = certify(line.robot, line.path, planned.trajectory, limits, law=c.label, enforced=enforced, scene=scene)
    facts = facts_of(line.robot, line.path, planned.trajectory, proof, limits)
    end = np.abs(planned.trajectory(planned.trajectory.end) - planned.joint_path(planned.joint_path.end)).max()
    return timed_plan | facts | {"slowed": planned.slowed, "end_error": float(end)}


def _motion(c: Contestant, joints: JointPath, raw: Any) -> Trajectory | str:
    """Return the motion of a call, or the reason why there is none."""
    if isinstance(raw, NoSolution):
        return raw.reason
    try:
        return c.read(joints, raw)  # type: ignore[no-any-return]
    except NoSolution as error:
        return error.reason
    except InvalidInput as error:  # an answer with NaN, or with times that run back
        return f"its answer is no motion: {error}"


def _median_ms(call: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Return the median of some calls without the first, and the last result."""
    ns, raws = timed(call, [()] * (rounds + 1))
    return float(np.median(ns[1:])) / 1e6, raws[-1]
