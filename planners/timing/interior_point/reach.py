"""Time optimum under velocity and acceleration limits, and a smooth initial guess from it; compiled.

With x = ṡ² the limits on acceleration are linear, |q' x'/2 + q'' x| ≤ a_max, so the greatest x that can still be brought to
rest is found by one pass backwards, and the motion by one pass forwards (Pham and Pham, IEEE T-RO 2018).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik.compiled import compiled
from optik.types import Array


@compiled
def _room(q1: Array, q2: Array, bound: tuple[Array, Array], x: float) -> tuple[float, float]:
    """Return the least and the greatest s̈ that the joints allow at x = ṡ²; least > greatest if none."""
    low, high = -1e300, 1e300
    for i in range(q1.shape[0]):
        down, up = bound[0][i], bound[1][i]
        if up == np.inf:
            continue
        if abs(q1[i]) * 1e12 < min(-down, up) and abs(q1[i]) < 1e-12:
            if not down <= q2[i] * x <= up:
                return 1.0, -1.0
            continue
        a, b = (down - q2[i] * x) / q1[i], (up - q2[i] * x) / q1[i]
        low, high = max(low, min(a, b)), min(high, max(a, b))
    return low, high


@compiled
def find_fastest(
    s: Array, q1: Array, q2: Array, speed: Array, bound: tuple[Array, Array], first: float, x: Array
) -> bool:
    """Compute the greatest x = ṡ² from a speed to rest, under bounds on q̈ and on ṡ; return whether the first speed is feasible.

    Shapes and units: s (k,) [m, rad], q1, q2 (k, n) [as q over powers of s], speed (k,) [m/s, rad/s], bound: the
    lower and the upper side (n,) [rad/s², m/s²], x (k,) [m²/s², rad²/s²].
    """
    k = s.shape[0]
    x[k - 1] = 0.0
    for i in range(k - 2, -1, -1):  # the greatest x from which x[i + 1] or less can be reached
        d = 2.0 * (s[i + 1] - s[i])
        top = min(speed[i] * speed[i], 1e300)
        low, high = 0.0, top
        for trial in range(60):
            y = high if trial == 0 else 0.5 * (low + high)
            least, most = _room(q1[i], q2[i], bound, y)
            good = least <= most and y + d * least <= x[i + 1] and y + d * most >= 0.0
            if good:
                low = y
                if trial == 0:
                    break
            else:
                high = y
            if high - low <= 1e-12 * high:
                break
        x[i] = low
    good = bool(first <= x[0] * 1.2)  # the grid is coarse: the programme itself will tell
    x[0] = min(first, x[0])
    for i in range(k - 1):
        d = 2.0 * (s[i + 1] - s[i])
        _, most = _room(q1[i], q2[i], bound, x[i])
        x[i + 1] = max(min(x[i + 1], x[i] + d * most), 0.0)
    return good


@compiled
def compute_times(s: Array, x: Array, t: Array) -> None:
    """Compute the times of grid points, with constant s̈ between them.

    Shapes and units: s (k,) [m, rad], x (k,) [m²/s², rad²/s²], t (k,) [s].
    """
    t[0] = 0.0
    for i in range(s.shape[0] - 1):
        v = sqrt(x[i]) + sqrt(x[i + 1])
        t[i + 1] = t[i] + 2.0 * (s[i + 1] - s[i]) / max(v, 1e-300)


@compiled
def filter_motion(t: Array, s: Array, v: Array, width: float, at: Array, out: Array) -> None:
    """Compute a motion smoothed by a box filter (moving mean in time), at given times.

    The motion is at rest before and after. Filtered ṡ(t) = (s(t) − s(t − w)) / w, so it ends where the motion ends.

    Shapes and units: t (k,) [s], s (k,) [m, rad], v (k,) [m/s, rad/s], width [s], at (m,) [s], out (3, m)
    [m, m/s, m/s², or rad].
    """
    whole = np.empty(t.shape[0])  # ∫ s dt to each knot, s quadratic between
    whole[0] = 0.0
    for i in range(t.shape[0] - 1):
        h = t[i + 1] - t[i]
        whole[i + 1] = whole[i] + h * s[i] + h * h * (2.0 * v[i] + v[i + 1]) / 6.0
    for m in range(at.shape[0]):
        area, place, speed = np.empty(2), np.empty(2), np.empty(2)
        for side in range(2):
            x = at[m] - side * width
            if x <= 0.0:
                area[side], place[side], speed[side] = s[0] * x, s[0], 0.0
            elif x >= t[-1]:
                area[side], place[side], speed[side] = whole[-1] + s[-1] * (x - t[-1]), s[-1], 0.0
            else:
                i = np.searchsorted(t, x, side="right") - 1
                u, h = x - t[i], t[i + 1] - t[i]
                a = (v[i + 1] - v[i]) / h
                area[side] = whole[i] + u * (s[i] + u * (0.5 * v[i] + u * a / 6.0))
                place[side] = s[i] + u * (v[i] + 0.5 * a * u)
                speed[side] = v[i] + a * u
        out[0, m] = (area[0] - area[1]) / width
        out[1, m] = (place[0] - place[1]) / width
        out[2, m] = (speed[0] - speed[1]) / width
