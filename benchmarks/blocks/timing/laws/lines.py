"""Straight lines to time: drawn so that the whole line can be followed, of two distances from a singularity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from benchmarks.blocks._arms import arm_label, arm_with
from benchmarks.blocks.timing.laws.arms import Stands, stands_of
from optik import se3
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.registry import short_name
from optik.types import Array
from planners.paths.base import Path
from planners.paths.line import Line

if TYPE_CHECKING:
    from benchmarks.blocks.timing.laws.sets import LimitSet

LINE_KINDS = {"regular": (0.05, np.inf), "near_singular": (0.02, 0.04)}
"""Range of the smallest singular value along the whole line, for each kind of line."""

LINE_LENGTHS = (0.05, 0.4)
"""Shortest and longest line [m]."""

LINE_TURNS = (0.05, 0.5)
"""Range of the angle [rad] that the tool turns through on every other line; it keeps its orientation on the others."""

LIMIT_MARGIN = 0.02
"""Least distance to the joint limits along the whole line [rad or m], so that no round-off ends a line early."""

TRACK_STEPS = 120
"""Steps of the track; the fastest joint of the hardest line moves about 0.1 rad in one."""

TRACK_TOLERANCE = 1e-9
"""Error that Newton's method must reach at every step [m and rad]."""

NEWTON_STEPS = 4
"""Iterations of Newton's method at every step of the track: it starts near, and converges quadratically."""

TRACK_DAMPING = 1e-14
"""Added to J Jᵀ, so that a singular J raises no error; such a track is dropped by its residual."""

CANDIDATES = 8
"""Lines tracked side by side."""

MOST_DRAWS = 100_000
"""Draws after which an arm counts as one that has no such line."""


@dataclass(frozen=True)
class DrawnLine:
    """A line and where the arm starts on it.

    Attributes
    ----------
    robot : Robot
        The arm.
    kind : str
        ``regular`` or ``near_singular``; other motions as `benchmarks.blocks.timing.laws.motions` calls them.
    index : int
        Which one of its kind.
    q_start : (n,) array
        Configuration at the start, inside the limits [rad, m].
    path : Path
        Of a line: straight, turning about a fixed axis or not at all.
    singular_value : float
        Smallest singular value of the Jacobian along the track by which the line was chosen.
    draws : int
        How many lines were drawn until one could be followed and was of its kind.
    arm : str
        What reports call the arm.
    """

    robot: Robot
    kind: str
    index: int
    q_start: Array
    path: Path
    singular_value: float
    draws: int
    arm: str


def draw_line(
    robot: str,
    kind: str,
    index: int,
    *,
    seed: int = 0,
    payload: float | tuple[float, float] | None = None,
    limits: Sequence[LimitSet] = (),
) -> DrawnLine:
    """Draw one line, the same for the same robot, kind, index and seed, and what it carries where torque is limited.

    A start uniform inside the limits, a direction uniform on the sphere, a length, for odd indices a turn; drawn again
    until the arm can follow the whole line with `LIMIT_MARGIN` to its limits and its smallest singular value is of the kind,
    and can stand everywhere on it within the limits on torque. A line counts as followed where Newton's method on the pose
    converges at many small steps of least joint motion. That needs no planner, so the set stays the same when planners
    change.
    """
    if kind not in LINE_KINDS:
        raise InvalidInput("kind", repr(kind), f"one of {', '.join(LINE_KINDS)}")
    check_count(index, "index", 0)
    check_count(seed, "seed", 0)
    arm = arm_with(robot, payload)
    stands = stands_of(arm, limits)
    rng = np.random.default_rng((seed, crc32(short_name(robot).encode()), crc32(kind.encode()), index))
    found = _first_good(arm, kind, rng, turns=index % 2 == 1, stands=stands)
    if found is None:
        raise InvalidInput("kind", f"{kind} on {robot}: no line in {MOST_DRAWS:,} draws", "an arm that has such lines")
    start, goal, singular_value, draws = found
    path = Line(arm.fk(start), goal)
    return DrawnLine(arm, kind, index, start, path, singular_value, draws, arm_label(robot, payload))


def _first_good(
    arm: Robot, kind: str, rng: np.random.Generator, *, turns: bool, stands: Stands | None
) -> tuple[Array, Array, float, int] | None:
    """Start, goal and smallest singular value of the first line of a kind that can be followed, and how many were drawn."""
    low, high = LINE_KINDS[kind]
    between = np.linspace(0.0, 1.0, TRACK_STEPS + 1)
    for draws in range(0, MOST_DRAWS, CANDIDATES):
        starts, goals = _candidates(arm, rng, turns=turns)
        poses = np.stack([se3.interpolate(a, b, between) for a, b in zip(arm.fk(starts), goals, strict=True)])
        singular_values = tracked(arm, starts, poses, low, stands)
        good = np.flatnonzero((singular_values >= low) & (singular_values <= high))
        if good.size:
            i = int(good[0])
            return starts[i], goals[i], float(singular_values[i]), draws + i + 1
    return None


def _candidates(robot: Robot, rng: np.random.Generator, *, turns: bool) -> tuple[Array, Array]:
    """Start configurations (k, n) and goal poses (k, 4, 4)."""
    starts = robot.limits.sample(rng, CANDIDATES, margin=LIMIT_MARGIN)
    move, axis = rng.normal(size=(2, CANDIDATES, 3))
    length, angle = rng.uniform(*LINE_LENGTHS, CANDIDATES), rng.uniform(*LINE_TURNS, CANDIDATES)
    goals = robot.fk(starts)
    goals[:, :3, 3] += (length / np.linalg.norm(move, axis=1))[:, None] * move
    if turns:
        w = (angle / np.linalg.norm(axis, axis=1))[:, None] * axis
        goals[:, :3, :3] = np.stack([se3.exp_so3(turn) for turn in w]) @ goals[:, :3, :3]
    return starts, goals


def tracked(robot: Robot, q: Array, poses: Array, low: float, stands: Stands | None = None) -> Array:
    """Smallest singular value along tracks of the tool; NaN where a track leaves the limits."""
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
    """Configurations (k, n) at poses (k, 4, 4) near q, each step the least joint motion: Jᵀ (J Jᵀ)⁻¹ e."""
    for _ in range(NEWTON_STEPS):
        J = robot.jacobian(q)
        transposed = J.transpose(0, 2, 1)
        normal = J @ transposed + TRACK_DAMPING * np.eye(6)
        q = q + (transposed @ np.linalg.solve(normal, robot.pose_errors(q, poses)[..., None]))[..., 0]
    return q
