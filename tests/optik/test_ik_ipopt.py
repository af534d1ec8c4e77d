"""IPOPT's formulation: what it solves, what it counts, what it says, and that it says nothing aloud."""

import subprocess
import sys

import numpy as np
import pytest

import optik
from optik import DHRow, IKStatus, JointLimits, Robot, Tolerance
from optik.errors import InvalidInput
from tests import oracles
from tests.optik.test_ik_dls import problems
from tests.robots import each_robot

pytest.importorskip("casadi")
from optik.ik import IPOPT
from tests.seeds import shift_seed

PAPER = optik.load("paper6r")
FORMS = ("constraint", "least_squares")
each_form = pytest.mark.parametrize("form", FORMS)
START = np.radians([20, -35, 40, 25, 50, -30])


def honest(result, arm, target):
    """Success is what the oracle's forward kinematics and the limits say it is."""
    e = oracles.error(oracles.fk(arm, result.q), target)
    p, r = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
    assert abs(result.position_error - p) < 1e-12
    assert abs(result.rotation_error - r) < 1e-9
    assert ((result.q >= arm.lower) & (result.q <= arm.upper)).all()
    assert bool(result) == (p <= 1e-6 and r <= 1e-6)
    assert result.status in IKStatus


# ---------------------------------------------------------------- problems
def four_joints():
    """An arm of four joints, one of them sliding, with nothing special about it."""
    rows = [DHRow(a=0.2, alpha=0.3 * i, d=0.1, theta=0.2 * i, prismatic=i == 2) for i in range(4)]
    base, end = oracles.pose((0.4, -0.2, 0.9), (0.1, 0.2, 0.3)), oracles.pose((3.0, 0.4, 0.2), (0.0, 0.1, 0.2))
    return Robot.from_mdh(rows, JointLimits([-2.0] * 4, [2.0] * 4), base=base, tool=end, name="four")


# ---------------------------------------------------------------- solving
@each_form
@each_robot
def test_targets_near_the_start_are_solved(name, form):
    robot, arm = optik.load(name), oracles.table(name)
    if form == "constraint" and robot.n < 6:
        with pytest.raises(optik.errors.InvalidInput, match="no more constraints than moving joints"):
            IPOPT(robot, form=form)
        return
    solver = IPOPT(robot, form=form)
    targets, starts = problems(name, 50, shift_seed(53))
    results = [solver.solve(T, q) for T, q in zip(targets, starts, strict=True)]
    for target, result in zip(targets, results, strict=True):
        honest(result, arm, target)
    # the square of a redundant arm has a singular Hessian: IPOPT creeps, and the constraints are the default
    assert sum(map(bool, results)) >= (24 if form == "least_squares" and robot.n > 6 else 48)


@each_form
def test_failures_are_honest_and_carry_ipopts_own_word(form):
    solver, arm = IPOPT(PAPER, form=form), oracles.table("paper6r")
    rng = np.random.default_rng(54)
    statuses = set()
    for _ in range(60):
        target = oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3))  # most are out of reach
        result = solver.solve(target, rng.uniform(arm.lower, arm.upper))
        honest(result, arm, target)
        assert result.status is not IKStatus.REJECTED
        if result.status is not IKStatus.UNREACHABLE:  # which is proved before IPOPT is asked
            assert result.message.startswith("IPOPT: ")
            assert len(result.message) > len("IPOPT: ")
        statuses.add(result.status)
    assert IKStatus.STALLED in statuses


def test_a_pose_that_no_configuration_has_is_called_infeasible_by_ipopt():
    turned = PAPER.fk(START) @ oracles.pose((0.0, 2.5, 0.0), (0.0, 0.0, 0.0))  # within reach, but not from that side
    result = IPOPT(PAPER).solve(turned, START)
    assert result.status is IKStatus.STALLED
    assert result.message == "IPOPT: Infeasible_Problem_Detected"
    least = IPOPT(PAPER, form="least_squares").solve(turned, START)
    assert least.status is IKStatus.STALLED  # a minimum, but the pose is not met there
    assert least.message == "IPOPT: Solve_Succeeded"


@each_form
def test_a_start_on_a_limit_and_a_solution_on_a_limit_are_fine(form):
    upper, lower = PAPER.limits.upper, PAPER.limits.lower
    q = np.array([0.3, upper[1], -0.7, lower[3], 0.9, -0.5])
    result = IPOPT(PAPER, form=form).solve(PAPER.fk(q), q)
    honest(result, oracles.table("paper6r"), PAPER.fk(q))
    assert result


@pytest.mark.parametrize("options", [{}, {"form": "least_squares"}])
def test_an_arm_of_four_joints_is_solved_quietly(options, capfd):
    robot, q = four_joints(), np.array([0.1, 0.2, 0.3, 0.4])
    result = IPOPT(robot, **options).solve(robot.fk(q), q + 0.05)
    assert result
    assert result.iterations <= 100
    assert np.abs(result.q - q).max() < 1e-4
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""


@each_form
def test_a_time_limit_that_is_over_at_once_is_the_status(form):
    result = IPOPT(PAPER, form=form, time_limit=1e-9, max_restarts=5).solve(PAPER.fk(START), np.zeros(6))
    assert result.restarts == 0
    assert result.status is IKStatus.TIME_LIMIT
    assert result.message == "IPOPT: User_Requested_Stop"


@each_form
def test_building_and_solving_say_nothing_aloud(form, capfd):
    solver = IPOPT(PAPER, form=form)
    for target in (PAPER.fk(START), oracles.trans(x=5.0) @ PAPER.fk(START)):
        for trace in (False, True):
            solver.solve(target, np.zeros(6), trace=trace)
    solver.with_options(max_iterations=1).solve(PAPER.fk(START), np.zeros(6))
    with pytest.raises(InvalidInput):
        IPOPT(PAPER, form=form, solver_options={"no_such_option": 1})
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""


FIRST = """
import optik
robot = optik.load("paper6r")
optik.solve_ik(robot, robot.fk([0.1] * 6), [0.2] * 6, solver="ipopt", form={!r})
"""


@each_form
def test_the_first_solve_of_a_process_says_nothing_aloud(form):
    # IPOPT greets once a process, so only a fresh one can tell
    done = subprocess.run(
        [sys.executable, "-c", FIRST.format(form)], capture_output=True, check=True, cwd=oracles.REPOSITORY
    )
    assert done.stdout + done.stderr == b""


# ---------------------------------------------------------------- options
def test_a_time_limit_that_does_not_bind_changes_nothing():
    for target, start in zip(*problems("paper6r", 5, 60), strict=True):
        free, timed = (IPOPT(PAPER, time_limit=limit, max_restarts=2).solve(target, start) for limit in (None, 60.0))
        assert (free.q == timed.q).all()
        assert free[1:6] == timed[1:6]


def test_a_looser_tolerance_needs_no_more_iterations():
    loose, tight = (IPOPT(PAPER, tolerance=Tolerance(x, x)) for x in (1e-2, 1e-9))
    for target, start in zip(*problems("paper6r", 10, 58), strict=True):
        a, b = loose.solve(target, start), tight.solve(target, start)
        assert a.iterations <= b.iterations
        assert b.position_error <= 1e-9 or not b


def test_solver_options_reach_ipopt():
    target = PAPER.fk(START)
    result = IPOPT(PAPER, solver_options={"max_iter": 1}).solve(target, np.zeros(6))
    assert result.iterations == 1
    again = optik.solve_ik(PAPER, target, np.zeros(6), "ipopt", solver_options={"max_iter": 1})
    assert (again.q == result.q).all()


@pytest.mark.parametrize("options", [{"no_such_option": 1}, {"max_iter": "many"}])
def test_solver_options_that_ipopt_does_not_know_are_refused_by_name(options):
    with pytest.raises(InvalidInput) as caught:
        IPOPT(PAPER, solver_options=options)
    assert caught.value.argument == "solver_options"
    assert next(iter(options)) in str(caught.value)
    with pytest.raises(InvalidInput):
        IPOPT(PAPER, solver_options=5)


def test_an_unknown_form_is_refused_with_those_that_exist():
    with pytest.raises(InvalidInput, match=r'^form: expected "constraint" or "least_squares"'):
        IPOPT(PAPER, form="penalty")
