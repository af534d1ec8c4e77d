"""The proof of contact against coal: between its instants, at spheres that are grazed once, and where it is cut short."""

import json
import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
import planners
from optik import Scene
from optik.errors import InvalidInput
from optik.ik import IKStatus
from optik.scene.contact import SELF, find_clearances, find_contact, find_nearest_pairs, find_pairs
from optik.types import Array
from planners import MotionLimits, Trajectory
from planners.certificate.clearance import Clearance, clearance
from planners.planning import PlanStatus
from tests.planners import contacts
from tests.planners.contacts import COAL_ERROR, REST, Oracle, drawn, drawn_motion, panda, pose, table
from tests.seeds import shift_seed

coal = pytest.importorskip("coal")

LIMITS = MotionLimits(3.0, 10.0, 100.0)
REACHED = REST + np.array([0.4, 0.2, 0.0, 0.3, 0.0, 0.0, 0.0])


def closeness(found: float) -> float:
    """How far below the least distance found its bound may be."""
    return max(0.05 * found, 1e-4) + 2e-9


def check(scene: Scene, motion: Trajectory, rate: float, around: int, oracle: Oracle | None = None) -> Clearance:
    """Judge a motion, and the judgement by coal at a rate and at instants within ±5 ms of the least distances found."""
    proof, oracle = clearance(panda(), motion, scene), oracle or Oracle(panda(), scene)
    assert proof.scene is not None and proof.own is not None
    assert proof.touches or proof.proved, proof
    within = [max(kind.found, 0.0) + 1e-4 for kind in (proof.scene, proof.own)]
    if proof.touches:
        closest = proof.nearest
        at = oracle.near(motion(np.array([closest.time])), *within)
        assert min(at.scene[0], at.own[0]) <= COAL_ERROR
        assert closest.found <= 0.0 and not np.isfinite(closest.value) and proof.find_violations()
        return proof
    t = [contacts.instants(motion, rate)]
    t += [kind.time + np.linspace(-5e-3, 5e-3, around) for kind in (proof.scene, proof.own)]
    near = oracle.near(motion(np.clip(np.concatenate(t), 0.0, motion.end)), *within)
    for kind, distance in ((proof.scene, near.scene), (proof.own, near.own)):
        assert distance.min() >= kind.value - COAL_ERROR, kind
        assert distance.min() <= kind.found + COAL_ERROR, "the least distance found is one"
        assert 0.0 < kind.value <= kind.found <= kind.value + closeness(kind.found)
    return proof


def with_sphere(rng: np.random.Generator, motion: Trajectory) -> Scene:
    """A sphere of 1 mm at the surface of a capsule at one instant, which it overlaps by 0.1 mm."""
    shapes, t = panda().shapes, rng.uniform(0.0, motion.end)
    link, a, b, radius = shapes.capsules
    k = int(rng.integers(1, len(radius)))
    T = panda().frames(motion(t))[link[k] - 1]
    across = np.cross(b[k] - a[k] if (a[k] != b[k]).any() else rng.normal(size=3), rng.normal(size=3))
    place = a[k] + rng.random() * (b[k] - a[k]) + (radius[k] + 0.9e-3) * across / np.linalg.norm(across)
    return Scene(spheres=[(T[:3, :3] @ place + T[:3, 3], 1e-3)])


def test_proofs_hold_against_coal_between_their_instants() -> None:
    rng, oracle, free = np.random.default_rng(shift_seed(5)), Oracle(panda(), table()), 0
    for i in range(24):
        scene = table() if i % 2 else drawn(rng)
        free += check(scene, drawn_motion(rng, i), 60.0, 21, oracle if i % 2 else None).proved
    assert free >= 8


def test_a_sphere_that_is_grazed_at_one_instant_is_found() -> None:
    rng = np.random.default_rng(6)
    for i in range(60):
        motion = drawn_motion(rng, i)
        proof = clearance(panda(), motion, with_sphere(rng, motion))
        assert proof.touches and not proof.proved


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(20))
def test_five_thousand_proofs_hold_against_coal(seed: int) -> None:
    rng, oracle = np.random.default_rng([7, seed]), Oracle(panda(), table())
    count = {"free": 0, "contact": 0, "grazed": 0}
    for i in range(200):
        scene = table() if i % 2 else drawn(rng)
        proof = check(scene, drawn_motion(rng, i), 500.0, 201, oracle if i % 2 else None)
        count["free" if proof.proved else "contact"] += 1
    for i in range(50):
        motion = drawn_motion(rng, i)
        count["grazed"] += check(with_sphere(rng, motion), motion, 1.0, 1).touches
    print(count)
    assert count["grazed"] == 50
    assert count["free"] >= 40


@pytest.mark.parametrize("kind", [0, 1])
def test_bounds_of_one_wide_interval_hold_on_a_hundred_thousand_instants(kind: int) -> None:
    rng, scene, tight = np.random.default_rng(shift_seed(8)), table(), []
    for _ in range(3):
        whole = drawn_motion(rng, kind)
        motion = whole.stretched(1.0) if kind else quarter(whole)
        bound = contacts.bounds_of_one_interval(panda(), motion, scene)
        t = np.linspace(0.0, motion.end, 16_667)
        distance, _ = find_nearest_pairs(panda(), scene, motion(t))
        assert distance.min() >= bound.min() - 1e-9
        tight.append(distance.min() - bound.min())
    assert kind or min(tight) < 0.02, "the bounds are of use"


def planar(*kinds: str) -> optik.Robot:
    """Joints R about z, L metres apart along x, or P along x; a small sphere at the tip, and one on the first link."""
    fixed = np.repeat(np.eye(4)[None], len(kinds), axis=0)
    fixed[1:, 0, 3] = LINK
    for i, kind in enumerate(kinds):
        if kind == "P":  # its z along the x of the link before
            fixed[i, :3, :3], fixed[i, 0, 3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], 0.0
    tip = (0.0, 0.0, 0.0) if kinds[-1] == "P" else (LINK, 0.0, 0.0)
    spheres = [(len(kinds), tip, 0.01), (1, (0.2, 0.0, 0.0), 0.01)]
    shapes = optik.Shapes(spheres, names=("tip", "first"))
    limits = optik.JointLimits(np.full(len(kinds), -9.0), np.full(len(kinds), 9.0))
    sliding = np.array([kind == "P" for kind in kinds])
    return optik.Robot("planar", fixed, sliding, np.eye(4), limits).with_shapes(shapes)


LINK, HALF = 0.5, 0.01
SHARP: dict[str, tuple[tuple[str, ...], list[list[float]], tuple[float, float, float]]] = {
    "two joints turn on": (("R", "R"), [[0.0, 2.0, 0.0], [0.0, 2.0, 0.0]], (1.0, 0.0, 0.0)),
    "one accelerates": (("R",), [[0.0, 0.0, -30.0]], (0.0, 1.0, 0.0)),
    "one slides while one turns": (("R", "P"), [[0.0, 3.0, 0.0], [0.0, 2.0, 0.0]], (0.0, -1.0, 0.0)),
    "one slides": (("P",), [[0.2, 0.0, -30.0]], (1.0, 0.0, 0.0)),
    "three turn away from a link": (
        ("R", "R", "R"),
        [[0.0, 3.0, 0.0], [2.0, 2.0, 0.0], [0.5, 3.0, 0.0]],
        (0.0, 0.0, 1.0),
    ),
}
"""Joints; place, velocity and acceleration of each at the middle; and the normal of a plane behind the tip."""


@pytest.mark.parametrize("case", SHARP)
def test_a_bound_is_below_the_distance_and_as_sharp_as_the_acceleration(case: str) -> None:
    kinds, states, normal = SHARP[case]
    robot, (q, v, a) = planar(*kinds), np.array(states).T
    c = np.array([0.5 * a, v - a * HALF, q - v * HALF + 0.5 * a * HALF**2])[:, None]
    motion = Trajectory(PPoly(c, [0.0, 2.0 * HALF]))
    scene = Scene(planes=[(tuple(-0.2 * x for x in normal), normal)], allow=[("first", "plane1")])
    t = np.linspace(0.0, motion.end, 2001)
    kind = 1 if len(kinds) == 3 else 0
    distance = find_nearest_pairs(robot, Scene() if kind else scene, motion(t))[0]
    bound = contacts.bounds_of_one_interval(robot, motion, scene)[kind]
    drop = distance[1000] - distance.min()
    assert drop > 1e-4
    assert distance.min() - 0.25 * drop <= bound <= distance.min()


def quarter(motion: Trajectory) -> Trajectory:
    """The motion for a fortieth of its time, from a third of it on."""
    c, h, t = motion.coefficients[:, 0], motion.end / 40.0, motion.end / 3.0
    shifted = np.array([np.poly1d(c[:, j])(np.poly1d([1.0, t])).coeffs for j in range(7)]).T
    return Trajectory(PPoly(shifted[:, None], [0.0, h]))


# ---------------------------------------------------------------- what is examined
def test_an_empty_scene_is_for_the_links_alone() -> None:
    folded = REST.copy()
    folded[3] = -3.05
    found = clearance(panda(), line(REST, folded), Scene())
    assert found.scene is None and found.own is not None
    assert found.nearest == found.own and found.own.margin == 0.0


def line(first: Array, last: Array) -> Trajectory:
    from planners.trajectory.curve import quintic_through

    rest = np.zeros((2, 7))
    return Trajectory(quintic_through(np.array([0.0, 1.0]), np.array([first, last]), rest, rest))


TWO_ARMS = """<robot name="two"><link name="base"/>{links}
<joint name="right" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 -0.5 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="9"/></joint><joint name="wrist" type="revolute"><parent link="arm"/>
<child link="tip"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="9"/></joint>
<joint name="left" type="revolute"><parent link="base"/><child link="other"/><origin xyz="0 0.5 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="9"/></joint></robot>""".format(
    links="".join(
        f'<link name="{name}"><collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>'
        for name in ("arm", "tip", "other")
    )
)


@pytest.mark.parametrize("angle", [-0.15, 0.0, 0.3, 1.2])
@pytest.mark.parametrize("cloud", [True, False])
def test_a_held_arm_in_contact_with_the_scene_is_noted(angle: float, cloud: bool) -> None:
    robot = optik.Robot.from_urdf(TWO_ARMS, "tip", shapes=True, values={"left": angle})
    at, held = np.array([0.2, 0.58, 0.0]), np.array([0.2 * np.cos(angle), 0.5 + 0.2 * np.sin(angle), 0.0])
    ball = {"clouds": [(at[None], 0.05)]} if cloud else {"spheres": [(at, 0.05)]}
    touches = bool(np.linalg.norm(at - held) <= 0.1)
    (name,) = Scene(**ball).names
    plan = planners.plan(robot, [0.1, 0.2], [0.0, 0.0], limits=LIMITS, scene=Scene(**ball))
    assert plan and plan.certificate.clearance is not None
    known = plan.certificate.clearance
    assert (("other", name, "neither moves: in contact") in known.left_out) == touches
    assert (f"other and {name}" in known.note) == touches == (known.note in str(plan.certificate) and known.note != "")
    free = planners.plan(robot, [0.1, 0.2], [0.0, 0.0], limits=LIMITS, scene=Scene(**ball, allow=[("base", name)]))
    assert free.certificate.clearance is not None and not free.certificate.clearance.note


def test_pairs_that_are_left_out_are_named() -> None:
    scene = Scene(boxes=[(pose(panda().fk(REST)[:3, 3]), (0.1, 0.1, 0.1))], allow=[("joint7", "box1")])
    open_ = Scene(boxes=scene.boxes)
    assert clearance(panda(), line(REST, REACHED), open_).touches
    allowed = clearance(panda(), line(REST, REST + 1e-3), scene)
    assert ("joint7", "box1", "allowed by the scene") in allowed.left_out
    assert "joint7" not in allowed.scene.pair
    assert ("base", "scene", "neither moves") in allowed.left_out
    assert any(why == "neighbours" for *_, why in allowed.left_out)


def test_coal_leaves_out_the_pairs_that_a_scene_allows() -> None:
    robot = panda()
    at = robot.fk(REST)[:3, 3]
    post = (at, at + np.array([0.0, 0.0, 0.02]), 0.01)
    scene = Scene(planes=[((0.0, 0.0, -2.0), (0.0, 0.0, 1.0))], cylinders=[post], names=("floor", "cup"))
    allowed = replace(scene, allow=[("joint7", "cup")])
    one, other = (Oracle(robot, each).near(REST[None], 0.05, 0.0).scene[0] for each in (scene, allowed))
    assert one < 0.0 < other


def test_the_margin_must_be_exceeded() -> None:
    motion = line(REST, REACHED)
    free = clearance(panda(), motion, table()).scene
    wide = clearance(panda(), motion, replace(table(), margin=free.found + 1e-3))
    assert wide.touches and not wide.proved
    assert "margin" in wide.find_violations()[0].words and "box" in wide.find_violations()[0].words
    near = clearance(panda(), motion, replace(table(), margin=0.99 * free.value))
    assert near.proved and near.scene is not None and near.scene.value > near.scene.margin == 0.99 * free.value
    assert near.own is not None and near.own.margin == 0.0, "links need not keep the margin"
    assert 0.0 < near.own.value < near.scene.margin
    assert near.nearest is near.scene and near.own.found < near.scene.found, "the nearest is that with the least room"


@pytest.mark.parametrize("seed", range(3))
def test_clearances_of_configurations_are_those_of_coal_to_the_scene_and_between_links(seed: int) -> None:
    rng = np.random.default_rng(seed)
    full, q = drawn(rng), panda().limits.sample(rng, 15)
    scene = Scene(boxes=full.boxes[:1], spheres=full.spheres[:1], capsules=full.capsules[:1], margin=0.03)
    distance, pair = find_clearances(panda(), scene, q)
    near, apart = Oracle(panda(), scene).near(q, np.inf, np.inf), distance > 0.0
    for i, expected in enumerate((near.scene, near.own)):
        np.testing.assert_allclose(distance[apart[:, i], i], expected[apart[:, i]], rtol=0.0, atol=COAL_ERROR)
        assert (expected[~apart[:, i]] <= COAL_ERROR).all()
        assert ((find_pairs(panda(), scene).bodies[pair[:, i], 2] == SELF) == bool(i)).all()
    assert apart.any(axis=0).all()
    rooms = find_nearest_pairs(panda(), scene, q)[0]
    np.testing.assert_allclose((distance - (scene.margin, 0.0)).min(axis=1), rooms, rtol=0.0, atol=1e-12)
    alone, none = find_clearances(panda(), Scene(), q[0])
    assert np.isinf(alone[0, 0]) and none[0, 0] == -1 and alone[0, 1] == distance[0, 1]


# ---------------------------------------------------------------- certificates, plans, files
@cache
def solved() -> planners.Plan:
    return planners.plan(panda(), REACHED, REST, scene=replace(table(), margin=0.002))


def test_a_plan_carries_its_scene_into_files_and_replans(tmp_path: Any) -> None:
    made = solved()
    assert made and made.certificate.clearance is not None
    proof = json.loads(json.dumps(made.to_dict(), allow_nan=False))["certificate"]["clearance"]
    assert [proof[kind]["margin"] for kind in ("scene", "own")] == [0.002, 0.0]
    assert proof["scene"]["value"] == made.certificate.clearance.scene.value > 0.002
    said = str(made)
    for words, kind in (("to the scene", "margin 2 mm"), ("between links", "margin 0 mm")):
        assert re.search(rf"{words} at least \d\S* mm \({kind}; found \d\S* mm, ", said), said
    made.save(tmp_path / "motion.json")
    read = planners.load_motion(tmp_path / "motion.json")
    assert read.scene == made.scene == replace(table(), margin=0.002) != table()
    assert read.certify().clearance == made.certificate.clearance
    later = planners.replan(made, 0.3)
    assert later and later.certificate.clearance is not None and later.certificate.clearance.scene.margin == 0.002
    other = planners.replan(made, 0.3, scene=replace(table(), margin=0.001))
    assert other.certificate.clearance is not None and other.certificate.clearance.scene.margin == 0.001
    blocked = Scene(boxes=[(pose(panda().fk(REACHED)[:3, 3]), (0.05, 0.05, 0.05))])
    assert planners.replan(made, 0.3, scene=blocked).status is not PlanStatus.SOLVED
    assert planners.plan(panda(), REACHED, REST).certificate.clearance is None


@pytest.mark.parametrize("stop", [False, True])
def test_a_state_that_touches_a_new_scene_is_refused_with_the_pair_and_the_position(stop: bool) -> None:
    made = solved()
    here = pose(panda().fk(made.trajectory(0.3))[:3, 3])
    refused = planners.replan(made, 0.3, stop=stop, scene=Scene(boxes=[(here, (0.05, 0.05, 0.05))]))
    assert refused.status is PlanStatus.CONTACT and refused.failure is not None and not refused.has_motion
    assert "box" in refused.failure.reason and "joint7" in refused.failure.reason
    np.testing.assert_allclose(made.joint_path(refused.failure.s), made.trajectory(0.3), atol=1e-6)


def test_a_plan_that_touches_names_the_place_and_the_pair() -> None:
    through = REST + np.array([0.4, 0.9, 0.0, 0.3, 0.0, 0.0, 0.0])
    refused = planners.plan(panda(), through, REST, scene=table())
    assert refused.status is PlanStatus.CONTACT and refused.failure is not None
    q = refused.prefix(refused.failure.s)
    assert find_contact(panda(), table(), q).distance <= 0.0
    assert find_contact(panda(), table(), refused.prefix(0.9 * refused.failure.s)).distance > 0.0
    assert "joint7 and box" in refused.failure.reason
    start = planners.plan(panda(), REST, through, scene=table())
    assert start.status is PlanStatus.CONTACT and start.failure is not None
    assert "start" in start.failure.reason and start.failure.s == 0.0


def test_the_best_branch_is_one_that_is_free() -> None:
    arm = elbow_arm()
    q = np.array([0.3, -0.9, 1.2, 0.4, 0.8, 0.1])
    target = arm.fk(q)
    goal = target.copy()
    goal[:3, 3] += [0.02, 0.05, 0.0]
    path = planners.Line(target, goal)
    elbow = arm.frames(q)[2, :3, 3]
    scene = Scene(spheres=[(elbow, 0.03)])
    kept = planners.plan(arm, path, q, scene=scene, limits=LIMITS)
    assert kept.status is PlanStatus.CONTACT and kept.failure is not None
    other = planners.plan(arm, path, scene=scene, limits=LIMITS)
    assert other and other.certificate.clearance is not None and other.certificate.clearance.proved
    free = find_nearest_pairs(arm, scene, other.trajectory(np.linspace(0.0, other.trajectory.end, 200)))[0]
    assert free.min() >= other.certificate.clearance.nearest.value - 1e-9


def test_the_null_space_motion_is_one_that_is_free() -> None:
    robot, goal = panda(), panda().fk(REST)
    goal[:3, 3] += [0.05, 0.1, -0.05]
    path = planners.Line(robot.fk(REST), goal)
    plain = planners.plan(robot, path)
    scene = Scene(spheres=[(robot.frames(plain.trajectory(0.5 * plain.trajectory.end))[3, :3, 3], 0.03)])
    assert clearance(robot, plain.trajectory, scene).touches
    assert planners.plan(robot, path, plain.trajectory(0.0), scene=scene).status is PlanStatus.CONTACT
    free = planners.plan(robot, path, scene=scene)
    assert free and free.certificate.clearance is not None and free.certificate.clearance.proved


def test_a_plan_that_touches_later_says_which_start_is_free() -> None:
    arm, q = elbow_arm(), np.array([0.3, -0.9, 1.2, 0.4, 0.8, 0.1])
    goal = arm.fk(q)
    goal[:3, 3] += [0.02, 0.2, 0.0]
    path = planners.Line(arm.fk(q), goal)
    followed = planners.follow(optik.ik.make_solver(arm), path, q)
    end = followed.joint_path(followed.joint_path.end)
    stopped = planners.plan(arm, path, q, scene=Scene(spheres=[(arm.frames(end)[2, :3, 3], 0.005)]), limits=LIMITS)
    assert stopped.status is PlanStatus.CONTACT and stopped.failure is not None
    assert stopped.failure.s > 0.1 * path.end
    assert 'branch="best", which follows the whole path without collision from the start' in stopped.failure.advice


def elbow_arm() -> optik.Robot:
    """The UR5e with thin capsules along its upper arm and forearm."""
    arm = optik.load("ur5e")
    a = arm.fixed[2, :3, 3]
    b = arm.fixed[3, :3, 3]
    return arm.with_shapes(optik.Shapes([(2, (0, 0, 0), tuple(a), 0.03), (3, (0, 0, 0), tuple(b), 0.03)]))


def test_free_inverse_kinematics_is_asked_for() -> None:
    arm, q = elbow_arm(), np.array([0.3, -0.9, 1.2, 0.4, 0.8, 0.1])
    target, scene = arm.fk(q), Scene(spheres=[(arm.frames(q)[2, :3, 3], 0.03)])
    plain = optik.solve_ik(arm, target, q)
    assert plain and find_contact(arm, scene, plain.q).distance <= 0.0
    free = optik.solve_ik(arm, target, q, scene=scene)
    assert free and find_contact(arm, scene, free.q).distance > 0.0
    assert np.abs(arm.fk(free.q) - target).max() < 1e-5
    wall = Scene(boxes=[(np.eye(4), (50.0, 50.0, 50.0))])
    none = optik.solve_ik(arm, target, q, scene=wall)
    assert none.status is IKStatus.IN_CONTACT and "box1" in none.message
    with pytest.raises(InvalidInput, match="shapes"):
        optik.solve_ik(arm.with_shapes(None), target, q, scene=scene)


@pytest.mark.parametrize("bad", ["scene", "robot"])
def test_bad_input_is_one_line(bad: str) -> None:
    bare = optik.load("panda").with_shapes(None)
    arm, scene = {"scene": (panda(), "shelf"), "robot": (bare, table())}[bad]
    with pytest.raises(InvalidInput) as error:
        planners.plan(arm, REACHED, REST, scene=scene)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("margin", [float("nan"), -1.0, "x", float("inf"), True])
def test_a_margin_is_a_distance(margin: Any) -> None:
    with pytest.raises(InvalidInput, match=r"scene\.margin"):
        Scene(margin=margin)


# ---------------------------------------------------------------- motions of others
@pytest.mark.filterwarnings("ignore:.*no units in the header:optik.errors.AssumptionWarning")
def test_setpoints_of_others_are_certified_without_a_path(tmp_path: Any) -> None:
    made, robot = solved(), panda()
    motion = made.trajectory
    t = np.linspace(0.0, motion.end, 301)
    names = list(reversed(robot.joint_names))
    order = [robot.joint_names.index(name) for name in names]
    rows = [motion(t, k)[:, order] for k in range(3)]
    table_ = "time," + ",".join(names + [f"dq_{n}" for n in names]) + "\n"
    table_ += "\n".join(",".join(map(repr, map(float, r))) for r in np.column_stack([t, rows[0], rows[1]]))
    (tmp_path / "m.csv").write_text(table_)
    data = {"joint_names": names, "times": t.tolist(), "positions": rows[0].tolist(), "velocities": rows[1].tolist()}
    (tmp_path / "m.json").write_text(json.dumps(data))
    planners.to_ros(made, tmp_path / "plain.json")
    message = json.loads((tmp_path / "plain.json").read_text())
    (tmp_path / "moveit.json").write_text(json.dumps({"joint_trajectory": message, "multi_dof_joint_trajectory": {}}))
    for file in ("m.csv", "m.json", "moveit.json"):
        read = planners.load_trajectory(tmp_path / file, robot)
        np.testing.assert_allclose(read(t), motion(t), rtol=0, atol=1e-6)
        proof = planners.certify(robot, None, read, scene=table())
        assert proof.clearance is not None and proof.clearance.proved
        json.dumps(proof.to_dict(), allow_nan=False)
    assert planners.load_trajectory(tmp_path / "m.csv", robot, interpolation="linear").coefficients.shape[0] == 2
    for wrong in ({"times": [1.0, *t[1:].tolist()]}, {"joint_names": names[1:]}, {"positions": rows[0][1:].tolist()}):
        (tmp_path / "bad.json").write_text(json.dumps(data | wrong))
        with pytest.raises(InvalidInput):
            planners.load_trajectory(tmp_path / "bad.json", robot)
    with pytest.raises(InvalidInput, match="interpolation"):
        planners.load_trajectory(tmp_path / "m.csv", robot, interpolation="quintic")
    (tmp_path / "more.csv").write_text(table_.replace("time,", "finger,", 1))
    with pytest.raises(InvalidInput, match="times"):
        planners.load_trajectory(tmp_path / "more.csv", robot)


def test_what_is_open_when_the_intervals_run_out_counts_for_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = drawn_motion(np.random.default_rng(0), 0)
    scene = Scene(boxes=[(pose((0.0, 0.0, 1.2)), (0.1, 0.1, 0.1))])
    whole = clearance(panda(), motion, scene)
    cut = []
    for most in (1, 2, 4):
        monkeypatch.setattr("planners.certificate.clearance.MOST_INTERVALS", most)
        cut.append(clearance(panda(), motion, scene))
    for kind in ("scene", "own"):
        values, known = [getattr(one, kind).value for one in cut], getattr(whole, kind)
        assert all(value <= known.found for value in values)
        assert min(values) < 0.9 * known.value  # what is open counts
    assert all(one.scene is not None and one.scene.value > 0.0 for one in cut)  # not that of the links
