"""The sweep of a running motion's clock, in parts: longer cells, and a stop and its last ramp against closed forms."""

import numpy as np
import pytest

from planners import JointLine, MotionLimits, plan, replan
from planners.timing.brake import RunningMotion
from planners.timing.brake.brake import RAMP_STEPS, _last_ramp
from planners.timing.brake.rows import Cells, cells_of
from tests.planners.cases import START, paper6r

MOVE = np.array([1.0, 0.1, -0.1, 0.1, 0.1, -0.1])
JERK = 40.0
"""A joint line, on which joint 1 moves farthest, and its jerk limit."""


def cells(length: float) -> Cells:
    limits = MotionLimits(1.0, 5.0, JERK)
    found = plan(paper6r(), JointLine(paper6r(), START, START + MOVE), START, limits=limits, timing="ruckig")
    running = RunningMotion(found.robot, found.trajectory)
    middle = 0.5 * found.trajectory.end  # at constant speed
    return cells_of(running, limits, middle, length, {"acceleration": 1.0, "jerk": 1.0})


def test_longer_cells_take_the_factors_of_the_cells_that_cover_them() -> None:
    short, long = cells(0.051), cells(0.1)
    untouched = cells(0.1)
    rng = np.random.default_rng(1)
    for order in (2, 3):
        for cell in range(short.x.size - 1):
            short.tighten(order, slice(cell, cell + 1), 1.0 + rng.uniform())
    short.soft[:] = rng.uniform(0.5, 1.0, short.soft.size)
    long.take(short)
    for cell in range(long.x.size - 1):  # no middle is at an end of a short cell
        middle = 0.5 * (long.x[cell] + long.x[cell + 1])
        covering = [i for i in range(short.x.size - 1) if short.x[i] < middle < short.x[i + 1]]
        factors = short.tight[:, covering[0]] if covering else np.ones(2)
        np.testing.assert_array_equal(long.tight[:, cell], factors)
        np.testing.assert_allclose(long.node[cell], untouched.node[cell] * factors[0], rtol=1e-15)
        np.testing.assert_allclose(long.edge[cell], untouched.edge[cell] * factors[1], rtol=1e-15)
        assert long.soft[cell] == (short.soft[covering[0]] if covering else 1.0)


def ramp(above: float) -> tuple[int, np.ndarray, float, float]:
    """Ramp from w = 1 and b = −2; the goal lies so many times below w as the hardest ramp would lower it."""
    whole, out = cells(0.3), np.zeros((4, RAMP_STEPS + 1))
    line, b, jerk = np.empty((3, whole.edge.shape[2] + 1)), -2.0, JERK
    fall = b * b / (2.0 * jerk)
    out[:, 0] = 0.0, 1.0, b, 0.0
    last = _last_ramp(whole, (0.0, 1.0, b, 0.0), 1.0 - above * fall, (1.0, 1e3), line, out, 0)
    return last, out, jerk, fall


@pytest.mark.parametrize("above", [1.5, 3.0])
def test_the_last_ramp_brings_the_clock_to_its_goal(above: float) -> None:
    last, (_, w, b, t), jerk, fall = ramp(above)
    assert last == RAMP_STEPS
    assert w[-1] == 1.0 - above * fall and b[-1] == 0.0
    assert t[-1] >= 2.0 / jerk
    np.testing.assert_allclose(np.diff(w), 0.5 * (b[1:] + b[:-1]) * np.diff(t), rtol=1e-6)


@pytest.mark.parametrize("above", [0.5, 1.0 - 0.5 / RAMP_STEPS**2])
def test_a_ramp_that_no_jerk_keeps_above_the_goal_is_none(above: float) -> None:
    """The second falls below the goal only on its last step."""
    assert ramp(above)[0] == -1


@pytest.mark.parametrize(("V", "A", "J"), [(0.66, 7.6, 124.0), (1.0, 5.0, 40.0), (1.4, 5.5, 50.0)])
def test_a_sweep_from_constant_speed_takes_nearly_the_time_of_its_closed_form(V: float, A: float, J: float) -> None:
    limits = MotionLimits(V, A, J)
    running = plan(paper6r(), JointLine(paper6r(), START, START + MOVE), START, limits=limits, timing="ruckig")
    shortest = V / A + A / J if A * A <= J * V else 2.0 * np.sqrt(V / J)
    for part in (0.45, 0.5, 0.55):
        stop = replan(running, part * running.trajectory.end, stop=True, time_limit=0.0)
        assert shortest * (1.0 - 1e-9) <= stop.trajectory.end <= 1.05 * shortest
