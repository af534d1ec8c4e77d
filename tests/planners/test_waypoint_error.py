"""The path error along a polyline with sharp corners, against the discrete Fréchet distance of dense samples."""

from itertools import pairwise

import numpy as np
import pytest

import optik
import planners
from optik.types import Array
from planners.trajectory.controller import trajectory_through

ARM = optik.load("panda")
REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def discrete_frechet(distances: Array) -> float:
    """The discrete Fréchet distance from all distances (k, m), row by row (Eiter and Mannila 1994)."""
    row = np.maximum.accumulate(distances[0])
    for each in distances[1:]:
        new = np.empty_like(row)
        new[0] = max(row[0], each[0])
        for j in range(1, row.size):
            new[j] = max(each[j], min(row[j], row[j - 1], new[j - 1]))
        row = new
    return float(row[-1])


def sample_polyline(waypoints: Array, parts: int) -> Array:
    """Poses along a polyline: positions linear, rotations about one axis for each segment."""
    poses = [waypoints[0]]
    for T, goal in pairwise(waypoints):
        turn = optik.se3.log_so3(goal[:3, :3] @ T[:3, :3].T)
        for u in np.arange(1, parts + 1) / parts:
            R = optik.se3.exp_so3(u * turn) @ T[:3, :3]
            poses.append(optik.se3.pose(R, (1.0 - u) * T[:3, 3] + u * goal[:3, 3]))
    return np.array(poses)


def wandering(rng: np.random.Generator) -> tuple[planners.Trajectory, Array]:
    """A motion near its waypoints, and the tool's poses at some of its setpoints, displaced."""
    q = REST + np.cumsum(rng.normal(0.0, 0.05, (7, 7)), axis=0)
    motion = trajectory_through(np.linspace(0.0, 3.0, 7), q, np.gradient(q, 0.5, axis=0))
    waypoints = ARM.fk(q[[0, 2, 3, 5, 6]]).copy()
    waypoints[:, :3, 3] += rng.normal(0.0, 2e-3, (5, 3))
    return motion, waypoints


@pytest.mark.parametrize("seed", range(6))
def test_the_bounds_enclose_the_frechet_distance_of_dense_samples(seed: int) -> None:
    motion, waypoints = wandering(np.random.default_rng(seed))
    tool, path = ARM.fk(motion(np.linspace(0.0, motion.end, 900))), sample_polyline(waypoints, 200)
    distance = np.linalg.norm(tool[:, None, :3, 3] - path[:, :3, 3], axis=2)
    turn = 2.0 * np.arcsin(
        np.minimum(1.0, np.linalg.norm(tool[:, None, :3, :3] - path[:, :3, :3], axis=(2, 3)) / 8**0.5)
    )
    step = max(np.linalg.norm(np.diff(x[:, :3, 3], axis=0), axis=1).max() for x in (tool, path))
    true = discrete_frechet(distance)
    off = planners.certify(ARM, waypoints, motion, tolerance=(true, np.pi)).path_error
    assert true - step <= off.distance <= 1.025 * true
    assert off.found_distance <= true + 1e-9 and off.found_distance >= off.distance - 0.03 * true
    wide = 1.05 * off.distance
    off = planners.certify(ARM, waypoints, motion, tolerance=(wide, 0.02)).path_error
    least = discrete_frechet(np.where(distance <= 1.002 * wide + step, turn, np.pi))
    most = discrete_frechet(np.where(distance <= wide - step, turn, np.pi))
    assert 0.98 * least - 0.002 <= off.angle <= 1.02 * most + 0.002


def line_of_tool(points: Array, blend: float) -> planners.Plan:
    start = ARM.fk(REST)
    poses = [optik.se3.pose(start[:3, :3], start[:3, 3] + p) for p in points]
    limits = planners.MotionLimits(2.0, 10.0, 100.0)
    return planners.plan(ARM, planners.Polyline(poses, blend=blend), REST, limits=limits)


CORNERS = np.array([[0.0, 0.0, 0.0], [0.08, 0.0, 0.0], [0.08, 0.08, 0.0], [0.0, 0.08, 0.05]])


def test_a_blended_corner_is_as_far_from_its_waypoint_as_it_was_planned() -> None:
    plan = line_of_tool(CORNERS, 5e-4)
    waypoints = plan.path.waypoints
    proof = planners.certify(ARM, waypoints, plan.trajectory, plan.motion.limits, tolerance=(1e-3, 0.01))
    assert proof.is_valid and 4.99e-4 < proof.path_error.distance < 5.2e-4
    tight = planners.certify(ARM, waypoints, plan.trajectory, plan.motion.limits, tolerance=(4e-4, 0.01))
    assert not tight.is_valid and "off its path" in tight.reasons[0]
    assert tight.path_error.found_distance > 4e-4


@pytest.mark.parametrize("case", ["backwards", "half", "without the spike", "in another order"])
def test_a_motion_that_skips_or_reverses_a_part_is_off_the_path(case: str) -> None:
    plan, waypoints = line_of_tool(CORNERS, 1e-3), line_of_tool(CORNERS, 1e-3).path.waypoints
    spike = np.insert(waypoints, 2, waypoints[1], axis=0)
    spike[2, 2, 3] -= 0.05
    spike = np.insert(spike, 3, waypoints[1], axis=0)
    wanted = {
        "backwards": waypoints[::-1], "half": np.concatenate([waypoints, waypoints[-1:]]),
        "without the spike": spike, "in another order": waypoints[[0, 2, 1, 3]],
    }[case]  # fmt: skip
    if case == "half":
        wanted[-1, :3, 3] += 0.04
    proof = planners.certify(ARM, wanted, plan.trajectory, tolerance=(2e-3, 0.01))
    assert not proof.is_valid and proof.path_error.found_distance > 0.02


def test_waypoints_need_a_tolerance() -> None:
    plan = line_of_tool(CORNERS, 1e-3)
    with pytest.raises(optik.errors.InvalidInput, match="tolerance: expected a largest distance"):
        planners.certify(ARM, plan.path.waypoints, plan.trajectory)
    with pytest.raises(optik.errors.InvalidInput, match="path"):
        planners.certify(ARM, np.eye(4), plan.trajectory, tolerance=(1e-3, 0.1))
