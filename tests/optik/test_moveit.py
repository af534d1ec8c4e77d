"""MoveIt planning scenes in YAML: what is read, and that bad files fail with one line."""

import os
import tarfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import se3
from optik.errors import AssumptionWarning, InvalidInput, OptikError, UnknownName
from optik.types import Array

yaml = pytest.importorskip("yaml")
QUARTER = [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]
SCENE = """
name: ""
robot_model_name: panda
robot_state:
  joint_state: {name: [panda_joint1], position: [0]}
fixed_frame_transforms:
  - child_frame_id: bench
    transform: {translation: [1, 0, 0], rotation: [0, 0, 0.7071067811865476, 0.7071067811865476]}
allowed_collision_matrix:
  entry_names: [hand, foot, can, wedge]
  entry_values:
    - [false, true, true, false]
    - [true, false, false, false]
    - enabled: [true, false, false, true]
    - [false, false, true, false]
  default_entry_names: [shelf]
  default_entry_values: [true]
world:
  collision_objects:
    - id: shelf
      header: {frame_id: panda_link0}
      primitives:
        - {type: box, dimensions: [1.2, 0.04, 3.4e-1]}
        - {type: 2, dimensions: [0.1]}
      primitive_poses:
        - {position: [0.5, -1.0, 0.25], orientation: [0, 0, 0.7071067811865476, 0.7071067811865476]}
        - {position: {x: 0, y: 0, z: 2}, orientation: {x: 0, y: 0, z: 0, w: 1}}
    - id: can
      header: {frame_id: bench}
      pose: {position: [0, 1, 0], orientation: [0, 0, 0, 1]}
      primitives: [{type: cylinder, dimensions: [0.14, 0.03]}]
      primitive_poses: [{position: [1e-05, 0, 0.5], orientation: [0.7071067811865476, 0, 0, 0.7071067811865476]}]
    - id: wedge
      meshes:
        - triangles: [{vertex_indices: [0, 1, 2]}, {vertex_indices: [0, 1, 3]}, {vertex_indices: [0, 2, 3]},
            {vertex_indices: [1, 2, 3]}]
          vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], {x: 0, y: 0, z: 1}]
      mesh_poses: [{position: [0, 0, 5], orientation: [0, 0, 0.7071067811865476, 0.7071067811865476]}]
    - id: floor
      planes: [{coef: [0, 0, 2, 1]}]
      plane_poses: [{position: [0, 0, 0], orientation: [0, 0, 0, 1]}]
"""


def load(tmp_path: Path, text: str) -> optik.Scene:
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    return optik.Scene.load(tmp_path / "scene.yaml")


def test_a_plane_may_have_a_normal_of_any_length(tmp_path: Path) -> None:
    for coef in ("[3, 0, 4, 10]", "[3e200, 0, 4e200, 1e201]", "[3e-200, 0, 4e-200, 1e-199]"):
        scene = load(tmp_path, SCENE.replace("coef: [0, 0, 2, 1]", f"coef: {coef}"))
        np.testing.assert_allclose(scene.planes[0], [[-1.2, 0.0, -1.6], [0.6, 0.0, 0.8]], rtol=0, atol=1e-15)


def quarter_turn(p: Any) -> Array:
    return se3.from_xyz_rpy(p, (0.0, 0.0, 90.0))


def test_objects_frames_and_allowed_pairs_are_read(tmp_path: Path) -> None:
    scene = load(tmp_path, SCENE)
    assert scene.names == ("shelf", "shelf#2", "floor", "can", "wedge")
    assert {tuple(p) for p in np.round(scene.meshes[0], 12).tolist()} == {(0, 0, 5), (0, 1, 5), (-1, 0, 5), (0, 0, 6)}
    (T, edges), (centre, radius), (a, b, thick) = scene.boxes[0], scene.spheres[0], scene.cylinders[0]
    np.testing.assert_allclose(T, quarter_turn((0.5, -1.0, 0.25)), rtol=0, atol=1e-15)
    assert (edges.tolist(), centre.tolist(), radius, thick) == ([1.2, 0.04, 0.34], [0.0, 0.0, 2.0], 0.1, 0.03)
    # The can lies along −y of its object, which is x of the base behind the bench's quarter turn.
    np.testing.assert_allclose([a, b], [[-0.07, 1e-5, 0.5], [0.07, 1e-5, 0.5]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(scene.planes[0], [[0.0, 0.0, -0.5], [0.0, 0.0, 1.0]], rtol=0, atol=0)
    assert set(scene.allow) == {
        ("hand", "can"), ("hand", "shelf"), ("hand", "shelf#2"), ("foot", "shelf"), ("foot", "shelf#2"),
    }  # fmt: skip


def test_objects_that_are_added_and_links_of_their_own_size_change_nothing(tmp_path: Path) -> None:
    more = "link_padding: [{link_name: hand, padding: 0}]\nlink_scale: [{link_name: hand, scale: 1.0}]\n"
    for word in ("add", "ADD", "0"):
        text = more + SCENE.replace("    - id:", f"    - operation: {word}\n      id:")
        assert load(tmp_path, text) == load(tmp_path, SCENE)


BOX = """
header: {stamp: {sec: 0, nanosec: 0}, frame_id: base_link}
id: crate
primitives: [{type: 1, dimensions: [0.2, 0.3, 0.4]}]
primitive_poses: [{position: {x: 0.6, z: 0.2}}]
"""
"""One CollisionObject."""


@pytest.mark.parametrize("operation", ["0", "ADD", '"\\0"', "!!binary AA=="])
@pytest.mark.parametrize("around", ["{}", "collision_objects: [{{{}}}]", "world: {{collision_objects: [{{{}}}]}}",
                                    "scene: {{name: a, world: {{collision_objects: [{{{}}}]}}}}\nsuccess: true"])  # fmt: skip
def test_a_scene_may_be_inside_another_message_or_one_object(around: str, operation: str, tmp_path: Path) -> None:
    lines = [*BOX.strip().splitlines(), f"operation: {operation}"]
    scene = load(tmp_path, around.format(("\n" if around == "{}" else ", ").join(lines)))
    assert scene.names == ("crate",) and scene.boxes[0][1].tolist() == [0.2, 0.3, 0.4]
    assert scene.boxes[0][0][:3, 3].tolist() == [0.6, 0.0, 0.2]


def test_an_object_that_is_removed_is_left_out_and_it_is_said(tmp_path: Path) -> None:
    two = "collision_objects: [{%s}, {id: ball, primitives: [{type: 2, dimensions: [0.1]}]}, {id: %s, operation: %s}%s]"
    crate = ", ".join(BOX.strip().splitlines())
    for word in ("REMOVE", "1", '"\\x01"', "!!binary AQ=="):
        with pytest.warns(AssumptionWarning, match=r"REMOVE in collision_objects\[2\] removes 'crate' before it"):
            assert load(tmp_path, two % (crate, "crate", word, "")).names == ("ball",)
    with pytest.warns(AssumptionWarning, match=r"REMOVE in collision_objects\[2\] removes every object"):
        assert load(tmp_path, two % (crate, "''", "REMOVE", f", {{{crate}}}")).names == ("crate",)
    with pytest.raises(InvalidInput, match="no objects"):
        load(tmp_path, "{id: a, operation: REMOVE}")


def test_missing_fields_have_the_defaults_of_the_messages(tmp_path: Path) -> None:
    whole = "{x: 0, y: 0, z: 2}, orientation: {x: 0, y: 0, z: 0, w: 1}"
    quarter = "[0, 0, 0.7071067811865476, 0.7071067811865476]"
    assert whole in SCENE
    for part in ("{z: 2}, orientation: {w: 1}", "{z: 2}, orientation: {x: 0}", "{z: 2}"):
        assert load(tmp_path, SCENE.replace(whole, part)) == load(tmp_path, SCENE)
    one = "world: {collision_objects: [{id: a, primitives: [{type: sphere, dimensions: [0.1]}], pose: {position: {x: 1}}}]}"
    centre, radius = load(tmp_path, one).spheres[0]
    assert (centre.tolist(), radius) == ([1.0, 0.0, 0.0], 0.1)
    named = SCENE.replace(f"rotation: {quarter}}}", "rotation: {z: 0.7071067811865476, w: 0.7071067811865476}}")
    assert named != SCENE and load(tmp_path, named) == load(tmp_path, SCENE)


def test_a_difference_is_read_as_the_whole_scene_and_says_so(tmp_path: Path) -> None:
    with pytest.warns(AssumptionWarning, match=r"scene\.yaml: is_diff"):
        scene = load(tmp_path, "is_diff: true\n" + SCENE)
    assert scene == load(tmp_path, SCENE)
    assert len(scene.notes) == 1 and "is_diff" in scene.notes[0]
    assert load(tmp_path, SCENE).notes == () and replace(scene, margin=0.1).notes == scene.notes


TEXT = """cell
* table top
{pose}2
box
1.0 0.8 0.04
0.5 0 -0.02
0 0 0.7071067811865476 0.7071067811865476
0 0 0 0
cylinder
0.05 0.6
0.4 -0.4 0.3
0 0 0 1
1 0 0 1
{subframes}* wedge
{pose}1
mesh
4 4
0 0 0
1 0 0
0 1 0
0 0 1
0 1 2
0 1 3
0 2 3
1 2 3
0 0 5
0 0 0 1
0 0 0 0
{subframes}* rest
{pose}2
sphere
0.1
0 0 2
0 0 0 1
0 0 0 0
plane
0 0 2 1
0 0 0
0 0 0 1
0 0 0 0
{subframes}.
"""
OLD = TEXT.format(pose="", subframes="")
NEW = TEXT.format(pose="0 0 1\n0 0 0 1\n", subframes="1\ngrip\n0 0 0.1\n0 0 0 1\n")


def load_text(tmp_path: Path, text: str) -> optik.Scene:
    (tmp_path / "cell.scene").write_text(text, encoding="utf-8")
    return optik.Scene.load(tmp_path / "cell.scene")


@pytest.mark.parametrize(("text", "height"), [(OLD, 0.0), (NEW, 1.0)])
def test_the_text_format_of_moveit_is_read_in_both_versions(tmp_path: Path, text: str, height: float) -> None:
    scene, up = load_text(tmp_path, text), height
    assert scene.names == ("table top", "rest", "rest#2", "table top#2", "wedge")
    (T, edges), (centre, radius), (a, b, thick) = scene.boxes[0], scene.spheres[0], scene.cylinders[0]
    np.testing.assert_allclose(T, quarter_turn((0.5, 0.0, up - 0.02)), rtol=0, atol=1e-15)
    assert (edges.tolist(), centre.tolist(), radius, thick) == ([1.0, 0.8, 0.04], [0.0, 0.0, 2.0 + height], 0.1, 0.05)
    np.testing.assert_allclose([a, b], [[0.4, -0.4, up], [0.4, -0.4, up + 0.6]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(scene.planes[0], [[0.0, 0.0, up - 0.5], [0.0, 0.0, 1.0]], rtol=0, atol=1e-15)
    corners = {tuple(p) for p in np.round(scene.meshes[0] - [0.0, 0.0, up], 12).tolist()}
    assert corners == {(0, 0, 5), (1, 0, 5), (0, 1, 5), (0, 0, 6)}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 0.*complete scene"), ("cell\n", "complete scene"), (OLD[:-2], "complete scene"),
        (OLD.replace("* wedge", "wedge"), r"line 14: .*; got 'wedge'"), (OLD.replace("* rest\n2", "* rest\n3"), "line"),
        (OLD.replace("4 4\n", "4 1000000000000\n"), "line"), (OLD.replace("box\n", "cone\n"), "box, sphere, cylinder"),
        (OLD.replace("1.0 0.8 0.04", "1.0 0.8"), "3 finite numbers"), (OLD.replace("1.0 0.8", "1.0 nan"), "3 finite numbers"),
        (OLD.replace("0 0 0 1\n1 0 0 1", "0 0 0 0\n1 0 0 1"), r"unit quaternion x, y, z, w; got \[0, "),
        (OLD.replace("* rest", "* wedge"), r"collision_objects\[2\].id"), ("cell\n.\n", "at least one object"),
    ],
)  # fmt: skip
def test_a_damaged_text_of_a_scene_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        load_text(tmp_path, text)
    assert "\n" not in str(caught.value) and "cell.scene" in str(caught.value)


def test_an_empty_octomap_is_no_obstacle(tmp_path: Path) -> None:
    text = SCENE.replace("world:\n", "world:\n  octomap: {octomap: {resolution: 0.0, data: []}}\n")
    assert text != SCENE
    assert load(tmp_path, text) == load(tmp_path, SCENE)


def test_a_floating_base_moves_the_world(tmp_path: Path) -> None:
    data = yaml.safe_load(SCENE)
    base = {"translation": [0.0, 2.0, 0.0], "rotation": QUARTER}
    data["robot_state"] = {"multi_dof_joint_state": {"joint_names": ["virtual_joint"], "transforms": [base]}}
    moved, scene = load(tmp_path, yaml.safe_dump(data)), load(tmp_path, SCENE)
    T = quarter_turn((0.0, 2.0, 0.0))
    np.testing.assert_allclose(T @ moved.boxes[0][0], scene.boxes[0][0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(T[:3, :3] @ moved.cylinders[0][0] + T[:3, 3], scene.cylinders[0][0], rtol=0, atol=1e-15)


def test_pairs_of_links_that_the_arm_does_not_have_are_left_out_for_it_only(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    arm, whole = optik.load("panda_hand"), load(tmp_path, SCENE)
    own = optik.Scene.load(tmp_path / "scene.yaml", robot=arm)
    assert own.allow == tuple(pair for pair in whole.allow if pair[0] == "hand") and own.names == whole.names
    assert own.pair_mask(arm).sum() == arm.shapes.m * 5 - 3 * (np.array(arm.shapes.names) == "hand").sum()
    with pytest.raises(UnknownName, match=r"'foot'.*robot=robot"):
        whole.pair_mask(arm)


BAD = [
    ("world: [", "complete YAML"),
    ("- 1", "a mapping"),
    ("a: 1\n---\nb: 2", "one document"),
    ("!!python/object/apply:os.system ['true']", "complete YAML"),
    ("{a: &a [1], ? *a : 2}", "complete YAML"),
    ("[" * 20_000, "complete YAML"),
    ("world: {collision_objects: 3}", "a list"),
    ("[" * 200 + "]" * 200, "at most 100 levels"),
    ("[" * 100_000, "at most 100 levels"),
    ("a: &a 1\nb: [" + "*a," * 2000 + "]", "at most 100 levels and 1000 aliases"),
    ("world: {}\nworld: {}", "'world' twice"),
    ("world: {}", "at least one object"),
    ("world: {collision_object: []}", "collision_object unknown"),
    ("world: {collision_objects: null}\nis_dif: false", "is_dif unknown"),
    (
        SCENE.replace("id: can", "id: shelf"),
        r"collision_objects\[1\].id: .*differs from that of collision_objects\[0\]; got 'shelf'",
    ),
    (SCENE.replace("{x: 0, y: 0, z: 2}", "{X: 0}"), "the field 'X'"),
    ("world: {collision_objects: [{id: a}]}", "'a' without parts"),
    (SCENE.replace("primitives: [", "primitve: ["), "primitve unknown"),
    (SCENE.replace("type: cylinder", "type: true"), "box, sphere, cylinder"),
    (SCENE.replace("frame_id: panda_link0", "frame_id: panda_hand"), "a frame of the base or of the world"),
    ("world: {octomap: {octomap: {resolution: 0.05, data: [1, 2]}}}", "world.octomap: expected none"),
    ("world: {octomap: 3}", "world.octomap: expected a mapping"),
    ("world: {collision_objects: [{id: a, operation: MOVE}]}", r"operation: expected ADD \(0\) or REMOVE"),
    ("world: {collision_objects: [{id: a, operation: [1]}]}", r"operation: expected ADD \(0\) or REMOVE"),
    ("world: {}\nlink_padding: [{link_name: hand, padding: 0.01}]", "padding: expected 0"),
    ("world: {}\nlink_scale: [{link_name: hand, scale: 1.1}]", "scale: expected 1"),
    ("world: {collision_objects: [{id: 3}]}", "a string"),
    (SCENE.replace("type: cylinder", "type: cone"), "box, sphere, cylinder"),
    (SCENE.replace("type: 2", "type: 4"), "box, sphere, cylinder"),
    (SCENE.replace("[0.14, 0.03]", "[0.14]"), "2 finite numbers"),
    (SCENE.replace("[0.14, 0.03]", "[0.14, .nan]"), "2 finite numbers"),
    (SCENE.replace("[0.14, 0.03]", "[0.14, -3]"), "above 0"),
    (SCENE.replace("[0.14, 0.03]", "[1400, 300]"), "cylinders"),
    (SCENE.replace("[1e-05, 0, 0.5]", "[a, 0, 0.5]"), "3 finite numbers"),
    (
        SCENE.replace("orientation: [0, 0, 0, 1]", "orientation: [0, 0, 0, 2]"),
        r"x, y, z, w; got \[0, 0, 0, 2\] of length 2",
    ),
    (SCENE.replace("orientation: [0, 0, 0, 1]", "orientation: [0, 0, 0, 2e200]"), "unit quaternion"),
    (SCENE.replace("[1e-05, 0, 0.5]", f"[{2**63}, 0, 0.5]"), "millimetres"),
    (SCENE.replace("coef: [0, 0, 2, 1]", "coef: [0, 0, 0, 1]"), "not 0"),
    (SCENE.replace("coef: [0, 0, 2, 1]", "coef: [0, 0, 2e-200, 1e200]"), "finite"),
    (SCENE.replace("id: floor", "id: floor\n      header: {frame_id: hall}"), "panda_link0.*a fixed frame"),
    (SCENE.replace("[false, true, true, false]", "[false, true]"), "entry_values"),
    (SCENE.replace("joint_state:", "attached_collision_objects: [{}]\n  joint_state:"), "with_part"),
    (
        SCENE.replace("joint_state:", "multi_dof_joint_state: {transforms: [{}, {}]}\n  joint_state:"),
        "2 floating joints",
    ),
    (SCENE.replace("vertex_indices: [0, 1, 2]", "vertex_indices: [0, 1, 4]"), "from 0 to 3"),
    (SCENE.replace("vertex_indices: [0, 1, 2]", "vertex_indices: [0, 1]"), "three indices"),
    (SCENE.replace("{x: 0, y: 0, z: 1}]", "[0, 0, 0]]"), "in a plane"),
]


@pytest.mark.parametrize(("text", "words"), BAD)
def test_a_bad_file_is_one_clear_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value) and "scene.yaml" in str(caught.value)


def paths(data: Any) -> list[tuple[Any, ...]]:
    """The way to every value in nested data."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [()] + [(key, *rest) for key, value in items for rest in paths(value)]


EVERY = paths(yaml.safe_load(SCENE))
JUNK = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)


@given(
    st.sampled_from(EVERY[1:]),
    JUNK | st.lists(JUNK, max_size=4) | st.dictionaries(st.text(max_size=3), JUNK, max_size=2),
)
def test_any_value_in_any_place_is_read_or_refused_in_one_line(path: tuple[Any, ...], value: Any) -> None:
    from optik.scene.files import scene_from_moveit

    data = yaml.safe_load(SCENE)
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    try:
        optik.Scene(**scene_from_moveit(yaml.safe_dump(data)))
    except OptikError as error:
        assert "\n" not in str(error)


if "MBM" in os.environ:  # a folder with the archives of MotionBenchMaker, which are not part of this project

    @pytest.mark.parametrize("robot", ["panda", "ur5"])
    def test_every_scene_of_motion_bench_maker_is_read(tmp_path: Path, robot: str) -> None:
        count = 0
        with tarfile.open(Path(os.environ["MBM"]) / f"{robot}.tar.bz2") as archive:
            for member in archive:
                if member.isfile() and Path(member.name).name.startswith("scene"):
                    content = archive.extractfile(member)
                    assert content is not None
                    scene = load(tmp_path, content.read().decode())
                    assert len(scene.boxes) + len(scene.cylinders) == len(scene.names) >= 7
                    count += 1
        assert count == 700
