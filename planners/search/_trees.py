"""Compiled RRT-Connect with proved edges, and shortening and rounding of its paths."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.arm.shapes.check import Capsules
from optik.arm.shapes.enclosure import complete_frame
from optik.arm.shapes.hulls import Hulls
from optik.compiled import compiled, inlined
from optik.kinematics import Chain, Triple
from optik.scene import Scene, contact
from optik.scene.cloud import count_parts
from optik.scene.contact import SELF, Objects
from optik.scene.distance import DISTANCE_ROUNDING, NearestPoint
from optik.types import Array, Indices
from planners.certificate.clearance import EndMotion, locate_capsule, turn_between

# ---------------- compiled checks of an arm among objects


Body = tuple[Chain, Capsules, Objects, Indices, Array, Array, Hulls, float]
"""An arm, its capsules, and a scene; the checked pairs (k, 4): capsule, number of the second body, its kind, and its row among
the boxes; the distance of axes (k,) at which a pair is in contact or within the margin [m]; boxes that enclose the objects
(rows, 15): centre, the axes of the edges, and half the edges [m, 1]; the hulls of both; and the margin [m]."""
Work = tuple[Array, Array, EndMotion, Array, Array, Indices, Array, Indices, Array]
"""Memory of the checks: joint frames (n, 4, 4), joint motion (4, n), motion of the ends of capsules, spheres (m, 4),
configuration (n,); the intervals that are not yet proved: open pairs (depth, pairs), ends (depth, 2), and number of open
pairs (depth,); and a seed of `refine`."""
HALF_SPACE = 1e5
"""Half the edges of the box that encloses the half-space behind a plane [m], as far as an arm can be."""
FINEST_PROOF = 1e-4
"""Smallest joint motion [rad, m] of a proof: an edge that needs a smaller one passes within about 0.1 mm of a body."""
MOST_OPEN = 40
"""Most intervals of an edge that wait for their proof. Each is at most half as long as the one before."""


def make_body(robot: Robot, scene: Scene) -> Body:
    """Return the arguments of the checks for an arm and a scene."""
    assert robot.shapes is not None
    found, radius, arrays = contact.find_pairs(robot, scene), robot.shapes.capsules[3], scene.arrays
    pairs = found.bodies
    kind, boxes, row = pairs[:, 2], [(np.zeros(3), np.eye(3), np.full(3, np.inf))], np.zeros(len(pairs), np.int64)
    for number, enclosing in _enclose(scene):
        of_kind = kind == number
        row[of_kind] = len(boxes) + pairs[of_kind, 1]
        boxes += enclosing
    thick = radius[pairs[:, 0]] + DISTANCE_ROUNDING + np.where(kind == SELF, 0.0, scene.margin)
    for number, second in ((SELF, radius), (contact.ROUND, arrays[4])):
        thick[kind == number] += second[pairs[kind == number, 1]]
    flat = np.array([np.concatenate([centre, axes.ravel(), half]) for centre, axes, half in boxes])
    rows = np.column_stack([pairs, row])
    return robot.chain, robot.shapes.capsules, arrays, rows, thick, flat, found.hulls, scene.margin


def _enclose(scene: Scene) -> Iterator[tuple[int, list[tuple[Array, Array, Array]]]]:
    """Yield each kind of objects, and for each object centre, axes (3, 3) and half edges of a box around it, without radii."""
    box_pose, box_half, a, b, _radius, planes, solids = scene.arrays
    yield contact.BOX, [(T[:3, 3], T[:3, :3].T, half) for T, half in zip(box_pose, box_half, strict=True)]
    yield (
        contact.CYLINDER,
        [(T[[3, 7, 11]], T[:12].reshape(3, 4)[:, :3].T, T[[16, 16, 17]]) for T in solids[: len(scene.cylinders)]],
    )
    corners = [(mesh.min(axis=0), mesh.max(axis=0)) for mesh in scene.meshes]
    last = len(corners) + sum(count_parts(len(points)) for points, _ in scene.clouds)
    corners += [(head[2:5] - head[8], head[5:8] + head[8]) for head in solids[::-1][len(corners) : last]]
    enclosing = [(0.5 * (low + high), np.eye(3), 0.5 * (high - low)) for low, high in corners]
    yield contact.MESH, enclosing
    yield contact.CLOUD, enclosing
    half = 0.5 * np.linalg.norm(b - a, axis=1)
    turn = [_frame_along(d / (2.0 * h) if h > 0.0 else np.eye(3)[2]) for d, h in zip(b - a, half, strict=True)]
    yield contact.ROUND, [(0.5 * (a[i] + b[i]), turn[i], np.array([0.0, 0.0, half[i]])) for i in range(len(a))]
    yield (
        contact.PLANE,
        [
            (x - HALF_SPACE * n, _frame_along(n), np.full(3, HALF_SPACE))
            for x, n in zip(planes[:, :3], planes[:, 3:], strict=True)
        ],
    )


def _frame_along(u: Array) -> Array:
    """Return orthonormal rows (3, 3), the last of them a unit vector."""
    return np.array([*complete_frame(u), u])


def make_work(body: Body) -> Work:
    """Return the memory of the checks."""
    chain, capsules, _scene, pairs = body[:4]
    n, m = len(chain[1]), len(capsules[0])
    moved = (np.empty((m, 2, 3)), np.zeros((m, 2, n + 1, 3)), np.zeros((m, 2, n + 1)), np.zeros((m, 2, n + 1)))
    spans, counts = np.empty((MOST_OPEN, 2)), np.empty(MOST_OPEN, np.int64)
    open_ = np.empty((MOST_OPEN, max(len(pairs), 1)), np.int64)
    seed = np.full((2, 4), -1.0)
    return np.empty((n, 4, 4)), np.zeros((4, n)), moved, np.empty((m, 4)), np.empty(n), open_, spans, counts, seed


@inlined
def _distance_from_box(boxes: Array, i: int, p: Triple) -> float:
    """Return the distance of a point from the box of a row."""
    x, y, z = p[0] - boxes[i, 0], p[1] - boxes[i, 1], p[2] - boxes[i, 2]
    u = max(abs(boxes[i, 3] * x + boxes[i, 4] * y + boxes[i, 5] * z) - boxes[i, 12], 0.0)
    v = max(abs(boxes[i, 6] * x + boxes[i, 7] * y + boxes[i, 8] * z) - boxes[i, 13], 0.0)
    w = max(abs(boxes[i, 9] * x + boxes[i, 10] * y + boxes[i, 11] * z) - boxes[i, 14], 0.0)
    return sqrt(u * u + v * v + w * w)


@inlined
def _rough_distance(spheres: Array, boxes: Array, k: int, i: int, kind: int, row: int) -> float:
    """Return a lower bound on the distance of axis k from the second body of a pair, from spheres and boxes around them."""
    middle = contact.read_row(spheres, k)
    if kind == SELF:
        return contact.length_between(middle, contact.read_row(spheres, i)) - float(spheres[k, 3] + spheres[i, 3])
    return _distance_from_box(boxes, row, middle) - float(spheres[k, 3])


@inlined
def _hull_gap(
    pair: tuple[int, int, int], scene: Objects, hulls: Hulls, frame: Array, margin: float, enough: float, seed: Array
) -> float:
    """Return a lower bound on the distance of a pair by its hulls, less the margin and rounding; above `enough` if possible."""
    less = DISTANCE_ROUNDING + (margin if pair[2] != SELF else 0.0)
    return contact.refine(pair, scene, hulls, frame, enough + less + DISTANCE_ROUNDING, seed)[0] - less


@inlined
def _free_of_hulls(gap: float, rate: float, h: float, slack: bool) -> float:
    """Return the half length ≤ h of the interval in which hulls stay apart that move by at most `rate` within h."""
    if gap > rate:
        return h
    return h * gap / rate if gap > 0.0 and not slack else 0.0


@compiled
def find_blocked(body: Body, q: Array, work: Work) -> int:
    """Return the first pair in contact or within the margin at a configuration, −1 if there is none.

    Shapes and units: q (n,) [rad, m].
    """
    chain, (link, ends_a, ends_b, _radius), scene, pairs, thick, boxes, hulls, margin = body
    frame, places, spheres = work[0], work[2][0], work[3]
    work[8][0, 0] = -1.0
    kinematics.frames(chain, q, frame)
    for k in range(link.shape[0]):
        a = contact.transform_point(frame, link[k], contact.read_row(ends_a, k))
        b = contact.transform_point(frame, link[k], contact.read_row(ends_b, k))
        places[k, 0, 0], places[k, 0, 1], places[k, 0, 2] = a
        places[k, 1, 0], places[k, 1, 1], places[k, 1, 2] = b
        spheres[k, 0], spheres[k, 1], spheres[k, 2] = contact.middle_of(a, b)
        spheres[k, 3] = 0.5 * contact.length_between(a, b)
    for p in range(pairs.shape[0]):
        k, i, kind = pairs[p, 0], pairs[p, 1], pairs[p, 2]
        if _rough_distance(spheres, boxes, k, i, kind, pairs[p, 3]) > thick[p]:
            continue
        if contact.find_nearest((k, i, kind), scene, places)[0] <= thick[p]:
            if hulls[0].shape[0] > 0 and _hull_gap((k, i, kind), scene, hulls, frame, margin, 0.0, work[8]) > 0.0:
                continue
            return p
    return -1


@inlined
def _free_half(
    near: NearestPoint, gap: float, moved: EndMotion, k: int, base: int, h: float, slack: bool, cloud: bool
) -> tuple[float, float]:  # fmt: skip
    """Return the half length ≤ h of the interval in which a pair stays apart, and the speed of its nearest point outwards.

    The motions of the ends are those of an interval of half length h. The bounds are those of `planners.certificate.clearance`.
    gap: distance less the radii. slack: the motion may deviate, so that its displacement does not vanish with the interval.
    cloud: no plane separates the other body, which is not convex.
    """
    places, velocity, away, bent = moved
    distance, share, w = near  # the distance is above 0, because the gap is
    rate = max(away[k, 0, base], away[k, 1, base])  # displacement within h
    if gap > rate or slack:
        return (h if gap > rate else 0.0), 0.0
    free = h * gap / rate
    if cloud:
        return free, 0.0
    n0, n1, n2 = w[0] / distance, w[1] / distance, w[2] / distance
    a, b = places[k, 0], places[k, 1]
    along = n0 * (b[0] - a[0]) + n1 * (b[1] - a[1]) + n2 * (b[2] - a[2])
    best, outwards = h, 0.0
    for e in range(2):
        v, fraction = velocity[k, e, base], share if e == 1 else 1.0 - share
        speed = n0 * v[0] + n1 * v[1] + n2 * v[2]
        outwards += fraction * speed
        ahead = gap + ((1.0 - share) * along if e == 1 else -share * along)
        if ahead <= 0.0:
            best = 0.0
            break
        root = abs(speed) + sqrt(speed * speed + 2.0 * bent[k, e, base] * ahead)
        if best * root > 2.0 * ahead:
            best = 2.0 * ahead / root
    return max(free, best), outwards


@inlined
def _set_interval(chain: Chain, a: Array, b: Array, deviation: Array, t: float, h: float, work: Work) -> None:
    """Compute the joint motion of the interval t ± h of the segment a–b; the capsules are not located yet."""
    frame, joint, spheres, q = work[0], work[1], work[3], work[4]
    for j in range(a.shape[0]):
        q[j] = a[j] + t * (b[j] - a[j])
    for i in range(frame.shape[0]):
        j, factor = kinematics.axis_of(chain, i)
        d = factor * (b[j] - a[j])
        joint[0, i], joint[2, i] = d, abs(d)
        joint[1, i] = h * abs(d) + abs(factor) * deviation[j]
    kinematics.frames(chain, q, frame)
    for k in range(spheres.shape[0]):
        spheres[k, 3] = -1.0


@inlined
def _measure(a: Array, b: Array, deviation: Array) -> tuple[float, bool]:
    """Return the length of a segment, and whether there is a deviation."""
    square, slack = 0.0, False
    for j in range(a.shape[0]):
        slack = slack or bool(deviation[j] > 0.0)
        square += (b[j] - a[j]) * (b[j] - a[j])
    return sqrt(square), slack


@compiled
def find_unproved(body: Body, a: Array, b: Array, deviation: Array, work: Work) -> int:
    """Return a pair that prevents the proof that a straight joint motion is free, −1 if all is proved.

    The proof covers every configuration of which each joint is within its deviation of some point of the segment a–b: distances
    in the middle of an interval bound how far the joints can move before contact, and the parts on both sides that remain are
    examined in the same way. Without a deviation the end b is examined first.

    Shapes and units: a, b, deviation (n,) [rad, m].
    """
    chain, (link, ends_a, ends_b, radius), scene, pairs, thick, boxes, hulls, margin = body
    frame, joint, moved, spheres, _q, open_, spans, counts, seed = work
    away, axes, (length, slack) = moved[2], (link, ends_a, ends_b), _measure(a, b, deviation)
    if not slack:
        last = find_blocked(body, b, work)
        if last >= 0:
            return last
    spans[0, 0], spans[0, 1], counts[0], top, seed[0, 0] = 0.0, 1.0, pairs.shape[0], 0, -1.0
    open_[0, : pairs.shape[0]] = np.arange(pairs.shape[0])
    while top >= 0:
        low, high, number = spans[top, 0], spans[top, 1], counts[top]
        t, h = 0.5 * (low + high), 0.5 * (high - low)
        _set_interval(chain, a, b, deviation, t, h, work)
        left, least, last, outwards = 0, h, -1, 0.0
        for entry in range(number):
            p = open_[top, entry]
            k, i, kind = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            locate_capsule(k, chain, frame, axes, joint, moved, spheres)
            if kind == SELF:
                locate_capsule(i, chain, frame, axes, joint, moved, spheres)
            base = link[i] if kind == SELF else 0
            shift = max(away[k, 0, base], away[k, 1, base])
            if _rough_distance(spheres, boxes, k, i, kind, pairs[p, 3]) > thick[p] + shift:
                continue
            near = contact.find_nearest((k, i, kind), scene, moved[0])
            gap, free, speed = near[0] - thick[p], 0.0, 0.0
            if gap > 0.0:
                free, speed = _free_half(near, gap, moved, k, base, h, slack, kind == contact.CLOUD)
            if free < h and gap <= contact.HULLS_FROM and hulls[0].shape[0] > 0:
                rate = shift + (radius[k] + DISTANCE_ROUNDING) * turn_between(joint, chain[1], base, link[k])
                finer = _hull_gap((k, i, kind), scene, hulls, frame, margin, rate, seed)
                gap, free = max(gap, finer), max(free, _free_of_hulls(finer, rate, h, slack))
            if gap <= 0.0:
                return int(p)
            if free < h:
                open_[top, left] = p
                left += 1
                if free < least or last < 0:
                    least, last, outwards = free, p, speed
        if left == 0:
            top -= 1
            continue
        if (least if not slack else h) * length < FINEST_PROOF or top + 1 >= MOST_OPEN:
            return int(last)
        before, behind = (low, t - least), (t + least, high)  # first the part with the contact, probably
        first, second = (before, behind) if outwards > 0.0 else (behind, before)
        open_[top + 1, :left] = open_[top, :left]
        spans[top, 0], spans[top, 1], counts[top] = second[0], second[1], left
        top += 1
        spans[top, 0], spans[top, 1], counts[top] = first[0], first[1], left
    return -1


# ---------------- compiled RRT-Connect between a start and goals, and shortening of its paths


Trees = tuple[Array, Indices, Indices]
"""Two trees: configurations (2, most, n) [rad, m], parents (2, most), −1 for a root, and numbers of configurations (2,)."""


LOCAL = 0.3
"""Size of the box around a configuration from which a local sample is taken, as a fraction of the joints' ranges."""


@inlined
def _square(a: Array, b: Array) -> float:
    """Return the square of the distance of two configurations."""
    total = 0.0
    for j in range(a.shape[0]):
        total += (b[j] - a[j]) * (b[j] - a[j])
    return total


@inlined
def _find_nearest_node(trees: Trees, tree: int, q: Array) -> int:
    best, nearest = np.inf, 0
    for k in range(trees[2][tree]):
        square = _square(trees[0][tree, k], q)
        if square < best:
            best, nearest = square, k
    return nearest


@compiled
def connect(
    body: Body, trees: Trees, samples: Array, ranges: Array, local: bool, step: float, work: Work
) -> tuple[int, int, int]:
    """Grow a tree from the start and one from the goals towards samples, until they meet.

    This is RRT-Connect (Kuffner and LaValle 2000). Each sample extends the smaller tree by one step. Then the other tree grows
    towards the new configuration until an edge is not free. The first attempt grows from the nearest goal to the start. If
    `local`, every second sample is moved near a configuration of the smaller tree: in a narrow passage it grows only there.

    Shapes and units: samples (k, n) within ranges (2, n) [rad, m], step [rad, m].

    Returns the number of samples used, and the last configurations of both trees, which are equal; −1 if they do not meet.
    """
    nodes, parents, counts = trees
    most, exact = nodes.shape[1], work[1][3]  # accelerations of the joints, zero: no deviation from an edge
    for k in range(samples.shape[0]):
        tree = 0 if counts[0] <= counts[1] else 1
        grown, new, target = tree, -1, samples[k]
        if k == 0:
            tree, grown, new, target = 0, 1, 0, nodes[0, 0]
        elif local and k % 2 == 1:
            node = nodes[tree, k // 2 % counts[tree]]
            for j in range(target.shape[0]):
                x = node[j] + LOCAL * (target[j] - 0.5 * (ranges[0, j] + ranges[1, j]))
                target[j] = min(max(x, ranges[0, j]), ranges[1, j])
        near = _find_nearest_node(trees, grown, target)
        while near >= 0:
            at, length = counts[grown], sqrt(_square(nodes[grown, near], target))
            if new >= 0 and length == 0.0:
                return (k + 1, new, near) if tree == 0 else (k + 1, near, new)
            if at >= most:
                return k + 1, -1, -1
            fraction = step / length if length > step else 1.0
            for j in range(target.shape[0]):
                start = nodes[grown, near, j]
                nodes[grown, at, j] = target[j] if fraction == 1.0 else start + fraction * (target[j] - start)
            if length == 0.0 or find_unproved(body, nodes[grown, near], nodes[grown, at], exact, work) >= 0:
                break
            parents[grown, at], counts[grown] = near, at + 1
            near = at
            if new < 0:
                grown, new, target = 1 - tree, at, nodes[tree, at]
                near = _find_nearest_node(trees, grown, target)
    return samples.shape[0], -1, -1


def trace_tree(trees: Trees, first: int, last: int) -> Array:
    """Return the path (k, n) from the start through configuration `first` of its tree, equal to `last` of the goals' tree."""
    nodes, parents, _counts = trees
    order: list[list[int]] = [[], []]
    for tree, k in ((0, first), (1, int(parents[1, last]))):
        while k >= 0:
            order[tree].append(k)
            k = int(parents[tree, k])
    return np.concatenate([nodes[0, order[0][::-1]], nodes[1, order[1]]])


@inlined
def _locate(path: Array, count: int, length: float, q: Array) -> int:
    """Write the point at a length along a path; return the number of the edge that it is on."""
    i, edge = 0, sqrt(_square(path[0], path[1]))
    while length > edge and i < count - 2:
        length -= edge
        i += 1
        edge = sqrt(_square(path[i], path[i + 1]))
    fraction = min(length / edge, 1.0) if edge > 0.0 else 0.0
    for j in range(q.shape[0]):
        q[j] = path[i, j] + fraction * (path[i + 1, j] - path[i, j])
    return i


@inlined
def _move_vertices(path: Array, first: int, count: int, by: int) -> None:
    """Move the vertices from `first` on to later places, or to earlier ones if `by` is below 0."""
    for m in range(count - first):
        k = count - 1 - m if by > 0 else first + m
        for j in range(path.shape[1]):
            path[k + by, j] = path[k, j]


@compiled
def shorten(body: Body, path: Array, count: int, draws: Array, work: Work) -> int:
    """Shorten a path by free straight motions between random points of it; first and last, remove vertices.

    Shapes and units: path (count + 2 rounds, n) [rad, m], overwritten, of which `count` are vertices; draws (rounds, 2) in
    [0, 1), two positions as fractions of the length.

    Returns the number of vertices that remain.
    """
    rounds, n, exact = draws.shape[0], path.shape[1], work[1][3]
    p, q = np.empty(n), np.empty(n)
    for r in range(-1, rounds + 1):
        if r < 0 or r == rounds:  # from each vertex the straight motion to the last one that is free
            i = 0
            while i < count - 2:
                for m in range(count - 1, i + 1, -1):
                    if find_unproved(body, path[i], path[m], exact, work) < 0:
                        _move_vertices(path, m, count, i + 1 - m)
                        count -= m - i - 1
                        break
                i += 1
            continue
        if count < 3:
            break
        total = 0.0
        for k in range(count - 1):
            total += sqrt(_square(path[k], path[k + 1]))
        i = _locate(path, count, total * min(draws[r, 0], draws[r, 1]), p)
        m = _locate(path, count, total * max(draws[r, 0], draws[r, 1]), q)
        if m > i and find_unproved(body, p, q, exact, work) < 0:
            _move_vertices(path, m + 1, count, 2 - (m - i))
            count += 2 - (m - i)
            for j in range(n):
                path[i + 1, j], path[i + 2, j] = p[j], q[j]
    return count


# ---------------- compiled proof of how far the corners of a path may be cut


CORNER_HALVINGS, MOST_SLABS = 10, 8
"""How often the length that is cut from a corner is halved before it counts as 0, and the most parts of a triangle's proof."""


@compiled
def prove_corner(body: Body, a: Array, v: Array, b: Array, work: Work) -> float:
    """Return the greatest proved fraction of a corner: the triangle between the vertex v and the points on its edges is free.

    The fraction of the points a and b (n,) is 1; they are at equal distances before and behind the vertex [rad, m]. The
    result is 0 if no fraction is proved.
    """
    # A slab of the triangle parallel to a–b is within half its height of its middle line, as long as its lower side. The height
    # is along the triangle's axis, so it bounds the deviation of each joint.
    n, fraction = v.shape[0], 1.0
    first, last, deviation = np.empty(n), np.empty(n), np.empty(n)
    for _ in range(CORNER_HALVINGS):
        slabs = 1
        while slabs <= MOST_SLABS:
            k = slabs - 1
            while k >= 0:
                middle, low = fraction * (k + 0.5) / slabs, fraction * (k + 1.0) / slabs
                for j in range(n):
                    axis, half = 0.5 * (a[j] + b[j]) - v[j], 0.5 * (b[j] - a[j])
                    first[j], last[j] = v[j] + middle * axis - low * half, v[j] + middle * axis + low * half
                    deviation[j] = 0.5 * fraction * abs(axis) / slabs
                if find_unproved(body, first, last, deviation, work) >= 0:
                    break
                k -= 1
            if k < 0:
                return fraction
            slabs *= 2
        fraction *= 0.5
    return 0.0
