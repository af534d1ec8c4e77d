"""Arms against the numbers of their makers: kinematics and torques in Pinocchio, and limits."""

import numpy as np
import pytest

import optik
from optik import Robot
from tests.oracles.makers import UR, fr3_urdf, ur_urdf

TEXTS = {"fr3": (fr3_urdf, "link8"), **{name: (lambda name=name: ur_urdf(name), "tool0") for name in UR}}


@pytest.mark.parametrize("name", TEXTS)
def test_kinematics_and_torques_are_those_of_the_makers_urdf_in_pinocchio(name):
    import pinocchio as pin

    text, tip = TEXTS[name]
    model = pin.buildModelFromXML(text())
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    data, tool, robot = model.createData(), model.getFrameId(tip), optik.load(name)
    base = np.eye(4) if name == "fr3" else np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link looks the other way
    rng = np.random.default_rng(44)
    q = robot.limits.sample(rng, 1000)
    dq, ddq = rng.normal(size=(2, 1000, robot.n))
    torques = np.empty_like(q)
    for i in range(1000):
        pin.framesForwardKinematics(model, data, q[i])
        assert np.abs(data.oMf[tool].homogeneous - base @ robot.fk(q[i])).max() < 1e-9
        torques[i] = pin.rnea(model, data, q[i], dq[i], ddq[i])
    assert np.abs(robot.torques(q, dq, ddq) - torques).max() <= 1e-9 * np.abs(torques).max()


def test_the_fr3_has_the_limits_of_its_urdf():
    robot, read = optik.load("fr3"), Robot.from_urdf(fr3_urdf())
    for name in ("lower", "upper", "velocity", "torque"):
        np.testing.assert_array_equal(getattr(robot.limits, name), getattr(read.limits, name))
    assert robot.limits.velocity_by_position == read.limits.velocity_by_position
    assert read.limits.acceleration is None and read.limits.deceleration is None and read.limits.jerk is None


def test_the_velocities_by_position_of_the_fr3_are_those_of_its_rate_limiter():
    # libfranka, rate_limiting.h, computeUpperLimitsJointVelocity: offset, twice the deceleration and end, without the tolerance
    limiter = [(0.3, 12.0, 2.7501), (0.2, 5.17, 1.7918), (0.2, 7.0, 2.9065), (0.3, 8.0, -0.1458), (0.35, 34.0, 2.8101)]
    limiter += [(0.35, 11.0, 4.5205), (0.35, 34.0, 3.0196)]
    limits = optik.load("fr3").limits
    slower = limits.velocity_by_position
    np.testing.assert_array_equal(np.column_stack([slower.offset, 2.0 * slower.deceleration, limits.upper]), limiter)


@pytest.mark.parametrize("name", UR)
def test_what_universal_robots_does_not_publish_is_unknown(name):
    limits = optik.load(name).limits
    assert limits.velocity is not None and limits.torque is not None
    assert (limits.acceleration, limits.deceleration, limits.jerk, limits.torque_rate) == (None,) * 4
    assert limits.velocity_by_position is None
