"""Positions along a path of a moving tool: the whole motion as chords, then Gauss–Newton steps, and a search at cusps."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import Instants
from planners.paths._poses import chords, embed_poses
from planners.paths.base import Path

CHORD_TURN = 0.1
"""Metres per radian: positions along a path are distinct also where only the rotation differs."""
BEND = 1e-5
"""Largest distance of the path from its chords, and of the tool between two instants from its chord [m]."""
CHORD_CELLS = 12
"""Least number of chords of a curved piece, which resolves also pieces shorter than `BEND`."""
CHORD_ROOM, ROOM_FACTOR = 1e-4, 8.0
"""First search distance of the tool from the path's chords [m], and its growth factor if the search fails."""
MOST_PAIRS = 20_000_000
"""Largest number of pairs of an instant and a chord; a motion that needs more is far from its path."""


def positions_along(path: Path, poses: Array, bend: float = BEND) -> Array:
    """Return the path parameters (k,) of a tool that moves through poses (k, 4, 4).

    The motion is projected onto the path as a whole, not pose by pose. Dynamic programming finds the sequence of adjacent
    chords with the least sum of squared distances. A step forwards is free, if the tool passes near every vertex between; a
    step backwards has a cost. So legs of a path that are close together, or cross, are distinguished by the order in time.
    """
    edges, off, z = _chords(path)
    y = np.ascontiguousarray(embed_poses(poses, CHORD_TURN))
    cell, room = np.empty(len(poses), np.int64), CHORD_ROOM + 2.0 * (bend + float(off.max()))
    size = float(np.ptp(np.concatenate([z, y]), axis=0).sum())
    while True:
        found = _find_cheapest(z, y, room, MOST_PAIRS, cell)
        if found == FOUND:
            return _nearest_on_chords(edges, z, y, cell)
        if found == TOO_MANY or room > size:
            return path.nearest(poses)
        room *= ROOM_FACTOR


@lru_cache(maxsize=4)
def _chords(path: Path) -> tuple[Array, Array, Array]:
    """Return the chords of the path: their ends in s, the distance of the path from each, and their end points."""
    edges, off = chords(path, CHORD_TURN, BEND, CHORD_CELLS)
    return edges, off, np.ascontiguousarray(embed_poses(path.pose(edges), CHORD_TURN))


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
            cost[i] = np.inf
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


NEAREST_TURN = 1e-3
"""Metres per radian in the distance to the path: where the tool moves, its position decides."""
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
TOOL_ON_PATH = 1e-9
"""Distance [m, rad] to the path below which a position needs no further search."""


class PathPositions(NamedTuple):
    """Path parameters (k,) of the tool at instants, its speed along the path, and the path's poses and twists there."""

    s: Array
    speed: Array
    poses: Array
    twist: Array


class Nearest:
    """Nearest positions along a path to a tool: Gauss–Newton steps, quartered if the distance increases.

    Any position gives a valid bound, and the nearest one the least. Near a cusp, where the path almost stops and turns back,
    several positions are equally near. Then a search around the guess selects the one where position and rotation agree and the
    tool moves forwards along the path.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._breaks = path, path.breaks
        bounds = path.known_bounds
        rate = bounds[:, :, 0].max(axis=0)
        self._still = float(PATH_STILL * np.hypot(rate[0], NEAREST_TURN * rate[1])) ** 2
        self._slow = CUSP * float(np.hypot(rate[0], CHORD_TURN * rate[1]))
        bend = np.hypot(bounds[:, 0, 1], CHORD_TURN * (bounds[:, 1, 1] - bounds[:, 1, 0] ** 2))  # ‖R''‖ ≤ |ω'| + |ω|²
        # Beside a straight piece, that of its neighbours counts.
        bend = np.where(bend > 1e-6 * self._slow, bend, np.inf)
        least = np.minimum(bend, np.minimum(np.append(bend[1:], np.inf), np.append(np.inf, bend[:-1])))
        self._width = np.minimum(np.sqrt(8.0 * BEND / least), path.end)

    def places(self, instants: Instants, guess: Array) -> PathPositions:
        """Return the positions along the path that are nearest to a tool, near a guess."""
        guess = np.clip(guess, 0.0, self._path.end)
        found, cost = self._descend(instants.poses, instants.motion, guess)
        rate = np.hypot(
            np.linalg.norm(found.twist[:, :3], axis=1), CHORD_TURN * np.linalg.norm(found.twist[:, 3:], axis=1)
        )
        back = found.speed < -PATH_STILL * np.abs(found.speed).max()
        at = np.flatnonzero(((rate < self._slow) & (cost > TOOL_ON_PATH**2)) | back)
        for part in (at[i : i + CUSPS_AT_ONCE] for i in range(0, at.size, CUSPS_AT_ONCE)):
            tool, motion = instants.poses[part], instants.motion[part]
            better, _ = self._descend(tool, motion, self._likeliest(tool, motion, guess[part]))
            before = _misfit(tool, motion, found.poses[part], found.twist[part])
            nearer = _misfit(tool, motion, better.poses, better.twist) < before
            for old, x in zip(found, better, strict=True):
                old[part[nearer]] = x[nearer]
        return found

    def _likeliest(self, tool: Array, motion: Array, guess: Array) -> Array:
        """Return the best of the positions around a guess (k,)."""
        piece = np.clip(np.searchsorted(self._breaks, guess, side="right") - 1, 0, self._width.size - 1)
        around = self._width[piece][:, None] * np.linspace(-1.0, 1.0, CUSP_PLACES)
        s = np.clip(guess[:, None] + around, 0.0, self._path.end)
        poses, twist = self._path.frames(s.ravel())
        tool, motion = np.repeat(tool, CUSP_PLACES, axis=0), np.repeat(motion, CUSP_PLACES, axis=0)
        misfit = _misfit(tool, motion, poses, twist).reshape(s.shape)
        return np.asarray(s[np.arange(guess.size), misfit.argmin(axis=1)])

    def _descend(self, tool: Array, motion: Array, s: Array) -> tuple[PathPositions, Array]:
        """Return the positions after Newton steps from a guess (k,), and their squared distances."""
        path = self._path
        poses, twist = path.frames(s)
        cost, step, speed = np.empty((3, s.size))
        _step(tool, motion, poses, twist, self._still, cost, step, speed)
        for _ in range(NEAREST_STEPS):
            after = np.clip(s + step, 0.0, path.end)
            if np.abs(after - s).max(initial=0.0) <= NEAREST_ENOUGH * path.end:
                break
            new_poses, new_twist = path.frames(after)
            new_cost, new_step, new_speed = np.empty((3, s.size))
            _step(tool, motion, new_poses, new_twist, self._still, new_cost, new_step, new_speed)
            nearer = new_cost <= 1.000001 * cost  # with rounding error
            step = np.where(nearer, new_step, 0.25 * step)
            new = after, new_cost, new_speed, new_poses, new_twist
            if nearer.all():
                s, cost, speed, poses, twist = new
                continue
            s = s.copy()
            for old, x in zip((s, cost, speed, poses, twist), new, strict=True):
                old[nearer] = x[nearer]
        return PathPositions(s, speed, poses, twist), cost


JOINT_CELLS = 16
"""Chords of each piece of a path in joint space, along which the first positions are searched."""


class NearestJoints:
    """Positions along a path in joint space that are nearest to the joints of a motion, by Gauss–Newton steps."""

    def __init__(self, robot: Robot, path: Path) -> None:
        self._robot, self._path = robot, path

    def _joints(self, s: Array, order: int) -> Array:
        found = self._path.configurations(self._robot, s, order)
        assert found is not None
        return found

    def guess(self, q: Array) -> Array:
        """Return the positions (k,) of a whole motion q (k, n) on the path's chords, in order; see `positions_along`."""
        breaks, u = self._path.breaks, np.arange(JOINT_CELLS) / JOINT_CELLS
        edges = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * u).ravel(), breaks[-1])
        z, y, cell = np.ascontiguousarray(self._joints(edges, 0)), np.ascontiguousarray(q), np.empty(len(q), np.int64)
        middle = 0.5 * (z[1:] + z[:-1])
        off = float(np.linalg.norm(self._joints(0.5 * (edges[1:] + edges[:-1]), 0) - middle, axis=1).max())
        room, size = CHORD_ROOM + 4.0 * off, float(np.ptp(np.concatenate([z, y]), axis=0).sum())
        while _find_cheapest(z, y, room, MOST_PAIRS, cell) != FOUND:
            if room > size:
                return np.asarray(edges[np.linalg.norm(y[:, None] - z, axis=2).argmin(axis=1)])
            room *= ROOM_FACTOR
        return _nearest_on_chords(edges, z, y, cell)

    def places(self, instants: Instants, guess: Array) -> PathPositions:
        """Return the positions along the path that are nearest to the joints, near a guess."""
        q, rate, s = instants.joints[:, 0], instants.joints[:, 1], np.clip(guess, 0.0, self._path.end)
        for _ in range(NEAREST_STEPS):
            q1 = self._joints(s, 1)
            size = np.maximum((q1 * q1).sum(axis=1), PATH_STILL**2)
            after = np.clip(s + ((q - self._joints(s, 0)) * q1).sum(axis=1) / size, 0.0, self._path.end)
            step, s = float(np.abs(after - s).max(initial=0.0)), after
            if step <= NEAREST_ENOUGH * self._path.end:
                break
        q1 = self._joints(s, 1)
        speed = (q1 * rate).sum(axis=1) / np.maximum((q1 * q1).sum(axis=1), PATH_STILL**2)
        return PathPositions(s, speed, *self._path.frames(s))


def _misfit(tool: Array, motion: Array, poses: Array, twist: Array) -> Array:
    """Return squared distances (k,) of position, rotation, and backward motion in `BACK_TIME`."""
    weight = np.array([1.0, 1.0, 1.0, CHORD_TURN, CHORD_TURN, CHORD_TURN])
    along = np.einsum("ki,ki->k", twist * weight, motion[:, 0] * weight)
    size = np.linalg.norm(twist * weight, axis=1)
    back = np.minimum(along / np.maximum(size, 1e-300), 0.0) * BACK_TIME
    return np.asarray(((embed_poses(tool, CHORD_TURN) - embed_poses(poses, CHORD_TURN)) ** 2).sum(axis=1) + back**2)


@compiled
def _step(
    tool: Array, motion: Array, poses: Array, twist: Array, still: float, cost: Array, step: Array, speed: Array
) -> None:
    """Compute squared distances of tool poses from path poses, Newton steps along the path, and the tool's speed along it.

    A rotation of 1 rad counts as `NEAREST_TURN`.
    """
    e = np.empty(6)
    for k in range(tool.shape[0]):
        A, B = tool[k], poses[k]
        for i in range(3):
            e[i] = A[i, 3] - B[i, 3]
        # R_tool R_pathᵀ − its transpose, halved, as a vector
        e[3] = 0.5 * _skew(A, B, 2, 1)
        e[4] = 0.5 * _skew(A, B, 0, 2)
        e[5] = 0.5 * _skew(A, B, 1, 0)
        size, along, going, off = still, 0.0, 0.0, 0.0
        for i in range(6):
            weight = 1.0 if i < 3 else NEAREST_TURN * NEAREST_TURN
            w = twist[k, i]
            size += weight * w * w
            along += weight * w * e[i]
            going += weight * w * motion[k, 0, i]
            off += weight * e[i] * e[i]
        cost[k], step[k], speed[k] = off, along / size, going / size


@compiled
def _skew(A: Array, B: Array, i: int, j: int) -> float:
    """Return entry (i, j) minus entry (j, i) of A Bᵀ, of the rotations of two poses."""
    value = 0.0
    for m in range(3):
        value += A[i, m] * B[j, m] - A[j, m] * B[i, m]
    return value
