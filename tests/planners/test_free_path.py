"""Ranges of the coordinates of a path with freedoms."""

import numpy as np

import optik
from planners import free, plan
from planners.paths.free_path import FreePath
from tests.planners.test_freedom import LIMITS, PANDA, line


def test_the_range_of_the_elbow_holds_its_coordinate_along_the_motion() -> None:
    robot = optik.load("panda")
    path = free(line(robot, PANDA), elbow=0.1, turn=0.5)
    found = plan(robot, path, PANDA, limits=LIMITS)
    assert found.freedom is not None and path.ranges[0].reached == (0.0, 0.0)
    elbow, turn = found.freedom.ranges
    low, high = elbow.reached
    assert (elbow.name, turn.name, elbow.allowed) == (
        "elbow",
        "turn",
        (-0.1, 0.1),
    ) and -0.1 - 1e-9 <= low < high <= 0.1 + 1e-9
    chosen = type(path).from_dict(found.path.to_dict(), robot)
    assert isinstance(chosen, FreePath) and chosen.null_space is not None and chosen.ranges == found.freedom.ranges
    s = np.linspace(0.0, path.end, 50)
    change = (
        found.joint_path(s) @ chosen.null_space.rows.T - path.spline.basis(s).combine(chosen.null_space.initial)[:, 0]
    )
    assert np.abs(change).max() > 0.02 and low - 1e-6 <= change.min() and change.max() <= high + 1e-6
    np.testing.assert_allclose(chosen.values_of_ranges(s)[:, 0], change[:, 0], atol=1e-6)
    values = found.freedom.values
    assert values.shape == (found.freedom.s.size, 2)
    for k, one in enumerate(found.freedom.ranges):
        assert one.reached[0] - 1e-12 <= values[:, k].min() < values[:, k].max() <= one.reached[1] + 1e-12
