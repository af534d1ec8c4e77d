"""Meshes and URDF shapes: read as trimesh reads them, enclosed whole, with an excess that is a bound."""

import pickle
import re
import struct
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import optik
import planners
from optik import se3
from optik.arm.shapes import enclosure
from optik.arm.shapes.enclosure import SPACING, Capsule, bound_excess, box_triangles, enclose_mesh, sample_points
from optik.arm.shapes.urdf import MeshFolders, read_mesh
from optik.errors import InvalidInput, RobotModelError, UnreadShapeWarning
from tests.oracles.shapes import distances

RNG = np.random.default_rng(3)


def bars():
    """Two bars that meet at a right angle."""
    two = [trimesh.creation.box((0.4, 0.06, 0.06)), trimesh.creation.box((0.06, 0.06, 0.3))]
    two[1].apply_translation((0.17, 0.0, 0.12))
    return two


def bent():
    """A solid that one capsule encloses badly."""
    return trimesh.util.concatenate(bars())


def inside(points, capsules):
    """How far the farthest point is outside all capsules; negative inside."""
    return np.min([distances(points, c.a, c.b, c.radius) for c in capsules], axis=0).max()


def surface(capsule, s, phi):
    """Points of a capsule by the length along its meridian and the angle, from its definition."""
    axis = capsule.b - capsule.a
    length, cap = np.linalg.norm(axis), 0.5 * np.pi * capsule.radius
    u = axis / length
    v = np.cross(u, (0.3, -0.5, 0.8))
    v /= np.linalg.norm(v)
    bend = np.where(s < cap, s, np.where(s > cap + length, s - length, cap)) / capsule.radius
    along = np.clip(s - cap, 0.0, length) - capsule.radius * np.cos(bend)
    around = np.cos(phi)[:, None] * v + np.sin(phi)[:, None] * np.cross(u, v)
    return capsule.a + along[:, None] * u + (capsule.radius * np.sin(bend))[:, None] * around


def farthest(capsule, tree, rng):
    """The largest distance of a capsule's surface from points: on a dense grid, refined around its best points."""
    end = np.linalg.norm(capsule.b - capsule.a) + np.pi * capsule.radius
    s, phi = (x.ravel() for x in np.meshgrid(np.linspace(0.0, end, 120), np.linspace(0.0, 2.0 * np.pi, 120)))
    ds, dphi = end / 120, 2.0 * np.pi / 120
    for _ in range(12):
        best = np.argsort(tree.query(surface(capsule, s, phi))[0])[-20:]
        s = np.append(np.clip(s[best, None] + ds * rng.uniform(-1.0, 1.0, (20, 60)), 0.0, end), s[best])
        phi = np.append(phi[best, None] + dphi * rng.uniform(-1.0, 1.0, (20, 60)), phi[best])
        ds, dphi = 0.6 * ds, 0.6 * dphi
    return tree.query(surface(capsule, s, phi))[0].max()


@pytest.mark.parametrize("seed", range(4))
def test_the_excess_of_a_capsule_is_the_farthest_of_its_surface_from_points_anywhere(seed):
    """The points lie to one side of the axis."""
    rng = np.random.default_rng(seed)
    capsule = Capsule(*rng.normal(size=(2, 3)), rng.uniform(0.2, 0.6))
    tree = cKDTree(capsule.a + rng.uniform(0.0, 1.0, (9, 1)) * (capsule.b - capsule.a) + 0.2 * rng.normal(size=(9, 3)))
    true = farthest(capsule, tree, rng)
    assert true <= bound_excess(capsule, [], tree) <= 1.01 * true


@pytest.mark.parametrize("seed", range(2))
def test_a_peak_of_the_distance_is_bounded_to_a_millimetre(seed):
    """The farthest place is equally far from three of a hundred points on the surface: the distance falls on all sides."""
    rng = np.random.default_rng(seed)
    capsule = Capsule(*rng.normal(size=(2, 3)), rng.uniform(0.2, 0.6))
    end = np.linalg.norm(capsule.b - capsule.a) + np.pi * capsule.radius
    tree = cKDTree(surface(capsule, rng.uniform(0.0, end, 100), rng.uniform(0.0, 2.0 * np.pi, 100)))
    true = farthest(capsule, tree, rng)
    assert true <= bound_excess(capsule, [], tree) <= true + 1e-3


# ---------------------------------------------------------------- files
@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj"])
def test_meshes_are_read_as_trimesh_reads_them(tmp_path, kind):
    mesh = bent()
    file = tmp_path / f"part.{kind.partition('_')[0]}"
    mesh.export(file, file_type=kind)
    assert (
        np.abs(np.sort(read_mesh(file).reshape(-1, 9), axis=0) - np.sort(mesh.triangles.reshape(-1, 9), axis=0)).max()
        <= 1e-7
    )


def test_faces_of_an_obj_may_be_polygons_with_textures_and_indices_from_the_end(tmp_path):
    file = tmp_path / "square.obj"
    file.write_text(
        "# a square\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1/1 3//1 -1\n", encoding="utf-8"
    )
    assert read_mesh(file).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


def binary(count, corners=(0.0, 0.0, 0.0)):
    return (
        b"solid like text".ljust(80)
        + struct.pack("<I", count)
        + (struct.pack("<12f", *(0.0,) * 3, *corners * 3) + b"\0\0")
    )


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.stl", b"", "bytes"),
        ("a.stl", b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nendloop\nendfacet\nendsolid", "1 corners"),
        ("a.stl", b"solid x\nfacet\nvertex 0 0 0 vertex 1 0 0 vertex 0 one 0\nendfacet", "numbers"),
        ("a.stl", binary(3), "bytes"),  # says three triangles and has one
        ("a.stl", binary(2**32 - 1), "bytes"),
        ("a.stl", binary(1, (np.nan, 0.0, 0.0)), "NaN"),
        ("a.stl", binary(0)[:84], "0 triangles"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "0 triangles"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "defined before"),
        ("a.obj", b"v 0 0 0\nf 1 1 -9\n", "defined before"),
        ("a.obj", b"v 0 0\n", "three coordinates"),
        ("a.obj", b"v 0 0 x\nf 1 1 1\n", "numbers"),
        ("a.obj", b"v 0 0 inf\nf 1 1 1\n", "finite"),
        ("a.obj", b"v 0 0 0\nf a b c\n", "numbers of corners"),
    ],
)
def test_a_bad_mesh_is_one_clear_line(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=words) as caught:
        read_mesh(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_large_mesh_is_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr("optik.arm.shapes.urdf.MOST_MESH_BYTES", 100)
    (tmp_path / "a.stl").write_bytes(binary(1))
    with pytest.raises(InvalidInput, match="MB"):
        read_mesh(tmp_path / "a.stl")


def test_meshes_are_found_below_their_folders_only(tmp_path):
    here, package = tmp_path / "here", tmp_path / "packages" / "arm"
    for folder in (here / "meshes", package):
        folder.mkdir(parents=True)
        (folder / "a.stl").write_bytes(binary(1))
    (tmp_path / "secret.stl").write_bytes(binary(1))
    (here / "link.stl").symlink_to(tmp_path / "secret.stl")
    folders = MeshFolders(here, [tmp_path / "packages"])
    assert folders.file("meshes/a.stl", "x") == (here / "meshes/a.stl").resolve()
    assert folders.file("package://arm/a.stl", "x") == (package / "a.stl").resolve()
    assert folders.file((here / "meshes/a.stl").as_uri(), "x") == (here / "meshes/a.stl").resolve()
    assert MeshFolders(None, {"arm": package}).file("package://arm/a.stl", "x") == (package / "a.stl").resolve()
    assert MeshFolders(None, [package]).file("package://arm/a.stl", "x") == (package / "a.stl").resolve()
    for name in ("../secret.stl", str(tmp_path / "secret.stl"), "link.stl", "package://arm/../../secret.stl"):
        with pytest.raises(InvalidInput, match="elsewhere"):
            folders.file(name, "x")
    with pytest.raises(InvalidInput, match="elsewhere"):
        folders.file("file://" + str(tmp_path / "%2e" / "secret.stl"), "x")
    for name, words in (
        ("http://x.org/a.stl", "URL"),
        ("ftp://x.org/a.stl", "URL"),
        ("meshes/a.dae", "existing mesh"),
        ("meshes/a.ply", "STL, OBJ or COLLADA"),
        ("meshes/b.stl", "existing mesh"),
        ("package://hand/a.stl", "package_dirs|existing mesh"),
        ("meshes/a\0.stl", "name of a file"),
        ("", "STL, OBJ or COLLADA"),
    ):
        with pytest.raises(InvalidInput, match=words):
            folders.file(name, "x")
    for bad in (tmp_path / "none",):
        with pytest.raises(InvalidInput, match="package_dirs"):
            MeshFolders(None, [bad])
    with pytest.raises(InvalidInput, match="package_dirs"):
        MeshFolders(None, "packages")


def test_a_package_is_found_above_the_file_and_beside_the_folders_above_it(tmp_path):
    here = tmp_path / "ws" / "arm_support" / "urdf" / "deep"
    for place in (here / "urdf", tmp_path / "ws" / "arm_support", tmp_path / "ws" / "parts", tmp_path / "parts"):
        place.mkdir(parents=True, exist_ok=True)
        (place / "a.stl").write_bytes(binary(1))
    (here.parent / "above.stl").write_bytes(binary(1))
    folders, ws = MeshFolders(here), tmp_path.resolve() / "ws"
    assert folders.file("package://arm_support/a.stl", "x") == ws / "arm_support" / "a.stl"
    assert folders.file("model://parts/a.stl", "x") == ws / "parts" / "a.stl", "the nearest"
    named = MeshFolders(here, {"parts": tmp_path / "parts"})
    assert named.file("package://parts/a.stl", "x") == tmp_path.resolve() / "parts" / "a.stl", "a named one first"
    (ws / "package.xml").write_text("<package><name> fine_arm </name></package>")
    for each in (MeshFolders(here), MeshFolders(None, [ws])):
        assert each.file("package://fine_arm/parts/a.stl", "x") == ws / "parts" / "a.stl", "named in its file"
    for name in ("../../../parts/a.stl", str(tmp_path / "ws" / "parts" / "a.stl")):
        assert MeshFolders(here).file(name, "x") == ws / "parts" / "a.stl", "in the package of the file"
    with pytest.raises(InvalidInput, match="elsewhere"):
        MeshFolders(here).file(str(tmp_path / "parts" / "a.stl"), "x")
    for name, words in (
        ("package://parts/../arm_support/a.stl", "elsewhere"),
        ("package://../above.stl", "existing mesh.*package_dirs"),
        ("package:///a.stl", "existing mesh"),
        ("package://none/a.stl", "existing mesh.*package_dirs"),
    ):
        with pytest.raises(InvalidInput, match=words):
            folders.file(name, "x")


COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="cm" meter="0.01"/><up_axis>Y_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="f" count="12">0 0 0 9 0 0 0 7 0 0 0 5</float_array><technique_common>
<accessor source="#f" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node><translate>1 2 3</translate>
<rotate>0 0 1 90</rotate><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_collada_is_read_as_assimp_reads_it_in_metres(tmp_path):
    coal = pytest.importorskip("coal")
    file = tmp_path / "a.dae"
    file.write_text(COLLADA)
    found = read_mesh(file)
    other = coal.MeshLoader().load(str(file), np.full(3, 0.01))  # it leaves out the unit
    wanted = np.array([other.vertices(i) for i in range(other.num_vertices)])
    assert found.shape == (4, 3, 3)
    for point in wanted:
        assert np.abs(found.reshape(-1, 3) - point).max(axis=1).min() < 1e-7
    assert np.ptp(found.reshape(-1, 3), axis=0) == pytest.approx((0.07, 0.09, 0.05), abs=1e-7)


def test_collada_with_parts_that_cannot_be_read_and_without_its_packages_is_refused(tmp_path, monkeypatch):
    file = tmp_path / "a.dae"
    for text in (
        COLLADA.replace("#p", "#none"),
        COLLADA.replace("<instance_geometry", '<instance_geometry url="#none"/><instance_geometry', 1),
        COLLADA[:400],
        COLLADA.replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "c">]><COLLADA', 1),
        COLLADA.replace('meter="0.01"', 'meter="inf"'),
        "PK",
    ):
        file.write_text(text)
        with pytest.raises(InvalidInput):
            read_mesh(file)
    monkeypatch.setattr("optik.arm.shapes.urdf.find_spec", lambda name: None)
    with pytest.raises(InvalidInput, match=r"trimesh and pycollada: pip install 'optik-toolkit\[meshes\]'"):
        read_mesh(file)


# ---------------------------------------------------------------- enclosure
SOLIDS = {
    "bent": bars(),
    "ball": [trimesh.creation.icosphere(1, 0.1)],
    "bar": [trimesh.creation.cylinder(0.02, 0.3, sections=9)],
}
"""Solids as unions of convex ones."""


@cache
def enclosed(name):
    return enclose_mesh(np.asarray(trimesh.util.concatenate(SOLIDS[name]).triangles))


@pytest.mark.parametrize("name", SOLIDS)
def test_the_solid_is_inside_and_no_point_of_the_surface_stands_out_farther_than_stated(name):
    convex, capsules = SOLIDS[name], enclosed(name)
    mesh = trimesh.util.concatenate(convex)
    assert inside(np.asarray(mesh.triangles).reshape(-1, 3), capsules) <= 0.0
    for part in convex:  # any mean of its corners is in the solid
        weights = RNG.dirichlet(np.full(len(part.vertices), 0.3), 300)
        assert inside(weights @ part.vertices, capsules) <= 0.0
    for k, c in enumerate(capsules):
        solid = trimesh.creation.capsule(np.linalg.norm(c.b - c.a), c.radius, count=[16, 16])
        solid.apply_transform(trimesh.geometry.align_vectors((0, 0, 1), c.b - c.a) if (c.b != c.a).any() else np.eye(4))
        middle = solid.bounds.mean(axis=0)
        surface = solid.vertices - middle + 0.5 * (c.a + c.b)
        others = capsules[:k] + capsules[k + 1 :]
        surface = surface[[not others or inside(p[None], others) > 1e-6 for p in surface]]
        if len(surface):
            true = trimesh.proximity.closest_point_naive(mesh, surface)[1].max()
            assert true <= c.excess + 1e-9
            assert c.excess <= 1.25 * true + 0.01  # of use: not much above what samples show


def test_a_bad_fit_is_cut_and_the_cut_has_less_excess():
    one, several = enclose_mesh(np.asarray(bent().triangles), 1), enclosed("bent")
    assert (len(one), 2 <= len(several) <= 3) == (1, True)
    assert max(c.excess for c in several) < 0.6 * one[0].excess


@pytest.mark.parametrize("far", [0.0, 5.0])
def test_points_on_a_mesh_are_as_dense_as_its_size_asks(far):
    rng, edges = np.random.default_rng(4), np.array([0.4, 0.2, 0.1])
    triangles = np.add(box_triangles(edges), [far, 0.0, 0.0])
    size = np.ptp(triangles.reshape(-1, 3), axis=0).max()
    tree, corner = sample_points(triangles), rng.dirichlet(np.ones(3), 4000)
    points = np.einsum("ke,ked->kd", corner, triangles[rng.integers(len(triangles), size=4000)])
    assert tree.query(points)[0].max() <= size / SPACING
    assert tree.n <= 60_000, "and not much denser"


@pytest.mark.parametrize("seed", range(3))
def test_a_capsule_is_its_own_enclosure(seed):
    rng = np.random.default_rng(seed)
    length, radius = rng.uniform(0.3, 0.8), rng.uniform(0.05, 0.2)
    solid = trimesh.creation.capsule(height=length, radius=radius, count=[32, 32])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-1.0, 1.0, 3)
    solid.apply_transform(T)
    found = enclosure.fit_capsule(np.array(solid.triangles))
    assert found.radius == pytest.approx(radius, rel=0.01)
    assert np.linalg.norm(found.b - found.a) == pytest.approx(length, abs=0.02 * length)
    assert 0.5 * (found.a + found.b) == pytest.approx(solid.bounds.mean(axis=0), abs=0.01)


def test_cutting_keeps_the_surface():
    triangles = RNG.normal(size=(200, 3, 3))
    area = trimesh.triangles.area(triangles).sum()
    for _ in range(5):
        normal = RNG.normal(size=3)
        offset = float(RNG.normal() * 0.5)
        below, above = enclosure.split_mesh(triangles, normal, offset)
        assert abs(trimesh.triangles.area(below).sum() + trimesh.triangles.area(above).sum() - area) <= 1e-9 * area
        assert (below @ normal).max() <= offset + 1e-9
        assert (above @ normal).min() >= offset - 1e-9


@pytest.mark.parametrize(("radius", "length"), [(0.05, 0.4), (0.1, 0.02), (0.03, 0.06)])
def test_a_cylinder_is_inside_its_capsule(radius, length):
    c = enclosure.enclose_cylinder(radius, length)
    turn = RNG.uniform(0.0, 2.0 * np.pi, 200)
    rims = np.stack((radius * np.cos(turn), radius * np.sin(turn), np.where(turn > 3.0, 0.5, -0.5) * length), axis=1)
    assert distances(rims, c.a, c.b, c.radius).max() <= 0.0
    assert distances(rims, c.a, c.b, c.radius).max() >= -1e-6
    assert c.excess >= max(c.radius - radius, c.b[2] + c.radius - 0.5 * length) - 1e-15


# ---------------------------------------------------------------- URDF
URDF = """<robot name="r">
<link name="foot"><collision><geometry><box size=".1 .04 .04"/></geometry></collision></link>
<link name="arm"><collision><origin xyz="0 0 .2"/>
<geometry><mesh filename="meshes/bar.stl" scale="1 1 -2"/></geometry></collision></link>
<link name="wrist"><collision><origin xyz="0 0 .1" rpy="0 1.5707963267948966 0"/>
<geometry><capsule radius=".03" length=".1"/></geometry></collision></link>
<link name="hand"><collision><geometry><sphere radius=".04"/></geometry></collision></link>
<link name="finger"><collision><origin xyz="0 0 .05"/><geometry><sphere radius=".01"/></geometry></collision></link>
<link name="knob"><collision><origin xyz=".1 0 .02"/><geometry><sphere radius=".01"/></geometry></collision></link>
<link name="tip"/>
<joint name="j1" type="revolute"><parent link="foot"/><child link="arm"/><origin xyz="0 0 .1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1"/></joint>
<joint name="j2" type="revolute"><parent link="arm"/><child link="wrist"/><origin xyz="0 0 .4"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1"/></joint>
<joint name="f1" type="fixed"><parent link="wrist"/><child link="tip"/><origin xyz="0 0 .3"/></joint>
<joint name="f2" type="fixed"><parent link="tip"/><child link="hand"/><origin xyz="0 0 .02"/></joint>
<joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
<limit lower="-.04" upper=".04"/></joint>
<joint name="turn" type="continuous"><parent link="hand"/><child link="knob"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.cylinder(0.03, 0.2, sections=8).export(tmp_path / "meshes/bar.stl")
    (tmp_path / "arm.urdf").write_text(URDF, encoding="utf-8")
    return tmp_path


@pytest.mark.filterwarnings("ignore:.*read without")
def test_collision_elements_become_capsules_of_the_links_that_move_them(folder):
    robot = optik.Robot.from_urdf(folder / "arm.urdf", "tip", shapes=True)
    shapes = robot.shapes
    rows = {
        name: [column[shapes.find_capsules(name)] for column in (*shapes.capsules, shapes.excess)]
        for name in shapes.names
    }
    assert {name: set(row[0].tolist()) for name, row in rows.items()} == {
        "foot": {0}, "arm": {1}, "wrist": {2}, "hand": {2}, "finger": {2}, "knob": {2},
    }  # fmt: skip
    q = np.array([0.3, -0.5])
    poses = dict(enumerate([np.eye(4), *robot.frames(q)[:-1]]))

    def world(name):
        link, a, b, radius, _ = rows[name]
        T = poses[int(link[0])]
        return [(T[:3, :3] @ x + T[:3, 3], T[:3, :3] @ y + T[:3, 3], r) for x, y, r in zip(a, b, radius, strict=True)]

    hand = robot.fk(q) @ se3.pose(p=(0.0, 0.0, 0.02))
    assert np.abs(world("hand")[0][0] - hand[:3, 3]).max() <= 1e-12
    bar = trimesh.load(folder / "meshes/bar.stl").vertices * (1.0, 1.0, -2.0) + (0.0, 0.0, 0.2)
    lower = se3.pose(p=(0.0, 0.0, 0.1)) @ se3.pose(se3.exp_so3([0.0, 0.3, 0.0]))
    points = bar @ lower[:3, :3].T + lower[:3, 3]
    assert np.min([distances(points, *c) for c in world("arm")], axis=0).max() <= 0.0
    for angle in np.linspace(-3.0, 3.0, 9):  # every position of what the arm does not move
        knob = hand @ se3.pose(se3.exp_so3([0.0, 0.0, angle]), (0.0, 0.0, 0.0)) @ np.array([0.1, 0.0, 0.02, 1.0])
        assert min(distances(knob[None, :3], *c)[0] for c in world("knob")) <= -0.01 + 1e-9
        finger = hand @ np.array([0.0, angle / 75.0, 0.05, 1.0])
        assert min(distances(finger[None, :3], *c)[0] for c in world("finger")) <= -0.01 + 1e-9
    assert np.isnan(rows["knob"][4]).all()
    assert np.isnan(rows["finger"][4]).all()
    assert rows["hand"][4][0] == 0.0
    assert robot.with_shapes(None) == optik.Robot.from_urdf(folder / "arm.urdf", "tip")


@pytest.mark.filterwarnings("ignore:.*read without")
def test_shapes_are_asked_for_also_behind_a_path_and_pairs_by_srdf(folder):
    (folder / "arm.srdf").write_text(
        '<robot name="r"><disable_collisions link1="foot" link2="wrist" reason="Never"/></robot>', encoding="utf-8"
    )
    robot = optik.load(f"{folder}/arm.urdf#tip=tip&srdf={folder}/arm.srdf")
    assert ("foot", "wrist", "Never") in robot.shapes.left_out
    assert optik.load(f"{folder}/arm.urdf#tip=tip").shapes is None
    for options in ({"package_dirs": [folder]}, {"srdf": folder / "arm.srdf"}):
        with pytest.raises(InvalidInput, match="shapes=True"):
            optik.Robot.from_urdf(folder / "arm.urdf", "tip", **options)
    with pytest.raises(InvalidInput, match="shapes=yes"):
        optik.load(f"{folder}/arm.urdf#shapes=perhaps")


@pytest.mark.filterwarnings("ignore:.*read without")
@pytest.mark.parametrize(
    ("old", "new", "link", "words"),
    [
        ("meshes/bar.stl", "../bar.stl", "arm", "existing mesh|elsewhere"),
        ("meshes/bar.stl", "https://x.org/bar.stl", "arm", "URL"),
        ('scale="1 1 -2"', 'scale="1 1"', "arm", "mesh scale"),
        ("meshes/bar.stl", "meshes/bar.dae", "arm", r"bar\.dae"),
        ("meshes/bar.stl", "$(find parts)/bar.stl", "arm", "xacro"),
        ('size=".1 .04 .04"', 'size=".1 .04 0"', "foot", "box size"),
        ('<sphere radius=".04"/>', "<sphere/>", "hand", "sphere radius"),
        ('<sphere radius=".04"/>', '<cone radius=".04"/>', "hand", "cone"),
    ],
)
def test_a_shape_that_cannot_be_read_is_none_and_a_scene_is_refused_until_it_is_given_or_left_out(
    folder, old, new, link, words
):
    file = folder / "arm.urdf"
    full = optik.Robot.from_urdf(file, "tip", shapes=True)
    file.write_text(URDF.replace(old, new), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnreadShapeWarning)
        assert optik.Robot.from_urdf(file, "tip").n == 2
        left = optik.Robot.from_urdf(file, "tip", shapes=True, without_shape=[link])
    with pytest.warns(UnreadShapeWarning, match=f"link '{link}'.*({words})") as caught:
        robot = optik.Robot.from_urdf(file, "tip", shapes=True)
    assert (len(caught), caught[0].filename, [name for name, _ in caught[0].message.links]) == (1, __file__, [link])
    assert set(robot.shapes.names) == set(left.shapes.names) == set(full.shapes.names) - {link}
    limits = planners.MotionLimits(1.0, 5.0, 50.0)
    for arm in (robot, pickle.loads(pickle.dumps(robot)), optik.Robot.from_dict(robot.to_dict())):
        with pytest.raises(InvalidInput, match=rf"link '{link}'.*({words}).*without_shape=\('{link}',\)"):
            planners.plan(arm, [0.2, 0.1], [0.0, 0.0], limits=limits, scene=optik.Scene())
        assert arm == robot != left
    number = {"foot": 0, "arm": 1, "hand": 2}[link]
    assert left == optik.load(file, tip="tip", without_shape=[link])
    assert left == optik.load(f"{file}#tip=tip&without_shape={link}")
    given = robot.with_shapes(robot.shapes.with_part(link, number, [((0.0, 0.0, 0.0), 0.01)]))
    for arm in (left, given):
        assert planners.plan(arm, [0.2, 0.1], [0.0, 0.0], limits=limits, scene=optik.Scene())


def test_an_arm_of_which_no_shape_can_be_read_is_read(folder):
    text = re.sub(r"<(box|sphere|capsule|mesh) ", r'<mesh filename="x.dae" n', URDF)
    with pytest.warns(UnreadShapeWarning, match=r"link 'foot'.*and 5 more .*x\.dae"):
        robot = optik.Robot.from_urdf(text, "tip", shapes=True)
    assert (robot.shapes.m, len(robot.shapes.unread)) == (0, 6)
    assert optik.Robot.from_dict(robot.to_dict()) == robot
    with pytest.raises(InvalidInput, match="shapes=True"):
        optik.Robot.from_urdf(text, "tip", without_shape=["foot"])
    with pytest.raises(RobotModelError, match="without_shape='feet' names no link"):
        optik.Robot.from_urdf(text, "tip", shapes=True, without_shape=["feet"])


@pytest.mark.filterwarnings("ignore:.*read without")
@pytest.mark.parametrize(
    ("old", "new", "kind", "words"),
    [
        ('<sphere radius=".04"/>', '<sphere radius="40"/>', InvalidInput, "millimetres"),
        ('<limit lower="-.04" upper=".04"/>', "", RobotModelError, "slide.*without limits"),
    ],
)
def test_a_shape_of_unknown_size_is_refused_only_where_shapes_are_read(folder, old, new, kind, words):
    (folder / "arm.urdf").write_text(URDF.replace(old, new), encoding="utf-8")
    assert optik.Robot.from_urdf(folder / "arm.urdf", "tip").n == 2
    with pytest.raises(kind, match=words):
        optik.Robot.from_urdf(folder / "arm.urdf", "tip", shapes=True)


def test_an_arm_without_collision_elements_has_no_shapes():
    with pytest.raises(RobotModelError, match="no <collision>"):
        optik.Robot.from_urdf(optik.load("panda").with_shapes(None).to_urdf(), shapes=True)


def test_a_box_is_closed():
    box = trimesh.Trimesh(*trimesh.triangles.to_kwargs(box_triangles(np.array([0.1, 0.2, 0.3]))).values(), process=True)
    box.merge_vertices()
    assert (abs(abs(box.volume) - 0.006) <= 1e-12, abs(box.area - 0.22) <= 1e-12) == (True, True)


def test_a_capsule_of_a_urdf_is_its_own_enclosure() -> None:
    """The length is that of the cylinder between the caps: the ends are half of it from the middle."""
    joint = (
        '<parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
    )
    shape = '<collision><geometry><capsule radius="0.05" length="0.4"/></geometry></collision>'
    links = f'<link name="base"/><link name="a">{shape}</link>'
    text = f'<robot name="c">{links}<joint name="j" type="revolute">{joint}</joint></robot>'
    ends = np.array(optik.Robot.from_urdf(text, "a", shapes=True).to_dict()["shapes"]["b"])
    np.testing.assert_allclose(np.abs(ends), [[0.0, 0.0, 0.2]], atol=1e-15)
