"""Come to rest on the path from a moving state: the shortest of many stops that keeps every limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from optik.errors import NoSolution
from planners.follow import JointPath
from planners.timing._ramps import SHORTEST, Table, states, table, worst
from planners.timing._ruckig import velocity_control
from planners.timing.base import MotionLimits

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""By how much a limit may be passed before it counts: a start that stands exactly on it comes with rounding."""
MARGINS = (0.999, 0.99, 0.97, 0.94)
"""Shares of the limits that stops are chosen within, in turn, until the exact evaluation agrees."""
TRIED = 3
"""How many of the chosen stops are evaluated exactly for each margin."""
JERKS = np.geomspace(1.0, 1e-5, 61)
SHARES = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05])
"""Candidate jerks over the greatest there can be, and accelerations over the one that would need no flat part."""


def stop_from(joint_path: JointPath, limits: MotionLimits, s: float, v: float, a: float) -> PPoly:
    """s(t) from the state (s, v, a) to rest, by Ruckig, evaluated at 65 instants of every piece.

    Raises
    ------
    NoSolution
        The state breaks a limit, the path ends too soon, or every stop breaks a limit on its way.
    """
    state = worst(joint_path, limits, np.array([s]), np.array([v]), np.array([a]), np.full(1, np.nan))
    if state.factor > 1.0 + ROUNDING:
        raise NoSolution(
            f"the state at s = {s:.6g} itself breaks the limit on {state.limit}: {state.factor:.6g} times too fast",
            s=s, joint=state.joint, advice="a state of a motion within these limits",
        )  # fmt: skip
    what = table(joint_path, limits)
    jerks, peaks = _candidates(what, s, v, a)
    duration, end, factor = _judged(what, s, v, a, jerks, peaks)
    inside = end <= joint_path.end
    for margin in MARGINS:
        good = np.flatnonzero(inside & (factor <= margin))
        for i in good[np.argsort(duration[good], kind="stable")][:TRIED]:
            phases = velocity_control((v, a), (0.0, 0.0), float(peaks[i]), float(jerks[i]))
            law = _law(s, v, a, phases)
            along = states(law)
            if law(law.x[-1]) <= joint_path.end and along[1].min() >= -ROUNDING * v:
                if worst(joint_path, limits, *along).factor <= 1.0 + ROUNDING:
                    return law
    return _refuse(joint_path, limits, (s, v, a), (jerks, peaks, end, factor))


def _candidates(what: Table, s: float, v: float, a: float) -> tuple[Array, Array]:
    """Jerks (k,) and greatest decelerations (k,) of stops that never run backwards."""
    ahead = np.abs(what.parts[what.s >= min(s, what.s[-2]), 2]).max(axis=1)  # |q'| / j
    top = (v + abs(a) * SHORTEST) / SHORTEST**2  # within the shortest time
    if ahead.min() > 0.0:
        top = min(top, 4.0 / float(ahead.min()))
    elif ahead.max() > 0.0:
        top = min(top, 4e3 / float(ahead.max()))
    jerk, share = (x.ravel() for x in np.meshgrid(top * JERKS, SHARES, indexing="ij"))
    room = jerk * v + 0.5 * a * a  # the deceleration without a flat part, squared
    peak = share * np.sqrt(room)
    # braking already, harder than the jerk can end in time: the motion would turn back
    possible = (peak >= -a) & ((a >= 0.0) | (jerk * v >= 0.5 * a * a))
    return jerk[possible], peak[possible]


def _phases(v: float, a: float, jerk: Array, peak: Array) -> tuple[Array, Array]:
    """Durations and jerks (k, 3): down to −peak, stay, and back to 0."""
    flat = np.maximum((v + 0.5 * a * a / jerk - peak * peak / jerk) / peak, 0.0)
    return np.stack([(a + peak) / jerk, flat, peak / jerk], axis=1), jerk[:, None] * np.array([-1.0, 0.0, 1.0])


def _judged(what: Table, s: float, v: float, a: float, jerk: Array, peak: Array) -> tuple[Array, Array, Array]:
    """Duration, last s, and factor by which each stop (k,) would have to be slower, at the nearest places of a table.

    Velocities and accelerations may be what they are at the start: a state on a limit can still stop.
    """
    h, j = _phases(v, a, jerk, peak)
    first = what.parts[_nearest(what, np.array([s]))]
    own = max(1e-3, float(np.abs(first[:, 0] * a + first[:, 1] * v * v).max()) ** 0.5)
    own_speed = float(what.slowness[_nearest(what, np.array([s]))].max()) * v
    at, speed, acceleration = (np.full(jerk.size, x) for x in (s, v, a))
    factor = np.zeros(jerk.size)
    for phase in range(3):
        t = h[:, phase, None] * np.linspace(0.0, 1.0, 9)
        j1 = j[:, phase, None]
        s1 = at[:, None] + t * (speed[:, None] + t * (0.5 * acceleration[:, None] + t * j1 / 6.0))
        v1 = speed[:, None] + t * (acceleration[:, None] + 0.5 * t * j1)
        a1 = acceleration[:, None] + t * j1
        k = _nearest(what, s1)
        p = what.parts[k]
        x, y, z = (b[..., None] for b in (v1, a1, np.broadcast_to(j1, v1.shape)))
        asked_a = np.sqrt(np.abs(p[..., 0, :] * y + p[..., 1, :] * x**2).max(axis=(1, 2)))
        asked_j = np.cbrt(np.abs(p[..., 2, :] * z + p[..., 3, :] * x * y + p[..., 4, :] * x**3).max(axis=(1, 2)))
        asked_v = (what.slowness[k] * v1).max(axis=1)
        for asked, start in ((asked_v, own_speed), (asked_a, own), (asked_j, 0.0)):
            factor = np.maximum(factor, np.where(asked <= start * (1.0 + 1e-6), np.minimum(asked, 0.9), asked))
        at, speed, acceleration = s1[:, -1], v1[:, -1], a1[:, -1]
    return h.sum(axis=1), at, factor


def _nearest(what: Table, s: Array) -> NDArray[np.int64]:
    last = what.s.size - 1
    return np.clip(np.round(s / what.s[-1] * last), 0, last).astype(np.int64)


def _law(s: float, v: float, a: float, phases: list[tuple[float, float]]) -> PPoly:
    rows, lengths = [], []
    for h, j in phases:
        rows.append((j / 6.0, 0.5 * a, v, s))
        lengths.append(h)
        s, v, a = s + h * (v + h * (0.5 * a + h * j / 6.0)), v + h * (a + 0.5 * h * j), a + h * j
    return PPoly(np.array(rows).T, np.concatenate([[0.0], np.cumsum(lengths)]), extrapolate=True)


def _refuse(
    joint_path: JointPath,
    limits: MotionLimits,
    state: tuple[float, float, float],
    tried: tuple[Array, Array, Array, Array],
) -> PPoly:
    """Say why there is no stop: the path's end, or the limit that the gentlest one breaks."""
    s, v, a = state
    jerks, peaks, end, factor = tried
    kept = factor <= MARGINS[-1]
    if kept.any():
        need = float((end[kept] - s).min())
        raise NoSolution(
            f"within the limits the motion stops {need:.6g} further on, and the path ends {joint_path.end - s:.6g} "
            f"after s = {s:.6g}",
            s=joint_path.end, advice=f"a stop that begins before s = {joint_path.end - need:.6g}, or a lower speed",
        )  # fmt: skip
    if not factor.size:
        raise NoSolution("the motion brakes so hard already that it would turn back", s=s, advice="a higher jerk limit")
    i = int(factor.argmin())
    law = _law(s, v, a, velocity_control((v, a), (0.0, 0.0), float(peaks[i]), float(jerks[i])))
    found = worst(joint_path, limits, *states(law))
    raise NoSolution(
        f"no stop from s = {s:.6g} keeps the limits: the gentlest breaks that on {found.limit} at s = {found.s:.6g}",
        s=found.s, joint=found.joint, advice=f"a motion about {max(found.factor, factor[i]):.3g} times slower",
    )  # fmt: skip
