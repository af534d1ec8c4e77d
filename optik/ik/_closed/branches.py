"""From roots to branches: whole turns, limits, and at a singular configuration the point of a curve of roots asked for.

A *root* is a configuration that meets the target, revolute joints in [−π, π), limits aside; a *branch* is a root with
whole turns added, inside the limits. Where the Jacobian has lost rank a root may be one point of a curve of roots (a
straight wrist fixes only q4 + q6): each piece of the curve inside the limits is then represented by one point, the one
nearest to a reference. All configurations are compared joint by joint, revolute ones around the circle.
"""

from __future__ import annotations

from itertools import combinations, product
from math import pi, sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik._closed.roots import (
    CLAMPED_STEPS,
    FLAT_PIVOT,
    LIMIT_BAND,
    POLISHING_STEPS,
    SAME_ROOT,
    keep_inside,
    refine,
    refine_within,
)
from optik.ik._null_space import SHARE_OF_TOLERANCE, descend
from optik.kinematics import Range
from optik.task import POSE
from optik.types import Array, Flags

ROOT_ERROR = 1e-9
"""Error of a root at most [m, rad], where some are so near: beside a singularity much else is within the tolerance."""

MOST_WINDINGS = 4096
"""Windings of one root at most: joints that can turn a hundred times would otherwise have millions."""

FEW_POINTS = 4
"""Starts on a curve of roots that are enough where only its nearest point is asked for."""

LOOK_AHEAD = 0.05
"""How far along a lost direction to look whether the roots go on there [rad]."""

LOOKS = 8
"""Directions tried from one lost direction: each is nearer to the curve's than the one before."""

NEAREST_WISH = np.array([1.0, 0.0, 0.0])
"""Weights [1] of the preference that sliding minimises: the distance to the reference alone."""


def windings(
    robot: Robot, q: Array, reference: Array, joints: Flags, *, slack: float = LIMIT_BAND, each: int = MOST_WINDINGS
) -> Array:
    """Configurations with whole turns added to some joints, nearest to a reference first."""
    columns = [_turned(robot, i, q[i], reference[i], slack)[:each] if joints[i] else [q[i]] for i in range(robot.n)]
    while np.prod([float(len(c)) for c in columns]) > MOST_WINDINGS:
        max(columns, key=len).pop()
    rows = np.array(list(product(*columns)), dtype=np.float64).reshape(-1, robot.n)
    ordered: Array = rows[np.linalg.norm(rows - reference, axis=1).argsort(kind="stable")]
    return ordered


def _turned(robot: Robot, i: int, x: float, near: float, slack: float) -> list[float]:
    """Values that joint i can have for x: the nearest first."""
    turn, low, high = 2.0 * pi, robot.limits.lower[i] - slack, robot.limits.upper[i] + slack
    if robot.prismatic[i] or robot.limits.lower[i] == robot.limits.upper[i]:
        return [x] if low <= x <= high else []
    first, last = np.ceil((low - x) / turn), np.floor((high - x) / turn)
    if np.isinf(low) or np.isinf(high):
        first = last = min(max(np.round((near - x) / turn), first), last)
    first, last = max(first, last - MOST_WINDINGS), min(last, first + MOST_WINDINGS)
    return sorted((x + turn * k for k in range(int(first), int(last) + 1)), key=lambda v: abs(v - near))


def too_many(robot: Robot) -> bool:
    """Whether `windings` leaves some out for this arm."""
    limits = robot.limits
    ends = np.isfinite(limits.lower) & np.isfinite(limits.upper) & ~robot.prismatic
    return bool(np.prod(np.floor((limits.upper - limits.lower)[ends] / (2.0 * pi)) + 1.0) > MOST_WINDINGS)


def inside(robot: Robot, target: Array, tolerance: tuple[float, float], rows: Array) -> Array:
    """Configurations that meet a target inside the limits, moved onto a limit that they miss by `LIMIT_BAND`."""
    rows, good = np.array(rows), np.empty(len(rows), np.bool_)
    limits = robot.limits
    keep_inside(robot.chain, (limits.lower, limits.upper), target, tolerance, rows, good)
    return rows[good]


# ---------------------------------------------------------------- curves of roots


def lost_directions(robot: Robot, q: Array) -> Array:
    """Directions of joint motion that leave the tool where it is, to first order."""
    moving = robot.limits.lower < robot.limits.upper
    _, sigma, Vt = np.linalg.svd(robot.jacobian(q)[:, moving])
    rank = int((sigma > sqrt(FLAT_PIVOT) * sigma[0]).sum())
    out = np.zeros((robot.n, Vt.shape[0] - rank))
    out[moving] = Vt[rank:].T
    return out


def goes_on(robot: Robot, target: Array, free: Range, q: Array, tolerance: tuple[float, float]) -> Flags:
    """Joints that move along the curve of roots through a configuration; none where it is an isolated root.

    Where more than one direction is lost, the curve leaves along some mixture of them: a root met off the direction in
    which it was looked for says which, and there it is looked for next.
    """
    moves = np.zeros(robot.n, dtype=np.bool_)
    lost = list(lost_directions(robot, q).T)
    between = [(a + sign * b) / sqrt(2.0) for a, b in combinations(lost, 2) for sign in (1.0, -1.0)]
    for along in [*lost, *between]:
        for d in (along, -along):
            for _ in range(LOOKS):
                ahead = q + LOOK_AHEAD * d
                x = ahead.copy()
                # stop at the tolerance: refining to rounding would move the point along the curve
                _, position, rotation = refine_within(robot.chain, free, target, tolerance, POLISHING_STEPS, x)
                went = float(np.linalg.norm(x - q))
                if position > tolerance[0] or rotation > tolerance[1] or not 0.2 * LOOK_AHEAD < went < 5.0 * LOOK_AHEAD:
                    break  # no root, the way back, or another branch
                if np.linalg.norm(x - ahead) < 0.2 * LOOK_AHEAD:
                    moves |= np.abs(x - q) > 1e-3 * LOOK_AHEAD
                    break
                d = (x - q) / went
    return moves


def slide(robot: Robot, target: Array, q: Array, reference: Array, tolerance: tuple[float, float]) -> Array:
    """Bring a configuration inside the limits, and along its curve of roots to where it is nearest to a reference."""
    limits, x = (robot.limits.lower, robot.limits.upper), robot.limits.clip(q)
    refine(robot.chain, limits, target, CLAMPED_STEPS, x)
    within = tolerance[0] / SHARE_OF_TOLERANCE, tolerance[1] / SHARE_OF_TOLERANCE
    descend(robot.chain, limits, (POSE.flags, target), within, (NEAREST_WISH, reference), x)
    if max(tolerance) <= ROOT_ERROR:  # a curve that is within the tolerance only has few exact roots
        refine(robot.chain, limits, target, CLAMPED_STEPS, x)
    return x


def pieces(
    robot: Robot, target: Array, tolerance: tuple[float, float], q: Array, moves: Flags, reference: Array, known: Array,
    few: bool,
) -> Array:  # fmt: skip
    """One configuration of each piece inside the limits of the curve of roots through a configuration.

    Points half a turn outside come inside by sliding, so no piece is missed, unless only a few near the reference are
    asked for.
    """
    each = 2 if few else MOST_WINDINGS
    starts = windings(robot, q, reference, moves, slack=pi + LIMIT_BAND, each=each)[: FEW_POINTS if few else None]
    still = windings(robot, q, reference, ~moves, each=each)
    found = np.empty((0, robot.n))
    for first, start in enumerate(starts if len(still) else ()):
        point = slide(robot, target, np.where(moves, start, still[0]), reference, tolerance)[None]
        point = inside(robot, target, tolerance, point)
        if first == 0 and len(point) and is_among(point[0], known):
            break
        if len(point) and not is_among(point[0], found):
            found = np.vstack([found, point])
    rows = [np.where(moves, point, others) for point in found for others in still]
    return inside(robot, target, tolerance, np.array(rows).reshape(-1, robot.n))


def is_among(q: Array, rows: Array) -> bool:
    """Whether a configuration is one of some others, turns counted."""
    return bool(len(rows) and np.abs(rows - q).max(axis=1).min() < 10.0 * SAME_ROOT)


@compiled
def first_of_each(rows: Array, first: Flags) -> None:
    """Find the rows that have no equal one before them, turns counted.

    Shapes and units: rows (k, n) [rad, m], first (k,) (overwritten).
    """
    for k in range(rows.shape[0]):
        first[k] = True
        for j in range(k):
            far = 0.0
            for i in range(rows.shape[1]):
                far = max(far, abs(rows[k, i] - rows[j, i]))
            if first[j] and far < 10.0 * SAME_ROOT:
                first[k] = False
                break


def unique(rows: Array) -> Array:
    """Each configuration once."""
    first = np.empty(len(rows), np.bool_)
    first_of_each(rows, first)
    return rows[first]
