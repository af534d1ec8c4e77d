"""The nearest pose inside the limits: where there is no solution, the configuration that comes closest to one."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain, copy_vector, frames, jacobian_from, tool_pose
from optik.linear import cholesky_solve
from optik.task import Task, task_error, task_rows
from optik.types import Array


def nearest(robot: Robot, task: Task, target: Array, starts: Array, max_iterations: int = 500) -> Array:
    """Return the configuration (n,) of least ½|e|² found from starts (k, n) inside the limits; e is the task's error."""
    q, best, least = robot.limits.clip(starts), starts[0], np.inf
    for one in q:
        cost: float = descend(
            robot.chain, robot.limits.lower, robot.limits.upper, task.flags, target,
            max_iterations, one,
        )  # fmt: skip
        if cost < least:
            best, least = one, cost
    return np.asarray(best)


@compiled
def _cost(
    chain: Chain, flags: Array, target: Array, q: Array,
    frame: Array, T: Array, e: Array, w: Array,
) -> float:  # fmt: skip
    frames(chain, q, frame)
    tool_pose(chain, frame, T)
    task_error(T, target, flags, e, w)
    cost = 0.0
    for i in range(6):
        cost += 0.5 * e[i] * e[i]
    return cost


@compiled
def descend(
    chain: Chain,
    lower: Array,
    upper: Array,
    flags: Array,
    target: Array,
    max_iterations: int,
    q: Array,
) -> float:
    """Levenberg–Marquardt inside the limits, from q (n,) in place; returns ½|e|² where no step lessens it any more.

    Joints at a limit that the gradient pushes further out are held (Bertsekas 1982); the others take a damped
    Gauss–Newton step, cut to the limits; the damping follows Nielsen (1999).
    """
    n = q.shape[0]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    e, w, A, g, dq, trial = np.empty(6), np.empty(3), np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
    cost = _cost(chain, flags, target, q, frame, T, e, w)
    damping, grow = 1e-3, 2.0
    for _ in range(max_iterations):
        jacobian_from(chain, frame, T, J)
        task_rows(target, flags, w, J)
        slope = 0.0
        for k in range(n):
            g[k] = 0.0
            for i in range(6):
                g[k] += J[i, k] * e[i]
            if (g[k] > 0.0 and q[k] >= upper[k]) or (g[k] < 0.0 and q[k] <= lower[k]):
                g[k] = 0.0
                for i in range(6):
                    J[i, k] = 0.0
            slope = max(slope, abs(g[k]))
        if slope <= 1e-12 * (1.0 + cost):
            break
        better = False
        while not better and damping < 1e12:
            for r in range(n):
                dq[r] = g[r]
                for c in range(r + 1):
                    A[r, c] = 0.0
                    for i in range(6):
                        A[r, c] += J[i, r] * J[i, c]
                A[r, r] += damping
            if cholesky_solve(A, dq):
                for k in range(n):
                    trial[k] = min(max(q[k] + dq[k], lower[k]), upper[k])
                tried = _cost(chain, flags, target, trial, frame, T, e, w)
                better = tried < cost
            if better:
                gain = cost - tried
                cost = tried
                copy_vector(trial, q)
                damping, grow = max(damping * 0.2, 1e-15), 2.0
                if gain <= 1e-16 * cost:
                    return cost
            else:
                damping, grow = damping * grow, grow * 2.0
        if not better:
            break
    return cost
