"""Hard targets in five equal strata: wrist and elbow singularities, joint limits, both at once, and joint zeros."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.base import ELBOW, WRIST, ProblemSet, put_at_zero, put_on_limits, singular, start_of
from optik.arm.robot import Robot
from optik.check import check_count, check_number
from optik.errors import InvalidInput


def hard(
    robot: Robot, seed: int, *, count: int = 1000, spread: float = 0.1, start_deg: ArrayLike | None = None
) -> ProblemSet:
    """Targets whose solutions are singular configurations, or have joints at their limits or at zero.

    On six-joint arms joint 5 (wrist) or joint 3 (elbow) moves to a sign change of det J while the others are random; no
    spherical wrist is needed. On arms with more joints all joints move to a Jacobian of lower rank, so that both singular
    strata are of the same kind, and not every joint that was put on a limit stays there.

    Parameters
    ----------
    robot : Robot
        The arm, of six joints or more.
    seed : int
        Seed of the random draw.
    count : int
        Number of problems, in five equal strata (the last one has the remainder).
    spread : float
        Standard deviation of start − solution on every joint [rad]; starts are clamped to the limits.
    start_deg : (n,) array, optional
        One start for all problems instead; prismatic joints in millimetres [deg, mm].

    Returns
    -------
    ProblemSet
        The problems in random order, grouped by stratum.

    Raises
    ------
    InvalidInput
        Fewer than six joints, fewer than five targets, a spread that is not positive, or a start outside the limits.
    """
    check_count(count, "count", 5)
    check_number(spread, "spread", "radians above 0", above=0.0)
    if robot.n < 6:
        raise InvalidInput("robot", f"{robot.name} with {robot.n} joints", "an arm of six joints or more")
    rng = np.random.default_rng((seed, 4))
    share = count // 5
    strata = {
        "wrist singular": singular(robot, rng, share, WRIST, on_limits=False),
        "elbow singular": singular(robot, rng, share, ELBOW, on_limits=False),
        "on the limits": put_on_limits(robot, rng, robot.limits.sample(rng, share)),
        "wrist singular, on the limits": singular(robot, rng, share, WRIST, on_limits=True),
        "joint zeros": put_at_zero(robot, rng, robot.limits.sample(rng, count - 4 * share)),
    }
    q = np.concatenate(list(strata.values()))
    order = rng.permutation(len(q))  # so that any part of the set contains all strata
    group = np.repeat(list(strata), [len(part) for part in strata.values()])[order]
    q = q[order]
    if start_deg is None:
        starts = robot.limits.clip(q + spread * rng.normal(size=q.shape))
    else:
        starts = np.tile(start_of(robot, start_deg), (count, 1))
    sigma = robot.singular_values(q)[:, -1]
    far = np.full(count, spread if start_deg is None else np.nan)
    return ProblemSet(robot.fk(q), starts, group, np.ones(count, dtype=bool), sigma, far)


METHOD = hard
