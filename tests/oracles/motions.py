"""Motions: polynomials in pieces by Horner's rule, their extrema by brute force, and what uniform bounds allow at best."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import PPoly
from scipy.optimize import minimize_scalar

Array = Any


def piece_values(c: Array, u: Array, order: int) -> Array:
    """Derivatives (k, n) at u (k,) after the starts of pieces with coefficients c (degree + 1, k, n)."""
    degree = len(c) - 1
    out = np.zeros(c.shape[1:])
    for i in range(degree - order + 1):
        power = degree - i
        factor = float(np.prod(np.arange(power - order + 1, power + 1)))
        out = out * u[:, None] + factor * c[i]
    return out


class Joints:
    """A motion's polynomials."""

    def __init__(self, motion: Any) -> None:
        self.t, self.c = np.array(motion.knots), np.array(motion.coefficients)

    def __call__(self, t: Array, order: int = 0) -> Array:
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        return piece_values(self.c[:, i], t - self.t[i], order)

    def ends(self, order: int) -> tuple[Array, Array]:
        """One-sided values at the first and the last instant of every piece."""
        h = np.diff(self.t)
        return piece_values(self.c, np.zeros_like(h), order), piece_values(self.c, h, order)


def value(motion: Any, t: float, order: int, k: int | None = None) -> Array:
    """Value of a derivative at t (n,), by the piece k, or by the piece that holds t."""
    x = motion.knots
    k = int(np.clip(np.searchsorted(x, t, side="right") - 1, 0, len(x) - 2)) if k is None else k
    return piece_values(motion.coefficients[:, [k]], np.array([t - x[k]]), order)[0]


def brute_extrema(motion: Any, order: int, points: int = 200_000) -> tuple[Array, Array, Array, Array]:
    """Least and greatest value of each joint and when: dense sampling piece by piece, refined by SciPy's bounded search."""
    x, n = motion.knots, motion.n
    per_piece = max(points // (len(x) - 1), 3)
    best = np.full((2, n), np.inf)
    when = np.zeros((2, n))
    for k in range(len(x) - 1):
        h = x[k + 1] - x[k]
        u = np.linspace(0.0, h, per_piece)
        for j in range(n):
            c = polynomial.polyder(motion.coefficients[::-1, k, j], order)
            dense = polynomial.polyval(u, c)
            for row, sign in enumerate((1.0, -1.0)):
                i = int(np.argmin(sign * dense))
                found, at = sign * dense[i], u[i]
                low, high = u[max(i - 1, 0)], u[min(i + 1, per_piece - 1)]
                fine: Any = minimize_scalar(
                    lambda w, c=c, sign=sign: sign * polynomial.polyval(w, c),
                    bounds=(low, high), method="bounded", options={"xatol": 1e-14 * h},
                )  # fmt: skip
                if fine.fun < found:
                    found, at = fine.fun, fine.x
                if found < best[row, j]:
                    best[row, j], when[row, j] = found, x[k] + at
    return best[0], -best[1], when[0], when[1]


def difference(f: Callable[[Array], Array], x: Array, h: Any) -> Array:
    """First derivative at x (k,) by central differences of eighth order, with one step h or one for each place (k,)."""
    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    total = np.asarray(sum(w * (f(x + k * h) - f(x - k * h)) for k, w in weights))
    return total / np.reshape(h, (-1, *[1] * (total.ndim - 1)) if np.ndim(h) else ())


def s_curve(end: float, jerk: float, ramp: float, hold: float = 0.0) -> PPoly:
    """s(t) from rest to rest in eight phases or fewer: jerk +, 0, −, 0, −, 0, +, scaled so that it ends at `end`."""
    phases = [(jerk, ramp), (0.0, hold), (-jerk, ramp), (0.0, 0.3), (-jerk, ramp), (0.0, hold), (jerk, ramp)]
    phases = [(j, h) for j, h in phases if h > 0.0]
    t, s, v, a, rows = [0.0], 0.0, 0.0, 0.0, []
    for j, h in phases:
        rows.append([j / 6, a / 2, v, s])
        s, v, a = s + v * h + a * h * h / 2 + j * h**3 / 6, v + a * h + j * h * h / 2, a + j * h
        t.append(t[-1] + h)
    return PPoly(np.array(rows).T * (end / s), np.array(t))


def double_s(length: float, v: Array, a: Array, j: Array) -> Array:
    """Duration from rest to rest under bounds on speed, acceleration and jerk (Biagiotti and Melchiorri, §3.4)."""
    ramp = np.where(v * j >= a * a, v / a + a / j, 2.0 * np.sqrt(v / j))
    cruising = length / v + ramp
    with np.errstate(invalid="ignore"):
        peak = 0.5 * a * (np.sqrt((a / j) ** 2 + 4.0 * length / a) - a / j)
        trapezoid = 2.0 * (peak / a + a / j)
    wedge = 4.0 * np.cbrt(length / (2.0 * j))
    short = np.where(peak >= a * a / j, trapezoid, wedge)
    return np.asarray(np.where(length >= v * ramp, cruising, short))


def best_uniform(joint_path: Any, velocity: float, acceleration: float, jerk: float) -> float:
    """Duration of the best motion whose bounds on ṡ, s̈, s⃛ are the same all along the path: a fine grid, no wit."""
    s = np.linspace(0.0, joint_path.end, 151)
    q1, q2, q3 = (np.abs(joint_path(s, order)).reshape(-1, 1) for order in (1, 2, 3))
    best = np.inf
    shares = np.geomspace(1e-3, 1.0, 200)
    fastest = min(velocity / q1.max(), np.sqrt(acceleration / q2.max()), np.cbrt(jerk / q3.max()))
    for v in fastest * np.geomspace(1e-3, 1.0, 150):
        a = shares * ((acceleration - q2 * v * v) / q1).min()
        j = ((jerk - 3.0 * q2 * v * a - q3 * v**3) / q1).min(axis=0)
        good = (a > 0.0) & (j > 0.0)
        if good.any():
            best = min(best, float(double_s(joint_path.end, np.full(good.sum(), v), a[good], j[good]).min()))
    return best
