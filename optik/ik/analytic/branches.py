"""From roots to branches: 2π-multiples, limits, and points on curves of roots.

A *root* is a configuration that meets the target, with revolute joints in [−π, π), regardless of the limits. A *branch* is
a root plus 2π-multiples, inside the limits. At a singular configuration a root may be one point of a curve of roots (a
straight wrist determines only q4 + q6). Each piece of the curve inside the limits is then represented by its point nearest
to a reference. Configurations are compared joint by joint, revolute joints modulo 2π.
"""

from __future__ import annotations

from itertools import combinations, product
from math import pi, sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik._null_space import FRACTION_OF_TOLERANCE, descend
from optik.ik.analytic.roots import (
    CLAMPED_STEPS,
    LIMIT_BAND,
    POLISHING_STEPS,
    SAME_ROOT,
    SINGULAR_PIVOT,
    keep_inside,
    refine,
    refine_within,
)
from optik.kinematics import Range
from optik.task import POSE
from optik.types import Array, Flags

ROOT_ERROR = 1e-9
"""If one root is this accurate [m, rad], less accurate roots are rejected; near a singularity many are within the tolerance."""
MOST_WINDINGS = 4096
"""Largest number of windings of one root: joints that can turn a hundred times would otherwise have millions."""
FEW_POINTS = 4
"""Number of initial guesses on a curve of roots if only its nearest point is needed."""
CURVE_STEP = 0.05
"""Step along a null-space direction that tests whether the curve of roots continues there [rad]."""
CURVE_TRIES = 8
"""Number of directions tried from one null-space direction, each nearer to the tangent of the curve."""
DISTANCE_OBJECTIVE = np.array([1.0, 0.0, 0.0])
"""Weights [1] of the objective of `slide`: the distance to the reference alone."""


def windings(
    robot: Robot, q: Array, reference: Array, joints: Flags, *, slack: float = LIMIT_BAND, each: int = MOST_WINDINGS
) -> Array:
    """Return the configurations with 2π-multiples added to some joints, nearest to a reference first."""
    columns = [_find_turns(robot, i, q[i], reference[i], slack)[:each] if joints[i] else [q[i]] for i in range(robot.n)]
    while np.prod([float(len(c)) for c in columns]) > MOST_WINDINGS:
        max(columns, key=len).pop()
    rows = np.array(list(product(*columns)), dtype=np.float64).reshape(-1, robot.n)
    ordered: Array = rows[np.linalg.norm(rows - reference, axis=1).argsort(kind="stable")]
    return ordered


def _find_turns(robot: Robot, i: int, x: float, near: float, slack: float) -> list[float]:
    """Return the values x + 2πk of joint i inside its limits, nearest to `near` first."""
    turn, low, high = 2.0 * pi, robot.limits.lower[i] - slack, robot.limits.upper[i] + slack
    if not robot.turning[i] or robot.limits.lower[i] == robot.limits.upper[i]:
        return [x] if low <= x <= high else []
    first, last = np.ceil((low - x) / turn), np.floor((high - x) / turn)
    if np.isinf(low) or np.isinf(high):
        first = last = min(max(np.round((near - x) / turn), first), last)
    first, last = max(first, last - MOST_WINDINGS), min(last, first + MOST_WINDINGS)
    return sorted((x + turn * k for k in range(int(first), int(last) + 1)), key=lambda v: abs(v - near))


def has_too_many_windings(robot: Robot) -> bool:
    """Return whether `windings` omits some windings of this arm."""
    limits = robot.limits
    ends = np.isfinite(limits.lower) & np.isfinite(limits.upper) & robot.turning
    return bool(np.prod(np.floor((limits.upper - limits.lower)[ends] / (2.0 * pi)) + 1.0) > MOST_WINDINGS)


def select_inside(robot: Robot, target: Array, tolerance: tuple[float, float], rows: Array) -> Array:
    """Return the configurations that meet a target inside the limits, after correcting violations up to `LIMIT_BAND`."""
    rows, good = np.array(rows), np.empty(len(rows), np.bool_)
    limits = robot.limits
    keep_inside(robot.chain, (limits.lower, limits.upper), target, tolerance, rows, good)
    return rows[good if robot.motors is None else good & limits.contains(rows)]


# ---------------------------------------------------------------- curves of roots


def null_space_basis(robot: Robot, q: Array) -> Array:
    """Return an orthonormal basis (n, k) of the joint motions that do not move the tool to first order."""
    moving = robot.limits.lower < robot.limits.upper
    _, sigma, Vt = np.linalg.svd(robot.jacobian(q)[:, moving])
    rank = int((sigma > sqrt(SINGULAR_PIVOT) * sigma[0]).sum())
    out = np.zeros((robot.n, Vt.shape[0] - rank))
    out[moving] = Vt[rank:].T
    return out


def find_curve_joints(robot: Robot, target: Array, free: Range, q: Array, tolerance: tuple[float, float]) -> Flags:
    """Return which joints move along the curve of roots through a configuration; none if the root is isolated.

    If the null space has several dimensions, the tangent of the curve is a combination of the basis. A root that is found
    off the tested direction gives the next direction to test.
    """
    moves = np.zeros(robot.n, dtype=np.bool_)
    lost = list(null_space_basis(robot, q).T)
    between = [(a + sign * b) / sqrt(2.0) for a, b in combinations(lost, 2) for sign in (1.0, -1.0)]
    for along in [*lost, *between]:
        for d in (along, -along):
            for _ in range(CURVE_TRIES):
                ahead = q + CURVE_STEP * d
                x = ahead.copy()
                # stop at the tolerance: refinement to rounding would move the point along the curve
                _, position, rotation = refine_within(robot.chain, free, target, tolerance, POLISHING_STEPS, x)
                went = float(np.linalg.norm(x - q))
                if position > tolerance[0] or rotation > tolerance[1] or not 0.2 * CURVE_STEP < went < 5.0 * CURVE_STEP:
                    break  # no root, the way back, or another branch
                if np.linalg.norm(x - ahead) < 0.2 * CURVE_STEP:
                    moves |= np.abs(x - q) > 1e-3 * CURVE_STEP
                    break
                d = (x - q) / went
    return moves


def slide(robot: Robot, target: Array, q: Array, reference: Array, tolerance: tuple[float, float]) -> Array:
    """Return the root inside the limits that is nearest to a reference along the curve of roots through a configuration."""
    limits, x = (robot.limits.lower, robot.limits.upper), robot.limits.clip(q)
    refine(robot.chain, limits, target, CLAMPED_STEPS, x)
    within = tolerance[0] / FRACTION_OF_TOLERANCE, tolerance[1] / FRACTION_OF_TOLERANCE
    descend(robot.chain, limits, (POSE.flags, target), within, (DISTANCE_OBJECTIVE, reference), x)
    if max(tolerance) <= ROOT_ERROR:  # a curve within a larger tolerance has few exact roots
        refine(robot.chain, limits, target, CLAMPED_STEPS, x)
    return x


def find_curve_points(
    robot: Robot, target: Array, tolerance: tuple[float, float], q: Array, moves: Flags, reference: Array, known: Array,
    few: bool,
) -> Array:  # fmt: skip
    """Return one configuration of each piece inside the limits of the curve of roots through a configuration.

    Sliding starts from windings up to half a turn outside the limits, so that no piece is missed unless `few` is set.
    """
    each = 2 if few else MOST_WINDINGS
    starts = windings(robot, q, reference, moves, slack=pi + LIMIT_BAND, each=each)[: FEW_POINTS if few else None]
    still = windings(robot, q, reference, ~moves, each=each)
    found = np.empty((0, robot.n))
    for first, start in enumerate(starts if len(still) else ()):
        point = slide(robot, target, np.where(moves, start, still[0]), reference, tolerance)[None]
        point = select_inside(robot, target, tolerance, point)
        if first == 0 and len(point) and is_among(point[0], known):
            break
        if len(point) and not is_among(point[0], found):
            found = np.vstack([found, point])
    rows = [np.where(moves, point, others) for point in found for others in still]
    return select_inside(robot, target, tolerance, np.array(rows).reshape(-1, robot.n))


def is_among(q: Array, rows: Array) -> bool:
    """Return whether a configuration is among others (k, n), where 2π-multiples differ."""
    return bool(len(rows) and np.abs(rows - q).max(axis=1).min() < 10.0 * SAME_ROOT)


@compiled
def mark_first(rows: Array, first: Flags) -> None:
    """Mark the rows that have no equal row before them, where 2π-multiples differ.

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
    """Return the distinct configurations."""
    first = np.empty(len(rows), np.bool_)
    mark_first(rows, first)
    return rows[first]
