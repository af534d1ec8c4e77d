"""An IK method of this package: random steps that are kept where they help."""

from __future__ import annotations

import numpy as np

from optik import se3
from optik.ik.base import Attempt, IKSolver, IKStatus


class RandomSearch(IKSolver):
    """Random steps, shorter after every failure; slow, but it needs no derivatives."""

    name = "random_search"  # as the entry point says

    def attempt(self, target, start, trace, time_limit):
        """Return one attempt from the initial guess."""
        robot, rng, q, size = self.robot, np.random.default_rng(0), start.copy(), 0.3
        error = np.linalg.norm(se3.error(robot.fk(q), target))
        for k in range(self.max_iterations):
            if error < min(self.tolerance.position, self.tolerance.rotation):
                return Attempt(q, IKStatus.SOLVED, k)
            tried = robot.limits.clip(q + size * rng.normal(size=robot.n))
            found = np.linalg.norm(se3.error(robot.fk(tried), target))
            q, error, size = (tried, found, 1.5 * size) if found < error else (q, error, 0.9 * size)
        return Attempt(q, IKStatus.MAX_ITERATIONS, self.max_iterations)
