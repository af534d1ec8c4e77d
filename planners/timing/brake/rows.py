"""Limits on the clock of a running motion, as rows in its rate at the ends of cells of time, and viable accelerations."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.limits import MotionLimits, PathPoints, sides
from planners.limits.base import middle_and_half
from planners.trajectory import Trajectory
from planners.trajectory.curve import evaluate_quintics, piece_at

CELLS_PER_PIECE = 2
"""Number of cells of each piece of the motion; between the ends of a cell the rows are interpolated."""
LEAST_CELLS = 20
"""Least number of cells of the examined part of the motion."""
NO_BOUND = 1e300
"""Value that stands for no bound."""


class RunningMotion(NamedTuple):
    """A motion of the robot's joints while it runs: for the rows of limits a joint path whose parameter is the time."""

    robot: Robot
    trajectory: Trajectory

    @property
    def end(self) -> float:
        """Return the duration of the motion [s]."""
        return self.trajectory.end

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return q or one of its derivatives in time (k, n)."""
        return self.trajectory(t, order)


class MotionPoints(PathPoints):
    """Instants of a running motion."""

    @cached_property
    def twist(self) -> Array:
        """Twists (k, 6) of the tool: (v, ω) [m/s, rad/s], linear first."""
        return np.asarray(np.einsum("kij,kj->ki", self.joint_path.robot.jacobian(self.q()), self.q(1)))


class Cells(NamedTuple):
    """A part of the motion, divided into cells, and the limits at both ends of each cell.

    ``x`` (k + 1,) are times from its start; ``last`` (k,) is the end of the piece with each cell; ``node`` (k, 2, m, 4)
    coefficients of b, w², w and 1, each value limited to its ``sides`` (2, m), on both sides of 0; ``edge`` (k, 2, e, 6) of
    j, w b, w³, w, b and w², each value limited to [−1, 1]. ``tight`` (2, k) are the factors of `tighten` on both so far;
    ``soft`` (k + 1,) are factors on the least b that avoid dead ends; ``stale`` (k + 1,) are ends whose least b is unknown.
    """

    x: Array
    last: Indices
    node: Array
    sides: Array
    edge: Array
    tight: Array
    soft: Array
    stale: Flags

    def tighten(self, order: int, which: slice, factor: float) -> None:
        """Scale the rows of acceleration (order 2) or jerk (order 3) in some cells."""
        (self.node if order == 2 else self.edge)[which] *= factor
        self.tight[order - 2, which] *= factor
        self.stale[which.start : which.stop + 1] = True

    def take(self, other: Cells) -> None:
        """Take over the factors of cells that cover a shorter part of this motion."""
        middle = 0.5 * (self.x[1:] + self.x[:-1])
        k = np.flatnonzero(middle < other.x[-1])
        i = np.searchsorted(other.x[1:], middle[k])
        for rows, factors, known in zip((self.node, self.edge), self.tight, other.tight, strict=True):
            rows[k] *= known[i, None, None, None]
            factors[k] *= known[i]
        self.soft[k] = other.soft[i]


def cells_of(
    motion: RunningMotion,
    limits: MotionLimits,
    t: float,
    length: float,
    scales: dict[str, float],
    least: int = LEAST_CELLS,
) -> Cells:
    """Return the part of a motion from t on, divided at its knots, and its limits."""
    knots = motion.trajectory.knots
    inner = knots[(knots > t) & (knots < t + length)] - t
    inner = inner[np.diff(inner, prepend=0.0) > 1e-6 * length]
    x = np.concatenate([[0.0], inner[inner < (1.0 - 1e-6) * length], [length]])
    parts = np.ceil(np.maximum(np.diff(x) * least / length, CELLS_PER_PIECE if 1 < x.size < least else 1)).astype(int)
    which, last = np.repeat(np.arange(parts.size), parts), np.cumsum(parts)
    within = np.arange(which.size) - (last - parts)[which]
    x = np.append(x[which] + (np.diff(x) / parts)[which] * within, length)
    ends, middle = np.repeat(x, 2)[1:-1], t + 0.5 * (x[1:] + x[:-1])
    piece = np.repeat(piece_at(knots, middle), 2)
    at = MotionPoints(
        motion,  # type: ignore[arg-type]  # no path: the points have the twists
        t + ends,
        evaluate_quintics(motion.trajectory.padded, piece, t - knots[piece] + ends),
    )
    bounds, rows = limits.bounds(motion.robot.n), {2: [np.empty((ends.size, 0, 4))], 3: [np.empty((ends.size, 0, 6))]}
    centres = [np.empty(0)]
    for kind in limits.kinds:
        if kind.order > 1 and kind.name in scales and kind.is_given(bounds[kind.name]):
            coefficients = kind.rows(at, bounds[kind.name])
            padded = np.zeros((ends.size, coefficients.shape[1], rows[kind.order][0].shape[2]))
            padded[..., : coefficients.shape[2]] = coefficients
            if kind.order == 2:  # rows of a pair are 0 in its middle
                centre = _centre_of(bounds[kind.name])
                centres.append(np.tile(centre, coefficients.shape[1] // centre.size))
                padded[..., 3] += centres[-1]
            rows[kind.order].append(padded / scales[kind.name])
    node, edge = (np.concatenate(each, axis=1) for each in rows.values())
    node, edge = (each.reshape(x.size - 1, 2, *each.shape[1:]) for each in (node, edge))
    rooms = np.concatenate(centres) + np.array([[-1.0], [1.0]])
    return Cells(
        x, last[which], node, rooms, edge, np.ones((2, x.size - 1)), np.ones(x.size), np.ones(x.size, dtype=bool)
    )


def _centre_of(bound: Any) -> Array:
    """Return the middle of a bound (n,), over half of its width; 0 where it is free, and for a record."""
    if not isinstance(bound, np.ndarray):
        return np.zeros(1)
    middle, half = middle_and_half(*sides(bound))
    return np.asarray(middle / half)


@compiled
def _used_sides(known: float, lower: float, upper: float, share: float) -> tuple[float, float]:
    """Return the used sides of a row: the fraction `share`, or the motion's own value plus half of the remaining range."""
    ratio = known / lower if known < 0.0 else known / upper
    used = max(share, ratio, 0.5 + 0.5 * min(ratio, 1.0))
    return lower * (used if known < 0.0 else share), upper * (used if known > 0.0 else share)


@compiled
def lines_at(
    cells: Cells, i: int, part: float, w: float, share: float, jerk: float, line: Array
) -> tuple[float, float, int]:
    """Return bounds on b from the rows of second order, lines of j over b (base, half and slope, (3, n)), and their number."""
    low, high, R, E = -NO_BOUND, NO_BOUND, cells.node, cells.edge
    for m in range(R.shape[2]):
        p = (1.0 - part) * R[i, 0, m, 0] + part * R[i, 1, m, 0]
        if p == 0.0:
            continue
        c1 = (1.0 - part) * R[i, 0, m, 1] + part * R[i, 1, m, 1]
        c2 = (1.0 - part) * R[i, 0, m, 2] + part * R[i, 1, m, 2]
        c3 = (1.0 - part) * R[i, 0, m, 3] + part * R[i, 1, m, 3]
        known = w * (c1 * w + c2) + c3
        down, up = _used_sides(known, cells.sides[0, m], cells.sides[1, m], share)
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
        down, up = _used_sides(known, -1.0, 1.0, share)
        line[0, n], line[1, n], line[2, n] = (
            (0.5 * (down + up) - known) / p,
            0.5 * (up - down) / abs(p),
            -(c1 * w + c4) / p,
        )
        n += 1
    return low, high, n


@compiled
def jerks_at(line: Array, n: int, b: float) -> tuple[float, float]:
    """Return the least and the greatest j at b."""
    low, high = -NO_BOUND, NO_BOUND
    for e in range(n):
        middle = line[0, e] + line[2, e] * b
        low, high = max(low, middle - line[1, e]), min(high, middle + line[1, e])
    return low, high


@compiled
def least_acceleration(line: Array, n: int, low: float) -> float:
    """Return the least b ≥ `low` at which some j is allowed; each pair of lines bounds b (Fourier–Motzkin elimination)."""
    least, most = jerks_at(line, n, low)
    if least <= most:
        return low
    for e in range(n):
        for f in range(e):
            d, off, room = line[2, e] - line[2, f], line[0, e] - line[0, f], line[1, e] + line[1, f]
            if d != 0.0:
                low = max(low, min((-room - off) / d, (room - off) / d))
    return low


CLOCK_RATES = 8
"""Number of clock rates for which the least b is found."""
BISECTIONS = 7
"""Number of bisections of the interval of b in that search."""
SAME_BOUND = 1e-6
"""Relative change of a least b below which those before it are not computed again."""


@compiled
def find_viable(cells: Cells, top: float, share: float, jerk: float, least: Array) -> None:
    """Update the least b (k + 1, CLOCK_RATES + 1) from which b = 0 is reached, at the cells' ends, for rates up to `top`.

    Only at the ends that are stale, and before those whose least b changes.
    """
    line, after = np.empty((2, 3, 2 * cells.edge.shape[2] + 2))
    last, changes = cells.x.shape[0] - 1, False
    for i in range(last, -1, -1):
        if not (cells.stale[i] or changes):
            continue
        changes, cells.stale[i] = False, False
        cell, part = (i, 0.0) if i < last else (i - 1, 1.0)
        for r in range(1, CLOCK_RATES + 1):
            w = top * r / CLOCK_RATES
            low, _, n = lines_at(cells, cell, part, w, share, jerk, line)
            if i < last:
                other, _, m = lines_at(cells, cell, 1.0, w, share, jerk, after)
                line[:, n : n + m] = after[:, :m]
                low, n = max(low, other), n + m
            low = min(least_acceleration(line, n, max(low, -2.0 * np.sqrt(jerk * top))), 0.0)
            if i < last and not _onward(cells, i, w, low, line, n, top, least):
                high = 0.0
                for _ in range(BISECTIONS):
                    b = 0.5 * (low + high)
                    if _onward(cells, i, w, b, line, n, top, least):
                        high = b
                    else:
                        low = b
                low = high
            low *= cells.soft[i]
            changes |= abs(low - least[i, r]) > SAME_BOUND * abs(low)
            least[i, r] = low


@compiled
def _onward(cells: Cells, i: int, w: float, b: float, line: Array, n: int, top: float, least: Array) -> bool:
    """Return whether the greatest j leads from w and b at a cell's start to above the least b at its end, or to rest before."""
    low, high = jerks_at(line, n, b)
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
    return bool(then >= interpolate_least(least, i + 1, after, top))


@compiled
def interpolate_least(least: Array, i: int, w: float, top: float) -> float:
    """Return the least b at a cell's end, interpolated over the rate; near rate 0 it is proportional to the square root."""
    r = w / top * CLOCK_RATES
    if r <= 1.0:
        return float(least[i, 1] * np.sqrt(r))
    k = min(int(r), CLOCK_RATES - 1)
    return float((k + 1.0 - r) * least[i, k] + (r - k) * least[i, k + 1])
