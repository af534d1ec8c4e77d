"""The layered graph: configurations at positions along a path, edges that can be followed, and the cheapest sequences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.following.resolve.nodes import Layer, Sampler
from planners.following.smoothing import LARGEST_EDGE
from planners.paths.base import Path

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


def join(a: Layer, b: Layer) -> Layer:
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
            self.layers[0] = join(self.layers[0], sampler.judge(sampler.draw(self.poses[:1], draws)[0]))
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
        self.layers[b] = join(self.layers[b], sampler.judge(sampler.wind(on[ok])))

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
            found, wrong = list[list[Sequence]](), list[tuple[int, int, int]]()
            for _, end in zip(range(count), self._ends() if stuck != 0 else (), strict=False):
                parts = self._trace(end)
                bad = [edge for part in parts for edge in self._check(part)]
                wrong += bad
                if not bad:
                    found.append([self.sequence(part) for part in parts])
            further += bool(found)
            if (found and (not wrong or further > MORE_ROUNDS)) or stuck == 0 or late:
                return found, gap or (None if found else (0.0, self.path.end))
            self._forbid(wrong)
            since = min(k for k, _, _ in wrong)
        return [], (0.0, self.path.end)
