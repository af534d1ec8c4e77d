"""Curves with derivatives on an interval [0, end], the chain rule for f(s(t)), and exact extrema of piecewise quintics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import comb
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.check import real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.types import Array, Indices

CHAIN = ((1.0,), (1.0, 1.0), (1.0, 3.0, 1.0))
"""Faà di Bruno's formula: factors of f', f'', f''' in the first, second and third derivative of f(s(t))."""
BINOMIAL = np.array([[comb(k, i) for i in range(7)] for k in range(7)], dtype=np.float64)
"""Binomial coefficients C(k, i), for Leibniz's rule and Bell polynomials up to the sixth derivative."""
TIME_BISECTIONS = 60
"""Halvings of an interval of time: more than the 53 binary digits of a float."""


class Curve(ABC):
    """A function of one parameter in [0, end], with derivatives."""

    parameter = "x"
    highest_order = 3

    @property
    @abstractmethod
    def end(self) -> float:
        """Upper end of the interval; the lower one is 0."""

    @abstractmethod
    def _evaluate(self, x: Array, order: int) -> Array:
        """Return the values (k, ...) of the derivative at x (k,), which lies in the interval."""

    def __call__(self, x: float | ArrayLike, order: int = 0) -> Array:
        """Return the value or a derivative at x.

        Parameters
        ----------
        x : scalar or (k,) array
            In [0, end]; up to 1e-9 of `end` beyond either end counts as the end.
        order : int
            0 for the value, 1 to 3 for derivatives.

        Returns
        -------
        array
            One value for a scalar x, or k of them stacked along the first axis.

        Raises
        ------
        InvalidInput
            x outside the interval or not finite, or another order.
        """
        if not isinstance(order, int | np.integer) or order not in range(self.highest_order + 1):
            raise InvalidInput("order", repr(order), f"0 to {self.highest_order}")
        if isinstance(x, float) and 0.0 <= x <= self.end:  # the usual scalar, without the checks of arrays
            value: Array = self._evaluate(np.array([x]), order)[0]
            return value
        at = real_array(x, self.parameter, "a number or an array of numbers")
        if at.ndim > 1:
            raise InvalidInput(self.parameter, f"shape {at.shape}", "a scalar or a one-dimensional array")
        slack = 1e-9 * max(self.end, 1e-9)
        if at.size and not ((at >= -slack) & (at <= self.end + slack)).all():
            wrong = at.ravel()[np.argmax(~((at.ravel() >= -slack) & (at.ravel() <= self.end + slack)))]
            raise InvalidInput(self.parameter, f"{wrong:.9g}", f"values in [0, {self.end:.9g}]")
        values = self._evaluate(np.atleast_1d(np.clip(at, 0.0, self.end)), order)
        return values[0] if at.ndim == 0 else values


class PiecewiseCurve(Curve):
    """A curve of piecewise polynomials with coefficients (at most 6, m, n) between knots (m + 1,)."""

    def _set_polynomial(self, polynomial: scipy.interpolate.PPoly) -> None:
        self._polynomial = polynomial
        self._x = np.require(polynomial.x, np.float64, ["C", "W"])
        self._c = np.require(polynomial.c, np.float64, ["C", "W"])

    def _evaluate(self, x: Array, order: int) -> Array:
        out = np.empty((x.size, self._c.shape[2]))
        evaluate(self._c, self._x, x, order, out)
        return out


@compiled
def evaluate(c: Array, knots: Array, x: Array, order: int, out: Array) -> None:
    """Write the derivatives (k, n) of piecewise polynomials at x (k,); at knots they are right-hand values."""
    last, degree = knots.shape[0] - 2, c.shape[0] - 1
    for i in range(x.shape[0]):
        k = min(max(np.searchsorted(knots, x[i], side="right") - 1, 0), last)
        u = x[i] - knots[k]
        for n in range(c.shape[2]):
            value, power = 0.0, 1.0
            for j in range(degree - order, -1, -1):
                term = c[j, k, n]
                for d in range(order):
                    term *= degree - j - d
                value += term * power
                power *= u
            out[i, n] = value


def piece_at(knots: Array, t: Array) -> Indices:
    """Return, for each time, the index of the piece of the motion that contains it."""
    return np.clip(np.searchsorted(knots, t, side="right") - 1, 0, knots.size - 2)


def evaluate_quintics(c: Array, piece: Indices, u: Array) -> Array:
    """Return q and its derivatives (4, k, n) at times u (k,) after the first knots of pieces of quintics (6, m, n)."""
    out = np.empty((4, u.size, c.shape[2]))
    _write_quintics(c, piece, u, out)
    return out


@compiled
def _write_quintics(c: Array, piece: Indices, u: Array, out: Array) -> None:
    for i in range(u.shape[0]):
        k, x = piece[i], u[i]
        for n in range(c.shape[2]):
            c0, c1, c2, c3, c4 = c[0, k, n], c[1, k, n], c[2, k, n], c[3, k, n], c[4, k, n]
            out[0, i, n] = c[5, k, n] + x * (c4 + x * (c3 + x * (c2 + x * (c1 + x * c0))))
            out[1, i, n] = c4 + x * (2.0 * c3 + x * (3.0 * c2 + x * (4.0 * c1 + x * 5.0 * c0)))
            out[2, i, n] = 2.0 * c3 + x * (6.0 * c2 + x * (12.0 * c1 + x * 20.0 * c0))
            out[3, i, n] = 6.0 * c2 + x * (24.0 * c1 + x * 60.0 * c0)


@compiled
def largest_term(c: Array, knots: Array) -> float:
    """Return the largest |cᵢ| hⁱ of piecewise polynomials over pieces of length h; NaN if a coefficient is NaN.

    Shapes and units: c (at most 6, m, n), knots (m + 1,). Returns [as the values].
    """
    largest: float = 0.0
    for k in range(c.shape[1]):
        h, power = knots[k + 1] - knots[k], 1.0
        for i in range(c.shape[0] - 1, -1, -1):
            for j in range(c.shape[2]):
                size: float = abs(c[i, k, j]) * power
                if np.isnan(size):
                    return size
                largest = max(largest, size)
            power *= h
    return largest


# ---------------------------------------------------------------- the chain rule for f(s(t))


def monomials(rates: Sequence[Array], *, full: bool = False) -> tuple[Array, ...]:
    """Return the products of derivatives of s(t) that the chain rule multiplies with f', f'', f'''."""
    v = rates[0]
    if len(rates) == 1:
        return (v,)
    if len(rates) == 2:
        return (rates[1], v * v, v, np.ones_like(v)) if full else (rates[1], v * v)
    highest = (rates[2], v * rates[1], v**3)
    return (*highest, v, rates[1], v * v) if full else highest


def chain_rows(derivatives: Sequence[Array]) -> Array:
    """Return the coefficients of a time derivative of f(s(t)) over its `monomials`."""
    factors = CHAIN[len(derivatives) - 1]
    return np.stack([factor * f for factor, f in zip(factors, derivatives, strict=True)], axis=-1)


def apply_chain_rule(derivatives: Sequence[Array], rates: Sequence[Array]) -> list[Array]:
    """Return the time derivatives of f(s(t)) by the chain rule."""
    found = []
    for order in range(1, len(rates) + 1):
        products = monomials(rates[:order])
        value = derivatives[0] * products[0]
        for i in range(1, order):
            value = value + CHAIN[order - 1][i] * derivatives[i] * products[i]
        found.append(value)
    return found


def find_times(function: Callable[[Array], Array], values: Array, end: float) -> Array:
    """Return the times at which an increasing function of time reaches given values, by bisection."""
    low, high = np.zeros(values.size), np.full(values.size, end)
    for _ in range(TIME_BISECTIONS):
        middle = 0.5 * (low + high)
        before = function(middle) < values
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low


@compiled
def bell(S: Array, B: Array) -> None:
    """Write the complete Bell polynomials of S into B: B_k = Σ_i C(k−1, i) B_{k−1−i} S_{i+1}, up to the length of B, at most 6.

    Shapes and units: S (m,) [1/s^i], B (m,) [1/s^i].
    """
    B[0] = 1.0
    for k in range(1, B.shape[0]):
        B[k] = 0.0
        for i in range(k):
            B[k] += BINOMIAL[k - 1, i] * B[k - 1 - i] * S[i + 1]


@compiled
def bells(S: Array, B: Array) -> None:
    """Write the complete Bell polynomials of many rows; see `bell`.

    Shapes and units: S (k, m) [1/s^i, 1/m^i], B (k, m) [1/s^i, 1/m^i].
    """
    for i in range(S.shape[0]):
        bell(S[i], B[i])


def quintic(x: Array, left: tuple[Array, Array, Array], right: tuple[Array, Array, Array]) -> Any:
    """Return the piecewise polynomial of degree 5 with these ends (Biagiotti and Melchiorri, Trajectory Planning, §2.1.6)."""
    h = np.diff(x)[:, None]
    p0, v0, a0 = left
    p1, v1, a1 = right
    P = p1 - (p0 + h * (v0 + 0.5 * h * a0))
    V = h * (v1 - (v0 + h * a0))
    A = h * h * (a1 - a0)
    c3, c4, c5 = 10.0 * P - 4.0 * V + 0.5 * A, -15.0 * P + 7.0 * V - A, 6.0 * P - 3.0 * V + 0.5 * A
    c = np.stack([c5 / h**5, c4 / h**4, c3 / h**3, 0.5 * a0, v0, p0])
    return scipy.interpolate.PPoly(c, x, extrapolate=True)


def constant_acceleration(s: Array, speed: Array) -> Any:
    """Return s(t) through path parameters (k,) with speeds ṡ (k,), and with constant s̈ between them."""
    h = 2.0 * np.diff(s) / (speed[:-1] + speed[1:])
    t = np.concatenate([[0.0], np.cumsum(h)])
    return scipy.interpolate.PPoly(np.stack([0.5 * np.diff(speed) / h, speed[:-1], s[:-1]]), t, extrapolate=True)


def quintic_through(x: Array, p: Array, v: Array, a: Array) -> Any:
    """Return the quintic spline through values at the knots, with continuous second derivatives."""
    return quintic(x, (p[:-1], v[:-1], a[:-1]), (p[1:], v[1:], a[1:]))


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
                at = 0
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
                        roots[at] = _root(a[order], degree, low, high, f_low)
                        at += 1
                    elif f_high == 0.0 and i < count:
                        roots[at] = high
                        at += 1
                    low, f_low = high, f_high
                if order < 4:
                    value[order, k, j, 0], value[order, k, j, 1] = least, most
                    when[order, k, j, 0], when[order, k, j, 1] = at_least, at_most
                count = at
                for i in range(at):
                    before[i] = roots[i]


@compiled
def whole_extrema(value: Array, when: Array, knots: Array, out: Array) -> None:
    """Write the least and the greatest value of all pieces (the first of equal ones), and their times.

    Shapes and units: value (4, m, n, 2) [rad/s^i, m/s^i] and when (4, m, n, 2) [s] of `piece_extrema`, knots (m + 1,) [s], out
    (4, 4, n): least, greatest, and when.
    """
    for order in range(4):
        for j in range(value.shape[2]):
            low, high = 0, 0
            for k in range(1, value.shape[1]):
                if value[order, k, j, 0] < value[order, low, j, 0]:
                    low = k
                if value[order, k, j, 1] > value[order, high, j, 1]:
                    high = k
            out[order, 0, j], out[order, 1, j] = value[order, low, j, 0], value[order, high, j, 1]
            out[order, 2, j] = knots[low] + when[order, low, j, 0]
            out[order, 3, j] = knots[high] + when[order, high, j, 1]


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
