"""Path and time together by CasADi and IPOPT: joints and their derivatives in s are unknowns, tied to the path.

It is the independent formulation of the tests. It reads the grid, the basis functions and the limits of the core, and shares no
formula with it: forward kinematics and all derivatives along the path are CasADi's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners.choice.choose import Choice
from planners.limits import DERIVATIVES
from planners.paths.control_curve import DEGREE
from planners.paths.free_path import FreePath

ORDERS = 4
"""A value and its first three derivatives in s."""


class SimultaneousSolution(NamedTuple):
    """Solution: duration [s], coefficients (C, D), ṡ, s̈, Δt, s⃛ (K + 1, 4), joints (n,) at the start, and what IPOPT says."""

    duration: float
    p: Array
    z: Array
    q_start: Array
    iterations: int
    success: bool
    status: str


class Constraints:
    """Expressions between bounds."""

    def __init__(self) -> None:
        self.g: list[Any] = []
        self.low: list[Array] = []
        self.high: list[Array] = []

    def add(self, value: Any, least: float, most: float) -> None:
        """Add the elements of an expression."""
        self.g.append(ca.vec(value))
        self.low.append(np.full(self.g[-1].numel(), least))
        self.high.append(np.full(self.g[-1].numel(), most))


def exponential(screw: Array, f: Any) -> Any:
    """The pose exp(f · screw), with |ω| 1 or 0."""
    v, w = screw[:3], screw[3:]
    hat = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if not hat.any():
        return ca.vertcat(ca.horzcat(np.eye(3), f * v), np.array([[0.0, 0.0, 0.0, 1.0]]))
    R = np.eye(3) + ca.sin(f) * hat + (1.0 - ca.cos(f)) * (hat @ hat)
    t = (f * np.eye(3) + (1.0 - ca.cos(f)) * hat + (f - ca.sin(f)) * (hat @ hat)) @ v
    return ca.vertcat(ca.horzcat(R, t), np.array([[0.0, 0.0, 0.0, 1.0]]))


def symbolic_pose(robot: Robot, q: Any) -> Any:
    """T_base_tool of symbolic joints."""
    T: Any = np.eye(4)
    for i in range(robot.n):
        move = exponential(np.eye(6)[2 if robot.prismatic[i] else 5], q[i])
        T = T @ robot.fixed[i] @ move
    return T @ robot.tool


def series(x: Any, sigma: Any) -> Any:
    """The Taylor polynomial of columns (·, 4): a value and three derivatives."""
    return sum(x[:, m] * sigma**m / factor for m, factor in enumerate((1.0, 1.0, 2.0, 6.0)))


def ties(choice: Choice) -> Any:
    """The function of (q (n, 4), f (D, 4), given poses (12, 4)) that is 0 where the tool is on the path, up to order 3."""
    robot, tool = choice.robot, choice.parts[3]
    sigma, D = ca.SX.sym("sigma"), choice.p.shape[1]
    q, f, pose = ca.SX.sym("q", robot.n, ORDERS), ca.SX.sym("f", D, ORDERS), ca.SX.sym("pose", 12, ORDERS)
    if tool is None:
        return ca.Function("ties", [q, f, pose], [ca.vec(q - f)])
    moved, coordinates, frames = series(q, sigma), series(f, sigma), series(pose, sigma)
    T = ca.vertcat(ca.reshape(frames, 3, 4), np.array([[0.0, 0.0, 0.0, 1.0]]))
    for d, screw in enumerate(tool.screws):
        T = T @ exponential(screw, coordinates[d])
    at = symbolic_pose(robot, moved)
    M = T[:3, :3].T @ at[:3, :3]
    off = [at[:3, 3] - T[:3, 3], ca.vertcat(M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]) / 2.0]
    if len(tool.rows):
        off.append(tool.rows @ moved - coordinates[len(tool.screws) :])
    error, out = ca.vertcat(*off), []
    for _ in range(ORDERS):
        out.append(ca.substitute(error, sigma, 0.0))
        error = ca.jacobian(error, sigma)
    return ca.Function("ties", [q, f, pose], [ca.vertcat(*out)])


def given_poses(choice: Choice, s: Array) -> Array:
    """Poses and their derivatives along the given path (K + 1, 4, 12), column by column: rotation, position."""
    assert isinstance(choice.initial, FreePath)
    path = choice.initial.given
    T, (V, V1, V2) = path(s), (path(s, order) for order in (1, 2, 3))

    def hat(w: Array) -> Array:
        zero = np.zeros(len(w))
        return np.stack([
            np.stack([zero, -w[:, 2], w[:, 1]], 1), np.stack([w[:, 2], zero, -w[:, 0]], 1),
            np.stack([-w[:, 1], w[:, 0], zero], 1),
        ], 1)  # fmt: skip

    w, w1, w2, R = hat(V[:, 3:]), hat(V1[:, 3:]), hat(V2[:, 3:]), T[:, :3, :3]
    turns = R, w @ R, (w1 + w @ w) @ R, (w2 + 2.0 * w1 @ w + w @ w1 + w @ w @ w) @ R
    places = T[:, :3, 3], V[:, :3], V1[:, :3], V2[:, :3]
    both = [np.concatenate([r, p[:, :, None]], axis=2) for r, p in zip(turns, places, strict=True)]
    return np.stack([x.transpose(0, 2, 1).reshape(len(s), 12) for x in both], axis=1)


def symbolic_path_error(choice: Choice, p: Any, q: Any) -> Any:
    """The ties of the joints and derivatives of all grid points."""
    s, n, D, basis = choice.optimum.programme.s, choice.robot.n, choice.p.shape[1], choice.parts[0]
    tie, count = ties(choice), s.size
    poses = np.zeros((count, ORDERS, 12)) if choice.parts[3] is None else given_poses(choice, s)
    fields = []
    for k in range(count):
        window = slice(int(basis.first[k]), int(basis.first[k]) + DEGREE + 1)
        fields.append(ca.vec(p[:, window] @ ca.DM(basis.values[k].T)))
    X, F, P = ca.SX.sym("X", n * ORDERS), ca.SX.sym("F", D * ORDERS), ca.SX.sym("P", 12 * ORDERS)
    whole = ca.Function("whole", [X, F, P], [
        tie(ca.reshape(X, n, ORDERS), ca.reshape(F, D, ORDERS), ca.reshape(P, 12, ORDERS))
    ])  # fmt: skip
    return whole.map(count)(q, ca.horzcat(*fields), ca.DM(poses.reshape(count, -1).T))


def add_timing(choice: Choice, found: Constraints, z: Any, q: Any) -> None:
    """Add the equations of motion along s, and the limits of velocity, acceleration and jerk."""
    programme, n = choice.optimum.programme, choice.robot.n
    limits, (length, time), K = programme.limits.arrays(n), programme.units, programme.s.size - 1
    v, a, t, j = (z[i, :] for i in range(4))
    ds, T, J = np.diff(programme.s)[None], t[:, :K], j[:, :K]
    found.add((T * (v[:, :K] + T * (0.5 * a[:, :K] + T * J / 6.0)) - ds) / ds, 0.0, 0.0)
    found.add((v[:, :K] + T * (a[:, :K] + 0.5 * T * J) - v[:, 1:]) / (length / time), 0.0, 0.0)
    found.add((a[:, :K] + T * J - a[:, 1:]) / (length / time**2), 0.0, 0.0)
    q1, q2, q3 = (q[n * m : n * (m + 1), :] for m in (1, 2, 3))
    rows = {name: ca.repmat(ca.DM(limits[name]), 1, K + 1) for name in DERIVATIVES}
    V, A = ca.repmat(v, n, 1), ca.repmat(a, n, 1)
    found.add(q1 * V / rows["velocity"], -1.0, 1.0)
    found.add((q1 * A + q2 * V * V) / rows["acceleration"], -1.0, 1.0)
    for first in (0, 1):
        at = slice(first, K + first)
        third = q1[:, at] * ca.repmat(J, n, 1) + 3.0 * q2[:, at] * V[:, at] * A[:, at] + q3[:, at] * V[:, at] ** 3
        found.add(third / rows["jerk"][:, :K], -1.0, 1.0)


def ranges(choice: Choice, z0: Array) -> tuple[Array, Array]:
    """The bounds of all unknowns."""
    (K, n), robot = (len(z0) - 1, choice.robot.n), choice.robot
    free = choice.programme.window.free.reshape(choice.p.shape)
    lower, upper = (np.where(free, bound, choice.p) for bound in (choice.bounds.lower, choice.bounds.upper))
    least = np.tile([0.0, -np.inf, 0.0, -np.inf], (K + 1, 1))
    most = np.full((K + 1, 4), np.inf)
    least[[0, -1], :2] = most[[0, -1], :2] = 0.0
    least[:K, 2] = 1e-3 * z0[:K, 2]
    least[K, 2:] = most[K, 2:] = 0.0
    joints = np.full((2, K + 1, n * ORDERS), np.inf)
    joints[0] *= -1.0
    if choice.parts[3] is not None:
        joints[0, :, :n], joints[1, :, :n] = robot.limits.lower, robot.limits.upper
    return (
        np.concatenate([least.ravel(), lower.ravel(), joints[0].ravel()]),
        np.concatenate([most.ravel(), upper.ravel(), joints[1].ravel()]),
    )


def solve_jointly(
    choice: Choice, start: tuple[Array, Array, Array] | None = None, *, iterations: int = 1000
) -> SimultaneousSolution:  # fmt: skip
    """Solve under limits of velocity, acceleration and jerk, from given (z, p, q) or the core's initial guess."""
    programme, n, (C, D) = choice.optimum.programme, choice.robot.n, choice.p.shape
    K, (length, time) = programme.s.size - 1, programme.units
    z0, p0, q0 = (programme.start, choice.p, choice.near) if start is None else start
    z0 = z0 * np.array([length / time, length / time**2, time, length / time**3])
    z0[K, 2:] = 0.0
    z, p, q = ca.MX.sym("z", 4, K + 1), ca.MX.sym("p", D, C), ca.MX.sym("q", n * ORDERS, K + 1)
    constraints = Constraints()
    constraints.add(symbolic_path_error(choice, p, q), 0.0, 0.0)
    add_timing(choice, constraints, z, q)
    for column, radius in choice.bounds.discs:
        constraints.add((p[column, :] ** 2 + p[column + 1, :] ** 2) / radius**2, -1.0, 1.0)
    least, most = ranges(choice, z0)
    unknowns = ca.vertcat(ca.vec(z), ca.vec(p), ca.vec(q))
    near = {} if start is None else {"mu_init": 1e-7, "bound_push": 1e-9, "bound_frac": 1e-9, "slack_bound_push": 1e-9}
    f = ca.sum2(z[2, :K]) / time
    solver = ca.nlpsol("together", "ipopt", {"x": unknowns, "f": f, "g": ca.vertcat(*constraints.g)}, {
        "print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8, "max_iter": iterations, **near},
    })  # fmt: skip
    answer = solver(
        x0=np.concatenate([z0.ravel(), p0.ravel(), q0.transpose(1, 0, 2).ravel()]), lbx=least, ubx=most,
        lbg=np.concatenate(constraints.low), ubg=np.concatenate(constraints.high),
    )  # fmt: skip
    x, stats = np.asarray(answer["x"]).ravel(), solver.stats()
    law, coefficients, joints = np.split(x, [4 * (K + 1), 4 * (K + 1) + C * D])
    return SimultaneousSolution(
        float(answer["f"]) * time, coefficients.reshape(C, D), law.reshape(K + 1, 4), joints[:n], int(stats["iter_count"]),
        bool(stats["success"]), str(stats["return_status"]),
    )  # fmt: skip
