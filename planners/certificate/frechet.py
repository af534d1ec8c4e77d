"""Path error along a polyline with sharp corners: bounds on the Fréchet distance between tool and polyline.

The Fréchet distance is the least distance within which the tool can follow the polyline forwards, from its first to its last
waypoint. Between two instants the tool is near its chord: a curve x(t) is at most h² max |ẍ| / 8 away from its chord.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from optik import se3
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik.base import Tolerance
from optik.types import Array
from planners.certificate.bounds import axes_motion
from planners.certificate.path_error import PathError
from planners.paths.poses import embed_poses
from planners.trajectory import Trajectory

CHORD_FRACTION = 0.01
"""Distance of the tool, and of a turning segment, from their chords, as a fraction of the tolerance."""
MOST_INSTANTS = 300_000
"""Largest number of instants; a motion that needs more has a looser bound."""
GAP = 1e-3
"""Relative difference of the bound and the largest value found, before the distance from the chords."""


class Chords(NamedTuple):
    """Embedded poses (k, 12) along a motion or a polyline, and the largest distances (2,) from their chords [m, rad]."""

    points: Array
    off: Array


def waypoint_error(robot: Robot, trajectory: Trajectory, waypoints: Array, tolerance: Tolerance) -> PathError:
    """Return bounds on the distance and angle between the tool and a polyline; an angle tolerance of π judges no rotation."""
    allowed = np.array([tolerance.position, 2.0 * np.sin(0.5 * min(tolerance.rotation, np.pi))])
    t, tool = _sample_tool(robot, trajectory, CHORD_FRACTION * allowed)
    edges = _divide_turns(waypoints, CHORD_FRACTION * allowed[1])
    off = tool.off + edges.off
    low, high, worst = _search(tool.points, edges.points, np.array([allowed[0], np.inf]))
    found = [max(0.0, low * allowed[0] - off[0]), 0.0]
    bound, when = [high * allowed[0] + off[0], np.pi], [t[worst], 0.0]
    if tolerance.rotation < np.pi:
        near = max(high, 1.0) * allowed[0] * (1.0 + GAP)
        low, high, worst = _search(tool.points, edges.points, np.array([near, allowed[1]]), rotation=True)
        least, most = max(0.0, low * allowed[1] - off[1]), high * allowed[1] + off[1]
        found[1], bound[1], when[1] = (*(2.0 * np.arcsin(min(1.0, 0.5 * x)) for x in (least, most)), t[worst])
    return PathError(*(float(x) for x in (*bound, *found, *when)))


def _sample_tool(robot: Robot, trajectory: Trajectory, allowed: Array) -> tuple[Array, Chords]:
    """Return instants at which the tool is within the allowed distances (2,) of its chords, and its poses there."""
    robot, trajectory = robot.axes, axes_motion(robot, trajectory)
    knots, turning = trajectory.knots, ~robot.prismatic
    links = np.linalg.norm([*robot.fixed[:, :3, 3], robot.tool[:3, 3]], axis=1).sum()
    # Distance of the tool from every joint; a derivative of q_i moves it by at most this, or by 1 if the joint slides.
    arm = np.where(turning, links + trajectory.extrema(0).worst[~turning].sum(), 1.0)
    rate, second = (trajectory.piece_worst(order) for order in (1, 2))
    spin = rate[:, turning].sum(axis=1)
    bend = np.stack([second @ arm + 2.0 * spin * (rate @ arm), second[:, turning].sum(axis=1) + 2.0 * spin**2], axis=1)
    h = np.diff(knots)
    parts = np.ceil(h * np.sqrt((bend / (8.0 * allowed)).max(axis=1))).clip(1.0)
    parts = np.ceil(parts * min(1.0, MOST_INSTANTS / parts.sum())).astype(np.int64)
    pieces = [a + d * np.arange(k) / k for a, d, k in zip(knots, h, parts, strict=False)]
    t = np.concatenate([*pieces, knots[-1:]])
    off = (bend * (h / parts)[:, None] ** 2 / 8.0).max(axis=0)
    return t, Chords(np.ascontiguousarray(embed_poses(robot.fk(trajectory(t)), 1.0)), off)


def _divide_turns(waypoints: Array, allowed: float) -> Chords:
    """Return the waypoints with intermediate poses, so that the rotation along a segment is within `allowed` of its chord."""
    poses, largest = [waypoints[0]], 0.0
    for T, goal in pairwise(waypoints):
        turn = se3.log_so3(goal[:3, :3] @ T[:3, :3].T)
        angle = float(np.linalg.norm(turn))
        count = max(1, int(np.ceil(angle / np.sqrt(8.0 * allowed))))
        for u in np.arange(1, count + 1) / count:
            poses.append(se3.pose(se3.exp_so3(u * turn) @ T[:3, :3], T[:3, 3] + u * (goal[:3, 3] - T[:3, 3])))
        largest = max(largest, (angle / count) ** 2 / 8.0)
    return Chords(np.ascontiguousarray(embed_poses(np.array(poses), 1.0)), np.array([0.0, largest]))


def _search(tool: Array, edges: Array, allowed: Array, rotation: bool = False) -> tuple[float, float, int]:
    """Return factors of one tolerance with which the tool cannot and can follow the polyline, and where it fails first."""
    scale = np.array([1.0, 0.0]) if not rotation else np.array([0.0, 1.0])

    def fails(factor: float) -> int:
        return int(_follow(tool, edges, (np.where(scale > 0.0, factor, 1.0) * allowed) ** 2))

    low, high, worst = 0.0, 1.0, min(fails(0.0), len(tool) - 1)  # an arm with prismatic joints only may never fail
    while (at := fails(high)) < len(tool) and high < 1e12:
        low, high, worst = high, 4.0 * high, at
    while high - low > GAP * high and high > GAP:
        middle = 0.5 * (low + high)
        at = fails(middle)
        if at < len(tool):
            low, worst = middle, at
        else:
            high = middle
    return low, high, worst


@compiled
def _free(p: Array, a: Array, b: Array, allowed: Array) -> tuple[float, float]:
    """Return the part [u, v] of the segment from a to b (12,) whose points are within the squared tolerances (2,) of p."""
    u, v = 0.0, 1.0
    for part in range(2):
        if np.isinf(allowed[part]):
            continue
        dd, df, ff = 0.0, 0.0, 0.0
        for i in range(3 if part else 0, 12 if part else 3):
            d, f = b[i] - a[i], a[i] - p[i]
            dd, df, ff = dd + d * d, df + d * f, ff + f * f
        if dd == 0.0:
            if ff > allowed[part]:
                return 1.0, 0.0
            continue
        disc = df * df - dd * (ff - allowed[part])
        if disc < 0.0:
            return 1.0, 0.0
        root = np.sqrt(disc)
        u, v = max(u, (-df - root) / dd), min(v, (-df + root) / dd)
    return u, v


@compiled
def _follow(tool: Array, edges: Array, allowed: Array) -> int:
    """Return how many points of the tool (k, 12) follow the edges (m, 12) within squared tolerances (2,); k if all.

    Dynamic programming over the free-space diagram (Alt and Godau 1995): `low` and `high` (m − 1,) are the reachable part of
    every edge at one instant.
    """
    k, m = int(tool.shape[0]), int(edges.shape[0])
    low, high = np.full(m - 1, 2.0), np.zeros(m - 1)
    for j in range(m - 1):  # the tool waits at its first point
        u, v = _free(tool[0], edges[j], edges[j + 1], allowed)
        if u > 0.0 or v < u:
            break
        low[j], high[j], last = u, v, j
        if v < 1.0:
            break
    if low[0] > 0.0:
        return 0
    first = 0
    for i in range(k - 1):
        below, alive = 2.0, m  # where along the tool's chord it passes on to the next edge; above 1: nowhere
        for j in range(first, m - 1):
            if j > last and below > 1.0:
                break
            left = low[j] if low[j] <= high[j] else 2.0
            u, v = _free(tool[i + 1], edges[j], edges[j + 1], allowed)
            a, b = _free(edges[j + 1], tool[i], tool[i + 1], allowed)
            low[j], high[j] = u if below <= 1.0 else max(u, left), v
            below = a if left <= 1.0 else max(a, below)
            below = below if below <= b else 2.0
            if low[j] <= high[j]:
                alive, last = min(alive, j), max(last, j)
        if alive == m:
            return i + 1
        first = alive
    arrived = low[m - 2] <= high[m - 2] and high[m - 2] >= 1.0
    return k if arrived else k - 1
