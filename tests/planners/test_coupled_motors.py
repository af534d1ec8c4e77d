"""Motions of arms with coupled motors, judged by formulas of their own."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import optik
import planners
from optik import Scene
from optik.errors import AssumptionWarning, InvalidInput, NoSolution
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Plan, PointToPoint, certify, load_trajectory, plan, save
from planners.files.base import from_plain, to_plain
from planners.limits._combination import Combination
from planners.search.rrt_connect import RRTConnect
from tests.optik.test_motors import MATRICES, NAMES, palletiser

BENT = np.array([0.3, -0.5, 0.6, -0.4, 0.5, 0.2])
TURN = np.array([1.0, -0.7, 0.8, 0.9, -1.0, 1.1])


def arm(C: Array) -> optik.Robot:
    plain = optik.load("puma560").with_payload(2.0)
    torque = 1.3 * plain.limits.torque  # the random matrix lets gravity act on the small motors of the wrist
    return plain.with_limits(
        velocity=2.5, acceleration=15.0, jerk=150.0, torque=torque, torque_rate=3000.0
    ).with_motors(C, names=NAMES)


def planned(name: str, law: str = "optimal") -> Plan:
    robot = arm(MATRICES[name])
    start, goal = robot.limits.clip(BENT), robot.limits.clip(BENT + TURN)
    return plan(robot, JointLine(robot, start, goal), start, timing=law, allow="jerk")


def motor_torques(found: Plan, count: int = 20_001) -> tuple[Array, Array]:
    """τ_m = Cᵀ τ_q + I m̈ + friction, and its rate by differences."""
    robot, motion = found.robot, found.trajectory
    motors, t = robot.motors, np.linspace(0.0, motion.end, count)
    E = np.linalg.inv(motors.matrix)
    v, a = motion(t, 1) @ E.T, motion(t, 2) @ E.T
    smooth = (
        robot.torques(motion(t), motion(t, 1), motion(t, 2)) @ motors.matrix + motors.inertia * a + motors.viscous * v
    )
    sign = np.where(np.abs(v) > 1e-9, np.sign(v), np.sign(smooth))  # at rest either sign
    return smooth + motors.coulomb * sign, np.diff(smooth, axis=0) / np.diff(t)[:, None]


@pytest.mark.parametrize("law", ["optimal", "toppra", "ruckig", "smooth"])
@pytest.mark.parametrize("name", MATRICES)
def test_motors_are_within_their_limits(name: str, law: str) -> None:
    found = planned(name, law)
    assert found
    motors, motion = found.robot.motors, found.trajectory
    t, E = np.linspace(0.0, motion.end, 20_001), np.linalg.inv(motors.matrix)
    orders = {"velocity": 1, "acceleration": 2, "jerk": 3}
    peaks = {
        field: float((np.abs(motion(t, k) @ E.T) / getattr(motors.limits, field)).max()) for field, k in orders.items()
    }
    torque, rate = motor_torques(found)
    peaks["torque"] = float((np.abs(torque) / motors.limits.torque).max())
    peaks["torque_rate"] = float((np.abs(rate) / motors.limits.torque_rate).max())
    for field, peak in peaks.items():
        if field in ("jerk", "torque_rate") and law == "toppra":
            continue
        proved = found.certificate.worst(f"motor_{field}")
        assert peak <= 1.0 + 1e-6 and peak <= proved[0] * (1.0 + 1e-6)
        assert proved[1] in NAMES
        if field != "torque_rate":  # whose differences pass over its steps
            assert proved[0] <= peak * 1.02 + 1e-3
    assert (
        max(found.certificate.worst(field)[0] for field in found.certificate.enforced if field in found.limits.extra)
        > 0.97
    )


def test_the_torque_that_binds_is_met() -> None:
    robot = arm(MATRICES["joints 2 and 3"])
    limits = MotionLimits.of(robot)
    free = planned("joints 2 and 3")
    torque, _ = motor_torques(free)
    least = np.abs(
        robot.gravity_torques(free.trajectory(np.linspace(0.0, free.duration, 200))) @ robot.motors.matrix
    ).max(axis=0)
    most = (
        least
        + robot.motors.coulomb
        + 0.75 * np.maximum(np.abs(torque).max(axis=0) - least - robot.motors.coulomb, 0.05)
    )
    tight = robot.motors.matrix.T
    given = Combination(tight, most, NAMES)
    found = plan(robot, free.path, free.trajectory(0.0), limits=MotionLimits.of(robot, motor_torque=given))
    assert found and found.duration > free.duration * 1.01
    torque, _ = motor_torques(found)
    assert 0.95 < (np.abs(torque) / most).max() <= 1.0 + 1e-6
    assert limits.value("motor_torque").names == NAMES


def test_the_range_of_a_motor_is_judged_exactly() -> None:
    robot = arm(MATRICES["joints 2 and 3"])
    middle = robot.motors.of(robot.limits.middle)
    m = middle.copy()
    m[2] = robot.motors.limits.upper[2] + 0.02
    start, plain = robot.motors.axes(middle), replace(robot, motors=None)
    wide = plain.with_limits(lower=np.full(6, -9.0), upper=np.full(6, 9.0))
    far = JointLine(wide, start, robot.motors.axes(m))
    motion = plan(wide, far, start, allow="limits")
    proof = certify(robot, far, motion.trajectory)
    assert any("M3 exceeds its range by 0.02" in words for words in proof.reasons)


def test_files_and_messages_have_the_makers_joints(tmp_path: Path) -> None:
    found = planned("differential wrist")
    robot = found.robot
    for suffix in (".json", ".npz", ".csv"):
        save(found, tmp_path / f"a{suffix}")
        again = planners.load_motion(tmp_path / f"a{suffix}")
        assert again.robot == robot and (again.trajectory.coefficients == found.trajectory.coefficients).all()
    rows = [row for row in csv.reader((tmp_path / "a.csv").read_text().splitlines()) if not row[0].startswith("#")]
    assert rows[0][1:7] == [f"q_{name}" for name in NAMES]
    table = np.array(rows[1:], dtype=float)
    np.testing.assert_allclose(table[:, 1:7], robot.motors.of(found.trajectory(table[:, 0])), atol=1e-12)
    planners.to_ros(found, tmp_path / "a.yaml")
    with pytest.warns(AssumptionWarning, match="positions are those of the motors .*, with the matrix of"):
        read = load_trajectory(tmp_path / "a.yaml", robot)
    t = np.linspace(0.0, min(read.end, found.duration), 300)
    np.testing.assert_allclose(read(t), found.trajectory(t), atol=1e-7)


@pytest.mark.parametrize(("suffix", "rate"), [(".json", None), (".csv", None), (".csv", 100.0)])
def test_a_motion_file_is_refused_for_another_matrix(suffix: str, rate: float | None, tmp_path: Path) -> None:
    found = planned("differential wrist")
    save(found, file := tmp_path / f"a{suffix}", rate=rate)
    read = load_trajectory(file, found.robot)
    np.testing.assert_allclose(read(read.end), found.trajectory(found.duration), atol=1e-9)
    other, shifted = arm(MATRICES["random"]), replace(found.robot.motors, offset=found.robot.motors.offset + 0.1)
    plain = replace(optik.load("puma560"), joint_names=found.robot.joint_names)
    for wrong in (other, plain, optik.load("puma560").with_motors(shifted.matrix, offset=shifted.offset, names=NAMES)):
        with pytest.raises(
            InvalidInput, match=r"motors: expected those of .*; got motors with other names, matrix or offsets"
        ):
            load_trajectory(file, wrong)
    with pytest.raises(InvalidInput, match=r"^unit: expected no unit=, because .* states its units"):
        load_trajectory(file, found.robot, unit="deg")


def test_a_motion_of_another_matrix_is_refused(tmp_path: Path) -> None:
    data = to_plain(planned("differential wrist").motion)
    data["robot"]["motors"]["matrix"][4][4] = 0.6
    with pytest.raises(InvalidInput):
        from_plain(data)


def test_stops() -> None:
    found = planned("random")
    stop = planners.replan(found, 0.4 * found.duration, stop=True)
    assert stop and stop.certificate.worst("motor_acceleration")[0] <= 1.0


def test_a_path_is_followed_up_to_where_a_motor_ends() -> None:
    """Beyond the ranges of the motors, although every axis alone is inside its own."""
    robot = arm(MATRICES["joints 2 and 3"])
    m = robot.motors.limits.middle.copy()
    m[2], m[3], m[4] = robot.motors.limits.upper[2] - 0.02, 0.4, 0.6
    q = robot.motors.axes(m)
    over = q.copy()
    over[2] += 0.1
    assert (robot.limits.lower < over).all() and (over < robot.limits.upper).all()
    assert not robot.limits.contains(over)
    found = plan(robot, Line(robot.fk(q), robot.fk(over)), q)
    assert not found and "M3 reaches the end of its range" in found.failure.reason
    with pytest.raises(InvalidInput, match=r"M3 = .* rad"):
        JointLine(robot, q, over)


@pytest.mark.parametrize(
    "name", ["differential wrist", *(pytest.param(x, marks=pytest.mark.soak) for x in ("random", "joints 2 and 3"))]
)
def test_searches_and_freedoms_stay_inside_the_ranges_of_the_motors(name: str) -> None:
    robot, rng, found = optik.load("ur5e").with_motors(MATRICES[name], names=NAMES), np.random.default_rng(4), 0
    ends = robot.limits.sample(rng, 16)
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        try:
            ways = planners.find_path(
                robot, first, last, scene=Scene(spheres=[((0.4, 0.2, 0.3), 0.1)]), max_samples=3000
            )
        except NoSolution:  # an end in contact
            continue
        for way in ways.paths:
            found += 1
            assert robot.limits.contains(way).all()
    assert found
    bent = robot.limits.clip(np.array([0.3, -1.2, 1.4, -1.6, -1.4, 0.3]))
    goal = robot.fk(bent).copy()
    goal[:3, 3] += [0.1, 0.1, 0.05]
    limits = MotionLimits.of(robot, acceleration=10.0, jerk=100.0)
    turned = plan(robot, planners.free(Line(robot.fk(bent), goal), turn=True, tilt=0.2), limits=limits)
    assert turned and turned.certificate.position_margin.min() >= 0.0


def test_shapes_are_chosen_beside_limits_of_motors() -> None:
    robot = arm(MATRICES["joints 2 and 3"])
    start, goal = robot.limits.clip(BENT), robot.limits.clip(BENT + TURN)
    found = plan(robot, PointToPoint(robot, start, goal), allow="jerk")
    assert found and found.freedom.unknown
    plain, none = replace(robot, motors=None), dict.fromkeys(MotionLimits.of(robot).extra)
    usual = plan(plain, PointToPoint(plain, start, goal), allow="jerk")
    wide = Combination(np.eye(6), np.full(6, 1e6), NAMES)
    beside = {"motor_velocity": wide, "motor_acceleration": wide, "motor_jerk": wide}
    again = plan(plain, PointToPoint(plain, start, goal), limits=MotionLimits.of(plain, **none | beside), allow="jerk")
    assert again.freedom.gradient == pytest.approx(usual.freedom.gradient, rel=1e-3)


def test_a_new_target_keeps_the_limits_of_motors_or_names_one() -> None:
    found, joined, kept = planned("random"), 0, set()
    rng, robot = np.random.default_rng(6), found.robot
    E, b = np.linalg.inv(robot.motors.matrix), robot.motors.limits
    limits = MotionLimits.of(robot, torque=None, torque_rate=None, motor_torque=None, motor_torque_rate=None)
    for at in np.linspace(0.1, 0.6, 12) * found.duration:
        goal = robot.limits.clip(found.trajectory(at) + 0.3 * rng.uniform(-1.0, 1.0, 6))
        new = planners.retarget(found, float(at), goal, limits=limits)
        if not new:
            kept.add(new.reason)
            continue
        joined += 1
        t = np.linspace(0.0, new.trajectory.end, 5001)
        for order, most in ((1, b.velocity), (2, b.acceleration), (3, b.jerk)):
            assert (np.abs(new.trajectory(t, order) @ E.T) <= most * (1.0 + 1e-6)).all()
    assert joined >= 7
    assert all(any(name in reason for name in NAMES) for reason in kept)


def test_a_goal_is_reached_in_the_winding_that_the_motors_reach() -> None:
    """An axis without limits is not unwound if a motor that moves it has limits."""
    plain = optik.load("ur5e")
    lower, upper = plain.limits.lower.copy(), plain.limits.upper.copy()
    lower[5], upper[5], lower[4], upper[4] = -np.inf, np.inf, -2.0, 2.0
    limits = {"lower": lower, "upper": upper, "velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}
    for matrix, turns in ((MATRICES["differential wrist"], False), (MATRICES["joints 2 and 3"], True)):
        robot = plain.with_limits(**limits).with_motors(matrix)
        start = robot.motors.axes([0.0, -1.3, 1.3, 0.0, 0.0, 0.0])
        goal = robot.motors.axes([0.1, -1.2, 1.2, 0.1, 1.9, 6.0])
        found = plan(robot, goal, start)
        assert found and (np.abs(found.trajectory(found.duration)[5] - goal[5]) > 6.0) == turns
        exact = plan(robot, goal, start, winding="exact")
        np.testing.assert_allclose(exact.trajectory(exact.duration), goal, atol=1e-9)


@pytest.mark.parametrize("bound", [None, "x", [None], {}])
def test_wrong_bounds_of_combinations_are_named(bound: object) -> None:
    with pytest.raises(InvalidInput, match="a number above 0 for each row"):
        MotionLimits.of(optik.load("ur5e"), motor_velocity={"matrix": [[0, 1, 1, 0, 0, 0]], "bound": bound})


def test_searches_that_begin_anew_stay_inside_the_ranges_of_the_motors() -> None:
    robot, rng, found = optik.load("ur5e").with_motors(MATRICES["random"], names=NAMES), np.random.default_rng(1), 0
    for _ in range(25):
        first, last = robot.limits.sample(rng, 2)
        balls = [(rng.uniform((-0.6, -0.6, -0.2), (0.6, 0.6, 1.0)), 0.12) for _ in range(6)]
        search = RRTConnect(max_samples=3000, restart=20)
        try:
            ways = planners.find_path(robot, first, last, scene=Scene(spheres=balls), search=search)
        except NoSolution:  # an end in contact
            continue
        found += len(ways.paths)
        assert all(robot.limits.contains(way).all() for way in ways.paths)
    assert found


def test_ranges_of_axes_beside_those_of_the_motors_are_kept_and_named() -> None:
    robot = palletiser()
    q = np.array([0.1, -0.5, 0.8, -1.0, 0.5, 0.2])
    inside, beyond = q + np.array([0.3, 0.2, 0.6, 0.0, 0.0, 0.0]), q + np.array([0.0, -0.6, -0.6, 0.0, 0.0, 0.0])
    found = plan(robot, JointLine(robot, q, inside), q)
    assert found and found.certificate.position_margin.shape == (7,)  # six motors, and joint 3
    t = np.linspace(0.0, found.duration, 2001)
    x = found.trajectory(t)[:, 2]
    assert found.certificate.position_margin[6] == pytest.approx(min(x.min() - 0.4, 2.3 - x.max()), abs=1e-6)
    wide = robot.with_limits(lower=robot.motors.limit_axes().lower, upper=robot.motors.limit_axes().upper)
    failed = plan(robot, JointLine(wide, q, beyond), q)
    assert not failed and "joint3 leaves its range [0.4, 2.3] rad" in str(failed)
    proof = certify(robot, None, plan(wide, JointLine(wide, q, beyond), q).trajectory, MotionLimits.of(robot))
    assert "joint3 exceeds its range by 0.2 " in proof.violations[0].words
