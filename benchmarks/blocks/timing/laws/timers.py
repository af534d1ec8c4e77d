"""Timing of a line: every law and peer times the same joint path and is certified; one line is shown in detail."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks.arms import torques_at
from benchmarks.blocks.base import Entry
from benchmarks.blocks.contest import timed, turns
from benchmarks.blocks.timing.laws.motions import DrawnLine
from benchmarks.blocks.timing.laws.rows import blank, facts_of
from benchmarks.blocks.timing.laws.settings import LawBlock, told
from benchmarks.peers.ik.base import Absent
from benchmarks.peers.laws.base import build_timing_peer, peer_limits
from benchmarks.records import UNKEPT, Journal, RunFolder
from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, make_solver
from optik.types import Array
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import LIMIT_WORDS
from planners.following.follow import FollowResult, JointPath, follow
from planners.limits import DERIVATIVES, LOADED, MotionLimits, ratio_to_limit, sides
from planners.plan import Plan, PlanStatus, make_law, plan
from planners.timing.base import TimeLaw, speed_bound
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
    """Return the rows of one line."""
    solver = make_solver(line.robot, block.solver)

    def follow_it() -> FollowResult:
        return follow(solver, line.path, line.q_start, samples=block.samples)

    ms, followed = _median_ms(follow_it, block.rounds)
    ends = line.path(np.array([0.0, line.path.end]))
    about = {
        "robot": line.arm, "kind": line.kind, "index": line.index, "length": line.path.end,
        "turn": float(np.linalg.norm(se3.error(ends[0], ends[1])[3:])), "draws": line.draws,
        "start": line.q_start.tolist(), "ms_follow": ms,
    }  # fmt: skip
    rows = []
    for limits in block.limits:
        within = limits.of(line.robot)
        timers = timers_of(block, line, within, journal)
        if followed.failure is not None:
            found = [
                blank(c.label, c.role) | {"status": str(followed.failure.status), "reason": followed.failure.reason}
                for c in timers
            ]
        else:
            assert followed.joint_path is not None
            found = _timed_rows(block, line, within, solver, followed.joint_path, timers, journal)
        problem = f"{line.arm} {line.kind} {line.index} {limits.label}"
        rows += [row | about | {"problem": problem, "limits": limits.label} for row in found]
    return rows


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
        row = blank(c.label, c.role)
        if c.ended:
            rows.append(row | {"status": "crashed", "reason": c.ended})
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
            line.robot, line.path, line.q_start, solver=solver, timing=c.law, limits=c.told, samples=block.samples,
            allow=LIMIT_WORDS,
        )  # fmt: skip

    if c.role == "law" and c.label == block.plan:
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
        proof = certify(line.robot, line.path, planned.trajectory, limits, law=c.label, enforced=c.enforced)
    facts = facts_of(line.robot, line.path, planned.trajectory, proof, limits)
    return timed_plan | facts | {"slowed": planned.slowed}


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


EXAMPLE_INSTANTS = 1201
"""Number of instants of each motion that are stored for plots."""

CURVE_PLACES = 401
"""Number of positions along the line at which the bounding curves are computed."""

MOST_SPEED = 1e9
"""Largest stored bound on the path speed [m/s]: a file has no infinity."""


def write_example(
    block: LawBlock, line: DrawnLine, folder: RunFolder, name: Callable[[str], str], journal: Journal
) -> None:
    """Write the motions of all laws, their active constraints, and last the curves over s, which mark completion."""
    limits = next(part for part in block.limits if part.label == block.example.limits).of(line.robot)
    solver = make_solver(line.robot, block.solver)
    motions, bindings = [], []
    for entry in (one for one in block.laws if one.label not in journal.crashed):
        with journal.at_work(entry.label):
            law, within = make_law(entry.name, **entry.options), told(limits, entry)
            planned = plan(
                line.robot, line.path, line.q_start, solver=solver, timing=law, limits=within, samples=block.samples,
                allow=LIMIT_WORDS,
            )  # fmt: skip
        if planned:
            motions.append(motion_frame(planned, limits).with_columns(law=pl.lit(entry.label)))
            proof = planned.certificate
            if within is not limits:
                proof = certify(line.robot, line.path, planned.trajectory, limits)
            bindings.append(binding_frame(proof).with_columns(law=pl.lit(entry.label)))
    joints = follow(solver, line.path, line.q_start, samples=block.samples).joint_path
    if motions and joints is not None:
        folder.write(name("motions"), pl.concat(motions))
        folder.write(name("binding"), pl.concat(bindings))
        folder.write(name("curve"), curve_frame(joints, limits))
    else:
        folder.write(name("curve"), pl.DataFrame({"s": []}))


def motion_frame(planned: Plan, limits: MotionLimits) -> pl.DataFrame:
    """Return the path speed and the ratios of the joints to their limits, over time."""
    robot, path, motion = planned.robot, planned.path, planned.trajectory
    t = np.linspace(0.0, motion.end, EXAMPLE_INSTANTS)
    q = motion(t)
    s = path.nearest(robot.fk(q))
    twist, tool = path.twist(s), np.einsum("kij,kj->ki", robot.jacobian(q), motion(t, 1))
    part = slice(3, 6) if path.unit == "rad" else slice(0, 3)
    speed = np.einsum("ki,ki->k", tool[:, part], twist[:, part]) / np.einsum("ki,ki->k", twist[:, part], twist[:, part])
    bound = limits.bounds(robot.n)
    ratios = {
        field: ratio_to_limit(motion(t, order), bound[field]).max(axis=1)
        for order, field in enumerate(DERIVATIVES, start=1)
    }
    return pl.DataFrame({"t": t, "s": s, "speed": speed, **ratios, **torque_ratios(robot, motion, limits, t)})


def torque_ratios(robot: Robot, motion: Trajectory, limits: MotionLimits, t: Array) -> dict[str, Array]:
    """Return the ratios of torques and their rates to their limits, over time."""
    bound = limits.bounds(robot.n)
    given = [name for name in LOADED if np.isfinite(bound[name]).any()]
    if not given:
        return {}
    values = dict(zip(("torque", "torque_rate"), torques_at(robot, motion, t), strict=True))
    return {name: ratio_to_limit(values[name], bound[name]).max(axis=(0, 2)) for name in given}


def binding_frame(proof: Certificate) -> pl.DataFrame:
    """Return the active constraint of each piece of a motion."""
    b = proof.binding
    return pl.DataFrame(
        {"from": b.s[:-1], "to": b.s[1:], "ratio": b.ratio, "limit": list(b.limit), "joint": list(b.joint)}
    )


def curve_frame(joints: JointPath, limits: MotionLimits) -> pl.DataFrame:
    """Return the greatest path speed over s by the velocity limits, and by the acceleration limits for any s̈."""
    s = np.linspace(0.0, joints.end, CURVE_PLACES)
    bound, names = limits.bounds(joints.robot.n), joints.robot.joint_names
    by_joint = ratio_to_limit(joints(s, 1), bound["velocity"])
    acceleration = maximum_velocity(joints(s, 1), joints(s, 2), bound["acceleration"])
    return pl.DataFrame(
        {
            "s": s,
            "velocity": np.minimum(speed_bound(joints, limits, s), MOST_SPEED),
            "velocity_joint": [names[i] for i in by_joint.argmax(axis=1)],
            "acceleration": np.minimum(acceleration, MOST_SPEED),
            "singular_value": joints.robot.singular_values(joints(s))[:, -1],
        }
    )


def maximum_velocity(q1: Array, q2: Array, limit: Array) -> Array:
    """Return the maximum-velocity curve: the greatest ṡ (k,) with an s̈ that satisfies |q' s̈ + q'' ṡ²| ≤ limit on every joint.

    Each joint allows an interval of s̈ whose ends are linear in x = ṡ², so the feasible x are an interval from 0, whose end
    bisection finds (Bobrow, Dubowsky and Gibson, IJRR 1985).
    """
    low, high = np.zeros(len(q1)), np.full(len(q1), 1.0)
    for _ in range(200):  # some x that is too large, where there is one
        good = _some_acceleration(q1, q2, limit, high)
        if not good.any() or high.max() > 1e18:
            break
        high = np.where(good, 4.0 * high, high)
    for _ in range(80):
        middle = 0.5 * (low + high)
        good = _some_acceleration(q1, q2, limit, middle)
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    return np.sqrt(low)


def _some_acceleration(q1: Array, q2: Array, limit: Array, x: Array) -> NDArray[np.bool_]:
    """Return whether some s̈ respects all limits at ṡ² = x (k,)."""
    lower, upper = sides(limit)
    moves = np.abs(q1) > 1e-12 * np.abs(q1).max()
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.stack([lower, upper])[:, None] - q2 * x[:, None]) / q1
    least = np.where(moves, ends.min(axis=0), -np.inf).max(axis=1)
    most = np.where(moves, ends.max(axis=0), np.inf).min(axis=1)
    stands = np.where(moves, True, ratio_to_limit(q2 * x[:, None], limit) <= 1.0).all(axis=1)
    return np.asarray((least <= most) & stands)
