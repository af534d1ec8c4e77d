"""Timing of a line: every law and peer times the same joint path and is certified; the motion in detail."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.blocks.block import Entry
from benchmarks.blocks.contest import Contestant, enter, enter_peer, facts_on, timed, timed_calls, turns
from benchmarks.blocks.entries import sample_torques
from benchmarks.blocks.timing.motions import DrawnLine
from benchmarks.blocks.timing.rows import plan_facts
from benchmarks.blocks.timing.settings import LawBlock, told
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.peers.laws.base import TimingPeer, peer_limits
from benchmarks.records import UNKEPT, Journal, RunFolder
from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, make_solver
from optik.registry import load_method, short_name
from optik.scene.contact import find_clearances
from optik.types import Array
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import LIMIT_WORDS
from planners.following.follow import FollowResult, JointPath, follow
from planners.limits import DERIVATIVES, LOADED, MotionLimits, ratio_to_limit, sides
from planners.plan import Plan, PlanStatus, make_law, plan
from planners.timing.base import speed_bound
from planners.trajectory import Trajectory

# ---------------- timing of a line


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
    suffix = f" {short_name(name)}" if len(block.solvers) > 1 else ""
    rows = []
    for limits in block.limits:
        within = limits.of(line.robot)
        entered = enter_laws(block, line.robot.n, within, journal, line.index)
        timers = [c for c in entered if "absent" not in c.about]
        if followed.failure is not None:
            law_rows = [
                _row_of(c) | {"status": str(followed.failure.status), "reason": followed.failure.reason} for c in timers
            ]
        else:
            assert joints is not None
            law_rows = _timed_rows(block, line, within, solver, joints, timers, journal)
        problem = f"{line.arm} {line.kind} {line.index} {limits.label}{suffix}"
        rows += [row | about | {"problem": problem, "limits": limits.label} for row in law_rows]
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
    block: LawBlock, line: DrawnLine, limits: MotionLimits, solver: IKSolver, joints: JointPath,
    timers: Sequence[Contestant], journal: Journal,
) -> list[dict[str, Any]]:  # fmt: skip
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
        facts = plan_facts(line.robot, line.path, motion, proof, limits)
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
    facts = plan_facts(line.robot, line.path, planned.trajectory, proof, limits)
    end = np.abs(planned.trajectory(planned.trajectory.end) - planned.joint_path(planned.joint_path.end)).max()
    return timed_plan | facts | {"slowed": planned.stretch_factor, "end_error": float(end)}


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


# ---------------- the motion of the detailed view


MOTION_INSTANTS = 751
"""Number of stored instants of the joints: a pixel each, five to an interval of the paper's line."""

CLEARANCE_INSTANTS = 501
"""Number of stored instants of the clearance; the least value is the certificate's."""

TOOL_INSTANTS = 1501
"""Number of stored instants of the tool's deviation, which oscillates between the samples; the largest of several is drawn."""

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
    tables: dict[str, list[pl.DataFrame]] = {}
    clearances: list[dict[str, Any]] = []
    for entry in (one for one in block.laws if one.label not in journal.crashed):
        with journal.at_work(entry.label):
            planned, proof = _plan_and_proof(block, line, entry, limits)
        if proof is None:
            continue
        frames = {"motions": motion_frame(planned, limits), "binding": binding_frame(proof)}
        if block.detail:
            frames |= {"joints": joint_frame(planned), "tool": tool_frame(planned)}
        if block.detail and planned.scene is not None:
            frames["clearance"] = clearance_frame(planned)
            clearances.append(clearance_facts(planned) | {"law": entry.label})
        for table, frame in frames.items():
            tables.setdefault(table, []).append(frame.with_columns(law=pl.lit(entry.label)))
    for table, parts in tables.items():
        folder.write(name(f"{table}.parquet"), pl.concat(parts))
    if clearances:
        folder.write_json(name("clearance.json"), clearances)
    joints = next((followed for by in block.solvers if (followed := _follow(block, line, by)) is not None), None)
    curve = pl.DataFrame({"s": []}) if joints is None or not tables else curve_frame(joints, limits)
    folder.write(name("curve.parquet"), curve)


def _plan_and_proof(
    block: LawBlock, line: DrawnLine, entry: Entry, limits: MotionLimits
) -> tuple[Plan, Certificate | None]:
    """Return the plan of a law by the first IK method that finds one, and its certificate with all limits."""
    law, within = make_law(entry.name, **entry.options), told(limits, entry)
    for name in block.solvers:
        planned = plan(
            line.robot, line.path, line.q_start, solver=make_solver(line.robot, name), timing=law, limits=within,
            allow=LIMIT_WORDS, **block.plan_options,
        )  # fmt: skip
        if planned:
            break
    if not planned or within is limits:
        return planned, planned.certificate if planned else None
    return planned, certify(line.robot, line.path, planned.trajectory, limits)


def _follow(block: LawBlock, line: DrawnLine, name: str) -> JointPath | None:
    return follow(make_solver(line.robot, name), line.path, line.q_start, samples=block.samples).joint_path


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
    values = dict(zip(("torque", "torque_rate"), sample_torques(robot, motion, t), strict=True))
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


def joint_frame(planned: Plan) -> pl.DataFrame:
    """Return the motion q, q̇, q̈, jerk of every joint, one row for each instant and joint."""
    motion = planned.trajectory
    t = np.linspace(0.0, motion.end, MOTION_INSTANTS)
    values = [motion(t, order) for order in range(4)]
    joints = planned.robot.joint_names
    return pl.DataFrame(
        {
            "t": np.repeat(t, len(joints)),
            "joint": list(joints) * MOTION_INSTANTS,
            **{name: v.ravel() for name, v in zip(("q", "dq", "ddq", "jerk"), values, strict=True)},
            **_torques(planned, t),
        }
    )


def _torques(planned: Plan, t: Array) -> dict[str, Array]:
    """Return torques and torque rates for the load with larger values at each instant; empty without masses."""
    robot, motion = planned.robot, planned.trajectory
    if robot.inertia is None:
        return {}
    found = [np.take_along_axis(x, np.abs(x).argmax(axis=0)[None], axis=0)[0] for x in sample_torques(robot, motion, t)]
    return dict(zip(("torque", "torque_rate"), (x.ravel() for x in found), strict=True))


def tool_frame(planned: Plan) -> pl.DataFrame:
    """Return the tool's position and its distance from the path, one row per instant."""
    t = np.linspace(0.0, planned.trajectory.end, TOOL_INSTANTS)
    pose = planned.robot.fk(planned.trajectory(t))
    s = planned.path.nearest(pose)
    e = se3.error(pose, planned.path.pose(s))
    return pl.DataFrame(
        {
            "t": t,
            "s": s,
            "x": pose[:, 0, 3],
            "y": pose[:, 1, 3],
            "z": pose[:, 2, 3],
            "distance": np.linalg.norm(e[:, :3], axis=1),
            "angle": np.linalg.norm(e[:, 3:], axis=1),
        }
    )


def clearance_frame(planned: Plan) -> pl.DataFrame:
    """Return the least distances over time, by the compiled distances at instants."""
    assert planned.scene is not None
    t = np.linspace(0.0, planned.trajectory.end, CLEARANCE_INSTANTS)
    distances, _ = find_clearances(planned.robot, planned.scene, planned.trajectory(t))
    finite = np.where(np.isfinite(distances), distances, np.nan)
    return pl.DataFrame({"t": t, "scene": finite[:, 0], "own": finite[:, 1]}, nan_to_null=True)


def clearance_facts(planned: Plan) -> dict[str, Any]:
    """Return the least distances of the certificate in words, with their times, and the pairs that were not examined."""
    proof = planned.certificate.clearance
    assert proof is not None
    return {
        "words": "; ".join(f"{words} {kind.describe()}" for words, kind in proof.kinds.items()),
        "marks": [(kind.time, kind.found) for kind in proof.kinds.values()],
        "left_out": [list(pair) for pair in proof.left_out],
    }


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
