"""The pace of a reference: s(t) by two sweeps, which nearly respects the limits; tracking enforces them."""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined, parallel
from optik.types import Array

PLACES, APART = (40, 2000), 0.02
"""Least and largest number of places of a sweep, and their distance between these numbers [s]."""
HALVINGS = 22
"""Bisections of ṡ² at a place."""
VELOCITY_PART, ACCELERATION_PART, OTHER_PART = 0.995, 0.95, 0.9
"""Fractions of the limits on velocity, on acceleration, and of all others that a pace uses."""
LEAST_PACE, FADE = 0.1, 0.2
"""Least ṡ of a pace, also where the limits stop it, since tracking respects them; and its fall [1/s] at the end, in ṡ²."""
NO_RATE = 1e-9
"""Rate of a joint [1] below which it does not limit s̈."""


@inlined
def _bracket(row: Array, x: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of s̈ in [low, high] that a row (4,) over s̈, ṡ², ṡ, 1 allows at ṡ² = x; empty if low > high."""
    rest = row[1] * x + row[2] * np.sqrt(x) + row[3]
    if abs(row[0]) < NO_RATE:
        return (low, high) if abs(rest) <= 1.0 else (1.0, -1.0)
    a, b = (-1.0 - rest) / row[0], (1.0 - rest) / row[0]
    return max(low, min(a, b)), min(high, max(a, b))


@parallel
def sweep(s: Array, rows: Array, cap: Array, first: float, slowest: float, x: Array, t: Array) -> None:
    """Write the largest ṡ² x (k,) along places s (k,), from `first` to rest, and before it not below `slowest`; and times t.

    Each place has rows (k, m, 4) over s̈, ṡ², ṡ and 1, which are respected where their values are in [−1, 1], and a largest
    ṡ² cap (k,). The backward sweep finds the largest ṡ² from which the next place can be reached, by bisection.
    """
    k = s.size
    K = np.empty(k)
    for i in range(k - 1, -1, -1):
        low, high = 0.0, cap[i] if i < k - 1 else 0.0
        for trial in range(HALVINGS):
            y = high if trial == 0 else 0.5 * (low + high)
            least, most = -np.inf, np.inf
            if i < k - 1:
                step = 2.0 * (s[i + 1] - s[i])
                least, most = -y / step, (K[i + 1] - y) / step
            for j in range(rows.shape[1]):
                least, most = _bracket(rows[i, j], y, least, most)
                if least > most:
                    break
            if least <= most:
                low = y
                if trial == 0:
                    break
            else:
                high = y
        K[i] = low
    x[0], t[0] = min(first, K[0]), 0.0
    for i in range(k - 1):
        step = 2.0 * (s[i + 1] - s[i])
        most = (K[i + 1] - x[i]) / step
        for j in range(rows.shape[1]):
            _, most = _bracket(rows[i, j], x[i], -np.inf, most) if abs(rows[i, j, 0]) >= NO_RATE else (0.0, most)
        floor = min(slowest, FADE * (s[k - 1] - s[i + 1]))
        x[i + 1] = max(min(x[i] + step * most, K[i + 1]), floor)
        t[i + 1] = t[i] + step / max(np.sqrt(x[i]) + np.sqrt(x[i + 1]), NO_RATE)


@parallel
def joint_rows(R: Array, limits: Array, pace: float, rows: Array, cap: Array) -> None:
    """Write the rows of the accelerations, and the largest ṡ² by velocities, jerks and the pace.

    Shapes and units: R (k, 4, n) [rad/s^i, m/s^i], limits (n, 4, 2) of position, velocity, acceleration and jerk, lower and
    upper, rows (k, n, 4) [1], cap (k,) [1].
    """
    for i in range(R.shape[0]):
        cap[i] = pace * pace
        for j in range(R.shape[2]):
            first, second, third = R[i, 1, j], R[i, 2, j], abs(R[i, 3, j])
            if abs(first) > NO_RATE:
                v = min(limits[j, 1, 1], -limits[j, 1, 0])
                cap[i] = min(cap[i], (VELOCITY_PART * v / first) ** 2)
            if third > NO_RATE:
                cap[i] = min(cap[i], (min(limits[j, 3, 1], -limits[j, 3, 0]) / third) ** (2.0 / 3.0))
            middle = 0.5 * (limits[j, 2, 1] + limits[j, 2, 0])
            half = 0.5 * ACCELERATION_PART * (limits[j, 2, 1] - limits[j, 2, 0])
            rows[i, j, 0], rows[i, j, 1] = first / half, second / half
            rows[i, j, 2], rows[i, j, 3] = 0.0, -middle / half


@parallel
def smooth_pace(s: Array, t: Array, first: float, width: float, when: Array, out: Array) -> None:
    """Write the means of s(t) over centred windows, at instants `when`; before t = 0 the rate is `first`.

    A mean bounds the jerk of the pace. A window behind the instant would lag by half its width.
    """
    k, end = s.size, s[-1]
    integral = np.zeros(k)
    for i in range(k - 1):
        integral[i + 1] = integral[i] + 0.5 * (s[i] + s[i + 1]) * (t[i + 1] - t[i])
    for w in range(when.size):
        sides = (0.0, 0.0)
        for side in range(2):
            y = when[w] + (side - 0.5) * width
            if y <= 0.0:
                value = s[0] * y + 0.5 * first * y * y
            elif y >= t[-1]:
                value = integral[-1] + end * (y - t[-1])
            else:
                i = min(max(np.searchsorted(t, y, side="right") - 1, 0), k - 2)
                u, slope = y - t[i], (s[i + 1] - s[i]) / max(t[i + 1] - t[i], 1e-12)
                value = integral[i] + s[i] * u + 0.5 * slope * u * u
            sides = (value, sides[1]) if side == 0 else (sides[0], value)
        out[w] = min((sides[1] - sides[0]) / width, end)
