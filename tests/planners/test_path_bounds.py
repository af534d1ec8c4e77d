"""Kernels of the path error, small enough for plain Python, in which no index leaves an array."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from optik import DHRow, JointLimits, Robot
from planners import JointLine, Trajectory
from planners.certificate.path_error import _fall, path_error


@pytest.mark.parametrize("still", [(False, False), (True, False), (False, True), (True, True)])
def test_a_cubic_goes_back_as_far_as_its_dense_values(still: tuple[bool, bool]) -> None:
    """Also of cubics at rest at their ends, of squares, and of straight lines."""
    rng, u = np.random.default_rng(1), np.linspace(0.0, 1.0, 20_001)
    for k in range(60):
        s0, s1, v0, v1 = rng.normal(size=4) * [1.0, 1.0, not still[0], not still[1]] * [1.0, 1.0, 9.0, 9.0]
        if k % 4 == 0:
            v1 = 2.0 * (s1 - s0) - v0
        cubic = np.polynomial.Polynomial([s0, v0, 3.0 * (s1 - s0) - 2.0 * v0 - v1, 2.0 * (s0 - s1) + v0 + v1])
        begin, high, end, low = _fall(s0, v0, s1, v1)
        back = (np.maximum.accumulate(cubic(u)) - cubic(u)).max()
        assert high - low == pytest.approx(back, abs=1e-6)
        assert (high, low) == pytest.approx((cubic(begin), cubic(end)), abs=1e-12)


def test_a_slider_on_its_line_is_proved_to_be_on_it() -> None:
    robot = Robot.from_mdh([DHRow(0.0, 0.0, 0.0, 0.0, True)], JointLimits([-9.0], [9.0]))
    c = np.zeros((6, 1, 1))
    c[:3, 0, 0] = 6.0, -15.0, 10.0
    line = JointLine(robot, [0.0], [1.0])
    proved, passage = path_error(robot, line, Trajectory(PPoly(c, [0.0, 1.0])))
    assert proved.distance <= 1e-9 and proved.angle <= 1e-9
    assert passage.s[[0, -1]].tolist() == [0.0, 1.0]
