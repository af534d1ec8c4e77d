"""The bounds that certificates rest on, where their remainder is all there is: on one wide interval, never halved.

Each is compared with what it bounds, from below and from above: a bound that is too small is false, and one whose constants
are too large is found by cases in which it is an equality.
"""

from itertools import product
from math import comb, factorial
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import PPoly

from optik import JointLimits, Robot
from optik.types import Array
from planners import Arc, Line, Path, Polyline, Trajectory
from planners.certificate import bounds as motion_bounds
from planners.certificate import path_error as deviation
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.bounds import bezier_bound, joint_bounds, tool_bounds
from planners.certificate.path_error import PieceBounds, path_error, path_rates, product_bound
from planners.trajectory.curve import bell, quintic_through
from tests import oracles
from tests.planners.cases import START, default_joint_path, default_line, paper6r
from tests.seeds import shift_seed

ROUNDING = 1.0 + 1e-10
SAMPLES = 100_000


def spread(rng: np.random.Generator, *shape: int, decades: float = 2.0) -> Array:
    """Magnitudes so far apart that in some draws each one counts for all."""
    return np.asarray(10.0 ** rng.uniform(-decades, decades, shape))


# ---------------------------------------------------------------- a curve between its ends
def norms(curves: list[Polynomial], t: Array) -> Array:
    return np.linalg.norm([c(t) for c in curves], axis=0)


def hermite_of(curves: list[Polynomial], h: float) -> float:
    """`bezier_bound` of polynomials on [0, h], from their own ends and fourth derivatives."""
    ends = [np.array([c(t) for c in part]) for part in (curves, [c.deriv() for c in curves]) for t in (0.0, h)]
    fourth = norms([c.deriv(4) for c in curves], np.linspace(0.0, h, 20_001)).max()
    left, right, left_rate, right_rate = ends
    return float(bezier_bound(left, left_rate, right, right_rate, h, fourth))


@pytest.mark.parametrize("h", [1e-3, 0.7, 1.0, 20.0])
def test_a_curve_at_rest_in_zero_at_both_ends_comes_as_far_as_the_bound_says(h: float) -> None:
    """f = t² (h − t)² has f⁗ = 24 and its greatest value h⁴/16 = 24 h⁴/384."""
    zero = np.zeros(2)
    bound = bezier_bound(zero, zero, zero, zero, h, 24.0)
    assert bound == pytest.approx(h**4 / 16.0, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("seed", range(6))
def test_no_polynomial_passes_the_bound_from_its_ends(seed: int) -> None:
    rng = np.random.default_rng(seed)
    h = float(spread(rng, 1, decades=0.5)[0])
    bubble = Polynomial([0.0, 0.0, h * h, -2.0 * h, 1.0])
    for cubic in (0.0, 0.1, 10.0):  # nothing but the remainder, a part of it, little of it
        curves = [bubble * Polynomial(rng.normal(size=3)) + cubic * Polynomial(rng.normal(size=4)) for _ in range(3)]
        assert norms(curves, np.linspace(0.0, h, SAMPLES)).max() <= hermite_of(curves, h) * ROUNDING


# ---------------------------------------------------------------- joints
@pytest.mark.parametrize("seed", range(4))
def test_no_derivative_of_a_quintic_passes_its_taylor_sum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, h = 5, float(spread(rng, 1, decades=0.5)[0])
    derivatives = rng.choice([-1.0, 1.0], (1, 6, n)) * spread(rng, 1, 6, n)
    derivatives[..., 0] = np.abs(derivatives[..., 0])  # where all have one sign the end is the greatest
    D = np.empty((6, n))
    joint_bounds(derivatives[0], h, D)
    c = derivatives[0] / np.array([factorial(i) for i in range(6)])[:, None]
    t = np.linspace(0.0, h, SAMPLES // 10)
    for order in range(6):
        values = np.abs(oracles.piece_values(np.repeat(c[::-1, None], t.size, axis=1), t, order))
        assert (values.max(axis=0) <= D[order] * ROUNDING).all()
        assert values[-1, 0] == pytest.approx(D[order, 0], rel=1e-10)


# ---------------------------------------------------------------- the tool, from the joints
def test_the_bell_polynomials_are_those_of_the_textbook() -> None:
    rng = np.random.default_rng(0)
    for S in spread(rng, 300, 6):
        B = np.empty(6)
        bell(S, B)
        x1, x2, x3, x4, x5 = S[1:]
        wanted = [
            1.0, x1, x1**2 + x2, x1**3 + 3 * x1 * x2 + x3, x1**4 + 6 * x1**2 * x2 + 4 * x1 * x3 + 3 * x2**2 + x4,
            x1**5 + 10 * x1**3 * x2 + 15 * x1 * x2**2 + 10 * x1**2 * x3 + 10 * x2 * x3 + 5 * x1 * x4 + x5,
        ]  # fmt: skip
        np.testing.assert_allclose(B, wanted, rtol=1e-13)


def arm_of(fixed: Any, slides: Any, tool: Array) -> Robot:
    n = len(slides)
    limits = JointLimits(np.full(n, -1e5), np.full(n, 1e5))
    return Robot("drawn", np.array(fixed), np.array(slides), np.asarray(tool), limits)


def bounded(robot: Robot, dq: Array) -> tuple[Array, Array, Array]:
    """`tool_bounds` from derivatives (6, k, n) of the joints."""
    k = dq.shape[1]
    links = np.linalg.norm([*robot.fixed[:, :3, 3], robot.tool[:3, 3]], axis=1)
    position, rotation, spin = np.empty((k, 6)), np.empty((k, 6)), np.empty(k)
    D = np.ascontiguousarray(np.moveaxis(np.abs(dq), 0, 1))
    for i in range(k):
        spin[i] = tool_bounds(links, robot.prismatic, D[i], np.empty((2, 6)), position[i], rotation[i])
    return position, rotation, spin


def true_rates(robot: Robot, dq: Array) -> tuple[Array, Array, Array]:
    """The same of the motion itself at one instant, by power series: every bound holds at each instant by itself."""
    scale = np.array([factorial(i) for i in range(6)])
    T = oracles.fk_series(robot, dq / scale[:, None, None]) * scale[:, None, None, None]
    position = np.linalg.norm(T[..., :3, 3], axis=-1).T
    # RᵀR of each: the spectral norm without a singular value decomposition of each
    turn = np.sqrt(np.linalg.eigvalsh(np.swapaxes(T[..., :3, :3], -1, -2) @ T[..., :3, :3])[..., -1]).T
    spin = np.linalg.norm(oracles.turning_series(robot, dq / scale[:, None, None])[4], axis=-1) * scale[4]
    return position, turn, spin


def drawn_arm(rng: np.random.Generator) -> Robot:
    n = int(rng.integers(1, 8))
    far = spread(rng, n + 1, decades=1.0)  # long links and short ones
    fixed = [oracles.pose(rng.normal(size=3), x * rng.normal(size=3)) for x in far]
    return arm_of(fixed[:n], rng.random(n) < 0.3, fixed[n])


@pytest.mark.parametrize("samples", [SAMPLES // 5, pytest.param(5 * SAMPLES, marks=pytest.mark.soak)])
def test_no_motion_of_a_tool_is_faster_in_any_order_than_the_bounds_say(samples: int) -> None:
    rng, arms = np.random.default_rng(1), samples // 400
    for _ in range(arms):
        robot = drawn_arm(rng)
        k = 400
        scale = spread(rng, 6, 1, 1) * spread(rng, 1, k, 1, decades=0.5)
        dq = scale * rng.normal(size=(6, k, robot.n))
        for truth, bound in zip(true_rates(robot, dq), bounded(robot, dq), strict=True):
            first = 1 if bound.ndim == 2 else 0  # of order 0 there is none
            assert (truth.T[first:] <= bound.T[first:] * ROUNDING).all()


ACROSS, ALONG = oracles.pose([np.pi / 2, 0, 0], [0, 0, 0]), np.eye(4)
TIGHT = {
    "one joint turns, its tool across": (arm_of([ALONG], [False], oracles.trans(x=0.7)), "pr", 1.5),
    "two about one axis": (arm_of([ALONG, oracles.trans(x=0.4)], [False, False], oracles.trans(x=0.3)), "pr", 1.5),
    "one slides across one that turns": (arm_of([ALONG, ACROSS], [False, True], np.eye(4)), "p", 1.5),
    "one slides": (arm_of([ALONG], [True], np.eye(4)), "p", 1.0 + 1e-9),
    "one turns across another": (arm_of([ALONG, ACROSS], [False, False], np.eye(4)), "w", 1.8),
}
"""Arms whose motions come near to their bounds, in position, rotation or d⁴ω/dt⁴, and how near."""


@pytest.mark.parametrize("name", TIGHT)
def test_for_the_simplest_arms_the_bounds_are_nearly_reached(name: str) -> None:
    """Where one term of a bound counts for all others it is an equality, so each coefficient is found by itself."""
    robot, parts, near = TIGHT[name]
    rng, draws = np.random.default_rng(shift_seed(2)), 200
    signs = np.array(list(product((-1.0, 1.0), repeat=6))).T  # all of them, of all orders
    dq = (spread(rng, 6, draws, 1, robot.n, decades=4.0) * signs[:, None, :, None]).reshape(6, -1, robot.n)
    if "about one axis" in name:
        dq[1:, :, 1] = dq[1:, :, 0]
    dq[0] = rng.uniform(-3.0, 3.0, dq[0].shape) if "slides" not in name else 0.0
    if "slides" in name:
        dq[0, :, -1] = spread(rng, dq.shape[1], decades=4.0)
    for part, truth, bound in zip("prw", true_rates(robot, dq), bounded(robot, dq), strict=True):
        if part not in parts:
            continue
        truth, bound = (x.reshape(draws, len(signs.T), -1) for x in (truth, bound))
        ratio = (bound / np.maximum(truth, 1e-300)).min(axis=1)  # of the best signs
        first = 1 if part != "w" else 0
        assert (ratio[:, first:] >= 1.0 - 1e-9).all()
        assert (np.quantile(ratio[:, first:], 0.9, axis=0) <= near).all(), np.quantile(ratio, 0.9, axis=0)


# ---------------------------------------------------------------- the path, run through by a cubic s(t)
def cubic(s0: float, v0: float, s1: float, v1: float, h: float) -> Polynomial:
    """s(t) with these values and rates at 0 and h."""
    slope = (s1 - s0) / h
    return Polynomial([s0, v0, (3.0 * slope - 2.0 * v0 - v1) / h, (v0 + v1 - 2.0 * slope) / h**2])


def rates(limits: PieceBounds, s0: float, s1: float, v0: float, v1: float, h: float) -> Array:
    out = np.empty((2, 5))
    path_rates(limits, (s0, s1), (v0, v1), h, out)
    return out


@pytest.mark.parametrize("chunk", range(4))
def test_no_path_run_through_by_a_cubic_changes_faster_than_the_bounds_say(chunk: int) -> None:
    """p(s) of degree 4 with derivatives of all sizes and signs, composed with s(t): an exact polynomial in t."""
    rng = np.random.default_rng([3, chunk])
    for _ in range(25):
        h = float(spread(rng, 1, decades=0.5)[0])
        s0, v0, s1, v1 = rng.choice([-1.0, 1.0], 4) * spread(rng, 4, decades=1.5)
        s = cubic(s0, v0, s1, v1, h)
        t = np.linspace(0.0, h, SAMPLES // 100)
        low, high = s(t).min(), s(t).max()
        p = Polynomial(rng.normal(size=5) * spread(rng, 5) / [1, 1, 2, 6, 24])
        grid = np.linspace(
            min(s0, s1, s0 + v0 * h / 3, s1 - v1 * h / 3), max(s0, s1, s0 + v0 * h / 3, s1 - v1 * h / 3), 2001
        )
        assert grid[0] - 1e-9 <= low <= high <= grid[-1] + 1e-9
        b = np.array([[np.abs(p.deriv(k)(grid)).max() for k in range(1, 5)]] * 2)
        limits = PieceBounds(np.array([grid[0], grid[-1]]), b[None])
        out = rates(limits, s0, s1, v0, v1, h)
        np.testing.assert_array_equal(out[0], out[1])
        composed = p(s)
        for k in range(1, 5):
            truth = np.abs(composed.deriv(k)(t)).max()
            assert truth <= out[0, k] * (1.0 + 1e-5)  # b was sampled


def test_each_term_of_the_paths_rates_is_an_equality_somewhere() -> None:
    h, d = 1.7, 0.3
    one = np.eye(4)
    for k in range(4):  # p = sᵏ⁺¹/(k+1)! near 0 has but one derivative there
        limits = PieceBounds(np.array([-10.0, 10.0]), np.stack([one[k], one[k]])[None])
        # at constant speed: only b_k vᵏ
        out = rates(limits, 0.0, d * h, d, d, h)[0, 1:]
        np.testing.assert_allclose(out, np.where(np.arange(4) == k, d ** (k + 1.0), 0.0), rtol=1e-12, atol=1e-14)
        # from rest to rest: ṡ = 6 d t (h − t)/h³ comes to 1.5 d/h in the middle, though it is 0 at both ends
        v, a, j = 1.5 * d / h, 6.0 * d / h**2, 12.0 * d / h**3
        terms = [
            [v, a, j, 0.0],
            [0.0, v * v, 3 * v * a, 4 * v * j + 3 * a * a],
            [0, 0, v**3, 6 * v * v * a],
            [0, 0, 0, v**4],
        ]
        np.testing.assert_allclose(rates(limits, 0.0, d, 0.0, 0.0, h)[0, 1:], terms[k], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(rates(limits, d, 0.0, 0.0, 0.0, h)[0, 1:], terms[k], rtol=1e-12, atol=1e-14)


def test_a_path_counts_by_all_pieces_that_the_cubic_may_touch_and_no_other() -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        breaks = np.append(0.0, np.cumsum(rng.uniform(0.1, 1.0, 6)))
        bounds = spread(rng, 6, 2, 4)
        limits = PieceBounds(breaks, bounds)
        s0, s1 = rng.choice(breaks, 2) if rng.random() < 0.3 else rng.uniform(0.0, breaks[-1], 2)
        v0, v1 = rng.normal(size=2)
        h = float(rng.uniform(0.1, 1.0))
        v0 = np.clip(v0, -3 * s0 / h, 3 * (breaks[-1] - s0) / h)
        v1 = np.clip(v1, -3 * (breaks[-1] - s1) / h, 3 * s1 / h)
        hull = np.array([s0, s0 + v0 * h / 3.0, s1 - v1 * h / 3.0, s1])
        low, high = hull.min(), hull.max()
        touched = (breaks[:-1] <= high) & (breaks[1:] >= low)
        inside = (breaks[:-1] < high - 1e-9) & (breaks[1:] > low + 1e-9)
        j = abs(6.0 * (v0 + v1) / h**2 - 12.0 * (s1 - s0) / h**3)
        v = max(abs(v0), abs(v1)) + j * h * h / 8.0
        out = rates(limits, s0, s1, v0, v1, h)
        assert (out[:, 1] <= bounds[touched, :, 0].max(axis=0) * v * ROUNDING).all()
        if inside.any():
            assert (out[:, 1] * ROUNDING >= bounds[inside, :, 0].max(axis=0) * v).all()


@pytest.mark.parametrize("inside", [True, False])
def test_the_places_that_a_cubic_may_come_to_are_those_of_its_bezier_points_to_a_hair(inside: bool) -> None:
    """A piece of the path counts that its hull reaches by a millionth, and not one that it misses by as much."""
    h, hair = 0.8, 1e-6
    for s0, s1, v0, v1 in ((2.0, 2.3, 3.0, 0.1), (2.0, 2.3, 0.1, -3.0), (2.3, 2.0, -3.0, 0.1), (2.0, 1.7, 0.1, 3.0)):
        hull = np.array([s0, s0 + v0 * h / 3.0, s1 - v1 * h / 3.0, s1])
        low, high = hull.min() + (hair if inside else -hair), hull.max() + (-hair if inside else hair)
        above = hull.max() > max(s0, s1) + 0.1  # on which side it goes beyond its ends
        breaks = np.array([0.0, high, 6.0]) if above else np.array([0.0, low, 6.0])
        bounds = np.ones((2, 2, 4))
        bounds[1 if above else 0, :, 0] = 1e3
        v = rates(PieceBounds(np.array([0.0, 6.0]), np.ones((1, 2, 4))), s0, s1, v0, v1, h)[0, 1]
        assert rates(PieceBounds(breaks, bounds), s0, s1, v0, v1, h)[0, 1] == pytest.approx(
            (1e3 if inside else 1.0) * v
        )


# ---------------------------------------------------------------- the rotation between tool and path
def test_the_turn_between_two_rotations_about_one_axis_is_the_binomial_theorem() -> None:
    for a, b in ((1.0, 1.0), (0.3, 2.0), (5.0, 0.1), (0.0, 1.0), (1.0, 0.0)):
        A, B = np.power(a, np.arange(5.0)), np.power(b, np.arange(5.0))
        assert product_bound(A, B) == pytest.approx(np.sqrt(3.0) * (a + b) ** 4, rel=1e-12)
    for i in range(5):
        assert product_bound(np.eye(5)[i], np.eye(5)[4 - i]) == pytest.approx(np.sqrt(3.0) * comb(4, i), rel=1e-12)


def test_the_turn_between_a_tool_and_its_path_changes_no_faster_than_the_bound_says() -> None:
    """Frobenius' norm of d⁴(A Bᵀ)/dt⁴ by power series, from the spectral norms of what A and B do."""
    rng, k = np.random.default_rng(shift_seed(5)), 4000
    scale = np.array([factorial(i) for i in range(5)])[:, None, None]
    arms = [arm_of([np.eye(4)] * n, [False] * n, np.eye(4)) for n in (1, 3)]
    for first, second in product(arms, arms):
        drawn = [spread(rng, 5, k, 1) * rng.normal(size=(5, k, r.n)) for r in (first, second)]
        A, B = (oracles.fk_series(r, x / scale)[..., :3, :3] for r, x in zip((first, second), drawn, strict=True))
        E = sum(A[i] @ np.swapaxes(B[4 - i], -1, -2) for i in range(5)) * 24.0
        a, b = (np.linalg.norm(X * scale[..., None], ord=2, axis=(-2, -1)).T for X in (A, B))
        truth = np.linalg.norm(E, axis=(-2, -1))
        bound = np.array(
            [product_bound(x, y) for x, y in zip(np.ascontiguousarray(a), np.ascontiguousarray(b), strict=True)]
        )
        assert (truth <= bound * ROUNDING).all()
        if first.n == second.n == 1:  # two equal singular values of three
            assert np.quantile(bound / truth, 0.5) <= 2.0


# ---------------------------------------------------------------- the whole, with no interval halved
@pytest.fixture
def never_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every piece of a motion is one interval, whose bound stands as it is.

    Only what Python looks up is changed: compiled code would keep a changed constant, or not see it.
    """

    def whole(_: Any, bounds: Any) -> Any:
        pieces = bounds.knots.size - 1
        return np.arange(pieces), bounds.ends, np.ones(pieces + 1, np.bool_)

    monkeypatch.setattr(deviation, "ERROR_INTERVALS", 0)
    monkeypatch.setattr(deviation, "_first_intervals", whole)
    monkeypatch.setattr(motion_bounds, "SPEED_INTERVALS", 0)


def one_joint(robot: Robot, q: Array, joint: int, c: Array, h: float) -> Trajectory:
    """All joints still but one, whose coefficients (6,) are those of t⁰ to t⁵."""
    out = np.zeros((6, 1, robot.n))
    out[5, 0] = q
    out[:, 0, joint] += c[::-1]
    return Trajectory(PPoly(out, [0.0, h]))


SLIDES = arm_of([np.eye(4), oracles.pose([0.0, 0.4, 0.0], [0.2, 0.1, 0.5])], [False, True], oracles.trans(x=0.1))
TURNS = arm_of([np.eye(4), oracles.pose([0.5, 0.4, 0.0], [0.2, 0.1, 0.5])], [False, False], np.eye(4))


@pytest.mark.parametrize("h", [0.5, 3.0])
@pytest.mark.parametrize("size", [1e-7, 1e-5, 0.05])
def test_a_tool_that_leaves_its_path_only_between_two_instants_is_seen(
    never_halved: None, h: float, size: float
) -> None:
    """It stands on the path at both, at rest; between, one joint goes off and comes back as 16 u² (1 − u)²."""
    bubble = size * 16.0 * np.array([0.0, 0.0, 1.0 / h**2, -2.0 / h**3, 1.0 / h**4, 0.0])
    q = np.array([0.3, 0.2])
    for robot in (SLIDES, TURNS):
        start = robot.fk(q)
        line = Line(start, oracles.moved(start, np.cross(start[:3, 2], [0.3, 0.5, 0.1])))  # across what joint 2 does
        error, _ = path_error(robot, line, one_joint(robot, q, 1, bubble, h))
        if robot is SLIDES:
            assert size * (1.0 - 1e-9) <= error.distance <= size * (1.0 + 1e-6)
            assert error.angle <= 1e-9
        else:
            assert (
                size * (1.0 - 1e-9) <= error.angle <= (1.35 * size if size < 1e-4 else np.inf)
            )  # √(3/2), and products
            assert error.distance <= 1e-9


@pytest.mark.parametrize("h", [0.5, 3.0])
def test_a_tool_that_is_fast_only_between_two_instants_is_seen(never_halved: None, h: float) -> None:
    """Its speed and acceleration are zero at both; between, the speed is 16 u² (1 − u)² of its greatest."""
    fast = 0.8
    v = fast * 16.0 * Polynomial([0.0, 0.0, 1.0 / h**2, -2.0 / h**3, 1.0 / h**4])
    for robot in (SLIDES, TURNS):
        motion = one_joint(robot, np.array([0.3, 0.2]), 1, v.integ().coef, h)
        part = MotionAnalysis(robot, motion).tool_speed_bound(0 if robot is SLIDES else 1)[0]
        assert fast * (1.0 - 1e-9) <= part <= fast * (1.0 + 1e-9)


def far_off(rng: np.random.Generator, size: float) -> Trajectory:
    """Two wide quintics of six joints, smooth to the second derivative."""
    t = np.array([0.0, *np.cumsum(rng.uniform(0.3, 1.0, 2))])
    values = size * rng.normal(size=(3, 3, 6)) * np.array([1.0, 1.0, 3.0])[:, None, None]
    values[0] += START
    return Trajectory(quintic_through(t, *values))


def paths_from(start: Array) -> dict[str, Path]:
    def at(*x: float, turn: Any = (0.0, 0.0, 0.0)) -> Array:
        return oracles.moved(start, np.array(x), np.array(turn))

    return {
        "line": default_line(),
        "turning line": Line(start, at(-0.1, 0.05, 0.1, turn=(0.4, -0.5, 0.3))),
        "arc": Arc.about(start, start[:3, 3] + np.array([0.0, 0.05, 0.0]), [1.0, 0.0, 0.0], 2.0),
        "polyline": Polyline(
            [start, at(-0.1, 0, 0), at(-0.1, 0.1, 0, turn=(0.3, 0.1, 0))], blend=5e-3, blend_rotation=0.1
        ),
    }


def contradicted(path: Path, trajectory: Trajectory, count: int, *, over: float) -> None:
    """Compare the bounds of a motion with many of its instants, and see that they are not far above."""
    robot = paper6r()
    (error, _), fast = path_error(robot, path, trajectory), MotionAnalysis(robot, trajectory).tool_speed[0]
    joints = oracles.Joints(trajectory)
    t = np.linspace(0.0, trajectory.end, count)
    T = oracles.fk(oracles.PAPER, joints(t))
    truth = list(oracles.speeds(oracles.PAPER, joints, t).max(axis=0))
    # the least that any place of the path has of each, which is no more than where the motion is taken to be
    s = np.linspace(0.0, path.end, 400)
    at = path.pose(s)
    for part in (0, 1):
        some = T[:: max(1, count // 500)] if part or not isinstance(path, Line) else T
        if isinstance(path, Line) and not path.twist(0.0)[3:].any():  # exactly, at the nearest place of a straight line
            chord = path.goal[:3, 3] - path.start[:3, 3]
            u = np.clip((some[:, :3, 3] - path.start[:3, 3]) @ chord / (chord @ chord), 0.0, 1.0)
            near = np.tile(path.start, (len(some), 1, 1))
            near[:, :3, 3] += u[:, None] * chord
            truth.append(oracles.off_by(some, near)[part].max())
        else:
            gaps = np.array([oracles.off_by(some, np.tile(x, (len(some), 1, 1)))[part] for x in at[::8]]).min(axis=0)
            step = path.end / 400 * 4 * path.derivative_bounds()[part, 0]
            truth.append(max(gaps.max() - step, 0.0))
    for said, found in zip((*fast, error.distance, error.angle), truth, strict=True):
        assert found <= said * ROUNDING + 1e-12
    if np.isfinite(over):
        assert fast[0] <= over * truth[0]
        assert fast[1] <= over * truth[1]


@pytest.mark.parametrize("kind", ["line", "turning line", "arc", "polyline"])
@pytest.mark.parametrize("size", [1e-3, 0.05, 0.3])
def test_no_instant_contradicts_the_bounds_of_wide_pieces_far_off_their_path(
    never_halved: None, kind: str, size: float
) -> None:
    rng = np.random.default_rng(6)
    path = paths_from(default_line().start)[kind]
    contradicted(path, far_off(rng, size), 1000, over=np.inf)


@pytest.mark.parametrize("pieces", [1, 2, 4])
def test_a_motion_on_its_path_at_few_instants_only_is_bounded_between(never_halved: None, pieces: int) -> None:
    joint_path = default_joint_path()
    s = np.linspace(0.0, joint_path.end, pieces + 1)
    trajectory = Trajectory(
        quintic_through(s / joint_path.end, *(joint_path(s, k) * joint_path.end**k for k in range(3)))
    )
    contradicted(default_line(), trajectory, 5_000, over=np.inf)


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["line", "turning line", "arc", "polyline"])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("halved", [False, True])
def test_no_instant_contradicts_the_bounds_at_length(
    request: pytest.FixtureRequest, kind: str, seed: int, halved: bool
) -> None:
    if not halved:
        request.getfixturevalue("never_halved")
    rng = np.random.default_rng([7, seed])
    path = paths_from(default_line().start)[kind]
    for size in (1e-4, 1e-3, 0.02, 0.1, 0.5):
        contradicted(path, far_off(rng, size), SAMPLES, over=1.001 if halved else np.inf)


def test_a_slider_on_a_turning_link_counts_by_the_binomial_theorem() -> None:
    """A link that turns at a constant rate a carries a slider: |d^k (e^{iat} r)| ≤ Σ binomial(k, m) aᵐ |r^(k−m)|."""
    rng, a = np.random.default_rng(17), 1.7
    lengths, D = np.array([0.3, 0.2]), np.zeros((6, 2))
    D[1, 0], D[:, 1] = a, rng.uniform(0.5, 2.0, 6)
    B, P = np.zeros((3, 7)), np.zeros((3, 7))
    motion_bounds.link_bounds(lengths, np.array([False, True]), D, B, P)
    for k in range(7):
        slides = sum(comb(k, m) * a**m * D[k - m, 1] for m in range(max(0, k - 5), k + 1))
        assert B[1, k] == pytest.approx(a**k) and B[2, k] == pytest.approx(a**k)
        assert P[2, k] == pytest.approx(lengths[0] * (k == 0) + lengths[1] * a**k + slides, rel=1e-12)
