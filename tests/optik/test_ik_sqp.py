"""The CasADi methods: the symbolic model, SQP, tasks of every kind, and what an optimiser alone can prefer."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import optik
from optik import DHRow, IKStatus, JointLimits, Robot
from optik.errors import InvalidInput
from optik.ik import IPOPT, SQP, _casadi
from optik.ik._null_space import PREFERENCES
from optik.task import Task, as_task
from tests import oracles
from tests.optik.test_task import TASKS, plain_error
from tests.seeds import shift_seed

PAPER = optik.load("paper6r")
START = np.radians([20, -35, 40, 25, 50, -30])
each_kind = pytest.mark.parametrize("kind", [IPOPT, SQP], ids=lambda k: k.name)


def seven(reach=1.0):
    alpha = np.array([-1, 1, 1, -1, -1, 1, 0]) * np.pi / 2
    limit = reach * np.radians([170, 120, 170, 120, 170, 120, 175])
    rows = [DHRow(alpha=a, d=d) for a, d in zip(alpha, [0.34, 0, 0.4, 0, 0.4, 0, 0.126], strict=True)]
    return Robot.from_dh(rows, JointLimits(-limit, limit), name="seven")


def five():
    rows = [DHRow(d=0.3, alpha=np.pi / 2), DHRow(a=0.3), DHRow(a=0.25), DHRow(alpha=np.pi / 2), DHRow(d=0.1)]
    return Robot.from_dh(rows, JointLimits([-2.9] * 5, [2.9] * 5), name="five")


def scara():
    """Four joints: one slides, one turns without end."""
    rows = [DHRow(a=0.3, d=0.4), DHRow(a=0.25, alpha=np.pi), DHRow(prismatic=True), DHRow(d=0.1)]
    limits = JointLimits([-2.5, -2.5, 0.0, -np.inf], [2.5, 2.5, 0.2, np.inf])
    return Robot.from_dh(rows, limits, base=oracles.pose((0.4, -0.2, 0.9), (0.1, 0.2, 0.3)), name="scara")


def locked():
    lower, upper = PAPER.limits.lower.copy(), PAPER.limits.upper.copy()
    lower[2] = upper[2] = 0.2
    return Robot("locked", PAPER.fixed, PAPER.prismatic, PAPER.tool, JointLimits(lower, upper))


SEVEN = seven()
ARMS = [PAPER, SEVEN, five(), scara(), locked()]
each_arm = pytest.mark.parametrize("robot", ARMS, ids=lambda r: r.name)


def problems(robot, count, seed, spread=0.1):
    rng, lim = np.random.default_rng(seed), robot.limits
    low, high = np.maximum(lim.lower, -3.0), np.minimum(lim.upper, 3.0)
    for q in rng.uniform(low, high, (count, robot.n)):
        yield robot.fk(q), lim.clip(q + rng.normal(0.0, spread, robot.n))


def honest(result, robot, task, target):
    """Success is what the plain error of the task and the limits say it is."""
    e = plain_error(robot.fk(result.q), target, task)
    p, r = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
    assert abs(result.position_error - p) < 1e-11
    assert abs(result.rotation_error - r) < 1e-8
    assert ((result.q >= robot.limits.lower) & (result.q <= robot.limits.upper)).all()
    if result:
        assert max(p, r) <= 1e-6 + 1e-10
    assert bool(result) is (result.status is IKStatus.SOLVED)


# ---------------------------------------------------------------- the symbolic model
def numbers(robot, task):
    """Numeric functions (q, target) of the model: p, R, J, components, E, its gradient, the Hessian, AD's gradient."""
    m = _casadi.build_model(robot)
    f, slope, H = _casadi.cost_derivatives(m, task)
    outputs = [m.p, m.R, m.J, _casadi.error_components(m, task), f, slope, H, ca.gradient(f, m.q)]
    function = ca.Function("model", [m.q, m.target], outputs)

    def at(q, target):
        parameters = np.empty(12)
        _casadi.pose_parameters(target, parameters)
        return [np.asarray(v, dtype=float) for v in function(q, parameters)]

    return at


@each_arm
def test_the_symbolic_arm_is_the_numeric_one(robot):
    at = numbers(robot, Task())
    for q in np.random.default_rng(101).uniform(-3, 3, (30, robot.n)):
        T = robot.fk(q)
        p, R, J, e, f = at(q, T)[:5]
        assert np.abs(p.ravel() - T[:3, 3]).max() < 1e-13
        assert np.abs(R - T[:3, :3]).max() < 1e-13
        assert np.abs(J - robot.jacobian(q)).max() < 1e-13
        assert np.abs(e).max() < 1e-13
        assert f < 1e-26


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_symbolic_error_is_the_tasks_near_it_and_vanishes_nowhere_else(task):
    at, rows = numbers(PAPER, task), [i for i in range(6) if task.mask[i]]
    rng, plain = np.random.default_rng(102), Task(task.mask, task.frame)
    for q in rng.uniform(PAPER.limits.lower, PAPER.limits.upper, (40, 6)):
        for spread in (1e-3, 0.5):
            target = PAPER.fk(q + rng.normal(0.0, spread, 6))
            e, f, slope, H, autodiff = (v.squeeze() for v in at(q, target)[3:])
            wanted, beyond = plain_error(PAPER.fk(q), target, plain)[rows], plain_error(PAPER.fk(q), target, task)
            lone = sum(task.mask[3:]) == 1 and not any(task.box[3:])  # a chord instead of the angle, whatever the rest
            if not lone:
                assert np.abs(e - wanted).max() < max(1e-8, 0.5 * np.linalg.norm(wanted[-3:]) ** 3)
            assert (np.sign(np.round(e, 8)) == np.sign(np.round(wanted, 8))).all()
            assert np.abs(slope - autodiff).max() < 1e-12
            assert (np.linalg.eigvalsh(H) > 0.0).all()
            if np.linalg.norm(beyond) > 1e-3:
                assert f > 1e-7
            if any(task.box[3:]):
                assert abs(f - 0.5 * beyond @ beyond) < 1e-8


def test_half_a_turn_is_the_farthest_and_finite():
    at, T = numbers(PAPER, Task()), PAPER.fk(START)
    for axis in np.eye(3):
        values = at(START, T @ oracles.pose(np.pi * axis, (0, 0, 0)))
        assert all(np.isfinite(v).all() for v in values)
        assert abs(values[4].item() - 2.0) < 1e-9  # ½ (2 sin ½π)²


# ---------------------------------------------------------------- every arm, every task
@each_kind
@each_arm
@pytest.mark.parametrize("task", [Task(), *map(as_task, ("position", "axis_z")), *TASKS[8:12]], ids=str)
def test_targets_near_the_start_are_solved_whatever_the_arm_and_the_task(kind, robot, task):
    solver, solved = kind(robot, task=task), 0
    for target, start in problems(robot, 8, shift_seed(103)):
        result = solver.solve(target, start, trace=True)
        honest(result, robot, task, target)
        assert result.trace.shape == (result.iterations + 1, 6)
        solved += bool(result)
    assert solved >= 7


@each_kind
def test_an_arm_that_cannot_move_is_answered(kind):
    robot = Robot.from_dh([DHRow(a=0.3), DHRow(a=0.3)], JointLimits([0.1, 0.2], [0.1, 0.2]))
    q = np.array([0.1, 0.2])
    assert kind(robot).solve(robot.fk(q), q)
    result = kind(robot).solve(oracles.pose((0, 0, 0.3), (0.001, 0, 0)) @ robot.fk(q), q)
    assert not result
    assert (result.q == q).all()


def test_sqp_says_how_it_ended():
    turned = PAPER.fk(START) @ oracles.pose((0.0, 2.5, 0.0), (0.0, 0.0, 0.0))
    result = SQP(PAPER).solve(turned, START)
    assert result.status is IKStatus.STALLED
    assert result.message == "SQP: Solve_Succeeded"  # a minimum, but the pose is not met there
    few = SQP(PAPER, max_iterations=2).solve(PAPER.fk(START), np.zeros(6))
    assert few.status is IKStatus.MAX_ITERATIONS
    assert few.iterations == 2
    late = SQP(PAPER, time_limit=1e-9).solve(PAPER.fk(START), np.zeros(6))
    assert late.status is IKStatus.TIME_LIMIT


# ---------------------------------------------------------------- what is preferred
def penalty(name, q, robot, task, posture):
    """The definitions, in NumPy."""
    lim = robot.limits
    if name == "posture":
        return 0.5 * np.sum((q - posture) ** 2)
    if name == "limits":
        return 0.5 * np.sum(((q - (lim.lower + lim.upper) / 2) / ((lim.upper - lim.lower) / 2)) ** 2)
    J = robot.jacobian(q)[list(task.mask)]
    return -0.5 * np.linalg.slogdet(J @ J.T + 1e-12 * np.eye(len(J)))[1]


def free_motion(robot, q, task):
    """Directions (n, k) that leave the task's components where they are."""
    return np.linalg.svd(robot.jacobian(q)[list(task.mask)])[2][task.size :].T


@each_kind
@pytest.mark.parametrize("task", [Task(frame="base"), Task((1, 1, 1, 0, 0, 0), "base")], ids=str)
@pytest.mark.parametrize("name", PREFERENCES)
def test_what_is_preferred_has_no_slope_along_the_free_motion(kind, name, task):
    posture = np.linspace(-0.5, 0.5, 7)
    given = {"posture": posture} if name == "posture" else {}
    robot = seven(3.0)  # minima inside the limits
    solver, plain = kind(robot, task=task, prefer=name, **given), kind(robot, task=task)
    flat, inside = 0, 0
    for target, start in problems(robot, 15, shift_seed(105), 0.2):
        result, before = solver.solve(target, start, trace=True), plain.solve(target, start)
        honest(result, robot, task, target)
        assert bool(result) >= bool(before)
        assert result.trace.shape == (result.iterations + 1, 6)
        gain = penalty(name, before.q, robot, task, posture) - penalty(name, result.q, robot, task, posture)
        assert gain > -1e-6 or not before
        if not result or (np.abs(result.q) > robot.limits.upper - 1e-3).any():
            continue
        inside += 1
        steps = 1e-5 * np.eye(7)
        slope = [penalty(name, result.q + s, robot, task, posture) - penalty(name, result.q - s, robot, task, posture)
                 for s in steps]  # fmt: skip
        flat += np.abs(np.array(slope) / 2e-5 @ free_motion(robot, result.q, task)).max() < 1e-3
    assert inside >= 6
    assert flat >= 0.6 * inside


@each_kind
def test_the_start_is_the_posture_unless_another_is_given(kind):
    task = as_task("position")
    for target, start in problems(SEVEN, 4, 106, 0.3):
        near = kind(SEVEN, task=task, prefer="posture", max_restarts=3).solve(target, start)
        same = kind(SEVEN, task=task, prefer="posture", posture=start, max_restarts=3).solve(target, start)
        assert (near.q == same.q).all()
        other = kind(SEVEN, task=task, prefer="posture", posture=np.zeros(7)).solve(target, start)
        assert np.linalg.norm(near.q - start) < np.linalg.norm(other.q - start)
        assert np.linalg.norm(other.q) < np.linalg.norm(near.q)


@each_kind
def test_weights_count(kind):
    target, start = next(iter(problems(SEVEN, 1, 107, 0.3)))
    task, ends = as_task("position"), []
    for weight in (1e-3, 1e3):
        q = kind(SEVEN, task=task, prefer={"posture": 1.0, "limits": weight}).solve(target, start).q
        ends.append(penalty("limits", q, SEVEN, task, start))
    assert ends[1] < ends[0]


@each_kind
def test_a_preference_moves_inside_the_box_and_not_out_of_it(kind):
    task = Task(box=0.05)
    solver, plain = kind(SEVEN, task=task, prefer="manipulability"), kind(SEVEN, task=task)
    gained = 0
    for target, start in problems(SEVEN, 8, shift_seed(108)):
        result, before = solver.solve(target, start), plain.solve(target, start)
        honest(result, SEVEN, task, target)
        assert result
        gained += penalty("manipulability", result.q, SEVEN, task, None) < penalty(
            "manipulability", before.q, SEVEN, task, None
        )
    assert gained >= 6


@each_kind
@pytest.mark.parametrize("name", PREFERENCES)
def test_a_preference_never_costs_a_pose_where_nothing_is_free(kind, name):
    solver, plain = kind(PAPER, prefer=name), kind(PAPER)
    for target, start in problems(PAPER, 10, 109):
        assert (solver.solve(target, start).q == plain.solve(target, start).q).all()


# ---------------------------------------------------------------- a distance from the limits
@each_kind
def test_every_joint_keeps_its_distance_from_the_limits(kind):
    solver, solved = kind(PAPER, limit_distance=0.2, max_restarts=5), 0
    for target, start in problems(PAPER, 20, shift_seed(110)):
        result = solver.solve(target, start)
        assert (result.q >= PAPER.limits.lower + 0.2).all() or not result
        assert (result.q <= PAPER.limits.upper - 0.2).all() or not result
        solved += bool(result)
    assert solved >= 3
    edge = PAPER.limits.upper
    assert not kind(PAPER, limit_distance=0.2).solve(PAPER.fk(edge), edge)
    inner = PAPER.limits.upper - 0.3
    assert kind(PAPER, limit_distance=0.2, max_restarts=20).solve(PAPER.fk(inner), edge)


@each_kind
def test_a_locked_joint_keeps_no_distance_and_an_endless_one_needs_none(kind):
    robot = locked()
    q = robot.limits.clip(np.full(6, 0.2))
    assert kind(robot, limit_distance=0.1).solve(robot.fk(q), q)
    endless = scara()
    q = np.array([0.1, 0.2, 0.1, 40.0])
    assert kind(endless, limit_distance=0.05).solve(endless.fk(q), q)


# ---------------------------------------------------------------- options
@each_kind
@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"prefer": "elbow"}, "prefer"), ({"prefer": {"limits": -1.0}}, r"prefer\['limits'\]"),
        ({"prefer": ["limits"]}, "prefer"), ({"posture": np.zeros(6)}, "posture"),
        ({"prefer": "posture", "posture": np.zeros(5)}, "posture"), ({"limit_distance": -0.1}, "limit_distance"),
        ({"limit_distance": np.inf}, "limit_distance"), ({"limit_distance": 2.0}, "limit_distance"),
    ],
)  # fmt: skip
def test_an_option_that_cannot_be_meant_is_refused_by_name(kind, options, argument):
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        kind(PAPER, **options)


@each_kind
def test_a_solver_with_everything_pickles_and_says_nothing_aloud(kind, capfd):
    solver = kind(
        SEVEN, task=Task(box=0.01), prefer={"posture": 1.0, "limits": 0.1}, posture=np.zeros(7), limit_distance=0.1,
        time_limit=30.0, max_restarts=2,
    )  # fmt: skip
    back = pickle.loads(pickle.dumps(solver))
    assert back.options == solver.options
    for target, start in problems(SEVEN, 4, 111):
        a, b = solver.solve(target, start), back.solve(target, start)
        assert (a.q == b.q).all()
        assert a.message == b.message
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""


@each_kind
def test_nothing_of_casadi_escapes(kind):
    solver = kind(PAPER)
    programme = solver._programme(False, False)

    def fails():
        raise RuntimeError("a bug\nof CasADi")

    programme._call = fails
    result = solver.solve(PAPER.fk(START), np.zeros(6))
    assert result.status is IKStatus.STALLED
    assert result.message.endswith("of CasADi")


@each_kind
def test_threads_that_share_a_solver_get_their_own_answers(kind):
    solver, given = kind(PAPER), list(problems(PAPER, 40, 112))
    alone = [solver.solve(*problem).q for problem in given]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda problem: solver.solve(*problem).q, given))
    assert all((a == b).all() for a, b in zip(alone, together, strict=True))


# ---------------------------------------------------------------- the usual call
@each_kind
@pytest.mark.parametrize("options", [{}, {"max_restarts": 3}, {"task": "position"}, {"max_iterations": 3}], ids=str)
def test_the_usual_call_answers_as_the_way_round_does(kind, options):
    """A single call goes straight through the buffers; of a batch, and of lists, every problem takes the way round."""
    solver = kind(PAPER, **options)
    near, far = list(problems(PAPER, 10, shift_seed(131))), list(problems(PAPER, 6, shift_seed(132), spread=2.0))
    beyond = [(oracles.trans(x=4.0), np.zeros(6)), (oracles.trans(x=0.1), np.full(6, 0.2))]
    failed = 0
    for target, start in near + far + beyond:
        one, listed = solver.solve(target, start), solver.solve(target.tolist(), start.tolist())
        batch = solver.solve_batch(target[None], start).result(0)
        assert (one.q == listed.q).all()
        assert (one.q == batch.q).all()
        assert one[1:] == listed[1:]
        assert one[1:6] == batch[1:6]
        honest(one, PAPER, as_task(options.get("task", "pose")), target)
        failed += not one
    assert 0 < failed < 18


@each_kind
def test_the_usual_call_refuses_what_cannot_be_meant_and_forgets_it(kind):
    solver, target = kind(PAPER), PAPER.fk(START)
    spoilt, outside = target.copy(), START.copy()
    spoilt[0, 0], outside[2] = np.nan, 9.0
    good = solver.solve(target, START)
    assert good
    for bad in [(spoilt, START), (target, outside), (target, START[:5]), (target[:3], START), (target, START * np.nan)]:
        with pytest.raises(InvalidInput):
            solver.solve(*bad)
        assert (solver.solve(target, START).q == good.q).all()


def test_after_a_failure_the_next_call_starts_from_its_own_start():
    solver = SQP(PAPER)
    assert not solver.solve(oracles.trans(x=4.0), np.zeros(6))
    traced = solver.solve(PAPER.fk(START), START + 0.01, trace=True)
    assert (traced.q == solver.solve(PAPER.fk(START), START + 0.01).q).all()
