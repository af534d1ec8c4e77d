"""A path sampled for marching, and the continuation of the joint motion along it at a singular configuration.

At such a configuration the Jacobian has a null space, in which pose and twist do not determine the joint velocity. Where the
tool's twist is in the range of the Jacobian, as in motion in the arm's plane through a straight wrist, there is one smooth
motion through it, the limit of the regular configurations on either side: the component in the null space is extrapolated
by the motion's own derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik import newton
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik import Tolerance
from optik.ik.closed_form import ClosedForm
from optik.types import Array, Flags
from planners.following import march
from planners.following.joint_path import LEAST_SPACING, fourth_bounds, smallest_singular_values
from planners.paths.base import Path

FOURTH_FRACTION = 0.2
"""Fraction of the tolerance that the path's fourth derivative may use in a step; the bound of the joints is wider."""

MOST_INSERTED = 100_000
"""Most samples that are inserted beforehand where the path bends; more are inserted only where a step is rejected."""

Guide = Callable[[Array], tuple[Array, Array]]
"""Constraint on the motion of a redundant arm: rows (k, 4, d, n) and values (k, 4, d) at s (k,), for `derivatives_at`."""


class Nodes(NamedTuple):
    """A path at s (k,): poses, twists (k, 3, 6), rows and values of the guide, bounds (k, 2) on fourth derivatives."""

    s: Array
    poses: Array
    twists: Array
    rows: Array
    values: Array
    fourth: Array


class Course:
    """A path with its null-space guide, to be sampled for marching."""

    def __init__(self, path: Path, guide: Guide) -> None:
        self.path, self.guide = path, guide
        self.pieces = path.piece_bounds()

    def nodes(self, s: Array) -> Nodes:
        """Return the path and its guide at s (k,)."""
        twists = np.empty((s.size, 3, 6))
        for order in (1, 2, 3):
            twists[:, order - 1] = self.path.twist(s, order)
        return Nodes(s, self.path.pose(s), twists, *self.guide(s), fourth_bounds(self.path, s, self.pieces))

    def spread(self, s: Array, tolerance: Tolerance) -> Array:
        """Return the values of s to march through: those given, the path's breaks, and more where the path bends.

        The path's contribution to the deviation in a step is h⁴/384 · |d⁴/ds⁴|. Breaks and samples nearer than `LEAST_SPACING`,
        in whose third derivatives rounding would show, are left out unless this contribution needs a shorter step.
        """
        breaks, fourth = self.path.breaks, self.pieces[:, :, 3]
        with np.errstate(divide="ignore"):
            share = (FOURTH_FRACTION * np.array([tolerance.position, tolerance.rotation]) / fourth).min(axis=1)
        step = np.sqrt(np.sqrt(384.0 * share))  # longest in each piece
        if len(breaks) > 2:
            s = np.union1d(s, breaks[1:-1])
        gap = np.diff(s)
        step = step[np.clip(np.searchsorted(breaks, s[:-1] + 0.5 * gap, side="right") - 1, 0, len(step) - 1)]
        parts = np.maximum(np.ceil(gap / step), 1.0).astype(np.int64)
        if parts.max() > 1:
            if parts.sum() > MOST_INSERTED:
                parts = np.minimum(parts, 16)
            u = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
            s, step = (
                np.append(np.repeat(s[:-1], parts) + np.repeat(gap / parts, parts) * u, s[-1]),
                np.repeat(step, parts),
            )
            gap = np.diff(s)
        if gap.min() >= LEAST_SPACING:
            return s
        kept = np.ones(len(s), np.bool_)
        thin(s, step, np.isin(s, breaks), kept)
        return np.asarray(s[kept])


@compiled
def thin(s: Array, step: Array, preferred: Flags, kept: Flags) -> None:
    """Leave out values of s nearer than `LEAST_SPACING` to the previous one, where the step may be that long.

    Of two near ones the preferred one is kept; both ends are always kept.

    Shapes and units: s (k,) [m, or rad], step (k - 1,) [m, or rad], preferred (k,), kept (k,).
    """
    last, longest = 0, step[0]
    for i in range(1, s.shape[0] - 1):
        least = min(longest, step[i])
        may = s[i + 1] - s[last] <= least
        near = s[i] - s[last] < LEAST_SPACING
        yields = s[i + 1] - s[i] < LEAST_SPACING and not preferred[i] and (preferred[i + 1] or i + 2 == s.shape[0])
        kept[i] = not (may and (near or yields))
        if kept[i]:
            last, longest = i, step[i]
        else:
            longest = least


def slice_nodes(nodes: Nodes, first: int, last: int | None = None) -> Nodes:
    """Return a range of nodes, without copying them."""
    return Nodes(*(x[first:last] for x in nodes))


def make_empty_guide(n: int) -> Guide:
    """Return the guide of an arm without null-space motion."""
    return lambda s: (np.empty((s.size, 4, 0, n)), np.empty((s.size, 4, 0)))


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
                q = q + 2.0 * np.pi * ~robot.prismatic * np.round((near - q) / (2.0 * np.pi))
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
