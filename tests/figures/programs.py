"""Random programs of 2 to 40 parts on six arms: certified, inside their zones and limits, and shorter than with stops.

A case is a program at zones of 2, 10 and 50 mm and with a stop at every part. Each part is drawn so that it can be followed
alone. The oracle has its own forward kinematics and evaluates the polynomials itself; it measures the distance of the tool from
the sharp parts, the ratios to the limits, the jumps, and the rest at stops. The first cases measure the CPU time of a part
by the length of the program, and pick-and-place moves.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path as FilePath
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

import optik
import planners
from optik import Robot, se3
from optik.errors import InvalidInput, NoSolution, OptikError
from optik.ik import get_solver
from optik.types import Array, Flags
from planners import Arc, JointLine, Line, MotionLimits, Part, Path, PointToPoint, Polyline, Program, ProgramPlan
from planners.program import Move
from tests.figures.figure import ROOT, Row, Value, main

SEED = 20261127
ARMS = ("ur5e", "paper6r", "panda", "irb120", "urdf", "rail")
LENGTHS, PICKS, PROGRAMS = (10, 40, 160), 20, 500
ZONES = (2e-3, 1e-2, 5e-2)
ASKED, ASKED_PICK = (0.96, 0.885, 0.805), {1e-2: 0.83, 5e-2: 0.78}
TOLERANCE, FOLLOWED, SAMPLES = 1e-5, 0.475, 31
"""The default of `plan` [m, rad]; the fraction of it to which a program follows each part, and its samples."""
FOLLOWING = (FOLLOWED * TOLERANCE, FOLLOWED * TOLERANCE)
MIX = ("joint", "line", "arc", "polyline", "moves")
KINDS = (*MIX, "joint", "line", "pose", "vector")
TRIES, OFF_LIMITS, FREE_IN, LIMITED_IN = 40, 0.02, 12, 3
"""Draws of a part before the program is drawn anew; distance of goals from the limits; one program of so many has a part with a
free turn, and one of so many tool speeds."""
RATE, LOW_RATE, LONG = 20_000.0, 5_000.0, 5.0
"""Samples per second of a motion, and of one that is longer [1/s, s]."""
SHARP_SPACING, LEAST_SHARP, NEAREST = 1e-4, 400, 8
"""Mean distance of the points of a sharp part [m], how many more it has, and beside how many near ones chords are tried: at a
corner the nearest ones can be of the other part."""
ROUNDING = 1e-6


# ---------------------------------------------------------------- arms and programs
@cache
def arm(name: str) -> Robot:
    if name == "urdf":
        return Robot.from_urdf(ROOT / "examples" / "arm.urdf")
    if name != "rail":
        return optik.load(name)
    own = optik.load("ur5e")
    along = se3.pose(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.zeros(3))
    fixed = np.concatenate([[along], [np.linalg.inv(along) @ own.fixed[0]], own.fixed[1:]])
    velocity = np.concatenate([[1.0], speeds_of(own)])
    limits = optik.JointLimits(np.append(-1.0, own.limits.lower), np.append(1.0, own.limits.upper), velocity=velocity)
    return Robot("ur5e_on_a_rail", fixed, np.append(True, own.prismatic), own.tool, limits)


def speeds_of(robot: Robot) -> Array:
    return np.full(robot.n, 3.0) if robot.limits.velocity is None else np.asarray(robot.limits.velocity)


def limits_of(robot: Robot) -> MotionLimits:
    return MotionLimits(velocity=speeds_of(robot), acceleration=10.0, jerk=100.0)


def draw_start(robot: Robot, rng: np.random.Generator) -> Array:
    """A configuration above the floor and away from singularities."""
    low, high = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    while True:
        q = 0.5 * (low + high) + 0.35 * (high - low) * rng.uniform(-1.0, 1.0, robot.n)
        if robot.singular_values(q[None])[0].min() > 0.06 and robot.fk(q)[2, 3] > 0.05:
            return q


def draw_near(robot: Robot, q: Array, size: float, rng: np.random.Generator) -> Array:
    step = size * rng.uniform(-1.0, 1.0, robot.n) * np.where(robot.prismatic, 0.3, 1.0)
    return np.clip(q + step, robot.limits.lower + OFF_LIMITS, robot.limits.upper - OFF_LIMITS)


def draw_pose(T: Array, most: float, rng: np.random.Generator) -> Array:
    """A pose up to a distance from another one, turned up to 0.5 rad."""
    way, turn = rng.normal(size=(2, 3))
    way *= rng.uniform(0.05, most) / np.linalg.norm(way)
    turn *= rng.uniform(0.0, 0.5) / np.linalg.norm(turn)
    return se3.pose(se3.exp_so3(turn) @ T[:3, :3], T[:3, 3] + way)


class Drawn(NamedTuple):
    """A part that can be followed: its kind, what `Part` is given, its end, and whether a program ends exactly there."""

    kind: str
    goal: Any
    given: dict[str, Any]
    q: Array
    exact: bool


def draw_path(robot: Robot, q: Array, kind: str, rng: np.random.Generator) -> tuple[Any, Path]:
    """The goal of a part, and the path that it means from q."""
    T = robot.fk(q)
    if kind == "joint":
        goal = draw_near(robot, q, 0.8, rng)
        return goal, JointLine(robot, q, goal)
    if kind == "pose":
        goal = draw_near(robot, q, 0.5, rng)
        return robot.fk(goal), JointLine(robot, q, goal)
    if kind == "moves":
        chosen = PointToPoint(robot, q, *(draw_near(robot, q, 0.6, rng) for _ in range(3)))
        found = planners.plan(robot, chosen, q, limits=limits_of(robot))
        return found.path, found.path
    if kind == "vector":
        frame, way = str(rng.choice(["tool", "base"])), rng.normal(size=3)
        way *= rng.uniform(0.05, 0.25) / np.linalg.norm(way)
        end = T.copy()
        end[:3, 3] += T[:3, :3] @ way if frame == "tool" else way
        return Move(way, frame), Line(T, end)
    if kind == "polyline":
        poses = [T]
        while len(poses) < 3 or (len(poses) < 5 and rng.random() < 0.6):
            poses.append(draw_pose(poses[-1], 0.12, rng))
        path: Path = Polyline(np.array(poses), blend=2e-3, blend_rotation=0.02)
        return path, path
    end = draw_pose(T, 0.25, rng)
    if kind == "arc":
        path = Arc.through(T, 0.5 * (T[:3, 3] + end[:3, 3]) + 0.05 * rng.normal(size=3), end)
        return path, path
    line = Line(T, end)
    return (planners.free(line, turn=0.3), line) if kind == "free" else (end, line)


def draw_part(robot: Robot, q: Array, kind: str, rng: np.random.Generator) -> Drawn | None:
    """A part of a kind from q on; None if it cannot be followed alone."""
    try:
        goal, path = draw_path(robot, q, kind, rng)
        if path.end < 1e-2:
            return None
        given = None if path.in_joints else q
        found = planners.follow(get_solver(robot, "lm"), path, given, samples=SAMPLES, tolerance=FOLLOWING)
        if not found or (kind == "free" and not planners.plan(robot, goal, q, limits=limits_of(robot))):
            return None
    except (NoSolution, InvalidInput):
        return None
    assert found.joint_path is not None
    options = {"move": "joint"} if kind == "pose" else {}
    return Drawn(kind, goal, options, found.joint_path.q[-1], kind in ("joint", "moves"))


def allowed(drawn: Sequence[Drawn], free_at: int, kinds: Sequence[str]) -> list[str]:
    """The kinds that can follow: only joints after a free turn; spline moves, which have a start, only after joints."""
    if len(drawn) == free_at:
        return ["free"]
    if drawn and drawn[-1].kind == "free":
        return ["joint"]
    return [kind for kind in kinds if kind != "moves" or not drawn or drawn[-1].exact]


def draw_program(
    robot: Robot, count: int, rng: np.random.Generator, kinds: Sequence[str], free_at: int = -1
) -> tuple[Array, list[Drawn]]:
    """A start and parts, each of which can be followed from the end of the one before."""
    while True:
        start = q = draw_start(robot, rng)
        drawn: list[Drawn] = []
        for _ in range(TRIES * count):
            one = draw_part(robot, q, str(rng.choice(allowed(drawn, free_at, kinds))), rng)
            if one is not None:
                drawn.append(one)
                q = one.q
            if len(drawn) == count:
                return start, drawn


def make_parts(drawn: Sequence[Drawn], rng: np.random.Generator | None = None) -> list[Part]:
    """Parts without zones; with random numbers half of them have a tool speed."""
    speeds = [None if rng is None or rng.random() < 0.5 else float(rng.uniform(0.05, 0.5)) for _ in drawn]
    return [Part(one.goal, tool_speed=speed, **one.given) for one, speed in zip(drawn, speeds, strict=True)]


def with_zone(parts: Sequence[Part], zone: float) -> Program:
    """The program with one zone at all corners."""
    return Program([replace(part, blend=zone) for part in parts[:-1]] + [parts[-1]])


# ---------------------------------------------------------------- the oracle
def place_tool(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Position (k, 3) and rotation (k, 3, 3) of the tool, by the product of transforms."""
    R, p = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    for i, (F, slides) in enumerate(zip(robot.fixed, robot.prismatic, strict=True)):
        p, R = p + R @ F[:3, 3], (R.reshape(-1, 3) @ F[:3, :3]).reshape(-1, 3, 3)
        if slides:
            p = p + R[:, :, 2] * q[:, i, None]
            continue
        c, s = np.cos(q[:, i])[:, None], np.sin(q[:, i])[:, None]
        R = np.stack([c * R[:, :, 0] + s * R[:, :, 1], c * R[:, :, 1] - s * R[:, :, 0], R[:, :, 2]], axis=2)
    return p + R @ robot.tool[:3, 3], (R.reshape(-1, 3) @ robot.tool[:3, :3]).reshape(-1, 3, 3)


def evaluate(motion: planners.Trajectory, t: Array, order: int, left: bool = False) -> Array:
    """A derivative (k, n) of a motion from its coefficients; at a knot from the right, or from the left."""
    c, knots = motion.coefficients, motion.knots
    piece = np.clip(np.searchsorted(knots, t, side="left" if left else "right") - 1, 0, knots.size - 2)
    u, out = (t - knots[piece])[:, None], np.zeros((t.size, motion.n))
    degree = len(c) - 1
    for k in range(degree + 1 - order):
        factor = np.prod(np.arange(degree - k, degree - k - order, -1.0))
        out = out * u + factor * c[k][piece]
    return out


def sample_part(robot: Robot, path: Path, x: Array) -> tuple[Array, Array]:
    """Positions and rotations of a sharp part at places on it."""
    if path.in_joints:
        return place_tool(robot, np.asarray(path.configurations(robot, x)))
    T = path(x)
    return T[:, :3, 3], T[:, :3, :3]


def densely(robot: Robot, path: Path) -> Array:
    """Points (k, 3) of a part close together."""
    length = np.linalg.norm(np.diff(sample_part(robot, path, np.linspace(0.0, path.end, 200))[0], axis=0), axis=1).sum()
    count = int(length / SHARP_SPACING) + LEAST_SHARP
    return sample_part(robot, path, np.union1d(np.linspace(0.0, path.end, count), path.breaks))[0]


def distances(points: Array, pieces: Sequence[Array]) -> Array:
    """Distances of points from curves, one after another: from the chords beside the nearest points of all of them."""
    curve = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])  # each begins where the one before ends
    out = np.full(len(points), np.inf)
    for near in cKDTree(curve).query(points, k=NEAREST)[1].T:
        for step in (-1, 0):
            a = np.clip(near + step, 0, len(curve) - 2)
            way, off = curve[a + 1] - curve[a], points - curve[a]
            u = np.clip((off * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-300), 0.0, 1.0)
            out = np.minimum(out, np.linalg.norm(off - u[:, None] * way, axis=1))
    return out


def inside_corners(plan: ProgramPlan, s: Array, t: Array) -> Flags:
    """Which times are in a corner, or in an interval between knots that touches one."""
    k = np.clip(np.searchsorted(plan.trajectory.knots, t, side="right") - 1, 0, s.size - 2)
    return np.any([(s[k + 1] > c.begin) & (s[k] < c.end) for c in plan.corners], axis=0) if plan.corners else t < 0.0


def tool_excess(plan: ProgramPlan, zone: float, t: Array, p: Array) -> tuple[float, float, Array]:
    """Largest distance from the sharp parts over the zone in corners, elsewhere [m], and the part of each sample."""
    s = np.asarray(plan.certificate.s)
    part = np.searchsorted([one.end for one in plan.parts[:-1]], np.interp(t, plan.trajectory.knots, s))
    corner = inside_corners(plan, s, t)
    sharp = [densely(plan.robot, one.path) for one in plan.parts]
    ratio, rest = 0.0, 0.0
    for i in range(len(plan.parts)):
        mine = part == i
        far = distances(p[mine], sharp[max(i - 1, 0) : i + 2])
        ratio = max(ratio, float(far[corner[mine]].max(initial=0.0)) / (zone + TOLERANCE))
        rest = max(rest, float(far[~corner[mine]].max(initial=0.0)))
    return ratio, rest, part


def same_place_excess(plan: ProgramPlan, zone: float) -> float:
    """Largest distance and angle at the knots from the sharp parts at the same path parameter, over what is allowed."""
    t, s = plan.trajectory.knots, np.asarray(plan.certificate.s)
    p, R = place_tool(plan.robot, evaluate(plan.trajectory, t, 0))
    part = np.searchsorted([one.end for one in plan.parts[:-1]], s)
    allow = np.full((t.size, 2), TOLERANCE)
    for c in plan.corners:
        allow[(s >= c.begin) & (s <= c.end)] += np.minimum([zone, 10.0 * zone], c.deviation)
    worst = 0.0
    for i, one in enumerate(plan.parts):
        mine = part == i
        x = np.clip((s[mine] - one.begin) / (one.end - one.begin), 0.0, 1.0) * one.path.end
        there, turned = sample_part(plan.robot, one.path, x)
        cosine = 0.5 * (np.einsum("kij,kij->k", R[mine], turned) - 1.0)
        sine = np.linalg.norm(R[mine] - turned, axis=(1, 2)) / np.sqrt(8.0)
        angle = np.where(cosine > 0.9, 2.0 * np.arcsin(np.minimum(sine, 1.0)), np.arccos(np.clip(cosine, -1.0, 1.0)))
        off = np.stack([np.linalg.norm(p[mine] - there, axis=1), angle], axis=1)
        worst = max(worst, float((off / allow[mine]).max(initial=0.0)))
    return worst


def speed_ratio(parts: Sequence[Part], part: Array, t: Array, p: Array) -> float:
    """Largest speed of the tool over the limit of its part, by differences of its positions."""
    speed, limit = (
        np.linalg.norm(np.diff(p, axis=0), axis=1) / np.diff(t),
        np.array([x.tool_speed or np.inf for x in parts]),
    )
    same = part[1:] == part[:-1]
    return float((speed / limit[part[1:]])[same].max(initial=0.0))


def rate_error(motion: planners.Trajectory, rng: np.random.Generator) -> float:
    """Largest difference of velocities, accelerations and jerks from central differences, over the limits' size."""
    h, worst = 1e-5, 0.0
    t = rng.uniform(h, motion.duration - h, 500)
    inside = np.searchsorted(motion.knots, t - h) == np.searchsorted(motion.knots, t + h)
    for order, size in ((1, 1.0), (2, 10.0), (3, 100.0)):
        at = t if order < 3 else t[inside]
        slope = (evaluate(motion, at + h, order - 1) - evaluate(motion, at - h, order - 1)) / (2.0 * h)
        worst = max(worst, float(np.abs(slope - evaluate(motion, at, order)).max(initial=0.0)) / size)
    return worst


def judge_motion(plan: ProgramPlan, parts: Sequence[Part], zone: float, rng: np.random.Generator) -> Row:
    """What the oracle finds on a motion."""
    motion, robot = plan.trajectory, plan.robot
    rate = RATE if motion.duration < LONG else LOW_RATE
    t = np.union1d(np.arange(0.0, motion.duration, 1.0 / rate), motion.knots)
    q = evaluate(motion, t, 0)
    p, _ = place_tool(robot, q)
    limits, knots = limits_of(robot), motion.knots
    ratios = []
    for order, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        both = np.concatenate([evaluate(motion, t, order), evaluate(motion, knots, order, left=True)])
        ratios.append(float((np.abs(both) / np.asarray(limit)).max()))
    corner, rest, part = tool_excess(plan, zone, t, p)
    jumps = [np.abs(evaluate(motion, knots, k) - evaluate(motion, knots, k, left=True))[1:-1].max() for k in (0, 1)]
    still = np.array([x for times in plan.times for x in (times.begin, times.rest, times.end)])
    stops = max(np.abs(evaluate(motion, still, 1, left=left)).max() for left in (False, True))
    return {
        "ratios": ratios, "range": float(np.maximum(robot.limits.lower - q, q - robot.limits.upper).max()),
        "corner": corner, "elsewhere": rest, "same_place": same_place_excess(plan, zone),
        "speed": speed_ratio(parts, part, t, p), "jumps": [float(x) for x in jumps], "stops": float(stops),
        "rates": rate_error(motion, rng), "goals": goal_error(plan, parts),
    }  # fmt: skip


def goal_error(plan: ProgramPlan, parts: Sequence[Part]) -> float:
    """Largest difference of the end of a part from its goal [m, rad], and of the end of the motion from the last part's."""
    worst, robot = 0.0, plan.robot
    for part, record in zip(parts, plan.parts, strict=True):
        if not isinstance(part.goal, np.ndarray):
            continue
        if part.goal.ndim == 1:
            off = np.asarray(record.path.configurations(robot, np.array([record.path.end])))[0] - part.goal
        else:
            p, R = sample_part(robot, record.path, np.array([record.path.end]))
            off = np.append(p[0] - part.goal[:3, 3], R[0] - part.goal[:3, :3])
        worst = max(worst, float(np.abs(off).max()))
    end, last = place_tool(robot, evaluate(plan.trajectory, plan.trajectory.knots[-1:], 0))[0][0], plan.parts[-1].path
    return max(worst, float(np.abs(end - sample_part(robot, last, np.array([last.end]))[0][0]).max()))


def survives_file(plan: ProgramPlan) -> bool:
    """Whether the certificate is valid again after the motion was written and read."""
    with tempfile.TemporaryDirectory() as folder:
        file = FilePath(folder) / "program.json"
        planners.save(plan, file)
        read = planners.load_motion(file)
    return bool(read.certify().is_valid and np.array_equal(read.trajectory.coefficients, plan.trajectory.coefficients))


def refused_truly(plan: ProgramPlan, robot: Robot, start: Array, parts: Sequence[Part]) -> bool:
    """Whether the refused part fails too as a program of its own, from where the program without it ends."""
    assert plan.failure is not None
    k = plan.failure.part
    if k is None or not plan.failure.reason.startswith(f"part {k + 1} "):
        return False
    before = planners.plan(robot, Program(parts[:k]), start, limits=limits_of(robot)) if k else None
    if before is not None and not before:
        return False
    q = start if before is None else evaluate(before.trajectory, before.trajectory.knots[-1:], 0)[0]
    try:
        return not planners.plan(robot, Program([parts[k]]), q, limits=limits_of(robot))
    except OptikError:
        return True


# ---------------------------------------------------------------- cases
def measure(case: int) -> Row:
    if case < len(LENGTHS):
        return measure_cost(LENGTHS[case])
    case -= len(LENGTHS)
    return measure_pick(case) if case < PICKS else measure_program(case - PICKS)


def measure_cost(count: int) -> Row:
    """CPU milliseconds a part of a program on ur5e with zones of 10 mm, the best of three."""
    robot, rng = arm("ur5e"), np.random.default_rng([SEED, 1, count])
    start, drawn = draw_program(robot, count, rng, MIX)
    program, best = with_zone(make_parts(drawn), 1e-2), np.inf
    for _ in range(3):
        begin = process_time()
        found = planners.plan(robot, program, start, limits=limits_of(robot))
        best = min(best, process_time() - begin)
    return {"kind": "cost", "parts": count, "ms": 1e3 * best / count, "valid": bool(found)}


def measure_pick(case: int) -> Row:
    """Home, above and down; up, across, above and down; up and home: the duration over that with a stop at every part."""
    robot = arm(("ur5e", "panda")[case % 2])
    for step in range(1000):
        rng = np.random.default_rng([SEED, 2, case, step])
        home = draw_start(robot, rng)
        first = se3.pose(robot.fk(home)[:3, :3], robot.fk(home)[:3, 3] + rng.uniform(-1.0, 1.0, 3) * [0.2, 0.2, 0.03])
        second = se3.pose(first[:3, :3], first[:3, 3] + rng.uniform(-1.0, 1.0, 3) * [0.3, 0.3, 0.03])
        down, up = Part(Move((0.0, 0.0, -0.1), "base")), Part(Move((0.0, 0.0, 0.1), "base"))
        parts = [Part(first, move="joint"), down, up, Part(second, move="joint"), down, up, Part(home)]
        try:
            stops = planners.plan(robot, Program(parts), home, limits=limits_of(robot))
        except OptikError:
            continue
        turned = max(
            (np.abs(p.path.q_goal - p.path.q_start).max() for p in stops.parts if isinstance(p.path, JointLine)),
            default=9,
        )
        if stops and turned < 2.5:
            break
    row: Row = {"kind": "pick", "arm": robot.name}
    for zone in ASKED_PICK:
        blend = [zone, 0.0, zone, zone, 0.0, zone, 0.0]
        program = Program([replace(part, blend=x) for part, x in zip(parts, blend, strict=True)])
        found = planners.plan(robot, program, home, limits=limits_of(robot))
        row[str(zone)] = found.duration / stops.duration if found else None
    return row


def case_program(case: int) -> tuple[Robot, Array, list[Part], bool]:
    """The arm, the start and the parts of a case, and whether parts have tool speeds."""
    rng = np.random.default_rng([SEED, 0, case])
    robot, count = arm(ARMS[case % len(ARMS)]), int(np.exp(rng.uniform(np.log(1.5), np.log(40.5))) + 0.5)
    count, limited = max(count, 2), rng.random() < 1.0 / LIMITED_IN
    free_at = int(rng.integers(count - 1)) if rng.random() < 1.0 / FREE_IN else -1
    start, drawn = draw_program(robot, count, rng, KINDS, free_at)
    return robot, start, make_parts(drawn, rng if limited else None), limited


def measure_program(case: int) -> Row:
    """A program at each zone, and with stops."""
    robot, start, parts, limited = case_program(case)
    row: Row = {"kind": "program", "arm": robot.name, "parts": len(parts), "limited": limited, "zones": {}}
    for zone in (0.0, *ZONES):
        begin = process_time()
        try:
            found = planners.plan(robot, with_zone(parts, zone), start, limits=limits_of(robot))
            row["zones"][str(zone)] = each = {"status": str(found.status), "cpu": process_time() - begin}
            if not found:
                each |= {"reason": found.failure.reason, "true": refused_truly(found, robot, start, parts)}
                continue
            each |= {"duration": found.duration} | judge_motion(found, parts, zone, np.random.default_rng(case))
            each["reduced"] = sum(bool(c.reduced) for c in found.corners)
            each["stopped"] = sum(bool(c.begin == c.end) for c in found.corners)
            if zone == ZONES[case % len(ZONES)]:
                each["file"] = survives_file(found)
        except Exception as error:  # each counts as a defect
            row["zones"][str(zone)] = {"status": "exception", "reason": repr(error)[:300]}
    return row


# ---------------------------------------------------------------- the figures
def judge(rows: list[Row]) -> list[Value]:
    programs = [row for row in rows if row["kind"] == "program"]
    each = [(row, float(zone), one) for row in programs for zone, one in row["zones"].items()]
    return [
        *judge_cost([row for row in rows if row["kind"] == "cost"]),
        *judge_pick([row for row in rows if row["kind"] == "pick"]),
        *judge_answers(each), *judge_oracle([(row, zone, one) for row, zone, one in each if "duration" in one]),
        *judge_durations(programs),
    ]  # fmt: skip


def judge_cost(rows: list[Row]) -> Iterator[Value]:
    ms = [row["ms"] for row in rows]
    text = ", ".join(f"{row['ms']:.1f} ({row['parts']})" for row in rows)
    yield Value("CPU a part, ur5e, 10 mm [ms]", "≤ 15", text, bool(ms) and max(ms) <= 15.0)
    yield Value("longest over shortest of these", "≤ 1.2", f"{max(ms) / min(ms):.2f}", max(ms) <= 1.2 * min(ms))


def judge_pick(rows: list[Row]) -> Iterator[Value]:
    for zone, asked in ASKED_PICK.items():
        for name in sorted({row["arm"] for row in rows}):
            got = [row[str(zone)] for row in rows if row["arm"] == name]
            middle = float(np.median([x for x in got if x is not None]))
            text = f"{middle:.3f}, {sum(x is not None for x in got)} of {len(got)} certified"
            what = f"pick and place, {name}, {1e3 * zone:g} mm: T over stops"
            yield Value(what, f"≤ {asked}", text, middle <= asked and None not in got)


def judge_answers(each: list[tuple[Row, float, Row]]) -> Iterator[Value]:
    bad = [(row, zone, one) for row, zone, one in each if one["status"] != "solved"]
    for row, zone, one in bad:
        print(
            f"  case {row['case']}, {row['arm']}, {row['parts']} parts, {1e3 * zone:g} mm: {one['status']}: {one['reason']}"
        )
    thrown, solved = [one for *_, one in bad if one["status"] == "exception"], len(each) - len(bad)
    yield Value("exceptions", "0", f"{len(thrown)} of {len(each)}", not thrown)
    share = solved / max(len(each), 1)
    yield Value("certified", "≥ 99 %", f"{solved} of {len(each)} ({100 * share:.1f} %)", share >= 0.99)
    untrue = [one for *_, one in bad if not one.get("true")]
    yield Value("refusals that are not true, or not by part", "0", f"{len(untrue)} of {len(bad)}", not untrue)


def judge_oracle(good: list[tuple[Row, float, Row]]) -> Iterator[Value]:
    asked: dict[str, tuple[str, float]] = {
        "corner": ("largest distance in corners over zone + tolerance", 1.0),
        "elsewhere": ("largest distance elsewhere [m]", 1e-5),
        "same_place": ("distance and angle at the same s over what was proved", 1.0),
        "speed": ("tool speed over its part's limit", 1.0 + ROUNDING),
        "range": ("joints beyond their ranges [rad, m]", 1e-9),
        "stops": ("velocity at stops [rad/s]", 1e-9),
        "rates": ("derivatives against differences, relative", 1e-3),
        "goals": ("ends of parts from their goals [m, rad]", 1e-6),
    }
    for i, name in enumerate(("velocity", "acceleration", "jerk")):
        yield largest(good, f"{name} over its limit", 1.0 + ROUNDING, lambda one, i=i: one["ratios"][i])
    for i, name in enumerate(("position", "velocity")):
        yield largest(good, f"jump of the {name} [rad, rad/s]", (1e-9, 1e-8)[i], lambda one, i=i: one["jumps"][i])
    for key, (what, most) in asked.items():
        yield largest(good, what, most, lambda one, key=key: one[key])
    files = [one["file"] for *_, one in good if "file" in one]
    yield Value("valid again from a file", "all", f"{sum(files)} of {len(files)}", all(files))


def largest(good: list[tuple[Row, float, Row]], what: str, most: float, of: Any) -> Value:
    """The largest of a quantity, and where it was."""
    row, zone, one = max(good, key=lambda each: of(each[2]))
    text = f"{of(one):.9g} (case {row['case']}, {row['arm']}, {1e3 * zone:g} mm)"
    return Value(what, f"≤ {most:.9g}", text, of(one) <= most)


def judge_durations(programs: list[Row]) -> Iterator[Value]:
    for zone, asked in zip(ZONES, ASKED, strict=True):
        ratio: dict[bool, list[float]] = {False: [], True: []}
        for row in programs:
            one, stops = row["zones"][str(zone)], row["zones"]["0.0"]
            if "duration" in one and "duration" in stops:
                ratio[row["limited"]].append(one["duration"] / stops["duration"])
        yield from judge_zone(zone, asked, np.array(ratio[False]), np.array(ratio[True]))
        ms = [
            1e3 * row["zones"][str(zone)]["cpu"] / row["parts"] for row in programs if "cpu" in row["zones"][str(zone)]
        ]
        print(f"  {1e3 * zone:g} mm: CPU a part {np.median(ms):.1f} ms, most {max(ms):.0f} ms")


def judge_zone(zone: float, asked: float, free: Array, limited: Array) -> Iterator[Value]:
    """Durations over those with stops; in a corner the lesser of two tool speeds holds, so that such programs are longer."""
    what, middle = f"{1e3 * zone:g} mm", float(np.median(free))
    yield Value(f"{what}: median of T over stops", f"≤ {asked}", f"{middle:.3f}", middle <= asked)
    for ratio, words in ((free, "longer than stops"), (limited, "longer than stops, parts with tool speeds")):
        longer = ratio[ratio > 1.0 + 1e-9]
        share, most = longer.size / max(ratio.size, 1), float(longer.max(initial=1.0))
        narrow = zone == ZONES[0]
        fine = (share <= 0.005 and most <= 1.01) if narrow else not longer.size
        text = f"{longer.size} of {ratio.size}, by {most - 1:.2%}; median {np.median(ratio):.3f}"
        yield Value(f"{what}: {words}", "≤ 0.5 %, by ≤ 1 %" if narrow else "0", text, fine)


if __name__ == "__main__":
    main("programs", measure, len(LENGTHS) + PICKS + PROGRAMS, judge)
