"""Forward sweep of a clock to a lower rate: it brakes as hard as the limits allow, above the least viable acceleration."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.timing._brake.rows import NO_BOUND, Cells, jerks_at, lines_at
from planners.timing._brake.viability import CLOCK_RATES, bound_at, viable

SWEEP_STEPS, FEWEST_STEPS, MOST_SWEEP_STEPS = 24, 16, 300
"""Approximate number of steps of a stop, the number below which it is swept again in shorter steps, and the largest number."""
RAMP_STEPS = 8
"""Number of steps of the last ramp."""
REPAIRS, SOFTER = 12, 0.5
"""Largest number of dead ends that a sweep avoids by braking more gently before them, and the factor on b for that."""
NEGLIGIBLE = 2e-3
"""Fraction of the hardest braking by which b may fall below its least value."""
AT_GOAL, DEAD_END, TOO_SHORT, TOO_MANY_STEPS = range(4)
"""How a sweep ended: at rest, at a dead end, at the end of the cells, or after `MOST_SWEEP_STEPS`."""

State = tuple[float, float, float, float]
"""Components of a knot: x, w, b and t."""


@compiled
def _cell(x: Array, at: float, i: int) -> int:
    while i < x.shape[0] - 2 and at >= x[i + 1]:
        i += 1
    return i


@compiled
def _part(x: Array, at: float, i: int) -> float:
    return float(min(max((at - x[i]) / (x[i + 1] - x[i]), 0.0), 1.0))


@compiled
def _until(d: float, w: float, b: float, j: float, h: float) -> float:
    """Return h with w h + b h²/2 + j h³/6 = d, by Newton steps from a guess; return the guess if the clock stops before."""
    t = h
    for _ in range(5):
        rate = w + t * (b + 0.5 * t * j)
        if rate <= 0.05 * w:
            return h
        t -= (t * (w + t * (0.5 * b + t * j / 6.0)) - d) / rate
        if not 0.0 < t < 4.0 * h:
            return h
    return t


@compiled
def _ramp(
    cells: Cells, start: State, goal: float, use: tuple[float, float], part: float, line: Array, out: Array, k: int
) -> tuple[float, int]:
    """Let b < 0 rise to 0 with a fraction of the greatest j; return w − goal at its end (< 0 if w falls below) and the knot.

    The value is `NO_BOUND` if no j above 0 is allowed on the way. If `k` is at least 0, knots are written after knot k.
    """
    x, w, b, t = start
    first, i = b, _cell(cells.x, x, 0)
    for step in range(RAMP_STEPS):
        i = _cell(cells.x, x, i)
        _, _, n = lines_at(cells, i, _part(cells.x, x, i), max(w, 0.0), use[0], use[1], line)
        j = part * jerks_at(line, n, b)[1]
        if j <= 0.0:
            return NO_BOUND, k
        until = first * (1.0 - (step + 1.0) / RAMP_STEPS)
        h = (until - b) / j
        x += h * (w + h * (0.5 * b + h * j / 6.0))
        w += h * (b + 0.5 * h * j)
        b, t = until, t + h
        if w < goal and step < RAMP_STEPS - 1:
            return w - goal, k
        if k >= 0:
            k += 1
            out[0, k], out[1, k], out[2, k], out[3, k] = x, w, b, t
    return w - goal, k


@compiled
def _last_ramp(
    cells: Cells, start: State, goal: float, use: tuple[float, float], line: Array, out: Array, k: int
) -> int:
    """Write the ramp that brings b and w to the goal together, by bisection of its jerk; return the last knot, or −1."""
    low, high = 0.0, 1.0
    for _ in range(50):
        part = 0.5 * (low + high)
        if _ramp(cells, start, goal, use, part, line, out, -1)[0] > 0.0:
            high = part
        else:
            low = part
    rest, last = _ramp(cells, start, goal, use, high, line, out, k)
    if last != k + RAMP_STEPS or abs(rest) > 1e-9 * start[1]:
        return -1
    out[1, last], out[2, last] = goal, 0.0
    return last


@compiled
def sweep_clock(
    cells: Cells, begin: tuple[float, float, float], share: float, jerk: float, least: Array, out: Array
) -> tuple[int, int]:
    """Find the least b, and sweep from w and b to the goal; return how the sweep ended, and the last knot."""
    w, _, goal = begin
    viable(cells, max(w, 1.0), share, jerk, least)
    low = 0.0
    for i in range(min(4, cells.x.shape[0])):
        low = min(low, least[i, CLOCK_RATES])
    total = min(cells.x[-1] / w, 2.0 * (w - goal) / max(-low, 1e-300) + 2.0 * np.sqrt((w - goal) / jerk))
    end, k, rounds, softer = TOO_MANY_STEPS, 0, 0, 1
    for _ in range(REPAIRS):
        end, k = _sweep(cells, begin, (share, jerk), total, least, out)
        if end == DEAD_END:  # avoid it by braking more gently: the nearer to b = 0, the safer
            first, last = _cell(cells.x, out[0, max(k - softer, 0)], 0), _cell(cells.x, out[0, k], 0)
            cells.soft[first : last + 3] *= SOFTER
            viable(cells, max(w, 1.0), share, jerk, least)
            softer += 1
        elif end == AT_GOAL and k < FEWEST_STEPS and rounds < 2:
            total, rounds = out[3, k], rounds + 1
        else:
            break
    return end, k


@compiled
def _step(
    cells: Cells, i: int, at: State, use: tuple[float, float], longest: float, line: Array, least: Array, top: float
) -> tuple[float, float, float, float]:
    """Return for a step in cell i its duration, the least allowed j on it, and the least viable and possible b at its end.

    A clock with b ≤ 0 keeps b ≤ 0, because a constant rate is always allowed. If the rows force b above 0, earlier steps have
    braked too hard.
    """
    (x, w, b, _), (share, jerk) = at, use
    _, _, n = lines_at(cells, i, _part(cells.x, x, i), w, share, jerk, line)
    low, high = jerks_at(line, n, b)
    h = longest
    reach = cells.x[cells.last[i]] - x  # up to the next knot of the motion, because every step ends there
    aligned = reach < 1.3 * h * w
    if aligned:
        h = reach / w
    elif reach < 2.0 * h * w:
        h = 0.5 * reach / w
    middle = _cell(cells.x, x + 0.5 * h * w, i)
    _, _, n = lines_at(cells, middle, _part(cells.x, x + 0.5 * h * w, middle), w + 0.5 * h * b, share, jerk, line)
    m1, m2 = jerks_at(line, n, b)
    low, high = max(low, m1), max(min(high, m2), m1)
    j, need, forced = max(low, min(0.0, high)), 0.0, 0.0
    for _ in range(4):
        if aligned:
            h = _until(reach, w, b, j, h)
        x1, w1 = x + h * (w + h * (0.5 * b + h * j / 6.0)), w + h * (b + 0.5 * h * j)
        if w1 <= 0.0:
            break
        c = _cell(cells.x, x1, i)
        part = _part(cells.x, x1, c)
        need = (1.0 - part) * bound_at(least, c, w1, top) + part * bound_at(least, c + 1, w1, top)
        _, _, n = lines_at(cells, c, part, w1, share, jerk, line)
        j1, j2 = jerks_at(line, n, b + h * j)
        softest = max(low, j1)
        j = min(max(softest, (need - b) / h), max(min(high, j2), low))
        if b <= 0.0:
            j, forced = min(j, -b / h), b + h * softest
    return (_until(reach, w, b, j, h) if aligned else h), j, need, forced


@compiled
def _sweep(
    cells: Cells, begin: tuple[float, float, float], use: tuple[float, float], total: float, least: Array, out: Array
) -> tuple[int, int]:
    """Run one sweep; return how it ended, and its last knot."""
    w, b, goal = begin
    top = max(w, 1.0)
    x, t, i, k = 0.0, 0.0, 0, 0
    line = np.empty((3, cells.edge.shape[2] + 1))
    out[0, 0], out[1, 0], out[2, 0], out[3, 0] = x, w, b, t
    longest, slack = total / SWEEP_STEPS, NEGLIGIBLE * np.abs(least).max()
    while k < MOST_SWEEP_STEPS:
        h, j, need, forced = _step(cells, i, (x, w, b, t), use, longest, line, least, top)
        x1, w1, b1 = x + h * (w + h * (0.5 * b + h * j / 6.0)), w + h * (b + 0.5 * h * j), b + h * j
        rest = -1.0
        if w1 > goal:
            rest = 1.0 if b1 >= 0.0 else _ramp(cells, (x1, w1, b1, t + h), goal, use, 1.0, line, out, -1)[0]
        if rest <= 0.0:
            if b >= 0.0:  # not yet braking: shorter steps
                longest *= 0.5
                if longest < 1e-4 * total:
                    return DEAD_END, k
                continue
            last = _last_ramp(cells, (x, w, b, t), goal, use, line, out, k)
            if last < 0:
                return DEAD_END, k
            return (AT_GOAL if out[0, last] <= cells.x[-1] else TOO_SHORT), last
        if forced > slack or b1 < need - 0.05 * abs(need) - slack:
            return DEAD_END, k
        x, w, b, t, k = x1, w1, b1, t + h, k + 1
        i = _cell(cells.x, x + 1e-12 * cells.x[-1], i)
        out[0, k], out[1, k], out[2, k], out[3, k] = x, w, b, t
        if x >= cells.x[-1]:
            return TOO_SHORT, k
    return TOO_MANY_STEPS, k
