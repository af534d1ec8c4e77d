"""One quintic in s for the whole path, from rest to rest, in the shortest time that keeps every limit."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.interpolate import PPoly

from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.fit import fitted
from planners.following.follow import JointPath
from planners.limits import ALL_LIMITS, MotionLimits
from planners.timing.base import TimeLaw, refit, speed_bound
from planners.trajectory import Trajectory

QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
"""s / L = 10 u³ − 15 u⁴ + 6 u⁵ with u = t / T, highest power first: no speed and no acceleration at either end."""
NO_MOTION = 1e-11
"""Joint motions below this are rounding [rad or m]: a limit on such a joint bounds no motion."""


class Smooth(TimeLaw):
    """s(t) = L (10 u³ − 15 u⁴ + 6 u⁵), u = t / T (Biagiotti and Melchiorri, Trajectory Planning, §2.1.6).

    At a given u, every velocity goes with 1/T, every acceleration with 1/T² and every jerk with 1/T³: one evaluation
    along u gives the shortest T. Jerk is continuous inside and starts and ends with a jump that the limit bounds.
    """

    name: ClassVar[str] = "smooth"
    keeps: ClassVar[tuple[str, ...]] = ALL_LIMITS

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Time the joint path.

        Raises
        ------
        InvalidInput
            Velocity, acceleration or jerk limits are missing.
        NoSolution
            No limit bounds a joint that moves.
        """
        bound = self.need(limits, joint_path.robot)
        duration = least_duration(joint_path, limits)
        c = joint_path.end * QUINTIC / duration ** np.arange(5, -1, -1)
        law = PPoly(c[:, None], np.array([0.0, duration]), extrapolate=True)
        return fitted(joint_path.robot, refit(joint_path, law, bound["jerk"]), limits, self.keeps)


def least_duration(joint_path: JointPath, limits: MotionLimits, instants: int = 1001) -> float:
    """Shortest T [s] of one quintic in s that keeps the limits at so many instants, and wherever the path has a node.

    Raises
    ------
    InvalidInput
        A path without length.
    NoSolution
        No limit bounds a joint that moves.
    """
    if not joint_path.end > 0.0:
        raise InvalidInput("joint_path", "a length of 0", "a path whose ends differ")
    moving = np.ptp(joint_path.q, axis=0) > NO_MOTION
    bound = {field: np.where(moving, of, np.inf) for field, of in limits.arrays(joint_path.robot.n).items()}
    bounded = MotionLimits(bound["velocity"], None, None, limits.tool_speed, limits.rotation_speed)
    u = np.union1d(np.linspace(0.0, 1.0, instants), _when(joint_path.nodes / joint_path.end))
    s, v, a, j = (joint_path.end * np.polyval(np.polyder(QUINTIC, order), u) for order in range(4))
    s = np.clip(s, 0.0, joint_path.end)
    q1, q2, q3 = (joint_path(s, order) for order in (1, 2, 3))
    v1, a1, j1 = v[:, None], a[:, None], j[:, None]
    duration: float = max(
        float((v / speed_bound(joint_path, bounded, s)).max()),
        float((np.abs(q1 * a1 + q2 * v1**2) / bound["acceleration"]).max()) ** (1.0 / 2.0),
        float((np.abs(q1 * j1 + 3.0 * q2 * v1 * a1 + q3 * v1**3) / bound["jerk"]).max()) ** (1.0 / 3.0),
    )
    if not 0.0 < duration < np.inf:
        names = ", ".join(joint_path.robot.joint_names[i] for i in np.flatnonzero(moving))
        raise NoSolution("nothing limits this motion", s=0.0, advice=f"a finite limit on a joint that moves: {names}")
    return duration


def _when(part: Array) -> Array:
    """Shares u (k,) of the duration after which the quintic has come to parts of the way, and between, in thirds."""
    low, high = np.zeros(part.size), np.ones(part.size)
    for _ in range(50):
        u = 0.5 * (low + high)
        before = np.polyval(QUINTIC, u) < part
        low, high = np.where(before, u, low), np.where(before, high, u)
    return np.concatenate([low[:-1] + np.diff(low) * share for share in (0.0, 1.0 / 3.0, 2.0 / 3.0)])


METHOD = Smooth
