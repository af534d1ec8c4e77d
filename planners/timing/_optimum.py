"""Interior-point iteration for the jerk-limited time optimum along a path: one small stage an interval, compiled.

Places s_k are fixed; unknown are ṡ = v and s̈ = a at them, and the duration τ and the jerk j of every interval:

    min Σ τ_k   with   v τ + a τ²/2 + j τ³/6 = Δs,   v + a τ + j τ²/2 = v⁺,   a + j τ = a⁺,
    |q' v| ≤ V,   |q' a + q'' v²| ≤ A,   |q' j + 3 q'' v a + q''' v³| ≤ J at both ends of every interval.

All of it is polynomial, and nothing is singular at standstill. A Newton step of the barrier problem is a linear-quadratic
problem over the stages, solved by one sweep back and one forth (Riccati), in which the sign of every pivot shows
whether the step goes down.
"""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from optik._compile import compiled

Array = NDArray[np.float64]

TERMINAL = 1e8
"""Weight of the state at the end in the sweep; its multiplier takes up what the weight leaves."""


@compiled
def values(z: Array, ds: Array, node: Array, edge: Array, g: Array, c: Array) -> None:
    """Residuals of the dynamics g (K, 3) and values of the limits c (K + 1, rows), each of which must be ≤ 1 and ≥ −1.

    z (K + 1, 4) holds v, a, τ, j; node (K + 1, n, 2) q'/A, q''/A; edge (K, 2, n, 3) q'/J, 3 q''/J, q'''/J at both
    ends of each interval. Row layout of c: n accelerations at the node, n jerks at the interval's start, n at its end.
    """
    K, n = ds.shape[0], node.shape[1]
    for k in range(K + 1):
        v, a, tau, j = z[k, 0], z[k, 1], z[k, 2], z[k, 3]
        for i in range(n):
            c[k, i] = node[k, i, 0] * a + node[k, i, 1] * v * v
        if k == K:
            break
        g[k, 0] = tau * (v + tau * (0.5 * a + tau * j / 6.0)) - ds[k]
        g[k, 1] = v + tau * (a + 0.5 * tau * j) - z[k + 1, 0]
        g[k, 2] = a + tau * j - z[k + 1, 1]
        w, b = z[k + 1, 0], z[k + 1, 1]
        for i in range(n):
            c[k, n + i] = edge[k, 0, i, 0] * j + edge[k, 0, i, 1] * v * a + edge[k, 0, i, 2] * v * v * v
            c[k, 2 * n + i] = edge[k, 1, i, 0] * j + edge[k, 1, i, 1] * w * b + edge[k, 1, i, 2] * w * w * w


@compiled
def _row(M: Array, m: Array, i: int, x: float, j: int, y: float, k: int, w: float, weight: float, pull: float) -> None:
    """Add weight · ∇c ∇cᵀ and pull · ∇c of a limit with gradient x, y, w at places i, j, k of the stage."""
    m[i] += pull * x
    m[j] += pull * y
    m[k] += pull * w
    M[i, i] += weight * x * x
    M[i, j] += weight * x * y
    M[i, k] += weight * x * w
    M[j, j] += weight * y * y
    M[j, k] += weight * y * w
    M[k, k] += weight * w * w


@compiled
def _stage(
    k: int, z: Array, top: Array, low: float, node: Array, edge: Array, c: Array, slack: Array, dual: Array,
    bound: Array, lam: Array, mu: float, delta: float, M: Array, m: Array,
) -> None:  # fmt: skip
    """Quadratic model of the barrier problem on interval k, over (v, a, τ, j, v⁺, a⁺): upper half of M (6, 6), and m (6,)."""
    n = node.shape[1]
    v, a, tau, j = z[k, 0], z[k, 1], z[k, 2], z[k, 3]
    w, b = z[k + 1, 0], z[k + 1, 1]
    for r in range(6):
        m[r] = 0.0
        for q in range(6):
            M[r, q] = 0.0
    m[2] = 1.0 - mu / (tau - low)
    M[2, 2] = bound[k, 2] / (tau - low)
    for r in range(4):
        M[r, r] += delta
    # curvature of the dynamics
    M[0, 2] += lam[k, 0]
    M[1, 2] += lam[k, 0] * tau + lam[k, 1]
    M[2, 2] += lam[k, 0] * (a + j * tau) + lam[k, 1] * j
    M[2, 3] += lam[k, 0] * 0.5 * tau * tau + lam[k, 1] * tau + lam[k, 2]
    if k > 0:
        m[0] += mu / (top[k] - v) - mu / v
        M[0, 0] += bound[k, 0] / v + bound[k, 1] / (top[k] - v)
    for i in range(3 * n):
        if k == 0 and i < n:
            continue  # the state at the start is given
        tp, tm, zp, zm = slack[k, 0, i], slack[k, 1, i], dual[k, 0, i], dual[k, 1, i]
        rp, rm = c[k, i] + tp - 1.0, -c[k, i] + tm - 1.0
        weight = zp / tp + zm / tm
        pull = (mu + zp * rp) / tp - (mu + zm * rm) / tm
        y = zp - zm
        if i < n:
            p, q = node[k, i, 0], node[k, i, 1]
            _row(M, m, 0, 2.0 * q * v, 1, p, 2, 0.0, weight, pull)
            M[0, 0] += 2.0 * q * y
        elif i < 2 * n:
            p, q, r3 = edge[k, 0, i - n, 0], edge[k, 0, i - n, 1], edge[k, 0, i - n, 2]
            _row(M, m, 0, q * a + 3.0 * r3 * v * v, 1, q * v, 3, p, weight, pull)
            M[0, 0] += 6.0 * r3 * v * y
            M[0, 1] += q * y
        else:
            p, q, r3 = edge[k, 1, i - 2 * n, 0], edge[k, 1, i - 2 * n, 1], edge[k, 1, i - 2 * n, 2]
            _row(M, m, 3, p, 4, q * b + 3.0 * r3 * w * w, 5, q * w, weight, pull)
            M[4, 4] += 6.0 * r3 * w * y
            M[4, 5] += q * y


@compiled
def _sweep(
    z: Array, goal: Array, ds: Array, top: Array, low: float, node: Array, edge: Array, g: Array, c: Array, slack: Array,
    dual: Array, bound: Array, lam: Array, mu: float, delta: float, d: Array, new: Array, store: Array,
) -> bool:  # fmt: skip
    """Newton step d (K + 1, 4) and the dynamics' new multipliers (K + 1, 3); False where a pivot is not positive."""
    K = ds.shape[0]
    M, m = np.empty((6, 6)), np.empty(6)
    Q, q = np.empty((4, 4)), np.empty(4)
    B = np.zeros((6, 4))
    N, R, r = np.zeros((4, 3)), np.empty((3, 3)), np.empty(3)
    P00, P01, P11 = TERMINAL, 0.0, TERMINAL
    p0 = TERMINAL * (z[K, 0] - goal[0]) + lam[K, 1]
    p1 = TERMINAL * (z[K, 1] - goal[1]) + lam[K, 2]
    t0 = np.empty((6, 4))
    for k in range(K - 1, -1, -1):
        _stage(k, z, top, low, node, edge, c, slack, dual, bound, lam, mu, delta, M, m)
        M[4, 4] += P00
        M[4, 5] += P01
        M[5, 5] += P11
        m[4] += p0
        m[5] += p1
        for i in range(6):
            for j in range(i):
                M[i, j] = M[j, i]
        v, a, tau, jerk = z[k, 0], z[k, 1], z[k, 2], z[k, 3]
        # (v, a, τ, j) -> (v, a, τ, j, v⁺, a⁺)
        for i in range(4):
            B[i, i] = 1.0
        B[4, 0], B[4, 1], B[4, 2], B[4, 3] = 1.0, tau, a + jerk * tau, 0.5 * tau * tau
        B[5, 0], B[5, 1], B[5, 2], B[5, 3] = 0.0, 1.0, jerk, tau
        for i in range(6):
            m[i] += M[i, 4] * g[k, 1] + M[i, 5] * g[k, 2]
        for i in range(6):
            for j in range(4):
                t0[i, j] = M[i, j] + M[i, 4] * B[4, j] + M[i, 5] * B[5, j]
        for i in range(4):
            q[i] = m[i] + B[4, i] * m[4] + B[5, i] * m[5]
            for j in range(4):
                Q[i, j] = t0[i, j] + B[4, i] * t0[4, j] + B[5, i] * t0[5, j]
        # the place s⁺ is fixed: one of τ and j follows from the other
        e0, e1, e2, e3 = tau, 0.5 * tau * tau, v + tau * (a + 0.5 * tau * jerk), tau * tau * tau / 6.0
        by_tau = abs(e2) >= abs(e3)
        pivot, free = (2, 3) if by_tau else (3, 2)
        ep, ef = (e2, e3) if by_tau else (e3, e2)
        n0 = -g[k, 0] / ep
        for i in range(4):
            for j in range(3):
                N[i, j] = 0.0
        N[0, 0] = N[1, 1] = N[free, 2] = 1.0
        N[pivot, 0], N[pivot, 1], N[pivot, 2] = -e0 / ep, -e1 / ep, -ef / ep
        for i in range(4):
            q[i] += Q[i, pivot] * n0
            for j in range(4):
                store[k, i, j] = Q[i, j]
            store[k, i, 4] = q[i]
        for i in range(3):
            f = 2 if i == 2 else i
            o = free if i == 2 else i
            r[f] = q[o] + N[pivot, i] * q[pivot]
            for j in range(3):
                h = free if j == 2 else j
                R[i, j] = (
                    Q[o, h]
                    + N[pivot, i] * Q[pivot, h]
                    + Q[o, pivot] * N[pivot, j]
                    + N[pivot, i] * Q[pivot, pivot] * N[pivot, j]
                )
        if not R[2, 2] > 1e-10:
            return False
        f0, f1, fr = -R[2, 0] / R[2, 2], -R[2, 1] / R[2, 2], -r[2] / R[2, 2]
        store[k, 0, 5], store[k, 1, 5], store[k, 2, 5] = f0, f1, fr
        P00, P01, P11 = R[0, 0] + R[0, 2] * f0, R[0, 1] + R[0, 2] * f1, R[1, 1] + R[1, 2] * f1
        p0, p1 = r[0] + R[0, 2] * fr, r[1] + R[1, 2] * fr
        store[k, 0, 6], store[k, 1, 6], store[k, 2, 6], store[k, 3, 6], store[k, 3, 5] = P00, P01, P11, p0, p1
    d[0, 0] = d[0, 1] = 0.0
    for k in range(K):
        tau, a, jerk, v = z[k, 2], z[k, 1], z[k, 3], z[k, 0]
        e0, e1, e2, e3 = tau, 0.5 * tau * tau, v + tau * (a + 0.5 * tau * jerk), tau * tau * tau / 6.0
        x0, x1 = d[k, 0], d[k, 1]
        free = store[k, 0, 5] * x0 + store[k, 1, 5] * x1 + store[k, 2, 5]
        if abs(e2) >= abs(e3):
            d[k, 3] = free
            d[k, 2] = (-g[k, 0] - e0 * x0 - e1 * x1 - e3 * free) / e2
            pivot, ep = 2, e2
        else:
            d[k, 2] = free
            d[k, 3] = (-g[k, 0] - e0 * x0 - e1 * x1 - e2 * free) / e3
            pivot, ep = 3, e3
        # stationarity of the eliminated one gives the multiplier of its equation (its constant is in store[:, 4] already)
        n0 = -g[k, 0] / ep
        s = store[k, pivot, 4]
        for i in range(4):
            s += store[k, pivot, i] * (d[k, i] - (n0 if i == pivot else 0.0))
        new[k, 0] = -s / ep
        d[k + 1, 0] = x0 + tau * x1 + (a + jerk * tau) * d[k, 2] + 0.5 * tau * tau * d[k, 3] + g[k, 1]
        d[k + 1, 1] = x1 + jerk * d[k, 2] + tau * d[k, 3] + g[k, 2]
        if k + 1 < K:
            P00, P01, P11 = store[k + 1, 0, 6], store[k + 1, 1, 6], store[k + 1, 2, 6]
            p0, p1 = store[k + 1, 3, 6], store[k + 1, 3, 5]
        else:
            P00, P01, P11 = TERMINAL, 0.0, TERMINAL
            p0 = TERMINAL * (z[K, 0] - goal[0]) + lam[K, 1]
            p1 = TERMINAL * (z[K, 1] - goal[1]) + lam[K, 2]
        new[k, 1] = p0 + P00 * d[k + 1, 0] + P01 * d[k + 1, 1]
        new[k, 2] = p1 + P01 * d[k + 1, 0] + P11 * d[k + 1, 1]
    d[K, 2] = d[K, 3] = 0.0
    new[K, 0], new[K, 1], new[K, 2] = 0.0, new[K - 1, 1], new[K - 1, 2]
    return True


@compiled
def _slopes(z: Array, d: Array, node: Array, edge: Array, out: Array) -> None:
    """Change of every limit's value along d, to first order (K + 1, 3 n)."""
    K, n = edge.shape[0], node.shape[1]
    for k in range(K + 1):
        v, a = z[k, 0], z[k, 1]
        for i in range(n):
            out[k, i] = node[k, i, 0] * d[k, 1] + 2.0 * node[k, i, 1] * v * d[k, 0]
        if k == K:
            break
        w, b = z[k + 1, 0], z[k + 1, 1]
        for i in range(n):
            p, q, r = edge[k, 0, i, 0], edge[k, 0, i, 1], edge[k, 0, i, 2]
            out[k, n + i] = p * d[k, 3] + q * (v * d[k, 1] + a * d[k, 0]) + 3.0 * r * v * v * d[k, 0]
            p, q, r = edge[k, 1, i, 0], edge[k, 1, i, 1], edge[k, 1, i, 2]
            out[k, 2 * n + i] = p * d[k, 3] + q * (w * d[k + 1, 1] + b * d[k + 1, 0]) + 3.0 * r * w * w * d[k + 1, 0]


@compiled
def _merit(
    z: Array, top: Array, low: float, g: Array, c: Array, slack: Array, goal: Array, mu: float
) -> tuple[float, float]:
    """Barrier objective, and the sum of what the equations leave."""
    K, n = g.shape[0], slack.shape[2] // 3
    objective, off = 0.0, abs(z[K, 0] - goal[0]) + abs(z[K, 1] - goal[1])
    for k in range(K):
        objective += z[k, 2] - mu * log(z[k, 2] - low)
        off += abs(g[k, 0]) + abs(g[k, 1]) + abs(g[k, 2])
        if k > 0:
            objective -= mu * (log(z[k, 0]) + log(top[k] - z[k, 0]))
        product = 1.0  # one logarithm for several slacks
        for i in range(3 * n):
            if k == 0 and i < n:
                continue
            product *= slack[k, 0, i] * slack[k, 1, i]
            if product < 1e-150 or product > 1e150:
                objective -= mu * log(product)
                product = 1.0
            off += abs(c[k, i] + slack[k, 0, i] - 1.0) + abs(-c[k, i] + slack[k, 1, i] - 1.0)
        objective -= mu * log(product)
    return objective, off


@compiled
def solve(
    z: Array, goal: Array, ds: Array, top: Array, node: Array, edge: Array, mu: float, least: float, most: int
) -> int:  # fmt: skip
    """Optimise in place z (K + 1, 4) = v, a, τ, j, from a start inside the limits; iterations, or −1 where it got stuck.

    Places ds (K,) and speeds top (K + 1,) are in units in which τ ≈ 1; goal (2,) is v, a at the end; mu the first and
    least the last barrier weight.
    """
    K, n = ds.shape[0], node.shape[1]
    rows = 3 * n
    g, c = np.zeros((K, 3)), np.zeros((K + 1, rows))
    slack, dual = np.ones((K + 1, 2, rows)), np.ones((K + 1, 2, rows))
    bound = np.zeros((K + 1, 3))
    lam, new, d = np.zeros((K + 1, 3)), np.zeros((K + 1, 3)), np.zeros((K + 1, 4))
    store, slope = np.empty((K, 4, 7)), np.zeros((K + 1, rows))
    dslack, ddual, dbound = np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 3))
    zt, gt, ct, st = z.copy(), g.copy(), c.copy(), slack.copy()
    low = 0.02 * ds.sum() / K
    values(z, ds, node, edge, g, c)
    for k in range(K):
        for i in range(rows):
            slack[k, 0, i] = max(1.0 - c[k, i], 1e-2)
            slack[k, 1, i] = max(1.0 + c[k, i], 1e-2)
            for side in range(2):
                dual[k, side, i] = mu / slack[k, side, i]
        if k > 0:
            z[k, 0] = min(max(z[k, 0], 1e-3 * top[k]), 0.999 * top[k])
            bound[k, 0], bound[k, 1] = mu / z[k, 0], mu / (top[k] - z[k, 0])
        z[k, 2] = max(z[k, 2], 2.0 * low)
        bound[k, 2] = mu / (z[k, 2] - low)
    values(z, ds, node, edge, g, c)
    delta, last_delta = 0.0, 0.0
    for iteration in range(most):
        delta = 0.0
        while not _sweep(z, goal, ds, top, low, node, edge, g, c, slack, dual, bound, lam, mu, delta, d, new, store):
            delta = max(4.0 * delta, last_delta / 3.0, 1e-6)
            if delta > 1e8:
                return -1
        last_delta = delta
        _slopes(z, d, node, edge, slope)
        ap, ad = 1.0, 1.0
        keep = max(0.99, 1.0 - mu)
        for k in range(K):
            for i in range(rows):
                if k == 0 and i < n:
                    continue
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    t, y = slack[k, side, i], dual[k, side, i]
                    dt = 1.0 - sign * c[k, i] - t - sign * slope[k, i]
                    dy = (mu - y * dt) / t - y
                    dslack[k, side, i], ddual[k, side, i] = dt, dy
                    if dt < -keep * t * (1.0 / ap if ap > 0 else 1e300):
                        ap = -keep * t / dt
                    if dy < -keep * y / ad:
                        ad = -keep * y / dy
            if k > 0:
                x, y = z[k, 0], bound[k, 0]
                dbound[k, 0] = (mu - y * d[k, 0]) / x - y
                x2, y2 = top[k] - z[k, 0], bound[k, 1]
                dbound[k, 1] = (mu + y2 * d[k, 0]) / x2 - y2
                if d[k, 0] < -keep * x / ap:
                    ap = -keep * x / d[k, 0]
                if -d[k, 0] < -keep * x2 / ap:
                    ap = keep * x2 / d[k, 0]
            x, y = z[k, 2] - low, bound[k, 2]
            dbound[k, 2] = (mu - y * d[k, 2]) / x - y
            if d[k, 2] < -keep * x / ap:
                ap = -keep * x / d[k, 2]
            for i in range(3):
                if dbound[k, i] < -keep * bound[k, i] / ad:
                    ad = -keep * bound[k, i] / dbound[k, i]
        phi, off = _merit(z, top, low, g, c, slack, goal, mu)
        alpha = ap
        for _ in range(12):
            for k in range(K + 1):
                for i in range(4):
                    zt[k, i] = z[k, i] + alpha * d[k, i]
                for side in range(2):
                    for i in range(rows):
                        st[k, side, i] = slack[k, side, i] + alpha * dslack[k, side, i]
            values(zt, ds, node, edge, gt, ct)
            phi_t, off_t = _merit(zt, top, low, gt, ct, st, goal, mu)
            if (
                off_t <= (1.0 - 1e-4 * alpha) * off + 1e-11
                or phi_t < phi - 1e-4 * off
                or (off_t < 1e-6 * K and phi_t <= phi + 1e-9 * abs(phi))
            ):
                break
            alpha *= 0.5
        for k in range(K + 1):
            for i in range(4):
                z[k, i] = zt[k, i]
            for i in range(3):
                lam[k, i] += alpha * (new[k, i] - lam[k, i])
                bound[k, i] += ad * dbound[k, i]
            for i in range(rows):
                c[k, i] = ct[k, i]
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    slack[k, side, i] = max(st[k, side, i], 1.0 - sign * ct[k, i])
                    dual[k, side, i] += ad * ddual[k, side, i]
        for k in range(K):
            for i in range(3):
                g[k, i] = gt[k, i]
        if alpha > 0.7 and ad > 0.7 and off_t <= 10.0 * mu * K:
            if mu <= least and off_t < 1e-8 * K:
                return iteration + 1
            mu = max(least, min(0.2 * mu, mu**1.5))
    return -1
