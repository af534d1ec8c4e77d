"""Arms whose base is turned: gravity is down in the frame of the root link, in files, MuJoCo and comparisons too."""

import json
import pickle
import warnings
from math import pi

import mujoco
import numpy as np
import pytest

import optik
from optik import Robot
from optik.arm.mjcf_writer import mujoco_model
from optik.errors import InvalidInput, MovingMountWarning, RobotModelError, RobotModelWarning
from tests.oracles.mounts import MountedGravity, random_mounted

WALL = f"""<robot name="wall"><link name="world"/><link name="plate"/>
  <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="mount" type="fixed"><parent link="world"/><child link="plate"/><origin rpy="{pi / 2} 0 0"/></joint>
  <joint name="j" type="revolute"><parent link="plate"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="100" velocity="2"/></joint></robot>"""
TURRET = WALL.replace(
    'name="mount" type="fixed"', 'name="mount" type="revolute"'
).replace("</joint>", '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>', 1)  # fmt: skip
WEIGHT = 10.0 * 9.80665 * 0.5
"""Torque of gravity at joint value 0 [N·m]."""


def read(arm, **options):
    """The arm, and the moving joints before its base that warnings name."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = Robot.from_urdf(arm.urdf, arm.tip, **options)
    assert all(w.category is MovingMountWarning for w in caught)
    assert len(caught) <= 1
    return robot, str(caught[0].message) if caught else ""


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("seed", range(15))
def test_torques_of_gravity_are_pinocchios_by_every_way_to_the_arm(seed, moving, tmp_path):
    rng = np.random.default_rng((seed, moving))
    arm = random_mounted(rng, moving=moving)
    oracle, (robot, warning) = MountedGravity(arm.urdf), read(arm, base=arm.base)
    assert all(name in warning for name in arm.moving)
    assert bool(warning) == moving
    whole, silent = read(arm)
    assert not silent
    assert whole.joint_names == (*arm.moving, *arm.joints)
    (tmp_path / "table.toml").write_text(arm.table, encoding="utf-8")
    (tmp_path / "arm.json").write_text(json.dumps(robot.to_dict()), encoding="utf-8")
    table, again = optik.load(tmp_path / "table.toml"), optik.load(tmp_path / "arm.json")
    moved = robot.with_base(optik.se3.pose(optik.se3.exp_so3(rng.normal(size=3)), rng.normal(size=3)))
    model = mujoco_model(moved)
    data = mujoco.MjData(model)
    for q in rng.uniform(-3, 3, (5, robot.n)):
        torques = oracle.torques(arm.joints, q)
        for other in (robot, table, again, moved):
            assert np.abs(other.gravity_torques(q) - torques).max() < 1e-10
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        assert np.abs(data.qfrc_bias - torques).max() < 1e-10
        every = np.concatenate([rng.uniform(-3, 3, len(arm.moving)), q])
        assert np.abs(whole.gravity_torques(every) - oracle.torques(whole.joint_names, every)).max() < 1e-10
    assert again == robot
    for other in (table, again, moved) if moving else (table, again, moved, whole):
        found = robot.compare(other)
        assert found.explained
        assert found.gravity == 0.0
        assert "gravity" not in str(found)
    found = robot.compare(robot.with_gravity((0, 0, -1)))
    assert found.agree
    angle = np.arccos(np.clip(-robot.gravity[2], -1.0, 1.0))
    assert abs(found.gravity - angle) < 1e-6
    assert ("gravity differs by" in str(found)) == (found.gravity > 0.0)


def test_an_arm_on_a_wall_holds_its_weight_however_it_is_loaded(tmp_path):
    file = tmp_path / "wall.urdf"
    file.write_text(WALL)
    for robot in (
        Robot.from_urdf(WALL), Robot.from_urdf(WALL, base="plate"), optik.load(file), optik.load(f"{file}#base=plate"),
    ):  # fmt: skip
        assert abs(robot.gravity_torques([0.0])[0] - WEIGHT) < 1e-9
    assert Robot.from_urdf(WALL).gravity.tolist() == [0.0, 0.0, -1.0]  # to the last bit, as all files had it
    assert repr(Robot.from_urdf(WALL)) == "Robot('wall', 1 joints)"
    assert repr(Robot.from_urdf(WALL, base="plate")) == "Robot('wall', 1 joints, gravity (0, -1, 0))"


def test_a_given_direction_is_that_of_the_base_and_nothing_is_warned_of(tmp_path):
    for text in (WALL, TURRET):
        file = tmp_path / "arm.urdf"
        file.write_text(text)
        for robot in (
            Robot.from_urdf(text, base="plate", gravity=(0, 0, -2)),
            optik.load(file, base="plate", gravity=[0, 0, -1]),
            optik.load(f"{file}#base=plate&gravity=0,0,-1"),
        ):
            assert robot.gravity.tolist() == [0.0, 0.0, -1.0]
            assert abs(robot.gravity_torques([0.0])[0]) < 1e-12
    assert optik.load("ur5e", gravity=(0, 1, 0)) == optik.load("ur5e").with_gravity((0, 1, 0))
    with pytest.raises(InvalidInput, match="three numbers"):
        optik.load(f"{file}#base=plate&gravity=down")
    with pytest.raises(RobotModelError, match="gravity"):
        optik.load(f"{file}#base=plate&gravity=0,1")


def test_a_moving_joint_before_the_base_stands_at_zero_and_one_warning_names_it():
    with pytest.warns(MovingMountWarning, match="joint mount moves the base 'plate'") as caught:
        robot = Robot.from_urdf(TURRET, base="plate")
    assert len(caught) == 1
    assert issubclass(MovingMountWarning, RobotModelWarning)
    assert (caught[0].filename, caught[0].message.robot) == (__file__, "wall")
    again = pickle.loads(pickle.dumps(caught[0].message))  # from another process
    assert (type(again), str(again)) == (MovingMountWarning, str(caught[0].message))
    assert abs(robot.gravity_torques([0.0])[0] - WEIGHT) < 1e-9


def test_a_robot_file_without_gravity_has_minus_z():
    for name in ("ur5e", "panda"):
        assert optik.load(name).gravity.tolist() == [0.0, 0.0, -1.0]
