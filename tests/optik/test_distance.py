from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

import optik
from optik.scene.distance import Hull, NearestPoint, find_hull, segment_box, segment_cylinder, segment_segment
from optik.types import Array
from tests.planners.contacts import COAL_ERROR, along, pose
from tests.seeds import shift_seed

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
        assert max(distance, 0.0) == pytest.approx(to_box(a, b, T, half), rel=0, abs=EXACT), k
        assert 0.0 <= share <= 1.0
        assert np.linalg.norm(w) == pytest.approx(abs(distance), rel=0, abs=EXACT)
        a, b, c, d = segments(rng, k)
        distance, share, w = segment_segment(triple(a), triple(b), triple(c), triple(d))
        assert distance == pytest.approx(to_segment(a, b, c, d), rel=0, abs=EXACT), k
        nearest = a + share * (b - a) - np.array(w)  # on the second segment
        assert to_segment(nearest, nearest, c, d) <= EXACT


def to_cylinder(a: Array, b: Array, T: Array, size: Array) -> float:
    a, d, p, R, size = (x.astype(np.longdouble) for x in (a, b - a, T[:3, 3], T[:3, :3], size))

    def distance(s: Array) -> Array:
        x = (a + np.multiply.outer(s, d) - p) @ R
        out = np.maximum(np.hypot(x[..., 0], x[..., 1]) - size[0], 0.0)
        return np.hypot(out, np.maximum(np.abs(x[..., 2]) - size[1], 0.0))

    return least(distance)


def sizes(half: Array) -> Array:
    """Radius and half length of a cylinder in a box."""
    return np.array([half[0], half[2]])


def test_distances_to_cylinders_are_exact() -> None:
    rng = np.random.default_rng(3)
    for k in range(600):
        a, b, T, half = box(rng, k)
        if k % 17 == 0:
            b = a + (T[:3, 2] if k % 2 else T[:3, 0]) * rng.normal()  # along the axis, or across
        distance, share, w = segment_cylinder(triple(a), triple(b), T, sizes(half))
        exact = to_cylinder(a, b, T, sizes(half))
        assert max(distance, 0.0) == pytest.approx(exact, rel=0, abs=1e-12), k
        if distance > 0.0:
            nearest = a + share * (b - a) - np.array(w)
            assert np.linalg.norm(w) == pytest.approx(distance, rel=0, abs=EXACT)
            assert to_cylinder(nearest, nearest, T, sizes(half)) <= EXACT


DIRECTIONS = np.random.default_rng(4).normal(size=(20_000, 3))
DIRECTIONS = np.vstack([DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None], np.eye(3), -np.eye(3)])


def least_translation(a: Array, b: Array, T: Array, reach: Any) -> float:
    """Least length of a translation that takes a segment out of a solid: by directions in its frame, ever finer."""
    a, b = (a - T[:3, 3]) @ T[:3, :3], (b - T[:3, 3]) @ T[:3, :3]
    n, rng, best = DIRECTIONS, np.random.default_rng(5), np.inf
    for level in range(8):
        depth = reach(n) - np.minimum(n @ a, n @ b)
        found, best = n[depth.argmin()], min(best, float(depth.min()))
        n = found + 0.03 * 0.2**level * rng.normal(size=(2000, 3))
        n /= np.linalg.norm(n, axis=1)[:, None]
    return best


def test_distances_to_slivers_are_exact_but_for_rounding_where_the_search_stalls() -> None:
    rng = np.random.default_rng(21)
    for _ in range(150):
        half = 10.0 ** rng.uniform(-6.0, 0.0, 3)
        T = pose(rng.normal(size=3), Rotation.random(random_state=rng).as_matrix())
        corners = np.array(list(product((-1.0, 1.0), repeat=3))) * half @ T[:3, :3].T + T[:3, 3]
        mesh = find_hull(corners)
        for _ in range(4):
            a = corners[rng.integers(8)] + rng.normal(size=3) * 10.0 ** rng.uniform(-7.0, -3.0)
            b = a + rng.normal(size=3) * 10.0 ** rng.uniform(-3.0, 0.5)
            exact = segment_box(triple(a), triple(b), T, half)[0]
            assert exact - 1e-8 <= to_mesh(a, b, mesh)[0] <= exact + optik.scene.distance.DISTANCE_ROUNDING


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_inside_a_solid_the_distance_is_minus_the_shortest_way_out(kind: str) -> None:
    rng, close = np.random.default_rng(shift_seed(6)), 0
    for k in range(60):
        _, _, T, half = box(rng, k)
        d = rng.normal(size=3) * 10.0 ** rng.uniform(-2.0, 0.0)
        if k % 4 == 0:
            d = T[:3, k % 3] * 0.3  # parallel to an edge or the axis
        x = T[:3, :3] @ (half * rng.uniform(-0.65, 0.65, 3)) + T[:3, 3]
        a, b = x - rng.random() * d, x + rng.random() * d
        size = sizes(half)
        if kind == "cylinder":
            x = T[:3, :3] @ (rng.uniform(-0.65, 0.65, 3) * (size[0], size[0], size[1])) + T[:3, 3]
            a, b = x - rng.random() * d, x + rng.random() * d

        def found(a: Array, b: Array, size: Array = size, T: Array = T, half: Array = half) -> NearestPoint:
            if kind == "box":
                return segment_box(triple(a), triple(b), T, half)
            return segment_cylinder(triple(a), triple(b), T, size)

        def reach(n: Array, size: Array = size, half: Array = half) -> Array:
            if kind == "box":
                return np.abs(n) @ half
            return size[0] * np.hypot(n[..., 0], n[..., 1]) + size[1] * np.abs(n[..., 2])

        distance, share, w = found(a, b)
        assert distance < 0.0 and 0.0 <= share <= 1.0
        other = least_translation(a, b, T, reach)
        assert -distance <= other + EXACT, "no direction is shorter"
        close += -distance >= other - 1e-6
        if k % 4 and kind == "box":  # else many points are equally deep
            assert to_box(*(a + share * (b - a) - w,) * 2, T, half) <= EXACT, "the deepest point leaves at the surface"
        way = np.array(w) / distance
        assert np.linalg.norm(way) == pytest.approx(1.0, abs=EXACT)
        for step, sign in ((1e-9, 1.0), (-1e-7, -1.0)):  # the translation takes the segment to the surface
            assert sign * found(a + (step - distance) * way, b + (step - distance) * way)[0] >= -EXACT
        gentle = 0.01 * rng.normal(size=(2, 3))
        change = found(a + gentle[0], b + gentle[1])[0] - distance
        assert abs(change) <= np.linalg.norm(gentle, axis=1).max() + EXACT
    assert close >= 40, "the directions find it too"


# ---------------------------------------------------------------- convex meshes


def to_hull(a: Array, b: Array, faces: Array) -> float:
    """Distance of a segment to the solid n·x ≤ c, by least-distance programming at points of the segment."""

    def distance(s: Array) -> Array:
        out = []
        for p in a + np.multiply.outer(np.asarray(s, float), b - a):  # least |y| with −n·y ≥ n·p − c: Lawson and Hanson
            E = np.vstack([-faces[:, :3].T, faces[:, :3] @ p - faces[:, 3]])
            y, _ = nnls(E, np.array([0.0, 0.0, 0.0, 1.0]))
            r = E @ y - (0.0, 0.0, 0.0, 1.0)
            out.append(np.linalg.norm(r[:3] / r[3]) if np.linalg.norm(r) > 1e-9 else 0.0)
        return np.array(out)

    return least(distance)


def hull(rng: np.random.Generator, k: int) -> Hull:
    """Hull of few or many points: anywhere, on a sphere, or of a prism with parallel faces."""
    points = rng.normal(size=(int(rng.integers(4, 40)), 3)) * rng.uniform(0.05, 0.3, 3)
    if k % 3 == 1:
        points /= 5.0 * np.linalg.norm(points, axis=1)[:, None]
    if k % 3 == 2:
        flat = points[:, :2]
        points = np.vstack([np.column_stack([flat, np.full(len(flat), z)]) for z in (-0.1, 0.1)])
    return find_hull(points)


def to_mesh(a: Array, b: Array, mesh: Hull) -> NearestPoint:
    return optik.scene.distance.segment_mesh(triple(a), triple(b), *mesh[:3])


def test_distances_to_meshes_are_those_of_a_convex_programme() -> None:
    rng = np.random.default_rng(7)
    for k in range(40):
        mesh, (a, b) = hull(rng, k), rng.uniform(-0.6, 0.6, (2, 3))
        if k % 4 == 0:
            b = a + np.cross(mesh.faces[0, :3], rng.normal(size=3))  # parallel to a face
        distance, share, w = to_mesh(a, b, mesh)
        assert max(distance, 0.0) == pytest.approx(to_hull(a, b, mesh.faces), rel=0, abs=1e-9), k
        if distance > 0.0:
            nearest = a + share * (b - a) - np.array(w)
            assert (mesh.faces[:, :3] @ nearest <= mesh.faces[:, 3] + 1e-12).all()
            assert np.linalg.norm(w) == pytest.approx(distance, rel=0, abs=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-12, 1e-9, 1e-6, 1e-3]))
def test_a_box_as_a_mesh_has_the_distances_of_the_box(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    a, b, T, half = box(rng, int(rng.integers(0, 1000)))
    if rng.random() < 0.3:  # touching a face, or nearly
        a[:] = T[:3, :3] @ (half * (1.0, *rng.uniform(-1.0, 1.0, 2)) + (off, 0.0, 0.0)) + T[:3, 3]
    corners = (np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half) @ T[:3, :3].T + T[:3, 3]
    one, other = to_mesh(a, b, find_hull(corners)), segment_box(triple(a), triple(b), T, half)
    assert one[0] == pytest.approx(other[0], rel=0, abs=2e-9 if abs(other[0]) < 1e-8 else 1e-11)
    if other[0] > 1e-3:
        np.testing.assert_allclose(one[2], other[2], rtol=0, atol=1e-9)


def test_a_turned_mesh_has_the_same_distances_and_no_motion_changes_them_by_more() -> None:
    rng = np.random.default_rng(8)
    for k in range(100):
        mesh, (a, b) = hull(rng, k), rng.uniform(-0.3, 0.3, (2, 3))
        R, p = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-1.0, 1.0, 3)
        distance = to_mesh(a, b, mesh)[0]
        turned = to_mesh(R @ a + p, R @ b + p, find_hull(mesh.corners @ R.T + p))[0]
        assert turned == pytest.approx(distance, rel=0, abs=1e-9)
        gentle = 0.01 * rng.normal(size=(2, 3))
        change = to_mesh(a + gentle[0], b + gentle[1], mesh)[0] - distance
        assert abs(change) <= np.linalg.norm(gentle, axis=1).max() + 1e-9
        if distance < 0.0:
            depth = -to_mesh(a, b, mesh)[0]
            n, corners = DIRECTIONS, mesh.corners
            assert depth <= ((n @ corners.T).max(axis=1) - np.minimum(n @ a, n @ b)).min() + EXACT
            _, share, w = to_mesh(a, b, mesh)
            way = np.array(w) / distance
            assert (corners @ way).max() - way @ (a + share * (b - a)) == pytest.approx(depth, rel=0, abs=1e-12)
            assert abs(to_mesh(a + (depth + 1e-8) * way, b + (depth + 1e-8) * way, mesh)[0] - 1e-8) <= 1e-9


def test_the_ridge_of_a_flat_roof_counts_inside() -> None:
    top = [(0.0, y, 0.2) for y in (-1.0, 1.0)]
    roof = find_hull(np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 0.196)] + top))
    depth, share, w = to_mesh(np.array([-0.05, -0.1, 0.15]), np.array([0.15, 0.1, 0.15]), roof)
    assert (depth, share) == pytest.approx((-0.05, 0.25), rel=0, abs=1e-12)
    assert w == pytest.approx((0.0, 0.0, -0.05), rel=0, abs=1e-12)


@pytest.mark.parametrize("count", [800, pytest.param(20_000, marks=pytest.mark.soak)])
def test_distances_agree_with_coal(count: int) -> None:
    coal = pytest.importorskip("coal")
    rng = np.random.default_rng(1)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = 1e-8  # the default stops 2.2e-6 m from a cylinder

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
        distance = segment_cylinder(triple(a), triple(b), T, sizes(half))[0] - RADIUS
        other = coal.Cylinder(half[0], 2.0 * half[2])
        theirs = found(capsule(a, b), (other, coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy())))
        assert (abs(distance - theirs) <= COAL_ERROR) if distance > 0.0 else theirs <= COAL_ERROR, k
        points, mesh = coal.StdVec_Vec3s(), hull(rng, k)
        points.extend(list(mesh.corners))
        theirs = found(capsule(a, b), (coal.Convex.convexHull(points, True, "Qt"), coal.Transform3s.Identity()))
        distance = to_mesh(a, b, mesh)[0] - RADIUS
        assert (abs(distance - theirs) <= COAL_ERROR) if distance > 0.0 else theirs <= COAL_ERROR, k
        a, b, c, d = segments(rng, k)
        distance = segment_segment(triple(a), triple(b), triple(c), triple(d))[0] - 2.0 * RADIUS
        theirs = found(capsule(a, b), capsule(c, d))
        assert (abs(distance - theirs) <= COAL_ERROR) if distance > 0.0 else theirs <= COAL_ERROR, k


def test_a_plane_counts_below_zero_behind_it() -> None:
    normal = np.array([0.0, 0.6, 0.8])
    point = np.array([5.0, 0.0, 1.0])
    for a, b in np.random.default_rng(2).uniform(-2.0, 2.0, (50, 2, 3)):
        distance, share, w = optik.scene.distance.segment_plane(triple(a), triple(b), point, normal)
        ends = (np.array([a, b]) - point) @ normal
        assert distance == pytest.approx(ends.min(), rel=0, abs=EXACT)
        assert share == ends.argmin()
        np.testing.assert_allclose(w, distance * normal, rtol=0, atol=EXACT)
