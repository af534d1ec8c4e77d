"""Ramps of the speed along s, and their ratios to the limits of the joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from optik.compiled import compiled
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import TOOL_SPEEDS, MotionLimits, PathPoints, kind_of
from planners.paths.base import Path
from planners.timing._sweep import make_graded_grid
from planners.timing.base import speed_bound

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
