"""One quintic in s for the whole path, from rest to rest, in the shortest time that respects every limit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy

from optik.errors import InvalidInput
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.following.follow import JointPath
from planners.limits import ALL_LIMITS, MotionLimits, PathPoints
from planners.motion.motion import stretch_analysed
from planners.timing.base import TimeLaw, find_moving, refit, refuse_free_motion
from planners.trajectory.curve import find_times

QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
"""s / L = 10 u³ − 15 u⁴ + 6 u⁵ with u = t / T, highest power first: no speed and no acceleration at either end."""


class Smooth(TimeLaw):
    """s(t) = L (10 u³ − 15 u⁴ + 6 u⁵), u = t / T (Biagiotti and Melchiorri, Trajectory Planning, §2.1.6).

    At a given u, every velocity goes with 1/T, every acceleration with 1/T² and every jerk with 1/T³: one evaluation
    along u gives the shortest T. Jerk is continuous inside and starts and ends with a jump that the limit bounds.
    """

    name: ClassVar[str] = "smooth"
    enforced: ClassVar[tuple[str, ...]] = ALL_LIMITS

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> MotionAnalysis:
        bound, duration = limits.arrays(joint_path.robot.n), least_duration(joint_path, limits)
        c = joint_path.end * QUINTIC / duration ** np.arange(5, -1, -1)
        law = scipy.interpolate.PPoly(c[:, None], np.array([0.0, duration]), extrapolate=True)
        motion = MotionAnalysis(joint_path.robot, refit(joint_path, law, bound["jerk"]), joint_path.path)
        return stretch_analysed(motion, limits, self.list_enforced(limits))


def least_duration(joint_path: JointPath, limits: MotionLimits, instants: int = 1001) -> float:
    """Return the shortest T of one quintic in s that respects the limits at sampled instants and around every node."""
    if not joint_path.end > 0.0:
        raise InvalidInput("joint_path", "a length of 0", "a path whose ends differ")
    moving, bound = find_moving(joint_path), limits.arrays(joint_path.robot.n)
    free: dict[str, Any] = {field: np.where(moving, of, np.inf) for field, of in bound.items()}
    limits = replace(limits, **free)
    u = np.union1d(np.linspace(0.0, 1.0, instants), _sample_times(joint_path.nodes / joint_path.end))
    s, *rates = (np.asarray(joint_path.end * np.polyval(np.polyder(QUINTIC, k), u)) for k in range(4))
    at = PathPoints(joint_path, np.clip(s, 0.0, joint_path.end))
    ratios = [
        (float(limits.ratios(kind.name, at, rates).max()), kind.order) for kind in limits.kinds if kind.homogeneous
    ]
    duration: float = max(ratio ** (1.0 / order) for ratio, order in ratios)
    if not 0.0 < duration < np.inf:
        refuse_free_motion(joint_path, moving)
    return duration


def _sample_times(part: Array) -> Array:
    """Return fractions u (k,) of the duration at which the quintic reaches fractions of the path, and thirds between."""
    low = find_times(lambda u: np.polyval(QUINTIC, u), part, 1.0)
    return np.concatenate([low[:-1] + np.diff(low) * share for share in (0.0, 1.0 / 3.0, 2.0 / 3.0)])


METHOD = Smooth
