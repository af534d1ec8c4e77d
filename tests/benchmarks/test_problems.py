"""Hard targets are as hard as they say: singular, on the limits, at zero, by the oracle's own Jacobian."""

from __future__ import annotations

import numpy as np
import pytest

import optik
from benchmarks.problems.base import start_of
from benchmarks.problems.hard import hard, put_at_zero, put_on_limits, singular
from optik import DHRow, JointLimits, Robot
from optik.errors import InvalidInput
from tests import oracles

SIX = ("paper6r", "puma560", "ur5e")


def seven_joints() -> Robot:
    twists, lengths = (0, -1, 1, -1, 1, -1, 1), (0.3, 0, 0.4, 0, 0.4, 0, 0.1)
    rows = [DHRow(alpha=0.5 * np.pi * s, d=d) for s, d in zip(twists, lengths, strict=True)]
    return Robot.from_mdh(rows, JointLimits(np.full(7, -2.0), np.full(7, 2.0)), name="seven")


@pytest.mark.parametrize("name", SIX)
@pytest.mark.parametrize("joint", [2, 4])
def test_singular_configurations_are_singular_by_the_oracle(name: str, joint: int) -> None:
    robot, arm = optik.load(name), oracles.table(name)
    q = singular(robot, np.random.default_rng(1), 12, joint, on_limits=False)
    assert q.shape == (12, 6)
    assert robot.limits.contains(q).all()
    for configuration in q:
        assert np.linalg.svd(oracles.jacobian(arm, configuration), compute_uv=False)[-1] < 1e-9


def test_at_a_spherical_wrist_the_outer_axes_are_parallel() -> None:
    robot, arm = optik.load("paper6r"), oracles.table("paper6r")
    for q in singular(robot, np.random.default_rng(2), 12, 4, on_limits=False):
        axes = oracles.jacobian(arm, q)[3:]
        assert np.linalg.norm(np.cross(axes[:, 3], axes[:, 5])) < 1e-9


def test_arms_with_seven_joints_have_singular_targets_too() -> None:
    robot = seven_joints()
    q = singular(robot, np.random.default_rng(3), 8, 4, on_limits=False)
    assert robot.limits.contains(q).all()
    assert np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1].max() < 1e-9


def test_joints_are_put_on_their_limits_and_at_zero() -> None:
    robot, rng = optik.load("paper6r"), np.random.default_rng(4)
    q = put_on_limits(robot, rng, robot.limits.draw(rng, 50), but=4)
    on = (q == robot.limits.lower) | (q == robot.limits.upper)
    assert on.any(axis=1).all()
    assert not on[:, 4].any()
    zeros = put_at_zero(robot, rng, robot.limits.draw(rng, 50)) == 0.0
    assert zeros.any(axis=1).all()
    assert zeros[0].all()


def test_the_set_has_equal_shares_that_any_part_of_it_keeps() -> None:
    robot = optik.load("paper6r")
    problems = hard(robot, 7, count=100)
    names, counts = np.unique(problems.group, return_counts=True)
    assert list(counts) == [20] * 5
    assert set(problems.group[:40]) == set(names)
    wrist = np.char.startswith(problems.group, "wrist")
    assert problems.sigma[wrist | (problems.group == "elbow singular")].max() < 1e-9
    assert robot.limits.contains(problems.starts).all()


def test_warm_and_cold_starts_have_the_same_targets() -> None:
    robot = optik.load("paper6r")
    warm, cold = hard(robot, 7, count=25), hard(robot, 7, count=25, start_deg=[5.0] * 6)
    np.testing.assert_array_equal(warm.targets, cold.targets)
    np.testing.assert_allclose(cold.starts, np.deg2rad(5.0))
    assert np.isnan(cold.spread).all()
    np.testing.assert_array_equal(hard(robot, 7, count=25).starts, warm.starts)


def test_a_wrong_setting_is_named() -> None:
    robot = optik.load("paper6r")
    with pytest.raises(InvalidInput, match="count"):
        hard(robot, 1, count=4)
    with pytest.raises(InvalidInput, match="spread"):
        hard(robot, 1, spread=0.0)
    short = Robot.from_mdh([DHRow(d=0.1)] * 3, JointLimits(np.full(3, -1.0), np.full(3, 1.0)), name="short")
    with pytest.raises(InvalidInput, match="six joints"):
        hard(short, 1)


def test_a_start_is_given_in_degrees_and_of_sliding_joints_in_millimetres() -> None:
    arm = optik.load("irb910sc")
    given = np.where(arm.prismatic, 50.0, 30.0)
    q = start_of(arm, given)
    np.testing.assert_allclose(q, np.where(arm.prismatic, 0.05, np.pi / 6), atol=1e-15)
    with pytest.raises(InvalidInput, match="start_deg"):
        start_of(arm, given * 1e3)
