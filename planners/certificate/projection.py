"""Positions along a path of a moving tool: chords of the whole motion, then Gauss–Newton steps, and a search at cusps."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import Instants
from planners.paths.base import Path
from planners.paths.points import PointsOf, without_rotation
from planners.paths.poses import MOST_CELLS, chords, divide_pieces, embed_poses

# ---------------- the positions of a motion on the chords of a path


CHORD_ROOM, ROOM_FACTOR = 1e-4, 8.0
"""First search distance of the tool from the path's chords [m], and its growth factor if the search fails."""
MOST_PAIRS = 4_000_000
"""Largest number of pairs of an instant and a chord; a motion that needs more is far from its path."""


def find_positions(edges: Array, z: Array, y: Array, off: float) -> Array | None:
    """Return the positions (k,) of a motion y (k, d) on chords z (m + 1, d), or None if the motion is far from them.

    `off` is the sum of the largest distances of the path and of the motion from their chords.
    """
    cell, room = np.empty(len(y), np.int64), CHORD_ROOM + 2.0 * off
    size = float(np.ptp(np.concatenate([z, y]), axis=0).sum())
    while True:
        found = _find_cheapest(z, y, room, MOST_PAIRS, cell)
        if found == FOUND:
            return _nearest_on_chords(edges, z, y, cell)
        if found == TOO_MANY or room > size:
            return None
        room *= ROOM_FACTOR


def _nearest_on_chords(edges: Array, z: Array, y: Array, cell: Indices) -> Array:
    """Return the path parameters (k,) on given chords that are nearest to points y."""
    a, e = z[cell], z[cell + 1] - z[cell]
    size = np.einsum("ij,ij->i", e, e)
    part = np.einsum("ij,ij->i", y - a, e) / np.where(size > 0.0, size, 1.0)
    return np.asarray(edges[cell] + np.clip(part, 0.0, 1.0) * (edges[cell + 1] - edges[cell]))


FOUND, TOO_FAR, TOO_MANY = range(3)
"""Results of the search: found, the motion is off its path, or too many pairs of an instant and a chord."""


@compiled
def _distance2(x: Array, a: Array, b: Array) -> float:
    """Return the squared distance of a point from the chord between two others."""
    along, size, off = 0.0, 0.0, 0.0
    for j in range(x.shape[0]):
        e, d = b[j] - a[j], x[j] - a[j]
        along += e * d
        size += e * e
        off += d * d
    if along <= 0.0 or size == 0.0:
        return off
    if along >= size:
        return max(off - 2.0 * along + size, 0.0)
    return max(off - along * along / size, 0.0)


@compiled
def _grow(x: Indices, count: int) -> Indices:
    """Return the array, copied into a larger one if it has fewer entries than `count`."""
    if count <= x.shape[0]:
        return x
    more = np.empty(2 * count, np.int64)
    for i in range(x.shape[0]):
        more[i] = x[i]
    return more


@compiled
def _find_cheapest(z: Array, y: Array, room: float, most: int, cell: Indices) -> int:
    """Find the chord of z (m + 1, d) for every point y (k, d), into cell (k,), by dynamic programming.

    A state is a chord within `room` of the point. From one point to the next it crosses only vertices within `room` of the
    segment between the points. A step forwards is free; a step backwards costs `room` times the chord's length.
    """
    m, k, limit = z.shape[0] - 1, y.shape[0], room * room
    cost, new, origin = np.full(m, np.inf), np.full(m, np.inf), np.empty(m, np.int64)
    near, touched = np.zeros(m + 1, np.bool_), np.empty(m, np.int64)
    cells, before = np.empty(4 * k + m, np.int64), np.empty(4 * k + m, np.int64)
    count = 0
    for i in range(m):
        d = _distance2(y[0], z[i], z[i + 1])
        if d <= limit:
            cost[i] = d
            cells[count], before[count] = i, -1
            count += 1
    first, last = 0, count
    for row in range(1, k):
        number = _find_touched(z, y[row - 1], y[row], limit, cells[first:last], near, touched)
        for j in range(first, last):
            i = cells[j]
            new[i], origin[i] = cost[i], j
        for j in range(1, number):
            i = touched[j]
            if near[i] and touched[j - 1] == i - 1 and new[i - 1] < new[i]:
                new[i], origin[i] = new[i - 1], origin[i - 1]
        for j in range(number - 2, -1, -1):
            i = touched[j]
            if near[i + 1] and touched[j + 1] == i + 1:
                back = new[i + 1] + room * np.sqrt(_distance2(z[i], z[i + 1], z[i + 1]))
                if back < new[i]:
                    new[i], origin[i] = back, origin[i + 1]
        cells, before = _grow(cells, count + number), _grow(before, count + number)
        first = count
        for j in range(number):
            i = touched[j]
            d = _distance2(y[row], z[i], z[i + 1])
            if d <= limit and new[i] < np.inf:
                cost[i] = new[i] + d
                cells[count], before[count] = i, origin[i]
                count += 1
            new[i], near[i], near[i + 1] = np.inf, False, False
        last = count
        if count > most:
            return TOO_MANY
        if first == last:
            return TOO_FAR
    return _trace_back(cost, cells[:last], before, first, cell)


@compiled
def _trace_back(cost: Array, cells: Indices, before: Indices, first: int, cell: Indices) -> int:
    """Trace the cheapest sequence of states back to the start and write it into `cell`; return TOO_FAR if there is none."""
    if first == cells.shape[0]:
        return TOO_FAR
    at, least = first, np.inf
    for j in range(first, cells.shape[0]):
        if cost[cells[j]] < least:
            at, least = j, cost[cells[j]]
    for row in range(cell.shape[0] - 1, -1, -1):
        cell[row] = cells[at]
        at = before[at]
    return FOUND


@compiled
def _find_touched(z: Array, a: Array, b: Array, limit: float, active: Indices, near: Flags, touched: Indices) -> int:
    """Write the chords that the segment from a to b can reach from the active ones, in order, into `touched`; return how many.

    near[i] is set if vertex i is within the limit of the segment.
    """
    m, number, next_free = z.shape[0] - 1, 0, 0
    for i in active:
        if i < next_free:
            continue
        low = i
        while low > next_free and _distance2(z[low], a, b) <= limit:
            near[low] = True
            low -= 1
        for j in range(low, i + 1):
            touched[number] = j
            number += 1
        next_free = i + 1
        while next_free < m and _distance2(z[next_free], a, b) <= limit:
            near[next_free] = True
            touched[number] = next_free
            number += 1
            next_free += 1
    return number


# ---------------- positions along a path of a moving tool


CHORD_TURN = 0.1
"""Metres per radian: positions along a path are distinct also where only the rotation differs."""
BEND = 1e-5
"""Largest distance of the path from its chords, and of the tool between two instants from its chord [m]."""
CHORD_CELLS = 12
"""Least number of chords of a curved piece, which resolves also pieces shorter than `BEND`."""


def positions_along(path: Path, poses: Array, bend: float = BEND) -> Array:
    """Return the path parameters (k,) of a tool that moves through poses (k, 4, 4).

    The motion is projected onto the path as a whole, not pose by pose. Dynamic programming finds the sequence of adjacent
    chords with the least sum of squared distances. A step forwards is free, if the tool passes near every vertex between; a
    step backwards has a cost. So legs of a path that are close together, or cross, are distinguished by the order in time.
    """
    edges, off, z = _chords(path)
    found = find_positions(edges, z, np.ascontiguousarray(embed_poses(poses, CHORD_TURN)), bend + float(off.max()))
    return path.nearest(poses) if found is None else found


@lru_cache(maxsize=4)
def _chords(path: Path) -> tuple[Array, Array, Array]:
    """Return the chords of the path: their ends in s, the distance of the path from each, and their end points."""
    edges, off = chords(path, CHORD_TURN, BEND, CHORD_CELLS)
    return edges, off, np.ascontiguousarray(embed_poses(path.pose(edges), CHORD_TURN))


NEAREST_TURN = 1.0
"""Metres per radian in the distance to the path, by default: the ratio of the usual tolerances of position and rotation."""
PATH_STILL = 1e-6
"""Fraction of the path's greatest rate below which it is at standstill: at such a cusp no position is nearest."""
NEAREST_ENOUGH = 3e-14
"""Convergence tolerance of the nearest position, as a fraction of the path."""
CUSP, CUSP_PLACES, CUSPS_AT_ONCE = 0.5, 65, 1024
"""Fraction of the path's greatest rate below which a position may be at a cusp; number of positions searched around it; and
number of instants searched at once, which bounds the memory."""
BACK_TIME = 1e-2
"""Time [s] that converts the backward speed along the path into a distance."""
NEAREST_STEPS = 20
"""Largest number of Newton steps; one or two are usual."""
NOT_ALONG_PATH = 0.1
"""Distance [m, rad] from the path beyond which a motion is not along it."""
TOOL_ON_PATH = 1e-9
"""Distance [m, rad] to the path below which a position needs no further search."""


class PathPositions(NamedTuple):
    """Path parameters (k,) of the tool at instants, its speed along the path, and the path's poses and twists there.

    ``path_joints`` (k, 2, n) are the configurations of a path in joint space and their derivatives in s; else (k, 0, 0).
    """

    s: Array
    speed: Array
    poses: Array
    twist: Array
    path_joints: Array


class PathComparison(NamedTuple):
    """A motion compared with its path at s (k,): squared distances, Newton steps, speeds along the path, rates of the path.

    ``points`` and ``tangents`` are the path's poses and twists, or its configurations and their derivatives.
    """

    s: Array
    cost: Array
    step: Array
    speed: Array
    rate: Array
    points: Array
    tangents: Array


class Nearest:
    """Nearest positions along a path to a tool: Gauss–Newton steps, quartered if the distance increases.

    Any position gives a valid bound, and the nearest one the least. Near a cusp, where the path almost stops and turns back,
    several positions are equally near. Then a search around the guess selects the one where position and rotation agree and the
    tool moves forwards along the path.
    """

    def __init__(self, path: Path, turn: float = NEAREST_TURN) -> None:
        self._path, self._breaks, self._turn, self.asked = path, path.breaks, turn, path.asked
        rate, bend = self._measure()
        self._slow = CUSP * rate
        # Beside a straight piece, that of its neighbours counts.
        bend = np.where(bend > 1e-6 * self._slow, bend, np.inf)
        least = np.minimum(bend, np.minimum(np.append(bend[1:], np.inf), np.append(np.inf, bend[:-1])))
        self._width = np.minimum(np.sqrt(8.0 * BEND / least), path.end)

    def _measure(self) -> tuple[float, Array]:
        """Return the largest rate of the path, and its largest second derivative on each piece (k − 1,)."""
        bounds = self._path.known_bounds
        rate = bounds[:, :, 0].max(axis=0)
        self._still = float(PATH_STILL * np.hypot(rate[0], self._turn * rate[1])) ** 2
        bend = np.hypot(bounds[:, 0, 1], CHORD_TURN * (bounds[:, 1, 1] - bounds[:, 1, 0] ** 2))  # ‖R''‖ ≤ |ω'| + |ω|²
        return float(np.hypot(rate[0], CHORD_TURN * rate[1])), bend

    def guess(self, instants: Instants) -> Array:
        """Return the positions (k,) of a whole motion; see `positions_along`."""
        return positions_along(self._path, instants.poses, BEND)

    def track(self, instants: Instants) -> tuple[Array, Array, Array]:
        """Return the points (k, d) of a motion for the choice of its first instants, their velocities and accelerations."""
        return instants.poses[:, :3, 3], instants.twists[:, 0, :3], instants.twists[:, 1, :3]

    def places(self, instants: Instants, guess: Array) -> PathPositions:
        """Return the positions along the path that are nearest to a motion, near a guess."""
        target, guess = self._target(instants), np.clip(guess, 0.0, self._path.end)
        found = self._descend(target, guess)
        back = found.speed < -PATH_STILL * np.abs(found.speed).max()
        at = np.flatnonzero(
            (((found.rate < self._slow) & (found.cost > TOOL_ON_PATH**2)) | back) & (found.cost < NOT_ALONG_PATH**2)
        )
        for part in (at[i : i + CUSPS_AT_ONCE] for i in range(0, at.size, CUSPS_AT_ONCE)):
            some, before = tuple(x[part] for x in target), tuple(x[part] for x in found[-2:])
            better = self._descend(some, self._likeliest(some, guess[part]))
            nearer = self._misfit(some, *better[-2:]) < self._misfit(some, *before)
            for old, x in zip(found, better, strict=True):
                old[part[nearer]] = x[nearer]
        return self._positions(found)

    def _likeliest(self, target: tuple[Array, ...], guess: Array) -> Array:
        """Return the best of the positions around a guess (k,)."""
        piece = np.clip(np.searchsorted(self._breaks, guess, side="right") - 1, 0, self._width.size - 1)
        around = self._width[piece][:, None] * np.linspace(-1.0, 1.0, CUSP_PLACES)
        s = np.clip(guess[:, None] + around, 0.0, self._path.end)
        repeated = tuple(np.repeat(x, CUSP_PLACES, axis=0) for x in target)
        misfit = self._misfit(repeated, *self._frames(s.ravel())).reshape(s.shape)
        return np.asarray(s[np.arange(guess.size), misfit.argmin(axis=1)])

    def _descend(self, target: tuple[Array, ...], s: Array) -> PathComparison:
        """Return the comparison after Newton steps from a guess (k,)."""
        end = self._path.end
        found = self._compare(target, s)
        for _ in range(NEAREST_STEPS):
            after = np.clip(found.s + found.step, 0.0, end)
            if np.abs(after - found.s).max(initial=0.0) <= NEAREST_ENOUGH * end:
                break
            new = self._compare(target, after)
            nearer = new.cost <= 1.000001 * found.cost  # with rounding error
            if nearer.all():
                found = new
                continue
            found.step[:] *= 0.25
            for old, x in zip(found, new, strict=True):
                old[nearer] = x[nearer]
        return found

    def _target(self, instants: Instants) -> tuple[Array, ...]:
        """Return the arrays (k, ...) of a motion that are compared with the path."""
        return instants.poses, instants.twists

    def _frames(self, s: Array) -> tuple[Array, Array]:
        """Return the points of the path at s, and their derivatives."""
        return self._path.frames(s)

    def _compare(self, target: tuple[Array, ...], s: Array) -> PathComparison:
        """Compare a motion with the path at s (k,)."""
        (tool, twists), (poses, twist) = target, self._frames(s)
        found = np.empty((4, s.size))
        _step(tool, twists, poses, twist, (self._still, self._turn), found)
        return PathComparison(s.copy(), found[0], found[1], found[2], found[3], poses, twist)

    def _misfit(self, target: tuple[Array, ...], poses: Array, twist: Array) -> Array:
        """Return squared distances (k,) of position, rotation, and backward motion in `BACK_TIME`."""
        tool, twists = target
        weight = np.array([1.0, 1.0, 1.0, CHORD_TURN, CHORD_TURN, CHORD_TURN])
        off = embed_poses(tool, CHORD_TURN) - embed_poses(poses, CHORD_TURN)
        return _add_backward_motion(off, twist * weight, twists[:, 0] * weight)

    def _positions(self, found: PathComparison) -> PathPositions:
        """Return the positions along the path, with the path's poses and twists there."""
        return PathPositions(found.s, found.speed, found.points, found.tangents, np.empty((found.s.size, 0, 0)))


class NearestPoint(Nearest):
    """Nearest positions along a path that asks less than the pose: those of the tool's point alone."""

    def __init__(self, path: Path, turn: float) -> None:
        super().__init__(PointsOf(path, np.eye(3)), turn)
        self._asking, self.asked = path, path.asked

    def guess(self, instants: Instants) -> Array:
        """Return the positions (k,) of a whole motion."""
        return positions_along(self._path, self._target(instants)[0], BEND)

    def _target(self, instants: Instants) -> tuple[Array, ...]:
        return tuple(without_rotation(x, np.eye(3)) for x in (instants.poses, instants.twists))

    def _positions(self, found: PathComparison) -> PathPositions:
        poses, twist = self._asking.frames(found.s)
        return super()._positions(found)._replace(poses=poses, twist=twist)


BEND_SAMPLES = 17
"""Samples of the derivatives on each piece of a path in joint space, for the number of its chords."""


class NearestJoints(Nearest):
    """Nearest positions along a path in joint space to the joints of a motion."""

    def __init__(self, robot: Robot, path: Path) -> None:
        self._robot = robot
        super().__init__(path)

    def _joints(self, s: Array, order: int) -> Array:
        found = self._path.configurations(self._robot, s, order)
        assert found is not None
        return self._robot.spread(found, order)

    def _measure(self) -> tuple[float, Array]:
        s = (self._breaks[:-1, None] + np.diff(self._breaks)[:, None] * np.linspace(0.0, 1.0, BEND_SAMPLES)).ravel()
        rate, bend = (np.linalg.norm(self._joints(s, order), axis=1) for order in (1, 2))
        self._still = max(float(PATH_STILL * rate.max()), 1e-100)  # above 0 for joints that stay
        self._bend = bend.reshape(-1, BEND_SAMPLES).max(axis=1)
        return float(rate.max()), self._bend

    def guess(self, instants: Instants) -> Array:
        """Return the positions (k,) of a whole motion, by the search of `positions_along` in joint space."""
        length = np.diff(self._breaks)
        cells = np.clip(np.ceil(length * np.sqrt(self._bend / (8.0 * BEND))), 1, MOST_CELLS).astype(int)
        edges = divide_pieces(self._breaks, cells)
        off = float((self._bend * (length / cells) ** 2).max()) / 8.0
        z, q = np.ascontiguousarray(self._joints(edges, 0)), np.ascontiguousarray(instants.joints[:, 0])
        found = find_positions(edges, z, q, BEND + 2.0 * off)  # twice, since the second derivative is sampled
        return edges[np.linalg.norm(q[:, None] - z, axis=2).argmin(axis=1)] if found is None else found

    def track(self, instants: Instants) -> tuple[Array, Array, Array]:
        """Return the configurations (k, n) of a motion, their velocities and accelerations."""
        return instants.joints[:, 0], instants.joints[:, 1], instants.joints[:, 2]

    def _target(self, instants: Instants) -> tuple[Array, ...]:
        return instants.joints[:, 0], instants.joints[:, 1], instants.joints[:, 2]

    def _frames(self, s: Array) -> tuple[Array, Array]:
        return self._joints(s, 0), self._joints(s, 1)

    def _compare(self, target: tuple[Array, ...], s: Array) -> PathComparison:
        (q, velocity, acceleration), (at, q1) = target, self._frames(s)
        off, rate = q - at, (q1 * q1).sum(axis=1)
        size = np.maximum(rate, self._still**2)
        speed = (q1 * velocity).sum(axis=1) / size
        if (cusp := size <= self._still**2).any():  # q' = 0, so q̈ = q'' ṡ²
            q2 = self._joints(s[cusp], 2)
            along = (q2 * acceleration[cusp]).sum(axis=1) / np.maximum((q2 * q2).sum(axis=1), 1e-300)
            speed[cusp] = np.sqrt(np.maximum(along, 0.0))
        cost, step = (off * off).sum(axis=1), (off * q1).sum(axis=1) / size
        return PathComparison(s.copy(), cost, step, speed, np.sqrt(rate), at, q1)

    def _misfit(self, target: tuple[Array, ...], poses: Array, twist: Array) -> Array:
        return _add_backward_motion(target[0] - poses, twist, target[1])

    def _positions(self, found: PathComparison) -> PathPositions:
        joints = np.stack([found.points, found.tangents], axis=1)
        return PathPositions(found.s, found.speed, *self._path.frames(found.s), joints)


def make_nearest(robot: Robot, path: Path, turn: float) -> Nearest:
    """Return the search of positions along a path, by what it asks; `turn` [m/rad] weighs rotation against position."""
    if path.in_joints:
        return NearestJoints(robot, path)
    return Nearest(path, turn) if path.asked == "pose" else NearestPoint(path, turn)


def _add_backward_motion(off: Array, tangents: Array, rate: Array) -> Array:
    """Return the squares (k,) of distances (k, d), with the squared backward motion along the path in `BACK_TIME` added."""
    size = np.maximum(np.linalg.norm(tangents, axis=1), 1e-300)
    back = np.minimum(np.einsum("ki,ki->k", tangents, rate) / size, 0.0) * BACK_TIME
    return np.asarray((off * off).sum(axis=1) + back**2)


@compiled
def _step(tool: Array, twists: Array, poses: Array, twist: Array, how: tuple[float, float], out: Array) -> None:
    """Compute squared distances, Newton steps, speeds and rates of `PathComparison` (4, k) for a tool and its path.

    `how` is the least squared rate of the path, and the distance [m] as which a rotation of 1 rad counts.
    """
    still, turn = how
    e = np.empty(6)
    for k in range(tool.shape[0]):
        A, B = tool[k], poses[k]
        for i in range(3):
            e[i] = A[i, 3] - B[i, 3]
        # R_tool R_pathᵀ − its transpose, halved, as a vector
        e[3] = 0.5 * _skew(A, B, 2, 1)
        e[4] = 0.5 * _skew(A, B, 0, 2)
        e[5] = 0.5 * _skew(A, B, 1, 0)
        size, along, going, off, rate = still, 0.0, 0.0, 0.0, 0.0
        for i in range(6):
            weight = 1.0 if i < 3 else turn * turn
            w = twist[k, i]
            size += weight * w * w
            along += weight * w * e[i]
            going += weight * w * twists[k, 0, i]
            off += weight * e[i] * e[i]
            rate += w * w * (1.0 if i < 3 else CHORD_TURN * CHORD_TURN)
        out[0, k], out[1, k], out[2, k], out[3, k] = off, along / size, going / size, np.sqrt(rate)


@compiled
def _skew(A: Array, B: Array, i: int, j: int) -> float:
    """Return entry (i, j) minus entry (j, i) of A Bᵀ, of the rotations of two poses."""
    value = 0.0
    for m in range(3):
        value += A[i, m] * B[j, m] - A[j, m] * B[i, m]
    return value
