"""Configurations of points on the way: branches and windings of poses that make the line through all points short."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy

from optik import se3
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import branches, get_solver
from optik.ik.problem import check_start
from optik.types import Array, Flags

ROOT_GUESSES, IDLE_GUESSES = 2000, 250
"""Most random initial guesses for the roots of a pose, and how many in a row without a new root end the search. It misses a
root to which a fraction p of the guesses leads with probability (1 − p)²⁵⁰: 0.6 % for p = 0.02."""
ENOUGH_SAMPLES = 64
"""Roots from random guesses that end the search: a redundant arm, or a singular pose, has infinitely many."""
MISSED = 1e-9
"""Largest distance of the joints from a via configuration that is passed exactly [rad, m], and error of a pose [m, rad]."""
MOST_WOUND = 2000
"""Most configurations of a pose, windings included, among which the line is chosen: those nearest to the fixed points."""
LENGTH_ROUNDING = 1e-9
"""Rounding error of a length [rad, m]."""
SWEEPS, LEAST_SHORTENING = 30, 1e-4
"""Most sweeps along the null spaces of the chosen configurations, and the fraction of the length that each must gain."""


def choose_configurations(
    robot: Robot, q: Array, targets: Sequence[Array], usable: Callable[[Array], Flags] | None
) -> Array:  # fmt: skip
    """Return the start and one configuration for each point (k, n), with the shortest line through them in joint space."""
    chosen, poses = [q[None]], dict[str, Array]()
    for i, target in enumerate(targets):
        if target.ndim == 2:
            poses[f"point {i}"] = se3.nearest_pose(se3.check_pose(target, f"point {i}"))
        else:
            goal = check_start(robot, target, f"point {i}")
            chosen += [_choose_between(robot, poses, (chosen[-1][-1], goal), usable), goal[None]]
            poses = {}
    return np.concatenate([*chosen, _choose_between(robot, poses, (chosen[-1][-1], None), usable)])


def find_configurations(robot: Robot, pose: Array, before: Array, which: str) -> Array:
    """Return different configurations (k, n) of a pose inside the limits, from given initial guesses (m, n) and random ones.

    Each has the winding that is nearest to the first guess.
    """
    target, bounds = se3.nearest_pose(pose), (robot.limits.lower, robot.limits.upper)
    moving = bounds[0] < bounds[1]
    if moving.sum() <= 6:  # a redundant arm has roots everywhere: they are searched inside the limits
        bounds = np.where(moving, -np.inf, bounds[0]), np.where(moving, np.inf, bounds[1])
        for bound in bounds:
            bound.flags.writeable = False  # as those of the limits: kernels are compiled once
    seeds = np.concatenate([before, robot.limits.sample(np.random.default_rng(0), ROOT_GUESSES)])
    roots = np.empty((ENOUGH_SAMPLES + len(before), robot.n))
    count, _steps = branches.enumerate_roots(
        robot.chain, bounds, target, (MISSED, MISSED), seeds, branches.POLISHING_STEPS, roots, IDLE_GUESSES
    )
    inside = _find_inside(robot, target, roots[:count], before[0])
    if not len(inside):
        solved = get_solver(robot, "lm").solve(target, before[0])
        inside = _find_inside(robot, target, solved.q[None] if solved else roots[:0], before[0])
    if not len(inside):
        reason = f"no configuration inside the limits reaches the pose of {which}, from {ROOT_GUESSES} initial guesses"
        advice = "a pose within reach; optik.solve_ik with closest=True returns the nearest pose"
        raise NoSolution(reason, advice=advice)
    return inside


def _find_inside(robot: Robot, target: Array, roots: Array, near: Array) -> Array:
    """Return those roots (k, n) of which a winding is inside the limits, as the one nearest to a configuration."""
    wound = wind(robot, roots, near, branches.LIMIT_BAND)
    return branches.select_inside(robot, target, (MISSED, MISSED), wound[~np.isnan(wound).any(axis=1)])


def wind(robot: Robot, q: Array, near: Array, slack: float = LIMIT_TOLERANCE) -> Array:
    """Return configurations (k, n) with each joint at the winding nearest to another one inside the limits; NaN without one."""
    turn = 2.0 * np.pi
    first, last = np.ceil((robot.limits.lower - slack - q) / turn), np.floor((robot.limits.upper + slack - q) / turn)
    turns = np.where(_turns(robot), np.clip(np.round((near - q) / turn), first, np.maximum(first, last)), 0.0)
    still = (q >= robot.limits.lower - slack) & (q <= robot.limits.upper + slack)
    inside = np.where(_turns(robot), first <= last, still)
    return np.where(inside, q + turn * turns, np.nan)


def _turns(robot: Robot) -> Flags:
    """Return the joints (n,) that have windings."""
    return np.asarray(robot.turning & (robot.limits.lower < robot.limits.upper))


def _choose_between(
    robot: Robot, poses: dict[str, Array], ends: tuple[Array, Array | None], usable: Callable[[Array], Flags] | None
) -> Array:  # fmt: skip
    """Return one configuration for each pose (k, n) on the shortest line between two configurations, or to the last pose."""
    layers, (start, goal) = list[Array](), ends
    for which, pose in poses.items():
        near = layers[-1][np.linalg.norm(layers[-1] - start, axis=1).argsort()[:ENOUGH_SAMPLES]] if layers else []
        found = find_configurations(robot, pose, np.array([*(x for x in ends if x is not None), *near]), which)
        may = np.ones(len(found), np.bool_) if usable is None else usable(found)
        layers.append(found[may] if may.any() else found)
    if not layers:
        return np.empty((0, robot.n))
    chosen = _find_shortest(robot, layers, start, goal)
    return _slide_along(robot, list(poses.values()), [start, *chosen, *([] if goal is None else [goal])], usable)


def _find_shortest(robot: Robot, layers: list[Array], start: Array, goal: Array | None) -> Array:
    """Return one row of each layer (k, n), in its best winding, on the shortest line from the start through all to the goal."""

    def to_goal(q: Array) -> Array:
        return np.zeros(len(q)) if goal is None else np.asarray(np.linalg.norm(q - goal, axis=1))

    nearest = [start]
    for layer in layers:  # the line through the nearest configurations bounds the shortest one
        wound = wind(robot, layer, nearest[-1])
        nearest.append(wound[np.linalg.norm(wound - nearest[-1], axis=1).argmin()])
    most = _measure(nearest) + float(to_goal(nearest[-1][None])[0]) + LENGTH_ROUNDING
    rows, cost, before = [start[None]], np.zeros(1), []
    for layer, x in zip(layers, nearest[1:], strict=True):
        q = np.concatenate([x[None], _expand(robot, layer, start, goal, most)])
        total = cost[:, None] + scipy.spatial.distance.cdist(rows[-1], q)
        keep = total.min(axis=0) + to_goal(q) <= most
        rows.append(q[keep])
        before.append(total.argmin(axis=0)[keep])
        cost = total.min(axis=0)[keep]
    i, chosen = int((cost + to_goal(rows[-1])).argmin()), []
    for q, step in zip(reversed(rows), reversed(before), strict=False):
        chosen.append(q[i])
        i = int(step[i])
    return np.array(chosen[::-1])


def _expand(robot: Robot, layer: Array, start: Array, goal: Array | None, most: float) -> Array:
    """Return all windings (k, n) inside the limits through which a line of a length leads from start to goal."""
    lower, upper, turn = robot.limits.lower, robot.limits.upper, 2.0 * np.pi
    rows, done = layer, ~_turns(robot)
    for j in [None, *np.flatnonzero(~done)]:
        if j is not None:
            low, high = max(lower[j], start[j] - most), min(upper[j], start[j] + most)
            first = np.ceil((low - LIMIT_TOLERANCE - rows[:, j]) / turn)
            last = np.floor((high + LIMIT_TOLERANCE - rows[:, j]) / turn)
            count = np.maximum(last - first + 1.0, 0.0).astype(np.int64)
            number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            turns = np.repeat(first, count) + number
            rows = np.repeat(rows, count, axis=0)
            rows[:, j] += turn * turns
            done[j] = True
        length = np.linalg.norm((rows - start)[:, done], axis=1)
        length = length if goal is None else length + np.linalg.norm((rows - goal)[:, done], axis=1)
        near = np.argsort(length, kind="stable")[:MOST_WOUND]
        rows = rows[near[length[near] <= most]]
    return np.asarray(robot.limits.clip(rows))


def _slide_along(
    robot: Robot, poses: list[Array], line: list[Array], usable: Callable[[Array], Flags] | None
) -> Array:  # fmt: skip
    """Return the configurations of the poses (k, n), moved along their null spaces until the line from its start is short."""
    inner, last = slice(1, len(poses) + 1), len(line) - 1
    free = [i for i in range(1, len(poses) + 1) if branches.null_space_basis(robot, line[i]).shape[1]]
    for _ in range(SWEEPS if free else 0):
        before = _measure(line)
        for i in free:
            beside = [line[i - 1], *([line[i + 1]] if i < last else [])]
            weights = np.array([1.0 / max(float(np.linalg.norm(line[i] - x)), MISSED) for x in beside])
            middle = weights @ np.array(beside) / weights.sum()  # Weiszfeld's step to the least sum of distances
            moved = branches.slide(robot, poses[i - 1], line[i], middle, (MISSED, MISSED))
            moved = branches.select_inside(robot, poses[i - 1], (MISSED, MISSED), moved[None])
            before_move = _measure([line[i - 1], line[i], *beside[1:]])
            shorter = len(moved) and _measure([line[i - 1], moved[0], *beside[1:]]) < before_move
            if shorter and (usable is None or bool(usable(moved)[0])):
                line[i] = moved[0]
        if _measure(line) > (1.0 - LEAST_SHORTENING) * before:
            break
    return np.array(line[inner])


def _measure(line: Sequence[Array]) -> float:
    """Return the length of the line through configurations [rad, m]."""
    return float(np.linalg.norm(np.diff(np.array(line), axis=0), axis=1).sum())
