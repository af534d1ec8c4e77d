"""Long runs, by make soak: no claimed success is wrong, over every robot, method, task and kind of start.

A smaller draw of the same runs with every test. The judge is plain NumPy and SciPy over the robots' own tables.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

import optik
from optik.errors import InvalidInput, MissingDependency, RobotModelError
from optik.ik import make_solver, solvers
from optik.task import as_task
from tests import oracles
from tests.robots import USUAL

POSES = {"lm": 144_000, "dls": 12_000, "closed_form": 12_000, "ipopt": 1_000, "sqp": 1_000}
"""Whole poses of one method over all robots, in a long run; another method takes 4,000."""

TASKED = {"lm": 40_000, "dls": 8_000, "ipopt": 500, "sqp": 500}
TASKS = ("position", "rotation", "axis_x", "axis_y", "axis_z")
ROUNDING = 1e-12  # the oracle rounds too: far below what a wrong answer would show


class Count(NamedTuple):
    problems: int = 0
    solved: int = 0
    wrong: int = 0

    def __add__(self, other: Any) -> Count:
        return Count(*(a + b for a, b in zip(self, other, strict=True)))


def problems(arm: oracles.Arm, count: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Targets within reach and some beyond, some at limits and straight; starts near the solution and anywhere."""
    low, high = oracles.span(arm)
    q = rng.uniform(low, high, (count, arm.n))
    special = rng.random(q.shape) < 0.2 * (rng.random(count) < 0.2)[:, None]
    ends = np.where(rng.random(q.shape) < 0.5, low, high)
    q = np.where(special, np.where(rng.random(q.shape) < 0.3, np.clip(0.0, low, high), ends), q)
    targets = oracles.fk(arm, q)
    targets[::20, :3, 3] += rng.normal(0.0, 0.5, (len(targets[::20]), 3))
    near = q + rng.normal(0.0, rng.choice([0.01, 0.1, 1.0], count)[:, None], q.shape)
    starts = np.where(rng.random(count)[:, None] < 0.5, near, rng.uniform(low, high, q.shape))
    return targets, np.clip(starts, low, high)


def judged(arm: oracles.Arm, batch: Any, targets: Any, task: str) -> Count:
    """Count claims that are none, successes not claimed, and answers outside the limits."""
    assert np.isfinite(batch.q).all()
    T = oracles.fk(arm, batch.q)
    if task == "pose":
        p, r = oracles.off_by(T, targets)
    else:
        mask = as_task(task).mask
        p, r = np.array([oracles.task_off_by(a, b, mask, "target") for a, b in zip(T, targets, strict=True)]).T
    inside = ((batch.q >= arm.lower - 1e-9) & (batch.q <= arm.upper + 1e-9)).all(axis=1)
    met = (p <= 1e-6 + ROUNDING) & (r <= 1e-6 + ROUNDING)
    wrong = (batch.solved & ~met) | ~inside
    wrong |= ~batch.solved & (p <= 1e-6 - ROUNDING) & (r <= 1e-6 - ROUNDING)
    wrong |= (np.abs(batch.position_error - p) > 1e-11) | (np.abs(batch.rotation_error - r) > 1e-7)
    return Count(len(targets), int(batch.solved.sum()), int(wrong.sum()))


def run(method: str, task: str, count: int, seed: int, names: tuple[str, ...] = optik.robots()) -> Count:
    """Share so many problems among the robots that the method can take."""
    total = Count()
    for k, name in enumerate(names):
        robot, arm, rng = optik.load(name), oracles.table(name), np.random.default_rng([seed, k])
        try:
            solver = make_solver(robot, method, task=task, **({} if method == "lm" else {"max_restarts": 2}))
        except MissingDependency as error:
            pytest.skip(str(error))
        except (RobotModelError, InvalidInput):
            continue  # not an arm for this method
        left = count // len(names)
        while left > 0:
            targets, starts = problems(arm, min(left, 20_000), rng)
            total += judged(arm, solver.solve_batch(targets, starts), targets, task)
            left -= len(targets)
    return total


def report(method: str, task: str, total: Count) -> None:
    print(f"{method}, {task}: {total.problems} problems, {total.solved} solved, {total.wrong} wrong")
    assert total.wrong == 0
    assert total.solved > 0.5 * total.problems


@pytest.mark.parametrize("method", solvers())
def test_every_claimed_success_is_one(method: str) -> None:
    report(method, "pose", run(method, "pose", 3300 if method == "lm" else 110, 98, USUAL))


@pytest.mark.parametrize("task", TASKS)
def test_every_claimed_success_at_a_task_is_one(task: str) -> None:
    report("lm", task, run("lm", task, 110, 97, USUAL))


@pytest.mark.soak
@pytest.mark.parametrize("method", solvers())
def test_every_claimed_success_is_one_at_length(method: str) -> None:
    report(method, "pose", run(method, "pose", POSES.get(method, 4_000), 99))


@pytest.mark.soak
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("method", sorted(TASKED))
def test_every_claimed_success_at_a_task_is_one_at_length(method: str, task: str) -> None:
    report(method, task, run(method, task, TASKED[method] // len(TASKS), 96))
