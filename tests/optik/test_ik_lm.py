"""The default method against slow oracles: arms of any kind, windings, half turns, limits, frames, tasks, threads."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import atan2, cos, inf, pi, sin

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

import optik
from optik import DHRow, IKStatus, JointLimits, Robot, Tolerance
from optik.errors import InvalidInput
from optik.ik import LM, make_solver
from optik.ik._gauss_newton import bounded_step, step_workspace
from optik.ik._lm import lanes, search
from optik.ik._lm.lanes import count_spare_joints, joint_parameters, move_to_limits
from optik.task import Task, as_task
from tests import forks, oracles
from tests.figures.ik_limits import draw as draw_configurations
from tests.robots import built
from tests.seeds import shift_seed

PAPER, ARM = optik.load("paper6r"), oracles.table("paper6r")
USUAL = Tolerance()
SIZES = (1, 4, 6, 7)  # each is compiled once, for half a minute: make soak has all up to 12
seeds = st.integers(0, 10**6)


def limited(arm, lower, upper):
    return oracles.Arm(arm.convention, arm.rows, arm.base, arm.tool, np.array(lower), np.array(upper))


def any_arm(rng, n, prismatic, convention):
    """A random arm whose limits are narrow, wide, one-sided, open or locked."""
    arm = oracles.random_arm(rng, n, prismatic=prismatic, convention=convention)
    middle, half = rng.uniform(-2, 2, n), rng.uniform(0.3, 8.0, n)
    kind = rng.integers(0, 8, n)
    half = np.where(kind == 0, 0.0, half)
    lower, upper = middle - half, middle + half
    return limited(arm, np.where(np.isin(kind, (1, 2)), -inf, lower), np.where(np.isin(kind, (1, 3)), inf, upper))


def draw(rng, arm):
    lower = np.where(np.isfinite(arm.lower), arm.lower, np.where(np.isfinite(arm.upper), arm.upper - 6.0, -3.0))
    upper = np.where(np.isfinite(arm.upper), arm.upper, lower + 6.0)
    return rng.uniform(lower, upper)


def inside(arm, q):
    return bool((np.isfinite(q) & (q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9)).all())


def check(arm, result, target, tolerance=USUAL):
    """Success is what the oracle says it is; whatever comes back is inside the limits, with the oracle's errors."""
    e = oracles.error(oracles.fk(arm, result.q), target)
    p, r = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
    assert inside(arm, result.q)
    assert abs(result.position_error - p) < 1e-12 * (1.0 + p)
    assert abs(result.rotation_error - r) < 1e-9
    assert bool(result) == (p <= tolerance.position + 1e-13 and r <= tolerance.rotation + 1e-13)


# ---------------------------------------------------------------- any arm
@settings(max_examples=20)
@given(
    seeds, st.sampled_from(SIZES), st.booleans(), st.sampled_from(["mdh", "dh"]), st.sampled_from([1e-3, 1e-6, 1e-10])
)
def test_success_is_one_and_a_failure_is_honest_whatever_the_arm(seed, n, prismatic, convention, tolerance):
    rng = np.random.default_rng(seed)
    arm = any_arm(rng, n, prismatic, convention)
    accepted = Tolerance(tolerance, 1e-6)
    solver = LM(built(arm), tolerance=accepted, max_restarts=10)
    for i in range(6):
        target = oracles.fk(arm, draw(rng, arm)) if i else oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3))
        result = solver.solve(target, draw(rng, arm))
        check(arm, result, target, accepted)
        assert i == 0 or result.status is not IKStatus.UNREACHABLE


@pytest.mark.soak
@pytest.mark.parametrize("n", range(1, 13))
def test_success_is_one_whatever_the_arm_at_length(n):
    rng, solved, solvable = np.random.default_rng(n), 0, 0
    for k in range(60):
        arm = any_arm(rng, n, bool(k & 1), ("mdh", "dh")[k >> 1 & 1])
        solver = LM(built(arm), max_restarts=30)
        for i in range(50):
            far = oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3))
            target = oracles.fk(arm, draw(rng, arm)) if i % 5 else far
            result = solver.solve(target, draw(rng, arm))
            check(arm, result, target)
            solved, solvable = solved + (bool(result) and i % 5 > 0), solvable + (i % 5 > 0)
    print(f"{n} joints: {solved} of {solvable} solved")
    assert solved > 0.97 * solvable


@given(seeds, st.sampled_from([1, 6]), st.sampled_from(["mdh", "dh"]))
def test_a_locked_joint_stays_and_the_others_solve(seed, k, convention):
    rng = np.random.default_rng(seed)
    arm = oracles.random_arm(rng, 6, convention=convention)
    lower, upper = arm.lower.copy(), arm.upper.copy()
    lower[:k] = upper[:k] = rng.uniform(-1, 1, k)
    arm = limited(arm, lower, upper)
    q = draw(rng, arm)
    result = LM(built(arm), max_restarts=50).solve(oracles.fk(arm, q), draw(rng, arm))
    check(arm, result, oracles.fk(arm, q))
    assert (result.q[:k] == lower[:k]).all()
    assert k == 1 or result


# ---------------------------------------------------------------- the chain model
def chain_pose(robot, q):
    """Forward kinematics of the chain's numbers, by plain products."""
    T = robot.fixed[0]
    for (px, py, pz, ca, sa, zero, slides, *_), x in zip(joint_parameters(robot), q, strict=True):
        T = T @ oracles.trans(px, py, pz) @ oracles.rot_x(atan2(sa, ca))
        T = T @ (oracles.rot_z(zero) @ oracles.trans(z=x) if slides else oracles.rot_z(x + zero))
    return T @ robot.tool


@given(seeds, st.integers(1, 12), st.booleans(), st.sampled_from(["mdh", "dh"]))
def test_the_chain_is_the_arm(seed, n, prismatic, convention):
    rng = np.random.default_rng(seed)
    arm = oracles.random_arm(rng, n, prismatic=prismatic, convention=convention)
    for _ in range(3):
        q = rng.uniform(-7, 7, n)
        assert np.abs(chain_pose(built(arm), q) - oracles.fk(arm, q)).max() < 1e-13 * (1 + n) * 10


@given(seeds, st.integers(2, 8), st.sampled_from([0.0, 1e-15, 1e-13, 1e-12, 2e-12, 1e-9, 1e-6]), st.booleans())
def test_the_chain_is_the_arm_where_axes_are_parallel_or_nearly_so(seed, n, off, prismatic):
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(n):
        alpha = rng.choice([0.0, pi, -pi, 0.5 * pi, -0.5 * pi]) + off * rng.choice([-1.0, 1.0])
        theta = rng.choice([0.0, pi, 0.5 * pi, rng.uniform(-3, 3)])
        rows.append(oracles.Row(*rng.uniform(-0.5, 0.5, 1), alpha, rng.uniform(-0.5, 0.5), theta))
    if prismatic:
        rows[-1] = replace(rows[-1], prismatic=True)
    for convention in ("mdh", "dh"):
        arm = oracles.Arm(convention, tuple(rows), lower=np.full(n, -9.0), upper=np.full(n, 9.0))
        q = rng.uniform(-7, 7, n)
        assert np.abs(chain_pose(built(arm), q) - oracles.fk(arm, q)).max() < 1e-11


# ---------------------------------------------------------------- sine, cosine, angle
@numba.njit
def sines_cosines(x, out):
    for i in range(x.size):
        out[i, 0], out[i, 1] = lanes.sine_cosine(x[i])


@numba.njit
def angles(s, c, out):
    for i in range(s.size):
        out[i, 0], out[i, 1] = lanes.angle_of(s[i], c[i])


def test_sine_and_cosine_are_those_of_the_library():
    rng = np.random.default_rng(102)
    x = [rng.uniform(-size, size, 20_000) for size in (1.0, 10.0, 1e3, 1e5)]
    x = np.concatenate([*x, np.arange(-4000, 4000) * (pi / 4), [0.0, -0.0, 1e-300, 1e-9, 1e5, -1e5]])
    out = np.empty((x.size, 2))
    sines_cosines(x, out)
    plain = np.array([[sin(v), cos(v)] for v in x])
    assert np.abs(out - plain).max() <= 3e-16


def test_the_angle_is_that_of_the_library_from_none_to_half_a_turn():
    near = np.logspace(-17, 0, 3000)
    theta = np.concatenate([[0.0, pi, pi / 2], near, pi - near, np.random.default_rng(103).uniform(0, pi, 20_000)])
    s, c = np.abs(np.sin(theta)), np.cos(theta)
    s[1], out = 0.0, np.empty((theta.size, 2))
    angles(s, c, out)
    plain = np.array([atan2(a, b) for a, b in zip(s, c, strict=True)])
    assert np.abs(out[:, 0] - plain).max() < 2e-13
    assert (np.abs(out[:, 0] - plain) <= 1e-13 * plain)[plain < 1.0].all()  # relative where it is small
    assert np.abs(out[:, 1] * s - plain)[s > 1e-12].max() < 2e-13
    assert out[0, 0] == 0.0
    assert out[0, 1] == pytest.approx(1.0, abs=1e-13)


# ---------------------------------------------------------------- half a turn
@pytest.mark.parametrize("off", [0.0, 1e-16, 1e-12, 1e-9, 1e-6, 1e-5, 1e-4])
def test_a_start_flipped_by_half_a_turn_is_solved_or_honestly_failed(off):
    rng, solved = np.random.default_rng(shift_seed(104)), 0
    axes = [*np.eye(3), *rng.normal(size=(17, 3))]
    solvers = LM(PAPER, max_restarts=0), LM(PAPER)
    for axis in axes:
        q = 0.6 * rng.uniform(ARM.lower, ARM.upper)
        T = oracles.fk(ARM, q)
        turn = oracles.pose((pi - off) * axis / np.linalg.norm(axis), (0, 0, 0))
        for flipped in (T @ turn, turn @ T, oracles.trans(*T[:3, 3]) @ turn @ oracles.trans(*-T[:3, 3]) @ T):
            for solver in solvers:
                check(ARM, solver.solve(flipped, q), flipped)
            # the other way round: a target that can be met, from a start whose tool is turned by half
            there = optik.solve_ik(PAPER, flipped, q)
            if there:
                back = solvers[1].solve(T, there.q)
                check(ARM, back, T)
                solved += bool(back)
                assert back
    assert solved > 3


def test_a_wrist_half_a_turn_off_gets_on_without_a_restart():
    # the error's sine is 1e-16 there: only the rotation matrix itself still knows the axis
    q = np.radians([20, -35, 40, 25, 50, -30])
    for k in (3, 5):
        start = q.copy()
        start[k] -= pi * np.sign(q[k])
        if inside(ARM, start):
            assert LM(PAPER, max_restarts=0).solve(oracles.fk(ARM, q), start)


# ---------------------------------------------------------------- windings
def nearest_winding(q, start, lower, upper):
    """Of all whole turns of q inside the limits the one nearest to the start, by trying them."""
    turns = [q + 2.0 * pi * k for k in range(-12, 13)]
    fit = [x for x in turns if lower - 1e-9 <= x <= upper + 1e-9]
    return min(fit, key=lambda x: abs(x - start)) if fit else None


BOUNDS = {
    "three turns": (-6.0 * pi, 6.0 * pi), "a turn each way": (-2.0 * pi, 2.0 * pi), "no end": (-inf, inf),
    "no upper end": (-1.0, inf), "no lower end": (-inf, 2.0), "from zero to a turn": (0.0, 2.0 * pi),
    "half a turn each way": (-pi, pi), "around half a turn": (np.radians(170.0), np.radians(190.0)),
    "off zero": (7.0, 15.0), "locked": (1.3, 1.3),
}  # fmt: skip


@pytest.mark.parametrize("bounds", BOUNDS.values(), ids=BOUNDS.keys())
def test_the_winding_is_inside_and_the_nearest_to_the_start(bounds):
    rng, solved = np.random.default_rng(shift_seed(105)), 0
    arm = limited(oracles.table("ur5e"), [bounds[0]] * 6, [bounds[1]] * 6)
    solver = LM(built(arm))
    low, high = max(bounds[0], -20.0), min(bounds[1], 20.0)
    for _ in range(60):
        q, start = rng.uniform(low, high, 6), rng.uniform(low, high, 6)
        result = solver.solve(oracles.fk(arm, q), start)
        check(arm, result, oracles.fk(arm, q))
        solved += bool(result)
        if result and result.restarts == 0:
            for i in range(6):
                best = nearest_winding(result.q[i], start[i], *bounds)
                assert abs(abs(result.q[i] - start[i]) - abs(best - start[i])) < 1e-9
    assert solved >= 58


@given(seeds)
def test_wrapping_ends_at_the_nearest_winding_and_stays_there(seed):
    """Brute force; values within some ulps of half a turn from the start, and of the limits, on purpose."""
    rng = np.random.default_rng(seed)
    lower, upper = list(BOUNDS.values())[seed % len(BOUNDS)]
    for _ in range(50):
        start = rng.uniform(max(lower, -20.0), min(upper, 20.0))
        near = rng.choice([start + pi * rng.integers(-5, 6), max(lower, -20.0), min(upper, 20.0), rng.uniform(-30, 30)])
        x = near + 2.0 * pi * rng.integers(-2, 3)
        for _ in range(rng.integers(4)):
            x = np.nextafter(x, rng.choice([-inf, inf]))
        q = np.array([x])
        arguments = np.array([False]), (np.array([lower]), np.array([upper])), np.array([start])
        search.wrap_configuration(*arguments, q)
        assert lower <= q[0] <= upper
        best = nearest_winding(x, start, lower, upper)
        assert best is None or abs(abs(q[0] - start) - abs(best - start)) < 1e-8
        assert any(search.wrap_configuration(*arguments, q) for _ in range(3)), (lower, upper, start, x)


HALF_TURN = """
import numpy as np
from optik import DHRow, JointLimits, Robot, solve_ik
rng = np.random.default_rng(1)
row = DHRow(*rng.uniform([-0.5, -np.pi, -0.5, -np.pi], [0.5, np.pi, 0.5, np.pi]))
robot = Robot.from_mdh([row], JointLimits([-np.inf], [np.inf]))
print(solve_ik(robot, robot.fk([-3.0451811403025206]), [0.09641151328727204]).status)
for k in range(300):
    start = rng.uniform(-3, 3, 1)
    for goal in (start + np.pi, start - np.pi):
        for end in (-np.inf, np.inf, goal):
            assert solve_ik(robot, robot.fk(np.nextafter(goal, end)), start)
"""


def test_a_free_joint_half_a_turn_from_its_start_does_not_go_back_and_forth_for_ever():
    done = forks.start(HALF_TURN)()
    assert done.returncode == 0, done.stderr  # below 0: killed, because the solve does not end
    assert done.stdout.startswith("solved")


@pytest.mark.parametrize("far", [1e4, 1e6, 1e8])
def test_a_free_joint_may_start_many_turns_away(far):
    arm = limited(ARM, [-inf] * 6, [inf] * 6)
    target = oracles.fk(ARM, np.full(6, 0.3))
    result = LM(built(arm)).solve(target, np.full(6, far))
    assert result
    assert np.abs(result.q - far).max() <= pi + 1e-6
    off = oracles.error(oracles.fk(arm, result.q), target)
    assert np.abs(off).max() < 1e-6 + 1e-15 * far  # the oracle's own last bits


# ---------------------------------------------------------------- limits and singular poses
def hard(rng, count):
    """Solutions where joints stand on their limits, the elbow is straight, the wrist is, or many joints are zero."""
    q = rng.uniform(ARM.lower, ARM.upper, (count, 6))
    kind = rng.integers(0, 5, count)
    one = rng.integers(0, 6, count)
    ends = np.where(rng.random((count, 6)) < 0.5, ARM.lower, ARM.upper)
    q[kind == 0, one[kind == 0]] = ends[kind == 0, one[kind == 0]]
    corner = (kind == 1)[:, None] & (rng.random((count, 6)) < 0.5)
    q[corner] = ends[corner]
    q[kind == 2, 4] = 0.0
    q[kind == 3, 2] = np.clip(0.0, ARM.lower[2], ARM.upper[2])
    zero = (kind == 4)[:, None] & (rng.random((count, 6)) < 0.5)
    q[zero] = 0.0
    return np.clip(q, ARM.lower, ARM.upper)


@pytest.mark.parametrize("spread", [0.1, None], ids=["warm", "cold"])
def test_limits_corners_and_singular_poses_are_solved(spread):
    rng = np.random.default_rng(106)
    q = hard(rng, 3000)
    if spread is None:
        starts = rng.uniform(ARM.lower, ARM.upper, q.shape)
    else:
        starts = np.clip(q + rng.normal(0, spread, q.shape), ARM.lower, ARM.upper)
    targets = oracles.fk(ARM, q)
    batch = LM(PAPER).solve_batch(targets, starts)
    p, r = oracles.off_by(oracles.fk(ARM, batch.q), targets)
    assert (batch.solved == ((p <= 1e-6) & (r <= 1e-6))).all()
    assert ((batch.q >= ARM.lower) & (batch.q <= ARM.upper)).all()
    assert (~batch.solved).sum() == 0


def test_a_start_a_hair_outside_counts_as_on_its_limit():
    start = ARM.upper + 0.9e-9
    result = LM(PAPER).solve(oracles.fk(ARM, ARM.upper - 0.1), start)
    assert result
    assert inside(ARM, result.q)
    with pytest.raises(InvalidInput):
        LM(PAPER).solve(oracles.fk(ARM, ARM.upper - 0.1), ARM.upper + 2e-9)


# ---------------------------------------------------------------- frames
def test_where_the_base_stands_changes_nothing():
    """What is promised: the same status, and the same q but for rounding, unless a tie is broken the other way."""
    rng, same = np.random.default_rng(shift_seed(107)), 0
    for _ in range(10):
        move = oracles.pose(rng.uniform(-1.7, 1.7, 3), rng.uniform(-3, 3, 3))
        fixed = np.array([move @ PAPER.fixed[0], *PAPER.fixed[1:]])
        usual, moved = LM(PAPER), LM(Robot("moved", fixed, PAPER.prismatic, PAPER.tool, PAPER.limits))
        for i in range(20):
            q, start = rng.uniform(ARM.lower, ARM.upper), rng.uniform(ARM.lower, ARM.upper)
            target = oracles.fk(ARM, q) if i % 4 else oracles.trans(x=3.0) @ oracles.fk(ARM, q)
            here, there = usual.solve(target, start), moved.solve(move @ target, start)
            assert here.status is there.status
            same += np.abs(here.q - there.q).max() < 1e-6 or i % 4 == 0
    assert same >= 196


# ---------------------------------------------------------------- iterations, restarts, time, options
@pytest.mark.parametrize("k", [0, 1, 5])
def test_an_attempt_has_so_many_iterations_and_there_are_so_many(k):
    rng = np.random.default_rng(108)
    for m in (0, 3):
        solver = LM(PAPER, max_iterations=k, max_restarts=m)
        for i in range(30):
            target = oracles.fk(ARM, rng.uniform(ARM.lower, ARM.upper))
            target = oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3)) if i % 3 == 0 else target
            result = solver.solve(target, rng.uniform(ARM.lower, ARM.upper))
            assert result.restarts <= m
            assert result.iterations <= k * (m + 1)
            check(ARM, result, target)


NARROW = Robot("narrow", PAPER.fixed, PAPER.prismatic, PAPER.tool, JointLimits(np.full(6, 0.2), np.full(6, 0.4)))
BESIDE = oracles.fk(ARM, np.full(6, 0.6))  # within reach as far as can be proved, but only by joints outside


@pytest.mark.parametrize("options", [{}, {"task": "axis_z"}, {"prefer": "limits"}], ids=str)
def test_a_time_limit_ends_the_restarts(options):
    solver = LM(NARROW, max_restarts=10**9, time_limit=0.05, **options)
    solver.with_options(max_restarts=0).solve(BESIDE, np.full(6, 0.3))  # compiled
    began = time.perf_counter()
    result = solver.solve(BESIDE, np.full(6, 0.3))
    assert time.perf_counter() - began < 5.0  # without the limit it would be days
    assert result.status is IKStatus.TIME_LIMIT


def test_neither_time_to_spare_nor_a_trace_changes_an_answer():
    rng = np.random.default_rng(109)
    plain, timed = LM(PAPER), LM(PAPER, time_limit=60.0)
    for i in range(60):
        target = oracles.fk(ARM, rng.uniform(ARM.lower, ARM.upper)) if i % 3 else oracles.trans(x=5.0)
        start = rng.uniform(ARM.lower, ARM.upper)
        a, b, c = plain.solve(target, start), timed.solve(target, start), plain.solve(target, start, trace=True)
        assert a[1:4] == b[1:4] == c[1:4]
        assert (b.q == c.q).all()
        if a:
            assert (a.q == b.q).all()
            assert c.trace.shape[1] == 6
            assert abs(np.linalg.norm(c.trace[-1, :3]) - a.position_error) < 1e-12 or a.restarts == 0


@pytest.mark.parametrize("tolerance", [1e-9, 1e-12, 1e-15, 1e-17])
def test_a_tolerance_nobody_can_keep_is_a_failure_and_not_a_wrong_arm(tolerance):
    solver = LM(PAPER, tolerance=Tolerance(tolerance, tolerance), max_restarts=3)
    result = solver.solve(oracles.fk(ARM, np.full(6, 0.3)), np.full(6, 0.2))
    assert (max(result[4:6]) <= tolerance) == bool(result)
    assert tolerance < 1e-12 or result


def test_an_arm_whose_figures_are_good_to_a_tenth_of_a_micron_is_solved():
    """`Robot` accepts a rotation that is one within 1e-6; so must the default method, or say so when it is built."""
    rng = np.random.default_rng(110)
    noise = np.zeros((6, 4, 4))
    noise[:, :3, :3] = rng.uniform(-1e-7, 1e-7, (6, 3, 3))
    robot = Robot("measured", PAPER.fixed + noise, PAPER.prismatic, PAPER.tool, PAPER.limits)
    q = np.full(6, 0.3)
    assert LM(robot).solve(robot.fk(q), q + 0.1)


def test_a_failure_is_no_further_off_than_the_start():
    """`IKResult.q`: on failure the best found; the start itself has been seen."""
    rng, worse = np.random.default_rng(111), 0
    for restarts in (0, 20):
        solver = LM(PAPER, max_restarts=restarts)
        for _ in range(150):
            start = rng.uniform(ARM.lower, ARM.upper)
            target = oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-0.6, 0.6, 3))
            result = solver.solve(target, start)
            e = oracles.error(oracles.fk(ARM, start), target)
            worse += np.hypot(result.position_error, result.rotation_error) > np.linalg.norm(e) + 1e-12
    assert worse == 0


@pytest.mark.parametrize("gain", [-1.0, np.nan, np.inf, "1", None])
def test_a_gain_that_cannot_be_meant_is_refused(gain):
    with pytest.raises(InvalidInput, match="gain"):
        LM(PAPER, gain=gain)


def test_fifteen_joints_are_refused_and_the_message_names_another_method():
    rows = [DHRow(a=0.1)] * 15
    with pytest.raises(InvalidInput, match="dls"):
        LM(Robot.from_mdh(rows, JointLimits([-1.0] * 15, [1.0] * 15)))


# ---------------------------------------------------------------- joints at their limits
def at_limits(arm, count, seed, share=0.7):
    """Targets of configurations with this share of the joints at a limit; starts 0.1 rad from them, and all at 0.1 rad."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (count, arm.n))
    end = np.where(rng.random(q.shape) < 0.5, arm.lower, arm.upper)
    q = np.where(rng.random(q.shape) < share, end, q)
    warm = np.clip(q + rng.normal(0.0, 0.1, q.shape), arm.lower, arm.upper)
    return oracles.fk(arm, q), warm, np.clip(np.full_like(q, 0.1), arm.lower, arm.upper)


def unsolved(arm, targets, starts):
    """How many are not solved, by the oracle's kinematics and the limits; every claim is the oracle's too."""
    batch = LM(built(arm)).solve_batch(targets, starts)
    p, r = oracles.off_by(oracles.fk(arm, batch.q), targets)
    assert ((batch.q >= arm.lower) & (batch.q <= arm.upper)).all()
    assert (batch.solved == ((p <= 1e-6) & (r <= 1e-6))).all()
    return int((~batch.solved).sum())


def on_a_rail(arm):
    """The arm, its base sliding a metre each way along x."""
    first = replace(arm.rows[0], alpha=arm.rows[0].alpha - pi / 2)
    rows = (oracles.Row(alpha=pi / 2, prismatic=True), first, *arm.rows[1:])
    return oracles.Arm(arm.convention, rows, arm.base, arm.tool, np.r_[-1.0, arm.lower], np.r_[1.0, arm.upper])


def narrow(n, seed):
    """A random arm with limits of its own on every joint."""
    rng = np.random.default_rng(seed)
    middle, half = rng.uniform(-1, 1, n), rng.uniform(0.5, 3.0, n)
    return limited(oracles.random_arm(rng, n, prismatic=seed % 2 == 0), middle - half, middle + half)


@pytest.mark.parametrize(
    "arm", [oracles.table("panda"), oracles.table("iiwa14"), narrow(7, 119)], ids=["panda", "iiwa14", "any"]
)
def test_a_target_with_most_joints_at_their_limits_is_solved(arm):
    targets, warm, cold = at_limits(arm, 1000, 116)
    assert unsolved(arm, targets, warm) == unsolved(arm, targets, cold) == 0


def test_a_start_a_milliradian_from_five_limits_is_solved():
    arm = oracles.table("panda")
    q = np.array([0.1149247325371392, 1.7628, 2.8973, -3.0718, -2.8973, 3.7525, 2.8973])
    start = [0.113644, 1.762465, 2.8973, -3.0718, -2.8973, 3.751587, 2.897036]
    result = LM(built(arm)).solve(oracles.fk(arm, q), start)
    check(arm, result, oracles.fk(arm, q))
    assert result


def test_what_is_met_only_outside_the_limits_is_still_said_to_be():
    """The panda's limits, moved so that none of the configurations that meet the target is inside."""
    arm = oracles.table("panda")
    q = 0.5 * (arm.lower + arm.upper)
    tight = limited(arm, q + 0.05, q + 0.06)
    result = LM(built(tight)).solve(oracles.fk(arm, q), q + 0.055)
    check(tight, result, oracles.fk(arm, q))
    assert result.status is IKStatus.OUTSIDE_LIMITS


@given(seeds, st.integers(1, 12))
def test_joints_to_spare_are_those_beyond_six_that_can_stand_at_a_limit(seed, n):
    arm = any_arm(np.random.default_rng(seed), n, False, "mdh")
    moves = [low < high for low, high in zip(arm.lower, arm.upper, strict=True)]
    ends = [
        m and (np.isfinite(low) or np.isfinite(high)) for m, low, high in zip(moves, arm.lower, arm.upper, strict=True)
    ]
    held = count_spare_joints(built(arm))
    assert held == max(0, min(sum(moves) - 6, sum(ends)))
    q = np.random.default_rng(seed).uniform(-0.1, 0.1, (50, n))
    put = move_to_limits(built(arm), np.random.default_rng(seed), q, held)
    assert ((put != q).sum(axis=1) == held).all()
    assert ((put == q) | ((put == arm.lower) | (put == arm.upper)) & ends).all()


@pytest.mark.soak
@pytest.mark.parametrize("name", ["panda", "iiwa14", "paper6r", "a rail", "7 a", "7 b", "8 a", "8 b"])
def test_targets_with_most_joints_at_their_limits_are_solved_at_length(name):
    """A share of warm and of cold starts: what a seventh joint loses, and an eighth, whose limits are met in pairs."""
    arms = {"a rail": on_a_rail(oracles.table("panda")), "7 a": narrow(7, 120), "7 b": narrow(7, 121)}
    arms |= {"8 a": narrow(8, 122), "8 b": narrow(8, 123)}
    arm = arms[name] if name in arms else oracles.table(name)
    count = 100_000
    targets, warm, cold = at_limits(arm, count, shift_seed(117))
    lost = unsolved(arm, targets, warm), unsolved(arm, targets, cold)
    print(f"{name}: of {count} not solved {lost[0]} warm, {lost[1]} cold")
    assert lost[0] <= (0 if arm.n == 6 else 1e-4 * count)
    assert lost[1] <= (0 if arm.n == 6 else 1e-3 * count)


@pytest.mark.parametrize(("name", "fraction"), [("gen3lite", 0.3), ("gen3lite", 0.7), ("paper6r", 0.7)])
def test_singular_targets_with_joints_at_limits_are_solved(name, fraction):
    """Before joints were held at their limits, 9 of 1,000 such targets of gen3lite were lost, also from 1e-3 away."""
    robot, arm, rng = optik.load(name), oracles.table(name), np.random.default_rng(shift_seed(130))
    q = draw_configurations(robot, rng, fraction, "singular", 1000)
    assert len(q) > 500
    assert oracles.smallest(arm, q).max() < 1e-8
    targets = oracles.fk(arm, q)
    for first in (robot.limits.sample(rng, len(q)), robot.limits.clip(q + rng.normal(0.0, 1e-3, q.shape))):
        assert unsolved(arm, targets, first) == 0


@pytest.mark.parametrize("task", ["position", "axis_z"])
def test_a_task_with_most_joints_at_their_limits_is_solved(task):
    targets, _, cold = at_limits(ARM, 500, 131)
    solver, first = LM(PAPER, task=task), np.random.default_rng(131).uniform(ARM.lower, ARM.upper, cold.shape)
    for target, start in zip(targets, first, strict=True):
        result = solver.solve(target, start)
        off = oracles.task_off_by(oracles.fk(ARM, result.q), target, solver.task.mask, "target")
        assert result
        assert max(off) < 1e-6 + 1e-8
        assert inside(ARM, result.q)


def test_a_joint_of_a_short_stroke_is_near_its_limit_only_relative_to_its_range():
    """A slide of 0.1 mm always is the nearest to a limit in metres: it was always held, instead of another joint."""
    arm = narrow(6, 132)
    arm = limited(
        oracles.Arm(arm.convention, (*arm.rows, oracles.Row(prismatic=True)), arm.base, arm.tool),
        np.r_[arm.lower, 0.0], np.r_[arm.upper, 1e-4],
    )  # fmt: skip
    robot, start = built(arm), 0.5 * (arm.lower + arm.upper)
    start[2] = arm.lower[2] + 0.01
    w, packed = np.zeros((lanes.ROWS, 1)), LM(robot)._arm
    search.hold_nearest(packed, w, 7, start, 0, 0)
    assert w[lanes.HELD_JOINTS, 0] == 1 << 2
    assert w[lanes.NEXT + 2, 0] == arm.lower[2]


def test_restarts_one_by_one_are_those_of_one_call_also_beyond_the_hundredth():
    """A solve with a time limit runs each attempt alone; late attempts start near the best iterate of those before."""
    for seed in range(3):
        rng = np.random.default_rng((133, seed))
        target, start = oracles.fk(ARM, rng.uniform(ARM.lower, ARM.upper)), rng.uniform(0.2, 0.4, 6)
        plain = LM(NARROW, max_restarts=140).solve(target, start)
        alone = LM(NARROW, max_restarts=140, time_limit=600.0).solve(target, start)
        assert plain.iterations == alone.iterations
        assert plain.status is alone.status
        assert abs(plain.position_error - alone.position_error) < 1e-9


def test_a_bounded_step_is_inside_and_mostly_the_least_squares_of_scipy():
    rng, same, worse = np.random.default_rng(shift_seed(134)), 0, 0
    for k in range(300):
        n = (3, 6, 7)[k % 3]
        J, e, q, dq = rng.normal(size=(6, n)), rng.normal(size=6), rng.normal(size=n), np.empty(n)
        low, high, damping = -rng.uniform(0.01, 0.5, n), rng.uniform(0.01, 0.5, n), 10.0 ** rng.uniform(-8, 0)
        low[rng.random(n) < 0.3] = 0.0
        assert bounded_step(J, e, damping, (q + low, q + high), q, dq, step_workspace(n))
        assert (dq >= low - 1e-12).all()
        assert (dq <= high + 1e-12).all()
        stacked, right = np.vstack([J, np.sqrt(damping) * np.eye(n)]), np.r_[e, np.zeros(n)]
        best = lsq_linear(stacked, right, (low, high), method="bvls", tol=1e-14).x
        cost, least = (np.sum((stacked @ x - right) ** 2) for x in (dq, best))
        assert least * (1.0 - 1e-9) <= cost
        worse += cost > np.sum(e**2)  # than no step: of a joint that was released and is held again
        same += cost <= least * (1.0 + 1e-9)
    assert same > 150
    assert worse <= 3


# ---------------------------------------------------------------- tasks
TASKS = [
    *map(as_task, ("position", "rotation", "axis_x", "axis_y", "axis_z")), Task((1, 1, 1, 1, 0, 1), "base"),
    Task((1, 1, 1, 0, 1, 1), "base"), Task((1, 1, 0, 1, 1, 1)), Task((0, 1, 0, 0, 1, 0)),
    Task((0, 0, 1, 1, 1, 0), "base"), Task((1, 0, 0, 0, 0, 0), "base"), Task((1, 0, 1, 0, 0, 1), "base"),
]  # fmt: skip


@pytest.mark.parametrize("name", ["lm", "dls"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_a_task_met_is_met_by_its_own_definition(task, name):
    rng, solved = np.random.default_rng(shift_seed(112)), 0
    solver = make_solver(PAPER, name, task=task, max_restarts=20)
    for i in range(30):
        target = oracles.fk(ARM, rng.uniform(ARM.lower, ARM.upper))
        if i % 5 == 0:  # anywhere, out of reach too
            target = oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-1, 1, 3))
        result = solver.solve(target, rng.uniform(ARM.lower, ARM.upper))
        p, r = oracles.task_off_by(oracles.fk(ARM, result.q), target, task.mask, task.frame)
        assert inside(ARM, result.q)
        assert abs(result.position_error - p) < 1e-12
        assert abs(result.rotation_error - r) < 1e-8
        assert bool(result) == (p <= 1e-6 and r <= 1e-6)
        solved += bool(result) and i % 5 > 0
    assert solved >= 19


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_what_is_free_is_not_held(task):
    """Move the target along what the task leaves free: the old answer still meets it."""
    rng = np.random.default_rng(113)
    solver = LM(PAPER, task=task)
    for _ in range(10):
        target = oracles.fk(ARM, 0.7 * rng.uniform(ARM.lower, ARM.upper))
        result = solver.solve(target, 0.5 * rng.uniform(ARM.lower, ARM.upper))
        if not result:
            continue
        axes = target[:3, :3] if task.frame == "target" else np.eye(3)
        moved = target.copy()
        moved[:3, 3] += axes @ ((np.array(task.mask[:3]) == 0) * rng.uniform(-1, 1, 3))
        free = [k for k in range(3) if not task.mask[3 + k]]
        turn = np.eye(3)
        if len(free) == 1:
            turn = oracles.pose(rng.uniform(-3, 3) * np.eye(3)[free[0]], (0, 0, 0))[:3, :3]
        elif len(free) == 3:
            turn = oracles.pose(rng.uniform(-1.5, 1.5, 3), (0, 0, 0))[:3, :3]
        if task.frame == "target":
            if len(free) != 1 or all(task.mask[:3]):  # position components are told along the target's own axes
                moved[:3, :3] = target[:3, :3] @ turn
        elif len(free) == 3 or len(free) == 1:
            moved[:3, :3] = turn @ target[:3, :3]
        again = solver.solve(moved, result.q)
        if task.frame == "target" and not all(task.mask[:3]) and len(free) == 3:
            continue  # turning the target turns the axes that the position is told along
        assert again.iterations == 0
        assert (again.q == result.q).all()


# ---------------------------------------------------------------- threads
@pytest.mark.parametrize("options", [{}, {"task": "axis_z"}, {"time_limit": 60.0}], ids=str)
def test_one_solver_in_eight_threads_answers_as_in_one(options):
    rng, solver = np.random.default_rng(115), LM(PAPER, max_restarts=20, **options)
    targets = oracles.fk(ARM, rng.uniform(ARM.lower, ARM.upper, (400, 6)))
    starts = rng.uniform(ARM.lower, ARM.upper, (400, 6))
    serial = [solver.solve(T, q) for T, q in zip(targets, starts, strict=True)]
    with ThreadPoolExecutor(8) as pool:
        threaded = list(pool.map(solver.solve, targets, starts))
    for a, b in zip(serial, threaded, strict=True):
        assert (a.q == b.q).all()
        assert a[1:6] == b[1:6]


def test_an_arm_with_the_widest_limits_is_solved():
    robot = optik.load("panda").with_limits(lower=np.full(7, -1e5), upper=np.full(7, 1e5))
    q = np.array([0.1, -0.7, 0.2, -2.0, 0.1, 1.5, 0.3])
    assert make_solver(robot, "lm").solve(robot.fk(q), q + 0.1)
