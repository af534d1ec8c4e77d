"""What every IK method owes its caller; a new file in optik/ik is in here at once, and so is a plug-in."""

import pickle
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pytest

import optik
from optik import IKResult, IKStatus, Tolerance
from optik.errors import InvalidInput, MissingDependency
from optik.ik import IKSolver, make_solver
from optik.plugins.files import is_path
from optik.registry import load_method, short_name
from tests import forks, oracles
from tests.outside import everything
from tests.robots import each_robot
from tests.seeds import shift_seed

ROBOT, ARM = optik.load("paper6r"), oracles.table("paper6r")
START = np.radians([20, -35, 40, 25, 50, -30])


class Method(NamedTuple):
    asked: str  # a name, or the path of a plug-in
    name: str
    build: Any
    solver: IKSolver


@pytest.fixture(scope="module", params=everything("optik.ik"), ids=short_name)
def method(request):
    """One method by its name, built for the paper's arm."""

    def build(**options):
        return make_solver(ROBOT, request.param, **options)

    try:
        return Method(request.param, short_name(request.param), build, build())
    except MissingDependency as error:
        pytest.skip(str(error))


def near(count, seed, spread=0.1):
    rng = np.random.default_rng(seed)
    solution = rng.uniform(ARM.lower, ARM.upper, (count, 6))
    starts = np.clip(solution + rng.normal(0.0, spread, solution.shape), ARM.lower, ARM.upper)
    return list(zip([oracles.fk(ARM, q) for q in solution], starts, strict=True))


def anywhere(count, seed):
    """Targets within reach and beyond it, starts anywhere inside the limits."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        T = oracles.fk(ARM, rng.uniform(ARM.lower, ARM.upper))
        if i % 3 == 0:
            T = oracles.pose(rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3))
        yield T, rng.uniform(ARM.lower, ARM.upper)


def check(result, target, tolerance=1e-6):
    """The answer as the oracle's own forward kinematics and the limits judge it."""
    assert isinstance(result, IKResult)
    assert result.q.shape == (6,)
    assert result.q.dtype == np.float64
    assert np.isfinite(result.q).all()
    assert ((result.q >= ARM.lower - 1e-9) & (result.q <= ARM.upper + 1e-9)).all()
    e = oracles.error(oracles.fk(ARM, result.q), target)
    p, r = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
    assert abs(result.position_error - p) < 1e-12
    assert abs(result.rotation_error - r) < 1e-9
    assert isinstance(result.status, IKStatus)
    assert bool(result) is (result.status is IKStatus.SOLVED)
    if result:
        assert max(p, r) <= tolerance
    assert result.iterations >= 0
    assert result.restarts >= 0


def same(a, b):
    assert (a.q == b.q).all()
    assert a[1:6] == b[1:6]
    assert a.message == b.message
    assert (a.trace is None) is (b.trace is None)
    assert a.trace is None or (a.trace == b.trace).all()


def test_targets_near_the_start_are_mostly_solved(method):
    problems = near(100, shift_seed(71))
    results = [method.solver.solve(T, q) for T, q in problems]
    for (target, _), result in zip(problems, results, strict=True):
        check(result, target)
    assert sum(map(bool, results)) >= 90


def test_success_is_confirmed_by_another_forward_kinematics_and_the_limits_are_kept(method):
    results = []
    for target, start in anywhere(60, 72):
        results.append(method.solver.solve(target, start))
        check(results[-1], target)
    assert not all(results)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_the_tolerance_that_was_asked_for_is_kept(method, tolerance):
    solver = method.build(tolerance=Tolerance(tolerance, tolerance))
    results = []
    for target, start in near(20, shift_seed(73)):
        results.append(solver.solve(target, start))
        check(results[-1], target, tolerance)
    assert sum(map(bool, results)) >= 16


def test_a_solution_as_start_is_the_answer_or_beside_it(method):
    result = method.solver.solve(oracles.fk(ARM, START), START)
    check(result, oracles.fk(ARM, START))
    assert result
    assert np.abs(result.q - START).max() < 1e-3


def test_the_singular_zero_pose_is_a_start_and_a_target_like_any_other(method):
    zero, there = oracles.fk(ARM, np.zeros(6)), oracles.fk(ARM, START)
    check(method.solver.solve(there, np.zeros(6)), there)
    check(method.solver.solve(zero, START), zero)
    check(method.solver.solve(zero, np.zeros(6)), zero)


def test_what_cannot_be_reached_is_not_solved(method):
    for x in (2.0, 100.0, 9e5):
        target = oracles.trans(x=x) @ oracles.fk(ARM, START)
        result = method.solver.solve(target, START)
        assert not result
        assert result.status.advice
        check_far = oracles.error(oracles.fk(ARM, result.q), target)
        assert abs(result.position_error - np.linalg.norm(check_far[:3])) < 1e-15 * x * 10


def test_arguments_are_read_and_never_written(method):
    target, start = oracles.fk(ARM, START), np.clip(START + 0.3, ARM.lower, ARM.upper)
    expected = method.solver.solve(target.copy(), start.copy(), trace=True)
    before = target.copy(), start.copy()
    same(method.solver.solve(target, start, trace=True), expected)
    assert (target == before[0]).all()
    assert (start == before[1]).all()
    target.setflags(write=False)
    start.setflags(write=False)
    same(method.solver.solve(target, start, trace=True), expected)


def test_lists_and_strided_and_fortran_arrays_are_read_as_what_they_are(method):
    target, start = oracles.fk(ARM, START), np.clip(START + 0.3, ARM.lower, ARM.upper)
    expected = method.solver.solve(target, start)
    wide = np.zeros((8, 8))
    wide[::2, ::2] = target
    for T, q in (
        (target.tolist(), tuple(start.tolist())),
        (np.asfortranarray(target), np.repeat(start, 2)[::2]),
        (wide[::2, ::2], start[::-1].copy()[::-1]),
        (target.astype(">f8"), start.astype(">f8")),
        (np.longdouble(target), np.longdouble(start)),
    ):
        same(method.solver.solve(T, q), expected)
    same(method.solver.solve(np.eye(4, dtype=int), np.zeros(6, int)), method.solver.solve(np.eye(4), np.zeros(6)))


def test_the_answer_is_the_callers_own(method):
    target = oracles.fk(ARM, START)
    first = method.solver.solve(target, np.zeros(6), trace=True)
    kept = first.q.copy(), None if first.trace is None else first.trace.copy()
    method.solver.solve(oracles.fk(ARM, -START), np.zeros(6), trace=True)
    assert (first.q == kept[0]).all()
    assert first.trace is None or (first.trace == kept[1]).all()
    at_solution = method.solver.solve(target, START)
    at_solution.q[:] = 9.0
    assert START[0] != 9.0
    check(method.solver.solve(target, START), target)


def test_the_same_problem_has_the_same_answer_whatever_came_before(method):
    problems = list(anywhere(10, 74))
    forth = [method.solver.solve(T, q, trace=True) for T, q in problems]
    back = [method.build().solve(T, q, trace=True) for T, q in problems[::-1]][::-1]
    for a, b in zip(forth, back, strict=True):
        same(a, b)


def test_the_trace_is_every_error_from_the_start_to_the_answer(method):
    solver = method.build(max_restarts=0)
    for target, start in anywhere(15, 75):
        result = solver.solve(target, start, trace=True)
        bare = solver.solve(target, start)
        assert bare.trace is None
        assert bare.status is result.status
        if result.trace is None:
            continue  # a method without iterations
        assert result.trace.shape == (result.iterations + 1, 6)
        if np.linalg.norm(result.trace[0, 3:]) < 3.14:  # at half a turn both signs are right
            assert np.abs(result.trace[0] - oracles.error(oracles.fk(ARM, start), target)).max() < 1e-12
        if result:
            assert np.abs(result.trace[-1] - oracles.error(oracles.fk(ARM, result.q), target)).max() < 1e-7


def test_a_run_stopped_at_k_is_the_first_k_steps_of_the_longer_one(method):
    target, start = oracles.fk(ARM, START), np.clip(START + 0.4, ARM.lower, ARM.upper)
    whole = method.build(max_restarts=0).solve(target, start, trace=True)
    if whole.trace is None:
        assert method.name == "closed_form", "every other method iterates"
        return
    for k in range(whole.iterations):
        stopped = method.build(max_iterations=k, max_restarts=0).solve(target, start, trace=True)
        assert stopped.iterations == k
        assert stopped.status is IKStatus.MAX_ITERATIONS
        assert (stopped.trace == whole.trace[: k + 1]).all()
        if method.name != "dls":  # which returns its best configuration, not the last
            assert np.abs(whole.trace[k] - oracles.error(oracles.fk(ARM, stopped.q), target)).max() < 1e-7
        check(stopped, target)


def test_restarts_solve_more_and_the_same_in_every_solver(method):
    problems = [p for i, p in enumerate(anywhere(30, shift_seed(76))) if i % 3]
    solvers = [method.build(max_restarts=most) for most in (0, 20, 20)]
    once, often, again = ([solver.solve(T, q) for T, q in problems] for solver in solvers)
    for (target, _), one, many, repeated in zip(problems, once, often, again, strict=True):
        check(many, target)
        same(many, repeated)
        assert bool(many) >= bool(one)
        assert many.restarts <= 20
        if one:
            same(one, many)
    assert sum(map(bool, often)) >= max(15, sum(map(bool, once)))


def test_solve_ik_answers_as_the_class_does(method):
    kind = type(method.solver)
    assert load_method("optik.ik", method.asked) is kind
    if not is_path(method.asked):
        assert getattr(optik.ik, kind.__name__) is kind
    assert kind.name == method.name
    for target, start in anywhere(6, 77):
        expected = kind(ROBOT).solve(target, start, trace=True)
        same(optik.solve_ik(ROBOT, target, start, solver=method.asked, trace=True), expected)
    few = kind(ROBOT, max_iterations=1, max_restarts=2).solve(target, start)
    same(optik.solve_ik(ROBOT, target, start, method.asked, max_iterations=1, max_restarts=2), few)


@each_robot
def test_every_robot_that_comes_with_optik_is_solved(method, name):
    robot, arm = optik.load(name), oracles.table(name)
    solver = method.solver.__class__(robot)
    rng = np.random.default_rng(shift_seed(78))
    solved = 0
    for q in oracles.configurations(arm, 20, shift_seed(79)):
        target, start = oracles.fk(arm, q), np.clip(q + rng.normal(0, 0.05, arm.n), arm.lower, arm.upper)
        result = solver.solve(target, start)
        solved += bool(result)
        if result:
            assert np.abs(oracles.error(oracles.fk(arm, result.q), target)).max() <= 1e-6
    assert solved >= (12 if method.name == "jt" else 16)  # the transpose's steps are short near singular configurations


def test_another_tool_is_solved_for_that_tool(method):
    tool = oracles.pose((0.3, -0.5, 0.7), (0.02, 0.03, 0.1))
    result = method.solver.__class__(ROBOT.with_tool(tool)).solve(oracles.fk(ARM, START) @ tool, START + 0.05)
    assert result
    assert np.abs(oracles.error(oracles.fk(ARM, result.q) @ tool, oracles.fk(ARM, START) @ tool)).max() <= 1e-6


SOLVE = """
import pickle, sys
solvers, target, start = pickle.load(sys.stdin.buffer)
results = [(solver.options, solver.solve(target, start, trace=True)) for solver in solvers]
sys.stdout.buffer.write(pickle.dumps(results))
"""


@pytest.fixture(name="there", scope="module")
def _there():
    """Solvers of all methods, and their options and results in another process, by the method as it was asked for."""
    solvers = {}
    for asked in everything("optik.ik"):
        with suppress(MissingDependency):
            solvers[asked] = make_solver(
                ROBOT, asked, max_iterations=60, max_restarts=2, tolerance=Tolerance(1e-5, 1e-4)
            )
    done = forks.start(SOLVE, data=pickle.dumps((list(solvers.values()), oracles.fk(ARM, START), np.zeros(6))))()
    return dict(zip(solvers, zip(solvers.values(), pickle.loads(done.stdout), strict=True), strict=True))


def test_a_solver_pickled_to_another_process_answers_the_same(method, there):
    solver, (options, result) = there[method.asked]
    assert options == solver.options
    same(result, solver.solve(oracles.fk(ARM, START), np.zeros(6), trace=True))


def test_with_options_keeps_the_robot_and_the_other_options(method):
    other = method.solver.with_options(max_restarts=3)
    assert type(other) is type(method.solver)
    assert other.robot == ROBOT
    assert other.options == method.solver.options | {"max_restarts": 3}


POSE = oracles.fk(ARM, START)
NAN_POSE, NAN_START = POSE.copy(), START.copy()
NAN_POSE[0, 3] = NAN_START[2] = np.nan
BAD = {
    "target NaN": (NAN_POSE, START, "target"), "target a rotation": (POSE[:3, :3], START, "target"),
    "target three rows": (POSE[:3], START, "target"), "target a batch": (np.array([POSE, POSE]), START, "target"),
    "target no rotation": (POSE * [[2.0], [2.0], [2.0], [1.0]], START, "target"),
    "target a reflection": (POSE @ np.diag([1.0, 1.0, -1.0, 1.0]), START, "target"),
    "target a word": ("home", START, "target"), "target None": (None, START, "target"),
    "start NaN": (POSE, NAN_START, "q0"), "start short": (POSE, START[:5], "q0"),
    "start a batch": (POSE, START[None], "q0"), "start a number": (POSE, 0.0, "q0"),
    "start a word": (POSE, "home", "q0"), "start None": (POSE, None, "q0"),
    "start outside": (POSE, np.where(np.arange(6) == 4, 2.0, START), "q0"),
    "start in degrees": (POSE, np.degrees(START), "q0"),
}  # fmt: skip


@pytest.mark.parametrize(("target", "start", "argument"), BAD.values(), ids=BAD.keys())
def test_what_cannot_be_meant_is_refused_by_name(method, target, start, argument):
    for call in (method.solver.solve, lambda T, q: optik.solve_ik(ROBOT, T, q, solver=method.asked)):
        with pytest.raises(InvalidInput) as caught:
            call(target, start)
        assert caught.value.argument == argument
        assert str(caught.value).startswith(f"{argument}: ")


@pytest.mark.parametrize(
    ("option", "value"), [("max_iterations", -1), ("max_restarts", True), ("time_limit", 0.0), ("no_such_option", 1)]
)
def test_an_option_that_cannot_be_meant_is_refused(method, option, value):
    with pytest.raises(InvalidInput, match=option):
        method.build(**{option: value})


def test_a_method_says_nothing_aloud(method, capfd):
    solver = method.build(max_restarts=1)
    for target, start in anywhere(4, 80):
        solver.solve(target, start, trace=True)
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""


def test_a_method_has_a_name_a_docstring_and_one_class(method):
    kind = type(method.solver)
    assert is_path(method.asked) or kind.__module__ == f"optik.ik.{method.name}"
    assert kind.__doc__
    assert issubclass(kind, IKSolver)
