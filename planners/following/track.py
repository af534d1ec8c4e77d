"""Track one branch along a path: march, divide rejected steps, step over singular configurations."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik import newton
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.motors import ranges_of
from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.ik.closed_form import ClosedForm
from optik.types import Array
from planners.following import joint_path, march
from planners.following.joint_path import LEAST_SPACING, Course, Nodes, slice_nodes, smallest_singular_values

# ---------------- continue the joint motion along a path at a singular configuration


CLEAR = 1e-4
"""Least singular value of the regular configuration ahead of a singular start: q'' is exact to 1e-3 / m² there."""
AHEAD = 2.0 ** np.arange(-10.0, -2.0)
"""Fractions of the path at which a regular configuration ahead of a singular start is searched, the nearest first."""


class PathPoint(NamedTuple):
    """A point of a joint path: s, the configuration q (n,) and its derivatives dq (3, n)."""

    s: float
    q: Array
    dq: Array


def singular_value_at(robot: Robot, q: Array) -> float:
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
        nodes, regular = course.nodes(np.array([s])), False
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
                regular |= bool(sigma >= march.REGULAR)
                yield left, right
        if regular:
            return


def find_regular_roots(robot: Robot, pose: Array, least: float, near: Array | None = None) -> tuple[Array, bool]:
    """Return the regular configurations of a pose inside the limits, and whether there are singular ones."""
    found = _closed_form(robot).branches(pose, near)
    singular = found.free.copy()
    for k in range(len(singular)):
        singular[k] |= singular_value_at(robot, found.q[k]) < least
    return np.asarray(found.q[~singular]), bool(singular.any())


@lru_cache(maxsize=16)
def _closed_form(robot: Robot) -> ClosedForm:
    return ClosedForm(robot)


# ---------------- track one branch along a path


LEAST_STEP = 1e-6
"""Shortest step, as a fraction of the path length: the accuracy of the end of a branch."""
FINEST_STEP = 1e-11
"""Shortest step, as a fraction of the path length, where only the path bends too much; rounding in s is 1e-16."""
MOST_NODES = 200_000
"""Most nodes of one path, at which tracking stops: minutes of computing time."""
BEND_FRACTION = 1e-3
"""Fraction of the tolerance below which the path's own bend does not limit a step, only the joints do."""
NODES_AT_ONCE = 1024
"""Nodes per march, so that the work of a rejected step does not grow with the path."""
STEP_OVER_FROM = (march.REGULAR, 1.7e-3, 3e-3, 5e-3, 1e-2, 3e-4, 1e-4)
"""Smallest singular values at the ends of a step over a singular configuration, in the order they are tried. Small ones make
a short step; at large ones a path that passes a little beside the singularity is still stepped over; the smallest are for
arms that leave the singularity slowly."""
STEP_OVER_LENGTHS = (1.0, 1.7, 3.0, 5.0)
"""Ratios of the step length behind the singular configuration to that before it, where the joint speeds change."""
SAME_START = 1e-4
"""Largest distance of a continuation of a singular start from the given one [rad or m]: `follow` accepts as much."""


class TrackEnd(NamedTuple):
    """End of a branch at s: a code of `march`, its value, and the joint at its limit, or −1."""

    code: int
    s: float
    value: float
    joint: int


class FollowedTrack(NamedTuple):
    """Nodes s (k,) of a branch with q (k, n) and dq (k, 3, n); and its end, or None at the end of the path."""

    s: Array
    q: Array
    dq: Array
    ended: TrackEnd | None


def track(
    robot: Robot, course: Course, nodes: Nodes, q_start: Array, tolerance: Tolerance,
    limits: tuple[Array, Array] | None = None,
) -> FollowedTrack:  # fmt: skip
    """Track the branch of a configuration along a path."""
    if limits is not None:
        return _Tracker(robot, course, tolerance, limits).run(nodes, q_start)
    way = _Tracker(robot, course, tolerance, (robot.limits.lower, robot.limits.upper)).run(nodes, q_start)
    return way if robot.motors is None else cut_at_motors(robot, way)


def find_exit(robot: Robot, s: Array, q: Array, dq: Array) -> tuple[float, int]:
    """Return where the first joint, or motor, leaves its range between nodes, and which; infinity if none does."""
    ranges = ranges_of(robot)
    x, dx = ranges.values(q), ranges.values(dq, 1)
    lower, upper = ranges.lower - LIMIT_TOLERANCE, ranges.upper + LIMIT_TOLERANCE
    exits = [march.find_limit_exit(s, x, dx, lower, upper, i) for i in range(lower.size)]
    i = int(np.argmin(exits))
    return float(exits[i]), i


def cut_at_motors(robot: Robot, way: FollowedTrack, turns: Array | float = 0.0) -> FollowedTrack:
    """Return a track, shifted by turns (n,), up to where a motor leaves its range."""
    s, i = find_exit(robot, way.s, way.q + turns, way.dq)
    if s >= way.s[-1]:
        ended = way.ended
        if ended is None or ended.code != march.LIMIT:
            return way
        return way._replace(ended=ended._replace(joint=ranges_of(robot).find(ended.joint)))
    k = max(int(np.searchsorted(way.s, s)), 1)
    return FollowedTrack(way.s[:k], way.q[:k], way.dq[:k], TrackEnd(march.LIMIT, s, 0.0, i))


class _Tracker:
    """A stack of the remaining parts of the path, the next one on top, and the accepted nodes.

    Each part begins with the last node of the previous one, so the cost of a rejected step is independent of the path length.
    """

    def __init__(self, robot: Robot, course: Course, tolerance: Tolerance, limits: tuple[Array, Array]) -> None:
        self.robot, self.course, self.limits = robot, course, limits
        self.chain = robot.chain
        self.slack = limits[0] - LIMIT_TOLERANCE, limits[1] + LIMIT_TOLERANCE
        self.allowed = np.array([tolerance.position, tolerance.rotation])
        self.end, self.count, n = course.path.end, 0, robot.n
        self.s, self.q, self.dq = np.empty(256), np.empty((256, n)), np.empty((256, 3, n))
        self.ahead: list[Nodes] = []
        self.least = march.REGULAR  # smallest singular value that a node may have
        self.at_limit: TrackEnd | None = None  # the end, once a limit was found

    def run(self, nodes: Nodes, q_start: Array) -> FollowedTrack:
        ended = self._begin(nodes, q_start)
        while ended is None and self.ahead:
            ended = self._advance(self.ahead.pop())
        k = self.count
        return FollowedTrack(self.s[:k], self.q[:k], self.dq[:k], ended or self.at_limit)

    def _keep(self, s: Array, q: Array, dq: Array) -> None:
        """Append accepted nodes (k,)."""
        new = self.count + len(s)
        while new > len(self.s):
            self.s, self.q, self.dq = (np.concatenate([x, np.empty_like(x)]) for x in (self.s, self.q, self.dq))
        at = slice(self.count, new)
        self.s[at], self.q[at], self.dq[at] = s, q, dq
        self.count = new

    def _resume(self, nodes: Nodes) -> None:
        """Continue from the last accepted node to the first node, of these or of the parts after them, that is well ahead."""
        s = float(self.s[self.count - 1])
        self.ahead.append(nodes)
        while self.ahead:
            nodes = self.ahead.pop()
            i = int(np.searchsorted(nodes.s, min(s + LEAST_SPACING, self.end)))
            if i < len(nodes.s) and nodes.s[i] > s:
                self.ahead += [slice_nodes(nodes, i), self.course.nodes(np.array([s, nodes.s[i]]))]
                return

    # ------------------------------------------------------------ the start

    def _begin(self, nodes: Nodes, q_start: Array) -> TrackEnd | None:
        """Project the start onto the path; at a singular one, begin with a smooth motion that starts there."""
        q, dq = np.array(q_start), np.empty((3, self.robot.n))
        reach = max(1.0, float(np.abs(nodes.poses[0, :3, 3]).max()))
        error, _ = newton.polish(self.chain, nodes.poses[0], nodes.rows[0, 0], nodes.values[0, 0], 10, q)
        at = nodes.twists[0], nodes.rows[0], nodes.values[0]
        rank, sigma = newton.derivatives_at(self.chain, q, *at, dq, march.REGULAR)
        outside = np.maximum(self.slack[0] - q, q - self.slack[1])
        start = np.clip(q_start, *self.limits)
        if not sigma >= march.REGULAR and self._depart(nodes, start):
            return None
        self._keep(nodes.s[:1], start[None], dq[None])
        if not sigma >= march.SMALLEST_SINGULAR_VALUE or rank == 0.0:
            return TrackEnd(march.SINGULAR, 0.0, float(sigma), -1)
        if not error <= march.ON_PATH * reach:
            return TrackEnd(march.NOT_MET, 0.0, error, -1)
        if outside.max() > 0.0:
            return TrackEnd(march.LIMIT, 0.0, 0.0, int(outside.argmax()))
        self.q[0] = q
        if sigma < march.REGULAR:
            self.least = march.SMALLEST_SINGULAR_VALUE
        self.ahead.append(nodes)
        return None

    def _depart(self, nodes: Nodes, q_start: Array) -> bool:
        """Begin at a singular configuration with a smooth motion from it; return whether there is one."""
        if self.robot.n > 6:
            return False
        for left, right in find_departures(self.robot, self.course, q_start):
            if np.abs(left.q - q_start).max() <= SAME_START and self._check_step(left, right) == march.DONE:
                for end in (left, right):
                    self._keep(np.array([end.s]), end.q[None], end.dq[None])
                self._resume(nodes)
                return True
        return False

    # ------------------------------------------------------------ marching

    def _advance(self, nodes: Nodes) -> TrackEnd | None:
        """March through nodes, the first of which is the last accepted one, and handle the result."""
        most = NODES_AT_ONCE if self.least == march.REGULAR else 2
        if len(nodes.s) > most:
            self.ahead.append(slice_nodes(nodes, most - 1))
            nodes = slice_nodes(nodes, 0, most)
        k, n = len(nodes.s), self.robot.n
        q, dq, singular = np.empty((k, n)), np.empty((k, 3, n)), np.empty(k)
        q[0], dq[0] = self.q[self.count - 1], self.dq[self.count - 1]
        good, code, value, joint = march.march(
            self.chain, self.slack, (*nodes,), self.allowed, self.least, q, dq, singular
        )
        self._keep(nodes.s[1:good], q[1:good], dq[1:good])
        near_singular = self.least < march.REGULAR and good > 1
        if near_singular and singular_value_at(self.robot, q[good - 1]) >= march.REGULAR:
            self.least = march.REGULAR
        i = good - 1
        if code == march.DONE:
            return None
        if code == march.LIMIT:
            return self._approach_limit(nodes, i, q[i : i + 2], dq[i : i + 2], value, joint)
        a, b = float(nodes.s[i]), float(nodes.s[i + 1])
        if code == march.SINGULAR:
            proved, coarse = self._step_over(nodes, i, value)
            if proved:
                return None
            if self.least == march.REGULAR and (not coarse or b - a <= LEAST_SPACING):  # approach it node by node
                self.least = march.SMALLEST_SINGULAR_VALUE
                self.ahead.append(slice_nodes(nodes, i))
                return None
        bends = (b - a) ** 4 / 384.0 * nodes.fourth[i] > BEND_FRACTION * self.allowed
        least = FINEST_STEP if code == march.LOOSE and bends.any() else LEAST_STEP
        if b - a <= least * self.end or self.count > MOST_NODES:
            return TrackEnd(code, b if code == march.SINGULAR else a, value, -1)
        parts = int(np.clip(np.ceil(value**0.25), 2, 16)) if code == march.LOOSE and value < np.inf else 2
        self.ahead += [slice_nodes(nodes, i + 1), self.course.nodes(np.linspace(a, b, parts + 1))]
        return None

    def _approach_limit(self, nodes: Nodes, i: int, q: Array, dq: Array, value: float, joint: int) -> TrackEnd | None:
        """Continue from node i up to the limit that the step to the next node, with ends q and dq, exceeds."""
        a, b = float(nodes.s[i]), float(nodes.s[i + 1])
        points = np.empty((self.robot.n, 6))
        march.control_points(b - a, q[0], dq[0], q[1], dq[1], points)
        u = march.find_exit(points[joint], self.limits[0][joint], self.limits[1][joint])
        limit = a + min(u, value) * (b - a)
        ended = TrackEnd(march.LIMIT, limit, value, joint)
        if limit - a > LEAST_STEP * self.end and (self.at_limit is None or limit < self.at_limit.s):
            self.ahead = [self.course.nodes(np.array([a, limit]))]
            self.at_limit = ended
            return None
        return ended

    # ------------------------------------------------------------ singular configurations

    def _step_over(self, nodes: Nodes, i: int, value: float) -> tuple[bool, bool]:
        """Step over the node after node i, with this singular value, between regular nodes or to the path's end.

        Return whether the step is proved, and if not, whether a shorter one might be.
        """
        middle, coarse, back = float(nodes.s[i + 1]), False, min(self.count, 64)
        sigma = smallest_singular_values(self.robot, self.q[self.count - back : self.count])
        for away in STEP_OVER_FROM:
            from_here = np.flatnonzero(sigma >= away)
            if not from_here.size:
                continue
            k = self.count - back + int(from_here[-1])
            left = PathPoint(float(self.s[k]), self.q[k].copy(), self.dq[k].copy())
            if value >= away:  # the node ahead is not singular at this threshold
                continue
            for stretch in STEP_OVER_LENGTHS:
                s = min(middle + stretch * (middle - left.s), self.end)
                right = continue_to(self.robot, self.course, left, s, away)
                if right is None:
                    continue
                code = self._check_step(left, right)
                if code == march.LOOSE:
                    ends = self._soften(k, left, right)
                else:
                    ends = [left, right] if code == march.DONE else None
                if ends is not None:
                    self.count = k
                    for end in ends:
                        self._keep(np.array([end.s]), end.q[None], end.dq[None])
                    self._resume(slice_nodes(nodes, i + 1))
                    return True, False
                coarse |= code in (march.LOOSE, march.TOO_LONG)
        return False, coarse

    def _soften(self, k: int, left: PathPoint, right: PathPoint) -> list[PathPoint] | None:
        """Return the step from node k as a cubic, with a node before it if needed; None if neither is accepted."""
        # Near a singular configuration that the path passes a little beside, exact second derivatives describe the
        # detour of the joints around it, not the step over it. The proof needs pose and twist only.
        h, (v0, v1) = right.s - left.s, (left.dq[0], right.dq[0])
        slope = (right.q - left.q) / h
        third = 6.0 * (v0 + v1 - 2.0 * slope) / h**2
        soft = PathPoint(left.s, left.q, np.stack([v0, (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, third]))
        softer = PathPoint(right.s, right.q, np.stack([v1, (4.0 * v1 + 2.0 * v0 - 6.0 * slope) / h, third]))
        if self._check_step(soft, softer) != march.DONE:
            return None
        before = PathPoint(float(self.s[k - 1]), self.q[k - 1], self.dq[k - 1]) if k > 0 else soft
        # The piece before must be accepted with this end, too.
        if k == 0 or self._check_step(before, soft) == march.DONE:
            return [soft, softer]
        between = continue_to(self.robot, self.course, left, left.s - 0.2 * (left.s - before.s), 0.0)
        if between is not None and self._check_step(before, between) == self._check_step(between, soft) == march.DONE:
            return [between, soft, softer]
        return None

    def _check_step(self, left: PathPoint, right: PathPoint) -> int:
        """Return the code of a step outside the march; DONE if it is accepted."""
        h, n = right.s - left.s, self.robot.n
        if np.abs(right.q - left.q).max() > march.LARGEST_STEP:
            return march.TOO_LONG
        if not h * max(np.abs(left.dq[0]).max(), np.abs(right.dq[0]).max()) <= march.LARGEST_STEP:
            return march.TOO_LONG
        aside = right.q - left.q - 0.5 * h * (left.dq[0] + right.dq[0])  # difference from the mean velocity
        if not np.abs(aside).max() <= march.LARGEST_CORRECTION:
            return march.NOT_MET
        points = np.empty((n, 6))
        s, q, dq = np.array([left.s, right.s]), np.stack([left.q, right.q]), np.stack([left.dq, right.dq])
        out = joint_path.deviation_bounds(self.robot, self.course.path, s, q, dq, self.course.pieces)
        if not (out[0] <= self.allowed).all():
            return march.LOOSE
        march.control_points(h, left.q, left.dq, right.q, right.dq, points)
        exits = [march.find_exit(points[j], self.slack[0][j], self.slack[1][j]) for j in range(n)]
        return march.LIMIT if min(exits) <= 1.0 else march.DONE
