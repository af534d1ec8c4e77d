"""Limits that makers publish: in URDF, in TOML and in joint_limits.yaml, and arms whose limits these are."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import optik
from optik.arm.limits import JointLimits, VelocityByPosition
from optik.errors import InvalidInput, RobotModelError
from planners import load_limits


def limited() -> optik.Robot:
    slowed = VelocityByPosition(
        np.array([0.1, 0.2, 0.3, 0.0, 0.1, 0.7]), np.array([1.0, 2.0, np.inf, 4.0, 5.0, 1.0 / 7.0])
    )
    own = JointLimits(
        np.full(6, -2.0), np.full(6, 2.5), 3.0, np.array([8.0, 8.0, 8.0, 9.0, 9.0, 0.1 + 0.2]), 100.0,
        deceleration=np.array([12.0, 12.0, 12.0, np.inf, 10.0, 1.0 / 3.0]), velocity_by_position=slowed,
    )  # fmt: skip
    return replace(optik.load("ur5e"), limits=own, inertia=None)


def test_urdf_json_and_pickle_keep_them_to_the_last_bit() -> None:
    robot = limited()
    for again in (
        optik.Robot.from_urdf(robot.to_urdf(), tip="tool", base="base"),
        optik.Robot.from_dict(json.loads(json.dumps(robot.to_dict()))),
        pickle.loads(pickle.dumps(robot)),
    ):
        for field in ("acceleration", "deceleration", "jerk"):
            assert (getattr(again.limits, field) == getattr(robot.limits, field)).all()
        kept = again.limits.velocity_by_position
        finite = np.isfinite(kept.deceleration)
        assert (kept.deceleration == robot.limits.velocity_by_position.deceleration).all()
        assert (kept.offset[finite] == robot.limits.velocity_by_position.offset[finite]).all()
    assert optik.Robot.from_dict(robot.to_dict()) == robot and hash(pickle.loads(pickle.dumps(robot))) == hash(robot)


def test_robots_that_differ_in_them_are_different() -> None:
    robot = limited()
    for change in (
        {"deceleration": None}, {"velocity_by_position": None},
        {"velocity_by_position": VelocityByPosition(np.zeros(6), np.ones(6))}, {"deceleration": np.full(6, 12.0)},
    ):  # fmt: skip
        other = replace(robot, limits=robot.limits.replace(**change))
        assert other != robot and other.fingerprint != robot.fingerprint


@pytest.mark.parametrize(
    ("attributes", "child", "words"),
    [
        ('acceleration="-1"', "", "acceleration -1"),
        ('jerk="x"', "", "jerk is 'x'"),
        ("", '<position_based_velocity_limits velocity_offset="0.3"/>', "deceleration_limit 0"),
        ("", '<position_based_velocity_limits velocity_offset="-0.3" deceleration_limit="1"/>', "velocity_offset -0.3"),
        (
            "",
            '<position_based_velocity_limits velocity_offset="0.3" deceleration_limit="inf"/>',
            "deceleration_limit is 'inf'",
        ),
    ],
)
def test_wrong_values_of_a_urdf_name_joint_and_attribute(attributes: str, child: str, words: str) -> None:
    text = f"""<robot name="one"><link name="a"/><link name="b"/><joint name="first" type="revolute"><parent link="a"/>
      <child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1" {attributes}/>{child}</joint>
      </robot>"""
    with pytest.raises(RobotModelError, match=words) as caught:
        optik.Robot.from_urdf(text)
    assert "'first'" in str(caught.value) and "\n" not in str(caught.value)


def test_a_toml_file_states_them(tmp_path: Path) -> None:
    text = (Path(optik.__file__).parent / "robots" / "ur5.toml").read_text(encoding="utf-8")
    slowed = "{ offset = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1], deceleration = [1, 2, 3, 4, 5, 6] }"
    rows = f"velocity = 3.0\nacceleration = 8.0\ndeceleration = 12.0\nvelocity_by_position = {slowed}"
    file = tmp_path / "mine.toml"
    file.write_text(text.replace("velocity = 3.141592653589793", rows), encoding="utf-8")
    robot = optik.load(file)
    assert (robot.limits.deceleration == 12.0).all() and robot.limits.velocity_by_position.deceleration[5] == 6.0
    for wrong, words in (
        ("deceleration = 12.0", "deceleration = -12.0"),
        ("offset = [0.1,", "offset = [-0.1,"),
        ("offset", "offsets"),
    ):
        file.write_text(text.replace("velocity = 3.141592653589793", rows.replace(wrong, words)), encoding="utf-8")
        with pytest.raises(InvalidInput, match=r"deceleration|offset"):
            optik.load(file)


UR_YAML = """
joint_limits:
  joint1: {has_acceleration_limits: false, has_position_limits: true, has_velocity_limits: true, max_effort: 54.0,
           max_position: !degrees  180.0, max_velocity: !degrees  90.0, min_position: !degrees -180.0}
  joint2: {has_velocity_limits: true, max_velocity: 1.5, has_deceleration_limits: true, max_deceleration: -4.0,
           has_acceleration_limits: true, max_acceleration: 3.0}
"""


def test_yaml_in_degrees_and_with_decelerations(tmp_path: Path) -> None:
    file = tmp_path / "joint_limits.yaml"
    file.write_text(UR_YAML, encoding="utf-8")
    with pytest.warns(optik.errors.AssumptionWarning, match="max_effort"):
        robot, limits = load_limits(file, optik.load("ur5e"))
    assert robot.limits.lower[0] == -np.pi and robot.limits.upper[0] == np.pi
    assert limits.velocity[0] == np.pi / 2.0 and limits.velocity[1] == 1.5
    assert robot.limits.deceleration.tolist() == [np.inf, 4.0, np.inf, np.inf, np.inf, np.inf]
    assert limits.value("acceleration_by_velocity").deceleration[1] == 4.0
    for wrong, words in (("-4.0", "below 0"), ("-4.0", "below 0"), ("!degrees  90.0", "YAML|number")):
        file.write_text(UR_YAML.replace(wrong, {"-4.0": "4.0"}.get(wrong, "!degrees fast")), encoding="utf-8")
        with pytest.raises(InvalidInput, match=words):
            load_limits(file, optik.load("ur5e"))
