"""Limits with two sides: what a pair is, what laws and certificates make of it, against dense samples."""

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Plan, certify, plan, replan
from planners.limits import PathPoints
from planners.timing.optimal import Optimal
from planners.trajectory.curve import monomials
from tests.planners.cases import START, default_joint_path, default_line, paper6r, random_trajectory
from tests.seeds import shift_seed

VELOCITY, ACCELERATION = (-0.8, 1.5), (np.array([-4.0, -3.0, -2.0, -5.0, -4.0, -3.0]), 6.0)
LIMITS = MotionLimits(VELOCITY, ACCELERATION, 60.0)
NEARER = MotionLimits(0.8, np.minimum(-ACCELERATION[0], ACCELERATION[1]), 60.0)
"""Both limits on both sides the lesser ones."""
LAWS = ("smooth", "ruckig", "constant_speed", "toppra", "optimal")

sizes = st.floats(1e-3, 1e3)


def columns(n: int) -> st.SearchStrategy[Any]:
    """A size as a number, or as one for each of n joints."""
    return st.one_of(sizes, st.lists(sizes, min_size=n, max_size=n))


def negative(x: Any) -> Any:
    return [-y for y in x] if isinstance(x, list) else -x


def beyond(trajectory: Any, order: int, lower: Any, upper: Any, count: int = 20_001) -> Array:
    """Largest ratio (n,) of dense samples to the side that they go to."""
    y = trajectory(np.linspace(0.0, trajectory.end, count), order)
    return np.asarray(np.maximum(y.max(axis=0) / upper, y.min(axis=0) / lower))


@given(st.integers(1, 4).flatmap(lambda n: st.tuples(st.just(n), columns(n), columns(n), st.booleans())))
def test_a_pair_is_what_its_two_sides_say_in_every_form(case: tuple[int, Any, Any, bool]) -> None:
    n, low, high, as_array = case
    lower, upper = np.broadcast_to(negative(low), n), np.broadcast_to(high, n)
    given_pair: Any = np.stack([lower, upper]) if as_array else (negative(low), high)
    limits = MotionLimits(given_pair, given_pair, 9.0)
    for name in ("velocity", "acceleration"):
        bound = limits.bounds(n)[name]
        if (lower == -upper).all():
            assert (bound == upper).all() and bound.shape == (n,)
        else:
            assert (bound == [lower, upper]).all() and not bound.flags.writeable
        assert (limits.arrays(n)[name] == np.minimum(-lower, upper)).all()
    assert limits == MotionLimits.from_plain(limits.to_plain(), n) == pickle.loads(pickle.dumps(limits))
    assert hash(limits) == hash(limits.scale(1.0))
    assert (limits.scale(3.0).arrays(n)["velocity"] == 3.0 * np.minimum(-lower, upper)).all()
    assert limits.scale(3.0, ("jerk",)).select(("velocity",)) == MotionLimits(given_pair)


def test_two_joints_are_told_from_two_sides_by_the_first_sign() -> None:
    assert MotionLimits((1.0, 2.0)).bounds(2)["velocity"].tolist() == [1.0, 2.0]
    assert MotionLimits((-1.0, 2.0)).bounds(2)["velocity"].tolist() == [[-1.0, -1.0], [2.0, 2.0]]
    both = MotionLimits(([-1.0, -2.0], [3.0, 4.0]))
    assert both.bounds(2)["velocity"].tolist() == [[-1.0, -2.0], [3.0, 4.0]]
    assert both.to_dict(2)["velocity"] == [[-1.0, -2.0], [3.0, 4.0]]
    assert MotionLimits((-2.0, 2.0)) == MotionLimits(2.0)
    free = MotionLimits(([-1.0, -np.inf], [3.0, np.inf]))
    assert free == MotionLimits.from_plain(free.to_plain(), 2)
    assert free.to_dict(2)["velocity"] == [[-1.0, None], [3.0, None]]


@pytest.mark.parametrize(
    "wrong",
    [
        (-1.0, -2.0), (1.0, -2.0), (0.0, 2.0), (-1.0, 0.0), (None, 2.0), (-np.inf, 2.0), (-1.0, np.nan), ([1.0, 2.0], 3.0),
        ([-1.0, -2.0], [1.0, 2.0, 3.0]), (-1.0, 2.0, 3.0), ([-1.0, 2.0], 3.0), ("-1", 2.0), [[-1.0], [[2.0]]],
    ],
)  # fmt: skip
def test_what_is_no_pair_is_refused_by_name(wrong: Any) -> None:
    with pytest.raises(InvalidInput, match="acceleration"):
        MotionLimits(acceleration=wrong)


def test_limits_without_two_sides_say_so() -> None:
    with pytest.raises(InvalidInput, match="jerk has no two sides"):
        MotionLimits(jerk=(-1.0, 2.0))
    with pytest.raises(InvalidInput, match="velocity: expected numbers or 6"):
        MotionLimits(([-1.0, -2.0], 3.0)).bounds(6)


def test_rows_are_at_most_one_exactly_where_the_value_is_between_its_sides() -> None:
    joints, rng = default_joint_path(), np.random.default_rng(shift_seed(8))
    s, v, a = rng.uniform(0.0, joints.end, 400), rng.uniform(0.0, 2.0, 400), rng.uniform(-15.0, 15.0, 400)
    at = PathPoints(joints, s)
    q1, q2 = joints(s, 1), joints(s, 2)
    values = {"velocity": q1 * v[:, None], "acceleration": q1 * a[:, None] + q2 * v[:, None] ** 2}
    for name, rates in (("velocity", (v,)), ("acceleration", (v, a))):
        lower, upper = LIMITS.bounds(6)[name]
        inside = (values[name] >= lower) & (values[name] <= upper)
        rows = LIMITS.rows(name, at)
        asked = np.einsum("kmi,ik->km", rows, np.stack(monomials(rates, full=rows.shape[2] == 4)))
        assert rows.shape[2] == (1 if name == "velocity" else 4)
        assert 0.1 < inside.mean() < 0.9
        assert ((np.abs(asked) <= 1.0) == inside).all()
        wanted = np.maximum(values[name] / upper, values[name] / lower)
        np.testing.assert_allclose(LIMITS.ratios(name, at, rates), wanted, rtol=1e-12)
    slower = LIMITS.ratios("acceleration", at, (v / 2.0, a / 4.0))
    np.testing.assert_allclose(slower, LIMITS.ratios("acceleration", at, (v, a)) / 4.0, rtol=1e-12)


def test_a_free_joint_has_no_ratio_and_no_row() -> None:
    limits = MotionLimits(acceleration=([-1.0, -np.inf, -3.0, -1.0, -1.0, -1.0], [2.0, np.inf, 2.0, 2.0, 2.0, 2.0]))
    joints = default_joint_path()
    rows = limits.rows("acceleration", PathPoints(joints, np.linspace(0.0, joints.end, 9)))
    assert np.isfinite(rows).all() and not rows[:, 1].any()
    motion = random_trajectory(np.random.default_rng(1), n=6, smooth=3)
    proof = certify(paper6r(), default_line(), motion, limits)
    assert np.isnan(proof.acceleration.ratio[1]) and np.isfinite(np.delete(proof.acceleration.ratio, 1)).all()
    assert proof.acceleration.value[1] == motion.extrema(2).worst[1]


@pytest.mark.parametrize("seed", range(6))
def test_certificates_judge_each_side_by_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = random_trajectory(rng, n=6, smooth=3)
    lower, upper = -rng.uniform(0.2, 5.0, (2, 6)), rng.uniform(0.2, 5.0, (2, 6))
    limits = MotionLimits((lower[0], upper[0]), (lower[1], upper[1]))
    proof = certify(paper6r(), default_line(), motion, limits)
    for order, found in ((1, proof.velocity), (2, proof.acceleration)):
        dense = beyond(motion, order, lower[order - 1], upper[order - 1])
        assert (found.ratio >= dense * (1.0 - 1e-12)).all()
        np.testing.assert_allclose(found.ratio, dense, rtol=1e-4)
        for i in range(6):  # the value stands at its time, on the side that is named by the ratio
            y = motion(found.time[i], order)[i]
            side = upper[order - 1, i] if y > 0.0 else lower[order - 1, i]
            assert (abs(y), y / side) == pytest.approx((found.value[i], found.ratio[i]), rel=1e-6)
    both = limits.bounds(6)
    for k, (a, b) in enumerate(zip(motion.knots[:-1], motion.knots[1:], strict=True)):
        t = np.linspace(a, b - 1e-9, 2001)
        worst = max(
            float(np.maximum(y / both[f][1], y / both[f][0]).max())
            for f, y in (("velocity", motion(t, 1)), ("acceleration", motion(t, 2)))
        )
        assert proof.binding.ratio[k] == pytest.approx(worst, rel=1e-3)


@pytest.fixture(scope="module")
def plans() -> dict[str, Plan]:
    return {law: plan(paper6r(), default_line(), START, limits=LIMITS, timing=law, allow="jerk") for law in LAWS}


@pytest.mark.parametrize("law", LAWS)
def test_laws_keep_both_sides(law: str, plans: dict[str, Plan]) -> None:
    found = plans[law]
    assert found and found.certificate.is_valid, found.certificate.reasons
    motion, bounds = found.trajectory, LIMITS.bounds(6)
    ratios = [beyond(motion, i, *bounds[f]).max() for i, f in ((1, "velocity"), (2, "acceleration"))]
    assert max(ratios) <= 1.0 + 1e-9
    if law in ("smooth", "toppra", "optimal"):  # others may be bound by the jerk
        assert max(ratios) > 0.97
    nearer = plan(paper6r(), default_line(), START, limits=NEARER, timing=law)
    assert motion.duration <= nearer.trajectory.duration * (1.0 + 1e-9)


@pytest.mark.parametrize("law", ["toppra", "optimal"])
def test_the_wider_side_is_used(law: str, plans: dict[str, Plan]) -> None:
    nearer = plan(paper6r(), default_line(), START, limits=NEARER, timing=law)
    assert plans[law].trajectory.duration < (0.9 if law == "toppra" else 0.97) * nearer.trajectory.duration
    lower, upper = LIMITS.bounds(6)["acceleration"]
    assert beyond(plans[law].trajectory, 2, lower, np.minimum(-lower, upper)).max() > 1.2


def test_the_optimum_comes_near_the_same_programme_on_more_intervals(plans: dict[str, Plan]) -> None:
    finer = Optimal(intervals=400).run(plans["optimal"].joint_path, LIMITS)
    assert plans["optimal"].trajectory.duration < 1.002 * finer.duration


def test_reversing_a_path_exchanges_its_sides(plans: dict[str, Plan]) -> None:
    """Backwards in time a velocity changes its sign and an acceleration does not."""
    joints, line = default_joint_path(), default_line()
    back = type(line)(line.pose(line.end), line.pose(0.0))
    mirrored = MotionLimits((-VELOCITY[1], -VELOCITY[0]), ACCELERATION, LIMITS.jerk)
    start = joints(joints.end)
    assert plan(paper6r(), back, start, limits=mirrored, timing="smooth").trajectory.duration == pytest.approx(
        plans["smooth"].trajectory.duration, rel=1e-5
    )


def test_replan_slows_down_to_the_side_by_which_a_state_is_too_fast(plans: dict[str, Plan]) -> None:
    running = plans["smooth"]
    t = 0.5 * running.trajectory.duration
    dq = running.trajectory(t, 1)
    i = int(np.argmax(np.abs(dq)))
    low, high = (0.5 * abs(dq[i]), 4.0 * np.abs(dq).max()) if dq[i] < 0.0 else (4.0 * np.abs(dq).max(), 0.5 * dq[i])
    tight = MotionLimits((-low, high), 1e3, 1e5)
    found = replan(running, t, limits=tight)
    assert found and found.within_limits_from > 0.0
    after = found.trajectory(np.linspace(found.within_limits_from, found.trajectory.end, 500), 1)
    assert -low * (1.0 + 1e-9) <= after.min() and after.max() <= high * (1.0 + 1e-9)
