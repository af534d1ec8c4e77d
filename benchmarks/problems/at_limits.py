"""Targets whose known solution has a chosen number of joints exactly at their limits, and the others inside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.problems.base import random_stream, with_starts
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.types import Array


@with_starts
def at_limits(robot: Robot, seed: int, *, count: int = 200, joints: Sequence[int] = (1, 2, 3)) -> dict[str, Array]:
    """Targets whose solution has several joints at their limits at once, where clamping and step rejection decide.

    Which joints and which of their two limits is random; the other joints are uniform inside their limits. There may be
    further solutions with fewer joints at limits. The first problems of a group are the same for any larger count.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random draw.
    count : int
        Number of targets for each number of joints.
    joints : sequence of int
        How many joints are at a limit; one group for each.

    Returns
    -------
    dict of (count, n) arrays
        Configurations that reach the targets, by the number of joints at their limits [rad, m].

    Raises
    ------
    InvalidInput
        More joints than the arm has with two finite limits, or a count below 1.
    """
    check_count(count, "count", 1)
    groups: dict[str, Array] = {}
    movable = np.flatnonzero(robot.limits.bounded)
    for number in joints:
        check_count(number, "joints", 1)
        if number > len(movable):
            raise InvalidInput(
                "joints", number, f"at most {len(movable)}, the number of joints of {robot.name} with two limits"
            )
        groups[f"{number} joint{'s' if number > 1 else ''} at limits"] = _drawn(robot, seed, count, number)
    return groups


def _drawn(robot: Robot, seed: int, count: int, number: int) -> Array:
    """Return configurations (count, n) with a number of joints at their limits."""
    which, side, inside = (random_stream(seed, "at_limits", str(number), word) for word in ("which", "side", "inside"))
    q = robot.limits.sample(inside, count)
    movable = np.flatnonzero(robot.limits.bounded)
    order = np.argsort(which.random((count, len(movable))), axis=1)[:, :number]
    chosen = np.zeros(q.shape, dtype=bool)
    np.put_along_axis(chosen, movable[order], True, axis=1)
    ends = np.where(side.random(q.shape) < 0.5, robot.limits.lower, robot.limits.upper)
    return np.where(chosen, ends, q)


METHOD = at_limits
