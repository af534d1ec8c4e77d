"""The law `optimal` under further limits beside CasADi's optimum of a programme of our own on 110 intervals, exact cones."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

import optik
from optik.arm.robot import Robot
from optik.types import Array
from planners import JointLine, MotionLimits, Plan, plan
from tests.figures import finish
from tests.figures.figure import Row, Value, main
from tests.figures.limits import BOX, _speeds, draw, value_of

COUNTS = {"acceleration_by_velocity": 20, "body_speed": 20, "open_container": 20, "grip": 20, "motors": 20, "rms": 15}
"""Number of motions of each limit."""
INTERVALS, APART = 110, 1e-4


def cases() -> list[tuple[str, int]]:
    return [(name, i) for name, count in COUNTS.items() for i in range(count)]


def coupled(i: int) -> tuple[Robot, Any, Array]:
    """The ur5e with a motor of joint 3 at the base and a differential wrist, and a joint line."""
    rng, C = np.random.default_rng([i, 99]), np.eye(6)
    C[2, 1], C[4:, 4:] = -1.0, [[0.5, 0.5], [0.5, -0.5]]
    robot = optik.load("ur5e").with_limits(acceleration=10.0, jerk=100.0, torque=None).with_motors(C)
    ends = 0.8 * robot.limits.sample(rng, 2)
    return robot, JointLine(robot, *ends), ends[0]


def optimum(name: str, robot: Robot, found: Plan, value: Any) -> float:
    """Duration of CasADi's optimum along the joint path of a plan, from its grid; NaN without one."""
    joints, knots = found.joint_path, found.trajectory.s
    t = np.linspace(0.0, found.duration, INTERVALS + 1)
    s = np.interp(t, found.trajectory.knots, knots)
    q1, q2, q3 = (joints(s, order) for order in (1, 2, 3))
    opti, K = casadi.Opti(), INTERVALS
    v, a, j, tau = opti.variable(K + 1), opti.variable(K + 1), opti.variable(K), opti.variable(K)
    opti.minimize(casadi.sum1(tau))
    opti.subject_to(opti.bounded(1e-5, tau, 10.0))
    opti.subject_to(v >= 0.0)
    for end in (0, K):
        opti.subject_to(v[end] == 0.0)
        opti.subject_to(a[end] == 0.0)
    opti.subject_to(v[1:] == v[:-1] + a[:-1] * tau + j * tau**2 / 2)
    opti.subject_to(a[1:] == a[:-1] + j * tau)
    opti.subject_to(np.diff(s) == v[:-1] * tau + a[:-1] * tau**2 / 2 + j * tau**3 / 6)
    E = np.eye(robot.n) if name != "motors" else robot.motors.inverse
    own = robot.limits if name != "motors" else robot.motors.limits
    V = _speeds(robot) if name != "motors" else own.velocity
    w1, w2, w3 = (x @ E.T for x in (q1, q2, q3))
    for i in range(robot.n):
        acceleration = w1[:, i] * a + w2[:, i] * v**2
        opti.subject_to(opti.bounded(-V[i], w1[:, i] * v, V[i]))
        opti.subject_to(opti.bounded(-10.0, acceleration, 10.0))
        for side in (slice(None, -1), slice(1, None)):
            jerk = w1[side, i] * j + 3.0 * w2[side, i] * v[side] * a[side] + w3[side, i] * v[side] ** 3
            opti.subject_to(opti.bounded(-100.0, jerk, 100.0))
        if name == "acceleration_by_velocity":
            y, speed = np.sign(q1[:, i]) * acceleration, np.abs(q1[:, i]) * v
            opti.subject_to(y + 2.5 * speed <= 10.0)
            opti.subject_to(y >= -14.0)
    if name == "body_speed":
        opti.subject_to(_slowness(robot, joints, s) * v <= value)
    if name == "rms":
        _bound_rms(opti, robot, joints, s, (v, a, tau), value)
    if name in ("open_container", "grip"):
        _bound_force(opti, name, robot, joints, s, (v, a), value)
    opti.set_initial(v, np.interp(s, knots, np.gradient(knots, found.trajectory.knots)))
    opti.set_initial(tau, np.diff(t))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "max_iter": 2000, "sb": "yes"})
    try:
        return float(opti.solve().value(casadi.sum1(tau)))
    except RuntimeError:
        return float("nan")


def _slowness(robot: Robot, joints: Any, s: Array) -> Array:
    """Greatest speed of points of the capsules per unit of s, by differences."""
    rng, most = np.random.default_rng(1), np.zeros(s.size)
    h = 1e-6
    ends = [robot.frames(joints(np.clip(s + d, 0.0, joints.end))) for d in (-h, h)]
    width = np.clip(s + h, 0.0, joints.end) - np.clip(s - h, 0.0, joints.end)
    for link, first, second, radius in zip(*robot.shapes.capsules, strict=True):
        for centre in (first, second) if link else ():
            n = rng.normal(size=(400, 3))
            p = centre + radius * n / np.linalg.norm(n, axis=1)[:, None]
            moved = [x[:, link - 1, :3, :3] @ p.T + x[:, link - 1, :3, 3:] for x in ends]
            most = np.maximum(most, np.linalg.norm(moved[1] - moved[0], axis=1).max(axis=1) / width)
    return most


def _bound_force(opti: Any, name: str, robot: Robot, joints: Any, s: Array, rates: tuple[Any, Any], value: Any) -> None:
    """Add the exact cone: f = Rᵀ (g − p' s̈ − p'' ṡ²), p by differences."""
    h, com = APART * joints.end, np.array(value.com)
    at = np.clip(s, h, joints.end - h)
    T = [robot.fk(joints(at + d)) for d in (-h, 0.0, h)]
    place = [x[:, :3, 3] + x[:, :3, :3] @ com for x in T]
    R = robot.fk(joints(s))[:, :3, :3]
    g = robot.gravity_magnitude * np.asarray(robot.gravity) / np.linalg.norm(robot.gravity)
    still = np.einsum("kji,j->ki", R, g)
    linear = -np.einsum("kji,kj->ki", R, (place[2] - place[0]) / (2.0 * h))
    square = -np.einsum("kji,kj->ki", R, (place[2] - 2.0 * place[1] + place[0]) / h**2)
    f = [still[:, i] + linear[:, i] * rates[1] + square[:, i] * rates[0] ** 2 for i in range(3)]
    n = np.array(value.axis)
    along = sum(n[i] * f[i] for i in range(3))
    across = sum(f[i] ** 2 for i in range(3)) - along**2
    if name == "open_container":
        opti.subject_to(along <= -0.1)
        opti.subject_to(across <= np.tan(value.angle) ** 2 * along**2)
    else:
        opti.subject_to(across <= (2.0 * value.friction * value.force) ** 2)
        opti.subject_to(opti.bounded(-value.force, along, value.force))


def _bound_rms(opti: Any, robot: Robot, joints: Any, s: Array, rates: tuple[Any, Any, Any], most: Array) -> None:
    """Bound the mean squares of the torques m s̈ + c ṡ² + viscous q' ṡ + coulomb sign q' + g by the trapezoidal rule."""
    (q, q1, q2), none = (joints(s, order) for order in range(3)), np.zeros((s.size, robot.n))
    g, dry, wet = robot.torques(q, none, none), robot.inertia.coulomb * np.sign(q1), robot.inertia.viscous * q1
    m, c = robot.torques(q, none, q1) - g, robot.torques(q, q1, q2) - g - dry - wet
    v, a, tau = rates
    for i in range(robot.n):
        square = (m[:, i] * a + c[:, i] * v**2 + wet[:, i] * v + dry[:, i] + g[:, i]) ** 2
        mean = 0.5 * casadi.sum1((square[1:] + square[:-1]) * tau) / most[i] ** 2
        opti.subject_to(mean <= casadi.sum1(tau))


def rms_case(i: int) -> tuple[Robot, Plan, Array]:
    """A motion of `tests.figures.finish`, slowed until the rms torques are below limits that bind, and these."""
    robot, path, q, _ = finish.draw(finish.QUIET + i)
    limits = MotionLimits.of(robot, **BOX | {"velocity": _speeds(robot)})
    free = plan(robot, path, q, limits=limits)
    usual, still = finish.rms(free), finish.rms(free.stretched(50.0))
    most = np.where(usual > still, still + 0.75 * (usual - still), 1e3)
    return robot, free.slowed_to(rms_torque=most), most


def measure(case: int) -> Row:
    name, i = cases()[case]
    if name == "rms":
        robot, one, most = rms_case(i)
        best = optimum(name, robot, one, most)
        return {"name": name, "ratio": one.duration / best if np.isfinite(best) else None}
    found = coupled(i) if name == "motors" else draw(name, 4 * i)
    if found is None:
        return {"name": name, "ratio": None}
    robot, path, q = found
    if name == "motors":
        value, one = None, plan(robot, path, q)
    else:
        value = value_of(name, robot)
        one = plan(robot, path, q, limits=MotionLimits.of(robot, **BOX | {"velocity": _speeds(robot)}, **{name: value}))
    if not one:
        return {"name": name, "ratio": None}
    best = optimum(name, robot, one, value)
    return {"name": name, "ratio": one.duration / best if np.isfinite(best) else None}


def judge(rows: list[Row]) -> list[Value]:
    values = []
    for name in COUNTS:
        mine = [row["ratio"] for row in rows if row["name"] == name and row["ratio"] is not None]
        if mine:
            asked = {"body_speed": 1.01, "rms": 1.08}.get(name, 1.005)
            words = f"{max(mine):.4f} at most, {np.median(mine):.4f} in the median of {len(mine)}"
            values.append(Value(f"{name}: duration over CasADi's", f"≤ {asked}", words, max(mine) <= asked))
    return values


if __name__ == "__main__":
    main("limits_casadi", measure, len(cases()), judge)
