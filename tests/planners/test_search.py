"""Search: proved edges against dense samples of distances, corners, determinism, contacts, closed boxes, and own searches."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pytest

import optik
import planners
from optik import JointLimits, Scene, Shapes, se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, UnknownName
from optik.registry import names
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners import find_path
from planners.search import JointSpace, Search, SearchStatus
from planners.search.base import SearchAttempt, measure_length
from planners.search.rrt_connect import RRTConnect
from tests.planners.contacts import REST, drawn, panda, pose, scara, table
from tests.seeds import shift_seed

TURN = np.array([1.4, 0, 0, 0, 0, 0, 0])
SEARCHES = pytest.mark.parametrize(
    "search",
    [
        pytest.param(
            name, marks=pytest.mark.skipif(name == "ompl" and find_spec("ompl") is None, reason="without OMPL")
        )
        for name in names("planners.search")
    ],
)
LEFT, RIGHT = REST - TURN, REST + TURN


def wall() -> Scene:
    """A thin wall in front of the arm, and a floor."""
    return Scene(boxes=[(pose((0.5, 0.0, 0.45)), (0.5, 0.004, 0.7))], planes=[((0, 0, -0.1), (0, 0, 1))])


def gantry() -> Robot:
    """A sphere of 0.1 m that two joints slide along x and y."""
    along = [se3.pose(np.roll(np.eye(3), 1, axis=0)), se3.pose(np.roll(np.eye(3), 1, axis=0))]
    limits = JointLimits([-5.0, -5.0], [5.0, 5.0])
    robot = Robot("gantry", np.array(along), np.ones(2, bool), np.eye(4), limits)
    return robot.with_shapes(Shapes(((2, (0, 0, 0), 0.1),)))


def staircase(leg: float, room: float, count: int) -> Scene:
    """Walls of a corridor for the gantry's sphere, with a dead end at (0, 0): legs along x and y in turn."""
    half, width = np.array([0.1 + room, 0.1 + room]), 0.02
    centre = np.array([(leg * ((i + 1) // 2), leg * (i // 2)) for i in range(count + 1)])
    boxes = [(pose((-half[0] - width / 2, 0.0, 0.0)), (width, 2.0 * half[1], 1.0))]
    for side in (1.0, -1.0):
        line = centre + side * half * [-1.0, 1.0]
        line[0] = side * half * [-side, 1.0]
        for i, (a, b) in enumerate(pairwise(line)):
            out = side * width / 2 * np.array([[0.0, 1.0], [-1.0, 0.0]])[i % 2]
            boxes.append((pose((*(a + b) / 2 + out, 0.0)), (*np.maximum(np.abs(b - a), width), 1.0)))
    return Scene(boxes=boxes)


def rooms(robot: Robot, scene: Scene, q: Array) -> Array:
    return find_nearest_pairs(robot, scene, q)[0]


def between(a: Array, b: Array, count: int) -> Array:
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


def check(robot: Robot, scene: Scene, path: Array) -> None:
    for a, b in pairwise(path):
        assert rooms(robot, scene, between(a, b, 800)).min() > 0.0


# ---------------------------------------------------------------- proofs
@pytest.mark.parametrize("robot", [panda(), scara()])
def test_proved_edges_are_free_at_dense_samples_and_free_edges_are_proved(robot: Robot) -> None:
    # Edges of several radians past thin boards and small spheres: the bound's remainder is as large as the arm.
    rng, count = np.random.default_rng(shift_seed(3)), {True: 0, False: 0}
    for i in range(24):
        scene = drawn(rng) if i % 2 else table()
        space = JointSpace(robot, scene)
        q = robot.limits.sample(rng, 400)
        free = q[rooms(robot, scene, q) > 0.0]
        assert [space.is_free(x) for x in q[:100]] == (rooms(robot, scene, q[:100]) > 0.0).tolist()
        for a, end in zip(free[:15], free[15:30], strict=False):
            b = a + rng.choice([0.1, 0.4, 1.0]) * (end - a)
            proved, least = space.is_edge_free(a, b), rooms(robot, scene, between(a, b, 700)).min()
            assert least > 0.0 if proved else least < 1e-3, (least, proved)
            count[proved] += 1
    assert min(count.values()) > 40


def test_an_edge_that_grazes_a_small_sphere_is_refused() -> None:
    robot, rng = panda(), np.random.default_rng(4)
    link, ends, _, radius = robot.shapes.capsules
    for _ in range(150):
        a, b = robot.limits.sample(rng, 2)
        k, t = int(rng.integers(1, len(radius))), rng.random()
        T = robot.frames(a + t * (b - a))[link[k] - 1]
        u = rng.normal(size=3)
        centre = T[:3, :3] @ (ends[k] + (radius[k] + 0.9e-3) * u / np.linalg.norm(u)) + T[:3, 3]
        assert not JointSpace(robot, Scene(spheres=[(centre, 1e-3)])).is_edge_free(a, b)


def test_bounds_are_used_up_to_the_last_millimetre() -> None:
    # The displacement of a sliding sphere is the bound itself: nothing hides a bound that is too large.
    robot, rng, proved = gantry(), np.random.default_rng(shift_seed(6)), 0
    assert np.abs(robot.frames(np.array([1.0, 2.0]))[1, :3, 3] - [1.0, 2.0, 0.0]).max() < 1e-12
    for _ in range(400):
        a, v = rng.uniform(-4.0, 4.0, (2, 2))
        u = rng.random()
        on_edge = np.array([*(a + u * (v - a)), 0.0])
        space = JointSpace(robot, Scene(spheres=[(on_edge, 1e-3)]))
        assert not space.is_edge_free(a, v)
        b = v + (a - v) * [1.0, -1.0]  # the axis of the triangle is that of a joint
        inside = np.array([*(v + rng.uniform(0.0, 0.5) * (u * (a - v) + (1.0 - u) * (b - v))), 0.0])
        space = JointSpace(robot, Scene(spheres=[(inside, 1e-3)]))
        length = space.find_corner_lengths(np.array([a, v, b]))[1]
        first, last = (v + length * _unit(x - v) for x in (a, b))
        w = np.sort(rng.random((500, 2)), axis=1)
        within = v * w[:, :1] + first * (w[:, 1:] - w[:, :1]) + last * (1.0 - w[:, 1:])
        assert length == 0.0 or np.linalg.norm(within - inside[:2], axis=1).min() > 0.101
        proved += length > 0.0
    assert proved > 200


def test_corners_may_be_cut_by_the_length_that_is_proved() -> None:
    robot, rng, found = panda(), np.random.default_rng(shift_seed(5)), []
    for _ in range(25):
        scene = drawn(rng)
        q = robot.limits.sample(rng, 300)
        free = q[rooms(robot, scene, q) > 0.0]
        if len(free) < 2:
            continue
        path = find_path(robot, free[0], free[1], scene=scene, shortcuts=0).vertices
        space = JointSpace(robot, scene)
        for k, length in enumerate(space.find_corner_lengths(path)):
            if length > 0.0:
                a, b = (path[k] + length * _unit(path[j] - path[k]) for j in (k - 1, k + 1))
                u = np.sort(rng.random((1000, 2)), axis=1)
                inside = path[k] * u[:, :1] + a * (u[:, 1:] - u[:, :1]) + b * (1.0 - u[:, 1:])
                assert rooms(robot, scene, inside).min() > 0.0
                found.append(2.0 * length / min(np.linalg.norm(path[k] - path[j]) for j in (k - 1, k + 1)))
    assert len(found) > 80
    assert np.mean(np.array(found) >= 0.25) > 0.7, "most corners may be cut by a good part of their edges"
    assert np.mean(np.array(found) < 1.0) > 0.01, "some are bounded by the proof: about 5 % of 500"


def _unit(x: Array) -> Array:
    return x / np.linalg.norm(x)


# ---------------------------------------------------------------- paths
def test_a_path_around_a_thin_wall_is_free_and_shorter_after_shortcuts() -> None:
    scene = wall()
    assert not JointSpace(panda(), scene).is_edge_free(LEFT, RIGHT)
    result = find_path(panda(), LEFT, RIGHT, scene=scene)
    rough = find_path(panda(), LEFT, RIGHT, scene=scene, shortcuts=0)
    assert result
    assert rough
    assert result.length < 0.9 * rough.length
    assert result.length == measure_length(result.vertices)
    for path in (*result.paths, *rough.paths):
        assert (path[0] == LEFT).all()
        assert (path[-1] == RIGHT).all()
        check(panda(), scene, path)
    alone = find_path(gantry(), [0.0, 0.0], [1.0, 1.0], scene=Scene())
    assert alone.vertices.tolist() == [[0.0, 0.0], [1.0, 1.0]], "without any pair of shapes"
    direct = find_path(panda(), LEFT, RIGHT, scene=Scene())
    assert (direct.vertices == [LEFT, RIGHT]).all()
    assert (direct.samples, direct.length) == (1, pytest.approx(2.8))


@SEARCHES
def test_equal_arguments_give_equal_paths_in_any_order_and_thread(search: str) -> None:
    def solve(seed: int) -> Array:
        path = find_path(panda(), LEFT, RIGHT, scene=wall(), seed=seed, search=search, shortcuts=0).vertices
        check(panda(), wall(), path)
        return path

    alone = {seed: solve(seed) for seed in (3, 2, 1, 0)}
    with ThreadPoolExecutor(4) as pool:
        together = dict(zip(range(4), pool.map(solve, range(4)), strict=True))
    assert all(np.array_equal(alone[seed], together[seed]) for seed in alone)
    assert not np.array_equal(alone[0], alone[1])


def test_several_paths_differ_and_the_shortest_is_first() -> None:
    result = find_path(panda(), LEFT, RIGHT, scene=wall(), paths=6)
    lengths = [measure_length(path) for path in result.paths]
    assert 1 < len(lengths) <= 6
    assert lengths == sorted(lengths)
    for path in result.paths:
        check(panda(), wall(), path)
    assert len(find_path(panda(), LEFT, RIGHT, scene=Scene(), paths=3).paths) == 1


def test_one_of_several_goals_and_a_pose_are_reached() -> None:
    scene, inside = wall(), REST.copy()
    result = find_path(panda(), LEFT, [inside, RIGHT, LEFT + 0.1], scene=scene)
    assert not JointSpace(panda(), scene).is_free(inside)
    assert (result.vertices[-1] == LEFT + 0.1).all()
    at_pose = find_path(panda(), LEFT, panda().fk(RIGHT), scene=scene)
    assert np.abs(panda().fk(at_pose.vertices[-1]) - panda().fk(RIGHT)).max() < 1e-6
    check(panda(), scene, at_pose.vertices)


@SEARCHES
def test_a_start_at_the_goal_is_a_path_of_no_length(search: str) -> None:
    same = find_path(panda(), LEFT, LEFT, scene=wall(), search=search)
    assert same
    assert same.length == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_a_goal_in_a_narrow_corridor_is_left_by_local_samples(seed: int) -> None:
    """Steps of up to 1 m towards samples everywhere do not leave legs of 0.25 m, with 100,000 samples of any of six seeds."""
    result = find_path(gantry(), [3.0, 2.0], [0.0, 0.0], scene=staircase(0.25, 0.014, 5), paths=1, seed=seed)
    assert result and result.samples > 5_000
    check(gantry(), staircase(0.25, 0.014, 5), result.vertices)


# ---------------------------------------------------------------- without a path
@SEARCHES
def test_a_goal_that_cannot_be_reached_ends_with_the_samples(search: str) -> None:
    # The first link cannot pass the post, in no configuration.
    robot, scene = scara(), Scene(boxes=[(pose((0.2, 0.0, 0.0)), (0.05, 0.05, 1.0))])
    start, goal = np.array([-1.0, 0.0, 0.1, 0.0]), np.array([1.0, 0.0, 0.1, 0.0])
    result = find_path(robot, start, goal, scene=scene, max_samples=700, search=search)
    assert result.status is SearchStatus.NO_PATH_FOUND
    assert not result
    assert result.samples == 700
    assert result.vertices.size == 0
    assert result.length == np.inf
    assert "700" in result.reason
    assert "max_samples" in result.advice
    again = RRTConnect(700, restart=300).search(JointSpace(robot, scene), start, goal[None], (0, 0))
    assert (again.vertices, again.samples) == (None, 700)
    assert find_path(robot, start, goal, scene=Scene())


def test_a_start_or_goal_in_contact_names_the_pair() -> None:
    blocked = find_path(panda(), REST, RIGHT, scene=wall())
    assert blocked.status is SearchStatus.START_IN_CONTACT
    assert "box1" in blocked.reason
    assert "start" in blocked.reason
    assert blocked.advice
    assert find_path(panda(), LEFT, REST, scene=wall()).status is SearchStatus.GOAL_IN_CONTACT
    near = find_path(panda(), LEFT, RIGHT, scene=Scene(boxes=wall().boxes, margin=0.6))
    assert near.status is SearchStatus.START_IN_CONTACT
    assert "margin is 600 mm" in near.reason
    far = find_path(panda(), LEFT, pose((3.0, 0.0, 0.5)), scene=Scene())
    assert far.status is SearchStatus.GOAL_UNREACHABLE
    assert "the goal" in far.reason
    assert far.advice not in far.reason


def test_four_goals_of_an_arm_with_four_joints_are_no_pose() -> None:
    robot, (start, *goals) = scara(), scara().limits.sample(np.random.default_rng(2), 5)
    assert (find_path(robot, start, goals, scene=Scene()).vertices[-1] == goals).all(axis=1).any()
    at_pose = find_path(robot, start, robot.fk(goals[0]), scene=Scene())
    np.testing.assert_allclose(robot.fk(at_pose.vertices[-1]), robot.fk(goals[0]), atol=1e-9)


# ---------------------------------------------------------------- arguments and own searches
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scene": None}, "scene"), ({"seed": -1}, "seed"), ({"max_samples": 0}, "max_samples"), ({"paths": 0}, "paths"),
        ({"shortcuts": -1}, "shortcuts"), ({"goal": [1.0, 2.0]}, "goal"), ({"goal": "home"}, "goal"),
        ({"goal": np.full(7, 9.0)}, "goal"), ({"q_start": np.full(7, 9.0)}, "q_start"),
        ({"search": RRTConnect(), "max_samples": 5}, "max_samples"), ({"robot": optik.load("irb910sc")}, "robot"),
        ({"robot": "panda"}, "robot"),
    ],
)  # fmt: skip
def test_invalid_arguments_are_named(change: dict[str, object], words: str) -> None:
    arguments = {"robot": panda(), "q_start": LEFT, "goal": RIGHT, "scene": wall()} | change
    with pytest.raises(InvalidInput, match=f"^{words}: "):
        find_path(**arguments)


def test_an_unknown_search_and_invalid_options_are_refused() -> None:
    with pytest.raises(UnknownName, match="rrt_connect"):
        find_path(panda(), LEFT, RIGHT, scene=wall(), search="rrt")
    for options in ({"step": 0.0}, {"restart": 0}, {"restart": 10**9}, {"max_samples": 1.5}):
        with pytest.raises(InvalidInput, match=next(iter(options))):
            RRTConnect(**options)


class Straight(Search):
    name = "straight"
    through = (LEFT, RIGHT)

    def search(self, space: JointSpace, start: Array, goals: Array, seed: tuple[int, ...]) -> SearchAttempt:
        return SearchAttempt(np.array(self.through), 0)


def test_an_own_search_is_used_and_its_edges_are_checked() -> None:
    assert find_path(panda(), LEFT, RIGHT, scene=Scene(), search=Straight())
    with pytest.raises(InvalidInput, match="edge 0 is not proved"):
        find_path(panda(), LEFT, RIGHT, scene=wall(), search=Straight())
    with pytest.raises(InvalidInput, match="path of Straight"):
        find_path(scara(), np.zeros(4), np.ones(4) * 0.1, scene=Scene(), search=Straight())
    for start, goal in ((LEFT, LEFT + 0.1), (LEFT, RIGHT - 0.1 * TURN), (RIGHT - 0.1, RIGHT)):
        with pytest.raises(InvalidInput, match="other ends"):
            find_path(panda(), start, goal, scene=Scene(), search=Straight())
    assert planners.search.Search is Search


def test_goals_farther_than_the_shortest_path_so_far_are_not_searched() -> None:
    class Detour(Search):
        name = "detour"
        seen: ClassVar[list[list[float]]] = []

        def search(self, space: JointSpace, start: Array, goals: Array, seed: tuple[int, ...]) -> SearchAttempt:
            self.seen.append(goals[:, 0].tolist())
            far = (1.2, 4.0)[len(self.seen) % 2]  # paths of 7, 1.4 and 7
            return SearchAttempt(np.array([start, [far, 0.0], goals[0]]), 0)

    find_path(gantry(), np.zeros(2), [[1.0, 0.0], [2.0, 0.0]], scene=Scene(), search=Detour(), shortcuts=0, paths=3)
    assert Detour.seen == [[1.0, 2.0], [1.0, 2.0], [1.0]]


def test_a_search_that_returns_nothing_is_named() -> None:
    class Lost(Straight):
        name = "lost"

        def search(self, *_: Any) -> Any:
            return None

    with pytest.raises(InvalidInput, match="result of Lost: expected a SearchAttempt"):
        find_path(panda(), LEFT, RIGHT, scene=Scene(), search=Lost())


@pytest.mark.parametrize("turns", [1000.0, np.inf])
def test_joints_that_turn_many_times_are_searched_near_the_start_and_the_goals(turns: float) -> None:
    limits, odd = panda().limits, np.arange(7) % 2 == 0
    robot = panda().with_limits(
        lower=np.where(odd, -turns, limits.lower),
        upper=np.where(odd, [turns, 0, turns, 0, turns, 0, 9.0], limits.upper),
    )
    for seed in range(3):
        found = find_path(robot, LEFT, RIGHT, scene=wall(), seed=seed, paths=1)
        assert found
        check(robot, wall(), found.vertices)
    space, ends = JointSpace(robot, wall()), np.array([LEFT, RIGHT])
    lower, upper = space.find_range(ends)
    assert (upper[odd] - lower[odd] <= 4.0 * np.pi + np.ptp(ends[:, odd], axis=0) + 1e-6).all()
    assert (lower[~odd] == limits.lower[~odd]).all()
    ur = JointSpace(optik.load("ur5"), Scene())
    assert (ur.find_range(np.array([np.full(6, 3.0)]))[0] == ur.robot.limits.lower).all()


@SEARCHES
def test_a_joint_without_limits_and_a_locked_one_are_searched(search: str) -> None:
    limits = scara().limits.replace(lower=[-np.inf, -2.6, 0.0, 0.0], upper=[np.inf, 2.6, 0.18, 0.0])
    robot, scene = replace(scara(), limits=limits), Scene(spheres=[((0.6 * np.cos(8.0), 0.6 * np.sin(8.0), 0.0), 0.1)])
    start, goal = np.array([7.0, 0.0, 0.1, 0.0]), np.array([9.0, 0.0, 0.1, 0.0])
    result = find_path(robot, start, goal, scene=scene, search=search, winding="exact")
    assert len(result.vertices) > 2
    check(robot, scene, result.vertices)
