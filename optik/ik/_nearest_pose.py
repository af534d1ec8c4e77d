"""Nearest pose inside the limits: the configuration of least squared error if there is no solution."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.ik._gauss_newton import NO_TRACE, descend_inside
from optik.newton import GAIN, LEAST_DAMPING
from optik.task import Task
from optik.types import Array

DESCENT_PATIENCE, DESCENT_PROGRESS = 12, 1.0 - 1e-12
"""The descent ends after this number of consecutive steps [1] that do not reduce ½|e|² by a fraction of 1e-12. The damping
has then grown by DESCENT_GROWTH¹²."""

DESCENT_GROWTH = 4.0
"""Growth of λ² after a step that does not reduce ½|e|² [1] (Marquardt 1963)."""


def find_nearest_pose(robot: Robot, task: Task, target: Array, starts: Array, max_iterations: int = 500) -> Array:
    """Return the configuration inside the limits with the least ½|e|² found from some initial guesses (k, n)."""
    q, best, least = robot.limits.clip(starts), starts[0], np.inf
    limits, goal = (robot.limits.lower, robot.limits.upper), (task.flags, target)
    rule = (
        0.0,
        0.0,
        float(max_iterations),
        float(DESCENT_PATIENCE),
        DESCENT_PROGRESS,
        GAIN,
        LEAST_DAMPING,
        DESCENT_GROWTH,
    )
    for one in q:
        _, _, p2, r2 = descend_inside(robot.chain, limits, goal, rule, 0, one, NO_TRACE)
        if p2 + r2 < least:
            best, least = one, p2 + r2
    return np.asarray(best)
