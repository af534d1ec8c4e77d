"""Verdicts of a certificate at their very edges: what is exactly a limit, what jumps, which end of a piece counts."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.optimize import minimize_scalar

from planners import Certificate, JointLine, MotionLimits, Trajectory, certify
from planners.limits import DERIVATIVES, TOOL_SPEEDS
from tests import oracles
from tests.oracles import PAPER
from tests.planners.cases import START, paper6r, step_of

ROBOT = paper6r()


def certified(trajectory: Trajectory, limits: MotionLimits, **options: Any) -> Certificate:
    """Along the straight way in joint space from its start to its end."""
    first, last = trajectory.ends(0)[0][0], trajectory.ends(0)[1][-1]
    return certify(ROBOT, JointLine(ROBOT, first, last), trajectory, limits, **options)


@pytest.mark.parametrize("field", DERIVATIVES)
@pytest.mark.parametrize(("over", "holds"), [(1e-13, True), (1e-9, False), (1e-11, False)])
def test_a_limit_is_kept_to_rounding_and_no_more(field: str, over: float, holds: bool) -> None:
    trajectory = step_of(2, 0.04, 0.8)
    worst = float(trajectory.extrema(DERIVATIVES.index(field) + 1).worst[2])
    certificate = certified(trajectory, MotionLimits(**{field: worst / (1.0 + over)}), enforced=(field,))
    assert any(field in words for words in certificate.reasons) != holds


def test_the_tools_limit_binds_by_the_faster_end_of_each_piece() -> None:
    base = step_of(1, 0.4, 1.0)
    t = np.array([0.0, 0.1, 0.25, 0.5, 0.8, 1.0])
    c = np.zeros((6, 5, 6))
    for k in range(5):  # the same motion in pieces whose ends are not equally fast
        for j in range(6):
            p = np.poly1d(base.coefficients[:, 0, j])(np.poly1d([1.0, t[k]]))
            c[6 - len(p.coef) :, k, j] = p.coef
    trajectory = Trajectory(PPoly(c, t))
    for field, speed in zip(TOOL_SPEEDS, oracles.speeds(PAPER, trajectory, t).T, strict=True):
        binding = certified(trajectory, MotionLimits(**{field: 0.7})).binding
        np.testing.assert_allclose(binding.ratio, np.maximum(speed[:-1], speed[1:]) / 0.7, rtol=1e-9)
        assert set(zip(binding.limit, binding.joint, strict=True)) == {(field, "tool")}


@pytest.mark.parametrize("size", [-1.3, -1.1])
def test_the_least_singular_value_is_found_where_it_is(size: float) -> None:
    """The wrist passes its straight place at no instant of any even grid."""
    trajectory = step_of(4, size, 2.0)
    certificate = certified(trajectory, MotionLimits())
    assert certificate.singular_value < 2e-5
    found = minimize_scalar(
        lambda t: abs(float(trajectory(t)[4])), bounds=(0.5, 1.8), method="bounded", options={"xatol": 1e-9}
    )
    assert certificate.t_singular_value == pytest.approx(found.x, abs=2e-4)
    at = oracles.smallest(PAPER, trajectory(certificate.t_singular_value))
    assert certificate.singular_value == pytest.approx(float(at), abs=1e-12)


@pytest.mark.parametrize("size", [1e-6, 1e-3])
def test_the_speeds_of_a_slow_tool_are_bounded_as_sharply_as_those_of_a_fast_one(size: float) -> None:
    trajectory = step_of(1, size, 1.0)
    certificate = certified(trajectory, MotionLimits())
    largest = oracles.speeds(PAPER, trajectory, np.linspace(0.0, 1.0, 20_001)).max(axis=0)
    for found, said in zip(largest, (certificate.tool_speed.value, certificate.rotation_speed.value), strict=True):
        assert found <= said * (1.0 + 1e-12)
        assert said <= max(found * (1.0 + 3e-6), 1e-6)


@pytest.mark.parametrize("joint", range(6))
def test_rest_is_that_of_every_joint(joint: int) -> None:
    c = np.zeros((6, 1, 6))
    c[5, 0], c[3, 0, joint] = START, 0.05  # from rest, and still moving at the end
    other = (joint + 1) % 6
    c[:, 0, other] += step_of(other, 0.1, 1.0).coefficients[:, 0, other] * np.array([1, 1, 1, 1, 1, 0.0])
    assert certified(Trajectory(PPoly(c, [0.0, 1.0])), MotionLimits()).rest == (True, False)
    back = c.copy()
    for j in range(6):
        p = np.poly1d(c[:, 0, j])(np.poly1d([-1.0, 1.0]))
        back[:, 0, j] = 0.0
        back[6 - len(p.coef) :, 0, j] = p.coef
    assert certified(Trajectory(PPoly(back, [0.0, 1.0])), MotionLimits()).rest == (False, True)
