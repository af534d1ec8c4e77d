"""Controllers that change or follow set-points, against plain transcriptions and a solution of the differential equation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

import optik
import planners
from optik.errors import InvalidInput
from planners import MotionLimits, stream
from planners.streams import Chunk
from planners.streams.controllers import ACCELERATION, JERK, VELOCITY, FrankaLimiter, ServoJ
from tests.seeds import shift_seed

REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


class Swings:
    """Chunks that swing faster than the limits."""

    def __init__(self, rng: np.random.Generator, start: np.ndarray, size: float, seconds: float) -> None:
        self.rng, self.start, self.seconds, self.due = rng, start, seconds, 0.0
        self.size, self.rate = rng.uniform(0.3, 1.0, start.size) * size, rng.uniform(1.0, 6.0, start.size)

    def __call__(self, now: Any) -> Chunk | None:
        if not self.due <= now.t <= self.seconds:
            return None
        self.due = now.t + self.rng.uniform(0.03, 0.3)
        t = now.t + np.arange(20)[:, None] / 20.0
        return Chunk(self.start + self.size * np.sin(t * self.rate), 20.0, now.t)


def setpoints(
    robot: optik.Robot, q: np.ndarray, limits: MotionLimits, size: float, rate: float, seed: int
) -> np.ndarray:
    source = Swings(np.random.default_rng(seed), q, size, 4.0)
    return np.array([now.q for now in stream(robot, source, q, limits=limits, rate=rate, realtime=False, silence=0.2)])


def test_the_limiter_changes_nothing_of_streams_within_its_limits():
    for seed in range(3):
        q = setpoints(optik.load("panda"), REST, FrankaLimiter.limits, 0.5, 1000.0, shift_seed(seed))
        assert np.abs(np.diff(q, axis=0)).max(axis=0).max() * 1e3 > 0.9 * FrankaLimiter.limits.velocity.min()
        np.testing.assert_allclose(FrankaLimiter().apply(q), q, rtol=0.0, atol=1e-11)


def test_the_limiter_changes_a_stream_up_to_its_own_velocity():
    own = MotionLimits(velocity=VELOCITY, acceleration=ACCELERATION, jerk=JERK)
    q = setpoints(optik.load("panda"), REST, own, 0.5, 1000.0, 1)
    assert np.abs(FrankaLimiter().apply(q) - q).max() > 1e-6


def test_the_limiter_is_its_source_line_by_line():
    rng = np.random.default_rng(2)
    q = REST + np.cumsum(rng.normal(size=(400, 7)) * 1e-3, axis=0)
    for j in (0, 6):
        last, v, a, found = q[0, j], 0.0, 0.0, [q[0, j]]
        for wanted in q[1:, j]:
            commanded_jerk = (((wanted - last) / 1e-3 - v) / 1e-3 - a) / 1e-3
            commanded = a + np.clip(commanded_jerk, -JERK[j], JERK[j]) * 1e-3
            safe_max = min((JERK[j] / ACCELERATION[j]) * (VELOCITY[j] - v), ACCELERATION[j])
            safe_min = max((JERK[j] / ACCELERATION[j]) * (-VELOCITY[j] - v), -ACCELERATION[j])
            after = v + max(min(commanded, safe_max), safe_min) * 1e-3
            a, v = (after - v) / 1e-3, after
            last += v * 1e-3
            found.append(last)
        np.testing.assert_allclose(FrankaLimiter().apply(q)[:, j], found, atol=1e-12)


def test_the_follower_solves_its_differential_equation():
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.normal(size=(60, 2)) * 1e-3, axis=0)
    servo = ServoJ(lookahead=0.05, gain=500.0)
    motion = servo.follow(q)
    held = [(q[0], np.zeros(2))]
    for target in q:
        place, speed = held[-1]
        a = 500.0 * (target - place - 0.05 * speed)
        held.append((place + 0.002 * speed + 0.5 * a * 0.002**2, speed + 0.002 * a))
    for order in range(2):
        np.testing.assert_allclose(motion(0.002 * np.arange(61), order), [x[order] for x in held], atol=1e-12)
    smooth = scipy.integrate.solve_ivp(  # the period is short against the follower's own time
        lambda t, x: [x[1], 500.0 * (1.0 - x[0] - 0.05 * x[1])], (0.0, 1.0), [0.0, 0.0], rtol=1e-9, atol=1e-9,
        t_eval=[0.5, 1.0],
    ).y[0]  # fmt: skip
    step = servo.follow(np.append(0.0, np.ones(500))[:, None])
    np.testing.assert_allclose(step(step.end), 1.0, atol=1e-11)
    np.testing.assert_allclose(step([0.502, 1.002])[:, 0], smooth, atol=5e-3)


def test_streams_after_the_follower_are_certified():
    robot, q = optik.load("ur5e"), np.array([0.0, -1.2, 1.4, -0.2, 0.5, 0.0])
    limits = MotionLimits(velocity=np.pi, acceleration=10.0)
    slower, valid = MotionLimits(velocity=0.9 * np.pi, acceleration=8.0, jerk=80.0), 0
    for seed in range(4):
        motion = ServoJ().follow(setpoints(robot, q, slower, 0.5, 500.0, shift_seed(seed)))
        assert np.abs(motion(motion.end, 1)).max() <= 1e-12
        valid += planners.certify(robot, None, motion, limits, enforced=("velocity", "acceleration")).is_valid
    assert valid >= 3


@pytest.mark.parametrize("given", [{"lookahead": 0.01}, {"lookahead": 0.3}, {"gain": 50.0}, {"gain": 3000.0}])
def test_an_option_out_of_its_range_is_named(given):
    with pytest.raises(InvalidInput, match=next(iter(given))):
        ServoJ(**given)


@pytest.mark.parametrize("q", [np.zeros(7), np.zeros((3, 6)), np.full((3, 7), np.nan)])
def test_positions_are_checked(q):
    with pytest.raises(InvalidInput, match="q"):
        FrankaLimiter().apply(q)
    with pytest.raises(InvalidInput, match="q"):
        ServoJ().follow(q[:1] if q.ndim > 1 else q)
