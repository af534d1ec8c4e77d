"""Targets that are proved unreachable, to test whether methods recognise them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.base import ProblemSet, from_solutions, random_stream
from optik.arm.reach import outside_reach, reach_bound
from optik.arm.robot import Robot
from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.task import as_task
from optik.types import Array, Flags

PROOF_TOLERANCE = 1e-5
"""Position tolerance [m] and rotation tolerance [rad] for which the proof must hold: far wider than any method's."""


def beyond_reach(
    robot: Robot, seed: int, *, count: int = 100, excesses_m: Sequence[float] = (0.001, 0.01, 0.1),
    starts: str | Sequence[str] | None = None, spread: float = 0.1, start_deg: ArrayLike | None = None,
) -> ProblemSet:  # fmt: skip
    """Targets that no configuration reaches: tool poses of random configurations, moved outwards past a proved bound.

    The bound is that of the solvers (`optik.arm.reach`): the distance between a point of the base and a point on the last
    axis is at most the sum of the links' lengths between them. It holds for all configurations, so each problem has
    ``known`` false and ``unreachable`` true. The first problems of a group are the same for any larger count.

    Parameters
    ----------
    robot : Robot
        The arm; its prismatic joints must have finite limits.
    seed : int
        Seed of the random draw.
    count : int
        Number of targets for each excess.
    excesses_m : sequence of float
        Distances of the targets beyond the bound; one group for each [m].
    starts : str or sequence of str, optional
        Kinds of starts, relative to the configuration whose pose was moved: near (the default), far, random, zero.
    spread : float
        Standard deviation of near starts on every joint [rad].
    start_deg : (n,) array, optional
        One start for all problems instead; prismatic joints in millimetres [deg, mm].

    Returns
    -------
    ProblemSet
        The problems, grouped by their excess.

    Raises
    ------
    InvalidInput
        An arm without a bound, an excess too small to be proved, a count below 1, or wrong starts.
    """
    check_count(count, "count", 1)
    bound = reach_bound(robot, as_task("pose"))
    if not np.isfinite(bound[7]):
        raise InvalidInput("robot", f"{robot.name} with a prismatic joint without limits", "an arm of finite reach")
    groups = {}
    for excess in map(float, excesses_m):
        check_number(excess, "excesses_m", "metres above 0", above=0.0)
        q = robot.limits.sample(random_stream(seed, "beyond_reach", repr(excess)), count)
        groups[f"beyond by {1e3 * excess:g} mm"] = q
    drawn = from_solutions(robot, seed, groups, starts=starts, spread=spread, start_deg=start_deg)
    each = np.repeat(np.asarray(excesses_m, dtype=float), len(drawn) // len(groups))
    targets = _moved_out(drawn.targets, bound, each)
    proved = _proved(targets, bound)
    none = np.full(len(targets), np.nan)
    return ProblemSet(targets, drawn.starts, drawn.group, ~proved, none, none, proved)


def _proved(targets: Array, bound: Array) -> Flags:
    """Check that the bound (8,) proves every target (k, 4, 4) unreachable."""
    proved = np.array([outside_reach(bound, T, PROOF_TOLERANCE, PROOF_TOLERANCE) for T in targets]) >= 0.0
    if not proved.all():
        raise InvalidInput("excesses_m", "a distance too small for a proof", "distances well above 10 µm")
    return proved


def _moved_out(targets: Array, bound: Array, excess: Array) -> Array:
    """Return targets (k, 4, 4) moved along the line between the two points of the bound (8,) until these are too far apart."""
    moved = targets.copy()
    point = np.einsum("kij,j->ki", targets[:, :3, :3], bound[3:6]) + targets[:, :3, 3] - bound[:3]
    distance = np.linalg.norm(point, axis=1)
    moved[:, :3, 3] += ((bound[7] + excess - distance) / distance)[:, None] * point
    return moved


METHOD = beyond_reach
