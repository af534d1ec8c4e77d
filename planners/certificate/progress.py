"""Where on its path a motion is, instant by instant: the cheapest way along the path's chords, in the order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.compiled import compiled
from optik.types import Array
from planners.certificate.bounds import Instants
from planners.paths._nearest import chords, embedded
from planners.paths.base import Path

Indices = NDArray[np.int64]

TURN = 0.1
"""Metres that a radian counts, to tell places of a path apart where only the rotation differs."""
BEND = 1e-5
"""How far the path may bend away from its chords, and the tool between two instants from its own [m]."""
CELLS = 12
"""Chords at least of a piece that bends: one that is shorter than what chords may be off has to be seen all the same."""
ROOM, WIDER = 1e-4, 8.0
"""How far the tool may be from the chords of its path [m], and how many times as far where it leaves them by more."""
MOST = 20_000_000
"""Pairs of an instant and a chord that are looked at; a motion that needs more is nowhere near its path."""

LITTLE = 1e-3
"""Metres that a radian counts to say which place is nearest: little where the position moves."""
STILL = 1e-6
"""Share of the path's greatest rate below which it stands still: there, at a cusp, no place is nearer than another."""
NEAR = 3e-14
"""How near to the nearest place of the path it is enough to be, as a share of the path."""
CUSP, AROUND, AT_ONCE = 0.5, 65, 1024
"""Share of the path's greatest rate below which a place may be at a cusp, how many places are looked at around it, and for how
many instants at a time."""
WHILE = 1e-2
"""Time [s] for which a tool that goes back along the path at a place counts as that far away from it."""
STEPS = 20
"""Most steps to the nearest place; one or two are usual."""
EXACT = 1e-9
"""A tool this near to its path [m, rad] is at the right place of it."""


class Places(NamedTuple):
    """Where on the path (k,) the tool is at some instants, how fast it goes there, and the path's pose and twist."""

    s: Array
    speed: Array
    poses: Array
    twist: Array


def places_along(path: Path, poses: Array, bend: float = BEND) -> Array:
    """Places (k,) on the path of a tool that moves through poses (k, 4, 4), none left out between two of them.

    The motion is put on the path as a whole, not pose by pose: among all ways to run through chords of the path one after
    the other while staying near them, the one with the least sum of squared distances (dynamic programming). Going on
    costs nothing and needs the tool to pass near every corner between; going back costs. So two legs of a path that lie
    close together, or cross, are told apart by the order in which the tool gets there.

    Parameters
    ----------
    path : Path
        With a length.
    poses : (k, 4, 4) array
        T_base_tool at successive instants.
    bend : float
        How far the tool may be from the straight way between two of them [m].

    Returns
    -------
    (k,) array
        Places in [0, end], exact but for the path's bend; where the tool is nowhere near, those that are nearest.
    """
    edges, off = chords(path, TURN, BEND, CELLS)
    z, y = (np.ascontiguousarray(embedded(T, TURN)) for T in (path.pose(edges), poses))
    cell, room = np.empty(len(poses), np.int64), ROOM + 2.0 * (bend + float(off.max()))
    size = float(np.ptp(np.concatenate([z, y]), axis=0).sum())
    while True:
        found = _cheapest(z, y, room, MOST, cell)
        if found == FOUND:
            return _within(edges, z, y, cell)
        if found == TOO_MANY or room > size:
            return path.nearest(poses)
        room *= WIDER


def _within(edges: Array, z: Array, y: Array, cell: Indices) -> Array:
    """Places (k,) on the chords of given cells that are nearest to points y."""
    a, e = z[cell], z[cell + 1] - z[cell]
    size = np.einsum("ij,ij->i", e, e)
    part = np.einsum("ij,ij->i", y - a, e) / np.where(size > 0.0, size, 1.0)
    return np.asarray(edges[cell] + np.clip(part, 0.0, 1.0) * (edges[cell + 1] - edges[cell]))


FOUND, TOO_FAR, TOO_MANY = range(3)


@compiled
def _distance2(x: Array, a: Array, b: Array) -> float:
    """Squared distance of a point from the chord between two others."""
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
def _grown(x: Indices, count: int) -> Indices:
    """The same array with room for so many entries."""
    if count <= x.shape[0]:
        return x
    more = np.empty(2 * count, np.int64)
    more[: x.shape[0]] = x
    return more


@compiled
def _cheapest(z: Array, y: Array, room: float, most: int, cell: Indices) -> int:
    """Dynamic programming: the chord of z (m + 1, d) of every point y (k, d), into cell (k,).

    A state is a chord within `room` of the point. From one point to the next it stays or goes over vertices that the way
    between the points passes within `room`: on for nothing, back for `room` times the chord's length.
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
        number = _touched(z, y[row - 1], y[row], limit, cells[first:last], near, touched)
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
        cells, before = _grown(cells, count + number), _grown(before, count + number)
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
    if first == last:
        return TOO_FAR
    at, least = first, np.inf
    for j in range(first, last):
        if cost[cells[j]] < least:
            at, least = j, cost[cells[j]]
    for row in range(k - 1, -1, -1):
        cell[row] = cells[at]
        at = before[at]
    return FOUND


@compiled
def _touched(
    z: Array, a: Array, b: Array, limit: float, active: Indices, near: NDArray[np.bool_], touched: Indices
) -> int:
    """Chords that the way from a to b may reach from the active ones, in order, into `touched`; how many.

    near[i] is set where vertex i lies within the limit of that way.
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


# ---------------------------------------------------------------- the nearest place around


class Nearest:
    """Nearest places of a path to a tool: Gauss and Newton's steps, quartered where they lead away.

    Any place gives a true bound, and the nearest the least. Around a cusp, where the path all but stands still and turns back,
    several places are equally near; the one is looked for, among places around the guess, where position and rotation agree and
    the tool moves forwards along the path.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._breaks = path, path.breaks
        bounds = path.piece_bounds()
        rate = bounds[:, :, 0].max(axis=0)
        self._still = float(STILL * np.hypot(rate[0], LITTLE * rate[1])) ** 2  # at a cusp nothing tells
        self._slow = CUSP * float(np.hypot(rate[0], TURN * rate[1]))
        bend = np.hypot(bounds[:, 0, 1], TURN * (bounds[:, 1, 1] - bounds[:, 1, 0] ** 2))  # ‖R''‖ ≤ |ω'| + |ω|²
        bend = np.where(
            bend > 1e-6 * self._slow, bend, np.inf
        )  # around a straight piece it is a corner beside it that counts
        least = np.minimum(bend, np.minimum(np.append(bend[1:], np.inf), np.append(np.inf, bend[:-1])))
        self._width = np.minimum(np.sqrt(8.0 * BEND / least), path.end)

    def places(self, instants: Instants, guess: Array) -> Places:
        """Places near a guess (k,)."""
        guess = np.clip(guess, 0.0, self._path.end)
        found, cost = self._descend(instants.poses, instants.motion, guess)
        rate = np.hypot(np.linalg.norm(found.twist[:, :3], axis=1), TURN * np.linalg.norm(found.twist[:, 3:], axis=1))
        back = found.speed < -STILL * np.abs(found.speed).max()
        at = np.flatnonzero(((rate < self._slow) & (cost > EXACT**2)) | back)
        for part in (at[i : i + AT_ONCE] for i in range(0, at.size, AT_ONCE)):
            tool, motion = instants.poses[part], instants.motion[part]
            better, _ = self._descend(tool, motion, self._likeliest(tool, motion, guess[part]))
            before = _misfit(tool, motion, found.poses[part], found.twist[part])
            nearer = _misfit(tool, motion, better.poses, better.twist) < before
            for old, x in zip(found, better, strict=True):
                old[part[nearer]] = x[nearer]
        return found

    def _likeliest(self, tool: Array, motion: Array, guess: Array) -> Array:
        """Of places around a guess (k,), those that fit best."""
        piece = np.clip(np.searchsorted(self._breaks, guess, side="right") - 1, 0, self._width.size - 1)
        around = self._width[piece][:, None] * np.linspace(-1.0, 1.0, AROUND)
        s = np.clip(guess[:, None] + around, 0.0, self._path.end)
        poses, twist = self._path.frames(s.ravel())
        tool, motion = np.repeat(tool, AROUND, axis=0), np.repeat(motion, AROUND, axis=0)
        misfit = _misfit(tool, motion, poses, twist).reshape(s.shape)
        return np.asarray(s[np.arange(guess.size), misfit.argmin(axis=1)])

    def _descend(self, tool: Array, motion: Array, s: Array) -> tuple[Places, Array]:
        """Places from a guess (k,), and their squared distances."""
        path = self._path
        poses, twist = path.frames(s)
        cost, step, speed = np.empty((3, s.size))
        _step(tool, motion, poses, twist, self._still, cost, step, speed)
        for _ in range(STEPS):
            after = np.clip(s + step, 0.0, path.end)
            if np.abs(after - s).max(initial=0.0) <= NEAR * path.end:
                break
            new_poses, new_twist = path.frames(after)
            new_cost, new_step, new_speed = np.empty((3, s.size))
            _step(tool, motion, new_poses, new_twist, self._still, new_cost, new_step, new_speed)
            nearer = new_cost <= 1.000001 * cost  # and what rounding may add
            step = np.where(nearer, new_step, 0.25 * step)
            new = after, new_cost, new_speed, new_poses, new_twist
            if nearer.all():
                s, cost, speed, poses, twist = new
                continue
            s = s.copy()
            for old, x in zip((s, cost, speed, poses, twist), new, strict=True):
                old[nearer] = x[nearer]
        return Places(s, speed, poses, twist), cost


def _misfit(tool: Array, motion: Array, poses: Array, twist: Array) -> Array:
    """Squared distances (k,) by position and rotation together, and how far the tool goes back along the path in `WHILE`."""
    weight = np.array([1.0, 1.0, 1.0, TURN, TURN, TURN])
    along = np.einsum("ki,ki->k", twist * weight, motion[:, 0] * weight)
    size = np.linalg.norm(twist * weight, axis=1)
    back = np.minimum(along / np.maximum(size, 1e-300), 0.0) * WHILE
    return np.asarray(((embedded(tool, TURN) - embedded(poses, TURN)) ** 2).sum(axis=1) + back**2)


@compiled
def _step(
    tool: Array, motion: Array, poses: Array, twist: Array, still: float, cost: Array, step: Array, speed: Array
) -> None:
    """Squared distances of poses of the tool from those of the path, steps along the path to less, and the tool's speed.

    A turn of 1 rad counts as `LITTLE`; along the path means by position, and by rotation where the position stands.
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
            weight = 1.0 if i < 3 else LITTLE * LITTLE
            w = twist[k, i]
            size += weight * w * w
            along += weight * w * e[i]
            going += weight * w * motion[k, 0, i]
            off += weight * e[i] * e[i]
        cost[k], step[k], speed[k] = off, along / size, going / size


@compiled
def _skew(A: Array, B: Array, i: int, j: int) -> float:
    """Entry (i, j) of A Bᵀ minus entry (j, i), of their rotations."""
    value = 0.0
    for m in range(3):
        value += A[i, m] * B[j, m] - A[j, m] * B[i, m]
    return value
