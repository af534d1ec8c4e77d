"""Brake a running motion as hard as its limits allow: a sweep of its clock to rest.

A clock τ(t) drives the motion q(τ). Its rate w = τ̇ decreases from 1 to 0, or to a goal. In w, b = τ̈ and j = τ⃛ every limit
is a row: rows of second order contain b, w² and w, and rows of third order contain j. A clock with a constant rate w ≤ 1
respects the limits, because the motion respects them. A backward pass finds the least b from which b = 0 can still be reached
in time (viability). The sweep runs forwards with the least j that keeps b above this bound. It ends when the greatest j brings
b to 0 and w to its goal at the same time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.limits import MotionLimits
from planners.limits.base import Limit
from planners.limits.kinds import LoadedLimit
from planners.timing.brake.rows import (
    CLOCK_RATES,
    NO_BOUND,
    Cells,
    RunningMotion,
    cells_of,
    find_viable,
    interpolate_least,
    jerks_at,
    lines_at,
)
from planners.trajectory import Trajectory
from planners.trajectory.curve import apply_chain_rule, evaluate_quintics, piece_at, quintic

SWEEP_STEPS, FEWEST_STEPS, MOST_SWEEP_STEPS = 24, 16, 1000
"""Approximate number of steps of a stop, the number below which it is swept again in shorter steps, and the largest number."""
RAMP_STEPS = 8
"""Number of steps of the last ramp."""
LONGEST_RAMP_STEP = 0.25
"""Longest step of the last ramp, as a fraction of the examined part of the motion."""
REPAIRS, SOFTER = 12, 0.5
"""Largest number of dead ends that a sweep avoids by braking more gently before them, and the factor on b for that."""
NEGLIGIBLE = 2e-3
"""Fraction of the hardest braking by which b may fall below its least value."""
AT_GOAL, DEAD_END, TOO_SHORT, TOO_MANY_STEPS = range(4)
"""Outcomes of a sweep: at rest, at a dead end, at the end of the cells, or after `MOST_SWEEP_STEPS`."""
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

    The value is `NO_BOUND` if no j above 0, or hardly any, is allowed on the way. If `k` is at least 0, knots are written after
    knot k.
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
        d = h * (w + h * (0.5 * b + h * j / 6.0))
        if d > LONGEST_RAMP_STEP * cells.x[-1] or x + d > cells.x[-1]:
            return NO_BOUND, k  # hardly any j is allowed here: the limits of this place are not those of the ramp
        x += d
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
        if 0.0 < _ramp(cells, start, goal, use, part, line, out, -1)[0] < NO_BOUND:
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
    """Update the least b, and sweep from w and b to the goal; return how the sweep ended, and the last knot."""
    w, _, goal = begin
    find_viable(cells, max(w, 1.0), share, jerk, least)
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
            cells.stale[first : last + 3] = True
            find_viable(cells, max(w, 1.0), share, jerk, least)
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
        need = (1.0 - part) * interpolate_least(least, c, w1, top) + part * interpolate_least(least, c + 1, w1, top)
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


ROUNDS, TIGHTER = 20, 5e-3
"""Largest number of sweeps, and a margin: each sweep tightens the rows where the last one exceeds a limit between knots."""
LONGER, MUCH_LONGER = 1.1, 1.3
"""Growth of the duration by tightening above which a smaller fraction of the limits may stop earlier, and above which the
search ends: rows tightened on a motion that uses its limits leave the clock no room to brake."""
QUICK_RAMP = 0.02
"""Fraction of a stop's duration in which b reaches its bound if there is no jerk limit."""
STOP_AHEAD = 1.5
"""Length of the examined part of the motion, relative to the length of a stop from its start under constant limits."""
GAUSS = np.polynomial.legendre.leggauss(4)
"""Nodes in [−1, 1] and weights of the integral of q̇ over a piece."""


class BrakingMotion(NamedTuple):
    """The joints' motion while they brake, None if none was found, and the time of the running motion at which it ends.

    The time is infinite if the running motion ends before the clock can reach its goal. ``smooth`` is whether the sweep met
    no dead end and was tightened little; if not, a smaller fraction of the limits may stop earlier.
    """

    motion: Trajectory | None
    end: float
    smooth: bool


NONE_FOUND, ENDS_BEFORE = BrakingMotion(None, 0.0, False), BrakingMotion(None, np.inf, False)
"""No braking was found, or the running motion ends before it."""


class Brake(NamedTuple):
    """A running motion, and the limits with which it brakes, each multiplied by its scale."""

    running: RunningMotion
    limits: MotionLimits
    scales: dict[str, float]

    @property
    def _kinds(self) -> list[Limit]:
        """The limits of second and third order."""
        bounds = self.limits.bounds(self.running.robot.n)
        chosen = (kind for kind in self.limits.kinds if kind.order > 1 and kind.name in self.scales)
        return [kind for kind in chosen if kind.is_given(bounds[kind.name])]

    def run(self, t: float, clock: tuple[float, float], share: float, goal: float = 0.0) -> BrakingMotion:
        """Return the braking motion from time t on: the clock slows from its rate and acceleration `clock` to the rate `goal`.

        It uses the fraction `share` of the limits, or as much as the running motion uses.
        """
        left, (w, b) = self.running.end - t, clock
        if w <= goal or left <= 0.0:
            return NONE_FOUND
        jerk, length = self._rough(t, clock)
        cells, rounds = cells_of(self.running, self.limits, t, min(length, left), self.scales), 0
        first = np.inf
        out = np.zeros((4, MOST_SWEEP_STEPS + RAMP_STEPS + 2))
        least = np.zeros((cells.x.size, CLOCK_RATES + 1))
        while rounds < ROUNDS:
            end, count = sweep_clock(cells, (w, b, goal), share, jerk, least, out)
            if end == TOO_SHORT and length < left:
                length, before = 2.0 * length, cells
                cells = cells_of(self.running, self.limits, t, min(length, left), self.scales)
                cells.take(before)
                least = np.zeros((cells.x.size, CLOCK_RATES + 1))
                continue
            if end != AT_GOAL:
                return ENDS_BEFORE if end == TOO_SHORT else NONE_FOUND
            motion, stopped = _braking(self.running.trajectory, t, out[:, : count + 1])
            rounds, first = rounds + 1, min(first, motion.end)
            if motion.end > MUCH_LONGER * first:
                return NONE_FOUND
            if not self._tighten(cells, motion, out[0, : count + 1], rounds):
                return BrakingMotion(motion, stopped, motion.end <= LONGER * first and bool(cells.soft.min() == 1.0))
        return NONE_FOUND

    def stop_time(self, t: float, clock: tuple[float, float]) -> float:
        """Return the approximate duration [s] of a stop from time t, with the limits that hold at t."""
        return min(self._rough(t, clock)[1], self.running.end - t)

    def _tighten(self, cells: Cells, motion: Trajectory, x: Array, rounds: int) -> bool:
        """Tighten the rows where the motion exceeds a limit inside its pieces; return whether it does."""
        robot, more, done = self.running.robot, TIGHTER * rounds, False
        analysis, bounds = MotionAnalysis(robot, motion), self.limits.bounds(robot.n)
        first = np.searchsorted(cells.x[1:], x[:-1] + 1e-9 * cells.x[-1])
        last = np.searchsorted(cells.x[1:], x[1:] - 1e-9 * cells.x[-1])
        for loaded in (False, True):
            if done:
                break
            for kind in self._kinds:
                if isinstance(kind, LoadedLimit) is not loaded:
                    continue
                ratios = kind.piece_ratios(analysis, bounds[kind.name]).max(axis=1) / self.scales[kind.name]
                for piece in np.flatnonzero(ratios > 1.0):
                    factor = 1.0 + 1.2 * (ratios[piece] - 1.0) + more
                    cells.tighten(kind.order, slice(first[piece], last[piece] + 1), factor)
                    done = True
        return done

    def _rough(self, t: float, clock: tuple[float, float]) -> tuple[float, float]:
        """Return the greatest |j|, and the part of the motion [s] that a stop needs, with the limits that hold at its start."""
        left, (w, b) = self.running.end - t, clock
        cells = cells_of(self.running, self.limits, t, 1e-3 * left, self.scales, 1)
        with np.errstate(divide="ignore"):
            p = cells.node[0, 0, :, 0]
            most = float((np.where(p > 0.0, -cells.sides[0], cells.sides[1]) / np.abs(p)).min(initial=np.inf))
            jerk = float((1.0 / np.abs(cells.edge[0, 0, :, 0])).min(initial=np.inf))
        most = max(min(most, 1e15 * w * w / left), abs(b), 1e-100)
        quickest = most * most / (QUICK_RAMP * w)
        jerk = min(jerk, quickest)
        ramp = min((most + abs(b)) / jerk, 2.0 * np.sqrt(w / jerk) + 2.0 * abs(b) / jerk)
        return 4.0 * jerk, STOP_AHEAD * w * (ramp + 0.5 * w / most)


def _braking(running: Trajectory, start: float, swept: Array) -> tuple[Trajectory, float]:
    """Return the joints' motion for a motion (4, k + 1) of the clock, and its end in the time of the running motion.

    Each piece is computed from the displacement of the joints on it, the integral of q̇. For a motion of nanometres, the
    difference of two positions would be only rounding error.
    """
    x, (w, b), t = np.minimum(swept[0], running.end - start), swept[1:3, :, None], swept[3]
    nodes, weights = GAUSS
    inner, k = x[:-1, None] + np.diff(x)[:, None] * (0.5 + 0.5 * nodes), x.size - 1
    every = np.concatenate([x[:-1], x[1:], inner.ravel()])
    piece = piece_at(running.knots, start + every)
    piece[k : 2 * k] = piece_at(running.knots, start + x[1:] - 1e-9 * np.diff(x))  # one-sided values where q̈ jumps
    q, q1, q2, _ = evaluate_quintics(running.padded, piece, start - running.knots[piece] + every)
    first = apply_chain_rule((q1[:k], q2[:k]), (w[:-1], b[:-1]))
    last = apply_chain_rule((q1[k : 2 * k], q2[k : 2 * k]), (w[1:], b[1:]))
    moved = np.einsum("k,kin,i->kn", np.diff(x), q1[2 * k :].reshape(*inner.shape, -1), 0.5 * weights)
    motion = quintic(t, (np.zeros_like(moved), *first), (moved, *last))
    motion.c[5] = q[0] + np.concatenate([np.zeros((1, moved.shape[1])), np.cumsum(moved, axis=0)[:-1]])
    known = None if running.s is None else np.interp(start + x, running.knots, running.s)
    return Trajectory(motion, known), min(start + float(x[-1]), running.end)
