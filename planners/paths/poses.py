"""Poses along a path: rotations between two, distances in space and rotation, and the nearest position."""

from __future__ import annotations

from math import degrees, pi
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.errors import InvalidInput
from optik.types import Array, Indices

NO_LENGTH = 1e-12
"""Chords [m] and angles [rad] below this are rounding: poses of an arm of a metre have errors of 1e-16."""
HALF_TURN = 1e-6
"""Nearer to 180° than this [rad], the direction of the shortest turn depends on rounding and measuring errors."""


def shortest_turn(start: Array, goal: Array, argument: str) -> Array:
    """Return the shortest rotation from one pose to another."""
    turn = se3.log_so3(goal[:3, :3] @ start[:3, :3].T)
    angle = float(np.linalg.norm(turn))
    if angle > pi - HALF_TURN:
        got = f"a turn of {degrees(angle):.6f}°, which is equally short in both directions"
        ways = "add a pose between the two (Polyline), give the axis (Arc.about), or turn 0.001 rad less"
        raise InvalidInput(argument, got, f"a turn of less than 180° from the previous pose: {ways}")
    return turn


def rotations_along(R: Array, w: Array, s: Array) -> Array:
    """Return the rotations exp(s w) R along a path that turns at a constant rate."""
    if not w.any():
        return np.broadcast_to(R, (s.size, 3, 3))
    return (se3.exp_so3(s[:, None] * w).reshape(-1, 3) @ R).reshape(-1, 3, 3)


def make_poses(R: Array, p: Array) -> Array:
    """Return the poses of rotations and positions."""
    out = np.zeros((len(p), 4, 4))
    out[:, :3, :3], out[:, :3, 3], out[:, 3, 3] = R, p, 1.0
    return out


def skew_vector(M: Array) -> Array:
    """Return twice the vectors of the skew parts of matrices: 2 sin φ · axis for a rotation by φ."""
    return np.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], axis=1)


def angle_about(axis: Array, R: Array) -> Array:
    """Return the angles about an axis whose rotations are nearest to the given ones.

    tr(exp(−θ n) R) = nᵀRn + cos θ (tr R − nᵀRn) + sin θ n·vec R is greatest there.
    """
    cosine = np.einsum("kii->k", R) - np.einsum("i,kij,j->k", axis, R, axis)
    return np.asarray(np.arctan2(skew_vector(R) @ axis, cosine))


def rotation_derivative_norms(w: Array, w1: Array, w2: Array) -> Array:
    """Return the norms of R', R'', R''' by R' = ω×R and the product rule; R itself has norm 1."""
    A, A1, A2 = (skew(v) for v in (w, w1, w2))
    second = A1 + A @ A
    third = A2 + 2.0 * A1 @ A + A @ A1 + A @ A @ A
    return np.stack([np.linalg.norm(M, ord=2, axis=(1, 2)) for M in (A, second, third)], axis=1)


def skew(w: Array) -> Array:
    """Return the matrices S (k, 3, 3) with S x = w × x."""
    out = np.zeros((len(w), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = w.T
    return out - np.swapaxes(out, 1, 2)


TURN_WEIGHT = 1e-3
"""Distance [m] that corresponds to a rotation by 1 rad: negligible beside distances, but decisive if the tool only turns."""
MOST_BEND = 1e-4
"""Largest distance of the path from the chords of the grid [m]: small beside arms, and a metre of arc needs few chords."""
MOST_CELLS = 512
"""Most chords of the grid between two breaks, so that a very sharp corner does not fill the memory."""
DISTANCES_AT_ONCE = 1_000_000
"""Distances from poses to chords that are in memory at a time: 8 MB an array."""


class PosesAlong(Protocol):
    """The members of a path that the search uses; see `planners.paths.base.Path`."""

    @property
    def end(self) -> float:
        """Length of the path [m, or rad]."""

    @property
    def breaks(self) -> Array:
        """Values of s (k,) between which the path is smooth."""

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) on derivatives between breaks."""

    def pose(self, s: ArrayLike) -> Array:
        """Return the poses (k, 4, 4) at s."""

    def twist(self, s: ArrayLike, order: int = 1) -> Array:
        """Return the twists (k, 6) at s, or their derivatives."""


def find_nearest_on_path(path: PosesAlong, poses: Array) -> Array:
    """Return the path parameters at which |p − x|² + `TURN_WEIGHT`² |R − X|²/2 is least, with the pose (x, X).

    The distance of the path from the chords of a grid has a known bound. So the chords that may be nearest are known, and
    each of them is searched. Two positions whose distances differ by less than twice that bound may count as one.
    """
    edges, bend = chords(path, TURN_WEIGHT, MOST_BEND)
    rows = max(DISTANCES_AT_ONCE // bend.size, 1)
    return np.concatenate([_search(path, edges, bend, poses[i : i + rows]) for i in range(0, len(poses), rows)])


def chords(path: PosesAlong, turn: float, most: float, least: int = 1) -> tuple[Array, Array]:
    """Divide a path into cells, each within a known distance of its chord, by |z''| h²/8."""
    breaks, bounds = path.breaks, path.piece_bounds()[:, :, 1]
    second = np.hypot(bounds[:, 0], turn * np.sqrt(1.5) * bounds[:, 1])  # a 3×3 matrix: Frobenius ≤ √3 spectral
    length = np.diff(breaks)
    fewest = np.where(second > 0.0, least, 1)
    cells = np.clip(np.ceil(length * np.sqrt(second / (8.0 * most))), fewest, MOST_CELLS).astype(int)
    return divide_pieces(breaks, cells), np.repeat(second * (length / cells) ** 2 / 8.0, cells)


def divide_pieces(breaks: Array, cells: Indices) -> Array:
    """Return the ends of equal cells of pieces between breaks, from the number of cells of each piece."""
    which = np.repeat(np.arange(cells.size), cells)
    within = np.arange(which.size) - np.repeat(np.cumsum(cells) - cells, cells)
    return np.append(breaks[which] + (np.diff(breaks) / cells)[which] * within, breaks[-1])


def _search(path: PosesAlong, edges: Array, bend: Array, poses: Array) -> Array:
    which, cell, part = _candidates(embed_poses(path.pose(edges), TURN_WEIGHT), bend, embed_poses(poses, TURN_WEIGHT))
    low, high = edges[cell], edges[cell + 1]
    s, cost = _newton(path, poses[which], low + part * (high - low), low, high)
    best = np.lexsort((s, cost, which))
    return s[best[np.searchsorted(which[best], np.arange(len(poses)))]]


def embed_poses(poses: Array, turn: float) -> Array:
    """Return poses as points whose squared distance is |p − x|² + turn² |R − X|²/2."""
    return np.concatenate([poses[:, :3, 3], (turn / np.sqrt(2.0)) * poses[:, :3, :3].reshape(-1, 9)], axis=1)


def _candidates(z: Array, bend: Array, x: Array) -> tuple[Indices, Indices, Array]:
    """Return pairs of a pose and a chord that may be nearest to it, and the position on the chord, from 0 to 1."""
    centre = z.mean(axis=0)
    a, e, x = z[:-1] - centre, np.diff(z, axis=0), x - centre
    length2 = np.einsum("ij,ij->i", e, e)
    along = x @ e.T - np.einsum("ij,ij->i", a, e)
    part = np.clip(along / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
    size = np.einsum("ij,ij->i", x, x)[:, None] + np.einsum("ij,ij->i", a, a)
    d = np.sqrt(np.maximum(size - 2.0 * (x @ a.T) + part * (part * length2 - 2.0 * along), 0.0))
    rounding = 1e-7 * np.sqrt(size.max())  # the square root of the rounding in a difference of squares
    near = d - bend <= (d + bend).min(axis=1, keepdims=True) + rounding
    which, cell = np.nonzero(near)
    return which, cell, part[which, cell]


def _newton(path: PosesAlong, poses: Array, s: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return s (k,) of least cost within [low, high], by Newton's method in a shrinking bracket, and the costs."""
    s, low, high = s.copy(), low.copy(), high.copy()
    active = np.arange(s.size)
    for step in range(60):
        slope, curvature = _slope(path, poses[active], s[active])
        low[active] = np.where(slope <= 0.0, s[active], low[active])
        high[active] = np.where(slope >= 0.0, s[active], high[active])
        new = s[active] - np.divide(slope, curvature, out=np.full(slope.shape, np.inf), where=curvature > 0.0)
        # clipping finds a minimum at the end of a cell at once; any other step out of the bracket is bisected
        kept = np.clip(new, low[active], high[active])
        half = 0.5 * (low[active] + high[active])
        new = np.where((kept == new) | ((step < 2) & (curvature > 0.0)), kept, half)
        moved = np.abs(new - s[active])
        s[active] = new
        active = active[moved > 1e-9 * path.end]
        if not active.size:
            break
    return s, _cost(path, poses, s)


def _cost(path: PosesAlong, poses: Array, s: Array) -> Array:
    at = path.pose(s)
    r = at[:, :3, 3] - poses[:, :3, 3]
    alike = np.einsum("kij,kij->k", *_rotations_of(at, poses))
    return np.asarray(np.einsum("ki,ki->k", r, r) + TURN_WEIGHT**2 * (3.0 - alike))


def _slope(path: PosesAlong, poses: Array, s: Array) -> tuple[Array, Array]:
    """Return the first and second derivatives (k,) of half the cost, by R' = ω×R and R'' = (ω'× + ω×ω×) R."""
    at, first, second = path.pose(s), path.twist(s), path.twist(s, 2)
    r, v, w = at[:, :3, 3] - poses[:, :3, 3], first[:, :3], first[:, 3:]
    R, X = _rotations_of(at, poses)
    M = R @ np.swapaxes(X, 1, 2)
    axis = skew_vector(M)
    turn = np.einsum("kii->k", M) * np.einsum("ki,ki->k", w, w) - np.einsum("ki,kij,kj->k", w, M, w)
    half = 0.5 * TURN_WEIGHT**2
    slope = np.einsum("ki,ki->k", r, v) + half * np.einsum("ki,ki->k", w, axis)
    curvature = np.einsum("ki,ki->k", v, v) + np.einsum("ki,ki->k", r, second[:, :3])
    return slope, curvature + half * (np.einsum("ki,ki->k", second[:, 3:], axis) + turn)


def _rotations_of(a: Array, b: Array) -> tuple[Array, Array]:
    return a[:, :3, :3], b[:, :3, :3]
