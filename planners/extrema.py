"""Exact extrema of piecewise quintics and of their derivatives, compiled."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array


@compiled
def _value(c: Array, degree: int, x: float) -> float:
    """Return the value of a polynomial by Horner's rule; coefficients lowest power first."""
    y = float(c[degree])
    for i in range(degree - 1, -1, -1):
        y = y * x + float(c[i])
    return y


@compiled
def _root(c: Array, degree: int, low: float, high: float, f_low: float) -> float:
    """Return the root of a polynomial between two points of different sign, by Newton steps safeguarded by bisection."""
    x = 0.5 * (low + high)
    for _ in range(80):
        y, slope = c[degree], 0.0
        for i in range(degree - 1, -1, -1):
            slope = slope * x + y
            y = y * x + c[i]
        if y == 0.0:
            return x
        if (y < 0.0) == (f_low < 0.0):
            low = x
        else:
            high = x
        step = y / slope if slope != 0.0 else np.inf
        after = x - step
        if not (low < after < high):
            after = 0.5 * (low + high)
        if abs(after - x) <= 1e-16 * high or not (low < after < high):
            return after
        x = after
    return x


@compiled
def piece_extrema(c: Array, h: Array, value: Array, when: Array) -> None:
    """Write the least and greatest values of pieces and of their derivatives up to order 3 on [0, h], and their times.

    A polynomial is monotone between the roots of its derivative, so the roots of each derivative are found between those
    of the next one, from the linear fourth derivative of the quintic upwards: none is missed.

    Shapes and units: c (6, m, n) [rad/s^i, m/s^i], h (m,) [s], value (4, m, n, 2) [rad/s^i, m/s^i], when (4, m, n, 2) [s].
    """
    m, n = c.shape[1], c.shape[2]
    a = np.zeros((5, 6))  # derivatives of orders 0 to 4, lowest power first
    roots, before = np.empty(6), np.empty(6)
    for k in range(m):
        for j in range(n):
            for i in range(6):
                a[0, i] = c[5 - i, k, j]
            for order in range(1, 5):
                for i in range(6 - order):
                    a[order, i] = (i + 1) * a[order - 1, i + 1]
            count = 0  # inner roots of the derivative one order higher
            for order in range(4, -1, -1):
                degree = 5 - order
                found = 0
                low, f_low = 0.0, a[order, 0]
                least, most, at_least, at_most = f_low, f_low, 0.0, 0.0
                for i in range(count + 1):
                    high = before[i] if i < count else h[k]
                    f_high = _value(a[order], degree, high)
                    if f_high < least:
                        least, at_least = f_high, high
                    if f_high > most:
                        most, at_most = f_high, high
                    if f_low * f_high < 0.0:
                        roots[found] = _root(a[order], degree, low, high, f_low)
                        found += 1
                    elif f_high == 0.0 and i < count:
                        roots[found] = high
                        found += 1
                    low, f_low = high, f_high
                if order < 4:
                    value[order, k, j, 0], value[order, k, j, 1] = least, most
                    when[order, k, j, 0], when[order, k, j, 1] = at_least, at_most
                count = found
                for i in range(found):
                    before[i] = roots[i]


@compiled
def piece_ends(c: Array, h: Array, first: Array, last: Array) -> None:
    """Write the values of pieces and of their derivatives up to order 3 at both ends.

    Shapes and units: c (6, m, n) [rad/s^i, m/s^i], h (m,) [s], first, last (4, m, n) [rad/s^i, m/s^i].
    """
    for k in range(c.shape[1]):
        for j in range(c.shape[2]):
            factor = np.ones(6)  # of each power, after `order` derivatives
            for order in range(4):
                value = 0.0
                for power in range(5, order - 1, -1):
                    value = value * h[k] + factor[power] * c[5 - power, k, j]
                first[order, k, j], last[order, k, j] = factor[order] * c[5 - order, k, j], value
                for power in range(order, 6):
                    factor[power] *= power - order
