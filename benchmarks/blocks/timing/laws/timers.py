"""Timing of a line: every law and peer times the same joint path and is certified; one line is shown in detail."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks.arms import torques_at
from benchmarks.blocks.base import Entry
from benchmarks.blocks.contest import Contestant, enter, enter_peer, facts_on, timed, timed_calls, turns
from benchmarks.blocks.timing.laws.motions import DrawnLine
from benchmarks.blocks.timing.laws.rows import blank, facts_of
from benchmarks.blocks.timing.laws.settings import LawBlock, told
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.peers.laws.base import TimingPeer, peer_limits
from benchmarks.records import UNKEPT, Journal, RunFolder
from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, make_solver
from optik.registry import load_method
from optik.types import Array
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import LIMIT_WORDS
from planners.following.follow import FollowResult, JointPath, follow
from planners.limits import DERIVATIVES, LOADED, MotionLimits, ratio_to_limit, sides
from planners.plan import Plan, PlanStatus, make_law, plan
from planners.timing.base import TimeLaw, speed_bound
from planners.trajectory import Trajectory


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
        entered = enter_laws(block, line.robot.n, within, journal, line.index)
        timers = [c for c in entered if "absent" not in c.about]
        if followed.failure is not None:
            found = [
                blank(c.label, c.entry.role)
                | {"status": str(followed.failure.status), "reason": followed.failure.reason}
                for c in timers
            ]
        else:
            assert followed.joint_path is not None
            found = _timed_rows(block, line, within, solver, followed.joint_path, timers, journal)
        problem = f"{line.arm} {line.kind} {line.index} {limits.label}"
        rows += [row | about | {"problem": problem, "limits": limits.label} for row in found]
    return rows


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
        peer: type[TimingPeer] = load_method(TIMING_PEERS, entry.name, "peer of timing")
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
        row = blank(c.label, c.entry.role)
        if c.ended:
            rows.append(row | {"status": "crashed", "reason": c.ended})
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
        return _plan(block, line, solver, c.method, within)

    if c.entry.role == "law" and c.label == block.plan:
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
        proof = certify(line.robot, line.path, planned.trajectory, limits, law=c.label, enforced=enforced)
    facts = facts_of(line.robot, line.path, planned.trajectory, proof, limits)
    return timed_plan | facts | {"slowed": planned.slowed}


def _plan(block: LawBlock, line: DrawnLine, solver: IKSolver, law: TimeLaw, within: MotionLimits) -> Plan:
    return plan(
        line.robot, line.path, line.q_start, solver=solver, timing=law, limits=within, samples=block.samples, allow=LIMIT_WORDS
    )  # fmt: skip


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
            within = told(limits, entry)
            planned = _plan(block, line, solver, make_law(entry.name, **entry.options), within)
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
