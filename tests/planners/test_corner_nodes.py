"""Rounded corners: their nodes, their proved deviation on coarse curves, and the path error of a program."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import optik
import planners
from optik import JointLimits, Robot, se3
from optik.types import Array
from planners import MotionLimits, Part, Program
from planners.paths.joint_curve import JointCurve
from planners.program import Move, joining
from planners.program.joining import ON_CURVE, place_nodes
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through

ROBOT = optik.load("ur5e")
HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])


def waves(s: Array) -> Array:
    """Joints (k, 4, 2) that swing ever faster."""
    a, w = np.array([1.0, 0.3]), np.array([1.0, 4.0])
    turned = [np.sin(w * s[:, None]), np.cos(w * s[:, None]), -np.sin(w * s[:, None]), -np.cos(w * s[:, None])]
    return np.stack([a * w**k * x for k, x in enumerate(turned)], axis=1)


def off(s: Array, values: Array) -> Array:
    """Distances of the quintics between nodes from the joints, in their middles."""
    motion, middle = Trajectory(quintic_through(s - s[0], *np.moveaxis(values[:, :3], 1, 0))), 0.5 * (s[1:] + s[:-1])
    return np.asarray(np.abs(motion(middle - s[0]) - waves(middle)[:, 0]).max(axis=1))


@pytest.mark.parametrize("least", [1e-3, 0.06])
def test_intervals_between_nodes_are_halved_until_their_quintics_are_on_the_curve(least: float) -> None:
    first = np.array([0.0, 0.9, 1.1, 2.0])
    s, values = place_nodes(waves, first, least)
    assert set(first) <= set(s)
    np.testing.assert_array_equal(values, waves(s))
    narrow = np.diff(s) <= 2.0 * least
    assert ((off(s, values) <= ON_CURVE) | narrow).all()
    coarse = first
    for _ in range(8):  # the same by halving one after another
        far = (off(coarse, waves(coarse)) > ON_CURVE) & (np.diff(coarse) > 2.0 * least)
        coarse = np.sort(np.append(coarse, 0.5 * (coarse[1:] + coarse[:-1])[far]))
    np.testing.assert_allclose(s, coarse, atol=1e-15)


def curve_through(rng: np.random.Generator, q: Array, length: float) -> JointCurve:
    """A wide curve with few nodes, from a configuration."""
    s = np.linspace(0.0, length, 3)
    q = q + np.append(np.zeros((1, 6)), 0.3 * length * np.cumsum(rng.normal(size=(2, 6)), axis=0), axis=0)
    return JointCurve(ROBOT, s, q, rng.normal(size=(3, 3, 6)) * np.array([0.3, 0.3, 0.6])[:, None])


@pytest.mark.parametrize("coarse", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_no_place_of_a_corner_is_farther_from_the_sharp_path_than_is_proved(
    seed: int, coarse: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of any three curves, and of one that is on the sharp path at both ends and at the corner, where it is looked at only."""
    rng = np.random.default_rng(seed)
    one, two = (curve_through(rng, HOME, 0.9) for _ in range(2))
    curve = curve_through(rng, HOME, (1.6, 0.5)[seed % 2])
    if coarse:
        monkeypatch.setattr(joining, "PROOF_INTERVALS", 2)
        half, two = 0.5 * curve.end, JointCurve(ROBOT, two.s, two.q + one.q[-1] - two.q[0], two.derivatives)
        q = one.configurations(ROBOT, [one.end - half, one.end]), two.configurations(ROBOT, [half])
        curve = JointCurve(ROBOT, curve.s, np.concatenate(q), curve.derivatives * (3.0, 0.3)[seed // 2 % 2])
    proved = joining._prove_deviation(ROBOT, one, two, curve)
    w = np.linspace(-0.5, 0.5, 4001) * curve.end
    before = one.configurations(ROBOT, one.end + np.minimum(w, 0.0))
    after = two.configurations(ROBOT, np.maximum(w, 0.0))
    sharp = np.ascontiguousarray(np.where((w < 0.0)[:, None], before, after))
    gap = se3.error(ROBOT.fk(curve.configurations(ROBOT, w + 0.5 * curve.end)), ROBOT.fk(sharp)).reshape(-1, 2, 3)
    true = np.linalg.norm(gap, axis=2).max(axis=0)
    assert (true <= proved * (1.0 + 1e-9)).all()
    assert coarse or (proved <= true * [1.3, 1.5]).all()


def test_two_rotations_against_each_other_have_the_bound_of_their_products(monkeypatch: pytest.MonkeyPatch) -> None:
    """E = R(2 w) − 1 has a second derivative of size 4."""
    monkeypatch.setattr(joining, "PROOF_INTERVALS", 2)
    robot = Robot("bar", np.eye(4)[None], np.array([False]), se3.pose(p=[0.3, 0.0, 0.0]), JointLimits([-9.0], [9.0]))

    def line(begin: float, rate: float) -> JointCurve:
        s, derivatives = np.array([0.0, 0.5, 1.0]), np.zeros((3, 3, 1))
        derivatives[:, 0] = rate
        return JointCurve(robot, s, (begin + rate * s)[:, None], derivatives)

    one, two, curve = line(1.0, -1.0), line(0.0, -1.0), line(-0.5, 1.0)
    turn = 2.0 * np.sin(0.5) + 0.5**2 / 8.0 * 4.0
    found = joining._prove_deviation(robot, one, two, curve)
    assert found[1] == pytest.approx(2.0 * np.arcsin(0.5 * turn), rel=1e-9)
    assert found[0] == pytest.approx(0.6 * np.sin(0.5) + 0.3 * 0.5**2 / 8.0 * 2.0, rel=1e-9)


def test_bounds_of_a_stretch_are_those_of_all_pieces_that_it_touches() -> None:
    rng, s = np.random.default_rng(1), np.array([0.0, 0.2, 0.5, 0.9, 1.0])
    curve = SimpleNamespace(s=s, node_bounds=rng.uniform(size=(4, 2, 4)))
    for low, high in ((0.1, 0.15), (0.1, 0.6), (0.0, 1.0), (0.2, 0.5), (0.5, 0.91), (0.95, 1.0), (0.3, 0.3)):
        touched = (s[:-1] < max(high, low + 1e-9)) & (s[1:] > low)
        wanted = curve.node_bounds[touched].max(axis=0)
        np.testing.assert_array_equal(joining._greatest_between(curve, low, high), wanted)  # type: ignore[arg-type]


def test_a_programs_tool_is_on_its_rounded_path() -> None:
    parts = [Part(Move([0.1, 0.0, 0.0], "base"), blend=0.01), Part(Move([0.0, 0.1, 0.0], "base"))]
    found = planners.plan(ROBOT, Program(parts), HOME, limits=MotionLimits(3.0, 10.0, 100.0))
    assert found and found.certificate.path_error.distance < 1e-8 and found.certificate.path_error.angle < 1e-8
