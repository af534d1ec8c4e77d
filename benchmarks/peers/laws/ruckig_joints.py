"""Ruckig from the first to the last configuration: the shortest jerk-limited motion in joint space. It leaves the line."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.trajectory import Trajectory

SHORTEST_STEP = 1e-12
"""Fraction of the duration below which steps are rounding between joints that change their jerk together."""


class RuckigJoints(TimingPeer):
    """``Ruckig(n).calculate(input, trajectory)`` with the limits of every joint, time synchronisation (its default)."""

    distribution = "ruckig"
    package = "ruckig"
    settings = (
        "Ruckig(n).calculate from the first to the last configuration of the path, at rest at both, with the limits of every "
        "joint, otherwise defaults (time synchronisation): the motion respects the limits and leaves the line by centimetres, "
        "as its deviation shows; a bound on what ignoring the path gains, not a law for it"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration", "jerk")

    def __init__(self, limits: dict[str, Array]) -> None:
        import ruckig

        self._ruckig: Any = ruckig
        self._limits = limits

    def call(self, joint_path: JointPath) -> Any:
        """Compute the motion in one call."""
        n = joint_path.robot.n
        given, found = self._ruckig.InputParameter(n), self._ruckig.Trajectory(n)
        start, goal = joint_path(np.array([0.0, joint_path.end]))
        given.current_position, given.target_position = start.tolist(), goal.tolist()
        given.max_velocity = self._limits["velocity"].tolist()
        given.max_acceleration = self._limits["acceleration"].tolist()
        given.max_jerk = self._limits["jerk"].tolist()
        result = self._ruckig.Ruckig(n).calculate(given, found)
        if result not in (self._ruckig.Result.Working, self._ruckig.Result.Finished):
            raise NoSolution(f"Ruckig: {result}")
        return found

    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory of Ruckig's cubic pieces, divided wherever a joint changes its jerk."""
        joints = [_joint(profile) for profile in raw.profiles[0]]
        knots = np.unique(np.concatenate([[0.0, raw.duration], *(joint.x for joint in joints)]))
        knots = knots[(knots == 0.0) | (np.diff(knots, prepend=0.0) > SHORTEST_STEP * raw.duration)]
        half = 0.5 * np.diff(knots)
        columns = [_pieces(joint, knots[:-1], half) for joint in joints]
        pieces = np.stack(columns, axis=2)
        return Trajectory(PPoly(pieces, knots, extrapolate=True))


def _joint(profile: Any) -> PPoly:
    """Return the motion of one joint: seven phases of constant jerk."""
    t = np.asarray(profile.t)
    used = t > 0.0
    p, v, a, j = (np.asarray(x)[:7][used] for x in (profile.p, profile.v, profile.a, profile.j))
    if not used.any():
        return PPoly(np.array([[0.0], [0.0], [0.0], [profile.p[0]]]), [0.0, 1.0], extrapolate=True)
    return PPoly(np.stack([j / 6.0, a / 2.0, v, p]), np.r_[0.0, np.cumsum(t[used])], extrapolate=True)


def _pieces(joint: PPoly, left: Array, half: Array) -> Array:
    """Return coefficients (4, m) on pieces from `left`; jerk and acceleration from their middles, where they do not jump."""
    j, a = joint(left + half, nu=3), joint(left + half, nu=2)
    return np.stack([j / 6.0, (a - j * half) / 2.0, joint(left, nu=1), joint(left)])


METHOD = RuckigJoints
