from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optik.arm.library import load
from optik.errors import InvalidInput, NoSolution, UnknownName
from optik.types import Array
from planners import JointLine
from planners.paths import path_of
from tests import oracles
from tests.oracles import PAPER
from tests.planners.cases import START, paper6r

ROBOT = paper6r()
GOAL = START + np.array([0.3, -0.2, 0.25, 0.4, -0.3, 0.5])
configurations = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6).map(
    lambda u: ROBOT.limits.lower + np.array(u) * (ROBOT.limits.upper - ROBOT.limits.lower)
)


@settings(max_examples=20)
@given(configurations, configurations, st.floats(0.0, 1.0))
def test_all_joints_move_at_constant_rates_and_the_tool_with_them(a: Array, b: Array, u: float) -> None:
    path = JointLine(ROBOT, a, b)
    assert path.end == pytest.approx(np.sqrt(((b - a) ** 2).sum()), rel=1e-14)
    q = (1.0 - u) * a + u * b
    np.testing.assert_allclose(path.configurations(ROBOT, u * path.end), q, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(path(u * path.end), oracles.fk(PAPER, q), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("robot", ["paper6r", "ur5e", "panda", "irb910sc"])
def test_the_bounds_hold_for_any_arm_also_where_samples_are_far_apart(robot: str) -> None:
    arm, rng = load(robot), np.random.default_rng(2)
    low, high = np.maximum(arm.limits.lower, -6.0), np.minimum(arm.limits.upper, 6.0)
    for _ in range(4):
        path = JointLine(arm, rng.uniform(low, high), rng.uniform(low, high))
        bounds = path.derivative_bounds()
        s = np.linspace(0.0, path.end, 5001)
        for k in (1, 2, 3):
            worst = np.linalg.norm(path(s, k)[:, :3], axis=1).max()
            assert worst <= bounds[0, k - 1] * (1.0 + 1e-12)
        assert np.linalg.norm(path(s, 1)[:, 3:], axis=1).max() <= bounds[1, 0] * (1.0 + 1e-12)
        fourth = oracles.difference(lambda x, p=path: p(x, 3)[:, :3], s[50:-50], 1e-3 * path.end)
        assert np.linalg.norm(fourth, axis=1).max() <= bounds[0, 3] * (1.0 + 1e-6)


def test_configurations_and_their_derivatives() -> None:
    path = JointLine(ROBOT, START, GOAL)
    s = np.linspace(0.0, path.end, 5)
    rate = (GOAL - START) / path.end
    np.testing.assert_allclose(path.configurations(ROBOT, s)[[0, -1]], [START, GOAL], rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(path.configurations(ROBOT, s, 1), np.tile(rate, (5, 1)))
    for order in (2, 3):
        assert not path.configurations(ROBOT, s, order).any()
    assert path.configurations(ROBOT, 0.1).shape == (6,)
    with pytest.raises(InvalidInput, match="s: "):
        path.configurations(ROBOT, 2.0 * path.end)


def test_the_unit_is_that_of_the_joints_that_move() -> None:
    arm = load("irb910sc")
    q = np.array([0.1, 0.3, 0.05, 0.2])
    assert JointLine(arm, q, q + np.array([0, 0, 0.1, 0])).unit == "m"
    assert JointLine(arm, q, q + np.array([0, 0.1, 0.1, 0])).unit == "rad"
    slide = JointLine(arm, q, q + np.array([0, 0, 0.1, 0]))
    np.testing.assert_allclose(
        slide(np.array([0.0, 0.1]), 1), np.tile([0, 0, -1.0, 0, 0, 0], (2, 1)), rtol=0.0, atol=1e-15
    )
    np.testing.assert_allclose(slide.derivative_bounds(), [[1, 0, 0, 0], [0, 0, 0, 0]], rtol=0.0, atol=1e-9)


def test_equal_configurations_make_a_path_without_length() -> None:
    path = JointLine(ROBOT, START, START)
    assert path.end == 0.0
    np.testing.assert_allclose(path(0.0), oracles.fk(PAPER, START), rtol=0.0, atol=1e-14)
    assert not path(0.0, 1).any()
    assert path.nearest(np.eye(4)[None]) == 0.0
    assert not path.derivative_bounds().any()


# ---------------------------------------------------------------- to a pose
@pytest.mark.parametrize("solver", ["lm", "dls"])
def test_to_a_pose_it_ends_there_to_rounding(solver: str) -> None:
    goal = oracles.moved(oracles.fk(PAPER, START), np.array([-0.1, 0.05, 0.1]), np.array([0.1, 0.2, 0.3]))
    path = JointLine.to_pose(ROBOT, START, goal, solver=solver)
    np.testing.assert_array_equal(path.q_start, START)
    assert max(oracles.off_by(oracles.fk(PAPER, path.q_goal), goal)) <= 1e-12
    assert ROBOT.limits.contains(path.q_goal)
    np.testing.assert_allclose(path(path.end), goal, rtol=0.0, atol=1e-12)


def test_a_pose_out_of_reach_has_no_solution_and_a_reason() -> None:
    with pytest.raises(NoSolution) as info:
        JointLine.to_pose(ROBOT, START, oracles.moved(oracles.fk(PAPER, START), np.array([5.0, 0.0, 0.0])))
    assert "unreachable" in info.value.reason
    assert "mm" in info.value.reason
    assert info.value.advice


def test_an_ik_method_that_does_not_exist_is_named() -> None:
    with pytest.raises(UnknownName):
        JointLine.to_pose(ROBOT, START, oracles.fk(PAPER, GOAL), solver="lmm")


# ---------------------------------------------------------------- misuse
@pytest.mark.parametrize("wrong", [START[:5], np.full(6, np.nan), START + 9.0, None, "start"])
@pytest.mark.parametrize("argument", ["q_start", "q_goal"])
def test_what_is_no_configuration_inside_the_limits_is_refused(argument: str, wrong: Any) -> None:
    good = {"q_start": START, "q_goal": GOAL}
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        JointLine(ROBOT, **(good | {argument: wrong}))


def test_the_joint_that_stands_outside_is_named() -> None:
    beyond = GOAL.copy()
    beyond[3] = ROBOT.limits.upper[3] + 0.1
    with pytest.raises(InvalidInput, match=ROBOT.joint_names[3]):
        JointLine(ROBOT, START, beyond)


def test_another_arm_is_refused() -> None:
    path, other = JointLine(ROBOT, START, GOAL), load("ur5e")
    for call in (lambda: path.configurations(other, 0.0), lambda: path_of(path.to_dict(), other)):
        with pytest.raises(InvalidInput, match="paper6r") as info:
            call()
        assert info.value.argument == "robot"
    for missing in (None, "paper6r"):
        with pytest.raises(InvalidInput, match="paper6r"):
            path_of(path.to_dict(), missing)
        with pytest.raises(InvalidInput, match="robot"):
            JointLine(missing, START, GOAL)
    with pytest.raises(InvalidInput, match="pose"):
        JointLine.to_pose(ROBOT, START, np.eye(3))
