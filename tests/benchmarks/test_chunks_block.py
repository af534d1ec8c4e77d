"""Streams of chunks: the judge against closed forms, and policies that keep what the page says of them."""

from __future__ import annotations

import numpy as np
import pytest

import optik
from benchmarks.blocks.chunks import CHASE, LINEAR, Policy, follow_by_rule, judge_setpoints, make_policy
from planners import MotionLimits
from planners.streams import Chunk

LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
ROBOT = optik.load("ur3e")
BOUNDS = LIMITS.bounds(6)
T = np.arange(4000) / 1000.0
START = np.array([0.0, -1.0, 1.0, 0.0, 1.0, 0.0])


def swing(t: np.ndarray) -> np.ndarray:
    return START + 0.3 * (1.0 - np.cos(3.0 * np.asarray(t)[..., None])) * np.ones(6)


POLICY = Policy(swing, START, [], [])


def test_the_judge_measures_a_swing_as_its_formula_says() -> None:
    found = judge_setpoints(swing(T), POLICY, ROBOT, BOUNDS, T)
    assert found["velocity"] == pytest.approx(0.3 * 3.0 / 2.0, rel=1e-5)
    # from rest, the acceleration begins with a step: one difference of jerk is that of the step
    assert found["acceleration"] == pytest.approx(0.3 * 9.0 / 10.0, rel=1e-5)
    assert found["jerk"] == pytest.approx(0.3 * 9.0 * 0.5 * 1000.0 / 100.0, rel=1e-2)
    assert (found["stops"], found["reversals"], found["discontinuities"]) == (0, 0, 0)
    assert (found["lag"], found["distance"]) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.0, abs=1e-12))
    assert found["outside"] == 2


def test_the_judge_finds_a_lag_a_step_a_stop_and_reversals() -> None:
    late = judge_setpoints(swing(np.maximum(T - 0.05, 0.0)), POLICY, ROBOT, BOUNDS, T)
    assert (late["lag"], late["distance"]) == (pytest.approx(0.05), pytest.approx(0.0, abs=1e-12))
    q = swing(T)
    q[2000:] += 0.01
    step = judge_setpoints(q, POLICY, ROBOT, BOUNDS, T)
    assert step["velocity"] == pytest.approx((0.01 * 1000.0 + abs(0.9 * np.sin(6.0))) / 2.0, rel=0.05)
    assert step["discontinuities"] == 2  # up, and back
    q = swing(T)
    q[1300:1400] = q[1300]
    assert judge_setpoints(q, POLICY, ROBOT, BOUNDS, T)["stops"] == 1
    q = swing(T) + 0.02 * np.sin(100.0 * T)[:, None]
    assert judge_setpoints(q, POLICY, ROBOT, BOUNDS, T)["reversals"] > 300


def test_a_policy_moves_within_half_of_the_limits_from_rest_and_its_last_joint_turns() -> None:
    policy = make_policy(ROBOT, BOUNDS, 8.0, np.random.default_rng(5))
    t = np.arange(0.0, 8.0, 1e-3)
    for order, name, most in ((1, "velocity", 0.5), (2, "acceleration", 0.5)):
        rate = np.diff(policy.intend(t), order, axis=0) * 1e3**order / BOUNDS[name]
        assert np.abs(rate[:, :5]).max() <= most
    assert np.ptp(policy.intend(t)[:, 5]) > 2.0
    assert all(np.abs(chunk.points[:, 5]).max() <= np.pi for chunk in policy.chunks)
    assert all(0.0 <= at - chunk.observed <= 0.3 for at, chunk in zip(policy.arrivals, policy.chunks, strict=False))


@pytest.mark.parametrize(("rule", "inside"), [(CHASE, True), (LINEAR, False)])
def test_rules_get_what_they_are_named_after(rule: str, inside: bool) -> None:
    seen = np.arange(0.0, 3.9, 0.3)
    chunks = [Chunk(swing(at + np.arange(20) / 20.0), 20.0, float(at)) for at in seen]
    policy = Policy(swing, START, [*(seen + 0.05).tolist(), 4.0], chunks)
    q, joined = follow_by_rule(rule, policy, ROBOT, LIMITS, T)
    found = judge_setpoints(q, policy, ROBOT, BOUNDS, T)
    assert joined == len(chunks)
    assert (found["outside"] == 0) == inside
    assert found["distance"] < 0.02
    if rule == LINEAR:  # at the targets' own instants it is the policy
        at = np.arange(1000, 3600, 200)
        assert np.abs(q[at] - swing(T[at])).max() < 1e-3
