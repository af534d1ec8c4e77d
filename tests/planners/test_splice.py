"""Motions cut, joined, held and begun elsewhere: against the motion itself, and against numpy.poly1d."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from planners import MotionLimits, Trajectory
from planners.motion.motion import FADE_FRACTION, match_start
from planners.trajectory import append_rest, cut_before, join

LIMITS = MotionLimits(2.0, 10.0, 100.0)


def drawn(seed: int, degree: int = 5) -> Trajectory:
    """A motion of random quintics, of 7 pieces and 3 joints, that does not even join."""
    rng = np.random.default_rng(seed)
    knots = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.3, 7)))
    return Trajectory(PPoly(rng.normal(size=(degree + 1, 7, 3)), knots))


@pytest.mark.parametrize("degree", [2, 3, 5])
@pytest.mark.parametrize("seed", range(10))
def test_what_is_left_is_the_same_motion(seed: int, degree: int) -> None:
    whole = drawn(seed, degree)
    t = float(np.random.default_rng([1, seed]).choice([0.0, whole.knots[3], whole.end * 0.37, whole.end * 0.91]))
    left = cut_before(whole, t)
    assert left.end == pytest.approx(whole.end - t, abs=1e-15)
    later = np.random.default_rng(2).uniform(0.0, left.end, 50)
    later = later[np.abs(later[:, None] + t - whole.knots).min(axis=1) > 1e-9]
    for order in range(4):
        np.testing.assert_array_equal(left(0.0, min(order, 2)), whole(t, min(order, 2)))
        np.testing.assert_allclose(left(later, order), whole(t + later, order), rtol=0.0, atol=1e-11)


def test_the_first_piece_that_is_left_is_the_polynomial_about_another_point() -> None:
    whole = drawn(3)
    t = 0.4 * whole.knots[1]
    for joint in range(3):
        shifted = np.poly1d(whole.coefficients[:, 0, joint])(np.poly1d([1.0, t]))
        np.testing.assert_allclose(cut_before(whole, t).coefficients[:, 0, joint], shifted.coeffs, rtol=1e-13)


def test_one_after_another_and_held() -> None:
    first, second = drawn(1, 3), drawn(2)
    both = join(first, second)
    assert both.end == first.end + second.end
    np.testing.assert_allclose(both(first.end + 0.1), second(0.1), atol=1e-13)
    np.testing.assert_array_equal(both(0.1), first(0.1))
    standing = append_rest(first, 0.5)
    assert standing.end == first.end + 0.5
    np.testing.assert_allclose(standing(first.end + 0.2), first(first.end))
    np.testing.assert_array_equal(standing(first.end + 0.2, 1), 0.0)


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6])
def test_a_motion_begins_at_the_state_and_comes_back_to_itself_gently(size: float) -> None:
    rng = np.random.default_rng(7)
    smooth = Trajectory(PPoly(rng.normal(size=(6, 1, 3)), [0.0, 1.0]))
    knots = np.linspace(0.0, 1.0, 101)
    pieces = np.concatenate([cut_before(smooth, t).coefficients[:, :1] for t in knots[:-1]], axis=1)
    q, dq, ddq = (smooth(0.0, order) + rng.normal(0.0, size * 10.0**order, 3) for order in range(3))
    new = match_start(Trajectory(PPoly(pieces, knots)), (q, dq, ddq), LIMITS)
    for order, value in enumerate((q, dq, ddq)):
        np.testing.assert_array_equal(new(0.0, order), value)
    for order, most in enumerate((1e-14, 1e-10, 1e-8)):
        assert np.abs(new.jumps(order)).max() <= most
    t = np.linspace(0.0, 0.999, 997)
    assert np.abs(new(t) - smooth(t)).max() <= 10.0 * size
    assert np.abs(new(t, 3) - smooth(t, 3)).max() <= FADE_FRACTION * 100.0 + 1e-6 or size == 1e-6
    over = np.abs(new(t, 3) - smooth(t, 3)).max(axis=1) > 1e-7
    assert over[0]
    assert size == 1e-6 or not over[-500:].any(), "it is the motion itself from then on"


def test_rounding_in_position_costs_no_jerk_on_a_short_way() -> None:
    c = np.zeros((6, 1, 1))
    c[2], c[5] = 100.0 / 6.0, 1.0
    short = Trajectory(PPoly(c, [0.0, 1e-6]))  # 2e-17 rad at 100 rad/s³
    new = match_start(short, (np.array([1.0 + 4e-16]), np.zeros(1), np.zeros(1)), LIMITS)
    np.testing.assert_array_equal(new(0.0), 1.0 + 4e-16)
    assert new.extrema(3).worst.max() <= 100.0 * (1.0 + 1e-12)
