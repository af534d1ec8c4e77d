"""Ways around obstacles: rooms and their derivatives against differences, motions against coal, what is refused."""

import pathlib
import sys
from functools import cache
from typing import Any

import numpy as np
import pytest

from optik import Scene
from optik.errors import InvalidInput, UnknownName
from optik.scene.contact import bodies_of, find_nearest_pairs
from optik.types import Array
from optik.view.page import describe_show
from planners import Line, MotionLimits, Plan, PointToPoint, free, load_motion, plan
from planners.choice import ways
from planners.choice.choose import Choice, JointChoice
from planners.choice.first_paths import advise_elbow
from planners.choice.programme import FreeProgramme
from planners.choice.rows import ClearanceLimits, NearPairs, pair_rooms
from planners.motion.show import show_motion
from planners.paths import ViaPoint
from planners.paths.free_path import FreePath
from planners.planning import PlanStatus
from planners.search.rrt_connect import RRTConnect
from planners.timing.optimal import Optimal
from tests.planners.contacts import REST, drawn, panda, pose, scara
from tests.seeds import shift_seed

LIMITS = MotionLimits(2.0, 10.0, 100.0)
GOAL = np.array([1.2, 0.3, 0.1, -1.9, -0.1, 2.1, 0.9])


def wall() -> Scene:
    """A wall between start and goal, and a plate above it: the straight joint line passes through the wall."""
    turned = pose([0.5, 0.3, 0.35])
    turned[:2, :2] = [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]
    return Scene(boxes=[(turned, (0.5, 0.02, 0.7))], margin=2e-3)


@cache
def around() -> Plan:
    return plan(panda(), GOAL, REST, limits=LIMITS, scene=wall(), avoid=True)


def test_configurations_between_grid_points_are_exact_on_a_cubic() -> None:
    rng, s = np.random.default_rng(2), np.array([0.0, 0.3, 0.4, 1.1])
    c = rng.normal(size=(4, 3))
    q, q1 = (np.polynomial.polynomial.polyval(s, x).T for x in (c, np.polynomial.polynomial.polyder(c)))
    finer = np.append((s[:-1, None] + np.diff(s)[:, None] * np.arange(4) / 4.0).ravel(), s[-1])
    assert ways.EXAMINED_BETWEEN == 4
    np.testing.assert_allclose(
        ways._between(np.stack([q, q1]), s), np.polynomial.polynomial.polyval(finer, c).T, atol=1e-12
    )


# ---------------------------------------------------------------- rows


def test_rooms_of_pairs_are_those_of_the_contact_check_and_change_as_their_differences() -> None:
    robot, rng, h, seen = panda(), np.random.default_rng(shift_seed(3)), 1e-7, 0
    for _ in range(20):
        scene = drawn(rng)
        bodies, q = bodies_of(robot, scene), REST + rng.uniform(-1.0, 1.0, (3, 7))
        slots = np.tile(np.arange(len(bodies[2])), (3, 1))
        room, slope = np.empty(slots.shape), np.empty((*slots.shape, 7))

        def rooms(q: Array, bodies: Any = bodies, margin: float = scene.margin, slots: Array = slots) -> Array:
            out = np.empty(slots.shape)
            pair_rooms(robot.chain, bodies, q, margin, slots, out, np.empty((0, 0, 0)))
            return out

        pair_rooms(robot.chain, bodies, q, scene.margin, slots, room, slope)
        np.testing.assert_array_equal(room.min(axis=1), find_nearest_pairs(robot, scene, q)[0])
        for j in range(7):
            step = h * np.eye(7)[j]
            ahead, behind = rooms(q + step), rooms(q - step)
            smooth = np.abs(ahead + behind - 2.0 * room) < 1e-12  # no change of the nearest points' faces
            change = (ahead - behind) / (2.0 * h)
            touched = np.abs(room - rooms(q)) > 0.0
            assert not touched.any()
            outside = (room > -0.01) & smooth
            np.testing.assert_allclose(slope[..., j][outside], change[outside], atol=2e-6)
            seen += int((outside & (np.abs(change) > 1e-3)).sum())
    assert seen > 2000


def test_near_pairs_are_those_below_the_bound_from_step_to_step() -> None:
    robot, rng, seen = panda(), np.random.default_rng(shift_seed(5)), 0
    for trial in range(60):
        scene = drawn(rng)
        near = 0.1 * np.cumsum(rng.normal(size=(12, 7)), axis=0)  # bounds from one configuration hold at the next ones
        q = REST + (rng.uniform(-1.0, 1.0, 7) + near if trial % 2 else rng.uniform(-1.0, 1.0, (12, 7)))
        bodies, pairs = bodies_of(robot, scene), NearPairs(robot, scene, len(q))
        slots = np.tile(np.arange(len(bodies[2])), (len(q), 1))
        room = np.empty(slots.shape)
        for size, within in ((0.0, 0.1), (0.02, 0.1), (0.05, 0.05), (1.0, 0.02), (0.02, np.inf)):
            q = q + size * rng.normal(size=q.shape)
            pair_rooms(robot.chain, bodies, q, scene.margin, slots, room, np.empty((0, 0, 0)))
            k, pair, rooms = pairs.find(q, within)
            np.testing.assert_array_equal(np.argwhere(room < within), np.column_stack([k, pair]))
            np.testing.assert_array_equal(room[k, pair], rooms)
            seen += k.size if within < np.inf else 0
    assert seen > 500


def test_near_pairs_of_the_arm_are_found_where_the_elbow_moves_and_the_hand_rests() -> None:
    robot, rng = panda(), np.random.default_rng(6)
    near = robot.limits.sample(rng, 20_000)
    near = near[find_nearest_pairs(robot, Scene(), near)[0] < 0.03]
    null = np.linalg.svd(robot.jacobian(near))[2][:, -1]
    pairs, bodies = NearPairs(robot, Scene(), len(near)), bodies_of(robot, Scene())[2]
    slots = np.tile(np.arange(len(bodies)), (len(near), 1))
    room = np.empty(slots.shape)
    for q in (robot.limits.clip(near + 0.4 * null), near, robot.limits.clip(near - 0.4 * null)):
        pair_rooms(robot.chain, bodies_of(robot, Scene()), q, 0.0, slots, room, np.empty((0, 0, 0)))
        k, pair, _rooms = pairs.find(q, 0.03)
        np.testing.assert_array_equal(np.argwhere(room < 0.03), np.column_stack([k, pair]))


@pytest.mark.parametrize("kind", ["joints", "elbow"])
def test_values_of_rooms_change_with_the_coefficients_as_their_differences(kind: str) -> None:
    robot, rng, h = panda(), np.random.default_rng(shift_seed(4)), 1e-6
    choice: Choice
    if kind == "joints":
        path = PointToPoint(robot, REST, GOAL)
        first = plan(robot, path, limits=LIMITS)
        optimum = Optimal().run_with_optimum(first.joint_path, LIMITS)[1]
        choice = JointChoice(path, first.joint_path, optimum)
    else:
        T = robot.fk(REST)
        goal = T.copy()
        goal[:3, 3] += [-0.1, 0.15, 0.1]
        freed = free(Line(T, goal), turn=True, elbow=True)
        first = plan(robot, freed, REST, limits=LIMITS, timing="smooth")
        optimum = Optimal().run_with_optimum(first.joint_path, LIMITS)[1]
        choice = Choice(freed, first.joint_path, optimum, held=False)
    scene = drawn(rng)
    K, pairs = choice.programme.K, len(bodies_of(robot, scene)[2])
    slots = rng.integers(-1, pairs, (K + 1, 5))
    rows = ClearanceLimits(robot, scene, *choice.parts[:2], slots, np.full((K + 1, 1), 2e-3), np.zeros(pairs, int))
    programme = FreeProgramme(choice.optimum.programme, *choice.parts, rows)

    def values(p: Array) -> Array:
        place = programme.place(p, choice.near)
        assert place is not None
        return rows.values(place)

    p = choice.p + 0.02 * rng.normal(size=choice.p.shape)
    place = programme.place(p, choice.near)
    assert place is not None
    z, border = choice.optimum.programme.start, programme.make_border()
    here = programme.problem(place).node[:, -5:, 3]
    y = np.zeros((K + 1, programme.rows + 2 * programme.problem(place).edge.shape[2]))
    programme.fill(place, z, y, border)
    seen = 0
    for i in rng.choice(p.size, 8, replace=False):
        step = np.zeros(p.size)
        step[i] = h
        ahead, behind = values(p + step.reshape(p.shape)), values(p - step.reshape(p.shape))
        change = (ahead - behind) / (2.0 * h)
        smooth = (np.abs(ahead + behind - 2.0 * here) < 1e-9) & (here < 1.5)
        at = i - programme.begin
        inside = (at >= 0) & (at < programme.width)
        column = np.zeros_like(change)
        column[inside] = border.columns[np.flatnonzero(inside), programme.rows - 5 : programme.rows, at[inside]]
        if not programme.window.free[i]:
            assert (column == 0.0).all()
            continue
        np.testing.assert_allclose(column[smooth], change[smooth], atol=1e-4 * max(1.0, float(np.abs(change).max())))
        seen += int((smooth & (np.abs(change) > 1e-3)).sum())
    assert seen > 50
    assert (here[slots < 0] < -0.99).all()


def test_coefficients_are_pushed_until_the_elbow_touches_nothing() -> None:
    robot = panda()
    T = robot.fk(REST)
    goal = T.copy()
    goal[:3, 3] += [0.0, 0.1, 0.05]
    freed = free(Line(T, goal), elbow=True)
    first = plan(robot, freed, REST, limits=LIMITS, timing="smooth")
    choice = Choice(freed, first.joint_path, Optimal().run_with_optimum(first.joint_path, LIMITS)[1], held=False)
    elbow = robot.frames(choice.near[0, 60])[3][:3, 3]
    for way in ((0.0, 1.0, 0.2), (0.0, -1.0, 0.2)):
        ball = elbow + 0.2 * np.array(way)
        scene = next(
            scene
            for scene in (Scene(spheres=[(ball, r)]) for r in np.linspace(0.02, 0.2, 91))
            if find_nearest_pairs(robot, scene, choice.near[0])[0].min() < -0.015
        )
        found = ways.push_out(choice, scene, choice.p, choice.near)
        assert found is not None
        assert find_nearest_pairs(robot, scene, found[1][0])[0].min() > 0.0
        tool = robot.fk(found[1][0])
        np.testing.assert_allclose(tool, freed.given.pose(choice.optimum.programme.s), atol=1e-8)


def test_each_room_that_is_required_has_a_slot_at_its_grid_point() -> None:
    """Also where many rooms are required of one grid point and none of another."""
    robot, rng = panda(), np.random.default_rng(9)
    path, scene = PointToPoint(robot, REST, GOAL), drawn(rng)
    first = plan(robot, path, limits=LIMITS)
    choice = JointChoice(path, first.joint_path, Optimal().run_with_optimum(first.joint_path, LIMITS)[1])
    cuts = ways.Cuts(robot, scene, choice.near[0])
    every = np.arange(len(bodies_of(robot, scene)[2]))
    cuts._add(np.zeros(every.size, int), every)
    wanted = rng.random(cuts.table.shape) < np.linspace(0.0, 0.3, len(cuts.table))[:, None]
    cuts.table = np.where(wanted, 1e-3, np.nan)
    slots = cuts.limits(choice)._slots
    for k in range(1, len(slots) - 1):
        assert set(slots[k][slots[k] >= 0].tolist()) == set(np.flatnonzero(wanted[k]).tolist())


def test_a_step_may_not_end_where_a_pair_without_a_slot_has_too_little_room_and_near_pairs_get_slots() -> None:
    robot, rng = panda(), np.random.default_rng(shift_seed(8))
    path = PointToPoint(robot, REST, GOAL)
    first = plan(robot, path, limits=LIMITS)
    choice = JointChoice(path, first.joint_path, Optimal().run_with_optimum(first.joint_path, LIMITS)[1])
    allowed, refused, given = 0, 0, 0
    for _ in range(30):
        scene = drawn(rng)
        pairs, K = len(bodies_of(robot, scene)[2]), choice.programme.K
        equal = np.full((K + 1, 1), 2e-3), np.zeros(pairs, int)
        rows = ClearanceLimits(robot, scene, *choice.parts[:2], np.full((K + 1, 6), -1), *equal)
        for size in (0.0, 0.02, 0.05, 0.1):  # from the second on most rooms are known by bounds only
            p = choice.p + size * rng.normal(size=choice.p.shape) * choice.programme.window.free.reshape(choice.p.shape)
            place = choice.programme.place(p, choice.near)
            assert place is not None
            least = find_nearest_pairs(robot, scene, place.path[0])[0].min()
            assert rows.allows(place) == (least >= 2e-3)
            allowed, refused = allowed + (least >= 2e-3), refused + (least < 2e-3)
        k, slot = rows.renew(place)
        assert (np.unique(np.stack([k, slot]), axis=1).shape[1]) == k.size
        value = rows.values(place)
        assert (value[k, slot] > 1.0 - 2.0 * 0.03 / 0.05).all()  # these pairs are near
        given += k.size
        assert rows.allows(place) or (rows._slots >= 0).all(axis=1).any()  # the rest is limited by slots
    assert allowed > 10
    assert refused > 10
    assert given > 100


# ---------------------------------------------------------------- plans


def test_a_way_around_a_wall_is_found_proved_and_faster_than_stops_at_its_corners() -> None:
    robot, found = panda(), around()
    direct = plan(robot, GOAL, REST, limits=LIMITS, scene=wall())
    assert direct.status is PlanStatus.CONTACT
    assert found
    assert found.search is not None
    assert found.search.samples > 0
    assert found.freedom is not None
    assert found.freedom.outcome == "chosen"
    assert found.freedom.gain > 0.05
    assert found.certificate.clearance is not None
    assert found.certificate.clearance.proved
    assert found.certificate.clearance.scene.value > wall().margin
    t = np.linspace(0.0, found.trajectory.duration, 4001)
    assert find_nearest_pairs(robot, wall(), found.trajectory(t))[0].min() > 0.0
    np.testing.assert_allclose(found.trajectory(0.0), REST, atol=1e-12)
    np.testing.assert_allclose(found.trajectory(found.trajectory.duration), GOAL, atol=1e-9)
    for order, most in ((1, 2.0), (2, 10.0), (3, 100.0)):
        assert np.abs(found.trajectory(t, order)).max() <= most * (1.0 + 1e-9)


def test_files_and_the_viewer_have_the_first_way(tmp_path: pathlib.Path) -> None:
    robot, found = panda(), around()
    found.save(tmp_path / "around.json")
    show = show_motion(load_motion(tmp_path / "around.json"))
    assert show.before is not None
    np.testing.assert_allclose(show.before[[0, -1]], robot.fk(np.stack([REST, GOAL]))[:, :3, 3], atol=1e-12)
    assert np.linalg.norm(np.diff(show.before, axis=0), axis=1).max() < 0.1
    assert describe_show(show)[0]["before"] is not None
    straight = plan(robot, GOAL, REST, limits=LIMITS)
    assert describe_show(show_motion(straight))[0]["before"] is None


def test_another_initial_path_is_tried_where_the_motion_stays_far_from_its_least_duration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = around()
    assert first.search is not None and first.search.paths == 1 and first.freedom.gain > 0.01
    module = sys.modules["planners.choice.ways"]
    monkeypatch.setattr(module, "NOT_FAR", 0.5)  # every motion is far
    monkeypatch.setattr(module, "ENOUGH_NEAR", 0.5)
    second = plan(panda(), GOAL, REST, limits=LIMITS, scene=wall(), avoid=True)
    assert second.search is not None and second.search.paths == 2
    assert second and second.trajectory.duration <= 1.005 * first.trajectory.duration


def test_the_same_scene_gives_the_same_motion_which_a_duration_slows() -> None:
    again, first = plan(panda(), GOAL, REST, limits=LIMITS, scene=wall(), avoid=True, duration=6.0), around()
    assert again and again.trajectory.duration == pytest.approx(6.0) and again.search == first.search
    slowed = first.trajectory.stretched(6.0 / first.trajectory.duration)
    assert (again.trajectory.coefficients == slowed.coefficients).all()
    assert plan(panda(), GOAL, REST, limits=LIMITS, scene=wall(), avoid=True, duration=first.trajectory.duration)
    assert first.freedom is not None
    assert first.freedom.gain == pytest.approx(1.0 - first.trajectory.duration / first.freedom.fixed_duration)


def test_any_law_times_the_way_that_is_found() -> None:
    found = plan(panda(), GOAL, REST, limits=LIMITS, scene=wall(), timing="smooth", avoid=True)
    assert found
    assert found.freedom is not None
    assert "only the law optimal" in found.freedom.outcome
    assert found.trajectory.duration > around().trajectory.duration


def test_via_points_are_passed_on_the_way_around() -> None:
    robot = panda()
    via = np.array([0.3, -1.2, 0.2, -2.2, -0.1, 1.9, 0.8])
    path = PointToPoint(robot, REST, ViaPoint(via), GOAL)
    found = plan(robot, path, limits=LIMITS, scene=wall(), avoid=True)
    assert found
    t = np.linspace(0.0, found.trajectory.duration, 4001)
    assert np.abs(found.trajectory(t) - via).max(axis=1).min() < 5e-3


def test_the_branch_of_a_pose_is_one_without_contact() -> None:
    """The ball stands in the elbow of the nearest branch of the goal's pose."""
    robot = panda()
    nearest = PointToPoint(robot, REST, robot.fk(GOAL)).coefficients[-1]
    scene = Scene(spheres=[(robot.frames(nearest)[3][:3, 3], 0.04)])
    assert find_nearest_pairs(robot, scene, nearest)[0][0] < 0.0
    found = plan(robot, PointToPoint(robot, REST, robot.fk(GOAL)), limits=LIMITS, scene=scene, avoid=True)
    assert found
    np.testing.assert_allclose(robot.fk(found.trajectory(found.trajectory.duration)), robot.fk(GOAL), atol=1e-8)


@pytest.mark.soak
def test_the_elbow_keeps_clear_of_a_ball_that_the_given_path_touches() -> None:
    robot, solved = panda(), 0
    for seed in range(6):
        rng = np.random.default_rng([shift_seed(7), seed])
        q = REST + rng.uniform(-0.3, 0.3, 7)
        T = robot.fk(q)
        goal = T.copy()
        goal[:3, 3] += [0.05, 0.15 * (-1) ** seed, 0.05]
        path = Line(T, goal)
        first = plan(robot, path, q, limits=LIMITS, scene=Scene())
        if not first:
            continue
        middle = first.trajectory(0.5 * first.trajectory.duration)
        ball = robot.frames(middle)[3][:3, 3] + 0.2 * np.array([0.0, (-1.0) ** seed, 0.3])
        joints = first.trajectory(np.linspace(0.0, first.trajectory.duration, 100))
        rooms = [
            r
            for r in np.linspace(0.01, 0.15, 57)
            if find_nearest_pairs(robot, Scene(spheres=[(ball, r)]), joints)[0].min() > 0
        ]
        if not rooms:
            continue
        scene = Scene(spheres=[(ball, max(rooms) + 0.015)], margin=1e-3)
        assert plan(robot, path, q, limits=LIMITS, scene=scene, resolve="local").status is PlanStatus.CONTACT
        found = plan(
            robot, free(path, elbow=True, turn=True, hold_start=False), q, limits=LIMITS, scene=scene, avoid=True
        )
        assert found.status in (PlanStatus.SOLVED, PlanStatus.CONTACT)
        if found:
            solved += 1
            t = np.linspace(0.0, found.trajectory.duration, 2001)
            assert find_nearest_pairs(robot, scene, found.trajectory(t))[0].min() > 0.0
    assert solved >= 3


@pytest.mark.soak
def test_more_coefficients_are_tried_where_the_default_ones_find_no_way_between_balls() -> None:
    robot, q = panda(), np.array([0.044, -0.557, -0.278, -2.443, 0.03, 1.67, 0.716])
    T, balls = robot.fk(q), [(0.327, -0.183, 0.610, 0.0125), (0.523, -0.229, 0.530, 0.0719)]
    goal = T.copy()
    goal[:3, 3] += [0.087, -0.214, 0.169]
    balls += [(0.449, -0.057, 0.473, 0.0501), (0.304, -0.216, 0.783, 0.0401)]
    scene = Scene(spheres=[(np.array(ball[:3]), ball[3]) for ball in balls], margin=1e-3)

    def planned(count: int | None) -> Plan:
        freed = free(Line(T, goal), elbow=True, turn=(-1.0, 1.0), tilt=0.3, coefficients=count)
        return plan(robot, freed, q, limits=LIMITS, scene=scene, avoid=True, timing=Optimal(intervals=40))

    assert planned(8).status is PlanStatus.CONTACT
    assert planned(12)
    found = planned(None)
    assert found
    assert isinstance(found.path, FreePath)
    assert found.path.spline.count == 12
    t = np.linspace(0.0, found.trajectory.duration, 2001)
    assert find_nearest_pairs(robot, scene, found.trajectory(t))[0].min() > 0.0


def test_a_cut_that_asks_for_too_little_room_is_found_by_the_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the limits on rooms no motion is accepted that touches: the certificate decides."""
    monkeypatch.setattr(ways, "NEAR_ROOM", -1.0)
    monkeypatch.setattr(ways.Cuts, "add_touched", lambda self, q: False)
    found = plan(panda(), GOAL, REST, limits=LIMITS, scene=wall(), avoid=True)
    if found:
        t = np.linspace(0.0, found.trajectory.duration, 4001)
        assert find_nearest_pairs(panda(), wall(), found.trajectory(t))[0].min() > 0.0


# ---------------------------------------------------------------- failures


def test_a_start_or_goal_in_contact_says_which() -> None:
    robot = panda()
    at = robot.fk(GOAL)[:3, 3]
    for q, goal, word in ((REST, GOAL, "goal"), (GOAL, REST, "start")):
        found = plan(robot, goal, q, limits=LIMITS, scene=Scene(spheres=[(at, 0.1)]), avoid=True)
        assert found.status is PlanStatus.CONTACT
        assert found.failure is not None
        assert word in found.failure.reason
        assert "sphere1" in found.failure.reason
        assert "margin" in found.failure.advice
        assert "samples" not in found.failure.advice, "which would not help"


@pytest.mark.parametrize("timing", [pytest.param("optimal", marks=pytest.mark.soak), "smooth"])
def test_a_free_path_says_where_it_touches_and_what_may_help(timing: str) -> None:
    robot, T = panda(), panda().fk(REST)
    goal = T.copy()
    goal[:3, 3] += [0.0, 0.2, 0.0]
    path = free(Line(T, goal), turn=0.1)
    for at, words in ((T, "start configuration is in collision"), (goal, "sphere1")):
        scene = Scene(spheres=[(at[:3, 3], 0.03)])
        found = plan(robot, path, REST, limits=LIMITS, scene=scene, avoid=True, timing=timing, allow="jerk")
        assert found.status is PlanStatus.CONTACT
        assert found.failure is not None
        assert words in found.failure.reason and "sphere1" in found.failure.reason
        assert "margin" in found.failure.advice and "law" not in found.failure.advice
        assert ("elbow=True in planners.free" in found.failure.advice) is (at is goal)
        assert advise_elbow(found.failure, free(Line(T, goal), elbow=True), robot) is found.failure  # has it already


def test_a_goal_that_is_walled_in_ends_without_a_path_and_without_a_claim_that_there_is_none() -> None:
    robot, post = scara(), Scene(boxes=[(pose((0.2, 0.0, 0.0)), (0.05, 0.05, 1.0))])
    start, goal = np.array([-1.0, 0.0, 0.1, 0.0]), np.array([1.0, 0.0, 0.1, 0.0])  # the first link cannot pass the post
    found = plan(robot, goal, start, limits=LIMITS, scene=post, avoid=RRTConnect(max_samples=300))
    assert found.status is PlanStatus.NO_PATH_FOUND
    assert found.failure is not None
    assert "does not prove that there is none" in found.failure.reason
    assert "more samples" in found.failure.advice


@pytest.mark.parametrize(
    ("path", "options", "said"),
    [
        (GOAL, {"scene": None}, "a Scene with the obstacles"),
        (GOAL, {"scene": 3}, "a Scene, such as"),
        (Line(panda().fk(REST), panda().fk(GOAL)), {}, "planners.free"),
        (GOAL, {"winding": "short"}, '^winding: expected "nearest" or "exact"'),
        (GOAL, {"avoid": "rrt"}, "rrt"),
        (
            GOAL,
            {"scene": Scene(spheres=[((9.0, 0.0, 0.001 * k), 0.01) for k in range(20_000)])},
            "clouds=.*20,000 objects",
        ),
        (GOAL, {"avoid": 3}, "avoid: expected True, False, or a search: ompl, rrt_connect"),
    ],
)
def test_what_cannot_avoid_is_refused(path: Any, options: dict[str, Any], said: str) -> None:
    with pytest.raises((InvalidInput, UnknownName), match=said):
        plan(panda(), path, REST, limits=LIMITS, **{"scene": wall(), "avoid": True, **options})
