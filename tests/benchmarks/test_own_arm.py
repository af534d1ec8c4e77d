"""An arm of the user: what is missing is said at once, the first motion succeeds, and other packages' robots can be loaded."""

import itertools
import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
from benchmarks.cli.command import Start
from benchmarks.cli.plan import choose_branch
from benchmarks.report import write_report
from benchmarks.run import run_suite
from benchmarks.suite import load_suite
from optik.errors import InvalidInput
from optik.plugins.files import forbid_code
from planners import Line, MotionLimits, plan
from tests.optik.test_robot_files import LISTS
from tests.oracles import REPOSITORY

Typed = Callable[..., tuple[Any, str, str]]

CAMERA = (
    '<link name="camera"/><joint name="c" type="fixed"><parent link="link6"/><child link="camera"/></joint></robot>'
)
ARM = (REPOSITORY / "examples" / "arm.urdf").read_text()
XACRO = """<?xml version="1.0"?>
<robot name="three" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.4"/>
  <xacro:macro name="segment" params="i parent">
    <link name="l${i}"/>
    <joint name="j${i}" type="revolute">
      <parent link="${parent}"/><child link="l${i}"/>
      <origin xyz="0 0 $(arg length)"/><axis xyz="0 ${i % 2} ${1 - i % 2}"/>
      <limit lower="-2" upper="2" velocity="3" effort="10"/>
    </joint>
  </xacro:macro>
  <link name="base"/>
  <xacro:segment i="1" parent="base"/><xacro:segment i="2" parent="l1"/><xacro:segment i="3" parent="l2"/>
</robot>
"""


@pytest.fixture
def two_tools(tmp_path: Path) -> Path:
    file = tmp_path / "two.urdf"
    file.write_text(ARM.replace("</robot>", CAMERA))
    return file


def test_one_message_names_all_that_is_missing_and_the_next_command_succeeds(two_tools: Path, typed: Typed) -> None:
    status, _, said = typed("plan", "line", "--robot", str(two_tools))
    assert status == 2
    assert "for example --acceleration 10 --jerk 50" in said
    assert said.strip().count("\n") <= 1
    status, _, said = typed("plan", "line", "--robot", str(two_tools), "--acceleration", "10", "--jerk", "50")
    assert status == 0, said


def test_a_tip_that_must_be_named_is_asked_for_with_the_limits(tmp_path: Path, typed: Typed) -> None:
    (tmp_path / "arms.urdf").write_text(LISTS["two arms"][0])
    status, _, said = typed("plan", "line", "--robot", str(tmp_path / "arms.urdf"))
    assert status == 2
    assert "--tip left6" in said and "--acceleration 10 --jerk 50" in said


def test_the_default_start_reaches_a_decimetre_in_every_direction(two_tools: Path) -> None:
    robot = optik.load(two_tools)
    q = optik.choose_start(robot)
    T, limits, solved = robot.fk(q), MotionLimits.of(robot, acceleration=10.0, jerk=100.0), 0
    for direction in itertools.product((-1.0, 0.0, 1.0), repeat=3):
        if any(direction):
            move = 0.1 * np.array(direction) / np.linalg.norm(direction)
            line = Line(T, optik.se3.pose(T[:3, :3], T[:3, 3] + move))
            branch = choose_branch(Start(robot, q, "", is_random=True), line)
            solved += bool(plan(robot, line, q, branch=branch, limits=limits))
    assert solved >= 24


def test_robots_shows_an_arm(two_tools: Path, typed: Typed) -> None:
    assert typed("robots", "ur5e")[1].strip() == str(optik.load("ur5e"))
    assert typed("robots", str(two_tools))[0] == 0
    assert optik.Robot.from_dict(json.loads(typed("robots", "ur5e", "--json")[1])) == optik.load("ur5e")
    status, _, said = typed("robots", "ur5f")
    assert status == 2 and "did you mean" in said


def test_a_table_of_joints_has_the_numbers_of_the_arm() -> None:
    robot = optik.load("irb910sc")  # with a prismatic joint
    lines = str(robot).splitlines()
    for i, line in enumerate(lines[2 : 2 + robot.n]):
        slides = robot.prismatic[i]
        factor, unit = (1e3, "mm") if slides else (180.0 / np.pi, "°")
        limits = robot.limits
        assert line.split()[:2] == [robot.joint_names[i], "prismatic" if slides else "revolute"]
        assert f"{factor * limits.lower[i]:.4g} to {factor * limits.upper[i]:.4g} {unit}" in line
        if limits.velocity is not None:
            assert f"{factor * limits.velocity[i]:.4g} {unit}/s" in line


# ---------------------------------------------------------------- robots of other packages
def test_a_xacro_file_is_expanded_with_its_arguments(tmp_path: Path) -> None:
    file = tmp_path / "three.urdf.xacro"
    file.write_text(XACRO)
    for length, options in ((0.4, ""), (0.25, "#length=0.25"), (0.25, "#length=0.25&tip=l3")):
        robot = optik.load(f"{file}{options}")
        assert robot.n == 3
        assert robot.fk(np.zeros(3))[2, 3] == pytest.approx(3 * length, abs=1e-12)
    file.write_text(XACRO.replace("i % 2", "i % nothing", 1))
    with pytest.raises(InvalidInput, match="nothing"):
        optik.load(file)
    with forbid_code(), pytest.raises(InvalidInput, match="runs no code"):
        optik.load(file)
    with pytest.raises(InvalidInput, match="options of a URDF"):
        optik.load(f"{REPOSITORY / 'examples' / 'arm.urdf'}#length=3")


def test_packages_of_a_xacro_file_are_found_beside_its_own(tmp_path: Path, typed: Typed) -> None:
    values = "<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:property name='far' value='{}'/></robot>"
    head, include = XACRO.split("<xacro:arg", 1)[0], '<xacro:include filename="$(find arm_values)/far.xacro"/>'
    ball = '<collision><geometry><mesh filename="package://arm_values/ball.obj"/></geometry></collision>'
    joint = '<joint name="j" type="revolute"><parent link="base"/><child link="tool"/><origin xyz="${far} 0 0"/>'
    limit = '<limit lower="-2" upper="2" velocity="3" effort="10"/></joint></robot>'
    links = f'<link name="base">{ball}</link><link name="tool"/>'
    for place, far in (("a", 0.25), ("b", 0.5)):
        file = tmp_path / place / "arm_support" / "urdf" / "arm.xacro"
        file.parent.mkdir(parents=True)
        file.write_text(head + include + links + joint + limit)
        beside = tmp_path / place / "arm_values"
        beside.mkdir()
        (beside / "far.xacro").write_text(values.format(far))
        (beside / "ball.obj").write_text("v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
        arm = optik.load(file, shapes=True)
        assert arm.fk([0.0])[0, 3] == far and arm.shapes is not None and arm.shapes.m
    (tmp_path / "b" / "arm_values").rename(tmp_path / "elsewhere")
    with pytest.raises(InvalidInput, match=r"arm_values.*package_dirs"):
        optik.load(file)
    given: list[Any] = [{"arm_values": tmp_path / "elsewhere"}, [tmp_path / "a"]]
    assert [optik.load(file, package_dirs=dirs).fk([0.0])[0, 3] for dirs in given] == [0.5, 0.25]
    status, _, said = typed("fk", "10", "-r", str(file))
    assert status == 2 and "--package-dir" in said and "package_dirs" not in said
    here = ("--package-dir", str(tmp_path / "a"))
    for words in (("fk", "10", "-r"), ("ik", "--xyz", "0.25,0,0", "-r"), ("robots",)):
        status, out, said = typed(*words, str(file), *here)
        assert status == 0 and (words[0] == "ik" or "0.25" in out or "(250" in out), said
    suite = tmp_path / "own.toml"
    assert typed("bench", "new", str(suite), "-r", str(file), *here)[0] == 0
    assert f"packages={tmp_path / 'a'}" in suite.read_text()


def test_pairs_of_an_srdf_are_left_out_by_load_and_by_commands(tmp_path: Path, typed: Typed) -> None:
    ball = "<collision><geometry><sphere radius='0.05'/></geometry></collision>"
    text = ARM.replace('<link name="link6"/>', f'<link name="link6">{ball}</link>')
    text = text.replace('<link name="link3"/>', f'<link name="link3">{ball}</link>')
    file, srdf = tmp_path / "arm.urdf", tmp_path / "arm.srdf"
    file.write_text(text)
    srdf.write_text('<robot name="r"><disable_collisions link1="link3" link2="link6" reason="Never"/></robot>')
    arm = optik.load(file, srdf=srdf)
    assert arm.shapes is not None and ("link3", "link6", "Never") in arm.shapes.left_out
    status, out, _ = typed("robots", str(file), "--srdf", str(srdf), "--tip", "link6", "--json")
    assert status == 0 and optik.Robot.from_dict(json.loads(out)) == optik.load(file, srdf=srdf, tip="link6")
    status, _, said = typed("robots", "ur5e", "--srdf", str(srdf))
    assert status == 2 and "--srdf" in said and "is no URDF" in said
    with pytest.raises(InvalidInput, match="package_dirs"):
        optik.load("ur5e", package_dirs=[tmp_path])


def test_a_description_is_read_from_the_cache_of_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    repository = tmp_path / "example-robot-data"
    file = repository / "robots" / "panda_description" / "urdf" / "panda.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(ARM)
    git = ("git", "-C", str(repository), "-c", "user.name=t", "-c", "user.email=t@t")
    for command in (("init", "-q"), ("add", "."), ("commit", "-qm", "arm")):
        subprocess.run([*git, *command], check=True)
    commit = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()
    cache = tmp_path / "cache" / f"example-robot-data-{commit}"
    cache.mkdir(parents=True)
    repository.rename(cache / "example-robot-data")
    monkeypatch.setitem(os.environ, "ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setitem(os.environ, "ROBOT_DESCRIPTION_COMMIT", commit)
    name = "robot_descriptions:panda_description"
    assert optik.load(name) == optik.Robot.from_urdf(ARM)
    assert optik.load(f"{name}#tip=link6").joint_names == optik.Robot.from_urdf(ARM, "link6").joint_names
    for wrong in ("robot_descriptions:", "robot_descriptions:os", "robot_descriptions:none_such_description"):
        with pytest.raises(InvalidInput):
            optik.load(wrong)


def test_a_vendors_arm_with_the_name_of_one_of_ours_runs_in_a_suite(tmp_path: Path) -> None:
    (tmp_path / "ur5e.urdf").write_text(ARM)
    block = (
        '\n[[budgets]]\nid = "{0}"\ntitle = "{0}"\nrobot = "{1}"\nset = "random_reachable"\noptions = {{ count = 5 }}\n'
        'budgets = [50]\nmethods = [{{ solver = "lm" }}]\n'
    )
    text = block.format("theirs", "./ur5e.urdf") + block.format("ours", "ur5e")
    (tmp_path / "suite.toml").write_text(f'title = "Two arms of one name"\nseed = 1\n{text}')
    run = run_suite(load_suite(tmp_path / "suite.toml"), tmp_path / "run")
    page = write_report(run).read_text(encoding="utf-8")
    assert "ur5e.urdf" in page
