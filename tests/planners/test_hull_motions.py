"""Proofs of motions by hulls: no instant is nearer than what is proved, and edges that are proved are free."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import optik
from optik import Scene, se3
from optik.arm.robot import Robot
from optik.arm.shapes.enclosure import CORNERS
from optik.scene.contact import PLANE, SELF, bodies_of, find_contact, refine
from optik.types import Array
from planners import Trajectory
from planners.certificate.clearance import clearance
from planners.choice.rows import NearPairs, pair_rooms
from planners.search._trees import find_blocked, find_unproved, make_body, make_work
from planners.trajectory.curve import quintic_through
from tests.optik.test_hulls import OBSTACLES, load


@cache
def robot(folder: Path) -> Robot:
    return load(folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("wrist")


def scene_of(kind: str, arm: Robot, q: Array, margin: float = 0.0) -> Scene:
    """An object in front of the flange."""
    T = arm.fk(q)
    scene = OBSTACLES[kind](T[:3, 3] + 0.15 * T[:3, 0], T[:3, 0])
    return replace(scene, allow=[(link, f"{kind}1") for link in ("arm", "ball")], margin=margin)


def hull_distances(arm: Robot, scene: Scene, q: Array) -> Array:
    """The least distances (k, 2) of hulls to the scene and between links, in contact at most 0."""
    _capsules, arrays, pairs, hulls = bodies_of(arm, scene)
    out, seed = np.full((len(q), 2), np.inf), np.full((2, 4), -1.0)
    for k, frames in enumerate(arm.frames(q)):
        for pair in pairs:
            found = refine(
                tuple(int(x) for x in pair), arrays, hulls, np.ascontiguousarray(frames[: arm.n]), np.inf, seed
            )[0]
            kind = int(pair[2] == SELF)
            out[k, kind] = min(out[k, kind], found)
    return out


@pytest.mark.parametrize("kind", OBSTACLES)
def test_no_instant_of_a_motion_is_nearer_than_what_is_proved(kind: str, folder: Path) -> None:
    arm, rng, seen = robot(folder), np.random.default_rng(3), 0
    for _ in range(12):
        q = rng.uniform(-1.0, 1.0, (3, 3)) * (0.3, 0.2, 0.3)
        motion = Trajectory(
            quintic_through(np.array([0.0, 0.6, 1.0]), q, 0.3 * rng.normal(size=(3, 3)), np.zeros((3, 3)))
        )
        scene = scene_of(kind, arm, q[1], 0.002)
        found = clearance(arm, motion, scene)
        least = hull_distances(arm, scene, motion(np.linspace(0.0, motion.end, 301))).min(axis=0)
        for part, nearest in zip((found.scene, found.own), least.tolist(), strict=True):
            assert part is not None
            if np.isfinite(part.value):
                seen += 1
                assert part.value <= max(nearest, 0.0) + 1e-9
                assert part.value > part.margin or part.found - part.value < 0.06 * part.found + 1e-4
            assert part.found > part.margin or nearest <= part.found + 0.01
    assert seen > 3


@pytest.mark.parametrize("kind", OBSTACLES)
def test_edges_that_are_proved_are_free_and_free_ones_are_proved(kind: str, folder: Path) -> None:
    arm, rng, count = robot(folder), np.random.default_rng(4), np.zeros((2, 2), int)
    for _ in range(40):
        a = rng.uniform(-1.0, 1.0, 3) * (1.0, 0.3, 0.4)
        b = a + rng.uniform(-0.4, 0.4, 3)
        scene = scene_of(kind, arm, a, 0.001)
        body = make_body(arm, scene)
        work = make_work(body)
        if find_blocked(body, a, work) >= 0:
            assert find_contact(arm, scene, a).room <= 1e-8
            continue
        proved = find_unproved(body, a, b, np.zeros(3), work) < 0
        rooms = hull_distances(arm, scene, a + np.linspace(0.0, 1.0, 101)[:, None] * (b - a)) - (0.001, 0.0)
        free = bool((rooms > 0.0).all())
        count[int(proved), int(free)] += 1
        assert free or not proved
        wide = find_unproved(body, a, b, np.full(3, 0.01), work) < 0
        moved = a + np.linspace(0.0, 1.0, 41)[:, None] * (b - a) + rng.choice([-0.01, 0.01], (41, 3))
        assert not wide or (hull_distances(arm, scene, moved) > (0.001, 0.0)).all()
    assert count[1, 1] > 5 and count[1, 0] == 0 and count[0, 1] <= 0.1 * count.sum()


def test_the_room_of_a_pair_of_hulls_falls_as_its_slope_says_and_near_pairs_are_found(folder: Path) -> None:
    arm, rng = robot(folder), np.random.default_rng(5)
    scene, seen = scene_of("box", arm, np.zeros(3)), 0
    bodies = bodies_of(arm, scene)
    q = rng.uniform(-1.0, 1.0, (60, 3)) * (0.4, 0.3, 2.0)
    slots = np.tile(np.arange(len(bodies[2])), (len(q), 1))
    room, slope = np.empty(slots.shape), np.empty((*slots.shape, 3))
    pair_rooms(arm.chain, bodies, q, 0.0, slots, room, slope)
    step = 1e-6
    for j in range(3):
        moved = [np.empty(slots.shape) for _ in range(2)]
        for sign, out in zip((-1.0, 1.0), moved, strict=True):
            pair_rooms(arm.chain, bodies, q + sign * step * np.eye(3)[j], 0.0, slots, out, np.empty((0, 0, 0)))
        for k, p in zip(*np.nonzero((room > 1e-3) & (room < 0.05)), strict=True):
            change = (moved[1][k, p] - moved[0][k, p]) / (2.0 * step)
            if abs(moved[0][k, p] + moved[1][k, p] - 2.0 * room[k, p]) < 1e-9:  # not at a bend or step of the room
                seen += 1
                assert slope[k, p, j] == pytest.approx(change, abs=1e-3)
    assert seen > 100 and (bodies[2][:, 2] != PLANE).all()
    pairs = NearPairs(arm, scene, len(q))
    for shift in (0.0, 0.01, -0.02):
        pair_rooms(arm.chain, bodies, q + shift, 0.0, slots, room, np.empty((0, 0, 0)))
        k, pair, rooms = pairs.find(q + shift, 0.03)
        np.testing.assert_array_equal(np.argwhere(room < 0.03), np.column_stack([k, pair]))
        np.testing.assert_allclose(room[k, pair], rooms, rtol=0.0, atol=2e-7)  # two searches
        without = NearPairs(arm, scene, len(q)), pairs
        besides = np.ascontiguousarray(slots[:, slots[0] % 3 == 0])
        for near in without:
            at, others, _rooms = near.find(q + shift, 0.03, besides)
            np.testing.assert_array_equal(np.column_stack([at, others]), np.column_stack([k, pair])[pair % 3 > 0])


def test_a_point_to_point_motion_among_boxes_is_planned_where_capsules_refuse_it(folder: Path) -> None:
    import planners

    arm = robot(folder)
    capsules = arm.with_shapes(optik.Shapes(arm.shapes.capsules, arm.shapes.names))
    scene = Scene(boxes=[(se3.pose(p=(0.45, 0.45, 0.3)), (0.1, 0.1, 0.4))])
    start, goal = np.array([0.0, 0.1, 0.1]), np.array([-1.0, 0.3, -0.3])
    assert not planners.find_path(capsules, start, goal, scene=scene)
    assert planners.find_path(arm, start, goal, scene=scene)


BLADE = """<robot name="blade"><link name="base"/><link name="blade"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="blade"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"""


def test_a_blade_that_turns_about_the_axis_of_its_capsule_is_seen_to_hit_a_box() -> None:
    blade = 2.0 * CORNERS * (0.29, 0.02, 0.02)
    shapes = optik.Shapes([(1, (0.0, 0.0, -0.01), (0.0, 0.0, 0.01), 0.3)], ("blade",), hulls=[[(blade, 0.0)]])
    arm = optik.Robot.from_urdf(BLADE, "blade").with_shapes(shapes)
    scene = Scene(boxes=[(se3.pose(p=(0.0, 0.2, 0.0)), (0.05, 0.05, 0.05))])
    body = make_body(arm, scene)
    for angle, free in ((0.7, True), (1.35, False), (2.6, False)):
        assert (find_unproved(body, np.zeros(1), np.full(1, angle), np.zeros(1), make_work(body)) < 0) == free
        motion = Trajectory(
            quintic_through(np.array([0.0, 1.0]), np.array([[0.0], [angle]]), np.zeros((2, 1)), np.zeros((2, 1)))
        )
        found = clearance(arm, motion, scene)
        assert found.proved == free and found.scene is not None
        if free:
            least = hull_distances(arm, scene, motion(np.linspace(0.0, 1.0, 501)))[:, 0].min()
            assert 0.9 * least - 1e-4 <= found.scene.value <= least + 1e-9
    found = find_unproved(body, np.zeros(1), np.full(1, 0.2), np.full(1, 0.3), make_work(body)) < 0
    assert found and find_unproved(body, np.zeros(1), np.full(1, 0.2), np.full(1, 1.2), make_work(body)) >= 0
