"""Interior-point iteration for the jerk-limited time optimum along a path: one small stage per interval, compiled.

The grid points s_k are fixed. Unknown are ṡ = v and s̈ = a there, and the duration τ and the jerk j of every interval:

    min Σ τ_k   with   v τ + a τ²/2 + j τ³/6 = Δs,   v + a τ + j τ²/2 = v⁺,   a + j τ = a⁺,
    |q' v| ≤ V,   |q' a + q'' v²| ≤ A,   |q' j + 3 q'' v a + q''' v³| ≤ J at both ends of every interval.

Torques and their rates are rows with more coefficients: p a + c v² + f v + g and p j + d v a + c' v³ + g' v + f' a + f'' v²
(`planners.limits.kinds`). All terms are polynomial, and none is singular at standstill. A Newton step of the
barrier problem (Nocedal and Wright, Numerical Optimization, ch. 19) is a linear-quadratic problem over the stages, solved by
one sweep back and one forth (Riccati), in which the sign of every pivot shows whether the step goes down.
"""

from __future__ import annotations

from math import log

import numpy as np

from optik.compiled import compiled, inlined
from optik.linear import copy_matrix
from optik.types import Array
from planners.timing.interior_point.newton import (
    Border,
    Iterate,
    Problem,
    active_range,
    back,
    edge_slope,
    forth,
    product,
)

MET = 1e-5
"""Accepted residual of the dynamics of an interval, over its length."""
TRUE = 1e-4
"""Accepted change of a joint's jerk by that residual, over its limit: the stricter test in short intervals."""


@inlined
def _edge_value(edge: Array, k: int, end: int, i: int, v: float, a: float, j: float) -> float:
    """Return the value of a row with jerk (a joint's jerk or torque rate) over its limit."""
    p, q, u = edge[k, end, i, 0], edge[k, end, i, 1], edge[k, end, i, 2]
    linear, square, slope = edge[k, end, i, 3], edge[k, end, i, 5], edge[k, end, i, 4]
    return float(p * j + (q * v + slope) * a + ((u * v + square) * v + linear) * v)


@compiled
def values(problem: Problem, z: Array, g: Array, c: Array) -> None:
    """Compute the residuals of the dynamics and the values of the limits; see `Iterate`.

    Shapes and units: z (K + 1, 4) [as the problem], g (K, 3) [as the problem], c (K + 1, m + 2·e) [1].
    """
    node, edge = problem.node, problem.edge
    K, m, e = problem.ds.shape[0], node.shape[1], edge.shape[2]
    for k in range(K + 1):
        v, a, tau, j = z[k, 0], z[k, 1], z[k, 2], z[k, 3]
        for i in range(m):
            c[k, i] = node[k, i, 0] * a + (node[k, i, 1] * v + node[k, i, 2]) * v + node[k, i, 3]
        if k == K:
            break
        g[k, 0] = tau * (v + tau * (0.5 * a + tau * j / 6.0)) - problem.ds[k]
        g[k, 1] = v + tau * (a + 0.5 * tau * j) - z[k + 1, 0]
        g[k, 2] = a + tau * j - z[k + 1, 1]
        w, b = z[k + 1, 0], z[k + 1, 1]
        for i in range(e):
            c[k, m + i] = _edge_value(edge, k, 0, i, v, a, j)
            c[k, m + e + i] = _edge_value(edge, k, 1, i, w, b, j)


@compiled
def slopes(problem: Problem, z: Array, d: Array, out: Array, border: Border | None) -> None:
    """Compute the first-order change of every limited value along d (K + 1, m + 2 e)."""
    node, edge = problem.node, problem.edge
    K, m, e = problem.ds.shape[0], node.shape[1], edge.shape[2]
    for k in range(K + 1):
        v, a = z[k, 0], z[k, 1]
        for i in range(m):
            out[k, i] = node[k, i, 0] * d[k, 1] + (2.0 * node[k, i, 1] * v + node[k, i, 2]) * d[k, 0]
        if k == K:
            break
        w, b = z[k + 1, 0], z[k + 1, 1]
        for i in range(e):
            x, r = edge_slope(edge, k, 0, i, v, a)
            out[k, m + i] = edge[k, 0, i, 0] * d[k, 3] + r * d[k, 1] + x * d[k, 0]
            x, r = edge_slope(edge, k, 1, i, w, b)
            out[k, m + e + i] = edge[k, 1, i, 0] * d[k, 3] + r * d[k + 1, 1] + x * d[k + 1, 0]
    if border is not None:
        for k in range(K + 1):
            for i in range(m + 2 * e if k < K else m):
                out[k, i] += product(border, border.columns[k, i], k)


@inlined
def _cut(length: float, x: float, dx: float, keep: float) -> float:
    """Return the step length, reduced so that x + length · dx ≥ (1 − keep) · x."""
    return -keep * x / dx if dx * length < -keep * x else length


# More than 8 parameters: the workspace of the iteration, which allocates it once.
@compiled
def lengths(
    problem: Problem, at: Iterate, mu: float, d: Array, slope: Array, dslack: Array, ddual: Array, dbound: Array,
    border: Border | None,
) -> tuple[float, float]:  # fmt: skip
    """Compute the steps of slacks and duals; return the lengths of the primal and the dual step that keep them positive."""
    K = problem.ds.shape[0]
    primal, dual, keep = 1.0, 1.0, max(0.99, 1.0 - mu)
    for k in range(K + 1):
        weight = mu * problem.tau[min(k, K - 1)]
        low, high = active_range(k, problem, border)
        for side in range(2):
            sign = 1.0 - 2.0 * side
            for i in range(low, high):
                t, y = at.slack[k, side, i], at.dual[k, side, i]
                dt = 1.0 - sign * (at.c[k, i] + slope[k, i]) - t
                dy = (weight - y * dt) / t - y
                dslack[k, side, i], ddual[k, side, i] = dt, dy
                primal, dual = _cut(primal, t, dt, keep), _cut(dual, y, dy, keep)
        if k == K:
            break
        if k > 0:
            v, room = at.z[k, 0], problem.top[k] - at.z[k, 0]
            dbound[k, 0] = (weight - at.bound[k, 0] * d[k, 0]) / v - at.bound[k, 0]
            dbound[k, 1] = (weight + at.bound[k, 1] * d[k, 0]) / room - at.bound[k, 1]
            primal = _cut(_cut(primal, v, d[k, 0], keep), room, -d[k, 0], keep)
            dual = _cut(_cut(dual, at.bound[k, 0], dbound[k, 0], keep), at.bound[k, 1], dbound[k, 1], keep)
        spare = at.z[k, 2] - problem.least[k]
        dbound[k, 2] = (weight - at.bound[k, 2] * d[k, 2]) / spare - at.bound[k, 2]
        primal, dual = _cut(primal, spare, d[k, 2], keep), _cut(dual, at.bound[k, 2], dbound[k, 2], keep)
    return primal, dual


@compiled
def merit(
    problem: Problem, mu: float, z: Array, g: Array, c: Array, slack: Array, border: Border | None
) -> tuple[float, float]:  # fmt: skip
    """Return the barrier objective, and the sum of the residuals."""
    K = g.shape[0]
    objective, off = 0.0, abs(z[K, 0] - problem.goal[0]) + abs(z[K, 1] - problem.goal[1])
    for k in range(K + 1):
        weight = mu * problem.tau[min(k, K - 1)]
        if k < K:
            tau = problem.tau[k]
            objective += z[k, 2] - weight * log(z[k, 2] - problem.least[k])
            off += (abs(g[k, 0]) + tau * (abs(g[k, 1]) + tau * abs(g[k, 2]))) / problem.ds[k]
            if k > 0:
                objective -= weight * log(z[k, 0] * (problem.top[k] - z[k, 0]))
        together = 1.0  # one logarithm for several slacks
        low, high = active_range(k, problem, border)
        for i in range(low, high):
            above, below = slack[k, 0, i], slack[k, 1, i]
            together *= above * below
            if together < 1e-150 or together > 1e150:
                objective -= weight * log(together)
                together = 1.0
            off += abs(c[k, i] + above - 1.0) + abs(below - c[k, i] - 1.0)
        objective -= weight * log(together)
    return objective, off


@compiled
def is_better(passed: Array, count: int, objective: float, off: float, small: float) -> bool:
    """Return whether a step is accepted by a filter (Nocedal and Wright, ch. 15.4).

    Compared with each earlier iterate at this barrier weight (2, count), its residual or its objective is lower.
    """
    last = passed[0, count - 1]
    if off < small and objective <= last + 1e-9 * abs(last):
        return True
    for i in range(count):
        if off > (1.0 - 1e-4) * passed[1, i] + 1e-11 and objective >= passed[0, i] - 1e-4 * passed[1, i]:
            return False
    return True


@compiled
def move_inside(problem: Problem, at: Iterate, mu: float) -> None:
    """Move the initial guess inside its bounds, and set their multipliers on the central path."""
    K = problem.ds.shape[0]
    for k in range(K):
        weight = mu * problem.tau[k]
        if k > 0:
            top = problem.top[k]
            at.z[k, 0] = min(max(at.z[k, 0], 1e-3 * min(top, problem.ds[k] / problem.tau[k])), 0.999 * top)
            at.bound[k, 0], at.bound[k, 1] = weight / at.z[k, 0], weight / (top - at.z[k, 0])
        at.z[k, 2] = max(at.z[k, 2], 1.02 * problem.least[k])
        at.bound[k, 2] = weight / (at.z[k, 2] - problem.least[k])
    values(problem, at.z, at.g, at.c)


@compiled
def centre(problem: Problem, at: Iterate, mu: float) -> None:
    """Set slacks and multipliers of the limits on the central path."""
    K, rows = problem.ds.shape[0], at.c.shape[1]
    for k in range(K + 1):
        for side in range(2):
            sign = 1.0 - 2.0 * side
            for i in range(rows):
                at.slack[k, side, i] = max(1.0 - sign * at.c[k, i], 1e-2)
                at.dual[k, side, i] = mu * problem.tau[min(k, K - 1)] / at.slack[k, side, i]


@compiled
def step(at: Iterate, alpha: float, d: Array, dslack: Array, trial: Iterate) -> None:
    """Compute the unknowns and the slacks of the trial point after a step of length alpha."""
    K, rows = at.g.shape[0], at.c.shape[1]
    for k in range(K + 1):
        for i in range(4):
            trial.z[k, i] = at.z[k, i] + alpha * d[k, i]
        for side in range(2):
            for i in range(rows):
                trial.slack[k, side, i] = at.slack[k, side, i] + alpha * dslack[k, side, i]


@compiled
def accept(
    at: Iterate, trial: Iterate, alpha: float, dual: float, lam: Array, ddual: Array, dbound: Array
) -> None:  # fmt: skip
    """Move to a trial point; a slack below the remaining range of its limit is set to that range."""
    K, rows = at.g.shape[0], at.c.shape[1]
    for k in range(K + 1):
        for i in range(4):
            at.z[k, i] = trial.z[k, i]
        for i in range(3):
            at.lam[k, i] += alpha * (lam[k, i] - at.lam[k, i])
            at.bound[k, i] += dual * dbound[k, i]
            if k < K:
                at.g[k, i] = trial.g[k, i]
        for i in range(rows):
            at.c[k, i] = trial.c[k, i]
            for side in range(2):
                at.slack[k, side, i] = max(trial.slack[k, side, i], 1.0 - (1.0 - 2.0 * side) * trial.c[k, i])
                at.dual[k, side, i] += dual * ddual[k, side, i]


@compiled
def gap_of(problem: Problem, at: Iterate, border: Border | None) -> float:
    """Return the duality gap, the sum of all slacks times multipliers; infinite if the dynamics are not satisfied."""
    K = problem.ds.shape[0]
    gap = 0.0
    for k in range(K + 1):
        low, high = active_range(k, problem, border)
        for side in range(2):
            for i in range(low, high):
                gap += at.slack[k, side, i] * at.dual[k, side, i]
        if k == K:
            break
        tau, most = at.z[k, 2], 0.0
        left = (abs(at.g[k, 0]), tau * abs(at.g[k, 1]), tau * tau * abs(at.g[k, 2]))
        for side in range(2):
            for i in range(problem.edge.shape[2]):
                most = max(most, abs(problem.edge[k, side, i, 0]))
        jerk = (60.0 * left[0] + 36.0 * left[1] + 9.0 * left[2]) / tau**3  # of the quintic that leaves nothing
        if left[0] + left[1] + left[2] > MET * problem.ds[k] or jerk * most > TRUE:
            return np.inf
        if k > 0:
            gap += at.z[k, 0] * at.bound[k, 0] + (problem.top[k] - at.z[k, 0]) * at.bound[k, 1]
        gap += (at.z[k, 2] - problem.least[k]) * at.bound[k, 2]
    return gap


@compiled
def make_iterate(K: int, rows: int) -> Iterate:
    """Return an iterate of zeros, for K intervals with so many limited values."""
    return Iterate(
        np.zeros((K + 1, 4)), np.zeros((K, 3)), np.zeros((K + 1, rows)), np.ones((K + 1, 2, rows)), np.ones((K + 1, 2, rows)),
        np.zeros((K + 1, 3)), np.zeros((K + 1, 3)),
    )  # fmt: skip


@compiled
def solve_barrier(problem: Problem, z: Array, mu: float, least: float, most: int, at: Iterate) -> int:
    """Optimise z in place, with its first state and the problem's goal fixed; return the number of iterations, or −1.

    The last iterate, with its multipliers, is left in ``at``. Shapes and units: z (K + 1, 4) [as the problem].
    """
    K, rows = problem.ds.shape[0], problem.node.shape[1] + 2 * problem.edge.shape[2]
    trial = make_iterate(K, rows)
    copy_matrix(z, at.z)
    move_inside(problem, at, mu)
    centre(problem, at, mu)
    d, lam, slope = np.zeros((K + 1, 4)), np.zeros((K + 1, 3)), np.zeros((K + 1, rows))
    dslack, ddual, dbound = np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 3))
    models, law, cost = np.empty((K, 4, 5)), np.empty((K, 3)), np.empty((K + 1, 5))
    passed, count, delta_before = np.empty((2, most)), 0, 0.0
    for iteration in range(most):
        delta = 0.0
        while not back(problem, at, mu, delta, models, law, cost, None):
            delta = max(4.0 * delta, delta_before / 3.0, 1e-6)
            if delta > 1e8:
                return -1
        delta_before = delta
        forth(problem, at, models, law, cost, d, lam, None)
        slopes(problem, at.z, d, slope, None)
        alpha, dual = lengths(problem, at, mu, d, slope, dslack, ddual, dbound, None)
        passed[0, count], passed[1, count] = merit(problem, mu, at.z, at.g, at.c, at.slack, None)
        count, off = count + 1, 0.0
        for _ in range(12):
            step(at, alpha, d, dslack, trial)
            values(problem, trial.z, trial.g, trial.c)
            objective, off = merit(problem, mu, trial.z, trial.g, trial.c, trial.slack, None)
            if is_better(passed, count, objective, off, 1e-6 * K):
                break
            alpha *= 0.5
        accept(at, trial, alpha, dual, lam, ddual, dbound)
        if alpha > 0.7 and dual > 0.7 and off <= 10.0 * mu * K:
            if (
                mu <= least
                and off < 1e-6 * K
                and gap_of(problem, at, None) < 3.0 * (2 * rows + 3) * least * problem.tau.sum()
            ):
                copy_matrix(at.z, z)
                return iteration + 1
            mu, count = max(least, min(0.2 * mu, mu**1.5)), 0
    return -1
