import json
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly

from optik import JointLimits, Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners import Certificate, JointLine, Line, MotionLimits, Part, Program, Trajectory, certify, make_law, plan
from planners.certificate.certificate import describe_limiting
from planners.limits import DERIVATIVES
from planners.paths.base import Path
from planners.program.parts import Dwell
from planners.trajectory.curve import quintic_through
from tests import oracles
from tests.oracles import PAPER
from tests.planners import cases
from tests.planners.cases import START, default_joint_path, default_line, paper6r, step_of

ROBOT = paper6r()
ROOMY = MotionLimits(1e6, 1e9, 1e12)
NAMES = [f"joint{i + 1}" for i in range(6)]


def certified(
    trajectory: Trajectory, limits: MotionLimits = ROOMY, *, path: Path | None = None, **options: Any
) -> Certificate:
    return certify(ROBOT, path or default_line(), trajectory, limits, **options)


def judged(trajectory: Trajectory, limits: MotionLimits = ROOMY, **options: Any) -> Certificate:
    """Judged along the straight way in joint space from its start to its end, whatever the range of the joints."""
    wide = JointLimits(np.full(6, -10.0), np.full(6, 10.0))
    free = Robot("free", ROBOT.fixed, ROBOT.prismatic, ROBOT.tool, wide)
    way = JointLine(free, trajectory(0.0), trajectory(trajectory.end))
    return certified(trajectory, limits, path=way, **options)


def around_start(rng: np.random.Generator, smooth: int, size: float = 0.02, pieces: int = 4) -> Trajectory:
    """Random pieces for six joints near the default start, which meet in so many orders."""
    base = cases.random_trajectory(rng, pieces=pieces, n=6, smooth=smooth)
    c = size * base.coefficients
    c[5] += START
    return Trajectory(PPoly(c, base.knots))


def smooth_but(jump: int | None) -> Trajectory:
    """Two pieces of every joint that are one polynomial, but for one derivative of one joint; no rest."""
    motion = around_start(np.random.default_rng(2), 6, 0.01, pieces=2)
    c = motion.coefficients.copy()
    if jump is not None:
        c[5 - jump, 1, 3] += 0.003
    return Trajectory(PPoly(c, motion.knots))


def moving(joint: int, t: Array, v: Array, a: Array) -> Trajectory:
    """One joint with these velocities and accelerations at knots, positions by integration of the quintics' mean."""
    q = np.zeros_like(v)
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]  # ∫ of the cubic velocity through v and a at both ends
        q[k + 1] = q[k] + h * (v[k] + v[k + 1]) / 2 + h * h * (a[k] - a[k + 1]) / 12
    values = np.zeros((3, len(t), 6))
    values[0] = START
    values[0, :, joint] += q
    values[1, :, joint], values[2, :, joint] = v, a
    return Trajectory(quintic_through(t, *values))


# ---------------------------------------------------------------- exact worst values
@pytest.mark.parametrize("smooth", [0, 1, 2, 3])
def test_worst_values_equal_dense_brute_force(smooth: int) -> None:
    trajectory = around_start(np.random.default_rng(11), smooth)
    limits = MotionLimits(np.arange(1.0, 7.0), 10.0, 100.0)
    certificate = certified(trajectory, limits)
    assert certificate.continuous == smooth - 1
    bounds = (np.arange(1.0, 7.0), np.full(6, 10.0), np.full(6, 100.0))
    for order, (field, bound) in enumerate(zip(DERIVATIVES, bounds, strict=True), start=1):
        if smooth < order:  # what it is the derivative of jumps
            np.testing.assert_array_equal(getattr(certificate, field).value, np.inf)
            np.testing.assert_array_equal(getattr(certificate, field).ratio, np.inf)
            continue
        least, greatest, t_least, t_greatest = oracles.brute_extrema(trajectory, order, 40_000)
        worst = np.maximum(-least, greatest)
        extreme = getattr(certificate, field)
        np.testing.assert_allclose(extreme.value, worst, rtol=1e-9)
        np.testing.assert_allclose(extreme.ratio, worst / bound, rtol=1e-9)
        np.testing.assert_allclose(extreme.time, np.where(-least > greatest, t_least, t_greatest), rtol=0, atol=1e-4)
    least, greatest, _, _ = oracles.brute_extrema(trajectory, 0, 40_000)
    margin = np.minimum(least - ROBOT.limits.lower, ROBOT.limits.upper - greatest)
    np.testing.assert_allclose(certificate.position_margin, margin, rtol=0, atol=1e-12)


def test_a_violation_between_the_samples_of_a_controller_is_found() -> None:
    t = np.array([0.0, 0.5001, 0.5005, 0.5009, 1.0])
    trajectory = moving(2, t, np.array([0.1, 0.1, 0.3, 0.1, 0.1]), np.zeros(5))
    limits = MotionLimits(velocity=0.2)
    sampled, _ = trajectory.sample(1000.0)
    assert np.abs(trajectory(sampled, 1)).max() <= 0.15, "what a millisecond grid sees"
    certificate = certified(trajectory, limits, enforced=("velocity",))
    ratio, joint, when = certificate.worst("velocity")
    assert ratio >= 1.5 * (1.0 - 1e-12)
    assert joint == "joint3"
    assert 0.5001 < when < 0.5009
    assert not certificate.is_valid


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize(
    ("field", "peak", "when"),
    [("velocity", 15 / 8, (0.5,)), ("acceleration", 10 / np.sqrt(3), (0.2113, 0.7887)), ("jerk", 60.0, (0.0, 1.0))],
)
def test_each_broken_limit_is_reported_with_its_joint_and_time(joint: int, field: str, peak: float, when: Any) -> None:
    size, T = 0.04, 0.8
    order = DERIVATIVES.index(field) + 1
    limit = peak * size / T**order / 1.5
    trajectory = step_of(joint, size, T)
    broken = judged(trajectory, MotionLimits(**{"velocity": 1e6, "acceleration": 1e6, "jerk": 1e6} | {field: limit}))
    ratio, name, t = broken.worst(field)
    assert ratio == pytest.approx(1.5, rel=1e-12)
    assert name == NAMES[joint]
    assert min(abs(t - u * T) for u in when) <= 1e-4
    assert getattr(broken, field).ratio[joint] == ratio
    assert not broken.is_valid
    assert len(broken.reasons) == 1
    assert broken.reasons[0].startswith(f"{field} of {NAMES[joint]} is 1.5 of its limit at t = ")
    assert float(broken.reasons[0].split("t = ")[1].split()[0]) == pytest.approx(t, abs=1e-5)
    kept = judged(trajectory, MotionLimits(**{field: 1.5 * limit * (1 + 1e-12)}), enforced=(field,))
    assert kept.is_valid
    assert kept.reasons == ()


def test_only_the_joint_whose_own_limit_is_broken_is_named() -> None:
    trajectory = Trajectory(quintic_through(np.array([0.0, 1.0]), *_all_joints_move()))
    worst = trajectory.extrema(1).worst
    for joint in range(6):
        limit = 10.0 * worst
        limit[joint] = worst[joint] / 1.01
        certificate = judged(trajectory, MotionLimits(velocity=limit), enforced=("velocity",))
        assert certificate.worst("velocity")[1] == NAMES[joint]
        assert len(certificate.reasons) == 1
        assert f"velocity of {NAMES[joint]} is 1.01 " in certificate.reasons[0]


def _all_joints_move() -> Array:
    values = np.zeros((3, 2, 6))
    values[0] = START
    values[0, 1] += 0.01 * np.arange(1, 7)
    return values


def test_what_a_law_does_not_promise_is_shown_but_not_judged() -> None:
    trajectory = step_of(0, 0.04, 0.8)
    limits = MotionLimits(1e-3, 1e6, 1e6)
    assert judged(trajectory, limits, enforced=("acceleration", "jerk")).is_valid
    certificate = judged(trajectory, limits, enforced=())
    assert certificate.is_valid
    assert certificate.velocity.ratio[0] > 1.0
    assert not judged(trajectory, limits).is_valid


def test_where_there_is_no_limit_there_is_no_ratio() -> None:
    certificate = certified(step_of(1, 0.04, 0.8), MotionLimits(velocity=2.0), enforced=("velocity",))
    assert np.isnan(certificate.jerk.ratio).all()
    assert np.isfinite(certificate.jerk.value).all()
    assert np.isnan(certificate.worst("jerk")[0])
    with pytest.raises(InvalidInput, match=r"^field: "):
        certificate.worst("speed")


# ---------------------------------------------------------------- position limits
@settings(max_examples=20)
@given(st.integers(0, 5), st.floats(-0.1, 0.1), st.booleans())
def test_the_position_margin_is_the_room_at_the_nearest_approach(joint: int, beyond: float, upward: bool) -> None:
    lower, upper = ROBOT.limits.lower, ROBOT.limits.upper
    assume(abs(beyond - 1e-9) > 1e-12)  # the tolerance itself
    size = (upper[joint] - START[joint] + beyond) if upward else (lower[joint] - START[joint] - beyond)
    certificate = judged(step_of(joint, size, 2.0))
    assert certificate.position_margin[joint] == pytest.approx(-beyond, abs=1e-12)
    assert certificate.is_valid == (beyond <= 1e-9)
    if beyond > 1e-9:
        assert len(certificate.reasons) == 1
        words = certificate.reasons[0].split(" exceeds its range by ")
        assert words[0] == NAMES[joint]
        assert float(words[1].split()[0]) == pytest.approx(beyond, rel=6e-3, abs=1e-12)
    others = np.delete(np.arange(6), joint)
    room = np.minimum(START - lower, upper - START)
    np.testing.assert_allclose(certificate.position_margin[others], room[others], rtol=0, atol=1e-12)


def test_a_position_limit_passed_between_the_samples_is_found() -> None:
    c = np.zeros((6, 1, 6))
    c[5, 0] = START
    room = ROBOT.limits.upper[4] - START[4]
    c[3, 0, 4], c[4, 0, 4] = -(room + 1e-6) / 0.25, (room + 1e-6) / 0.25  # a parabola that peaks at t = 0.5
    certificate = certified(Trajectory(PPoly(c, [0.0, 1.0])))
    assert certificate.position_margin[4] == pytest.approx(-1e-6, abs=1e-12)
    assert not certificate.is_valid


# ---------------------------------------------------------------- continuity
@pytest.mark.parametrize(("jump", "continuous"), [(0, -1), (1, 0), (2, 1), (3, 2), (None, 3)])
def test_what_jumps_ends_continuity_and_makes_every_higher_derivative_infinite(
    jump: int | None, continuous: int
) -> None:
    certificate = certified(smooth_but(jump), MotionLimits(10.0, 10.0, 10.0))
    assert certificate.continuous == continuous
    for order, field in enumerate(DERIVATIVES, start=1):
        extreme = getattr(certificate, field)
        assert np.isinf(extreme.value[3]) == np.isinf(extreme.ratio[3]) == (order > continuous + 1)


@pytest.mark.parametrize(
    ("order", "field", "words"), [(0, "velocity", "position jumps"), (1, "acceleration", "velocity jumps")]
)
def test_a_jump_breaks_the_certificate_of_any_law_where_it_is(order: int, field: str, words: str) -> None:
    c = np.zeros((6, 2, 6))
    c[5] = START
    c[5 - order, 1, 1] += 0.1
    trajectory = Trajectory(PPoly(c, [0.0, 0.5, 1.0]))
    certificate = certified(trajectory, MotionLimits(2.0, 10.0, 100.0))
    assert not certificate.is_valid
    assert certificate.worst(field) == (np.inf, "joint2", 0.5)
    np.testing.assert_array_equal(np.delete(getattr(certificate, field).value, 1), 0.0)
    assert any(words in reason for reason in certified(trajectory, enforced=()).reasons)


def test_standstill_before_a_start_at_rest_counts() -> None:
    assert certified(step_of(0, 0.04, 0.8)).continuous == 2, "jerk starts and ends with a step"
    c = np.zeros((6, 1, 6))
    c[5, 0] = START
    c[3, 0] = 0.05  # q̈ = 0.1 from rest at t = 0; still moving at the end
    certificate = certified(Trajectory(PPoly(c, [0.0, 1.0])))
    assert certificate.rest == (True, False)
    assert certificate.continuous == 1
    assert np.isinf(certificate.jerk.value).all()
    np.testing.assert_array_equal(certificate.jerk.time, 0.0)


def test_rest_is_a_velocity_of_zero() -> None:
    assert certified(step_of(0, 0.04, 0.8)).rest == (True, True)
    assert certified(smooth_but(None)).rest == (False, False)
    still = np.zeros((6, 1, 6))
    still[5, 0] = START
    certificate = certified(Trajectory(PPoly(still, [0.0, 1.0])), MotionLimits(1.0, 1.0, 1.0))
    assert certificate.rest == (True, True)
    assert certificate.continuous == 3
    assert certificate.reasons == (f"the motion ends at s = 0 of its path, not at {default_line().end:.6g}",)


def bang_bang(joint: int, a: float, T: float) -> Trajectory:
    """Accelerate for half the time, decelerate for the other half."""
    c = np.zeros((6, 2, 6))
    c[5] = START
    c[3, 0, joint], c[3, 1, joint] = a / 2, -a / 2
    c[4, 1, joint], c[5, 1, joint] = a * T / 2, START[joint] + a * T * T / 8
    return Trajectory(PPoly(c, [0.0, T / 2, T]))


def test_a_jump_of_acceleration_is_infinite_jerk_of_that_joint_at_its_largest_jump() -> None:
    certificate = judged(bang_bang(3, 0.5, 1.0), MotionLimits(2.0, 10.0, 100.0))
    others = [0, 1, 2, 4, 5]
    assert certificate.jerk.value[3] == certificate.jerk.ratio[3] == np.inf
    assert certificate.jerk.time[3] == 0.5, "the jump of 2a, not those of a at the ends"
    np.testing.assert_array_equal(certificate.jerk.value[others], 0.0)
    np.testing.assert_array_equal(certificate.jerk.ratio[others], 0.0)
    assert certificate.continuous == 1
    assert certificate.worst("jerk") == (np.inf, "joint4", 0.5)
    assert certificate.reasons == ("jerk of joint4 is unbounded at t = 0.5 s",)
    assert certificate.acceleration.value[3] == pytest.approx(0.5, rel=1e-12)


def test_a_jump_has_no_ratio_where_jerk_is_free() -> None:
    certificate = certified(bang_bang(3, 0.5, 1.0), MotionLimits(2.0, 10.0))
    assert certificate.jerk.value[3] == np.inf
    assert np.isnan(certificate.jerk.ratio).all()


# ---------------------------------------------------------------- jerk as a controller sees it
@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_sampled_jerk_is_the_largest_difference_of_accelerations_over_a_period(rate: float) -> None:
    trajectory = around_start(np.random.default_rng(3), smooth=2)
    certificate = certified(trajectory, rate=rate)
    periods = int(trajectory.duration * rate)
    accelerations = np.array([oracles.value(trajectory, i / rate, 2) for i in range(periods + 1)])
    wanted = np.abs(np.diff(accelerations, axis=0)).max(axis=0) * rate
    assert certificate.rate == rate
    np.testing.assert_allclose(certificate.sampled_jerk, wanted, rtol=1e-9)


def test_sampled_jerk_looks_at_the_last_whole_period_too() -> None:
    c = np.zeros((6, 1, 6))
    c[0], c[5, 0] = 1 / 20, START  # q̈ = t³
    certificate = certified(Trajectory(PPoly(c, [0.0, 0.5])), rate=10.0)
    assert certificate.sampled_jerk[0] == pytest.approx((0.5**3 - 0.4**3) * 10.0)


# ---------------------------------------------------------------- the tool
def paper_motion() -> Trajectory:
    return make_law("quintic").run(default_joint_path(), ROOMY)


def assert_bounds(proved: float, truth: float) -> None:
    """Never below the truth, and not far above it."""
    assert truth <= proved <= 1.05 * max(truth, 1e-9)


@pytest.mark.parametrize("law", ["quintic", "ruckig", "optimal"])
def test_the_path_error_bounds_what_plain_kinematics_say(law: str) -> None:
    line = default_line()
    trajectory = make_law(law).run(default_joint_path(), MotionLimits(2.0, 10.0, 100.0))
    error = certified(trajectory).path_error
    worst = np.zeros(2)
    for t in np.append(np.linspace(0.0, trajectory.duration, 1201), [error.t_distance, error.t_angle]):
        worst = np.maximum(worst, oracles.off_line(line.start, line.goal, oracles.fk(PAPER, trajectory(t))))
    assert_bounds(error.distance, worst[0])
    assert_bounds(error.angle, worst[1])
    for t, found, part in ((error.t_distance, error.found_distance, 0), (error.t_angle, error.found_angle, 1)):
        at = oracles.off_line(line.start, line.goal, oracles.fk(PAPER, trajectory(t)))[part]
        assert at == pytest.approx(found, rel=1e-6, abs=1e-14)


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-4, 0.3))
def test_no_instant_contradicts_the_bounds_of_a_motion_far_from_its_line(seed: int, size: float) -> None:
    trajectory, line = around_start(np.random.default_rng(seed), 3, size), default_line()
    certificate = certify(ROBOT, line, trajectory, ROOMY)
    assume((certificate.position_margin > 0.0).all())
    error, slack = certificate.path_error, 1.0 + 1e-9
    t = np.linspace(0.0, trajectory.duration, 101)
    off = [oracles.off_line(line.start, line.goal, T) for T in oracles.fk(PAPER, trajectory(t))]
    worst = [*np.max(off, axis=0), *oracles.speeds(PAPER, trajectory, t).max(axis=0)]
    assert worst[0] <= slack * error.distance
    assert worst[1] <= slack * error.angle, "the line keeps its orientation, so the angle is the same at all its places"
    assert error.angle <= 1.1 * worst[1] + 1e-9
    assert worst[2] <= slack * certificate.tool_speed.value <= 1.01 * worst[2] + 1e-5
    assert worst[3] <= slack * certificate.rotation_speed.value <= 1.01 * worst[3] + 1e-5


def test_a_path_that_crosses_itself_is_followed_in_its_order() -> None:
    """At the end the tool is where it was at the start, but turned: only the order along the path tells them apart."""
    start = ROBOT.fk(START)
    line = Line(start, oracles.moved(start, np.zeros(3), np.array([0.0, 0.0, 0.4])))
    trajectory = make_law("optimal").run(cases.followed_line(line.start, line.goal), MotionLimits(2.0, 10.0, 100.0))
    certificate = certify(ROBOT, line, trajectory, ROOMY)
    assert certificate.path_error.angle <= 2e-9
    np.testing.assert_allclose(certificate.binding.s[[0, -1]], [0.0, 0.4], rtol=0.0, atol=1e-9)


def test_a_tolerance_is_part_of_the_promise() -> None:
    trajectory = paper_motion()
    assert certified(trajectory, enforced=(), tolerance=(1e-5, 1e-5)).is_valid
    words = certified(trajectory, enforced=(), tolerance=(1e-7, 1e-5)).reasons
    assert len(words) == 1
    assert "off its path" in words[0]
    words = certified(trajectory, enforced=(), tolerance=(1e-5, 1e-7)).reasons
    assert "turned" in words[0]


def test_a_tolerance_below_a_nanometre_is_proved_where_it_is_kept() -> None:
    trajectory = make_law("optimal").run(default_joint_path(), MotionLimits(2.0, 10.0, 100.0))
    certificate = certified(trajectory, tolerance=(1e-12, 1e-12))
    assert certificate.is_valid
    assert max(certificate.path_error.distance, certificate.path_error.angle) <= 1e-12


def test_limits_of_the_tool_are_judged() -> None:
    trajectory = paper_motion()
    fastest = certified(trajectory).tool_speed.value
    slow = certified(trajectory, MotionLimits(tool_speed=0.5 * fastest), enforced=("tool_speed",))
    assert slow.worst("tool_speed")[:2] == (pytest.approx(2.0), "tool")
    assert slow.reasons[0].startswith("tool_speed of tool is 2")
    assert certified(trajectory, MotionLimits(tool_speed=1.001 * fastest), enforced=("tool_speed",)).is_valid


def test_the_binding_limit_is_that_of_the_worst_joint_of_each_piece() -> None:
    limits = MotionLimits(2.0, 10.0, 100.0)
    trajectory = make_law("optimal").run(default_joint_path(), limits)
    binding = certified(trajectory, limits).binding
    assert np.isclose(binding.ratio.max(), 1.0, atol=1e-3)
    assert binding.ratio.max() <= 1.0
    assert (np.diff(binding.s) > 0.0).all()
    for k in range(0, len(binding.ratio), 7):
        u = np.linspace(binding.t[k], binding.t[k + 1], 41)[1:-1]
        worst = {
            (field, joint): float(np.abs([oracles.value(trajectory, t, order, k)[j] for t in u]).max()) / bound
            for order, (field, bound) in enumerate(zip(DERIVATIVES, (2.0, 10.0, 100.0), strict=True), start=1)
            for j, joint in enumerate(NAMES)
        }
        assert binding.ratio[k] >= max(worst.values()) - 1e-12
        assert worst[binding.limit[k], binding.joint[k]] >= max(worst.values()) - 0.02


@pytest.mark.parametrize(("off", "turn"), [((0.8, 0.3, 0.48), (0, 0, 0)), ((0, 0, 0), (0.6, 0.0, 0.8))])
def test_a_motion_beside_or_turned_from_its_line_by_a_thousandth_is_reported_so(off: Any, turn: Any) -> None:
    line, v, w = default_line(), np.cross(cases.MOVE, off), np.array(turn) * 1e-3
    v *= 1e-3 / max(np.linalg.norm(v), 1e-9)
    error = certify(ROBOT, Line(oracles.moved(line.start, v, w), oracles.moved(line.goal, v, w)), paper_motion(), ROOMY)
    assert error.path_error.distance == pytest.approx(np.linalg.norm(v), abs=1e-6)
    assert error.path_error.angle == pytest.approx(np.linalg.norm(w), abs=1e-6)


def test_a_bulge_of_one_millimetre_is_found_where_it_is() -> None:
    line, joint_path = default_line(), default_joint_path()
    t = np.linspace(0.0, 1.5, 61)
    q = np.empty((61, 6))
    for i, u in enumerate(t / 1.5):
        off = 1e-3 * max(0.0, 1.0 - ((u - 0.4) / 0.1) ** 2) ** 3
        target = oracles.moved(oracles.line_pose(line.start, line.goal, u), [0.0, off, 0.0])
        q[i] = oracles.met(PAPER, target, joint_path(u * line.end))
    spline = CubicSpline(t, q)
    error = certified(Trajectory(quintic_through(t, q, spline(t, 1), spline(t, 2)))).path_error
    assert error.distance == pytest.approx(1e-3, rel=1e-3)
    assert error.t_distance == pytest.approx(0.4 * 1.5, abs=0.01)


def test_tool_speed_and_rotation_speed_are_those_of_the_moving_tool() -> None:
    start = ROBOT.fk(START)
    line = Line(start, oracles.moved(start, np.array([0.05, 0.03, -0.04]), np.array([0.1, -0.2, 0.15])))
    trajectory = make_law("quintic").run(cases.followed_line(line.start, line.goal), ROOMY)
    certificate = certify(ROBOT, line, trajectory, ROOMY)
    fastest = np.zeros(2)
    h = 1e-5
    near = [certificate.tool_speed.time, certificate.rotation_speed.time]
    for t in [*np.linspace(0.0, trajectory.duration, 301)[1:-1], *near]:  # at rest at both ends
        twist = oracles.error(oracles.fk(PAPER, trajectory(t - h)), oracles.fk(PAPER, trajectory(t + h))) / (2 * h)
        fastest = np.maximum(fastest, [np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])])
    for proved, found in zip((certificate.tool_speed.value, certificate.rotation_speed.value), fastest, strict=True):
        assert found * (1.0 - 1e-6) <= proved <= found * (1.0 + 1e-4)


def test_the_smallest_singular_value_and_when() -> None:
    trajectory = paper_motion()
    certificate = certified(trajectory)
    t = np.linspace(0.0, 3.0, 101)
    values = [np.linalg.svd(oracles.jacobian(PAPER, trajectory(w)), compute_uv=False)[-1] for w in t]
    assert certificate.singular_value <= min(values) * (1.0 + 1e-9)
    assert certificate.singular_value == pytest.approx(min(values), rel=1e-3)
    assert certificate.singular_value > 0.22
    assert certificate.t_singular_value == pytest.approx(t[int(np.argmin(values))], abs=0.03)


# ---------------------------------------------------------------- plain data
@pytest.mark.parametrize("limits", [MotionLimits(), MotionLimits(2.0, 10.0, 100.0), MotionLimits(velocity=2.0)])
@pytest.mark.parametrize("kind", ["smooth", "jumps", "still"])
def test_plain_data_are_strict_json_and_say_what_the_certificate_says(limits: MotionLimits, kind: str) -> None:
    trajectory = {"smooth": paper_motion(), "jumps": bang_bang(3, 0.5, 1.0), "still": step_of(0, 0.0, 1.0)}[kind]
    certificate = certified(trajectory, limits, law="some law")
    data = json.loads(json.dumps(certificate.to_dict(), allow_nan=False))
    assert data["law"] == "some law"
    assert data["is_valid"] is certificate.is_valid
    assert data["reasons"] == list(certificate.reasons)
    assert data["joint_names"] == NAMES
    assert data["path_error"]["distance"] == certificate.path_error.distance
    for field in DERIVATIVES:
        for name, values in getattr(certificate, field)._asdict().items():
            for mine, theirs in zip(values, data[field][name], strict=True):
                assert theirs == (mine if np.isfinite(mine) else None)


def test_what_it_is_a_certificate_of() -> None:
    certificate = certified(paper_motion(), law="quintic", enforced=(), rate=500.0)
    assert (certificate.law, certificate.enforced, certificate.duration) == ("quintic", (), 3.0)
    assert certificate.joint_names == tuple(NAMES)


def test_a_rate_that_tells_nothing_is_refused() -> None:
    for rate in (1e-6, 1e9):
        assert certified(paper_motion(), rate=rate).rate == rate
    for rate in (0.0, -1.0, 0.9e-6, 1.1e9, 1e300, 5e-324, np.nan):
        with pytest.raises(InvalidInput, match=r"^rate: "):
            certified(paper_motion(), rate=rate)


TWO_JOINTS = cases.random_trajectory(np.random.default_rng(0))
WRONG = {
    "robot": ("paper6r",), "path": ("line",), "trajectory": ([0.0, 1.0], TWO_JOINTS), "limits": (2.0,),
    "enforced": (("velocty",),),
    "tolerance": (0.0, (0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (1.0,), "tight", (1.0, np.inf)),
}  # fmt: skip


@pytest.mark.parametrize("argument", WRONG)
def test_what_cannot_be_meant_is_refused_by_name(argument: str) -> None:
    things = {"robot": ROBOT, "path": default_line(), "trajectory": paper_motion(), "limits": ROOMY}
    for wrong in WRONG[argument]:
        with pytest.raises(InvalidInput) as info:
            certify(**(things | {argument: wrong}))
        assert info.value.argument.partition(".")[0] == argument


def test_a_motion_without_a_path_is_judged_by_its_joints() -> None:
    motion = paper_motion()
    proof = certify(ROBOT, None, motion, ROOMY)
    assert proof.is_valid
    assert np.isnan(proof.path_error.distance)
    assert proof.to_dict()["path_error"]["distance"] is None
    np.testing.assert_array_equal(proof.binding.s, motion.knots)
    assert proof.velocity.ratio.tolist() == certified(motion).velocity.ratio.tolist()
    assert certify(ROBOT, None, motion).velocity.value.tolist() == proof.velocity.value.tolist(), (
        "the robot's own limits"
    )
    for option in ({"tolerance": (1e-5, 1e-5)}, {"span": (0.0, 0.1)}):
        with pytest.raises(InvalidInput, match="path"):
            certify(ROBOT, None, motion, ROOMY, **option)


def test_certificates_can_be_compared_and_kept_in_sets() -> None:
    one, other = certified(paper_motion()), certified(paper_motion())
    assert one == one
    assert one != other, "equal only where they are the same object"
    assert len({one, other}) == 2


def test_the_segment_of_a_wait_has_no_active_constraint() -> None:
    robot = paper6r()
    there, back = robot.fk(START), robot.fk(START)
    there[:3, 3] += [-0.05, 0.0, 0.1]
    parts = (Part(Line(back, there)), Dwell(0.5), Part(Line(there, back)))
    proof = plan(robot, Program(parts), START).certificate
    active = proof.binding
    (wait,) = np.flatnonzero(active.ratio == 0.0)
    assert active.ratio.size == active.t.size - 1 and np.diff(active.t)[wait] == pytest.approx(0.5)
    ways = np.sort(active.ratio[:wait]), np.sort(active.ratio[wait + 1 :])  # the way back is as fast as the way there
    np.testing.assert_allclose(*ways, atol=0.02)
    assert sum(map(int, re.findall(r"(\d+) %", describe_limiting(proof)[0]))) <= 100 * (1.0 - 0.5 / proof.duration) + 1
