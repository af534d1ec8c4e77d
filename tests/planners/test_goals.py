"""Goals of searches: windings, poses of which only one configuration can be reached, starts without contact."""

import itertools
import pathlib
from functools import cache

import numpy as np
import pytest

import optik
from optik import JointLimits, Robot, Scene, Shapes, se3
from optik.errors import InvalidInput
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Plan, PointToPoint, find_path, free, plan
from planners.following.branches import find_branches
from planners.paths import ViaPoint
from planners.paths.configurations import find_configurations
from planners.planning import PlanStatus
from planners.search import SearchStatus, find
from planners.search.base import JointSpace
from tests.planners.contacts import pose

LIMITS = MotionLimits(1.0, 5.0, 50.0)
TURN = 2.0 * np.pi
CONTINUOUS = """<robot name="c"><link name="b"/>
<link name="l1"><collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.05 0.05"/></geometry></collision></link>
<link name="l2"><collision><origin xyz="0.15 0 0"/><geometry><box size="0.3 0.04 0.04"/></geometry></collision></link>
<link name="t"/>
<joint name="j1" type="continuous"><parent link="b"/><child link="l1"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.45 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" effort="0" velocity="0"/></joint>
<joint name="f" type="fixed"><parent link="l2"/><child link="t"/><origin xyz="0.3 0 0"/></joint></robot>"""
ELBOWS = {
    "ur10e": np.array([0.3, -1.2, 1.6, -1.9, -1.4, 0.2]),
    "panda_hand": np.array([0.3, -0.5, 0.2, -2.2, 0.1, 1.8, 0.6]),
}
"""Configurations whose elbows are bent."""
START, GOAL = np.array([3.0, 0.3]), np.array([-3.0, 0.3])
SHORT = TURN - 6.0
"""The way from 3 to −3 rad through π."""


@pytest.fixture(scope="module")
def continuous(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    file = tmp_path_factory.mktemp("arm") / "continuous.urdf"
    file.write_text(CONTINUOUS)
    return Robot.from_urdf(file, shapes=True)


def ball(angle: float) -> Scene:
    """A ball that the first link meets at an angle."""
    return Scene(spheres=[((0.38 * np.cos(angle), 0.38 * np.sin(angle), 0.2), 0.01)])


def planar(*limits: float) -> Robot:
    """Three links in a plane: a pose of the tool has two configurations."""
    fixed = np.array([se3.pose(np.eye(3), [x, 0.0, 0.0]) for x in (0.0, 0.4, 0.35)])
    bare = Robot(
        "planar",
        fixed,
        np.zeros(3, bool),
        se3.pose(np.eye(3), [0.15, 0.0, 0.0]),
        JointLimits(-np.array(limits), limits),
    )
    links = (
        (1, (0.06, 0, 0), (0.4, 0, 0), 0.03),
        (2, (0, 0, 0), (0.35, 0, 0), 0.03),
        (3, (0, 0, 0), (0.15, 0, 0), 0.03),
    )
    return bare.with_shapes(Shapes(links, apart=((1, 2, "a hinge"), (2, 3, "a hinge"))))


@cache
def pocket() -> tuple[Robot, Scene, Array, Array]:
    """Arm, posts, start, and a pose whose nearest free configuration is in a pocket between posts."""
    robot, rng, posts = planar(2.9, 2.8, 2.5), np.random.default_rng(59), []
    for _ in range(5):
        angle, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.9)
        posts.append(((far * np.cos(angle), far * np.sin(angle), 0.0), rng.uniform(0.03, 0.07)))
    scene, q = Scene(spheres=posts), robot.limits.sample(rng, 200)
    a, b = q[find_nearest_pairs(robot, scene, q)[0] > 0.01][:2]
    return robot, scene, a, robot.fk(b)


def assert_free(found: Plan, scene: Scene) -> None:
    t = np.linspace(0.0, found.trajectory.duration, 2001)
    assert find_nearest_pairs(found.robot, scene, found.trajectory(t))[0].min() > 0.0


# ---------------------------------------------------------------- windings
def test_goals_are_all_windings_inside_the_limits_at_most_a_turn_from_the_start() -> None:
    rng, k = np.random.default_rng(1), np.array(list(itertools.product(range(-5, 6), repeat=3)))
    for lower, upper in (([-np.inf, -7.0, -3.0], [np.inf, 7.0, 3.0]), ([-np.inf, -4.0, -20.0], [np.inf, 9.0, np.inf])):
        robot = planar(1.0, 1.0, 1.0).with_limits(lower=lower, upper=upper)
        for turning in (np.ones(3, bool), np.array([True, False, False])):
            wide = turning & (np.subtract(upper, lower) > TURN)
            for near, q in robot.limits.sample(rng, 40).reshape(-1, 2, 3):
                every = q + TURN * k[(k[:, ~wide] == 0).all(axis=1)]
                close = (np.abs(every - near) <= TURN) | ~wide
                expected = every[close.all(axis=1) & robot.limits.contains(every)]
                found = find._wind(robot, q[None], near, turning)
                np.testing.assert_allclose(np.unique(found.round(6), axis=0), np.unique(expected.round(6), axis=0))
                assert (np.diff(np.linalg.norm(found - near, axis=1)) >= 0.0).all()


def test_a_bare_goal_is_reached_the_short_way_round_and_a_given_line_is_taken_as_written(continuous: Robot) -> None:
    short = plan(continuous, GOAL, START, limits=LIMITS)
    assert short
    assert short.path.end == pytest.approx(SHORT)
    np.testing.assert_allclose(short.goal, [TURN - 3.0, 0.3], atol=1e-9)
    assert short.to_dict()["goal"] == short.goal.tolist()
    for written in (
        plan(continuous, JointLine(continuous, START, GOAL), limits=LIMITS),
        plan(continuous, GOAL, START, limits=LIMITS, winding="exact"),
        plan(continuous, PointToPoint(continuous, START, GOAL), limits=LIMITS, scene=Scene(), avoid=True),
    ):
        assert written
        np.testing.assert_allclose(written.goal, GOAL, atol=1e-9)


def test_degrees_as_a_start_or_a_goal_are_asked_for() -> None:
    robot, q = optik.load("ur5e"), np.array([0.0, -1.2, 1.5, -1.5, -1.5, 0.0])
    for goal, start, argument in ((robot.fk(q), np.rad2deg(q), "q_start"), (np.rad2deg(q), q, "q_goal")):
        with pytest.raises(
            InvalidInput, match=rf"^{argument}: .* rad; got .* rad; are these degrees\? np\.deg2rad converts them$"
        ):
            plan(robot, goal, start)
    with pytest.raises(InvalidInput, match=r"^q_goal: .*are these degrees\? np\.deg2rad"):
        plan(robot, [0.0, -70.0, 80.0, -90.0, -90.0, 361.0], q)  # a little outside in degrees, too
    for far in (7.0, 500.0):  # an error of any unit; no degrees either
        with pytest.raises(InvalidInput, match=rf"got joint1 = {far:g} rad$"):
            plan(robot, q, [far, *q[1:]])


def test_a_search_goes_the_short_way_or_the_long_one_where_that_is_blocked(continuous: Robot) -> None:
    assert not JointSpace(continuous, ball(np.pi)).is_edge_free(START, np.array([TURN - 3.0, 0.3]))
    for scene, length, goal in ((ball(0.0), SHORT, TURN - 3.0), (ball(np.pi), 6.0, -3.0)):
        found = find_path(continuous, START, GOAL, scene=scene)
        assert found
        assert found.vertices[-1] == pytest.approx([goal, 0.3])
        assert found.length == pytest.approx(length, abs=1e-6)
        around = plan(continuous, GOAL, START, limits=LIMITS, scene=scene, avoid=True)
        assert around
        np.testing.assert_allclose(around.goal, [goal, 0.3], atol=1e-9)
        assert_free(around, scene)
    exact = find_path(continuous, START, GOAL, scene=ball(0.0), winding="exact", max_samples=200)
    assert exact.status is SearchStatus.NO_PATH_FOUND
    assert 'winding="nearest"' in exact.advice
    with pytest.raises(InvalidInput, match="winding: expected"):
        find_path(continuous, START, GOAL, scene=Scene(), winding="any")


def test_a_pose_is_reached_with_another_winding_of_a_joint_with_limits() -> None:
    robot, start = planar(6.0, 2.8, 2.5), np.array([0.0, 0.5, 0.2])
    scene = Scene(spheres=[((0.25 * np.cos(1.0), 0.25 * np.sin(1.0), 0.0), 0.04)])
    goal = np.array([2.0, 0.5, 0.2])
    found = find_path(robot, start, robot.fk(goal), scene=scene, max_samples=3000)
    assert found
    assert found.vertices[-1, 0] < 0.0
    np.testing.assert_allclose(robot.fk(found.vertices[-1]), robot.fk(goal), atol=1e-9)
    assert find_path(robot, start, goal, scene=scene, max_samples=300).status is SearchStatus.NO_PATH_FOUND


# ---------------------------------------------------------------- poses
def test_a_pose_is_reached_in_the_configuration_that_a_search_leads_to() -> None:
    robot, scene, start, target = pocket()
    every = find_configurations(robot, target, start[None], "the goal")
    free = every[find_nearest_pairs(robot, scene, every)[0] > 0.0]
    nearest = free[np.linalg.norm(free - start, axis=1).argmin()]
    assert find_path(robot, start, nearest, scene=scene, max_samples=1000).status is SearchStatus.NO_PATH_FOUND
    for given in (target, PointToPoint(robot, start, target)):
        found = plan(robot, given, start, limits=LIMITS, scene=scene, avoid=True)
        assert found
        assert_free(found, scene)
        np.testing.assert_allclose(robot.fk(found.goal), target, atol=1e-8)
        assert np.abs(found.goal - nearest).max() > 0.1


def test_a_via_point_is_passed_in_the_configuration_that_a_search_leads_to(tmp_path: pathlib.Path) -> None:
    robot, scene, start, target = pocket()
    given = PointToPoint(robot, start, ViaPoint(target), start + 0.1 * np.eye(3)[0])
    found = plan(robot, given, limits=LIMITS, scene=scene, avoid=True)
    assert found
    assert_free(found, scene)
    assert np.abs(found.path.vias[0].q - given.vias[0].q).max() > 0.1
    assert not found.path.list_missed()
    t = np.linspace(0.0, found.trajectory.duration, 20001)
    assert np.abs(robot.fk(found.trajectory(t)) - target).max(axis=(1, 2)).min() < 1e-3
    found.save(tmp_path / "via.json")


def test_a_pose_without_a_free_configuration_or_out_of_reach_is_a_status_with_its_reason() -> None:
    robot, _, start, target = pocket()
    ball = Scene(spheres=[(target[:3, 3], 0.1)])
    blocked = plan(robot, target, start, limits=LIMITS, scene=ball, avoid=True)
    assert blocked.status is PlanStatus.CONTACT
    assert blocked.failure is not None
    assert "all 2 configurations found for the goal are in collision" in blocked.failure.reason
    assert "sphere1" in blocked.failure.reason
    via = PointToPoint(robot, start, target, start + 0.1)
    said = plan(robot, via, limits=LIMITS, scene=ball, avoid=True).failure
    assert said is not None
    assert "configurations found for point 0 are in collision" in said.reason
    assert "via point" in said.advice
    far = plan(robot, pose((2.0, 0.0, 0.0)), start, limits=LIMITS, scene=Scene(), avoid=True)
    assert far.status is PlanStatus.UNREACHABLE
    assert far.failure is not None
    assert "the pose of the goal" in far.failure.reason


# ---------------------------------------------------------------- starts
def elbow_ball(robot: Robot, q: Array, gap: float) -> Scene:
    """A ball beside the elbow of a configuration: in contact, or at a distance."""
    assert robot.shapes is not None
    link, a, b, radius = robot.shapes.capsules
    i = int(np.flatnonzero(link == 3)[0])
    T = robot.frames(q)[2]
    middle, up = T[:3, :3] @ (0.5 * (a[i] + b[i])) + T[:3, 3], np.cross(T[:3, :3] @ (b[i] - a[i]), [0.3, 0.5, 0.8])
    return Scene(spheres=[(middle + (radius[i] + 0.02 + gap) * up / np.linalg.norm(up), 0.02)])


@pytest.mark.parametrize("name", ["ur10e", "panda_hand"])
def test_a_path_without_a_start_begins_in_a_free_configuration_away_from_contact(name: str) -> None:
    robot = optik.load(name)
    T = robot.fk(ELBOWS[name])
    goal = T.copy()
    goal[:3, 3] += [0.05, 0.08, -0.05]
    path = Line(T, goal)
    alone = plan(robot, path, limits=LIMITS, scene=Scene())
    assert alone
    begin = alone.trajectory(0.0)
    own = find_nearest_pairs(robot, Scene(), begin)[0][0]
    for gap, given in itertools.product((-0.015, 0.002), (path, free(path, turn=0.3))):
        scene = elbow_ball(robot, begin, gap)
        assert find_nearest_pairs(robot, scene, begin)[0][0] < min(own, gap + 1e-3)
        found = plan(robot, given, limits=LIMITS, scene=scene, avoid=given is not path)
        assert found
        assert_free(found, scene)
        assert find_nearest_pairs(robot, scene, found.trajectory(0.0))[0][0] > 0.005


def test_a_branch_costs_half_a_radian_more_for_a_tenth_of_the_room_and_comes_last_if_it_starts_in_collision() -> None:
    robot = optik.load("ur10e")
    T = robot.fk(ELBOWS["ur10e"])
    goal = T.copy()
    goal[:3, 3] += [0.05, 0.08, -0.05]
    path = Line(T, goal)
    alone = find_branches(robot, path)
    best = alone[0].q
    for room, more in ((0.05, 0.0), (0.005, 0.2 * np.log(10.0)), (-0.01, np.inf)):

        def rooms(q: Array, room: float = room) -> Array:
            return np.full(len(q), room if np.abs(np.sin(0.5 * (q[0] - best))).max() < 1e-6 else 1.0)

        found = find_branches(robot, path, rooms=rooms)
        cost = {tuple(branch.q): branch.cost for branch in found}
        assert cost[tuple(best)] == pytest.approx(alone[0].cost + more)
        assert all(cost[tuple(branch.q)] == pytest.approx(branch.cost) for branch in alone[1:])
        whole = [branch for branch in found if branch.ended is None]
        assert len(whole) > 1
        if room < 0.0:
            assert (whole[-1].q == best).all()
