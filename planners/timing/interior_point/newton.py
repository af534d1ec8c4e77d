"""Newton step of the barrier problem, with or without coefficients of a free path: linear-quadratic over stages.

The backward sweep computes the cost to go (Riccati); the sign of every pivot shows whether the step is a descent direction. The
forward sweep computes the step, and the multipliers of the dynamics. The coefficients of a free path border the stages
(`planners.timing.interior_point.newton`); without them the argument is None, and Numba leaves these branches out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled, inlined
from optik.types import Array, Indices

# ---------------- coefficients p of a free path in the Newton step


FLAT_CURVATURE = 1e-12
"""Least curvature of the model in a coefficient: below it is rounding error."""


class Border(NamedTuple):
    """Derivatives in the coefficients p (P,), and the workspace of the sweeps; W is the width of the window.

    columns (K + 1, m + 2 e, W) are the derivatives of the limited values of each stage, cross (K, 5, W) those of their sum
    weighted by multipliers in p and v, a, j, v⁺, a⁺; the squares of bends (K + 1, r, W) are curvature in p alone; begin (K +
    1,) is the window's first coefficient, stay (K + 1,) the first one that is eliminated at the stage; own (P, D) are the
    Hessian and pull (P,) the gradient of the coefficients' own limits, D adjacent ones together; d (P,) is the step. The
    other fields are workspace.
    """

    columns: Array
    cross: Array
    bends: Array
    begin: Indices
    stay: Indices
    own: Array
    pull: Array
    d: Array
    mixed: Array  # (6, W) over v, a, τ, j, v⁺, a⁺ and the window
    square: Array  # (W, W) Π, lower half
    slope: Array  # (W,)
    law: Array  # (K, W) feedback of the free one of τ and j
    pivots: Array  # (K, W) row of the model for the other one
    mixed_cost: Array  # (K + 1, 2, W) S
    gains: Array  # (P, 3 + W) feedback of each coefficient


def make_border(columns: Array, cross: Array, bends: Array, begin: Indices, stay: Indices, own: Array) -> Border:
    """Return a border with its workspace."""
    K, W, P = len(begin) - 1, columns.shape[2], len(own)
    return Border(
        columns, cross, bends, begin, stay, own, np.zeros(P), np.zeros(P), np.zeros((6, W)), np.zeros((W, W)), np.zeros(W),
        np.zeros((K, W)), np.zeros((K, W)), np.zeros((K + 1, 2, W)), np.zeros((P, 3 + W)),
    )  # fmt: skip


@inlined
def clear(border: Border, K: int) -> None:
    """Begin the backward sweep."""
    border.square[:] = 0.0
    border.slope[:] = 0.0
    border.mixed_cost[K] = 0.0


@inlined
def add_to_border(border: Border, column: Array, weight: float, pull: float) -> None:
    """Add weight · ∇c ∇cᵀ and pull · ∇c of a limited value to the model of the coefficients."""
    square, slope = border.square, border.slope
    for i in range(column.shape[0]):
        if column[i] != 0.0:
            slope[i] += pull * column[i]
            x = weight * column[i]
            for j in range(i + 1):
                square[i, j] += x * column[j]


@inlined
def mix(border: Border, column: Array, x: tuple[float, float, float, float, float]) -> None:
    """Add the products of a value's derivatives in the coefficients and in v, a, j, v⁺ and a⁺, which are weighted already."""
    mixed = border.mixed
    for i in range(column.shape[0]):
        y = column[i]
        mixed[0, i] += x[0] * y
        mixed[1, i] += x[1] * y
        mixed[3, i] += x[2] * y
        mixed[4, i] += x[3] * y
        mixed[5, i] += x[4] * y


@compiled
def shift(k: int, border: Border) -> None:
    """Move the model from the window of stage k + 1 to that of stage k."""
    square, slope, offset = border.square, border.slope, border.begin[k + 1] - border.begin[k]
    if offset == 0:
        return
    for i in range(slope.shape[0] - 1, -1, -1):
        slope[i] = slope[i - offset] if i >= offset else 0.0
        for j in range(i, -1, -1):
            square[i, j] = square[i - offset, j - offset] if j >= offset else 0.0


@compiled
def fold(k: int, z: Array, g: Array, row: Array, pivot: int, border: Border) -> None:
    """Eliminate v⁺ and a⁺ from the mixed part by the dynamics, and one of τ and j by s⁺; rows 0, 1 and 2 remain."""
    mixed, slope, after = border.mixed, border.slope, border.mixed_cost[k + 1]
    a, tau, j = z[1], z[2], z[3]
    offset, free, fixed = border.begin[k + 1] - border.begin[k], 5 - pivot, -g[0] / row[pivot]
    for i in range(slope.shape[0]):
        x, y = mixed[4, i], mixed[5, i]
        if i >= offset:
            x += after[0, i - offset]
            y += after[1, i - offset]
        slope[i] += x * g[1] + y * g[2]
        mixed[0, i] += x
        mixed[1, i] += tau * x + y
        mixed[2, i] += (a + j * tau) * x + j * y
        mixed[3, i] += 0.5 * tau * tau * x + tau * y
        p = mixed[pivot, i]
        border.pivots[k, i] = p
        slope[i] += fixed * p
        mixed[0, i] -= row[0] / row[pivot] * p
        mixed[1, i] -= row[1] / row[pivot] * p
        mixed[2, i] = mixed[free, i] - row[free] / row[pivot] * p


@compiled
def eliminate(k: int, R: Array, r: float, delta: float, cost: Array, border: Border) -> bool:
    """Eliminate the free control of stage k, then the coefficients that occur in no earlier stage.

    R (3, 3) is the model over v, a and the control, r its slope in the control, cost (5,) the cost to go, which is updated.
    """
    mixed, square, slope, begin = border.mixed, border.square, border.slope, border.begin[k]
    S, W, D = border.mixed_cost[k], border.slope.shape[0], border.own.shape[1]
    for i in range(W):
        x = -mixed[2, i] / R[2, 2]
        border.law[k, i] = x
        S[0, i], S[1, i] = mixed[0, i] + R[0, 2] * x, mixed[1, i] + R[1, 2] * x
        slope[i] += x * r
        for j in range(i + 1):
            square[i, j] += x * mixed[2, j]
    for c in range(border.stay[k], border.stay[k + 1]):
        i, group = c - begin, c - c % D
        slope[i] += border.pull[c]
        square[i, i] += delta
        for j in range(c % D + 1):
            square[i, group + j - begin] += border.own[c, j]
    for c in range(border.stay[k + 1] - 1, border.stay[k] - 1, -1):
        i, gain = c - begin, border.gains[c]
        if not square[i, i] > FLAT_CURVATURE:
            return False
        gain[0], gain[1], gain[2] = -S[0, i] / square[i, i], -S[1, i] / square[i, i], -slope[i] / square[i, i]
        cost[0] += gain[0] * S[0, i]
        cost[1] += gain[0] * S[1, i]
        cost[2] += gain[1] * S[1, i]
        cost[3] += gain[0] * slope[i]
        cost[4] += gain[1] * slope[i]
        for j in range(i):
            x = -square[i, j] / square[i, i]
            gain[3 + j] = x
            S[0, j] += x * S[0, i]
            S[1, j] += x * S[1, i]
            slope[j] += x * slope[i]
            for h in range(j + 1):
                square[j, h] += x * square[i, h]
        S[0, i], S[1, i], slope[i] = 0.0, 0.0, 0.0
        for j in range(i + 1):
            square[i, j] = 0.0
    return True


@compiled
def step_coefficients(k: int, x: float, y: float, border: Border) -> None:
    """Compute the step of the coefficients that stage k eliminated, from that of v, a and of the earlier coefficients."""
    begin = border.begin[k]
    for c in range(border.stay[k], border.stay[k + 1]):
        gain = border.gains[c]
        d = gain[0] * x + gain[1] * y + gain[2]
        for j in range(c - begin):
            d += gain[3 + j] * border.d[begin + j]
        border.d[c] = d


@inlined
def product(border: Border, row: Array, k: int) -> float:
    """Return the product of a row over the window of stage k with the step."""
    begin, total = border.begin[k], 0.0
    for i in range(min(row.shape[0], border.d.shape[0] - begin)):
        total += row[i] * border.d[begin + i]
    return total


# ---------------- newton step of the barrier problem


TERMINAL = 1e4
"""Weight of the state at the end in the sweep, in the units of the last interval; its multiplier removes the remaining error.

Rounding in the backward sweep is relative to this: far larger weights make the pivots meaningless."""
PIVOT = 1e-8
"""Least curvature of the model in a stage's free variable, in the stage's units: below it is rounding error."""


class Problem(NamedTuple):
    """Data of the problem, in units near 1; K intervals, m limits at grid points, e limits in intervals.

    ds (K,) lengths of the intervals, tau (K,) about their durations, 1 in the mean, least (K,) their least ones (above 0, so
    that time does not run backwards on the way to the solution), top (K + 1,) greatest speeds, node (K + 1, m, 4) the
    coefficients of a, v², v and 1 of what is limited at places (q'/A, q''/A, 0 and 0 for an acceleration), edge (K, 2, e, 6)
    those of j, v a, v³, v, a and v² at both ends of each interval (q'/J, 3 q''/J, q'''/J, 0, 0 and 0 for a jerk), goal (2,) v
    and a at the end. Every such value is limited to [−1, 1].

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
    """State of the iteration.

    z (K + 1, 4) holds v, a, τ, j; g (K, 3) what the dynamics leave, c (K + 1, m + 2 e) the limited values, each in [−1, 1]
    at the end: m at the place, e at the interval's start, e at its end. slack and dual (K + 1, 2, m + 2 e)
    belong to c ≤ 1 and −c ≤ 1, bound (K + 1, 3) to v ≥ 0, v ≤ top and τ ≥ its least, lam (K + 1, 3) to the dynamics.
    """

    z: Array
    g: Array
    c: Array
    slack: Array
    dual: Array
    bound: Array
    lam: Array


@inlined
def active_range(k: int, problem: Problem, border: Border | None) -> tuple[int, int]:
    """Return the range of the active limits of a stage: at the first and the last state, which are given, only those of p."""
    m, K = problem.node.shape[1], problem.ds.shape[0]
    if border is None:
        return (m if k == 0 else 0), (m + 2 * problem.edge.shape[2] if k < K else 0)
    return 0, (m + 2 * problem.edge.shape[2] if k < K else m)


@inlined
def edge_slope(edge: Array, k: int, end: int, i: int, v: float, a: float) -> tuple[float, float]:
    """Return the derivatives of a row with jerk over v and a.

    Shapes and units: edge (K, 2, e, 6) [as the problem], v, a [as the problem].
    """
    q, u, y = edge[k, end, i, 1], edge[k, end, i, 2], edge[k, end, i, 5]
    return q * a + (3.0 * u * v + 2.0 * y) * v + edge[k, end, i, 3], q * v + edge[k, end, i, 4]


@inlined
def pull_of(at: Iterate, k: int, i: int, mu: float) -> tuple[float, float, float]:
    """Return the weight of ∇c ∇cᵀ and the pull along ∇c in the model for both sides of a limit, and the multiplier of c."""
    above, below = 1.0 / at.slack[k, 0, i], 1.0 / at.slack[k, 1, i]
    up, down, c = at.dual[k, 0, i], at.dual[k, 1, i], at.c[k, i]
    higher = (mu + up * (c - 1.0)) * above + up
    lower = (mu - down * (c + 1.0)) * below + down
    return up * above + down * below, higher - lower, up - down


@inlined
def _stage(k: int, problem: Problem, at: Iterate, mu: float, delta: float, M: Array, m: Array) -> None:
    """Compute the quadratic barrier model on interval k, over (v, a, τ, j, v⁺, a⁺): M (6, 6), upper half, m (6,)."""
    z, lam, node, edge = at.z, at.lam, problem.node, problem.edge
    n, e = node.shape[1], edge.shape[2]
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
            weight, pull, y = pull_of(at, k, i, mu)
            p, q = node[k, i, 0], node[k, i, 1]
            x = 2.0 * q * v + node[k, i, 2]
            m0, m1 = m0 + pull * x, m1 + pull * p
            M00, M01, M11 = M00 + weight * x * x + 2.0 * q * y, M01 + weight * x * p, M11 + weight * p * p
    for i in range(e):
        weight, pull, y = pull_of(at, k, n + i, mu)
        p, q, u = edge[k, 0, i, 0], edge[k, 0, i, 1], 6.0 * edge[k, 0, i, 2] * v + 2.0 * edge[k, 0, i, 5]
        x, r = edge_slope(edge, k, 0, i, v, a)
        m0, m1, m3 = m0 + pull * x, m1 + pull * r, m3 + pull * p
        M00, M01, M11 = M00 + weight * x * x + u * y, M01 + weight * x * r + q * y, M11 + weight * r * r
        M03, M13, M33 = M03 + weight * x * p, M13 + weight * r * p, M33 + weight * p * p
        weight, pull, y = pull_of(at, k, n + e + i, mu)
        p, q, u = edge[k, 1, i, 0], edge[k, 1, i, 1], 6.0 * edge[k, 1, i, 2] * w + 2.0 * edge[k, 1, i, 5]
        x, r = edge_slope(edge, k, 1, i, w, b)
        m3, m4, m5 = m3 + pull * p, m4 + pull * x, m5 + pull * r
        M33, M34, M35 = M33 + weight * p * p, M34 + weight * p * x, M35 + weight * p * r
        M44, M45, M55 = M44 + weight * x * x + u * y, M45 + weight * x * r + q * y, M55 + weight * r * r
    m[0], m[1], m[2], m[3], m[4], m[5] = m0, m1, 1.0 - mu * spare, m3, m4, m5
    M[0, 0], M[0, 1], M[0, 3], M[1, 1], M[1, 3], M[3, 3] = M00, M01, M03, M11, M13, M33
    M[3, 4], M[3, 5], M[4, 4], M[4, 5], M[5, 5] = M34, M35, M44, M45, M55
    M[0, 2] = lam[k, 0]
    M[1, 2] = lam[k, 0] * tau + lam[k, 1]
    M[2, 2] = delta / problem.tau[k] ** 2 + at.bound[k, 2] * spare + lam[k, 0] * (a + j * tau) + lam[k, 1] * j
    M[2, 3] = lam[k, 0] * 0.5 * tau * tau + lam[k, 1] * tau + lam[k, 2]


@inlined
def _fold(z: Array, g: Array, M: Array, m: Array, Q: Array, q: Array) -> None:
    """Eliminate v⁺ and a⁺ from a stage's model by the dynamics: M (6, 6), upper half, and m become Q (4, 4) and q (4,).

    Of v, a, τ and j, only the jerk occurs in limits together with v⁺ and a⁺.
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
    """Compute the gradient (4,) of s⁺ over (v, a, τ, j); return which of τ and j it determines."""
    v, a, tau, j = z[0], z[1], z[2], z[3]
    row[0], row[1] = tau, 0.5 * tau * tau
    row[2], row[3] = v + tau * (a + 0.5 * tau * j), tau * tau * tau / 6.0
    return 2 if abs(row[2]) >= abs(row[3]) else 3


@compiled
def back(
    problem: Problem, at: Iterate, mu: float, delta: float, models: Array, law: Array, cost: Array, border: Border | None
) -> bool:  # fmt: skip
    """Sweep from the end: compute the model over (v, a, τ, j), the feedback and the cost to go of every stage.

    Shapes and units: models (K, 4, 5) [as the problem], law (K, 3) [as the problem], cost (K + 1, 5) [as the problem].
    """
    z, K = at.z, problem.ds.shape[0]
    M, m, row = np.empty((6, 6)), np.empty(6), np.empty(4)
    Q, q, R, r, N = np.empty((4, 4)), np.empty(4), np.empty((3, 3)), np.empty(3), np.empty(3)
    tau, ds = problem.tau[K - 1], problem.ds[K - 1]
    cost[K, 0], cost[K, 1], cost[K, 2] = TERMINAL * tau * (tau / ds) ** 2, 0.0, TERMINAL * tau * (tau**2 / ds) ** 2
    for i in range(2):
        cost[K, 3 + i] = cost[K, 2 * i] * (z[K, i] - problem.goal[i]) + at.lam[K, 1 + i]
    if border is not None:
        _end(problem, at, mu, border)
    for k in range(K - 1, -1, -1):
        _stage(k, problem, at, mu, delta, M, m)
        if border is not None:
            _border_stage(k, problem, at, mu, border)
        M[4, 4] += cost[k + 1, 0]
        M[4, 5] += cost[k + 1, 1]
        M[5, 5] += cost[k + 1, 2]
        m[4] += cost[k + 1, 3]
        m[5] += cost[k + 1, 4]
        _fold(z[k], at.g[k], M, m, Q, q)
        pivot = _place_row(z[k], row)  # s⁺ is fixed: one of τ and j follows from the others
        free = 5 - pivot
        if border is not None:
            fold(k, z[k], at.g[k], row, pivot, border)
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
        if border is not None and not eliminate(k, R, r[2], delta, cost[k], border):
            return False
    return True


@compiled
def _end(problem: Problem, at: Iterate, mu: float, border: Border) -> None:
    """Compute the model of the coefficients at the last grid point: limits that depend on the path alone."""
    K, m = problem.ds.shape[0], problem.node.shape[1]
    clear(border, at.z.shape[0] - 1)
    for i in range(m):
        weight, pull, _y = pull_of(at, K, i, mu * problem.tau[K - 1])
        add_to_border(border, border.columns[K, i], weight, pull)


@compiled
def _border_stage(k: int, problem: Problem, at: Iterate, mu: float, border: Border) -> None:
    """Add the limits of interval k to the model of the coefficients, alone and with (v, a, τ, j, v⁺, a⁺)."""
    z, node, edge, columns = at.z, problem.node, problem.edge, border.columns
    n, e = node.shape[1], edge.shape[2]
    v, a, w, b = z[k, 0], z[k, 1], z[k + 1, 0], z[k + 1, 1]
    mu *= problem.tau[k]
    shift(k, border)
    mixed = border.mixed
    for i in range(mixed.shape[1]):
        mixed[0, i], mixed[1, i], mixed[3, i] = border.cross[k, 0, i], border.cross[k, 1, i], border.cross[k, 2, i]
        mixed[2, i], mixed[4, i], mixed[5, i] = 0.0, border.cross[k, 3, i], border.cross[k, 4, i]
    for i in range(border.bends.shape[1]):
        add_to_border(border, border.bends[k, i], 1.0, 0.0)
    for i in range(n):
        weight, pull, _y = pull_of(at, k, i, mu)
        add_to_border(border, columns[k, i], weight, pull)
        if k > 0:
            x = 2.0 * node[k, i, 1] * v + node[k, i, 2]
            mix(border, columns[k, i], (weight * x, weight * node[k, i, 0], 0.0, 0.0, 0.0))
    for i in range(e):
        for end in range(2):
            at_row = n + end * e + i
            weight, pull, _y = pull_of(at, k, at_row, mu)
            add_to_border(border, columns[k, at_row], weight, pull)
            p = weight * edge[k, end, i, 0]
            x, r = edge_slope(edge, k, end, i, w if end else v, b if end else a)
            if end:
                mix(border, columns[k, at_row], (0.0, 0.0, p, weight * x, weight * r))
            else:
                mix(border, columns[k, at_row], (weight * x, weight * r, p, 0.0, 0.0))


@compiled
def forth(
    problem: Problem, at: Iterate, models: Array, law: Array, cost: Array, d: Array, lam: Array, border: Border | None
) -> None:  # fmt: skip
    """Sweep from the start: compute the step and the new multipliers of the dynamics.

    Shapes and units: models, law, cost (K, 4, 5) [as the problem], d (K + 1, 4) [as the problem], lam (K + 1, 3)
    [as the problem].
    """
    z, g, K = at.z, at.g, problem.ds.shape[0]
    row = np.empty(4)
    d[0, 0] = d[0, 1] = d[K, 2] = d[K, 3] = 0.0
    for k in range(K):
        x, y = d[k, 0], d[k, 1]
        pivot = _place_row(z[k], row)
        free = 5 - pivot
        d[k, free] = law[k, 0] * x + law[k, 1] * y + law[k, 2]
        if border is not None:
            step_coefficients(k, x, y, border)
            d[k, free] += product(border, border.law[k], k)
        fixed = -g[k, 0] / row[pivot]
        d[k, pivot] = fixed - (row[0] * x + row[1] * y + row[free] * d[k, free]) / row[pivot]
        slope = models[k, pivot, 4]  # it holds the constant part already
        for i in range(4):
            slope += models[k, pivot, i] * (d[k, i] - (fixed if i == pivot else 0.0))
        if border is not None:
            slope += product(border, border.pivots[k], k)
        lam[k, 0] = -slope / row[pivot]
        a, tau, j = z[k, 1], z[k, 2], z[k, 3]
        v_next = x + tau * y + (a + j * tau) * d[k, 2] + 0.5 * tau * tau * d[k, 3] + g[k, 1]
        a_next = y + j * d[k, 2] + tau * d[k, 3] + g[k, 2]
        d[k + 1, 0], d[k + 1, 1] = v_next, a_next
        lam[k, 1] = cost[k + 1, 3] + cost[k + 1, 0] * v_next + cost[k + 1, 1] * a_next
        lam[k, 2] = cost[k + 1, 4] + cost[k + 1, 1] * v_next + cost[k + 1, 2] * a_next
        if border is not None:
            lam[k, 1] += product(border, border.mixed_cost[k + 1, 0], k + 1)
            lam[k, 2] += product(border, border.mixed_cost[k + 1, 1], k + 1)
    lam[K, 0], lam[K, 1], lam[K, 2] = 0.0, lam[K - 1, 1], lam[K - 1, 2]
