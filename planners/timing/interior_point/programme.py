"""The time-optimal programme along a joint path, in units near 1, and its initial guesses: swept, filtered or a quintic."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import DERIVATIVES, TOOL_SPEEDS, MotionLimits, sides
from planners.limits.motion_limits import find_tool_limit_changes
from planners.timing import _sweep
from planners.timing._sweep import make_graded_grid
from planners.timing.base import PathState, find_moving, refuse_free_motion, speed_bound
from planners.timing.interior_point import rows
from planners.timing.interior_point.newton import Problem
from planners.timing.interior_point.rows import Rows, build_rows, derivatives, swept_rows
from planners.timing.smooth import QUINTIC, least_duration
from planners.trajectory.curve import find_times

UNITS = 64.0
"""The programme counts time and s in 64ths of the motion, so that its numbers are near 1."""
USUAL_INTERVALS, MORE_PER_BREAK = 128, 8
"""Intervals of a path without breaks, and those that each break adds: enough for ramps on either side of it."""
START_PER_PIECE = 12
"""Intervals of the initial guess between any two breaks."""
STEADY = 1.5
"""Ratio of the initial guess's largest speed to the speed that respects the jerk limits at s̈ = s⃛ = 0."""
SMOOTHEST = 0.02
"""Least width of the initial guess's filter, as a fraction of the motion: shorter ramps fit into one interval."""
SHORTEST_INTERVAL = 0.02
"""Least duration of an interval, as a fraction of its initial guess: time must not run backwards during the iteration."""
BRIEFEST_AT_TOP = 0.95
"""Least duration of an interval, as a fraction of its duration at the greater of the speeds that its ends allow: limits on
speed that held at the ends only would be exceeded between them, and the iteration would not converge."""
NO_WAY = 1e-9
"""Fraction of the path below which the distance covered within the filter's width is neglected: it is rounding error in s."""
TOOL_SPARE = 0.9999
"""Fraction of the tool's limits that a motion from a moving state uses: it cannot be stretched later."""
TORQUE_SPARE = 0.998
"""Fraction of the limits on torque and its rate for such a motion: their proved bounds exceed the peaks by more."""


class TimingProblem(NamedTuple):
    """A nonlinear programme: its joint path, limits and data, path parameters s (K + 1,), and initial guess (K + 1, 4).

    ``units`` are those of length and time, ``moving`` is the state at the start, None for rest.
    """

    joint_path: JointPath
    limits: MotionLimits
    problem: Problem
    s: Array
    start: Array
    units: tuple[float, float]
    moving: PathState | None
    rows: Rows


def moving_programme(
    joint_path: JointPath, limits: MotionLimits, intervals: int | None, state: PathState, end: float,
    guessed: MotionLimits | None = None,
) -> TimingProblem | None:  # fmt: skip
    """Return the programme from a moving state to rest at a path parameter; its guess has other limits if they are given."""
    bound = limits.arrays(joint_path.robot.n)
    lower, upper = sides((guessed or limits).bounds(joint_path.robot.n)["acceleration"])
    begin, first = state.s, state.speed
    s = joint_path.path.grid(max(150, joint_path.knots.size), START_PER_PIECE)
    s = np.concatenate([[begin], s[(s > begin) & (s < end)], [end]])
    if s.size <= START_PER_PIECE:  # a stop within one cell of the path
        s = np.linspace(begin, end, START_PER_PIECE + 1)
    x, t = np.empty(s.size), np.empty(s.size)
    _, q1, q2, q3 = derivatives(joint_path, s)
    braking = np.where(q1 > 0.0, -lower, upper).max(axis=0)  # whatever the other side allows
    peak, most, ramp = _ramps(joint_path, bound | {"acceleration": braking}, q1, s)
    usable = -np.minimum(-lower, most), np.minimum(upper, most)
    with np.errstate(divide="ignore"):
        speed = np.fmin(speed_bound(joint_path, limits, s), (peak / np.abs(q1)).min(axis=1))
        speed = np.fmin(speed, STEADY * np.cbrt(bound["jerk"] / np.abs(q3)).min(axis=1))
    if not rows.find_fastest(s, q1, q2, speed, usable, first * first, x):
        return None
    rows.compute_times(s, x, t)
    width = max(ramp, SMOOTHEST * float(t[-1]))
    v, since = np.sqrt(x), 0.0
    if first * width > NO_WAY * (end - begin):  # the filter looks back on a motion that came in at its speed
        t, s, v = np.append(0.0, t + width), np.append(begin - first * width, s), np.append(first, v)
        since = _find_time(t, s, v, width, begin)
    when = _distribute(t, s, v, width, since, _count(joint_path, intervals))
    at, v, a = _filter(t, s, v, width, when)
    at = np.clip(at, begin, end)
    at[0], at[-1] = begin, end
    for place in find_tool_limit_changes(limits, joint_path.path):  # the nearest grid point moves there
        k = int(np.abs(at - place).argmin())
        if 0 < k < at.size - 1 and at[k - 1] < place < at[k + 1]:
            at[k] = place
    v[-1] = a[-1] = 0.0
    v[0], a[0] = state.speed, state.acceleration
    units = (end - begin) / UNITS, (when[-1] - when[0]) / UNITS
    return build_programme(joint_path, limits, at, v, a, np.diff(when), units, state)


def quintic_programme(joint_path: JointPath, limits: MotionLimits, intervals: int | None) -> TimingProblem:
    """Return the programme from rest to rest whose initial guess is one quintic in s, slow enough for all limits."""
    duration, count = least_duration(joint_path, limits), _count(joint_path, intervals)
    u, motion = np.linspace(0.0, 1.0, count + 1), np.empty((3, count + 1))
    for order in range(3):
        motion[order] = joint_path.end / duration**order * np.polyval(np.polyder(QUINTIC, order), u)
    motion[:, 0], motion[:, -1] = 0.0, (joint_path.end, 0.0, 0.0)
    s, v, a = motion
    units = joint_path.end / UNITS, duration / UNITS
    return build_programme(joint_path, limits, s, v, a, np.full(count, duration / count), units, None)


def interpolate_start(given: TimingProblem, z: Array, u: float) -> Array:
    """Return s, speeds and accelerations at a fraction of the durations of the intervals of a motion.

    On the quintics through the motion's own states, so that a start tells as much as a solution does.
    """
    v0, a0, tau = z[:-1, 0], z[:-1, 1], z[:-1, 2]
    v1, a1, ds = z[1:, 0], z[1:, 1], given.problem.ds
    P = ds - tau * (v0 + 0.5 * tau * a0)
    V, A = tau * (v1 - v0 - tau * a0), tau**2 * (a1 - a0)
    c3, c4, c5 = 10.0 * P - 4.0 * V + 0.5 * A, -15.0 * P + 7.0 * V - A, 6.0 * P - 3.0 * V + 0.5 * A
    s = u * tau * (v0 + 0.5 * u * tau * a0) + u**3 * (c3 + u * (c4 + u * c5))
    v = v0 + u * tau * a0 + u**2 * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)) / tau
    a = a0 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5)) / tau**2
    return np.stack([given.s[:-1] + given.units[0] * s, v, a])


def halve_intervals(given: TimingProblem, z: Array, which: NDArray[np.bool_]) -> TimingProblem:
    """Return the programme with some intervals halved in time; its initial guess is a motion of the given programme."""
    length, time = given.units
    i = np.flatnonzero(which)
    middle, width = interpolate_start(given, z, 0.5)[:, i], given.s[i + 1] - given.s[i]
    middle[0] = np.clip(middle[0], given.s[i] + 0.01 * width, given.s[i + 1] - 0.01 * width)
    middle[1] = np.maximum(middle[1], 0.0)  # a start: it need not agree
    s, v, a = np.insert(np.stack([given.s, z[:, 0], z[:, 1]]), i + 1, middle, axis=1)
    tau = np.insert(np.where(which, 0.5 * z[:-1, 2], z[:-1, 2]), i + 1, 0.5 * z[i, 2])
    v, a = v * length / time, a * length / time**2
    return build_programme(given.joint_path, given.limits, s, v, a, tau * time, given.units, given.moving)


def _count(joint_path: JointPath, intervals: int | None) -> int:
    return intervals or min(USUAL_INTERVALS + MORE_PER_BREAK * (joint_path.path.breaks.size - 2), 1000)


def _distribute(t: Array, s: Array, v: Array, width: float, since: float, count: int) -> Array:
    """Return times (count + 1,) of the filtered motion, half of them equally spaced, half where its acceleration changes."""
    end = float(t[-1]) + width
    fine = np.unique(np.concatenate([t, t + width, np.linspace(since, end, 401)]))
    fine = fine[(fine >= since) & (fine <= end)]
    fine[0], fine[-1] = since, end
    change = np.abs(np.diff(_filter(t, s, v, width, fine)[2]))
    weight = np.diff(fine) / (end - since) + change / max(float(change.sum()), 1e-300)
    share = np.append(0.0, np.cumsum(weight))
    return np.asarray(np.interp(np.linspace(0.0, share[-1], count + 1), share, fine))


def _filter(t: Array, s: Array, v: Array, width: float, when: Array) -> Array:
    """Return s, ṡ and s̈ (3, k), at the times `when`, of a motion s(t) smoothed by a box filter (moving mean in time)."""
    out = np.empty((3, when.size))
    rows.filter_motion(t, s, v, width, when, out)
    return out


def _ramps(joint_path: JointPath, bound: dict[str, Array], q1: Array, s: Array) -> tuple[Array, Array, float]:
    """Return the velocities and accelerations (n,) that the joints can reach on the path, and the width of the filter [s].

    From rest to rest over a distance D, a joint cannot exceed the velocities (A D)^½ and (J D²)^⅓; with a velocity V and a jerk
    J it cannot exceed the acceleration (J V)^½. A margin is added.
    """
    V, A, J = (bound[field] for field in DERIVATIVES)
    D = np.sum(0.5 * (np.abs(q1[1:]) + np.abs(q1[:-1])) * np.diff(s)[:, None], axis=0)
    moving = 1e-6 * D.max() < D
    most = np.fmin(2.0 * np.sqrt(A * D), 2.0 * np.cbrt(J * D * D))
    peak = np.where((10.0 * most < V) & moving, 10.0 * most, np.inf)
    if not np.isfinite(np.fmin(V, peak)[moving]).any():
        refuse_free_motion(joint_path, moving)
    least = np.fmin(A, np.sqrt(J * np.fmin(V, most)))
    with np.errstate(invalid="ignore"):
        ramps = np.where(np.isfinite(J) & moving, least / J, 0.0)
    return peak, least, 1.2 * float(ramps.max())


def _peaks(tau: Array, top: Array) -> Array:
    """Return one row for every grid point (K + 1, 1, 4), which limits the peak speed inside the interval after it.

    Where torques are limited the acceleration changes so slowly that it reverses inside one interval. From v with the
    acceleration a, and with −a/2 at the end, the speed peaks at v + a τ/3; the duration is that of the initial guess.
    """
    row = np.zeros((top.size, 1, 4))
    row[:-1, 0, 0], row[:-1, 0, 2] = tau / (3.0 * top[:-1]), 1.0 / top[:-1]
    return row


def _find_time(t: Array, s: Array, v: Array, width: float, place: float) -> float:
    """Return the time at which the filtered motion passes a path parameter."""
    return float(find_times(lambda x: _filter(t, s, v, width, x)[0], np.array([place]), float(t[-1]) + width)[0])


def build_programme(
    joint_path: JointPath, limits: MotionLimits, s: Array, v: Array, a: Array, tau: Array, units: tuple[float, float],
    moving: PathState | None,
) -> TimingProblem:  # fmt: skip
    """Return the programme at nodes s, with a motion as its initial guess."""
    (length, time), given_limits = units, limits
    K = len(tau)
    beside = min(1e-9 * (s[-1] - s[0]), 1e-3 * float(np.diff(s).min()))  # q''' may jump at a node of the path
    along, v1 = derivatives(joint_path, s), length / time
    around = derivatives(joint_path, s[:-1] + beside)[3], derivatives(joint_path, s[1:] - beside)[3]
    if moving is not None:  # a motion that cannot be stretched later keeps a margin between grid points
        limits = limits.scale(TOOL_SPARE, (*TOOL_SPEEDS, *(limits.extra or ())))
        limits = limits.scale(TORQUE_SPARE, ("torque", "torque_rate"))
    limit_rows = build_rows(joint_path, limits, s, along, around)
    node = limit_rows.node * np.array([v1 / time, v1**2, v1, 1.0])
    edge = limit_rows.edge * np.array([v1 / time**2, v1**2 / time, v1**3, v1, v1 / time, v1**2])
    start = np.zeros((K + 1, 4))
    start[:, 0], start[:, 1], start[:-1, 2] = v / v1, a * (time / v1), tau / time
    start[:-1, 3] = np.diff(start[:, 1]) / start[:-1, 2]
    top = np.minimum(speed_bound(joint_path, limits, s) / v1, 1e6)
    tau, ds = start[:-1, 2].copy(), np.diff(s) / length
    if limit_rows.loaded:
        node = np.concatenate([node, _peaks(tau, top)], axis=1)
    least = np.maximum(SHORTEST_INTERVAL * tau, BRIEFEST_AT_TOP * ds / np.maximum(top[:-1], top[1:]))
    problem = Problem(ds, tau, least, top, node, edge, np.zeros(2))
    return TimingProblem(joint_path, given_limits, problem, s, start, units, moving, limit_rows)


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


def start(joint_path: JointPath, limits: MotionLimits, intervals: int | None, more: float = 1.0) -> TimingProblem:
    """Return the programme from rest to rest."""
    along, motion = sweep_joint_path(joint_path, limits)
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
    changes = find_tool_limit_changes(limits, joint_path.path)
    when, k, nodes = _add_nodes(when, joint_path, along, motion, least, changes)
    states = np.empty((3, when.size))
    _sweep.sample(along.s, motion, when, states)
    states[0, 0], states[0, -1], states[0, k] = 0.0, joint_path.end, nodes
    kept = _is_increasing(states[0], np.concatenate([[0], k, [when.size - 1]]))
    when, (s, v, a) = when[kept], states[:, kept]
    units = 2.0 * joint_path.end / when.size, 2.0 * float(t[-1]) / when.size  # an interval is about half of either
    return build_programme(joint_path, limits, s, v, a, np.diff(when), units, None)


def sweep_joint_path(joint_path: JointPath, limits: MotionLimits) -> tuple[_sweep.Along, Array]:
    """Return the path at path parameters (m,), and the motion (4, m) of `_sweep.swept` along it from rest to rest."""
    along = _make_sweep_input(joint_path, limits)
    motion = np.empty((4, along.s.size))
    _sweep.sweep_path(
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
    """Return which path parameters (k,) exceed all previous ones; the fixed ones always count, and bound those between them."""
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
    moving = find_moving(joint_path)
    A, J = (np.where(moving, bound[field], np.inf) for field in ("acceleration", "jerk"))
    along = derivatives(joint_path, s)
    *loaded, most = swept_rows(joint_path, limits, s, along)
    if most.size:
        q1, q2, q3 = (np.concatenate(pair, axis=1) for pair in zip(along[1:], loaded, strict=True))
        A, J = np.append(A, most[0]), np.append(J, most[1])
    else:
        _, q1, q2, q3 = along
    size, length = np.abs(q1), float(s[-1])
    a, j = float((size / A).max(axis=1).mean()), float((size / J).max(axis=1).mean())
    # by order of magnitude no motion takes less time than these; far higher derivatives need not be told apart
    least = max(float((np.diff(s) / top[1:]).sum()), np.sqrt(length * a), np.cbrt(length * j))
    top = np.minimum(top, FASTEST * length / least)
    highest = FASTEST * length / least**2, FASTEST**2 * length / least**3
    return _sweep.Along(s, q1, q2, q3, A, J, top, highest)
