"""Configurations chosen for poses, against all combinations of branches and against lines that reach the same poses."""

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.spatial.distance import cdist

import optik
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.types import Array
from planners import JointLine, MotionLimits, PointToPoint, plan
from planners.paths.configurations import _expand, choose_configurations, find_configurations
from tests import oracles
from tests.optik.test_ik_lm import narrow, on_a_rail
from tests.robots import built

LIMITS = MotionLimits(2.0, 10.0, 100.0)


def measure(q: Array) -> float:
    return float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())


def unlimited(name: str) -> Robot:
    """An arm whose joints turn for ever."""
    robot = optik.load(name)
    return robot.with_limits(lower=np.full(robot.n, -np.inf), upper=np.full(robot.n, np.inf))


@pytest.mark.parametrize("seed", range(4))
def test_the_line_is_the_shortest_of_all_combinations_of_branches_and_windings(seed: int) -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng([1, seed])
    q = robot.limits.sample(rng, 4)
    poses, solver = robot.fk(q[1:3]), make_solver(robot, "closed_form")
    first, second = (solver.branches(pose, q[0]).q for pose in poses)
    ways = np.linalg.norm(first - q[0], axis=1)[:, None] + cdist(first, second) + np.linalg.norm(second - q[3], axis=1)
    for goal, best in ((q[3:], ways), (q[:0], ways - np.linalg.norm(second - q[3], axis=1))):
        found = choose_configurations(robot, q[0], [*poses, *goal], None)
        assert measure(found) == pytest.approx(best.min(), rel=1e-9)
        np.testing.assert_allclose(robot.fk(found[1:3]), poses, atol=1e-8)
        assert robot.limits.contains(found).all()


@pytest.mark.parametrize("seed", range(6))
def test_all_windings_inside_the_limits_are_candidates(seed: int) -> None:
    """Against all combinations of whole turns."""
    rng, robot = np.random.default_rng([3, seed]), optik.load("ur5e")
    lower = -rng.uniform(1.5, 7.0, 6)
    robot = robot.with_limits(lower=lower, upper=lower + rng.uniform(5.0, 12.0, 6))
    start, goal = robot.limits.sample(rng, 2)
    layer, most = rng.uniform(-4.0, 4.0, (2, 6)), rng.uniform(8.0, 14.0)
    turns = 2.0 * np.pi * np.array(list(product((-2, -1, 0, 1, 2), repeat=6)))
    every = (layer[:, None] + turns).reshape(-1, 6)
    every = every[robot.limits.contains(every)]
    every = every[np.linalg.norm(every - start, axis=1) + np.linalg.norm(every - goal, axis=1) <= most]
    found = _expand(robot, layer, start, goal, most)
    assert len(found) == len(every)
    np.testing.assert_allclose(found[np.lexsort(found.round(6).T)], every[np.lexsort(every.round(6).T)], atol=1e-9)


@pytest.mark.parametrize("name", ["kr6", "irb910sc", "panda", "a rail", "unlimited"])
def test_the_line_is_never_longer_than_the_one_from_which_the_poses_come(name: str) -> None:
    arms = {"a rail": lambda: built(on_a_rail(oracles.table("paper6r"))), "unlimited": lambda: unlimited("ur5e")}
    robot, shorter = arms.get(name, lambda: optik.load(name))(), 0
    for seed in range(8):
        rng = np.random.default_rng([2, seed])
        q = robot.limits.sample(rng, 1)
        for _ in range(5):
            q = np.concatenate([q, robot.limits.clip(q[-1:] + rng.uniform(-1.0, 1.0, robot.n))])
        targets = [x if i == 2 else robot.fk(x) for i, x in enumerate(q[1:])]
        found = choose_configurations(robot, q[0], targets, None)
        assert measure(found) <= measure(q) + 1e-7
        np.testing.assert_allclose(robot.fk(found), robot.fk(q), atol=1e-8)
        assert robot.limits.contains(found).all()
        shorter += measure(found) < 0.98 * measure(q)
    assert name not in {"panda", "a rail"} or shorter > 2


def test_a_joint_without_limits_turns_on_to_a_goal_of_several_turns() -> None:
    """The nearest windings from point to point would turn back before the goal."""
    robot = unlimited("ur5e")
    q = np.array([0.2, -1.4, 1.7, -1.9, -1.57, 0.1]) + np.array([[0.0], [3.5], [7.0], [9.0]]) * np.eye(6)[0]
    found = choose_configurations(robot, q[0], [robot.fk(q[1]), robot.fk(q[2]), q[3]], None)
    np.testing.assert_allclose(found, q, atol=1e-8)


def test_arms_with_too_many_windings_take_the_nearest_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(choose_configurations.__globals__, "MOST_WOUND", 1)
    robot, rng = unlimited("ur5e"), np.random.default_rng(4)
    q = rng.uniform(-10.0, 10.0, (6, 6))
    found = choose_configurations(robot, q[0], [*robot.fk(q[1:5]), q[5]], None)
    np.testing.assert_allclose(robot.fk(found), robot.fk(q), atol=1e-8)
    assert measure(found) <= measure(q)


@pytest.mark.parametrize("seed", range(120, 126))
def test_poses_of_narrow_arms_are_found(seed: int) -> None:
    for n in (6, 7):
        robot = built(narrow(n, seed))
        q = robot.limits.sample(np.random.default_rng(seed), 2)
        found = find_configurations(robot, robot.fk(q[1]), q[:1], "the pose")
        assert robot.limits.contains(found).all()
        np.testing.assert_allclose(robot.fk(found), np.repeat(robot.fk(q[1])[None], len(found), axis=0), atol=1e-8)
        assert n == 7 or np.abs(found - q[1]).max(axis=1).min() < 1e-6


def test_the_choice_is_among_usable_configurations_or_all_if_none_is() -> None:
    robot = optik.load("ur5e")
    q = np.array([[0.2, -1.4, 1.7, -1.9, -1.57, 0.1], [0.4, -1.2, 1.5, -1.7, -1.3, 0.3]])
    for usable, kept in ((lambda x: x[:, 4] > 0.0, False), (lambda x: np.zeros(len(x), np.bool_), True)):
        found = choose_configurations(robot, q[0], [robot.fk(q[1])], usable)
        assert np.allclose(found[1], q[1], atol=1e-8) == kept
        assert kept or found[1, 4] > 0.0


@pytest.mark.parametrize("lengths", [(1.7, 0.011, 1.7), (2.0, 1e-4, 1.5, 1e-3, 1.0), (1.0, 0.01, 0.01, 0.01, 1.0)])
def test_a_short_leg_between_long_ones_bends_the_first_path_little(lengths: tuple[float, ...]) -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng(5)
    ways = rng.normal(size=(len(lengths), 6))
    ways *= (np.array(lengths) / np.linalg.norm(ways, axis=1))[:, None]
    q = np.cumsum(np.concatenate([np.array([[0.2, -1.4, 1.7, -1.9, -1.57, 0.1]]), ways]), axis=0)
    path = PointToPoint(robot, *q)
    s = np.concatenate([np.linspace(a, b, 100) for a, b in pairwise(path.breaks)])
    assert measure(path.configurations(robot, s)) <= 1.2 * measure(q)
    found = plan(robot, path, limits=LIMITS)
    assert found
    stops = sum(plan(robot, JointLine(robot, a, b), limits=LIMITS).trajectory.duration for a, b in pairwise(q))
    assert found.trajectory.duration < stops
