"""A problem set in one file: targets at a given distance from the tool at random starts, some of them unreachable."""

from __future__ import annotations

import numpy as np

from benchmarks.problems.base import ProblemSet
from optik.check import check_count, check_number


def beside(robot, seed, *, count=100, distance=0.1):
    """Return targets near the tool, with its orientation.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random numbers: equal seeds give equal problems.
    count : int
        Number of problems.
    distance : float
        Distance from the tool at the start [m].

    Returns
    -------
    ProblemSet
        The problems.
    """
    check_count(count, "count", 1)
    check_number(distance, "distance", "metres above 0", above=0.0)
    rng = np.random.default_rng((seed, 5))
    starts = robot.limits.sample(rng, count)
    way = rng.normal(size=(count, 3))
    targets = robot.fk(starts)
    targets[:, :3, 3] += distance * way / np.linalg.norm(way, axis=1, keepdims=True)
    unknown = np.full(count, np.nan)
    return ProblemSet(targets, starts, np.full(count, "beside"), np.zeros(count, dtype=bool), unknown, unknown)


METHOD = beside
