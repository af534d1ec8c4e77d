"""Branch and winding for a whole path: every configuration at its start is tracked to the end, and the best one chosen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik import kinematics
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.types import Array
from planners.following import march
from planners.following.course import Course, unguided
from planners.following.singular import departures, roots
from planners.following.track import Ended, Track, track
from planners.paths.base import Path

STATIONS = 31
"""Equal samples along the path on which branches are compared; more are put between them where they are needed."""

SAME = 1e-4
"""Configurations nearer than this on every joint, whole turns aside, are one."""

MOTION, LIMITS, SINGULAR, START = 1.0, 0.5, 0.2, 1.0
"""Weights of a branch's cost: the length of its way in joint space [rad or m]; the mean over the path of the sum over the
joints of ((q − middle) / half range)²; −ln of the smallest singular value on the way; and, where a start was given, the
distance from it [rad or m]."""


class Branch(NamedTuple):
    """One way to follow a path.

    Attributes
    ----------
    q : (n,) array
        Configuration at the path's start, its winding the one that goes farthest, and of those the cheapest.
    cost : float
        See the weights of this module; lower is better.
    s : float
        How far it goes: the path's end, or where it ends.
    ended : Ended or None
        How it ends early.
    """

    q: Array
    cost: float
    s: float
    ended: Ended | None


def branches(robot: Robot, path: Path, near: Array | None = None) -> list[Branch]:
    """Track every branch of the path's start to its end; the best first, then those that end early, the farthest first.

    For an arm of up to six joints a configuration that is not singular has exactly one continuation, so there is nothing
    else to choose from: dynamic programming over stations would have one successor to each state. A winding of a joint
    fits if the joint, with these whole turns, stays inside its limits all along the path; joints are wound one by one,
    as neither motion nor cost couples them.

    Parameters
    ----------
    robot : Robot
        Of up to six joints.
    path : Path
        What to follow.
    near : (n,) array, optional
        Prefer branches that start near it.

    Returns
    -------
    list of Branch
        Empty where no configuration meets the path's start from which a motion goes on.
    """
    tolerance, course = Tolerance(1e-5, 1e-5), Course(path, unguided(robot.n))
    nodes = course.nodes(course.spread(np.linspace(0.0, path.end, STATIONS), tolerance))
    open_ended = np.full(robot.n, np.inf)
    found = []
    for root in _starts(robot, course, nodes.poses[0], near):
        way = track(robot, course, nodes, root, tolerance, (-open_ended, open_ended))
        if len(way.s) > 1:
            found.append(_wound(robot, path, way, near))
        else:
            found.append(Branch(root, np.inf, 0.0, way.ended))
    return sorted(found, key=lambda branch: (-branch.s, branch.cost))


def _starts(robot: Robot, course: Course, pose: Array, near: Array | None) -> Array:
    """Configurations (k, n) inside the limits at the path's start, each once whatever its winding.

    The regular ones, and where there are singular ones, which meet the pose along whole curves, those from which a motion
    goes on.
    """
    start = near if near is not None and robot.limits.contains(near) else None
    found, singular = roots(robot, pose, march.REGULAR, start)
    if singular:
        goes_on = [left.q for left, _ in departures(robot, course)]
        found = np.concatenate([found, np.array(goes_on).reshape(-1, robot.n)])
    kept: list[Array] = []
    turn = 2.0 * np.pi * ~robot.prismatic
    for q in found:
        apart = (q - known for known in kept)
        if all(np.abs(d - turn * np.round(d / (2.0 * np.pi))).max() > SAME for d in apart):
            kept.append(q)
    return np.array(kept).reshape(-1, robot.n)


def _wound(robot: Robot, path: Path, way: Track, near: Array | None) -> Branch:
    """The branch with the winding of every joint that goes farthest, and of those the cheapest."""
    turns, ends, joint, posture = np.zeros(robot.n), np.inf, -1, 0.0
    for i in range(robot.n):
        leaves, _, cost, k = min(_windings(robot, way, i, near), key=lambda w: (-w[0], w[1]))
        turns[i], posture = 2.0 * np.pi * k, posture + cost
        if leaves < ends:
            ends, joint = leaves, i
    end, ended = float(way.s[-1]), way.ended
    if ends < end:
        end, ended = ends, Ended(march.LIMIT, ends, 0.0, joint)
    motion = float(np.linalg.norm(np.diff(way.q, axis=0), axis=1).sum())
    q = way.q[0] + turns
    sigma = np.empty(len(way.s))
    kinematics.singular_values_batch(robot.chain, np.ascontiguousarray(way.q), sigma)
    cost = MOTION * motion + posture - SINGULAR * float(np.log(np.maximum(sigma.min(), march.SMALLEST_SINGULAR_VALUE)))
    if near is not None:
        cost += START * float(np.linalg.norm(q - near))
    return Branch(q, cost, path.end if ended is None else end, ended)


def _windings(robot: Robot, way: Track, i: int, near: Array | None) -> list[tuple[float, float, float, int]]:
    """Where joint i leaves its limits (infinity: nowhere), what that costs with and without the way from the start, turns.

    For each winding that starts inside.
    """
    low, high = robot.limits.lower[i], robot.limits.upper[i]
    q, turn = way.q[0, i], 2.0 * np.pi
    if robot.prismatic[i] or low == high:
        first = last = 0
    elif np.isinf(low) or np.isinf(high):  # as near as can be to the start, or to the end that there is
        goal = near[i] if near is not None else np.clip(0.0, low, high)
        first = last = int(np.round((goal - q) / turn))
        if not low <= q + turn * first <= high:
            first = last = int(np.ceil((low - q) / turn) if np.isinf(high) else np.floor((high - q) / turn))
    else:
        first, last = int(np.ceil((low - 1e-9 - q) / turn)), int(np.floor((high + 1e-9 - q) / turn))
    finite = np.isfinite(low) and np.isfinite(high) and low < high
    steps = np.gradient(way.s) / (way.s[-1] - way.s[0])
    out = []
    for k in range(first, last + 1):
        shift = np.zeros(robot.n)
        shift[i] = k * turn
        lower, upper = robot.limits.lower - shift - LIMIT_TOLERANCE, robot.limits.upper - shift + LIMIT_TOLERANCE
        leaves = march.leaves(way.s, way.q, way.dq, lower, upper, i)
        x = (way.q[:, i] + k * turn - 0.5 * (low + high)) / (0.5 * (high - low)) if finite else np.zeros(len(way.s))
        cost = LIMITS * float(x**2 @ steps)
        away = START * abs(q + k * turn - near[i]) if near is not None else 0.0
        out.append((leaves, cost + away, cost, k))
    return out or [(0.0, 0.0, 0.0, 0)]
