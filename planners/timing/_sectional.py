"""Sections of a path for the laws ruckig and constant_speed: ramps of the speed along s, by dynamic programming."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.following.follow import JointPath
from planners.limits import TOOL_SPEEDS, MotionLimits, PathPoints, kind_of
from planners.paths.base import Path
from planners.timing import _sweep
from planners.timing._sweep import make_graded_grid
from planners.timing.base import speed_bound

# ---------------- ramps of the speed along s, and their ratios to the limits of the joints


TABLE_INTERVALS, TABLE_PER_PIECE = 1024, 12
"""Least number of intervals of a table, and the number in the path's shortest piece."""
LEAST_FLAT = 0.02
"""Least fraction of a ramp with constant acceleration: without it Ruckig's roots lose half their digits; it costs 1e-4 of T."""
SHORTEST_PHASE = 5e-4
"""Least time [s] in which the acceleration rises or falls: shorter phases save no time and are dominated by round-off."""


class Ramp(NamedTuple):
    """Ramp from speed v0 at s0 to v1 at s1, with zero acceleration at both ends.

    The acceleration rises in the fraction `rise` of the time, is constant, and falls in the fraction `fall`; their sum is at
    most 1 − `LEAST_FLAT`.
    """

    s0: float
    v0: float
    s1: float
    v1: float
    rise: float
    fall: float


class RampTable(NamedTuple):
    """Coefficients of a motion along s over the limits of the arm, at grid points.

    Attributes
    ----------
    s : (m,) array
        Path parameters, from 0 to the path's end.
    slowness : (m,) array
        1 / greatest ṡ by the limits on velocities (joints, tool, rotation).
    parts : (m, 5, n) array
        q'/a, q''/a, q'/j, 3 q''/j, q'''/j, where a and j are each joint's limits: q̈ / a = (q' s̈ + q'' ṡ²) / a and
        q⃛ / j = (q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³) / j.
    """

    s: Array
    slowness: Array
    parts: Array


def make_table(joint_path: JointPath, limits: MotionLimits) -> RampTable:
    """Return the table at path parameters that include every break and are dense where pieces are short."""
    breaks, end = joint_path.path.breaks, joint_path.end
    s = make_graded_grid(breaks[breaks < end], end, TABLE_INTERVALS, TABLE_PER_PIECE)
    slowness = 1.0 / speed_bound(joint_path, limits, s)
    if any(np.ndim(limits.value(name)) for name in TOOL_SPEEDS):  # the lesser speed also half a cell beyond its segment
        slowness = np.maximum(slowness, np.maximum(np.append(slowness[1:], 0.0), np.append(0.0, slowness[:-1])))
    return RampTable(s, slowness, limit_rows(limits, PathPoints(joint_path, s)))


def limit_rows(limits: MotionLimits, at: PathPoints) -> Array:
    """Return the `parts` of a table: rows of the acceleration and jerk limits; of a pair, the side nearer to zero counts."""
    bound = limits.arrays(at.joint_path.robot.n)
    rows = np.concatenate([kind_of(name).rows(at, bound[name]) for name in ("acceleration", "jerk")], axis=2)
    return np.ascontiguousarray(rows.transpose(0, 2, 1))


EQUAL_LIMITS = 1e-9
"""Largest relative difference of limits that are the same everywhere on a path: rounding."""


def constant_limits(path: Path, table: RampTable) -> tuple[float, float, float] | None:
    """Return the limits on ṡ, s̈ and s⃛ of a straight path in joint space; None if they vary along the path."""
    bounds = path.joint_bounds()
    size = np.abs(table.parts).max(axis=2)
    rows = np.column_stack([table.slowness, size[:, 0], size[:, 2]])
    least, most = rows.min(axis=0), rows.max(axis=0)
    if bounds is None or not (least > 0.0).all() or (most - least > EQUAL_LIMITS * most).any():
        return None
    bends = (bounds.max(axis=(0, 2)) * path.end ** np.arange(4))[1:]
    return None if bends.max() > EQUAL_LIMITS else (float(1.0 / most[0]), float(1.0 / most[1]), float(1.0 / most[2]))


@compiled
def profile(d: float, v0: float, v1: float, rise: float, fall: float) -> tuple[float, float]:
    """Return the duration and the greatest acceleration of a ramp of length d.

    The ramp's mean speed is v0 + κ (v1 − v0), where κ is how far before the end the trapezoid's centroid lies.

    Shapes and units: d [m, rad], v0, v1 [m/s, rad/s], rise, fall [1]. Returns [s].
    """
    area = 1.0 - 0.5 * (rise + fall)
    flat_end = 1.0 - fall
    centroid = (
        rise * rise / 3.0 + 0.5 * (flat_end * flat_end - rise * rise) + 0.5 * fall * (flat_end + fall / 3.0)
    ) / area
    duration = d / (v0 + (v1 - v0) * (1.0 - centroid))
    return duration, (v1 - v0) / (duration * area)


@compiled
def nearest(places: Array, s: float) -> int:
    """Return the index of the grid point nearest to s.

    Shapes and units: places (m,) [m, rad], s [m, rad].
    """
    k = min(max(int(np.searchsorted(places, s)), 1), places.size - 1)
    return k - 1 if s - places[k - 1] < places[k] - s else k


@compiled
def ramp_ratio(
    what: RampTable, s: float, v: float, ramp: tuple[float, float, float, float], count: int, most: float
) -> float:
    """Return the factor by which a ramp must be stretched to respect the limits at its samples.

    It samples `count` + 1 instants of each of the three phases, at the nearest grid points of the table, and stops when the
    factor exceeds `most`.

    Shapes and units: s, v [m, rad], ramp (4,) [s], most [1]. Returns [1].
    """
    places, slowness, parts = what.s, what.slowness, what.parts
    duration, peak, rise, fall = ramp
    worst_v, worst_a, worst_j = 0.0, 0.0, 0.0
    most_a, most_j = most * most, most * most * most
    a = 0.0
    for phase in range(3):
        share = rise if phase == 0 else (1.0 - rise - fall if phase == 1 else fall)
        h = share * duration
        if h <= 0.0:
            continue
        j = peak / h if phase == 0 else (0.0 if phase == 1 else -peak / h)
        for i in range(count + 1):
            t = h * i / count
            at = s + t * (v + t * (0.5 * a + t * j / 6.0))
            speed = v + t * (a + 0.5 * t * j)
            acceleration = a + j * t
            k = nearest(places, at)
            worst_v = max(worst_v, slowness[k] * speed)
            square, product, cube = speed * speed, speed * acceleration, speed * speed * speed
            p = parts[k]
            for n in range(p.shape[1]):
                worst_a = max(worst_a, abs(p[0, n] * acceleration + p[1, n] * square))
                worst_j = max(worst_j, abs(p[2, n] * j + p[3, n] * product + p[4, n] * cube))
            if worst_v > most or worst_a > most_a or worst_j > most_j:
                return np.inf
        s += h * (v + h * (0.5 * a + h * j / 6.0))
        v += h * (a + 0.5 * h * j)
        a += j * h
    worst: float = max(worst_v, max(worst_a**0.5, worst_j ** (1.0 / 3.0)))
    return worst


def ratio_of(what: RampTable, ramp: Ramp, count: int = 24, most: float = np.inf) -> float:
    """Return the factor by which a ramp must be stretched to respect the limits."""
    duration, peak = profile(ramp.s1 - ramp.s0, ramp.v0, ramp.v1, ramp.rise, ramp.fall)
    shape = (duration, peak, ramp.rise, ramp.fall)
    return float(ramp_ratio(what, ramp.s0, ramp.v0, shape, count, most))


def phases_of(ramp: Ramp) -> Array:
    """Return the durations and jerks of the phases of a ramp."""
    duration, peak = profile(ramp.s1 - ramp.s0, ramp.v0, ramp.v1, ramp.rise, ramp.fall)
    if ramp.v0 == ramp.v1:
        return np.array([[duration, 0.0]])
    rise, fall = ramp.rise * duration, ramp.fall * duration
    return np.array([[rise, peak / rise], [duration - rise - fall, 0.0], [fall, -peak / fall]])


def law_of(ramps: list[Ramp], phases: list[Array]) -> scipy.interpolate.PPoly:
    """Return s(t) along ramps."""
    rows, lengths = [], []
    for ramp, each in zip(ramps, phases, strict=True):
        s, v, a = ramp.s0, ramp.v0, 0.0
        for h, j in each:
            rows.append((j / 6.0, 0.5 * a, v, s))
            lengths.append(h)
            s, v, a = s + h * (v + h * (0.5 * a + h * j / 6.0)), v + h * (a + 0.5 * h * j), a + h * j
    return scipy.interpolate.PPoly(np.array(rows).T, np.concatenate([[0.0], np.cumsum(lengths)]), extrapolate=True)


class RampRatio(NamedTuple):
    """The most exceeded limit of a motion: the factor by which it must be stretched, the path parameter and the joint."""

    factor: float
    s: float
    joint: str | None
    limit: str


def find_worst(joint_path: JointPath, limits: MotionLimits, s: Array, v: Array, a: Array, j: Array) -> RampRatio:
    """Return the most exceeded limit of a motion along s, by the chain rule."""
    at = PathPoints(joint_path, np.clip(s, 0.0, joint_path.end))
    kinds = [kind for kind in limits.kinds if kind.homogeneous]
    ratios = [limits.ratios(kind.name, at, (v, a, j)) ** (1.0 / kind.order) for kind in kinds]
    columns = [(kind, i) for kind, ratio in zip(kinds, ratios, strict=True) for i in range(ratio.shape[1])]
    together = np.concatenate(ratios, axis=1)
    place, column = np.unravel_index(int(np.nanargmax(together)), together.shape)
    kind, i = columns[column]
    joint = joint_path.robot.joint_names[i] if kind.subject is None else None
    return RampRatio(float(together[place, column]), float(at.s[place]), joint, kind.name.replace("_", " "))


# ---------------- sections of a path and the speeds at their ends


SECTION_PLACES = 14
"""Intervals between candidate ends of sections; twice as many are no faster on lines (T / T* 1.036 for 1.037)."""
SPEED_LEVELS = np.array([1.0, 0.93, 0.86, 0.78, 0.7, 0.62, 0.54, 0.46, 0.38, 0.3, 0.22, 0.15, 0.08])
"""Candidate speeds at a grid point, over the greatest that the limits could allow there."""
SECTION_SHAPES = np.array([[0.49, 0.49], [0.25, 0.25], [0.1, 0.1], [0.25, 0.73], [0.73, 0.25]])
"""Candidate fractions of a ramp in which its acceleration rises and falls."""
SECTION_REACH = 24
"""Largest number of intervals of one section; it bounds the work of the dynamic programming."""
BRIEF = 4.0
"""Least time at full speed between two breaks that are both ends of sections, over the shortest phase of a ramp."""
REACHED_TRIAL = 4
"""Trial from which on candidate speeds are at most 1.5 times those of a motion swept along the path."""
RAMP_SAMPLES = 5
"""Intervals of each phase of a ramp that the local search samples: few, as it evaluates ramps thousands of times."""
SEARCH = ((4, 15), (6, 15))
"""Sharpness (a power of two) and rounds of the local search, in turn."""


def find_sections(what: RampTable, breaks: Array, duration: float) -> list[Ramp]:
    """Return ramps from rest to rest along the whole table, nearly as fast as its limits allow."""
    fastest = _fastest(what.slowness, what.parts, what.s)
    shortest = min(SHORTEST_PHASE, 0.01 * duration)
    nodes, open_since = _find_candidates(what, fastest, breaks, BRIEF * shortest)
    speeds = fastest[nodes][:, None] * SPEED_LEVELS
    speeds[[0, -1]] = -1.0
    speeds[[0, -1], 0] = 0.0
    most = 1.0 + 1e-9  # candidates that stand exactly on a limit are in, however they round
    tried = 0
    while True:
        tried += 1
        if tried == REACHED_TRIAL:  # beside a slow corner few of these speeds can be reached at all
            speeds[1:-1] = np.minimum(speeds[1:-1, :1], 1.5 * _sweep_speeds(what)[nodes[1:-1], None]) * SPEED_LEVELS
        chain = _find_chain(what, what.s[nodes], open_since, speeds, most, shortest)
        if chain.shape[0] or most > 1e6:
            break
        most *= 1.3  # no candidate speed is low enough: take a motion that is too fast, and let it be slowed
    fixed = np.isin(chain[:, 2], what.s[nodes[open_since[1:]]])
    for sharpness, rounds in SEARCH:
        slow = max(_ratio(what, ramp) for ramp in chain)
        _search(what, chain, fixed, rounds, (sharpness, slow, shortest / slow))
    return [Ramp(*map(float, row)) for row in chain]


def _sweep_speeds(what: RampTable) -> Array:
    """Return the speeds of a motion along the table that nearly respects all limits."""
    parts = what.parts
    size = np.abs(parts).max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        jerk = np.where(size[2] > 0.0, size[0] / size[2], np.inf)
        q3 = np.where(np.isfinite(jerk), parts[:, 4] * jerk, 0.0)
    most = 1e3 / np.abs(parts[:, 0]).max(axis=1).mean(), 1e3 / np.abs(parts[:, 2]).max(axis=1).mean()
    along = _sweep.Along(
        what.s, parts[:, 0].copy(), parts[:, 1].copy(), q3, np.ones(jerk.size), jerk,
        np.minimum(1.0 / np.maximum(what.slowness, 1e-12), 1e12), (float(most[0]), float(most[1])),
    )  # fmt: skip
    motion = np.empty((4, what.s.size))
    _sweep.sweep_path(along, _sweep.speed_bounds(along, 0.8, 0.6), 6, 1.1, motion)
    return np.asarray(motion[1])


def _ratio(what: RampTable, ramp: Array) -> float:
    s0, v0, s1, v1, rise, fall = ramp
    duration, peak = profile(s1 - s0, v0, v1, rise, fall)
    return float(ramp_ratio(what, s0, v0, (duration, peak, rise, fall), 16, np.inf))


def _fastest(slowness: Array, parts: Array, s: Array) -> Array:
    """Return the approximate greatest ṡ at each grid point, by its limits and by the distance to rest at either end."""
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.abs(parts).max(axis=2)
        here = 1.0 / np.maximum(slowness, np.maximum(np.sqrt(size[:, 1]), np.cbrt(size[:, 4])))
        accelerations, jerks = 1.0 / size[:, 0], 1.0 / size[:, 2]
        for order in (slice(None), slice(None, None, -1)):
            travelled = s if order.step is None else s[-1] - s[::-1]
            cells = np.diff(travelled, prepend=0.0)
            by_acceleration = np.sqrt(2.0 * np.cumsum(accelerations[order] * cells))
            by_jerk = np.cbrt(4.5 * np.maximum.accumulate(jerks[order]) * travelled**2)
            here[order] = np.fmin(here[order], np.fmin(by_acceleration, by_jerk))
    finite = np.isfinite(here)
    return np.asarray(np.where(finite, here, here[finite].max()))


def _find_candidates(what: RampTable, fastest: Array, breaks: Array, brief: float) -> tuple[Indices, Indices]:
    """Return indices (k,) of candidate ends of sections, and for each that of the last break before it.

    Breaks that are passed within a `brief` time after another count as one with it: no ramp fits between. Places are spread
    half by s and half by time; each piece between two breaks has its ends and its quarters besides.
    """
    s, last = what.s, what.s.size - 1
    slow = 1.0 / np.maximum(fastest, 0.15 * fastest.max())
    time = np.concatenate([[0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(s))])
    even = np.interp(np.linspace(0.0, 1.0, SECTION_PLACES + 1), 0.5 * time / time[-1] + 0.5 * s / s[-1], s)
    passed = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(s) / (fastest[1:] + fastest[:-1]))])
    kept = [0.0]
    for x in breaks[(breaks > 0.0) & (breaks < s[-1])]:
        before, at, end = np.interp([kept[-1], x, s[-1]], s, passed)
        if at - before >= brief and end - at >= brief:
            kept.append(float(x))
    breaks = np.array([*kept, s[-1]])
    quarters = breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(4) / 4.0
    pieces = quarters.ravel() if breaks.size > 2 else np.empty(0)
    nodes = np.unique(_nearest(s, np.concatenate([even, pieces, [0.0, s[last]]])))
    ends = np.unique(np.searchsorted(nodes, _nearest(s, breaks[:-1])))
    return nodes, ends[np.maximum(np.searchsorted(ends, np.arange(nodes.size)) - 1, 0)]


def _nearest(s: Array, x: Array) -> Indices:
    """Return the indices of the grid points nearest to x (k,)."""
    k = np.clip(np.searchsorted(s, x), 1, s.size - 1)
    return np.where(x - s[k - 1] < s[k] - x, k - 1, k)


@compiled
def _find_chain(what: RampTable, s: Array, open_since: Indices, speeds: Array, most: float, shortest: float) -> Array:
    """Return the fastest chain of ramps between candidates whose samples respect the limits (k, 6); (0, 6) if there is none.

    A ramp to place i starts at place open_since[i] or later.

    Returns (k, 6).
    """
    count, levels = speeds.shape
    best = np.full((count, levels), np.inf)
    back = np.zeros((count, levels, 3), np.int64)
    best[0, 0] = 0.0
    for to in range(1, count):
        for high in range(levels):
            v1 = speeds[to, high]
            for at in range(to - 1, max(to - 1 - SECTION_REACH, open_since[to] - 1), -1):
                for low in range(levels):
                    v0 = speeds[at, low]
                    if v1 < 0.0 or v0 < 0.0 or v0 + v1 <= 0.0 or best[at, low] >= best[to, high]:
                        continue
                    for shape in range(SECTION_SHAPES.shape[0]):
                        rise, fall = SECTION_SHAPES[shape, 0], SECTION_SHAPES[shape, 1]
                        duration, peak = profile(s[to] - s[at], v0, v1, rise, fall)
                        better = best[at, low] + duration < best[to, high] * (1.0 - 1e-12)  # ties: the first stays
                        if not better or min(rise, fall) * duration < shortest:
                            continue
                        ramp = (duration, peak, rise, fall)
                        if ramp_ratio(what, s[at], v0, ramp, 4, most) <= most:
                            best[to, high] = best[at, low] + duration
                            back[to, high, 0], back[to, high, 1], back[to, high, 2] = at, low, shape
    if not np.isfinite(best[-1, 0]):
        return np.empty((0, 6))
    chain = np.empty((count, 6))
    to, high, k = count - 1, 0, count
    while to > 0:
        at, low, shape = back[to, high]
        k -= 1
        chain[k, 0], chain[k, 1], chain[k, 2], chain[k, 3] = s[at], speeds[at, low], s[to], speeds[to, high]
        chain[k, 4], chain[k, 5] = SECTION_SHAPES[shape, 0], SECTION_SHAPES[shape, 1]
        to, high = at, low
    return chain[k:].copy()


@compiled
def _power(what: RampTable, row: Array, count: int, sharpness: int, slow: float) -> tuple[float, float]:
    """Return the duration of a ramp, and the time integral of the sum of r^p over all limits, p = 3 · 2^sharpness.

    r is the ratio of velocity, acceleration and jerk to its limit to the power 1, 1/2 and 1/3, after stretching by `slow`.
    """
    places, slowness, parts = what.s, what.slowness, what.parts
    duration, peak = profile(row[2] - row[0], row[1], row[3], row[4], row[5])
    s, v, a, total = row[0], row[1], 0.0, 0.0
    r1, r2, r3 = 1.0 / slow, 1.0 / slow**2, 1.0 / slow**3
    for phase in range(3):
        share = row[4] if phase == 0 else (1.0 - row[4] - row[5] if phase == 1 else row[5])
        h = share * duration
        j = peak / h if phase == 0 else (0.0 if phase == 1 else -peak / h)
        integral = 0.0
        for i in range(count + 1):
            t = h * i / count
            at = s + t * (v + t * (0.5 * a + t * j / 6.0))
            speed, acceleration = v + t * (a + 0.5 * t * j), a + j * t
            k = min(max(np.searchsorted(places, at) - 1, 0), slowness.size - 2)
            f = (at - places[k]) / (places[k + 1] - places[k])
            g = 1.0 - f
            c0, c1 = acceleration * r2, speed * speed * r2
            c2, c3, c4 = j * r3, speed * acceleration * r3, speed * speed * speed * r3
            p, q = parts[k], parts[k + 1]
            z = ((slowness[k] * g + slowness[k + 1] * f) * speed * r1) ** 3
            for _ in range(sharpness):
                z *= z
            for n in range(p.shape[1]):
                x = abs((p[0, n] * g + q[0, n] * f) * c0 + (p[1, n] * g + q[1, n] * f) * c1)
                y = abs(
                    (p[2, n] * g + q[2, n] * f) * c2
                    + (p[3, n] * g + q[3, n] * f) * c3
                    + (p[4, n] * g + q[4, n] * f) * c4
                )
                x *= x**0.5
                for _ in range(sharpness):
                    x *= x
                    y *= y
                z += x + y
            integral += 0.5 * z if i == 0 or i == count else z
        total += integral / count * h
        s += h * (v + h * (0.5 * a + h * j / 6.0))
        v += h * (a + 0.5 * h * j)
        a += j * h
    return duration, total


class _Measures(NamedTuple):
    """Durations, integrals of `_power`, their sums from each ramp on (k + 3,), and least lengths, of ramps (k,)."""

    time: Array
    power: Array
    left_time: Array
    left_power: Array
    least: Array


@compiled
def _move(ramps: Array, k: int, number: int, move: float) -> None:
    """Change one of the four variables of a ramp: s and the speed of its end, its rise and its fall."""
    if number == 0:
        ramps[k, 2] += move
        ramps[k + 1, 0] = ramps[k, 2]
    elif number == 1:
        ramps[k, 3] *= np.exp(move)
        ramps[k + 1, 1] = ramps[k, 3]
    else:
        other = ramps[k, 7 - number]
        ramps[k, 2 + number] = min(max(ramps[k, 2 + number] + move, 0.02), 1.0 - LEAST_FLAT - other)


@compiled
def _cost(
    what: RampTable,
    ramps: Array,
    k: int,
    end: int,
    done: tuple[float, float],
    at: _Measures,
    aim: tuple[int, float, float],
) -> float:
    """Return the logarithm of the scaled duration after a change of ramps k to end − 1; infinite if one is too short."""
    sharpness, slow, shortest = aim
    for i in range(k, end):
        if not ramps[i, 2] - ramps[i, 0] > at.least[i]:
            return np.inf
    allowed = True
    for i in range(k, end):
        at.time[i], at.power[i] = _power(what, ramps[i], RAMP_SAMPLES, sharpness, slow)
        allowed = allowed and min(ramps[i, 4], ramps[i, 5]) * at.time[i] >= shortest
    if not allowed:
        return np.inf
    total, mean = done[0] + at.left_time[k + 2], done[1] + at.left_power[k + 2]
    for i in range(k, min(k + 2, len(ramps))):
        total, mean = total + at.time[i], mean + at.power[i]
    return float(np.log(total) + np.log(mean / total) / (3.0 * 2.0**sharpness))


@compiled
def _search(what: RampTable, ramps: Array, fixed: Flags, rounds: int, aim: tuple[int, float, float]) -> None:
    """Improve the ends and shapes of ramps (k, 6), in place, one variable at a time, while the scaled motion gets faster.

    Ends that are fixed (k,) stay. `aim` is the sharpness, the slowing and the shortest phase. The duration after a uniform
    scaling to the limits is (duration) · (largest r); a mean of order p = 3 · 2^sharpness stands for the largest, so that
    every step that brings a ramp away from its limits counts, and not only those at the worst place.
    """
    count, lengths = len(ramps), ramps[:, 2] - ramps[:, 0]
    least = np.minimum(1e-3 * ramps[-1, 2], 0.25 * lengths)
    at = _Measures(np.empty(count), np.empty(count), np.zeros(count + 3), np.zeros(count + 3), least)
    for k in range(count):
        at.time[k], at.power[k] = _power(what, ramps[k], RAMP_SAMPLES, aim[0], aim[1])
    best = np.log(at.time.sum()) + np.log(at.power.sum() / at.time.sum()) / (3.0 * 2.0 ** aim[0])
    step = np.empty((count, 4))
    step[:, 0], step[:, 1], step[:, 2], step[:, 3] = np.minimum(0.02 * ramps[-1, 2], 0.5 * lengths), 0.05, 0.1, 0.1
    kept, kept_time, kept_power = np.empty((2, 6)), np.empty(2), np.empty(2)
    for _ in range(rounds):
        for k in range(count - 1, -1, -1):
            at.left_time[k] = at.left_time[k + 1] + at.time[k]
            at.left_power[k] = at.left_power[k + 1] + at.power[k]
        done = (0.0, 0.0)
        for k in range(count):
            for number in range(4):
                junction = number < 2
                if (junction and k == count - 1) or (number == 0 and fixed[k]):
                    continue
                end, better = k + 2 if junction else k + 1, False
                for sign in (1.0, -1.0):
                    for i in range(k, end):
                        kept[i - k], kept_time[i - k], kept_power[i - k] = ramps[i], at.time[i], at.power[i]
                    move = sign * step[k, number]
                    _move(ramps, k, number, move)
                    value = _cost(what, ramps, k, end, done, at, aim)
                    if value < best - 1e-12:
                        best, better, step[k, number] = value, True, 1.5 * move
                        break
                    for i in range(k, end):
                        ramps[i], at.time[i], at.power[i] = kept[i - k], kept_time[i - k], kept_power[i - k]
                if not better:
                    step[k, number] *= 0.5
            done = (done[0] + at.time[k], done[1] + at.power[k])
