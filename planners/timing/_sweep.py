"""Motion along a path that nearly respects its jerk limits: two sweeps, and a filter of locally adapted width.

The greatest speeds are known at grid points s_i. A sweep from either end lets the speed rise within the remaining limits on
acceleration and jerk; at a speed bound it continues without acceleration. The lower of both sweeps is a motion whose
acceleration jumps only at its peaks. A moving mean in time rounds these peaks. Its width is the time to come to rest at the
greatest jerk: short near a sharp corner, long on a long straight piece. Where the motion is still too fast, it is slowed
locally.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array

GROWTH = 1.25
"""Largest ratio of the lengths of neighbouring cells."""
FIRST_CELL = 0.01
"""Length of the first and of the last cell, relative to others: from rest, s grows with the cube of time."""


ROUNDED_BREAK = 1e-9
"""Largest distance of two breaks that are one, as a fraction of the path: a cell between them would be rounding."""


def make_graded_grid(breaks: Array, end: float, count: int, per_piece: int) -> Array:
    """Return path parameters from 0 to the end, with a least number of cells in the path and in each piece between breaks.

    The first and the last cell are a hundredth of that, and neighbours differ little. Breaks that differ by rounding are one.
    """
    inner = breaks[(breaks > ROUNDED_BREAK * end) & (breaks < (1.0 - ROUNDED_BREAK) * end)]
    inner = inner[np.diff(inner, prepend=0.0) > ROUNDED_BREAK * end]
    return np.asarray(_make_grid(np.concatenate([[0.0], inner, [end]]), count, per_piece, FIRST_CELL))


@compiled
def _add_cells(length: float, left: float, right: float, most: float, out: Array, begin: int) -> int:
    """Write the cells of a piece from index `begin` on, of lengths `left` and `right` at its ends and up to `most` between."""
    x, y, k, size = 0.0, length, begin, left
    after = 0
    while True:  # from both ends in turn, the shorter first, until they meet
        if size > y - x or right > y - x:
            break
        if size <= right:
            out[k], x, k, size = size, x + size, k + 1, min(size * GROWTH, most)
        else:
            after += 1
            out[out.shape[0] - after], y, right = right, y - right, min(right * GROWTH, most)
    out[k] = y - x
    if k > begin and out[k] < 0.5 * out[k - 1]:
        out[k - 1] = out[k] = 0.5 * (out[k] + out[k - 1])
    k += 1
    for i in range(after):
        out[k] = out[out.shape[0] - after + i]
        k += 1
    return k


@compiled
def _make_grid(breaks: Array, count: int, per_piece: int, first: float) -> Array:
    """Return path parameters (m,) that include all breaks, with a least number of cells in the path and in each piece.

    The first and the last cell have the fraction `first` of the length of others, and neighbours differ little.

    Returns (m,).
    """
    k, most = breaks.shape[0] - 1, breaks[-1] / count
    pieces = np.empty(k)
    for i in range(k):
        pieces[i] = breaks[i + 1] - breaks[i]
    size = np.empty(k + 1)
    size[0], size[k] = first * min(most, pieces[0] / per_piece), first * min(most, pieces[k - 1] / per_piece)
    for i in range(1, k):
        size[i] = min(most, min(pieces[i - 1], pieces[i]) / per_piece)
    for i in range(1, k + 1):
        size[i] = min(size[i], size[i - 1] + (GROWTH - 1.0) * pieces[i - 1])
    for i in range(k - 1, -1, -1):
        size[i] = min(size[i], size[i + 1] + (GROWTH - 1.0) * pieces[i])
    cells = np.empty(2 * (count + k * (per_piece + 200)))
    m = 0
    for i in range(k):
        m = _add_cells(pieces[i], size[i], size[i + 1], min(most, pieces[i] / per_piece), cells, m)
    out = np.empty(m + 1)
    out[0], out[m] = breaks[0], breaks[k]
    i, x = 0, 0.0
    for j in range(m):
        x += cells[j]
        if j < m - 1:
            out[j + 1] = breaks[0] + x
    return out


LEFT = 0.1
"""Least fraction of a limit that remains for s̈ and s⃛ where the path's curvature uses most of it."""


class Along(NamedTuple):
    """The path at grid points (m,).

    q', q'', q''' (m, n) over s, limits on q̈ and q⃛ (n,), the greatest speeds (m,), and the greatest s̈ and s⃛ that count.
    """

    s: Array
    q1: Array
    q2: Array
    q3: Array
    acceleration: Array
    jerk: Array
    top: Array
    most: tuple[float, float]


def speed_bounds(along: Along, bends: float, twists: float) -> Array:
    """Return the greatest speeds at which the path's curvature uses given fractions of the limits on q̈ and on q⃛."""
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = np.sqrt(np.fmin.reduce(bends * along.acceleration / np.abs(along.q2), axis=1))
        twist = np.cbrt(np.fmin.reduce(twists * along.jerk / np.abs(along.q3), axis=1))
    return np.fmin(along.top, np.fmin(bend, twist))


@compiled
def _room(along: Along, i: int, v: float, a: float, slow: float) -> tuple[float, float]:
    """Return the remaining s̈ and s⃛ at a grid point, for a speed and an acceleration."""
    most_a, most_j = along.most[0] * slow**2, along.most[1] * slow**3
    for n in range(along.q1.shape[1]):
        p, q, A, J = abs(along.q1[i, n]), abs(along.q2[i, n]), along.acceleration[n] * slow**2, along.jerk[n] * slow**3
        if p * most_a > LEFT * A:
            most_a = min(most_a, max(A - q * v * v, LEFT * A) / p)
        if p * most_j > LEFT * J:
            most_j = min(most_j, max(J - 3.0 * q * v * abs(a) - abs(along.q3[i, n]) * v * v * v, LEFT * J) / p)
    return most_a, most_j


@compiled
def _time(d: float, v: float, a: float, j: float) -> float:
    """Return the time with v t + a t²/2 + j t³/6 = d, for v, a, j ≥ 0 that are not all 0, by Newton steps from above."""
    t = (6.0 * d / j) ** (1.0 / 3.0)
    if v > 0.0:
        t = min(t, d / v)
    if a > 0.0:
        t = min(t, sqrt(2.0 * d / a))
    for _ in range(20):
        off = t * (v + t * (0.5 * a + t * j / 6.0)) - d
        step = off / (v + t * (a + 0.5 * t * j))
        t -= step
        if step <= 1e-9 * t:
            break
    return float(t)


@compiled
def _rise(along: Along, top: Array, slow: Array, step: int, x: Array) -> None:
    """Lower x (m,) to the greatest speeds reachable from rest at one end, in steps of `step`."""
    m = along.s.shape[0]
    i, v, a = (0 if step > 0 else m - 1), 0.0, 0.0
    x[i] = 0.0
    for _ in range(m - 1):
        k = i + step
        d = abs(along.s[k] - along.s[i])
        most_a, most_j = _room(along, i, v, a, min(slow[i], slow[k]))
        a = min(a, most_a)
        t = _time(d, v, a, most_j)
        reached = a + most_j * t
        if reached <= most_a:
            w = v + t * (a + 0.5 * t * most_j)
        else:
            reached = most_a
            w = sqrt(v * v + (a + reached) * d)
        if w > top[k] * slow[k]:
            w = top[k] * slow[k]
            reached = max(0.0, min(reached, 0.5 * (w * w - v * v) / d))
        i, v, a = k, w, reached
        x[i] = min(x[i], v)


@compiled
def sweep_times(s: Array, v: Array, t: Array) -> None:
    """Compute the times of grid points: speeds are linear in time between them, except at the ends, where s̈ starts from 0.

    Shapes and units: s (m,) [m, rad], v (m,) [m/s, rad/s], t (m,) [s].
    """
    m = s.shape[0]
    t[0] = 0.0
    for i in range(m - 1):
        factor = 3.0 if v[i] == 0.0 or v[i + 1] == 0.0 else 2.0
        t[i + 1] = t[i] + factor * (s[i + 1] - s[i]) / (v[i] + v[i + 1])


@compiled
def _widths(along: Along, v: Array, slow: Array, t: Array, half: Array) -> None:
    """Compute half the widths (m,) of the mean: the time to rest, or to zero acceleration, with bounded slope."""
    m = v.shape[0]
    for i in range(m):
        a, j = _room(along, i, v[i], 0.0, slow[i])
        half[i] = min(min(a / j, 0.9 * sqrt(2.0 * v[i] / j)), min(t[i], t[m - 1] - t[i]))
    for i in range(1, m):
        half[i] = min(half[i], half[i - 1] + 0.5 * (t[i] - t[i - 1]))
    for i in range(m - 2, -1, -1):
        half[i] = min(half[i], half[i + 1] + 0.5 * (t[i + 1] - t[i]))


@compiled
def _value(t: Array, y: Array, x: float) -> float:
    i = min(max(np.searchsorted(t, x, side="right") - 1, 0), t.shape[0] - 2)
    return float(y[i] + (y[i + 1] - y[i]) * (x - t[i]) / (t[i + 1] - t[i]))


@compiled
def _place(s: Array, t: Array, v: Array, x: float) -> float:
    """Return s at a time: speeds are linear in time between grid points; next to rest, s is a cubic."""
    i = min(max(np.searchsorted(t, x, side="right") - 1, 0), t.shape[0] - 2)
    u, d = (x - t[i]) / (t[i + 1] - t[i]), s[i + 1] - s[i]
    if v[i] == 0.0:
        return float(s[i] + d * u**3)
    if v[i + 1] == 0.0:
        return float(s[i + 1] - d * (1.0 - u) ** 3)
    return float(s[i] + d * u * (2.0 * v[i] + u * (v[i + 1] - v[i])) / (v[i] + v[i + 1]))


@compiled
def _smooth(along: Along, v: Array, slow: Array, t: Array, half: Array, out: Array) -> None:
    """Compute mean speeds (m,) over the time around each grid point."""
    m = v.shape[0]
    sweep_times(along.s, v, t)
    _widths(along, v, slow, t, half)
    out[0], out[m - 1] = 0.0, 0.0
    for i in range(1, m - 1):
        h = half[i]
        if h < 1e-3 * (t[i + 1] - t[i - 1]):
            out[i] = v[i]
        else:
            out[i] = (_place(along.s, t, v, t[i] + h) - _place(along.s, t, v, t[i] - h)) / (2.0 * h)


@compiled
def _accelerations(s: Array, v: Array, t: Array, a: Array) -> None:
    """Compute s̈ (m,) from speeds, by parabolas through three grid points, and times t (m,) that agree with both."""
    m = s.shape[0]
    a[0], a[m - 1] = 0.0, 0.0
    for i in range(1, m - 1):
        before, after = t[i] - t[i - 1], t[i + 1] - t[i]
        a[i] = ((v[i] - v[i - 1]) / before * after + (v[i + 1] - v[i]) / after * before) / (before + after)
    begin = t[0]
    for i in range(m - 1):
        h, mean = t[i + 1] - begin, 0.5 * (v[i] + v[i + 1])
        begin = t[i + 1]
        mean = max(mean - h * (a[i + 1] - a[i]) / 12.0, 0.5 * mean)
        t[i + 1] = t[i] + (s[i + 1] - s[i]) / mean


@compiled
def _ratios(along: Along, v: Array, a: Array, t: Array, half: Array, out: Array) -> float:
    """Compute the factors (m,) by which the motion is too fast at grid points; return the largest."""
    m, worst = v.shape[0], 0.0
    for i in range(m):
        low, high = max(i - 1, 0), min(i + 1, m - 1)
        before = max(t[i] - max(0.25 * half[i], t[i] - t[low]), 0.0)
        after = min(t[i] + max(0.25 * half[i], t[high] - t[i]), t[m - 1])
        j = (_value(t, a, after) - _value(t, a, before)) / (after - before)
        ratio = v[i] / along.top[i]
        asked_a, asked_j = 0.0, 0.0
        for n in range(along.q1.shape[1]):
            p, q, r = along.q1[i, n], along.q2[i, n], along.q3[i, n]
            asked_a = max(asked_a, abs(p * a[i] + q * v[i] * v[i]) / along.acceleration[n])
            asked_j = max(asked_j, abs(p * j + 3.0 * q * v[i] * a[i] + r * v[i] * v[i] * v[i]) / along.jerk[n])
        out[i] = max(ratio, max(sqrt(asked_a), asked_j ** (1.0 / 3.0)))
        worst = max(worst, out[i])
    return worst


@compiled
def _slow_down(t: Array, half: Array, ratio: Array, slow: Array) -> None:
    """Slow the motion by its excess ratios within the width of the mean."""
    m = t.shape[0]
    peak, hold = 1.0, 0.0
    for i in range(m):  # the largest ratio holds for half a width
        if i > 0 and t[i] > hold:
            peak = 1.0
        if ratio[i] >= peak:
            peak, hold = ratio[i], t[i] + half[i]
        slow[i] /= max(peak, 1.0)
    peak, hold = 1.0, t[m - 1]
    for i in range(m - 1, -1, -1):
        if t[i] < hold:
            peak = 1.0
        if ratio[i] >= peak:
            peak, hold = ratio[i], t[i] - half[i]
        if peak > ratio[i]:
            slow[i] /= peak


@compiled
def sweep_path(along: Along, top: Array, rounds: int, close: float, out: Array) -> float:
    """Compute a motion from rest to rest that nearly respects the limits; return its largest excess ratio.

    Shapes and units: top (m,) [m/s, rad/s], close [1], out (4, m) [s]. Returns [1].
    """
    m = along.s.shape[0]
    slow, v, ratio = np.ones(m), np.empty(m), np.empty(m)
    t, mean, a, half = out[0], out[1], out[2], out[3]
    worst = 0.0
    for k in range(rounds):
        for i in range(m):
            v[i] = top[i] * slow[i]
        _rise(along, top, slow, 1, v)
        _rise(along, top, slow, -1, v)
        _smooth(along, v, slow, t, half, mean)
        sweep_times(along.s, mean, t)
        _accelerations(along.s, mean, t, a)
        worst = _ratios(along, mean, a, t, half, ratio)
        if worst <= close or k == rounds - 1:
            break
        _slow_down(t, half, ratio, slow)
    return worst


@compiled
def _widen(t: Array, half: Array) -> None:
    """Set one width on the ramps from rest and to rest: that of their ends."""
    i, k = 1, t.shape[0] - 2
    while i < k and half[i] > 0.5 * t[i]:
        i += 1
    while k > i and half[k] > 0.5 * (t[t.shape[0] - 1] - t[k]):
        k -= 1
    half[:i], half[k + 1 :] = half[i], half[k]


@compiled
def _changes(along: Along, motion: Array, out: Array) -> None:
    """Compute the total changes (m,) of q̈, and of q⃛ by the path's curvature, up to each grid point, of the largest joint.

    Both are relative to their limits, or to the change of q̈ that the jerk limit allows within half the width of the mean, if
    that is less. s̈ counts likewise relative to its greatest value, for ramps where only speeds are limited.
    """
    v, a, half = motion[1], motion[2], motion[3]
    out[0] = 0.0
    for i in range(v.shape[0] - 1):
        h = max(half[i], half[i + 1])
        most = abs(a[i + 1] - a[i]) / min(along.most[0], h * along.most[1])
        for n in range(along.q1.shape[1]):
            before = along.q1[i, n] * a[i] + along.q2[i, n] * v[i] * v[i]
            after = along.q1[i + 1, n] * a[i + 1] + along.q2[i + 1, n] * v[i + 1] * v[i + 1]
            most = max(most, abs(after - before) / min(along.acceleration[n], h * along.jerk[n]))
            before = (3.0 * along.q2[i, n] * a[i] + along.q3[i, n] * v[i] * v[i]) * v[i]
            after = (3.0 * along.q2[i + 1, n] * a[i + 1] + along.q3[i + 1, n] * v[i + 1] * v[i + 1]) * v[i + 1]
            most = max(most, abs(after - before) / along.jerk[n])
        out[i + 1] = out[i] + most


@compiled
def count_intervals(
    along: Along, motion: Array, even: float, per_change: tuple[float, float, float], least: float, share: Array
) -> float:
    """Count the intervals before each grid point of a swept motion: a constant number, and some per change of q̈ by its limit.

    The number per change is the first of `per_change` for motions of few changes, and falls to the second for motions with far
    more changes than the third. No interval is shorter than `least`; neighbours differ little.

    Shapes and units: motion (4, m) [s, m/s, m/s², s], per_change (3,), least [s], share (m,) [1].
    """
    t, half = motion[0], motion[3]
    m = t.shape[0]
    change, length = np.empty(m), np.empty(m)
    _widen(t, half)
    _changes(along, motion, change)
    few, many, some = per_change
    each = many + (few - many) * min(1.0, some / max(change[m - 1], 1e-300))
    for i in range(m):
        w = max(0.2 * half[i], t[min(i + 1, m - 1)] - t[max(i - 1, 0)])
        before, after = max(t[i] - w, 0.0), min(t[i] + w, t[m - 1])
        length[i] = least + 1.0 / (
            even / t[m - 1] + each * (_value(t, change, after) - _value(t, change, before)) / (after - before)
        )
    for i in range(1, m):
        length[i] = min(length[i], length[i - 1] + 0.3 * (t[i] - t[i - 1]))
    for i in range(m - 2, -1, -1):
        length[i] = min(length[i], length[i + 1] + 0.3 * (t[i + 1] - t[i]))
    share[0] = 0.0
    for i in range(m - 1):
        share[i + 1] = share[i] + 0.5 * (t[i + 1] - t[i]) * (1.0 / length[i] + 1.0 / length[i + 1])
    return float(share[m - 1])


@compiled
def sample(s: Array, motion: Array, when: Array, out: Array) -> None:
    """Compute s, ṡ and s̈ of a swept motion at times; ṡ is a cubic between grid points.

    For s both s̈ are clipped so that the cubic's Bézier points are not below 0: s does not decrease.

    Shapes and units: s (m,) [m, rad], motion (4, m) [s, m/s, m/s², s], when (k,) [s], out (3, k) [m, m/s, m/s², or rad].
    """
    t, v, a = motion[0], motion[1], motion[2]
    for k in range(when.shape[0]):
        i = min(max(np.searchsorted(t, when[k], side="right") - 1, 0), t.shape[0] - 2)
        h = t[i + 1] - t[i]
        u = (when[k] - t[i]) / h
        first, last = max(h * a[i], -3.0 * v[i]), min(h * a[i + 1], 3.0 * v[i + 1])
        c2 = 3.0 * (v[i + 1] - v[i]) - (2.0 * first + last)
        c3 = 2.0 * (v[i] - v[i + 1]) + (first + last)
        whole = v[i] + first / 2.0 + c2 / 3.0 + c3 / 4.0
        area = u * (v[i] + u * (first / 2.0 + u * (c2 / 3.0 + u * c3 / 4.0)))
        out[0, k] = s[i] + (s[i + 1] - s[i]) * min(max(area / whole, 0.0), 1.0)
        c2 = 3.0 * (v[i + 1] - v[i]) - h * (2.0 * a[i] + a[i + 1])
        c3 = 2.0 * (v[i] - v[i + 1]) + h * (a[i] + a[i + 1])
        out[1, k] = max(v[i] + u * (h * a[i] + u * (c2 + u * c3)), 0.5 * min(v[i], v[i + 1]))
        out[2, k] = a[i] + u * (2.0 * c2 + 3.0 * u * c3) / h
