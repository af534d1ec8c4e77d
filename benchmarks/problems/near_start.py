"""Starts near a solution: start = solution + N(0, spread), in strata of the smallest singular value if asked."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from benchmarks.problems.base import ProblemSet
from optik.arm.robot import Robot
from optik.check import check_count


def near_start(
    robot: Robot,
    seed: int,
    *,
    count: int = 1000,
    spreads: Sequence[float] = (0.1,),
    singular_edges: Sequence[float] = (),
) -> ProblemSet:
    """Reachable targets started so many radians away, clamped to the limits.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Of the draw.
    count : int
        How many of each spread, or of each stratum.
    spreads : sequence of float
        Standard deviations of start − solution on every joint [rad]. The same solutions and directions for each.
    singular_edges : sequence of float
        Edges of strata of the smallest singular value at the solution; none for a plain draw.
    """
    check_count(count, "count", 1)
    rng = np.random.default_rng((seed, 2))
    if len(singular_edges):
        pool = robot.limits.draw(rng, 200 * count)
        sigma = robot.singular_values(pool)[:, -1]
        strata = [
            (f"{low:g} ≤ σ < {high:g}", np.flatnonzero((sigma >= low) & (sigma < high))[:count])
            for low, high in pairwise(singular_edges)
        ]
        q = np.concatenate([pool[chosen] for _, chosen in strata])
        names = np.concatenate([np.full(len(chosen), name) for name, chosen in strata])
    else:
        q = robot.limits.draw(rng, count)
        names = np.full(count, "")
    noise = rng.normal(size=q.shape)
    parts = [(robot.limits.clip(q + spread * noise), spread) for spread in spreads]
    k, n = len(q), len(spreads)
    group = names if len(singular_edges) else np.repeat([f"spread {s:g} rad" for s in spreads], k)
    return ProblemSet(
        np.tile(robot.fk(q), (n, 1, 1)),
        np.concatenate([p for p, _ in parts]),
        np.tile(names, n) if len(singular_edges) else group,
        np.ones(n * k, dtype=bool),
        np.tile(robot.singular_values(q)[:, -1], n),
        np.repeat(np.asarray(spreads, dtype=float), k),
    )


METHOD = near_start
