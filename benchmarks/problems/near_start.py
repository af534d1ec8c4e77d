"""Starts near a solution: start = solution + N(0, spread), optionally in strata of the smallest singular value."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.problems.base import ProblemSet
from optik.arm.robot import Robot
from optik.check import check_count
from optik.types import Array

POOL = 200
"""Samples per requested configuration of a stratum: configurations near singularities are rare."""


def near_start(
    robot: Robot, seed: int, *, count: int = 1000, spreads: Sequence[float] = (0.1,),
    singular_edges: Sequence[float] = (),
) -> ProblemSet:  # fmt: skip
    """Reachable targets whose starts are a known solution plus normal noise, clamped to the joint limits.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random draw.
    count : int
        Number of problems for each spread, and in each stratum if there are strata.
    spreads : sequence of float
        Standard deviations of start − solution on every joint [rad]. Solutions and directions are the same for each.
    singular_edges : sequence of float
        Edges of strata of the smallest singular value at the solution [1]; empty for no strata.

    Returns
    -------
    ProblemSet
        The problems, grouped by stratum, or by spread where there are no strata.

    Raises
    ------
    InvalidInput
        `count` is not an integer of at least 1.
    """
    check_count(count, "count", 1)
    rng = np.random.default_rng((seed, 2))
    if len(singular_edges):
        q, stratum = _stratified(robot, rng, count, singular_edges)
    else:
        q = robot.limits.sample(rng, count)
    noise = rng.normal(size=q.shape)
    k, n = len(q), len(spreads)
    group = np.tile(stratum, n) if len(singular_edges) else np.repeat([f"spread {s:g} rad" for s in spreads], k)
    return ProblemSet(
        np.tile(robot.fk(q), (n, 1, 1)),
        np.concatenate([robot.limits.clip(q + spread * noise) for spread in spreads]),
        group,
        np.ones(n * k, dtype=bool),
        np.tile(robot.singular_values(q)[:, -1], n),
        np.repeat(np.asarray(spreads, dtype=float), k),
    )


def _stratified(
    robot: Robot, rng: np.random.Generator, count: int, edges: Sequence[float]
) -> tuple[Array, NDArray[np.str_]]:
    """Return at most `count` random configurations in each stratum of the smallest singular value, and their strata."""
    pool = robot.limits.sample(rng, POOL * count)
    sigma = robot.singular_values(pool)[:, -1]
    strata = {f"{low:g} ≤ σ < {high:g}": pool[(sigma >= low) & (sigma < high)][:count] for low, high in pairwise(edges)}
    return np.concatenate(list(strata.values())), np.repeat(list(strata), [len(q) for q in strata.values()])


METHOD = near_start
