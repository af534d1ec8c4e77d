"""The reference of a chunk: the smoothest quintic spline within a tolerance of its points (P-splines; Eilers, Marx, 1996)."""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined, parallel
from optik.types import Array

MOST_SPANS = 1000
"""Largest number of polynomials of a reference."""
PENALTIES = 10.0 ** np.arange(3.0, -6.0, -1.0)
"""Weights of the third derivative, in units of one sample, from the smoothest reference to the closest one."""
# The six quintic B-splines over a uniform interval: row i is the polynomial of the i-th coefficient, lowest power first.
_BASIS = [
    [1, -5, 10, -10, 5, -1],
    [26, -50, 20, 20, -20, 5],
    [66, 0, -60, 0, 30, -10],
    [26, 50, 20, -20, -20, 10],
    [1, 5, 10, 10, 5, -5],
    [0, 0, 0, 0, 0, 1],
]
# Their derivatives of order 0 to 3: (order, i, power).
BASIS = np.array([[np.pad(np.polyder(row[::-1], k)[::-1] / 120.0, (0, k)) for row in _BASIS] for k in range(4)])
FEWEST_NOISY, MEDIAN = 12, 0.6745 * np.sqrt(924.0)
"""Fewest points whose scatter is estimated, and the median of the absolute sixth differences of unit noise."""
ROUNDING = 1e-12
"""Smallest eigenvalue of the normal equations, in units of one sample: fewer points than coefficients leave them singular."""


@inlined
def evaluate_reference(c: Array, h: float, s: float, out: Array) -> None:
    """Write r and its derivatives at s: c (k, n), interval h [s], out (at most 4, n) [rad/s^i, m/s^i]."""
    k = min(max(int(s / h), 0), c.shape[0] - 6)
    u, scale = s / h - k, 1.0
    for order in range(out.shape[0]):
        out[order] = 0.0
        for i in range(6):
            value = 0.0
            for power in range(5 - order, -1, -1):
                value = value * u + BASIS[order, i, power]
            value *= scale
            for j in range(c.shape[1]):
                out[order, j] += value * c[k + i, j]
        scale /= h


@parallel
def sample_reference(c: Array, h: float, s: Array, R: Array) -> None:
    """Write the reference and its derivatives R (k, 4, n) at places s (k,)."""
    for i in range(s.size):
        evaluate_reference(c, h, s[i], R[i])


@inlined
def _normal_equations(P: Array, B: Array, R: Array) -> int:
    """Write the bands B (6, k) of BᵀB and the right-hand sides R (k, n) = BᵀP of points P (m, n); return the spans."""
    m: int = P.shape[0]
    spans = min(m - 1, MOST_SPANS)
    h = (m - 1) / spans
    b = np.empty(6)
    B[:], R[:] = 0.0, 0.0
    for i in range(m):
        k = min(int(i / h), spans - 1)
        u = i / h - k
        for a in range(6):
            b[a] = BASIS[0, a, 5]
            for power in range(4, -1, -1):
                b[a] = b[a] * u + BASIS[0, a, power]
        for a in range(6):
            for d in range(a + 1):
                B[d, k + a] += b[a] * b[a - d]
            for j in range(P.shape[1]):
                R[k + a, j] += b[a] * P[i, j]
    return spans


@inlined
def _solve(B: Array, penalty: float, L: Array, c: Array) -> None:
    """Solve (BᵀB + penalty D₃ᵀD₃) c = R in place by a banded LDLᵀ factor: bands (6, k), work L (6, k), c (k, n)."""
    size, n = c.shape
    difference = (-1.0, 3.0, -3.0, 1.0)
    L[:] = B
    for i in range(size - 3):
        for a in range(4):
            for d in range(a + 1):
                L[d, i + a] += penalty * difference[a] * difference[a - d]
    for i in range(size):
        L[0, i] += ROUNDING
        for d in range(min(5, i), 0, -1):  # L[d] holds L D until the row is complete
            for e in range(d + 1, min(5, i) + 1):
                L[d, i] -= L[e, i] * L[e - d, i - d]
        for d in range(1, min(5, i) + 1):
            factor = L[d, i] / L[0, i - d]
            L[0, i] -= factor * L[d, i]
            L[d, i] = factor
            for j in range(n):
                c[i, j] -= factor * c[i - d, j]
    for i in range(size - 1, -1, -1):
        for j in range(n):
            c[i, j] /= L[0, i]
        for d in range(1, min(5, size - 1 - i) + 1):
            for j in range(n):
                c[i, j] -= L[d, i + d] * c[i + d, j]


def find_scatter(P: Array) -> float:
    """Return the largest standard deviation of the noise of points P (m, n) over the joints [rad, m].

    Sixth differences suppress the smooth motion; the median is robust against kinks.
    """
    if len(P) < FEWEST_NOISY:
        return 0.0
    rough, k = np.abs(np.diff(P, 6, axis=0)), (len(P) - 6) // 2
    return float(np.partition(rough, k, axis=0)[k].max() / MEDIAN)


@parallel
def fit_reference(P: Array, tolerance: float, c: Array) -> float:
    """Write the coefficients c (k, n) of the smoothest reference within a tolerance of points P (m, n).

    Returns the largest distance to a point [rad, m]. The distance grows with the penalty, which is found by bisection.
    """
    size, n, m = c.shape[0], c.shape[1], P.shape[0]
    B, L, at = np.empty((6, size)), np.empty((6, size)), np.empty((1, n))
    R, trial = np.empty((size, n)), np.empty((size, n))
    spans = _normal_equations(P, B, R)
    h = (m - 1) / spans
    low, high, best = 0, PENALTIES.size - 1, np.inf
    while low <= high:
        k = (low + high) // 2
        trial[:] = R
        _solve(B, PENALTIES[k] / h**5, L, trial)
        worst = 0.0
        for i in range(m):
            evaluate_reference(trial, h, float(i), at)
            for j in range(n):
                worst = max(worst, abs(at[0, j] - P[i, j]))
        if worst <= tolerance or k == PENALTIES.size - 1:
            c[:], best = trial, worst
        if worst <= tolerance:
            high = k - 1
        else:
            low = k + 1
    return best
