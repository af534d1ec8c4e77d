"""How far a motion's tool leaves its path at most, at every instant: a proved bound beside the largest value found."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array
from planners.certificate.bounds import Instants, MotionBounds, bezier_bound, joint_bounds, tool_bounds
from planners.certificate.progress import BEND, Nearest, Places, places_along
from planners.paths.base import Path
from planners.trajectory import Trajectory

Bools = NDArray[np.bool_]
Side = TypeVar("Side", Instants, Places)

LOOSE = 1.05
"""A bound may be so many times the largest value found…"""
FLOOR = 1e-9
"""…or this [m or rad], where all values are smaller."""
MOST = 400_000
"""Intervals at most; a motion that needs more keeps the bound it has then."""
PARTS = 64
"""Parts at most of a piece of the motion on a first look for the places that it comes to."""
ROUNDING = 2e-15
"""What rounding may take from a computed distance [m] or angle [rad]."""


class PathError(NamedTuple):
    """Bounds on the tool's distance [m] from its path and on its angle [rad] to it, proved for every instant.

    The largest values that were found, and when, stand beside them: the truth is between.
    """

    distance: float
    angle: float
    found_distance: float
    found_angle: float
    t_distance: float
    t_angle: float


class Passage(NamedTuple):
    """A motion along its path: places s (k,) and the path's poses (k, 4, 4) there at instants t (k,), some of them knots.

    ``falls`` (m, 3) are stretches on which s(t) goes back between two instants: when, from which place, and to which.
    """

    t: Array
    s: Array
    poses: Array
    knot: Bools
    falls: Array


def path_error(
    robot: Robot,
    path: Path,
    trajectory: Trajectory,
    bounds: MotionBounds | None = None,
    enough: tuple[float, float] = (FLOOR, FLOOR),
) -> tuple[PathError, Passage]:
    """Bound the distance and the angle between the tool and its path at every instant of a motion.

    The tool is compared with the path at s(t), the places that the motion as a whole is at
    (`planners.certificate.progress`), each the nearest around. Between instants the error is
    bounded by its cubic and the fourth derivatives of both motions (`planners.certificate.bounds`), which is true whatever
    s(t) is; intervals are divided until the bound is at most 1.05 times the largest value found, or 1 nm (1 nrad).

    Parameters
    ----------
    robot : Robot
        The arm.
    path : Path
        What its tool should follow.
    trajectory : Trajectory
        Its motion.
    bounds : MotionBounds, optional
        Of that motion, where they are known already.
    enough : (2,) tuple of float
        Distance [m] and angle [rad] below which no bound need be finer; at most 1 nm and 1 nrad count.

    Returns
    -------
    PathError
        Distances in metres, angles in radians.
    Passage
        Where on the path the motion is, at its knots and between.
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    nearest = Nearest(path)
    piece, left, right, knot = _first_look(bounds)
    guess = places_along(path, np.concatenate([left.poses, right.poses[-1:]]), BEND)
    both = nearest.places(_joined(left, right), np.concatenate([guess[:-1], guess[1:]]))
    here, there = (Places(*(x[i] for x in both)) for i in (slice(None, piece.size), slice(piece.size, None)))
    times, at_times = np.append(left.t, right.t[-1]), np.append(here.s, there.s[-1])
    poses, falls = np.concatenate([here.poses, there.poses[-1:]]), []
    found, when, proved = np.zeros(2), np.zeros(2), np.zeros(2)
    for instants, places in ((left, here), (right, there)):
        _note(instants, places, found, when)
    limits, kept, floor = PieceBounds.of(path), 0, np.minimum(enough, FLOOR)
    while True:
        between, fall = np.empty((2, left.t.size, 2))
        _intervals(bounds.links, robot.prismatic, limits, path.end, left, right, here, there, between, fall)
        over = (between / ((LOOSE - 0.002) * np.maximum(found, floor))).max(axis=1)
        loose = over > 1.0
        loose &= (right.t - left.t > 1e-9 * trajectory.end) & (kept + loose.sum() <= MOST)
        proved = np.maximum(proved, between[~loose].max(axis=0, initial=0.0))
        back = ~loose & (fall[:, 0] > fall[:, 1])
        falls.append(np.column_stack([left.t[back], fall[back]]))
        if not loose.any():
            break
        kept += int(np.count_nonzero(~loose))
        piece = piece[loose]
        left, right = (Instants(*(x[loose] for x in side)) for side in (left, right))
        here, there = (Places(*(x[loose] for x in side)) for side in (here, there))
        parts = int(np.clip(np.ceil(np.median(over[loose]) ** 0.25), 2, 8))  # errors of cubics fall by parts⁴
        u = np.repeat(np.arange(1, parts) / parts, piece.size)
        t, guess = _within(u, parts - 1, left.t, right.t, here, there)
        middle = bounds.at(np.tile(piece, parts - 1), t)
        at = nearest.places(middle, guess)
        _note(middle, at, found, when)
        piece = np.tile(piece, parts)
        left, right = _joined(left, middle), _joined(middle, right)
        here, there = _joined(here, at), _joined(at, there)
    proved = np.maximum(proved, found) + ROUNDING
    error = PathError(*(float(x) for x in (*proved, *found, *when)))
    return error, Passage(times, at_times, poses, knot, np.concatenate(falls))


def _first_look(bounds: MotionBounds) -> tuple[NDArray[np.int64], Instants, Instants, Bools]:
    """Intervals in which the tool stays within about `BEND` of the straight way: their pieces, their ends, one-sided.

    Also which of the k + 1 instants between them are knots of the motion.
    """
    t = bounds.knots
    piece = np.arange(t.size - 1)
    left, right = bounds.ends
    parts = np.empty(piece.size, np.int64)
    _parts(left, right, parts)
    if parts.max() == 1:
        return piece, left, right, np.ones(t.size, np.bool_)
    which = np.repeat(piece, parts)
    part = np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)
    begin = t[which] + part * (np.diff(t) / parts)[which]
    end = np.where(part + 1 == parts[which], t[which + 1], np.append(begin[1:], t[-1]))
    return which, bounds.at(which, begin), bounds.at(which, end), np.append(part == 0, True)


@compiled
def _parts(left: Instants, right: Instants, parts: NDArray[np.int64]) -> None:
    """Equal parts (k,) of intervals in which the tool bends away from the straight way by `BEND` at most, by |a| h²/8."""
    way, aside = np.empty(3), np.empty(3)
    for k in range(parts.shape[0]):
        length, bend = 0.0, 0.0
        for i in range(3):
            way[i] = right.poses[k, i, 3] - left.poses[k, i, 3]
            length += way[i] * way[i]
        for a in (left.motion[k, 1], right.motion[k, 1]):  # along the way nothing bends
            along = (way[0] * a[0] + way[1] * a[1] + way[2] * a[2]) / length if length > 0.0 else 0.0
            for i in range(3):
                aside[i] = a[i] - along * way[i]
            bend = max(bend, np.sqrt(aside[0] ** 2 + aside[1] ** 2 + aside[2] ** 2))
        bend *= (right.t[k] - left.t[k]) ** 2 / 8.0
        parts[k] = int(min(max(np.ceil(np.sqrt(bend / BEND)), 1.0), PARTS))


def _within(u: Array, times: int, t0: Array, t1: Array, here: Places, there: Places) -> tuple[Array, Array]:
    """Instants at parts u of intervals, tiled so many times, and the places that the cubic through their ends has there."""
    t0, h = np.tile(t0, times), np.tile(t1 - t0, times)
    s0, v0, s1, v1 = (np.tile(x, times) for x in (here.s, here.speed, there.s, there.speed))
    w = 1.0 - u
    s = w * w * ((1.0 + 2.0 * u) * s0 + u * h * v0) + u * u * ((1.0 + 2.0 * w) * s1 - w * h * v1)
    return t0 + u * h, s


def _joined(a: Side, b: Side) -> Side:
    return type(a)(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))


# ---------------------------------------------------------------- errors, and their bounds between instants


@compiled
def _turn(A: Array, B: Array, out: Array) -> None:
    """E = R_tool R_pathᵀ of two poses, into out (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]


@compiled
def _angle(norm: float) -> float:
    """Angle of a rotation E whose ‖E − I‖ (Frobenius) is known: it is 2√2 sin(angle / 2)."""
    return float(2.0 * np.arcsin(min(norm / (2.0 * np.sqrt(2.0)), 1.0)))


def _note(instants: Instants, places: Places, found: Array, when: Array) -> None:
    """Keep the largest distance and angle found."""
    _largest(instants.t, instants.poses, places.poses, found, when)


@compiled
def _largest(t: Array, tool: Array, poses: Array, found: Array, when: Array) -> None:
    E = np.empty((3, 3))
    for k in range(t.shape[0]):
        _turn(tool[k], poses[k], E)
        distance, turn = 0.0, 0.0
        for i in range(3):
            distance += (tool[k, i, 3] - poses[k, i, 3]) ** 2
            E[i, i] -= 1.0
            for j in range(3):
                turn += E[i, j] * E[i, j]
        distance, turn = np.sqrt(distance), _angle(np.sqrt(turn))
        if distance > found[0]:
            found[0], when[0] = distance, t[k]
        if turn > found[1]:
            found[1], when[1] = turn, t[k]


@compiled
def _error(tool: Array, motion: Array, pose: Array, twist: Array, speed: float, value: Array, rate: Array) -> None:
    """Errors (12,) of position and of rotation, E − I, and how fast they change, the path being run through at a speed."""
    E = np.empty((3, 3))
    _turn(tool, pose, E)
    for i in range(3):
        value[i] = tool[i, 3] - pose[i, 3]
        rate[i] = motion[0, i] - speed * twist[i]
    w = (motion[0, 3], motion[0, 4], motion[0, 5])
    p = (speed * twist[3], speed * twist[4], speed * twist[5])
    for i in range(3):  # Ė = ω × E − E (ω_path ×)
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            value[3 + 3 * i + j] = E[i, j] - (1.0 if i == j else 0.0)
            rate[3 + 3 * i + j] = w[a] * E[b, j] - w[b] * E[a, j] - (E[i, c] * p[d] - E[i, d] * p[c])


class PieceBounds(NamedTuple):
    """Bounds (m, 2, 4) on a path's derivatives, position and rotation, on the m pieces between its breaks (m + 1,)."""

    breaks: Array
    bounds: Array

    @classmethod
    def of(cls, path: Path) -> PieceBounds:
        """Those of a path."""
        return cls(np.ascontiguousarray(path.breaks), np.ascontiguousarray(path.piece_bounds()))


@compiled
def _on_stretch(limits: PieceBounds, low: float, high: float, out: Array) -> None:
    """Bounds (2, 4) on the path's derivatives between two places: the largest of the pieces that are touched."""
    last = limits.bounds.shape[0] - 1
    first = min(max(np.searchsorted(limits.breaks, low) - 1, 0), last)
    final = min(max(np.searchsorted(limits.breaks, high, side="right") - 1, 0), last)
    for part in range(2):
        for k in range(4):
            out[part, k] = 0.0
            for i in range(first, final + 1):
                out[part, k] = max(out[part, k], limits.bounds[i, part, k])


@compiled
def path_rates(limits: PieceBounds, s0: float, s1: float, v0: float, v1: float, h: float, out: Array) -> None:
    """Bounds (2, 5) on the derivatives in time of a path's position and rotation at a cubic s(t) over h (Faà di Bruno).

    s(t) is given by its ends; its Bézier points bound the places that it comes to, its derivatives the rates.
    """
    slope = (s1 - s0) / h
    a0, a1 = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, (2.0 * v0 + 4.0 * v1 - 6.0 * slope) / h
    j = abs(a1 - a0) / h
    v = max(abs(v0), abs(v1)) + j * h * h / 8.0
    a = max(abs(a0), abs(a1))
    b = np.empty((2, 4))
    p, q = s0 + v0 * h / 3.0, s1 - v1 * h / 3.0
    _on_stretch(limits, min(s0, p, q, s1), max(s0, p, q, s1), b)
    for part in range(2):
        b1, b2, b3, b4 = b[part, 0], b[part, 1], b[part, 2], b[part, 3]
        out[part, 0] = 1.0
        out[part, 1] = b1 * v
        out[part, 2] = b1 * a + b2 * v * v
        out[part, 3] = b1 * j + 3.0 * b2 * v * a + b3 * v**3
        out[part, 4] = b2 * (4.0 * v * j + 3.0 * a * a) + 6.0 * b3 * v * v * a + b4 * v**4


@compiled
def _cut(v: float, before: float, after: float, h: float) -> float:
    """A rate of s, cut so that the Bézier points of its cubic stay on the path, which reaches so far back and on."""
    return min(max(v, -3.0 * before / h), 3.0 * after / h)


@compiled
def _intervals(
    links: Array, prismatic: Bools, limits: PieceBounds, end: float, left: Instants, right: Instants, here: Places,
    there: Places, out: Array, fall: Array,
) -> None:  # fmt: skip
    """Bounds (k, 2) on distance and angle within intervals of time; s(t) is the cubic through their ends.

    Into fall (k, 2), the places between which that cubic goes back.
    """
    k = left.t.shape[0]
    h = right.t - left.t
    D, moves, turns, spin = np.empty(left.joints.shape), np.empty((k, 6)), np.empty((k, 6)), np.empty(k)
    joint_bounds(left.joints, h, D)
    tool_bounds(links, prismatic, D, moves, turns, spin)
    e0, r0, e1, r1, b = np.empty(12), np.empty(12), np.empty(12), np.empty(12), np.empty((2, 5))
    for i in range(k):
        v0 = _cut(here.speed[i], here.s[i], end - here.s[i], h[i])
        v1 = _cut(there.speed[i], end - there.s[i], there.s[i], h[i])
        _error(left.poses[i], left.motion[i], here.poses[i], here.twist[i], v0, e0, r0)
        _error(right.poses[i], right.motion[i], there.poses[i], there.twist[i], v1, e1, r1)
        path_rates(limits, here.s[i], there.s[i], v0, v1, h[i], b)
        fall[i, 0], fall[i, 1] = _fall(here.s[i], v0 * h[i], there.s[i], v1 * h[i])
        fourth = moves[i, 4] + b[0, 4]
        out[i, 0] = bezier_bound(e0[:3], r0[:3], e1[:3], r1[:3], h[i], fourth)
        fourth = product_bound(turns[i], b[1])
        out[i, 1] = _angle(bezier_bound(e0[3:], r0[3:], e1[3:], r1[3:], h[i], fourth))


@compiled
def product_bound(a: Array, b: Array) -> float:
    """Bound on the Frobenius norm of the fourth derivative of R_tool R_pathᵀ, from spectral ones (5,) of both."""
    fourth = a[0] * b[4] + 4.0 * a[1] * b[3] + 6.0 * a[2] * b[2] + 4.0 * a[3] * b[1] + a[4] * b[0]
    return float(np.sqrt(3.0) * fourth)  # of a 3×3 matrix


@compiled
def _fall(s0: float, v0: float, s1: float, v1: float) -> tuple[float, float]:
    """Places between which the cubic with these values and slopes at 0 and 1 goes back farthest; twice the same if nowhere."""
    c3, c2 = 2.0 * (s0 - s1) + v0 + v1, 3.0 * (s1 - s0) - 2.0 * v0 - v1
    root = c2 * c2 - 3.0 * c3 * v0
    turns = (0.0, 1.0)  # where it turns, in order: the roots of 3 c₃ u² + 2 c₂ u + v₀
    if root > 0.0 and c2 + np.copysign(np.sqrt(root), c2) != 0.0:
        w = -(c2 + np.copysign(np.sqrt(root), c2))
        a, b = v0 / w, (w / (3.0 * c3) if c3 != 0.0 else 2.0)
        turns = (min(a, b), max(a, b))
    top = high = low = s0
    for u in (turns[0], turns[1], 1.0):
        if not 0.0 < u <= 1.0:
            continue
        s = s1 if u == 1.0 else s0 + u * (v0 + u * (c2 + u * c3))
        top = max(top, s)
        if top - s > high - low:
            high, low = top, s
    return high, low
