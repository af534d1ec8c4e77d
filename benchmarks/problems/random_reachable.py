"""Random reachable targets: tool poses of random configurations inside the limits, from one fixed start."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.base import ProblemSet, start_of
from optik.arm.robot import Robot
from optik.check import check_count


def random_reachable(robot: Robot, seed: int, *, start_deg: ArrayLike, count: int = 500) -> ProblemSet:
    """Targets at random positions and orientations that the arm can reach.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random draw.
    start_deg : (n,) array
        Start configuration of all problems; prismatic joints in millimetres [deg, mm].
    count : int
        Number of problems.

    Returns
    -------
    ProblemSet
        The problems, in one group.

    Raises
    ------
    InvalidInput
        `count` is not an integer of at least 1, or the start is outside the limits.
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
