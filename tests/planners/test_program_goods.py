"""Programs that pick up and put down: scenes with what is carried, limits on goods, and certificates of several sections."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import optik
import planners
from optik import registry, se3
from optik.arm.limits import VelocityByPosition
from optik.errors import InvalidInput, UnknownName
from planners import Line, MotionLimits, Part, Program
from planners.limits import ALL_LIMITS
from planners.paths.program import ProgramPath
from planners.planning import PlanStatus
from planners.program import Dwell, Move, ToolChange
from planners.replan import finish
from planners.trajectory import append_rest, join

HAND = optik.load("panda_hand")
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
PANDA_LIMITS = MotionLimits.of(HAND, velocity=1.5, acceleration=5.0, jerk=50.0)
SHELF = (se3.pose(p=[0.45, 0.1, 0.1]), (0.3, 0.3, 0.2))
BOTTLE = ((0.0, 0.0, 0.02), (0.0, 0.0, 0.1), 0.03)  # its lowest point is 0.13 m below the tool
UR = optik.load("ur5e")
UR_HOME = np.deg2rad([0, -90, 90, -90, -90, 0])
LIMITS = MotionLimits.of(UR, acceleration=12.0, jerk=200.0)


def down(x: float, y: float, z: float) -> np.ndarray:
    return se3.pose(np.diag([1.0, -1.0, -1.0]), [x, y, z])


def off(*way: float) -> np.ndarray:
    T = UR.fk(UR_HOME)
    return se3.pose(T[:3, :3], T[:3, 3] + way)


def pick(grasp: float, *, allow=(("payload", "shelf"),), payload=0.4, shapes=(BOTTLE,)) -> planners.Plan:
    """A bottle is taken at a height of the tool over the floor, lifted, and put down beside."""
    scene = optik.Scene(boxes=[SHELF], names=("shelf",), allow=allow)
    carried = {} if shapes is None else {"shapes": list(shapes)}
    program = Program([
        Part(down(0.45, 0.1, 0.5), move="joint"), Part(down(0.45, 0.1, grasp)), ToolChange(payload=payload, **carried),
        Part(Move([0, 0, 0.1], "base")), Part(Move([0, 0.05, 0], "base")), Part(Move([0, 0, -0.1], "base")),
        ToolChange(payload=None), Part(Move([0, 0, 0.15], "base")),
    ])  # fmt: skip
    return planners.plan(HAND, program, READY, limits=PANDA_LIMITS, scene=scene)


# ---------------------------------------------------------------- scenes
@pytest.fixture(scope="module")
def lifted() -> planners.ProgramPlan:
    return pick(0.33)


def test_what_stands_on_a_surface_is_lifted_and_put_down(lifted) -> None:
    assert lifted, lifted
    carried = ("payload", "shelf", "allowed by the scene")
    assert [carried in s.certificate.clearance.left_out for s in lifted.sections] == [False] * 2 + [True] * 3 + [False]
    assert carried in lifted.certificate.clearance.left_out
    assert lifted.scene.allow == (("payload", "shelf"),)
    alone = planners.certify(
        HAND, lifted.path, lifted.trajectory, lifted.limits, scene=lifted.scene, tolerance=(1e-4, 1e-3)
    )
    assert alone.is_valid and alone.clearance.left_out == lifted.certificate.clearance.left_out
    np.testing.assert_allclose(alone.clearance.scene.value, lifted.certificate.clearance.scene.value, rtol=1e-4)


def test_a_lifted_motion_is_read_from_its_file_replanned_and_stopped(lifted, tmp_path) -> None:
    lifted.save(tmp_path / "m.json")
    assert planners.load_motion(tmp_path / "m.json").certificate.is_valid
    when = lifted.times[2]
    middle = 0.5 * (when.begin + when.rest)
    onward = planners.replan(lifted, middle, limits=PANDA_LIMITS.scale(0.5))
    assert onward and onward.scene == lifted.scene
    stop = planners.replan(lifted, middle, stop=True)
    assert stop and planners.replan(stop, stop.duration)


@pytest.mark.parametrize("depth", [0.001, pytest.param(0.03, marks=pytest.mark.soak)])
def test_a_hand_in_the_surface_is_found_where_only_the_payload_may_touch(lifted, depth: float) -> None:
    over = lifted.certificate.clearance.scene  # of the hand, which is lowest at 0.33 m
    assert "payload" not in over.pair and over.pair[1] == "shelf"
    found = pick(0.33 - over.found - depth)
    assert found.status is PlanStatus.CONTACT and found.failure.part == 1
    assert "shelf" in found.failure.reason and "payload" not in found.failure.reason


def test_a_pair_is_needed_for_the_payload_and_names_the_part_that_begins_in_contact() -> None:
    found = pick(0.329, allow=())
    assert (
        found.status is PlanStatus.CONTACT and found.failure.part == 2 and "payload and shelf" in found.failure.reason
    )
    assert found.robot.payload is not None and found.prefix is None


def test_a_name_that_no_section_has_is_refused() -> None:
    assert pick(0.33, shapes=None)  # a payload without shapes has no pairs
    with pytest.raises(UnknownName, match="'bottle'"):
        pick(0.33, allow=[("bottle", "shelf")])
    with pytest.raises(UnknownName, match="'payload'"):
        pick(0.33, payload=None, shapes=None)
    scene = optik.Scene(boxes=[SHELF], names=("shelf",), allow=[("payload", "shelf")])
    with pytest.raises(UnknownName, match="'payload'"):
        planners.plan(HAND, down(0.45, 0.1, 0.5), READY, limits=PANDA_LIMITS, scene=scene)


# ---------------------------------------------------------------- goods
CYCLE = [
    Part(off(0, 0.2, 0), move="joint", blend=0.02), Part(Move([0, 0, 0.1]), tool_speed=0.25), Dwell(0.2),
    ToolChange(payload=1.5), Part(Move([0, 0, -0.1])), Part(off(0.1, -0.2, 0), move="joint"), Dwell(0.2),
    ToolChange(payload=None), Part(UR_HOME),
]  # fmt: skip


@pytest.fixture(scope="module")
def sucked() -> planners.ProgramPlan:
    return planners.plan(
        UR, Program(CYCLE), UR_HOME, limits=replace(LIMITS, extra={"suction": planners.limits.Suction(0.5, 20.0)})
    )


def test_goods_limit_the_sections_that_carry_them(sucked) -> None:
    assert sucked and sucked.certificate.exempt == {"suction": (0, 3)}
    free = planners.plan(UR, Program(CYCLE), UR_HOME, limits=LIMITS)
    same = [a.duration == pytest.approx(b.duration) for a, b in zip(sucked.sections, free.sections, strict=True)]
    assert same[0] and same[3] and sucked.sections[2].duration > 1.1 * free.sections[2].duration
    assert sucked.certificate.extreme("suction").ratio == pytest.approx(1.0, abs=1e-5)
    heavy = planners.limits.Suction(0.5, 20.0, mass=1.5)
    for one in sucked.sections[1:3]:
        proof = planners.certify(UR, one.path, one.trajectory, MotionLimits(extra={"suction": heavy}))
        assert proof.is_valid and proof.extreme("suction").ratio == pytest.approx(
            one.certificate.extreme("suction").ratio
        )
    empty = sucked.sections[3]  # would throw off what it does not carry
    assert not planners.certify(UR, empty.path, empty.trajectory, MotionLimits(extra={"suction": heavy})).is_valid


def test_the_sections_without_goods_are_listed_also_from_a_file_and_after_replanning(
    sucked, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "suction: 1 (tool at" in str(sucked) and "not applied in sections 1, 4 (no payload)" in str(sucked)
    assert sucked.certificate.to_dict()["exempt"] == {"suction": [0, 3]}
    sucked.save(tmp_path / "m.json")
    proof = planners.load_motion(tmp_path / "m.json").certificate
    assert proof.is_valid and proof.exempt == sucked.certificate.exempt
    assert proof.extreme("suction").ratio == pytest.approx(sucked.certificate.extreme("suction").ratio)
    for section, exempt in ((2, (3,)), (3, (3,))):
        when = sucked.times[section]
        onward = planners.replan(sucked, 0.5 * (when.begin + when.rest))
        assert onward and onward.certificate.exempt == {"suction": exempt}
    weaker = replace(sucked.limits, extra={"suction": planners.limits.Suction(0.5, 18.0)})
    slower = planners.replan(sucked, 0.5 * sucked.times[0].rest, limits=weaker)
    assert slower and slower.sections[3].duration == pytest.approx(sucked.sections[3].duration)
    assert slower.sections[2].duration > sucked.sections[2].duration
    monkeypatch.setattr(finish, "CHECKED_STEPS", 40)
    assert sucked.slowed_to(stopping_time=1.0).certificate.exempt == {"suction": (0, 3)}


def test_goods_count_everywhere_in_a_program_without_a_payload() -> None:
    turned = UR.fk(UR_HOME + np.array([0, 0, 0, 0.6, 0, 0]))
    items = [Part(off(0, 0.1, 0), move="joint"), Part(turned, move="joint"), Part(UR_HOME)]
    cup = replace(LIMITS, extra={"open_container": planners.limits.OpenContainer(0.3, axis="-z")})
    tilted = planners.plan(UR, Program(items), UR_HOME, limits=cup)
    assert not tilted and tilted.failure.part == 1 and "open container" in tilted.failure.reason
    carried = [items[0], ToolChange(payload=0.5), Part(off(0, 0.1, 0.1)), ToolChange(payload=None), *items[1:]]
    held = planners.plan(UR, Program(carried), UR_HOME, limits=cup)
    assert held and held.certificate.exempt == {"open_container": (0, 2, 3)}
    light = replace(LIMITS, extra={"suction": planners.limits.Suction(0.5, 18.0, mass=1.5)})
    found = planners.plan(UR, Program([items[0], items[2]]), UR_HOME, limits=light)
    assert found and found.certificate.exempt == {} and found.certificate.extreme("suction").ratio > 0.99
    with pytest.raises(InvalidInput, match="no mass"):
        planners.plan(
            UR, Program(items), UR_HOME, limits=replace(LIMITS, extra={"suction": planners.limits.Suction(0.5, 20.0)})
        )


# ---------------------------------------------------------------- messages
@pytest.mark.parametrize("rate", [None, 125.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_law_with_jumps_of_the_acceleration_is_written_with_its_stops(
    seed: int, rate: float | None, tmp_path
) -> None:
    rng = np.random.default_rng([5, seed])
    middle = [ToolChange(payload=1.0)] if seed == 0 else [Dwell(0.15)] if seed == 1 else []
    items = [Part(off(*rng.uniform(-0.15, 0.15, 3)), move="joint"), Part(Move(rng.uniform(-0.1, 0.1, 3))), *middle,
             Part(UR_HOME + rng.uniform(-0.3, 0.3, 6))]  # fmt: skip
    found = planners.plan(UR, Program(items), UR_HOME, limits=MotionLimits.of(UR, acceleration=8.0), timing="toppra")
    sent = planners.to_ros(found, tmp_path / "m.yaml", rate=rate)
    assert sent.certificate.is_valid and sent.factor < 1.5
    read = planners.load_trajectory(tmp_path / "m.yaml", UR)  # by another way than the export
    still = read.knots[np.abs(read(read.knots, 1)).max(axis=1) < 1e-12]
    at = [sent.factor * t for when in found.times for t in (when.begin, when.rest)]
    assert all(np.abs(still - t).min() < 2e-9 for t in at)
    if seed == 1:
        wait = found.times[1]
        t = sent.factor * np.linspace(wait.rest, wait.end, 50)[1:-1]
        assert np.abs(read(t, 1)).max() < 1e-12


def test_a_message_is_slowed_for_what_each_section_carries(sucked, tmp_path) -> None:
    sent = planners.to_ros(sucked, tmp_path / "m.yaml", rate=40.0)
    assert sent.certificate.is_valid and sent.certificate.exempt == {"suction": (0, 3)}
    items = [Part(off(0.05, 0.1, 0), move="joint"), ToolChange(payload=3.0), Part(off(0.25, -0.2, 0), move="joint")]
    free = planners.plan(UR, Program(items), UR_HOME, limits=LIMITS)  # what it needs is the limit
    heavy = replace(LIMITS, torque=free.certificate.torque.value * (1.0 + 1e-6))
    loaded = planners.plan(UR, Program(items), UR_HOME, limits=heavy)
    assert loaded and planners.to_ros(loaded, tmp_path / "n.yaml", rate=40.0).certificate.is_valid


# ---------------------------------------------------------------- the whole is the worst of the sections
EYE = [[float(i == j) for j in range(6)] for i in range(6)]
BOUNDS = {
    "velocity": 1.6, "acceleration": 12.0, "jerk": 250.0, "tool_speed": 0.8, "rotation_speed": 0.7,
    "torque": [60.0, 60.0, 60.0, 6.0, 6.0, 6.0], "torque_rate": [400.0, 900.0, 400.0, 40.0, 40.0, 40.0],
    "acceleration_by_velocity": planners.limits.AccelerationByVelocity(12.0, 14.0, 3.0), "body_speed": 1.2,
    "grip": planners.limits.Grip(0.5, 11.0, 1.0), "open_container": planners.limits.OpenContainer(0.6, "-z"),
    "suction": planners.limits.Suction(0.5, 30.0, 1.0), "tray": planners.limits.Tray(0.7, None, "-z"),
    "velocity_by_position": VelocityByPosition(np.full(6, 0.2), np.full(6, 0.4)),
    "motor_velocity": {"matrix": EYE, "bound": [1.6] * 6}, "motor_acceleration": {"matrix": EYE, "bound": [12.0] * 6},
    "motor_jerk": {"matrix": EYE, "bound": [250.0] * 6},
    "motor_torque": {"matrix": EYE, "bound": [60.0, 60.0, 60.0, 6.0, 6.0, 6.0]},
    "motor_torque_rate": {"matrix": EYE, "bound": [400.0, 900.0, 400.0, 40.0, 40.0, 40.0]},
}  # fmt: skip
"""A bound of every limit that a slow section respects and a fast one exceeds."""
NEAR = optik.Scene(spheres=[(off(0.35, 0.35, 0.05)[:3, 3], 0.02)])


@pytest.fixture(scope="module")
def uneven():
    """Two sections, of which the second is driven three times as fast, off its path, and nearer to an obstacle."""
    arm = UR.with_motors(EYE)
    ends = [off(0, 0, 0), off(0.0, 0.2, 0.05), off(0.25, 0.2, 0.05) @ se3.pose(se3.exp_so3([0.0, 0.0, 0.4]))]
    q, plans = UR_HOME, []
    for a, b in itertools.pairwise(ends):
        plans.append(
            planners.plan(UR, Line(a, b), q, limits=MotionLimits.of(UR, velocity=0.8, acceleration=3.0, jerk=50.0))
        )
        q = plans[-1].goal
    middle = 0.5 * (ends[1][:3, 3] + ends[2][:3, 3]) + [0.0, 0.0078, 0.0]
    paths = [plans[0].path, planners.Arc.through(ends[1], middle, ends[2])]
    motions = [plans[0].trajectory.without_s, plans[1].trajectory.without_s.stretched(1.0 / 3.0)]
    whole = join(append_rest(motions[0], 0.1), motions[1])
    extra = {name: bound for name, bound in BOUNDS.items() if name not in ALL_LIMITS}
    limits = MotionLimits(**{name: BOUNDS[name] for name in ALL_LIMITS}, extra=extra)
    options = {"limits": limits, "tolerance": (1e-3, 1e-2), "scene": NEAR}
    parts = [planners.certify(arm, path, motion, **options) for path, motion in zip(paths, motions, strict=True)]
    return parts, planners.certify(arm, ProgramPath(paths, [arm, arm]), whole, **options), motions[0].end + 0.1


def test_every_limit_is_in_the_test_of_merged_certificates() -> None:
    assert set(BOUNDS) == {*ALL_LIMITS, *registry.own_names("planners.limits")}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_limit_that_only_the_second_section_exceeds_is_exceeded(uneven, name: str) -> None:
    (slow, fast), whole, begin = uneven
    assert np.nanmax(slow.extreme(name).ratio) < 1.0 < np.nanmax(fast.extreme(name).ratio)
    assert replace(slow, enforced=(name,), path_error=whole.path_error, tolerance=None).is_valid
    merged, worst = whole.extreme(name), fast.extreme(name)
    i = int(np.nanargmax(worst.ratio)) if np.ndim(worst.ratio) else ()
    assert np.asarray(merged.ratio)[i] == pytest.approx(np.asarray(worst.ratio)[i], rel=1e-9)
    assert np.asarray(merged.value)[i] == pytest.approx(np.asarray(worst.value)[i], rel=1e-9)
    assert np.asarray(merged.time)[i] == pytest.approx(begin + np.asarray(worst.time)[i], abs=1e-9)
    ratios = np.fmax(slow.extreme(name).ratio, worst.ratio)
    np.testing.assert_allclose(merged.ratio, ratios, rtol=1e-9)
    judged = replace(whole, enforced=(name,), tolerance=None, clearance=None)
    assert not judged.is_valid and judged.violations[0].words.startswith(name)


def test_clearance_and_path_error_are_those_of_the_worse_section(uneven) -> None:
    (slow, fast), whole, begin = uneven
    assert fast.clearance.scene.value < 0.8 * slow.clearance.scene.value
    assert whole.clearance.scene.value == pytest.approx(fast.clearance.scene.value, rel=1e-9)
    assert whole.clearance.scene.time == pytest.approx(begin + fast.clearance.scene.time)
    assert slow.path_error.distance < 1e-5 and fast.path_error.distance > 5e-3
    assert whole.path_error.distance == pytest.approx(fast.path_error.distance, rel=1e-9)
    assert whole.path_error.t_distance == pytest.approx(begin + fast.path_error.t_distance)
    judged = replace(whole, enforced=())
    assert not judged.is_valid and any("off its path" in words for words in judged.reasons)
    assert whole.energy.drawn == pytest.approx(slow.energy.drawn + fast.energy.drawn) and not whole.exempt
    nearer = replace(NEAR, margin=0.5 * (slow.clearance.scene.value + fast.clearance.scene.value))
    for part, valid in ((slow, True), (fast, False)):
        room = planners.certify(UR, None, part.analysis.trajectory, MotionLimits(), scene=nearer)
        assert room.is_valid == valid
    assert not planners.certify(UR, None, whole.analysis.trajectory, MotionLimits(), scene=nearer).is_valid
