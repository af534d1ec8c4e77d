"""Quintic Hermite interpolation of values, first and second derivatives at knots."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from optik.types import Array


def quintic(x: Array, left: tuple[Array, Array, Array], right: tuple[Array, Array, Array]) -> Any:
    """Return the piecewise polynomial of degree 5 with these ends (Biagiotti and Melchiorri, Trajectory Planning, §2.1.6)."""
    h = np.diff(x)[:, None]
    p0, v0, a0 = left
    p1, v1, a1 = right
    P = p1 - (p0 + h * (v0 + 0.5 * h * a0))
    V = h * (v1 - (v0 + h * a0))
    A = h * h * (a1 - a0)
    c = np.empty((6, *p0.shape))
    c[5] = p0
    c[4] = v0
    c[3] = 0.5 * a0
    c[2] = (10.0 * P - 4.0 * V + 0.5 * A) / h**3
    c[1] = (-15.0 * P + 7.0 * V - A) / h**4
    c[0] = (6.0 * P - 3.0 * V + 0.5 * A) / h**5
    return scipy.interpolate.PPoly(c, x, extrapolate=True)


def quintic_through(x: Array, p: Array, v: Array, a: Array) -> Any:
    """Return the quintic spline through values at the knots, with continuous second derivatives."""
    return quintic(x, (p[:-1], v[:-1], a[:-1]), (p[1:], v[1:], a[1:]))
