"""The arm as a MuJoCo model: MuJoCo's own dynamics and kinematics are those of ours, whatever the arm's masses are."""

import sys
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

import optik
from optik.arm.inertia import Inertia
from optik.arm.mjcf_writer import ROD_DENSITY, _rod, assume_masses, mujoco_model, to_mjcf
from optik.errors import InvalidInput, MissingDependency, RobotModelError
from tests.robots import each_robot


def differences(robot, seed=0, states=20):
    """Largest differences from MuJoCo of torques, mass matrices and tool poses at random states."""
    heavy = assume_masses(robot)[0].with_inertia(coulomb=0.0)
    model = mujoco_model(heavy)
    data, rng, worst = mujoco.MjData(model), np.random.default_rng(seed), np.zeros(3)
    low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
    for _ in range(states):
        q, dq, ddq = rng.uniform(low, high), rng.normal(0.0, 2.0, robot.n), rng.normal(0.0, 10.0, robot.n)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        M = np.zeros((robot.n, robot.n))
        mujoco.mj_fullM(model, data, M)
        T = np.column_stack([data.site_xmat[0].reshape(3, 3), data.site_xpos[0]])
        pairs = ((data.qfrc_inverse, heavy.torques(q, dq, ddq)), (M, heavy.mass_matrix(q)), (T, heavy.fk(q)[:3]))
        worst = np.maximum(worst, [np.abs(a - b).max() for a, b in pairs])
    return worst


@each_robot
def test_torques_mass_matrices_and_tool_poses_are_those_of_mujoco(name):
    robot = optik.load(name)
    assert (differences(robot) <= 1e-9).all()
    if robot.inertia is not None:
        loaded = robot.with_payload(2.0, (0.01, 0.02, 0.05), np.diag([0.01, 0.02, 0.02]))
        assert (differences(loaded, 1) <= 1e-9).all()
        assert np.abs(differences(loaded.with_gravity((0.3, -0.2, 0.5), 3.0), 2)).max() <= 1e-9


def test_masses_that_mujoco_refuses_are_substituted_and_the_exact_ones_put_back():
    puma = optik.load("puma560")  # link 1 without mass; a moment of link 3 exceeds the sum of the others by 9 %
    assert (differences(puma.with_payload(1.0)) <= 1e-9).all()
    tensors = np.array(
        [np.diag([0.0, 1.0, 1.0]), np.diag([1.0, 1.0, 2.0]), np.zeros((3, 3))]
    )  # a rod, a plate, a point
    n = puma.n
    odd = Inertia(np.ones(n), np.full((n, 3), 0.1), tensors[np.arange(n) % 3], motor=0.1)
    assert (differences(puma.with_inertia(odd)) <= 1e-9).all()
    text = to_mjcf(puma)
    moments = np.array(ET.fromstring(text).findall(".//inertial")[2].get("diaginertia").split(), dtype=float)
    change = np.abs(np.linalg.eigvalsh(puma.inertia.tensor[2]) - moments).max()
    assert 0.0 < change <= 0.0075 / 3 + 1e-9  # the excess of 0.0075 kg·m², a third on each moment


def test_motors_saturate_at_the_torque_limits():
    robot = optik.load("paper6r")
    model = mujoco_model(robot)
    data = mujoco.MjData(model)
    data.ctrl[:] = [1e6, -1e6] * 3
    mujoco.mj_forward(model, data)
    assert np.array_equal(data.actuator_force, robot.limits.torque * np.array([1, -1] * 3))
    unlimited = mujoco_model(robot.with_limits(torque=None))
    data = mujoco.MjData(unlimited)
    data.ctrl[:] = 1e6
    mujoco.mj_forward(unlimited, data)
    assert np.array_equal(data.actuator_force, np.full(6, 1e6))


@pytest.mark.parametrize("limits", [False, True])
def test_position_limits_are_told_and_applied_only_on_request(limits):
    robot = optik.load("panda").with_gravity(magnitude=0.0)
    model = mujoco_model(robot, limits=limits)
    assert np.array_equal(model.jnt_range, np.column_stack([robot.limits.lower, robot.limits.upper]))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5 * (robot.limits.lower + robot.limits.upper)
    data.qpos[6] = robot.limits.upper[6] - 1e-3
    data.qvel[6] = 1.0
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert (data.qpos[6] < robot.limits.upper[6] + 5e-3) == limits


def test_friction_holds_an_arm_at_rest():
    model = mujoco_model(optik.load("paper6r").with_inertia(coulomb=200.0))
    data = mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos).max() <= 1e-5  # one second under its weight


def test_friction_of_moving_joints_has_the_sign_of_their_velocity():
    robot = optik.load("paper6r").with_payload(2.0)
    model, rng = mujoco_model(robot), np.random.default_rng(4)
    data = mujoco.MjData(model)
    for _ in range(20):
        q, dq = rng.uniform(-1.0, 1.0, 6), rng.choice([-1.0, 1.0], 6) * rng.uniform(0.2, 2.0, 6)
        torque = rng.normal(size=6)
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, dq, torque
        mujoco.mj_forward(model, data)
        expected = np.linalg.solve(robot.mass_matrix(q), torque - robot.torques(q, dq, np.zeros(6)))
        assert np.allclose(data.qacc, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_friction_stops_a_sliding_mass_where_it_must():
    limits = optik.JointLimits([-5.0], [5.0])
    given = Inertia([2.0], np.zeros((1, 3)), np.zeros((1, 3, 3)), motor=0.5, coulomb=4.0)
    slide = optik.Robot("slide", np.eye(4)[None], [True], np.eye(4), limits, gravity_magnitude=0.0, inertia=given)
    model = mujoco_model(slide)
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0
    mujoco.mj_step(model, data, nstep=2000)
    # From 1 m/s at f / m it takes m v² / 2 f, less half a step's way by the integrator.
    assert np.isclose(data.qpos[0], 2.5 / 8.0, rtol=0.0, atol=0.0005) and abs(data.qvel[0]) <= 1e-9


def test_names_are_kept_and_those_that_xml_cannot_hold_refused(tmp_path):
    base = optik.load("ur5e")
    named = optik.Robot('a <b> & "c"', base.fixed, base.prismatic, base.tool, base.limits, [*"äbc", "link1", "e'", "&"])
    text = to_mjcf(named, tmp_path / "arm.xml")
    assert (tmp_path / "arm.xml").read_text(encoding="utf-8") == text
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    assert [model.joint(i).name for i in range(6)] == list(named.joint_names)
    bad = optik.Robot("arm", base.fixed, base.prismatic, base.tool, base.limits, [*"abcde", "\x01"])
    with pytest.raises(RobotModelError, match="name in XML"):
        to_mjcf(bad)


def test_capsules_are_drawn_and_touch_nothing():
    robot = optik.load("panda")
    model = mujoco_model(robot)
    assert model.ngeom == robot.shapes.m
    assert not model.geom_contype.any() and not model.geom_conaffinity.any()
    assert np.isclose(mujoco.mj_getTotalmass(model), robot.inertia.mass.sum(), rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_an_assumed_rod_has_the_moments_of_its_discs(seed):
    rng = np.random.default_rng(seed)
    end, thickness = rng.normal(size=3) * (0.01, 1.0)[seed % 2], rng.uniform(0.05, 0.2)
    length = np.linalg.norm(end)
    mass, com, tensor = _rod(end, float(length), thickness)
    long, radius = max(length, thickness), 0.5 * thickness
    z = np.linspace(-0.5 * long, 0.5 * long, 20_001)
    across = np.trapezoid(0.25 * radius**2 + z**2, z) * ROD_DENSITY * np.pi * radius**2
    assert mass == pytest.approx(ROD_DENSITY * np.pi * radius**2 * long, rel=1e-12)
    np.testing.assert_allclose(com, 0.5 * end)
    assert end @ tensor @ end / length**2 == pytest.approx(0.5 * mass * radius**2, rel=1e-9)
    assert np.trace(tensor) == pytest.approx(2.0 * across + 0.5 * mass * radius**2, rel=1e-6)


@pytest.mark.parametrize("radius", [0.02, 0.3])
@pytest.mark.parametrize(("share", "kind"), [(0.99, "sphere"), (1.01, "capsule")])
def test_a_capsule_without_a_length_is_a_sphere(radius, share, kind):
    shapes = optik.Shapes([(1, (0, 0, 0), (share * 1e-9 * radius, 0, 0), radius)])
    geom = ET.fromstring(to_mjcf(optik.load("panda").with_shapes(shapes))).findall(".//geom")
    assert [x.get("type") for x in geom] == [kind]


def test_bad_input_is_refused():
    robot = optik.load("panda")
    with pytest.raises(InvalidInput, match="interval"):
        to_mjcf(robot.with_payload((1.0, 2.0)))
    with pytest.raises(InvalidInput, match="step"):
        to_mjcf(robot, step=0.0)


def test_without_mujoco_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    robot = optik.load("panda")
    assert to_mjcf(robot).startswith("<mujoco")  # text needs no package
    with pytest.raises(MissingDependency, match=r"optik-toolkit\[sim\]"):
        mujoco_model(robot)


# ---------------------------------------------------------------- masses that are assumed
def test_an_arm_with_masses_is_left_alone():
    robot = optik.load("panda")
    assert assume_masses(robot) == (robot, "")
    assert "assumed" not in to_mjcf(robot)


def test_assumed_masses_are_rods_along_the_links():
    rows = [{"a": 0.0, "alpha": 0.0, "d": 0.0, "theta": 0.0}, {"a": 1.0, "alpha": 0.0, "d": 0.0, "theta": 0.0}]
    tool = np.eye(4)
    tool[0, 3] = 1.0
    limits = optik.JointLimits([-3, -3], [3, 3], torque=[1.0, 1.0])
    robot = optik.Robot.from_mdh(rows, limits, tool=tool)
    heavy, assumed = assume_masses(robot)
    # Two solid cylinders of one metre, 0.2 m thick, of 1500 kg/m³.
    mass = 1500 * np.pi * 0.01
    assert np.allclose(heavy.inertia.mass, mass)
    assert np.allclose(heavy.inertia.com, [[0.5, 0, 0]] * 2)
    across = mass * (3 * 0.01 + 1.0) / 12
    assert np.allclose(heavy.inertia.tensor[0], np.diag([0.5 * mass * 0.01, across, across]))
    assert np.allclose(heavy.inertia.motor, [2 * mass * 0.04, mass * 0.04])
    assert not heavy.inertia.coulomb.any() and heavy.limits.torque is None
    assert "unknown" in assumed and "1500 kg/m³" in assumed and "200 mm" in assumed and "torque limits" in assumed
    assert "assumed" in to_mjcf(robot)
