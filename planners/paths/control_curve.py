"""B-splines of degree 5 on [0, end] with clamped ends: basis functions, derivatives and bounds from the control points."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from optik.arm.plain import read_numbers
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.types import Array, Indices

DEGREE = 5
"""Degree of the splines: their fourth derivatives are continuous, so that the jerk of a motion along them is."""
SPAN_SAMPLES = 24
"""Samples of each span for the bounds on derivatives; between them a bound grows by half their distance times the next one."""
PASSED = 1e-13
"""Largest distance from a value that a spline takes [as its unit]: rounding."""


@compiled
def _fill_basis(t: Array, s: Array, span: Indices, out: Array) -> None:
    """Write the functions that are not 0 in the spans of points, and their first three derivatives (k, 4, 6)."""
    of_degree = np.zeros((DEGREE + 1, DEGREE + 1))  # functions of degrees 0, 1, … that are not 0 in the span
    of_degree[0, 0] = 1.0
    part, before = np.zeros(DEGREE + 1), np.zeros(DEGREE + 1)
    for k in range(s.size):
        for p in range(1, DEGREE + 1):
            for r in range(p + 1):
                i, value = span[k] - p + r, 0.0
                if r > 0:
                    value += (s[k] - t[i]) * (of_degree[p - 1, r - 1] / (t[i + p] - t[i]))
                if r < p:
                    value += (t[i + p + 1] - s[k]) * (of_degree[p - 1, r] / (t[i + p + 1] - t[i + 1]))
                of_degree[p, r] = value
        for order in range(4):
            part[:] = of_degree[DEGREE - order]
            for p in range(DEGREE - order + 1, DEGREE + 1):
                before[:] = part
                for r in range(p + 1):
                    i, value = span[k] - p + r, 0.0
                    if r > 0:
                        value += before[r - 1] / (t[i + p] - t[i])
                    if r < p:
                        value -= before[r] / (t[i + p + 1] - t[i + 1])
                    part[r] = p * value
            out[k, order] = part


class Basis(NamedTuple):
    """Basis functions at points (k,): the first one that is not 0 there (k,), and values and derivatives of six (k, 4, 6)."""

    first: Indices
    values: Array

    def combine(self, coefficients: Array) -> Array:
        """Return the spline of coefficients (C, D) and its derivatives (k, 4, D)."""
        window = coefficients[self.first[:, None] + np.arange(DEGREE + 1)]
        first = window[:, :1]  # its functions' derivatives add up to 0: without it less is lost to rounding
        out: Array = self.values @ (window - first)
        out[:, 0] += first[:, 0]
        return out

    def matrix(self, count: int, order: int = 0) -> Array:
        """Return the matrix (k, C) from that many control points to the spline or a derivative at the points."""
        out = np.zeros((len(self.first), count))
        np.put_along_axis(out, self.first[:, None] + np.arange(DEGREE + 1), self.values[:, order], axis=1)
        return out


class ControlBounds(NamedTuple):
    """Bounds of control points (C, D): each lower ≤ p ≤ upper, and discs: first of two columns, and radius."""

    lower: Array
    upper: Array
    discs: tuple[tuple[int, float], ...] = ()

    def clip(self, p: Array) -> Array:
        """Return the nearest control points inside."""
        p = np.clip(p, self.lower, self.upper)
        for at, radius in self.discs:
            p[:, at : at + 2] /= np.maximum(np.linalg.norm(p[:, at : at + 2], axis=1) / radius, 1.0)[:, None]
        return p


class ControlCurve:
    """Clamped knots on [0, end], by default equally spaced.

    Attributes
    ----------
    count : int
        Number of control points.
    """

    def __init__(self, end: float, count: int, inner: Array | None = None) -> None:
        inner = np.linspace(0.0, end, count - DEGREE + 1)[1:-1] if inner is None else inner
        self.end, self.count = end, len(inner) + DEGREE + 1
        self.knots: Array = np.concatenate([np.zeros(DEGREE + 1), inner, np.full(DEGREE + 1, end)])

    @classmethod
    def between(cls, breaks: Array) -> Self:
        """Return the knots of spans between increasing parameters from 0."""
        return cls(float(breaks[-1]), 0, breaks[1:-1])

    @cached_property
    def breaks(self) -> Array:
        """The distinct knots."""
        return self.knots[DEGREE : self.count + 1]

    @cached_property
    def greville(self) -> Array:
        """The parameters of the control points (count,), means of knots: control points of a line at them are on it."""
        return np.array([self.knots[i + 1 : i + DEGREE + 1].mean() for i in range(self.count)])

    def basis(self, s: Array) -> Basis:
        """Return the basis functions and their first three derivatives, by de Boor's recursion."""
        span = np.clip(np.searchsorted(self.knots, s, side="right") - 1, DEGREE, self.count - 1)
        out = np.empty((s.size, 4, DEGREE + 1))
        _fill_basis(self.knots, np.ascontiguousarray(s), span, out)
        return Basis(span - DEGREE, out)

    def derivative_bounds(self, coefficients: Array, orders: int) -> Array:
        """Return bounds on |f⁽ᵐ⁾|, m = 0 … orders, in each span (spans, orders + 1, D): the largest control points."""
        spans = self.count - DEGREE
        out = np.empty((spans, orders + 1, coefficients.shape[1]))
        for m in range(orders + 1):
            size = np.abs(self.control_points(coefficients, m))
            out[:, m] = np.max([size[i : i + spans] for i in range(DEGREE - m + 1)], axis=0)
        return out

    def control_points(self, coefficients: Array, order: int) -> Array:
        """Return the control points (C − order, D) of a derivative."""
        t, c = self.knots, coefficients
        for m in range(1, order + 1):
            p = DEGREE - m + 1
            width = t[m + p : m + p + len(c) - 1] - t[m : m + len(c) - 1]
            c = p * np.diff(c, axis=0) / np.where(width > 0.0, width, 1.0)[:, None]
        return c

    def fit(self, s: Array, values: Array) -> Array:
        """Return the coefficients (C, D) of the least-squares spline through values (k, D), exact at the first and last one."""
        A = self.basis(s).matrix(self.count)
        ends = A[:, :1] * values[:1] + A[:, -1:] * values[-1:]
        inner = np.linalg.lstsq(A[:, 1:-1], values - ends, rcond=None)[0]
        return np.concatenate([values[:1], inner, values[-1:]])

    def interpolate(self, s: Array, q: Array) -> Array:
        """Return the control points (C, n) of the line, or of the curve with the least ∫ |q''|² ds, through values at s."""
        C = self.count
        if len(s) == 2:
            return np.asarray(q[0] + self.greville[:, None] / self.end * (q[1] - q[0]))
        u, width = (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1), np.diff(self.breaks)
        at = (self.breaks[:-1, None] + width[:, None] * u).ravel()
        bend, A = np.sqrt(np.repeat(width, u.size))[:, None] * self.basis(at).matrix(C, 2), self.basis(s).matrix(C)
        H = bend.T @ bend * self.end**3
        system = np.block([[H, A.T], [A, np.zeros((s.size, s.size))]])
        found = np.linalg.solve(system, np.concatenate([np.zeros((C, q.shape[1])), q]))[:C]
        found[[0, -1]] = q[[0, -1]]  # to the last bit; `move_inside` removes the rounding error of the other values
        return np.asarray(found)

    def move_inside(self, s: Array, values: Array, p: Array, lower: Array, upper: Array) -> Array:
        """Return control points (C, D) near p, inside bounds (D,), whose spline takes values (k, D) at s; both ends are kept.

        A control point that leaves its range is put onto its bound, and the others take the rest by the least change. A value
        is missed only where it needs control points outside.
        """
        A, out = self.basis(s).matrix(self.count), p.copy()
        if np.abs(rest := values - A @ out).max() > PASSED:
            out[1:-1] += np.linalg.lstsq(A[:, 1:-1], rest, rcond=None)[0]
        for j in range(p.shape[1]):
            free = np.arange(1, self.count - 1)
            while (inside := (out[free, j] >= lower[j]) & (out[free, j] <= upper[j])).sum() < free.size:
                out[1:-1, j] = np.clip(out[1:-1, j], lower[j], upper[j])
                free = free[inside]
                out[free, j] += np.linalg.lstsq(A[:, free], values[:, j] - A @ out[:, j], rcond=None)[0]
        return out


def read_breaks(data: Any) -> Array:
    """Return the knots (k,) of plain data."""
    if not isinstance(data, list) or len(data) < 2:
        raise InvalidInput("knots", repr(data)[:60], "a list of at least two numbers")
    at = read_numbers(data, (len(data),), "knots")
    if not (np.diff(at) > 0.0).all() or at[0] != 0.0 or not np.isfinite(at[-1]):
        raise InvalidInput("knots", repr(data)[:60], "increasing numbers from 0")
    return at
