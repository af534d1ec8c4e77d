"""Long runs, by make soak: no claimed success is wrong, over every robot, method and kind of start."""

from __future__ import annotations

import numpy as np
import pytest

import optik
from optik.ik import make_solver, solvers
from tests import oracles

COUNT = {"ipopt": 2_000}


@pytest.mark.soak
@pytest.mark.parametrize("method", solvers())
@pytest.mark.parametrize("name", optik.robots())
def test_every_claimed_success_is_one(name: str, method: str) -> None:
    robot, arm = optik.load(name), oracles.table(name)
    rng = np.random.default_rng(99)
    solver = make_solver(robot, method, max_restarts=2)
    lower, upper = robot.limits.lower, robot.limits.upper
    solved = 0
    for _ in range(COUNT.get(method, 20_000)):
        q = rng.uniform(lower, upper)
        near = robot.limits.clip(q + rng.normal(0.0, rng.choice([0.01, 0.1, 1.0]), robot.n))
        start = near if rng.random() < 0.7 else rng.uniform(lower, upper)
        target = oracles.fk(arm, q)
        result = solver.solve(target, start)
        assert ((result.q >= lower - 1e-9) & (result.q <= upper + 1e-9)).all()
        e = oracles.error(oracles.fk(arm, result.q), target)
        position, rotation = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
        # the oracle rounds too: 1e-12 is far below what a wrong answer would show
        assert bool(result) == (position <= 1e-6 + 1e-12 and rotation <= 1e-6 + 1e-12)
        solved += bool(result)
    assert solved > 0.5 * COUNT.get(method, 20_000)
