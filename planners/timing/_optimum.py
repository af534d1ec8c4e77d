"""Interior-point iteration for the jerk-limited time optimum along a path: one small stage an interval, compiled.

Places s_k are fixed; unknown are ṡ = v and s̈ = a at them, and the duration τ and the jerk j of every interval:

    min Σ τ_k   with   v τ + a τ²/2 + j τ³/6 = Δs,   v + a τ + j τ²/2 = v⁺,   a + j τ = a⁺,
    |q' v| ≤ V,   |q' a + q'' v²| ≤ A,   |q' j + 3 q'' v a + q''' v³| ≤ J at both ends of every interval.

All of it is polynomial, and nothing is singular at standstill. A Newton step of the barrier problem (Nocedal and Wright,
Numerical Optimization, ch. 19) is a linear-quadratic problem over the stages, solved by one sweep back and one forth
(Riccati), in which the sign of every pivot shows whether the step goes down.
"""

from __future__ import annotations

from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik._compile import compiled, inlined

Array = NDArray[np.float64]

TERMINAL = 1e4
"""Weight of the state at the end in the sweep, in the units of the last interval; its multiplier takes up what it leaves.

All that the sweep carries back is rounded to this: weights far above what it compares with drown the pivots."""

PIVOT = 1e-8
"""Curvature of the model in a stage's free number, in the stage's units, below which it is rounding."""

MET = 1e-5
"""What the dynamics of an interval may leave at the end, over its length."""
TRUE = 1e-4
"""What that may change in the jerk of any joint, over its limit: in brief intervals far more than in s."""


class Problem(NamedTuple):
    """What is given, in units in which the numbers are near 1; n joints, K intervals.

    ds (K,) lengths of the intervals, tau (K,) about their durations, 1 in the mean, least (K,) their least ones (above 0, so
    that time does not run backwards on the way to the solution), top (K + 1,) greatest speeds, node (K + 1, n, 2) q'/A and
    q''/A, edge (K, 2, n, 3) q'/J, 3 q''/J and q'''/J at both ends of each interval, goal (2,) v and a at the end.

    A sharp corner has intervals a thousandth as long as others: what is added to a stage, what is judged small, and the
    weight of its barrier, are counted in the interval's own ds and tau.
    """

    ds: Array
    tau: Array
    least: Array
    top: Array
    node: Array
    edge: Array
    goal: Array


class Iterate(NamedTuple):
    """Where the iteration stands.

    z (K + 1, 4) holds v, a, τ, j; g (K, 3) what the dynamics leave, c (K + 1, 3 n) the limited values, each in [−1, 1] at
    the end: n accelerations at the node, n jerks at the interval's start, n at its end. slack and dual (K + 1, 2, 3 n)
    belong to c ≤ 1 and −c ≤ 1, bound (K + 1, 3) to v ≥ 0, v ≤ top and τ ≥ its least, lam (K + 1, 3) to the dynamics.
    """

    z: Array
    g: Array
    c: Array
    slack: Array
    dual: Array
    bound: Array
    lam: Array


@compiled
def values(problem: Problem, z: Array, g: Array, c: Array) -> None:
    """Residuals of the dynamics and values of the limits at z, see `Iterate`."""
    node, edge = problem.node, problem.edge
    K, n = problem.ds.shape[0], node.shape[1]
    for k in range(K + 1):
        v, a, tau, j = z[k, 0], z[k, 1], z[k, 2], z[k, 3]
        for i in range(n):
            c[k, i] = node[k, i, 0] * a + node[k, i, 1] * v * v
        if k == K:
            break
        g[k, 0] = tau * (v + tau * (0.5 * a + tau * j / 6.0)) - problem.ds[k]
        g[k, 1] = v + tau * (a + 0.5 * tau * j) - z[k + 1, 0]
        g[k, 2] = a + tau * j - z[k + 1, 1]
        w, b = z[k + 1, 0], z[k + 1, 1]
        for i in range(n):
            c[k, n + i] = edge[k, 0, i, 0] * j + edge[k, 0, i, 1] * v * a + edge[k, 0, i, 2] * v * v * v
            c[k, 2 * n + i] = edge[k, 1, i, 0] * j + edge[k, 1, i, 1] * w * b + edge[k, 1, i, 2] * w * w * w


@compiled
def limited(
    q1: Array,
    q2: Array,
    q3: Array,
    acceleration: Array,
    jerk: Array,
    length: float,
    time: float,
    node: Array,
    edge: Array,
) -> None:
    """Fill a problem's `node` and `edge` from q', q'' (K + 1, n), q''' (2 K, n: at the starts, then the ends) and limits."""
    K = edge.shape[0]
    v1, v2, v3 = length / time, (length / time) ** 2, (length / time) ** 3
    for i in range(q1.shape[1]):
        A, J = 1.0 / acceleration[i], 1.0 / jerk[i]
        for k in range(K + 1):
            node[k, i, 0], node[k, i, 1] = q1[k, i] * v1 / time * A, q2[k, i] * v2 * A
        for k in range(K):
            for side in range(2):
                edge[k, side, i, 0] = q1[k + side, i] * v1 / time**2 * J
                edge[k, side, i, 1] = 3.0 * q2[k + side, i] * v2 / time * J
                edge[k, side, i, 2] = q3[k + side * K, i] * v3 * J


@inlined
def _first(k: int, n: int) -> int:
    """First limit of a place: the state at the start is given, so its acceleration is no limit."""
    return n if k == 0 else 0


@inlined
def _pull(at: Iterate, k: int, i: int, mu: float) -> tuple[float, float, float]:
    """Of a limit's two sides: weight of ∇c ∇cᵀ and pull along ∇c in the model, and the multiplier of c."""
    above, below = 1.0 / at.slack[k, 0, i], 1.0 / at.slack[k, 1, i]
    up, down, c = at.dual[k, 0, i], at.dual[k, 1, i], at.c[k, i]
    higher = (mu + up * (c - 1.0)) * above + up
    lower = (mu - down * (c + 1.0)) * below + down
    return up * above + down * below, higher - lower, up - down


@inlined
def _stage(k: int, problem: Problem, at: Iterate, mu: float, delta: float, M: Array, m: Array) -> None:
    """Quadratic model of the barrier problem on interval k, over (v, a, τ, j, v⁺, a⁺): upper half of M (6, 6), and m (6,)."""
    z, lam, node, edge = at.z, at.lam, problem.node, problem.edge
    n = node.shape[1]
    v, a, tau, j = z[k, 0], z[k, 1], z[k, 2], z[k, 3]
    w, b = z[k + 1, 0], z[k + 1, 1]
    size = problem.ds[k] / problem.tau[k]
    mu *= problem.tau[k]
    delta *= problem.tau[k]
    spare = 1.0 / (tau - problem.least[k])
    m0, m1, m3, m4, m5 = 0.0, 0.0, 0.0, 0.0, 0.0
    M00, M01, M11 = delta / size**2, 0.0, delta * (problem.tau[k] / size) ** 2
    M03, M13, M33 = 0.0, 0.0, delta * (problem.tau[k] ** 2 / size) ** 2
    M34, M35, M44, M45, M55 = 0.0, 0.0, 0.0, 0.0, 0.0
    if k > 0:
        low, room = 1.0 / v, 1.0 / (problem.top[k] - v)
        m0 += mu * (room - low)
        M00 += at.bound[k, 0] * low + at.bound[k, 1] * room
        for i in range(n):
            weight, pull, y = _pull(at, k, i, mu)
            p, q = node[k, i, 0], node[k, i, 1]
            x = 2.0 * q * v
            m0, m1 = m0 + pull * x, m1 + pull * p
            M00, M01, M11 = M00 + weight * x * x + 2.0 * q * y, M01 + weight * x * p, M11 + weight * p * p
    for i in range(n):
        weight, pull, y = _pull(at, k, n + i, mu)
        p, q, u = edge[k, 0, i, 0], edge[k, 0, i, 1], edge[k, 0, i, 2]
        x, r = q * a + 3.0 * u * v * v, q * v
        m0, m1, m3 = m0 + pull * x, m1 + pull * r, m3 + pull * p
        M00, M01, M11 = M00 + weight * x * x + 6.0 * u * v * y, M01 + weight * x * r + q * y, M11 + weight * r * r
        M03, M13, M33 = M03 + weight * x * p, M13 + weight * r * p, M33 + weight * p * p
        weight, pull, y = _pull(at, k, 2 * n + i, mu)
        p, q, u = edge[k, 1, i, 0], edge[k, 1, i, 1], edge[k, 1, i, 2]
        x, r = q * b + 3.0 * u * w * w, q * w
        m3, m4, m5 = m3 + pull * p, m4 + pull * x, m5 + pull * r
        M33, M34, M35 = M33 + weight * p * p, M34 + weight * p * x, M35 + weight * p * r
        M44, M45, M55 = M44 + weight * x * x + 6.0 * u * w * y, M45 + weight * x * r + q * y, M55 + weight * r * r
    m[0], m[1], m[2], m[3], m[4], m[5] = m0, m1, 1.0 - mu * spare, m3, m4, m5
    M[0, 0], M[0, 1], M[0, 3], M[1, 1], M[1, 3], M[3, 3] = M00, M01, M03, M11, M13, M33
    M[3, 4], M[3, 5], M[4, 4], M[4, 5], M[5, 5] = M34, M35, M44, M45, M55
    M[0, 2] = lam[k, 0]
    M[1, 2] = lam[k, 0] * tau + lam[k, 1]
    M[2, 2] = delta / problem.tau[k] ** 2 + at.bound[k, 2] * spare + lam[k, 0] * (a + j * tau) + lam[k, 1] * j
    M[2, 3] = lam[k, 0] * 0.5 * tau * tau + lam[k, 1] * tau + lam[k, 2]


@inlined
def _fold(z: Array, g: Array, M: Array, m: Array, Q: Array, q: Array) -> None:
    """Put the dynamics of v⁺ and a⁺ into a stage's model: M (6, 6), upper half, and m become Q (4, 4) and q (4,).

    Of v, a, τ and j it is the jerk only that a limit has together with v⁺ and a⁺.
    """
    a, tau, j = z[1], z[2], z[3]
    first, second = (1.0, tau, a + j * tau, 0.5 * tau * tau), (0.0, 1.0, j, tau)  # derivatives of v⁺ and of a⁺
    velocity = m[4] + M[4, 4] * g[1] + M[4, 5] * g[2]
    acceleration = m[5] + M[4, 5] * g[1] + M[5, 5] * g[2]
    m[3] += M[3, 4] * g[1] + M[3, 5] * g[2]
    for r in range(4):
        q[r] = m[r] + first[r] * velocity + second[r] * acceleration
        x, y = M[4, 4] * first[r] + M[4, 5] * second[r], M[4, 5] * first[r] + M[5, 5] * second[r]
        for i in range(r, 4):
            Q[r, i] = M[r, i] + x * first[i] + y * second[i]
        Q[r, 3] += M[3, 4] * first[r] + M[3, 5] * second[r]
    Q[3, 3] += M[3, 4] * first[3] + M[3, 5] * second[3]
    for r in range(1, 4):
        for i in range(r):
            Q[r, i] = Q[i, r]


@inlined
def _place_row(z: Array, row: Array) -> int:
    """Gradient (4,) of the place s⁺ over (v, a, τ, j); which of τ and j it shall determine."""
    v, a, tau, j = z[0], z[1], z[2], z[3]
    row[0], row[1] = tau, 0.5 * tau * tau
    row[2], row[3] = v + tau * (a + 0.5 * tau * j), tau * tau * tau / 6.0
    return 2 if abs(row[2]) >= abs(row[3]) else 3


@compiled
def _back(problem: Problem, at: Iterate, mu: float, delta: float, models: Array, law: Array, cost: Array) -> bool:
    """The sweep from the end: of every stage its model over (v, a, τ, j), its feedback and its cost to go.

    models (K, 4, 5) hold matrix and vector, law (K, 3) the one free number as a function of (v, a) and its constant,
    cost (K + 1, 5) P₀₀, P₀₁, P₁₁, p₀, p₁. False where a pivot is not positive: the model has no least value.
    """
    z, K = at.z, problem.ds.shape[0]
    M, m, row = np.empty((6, 6)), np.empty(6), np.empty(4)
    Q, q, R, r, N = np.empty((4, 4)), np.empty(4), np.empty((3, 3)), np.empty(3), np.empty(3)
    tau, ds = problem.tau[K - 1], problem.ds[K - 1]
    cost[K, 0], cost[K, 1], cost[K, 2] = TERMINAL * tau * (tau / ds) ** 2, 0.0, TERMINAL * tau * (tau**2 / ds) ** 2
    for i in range(2):
        cost[K, 3 + i] = cost[K, 2 * i] * (z[K, i] - problem.goal[i]) + at.lam[K, 1 + i]
    for k in range(K - 1, -1, -1):
        _stage(k, problem, at, mu, delta, M, m)
        M[4, 4] += cost[k + 1, 0]
        M[4, 5] += cost[k + 1, 1]
        M[5, 5] += cost[k + 1, 2]
        m[4] += cost[k + 1, 3]
        m[5] += cost[k + 1, 4]
        _fold(z[k], at.g[k], M, m, Q, q)
        pivot = _place_row(z[k], row)  # the place s⁺ is fixed: one of τ and j follows from the others
        free = 5 - pivot
        N[0], N[1], N[2] = -row[0] / row[pivot], -row[1] / row[pivot], -row[free] / row[pivot]
        for i in range(4):
            q[i] -= Q[i, pivot] * at.g[k, 0] / row[pivot]
            models[k, i, 4] = q[i]
            for j in range(4):
                models[k, i, j] = Q[i, j]
        for i in range(3):
            o = free if i == 2 else i
            r[i] = q[o] + N[i] * q[pivot]
            for j in range(3):
                h = free if j == 2 else j
                R[i, j] = Q[o, h] + N[i] * Q[pivot, h] + N[j] * (Q[o, pivot] + N[i] * Q[pivot, pivot])
        unit = problem.tau[k] if free == 2 else problem.ds[k] / problem.tau[k] ** 3
        if not R[2, 2] * unit**2 > PIVOT * problem.tau[k]:
            return False
        law[k, 0], law[k, 1], law[k, 2] = -R[2, 0] / R[2, 2], -R[2, 1] / R[2, 2], -r[2] / R[2, 2]
        cost[k, 0], cost[k, 1] = R[0, 0] + R[0, 2] * law[k, 0], R[0, 1] + R[0, 2] * law[k, 1]
        cost[k, 2] = R[1, 1] + R[1, 2] * law[k, 1]
        cost[k, 3], cost[k, 4] = r[0] + R[0, 2] * law[k, 2], r[1] + R[1, 2] * law[k, 2]
    return True


@compiled
def _forth(problem: Problem, at: Iterate, models: Array, law: Array, cost: Array, d: Array, lam: Array) -> None:
    """The sweep from the start: the step d (K + 1, 4) and the dynamics' new multipliers lam (K + 1, 3)."""
    z, g, K = at.z, at.g, problem.ds.shape[0]
    row = np.empty(4)
    d[0, 0] = d[0, 1] = d[K, 2] = d[K, 3] = 0.0
    for k in range(K):
        x, y = d[k, 0], d[k, 1]
        pivot = _place_row(z[k], row)
        free = 5 - pivot
        d[k, free] = law[k, 0] * x + law[k, 1] * y + law[k, 2]
        fixed = -g[k, 0] / row[pivot]
        d[k, pivot] = fixed - (row[0] * x + row[1] * y + row[free] * d[k, free]) / row[pivot]
        slope = models[k, pivot, 4]  # it holds the constant part already
        for i in range(4):
            slope += models[k, pivot, i] * (d[k, i] - (fixed if i == pivot else 0.0))
        lam[k, 0] = -slope / row[pivot]
        a, tau, j = z[k, 1], z[k, 2], z[k, 3]
        v_next = x + tau * y + (a + j * tau) * d[k, 2] + 0.5 * tau * tau * d[k, 3] + g[k, 1]
        a_next = y + j * d[k, 2] + tau * d[k, 3] + g[k, 2]
        d[k + 1, 0], d[k + 1, 1] = v_next, a_next
        lam[k, 1] = cost[k + 1, 3] + cost[k + 1, 0] * v_next + cost[k + 1, 1] * a_next
        lam[k, 2] = cost[k + 1, 4] + cost[k + 1, 1] * v_next + cost[k + 1, 2] * a_next
    lam[K, 0], lam[K, 1], lam[K, 2] = 0.0, lam[K - 1, 1], lam[K - 1, 2]


@compiled
def _slopes(problem: Problem, z: Array, d: Array, out: Array) -> None:
    """Change of every limited value along d, to first order (K + 1, 3 n)."""
    node, edge = problem.node, problem.edge
    K, n = problem.ds.shape[0], node.shape[1]
    for k in range(K + 1):
        v, a = z[k, 0], z[k, 1]
        for i in range(n):
            out[k, i] = node[k, i, 0] * d[k, 1] + 2.0 * node[k, i, 1] * v * d[k, 0]
        if k == K:
            break
        w, b = z[k + 1, 0], z[k + 1, 1]
        for i in range(n):
            p, q, u = edge[k, 0, i, 0], edge[k, 0, i, 1], edge[k, 0, i, 2]
            out[k, n + i] = p * d[k, 3] + q * (v * d[k, 1] + a * d[k, 0]) + 3.0 * u * v * v * d[k, 0]
            p, q, u = edge[k, 1, i, 0], edge[k, 1, i, 1], edge[k, 1, i, 2]
            out[k, 2 * n + i] = p * d[k, 3] + q * (w * d[k + 1, 1] + b * d[k + 1, 0]) + 3.0 * u * w * w * d[k + 1, 0]


@inlined
def _cut(length: float, x: float, dx: float, keep: float) -> float:
    """The step's length, cut so that x + length · dx keeps a share of x > 0."""
    return -keep * x / dx if dx * length < -keep * x else length


@compiled
def _lengths(
    problem: Problem,
    at: Iterate,
    mu: float,
    d: Array,
    slope: Array,
    dslack: Array,
    ddual: Array,
    dbound: Array,
) -> tuple[float, float]:
    """Steps of slacks and duals, and how long primal and dual steps may be so that all stays positive."""
    K, n = problem.ds.shape[0], problem.node.shape[1]
    primal, dual, keep = 1.0, 1.0, max(0.99, 1.0 - mu)
    for k in range(K):
        weight = mu * problem.tau[k]
        for side in range(2):
            sign = 1.0 - 2.0 * side
            for i in range(_first(k, n), 3 * n):
                t, y = at.slack[k, side, i], at.dual[k, side, i]
                dt = 1.0 - sign * (at.c[k, i] + slope[k, i]) - t
                dy = (weight - y * dt) / t - y
                dslack[k, side, i], ddual[k, side, i] = dt, dy
                primal, dual = _cut(primal, t, dt, keep), _cut(dual, y, dy, keep)
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
def _merit(problem: Problem, mu: float, z: Array, g: Array, c: Array, slack: Array) -> tuple[float, float]:
    """Barrier objective, and the sum of what the equations leave."""
    K, n = g.shape[0], problem.node.shape[1]
    objective, off = 0.0, abs(z[K, 0] - problem.goal[0]) + abs(z[K, 1] - problem.goal[1])
    for k in range(K):
        tau, weight = problem.tau[k], mu * problem.tau[k]
        objective += z[k, 2] - weight * log(z[k, 2] - problem.least[k])
        off += (abs(g[k, 0]) + tau * (abs(g[k, 1]) + tau * abs(g[k, 2]))) / problem.ds[k]
        if k > 0:
            objective -= weight * log(z[k, 0] * (problem.top[k] - z[k, 0]))
        product = 1.0  # one logarithm for several slacks
        for i in range(_first(k, n), 3 * n):
            above, below = slack[k, 0, i], slack[k, 1, i]
            product *= above * below
            if product < 1e-150 or product > 1e150:
                objective -= weight * log(product)
                product = 1.0
            off += abs(c[k, i] + above - 1.0) + abs(below - c[k, i] - 1.0)
        objective -= weight * log(product)
    return objective, off


@compiled
def _better(passed: Array, count: int, objective: float, off: float, small: float) -> bool:
    """Whether a step is taken: a filter (Nocedal and Wright, ch. 15.4).

    Against every iterate before at this barrier (2, count), it meets the equations better or has a lower objective.
    """
    last = passed[0, count - 1]
    if off < small and objective <= last + 1e-9 * abs(last):
        return True
    for i in range(count):
        if off > (1.0 - 1e-4) * passed[1, i] + 1e-11 and objective >= passed[0, i] - 1e-4 * passed[1, i]:
            return False
    return True


@compiled
def _begin(problem: Problem, at: Iterate, mu: float) -> None:
    """Put the start inside its bounds, and slacks and multipliers on the central path."""
    K, n = problem.ds.shape[0], problem.node.shape[1]
    for k in range(K):
        weight = mu * problem.tau[k]
        if k > 0:
            top = problem.top[k]
            at.z[k, 0] = min(max(at.z[k, 0], 1e-3 * min(top, problem.ds[k] / problem.tau[k])), 0.999 * top)
            at.bound[k, 0], at.bound[k, 1] = weight / at.z[k, 0], weight / (top - at.z[k, 0])
        at.z[k, 2] = max(at.z[k, 2], 1.02 * problem.least[k])
        at.bound[k, 2] = weight / (at.z[k, 2] - problem.least[k])
    values(problem, at.z, at.g, at.c)
    for k in range(K):
        for side in range(2):
            sign = 1.0 - 2.0 * side
            for i in range(3 * n):
                at.slack[k, side, i] = max(1.0 - sign * at.c[k, i], 1e-2)
                at.dual[k, side, i] = mu * problem.tau[k] / at.slack[k, side, i]


@compiled
def _take(
    at: Iterate, trial: Iterate, alpha: float, dual: float, lam: Array, ddual: Array, dbound: Array
) -> None:  # fmt: skip
    """Move to a trial point; a slack smaller than what its limit leaves is widened to that."""
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
def _gap(problem: Problem, at: Iterate) -> float:
    """Sum of all slacks times their multipliers: about what is left to the optimum; infinite where the dynamics are not met."""
    K, n = problem.ds.shape[0], problem.node.shape[1]
    gap = 0.0
    for k in range(K):
        tau, most = at.z[k, 2], 0.0
        left = (abs(at.g[k, 0]), tau * abs(at.g[k, 1]), tau * tau * abs(at.g[k, 2]))
        for side in range(2):
            for i in range(n):
                most = max(most, abs(problem.edge[k, side, i, 0]))
        jerk = (60.0 * left[0] + 36.0 * left[1] + 9.0 * left[2]) / tau**3  # of the quintic that leaves nothing
        if left[0] + left[1] + left[2] > MET * problem.ds[k] or jerk * most > TRUE:
            return np.inf
        for side in range(2):
            for i in range(_first(k, n), 3 * n):
                gap += at.slack[k, side, i] * at.dual[k, side, i]
        if k > 0:
            gap += at.z[k, 0] * at.bound[k, 0] + (problem.top[k] - at.z[k, 0]) * at.bound[k, 1]
        gap += (at.z[k, 2] - problem.least[k]) * at.bound[k, 2]
    return gap


@compiled
def _iterate(K: int, rows: int) -> Iterate:
    return Iterate(
        np.zeros((K + 1, 4)), np.zeros((K, 3)), np.zeros((K + 1, rows)), np.ones((K + 1, 2, rows)), np.ones((K + 1, 2, rows)),
        np.zeros((K + 1, 3)), np.zeros((K + 1, 3)),
    )  # fmt: skip


@compiled
def solve(problem: Problem, z: Array, mu: float, least: float, most: int) -> int:
    """Optimise z (K + 1, 4) = v, a, τ, j in place; its first state and the problem's goal are kept.

    Returns the iterations taken, or −1 where it got stuck.
    """
    K, n = problem.ds.shape[0], problem.node.shape[1]
    rows = 3 * n
    at, trial = _iterate(K, rows), _iterate(K, rows)
    at.z[:] = z
    _begin(problem, at, mu)
    d, lam, slope = np.zeros((K + 1, 4)), np.zeros((K + 1, 3)), np.zeros((K + 1, rows))
    dslack, ddual, dbound = np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 3))
    models, law, cost = np.empty((K, 4, 5)), np.empty((K, 3)), np.empty((K + 1, 5))
    passed, count, delta_before = np.empty((2, most)), 0, 0.0
    for iteration in range(most):
        delta = 0.0
        while not _back(problem, at, mu, delta, models, law, cost):
            delta = max(4.0 * delta, delta_before / 3.0, 1e-6)
            if delta > 1e8:
                return -1
        delta_before = delta
        _forth(problem, at, models, law, cost, d, lam)
        _slopes(problem, at.z, d, slope)
        alpha, dual = _lengths(problem, at, mu, d, slope, dslack, ddual, dbound)
        passed[0, count], passed[1, count] = _merit(problem, mu, at.z, at.g, at.c, at.slack)
        count, off = count + 1, 0.0
        for _ in range(12):
            for k in range(K + 1):
                for i in range(4):
                    trial.z[k, i] = at.z[k, i] + alpha * d[k, i]
                for side in range(2):
                    for i in range(rows):
                        trial.slack[k, side, i] = at.slack[k, side, i] + alpha * dslack[k, side, i]
            values(problem, trial.z, trial.g, trial.c)
            objective, off = _merit(problem, mu, trial.z, trial.g, trial.c, trial.slack)
            if _better(passed, count, objective, off, 1e-6 * K):
                break
            alpha *= 0.5
        _take(at, trial, alpha, dual, lam, ddual, dbound)
        if alpha > 0.7 and dual > 0.7 and off <= 10.0 * mu * K:
            if mu <= least and off < 1e-6 * K and _gap(problem, at) < 3.0 * (6 * n + 3) * least * problem.tau.sum():
                z[:] = at.z
                return iteration + 1
            mu, count = max(least, min(0.2 * mu, mu**1.5)), 0
    return -1
