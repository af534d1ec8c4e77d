"""Goals of a search: the configurations of a pose, and their windings, that are collision-free."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik.problem import check_start
from optik.types import Array, Flags
from planners.paths.configurations import find_configurations
from planners.paths.goal import find_continuous
from planners.search.base import JointSpace

FEWEST_GOALS, MOST_GUESSING_ROUNDS, ROUND_GUESSES = 8, 12, 60
"""Collision-free configurations of a pose that are enough for a redundant arm (for others one is), most rounds that search more
of them, and the initial guesses of each round."""
MOST_GOALS = 500
"""Most goals of a search, windings included: those nearest to the start."""
FARTHEST_WINDING = 2.0 * np.pi * (1.0 + 1e-9)
"""Largest motion of a joint from the start to a winding that is a goal [rad]: further turns lead to the same places."""
EQUAL_DECIMALS = 7
"""Decimals within which goals are equal [rad, m]."""


def list_goals(space: JointSpace, start: Array, goal: ArrayLike, winding: str) -> tuple[Array, Array]:
    """Return the collision-free goals (k, n), the nearest first, and all configurations (m, n) of which they are windings.

    A pose has all its configurations and their windings inside the limits as goals; joints have the windings of joints without
    limits, unless `winding` is exact.
    """
    robot = space.robot
    expected = f"{robot.n} joints, several rows of them, or a pose (4, 4)"
    try:
        array = np.asarray(goal, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput("goal", repr(goal)[:60], expected) from None
    turning = find_continuous(robot) if winding == "nearest" else np.zeros(robot.n, np.bool_)
    if array.shape == (4, 4) and (robot.n != 4 or (array[3] == np.eye(4)[3]).all()):
        found, turning = _find_configurations(space, start, se3.check_pose(array, "goal")), robot.turning
    elif array.ndim not in (1, 2) or array.shape[-1] != robot.n or not len(array):
        raise InvalidInput("goal", f"shape {array.shape}", expected)
    else:
        found = np.array([check_start(robot, q, "goal") for q in array.reshape(-1, robot.n)])
    free = found[[space.is_free(q) for q in np.ascontiguousarray(found)]]
    return _wind(robot, free, start, turning), found


def _find_configurations(space: JointSpace, start: Array, pose: Array) -> Array:
    """Return configurations (k, n) of a pose: more if few are collision-free."""
    robot, rng, rounds = space.robot, np.random.default_rng(0), list[Array]()
    fewest, count = FEWEST_GOALS if robot.n > 6 else 1, 0
    for _ in range(MOST_GUESSING_ROUNDS):
        guesses = robot.limits.sample(rng, ROUND_GUESSES) if rounds else np.empty((0, robot.n))
        rounds.append(find_configurations(robot, pose, np.concatenate([start[None], guesses]), "the goal"))
        count += sum(space.is_free(q) for q in np.ascontiguousarray(rounds[-1]))
        if count >= fewest:
            break
    return _drop_equal(np.concatenate(rounds))


def _wind(robot: Robot, q: Array, near: Array, turning: Flags) -> Array:
    """Return configurations (k, n) and their windings inside the limits, at most a turn from another one, the nearest first."""
    turn, lower, upper = 2.0 * np.pi, robot.limits.lower - LIMIT_TOLERANCE, robot.limits.upper + LIMIT_TOLERANCE
    turning = turning & (upper - lower >= turn)
    turns = np.clip(np.round((near - q) / turn), np.ceil((lower - q) / turn), np.floor((upper - q) / turn))
    wound = q + turn * np.where(turning, turns, 0.0)
    for i in np.flatnonzero(turning):
        others = np.concatenate([wound, wound])
        others[:, i] += turn * np.repeat([-1.0, 1.0], len(wound))
        x = others[:, i]
        wound = np.concatenate(
            [wound, others[(x >= lower[i]) & (x <= upper[i]) & (np.abs(x - near[i]) <= FARTHEST_WINDING)]]
        )
        wound = wound[np.argsort(np.linalg.norm(wound - near, axis=1), kind="stable")[:MOST_GOALS]]
    wound = _drop_equal(wound if robot.motors is None else wound[robot.limits.contains(wound)])
    return np.ascontiguousarray(wound[np.argsort(np.linalg.norm(wound - near, axis=1), kind="stable")])


def _drop_equal(q: Array) -> Array:
    """Return the different ones of configurations (k, n)."""
    return q[np.sort(np.unique(q.round(EQUAL_DECIMALS), axis=0, return_index=True)[1])]
