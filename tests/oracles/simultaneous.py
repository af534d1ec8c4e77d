"""Path and time together by CasADi and IPOPT: joints and their derivatives in s are unknowns, tied to the path by equations.

It reads the grid, the basis functions and the limits of the core, and shares no formula with it: forward kinematics and all
derivatives along the path are CasADi's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners.paths._spline import DEGREE
from planners.timing._free.choose import Choice

ORDERS = 4
"""A value and its first three derivatives in s."""


class Joint(NamedTuple):
    """Solution: duration [s], coefficients (C, D), IPOPT's iterations, and whether it succeeded."""

    duration: float
    p: Array
    iterations: int
    success: bool


def exponential(screw: Array, f: Any) -> Any:
    """The pose exp(f · screw), with |ω| 1 or 0."""
    v, w = screw[:3], screw[3:]
    hat = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if not hat.any():
        return ca.vertcat(ca.horzcat(np.eye(3), f * v), np.array([[0.0, 0.0, 0.0, 1.0]]))
    R = np.eye(3) + ca.sin(f) * hat + (1.0 - ca.cos(f)) * (hat @ hat)
    t = (f * np.eye(3) + (1.0 - ca.cos(f)) * hat + (f - ca.sin(f)) * (hat @ hat)) @ v
    return ca.vertcat(ca.horzcat(R, t), np.array([[0.0, 0.0, 0.0, 1.0]]))


def forward(robot: Robot, q: Any) -> Any:
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
    moved, coordinates, given = series(q, sigma), series(f, sigma), series(pose, sigma)
    T = ca.vertcat(ca.reshape(given, 3, 4), np.array([[0.0, 0.0, 0.0, 1.0]]))
    for d, screw in enumerate(tool.screws):
        T = T @ exponential(screw, coordinates[d])
    at = forward(robot, moved)
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


def solve_jointly(choice: Choice, start: tuple[Array, Array, Array] | None = None) -> Joint:
    """Solve under limits of velocity, acceleration and jerk, from given (z, p, q) or the core's initial guess."""
    programme = choice.optimum.programme
    robot, s, limits = choice.robot, programme.s, programme.limits.arrays(choice.robot.n)
    K, n, (C, D), basis = s.size - 1, robot.n, choice.p.shape, choice.parts[0]
    length, time = programme.units
    z0, p0, q0 = (programme.start, choice.p, choice.near) if start is None else start
    z0 = z0 * np.array([length / time, length / time**2, time, length / time**3])
    z, p, q = ca.MX.sym("z", 4, K + 1), ca.MX.sym("p", D, C), ca.MX.sym("q", n * ORDERS, K + 1)
    tie = ties(choice)
    poses = np.zeros((K + 1, ORDERS, 12)) if choice.parts[3] is None else given_poses(choice, s)
    fields = []
    for k in range(K + 1):
        window = slice(int(basis.first[k]), int(basis.first[k]) + DEGREE + 1)
        fields.append(ca.vec(p[:, window] @ ca.DM(basis.values[k].T)))
    size = tie.size_out(0)[0]
    X, F, P = ca.SX.sym("X", n * ORDERS), ca.SX.sym("F", D * ORDERS), ca.SX.sym("P", 12 * ORDERS)
    whole = ca.Function("whole", [X, F, P], [
        tie(ca.reshape(X, n, ORDERS), ca.reshape(F, D, ORDERS), ca.reshape(P, 12, ORDERS))
    ])  # fmt: skip
    given = ca.DM(poses.reshape(K + 1, -1).T)
    g, low, high = (
        [ca.vec(whole.map(K + 1)(q, ca.horzcat(*fields), given))],
        [np.zeros(size * (K + 1))],
        [np.zeros(size * (K + 1))],
    )

    def limit(value: Any, least: float, most: float) -> None:
        g.append(ca.vec(value))
        low.append(np.full(g[-1].numel(), least))
        high.append(np.full(g[-1].numel(), most))

    v, a, t, j = (z[i, :] for i in range(4))
    ds, T, J = np.diff(s)[None], t[:, :K], j[:, :K]
    limit((T * (v[:, :K] + T * (0.5 * a[:, :K] + T * J / 6.0)) - ds) / ds, 0.0, 0.0)
    limit((v[:, :K] + T * (a[:, :K] + 0.5 * T * J) - v[:, 1:]) / (length / time), 0.0, 0.0)
    limit((a[:, :K] + T * J - a[:, 1:]) / (length / time**2), 0.0, 0.0)
    q1, q2, q3 = (q[n * m : n * (m + 1), :] for m in (1, 2, 3))
    rows = {name: ca.repmat(ca.DM(limits[name]), 1, K + 1) for name in ("velocity", "acceleration", "jerk")}
    V, A = ca.repmat(v, n, 1), ca.repmat(a, n, 1)
    limit(q1 * V / rows["velocity"], -1.0, 1.0)
    limit((q1 * A + q2 * V * V) / rows["acceleration"], -1.0, 1.0)
    for first in (0, 1):
        at = slice(first, K + first)
        third = q1[:, at] * ca.repmat(J, n, 1) + 3.0 * q2[:, at] * V[:, at] * A[:, at] + q3[:, at] * V[:, at] ** 3
        limit(third / rows["jerk"][:, :K], -1.0, 1.0)
    for column, radius in choice.bounds.discs:
        limit((p[column, :] ** 2 + p[column + 1, :] ** 2) / radius**2, -1.0, 1.0)
    free = choice.programme.window.free.reshape(C, D)
    lower, upper = (np.where(free, bound, choice.p) for bound in (choice.bounds.lower, choice.bounds.upper))
    least = np.tile([0.0, -np.inf, 0.0, -np.inf], (K + 1, 1))
    most = np.tile([np.inf, np.inf, np.inf, np.inf], (K + 1, 1))
    least[[0, -1], :2] = most[[0, -1], :2] = 0.0
    least[:K, 2] = 1e-3 * z0[:K, 2]
    least[K, 2:] = most[K, 2:] = 0.0
    z0 = z0.copy()
    z0[K, 2:] = 0.0
    ranges = np.full((2, K + 1, n * ORDERS), np.inf)
    ranges[0] *= -1.0
    if choice.parts[3] is not None:
        ranges[0, :, :n], ranges[1, :, :n] = robot.limits.lower, robot.limits.upper
    unknowns = ca.vertcat(ca.vec(z), ca.vec(p), ca.vec(q))
    q0 = q0.transpose(1, 0, 2).reshape(K + 1, -1)
    near = {} if start is None else {"mu_init": 1e-7, "bound_push": 1e-9, "bound_frac": 1e-9, "slack_bound_push": 1e-9}
    solver = ca.nlpsol("together", "ipopt", {"x": unknowns, "f": ca.sum2(T) / time, "g": ca.vertcat(*g)}, {
        "print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8, "max_iter": 1000, **near},
    })  # fmt: skip
    answer = solver(
        x0=np.concatenate([z0.ravel(), p0.ravel(), q0.ravel()]),
        lbx=np.concatenate([least.ravel(), lower.ravel(), ranges[0].ravel()]),
        ubx=np.concatenate([most.ravel(), upper.ravel(), ranges[1].ravel()]),
        lbg=np.concatenate(low), ubg=np.concatenate(high),
    )  # fmt: skip
    x, stats = np.asarray(answer["x"]).ravel(), solver.stats()
    found = x[4 * (K + 1) : 4 * (K + 1) + C * D].reshape(C, D)
    return Joint(float(answer["f"]) * time, found, int(stats["iter_count"]), bool(stats["success"]))
