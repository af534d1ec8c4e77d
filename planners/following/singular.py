"""Continue the joint motion along a path at a singular configuration, from regular configurations near it.

At such a configuration the Jacobian has a null space, in which pose and twist do not determine the joint velocity. Where the
tool's twist is in the range of the Jacobian, as in motion in the arm's plane through a straight wrist, there is one smooth
motion through it, the limit of the regular configurations on either side: the component in the null space is extrapolated
by the motion's own derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik import newton
from optik.arm.robot import Robot
from optik.ik.closed_form import ClosedForm
from optik.types import Array
from planners.following import march
from planners.following.joint_path import Course, smallest_singular_values

CLEAR = 1e-4
"""Least singular value of the regular configuration ahead of a singular start: q'' is exact to 1e-3 / m² there."""
AHEAD = 2.0 ** np.arange(-10.0, -2.0)
"""Fractions of the path at which a regular configuration ahead of a singular start is searched, the nearest first."""


class PathPoint(NamedTuple):
    """A point of a joint path: s, the configuration q (n,) and its derivatives dq (3, n)."""

    s: float
    q: Array
    dq: Array


def smallest_singular_value(robot: Robot, q: Array) -> float:
    """Return the smallest singular value of the Jacobian."""
    return float(smallest_singular_values(robot, q[None])[0])


def continue_to(robot: Robot, course: Course, near: PathPoint, s: float, away: float) -> PathPoint | None:
    """Return the continuation of a motion from a regular point to s near it, ahead or behind; None if it fails."""
    chain, h = robot.chain, s - near.s
    q = near.q + h * (near.dq[0] + 0.5 * h * (near.dq[1] + h * near.dq[2] / 3.0))
    nodes, predicted, dq = course.nodes(np.array([s])), q.copy(), np.empty((3, robot.n))
    rows, values, reach = nodes.rows[0], nodes.values[0], max(1.0, float(np.abs(nodes.poses[0, :3, 3]).max()))
    error, _ = newton.polish(chain, nodes.poses[0], rows[0], values[0], 8, q)
    rank, sigma = newton.derivatives_at(chain, q, nodes.twists[0], rows, values, dq, away)
    if not (sigma >= away and rank > 0.0):
        if 0.0 < s < course.path.end:
            return None
        q = predicted.copy()
        dq = np.stack([near.dq[0] + h * (near.dq[1] + 0.5 * h * near.dq[2]), near.dq[1] + h * near.dq[2], near.dq[2]])
        error = newton.polish_damped(chain, nodes.poses[0], nodes.twists[0, 0], 6, q, dq[0])
        error = 0.0 if np.isfinite(error) else error  # the remaining error counts in the bound
    if not (error <= march.ON_PATH * reach and np.abs(q - predicted).max() <= march.LARGEST_CORRECTION):
        return None
    return PathPoint(s, q, dq)


def find_departures(robot: Robot, course: Course, near: Array | None = None) -> Iterator[tuple[PathPoint, PathPoint]]:
    """Yield smooth motions that begin at a singular start of the path.

    They are continued backwards to the start from the regular configurations a little ahead.
    """
    chain, none = robot.chain, np.empty((4, 0, robot.n))
    for s in AHEAD * course.path.end:
        nodes, found = course.nodes(np.array([s])), False
        for q in find_regular_roots(robot, nodes.poses[0], CLEAR)[0]:
            if near is not None:
                q = q + 2.0 * np.pi * robot.turning * np.round((near - q) / (2.0 * np.pi))
                if np.abs(q - near).max() > march.LARGEST_STEP:
                    continue
            dq = np.empty((3, robot.n))
            at = nodes.twists[0], none, none[:, :, 0]
            newton.polish(chain, nodes.poses[0], none[0], none[0, :, 0], 8, q)
            rank, sigma = newton.derivatives_at(chain, q, *at, dq, march.REGULAR)
            if not (sigma >= CLEAR and rank > 0.0):
                continue
            right = PathPoint(float(s), q, dq)
            left = continue_to(robot, course, right, 0.0, march.REGULAR)
            if left is not None:
                found |= bool(sigma >= march.REGULAR)
                yield left, right
        if found:
            return


def find_regular_roots(robot: Robot, pose: Array, least: float, near: Array | None = None) -> tuple[Array, bool]:
    """Return the regular configurations of a pose inside the limits, and whether there are singular ones."""
    found = _closed_form(robot).branches(pose, near)
    singular = found.free.copy()
    for k in range(len(singular)):
        singular[k] |= smallest_singular_value(robot, found.q[k]) < least
    return np.asarray(found.q[~singular]), bool(singular.any())


@lru_cache(maxsize=16)
def _closed_form(robot: Robot) -> ClosedForm:
    return ClosedForm(robot)
