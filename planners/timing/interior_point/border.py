"""Coefficients p of a free path in the Newton step: a window of them travels with the state; compiled.

The dynamics of s do not depend on p, so the cost to go is ½ xᵀP x + xᵀS p + ½ pᵀΠ p. A B-spline's coefficient occurs in the
limits of few adjacent grid points. The backward sweep eliminates it at the first of them; a step costs time in proportion to
the number of grid points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled, inlined
from optik.types import Array, Indices

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
def add(border: Border, column: Array, weight: float, pull: float) -> None:
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
def choose(k: int, x: float, y: float, border: Border) -> None:
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
