"""Kernels of streams, small enough for plain Python: pace, tracking and phases against plain evaluations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from planners import MotionLimits
from planners.streams import motion
from planners.streams.interior import _add_transposed, make_factors, make_stencils
from planners.streams.motion import ACCELERATION_PART, VELOCITY_PART, JointCubics, sweep_pace, write_joint_rows
from planners.streams.reference import CUT, _list_instants, make_objective, track_targets
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through
from tests.planners.test_stream_certificate import bare, certify


def test_rows_and_largest_paces_are_those_of_the_lesser_sides() -> None:
    rng, k, n = np.random.default_rng(1), 40, 3
    R = rng.normal(size=(k, 4, n)) * 10.0 ** rng.uniform(-1.0, 1.0, (k, 4, n))
    limits = np.sort(rng.uniform(0.5, 3.0, (n, 4, 2)) * [-1.0, 1.0], axis=2)
    rows, cap = np.empty((k, n, 4)), np.empty(k)
    write_joint_rows(R, limits, 1.3, rows, cap)
    least = np.minimum(limits[:, :, 1], -limits[:, :, 0])
    wanted = np.minimum((VELOCITY_PART * least[:, 1] / R[:, 1]) ** 2, (least[:, 3] / np.abs(R[:, 3])) ** (2.0 / 3.0))
    np.testing.assert_allclose(cap, np.minimum(wanted.min(axis=1), 1.3**2), rtol=1e-12)
    assert len(np.unique(cap)) > k // 2
    a, x = rng.normal(size=(2, k, 1))
    value = R[:, 1] * a + R[:, 2] * x**2  # accelerations, over what is used of their range around its middle
    half, middle = 0.5 * (limits[:, 2, 1] - limits[:, 2, 0]), 0.5 * (limits[:, 2, 1] + limits[:, 2, 0])
    found = rows[..., 0] * a + rows[..., 1] * x**2 + rows[..., 2] * np.abs(x) + rows[..., 3]
    np.testing.assert_allclose(found, (value - middle) / (ACCELERATION_PART * half), rtol=1e-12)


def test_a_sweep_is_as_fast_as_its_rows_allow_and_ends_at_rest() -> None:
    """Against sweeps in small steps, of rows that differ from place to place."""
    rng, k = np.random.default_rng(2), 200
    s, cap = np.linspace(0.0, 3.0, k), rng.uniform(0.5, 2.0, 200)
    rows = np.zeros((k, 2, 4))
    rows[:, 0, 0], rows[:, 1, 0] = 1.0 / rng.uniform(0.5, 1.5, k), -1.0 / rng.uniform(0.5, 1.5, k)
    rows[:, :, 1], rows[:, :, 3] = 0.1 * rng.normal(size=(k, 2)), 0.2 * rng.normal(size=(k, 2))
    x, t = np.empty(k), np.empty(k)
    sweep_pace(s, rows, cap, 1e-9, 0.0, x, t)
    step = 2.0 * np.diff(s)
    rate = np.diff(x) / step
    value = rows[:-1, :, 0] * rate[:, None] + rows[:-1, :, 1] * x[:-1, None] + rows[:-1, :, 3]
    assert x[-1] == 0.0 and (x <= cap + 1e-12).all() and (np.abs(value) <= 1.0 + 1e-5).all()
    at_cap, at_row = np.abs(x - cap) < 1e-5, np.append((np.abs(value) > 1.0 - 1e-4).any(axis=1), True)
    assert (at_cap | at_row | np.append(at_cap[1:], True)).mean() > 0.9
    np.testing.assert_allclose(np.diff(t), step / (np.sqrt(x[:-1]) + np.sqrt(x[1:])), rtol=1e-9)


def test_a_smoothed_pace_is_the_mean_of_a_centred_window() -> None:
    rng, width, first = np.random.default_rng(3), 0.4, 0.7
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.2, 30)))
    s = np.append(0.2, 0.2 + np.cumsum(rng.uniform(0.0, 0.3, 30)))
    when, out = np.linspace(0.0, t[-1] + 0.5, 40), np.empty(40)
    motion.smooth_pace(s, t, first, width, when, out)
    u = (np.arange(20_000) + 0.5) / 20_000 - 0.5
    for at, found in zip(when, out, strict=True):
        x = at + width * u
        mean = np.where(x < 0.0, s[0] + first * x, np.interp(x, t, s)).mean()
        assert found == pytest.approx(min(mean, s[-1]), abs=1e-5)
    assert out[-1] == s[-1]


LIMITS = MotionLimits(velocity=(-1.5, 1.2), acceleration=(-6.0, 8.0), jerk=90.0)


def box(most: float) -> np.ndarray:
    """Limits (3, 4, 2) of position to jerk."""
    sides = [[-most, 0.8 * most], [-1.5, 1.2], [-6.0, 8.0], [-90.0, 90.0]]
    return np.tile(np.array(sides), (3, 1, 1))


@pytest.mark.parametrize("speed", [0.8, 1e-3, 1e-7, 0.0])
@pytest.mark.parametrize("jerk", [9.0, -0.5, 0.0])
def test_targets_are_tracked_within_the_limits_from_any_state(speed: float, jerk: float) -> None:
    """From fast states and from those just after a start, with an acceleration that begins."""
    rng = np.random.default_rng(5)
    state = np.stack([rng.normal(size=3), speed * rng.normal(size=3), jerk * rng.uniform(0.3, 0.6, 3)])
    when = np.arange(0.0, 1.2, 0.02)
    target = state[0] + 0.25 * np.sin(1.2 * when[:, None] * [1.0, 0.5, -0.8]) ** 2
    failed, _, knots, count, c = track_targets(state, box(9.0), when, target, 0.04, 10**6)
    assert failed < 0
    curve = JointCubics(knots, count, c)
    proof = certify(curve, state, LIMITS, bare(3, 9.0))
    assert proof.is_valid, proof.reasons
    assert 1.2 <= curve.end <= 2.6
    off = np.abs(curve.trajectory(when) - target)
    assert off[when > 0.7].max() < 0.02 if speed < 0.5 else off[-1].max() < 0.05
    np.testing.assert_allclose(curve.trajectory(curve.end), target[-1], atol=5e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("case", ["velocity ahead", "velocity", "acceleration", "beyond rounding", "range"])
def test_states_on_a_limit_are_left_within_the_limits(case: str, side: float) -> None:
    """A velocity that is reached when the acceleration ends; the largest velocity; accelerations; a range to stop in."""
    v, a, j = (1.2, 8.0, 90.0) if side > 0.0 else (-1.5, -6.0, -90.0)
    states = {
        "velocity ahead": (0.0, v - 0.5 * (0.8 * a) ** 2 / j, 0.8 * a), "velocity": (0.0, v, 0.0),
        "acceleration": (0.0, 0.1 * v, a),
        "beyond rounding": (0.0, 0.1 * v, a * (1.0 + 5e-7)),
        "range": (9.0 * (0.8 if side > 0.0 else 1.0) * side - 0.4 * side, 0.5 * side, 0.0),
    }  # fmt: skip
    state = np.tile(np.array(states[case])[:, None], (1, 3)) * [1.0, 1.0, 0.0] + np.zeros((3, 3))
    when = np.arange(0.0, 1.0, 0.02)
    target = state[0] + 0.05 * side * when[:, None]
    failed, _, knots, count, c = track_targets(state, box(9.0), when, target, 0.04, 10**6)
    assert failed < 0
    found = certify(JointCubics(knots, count, c), state, LIMITS, bare(3, 9.0))
    assert found.is_valid or case == "beyond rounding", found.reasons
    assert all("acceleration" in words and t < 1e-6 for words, t, *_ in found.violations)


def test_the_objective_is_the_weighted_distance_and_jerk_of_a_spline() -> None:
    rng = np.random.default_rng(6)
    for N in (6, 9):
        T = np.append(0.1, 0.1 + np.cumsum(rng.uniform(0.02, 0.2, N)))
        f, A, H = np.empty((3, N + 3)), np.empty((9, N + 3)), np.empty((4, N + 3))
        make_factors(T, f), make_stencils(f, A)
        when, k = np.append(0.05, rng.uniform(T[0], T[-1], 12)), 13
        w, B, at = rng.uniform(0.5, 2.0, k), np.empty((k, 4)), np.empty(k, dtype=np.int64)
        make_objective(T, when, 1e-9 * w, A, H, B, at)
        spline = BSpline(np.concatenate([T[:1].repeat(3), T, T[-1:].repeat(3)]), np.eye(N + 3), 3)
        basis, jerk = spline(when[1:]), spline(0.5 * (T[1:] + T[:-1]), 3)
        full = 1e-9 * basis.T @ (w[1:, None] * basis) + CUT * jerk.T @ (np.diff(T)[:, None] * jerk)
        for d in range(4):
            np.testing.assert_allclose(H[d, d:], np.diag(full, -d), rtol=1e-7, atol=1e-9 * np.abs(full).max())
        assert at[0] == -1


def test_the_hold_after_the_last_target_counts_twice() -> None:
    T, when = np.linspace(0.0, 1.0, 11), np.array([0.0, 0.1, 0.2, 0.31])
    t, w = np.empty(20), np.empty(20)
    k = _list_instants(T, when, 0.1, t, w)
    np.testing.assert_allclose(t[:k], [*when, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    np.testing.assert_allclose(w[:k], [0.05] * 4 + [0.2] * 7)


def test_phases_are_joined_exactly_and_a_plan_is_entered_without_a_step() -> None:
    rng, transfer = np.random.default_rng(7), motion.Transfer(box(9.0))
    for k in range(6):
        state = rng.normal(size=(3, 3)) * [[1.0], [0.5], [2.0]]
        goal = np.zeros((3, 3))
        goal[0] = rng.normal(size=3)
        found = transfer.to_state(state, goal)
        assert found is not None
        proof = certify(found, state, LIMITS, bare(3, 9.0))
        assert proof.is_valid, proof.reasons
        np.testing.assert_allclose(found.trajectory(found.end), goal[0], atol=1e-12)
        x = np.array([0.0, 0.7, 1.5])
        other = Trajectory(
            quintic_through(x, 0.3 * np.cumsum(rng.normal(size=(3, 3)), axis=0), np.zeros((3, 3)), np.zeros((3, 3)))
        )
        t = float(rng.uniform(0.05, 1.4))
        there = np.stack([other(t, order) for order in range(3)])
        entry = transfer.to_state(state, there)
        assert entry is not None
        whole = entry.onto(other, t, there)
        assert certify(whole, state, MotionLimits(99.0, 999.0, 1e5), bare(3, 9.0)).discontinuity.max() < 1e-9
        assert whole.end == pytest.approx(entry.end + other.end - t, abs=1e-12)
        u = np.linspace(t, other.end, 9)
        np.testing.assert_allclose(whole(np.minimum(entry.end + u - t, whole.end)), other(u), atol=1e-9), k
    still = np.stack([np.ones(3), np.zeros(3), np.zeros(3)])
    rest = motion.join_states(still, still, np.zeros((3, 2)), np.zeros((3, 2)))
    assert 0.0 < rest.end < 0.01 and (rest.trajectory(rest.end) == 1.0).all()


def test_transposed_rows_are_those_of_the_stencils() -> None:
    rng = np.random.default_rng(11)
    T = np.cumsum(rng.uniform(0.01, 0.04, 9))
    N = T.size - 1
    f, A, w, g = np.empty((3, N + 3)), np.zeros((9, N + 3)), rng.normal(size=(4, N + 3)), rng.normal(size=N + 3)
    make_factors(T, f)
    make_stencils(f, A)
    wanted = g + w[0]
    for order, first in enumerate(
        (0, 2, 5), 1
    ):  # rows of velocity, acceleration and jerk, over 2, 3 and 4 control points
        for i in range(N + 3 - order):
            wanted[i : i + order + 1] += w[order, i] * A[first : first + order + 1, i]
    _add_transposed(f, w.copy(), g)
    np.testing.assert_allclose(g, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
