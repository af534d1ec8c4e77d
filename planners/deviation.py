"""How far a motion's tool leaves its path at most, at every instant: a proved bound beside the largest value found."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from optik._compile import compiled
from optik.robot import Robot
from planners.motion_bounds import Instants, MotionBounds, hermite_bound
from planners.paths.base import Path
from planners.trajectory import Trajectory

Array = NDArray[np.float64]
Side = TypeVar("Side", Instants, "_Places")

LOOSE = 1.05
"""A bound may be so many times the largest value found…"""
FLOOR = 1e-9
"""…or this [m or rad], where all values are smaller."""
MOST = 400_000
"""Intervals at most; a motion that needs more keeps the bound it has then."""
GRID, PER_PIECE = 512, 16
"""Intervals of a path, and of each of its pieces, on a first look for the place that the tool is at."""
TURN = 0.1
"""Metres that a radian counts, to tell places of a path apart where only the rotation differs."""
AT_ONCE = 2048
"""Instants whose places on the grid are chosen together."""
LITTLE = 1e-3
"""Metres that it counts to say which place is nearest: little where the position moves."""
STILL = 1e-6
"""Share of the path's greatest rate below which it stands still: there, at a cusp, no place is nearer than another."""
NEAR = 3e-14
"""How near to the nearest place of the path it is enough to be, as a share of the path."""
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


class _Places(NamedTuple):
    """Where on the path (k,) the tool is at some instants, how fast it goes there, and the path's pose and twist."""

    s: Array
    speed: Array
    poses: Array
    twist: Array


def path_error(
    robot: Robot,
    path: Path,
    trajectory: Trajectory,
    bounds: MotionBounds | None = None,
    enough: tuple[float, float] = (FLOOR, FLOOR),
) -> tuple[PathError, Array]:
    """Bound the distance and the angle between the tool and its path at every instant of a motion.

    The tool is compared with the path at s(t), which follows the nearest place: so the path is run through in its order,
    and a path that crosses itself is not taken for its other branch. Between instants the error is bounded by its cubic
    and the fourth derivatives of both motions (`planners.motion_bounds`); intervals are divided until the bound is at most
    1.05 times the largest value found, or 1 nm (1 nrad).

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
    (m + 1,) array
        Places s on the path at the trajectory's knots.
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    piece = np.arange(trajectory.knots.size - 1)
    left, right = bounds.ends
    tracked = _track(path, np.concatenate([left.poses, right.poses[-1:]]))
    here, there = _places(path, left, tracked[:-1]), _places(path, right, tracked[1:])
    found, when, proved = np.zeros(2), np.zeros(2), np.zeros(2)
    for instants, places in ((left, here), (right, there)):
        _note(instants, places, found, when)
    limits, at_knots = _PieceBounds(path), np.append(here.s, there.s[-1])
    kept, floor = 0, np.minimum(enough, FLOOR)
    while True:
        between = _between(limits, path.end, bounds, left, right, here, there)
        over = (between / ((LOOSE - 0.002) * np.maximum(found, floor))).max(axis=1)
        loose = over > 1.0
        loose &= (right.t - left.t > 1e-9 * trajectory.end) & (kept + loose.sum() <= MOST)
        proved = np.maximum(proved, between[~loose].max(axis=0, initial=0.0))
        if not loose.any():
            break
        kept += int(np.count_nonzero(~loose))
        piece = piece[loose]
        left, right = (Instants(*(x[loose] for x in side)) for side in (left, right))
        here, there = (_Places(*(x[loose] for x in side)) for side in (here, there))
        parts = int(np.clip(np.ceil(np.median(over[loose]) ** 0.25), 2, 8))  # errors of cubics fall by parts⁴
        u = np.repeat(np.arange(1, parts) / parts, piece.size)
        t, guess = _within(u, parts - 1, left.t, right.t, here, there)
        middle = bounds.at(np.tile(piece, parts - 1), t)
        at = _places(path, middle, guess)
        _note(middle, at, found, when)
        piece = np.tile(piece, parts)
        left, right = _joined(left, middle), _joined(middle, right)
        here, there = _joined(here, at), _joined(at, there)
    proved = np.maximum(proved, found) + ROUNDING
    return PathError(*(float(x) for x in (*proved, *found, *when))), at_knots


def _within(u: Array, times: int, t0: Array, t1: Array, here: _Places, there: _Places) -> tuple[Array, Array]:
    """Instants at parts u of intervals, tiled so many times, and the places that the cubic through their ends has there."""
    t0, h = np.tile(t0, times), np.tile(t1 - t0, times)
    s0, v0, s1, v1 = (np.tile(x, times) for x in (here.s, here.speed, there.s, there.speed))
    w = 1.0 - u
    s = w * w * ((1.0 + 2.0 * u) * s0 + u * h * v0) + u * u * ((1.0 + 2.0 * w) * s1 - w * h * v1)
    return t0 + u * h, s


def _joined(a: Side, b: Side) -> Side:
    return type(a)(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))


def _errors(instants: Instants, places: _Places) -> tuple[Array, Array]:
    """Position error (k, 3), and the turn E = R_tool R_pathᵀ as E − I (k, 9): its norm is 2√2 sin(angle / 2)."""
    position = instants.poses[:, :3, 3] - places.poses[:, :3, 3]
    turn = instants.poses[:, :3, :3] @ places.poses[:, :3, :3].transpose(0, 2, 1) - np.eye(3)
    return position, turn.reshape(-1, 9)


def _angle(norm: Array) -> Array:
    return np.asarray(2.0 * np.arcsin(np.minimum(norm / (2.0 * np.sqrt(2.0)), 1.0)))


def _note(instants: Instants, places: _Places, found: Array, when: Array) -> None:
    """Keep the largest distance and angle found."""
    position, turn = _errors(instants, places)
    for i, size in enumerate((np.linalg.norm(position, axis=1), _angle(np.linalg.norm(turn, axis=1)))):
        k = int(size.argmax())
        if size[k] > found[i]:
            found[i], when[i] = size[k], instants.t[k]


def _between(
    limits: _PieceBounds,
    end: float,
    bounds: MotionBounds,
    left: Instants,
    right: Instants,
    here: _Places,
    there: _Places,
) -> Array:
    """Bounds (k, 2) on distance and angle within the intervals.

    s(t) is the cubic through its ends; rates are cut so that its Bézier points stay on the path.
    """
    h = right.t - left.t
    first = np.clip(here.speed, -3.0 * here.s / h, 3.0 * (end - here.s) / h)
    last = np.clip(there.speed, -3.0 * (end - there.s) / h, 3.0 * there.s / h)
    position, turn = zip(_errors(left, here), _errors(right, there), strict=True)
    rates = [_rates(x, p, v) for x, p, v in ((left, here, first), (right, there, last))]
    moves, turns, _ = bounds.between(left, h)
    path_moves, path_turns = _path_bounds(limits, here.s, there.s, first, last, h)
    fourth = moves[:, 4] + path_moves[:, 4]
    distance = hermite_bound(position[0], rates[0][0], position[1], rates[1][0], h, fourth)
    fourth = (turns[:, :5] * path_turns[:, ::-1]) @ np.array([1.0, 4.0, 6.0, 4.0, 1.0])
    angle = hermite_bound(turn[0], rates[0][1], turn[1], rates[1][1], h, np.sqrt(3.0) * fourth)
    return np.stack([distance, _angle(angle)], axis=1)


def _rates(instants: Instants, places: _Places, speed: Array) -> tuple[Array, Array]:
    """How fast the errors of `_errors` change, the path being run through at a speed."""
    twist, path_twist = instants.motion[:, 0], places.twist * speed[:, None]
    turn = instants.poses[:, :3, :3] @ places.poses[:, :3, :3].transpose(0, 2, 1)
    rate = _cross_matrix(twist[:, 3:]) @ turn - turn @ _cross_matrix(path_twist[:, 3:])
    return twist[:, :3] - path_twist[:, :3], rate.reshape(-1, 9)


def _cross_matrix(w: Array) -> Array:
    out = np.zeros((len(w), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = w.T
    return out - out.transpose(0, 2, 1)


class _PieceBounds:
    """The bounds on a path's derivatives on stretches of it: the largest of the smooth pieces that each one touches."""

    def __init__(self, path: Path) -> None:
        self._breaks, self._bounds = path.breaks, path.piece_bounds()

    def between(self, low: Array, high: Array) -> Array:
        """Bounds (2, 4, k) on the stretches from low to high (k,)."""
        last = len(self._bounds) - 1
        first = np.clip(np.searchsorted(self._breaks, low, side="left") - 1, 0, last)
        final = np.clip(np.searchsorted(self._breaks, high, side="right") - 1, 0, last)
        found = self._bounds[first]
        for more in range(1, int((final - first).max(initial=0)) + 1):
            found = np.maximum(found, self._bounds[np.minimum(first + more, final)])
        return np.moveaxis(found, 0, -1)


def _path_bounds(limits: _PieceBounds, s0: Array, s1: Array, v0: Array, v1: Array, h: Array) -> tuple[Array, Array]:
    """Bounds (k, 5) on the derivatives in time of the path's position and rotation (Faà di Bruno) at a cubic s(t)."""
    slope = (s1 - s0) / h
    a0, a1 = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, (2.0 * v0 + 4.0 * v1 - 6.0 * slope) / h
    j = np.abs(a1 - a0) / h
    v = np.maximum(np.abs(v0), np.abs(v1)) + j * h * h / 8.0
    a = np.maximum(np.abs(a0), np.abs(a1))
    out = []
    hull = np.stack([s0, s0 + v0 * h / 3.0, s1 - v1 * h / 3.0, s1])
    for b1, b2, b3, b4 in limits.between(hull.min(axis=0), hull.max(axis=0)):
        second, third = b1 * a + b2 * v * v, b1 * j + 3.0 * b2 * v * a + b3 * v**3
        fourth = b2 * (4.0 * v * j + 3.0 * a * a) + 6.0 * b3 * v * v * a + b4 * v**4
        out.append(np.stack([np.ones_like(v), b1 * v, second, third, fourth], axis=1))
    return out[0], out[1]


def _places(path: Path, instants: Instants, guess: Array) -> _Places:
    """Nearest places to the tool near a guess: Gauss and Newton's steps, quartered where they lead away.

    Any place gives a true bound, and the nearest the least.
    """
    part = _Part(path)
    s = np.clip(guess, 0.0, path.end)
    poses, twist = path.pose(s), path.twist(s)
    offset = _offset(instants.poses, poses)
    step = part.along(twist, offset)
    for _ in range(20):
        after = np.clip(s + step, 0.0, path.end)
        if np.abs(after - s).max(initial=0.0) <= NEAR * path.end:
            break
        new = after, path.pose(after), path.twist(after)
        there = _offset(instants.poses, new[1])
        nearer = _weighed(there, there) <= 1.000001 * _weighed(offset, offset)  # and what rounding may add
        step = np.where(nearer, part.along(new[2], there), 0.25 * step)
        for old, x in zip((s, poses, twist, offset), (*new, there), strict=True):
            old[nearer] = x[nearer]
    return _Places(s, part.along(twist, instants.motion[:, 0]), poses, twist)


def _offset(tool: Array, poses: Array) -> Array:
    """Small motion (k, 6), linear and angular, from the path's poses to the tool's, to first order."""
    turn = tool[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)
    return np.concatenate([tool[:, :3, 3] - poses[:, :3, 3], 0.5 * _vee(turn - turn.transpose(0, 2, 1))], axis=1)


class _Part:
    """How far along a path something is: by its position, and by its rotation where the position stands."""

    def __init__(self, path: Path) -> None:
        rate = path.derivative_bounds()[:, 0]
        self._still = (STILL * np.hypot(rate[0], LITTLE * rate[1])) ** 2  # at a cusp nothing tells

    def along(self, twist: Array, motion: Array) -> Array:
        """Distance in s (k,) that a small motion (k, 6) of the tool makes, to first order."""
        return np.asarray(_weighed(twist, motion) / (_weighed(twist, twist) + self._still))


def _weighed(a: Array, b: Array) -> Array:
    """Inner products (k,) of motions (k, 6), where a turn of 1 rad counts as `LITTLE`."""
    linear, angular = (np.einsum("ki,ki->k", a[:, i], b[:, i]) for i in (slice(0, 3), slice(3, 6)))
    return np.asarray(linear + LITTLE**2 * angular)


def _vee(w: Array) -> Array:
    return np.stack([w[:, 2, 1], w[:, 0, 2], w[:, 1, 0]], axis=1)


def _track(path: Path, poses: Array) -> Array:
    """Places (k,) of poses on a grid of the path that together are nearest, where going back costs and going on does not.

    So the leg out and the leg back of a path that returns on itself are told apart by the order of the poses.
    """
    s = path.places(GRID, PER_PIECE)
    grid, points = (np.ascontiguousarray(_embedded(T).T) for T in (path.pose(s), poses))
    back = np.append(np.sum(np.diff(grid, axis=1) ** 2, axis=0), 0.0)
    index = np.zeros(len(poses), dtype=np.int64)
    cost = np.zeros(s.size)
    for first in range(0, len(poses), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        _cheapest(grid, points[:, part], back, cost, index[part])
        cost = np.append(np.cumsum(back[: index[part][-1]][::-1])[::-1], np.zeros(s.size - index[part][-1]))
    return s[index]


def _embedded(poses: Array) -> Array:
    """Poses as points (k, 12) with |a − b|² = |p − x|² + `TURN`² |R − X|² / 2."""
    return np.concatenate([poses[:, :3, 3], (TURN / np.sqrt(2.0)) * poses[:, :3, :3].reshape(-1, 9)], axis=1)


@compiled
def _cheapest(grid: Array, points: Array, back: Array, cost: Array, index: NDArray[np.int64]) -> None:
    """Dynamic programming over places (12, m) for points (12, k) in their order, from costs (m,) to begin with.

    A place costs its squared distance from the point, and going back to it from the one behind costs back (m,).
    """
    m, k = grid.shape[1], points.shape[1]
    before = np.empty((k, m), dtype=np.int32)
    total = cost.copy()
    for row in range(k):
        came = before[row]
        came[m - 1] = m - 1
        for i in range(m - 2, -1, -1):
            came[i] = i
            if total[i + 1] + back[i] < total[i]:
                total[i], came[i] = total[i + 1] + back[i], came[i + 1]
        for i in range(1, m):
            if total[i - 1] <= total[i]:
                total[i], came[i] = total[i - 1], came[i - 1]
        for j in range(12):
            x = points[j, row]
            for i in range(m):
                total[i] += (grid[j, i] - x) * (grid[j, i] - x)
    at = np.argmin(total)
    for row in range(k - 1, -1, -1):
        index[row] = at
        at = before[row, at]
