"""Redundancy resolution: the cost of a preference with its gradient, and the descent to its minimum along the task.

`Preference` holds the options ``prefer`` and ``posture`` of every method that supports them. All methods minimise the same
function of q, from a configuration that meets the target to a local minimum in the null space: `lm` by the projected
gradient descent of `optik.ik._null_space`, `sqp` and `ipopt` by a second programme with the symbolic function of
`optik.ik._casadi`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled, inlined
from optik.errors import InvalidInput
from optik.kinematics import Chain, Range, forward, jacobian_from, workspace
from optik.linear import cholesky_solve, copy_vector, damped_step
from optik.task import Goal, Task, goal_error, task_error, task_rows
from optik.types import Array, Indices

Objective = tuple[Array, Array]
"""Secondary objective: weights (3,) of posture, limits and manipulability [1], and the posture (n,) [rad, m]."""
RANK_FLOOR = 1e-12
"""Added to the diagonal of J Jᵀ [m², 1], so that its determinant is positive at a singular configuration. It is far above
the rounding errors of the products, and a millionth of the square of a singular value of 1e-3."""
LOST_RANK = -1e3
"""Log √det(J Jᵀ) [1] if the factorisation fails nevertheless, below all other values (6 log √1e-12 = −83)."""
PROJECTION_DAMPING = 1e-12
"""Damping λ² [m², rad²] of projections and corrections, which keeps them finite at a singular configuration."""
MOST_CORRECTIONS, FRACTION_OF_TOLERANCE = 8, 0.1
"""Largest number of Newton steps that correct the task error, and the fraction of the tolerance at which they end [1]."""
MOST_DESCENTS, LONGEST_DESCENT = 200, 0.5
"""Largest number and length [rad, m] of the descent's steps. The correction after a step must stay on the same branch."""
LEAST_SLOPE, SHORTEST_DESCENT = 1e-7, 1e-8
"""Projected gradient that counts as zero, and the shortest step that is tried [rad, m]."""
SUFFICIENT = 1e-4
"""Least decrease as a fraction of the one that the slope predicts [1] (Armijo; Nocedal and Wright 2006, §3.1)."""


@inlined
def normalise(x: float, low: float, high: float) -> tuple[float, float]:
    """Return a joint's position relative to its range, −1 to 1, and half the range; 0 and 1 without a finite range.

    Shapes and units: x [rad, m], low, high [rad, m]. Returns [1] and [rad, m].
    """
    if not -np.inf < low < high < np.inf:
        return 0.0, 1.0
    half = 0.5 * (high - low)
    return (x - 0.5 * (low + high)) / half, half


@compiled
def cost(limits: Range, objective: Objective, q: Array, J: Array, flags: Array, g: Array) -> float:
    """Return the cost of the objective at q, and write its gradient into g.

    Shapes and units: q (n,) [rad, m], J (6, n) [m/rad, 1], flags (13,) [1, m, rad], g (n,) [1/rad, 1/m] (overwritten). Returns
    [1].
    """
    (lower, upper), (weights, posture) = limits, objective
    value = 0.0
    for k in range(q.shape[0]):
        d = q[k] - posture[k]
        value += 0.5 * weights[0] * d * d
        g[k] = weights[0] * d
        x, half = normalise(q[k], lower[k], upper[k])
        value += 0.5 * weights[1] * x * x
        g[k] += weights[1] * x / half
    if weights[2] > 0.0:
        value -= weights[2] * log_manipulability(J, flags, weights[2], g)
    return value


@compiled
def _pseudo_inverse(J: Array, rows: Indices, m: int, pseudo: Array) -> float:
    """Write J⁺ = Jᵀ (J Jᵀ)⁻¹ of the first m of `rows` into pseudo (n, 6), and return log √det(J Jᵀ)."""
    n = J.shape[1]
    A, L, y = np.empty((m, m)), np.empty((m, m)), np.empty(m)
    for a in range(m):
        for b in range(m):
            A[a, b] = RANK_FLOOR if a == b else 0.0
            for k in range(n):
                A[a, b] += J[rows[a], k] * J[rows[b], k]
    for k in range(n):
        for a in range(m):
            y[a] = J[rows[a], k]
            for b in range(m):
                L[a, b] = A[a, b]
        if not cholesky_solve(L, y, 0.0):
            return LOST_RANK
        for a in range(m):
            pseudo[k, rows[a]] = y[a]
    value = 0.0
    for a in range(m):
        value += log(L[a, a])
    return value


@compiled
def log_manipulability(J: Array, flags: Array, weight: float, g: Array) -> float:
    """Return log √det(J Jᵀ) of the task's rows, and add −weight times its gradient to g.

    The gradient is the trace of J⁺ ∂J/∂q_k; ∂J_i/∂q_k = (ω_k × v_i, ω_k × ω_i) for k ≤ i, and (ω_i × v_k, 0) for k > i.

    Shapes and units: J (6, n) [m/rad, 1], flags (13,) [1, m, rad], weight [1], g (n,) [1/rad, 1/m]. Returns [1].
    """
    n, m = J.shape[1], 0
    rows = np.empty(6, np.int64)
    for r in range(6):
        if flags[r] != 0.0:
            rows[m] = r
            m += 1
    pseudo, d = np.zeros((n, 6)), np.empty(6)
    value = _pseudo_inverse(J, rows, m, pseudo)
    if value == LOST_RANK:
        return value
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
def rotate_to_task(target: Array, flags: Array, J: Array, K: Array) -> None:
    """Write the geometric Jacobian along the axes of the task's frame into K.

    Shapes and units: target (4, 4) [1, m], flags (13,) [1, m, rad], J (6, n) [m/rad, 1], K (6, n) [m/rad, 1] (overwritten).
    """
    for k in range(J.shape[1]):
        for b in (0, 3):
            for i in range(3):
                K[b + i, k] = J[b + i, k]
                if flags[6] == 0.0:
                    K[b + i, k] = target[0, i] * J[b, k] + target[1, i] * J[b + 1, k] + target[2, i] * J[b + 2, k]


@compiled
def _cost_in_task_frame(limits: Range, goal: Goal, objective: Objective, q: Array, J: Array, g: Array) -> float:
    """Return `cost` at q from the geometric Jacobian J (6, n) in the base frame, and write its gradient into g."""
    flags, target = goal
    K = np.empty_like(J)
    rotate_to_task(target, flags, J, K)
    return cost(limits, objective, q, K, flags, g)


@compiled
def compute_cost(chain: Chain, limits: Range, goal: Goal, objective: Objective, q: Array) -> float:
    """Return the cost of the objective at one configuration: q (n,) [rad, m]. Returns [1]."""
    frame, T, J = workspace(chain, q.shape[0])
    forward(chain, q, frame, T)
    jacobian_from(chain, frame, T, J)
    return _cost_in_task_frame(limits, goal, objective, q, J, np.empty(q.shape[0]))


@compiled
def project_gradient(J: Array, g: Array, limits: Range, q: Array, d: Array) -> float:
    """Write −g projected onto the null space of J into d, and return its norm.

    A joint at a limit that the direction would move outwards is fixed, and the projection is repeated.

    Shapes and units: J (6, n) [m/rad, 1], g (n,) [1/rad, 1/m], q (n,) [rad, m], d (n,) [1/rad, 1/m] (overwritten).
    """
    n, (lower, upper) = q.shape[0], limits
    A, y, e = np.empty((6, 6)), np.empty(6), np.empty(6)
    for _ in range(n + 1):
        for r in range(6):
            e[r] = 0.0
            for k in range(n):
                e[r] += J[r, k] * g[k]
        if not damped_step(J, e, PROJECTION_DAMPING, A, y, d, 0.0):
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
    chain: Chain, limits: Range, goal: Goal, tolerance: tuple[float, float], q: Array, frame: Array, T: Array, J: Array
) -> bool:
    """Correct the task error by Newton steps clamped to the limits; return whether it is a fraction of the tolerance.

    Shapes and units: tolerance (float, float) [m, rad], q (n,) [rad, m] (overwritten), frame (n, 4, 4) [1, m] (overwritten), T
    (4, 4) [1, m] (overwritten), J (6, n) [m/rad, 1] (overwritten).
    """
    n, (flags, target), (lower, upper) = q.shape[0], goal, limits
    A, y, dq, e, w, K = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6), np.empty(3), np.empty((6, n))
    for _ in range(MOST_CORRECTIONS):
        p2, r2 = goal_error(chain, flags, target, q, frame, T, e, w)
        jacobian_from(chain, frame, T, J)
        if p2 <= (FRACTION_OF_TOLERANCE * tolerance[0]) ** 2 and r2 <= (FRACTION_OF_TOLERANCE * tolerance[1]) ** 2:
            return True
        for r in range(6):
            for k in range(n):
                K[r, k] = J[r, k]
        task_rows(target, flags, w, K)
        if not damped_step(K, e, PROJECTION_DAMPING, A, y, dq, 0.0):
            return False
        for k in range(n):
            q[k] = min(max(q[k] + dq[k], lower[k]), upper[k])
    return False


@compiled
def descend(
    chain: Chain, limits: Range, goal: Goal, tolerance: tuple[float, float], objective: Objective, q: Array
) -> None:  # fmt: skip
    """Minimise the objective by projected gradient descent in the null space of the task.

    Shapes and units: tolerance (float, float) [m, rad], q (n,) [rad, m] (overwritten).
    """
    n, (flags, target), (lower, upper) = q.shape[0], goal, limits
    frame, T, J = workspace(chain, n)
    g, d, trial, e, w = np.empty(n), np.empty(n), q.copy(), np.empty(6), np.empty(3)
    if not correct(chain, limits, goal, tolerance, trial, frame, T, J):
        return
    copy_vector(trial, q)
    value, step = _cost_in_task_frame(limits, goal, objective, q, J, g), 1.0
    for _ in range(MOST_DESCENTS):
        task_error(T, target, flags, e, w)
        task_rows(target, flags, w, J)
        size = project_gradient(J, g, limits, q, d)
        if size < LEAST_SLOPE:
            return
        better = False
        while not better and step * size > SHORTEST_DESCENT:
            reach = min(step, LONGEST_DESCENT / size)
            for k in range(n):
                trial[k] = min(max(q[k] + reach * d[k], lower[k]), upper[k])
            if correct(chain, limits, goal, tolerance, trial, frame, T, J):
                tried = _cost_in_task_frame(limits, goal, objective, trial, J, g)
                better = tried < value - SUFFICIENT * reach * size * size
            if not better:
                step = 0.5 * reach
        if not better:
            return
        value, step = tried, 2.0 * reach
        copy_vector(trial, q)


PREFERENCES: Mapping[str, str] = {
    "posture": "½|q − posture|²",
    "limits": "½ Σ ((q − middle) / half range)² over joints with two finite limits (Liégeois 1977)",
    "manipulability": "−log sqrt(det(J Jᵀ)), J the task's rows in metres and radians (Yoshikawa 1985)",
}
"""Objectives by name, and the functions that are minimised."""


@dataclass(frozen=True, eq=False)
class Preference:
    """Secondary objective in the null space of a task, with weights above 0 by name; false if it is empty.

    The posture (n,) [rad, m] is None for the initial guess of each solve.
    """

    robot: Robot
    weights: Mapping[str, float]
    posture: Array | None

    @classmethod
    def from_options(cls, robot: Robot, prefer: object, posture: ArrayLike | None) -> Preference:
        """Read the options ``prefer`` and ``posture``."""
        expected = f"one or more of {', '.join(PREFERENCES)}, alone or as a mapping from these to weights"
        named = {} if prefer is None else {prefer: 1.0} if isinstance(prefer, str) else prefer
        if not isinstance(named, Mapping):
            raise InvalidInput("prefer", repr(prefer)[:60], expected)
        for name in named:
            if name not in PREFERENCES:
                raise InvalidInput("prefer", repr(name)[:60], expected)
        weights = {k: check_number(v, f"prefer[{k!r}]", "a weight ≥ 0", least=0.0) for k, v in named.items()}
        weights = {k: weight for k, weight in weights.items() if weight > 0.0}
        if robot.linkage is not None and "manipulability" in weights:
            raise InvalidInput("prefer", f"manipulability, for the linkage {robot.name}", "posture or limits")
        if posture is not None and "posture" not in weights:
            raise InvalidInput("posture", "a posture", 'prefer="posture" together with it')
        return cls(robot, weights, None if posture is None else robot.configuration(posture, "posture").copy())

    def __bool__(self) -> bool:
        return bool(self.weights)

    @property
    def options(self) -> dict[str, Any]:
        """Values of the options ``prefer`` and ``posture``."""
        posture = None if self.posture is None else tuple(self.posture.tolist())
        return {"prefer": dict(self.weights) or None, "posture": posture}

    def explain(self, task: Task, moving: int | None = None) -> str:
        """Return the message that the preference has no effect if the arm is not redundant for the task, else ""."""
        limits = self.robot.limits
        moving = int((limits.lower < limits.upper).sum()) if moving is None else moving
        if not self or task.exact < moving:
            return ""
        return f"prefer has no effect: {moving} joints move, and {task.exact} components of the task are exact"

    def objective(self, start: Array) -> Objective:
        """Return the objective of one solve as the kernels take it."""
        weights = np.array([self.weights.get(name, 0.0) for name in PREFERENCES])
        return weights, start if self.posture is None else self.posture

    def value(self, task: Task, target: Array, start: Array, q: Array) -> float:
        """Return the cost at one configuration."""
        limits, goal = (self.robot.limits.lower, self.robot.limits.upper), (task.flags, target)
        return float(compute_cost(self.robot.chain, limits, goal, self.objective(start), q))

    def improve(self, task: Task, tolerance: tuple[float, float], target: Array, start: Array, q: Array) -> Array:
        """Return the local minimum of the cost in the null space that is found from a configuration."""
        limits, out = (self.robot.limits.lower, self.robot.limits.upper), q.copy()
        descend(self.robot.chain, limits, (task.flags, target), tolerance, self.objective(start), out)
        return out
