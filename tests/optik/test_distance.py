from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optik.distance import segment_box, segment_plane, segment_segment
from optik.types import Array
from tests.planners.contacts import COAL_ERROR, along, pose

EXACT = 1e-13  # some hundred roundings of coordinates of 1 m
RADIUS = 0.01


def triple(x: Array) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])


def least(f: Any) -> float:
    """Least value of a convex function on [0, 1] by ever finer grids, in long double."""
    low, high = np.longdouble(0), np.longdouble(1)
    for _ in range(14):
        s = np.linspace(low, high, 41)
        k = int(f(s).argmin())
        low, high = s[max(k - 1, 0)], s[min(k + 1, 40)]
    return float(f(np.array([low, 0.5 * (low + high), high])).min())


def to_box(a: Array, b: Array, T: Array, half: Array) -> float:
    a, d, p, R = (x.astype(np.longdouble) for x in (a, b - a, T[:3, 3], T[:3, :3]))
    out = lambda s: np.maximum(np.abs((a + np.multiply.outer(s, d) - p) @ R) - half, 0.0)  # noqa: E731
    return least(lambda s: np.sqrt((out(s) ** 2).sum(axis=-1)))


def to_segment(a: Array, b: Array, c: Array, d: Array) -> float:
    a, u, c, v = (x.astype(np.longdouble) for x in (a, b - a, c, d - c))
    square = v @ v

    def distance(s: Array) -> Array:
        off = a + np.multiply.outer(s, u) - c
        share = np.clip(off @ v / square, 0.0, 1.0) if square > 0.0 else np.zeros_like(s)
        return np.sqrt(((off - np.multiply.outer(share, v)) ** 2).sum(axis=-1))

    return least(distance)


def box(rng: np.random.Generator, k: int) -> tuple[Array, Array, Array, Array]:
    """A segment and a box, many of them in special positions: a point, along an edge, in a face's plane, inside."""
    a, b = rng.uniform(-1.0, 1.0, (2, 3))
    T = pose(rng.uniform(-1.0, 1.0, 3), Rotation.random(random_state=rng).as_matrix())
    half = rng.uniform(0.001, 0.5, 3)
    if k % 3 == 0:
        T[:3, :3] = np.eye(3)
    if k % 5 == 0:
        b[:2] = a[:2]
    if k % 7 == 0:
        a[2] = b[2] = T[2, 3] + half[2]
    if k % 11 == 0:
        b = a.copy()
    if k % 13 == 0:
        a = T[:3, 3] + 0.1 * half
    return a, b, T, half


def segments(rng: np.random.Generator, k: int) -> tuple[Array, Array, Array, Array]:
    """Two segments, many of them points, parallel, nearly parallel, or crossing."""
    a, b, c, d = rng.uniform(-1.0, 1.0, (4, 3))
    if k % 3 == 0:
        d = c + (b - a) * rng.uniform(-2.0, 2.0)
    if k % 5 == 0:
        d = c + (b - a) + 10.0 ** rng.uniform(-16.0, -3.0) * rng.normal(size=3)
    if k % 7 == 0:
        d = c.copy()
    if k % 11 == 0:
        b = a.copy()
    if k % 13 == 0:
        c, d = a + 0.3 * (b - a) - 0.1 * (d - c), a + 0.3 * (b - a) + 0.2 * (d - c)
    return a, b, c, d


def test_distances_to_boxes_and_segments_are_exact() -> None:
    rng = np.random.default_rng(0)
    for k in range(300):
        a, b, T, half = box(rng, k)
        distance, share, w = segment_box(triple(a), triple(b), T, half)
        assert distance == pytest.approx(to_box(a, b, T, half), rel=0, abs=EXACT), k
        assert 0.0 <= share <= 1.0
        assert np.linalg.norm(w) == pytest.approx(distance, rel=0, abs=EXACT)
        a, b, c, d = segments(rng, k)
        distance, share, w = segment_segment(triple(a), triple(b), triple(c), triple(d))
        assert distance == pytest.approx(to_segment(a, b, c, d), rel=0, abs=EXACT), k
        nearest = a + share * (b - a) - np.array(w)  # on the second segment
        assert to_segment(nearest, nearest, c, d) <= EXACT


@pytest.mark.parametrize("count", [800, pytest.param(20_000, marks=pytest.mark.soak)])
def test_distances_agree_with_coal(count: int) -> None:
    coal = pytest.importorskip("coal")
    rng = np.random.default_rng(1)
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def capsule(a: Array, b: Array) -> Any:
        shape = coal.Capsule(RADIUS, float(np.linalg.norm(b - a)))
        return shape, coal.Transform3s(along(b - a), 0.5 * (a + b))

    def found(one: Any, other: Any) -> float:
        result.clear()
        return float(coal.distance(*one, *other, request, result))

    for k in range(count):
        a, b, T, half = box(rng, k)
        distance = segment_box(triple(a), triple(b), T, half)[0] - RADIUS
        theirs = found(capsule(a, b), (coal.Box(*(2.0 * half)), coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy())))
        assert (abs(distance - theirs) <= COAL_ERROR) if distance > 0.0 else theirs <= COAL_ERROR, k
        a, b, c, d = segments(rng, k)
        distance = segment_segment(triple(a), triple(b), triple(c), triple(d))[0] - 2.0 * RADIUS
        theirs = found(capsule(a, b), capsule(c, d))
        assert (abs(distance - theirs) <= COAL_ERROR) if distance > 0.0 else theirs <= COAL_ERROR, k


def test_a_plane_counts_below_zero_behind_it() -> None:
    normal = np.array([0.0, 0.6, 0.8])
    point = np.array([5.0, 0.0, 1.0])
    for a, b in np.random.default_rng(2).uniform(-2.0, 2.0, (50, 2, 3)):
        distance, share, w = segment_plane(triple(a), triple(b), point, normal)
        ends = (np.array([a, b]) - point) @ normal
        assert distance == pytest.approx(ends.min(), rel=0, abs=EXACT)
        assert share == ends.argmin()
        np.testing.assert_allclose(w, distance * normal, rtol=0, atol=EXACT)
