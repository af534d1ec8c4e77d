"""A start for the optimum from rest to rest: a swept motion that nearly keeps all limits, and where its intervals end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optik.errors import NoSolution
from planners.follow import JointPath
from planners.timing import _sweep
from planners.timing._programme import UNITS, Programme, numbers
from planners.timing.base import MotionLimits, speed_bound
from planners.timing.smooth import NO_MOTION

Array = NDArray[np.float64]

PLACES, PER_PIECE = 300, 12
"""Least places of the sweep, and those between any two breaks."""
FIRST = 0.01
"""Length of the first cell and of the last, over that of others: from rest, places go with the cube of time."""
BENDS, TWISTS = 0.8, 0.6
"""Shares of the limits on acceleration and jerk that the path's own bends may use up at a steady speed."""
ROUNDS, CLOSE = 6, 1.1
"""Most sweeps, and by how much the last may be too fast: the rest is slowed as a whole."""
EVEN, PER_CHANGE = 80, 10
"""Of every motion, and what each change of an acceleration by its limit adds: a straight line has four."""


def start(joint_path: JointPath, limits: MotionLimits, intervals: int | None) -> Programme:
    """The programme from rest to rest.

    Raises
    ------
    NoSolution
        No limit bounds a joint that moves.
    """
    along = _along(joint_path, limits)
    m = along.s.size
    top, motion, share = np.empty(m), np.empty((4, m)), np.empty(m)
    _sweep.tops(along, BENDS, TWISTS, top)
    _sweep.swept(along, top, ROUNDS, CLOSE, motion)
    count = intervals or round(_sweep.spread(along, motion, EVEN, PER_CHANGE, share))
    t = motion[0]
    when = np.interp(np.linspace(0.0, share[-1], count + 1), share, t)
    found = np.empty((3, count + 1))
    _sweep.sampled(along.s, motion, when, found)
    s, v, a = found
    s[0], s[-1] = 0.0, joint_path.end
    return numbers(joint_path, limits, s, v, a, np.diff(when), (joint_path.end / UNITS, t[-1] / UNITS), None)


def _along(joint_path: JointPath, limits: MotionLimits) -> _sweep.Along:
    s = _sweep.graded(joint_path.path.breaks * (joint_path.end / joint_path.path.end), max(PLACES, joint_path.knots.size), PER_PIECE, FIRST)
    bound, top = limits.arrays(joint_path.robot.n), speed_bound(joint_path, limits, s)
    A, J = bound["acceleration"], bound["jerk"]
    q1, q2, q3 = (np.ascontiguousarray(joint_path(s, order)) for order in (1, 2, 3))
    size = np.abs(q1)
    length, a, j = s[-1], float((size / A).max(axis=1).mean()), float((size / J).max(axis=1).mean())
    # no motion takes less time than these by order of magnitude; far higher derivatives need not be told apart
    least = max(float((np.diff(s) / top[1:]).sum()), np.sqrt(length * a), np.cbrt(length * j))
    moving = np.ptp(joint_path.q, axis=0) > NO_MOTION
    if not 0.0 < least < np.inf:
        names = ", ".join(joint_path.robot.joint_names[i] for i in np.flatnonzero(moving))
        raise NoSolution("no limit bounds a joint that moves", s=0.0, advice=f"finite limits on one of {names}")
    top = np.minimum(top, 1e3 * length / least)
    return _sweep.Along(s, q1, q2, q3, A, J, top, (1e4 * length / least**2, 1e6 * length / least**3))
