"""Where an arm or a task leaves motion free: the way down to a preferred posture along it, the target staying met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Chain, copy_vector, frames, jacobian_from, tool_pose
from optik.linear import cholesky_solve, damped_step
from optik.task import Task, task_error, task_rows
from optik.types import Array

PREFERENCES: Mapping[str, str] = {
    "posture": "½|q − posture|²",
    "limits": "½ Σ ((q − middle) / half range)² over joints with two finite limits (Liégeois 1977)",
    "manipulability": "−log sqrt(det(J Jᵀ)), J the task's rows in metres and radians (Yoshikawa 1985)",
}
"""What can be preferred, and what is minimised for it."""


def read_weights(prefer: object) -> dict[str, float]:
    """Return the weights above 0 by name: what ``prefer`` means to every method that has it.

    Raises
    ------
    InvalidInput
        No name or mapping of names, or a weight below 0.
    """
    expected = f"one or more of {', '.join(PREFERENCES)}, alone or as a mapping from these to weights"
    named = {} if prefer is None else {prefer: 1.0} if isinstance(prefer, str) else prefer
    if not isinstance(named, Mapping):
        raise InvalidInput("prefer", repr(prefer)[:60], expected)
    for name in named:
        if name not in PREFERENCES:
            raise InvalidInput("prefer", repr(name)[:60], expected)
    weights = {k: check_number(v, f"prefer[{k!r}]", "a weight ≥ 0", least=0.0) for k, v in named.items()}
    return {k: weight for k, weight in weights.items() if weight > 0.0}


def read_posture(robot: Robot, weights: Mapping[str, float], posture: ArrayLike | None) -> Array | None:
    """Return the posture (n,) to come down to, None for the start.

    Raises
    ------
    InvalidInput
        No configuration, or one without a preference for it.
    """
    if posture is not None and "posture" not in weights:
        raise InvalidInput("posture", "a posture", 'prefer="posture" beside it')
    return None if posture is None else robot.configuration(posture, "posture").copy()


def nothing_free(task: Task, moving: int) -> str:
    """Say that a preference changes nothing, where a task leaves so many moving joints no motion; else nothing."""
    if task.exact < moving:
        return ""
    return f"prefer changes nothing: {moving} joints that move, {task.exact} components to be met exactly"


@dataclass(frozen=True, eq=False)
class Preference:
    """What to come down to: weights (3,) of posture, limits and manipulability, and the posture, None for the start."""

    robot: Robot
    weights: Array
    posture: Array | None
    options: dict[str, Any]

    @classmethod
    def of(cls, robot: Robot, prefer: object, posture: ArrayLike | None) -> Preference | None:
        """Read the options ``prefer`` and ``posture``.

        Raises
        ------
        InvalidInput
            No name or weight of one, a posture that is no configuration, or one without a preference for it.
        """
        named = read_weights(prefer)
        q = read_posture(robot, named, posture)
        kept = dict(prefer) if isinstance(prefer, Mapping) else prefer
        weights = np.array([named.get(name, 0.0) for name in PREFERENCES])
        return cls(robot, weights, q, {"prefer": kept, "posture": q}) if named else None

    def note(self, task: Task) -> str:
        """Say where the preference changes nothing; else nothing."""
        limits = self.robot.limits
        return nothing_free(task, int((limits.lower < limits.upper).sum()))

    def improve(self, task: Task, tolerance: Any, target: Array, start: Array, q: Array) -> Array:
        """Return the configuration (n,) at the end of the way down from q, which meets the task."""
        robot, out = self.robot, q.copy()
        posture = start if self.posture is None else self.posture
        descend(
            robot.chain, robot.limits.lower, robot.limits.upper, task.flags, target,
            np.array([*self.weights, tolerance.position, tolerance.rotation]), posture, out,
        )  # fmt: skip
        return out


@compiled
def cost(
    lower: Array, upper: Array, weights: Array, posture: Array, q: Array, J: Array, flags: Array, g: Array
) -> float:  # fmt: skip
    """What is preferred at q (n,), and its gradient into g (n,); J (6, n) is the geometric Jacobian there."""
    n, value = q.shape[0], 0.0
    for k in range(n):
        d = q[k] - posture[k]
        value += 0.5 * weights[0] * d * d
        g[k] = weights[0] * d
        if -np.inf < lower[k] < upper[k] < np.inf:
            half = 0.5 * (upper[k] - lower[k])
            x = (q[k] - 0.5 * (lower[k] + upper[k])) / half
            value += 0.5 * weights[1] * x * x
            g[k] += weights[1] * x / half
    if weights[2] > 0.0:
        value -= weights[2] * log_manipulability(J, flags, weights[2], g)
    return value


@compiled
def log_manipulability(J: Array, flags: Array, weight: float, g: Array) -> float:
    """Return log √det(J Jᵀ) over the task's rows, and −weight times its gradient added to g (n,).

    The gradient is the trace of J⁺ ∂J/∂q_k; ∂J_i/∂q_k = (ω_k × v_i, ω_k × ω_i) for k ≤ i, and (ω_i × v_k, 0) for k > i.
    """
    n = J.shape[1]
    rows = np.empty(6, np.int64)
    m = 0
    for r in range(6):
        if flags[r] != 0.0:
            rows[m] = r
            m += 1
    A, L, y = np.empty((m, m)), np.empty((m, m)), np.empty(m)
    for a in range(m):
        for b in range(m):
            A[a, b] = 1e-12 if a == b else 0.0  # finite where the rank is lost
            for k in range(n):
                A[a, b] += J[rows[a], k] * J[rows[b], k]
    pseudo = np.zeros((n, 6))  # J⁺ = Jᵀ (J Jᵀ)⁻¹, row by row
    value = 0.0
    for k in range(n):
        for a in range(m):
            y[a] = J[rows[a], k]
            for b in range(m):
                L[a, b] = A[a, b]
        if not cholesky_solve(L, y, 0.0):
            return -1e3
        for a in range(m):
            pseudo[k, rows[a]] = y[a]
    for a in range(m):
        value += log(L[a, a])
    d = np.empty(6)
    for k in range(n):
        slope = 0.0
        for i in range(n):
            for r in range(3):
                r1, r2 = (r + 1) % 3, (r + 2) % 3
                if k <= i:
                    d[r] = J[3 + r1, k] * J[r2, i] - J[3 + r2, k] * J[r1, i]
                    d[3 + r] = J[3 + r1, k] * J[3 + r2, i] - J[3 + r2, k] * J[3 + r1, i]
                else:
                    d[r] = J[3 + r1, i] * J[r2, k] - J[3 + r2, i] * J[r1, k]
                    d[3 + r] = 0.0
            for r in range(6):
                slope += pseudo[i, r] * d[r]
        g[k] -= weight * slope
    return value


@compiled
def along_task(target: Array, flags: Array, J: Array, K: Array) -> None:
    """Write the geometric Jacobian J (6, n) into K, seen along the axes of the task's frame."""
    for k in range(J.shape[1]):
        for b in (0, 3):
            for i in range(3):
                K[b + i, k] = J[b + i, k]
                if flags[6] == 0.0:
                    K[b + i, k] = target[0, i] * J[b, k] + target[1, i] * J[b + 1, k] + target[2, i] * J[b + 2, k]


@compiled
def free_direction(J: Array, g: Array, lower: Array, upper: Array, q: Array, A: Array, y: Array, d: Array) -> float:
    """Steepest way down that keeps the task to first order, into d (n,): −g less its part across the null space of J.

    Joints at a limit that it pushes further out are held, and the rest is done again; J loses their columns. Returns |d|.
    """
    n = q.shape[0]
    e = np.empty(6)
    for _ in range(n + 1):
        for r in range(6):
            e[r] = 0.0
            for k in range(n):
                e[r] += J[r, k] * g[k]
        if not damped_step(J, e, 1e-12, A, y, d, 0.0):
            return 0.0
        size, pushed = 0.0, False
        for k in range(n):
            d[k] -= g[k]
            if (d[k] < 0.0 and q[k] <= lower[k]) or (d[k] > 0.0 and q[k] >= upper[k]):
                g[k] = 0.0
                for r in range(6):
                    J[r, k] = 0.0
                pushed = True
            size += d[k] * d[k]
        if not pushed:
            return float(np.sqrt(size))
    return 0.0


@compiled
def correct(
    chain: Chain, lower: Array, upper: Array, flags: Array, target: Array,
    tolerances: Array, q: Array, frame: Array, T: Array, J: Array,
) -> bool:  # fmt: skip
    """Bring q (n,) back onto the task, inside the limits, by a few Newton steps; J is left as it is at q."""
    n = q.shape[0]
    A, y, dq, e, w, K = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6), np.empty(3), np.empty((6, n))
    for _ in range(8):
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        task_error(T, target, flags, e, w)
        jacobian_from(chain, frame, T, J)
        p2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        r2 = e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
        # well inside the tolerance, so that the next correction starts from a met target
        if p2 <= (0.1 * tolerances[0]) ** 2 and r2 <= (0.1 * tolerances[1]) ** 2:
            return True
        for r in range(6):
            for k in range(n):
                K[r, k] = J[r, k]
        task_rows(target, flags, w, K)
        if not damped_step(K, e, 1e-12, A, y, dq, 0.0):
            return False
        for k in range(n):
            q[k] = min(max(q[k] + dq[k], lower[k]), upper[k])
    return False


@compiled
def descend(
    chain: Chain, lower: Array, upper: Array, flags: Array, target: Array,
    numbers: Array, posture: Array, q: Array,
) -> None:  # fmt: skip
    """Projected gradient descent with a growing step, from q (n,) in place; numbers are the weights and tolerances."""
    n = q.shape[0]
    weights, tolerances = numbers[:3], numbers[3:]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, y, g, d, trial = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(n), np.empty(n)
    e, w = np.empty(6), np.empty(3)
    copy_vector(q, trial)
    if not correct(chain, lower, upper, flags, target, tolerances, trial, frame, T, J):
        return
    copy_vector(trial, q)
    K = np.empty((6, n))
    along_task(target, flags, J, K)
    value = cost(lower, upper, weights, posture, q, K, flags, g)
    step = 1.0
    for _ in range(200):
        task_error(T, target, flags, e, w)
        task_rows(target, flags, w, J)
        size = free_direction(J, g, lower, upper, q, A, y, d)
        if size < 1e-7:
            return
        better = False
        while not better and step * size > 1e-8:
            reach = min(step, 0.5 / size)  # half a radian at most, so that the correction stays on the same branch
            for k in range(n):
                trial[k] = min(max(q[k] + reach * d[k], lower[k]), upper[k])
            if correct(chain, lower, upper, flags, target, tolerances, trial, frame, T, J):
                along_task(target, flags, J, K)
                tried = cost(lower, upper, weights, posture, trial, K, flags, g)
                better = tried < value - 1e-4 * reach * size * size
            if not better:
                step = 0.5 * reach
        if not better:
            return
        value = tried
        copy_vector(trial, q)
        step = 2.0 * reach
