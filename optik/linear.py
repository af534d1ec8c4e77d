"""Small dense linear systems: Cholesky, damped steps, Householder least squares, smallest singular values."""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Indices

ORTHOGONAL = 1e-10
"""Cosine [1] below which two rows count as orthogonal; it is the relative error of singular values that are nearly equal, and
its square that of others."""
BOUND_ROUNDING = 1e-12
"""Upper bound on the relative rounding error of `_inverse_bound`."""
MOST_SWEEPS = 30
"""Most sweeps of Jacobi rotations: two or three are enough for finite numbers."""


@compiled
def copy_vector(a: Array, out: Array) -> None:
    """Copy a vector: a (n,) [as given], out (n,) [as a] (overwritten)."""
    for i in range(a.shape[0]):  # a slice assignment takes seconds to compile
        out[i] = a[i]


@compiled
def copy_matrix(A: Array, out: Array) -> None:
    """Copy a matrix: A (m, n) [as given], out (m, n) [as A] (overwritten)."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = A[i, j]


@compiled
def qr_factor(A: Array, beta: Array, order: Indices) -> float:
    """Factor a matrix by Householder QR with column pivoting, in place; return |r_nn| / |r_11|, 0 for a singular matrix.

    See Golub and Van Loan, Matrix Computations, §5.4.2.

    Shapes and units: A (m, n) [as given] (overwritten), beta (n,) [1] (overwritten), order (n,) (overwritten).
    """
    m, n = A.shape
    first, last = 0.0, 0.0
    for j in range(n):
        order[j] = j
    for j in range(n):
        longest, at = -1.0, j
        for c in range(j, n):
            s = 0.0
            for r in range(j, m):
                s += A[r, c] * A[r, c]
            if s > longest:
                longest, at = s, c
        if at != j:
            order[j], order[at] = order[at], order[j]
            for r in range(m):
                t = A[r, j]
                A[r, j] = A[r, at]
                A[r, at] = t
        last = sqrt(longest)
        first = max(first, last)
        if not last > 0.0:  # zero, or not a number
            for c in range(j, n):
                beta[c] = 0.0
            return 0.0
        alpha = -last if A[j, j] > 0.0 else last
        v = A[j, j] - alpha
        beta[j] = -v / alpha
        A[j, j] = alpha
        for r in range(j + 1, m):
            A[r, j] /= v
        for c in range(j + 1, n):
            s = A[j, c]
            for r in range(j + 1, m):
                s += A[r, j] * A[r, c]
            s *= beta[j]
            A[j, c] -= s
            for r in range(j + 1, m):
                A[r, c] -= s * A[r, j]
    return last / first


@compiled
def qr_solve(A: Array, beta: Array, order: Indices, b: Array, x: Array) -> float:
    """Solve A x = b in the least-squares sense by the factors of `qr_factor`; return the residual's norm.

    Shapes and units: A (m, n) [as given], beta (n,) [1], order (n,), b (m,) [as A x] (overwritten), x (n,) [as b / A]
    (overwritten).
    """
    m, n = A.shape
    for j in range(n):
        s = b[j]
        for r in range(j + 1, m):
            s += A[r, j] * b[r]
        s *= beta[j]
        b[j] -= s
        for r in range(j + 1, m):
            b[r] -= s * A[r, j]
    rest = 0.0
    for r in range(n, m):
        rest += b[r] * b[r]
    for j in range(n - 1, -1, -1):
        s = b[j]
        for c in range(j + 1, n):
            s -= A[j, c] * b[c]
        b[j] = s / A[j, j]
        x[order[j]] = b[j]
    return sqrt(rest)


@compiled
def _inverse_bound(QR: Array) -> float:
    """Return 1 / ‖R⁻¹‖ (Frobenius), a lower bound on the smallest singular value of R, from `qr_factor`."""
    k, total = QR.shape[1], 0.0
    x = np.empty(k)
    for c in range(k):  # R x = e_c
        for i in range(c, -1, -1):
            s = 1.0 if i == c else 0.0
            for j in range(i + 1, c + 1):
                s -= QR[i, j] * x[j]
            x[i] = s / QR[i, i]
            total += x[i] * x[i]
    return float((1.0 - BOUND_ROUNDING) / sqrt(total))


@compiled
def smallest_singular_value(J: Array, floor: float = np.inf, below: float = np.inf) -> float:
    """Return the smallest singular value, to 1e-10 of itself or rounding of the largest: J (m, n) [as given].

    If it exceeds `below`, the returned value may be a lower bound on it that also exceeds `below`.
    """
    m, n = J.shape
    tall = m >= n
    k, rest = (n, m) if tall else (m, n)
    A, beta, order = np.empty((rest, k)), np.empty(k), np.empty(k, np.int64)
    for i in range(rest):
        for j in range(k):
            A[i, j] = J[i, j] if tall else J[j, i]
    if qr_factor(A, beta, order) == 0.0:
        return 0.0
    if below < np.inf:
        bound = _inverse_bound(A)
        if bound > below:
            return bound
    return smallest_of_factor(A, floor)


@compiled
def smallest_of_factor(QR: Array, floor: float = np.inf) -> float:
    """Return the smallest singular value of a matrix of full rank by its factors of `qr_factor`.

    One-sided Jacobi rotations of the rows of R, which column pivoting has made nearly diagonal, so that two or three
    sweeps are enough (Drmač and Veselić 2008). With column pivoting the value is at least 3 |r_kk| / √(4ᵏ + 6k − 1)
    (Lawson and Hanson, Solving Least Squares Problems, eq. 6.31).

    Shapes and units: QR (m, k) [as given].
    """
    k = QR.shape[1]
    bound = 3.0 * abs(QR[k - 1, k - 1]) / sqrt(4.0**k + 6.0 * k - 1.0)
    if bound > floor:
        return float(bound)
    A = np.zeros((k, k))
    for i in range(k):
        for j in range(i, k):
            A[i, j] = QR[i, j]
    for _ in range(MOST_SWEEPS):
        turned = False
        for p in range(k - 1):
            for q in range(p + 1, k):
                a, b, c = 0.0, 0.0, 0.0
                for i in range(k):
                    a += A[p, i] * A[p, i]
                    b += A[q, i] * A[q, i]
                    c += A[p, i] * A[q, i]
                if not abs(c) > ORTHOGONAL * sqrt(a * b):
                    continue
                turned = True
                zeta = (b - a) / (2.0 * c)
                t = 1.0 / (abs(zeta) + sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    t = -t
                cs = 1.0 / sqrt(1.0 + t * t)
                sn = cs * t
                for i in range(k):
                    x, y = A[p, i], A[q, i]
                    A[p, i] = cs * x - sn * y
                    A[q, i] = sn * x + cs * y
        if not turned:
            break
    least = np.inf
    for p in range(k):
        s = 0.0
        for i in range(k):
            s += A[p, i] * A[p, i]
        least = min(least, s)
    return sqrt(least)


@compiled
def cholesky_solve(A: Array, b: Array, least: float = 1e-14) -> bool:
    """Solve A x = b for a symmetric positive definite A; return False if A is not.

    Shapes and units: A (n, n) [as given] (overwritten), b (n,) [as A x] (overwritten), least [1].
    """
    n = b.shape[0]
    for j in range(n):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > least * A[j, j]:
            return False
        d = sqrt(d)
        A[j, j] = d
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = s / d
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= A[i, k] * b[k]
        b[i] = s / A[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= A[k, i] * b[k]
        b[i] = s / A[i, i]
    return True


@compiled
def damped_step(J: Array, e: Array, damping2: float, A: Array, y: Array, dq: Array, least: float = 1e-14) -> bool:
    """Compute the damped least-squares step Δq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, paper eq. 11–12.

    Shapes and units: J (m, n) [m/rad, 1], e (m,) [m, rad], damping2 [m², rad²], A (m, m) [m²] (overwritten), y (m,) [1/m]
    (overwritten), dq (n,) [rad, m] (overwritten), least [1].
    """
    m, n = J.shape
    for i in range(m):
        y[i] = e[i]
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                s += J[i, k] * J[j, k]
            A[i, j] = s
        A[i, i] += damping2
    if not cholesky_solve(A, y, least):
        return False
    for k in range(n):
        s = 0.0
        for i in range(m):
            s += J[i, k] * y[i]
        dq[k] = s
    return True
