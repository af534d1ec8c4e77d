"""Clearance: proved least distance between an arm and a scene, and between the arm's links, over a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.scene import Scene
from optik.scene.contact import TOUCHING, bodies_of, check_scene, find_pairs
from optik.types import Flags
from planners.certificate.bounds import NARROWEST_SHARE, axes_motion
from planners.certificate.clearance_search import search
from planners.certificate.violation import Violation
from planners.trajectory import Trajectory

CLOSE = (0.05, 1e-4)
"""A bound is refined until it is within this fraction of the least distance found, or this distance [m], if that is larger."""
MOST_INTERVALS = 200_000
"""Largest number of intervals: a hundred times that of a long motion past a shelf. The remaining intervals are not proved."""
POSITION_STEP, VELOCITY_STEP = 1e-11, 1e-10
"""Steps at a knot [rad or m, and per s] below which a motion counts as smooth: points move by less than `DISTANCE_ROUNDING`."""


class Closest(NamedTuple):
    """The least distance of one kind of pairs over a motion.

    Attributes
    ----------
    value : float
        Proved lower bound on the distance [m]; −infinity for contact, where the search ends.
    found : float
        Least distance at the examined instants [m]; the true least distance is between `value` and this one.
    time : float
        Its time [s].
    pair : (2,) tuple of str
        The shape of the arm, and the object or the other shape.
    margin : float
        Distance that must be exceeded [m]: the margin of the scene, 0 between links.
    """

    value: float
    found: float
    time: float
    pair: tuple[str, str]
    margin: float = 0.0

    @property
    def room(self) -> float:
        """The least distance found less the margin [m]."""
        return self.found - self.margin

    def describe(self) -> str:
        """Return the proved bound, the margin, and the least distance found, as words."""
        proved = f"at least {1e3 * self.value:.3g} mm" if np.isfinite(self.value) else "nothing proved"
        where = f"{self.pair[0]} and {self.pair[1]} at {self.time:.3g} s"
        return f"{proved} (margin {1e3 * self.margin:.3g} mm; found {1e3 * self.found:.3g} mm, {where})"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files; None for infinite numbers."""
        finite = {k: None if isinstance(x, float) and not np.isfinite(x) else x for k, x in self._asdict().items()}
        return finite | {"pair": list(self.pair)}


NOTHING = Closest(np.inf, np.inf, 0.0, ("", ""))
"""The least distance if no pair is examined."""


@dataclass(frozen=True)
class Clearance:
    """The least distances over a motion, for these shapes and this scene: two numbers, each with its margin.

    Attributes
    ----------
    scene, own : Closest or None
        Between the arm and the scene, and between the arm's own links; None without a pair to examine.
    left_out : tuple of (str, str, str)
        Pairs that were not examined, with reasons.
    """

    scene: Closest | None
    own: Closest | None
    left_out: tuple[tuple[str, str, str], ...]

    @property
    def kinds(self) -> dict[str, Closest]:
        """The examined kinds of pairs, by words: ``"to the scene"`` and ``"between links"``."""
        kinds = (("to the scene", self.scene), ("between links", self.own))
        return {words: kind for words, kind in kinds if kind is not None}

    @property
    def note(self) -> str:
        """A note on shapes and objects that are in contact although neither moves, such as a held arm; else empty."""
        touching = [f"{one} and {other}" for one, other, why in self.left_out if why == TOUCHING]
        return f"in contact, though neither moves: {', '.join(touching)}" if touching else ""

    @property
    def nearest(self) -> Closest:
        """`scene` or `own`: the one whose least distance found exceeds its margin by less; infinite without a pair."""
        return min(self.kinds.values(), key=lambda kind: kind.room, default=NOTHING)

    @property
    def touches(self) -> bool:
        """Whether links touch, or a distance to the scene at or below the margin was found."""
        return any(kind.found <= kind.margin for kind in self.kinds.values())

    @property
    def proved(self) -> bool:
        """Whether it is proved that no links touch and all distances to the scene exceed the margin."""
        return all(kind.value > kind.margin for kind in self.kinds.values())

    def find_violations(self) -> tuple[Violation, ...]:
        """Return a contact, or a distance that is not proved; empty if the motion is collision-free."""
        if self.proved:
            return ()
        kind = self.nearest
        where = f"{kind.pair[0]} and {kind.pair[1]} at t = {kind.time:.6g} s"
        beyond = "" if kind.margin == 0.0 else f", and the margin is {1e3 * kind.margin:.6g} mm"
        word = "not_proved" if kind.room > 0.0 else "contact"
        if kind.room > 0.0:
            words = f"the clearance is not proved: found {1e3 * kind.found:.6g} mm between {where}{beyond}"
        elif kind.found > 0.0:
            words = f"{1e3 * kind.found:.6g} mm between {where}{beyond}"
        else:
            words = f"contact of {where}"
        return (Violation(words, kind.time, word),)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files; None for infinite numbers, and for a kind without a pair."""
        kinds = {"scene": self.scene, "own": self.own}
        plain = {name: None if kind is None else kind.to_dict() for name, kind in kinds.items()}
        return plain | {"left_out": [list(pair) for pair in self.left_out]}


def clearance(robot: Robot, trajectory: Trajectory, scene: Scene) -> Clearance:
    """Return the proved least distances between an arm and a scene, and between its links, over a motion.

    On an interval with the middle m and half length h, let D be the distance of two convex bodies at m, one of them the axis of
    a capsule of the arm: the segment between two points e, which moves relative to the other body. Two bounds hold within the
    interval, of which the better one counts:

    * D − max |e(t) − e(m)|. A joint that turns by at most R moves e by at most R times its distance from the axis; from the
      inner joint to the outer one, each turns while those behind it stand as at m, so the distances at m add up.
    * Let n be the unit vector at m from the nearest point of the other body to x on the axis. The other body stays behind the
      plane at its nearest point, so the distance is at least D + min over e of n·(e(t) − x), and
      n·(e(t) − x) ≥ n·(e(m) − x) − |n·ė(m)| h − max|ë| h²/2. For a point of a link behind revolute joints with bounds V on
      their velocities and A on their accelerations, from the outermost joint inwards,
      |ė| grows by V r and |ë| by A r + V² r + 2 V |ė|, with r the distance to the axis at m plus what the outer joints can
      move e within the interval. This follows from e = p + R(q) e', e' in the frame behind the joint, differentiated twice. A
      sliding joint adds V and A. The bound needs continuous velocities.

    Where capsules come within `optik.scene.contact.HULLS_FROM` of contact, the hulls of the same parts count, if the arm has
    any: D is then their distance, and only the first bound holds. A point of a hull is within the radius ρ of the capsule of a
    point e of its axis, so that both joint by joint as above it moves by at most |e(t) − e(m)| + ρ Σ R, over the joints that
    turn it.

    For two capsules of the arm only the joints between their links count, seen from the inner link. R, V and A are the exact
    extrema of the polynomials, or within one polynomial their Taylor sums from m where those are less. An interval whose bound
    is not close to the least distance found so far is halved, at a knot first. Distances are exact but for rounding, which is
    subtracted (`optik.scene.distance`). The method follows the dichotomy by which HPP validates paths (Mirabel et al. 2016;
    before it Schwarzer, Saha and Latombe 2005) and conservative advancement (Mirtich 2000).
    """
    check_scene(robot, scene)
    pairs, bodies, axes = find_pairs(robot, scene), bodies_of(robot, scene), axes_motion(robot, trajectory)
    motion = (axes.padded, axes.knots, axes.piece_ranges, _is_continuous(axes))
    wanted = (scene.margin, *CLOSE, NARROWEST_SHARE * trajectory.duration, MOST_INTERVALS)
    least = np.empty((2, 4))
    search(robot.axes.chain, bodies, motion, wanted, least)
    touched = least[0, 0] <= scene.margin or least[1, 0] <= 0.0
    kinds: list[Closest | None] = []
    for found, t, value, pair in least.tolist():
        proved = -np.inf if touched else min(value, found)
        margin = scene.margin if not kinds else 0.0
        kinds.append(Closest(proved, found, t, pairs.names[int(pair)], margin) if pair >= 0 else None)
    return Clearance(kinds[0], kinds[1], pairs.left_out)


def _is_continuous(trajectory: Trajectory) -> Flags:
    """Return at which knots (m + 1,) positions and velocities are continuous to rounding."""
    smooth = np.ones(trajectory.knots.size, np.bool_)
    for order, step in enumerate((POSITION_STEP, VELOCITY_STEP)):
        smooth[1:-1] &= (np.abs(trajectory.jumps(order)) <= step).all(axis=1)
    return smooth
