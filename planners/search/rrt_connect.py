"""RRT-Connect: two trees of proved edges, from the start and from the goals, grow towards random configurations."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik.check import check_count, check_number
from optik.types import Array
from planners.search._trees import connect, trace_tree
from planners.search.base import JointSpace, Search, SearchAttempt

NODES_OF_A_SAMPLE = 4
"""Room of a tree for this many configurations a sample; the trees start anew when it is used up."""
RESTART_GROWTH, MOST_RESTART = 4, 1_000_000
"""Ratio of the second number of samples before a restart to the first, and the largest number, which memory limits."""


class RRTConnect(Search):
    """RRT-Connect (Kuffner and LaValle 2000) with proved edges; after the first restart every second sample is local.

    Parameters
    ----------
    max_samples : int
        Largest number of random configurations.
    step : float
        Longest edge in joint space [rad, m].
    restart : int
        Number of samples before the first restart of both trees; a second one follows after four times as many. Long searches
        rarely succeed, so restarts save time. The last trees grow large, as narrow passages need.
    """

    name: ClassVar[str] = "rrt_connect"

    def __init__(self, max_samples: int = 100_000, step: float = 1.0, restart: int = 5_000) -> None:
        super().__init__(max_samples)
        self.step = check_number(step, "step", "a joint motion above 0 [rad, m]", above=0.0)
        check_count(restart, "restart", 1, MOST_RESTART)
        self.restart = restart

    def search(self, space: JointSpace, start: Array, goals: Array, seed: tuple[int, ...]) -> SearchAttempt:  # noqa: D102
        used, attempt, ranges = 0, 0, np.stack(space.find_range(np.array([start, *goals])))
        while used < self.max_samples:
            most = self.restart * RESTART_GROWTH**attempt if attempt < 2 else MOST_RESTART
            count = min(most, MOST_RESTART, self.max_samples - used)
            attempt += 1
            samples = np.random.default_rng((*seed, attempt)).uniform(ranges[0], ranges[1], (count, len(start)))
            local = attempt > 1
            if space.robot.motors is not None:  # whose range is convex: edges between samples of it stay inside
                samples, local = space.robot.limits.clip(samples), False
            room = NODES_OF_A_SAMPLE * count + len(goals) + 2
            trees = np.empty((2, room, len(start))), np.full((2, room), -1), np.array([1, len(goals)])
            trees[0][0, 0], trees[0][1, : len(goals)] = start, goals
            done, first, last = connect(space.body, trees, samples, ranges, local, self.step, space.work)
            used += done
            if first >= 0:
                return SearchAttempt(trace_tree(trees, first, last), used)
        return SearchAttempt(None, used)


METHOD = RRTConnect
