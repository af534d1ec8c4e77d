"""Redundancy resolution for arms of more than six joints: null-space motion chosen along the path, then tracked exactly."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import scipy

from optik import newton
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik import IKSolver, make_solver
from optik.types import Array, Flags, Indices
from planners.following import smoothing
from planners.following.branches import MOTION_WEIGHT, SINGULAR_WEIGHT, START_WEIGHT, Rooms, clearance_costs
from planners.following.joint_path import Guide, smallest_singular_values
from planners.following.smoothing import BARRIER_WEIGHT, LARGEST_EDGE, LOG_EDGE, STATION_REACHED
from planners.paths.base import Path

GUIDE_STATIONS = 25
"""Stations along the path at which the null-space motion is chosen: a spline of 24 pieces."""
STATION_DRAWS = 40
"""Random initial guesses at every station, among whose solutions the programme chooses."""
CHOICES = 3
"""Null-space motions that are tried, the best first: the first can be followed on most paths."""
SHORTEST_FRACTION = 1e-3
"""Shortest step towards the end of the reach, as a fraction of the path: the accuracy of that end."""
KEEP_OFF_FACTOR = 8.0
"""Factor on the weight of the distance to the limits, if the null-space motion reached a limit."""
RETREATS = (0.7, 0.4, 0.2, 0.1, 0.0)
"""Fractions of the smoothing that are tried where all of it leads into contact."""
FEWEST_FREE, MOST_START_ROUNDS = 8, 20
"""Collision-free configurations that are enough at the first station (at others one is), and most rounds of initial guesses."""
SELF_MOTION = 0.1
"""Motion along the null space to the configurations that are continued beside those of the station before [rad or m]."""
MOST_REFINEMENTS = 4
"""Most attempts to follow one null-space motion; before each new one, stations are inserted where following failed."""


def find_null_space_motions(
    robot: Robot, path: Path, q: Array | None, branch: str, rooms: Rooms | None = None
) -> Iterator[NullSpaceMotion]:
    """Yield null-space motions to try, the best first.

    Configurations q_k are chosen at stations along the path: for ``"start"`` by minimum-norm joint motion from the given one;
    for ``"best"`` by dynamic programming over random configurations at every station and those continued from the previous
    station, at the cost of motion, distance to the limits and singularity. They are then moved along their self-motion
    manifolds until the whole motion is smooth and keeps away from the limits. A spline g through them, and one W through
    the null spaces there, are the guide: q(s) is the configuration on the path with W(s) (q − g(s)) = 0. So q', q'', q''' are
    unique and exact for any splines.
    """
    s = np.linspace(0.0, path.end, GUIDE_STATIONS)
    if branch == "start":
        assert q is not None
        chosen = [q[None].copy()]
        _project(robot, path.pose(s[:1]), chosen[0])
    else:
        chosen = _search_stations(robot, np.ascontiguousarray(path.pose(s)), q, rooms)
    for way in chosen:
        yield NullSpaceMotion(robot, path, s, way, held=branch == "start", rooms=rooms)


class NullSpaceMotion:
    """Configurations at stations along a path, smoothed together, and the guide through them."""

    def __init__(
        self, robot: Robot, path: Path, s: Array, way: Array, *, held: bool, rooms: Rooms | None = None
    ) -> None:  # fmt: skip
        self.robot, self.path, self.held, self.rooms = robot, path, held, rooms
        self.chain = robot.chain
        self.middle = robot.limits.middle
        self.half = np.where(robot.limits.bounded, robot.limits.half, np.inf)  # a locked joint has no range
        self.first: Array = np.linalg.svd(robot.jacobian(way[0]))[2][6:].T.copy()
        self.s, self.way, self.keep_off = s[: len(way)], way, BARRIER_WEIGHT
        self._continue(s[len(way) :])
        self._smooth()

    @property
    def start(self) -> Array:
        """Configuration (n,) at the start of the path [rad, m]."""
        start: Array = self.way[0]
        return start

    def _continue(self, s: Array) -> None:
        """Continue the last configuration to stations s (k,), as far as possible.

        If one is not reached, a nearer one is tried first, so that the last is near the end of the arm's reach.
        """
        ahead = list(s)
        while ahead:
            at = np.array([self.s[-1], *ahead])
            way = np.repeat(self.way[-1:], len(at), axis=0)
            poses, N = np.ascontiguousarray(self.path.pose(at)), self.first.copy()
            good = smoothing.continue_stations(self.chain, self.middle, self.half, poses, at / self.path.end, N, way)
            self.s, self.way = np.append(self.s, at[1:good]), np.concatenate([self.way, way[1:good]])
            ahead = ahead[good - 1 :]
            if ahead:
                if ahead[0] - self.s[-1] < SHORTEST_FRACTION * self.path.end:
                    return
                ahead.insert(0, 0.5 * (self.s[-1] + ahead[0]))

    def _smooth(self) -> None:
        poses, self.N = np.ascontiguousarray(self.path.pose(self.s)), np.empty((*self.way.shape, self.first.shape[1]))
        fractions, before = self.s / self.path.end, self.way
        self.way = np.array(before, order="C")
        smoothing.smooth(
            self.chain,
            (self.middle, self.half),
            (poses, fractions),
            self.first,
            self.keep_off,
            self.held,
            self.way,
            self.N,
        )
        if self.rooms is not None and self.rooms(self.way).min() <= 0.0 < self.rooms(before).min():
            self._retreat(before, poses, self.rooms)

    def _retreat(self, before: Array, poses: Array, rooms: Rooms) -> None:
        """Undo so much of the smoothing from free configurations (k, n) that all are free again."""
        smoothed = self.way
        for fraction in RETREATS:
            self.way = before + fraction * (smoothed - before)
            if _project(self.robot, poses, self.way).all() and rooms(self.way).min() > 0.0:
                break
        smoothing.find_null_spaces(self.chain, self.way, self.first, self.N)

    def refine(self, s: float, limit: bool) -> bool:
        """Insert stations near s, where following failed, and smooth the motion again; return False if it cannot be refined."""
        if s >= self.s[-1] and self.s[-1] < self.path.end:
            return False
        k = int(np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2))
        near = slice(max(k - 2, 0), k + 4)
        more = 0.5 * (self.s[near][1:] + self.s[near][:-1])
        between = np.ascontiguousarray(0.5 * (self.way[near][1:] + self.way[near][:-1]))
        apart = np.diff(self.s[near]).min() >= SHORTEST_FRACTION * self.path.end
        if apart and _project(self.robot, self.path.pose(more), between).all():
            order = np.argsort(np.append(self.s, more))
            self.s, self.way = np.append(self.s, more)[order], np.concatenate([self.way, between])[order]
        elif not limit:
            return False
        if limit:
            self.keep_off *= KEEP_OFF_FACTOR
        self._smooth()
        return True

    def guide(self) -> Guide:
        """Return the guide through the configurations; behind the last one it is constant."""
        return _build_guide(self.s, self.way, np.swapaxes(self.N, 1, 2))


def _project(robot: Robot, poses: Array, q: Array) -> Flags:
    """Project configurations (k, n), in place, onto poses (k, 4, 4) by minimum-norm steps; return which of them converge."""
    newton.polish_batch(robot.chain, q, poses, 12)
    return np.asarray(np.abs(robot.pose_errors(q, poses)).max(axis=1) < STATION_REACHED)


def _search_stations(robot: Robot, poses: Array, near: Array | None, rooms: Rooms | None) -> list[Array]:
    """Return the cheapest sequences (k, n) over the stations, by dynamic programming; shorter if none reaches the last one."""
    solver, rng = _solver(robot), np.random.default_rng(0)
    starts = robot.limits.sample(rng, STATION_DRAWS * len(poses))
    solutions = solver.solve_batch(np.repeat(poses, STATION_DRAWS, axis=0), starts, threads=1)
    layers: list[Array] = []
    costs: list[Array] = []
    before: list[Indices] = []
    for k, pose in enumerate(poses):
        part = slice(k * STATION_DRAWS, (k + 1) * STATION_DRAWS)
        q = solutions.q[part][solutions.solved[part]]
        if k:
            on = (
                layers[-1].copy()
                if rooms is None
                else _spread(robot, layers[-1][np.argsort(costs[-1])[:STATION_DRAWS]])
            )
            on = on[_project(robot, np.repeat(pose[None], len(on), axis=0), on) & robot.limits.contains(on)]
            q = np.concatenate([on[: 3 * STATION_DRAWS], q])
        if rooms is not None:
            q = _find_free(robot, pose, q[rooms(q) > 0.0], rooms, FEWEST_FREE if k == 0 else 1)
        if not len(q):
            break
        clearance = np.zeros(len(q)) if rooms is None else clearance_costs(rooms(q))
        own = (_station_costs(robot, q) + clearance) / len(poses) + (clearance if k == 0 else 0.0)
        if k == 0:
            if near is not None:
                own = own + START_WEIGHT * np.linalg.norm(q - near, axis=1)
            layers, costs, before = [q], [own], [np.zeros(len(q), np.int64)]
            continue
        total, best = np.empty(len(q)), np.empty(len(q), np.int64)
        _find_edges(layers[-1], costs[-1], q, 0.5 * MOTION_WEIGHT * (len(poses) - 1), total, best)
        if not np.isfinite(total).any():
            break
        kept = np.isfinite(total)
        layers.append(q[kept])
        costs.append((total + own)[kept])
        before.append(best[kept])
    return [_trace_back(layers, before, int(i)) for i in _choose_different(layers, costs)]


def _spread(robot: Robot, q: Array) -> Array:
    """Return configurations (k, n) and others on both sides of them along their null spaces."""
    null = np.linalg.svd(robot.jacobian(q))[2][:, 6:]
    steps = [sign * SELF_MOTION * null[:, i] for i in range(null.shape[1]) for sign in (1.0, -1.0)]
    return np.concatenate([q, *(q + step for step in steps)])


def _find_free(robot: Robot, pose: Array, q: Array, rooms: Rooms, fewest: int) -> Array:
    """Return collision-free configurations (k, n) of a pose: those given and others, if they are too few."""
    rng = np.random.default_rng(1)
    for _ in range(MOST_START_ROUNDS):
        if len(q) >= fewest:
            break
        starts = robot.limits.sample(rng, STATION_DRAWS)
        found = _solver(robot).solve_batch(np.repeat(pose[None], STATION_DRAWS, axis=0), starts, threads=1)
        more = found.q[found.solved]
        q = np.concatenate([q, more[rooms(more) > 0.0]])
    return q


@compiled
def _find_edges(layer: Array, costs: Array, q: Array, weight: float, total: Array, best: Indices) -> None:
    """Write the cheapest edge from a layer (k, n) to each configuration (m, n), no joint moving far; infinite without one."""
    for j in range(q.shape[0]):
        total[j], best[j] = np.inf, 0
        for i in range(layer.shape[0]):
            square, largest = 0.0, 0.0
            for a in range(q.shape[1]):
                d = q[j, a] - layer[i, a]
                square += d * d
                largest = max(largest, abs(d))
            cost = costs[i] + weight * square
            if largest <= LARGEST_EDGE and cost < total[j]:
                total[j], best[j] = cost, i


def _choose_different(layers: list[Array], costs: list[Array]) -> list[int]:
    """Return the last configurations of the cheapest sequences that end in different configurations."""
    if not layers:
        return []
    chosen: list[int] = []
    for i in np.argsort(costs[-1]):
        if all(np.abs(layers[-1][i] - layers[-1][j]).max() > LARGEST_EDGE for j in chosen):
            chosen.append(int(i))
    return chosen[:CHOICES]


def _trace_back(layers: list[Array], before: list[Indices], i: int) -> Array:
    way = []
    for layer, earlier in zip(reversed(layers), reversed(before), strict=True):
        way.append(layer[i])
        i = int(earlier[i])
    return np.array(way[::-1])


@lru_cache(maxsize=16)
def _solver(robot: Robot) -> IKSolver:
    return make_solver(robot, "lm", max_restarts=3)


def _station_costs(robot: Robot, q: Array) -> Array:
    """Return the costs (k,) of configurations (k, n): nearness to limits and to singular configurations."""
    sigma = smallest_singular_values(robot, q)
    x = np.minimum(np.abs(robot.limits.normalise(q)), LOG_EDGE)
    return np.asarray(
        -BARRIER_WEIGHT * np.log(1.0 - x**2).sum(axis=1) - SINGULAR_WEIGHT * np.log(np.maximum(sigma, 1e-9))
    )


def _build_guide(s: Array, way: Array, directions: Array) -> Guide:
    """Return the guide through configurations (k, n) and null-space bases (k, d, n) at stations s (k,)."""
    k, d, n = directions.shape
    W = directions.reshape(k, d * n)
    both = np.concatenate([W, way], axis=1)
    spline = scipy.interpolate.make_interp_spline(s, both, k=min(5, k - 1)) if k > 1 else None

    def guide(at: Array) -> tuple[Array, Array]:
        orders = np.zeros((at.size, 4, (d + 1) * n))
        inside = at <= s[-1]
        orders[~inside, 0] = both[-1]
        if spline is None:
            orders[:, 0] = both[0]
        else:
            for order in range(min(4, spline.k + 1)):
                orders[inside, order] = spline(at[inside], order)
        rows, g = orders[:, :, : d * n].reshape(at.size, 4, d, n), orders[:, :, d * n :]
        values = np.zeros((at.size, 4, d))
        for order, terms in enumerate(((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))):  # Leibniz
            for j, weight in enumerate(terms):
                values[:, order] += weight * np.einsum("kdn,kn->kd", rows[:, order - j], g[:, j])
        return np.ascontiguousarray(rows), values

    return guide
