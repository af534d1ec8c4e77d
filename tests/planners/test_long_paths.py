"""What short and near-repeated segments cost, and long paths: by whole plans, from waypoints to a certificate that holds."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import optik
from optik.types import Array
from planners import MotionLimits, Plan, Polyline, plan
from planners.timing._sweep import make_graded_grid

LIMITS = MotionLimits(2.0, 10.0, 100.0)


def corners() -> tuple[Any, Array, list[Array]]:
    robot, q = optik.load("irb120"), np.deg2rad([10.0, 20.0, -10.0, 30.0, 40.0, 20.0])
    poses = [robot.fk(q) for _ in range(4)]
    for pose, move in zip(poses, ([0, 0, 0], [0, 0.05, 0], [0.03, 0.05, 0.03], [0.03, 0, 0.05]), strict=True):
        pose[:3, 3] += move
    return robot, q, poses


@cache
def plain() -> Plan:
    robot, q, poses = corners()
    return plan(robot, Polyline(poses), q, limits=LIMITS)


@pytest.mark.parametrize("where", [1, 2, 4])
@pytest.mark.parametrize("eps", [1e-8, 1e-7, 1e-6, 1e-5, 1e-4])
def test_a_waypoint_that_nearly_repeats_its_neighbour_costs_next_to_nothing(eps: float, where: int) -> None:
    robot, q, poses = corners()
    again = poses[where - 1].copy()
    again[:3, 3] += np.array([0.6, -0.5, 0.62]) * eps
    made = plan(robot, Polyline([*poses[:where], again, *poses[where:]]), q, limits=LIMITS)
    assert made, made.failure
    assert made.trajectory.end < 1.05 * plain().trajectory.end


@cache
def winding(count: int) -> tuple[Any, Array, Polyline]:
    """A rough curve through so many waypoints."""
    robot, q = optik.load("ur10e"), np.deg2rad([20.0, -80.0, 100.0, -100.0, -90.0, 30.0])
    rng, start, poses = np.random.default_rng(0), robot.fk(q), []
    for u in np.linspace(0.0, 1.0, count):
        pose = start.copy()
        pose[:3, 3] += [0.15 * np.sin(4 * np.pi * u), 0.2 * u - 0.1, 0.1 * np.cos(4 * np.pi * u) - 0.1]
        pose[:3, 3] += 0.15 / count * rng.normal(size=3)
        poses.append(pose)
    poses[0] = start
    return robot, q, Polyline(poses, blend=1e-3)


@pytest.mark.parametrize("law", ["optimal", "ruckig", "toppra"])
def test_hundreds_of_waypoints_are_planned_by_every_law(law: str) -> None:
    robot, q, path = winding(300)
    made = plan(robot, path, q, limits=LIMITS, timing=law, allow="jerk")
    assert made, made.failure


@pytest.mark.soak
@pytest.mark.parametrize("law", ["optimal", "ruckig", "toppra"])
@pytest.mark.parametrize("count", [1000, 3000])
def test_thousands_of_waypoints_are_planned_by_every_law(count: int, law: str) -> None:
    robot, q, path = winding(count)
    made = plan(robot, path, q, limits=LIMITS, timing=law, allow="jerk")
    assert made, made.failure


def test_breaks_that_differ_by_rounding_make_no_cells() -> None:
    """Corners of dense polylines may end where the next one begins, but for the last bit."""
    breaks = np.array([0.0, 0.1, np.nextafter(0.1, 1.0), 0.2, 0.2 + 1e-16, 0.3])
    grid, plain = (make_graded_grid(b, 0.3, 64, 4) for b in (breaks, np.array([0.0, 0.1, 0.2, 0.3])))
    np.testing.assert_allclose(grid, plain, rtol=0.0, atol=1e-12)
    assert np.diff(grid).min() > 1e-6
