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
GIVEN_DRAWS = 0.25
"""Guesses with the freedoms at their given values, for each random guess of freedoms."""
INSIDE_DISC = 1e-9
"""Fraction of a disc's radius by which a value moved into it is inside: above rounding."""
MOST_WORK, DRAW_WORK = 1_500_000, 8
"""Configurations that are moved or judged in one search, and as how many of them a random guess counts: both take about 10 s on
one core among few obstacles."""


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
        Computing time [s] after which no more configurations are sought, beside the budget of work; may be infinite.
    discs : tuple of (int, float)
        First of two joints whose values lie in a disc, and its radius.
    """

    def __init__(
        self, arm: Robot, own: Robot, path: Path, collision: CollisionCheck | None, time_limit: float,
        discs: tuple[tuple[int, float], ...] = (),
    ) -> None:  # fmt: skip
        limits = arm.limits
        self.arm, self._own, self._collision, self._discs = arm, own, collision, discs
        self.redundant = arm.n > 6
        self.work, self.met, self._is_free = 0, False, arm.n > own.n
        single, given = (one if one.motors is None else replace(one, motors=None) for one in (arm, own))
        self._solver, self._given = (make_solver(one, "lm", max_restarts=2) for one in (single, given))  # see `allows`
        poses = path.pose(SEED_STATIONS * path.end).round(6) + 0.0
        self.rng = np.random.default_rng([int(arm.fingerprint, 16), zlib.crc32(poses.tobytes())])
        self.circle: Flags = ~arm.prismatic & (limits.upper - limits.lower > CIRCLE_RANGE) & (own.motors is None)
        self._low = np.where(self.circle | np.isinf(limits.lower), -np.pi, limits.lower)
        self._high = np.where(self.circle | np.isinf(limits.upper), np.pi, limits.upper)
        self._range = [np.where(self.circle, side * np.inf, x)[own.n :] for side, x in ((-1.0, limits.lower), (1.0, limits.upper))]
        self._values = np.clip(0.0, *self._range)
        speed = np.full(arm.n, np.inf) if limits.velocity is None else limits.velocity
        known, real = np.isfinite(speed), np.arange(arm.n) < own.n
        self.slowness: Array = np.where(known, 1.0 / np.where(known, speed, 1.0), 0.0)
        typical = np.median(self.slowness[known & real]) if (known & real).any() else 1.0
        weights = np.where(real, np.where(known, (self.slowness / typical) ** 2, 1.0), FREEDOM_WEIGHT)
        self.weights: Array = np.maximum(weights, LEAST_WEIGHT)
        # A kernel that is not compiled yet takes half a minute, which does not count.
        for solver, middle in ((self._solver, limits.middle), (self._given, own.limits.middle)):
            solver.solve_batch(solver.robot.fk(middle[None]), middle[None], threads=1)
        self._deadline = perf_counter() + time_limit

    @property
    def is_over(self) -> bool:
        """Whether the budget of work is spent, or the computing time over, which is noted."""
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
        if self._collision is None or not len(q):
            return np.full(len(q), np.inf)
        return self._collision.find_rooms(np.ascontiguousarray(q[:, : self._own.n]))

    def name_contact(self, q: Array) -> str:
        """Return the pair that is in contact at most of the configurations (k, n), in words."""
        assert self._collision is not None
        pairs = Counter(self._collision.name_pair(x) for x in q[:, : self._own.n])
        return pairs.most_common(1)[0][0]

    def allows(self, q: Array) -> Flags:
        """Return which configurations are inside the limits and the discs of their freedoms."""
        inside = ((q >= self.arm.limits.lower) & (q <= self.arm.limits.upper) | self.circle).all(axis=1)
        if self._own.motors is not None:
            inside = inside & self._own.limits.contains(q[:, : self._own.n])
        for at, radius in self._discs:
            inside = inside & (np.linalg.norm(q[:, at : at + 2], axis=1) <= radius)
        return np.asarray(inside)

    def draw(self, poses: Array, count: int) -> list[Array]:
        """Return configurations of each pose (k, 4, 4) from so many random guesses."""
        layers = [np.empty((0, self.arm.n))] * len(poses)
        for solver, number in ((self._solver, count), (self._given, int(GIVEN_DRAWS * count)))[: 1 + self._is_free]:
            n, self.work = solver.robot.n, self.work + DRAW_WORK * number * len(poses)
            starts = self._low[:n] + (self._high - self._low)[:n] * self.rng.random((len(poses) * number, n))
            targets = np.repeat(poses, number, axis=0)
            values = np.tile(self._values, (len(starts), 1))[:, : self.arm.n - n]
            at = targets if n == self.arm.n else self._tool_poses(values, targets)
            found = solver.solve_batch(at, starts, threads=1)
            solved = np.flatnonzero(found.solved)
            q, ok = self.project(np.concatenate([found.q, values], axis=1)[solved], targets[solved], 3)
            q, own = self.wind(q[ok]), (solved // number)[ok]
            layers = [np.concatenate([layer, q[own == k]]) for k, layer in enumerate(layers)]
        return layers if self.redundant else [keep_different(layer, SAME_ROOT, 0.0) for layer in layers]

    def _tool_poses(self, values: Array, poses: Array) -> Array:
        """Return the poses (k, 4, 4) of the arm's own tool with values of the freedoms (k, d) at poses of the path."""
        middle = np.tile(self._own.limits.middle, (len(values), 1))
        moved = self.arm.fk(np.concatenate([middle, values], axis=1))
        return np.ascontiguousarray(poses @ np.linalg.inv(moved) @ self._own.fk(middle))

    def _confine(self, q: Array, poses: Array, steps: int) -> None:
        """Move freedoms, in place, into their ranges and discs; the arm's own joints then reach the poses."""
        n = self._own.n
        values = np.clip(q[:, n:], *self._range)
        for at, radius in self._discs:
            size = np.linalg.norm(values[:, at - n : at - n + 2], axis=1, keepdims=True)
            values[:, at - n : at - n + 2] *= np.minimum(1.0, (1.0 - INSIDE_DISC) * radius / np.maximum(size, 1e-300))
        out = np.flatnonzero((values != q[:, n:]).any(axis=1))
        if out.size:
            own = np.ascontiguousarray(q[out, :n])
            newton.polish_batch(self._own.chain, own, self._tool_poses(values[out], poses[out]), steps)
            q[out] = np.concatenate([own, values[out]], axis=1)

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
            J, e = self.arm.jacobian(q), self.arm.pose_errors(q, poses)
            JW = J * W
            y = np.linalg.solve(JW @ np.swapaxes(J, 1, 2) + 1e-12 * np.eye(6), e[..., None])[..., 0]
            q += np.einsum("kij,ki->kj", JW, y)
        return self.project(q, poses, 3)

    def judge(self, q: Array) -> Layer:
        """Return the configurations that are free of contact and regular, with their costs."""
        self.work += len(q)
        room, sigma, sides = self.rooms(q), *self.regularity(q)
        kept = (room > 0.0) & (sigma > (0.0 if self._own.n == self.arm.n > 6 else LEAST_REGULAR))
        q, room, sigma, sides = q[kept], room[kept], sigma[kept], sides[kept]
        x = np.minimum(np.abs(self.arm.limits.normalise(q)), LOG_EDGE)
        x = np.where(self.circle, 0.0, x)
        cost = -BARRIER_WEIGHT * np.log(1.0 - x**2).sum(axis=1) - SINGULAR_WEIGHT * np.log(np.maximum(sigma, 1e-9))
        return Layer(q, cost + ROOM_WEIGHT * np.exp(-np.maximum(room, 0.0) / NEAR_ROOM), sides)

    def regularity(self, q: Array) -> tuple[Array, Array]:
        """Return the smallest singular values (k,) of the arm without freedoms, which follows the path, and the sides (k,)."""
        own = np.ascontiguousarray(q[:, : self._own.n])
        sides = np.sign(np.linalg.det(self._own.jacobian(own))) if self._own.n == 6 else np.zeros(len(q))
        return smallest_singular_values(self._own, own), sides
