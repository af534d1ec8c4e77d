"""Point clouds: distances by all points in NumPy, proofs against dense sampling, ways around a wall of points, pictures."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
from benchmarks.blocks.clearance import ClearanceBlock, _Clearance
from optik import Robot, Scene
from optik.errors import InvalidInput
from optik.scene.contact import CLOUD, bound_distance, find_nearest, find_nearest_pairs, find_pairs
from optik.types import Array
from planners import find_path, plan
from planners.certificate.clearance import clearance
from planners.choice.rows import bodies_of, pair_rooms
from planners.search._trees import find_blocked, find_unproved, make_body, make_work
from planners.trajectory import Trajectory
from tests.oracles.shapes import distances
from tests.planners.contacts import REST, drawn_motion, panda
from tests.planners.test_avoid import GOAL, LIMITS, wall
from tests.planners.test_view_data import data_of_show, pairs, show
from tests.seeds import shift_seed

RADIUS = 0.01


def draw_points(rng: np.random.Generator, count: int) -> Array:
    """Points on five plates around an arm, which no plane separates from it."""
    corners = rng.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 1.1], (5, 3))
    spans, which = 0.1 * rng.normal(size=(5, 2, 3)), rng.integers(5, size=count)
    return np.asarray(corners[which] + np.einsum("kd,kdc->kc", rng.random((count, 2)), spans[which]))


def measure(robot: Robot, points: Array, q: Array) -> Array:
    """Least distances of the arm's moving capsules to all balls at configurations."""
    link, a, b, radius = (column[robot.shapes.capsules[0] > 0] for column in robot.shapes.capsules)
    T, out = robot.frames(q)[:, link - 1], []
    ends = [np.einsum("kmij,mj->kmi", T[..., :3, :3], end) + T[..., :3, 3] for end in (a, b)]
    for at in zip(*ends, strict=True):
        out.append(min(distances(points, *axis).min() for axis in zip(*at, radius, strict=True)) - RADIUS)
    return np.array(out)


def apart(name: str) -> Robot:
    """An arm whose links are not checked against each other."""
    robot = optik.load(name)
    capsules = [(int(link), *rest) for link, *rest in zip(*robot.shapes.capsules, strict=True)]
    pairs = [(i, j, "not examined") for j in range(robot.n + 1) for i in range(j)]
    return robot.with_shapes(optik.Shapes(capsules, apart=pairs))


@pytest.mark.parametrize("arm", ["panda_hand", "ur5"])
@pytest.mark.parametrize("count", [1, 64, 65, 1025, 10_000])
def test_distances_are_the_least_over_all_points(arm: str, count: int) -> None:
    robot, rng = apart(arm), np.random.default_rng(count)
    points = draw_points(rng, count)
    points[count // 2 :] = points[: count - count // 2]  # duplicates
    q = robot.limits.sample(rng, 20)
    scene = Scene(clouds=[(points, RADIUS)])
    found = find_nearest_pairs(robot, scene, q)[0]
    np.testing.assert_allclose(found, measure(robot, points, q), rtol=0.0, atol=1e-12)
    body = make_body(robot, scene)
    blocked = np.array([find_blocked(body, at, make_work(body)) >= 0 for at in q])
    assert (blocked == (found <= 0.0)).all()


def test_a_row_of_points_has_directions_by_which_the_axis_leaves_it() -> None:
    points, rng = np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 3000), np.random.default_rng(2)
    scene = Scene(clouds=[(points, RADIUS)])
    for a, b in zip(rng.normal(size=(50, 3)) * 0.3, rng.normal(size=(50, 3)) * 0.3 + (1.0, 0.0, 0.0), strict=True):
        near = [find_nearest((0, i, CLOUD), scene.arrays, np.array([[a, b]])) for i in range(8)]
        distance, share, w = min(near)
        assert distance == pytest.approx(distances(points, a, b, RADIUS).min(), rel=0.0, abs=1e-14)
        centre = a + share * (b - a) - np.array(w) * (1.0 + RADIUS / distance)
        assert np.linalg.norm(points - centre, axis=1).min() < 1e-12
    through = find_nearest((0, 0, CLOUD), scene.arrays, np.array([[points[5], points[5]]]))
    assert through == (-RADIUS, 0.0, (0.0, 0.0, 0.0))


def test_a_far_part_of_a_cloud_is_bounded_by_its_box_in_every_direction() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        points = rng.uniform(-0.3, 0.3, (6, 3))
        scene = Scene(clouds=[(points, RADIUS)])
        for p in rng.normal(size=(20, 3)) * 10.0 ** rng.uniform(-1.0, 1.0, (20, 1)):
            out = np.maximum(np.maximum(points.min(axis=0) - p, p - points.max(axis=0)), 0.0)
            bound = bound_distance(tuple(p.tolist()), 0.1, CLOUD, 0, scene.arrays, np.empty((0, 4)))
            assert bound == pytest.approx(np.linalg.norm(out) - RADIUS - 0.1, abs=1e-12)
            assert bound <= np.linalg.norm(points - p, axis=1).min() - RADIUS - 0.1 + 1e-12


def test_rows_change_as_their_differences() -> None:
    robot, rng, h, exact = apart("panda"), np.random.default_rng(shift_seed(3)), 1e-7, []
    scene = Scene(clouds=[(draw_points(rng, 3000), RADIUS)], margin=1e-3)
    bodies, q = bodies_of(robot, scene), REST + rng.uniform(-1.0, 1.0, (3, 7))
    slots = np.tile(np.arange(len(bodies[2])), (3, 1))
    (room, ahead, behind), slope = np.empty((3, *slots.shape)), np.empty((*slots.shape, 7))
    pair_rooms(robot.chain, bodies, q, scene.margin, slots, room, slope)
    assert room.min(axis=1) == pytest.approx(find_nearest_pairs(robot, scene, q)[0])
    for j, step in enumerate(h * np.eye(7)):
        pair_rooms(robot.chain, bodies, q + step, scene.margin, slots, ahead, np.empty((0, 0, 0)))
        pair_rooms(robot.chain, bodies, q - step, scene.margin, slots, behind, np.empty((0, 0, 0)))
        exact.append(np.abs((ahead - behind) / (2.0 * h) - slope[..., j]) < 1e-6)
    assert np.mean(exact) > 0.99  # but where the nearest point is another one


def test_proofs_are_right_at_every_instant() -> None:
    robot, rng, free, straight, count = apart("panda"), np.random.default_rng(shift_seed(1)), 0, 0, 0
    while count < 60 and not (count >= 14 and min(free, straight) >= 3 and max(free, straight) <= count - 3):
        points, motion = draw_points(rng, 300), drawn_motion(rng, 1)
        scene = Scene(clouds=[(points, RADIUS)])
        found = clearance(robot, motion, scene).scene
        near = np.clip(found.time + np.arange(-0.05, 0.05, 5e-4), 0.0, motion.end)
        least = measure(robot, points, motion(np.append(np.arange(0.0, motion.end, 5e-3), near))).min()
        if least > 0.0:
            assert found.value <= least <= found.found + 1e-4 and found.value >= 0.95 * found.found - 1e-4
        else:
            assert found.found <= 0.0 and found.value == -np.inf
        at = measure(robot, points, motion(np.array([found.time])))[0]
        assert found.found == pytest.approx(at, rel=0.0, abs=1e-12)
        a, b, body = motion(0.0), motion(0.3 * motion.end), make_body(robot, scene)
        proved = find_unproved(body, a, b, np.zeros(7), make_work(body)) < 0
        assert not proved or measure(robot, points, np.linspace(a, b, 200)).min() > 0.0
        free, straight, count = free + (least > 0.0), straight + proved, count + 1
    assert count < 60, "motions with and without contact, edges with and without a proof"


def test_a_part_on_several_sides_is_not_behind_a_plane() -> None:
    """A ball turns past a near point on its side, and through a farther one between both ends; it stays near a sphere."""
    turn = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    robot = panda().with_shapes(optik.Shapes([(7, (0.0, 0.0, 0.0), 0.02)]))
    middle, ahead = robot.frames(np.array([REST, REST + 0.6 * turn]))[:, 6, :3, 3]
    points = np.array([middle + 0.05 * np.eye(3)[2], ahead])
    centre, inner = (0.0, 0.0, middle[2]), float(np.linalg.norm(middle[:2])) - 0.022
    scene = Scene(spheres=[(centre, inner)], clouds=[(points, RADIUS)])
    motion = Trajectory(PPoly(np.array([[2.0 * turn], [REST - turn]]), [0.0, 1.0]))
    found = clearance(robot, motion, scene)
    assert found.touches and found.scene.pair[1] == "cloud1"
    body = make_body(robot, scene)
    assert find_unproved(body, REST - turn, REST + turn, np.zeros(7), make_work(body)) >= 0


# ---------------------------------------------------------------- plans


def wall_of_points() -> Scene:
    """The surface of the wall of `test_avoid` as points, 1 cm apart."""
    (T, _), x = wall().boxes[0], np.linspace(-0.25, 0.25, 51)
    flat = np.array([(u, side, v) for u in x for side in (-0.01, 0.01) for v in np.linspace(-0.35, 0.35, 71)])
    return Scene(clouds=[(flat @ T[:3, :3].T + T[:3, 3], 0.008)], margin=2e-3, names=("scan",))


def test_a_plan_around_a_wall_of_points_is_proved() -> None:
    scene, robot = wall_of_points(), panda()
    assert plan(robot, GOAL, REST, limits=LIMITS, scene=scene).status == "contact"
    found = plan(robot, GOAL, REST, limits=LIMITS, scene=scene, avoid=True)
    assert found and found.certificate.clearance.scene.value > scene.margin
    q = found.trajectory(np.arange(0.0, found.trajectory.end, 2e-3))
    assert measure(robot, scene.clouds[0][0], q).min() + RADIUS - 0.008 > scene.margin
    paths = [find_path(robot, REST, GOAL, scene=wall_of_points()).paths[0].tobytes() for _ in range(2)]
    assert paths[0] == paths[1]


def test_a_cloud_has_one_name_is_allowed_as_one_and_coal_refuses_it(tmp_path: Path) -> None:
    robot, scene, file = panda(), wall_of_points(), tmp_path / "cell.json"
    pairs_of = [find_pairs(robot, replace(scene, allow=allow)).names for allow in ((), [("joint7", "scan")])]
    link = robot.shapes.capsules[0]
    counts = [sum(other == "scan" for _, other in names) for names in pairs_of]
    assert counts == [8 * (link > 0).sum(), 8 * ((link > 0) & (link < 7)).sum()]
    far = (np.ones((3000, 3)) * 50.0, 0.01)
    data = data_of_show(show(robot, Scene(clouds=[scene.clouds[0], far], names=("scan", "far"))))
    near, _ = pairs(data, "planned")
    assert {pair["names"][1] for pair in near} == {"scan"} and {pair["kind"] for pair in near} == {"clouds"}
    file.write_text(json.dumps(scene.to_dict()), encoding="utf-8")
    with pytest.raises(InvalidInput, match="1 clouds"):
        _Clearance().prepare(ClearanceBlock(id="a", robot="panda", scene=str(file), count=1), 0)
