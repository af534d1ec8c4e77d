"""Compiled search for the least distance between shapes over a motion: intervals of time are halved until it is proved."""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik import kinematics
from optik.arm.shapes.hull_distance import Hulls
from optik.compiled import compiled, inlined
from optik.kinematics import Chain
from optik.scene.contact import (
    CLOUD,
    HULLS_FROM,
    ROUND,
    SELF,
    Bodies,
    Objects,
    bound_distance,
    find_nearest,
    length_between,
    middle_of,
    read_row,
    refine,
    transform_point,
)
from optik.scene.distance import DISTANCE_ROUNDING, NearestPoint
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import instants

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
    x, y, z = transform_point(frame, link, (point[0], point[1], point[2]))
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
    spheres[k, 0], spheres[k, 1], spheres[k, 2] = middle_of(a, b)
    spheres[k, 3] = 0.5 * length_between(a, b)


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
    motion: Polynomials, first: int, last: int, span: Array, D: Array, joint: Array
) -> tuple[float, bool]:
    """Compute derivatives D (1, 6, n) at the middle of an interval over pieces `first` to `last`, and `joint` of `_locate_end`.

    Returns half the length of the interval [s], and whether velocities are continuous in it.
    """
    c, knots, extrema, continuous = motion
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
    interval: tuple[float, float, bool], least: Array, finer: tuple[Hulls, Array, float, float],
) -> float:  # fmt: skip
    """Return a lower bound on the distance of a pair (capsule, body, kind, base link) over an interval.

    thick: radii and rounding. interval: middle, half length, and whether it is smooth. least (4,): least distance found of this
    kind, its time, the lowest bound and the pair; updated with the distance at the middle. finer: hulls, the frames of the
    links, the displacement of hulls by turning about the axis, and the distance of capsules from which hulls count.

    Returns [m].
    """
    k, i, kind, base = pair
    near = find_nearest((k, i, kind), scene, moved[0])
    distance, closer = near[0] - (thick - DISTANCE_ROUNDING), -np.inf
    if distance <= finer[3] and finer[0][0].shape[0] > 0:
        found = refine((k, i, kind), scene, finer[0], finer[1])[0]
        if found > 0.0:
            distance, closer = max(distance, found), found - DISTANCE_ROUNDING - shift - finer[2]
    if distance < least[0]:
        least[0], least[1] = distance, interval[0]
    bound = near[0] - shift
    if interval[2] and near[0] > 0.0 and kind != CLOUD:  # a cloud is not convex: no plane separates it
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
    chain: Chain, bodies: Bodies, motion: Polynomials, wanted: SearchOptions,
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
    for node in range(nodes[0].shape[0]):
        first, last, start, number = nodes[1][node]
        h, smooth, placed = 0.0, True, False
        left[node, 0] = used
        for entry in range(start, start + number):
            which, bound = open_[0][entry], open_[1][entry]
            k, i, kind = pairs[which, 0], pairs[which, 1], pairs[which, 2]
            own = 1 if kind == SELF else 0
            if bound < _target(least[own, 0], own, wanted):
                if not placed:
                    h, smooth = _bound_joints(motion, first, last, nodes[0][node], D, joint)
                    kinematics.frames(chain, D[0, 0], frame)
                    spheres[:, 3], placed = -1.0, True
                locate_capsule(k, chain, frame, axes, joint, moved, spheres)
                base, thick = 0, radius[k] + DISTANCE_ROUNDING
                if kind == SELF:
                    locate_capsule(i, chain, frame, axes, joint, moved, spheres)
                    base, thick = link[i], thick + radius[i]
                elif kind == ROUND:
                    thick += scene[4][i]
                shift = max(away[k, 0, base], away[k, 1, base])
                rough = bound_distance(read_row(spheres, k), spheres[k, 3], kind, i, scene, spheres) - shift - thick
                if rough < _target(least[own, 0], own, wanted):
                    before, interval = least[own, 0], (0.5 * (nodes[0][node, 0] + nodes[0][node, 1]), h, smooth)
                    spin = 0.0
                    if hulls[0].shape[0] > 0:
                        spin = (radius[k] + DISTANCE_ROUNDING) * turn_between(joint, chain[1], base, link[k])
                    finer = (hulls, frame, spin, HULLS_FROM + (wanted[0] if own == 0 else 0.0))
                    judged = _judge((k, i, kind, base), thick, scene, moved, shift, interval, least[own], finer)
                    rough = max(rough, judged)
                    if least[own, 0] < before:
                        least[own, 3] = which
                bound = max(bound, rough)
            if bound >= _target(least[own, 0], own, wanted):
                least[own, 2] = min(least[own, 2], bound)
                continue
            rest[0][used], rest[1][used] = which, bound
            used += 1
        left[node, 1] = used - left[node, 0]
    return left


@compiled
def search(chain: Chain, bodies: Bodies, motion: Polynomials, wanted: SearchOptions, least: Array) -> int:
    """Find and prove the least distances over a motion, of pairs with the scene and of pairs of the arm's own capsules.

    All intervals of one length are bounded before their halves, so that the least distance found soon approaches the true one.
    The search ends at the first level where a pair reaches the margin, or when no pair is open.

    Shapes and units: least (2, 4) [m] (overwritten).
    """
    knots, pairs = motion[1], bodies[2]
    end = knots.shape[0] - 2
    least[:, 0], least[:, 1], least[:, 2], least[:, 3] = np.inf, 0.0, np.inf, -1.0
    spans = np.array([[0.0, 0.0], [knots[end + 1], knots[end + 1]], [0.0, knots[end + 1]]])
    parts = np.array([[0, 0, 0, 0], [end, end, 0, 0], [0, end, 0, 0]], np.int64)
    parts[:, 3] = pairs.shape[0]
    ids, bounds, total = np.arange(pairs.shape[0]), np.full(pairs.shape[0], -np.inf), 0
    while spans.shape[0]:
        total += spans.shape[0]
        rest = (np.empty(parts[:, 3].sum(), np.int64), np.empty(parts[:, 3].sum()))
        left = _judge_level(chain, bodies, motion, wanted, (spans, parts), (ids, bounds), rest, least)
        ends = least[0, 0] <= wanted[0] or least[1, 0] <= 0.0 or total >= wanted[4]
        halves, those, count = np.empty((2 * spans.shape[0], 2)), np.empty((2 * spans.shape[0], 4), np.int64), 0
        for k in range(spans.shape[0]):
            start, number = left[k]
            if ends or 0.5 * (spans[k, 1] - spans[k, 0]) <= wanted[3]:
                for entry in range(start, start + number):
                    own = least[1 if pairs[rest[0][entry], 2] == SELF else 0]
                    own[2] = min(own[2], rest[1][entry])
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
