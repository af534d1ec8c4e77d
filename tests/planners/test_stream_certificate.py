"""The certificate of a stream's motion: of polynomials of any states, against dense values, with one fault at a time."""

from __future__ import annotations

from itertools import pairwise, product
from math import factorial
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
from optik import JointLimits, Robot, Scene, Shapes
from optik.types import Array
from planners import MotionLimits, Trajectory
from planners.limits.base import sides
from planners.streams.motion import JointCubics
from planners.streams.result import CONTINUOUS, EXCESS, StreamCertificate, certify_joined
from planners.trajectory.curve import quintic_through
from tests.optik.test_motors import MATRICES, NAMES

WIDE = MotionLimits(velocity=(-90.0, 70.0), acceleration=(-900.0, 800.0), jerk=9e4)
ORDERS = ("position", "velocity", "acceleration")


def bare(n: int, most: float = 50.0) -> Robot:
    fixed = np.tile(np.eye(4), (n, 1, 1))
    fixed[:, 0, 3] = 0.3
    return Robot("bare", fixed, np.zeros(n, bool), np.eye(4), JointLimits(np.full(n, -most), np.full(n, 0.8 * most)))


def curve_of(kind: str, rng: np.random.Generator, n: int = 3, last: Any = 0.0) -> tuple[Any, Array]:
    """A motion from a moving state to rest, as an entered plan (quintics) or as cubics of each joint; and that state.

    A plan may end with a velocity and an acceleration, `last` (2, n).
    """
    state = rng.normal(size=(3, n))
    if kind == "plan":
        t = np.array([0.0, 0.4, 0.9, 1.7])
        q, v, a = (np.concatenate([state[k : k + 1], rng.normal(size=(3, n))]) for k in range(3))
        v[-1], a[-1] = np.broadcast_to(last, (2, n))
        return Trajectory(quintic_through(t, q, v, a)), state
    knots, count = np.zeros((n, 8)), np.array([5, 7, 8][:n])
    c = np.zeros((n, 4, 7))
    for j, k in enumerate(count):
        h = rng.uniform(0.2, 0.5, k - 1)
        knots[j, 1:k] = np.cumsum(h)
        jerk, left = rng.normal(size=k - 1), np.cumsum(h[::-1])[::-1] - h
        R = np.stack([0.5 * h * h + left * h, h])  # of the jerks on the last velocity and acceleration
        v0, a0 = state[1, j], state[2, j]
        jerk -= np.linalg.pinv(R) @ (R @ jerk + [v0 + knots[j, k - 1] * a0, a0])
        q, v, a = state[:, j]
        for i, (hi, ji) in enumerate(zip(h, jerk, strict=True)):
            c[j, :, i] = ji / 6.0, 0.5 * a, v, q
            q, v, a = q + hi * (v + hi * (0.5 * a + hi * ji / 6.0)), v + hi * (a + 0.5 * hi * ji), a + hi * ji
    return JointCubics(knots, count.astype(np.int64), c), state


def stepped(curve: Any, order: int, knot: int, joint: int, step: float) -> Any:
    """The motion with a step of a derivative of a joint at a knot, which moves what follows."""
    if isinstance(curve, JointCubics):
        knots, c = curve.knots[joint, : curve.count[joint]], curve.c[joint, ::-1].copy()
    else:
        knots, c = curve.knots, curve.padded[::-1, :, joint].copy()
    for i in range(knot, knots.size - 1):
        for k in range(order + 1):
            c[k, i] += step * (knots[i] - knots[knot]) ** (order - k) / factorial(order - k) / factorial(k)
    if isinstance(curve, JointCubics):
        out = curve.c.copy()
        out[joint] = c[::-1]
        return JointCubics(curve.knots, curve.count, out)
    full = curve.padded.copy()
    full[:, :, joint] = c[::-1]
    return Trajectory(PPoly(full, curve.knots))


def certify(curve: Any, state: Array, limits: MotionLimits = WIDE, robot: Robot | None = None) -> StreamCertificate:
    return certify_joined(robot or bare(state.shape[1]), curve, limits, state, None)


@pytest.mark.parametrize("kind", ["plan", "cubics"])
def test_a_step_at_the_entry_or_inside_is_as_large_as_it_is(kind: str) -> None:
    rng = np.random.default_rng(1)
    curve, state = curve_of(kind, rng)
    assert certify(curve, state).is_valid and certify(curve, state).discontinuity.max() < 1e-12
    for joint, knot, order, step in product(range(3), (0, 1, 2, 3), range(3), (1e-6, -0.1)):
        if kind == "plan" and knot == 3:
            continue
        found = certify(stepped(curve, order, knot, joint, step), state)
        wanted = abs(step) * np.eye(3)[order]
        if order == 2:  # which changes the velocity at the end
            wanted[1] = abs(step) * rest_of(curve, knot, joint)
        np.testing.assert_allclose(found.discontinuity, wanted, rtol=1e-6, atol=1e-12)
        assert not found.is_valid and f"the {ORDERS[order]} is discontinuous by {abs(step):.3g}" in found.reasons


def rest_of(curve: Any, knot: int, joint: int) -> float:
    knots = curve.knots[joint, : curve.count[joint]] if isinstance(curve, JointCubics) else curve.knots
    return float(knots[-1] - knots[knot])


@pytest.mark.parametrize("order", [1, 2])
def test_a_plan_that_does_not_end_at_rest_is_refused(order: int) -> None:
    last = 1e-6 * np.eye(2)[order - 1][:, None] * [0.0, -1.0, 0.0]
    found = certify(*curve_of("plan", np.random.default_rng(2), last=last))
    np.testing.assert_allclose(found.discontinuity, 1e-6 * np.eye(3)[order], rtol=1e-6, atol=1e-12)
    assert found.reasons == (f"the {ORDERS[order]} is discontinuous by 1e-06",)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_step_is_one_just_above_rounding(share: float) -> None:
    curve, state = curve_of("plan", np.random.default_rng(3))
    for order in range(3):
        moved = state.copy()
        moved[order, 2] += share * CONTINUOUS
        assert certify(curve, moved).is_valid == (share < 1.0)
    assert not certify(curve, np.where(np.arange(3)[:, None] == 1, np.nan, state)).is_valid


@pytest.mark.parametrize("kind", ["plan", "cubics"])
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_peaks_are_the_largest_ratios_of_dense_values_on_either_side(kind: str, turned: float) -> None:
    rng, limits = np.random.default_rng(4), MotionLimits((-3.0, 2.0), (-9.0, 12.0), 70.0)
    for _ in range(6):
        curve, state = curve_of(kind, rng)
        if isinstance(curve, JointCubics):
            curve = JointCubics(curve.knots, curve.count, turned * curve.c)
            motion = curve.trajectory
        else:
            curve = motion = Trajectory(PPoly(turned * curve.padded, curve.knots))
        found, x = certify(curve, turned * state, limits), motion.knots
        t = np.unique(np.concatenate([np.linspace(a, b - 1e-12, 2001) for a, b in pairwise(x)]))
        for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
            low, high = sides(limits.bounds(3)[name])
            value, peak = motion(t, order), found.peaks[name]
            ratio = np.maximum(value / low, value / high)
            np.testing.assert_allclose(peak.ratio, ratio.max(axis=0), rtol=1e-5)
            np.testing.assert_allclose(peak.value, np.abs(value[ratio.argmax(axis=0), range(3)]), rtol=1e-5)
            here = motion(np.minimum(peak.time, motion.end), order)[range(3), range(3)]
            if order < 3:  # the jerk steps at its times
                np.testing.assert_allclose(np.abs(here), peak.value, rtol=1e-9)
        q, robot = motion(t), bare(3)
        margins = np.stack([q.min(axis=0) - robot.limits.lower, robot.limits.upper - q.max(axis=0)])
        np.testing.assert_allclose(found.position_margin, margins.min(axis=0), atol=1e-5)
        at = np.where(margins[0] < margins[1], t[q.argmin(axis=0)], t[q.argmax(axis=0)])
        np.testing.assert_allclose(found.t_position_margin, at, atol=2e-3)
        worst = [name for name in found.peaks if found.peaks[name].ratio.max() > 1.0 + EXCESS]
        assert {words.split()[0] for words in found.reasons} == set(worst)
        assert found.duration == motion.end


@pytest.mark.parametrize(("share", "valid"), [(1.0 - 1e-6, True), (1.0 + 1e-6, False)])
@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk", "tool_speed", "rotation_speed", "range"])
def test_a_motion_just_beyond_one_limit_is_refused_by_its_name(name: str, share: float, valid: bool) -> None:
    curve, state = curve_of("plan", np.random.default_rng(5))
    limits, robot = MotionLimits(99.0, 999.0, 1e5, tool_speed=99.0, rotation_speed=99.0), bare(3)
    proof = certify(curve, state, limits)
    if name == "range":
        margin = proof.position_margin + (2.0 if valid else 0.0)
        lower = robot.limits.lower + np.eye(3)[1] * (margin[1] + 1e-6 if not valid else 0.0)
        robot = robot.with_limits(
            lower=lower, upper=robot.limits.upper - np.eye(3)[1] * (margin[1] + 1e-6) * (not valid)
        )
    else:
        peak = float(np.max(proof.peaks[name].value))
        limits = MotionLimits(**({key: float(limits.value(key)) for key in proof.peaks} | {name: peak / share}))
    found = certify(curve, state, limits, robot)
    assert found.is_valid == valid
    if not valid:
        assert len(found.reasons) == 1
        assert found.reasons[0].startswith("joint2 exceeds its range by 1e-06" if name == "range" else f"{name} of ")


@pytest.mark.parametrize("kind", ["plan", "cubics"])
def test_a_motor_outside_its_range_is_found_where_every_joint_is_inside_its_own(kind: str) -> None:
    plain = optik.load("puma560")
    robot = plain.with_motors(MATRICES["joints 2 and 3"], names=NAMES)
    m = robot.motors.of(robot.limits.middle)
    state = np.zeros((3, 6))
    state[0] = robot.motors.axes(m)
    m[2] = robot.motors.limits.upper[2] + 0.02
    away = robot.motors.axes(m) - state[0]
    if kind == "plan":
        still = np.zeros((3, 6))
        q = np.stack([state[0], state[0] + away, state[0]])
        curve: Any = Trajectory(quintic_through(np.array([0.0, 1.0, 2.0]), q, still, still))
    else:
        j, h = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0]), 0.25
        c, knots, count = np.zeros((6, 4, 8)), np.tile(np.arange(9) * h, (6, 1)), np.full(6, 9)
        for i in range(6):
            q, v, a, size = state[0, i], 0.0, 0.0, away[i] / (2.0 * h**3)
            for k in range(8):
                c[i, :, k] = size * j[k] / 6.0, 0.5 * a, v, q
                q, v, a = c[i, ::-1, k] @ h ** np.arange(4), v + h * a + 0.5 * h * h * size * j[k], a + h * size * j[k]
        curve = JointCubics(knots, count, c)
    limits = MotionLimits(99.0, 999.0, 1e5)
    found = certify(curve, state, limits, robot)
    assert found.reasons == ("M3 exceeds its range by 0.02 (rad or m) at t = 1 s",)
    assert certify(curve, state, limits, plain).is_valid


def test_contact_is_a_violation() -> None:
    curve, state = curve_of("plan", np.random.default_rng(6))
    robot = bare(3).with_shapes(Shapes([(3, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0), 0.02)]))
    for far, touches in ((5.0, False), (0.6, True)):
        scene = Scene(spheres=[((far, 0.0, 0.0), 0.4)])
        found = certify_joined(robot, curve, WIDE, state, scene)
        assert found.is_valid != touches and any("contact" in words for words in found.reasons) == touches
        assert "contact" not in found.not_covered
