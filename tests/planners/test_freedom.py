"""Path and time together: derivatives against differences, the Newton step against dense sums, plans over freedoms."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
import planners
from optik import Robot, dynamics, se3
from optik.arm.inertia import Inertia
from optik.arm.library import load
from optik.errors import InvalidInput, UnknownName
from optik.ik import make_solver
from optik.types import Array
from planners import Arc, JointLine, Line, MotionLimits, PointToPoint, Polyline, follow, free, make_law, plan
from planners.choice.choose import Choice, pick_plan
from planners.choice.first_paths import OFFSETS, _list_turns
from planners.choice.solve import _Box, _Iteration, solve_coefficients
from planners.choice.torques import torque_changes
from planners.paths.control_curve import ControlBounds
from planners.paths.free_path import FreePath
from planners.timing.interior_point import iteration
from planners.timing.interior_point.newton import back, forth
from planners.timing.optimal import Optimal
from tests import oracles
from tests.planners.cases import START, paper6r

LIMITS = MotionLimits(2.0, 10.0, 100.0)
"""Limits of all joints: velocity, acceleration and jerk."""
PANDA = np.array([0.2, -0.4, 0.1, -2.0, 0.2, 1.8, 0.5])
"""A configuration of panda away from its limits."""


@cache
def torch() -> Robot:
    """The paper's arm with a torch that leans by 45° from the axis of its last joint."""
    c = np.sqrt(0.5)
    return paper6r().with_tool(np.array([[c, 0, c, 0.05], [0, 1, 0, 0], [-c, 0, c, 0.1], [0, 0, 0, 1.0]]))


def line(robot: Robot, q: Array, way: Any = (-0.1, 0.05, 0.15)) -> Line:
    """A line from the tool of a configuration."""
    return Line(robot.fk(q), oracles.moved(robot.fk(q), np.array(way), np.zeros(3)))


CASES = {
    "turn": (lambda: torch(), START, {"turn": True}, LIMITS),
    "tilt and turn": (lambda: torch(), START, {"tilt": 0.2, "turn": (-1.0, 1.0)}, LIMITS),
    "elbow": (lambda: optik.load("panda"), PANDA, {"elbow": True}, LIMITS),
}
"""Arm, start, freedoms and limits of plans."""


# ---------------------------------------------------------------- derivatives


def sliding() -> Robot:
    """An arm with a sliding joint and drawn masses."""
    rng, robot = np.random.default_rng(7), optik.load("irb910sc")
    spread = rng.normal(size=(robot.n, 3, 3))
    inertia = np.array([0.01 * (a @ a.T) + 0.1 * np.eye(3) for a in spread])
    return robot.with_inertia(Inertia(rng.uniform(0.5, 3.0, robot.n), 0.1 * rng.normal(size=(robot.n, 3)), inertia))


OBLIQUE = [0.6, -0.64, -0.48]
"""A direction of gravity with all three components."""


@pytest.mark.parametrize(
    "make",
    [
        lambda: optik.load("panda").with_payload(2.0),
        lambda: optik.load("ur5e"),
        sliding,
        lambda: optik.load("panda").with_payload(2.0).with_gravity(OBLIQUE),
        lambda: sliding().with_gravity(OBLIQUE),
    ],
)
def test_torques_along_a_path_change_as_differences_of_them_do(make: Any) -> None:
    robot, rng, h = make(), np.random.default_rng(0), 1e-6
    load, path = robot.loads[0], rng.normal(size=(4, 5, robot.n))
    out = np.empty((5, 6, robot.n, robot.n, 4))
    torque_changes(robot.chain, load.bodies, path, out)

    def torques(x: Array) -> Array:
        found = np.empty((5, 6, robot.n))
        dynamics.path_torques(robot.chain, load.bodies, np.ascontiguousarray(x), found)
        return found

    for j in range(robot.n):
        for order in range(4):
            step = np.zeros_like(path)
            step[order, :, j] = h
            change = (torques(path + step) - torques(path - step)) / (2.0 * h)
            np.testing.assert_allclose(out[..., j, order], change, atol=2e-7 * max(1.0, float(np.abs(change).max())))


def choice(
    robot: Robot, path: FreePath, q: Array, limits: MotionLimits, *, held: bool = False, law: Optimal | None = None
) -> Choice:
    """The choice of a path's coefficients from the optimum along it."""
    joints = follow(make_solver(robot, "lm"), path, q).joint_path
    assert joints is not None
    return Choice(path, joints, (law or Optimal()).run_with_optimum(joints, limits)[1], held=held)


@cache
def all_limits(law: Optimal | None = None) -> Choice:
    """All freedoms under all limits."""
    robot = optik.load("panda").with_inertia(viscous=2.0).with_payload(2.0)
    limits = replace(MotionLimits.of(robot), tool_speed=0.5, rotation_speed=1.0, extra={"body_speed": 0.6})
    return choice(robot, free(line(robot, PANDA), tilt=0.3, turn=True, elbow=True), PANDA, limits, law=law)


def limited_values(given: Choice, p: Array, near: Array, z: Array) -> Array:
    place = given.programme.place(p, near)
    assert place is not None
    problem = given.programme.problem(place)
    g = np.zeros((given.programme.K, 3))
    c = np.zeros((given.programme.K + 1, problem.node.shape[1] + 2 * problem.edge.shape[2]))
    iteration.values(problem, z, g, c)
    return c


def test_limited_values_change_with_the_coefficients_as_their_differences() -> None:
    given, rng, h = all_limits(), np.random.default_rng(1), 1e-6
    programme, z = given.programme, given.optimum.programme.start
    p = given.p + 0.02 * rng.normal(size=given.p.shape)
    place = programme.place(p, given.near)
    assert place is not None
    border = programme.make_border()
    programme.fill(place, z, np.zeros_like(limited_values(given, p, place.path, z)), border)
    seen = np.zeros(programme.rows, bool)
    by_differences = slice(programme.speeds - given.robot.shapes.m, programme.speeds)
    for i in rng.choice(p.size, 12, replace=False):
        step = np.zeros(p.size)
        step[i] = h
        step = step.reshape(p.shape)
        change = (limited_values(given, p + step, place.path, z) - limited_values(given, p - step, place.path, z)) / (
            2 * h
        )
        for k in range(programme.K + 1):
            at, rows = i - programme.begin[k], slice(None if k < programme.K else programme.rows)
            column = border.columns[k, rows, at] if 0 <= at < programme.width else 0.0
            off = np.abs(column - change[k, rows])
            assert np.delete(off, by_differences).max() <= 1e-6 and off[by_differences].max() <= 3e-6
        seen |= (np.abs(change[:, : programme.rows]) > 1e-3).any(axis=0)
    counts = programme.scales.counts
    tool = programme.speeds + int(counts[2:4].sum())
    rests = np.flatnonzero(given.robot.shapes.capsules[0] == 0) + int(counts[:2].sum())
    assert counts[7] == given.robot.shapes.m
    # every limit depends on the path somewhere, but for the speeds of the tool's point and of what rests
    assert set(np.flatnonzero(~seen)) == {tool, *rests}


def test_cross_derivatives_are_those_of_the_columns() -> None:
    given, rng, h = all_limits(), np.random.default_rng(2), 1e-5
    programme, z = given.programme, given.optimum.programme.start
    place = programme.place(given.p, given.near)
    assert place is not None
    y = rng.normal(size=limited_values(given, given.p, place.path, z).shape)
    border = programme.make_border()
    programme.fill(place, z, y, border)
    m = programme.rows
    e = (y.shape[1] - m) // 2

    def columns(k: int, unknown: int, sign: float) -> Array:
        moved, out = z.copy(), programme.make_border()
        moved[k, unknown] += sign * h
        programme.fill(place, moved, y, out)
        return out.columns

    for k in (1, 40, programme.K - 1):
        for unknown, row in ((0, 0), (1, 1), (3, 2)):
            change = (columns(k, unknown, 1.0) - columns(k, unknown, -1.0)) / (2.0 * h)
            here = y[k, : m + e] @ change[k, : m + e] + (y[k, m + e :] @ change[k, m + e :] if unknown == 3 else 0.0)
            np.testing.assert_allclose(border.cross[k, row], here, atol=1e-6)
            if unknown < 3:
                before = y[k - 1, m + e :] @ change[k - 1, m + e :]
                np.testing.assert_allclose(border.cross[k - 1, 3 + row], before, atol=1e-6)


def test_speeds_are_limited_a_third_of_an_interval_after_each_grid_point() -> None:
    """A speed that rises by half of the jerk's range and falls by the other half peaks there."""
    given = all_limits()
    programme, v = given.programme, given.optimum.programme.start[:, 0] * given.programme.time[0]
    duration = 2.0 * np.diff(given.optimum.programme.s) / (v[:-1] + v[1:])
    assert np.median(programme.scales.peak[:-1] / duration) == pytest.approx(1.0 / 3.0, rel=1e-6)
    assert programme.scales.peak[-1] == 0.0


IN_PLAIN_PYTHON = """
import pickle, sys
programme, p, near, z, y = pickle.load(sys.stdin.buffer)
place, border = programme.place(p, near), programme.make_border()
programme.fill(place, z, y, border)
problem = programme.problem(place)
sys.stdout.buffer.write(pickle.dumps((place.path, border.columns, border.cross, problem.node, problem.edge)))
"""
"""Computes all derivatives; NumPy raises where an index is beyond the end of an array, as a compiled kernel does not."""


def test_kernels_in_plain_python_stay_inside_their_arrays_and_give_the_same_values() -> None:
    given, rng = all_limits(Optimal(intervals=8)), np.random.default_rng(3)
    programme, z = given.programme, given.optimum.programme.start
    p = given.p + 0.02 * rng.normal(size=given.p.shape)
    place, border = programme.place(p, given.near), programme.make_border()
    assert place is not None
    problem = programme.problem(place)
    y = rng.normal(size=(programme.K + 1, programme.rows + 2 * problem.edge.shape[2]))
    programme.fill(place, z, y, border)
    child = subprocess.run(
        [sys.executable, "-c", IN_PLAIN_PYTHON], input=pickle.dumps((programme, p, given.near, z, y)),
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, stdout=subprocess.PIPE, check=True,
    )  # fmt: skip
    compiled = place.path, border.columns, border.cross, problem.node, problem.edge
    for mine, plain in zip(compiled, pickle.loads(child.stdout), strict=True):
        np.testing.assert_allclose(plain, mine, rtol=1e-7, atol=1e-9 * np.abs(mine).max())


# ---------------------------------------------------------------- the Newton step


def test_the_bordered_sweeps_solve_the_system_of_the_newton_step() -> None:
    """The model's gradient in every coefficient is zero after the step, written as a sum over all limited values."""
    robot = torch()
    given = choice(robot, free(line(robot, START), tilt=0.2, turn=True), START, LIMITS)
    programme, mu = given.programme, 0.05
    place = programme.place(given.p, given.near)
    assert place is not None
    problem, K = programme.problem(place), programme.K
    rows = problem.node.shape[1] + 2 * problem.edge.shape[2]
    at, border = iteration.make_iterate(K, rows), programme.make_border()
    at.z[:] = given.optimum.programme.start
    iteration.move_inside(problem, at, mu)
    iteration.centre(problem, at, mu)
    y = at.dual[:, 0] - at.dual[:, 1]
    programme.fill(place, at.z, y, border)
    box = _Box(given.bounds, programme.window.free, given.p, mu)

    delta = 1e4

    def step(damping: float) -> tuple[Array, Array]:
        box.model(given.p, mu, border.own, border.pull, damping)
        d, lam = np.zeros((K + 1, 4)), np.zeros((K + 1, 3))
        models, law, cost = np.empty((K, 4, 5)), np.empty((K, 3)), np.empty((K + 1, 5))
        assert back(problem, at, mu, delta, models, law, cost, border)
        forth(problem, at, models, law, cost, d, lam, border)
        return d, border.d.copy()

    d, dp = step(1e-3)
    slope = np.zeros((K + 1, rows))
    iteration.slopes(problem, at.z, d, slope, border)
    above, below = 1.0 / at.slack[:, 0], 1.0 / at.slack[:, 1]
    up, down, c = at.dual[:, 0], at.dual[:, 1], at.c
    weights = mu * problem.tau[np.minimum(np.arange(K + 1), K - 1)][:, None]
    pull = (weights + up * (c - 1.0)) * above + up - (weights - down * (c + 1.0)) * below - down
    force = pull + (up * above + down * below) * slope
    force[K, programme.rows :] = 0.0
    total = programme.gather(force, border)
    for k in range(K):
        begin, window = programme.begin[k], border.cross.shape[2]
        change = np.array([d[k, 0], d[k, 1], d[k, 3], d[k + 1, 0], d[k + 1, 1]]) @ border.cross[k]
        total[begin : begin + window] += change[: total.size - begin]
    D = programme.D
    for i in range(total.size):
        group = i - i % D
        total[i] += border.pull[i] + delta * dp[i]
        total[i] += sum(
            (border.own[i, j] if j <= i % D else border.own[group + j, i % D]) * dp[group + j] for j in range(D)
        )
    scale = np.abs(programme.gather(np.abs(force), border)).max()
    assert np.abs(dp).max() > 1e-3
    assert np.abs(total).max() < 1e-9 * scale
    assert np.abs(step(1e12)[1]).max() < 1e-7  # a stiff coefficient stays


@pytest.mark.parametrize("velocity", [2.0, 0.3])
@pytest.mark.parametrize("name", ["turn", "tilt and turn", "elbow"])
def test_the_gradient_is_that_of_the_duration(name: str, velocity: float) -> None:
    """A slow joint is at its speed limit for most of the motion, a fast one never."""
    make, q, freedoms, limits = CASES[name]
    limits = replace(limits, velocity=velocity)
    robot = make()
    given = choice(robot, free(line(robot, q), **freedoms), q, limits)

    def barrier(p: Array) -> tuple[float, Array]:
        """Least barrier objective with these coefficients, which is smooth in them, and its gradient by the multipliers."""
        programme, place = given.programme, given.programme.place(p, given.near)
        assert place is not None
        one = _Iteration(programme, p, given.bounds, place, 1.0, 1e12)
        for _ in range(60):
            assert one._newton()
            assert one._search() is not None
            one.count = 0
        at = one.at
        value = iteration.merit(one.problem, one.mu, at.z, at.g, at.c, at.slack, one.border)
        assert value[1] < 1e-8
        y = at.dual[:, 0] - at.dual[:, 1]
        programme.fill(one.place, at.z, y, one.border)
        return value[0], programme.gather(y, one.border)

    value = barrier(given.p)[1]
    for way in (value.copy(), *np.random.default_rng(4).normal(size=(2, value.size))):
        way /= np.linalg.norm(way)
        step = 1e-5 * way.reshape(given.p.shape)
        slope = (barrier(given.p + step)[0] - barrier(given.p - step)[0]) / 2e-5
        assert float(value @ way) == pytest.approx(slope, abs=1e-4 * np.linalg.norm(value))
    found = solve_coefficients(given.programme, given.p, given.bounds, given.near, least=1e-9, damping=1e12)
    assert found is not None
    exact = found.gradient
    rough = given.gradient()  # of the law's own multipliers, on its grid and with its greatest speeds
    assert np.abs(rough - exact).max() <= 0.02 * np.abs(exact).max()


# ---------------------------------------------------------------- plans


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("held", [True, False])
def test_a_freedom_shortens_the_motion_inside_its_range_and_the_motion_is_proved(name: str, held: bool) -> None:
    make, q, freedoms, limits = CASES[name]
    robot = make()
    given = line(robot, q)
    fixed = plan(robot, given, q, limits=limits)
    path = free(given, hold_start=held, **freedoms)
    found = plan(robot, path, q, limits=limits)
    assert found
    result = found.freedom
    assert result is not None
    assert found.trajectory.duration < (0.97 if not held else 0.99) * fixed.trajectory.duration
    assert result.gain == pytest.approx(1.0 - found.trajectory.duration / fixed.trajectory.duration, abs=2e-3)
    assert result.outcome == "chosen"
    if held:
        np.testing.assert_allclose(found.trajectory(0.0), q, atol=1e-4)
    t = np.linspace(0.0, found.trajectory.duration, 400)
    poses = robot.fk(found.trajectory(t))
    s = given.nearest(poses)
    assert np.linalg.norm(poses[:, :3, 3] - given.pose(s)[:, :3, 3], axis=1).max() <= 2e-5
    axes = np.einsum("ki,ki->k", poses[:, :3, 2], given.pose(s)[:, :3, 2])
    assert np.arccos(np.clip(axes, -1.0, 1.0)).max() <= freedoms.get("tilt", 0.0) + 2e-4
    for part in result.ranges:
        low, high = part.allowed
        assert low - 1e-9 <= part.reached[0] <= part.reached[1] <= high + 1e-9
    for order, most in ((1, 2.0), (2, 10.0), (3, 100.0)):
        assert np.abs(found.trajectory(t, order)).max() <= most * (1.0 + 1e-9)


def test_a_seam_is_shortened() -> None:
    robot = torch()
    start = robot.fk(START)
    corners = [
        start,
        *(oracles.moved(start, np.array(way), np.zeros(3)) for way in ((-0.1, 0, 0.05), (-0.1, 0.1, 0.1))),
    ]
    given = Polyline(corners, blend=5e-3)
    fixed = plan(robot, given, START, limits=LIMITS)
    found = plan(robot, free(given, turn=np.pi), START, limits=LIMITS)
    assert found.trajectory.duration < 0.995 * fixed.trajectory.duration


def test_a_line_through_many_waypoints_is_shortened_as_the_line_is() -> None:
    """The timing has fewer grid points than the waypoints would have coefficients."""
    robot = torch()
    poses = np.tile(robot.fk(START), (200, 1, 1))
    poses[:, :3, 3] += np.linspace(0.0, 1.0, 200)[:, None] * [-0.2, 0.3, 0.0]
    gains = []
    for given in (Polyline(poses, blend=1e-3), Line(poses[0], poses[-1])):
        found = plan(robot, free(given, turn=True, hold_start=False), START, limits=LIMITS)
        assert found.freedom is not None
        gains.append(found.freedom.gain)
    assert gains[0] > 0.99 * gains[1] > 0.05


def test_a_freedom_that_cannot_shorten_the_motion_is_recognised_by_the_gradient() -> None:
    robot = paper6r()  # its tool's axis is that of the last joint, which no limit holds back
    given = line(robot, START)
    found = plan(robot, free(given, turn=True), START, limits=LIMITS)
    assert found.freedom is not None
    assert "cannot shorten" in found.freedom.outcome
    assert found.freedom.starts == 0
    assert found.trajectory.duration == pytest.approx(
        plan(robot, given, START, limits=LIMITS).trajectory.duration, rel=1e-9
    )


@pytest.mark.parametrize("timing", ["smooth", "constant_speed", "toppra"])
def test_other_laws_time_the_chosen_and_the_initial_coefficients_and_keep_the_shorter_motion(timing: str) -> None:
    robot, path = torch(), line(torch(), START)
    found = plan(robot, free(path, turn=True, tilt=0.3), START, limits=LIMITS, timing=timing, allow="jerk")
    given = plan(robot, path, START, limits=LIMITS, timing=timing, allow="jerk")
    assert found and given and found.law == timing
    assert found.freedom is not None and found.freedom.fixed_duration == pytest.approx(given.trajectory.duration)
    assert found.trajectory.duration <= given.trajectory.duration
    if found.freedom.gain > 0.0:
        assert "law optimal" in found.freedom.outcome and found.trajectory.duration < given.trajectory.duration


def test_a_first_guess_may_be_at_a_turn_that_is_not_allowed() -> None:
    robot = torch()
    path = free(line(robot, START), turn=(0.3, 0.8), hold_start=False)
    found = plan(robot, path, START, limits=LIMITS)
    assert found
    assert found.freedom is not None
    low, high = found.freedom.ranges[0].reached
    assert 0.3 <= low <= high <= 0.8
    with pytest.raises(InvalidInput, match="q_start"):
        plan(robot, free(line(robot, START), turn=(0.3, 0.8)), START, limits=LIMITS)


def test_a_duration_is_that_of_the_chosen_path_slowed() -> None:
    robot = torch()
    path = free(line(robot, START), turn=True)
    fastest = plan(robot, path, START, limits=LIMITS)
    slower = plan(robot, path, START, limits=LIMITS, duration=1.5 * fastest.trajectory.duration)
    assert slower
    assert slower.trajectory.duration == pytest.approx(1.5 * fastest.trajectory.duration)
    assert slower.freedom is not None
    assert slower.freedom.gain > 0.0


def test_the_same_arguments_make_the_same_motion() -> None:
    robot = torch()
    one, two = (
        plan(robot, free(line(robot, START), turn=True, hold_start=False), START, limits=LIMITS) for _ in range(2)
    )
    assert (one.trajectory.coefficients == two.trajectory.coefficients).all()


@pytest.mark.parametrize(
    ("freedoms", "kind", "said"),
    [
        ({}, InvalidInput, "at least one"),
        ({"turn": (1.0, -1.0)}, InvalidInput, "lower < upper"),
        ({"turn": "wide"}, InvalidInput, "turn"),
        ({"turn": float("nan")}, InvalidInput, "turn"),
        ({"tilt": True}, InvalidInput, "tilt"),
        ({"tilt": (0.0, 0.1)}, InvalidInput, "tilt"),
        ({"tilt": -0.1}, InvalidInput, "tilt"),
        ({"tilt": 3.2}, InvalidInput, "at most π"),
        ({"elbow": (0.1, 0.5)}, InvalidInput, "0 is the initial joint path"),
        ({"elbow": np.array([-0.5, -0.1])}, InvalidInput, "0 is the initial joint path"),
        ({"trun": True}, UnknownName, "turn"),
        ({"turn": True, "starts": 0}, InvalidInput, "starts"),
        ({"turn": True, "coefficients": 3}, InvalidInput, "coefficients"),
        ({"turn": True, "coefficients": 10**12}, InvalidInput, "coefficients"),
        ({"turn": True, "hold_start": "yes"}, InvalidInput, "hold_start"),
    ],
)
def test_freedoms_that_no_path_can_have_are_refused(freedoms: dict[str, Any], kind: type, said: str) -> None:
    with pytest.raises(kind, match=said):
        free(line(torch(), START), **freedoms)


def test_a_pair_may_be_an_array() -> None:
    assert free(line(torch(), START), turn=np.array([-1.0, 0.5])).bounds == {"turn": (-1.0, 0.5)}


def test_misuse_of_a_free_path_is_refused() -> None:
    robot = torch()
    path = free(line(robot, START), turn=True)
    with pytest.raises(InvalidInput, match="without freedoms"):
        free(path, turn=True)
    with pytest.raises(InvalidInput, match="elbow"):
        plan(robot, free(line(robot, START), elbow=True), START, limits=LIMITS)
    with pytest.raises(InvalidInput, match="grid points"):
        plan(robot, free(line(robot, START), turn=True, coefficients=2000), START, limits=LIMITS)


def test_the_tool_stays_in_the_cone_of_its_tilt_and_within_the_stated_distance_of_the_given_path() -> None:
    """The iteration leaves the disc by its last residual on this line, by 1.8e-4 rad."""
    robot = torch()
    low, high = robot.limits.lower, robot.limits.upper
    rng = np.random.default_rng([20261123, 4, 21])
    while True:
        q = low + (high - low) * rng.uniform(0.25, 0.75, robot.n)
        way = rng.normal(size=3)
        given = line(robot, q, 0.25 * way / np.linalg.norm(way))
        if plan(robot, given, q, limits=LIMITS):
            break
    found = plan(robot, free(given, hold_start=False, tilt=0.2, turn=(-1.0, 1.0)), q, limits=LIMITS)
    assert found.freedom is not None
    assert found.freedom.outcome == "chosen"
    tilt, turn = found.freedom.ranges
    values = found.freedom.values
    assert values.shape[1] == 2 and 0.0 <= values[:, 0].min() < values[:, 0].max() <= tilt.reached[1] * (1.0 + 1e-12)
    assert tilt.reached[1] <= 0.2 * (1.0 + 1e-12)
    assert -1.0 <= turn.reached[0] <= turn.reached[1] <= 1.0
    tool = robot.fk(found.trajectory(np.linspace(0.0, found.trajectory.duration, 500)))
    nearest = given.pose(given.nearest(tool))
    axes = np.einsum("ki,ki->k", tool[:, :3, 2], nearest[:, :3, 2])
    assert (np.arccos(np.clip(axes, -1.0, 1.0)) <= 0.2 + 1e-7).all()
    angle = np.arccos(np.clip((np.einsum("kij,kij->k", tool[:, :3, :3], nearest[:, :3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    assert np.linalg.norm(tool[:, :3, 3] - nearest[:, :3, 3], axis=1).max() <= found.freedom.distance <= 1e-5
    assert angle.max() <= found.freedom.angle <= 1.2 + 1e-5


def test_coefficients_outside_their_range_are_refused() -> None:
    path = free(line(torch(), START), tilt=0.2, turn=(-1.0, 1.0))
    inside = np.tile([0.12, 0.16, 1.0], (path.spline.count, 1))
    assert path.with_coefficients(inside, None).ranges[0].reached[1] <= 0.2
    for factor, said in (([1.01, 1.01, 1.0], "tilt"), ([1.0, 1.0, 1.01], "turn")):
        with pytest.raises(InvalidInput, match=f"for {said}"):
            path.with_coefficients(inside * factor, None)


def test_a_disc_bounds_the_norm_of_its_coordinates() -> None:
    bounds = ControlBounds(np.full((3, 2), -np.inf), np.full((3, 2), np.inf), ((0, 0.5),))
    p = np.array([[0.0, 0.0], [0.3, 0.4], [0.6, 0.0]])
    box = _Box(bounds, np.ones(6, np.bool_), p, 0.01)
    np.testing.assert_allclose(box.values(p)[:, 2], [0.0, 1.0, 1.44])


def test_shapes_are_chosen_for_the_speed_of_the_body() -> None:
    robot, gains = optik.load("panda"), []
    limits = replace(LIMITS, extra={"body_speed": 0.25})
    for seed in range(4):
        first, last = robot.limits.sample(np.random.default_rng(seed), 2, margin=0.3)
        straight = plan(robot, JointLine(robot, first, last), first, limits=limits)
        found = plan(robot, PointToPoint(robot, first, last), limits=limits)
        assert found and found.certificate.worst("body_speed")[0] <= 1.0
        assert "chosen without" not in str(found) and found.freedom.unknown == ()
        gains.append(1.0 - found.duration / straight.duration)
    assert max(gains) > 0.05 and min(gains) > -1e-3


# ---------------------------------------------------------------- given poses that wind
def winding_seam(yaw: Array) -> Polyline:
    """A wave of 24 waypoints in front of an irb120; the tool points down and is turned about its axis."""
    u = np.linspace(0.0, 1.0, yaw.size)
    points = np.stack([0.36 + 0.02 * np.sin(2.0 * np.pi * u), 0.25 * (u - 0.5), np.full(yaw.size, 0.34)], axis=1)
    turned = se3.exp_so3(np.stack([0.0 * yaw, 0.0 * yaw, yaw], axis=1)) @ np.diag([1.0, -1.0, -1.0])
    return Polyline([se3.pose(R, p) for R, p in zip(turned, points, strict=True)], blend=2e-3)


def travel_of(found: planners.Plan) -> float:
    return float(np.abs(np.diff(found.trajectory(np.linspace(0.0, found.duration, 1001)), axis=0)).sum())


@pytest.mark.parametrize("law", ["optimal", "constant_speed"])
@pytest.mark.parametrize("winding", [4.5, -6.0])
def test_a_free_turn_unwinds_the_given_yaw(law: str, winding: float) -> None:
    robot, timing = load("irb120"), make_law(law, **({"speed": 0.02} if law == "constant_speed" else {}))
    limits = MotionLimits.of(robot, acceleration=5.0, jerk=50.0, tool_speed=0.05)
    given = winding_seam(winding * np.linspace(-0.5, 0.5, 24))
    found = planners.plan(robot, free(given, turn=abs(winding)), limits=limits, timing=timing)
    constant = [
        planners.plan(robot, winding_seam(np.full(24, yaw)), limits=limits, timing=timing)
        for yaw in (0.0, 1.5, 3.0, 4.5)
    ]
    solved = [plan for plan in constant if plan]
    shortest = min(plan.duration for plan in solved)
    assert found.duration <= 1.002 * shortest
    assert travel_of(found) <= 1.1 * min(travel_of(plan) for plan in solved if plan.duration <= 1.002 * shortest)
    assert found.freedom is not None and found.freedom.outcome.startswith("chosen")


@pytest.mark.parametrize("held", [False, True])
def test_orientations_stay_constant_relative_to_the_base_and_to_the_tangent(held: bool) -> None:
    s = np.linspace(0.0, 1.0, 401)
    centre, first = np.array([0.4, 0.0, 0.3]), se3.pose(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, 0.3])
    fixed = free(Arc.about(first, centre, [0.0, 0.0, 1.0], 3.0), turn=(-4.0, 2.0))  # winds against its tangent only
    follows = free(
        Arc.about(first, centre, [0.0, 0.0, 1.0], 3.0, orientation="arc"), turn=4.0
    )  # and against the base only
    for path, direction in (
        (fixed, lambda R, t: np.einsum("ki,ki->k", R[:, :, 0], t)),
        (follows, lambda R, _: R[:, 0, 0]),
    ):
        turns = list(_list_turns(path, 0, s * path.end, held=held))
        assert len(turns) == (1 if held else OFFSETS)
        R = path.given(s * path.end)[:, :3, :3]
        tangents = path.given(s * path.end, 1)[:, :3]
        for f in turns:
            turned = R @ se3.exp_so3(np.stack([0.0 * f, 0.0 * f, f], axis=1))
            assert np.ptp(direction(turned, tangents)) < 1e-4
            low, high = path.bounds["turn"]
            assert low - 1e-9 <= f.min() and f.max() <= high + 1e-9
            assert not held or f[0] == pytest.approx(0.0, abs=1e-12)


def test_of_plans_that_are_nearly_as_fast_the_one_with_the_least_travel_is_taken() -> None:
    def motion(duration: float, far: float) -> Any:
        return SimpleNamespace(
            trajectory=planners.Trajectory(PPoly(np.array([[[far / duration]], [[0.0]]]), [0.0, duration]))
        )

    plans = [motion(1.0, 2.0), motion(1.0019, 1.0), motion(1.0021, 0.5)]
    assert pick_plan(plans) is plans[1]
