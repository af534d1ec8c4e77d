from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from optik.errors import InvalidInput
from planners import Trajectory
from tests import oracles
from tests.planners import cases

seeds = st.integers(0, 2**31)


def random(seed: int, **options: Any) -> Trajectory:
    return cases.random_trajectory(np.random.default_rng(seed), **options)


# ---------------------------------------------------------------- values
@given(seeds, st.integers(0, 3), st.floats(0.0, 1.0))
def test_values_are_those_of_the_polynomial_that_holds_the_instant(seed: int, order: int, u: float) -> None:
    trajectory = random(seed)
    t = u * trajectory.duration
    wanted = oracles.value(trajectory, t, order)
    np.testing.assert_allclose(trajectory(t, order), wanted, rtol=1e-12, atol=1e-12 * (1 + np.abs(wanted).max()))


def test_where_a_derivative_jumps_the_right_hand_value_is_given() -> None:
    trajectory = random(2)
    for k in range(1, len(trajectory.knots) - 1):
        for order in range(4):
            right = oracles.value(trajectory, trajectory.knots[k], order, k)
            np.testing.assert_array_equal(trajectory(trajectory.knots[k], order), right)


def test_what_it_says_of_itself() -> None:
    c, x = np.random.default_rng(0).normal(size=(6, 3, 2)), np.array([0.0, 0.5, 1.25, 4.0])
    trajectory = Trajectory(PPoly(c, x))
    assert trajectory.duration == trajectory.end == 4.0
    assert trajectory.n == 2
    np.testing.assert_array_equal(trajectory.knots, x)
    np.testing.assert_array_equal(trajectory.coefficients, c)


# ---------------------------------------------------------------- extrema
@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_extrema_equal_two_hundred_thousand_samples_refined(seed: int, order: int) -> None:
    trajectory = random(seed, pieces=1 + seed, smooth=(0, 2, 3, 0)[seed])
    extrema = trajectory.extrema(order)
    least, greatest, t_least, t_greatest = oracles.brute_extrema(trajectory, order)
    np.testing.assert_allclose(extrema.least, least, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(extrema.greatest, greatest, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(extrema.t_least, t_least, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(extrema.t_greatest, t_greatest, rtol=0.0, atol=1e-5)


@settings(max_examples=150)
@given(seeds, st.integers(0, 3))
def test_extrema_are_never_below_what_occurs(seed: int, order: int) -> None:
    rng = np.random.default_rng(seed)
    pieces = int(rng.integers(1, 5))
    x = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-3, 1, pieces))])
    c = rng.normal(size=(6, pieces, 2)) * 10.0 ** rng.uniform(-12, 3, (6, pieces, 2))
    c *= rng.random((6, pieces, 2)) < 0.8
    trajectory = Trajectory(PPoly(c, x))
    extrema = trajectory.extrema(order)
    least, greatest = np.full(2, np.inf), np.full(2, -np.inf)
    for k in range(pieces):
        t = np.linspace(x[k], x[k + 1], 501)
        values = np.array([oracles.value(trajectory, w, order, k) for w in t[[0, -1]]])
        values = np.concatenate([values, trajectory(t[:-1], order)])
        least, greatest = np.minimum(least, values.min(axis=0)), np.maximum(greatest, values.max(axis=0))
    slack = 1e-9 * np.maximum(np.abs(least), np.abs(greatest)) + 1e-300
    assert (extrema.least <= least + slack).all()
    assert (extrema.greatest >= greatest - slack).all()


@given(seeds, st.integers(0, 3))
def test_extrema_occur_when_they_are_said_to(seed: int, order: int) -> None:
    trajectory = random(seed)
    extrema, x = trajectory.extrema(order), trajectory.knots
    for j in range(trajectory.n):
        for wanted, t in ((extrema.least[j], extrema.t_least[j]), (extrema.greatest[j], extrema.t_greatest[j])):
            near = [k for k in range(len(x) - 1) if x[k] <= t <= x[k + 1]]  # two pieces at a knot
            values = [oracles.value(trajectory, t, order, k)[j] for k in near]
            assert min(abs(v - wanted) for v in values) <= 1e-11 * (1.0 + abs(wanted))


@given(seeds, st.integers(0, 3))
def test_the_worst_is_the_larger_side(seed: int, order: int) -> None:
    e = random(seed).extrema(order)
    for j in range(2):
        low, high = abs(e.least[j]), abs(e.greatest[j])
        assert e.worst[j] == max(low, high)
        assert e.t_worst[j] == (e.t_least[j] if low > high else e.t_greatest[j])


def test_a_one_sided_value_at_a_jump_counts() -> None:
    c = np.zeros((6, 2, 1))
    c[4, 0], c[3, 0], c[4, 1] = 1.0, 1.0, -2.0  # q̇ = 1 + 2t up to 3, then −2
    extrema = Trajectory(PPoly(c, [0.0, 1.0, 2.0])).extrema(1)
    assert extrema.greatest[0] == pytest.approx(3.0)
    assert extrema.t_greatest[0] == 1.0
    assert extrema.least[0] == -2.0
    assert extrema.t_least[0] == 1.0


def test_a_constant_motion_has_its_value_as_both_extrema() -> None:
    c = np.zeros((6, 2, 2))
    c[5] = [0.25, -0.5]
    trajectory = Trajectory(PPoly(c, [0.0, 1.0, 3.0]))
    np.testing.assert_array_equal(trajectory.extrema(0).least, [0.25, -0.5])
    np.testing.assert_array_equal(trajectory.extrema(0).greatest, [0.25, -0.5])
    for order in (1, 2, 3):
        np.testing.assert_array_equal(trajectory.extrema(order).worst, [0.0, 0.0])


# ---------------------------------------------------------------- ends and jumps
@given(seeds, st.integers(0, 3))
def test_jumps_are_the_differences_of_one_sided_values(seed: int, order: int) -> None:
    trajectory = random(seed, pieces=4)
    first, last = trajectory.ends(order)
    x = trajectory.knots
    for k in range(4):
        np.testing.assert_allclose(first[k], oracles.value(trajectory, x[k], order, k), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(last[k], oracles.value(trajectory, x[k + 1], order, k), rtol=1e-12, atol=1e-12)
    assert trajectory.jumps(order).shape == (3, 2)
    np.testing.assert_array_equal(trajectory.jumps(order), first[1:] - last[:-1])


# ---------------------------------------------------------------- slower and sampled
@given(seeds, st.floats(0.2, 20.0), st.floats(0.0, 1.0), st.integers(0, 3))
def test_a_slowed_motion_has_its_derivatives_over_powers_of_the_factor(
    seed: int, factor: float, u: float, order: int
) -> None:
    trajectory = random(seed)
    slow = trajectory.stretched(factor)
    assert slow.duration == pytest.approx(factor * trajectory.duration, rel=1e-12)
    x = trajectory.knots
    np.testing.assert_allclose(slow.knots, factor * x, rtol=1e-14)
    k = min(int(u * (len(x) - 1)), len(x) - 2)
    t = x[k] + (0.1 + 0.8 * u) * (x[k + 1] - x[k])
    wanted = trajectory(t, order) / factor**order
    scale = np.abs(trajectory.extrema(order).worst).max() / factor**order
    np.testing.assert_allclose(slow(factor * t, order), wanted, rtol=0.0, atol=1e-10 * scale)
    np.testing.assert_allclose(
        slow.extrema(order).worst, trajectory.extrema(order).worst / factor**order, rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize("rate", [0.5, 7.0, 100.0, 1000.0])
def test_samples_are_a_period_apart_from_the_start_and_the_end_is_always_there(rate: float) -> None:
    trajectory = random(5)
    t, q = trajectory.sample(rate)
    assert t[0] == 0.0
    assert t[-1] == trajectory.duration
    assert q.shape == (t.size, 2)
    np.testing.assert_allclose(t[:-1], np.arange(t.size - 1) / rate, rtol=1e-13)
    assert 0.0 < t[-1] - t[-2] <= (1.0 + 1e-9) / rate
    np.testing.assert_allclose(q[t.size // 2], oracles.value(trajectory, t[t.size // 2], 0), rtol=1e-12, atol=1e-12)


def test_an_end_on_the_grid_is_sampled_once() -> None:
    c = np.ones((6, 1, 1))
    t, _ = Trajectory(PPoly(c, [0.0, 0.3])).sample(10.0)
    np.testing.assert_allclose(t, [0.0, 0.1, 0.2, 0.3], rtol=0.0, atol=1e-15)
    assert t.size == 4


# ---------------------------------------------------------------- misuse
@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
def test_rates_and_factors_that_are_not_above_zero_are_refused(wrong: float) -> None:
    trajectory = random(0)
    with pytest.raises(InvalidInput, match=r"^rate: "):
        trajectory.sample(wrong)
    with pytest.raises(InvalidInput, match=r"^factor: "):
        trajectory.stretched(wrong)


def one_wrong(value: float) -> PPoly:
    c = np.ones((6, 2, 1))
    c[2, 1, 0] = value
    return PPoly(c, [0.0, 1.0, 2.0])


@pytest.mark.parametrize(
    "wrong",
    [
        PPoly(np.ones((7, 2, 1)), [0.0, 1.0, 2.0]),  # degree 6
        PPoly(np.ones((6, 2)), [0.0, 1.0, 2.0]),  # no joints
        PPoly(np.ones((6, 2, 1)), [1.0, 2.0, 3.0]),  # does not start at 0
        PPoly(np.ones((6, 2, 1)), [0.0, -1.0, -2.0]),  # runs backwards
        one_wrong(np.nan),
        one_wrong(np.inf),
        None,
        "motion",
        np.ones((6, 2, 1)),
        PPoly,
    ],
)
def test_what_is_no_motion_from_time_zero_is_refused(wrong: Any) -> None:
    with pytest.raises(InvalidInput, match=r"^polynomial: "):
        Trajectory(wrong)


@pytest.mark.parametrize("order", [4, -1])
def test_extrema_of_an_order_that_does_not_exist_are_refused(order: int) -> None:
    with pytest.raises(InvalidInput):
        random(0).extrema(order)


def test_a_trajectory_cannot_be_changed_through_what_it_hands_out() -> None:
    trajectory = random(0)
    before = trajectory(0.1)
    try:
        trajectory.coefficients[:] = 0.0
    except ValueError:
        return
    np.testing.assert_array_equal(trajectory(0.1), before)
