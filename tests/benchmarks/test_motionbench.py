"""Motion problems in MotionBenchMaker's wording: ten generated ones are read, and their ways are found."""

from __future__ import annotations

import io
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import optik
from benchmarks.problems.motionbench import END_ROOM, follow_curobo, read_archive, read_problem, write_problems
from optik import JointLimits, Robot
from optik.errors import InvalidInput
from optik.scene.contact import find_contact, find_nearest_pairs
from planners import find_path
from tests.planners.contacts import Oracle

pytest.importorskip("yaml")
GRASPING = ("hand", "fingers")
SCENE = """
allowed_collision_matrix:
  entry_names: [other_link, cup]
  entry_values: [[false, true], [true, false]]
world:
  collision_objects:
    - id: cup
      primitives: [{type: cylinder, dimensions: [0.1, 0.02]}]
      primitive_poses: [{position: [%g, %g, %g], orientation: [0, 0, 0, 1]}]
"""
REQUEST = """
start_state: {joint_state: {name: [%s], position: %s}}
goal_constraints: [{joint_constraints: [%s]}]
"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return optik.load("panda_hand")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Path:
    made = tmp_path_factory.mktemp("problems") / "ten.tar.bz2"
    write_problems(made, robot, seed=26)
    return made


def write(file: Path, **texts: str) -> Path:
    with tarfile.open(file, "w") as archive:
        for name, text in texts.items():
            member = tarfile.TarInfo(f"problems/table_pick_panda/{name}0007.yaml")
            member.size = len(text.encode())
            archive.addfile(member, io.BytesIO(text.encode()))
    return file


def test_ten_problems_have_free_ends_and_a_way_around_the_obstacles(file: Path, robot: Robot) -> None:
    problems = list(read_archive(file))
    assert problems == [(kind, k) for kind in ("table_boxes", "table_cylinders") for k in range(1, 6)]
    assert len({texts["scene"] for texts in read_archive(file).values()}) == 10
    for kind, number in problems:
        scene, start, goal, _ = read_problem(file, kind, number, robot)
        shapes = scene.cylinders if kind == "table_cylinders" else scene.boxes
        assert len(scene.names) == 6 and len(shapes) == (5 if kind == "table_cylinders" else 6)
        ends = np.array([start, goal])
        assert robot.limits.contains(ends).all() and (find_nearest_pairs(robot, scene, ends)[0] > END_ROOM).all()
        assert find_path(robot, start, goal, scene=scene, paths=1, shortcuts=0), (kind, number)


def test_the_straight_motion_between_the_ends_is_in_contact_by_coal(file: Path, robot: Robot) -> None:
    pytest.importorskip("coal")
    for kind, number in read_archive(file):
        scene, start, goal, _ = read_problem(file, kind, number, robot)
        between = Oracle(robot, scene).near(np.linspace(start, goal, 100), 0.05, 0.05)
        assert min(between.scene.min(), between.own.min()) < 0.0, (kind, number)


def test_a_seed_gives_equal_problems_and_a_larger_count_begins_with_them(
    tmp_path: Path, file: Path, robot: Robot
) -> None:
    write_problems(tmp_path / "three.tar.bz2", robot, seed=26, count=3)
    three = read_archive(tmp_path / "three.tar.bz2")
    assert len(three) == 3 and all(read_archive(file)[key] == texts for key, texts in three.items())
    write_problems(tmp_path / "other.tar.bz2", robot, seed=27, count=1)
    assert read_archive(tmp_path / "other.tar.bz2")["table_boxes", 1] != three["table_boxes", 1]


def test_the_grasped_object_may_be_touched_by_the_hand_alone(tmp_path: Path, robot: Robot) -> None:
    start = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    goal = start + np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    order = [2, 0, 1, 3, 4, 5, 6]  # joints are found by name; the file's have a prefix, and it names fingers, too
    names = [f"panda_{robot.joint_names[k]}" for k in order]
    joints = ", ".join(f"{{joint_name: panda_{robot.joint_names[k]}, position: {goal[k]}}}" for k in reversed(order))
    request = REQUEST % (", ".join(["panda_finger_joint1", *names]), [0.04, *start[order].tolist()], joints)
    made = write(tmp_path / "grasp.tar", scene=SCENE % tuple(robot.fk(goal)[:3, 3]), request=request)
    scene, *ends, moved = read_problem(made, "table_pick", 7, robot, GRASPING)
    assert not moved
    assert np.array_equal(ends, [start, goal])
    assert sorted(scene.allow) == [("fingers", "cup"), ("hand", "cup")]
    assert read_problem(made, "table_pick", 7, robot).scene.allow == (("other_link", "cup"),)
    made = write(tmp_path / "base.tar", scene=SCENE % (0.0, 0.0, 0.1), request=request)  # touched by the base
    assert not read_problem(made, "table_pick", 7, robot, GRASPING).scene.allow


def test_the_rules_of_curobo_change_start_goal_cylinders_and_add_a_stand(tmp_path: Path, robot: Robot) -> None:
    goal = np.array([0.9, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    joints = ", ".join(
        f"{{joint_name: {name}, position: {q}}}" for name, q in zip(robot.joint_names, goal, strict=True)
    )
    request = REQUEST % (", ".join(robot.joint_names), [0.5] * 7, joints)
    scene = SCENE.replace("0.02]", "0.03]") % (0.6, 0.0, 0.3)
    before = read_problem(write(tmp_path / "can.tar", scene=scene, request=request), "table_pick", 7, robot, GRASPING)
    after = follow_curobo(robot, before)
    assert before.scene.cylinders[0][2] == 0.03 and after.scene.cylinders[0][2] == 0.01
    assert after.scene.names == ("stand", "cup") and np.array_equal(after.scene.boxes[0][1], [0.3, 0.25, 0.8])
    assert np.array_equal(after.goal, robot.fk(goal)) and after.start[1] == -0.785
    found = find_path(robot, after.start, after.goal, scene=after.scene, paths=1)
    assert found and np.abs(robot.fk(found.vertices[-1]) - after.goal).max() <= 1e-6
    assert find_contact(robot, *after[:2]).room > 0.0


def test_ends_beyond_a_printed_limit_by_its_rounding_are_moved_onto_it(tmp_path: Path, robot: Robot) -> None:
    lower, upper = np.full(7, -3.14159), np.full(7, 3.14159)
    printed = replace(robot, limits=JointLimits(lower, upper, robot.limits.velocity))
    for goal, inside in ((np.pi, 3.14159), (-np.pi, -3.14159), (3.141595001, None), (3.1415, 3.1415), (-3.2, None)):
        joints = ", ".join(f"{{joint_name: {name}, position: {goal!r}}}" for name in robot.joint_names)
        request = REQUEST % (", ".join(robot.joint_names), [0.5] * 7, joints)
        made = write(tmp_path / f"{goal}.tar", scene=SCENE % (1, 1, 1), request=request)
        problem = read_problem(made, "table_pick", 7, printed)
        assert np.array_equal(problem.goal, np.full(7, goal if inside is None else inside))
        assert problem.moved == (inside is not None and inside != goal)


@pytest.mark.parametrize("form", ["%s", "panda_%s", "%s_joint", "left_%s_1"])
def test_joints_are_found_by_equal_names_or_by_one_prefix_and_suffix(tmp_path: Path, robot: Robot, form: str) -> None:
    named = replace(robot, joint_names=tuple(form % name for name in robot.joint_names))
    end = np.array([1e-05, -0.5, 0.5, -1.0, 0.0, 1.0, 2.0])
    for one, other in ((robot, named), (named, robot)):
        joints = ", ".join(
            f"{{joint_name: {name}, position: {q}}}" for name, q in zip(one.joint_names, end, strict=True)
        )
        request = REQUEST % (", ".join(one.joint_names), end.tolist(), joints)
        made = write(tmp_path / f"{one.joint_names[0]}.tar", scene=SCENE % (1, 1, 1), request=request)
        assert np.array_equal(read_problem(made, "table_pick", 7, other).goal, end)


@pytest.mark.parametrize(
    "names",
    [
        [
            "shoulder_pan_joint",
            "shoulder_lift_joint",
            "elbow_joint",
            "wrist_1_joint",
            "wrist_2_joint",
            "wrist_3_joint",
            "a",
        ],
        [f"panda_joint{k}" for k in range(1, 7)],
        [f"panda_joint{k}" for k in range(2, 9)],
        ["joint1", *(f"panda_joint{k}" for k in range(2, 8))],
        [f"joint{k}" for k in range(1, 7)] + ["finger_joint7"],
        [f"axis{k}" for k in range(1, 8)],
    ],
)
def test_other_joints_are_refused_in_one_line_with_both_lists(tmp_path: Path, robot: Robot, names: list[str]) -> None:
    joints = ", ".join(f"{{joint_name: {name}, position: 0.5}}" for name in names)
    request = REQUEST % (", ".join(names), [0.5] * len(names), joints)
    made = write(tmp_path / "other.tar", scene=SCENE % (1, 1, 1), request=request)
    with pytest.raises(InvalidInput) as caught:
        read_problem(made, "table_pick", 7, robot)
    assert ", ".join(names) in str(caught.value) and ", ".join(robot.joint_names) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_files_fail_with_one_line(tmp_path: Path, file: Path, robot: Robot) -> None:
    with pytest.raises(InvalidInput, match="a tar file of problems"):
        read_archive(tmp_path / "none.tar.bz2")
    (tmp_path / "text.tar.bz2").write_text("no tar file")
    with pytest.raises(InvalidInput, match=r"a tar file of problems.*text\.tar\.bz2") as caught:
        read_archive(tmp_path / "text.tar.bz2")
    assert "\n" not in str(caught.value)
    with pytest.raises(InvalidInput, match="scene0001"):
        read_archive(write(tmp_path / "half.tar", scene=SCENE))
    with pytest.raises(InvalidInput, match="table_boxes, table_cylinders"):
        read_problem(file, "cage", 1, robot)
    alone = ", ".join(f"{{joint_name: joint{k}, position: 1e-5}}" for k in range(1, 8))
    for request in ("[]", "start_state: {}", REQUEST % ("a", [0.0], ""), REQUEST % ("joint1", [0.0], alone)):
        made = write(tmp_path / f"{len(request)}.tar", scene=SCENE % (1, 1, 1), request=request)
        with pytest.raises(InvalidInput, match=r"start_state|the joints joint1"):
            read_problem(made, "table_pick", 7, robot)
