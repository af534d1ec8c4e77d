"""Damped Gauss–Newton iteration inside joint limits: each step solves for the free joints and holds the others."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled, inlined
from optik.ik.problem import MAX_ITERATIONS, SOLVED, STALLED
from optik.kinematics import Chain, Range, workspace
from optik.linear import cholesky_solve, copy_vector
from optik.newton import GAIN, LEAST_DAMPING
from optik.task import Goal, Task, goal_error, goal_jacobian
from optik.types import Array

Work = tuple[Array, Array, Array, Array]
"""Scratch of `bounded_step`: matrix (6, 6) [m²], right-hand sides (6,) and (6,) [m, rad], state of each joint (n,) [1]."""
Rule = tuple[float, float, float, float, float, float, float, float]
"""Settings of `descend_inside`: position and rotation tolerance [m, rad]; number of iterations; patience and progress [1];
gain and least damping of λ² = gain · ½|e|² + least damping; growth of λ². The iteration ends after `patience` iterations
that do not reduce ½|e|² below the fraction `progress` of its least value. A step that does not reduce ½|e|² is undone, and
λ² grows. A growth of 1 accepts every step."""
JOINT_FREE, JOINT_RELEASED, JOINT_LOW, JOINT_HIGH, JOINT_LOCKED = 0.0, 1.0, 2.0, 3.0, 4.0
"""States of a joint in one step. A joint that comes back to its bound after its release stays there."""
LEAST_PULL = 1e-9
"""Least step away from its bound at which a joint is released [rad, m]; smaller values are rounding errors."""
NO_TRACE = np.empty((0, 6))
"""Argument `trace` of `descend_inside` if the errors are not recorded."""
LEAST_SCALE = 1e-9
"""Smallest factor on the gain that the growth leads to [1]; steps with it are undamped."""


@inlined
def step_workspace(n: int) -> Work:
    """Allocate the scratch of `bounded_step` for n joints."""
    return np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(n)


@inlined
def solve_free_joints(J: Array, e: Array, damping2: float, dq: Array, work: Work) -> bool:
    """Solve for the step of the free joints, given the step of the others; return False if the system is singular."""
    A, y, r, state = work
    n = dq.shape[0]
    for i in range(6):
        r[i] = e[i]
        for k in range(n):
            if state[k] > JOINT_RELEASED:
                r[i] -= J[i, k] * dq[k]
        y[i] = r[i]
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                if state[k] <= JOINT_RELEASED:
                    s += J[i, k] * J[j, k]
            A[i, j] = s
        A[i, i] += damping2
    if not cholesky_solve(A, y, 0.0):
        return False
    for k in range(n):
        if state[k] <= JOINT_RELEASED:
            dq[k] = 0.0
            for i in range(6):
                dq[k] += J[i, k] * y[i]
    return True


@compiled
def bounded_step(J: Array, e: Array, damping2: float, bounds: Range, q: Array, dq: Array, work: Work) -> bool:
    """Nearly minimise |J Δq − e|² + λ² |Δq|² with q + Δq inside bounds; return False if the system is singular.

    A joint that would leave its bounds is set on its bound, and the system is solved again for the other joints. A joint on
    its bound that the gradient pulls inside is released once. So at most three systems are solved for each joint.
    """
    (low, high), y, state = bounds, work[1], work[3]
    n = q.shape[0]
    for k in range(n):
        dq[k], state[k] = 0.0, JOINT_FREE if low[k] < high[k] else JOINT_LOCKED
    while True:
        if not solve_free_joints(J, e, damping2, dq, work):
            return False
        pushed, pulled, most = False, -1, LEAST_PULL
        for k in range(n):
            if state[k] <= JOINT_RELEASED and not low[k] <= q[k] + dq[k] <= high[k]:
                below, again = q[k] + dq[k] < low[k], state[k] == JOINT_RELEASED
                dq[k] = (low[k] if below else high[k]) - q[k]
                state[k] = JOINT_LOCKED if again else (JOINT_LOW if below else JOINT_HIGH)
                pushed = True
        if pushed:
            continue
        for k in range(n):
            if state[k] == JOINT_LOW or state[k] == JOINT_HIGH:
                pull = -dq[k]  # over λ²: y is (e − J Δq) / λ²
                for i in range(6):
                    pull += J[i, k] * y[i]
                pull = pull if state[k] == JOINT_LOW else -pull
                if pull > most:
                    pulled, most = k, pull
        if pulled < 0:
            return True
        state[pulled] = JOINT_RELEASED


@compiled
def descend_inside(
    chain: Chain, bounds: Range, goal: Goal, rule: Rule, first: int, q: Array, trace: Array
) -> tuple[int, int, float, float]:
    """Iterate from q (n,) inside bounds until the task is met or ½|e|² stops decreasing; q becomes the best iterate.

    `first` is the number of the first iteration. `trace` (iterations + 1, 6) receives all errors, unless it is empty.
    Returns the number of the last iteration, SOLVED, MAX_ITERATIONS or STALLED, and the squared errors at q [m², rad²].
    """
    tolerance_p, tolerance_r, iterations, patience, progress, gain, damping, growth = rule
    n, (flags, target), (low, high) = q.shape[0], goal, bounds
    (frame, T, J), work, best = workspace(chain, n), step_workspace(n), q.copy()
    e, w, dq = np.empty(6), np.empty(3), np.empty(n)
    least, best_p2, best_r2, stalls, scale, iteration = np.inf, np.inf, np.inf, 0, 1.0, first
    while True:
        p2, r2 = goal_error(chain, flags, target, q, frame, T, e, w)
        if trace.shape[0] > 0:
            copy_vector(e, trace[iteration])
        if p2 <= tolerance_p * tolerance_p and r2 <= tolerance_r * tolerance_r:
            return iteration, SOLVED, p2, r2
        cost = 0.5 * (p2 + r2)
        stalls = 0 if cost < progress * least else stalls + 1
        least = cost if stalls == 0 else least
        better = p2 + r2 < best_p2 + best_r2
        if better:
            best_p2, best_r2, scale = p2, r2, max(scale / growth, LEAST_SCALE)
            copy_vector(q, best)
        if iteration >= iterations or stalls >= patience or not (better or cost < np.inf):
            copy_vector(best, q)
            return iteration, MAX_ITERATIONS if iteration >= iterations else STALLED, best_p2, best_r2
        if growth > 1.0 and not better:
            scale *= growth
            copy_vector(best, q)
            p2, r2 = goal_error(chain, flags, target, q, frame, T, e, w)
            cost = 0.5 * (p2 + r2)
        goal_jacobian(chain, flags, target, frame, T, w, J)
        if not bounded_step(J, e, scale * gain * cost + damping, bounds, q, dq, work):
            copy_vector(best, q)
            return iteration, STALLED, best_p2, best_r2
        for k in range(n):
            q[k] = min(max(q[k] + dq[k], low[k]), high[k])
        iteration += 1


DESCENT_PATIENCE, DESCENT_PROGRESS = 12, 1.0 - 1e-12
"""The descent ends after this number of consecutive steps [1] that do not reduce ½|e|² by a fraction of 1e-12. The damping
has then grown by DESCENT_GROWTH¹²."""
DESCENT_GROWTH = 4.0
"""Growth of λ² after a step that does not reduce ½|e|² [1] (Marquardt 1963)."""


def find_nearest_pose(robot: Robot, task: Task, target: Array, starts: Array, max_iterations: int = 5000) -> Array:
    """Return the configuration inside the limits with the least ½|e|² found from some initial guesses (k, n)."""
    q, best, least = robot.limits.clip(starts), starts[0], np.inf
    limits, goal = (robot.limits.lower, robot.limits.upper), (task.flags, target)
    rule = (
        0.0,
        0.0,
        float(max_iterations),
        float(DESCENT_PATIENCE),
        DESCENT_PROGRESS,
        GAIN,
        LEAST_DAMPING,
        DESCENT_GROWTH,
    )
    for one in q:
        _, _, p2, r2 = descend_inside(robot.chain, limits, goal, rule, 0, one, NO_TRACE)
        if p2 + r2 < least:
            best, least = one, p2 + r2
    return np.asarray(best)
