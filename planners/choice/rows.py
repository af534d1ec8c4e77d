"""Obstacles and via points as limits on the coefficients of a joint path, at the grid points before them."""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik import kinematics, se3
from optik.arm.robot import Robot
from optik.compiled import compiled, inlined
from optik.kinematics import Chain, Triple
from optik.scene import Scene
from optik.scene.contact import (
    HULLS_FROM,
    ROUND,
    SELF,
    Bodies,
    bodies_of,
    bound_distance,
    find_nearest,
    length_between,
    middle_of,
    read_row,
    refine,
    transform_point,
)
from optik.scene.distance import DISTANCE_ROUNDING
from optik.types import Array, Flags, Indices
from planners.choice.programme import ChoicePlace, Statics
from planners.paths.control_curve import DEGREE, PASSED, Basis
from planners.paths.point_to_point import PointToPoint, Via
from planners.paths.poses import skew_vector

# ---------------- distances to obstacles as limits on the coefficients of a path


ROOM_BEND = 0.05
"""Clearance x [m] at which the constraint value 1 − 2 x / (x + ROOM_BEND) is 0: it is −1 far away, and 1 without clearance."""
FREE_ROOM = 1e3
"""Clearance [m] that stands for "not limited"."""
SLOT_ROOM = 0.03
"""Clearance [m] below which a pair is limited."""
BLOCK = 32
"""Number of pairs of a capsule that are skipped together."""
NO_DIRECTION = 1e-12
"""Distance of axes [m] below which the gradient direction is undefined."""
NO_PAIRS = np.empty((0, 0), np.int64)
"""No pairs that are left out."""


class NearPairs:
    """The pairs of shapes with little clearance at each of some configurations, from one step of them to the next.

    The clearance, called room in the code, is the distance minus the required margin. A lower bound on each room is known from
    the last time, or else from the configuration before, and how far the ends of each capsule have moved since. A room is
    computed where this bound, and one from a sphere around the capsule, do not suffice. A block of pairs of one capsule with
    objects is skipped if its least bound suffices; those of two links are skipped if spheres around the links are far apart.
    """

    def __init__(self, robot: Robot, scene: Scene, count: int) -> None:
        self._chain, self._bodies, self._margin = robot.chain, bodies_of(robot, scene), scene.margin
        capsules, pairs, self.count = len(self._bodies[0][0]), len(self._bodies[2]), count
        frames = np.zeros((count, len(robot.fixed) if len(self._bodies[3][0]) else 0, 4, 4))
        self._memory = np.zeros((count, capsules, 2, 3)), np.zeros((count, capsules)), np.zeros((count, pairs)), frames
        (link, a, b, radius), (body, other, kind) = self._bodies[0], self._bodies[2].T
        own = kind == SELF
        owner = np.where(own, -1 - (len(robot.fixed) + 1) * link[body] - link[np.where(own, other, 0)], body)
        starts = ((np.arange(pairs) % BLOCK == 0) & ~own) | (np.diff(owner, prepend=-1) != 0)
        self._balls = np.zeros((len(robot.fixed) + 1, 4))
        for i in np.unique(link):
            ends, thick = np.concatenate([a[link == i], b[link == i]]), np.tile(radius[link == i], 2)
            centre = 0.5 * (ends.min(axis=0) + ends.max(axis=0))
            self._balls[i] = *centre, (np.linalg.norm(ends - centre, axis=1) + thick).max()
        self._blocks = np.append(np.flatnonzero(starts), pairs)
        self._least, size = np.full((count, self._blocks.size - 1), -np.inf), count * pairs
        self._found = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size)

    def find(self, q: Array, within: float, besides: Indices = NO_PAIRS) -> tuple[Indices, Indices, Array]:
        """Return the pairs with less room than a bound ≥ 0 [m], sorted by configuration: configurations, pairs, and rooms.

        Pairs in `besides` (count, S) are left out at their configuration.
        """
        blocks, q = (self._blocks, self._least, self._balls, besides), np.ascontiguousarray(q)
        count = find_near(self._chain, self._bodies, q, self._margin, within, self._memory, blocks, self._found)
        k, pair, room = self._found
        return k[:count].copy(), pair[:count].copy(), room[:count].copy()


class ClearanceLimits(Statics):
    """The rooms of a few pairs at each grid point: those in `slots` (K + 1, S), indices of `find_pairs` or −1 for none.

    required (K + 1, C) is the least room [m], below `SLOT_ROOM`, or −infinity if there is none; column (pairs,) is the place of
    each pair in it. No step ends where another pair has less. Pairs that come near take the place of farther ones.
    """

    bends = 0

    def __init__(
        self, robot: Robot, scene: Scene, basis: Basis, free: Flags, slots: Indices, required: Array, column: Indices,
        pairs: NearPairs | None = None,
    ) -> None:  # fmt: skip
        self._robot, self._bodies, self._basis, self._free = robot, bodies_of(robot, scene), basis, free
        self._margin, self._slots, self.count = scene.margin, slots.copy(), slots.shape[1]
        self._required, self._column = required, column
        self._pairs = pairs or NearPairs(robot, scene, len(required))
        self._room, self._slope = np.empty(slots.shape), np.empty((*slots.shape, robot.n))
        self._at: ChoicePlace | None = None  # the joints that the rooms of the slots and their derivatives belong to
        # pairs without a slot that are near there
        self._near: tuple[ChoicePlace, Indices, Indices, Array] | None = None

    def allows(self, place: ChoicePlace) -> bool:
        """Return whether every pair has its required room."""
        k, pair, room = self._pairs.find(place.path[0], SLOT_ROOM, self._slots)  # those are limited by their slacks
        self._near = place, k, pair, room
        return not bool((room < self._required[k, self._column[pair]]).any())

    def renew(self, place: ChoicePlace) -> tuple[Indices, Indices]:
        """Give slots to the pairs that came near."""
        if self._near is None or self._near[0] is not place:
            self.allows(place)
        if self._at is not place:
            self.values(place)
        assert self._near is not None
        changed = []
        for k, pair, room in zip(*self._near[1:], strict=True):
            slot = int(self._room[k].argmax())
            if self._room[k, slot] > room and np.isfinite(self._required[k, self._column[pair]]):
                self._slots[k, slot], self._room[k, slot] = pair, room
                changed.append((k, slot))
        found = np.unique(np.array(changed, np.int64).reshape(-1, 2), axis=0)
        return found[:, 0], found[:, 1]

    def values(self, place: ChoicePlace) -> Array:
        """Return the values (K + 1, count) for joints at the grid points; −1 where there is no limit."""
        self._at = place
        pair_rooms(self._robot.chain, self._bodies, place.path[0], self._margin, self._slots, self._room, self._slope)
        required = np.take_along_axis(self._required, self._column[self._slots], axis=1)
        x = np.minimum(self._room - np.where(self._slots >= 0, required, 0.0), FREE_ROOM)
        fall = np.where(x > 0.0, ROOM_BEND / (np.maximum(x, 0.0) + ROOM_BEND) ** 2, 1.0 / ROOM_BEND)
        self._slope *= -2.0 * fall[..., None]
        return np.asarray(1.0 - 2.0 * x / (np.maximum(x, 0.0) + ROOM_BEND))

    def write(self, place: ChoicePlace, joints: Array, y: Array, columns: Array, bends: Array, begin: Indices) -> None:
        """Write the derivatives (K + 1, count, W) in the coefficients."""
        if self._at is not place:
            self.values(place)
        values, first = self._basis.values[:, 0], self._basis.first
        slope = self._slope if joints.size == 0 else np.einsum("ksj,kdj->ksd", self._slope, joints[:, 0])
        D = slope.shape[2]
        window = (first[:, None] + np.arange(DEGREE + 1))[:, :, None] * D + np.arange(D)
        part = np.einsum("kb,ksd->ksbd", values, slope) * self._free[window][:, None]
        columns[:] = 0.0
        columns[:, :, : part.shape[2] * D] = part.reshape(*part.shape[:2], part.shape[2] * D)


@compiled
def pair_rooms(
    chain: Chain, bodies: Bodies, q: Array, margin: float, slots: Indices, room: Array, slope: Array
) -> None:
    """Write the rooms of pairs at configurations, infinite for slot −1, and their derivatives in the joints unless empty.

    Shapes and units: q (k, n) [rad, m], margin [m], slots (k, s), room (k, s) [m], slope (k, s, n) [m/rad, 1].
    """
    (link, a, b, radius), scene, pairs, hulls = bodies
    frame, places = np.empty((chain[0].shape[0], 4, 4)), np.empty((link.shape[0], 2, 3))
    seeds = np.full((slots.shape[1], 2, 4), -1.0)
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
            u0, u1, u2 = w[0] / distance, w[1] / distance, w[2] / distance
            x = places[m, 0, 0] + share * (places[m, 1, 0] - places[m, 0, 0])
            y = places[m, 0, 1] + share * (places[m, 1, 1] - places[m, 0, 1])
            z = places[m, 0, 2] + share * (places[m, 1, 2] - places[m, 0, 2])
            finer = -1.0
            if room[k, s] <= HULLS_FROM and hulls[0].shape[0] > 0:
                finer, normal, point = refine((m, i, kind), scene, hulls, frame, np.inf, seeds[s])
                least = finer - (margin if kind != SELF else 0.0)
                if finer > 0.0 and least > room[k, s]:
                    room[k, s], (u0, u1, u2), (x, y, z) = least, normal, point
            if not slope.shape[0] or (finer <= 0.0 and abs(distance) < NO_DIRECTION):
                continue
            base = link[i] if kind == SELF else 0
            for j in range(base, link[m]):
                z0, z1, z2 = frame[j, 0, 2], frame[j, 1, 2], frame[j, 2, 2]
                if chain[1][j]:
                    rate = u0 * z0 + u1 * z1 + u2 * z2
                else:
                    d0, d1, d2 = x - frame[j, 0, 3], y - frame[j, 1, 3], z - frame[j, 2, 3]
                    rate = u0 * (z1 * d2 - z2 * d1) + u1 * (z2 * d0 - z0 * d2) + u2 * (z0 * d1 - z1 * d0)
                of, factor = kinematics.axis_of(chain, j)
                slope[k, s, of] += factor * rate


@inlined
def _turn_between(a: Array, b: Array) -> float:
    """Return how far a unit vector moves at most between two frames (4, 4): the norm of the difference of the rotations."""
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += (b[i, j] - a[i, j]) ** 2
    return sqrt(0.5 * square)


@inlined
def _measure_turns(frame: Array, frames: Array, k: int, turned: Array) -> None:
    """Write how far links turned since their frames were remembered, and since those of the configuration before."""
    for j in range(frames.shape[1]):
        turned[0, j + 1] = _turn_between(frames[k, j], frame[j])
        frames[k, j] = frame[j]
        turned[1, j + 1] = _turn_between(frames[max(k - 1, 0), j], frame[j])


@inlined
def _room_of(
    pair: tuple[int, int, int], at: tuple[Array, Array, Array, Array], bodies: Bodies, margin: float, within: float
) -> float:
    """Return the room of a pair, or a lower bound on it if that is at least `within`; at: places, spheres, frames, a seed."""
    (_link, _a, _b, radius), scene, _pairs, hulls = bodies
    (m, i, kind), (places, spheres, frame, seed) = pair, at
    thick = radius[m] + (radius[i] if kind == SELF else margin + (scene[4][i] if kind == ROUND else 0.0))
    room = bound_distance(read_row(spheres, m), spheres[m, 3], kind, i, scene, spheres) - thick
    if room < within:
        room = find_nearest(pair, scene, places)[0] - thick
        if room <= HULLS_FROM and hulls[0].shape[0] > 0:
            finer = refine(pair, scene, hulls, frame, within + margin + SLOT_ROOM, seed)[0]
            if finer > 0.0:
                room = max(room, finer - (margin if kind != SELF else 0.0))
    return float(room)


@compiled
def _move(ends: Array, u: Triple, v: Triple) -> float:
    """Return how far an axis moves at most: from its ends (2, 3) to u and v."""
    return max(length_between(read_row(ends, 0), u), length_between(read_row(ends, 1), v))


@compiled
def _room_of_balls(frame: Array, balls: Array, m: int, i: int) -> float:
    """Return the room between the spheres around the shapes of two links."""
    u, v = transform_point(frame, m, read_row(balls, m)), transform_point(frame, i, read_row(balls, i))
    return float(length_between(u, v) - balls[m, 3] - balls[i, 3])


@compiled
def find_near(
    chain: Chain, bodies: Bodies, q: Array, margin: float, within: float,
    memory: tuple[Array, Array, Array, Array], blocks: tuple[Indices, Array, Array, Indices],
    found: tuple[Indices, Indices, Array],
) -> int:  # fmt: skip
    """Find the pairs with less room than a bound, and return their number.

    memory (updated): ends of the capsules (k, m, 2, 3), how far each has moved (k, m), a lower bound on the room of each pair
    plus the distance that its capsules had moved then (k, pairs) [m], or 0, and with hulls the frames of the joints
    (k, n, 4, 4). blocks: where the blocks of pairs begin, the least of these bounds in each (k, blocks) (updated), spheres
    around the shapes of each link (n + 1, 4), pairs left out. found (written): configurations, pairs, rooms.

    Shapes and units: q (k, n) [rad, m], margin, within [m].
    """
    (link, a, b, radius), _scene, pairs, _hulls = bodies
    (places, moved, known, frames), (begin, least, balls, besides) = memory, blocks
    frame, spheres, count = np.empty((chain[0].shape[0], 4, 4)), np.empty((link.shape[0], 4)), 0
    turned = np.zeros((2, chain[0].shape[0] + 1))
    seeds, ahead = np.full((pairs.shape[0] if frames.shape[1] > 0 else 1, 2, 4), -1.0), np.zeros(link.shape[0])
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        at, last = places[k], max(k - 1, 0)
        _measure_turns(frame, frames, k, turned)
        for m in range(link.shape[0]):
            u, v = transform_point(frame, link[m], read_row(a, m)), transform_point(frame, link[m], read_row(b, m))
            thick = radius[m] + DISTANCE_ROUNDING if frames.shape[1] > 0 else 0.0
            moved[k, m] += _move(at[m], u, v) + thick * turned[0, link[m]]
            at[m, 0, 0], at[m, 0, 1], at[m, 0, 2] = u
            at[m, 1, 0], at[m, 1, 1], at[m, 1, 2] = v
            spheres[m, 0], spheres[m, 1], spheres[m, 2] = middle_of(u, v)
            spheres[m, 3] = 0.5 * length_between(u, v)
            step = _move(places[last, m], u, v) + thick * turned[1, link[m]]
            ahead[m] = moved[k, m] - moved[last, m] - step  # added to a bound of the configuration before: one of this
        for block in range(least.shape[1]):
            first, lowest, m = begin[block], np.inf, pairs[begin[block], 0]
            if pairs[first, 2] == SELF:
                free = _room_of_balls(frame, balls, link[m], link[pairs[first, 1]])
            else:
                least[k, block] = max(least[k, block], least[last, block] + ahead[m])
                free = least[k, block] - moved[k, m]
            if free >= within:
                continue
            for p in range(first, begin[block + 1]):
                m, i, kind = pairs[p, 0], pairs[p, 1], pairs[p, 2]
                way = moved[k, m] + (moved[k, i] if kind == SELF else 0.0)
                if known[k, p] == 0.0 and k > 0 and known[k - 1, p] != 0.0:
                    known[k, p] = known[k - 1, p] + ahead[m] + (ahead[i] if kind == SELF else 0.0)
                if known[k, p] == 0.0 or known[k, p] - way < within:
                    if besides.shape[0] > 0 and (besides[k] == p).any():
                        lowest = -np.inf
                        continue
                    seed = seeds[min(p, seeds.shape[0] - 1)]
                    room = _room_of((m, i, kind), (at, spheres, frame, seed), bodies, margin, within)
                    known[k, p] = room + way
                    if room < within:
                        found[0][count], found[1][count], found[2][count], count = k, p, room, count + 1
                lowest = min(lowest, known[k, p])
            least[k, block] = lowest
    return count


# ---------------- via points as limits on the coefficients of a joint path


EXACT_WITHIN = 1e-6
"""Half width of the limits on each joint at a via configuration that is passed exactly [rad, m]; the residual is removed."""
VIA_FRACTION = 0.999
"""Fraction of a via point's tolerance that its path may use; the error of the motion uses the remaining part."""
PASSING_STEPS = 10
"""Most Newton steps onto the via points."""


class ViaLimits(Statics):
    """Limits at via points: √(1 + 3 x²) − 1 with x = distance / tolerance and angle / tolerance; if exact, each joint.

    Each via point stands at the grid point before it, whose window has all coefficients of its span.
    """

    def __init__(self, robot: Robot, path: PointToPoint, s: Array) -> None:
        self._robot, self._vias, self._size = robot, path.vias, s.size
        self._moves = robot.limits.lower < robot.limits.upper  # a locked joint's control points are given
        at = np.array([via.s for via in path.vias])
        self._rows = np.clip(np.searchsorted(s, at, side="right") - 1, 0, s.size - 2)
        self._basis = path.spline.basis(at)
        self.bends = 6 if any(via.tolerance is not None for via in path.vias) else 0
        self.count = max((2 if via.tolerance is not None else robot.n for via in path.vias), default=0)

    def values(self, place: ChoicePlace) -> Array:
        """Return the values (K + 1, count); 0 where there is no limit."""
        out, q = np.zeros((self._size, self.count)), self._basis.combine(place.p)[:, 0]
        for via, row, x in zip(self._vias, self._rows, q, strict=True):
            found = self._limit(via, x)[0]
            out[row, : found.size] = found
        return out

    def write(self, place: ChoicePlace, joints: Array, y: Array, columns: Array, bends: Array, begin: Indices) -> None:
        """Write the derivatives (K + 1, count, W) in the control points, and the factors of curvature (K + 1, 6, W)."""
        p = place.p
        columns[:], bends[:], n, q = 0.0, 0.0, p.shape[1], self._basis.combine(p)[:, 0]
        for i, (via, row, x) in enumerate(zip(self._vias, self._rows, q, strict=True)):
            _value, slope, bend = self._limit(via, x)
            for b in range(DEGREE + 1):
                point = int(self._basis.first[i]) + b
                if not 0 < point < len(p) - 1:  # start and goal are given
                    continue
                at, weight = point * n - int(begin[row]), self._basis.values[i, 0, b]
                columns[row, : len(slope), at : at + n] = weight * slope * self._moves
                for part, factor in enumerate(bend):
                    force = np.sqrt(max(float(y[row, part]), 0.0))
                    bends[row, 3 * part : 3 * part + 3, at : at + n] = force * weight * factor * self._moves

    def _limit(self, via: Via, q: Array) -> tuple[Array, Array, tuple[Array, ...]]:
        """Return the values of a via point, their derivatives in q (k, n), and factors (3, n) of their curvature."""
        if via.tolerance is None:
            return (q - via.q) / EXACT_WITHIN, np.eye(q.size) / EXACT_WITHIN, ()
        pose, J, inside = self._robot.fk(q), self._robot.jacobian(q), via.tolerance.scale(VIA_FRACTION)
        M = pose[:3, :3] @ via.pose[:3, :3].T
        parts = (
            (pose[:3, 3] - via.pose[:3, 3], inside.position, J[:3]),
            (0.5 * skew_vector(M[None])[0], np.sqrt(2.0 * (1.0 - np.cos(min(inside.rotation, np.pi)))), J[3:]),
        )
        squares = np.array([parts[0][0] @ parts[0][0] / parts[0][1] ** 2, (3.0 - np.trace(M)) / parts[1][1] ** 2])
        root, slopes, bends = np.sqrt(1.0 + 3.0 * squares), [], []
        for (off, most, rows), r, square in zip(parts, root, squares, strict=True):
            u = off / most  # the Hessian is 3/r Jᵀ (I − 3 u uᵀ / r²) J over the square of the tolerance
            slopes.append(3.0 / (most * r) * u @ rows)
            b = (1.0 - 1.0 / r) / square if square > 0.0 else 1.5
            bends.append(np.sqrt(3.0 / r) / most * (rows - b * np.outer(u, u @ rows)))
        return root - 1.0, np.stack(slopes), tuple(bends)


def pass_through(path: PointToPoint, p: Array) -> Array:
    """Return control points whose path passes all via points, by the least change of the inner ones."""
    limits, out = path.robot.limits, p.copy()
    out[1:-1] = limits.clip(out[1:-1])
    if not path.vias:
        return out
    at = np.array([via.s for via in path.vias])
    basis = path.spline.basis(at)
    for step in range(PASSING_STEPS):
        q = basis.combine(out)[:, 0]
        wanted = np.stack([_nearest_inside(path.robot, via, x) for via, x in zip(path.vias, q, strict=True)])
        if step == PASSING_STEPS - 1:  # a pose that is not reached inside the limits: by its first configuration
            wanted = np.where(np.abs(wanted - q).max(axis=1)[:, None] > PASSED, [via.q for via in path.vias], q)
        if np.abs(wanted - q).max() <= PASSED:
            break
        out = path.spline.move_inside(at, limits.clip(wanted), out, limits.lower, limits.upper)
    return out


def _nearest_inside(robot: Robot, via: Via, q: Array) -> Array:
    """Return a configuration near q that meets a via point, by one Newton step where it is missed."""
    if via.tolerance is None:
        return via.q
    e, inside = se3.error(robot.fk(q)[None], via.pose[None])[0], via.tolerance.scale(VIA_FRACTION)
    distance, angle = float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))
    if distance <= inside.position and angle <= inside.rotation:
        return q
    e[:3] *= max(0.0, 1.0 - VIA_FRACTION * inside.position / distance) if distance > 0.0 else 0.0
    e[3:] *= max(0.0, 1.0 - VIA_FRACTION * inside.rotation / angle) if angle > 0.0 else 0.0
    return np.asarray(q + np.linalg.pinv(robot.jacobian(q)) @ e)
