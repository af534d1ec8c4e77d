"""Layered graph of configurations along a path: edges that can be followed, cheapest sequences, and their relaxation."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np

from optik import newton
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik import make_solver
from optik.types import Array, Flags, Indices
from planners.following.branches import CollisionCheck, keep_different
from planners.following.joint_path import smallest_singular_values
from planners.following.smoothing import BARRIER_WEIGHT, LARGEST_EDGE, LOG_EDGE, STATION_REACHED
from planners.paths.base import Path
from planners.paths.control_curve import ControlBounds

# ---------------- configurations of an arm that reach poses of a path


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


# ---------------- the layered graph


DISTURBANCE = 0.15
"""Standard deviation [rad, m] of the disturbance of a second continuation of each configuration."""
CHECKED_AT, NEAR_CHORD = (0.25, 0.5, 0.75), 0.5
"""Positions along an edge at which it is followed, and how far from the chord it may be there, over the longest edge."""
ALIKE = 0.02
"""Edges whose ends are nearer than this [rad, m] to those of one that cannot be followed are not tried."""
FEW_ROUNDS, MOST_ROUNDS, MORE_ROUNDS = 20, 300, 3
"""Most rounds of the search without inserted layers, and with them; how many more are made for further sequences once one is
found."""
RECONFIGURATION, PRICE = 1e6, 0.5
"""Cost of a reconfiguration, above all other costs, so that the fewest are taken; and per second of its slowest joint."""
FEWEST_STARTS, MOST_START_ROUNDS = 8, 20
"""Configurations that are enough at a start, and most further rounds of draws there."""
OFTEN = 5
"""Rounds in which an edge to a layer cannot be followed after which one is inserted before it."""
SPREAD_ON = 5
"""Layers on both sides of an inserted one to which its configurations are continued."""


class Sequence(NamedTuple):
    """Configurations q (k, m) of an arm [rad, m] at positions s (k,) along its path [m, or rad], between reconfigurations."""

    s: Array
    q: Array


@compiled
def find_edges(
    layer: tuple[Array, Array, Array], q: Array, sides: Array, metric: tuple[Array, Flags], forbidden: Flags,
    window: Indices, total: Array, best: Indices,
) -> None:  # fmt: skip
    """Write the cheapest edge from a layer (k, n) to each configuration (m, n); infinite without one.

    Shapes and units: layer: configurations (k, n) [rad, m], costs (k,) and sides (k,), q (m, n) [rad, m], sides (m,), metric:
    weights (n,) and which joints are on the circle (n,), forbidden (k, m), or empty, window (m, 2) of rows of the layer,
    total (m,), best (m,) (overwritten).
    """
    (before, costs, side), (weights, circle) = layer, metric
    for j in range(q.shape[0]):
        total[j], best[j] = np.inf, -1
        for i in range(window[j, 0], window[j, 1]):
            cost = costs[i]
            if not cost < total[j] or side[i] != sides[j] or (forbidden.size > 0 and forbidden[i, j]):
                continue
            for a in range(q.shape[1]):
                d = abs(q[j, a] - before[i, a])
                if circle[a] and d > np.pi:
                    d = 2.0 * np.pi - d
                if d > LARGEST_EDGE:
                    cost = np.inf
                    break
                cost += weights[a] * d * d
            if cost < total[j]:
                total[j], best[j] = cost, i


def join_layers(a: Layer, b: Layer) -> Layer:
    """Return the configurations of two layers."""
    return Layer(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))


class Graph:
    """Layers of configurations along a path; `find` returns sequences whose edges are followed.

    Parameters
    ----------
    sampler : Sampler
        Source and judge of configurations.
    path : Path
        The path of the arm's tool.
    s : (k,) array
        Positions of the layers.
    draws : int
        Random guesses for each layer.
    near : (n,) array, optional
        A configuration near which the first one is preferred.
    held : bool
        Whether it is the only configuration of the first layer.
    """

    def __init__(
        self, sampler: Sampler, path: Path, s: Array, draws: int, near: Array | None = None, *, held: bool = False
    ) -> None:
        self.sampler, self.path, self.s, self.draws, self.near, self.held = sampler, path, s, draws, near, held
        self.poses = np.ascontiguousarray(path.pose(s))
        drawn = sampler.draw(self.poses, draws)
        if held and near is not None:
            drawn[0] = sampler.wind(near[None])
        self.layers = [sampler.judge(q) for q in drawn]
        for _ in range(0 if held else MOST_START_ROUNDS):
            if len(self.layers[0].q) >= FEWEST_STARTS:
                break
            self.layers[0] = join_layers(self.layers[0], sampler.judge(sampler.draw(self.poses[:1], draws)[0]))
        self.forbidden: dict[int, Flags] = {}
        self.failed = Counter[int]()
        self.inserted = self.rounds = 0
        self.costs: list[Array] = []
        self.before: list[Indices] = []
        self.cut: list[Indices] = []
        if sampler.redundant:
            ahead = [(k - 1, k, True) for k in range(1, len(s))]
            for a, b, spread in ahead + [(k + 1, k, False) for k in range(len(s) - 2, int(self.held) - 1, -1)]:
                if not sampler.is_over:
                    self._grow(a, b, spread=spread)

    # ------------------------------------------------------------ configurations

    def _grow(self, a: int, b: int, *, spread: bool = True) -> None:
        """Add to layer b continuations of configurations of layer a: of all, also disturbed, or of those without an edge."""
        sampler, q = self.sampler, self.layers[a].q
        if not spread and len(q):
            q = q[~self._are_linked(b, a)]
        q = q[sampler.rng.permutation(len(q))[: 2 * self.draws]]
        half, ok = sampler.project(q, self.path.pose(np.array([0.5 * (self.s[a] + self.s[b])])))
        q, half = q[ok], half[ok]
        if spread:
            disturbed = half + DISTURBANCE * sampler.rng.standard_normal(half.shape)
            q, half = np.tile(q, (2, 1)), np.concatenate([half, disturbed])
        on, ok = sampler.project(half, self.poses[b])
        ok &= np.abs(on - q).max(axis=1, initial=0.0) <= LARGEST_EDGE
        self.layers[b] = join_layers(self.layers[b], sampler.judge(sampler.wind(on[ok])))

    def _are_linked(self, a: int, b: int) -> Flags:
        """Return which configurations of layer b have an edge to one of layer a."""
        return np.asarray(self._find_edges(a, np.zeros(len(self.layers[a].q)), b, np.zeros((0, 0), np.bool_))[1] >= 0)

    def _find_edges(self, a: int, costs: Array, b: int, forbidden: Flags) -> tuple[Array, Indices]:
        """Return the costs of layer b by the best edges from layer a, and their first ends; −1 without one."""
        (layer, _, side), (q, _, sides), sampler = self.layers[a], self.layers[b], self.sampler
        spread = np.where(sampler.circle, -1.0, layer.std(axis=0)) if len(layer) else np.zeros(1)
        j = int(np.argmax(spread))  # of sorted rows only a window can be near
        order = np.argsort(layer[:, j]) if spread[j] >= 0.0 else np.arange(len(layer))
        if spread[j] >= 0.0:
            ends = [np.searchsorted(layer[order, j], q[:, j] + side * (LARGEST_EDGE + 1e-12)) for side in (-1.0, 1.0)]
        else:
            ends = [np.full(len(q), i) for i in (0, len(layer))]
        total, best = np.empty(len(q)), np.empty(len(q), np.int64)
        weights = 0.5 * (len(self.s) - 1) * sampler.weights
        forbidden = forbidden[order] if forbidden.size else forbidden
        find_edges(
            (layer[order], costs[order], side[order]), q, sides, (weights, sampler.circle), forbidden,
            np.stack(ends, axis=1).astype(np.int64), total, best,
        )  # fmt: skip
        return total, np.where(best >= 0, order[best] if len(order) else best, -1)

    def _insert(self, k: int) -> None:
        """Insert a layer in the middle between k − 1 and k, with continuations from both sides."""
        at = 0.5 * (self.s[k - 1] + self.s[k])
        self.s = np.insert(self.s, k, at)
        self.poses = np.insert(self.poses, k, self.path.pose(np.array([at]))[0], axis=0)
        self.layers.insert(k, self.sampler.judge(self.sampler.draw(self.poses[k : k + 1], 2 * self.draws)[0]))
        self.forbidden = {i + (i > k): pairs for i, pairs in self.forbidden.items() if i != k}
        self.failed, last = Counter(), len(self.s) - 1
        self.inserted += 1
        if not self.sampler.redundant:
            return
        self._grow(k - 1, k)
        self._grow(k + 1, k)
        for j in range(k, min(k + SPREAD_ON, last)):
            self._grow(j, j + 1, spread=False)
        for j in range(k, max(k - SPREAD_ON, int(self.held)), -1):
            self._grow(j, j - 1, spread=False)

    # ------------------------------------------------------------ sequences

    def _solve(self, cuts: int, since: int = 0) -> int | None:
        """Find the least costs of all configurations by dynamic programming; return the layer that none reaches, or None.

        Those of layers before `since` are known.
        """
        K = len(self.layers)
        for known in (self.costs, self.before, self.cut):
            del known[since:]
        for k, layer in enumerate(self.layers):
            if k < len(self.costs):
                continue
            if k == 0:
                cost, before = layer.costs / K, np.full(len(layer.q), -1)
                if self.near is not None:
                    cost = cost + np.linalg.norm(self.sampler.wind(layer.q - self.near), axis=1)
            else:
                cost, before = self._find_edges(k - 1, self.costs[-1], k, self._forbidden_of(k))
                cost = cost + layer.costs / K
            cut = np.full(len(layer.q), -1)
            if cuts and k and len(cost) and np.isfinite(cost).any():
                i = int(np.argmin(cost))
                seconds = (np.abs(layer.q - layer.q[i]) * self.sampler.slowness).max(axis=1)
                dear = cost[i] + RECONFIGURATION + PRICE * seconds
                dear = np.where(dear < (cuts + 1) * RECONFIGURATION, dear, np.inf)
                cut, cost = np.where(dear < cost, i, -1), np.minimum(cost, dear)
            if not np.isfinite(cost).any():
                return k
            self.costs.append(cost)
            self.before.append(before)
            self.cut.append(cut)
        return None

    def _trace(self, end: int) -> list[list[tuple[int, int]]]:
        """Return the layers and rows of the sequence to a row of the last layer reached, divided at reconfigurations."""
        last, i = len(self.costs) - 1, end
        parts = [[(last, end)]]
        for k in range(last, 0, -1):
            if self.cut[k][i] >= 0:
                i = int(self.cut[k][i])
                parts.append([(k, i)])
            i = int(self.before[k][i])
            parts[-1].append((k - 1, i))
        return [part[::-1] for part in parts[::-1]]

    def _ends(self) -> Iterator[int]:
        """Yield rows of the last layer reached, each far from those before, the cheapest first."""
        chosen: list[int] = []
        q, costs = self.layers[len(self.costs) - 1].q, self.costs[-1]
        for i in np.argsort(costs).tolist():
            if np.isfinite(costs[i]) and all(np.abs(q[i] - q[j]).max() > LARGEST_EDGE for j in chosen):
                chosen.append(i)
                yield i

    def _check(self, part: list[tuple[int, int]]) -> list[tuple[int, int, int]]:
        """Return the edges (layer, row before, row) of a sequence that cannot be followed."""
        q = self.sequence(part).q
        if len(q) < 2:
            return []
        s, alive = self.s[[k for k, _ in part]], np.ones(len(q) - 1, np.bool_)
        for u in CHECKED_AT:
            chord = (1.0 - u) * q[:-1] + u * q[1:]
            on, ok = self.sampler.project(chord, self.path.pose((1.0 - u) * s[:-1] + u * s[1:]))
            alive &= ok & (np.abs(on - chord).max(axis=1) <= NEAR_CHORD * LARGEST_EDGE)
            alive[alive] = self.sampler.rooms(on[alive]) > 0.0
        edges = list(pairwise(part))
        return [(edges[e][1][0], edges[e][0][1], edges[e][1][1]) for e in np.flatnonzero(~alive)]

    def sequence(self, part: list[tuple[int, int]]) -> Sequence:
        """Return the configurations of a sequence, without jumps of a turn."""
        q = np.array([self.layers[k].q[i] for k, i in part])
        return Sequence(
            self.s[[k for k, _ in part]], self.sampler.unwind(q, self.near if self.held and part[0][0] == 0 else None)
        )

    def _forbid(self, edges: list[tuple[int, int, int]]) -> None:
        """Forbid edges, and those that are nearly the same."""
        for k, i, j in edges:
            a, b = self.layers[k - 1].q, self.layers[k].q
            like = np.ix_(np.abs(a - a[i]).max(axis=1) < ALIKE, np.abs(b - b[j]).max(axis=1) < ALIKE)
            known = self._forbidden_of(k)
            pairs = known.copy() if known.size else np.zeros((len(a), len(b)), np.bool_)
            pairs[like] = True
            self.forbidden[k] = pairs
        self.failed.update({k for k, _, _ in edges})

    def _forbidden_of(self, k: int) -> Flags:
        """Return which edges to layer k are forbidden; empty if none is."""
        known = self.forbidden.get(k, np.zeros((0, 0), np.bool_))
        more = [(0, len(self.layers[i].q) - n) for i, n in zip((k - 1, k), known.shape, strict=True)]
        return np.pad(known, more) if known.size else known

    def find(self, count: int, cuts: int, least: float) -> tuple[list[list[Sequence]], tuple[float, float] | None]:
        """Return up to so many sequences, each divided at its reconfigurations.

        Where no configuration goes on, layers are inserted, down to a least spacing. If there is still none, the sequences end
        there, and the positions between which none goes on are returned, too. Only the edges of the answers are followed.
        """
        further = since = 0
        for _ in range(MOST_ROUNDS if np.isfinite(least) else FEW_ROUNDS):
            self.rounds += 1
            late, gap = self.sampler.is_over, None
            often = [k for k, times in self.failed.items() if times >= OFTEN and self.s[k] - self.s[k - 1] >= least]
            if often and not late:
                self._insert(often[0])
                since = 0
            stuck = self._solve(cuts, since)
            if stuck is not None:
                gap = float(self.s[max(stuck - 1, 0)]), float(self.s[stuck])
                if stuck and gap[1] - gap[0] >= least and not late:
                    self._insert(stuck)
                    since = 0
                    continue
            answers, wrong = list[list[Sequence]](), list[tuple[int, int, int]]()
            for _, end in zip(range(count), self._ends() if stuck != 0 else (), strict=False):
                parts = self._trace(end)
                bad = [edge for part in parts for edge in self._check(part)]
                wrong += bad
                if not bad:
                    answers.append([self.sequence(part) for part in parts])
            further += bool(answers)
            if (answers and (not wrong or further > MORE_ROUNDS)) or stuck == 0 or late:
                return answers, gap or (None if answers else (0.0, self.path.end))
            self._forbid(wrong)
            since = min(k for k, _, _ in wrong)
        return [], (0.0, self.path.end)


# ---------------- relaxation


SWEEPS, MOVED = 120, 3e-4
"""Most sweeps, and the largest motion of a joint [rad, m] in a sweep that ends them."""
WANTED_ROOM, KEPT_ROOM = 0.02, 0.5
"""A configuration keeps this room [m], or this fraction of the room that it has at first."""
REGULAR = 0.02
"""Smallest singular value up to which a configuration's own may not become less [m, 1]."""
LIMITS_PUSH, INSIDE = 0.02, 0.02
"""Step from the limits of a joint at one of them [rad, m], and the fraction of half its range that is kept from them: the curve
through the configurations overshoots."""
LONGEST_MOVE = 0.3
"""Longest motion of a joint in a sweep [rad, m]."""
LONGER, SHORTER = 1.5, 0.4
"""Factors of the step after one that was accepted, and after one that was not."""


def relax_sequences(
    sampler: Sampler, path: Path, given: list[Sequence], *, held: bool, caution: int = 0
) -> list[Sequence]:
    """Return shorter sequences: each configuration moves towards the mean of its neighbours, and stays inside and free.

    Each further degree of caution keeps it farther from limits and contact.
    """
    if not given:
        return []
    s, q = np.concatenate([one.s for one in given]), np.concatenate([one.q for one in given])
    limits = sampler.arm.limits
    row, last = (np.concatenate([np.arange(len(one.s))[::way] for one in given]) for way in (1, -1))  # from both ends
    (sigma, sides), regular = sampler.regularity(q), REGULAR * (1 + caution)
    poses, step = np.ascontiguousarray(path.pose(s)), np.ones(len(q))
    pad = INSIDE * (1 + caution) * np.where(limits.bounded, limits.half, 0.0)
    push, wanted = LIMITS_PUSH * 3.0**caution, WANTED_ROOM * (1 + caution)
    floor = np.minimum(KEPT_ROOM * sampler.rooms(q), wanted)

    def outside(x: Array) -> Array:
        return np.maximum(np.maximum(limits.lower + pad - x, x - limits.upper + pad), 0.0)

    for _ in range(SWEEPS):
        moved = 0.0
        for parity in (0, 1):
            k = np.flatnonzero((row % 2 == parity) & ((row > 0) | (not held)))
            below, above = np.sign(row[k]), np.sign(last[k])  # an end has one neighbour
            left, right = k + np.where(below, -1, above), k + np.where(above, 1, -below)
            u = np.where(left < right, (s[k] - s[left]) / np.where(left < right, s[right] - s[left], 1.0), 0.0)[:, None]
            to = step[k, None] * ((1.0 - u) * q[left] + u * q[right] - q[k])
            on, ok = sampler.project_slowly(q[k] + to - push * limits.normalise(q[k]) ** 7, poses[k])
            room = np.full(len(k), -1.0)
            room[ok] = sampler.rooms(on[ok])
            ok &= (room > 0.0) & (room >= floor[k])
            ok &= (np.abs(on - q[k]).max(axis=1) < LONGEST_MOVE) & (outside(on) <= outside(q[k]) + 1e-12).all(axis=1)
            sigma_on, sides_on = sampler.regularity(on)
            ok &= (sides_on == sides[k]) & (sigma_on >= np.minimum(sigma[k], regular))
            moved = max(moved, float(np.abs(on[ok] - q[k][ok]).max(initial=0.0)))
            q[k[ok]], sigma[k[ok]] = on[ok], sigma_on[ok]
            step[k] = np.where(ok, np.minimum(1.0, LONGER * step[k]), SHORTER * step[k])
        if moved < MOVED:
            break
    ends = np.flatnonzero(last == 0)[:-1] + 1
    return [Sequence(*pair) for pair in zip(np.split(s, ends), np.split(q, ends), strict=True)]
