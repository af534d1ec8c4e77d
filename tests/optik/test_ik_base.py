"""What every method shares: the judgement that believes none of them, restarts, time, options, and the one call."""

import os
import subprocess
import sys
import time
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import IKResult, IKStatus, JointLimits, Robot, Tolerance
from optik.errors import InvalidInput, OptikError, UnknownName
from optik.ik import DLS, IKSolver, make_solver
from optik.ik.base import Attempt
from optik.ik.problem import check_start, sample_restart
from tests import forks, oracles

PAPER = optik.load("paper6r")
ARM = oracles.table("paper6r")
START = np.radians([20, -35, 40, 25, 50, -30])
TARGET = oracles.fk(ARM, START + 0.1)
FAR = oracles.trans(x=5.0) @ TARGET


class Says(IKSolver):
    """A method that answers what it was told to, one answer an attempt, whatever the problem."""

    name: ClassVar[str] = "says"

    def __init__(self, robot, *, answers, **options):
        super().__init__(robot, **options)
        self.answers = answers
        self.starts = []

    @property
    def options(self):
        return {**super().options, "answers": self.answers}

    def attempt(self, target, start, trace, time_limit):
        answer = self.answers[min(len(self.starts), len(self.answers) - 1)]
        self.starts.append(start.copy())
        return Attempt(*answer)


class Dawdles(IKSolver):
    """A method that takes its time and finds nothing."""

    name: ClassVar[str] = "dawdles"

    def attempt(self, target, start, trace, time_limit):
        self.time_limits = [*getattr(self, "time_limits", []), time_limit]
        time.sleep(0.02)
        return Attempt(start, IKStatus.STALLED, 1)


def says(*answers, robot=PAPER, **options):
    return Says(robot, answers=answers, **options)


# ---------------------------------------------------------------- the judgement
def test_a_method_that_lies_is_rejected():
    result = says((START, IKStatus.SOLVED, 3, None, "done")).solve(TARGET, START)
    assert result.status is IKStatus.REJECTED
    assert not result
    assert result.message == "done"
    e = oracles.error(oracles.fk(ARM, START), TARGET)
    assert abs(result.position_error - np.linalg.norm(e[:3])) < 1e-13
    assert abs(result.rotation_error - np.linalg.norm(e[3:])) < 1e-13


@pytest.mark.parametrize("claim", [s for s in IKStatus if s is not IKStatus.SOLVED])
def test_a_method_too_modest_to_claim_its_success_has_it(claim):
    assert says((START + 0.1, claim, 3)).solve(TARGET, START)


@pytest.mark.parametrize("claim", list(IKStatus))
def test_a_failure_keeps_the_methods_own_reason(claim):
    result = says((START, claim, 3)).solve(TARGET, START)
    assert result.status is (IKStatus.REJECTED if claim is IKStatus.SOLVED else claim)


def test_a_pose_met_outside_the_limits_is_no_success_and_the_answer_is_inside():
    narrow = Robot("narrow", PAPER.fixed, PAPER.prismatic, PAPER.tool, JointLimits(START - 0.05, START + 0.05))
    result = says((START + 0.1, IKStatus.SOLVED, 3), robot=narrow).solve(TARGET, START)
    assert result.status is IKStatus.OUTSIDE_LIMITS
    assert not result
    assert np.abs(result.q - (START + 0.05)).max() < 1e-15
    e = oracles.error(oracles.fk(ARM, result.q), TARGET)
    assert abs(result.position_error - np.linalg.norm(e[:3])) < 1e-13  # of the answer, not of the claim


def test_a_whole_turn_past_the_limits_is_outside_them():
    result = says((START + 0.1 + np.eye(6)[0] * 2 * np.pi, IKStatus.SOLVED, 3)).solve(TARGET, START)
    assert result.status is IKStatus.OUTSIDE_LIMITS
    assert PAPER.limits.contains(result.q)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("claim", [IKStatus.SOLVED, IKStatus.STALLED])
def test_an_answer_that_is_no_number_is_no_success(joint, value, claim):
    q = START + 0.1
    q[joint] = value
    result = says((q, claim, 3)).solve(TARGET, START)
    assert not result
    assert result.status is (IKStatus.REJECTED if claim is IKStatus.SOLVED else claim)
    q[joint] = 0.0  # what is no number
    np.testing.assert_array_equal(result.q, PAPER.limits.clip(q))
    assert np.isfinite([result.position_error, result.rotation_error]).all()


def test_success_needs_both_errors_within_the_tolerance():
    e = np.abs(PAPER.pose_errors(START, TARGET))
    p, r = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
    for position, rotation, expected in (
        (1.001 * p, 1.001 * r, True),
        (0.999 * p, 1.001 * r, False),
        (1.001 * p, 0.999 * r, False),
    ):
        tolerance = Tolerance(position, rotation)
        assert bool(says((START, IKStatus.SOLVED, 1), tolerance=tolerance).solve(TARGET, START)) is expected


@given(st.integers(0, 10**6), st.sampled_from(list(IKStatus)), st.floats(-9, 1))
def test_success_is_what_the_oracle_says_it_is(seed, claim, exponent):
    rng = np.random.default_rng(seed)
    q = rng.uniform(ARM.lower, ARM.upper)
    answer = q + rng.normal(size=6) * 10.0**exponent
    target = oracles.fk(ARM, q)
    result = says((answer, claim, 1)).solve(target, START)
    e = oracles.error(oracles.fk(ARM, result.q), target)
    p, r = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
    inside = bool(((result.q >= ARM.lower - 1e-9) & (result.q <= ARM.upper + 1e-9)).all())
    assert inside
    if bool(result) != (p <= 1e-6 and r <= 1e-6):
        assert result.status is IKStatus.OUTSIDE_LIMITS  # the clipped answer may solve within the tolerance
    assert abs(result.position_error - p) < 1e-12
    assert abs(result.rotation_error - r) < 1e-9


def test_a_result_is_true_where_it_is_solved_and_nowhere_else():
    for status in IKStatus:
        assert bool(IKResult(START, status, 0, 0, 0.0, 0.0)) is (status is IKStatus.SOLVED)


def test_every_failure_says_what_to_try():
    assert IKStatus.SOLVED.advice == ""
    for status in IKStatus:
        assert status is IKStatus.SOLVED or status.advice


@pytest.mark.parametrize("field", ["position", "rotation"])
@pytest.mark.parametrize("value", [0.0, -1e-6, np.nan, "a millimetre"])
def test_a_tolerance_is_above_zero(field, value):
    with pytest.raises(InvalidInput) as caught:
        Tolerance(**{field: value})
    assert caught.value.argument == f"tolerance.{field}"


# ---------------------------------------------------------------- restarts
def test_without_restarts_there_is_one_attempt_from_the_start():
    solver = says((START, IKStatus.STALLED, 3))
    result = solver.solve(TARGET, START)
    assert (result.restarts, result.iterations) == (0, 3)
    assert len(solver.starts) == 1
    assert (solver.starts[0] == START).all()


def test_attempts_end_at_the_first_success_and_their_iterations_add_up():
    good = START + 0.1
    solver = says(
        (START, IKStatus.STALLED, 3), (START, IKStatus.STALLED, 4), (good, IKStatus.SOLVED, 5), max_restarts=9
    )
    result = solver.solve(TARGET, START)
    assert result
    assert (result.restarts, result.iterations) == (2, 12)
    assert len(solver.starts) == 3
    assert (result.q == good).all()


def test_a_failure_after_all_restarts_is_the_best_of_them():
    near, nearest = START + 0.09, START + 0.099
    answers = [(near, IKStatus.STALLED, 1), (nearest, IKStatus.MAX_ITERATIONS, 2), (START, IKStatus.STALLED, 4)]
    solver = says(*answers, max_restarts=2)
    result = solver.solve(TARGET, START)
    assert (result.q == nearest).all()
    assert result.status is IKStatus.MAX_ITERATIONS
    assert (result.restarts, result.iterations) == (2, 7)


def test_the_best_is_judged_in_units_of_the_tolerance():
    T = oracles.fk(ARM, START)
    beside, turned = oracles.trans(x=0.01) @ T, T @ oracles.rot_z(0.01)
    a, b = (oracles.damped_least_squares(ARM, goal, START, damping=0.01).q[-1] for goal in (beside, turned))
    answers = [(a, IKStatus.STALLED, 1), (b, IKStatus.STALLED, 1)]  # 0.01 m off, and 0.01 rad off
    for order in (answers, answers[::-1]):
        assert (says(*order, tolerance=Tolerance(1e-3, 1e-5), max_restarts=1).solve(T, START).q == a).all()
        assert (says(*order, tolerance=Tolerance(1e-5, 1e-3), max_restarts=1).solve(T, START).q == b).all()


def test_the_trace_is_that_of_the_attempt_whose_answer_is_given():
    traces = [np.full((2, 6), float(i)) for i in range(2)]
    answers = [(START + 0.09, IKStatus.STALLED, 1, traces[0]), (START, IKStatus.STALLED, 1, traces[1])]
    result = says(*answers, max_restarts=1).solve(TARGET, START, trace=True)
    assert (result.q == START + 0.09).all()
    assert (result.trace == traces[0]).all()


def test_restarts_begin_at_the_start_and_go_on_at_the_drawn_ones():
    solver = says((START, IKStatus.STALLED, 1), max_restarts=4)
    solver.solve(TARGET, START)
    expected = [START, *(sample_restart(PAPER, TARGET, START, i) for i in range(1, 5))]
    assert (np.array(solver.starts) == np.array(expected)).all()
    assert len({s.tobytes() for s in solver.starts}) == 5


def test_restarts_are_drawn_inside_the_limits_and_all_over_them():
    drawn = np.array([sample_restart(PAPER, TARGET, START, i) for i in range(1, 2001)])
    assert PAPER.limits.contains(drawn).all()
    u = (drawn - ARM.lower) / (ARM.upper - ARM.lower)
    assert np.abs(u.mean(axis=0) - 0.5).max() < 0.03
    assert (u.min(axis=0) < 0.01).all()
    assert (u.max(axis=0) > 0.99).all()
    assert np.abs(np.corrcoef(u.T) - np.eye(6)).max() < 0.1


def test_restarts_depend_on_the_problem():
    drawn = [sample_restart(PAPER, T, q, i) for T in (TARGET, FAR) for q in (START, START + 0.1) for i in (1, 2)]
    assert len({d.tobytes() for d in drawn}) == 8


def test_restarts_of_free_joints_stay_within_half_a_turn():
    free = Robot("free", PAPER.fixed, PAPER.prismatic, PAPER.tool, JointLimits([-np.inf] * 6, [np.inf] * 6))
    drawn = np.array([sample_restart(free, TARGET, START, i) for i in range(1, 200)])
    assert np.abs(drawn).max() <= np.pi
    assert np.abs(drawn).max() > 3.0


@pytest.mark.parametrize("bounds", [(5.0, np.inf), (-np.inf, -5.0)])
def test_restarts_of_a_half_free_joint_are_inside_its_limits_and_not_all_one(bounds):
    lower, upper = np.full(6, bounds[0]), np.full(6, bounds[1])
    free = Robot("rails", PAPER.fixed, PAPER.prismatic, PAPER.tool, JointLimits(lower, upper))
    drawn = np.array([sample_restart(free, TARGET, START, i) for i in range(1, 10)])
    assert free.limits.contains(drawn).all()
    assert (drawn.std(axis=0) > 0).all()


def test_minus_zero_is_the_same_problem_as_zero():
    other = TARGET.copy()
    other[3, 0] = -0.0
    assert (sample_restart(PAPER, TARGET, START, 1) == sample_restart(PAPER, other, START, 1)).all()


DRAW = """
import numpy as np, optik
from optik.ik import DLS
robot = optik.load("paper6r")
q = np.radians([20, -35, 40, 25, 50, -30])
target = robot.fk(np.radians([-150, 60, 40, 75, 50, -30]))
result = DLS(robot, max_restarts=50).solve(target, q)
print(result.restarts, result.iterations, result.q.tobytes().hex())
"""


def test_a_solve_with_restarts_is_the_same_in_every_process(capfd):
    other = subprocess.run(
        [sys.executable, "-c", DRAW], capture_output=True, text=True, check=True, cwd=oracles.REPOSITORY,
        env=os.environ | {"PYTHONHASHSEED": "1"},
    )  # fmt: skip
    exec(DRAW, {})
    assert capfd.readouterr().out == other.stdout
    assert int(other.stdout.split()[0]) > 0  # it did restart


# ---------------------------------------------------------------- time
def test_the_time_limit_ends_the_restarts_with_its_own_status():
    solver = Dawdles(PAPER, max_restarts=10**9, time_limit=0.05)  # without a limit this would not end
    result = solver.solve(TARGET, START)
    assert result.status is IKStatus.TIME_LIMIT
    assert not result
    assert result.iterations == result.restarts + 1 == len(solver.time_limits)
    assert solver.time_limits == sorted(solver.time_limits, reverse=True)
    assert all(0.0 < s <= 0.05 for s in solver.time_limits)


def test_without_a_time_limit_an_attempt_has_all_the_time_there_is():
    solver = Dawdles(PAPER)
    assert solver.solve(TARGET, START).status is IKStatus.STALLED
    assert solver.time_limits == [None]


def test_a_success_within_the_first_attempt_stands_however_long_it_took():
    assert DLS(PAPER, time_limit=1e-9, max_restarts=3).solve(TARGET, START)


def test_dls_ends_at_its_time_limit():
    # met only by joints outside these limits, and not proved so
    narrow = Robot("narrow", PAPER.fixed, PAPER.prismatic, PAPER.tool, JointLimits(START - 0.05, START + 0.05))
    result = DLS(narrow, time_limit=0.02, max_restarts=10**9).solve(TARGET, START)
    assert result.status is IKStatus.TIME_LIMIT
    assert result.iterations == 100 * (result.restarts + 1)


# ---------------------------------------------------------------- options
BAD_OPTIONS = [
    ("max_iterations", -1), ("max_iterations", True), ("max_iterations", 3.0), ("max_iterations", np.nan),
    ("max_iterations", 10**9 + 1), ("max_iterations", 10**30), ("max_restarts", -1), ("max_restarts", 10**9 + 1),
    ("max_restarts", 10**30), ("max_restarts", False), ("max_restarts", None), ("time_limit", 0.0),
    ("time_limit", -1.0), ("time_limit", np.nan), ("time_limit", "1 s"), ("time_limit", True), ("tolerance", 1e-6),
    ("tolerance", None),
]  # fmt: skip


@pytest.mark.parametrize(("option", "value"), BAD_OPTIONS)
def test_an_option_out_of_range_is_refused_by_name(option, value):
    for build in (lambda **o: says((START, IKStatus.STALLED, 1), **o), lambda **o: make_solver(PAPER, "dls", **o)):
        with pytest.raises(InvalidInput, match=rf"^{option}: "):
            build(**{option: value})


def test_a_robots_name_is_not_a_robot():
    with pytest.raises(InvalidInput, match=r"^robot: .*optik\.load"):
        DLS("paper6r")
    with pytest.raises(InvalidInput, match=r"^robot: "):
        optik.solve_ik("paper6r", TARGET, START)


# ---------------------------------------------------------------- the one call
def test_an_unknown_solver_is_answered_with_the_nearest_names():
    with pytest.raises(UnknownName) as caught:
        optik.solve_ik(PAPER, TARGET, START, solver="ipot")
    assert caught.value.kind == "IK method"
    assert caught.value.nearest[0] == "ipopt"
    assert caught.value.known == optik.ik.solvers()
    for hidden in ("base", "_casadi", "__init__", ""):
        with pytest.raises(UnknownName):
            optik.solve_ik(PAPER, TARGET, START, solver=hidden)
    for path in ("../ik/dls", "dls.py"):
        with pytest.raises(InvalidInput, match=r"^IK method: expected a file"):
            optik.solve_ik(PAPER, TARGET, START, solver=path)


def test_an_unknown_option_is_refused_by_name():
    with pytest.raises(InvalidInput, match=r"^options: .*dampping"):
        optik.solve_ik(PAPER, TARGET, START, solver="dls", dampping=0.1)
    with pytest.raises(InvalidInput, match=r"^options: .*dampping"):
        make_solver(PAPER, "dls", dampping=0.1)


def test_a_solver_that_is_no_name_is_refused():
    with pytest.raises(OptikError):
        optik.solve_ik(PAPER, TARGET, START, solver=None)


@pytest.mark.parametrize("value", [True, 1.0])
def test_a_bad_option_is_refused_after_its_equal_was_accepted_too(value):
    optik.solve_ik(PAPER, TARGET, START, max_iterations=1)
    with pytest.raises(InvalidInput):
        optik.solve_ik(PAPER, TARGET, START, max_iterations=value)


def test_solve_ik_keeps_a_solver_per_robot_and_options():
    from optik.ik import _get_cached

    _get_cached.cache_clear()
    for _ in range(3):
        optik.solve_ik(optik.load("paper6r"), TARGET, START, gain=0.2, max_iterations=9)
        optik.solve_ik(PAPER, TARGET, START, max_iterations=9, gain=0.2)  # the order of options is no option
    assert (_get_cached.cache_info().misses, _get_cached.cache_info().hits) == (1, 5)
    optik.solve_ik(PAPER, TARGET, START, gain=0.3)
    optik.solve_ik(PAPER.with_tool(oracles.trans(z=0.1)), TARGET, START, gain=0.2, max_iterations=9)
    assert _get_cached.cache_info().misses == 3


def test_methods_are_found_by_their_class_too_and_others_are_not():
    assert optik.ik.DLS is DLS
    with pytest.raises(AttributeError, match="dls"):
        _ = optik.ik.Newton
    with pytest.raises(AttributeError):
        _ = optik.ik._nothing


def test_a_methods_module_is_the_same_before_and_after_its_class():
    code = (
        "import sys, optik.ik; first = optik.ik.sqp; optik.ik.SQP;"
        "print(first is optik.ik.sqp is sys.modules['optik.ik.sqp'], optik.ik.SQP is optik.ik.sqp.METHOD)"
    )
    for order in (code, code.replace("first =", "optik.ik.SQP; first =")):
        assert forks.start(order)().stdout.split() == ["True", "True"]
    for wrong in ("Sqp", "dLS", "closedform"):
        with pytest.raises(AttributeError):
            getattr(optik.ik, wrong)


@pytest.mark.parametrize("solver", ["lm", "dls"])
@pytest.mark.parametrize("option", ["trace", "closest"])
@pytest.mark.parametrize("value", ["no", "", None, np.nan, 1.0])
def test_what_is_no_yes_or_no_is_refused_by_name(solver, option, value):
    for call in (make_solver(PAPER, solver).solve, lambda *a, **o: optik.solve_ik(PAPER, *a, solver, **o)):
        with pytest.raises(InvalidInput, match=rf"^{option}: "):
            call(TARGET, START, **{option: value})
    with pytest.raises(InvalidInput, match="as_printed"):
        make_solver(PAPER, "dls", as_printed="no")


@pytest.mark.parametrize("solver", ["lm", "dls"])
def test_a_trace_that_would_fill_the_memory_is_refused_by_name(solver):
    many = make_solver(PAPER, solver, max_iterations=10**9)
    assert many.solve(TARGET, START)
    with pytest.raises(InvalidInput, match=r"^trace: .*1,000,000.*1000000000"):
        many.solve(TARGET, START, trace=True)
    assert many.with_options(max_iterations=10**6).solve(TARGET, START, trace=True).trace is not None


def test_a_start_outside_the_limits_is_refused_with_the_joint_and_its_limits():
    q = START.copy()
    q[1] = 1.6
    with pytest.raises(InvalidInput, match=r"q0: .*\[-1\.48353, 1\.48353\].*joint2 = 1\.6"):
        check_start(PAPER, q)
    q[3] = -9.0  # the worst of two is named
    with pytest.raises(InvalidInput, match=r"joint4 = -9"):
        check_start(PAPER, q)
    with pytest.raises(InvalidInput, match=r"^here: "):
        check_start(PAPER, q, "here")
    assert (check_start(PAPER, PAPER.limits.upper) == PAPER.limits.upper).all()
    assert (check_start(PAPER, START.tolist()) == START).all()
