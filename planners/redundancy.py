"""The free motion of an arm with more joints than a pose asks for: chosen along the path, then followed exactly."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from optik import kinematics
from optik._compile import compiled
from optik.ik import IKSolver, make_solver
from optik.ik._chain import draw_configurations
from optik.robot import Robot
from planners._course import Guide
from planners.branches import MOTION, SINGULAR, START
from planners.paths.base import Path

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STATIONS = 25
"""Places along the path at which the free motion is chosen."""

DRAWN = 40
"""Configurations drawn at every station."""

LARGEST_EDGE = 0.7
"""Largest joint motion from a station to the next [rad or m], before it is made smooth."""

ROOM = 0.3
"""Weight of the room to the limits, −Σ ln(1 − x²) with x = (q − middle) / half range, beside ½ the squared motion."""

EDGE = 0.98
"""Beyond this x the logarithm is continued as a parabola."""

ROUNDS = 12
"""Of making the free motion smooth."""

CHOICES = 3
"""Free motions tried, the best first."""

NEAREST = 1e-3
"""Shortest step [share of the path] towards where the reach ends."""

REACHED = 1e-9
"""Error that brings a configuration to its station [m, rad]."""


def guides(robot: Robot, path: Path, q: Array | None, branch: str) -> Iterator[tuple[Array, Guide]]:
    """Starts (n,) and free motions to try, best first.

    Configurations q_k at stations along the path are chosen: for ``"start"`` those that the given one is carried to by
    the shortest joint motion; for ``"best"`` by dynamic programming over configurations drawn at every station and those
    carried on from the station before, at the cost of motion, room to the limits and singularity. They are then moved
    along their curves of solutions to where the whole motion is smooth and keeps away from the limits. A spline g through
    them, and one W through the directions of free motion there, are the guide: q(s) is the configuration on the path with
    W(s) (q − g(s)) = 0. That makes q', q'', q''' unique and exact, whatever the splines do between stations.

    Parameters
    ----------
    robot : Robot
        Of more than six joints.
    path : Path
        What to follow.
    q : (n,) array, optional
        The start for ``"start"``, one to start near for ``"best"``.
    branch : {"start", "best"}
        Whether to begin at q.

    Yields
    ------
    tuple
        Start (n,) and guide.
    """
    s = np.linspace(0.0, path.end, STATIONS)
    if branch == "start":
        assert q is not None
        chosen = [q[None].copy()]
        _reach(robot, path.pose(s[:1]), chosen[0])
    else:
        chosen = _programmed(robot, np.ascontiguousarray(path.pose(s)), q)
    for way in chosen:
        at, way = _carried(robot, path, s, way)
        way = _smooth(robot, path, at, way, fixed=branch == "start")
        yield way[0], _guide(robot, at, way)


def _reach(robot: Robot, poses: Array, q: Array) -> NDArray[np.bool_]:
    """Bring configurations (k, n), in place, the shortest way onto poses (k, 4, 4); which of them come there."""
    kinematics.polish_batch(robot.fixed, robot.prismatic, robot.tool, q, poses, 12)
    return np.asarray(np.abs(robot.errors(q, poses)).max(axis=1) < REACHED)


def _carried(robot: Robot, path: Path, s: Array, way: Array) -> tuple[Array, Array]:
    """Carry the last of configurations (k, n) on to the other stations s, kept off the limits, as far as it goes.

    Returns the stations and the configurations there; where a station is not reached, one nearer is tried, so that the
    last is near where the arm's reach ends.
    """
    at, found, wanted = list(s[: len(way)]), list(way), list(s[len(way) :])
    while wanted:
        pose, x = path.pose(wanted[0])[None], found[-1][None].copy()
        good = bool(_reach(robot, pose, x)[0]) and np.abs(x[0] - found[-1]).max() <= LARGEST_EDGE
        if not good:
            if wanted[0] - at[-1] < NEAREST * path.end:
                break
            wanted = [0.5 * (at[-1] + wanted[0])]
            continue
        N = _free(robot, x)[0]
        away = -ROOM * N @ (N.T @ _room(robot, x)[0][0]) * (wanted[0] - at[-1]) / path.end
        y = x + away * min(1.0, 0.05 / max(float(np.abs(away).max()), 1e-12))
        found.append(y[0] if _reach(robot, pose, y)[0] else x[0])
        at.append(wanted.pop(0))
    return np.array(at), np.array(found)


def _programmed(robot: Robot, poses: Array, near: Array | None) -> list[Array]:
    """The cheapest ways (k, n) from station to station, by dynamic programming; shorter ones where none goes all the way."""
    solver, rng = _solver(robot), np.random.default_rng(0)
    starts = draw_configurations(robot, rng, DRAWN * len(poses))
    drawn = solver.solve_batch(np.repeat(poses, DRAWN, axis=0), starts, threads=1)
    layers: list[Array] = []
    costs: list[Array] = []
    before: list[Ints] = []
    for k, pose in enumerate(poses):
        part = slice(k * DRAWN, (k + 1) * DRAWN)
        q = drawn.q[part][drawn.solved[part]]
        if k:
            on = layers[-1].copy()
            on = on[_reach(robot, np.repeat(pose[None], len(on), axis=0), on) & robot.limits.contains(on)]
            q = np.concatenate([on[: 3 * DRAWN], q])
        if not len(q):
            break
        own = _standing(robot, q) / len(poses)
        if k == 0:
            if near is not None:
                own = own + START * np.linalg.norm(q - near, axis=1)
            layers, costs, before = [q], [own], [np.zeros(len(q), np.int64)]
            continue
        total, best = np.empty(len(q)), np.empty(len(q), np.int64)
        _edges(layers[-1], costs[-1], q, 0.5 * MOTION * (len(poses) - 1), total, best)
        if not np.isfinite(total).any():
            break
        kept = np.isfinite(total)
        layers.append(q[kept])
        costs.append((total + own)[kept])
        before.append(best[kept])
    return [_back(layers, before, int(i)) for i in _different(layers, costs)]


@compiled
def _edges(layer: Array, costs: Array, q: Array, weight: float, total: Array, best: Ints) -> None:
    """Cheapest edge from a layer (k, n) to each configuration (m, n), no joint moving far; infinite where there is none."""
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


def _different(layers: list[Array], costs: list[Array]) -> list[int]:
    """Last configurations of the cheapest ways that end apart from each other."""
    if not layers:
        return []
    chosen: list[int] = []
    for i in np.argsort(costs[-1]):
        if all(np.abs(layers[-1][i] - layers[-1][j]).max() > LARGEST_EDGE for j in chosen):
            chosen.append(int(i))
    return chosen[:CHOICES]


def _back(layers: list[Array], before: list[Ints], i: int) -> Array:
    way = []
    for layer, earlier in zip(reversed(layers), reversed(before), strict=True):
        way.append(layer[i])
        i = int(earlier[i])
    return np.array(way[::-1])


@lru_cache(maxsize=16)
def _solver(robot: Robot) -> IKSolver:
    return make_solver(robot, "lm", max_restarts=3)


def _standing(robot: Robot, q: Array) -> Array:
    """Cost (k,) of standing at configurations (k, n)."""
    sigma = np.empty(len(q))
    kinematics.singular_values_batch(robot.fixed, robot.prismatic, robot.tool, np.ascontiguousarray(q), sigma)
    lower, upper = robot.limits.lower, robot.limits.upper
    finite = np.isfinite(lower) & np.isfinite(upper) & (lower < upper)
    low, high = np.where(finite, lower, -1.0), np.where(finite, upper, 1.0)
    x = np.where(finite, np.minimum(np.abs(2.0 * q - low - high) / (high - low), EDGE), 0.0)
    return np.asarray(-ROOM * np.log(1.0 - x**2).sum(axis=1) - SINGULAR * np.log(np.maximum(sigma, 1e-9)))


def _room(robot: Robot, q: Array) -> tuple[Array, Array]:
    """First and second derivatives (k, n) of −Σ ln(1 − x²), which keeps joints away from their limits."""
    lower, upper = robot.limits.lower, robot.limits.upper
    finite = np.isfinite(lower) & np.isfinite(upper) & (lower < upper)
    half = np.where(finite, 0.5 * (np.where(finite, upper, 1.0) - np.where(finite, lower, -1.0)), 1.0)
    x = (q - np.where(finite, np.where(finite, lower, 0.0) + half, 0.0)) / half
    inner = np.clip(x, -EDGE, EDGE)
    curve = 2.0 * (1.0 + inner**2) / (1.0 - inner**2) ** 2
    slope = 2.0 * inner / (1.0 - inner**2) + curve * (x - inner)
    return np.where(finite, slope / half, 0.0), np.where(finite, curve / half**2, 0.0)


def _free(robot: Robot, q: Array) -> Array:
    """Orthonormal directions (k, n, d) of free motion at configurations (k, n), each set turned to be like the one before."""
    basis = np.swapaxes(np.linalg.svd(robot.jacobian(q))[2][:, 6:], 1, 2).copy()
    for k in range(1, len(basis)):
        u, _, vt = np.linalg.svd(basis[k].T @ basis[k - 1])
        basis[k] = basis[k] @ (u @ vt)
    return basis


def _smooth(robot: Robot, path: Path, s: Array, way: Array, *, fixed: bool) -> Array:
    """Move configurations (k, n) at stations s along their curves of solutions to the least cost of motion and room.

    Newton steps in the coordinates of free motion: a block tridiagonal system, small enough to be dense.
    """
    k, d = len(way), robot.n - 6
    if k < 2:
        return way
    poses, stretch = path.pose(s), np.diff(s) / (s[-1] - s[0])
    stiff = np.r_[0.0, 1.0 / stretch, 0.0]  # of the spring before each, and after
    share = ROOM * 0.5 * (np.r_[stretch, 0.0] + np.r_[0.0, stretch])[:, None]
    for _ in range(ROUNDS):
        N = _free(robot, way)
        slope, curve = _room(robot, way)
        pull = np.zeros_like(way)
        step = np.diff(way, axis=0) / stretch[:, None]
        pull[:-1] += step
        pull[1:] -= step
        b = np.einsum("kni,kn->ki", N, pull - share * slope)
        A = np.zeros((k, d, k, d))
        for i in range(k):
            A[i, :, i, :] = (stiff[i] + stiff[i + 1]) * np.eye(d) + share[i] * (N[i].T * curve[i]) @ N[i]
            if i:
                A[i, :, i - 1, :] = -stiff[i] * N[i].T @ N[i - 1]
                A[i - 1, :, i, :] = A[i, :, i - 1, :].T
        if fixed:
            A[0], b[0] = 0.0, 0.0
            A[:, :, 0, :] = 0.0
            A[0, :, 0, :] = np.eye(d)
        z = np.linalg.solve(A.reshape(k * d, k * d), b.ravel()).reshape(k, d)
        move = np.einsum("kni,ki->kn", N, z)
        largest = float(np.abs(move).max())
        better = way + move * min(1.0, 0.2 / max(largest, 1e-12))
        good = _reach(robot, poses, better)
        way = np.where(good[:, None], better, way)
        if largest < 1e-4:
            break
    return way


def _guide(robot: Robot, s: Array, way: Array) -> Guide:
    """The guide through configurations (k, n) at stations s (k,); beyond the last it stays."""
    k, d, n = len(way), robot.n - 6, robot.n
    W = np.swapaxes(_free(robot, way), 1, 2).reshape(k, d * n)
    both = np.concatenate([W, way], axis=1)
    spline = make_interp_spline(s, both, k=min(5, k - 1)) if k > 1 else None

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
