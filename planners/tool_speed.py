"""Greatest speed of the tool's point and of its rotation along a trajectory: proved upper bounds, not samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.robot import Robot
from planners.motion_bounds import Instants, MotionBounds, hermite_bound
from planners.trajectory import Trajectory

Array = NDArray[np.float64]

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

    Between instants v and ω are bounded by their cubics and their fourth derivatives (`planners.motion_bounds`); intervals
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
    piece = np.arange(trajectory.knots.size - 1)
    left, right = bounds.ends
    found, when, proved = np.zeros(2), np.zeros(2), np.zeros(2)
    _note(left, found, when)
    _note(right, found, when)
    kept = 0
    while True:
        between = _between(bounds, left, right)
        loose = (between > np.maximum(found * (1.0 + LOOSE), FLOOR)).any(axis=1)
        loose &= (right.t - left.t > 1e-9 * trajectory.end) & (kept + loose.sum() <= MOST)
        proved = np.maximum(proved, between[~loose].max(axis=0, initial=0.0))
        if not loose.any():
            break
        kept += int(np.count_nonzero(~loose))
        piece = piece[loose]
        left, right = (Instants(*(x[loose] for x in side)) for side in (left, right))
        middle = bounds.at(piece, 0.5 * (left.t + right.t))
        _note(middle, found, when)
        piece = np.concatenate([piece, piece])
        left, right = (
            Instants(*(np.concatenate(pair) for pair in zip(a, b, strict=True)))
            for a, b in ((left, middle), (middle, right))
        )
    proved = np.maximum(proved, found)
    return ToolSpeed(float(proved[0]), float(proved[1]), float(when[0]), float(when[1]))


def _note(instants: Instants, found: Array, when: Array) -> None:
    for i, part in enumerate((slice(0, 3), slice(3, 6))):
        size = np.linalg.norm(instants.motion[:, 0, part], axis=1)
        k = int(size.argmax())
        if size[k] > found[i]:
            found[i], when[i] = size[k], instants.t[k]


def _between(bounds: MotionBounds, left: Instants, right: Instants) -> Array:
    h = right.t - left.t
    moves, _, spin = bounds.between(left, h)
    both = []
    for part, fourth in ((slice(0, 3), moves[:, 5]), (slice(3, 6), spin)):
        a, b = left.motion[:, :, part], right.motion[:, :, part]
        both.append(hermite_bound(a[:, 0], a[:, 1], b[:, 0], b[:, 1], h, fourth))
    return np.stack(both, axis=1)
