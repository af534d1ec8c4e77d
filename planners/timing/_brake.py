"""Brake a running motion as hard as its limits allow: a sweep of its clock to rest.

The motion q(τ) is run by a clock τ(t) whose rate w = τ̇ falls from 1 to 0, or to a goal. In w, b = τ̈ and j = τ⃛ every limit
is a row: of the second order on b, w² and w, of the third on j. A clock at any constant rate w ≤ 1 respects the limits, since
the motion does. The least b from which b = 0 can still be reached in time is found backwards (viability). The sweep goes
forwards with the least j that keeps b above it, until the greatest j brings b to 0 and w to its goal together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array, Indices
from planners.certificate.examined import examined
from planners.curve import composed
from planners.hermite import quintic
from planners.limits import MotionLimits, PathPoints
from planners.limits._loaded import LoadedLimit
from planners.limits.base import Limit
from planners.trajectory import Trajectory

STEPS, FEWEST_STEPS, MOST_STEPS = 24, 16, 300
"""Steps of a stop, about; fewer are swept again in shorter ones, and more are none."""
RAMP_STEPS = 8
"""Steps of the last ramp."""
PARTS = 2
"""Cells of each piece of the motion: between their ends the rows are interpolated."""
CELLS = 20
"""Least number of cells of the part of the motion that is looked at."""
RATES = 8
"""Rates of the clock for which the least b is found."""
BISECTIONS = 7
"""Halvings of the interval of b in that search."""
ROUNDS, SPARE = 5, 2e-3
"""Sweeps at most, each with rows tightened where the last one exceeds a limit between its knots, and by how much more."""
REPAIRS, SOFTER = 12, 0.5
"""Dead ends of a sweep that are passed by a gentler brake before them, and by what factor on b it is gentler."""
NEGLIGIBLE = 2e-3
"""Fraction of the hardest braking by which b may be below the least one."""
QUICK_RAMP = 0.02
"""Fraction of a stop's duration in which b reaches its bound where no limit on a jerk holds."""
AHEAD = 1.0
"""Part of the motion that is looked at, over what a stop from its start would need under constant limits."""
NONE = 1e300
"""A bound that is none."""
DONE, DEAD_END, TOO_SHORT, TOO_LONG = range(4)
"""How a sweep ended: at rest, at a dead end, at the end of the cells, or after `MOST_STEPS`."""


class Course(NamedTuple):
    """A running motion as its limits see it: the points of a curve of the robot's joints."""

    robot: Robot
    trajectory: Trajectory

    @property
    def end(self) -> float:
        """The duration [s]."""
        return self.trajectory.end


class Cells(NamedTuple):
    """A part of the motion in cells, and the limits at both ends of each.

    ``x`` (k + 1,) are times from its start; ``last`` (k,) the end of the piece that each cell is part of; ``node`` (k, 2, m, 4)
    coefficients of b, w², w and 1; ``edge`` (k, 2, e, 6) of j, w b, w³, w, b and w²: each value is limited to [−1, 1].
    """

    x: Array
    last: Indices
    node: Array
    edge: Array


class Braking(NamedTuple):
    """The joints' motion while they brake, and the time of the running motion at which it ends."""

    motion: Trajectory
    end: float


def brake(
    robot: Robot, running: Trajectory, limits: MotionLimits, t: float, clock: tuple[float, float],
    scales: dict[str, float], share: float, goal: float = 0.0,
) -> Braking | None:  # fmt: skip
    """Return the motion from time t of a running one until its clock has slowed from w and b to the rate `goal`, or None.

    It uses a fraction `share` of the limits named in `scales`, each multiplied by its scale, or what the running motion uses.
    """
    left, (w, b) = running.end - t, clock
    jerk, length = _rough(Course(robot, running), limits, t, clock, scales)
    kinds = [
        k
        for k in limits.kinds
        if k.order > 1 and k.name in scales and np.isfinite(limits.bounds(robot.n)[k.name]).any()
    ]
    cells, rounds = None, 0
    out = np.zeros((4, MOST_STEPS + RAMP_STEPS + 2))
    while w > goal and left > 0.0:
        cells = cells or _cells(Course(robot, running), limits, t, min(length, left), scales)
        least = np.zeros((cells.x.size, RATES + 1))
        end, count = _swept(cells, (w, b, goal), share, jerk, least, out)
        if end == TOO_SHORT and length < left:
            length, cells = 2.0 * length, None
            continue
        if end != DONE:
            return None
        braking = _braking(running, t, out[:, : count + 1])
        if not _tighten(cells, robot, braking.motion, limits, kinds, scales, out[0, : count + 1]):
            return braking
        rounds += 1
        if rounds == ROUNDS:
            return None
    return None


def stop_time(
    robot: Robot,
    running: Trajectory,
    limits: MotionLimits,
    t: float,
    clock: tuple[float, float],
    scales: dict[str, float],
) -> float:
    """Return about how long [s] a stop takes from time t, were the limits along the motion what they are there."""
    return min(_rough(Course(robot, running), limits, t, clock, scales)[1], running.end - t)


def _tighten(
    cells: Cells,
    robot: Robot,
    motion: Trajectory,
    limits: MotionLimits,
    kinds: list[Limit],
    scales: dict[str, float],
    x: Array,
) -> bool:
    """Tighten the rows where the motion exceeds a limit inside its pieces; whether it does."""
    bounds, done = limits.bounds(robot.n), False
    first = np.searchsorted(cells.x[1:], x[:-1] + 1e-9 * cells.x[-1])
    last = np.searchsorted(cells.x[1:], x[1:] - 1e-9 * cells.x[-1])
    for loaded in (False, True):
        if done:
            break
        for kind in kinds:
            if isinstance(kind, LoadedLimit) is not loaded:
                continue
            ratios = kind.piece_ratios(examined(robot, motion), bounds[kind.name]).max(axis=1) / scales[kind.name]
            rows = cells.node if kind.order == 2 else cells.edge
            for piece in np.flatnonzero(ratios > 1.0):
                rows[first[piece] : last[piece] + 1] *= 1.0 + 1.3 * (ratios[piece] - 1.0) + SPARE
                done = True
    return done


def _rough(
    course: Course, limits: MotionLimits, t: float, clock: tuple[float, float], scales: dict[str, float]
) -> tuple[float, float]:
    """The greatest |j|, and the part of the motion [s] that a stop needs, were the limits what they are at its start."""
    left, (w, b) = course.end - t, clock
    cells = _cells(course, limits, t, 1e-3 * left, scales, 1)
    with np.errstate(divide="ignore"):
        most = float((1.0 / np.abs(cells.node[0, 0, :, 0])).min(initial=np.inf))
        jerk = float((1.0 / np.abs(cells.edge[0, 0, :, 0])).min(initial=np.inf))
    most = max(min(most, 1e15 * w * w / left), abs(b), 1e-100)
    quickest = most * most / (QUICK_RAMP * w)
    jerk = min(jerk, quickest)
    ramp = min((most + abs(b)) / jerk, 2.0 * np.sqrt(w / jerk) + 2.0 * abs(b) / jerk)
    return 4.0 * jerk, AHEAD * w * (ramp + 0.5 * w / most)


def _cells(
    course: Course, limits: MotionLimits, t: float, length: float, scales: dict[str, float], least: int = CELLS
) -> Cells:
    """The part of a motion from t on, divided at its knots, and the limits there."""
    knots = course.trajectory.knots
    inner = knots[(knots > t) & (knots < t + length)] - t
    inner = inner[np.diff(inner, prepend=0.0) > 1e-6 * length]
    x = np.concatenate([[0.0], inner[inner < (1.0 - 1e-6) * length], [length]])
    parts = np.ceil(np.maximum(np.diff(x) * least / length, PARTS if 1 < x.size < least else 1)).astype(int)
    which, last = np.repeat(np.arange(parts.size), parts), np.cumsum(parts)
    within = np.arange(which.size) - (last - parts)[which]
    x = np.append(x[which] + (np.diff(x) / parts)[which] * within, length)
    ends, middle = np.repeat(x, 2)[1:-1], t + 0.5 * (x[1:] + x[:-1])
    piece = np.repeat(_piece(knots, middle), 2)
    at = PathPoints(
        course,  # type: ignore[arg-type]  # what rows read of a joint path: robot and end
        t + ends,
        _derivatives(course.trajectory.padded, piece, t - knots[piece] + ends),
    )
    bounds, rows = limits.bounds(course.robot.n), {2: np.empty((ends.size, 0, 4)), 3: np.empty((ends.size, 0, 6))}
    for kind in limits.kinds:
        if kind.order > 1 and kind.name in scales and np.isfinite(bounds[kind.name]).any():
            found, wide = kind.rows(at, bounds[kind.name]) / scales[kind.name], rows[kind.order]
            padded = np.zeros((ends.size, found.shape[1], wide.shape[2]))
            padded[..., : found.shape[2]] = found
            rows[kind.order] = np.concatenate([wide, padded], axis=1)
    node, edge = (each.reshape(x.size - 1, 2, *each.shape[1:]) for each in rows.values())
    return Cells(x, last[which], node, edge)


def _piece(knots: Array, t: Array) -> Indices:
    """The pieces that hold times."""
    return np.clip(np.searchsorted(knots, t, side="right") - 1, 0, knots.size - 2)


def _derivatives(c: Array, piece: Indices, u: Array) -> Array:
    """Q and its derivatives (4, k, n) at times u (k,) behind the first knots of pieces of quintics (6, m, n)."""
    out = np.empty((4, u.size, c.shape[2]))
    _evaluate(c, piece, u, out)
    return out


@compiled
def _evaluate(c: Array, piece: Indices, u: Array, out: Array) -> None:
    for i in range(u.shape[0]):
        k, x = piece[i], u[i]
        for n in range(c.shape[2]):
            c0, c1, c2, c3, c4 = c[0, k, n], c[1, k, n], c[2, k, n], c[3, k, n], c[4, k, n]
            out[0, i, n] = c[5, k, n] + x * (c4 + x * (c3 + x * (c2 + x * (c1 + x * c0))))
            out[1, i, n] = c4 + x * (2.0 * c3 + x * (3.0 * c2 + x * (4.0 * c1 + x * 5.0 * c0)))
            out[2, i, n] = 2.0 * c3 + x * (6.0 * c2 + x * (12.0 * c1 + x * 20.0 * c0))
            out[3, i, n] = 6.0 * c2 + x * (24.0 * c1 + x * 60.0 * c0)


# ---------------------------------------------------------------- the limits in a cell


@compiled
def _sides(known: float, share: float) -> tuple[float, float]:
    """The sides of a row: the fraction `share`, or what the motion itself uses there and half of what it leaves."""
    used = max(share, abs(known), 0.5 + 0.5 * min(abs(known), 1.0))
    return (-used if known < 0.0 else -share), (used if known > 0.0 else share)


@compiled
def _lines(
    cells: Cells, i: int, part: float, w: float, share: float, jerk: float, line: Array
) -> tuple[float, float, int]:
    """Bounds on b by the rows of second order; and j as lines over b: base, half and slope (3, n), and how many."""
    low, high, R, E = -NONE, NONE, cells.node, cells.edge
    for m in range(R.shape[2]):
        p = (1.0 - part) * R[i, 0, m, 0] + part * R[i, 1, m, 0]
        if p == 0.0:
            continue
        c1 = (1.0 - part) * R[i, 0, m, 1] + part * R[i, 1, m, 1]
        c2 = (1.0 - part) * R[i, 0, m, 2] + part * R[i, 1, m, 2]
        c3 = (1.0 - part) * R[i, 0, m, 3] + part * R[i, 1, m, 3]
        known = w * (c1 * w + c2) + c3
        down, up = _sides(known, share)
        one, other = (down - known) / p, (up - known) / p
        low, high = max(low, min(one, other)), min(high, max(one, other))
    line[0, 0], line[1, 0], line[2, 0] = 0.0, jerk, 0.0
    n = 1
    for e in range(E.shape[2]):
        p = (1.0 - part) * E[i, 0, e, 0] + part * E[i, 1, e, 0]
        if p == 0.0:
            continue
        c1 = (1.0 - part) * E[i, 0, e, 1] + part * E[i, 1, e, 1]
        c2 = (1.0 - part) * E[i, 0, e, 2] + part * E[i, 1, e, 2]
        c3 = (1.0 - part) * E[i, 0, e, 3] + part * E[i, 1, e, 3]
        c4 = (1.0 - part) * E[i, 0, e, 4] + part * E[i, 1, e, 4]
        c5 = (1.0 - part) * E[i, 0, e, 5] + part * E[i, 1, e, 5]
        known = w * (c2 * w * w + c3 + c5 * w)
        down, up = _sides(known, share)
        line[0, n], line[1, n], line[2, n] = (
            (0.5 * (down + up) - known) / p,
            0.5 * (up - down) / abs(p),
            -(c1 * w + c4) / p,
        )
        n += 1
    return low, high, n


@compiled
def _jerks(line: Array, n: int, b: float) -> tuple[float, float]:
    """Least and greatest j at b."""
    low, high = -NONE, NONE
    for e in range(n):
        middle = line[0, e] + line[2, e] * b
        low, high = max(low, middle - line[1, e]), min(high, middle + line[1, e])
    return low, high


@compiled
def _least(line: Array, n: int, low: float) -> float:
    """The least b, at least `low`, at which some j is allowed: each two lines bound b (Fourier–Motzkin elimination)."""
    for e in range(n):
        for f in range(e):
            d, off, room = line[2, e] - line[2, f], line[0, e] - line[0, f], line[1, e] + line[1, f]
            if d != 0.0:
                low = max(low, min((-room - off) / d, (room - off) / d))
    return low


# ---------------------------------------------------------------- viability, backwards


@compiled
def _viable(cells: Cells, top: float, share: float, jerk: float, least: Array) -> None:
    """Fill the least b (k + 1, RATES + 1) at the cells' ends and at rates up to `top`, from which b = 0 is reached in time."""
    line, after = np.empty((2, 3, 2 * cells.edge.shape[2] + 2))
    last = cells.x.shape[0] - 1
    for i in range(last, -1, -1):
        cell, part = (i, 0.0) if i < last else (i - 1, 1.0)
        for r in range(1, RATES + 1):
            w = top * r / RATES
            low, _, n = _lines(cells, cell, part, w, share, jerk, line)
            if i < last:
                other, _, m = _lines(cells, cell, 1.0, w, share, jerk, after)
                line[:, n : n + m] = after[:, :m]
                low, n = max(low, other), n + m
            low = min(_least(line, n, max(low, -2.0 * np.sqrt(jerk * top))), 0.0)
            if i < last and not _onward(cells, i, w, low, line, n, top, least):
                high = 0.0
                for _ in range(BISECTIONS):
                    b = 0.5 * (low + high)
                    if _onward(cells, i, w, b, line, n, top, least):
                        high = b
                    else:
                        low = b
                low = high
            least[i, r] = low


@compiled
def _onward(cells: Cells, i: int, w: float, b: float, line: Array, n: int, top: float, least: Array) -> bool:
    """Whether the greatest j leads from w and b at the start of a cell above the least b at its end, or to rest before."""
    low, high = _jerks(line, n, b)
    if high < low:
        return False
    d = cells.x[i + 1] - cells.x[i]
    square = w * w + 2.0 * b * d
    if square <= 0.01 * w * w:
        return b * b <= 2.0 * max(high, 0.0) * w
    after = np.sqrt(square)
    h = 2.0 * d / (w + after)
    then = b + high * h
    after = min(max(w + 0.5 * (b + min(then, 0.0)) * h, 0.1 * w), top)
    return bool(then >= _bound(least, i + 1, after, top))


@compiled
def _bound(least: Array, i: int, w: float, top: float) -> float:
    """The least b at the end of a cell, interpolated over the rate; towards rate 0 it goes with its square root."""
    r = w / top * RATES
    if r <= 1.0:
        return float(least[i, 1] * np.sqrt(r))
    k = min(int(r), RATES - 1)
    return float((k + 1.0 - r) * least[i, k] + (r - k) * least[i, k + 1])


# ---------------------------------------------------------------- the sweep, forwards


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
    """The time in which w h + b h²/2 + j h³/6 = d, by Newton's steps from a guess; the guess where the clock stops before."""
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
    cells: Cells, start: tuple[float, float, float, float], goal: float, share: float, jerk: float, part: float, line: Array,
    out: Array, k: int,
) -> tuple[float, int]:  # fmt: skip
    """Let b < 0 rise to 0 with a part of the greatest j: w − goal then, and the last knot; below 0 where w falls below before.

    It is `NONE` where no j above 0 is allowed on the way. Knots are written behind knot k where `k` is at least 0.
    """
    x, w, b, t = start
    first, i = b, _cell(cells.x, x, 0)
    for step in range(RAMP_STEPS):
        i = _cell(cells.x, x, i)
        _, _, n = _lines(cells, i, _part(cells.x, x, i), max(w, 0.0), share, jerk, line)
        j = part * _jerks(line, n, b)[1]
        if j <= 0.0:
            return NONE, k
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
    cells: Cells,
    start: tuple[float, float, float, float],
    goal: float,
    share: float,
    jerk: float,
    line: Array,
    out: Array,
    k: int,
) -> int:
    """Write the ramp from a knot to the goal, b and w at once, by bisection of its jerk; the last knot, or −1 where none is."""
    low, high = 0.0, 1.0
    for _ in range(50):
        part = 0.5 * (low + high)
        if _ramp(cells, start, goal, share, jerk, part, line, out, -1)[0] > 0.0:
            high = part
        else:
            low = part
    rest, last = _ramp(cells, start, goal, share, jerk, high, line, out, k)
    if last != k + RAMP_STEPS or abs(rest) > 1e-9 * start[1]:
        return -1
    out[1, last], out[2, last] = goal, 0.0
    return last


@compiled
def _swept(
    cells: Cells, begin: tuple[float, float, float], share: float, jerk: float, least: Array, out: Array
) -> tuple[int, int]:
    """Find the least b, and sweep from w and b to the goal: how it ended, and the last knot."""
    w, _, goal = begin
    _viable(cells, max(w, 1.0), share, jerk, least)
    low = 0.0
    for i in range(min(4, cells.x.shape[0])):
        low = min(low, least[i, RATES])
    total = min(cells.x[-1] / w, 2.0 * (w - goal) / max(-low, 1e-300) + 2.0 * np.sqrt((w - goal) / jerk))
    end, k, rounds, softer = TOO_LONG, 0, 0, 1
    for _ in range(REPAIRS):
        end, k = _sweep(cells, begin, share, jerk, total, least, out)
        if end == DEAD_END:  # go past it with a gentler brake: the nearer to b = 0, the surer
            first, last = _cell(cells.x, out[0, max(k - softer, 0)], 0), _cell(cells.x, out[0, k], 0)
            least[first : min(last + 3, least.shape[0])] *= SOFTER
            softer += 1
        elif end == DONE and k < FEWEST_STEPS and rounds < 2:
            total, rounds = out[3, k], rounds + 1
        else:
            break
    return end, k


@compiled
def _sweep(
    cells: Cells, begin: tuple[float, float, float], share: float, jerk: float, total: float, least: Array, out: Array
) -> tuple[int, int]:
    """One sweep: how it ended, and its last knot."""
    w, b, goal = begin
    top = max(w, 1.0)
    x, t, i, k = 0.0, 0.0, 0, 0
    line = np.empty((3, cells.edge.shape[2] + 1))
    out[0, 0], out[1, 0], out[2, 0], out[3, 0] = x, w, b, t
    longest, slack = total / STEPS, NEGLIGIBLE * np.abs(least).max()
    while k < MOST_STEPS:
        _, _, n = _lines(cells, i, _part(cells.x, x, i), w, share, jerk, line)
        low, high = _jerks(line, n, b)
        h = longest
        reach = cells.x[cells.last[i]] - x  # to the next knot of the motion, where a step ends
        aligned = reach < 1.3 * h * w
        if aligned:
            h = reach / w
        elif reach < 2.0 * h * w:
            h = 0.5 * reach / w
        middle = _cell(cells.x, x + 0.5 * h * w, i)
        _, _, n = _lines(cells, middle, _part(cells.x, x + 0.5 * h * w, middle), w + 0.5 * h * b, share, jerk, line)
        m1, m2 = _jerks(line, n, b)
        low, high = max(low, m1), max(min(high, m2), m1)
        j, need, c = max(low, min(0.0, high)), 0.0, i
        for _ in range(4):
            if aligned:
                h = _until(reach, w, b, j, h)
            x1, w1 = x + h * (w + h * (0.5 * b + h * j / 6.0)), w + h * (b + 0.5 * h * j)
            if w1 <= 0.0:
                break
            c = _cell(cells.x, x1, i)
            part = _part(cells.x, x1, c)
            need = (1.0 - part) * _bound(least, c, w1, top) + part * _bound(least, c + 1, w1, top)
            _, _, n = _lines(cells, c, part, w1, share, jerk, line)
            j1, j2 = _jerks(line, n, b + h * j)
            j = min(max(max(low, j1), (need - b) / h), max(min(high, j2), low))
        if aligned:
            h = _until(reach, w, b, j, h)
        x1, w1, b1 = x + h * (w + h * (0.5 * b + h * j / 6.0)), w + h * (b + 0.5 * h * j), b + h * j
        rest = -1.0
        if w1 > goal:
            rest = 1.0 if b1 >= 0.0 else _ramp(cells, (x1, w1, b1, t + h), goal, share, jerk, 1.0, line, out, -1)[0]
        if rest <= 0.0:
            if b >= 0.0:  # not yet braking: shorter steps
                longest *= 0.5
                if longest < 1e-4 * total:
                    return DEAD_END, k
                continue
            last = _last_ramp(cells, (x, w, b, t), goal, share, jerk, line, out, k)
            if last < 0:
                return DEAD_END, k
            return (DONE if out[0, last] <= cells.x[-1] else TOO_SHORT), last
        if b1 < need - 0.05 * abs(need) - slack:
            return DEAD_END, k
        x, w, b, t, k = x1, w1, b1, t + h, k + 1
        i = _cell(cells.x, x + 1e-12 * cells.x[-1], i)
        out[0, k], out[1, k], out[2, k], out[3, k] = x, w, b, t
        if x >= cells.x[-1]:
            return TOO_SHORT, k
    return TOO_LONG, k


# ---------------------------------------------------------------- the motion

GAUSS = np.polynomial.legendre.leggauss(4)
"""Nodes in [−1, 1] and weights of the integral of q̇ over a piece."""


def _braking(running: Trajectory, start: float, swept: Array) -> Braking:
    """The joints' motion for a motion (4, k + 1) of the clock.

    Each piece is made from how far the joints move on it, the integral of q̇: the difference of two positions would leave
    rounding only of a motion of nanometres.
    """
    x, (w, b), t = np.minimum(swept[0], running.end - start), swept[1:3, :, None], swept[3]
    nodes, weights = GAUSS
    inner, k = x[:-1, None] + np.diff(x)[:, None] * (0.5 + 0.5 * nodes), x.size - 1
    every = np.concatenate([x[:-1], x[1:], inner.ravel()])
    piece = _piece(running.knots, start + every)
    piece[k : 2 * k] = _piece(running.knots, start + x[1:] - 1e-9 * np.diff(x))  # one-sided values where q̈ jumps
    q, q1, q2, _ = _derivatives(running.padded, piece, start - running.knots[piece] + every)
    first = composed((q1[:k], q2[:k]), (w[:-1], b[:-1]))
    last = composed((q1[k : 2 * k], q2[k : 2 * k]), (w[1:], b[1:]))
    moved = np.einsum("k,kin,i->kn", np.diff(x), q1[2 * k :].reshape(*inner.shape, -1), 0.5 * weights)
    motion = quintic(t, (np.zeros_like(moved), *first), (moved, *last))
    motion.c[5] = q[0] + np.concatenate([np.zeros((1, moved.shape[1])), np.cumsum(moved, axis=0)[:-1]])
    return Braking(Trajectory(motion), min(start + float(x[-1]), running.end))
