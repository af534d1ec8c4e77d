"""Hulls of the parts of a mesh: they contain it, their distances are those of other ways to compute them, and they decide."""

import itertools
import pickle
import struct
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

import optik
from optik import Scene, se3
from optik.arm.shapes.enclosure import CORNERS, FACES, Hull
from optik.arm.shapes.hulls import enclose_body, list_hulls, nearest_hulls, pack_hulls, round_hull
from optik.errors import EnclosureWarning, InvalidInput
from optik.scene.contact import advise_contact, find_contact, find_nearest_pairs
from optik.types import Array

KINDS = np.zeros(7, np.int64)


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Array:
    """Triangles of a box between two corners."""
    corners = np.array(low) + (CORNERS + 0.5) * (np.array(high) - low)
    return np.array([corners[list(part)] for a, b, c, d in FACES for part in ((a, b, c), (a, c, d))])


def fork(width: float = 0.1, gap: float = 0.06, length: float = 0.2) -> Array:
    """A bridge with two prongs along x; its hull is a box."""
    bridge = box((0.0, -width, -0.04), (0.05, width, 0.04))
    prongs = [box((0.04, y, -0.04), (length, y + width - gap, 0.04)) for y in (-width, gap)]
    return np.concatenate([bridge, *prongs])


def write_stl(file: Path, triangles: Array) -> str:
    rows = b"".join(struct.pack("<12fH", *np.zeros(3), *t.ravel(), 0) for t in triangles)
    file.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + rows)
    return file.name


def wrist(folder: Path, turning: str = "") -> str:
    """A spherical wrist: a forearm whose fork holds a ball joint, and a flange that turns between the prongs."""
    meshes = {
        "base": box((-0.1, -0.1, 0.0), (0.1, 0.1, 0.2)),
        "arm": fork(),
        "ball": box((-0.02, -0.03, -0.02), (0.03, 0.03, 0.02)),
        "flange": box((0.03, -0.045, -0.045), (0.08, 0.045, 0.045))
        if not turning
        else box((-0.02, -0.08, -0.08), (0.02, 0.08, 0.08)),
    }
    links = "".join(
        f'<link name="{name}"><collision><geometry><mesh filename="{write_stl(folder / (name + ".stl"), mesh)}"/></geometry>'
        "</collision></link>"
        for name, mesh in meshes.items()
    )
    joints = "".join(
        f'<joint name="{child}_joint" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="2" effort="9"/></joint>'
        for parent, child, place, axis in (
            ("base", "arm", "0 0 .3", "0 0 1"),
            ("arm", "ball", ".15 0 0", "0 1 0"),
            ("ball", "flange", "0 0 0", "1 0 0"),
        )
    )
    (folder / "wrist.urdf").write_text(f"<robot name='wrist'>{links}{joints}</robot>", encoding="utf-8")
    return f"{folder}/wrist.urdf"


def load(folder: Path, turning: str = "") -> optik.Robot:
    return optik.Robot.from_urdf(wrist(folder, turning), "flange", shapes=True)


# ---------------------------------------------------------------- distances
def least_distance(a: Array, b: Array) -> float:
    """The distance of two hulls as a problem of least squares with weights ≥ 0 that sum to 1."""
    rows = np.vstack([np.hstack([a.T, -b.T]), 1e3 * np.repeat(np.eye(2), [len(a), len(b)], axis=1)])
    x = nnls(rows, np.array([0.0, 0.0, 0.0, 1e3, 1e3]), maxiter=10_000)[0]
    u, v = x[: len(a)], x[len(a) :]
    return float(np.linalg.norm(a.T @ (u / u.sum()) - b.T @ (v / v.sum())))


@pytest.mark.parametrize("kind", ["any", "points", "segments", "flat", "grid", "near"])
def test_distances_of_hulls_are_those_of_least_squares_and_never_larger(kind: str) -> None:
    rng = np.random.default_rng(len(kind))
    for _ in range(60):
        a, b = (rng.normal(size=(rng.integers(1, 60), 3)) * rng.uniform(0.01, 0.3, 3) for _ in range(2))
        if kind == "points":
            a = a[:1]
        elif kind == "segments":
            a, b = a[:2], b[:2]
        elif kind == "flat":
            a[:, 2], b[:, 1] = 0.0, 0.0
        elif kind == "grid":
            a, b = a.round(1), b.round(1)
        T = se3.pose(se3.exp_so3(rng.normal(size=3)), rng.normal(size=3) * (0.1 if kind == "near" else 0.6))
        frame = np.stack([np.eye(4), T])
        hulls = pack_hulls([(0, list_hulls([Hull(a, 0.0)])), (2, list_hulls([Hull(b, 0.0)]))], KINDS)
        found, normal, point = nearest_hulls(1, 0, hulls, frame, np.inf, np.full((2, 4), -1.0))
        moved = b @ T[:3, :3].T + T[:3, 3]
        least = least_distance(moved, a)
        assert least - 2e-7 <= max(found, 0.0) <= least + 1e-12
        if found > 1e-6:  # the normal separates both, and the point belongs to the first
            assert (moved @ normal).min() - (a @ normal).max() >= found - 1e-12
            assert least_distance(moved, np.array([point])) < 1e-7
        rounded = pack_hulls([(0, list_hulls([Hull(a, 0.01)])), (2, list_hulls([Hull(b, 0.02)]))], KINDS)
        assert nearest_hulls(1, 0, rounded, frame, np.inf, np.full((2, 4), -1.0))[0] <= max(least - 0.03 + 1e-12, 0.0)


def test_a_search_may_begin_with_the_corners_of_another_configuration_and_end_at_the_least_that_counts() -> None:
    rng = np.random.default_rng(8)
    bodies = [[rng.normal(size=(30, 3)) * 0.05 + rng.normal(size=3) * 0.1 for _ in range(4)] for _ in range(2)]
    packed = [list_hulls([Hull(a, 0.001 * k) for k, a in enumerate(of)]) for of in bodies]
    hulls, seed, ends, seen = pack_hulls(list(zip((0, 2), packed, strict=True)), KINDS), np.full((2, 4), -1.0), set(), 0
    for k in range(300):
        T = se3.pose(
            se3.exp_so3(0.02 * k * np.array([0.3, -0.5, 0.8])), (0.45 + 0.2 * np.sin(0.05 * k), 0.1 - 0.001 * k, 0.0)
        )
        frame = np.stack([np.eye(4), T])
        found = nearest_hulls(1, 0, hulls, frame, np.inf, seed)[0]
        alone = nearest_hulls(1, 0, hulls, frame, np.inf, np.full((2, 4), -1.0))[0]
        assert max(found, 0.0) == pytest.approx(max(alone, 0.0), abs=2e-7)
        if k % 30 == 0:
            moved = [b @ T[:3, :3].T + T[:3, 3] for b in bodies[1]]
            rows = [
                (least_distance(b, a), 0.001 * (i + j)) for i, b in enumerate(moved) for j, a in enumerate(bodies[0])
            ]
            least = min(distance - radius for distance, radius in rows)
            assert max(least, 0.0) - 2e-7 <= max(found, 0.0) <= max(least, 0.0) + 1e-12
        capped = nearest_hulls(1, 0, hulls, frame, 0.05, seed.copy())[0]
        assert capped <= found + 2e-7 and (capped == 0.05 or capped == pytest.approx(found, abs=2e-7) or capped <= 0.0)
        seen, ends = seen + (found > 0.0), ends | {seed[0, 0]}
    assert seen > 100 and len(ends) > 2


def test_corners_that_decided_turned_cubes_begin_the_search_of_parallel_ones() -> None:
    cube, rng, axes = np.array(list(itertools.product((-0.1, 0.1), repeat=3))), np.random.default_rng(5), np.eye(4)
    hulls = pack_hulls([(0, list_hulls([Hull(cube, 0.0)])), (2, list_hulls([Hull(cube, 0.0)]))], KINDS)
    for _ in range(2000):
        seed, away = np.full((2, 4), -1.0), rng.uniform(-0.3, 0.3, 3)
        turned = se3.pose(se3.exp_so3(rng.uniform(0.02, 0.3) * rng.normal(size=3)), away)
        nearest_hulls(1, 0, hulls, np.stack([axes, turned]), np.inf, seed)
        found = nearest_hulls(1, 0, hulls, np.stack([axes, se3.pose(p=away)]), np.inf, seed)[0]
        apart = float(np.linalg.norm(np.maximum(np.abs(away) - 0.2, 0.0)))  # of parallel cubes
        assert max(found, 0.0) == pytest.approx(apart, abs=2e-7)


# ---------------------------------------------------------------- hulls of a body
def test_hulls_contain_the_solid_between_cuts_and_leave_the_gap_of_a_fork_free() -> None:
    capsules = enclose_body(fork())
    hulls, rng = [hull for c in capsules for hull in c.hulls], np.random.default_rng(0)
    inside = np.concatenate([
        rng.uniform((0.0, -0.1, -0.04), (0.05, 0.1, 0.04), (200, 3)),
        rng.uniform((0.04, 0.06, -0.04), (0.2, 0.1, 0.04), (200, 3)),
    ])  # fmt: skip
    between = rng.uniform((0.06, -0.05, -0.03), (0.19, 0.05, 0.03), (50, 3))
    for points, is_inside in ((inside, True), (between, False)):
        away = [min(least_distance(np.array([x]), hull.corners) - hull.radius for hull in hulls) for x in points]
        assert (np.array(away) <= 1e-9).all() if is_inside else (np.array(away) > 1e-3).all()
    assert max(hull.excess for hull in hulls) < 0.02 < max(c.excess for c in capsules)


def test_a_step_that_is_small_in_a_large_body_is_cut_away() -> None:
    """The hull of both boxes is larger by 0.5 %, but this is 0.13 litres, and 21 mm deep."""
    body = np.concatenate([box((0.0, 0.0, 0.0), (0.3, 0.3, 0.27)), box((0.0, 0.0, 0.27), (0.3, 0.27, 0.3))])
    assert max(hull.excess for c in enclose_body(body) for hull in c.hulls) < 0.015


def test_a_ball_of_many_cuts_is_covered_in_its_middle() -> None:
    """Three cuts along different axes meet inside of a solid, where its surface has no point."""
    rng = np.random.default_rng(1)
    towers = [box((x, y, z), (x + 0.3, y + 0.3, z + 0.3)) for x, y, z in 0.31 * np.argwhere(np.ones((2, 2, 2)))]
    towers += [
        box((0.0, 0.0, 0.0), (0.6, 0.6, 0.6)),
        box((0.6, 0.2, 0.2), (1.4, 0.3, 0.3)),
        box((0.2, 0.6, 0.2), (0.3, 1.4, 0.3)),
    ]
    hulls = [hull for c in enclose_body(np.concatenate(towers)) for hull in c.hulls]
    for x in rng.uniform(0.02, 0.58, (100, 3)):
        assert min(least_distance(x[None], hull.corners) - hull.radius for hull in hulls) <= 1e-9


def test_a_rounded_hull_of_few_corners_contains_all_points() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(600, 3))
    points *= 0.2 / np.linalg.norm(points, axis=1)[:, None]
    hull = round_hull(points)
    assert len(hull.corners) <= 96 and 0.0 < hull.radius < 0.01
    assert max(least_distance(x[None], hull.corners) for x in points) <= hull.radius


def test_hulls_outside_of_their_capsule_or_of_another_number_are_refused() -> None:
    capsule = [(0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0), 0.05)]
    inside = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.04]])
    for hulls in (
        [],
        [[(inside, 0.0)], []],
        [[(inside + 0.1, 0.0)]],
        [[(inside, -1.0)]],
        [[inside]],
        [[(inside * np.nan, 0.0)]],
    ):
        if hulls:
            with pytest.raises(InvalidInput, match="hulls"):
                optik.Shapes(capsule, hulls=hulls)
    shapes = optik.Shapes(capsule, ("a",), hulls=[[(inside, 0.0)]])
    assert shapes != optik.Shapes(capsule, ("a",))
    more = shapes.with_part("b", 1, [((0.0, 0.0, 0.0), 0.1)])
    assert [len(of) for of in more.hulls] == [1, 0] and more.without_part("b") == shapes
    T = se3.pose(se3.exp_so3(np.array([0.0, 0.0, 1.0])), (0.1, 0.2, 0.3))
    moved = shapes.transform_part("a", T).hulls[0][0].corners
    np.testing.assert_allclose(moved, inside @ T[:3, :3].T + T[:3, 3], atol=1e-15)


# ---------------------------------------------------------------- arms
def test_a_wrist_whose_capsules_touch_is_free_by_its_meshes(tmp_path: Path) -> None:
    coal = pytest.importorskip("coal")
    with warnings.catch_warnings():
        warnings.simplefilter("error", EnclosureWarning)
        robot = load(tmp_path)
    assert optik.Robot.from_dict(robot.to_dict()) == robot == pickle.loads(pickle.dumps(robot))
    assert "flange" in str(robot) and "(hulls " in str(robot)
    q = robot.limits.sample(np.random.default_rng(0), 300)
    room = find_nearest_pairs(robot, Scene(), q)[0]
    capsules = robot.with_shapes(optik.Shapes(robot.shapes.capsules, robot.shapes.names))
    assert (find_nearest_pairs(capsules, Scene(), q)[0] <= 0.0).all()
    mesh = {
        "arm": fork(),
        "flange": box((0.03, -0.045, -0.045), (0.08, 0.045, 0.045)),
        "base": box((-0.1, -0.1, 0.0), (0.1, 0.1, 0.2)),
    }
    solid = {}
    for name, triangles in mesh.items():
        points, body = triangles.reshape(-1, 3), coal.BVHModelOBBRSS()
        body.beginModel(len(triangles), len(points))
        vertices, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for x in points:
            vertices.append(x)
        for k in range(len(triangles)):
            faces.append(coal.Triangle(3 * k, 3 * k + 1, 3 * k + 2))
        body.addSubModel(vertices, faces)
        body.endModel()
        solid[name] = body
    free = np.empty(len(q), np.bool_)
    for k, (frames, tool) in enumerate(zip(robot.frames(q), robot.fk(q), strict=True)):
        place = [coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy()) for T in (np.eye(4), frames[0], tool)]
        pairs = (
            (solid["arm"], place[1], solid["flange"], place[2]),
            (solid["base"], place[0], solid["flange"], place[2]),
        )
        free[k] = not any(coal.collide(*pair, coal.CollisionRequest(), coal.CollisionResult()) for pair in pairs)
    assert not ((room > 0.0) & ~free).any() and 0.1 < free.mean() < 1.0
    assert ((room > 0.0) & free).sum() >= 0.95 * free.sum()
    near = find_contact(robot, Scene(), q[room <= 0.0][0])
    advice = advise_contact(robot, Scene(), near.pair, "another start")
    assert advice.startswith("another start") and "with_apart" in advice
    always = advise_contact(capsules, Scene(), ("flange", "arm"), "another start")
    assert "another" not in always and "'flange', 'arm'" in always and "each of" in always


def test_meshes_that_are_always_in_contact_are_left_out_and_said(tmp_path: Path) -> None:
    with pytest.warns(EnclosureWarning, match=r"each of 10,000 sampled") as caught:
        robot = load(tmp_path, "turning")
    assert any(w.message.pairs == (("arm", "flange"),) for w in caught if isinstance(w.message, EnclosureWarning))
    assert ("arm", "flange") in [pair[:2] for pair in robot.shapes.left_out]
    assert "10,000" in robot.shapes.left_out[-1][2]


TILTED = se3.exp_so3(np.array([0.3, 0.2, 0.1]))
OBSTACLES = {
    "box": lambda x, _: Scene(boxes=[(se3.pose(TILTED, x), (0.03, 0.06, 0.03))]),
    "sphere": lambda x, _: Scene(spheres=[(x, 0.03)]),
    "capsule": lambda x, n: Scene(capsules=[(x, x + 0.1 * n, 0.03)]),
    "plane": lambda x, n: Scene(planes=[(x, -n)]),
    "cylinder": lambda x, n: Scene(cylinders=[(x, x + 0.1 * n, 0.03)]),
    "mesh": lambda x, _: Scene(meshes=[x + 0.03 * CORNERS]),
    "cloud": lambda x, _: Scene(clouds=[(x + 0.01 * np.random.default_rng(0).normal(size=(300, 3)), 0.01)]),
}
"""An object of each kind at a point, and in a direction."""


@pytest.mark.parametrize("kind", OBSTACLES)
def test_an_object_in_a_capsule_but_beside_the_mesh_is_free(kind: str, tmp_path: Path) -> None:
    robot = load(tmp_path)
    q = np.array([0.3, 0.0, 0.0])
    corners = box((0.03, -0.045, -0.045), (0.08, 0.045, 0.045)).reshape(-1, 3)
    T = robot.fk(q)
    tip = T[:3, :3] @ (0.08, 0.0, 0.0) + T[:3, 3]
    ahead = T[:3, :3] @ (1.0, 0.0, 0.0)
    capsules = robot.with_shapes(optik.Shapes(robot.shapes.capsules, robot.shapes.names, robot.shapes.apart))
    apart, freed = [(link, f"{kind}1") for link in ("arm", "ball")], 0
    world = corners @ T[:3, :3].T + T[:3, 3]
    for away in np.linspace(0.0, 0.2, 41):
        x = tip + away * ahead
        scene = replace(OBSTACLES[kind](x, ahead), allow=apart)
        fine, rough = (find_contact(arm, scene, q) for arm in (robot, capsules))
        freed += fine.room > 0.0 >= rough.room
        assert fine.room >= rough.room
        if kind in ("sphere", "plane") and f"{kind}1" in fine.pair and fine.room > 0.0:
            plane, sphere = ((x - world) @ ahead).min(), least_distance(world, x[None]) - 0.03
            assert fine.room <= {"plane": plane, "sphere": sphere}[kind] + 1e-8
        assert fine.room <= 1e-8 or away > 0.0
    assert freed > 0
