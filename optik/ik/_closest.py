"""Nearest pose inside the limits: where there is no solution, the configuration of least squared error."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain, Range, workspace
from optik.linear import cholesky_solve, copy_vector
from optik.task import Goal, Task, goal_error, goal_jacobian
from optik.types import Array

FIRST_DAMPING, MOST_DAMPING = 1e-3, 1e12
"""Damping [m², rad²] of the first step, and the largest: there a step is shorter than rounding."""

FLATTEST = 1e-12
"""Slope of ½|e|² [m², rad² per rad or m], relative to 1 + ½|e|², that counts as a minimum: rounding of the slope."""

LEAST_GAIN = 1e-16
"""Relative decrease of ½|e|² after which no more is to be expected: rounding of the sum."""


def nearest(robot: Robot, task: Task, target: Array, starts: Array, max_iterations: int = 500) -> Array:
    """Return the configuration of least ½|e|² that is found inside the limits, e the task's error.

    Parameters
    ----------
    robot : Robot
        The arm.
    task : Task
        Which components of the error count.
    target : (4, 4) array
        Target pose in the base frame [1, m].
    starts : (k, n) array
        Initial guesses [rad, m].
    max_iterations : int, optional
        Most steps from each.

    Returns
    -------
    (n,) array
        The configuration [rad, m].
    """
    q, best, least = robot.limits.clip(starts), starts[0], np.inf
    limits, goal = (robot.limits.lower, robot.limits.upper), (task.flags, target)
    for one in q:
        cost: float = descend_to_pose(robot.chain, limits, goal, max_iterations, one)
        if cost < least:
            best, least = one, cost
    return np.asarray(best)


@compiled
def hold_pushed(limits: Range, q: Array, J: Array, e: Array, g: Array) -> float:
    """Downhill direction Jᵀ e, with the joints held that stand at a limit and would be pushed out (Bertsekas 1982).

    Parameters
    ----------
    limits : Range
        Position limits.
    q : (n,) array
        Configuration inside them [rad, m].
    J : (6, n) array
        Jacobian of the error [m/rad, 1]; the columns of held joints are set to 0.
    e : (6,) array
        Error [m, rad].
    g : (n,) array
        The direction [m², rad²], 0 for held joints; overwritten.

    Returns
    -------
    float
        Its largest component.
    """
    lower, upper = limits
    slope = 0.0
    for k in range(q.shape[0]):
        g[k] = 0.0
        for i in range(6):
            g[k] += J[i, k] * e[i]
        if (g[k] > 0.0 and q[k] >= upper[k]) or (g[k] < 0.0 and q[k] <= lower[k]):
            g[k] = 0.0
            for i in range(6):
                J[i, k] = 0.0
        slope = max(slope, abs(g[k]))
    return slope


@compiled
def normal_step(J: Array, g: Array, damping: float, A: Array, dq: Array) -> bool:
    """Damped Gauss–Newton step (JᵀJ + μ I)⁻¹ g: what `damped_step` is for J Jᵀ, where most columns may be held.

    Parameters
    ----------
    J : (6, n) array
        Jacobian [m/rad, 1].
    g : (n,) array
        Jᵀ e [m², rad²].
    damping : float
        μ [m², rad²].
    A : (n, n) array
        Scratch [m²]; overwritten.
    dq : (n,) array
        The step [rad, m]; overwritten.

    Returns
    -------
    bool
        False where the matrix is not positive definite to working precision.
    """
    for r in range(g.shape[0]):
        dq[r] = g[r]
        for c in range(r + 1):
            A[r, c] = 0.0
            for i in range(6):
                A[r, c] += J[i, r] * J[i, c]
        A[r, r] += damping
    return cholesky_solve(A, dq)


@compiled
def descend_to_pose(chain: Chain, limits: Range, goal: Goal, max_iterations: int, q: Array) -> float:
    """Levenberg–Marquardt iteration inside the limits to a minimum of ½|e|², e the task's error.

    A joint at a limit that the gradient pushes further out is held; the others take a damped Gauss–Newton step, clamped
    to the limits. The damping follows Nielsen (1999).

    Parameters
    ----------
    chain : Chain
        The arm.
    limits : Range
        Its position limits.
    goal : Goal
        The task and its target.
    max_iterations : int
        Most steps.
    q : (n,) array
        Initial guess inside the limits [rad, m]; overwritten by the minimum found.

    Returns
    -------
    float
        ½|e|² there [m², rad²].
    """
    n, (flags, target), (lower, upper) = q.shape[0], goal, limits
    frame, T, J = workspace(n)
    e, w, A, g, dq, trial = np.empty(6), np.empty(3), np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
    p2, r2 = goal_error(chain, flags, target, q, frame, T, e, w)
    cost = 0.5 * (p2 + r2)
    damping, grow = FIRST_DAMPING, 2.0
    for _ in range(max_iterations):
        goal_jacobian(chain, flags, target, frame, T, w, J)
        if hold_pushed(limits, q, J, e, g) <= FLATTEST * (1.0 + cost):
            break
        better = False
        while not better and damping < MOST_DAMPING:
            if normal_step(J, g, damping, A, dq):
                for k in range(n):
                    trial[k] = min(max(q[k] + dq[k], lower[k]), upper[k])
                p2, r2 = goal_error(chain, flags, target, trial, frame, T, e, w)
                tried = 0.5 * (p2 + r2)
                better = tried < cost
            if not better:
                damping, grow = damping * grow, grow * 2.0
        if not better:
            break
        gain, cost = cost - tried, tried
        copy_vector(trial, q)
        damping, grow = max(damping * 0.2, 1e-15), 2.0
        if gain <= LEAST_GAIN * cost:
            break
    return cost
