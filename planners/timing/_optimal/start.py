"""Initial guess for the time optimum from rest to rest: a swept motion that nearly respects all limits, and its grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import DERIVATIVES, MotionLimits
from planners.timing import _sweep
from planners.timing._grid import make_graded_grid
from planners.timing._optimal.derivatives import derivatives
from planners.timing._optimal.limited import swept_rows
from planners.timing._optimal.programme import Programme, build_programme
from planners.timing.base import speed_bound
from planners.timing.smooth import NO_JOINT_MOTION

Indices = NDArray[np.int64]

SWEEP_PLACES, SWEEP_PER_PIECE = 300, 12
"""Least number of grid points: of the whole sweep, and of each piece between breaks."""
RAMP_BEND_SHARE, RAMP_TWIST_SHARE = 0.8, 0.6
"""Fractions of the limits on acceleration and jerk that the path's curvature may use at constant speed."""
SWEEP_ROUNDS, SWEEP_EXCESS = 6, 1.1
"""Largest number of sweeps, and the excess of speed at which they end; the remaining excess stretches the whole motion."""
EVEN, PER_CHANGE = 80, (10.0, 3.0, 20.0)
"""Intervals of every motion, and those that each change of an acceleration by its limit adds (`_sweep.spread`): a straight
line has four such changes."""
STRAIGHT_LOADED, CURVED_LOADED = (50, (15.0, 5.0, 20.0)), (100, (20.0, 7.0, 20.0))
"""The same two where torques are limited, on a straight line in joint space and on any other path: ramps of torque are longer
than those of acceleration, and speeds peak inside them."""
STRAIGHT = 1e-6
"""Change of q' over the path, over the largest q', below which the joint path is straight."""

FASTEST = 1e4
"""Largest ratio of speeds and accelerations to the mean ones: no initial guess needs more."""
Q_ROUNDING, JERK_ROUNDING = 4e-16, 1e-3
"""Rounding error of q [rad or m], and the fraction of a jerk limit that it may use in an interval."""
FEWEST = 50
"""Least number of intervals of a motion, whatever the rounding."""
NODE_JUMP = 0.02
"""Largest jump of q''' within an interval, as a fraction of the jerk limits; larger jumps are at grid points."""

SAME_NODE = 1e-9
"""Fraction of the path within which a node and a change of a limit coincide."""


def start(joint_path: JointPath, limits: MotionLimits, intervals: int | None, more: float = 1.0) -> Programme:
    """Return the programme from rest to rest."""
    along, motion = sweep(joint_path, limits)
    t, share = motion[0], np.empty(along.s.size)
    jerk = along.jerk[: joint_path.robot.n]  # not those of torque rates, which are counted in other units
    least = min(briefest(jerk), t[-1] / FEWEST)
    even, per_change = EVEN, PER_CHANGE
    if along.jerk.size > jerk.size:
        bend = joint_path.end * np.abs(along.q2[:, : jerk.size]).max()
        straight = bend < STRAIGHT * np.abs(along.q1[:, : jerk.size]).max()
        even, per_change = STRAIGHT_LOADED if straight else CURVED_LOADED
    usual = round(_sweep.count_intervals(along, motion, even, per_change, least, share))
    count = max(round(more * (intervals or usual)), 8)
    when = np.interp(np.linspace(0.0, share[-1], count + 1), share, t)
    changes = limits.tool_changes(joint_path.path)
    when, k, nodes = _add_nodes(when, joint_path, along, motion, least, changes)
    found = np.empty((3, when.size))
    _sweep.sample(along.s, motion, when, found)
    found[0, 0], found[0, -1], found[0, k] = 0.0, joint_path.end, nodes
    kept = _is_increasing(found[0], np.concatenate([[0], k, [when.size - 1]]))
    when, (s, v, a) = when[kept], found[:, kept]
    units = 2.0 * joint_path.end / when.size, 2.0 * float(t[-1]) / when.size  # an interval is about half of either
    return build_programme(joint_path, limits, s, v, a, np.diff(when), units, None)


def sweep(joint_path: JointPath, limits: MotionLimits) -> tuple[_sweep.Along, Array]:
    """Return the path at path parameters (m,), and the motion (4, m) of `_sweep.swept` along it from rest to rest."""
    along = _make_sweep_input(joint_path, limits)
    motion = np.empty((4, along.s.size))
    _sweep.sweep(
        along, _sweep.speed_bounds(along, RAMP_BEND_SHARE, RAMP_TWIST_SHARE), SWEEP_ROUNDS, SWEEP_EXCESS, motion
    )
    return along, motion


def _add_nodes(
    when: Array, joint_path: JointPath, along: _sweep.Along, motion: Array, least: float, changes: Array
) -> tuple[Array, Indices, Array]:
    """Return times with those of the nodes at which q''' jumps; the indices of these times, and the nodes.

    Such a node inside an interval would have different limits on both sides. The same holds for positions at which the limit on
    the tool speed changes.
    """
    nodes = joint_path.nodes[1:-1]
    beside = 1e-3 * np.minimum(np.diff(joint_path.nodes)[1:], np.diff(joint_path.nodes)[:-1])
    jump = np.abs(derivatives(joint_path, nodes + beside)[3] - derivatives(joint_path, nodes - beside)[3])
    speed = np.interp(nodes, along.s, motion[1])
    chosen = (jump / along.jerk[: jump.shape[1]]).max(axis=1) * speed**3 > NODE_JUMP
    nodes = nodes[chosen]
    if changes.size:
        apart = np.abs(nodes[:, None] - changes).min(axis=1) > SAME_NODE * joint_path.end
        nodes = np.sort(np.concatenate([nodes[apart], changes]))
    passed = np.interp(nodes, along.s, motion[0])
    # a node replaces a time within a third of its interval
    i = np.clip(np.searchsorted(when, passed), 1, when.size - 1)
    low, high = passed - when[i - 1], when[i] - passed
    near = np.minimum(low, high) < (low + high) / 3.0
    away = np.where(low < high, i - 1, i)[near]
    keep = np.ones(when.size, dtype=bool)
    keep[away[(away > 0) & (away < when.size - 1)]] = False
    kept = select_spaced(passed, when[-1], least)
    nodes, passed = nodes[kept], passed[kept]
    when = np.sort(np.concatenate([when[keep], passed]))
    return when, np.searchsorted(when, passed), nodes


def _is_increasing(s: Array, fixed: Indices) -> NDArray[np.bool_]:
    """Return which path parameters (k,) exceed all before them; the fixed ones are kept, and bound those between them."""
    i = np.arange(s.size)
    before, after = s[fixed[np.searchsorted(fixed, i, side="right") - 1]], s[fixed[np.searchsorted(fixed, i)]]
    farthest = np.maximum.accumulate(np.where((s > before) & (s < after), s, before))
    kept = np.append(True, farthest[1:] > farthest[:-1])
    kept[fixed] = True
    return np.asarray(kept)


def briefest(jerk: Array) -> float:
    """Return the least duration of an interval whose jerk is not dominated by rounding error in q."""
    return float(np.cbrt(60.0 * Q_ROUNDING / (JERK_ROUNDING * jerk.min())))


def select_spaced(times: Array, end: float, least: float) -> NDArray[np.bool_]:
    """Select increasing times with a least distance from each other, from 0 and from the end."""
    kept, last = np.zeros(times.size, dtype=bool), 0.0
    for i, t in enumerate(times):
        if t - last >= least and end - t >= least:
            kept[i], last = True, t
    return kept


def _make_sweep_input(joint_path: JointPath, limits: MotionLimits) -> _sweep.Along:
    s = make_graded_grid(
        joint_path.path.breaks, joint_path.end, max(SWEEP_PLACES, joint_path.knots.size), SWEEP_PER_PIECE
    )
    bound, top = limits.arrays(joint_path.robot.n), speed_bound(joint_path, limits, s)
    moving = np.ptp(joint_path.q, axis=0) > NO_JOINT_MOTION
    A, J = (np.where(moving, bound[field], np.inf) for field in ("acceleration", "jerk"))
    found = derivatives(joint_path, s)
    *loaded, most = swept_rows(joint_path, limits, s, found)
    if most.size:
        q1, q2, q3 = (np.concatenate(pair, axis=1) for pair in zip(found[1:], loaded, strict=True))
        A, J = np.append(A, most[0]), np.append(J, most[1])
    else:
        _, q1, q2, q3 = found
    size, length = np.abs(q1), float(s[-1])
    a, j = float((size / A).max(axis=1).mean()), float((size / J).max(axis=1).mean())
    # by order of magnitude no motion takes less time than these; far higher derivatives need not be told apart
    least = max(float((np.diff(s) / top[1:]).sum()), np.sqrt(length * a), np.cbrt(length * j))
    free = not np.isfinite([bound[field][moving] for field in DERIVATIVES]).any() and not np.isfinite(limits.tool).any()
    if (free and not most.size) or not 0.0 < least < np.inf:
        names = ", ".join(joint_path.robot.joint_names[i] for i in np.flatnonzero(moving))
        raise NoSolution("no limit bounds a joint that moves", s=0.0, advice=f"finite limits on one of {names}")
    top = np.minimum(top, FASTEST * length / least)
    highest = FASTEST * length / least**2, FASTEST**2 * length / least**3
    return _sweep.Along(s, q1, q2, q3, A, J, top, highest)
