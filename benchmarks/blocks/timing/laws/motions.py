"""Other motions to time than straight lines: arcs, seams and joint moves, drawn, and paths from a user's own file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from benchmarks.blocks._arms import arm_label, arm_with
from benchmarks.blocks.timing.laws.arms import Stands, stands_of
from benchmarks.blocks.timing.laws.lines import (
    LIMIT_MARGIN,
    LINE_KINDS,
    MOST_DRAWS,
    TRACK_STEPS,
    DrawnLine,
    draw_line,
    tracked,
)
from benchmarks.problems._tables import read_poses
from optik import se3
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, read_bytes
from optik.ik import make_solver
from optik.registry import short_name
from optik.types import Array
from planners import load_motion
from planners.following.follow import follow
from planners.paths.arc import Arc
from planners.paths.base import Path
from planners.paths.joint_line import JointLine
from planners.paths.polyline import Polyline

if TYPE_CHECKING:
    from benchmarks.blocks.timing.laws.sets import LimitSet

ARC_RADII, ARC_ANGLES = (0.03, 0.15), (0.5, 3.0)
"""Ranges of the radius [m] and of the angle [rad] of an arc."""

SEAM_CORNERS, SEAM_SEGMENTS, SEAM_BENDS = (2, 5), (0.04, 0.12), (0.2, 1.4)
"""Least and one more than the largest number of inner waypoints of a seam, ranges of its segments' length [m] and of the
angle between neighbours [rad]: never back the way it came, which no blend can pass."""

SEAM_TURN = 0.2
"""Angle [rad] that the tool turns through on each segment of every other seam."""

SEAM_BLEND, SEAM_BLEND_ROTATION = 2e-3, 2e-2
"""Largest distance [m] and rotation [rad] between the blended path and a seam's waypoints."""

TRACKED_AT_ONCE = 8
"""Candidates tracked side by side, as of lines."""

MOTION_KINDS = (*LINE_KINDS, "arc", "seam", "joints", "file")
"""All kinds of motions: straight lines of two kinds, other drawn ones, and those of a file."""


def draw_motion(
    robot: str,
    kind: str,
    index: int,
    *,
    seed: int = 0,
    path: str = "",
    payload: float | tuple[float, float] | None = None,
    limits: Sequence[LimitSet] = (),
) -> DrawnLine:
    """Draw one motion, the same for the same robot, kind, index and seed, or read it from a file.

    Arcs and seams are drawn as lines are (`draw_line`): again until an independent tracker follows the whole path with a
    margin to the joint limits and a smallest singular value of at least 0.05. Joint moves are straight in joint space between
    two random configurations. Where torque is limited, all are drawn again until the arm, with its payload, can stand
    everywhere on the path.
    """
    if kind in LINE_KINDS:
        return draw_line(robot, kind, index, seed=seed, payload=payload, limits=limits)
    if kind == "file":
        return motion_in_file(robot, path, payload)
    if kind not in MOTION_KINDS:
        raise InvalidInput("kind", repr(kind), f"one of {', '.join(MOTION_KINDS)}")
    check_count(index, "index", 0)
    check_count(seed, "seed", 0)
    arm, name = arm_with(robot, payload), arm_label(robot, payload)
    stands = stands_of(arm, limits)
    rng = np.random.default_rng((seed, crc32(short_name(robot).encode()), crc32(kind.encode()), index))
    q_start, drawn, sigma, draws = (_joints if kind == "joints" else _tracked)(arm, kind, index, rng, stands)
    return DrawnLine(arm, kind, index, q_start, drawn, sigma, draws, name)


def _joints(
    arm: Robot, kind: str, index: int, rng: np.random.Generator, stands: Stands | None
) -> tuple[Array, Path, float, int]:
    """A straight move in joint space on which the arm can stand: start, path, smallest singular value, draws."""
    for draws in range(1, MOST_DRAWS + 1):
        q = arm.limits.sample(rng, 2, margin=LIMIT_MARGIN)
        along = q[0] + np.linspace(0.0, 1.0, TRACK_STEPS + 1)[:, None] * (q[1] - q[0])
        if stands is None or stands(along).all():
            return q[0], JointLine(arm, q[0], q[1]), float(arm.singular_values(along)[:, -1].min()), draws
    raise _none(arm, kind)


def _tracked(
    arm: Robot, kind: str, index: int, rng: np.random.Generator, stands: Stands | None
) -> tuple[Array, Path, float, int]:
    """An arc or a seam that an independent tracker follows whole: start, path, smallest singular value, draws."""
    build = _arc if kind == "arc" else _seam
    for draws in range(0, MOST_DRAWS, TRACKED_AT_ONCE):
        starts = arm.limits.sample(rng, TRACKED_AT_ONCE, margin=LIMIT_MARGIN)
        paths = [build(T, rng, index % 2 == 1) for T in arm.fk(starts)]
        poses = np.stack([one(np.linspace(0.0, one.end, TRACK_STEPS + 1)) for one in paths])
        low, _ = LINE_KINDS["regular"]
        singular_values = tracked(arm, starts, poses, low, stands)
        good = np.flatnonzero(singular_values >= low)
        if good.size:
            i = int(good[0])
            return starts[i], paths[i], float(singular_values[i]), draws + i + 1
    raise _none(arm, kind)


def _none(arm: Robot, kind: str) -> InvalidInput:
    """The error for an arm that has no such path."""
    wanted = "an arm that can follow such paths, and a payload that it can hold"
    return InvalidInput("kind", f"{kind} on {arm.name}: no path in {MOST_DRAWS:,} draws", wanted)


def _arc(T: Array, rng: np.random.Generator, turns: bool) -> Path:
    """An arc from the pose T (4, 4) about a random axis."""
    axis, across = rng.normal(size=(2, 3))
    radius, angle = rng.uniform(*ARC_RADII), rng.uniform(*ARC_ANGLES)
    outward = np.cross(axis, across)
    centre = T[:3, 3] - radius * outward / np.linalg.norm(outward)
    return Arc.about(T, centre, axis, angle, orientation="arc" if turns else "fixed")


def _seam(T: Array, rng: np.random.Generator, turns: bool) -> Path:
    """A polyline from the pose T (4, 4) through some waypoints, each segment bent against the one before."""
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
    """Read the path of a motion from a file: waypoints of a seam, or a motion that `planners.save` wrote.

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
    """Whether a file is a table of poses, and not a motion that was saved."""
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
    """Path through the waypoints of a table, and the start in its first row."""
    poses = read_poses(file, arm)
    if len(poses.targets) < 2:
        raise InvalidInput(str(file), "one row", "two waypoints or more")
    path = Polyline(poses.targets, blend=SEAM_BLEND, blend_rotation=SEAM_BLEND_ROTATION)
    return path, None if poses.starts is None else poses.starts[0]


def _saved(arm: Robot, file: FilePath) -> tuple[Path, Array | None]:
    """Path and start of a motion that `planners.save` wrote."""
    motion = load_motion(file)
    theirs = motion.robot if arm.payload is None else replace(motion.robot, payload=arm.payload)
    if theirs != arm:
        raise InvalidInput(str(file), f"a motion of {motion.robot.name}", f"one of this {arm.name}")
    return motion.path, motion.trajectory(np.zeros(1))[0]
