"""Redundancy resolution: the preference is at a minimum in the null space with the target met, against SciPy."""

import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import optik
from optik.errors import InvalidInput
from optik.ik import LM, _casadi, make_solver
from optik.ik._null_space import RANK_FLOOR, cost, log_manipulability
from optik.task import Task, as_task
from tests import oracles
from tests.robots import built
from tests.seeds import shift_seed

HALF = np.pi / 2
LBR = oracles.Arm(
    "dh",
    tuple(
        oracles.Row(alpha=alpha, d=d)
        for alpha, d in ((-HALF, 0.34), (HALF, 0), (HALF, 0.4), (-HALF, 0), (-HALF, 0.4), (HALF, 0), (0, 0.126))
    ),
    lower=-np.radians([170, 120, 170, 120, 170, 120, 175]),
    upper=np.radians([170, 120, 170, 120, 170, 120, 175]),
)
SIX = oracles.table("paper6r")


CASES = {
    "LBR pose": (LBR, "pose"),
    "6R position": (SIX, "position"),
    "6R axis": (SIX, "axis_z"),
    "LBR axis": (LBR, "axis_z"),
}
each_case = pytest.mark.parametrize(("arm", "task"), CASES.values(), ids=CASES.keys())
PREFERENCES = ["posture", "limits", "manipulability", {"posture": 0.3, "limits": 1.0, "manipulability": 0.1}]


def rows_of(arm, task, q, target):
    """The task's rows of the geometric Jacobian, along the target's axes."""
    J = oracles.jacobian(arm, q)
    R = target[:3, :3]
    J = np.vstack([R.T @ J[:3], R.T @ J[3:]])
    return J[np.array(as_task(task).mask, bool)]


def value(arm, task, prefer, posture, q, target):
    """The preference by its words: ½|q − posture|², ½ Σ ((q − middle) / half)², −log √det(J Jᵀ)."""
    weights = {prefer: 1.0} if isinstance(prefer, str) else prefer
    middle, half = 0.5 * (arm.lower + arm.upper), 0.5 * (arm.upper - arm.lower)
    total = weights.get("posture", 0.0) * 0.5 * np.sum((q - posture) ** 2)
    total += weights.get("limits", 0.0) * 0.5 * np.sum(((q - middle) / half) ** 2)
    if weights.get("manipulability"):
        J = rows_of(arm, task, q, target)
        total -= weights["manipulability"] * np.sum(np.log(np.linalg.svd(J, compute_uv=False)))
    return total


def gradient(f, q, h=1e-6):
    return np.array([(f(q + h * e) - f(q - h * e)) / (2 * h) for e in np.eye(q.size)])


def task_error(arm, task, target, q):
    """Components of the error that count (one lone free rotation: the axis, as a cross product)."""
    T = oracles.fk(arm, q)
    p = target[:3, :3].T @ (T[:3, 3] - target[:3, 3])
    if task == "position":
        return p
    D = target[:3, :3].T @ T[:3, :3]
    return np.concatenate([p, D[:2, 2] if task == "axis_z" else Rotation.from_matrix(D).as_rotvec()])


@each_case
@pytest.mark.parametrize("prefer", PREFERENCES, ids=str)
def test_no_way_leads_further_down_and_the_target_stays_met(arm, task, prefer):
    rng, robot, still = np.random.default_rng(shift_seed(501)), built(arm), 0
    solver, plain = LM(robot, task=task, prefer=prefer), LM(robot, task=task)
    for _ in range(6):
        target = oracles.fk(arm, 0.8 * rng.uniform(arm.lower, arm.upper))
        start = 0.8 * rng.uniform(arm.lower, arm.upper)
        before, result = plain.solve(target, start), solver.solve(target, start)
        assert bool(before) == bool(result)
        if not result:
            continue
        p, r = oracles.task_off_by(oracles.fk(arm, result.q), target, as_task(task).mask, "target")
        assert p <= 1e-6
        assert r <= 1e-6
        assert abs(result.position_error - p) < 1e-12
        assert ((result.q >= arm.lower) & (result.q <= arm.upper)).all()

        def f(q, target=target, start=start):
            return value(arm, task, prefer, start, q, target)

        # a plain answer is off the target by up to 1e-6, and what that gains is no gain
        slope = gradient(f, before.q) @ np.linalg.pinv(rows_of(arm, task, before.q, target), rcond=1e-9)
        off = np.linalg.norm(slope) * np.linalg.norm(task_error(arm, task, target, before.q))
        assert f(result.q) <= f(before.q) + 2.0 * off + 1e-9
        # the gradient, less what the task's rows and the limits that it pushes against can balance, is none
        g = gradient(f, result.q)
        at_limit = (result.q <= arm.lower + 1e-7) & (g > 0) | (result.q >= arm.upper - 1e-7) & (g < 0)
        J = rows_of(arm, task, result.q, target)[:, ~at_limit]
        left = g[~at_limit] - np.linalg.pinv(J, rcond=1e-9) @ (J @ g[~at_limit])
        still += np.linalg.norm(left) < 1e-3 * (1.0 + np.linalg.norm(g))
        # SciPy, from our answer, gets no lower
        other = minimize(
            f, result.q, method="SLSQP", bounds=list(zip(arm.lower, arm.upper, strict=True)), options={"maxiter": 60},
            constraints={"type": "eq", "fun": lambda q, t=target: task_error(arm, task, t, q)},
        )  # fmt: skip
        if other.success and np.abs(task_error(arm, task, target, other.x)).max() < 1e-6:
            near = np.abs(other.x - result.q).max() < 0.1  # else it has gone to another branch
            assert not near or f(result.q) <= other.fun + 1e-3 * (1.0 + abs(other.fun))
    assert still >= 4


@each_case
def test_the_posture_is_the_start_unless_given(arm, task):
    rng, robot = np.random.default_rng(502), built(arm)
    posture = 0.5 * rng.uniform(arm.lower, arm.upper)
    for _ in range(5):
        q = 0.8 * rng.uniform(arm.lower, arm.upper)
        target, start = oracles.fk(arm, q), 0.8 * rng.uniform(arm.lower, arm.upper)
        by_start = LM(robot, task=task, prefer="posture").solve(target, start)
        same = LM(robot, task=task, prefer="posture", posture=start).solve(target, start)
        given_one = LM(robot, task=task, prefer="posture", posture=posture).solve(target, start)
        assert (by_start.q == same.q).all()
        plain = LM(robot, task=task).solve(target, start)
        assert np.linalg.norm(given_one.q - posture) <= np.linalg.norm(plain.q - posture) + 1e-6
        assert np.linalg.norm(by_start.q - start) <= np.linalg.norm(plain.q - start) + 1e-6
        # a posture that meets the target is where it ends, from beside it
        beside = LM(robot, task=task, prefer="posture", posture=q).solve(
            target, np.clip(q + 0.05, arm.lower, arm.upper)
        )
        assert np.abs(beside.q - q).max() < 1e-4


@given(st.integers(0, 10**6), st.integers(6, 9), st.booleans(), st.sampled_from(["mdh", "dh"]))
def test_the_gradient_of_the_manipulability_is_that_of_finite_differences(seed, n, prismatic, convention):
    rng = np.random.default_rng(seed)
    arm = oracles.random_arm(rng, n, prismatic=prismatic, convention=convention)
    robot, q = built(arm), rng.uniform(-2, 2, n)
    mask = rng.integers(0, 2, 6) if seed % 2 else np.ones(6, int)
    mask[seed % 6] = 1
    flags = np.concatenate([mask, np.zeros(7)]).astype(float)

    def plain(x):
        return np.sum(np.log(np.linalg.svd(oracles.jacobian(arm, x)[mask == 1], compute_uv=False)))

    assume(np.linalg.svd(oracles.jacobian(arm, q)[mask == 1], compute_uv=False)[-1] >= 1e-2)
    g = np.zeros(n)
    got = log_manipulability(np.ascontiguousarray(robot.jacobian(q)), flags, 1.0, g)
    assert got == pytest.approx(plain(q), abs=1e-6)
    expected = gradient(plain, q)
    assert np.abs(-g - expected).max() < 1e-5 * (1.0 + np.abs(expected).max())


def test_the_whole_cost_and_its_gradient_are_the_words():
    rng, arm = np.random.default_rng(503), LBR
    robot, flags = built(arm), as_task("pose").flags
    weights = np.array([0.3, 0.7, 0.2])
    prefer = dict(zip(("posture", "limits", "manipulability"), weights, strict=True))
    for _ in range(20):
        q, posture, g = 0.8 * rng.uniform(arm.lower, arm.upper), rng.uniform(arm.lower, arm.upper), np.empty(7)
        J = np.ascontiguousarray(robot.jacobian(q))
        got = cost((arm.lower, arm.upper), (weights, posture), q, J, flags, g)
        if np.linalg.svd(J, compute_uv=False)[-1] < 1e-2:
            continue

        def f(x, posture=posture):
            return value(arm, "pose", prefer, posture, x, np.eye(4))

        assert got == pytest.approx(f(q), abs=1e-6)
        assert np.abs(g - gradient(f, q)).max() < 1e-5 * (1.0 + np.abs(g).max())


def test_an_arm_without_free_motion_keeps_its_answer_up_to_the_tolerance():
    rng, robot = np.random.default_rng(504), optik.load("paper6r")
    for _ in range(10):
        q = 0.6 * rng.uniform(SIX.lower, SIX.upper)
        target, start = oracles.fk(SIX, q), np.clip(q + 0.05, SIX.lower, SIX.upper)
        plain, other = LM(robot).solve(target, start), LM(robot, prefer="limits").solve(target, start)
        assert np.abs(plain.q - other.q).max() < 1e-3


def test_open_and_locked_joints_have_no_middle():
    lower, upper = LBR.lower.copy(), LBR.upper.copy()
    lower[0], upper[0], lower[2], upper[2] = -np.inf, np.inf, 0.4, 0.4
    arm = oracles.Arm(LBR.convention, LBR.rows, lower=lower, upper=upper)
    start = np.array([0.1, 0.2, 0.4, 0.4, 0.5, 0.6, 0.7])
    result = LM(built(arm), prefer="limits", task="position").solve(
        oracles.fk(arm, start + np.array([9, 0.1, 0, 0.1, 0, 0.1, 0])), start
    )
    assert result
    assert result.q[2] == 0.4
    assert np.isfinite(result.q).all()


def test_the_posture_given_is_kept_though_its_array_changes():
    posture = np.full(7, 0.3)
    solver = LM(built(LBR), prefer="posture", posture=posture)
    target, start = oracles.fk(LBR, np.full(7, 0.5)), np.full(7, 0.45)
    before = solver.solve(target, start)
    posture[:] = -1.0
    assert (solver.solve(target, start).q == before.q).all()
    assert (np.array(solver.options["posture"]) == 0.3).all()


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"prefer": "home"}, "prefer"), ({"prefer": {"home": 1.0}}, "prefer"), ({"prefer": 3}, "prefer"),
        ({"prefer": {"limits": -1.0}}, "prefer['limits']"), ({"prefer": {"limits": np.nan}}, "prefer['limits']"),
        ({"posture": np.zeros(7)}, "posture"), ({"prefer": "limits", "posture": np.zeros(7)}, "posture"),
        ({"prefer": "posture", "posture": np.zeros(6)}, "posture"),
        ({"prefer": "posture", "posture": np.full(7, np.nan)}, "posture"),
    ],
    ids=str,
)  # fmt: skip
def test_what_cannot_be_meant_is_refused_by_name(options, argument):
    with pytest.raises(InvalidInput, match="^" + re.escape(argument) + ": "):
        LM(built(LBR), **options)


@pytest.mark.parametrize("name", ["lm", "sqp", "ipopt"])
def test_a_preference_that_changes_nothing_says_so(name):
    robot, q = optik.load("paper6r"), np.array([0.3, -0.4, 0.5, 0.2, 0.6, -0.1])
    silent = make_solver(robot, name).solve(robot.fk(q), q + 0.01)
    assert "prefer" not in silent.message
    for task, says in (("pose", True), ("axis_z", False)):
        result = make_solver(robot, name, prefer="posture", task=task).solve(robot.fk(q), q + 0.01)
        assert result
        assert bool(re.search(r"prefer .* 6 joints .* 6 components", result.message)) == says


@pytest.mark.parametrize("prefer", ["limits", {"posture": 1, "manipulability": 0.0}, {"limits": 0.0}, {}, None])
def test_a_preference_means_the_same_weights_to_every_method(prefer):
    robot = optik.load("panda")
    expected = {"limits": 1.0} if prefer == "limits" else {k: w for k, w in (prefer or {}).items() if w}
    for name in ("lm", "sqp", "ipopt"):
        assert make_solver(robot, name, prefer=prefer).preference.weights == expected


@pytest.mark.parametrize("prefer", ["home", {"home": 1.0}, 3, {"limits": -1.0}, {"limits": True}, ["limits"]])
@pytest.mark.parametrize("name", ["lm", "sqp", "ipopt"])
def test_what_is_no_preference_is_refused_by_every_method(name, prefer):
    with pytest.raises(InvalidInput, match=r"^prefer"):
        make_solver(optik.load("panda"), name, prefer=prefer)


@pytest.mark.parametrize(
    "task", [as_task("pose"), as_task("axis_z"), Task((1, 1, 1, 0, 0, 0), "base"), Task(box=0.01)], ids=str
)
@pytest.mark.parametrize("name", ["lm", "sqp", "ipopt"])
def test_every_method_minimises_the_same_function(name, task):
    """The value by which a method chooses, and the expression that CasADi differentiates, are those of the words."""
    rng, robot, prefer = np.random.default_rng(505), built(LBR), {"posture": 0.3, "limits": 0.7, "manipulability": 0.2}
    solver = make_solver(robot, name, prefer=prefer, task=task)
    q, posture = 0.8 * rng.uniform(LBR.lower, LBR.upper), rng.uniform(LBR.lower, LBR.upper)
    target = oracles.fk(LBR, rng.uniform(LBR.lower, LBR.upper))
    R = target[:3, :3].T if task.frame == "target" else np.eye(3)
    J = oracles.jacobian(LBR, q)
    J = np.vstack([R @ J[:3], R @ J[3:]])[np.array(task.mask)]
    x = (q - 0.5 * (LBR.lower + LBR.upper)) / (0.5 * (LBR.upper - LBR.lower))
    expected = 0.15 * np.sum((q - posture) ** 2) + 0.35 * np.sum(x**2)
    expected -= 0.1 * np.linalg.slogdet(J @ J.T + RANK_FLOOR * np.eye(len(J)))[1]
    assert solver.preference.value(task, target, posture, q) == pytest.approx(expected, abs=1e-9)
    if name != "lm":
        ca, m = pytest.importorskip("casadi"), _casadi.build_model(robot)
        at = ca.SX.sym("posture", 7)
        f = ca.Function("f", [m.q, m.target, at], [_casadi.preference_cost(m, task, robot, prefer, at)])
        assert float(f(q, target[:3].ravel(), posture)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("prefer", PREFERENCES, ids=str)
def test_methods_come_to_the_same_minimum_of_a_preference(prefer):
    """From starts near a solution most descends end in one valley; manipulability has more than one."""
    rng, robot, task = np.random.default_rng(shift_seed(506)), built(LBR), as_task("pose")
    solvers = [make_solver(robot, name, prefer=prefer) for name in ("lm", "sqp", "ipopt")]
    same = solved = 0
    for _ in range(32):
        q = 0.6 * rng.uniform(LBR.lower, LBR.upper)
        target, start = oracles.fk(LBR, q), np.clip(q + rng.normal(0.0, 0.02, 7), LBR.lower, LBR.upper)
        results = [solver.solve(target, start) for solver in solvers]
        solved += all(results)
        if not all(results):
            continue
        values = [solvers[0].preference.value(task, target, start, result.q) for result in results]
        same += max(values) - min(values) < 1e-4
    assert solved >= 29
    assert same >= 16
