"""Joint paths of free shape: via points without stops, the choice of configurations, and what a certificate proves of them."""

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import optik
from optik import Scene, Shapes
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners import JointLine, MotionLimits, Plan, PointToPoint, plan
from planners.choice.choose import JointChoice
from planners.choice.rows import pass_through
from planners.paths import ViaPoint
from planners.paths.joint_curve import reach_bounds
from planners.timing.optimal import Optimal
from tests import oracles
from tests.seeds import shift_seed

HOME = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.78])
"""A configuration of panda away from its limits."""
LIMITS = MotionLimits(2.0, 10.0, 100.0)
"""Limits of all joints: velocity, acceleration and jerk."""
TOLERANCE = (5e-3, 0.09)
"""Tolerance of via poses [m, rad]."""


@cache
def cycle() -> PointToPoint:
    """Pick and place: over, at and over two places, and back."""
    robot = optik.load("panda")
    down = robot.fk(HOME)
    ways = (
        [0.1, 0.15, 0.0],
        [0.1, 0.15, -0.1],
        [0.1, 0.15, 0.0],
        [0.1, -0.1, 0.0],
        [0.1, -0.1, -0.1],
        [0.1, -0.1, 0.0],
    )
    vias = [ViaPoint(oracles.moved(down, np.array(way), np.zeros(3)), TOLERANCE) for way in ways]
    return PointToPoint(robot, HOME, *vias, HOME)


@cache
def planned() -> Plan:
    return plan(cycle().robot, cycle(), limits=LIMITS)


def nearest_passes(found: Plan, poses: list[Array]) -> list[tuple[float, float, float]]:
    """For each pose the time at which the tool is first nearest to it after the one before, the distance and the angle."""
    passes, after = [], 0.0
    for pose in poses:

        def off(t: Array, pose: Array = pose) -> Array:
            """Distance [m] and angle [rad] of the tool at times (k,), (k, 2)."""
            tool = found.robot.fk(found.trajectory(t))
            cosine = (np.einsum("kij,ij->k", tool[:, :3, :3], pose[:3, :3]) - 1.0) / 2.0
            distance = np.linalg.norm(tool[:, :3, 3] - pose[:3, 3], axis=1)
            return np.stack([distance, np.arccos(np.clip(cosine, -1.0, 1.0))], axis=1)

        def worst(t: Array, off: Any = off) -> Array:
            return np.asarray((off(t) / TOLERANCE).max(axis=1))

        t = np.linspace(after, found.trajectory.duration, 4001)
        for i in np.flatnonzero(worst(t) <= 1.2):  # about to pass: the pass itself may be far shorter than a step
            low, high = t[max(i - 1, 0)], t[min(i + 1, 4000)]
            for _ in range(4):
                fine = np.linspace(low, high, 41)
                best = int(worst(fine).argmin())
                low, high = fine[max(best - 1, 0)], fine[min(best + 1, 40)]
            if worst(fine)[best] <= 1.0 + found.certificate.path_error.distance / TOLERANCE[0]:
                break
        else:
            raise AssertionError(off(t).min(axis=0))
        after = float(fine[best])
        passes.append((after, *off(fine)[best].tolist()))
    return passes


def test_a_tolerance_below_rounding_is_refused() -> None:
    for tolerance in ((1e-12, 0.1), (1e-3, 1e-12)):
        with pytest.raises(InvalidInput, match="tolerance: expected 1e-06 m and rad or more"):
            ViaPoint(np.eye(4), tolerance)


def test_via_poses_are_passed_in_order_within_their_tolerance_and_without_stops() -> None:
    found = planned()
    assert found
    path = found.path
    assert isinstance(path, PointToPoint)
    passes = np.array(nearest_passes(found, [via.pose for via in path.vias]))
    assert (path.via_errors <= np.array(TOLERANCE) + 1e-9).all() and (path.via_errors[:, 0] > 1e-4).all()
    assert (passes[:, 1:] <= np.array(TOLERANCE) + 1e-5).all(), "inside, but for the error of following the path"
    assert (np.diff(passes[:, 0]) > 0.0).all()
    q = [HOME, *(via.q for via in path.vias), HOME]
    lines = [JointLine(path.robot, a, b) for a, b in pairwise(q)]
    stops = sum(plan(path.robot, one, limits=LIMITS).trajectory.duration for one in lines)
    assert found.trajectory.duration < 0.7 * stops
    t = np.linspace(0.05, 0.95, 500) * found.trajectory.duration
    assert np.abs(found.trajectory(t, 1)).max(axis=1).min() > 1e-3
    for order, most in ((1, 2.0), (2, 10.0), (3, 100.0)):
        t = np.linspace(0.0, found.trajectory.duration, 5000)
        assert np.abs(found.trajectory(t, order)).max() <= most * (1.0 + 1e-9)
    q_end = found.trajectory(found.trajectory.duration)
    np.testing.assert_allclose(q_end, HOME, atol=1e-12)


def test_the_control_points_stay_inside_the_joint_limits() -> None:
    path, limits = planned().path, planned().robot.limits
    assert isinstance(path, PointToPoint)
    assert (path.coefficients >= limits.lower - 1e-9).all()
    assert (path.coefficients <= limits.upper + 1e-9).all()


@pytest.mark.parametrize("tight", [True, False])
def test_a_via_configuration_is_passed_exactly(tight: bool) -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng(5)
    start = np.array([0.2, -1.4, 1.7, -1.9, -1.57, 0.1])
    way = [start + 0.5 * rng.uniform(-1.0, 1.0, 6) for _ in range(2)]
    limits = LIMITS if tight else MotionLimits(2.0, 50.0, 2000.0)
    found = plan(robot, PointToPoint(robot, start, *way, start), limits=limits)
    assert found
    t = np.linspace(0.0, found.trajectory.duration, 200_001)
    q = found.trajectory(t)
    for one in way:
        assert np.abs(q - one).max(axis=1).min() < 3.0 * limits.arrays(6)["velocity"].max() * (t[1] - t[0])
    path = found.path
    assert isinstance(path, PointToPoint)
    assert not path.list_missed()


@pytest.mark.parametrize("name", ["ur5e", "gen3lite", "irb910sc"])
def test_via_points_anywhere_inside_the_limits_are_passed_by_the_first_path(name: str) -> None:
    """Some interpolating splines leave the limits; then control points are put onto them and others take the rest."""
    robot, outside = optik.load(name), 0
    for seed in range(12):
        rng = np.random.default_rng([shift_seed(8), seed])
        q = robot.limits.sample(rng, 6)
        q[2] = robot.limits.upper if seed == 0 else q[2]
        path = PointToPoint(robot, q[0], *(ViaPoint(one) for one in q[1:5]), q[5])
        assert not path.list_missed()
        limits, p = robot.limits, path.coefficients
        assert (p >= limits.lower).all()
        assert (p <= limits.upper).all()
        assert (p[[0, -1]] == q[[0, 5]]).all()
        through = path.spline.interpolate(np.array([0.0, *(via.s for via in path.vias), path.end]), q)
        outside += int(((through < limits.lower) | (through > limits.upper)).any())
        moved = pass_through(path, np.concatenate([p[:1], p[1:-1] + rng.normal(size=p[1:-1].shape), p[-1:]]))
        assert not path.with_coefficients(moved).list_missed()
        assert (moved == limits.clip(moved)).all()
    assert outside > 6


@pytest.mark.parametrize(("timing", "avoid"), [("smooth", False), ("optimal", True), ("smooth", True)])
def test_via_points_near_the_limits_are_passed_by_plans(timing: str, avoid: bool) -> None:
    robot, rng = optik.load("gen3lite"), np.random.default_rng(9)
    robot = robot.with_shapes(Shapes(((6, (0.0, 0.0, 0.0), 0.01),)))
    q = robot.limits.middle + 0.97 * robot.limits.half * np.sign(rng.uniform(-1.0, 1.0, (4, 6)))
    found = plan(
        robot, PointToPoint(robot, *q), q[0], limits=LIMITS, timing=timing, scene=Scene(), avoid=avoid, allow="jerk"
    )
    assert found, found.failure
    assert isinstance(found.path, PointToPoint)
    assert not found.path.list_missed()


def test_a_locked_joint_stays_and_the_others_are_chosen() -> None:
    robot = optik.load("panda")
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[2] = upper[2] = 0.3
    robot = robot.with_limits(lower=lower, upper=upper)
    start, goal = robot.limits.clip(HOME), robot.limits.clip(HOME + 0.8)
    via = robot.limits.clip(HOME + np.array([0.5, -0.5, 0, 0.2, 0.3, 0.1, -0.5]))
    found = plan(robot, PointToPoint(robot, start, ViaPoint(via, TOLERANCE), goal), limits=LIMITS)
    assert found
    assert found.freedom is not None
    assert found.freedom.gain > 0.02


@pytest.mark.parametrize("seed", range(3))
def test_a_direct_move_is_never_slower_than_the_straight_line_and_faster_with_torque(seed: int) -> None:
    robot, rng = optik.load("panda").with_payload(3.0), np.random.default_rng(seed)
    limits = MotionLimits.of(robot)
    low, span = robot.limits.lower, robot.limits.upper - robot.limits.lower
    while True:
        q, goal = (low + span * rng.uniform(0.2, 0.8, 7) for _ in range(2))
        line = plan(robot, JointLine(robot, q, goal), q, limits=limits)
        if line:
            break
    found = plan(robot, PointToPoint(robot, q, goal), limits=limits)
    assert found
    assert found.trajectory.duration <= line.trajectory.duration * (1.0 + 1e-6)


def test_a_straight_path_takes_the_time_of_the_line() -> None:
    robot = optik.load("ur5e")
    q, goal = np.zeros(6), np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.4])
    line, free = plan(robot, JointLine(robot, q, goal), limits=LIMITS), PointToPoint(robot, q, goal)
    found = plan(robot, free, limits=LIMITS, timing="smooth")
    assert found
    assert found.freedom is not None
    assert "only the law optimal" in found.freedom.outcome
    best = plan(robot, free, limits=LIMITS)
    assert best.trajectory.duration <= line.trajectory.duration * (1.0 + 1e-8)


def test_a_motion_of_the_elbow_with_a_resting_tool_is_proved() -> None:
    """The tool says nothing of the position along the path; the joints do."""
    robot = optik.load("panda")
    N = np.linalg.svd(robot.jacobian(HOME))[2][6]
    q = HOME.copy()
    for _ in range(20):
        q = q + 0.02 * np.linalg.svd(robot.jacobian(q))[2][6] * np.sign(np.linalg.svd(robot.jacobian(q))[2][6] @ N)
    found = plan(robot, PointToPoint(robot, HOME, q), limits=LIMITS)
    assert found
    assert found.certificate.path_error.distance < 1e-8
    assert found.certificate.is_valid


def test_limits_of_via_points_change_with_the_control_points_as_their_differences() -> None:
    path = cycle()
    robot, rng = path.robot, np.random.default_rng(0)
    joints = plan(robot, path, limits=LIMITS, timing="smooth").joint_path
    optimum = Optimal().run_with_optimum(joints, LIMITS)[1]
    programme = JointChoice(path, joints, optimum).programme
    p = path.coefficients + 0.02 * rng.normal(size=path.coefficients.shape)
    p[[0, -1]] = path.coefficients[[0, -1]]
    place = programme.place(p, np.zeros((4, programme.K + 1, robot.n)))
    assert place is not None
    rows = slice(programme.rows - 2, programme.rows)

    def values(x: Array) -> Array:
        moved = programme.place(x, place.path)
        assert moved is not None
        return programme.problem(moved).node[:, rows, 3]

    problem, border = programme.problem(place), programme.make_border()
    y = np.ones((programme.K + 1, problem.node.shape[1] + 2 * problem.edge.shape[2]))
    programme.fill(place, optimum.programme.start, y, border)
    assert np.abs(values(p)).max() > 1.0
    limited = np.flatnonzero(np.abs(values(p)).max(axis=1) > 0.0)
    assert limited.size == 6
    for i in rng.choice(np.arange(robot.n, p.size - robot.n), 20, replace=False):
        step = np.zeros(p.size)
        step[i] = 1e-4
        step = step.reshape(p.shape)
        below, here, above = values(p - step), values(p), values(p + step)
        for k in limited:
            c = i - programme.begin[k]
            inside = 0 <= c < programme.width
            slope = border.columns[k, rows, c] if inside else np.zeros(2)
            np.testing.assert_allclose(slope, (above - below)[k] / 2e-4, atol=1e-3)
            bend = (border.bends[k, :, c] ** 2).reshape(2, 3).sum(axis=1) if inside else np.zeros(2)
            exact = (above - 2.0 * here + below)[k] / 1e-8
            assert (np.abs(bend - exact) <= 0.2 * np.abs(exact) + 10.0).all()  # without the curvature of the kinematics


def test_a_file_whose_path_misses_a_via_point_is_refused() -> None:
    data = planned().path.to_dict()
    coefficients = np.array(data["coefficients"])
    coefficients[4:-4] += 0.02
    with pytest.raises(InvalidInput, match="misses the via point"):
        PointToPoint.from_dict({**data, "coefficients": coefficients.tolist()}, planned().robot)


@pytest.mark.parametrize("name", ["ur5e", "irb910sc"])
def test_a_bound_of_a_piece_is_its_largest_sample_and_what_may_be_between_samples(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between samples a derivative rises by at most half their distance times the bound above it, wherever they are."""
    robot, rng, sampled = optik.load(name), np.random.default_rng(11), 0
    for _ in range(3):
        path = PointToPoint(robot, *robot.limits.sample(rng, 4))
        evaluate, seen = PointToPoint.coordinates, []
        monkeypatch.setattr(
            PointToPoint, "coordinates", lambda self, s, f=evaluate, seen=seen: (seen.append(s), f(self, s))[1]
        )
        bounds = path.piece_bounds()
        monkeypatch.setattr(PointToPoint, "coordinates", evaluate)
        at = np.unique(np.concatenate([np.ravel(s) for s in seen]))
        reach = reach_bounds(robot, path.spline.derivative_bounds(path.coefficients, 4))
        turns = oracles.rotation_derivatives(path, at)[1:4]
        norms = [
            [np.linalg.norm(path(at, order)[:, :3], axis=1) for order in (1, 2, 3)],
            [np.linalg.norm(x, ord=2, axis=(1, 2)) for x in turns],
        ]
        for k, (a, b) in enumerate(pairwise(path.breaks)):
            inside = (at >= a) & (at <= b)
            gap = np.diff(np.concatenate([[a - (at[inside][0] - a)], at[inside], [b + (b - at[inside][-1])]])).max()
            for part, order in np.ndindex(2, 3):
                between = norms[part][order][inside].max() + 0.5 * gap * bounds[k, part, order + 1]
                least = min(between, reach[k, part, order])
                assert bounds[k, part, order] >= least * (1.0 - 1e-9)
                sampled += between < reach[k, part, order]
    assert sampled > 100


def test_the_same_points_make_the_same_motion() -> None:
    again = plan(cycle().robot, cycle(), limits=LIMITS)
    assert (again.trajectory.coefficients == planned().trajectory.coefficients).all()


@pytest.mark.parametrize(
    ("points", "kind", "said"),
    [
        ((), InvalidInput, "goal"),
        ((HOME,), InvalidInput, "other joints"),
        ((ViaPoint(HOME + 0.1, TOLERANCE),), InvalidInput, "tolerance"),
        ((np.zeros(3),), InvalidInput, "7"),
        (([HOME + 0.1, HOME + 0.2, 3.0],), InvalidInput, "^target: "),
        (("home",), InvalidInput, "^target: "),
        ((HOME + 9.0,), InvalidInput, "limits"),
        ((np.full(7, np.nan),), InvalidInput, "point 0"),
        ((np.diag([1.0, 1.0, 2.0, 1.0]),), InvalidInput, "point 0"),
        ((oracles.moved(np.eye(4), np.array([5.0, 0.0, 0.0]), np.zeros(3)),), NoSolution, "point 0"),
    ],
)
def test_points_that_no_path_can_have_are_refused(points: Any, kind: type, said: str) -> None:
    with pytest.raises(kind, match=said):
        PointToPoint(optik.load("panda"), HOME, *points)


def test_a_point_that_repeats_the_one_before_is_merged_with_it() -> None:
    robot, via, goal = optik.load("panda"), HOME + 0.2, HOME - 0.1
    plain = PointToPoint(robot, HOME, via, goal)
    path = PointToPoint(robot, HOME, HOME, via, ViaPoint(via + 1e-9, (1e-3, 1e-2)), via, goal - 1e-8, goal)
    assert path.dropped == (1, 3, 4, 5) and plain.dropped == ()
    np.testing.assert_allclose(path.coefficients, plain.coefficients, atol=1e-12)
    assert path.vias[0].tolerance is None and len(path.vias) == 1
    found = plan(robot, path, limits=LIMITS)
    assert "(points merged: 4)" in str(found) and "merged" not in str(plan(robot, plain, limits=LIMITS))
    assert np.abs(found.goal - goal).max() < 1e-12
    with pytest.raises(InvalidInput, match="only points that equal the start"):
        PointToPoint(robot, HOME, HOME, HOME + 1e-9)


def test_misuse_of_via_points_and_arms_is_refused() -> None:
    with pytest.raises(InvalidInput, match="shape"):
        ViaPoint(np.zeros((3, 3)))
    with pytest.raises(InvalidInput, match="arm of this path"):
        plan(optik.load("iiwa14"), cycle(), limits=LIMITS)
