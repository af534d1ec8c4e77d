"""Arms with three to five joints: only the tool's point follows a path, or its point and axis; oracles are plain NumPy."""

from pathlib import Path as File
from typing import Any

import numpy as np
import pytest

import optik
from optik import DHRow, JointLimits, Robot, Scene, Shapes, se3
from optik.errors import InvalidInput
from optik.types import Array
from planners import Arc, Line, MotionLimits, Part, Plan, Polyline, Program, certify, free, load_motion, plan, replan
from planners.certificate.bounds import MotionBounds
from planners.certificate.path_error import compare_with_path, path_error
from planners.certificate.projection import PathPositions
from planners.following.freed import find_distance
from planners.limits import PathPoints
from planners.paths.base import Path
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through

LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
POINT: dict[str, Any] = {"turn": True, "tilt": True}
AXIS: dict[str, Any] = {"turn": True}
UP = {"a": 0.0, "alpha": np.pi / 2.0, "d": 0.2}
ROWS = {
    "three": [UP, {"a": 0.3}, {"a": 0.25}],
    "four": [UP, {"a": 0.3}, {"a": 0.25}, {"a": 0.1}],
    "five": [UP, {"a": 0.3}, {"a": 0.25}, {"a": 0.05, "alpha": np.pi / 2.0}, {"a": 0.04, "alpha": 1.1, "d": 0.1}],
    "rolling": [UP, {"a": 0.3}, {"a": 0.25}, {"a": 0.05, "alpha": np.pi / 2.0}, {"d": 0.1}],
    "flat2": [{"a": 0.3}, {"a": 0.3}],
    "flat3": [{"a": 0.3}, {"a": 0.3}, {"a": 0.2}],
    "flat4": [{"a": 0.3}, {"a": 0.3}, {"a": 0.2}, {"a": 0.1}],
}
Q = np.array([-0.4, 0.9, -1.3, 0.6, 0.5])


def make(name: str, most: float = 3.1) -> Robot:
    rows, base = ROWS[name], se3.pose(se3.exp_so3([0.3, -0.5, 0.2]), (0.1, 0.2, 0.3))
    limits = JointLimits(np.full(len(rows), -most), np.full(len(rows), most))
    return Robot.from_dh([DHRow(**row) for row in rows], limits, name=name, base=base)


def line(robot: Robot, move: Any, q: Array | None = None) -> tuple[Line, Array]:
    """Return a line from a configuration, in the frame of the base's table, and the configuration."""
    q = Q[: robot.n] if q is None else q
    start, goal = robot.fk(q), robot.fk(q)
    goal[:3, 3] += np.linalg.norm(move) * (robot.fixed[0][:3, :3] @ move) / np.linalg.norm(move)
    return Line(start, goal), q


def continue_point(robot: Robot, q: Array, path: Path, axis: bool = False, steps: int = 400) -> Array | None:
    """Return configurations (k, n) by steps of least norm for the rows of the point, and of the axis; None if they end."""
    found = [q]
    for s in np.linspace(0.0, path.end, steps + 1)[1:]:
        T, q = path.pose(s), found[-1].copy()
        for _ in range(6):
            at, J = robot.fk(q), robot.jacobian(q)
            error, rows = T[:3, 3] - at[:3, 3], J[:3]
            if axis:
                error = np.append(error, T[:3, :2].T @ np.cross(at[:3, 2], T[:3, 2]))
                rows = np.concatenate([rows, T[:3, :2].T @ J[3:]])
            q = q + np.linalg.pinv(rows) @ error
        if np.abs(error).max() > 1e-10 or not robot.limits.contains(q):
            return None
        found.append(q)
    return np.array(found)


def deviations(robot: Robot, path: Path, motion: Trajectory, count: int = 4001) -> tuple[float, float]:
    """Return the largest distance and angle of the axis to the nearest point of a straight path, at instants."""
    T, start, goal = robot.fk(motion(np.linspace(0.0, motion.duration, count))), path.pose(0.0), path.pose(path.end)
    along = (goal - start)[:3, 3] / path.end
    off = T[:, :3, 3] - start[:3, 3]
    off -= np.clip(off @ along, 0.0, path.end)[:, None] * along
    angle = np.arccos(np.clip(T[:, :3, 2] @ start[:3, 2], -1.0, 1.0))
    return float(np.linalg.norm(off, axis=1).max()), float(angle.max())


def assert_follows(found: Plan, path: Path, axis: bool = False) -> None:
    assert found, found
    assert found.certificate.is_valid and found.certificate.path_error.distance <= 1e-8
    distance, angle = deviations(found.robot, path, found.trajectory)
    assert distance <= found.certificate.path_error.distance + 1e-14
    if axis:
        assert angle <= found.certificate.path_error.angle + 3e-8  # of arccos
    for order, most in ((1, 2.0), (2, 10.0), (3, 100.0)):
        assert np.abs(found.trajectory(np.linspace(0.0, found.duration, 4001), order)).max() <= most * (1.0 + 1e-9)


# ---------------------------------------------------------------- following
@pytest.mark.parametrize("name", ["three", "four", "five", "rolling"])
@pytest.mark.parametrize("held", [True, False])
def test_only_the_point_follows_a_line_that_no_pose_can(name: str, held: bool) -> None:
    robot = make(name)
    path, q = line(robot, [-0.06, 0.08, 0.04])
    assert not plan(robot, path, q, limits=LIMITS)
    found = plan(robot, free(path, **POINT), q if held else None, limits=LIMITS)
    assert_follows(found, path)
    assert found.certificate.asked == "point" and "rad" not in str(found).split("path error")[1].split(",")[0]


def test_three_joints_move_as_a_continuation_of_three_rows() -> None:
    robot = make("three")
    path, q = line(robot, [-0.06, 0.08, 0.04])
    expected = continue_point(robot, q, path)
    assert expected is not None
    found = plan(robot, free(path, **POINT), q, limits=LIMITS).joint_path
    np.testing.assert_allclose(found(np.linspace(0.0, path.end, len(expected))), expected, atol=1e-9)


def test_five_joints_follow_point_and_axis_as_a_continuation_of_five_rows() -> None:
    robot = make("five")
    path, q = line(robot, [0.03, 0.04, -0.02])
    expected = continue_point(robot, q, path, axis=True)
    assert expected is not None
    found = plan(robot, free(path, **AXIS), q, limits=LIMITS)
    assert_follows(found, path, axis=True)
    assert found.certificate.asked == "axis"
    np.testing.assert_allclose(found.joint_path(np.linspace(0.0, path.end, len(expected))), expected, atol=1e-8)
    turned = se3.error(robot.fk(found.trajectory(found.duration)), path.pose(path.end))
    assert np.linalg.norm(turned[3:]) > 1e-3, "the turn is not asked"
    assert_follows(plan(robot, free(path, **AXIS), limits=LIMITS), path, axis=True)
    start, goal = (path.pose(s) @ se3.pose(se3.exp_so3([0.0, 0.0, 2.0]), np.zeros(3)) for s in (0.0, path.end))
    same = plan(robot, free(Line(start, goal), **AXIS), q, limits=LIMITS)
    assert same.duration == pytest.approx(found.duration, rel=1e-6), "the start has its own turn"


def test_a_last_joint_about_the_tools_axis_leaves_four_joints_for_point_and_axis() -> None:
    robot = make("rolling")
    path, q = line(robot, [-0.06, 0.08, 0.04])
    refused = plan(robot, free(path, **AXIS), q, limits=LIMITS)
    assert not refused and refused.failure is not None
    assert "joint5 turns the tool about its axis only" in refused.failure.reason
    assert "point and axis are asked" in refused.failure.reason and "tilt=True" in refused.failure.advice
    radial = robot.fk(q)[:3, 3] - robot.fixed[0][:3, 3]
    up = robot.fixed[0][:3, 2]
    radial -= (radial @ up) * up
    goal = robot.fk(q)
    goal[:3, 3] -= 0.1 * radial / np.linalg.norm(radial)  # in the arm's own vertical plane
    assert_follows(
        plan(robot, free(Line(robot.fk(q), goal), **AXIS), q, limits=LIMITS), Line(robot.fk(q), goal), axis=True
    )


@pytest.mark.parametrize("turn", [np.eye(3)[i] * np.pi / 2.0 for i in range(3)])
def test_the_given_rotation_does_not_matter_where_only_the_point_is_asked(turn: Array) -> None:
    robot = make("three")
    path, q = line(robot, [-0.06, 0.08, 0.04])
    start, goal = (path.pose(s) @ se3.pose(se3.exp_so3(turn), np.zeros(3)) for s in (0.0, path.end))
    found, expected = (plan(robot, free(one, **POINT), q, limits=LIMITS) for one in (Line(start, goal), path))
    assert found.duration == pytest.approx(expected.duration, rel=1e-9)
    assert_follows(plan(robot, free(Line(start, goal), **POINT), limits=LIMITS), path)


def test_no_rotation_of_the_tool_is_singular_for_a_point() -> None:
    robot, q = make("three"), np.array([-0.9, 0.9, -1.3])
    goal = q + np.array(
        [np.pi / 2.0, -0.4, 0.4 - np.pi / 2.0]
    )  # a quarter turn about two axes: a wrist's Euler angles lock
    poses = robot.fk(q + np.linspace(0.0, 1.0, 40)[:, None] * (goal - q))
    found = plan(robot, free(Polyline(poses, blend=0.002), **POINT), q, limits=LIMITS)
    assert found, found
    np.testing.assert_allclose(found.trajectory(found.duration), goal, atol=1e-7)
    arc = Arc.about(robot.fk(q), robot.fixed[0][:3, 3], robot.fixed[0][:3, 2], np.deg2rad(200.0))
    assert plan(robot, free(arc, **POINT), q, limits=LIMITS)


@pytest.mark.parametrize("name", ["flat2", "flat3", "flat4"])
def test_a_planar_arm_follows_points_in_its_plane_and_refuses_others_by_name(name: str) -> None:
    robot = make(name)
    path, q = line(robot, [-0.06, 0.03, 0.0], np.array([0.3, 0.7, 0.5, 0.4])[: robot.n])
    for start in (q, None):
        assert_follows(plan(robot, free(path, **POINT), start, limits=LIMITS), path)
    beside, _ = line(robot, [-0.06, 0.03, 0.02], q)
    refused = plan(robot, free(beside, **POINT), q, limits=LIMITS)
    assert refused.failure is not None and refused.status == "unreachable"
    assert "moves its tool's point in a plane only, and the path is 20 mm beside it" in refused.failure.reason


def test_an_arm_whose_point_moves_on_a_sphere_is_refused_by_that() -> None:
    robot = Robot.from_dh([DHRow(**UP), DHRow(a=0.3)], JointLimits(np.full(2, -3.0), np.full(2, 3.0)), name="globe")
    path, q = line(robot, [0.0, 0.05, 0.02])
    refused = plan(robot, free(path, **POINT), q, limits=LIMITS)
    assert refused.failure is not None and "in 2 directions only" in refused.failure.reason


def test_a_scara_keeps_its_plans_and_its_tool_may_turn() -> None:
    robot, q = optik.load("irb910sc"), np.array([0.3, 0.8, 0.05, 0.4])
    path, _ = line(robot, [-0.05, 0.03, 0.01], q)
    assert plan(robot, path, q, limits=LIMITS)
    assert_follows(plan(robot, free(path, **POINT), q, limits=LIMITS), path)
    with pytest.raises(InvalidInput, match="with five for turn=True alone; or turn=True, tilt=True; got one with turn"):
        plan(robot, free(path, **AXIS), q, limits=LIMITS)


def test_refusals_are_of_what_is_asked() -> None:
    robot = make("four")
    path, q = line(robot, [0.3, 0.4, 0.5])
    refused = plan(robot, free(path, **POINT), q, limits=LIMITS)
    assert refused.failure is not None and refused.failure.s > 0.01
    assert "only the tool's point is asked" in refused.failure.reason
    assert "4 joints" not in refused.failure.reason and "free" not in (refused.failure.joint or "")
    until = continue_point(robot, q, Line(path.pose(0.0), path.pose(0.95 * refused.failure.s)))
    assert until is not None
    small = make("three", 1.35)
    refused = plan(small, free(line(small, [-0.1, 0.04, 0.0])[0], **POINT), Q[:3], limits=LIMITS)
    assert refused.failure is not None and refused.failure.joint == "joint3"


@pytest.mark.parametrize("name", ["three", "four", "five", "flat3"])
def test_a_refused_pose_advises_to_ask_the_point(name: str) -> None:
    robot = make(name)
    shift = [-0.05, 0.04, 0.0 if name == "flat3" else 0.03]
    path, q = line(robot, shift, Q[: robot.n])
    turned = Line(path.pose(0.0), path.pose(path.end) @ se3.pose(se3.exp_so3([0.2, 0.3, 0.0]), np.zeros(3)))
    for start in (q, None):
        refused = plan(robot, turned, start, limits=LIMITS)
        assert refused.failure is not None
        assert refused.failure.advice.startswith(
            "free(path, turn=True, tilt=True), which asks the tool's point alone; or"
        )
    assert plan(robot, free(turned, turn=True, tilt=True), q, limits=LIMITS)


# ---------------------------------------------------------------- misuse
@pytest.mark.parametrize(
    ("freedoms", "words"),
    [
        ({"tilt": True}, "turn=True, tilt=True, .*; got True without turn=True"),
        ({"turn": 1.0, "tilt": True}, "turn=True, tilt=True, .*; got True without turn=True"),
        ({"tilt": True, "turn": True, "elbow": True}, "elbow with turn=True, tilt=True"),
    ],
)
def test_a_free_tilt_needs_a_free_turn(freedoms: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        free(line(make("three"), [0.0, 0.1, 0.0])[0], **freedoms)


def test_a_path_without_points_and_too_few_joints_are_refused() -> None:
    T = make("three").fk(Q[:3])
    with pytest.raises(InvalidInput, match="whose point does not move"):
        free(Line(T, T @ se3.pose(se3.exp_so3([0.0, 0.0, 0.5]), np.zeros(3))), **POINT)
    robot = make("five")
    path, q = line(robot, [0.03, 0.04, -0.02])
    for freedoms in ({"turn": 1.0}, {"tilt": 0.3}, {"turn": True, "tilt": 0.3}):
        with pytest.raises(InvalidInput, match="at least six joints, or with five for turn=True alone"):
            plan(robot, free(path, **freedoms), q, limits=LIMITS)
    with pytest.raises(InvalidInput, match="q_start"):
        plan(robot, free(path, **POINT), q + 0.01, limits=LIMITS)


# ---------------------------------------------------------------- proof, files, laws, obstacles
@pytest.mark.parametrize("freedoms", [POINT, AXIS])
@pytest.mark.parametrize("known", [True, False])
def test_the_certificate_proves_what_is_asked_of_a_motion_beside_its_path(freedoms: Any, known: bool) -> None:
    robot, rng = make("five"), np.random.default_rng(5)
    path, q = line(robot, [0.03, 0.04, -0.02])
    found = plan(robot, free(path, **freedoms), q, limits=LIMITS)
    t = np.linspace(0.0, found.duration, 9)
    bump = (np.sin(np.pi * t / t[-1]) ** 4)[:, None] * rng.uniform(-2e-3, 2e-3, robot.n)
    x = [found.trajectory(t, order) for order in range(3)]
    coarse = Trajectory(
        quintic_through(t, x[0] + bump, *x[1:]), found.joint_path.path.nearest(robot.fk(x[0])) if known else None
    )
    error, _ = path_error(robot, found.path, coarse)
    distance, angle = deviations(robot, path, coarse, 20_001)
    assert 1e-4 < distance <= error.distance <= 1.06 * distance
    assert error.angle < 1e-12 if freedoms is POINT else 1e-4 < angle <= error.angle <= 1.06 * angle
    near, far = ((0.9 * error.distance, 1.0), (1.1 * error.distance, 1e-9 if freedoms is POINT else 1.1 * error.angle))
    assert not certify(robot, found.path, coarse, tolerance=near).path_error.distance <= near[0]
    proof = certify(robot, found.path, coarse, tolerance=far)
    assert not proof.path_error.find_violations(proof.tolerance)
    if freedoms is AXIS:
        assert certify(robot, found.path, coarse, tolerance=(1.0, 0.9 * error.angle)).path_error.find_violations(
            optik.Tolerance(1.0, 0.9 * error.angle)
        )


def test_the_rates_of_the_compared_axes_are_their_derivatives() -> None:
    robot, rng, h = make("five"), np.random.default_rng(8), 1e-6
    path = free(line(robot, [0.03, 0.04, -0.02])[0], **AXIS).asking(robot)
    t = np.linspace(0.0, 1.0, 5)
    motion = Trajectory(quintic_through(t, *rng.uniform(-1.0, 1.0, (3, 5, 5))))
    at = rng.uniform(0.01, 0.99, 20)
    bounds, s, speed = MotionBounds(robot, motion), path.end * at, rng.uniform(-1.0, 1.0, 20)
    values = []
    for k in (-h, 0.0, h):
        side = bounds.at(np.clip(np.searchsorted(t, at) - 1, 0, 3), at + k)
        along = PathPositions(s + k * speed, speed, *path.frames(s + k * speed), np.empty((20, 0, 0)))
        values.append(compare_with_path(side, along, "axis"))
    (before, _), (now, off), (after, _) = values
    rate = now.error[:, 1] + speed[:, None] * now.error[:, 2]
    np.testing.assert_allclose((after.error[:, 0] - before.error[:, 0]) / (2.0 * h), rate, atol=1e-7)
    tool, given = robot.fk(motion(at))[:, :3, 2], path.pose(s)[:, :3, 2]
    np.testing.assert_allclose(off[:, 1], np.arccos(np.einsum("ki,ki->k", tool, given)), atol=1e-9)


@pytest.mark.parametrize("freedoms", [POINT, AXIS])
def test_files_keep_what_is_asked(freedoms: Any, tmp_path: File) -> None:
    robot = make("five")
    path, q = line(robot, [0.03, 0.04, -0.02])
    found = plan(robot, free(path, **freedoms), q, limits=LIMITS)
    found.save(tmp_path / "motion.json")
    back = load_motion(tmp_path / "motion.json")
    assert back.path.asked == found.path.asked != "pose"
    proof = certify(robot, back.path, back.trajectory, LIMITS, tolerance=(1e-5, 1e-5))
    assert proof.is_valid and proof.path_error.distance <= 1e-8
    data = found.path.to_dict()
    with pytest.raises(InvalidInput, match="asked"):
        type(found.path).from_dict(data | {"asked": "nothing"})


@pytest.mark.parametrize("law", ["optimal", "constant_speed", "quintic", "smooth"])
def test_time_laws_run_along_points(law: str) -> None:
    robot = make("four")
    path, q = line(robot, [-0.06, 0.08, 0.04])
    slow = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0, rotation_speed=0.2, tool_speed=0.2)
    found = plan(robot, free(path, **POINT), q, limits=slow, timing=law, allow=("limits", "jerk"))
    assert found, found
    joints, s = found.joint_path, np.linspace(0.0, path.end, 5)
    moved = np.einsum("kij,kj->ki", robot.jacobian(joints(s)), joints(s, 1))
    np.testing.assert_allclose(PathPoints(joints, s).twist, moved, atol=1e-12)
    if law != "quintic":
        T = np.linspace(0.0, found.duration, 2001)
        twist = np.einsum("kij,kj->ki", robot.jacobian(found.trajectory(T)), found.trajectory(T, 1))
        assert np.linalg.norm(twist[:, 3:], axis=1).max() <= 0.2 * (1.0 + 1e-6)
        assert np.linalg.norm(twist[:, :3], axis=1).max() <= 0.2 * (1.0 + 1e-6)


def test_a_motion_stops_and_goes_on_along_points() -> None:
    robot = make("five")
    path, q = line(robot, [0.03, 0.04, -0.02])
    found = plan(robot, free(path, **POINT), q, limits=LIMITS)
    stopped = replan(found, 0.3 * found.duration, stop=True)
    assert stopped and stopped.path.asked == "point" and stopped.certificate.path_error.distance <= 1e-5
    home = plan(robot, Program([Part(free(path, **POINT)), Part(q)]), q, limits=LIMITS)
    assert home and home.certificate.path_error.distance <= 1e-5


def test_motors_that_move_joints_together_keep_their_ranges() -> None:
    coupled, q = make("three", 1.4).with_motors([[1, 0, 0], [0, 1, 0], [0, -1, 1]]), Q[:3]
    for goal, left in (([-0.3, 0.6, -1.6], ""), ([-0.4, 0.2, -1.7], "motor3 leaves its range [-1.4, 1.4]")):
        end = coupled.fk(q)
        end[:3, 3] = coupled.fk(np.array(goal))[:3, 3]
        found = plan(coupled, free(Line(coupled.fk(q), end), **POINT), q, limits=LIMITS)
        assert bool(found) is not bool(left) and left in (found.failure.reason if found.failure else "")


def test_points_are_followed_around_a_box() -> None:
    spheres = [(link, (-0.02, 0.0, 0.0), 0.02) for link in range(2, 5)]
    robot = make("four").with_shapes(Shapes(spheres, names=("two", "three", "four")))
    path, q = line(robot, [-0.06, 0.08, 0.04])
    alone = plan(robot, free(path, **POINT), q, limits=LIMITS)
    elbow = robot.frames(alone.trajectory(alone.duration))[3]
    scene = Scene(spheres=[(elbow[:3, 3], 0.01)], margin=0.001)
    found = plan(robot, free(path, **POINT), limits=LIMITS, scene=scene)
    assert_follows(found, path)
    assert found.certificate.clearance is not None and not found.certificate.clearance.touches
    assert plan(robot, free(path, **POINT), limits=LIMITS, scene=scene, avoid=True)


# ---------------------------------------------------------------- more is never less
@pytest.mark.parametrize(
    ("name", "seed", "held"),
    [
        ("ur5e", 1, True),
        ("ur5e", 1, False),
        ("panda", 2, True),
        pytest.param("panda", 2, False, marks=pytest.mark.soak),
    ],
)
def test_a_free_tilt_is_never_less_than_a_cone_or_a_turn(name: str, seed: int, held: bool) -> None:
    robot, rng = optik.load(name), np.random.default_rng(seed)
    q = {"ur5e": np.array([0.4, -1.2, 1.6, -1.0, -1.3, 0.2]), "panda": np.array([0.3, -0.6, 0.2, -2.2, 0.1, 1.7, 0.5])}[
        name
    ]
    goal = robot.fk(q)
    goal[:3, 3] += 0.1 * rng.uniform(-1.0, 1.0, 3)
    path = Line(robot.fk(q), goal)
    durations = []
    for freedoms in ({"turn": True}, {"turn": True, "tilt": 0.3}, POINT):
        found = plan(robot, free(path, **freedoms), q if held else None, limits=LIMITS)
        assert found, found
        durations.append(found.duration)
    assert durations[2] <= 1.002 * min(durations)


def test_what_a_constant_orientation_solves_stays_solved_where_the_point_alone_is_asked() -> None:
    robot = make("rolling")
    assert find_distance(robot, Q, free(Line(robot.fk(Q), robot.fk(Q + 0.1)), **POINT)) == (0.0, 0.0)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        q = rng.uniform(-1.0, 1.0, 5) + np.array([0.0, 0.9, -1.3, 0.4, 0.0])
        radial = robot.fk(q)[:3, 3] - robot.fixed[0][:3, 3]
        goal = robot.fk(q)
        goal[:3, 3] += 0.1 * rng.uniform(-1.0, 1.0) * radial / np.linalg.norm(radial)
        path = Line(robot.fk(q), goal)
        given = plan(robot, path, q, limits=LIMITS)
        for freedoms in (AXIS, POINT):
            found = plan(robot, free(path, **freedoms), q, limits=LIMITS)
            assert not given or (found and found.duration <= 1.002 * given.duration), found
