"""The paper's iteration against a plain one with SciPy's logarithm and a matrix inverse."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import DHRow, IKStatus, JointLimits, Robot
from optik.errors import InvalidInput
from optik.ik import DLS, make_solver
from optik.ik.dls import iterate
from tests import oracles
from tests.robots import BOUNDED, built
from tests.seeds import shift_seed

PAPER = optik.load("paper6r")
each_robot = pytest.mark.parametrize("name", BOUNDED)
seeds = st.integers(0, 10**6)


def problems(name, count, seed, spread=0.1):
    """Targets with a known solution, and starts so far from it, clamped to the limits."""
    rng, arm = np.random.default_rng(seed), oracles.table(name)
    solution = rng.uniform(*oracles.span(arm), (count, arm.n))
    start = np.clip(solution + rng.normal(0.0, spread, solution.shape), arm.lower, arm.upper)
    return [oracles.fk(arm, q) for q in solution], start


# ---------------------------------------------------------------- against the oracle
@each_robot
@pytest.mark.parametrize(("damping", "step"), [(0.05, 1.0), (0.1, 0.5), (0.2, 1.5), (0.5, 1.0)])
def test_every_iterate_is_the_plain_iterations(name, damping, step):
    arm, robot = oracles.table(name), optik.load(name)
    solver = DLS(robot, damping=damping, step=step, max_iterations=25)
    for target, start in zip(*problems(name, 5, 41, spread=0.3), strict=True):
        plain = oracles.damped_least_squares(arm, target, start, damping=damping, step=step, iterations=25)
        result = solver.solve(target, start, trace=True)
        assert result.iterations == len(plain.q) - 1
        assert np.abs(result.trace - plain.errors).max() < 1e-9
        assert bool(result) == plain.solved
        best = plain.q[-1] if plain.solved else plain.q[np.argmin(np.linalg.norm(plain.errors, axis=1))]
        assert np.abs(result.q - best).max() < 1e-9


@each_robot
def test_every_iterate_of_a_run_that_hits_its_limits_is_the_plain_iterations(name):
    # limits so narrow that the clamp of eq. 13 acts in most iterations
    arm, robot = oracles.table(name), optik.load(name)
    rng = np.random.default_rng(42)
    for _ in range(10):
        middle = rng.uniform(arm.lower, arm.upper)
        lower, upper = np.maximum(arm.lower, middle - 0.1), np.minimum(arm.upper, middle + 0.1)
        narrow = Robot(name, robot.fixed, robot.prismatic, robot.tool, JointLimits(lower, upper))
        plain_arm = replace(arm, lower=lower, upper=upper)
        target = oracles.fk(arm, middle + rng.uniform(-0.3, 0.3, arm.n))
        plain = oracles.damped_least_squares(plain_arm, target, middle, damping=0.1, iterations=15)
        trace = DLS(narrow, damping=0.1, max_iterations=15).solve(target, middle, trace=True).trace
        assert np.abs(trace - plain.errors).max() < 1e-9
        assert ((plain.q == lower) | (plain.q == upper)).any()  # the clamp did act


@given(seeds, st.sampled_from(["mdh", "dh"]), st.integers(1, 8))
def test_arms_of_any_length_with_a_sliding_joint_iterate_as_the_plain_iteration_does(seed, convention, n):
    rng = np.random.default_rng(seed)
    arm = oracles.random_arm(rng, n, prismatic=True, convention=convention)
    q = rng.uniform(-2, 2, n)
    target, start = oracles.fk(arm, q), q + rng.uniform(-0.3, 0.3, n)
    plain = oracles.damped_least_squares(arm, target, start, damping=0.2, iterations=8)
    trace = DLS(built(arm), damping=0.2, max_iterations=8).solve(target, start, trace=True).trace
    assert trace.shape == plain.errors.shape
    assert np.abs(trace - plain.errors).max() < 1e-9


# ---------------------------------------------------------------- the paper's misprint and the paper's claims
def test_equation_9_as_printed_solves_none_and_corrected_solves_most():
    targets, starts = problems("paper6r", 1000, shift_seed(46))
    printed, corrected = DLS(PAPER, as_printed=True), DLS(PAPER, damping=0.01)
    wrong = [printed.solve(T, q) for T, q in zip(targets, starts, strict=True)]
    right = [corrected.solve(T, q) for T, q in zip(targets, starts, strict=True)]
    assert sum(map(bool, wrong)) == 0
    assert {r.iterations for r in wrong} == {100}
    assert sum(map(bool, right)) >= 940
    assert 4 <= np.median([r.iterations for r in right if r]) <= 5


def test_equation_9_as_printed_turns_the_tool_away():
    q = np.radians([20, -35, 40, 25, 50, -30])
    target = PAPER.fk(q).copy()
    target[:3, :3] = oracles.rot_z(0.1)[:3, :3] @ target[:3, :3]
    printed = DLS(PAPER, as_printed=True, damping=0.0, step=0.01, max_iterations=1).solve(target, q, trace=True)
    corrected = DLS(PAPER, damping=0.0, step=0.01, max_iterations=1).solve(target, q, trace=True)
    assert abs(np.linalg.norm(printed.trace[1, 3:]) - 0.101) < 1e-5
    assert abs(np.linalg.norm(corrected.trace[1, 3:]) - 0.099) < 1e-5


def test_more_damping_solves_fewer_in_more_iterations():
    targets, starts = problems("paper6r", 100, shift_seed(47))
    solved, iterations = [], []
    for damping in (0.01, 0.05, 0.1, 0.2):
        solver = DLS(PAPER, damping=damping)
        results = [solver.solve(T, q) for T, q in zip(targets, starts, strict=True)]
        solved.append(sum(map(bool, results)))
        iterations.append(np.median([r.iterations for r in results if r]))
    assert solved == sorted(solved, reverse=True)
    assert iterations == sorted(iterations)
    assert solved[0] - solved[-1] > 20


def test_undamped_whole_steps_are_newtons_and_converge_quadratically():
    q = np.radians([20, -35, 40, 25, 50, -30])
    result = DLS(PAPER, damping=0.0).solve(PAPER.fk(q), q + 0.05, trace=True)
    size = np.linalg.norm(result.trace, axis=1)
    assert result
    assert (size[1:] < 5 * size[:-1] ** 2 + 1e-15).all()


# ---------------------------------------------------------------- honesty in hard places
def test_without_damping_a_singular_pose_stalls_and_the_message_says_what_would_help():
    sliders = Robot.from_mdh([DHRow(prismatic=True)] * 3, JointLimits([-1.0] * 3, [1.0] * 3))
    for robot, q in ((PAPER, np.zeros(6)), (sliders, np.zeros(3))):
        result = DLS(robot, damping=0.0).solve(oracles.pose((0.1, 0.2, 0.3), (0.1, 0.1, 0.1)) @ robot.fk(q), q)
        assert result.status is IKStatus.STALLED
        assert "damping" in result.message
        assert result.iterations == 0
        assert (result.q == q).all()
        assert result.status.advice


def test_a_joint_that_starts_on_its_limit_may_leave_it():
    q = PAPER.limits.clip(np.array([0.3, -0.6, np.pi / 2, 0.4, 0.9, -0.5]))
    inside = q - [0, 0, 0.2, 0, 0, 0]
    result = DLS(PAPER).solve(PAPER.fk(inside), q)
    assert result
    assert np.abs(result.q - inside).max() < 1e-4


# ---------------------------------------------------------------- options
BAD_OPTIONS = [
    ("damping", -1e-9), ("damping", np.nan), ("damping", np.inf), ("step", 0.0), ("step", -1.0), ("step", np.nan),
    ("step", np.inf), ("damping", "x"), ("damping", None), ("step", np.ones(2)), ("max_iterations", "10"),
]  # fmt: skip


@pytest.mark.parametrize(("option", "value"), BAD_OPTIONS)
def test_an_option_out_of_range_is_refused_by_name(option, value):
    with pytest.raises(InvalidInput, match=rf"^{option}: "):
        DLS(PAPER, **{option: value})
    with pytest.raises(InvalidInput):
        make_solver(PAPER, "dls", **{option: value})
    with pytest.raises(InvalidInput):
        DLS(PAPER).with_options(**{option: value})


def test_numpys_whole_numbers_count():
    assert DLS(PAPER, max_iterations=np.int64(7)).max_iterations == 7


def test_a_read_only_or_strided_problem_compiles_nothing():
    (target,), (start,) = problems("paper6r", 1, 44)
    expected, compiled = DLS(PAPER).solve(target, start), len(iterate.signatures)
    frozen = target.copy(), start.copy()
    for array in frozen:
        array.setflags(write=False)
    for T, q in (frozen, (np.asfortranarray(target), np.repeat(start, 2)[::2])):
        assert (DLS(PAPER).solve(T, q).q == expected.q).all()
    assert len(iterate.signatures) == compiled
