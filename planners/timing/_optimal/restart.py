"""Where a motion might stop from a moving state, and the stop that Ruckig finds were the joint path straight."""

from __future__ import annotations

import numpy as np

from optik.errors import NoSolution
from planners.curve import composed
from planners.fit import stretch
from planners.following.follow import JointPath
from planners.hermite import quintic
from planners.limits import DERIVATIVES, MotionLimits
from planners.splice import begun
from planners.timing._ruckig import velocity_control
from planners.timing.base import PathState
from planners.trajectory import Trajectory

SHORTEST_STOP = 1e-6
"""Shortest way to rest, as a share of the path, for which a programme is solved: below it the joint path is straight."""
STOP_SHARES = (1.0 - 1e-9, 0.999, 0.99, 0.97, 0.94, 0.9, 0.8, 0.65, 0.5, 0.3, 0.15)
"""Shares of the greatest deceleration and its jerk, tried in turn until the limits are kept on the path's own curve."""
PHASE_PARTS = 8
"""Pieces of every phase of a straight stop: quintics that follow the curved joint path."""
LIMIT_ROUNDING = 5e-13
"""Excess of a limit that is accepted where nothing is slowed afterwards: half of what a certificate accepts as rounding."""
STOPS = (1.02, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 6.0)
"""Distances to rest that are tried, over the one that the limits would allow on a straight joint path."""


def stopping_places(
    joint_path: JointPath, limits: MotionLimits, state: PathState, known: Trajectory | None
) -> list[float]:
    """Places at which a motion might come to rest, from what the limits would allow on a straight joint path.

    None where the way is too short to be worth a programme; only places before that of a stop that is known.

    Parameters
    ----------
    joint_path : JointPath
        q(s).
    limits : MotionLimits
        Limits of the motion.
    state : PathState
        Where the motion is, and how fast.
    known : Trajectory or None
        A stop that is known already.

    Returns
    -------
    list of float
        Places [m, rad], the nearest first.
    """
    phases = _phases(joint_path, limits, state, STOP_SHARES[0])
    distance = joint_path.end if phases is None else _travelled(state, phases)[0]
    if distance < SHORTEST_STOP * joint_path.end and known is not None:
        return []
    places = [state.s + max(distance, SHORTEST_STOP * joint_path.end) * factor for factor in STOPS]
    return [s for s in places if s < joint_path.end] + [joint_path.end]


def straight_stop(joint_path: JointPath, limits: MotionLimits, state: PathState) -> Trajectory | None:
    """The quickest stop of constant jerks that keeps the limits, of those that a straight joint path would have.

    On a way of some millimetres that is the optimum; on a longer one a motion to fall back on.

    Parameters
    ----------
    joint_path : JointPath
        q(s).
    limits : MotionLimits
        Limits of the motion.
    state : PathState
        Where the motion is, and how fast.

    Returns
    -------
    Trajectory or None
        None where no such stop keeps the limits.
    """
    for share in STOP_SHARES:
        phases = _phases(joint_path, limits, state, share)
        if phases is None or state.s + _travelled(state, phases)[0] > joint_path.end:
            continue
        motion = _along(joint_path, state, phases)
        if motion is not None and state.joints is not None:
            motion = begun(motion, state.joints, limits)
        if (
            motion is not None
            and stretch(joint_path.robot, motion, limits, path=joint_path.path) <= 1.0 + LIMIT_ROUNDING
        ):
            return motion
    return None


def _phases(
    joint_path: JointPath, limits: MotionLimits, state: PathState, share: float
) -> list[tuple[float, float]] | None:
    """Phases (duration, jerk) of s to rest at a share of the limits, were the joint path straight; None where none are.

    Ruckig counts in units of the stop's own time and jerk, so that its numbers are near 1 however slow the motion is.

    Returns
    -------
    list of tuple of float, or None
        Durations and jerks.
    """
    bound = limits.arrays(joint_path.robot.n)
    q1 = np.maximum(np.abs(joint_path(state.s, 1)), 1e-12)
    v, a = state.speed, state.acceleration
    most, jerk = (share * float((bound[field] / q1).min()) for field in DERIVATIVES[1:])
    if not np.isfinite(jerk):
        jerk = most * most / max(v, 1e-300)  # no limit: one period of the deceleration
    time = max(np.sqrt(v / jerk), abs(a) / jerk) if jerk > 0.0 else 0.0
    if not (time > 0.0 and np.isfinite(time)):
        return None
    unit = jerk * time
    try:
        found = velocity_control((v / (unit * time), a / unit), (0.0, 0.0), max(most, abs(a)) / unit, 1.0)
    except NoSolution:
        return None
    return [(h * time, j * jerk) for h, j in found]


def _travelled(state: PathState, phases: list[tuple[float, float]]) -> tuple[float, float]:
    """How far the phases take s, and the least speed at their ends."""
    at, v, a, least = 0.0, state.speed, state.acceleration, state.speed
    for h, j in phases:
        at, v, a = at + h * (v + h * (0.5 * a + h * j / 6.0)), v + h * (a + 0.5 * h * j), a + h * j
        least = min(least, v)
    return at, least


def _along(joint_path: JointPath, state: PathState, phases: list[tuple[float, float]]) -> Trajectory | None:
    """The joints' motion for a motion of s; None where that turns back.

    Each piece is made from how far the joints move on it, the integral of q': the difference of two positions would
    leave rounding only of a motion of nanometres.

    Returns
    -------
    Trajectory or None
        The motion.
    """
    h, j = (np.repeat(x, PHASE_PARTS) for x in np.array(phases).T)
    h /= PHASE_PARTS
    along = np.empty((3, h.size + 1))  # s from the start, ṡ, s̈
    along[:, 0] = 0.0, state.speed, state.acceleration
    for i in range(h.size):
        s, v, a = along[:, i]
        along[:, i + 1] = (
            s + h[i] * (v + h[i] * (0.5 * a + h[i] * j[i] / 6.0)),
            v + h[i] * (a + 0.5 * h[i] * j[i]),
            a + h[i] * j[i],
        )
    along[1:, -1] = 0.0
    if along[1].min() < -1e-9 * state.speed:
        return None
    s, v, a = along[0], along[1, :, None], along[2, :, None]
    place = np.minimum(state.s + s, joint_path.end)
    dq, ddq = composed((joint_path(place, 1), joint_path(place, 2)), (v, a))
    nodes, weights = np.polynomial.legendre.leggauss(4)
    inner = np.minimum(state.s + s[:-1, None] + np.diff(s)[:, None] * (0.5 + 0.5 * nodes), joint_path.end)
    rates = joint_path(inner.ravel(), 1).reshape(*inner.shape, -1)
    moved = np.einsum("k,kin,i->kn", np.diff(s), rates, 0.5 * weights)
    t = np.append(0.0, np.cumsum(h))
    motion = quintic(t, (np.zeros_like(moved), dq[:-1], ddq[:-1]), (moved, dq[1:], ddq[1:]))
    motion.c[5] = joint_path(state.s) + np.concatenate([np.zeros((1, moved.shape[1])), np.cumsum(moved, axis=0)[:-1]])
    return Trajectory(motion)
