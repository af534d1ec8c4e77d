"""Redundancy resolution for arms of more than six joints: null-space motion chosen along the path, then tracked exactly."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from optik import newton
from optik.arm.robot import Robot
from optik.types import Array, Flags
from planners.following import smoothing
from planners.following.branches import CollisionCheck, Rooms
from planners.following.joint_path import Guide
from planners.following.resolve import Resolution, resolve
from planners.following.resolve.graph import Sampler, Sequence, relax_sequences
from planners.following.smoothing import BARRIER_WEIGHT, STATION_REACHED
from planners.paths.base import Path

GUIDE_STATIONS = 25
"""Stations along the path at which the null-space motion is chosen: a spline of 24 pieces."""
CHOICES = 5
"""Null-space motions that are tried, the best first: the first can be followed on most paths."""
SHORTEST_FRACTION = 1e-3
"""Shortest step towards the end of the reach, as a fraction of the path: the accuracy of that end."""
KEEP_OFF_FACTOR = 8.0
"""Factor on the weight of the distance to the limits, if the null-space motion reached a limit."""
RETREATS = (0.7, 0.4, 0.2, 0.1, 0.0)
"""Fractions of the smoothing that are tried where all of it leads into contact."""
MOST_REFINEMENTS = 4
"""Most attempts to follow one null-space motion; before each new one, stations are inserted where following failed."""


def find_null_space_motions(
    robot: Robot, path: Path, q: Array | None, branch: str, collision: CollisionCheck | None = None,
    way: Sequence | None = None, time_limit: float = 0.0, made: list[Resolution] | None = None,
) -> Iterator[NullSpaceMotion]:  # fmt: skip
    """Yield null-space motions to try, the best first.

    Configurations q_k are chosen at stations along the path: those that are given; for ``"start"`` by minimum-norm joint motion
    from the given one; then, and for ``"best"`` at once, among all that are found (`planners.following.resolve`), with few
    stations first. They are then moved along their self-motion manifolds until the whole motion is smooth and keeps away from
    the limits. A spline g through them, and one W through the null spaces there, are the guide: q(s) is the configuration on
    the path with W(s) (q − g(s)) = 0. So q', q'', q''' are unique and exact for any splines.
    """
    fixed, rooms = branch == "start", None if collision is None else collision.find_rooms
    if way is not None:
        q_way = way.q.copy()
        _project(robot, path.pose(way.s), q_way)
        yield NullSpaceMotion(robot, path, way.s, q_way, held=fixed, rooms=rooms, smooth=False)
        return
    if fixed:
        assert q is not None
        s, first = np.linspace(0.0, path.end, GUIDE_STATIONS), q[None].copy()
        _project(robot, path.pose(s[:1]), first)
        yield NullSpaceMotion(robot, path, s, first, held=True, rooms=rooms)
        if not time_limit > 0.0:
            return
        q = first[0]
    sampler = Sampler(robot, robot, path, collision, time_limit or np.inf)
    for many in (True,) if fixed else (False, True) if time_limit > 0.0 else (False,):
        sequences, done = resolve(sampler, path, q, held=fixed, many=many, count=CHOICES)
        if made is not None:
            made.append(done)
        motions = (
            NullSpaceMotion(
                robot, path, *(parts[-1] if rooms is None else relax_sequences(sampler, path, parts[-1:], held=fixed)[0]),
                held=fixed, rooms=rooms, smooth=rooms is None,
            )
            for parts in sequences
        )  # fmt: skip
        # A relaxation among obstacles takes long, so the cheapest sequence is first; else that with the shortest motion.
        yield from motions if rooms is not None else sorted(motions, key=lambda motion: (-motion.s[-1], motion.length))


class NullSpaceMotion:
    """Configurations at stations along a path, smoothed together, and the guide through them."""

    def __init__(
        self, robot: Robot, path: Path, s: Array, way: Array, *, held: bool, rooms: Rooms | None = None, smooth: bool = True,
    ) -> None:  # fmt: skip
        self.robot, self.path, self.held, self.rooms = robot, path, held, rooms
        half = np.where(robot.limits.bounded, robot.limits.half, np.inf)  # a locked joint has no range
        self.chain, self.ranges = robot.chain, (robot.limits.middle, half)
        rest = np.linspace(0.0, path.end, GUIDE_STATIONS)
        self.first: Array = np.linalg.svd(robot.jacobian(way[0]))[2][6:].T.copy()
        self.s, self.way, self.keep_off = s[: len(way)], way, BARRIER_WEIGHT
        self._continue(np.append(s[len(way) :], rest[rest > s[-1]]))
        if smooth:
            self._smooth()

    @property
    def N(self) -> Array:
        """Bases (k, n, d) of the null spaces at the configurations, each near the one before."""
        N = np.empty((*self.way.shape, self.first.shape[1]))
        smoothing.find_null_spaces(self.chain, self.way, self.first, N)
        return N

    @property
    def length(self) -> float:
        """Mean square of the joints' motion per length of the path, times that length squared [rad², m²]."""
        return float(((np.diff(self.way, axis=0) ** 2).sum(axis=1) / np.diff(self.s)).sum() * self.s[-1])

    def _continue(self, s: Array) -> None:
        """Continue the last configuration to stations s (k,), as far as possible.

        If one is not reached, a nearer one is tried first, so that the last is near the end of the arm's reach.
        """
        ahead = list(s)
        while ahead:
            at = np.array([self.s[-1], *ahead])
            way = np.repeat(self.way[-1:], len(at), axis=0)
            poses, N = np.ascontiguousarray(self.path.pose(at)), self.first.copy()
            good = smoothing.continue_stations(self.chain, *self.ranges, poses, at / self.path.end, N, way)
            self.s, self.way = np.append(self.s, at[1:good]), np.concatenate([self.way, way[1:good]])
            ahead = ahead[good - 1 :]
            if ahead:
                if ahead[0] - self.s[-1] < SHORTEST_FRACTION * self.path.end:
                    return
                ahead.insert(0, 0.5 * (self.s[-1] + ahead[0]))

    def _smooth(self) -> None:
        poses, N = np.ascontiguousarray(self.path.pose(self.s)), np.empty((*self.way.shape, self.first.shape[1]))
        fractions, before = self.s / self.path.end, self.way
        self.way = np.array(before, order="C")
        smoothing.smooth(self.chain, self.ranges, (poses, fractions), self.first, self.keep_off, self.held, self.way, N)
        if self.rooms is not None and self.rooms(self.way).min() <= 0.0 < self.rooms(before).min():
            self._retreat(before, poses, self.rooms)

    def _retreat(self, before: Array, poses: Array, rooms: Rooms) -> None:
        """Undo so much of the smoothing from free configurations (k, n) that all are free again."""
        smoothed = self.way
        for fraction in RETREATS:
            self.way = before + fraction * (smoothed - before)
            if _project(self.robot, poses, self.way).all() and rooms(self.way).min() > 0.0:
                break

    def refine(self, s: float, limit: bool) -> bool:
        """Insert stations near s, where following failed, and smooth the motion again; return False if it cannot be refined."""
        if s >= self.s[-1] and self.s[-1] < self.path.end:
            return False
        k = int(np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2))
        near = slice(max(k - 2, 0), k + 4)
        more = 0.5 * (self.s[near][1:] + self.s[near][:-1])
        between = np.ascontiguousarray(0.5 * (self.way[near][1:] + self.way[near][:-1]))
        apart = np.diff(self.s[near]).min() >= SHORTEST_FRACTION * self.path.end
        if apart and _project(self.robot, self.path.pose(more), between).all():
            order = np.argsort(np.append(self.s, more))
            self.s, self.way = np.append(self.s, more)[order], np.concatenate([self.way, between])[order]
        elif not limit:
            return False
        if limit:
            self.keep_off *= KEEP_OFF_FACTOR
        self._smooth()
        return True

    def guide(self) -> Guide:
        """Return the guide through the configurations and their null spaces.

        After the last one it continues as a Taylor polynomial. A constant continuation would have a kink, and so would q'.
        """
        s, N = self.s, self.N
        k, n, d = N.shape
        both = np.concatenate([np.swapaxes(N, 1, 2).reshape(k, d * n), self.way], axis=1)
        spline = scipy.interpolate.make_interp_spline(s, both, k=min(5, k - 1))

        def guide(at: Array) -> tuple[Array, Array]:
            inside, u = np.minimum(at, s[-1]), np.maximum(at - s[-1], 0.0)[:, None]
            orders = np.stack([spline(inside, order) for order in range(4)], axis=1)
            orders[:, 0] += u * (orders[:, 1] + u * (orders[:, 2] / 2.0 + u * orders[:, 3] / 6.0))
            orders[:, 1] += u * (orders[:, 2] + u * orders[:, 3] / 2.0)
            orders[:, 2] += u * orders[:, 3]
            rows, g = orders[:, :, : d * n].reshape(at.size, 4, d, n), orders[:, :, d * n :]
            values = np.zeros((at.size, 4, d))
            for order, terms in enumerate(((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))):  # Leibniz
                for j, weight in enumerate(terms):
                    values[:, order] += weight * np.einsum("kdn,kn->kd", rows[:, order - j], g[:, j])
            return np.ascontiguousarray(rows), values

        return guide


def _project(robot: Robot, poses: Array, q: Array) -> Flags:
    """Project configurations (k, n), in place, onto poses (k, 4, 4) by minimum-norm steps; return which of them converge."""
    newton.polish_batch(robot.chain, q, poses, 12)
    return np.asarray(np.abs(robot.pose_errors(q, poses)).max(axis=1) < STATION_REACHED)
