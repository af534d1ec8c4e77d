"""Distances to obstacles as limits on the coefficients of a path: a few pairs of shapes at each grid point."""

from __future__ import annotations

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain
from optik.scene import Scene
from optik.scene.contact import ROUND, SELF, Bodies, find_nearest, find_pairs, read_row, transform_point
from optik.types import Array, Flags, Indices
from planners.paths._spline import DEGREE, Basis
from planners.timing._free.programme import Place, Statics

ROOM_BEND = 0.05
"""Room x [m] at which the limited value 1 − 2 x / (x + ROOM_BEND) is 0: it is −1 far away, and 1 with no room left."""
FREE_ROOM = 1e3
"""Room [m] of what is not limited."""
SLOT_ROOM = 0.03
"""Room [m] below which a pair is limited."""
MOST_MEASURED = 0.3
"""Fraction of the pairs that are near the others' last rooms above which all are measured anew."""
NO_DIRECTION = 1e-12
"""Distance of axes [m] below which nothing tells where to move."""


class ClearanceLimits(Statics):
    """The rooms of a few pairs at each grid point: those in `slots` (K + 1, S), indices of `find_pairs` or −1 for none.

    required (K + 1, pairs) is the least room [m] of each pair, −infinity where it has none. No step ends where another pair has
    less. Pairs that come near take the place of farther ones.
    """

    bends = 0

    def __init__(self, robot: Robot, scene: Scene, basis: Basis, free: Flags, slots: Indices, required: Array) -> None:
        self._robot, self._bodies, self._basis, self._free = robot, bodies_of(robot, scene), basis, free
        self._margin, self._slots, self._required, self.count = scene.margin, slots.copy(), required, slots.shape[1]
        self._every = np.tile(np.arange(required.shape[1]), (len(required), 1))
        self._rooms, self._slope = np.empty(required.shape), np.empty((*slots.shape, robot.n))
        self._known, self._q = np.full(required.shape, -np.inf), np.zeros((len(required), robot.n))
        self._reach = find_reaches(robot)
        self._at: Place | None = None  # the joints that the derivatives belong to

    def allows(self, place: Place) -> bool:
        """Return whether every pair keeps its room."""
        self._measure(place.path[0])
        bad = self._rooms < self._required
        k, slot = np.nonzero(self._slots >= 0)
        bad[k, self._slots[k, slot]] = False  # limited by its slack
        return not bad.any()

    def _measure(self, q: Array) -> None:
        """Compute the rooms below `SLOT_ROOM`, and lower bounds on others: no joint moves a shape farther than its reach."""
        least = self._known - (np.abs(q - self._q) @ self._reach)[:, None]
        near = least < SLOT_ROOM
        if near.sum() > MOST_MEASURED * near.size:
            self._q, near = q.copy(), np.ones_like(near)
        width = int(near.sum(axis=1).max())
        order = np.argsort(~near, axis=1, kind="stable")[:, :width] if width < near.shape[1] else self._every
        room = np.empty(order.shape)
        pair_rooms(
            self._robot.chain, self._bodies, q, self._margin, np.ascontiguousarray(order), room, np.empty((0, 0, 0))
        )
        self._rooms = least
        np.put_along_axis(self._rooms, order, room, axis=1)
        if near.all():
            self._known = self._rooms.copy()

    def renew(self, place: Place) -> tuple[Indices, Indices]:
        """Give slots to the pairs that came near, after `allows` at this place."""
        near = (self._rooms < SLOT_ROOM) & np.isfinite(self._required)
        k, slot = np.nonzero(self._slots >= 0)
        near[k, self._slots[k, slot]] = False
        changed = []
        for point, pair in np.argwhere(near):
            held = self._slots[point]
            rooms = np.where(held < 0, np.inf, self._rooms[point, held])
            at = int(rooms.argmax())
            if rooms[at] > self._rooms[point, pair]:
                held[at] = pair
                changed.append((point, at))
        found = np.unique(np.array(changed, np.int64).reshape(-1, 2), axis=0)
        return found[:, 0], found[:, 1]

    def values(self, place: Place) -> Array:
        """Return the values (K + 1, count) for joints at the grid points; −1 where there is no limit."""
        room, self._at = np.empty(self._slots.shape), place
        pair_rooms(self._robot.chain, self._bodies, place.path[0], self._margin, self._slots, room, self._slope)
        required = np.take_along_axis(self._required, np.maximum(self._slots, 0), axis=1)
        room -= np.where(self._slots >= 0, required, 0.0)
        x = np.minimum(room, FREE_ROOM)
        self._slope *= (
            -2.0 * np.where(x > 0.0, ROOM_BEND / (np.maximum(x, 0.0) + ROOM_BEND) ** 2, 1.0 / ROOM_BEND)[..., None]
        )
        return np.asarray(1.0 - 2.0 * x / (np.maximum(x, 0.0) + ROOM_BEND))

    def write(self, place: Place, joints: Array, y: Array, columns: Array, bends: Array, begin: Indices) -> None:
        """Write the derivatives (K + 1, count, W) in the coefficients."""
        if self._at is not place:
            self.values(place)
        values, first = self._basis.values[:, 0], self._basis.first
        slope = self._slope if joints.size == 0 else np.einsum("ksj,kdj->ksd", self._slope, joints[:, 0])
        D = slope.shape[2]
        window = (first[:, None] + np.arange(DEGREE + 1))[:, :, None] * D + np.arange(D)
        part = np.einsum("kb,ksd->ksbd", values, slope) * self._free[window][:, None]
        columns[:] = 0.0
        columns[:, :, : part.shape[2] * D] = part.reshape(*part.shape[:2], -1)


def find_reaches(robot: Robot) -> Array:
    """Return how far a unit of each joint moves a shape at most (n,) [m/rad, 1]."""
    assert robot.shapes is not None
    link, a, b, _radius = robot.shapes.capsules
    lengths = np.linalg.norm(robot.fixed[:, :3, 3], axis=1)
    span = np.maximum(np.abs(robot.limits.lower), np.abs(robot.limits.upper))
    lengths += np.where(robot.prismatic & np.isfinite(span), span, 0.0)
    extents = np.maximum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1))
    reach = np.ones(robot.n)
    for j in np.flatnonzero(~robot.prismatic):
        behind = [lengths[j + 1 : m].sum() + extent for m, extent in zip(link, extents, strict=True) if m > j]
        reach[j] = max(behind, default=0.0)
    return reach


def bodies_of(robot: Robot, scene: Scene) -> Bodies:
    """Return the shapes of an arm and a scene, and the pairs that are checked, as arguments of kernels."""
    assert robot.shapes is not None
    return robot.shapes.capsules, scene.arrays, find_pairs(robot, scene).bodies


@compiled
def pair_rooms(
    chain: Chain, bodies: Bodies, q: Array, margin: float, slots: Indices, room: Array, slope: Array
) -> None:
    """Write the rooms of pairs at configurations, infinite for slot −1, and their derivatives in the joints unless empty.

    Shapes and units: q (k, n) [rad, m], margin [m], slots (k, s), room (k, s) [m], slope (k, s, n) [m/rad, 1].
    """
    (link, a, b, radius), scene, pairs = bodies
    n = q.shape[1]
    frame, places = np.empty((n, 4, 4)), np.empty((link.shape[0], 2, 3))
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        for m in range(link.shape[0]):
            places[m, 0, 0], places[m, 0, 1], places[m, 0, 2] = transform_point(frame, link[m], read_row(a, m))
            places[m, 1, 0], places[m, 1, 1], places[m, 1, 2] = transform_point(frame, link[m], read_row(b, m))
        for s in range(slots.shape[1]):
            room[k, s] = np.inf
            if slope.shape[0]:
                slope[k, s] = 0.0
            if slots[k, s] < 0:
                continue
            m, i, kind = pairs[slots[k, s], 0], pairs[slots[k, s], 1], pairs[slots[k, s], 2]
            distance, share, w = find_nearest((m, i, kind), scene, places)
            thick = radius[m] + (radius[i] if kind == SELF else margin + (scene[4][i] if kind == ROUND else 0.0))
            room[k, s] = distance - thick
            if not slope.shape[0] or abs(distance) < NO_DIRECTION:
                continue
            u0, u1, u2 = w[0] / distance, w[1] / distance, w[2] / distance
            x = places[m, 0, 0] + share * (places[m, 1, 0] - places[m, 0, 0])
            y = places[m, 0, 1] + share * (places[m, 1, 1] - places[m, 0, 1])
            z = places[m, 0, 2] + share * (places[m, 1, 2] - places[m, 0, 2])
            base = link[i] if kind == SELF else 0
            for j in range(base, link[m]):
                z0, z1, z2 = frame[j, 0, 2], frame[j, 1, 2], frame[j, 2, 2]
                if chain[1][j]:
                    slope[k, s, j] = u0 * z0 + u1 * z1 + u2 * z2
                else:
                    d0, d1, d2 = x - frame[j, 0, 3], y - frame[j, 1, 3], z - frame[j, 2, 3]
                    slope[k, s, j] = u0 * (z1 * d2 - z2 * d1) + u1 * (z2 * d0 - z0 * d2) + u2 * (z0 * d1 - z1 * d0)
