"""Linkages: axes of a chain that follow joints (<mimic>), against a plain evaluation and Pinocchio; files and refusals."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

import optik
from optik.arm.mjcf_writer import to_mjcf
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array
from tests.oracles.linkages import KINDS, Linkage


def order(robot: optik.Robot, q: Array) -> dict[str, float]:
    return dict(zip(robot.joint_names, q.tolist(), strict=True))


@pytest.mark.parametrize("linkage", KINDS.values(), ids=KINDS)
def test_kinematics_are_those_of_a_plain_evaluation(linkage: Linkage) -> None:
    robot = optik.Robot.from_urdf(linkage.urdf(), "tool0")
    assert sorted(robot.joint_names) == sorted(linkage.drivers) and robot.n == len(linkage.drivers)
    q = robot.limits.sample(np.random.default_rng(1), 40)
    np.testing.assert_allclose(robot.fk(q), [linkage.fk(order(robot, x)) for x in q], rtol=0.0, atol=1e-12)
    h = 1e-6
    for x in q[:3]:
        slope = np.array([(robot.fk(x + h * e) - robot.fk(x - h * e)) / (2.0 * h) for e in np.eye(robot.n)])
        spin = slope[:, :3, :3] @ robot.fk(x)[:3, :3].T
        J = np.concatenate([slope[:, :3, 3], np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)], axis=1)
        np.testing.assert_allclose(robot.jacobian(x), J.T, atol=1e-8)
    assert robot.frames(q).shape == (40, len(linkage.axes) + 1, 4, 4)


@pytest.mark.parametrize("linkage", KINDS.values(), ids=KINDS)
def test_limits_of_followers_apply_to_what_they_follow(linkage: Linkage) -> None:
    robot = optik.Robot.from_urdf(linkage.urdf(), "tool0")
    for i, name in enumerate(robot.joint_names):
        low, high = linkage.span(name, 0)
        assert (robot.limits.lower[i], robot.limits.upper[i]) == pytest.approx((low, high), abs=1e-15)
        assert robot.limits.velocity[i] == pytest.approx(linkage.span(name, 1)[1], abs=1e-15)
        own = next(axis for axis in (*linkage.axes, *linkage.beside) if axis.name == name)
        assert robot.limits.torque[i] == own.effort


@pytest.mark.parametrize("linkage", KINDS.values(), ids=KINDS)
def test_torques_are_those_of_all_axes_at_the_joints(linkage: Linkage) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(linkage.urdf(mimic=False))
    data, robot, rng = model.createData(), optik.Robot.from_urdf(linkage.urdf(), "tool0"), np.random.default_rng(2)
    M = np.array([[(linkage.relation(axis.name)[0] == name) * linkage.relation(axis.name)[1] for name in robot.joint_names]
                  for axis in linkage.axes])  # fmt: skip
    k = np.arange(len(linkage.axes))
    for q in robot.limits.sample(rng, 10):
        dq, ddq = rng.normal(size=(2, robot.n))
        x, dx, ddx = np.array(linkage.values(order(robot, q))), M @ dq, M @ ddq
        torque = pinocchio.rnea(model, data, x, dx, ddx)
        torque += (0.3 + 0.1 * k) * dx + (0.2 + 0.05 * k) * np.sign(dx)
        down = robot.gravity_magnitude / 9.81
        still = pinocchio.rnea(model, data, x, 0.0 * dx, 0.0 * dx) * (down - 1.0)  # another free fall
        np.testing.assert_allclose(robot.torques(q, dq, ddq), M.T @ (torque + still), rtol=1e-9, atol=1e-9)
        H = np.array(pinocchio.crba(model, data, x))
        np.testing.assert_allclose(robot.mass_matrix(q), M.T @ H @ M, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("linkage", KINDS.values(), ids=KINDS)
def test_files_hold_the_relations(linkage: Linkage) -> None:
    robot = optik.Robot.from_urdf(linkage.urdf(), "tool0")
    again = optik.Robot.from_dict(json.loads(json.dumps(robot.to_dict())))
    assert again == robot == pickle.loads(pickle.dumps(robot)) and again.fingerprint == robot.fingerprint
    copy = optik.Robot.from_urdf(robot.to_urdf(), "tool")
    assert sorted(copy.joint_names) == sorted(robot.joint_names)
    q = robot.limits.sample(np.random.default_rng(3), 10)
    to = [robot.joint_names.index(name) for name in copy.joint_names]
    np.testing.assert_allclose(copy.fk(q[:, to]), robot.fk(q), atol=1e-12)
    np.testing.assert_allclose(copy.torques(q[:, to], q[:, to], q[:, to]), robot.torques(q, q, q)[:, to], atol=1e-9)
    for name in ("lower", "upper", "velocity", "torque"):
        np.testing.assert_allclose(getattr(copy.limits, name), getattr(robot.limits, name)[to], atol=1e-12)
    assert robot.compare(robot.with_gravity((0.0, 0.0, -1.0))) and (robot.n == copy.n)
    with pytest.raises(RobotModelError, match="a linkage, whose axes follow joints"):
        to_mjcf(robot)


def test_two_linkages_that_differ_in_a_relation_differ() -> None:
    one, other = (optik.Robot.from_urdf(KINDS[kind].urdf(), "tool0") for kind in ("half", "offset"))
    changed = optik.Robot.from_urdf(KINDS["half"].urdf().replace('multiplier="0.5"', 'multiplier="0.6"'), "tool0")
    assert one != changed and one.fingerprint != changed.fingerprint and not one.compare(changed)
    assert "differ" in str(one.compare(other))
    with pytest.raises(InvalidInput, match="a linkage"):
        one.with_motors(np.eye(one.n))


@pytest.mark.parametrize("method", ["lm", "dls", "sqp", pytest.param("closed_form", marks=pytest.mark.soak)])
@pytest.mark.parametrize("kind", ["inclined wrist", "half", "telescope", "before its driver"])
def test_inverse_kinematics_of_linkages(kind: str, method: str) -> None:
    if method == "sqp":
        pytest.importorskip("casadi")
    robot = optik.Robot.from_urdf(KINDS[kind].urdf(), "tool0")
    solver, solved = optik.ik.make_solver(robot, method, **({"max_restarts": 30} if method != "closed_form" else {})), 0
    for q in robot.limits.sample(np.random.default_rng(4), 5):
        found = solver.solve(robot.fk(q), robot.limits.middle)
        solved += bool(found)
        if found:
            T = KINDS[kind].fk(order(robot, found.q))
            assert np.abs(T - robot.fk(q)).max() < 2e-6 and robot.limits.contains(found.q)
    assert solved == 5 or (method == "dls" and solved >= 3)  # which has no restarts by default


def test_a_turn_of_a_joint_is_no_winding_if_a_follower_does_not_turn_with_it() -> None:
    for kind, whole in (("half", [True, True, False, True, True, True]), ("inclined wrist", [True] * 6)):
        robot = optik.Robot.from_urdf(KINDS[kind].urdf(), "tool0")
        assert robot.turning.tolist() == whole
        q = robot.limits.sample(np.random.default_rng(5), 1)[0]
        for i, same in enumerate(whole):
            turned = q + 2.0 * np.pi * np.eye(6)[i]
            assert (np.abs(robot.fk(turned) - robot.fk(q)).max() < 1e-12) == same


FOLLOWS = '<mimic joint="j3" multiplier="0.5" offset="0.0"/>'


@pytest.mark.parametrize(
    ("mimic", "words"),
    [
        ('<mimic joint="nobody"/>', r"joint 'h': follows joint 'nobody', which does not exist"),
        ('<mimic joint="h"/>', r"joint 'h': follows joint 'h', which follows itself \(<mimic>\)"),
        ('<mimic joint="end"/>', r"joint 'h': follows joint 'end' \(<mimic>\), whose type is 'fixed'"),
        ('<mimic joint="j3" multiplier="0"/>', r"joint 'h': follows joint 'j3' \(<mimic>\), whose multiplier is 0"),
        ('<mimic joint="j3" offset="9"/>', r"joints j3, h move together \(<mimic>\), and their ranges have nothing in common"),
        ('<mimic joint="j3" multiplier="a"/>', r"joint 'h': mimic multiplier is 'a', expected a finite number"),
    ],
)  # fmt: skip
def test_relations_that_cannot_be_read_are_refused_by_name(mimic: str, words: str) -> None:
    with pytest.raises(RobotModelError, match=words):
        optik.Robot.from_urdf(KINDS["half"].urdf().replace(FOLLOWS, mimic), "tool0")


def test_closed_loops_of_links_are_refused_by_name() -> None:
    loop = (
        '<joint name="bar" type="revolute"><parent link="base"/><child link="l3"/><limit lower="-1" upper="1"/></joint>'
    )
    with pytest.raises(RobotModelError, match="two parents, by the joints 'h' and 'bar': a closed loop"):
        optik.Robot.from_urdf(KINDS["half"].urdf().replace("</robot>", loop + "</robot>"), "tool0")


def test_an_axis_whose_driver_is_held_is_fixed() -> None:
    linkage = KINDS["driver beside"]
    held = optik.Robot.from_urdf(linkage.urdf(), "tool0", values={"off": 0.7})
    assert held.linkage is None and "off" not in held.joint_names
    q = held.limits.sample(np.random.default_rng(6), 5)
    np.testing.assert_allclose(held.fk(q), [linkage.fk(order(held, x) | {"off": 0.7}) for x in q], atol=1e-12)
