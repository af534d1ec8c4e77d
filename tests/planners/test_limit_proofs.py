"""Proofs of limits on coarse pieces, never divided, where what a proof adds to samples decides; and each term that it adds."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicHermiteSpline, PPoly

import optik
from optik.arm.limits import VelocityByPosition
from optik.types import Array
from planners import MotionLimits
from planners.certificate import analysis, bounds
from planners.certificate.analysis import MotionAnalysis
from planners.limits import AccelerationByVelocity, Grip, OpenContainer, Suction, Tray, kind_of
from planners.limits._bernstein import ROUNDING, multiply, on_pieces, proves_above
from planners.limits._combination import Combination
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through
from tests import oracles
from tests.planners.torques import random_loaded, values

COM = (0.01, 0.02, 0.05)
GOODS: dict[str, Any] = {
    "open_container": OpenContainer(0.3, "-z", COM),
    "tray": Tray(0.3, 4.0, (0.6, 0.0, -0.8), COM),
    "grip": Grip(0.4, 14.0, 1.3, "y", COM),
    "suction": Suction(0.4, 20.0, 1.3, "z", COM),
}
TILTS = ("open_container", "tray")
PLACE = np.deg2rad([10.0, -80.0, 95.0, -105.0, -90.0, 20.0])


def arm() -> optik.Robot:
    return optik.load("ur5e")


def bound_of(name: str, value: Any, n: int = 6) -> Any:
    return MotionLimits(extra={name: value}).bounds(n)[name]


class Whole(MotionAnalysis):
    """A motion of which every piece is one interval, whose bound stands as it is, with or without its remainder."""

    remainder = 1.0

    def prove_peak(self, key: Any, evaluate: Any, enclose: Any, excess: float) -> tuple[float, float]:
        def bound(first: Array, last: Array, h: Array, B: Array, P: Array) -> Array:
            return np.asarray(enclose(first, last, h, self.remainder * B, self.remainder * P))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(bounds, "PEAK_INTERVALS", 0)
            return bounds.prove_peak(self.bounds, evaluate, bound, excess)


class Bare(Whole):
    """One without: what the values at the ends alone say."""

    remainder = 0.0


def swings(rng: np.random.Generator, n: int, speed: float, h: float, q: Array) -> Trajectory:
    """One quintic of n joints from rest to rest, whose accelerations are 0 at both ends, too: q̇ = 16 v u² (1 − u)²."""
    size = speed * np.append(rng.uniform(0.5, 1.5, n) * rng.choice([-1.0, 1.0], n), np.zeros(q.size - n))
    c = 16.0 * h * np.array([0.0, 0.0, 0.0, 1.0 / 3.0, -0.5, 0.2])[::-1, None] * size
    c[5] = q
    return Trajectory(PPoly(c[:, None] / h ** np.arange(5, -1, -1.0)[:, None, None], [0.0, h]))


def specific_force(motion: Trajectory, com: Array, count: int = 2001) -> Array:
    """Specific force of a point of the tool in the tool's frame, its acceleration by differences of poses."""
    e = 1e-4 * motion.end
    t = np.linspace(e, motion.end - e, count)

    def place(at: Array) -> Array:
        T = oracles.fk(arm(), motion(at))
        return np.asarray(T[:, :3, 3] + T[:, :3, :3] @ com)

    a = (place(t + e) - 2.0 * place(t) + place(t - e)) / e**2
    R = oracles.fk(arm(), motion(t))[:, :3, :3]
    return np.einsum("kji,kj->ki", R, np.array([0.0, 0.0, -9.80665]) - a)


def ratio_of(name: str, value: Any, f: Array) -> Array:
    """Ratios of specific forces to a limit, by its definition."""
    along, across = f @ value.axis, np.linalg.norm(np.cross(f, value.axis), axis=1)
    if name in TILTS:
        return np.arctan2(across, -along) / (value.angle if name == "open_container" else np.arctan(0.25))
    if name == "grip":
        return 1.3 * np.maximum(across / (2.0 * 0.4 * 14.0), np.abs(along) / 14.0)
    return np.asarray(np.maximum(1.3 * (across / 0.4 + along) / 20.0, 0.0))


# ---------------------------------------------------------------- coarse motions
@pytest.mark.parametrize("name", GOODS)
def test_no_instant_of_a_coarse_motion_contradicts_what_is_proved_of_goods(name: str) -> None:
    """Angles above π/2 are refused, but not bounded."""
    rng, kind, bound, below = np.random.default_rng(1), kind_of(name), bound_of(name, GOODS[name]), 0
    for speed, h, tilted in ((0.3, 3.0, 0.3), (1.0, 3.0, 0.3), (2.0, 0.6, 0.3), (2.5, 9.0, 0.0)):
        for _ in range(4):  # upright with large tilts only by the acceleration to the axis that turns
            motion = swings(rng, 6 if tilted else 1, speed, h, PLACE + tilted * rng.normal(size=6))
            proved, bare = (kind.judge(each(arm(), motion), bound).ratio for each in (Whole, Bare))
            true = float(ratio_of(name, GOODS[name], specific_force(motion, np.array(COM), 601)).max())
            most = 0.5 * np.pi / kind.value(bound) if name in TILTS else np.inf
            assert min(true * (1.0 - 1e-6), most) <= proved
            below += bare < min(0.95 * true, most)
    assert below, "the remainder must decide"


def test_no_instant_of_a_coarse_motion_contradicts_what_is_proved_of_the_body() -> None:
    rng = np.random.default_rng(2)
    for speed, h in product((0.5, 3.0), (0.5, 3.0)):
        motion = swings(rng, 6, speed, h, PLACE)
        found, bare = (kind_of("body_speed").judge(each(arm(), motion), np.array([0.7])) for each in (Whole, Bare))
        t, e = np.linspace(0.0, h - 1e-6, 300), 1e-6
        one, two = (arm().frames(motion(x)) for x in (t, t + e))
        true = 0.0
        for link, *ends, _ in zip(*arm().shapes.capsules, strict=True):
            for end in ends if link else ():
                p = [T[:, link - 1, :3, :3] @ end + T[:, link - 1, :3, 3] for T in (one, two)]
                true = max(true, float(np.linalg.norm(p[1] - p[0], axis=1).max()) / e)
        assert bare.value < 1e-6 * true and true <= found.value == pytest.approx(0.7 * found.ratio)


def coarse(rng: np.random.Generator, n: int, size: float, pieces: int = 2) -> Trajectory:
    """Wide quintics of any states."""
    t = np.append(0.0, np.cumsum(rng.uniform(0.3, 0.9, pieces)))
    q, v, a = size * rng.normal(size=(3, pieces + 1, n)) * np.array([0.4, 1.0, 4.0])[:, None, None]
    return Trajectory(quintic_through(t, q, v, a))


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_speeds_that_fall_towards_either_end_are_proved_between_the_samples(turned: float) -> None:
    """The same motions towards the upper and the lower ends of ranges that are as far."""
    rng, n = np.random.default_rng(3), 6
    robot = arm().with_limits(lower=np.full(n, -2.0), upper=np.full(n, 2.0), velocity=np.full(n, 30.0))
    value = VelocityByPosition(rng.uniform(0.05, 0.3, n), rng.uniform(2.0, 9.0, n))
    kind = kind_of("velocity_by_position")
    joints = 0
    for _ in range(15):
        motion = coarse(rng, n, 0.5)
        motion = Trajectory(PPoly(turned * motion.coefficients, motion.knots))
        found = kind.judge(MotionAnalysis(robot, motion), bound_of("velocity_by_position", value))
        t = np.unique(
            np.concatenate([np.linspace(a, b, 4001) for a, b in zip(motion.knots[:-1], motion.knots[1:], strict=True)])
        )
        q, v = motion(t), motion(t, 1)
        room = np.maximum(2.0 - np.sign(v) * q, 0.0)
        most = np.minimum(30.0, np.sqrt(2.0 * value.deceleration * room) - value.offset)
        true = np.where(most > 0.0, np.abs(v) / np.where(most > 0.0, most, 1.0), np.where(v == 0.0, 0.0, np.inf)).max(
            axis=0
        )
        joints += np.isfinite(true).sum()
        assert (true * (1.0 - 1e-9) <= found.ratio).all()
        assert (found.ratio <= 1.1 * true + 1e-9)[np.isfinite(true) & (true < 3.0)].all()
    assert joints > 60


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_a_joint_without_a_deceleration_is_judged_by_its_velocity_in_either_direction(turned: float) -> None:
    robot = arm().with_limits(velocity=np.full(6, 2.0))
    c, slope = np.zeros((6, 1, 6)), 3.0
    c[2:5, 0, 2] = turned * np.array([-slope / 3.0, 0.33 * slope, 2.0 - 0.33**2 * slope])  # q̇ = 2 − 3 (t − 0.33)²
    value = VelocityByPosition(np.zeros(6), np.full(6, np.inf))
    found = kind_of("velocity_by_position").judge(MotionAnalysis(robot, Trajectory(PPoly(c, [0.0, 1.0]))), value)
    assert 1.0 <= found.ratio[2] <= 1.1 and not np.delete(found.ratio, 2).any()
    assert found.time[2] == pytest.approx(0.4) and found.value[2] == pytest.approx(2.0 - slope * 0.07**2)


def test_accelerations_that_fall_with_the_speed_are_exact_on_coarse_pieces() -> None:
    rng, value = np.random.default_rng(4), AccelerationByVelocity(8.0, 11.0, 3.0)
    for _ in range(10):
        motion = coarse(rng, 6, 0.5)
        found = kind_of("acceleration_by_velocity").judge(MotionAnalysis(arm(), motion), value)
        t = np.linspace(0.0, motion.end, 40_001)
        v, y = motion(t, 1), np.sign(motion(t, 1)) * motion(t, 2)
        true = np.maximum((y + 8.0 / 3.0 * np.abs(v)) / 8.0, -y / 11.0).max(axis=0)
        assert (true * (1.0 - 1e-9) <= found.ratio).all() and (found.ratio <= 1.002 * true).all()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_combinations_of_joints_are_exact_on_coarse_pieces(order: int) -> None:
    rng = np.random.default_rng(5)
    name = ("motor_velocity", "motor_acceleration", "motor_jerk")[order - 1]
    value = Combination(rng.normal(size=(3, 6)), rng.uniform(0.5, 3.0, 3))
    for _ in range(5):
        motion = coarse(rng, 6, 0.5)
        found = kind_of(name).judge(MotionAnalysis(arm(), motion), value)
        t = np.unique(np.concatenate([np.linspace(0.0, motion.end, 40_001), motion.knots, motion.knots - 1e-12])).clip(
            0.0
        )
        true = (np.abs(motion(t, order) @ np.array(value.matrix).T) / value.bound).max(axis=0)
        if order == 3:  # the acceleration is continuous
            assert not motion.jumps(2).max() > 1e-9
        np.testing.assert_allclose(found.ratio, true, rtol=1e-6)
        np.testing.assert_allclose(found.value, true * value.bound, rtol=1e-6)


# ---------------------------------------------------------------- polynomials above a value
@pytest.mark.parametrize("degree", [1, 4, 8])
def test_a_polynomial_is_proved_above_what_lies_just_below_its_minimum(degree: int) -> None:
    """Alone, and where another one is above 0; both on many pieces of which one decides."""
    rng, u = np.random.default_rng(degree), np.linspace(0.0, 1.0, 20_001)
    for _ in range(40):
        c, where = rng.normal(size=(degree + 1, 3)), rng.normal(size=(4, 3))
        value, there = (np.array([Polynomial(x)(u) for x in given.T]) for given in (c, where))
        least = value.min()
        assert proves_above(c, least - 1e-6) and not proves_above(c, least + 1e-6)
        if (there > 0.0).any():
            least = value[there > 0.0].min()
            assert proves_above(c, least - 1e-3, where=where) and not proves_above(c, least + 1e-3, where=where)
    one = np.ones((2, 1)) * [[1.0], [0.0]]
    assert proves_above(one, 1.0 + 0.9 * ROUNDING) and not proves_above(one, 1.0 + 1.1 * ROUNDING)
    assert proves_above(c, 1e9, where=-np.ones((1, 3)))


def test_polynomials_of_pieces_are_those_of_the_motion() -> None:
    rng = np.random.default_rng(6)
    motion, u = coarse(rng, 2, 1.0), np.linspace(0.0, 1.0, 5)
    h = np.diff(motion.knots)
    for order, k, i in product(range(3), range(2), range(2)):
        c = on_pieces(motion, order)[:, k, i]
        inside = motion.knots[k] + h[k] * u[:-1]
        np.testing.assert_allclose(Polynomial(c)(u[:-1]), motion(inside, order)[:, i], rtol=1e-9, atol=1e-9)
    a, b = rng.normal(size=(5, 2)), rng.normal(size=(3, 2))
    for i in range(2):
        np.testing.assert_allclose(multiply(a, b)[:, i], (Polynomial(a[:, i]) * Polynomial(b[:, i])).coef, rtol=1e-12)


# ---------------------------------------------------------------- what one interval adds
class Interval(MotionAnalysis):
    """A motion that hands out what `prove_peak` is given, and says a ratio of 2 at 0.5 s."""

    def prove_peak(self, key: Any, evaluate: Any, enclose: Any, excess: float) -> tuple[float, float]:
        self.given = SimpleNamespace(evaluate=evaluate, enclose=enclose, excess=excess)
        return 2.0, 0.5


def given_of(robot: optik.Robot, name: str, bound: Any) -> Any:
    rng = np.random.default_rng(7)
    motion = Interval(robot, coarse(rng, robot.n, 0.5))
    found = kind_of(name).judge(motion, bound)
    assert np.all(found.ratio == 2.0) and np.all(found.time == 0.5)
    return motion.given


def sphere(rng: np.random.Generator, count: int = 20_000) -> Array:
    u = rng.normal(size=(count, 3))
    return np.asarray(u / np.linalg.norm(u, axis=1)[:, None])


@pytest.mark.parametrize("name", GOODS)
def test_a_ball_of_forces_is_measured_by_its_worst_point(name: str) -> None:
    rng, value, kind = np.random.default_rng(8), GOODS[name], kind_of(name)
    ball = sphere(rng)
    for f in rng.normal(size=(12, 3)) * [4.0, 4.0, 9.0]:
        off = float(rng.uniform(0.05, 0.95)) * float(np.linalg.norm(f))
        found = float(kind.measure(value, 1.3, f[None], off)[0])
        true = float(ratio_of(name, value, f + off * ball).max())
        most = np.pi / kind.value(value) if name in TILTS else np.inf
        assert true * (1.0 - 1e-12) <= found and min(found, most) <= 1.02 * true + 1e-9
        assert float(kind.measure(value, 1.3, f[None])[0]) == pytest.approx(
            ratio_of(name, value, f[None])[0], abs=1e-12
        )


def test_the_forces_of_one_interval_are_bounded_by_leibnizs_rule() -> None:
    """Each product of a rotation's and a point's derivative by itself, and all of them together."""
    rng, g, kind, value = np.random.default_rng(9), 9.80665, kind_of("suction"), GOODS["suction"]
    robot = arm()
    given = given_of(robot, "suction", value)
    away = np.linalg.norm(robot.tool[:3, 3] + robot.tool[:3, :3] @ COM)
    assert given.excess == 1e-5
    for b, p in [*product(range(5), range(2, 7)), (None, None)]:
        B, P = np.zeros((1, 7, 7)), np.zeros((1, 7, 7))
        if b is None:
            B, P = rng.uniform(0.1, 1.0, (2, 1, 7, 7))
        else:
            B[0, -1, b], P[0, -1, p] = 1.7, 2.3
        first, last, h = rng.normal(size=(1, 7)), rng.normal(size=(1, 7)), rng.uniform(0.5, 2.0, 1)
        R, x = B[0, -1], P[0, -1] + away * B[0, -1]
        fourth = R[4] * (g + x[2]) + 4.0 * R[3] * x[3] + 6.0 * R[2] * x[4] + 4.0 * R[1] * x[5] + x[6]
        slope = h[0] / 3.0
        hull = [first[0, 1:4], first[0, 1:4] + slope * first[0, 4:], last[0, 1:4] - slope * last[0, 4:], last[0, 1:4]]
        wanted = max(float(kind.measure(value, 1.3, f[None], h[0] ** 4 / 384.0 * fourth)[0]) for f in hull)
        assert given.enclose(first, last, h, B, P)[0] == pytest.approx(wanted, rel=1e-12)


def test_forces_and_their_rates_are_those_of_differences() -> None:
    rng, robot = np.random.default_rng(10), arm()
    given = given_of(robot, "suction", GOODS["suction"])
    motion = coarse(rng, 6, 0.5, 1)
    f = specific_force(motion, np.array(COM), 4001)
    e = 1e-4 * motion.end
    t = np.linspace(e, motion.end - e, 4001)
    states = np.zeros((t.size, 6, 6))
    states[:, :4] = np.stack([motion(t, order) for order in range(4)], axis=1)
    found = given.evaluate(states)
    scale = np.abs(f).max()
    np.testing.assert_allclose(found[:, 1:4], f, atol=1e-5 * scale)
    np.testing.assert_allclose(found[:, 0], ratio_of("suction", GOODS["suction"], found[:, 1:4]), rtol=1e-12)
    slope = (found[2:, 1:4] - found[:-2, 1:4]) / (t[2] - t[0])
    np.testing.assert_allclose(found[1:-1, 4:], slope, atol=1e-4 * np.abs(slope).max())


def test_the_speeds_of_one_interval_add_the_third_derivatives_of_each_capsule() -> None:
    rng, robot = np.random.default_rng(11), arm()
    given = given_of(robot, "body_speed", np.array([0.4]))
    link, first, second, radius = robot.shapes.capsules
    assert given.excess == 1e-4
    for _ in range(20):
        B, P = 10.0 ** rng.uniform(-2.0, 2.0, (2, 1, robot.n + 1, 7))
        one, other = rng.uniform(0.1, 2.0, (2, 1, 1 + link.size))
        h = rng.uniform(0.2, 1.5, 1)
        wanted = 0.0
        for k, m in enumerate(link):
            third = P[0, m, 3] + (max(np.linalg.norm(first[k]), np.linalg.norm(second[k])) + radius[k]) * B[0, m, 3]
            wanted = max(wanted, max(one[0, 1 + k], other[0, 1 + k]) + (h[0] ** 2 / 8.0 * third / 0.4 if m else 0.0))
        assert given.enclose(one, other, h, B, P)[0] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("rate", [False, True])
def test_the_motor_torques_of_one_interval_are_a_cubics_with_friction_and_a_remainder(
    rate: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("TORQUE_INTERVALS", "FEW_INTERVALS"):  # nothing is divided
        monkeypatch.setattr(analysis, name, 0)
    rng, kind = np.random.default_rng(12), kind_of("motor_torque_rate" if rate else "motor_torque")
    robot = random_loaded(rng, 3, prismatic=False, coulomb=0.4).with_motors(np.eye(3) + 0.3 * rng.normal(size=(3, 3)))
    motors, T, seen, one_sided = robot.motors, rng.normal(size=(3, 3)), set(), list[bool]()
    value, E = Combination(T, rng.uniform(1.0, 3.0, 3)), np.linalg.inv(motors.matrix)
    plain = replace(robot, motors=None)
    for _ in range(60):
        motion = coarse(rng, 3, rng.uniform(0.1, 1.0), 1)
        t = motion.knots
        v, a, j = (motion(t, order) @ E.T for order in (1, 2, 3))
        axes = values(plain, motion, t, plain.loads[0])
        tau = axes[:, 0] @ T.T + motors.inertia * a + motors.viscous * v
        slope = axes[:, 1] @ T.T + motors.inertia * j + motors.viscous * a
        fourth = np.abs(T) @ MotionAnalysis(plain, motion).torques.ends[0].fourths[0]
        fourth += motors.viscous * np.abs(E @ (120.0 * motion.padded[0, 0]))
        turns = motion(np.linspace(*t, 2001), 1) @ E.T
        found = kind.judge(MotionAnalysis(robot, motion), value).value
        for i in range(3):
            cubic = CubicHermiteSpline(t, tau[:, i], slope[:, i])
            curve = cubic.derivative() if rate else cubic
            peaks = curve(np.append(t, [x for x in curve.derivative().roots() if t[0] <= x <= t[1]]))
            h, f = t[1] - t[0], 0.0 if rate else motors.coulomb[i]
            off = fourth[i] * (np.sqrt(3.0) * h**3 / 216.0 if rate else h**4 / 384.0)
            both = np.abs(peaks).max() + off + f
            if f == 0.0 or turns[:, i].min() < 0.0 < turns[:, i].max():
                assert found[i] == pytest.approx(both, rel=1e-9)
                continue
            sign = np.sign(turns[1000, i])
            one = max(peaks.max() + off + sign * f, off - peaks.min() - sign * f)
            assert min(abs(found[i] - one), abs(found[i] - both)) <= 1e-9 * both
            one_sided.append(bool(abs(found[i] - one) <= 1e-9 * both))
            seen |= {(sign, one_sided[-1])}
    assert rate or ({(1.0, True), (-1.0, True)} <= seen and np.mean(one_sided) > 0.5)
