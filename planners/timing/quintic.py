"""The paper's time law: constant tool speed, velocities J⁻¹V and no acceleration at samples, rest at both ends."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik.check import check_number
from optik.errors import InvalidInput
from planners.following.follow import JointPath
from planners.limits import MotionLimits
from planners.motion.motion import find_stretch_factor
from planners.timing.base import TimeLaw
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through


class Quintic(TimeLaw):
    """Quintic segments between samples Δt apart, exactly as in the paper (§3.3, eq. 16–17); the baseline.

    The law ignores all limits. Its first and last segments accelerate within one Δt; the certificate shows the violations.

    Parameters
    ----------
    duration : float
        T [s].
    step : float
        Δt [s]; T / Δt segments, rounded to a whole number.

    Raises
    ------
    InvalidInput
        Durations that are not above 0, or a step longer than half the duration.
    """

    name: ClassVar[str] = "quintic"
    enforced: ClassVar[tuple[str, ...]] = ()

    def __init__(self, *, duration: float = 3.0, step: float = 0.02) -> None:
        self.duration = check_number(duration, "duration", "seconds above 0", above=0.0)
        wanted = "seconds above 0, at most half the duration"
        if check_number(step, "step", wanted, above=0.0) > 0.5 * self.duration:
            raise InvalidInput("step", step, wanted)
        self.segments = round(duration / step)

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        t = np.linspace(0.0, self.duration, self.segments + 1)
        s = np.linspace(0.0, joint_path.end, self.segments + 1)
        q = joint_path(s)
        velocity = joint_path(s, 1) * (joint_path.end / self.duration)  # J⁻¹ V: q' times the constant ṡ
        velocity[0] = velocity[-1] = 0.0
        return Trajectory(quintic_through(t, q, velocity, np.zeros_like(q)), s)

    def least_duration(self, joint_path: JointPath, limits: MotionLimits) -> float:
        """Return the least T at which the law respects all limits, with the same number of segments.

        With a fixed number of segments, T only scales the motion in time: velocities with 1/T, accelerations with 1/T² and
        jerks with 1/T³. So the result is exact, from the extrema of one motion. It is 0 without limits.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.

        Returns
        -------
        float
            T [s].
        """
        return self.duration * find_stretch_factor(self.run_with_analysis(joint_path, limits), limits)


METHOD = Quintic
