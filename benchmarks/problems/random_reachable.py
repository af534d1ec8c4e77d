"""Random reachable targets: tool poses of random configurations inside the limits."""

from __future__ import annotations

import numpy as np

from benchmarks.problems.base import with_starts
from optik.arm.robot import Robot
from optik.check import check_count
from optik.types import Array


@with_starts
def random_reachable(robot: Robot, seed: int, *, count: int = 500) -> dict[str, Array]:
    """Targets at random positions and orientations that the arm can reach, from one fixed start or several kinds of starts.

    The first problems are the same for any larger count.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random draw.
    count : int
        Number of targets.

    Returns
    -------
    dict of (count, n) arrays
        Configurations that reach the targets, one group [rad, m].

    Raises
    ------
    InvalidInput
        `count` is not an integer of at least 1.
    """
    check_count(count, "count", 1)
    return {"random": robot.limits.sample(np.random.default_rng((seed, 1)), count)}


METHOD = random_reachable
