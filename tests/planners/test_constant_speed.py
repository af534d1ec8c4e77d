"""Constant speed along seams as CAM and scanners write them: straight runs, near breaks, noise, corners that nearly return."""

import re

import numpy as np
import pytest

import optik
from optik.types import Array
from planners import MotionLimits, Plan, Polyline, make_law, plan
from planners.planning import PlanStatus
from tests.figures.constant_speed import bound
from tests.planners.cases import START

ROBOT = optik.load("paper6r")
LIMITS = MotionLimits(2.0, 10.0, 150.0)


def seam(points: Array) -> Polyline:
    """A polyline through points (k, 2) [m] beside the start, in a plane, the tool's orientation fixed."""
    poses = np.tile(ROBOT.fk(START), (len(points), 1, 1))
    poses[:, 1, 3] += points[:, 0]
    poses[:, 2, 3] += points[:, 1]
    return Polyline(poses)


def zigzag(count: int, degrees: float, length: float) -> Array:
    """Legs of a length, alternately straight on and turned by an angle."""
    heading = np.radians(degrees) * (np.arange(count) % 2)
    steps = length * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def tool_speeds(found: Plan, share: Array) -> Array:
    """Speeds of the tool at shares of the duration, by differences of its position."""
    motion = found.trajectory
    t, dt = share * motion.duration, 1e-5 * motion.duration
    ahead, behind = (ROBOT.fk(motion(t + k * dt))[:, :3, 3] for k in (1, -1))
    return np.asarray(np.linalg.norm(ahead - behind, axis=1) / (2.0 * dt))


@pytest.mark.parametrize("count", [8, 81])
def test_a_straight_run_of_many_waypoints_is_one_line(count: int) -> None:
    law = make_law("constant_speed", speed=0.05)
    run = plan(ROBOT, seam(np.outer(np.linspace(0.0, 0.08, count), [0.6, 0.8])), START, timing=law, limits=LIMITS)
    line = plan(ROBOT, seam(np.outer([0.0, 0.08], [0.6, 0.8])), START, timing=law, limits=LIMITS)
    assert run and line
    assert run.trajectory.duration == pytest.approx(line.trajectory.duration, rel=1e-3)
    speeds = tool_speeds(run, np.linspace(0.3, 0.7, 50))
    np.testing.assert_allclose(speeds, 0.05, rtol=1e-5)


def test_pieces_of_nanometres_between_corners_do_not_slow_the_tool() -> None:
    rng = np.random.default_rng(21)
    heading = np.cumsum(np.full(199, 0.5e-3)) / 0.05
    length = 0.5e-3 + 2e-8 * rng.uniform(-1.0, 1.0, 199)
    steps = length[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    path = seam(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))
    assert np.diff(path.breaks).min() < 1e-7
    found = plan(ROBOT, path, START, timing=make_law("constant_speed", speed=0.02), limits=LIMITS)
    assert found, found.failure
    np.testing.assert_allclose(tool_speeds(found, np.linspace(0.3, 0.7, 97)), 0.02, rtol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_refusal_is_true_from_both_sides(seed: int) -> None:
    rng = np.random.default_rng([21, seed])
    count = int(rng.integers(20, 60))
    points = zigzag(count, rng.uniform(20.0, 150.0), rng.uniform(1e-3, 3e-3)) + rng.normal(size=(count + 1, 2)) * 3e-5
    path = seam(points - points[0])
    refused = plan(ROBOT, path, START, timing=make_law("constant_speed", speed=2.0), limits=LIMITS)
    assert refused.status is PlanStatus.TIMING_INFEASIBLE
    assert refused.failure is not None and "timing='optimal' with tool_speed=2" in refused.failure.advice
    named = float(refused.failure.advice.removeprefix("speed=").split(" or less")[0])
    slower = plan(ROBOT, path, START, timing=make_law("constant_speed", speed=0.95 * named), limits=LIMITS)
    assert slower, slower.failure
    np.testing.assert_allclose(slower.speed, 0.95 * named, rtol=1e-12)
    low, middle = bound(slower.joint_path, LIMITS)
    assert 0.95 * low <= named <= 1.02 * middle


def test_a_speed_is_chosen_only_where_it_is_no_crawl_beside_a_sweep() -> None:
    path = seam(zigzag(30, 179.9, 1e-3))  # corners everywhere, so half of the path allows as little as the sharpest one
    crawl = plan(ROBOT, path, START, timing="constant_speed", limits=LIMITS)
    assert crawl.status is PlanStatus.TIMING_INFEASIBLE and crawl.failure is not None
    slow, quick = map(
        float,
        re.findall(r"take ([\d.e+]+) s, one that slows at corners only about ([\d.e+]+) s", crawl.failure.reason)[0],
    )
    assert slow > 1e3 * quick
    optimal = plan(ROBOT, path, START, limits=LIMITS)
    assert quick == pytest.approx(optimal.trajectory.duration, rel=0.5)
    assert plan(ROBOT, seam(zigzag(30, 90.0, 1e-3)), START, timing="constant_speed", limits=LIMITS)


def test_a_refusal_by_a_ramp_says_so_and_a_longer_ramp_allows_more() -> None:
    path = seam(np.outer(np.linspace(0.0, 0.01, 20), [0.6, 0.8]))
    named = []
    for ramp in (0.25, 0.5):
        refused = plan(ROBOT, path, START, timing=make_law("constant_speed", speed=1.0, ramp=ramp), limits=LIMITS)
        assert refused.failure is not None and f"in a ramp of {ramp:g} of the distance" in refused.failure.reason
        assert ("a longer ramp=" in refused.failure.advice) == (ramp < 0.5)
        named.append(float(refused.failure.advice.removeprefix("speed=").split(" or less")[0]))
        law = make_law("constant_speed", speed=0.95 * named[-1], ramp=ramp)
        assert plan(ROBOT, path, START, timing=law, limits=LIMITS)
    assert named[1] > 1.3 * named[0]
