"""Motions are stretched in time by the least factor with which they have a valid certificate: against bisection."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PPoly

import optik
from optik.errors import NoSolution
from planners import MotionLimits, Trajectory, certify, stretch_to_limits
from planners.trajectory.trajectory import trajectory_through
from tests.planners.cases import START, paper6r

KINDS: dict[str, MotionLimits] = {
    "derivatives": MotionLimits(1.0, 2.0, 9.0),
    "sided": MotionLimits(acceleration=(-1.0, 2.0), jerk=20.0),
    "tool speed": MotionLimits(velocity=3.0, tool_speed=0.2, rotation_speed=0.3),
    "torque": MotionLimits(velocity=9.0, torque=[60.0, 120.0, 60.0, 8.0, 8.0, 8.0]),
    "torque rate": MotionLimits(velocity=9.0, torque_rate=60.0),
}


def moving(seed: int, rests: tuple[bool, bool], size: float = 0.4) -> Trajectory:
    """Quintics through five random states near the start configuration, each end at rest or not."""
    rng = np.random.default_rng(seed)
    states = [scale * rng.normal(size=(5, 6)) for scale in (size, 0.5, 2.0)]
    for end, still in zip((0, -1), rests, strict=True):
        for derivative in states[1:]:
            derivative[end] *= not still
    return trajectory_through(np.r_[0.0, np.cumsum(rng.uniform(0.3, 0.8, 4))], START + states[0], *states[1:])


def excused(motion: Trajectory, limits: MotionLimits, **options: Any) -> bool:
    """Whether a motion violates nothing, except that it may end in motion."""
    reasons = certify(paper6r(), None, motion, limits, **options).reasons
    return set(reasons) <= {"the motion does not end at rest"}


def least_by_bisection(motion: Trajectory, limits: MotionLimits) -> float:
    low, high = 1e-3, 1.0
    while not excused(motion.stretched(high), limits):
        low, high = high, 2.0 * high
    while high - low > 1e-7 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excused(motion.stretched(middle), limits) else (middle, high)
    return high


@pytest.mark.parametrize("rests", [(True, True), (False, True), (True, False), (False, False)])
@pytest.mark.parametrize("kind", KINDS)
def test_the_stretch_is_the_least_with_a_valid_certificate(kind: str, rests: tuple[bool, bool]) -> None:
    limits = KINDS[kind]
    for seed in range(2):
        motion = moving(seed, rests)
        stretched = stretch_to_limits(paper6r(), motion, limits)
        assert excused(stretched, limits)
        assert certify(paper6r(), None, stretched, limits).is_valid == rests[1]
        least = least_by_bisection(motion, limits)
        assert stretched.duration / motion.duration == pytest.approx(least, rel=3e-6)
        t = np.linspace(0.0, 1.0, 50)
        assert np.abs(stretched(t * stretched.duration) - motion(t * motion.duration)).max() < 1e-12


def step(joint: int, order: int) -> Trajectory:
    """A motion between rests with a discontinuous derivative of a joint at 0.5 s."""
    T = moving(0, (True, True))
    c = T.padded.copy()
    c[5 - order, 2:, joint] += 0.1
    return Trajectory(PPoly(c, T.knots))


@pytest.mark.parametrize(
    ("motion", "limits", "reason"),
    [
        (step(1, 0), MotionLimits(1.0), "joint2"),
        (step(2, 1), MotionLimits(1.0), "joint3"),
        (step(3, 2), MotionLimits(1.0, 2.0, 9.0), "jerk of joint4 is unbounded"),
        (moving(3, (True, False), 4.0), MotionLimits(1.0), "exceeds its range"),
        (moving(0, (True, True)), MotionLimits(torque=[60.0, 5.0, 60.0, 8.0, 8.0, 8.0]), "torque of joint2 is"),
    ],
)
def test_what_no_stretch_helps_is_named(motion: Trajectory, limits: MotionLimits, reason: str) -> None:
    with pytest.raises(NoSolution, match="violated at any speed") as caught:
        stretch_to_limits(paper6r(), motion, limits)
    assert reason in str(caught.value)
    assert not any(excused(motion.stretched(c), limits) for c in np.geomspace(0.1, 1e3, 40))


def test_a_spline_of_scipy_is_stretched() -> None:
    t, q = np.array([0.0, 1.0, 2.0]), START + np.array([[0.0], [0.3], [0.6]]) * np.eye(6)[0]
    motion = Trajectory(CubicHermiteSpline(t, q, np.array([[0.0], [0.3], [0.0]]) * np.eye(6)[0]))
    assert stretch_to_limits(paper6r(), motion, MotionLimits(0.15)).duration > 4.0


def test_a_contact_is_not_stretched_away() -> None:
    robot, q = optik.load("panda"), np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    motion = trajectory_through(
        np.array([0.0, 1.0]), *(np.array([x, y]) for x, y in [(q, q + 0.3), (0 * q, 0 * q), (0 * q, 0 * q)])
    )
    wall = optik.Scene(spheres=[(robot.fk(q + 0.15)[:3, 3], 0.05)])
    limits = MotionLimits.of(robot, acceleration=5.0, jerk=50.0)
    assert stretch_to_limits(robot, motion, limits).duration > 0.0
    with pytest.raises(NoSolution, match="contact"):
        stretch_to_limits(robot, motion, limits, scene=wall)


def test_a_limit_that_only_the_motion_keeps_is_respected_at_the_largest_speed_that_does() -> None:
    """A falling arm needs less torque than one that rests: the limit is below what would hold it."""
    c = np.zeros((3, 1, 6))
    c[:, 0, 1], c[2, 0] = (3.0, -1.2, 0.0), START
    motion = Trajectory(PPoly(c, [0.0, 0.4]))
    limits = MotionLimits(torque=[1e4, 90.0, 1e4, 1e4, 1e4, 1e4])
    assert not excused(motion.stretched(10.0), limits) and np.abs(paper6r().gravity_torques(START)[1]) > 90.0
    for given in (motion, motion.stretched(0.1), motion.stretched(1.5)):
        stretched = stretch_to_limits(paper6r(), given, limits)
        assert excused(stretched, limits) and not excused(stretched.stretched(1.0 - 3e-6), limits)
        assert stretched.duration == pytest.approx(0.4 * 0.482932, rel=1e-5)
    with pytest.raises(NoSolution, match="torque of joint2 is"):
        stretch_to_limits(paper6r(), motion, MotionLimits(torque=[1e4, 1.0, 1e4, 1e4, 1e4, 1e4]))
