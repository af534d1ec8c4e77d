"""Come to rest on the path from a moving state: the shortest of many stops that keeps every limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from optik._compile import compiled
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
JERKS = np.geomspace(1.0, 1e-4, 25)
"""Candidate jerks, while the brake is applied and while it is let go, over the greatest that there can be."""
SHARES = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05])
"""Candidate decelerations, over the one that would need no time at constant deceleration."""


def stop_from(joint_path: JointPath, limits: MotionLimits, s: float, v: float, a: float) -> PPoly:
    """s(t) from the state (s, v, a) to rest, by Ruckig, evaluated at 65 instants of every piece.

    A stop is two sections: to a deceleration with one jerk, and from it to rest with another.

    Raises
    ------
    NoSolution
        The state breaks a limit, or no stop was found that keeps the limits and ends on the path.
    """
    here = (np.array([x]) for x in (s, v, a, np.nan))  # no jerk is judged: it may jump
    state = worst(joint_path, limits, *here)
    if state.factor > 1.0 + ROUNDING:
        raise NoSolution(
            f"the state at s = {s:.6g} itself breaks the limit on {state.limit}: {state.factor:.6g} times too fast",
            s=s, joint=state.joint, advice="a state of a motion within these limits",
        )  # fmt: skip
    what = table(joint_path, limits)
    tried = _stops(_greatest_jerk(what, s, v, a) * JERKS, SHARES, v, a)
    scale, first = (what.s.size - 1) / what.s[-1], np.empty(2)
    ends = np.empty((len(tried), 2))
    for margin in MARGINS:
        # velocities and accelerations may be what they are at the start: a state on a limit can still stop
        first[:] = margin, max(margin, state.factor * (1.0 + 1e-6))
        _judge(what.slowness, what.parts, scale, s, v, a, tried, first, ends)
        good = np.flatnonzero((ends[:, 0] <= joint_path.end) & (ends[:, 1] <= 1.0))
        for i in good[np.argsort(tried[good, :3].sum(axis=1), kind="stable")][:TRIED]:
            law = _law(s, v, a, tried[i])
            along = states(law)
            stays = law(law.x[-1]) <= joint_path.end and along[1].min() >= -ROUNDING * v
            if stays and worst(joint_path, limits, *along).factor <= 1.0 + ROUNDING:
                return law
    return _refuse(joint_path, limits, (s, v, a), tried, ends)


def _greatest_jerk(what: Table, s: float, v: float, a: float) -> float:
    ahead = np.abs(what.parts[what.s >= min(s, what.s[-2]), 2]).max(axis=1)  # |q'| / j
    most = (v + abs(a) * SHORTEST) / SHORTEST**2  # within the shortest time
    gentlest = ahead.min() if ahead.min() > 1e-3 * ahead.max() else 1e-3 * ahead.max()
    return min(most, 2.0 / float(gentlest)) if gentlest > 0.0 else most


def _stops(jerks: Array, shares: Array, v: float, a: float) -> Array:
    """Durations of three phases, and jerks of the first and the last (k, 5), of stops that never run backwards."""
    apply, release, share = (x.ravel() for x in np.meshgrid(jerks, jerks, shares, indexing="ij"))
    # v = ∫ deceleration: without a flat part p² (1/apply + 1/release) / 2 = v + a² / (2 apply)
    peak = share * np.sqrt((2.0 * v + a * a / apply) / (1.0 / apply + 1.0 / release))
    if a < 0.0:  # the brake is on already: keep it as it is, too
        peak = np.where(share == shares[-1], -a, peak)
    toward = np.where(peak >= -a, -apply, apply)
    h = np.abs(a + peak) / apply
    left = v + h * (a + 0.5 * h * toward) - 0.5 * peak * peak / release
    out = np.stack([h, left / peak, peak / release, toward, release], axis=1)
    return np.asarray(out[left >= 0.0])


@compiled
def _judge(
    slowness: Array, parts: Array, scale: float, s: float, v: float, a: float, tried: Array, most: Array, out: Array
) -> None:
    """Last s of each stop, and its largest ratio to what it may; `most` holds the share of jerk and of the others.

    At 13 instants of each phase and the nearest places of a table.
    """
    for i in range(len(tried)):
        at, speed, acceleration, ratio = s, v, a, 0.0
        for phase in range(3):
            h = tried[i, phase]
            j = tried[i, 3] if phase == 0 else (0.0 if phase == 1 else tried[i, 4])
            for step in range(13):
                t = h * step / 12
                place = at + t * (speed + t * (0.5 * acceleration + t * j / 6.0))
                v1, a1 = speed + t * (acceleration + 0.5 * t * j), acceleration + t * j
                k = min(max(int(place * scale + 0.5), 0), slowness.size - 1)
                p = parts[k]
                asked_a, asked_j = 0.0, 0.0
                for n in range(p.shape[1]):
                    asked_a = max(asked_a, abs(p[0, n] * a1 + p[1, n] * v1 * v1))
                    asked_j = max(asked_j, abs(p[2, n] * j + p[3, n] * v1 * a1 + p[4, n] * v1 * v1 * v1))
                ratio = max(ratio, max(slowness[k] * v1, asked_a**0.5) / most[1], asked_j ** (1.0 / 3.0) / most[0])
            at += h * (speed + h * (0.5 * acceleration + h * j / 6.0))
            speed += h * (acceleration + 0.5 * h * j)
            acceleration += h * j
        out[i, 0], out[i, 1] = at, ratio


def _law(s: float, v: float, a: float, stop: Array) -> PPoly:
    """Ruckig's motion of a stop: to the middle of the flat part, and from there to rest."""
    h, flat, last, toward, release = (float(x) for x in stop)
    peak = last * release
    between = (0.5 * flat * peak + 0.5 * last * peak, -peak)
    phases = velocity_control((v, a), between, max(peak, abs(a)), abs(toward))
    phases += velocity_control(between, (0.0, 0.0), peak, release)
    rows, lengths = [], []
    for h, j in phases:
        if h > 1e-9 * (stop[0] + stop[1] + stop[2]):
            rows.append((j / 6.0, 0.5 * a, v, s))
            lengths.append(h)
            s, v, a = s + h * (v + h * (0.5 * a + h * j / 6.0)), v + h * (a + 0.5 * h * j), a + h * j
    return PPoly(np.array(rows).T, np.concatenate([[0.0], np.cumsum(lengths)]), extrapolate=True)


def _refuse(
    joint_path: JointPath, limits: MotionLimits, state: tuple[float, float, float], tried: Array, ends: Array
) -> PPoly:
    """Say why there is no stop: the path's end, or the limit that the gentlest one on the path breaks."""
    s, v, a = state
    kept = ends[:, 1] <= 1.0
    if kept.any():
        need = float((ends[kept, 0] - s).min())
        raise NoSolution(
            f"the shortest stop found within the limits needs {need:.6g} of path, and it ends "
            f"{joint_path.end - s:.6g} after s = {s:.6g}",
            s=joint_path.end, advice=f"a stop that begins before s = {joint_path.end - need:.6g}, or a lower speed",
        )  # fmt: skip
    if not len(tried):
        raise NoSolution("the motion brakes so hard already that it would turn back", s=s, advice="a higher jerk limit")
    i = int(np.where(ends[:, 0] <= joint_path.end, ends[:, 1], np.inf).argmin())
    found = worst(joint_path, limits, *states(_law(s, v, a, tried[i])))
    raise NoSolution(
        f"no stop found from s = {s:.6g} keeps the limits: the gentlest breaks that on {found.limit} at "
        f"s = {found.s:.6g}",
        s=found.s, joint=found.joint, advice=f"a motion about {max(found.factor, 1.001):.4g} times slower",
    )  # fmt: skip
