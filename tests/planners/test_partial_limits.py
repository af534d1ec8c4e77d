"""Limits that are known for some joints only: no warning, and the motion of limits that are too large to bind."""

import numpy as np
import pytest

import optik
import planners
from optik import Robot

inf = np.inf
MIXED = np.array([inf, 150.0, inf, inf, 28.0, inf])
"""Torque limits of which most are unknown [N·m]; a URDF has the effort 0 there."""
UR5E = optik.load("ur5e")
ARM = Robot.from_urdf(UR5E.with_limits(torque=MIXED).to_urdf())
FREE = {
    "torque": MIXED,
    "torque, two sides": np.array([-MIXED, 0.9 * MIXED]),
    "torque rate": np.array([inf, 1500.0, inf, 200.0, inf, inf]),
    "acceleration, two sides": np.array([[-8.0, -inf, -9.0, -10.0, -inf, -10.0], [8.0, inf, 10.0, 10.0, inf, 9.0]]),
}
"""Bounds with infinite parts, by the name of their limit."""
START = np.array([0.2, -1.2, 1.5, -0.4, 0.8, 0.1])
POSE = UR5E.fk(START)
LINE = planners.Line(POSE, POSE @ optik.se3.pose(p=(0.1, 0.05, 0.03)))
PATHS = {
    "line": (LINE, START),
    "between": (planners.PointToPoint(ARM, START, START + 0.4), None),
    "free": (planners.free(LINE, turn=True), START),
}


def limited(name, bound):
    kind = name.split(",")[0].replace(" ", "_")
    return planners.MotionLimits.of(ARM, **{"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0} | {kind: bound})


def test_efforts_of_zero_are_unknown():
    assert (ARM.limits.torque == MIXED).all()


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", FREE)
def test_an_unknown_limit_is_one_that_does_not_bind(name, path):
    plans = [
        planners.plan(ARM, PATHS[path][0], PATHS[path][1], limits=limited(name, bound))  # warnings are errors here
        for bound in (FREE[name], np.where(np.isinf(FREE[name]), np.sign(FREE[name]) * 1e7, FREE[name]))
    ]
    assert all(plans)
    times = [plan.trajectory.duration for plan in plans]
    assert abs(times[0] / times[1] - 1.0) < 1e-4
    stop = planners.replan(plans[0], 0.4 * times[0], stop=True)
    assert stop


def test_friction_that_takes_all_of_a_limit_is_a_reason_and_no_warning():
    robot = ARM.with_inertia(coulomb=np.array([0.0, 0.0, 0.0, 0.0, 28.0, 0.0]))
    plan = planners.plan(
        robot, LINE, START, limits=planners.MotionLimits.of(robot, velocity=2.0, acceleration=10.0, jerk=100.0)
    )
    assert not plan
    assert plan.failure.joint == "joint5"
