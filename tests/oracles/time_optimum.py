"""The jerk- and torque-limited time optimum by a plain programme for IPOPT: no wit, and another library's dynamics."""

from typing import Any

import casadi as ca
import numpy as np

from tests.oracles.torques import Torques

Array = Any


def path_torques(torques: Torques, joint_path: Any, s: Array) -> tuple[Array, Array, Array]:
    """p, c and g (k, n) of τ = p s̈ + c ṡ² + g at places of a joint path, without friction."""
    q, q1, q2 = (joint_path(s, order) for order in range(3))
    g = np.array([torques.torque(at, 0.0 * at, 0.0 * at) for at in q])
    p = np.array([torques.torque(at, 0.0 * at, slope) for at, slope in zip(q, q1, strict=True)])
    c = np.array([torques.torque(at, slope, bend) for at, slope, bend in zip(q, q1, q2, strict=True)])
    return p - g, c - g - torques.viscous * q1, g


def path_rates(torques: Torques, joint_path: Any, s: Array, apart: float) -> tuple[Array, Array, Array]:
    """Derivatives of p, c and g in s, by central differences of the fourth order."""
    beside = [path_torques(torques, joint_path, s + k * apart) for k in (-2, -1, 1, 2)]
    p, c, g = ((b[0] - 8.0 * b[1] + 8.0 * b[2] - b[3]) / (12.0 * apart) for b in zip(*beside, strict=True))
    return p, c, g


def best_duration(joint_path: Any, limits: Any, load: Any = None, K: int = 80) -> float:
    """Least duration; limits on velocity, acceleration, jerk, and with a load on torque and torque rate, (n,) each.

    Infinite limits are free. It keeps its limits at its places only, which stand equally spaced in the root of a quintic.
    """
    velocity, acceleration, jerk, *loaded = limits
    u = np.linspace(0.0, 1.0, K + 1)
    s = joint_path.end * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
    q1, q2, q3 = (joint_path(s, order) for order in (1, 2, 3))
    if load is not None:
        torque, rate = loaded
        torques = Torques(joint_path.robot.fixed, joint_path.robot.prismatic, load)
        viscous, coulomb = load.viscous, load.coulomb
        p, c, g = path_torques(torques, joint_path, s)
        inside = np.clip(s, 2e-4 * joint_path.end, (1.0 - 2e-4) * joint_path.end)
        dp, dc, dg = path_rates(torques, joint_path, inside, 1e-4 * joint_path.end)
    v, a, tau, j = ca.SX.sym("v", K + 1), ca.SX.sym("a", K + 1), ca.SX.sym("t", K), ca.SX.sym("j", K)
    rows: list[Any] = [v[0], a[0], v[K], a[K]]
    low, high = [0.0] * 4, [0.0] * 4

    def keep(value: Any, least: float, most: float) -> None:
        if np.isfinite([least, most]).any():
            rows.append(value / most)
            low.append(least / most)
            high.append(1.0)

    for k in range(K):
        t = tau[k]
        rows += [
            v[k] * t + a[k] * t**2 / 2 + j[k] * t**3 / 6 - (s[k + 1] - s[k]),
            v[k] + a[k] * t + j[k] * t**2 / 2 - v[k + 1],
            a[k] + j[k] * t - a[k + 1],
        ]
        low, high = low + [0.0] * 3, high + [0.0] * 3
        for i in range(q1.shape[1]):
            for e in (k, k + 1):
                keep(q1[e, i] * j[k] + 3 * q2[e, i] * v[e] * a[e] + q3[e, i] * v[e] ** 3, -jerk[i], jerk[i])
                if load is None:
                    continue
                turning = (
                    p[e, i] * j[k] + (dp[e, i] + 2 * c[e, i]) * v[e] * a[e] + dc[e, i] * v[e] ** 3 + dg[e, i] * v[e]
                )
                turning += viscous[i] * (q1[e, i] * a[e] + q2[e, i] * v[e] ** 2)
                keep(turning, -rate[i], rate[i])
            keep(q1[k, i] * v[k], -velocity[i], velocity[i])
            keep(q1[k, i] * a[k] + q2[k, i] * v[k] ** 2, -acceleration[i], acceleration[i])
            if load is not None and k > 0:
                drive = p[k, i] * a[k] + c[k, i] * v[k] ** 2 + viscous[i] * q1[k, i] * v[k] + g[k, i]
                drive += coulomb[i] * np.sign(q1[k, i])
                keep(drive, -torque[i], torque[i])
    x = ca.vertcat(v, a, tau, j)
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-8, "ipopt.mu_init": 1e-2}
    solver = ca.nlpsol("best", "ipopt", {"x": x, "f": ca.sum1(tau), "g": ca.vertcat(*rows)}, options)
    T = 4.0
    speed = joint_path.end / T * (30.0 * u**2 - 60.0 * u**3 + 30.0 * u**4)
    start = np.concatenate([speed, np.zeros(K + 1), np.full(K, T / K), np.zeros(K)])
    lower = np.concatenate([np.zeros(K + 1), np.full(K + 1, -np.inf), np.full(K, 1e-6), np.full(K, -np.inf)])
    found = solver(x0=start, lbx=lower, lbg=low, ubg=high)
    assert solver.stats()["success"]
    return float(found["f"])
