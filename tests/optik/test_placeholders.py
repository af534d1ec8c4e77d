"""Limits of a URDF that are probably none are said when it is read, with the option that ignores them."""

import warnings

import numpy as np
import pytest

import optik
from benchmarks.cli.command import translate
from optik import Robot
from optik.errors import RobotModelWarning

MASS = (
    '<inertial><origin xyz="0.2 0 0"/><mass value="3"/>'
    '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def arm(efforts, velocities, mass=MASS):
    """URDF of horizontal joints 0.3 m apart."""
    links = "".join(f'<link name="l{i}">{mass}</link>' for i in range(len(efforts) + 1))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0.3 0 0"/>'
        f'<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="{effort}" velocity="{velocity}"/></joint>'
        for i, (effort, velocity) in enumerate(zip(efforts, velocities, strict=True))
    )
    return f'<robot name="a">{links}{joints}</robot>'


def said(text):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = Robot.from_urdf(text)
    assert all(issubclass(each.category, RobotModelWarning) for each in caught)
    return robot, [str(each.message) for each in caught]


def test_one_effort_that_cannot_hold_the_arm_is_asked_about_and_the_option_ignores_it():
    robot, (words,) = said(arm([1, 1, 1], [1, 1, 1]))
    q = robot.limits.sample(np.random.default_rng(0), 64)
    held = (np.abs([robot.torques(x, np.zeros(3), np.zeros(3)) for x in q]) <= 1.0).all(axis=1).mean()
    assert f"effort 1 on all joints: a placeholder? it holds the arm against gravity in {held:.0%} of 64" in words
    assert "with_limits(torque=None) ignores it" in words and "--torque none ignores it" in translate(words)
    assert robot.with_limits(torque=None).limits.torque is None


@pytest.mark.parametrize(
    ("efforts", "mass"), [([1, 1, 1], ""), ([200, 200, 200], MASS), ([1, 2, 1], MASS), ([0, 0, 0], MASS), ([1], MASS)]
)
def test_efforts_that_hold_the_arm_differ_or_cannot_be_judged_are_taken(efforts, mass):
    assert said(arm(efforts, [1] * len(efforts), mass))[1] == []


@pytest.mark.parametrize(
    ("efforts", "velocities", "names"),
    [
        ([5, 6, 7], [1, 0, 1], "j1"),
        ([1000] * 3, [0, "0.0", 0], "j0, j1, j2"),
        ([0, 0, 0], [0, 0, 0], None),
        ([5, 6, 7], [0, 0, 0], None),
    ],
)
def test_a_velocity_of_0_beside_other_limits_is_named_and_read_as_unknown(efforts, velocities, names):
    robot, words = said(arm(efforts, velocities, ""))
    wanted = f"velocity 0 of joint {names}: read as unknown; with_limits(velocity=) sets it"
    assert [each.endswith(wanted) for each in words] == ([] if names is None else [True])
    assert all("--velocity sets it" in translate(each) for each in words)
    known = robot.limits.velocity
    assert known is None or (np.isinf(known) == [float(v) == 0.0 for v in velocities]).all()


def test_arms_that_ship_and_are_written_are_read_in_silence():
    for name in optik.robots():
        robot = optik.load(name)
        if np.isfinite(robot.limits.half).all() and robot.motors is None:
            assert said(robot.to_urdf())[1] == []
