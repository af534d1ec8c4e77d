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
from planners.timing._free.programme import Place

ROOM_BEND = 0.05
"""Room x [m] at which the limited value 1 − 2 x / (x + ROOM_BEND) is 0: it is −1 far away, and 1 with no room left."""
FREE_ROOM = 1e3
"""Room [m] of what is not limited."""
NO_DIRECTION = 1e-12
"""Distance of axes [m] below which nothing tells where to move."""


class ClearanceLimits:
    """The least rooms required (K + 1, S) [m] of chosen pairs: slots (K + 1, S) are indices of `find_pairs`, or −1."""

    bends = 0

    def __init__(
        self, robot: Robot, scene: Scene, basis: Basis, free: Flags, slots: Indices, required: Array
    ) -> None:  # fmt: skip
        self._robot, self._bodies, self._basis, self._free = robot, bodies_of(robot, scene), basis, free
        self._margin, self._slots, self._required = scene.margin, slots, required
        self.count = slots.shape[1]
        self._slope = np.empty((*slots.shape, robot.n))

    def values(self, place: Place) -> Array:
        """Return the values (K + 1, count) for joints at the grid points; −1 where there is no limit."""
        room = np.empty(self._slots.shape)
        pair_rooms(self._robot.chain, self._bodies, place.path[0], self._margin, self._slots, room, self._slope)
        x = np.minimum(room - self._required, FREE_ROOM)
        self._slope *= (
            -2.0 * np.where(x > 0.0, ROOM_BEND / (np.maximum(x, 0.0) + ROOM_BEND) ** 2, 1.0 / ROOM_BEND)[..., None]
        )
        return np.asarray(1.0 - 2.0 * x / (np.maximum(x, 0.0) + ROOM_BEND))

    def write(self, _place: Place, joints: Array, _y: Array, columns: Array, _bends: Array, _begin: Indices) -> None:
        """Write the derivatives (K + 1, count, W) in the coefficients; of the values that were computed last."""
        values, first = self._basis.values[:, 0], self._basis.first
        slope = self._slope if joints.size == 0 else np.einsum("ksj,kdj->ksd", self._slope, joints[:, 0])
        D = slope.shape[2]
        window = (first[:, None] + np.arange(DEGREE + 1))[:, :, None] * D + np.arange(D)
        part = np.einsum("kb,ksd->ksbd", values, slope) * self._free[window][:, None]
        columns[:] = 0.0
        columns[:, :, : part.shape[2] * D] = part.reshape(*part.shape[:2], -1)


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
