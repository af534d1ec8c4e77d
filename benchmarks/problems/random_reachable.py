"""Random reachable targets: tool poses of random configurations inside the limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems._starts import from_solutions
from benchmarks.problems.base import ProblemSet
from optik.arm.robot import Robot
from optik.check import check_count


def random_reachable(
    robot: Robot,
    seed: int,
    *,
    start_deg: ArrayLike | None = None,
    count: int = 500,
    starts: str | Sequence[str] | None = None,
    spread: float = 0.1,
) -> ProblemSet:
    """Targets at random positions and orientations that the arm can reach, from one fixed start or several kinds of starts.

    The first problems are the same for any larger count.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random draw.
    start_deg : (n,) array, optional
        One start for all problems; prismatic joints in millimetres [deg, mm].
    count : int
        Number of targets.
    starts : str or sequence of str, optional
        Kinds of starts in place of a fixed one: near (the default), far, random, zero; one or several.
    spread : float
        Standard deviation of start − solution on every joint, for near starts [rad].

    Returns
    -------
    ProblemSet
        The problems, in one group for each kind of start.

    Raises
    ------
    InvalidInput
        `count` is not an integer of at least 1, both starts and start_deg, or the start is outside the limits.
    """
    check_count(count, "count", 1)
    q = robot.limits.sample(np.random.default_rng((seed, 1)), count)
    return from_solutions(robot, seed, {"random": q}, starts=starts, spread=spread, start_deg=start_deg)


METHOD = random_reachable
