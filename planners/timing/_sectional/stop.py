"""Come to rest on the path from a moving state: the shortest of many stops that keeps every limit."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from optik.compiled import compiled
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import MotionLimits
from planners.timing._ruckig import velocity_control
from planners.timing._sectional.ramps import SHORTEST_PHASE, Table, states, table, worst

STATE_ROUNDING = 1e-9
"""Excess of a limit that counts as rounding: an initial state may be exactly on a limit."""
MARGINS = (0.999, 0.99, 0.97, 0.94)
"""Shares of the limits that stops are chosen within, in turn, until the exact evaluation agrees."""
TRIED = 3
"""Number of chosen stops that are evaluated exactly for each margin."""
JERKS = np.geomspace(1.0, 1e-3, 16)
"""Candidate jerks, over the greatest possible one."""
DECELERATIONS = np.array([1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1, 0.05])
"""Candidate decelerations, over the one that would need no time at constant deceleration."""


def stop_from(joint_path: JointPath, limits: MotionLimits, s: float, v: float, a: float) -> PPoly:
    """s(t) from the state (s, v, a) to rest, by Ruckig, evaluated at 65 instants of every piece.

    A stop is of three sections, each with a jerk of its own: to no acceleration, to a deceleration, and to rest.

    Parameters
    ----------
    joint_path : JointPath
        q(s).
    limits : MotionLimits
        Limits of the motion.
    s, v, a : float
        The state: s [m, rad], ṡ [m/s, rad/s] and s̈ [m/s², rad/s²].

    Returns
    -------
    scipy.interpolate.PPoly
        s(t), at rest at its last knot.

    Raises
    ------
    NoSolution
        The state breaks a limit, or no stop was found that keeps the limits and ends on the path.
    """
    here = (np.array([x]) for x in (s, v, a, np.nan))  # no jerk is judged: it may jump
    state = worst(joint_path, limits, *here)
    if state.factor > 1.0 + STATE_ROUNDING:
        raise NoSolution(
            f"the state at s = {s:.6g} itself breaks the limit on {state.limit}: {state.factor:.6g} times too fast",
            s=s, joint=state.joint, advice="a state of a motion within these limits",
        )  # fmt: skip
    what = table(joint_path, limits)
    h, j = tried = _stops(_greatest_jerk(what, s, v, a), v, a)
    scale, first = (what.s.size - 1) / what.s[-1], np.empty(2)
    ends = np.empty((len(h), 2))
    for margin in MARGINS:
        # velocities and accelerations may be what they are at the start: a state on a limit can still stop
        first[:] = margin, max(margin, state.factor * (1.0 + 1e-6))
        _judge(what.slowness, what.parts, scale, (s, v, a), h, j, first, ends)
        good = np.flatnonzero((ends[:, 0] <= joint_path.end) & (ends[:, 1] <= 1.0))
        for i in good[np.argsort(h[good].sum(axis=1), kind="stable")][:TRIED]:
            law = _law(s, v, a, h[i], j[i])
            along = states(law)
            stays = law(law.x[-1]) <= joint_path.end and along[1].min() >= -STATE_ROUNDING * v
            if stays and worst(joint_path, limits, *along).factor <= 1.0 + STATE_ROUNDING:
                return law
    return _refuse(joint_path, limits, (s, v, a), tried, ends)


def _greatest_jerk(what: Table, s: float, v: float, a: float) -> float:
    ahead = np.abs(what.parts[what.s >= min(s, what.s[-2]), 2]).max(axis=1)  # |q'| / j
    most = (v + abs(a) * SHORTEST_PHASE) / SHORTEST_PHASE**2  # within the shortest time
    gentlest = ahead.min() if ahead.min() > 1e-3 * ahead.max() else 1e-3 * ahead.max()
    return min(most, 2.0 / float(gentlest)) if gentlest > 0.0 else most


def _stops(top: float, v: float, a: float) -> tuple[Array, Array]:
    """Durations and jerks (k, 4) of stops that never run backwards.

    The acceleration goes to 0 with one jerk, on to a deceleration with another, stays, and goes back with a third. A
    state that decelerates already goes to the deceleration at once.

    Returns
    -------
    tuple of arrays
        Durations and jerks (k, 4).
    """
    jerks = top * JERKS
    ease, apply, release, share = (
        x.ravel() for x in np.meshgrid(jerks if a > 0.0 else jerks[:1], jerks, jerks, DECELERATIONS, indexing="ij")
    )
    first = a / ease if a > 0.0 else np.zeros(ease.size)
    reached = v + 0.5 * first * max(a, 0.0)
    a = min(a, 0.0)
    # the speed is ∫ deceleration: without a flat part p² (1/apply + 1/release) / 2 = v + a² / (2 apply)
    peak = share * np.sqrt((2.0 * reached + a * a / apply) / (1.0 / apply + 1.0 / release))
    if a < 0.0:
        peak = np.where(share == DECELERATIONS[-1], -a, peak)  # also keep the present deceleration
    toward = np.where(peak >= -a, -apply, apply)
    second = np.abs(a + peak) / apply
    left = reached + second * (a + 0.5 * second * toward) - 0.5 * peak * peak / release
    h = np.stack([first, second, left / peak, peak / release], axis=1)
    j = np.stack([-ease, toward, np.zeros(ease.size), release], axis=1)
    return h[left >= 0.0], j[left >= 0.0]


@compiled
def _judge(
    slowness: Array,
    parts: Array,
    scale: float,
    start: tuple[float, float, float],
    durations: Array,
    jerks: Array,
    most: Array,
    out: Array,
) -> None:
    """Last s of each stop (k, 4), and its largest ratio to what it may: `most` is the share of jerk and of the others.

    At 13 instants of each phase and the nearest places of a table.
    """
    for i in range(len(durations)):
        (at, speed, acceleration), ratio = start, 0.0
        for phase in range(4):
            h, j = durations[i, phase], jerks[i, phase]
            if h <= 0.0:
                continue
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
                ratio = max(ratio, max(slowness[k] * v1, asked_a**0.5) / most[1])
                if asked_j > (ratio * most[0]) ** 3:
                    ratio = asked_j ** (1.0 / 3.0) / most[0]
            at += h * (speed + h * (0.5 * acceleration + h * j / 6.0))
            speed += h * (acceleration + 0.5 * h * j)
            acceleration += h * j
            if ratio > 2.0:
                break
        out[i, 0], out[i, 1] = at, ratio


def _law(s: float, v: float, a: float, durations: Array, jerks: Array) -> PPoly:
    """Ruckig's motion of a stop: to no acceleration, to the middle of the constant deceleration, and to rest."""
    peak = float(durations[3] * jerks[3])
    half = 0.5 * peak * float(durations[2] + durations[3])
    goals = [((half, -peak), abs(float(jerks[1]))), ((0.0, 0.0), float(jerks[3]))]
    if durations[0] > 0.0:
        goals.insert(0, ((v + 0.5 * a * float(durations[0]), 0.0), -float(jerks[0])))
    rows, lengths, state = [], [], (v, a)
    for goal, jerk in goals:
        for h, j in velocity_control(state, goal, max(peak, abs(state[1])), jerk):
            if h > 1e-9 * durations.sum():
                rows.append((j / 6.0, 0.5 * a, v, s))
                lengths.append(h)
                s, v, a = s + h * (v + h * (0.5 * a + h * j / 6.0)), v + h * (a + 0.5 * h * j), a + h * j
        state = goal
    return PPoly(np.array(rows).T, np.concatenate([[0.0], np.cumsum(lengths)]), extrapolate=True)


def _refuse(
    joint_path: JointPath,
    limits: MotionLimits,
    state: tuple[float, float, float],
    tried: tuple[Array, Array],
    ends: Array,
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
    if not len(ends):
        raise NoSolution(
            "the motion decelerates so much already that it would turn back", s=s, advice="a higher jerk limit"
        )
    i = int(np.where(ends[:, 0] <= joint_path.end, ends[:, 1], np.inf).argmin())
    found = worst(joint_path, limits, *states(_law(s, v, a, tried[0][i], tried[1][i])))
    raise NoSolution(
        f"no stop found from s = {s:.6g} keeps the limits: the gentlest breaks that on {found.limit} at "
        f"s = {found.s:.6g}",
        s=found.s, joint=found.joint, advice=f"a motion about {max(found.factor, 1.001):.4g} times slower",
    )  # fmt: skip
