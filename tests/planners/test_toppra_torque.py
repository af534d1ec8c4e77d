"""TOPP-RA under torque limits: against dense samples, and against a linear programme on the same places."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import linprog

from optik.arm.inertia import Inertia
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Trajectory, plan
from planners.following.joint_path import JointPath
from planners.timing.toppra import Toppra
from tests.planners.cases import START, default_line, paper6r

TORQUE = np.array([25.0, 40.0, 25.0, 9.0, 7.0, 5.0])
VISCOUS, COULOMB = 8.0, 2.0


@cache
def arm(viscous: float = 0.0, coulomb: float = 0.0) -> Robot:
    rng, mass = np.random.default_rng(3), np.array([6.0, 5.0, 4.0, 2.0, 1.5, 0.8])
    tensor = mass[:, None, None] / 3.0 * np.diag([0.05, 0.06, 0.07])
    com = rng.uniform(-0.1, 0.1, (6, 3))
    return replace(paper6r(), inertia=Inertia(mass, com, tensor, motor=0.1, viscous=viscous, coulomb=coulomb))


@cache
def joints(viscous: float = 0.0, coulomb: float = 0.0) -> JointPath:
    return path_of(arm(viscous, coulomb))


def path_of(robot: Robot) -> JointPath:
    """The same joint path of the arm with another payload."""
    return plan(robot, default_line(), START, limits=MotionLimits(2.0, 10.0, 100.0), timing="smooth").joint_path


def torques(motion: Trajectory, t: Array, viscous: float, coulomb: float, robot: Robot | None = None) -> Array:
    """Torques (k, n), both frictions by their closed form."""
    dq = motion(t, 1)
    bare = arm() if robot is None else robot
    return np.asarray(bare.torques(motion(t), dq, motion(t, 2)) + viscous * dq + coulomb * np.sign(dq))


@pytest.mark.parametrize("friction", [(0.0, 0.0), (0.0, COULOMB), (VISCOUS, 0.0), (VISCOUS, COULOMB)])
@pytest.mark.parametrize("acceleration", [None, 10.0])
def test_torques_are_kept_and_used(friction: tuple[float, float], acceleration: float | None) -> None:
    limits = MotionLimits(2.0, acceleration, torque=TORQUE)
    motion = Toppra().run(joints(*friction), limits)
    t = np.linspace(0.0, motion.end, 20_001)
    ratio = np.abs(torques(motion, t, *friction)) / TORQUE
    used = max(ratio.max(), np.abs(motion(t, 1)).max() / 2.0)
    assert used > 0.999 and ratio.max() < 1.0 + 2e-4
    if acceleration is None:
        assert ratio.max() > 0.999
    free = MotionLimits(2.0, 10.0) if acceleration else MotionLimits(2.0, 100.0)
    assert motion.duration >= Toppra().run(joints(*friction), free).duration * (1.0 - 1e-6) or acceleration is None


def least_duration(
    path: JointPath, lower: Array, upper: Array, coulomb: float, speed: float, count: int = 300
) -> float:
    """Duration of the greatest ṡ² whose torques keep their limits at both ends of each interval, by linear programming."""
    robot, s = arm(), np.linspace(0.0, path.end, count + 1)
    q, q1, q2 = (path(s, order) for order in range(3))
    zero = np.zeros_like(q)
    still = robot.torques(q, zero, zero)
    a, b = robot.torques(q, zero, q1) - still, robot.torques(q, q1, q2) - still
    h, n = np.diff(s), q.shape[1]
    at_rest = np.zeros_like(q, dtype=bool)  # where a joint rests or reverses its friction may have either sign
    at_rest[[0, -1]] = True
    turns = np.sign(q1[1:]) * np.sign(q1[:-1]) <= 0.0
    at_rest[1:] |= turns
    at_rest[:-1] |= turns
    c = still + coulomb * np.where(at_rest, 0.0, np.sign(q1))
    room = coulomb * at_rest
    rows, most = np.zeros((2, count, 2 * n, count + 1)), np.zeros((2, count, 2 * n))
    for end in (0, 1):
        for k in range(count):
            at = k + end
            row = np.zeros((n, count + 1))  # s̈ is the change of ṡ² over 2 h
            row[:, k + 1] += 0.5 * a[at] / h[k]
            row[:, k] -= 0.5 * a[at] / h[k]
            row[:, at] += b[at]
            rows[end, k] = np.vstack([row, -row])
            most[end, k] = np.concatenate([upper - room[at] - c[at], c[at] - lower - room[at]])
    top = (speed / np.abs(q1).max(axis=1)) ** 2
    top[[0, -1]] = 0.0
    found = linprog(
        -np.ones(count + 1),
        A_ub=rows.reshape(-1, count + 1),
        b_ub=most.ravel(),
        bounds=np.stack([0.0 * top, top], axis=1),
    )
    assert found.success
    v = np.sqrt(np.maximum(found.x, 0.0))
    return float((2.0 * h / (v[1:] + v[:-1])).sum())


@pytest.mark.parametrize(("coulomb", "share"), [(0.0, 1.0), (COULOMB, 1.0), (0.0, 1.6)])
def test_the_duration_is_that_of_a_linear_programme(coulomb: float, share: float) -> None:
    pair = (-TORQUE, share * TORQUE)
    motion = Toppra(grid=300).run(joints(0.0, coulomb), MotionLimits(2.0, torque=pair if share > 1.0 else TORQUE))
    least = least_duration(joints(0.0, coulomb), *pair, coulomb, 2.0)
    assert motion.duration == pytest.approx(least, rel=2e-3)


def test_viscous_friction_is_that_of_the_speeds_themselves() -> None:
    """Around another speed than its own friction would be too small or too large by percents."""
    motion = Toppra().run(joints(VISCOUS, 0.0), MotionLimits(2.0, torque=TORQUE))
    t = np.linspace(0.0, motion.end, 20_001)
    ratio = (np.abs(torques(motion, t, VISCOUS, 0.0)) / TORQUE).max(axis=1)
    assert (ratio > 0.97).mean() > 0.9  # it lags where ṡ grows fast within an interval of s
    assert ratio[6_000:16_000].min() > 0.9995  # where friction takes most of it


def test_a_payload_between_two_masses_is_timed_for_both() -> None:
    both, limits = arm().with_payload((0.0, 2.0)), MotionLimits(2.0, torque=TORQUE)
    motion = Toppra().run(path_of(both), limits)
    t = np.linspace(0.0, motion.end, 5_001)
    for mass in (0.0, 2.0):
        robot = arm().with_payload(mass) if mass else arm()
        assert (np.abs(torques(motion, t, 0.0, 0.0, robot)) / TORQUE).max() < 1.0 + 2e-4
        assert motion.duration >= Toppra().run(path_of(robot), limits).duration * (1.0 - 1e-6)
    found = plan(both, default_line(), START, limits=limits, timing="toppra")
    assert found and found.certificate.is_valid


def test_limits_on_acceleration_may_be_left_out_only_where_torque_stands() -> None:
    path = joints()
    with pytest.raises(InvalidInput, match="limits on acceleration"):
        Toppra().run(path, MotionLimits(2.0))
    with pytest.raises(InvalidInput, match="limits on velocity"):
        Toppra().run(path, MotionLimits(torque=TORQUE))
    with pytest.raises(InvalidInput, match="robot"):
        Toppra().run(path_of(replace(paper6r(), inertia=None)), MotionLimits(2.0, torque=TORQUE))
