"""Limits as makers and goods state them: each judged, enforced and filed, against evaluations of its own here."""

from __future__ import annotations

import json
import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
from optik.arm.limits import JointLimits, VelocityByPosition
from optik.errors import InvalidInput, UnknownName
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Plan, certify, free, load_motion, make_law, plan, replan, save
from planners.certificate.analysis import MotionAnalysis
from planners.limits import AccelerationByVelocity, Grip, OpenContainer, Suction, Tray, kind_of
from planners.limits.base import PathPoints
from planners.limits.record import find_velocity_reversals
from planners.trajectory import Trajectory
from tests.planners.test_limit_proofs import specific_force

BOX: dict[str, Any] = {"acceleration": 10.0, "jerk": 100.0}
BENT = np.deg2rad([10.0, -80.0, 95.0, -105.0, -90.0, 20.0])
"""A start of the ur5e with the tool downwards."""
UP = "-z"
LIMITS: dict[str, Any] = {
    "velocity_by_position": VelocityByPosition(np.full(6, 0.2), np.full(6, 0.3)),
    "acceleration_by_velocity": AccelerationByVelocity(8.0, 11.0, 3.0),
    "body_speed": 0.3,
    "open_container": OpenContainer(np.deg2rad(8.0), UP, (0.0, 0.02, 0.05)),
    "tray": Tray(0.3, 4.0, UP),
    "grip": Grip(0.4, 14.0, 1.0, "y", (0.0, 0.0, 0.08)),
    "suction": Suction(0.4, 20.0, 1.0, "z", (0.0, 0.0, 0.03)),
}
"""A value of each that binds on `moving`."""


@cache
def arm() -> optik.Robot:
    return optik.load("ur5e")


@cache
def moving(name: str) -> Any:
    """A path on which the limit binds."""
    if name in ("velocity_by_position", "acceleration_by_velocity", "body_speed"):
        return JointLine(arm(), BENT, BENT + np.array([1.2, -0.9, 0.8, 0.7, -1.0, 1.5]))
    goal = arm().fk(BENT).copy()
    goal[:3, 3] += (0.25, -0.2, 0.1)
    return Line(arm().fk(BENT), goal)


@cache
def planned(name: str, law: str = "optimal") -> Plan:
    return plan(
        arm(),
        moving(name),
        BENT,
        limits=MotionLimits.of(arm(), torque=None, **BOX, **{name: LIMITS[name]}),
        timing=law,
        allow="jerk",
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_grip_has_a_face_on_both_sides(sign: float) -> None:
    kind, bound = kind_of("grip"), LIMITS["grip"]
    along = sign * kind.axis(bound) * bound.force / bound.mass
    E, most = kind.faces(bound, bound.mass, np.zeros((1, 8, 3)))
    assert (E[0] @ along / most).max() == pytest.approx(1.0)


def test_joints_rest_or_reverse_where_they_barely_move_or_change_their_sign() -> None:
    backwards, across = np.array([-1.0, -1e-12, -1.0]), np.array([1.0, -1.0, -1.0])
    for q1, rests in (
        (backwards, [False, True, False]),
        (-backwards, [False, True, False]),
        (across, [True, True, False]),
    ):
        np.testing.assert_array_equal(find_velocity_reversals(q1[:, None])[:, 0], rests)


@pytest.mark.parametrize("name", list(LIMITS))
def test_only_what_scales_with_time_is_called_homogeneous(name: str) -> None:
    found = planned(name)
    at = PathPoints(found.joint_path, np.linspace(0.1, 0.9, 9) * found.path.end)
    slow, fast = (found.limits.ratios(name, at, [np.full(9, 0.5 * k**i) for i in (1, 2, 3)]) for k in (1.0, 2.0))
    scales = np.allclose(fast, 2.0 ** kind_of(name).order * slow)
    assert scales == kind_of(name).homogeneous


def dense(motion: Trajectory, count: int = 20_001) -> tuple[Array, Array, Array, Array]:
    t = np.linspace(0.0, motion.end, count)
    return t, motion(t), motion(t, 1), motion(t, 2)


def peak(name: str, motion: Trajectory) -> float:
    """Largest ratio at dense instants, by formulas of its own."""
    value, limits = LIMITS[name], arm().limits
    _, q, v, a = dense(motion)
    if name == "velocity_by_position":
        room = np.where(v > 0.0, limits.upper - q, q - limits.lower)
        most = np.minimum(limits.velocity, np.sqrt(2.0 * value.deceleration * room) - value.offset)
        return float((np.abs(v) / most).max())
    if name == "acceleration_by_velocity":
        y = np.where(np.abs(v) > 1e-9, np.sign(v), 0.0) * a  # at rest the sign is rounding
        return float(np.maximum((y + 8.0 / 3.0 * np.abs(v)) / 8.0, -y / 11.0).max())
    if name == "body_speed":
        rng, found = np.random.default_rng(4), 0.0
        t = np.linspace(0.0, motion.end, 800)
        frames = arm().frames(motion(t))
        ahead = arm().frames(motion(np.clip(t + 1e-6, 0.0, motion.end)))
        for link, first, second, radius in zip(*arm().shapes.capsules, strict=True):
            if not link:
                continue
            for end in (first, second):
                n = rng.normal(size=(400, 3))
                p = end + radius * n / np.linalg.norm(n, axis=1)[:, None]
                now, then = (f[:, link - 1, :3, :3] @ p.T + f[:, link - 1, :3, 3:] for f in (frames, ahead))
                found = max(found, float(np.linalg.norm(then - now, axis=1)[:-1].max() / 1e-6))
        return found / value
    f = specific_force(motion, np.array(value.com or (0.0, 0.0, 0.0)), 4001)
    along, across = f @ np.array(value.axis), None
    across = np.linalg.norm(np.cross(f, value.axis), axis=1)
    if name in ("open_container", "tray"):
        most = value.angle if name == "open_container" else np.arctan(min(0.3, 0.25))
        return float((np.arctan2(across, -along) / most).max())
    if name == "grip":
        return float(np.maximum(across / (2.0 * 0.4 * 14.0), np.abs(along) / 14.0).max())
    return float((across / 0.4 + along).max() / 20.0)


@pytest.mark.parametrize("name", LIMITS)
def test_the_proof_is_above_dense_values_and_close(name: str) -> None:
    free = plan(arm(), moving(name), BENT, limits=MotionLimits.of(arm(), torque=None, **BOX))
    found = peak(name, free.trajectory)
    proved = certify(arm(), moving(name), free.trajectory, MotionLimits(extra={name: LIMITS[name]})).worst(name)[0]
    assert found > 1.05, "the limit must bind for the other tests"
    assert found * (1.0 - 2e-5) <= proved <= found * (1.004 if name == "body_speed" else 1.0005)


@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("law", ["optimal", "toppra", "ruckig", "smooth", "constant_speed"])
def test_laws_respect_it(name: str, law: str) -> None:
    found = planned(name, law)
    assert found and name in found.certificate.enforced
    assert 0.95 < peak(name, found.trajectory) <= 1.0 + 2e-5
    assert found.certificate.worst(name)[0] <= 1.0


@pytest.mark.parametrize("name", LIMITS)
def test_the_optimum_is_faster_than_a_motion_slowed_as_a_whole(name: str) -> None:
    free = plan(arm(), moving(name), BENT, limits=MotionLimits.of(arm(), torque=None, **BOX))
    kind, analysis = kind_of(name), free.certificate.analysis
    slowed = kind.stretch_factor(analysis, MotionLimits(extra={name: LIMITS[name]}).bounds(6)[name])
    assert free.duration < planned(name).duration < 0.995 * slowed * free.duration
    reached = certify(arm(), moving(name), free.trajectory.stretched(slowed), MotionLimits(extra={name: LIMITS[name]}))
    assert reached.worst(name)[0] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("name", LIMITS)
def test_stops_respect_it(name: str) -> None:
    running = planned(name)
    for share in (0.2, 0.45, 0.7):
        stop = replan(running, share * running.duration, stop=True)
        assert stop and peak(name, stop.trajectory) <= 1.0 + 2e-5


@pytest.mark.parametrize("name", LIMITS)
def test_files_and_values(name: str, tmp_path: Path) -> None:
    motion = planned(name).motion
    for suffix in (".json", ".npz", ".csv"):
        save(motion, tmp_path / f"motion{suffix}")
        again = load_motion(tmp_path / f"motion{suffix}")
        assert again.limits == motion.limits and hash(again.limits) == hash(motion.limits)
    kind, limits = kind_of(name), motion.limits
    assert pickle.loads(pickle.dumps(limits)) == limits
    plain = json.loads(json.dumps(kind.to_plain(limits.value(name))))
    assert kind.from_plain(plain, 6) == limits.value(name)
    half = limits.scale(0.5, (name,))
    proofs = [certify(arm(), moving(name), motion.trajectory, x).worst(name)[0] for x in (limits, half)]
    assert proofs[1] > 1.2 * proofs[0]


def test_ratios_at_reversals_are_exact() -> None:
    """q̇ = t² − 1/3 on [−1, 1] reverses twice; deceleration turns into acceleration there."""
    import scipy

    c = np.zeros((6, 1, 6))
    c[2, 0, 0], c[3, 0, 0], c[4, 0, 0] = 1.0 / 3.0, -1.0, 2.0 / 3.0  # q̇ = t² − 2 t + 2 / 3
    motion = Trajectory(scipy.interpolate.PPoly(c, np.array([0.0, 2.0])))
    value = AccelerationByVelocity(1.5, 4.0, 2.0)
    bound = MotionLimits(extra={"acceleration_by_velocity": value}).bounds(6)["acceleration_by_velocity"]
    kind = kind_of("acceleration_by_velocity")
    from planners.certificate.analysis import MotionAnalysis

    t = np.linspace(0.0, 2.0, 2_000_001)
    v, a = t**2 - 2.0 * t + 2.0 / 3.0, 2.0 * t - 2.0
    y = np.sign(v) * a
    exact = np.maximum((y + 0.75 * np.abs(v)) / 1.5, -y / 4.0).max()
    assert kind.judge(MotionAnalysis(arm(), motion), bound).ratio[0] == pytest.approx(exact, rel=1e-6)


def test_what_stands_at_rest_is_refused_in_words() -> None:
    goal = arm().fk(BENT).copy()
    goal[:3, :3] = goal[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
    tilted = Line(arm().fk(BENT), goal)
    limits = MotionLimits.of(arm(), torque=None, **BOX, open_container=OpenContainer(0.2, UP))
    found = plan(arm(), tilted, BENT, limits=limits)
    assert not found and "the open container is tilted by" in found.failure.reason
    weak = plan(
        arm(), moving("grip"), BENT, limits=MotionLimits.of(arm(), torque=None, **BOX, grip=Grip(0.1, 10.0, 1.0, "y"))
    )
    assert not weak and "grip" in weak.failure.reason and "at rest" in weak.failure.reason


def test_an_end_where_the_limit_is_zero_is_refused_and_a_start_there_is_not() -> None:
    robot, inside = arm(), BENT.copy()
    gap = 0.2**2 / 0.6
    near = robot.limits.upper[0] - 0.5 * gap
    outer = inside.copy()
    outer[0] = near
    limits = MotionLimits.of(robot, torque=None, **BOX, velocity_by_position=LIMITS["velocity_by_position"])
    there = plan(robot, JointLine(robot, inside, outer), inside, limits=limits)
    assert not there
    assert robot.joint_names[0] in there.failure.reason and f"{robot.limits.upper[0] - gap:.6g}" in there.failure.reason
    back = plan(robot, JointLine(robot, outer, inside), outer, limits=limits)
    assert back and back.certificate.is_valid


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"grip": Grip(0.4, 40.0)}, "no mass"),
        ({"acceleration_by_velocity": AccelerationByVelocity([1.0, 2.0])}, "6 of them"),
        ({"velocity_by_position": VelocityByPosition(np.zeros(3), np.ones(3))}, "the 6 of"),
        ({"open_container": 2.0}, "below π/2"),
        ({"grip": {"friction": 0.4}}, "force missing"),
        ({"tray": {"axis": "w", "friction": 0.1}}, "three numbers"),
        ({"grip": Grip}, "a Grip"),
    ],
)
def test_misuse_is_one_line(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        plan(arm(), moving("grip"), BENT, limits=MotionLimits.of(arm(), torque=None, **BOX, **given))


def test_missing_shapes_gravity_and_velocities_are_named() -> None:
    from dataclasses import replace

    floating = replace(arm(), gravity_magnitude=0.0)
    for robot, given, words in (
        (replace(arm(), shapes=None), {"body_speed": 0.2}, "without shapes"),
        (floating, {"open_container": 0.2}, "without gravity"),
        (
            replace(arm(), limits=arm().limits.replace(velocity=None)),
            {"acceleration_by_velocity": 9.0},
            "no velocity limits",
        ),
    ):
        with pytest.raises(InvalidInput, match=words):
            make_law("optimal").need(MotionLimits(2.0, 10.0, 100.0, extra=given), robot)


def test_a_robots_own_records_are_limits() -> None:
    from dataclasses import replace

    own = JointLimits(
        arm().limits.lower, arm().limits.upper, 3.0, 8.0, 100.0, deceleration=np.full(6, 12.0),
        velocity_by_position=LIMITS["velocity_by_position"],
    )  # fmt: skip
    robot = replace(arm(), limits=own)
    limits = MotionLimits.of(robot)
    assert set(limits.extra) == {"velocity_by_position", "acceleration_by_velocity"}
    assert limits.given_names == () and (limits.acceleration == 12.0).all()
    without = MotionLimits.of(robot, velocity_by_position=None)
    assert set(without.extra) == {"acceleration_by_velocity"}
    found = plan(robot, moving("acceleration_by_velocity"), BENT)
    _, _, v, a = dense(found.trajectory)
    y = np.sign(v) * a
    assert found and y.max() <= 8.0 + 1e-6 and 8.5 < -y.min() <= 12.0 + 1e-6


def test_a_ratio_below_one_is_proved_to_be_at_most_one() -> None:
    """Bounds that are close enough may still be above 1: then a part of a valid motion would not be valid."""
    motion = MotionAnalysis(
        arm(), plan(arm(), JointLine(arm(), BENT, BENT + 0.5), BENT, limits=MotionLimits.of(arm(), **BOX)).trajectory
    )
    for most in (1.0 - 1e-6, 0.5, 1.0 + 1e-6):

        def evaluate(joints: Array, most: float = most) -> Array:
            return np.full((len(joints), 1), most)

        def enclose(first: Array, last: Array, h: Array, *_: Array) -> Array:
            return first[:, 0] * (1.0 + 9e-5 * np.minimum(h / 0.01, 1.0) ** 2)

        ratio, _ = motion.prove_peak(most, evaluate, enclose, 1e-4)
        assert most <= ratio <= (1.0 if most < 1.0 else most * (1.0 + 1e-4))


@pytest.mark.parametrize("more", [{}, pytest.param({"tilt": 0.3}, marks=pytest.mark.soak)])
def test_freedoms_of_an_arm_whose_speed_falls_towards_the_ends(more: dict[str, float]) -> None:
    robot = optik.load("fr3")
    q = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])
    goal = robot.fk(q).copy()
    goal[:3, 3] += [0.0, -0.4, -0.1]
    found = plan(robot, free(Line(robot.fk(q), goal), turn=True, **more))
    assert found and found.certificate.worst("velocity_by_position")[0] <= 1.0


def test_wrong_names_and_values_of_one_number_are_named() -> None:
    with pytest.raises(UnknownName, match="did you mean grip"):
        MotionLimits.of(arm(), gripp=1.0)
    fr3 = optik.load("fr3")
    short = MotionLimits.of(fr3, velocity_by_position={"offset": 0.1, "deceleration": 5.0})
    q = fr3.limits.middle
    with pytest.raises(InvalidInput, match="the 7 of fr3"):
        plan(fr3, JointLine(fr3, q, q + 0.1), q, limits=short)
    with pytest.raises(InvalidInput, match="a number for each joint"):
        MotionLimits.of(fr3, velocity_by_position={"offset": "x", "deceleration": 5.0})
    with pytest.raises(InvalidInput, match=r"below π/2 \[rad\]; got 2\.61799"):
        OpenContainer(np.deg2rad(150.0))


@pytest.mark.parametrize("suffix", ["json", "npz", "csv"])
def test_a_plan_of_an_arm_that_brakes_harder_is_filed(suffix: str, tmp_path: Path) -> None:
    robot = arm().with_limits(acceleration=5.0, jerk=50.0, deceleration=8.0)
    found = plan(robot, BENT + 0.2, BENT)
    save(found, tmp_path / f"a.{suffix}")
    again = load_motion(tmp_path / f"a.{suffix}")
    assert again.robot == robot and again.limits.extra == found.limits.extra
    assert (again.trajectory.coefficients == found.trajectory.coefficients).all()


@pytest.mark.filterwarnings("error")
def test_a_start_where_the_limit_by_position_is_zero_may_move_away_and_a_goal_there_is_refused_by_its_range() -> None:
    robot = optik.load("fr3")
    home = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    limits = MotionLimits.of(robot)
    for joint, end in ((1, robot.limits.lower[1]), (5, robot.limits.upper[5])):
        near = home.copy()
        near[joint] = end + 0.005 * np.sign(home[joint] - end)
        found = plan(robot, home, near, limits=limits)
        assert found and found.certificate.worst("velocity_by_position")[0] <= 1.0
        refused = plan(robot, near, home, limits=limits)
        assert refused.status == "timing_infeasible" and f"end of its range, {end:.6g} rad" in refused.failure.reason


@pytest.mark.parametrize(("friction", "slenderness"), [(0.3, None), (None, 4.0), (0.3, 4.0), (0.3, 2.0)])
def test_a_scaled_tray_has_the_scaled_angle(friction: float | None, slenderness: float | None) -> None:
    tray = Tray(friction, slenderness, UP)
    scaled = tray.scaled(0.5)
    assert scaled.largest_angle == pytest.approx(0.5 * tray.largest_angle, rel=1e-12)
    assert (scaled.friction is None, scaled.slenderness is None) == (friction is None, slenderness is None)
