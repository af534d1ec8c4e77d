"""Proved bounds on torques and their rates: against Pinocchio, against samples of one wide interval, and in closed form."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from optik import DHRow, JointLimits, Robot
from optik.arm.inertia import Inertia
from optik.types import Array
from planners import Trajectory
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.effort import energy, find_torque_stretch, friction_steps
from planners.certificate.torque import cubic_range, direction, fourth_bounds, sizes, slope_range
from planners.trajectory.curve import quintic_through
from tests.oracles.torques import Torques
from tests.planners.torques import loaded, proved, random_loaded, swing, values

each_kind = pytest.mark.parametrize("rate", [False, True], ids=["torque", "rate"])
TORQUE_ROUNDING = 1e-9
"""What the polynomials' rounding may make of a torque, as a share of it."""


def dense(robot: Robot, trajectory: Trajectory, count: int, *, rate: bool) -> Array:
    """Largest values of samples, on both sides of the knots too, of all loads, with friction by the sign of the velocity."""
    beside = trajectory.knots[1:] * (1.0 - 1e-9)
    t = np.sort(np.concatenate([np.linspace(0.0, trajectory.end, count), trajectory.knots, beside]))
    found = []
    for load in robot.loads:
        out = values(robot, trajectory, t, load)
        friction = 0.0 if rate else load.coulomb * np.sign(trajectory(t, 1))
        found.append(np.abs(out[:, int(rate)] + friction).max(axis=0))
    return np.max(found, axis=0)


# ---------------------------------------------------------------- another library
def is_pinocchios(seed: int) -> None:
    """A motion's bounds against torques at 20 kHz by Pinocchio: none below, none far above."""
    pytest.importorskip("pinocchio")
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    robot = random_loaded(rng, n, prismatic=bool(seed % 3 == 0), coulomb=0.5 if seed % 2 else 0.0)
    motion = swing(rng, n, int(rng.integers(3, 12)), rng.uniform(0.05, 0.2))
    load = robot.loads[0]
    oracle = Torques(robot.fixed, robot.prismatic, load)
    t = np.linspace(0.0, motion.end, int(20000 * motion.end) + 2)
    q = [motion(t, order) for order in range(4)]
    torque = np.array([oracle.torque(*(x[k] for x in q[:3])) for k in range(t.size)])
    near = np.unique(np.concatenate([np.arange(0, t.size, 40), [0, t.size - 1]]))
    rates = np.array([oracle.rate(*(x[k] for x in q)) for k in near])
    sign = np.sign(q[1])
    sign[[0, -1]] = 0.0

    def largest(still: Array) -> Array:
        """Of all instants, with the whole set of friction where a joint is still."""
        either = np.maximum(np.abs(torque + load.coulomb), np.abs(torque - load.coulomb))
        return np.where(still, either, np.abs(torque + load.coulomb * sign)).max(axis=0)

    reversing = sign == 0.0  # or between this sample and the next, or the one before
    reversing[1:] |= sign[1:] * sign[:-1] < 0.0
    reversing[:-1] |= sign[1:] * sign[:-1] < 0.0
    for rate, found in ((False, largest(sign == 0.0)), (True, np.abs(rates).max(axis=0))):
        bound = proved(robot, motion, rate=rate).ratio
        assert (bound >= found * (1.0 - TORQUE_ROUNDING)).all()
        if not rate:
            assert (bound <= 1.002 * np.maximum(largest(reversing), 0.01)).all()


@pytest.mark.parametrize("seed", range(30))
def test_no_torque_of_pinocchios_is_above_the_bound(seed: int) -> None:
    is_pinocchios(seed)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1000, 1400))
def test_no_torque_of_pinocchios_is_above_the_bound_in_many_motions(seed: int) -> None:
    is_pinocchios(seed)


@each_kind
def test_the_bound_is_close_to_the_largest_sample(rate: bool) -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        robot = random_loaded(rng, 6, prismatic=seed % 2 == 0)
        motion = swing(rng, 6, 20, 1.0)
        bound, found = proved(robot, motion, rate=rate).ratio, dense(robot, motion, 20001, rate=rate)
        assert (bound >= found * (1.0 - TORQUE_ROUNDING)).all()
        assert (bound <= 1.002 * np.maximum(found, 0.01)).all()


# ---------------------------------------------------------------- one wide interval
def wide(rng: np.random.Generator, n: int, duration: float) -> Trajectory:
    """One quintic piece with derivatives of every order."""
    c = rng.normal(size=(6, 1, n)) / duration ** np.arange(5, -1, -1)[:, None, None]
    return Trajectory(PPoly(c, np.array([0.0, duration])))


@each_kind
@pytest.mark.parametrize("prismatic", [False, True], ids=["revolute", "sliding"])
def test_one_wide_interval_is_bounded_without_any_division(rate: bool, prismatic: bool) -> None:
    for seed, n in enumerate((1, 2, 3, 7)):
        rng = np.random.default_rng(seed)
        robot, motion = random_loaded(rng, n, prismatic=prismatic, coulomb=0.2), wide(rng, n, 0.5)
        bound = proved(robot, motion, rate=rate, most=0).ratio
        assert (bound >= dense(robot, motion, 100_001 if n == 7 else 20_001, rate=rate)).all()
        closer = proved(robot, motion, rate=rate).ratio
        assert (closer <= bound * (1.0 + TORQUE_ROUNDING)).all()


def is_below_its_bound(robot: Robot, seed: int) -> float:
    """The fourth derivative of the polynomial through samples of the torque against the bound; their largest ratio."""
    motion, load, width = wide(np.random.default_rng(seed), robot.n, 1.0), robot.loads[0], 0.05
    nodes = width * 0.5 * (1.0 - np.cos(np.pi * (np.arange(17) + 0.5) / 17))
    torque = values(robot, motion, nodes, load)[:, 0]
    D = np.abs(motion.padded[::-1, 0]) * np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0])[:, None]
    bound = np.empty(robot.n)
    fourth_bounds(sizes(robot, load), D, False, np.empty((2, robot.n + 1, 7)), bound)
    fit = [np.polynomial.chebyshev.Chebyshev.fit(nodes, x, 14, domain=[0.0, width]) for x in torque.T]
    fourth = np.abs([x.deriv(4)(0.0) for x in fit])
    assert (fourth <= 1.01 * bound + 1e-2).all()
    return float((fourth / np.maximum(bound, 1e-9)).max())


@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans())
def test_the_fourth_derivative_is_below_its_bound(seed: int, n: int, prismatic: bool) -> None:
    is_below_its_bound(random_loaded(np.random.default_rng(seed), n, prismatic=prismatic), seed)


def joints(*rows: DHRow, com: float, moment: float, mass: float = 1.0) -> Robot:
    """An arm without lengths and weight, whose last link alone has a mass."""
    n = len(rows)
    bare = Robot.from_mdh(list(rows), JointLimits(np.full(n, -9.0), np.full(n, 9.0)))
    masses, points, tensor = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    masses[-1], points[-1, 0] = mass, com
    tensor[-1] = np.diag([0.0, moment, moment])  # a rod along x
    return bare.with_inertia(Inertia(masses, points, tensor)).with_gravity(magnitude=0.0)


def test_every_part_of_the_bound_is_needed() -> None:
    """A rod that two crossing joints turn about its middle, a point that slides on an arm that turns, and one at an end."""
    turned = DHRow(0.0, 0.0, 0.0), DHRow(0.0, np.pi / 2, 0.0)
    sliding = DHRow(0.0, 0.0, 0.0), DHRow(0.0, np.pi / 2, 0.0, 0.0, True)
    for rows, com, moment in ((turned, 0.0, 0.3), (sliding, 0.0, 0.0), (turned, 0.4, 0.0)):
        near = [is_below_its_bound(joints(*rows, com=com, moment=moment), seed) for seed in range(8)]
        assert max(near) > 0.02


def pendulum(mass: float = 2.0, length: float = 0.5, *, gravity: float = 9.80665, coulomb: float = 0.0) -> Robot:
    """One joint that turns about a level axis, with a point mass."""
    tilted = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
    bare = Robot.from_mdh([DHRow(0.0, 0.0, 0.0)], JointLimits([-9.0], [9.0]), base=tilted)
    masses = Inertia([mass], [[length, 0.0, 0.0]], np.zeros((1, 3, 3)), coulomb=coulomb)
    return bare.with_inertia(masses).with_gravity(magnitude=gravity)


def turning(*pieces: tuple[float, tuple[float, ...]]) -> Trajectory:
    """One joint: durations and coefficients, highest power first."""
    c = np.zeros((6, len(pieces), 1))
    for k, (_, coefficients) in enumerate(pieces):
        c[6 - len(coefficients) :, k, 0] = coefficients
    return Trajectory(PPoly(c, np.cumsum([0.0, *(h for h, _ in pieces)])))


def test_a_pendulum_that_turns_evenly_has_the_bound_of_its_closed_form() -> None:
    robot, motion = pendulum(), turning((3.0, (2.0, -3.0)))
    weight = 2.0 * 0.5 * 9.80665
    found = proved(robot, motion, rate=False)
    assert found.ratio == pytest.approx([weight], rel=2e-5)
    assert abs(np.cos(motion(float(found.time[0]))[0])) == pytest.approx(1.0, abs=1e-4)
    assert proved(robot, motion, rate=True).ratio == pytest.approx([2.0 * weight], rel=2e-5)
    bound, still = np.empty(1), np.empty(1)
    D = np.array([[9.0], [2.0], [0.0], [0.0], [0.0], [0.0]])
    arm = sizes(robot, robot.loads[0])
    fourth_bounds(arm, D, True, np.empty((2, 2, 7)), still)
    assert still == pytest.approx([weight * 2.0**4], rel=1e-14)
    fourth_bounds(arm, D, False, np.empty((2, 2, 7)), bound)
    assert bound == pytest.approx([weight * 2.0**4 + 2.0 * 0.25 * 2.0**6 * 16.0], rel=1e-14)


# ---------------------------------------------------------------- Hermite interpolation
def test_the_remainders_are_those_of_peanos_kernel() -> None:
    """Largest integral over s of the kernels of value and rate: the constants in closed form."""
    x, s = np.linspace(0.0, 1.0, 401), (np.arange(2000) + 0.5) / 2000
    third = np.maximum(x[:, None] - s, 0.0) ** 3 / 6.0
    second = np.maximum(x[:, None] - s, 0.0) ** 2 / 2.0
    end, slope = (1.0 - s) ** 3 / 6.0, (1.0 - s) ** 2 / 2.0
    u = x[:, None]
    value = third - (3 * u**2 - 2 * u**3) * end - (u**3 - u**2) * slope
    rate = second - (6 * u - 6 * u**2) * end - (3 * u**2 - 2 * u) * slope
    assert np.abs(value).mean(axis=1).max() == pytest.approx(1.0 / 384.0, rel=1e-4)
    assert np.abs(rate).mean(axis=1).max() == pytest.approx(np.sqrt(3.0) / 216.0, rel=1e-3)


numbers = st.integers(-(10**6), 10**6).map(lambda k: 1e-3 * k)


@settings(max_examples=200)
@given(numbers, numbers, numbers, numbers, st.floats(1e-3, 10.0))
def test_ranges_of_cubics_hold_all_samples_and_are_reached(a: float, b: float, c: float, d: float, h: float) -> None:
    x = np.linspace(0.0, 1.0, 2001)
    y = a + (b - a) * (3 * x**2 - 2 * x**3) + h * c * (x - 2 * x**2 + x**3) + h * d * (x**3 - x**2)
    rates = (b - a) / h * (6 * x - 6 * x**2) + c * (1 - 4 * x + 3 * x**2) + d * (3 * x**2 - 2 * x)
    for (low, high), sample in ((cubic_range(a, b, c, d, h), y), (slope_range(a, b, c, d, h), rates)):
        size = np.abs(sample).max() + abs(a) + abs(b) + h * (abs(c) + abs(d)) + (abs(a) + abs(b)) / h
        assert low - 1e-12 * size <= sample.min() <= low + 1e-5 * size
        assert high - 1e-5 * size <= sample.max() <= high + 1e-12 * size


# ---------------------------------------------------------------- Coulomb friction
@settings(max_examples=100)
@given(st.integers(0, 10**6), st.floats(0.01, 1.0))
def test_a_direction_is_only_said_where_no_sample_contradicts(seed: int, h: float) -> None:
    rates = np.random.default_rng(seed).normal(size=5)
    sense = direction(rates, h)
    t = np.linspace(0.0, h, 501)
    velocity = rates[0] + t * (rates[1] + t * (rates[2] / 2 + t * (rates[3] / 6 + t * rates[4] / 24)))
    assert sense == 0 or (sense * velocity >= 0.0).all()


def test_friction_counts_by_the_sense_of_the_motion_and_on_both_sides_at_rest() -> None:
    robot = pendulum(gravity=0.0, coulomb=1.0)
    inertia = 2.0 * 0.25
    up = turning((1.0, (0.5 * 3.0, 1.0, 0.0)))  # q̈ = 3: friction adds to the torque
    assert proved(robot, up, rate=False).ratio == pytest.approx([3.0 * inertia + 1.0], rel=2e-5)
    down = turning((0.25, (-0.5 * 3.0, 1.0, 0.0)))  # it takes off, as long as the joint does not stop
    found = proved(robot, down, rate=False)
    assert found.ratio == pytest.approx([abs(-3.0 * inertia + 1.0)], rel=2e-5)
    back = turning((1.0, (-0.5 * 3.0, 1.0, 0.0)))  # it stops at 1/3 s: both sides there
    assert proved(robot, back, rate=False).ratio == pytest.approx([3.0 * inertia + 1.0], rel=2e-5)
    assert proved(robot, back, rate=False).found == pytest.approx([3.0 * inertia + 1.0], rel=1e-6)
    stopped = turning((1.0 / 3.0, (-0.5 * 3.0, 1.0, 0.0)))  # at its end alone
    assert proved(robot, stopped, rate=False).ratio == pytest.approx([3.0 * inertia + 1.0], rel=1e-6)
    held = turning((1.0, (0.3,)))
    assert proved(robot, held, rate=False).ratio == pytest.approx([1.0], rel=1e-12)
    assert proved(robot, back, rate=True).ratio <= 0.01  # finer than this share of a limit is not asked


def test_steps_of_friction_are_listed() -> None:
    robot = pendulum(coulomb=0.7)
    rest_to_rest = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    there = Trajectory(
        PPoly(np.stack([rest_to_rest, -rest_to_rest + [0, 0, 0, 0, 0, 1.0]], axis=1)[:, :, None], [0.0, 1.0, 2.0])
    )
    motion = MotionAnalysis(robot, there)
    steps = friction_steps(robot, there, motion.torques, motion.rest)
    assert [x for s in steps for x in (s.t, s.size)] == pytest.approx([0.0, 0.7, 1.0, 1.4, 2.0, 0.7])
    inside = turning((1.0, (-0.5 * 3.0, 1.0, 0.0)))
    motion = MotionAnalysis(robot, inside)
    steps = friction_steps(robot, inside, motion.torques, motion.rest)
    assert [(s.t, s.joint, s.size) for s in steps] == [
        (pytest.approx(1.0 / 3.0), robot.joint_names[0], pytest.approx(1.4))
    ]
    assert friction_steps(pendulum(), inside, MotionAnalysis(pendulum(), inside).torques, (False, False)) == ()


# ---------------------------------------------------------------- payload in an interval, sides, speed
@each_kind
def test_a_payload_in_an_interval_is_bounded_by_its_worst_end(rate: bool) -> None:
    robot, rng = loaded(), np.random.default_rng(8)
    motion = swing(rng, 6, 8, 0.8)
    between = proved(robot.with_payload((0.5, 4.0), com=(0.0, 0.05, 0.1)), motion, rate=rate).ratio
    each = [proved(robot.with_payload(m, com=(0.0, 0.05, 0.1)), motion, rate=rate).ratio for m in (0.5, 1.7, 4.0)]
    assert between == pytest.approx(np.maximum(each[0], each[2]), rel=1e-12)
    assert (between >= each[1]).all()


def test_each_side_is_judged_by_its_own_limit() -> None:
    robot, motion = loaded(), swing(np.random.default_rng(8), 6, 8, 0.8)
    torque = values(robot, motion, np.linspace(0.0, motion.end, 20001), robot.loads[0])[:, 0]
    lower, upper = -np.full(6, 3.0), np.full(6, 11.0)
    found = MotionAnalysis(robot, motion).torques.bound_ratios(np.stack([lower, upper]), rate=False)
    expected = np.maximum(torque.min(axis=0) / lower, torque.max(axis=0) / upper)
    assert found.ratio == pytest.approx(expected, rel=1e-3)
    assert (found.upper == (torque.max(axis=0) / upper >= torque.min(axis=0) / lower)).all()


@each_kind
@pytest.mark.parametrize("share", [0.6, 3.0])
def test_the_slowing_just_keeps_the_limit(rate: bool, share: float) -> None:
    robot, motion = loaded(coulomb=0.3), swing(np.random.default_rng(9), 6, 40, 0.8)
    standing = MotionAnalysis(robot, motion.stretched(1e3)).torques
    one = np.stack([-np.ones(6), np.ones(6)])
    still = 0.0 if rate else standing.bound_ratios(one, rate=rate).ratio
    size = still + share * (proved(robot, motion, rate=rate).ratio - still)
    bound = np.stack([-size, size])
    factor = find_torque_stretch(MotionAnalysis(robot, motion).torques, bound, rate=rate)
    assert (factor > 1.0) == (share < 1.0)
    slowed = MotionAnalysis(robot, motion.stretched(factor)).torques.bound_ratios(bound, rate=rate).ratio.max()
    assert slowed == pytest.approx(1.0, rel=1e-2)


def test_no_slowing_helps_against_gravity_and_none_is_needed_without_limits() -> None:
    robot, motion = loaded(), swing(np.random.default_rng(9), 6, 8, 0.8)
    torques = MotionAnalysis(robot, motion).torques
    assert find_torque_stretch(torques, np.full((2, 6), 1e-3) * [[-1.0], [1.0]], rate=False) == np.inf
    assert find_torque_stretch(torques, np.full((2, 6), np.inf) * [[-1.0], [1.0]], rate=False) == 0.0


def test_the_energy_is_what_goes_into_motion_and_height() -> None:
    """A pendulum that is raised without friction: its potential energy, and the area of the positive power."""
    robot, t = pendulum(), np.linspace(0.0, 1.5, 41)
    course = np.polynomial.Polynomial([-0.5, 0.0, 0.0, 20.0, -30.0, 12.0], domain=[0.0, 1.5], window=[0.0, 1.0])
    motion = Trajectory(
        quintic_through(t, *(course.deriv(k)(t)[:, None] if k else course(t)[:, None] for k in range(3)))
    )
    found = energy(MotionAnalysis(robot, motion).torques)
    heights = (robot.fk(motion(np.array([0.0, motion.end]))) @ [0.5, 0.0, 0.0, 1.0])[:, 2]
    assert found.net == pytest.approx(2.0 * 9.80665 * (heights[1] - heights[0]), rel=1e-7)
    x = np.linspace(0.0, motion.end, 100_001)
    power = values(robot, motion, x, robot.loads[0])[:, 0] * motion(x, 1)
    assert found.drawn == pytest.approx(float(np.maximum(power, 0.0).mean()) * motion.end, rel=1e-3)
    assert found.drawn > 1.005 * found.net
    assert found.power == pytest.approx(float(power.max()), rel=1e-2)


def test_sizes_are_of_the_arm_and_the_load() -> None:
    arm: Any = sizes(loaded(), loaded().loads[0])
    assert arm[0] == pytest.approx(np.linalg.norm(loaded().fixed[:, :3, 3], axis=1))
    assert arm[6] == pytest.approx(9.80665)
