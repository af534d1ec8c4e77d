"""Limits: what is inside, the middle and the half of a range, configurations drawn inside, and what is refused."""

from math import pi

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from optik import JointLimits
from optik.arm.limits import check_positive
from optik.errors import InvalidInput


def test_contains_is_true_at_the_limits_and_a_billionth_past_and_no_further():
    limits = JointLimits([-1, -2], [1, 2])
    assert limits.contains([1, -2])
    assert limits.contains([1 + 0.9e-9, -2 - 0.9e-9])
    assert not limits.contains([1 + 1.1e-9, 0])
    assert not limits.contains([0, -2 - 1.1e-9])
    assert limits.contains([[0, 0], [0, 3]]).tolist() == [True, False]
    assert not limits.contains([np.nan, 0.0])


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=2))
def test_clip_gives_the_nearest_configuration_inside(q):
    limits = JointLimits([-1, -np.inf], [1, 2])
    inside = limits.clip(q)
    assert limits.contains(inside)
    assert inside.tolist() == [min(max(q[0], -1), 1), min(q[1], 2)]


def test_a_locked_joint_and_a_free_one_are_limits():
    limits = JointLimits([0.5, -np.inf], [0.5, np.inf])
    assert limits.contains([0.5, 1e9])
    assert not limits.contains([0.6, 0.0])


def test_one_figure_stands_for_every_joint():
    limits = JointLimits([-1, -1], [1, 1], velocity=2, jerk=[3, np.inf])
    assert limits.velocity.tolist() == [2, 2]
    assert limits.acceleration is None
    assert limits.jerk.tolist() == [3, np.inf]


BAD_LIMITS = {
    "NaN below": (([np.nan, 0], [1, 1]), {}, "limits", "NaN"),
    "NaN above": (([0, 0], [1, np.nan]), {}, "limits", "NaN"),
    "crossed": (([0, 2], [1, 1]), {}, "limits", "joint 2"),
    "lengths": (([0, 0], [1, 1, 1]), {}, "limits", "length"),
    "none": (([], []), {}, "limits", "n ≥ 1"),
    "scalars": ((0, 1), {}, "limits", "length"),
    "tables": (([[0, 0]], [[1, 1]]), {}, "limits", "length"),
    **{
        f"{name} {label}": (([0, 0], [1, 1]), {name: value}, name, word)
        for name in ("velocity", "acceleration", "jerk")
        for label, value, word in (
            ("zero", 0.0, "above 0"), ("negative", [1, -1], "above 0"), ("NaN", [1, np.nan], "above 0"),
            ("minus infinity", -np.inf, "above 0"), ("too long", [1, 1, 1], "2 of them"),
            ("a table", [[1, 1]], "2 of them"), ("a word", "fast", "2 of them"),
        )
    },
}  # fmt: skip


@pytest.mark.parametrize(("limits", "options", "argument", "word"), BAD_LIMITS.values(), ids=BAD_LIMITS.keys())
def test_limits_that_cannot_be_meant_are_refused_by_name(limits, options, argument, word):
    with pytest.raises(InvalidInput) as caught:
        JointLimits(*limits, **options)
    assert caught.value.argument == argument
    assert word in str(caught.value)


def test_positive_gives_one_figure_a_joint_and_no_hold_of_the_callers():
    mine = np.array([1.0, 2.0])
    limit = check_positive(mine, 2, "speed")
    mine[0] = 7.0
    assert limit.tolist() == [1, 2]
    assert not limit.flags.writeable


@pytest.mark.parametrize("bound", [np.inf, -np.inf])
def test_limits_that_no_finite_configuration_meets_are_refused(bound):
    with pytest.raises(InvalidInput):
        JointLimits([bound], [bound])


# ---------------------------------------------------------------- middle, half, draws
ends = st.floats(-1e3, 1e3) | st.sampled_from([-np.inf, np.inf, 0.0])


@st.composite
def joint_limits(draw):
    pairs = [sorted(draw(st.tuples(ends, ends))) for _ in range(draw(st.integers(1, 4)))]
    lower, upper = np.array(pairs).T
    assume((lower < np.inf).all() and (upper > -np.inf).all())
    return JointLimits(lower, upper)


@given(joint_limits())
def test_the_middle_is_inside_and_half_the_range_from_both_limits(limits):
    middle, half = limits.middle, limits.half
    assert limits.contains(middle)
    for m, h, low, high in zip(middle, half, limits.lower, limits.upper, strict=True):
        if np.isfinite([low, high]).all():
            assert abs(m - h - low) <= 1e-12 * (1.0 + abs(low))
            assert abs(m + h - high) <= 1e-12 * (1.0 + abs(high))
        else:
            assert h == np.inf
            assert m == min((x for x in (0.0, low, high) if low <= x <= high), key=abs)
    for array in (middle, half):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_finite_limit_beyond_any_turn_is_refused_and_the_largest_is_not():
    assert JointLimits([-1e5], [1e5]).half.tolist() == [1e5]
    for lower, upper in ((-1.7e308, 1.7e308), (-1.0, 1.01e5), (-1.01e5, np.inf)):
        with pytest.raises(InvalidInput, match="at most 100000"):
            JointLimits([-1.0, lower], [1.0, upper])


@given(joint_limits(), st.integers(0, 2**32))
def test_positions_relative_to_the_range_are_within_one_and_lead_back(limits, seed):
    q = limits.sample(np.random.default_rng(seed), 5)
    x = limits.normalise(q)
    ranged = limits.bounded & (limits.half > 1e-9)
    assert limits.bounded.tolist() == [
        -np.inf < a < b < np.inf for a, b in zip(limits.lower, limits.upper, strict=True)
    ]
    assert np.abs(x).max() <= 1.0 + 1e-6
    assert np.abs(x * np.where(ranged, limits.half, 0.0) + limits.middle - q)[:, ranged].max(initial=0.0) < 1e-9
    assert (x[:, np.isinf(limits.half) | (limits.half == 0.0)] == 0.0).all()
    assert np.abs(limits.normalise(limits.upper)[ranged] - 1.0).max(initial=0.0) < 1e-3


@given(joint_limits(), st.integers(0, 2**32), st.floats(0.0, 2.0))
def test_configurations_are_drawn_inside_at_most_a_turn_wide_and_off_the_limits(limits, seed, margin):
    least = np.min(np.where(np.isinf(limits.half), pi, limits.half))
    if margin > least + 1e-9:
        with pytest.raises(InvalidInput, match="margin"):
            limits.sample(np.random.default_rng(seed), 3, margin=margin)
        return
    assume(margin < least - 1e-9 or margin == 0.0)
    q = limits.sample(np.random.default_rng(seed), 3, margin=margin)
    assert q.shape == (3, limits.lower.size)
    assert (q >= limits.lower + margin - 1e-9).all()
    assert (q <= limits.upper - margin + 1e-9).all()
    near = np.where(np.isfinite(limits.lower), limits.lower, np.where(np.isfinite(limits.upper), limits.upper, 0.0))
    assert (np.abs(q - near)[:, np.isinf(limits.half)] <= 2.0 * pi).all()


def test_draws_are_one_call_of_the_generators_uniform():
    limits = JointLimits([-1.0, -np.inf, 2.0, -np.inf], [1.0, np.inf, np.inf, 5.0])
    low, high = [-1.0, -pi, 2.0, 5.0 - 2.0 * pi], [1.0, pi, 2.0 + 2.0 * pi, 5.0]
    assert (limits.sample(np.random.default_rng(3), 7) == np.random.default_rng(3).uniform(low, high, (7, 4))).all()
    low, high = [-1.0, -1.0, 2.0, 5.0 - 4.0], [1.0, 1.0, 4.0, 5.0]
    drawn = limits.sample(np.random.default_rng(3), 7, half_if_infinite=[9.0, 1.0, 1.0, 2.0])
    assert (drawn == np.random.default_rng(3).uniform(low, high, (7, 4))).all()
    for count in (-1, 2.5, "3"):
        with pytest.raises(InvalidInput, match="count"):
            limits.sample(np.random.default_rng(3), count)


def test_replaced_limits_keep_those_that_are_not_named():
    limits = JointLimits([-1, -2], [1, 2], velocity=[1, 2], jerk=3)
    other = limits.replace(velocity=None, acceleration=5, lower=[0, 0])
    assert other.lower.tolist() == [0, 0]
    assert (other.upper == limits.upper).all()
    assert other.velocity is None
    assert other.acceleration.tolist() == [5, 5]
    assert other.jerk.tolist() == [3, 3]
    assert limits.velocity.tolist() == [1, 2]
    with pytest.raises(InvalidInput, match=r"limits: .*upper, velocity.*got speed"):
        limits.replace(speed=3)
    with pytest.raises(InvalidInput, match="lower 5 above upper 1 at joint 1"):
        limits.replace(lower=[5, 0])
