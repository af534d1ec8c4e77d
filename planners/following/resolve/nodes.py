"""Configurations of an arm that reach poses of a path: random ones, continued ones, and their costs."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from optik import newton
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.types import Array, Flags
from planners.following.branches import keep_different
from planners.following.collision import CollisionCheck
from planners.following.joint_path import smallest_singular_values
from planners.following.smoothing import BARRIER_WEIGHT, LOG_EDGE, STATION_REACHED
from planners.paths.base import Path
from planners.paths.control_curve import ControlBounds

SEED_STATIONS = np.linspace(0.0, 1.0, 5)
"""Fractions of the path whose poses, to a micrometre, seed the random numbers."""
CIRCLE_RANGE = 3.0 * np.pi
"""Range [rad] from which a joint's values are on the circle: every one has a winding inside the limits with room to move."""
SINGULAR_WEIGHT, ROOM_WEIGHT, NEAR_ROOM = 0.2, 1.0, 0.02
"""Weights in a configuration's cost of −ln of the smallest singular value, and of e^(−room / `NEAR_ROOM`) [m]."""
FREEDOM_WEIGHT, LEAST_WEIGHT = 0.05, 1.0 / 400.0
"""Weight of the motion of a freedom, beside that of the arm's median joint, and the least weight."""
LEAST_REGULAR = 5e-3
"""Least smallest singular value [m, 1] of an arm that follows a path with freedoms: nearer to a singular configuration, joints
move far for a small change of the freedoms."""
SAME_ROOT = 1e-5
"""Configurations nearer than this [rad, m] are one root of an arm with six joints."""
EACH_GIVEN = 4
"""One guess in this number has the given values of the freedoms."""
ARRIVED = 1e-6
"""Error [m, rad] up to which a configuration is moved by steps of least norm alone."""
MOST_WORK, DRAW_WORK = 1_500_000, 8
"""Largest number of configurations that one search moves or checks, and the number that a random guess counts as. Either kind
alone uses this budget up in about 10 s, on one core among few obstacles."""


class Layer(NamedTuple):
    """Configurations (k, n) of one pose, on the circle [rad, m], their costs (k,), and sides (k,).

    The side is the sign of the determinant of an arm of six joints: it changes only through a singular configuration.
    """

    q: Array
    costs: Array
    sides: Array


class Sampler:
    """Draws, continues and judges configurations of an arm, inside the limits and free of contact.

    Parameters
    ----------
    arm : Robot
        The arm, with its freedoms as joints.
    own : Robot
        The arm without freedoms, whose joints come first.
    path : Path
        The path, which seeds the random numbers with the arm.
    collision : CollisionCheck or None
        The arm in its scene.
    time_limit : float
        Largest computing time of a search [s], in addition to its budget of configurations; may be infinite.
    discs : tuple of (int, float)
        First of two joints whose values lie in a disc, and its radius.
    """

    def __init__(
        self, arm: Robot, own: Robot, path: Path, collision: CollisionCheck | None, time_limit: float,
        discs: tuple[tuple[int, float], ...] = (),
    ) -> None:  # fmt: skip
        limits = arm.limits
        self.arm, self.own, self.collision = arm, own, collision
        self.redundant = arm.n > 6
        self.work, self.met = 0, False
        single = arm if arm.motors is None else replace(arm, motors=None)  # `allows` knows the motors
        self._solver = make_solver(single, "lm", max_restarts=2)
        poses = path.pose(SEED_STATIONS * path.end).round(6) + 0.0
        self.rng = np.random.default_rng([int(arm.fingerprint, 16), zlib.crc32(poses.tobytes())])
        self.circle: Flags = arm.turning & (limits.upper - limits.lower > CIRCLE_RANGE) & (own.motors is None)
        self._low = np.where(self.circle | np.isinf(limits.lower), -np.pi, limits.lower)
        self._high = np.where(self.circle | np.isinf(limits.upper), np.pi, limits.upper)
        low, high = (np.where(self.circle, x, y)[own.n :] for x, y in ((-np.inf, limits.lower), (np.inf, limits.upper)))
        self._freedoms = ControlBounds(low, high, tuple((at - own.n, radius) for at, radius in discs))
        speed = np.full(arm.n, np.inf) if limits.velocity is None else limits.velocity
        known, real = np.isfinite(speed), np.arange(arm.n) < own.n
        self.slowness: Array = np.where(known, 1.0 / np.where(known, speed, 1.0), 0.0)
        typical = np.median(self.slowness[known & real]) if (known & real).any() else 1.0
        weights = np.where(real, np.where(known, (self.slowness / typical) ** 2, 1.0), FREEDOM_WEIGHT)
        self.weights: Array = np.maximum(weights, LEAST_WEIGHT)
        # A kernel that is not compiled yet takes half a minute, which does not count.
        self._solver.solve_batch(arm.fk(limits.middle[None]), limits.middle[None], threads=1)
        self._deadline = perf_counter() + time_limit

    @property
    def is_over(self) -> bool:
        """Whether the budget is used up or the time limit has passed; records the latter in `met`."""
        self.met = self.met or perf_counter() > self._deadline
        return self.met or self.work > MOST_WORK

    def wind(self, q: Array) -> Array:
        """Return configurations with the values of turning joints in [−π, π] where these are on the circle."""
        return np.ascontiguousarray(np.where(self.circle, q - 2.0 * np.pi * np.round(q / (2.0 * np.pi)), q))

    def unwind(self, q: Array, first: Array | None = None) -> Array:
        """Return a sequence (k, n) without jumps of a turn: it begins in the windings of a configuration (n,), if one is given.

        Else, the windings are those nearest to the middle of the ranges.
        """
        step = np.diff(q, axis=0)
        step -= np.where(self.circle, 2.0 * np.pi * np.round(step / (2.0 * np.pi)), 0.0)
        q = np.concatenate([q[:1], q[:1] + np.cumsum(step, axis=0)])
        off = self.arm.limits.middle - 0.5 * (q.min(axis=0) + q.max(axis=0)) if first is None else first - q[0]
        return np.asarray(q + np.where(self.circle, 2.0 * np.pi * np.round(off / (2.0 * np.pi)), 0.0))

    def rooms(self, q: Array) -> Array:
        """Return the rooms (k,) of configurations [m]; infinite without a scene."""
        if self.collision is None or not len(q):
            return np.full(len(q), np.inf)
        return self.collision.find_rooms(np.ascontiguousarray(q[:, : self.own.n]))

    def name_contact(self, q: Array) -> str:
        """Return the pair that is in contact at most of the configurations (k, n), in words."""
        assert self.collision is not None
        pairs = Counter(self.collision.name_pair(x) for x in q[:, : self.own.n])
        return pairs.most_common(1)[0][0]

    def allows(self, q: Array) -> Flags:
        """Return which configurations are inside the limits."""
        inside = ((q >= self.arm.limits.lower) & (q <= self.arm.limits.upper) | self.circle).all(axis=1)
        if self.own.motors is not None:
            inside = inside & self.own.limits.contains(q[:, : self.own.n])
        return np.asarray(inside)

    def draw(self, poses: Array, count: int) -> list[Array]:
        """Return configurations of each pose (k, 4, 4) from so many random guesses, some with the freedoms' given values."""
        starts = self._low + (self._high - self._low) * self.rng.random((len(poses) * count, self.arm.n))
        starts[::EACH_GIVEN, self.own.n :] = self._freedoms.clip(np.zeros((1, self.arm.n - self.own.n)))
        targets = np.repeat(poses, count, axis=0)
        self.work += DRAW_WORK * len(starts)
        found = self._solver.solve_batch(targets, starts, threads=1)
        solved = np.flatnonzero(found.solved)
        q, ok = self.project(found.q[solved], targets[solved], 3)
        own = solved // count
        q, own = self.wind(q[ok]), own[ok]
        layers = [q[own == k] for k in range(len(poses))]
        return layers if self.redundant else [keep_different(layer, SAME_ROOT, 0.0) for layer in layers]

    def _confine(self, q: Array, poses: Array, steps: int) -> None:
        """Clip freedoms in place to their ranges and discs, and correct the arm's joints to reach the poses."""
        n = self.own.n
        values = self._freedoms.clip(q[:, n:])
        out = np.flatnonzero((values != q[:, n:]).any(axis=1))
        if out.size:
            own, middle = np.array(q[out, :n], order="C"), np.tile(self.own.limits.middle, (out.size, 1))
            moved = np.linalg.solve(self.arm.fk(np.append(middle, values[out], axis=1)), self.own.fk(middle))
            newton.polish_batch(self.own.chain, own, np.ascontiguousarray(poses[out] @ moved), steps)
            q[out] = np.append(own, values[out], axis=1)

    def project(self, q: Array, poses: Array, steps: int = 8) -> tuple[Array, Flags]:
        """Return configurations moved onto poses by steps of least norm, and which of them arrive and are allowed."""
        q = np.array(q, order="C")
        poses = np.array(np.broadcast_to(poses, (len(q), 4, 4)), order="C")  # writable: the kernel has one variant
        if not len(q):
            return q, np.zeros(0, np.bool_)
        newton.polish_batch(self.arm.chain, q, poses, steps)
        self._confine(q, poses, steps)
        self.work += len(q)
        return q, (np.abs(self.arm.pose_errors(q, poses)).max(axis=1) < STATION_REACHED) & self.allows(q)

    def project_slowly(self, q: Array, poses: Array) -> tuple[Array, Flags]:
        """Return configurations moved onto poses with the least motion by the weights of the joints, and which arrive."""
        q, W = np.array(q, order="C"), 1.0 / self.weights
        for _ in range(3):
            e = self.arm.pose_errors(q, poses)
            if np.abs(e).max(initial=0.0) < ARRIVED:
                break
            J = self.arm.jacobian(q)
            JW = J * W
            y = np.linalg.solve(JW @ np.swapaxes(J, 1, 2) + 1e-12 * np.eye(6), e[..., None])[..., 0]
            q += np.einsum("kij,ki->kj", JW, y)
        return self.project(q, poses, 3)

    def judge(self, q: Array) -> Layer:
        """Return the configurations that are free of contact and regular, with their costs."""
        self.work += len(q)
        room, sigma, sides = self.rooms(q), *self.regularity(q)
        kept = (room > 0.0) & (sigma > (0.0 if self.own.n == self.arm.n > 6 else LEAST_REGULAR))
        q, room, sigma, sides = q[kept], room[kept], sigma[kept], sides[kept]
        x = np.minimum(np.abs(self.arm.limits.normalise(q)), LOG_EDGE)
        x = np.where(self.circle, 0.0, x)
        cost = -BARRIER_WEIGHT * np.log(1.0 - x**2).sum(axis=1) - SINGULAR_WEIGHT * np.log(np.maximum(sigma, 1e-9))
        return Layer(q, cost + ROOM_WEIGHT * np.exp(-np.maximum(room, 0.0) / NEAR_ROOM), sides)

    def regularity(self, q: Array) -> tuple[Array, Array]:
        """Return the smallest singular values (k,) of the arm without freedoms, which follows the path, and the sides (k,)."""
        own = np.ascontiguousarray(q[:, : self.own.n])
        sides = np.sign(np.linalg.det(self.own.jacobian(own))) if self.own.n == 6 else np.zeros(len(q))
        return smallest_singular_values(self.own, own), sides
