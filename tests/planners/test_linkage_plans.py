"""Motions of linkages, judged by a plain evaluation of all axes; and the same arm as a linkage and without relations."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik import Scene, dynamics
from optik.arm.linkage import Linkage as Relations
from optik.errors import RobotModelError
from optik.scene.contact import find_clearances, find_pairs
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Plan, PointToPoint, certify, load_motion, plan, replan, save
from planners.cell import make_drive
from planners.certificate.path_error import path_error
from planners.certificate.torque import TorqueBounds, bound_fourths
from planners.choice.columns import joint_changes, tool_changes
from planners.choice.programme import write_torque_changes
from planners.choice.rows import pair_rooms
from tests.oracles.linkages import KINDS, Linkage

BALLS = "".join(
    f'<collision><origin xyz="{x} 0 0.05"/><geometry><sphere radius="0.05"/></geometry></collision>'
    for x in (0.0, 0.04)
)


def robot_of(linkage: Linkage, *, shapes: bool = False) -> optik.Robot:
    text = linkage.urdf()
    if shapes:
        text = text.replace("</inertial>", "</inertial>" + BALLS)
    robot = optik.Robot.from_urdf(text, "tool0", shapes=shapes)
    return robot.with_limits(acceleration=8.0, jerk=80.0)


def states(found: Plan, linkage: Linkage, count: int = 601) -> tuple[Array, Array, Array]:
    """Return times, all axes (k, N) and the tool's points (k, 3) of a motion."""
    t = np.linspace(0.0, found.duration, count)
    rows = [dict(zip(found.robot.joint_names, q.tolist(), strict=True)) for q in found.trajectory(t)]
    return t, np.array([linkage.values(q) for q in rows]), np.array([linkage.fk(q)[:3, 3] for q in rows])


@cache
def planned(kind: str) -> Plan:
    robot = robot_of(KINDS[kind])
    start, goal = robot.limits.middle, robot.limits.sample(np.random.default_rng(8), 1)[0]
    found = plan(robot, JointLine(robot, start, 0.3 * start + 0.7 * goal), start)
    assert found, str(found)
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_every_axis_keeps_its_range_and_its_speed(kind: str) -> None:
    found, linkage = planned(kind), KINDS[kind]
    t, x, p = states(found, linkage)
    speed = np.abs(np.diff(x, axis=0)) / t[1]
    for i, axis in enumerate(linkage.axes):
        assert axis.span[0] - 1e-9 <= x[:, i].min() and x[:, i].max() <= axis.span[1] + 1e-9
        assert speed[:, i].max() <= axis.speed * (1.0 + 1e-6)
    assert (np.linalg.norm(np.diff(p, axis=0), axis=1) / t[1]).max() <= found.certificate.tool_speed.value * (
        1.0 + 1e-6
    )
    assert found.certificate.path_error.distance < 1e-9 and found.certificate.worst("torque")[0] <= 1.0
    load = found.trajectory(t), found.trajectory(t, 1), found.trajectory(t, 2)
    most = found.robot.limits.torque
    torque, proved = (np.abs(found.robot.torques(*load)) / most).max(axis=0), found.certificate.torque.ratio
    assert (torque <= proved * (1.0 + 1e-9)).all()  # the proof has Coulomb friction on both sides at rest
    assert (proved <= 1.02 * torque + found.robot.loads[0].coulomb / most + 1e-4).all()


@pytest.mark.parametrize(
    "kind",
    [
        "inclined wrist",
        "half",
        *(pytest.param(x, marks=pytest.mark.soak) for x in ("telescope", "mimic of a mimic", "two slow followers")),
    ],
)
def test_lines_are_followed_and_proved(kind: str) -> None:
    linkage, robot = KINDS[kind], robot_of(KINDS[kind])
    q = robot.limits.clip(robot.limits.middle + np.array([0.2, 0.3, 0.4, 0.3, 0.6, -0.2, 0.2])[: robot.n])
    start = robot.fk(q)
    goal = optik.se3.pose(start[:3, :3], start[:3, 3] + np.array([0.03, 0.05, -0.06]))
    found = plan(robot, Line(start, goal), q)
    assert found and found.certificate, str(found)
    p = states(found, linkage)[2]
    along = goal[:3, 3] - start[:3, 3]
    away = np.linalg.norm(np.cross(p - start[:3, 3], along / np.linalg.norm(along)), axis=1).max()
    bound = found.certificate.path_error.distance
    assert away <= bound + 1e-12 and bound < 1e-5
    stop = replan(found, 0.4 * found.duration, stop=True)
    assert stop and stop.certificate.worst("velocity")[0] <= 1.0


def test_a_torque_limit_binds_at_the_joints() -> None:
    found = planned("inclined wrist")
    peak = found.certificate.torque
    i = int(np.argmax(peak.ratio))
    most = np.array(found.robot.limits.torque)
    still = np.abs(found.robot.gravity_torques(found.trajectory(np.linspace(0.0, found.duration, 50))))[:, i].max()
    most[i] = max(1.2 * still, 0.8 * peak.ratio[i] * most[i])
    slower = plan(found.robot, found.path, found.trajectory(0.0), limits=MotionLimits.of(found.robot, torque=most))
    assert slower and slower.duration >= found.duration and slower.certificate.worst("torque")[0] <= 1.0
    t = np.linspace(0.0, slower.duration, 4001)
    torque = np.abs(slower.robot.torques(slower.trajectory(t), slower.trajectory(t, 1), slower.trajectory(t, 2))) / most
    assert 0.97 <= torque.max() <= 1.0 + 1e-9


def test_files_and_messages_list_the_driving_joints(tmp_path: Path) -> None:
    for kind in ("level palletiser", "driver beside"):
        found = planned(kind)
        for suffix in (".json", ".npz", ".csv"):
            save(found, tmp_path / f"a{suffix}")
            again = load_motion(tmp_path / f"a{suffix}")
            assert again.robot == found.robot
            assert (again.trajectory.coefficients == found.trajectory.coefficients).all()
        planners.to_ros(found, tmp_path / "a.yaml")
        lines = (tmp_path / "a.yaml").read_text().splitlines()
        at = lines.index("joint_names:") + 1
        assert [line.strip('- "') for line in lines[at : at + found.robot.n]] == [*found.robot.joint_names]
        read = planners.load_trajectory(tmp_path / "a.yaml", found.robot)
        t = np.linspace(0.0, min(read.end, found.duration), 300)
        np.testing.assert_allclose(read(t), found.trajectory(t), atol=1e-7)


def test_drives_execute_the_driving_joints_and_mujoco_is_refused() -> None:
    found = planned("level palletiser")
    execution = make_drive("ideal", found.robot).execute(found)
    assert execution
    np.testing.assert_allclose(execution.q[-1], found.trajectory(found.duration), atol=1e-9)
    pytest.importorskip("mujoco")
    with pytest.raises(RobotModelError, match="a linkage"):
        make_drive("mujoco", found.robot)


def test_a_running_motion_is_led_elsewhere() -> None:
    found, linkage = planned("two slow followers"), KINDS["two slow followers"]
    goal = found.robot.limits.clip(found.trajectory(0.5 * found.duration) + 0.2)
    new = planners.retarget(found, 0.3 * found.duration, goal)
    assert new, new.reason
    t = np.linspace(0.0, new.trajectory.end, 4001)
    rates = np.abs(new.trajectory(t, 1)).max(axis=0)
    for name, rate in zip(found.robot.joint_names, rates, strict=True):
        assert rate <= linkage.span(name, 1)[1] * (1.0 + 1e-6)


# ---------------------------------------------------------------- the same arm, with and without relations


@cache
def twins() -> tuple[optik.Robot, optik.Robot]:
    """An arm, and the same one whose joints 2, 3 and 5 are axes that turn the other way, the third with an offset."""
    plain = robot_of(Linkage([axis for axis in KINDS["inclined wrist"].axes if axis.name != "j5b"]), shapes=True)
    factor, offset = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0]), np.array([0.0, 0.0, 0.25, 0.0, 0.0, 0.0])
    flip, fixed, tool = np.diag([1.0, -1.0, -1.0, 1.0]), np.array(plain.fixed), plain.tool
    back = [np.eye(4)] * 6
    for i in range(6):  # x about the flipped axis is −q: Rot(z, q) = flip · Rot(z, −q) · flip
        if factor[i] < 0.0:
            turn = optik.se3.pose(optik.se3.exp_so3([0.0, 0.0, -offset[i]]))
            fixed[i], back[i] = fixed[i] @ flip @ turn, flip
    fixed[1:] = [T @ F for T, F in zip(back, fixed[1:], strict=False)]
    relations = Relations(np.arange(6), factor, offset, plain.prismatic, tuple(f"a{i}" for i in range(6)))
    inertia = plain.inertia.transform(back)
    shapes = plain.shapes
    for i in range(6):
        shapes = shapes.transform_part(i + 1, back[i])
    other = replace(plain, fixed=fixed, tool=back[5] @ tool, linkage=relations, inertia=inertia, shapes=shapes)
    return plain, other


def test_the_twins_are_the_same_arm() -> None:
    plain, other = twins()
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 20, 6))
    np.testing.assert_allclose(other.fk(q), plain.fk(q), atol=1e-14)
    np.testing.assert_allclose(other.jacobian(q), plain.jacobian(q), atol=1e-14)
    np.testing.assert_allclose(other.torques(q, dq, ddq), plain.torques(q, dq, ddq), atol=1e-12)
    np.testing.assert_allclose(other.mass_matrix(q), plain.mass_matrix(q), atol=1e-13)
    scene = Scene(spheres=[((0.6, 0.3, 0.9), 0.1)])
    np.testing.assert_allclose(*(find_clearances(arm, scene, q)[0] for arm in (plain, other)), atol=1e-13)


def test_certificates_of_the_twins_are_equal() -> None:
    plain = twins()[0]
    q = np.array([0.2, 0.3, 0.4, 0.3, 0.6, -0.2])
    start = plain.fk(q)
    line = Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + [0.05, 0.08, -0.06]))
    found = plan(plain, line, q)
    scene, pairs = Scene(spheres=[((0.6, 0.5, 0.9), 0.1)]), []
    for arm in twins():
        limits = MotionLimits.of(arm, body_speed=1.0, tray={"slenderness": 3.0, "friction": 0.6}, torque_rate=4000.0)
        joint = certify(
            arm, JointLine(arm, q, q + 0.3), plan(plain, JointLine(plain, q, q + 0.3), q).trajectory, limits
        )
        pairs.append((certify(arm, line, found.trajectory, limits, scene=scene), joint))
    for one, same in zip(*pairs, strict=True):
        assert same.path_error[:2] == pytest.approx(one.path_error[:2], rel=1e-3, abs=1e-12)
        for name in ("velocity", "torque", "torque_rate", "tool_speed", "rotation_speed", *one.extra):
            x, y = (proof.extreme(name) for proof in (same, one))
            np.testing.assert_allclose(x.ratio, y.ratio, rtol=1e-3, atol=1e-9, err_msg=name)
            np.testing.assert_allclose(x.value, y.value, rtol=1e-3, atol=1e-9, err_msg=name)
        assert same.extra.keys() == one.extra.keys() and len(one.extra) == 2
    assert pairs[1][0].clearance.scene.value == pytest.approx(pairs[0][0].clearance.scene.value, rel=1e-3)


@pytest.mark.parametrize("kind", ["inclined wrist", "half", "mimic of a mimic"])
def test_derivatives_for_the_choice_of_paths_are_differences(kind: str) -> None:
    robot, rng, h = robot_of(KINDS[kind], shapes=True), np.random.default_rng(3), 1e-6
    path, n = 0.4 * rng.normal(size=(4, 3, robot.n)), robot.n
    load, out = robot.loads[0], np.empty((3, 6, n, n, 4))
    write_torque_changes(robot, load.bodies, path, out)
    twist, change = np.empty((3, 6)), np.empty((3, 6, n, 2))
    tool_changes(robot.chain, path, twist, change)
    np.testing.assert_allclose(twist, np.einsum("kin,kn->ki", robot.jacobian(path[0]), path[1]), atol=1e-12)
    scene = Scene(spheres=[((0.6, 0.5, 0.9), 0.1)])
    pairs = find_pairs(robot, scene)
    bodies = (robot.shapes.capsules, scene.arrays, pairs.bodies, pairs.hulls)
    slots = np.tile(np.arange(len(pairs.bodies)), (3, 1))

    def rooms(q: Array) -> Array:
        room = np.empty(slots.shape)
        pair_rooms(robot.chain, bodies, np.ascontiguousarray(q), 0.0, slots, room, np.empty((0, len(pairs.bodies), n)))
        return room

    slope = np.empty((*slots.shape, n))
    pair_rooms(robot.chain, bodies, path[0], 0.0, slots, np.empty(slots.shape), slope)

    def torques(x: Array) -> Array:
        found = np.empty((3, 6, n))
        dynamics.path_torques(robot.chain, load.bodies, np.ascontiguousarray(x), found)
        return found

    for j in range(n):
        for order in range(4):
            step = np.zeros_like(path)
            step[order, :, j] = h
            slopes = (torques(path + step) - torques(path - step)) / (2.0 * h)
            np.testing.assert_allclose(out[..., j, order], slopes, atol=1e-6 * max(1.0, float(np.abs(slopes).max())))
            if order < 2:
                J = [np.einsum("kin,kn->ki", robot.jacobian(x[0]), x[1]) for x in (path + step, path - step)]
                np.testing.assert_allclose(change[..., j, order], (J[0] - J[1]) / (2.0 * h), atol=1e-8)
        away = h * np.eye(n)[j]
        np.testing.assert_allclose(
            slope[..., j], (rooms(path[0] + away) - rooms(path[0] - away)) / (2.0 * h), atol=1e-6
        )
    if n == 6:  # J h = field, and its derivatives along the path
        fields, joints = np.zeros((3, 1, 4, 6)), np.empty((3, 4, 1, 6))
        fields[:, 0, 0] = rng.normal(size=6)
        joint_changes(robot.chain, np.empty((0, 6)), fields, path, joints)
        at = robot.fk(path[0])[:, :3, 3]
        w, v = fields[:, 0, 0, :3], fields[:, 0, 0, 3:]  # about the base's origin
        moved = np.einsum("kin,kn->ki", robot.jacobian(path[0]), joints[:, 0, 0])
        np.testing.assert_allclose(moved, np.concatenate([v + np.cross(w, at), w], axis=1), atol=1e-9)


@pytest.mark.soak
def test_searches_and_freedoms_of_linkages() -> None:
    robot, rng = robot_of(KINDS["inclined wrist"], shapes=True), np.random.default_rng(2)
    links = range(1, 8)
    apart = robot.shapes.with_apart([(a, b, "small") for a in links for b in links if a < b])
    robot, scene = robot.with_shapes(apart), Scene(margin=0.01, spheres=[((0.7, 0.0, 0.9), 0.15)])
    free_ones = [q for q in robot.limits.sample(rng, 40) if find_clearances(robot, scene, q[None])[0].min() > 0.05][:6]
    ways = 0
    for first, last in zip(free_ones[::2], free_ones[1::2], strict=True):
        found = planners.find_path(robot, first, last, scene=scene, max_samples=4000)
        for way in found.paths:
            ways += 1
            q = np.concatenate([a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a) for a, b in itertools.pairwise(way)])
            assert find_clearances(robot, scene, q)[0].min() > 0.01
    assert ways
    around = plan(robot, free_ones[1], free_ones[0], scene=scene, avoid=True)
    assert around and around.certificate, str(around)
    q = np.array([0.2, 0.3, 0.4, 0.3, 0.6, -0.2])
    start = robot.fk(q)
    line = Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + [0.1, 0.2, -0.1]))
    given, turned = plan(robot, line, q), plan(robot, planners.free(line, turn=0.6), q)
    assert given and turned and turned.duration <= given.duration * (1.0 + 1e-6)
    straight, bent = plan(robot, JointLine(robot, q, -q), q), plan(robot, PointToPoint(robot, q, -q), q)
    assert straight and bent and bent.duration <= straight.duration * (1.0 + 1e-6)


def test_fourth_derivatives_of_torques_are_below_their_bounds() -> None:
    robot, rng = robot_of(KINDS["mimic of a mimic"]), np.random.default_rng(9)
    for h in (0.02, 0.3):
        joints = rng.normal(size=(1, 6, robot.n)) / h ** np.arange(6.0)[:, None]
        bounds = TorqueBounds(robot, np.array([0.0, h]), joints, joints)
        out = bound_fourths(bounds.models[0], np.array([h]), joints)
        t = 0.5 * h * (1.0 + np.cos(np.pi * (np.arange(60) + 0.5) / 60))
        powers = t[:, None] ** np.arange(6) / np.cumprod([1.0, 1.0, 2.0, 3.0, 4.0, 5.0])
        states = [powers[:, : 6 - k] @ joints[0, k:] for k in range(3)]
        smooth = robot.with_inertia(coulomb=np.zeros(len(robot.fixed)))
        for i, torque in enumerate(smooth.torques(*states).T):
            fitted = np.polynomial.Chebyshev.fit(t, torque, 40, domain=[0.0, h])
            truth = np.abs(fitted.deriv(4)(np.linspace(0.1 * h, 0.9 * h, 50))).max()
            assert truth <= out[0, i], (h, i)


def test_errors_of_curved_joint_paths_are_those_of_the_twin() -> None:
    plain = twins()[0]
    q = np.array([0.2, 0.3, 0.4, 0.3, 0.6, -0.2])
    found, errors = plan(plain, PointToPoint(plain, q, -q), q), list[float]()
    shifts = 0.05 * np.random.default_rng(4).normal(size=found.path.coefficients.shape)
    shifts[[0, 1, 2, -3, -2, -1]] = 0.0
    for arm in twins():
        for share in (0.0, 1.0):  # on the path the bound is that of its remainder
            path = PointToPoint(arm, q, -q).with_coefficients(found.path.coefficients + share * shifts)
            errors += certify(arm, path, found.trajectory, MotionLimits.of(arm)).path_error[:2]
    assert errors[4:] == pytest.approx(errors[:4], rel=1e-3, abs=0.0) and errors[2] > 1e-4 > errors[0]


def test_remainders_on_curved_joint_paths_are_those_of_the_twin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planners.certificate.path_error.NARROWEST_SHARE", 1e9)  # so no interval is divided

    def leave_to_joints(*given: Any) -> None:
        given[-2][:], given[-1][:] = np.inf, 0.0

    monkeypatch.setattr("planners.certificate.path_error.intervals", leave_to_joints)
    q, errors = np.array([0.2, 0.3, 0.4, 0.3, 0.6, -0.2]), list[float]()
    found = plan(twins()[0], PointToPoint(twins()[0], q, -q), q)
    shifts = 0.05 * np.random.default_rng(4).normal(size=found.path.coefficients.shape)
    shifts[[0, 1, 2, -3, -2, -1]] = 0.0
    for arm in twins():
        path = PointToPoint(arm, q, -q).with_coefficients(found.path.coefficients + shifts)
        errors += path_error(arm, path, found.trajectory)[0][:2]
    assert errors[2:] == pytest.approx(errors[:2], rel=1e-6)
