"""Arms with fewer joints than the task has components: what they reach is found, and all else ends early with its reason."""

import numpy as np
import pytest

import optik
from optik.ik import DLS, LM, IKStatus
from tests import oracles

WX200 = optik.load("wx200")
SCARA = optik.load("irb910sc")
HELD = optik.load("ur5e").with_limits(lower=[-6, -6, -3, -6, 0.5, -6], upper=[6, 6, 3, 6, 0.5, 6])
"""An arm with a joint that is held."""
TWO = WX200.with_limits(lower=[-3, -1, 0.1, 0.2, 0.3], upper=[3, 1, 0.1, 0.2, 0.3])


def turned(robot, seed):
    """A pose near a pose of the tool, with a random orientation, and an initial guess."""
    rng = np.random.default_rng(seed)
    T = robot.fk(robot.limits.sample(rng, 1)[0])
    T[:3, :3], T[:3, 3] = oracles.random_pose(rng)[:3, :3], T[:3, 3] + rng.normal(0.0, 0.01, 3)
    return T, robot.limits.sample(rng, 1)[0]


LACKS = {
    "five": (WX200, "pose", "5 joints; a pose has 6 components: task position or axis_z"),
    "four": (SCARA, "pose", "4 joints; a pose has 6 components: task position"),
    "an axis": (SCARA, "axis_z", "4 joints; the task has 5 components: task position"),
    "two": (TWO, "position", "2 joints; a position has 3 components: a task with fewer components"),
    "held": (HELD, "pose", "5 joints; a pose has 6 components: task position or axis_z"),
}


@pytest.mark.parametrize(("robot", "task", "words"), LACKS.values(), ids=LACKS.keys())
def test_a_pose_that_is_not_reached_names_the_joints_and_the_tasks_that_fit(robot, task, words):
    results = [optik.solve_ik(robot, *turned(robot, seed), task=task, max_restarts=200) for seed in range(12)]
    lacking = [result for result in results if result.status is IKStatus.TOO_FEW_JOINTS]
    assert {result.status for result in results} <= {IKStatus.TOO_FEW_JOINTS, IKStatus.UNREACHABLE}
    assert {result.message for result in lacking} == {words}
    assert words in str(lacking[0])
    assert "restarts (max_restarts)" not in str(lacking[0])
    assert np.median([result.restarts for result in lacking]) < 100


@pytest.mark.parametrize("robot", [WX200, SCARA, HELD])
def test_what_such_an_arm_reaches_is_solved(robot):
    rng = np.random.default_rng(7)
    q, starts = robot.limits.sample(rng, 300), robot.limits.sample(rng, 300)
    batch = LM(robot).solve_batch(robot.fk(q), starts)
    assert batch.solved.all()
    assert np.abs(robot.pose_errors(batch.q, robot.fk(q))).max() < 1e-6


def test_single_calls_batches_and_timed_calls_end_after_the_same_attempts():
    solver, timed = LM(WX200, max_restarts=200), LM(WX200, max_restarts=200, time_limit=600.0)
    problems = [turned(WX200, seed) for seed in range(60)]
    batch = solver.solve_batch(*(np.array(x) for x in zip(*problems, strict=True)))
    for i, problem in enumerate(problems):
        one, other = solver.solve(*problem), timed.solve(*problem)
        assert (one.status, one.restarts) == (other.status, other.restarts)
        assert (batch.result(i).status, batch.restarts[i]) == (one.status, one.restarts)
    assert (batch.status == tuple(IKStatus).index(IKStatus.TOO_FEW_JOINTS)).sum() > 20
    assert (batch.restarts[batch.status != 5] < 60).mean() > 0.7


def test_restarts_of_any_arm_stop_when_all_of_them_end_at_the_same_residual():
    # beyond these limits, and not proved so: every attempt is clamped to the nearest corner
    q = np.full(6, 0.3)
    narrow = oracles.table("paper6r")
    robot = optik.load("paper6r").with_limits(lower=q - 0.05, upper=q + 0.05)
    target = oracles.fk(narrow, q + 0.3)
    result = DLS(robot, max_restarts=10**6).solve(target, q)
    assert not result
    assert result.restarts < 100
    assert result.status is not IKStatus.TOO_FEW_JOINTS
    assert DLS(robot, max_restarts=10**6, time_limit=0.5).solve(target, q).status is IKStatus.TIME_LIMIT
