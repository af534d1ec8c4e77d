"""Constant tool speed between two ramps: the tool's speed is constant on the whole path except its ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
import scipy

from optik.check import check_number, format_ratio
from optik.errors import InvalidInput, NoSolution
from optik.types import Array, Flags, Indices
from planners.certificate.analysis import MotionAnalysis
from planners.following.follow import JointPath
from planners.limits import ALL_LIMITS, MotionLimits, PathPoints
from planners.motion.motion import find_stretch_factor, stretch_analysed
from planners.timing import _sectional
from planners.timing._sectional import Ramp, RampRatio, RampTable
from planners.timing.base import TimeLaw, refit, speed_bound
from planners.timing.interior_point.programme import select_spaced, sweep_joint_path
from planners.timing.interior_point.rows import derivatives
from planners.timing.smooth import least_duration
from planners.trajectory import Trajectory
from planners.trajectory.curve import apply_chain_rule, find_times, quintic_through

DISTANCE_CELLS, DISTANCE_PER_PIECE, STEEP = 1024, 8, 0.1
"""Least number of cells of the path and of each of its pieces, and the largest change of ln |v| over a cell (by end slopes)."""
LEAST_KNOTS = 32
"""Least number of knots of s(t) on a path whose pieces are all curved; `DISTANCE_PER_PIECE` is that of a piece."""
SAME_BREAK = 1e-6
"""Relative distance below which two breaks are merged; in shorter cells the third derivative is rounding error."""
STRAIGHT_CELL = 1e-9
"""Relative change of the tool's speed over a cell, at a constant ṡ, that counts as rounding error."""
KNOTS_APART = 2e-4
"""Least time [s] between knots of s(t) in motions of at least a second, or its fraction of a shorter motion. A corner in which
the joints reach their limits takes many times as long."""
RAMP_SHAPES = [(r, f) for r in (0.49, 0.35, 0.2, 0.1, 0.05) for f in (0.49, 0.35, 0.2, 0.1, 0.05)] + [
    (x, 1.0 - _sectional.LEAST_FLAT - x) for x in (0.15, 0.25, 0.35, 0.65, 0.75, 0.85)
]
"""Fractions of a ramp in which its acceleration rises and falls."""
RAMP_LENGTHS = (1.0, 0.9, 0.75)
"""Lengths of the ramps to the greatest speed, relative to the longest allowed ramps."""
CRAWL = 1e3
"""Largest ratio of the duration to that of a motion that slows at corners; above it no speed is chosen (1 s becomes 17 min)."""
FIRST_ROOM, ROOM_LEFT, ROOMS = 0.999, 0.998, 3
"""Fraction of the limits that ramps use first, factor on it after an excess, and number of fractions that are tried."""


class ConstantSpeed(TimeLaw):
    """Constant speed of the tool, |v|, from the end of one ramp to the start of the other; |ω| if the tool only turns.

    The ramps are limited in jerk and as short as the local limits allow. Each takes at most the fraction `ramp` of the
    distance. The speed is one number and is met exactly: this motion is never slowed as a whole.

    Parameters
    ----------
    speed : float, optional
        Tool speed [m/s; rad/s for a pure rotation]; by default the greatest that the limits allow everywhere. The
        sharpest corner determines it. There is no motion if it would take a thousand times as long as a motion that slows
        at corners only. A given speed may be arbitrarily low.
    ramp : float
        Largest fraction of the distance for each of the two ramps, up to a half.
    """

    name: ClassVar[str] = "constant_speed"
    enforced: ClassVar[tuple[str, ...]] = ALL_LIMITS

    def __init__(self, *, speed: float | None = None, ramp: float = 0.25) -> None:
        self.speed = None if speed is None else check_number(speed, "speed", "a tool speed above 0, or None", above=0.0)
        self.ramp = check_number(ramp, "ramp", "a fraction above 0, at most 0.5", above=0.0)
        if ramp > 0.5:
            raise InvalidInput("ramp", ramp, "a fraction above 0, at most 0.5")

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> MotionAnalysis:
        shortest = min(_sectional.SHORTEST_PHASE, 0.01 * least_duration(joint_path, limits))
        distance = _distance(joint_path, limits)
        if self.speed is not None:
            motion = self._quickest(distance, self.speed, shortest)
            if motion is not None:
                return motion
        # widest ramps, scaled in time: the greatest speed of all, as a uniform scaling changes speeds alike
        widest = _find_widest(distance.table, self.ramp, shortest)
        built = _build(distance, widest)
        fastest = stretch_analysed(
            MotionAnalysis(joint_path.robot, built, joint_path.path), limits, self.list_enforced(limits)
        )
        greatest = widest[0].v1 * built.duration / fastest.trajectory.duration
        if self.speed is None:
            _check_crawl(distance, widest, greatest)
            motion = self._quickest(distance, greatest, shortest)
            return fastest if motion is None or motion.trajectory.duration > fastest.trajectory.duration else motion
        if self.speed > greatest:
            worst, in_ramp = _find_worst(distance, widest, self.speed)
            turns, unit = ("rotation", "rad/s") if distance.turning else ("tool", "m/s")
            longer = "a longer ramp= (at most 0.5); " if in_ramp and self.ramp < 0.5 else ""
            slower = f"timing='optimal' with {turns}_speed={self.speed:.6g}"
            where = f", in a ramp of {self.ramp:.3g} of the distance" if in_ramp else ""
            raise NoSolution(
                f"{self.speed:.6g} {unit} is {format_ratio(self.speed / greatest)} times too fast: the limit "
                f"on {worst.limit} is exceeded at s = {worst.s:.4g}{where}",
                s=worst.s, joint=worst.joint,
                advice=f"speed={_round_down(greatest):.6g} or less; {longer}or {slower}",
            )  # fmt: skip
        return fastest.stretched(greatest / self.speed)

    def _quickest(self, distance: _Distance, speed: float, shortest: float) -> MotionAnalysis | None:
        """Return the motion with the shortest ramps to a speed; None if none of the tried ramps respects the limits."""
        joint_path, limits = distance.joint_path, distance.limits
        enforced, room = self.list_enforced(limits), FIRST_ROOM
        for _ in range(ROOMS):
            ramps = _find_shortest(distance.table, speed, self.ramp, room, shortest)
            if ramps is None:
                return None
            motion = MotionAnalysis(joint_path.robot, _build(distance, ramps), joint_path.path)
            excess = find_stretch_factor(motion, limits, enforced)
            if excess <= 1.0:
                return motion
            if self.speed is None and excess <= 1.0 / FIRST_ROOM:
                return stretch_analysed(motion, limits, enforced)
            room *= ROOM_LEFT / excess
        return None


def _check_crawl(distance: _Distance, widest: list[Ramp], greatest: float) -> None:
    """Raise NoSolution if the motion at the greatest speed takes a thousand times as long as one that slows at corners."""
    quick, slow = (
        float(sweep_joint_path(distance.joint_path, distance.limits)[1][0, -1]),
        float(distance.table.s[-1]) / greatest,
    )
    if slow <= CRAWL * quick:
        return
    found, _ = _find_worst(distance, widest, 2.0 * greatest)
    raise NoSolution(
        f"a constant speed would be {greatest:.3g} at most: {found.joint or 'the tool'} is at its limit on {found.limit} at "
        f"s = {found.s:.6g}; the motion would take {slow:.3g} s, one that slows at corners only about {quick:.3g} s",
        s=found.s, joint=found.joint,
        advice=f"a larger blend there, timing='optimal', or speed={_round_down(greatest):.6g} to accept this duration",
    )  # fmt: skip


class _Distance(NamedTuple):
    """A joint path with its limits as a function of the distance x that the tool travels, or turns.

    At the table's points: s (m,), its derivatives over x (3, m), and which (m,) are knots of s(x). Elsewhere s(x) is linear.
    """

    joint_path: JointPath
    limits: MotionLimits
    s: Array
    rates: Array
    knots: Flags
    table: RampTable
    turning: bool


def _distance(joint_path: JointPath, limits: MotionLimits) -> _Distance:
    """Return the path as a function of the tool's own distance, which is proportional to s on straight lines.

    With c = dx/ds the tool's speed at ṡ = 1: s' = 1 / c, s'' = −c' / c³, s''' = (3 c'² − c c'') / c⁵.
    """
    path, end = joint_path.path, joint_path.end
    s, knots = _make_grid(path.breaks, end)
    turning = bool(path.turns_only or np.linalg.norm(path.twist(s)[:, :3], axis=1).max() <= 1e-9)
    while True:
        c, c1, c2 = _rates(joint_path, s, turning)
        if c.min() <= 1e-6 * c.max():
            raise NoSolution(
                f"the tool point does not move at s = {s[c.argmin()]:.6g}: no speed of it is constant along this path",
                s=float(s[c.argmin()]), advice="another law, with tool_speed= or rotation_speed= as limits",
            )  # fmt: skip
        h = np.diff(s)
        slope = np.abs(c1) / c
        steep = (np.maximum(slope[:-1], slope[1:]) * h > STEEP) & (h > SAME_BREAK * end)
        if not steep.any():
            break
        s, knots = np.append(s, 0.5 * (s[:-1] + s[1:])[steep]), np.append(knots, np.ones(steep.sum(), np.bool_))
        order = np.argsort(s)
        s, knots = s[order], knots[order]
    # the integral over each cell of the quintic through c, c' and c'' at both its ends
    cells = 0.5 * h * (c[:-1] + c[1:]) - 0.1 * h**2 * np.diff(c1) + h**3 / 120.0 * (c2[:-1] + c2[1:])
    wide = np.maximum(np.append(h, 0.0), np.append(0.0, h))
    bent = np.maximum(np.abs(c1) * wide, np.abs(c2) * wide**2) > STRAIGHT_CELL * c
    bent |= np.append(bent[1:], False) | np.append(False, bent[:-1])
    rates = np.stack([1.0 / c, -c1 / c**3, (3.0 * c1**2 - c * c2) / c**5])
    q, *orders = derivatives(joint_path, s)
    along = _sectional.limit_rows(
        limits, PathPoints(joint_path, s, (q, *apply_chain_rule(orders, [y[:, None] for y in rates])))
    )
    x = np.concatenate([[0.0], np.cumsum(cells)])
    table = RampTable(x, 1.0 / (speed_bound(joint_path, limits, s) * c), along)
    return _Distance(joint_path, limits, s, rates, bent & knots, table, turning)


def _make_grid(breaks: Array, end: float) -> tuple[Array, Flags]:
    """Return points from 0 to the end, equally spaced between breaks, and which are knots; nearly equal breaks are merged."""
    ends = [0.0]
    for place in breaks[breaks < (1.0 - SAME_BREAK) * end]:
        if place - ends[-1] > SAME_BREAK * end:
            ends.append(place)
    length = np.diff(ends, append=end)
    cells, knots = (
        np.maximum(np.ceil(length * (most / end)), DISTANCE_PER_PIECE).astype(np.int64)
        for most in (DISTANCE_CELLS, LEAST_KNOTS)
    )
    within = np.arange(cells.sum()) - np.repeat(np.cumsum(cells) - cells, cells)
    s = np.repeat(ends, cells) + np.repeat(length / cells, cells) * within
    return np.append(s, end), np.append(within % np.repeat(cells // knots, cells) == 0, np.True_)


def _rates(joint_path: JointPath, s: Array, turning: bool) -> tuple[Array, Array, Array]:
    """Return the tool's |v| or |ω| per unit of s (k,), and its first and second derivative in s."""
    part = slice(3, 6) if turning else slice(0, 3)
    v, v1, v2 = (joint_path.path.twist(s, order)[:, part] for order in (1, 2, 3))
    c = np.linalg.norm(v, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        c1 = (v * v1).sum(axis=1) / c
        return c, c1, ((v1 * v1).sum(axis=1) + (v * v2).sum(axis=1) - c1 * c1) / c


def _ramp(what: RampTable, last: bool, length: float, speed: float, shape: tuple[float, float]) -> Ramp:
    end = float(what.s[-1])
    return Ramp(end - length, speed, end, 0.0, *shape) if last else Ramp(0.0, 0.0, length, speed, *shape)


def _cruising(what: RampTable, start: float, end: float) -> tuple[int, float]:
    """Return where a constant speed of 1 from start to end exceeds the limits most, and the factor."""
    low, high = np.searchsorted(what.s, [start, end])
    at = slice(max(low - 1, 0), high + 1)
    size = np.abs(what.parts[at]).max(axis=2)
    factor = np.maximum(what.slowness[at], np.maximum(np.sqrt(size[:, 1]), np.cbrt(size[:, 4])))
    k = int(factor.argmax())
    return at.start + k, float(factor[k])


def _slowdown_factor(what: RampTable, ramp: Ramp, most: float = np.inf) -> float:
    """Return the factor by which a ramp must be slowed, from as many instants as points; infinite if it is above `most`."""
    inside = int(np.searchsorted(what.s, ramp.s1) - np.searchsorted(what.s, ramp.s0))
    return _sectional.ratio_of(what, ramp, max(24, inside), most)


def _is_quick(ramp: Ramp, slow: float, shortest: float) -> bool:
    """Return whether the acceleration rises or falls in less than the shortest time, after slowing the motion."""
    duration = 2.0 * (ramp.s1 - ramp.s0) / (ramp.v0 + ramp.v1)
    return min(ramp.rise, ramp.fall) * duration * slow < shortest


def _find_widest(what: RampTable, share: float, shortest: float) -> list[Ramp]:
    """Return the ramps to the greatest speed: of the lengths and shapes that need the least stretching from speed 1."""
    end = float(what.s[-1])
    cruising = _cruising(what, share * end, (1.0 - share) * end)[1]
    chosen: list[tuple[float, Ramp]] = []
    for last in (False, True):
        best: dict[bool, tuple[float, Ramp]] = {}  # for ramps that are too quick, and for others
        for length in end * share * np.array(RAMP_LENGTHS):
            for shape in RAMP_SHAPES:
                ramp = _ramp(what, last, length, 1.0, shape)
                factor = _slowdown_factor(what, ramp, max(b[0] for b in best.values()) if best else np.inf)
                quick = _is_quick(ramp, factor, shortest)
                if quick not in best or max(factor, cruising) < best[quick][0]:
                    best[quick] = max(factor, cruising), ramp
            if best.get(False, (np.inf,))[0] == cruising:
                break
        chosen.append(best.get(False) or best[True])
    (one, first), (other, second) = chosen
    slow = max(one, other, _cruising(what, first.s1, second.s0)[1])
    return [first._replace(v1=1.0 / slow), second._replace(v0=1.0 / slow)]


def _find_shortest(what: RampTable, speed: float, share: float, room: float, shortest: float) -> list[Ramp] | None:
    """Return the shortest ramps to a speed that respect a fraction of the limits; None if the longest ones do not."""
    end, out = float(what.s[-1]), []
    if _cruising(what, share * end, (1.0 - share) * end)[1] * speed > 1.0 + 1e-3:
        return None
    for last in (False, True):
        best: Ramp | None = None
        for shape in RAMP_SHAPES:
            low, high = 0.0, share * end if best is None else (best.s1 - best.s0) * (1.0 - 1e-4)
            if not _is_allowed(what, _ramp(what, last, high, speed, shape), room, shortest):
                continue
            for _ in range(12):
                middle = 0.5 * (low + high)
                if _is_allowed(what, _ramp(what, last, middle, speed, shape), room, shortest):
                    high = middle
                else:
                    low = middle
            best = _ramp(what, last, high, speed, shape)
        if best is None:
            return None
        out.append(best)
    return out if _cruising(what, out[0].s1, out[1].s0)[1] * speed <= 1.0 + 1e-3 else None


def _is_allowed(what: RampTable, ramp: Ramp, room: float, shortest: float) -> bool:
    return not _is_quick(ramp, 1.0, shortest) and _slowdown_factor(what, ramp, room) <= room


def _law(distance: _Distance, ramps: list[Ramp]) -> scipy.interpolate.PPoly:
    """Return s(t) for a ramp, constant speed and a ramp of the travelled distance."""
    first, second = ramps
    chain = [first, second]
    if second.s0 > first.s1:
        chain.insert(1, Ramp(first.s1, first.v1, second.s0, second.v0, 0.49, 0.49))
    x_law = _sectional.law_of(chain, [_sectional.phases_of(ramp) for ramp in chain])
    places, switches, end = distance.table.s, x_law.x, float(x_law.x[-1])
    inner = np.flatnonzero(distance.knots[1:-1]) + 1
    t, apart = find_times(x_law, places[inner], end), KNOTS_APART * min(1.0, end)
    after = np.clip(np.searchsorted(switches, t), 1, switches.size - 1)
    kept = np.minimum(t - switches[after - 1], switches[after] - t) > apart
    inner, t = inner[kept], t[kept]
    kept = select_spaced(t, end, apart)
    inner, t = inner[kept], np.concatenate([switches, t[kept]])
    s_of_x = quintic_through(places, *(y[:, None] for y in (distance.s, *distance.rates[:2])))
    at_switches = (s_of_x(x_law(switches), order)[:, 0] for order in range(3))
    order = np.argsort(t)
    s, *over_x = (
        np.append(a, b[inner])[order][:, None]
        for a, b in zip(at_switches, (distance.s, *distance.rates[:2]), strict=True)
    )
    t = t[order]
    velocity, acceleration = apply_chain_rule(over_x, [x_law(t, order)[:, None] for order in (1, 2)])
    return scipy.interpolate.PPoly(quintic_through(t, s, velocity, acceleration).c[..., 0], t, extrapolate=True)


def _build(distance: _Distance, ramps: list[Ramp]) -> Trajectory:
    joint_path = distance.joint_path
    return refit(joint_path, _law(distance, ramps), distance.limits.arrays(joint_path.robot.n)["jerk"])


def _find_worst(distance: _Distance, ramps: list[Ramp], speed: float) -> tuple[RampRatio, bool]:
    """Return the most exceeded limit of the motion with these ramps at this speed, and whether it is in a ramp."""
    what, (first, second) = distance.table, ramps
    k = np.array([_cruising(what, first.s1, second.s0)[0]])
    found = _judge(distance, k, [np.array([y]) for y in (speed, 0.0, 0.0)])
    in_ramp = False
    for ramp in (first._replace(v1=speed), second._replace(v0=speed)):
        law = _sectional.law_of([ramp], [_sectional.phases_of(ramp)])
        near = np.arange(np.searchsorted(what.s, ramp.s0), np.searchsorted(what.s, ramp.s1))
        t = find_times(law, what.s[near], float(law.x[-1]))
        rates = [law(t, order) for order in (1, 2, 3)]
        other = _judge(distance, near, rates)
        if other.factor > found.factor:
            found, in_ramp = other, True
    return found, in_ramp


def _judge(distance: _Distance, at: Indices, rates: Sequence[Array]) -> RampRatio:
    """Return the most exceeded limit at points of the table, for a speed, acceleration and jerk along the distance."""
    along_path = apply_chain_rule(list(distance.rates[:, at]), list(rates))
    return _sectional.find_worst(distance.joint_path, distance.limits, distance.s[at], *along_path)


def _round_down(x: float) -> float:
    """Round down to six digits."""
    unit = 10.0 ** (np.floor(np.log10(x)) - 5.0)
    return float(np.floor(x / unit * (1.0 - 1e-9)) * unit)


METHOD = ConstantSpeed
