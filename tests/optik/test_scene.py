"""Scenes: checks of what is around an arm, what may be touched, and files."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
import planners
from optik import se3
from optik.arm.shapes.enclosure import box_triangles
from optik.errors import InvalidInput, OptikError, RobotModelError, UnknownName
from optik.scene import files
from optik.scene.contact import BOX, CLOUD, CYLINDER, MESH, ROUND, find_contact, find_nearest, find_nearest_pairs
from tests.oracles.shapes import distances
from tests.seeds import shift_seed

T = se3.from_xyz_rpy((0.4, 0.0, -0.025), (0.0, 0.0, 30.0))
SCENE = optik.Scene(
    boxes=[(T, (0.8, 1.2, 0.05))],
    spheres=[((0.5, 0.0, 0.3), 0.06)],
    capsules=[((0.6, 0.3, 0.0), (0.6, 0.3, 0.9), 0.03)],
    planes=[((0.0, 0.0, -0.7), (0.0, 0.0, 2.0))],
    cylinders=[((0.6, -0.3, 0.0), (0.6, -0.3, 0.12), 0.04)],
    meshes=[[(0.5, 0.0, 0.0), (0.6, 0.0, 0.0), (0.5, 0.1, 0.0), (0.5, 0.0, 0.08)]],
    clouds=[([(0.5, 0.0, 0.4), (0.5, 0.01, 0.4)], 0.01)],
    allow=[("base", "box1")],
    margin=0.01,
)
EXAMPLE = "\n".join(line[4:] for line in (files.__doc__ or "").splitlines() if line.startswith("    "))


def test_kernels_take_half_edges_spheres_as_capsules_and_unit_normals():
    pose, half, a, b, radius, planes, solids = SCENE.arrays
    assert np.abs(pose - T).max() <= 1e-15
    assert half.tolist() == [[0.4, 0.6, 0.025]]
    assert a.tolist() == [[0.5, 0.0, 0.3], [0.6, 0.3, 0.0]]
    assert b.tolist() == [[0.5, 0.0, 0.3], [0.6, 0.3, 0.9]]
    assert radius.tolist() == [0.06, 0.03]
    assert planes.tolist() == [[0.0, 0.0, -0.7, 0.0, 0.0, 1.0]]
    cylinder = solids[0, :16].reshape(4, 4)
    np.testing.assert_allclose(cylinder[:3, 2:], [[0.0, 0.6], [0.0, -0.3], [1.0, 0.06]], rtol=0, atol=1e-16)
    np.testing.assert_allclose(solids[0, 16:], [0.04, 0.06], rtol=0, atol=1e-16)
    assert SCENE.names == ("box1", "sphere1", "capsule1", "plane1", "cylinder1", "mesh1", "cloud1")
    assert solids.shape == (1 + 4 + 4 + 6 + 4 + 1 + 1, 18)
    assert solids[-2, :9].tolist() == [15, 19, 0.5, 0.0, 0.4, 0.5, 0.01, 0.4, 0.01]
    assert solids[-1, :6].tolist() == [1, 5, 5, 9, 9, 15]
    empty = optik.Scene().arrays
    assert [x.shape for x in empty] == [(0, 4, 4), (0, 3), (0, 3), (0, 3), (0,), (0, 6), (0, 18)]
    for x, none in zip(SCENE.arrays, empty, strict=True):
        assert x.flags.c_contiguous
        assert not x.flags.writeable
        assert (x.dtype, x.ndim) == (none.dtype, none.ndim)  # one layout, so that kernels are compiled once


def test_a_scene_is_equal_by_content_through_pickle_json_and_toml(tmp_path):
    assert pickle.loads(pickle.dumps(SCENE)) == SCENE
    assert optik.Scene.from_dict(json.loads(json.dumps(SCENE.to_dict()))) == SCENE
    assert hash(SCENE) == hash(pickle.loads(pickle.dumps(SCENE)))
    assert optik.Scene(spheres=SCENE.spheres) != optik.Scene(spheres=SCENE.spheres, margin=0.01)
    assert optik.Scene(spheres=SCENE.spheres) != optik.Scene(spheres=SCENE.spheres, allow=[("base", "sphere1")])
    (tmp_path / "cell.toml").write_text(EXAMPLE, encoding="utf-8")
    (tmp_path / "cell.json").write_text(json.dumps(SCENE.to_dict()), encoding="utf-8")
    read = optik.Scene.load(tmp_path / "cell.toml")
    assert read.names == ("table", "sphere1", "capsule1", "floor", "cylinder1", "mesh1", "cloud1")
    assert (read.allow, read.margin) == ((("base", "table"),), 0.01)
    for mine, theirs in zip(read.arrays, SCENE.arrays, strict=True):
        assert np.abs(mine - theirs).max() <= 1e-15
    assert optik.Scene.load(tmp_path / "cell.json") == SCENE


def test_what_is_allowed_is_a_link_by_its_joint_or_capsules_by_their_name():
    shapes = optik.Shapes(
        [(0, (0, 0, 0), 0.1), (3, (0, 0, 0), 0.1), (3, (0, 0, 0.1), 0.1)], names=("foot", "arm", "lamp"), excess=0.0
    )
    robot = optik.load("panda").with_shapes(shapes)

    def touching(*allow):
        return (~optik.Scene(spheres=SCENE.spheres, planes=SCENE.planes, allow=allow).pair_mask(robot)).tolist()

    assert touching() == [[False, False]] * 3
    assert touching(("base", "sphere1")) == touching(("foot", "sphere1")) == [[True, False], [False] * 2, [False] * 2]
    assert touching(("joint3", "plane1")) == [[False, False], [False, True], [False, True]]
    assert touching(("lamp", "plane1")) == [[False, False], [False, False], [False, True]]
    with pytest.raises(UnknownName, match="did you mean lamp"):
        touching(("lump", "plane1"))
    with pytest.raises(InvalidInput, match="without shapes"):
        optik.Scene().pair_mask(robot.with_shapes(None))


CUBE = box_triangles(np.ones(3))
DENTED = np.vstack([CUBE, CUBE * 0.5 + (0.6, 0.0, 0.0)])
BAD = [
    (dict(boxes=[(T, (1.0, 1.0, 0.0))]), "edge"),
    (dict(boxes=[(T, (1.0, 1.0))]), "edge"),
    (dict(boxes=[(T[:3, :3], (1.0, 1.0, 1.0))]), "pose"),
    (dict(boxes=[(2.0 * T, (1.0, 1.0, 1.0))]), "boxes\\[0\\]: T"),
    (dict(boxes=[(T, (300.0, 200.0, 100.0))]), "millimetres"),
    (dict(boxes=3), "a list of boxes"),
    (dict(boxes=[T]), "edge lengths"),
    (dict(spheres=[((0.0, 500.0, 0.0), 0.1)]), "millimetres"),
    (dict(spheres=[((0.0, 0.0, 0.0), 150.0)]), "millimetres"),
    (dict(spheres=[((0.0, np.nan, 0.0), 0.1)]), "finite"),
    (dict(spheres=[((0.0, 0.0, 0.0), -0.1)]), "above 0"),
    (dict(spheres=[((0.0, 0.0, 0.0), True)]), "above 0"),
    (dict(capsules=[((0.0, 0.0, 0.0), (0.0, 0.0), 0.1)]), "three finite"),
    (dict(cylinders=[((0.0, 0.0, 0.1), (0.0, 0.0, 0.1), 0.1)]), "a length of 0 m"),
    (dict(cylinders=[((0.0, 0.0, 0.0), (0.0, 0.0, np.nan), 0.1)]), "finite"),
    (dict(cylinders=[((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))]), "\\(a, b, radius\\)"),
    (dict(meshes=[np.eye(3)]), "shape \\(3, 3\\)"),
    (dict(meshes=[[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]]), "in a plane"),
    (dict(meshes=[[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, np.nan)]]), "finite"),
    (dict(meshes=[[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 300)]]), "millimetres"),
    (dict(meshes=[DENTED]), "not convex: corners lie"),
    (dict(meshes=[np.vstack([CUBE, 0.999 * CUBE])]), "not convex: corners lie 0.0"),
    (dict(meshes=["corners"]), "corners"),
    (dict(meshes=[np.random.default_rng(0).normal(size=(5000, 3))]), "at most 4096"),
    (dict(clouds=[(np.zeros((0, 3)), 0.1)]), r"clouds\[0\]: points: expected 1 to 1000000 points \(k, 3\)"),
    (dict(clouds=[(np.zeros(3), 0.1)]), "shape \\(3,\\)"),
    (dict(clouds=[(np.zeros((1_000_001, 3)), 0.1)]), "shape \\(1000001, 3\\)"),
    (dict(clouds=[([(0, 0, 0), (0, np.nan, 0)], 0.1)]), "point 1: .*nan"),
    (dict(clouds=[([(0, 0, 0), (0, 200, 0)], 0.1)]), "millimetres"),
    (dict(clouds=[([(0, 0, 0)], 0.0)]), "radius: expected a length above 0"),
    (dict(clouds=[([(0, 0, 0)], np.inf)]), "radius: expected a length above 0"),
    (dict(clouds=[np.zeros((3, 3))]), "\\(points, radius\\)"),
    (dict(planes=[((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]), "not all 0"),
    (dict(planes=[((0.0, 0.0, 0.0), (0.0, 0.0, np.inf))]), "direction"),
    (dict(spheres=SCENE.spheres * 2, names=("a", "a")), "different names"),
    (dict(spheres=SCENE.spheres, names=("a", "b")), "different names"),
    (dict(spheres=SCENE.spheres, allow=[("base", "box1")]), "unknown object"),
    (dict(spheres=SCENE.spheres, allow=[("base",)]), "pairs"),
    (dict(spheres=SCENE.spheres, allow="base"), "pairs"),
    (dict(spheres=SCENE.spheres, excess=-1.0), "excess"),
]


@pytest.mark.parametrize(("arguments", "words"), BAD)
def test_bad_input_is_one_clear_line(arguments, words):
    with pytest.raises(OptikError, match=words) as caught:
        optik.Scene(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("boxes = 3", "tables"),
        ("[[boxes]]\nxyz_mm = [0, 0, 0]", "edges_mm missing"),
        ("[[boxes]]\nxyz_mm = [0, 0, 0]\nedges_mm = [1, 2, 0]", "bad.toml: scene.boxes"),
        ("[[spheres]]\ncentre_mm = [0, 0, nan]\nradius_mm = 3", "centre_mm"),
        ("[[spheres]]\ncentre_m = [0, 0, 0]\nradius_mm = 3", "centre_m unknown"),
        ("x =", "TOML"),
        ("allow = 3", "allow"),
    ],
)
def test_a_bad_file_is_named_with_the_key(tmp_path, text, words):
    (tmp_path / "bad.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInput, match=words):
        optik.Scene.load(tmp_path / "bad.toml")


def test_files_that_are_no_scenes_are_refused(tmp_path):
    (tmp_path / "a.json").write_text("[]", encoding="utf-8")
    for name in ("a.json", "missing.toml", "a.step"):
        with pytest.raises(InvalidInput):
            optik.Scene.load(tmp_path / name)
    with pytest.raises(InvalidInput, match="package_dirs"):
        optik.Scene.load(tmp_path / "a.json", package_dirs=[tmp_path])


WEDGE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
CELL = """<robot name="cell"><link name="world"/>
<link name="table"><collision><geometry><box size="1 2 .1"/></geometry></collision>
<collision><origin xyz="0 0 1"/><geometry><sphere radius=".1"/></geometry></collision></link>
<link name="wedge"><collision><geometry><mesh filename="wedge.obj" scale=".1 .1 .1"/></geometry></collision></link>
<link name="post"><collision><geometry><cylinder radius=".05" length="1"/></geometry></collision></link>
<joint name="a" type="fixed"><parent link="world"/><child link="table"/>
<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint>
<joint name="c" type="fixed"><parent link="table"/><child link="wedge"/><origin xyz="0 0 1"/></joint>
<joint name="b" type="revolute"><parent link="table"/><child link="post"/>
<origin xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
</robot>"""


def test_a_static_urdf_is_a_scene_with_its_joints_at_0(tmp_path):
    (tmp_path / "cell.urdf").write_text(CELL, encoding="utf-8")
    (tmp_path / "wedge.obj").write_text(WEDGE, encoding="utf-8")
    scene = optik.Scene.load(tmp_path / "cell.urdf")
    assert scene.names == ("table", "table#2", "post", "wedge")
    ends = {tuple(corner) for corner in np.round(scene.meshes[0], 12).tolist()}
    assert ends == {(1.0, 0.0, 1.0), (1.0, 0.1, 1.0), (0.9, 0.0, 1.0), (1.0, 0.0, 1.1)}
    (pose, edges), (centre, radius), (a, b, thick) = scene.boxes[0], scene.spheres[0], scene.cylinders[0]
    assert np.abs(pose - se3.from_xyz_rpy((1, 0, 0), (0, 0, 90))).max() <= 1e-15
    assert edges.tolist() == [1.0, 2.0, 0.1]
    assert (np.abs(centre - (1, 0, 1)).max() <= 1e-15, radius) == (True, 0.1)
    # a metre along y of the table, which is −x of the world
    np.testing.assert_allclose([a, b], [[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]], rtol=0, atol=1e-15)
    assert (thick, scene.excess.tolist()) == (0.05, [0.0] * 4)
    with pytest.raises(RobotModelError, match="no <collision>"):
        (tmp_path / "empty.urdf").write_text('<robot name="x"><link name="a"/></robot>', encoding="utf-8")
        optik.Scene.load(tmp_path / "empty.urdf")


def test_a_mesh_is_the_hull_of_its_corners_or_convex_triangles(tmp_path):
    hull = np.array([(x, y, z) for x in (0.0, 0.2) for y in (0.0, 0.3) for z in (0.0, 0.4)])
    inside = optik.Scene(meshes=[np.vstack([hull, [(0.1, 0.1, 0.1)]])])
    solids = inside.arrays[6]
    assert solids[-1, :6].tolist() == [0, 8, 8, 14, 14, 26]
    np.testing.assert_allclose(sorted(solids[8:14, 3]), [0.0, 0.0, 0.0, 0.2, 0.3, 0.4], rtol=0, atol=1e-15)
    np.testing.assert_allclose(solids[-1, 6:10], [0.1, 0.15, 0.2, np.sqrt(0.0725)], rtol=0, atol=1e-15)
    pointed = np.vstack([hull, [(0.1, 0.15, 0.9)]])
    middle, radius = np.split(optik.Scene(meshes=[pointed]).arrays[6][-1, 6:10], [3])
    assert np.linalg.norm(pointed - middle, axis=1).max() == pytest.approx(radius[0], rel=0, abs=1e-15)
    # the orientation of triangles does not count, nor single precision
    rounded = np.vstack([CUBE[:6], CUBE[6:, ::-1]]) * (1.0 + 1e-7 * np.arange(12)[:, None, None])
    assert len(optik.Scene(meshes=[rounded]).meshes[0]) >= 8
    with pytest.raises(InvalidInput, match="corners_mm"):
        (tmp_path / "bad.toml").write_text("[[meshes]]\ncorners_mm = [[0, 0]]", encoding="utf-8")
        optik.Scene.load(tmp_path / "bad.toml")


def test_a_file_without_cylinders_is_read_and_written_as_before():
    data = optik.Scene(boxes=SCENE.boxes).to_dict()
    assert list(data) == ["boxes", "spheres", "capsules", "planes", "allow", "names", "excess", "margin"]
    assert optik.Scene.from_dict(data) == optik.Scene(boxes=SCENE.boxes)


part = st.none() | st.booleans() | st.floats() | st.text(max_size=3) | st.lists(st.floats(-1.0, 9.0), max_size=4)


@given(
    st.sampled_from(files.SCENE_KEYS),
    part | st.lists(part, max_size=3) | st.lists(st.lists(part, max_size=3), max_size=2),
)
def test_plain_data_fails_with_our_errors_only(key, value):
    try:
        scene = optik.Scene.from_dict(SCENE.to_dict() | {key: value})
    except OptikError as error:
        assert "\n" not in str(error)
    else:
        assert optik.Scene.from_dict(scene.to_dict()) == scene


# ---------------------------------------------------------------- attached objects
Q = np.array([0.3, -0.4, 0.2, -2.0, 0.1, 1.7, 0.5])


@pytest.mark.parametrize("name", [name for name in SCENE.names if name != "plane1"])
def test_an_attached_object_moves_with_the_tool_and_its_capsules_contain_it(name):
    robot = optik.load("panda_hand")
    carrying, rest = SCENE.attach(robot, name, Q)
    assert set(rest.names) == set(SCENE.names) - {name}
    assert all(pair[1] != name for pair in rest.allow) and rest.margin == SCENE.margin
    mine = carrying.shapes.find_capsules(name)
    link, a, b, radius = (column[mine] for column in carrying.shapes.capsules)
    assert set(link.tolist()) == {7}
    T = robot.frames(Q)[6]
    a, b = (end @ T[:3, :3].T + T[:3, 3] for end in (a, b))
    rng, inside, count = np.random.default_rng(shift_seed(1)), SCENE.without(*rest.names), 0
    low, high = np.minimum(a, b).min(axis=0) - radius.max(), np.maximum(a, b).max(axis=0) + radius.max()
    for p in rng.uniform(low, high, (2000, 3)):
        if find_nearest((0, 0, kind_of(inside)), inside.arrays, np.array([[p, p]]))[0] <= radius_of(inside):
            assert min(distances(p[None], *capsule).item() for capsule in zip(a, b, radius, strict=True)) <= 1e-9
            count += 1
    assert count >= 20


def kind_of(scene):
    return (BOX, ROUND, ROUND, 2, CYLINDER, MESH, CLOUD)[
        [bool(getattr(scene, kind)) for kind in files.OBJECT_KINDS].index(True)
    ]


def radius_of(scene):
    return float(scene.arrays[4].sum())


def test_an_attached_object_in_contact_is_named_unless_it_is_allowed():
    robot = optik.load("panda_hand")
    tool = robot.fk(Q)[:3, 3]
    cup = (tool, tool - np.array([0.0, 0.0, 0.1]), 0.03)
    low = cup[1] - np.array([0.0, 0.0, 0.06])
    scene = optik.Scene(boxes=[(se3.pose(p=low), (0.3, 0.3, 0.1))], cylinders=[cup], names=("table", "cup"))
    carrying, rest = scene.attach(robot, "cup", Q)
    assert find_contact(carrying, rest, Q).pair == ("cup", "table")
    refused = planners.plan(carrying, Q + 0.01, Q, scene=rest)
    assert (refused.status, refused.failure.s) == ("contact", 0.0)
    assert "cup and table" in refused.failure.reason and "\n" not in refused.failure.reason
    carrying, rest = scene.attach(robot, "cup", Q, allow=["table"])
    assert find_contact(carrying, rest, Q).pair != ("cup", "table")
    assert rest.without("table") == optik.Scene()
    for arguments, words in (
        ((robot, "cap", Q), "did you mean cup"),
        ((robot.with_shapes(None), "cup", Q), "without shapes"),
        ((carrying, "cup", Q), "a part 'cup'"),
    ):
        with pytest.raises(OptikError, match=words):
            scene.attach(*arguments)
    with pytest.raises(InvalidInput, match=r"^allow: expected a list of strings; got 'table'"):
        scene.attach(robot, "cup", Q, allow="table")
    with pytest.raises(InvalidInput, match="the plane"):
        SCENE.attach(robot, "plane1", Q)


def test_the_deepest_of_several_objects_counts_where_the_arm_is_inside_all() -> None:
    robot, rng, inside = optik.load("panda"), np.random.default_rng(shift_seed(12)), 0
    for _ in range(20):
        poses = np.tile(np.eye(4), (4, 1, 1))
        poses[:, :3, 3] = rng.uniform([-0.4, -0.4, 0.0], [0.4, 0.4, 0.8], (4, 3))
        boxes = [(T, tuple(rng.uniform(0.5, 2.5, 3))) for T in poses]
        q = robot.limits.sample(rng, 50)
        found = find_nearest_pairs(robot, optik.Scene(boxes=boxes), q)[0]
        alone = [find_nearest_pairs(robot, optik.Scene(boxes=[one]), q)[0] for one in boxes]
        np.testing.assert_array_equal(found, np.min(alone, axis=0))
        inside += int((found < -0.3).sum())
    assert inside > 200
