"""The oracles among themselves: what two of them say of one thing agrees, and the continuation ends where it must."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import optik
from optik import JointLimits
from planners import JointLine, Line, Polyline
from tests import oracles
from tests.oracles.continuation import _Arm, follow_densely

ARMS = {
    "paper": oracles.PAPER,
    "sliding": oracles.SLIDING,
    "ur5e": oracles.UR5E,
    "drawn, dh": oracles.random_arm(np.random.default_rng(3), 7, prismatic=True, convention="dh"),
    "drawn, mdh": oracles.random_arm(np.random.default_rng(4), 5, prismatic=True),
    "panda": optik.load("panda"),
}


@pytest.mark.parametrize("name", ARMS)
def test_poses_and_jacobians_are_those_of_differences_and_of_many_at_once(name: str) -> None:
    arm: Any = ARMS[name]
    n, rng = len(oracles.kinematics.chain(arm)[1].d), np.random.default_rng(1)
    many = rng.uniform(-2.0, 2.0, (5, n))
    J, fast = oracles.jacobian(arm, many), _Arm(arm)
    for q, one in zip(many, J, strict=True):
        np.testing.assert_allclose(oracles.jacobian(arm, q), one, rtol=0.0, atol=1e-14)
        columns = [oracles.error(oracles.fk(arm, q - h), oracles.fk(arm, q + h)) / 2e-5 for h in 1e-5 * np.eye(n)]
        np.testing.assert_allclose(np.stack(columns, axis=1), one, rtol=0.0, atol=1e-8)
        pose, quick = fast(q)
        np.testing.assert_allclose(pose, oracles.fk(arm, q), rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(quick, one, rtol=0.0, atol=1e-14)
    series = rng.normal(size=(4, n))
    factors = np.array([1.0, 1.0, 2.0])[:, None]
    twists = oracles.tool_motion(arm, series[0], series[1:] * [[1.0], [2.0], [6.0]])
    np.testing.assert_allclose(oracles.turning_series(arm, series) * factors, twists[:, 3:], rtol=0.0, atol=1e-12)


# ---------------------------------------------------------------- continuation
@pytest.mark.parametrize("name", ["paper6r", "ur5e", "irb910sc"])
def test_a_path_made_in_the_joints_is_followed_by_these_joints(name: str) -> None:
    robot, rng = optik.load(name), np.random.default_rng(5)
    low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
    for _ in range(2):
        a, b = (0.5 * (low + high) + 0.35 * (high - low) * rng.uniform(-1.0, 1.0, robot.n) for _ in range(2))
        way = follow_densely(robot, JointLine(robot, a, b), a)
        regular = oracles.smallest(robot, a + np.linspace(0.0, 1.0, 2001)[:, None] * (b - a)).min()
        assert way.follows, way[:5]  # singular places too: the joints go over them smoothly
        np.testing.assert_allclose(way.q[-1], b, rtol=0.0, atol=1e-6)
        assert way.sigma <= max(1.05 * regular, 2e-4)


@pytest.mark.parametrize("name", ["paper6r", "ur5e"])
def test_a_straight_wrist_is_passed_where_the_joints_go_on_smoothly(name: str) -> None:
    robot = optik.load(name)
    a = np.array([0.3, -0.9, 0.9, 0.4, 0.3, -0.5])
    b = a + np.array([0.1, 0.15, -0.1, 0.2, 0.0, 0.3])
    b[4] = -0.2
    way = follow_densely(robot, JointLine(robot, a, b), a)
    assert way.follows, way[:5]
    assert way.sigma < 2e-4
    np.testing.assert_allclose(way.q[-1], b, rtol=0.0, atol=1e-6)


def test_a_limit_ends_the_motion_where_the_joint_comes_to_it() -> None:
    robot = optik.load("paper6r")
    a = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
    b = a + np.array([0.3, 0.2, -0.2, 0.1, 0.2, 0.4])
    path = JointLine(robot, a, b)
    upper = robot.limits.upper.copy()
    upper[5] = a[5] + 0.3
    tight = replace(robot, limits=JointLimits(robot.limits.lower, upper))
    way = follow_densely(tight, path, a)
    assert (way.why, way.joint) == ("limit", 5)
    assert way.at == pytest.approx(0.75 * path.end, abs=0.02)
    upper[5] = a[5] + 0.401
    roomy = replace(robot, limits=JointLimits(robot.limits.lower, upper))
    assert follow_densely(roomy, path, a).room == pytest.approx(1e-3, rel=1e-3)


def test_out_of_reach_no_motion_is_followed() -> None:
    robot, q = optik.load("paper6r"), np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
    robot = replace(robot, limits=JointLimits(np.full(6, -20.0), np.full(6, 20.0)))
    start = robot.fk(q)
    way = follow_densely(robot, Line(start, oracles.moved(start, np.array([0.0, 0.0, 2.0]))), q)
    assert way.why
    assert 0.0 < way.at < 1.0
    assert oracles.smallest(robot, way.q[-1]) < 1e-2, "a branch ends at the edge of what it reaches"


@pytest.mark.parametrize("beside", [1e-3, 1e-6])
def test_beside_a_straight_wrist_the_joints_turn_around_it_and_never_leap(beside: float) -> None:
    robot, q = optik.load("ur5e"), np.array([0.3, -1.2, 1.5, -0.9, 0.15, 0.4])
    there, aside = robot.fk(q + np.array([0, 0, 0, 0, -0.3, 0.0])), oracles.jacobian(robot, q)[3:, 3]
    path = Line(robot.fk(q), oracles.moved(there, np.zeros(3), beside * aside))
    way = follow_densely(robot, path, q)
    assert way.follows, way[:5]
    assert np.abs(np.diff(way.q, axis=0)).max() <= 0.04
    assert abs(way.q[-1, 3] - q[3]) > 2.0, "the fourth and the sixth joint turn round, the fifth keeps its sign"
    assert (way.q[:, 4] > 0.0).all()


@pytest.mark.parametrize("tiny", [1e-6, 1e-8])
def test_waypoints_nearly_repeated_are_no_obstacle(tiny: float) -> None:
    robot, q = optik.load("irb120"), np.deg2rad([10, 20, -10, 30, 40, 20.0])
    T = robot.fk(q)
    poses = [oracles.moved(T, np.array(x)) for x in ([0, 0, 0], [0, 0.05, 0], [tiny, 0.05, tiny], [0.03, 0.05, 0.03])]
    way = follow_densely(robot, Polyline(np.array(poses), blend=1e-5), q)
    assert way.follows, way[:5]
    assert max(oracles.off_by(oracles.fk(robot, way.q[-1]), poses[-1])) < 1e-9


def test_a_redundant_arm_is_followed_and_kept_off_its_limits() -> None:
    robot = optik.load("panda")
    q = np.array([0.1, -0.5, 0.1, -2.0, 0.1, 1.6, 0.6])
    start = robot.fk(q)
    way = follow_densely(robot, Line(start, oracles.moved(start, np.array([0.1, 0.2, -0.1]))), q)
    assert way.follows, way[:5]
    assert way.room > 0.0
