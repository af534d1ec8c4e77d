"""Greatest speeds of the tool's point and of its rotation along a trajectory: proved upper bounds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import Instants, MotionBounds, bezier_bound, joint_bounds, tool_bounds
from planners.certificate.dividing import Closeness, SubdivisionBound, repeat_ends
from planners.trajectory import Trajectory

SPEED_EXCESS = 1e-6
"""Largest excess of the bound over the largest speed found, as a fraction of it."""
SPEED_FLOOR = 1e-6
"""Least speed [m/s or rad/s] that the excess is relative to."""
SPEED_INTERVALS = 200_000
"""Largest number of intervals: minutes of computing; a motion that needs more has a looser bound."""
MOVES_AND_TURNS = np.repeat(np.eye(2), 3, axis=0)
"""Matrix from the squares of a twist (6,) to |v|² and |ω|²."""


class ToolSpeed(NamedTuple):
    """Proved bounds on |v| [m/s] and |ω| [rad/s] of the tool over a motion, and the times of the peaks [s]."""

    speed: float
    rotation: float
    t_speed: float
    t_rotation: float


def tool_speed(robot: Robot, trajectory: Trajectory, bounds: MotionBounds | None = None) -> ToolSpeed:
    """Return proved bounds on the tool's speeds over a motion.

    Between instants v and ω are bounded by their cubic interpolants and fourth derivatives (`planners.certificate.bounds`).
    Intervals are divided until the bounds exceed the largest values found by at most 1e-6 of them.
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    speeds = _Speeds(bounds, trajectory.end)
    proved = speeds.bound(np.arange(trajectory.knots.size - 1), *bounds.ends)
    return ToolSpeed(float(proved[0]), float(proved[1]), float(speeds.when[0]), float(speeds.when[1]))


class _Speeds(SubdivisionBound[Instants]):
    """|v| and |ω| of the tool."""

    def __init__(self, bounds: MotionBounds, duration: float) -> None:
        super().__init__(duration, Closeness(1.0 + SPEED_EXCESS, np.full(2, SPEED_FLOOR), SPEED_INTERVALS))
        self._bounds = bounds

    def between(self, left: Instants, right: Instants) -> Array:
        out = np.empty((left.t.size, 2))
        speeds_within(self._bounds.links, self._bounds.robot.prismatic, left, right, out)
        return out

    def within(self, piece: Indices, left: Instants, right: Instants, shares: Array) -> Instants:
        times = shares.size // piece.size
        t = repeat_ends(left.t, times) + shares * repeat_ends(right.t - left.t, times)
        return self._bounds.at(repeat_ends(piece, times), t)

    def values(self, side: Instants) -> Array:
        twist = side.motion[:, 0]
        return np.asarray(np.sqrt((twist * twist) @ MOVES_AND_TURNS))


@compiled
def speeds_within(links: Array, prismatic: Flags, left: Instants, right: Instants, out: Array) -> None:
    """Compute bounds on |v| and |ω| of the tool within intervals of time.

    Shapes and units: links (n + 1,) [m], prismatic (n,), out (k, 2) [m/s, rad/s].
    """
    k = left.t.shape[0]
    h = right.t - left.t
    D, moves, turns, spin = np.empty(left.joints.shape), np.empty((k, 6)), np.empty((k, 6)), np.empty(k)
    joint_bounds(left.joints, h, D)
    tool_bounds(links, prismatic, D, moves, turns, spin)
    for i in range(k):
        a, b = left.motion[i], right.motion[i]
        out[i, 0] = bezier_bound(a[0, :3], a[1, :3], b[0, :3], b[1, :3], h[i], moves[i, 5])
        out[i, 1] = bezier_bound(a[0, 3:], a[1, 3:], b[0, 3:], b[1, 3:], h[i], spin[i])
