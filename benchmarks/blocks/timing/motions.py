"""Motions to time: lines, arcs, seams and joint moves, sampled so that an arm can follow them, and paths from a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from zlib import crc32

import numpy as np

from benchmarks.blocks.entries import arm_label, arm_with
from benchmarks.blocks.timing.settings import GIVEN_LINE, LINE_KINDS, MOTION_KINDS, LimitSet, LineSet
from benchmarks.problems.base import start_of
from benchmarks.problems.tables import read_poses
from optik import se3
from optik.arm.robot import Robot
from optik.check import check_count
from optik.dynamics import torques_batch
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, read_bytes
from optik.ik import make_solver
from optik.registry import short_name
from optik.types import Array, Flags
from planners import load_motion
from planners.following.follow import follow
from planners.limits import sides
from planners.paths.arc import Arc
from planners.paths.base import Path
from planners.paths.joint_line import JointLine
from planners.paths.line import Line
from planners.paths.polyline import Polyline

STATIC_SHARE = 0.95
"""Largest fraction of a torque limit for gravity and Coulomb friction at rest: with all of it no motion could start. The margin
also covers positions between the steps of a track, and the other configurations of a redundant arm."""

Stands = Callable[[Array], Flags]
"""Function from configurations (k, n) to whether the motors can hold the arm there."""


def stands_of(arm: Robot, limits: Sequence[LimitSet]) -> Stands | None:
    """Return a test for configurations where gravity and Coulomb friction take at most `STATIC_SHARE` of every torque limit."""
    bounds = [sides(part.of(arm).bounds(arm.n)["torque"]) for part in limits if part.counts_torque]
    if not bounds:
        return None
    lower = STATIC_SHARE * np.max([bound[0] for bound in bounds], axis=0)
    upper = STATIC_SHARE * np.min([bound[1] for bound in bounds], axis=0)
    loads = arm.loads

    def stands(q: Array) -> Flags:
        states = np.zeros((len(q), 4, arm.n))
        states[:, 0] = q
        torque, found = np.empty((len(q), 2, arm.n)), np.ones(len(q), dtype=bool)
        for load_ in loads:
            torques_batch(arm.chain, load_.bodies, load_.viscous, states, torque)
            still, friction = torque[:, 0], load_.coulomb
            found &= ((still - friction >= lower) & (still + friction <= upper)).all(axis=1)
        return found

    return stands


LINE_LENGTHS = (0.05, 0.4)
"""Shortest and longest line [m]."""

LINE_TURNS = (0.05, 0.5)
"""Range of the rotation angle [rad] of the tool on every other line; its orientation is constant on the others."""

ARC_RADII, ARC_ANGLES = (0.03, 0.15), (0.5, 3.0)
"""Ranges of the radius [m] and of the angle [rad] of an arc."""

SEAM_CORNERS, SEAM_SEGMENTS, SEAM_BENDS = (2, 5), (0.04, 0.12), (0.2, 1.4)
"""Least and one more than the largest number of inner waypoints of a seam, ranges of its segments' length [m] and of the angle
between neighbours [rad]: it never reverses, because a blend cannot."""

SEAM_TURN = 0.2
"""Rotation angle [rad] of the tool on each segment of every other seam."""

SEAM_BLEND, SEAM_BLEND_ROTATION = 2e-3, 2e-2
"""Largest distance [m] and rotation [rad] between the blended path and a seam's waypoints."""

LIMIT_MARGIN = 0.02
"""Least distance to the joint limits along the whole line [rad or m], so that no round-off ends a line early."""

TRACK_STEPS = 120
"""Steps of the track; the fastest joint of the hardest line moves about 0.1 rad in one."""

TRACK_TOLERANCE = 1e-9
"""Error that Newton's method must reach at every step [m and rad]."""

NEWTON_STEPS = 4
"""Iterations of Newton's method at every step of the track: its initial guess is near, and it converges quadratically."""

TRACK_DAMPING = 1e-14
"""Added to J Jᵀ, so that a singular J raises no error; the residual excludes such a track."""

CANDIDATES = 8
"""Lines tracked side by side."""

MOST_DRAWS = 100_000
"""Number of samples after which an arm counts as one without such a line."""


@dataclass(frozen=True)
class DrawnLine:
    """A motion to time: its path, and the start configuration inside the limits [rad, m]."""

    robot: Robot
    kind: str  # as `draw_motion` calls it
    index: int  # which one of its kind
    q_start: Array
    path: Path
    singular_value: float  # smallest one of the Jacobian along the track by which the path was chosen
    draws: int  # how many paths were sampled until one could be followed and was of its kind
    arm: str  # name in reports


def tracked(robot: Robot, q: Array, poses: Array, low: float, stands: Stands | None = None) -> Array:
    """Return the smallest singular value along tracks of the tool; NaN where a track leaves the limits."""
    q = q.copy()
    lower, upper = robot.limits.lower + LIMIT_MARGIN, robot.limits.upper - LIMIT_MARGIN
    least = robot.singular_values(q)[:, -1]
    if stands is not None:
        least[~stands(q)] = np.nan
    for step in range(1, TRACK_STEPS + 1):
        alive = np.flatnonzero(least >= low)  # a track below `low` is followed no further, and keeps its value
        if not alive.size:
            break
        moved = _newton(robot, q[alive], poses[alive, step])
        inside = ((moved >= lower) & (moved <= upper)).all(axis=1)
        inside &= np.abs(robot.pose_errors(moved, poses[alive, step])).max(axis=1) <= TRACK_TOLERANCE
        if stands is not None:
            inside &= stands(moved)
        q[alive] = np.where(inside[:, None], moved, q[alive])
        least[alive] = np.where(inside, np.fmin(least[alive], robot.singular_values(q[alive])[:, -1]), np.nan)
    return least


def _newton(robot: Robot, q: Array, poses: Array) -> Array:
    """Return configurations (k, n) at poses (k, 4, 4) near q, each step the least joint motion: Jᵀ (J Jᵀ)⁻¹ e."""
    for _ in range(NEWTON_STEPS):
        J = robot.jacobian(q)
        transposed = J.transpose(0, 2, 1)
        normal = J @ transposed + TRACK_DAMPING * np.eye(6)
        q = q + (transposed @ np.linalg.solve(normal, robot.pose_errors(q, poses)[..., None]))[..., 0]
    return q


def motion_of(part: LineSet, index: int, seed: int, limits: Sequence[LimitSet] = ()) -> DrawnLine:
    """Return one motion of a set: sampled, the given line, or that of a file."""
    if part.kind != GIVEN_LINE:
        payload = part.payload
        return draw_motion(part.robot, part.kind, index, seed=seed, path=part.path, payload=payload, limits=limits)
    arm = part.load()
    q = start_of(arm, part.start_deg)
    start = arm.fk(q)
    line = Line(start, se3.pose(start[:3, :3], start[:3, 3] + part.move_m))
    if not line.end:
        raise InvalidInput("move_m", part.move_m, "a motion")
    return DrawnLine(arm, part.label, 0, q, line, float(arm.singular_values(q[None])[0, -1]), 1, part.arm)


def draw_motion(
    robot: str, kind: str, index: int, *, seed: int = 0, path: str = "",
    payload: float | tuple[float, float] | None = None, limits: Sequence[LimitSet] = (),
) -> DrawnLine:  # fmt: skip
    """Sample one motion, the same for the same robot, kind, index and seed, or read it from a file.

    Lines, arcs and seams start at a configuration uniform inside the limits, and turn the tool where the index is odd. They
    are drawn again until the arm can follow the whole path with `LIMIT_MARGIN` to its limits, and the smallest singular value
    is that of the kind, of arcs and seams at least 0.05. A path counts as followed where Newton's method on the pose converges
    at many small steps of least joint motion. That needs no planner, so the set stays the same when planners change. Joint
    moves are straight in joint space between two random configurations. Where torque is limited, all are drawn again until the
    arm, with its payload, can stand everywhere on the path.
    """
    if kind == "file":
        return motion_in_file(robot, path, payload)
    if kind not in MOTION_KINDS:
        raise InvalidInput("kind", repr(kind), f"one of {', '.join(MOTION_KINDS)}")
    return draw_motion_of(arm_with(robot, payload), robot, kind, index, seed, limits, arm_label(robot, payload))


def draw_motion_of(
    arm: Robot, robot: str, kind: str, index: int, seed: int, limits: Sequence[LimitSet] = (), label: str = ""
) -> DrawnLine:
    """Sample one motion of an arm that has its payload and its tool; `robot` is its name, which the seed depends on."""
    check_count(index, "index", 0)
    check_count(seed, "seed", 0)
    stands = stands_of(arm, limits)
    rng = np.random.default_rng((seed, crc32(short_name(robot).encode()), crc32(kind.encode()), index))
    q_start, drawn, sigma, draws = (_joints if kind == "joints" else _tracked)(arm, kind, index, rng, stands)
    return DrawnLine(arm, kind, index, q_start, drawn, sigma, draws, label)


def _joints(
    arm: Robot, kind: str, index: int, rng: np.random.Generator, stands: Stands | None
) -> tuple[Array, Path, float, int]:
    """Return a straight move in joint space on which the arm can rest: start, path, smallest singular value, samples."""
    for draws in range(1, MOST_DRAWS + 1):
        q = arm.limits.sample(rng, 2, margin=LIMIT_MARGIN)
        along = q[0] + np.linspace(0.0, 1.0, TRACK_STEPS + 1)[:, None] * (q[1] - q[0])
        if stands is None or stands(along).all():
            return q[0], JointLine(arm, q[0], q[1]), float(arm.singular_values(along)[:, -1].min()), draws
    raise _none(arm, kind)


def _tracked(
    arm: Robot, kind: str, index: int, rng: np.random.Generator, stands: Stands | None
) -> tuple[Array, Path, float, int]:
    """Return a tool path that an independent tracker follows completely: start, path, smallest singular value, samples."""
    low, high = LINE_KINDS.get(kind, LINE_KINDS["regular"])
    turns = index % 2 == 1
    for draws in range(0, MOST_DRAWS, CANDIDATES):
        starts = arm.limits.sample(rng, CANDIDATES, margin=LIMIT_MARGIN)
        at = arm.fk(starts)
        if kind in LINE_KINDS:
            paths = _lines(at, rng, turns)
        else:
            paths = [_arc(T, rng, turns) if kind == "arc" else _seam(T, rng, turns) for T in at]
        poses = np.stack([path(np.linspace(0.0, path.end, TRACK_STEPS + 1)) for path in paths])
        singular_values = tracked(arm, starts, poses, low, stands)
        good = np.flatnonzero((singular_values >= low) & (singular_values <= high))
        if good.size:
            i = int(good[0])
            return starts[i], paths[i], float(singular_values[i]), draws + i + 1
    raise _none(arm, kind)


def _none(arm: Robot, kind: str) -> InvalidInput:
    """Return the error for an arm without such a path."""
    wanted = "an arm that can follow such paths, and a payload that it can hold"
    return InvalidInput("kind", f"{kind} on {arm.name}: no path in {MOST_DRAWS:,} draws", wanted)


def _lines(starts: Array, rng: np.random.Generator, turns: bool) -> list[Path]:
    """Return random straight lines from poses (k, 4, 4): uniform direction, a length, and an angle about a random axis."""
    move, axis = rng.normal(size=(2, CANDIDATES, 3))
    length, angle = rng.uniform(*LINE_LENGTHS, CANDIDATES), rng.uniform(*LINE_TURNS, CANDIDATES)
    goals = starts.copy()
    goals[:, :3, 3] += (length / np.linalg.norm(move, axis=1))[:, None] * move
    if turns:
        w = (angle / np.linalg.norm(axis, axis=1))[:, None] * axis
        goals[:, :3, :3] = np.stack([se3.exp_so3(turn) for turn in w]) @ goals[:, :3, :3]
    return [Line(start, goal) for start, goal in zip(starts, goals, strict=True)]


def _arc(T: Array, rng: np.random.Generator, turns: bool) -> Path:
    """Return an arc from the pose T (4, 4) about a random axis."""
    axis, across = rng.normal(size=(2, 3))
    radius, angle = rng.uniform(*ARC_RADII), rng.uniform(*ARC_ANGLES)
    outward = np.cross(axis, across)
    centre = T[:3, 3] - radius * outward / np.linalg.norm(outward)
    return Arc.about(T, centre, axis, angle, orientation="arc" if turns else "fixed")


def _seam(T: Array, rng: np.random.Generator, turns: bool) -> Path:
    """Return a polyline from the pose T (4, 4) through some waypoints; each segment turns away from the previous one."""
    way, waypoints = rng.normal(size=3), [T]
    way /= np.linalg.norm(way)
    for _ in range(int(rng.integers(*SEAM_CORNERS)) + 1):
        last = waypoints[-1].copy()
        last[:3, 3] += rng.uniform(*SEAM_SEGMENTS) * way
        axis, other = rng.normal(size=(2, 3))
        if turns:
            last[:3, :3] = se3.exp_so3(SEAM_TURN * axis / np.linalg.norm(axis)) @ last[:3, :3]
        waypoints.append(last)
        bend = np.cross(way, other)
        way = se3.exp_so3(rng.uniform(*SEAM_BENDS) * bend / np.linalg.norm(bend)) @ way
    return Polyline(np.array(waypoints), blend=SEAM_BLEND, blend_rotation=SEAM_BLEND_ROTATION)


# ---------------------------------------------------------------- files


def motion_in_file(robot: str, path: str, payload: float | tuple[float, float] | None = None) -> DrawnLine:
    """Read the path of a motion from a file: waypoints of a seam, or a motion saved by `planners.save`.

    Waypoints are a table as of problem sets (`benchmarks.problems.file`): CSV or NPZ. A start in its first row is where the
    arm starts; without one it is the best branch that follows the whole path. Of a motion, path and start are taken.
    """
    arm, file = arm_with(robot, payload), FilePath(path)
    tool_path, q = path_in_file(arm, file)
    followed = follow(make_solver(arm, "lm"), tool_path, q)
    joints = followed.joint_path
    if followed.failure is not None or joints is None:
        reason = followed.failure.reason if followed.failure is not None else "no joint path"
        raise InvalidInput(path, f"a path that {arm.name} cannot follow: {reason}", "a path inside its workspace")
    start = joints(np.zeros(1))[0] if q is None else q
    sigma = float(joints.singular_values.min())
    return DrawnLine(arm, file.name, 0, start, tool_path, sigma, 1, arm_label(robot, payload))


def path_in_file(arm: Robot, file: FilePath) -> tuple[Path, Array | None]:
    """Read the path of a motion from a file, as `motion_in_file` does, without following it."""
    return (_waypoints if _holds_waypoints(file) else _saved)(arm, file)


def _holds_waypoints(file: FilePath) -> bool:
    """Return whether a file is a table of poses, and not a saved motion."""
    suffix = check_suffix(file, (".csv", ".npz", ".json"))
    if suffix == ".csv":
        lines = decode_text(read_bytes(file)).splitlines()
        header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
        return "x_m" in header.replace(",", " ").split()
    if suffix == ".npz":
        try:
            with np.load(file, allow_pickle=False) as arrays:
                return "targets" in arrays.files
        except (OSError, ValueError) as error:
            raise InvalidInput(str(file), str(error)[:120], "a file of waypoints or a motion") from None
    return False


def _waypoints(arm: Robot, file: FilePath) -> tuple[Path, Array | None]:
    """Return the path through the waypoints of a table, and the start in its first row."""
    poses = read_poses(file, arm)
    if len(poses.targets) < 2:
        raise InvalidInput(str(file), "one row", "two waypoints or more")
    path = Polyline(poses.targets, blend=SEAM_BLEND, blend_rotation=SEAM_BLEND_ROTATION)
    return path, None if poses.starts is None else poses.starts[0]


def _saved(arm: Robot, file: FilePath) -> tuple[Path, Array | None]:
    """Return path and start of a motion saved by `planners.save`."""
    motion = load_motion(file)
    theirs = motion.robot if arm.payload is None else replace(motion.robot, payload=arm.payload)
    if theirs != arm:
        raise InvalidInput(str(file), f"a motion of {motion.robot.name}", f"one of this {arm.name}")
    return motion.path, motion.trajectory(np.zeros(1))[0]
