"""Clearance: proved least distance between an arm and a scene, and between the arm's links, over a motion."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.arm.shapes.hulls import Hulls
from optik.compiled import compiled, inlined
from optik.kinematics import Chain
from optik.scene import Scene, contact
from optik.scene.contact import SELF, Bodies, Objects, bound_distance, read_row
from optik.scene.distance import DISTANCE_ROUNDING, NearestPoint
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import NARROWEST_SHARE, axes_motion, instants
from planners.certificate.violation import Violation
from planners.trajectory import Trajectory

# ---------------- compiled search for the least distance between shapes over a motion


Polynomials = tuple[Array, Array, Array, Flags]
"""A motion as arguments of kernels: coefficients (6, m, n), knots (m + 1,) [s], the pieces' extrema of orders 0 to 3
(4, m, n, 2), and at which knots (m + 1,) the velocities are continuous."""
EndMotion = tuple[Array, Array, Array, Array]
"""Motion of the ends of capsules in an interval: points (m, 2, 3) at its middle [m]; and relative to each link (n + 1):
velocity (m, 2, n + 1, 3) at its middle [m/s], and bounds on displacement and acceleration (m, 2, n + 1) [m, m/s²]."""
SearchOptions = tuple[float, float, float, float, int]
"""Margin to the scene [m]; fraction of the least distance found, and distance [m], within which a bound is close enough;
shortest half interval [s]; largest number of intervals."""


@inlined
def _locate_end(
    chain: Chain, frame: Array, link: int, point: Array, joint: Array, e: int, moved: EndMotion, k: int
) -> None:
    """Compute the position of end e of capsule k, and its motion relative to each link before its own.

    joint (4, n): velocities at the middle, and bounds over the interval on displacement, velocity and acceleration.
    """
    prismatic = chain[1]
    places, velocity, away, bent = moved
    x, y, z = contact.transform_point(frame, link, (point[0], point[1], point[2]))
    places[k, e, 0], places[k, e, 1], places[k, e, 2] = x, y, z
    v0, v1, v2, gone, speed, pull = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(link, -1, -1):
        velocity[k, e, i, 0], velocity[k, e, i, 1], velocity[k, e, i, 2] = v0, v1, v2
        away[k, e, i], bent[k, e, i] = gone, pull
        if i == 0:
            break
        j = i - 1  # the joint between link i − 1 and link i
        z0, z1, z2 = frame[j, 0, 2], frame[j, 1, 2], frame[j, 2, 2]
        rate, far, fast, hard = joint[0, j], joint[1, j], joint[2, j], joint[3, j]
        if prismatic[j]:
            v0, v1, v2 = v0 + rate * z0, v1 + rate * z1, v2 + rate * z2
            gone, speed, pull = gone + far, speed + fast, pull + hard
        else:
            d0, d1, d2 = x - frame[j, 0, 3], y - frame[j, 1, 3], z - frame[j, 2, 3]
            c0, c1, c2 = z1 * d2 - z2 * d1, z2 * d0 - z0 * d2, z0 * d1 - z1 * d0
            here = sqrt(c0 * c0 + c1 * c1 + c2 * c2)
            most = here + gone
            v0, v1, v2 = v0 + rate * c0, v1 + rate * c1, v2 + rate * c2
            pull += (hard + fast * fast) * most + 2.0 * fast * speed
            gone, speed = gone + far * here, speed + fast * most


@inlined
def locate_capsule(
    k: int,
    chain: Chain,
    frame: Array,
    axes: tuple[Indices, Array, Array],
    joint: Array,
    moved: EndMotion,
    spheres: Array,
) -> None:
    """Compute both ends of capsule k and the sphere around its axis, unless they are known for this interval."""
    if spheres[k, 3] >= 0.0:
        return
    _locate_end(chain, frame, axes[0][k], axes[1][k], joint, 0, moved, k)
    _locate_end(chain, frame, axes[0][k], axes[2][k], joint, 1, moved, k)
    a, b = read_row(moved[0][k], 0), read_row(moved[0][k], 1)
    spheres[k, 0], spheres[k, 1], spheres[k, 2] = contact.middle_of(a, b)
    spheres[k, 3] = 0.5 * contact.length_between(a, b)


@inlined
def turn_between(joint: Array, prismatic: Flags, base: int, link: int) -> float:
    """Return how far a link turns relative to another before it, at most: `joint` of `_locate_end`."""
    most = 0.0
    for j in range(base, link):
        if not prismatic[j]:
            most += joint[1, j]
    return most


@compiled
def _bound_joints(
    curves: Polynomials, first: int, last: int, span: Array, D: Array, joint: Array
) -> tuple[float, bool]:
    """Compute derivatives D (1, 6, n) at the middle of an interval over pieces `first` to `last`, and `joint` of `_locate_end`.

    Returns half the length of the interval [s], and whether velocities are continuous in it.
    """
    c, knots, extrema, continuous = curves
    t = 0.5 * (span[0] + span[1])
    h = 0.5 * (span[1] - span[0])
    piece, smooth = first, True
    for k in range(first + 1, last + 1):
        smooth = smooth and continuous[k]
        if knots[k] <= t:
            piece = k
    instants(c, np.full(1, piece), np.full(1, t - knots[piece]), D)
    for j in range(c.shape[2]):
        joint[0, j] = D[0, 1, j]
        for i in range(3):
            at, most = D[0, 0, j] if i == 0 else 0.0, 0.0
            for k in range(first, last + 1):
                most = max(most, at - extrema[i, k, j, 0], extrema[i, k, j, 1] - at)
            joint[1 + i, j] = most
        if first == last:  # Taylor sums are better for short intervals
            for i in range(3):
                total, factor = 0.0 if i == 0 else abs(D[0, i, j]), h
                for m in range(1, 6 - i):
                    total += abs(D[0, i + m, j]) * factor
                    factor *= h / (m + 1)
                joint[1 + i, j] = min(joint[1 + i, j], total)
    return h, smooth


@inlined
def _plane_distance(near: NearestPoint, moved: EndMotion, k: int, base: int, h: float) -> float:
    """Return a lower bound on the distance of axis k over an interval, from the plane at the nearest point; see `clearance`."""
    places, velocity, _away, bent = moved
    distance, share, w = near
    n0, n1, n2 = w[0] / distance, w[1] / distance, w[2] / distance
    a, b = places[k, 0], places[k, 1]
    along = n0 * (b[0] - a[0]) + n1 * (b[1] - a[1]) + n2 * (b[2] - a[2])
    least = np.inf
    for e in range(2):
        v = velocity[k, e, base]
        ahead = (1.0 - share if e == 1 else -share) * along
        speed = abs(n0 * v[0] + n1 * v[1] + n2 * v[2])
        least = min(least, ahead - h * (speed + 0.5 * h * bent[k, e, base]))
    return distance + least


@inlined
def _target(found: float, own: int, wanted: SearchOptions) -> float:
    """Return the lower bound that is close enough to the least distance found; above the margin unless that is reached."""
    margin, share, absolute = wanted[0] if own == 0 else 0.0, wanted[1], wanted[2]
    if found == np.inf:
        return found
    return max(found - max(share * abs(found), absolute), 0.5 * (found + margin))


@inlined
def _judge(
    pair: tuple[int, int, int, int], thick: float, scene: Objects, moved: EndMotion, shift: float,
    interval: tuple[float, float, bool], least: Array, finer: tuple[Hulls, Array, float, float, Array],
) -> float:  # fmt: skip
    """Return a lower bound on the distance of a pair (capsule, body, kind, base link) over an interval.

    thick: radii and rounding. interval: middle, half length, and whether it is smooth. least (4,): least distance found of this
    kind, its time, the lowest bound and the pair; updated with the distance at the middle. finer: hulls, the frames of the
    links, the displacement of hulls by turning about the axis, the distance of capsules from which hulls count, and a seed.

    Returns [m].
    """
    k, i, kind, base = pair
    near = contact.find_nearest((k, i, kind), scene, moved[0])
    distance, closer = near[0] - (thick - DISTANCE_ROUNDING), -np.inf
    if distance <= finer[3] and finer[0][0].shape[0] > 0:
        enough = max(least[0], 0.0) + 2.0 * DISTANCE_ROUNDING + shift + finer[2]
        refined = contact.refine((k, i, kind), scene, finer[0], finer[1], enough, finer[4])[0]
        if refined > 0.0:
            distance, closer = max(distance, refined), refined - DISTANCE_ROUNDING - shift - finer[2]
    if distance < least[0]:
        least[0], least[1] = distance, interval[0]
    bound = near[0] - shift
    if interval[2] and near[0] > 0.0 and kind != contact.CLOUD:  # a cloud is not convex: no plane separates it
        bound = max(bound, _plane_distance(near, moved, k, base, interval[1]))
    return max(bound - thick, closer)


@compiled
def _split(knots: Array, first: int, last: int, span: Array) -> tuple[float, int, int]:
    """Return the instant that divides an interval, at a knot if there is one; and the pieces before and after it."""
    t = 0.5 * (span[0] + span[1])
    if first == last:
        return t, first, first
    best = first + 1
    for k in range(first + 2, last + 1):
        if abs(knots[k] - t) < abs(knots[best] - t):
            best = k
    return knots[best], best - 1, best


@compiled
def _judge_level(
    chain: Chain, bodies: Bodies, curves: Polynomials, wanted: SearchOptions,
    nodes: tuple[Array, Indices], open_: tuple[Indices, Array], rest: tuple[Indices, Array], least: Array,
) -> Indices:  # fmt: skip
    """Bound the distances of the open pairs in all intervals of one level.

    nodes: spans (k, 2), and (k, 4): first and last piece, start and number of the open pairs. open_: pairs and their bounds.
    rest: output, pairs that remain open.

    Returns start and number (k, 2) of the remaining pairs of each interval.
    """
    (link, ends_a, ends_b, radius), scene, pairs, hulls = bodies
    count, n = link.shape[0], chain[1].shape[0]
    away = np.empty((count, 2, n + 1))
    moved = (np.empty((count, 2, 3)), np.empty((count, 2, n + 1, 3)), away, np.empty_like(away))
    frame, D, joint, spheres = np.empty((n, 4, 4)), np.empty((1, 6, n)), np.empty((4, n)), np.empty((count, 4))
    left, used, axes = np.zeros((nodes[0].shape[0], 2), np.int64), 0, (link, ends_a, ends_b)
    seed = np.full((2, 4), -1.0)
    for node in range(nodes[0].shape[0]):
        first, last, start, number = nodes[1][node]
        h, smooth, placed = 0.0, True, False
        left[node, 0] = used
        for entry in range(start, start + number):
            which, bound = open_[0][entry], open_[1][entry]
            k, i, kind = pairs[which, 0], pairs[which, 1], pairs[which, 2]
            group = 1 if kind == SELF else 0
            if bound < _target(least[group, 0], group, wanted):
                if not placed:
                    h, smooth = _bound_joints(curves, first, last, nodes[0][node], D, joint)
                    kinematics.frames(chain, D[0, 0], frame)
                    spheres[:, 3], placed = -1.0, True
                locate_capsule(k, chain, frame, axes, joint, moved, spheres)
                base, thick = 0, radius[k] + DISTANCE_ROUNDING
                if kind == SELF:
                    locate_capsule(i, chain, frame, axes, joint, moved, spheres)
                    base, thick = link[i], thick + radius[i]
                elif kind == contact.ROUND:
                    thick += scene[4][i]
                shift = max(away[k, 0, base], away[k, 1, base])
                rough = bound_distance(read_row(spheres, k), spheres[k, 3], kind, i, scene, spheres) - shift - thick
                if rough < _target(least[group, 0], group, wanted):
                    before, interval = least[group, 0], (0.5 * (nodes[0][node, 0] + nodes[0][node, 1]), h, smooth)
                    spin = 0.0
                    if hulls[0].shape[0] > 0:
                        spin = (radius[k] + DISTANCE_ROUNDING) * turn_between(joint, chain[1], base, link[k])
                    finer = (hulls, frame, spin, contact.HULLS_FROM + (wanted[0] if group == 0 else 0.0), seed)
                    judged = _judge((k, i, kind, base), thick, scene, moved, shift, interval, least[group], finer)
                    rough = max(rough, judged)
                    if least[group, 0] < before:
                        least[group, 3] = which
                bound = max(bound, rough)
            if bound >= _target(least[group, 0], group, wanted):
                least[group, 2] = min(least[group, 2], bound)
                continue
            rest[0][used], rest[1][used] = which, bound
            used += 1
        left[node, 1] = used - left[node, 0]
    return left


@compiled
def search(chain: Chain, bodies: Bodies, curves: Polynomials, wanted: SearchOptions, least: Array) -> int:
    """Find and prove the least distances over a motion, of pairs with the scene and of pairs of the arm's own capsules.

    All intervals of one length are bounded before their halves, so that the least distance found soon approaches the true one.
    The search ends at the first level where a pair reaches the margin, or when no pair is open.

    Shapes and units: least (2, 4) [m] (overwritten).
    """
    knots, pairs = curves[1], bodies[2]
    end = knots.shape[0] - 2
    least[:, 0], least[:, 1], least[:, 2], least[:, 3] = np.inf, 0.0, np.inf, -1.0
    spans = np.array([[0.0, 0.0], [knots[end + 1], knots[end + 1]], [0.0, knots[end + 1]]])
    parts = np.array([[0, 0, 0, 0], [end, end, 0, 0], [0, end, 0, 0]], np.int64)
    parts[:, 3] = pairs.shape[0]
    ids, bounds, total = np.arange(pairs.shape[0]), np.full(pairs.shape[0], -np.inf), 0
    while spans.shape[0]:
        total += spans.shape[0]
        rest = (np.empty(parts[:, 3].sum(), np.int64), np.empty(parts[:, 3].sum()))
        left = _judge_level(chain, bodies, curves, wanted, (spans, parts), (ids, bounds), rest, least)
        ends = least[0, 0] <= wanted[0] or least[1, 0] <= 0.0 or total >= wanted[4]
        halves, those, count = np.empty((2 * spans.shape[0], 2)), np.empty((2 * spans.shape[0], 4), np.int64), 0
        for k in range(spans.shape[0]):
            start, number = left[k]
            if ends or 0.5 * (spans[k, 1] - spans[k, 0]) <= wanted[3]:
                for entry in range(start, start + number):
                    group = least[1 if pairs[rest[0][entry], 2] == SELF else 0]
                    group[2] = min(group[2], rest[1][entry])
            elif number:
                t, before, behind = _split(knots, parts[k, 0], parts[k, 1], spans[k])
                halves[count, 0], halves[count, 1] = spans[k, 0], t
                halves[count + 1, 0], halves[count + 1, 1] = t, spans[k, 1]
                those[count, 0], those[count, 1] = parts[k, 0], before
                those[count + 1, 0], those[count + 1, 1] = behind, parts[k, 1]
                those[count : count + 2, 2], those[count : count + 2, 3] = start, number
                count += 2
        spans, parts, ids, bounds = halves[:count], those[:count], rest[0], rest[1]
    return total


# ---------------- clearance


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
        touching = [f"{one} and {other}" for one, other, why in self.left_out if why == contact.TOUCHING]
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
    contact.check_scene(robot, scene)
    pairs, bodies = contact.find_pairs(robot, scene), contact.bodies_of(robot, scene)
    axes = axes_motion(robot, trajectory)
    curves = (axes.padded, axes.knots, axes.piece_ranges, _is_continuous(axes))
    wanted = (scene.margin, *CLOSE, NARROWEST_SHARE * trajectory.duration, MOST_INTERVALS)
    least = np.empty((2, 4))
    search(robot.axes.chain, bodies, curves, wanted, least)
    touched = least[0, 0] <= scene.margin or least[1, 0] <= 0.0
    kinds: list[Closest | None] = []
    for least_value, t, value, pair in least.tolist():
        proved = -np.inf if touched else min(value, least_value)
        margin = scene.margin if not kinds else 0.0
        kinds.append(Closest(proved, least_value, t, pairs.names[int(pair)], margin) if pair >= 0 else None)
    return Clearance(kinds[0], kinds[1], pairs.left_out)


def _is_continuous(trajectory: Trajectory) -> Flags:
    """Return at which knots (m + 1,) positions and velocities are continuous to rounding."""
    smooth = np.ones(trajectory.knots.size, np.bool_)
    for order, step in enumerate((POSITION_STEP, VELOCITY_STEP)):
        smooth[1:-1] &= (np.abs(trajectory.jumps(order)) <= step).all(axis=1)
    return smooth
