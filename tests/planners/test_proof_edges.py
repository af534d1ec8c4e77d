"""Proofs at their edges: closed forms with equality, shapes without symmetry, and cases just beyond each threshold."""

from functools import partial
from importlib import import_module
from math import factorial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from optik import DHRow, JointLimits, Robot, Scene, Shapes
from optik.arm.inertia import Inertia
from optik.errors import InvalidInput
from optik.ik.base import Tolerance
from optik.scene.contact import BOX, PLANE, ROUND, SELF, bound_distance
from optik.scene.distance import DISTANCE_ROUNDING
from optik.scene.model import UNIT_NORMAL
from optik.types import Array
from planners import Trajectory
from planners.certificate import analysis
from planners.certificate import clearance as module
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.clearance import POSITION_STEP, VELOCITY_STEP, clearance
from planners.certificate.effort import energy
from planners.certificate.path_error import PathError
from planners.certificate.torque import direction, fourth_bounds, sizes
from planners.limits import DERIVATIVES, LOADED, PathPoints, kind_of
from planners.limits.base import Limit
from planners.trajectory.curve import quintic_through
from tests.planners.contacts import bounds_of_one_interval, pose
from tests.planners.torques import proved, random_loaded, swing, values

SEEDS = pytest.mark.parametrize("seed", range(6))
ROUNDING = 1e-12


def polynomial(*pieces: tuple[float, Any]) -> Trajectory:
    """Durations and coefficients (k, n) of pieces, highest power first."""
    rows = [np.atleast_2d(np.asarray(c, float).T).T for _, c in pieces]
    c = np.zeros((6, len(pieces), rows[0].shape[1]))
    for k, row in enumerate(rows):
        c[6 - len(row) :, k] = row
    return Trajectory(PPoly(c, np.cumsum([0.0, *(h for h, _ in pieces)])))


# ---------------------------------------------------------------- clearance
def bar(
    rng: np.random.Generator, length: float, radius: float, *, slides: bool = False, outwards: bool = True
) -> Robot:
    """One joint anywhere, with a capsule from its axis to `length` along its x, or the other way round."""
    base = pose(rng.normal(size=3), Rotation.random(random_state=rng).as_matrix())
    ends = [(0.0, 0.0, 0.0), (length, 0.0, 0.0)][:: 1 if outwards else -1]
    limits = JointLimits(np.full(1, -9.0), np.full(1, 9.0))
    robot = Robot("bar", base[None], np.array([slides]), np.eye(4), limits)
    return robot.with_shapes(Shapes([(1, *ends, radius)], names=("bar",)))


def plane_beside(robot: Robot, axis: int, far: float, rng: np.random.Generator) -> Scene:
    """A plane behind the joint's origin by `far`, whose normal of any length is the joint's axis x, y or z at 0."""
    T = robot.fixed[0]
    return Scene(planes=[(T[:3, 3] - far * T[:3, axis], rng.uniform(0.1, 5.0) * T[:3, axis])])


@SEEDS
@pytest.mark.parametrize("outwards", [False, True])
def test_a_bar_that_begins_on_the_axis_swings_with_its_other_end(seed: int, outwards: bool) -> None:
    rng = np.random.default_rng(seed)
    length, radius, middle, half = rng.uniform(0.3, 0.8), 0.01, rng.uniform(-0.4, 0.1), rng.uniform(0.2, 0.4)
    robot = bar(rng, length, radius, outwards=outwards)
    motion = polynomial((1.0, [[2.0 * half], [middle - half]]))
    far = length * np.sin(0.8) + 0.1
    true = far - radius + min(0.0, length * np.sin(middle - half))
    bound = bounds_of_one_interval(robot, motion, plane_beside(robot, 1, far, rng))[0]
    assert true - 2.0 * length * half <= bound <= true
    found = clearance(robot, motion, plane_beside(robot, 1, far, rng)).scene
    assert found is not None and found.value <= true <= found.found + ROUNDING
    assert found.found == pytest.approx(true, abs=1e-9), "at its start it is nearest"


@SEEDS
@pytest.mark.parametrize("what", ["velocity", "position"])
def test_a_motion_that_jumps_inside_an_interval_is_not_bounded_by_its_middle(seed: int, what: str) -> None:
    rng = np.random.default_rng(seed)
    robot, high, touch = bar(rng, 0.1, 0.02, slides=True), rng.uniform(0.5, 2.0), -rng.uniform(0.1, 5.0) * 1e-3
    scene = plane_beside(robot, 2, 0.3, rng)
    low = touch - 0.3 + 0.02  # where the bar enters the plane
    t = 0.1 + 0.3 * rng.random()
    v = (high - low) / 0.05
    pieces = [(t, [[0.0], [high]]), (0.05, [[-v], [high]]), (0.05, [[v], [low]]), (2.0 - t, [[0.0], [high]])]
    if what == "position":
        pieces = [(t, [[high]]), (0.1, [[low]]), (2.0 - t, [[high]])]
    motion = polynomial(*pieces)
    assert bounds_of_one_interval(robot, motion, scene)[0] <= touch
    found = clearance(robot, motion, scene)
    assert found.touches and not found.proved and found.nearest.found <= 0.0
    assert found.nearest.time == pytest.approx(t + 0.05, abs=0.051)


@pytest.mark.parametrize(("order", "least"), [(0, POSITION_STEP), (1, VELOCITY_STEP)])
def test_a_step_just_above_rounding_is_none_of_a_smooth_motion(order: int, least: float) -> None:
    for share, smooth in ((0.98, True), (1.02, False)):
        step = share * least
        pieces = [(0.5, [[0.0], [0.0]]), (0.5, [[step if order else 0.0], [0.0 if order else step]])]
        assert module._is_continuous(polynomial(*pieces)).tolist() == [True, smooth, True]


def test_the_sphere_around_an_axis_is_as_far_as_the_exact_formulas_say() -> None:
    rng = np.random.default_rng(0)
    for _ in range(40):
        T = pose(rng.normal(size=3), Rotation.random(random_state=rng).as_matrix())
        edges, middle, half = rng.uniform(0.05, 0.6, 3), rng.normal(size=3), rng.uniform(0.0, 0.5)
        c, d, normal, spheres = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), rng.normal(size=(2, 4))
        scene = Scene(boxes=[(T, 2.0 * edges)], capsules=[(c, d, 0.1)], planes=[(c, normal)]).arrays
        near = tuple(float(x) for x in middle)
        out = np.maximum(np.abs(T[:3, :3].T @ (middle - T[:3, 3])) - edges, 0.0)
        expected = {
            BOX: np.linalg.norm(out) - half,
            PLANE: (middle - c) @ normal / np.linalg.norm(normal) - half,
            SELF: np.linalg.norm(middle - spheres[0, :3]) - half - spheres[0, 3],
            ROUND: np.linalg.norm(middle - 0.5 * (c + d)) - half - 0.5 * np.linalg.norm(d - c),
        }
        for kind, distance in expected.items():
            found = bound_distance(near, half, kind, 0, scene, spheres)
            assert found == pytest.approx(distance, abs=1e-13), kind


@SEEDS
def test_a_still_ball_is_bounded_by_its_distance_from_a_turned_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(10):
        robot = bar(rng, 0.0, 0.03)
        T = pose(robot.fixed[0, :3, 3] + 0.5 * rng.normal(size=3), Rotation.random(random_state=rng).as_matrix())
        edges = rng.uniform(0.05, 0.6, 3)
        out = np.abs(T[:3, :3].T @ (robot.fixed[0, :3, 3] - T[:3, 3])) - 0.5 * edges
        motion = polynomial((1.0, [[0.0], [0.0]]))
        scene = Scene(boxes=[(T, edges)])
        if out.max() > 0.0:
            true = float(np.linalg.norm(np.maximum(out, 0.0))) - 0.03
            assert bounds_of_one_interval(robot, motion, scene)[0] == pytest.approx(true - DISTANCE_ROUNDING, abs=1e-13)
            if true > 1e-6:
                assert clearance(robot, motion, scene).nearest.value == pytest.approx(
                    true - DISTANCE_ROUNDING, abs=1e-13
                )
        else:
            assert clearance(robot, motion, scene).touches


@pytest.mark.parametrize(
    "normal", [(1, 1, 0), (0.3, -2, 5), (1e-3, 2e-3, -1e-3), (3e200, 1e200, 0), (0, 0, 1 + 1.03 * UNIT_NORMAL)]
)
def test_a_normal_of_any_length_is_made_one(normal: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(1)
    scaled = np.array(normal) / np.abs(normal).max()
    unit = scaled / np.linalg.norm(scaled)
    scene = Scene(planes=[((0.1, -0.2, 0.3), normal)])
    np.testing.assert_allclose(scene.arrays[5][0, 3:], unit, rtol=0.0, atol=2e-16)
    robot = bar(rng, 0.3, 0.02)
    ends = robot.fk(np.zeros(1)) @ np.array([[0.0, 0.0, 0.0, 1.0], [0.3, 0.0, 0.0, 1.0]]).T
    true = float(((ends[:3].T - (0.1, -0.2, 0.3)) @ unit).min()) - 0.02
    found = clearance(robot, polynomial((1.0, [[0.0], [0.0]])), scene).nearest
    assert found.found == pytest.approx(true, abs=1e-9)


# ---------------------------------------------------------------- torque
def slider(mass: float, viscous: float) -> Robot:
    """One joint that slides without weight."""
    bare = Robot.from_mdh([DHRow(0.0, 0.0, 0.0, 0.0, True)], JointLimits([-9.0], [9.0]))
    given = Inertia([mass], [[0.1, -0.2, 0.3]], np.zeros((1, 3, 3)), viscous=viscous)
    return bare.with_inertia(given).with_gravity(magnitude=0.0)


@pytest.mark.parametrize("seed", range(2))
def test_one_interval_of_a_viscous_slider_is_bounded_by_its_remainder_exactly(seed: int) -> None:
    """The force F + k t² (h − t)² has a constant cubic Hermite interpolant: the remainder is all, and it is reached."""
    rng = np.random.default_rng(seed)
    mass, viscous, h, k = rng.uniform(0.5, 3.0), rng.uniform(0.5, 5.0), rng.uniform(0.3, 1.5), rng.uniform(1.0, 9.0)
    force = np.polynomial.Polynomial([rng.uniform(0.1, 0.5), 0.0, k * h * h, -2.0 * k * h, k])
    rate = sum((-mass / viscous) ** i * force.deriv(i) for i in range(5)) / viscous  # of m q̈ + viscous q̇ = force
    motion = polynomial((h, rate.integ().coef[::-1][:, None]))
    robot, side = slider(mass, viscous), rng.choice([-1.0, 1.0])
    bound = [proved(robot, polynomial((h, side * rate.integ().coef[::-1][:, None])), rate=r, most=0).ratio[0]
             for r in (False, True)]  # fmt: skip
    largest = force.coef[0] + k * h**4 / 16.0, np.sqrt(3.0) * k * h**3 / 9.0
    np.testing.assert_allclose(bound, largest, rtol=1e-9)
    t = np.linspace(0.0, h, 10_001)
    reached = np.abs(values(robot, motion, t, robot.loads[0])[:, :, 0]).max(axis=0)
    np.testing.assert_allclose(reached, largest, rtol=1e-6)


def bells(S: Array) -> Array:
    """Complete Bell polynomials B_0 to B_6 of S_1 to S_6, (7,): derivatives at 0 of exp Σ S_k xᵏ / k!."""
    x = np.polynomial.Polynomial([0.0, *(S[k] / factorial(k) for k in range(1, 7))])
    series, power = np.zeros(7), np.polynomial.Polynomial([1.0])
    for k in range(7):
        series[: min(7, power.coef.size)] += power.coef[:7] / factorial(k)
        power = power * x
    return np.asarray(series * [factorial(k) for k in range(7)])


def leibniz(a: Array, b: Array, order: int, first: int = 0) -> float:
    """The derivative of an order of a product of a function and another's derivative of order `first`."""
    return float(sum(factorial(order) / factorial(m) / factorial(order - m) * a[m] * b[order - m + first]
                     for m in range(order + 1)))  # fmt: skip


@SEEDS
@pytest.mark.parametrize("orders", [(1, 5), (2, 5), (1, 2, 3, 4, 5), (3, 4)])
def test_the_fourth_derivatives_bound_is_its_closed_form(seed: int, orders: tuple[int, ...]) -> None:
    """Two joints, the first one turning: what `planners.certificate.torque` derives, written anew."""
    rng = np.random.default_rng(seed)
    slides = bool(seed % 2)
    rows = [DHRow(0.0, 0.3, 0.2, 0.1), DHRow(0.4, 1.1, 0.0 if slides else 0.3, 0.2, slides)]
    bare = Robot.from_mdh(rows, JointLimits(np.full(2, -9.0), np.full(2, 9.0)))
    mass, com, viscous = rng.uniform(0.5, 2.0, 2), rng.normal(size=(2, 3)), rng.uniform(0.1, 2.0)
    tensor = np.array([np.diag(x) for x in rng.uniform(1.0, 1.5, (2, 3))])
    robot = bare.with_inertia(Inertia(mass, com, tensor, viscous=viscous))
    D = np.zeros((6, 2))
    D[list(orders)] = rng.uniform(0.2, 2.0, (len(orders), 2))
    D[0] = rng.uniform(0.2, 2.0, 2)
    size = np.linalg.norm(robot.fixed[:, :3, 3], axis=1), np.linalg.norm(com, axis=1)
    S = np.zeros((2, 7))
    S[0, :6], S[1, :6] = D[:, 0], D.sum(axis=1) if not slides else D[:, 0]
    one, two = bells(S[0]), bells(S[1])
    slid = np.array([leibniz(one, np.append(D[:, 1], 0.0), k) for k in range(7)]) if slides else 0.0  # of z₂ q₂
    p1 = size[0][0] * np.eye(7)[0]
    p2 = p1 + size[0][1] * one + slid
    g, half, expected = 9.80665, 0.5 * np.trace(tensor, axis1=1, axis2=2), np.zeros((2, 2))
    for link, (b, p) in enumerate(((one, p1), (two, p2))):
        c = p + size[1][link] * b
        pull = mass[link] * np.concatenate([c[2:], [0.0, 0.0]])
        pull[0] += mass[link] * g
        for i, before in ((0, p1), (1, p2))[: link + 1]:
            turns = i == 0 or not slides
            arm = p - before + size[1][link] * b if turns else one
            expected[i, link] = leibniz(arm, pull, 4) + (half[link] * leibniz(b, b, 4, 2) if turns else 0.0)
    out, D5 = np.empty(2), D[5]
    fourth_bounds(sizes(robot, robot.loads[0]), D, False, np.empty((2, 3, 7)), out)
    np.testing.assert_allclose(out, expected.sum(axis=1) + viscous * D5, rtol=1e-11)


@SEEDS
def test_the_direction_of_a_joint_is_known_at_any_rate(seed: int) -> None:
    """A velocity that crosses 0 just inside the interval, and just before it, from slow to fast."""
    rng = np.random.default_rng(seed)
    for size in 10.0 ** rng.uniform(-12.0, 6.0, 20):
        h, sign = 10.0 ** rng.uniform(-4.0, 1.0), rng.choice([-1, 1])
        for share, sense in ((0.01, 0), (-0.01, sign), (0.0, sign), (0.99, 0), (1.01, -sign), (1.0, -sign)):
            rates = sign * size * np.array([-share * h, 1.0, 0.0, 0.0, 0.0])
            assert direction(rates, h) == sense, (share, size)
        for k in range(5):  # a velocity tᵏ
            assert direction(sign * size * np.eye(5)[k], h) == sign
    assert direction(np.zeros(5), 1.0) == 0


@SEEDS
def test_friction_is_added_in_the_sense_of_a_slow_motion(seed: int) -> None:
    """A slider that starts at 0.5 mm/s or less, slowed by more than friction and reversed or not within the interval."""
    rng = np.random.default_rng(seed)
    robot = slider(1.0, 0.0).with_inertia(coulomb=0.7)
    v, side = 10.0 ** rng.uniform(-8.0, -3.3), rng.choice([-1.0, 1.0])
    for stops, force in ((0.9, 0.7 + v / 0.9), (1.1, max(v / 1.1 - 0.7, 0.7 - v / 1.1))):
        motion = polynomial((1.0, side * np.array([[-0.5 * v / stops], [v], [0.0]])))
        found = proved(robot, motion, rate=False)
        assert found.ratio[0] == pytest.approx(force, rel=1e-9), stops


@SEEDS
def test_ratios_at_the_ends_of_pieces_are_of_the_side_of_the_torque(seed: int) -> None:
    """With friction by the sense of the motion, small torques and large ones, and unequal limits on both sides."""
    rng = np.random.default_rng(seed)
    robot = slider(rng.uniform(0.5, 3.0), rng.uniform(0.1, 2.0)).with_inertia(coulomb=0.3)
    size = (0.01, 1.0)[seed % 2]
    motion = polynomial((0.7, size * rng.normal(size=(6, 1))), (0.4, size * rng.normal(size=(6, 1))))
    bound = np.array([[-rng.uniform(0.5, 2.0)], [rng.uniform(3.0, 9.0)]])
    torques = MotionAnalysis(robot, motion).torques
    mass, viscous = torques.models[0][1].bodies[0][0], torques.models[0][1].viscous[0]
    for rate in (False, True):
        found = torques.piece_ratios(bound, rate=rate)
        for k, (start, end) in enumerate(zip(motion.knots[:-1], motion.knots[1:], strict=True)):
            local = np.poly1d(motion.coefficients[:, k, 0])
            values_ = []
            for t in (0.0, end - start):
                v, a, j = (local.deriv(i)(t) for i in (1, 2, 3))
                values_.append(mass * j + viscous * a if rate else mass * a + viscous * v + 0.3 * np.sign(v))
            expected = max(x / bound[1, 0] if x > 0.0 else x / bound[0, 0] for x in values_)
            assert found[k, 0] == pytest.approx(expected, rel=1e-9)


# ---------------------------------------------------------------- limits of some joints
@pytest.mark.parametrize("name", [*DERIVATIVES, *LOADED])
def test_a_joint_without_a_limit_frees_no_other_joint(name: str) -> None:
    """A free joint is as good as one with a limit that nothing reaches."""
    rng = np.random.default_rng(len(name))
    robot, kind = random_loaded(rng, 3, prismatic=True, coulomb=0.2), kind_of(name)
    motion = swing(rng, 3, 2, 0.7)
    bound = rng.uniform(1e3, 3e3, 3)
    free, far = bound.copy(), bound.copy()
    free[1], far[1] = np.inf, 1e15
    limited = [0, 2]
    mine, theirs = (kind.judge(MotionAnalysis(robot, motion), x) for x in (free, far))
    assert (mine.ratio[limited] > 1e-6).all() and np.isnan(mine.ratio[1])
    np.testing.assert_allclose(mine.ratio[limited], theirs.ratio[limited], rtol=1e-4)
    np.testing.assert_allclose(mine.value[limited], theirs.value[limited], rtol=1e-4)
    for slowing in (kind.stretch_factor, *([partial(Limit.stretch_factor, kind)] if kind.homogeneous else [])):
        one, other = (slowing(MotionAnalysis(robot, motion), x) for x in (free, far))
        assert one > 0.0 and one == pytest.approx(other, rel=1e-4)
    one, other = (kind.piece_ratios(MotionAnalysis(robot, motion), x) for x in (free, far))
    np.testing.assert_allclose(one[:, limited], other[:, limited], rtol=1e-9)
    assert one[:, limited].max() > 0.0
    q = rng.normal(size=(4, 5, 3))
    points = [PathPoints(SimpleNamespace(robot=robot, end=4.0), np.arange(5.0), tuple(q)) for _ in range(2)]
    rows, others = (kind.rows(at, x) for at, x in zip(points, (free, far), strict=True))
    assert rows.shape == others.shape and np.abs(rows).max() > 0.0
    np.testing.assert_allclose(rows, others, rtol=1e-9, atol=1e-9 * np.abs(rows).max())


# ---------------------------------------------------------------- energy
@SEEDS
def test_the_work_of_a_piece_that_begins_and_ends_moving_is_its_kinetic_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mass, h = rng.uniform(0.5, 3.0), rng.uniform(0.2, 1.5)
    robot = slider(mass, 0.0)
    c = np.array([0.2, -0.3, 0.5, 1.0, 2.0, 0.3]) * rng.uniform(0.5, 1.5, 6)
    motion = polynomial((h, c[2:, None]))  # a cubic: power is a cubic, and the rule exact
    v = motion(np.array([0.0, h]), 1)[:, 0]
    found = energy(MotionAnalysis(robot, motion).torques)
    assert found.net == pytest.approx(0.5 * mass * (v[1] ** 2 - v[0] ** 2), rel=1e-10)
    power = mass * motion(np.array([0.0, 0.5 * h, h]), 1)[:, 0] * motion(np.array([0.0, 0.5 * h, h]), 2)[:, 0]
    assert found.power == pytest.approx(power.max(), rel=1e-12)
    assert found.time == pytest.approx([0.0, 0.5 * h, h][power.argmax()], abs=1e-12)
    assert found.drawn == pytest.approx(found.net, rel=1e-10) if (power > 0.0).all() else found.drawn > found.net
    viscous = proved_energy(slider(mass, 0.4).with_inertia(coulomb=0.2), motion)
    t = np.linspace(0.0, h, 20_001)
    moving = np.abs(motion(t, 1)[:, 0])
    lost = 0.4 * np.trapezoid(moving**2, t) + 0.2 * np.trapezoid(moving, t)
    assert viscous == pytest.approx(found.net + lost, rel=1e-6)


def proved_energy(robot: Robot, motion: Trajectory) -> float:
    return energy(MotionAnalysis(robot, motion).torques).net


# ---------------------------------------------------------------- thresholds
STATED = {
    "planners.certificate.analysis": {
        "JUMP": 1e-5, "STEP_ROUNDING": 1e-14, "AT_REST": 1e-9, "COVERED": (1e-5, 1e-5), "LIMIT_TOLERANCE": 1e-9,
        "CROSSING_ROUNDING": 1e-12,
    },
    "planners.certificate.clearance": {"POSITION_STEP": 1e-11, "VELOCITY_STEP": 1e-10},
    "planners.certificate.certificate": {"RATIO_ROUNDING": 1e-12},
    "planners.certificate.path_error": {"ERROR_EXCESS": 1.048, "ERROR_FLOOR": 1e-9, "ERROR_ROUNDING": 2e-15},
    "planners.certificate.torque": {
        "TORQUE_EXCESS": 1e-5, "TORQUE_FLOOR": 1e-2, "MOTOR_FLOOR": 1e-5, "STANDSTILL": 1e-9,
    },
    "planners.certificate.certification": {"STILL": 1e-9, "UNMOVED": 1e-12, "AT_STOP": 1e-6},
    "planners.certificate.frechet": {"CHORD_FRACTION": 0.01, "GAP": 1e-3},
    "planners.limits._bernstein": {"ROUNDING": 1e-13},
    "planners.limits.kinds": {"AT_BREAK": 1e-9, "STANDING_SHARE": 1e-9},
    "planners.limits.velocity_by_position": {"FIRST_EXCESS": 1e-9, "STILL": 1e-12},
    "planners.limits._specific_force": {"PROOF_EXCESS": 1e-5},
    "planners.streams.result": {"CONTINUOUS": 1e-9, "EXCESS": 1e-9, "JOINED_WITHIN": 0.01},
    "planners.program.joining": {"ON_CURVE": 1e-8, "MIDDLE": 5.0 / 64.0},
    "planners.program.following": {"GAP": 1e-6, "NO_GAP": 1e-12},
    "planners.cell.drives._run": {"GREATEST_STEP": 1.0 + 1e-6},
    "planners.cell.calibration": {"CONFIDENCE": 0.999, "MOST_LEFT_OUT": 0.25, "MOST_TURN": 0.05},
    "optik.scene.distance": {"DISTANCE_ROUNDING": 1e-9},
    "optik.scene.model": {"UNIT_NORMAL": 1e-14},
}  # fmt: skip
"""What docstrings, documentation and formats promise; tests of behaviour take the code's own constants."""


@pytest.mark.parametrize("name", STATED)
def test_thresholds_are_those_that_are_stated(name: str) -> None:
    found = import_module(name)
    assert {key: getattr(found, key) for key in STATED[name]} == STATED[name]


def rounding(motion: Trajectory) -> Array:
    """Rounding errors of derivatives (4, m + 1, n) at the knots, from the shorter piece beside each."""
    h = np.diff(motion.knots)
    shorter = np.minimum(np.append(h, h[-1]), np.append(h[0], h))
    size = np.maximum(motion.extrema(0).worst, analysis.FROM_AFAR)
    return analysis.STEP_ROUNDING * size / shorter[None, :, None] ** np.arange(4)[:, None, None]


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize(("share", "jumps"), [(0.99, False), (1.01, True)])
def test_a_jump_is_one_just_above_its_threshold(order: int, share: float, jumps: bool) -> None:
    """A quintic of a second joint is unlike the first: each is judged on its own scale."""
    t, q = np.array([0.0, 0.7, 1.3]), np.array([[0.0, 0.0], [0.4, 30.0], [0.9, -50.0]])
    smooth = Trajectory(quintic_through(t, q, np.array([[0.0, 0.0], [1.0, 5.0], [0.0, 0.0]]), np.zeros((3, 2))))
    c, moved = smooth.coefficients.copy(), smooth
    for _ in range(4):  # the jump changes the largest value that it is compared with
        most = analysis.JUMP * moved.extrema(order).worst + rounding(moved)[order, 1]
        c[5 - order, 1, 0] += (share * most[0] - moved.jumps(order)[0, 0]) / factorial(order)
        moved = Trajectory(PPoly(c, smooth.knots))
    assert moved.jumps(order)[0, 0] == pytest.approx(share * most[0], rel=1e-3)
    assert analysis.jumps(moved, analysis.rest(moved))[order, 1, 0] == jumps


@pytest.mark.parametrize(("share", "rests"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("end", [0, 1])
def test_a_motion_is_at_rest_just_below_its_threshold(share: float, rests: bool, end: int) -> None:
    t, q = np.array([0.0, 0.7, 1.3, 1.8]), np.array([[0.0, 0.0], [0.4, 30.0], [0.9, -50.0], [0.7, 20.0]])
    v = np.array([[0.0, 0.0], [1.0, 5.0], [-0.5, 2.0], [0.0, 0.0]])
    still = Trajectory(quintic_through(t, q, v, np.zeros((4, 2))))
    most = rounding(still)[1, -end]
    if end:
        most = most + analysis.AT_REST * still.extrema(1).worst
    v[-end, 0] = share * most[0]
    found = analysis.rest(Trajectory(quintic_through(t, q, v, np.zeros((4, 2)))))
    assert found[end] == rests and found[1 - end]


def test_a_joint_that_stands_at_0_is_at_rest() -> None:
    assert analysis.rest(polynomial((1.0, np.array([[0.0, 0.3]])))) == (True, True)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize(("knot", "shorter"), [(1, 0.01), (2, 0.01), (3, 0.2)])
def test_rounding_counts_by_the_shorter_of_the_pieces_beside_a_knot(order: int, knot: int, shorter: float) -> None:
    h, worst = np.array([0.5, 0.01, 0.2, 0.3]), np.array([0.3, 4.0])
    for share in (0.9, 1.1):
        c = np.zeros((6, 4, 2))
        c[5] = worst
        c[5 - order, knot, 1] = share * analysis.STEP_ROUNDING * worst[1] / shorter**order / factorial(order)
        motion = Trajectory(PPoly(c, np.append(0.0, np.cumsum(h))))
        assert analysis.jumps(motion, (True, True))[order, knot].tolist() == [False, share > 1.0]


@pytest.mark.parametrize(("distance", "angle"), [(1.01, 0.5), (0.5, 1.01), (1.01, 1.01), (1.0, 1.0)])
@pytest.mark.parametrize("tolerance", [(3e-4, 2e-5), (1e-6, 5e-3)])
def test_a_tool_off_its_path_is_named_just_beyond_the_tolerance(
    distance: float, angle: float, tolerance: tuple[float, float]
) -> None:
    sizes_ = distance * tolerance[0], angle * tolerance[1]
    off = PathError(*sizes_, *sizes_, 0.3, 0.7)
    found = [(x.t, "turned" in x.words) for x in off.find_violations(Tolerance(*tolerance))]
    assert found == [(0.3, False)] * (distance > 1.0) + [(0.7, True)] * (angle > 1.0)
    assert off.find_violations(None) == []


def test_a_joint_leaves_its_range_just_beyond_the_tolerance() -> None:
    for share in (1.0, 1.01):
        margins = np.array([0.3, -share * analysis.LIMIT_TOLERANCE, 0.1])
        found = analysis.find_position_violations(margins, ("a", "b", "c"))
        assert [x.joint for x in found] == (["b"] if share > 1.0 else [])
    limits = JointLimits([-0.5], [2.0])
    robot = Robot("bar", np.eye(4)[None], np.array([False]), np.eye(4), limits)
    for low, high in ((-0.3, 1.9), (-0.1, 0.2), (-0.7, 1.0), (0.0, 2.3)):
        motion = polynomial((1.0, [[high - low], [low]]))
        assert analysis.position_margins(robot, motion)[0] == pytest.approx(min(low + 0.5, 2.0 - high), abs=1e-12)


def test_the_jerk_that_a_controller_sees_of_a_long_motion_is_found_at_its_knots(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An acceleration that jumps at one knot, of more periods than are all looked at."""
    pieces = [(3.0, [[0.05], [0.0], [0.0]]), (2.0, [[-0.2], [0.3], [0.45]]), (4.0, [[0.01], [0.0], [0.0]])]
    motion, largest = polynomial(*pieces), 2.0 * 0.25 * 100.0
    for most in (analysis.PERIODS, 20):
        monkeypatch.setattr(analysis, "PERIODS", most)
        assert analysis.sampled_jerk(motion, 100.0)[0] == pytest.approx(largest, rel=1e-9)
    for rate in analysis.RATES:
        assert np.isfinite(analysis.sampled_jerk(motion, rate)).all()
        with pytest.raises(InvalidInput, match="rate"):
            analysis.check_rate(rate * (1.01 if rate > 1.0 else 0.99))
