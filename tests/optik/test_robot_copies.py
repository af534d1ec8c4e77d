"""Copies of an arm with another base, tool or limits, and the singular values of its Jacobian."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import JointLimits, Robot
from optik.errors import InvalidInput, RobotModelError
from tests import oracles

ROBOTS = [optik.load(name) for name in optik.robots()]
lengths, turns = st.floats(-2, 2), st.floats(-4, 4)
poses = st.builds(oracles.pose, st.tuples(turns, turns, turns), st.tuples(lengths, lengths, lengths))
robots = st.sampled_from(ROBOTS)
seeds = st.integers(0, 2**32)


def drawn(robot, seed):
    return robot.limits.sample(np.random.default_rng(seed), 3)


def is_same_but(one, other, *fields):
    names = {"name", "prismatic", "tool", "limits", "joint_names", "gravity", "source"}.difference(fields)
    return all(np.array_equal(getattr(one, f), getattr(other, f)) for f in names) and type(one) is type(other) is Robot


@given(robots, poses, poses, seeds)
def test_a_new_base_stands_before_the_present_one_and_gravity_points_where_it_did(robot, T, S, seed):
    q, moved = drawn(robot, seed), robot.with_base(T)
    assert np.abs(moved.fk(q) - T @ robot.fk(q)).max() < 1e-13
    assert np.abs(moved.gravity - T[:3, :3] @ robot.gravity).max() < 1e-14
    # angles between gravity and what the arm consists of are the same: it still hangs as it did
    down = [np.einsum("kifj,j->kif", r.frames(q)[..., :3, :3].swapaxes(-1, -2), r.gravity) for r in (robot, moved)]
    assert np.abs(down[0] - down[1]).max() < 1e-13
    assert is_same_but(robot, moved, "gravity")
    assert np.abs(moved.with_base(S).fk(q) - robot.with_base(S @ T).fk(q)).max() < 1e-13
    assert robot.with_base(np.eye(4)) == robot


@given(robots, poses, seeds)
def test_a_tool_replaces_the_whole_transform_behind_the_last_joint(robot, T, seed):
    q, other = drawn(robot, seed), robot.with_tool(T)
    frames = robot.frames(q)
    assert np.abs(other.fk(q) - frames[:, -2] @ T).max() < 1e-13
    assert (other.frames(q)[:, :-1] == frames[:, :-1]).all()
    assert is_same_but(robot, other, "tool")
    assert other.with_tool(robot.tool) == robot


@given(robots, poses, seeds)
def test_an_added_tool_stands_behind_the_present_one_as_in_a_table(robot, T, seed):
    q, other = drawn(robot, seed), robot.with_tool(T, add=True)
    assert np.abs(other.fk(q) - robot.fk(q) @ T).max() < 1e-13
    assert is_same_but(robot, other, "tool")
    assert robot.with_tool(np.eye(4), add=True) == robot


def test_tools_and_bases_of_a_table_are_those_that_are_added():
    rows, limits = [{"a": 0.3, "alpha": 0.7, "d": 0.1}, {"a": 0.2, "alpha": -0.4}], JointLimits([-1, -1], [1, 1])
    base, tool = oracles.pose((0.1, 0.2, 0.3), (1.0, 2.0, 3.0)), oracles.pose((0.3, 0.1, 0.2), (0.0, 0.0, 0.1))
    for build in (Robot.from_dh, Robot.from_mdh):
        whole = build(rows, limits, base=base, tool=tool, gravity=base[:3, :3] @ [0, 0, -1])
        parts = build(rows, limits).with_tool(tool, add=True).with_base(base)
        for one, other in ((whole.fixed, parts.fixed), (whole.tool, parts.tool), (whole.gravity, parts.gravity)):
            assert np.abs(one - other).max() < 1e-15


def test_limits_are_exchanged_as_a_whole_or_one_by_one():
    robot = optik.load("panda")
    slow = robot.with_limits(velocity=0.5)
    assert slow.limits.velocity.tolist() == [0.5] * 7
    for field in ("lower", "upper", "acceleration", "jerk"):
        assert (getattr(slow.limits, field) == getattr(robot.limits, field)).all()
    assert is_same_but(robot, slow, "limits")
    assert (slow.fixed == robot.fixed).all()
    assert robot.with_limits(velocity=None).limits.velocity is None
    assert robot.with_limits() == robot.with_limits(robot.limits) == robot
    wide = JointLimits([-3.0] * 7, [3.0] * 7)
    assert robot.with_limits(wide).limits is wide
    both = robot.with_limits(wide, jerk=9.0).limits
    assert (both.upper == 3.0).all()
    assert both.velocity is None
    assert both.jerk.tolist() == [9.0] * 7


MISUSE = {
    "a base that is a rotation": (lambda r: r.with_base(np.eye(3)), r"^base: "),
    "a tool that is a rotation": (lambda r: r.with_tool(np.eye(3)), r"^tool: "),
    "a tool to be added that is a word": (lambda r: r.with_tool("long", add=True), r"^tool: "),
    "add that is a word": (lambda r: r.with_tool(np.eye(4), add="no"), r"^add: "),
    "limits that are a list": (lambda r: r.with_limits([[-1, 1]]), r"^limits: "),
    "limits that are a list, and a field": (lambda r: r.with_limits([[-1, 1]], jerk=1.0), r"^limits: "),
    "limits of another arm": (lambda r: r.with_limits(JointLimits([0], [1])), "limits for 1"),
    "a limit that does not exist": (lambda r: r.with_limits(effort=1.0), r"^limits: .*got effort"),
}


@pytest.mark.parametrize(("use", "word"), MISUSE.values(), ids=MISUSE.keys())
def test_what_makes_no_copy_is_refused_by_name(use, word):
    with pytest.raises((InvalidInput, RobotModelError), match=word):
        use(optik.load("paper6r"))


# ---------------------------------------------------------------- singular values
@given(robots, seeds)
def test_singular_values_are_the_roots_of_the_eigenvalues_of_the_smaller_gram_matrix(robot, seed):
    q = drawn(robot, seed)
    sigma = robot.singular_values(q)
    assert sigma.shape == (3, min(6, robot.n))
    assert (np.diff(sigma, axis=-1) <= 0.0).all()
    for i in range(3):
        J = oracles.jacobian(oracles.table(robot.name), q[i])
        gram = J @ J.T if robot.n >= 6 else J.T @ J
        assert np.abs(np.sort(np.linalg.eigvalsh(gram))[::-1] - sigma[i] ** 2).max() < 1e-12
        assert (robot.singular_values(q[i]) == sigma[i]).all()


def test_singular_values_of_no_configurations_and_of_none():
    robot = optik.load("panda")
    assert robot.singular_values(np.zeros((0, 7))).shape == (0, 6)
    assert robot.singular_values(np.zeros((2, 4, 7))).shape == (2, 4, 6)
    assert optik.load("paper6r").singular_values(np.zeros(6))[-1] < 1e-14
    with pytest.raises(InvalidInput, match=r"^q: "):
        robot.singular_values(np.zeros(6))
