"""The reference of a chunk, the smoothest spline within a tolerance of its points, and the motions nearest to targets."""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined, parallel
from optik.types import Array, Indices
from planners.streams.interior import MOST_STEPS, ROWS, add_weighted, make_factors, make_stencils, minimise
from planners.streams.motion import SAME_TIME, integrate

# ---------------- the reference of a chunk


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


# ---------------- tracking


TIGHT = 0.03
"""Fraction of the range of velocities: if the velocity after the acceleration is ended comes nearer to its limit than this, the
acceleration is ended first, in a piece of its own."""
BEYOND = 1e-6
"""Relative excess of the initial acceleration over its limit that counts as rounding."""
CUT = (2.0 * np.pi * 40.0) ** -6
"""Weight of the squared jerk: the tracking follows targets of up to 40 Hz [s⁶]."""
HOLD = 2.0
"""Weight of the distance to the last target after its instant, over that before."""
SPARE, INWARDS = 1e-7, 2e-7
"""Fraction of the limits, and distance to the range ends [rad, m], that are left unused for rounding of the iteration."""
ROOM = 1.1
"""Time after the last target in which the arm comes to rest, over the time of a stop from the largest velocity."""
SET_UP = 10
"""Work of an interval of a spline before the first iteration, over that of an iteration."""
LEAST_INTERVALS, SHORTER_INTERVALS = 6, 60
"""Least number of intervals of a spline, and room for the intervals before the longest ones."""
FIRST_INTERVAL, GROWTH = (2e-3, 0.02), (1.6, 1.2)
"""Least and largest first interval [s], 0.3 times that in which the acceleration can change wholly; the ratio of intervals that
follow each other, if that time is below the largest first interval, or not."""


@inlined
def lay_grid(begin: float, end: float, first: float, growth: float, longest: float, T: Array) -> int:
    """Write breakpoints T from `begin` to `end` or later [s], whose distances grow to `longest`; return their number."""
    T[0], k, h = begin, 0, first
    while (T[k] < end or k < LEAST_INTERVALS) and k < T.size - 1:
        k += 1
        T[k] = T[k - 1] + h
        h = min(h * growth, longest)
    return k + 1


@inlined
def _ramp(x: Array, limits: Array, knots: Array, c: Array) -> int:
    """Write the cubic that first changes the acceleration of a state x (3,) with the largest jerk, if needed.

    The acceleration is ended near the velocity limit, and brought to its own limit from beyond it. The state is replaced by the
    state after the cubic. Returns the number of cubics, 0 or 1.
    """
    v, a, knots[0] = x[1], x[2], 0.0
    if a == 0.0:
        return 0
    up = a > 0.0
    jerk, most = limits[3, 0 if up else 1], limits[2, 1 if up else 0]
    then = v - 0.5 * a * a / jerk  # when the acceleration is ended
    room = limits[1, 1] - then if up else then - limits[1, 0]
    after = a if abs(a) <= (1.0 + BEYOND) * abs(most) else most
    if room < TIGHT * (limits[1, 1] - limits[1, 0]):
        after = 0.0
    count = _add_piece(x, (after - a) / jerk, jerk, 0, knots, c)
    if count:
        x[2] = after
    return count


@inlined
def _basis(T: Array, x: float, b: Array) -> int:
    """Write the four cubic B-splines b (4,) at x over breakpoints T (N + 1,); return the index of the first one."""
    N = T.size - 1
    k = min(max(int(np.searchsorted(T, x, side="right")) - 1, 0), N - 1)
    b[0] = 1.0
    for j in range(1, 4):
        saved = 0.0
        for r in range(j):
            right, left = T[min(k + r + 1, N)], T[max(k + r + 1 - j, 0)]
            part = b[r] / (right - left)
            b[r] = saved + (right - x) * part
            saved = (x - left) * part
        b[j] = saved
    return k


@inlined
def make_objective(T: Array, when: Array, weight: Array, A: Array, H: Array, B: Array, at: Indices) -> None:
    """Write the bands H (4, N + 3) of the objective, and the basis B (k, 4) and its first indices at the instants.

    The objective is Σ ½ weight (q(when) − target)² + ½ CUT ∫ q⃛².
    """
    H[:] = 0.0
    w = np.zeros((4, H.shape[1]))
    for i in range(T.size - 1):
        w[3, i] = CUT * (T[i + 1] - T[i])
    add_weighted(A, w, H)
    for i in range(when.size):
        if when[i] <= T[0]:
            at[i] = -1
            continue
        at[i] = _basis(T, when[i], B[i])
        for a in range(4):
            for d in range(a + 1):
                H[d, at[i] + a] += weight[i] * B[i, a] * B[i, a - d]


@parallel
def track_targets(
    state: Array, limits: Array, when: Array, target: Array, longest: float, budget: int
) -> tuple[int, int, Array, Indices, Array]:
    """Compute the joint motions nearest to targets, from a state to rest; one without a motion from the state is stopped first.

    Returns the index of the first joint without a motion (−1 if none, −2 above the budget), the work in intervals times
    iterations, and the motions (knots, counts, cubics).

    Shapes and units: state (3, n) [rad/s^i, m/s^i], limits (n, 4, 2) of position to jerk, lower and upper, when (k,) [s],
    target (k, n) [rad, m], longest [s]. The motions have knots (n, K) [s], counts (n,), cubics (n, 4, K), highest power first.
    """
    n, last, (ramp, end) = state.shape[1], when.size - 1, _find_horizon(state, limits, when[-1], target[-1])
    first, growth = min(0.3 * ramp, FIRST_INTERVAL[1], longest), GROWTH[0] if ramp < FIRST_INTERVAL[1] else GROWTH[1]
    first = max(first, min(FIRST_INTERVAL[0], longest))
    if not n * (end / longest + SHORTER_INTERVALS) * SET_UP <= budget:
        return -2, 0, np.empty((n, 0)), np.empty(n, dtype=np.int64), np.empty((n, 4, 0))
    most, used = int(end / longest) + SHORTER_INTERVALS, 0
    knots, count, c = np.empty((n, most)), np.empty(n, dtype=np.int64), np.empty((n, 4, most))
    control, x0, box = np.empty(most), np.empty(3), np.empty((4, 2))
    t, w = np.empty(when.size + most), np.empty(when.size + most)
    B, at, jerk = np.empty((t.size, 4)), np.empty(t.size, dtype=np.int64), np.empty(most)
    f, A, H, W = np.empty((3, 0)), np.empty((9, 0)), np.empty((4, 0)), np.empty((17, 4, 0))
    rest = np.array([np.nan, 0.0, 0.0])
    usual, samples = False, 0  # whether the spline is that of a joint without a lead
    for j in range(n):
        for tries in range(2):
            for i in range(3):
                x0[i] = state[i, j]
            lead = _ramp(x0, limits[j], knots[j], c[j]) if tries == 0 else _stop(x0, limits[j], knots[j], c[j])
            N = lay_grid(knots[j, lead], end, first, growth, longest, knots[j, lead:]) - 1
            T, size = knots[j, lead : lead + N + 1], N + 3
            count[j] = N + 1 + lead
            if lead or not usual:
                f, A, H, W = np.empty((3, size)), np.empty((9, size)), np.empty((4, size)), np.empty((17, 4, size))
                make_factors(T, f)
                make_stencils(f, A)
                samples = _list_instants(T, when, longest, t, w)
                make_objective(T, t[:samples], w[:samples], A, H, B, at)
                usual = not lead
            control[0] = x0[0]
            control[1] = x0[0] + x0[1] / f[0, 0]
            control[2] = control[1] + (x0[1] + x0[2] / f[1, 0]) / f[0, 1]
            g = np.zeros(size)
            for i in range(samples):
                for a in range(4):
                    if at[i] >= 0:
                        g[at[i] + a] -= w[i] * B[i, a] * target[min(i, last), j]
            box[:] = limits[j]
            box[0, 0], box[0, 1] = min(box[0, 0] + INWARDS, x0[0]), max(box[0, 1] - INWARDS, x0[0])
            allowed = min(MOST_STEPS, max((budget - used) // N - SET_UP, 0))
            steps = minimise((f, A), H, g, box, control[:size], W, allowed)
            used += N * (SET_UP + (steps if steps >= 0 else allowed))
            if steps >= 0 or allowed < MOST_STEPS:
                break
        if steps < 0:
            return j if allowed == MOST_STEPS else -2, used, knots, count, c
        for i in range(N):
            jerk[i] = W[ROWS, 3, i]
        integrate(T, jerk[:N], x0, rest, c[j, :, lead:])
    return -1, used, knots, count, c


@inlined
def _find_horizon(state: Array, limits: Array, last: float, target: Array) -> tuple[float, float]:
    """Return the longest change of an acceleration [s], and the time in which all joints rest at their last targets (n,)."""
    ramp, end = 0.0, 0.0
    for j in range(target.size):
        v, a = max(limits[j, 1, 1], -limits[j, 1, 0]), min(limits[j, 2, 1], -limits[j, 2, 0])
        jmax = min(limits[j, 3, 1], -limits[j, 3, 0])
        own, flat = a / jmax, abs(state[2, j]) / jmax
        ramp = max(ramp, own)
        fast = state[1, j] + 0.5 * flat * state[2, j]  # when the acceleration is 0
        stop = abs(fast) / a + own
        away = abs(target[j] - state[0, j] - flat * state[1, j] - 0.5 * stop * fast)
        reach = flat + stop + away / min(limits[j, 1, 1], -limits[j, 1, 0])
        end = max(end, max(last, reach) + ROOM * (v / a + own))
    return ramp, end


@inlined
def _add_piece(x: Array, h: float, jerk: float, i: int, knots: Array, c: Array) -> int:
    """Write cubic i, with a jerk for h [s], from a state x (3,), which is replaced by the state after it; return i + 1 or i."""
    if h < SAME_TIME:
        return i
    q, v, a = x[0], x[1], x[2]
    c[0, i], c[1, i], c[2, i], c[3, i] = jerk / 6.0, 0.5 * a, v, q
    x[0], x[1], x[2] = q + h * (v + h * (0.5 * a + h * jerk / 6.0)), v + h * (a + 0.5 * h * jerk), a + h * jerk
    knots[i + 1] = knots[i] + h
    return i + 1


@inlined
def _stop(x: Array, limits: Array, knots: Array, c: Array) -> int:
    """Write the cubics of the shortest stop of a state x (3,), which is replaced by the state after it; return their number.

    No motion inside the limits goes further, so the joint stops inside its range if any motion stays there. The limits are used
    wholly, as the running motion may use them.
    """
    down, up, knots[0] = -limits[3, 0] / (1.0 - SPARE), limits[3, 1] / (1.0 - SPARE), 0.0
    then = x[1] + 0.5 * x[2] * abs(x[2]) / (down if x[2] > 0.0 else up)  # when the acceleration is ended
    side = 1.0 if then > 0.0 else -1.0
    first, last, most = (down, up, -limits[2, 0]) if then > 0.0 else (up, down, limits[2, 1])
    v, a = side * x[1], side * x[2]
    lost = v + 0.5 * a * a / first  # by the deceleration
    peak = max(min(np.sqrt(2.0 * max(lost, 0.0) / (1.0 / first + 1.0 / last)), most / (1.0 - SPARE)), -a)
    hold = (lost - 0.5 * peak * peak * (1.0 / first + 1.0 / last)) / max(peak, 1e-9)
    i = _add_piece(x, (a + peak) / first, -side * first, 0, knots, c)
    i = _add_piece(x, hold, 0.0, i, knots, c)
    return _add_piece(x, peak / last, side * last, i, knots, c)


@inlined
def _list_instants(T: Array, when: Array, longest: float, t: Array, w: Array) -> int:
    """Write the instants of the targets and of the hold after them, with their weights; return their number."""
    k = when.size
    for i in range(k):
        t[i], w[i] = when[i], 0.5 * longest
    for i in range(T.size):
        if T[i] > when[-1] + 0.25 * longest:
            t[k], w[k] = T[i], HOLD * longest
            k += 1
    return k
