"""Scale a motion uniformly in time until it reaches a limit and exceeds none."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.errors import NoSolution
from planners.certificate.analysis import MotionAnalysis
from planners.limits import MotionLimits, check_names
from planners.paths.base import Path
from planners.trajectory import Trajectory

FIRST_MARGIN = 1e-12
"""Relative margin of a second slow-down, needed if rounding still exceeds a limit; ten times as much for each further one."""

SPARE = 1e-6
"""Largest fraction of the duration that a scaled motion may be too slow: gravity does not scale with a power of the speed."""

MOST_SPEED_UPS = 4
"""Most times that such a motion is sped up again; each adds a few digits."""


def stretch_factor(motion: MotionAnalysis, limits: MotionLimits, enforced: tuple[str, ...] | None = None) -> float:
    """Return the least factor by which a motion from rest to rest is stretched in time to respect the limits."""
    if enforced is not None:
        check_names(enforced, "enforced")
    bounds = limits.bounds(motion.robot.n)
    chosen = [kind for kind in limits.kinds if enforced is None or kind.name in enforced]
    return max((kind.stretch_factor(motion, bounds[kind.name]) for kind in chosen), default=0.0)


def is_within(motion: MotionAnalysis, limits: MotionLimits, names: tuple[str, ...]) -> bool:
    """Say whether a motion respects these limits, as the certificate judges them."""
    bounds = limits.bounds(motion.robot.n)
    chosen = [kind for kind in limits.kinds if kind.name in names and np.isfinite(bounds[kind.name]).any()]
    return all(float(np.nanmax(kind.judge(motion, bounds[kind.name]).ratio)) <= 1.0 for kind in chosen)


def fit_to_limits(
    robot: Robot,
    trajectory: Trajectory,
    limits: MotionLimits,
    enforced: tuple[str, ...] | None = None,
    path: Path | None = None,
) -> Trajectory:
    """Return a motion from rest to rest, scaled in time to reach a limit and exceed none."""
    return fit(MotionAnalysis(robot, trajectory, path), limits, enforced).trajectory


def fit(motion: MotionAnalysis, limits: MotionLimits, enforced: tuple[str, ...] | None = None) -> MotionAnalysis:
    """Return a motion from rest to rest, scaled in time to reach a limit and exceed none, with its analysis."""
    factor = stretch_factor(motion, limits, enforced)
    if not factor > 0.0:
        return motion
    margin = 0.0
    while True:
        if not np.isfinite(factor):
            raise NoSolution("a limit is exceeded at any speed", advice="another path, or higher limits")
        motion = motion.slowed(factor * (1.0 + margin))
        factor = stretch_factor(motion, limits, enforced)
        if factor <= 1.0:
            break
        margin = 10.0 * margin if margin else FIRST_MARGIN  # rounding in the scaled motion may still exceed a limit
    for _ in range(MOST_SPEED_UPS):
        if not 0.0 < factor < 1.0 - SPARE:
            break
        closer = motion.slowed(factor)
        factor = stretch_factor(closer, limits, enforced)
        if factor > 1.0:
            break
        motion = closer
    return motion
