"""What a controller makes of points: against a plain interpolation, piece by piece, by solving for its coefficients."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Trajectory, certify, make_law
from planners.trajectory.trajectory import sample_states, simulate_controller
from tests import oracles
from tests.planners import cases
from tests.planners.cases import default_joint_path, default_line, paper6r

ORDERS = {"linear": 1, "cubic": 2, "quintic": 3}


def row(order: int, u: float, size: int) -> Array:
    """Derivative of (1, u, u², …)."""
    out = np.zeros(size)
    for power in range(order, size):
        out[power] = u ** (power - order) * float(np.prod(np.arange(power - order + 1, power + 1)))
    return out


def between(left: Array, right: Array, h: float, u: float, order: int) -> Array:
    """Derivative at u of the lowest polynomial with these values and derivatives (k, n) at 0 and h."""
    k = len(left)
    A = np.array([row(o, at, 2 * k) for at in (0.0, h) for o in range(k)])
    scale = h ** -np.arange(2 * k)  # solved in u / h, where the matrix is well conditioned
    weights = np.array([h ** (i % k) for i in range(2 * k)])
    coefficients = np.linalg.solve(A * scale * weights[:, None], np.vstack([left, right]) * weights[:, None])
    return np.asarray(row(order, u, 2 * k) @ (coefficients * scale[:, None]))


def exact(trajectory: Trajectory, t: float, order: int) -> Array:
    """Value of a derivative; where t is a knot, the mean of both sides."""
    x = trajectory.knots
    k = int(np.argmin(np.abs(x - t)))
    if abs(x[k] - t) > 1e-9 or k in (0, len(x) - 1):
        return oracles.value(trajectory, t, order)
    return 0.5 * (oracles.value(trajectory, t, order, k - 1) + oracles.value(trajectory, t, order, k))


def interpolation(trajectory: Trajectory, rate: float, kind: str, t: float, order: int) -> Array:
    """What a controller is at, told the states at n / rate and at the end; slow."""
    points = []
    while len(points) / rate < trajectory.end - 1e-6 / rate:
        points.append(len(points) / rate)
    points.append(trajectory.end)
    i = max(k for k in range(len(points) - 1) if points[k] <= t)
    left, right = (np.array([exact(trajectory, points[k], o) for o in range(ORDERS[kind])]) for k in (i, i + 1))
    return between(left, right, points[i + 1] - points[i], t - points[i], order)


@pytest.mark.parametrize("kind", ORDERS)
@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.integers(2, 3), st.floats(3.0, 60.0))
def test_it_is_what_plain_interpolation_makes_of_the_points(kind: str, seed: int, smooth: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    trajectory = cases.random_trajectory(rng, pieces=3, n=2, smooth=smooth)
    motion = simulate_controller(trajectory, rate, kind)
    assert motion.duration == trajectory.duration
    for t in rng.uniform(0.0, trajectory.end, 8):
        for order in range(4):
            expected = interpolation(trajectory, rate, kind, t, order)
            size = max(1.0, np.abs(expected).max(), rate**order * 1e-3)
            assert np.abs(motion(t, order) - expected).max() <= 1e-7 * size


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_states_are_the_exact_ones_and_the_mean_of_both_sides_where_acceleration_jumps(seed: int, smooth: int) -> None:
    rng = np.random.default_rng(seed)
    trajectory = cases.random_trajectory(rng, pieces=4, n=3, smooth=smooth)
    t = np.concatenate([trajectory.knots, rng.uniform(0.0, trajectory.end, 6)])
    for order, values in enumerate(sample_states(trajectory, t)):
        expected = np.array([exact(trajectory, x, order) for x in t])
        np.testing.assert_allclose(values, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def test_a_motion_told_at_its_own_quintic_knots_is_itself() -> None:
    trajectory = make_law("quintic").run(default_joint_path(), MotionLimits())
    again = simulate_controller(trajectory, 50.0, "quintic")
    np.testing.assert_allclose(again.knots, trajectory.knots, rtol=0, atol=1e-15)
    np.testing.assert_allclose(again(again.knots[:-1] + 0.007, 3), trajectory(again.knots[:-1] + 0.007, 3), atol=1e-5)


def test_the_certificate_says_what_each_interpolation_breaks() -> None:
    robot, path, limits = paper6r(), default_line(), MotionLimits.of(paper6r())
    trajectory = make_law("ruckig").run(default_joint_path(), limits)
    proofs = {k: certify(robot, path, simulate_controller(trajectory, 500.0, k), limits) for k in ORDERS}
    assert {k: p.continuous for k, p in proofs.items()} == {"linear": 0, "cubic": 1, "quintic": 2}
    assert proofs["linear"].worst("acceleration")[0] == np.inf
    assert proofs["cubic"].worst("jerk")[0] == np.inf
    assert np.isfinite(proofs["quintic"].worst("jerk")[0])
    off = {k: p.path_error.distance for k, p in proofs.items()}
    assert off["linear"] > 100 * off["cubic"]
    assert max(off["cubic"], off["quintic"]) < 1e-9


@pytest.mark.parametrize("T", [1.0, 1.0 + 1e-13, 0.9999999999, 0.0005, 1.0005])
def test_points_are_at_whole_periods_and_at_the_end_and_never_a_rounding_apart(T: float) -> None:
    c = np.zeros((6, 1, 1))
    c[:3, 0, 0] = 6 / T**5, -15 / T**4, 10 / T**3
    motion = simulate_controller(Trajectory(PPoly(c, [0.0, T])), 1000.0, "quintic")
    assert motion.duration == T
    n = motion.knots.size - 1
    np.testing.assert_array_equal(motion.knots[:-1], np.arange(n) / 1000.0)
    assert n == max(1, int(np.ceil(T * 1000.0 - 1e-6)))
    assert T * 1000.0 < 1 or np.diff(motion.knots).min() > 4e-4


@pytest.mark.parametrize(
    ("rate", "kind", "named"),
    [
        (0.0, "linear", "rate"),
        (np.nan, "linear", "rate"),
        (np.inf, "linear", "rate"),
        ("fast", "linear", "rate"),
        (1e9, "linear", "1,?000,?000 points"),
        (100.0, "septic", 'interpolation: expected "linear" or "cubic" or "quintic"; got .septic.'),
        (100.0, None, "interpolation"),
    ],
)
def test_what_cannot_be_meant_is_refused(rate: Any, kind: Any, named: str) -> None:
    trajectory = cases.random_trajectory(np.random.default_rng(0), smooth=3)
    with pytest.raises(InvalidInput, match=named):
        simulate_controller(trajectory, rate, kind)
