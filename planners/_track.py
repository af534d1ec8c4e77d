"""Track one branch along a path: march, and put nodes between where a step is refused, until it ends or the path does."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik import kinematics
from optik.ik import Tolerance
from optik.robot import LIMIT_TOLERANCE, Robot
from planners import _march
from planners.joint_path import fourth_bounds
from planners.paths.base import Path

Array = NDArray[np.float64]

Guide = Callable[[Array], tuple[Array, Array]]
"""The free motion of a redundant arm: rows (k, 4, d, n) and values (k, 4, d) at s (k,), as `derivatives_at` takes them."""

LEAST_STEP = 1e-6
"""Shortest step, as a share of the path's length: so sharply the end of a branch is found."""

MOST_NODES = 200_000
"""Of one path; more would only take time."""


class Nodes(NamedTuple):
    """A path at places s (k,): poses, twists (k, 3, 6), the rows and values of the free motion, bounds (k, 2)."""

    s: Array
    poses: Array
    twists: Array
    rows: Array
    values: Array
    fourth: Array


class Ended(NamedTuple):
    """How a branch ended at s: a code of `_march`, its figure, and the joint that is at its limit, or −1."""

    code: int
    s: float
    value: float
    joint: int


class Track(NamedTuple):
    """Nodes s (k,) of a branch with q (k, n), dq (k, 3, n), the smallest singular values (k,), and how it ended."""

    s: Array
    q: Array
    dq: Array
    singular: Array
    ended: Ended | None


def unguided(n: int) -> Guide:
    """The guide of an arm without free motion."""
    return lambda s: (np.empty((s.size, 4, 0, n)), np.empty((s.size, 4, 0)))


def nodes_at(path: Path, s: Array, guide: Guide) -> Nodes:
    """What marching needs of a path."""
    twists = np.empty((s.size, 3, 6))
    for order in (1, 2, 3):
        twists[:, order - 1] = path.twist(s, order)
    return Nodes(s, path.pose(s), twists, *guide(s), fourth_bounds(path, s))


def track(
    robot: Robot,
    path: Path,
    nodes: Nodes,
    q_start: Array,
    guide: Guide,
    tolerance: Tolerance,
    limits: tuple[Array, Array] | None = None,
) -> Track:
    """Follow a path from q_start (n,) near its first node, inside the limits (the robot's own, or others)."""
    arm = robot.fixed, robot.prismatic, robot.tool
    if limits is None:
        limits = robot.limits.lower, robot.limits.upper
    slack = limits[0] - LIMIT_TOLERANCE, limits[1] + LIMIT_TOLERANCE
    allowed = np.array([tolerance.position, tolerance.rotation])
    q0, dq0, singular = np.array(q_start), np.empty((3, robot.n)), np.zeros(1)
    error, _ = kinematics.put_on(*arm, nodes.poses[0], nodes.rows[0, 0], nodes.values[0, 0], 10, q0)
    rank, singular[0] = kinematics.derivatives_at(*arm, q0, nodes.twists[0], nodes.rows[0], nodes.values[0], dq0)
    good: list[tuple[Array, ...]] = []
    ended: Ended | None = None
    at_limit: Ended | None = None  # how it ends, once it has come to the limit
    reach = max(1.0, float(np.abs(nodes.poses[0, :3, 3]).max()))
    outside = np.maximum(slack[0] - q0, q0 - slack[1])
    if not singular[0] >= _march.SMALLEST_SINGULAR_VALUE or rank == 0.0:
        ended = Ended(_march.SINGULAR, 0.0, float(singular[0]), -1)
    elif not error <= _march.ON_PATH * reach:
        ended = Ended(_march.NOT_MET, 0.0, error, -1)
    elif outside.max() > 0.0:
        ended = Ended(_march.LIMIT, 0.0, 0.0, int(outside.argmax()))
    least, total, between = LEAST_STEP * path.end, 0, np.empty(0)
    while ended is None:
        k = len(nodes.s)
        q, dq, sv = np.empty((k, robot.n)), np.empty((k, 3, robot.n)), np.empty(k)
        q[0], dq[0], sv[0] = q0, dq0, singular[0]
        count, code, value, joint = _march.march(*arm, *slack, *nodes, allowed, q, dq, sv)
        kept = slice(0, count if code == _march.DONE else count - 1)
        good.append((nodes.s[kept], q[kept], dq[kept], sv[kept]))
        if code == _march.DONE:
            ended = at_limit
            break
        total += count
        i = count - 1
        a, b = float(nodes.s[i]), float(nodes.s[i + 1])
        q0, dq0, singular = q[i].copy(), dq[i].copy(), sv[i : i + 1].copy()
        if code == _march.LIMIT:
            points = np.empty((robot.n, 6))
            _march.control_points(b - a, q[i], dq[i], q[i + 1], dq[i + 1], points)
            u = _march.first_exit(points[joint], limits[0][joint], limits[1][joint])
            limit = a + min(u, value) * (b - a)
            if limit - a > least and (at_limit is None or limit < at_limit.s):  # up to the limit, and no further
                nodes = nodes_at(path, np.array([a, limit]), guide)
                at_limit = Ended(code, limit, value, joint)
                continue
            good.append((np.array([a]), q0[None], dq0[None], singular))
            ended = Ended(code, limit, value, joint)
            break
        if b - a <= least or total > MOST_NODES:
            good.append((np.array([a]), q0[None], dq0[None], singular))
            ended = Ended(code, b if code == _march.SINGULAR else a, value, -1)
            break
        parts = int(np.clip(np.ceil(value**0.25), 2, 16)) if code == _march.LOOSE and value < np.inf else 2
        between = np.linspace(a, b, parts + 1)[:-1]
        more = nodes_at(path, between, guide)
        nodes = Nodes(*(np.concatenate([new, old[i + 1 :]]) for new, old in zip(more, nodes, strict=True)))
    if not good:
        good.append((nodes.s[:1], q0[None], dq0[None], singular))
    s, qs, dqs, svs = (np.concatenate(part) for part in zip(*good, strict=True))
    return Track(s, qs, dqs, svs, ended)
