"""Configurations of points on the way: the branches of poses, chosen over all points."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from optik import newton, se3
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import make_solver
from optik.ik._problem import check_start
from optik.types import Array, Flags

BRANCH_DRAWS = 60
"""Random initial guesses for the configurations of a pose."""
CONTINUING_STEPS = 20
"""Most Newton steps from a configuration of one point to the pose of the next."""
GOAL_STEPS = 3
"""Newton steps after the IK, so that a pose is reached to rounding."""
BRANCH_APART = 1e-3
"""Largest distance between two results of the IK that count as one [rad, m]."""
MISSED = 1e-9
"""Largest distance of the joints from a via configuration that is passed exactly [rad, m]."""


def choose_configurations(
    robot: Robot, q: Array, targets: Sequence[Array], usable: Callable[[Array], Flags] | None
) -> Array:  # fmt: skip
    """Return the start and one configuration for each point (k, n), with the least sum of squared joint motions."""
    layers = [q[None]]
    for i, target in enumerate(targets):
        if target.ndim == 2:
            found = find_configurations(robot, se3.check_pose(target, f"point {i}"), layers[-1], f"point {i}")
            may = np.ones(len(found), np.bool_) if usable is None else usable(found)
            layers.append(found[may] if may.any() else found)
        else:
            layers.append(check_start(robot, target, f"point {i}")[None])
    cost, before = np.zeros(1), []
    for first, second in itertools.pairwise(layers):
        total = cost[:, None] + ((first[:, None] - second) ** 2).sum(axis=2)
        before.append(total.argmin(axis=0))
        cost = total.min(axis=0)
    chosen = [int(cost.argmin())]
    for step in reversed(before):
        chosen.append(int(step[chosen[-1]]))
    return np.stack([layer[i] for layer, i in zip(layers, reversed(chosen), strict=True)])


def find_configurations(robot: Robot, pose: Array, before: Array, which: str) -> Array:
    """Return different configurations (k, n) of a pose inside the limits, from those of the point before and random ones."""
    target, limits = se3.nearest_pose(pose), robot.limits
    on = before[:BRANCH_DRAWS].copy()
    newton.polish_batch(robot.chain, on, np.repeat(target[None], len(on), axis=0), CONTINUING_STEPS)
    on = on[
        (np.abs(robot.pose_errors(on, np.repeat(target[None], len(on), axis=0))).max(axis=1) < MISSED)
        & limits.contains(on)
    ]
    starts = limits.sample(np.random.default_rng(0), BRANCH_DRAWS)
    several = np.repeat(target[None], BRANCH_DRAWS, axis=0)
    found = make_solver(robot, "lm", max_restarts=3).solve_batch(several, starts, threads=1)
    reached = np.ascontiguousarray(found.q[found.solved])
    newton.polish_batch(robot.chain, reached, several[: len(reached)], GOAL_STEPS)
    q = np.concatenate([on, reached[limits.contains(reached)]])
    wound = q - 2.0 * np.pi * np.round((q - before[0]) / (2.0 * np.pi))
    inside = (wound >= limits.lower) & (wound <= limits.upper) & ~robot.prismatic
    kept: list[Array] = []
    for x in np.where(inside, wound, q):
        if all(np.abs(x - other).max() > BRANCH_APART for other in kept):
            kept.append(x)
    if not kept:
        raise NoSolution(
            f"no configuration inside the limits reaches the pose of {which}, from {BRANCH_DRAWS} initial guesses",
            advice="a pose within reach; optik.solve_ik with closest=True returns the nearest pose",
        )
    return np.array(kept)
