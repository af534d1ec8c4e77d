"""Path and time together against IPOPT on the same grid, with the joints as unknowns: an independent formulation."""

from typing import Any

import numpy as np
import pytest

from optik.ik import make_solver
from planners import MotionLimits, PointToPoint, follow, free
from planners.choice.choose import make_choice
from planners.choice.solve import solve_coefficients
from planners.timing.optimal import Optimal
from tests.oracles.simultaneous import solve_jointly
from tests.planners.cases import START, paper6r
from tests.planners.test_freedom import line, torch

MOVE = START + np.array([0.4, -0.3, 0.2, 0.5, -0.4, 0.3])


@pytest.mark.parametrize(
    "make",
    [lambda: free(line(torch(), START), turn=(-1.0, 1.0)), lambda: PointToPoint(paper6r(), START, MOVE)],
    ids=["turn", "joints"],
)
def test_the_optimum_is_that_of_ipopt_with_the_joints_as_unknowns(make: Any) -> None:
    path = make()
    robot = paper6r() if path.in_joints else torch()
    limits = MotionLimits(2.0, 10.0, 100.0)
    joints = follow(make_solver(robot, "lm"), path, START).joint_path
    assert joints is not None
    optimum = Optimal(intervals=12).run_with_optimum(joints, limits)[1]
    choice = make_choice(path, joints, optimum, held=True)
    found = solve_coefficients(
        choice.programme, choice.p, choice.bounds, choice.near, least=1e-9, damping=choice.damping
    )
    assert found is not None
    other = solve_jointly(choice, (found.z, found.p, found.path))  # it would leave what is no optimum
    assert other.success
    assert other.duration == pytest.approx(found.duration, rel=1e-5)
    if not path.in_joints:  # several joint paths take the least time
        np.testing.assert_allclose(found.p, other.p, atol=1e-3)
        assert np.abs(found.p - choice.p).max() > 0.05
