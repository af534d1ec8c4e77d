"""Greatest speed of the tool's point and of its rotation along a trajectory: proved upper bounds, not samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array
from planners.certificate.bounds import Instants, MotionBounds, bezier_bound, joint_bounds, tool_bounds
from planners.trajectory import Trajectory

LOOSE = 1e-6
"""A bound may be so much above the largest value found, as a share of it."""
FLOOR = 1e-6
"""…or this [m/s or rad/s]."""
MOST = 200_000
"""Intervals at most; a motion that needs more keeps the bound it has then."""


class ToolSpeed(NamedTuple):
    """Proved bounds on |v| [m/s] and |ω| [rad/s] of the tool at every instant, and when they are nearly reached [s]."""

    speed: float
    rotation: float
    t_speed: float
    t_rotation: float


def tool_speed(robot: Robot, trajectory: Trajectory, bounds: MotionBounds | None = None) -> ToolSpeed:
    """Bound the tool's speeds at every instant of a motion.

    Between instants v and ω are bounded by their cubics and their fourth derivatives (`planners.certificate.bounds`); intervals
    that may hold more than the largest value found are halved until they hold 1e-6 of it more at most.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        Its motion.
    bounds : MotionBounds, optional
        Of that motion, where they are known already.

    Returns
    -------
    ToolSpeed
        Bounds, and the instants of the largest values found.
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    found, when, proved = np.zeros(2), np.zeros(2), np.zeros(2)
    left, right = bounds.ends
    for side in (left, right):
        _largest(side.t, side.motion, found, when)
    piece, kept, shortest = np.arange(trajectory.knots.size - 1), 0, 1e-9 * trajectory.end
    while True:
        between, loose = np.empty((piece.size, 2)), np.empty(piece.size, np.bool_)
        _intervals(bounds.links, robot.prismatic, left, right, between)
        kept += _passing(between, right.t - left.t, found, shortest, MOST - kept, proved, loose)
        if not loose.any():
            break
        piece = piece[loose]
        left, right = (Instants(*(x[loose] for x in side)) for side in (left, right))
        middle = bounds.at(piece, 0.5 * (left.t + right.t))
        _largest(middle.t, middle.motion, found, when)
        piece = np.concatenate([piece, piece])
        left, right = (
            Instants(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))
            for a, b in ((left, middle), (middle, right))
        )
    proved = np.maximum(proved, found)
    return ToolSpeed(float(proved[0]), float(proved[1]), float(when[0]), float(when[1]))


@compiled
def _norm(x: Array) -> float:
    return float(np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]))


@compiled
def _largest(t: Array, motion: Array, found: Array, when: Array) -> None:
    """Keep the largest speeds of given instants."""
    for k in range(t.shape[0]):
        for i in range(2):
            size = _norm(motion[k, 0, 3 * i : 3 * i + 3])
            if size > found[i]:
                found[i], when[i] = size, t[k]


@compiled
def _passing(
    between: Array, h: Array, found: Array, shortest: float, room: int, proved: Array, loose: NDArray[np.bool_]
) -> int:
    """Which intervals may hold more than was found; the bounds of the others count. Returns how many these are."""
    number = 0
    for k in range(h.shape[0]):
        loose[k] = h[k] > shortest and (
            between[k, 0] > max(found[0] * (1.0 + LOOSE), FLOOR) or between[k, 1] > max(found[1] * (1.0 + LOOSE), FLOOR)
        )
        number += loose[k]
    for k in range(h.shape[0]):
        loose[k] = loose[k] and number <= room
        if not loose[k]:
            for i in range(2):
                proved[i] = max(proved[i], between[k, i])
    return len(h) - number


@compiled
def _intervals(links: Array, prismatic: NDArray[np.bool_], left: Instants, right: Instants, out: Array) -> None:
    """Bounds (k, 2) on |v| and |ω| within intervals of time."""
    k = left.t.shape[0]
    h = right.t - left.t
    D, moves, turns, spin = np.empty(left.joints.shape), np.empty((k, 6)), np.empty((k, 6)), np.empty(k)
    joint_bounds(left.joints, h, D)
    tool_bounds(links, prismatic, D, moves, turns, spin)
    for i in range(k):
        a, b = left.motion[i], right.motion[i]
        out[i, 0] = bezier_bound(a[0, :3], a[1, :3], b[0, :3], b[1, :3], h[i], moves[i, 5])
        out[i, 1] = bezier_bound(a[0, 3:], a[1, 3:], b[0, 3:], b[1, 3:], h[i], spin[i])
