"""Chunks that lead back from an end of a range, shortest stops, chunks just after a start, and proofs of entered plans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import ruckig
import scipy

import optik
import planners
from planners import MotionLimits, Retargeted, Trajectory, retarget, stream
from planners.limits._combination import Combination
from planners.streams import Chunk
from planners.streams.motion import JointCubics, write_joint_rows
from planners.streams.reference import SPARE, _stop
from planners.streams.result import certify_joined
from planners.trajectory import make_rest
from tests.optik.test_motors import MATRICES
from tests.planners.test_coupled_motors import arm, motor_torques, planned
from tests.seeds import shift_seed

REST = np.array([0.0, -1.5, 1.4, -1.5, -1.57, 0.0])
LIMITS = MotionLimits(velocity=2.5, acceleration=10.0, jerk=200.0)


def braking(robot: optik.Robot, limits: MotionLimits, rng: np.random.Generator) -> tuple[Retargeted, np.ndarray]:
    """A motion that brakes onto ends of ranges, and where it came from."""
    low, high = robot.limits.lower, robot.limits.upper
    start = low + rng.uniform(0.3, 0.7, robot.n) * (high - low)
    goal, moved = start.copy(), rng.permutation(robot.n)[: rng.integers(1, robot.n + 1)]
    goal[moved] = np.where(rng.random(moved.size) < 0.5, low[moved], high[moved])
    found = retarget(planners.plan(robot, start + 1e-3, start, limits=limits), 0.0, goal)
    assert found, found.reason
    return found, start


@pytest.mark.parametrize("jerk", [50.0, 500.0, 5000.0])
@pytest.mark.parametrize("name", ["kr6", "panda"])
def test_a_chunk_that_leads_back_from_an_end_is_followed(name: str, jerk: float) -> None:
    robot, rng = optik.load(name), np.random.default_rng([shift_seed(1), int(jerk)])
    limits = MotionLimits(velocity=2.0, acceleration=10.0, jerk=jerk)
    for _ in range(2):
        motion, start = braking(robot, limits, rng)
        end = motion.trajectory.end
        for at in np.append(np.linspace(0.6, 0.999, 12) * end, end - 1e-6):
            q, v = motion.trajectory(at), motion.trajectory(at, 1)
            t = np.arange(20)[:, None] / 20.0
            P = q + 0.2 * v * np.minimum(t, 0.1) + 0.3 * (start - q) * t
            found = retarget(motion, float(at), Chunk(robot.limits.clip(P), 20.0, float(at)))
            assert found, (at / end, found.reason)
            samples = found.trajectory(np.linspace(0.0, found.trajectory.end, 3000))
            assert (samples <= robot.limits.upper + 1e-9).all() and (samples >= robot.limits.lower - 1e-9).all()


def test_a_stop_is_the_shortest_of_ruckig() -> None:
    rng, goes = np.random.default_rng(shift_seed(2)), 0
    for _ in range(300):
        limits = np.array([[-9.0, 9.0], [-2.0, 2.0], [-rng.uniform(2, 9), rng.uniform(2, 9)], [-60.0, 60.0]])
        x = np.array([rng.uniform(-1, 1), rng.uniform(-2, 2), rng.uniform(*limits[2])])
        problem, answer = ruckig.InputParameter(1), ruckig.Trajectory(1)
        problem.control_interface = ruckig.ControlInterface.Velocity
        problem.current_position, problem.current_velocity, problem.current_acceleration = ([v] for v in x)
        problem.target_velocity, problem.target_acceleration = [0.0], [0.0]
        problem.max_acceleration, problem.min_acceleration = [limits[2, 1]], [limits[2, 0]]
        problem.max_jerk = [60.0]
        assert ruckig.Ruckig(1).calculate(problem, answer) == ruckig.Result.Working
        knots, c, state = np.zeros(8), np.zeros((4, 8)), x.copy()
        scaled = limits.copy()
        scaled[2:] *= 1.0 - SPARE
        count = _stop(state, scaled, knots, c)
        goes += count == 3
        assert knots[count] == pytest.approx(answer.duration, abs=1e-7)
        np.testing.assert_allclose(state, [answer.at_time(answer.duration)[0][0], 0.0, 0.0], atol=1e-7)
        motion = scipy.interpolate.PPoly(c[:, :count], knots[: count + 1])
        np.testing.assert_allclose([motion(0.0, k) for k in range(3)], x, atol=1e-12)
    assert goes > 50


@pytest.mark.parametrize("after", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7])
def test_a_chunk_just_after_a_start_takes_the_time_from_rest(after: float) -> None:
    robot, t = optik.load("ur5e"), np.arange(20)[:, None] / 20.0
    first = planners.plan(robot, REST + 0.5, REST, limits=LIMITS)
    chunk = Chunk(REST + 0.2 * np.sin(t * np.arange(1, 7) / 3.0), 20.0)
    usual, found = (retarget(first, at, chunk).trajectory.end for at in (0.0, after))
    assert found == pytest.approx(usual, rel=0.2)


def test_the_pace_respects_the_lower_side_of_unequal_limits() -> None:
    R = np.zeros((4, 4, 1))
    R[:, 1], limits = 0.5, np.array([[[-9.0, 9.0], [-1.0, 3.0], [-5.0, 5.0], [-99.0, 99.0]]])
    for sides in ((-1.0, 3.0), (-3.0, 1.0)):
        limits[0, 1] = sides
        rows, cap = np.empty((4, 1, 4)), np.empty(4)
        write_joint_rows(R, limits, 10.0, rows, cap)
        np.testing.assert_allclose(cap, (0.995 * 1.0 / 0.5) ** 2)
    uneven = MotionLimits(velocity=(-0.5, 2.0), acceleration=10.0, jerk=200.0)
    robot, t = optik.load("ur5e"), np.arange(40)[:, None] / 20.0
    first = planners.plan(robot, REST + 1e-3, REST, limits=uneven)
    found = retarget(first, 0.0, Chunk(REST - 1.2 * t * np.eye(6)[0], 20.0))  # faster than the lower side
    assert found and found.reference is not None
    speed = 1.2 * np.diff(found.reference.s) / np.diff(found.reference.when)
    assert 0.45 < speed.max() <= 0.5


def test_a_stream_has_the_speed_of_its_chunk() -> None:
    robot, t = optik.load("ur5e"), np.arange(80)[:, None] / 20.0
    waiting = [Chunk(REST + 0.1 * t * np.ones(6), 20.0)]
    flow = stream(
        robot,
        lambda now: waiting.pop() if waiting else None,
        REST,
        rate=100.0,
        limits=LIMITS,
        realtime=False,
        silence=0.1,
    )
    seen = [(now.t, now.q[0] - REST[0]) for now in flow if 1.0 < now.t < 3.0]
    (t0, q0), (t1, q1) = seen[0], seen[-1]
    assert (q1 - q0) / (t1 - t0) == pytest.approx(0.1, rel=1e-3)


def test_knots_one_rounding_apart_are_kept_at_every_time() -> None:
    """Knots of joints differ by rounding, and a target that is blocked keeps the motion from any time on."""
    robot, rng = optik.load("ur5e"), np.random.default_rng(shift_seed(3))
    blocked = MotionLimits(velocity=2.5, acceleration=10.0, jerk=200.0, tool_speed=1e-3)
    for _ in range(4):
        a, b, far = rng.uniform(-2.0, 2.0, (3, 6))
        first = planners.plan(robot, a + 1e-3, a, limits=LIMITS)
        motion = retarget(first, 0.5 * first.duration, b, limits=LIMITS)
        knots = motion.trajectory.knots
        assert (np.diff(knots) > 0.9e-13).all()
        for at in np.concatenate([knots, np.nextafter(knots[1:], 0.0), 0.5 * (knots[1:] + knots[:-1])]):
            kept = retarget(motion, float(at), far, limits=blocked)
            assert not kept and "tool_speed" in kept.reason
            assert kept.certificate.discontinuity.max() <= 1e-9


def test_a_motion_whose_knots_become_equal_is_cut() -> None:
    """Subtraction of a time rounds two knots to one."""
    t, near = 2.0**-53, 1.0 + 2.0**-51
    assert near - t == np.nextafter(near, 2.0) - t
    c = np.zeros((4, 3, 1))
    c[3] = 0.5
    motion = Trajectory(scipy.interpolate.PPoly(c, [0.0, near, np.nextafter(near, 2.0), 2.0]))
    rest = planners.trajectory.cut_before(motion, t)
    np.testing.assert_allclose(rest.knots, [0.0, near - t, 2.0 - t])


# ---------------------------------------------------------------- what is proved


def entered() -> tuple[Retargeted, np.ndarray, float]:
    """A motion that enters a plan, the state at its begin, and the time of the entry."""
    robot = optik.load("ur5e")
    first = planners.plan(robot, REST + 0.4, REST, limits=LIMITS)
    other = planners.plan(robot, REST - 0.4, REST + 0.3, limits=LIMITS)
    found = retarget(first, 0.3, other)
    assert found.status == "joined" and isinstance(found.curve, Trajectory), found.reason
    state = np.array([first.trajectory(0.3, k) for k in range(3)])
    return found, state, max(found.trajectory.end - other.duration, 0.0)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_step_of_an_entered_plan_is_found_at_its_begin_at_the_entry_and_inside(order: int) -> None:
    found, state, entry = entered()
    motion, words = found.trajectory, ("position", "velocity", "acceleration")[order]
    assert certify_joined(found.robot, motion, LIMITS, state, None).is_valid
    at = int(np.searchsorted(motion.knots, entry))
    for k in (0, 1, at, at + 1, len(motion.knots) - 3, len(motion.knots) - 2):
        for joint in (0, 5):
            c, last = motion.coefficients.copy(), None if joint else k + 1  # from there on, or of one piece
            c[len(c) - 1 - order, k:last, joint] += (1.0, 1.0, 0.5)[order] * 1e-5
            broken = Trajectory(scipy.interpolate.PPoly(c, motion.knots))
            proof = certify_joined(found.robot, broken, LIMITS, state, None)
            assert not proof.is_valid and proof.discontinuity[order] >= 0.99e-5
            assert any(f"the {words} is discontinuous" in reason for reason in proof.reasons)
    moved = state.copy()
    moved[order, 2] += 1e-5
    proof = certify_joined(found.robot, motion, LIMITS, moved, None)
    assert proof.reasons == (f"the {words} is discontinuous by 1e-05",)


def test_an_entered_plan_that_does_not_rest_at_its_end_is_not_valid() -> None:
    found, state, _ = entered()
    cut = planners.trajectory.cut_after(found.trajectory, 0.7 * found.trajectory.end)
    assert not certify_joined(found.robot, cut, LIMITS, state, None).is_valid


@pytest.mark.parametrize("outside", [-0.02, 0.02])
def test_ranges_of_motors_are_judged(outside: float) -> None:
    robot = arm(MATRICES["joints 2 and 3"])
    m = robot.motors.of(robot.limits.middle)
    m[2] = (robot.motors.limits.upper if outside > 0.0 else robot.motors.limits.lower)[2] + outside
    q = robot.motors.axes(m)
    state, limits = np.stack([q, 0.0 * q, 0.0 * q]), MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
    c = np.zeros((6, 4, 1))
    c[:, 3, 0] = q
    cubics = JointCubics(np.tile([0.0, 0.1], (6, 1)), np.full(6, 2), c)
    curves: tuple[Any, ...] = (make_rest(q, 0.1), cubics)
    for curve in curves:
        proof = certify_joined(robot, curve, limits, state, None)
        assert any("M3 exceeds its range by 0.02" in words for words in proof.reasons)
        assert proof.position_margin[2] == pytest.approx(-0.02, abs=1e-9)


def test_the_motor_torque_rate_that_binds_is_met() -> None:
    robot, free = arm(MATRICES["joints 2 and 3"]), planned("joints 2 and 3")
    _, rate = motor_torques(free)
    most = 0.5 * np.quantile(np.abs(rate), 0.999, axis=0) + 1.0
    given = Combination(robot.motors.matrix.T, most, ("M1", "M2", "M3", "M4", "M5", "M6"))
    limits = MotionLimits.of(robot, motor_torque_rate=given)
    found = planners.plan(robot, free.path, free.trajectory(0.0), limits=limits)
    assert found and found.duration > free.duration * 1.01
    _, rate = motor_torques(found)
    assert 0.9 < (np.abs(rate) / most).max() <= 1.0 + 1e-3


def test_the_jerk_that_a_controller_sees_of_twenty_minutes_is_that_of_its_periods() -> None:
    robot, T = optik.load("ur5e"), 1200.0
    c = np.zeros((4, 1, 6))
    c[0, 0] = np.arange(1.0, 7.0) / 6.0 * 1e-8
    c[3, 0] = REST
    motion = Trajectory(scipy.interpolate.PPoly(c, [0.0, T]))
    proof = planners.certify(robot, None, motion, MotionLimits(velocity=9.0, acceleration=9.0), rate=1000.0)
    np.testing.assert_allclose(proof.sampled_jerk, np.arange(1.0, 7.0) * 1e-8, rtol=1e-3)
