"""Retargeting: motions from moving states onto chunks, joints, velocities and plans, against plain evaluations and solvers."""

from __future__ import annotations

import time
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
import ruckig
import scipy

import optik
import planners
from optik.errors import InvalidInput
from planners import MotionLimits, retarget, stream
from planners.limits.base import sides
from planners.streams import Chunk, JogVelocity, RetargetStatus
from planners.streams.chunk import load_chunks
from planners.streams.interior import MOST_STEPS, make_factors, make_rows, make_stencils, minimise
from planners.streams.motion import JointCubics, integrate, sweep_pace, write_joint_rows
from planners.streams.reference import evaluate_reference, fit_reference, make_objective, sample_reference
from planners.streams.result import certify_joined
from tests.oracles import PinocchioDynamics
from tests.seeds import shift_seed

REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
PANDA = MotionLimits(
    velocity=[2.175] * 4 + [2.61] * 3, acceleration=[15, 7.5, 10, 12.5, 15, 20, 20],
    jerk=[7500, 3750, 5000, 6250, 7500, 10000, 10000],
)  # fmt: skip
UR = MotionLimits(velocity=np.pi, acceleration=10.0, jerk=100.0)
UNEVEN = MotionLimits(velocity=(-3.5, 3.0), acceleration=(-12.0, 9.0), jerk=100.0)
ARMS = {"panda": ("panda", PANDA), "ur5e": ("ur5e", UR), "uneven": ("ur5e", UNEVEN)}


@cache
def running(arm: str) -> list[planners.Plan]:
    """Certified motions that stand on their limits most of the time."""
    name, limits = ARMS[arm]
    robot, rng = optik.load(name), np.random.default_rng(3)
    low, high = np.maximum(robot.limits.lower, -3.0) + 0.3, np.minimum(robot.limits.upper, 3.0) - 0.3
    found = []
    while len(found) < 6:
        q = rng.uniform(low, high)
        plan = planners.plan(robot, np.clip(q + rng.uniform(-1.3, 1.3, robot.n), low, high), q, limits=limits)
        found += [plan] if plan else []
    return found


def draw(arm: str, rng: np.random.Generator) -> tuple[planners.Plan, float, Chunk]:
    """A running motion, a time, and a chunk that goes on from near there, noisy, with a duplicate, as fast as the limits."""
    plan = running(arm)[rng.integers(6)]
    at = float(rng.uniform(0.02, 0.98) * plan.trajectory.duration)
    rate, m = float(rng.choice([10.0, 15.0, 20.0, 30.0])), int(rng.integers(8, 51))
    delay = float(rng.uniform(0.0, 0.15))
    t, seen = np.arange(m)[:, None] / rate, max(at - delay, 0.0)
    q, v = plan.trajectory(seen), plan.trajectory(seen, 1)
    points = q + rng.uniform(-0.05, 0.05, q.size) + 0.4 * v * (1.0 - np.exp(-t / 0.4))
    points = points + rng.uniform(-0.5, 0.5, q.size) * np.sin(t * rng.uniform(0.5, 4.0, q.size))
    points += rng.normal(size=points.shape) * rng.choice([0.0, 1e-3, 3e-3])
    k = int(rng.integers(1, m - 2))
    points[k + 1] = points[k]
    low, high = plan.robot.limits.lower - 0.09, plan.robot.limits.upper + 0.09  # further ones are refused
    return plan, at, Chunk(np.clip(points, low, high), rate, at - delay)


def samples(motion: planners.Trajectory, rate: float = 20e3) -> list[np.ndarray]:
    """q and its derivatives at a rate and just inside the ends of the pieces, by SciPy."""
    x, c = motion.knots, motion.coefficients
    t = np.unique(np.concatenate([np.arange(0.0, motion.end, 1.0 / rate), x[:-1], x[1:] - 1e-12]))
    poly = scipy.interpolate.PPoly(c, x)
    return [poly(t, order) for order in range(4)]


def check_motion(robot: optik.Robot, limits: MotionLimits, motion: planners.Trajectory, start: Any) -> None:
    """Continuity with the start and inside, rest at the end, and all limits, by samples."""
    for order, value in enumerate(start):
        np.testing.assert_allclose(motion(0.0, order), value, rtol=0.0, atol=1e-12)
    for order in range(3):
        assert np.abs(motion.jumps(order)).max(initial=0.0) <= 1e-12
    for order in (1, 2):
        assert np.abs(motion.ends(order)[1][-1]).max() <= 1e-12
    q = samples(motion)
    assert (q[0] >= robot.limits.lower - 1e-9).all() and (q[0] <= robot.limits.upper + 1e-9).all()
    for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
        low, high = sides(limits.bounds(robot.n)[name])
        assert (q[order] >= low * (1.0 + 1e-9) - 1e-12).all() and (q[order] <= high * (1.0 + 1e-9) + 1e-12).all(), name


@pytest.mark.parametrize("arm", ARMS)
def test_random_states_join_random_chunks_within_all_limits(arm):
    rng = np.random.default_rng(shift_seed(1))
    joined = 0
    for _ in range(40):
        plan, at, chunk = draw(arm, rng)
        found = retarget(plan, at, chunk)
        assert found and found.status == "joined" and found.certificate.is_valid, found.reason
        check_motion(plan.robot, plan.limits, found.trajectory, [plan.trajectory(at, k) for k in range(3)])
        assert found.skipped <= (at - chunk.observed) * chunk.rate + 1.0 and found.repaired >= 1
        joined += found.joined_after is not None
    assert joined >= (36 if arm == "panda" else 24)


def test_what_is_proved_of_the_joining_is_true():
    rng, never = np.random.default_rng(shift_seed(2)), 0
    high = optik.load("panda").limits.upper
    near = planners.plan(optik.load("panda"), high - 0.29, high - 0.3, limits=PANDA)
    for k in range(20):
        if k % 2:  # smoothed so much that the paced chunk leaves the range
            points = np.minimum(high - 0.29 + 0.03 * np.arange(30)[:, None], high)
            points[:-1] -= 0.15 * np.abs(rng.normal(size=(29, 7)))
            found = retarget(near, near.trajectory.end, Chunk(points, 20.0, near.trajectory.end), tolerance=0.2)
        else:
            plan, at, chunk = draw("panda", rng)
            found = retarget(plan, at, chunk)
        ref, t = found.reference, np.linspace(0.0, found.trajectory.end, 3000)
        s = np.interp(t, ref.when, ref.s)
        spline = scipy.interpolate.BSpline((np.arange(len(ref.c) + 6) - 5.0) * ref.h, ref.c, 5)
        off = np.abs(found.trajectory(t) - spline(s)).max(axis=1)
        if found.joined_after is None:
            never += 1
            assert off[t > 0.9 * t[-1]].max() > 0.01
            continue
        after = off[t >= found.joined_after]
        assert after.max(initial=0.0) <= 0.01 + 1e-9
        assert after.max(initial=0.0) <= found.deviation + 1e-9
        assert found.deviation <= max(1.06 * after.max(), after.max() + 1e-3)  # a bound that is close
        before = off[t < found.joined_after]
        assert not before.size or before.max() > 0.0099
    assert never


@pytest.mark.parametrize("arm", ["panda", "ur5e"])
def test_a_goal_takes_the_time_of_ruckig(arm):
    rng = np.random.default_rng(shift_seed(4))
    for _ in range(30):
        plan, at, _ = draw(arm, rng)
        robot, goal = plan.robot, plan.trajectory(at) + rng.uniform(-0.3, 0.3, plan.robot.n)
        goal = robot.limits.clip(goal)
        found = retarget(plan, at, goal)
        assert found.status == "goal", found.reason
        check_motion(robot, plan.limits, found.trajectory, [plan.trajectory(at, k) for k in range(3)])
        np.testing.assert_allclose(found.trajectory(found.trajectory.end), goal, rtol=0.0, atol=1e-12)
        assert found.trajectory.end <= 1.001 * ruckig_duration(plan, at, goal)


def ruckig_duration(plan: planners.Plan, at: float, goal: np.ndarray, *rates: np.ndarray) -> float:
    problem, answer, n = ruckig.InputParameter(plan.robot.n), ruckig.Trajectory(plan.robot.n), plan.robot.n
    problem.current_position, problem.current_velocity, problem.current_acceleration = (
        plan.trajectory(at, k).tolist() for k in range(3)
    )
    problem.target_position = list(goal)
    if rates:
        problem.target_velocity, problem.target_acceleration = map(list, rates)
    bounds = plan.limits.bounds(n)
    problem.max_velocity, problem.max_acceleration, problem.max_jerk = (
        (bounds[k] * (1.0 + 1e-6)).tolist() for k in ("velocity", "acceleration", "jerk")
    )
    done = ruckig.Ruckig(n).calculate(problem, answer)
    return answer.duration if done == ruckig.Result.Working else np.inf


def test_another_plan_is_entered_on_the_way_and_then_followed_exactly():
    rng = np.random.default_rng(shift_seed(5))
    ratios = []
    for _ in range(12):
        plan, at, _ = draw("panda", rng)
        q = plan.robot.limits.clip(plan.trajectory(at) + rng.uniform(-0.2, 0.2, 7))
        other = planners.plan(plan.robot, plan.robot.limits.clip(q + rng.uniform(-1.0, 1.0, 7)), q, limits=PANDA)
        found = retarget(plan, at, other)
        assert found.status == "joined", found.reason
        check_motion(plan.robot, PANDA, found.trajectory, [plan.trajectory(at, k) for k in range(3)])
        assert np.abs(found.trajectory.jumps(2)).max() <= 1e-13  # knots are rounded, and jerks are thousands
        end = other.trajectory.end
        t = np.linspace(0.0, min(0.04 * end, found.trajectory.end), 50)
        np.testing.assert_allclose(found.trajectory(found.trajectory.end - t), other.trajectory(end - t), atol=1e-9)
        ratios.append(found.trajectory.end / (ruckig_duration(plan, at, other.trajectory(0.0)) + end))
    assert np.median(ratios) < 0.8 and max(ratios) <= 1.0 + 1e-9


def best_entry(plan: planners.Plan, at: float, other: planners.Trajectory) -> float:
    """The least duration of entry and rest among many instants, by Ruckig."""
    totals = []
    for t in np.linspace(0.0, 0.95 * other.end, 150):
        totals.append(ruckig_duration(plan, at, other(t), other(t, 1), other(t, 2)) + other.end - t)
    return min(totals)


def test_a_plan_is_entered_nearly_as_early_as_possible():
    rng = np.random.default_rng(shift_seed(15))
    over = []
    for _ in range(8):
        plan, at, _ = draw("panda", rng)
        q = plan.robot.limits.clip(plan.trajectory(at) + rng.uniform(-0.2, 0.2, 7))
        other = planners.plan(plan.robot, plan.robot.limits.clip(q + rng.uniform(-1.0, 1.0, 7)), q, limits=PANDA)
        over.append(retarget(plan, at, other).trajectory.end / best_entry(plan, at, other.trajectory))
    assert np.median(over) < 1.005 and max(over) < 1.05


def test_a_chunk_is_entered_where_the_arm_is_or_by_the_clock():
    robot, t = optik.load("panda"), np.arange(30)[:, None] / 20.0
    rest = planners.plan(robot, REST, REST + 0.1, limits=PANDA)
    now = rest.trajectory.end + 1.0
    fast = Chunk(
        REST + 0.5 * (t - 0.1), 20.0, now - 0.3
    )  # the arm is where the chunk was at 0.1 s, and the clock is at 0.3 s
    nearest, clock = (retarget(rest, now, fast, align=align) for align in ("nearest", "clock"))
    assert (nearest.skipped, clock.skipped) == (3, 6) and nearest and clock
    slow = Chunk(REST + 0.005 * (t - 0.1), 20.0, now - 0.3)  # its places differ by less than the tolerance
    assert retarget(rest, now, slow).skipped == 6


def test_a_certificate_says_what_is_violated():
    plan = running("panda")[0]
    state = np.array([plan.trajectory(0.2, k) for k in range(3)])
    found = retarget(plan, 0.2, REST)
    certify = partial(certify_joined, plan.robot, found.curve, scene=None)
    assert certify(PANDA, state).is_valid
    for order, name in enumerate(("position", "velocity", "acceleration")):
        moved = state.copy()
        moved[order, 3] += 1e-6
        assert certify(PANDA, moved).reasons == (f"the {name} is discontinuous by 1e-06",)
    slow = certify(PANDA.scale(0.5, ("velocity",)), state)
    assert not slow.is_valid and slow.reasons[0].startswith("velocity of joint") and "NOT valid" in str(slow)


def test_a_motion_can_be_retargeted_again_and_again():
    rng = np.random.default_rng(shift_seed(6))
    plan, at, chunk = draw("ur5e", rng)
    motion: Any = retarget(plan, at, chunk)
    for _ in range(30):
        t = float(rng.uniform(0.0, 0.4))
        state = motion.state(t)
        target = Chunk(state[0] + np.cumsum(rng.uniform(-0.02, 0.02, (15, 6)), axis=0), 20.0, t - 0.02)
        motion = retarget(motion, t, (rng.choice([0, 1]) and target) or plan.robot.limits.clip(state[0]))
        assert motion, motion.reason
        check_motion(plan.robot, plan.limits, motion.trajectory, state)


def test_limits_of_the_whole_arm_are_proved_or_the_motion_is_kept():
    robot = optik.load("panda").with_payload(3.0)
    limits = MotionLimits.of(robot, jerk=5000.0, tool_speed=0.7)
    first = planners.plan(robot, REST + 0.3, REST, limits=limits)
    t = np.arange(30)[:, None] / 20.0
    found = retarget(first, 0.2, Chunk(REST + 0.4 * np.sin(t * np.arange(1, 8) / 3.0), 20.0, 0.2))
    assert found, found.reason
    whole = planners.certify(robot, None, found.trajectory, limits)
    assert all(whole.worst(name)[0] <= 1.0 + 1e-9 for name in ("torque", "torque_rate", "tool_speed", "jerk"))
    assert {"torque", "torque_rate", "tool_speed"} <= set(found.certificate.peaks)
    kept = retarget(
        first, 0.2, Chunk(REST + np.sin(t), 20.0, 0.2), limits=MotionLimits.of(robot, jerk=5000.0, tool_speed=1e-3)
    )
    assert kept.status is RetargetStatus.KEPT and "tool_speed" in kept.reason
    np.testing.assert_allclose(kept.trajectory(kept.trajectory.end), REST + 0.3, atol=1e-9)


@pytest.mark.parametrize("mass", [3.0, (0.5, 3.0)])
def test_states_on_torque_limits_join_chunks_and_goals(mass):
    robot = optik.load("panda").with_payload(mass)
    limits = MotionLimits(PANDA.velocity, PANDA.acceleration, PANDA.jerk, torque=robot.limits.torque)
    low, high = np.array([0.0, 0.7, 0.0, -0.9, 0.0, 1.6, 0.0]), np.array([0.6, 1.2, 0.4, -0.5, 0.3, 1.9, 0.5])
    models = [PinocchioDynamics(robot.with_payload(m)) for m in np.atleast_1d(mass)]
    rng, joined, at_limit = np.random.default_rng(shift_seed(3)), 0, 0
    plans = [planners.plan(robot, *each, limits=limits) for each in ((low, high), (high, low))]
    for k in range(40):
        plan = plans[k % 2]
        at = float(rng.uniform(0.02, 0.98) * plan.trajectory.duration)
        state = [plan.trajectory(at, order) for order in range(3)]
        at_limit += any((np.abs(model.torques(*state)) > 0.97 * robot.limits.torque).any() for model in models)
        points = state[0] + rng.uniform(-0.3, 0.3, 7) * np.sin(np.arange(15)[:, None] / 20.0 * rng.uniform(1.0, 4.0, 7))
        found = retarget(plan, at, Chunk(points, 20.0, at - 0.05) if k % 4 < 2 else rng.uniform(low, high))
        joined += bool(found)
        check_motion(robot, limits, found.trajectory, state)
        for t in np.arange(0.0, found.trajectory.end, 0.005):
            for model in models:
                tau = model.torques(*(found.trajectory(t, order) for order in range(3)))
                assert (np.abs(tau) <= robot.limits.torque).all()
    assert joined >= 39 and at_limit >= 5


def test_obstacles_are_proved_to_be_avoided_or_the_motion_is_kept():
    robot = optik.load("panda")
    there = robot.fk(REST + np.eye(7)[0] * 0.6)[:3, 3]
    boxes = ((optik.se3.pose(p=there), np.array([0.1, 0.1, 0.1])),)
    scene = optik.Scene(boxes=boxes)
    first = planners.plan(robot, REST + np.eye(7)[0] * 0.1, REST, limits=PANDA, scene=scene)
    free = retarget(first, 0.1, REST - np.eye(7)[0] * 0.3, scene=scene)
    assert free and free.certificate.clearance is not None and "contact" not in free.certificate.not_covered
    hit = retarget(first, 0.1, REST + np.eye(7)[0] * 0.8, scene=scene)
    assert not hit and "contact" in hit.reason


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"at": -1.0}, "at"), ({"at": np.nan}, "at"), ({"onto": "home"}, "onto"), ({"onto": np.zeros(5)}, "onto"),
        ({"onto": np.full(7, np.nan)}, "onto"), ({"onto": np.full(7, 3.5)}, "onto: expected a value in"),
        ({"tolerance": 0.0}, "tolerance"), ({"pace": -1.0}, "pace"),
        ({"align": "time"}, "align"), ({"longest": 0.0}, "longest"),
        ({"limits": MotionLimits(velocity=1.0, acceleration=2.0)}, "no jerk limit of joint1"), ({"motion": 3}, "motion"),
    ],
)  # fmt: skip
def test_misuse_names_the_argument(change, words):
    given = {"motion": running("panda")[0], "at": 0.1, "onto": REST} | change
    with pytest.raises(InvalidInput, match=words):
        retarget(given.pop("motion"), given.pop("at"), given.pop("onto"), **given)


@pytest.mark.parametrize(
    ("points", "rate", "words"),
    [(np.zeros(7), 20.0, "points"), (np.zeros((1, 7)), 20.0, "points"), (np.full((3, 7), np.inf), 20.0, "points"),
     (np.zeros((3, 7)), 0.0, "rate"), ("abc", 20.0, "points")],
)  # fmt: skip
def test_a_chunk_is_checked(points, rate, words):
    with pytest.raises(InvalidInput, match=words):
        Chunk(points, rate)


@pytest.mark.parametrize("points", [2, 3, 5, 65, 400])
def test_chunks_of_any_size_are_followed_to_their_end(points):
    robot = optik.load("panda")
    t = np.arange(points)[:, None] / 20.0
    P = REST + 0.2 * np.sin(t * np.linspace(0.3, 1.0, 7))
    rest = planners.plan(robot, REST + 0.01, REST, limits=PANDA)
    found = retarget(rest, rest.trajectory.end + 1.0, Chunk(P, 20.0, rest.trajectory.end + 1.0))
    assert found, found.reason
    np.testing.assert_allclose(found.trajectory(found.trajectory.end), P[-1], atol=6e-3)
    assert (found.reference.error <= 0.005 and abs(found.pace - 1.0) < 0.3) or points < 4


def test_a_state_outside_lower_limits_is_kept_with_its_joint():
    plan = running("panda")[0]
    slow = MotionLimits(velocity=0.05, acceleration=10.0, jerk=1000.0)
    kept = retarget(plan, 0.5 * plan.trajectory.end, REST, limits=slow)
    assert not kept and kept.reason.startswith("the velocity of joint")
    assert not kept.certificate.is_valid  # for these limits, which the running motion exceeds


# ---------------------------------------------------------------- the parts


def test_the_reference_is_the_penalised_spline_of_a_plain_solution():
    rng = np.random.default_rng(7)
    for m in (4, 9, 30, 90):
        P = np.cumsum(rng.normal(size=(m, 3)), axis=0) * 0.05
        spans = m - 1
        h, c = (m - 1) / spans, np.empty((spans + 5, 3))
        error = fit_reference(P, 5e-3, c)
        knots = (np.arange(spans + 11) - 5.0) * h
        B = scipy.interpolate.BSpline.design_matrix(
            np.clip(np.arange(m), 0, (m - 1) * (1 - 1e-13)), knots, 5, True
        ).toarray()
        D = np.diff(np.eye(spans + 5), 3, axis=0)
        for penalty in 10.0 ** np.arange(3.0, -6.0, -1.0):
            plain = np.linalg.solve(B.T @ B + penalty / h**5 * D.T @ D + 1e-12 * np.eye(spans + 5), B.T @ P)
            if np.abs(B @ plain - P).max() <= 5e-3:
                break
        np.testing.assert_allclose(B @ c, B @ plain, atol=1e-7)
        assert abs(np.abs(B @ c - P).max() - error) < 1e-9
        out = np.empty((4, 3))
        for s in rng.uniform(0.0, m - 1.0, 5):
            evaluate_reference(c, h, float(s), out)
            spline = scipy.interpolate.BSpline(knots, c, 5)
            for order in range(4):
                np.testing.assert_allclose(out[order], spline(s, order), rtol=1e-8, atol=1e-8)


def random_programme(rng: np.random.Generator) -> tuple[Any, ...]:
    """A spline's factors and stencils, and the objective of noisy targets."""
    N = int(rng.integers(8, 20))
    T = np.append(0.0, np.cumsum(rng.uniform(0.02, 0.06, N)))
    f, A, H = np.empty((3, N + 3)), np.empty((9, N + 3)), np.empty((4, N + 3))
    make_factors(T, f), make_stencils(f, A)
    when, w, B = np.linspace(0.02, T[-1] - 0.1, 25), np.full(25, 0.02), np.empty((25, 4))
    at = np.empty(25, dtype=np.int64)
    make_objective(T, when, w, A, H, B, at)
    target, g = np.cumsum(rng.normal(size=25)) * 0.05, np.zeros(N + 3)
    for i in range(25):
        g[at[i] : at[i] + 4] -= w[i] * B[i] * target[i]
    return f, A, H, g


def dense_rows(f: np.ndarray, E: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """All rows over the unknowns, over the width of their limits."""
    size, found = len(E), np.zeros((4, len(E), E.shape[1]))
    for i in range(E.shape[1]):
        one = np.empty((4, size))
        make_rows(f, np.ascontiguousarray(E[:, i]), one)
        for k in range(4):
            found[k, : size - k, i] = one[k, : size - k] / (limits[k, 1] - limits[k, 0])
    return found.reshape(4 * size, -1)


def test_the_iteration_solves_the_quadratic_programme_of_scipy():
    rng = np.random.default_rng(shift_seed(8))
    limits = np.array([[-2.0, 2.0], [-1.0, 0.8], [-6.0, 8.0], [-100.0, 100.0]])
    bounded = 0
    for _ in range(12):
        f, A, H, g = random_programme(rng)
        size = g.size
        c = np.zeros(size)
        steps = minimise((f, A), H, g, limits, c, np.empty((17, 4, size)), MOST_STEPS)
        bounded += steps > 0
        bands = [H[0], *(H[d, d:] for d in (1, 2, 3) for _ in range(2))]
        full = scipy.sparse.diags(bands, [0, -1, 1, -2, 2, -3, 3]).toarray()
        E = np.zeros((size, size - 5))  # the unknowns; the last three control points are one
        E[np.arange(3, size - 2), np.arange(size - 5)] = 1.0
        E[-2:, -1] = 1.0
        G, wide = dense_rows(f, E, limits), limits[:, 1] - limits[:, 0]
        low, high = (np.repeat(limits[:, side] / wide, size) for side in (0, 1))
        within = scipy.optimize.LinearConstraint(G, low, high)
        P, r = E.T @ full @ E, E.T @ g
        best = scipy.optimize.minimize(
            lambda y, P=P, r=r: float(0.5 * y @ P @ y + r @ y), np.zeros(size - 5), jac=lambda y, P=P, r=r: P @ y + r,
            method="SLSQP", constraints=within, options={"maxiter": 500, "ftol": 1e-12},
        )  # fmt: skip
        y = c[3:-2]
        assert steps >= 0 and (G @ y >= low - 1e-8).all() and (G @ y <= high + 1e-8).all()
        assert 0.5 * y @ P @ y + r @ y <= best.fun + 1e-5 * max(abs(best.fun), 1e-3)
    assert bounded > 6


def test_jerks_are_corrected_by_the_least_amount_that_meets_the_goal():
    rng = np.random.default_rng(9)
    T = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.2, 9)))
    jerk, state, goal = rng.normal(size=9), rng.normal(size=3), rng.normal(size=3)
    before, c = jerk.copy(), np.empty((4, 9))
    integrate(T, jerk, state, goal, c)
    motion = scipy.interpolate.PPoly(c, T)
    for order in range(3):
        np.testing.assert_allclose(motion(T[-1], order), goal[order], atol=1e-12)
        np.testing.assert_allclose(motion(0.0, order), state[order], atol=1e-12)
    h = np.diff(T)
    left = T[-1] - T[1:]
    R = np.stack([h**3 / 6 + left * h**2 / 2 + left**2 * h / 2, h**2 / 2 + left * h, h])
    change = (jerk - before) * np.sqrt(h)  # of least norm: a combination of the rows
    fit = np.linalg.lstsq((R / np.sqrt(h)).T, change, rcond=None)[1]
    assert fit.size == 0 or fit[0] < 1e-18


def test_a_sweep_reaches_the_rest_of_a_straight_line_in_its_least_time():
    n, k = 1, 400
    c = np.arange(-2.0, 30.0)[:, None] * 0.1  # a straight line: r' = 0.1
    s = np.linspace(0.0, 25.0, k)
    R = np.empty((k, 4, n))
    sample_reference(c, 1.0, s, R)
    limits = np.array([[[-9.0, 9.0], [-1.0, 1.0], [-0.5, 0.5], [-1e9, 1e9]]])
    rows, cap, x, times = np.empty((k, n, 4)), np.empty(k), np.empty(k), np.empty(k)
    write_joint_rows(R, limits, 100.0, rows, cap)
    sweep_pace(s, rows, cap, 1e-12, 0.0, x, times)
    v, a = 0.995 / 0.1, 0.95 * 0.5 / 0.1
    exact = np.minimum(np.minimum(2.0 * a * s, v * v), 2.0 * a * (s[-1] - s))
    np.testing.assert_allclose(x[5:-5], exact[5:-5], rtol=1e-3)
    np.testing.assert_allclose(times[-1], v / a + s[-1] / v, rtol=1e-2)


def test_cubics_and_their_trajectory_are_the_same_motion():
    rng = np.random.default_rng(shift_seed(10))
    plan, at, chunk = draw("panda", rng)
    found = retarget(plan, at, chunk)
    assert isinstance(found.curve, JointCubics)
    for j, count in enumerate(found.curve.count):
        own = scipy.interpolate.PPoly(found.curve.c[j, :, : count - 1], found.curve.knots[j, :count])
        t = rng.uniform(0.0, own.x[-1], 200)
        for order in range(3):
            np.testing.assert_allclose(own(t, order), found.trajectory(t, order)[:, j], atol=1e-11)
    whole = found.trajectory
    for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
        np.testing.assert_allclose(found.certificate.peaks[name].value, whole.extrema(order).worst, rtol=1e-9)
    margin = np.minimum(
        whole.extrema(0).least - plan.robot.limits.lower, plan.robot.limits.upper - whole.extrema(0).greatest
    )
    np.testing.assert_allclose(found.certificate.position_margin, margin, atol=1e-12)


# ---------------------------------------------------------------- streams


class Policy:
    """Chunks of a smooth intention, some time after they were observed, noisy and biased."""

    def __init__(self, seed: int, n: int, latency: float) -> None:
        self.rng, self.latency, self.seen, self.due = np.random.default_rng(seed), latency, 0.0, 0.0
        self.size, self.rate = self.rng.uniform(0.1, 0.4, n), self.rng.uniform(0.5, 2.0, n)

    def intend(self, t: Any) -> np.ndarray:
        return REST + self.size * np.sin(np.asarray(t)[..., None] * self.rate)

    def __call__(self, now: Any) -> Chunk | None:
        if now.t < self.due or now.t > 3.0:
            return None
        t = self.seen + np.arange(20) / 20.0
        points = self.intend(t) + self.rng.normal(size=(20, 7)) * 1e-3 + self.rng.normal(size=7) * 4e-3
        chunk, self.seen = Chunk(points, 20.0, self.seen), now.t
        self.due = now.t + self.rng.uniform(0.0, self.latency)
        return chunk


def test_a_stream_joins_late_and_noisy_chunks_and_ends_at_rest():
    policy = Policy(shift_seed(11), 7, 0.3)
    flow = stream(optik.load("panda"), policy, REST, limits=PANDA, realtime=False, silence=0.3)
    points = list(flow)
    t, q, dq, ddq = (np.array([getattr(p, name) for p in points]) for name in ("t", "q", "dq", "ddq"))
    np.testing.assert_allclose(np.diff(t), 1e-3, atol=1e-12)
    bounds = PANDA.bounds(7)
    assert (np.abs(dq) <= bounds["velocity"] * (1 + 1e-9)).all() and (
        np.abs(ddq) <= bounds["acceleration"] * (1 + 1e-9)
    ).all()
    assert (np.abs(np.diff(ddq, axis=0)) <= 1e-3 * bounds["jerk"] * (1 + 1e-6)).all()  # also where motions join
    assert (np.abs(np.diff(q, axis=0) - 5e-4 * (dq[1:] + dq[:-1])) <= 1e-9 * bounds["jerk"]).all()
    off = np.abs(q - policy.intend(t))[(t > 0.8) & (t < 3.0)]
    assert np.sqrt((off.max(axis=1) ** 2).mean()) < 0.02
    report = flow.report()
    assert report.joined >= 10 and not report.kept and report.late == report.missed == 0
    assert not dq[-1].any() and not ddq[-1].any() and str(report.joined) in str(report)


def test_a_stream_with_a_clock_gives_the_set_points_of_the_clock():
    policy = Policy(12, 7, 0.2)
    flow = stream(optik.load("panda"), policy, REST, limits=PANDA, rate=200.0, budget=0.05, silence=0.1)
    ticks = []
    for now in flow:
        ticks.append(round(now.t * 200.0))
        if now.t > 1.0:
            flow.stop()
    assert (np.diff(ticks) >= 1).all() and flow.report().joined >= 1
    assert not now.dq.any()


def test_a_result_that_comes_after_its_instant_is_dropped_and_the_running_motion_goes_on():
    flow = stream(optik.load("panda"), Policy(5, 7, 0.1), REST, limits=PANDA, rate=200.0, budget=0.0)
    prompt = flow.engine.run

    def slow(*given: Any) -> Any:
        time.sleep(0.05)
        return prompt(*given)

    flow.engine.run = slow  # type: ignore[method-assign] # as on a machine that is busy
    ticks = [now for now in flow if now.t < 0.5 or flow.stop()]
    assert flow.report().late >= 2 and flow.report().joined == 0
    assert all((now.q == REST).all() for now in ticks)


def test_a_chunk_of_the_future_begins_then_by_the_clock():
    robot = optik.load("panda")
    t = np.arange(20)[:, None] / 20.0
    rest = planners.plan(robot, REST + 0.001, REST, limits=PANDA)
    chunk = Chunk(REST + 0.001 + 0.2 * np.sin(t), 20.0, 2.0)
    late, soon = (retarget(rest, 1.0, chunk, align=align) for align in ("clock", "nearest"))
    assert late and soon and abs(late.trajectory.end - soon.trajectory.end - 1.0) < 0.05
    np.testing.assert_allclose(late.trajectory(1.5), soon.trajectory(0.5), atol=5e-3)


def test_arrived_goals_stay():
    robot = optik.load("panda")
    rest = planners.plan(robot, REST + 0.1, REST, limits=PANDA)
    for off in (0.0, 1e-16, 1e-13, 1e-12, 1e-11):
        found = retarget(rest, rest.trajectory.end + 1.0, REST + 0.1 + off)
        assert found.status == "goal" and found.trajectory.end < 0.01, (off, found.reason)


def test_what_is_not_limited_is_named_as_not_covered():
    plan = running("panda")[0]
    free = retarget(plan, 0.1, REST).certificate.not_covered
    assert free == ("the path of the tool", "torque", "torque rate", "tool speed", "rotation speed", "contact")


@pytest.mark.parametrize("arm", ["panda", "ur5e"])
def test_jogging_respects_limits_and_ranges_and_stops_by_itself(arm):
    name, limits = ARMS[arm]
    robot, rng = optik.load(name), np.random.default_rng(shift_seed(13))
    for _ in range(4):
        q = robot.limits.clip(rng.uniform(-1.5, 1.5, robot.n))
        jog, most = JogVelocity(timeout=0.15), limits.bounds(robot.n)["velocity"]
        flow = stream(robot, jog, q, limits=limits, realtime=False, silence=0.2)
        command, last, motions, change = np.zeros(robot.n), 0.0, [], 0.0
        for now in flow:
            if now.joined is not None:
                motions.append(now.joined)
                check_motion(robot, limits, now.joined.trajectory, (now.q, now.dq, now.ddq))
            if now.t >= change and now.t < 3.0:
                command = rng.uniform(-1.2, 1.2, robot.n) * most * (rng.random(robot.n) < 0.5)
                jog.set(command)
                change, last = now.t + rng.uniform(0.01, 0.3), now.t
        assert len(motions) > 5 and not flow.report().kept
        stop = max(limits.bounds(robot.n)["velocity"] / 7.5) + 0.3
        assert motions[-1].trajectory.end <= 0.15 + 1.1 * stop and now.t <= last + 0.15 + 1.1 * stop + 0.25


def test_a_jogged_joint_stops_at_the_end_of_its_range():
    robot = optik.load("panda")
    jog = JogVelocity(timeout=5.0)
    flow = stream(robot, jog, REST, limits=PANDA, realtime=False, silence=0.1)
    jog.set([0.0, 0.0, 0.0, 2.0, 0.0, 0.0, -0.5])
    last = list(flow)[-1]
    assert robot.limits.upper[3] - 1e-6 < last.q[3] <= robot.limits.upper[3] and last.q[6] < REST[6] - 0.5


@pytest.mark.parametrize(
    ("given", "words"),
    [({"source": 3}, "source"), ({"start": np.full(7, 9.0)}, "start"), ({"rate": 0.0}, "rate"), ({"budget": -1.0}, "budget"),
     ({"realtime": "yes"}, "realtime"), ({"silence": -1.0}, "silence"), ({"robot": "panda"}, "robot")],
)  # fmt: skip
def test_misuse_of_a_stream_names_the_argument(given, words):
    known = {"robot": optik.load("panda"), "source": lambda now: None, "start": REST, "limits": PANDA} | given
    with pytest.raises(InvalidInput, match=words):
        stream(known.pop("robot"), known.pop("source"), known.pop("start"), **known)


def test_chunks_are_read_from_a_table(tmp_path):
    robot, file = optik.load("ur5e"), tmp_path / "chunks.csv"
    rows = ["0.1,1,0,0,0,0,0,10", "0.1,0,0,0,0,0,0,0", "0.0,0,1,2,3,4,5,6", "0.0,1,1,2,3,4,5,7"]
    file.write_text("\n".join(["observed,index," + ",".join(f"q{i}_deg" for i in range(1, 7)), *rows]))
    first, second = load_chunks(file, robot, 20.0)
    assert (first.observed, second.observed, first.rate) == (0.0, 0.1, 20.0)
    np.testing.assert_allclose(np.rad2deg(second.points)[:, 5], [0.0, 10.0])
    file.write_text("observed,index,q1\n0,0,1\n")
    with pytest.raises(InvalidInput, match="columns observed,index,q1,…,q"):
        load_chunks(file, robot, 20.0)
    file.write_text("observed,index," + ",".join(robot.joint_names) + "\n0,0,1,2,3,4,5,6\n")
    with pytest.raises(InvalidInput, match="one target observed at 0 s"):
        load_chunks(file, robot, 20.0)
