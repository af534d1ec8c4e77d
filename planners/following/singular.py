"""Where the joint motion along a path goes on at a singular configuration: from regular configurations near it.

At such a configuration the Jacobian says nothing about one direction of the joints. Where the tool's twist needs nothing
that is lost there, as in motion in the arm's plane through a straight wrist, there is one smooth motion through it, and it
is the limit of the regular configurations on either side: pose and twist determine all directions but the lost one, and
that is carried on by the motion's own derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.ik.closed_form import ClosedForm
from optik.types import Array
from planners.following import march
from planners.following.course import Course

CLEAR = 1e-4
"""Smallest singular value of a place ahead of a singular start: its derivatives q'' are exact to 1e-3 / m²."""

AHEAD = 2.0 ** np.arange(-10.0, -2.0)
"""Shares of the path at which the motion from a singular start is looked for, the nearest that is regular first."""


class At(NamedTuple):
    """A place s of a path, a configuration q (n,) there and its derivatives dq (3, n)."""

    s: float
    q: Array
    dq: Array


def smallest(robot: Robot, q: Array) -> float:
    """Smallest singular value of the Jacobian at q (n,)."""
    out = np.empty(1)
    kinematics.singular_values_batch(robot.chain, q[None], out)
    return float(out[0])


def beyond(robot: Robot, course: Course, near: At, s: float, away: float) -> At | None:
    """The configuration at s, ahead or behind, of the motion that is known at a regular place near it.

    Exact, if its smallest singular value is not below `away`. A singular end of the path is met by `kinematics.settle`.
    None where neither is so, or the configuration is not near where the motion leads.
    """
    chain, h = robot.chain, s - near.s
    q = near.q + h * (near.dq[0] + 0.5 * h * (near.dq[1] + h * near.dq[2] / 3.0))
    nodes, predicted, dq = course.nodes(np.array([s])), q.copy(), np.empty((3, robot.n))
    rows, values, reach = nodes.rows[0], nodes.values[0], max(1.0, float(np.abs(nodes.poses[0, :3, 3]).max()))
    error, _ = kinematics.put_on(chain, nodes.poses[0], rows[0], values[0], 8, q)
    rank, sigma = kinematics.derivatives_at(chain, q, nodes.twists[0], rows, values, dq, away)
    if not (sigma >= away and rank > 0.0):
        if 0.0 < s < course.path.end:
            return None
        q = predicted.copy()
        dq = np.stack([near.dq[0] + h * (near.dq[1] + 0.5 * h * near.dq[2]), near.dq[1] + h * near.dq[2], near.dq[2]])
        error = kinematics.settle(chain, nodes.poses[0], nodes.twists[0, 0], 6, q, dq[0])
        error = 0.0 if np.isfinite(error) else error  # what is left counts in the bound
    if not (error <= march.ON_PATH * reach and np.abs(q - predicted).max() <= march.LARGEST_CORRECTION):
        return None
    return At(s, q, dq)


def departures(robot: Robot, course: Course, near: Array | None = None) -> Iterator[tuple[At, At]]:
    """Singular starts of the path with smooth motions that go on from them: each start, and a regular place ahead.

    From every configuration a little ahead (or those near the given one, with its windings) back to the start.
    """
    chain, none = robot.chain, np.empty((4, 0, robot.n))
    for s in AHEAD * course.path.end:
        nodes, found = course.nodes(np.array([s])), False
        for q in roots(robot, nodes.poses[0], CLEAR)[0]:
            if near is not None:
                q = q + 2.0 * np.pi * ~robot.prismatic * np.round((near - q) / (2.0 * np.pi))
                if np.abs(q - near).max() > march.LARGEST_STEP:
                    continue
            dq = np.empty((3, robot.n))
            at = nodes.twists[0], none, none[:, :, 0]
            kinematics.put_on(chain, nodes.poses[0], none[0], none[0, :, 0], 8, q)
            rank, sigma = kinematics.derivatives_at(chain, q, *at, dq, march.REGULAR)
            if not (sigma >= CLEAR and rank > 0.0):
                continue
            right = At(float(s), q, dq)
            left = beyond(robot, course, right, 0.0, march.REGULAR)
            if left is not None:
                found |= bool(sigma >= march.REGULAR)
                yield left, right
        if found:
            return


def roots(robot: Robot, pose: Array, least: float, near: Array | None = None) -> tuple[Array, bool]:
    """Configurations (k, n) that meet a pose inside the limits, whose smallest singular value is at least so much.

    And whether there are others.
    """
    found = _closed_form(robot).branches(pose, near)
    singular = found.free.copy()
    for k in range(len(singular)):
        singular[k] |= smallest(robot, found.q[k]) < least
    return np.asarray(found.q[~singular]), bool(singular.any())


@lru_cache(maxsize=16)
def _closed_form(robot: Robot) -> ClosedForm:
    return ClosedForm(robot)
