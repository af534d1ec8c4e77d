"""The optimum under torque and torque rate: proved, close to finer programmes, and to an independent one."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

import optik
from optik import Robot
from optik.errors import NoSolution
from optik.ik import make_solver
from optik.types import Array
from planners import Line, MotionLimits, certify, follow
from planners.following.joint_path import JointPath
from planners.limits import PathPoints
from planners.paths.joint_line import JointLine
from planners.timing.interior_point import iteration, newton
from planners.timing.interior_point.rows import build_rows, derivatives
from planners.timing.optimal import Optimal
from tests.oracles import moved
from tests.oracles.time_optimum import best_duration
from tests.planners.torques import random_loaded
from tests.seeds import shift_seed

PAYLOADS = {"panda": (0.0, 1.5, 3.0), "ur5e": (0.0, 2.5, 5.0), "puma560": (0.0, 1.25, 2.5)}
"""None, half and full [kg]: of the data sheets, and of the Puma 560's."""


@cache
def arm(name: str, payload: float) -> Robot:
    return optik.load(name).with_payload(payload)


def limits_of(robot: Robot, *, acceleration: bool) -> MotionLimits:
    """The robot's own, and ours where it has none."""
    own, n = robot.limits, robot.n
    return MotionLimits(
        own.velocity if own.velocity is not None else np.full(n, 2.0),
        (own.acceleration if own.acceleration is not None else np.full(n, 10.0)) if acceleration else None,
        own.jerk if own.jerk is not None else np.full(n, 500.0),
        torque=own.torque,
        torque_rate=own.torque_rate if own.torque_rate is not None else 10.0 * own.torque,
    )


def possible(joint_path: JointPath) -> bool:
    """Whether the motors can hold the arm everywhere on the path."""
    robot = joint_path.robot
    static = np.abs(robot.gravity_torques(joint_path(np.linspace(0.0, joint_path.end, 300)))) + robot.inertia.coulomb
    return bool((static < 0.995 * robot.limits.torque).all())


def joint_paths(robot: Robot, seed: int, *, lines: bool) -> Iterator[JointPath]:
    """Joint moves over the whole range, or lines of 5 to 40 cm, that gravity does not forbid."""
    rng, solver = np.random.default_rng(seed), make_solver(robot, "lm")
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    while True:
        a, b = lower + (upper - lower) * rng.uniform(0.05, 0.95, (2, robot.n))
        start, along = robot.fk(a), rng.normal(size=3)
        goal = moved(start, along / np.linalg.norm(along) * rng.uniform(0.05, 0.4), 0.5 * rng.normal(size=3))
        found = follow(solver, Line(start, goal) if lines else JointLine(robot, a, b), a, resolve="local")
        if found and possible(found.joint_path) and (not lines or found.joint_path.singular_values.min() > 0.02):
            yield found.joint_path


def judged(joint_path: JointPath, limits: MotionLimits) -> float:
    """Duration over that of the same programme on 400 intervals; all limits are proved."""
    robot = joint_path.robot
    motion = Optimal().run(joint_path, limits)
    proof = certify(robot, joint_path.path, motion, limits, tolerance=(1e-4, 1e-4))
    assert proof.is_valid, proof.reasons
    for name in ("torque", "torque_rate", "velocity", "jerk"):
        assert proof.worst(name)[0] <= 1.0 + 1e-12
    return motion.duration / Optimal(intervals=400).run(joint_path, limits).duration


@pytest.mark.parametrize("lines", [False, True], ids=["joints", "line"])
@pytest.mark.parametrize("name", PAYLOADS)
def test_torque_is_kept_at_the_least_duration(name: str, lines: bool) -> None:
    robot = arm(name, PAYLOADS[name][2])
    paths = joint_paths(robot, 1, lines=lines)
    ratios = [judged(next(paths), limits_of(robot, acceleration=acceleration)) for acceleration in (True, False)]
    assert max(ratios) <= 1.003


@pytest.mark.soak
@pytest.mark.parametrize("payload", range(3))
@pytest.mark.parametrize("name", PAYLOADS)
@pytest.mark.parametrize("lines", [False, True], ids=["joints", "line"])
def test_torque_is_kept_at_the_least_duration_by_many(name: str, payload: int, lines: bool) -> None:
    """1,000 joint moves and 200 lines in all."""
    robot = arm(name, PAYLOADS[name][payload])
    limits = limits_of(robot, acceleration=False)
    paths = joint_paths(robot, shift_seed(100 + 20 * payload), lines=lines)
    ratios = [judged(next(paths), limits) for _ in range(23 if lines else 112)]
    print(f"{name} {PAYLOADS[name][payload]} kg: T/T400 median {np.median(ratios):.5f}, worst {max(ratios):.5f}")
    assert np.median(ratios) <= 1.002
    assert max(ratios) <= 1.01


def against_ipopt(robot: Robot, joint_path: JointPath, K: int, limits: MotionLimits) -> float:
    """Our duration over that of an independent programme."""
    bounds = limits.arrays(robot.n)
    torque, rate = limits.bounds(robot.n)["torque"], limits.bounds(robot.n)["torque_rate"]
    asked = (bounds["velocity"], np.full(robot.n, np.inf), bounds["jerk"], torque, rate)
    theirs = best_duration(joint_path, asked, robot.loads[0], K)
    return Optimal().run(joint_path, limits).duration / theirs


def test_the_duration_is_that_of_an_independent_programme() -> None:
    """Of motors that are so weak that torque limits the motion, friction included; theirs keeps limits at its places only."""
    robot = arm("puma560", 2.5)
    joint_path = next(joint_paths(robot, 1, lines=False))
    static = np.abs(robot.gravity_torques(joint_path(np.linspace(0.0, joint_path.end, 100)))).max(axis=0)
    limits = MotionLimits(3.0, None, 500.0, torque=1.5 * (static + robot.inertia.coulomb), torque_rate=1000.0)
    ratio = against_ipopt(robot, joint_path, 40, limits)
    assert 0.995 <= ratio <= 1.005
    assert certify(robot, joint_path.path, Optimal().run(joint_path, limits), limits).worst("torque")[0] > 0.999


@pytest.mark.soak
@pytest.mark.parametrize("name", PAYLOADS)
def test_the_durations_are_those_of_an_independent_programme(name: str) -> None:
    robot = arm(name, PAYLOADS[name][2])
    ratios = []
    for lines in (False, True):
        paths = joint_paths(robot, shift_seed(7), lines=lines)
        for _ in range(5):
            try:
                ratios.append(against_ipopt(robot, next(paths), 120, limits_of(robot, acceleration=False)))
            except AssertionError:  # IPOPT did not converge
                continue
    print(f"{name}: ours over IPOPT's, median {np.median(ratios):.5f}, worst {max(ratios):.5f}, of {len(ratios)}")
    assert len(ratios) >= 8
    assert max(ratios) <= 1.005


def test_a_payload_in_an_interval_is_planned_for_its_worst() -> None:
    light, heavy = arm("panda", 0.0), arm("panda", 3.0)
    both = optik.load("panda").with_payload((0.0, 3.0))
    joint_path = next(joint_paths(heavy, 4, lines=False))
    limits = limits_of(heavy, acceleration=False)
    ends = joint_path(0.0), joint_path(joint_path.end)
    planned = follow(make_solver(both, "lm"), JointLine(both, *ends), ends[0]).joint_path
    motion = Optimal().run(planned, limits)
    for robot in (light, heavy, both):
        assert certify(robot, JointLine(robot, *ends), motion, limits).worst("torque")[0] <= 1.0 + 1e-12
    alone = Optimal().run(joint_path, limits).duration
    assert alone * 0.9999 <= motion.duration <= 2.0 * alone


def test_motors_that_cannot_hold_the_arm_are_named() -> None:
    robot = arm("panda", 3.0)
    joint_path = next(joint_paths(robot, 1, lines=False))
    static = np.abs(robot.gravity_torques(joint_path(np.linspace(0.0, joint_path.end, 100)))).max(axis=0)
    weak = int(np.argmax(static / robot.limits.torque))
    torque = np.array(robot.limits.torque)
    torque[weak] = 0.5 * static[weak]
    with pytest.raises(NoSolution, match=rf"gravity.*{robot.joint_names[weak]}") as caught:
        Optimal().run(joint_path, MotionLimits(2.0, 10.0, 1000.0, torque=torque))
    assert caught.value.joint == robot.joint_names[weak]
    at = robot.gravity_torques(joint_path(caught.value.s))
    assert abs(at[weak]) >= torque[weak]


def test_acceleration_limits_may_be_left_out_where_torques_are_limited() -> None:
    robot = arm("panda", 3.0)
    joint_path = next(joint_paths(robot, 1, lines=False))
    with_them = Optimal().run(joint_path, limits_of(robot, acceleration=True))
    without = Optimal().run(joint_path, limits_of(robot, acceleration=False))
    assert without.duration <= with_them.duration * 1.001


@pytest.mark.parametrize("seed", range(3))
def test_sliding_joints_keep_their_forces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_loaded(rng, 5, prismatic=True, coulomb=0.2)
    middle, half = robot.limits.middle, np.minimum(robot.limits.half, 1.0)
    a, b = middle + half * rng.uniform(-0.8, 0.8, (2, 5))
    joint_path = follow(make_solver(robot, "lm"), JointLine(robot, a, b), a).joint_path
    static: Array = np.abs(robot.gravity_torques(joint_path(np.linspace(0.0, joint_path.end, 100)))).max(axis=0)
    limits = MotionLimits(2.0, None, 200.0, torque=1.3 * static + 2.0, torque_rate=20.0 * static + 50.0)
    assert judged(joint_path, limits) <= 1.005


def test_rows_of_the_programme_are_those_of_the_limits() -> None:
    """Friction included: as a joint moves, and on both sides where it reverses between two places."""
    robot = arm("puma560", 2.5)
    joint_path = next(path for path in joint_paths(robot, 3, lines=True) if reverses(path))
    limits = MotionLimits(2.0, None, 500.0, torque=(-0.9 * robot.limits.torque, robot.limits.torque), torque_rate=900.0)
    s = np.linspace(0.0, joint_path.end, 41) + 1e-4 * joint_path.end
    found = derivatives(joint_path, s[:-1])
    places = s[:-1]
    given = build_rows(joint_path, limits, places, found, (found[3, :-1], found[3, 1:]))
    at = PathPoints(joint_path, places, tuple(found))
    assert given.node.shape[1] == given.static.shape[1] == robot.n
    np.testing.assert_allclose(given.node[1:], limits.rows("torque", at)[1:], rtol=1e-9, atol=1e-9)
    rates = limits.rows("torque_rate", at)
    for end, rows in enumerate((rates[:-1], rates[1:])):
        np.testing.assert_allclose(given.edge[:, end, robot.n :], rows, rtol=1e-9, atol=1e-9)


def reverses(joint_path: JointPath) -> bool:
    """Whether a joint reverses well inside the path."""
    slopes = joint_path(np.linspace(0.1, 0.9, 50) * joint_path.end, 1)
    return bool((slopes.min(axis=0) * slopes.max(axis=0) < 0.0).any())


@pytest.mark.parametrize("seed", range(5))
def test_slopes_of_the_programme_are_those_of_its_values(seed: int) -> None:
    """Of rows with all their coefficients, by central differences."""
    rng, K, m, e = np.random.default_rng(seed), 6, 5, 4
    node, edge = rng.normal(size=(K + 1, m, 4)), rng.normal(size=(K, 2, e, 6))
    problem = newton.Problem(np.ones(K), np.ones(K), np.full(K, 0.1), np.full(K + 1, 9.0), node, edge, np.zeros(2))
    z, d = rng.uniform(0.5, 2.0, (K + 1, 4)), rng.normal(size=(K + 1, 4))
    (slope, above, below), g = np.zeros((3, K + 1, m + 2 * e)), np.zeros((K, 3))
    iteration.slopes(problem, z, d, slope, None)
    iteration.values(problem, z + 1e-5 * d, g, above)
    iteration.values(problem, z - 1e-5 * d, g, below)
    np.testing.assert_allclose(slope, (above - below) / 2e-5, rtol=0.0, atol=1e-7)
