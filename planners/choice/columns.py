"""Derivatives of the constraint values in a path's coefficients, from those in q, …, q''' at each grid point; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik import newton
from optik.compiled import compiled, inlined
from optik.kinematics import Chain, axis_of, tool_pose
from optik.linear import qr_factor, qr_solve
from optik.types import Array, Flags, Indices
from planners.choice.torques import move
from planners.paths.screws import CHOOSE, cross

TRACE_STEPS = 8
"""Most Newton steps from the configurations of the last coefficients to those of a trial step."""
TRACED = 1e-10
"""Largest remaining error of a configuration [m, rad]: a step of the coefficients that leaves more is halved."""


@compiled
def trace_path(chain: Chain, poses: Array, twists: Array, rows: Array, values: Array, q: Array) -> bool:
    """Move configurations and their derivatives q (k, 4, n), in place, onto a path; return whether all of them meet it.

    Shapes and units: poses (k, 4, 4), twists (k, 3, 6), rows (k, 4, r, n), values (k, 4, r) of the null-space coordinates.
    """
    for k in range(q.shape[0]):
        error, rank = newton.polish(chain, poses[k], rows[k, 0], values[k, 0], TRACE_STEPS, q[k, 0])
        if not error <= TRACED or rank == 0.0:
            return False
        rank, _singular = newton.derivatives_at(chain, q[k, 0], twists[k], rows[k], values[k], q[k, 1:], 0.0)
        if rank == 0.0:
            return False
    return True


@compiled
def joint_changes(chain: Chain, rows: Array, fields: Array, path: Array, h: Array) -> None:
    """Write the joints' motion h (k, 4, D, n) per unit of each coordinate, and its derivatives along the path.

    With screws S, fields E of the tool's coordinates and constant rows N of null-space ones, S h = E and N h = 0 for the tool's
    coordinates, S h = 0 and N h = 1 for those of the null space. The derivatives follow by the product rule.

    Shapes and units: rows (r, n), fields (k, d, 4, 6), D = d + r, path (4, k, n).
    """
    n, r, d, N = path.shape[2], rows.shape[0], fields.shape[1], chain[0].shape[0]
    T, S, V = np.empty((N, 4, 4)), np.empty((N, 4, 6)), np.empty((N, 3, 6))
    A, beta, order, b = np.empty((6 + r, n)), np.empty(n), np.empty(n, np.int64), np.empty(6 + r)
    for k in range(path.shape[1]):
        move(chain, path, k, T, S, V)
        A[:] = 0.0
        for i in range(N):
            at, factor = axis_of(chain, i)
            for x in range(6):
                A[x, at] += factor * S[i, 0, x]
        for i in range(n):
            for x in range(r):
                A[6 + x, i] = rows[x, i]
        qr_factor(A, beta, order)
        for c in range(d + r):
            for m in range(4):
                for x in range(6):
                    b[x] = fields[k, c, m, x] if c < d else 0.0
                    for i in range(1, m + 1):
                        for j in range(N):
                            at, factor = axis_of(chain, j)
                            b[x] -= CHOOSE[m, i] * S[j, i, x] * (factor * h[k, m - i, c, at])
                for x in range(r):
                    b[6 + x] = 1.0 if m == 0 and c == d + x else 0.0
                qr_solve(A, beta, order, b, h[k, m, c])


@compiled
def tool_changes(chain: Chain, path: Array, twist: Array, change: Array) -> None:
    """Write the tool's twist per unit of s (k, 6), (v, ω), and its derivatives (k, 6, n, 2) in q and q'."""
    n = chain[0].shape[0]
    T, S, V, E = np.empty((n, 4, 4)), np.empty((n, 4, 6)), np.empty((n, 3, 6)), np.empty(6)
    change[:] = 0.0
    tool, p, ahead = np.empty((4, 4)), np.empty(3), np.empty(6)
    for k in range(path.shape[1]):
        move(chain, path, k, T, S, V)
        tool_pose(chain, T, tool)
        w = V[n - 1, 0]
        for x in range(3):
            p[x] = tool[x, 3]
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            twist[k, 3 + x] = w[x]
            twist[k, x] = w[3 + x] + w[y] * p[z] - w[z] * p[y]
        for j in range(n):
            s, (at, factor) = S[j, 0], axis_of(chain, j)
            for x in range(6):
                ahead[x] = w[x] - V[j, 0, x]
            for order in range(2):
                E[:] = 0.0
                if order == 0:
                    cross(s, ahead, 1.0, E)
                else:
                    E[:] = s
                for x in range(3):
                    y, z = (x + 1) % 3, (x + 2) % 3
                    change[k, 3 + x, at, order] += factor * E[x]
                    change[k, x, at, order] += factor * (E[3 + x] + E[y] * p[z] - E[z] * p[y])
                if order == 0:  # the point itself moves
                    for x in range(3):
                        y, z = (x + 1) % 3, (x + 2) % 3
                        dy = s[3 + y] + s[z] * p[x] - s[x] * p[z]
                        dz = s[3 + z] + s[x] * p[y] - s[y] * p[x]
                        change[k, x, at, 0] += factor * (w[y] * dz - w[z] * dy)


class Scales(NamedTuple):
    """Factors of the constraint values, 1 over their limits, in the units of the problem; 0 where free.

    speed (K + 1, n) of q' v, acceleration (n,), jerk (n,), torque (L, K + 1, n), rate (L, n), viscous (L, n) [N·m·s/rad], tool
    (K + 1, 2) of squared speeds, range (n,) of q; peak (K + 1,) is the time after which the speed peaks, time (3,) the units
    of v, a and j. counts are the rows at a grid point: joint speeds, their peaks, accelerations, torques, a bit for each tool
    speed, ranges, static limits, and further speeds, whose rows follow the peaks.
    """

    speed: Array
    acceleration: Array
    jerk: Array
    torque: Array
    rate: Array
    viscous: Array
    tool: Array
    range: Array
    peak: Array
    time: Array
    counts: Indices


class Local(NamedTuple):
    """Derivatives at grid points; the last are empty if the coordinates are the joints themselves.

    Of torques (L, K + 1, 6, n, n, 4), the tool's twists (K + 1, 6) and their changes (K + 1, 6, n, 2), and the joints in the
    coordinates (K + 1, 4, D, n).
    """

    torques: Array
    twist: Array
    tool: Array
    joints: Array


class Window(NamedTuple):
    """Basis functions (K + 1, 4, w) at the grid points, the first of them (K + 1,), and whether a coefficient is free (P,)."""

    basis: Array
    first: Indices
    free: Flags


class ColumnTarget(NamedTuple):
    """Where columns go: grid point k, D coordinates, first coefficient of the window, and workspace (D, 4)."""

    k: int
    D: int
    start: int
    work: Array


@inlined
def _spread(G: Array, low: int, high: int, to: ColumnTarget, local: Local, window: Window, out: Array) -> None:
    """Write a gradient in q, …, q''' of joints low to high (n, 4) as one in the coefficients of a window (W,)."""
    h, w, k, g = local.joints, window.basis.shape[2], to.k, to.work
    for i in range(out.shape[0]):
        out[i] = 0.0
    first, last = 0, to.D
    if h.shape[0] == 0:
        first, last = low, high
    for d in range(first, last):
        for i in range(4):
            if h.shape[0] == 0:
                g[d, i] = G[d, i]
                continue
            total = 0.0
            for m in range(i, 4):
                part = 0.0
                for j in range(low, high):
                    part += G[j, m] * h[k, m - i, d, j]
                total += CHOOSE[m, i] * part
            g[d, i] = total
    for b in range(w):
        at = (window.first[k] + b) * to.D
        for d in range(first, last):
            if window.free[at + d]:
                value = 0.0
                for i in range(4):
                    value += g[d, i] * window.basis[k, i, b]
                out[at + d - to.start] = value


@inlined
def _add(total: Array, G: Array, y: float) -> None:
    for j in range(total.shape[0]):
        for i in range(4):
            total[j, i] += y * G[j, i]


@compiled
def _node(
    z: Array, y: Array, scales: Scales, local: Local, window: Window, to: ColumnTarget, sums: Array, out: Array
) -> None:  # fmt: skip
    """Write the columns of the limits at a grid point, and add their cross derivatives with v and a to sums (3, n, 4)."""
    n, time, counts, k = scales.jerk.shape[0], scales.time, scales.counts, to.k
    v, a = z[k, 0] * time[0], z[k, 1] * time[1]
    G, row = np.zeros((n, 4)), 0
    for family in range(2):  # speeds, and their peaks after the grid point
        lead = scales.peak[k] if family == 1 else 0.0
        for j in range(counts[family]):
            G[j, 1] = (v + lead * a) * scales.speed[k, j]
            sums[0, j, 1] += y[k, row] * scales.speed[k, j] * time[0]
            sums[1, j, 1] += y[k, row] * lead * scales.speed[k, j] * time[1]
            _spread(G, j, j + 1, to, local, window, out[row])
            row += 1
    row += counts[7]  # those of `fill_further`
    for j in range(counts[2]):
        f = scales.acceleration[j]
        G[j, 1], G[j, 2] = f * a, f * v * v
        sums[0, j, 2] += y[k, row] * 2.0 * f * v * time[0]
        sums[1, j, 1] += y[k, row] * f * time[1]
        _spread(G, j, j + 1, to, local, window, out[row])
        row += 1
    _torque(v, a, y[k, row:], scales, local, window, to, sums, out[row:])
    row += counts[3]
    for part in range(2):
        if counts[4] & (1 << part):
            _tool(v, part, y[k, row], scales, local, window, to, sums, out[row])
            row += 1
    G[:] = 0.0
    for j in range(counts[5]):
        G[j, 0] = scales.range[j]
        _spread(G, j, j + 1, to, local, window, out[row])
        row += 1


# More than 8 parameters: a part of `_node`, whose workspace it shares.
@compiled
def _torque(
    v: float, a: float, y: Array, scales: Scales, local: Local, window: Window, to: ColumnTarget, sums: Array, out: Array
) -> None:  # fmt: skip
    """Write the columns of the torques of all loads at a grid point."""
    n, time = scales.jerk.shape[0], scales.time
    G, X, Y = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4))
    for t in range(scales.counts[3]):
        load, i = t // n, t % n
        f, change = scales.torque[load, to.k, i], local.torques[load, to.k]
        for j in range(n):
            for m in range(4):
                p, c = f * change[0, i, j, m], f * change[1, i, j, m]
                G[j, m] = p * a + c * v * v + f * change[2, i, j, m]
                X[j, m], Y[j, m] = 2.0 * c * v * time[0], p * time[1]
        G[i, 1] += f * scales.viscous[load, i] * v
        X[i, 1] += f * scales.viscous[load, i] * time[0]
        _add(sums[0], X, y[t])
        _add(sums[1], Y, y[t])
        _spread(G, 0, n, to, local, window, out[t])


# More than 8 parameters: a part of `_node`, whose workspace it shares.
@compiled
def _tool(
    v: float, part: int, y: float, scales: Scales, local: Local, window: Window, to: ColumnTarget, sums: Array, out: Array
) -> None:  # fmt: skip
    """Write the columns of the square of the tool's speed, or of its rotation speed, at a grid point."""
    n, f, k = scales.jerk.shape[0], scales.tool[to.k, part], to.k
    G, X = np.zeros((n, 4)), np.zeros((n, 4))
    for j in range(n):
        for m in range(2):
            change = 0.0
            for x in range(3 * part, 3 * part + 3):
                change += 2.0 * f * local.twist[k, x] * local.tool[k, x, j, m]
            G[j, m], X[j, m] = change * v * v, 2.0 * change * v * scales.time[0]
    _add(sums[0], X, y)
    _spread(G, 0, n, to, local, window, out)


# More than 8 parameters: interval and grid point differ at its end, and the caller passes parts of its arrays.
@compiled
def _edge(
    k: int, z: Array, y: Array, scales: Scales, local: Local, window: Window, to: ColumnTarget, sums: Array, out: Array
) -> None:  # fmt: skip
    """Write the columns of the limits on jerk and torque rate of interval k at one of its ends, and add cross derivatives."""
    n, time, at = scales.jerk.shape[0], scales.time, to.k
    v, a, jerk = z[at, 0] * time[0], z[at, 1] * time[1], z[k, 3] * time[2]
    G, X, Y, Z = np.zeros((n, 4)), np.zeros((n, 4)), np.zeros((n, 4)), np.zeros((n, 4))
    for j in range(n):
        f = scales.jerk[j]
        G[j, 1], G[j, 2], G[j, 3] = f * jerk, 3.0 * f * v * a, f * v * v * v
        sums[0, j, 2] += y[j] * 3.0 * f * a * time[0]
        sums[0, j, 3] += y[j] * 3.0 * f * v * v * time[0]
        sums[1, j, 2] += y[j] * 3.0 * f * v * time[1]
        sums[2, j, 1] += y[j] * f * time[2]
        _spread(G, j, j + 1, to, local, window, out[j])
    for t in range(scales.rate.shape[0] * n):
        load, i, row = t // n, t % n, n + t
        f, change, b = scales.rate[load, i], local.torques[load, at], scales.viscous[load, i]
        for j in range(n):
            for m in range(4):
                p, d = f * change[0, i, j, m], f * change[3, i, j, m]
                c, h = f * change[4, i, j, m], f * change[5, i, j, m]
                G[j, m] = p * jerk + (d * a + c * v * v + h) * v
                X[j, m] = (d * a + 3.0 * c * v * v + h) * time[0]
                Y[j, m], Z[j, m] = d * v * time[1], p * time[2]
        G[i, 1] += f * b * a
        G[i, 2] += f * b * v * v
        X[i, 2] += 2.0 * f * b * v * time[0]
        Y[i, 1] += f * b * time[1]
        _add(sums[0], X, y[row])
        _add(sums[1], Y, y[row])
        _add(sums[2], Z, y[row])
        _spread(G, 0, n, to, local, window, out[row])


@compiled
def fill(
    z: Array, y: Array, scales: Scales, local: Local, window: Window, D: int, columns: Array, cross_sums: Array
) -> None:  # fmt: skip
    """Write the columns (K + 1, m + 2 e, W) of all limits, and the cross derivatives (K, 5, W) of `border.Border`.

    y (K + 1, m + 2 e) are the multipliers of the constraint values.
    """
    K, n = z.shape[0] - 1, scales.jerk.shape[0]
    e = n * (1 + scales.rate.shape[0])
    m, W = columns.shape[1] - 2 * e, columns.shape[2]
    here, there, work, part = np.zeros((3, n, 4)), np.zeros((3, n, 4)), np.empty((D, 4)), np.empty(W)
    for k in range(K + 1):
        to = ColumnTarget(k, D, window.first[k] * D, work)
        here[:], there[:] = 0.0, 0.0
        _node(z, y, scales, local, window, to, here, columns[k])
        if k == K:
            break
        end = ColumnTarget(k + 1, D, to.start, work)
        _edge(k, z, y[k, m : m + e], scales, local, window, to, here, columns[k, m : m + e])
        _edge(k, z, y[k, m + e :], scales, local, window, end, there, columns[k, m + e :])
        for i in range(3):
            _spread(here[i], 0, n, to, local, window, cross_sums[k, i])
        for i in range(3):  # of v⁺ and a⁺, and the second part of that of j
            _spread(there[i], 0, n, end, local, window, part)
            at = 3 + i if i < 2 else 2
            for c in range(W):
                cross_sums[k, at, c] = part[c] + (cross_sums[k, 2, c] if i == 2 else 0.0)


# More than 8 parameters: those of `fill`, and the derivatives (K + 1, c, n, 2) of the rows.
@compiled
def fill_further(
    z: Array, y: Array, scales: Scales, local: Local, changes: Array, window: Window, D: int, columns: Array, cross_sums: Array
) -> None:  # fmt: skip
    """Write the columns of further speeds, and add to the cross derivatives that `fill` wrote."""
    K, n, time, counts = z.shape[0] - 1, scales.jerk.shape[0], scales.time, scales.counts
    G, X, work, part = np.zeros((n, 4)), np.zeros((n, 4)), np.empty((D, 4)), np.empty(columns.shape[2])
    for k in range(K + 1):
        to = ColumnTarget(k, D, window.first[k] * D, work)
        X[:] = 0.0
        for i in range(counts[7]):
            row = counts[0] + counts[1] + i
            for j in range(n):
                for m in range(2):
                    G[j, m] = changes[k, i, j, m] * z[k, 0] * time[0]
                    X[j, m] += y[k, row] * changes[k, i, j, m] * time[0]
            _spread(G, 0, n, to, local, window, columns[k, row])
        if k < K:
            _spread(X, 0, n, to, local, window, part)
            for c in range(part.shape[0]):
                cross_sums[k, 0, c] += part[c]
