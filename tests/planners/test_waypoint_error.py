"""The path error along a polyline with sharp corners, against the discrete Fréchet distance of dense samples."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
import planners
from optik import JointLimits, Robot
from optik.ik.base import Tolerance
from optik.types import Array
from planners import Trajectory
from planners.certificate import frechet
from planners.paths.poses import embed_poses
from planners.trajectory.curve import quintic_through
from planners.trajectory.trajectory import trajectory_through
from tests import oracles

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
    tool, path = ARM.fk(motion(np.linspace(0.0, motion.end, 450))), sample_polyline(waypoints, 100)
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


# ---------------------------------------------------------------- closed forms, and the kernels in plain Python
def chain_of(*slides: bool, link: float = 0.0) -> Robot:
    """Joints about or along z, each turned by 90° about x against the one before."""
    fixed = [oracles.pose([0.5 * np.pi * (i > 0), 0, 0], [0.0, 0.0, link * (i > 0)]) for i in range(len(slides))]
    limits = JointLimits(np.full(len(slides), -99.0), np.full(len(slides), 99.0))
    return Robot("chain", np.array(fixed), np.array(slides), np.eye(4), limits)


@pytest.mark.parametrize("slides", [True, False])
@pytest.mark.parametrize("share", [0.005, 0.05, -0.005, -0.05])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_tool_that_ends_beyond_or_before_its_last_waypoint_is_as_far_off(
    slides: bool, share: float, side: int
) -> None:
    """The share is one of the segment; inside, the tool goes along the waypoints exactly. So at the first one."""
    robot, marks = chain_of(slides), np.array([0.0, 0.23, 0.5])[::side]
    q, beyond, still = marks.copy(), abs(share) * 0.27, np.zeros((3, 1))
    q[-1 if side > 0 else 0] += share * 0.27
    motion = Trajectory(quintic_through(np.array([0.0, 1.0, 2.0]), q[:, None], still, still))
    tolerance = Tolerance(0.4 * beyond, 0.4 * beyond)
    found = frechet.waypoint_error(robot, motion, robot.fk(marks[:, None]), tolerance)
    off, least = (found.distance, found.found_distance) if slides else (found.angle, found.found_angle)
    assert beyond <= off <= 1.02 * beyond and 0.98 * beyond <= least <= beyond
    assert (found.angle if slides else found.distance) <= 0.02 * beyond


def dense(points: Array, parts: int) -> Array:
    u = np.linspace(0.0, len(points) - 1.0, (len(points) - 1) * parts + 1)
    return np.stack([np.interp(u, np.arange(len(points)), x) for x in points.T], axis=1)


@pytest.fixture
def plain_follow(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The kernel in plain Python, where numpy raises if an index leaves an array: of points of the plane."""
    follow, free = (getattr(x, "py_func", x) for x in (frechet._follow, frechet._free))
    monkeypatch.setattr(frechet, "_free", free)

    def reaches(tool: Array, edges: Array, distance: float, first: int) -> bool:
        wide = [np.zeros((len(x), 12)) for x in (tool, edges)]
        for full, x in zip(wide, (tool, edges), strict=True):
            full[:, first : first + x.shape[1]] = x
        allowed = np.array([distance**2, np.inf] if first < 3 else [np.inf, distance**2])
        return bool(follow(*wide, allowed) == len(tool))

    return reaches


@pytest.mark.parametrize("seed", range(8))
def test_chords_follow_edges_within_the_distance_of_dense_points(seed: int, plain_follow: Any) -> None:
    rng, first = np.random.default_rng(seed), (0, 1, 3, 10)[seed % 4]
    edges = np.cumsum(rng.normal(size=(2 + seed // 2, 2)), axis=0)
    tool = dense(edges, 3) + 0.2 * rng.normal(size=(3 * len(edges) - 2, 2))
    parts = dense(tool, 15), dense(edges, 45)
    true = discrete_frechet(np.linalg.norm(parts[0][:, None] - parts[1], axis=2))
    step = max(np.linalg.norm(np.diff(x, axis=0), axis=1).max() for x in parts)
    assert plain_follow(tool, edges, true + 1e-9, first) and not plain_follow(tool, edges, true - step, first)
    point = edges[:1].repeat(3, axis=0)  # edges without length
    spread = float(np.linalg.norm(tool - edges[0], axis=1).max())
    assert plain_follow(tool, point, spread + 1e-9, first) and not plain_follow(tool, point, spread - 1e-9, first)


def test_who_turns_back_is_half_of_the_way_back_away(plain_follow: Any) -> None:
    """Within one edge, and over several; the tool, or the edges."""
    for one in ([0.0, 0.8, 0.2, 1.0], [0.0, 0.5, 0.8, 0.5, 0.2, 0.6, 1.0]):
        for other in ([0.0, 1.0], [0.0, 0.3, 0.5, 0.7, 1.0]):
            for tool, edges in ((one, other), (other, one)):
                tool, edges = (np.array(x)[:, None] for x in (tool, edges))
                assert plain_follow(tool, edges, 0.3 + 1e-9, 2) and not plain_follow(tool, edges, 0.3 - 1e-9, 2)


@pytest.mark.parametrize("slides", [(False,), (False, True), (True, False), (False, False), (False, True, False)])
def test_no_instant_is_farther_from_its_chord_than_is_said(slides: tuple[bool, ...]) -> None:
    """Also where a slider is farther out between the knots than at them."""
    rng = np.random.default_rng(len(slides))
    robot = chain_of(*slides, link=0.2)
    for k in range(6):
        v = rng.normal(size=(2, robot.n)) * [[1.0], [9.0]]
        out = np.array([0.0, 0.0, 0.0, 16.0, -32.0, 16.0])[::-1, None, None] * np.array(slides) * rng.uniform(0.5, 3.0)
        c = np.zeros((6, 1, robot.n))
        c[4], c[3] = (30.0 * ~np.array(slides), 0.0) if k == 4 else (v[0], v[1] * (k % 2))
        c += np.where(k > 2, out, 0.0)
        motion, allowed = Trajectory(PPoly(c, [0.0, 1.0])), np.array([3e-3, 1e-2])
        t, chords = frechet._sample_tool(robot, motion, allowed)
        assert (chords.off <= allowed * (1.0 + 1e-12)).all()
        for a, b, p, q in zip(t[:-1], t[1:], chords.points[:-1], chords.points[1:], strict=True):
            u = np.linspace(0.0, 1.0, 5)[1:-1, None]
            between = embed_poses(robot.fk(motion(a + (b - a) * u[:, 0])), 1.0) - (p + u * (q - p))
            far = np.linalg.norm(between[:, :3], axis=1).max(), np.linalg.norm(between[:, 3:], axis=1).max()
            assert (np.array(far) <= chords.off * (1.0 + 1e-9) + 1e-12).all()


def test_a_turning_segment_stays_near_its_chords() -> None:
    robot = chain_of(False)
    q = np.array([[0.0], [1.3], [1.3], [-0.5]])
    for allowed in (1e-2, 1e-4):
        edges = frechet._divide_turns(robot.fk(q), allowed)
        assert edges.off[0] == 0.0 and 0.5 * allowed < edges.off[1] <= allowed
        angles = dense(q, 40)
        points = embed_poses(robot.fk(angles), 1.0)[:, 3:]
        along = dense(edges.points[:, 3:], 40)
        assert np.linalg.norm(points[:, None] - along, axis=2).min(axis=1).max() <= edges.off[1] + 1e-12
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() == pytest.approx(2.0 * np.sin(1.8 / 80.0), rel=1e-9)
