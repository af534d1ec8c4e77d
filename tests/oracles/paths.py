"""Paths: a line's poses and the joints' derivatives along it, any path's rotation, and the place nearest to a pose."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tests.oracles.kinematics import fk_series, jacobian, met, times
from tests.oracles.poses import crossing, error, off_by, vee

Array = Any
TERMS = 4


def line_pose(start: Array, goal: Array, u: float) -> Array:
    """Pose at the part u of a line: position straight, rotation by SciPy's Slerp."""
    T = np.eye(4)
    T[:3, 3] = (1 - u) * start[:3, 3] + u * goal[:3, 3]
    T[:3, :3] = Slerp([0, 1], Rotation.from_matrix([start[:3, :3], goal[:3, :3]]))(u).as_matrix()
    return T


def off_line(start: Array, goal: Array, T: Array) -> tuple[float, float]:
    """Distance from a pose to a line with a chord, and the angle to the line's rotation at the nearest place."""
    chord = goal[:3, 3] - start[:3, 3]
    u = float(np.clip((T[:3, 3] - start[:3, 3]) @ chord / (chord @ chord), 0.0, 1.0))
    return off_by(T, line_pose(start, goal, u))


def pose_series(start: Array, goal: Array, s: float, end: float) -> Array:
    """Pose at s + ε on the line from start to goal as a power series in ε."""
    e = error(start, goal) / end
    w = crossing(e[3:])
    out = np.zeros((TERMS, 4, 4))
    out[0] = np.eye(4)
    out[0, :3, 3] = start[:3, 3] + s * e[:3]
    out[1, :3, 3] = e[:3]
    power = Rotation.from_rotvec(s * e[3:]).as_matrix() @ start[:3, :3]
    for k in range(TERMS):
        out[k, :3, :3] = power
        power = w @ power / (k + 1)
    return out


def derivatives_along(arm: Any, start: Array, goal: Array, s: float, end: float, guess: Array) -> Array:
    """Derivatives of order 0 to 3 (4, n) of the configuration that follows the line, by Newton on power series."""
    target = pose_series(start, goal, s, end)
    at = np.eye(4)
    at[:3] = target[0][:3]
    q = np.zeros((TERMS, len(guess)))
    q[0] = met(arm, at, guess)
    J = jacobian(arm, q[0])
    for _ in range(12):
        T = fk_series(arm, q)
        turn = times(target[:, :3, :3], np.swapaxes(T[:, :3, :3], 1, 2))
        e = np.concatenate([(target - T)[:, :3, 3], vee(turn)], axis=1)  # vanishes together with the rotation vector
        q += np.linalg.solve(J, e.T).T
    return q * np.array([1.0, 1.0, 2.0, 6.0])[:, None]


def rotation_derivatives(path: Any, s: Array) -> list[Array]:
    """Rotations (k, 3, 3) of a path and their first three derivatives, from its twists, by R' = ω× R and the product rule."""
    R = path.pose(s)[:, :3, :3]
    w, w1, w2 = (crossing(path.twist(s, k)[:, 3:]) for k in (1, 2, 3))
    return [R, w @ R, (w1 + w @ w) @ R, (w2 + 2.0 * w1 @ w + w @ w1 + w @ w @ w) @ R]


def nearest(path: Any, T: Array, low: Array, high: Array, weight: float) -> tuple[Array, Array]:
    """Places (k,) between low and high least apart from poses, a radian counted as so many metres; and how far apart."""

    def cost(s: Array) -> Array:
        distance, angle = off_by(T, path.pose(s))
        return np.hypot(distance, weight * angle)

    grid = np.stack([cost(low + (high - low) * x) for x in np.linspace(0.0, 1.0, 25)])
    k, step = grid.argmin(axis=0), (high - low) / 24.0
    a, b = low + step * np.maximum(k - 1, 0), low + step * np.minimum(k + 1, 24)
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(60):
        c, d = b - golden * (b - a), a + golden * (b - a)
        left = cost(c) < cost(d)
        a, b = np.where(left, a, c), np.where(left, d, b)
    s = 0.5 * (a + b)
    return s, cost(s)
