"""An interior-point method for one joint: a cubic B-spline in time, a quadratic objective, and limits on each derivative.

With control points c, the rows are c_i, the control points of the first and of the second derivative, and the jerks:

    v_i = 3 (c_{i+1} − c_i) / (t_{i+4} − t_{i+1}),  a_i = 2 (v_{i+1} − v_i) / (t_{i+4} − t_{i+2}),  j_i = (a_{i+1} − a_i) / h_i

The convex hull of the rows contains the curve, so a limit on them holds at every instant. The first three control points are
the state at the start, and the last three are equal: the motion ends at rest. Each matrix has half bandwidth 3, so that a step
costs O(N). The iteration is Mehrotra's (SIAM Journal on Optimization, 1992).
"""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined
from optik.types import Array

MOST_STEPS = 60
"""Largest number of iterations."""
GAP, INFEASIBLE, GRADIENT, NO_GAP = 1e-7, 1e-9, 1e-4, 1e-10
"""The iteration ends with this mean complementarity and this residual of the rows, both over half the width of a limit, if the
gradient is as small as the third value, or the complementarity as small as the last one: a feasible point that is not optimal
is an answer, and rounding keeps some gradients from falling further."""
FIRST_SLACK, FIRST_MULTIPLIER, PART_OF_STEP = 0.1, 0.01, 0.995
"""Least slack and multiplier of the first iterate, and the fraction of a step to the boundary that is taken."""
S1, S2, L1, L2, R1, R2, I1, I2, P1, P2, N1, N2, M1, M2, ROWS, WEIGHT, NET = range(17)
"""Work arrays over the rows: slacks of the lower and the upper side, multipliers, residuals, inverse slacks, products of the
first direction, directions of slacks and of multipliers, values of rows,
weights in the normal matrix, and differences of multipliers."""


@inlined
def make_factors(T: Array, f: Array) -> None:
    """Write the factors f (3, N + 3) of the differences of a spline with breakpoints T (N + 1,) [s]: 1/s each."""
    N = T.size - 1
    for i in range(N + 2):
        f[0, i] = 3.0 / (T[min(i + 1, N)] - T[max(i - 2, 0)])
        if i <= N:
            f[1, i] = 2.0 / (T[min(i + 1, N)] - T[max(i - 1, 0)])
        if i < N:
            f[2, i] = 1.0 / (T[i + 1] - T[i])


@inlined
def make_rows(f: Array, c: Array, x: Array) -> None:
    """Write control points, velocities, accelerations and jerks x (4, N + 3) of control points c (N + 3,)."""
    N = c.size - 3
    for i in range(N + 3):
        x[0, i] = c[i]
    for i in range(N + 2):
        x[1, i] = (c[i + 1] - c[i]) * f[0, i]
    for i in range(N + 1):
        x[2, i] = (x[1, i + 1] - x[1, i]) * f[1, i]
    for i in range(N):
        x[3, i] = (x[2, i + 1] - x[2, i]) * f[2, i]


@inlined
def _add_transposed(f: Array, w: Array, g: Array) -> None:
    """Add the transposed rows times w (4, N + 3), which is overwritten, to g (N + 3,)."""
    N = g.size - 3
    for i in range(N):
        u = w[3, i] * f[2, i]
        w[2, i] -= u
        w[2, i + 1] += u
    for i in range(N + 1):
        u = w[2, i] * f[1, i]
        w[1, i] -= u
        w[1, i + 1] += u
    for i in range(N + 2):
        u = w[1, i] * f[0, i]
        g[i] += w[0, i] - u
        g[i + 1] += u
    g[N + 2] += w[0, N + 2]


@inlined
def make_stencils(f: Array, A: Array) -> None:
    """Write the coefficients A (9, N + 3) of the rows over control points: two of v_i, three of a_i, four of j_i."""
    N = f.shape[1] - 3
    for i in range(N + 2):
        A[0, i], A[1, i] = -f[0, i], f[0, i]
    for i in range(N + 1):
        A[2, i], A[3, i], A[4, i] = f[1, i] * f[0, i], -f[1, i] * (f[0, i] + f[0, i + 1]), f[1, i] * f[0, i + 1]
    for i in range(N):
        A[5, i], A[6, i] = -f[2, i] * A[2, i], f[2, i] * (A[2, i + 1] - A[3, i])
        A[7, i], A[8, i] = f[2, i] * (A[3, i + 1] - A[4, i]), f[2, i] * A[4, i + 1]


@inlined
def add_weighted(A: Array, w: Array, F: Array) -> None:
    """Add Aᵀ diag(w) A to the bands F (4, N + 3) of a matrix over control points; row weights w (4, N + 3)."""
    size = F.shape[1]
    for i in range(size):
        F[0, i] += w[0, i]
    for kind in range(1, 4):
        at = (kind - 1) * (kind + 2) // 2  # 0, 2, 5
        for a in range(kind + 1):
            for b in range(a + 1):
                for i in range(size - kind):
                    F[a - b, i + a] += w[kind, i] * A[at + a, i] * A[at + b, i]


@inlined
def _fold_matrix(F: Array, M: Array) -> None:
    """Write the bands M (4, N − 2) over the unknowns from those over control points: the last three are one unknown."""
    N = F.shape[1] - 3
    Y = N - 2
    for d in range(4):
        for i in range(Y):
            M[d, i] = F[d, i + 3] if i >= d else 0.0
    last = Y - 1
    M[0, last] += F[0, N + 1] + F[0, N + 2] + 2.0 * (F[1, N + 1] + F[1, N + 2] + F[2, N + 2])
    M[1, last] += F[2, N + 1] + F[3, N + 2]
    M[2, last] += F[3, N + 1]


@inlined
def _factor(M: Array) -> bool:
    """Factor a banded matrix in place, M = L D Lᵀ: bands of L, and 1 / D in the first row; False if it is not positive."""
    for i in range(M.shape[1]):
        u3, u2, u1, d0 = M[3, i], M[2, i], M[1, i], M[0, i]
        if i > 2:
            l3 = u3 * M[0, i - 3]
            u2 -= u3 * M[1, i - 2]
            u1 -= u3 * M[2, i - 1]
            d0 -= u3 * l3
            M[3, i] = l3
        if i > 1:
            l2 = u2 * M[0, i - 2]
            u1 -= u2 * M[1, i - 1]
            d0 -= u2 * l2
            M[2, i] = l2
        if i > 0:
            l1 = u1 * M[0, i - 1]
            d0 -= u1 * l1
            M[1, i] = l1
        if not d0 > 0.0:
            return False
        M[0, i] = 1.0 / d0
    return True


@inlined
def _solve(M: Array, g: Array, c: Array) -> None:
    """Write the solution for a gradient g (N + 3,) over control points into c (N + 3,), whose first three become 0."""
    Y = M.shape[1]
    N = Y + 2
    c[0], c[1], c[2] = 0.0, 0.0, 0.0
    for i in range(Y):
        right = -g[i + 3] if i < Y - 1 else -(g[N] + g[N + 1] + g[N + 2])
        if i > 2:
            right -= M[3, i] * c[i]
        if i > 1:
            right -= M[2, i] * c[i + 1]
        if i > 0:
            right -= M[1, i] * c[i + 2]
        c[i + 3] = right
    for i in range(Y):
        c[i + 3] *= M[0, i]
    for i in range(Y - 1, -1, -1):
        if i + 1 < Y:
            c[i + 3] -= M[1, i + 1] * c[i + 4]
        if i + 2 < Y:
            c[i + 3] -= M[2, i + 2] * c[i + 5]
        if i + 3 < Y:
            c[i + 3] -= M[3, i + 3] * c[i + 6]
    c[N + 1], c[N + 2] = c[N], c[N]


@inlined
def _gradient(H: Array, g: Array, c: Array, scale: float, out: Array) -> None:
    """Write scale (H c + g) for the bands H (4, N + 3)."""
    size = c.size
    for i in range(size):
        out[i] = g[i] + H[0, i] * c[i]
    for d in range(1, 4):
        for i in range(size - d):
            out[i + d] += H[d, i + d] * c[i]
            out[i] += H[d, i + d] * c[i + d]
    for i in range(size):
        out[i] *= scale


@inlined
def _largest(g: Array) -> float:
    """Return the largest absolute gradient (N + 3,) over the unknowns."""
    N = g.size - 3
    most: float = abs(g[N] + g[N + 1] + g[N + 2])
    for i in range(3, N):
        most = max(most, abs(g[i]))
    return most


@inlined
def _regularise(M: Array, part: float) -> bool:
    """Add a part of its largest entry to the diagonal of a matrix and factor it; False if it is not positive definite."""
    most = 0.0
    for i in range(M.shape[1]):
        most = max(most, M[0, i])
    for i in range(M.shape[1]):
        M[0, i] += part * most
    return _factor(M)


@inlined
def _begin(W: Array, box: Array) -> bool:
    """Write the first slacks and multipliers; return whether a row exceeds its limit."""
    exceeded, N = False, W.shape[2] - 3
    for k in range(4):
        for i in range(3 - k, N + 1 if k < 2 else N):
            z = (W[ROWS, k, i] - box[0, k]) * box[1, k]
            exceeded |= abs(z) > 1.0
            W[S1, k, i], W[S2, k, i] = max(z + 1.0, FIRST_SLACK), max(1.0 - z, FIRST_SLACK)
            W[L1, k, i], W[L2, k, i] = FIRST_MULTIPLIER, FIRST_MULTIPLIER
    return exceeded


@inlined
def _prepare(W: Array, box: Array) -> tuple[float, float]:
    """Write residuals, inverse slacks and weights; return the sum of complementarities and the largest residual."""
    gap, infeasible, N = 0.0, 0.0, W.shape[2] - 3
    W[P1], W[P2], W[WEIGHT], W[NET] = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        for i in range(3 - k, N + 1 if k < 2 else N):
            z = (W[ROWS, k, i] - box[0, k]) * box[1, k]
            W[R1, k, i], W[R2, k, i] = z + 1.0 - W[S1, k, i], 1.0 - z - W[S2, k, i]
            W[I1, k, i], W[I2, k, i] = 1.0 / W[S1, k, i], 1.0 / W[S2, k, i]
            W[WEIGHT, k, i] = (W[L1, k, i] * W[I1, k, i] + W[L2, k, i] * W[I2, k, i]) * box[1, k] ** 2
            W[NET, k, i] = (W[L2, k, i] - W[L1, k, i]) * box[1, k]
        for i in range(3 - k, N + 1 if k < 2 else N):
            gap += W[S1, k, i] * W[L1, k, i] + W[S2, k, i] * W[L2, k, i]
            infeasible = max(infeasible, max(abs(W[R1, k, i]), abs(W[R2, k, i])))
    return gap, infeasible


@inlined
def _aim(W: Array, box: Array, target: float) -> None:
    """Write the right-hand sides of the rows for a complementarity."""
    N = W.shape[2] - 3
    W[ROWS] = 0.0
    for k in range(4):
        for i in range(3 - k, N + 1 if k < 2 else N):
            lower = (target - W[P1, k, i] - W[L1, k, i] * W[R1, k, i]) * W[I1, k, i] - W[L1, k, i]
            upper = (target - W[P2, k, i] - W[L2, k, i] * W[R2, k, i]) * W[I2, k, i] - W[L2, k, i]
            W[ROWS, k, i] = (upper - lower) * box[1, k]


@inlined
def _direct(W: Array, box: Array, target: float) -> tuple[float, float]:
    """Write the directions of slacks and multipliers from those of the rows; return the longest steps, at most 1."""
    primal, dual, N = 1.0, 1.0, W.shape[2] - 3
    for k in range(4):
        for i in range(3 - k, N + 1 if k < 2 else N):
            z = W[ROWS, k, i] * box[1, k]
            W[N1, k, i], W[N2, k, i] = W[R1, k, i] + z, W[R2, k, i] - z
            W[M1, k, i] = (target - W[P1, k, i] - W[L1, k, i] * W[N1, k, i]) * W[I1, k, i] - W[L1, k, i]
            W[M2, k, i] = (target - W[P2, k, i] - W[L2, k, i] * W[N2, k, i]) * W[I2, k, i] - W[L2, k, i]
        for i in range(3 - k, N + 1 if k < 2 else N):
            primal = max(primal, max(-W[N1, k, i] * W[I1, k, i], -W[N2, k, i] * W[I2, k, i]))
            dual = max(dual, max(-W[M1, k, i] / W[L1, k, i], -W[M2, k, i] / W[L2, k, i]))
    return 1.0 / primal, 1.0 / dual


@inlined
def _predict(W: Array, primal: float, dual: float) -> float:
    """Write the products of the first direction; return the sum of complementarities after its steps."""
    after, N = 0.0, W.shape[2] - 3
    for k in range(4):
        for i in range(3 - k, N + 1 if k < 2 else N):
            after += (W[S1, k, i] + primal * W[N1, k, i]) * (W[L1, k, i] + dual * W[M1, k, i])
            after += (W[S2, k, i] + primal * W[N2, k, i]) * (W[L2, k, i] + dual * W[M2, k, i])
            W[P1, k, i], W[P2, k, i] = W[N1, k, i] * W[M1, k, i], W[N2, k, i] * W[M2, k, i]
    return after


@inlined
def _advance(W: Array, primal: float, dual: float) -> None:
    """Take the steps."""
    N = W.shape[2] - 3
    for k in range(4):
        for i in range(3 - k, N + 1 if k < 2 else N):
            W[S1, k, i] += primal * W[N1, k, i]
            W[S2, k, i] += primal * W[N2, k, i]
            W[L1, k, i] += dual * W[M1, k, i]
            W[L2, k, i] += dual * W[M2, k, i]


@inlined
def minimise(spline: tuple[Array, Array], H: Array, g: Array, limits: Array, c: Array, W: Array, most: int) -> int:
    """Minimise ½ cᵀ H c + gᵀ c over the control points c[3:], with all rows within the limits, in at most `most` steps.

    Returns the number of steps, or −1 if no such point was found. c (N + 3,) begins with the state. Afterwards W[ROWS] has
    the rows.

    Shapes and units: spline f (3, N + 3) of `make_factors` and A (9, N + 3) of `make_stencils`, H (4, N + 3) bands, g (N + 3,),
    limits (4, 2) [rad/s^i, m/s^i], W (17, 4, N + 3).
    """
    (f, A), size = spline, c.size
    F, fold, box = np.empty((4, size)), np.empty((4, size - 5)), np.empty((2, 4))
    gradient, right, dc = np.empty(size), np.empty(size), np.empty(size)
    for k in range(4):
        box[0, k] = 0.5 * (limits[k, 0] + limits[k, 1]) if limits[k, 1] < np.inf else 0.0
        box[1, k] = 2.0 / (limits[k, 1] - limits[k, 0])
    for i in range(3, size):
        c[i] = 0.0
    _gradient(H, g, c, 1.0, gradient)
    _fold_matrix(H, fold)
    if not _regularise(fold, 1e-13):
        return -1
    _solve(fold, gradient, dc)
    for i in range(3, size):
        c[i] += dc[i]
    make_rows(f, c, W[ROWS])
    if not _begin(W, box):
        return 0
    scale = 1.0 / max(_largest(gradient), 1e-12)
    for step in range(1, most + 1):
        gap, infeasible = _prepare(W, box)
        mean = gap / (8 * size - 32)
        _gradient(H, g, c, scale, gradient)
        _add_transposed(f, W[NET], gradient)
        if mean < GAP and infeasible < INFEASIBLE and (mean < NO_GAP or _largest(gradient) < GRADIENT):
            return step
        for d in range(4):
            for i in range(size):
                F[d, i] = scale * H[d, i]
        add_weighted(A, W[WEIGHT], F)
        _fold_matrix(F, fold)
        if not _regularise(fold, 1e-14):
            return -1
        target, primal, dual = 0.0, 1.0, 1.0
        for phase in range(2):
            _aim(W, box, target)
            for i in range(size):
                right[i] = gradient[i]
            _add_transposed(f, W[ROWS], right)
            _solve(fold, right, dc)
            make_rows(f, dc, W[ROWS])
            primal, dual = _direct(W, box, target)
            if phase == 0:
                target = mean * (_predict(W, primal, dual) / gap) ** 3
        primal, dual = min(1.0, PART_OF_STEP * primal), min(1.0, PART_OF_STEP * dual)
        _advance(W, primal, dual)
        for i in range(3, size):
            c[i] += primal * dc[i]
        make_rows(f, c, W[ROWS])
    return -1
