"""Random reachable targets: tool poses of configurations drawn inside the limits, from one fixed start."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.base import ProblemSet, start_of
from optik.arm.robot import Robot
from optik.check import check_count


def random_reachable(robot: Robot, seed: int, *, start_deg: ArrayLike, count: int = 500) -> ProblemSet:
    """Targets at any position and orientation that the arm can take.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Of the draw.
    start_deg : (n,) array
        The one start configuration [degrees].
    count : int
        How many.
    """
    check_count(count, "count", 1)
    q0 = start_of(robot, start_deg)
    rng = np.random.default_rng((seed, 1))
    q = robot.limits.draw(rng, count)
    return ProblemSet(
        robot.fk(q),
        np.tile(q0, (count, 1)),
        np.full(count, "random"),
        np.ones(count, dtype=bool),
        robot.singular_values(q)[:, -1],
        np.full(count, np.nan),
    )


METHOD = random_reachable
