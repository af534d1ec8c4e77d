"""Rotation along a path: about a fixed axis at constant rate, by the shortest turn; half turns raise an error."""

from __future__ import annotations

from math import degrees, pi

import numpy as np

from optik import se3
from optik.errors import InvalidInput
from optik.types import Array

NO_LENGTH = 1e-12
"""Chords [m] and angles [rad] below this are rounding: poses of an arm of a metre have errors of 1e-16."""

HALF_TURN = 1e-6
"""Nearer to 180° than this [rad], the direction of the shortest turn depends on rounding and measuring errors."""


def shortest_turn(start: Array, goal: Array, argument: str) -> Array:
    """Return the shortest rotation from one pose to another."""
    turn = se3.log_so3(goal[:3, :3] @ start[:3, :3].T)
    angle = float(np.linalg.norm(turn))
    if angle > pi - HALF_TURN:
        raise InvalidInput(
            argument,
            f"a turn of {degrees(angle):.6f}°, which is equally short in both directions",
            "a turn of less than 180° from the previous pose: add a pose between the two (Polyline), give the axis "
            "(Arc.about), or turn 0.001 rad less",
        )
    return turn


def rotations_along(R: Array, w: Array, s: Array) -> Array:
    """Return the rotations exp(s w) R along a path that turns at a constant rate."""
    if not w.any():
        return np.broadcast_to(R, (s.size, 3, 3))
    return (se3.exp_so3(s[:, None] * w).reshape(-1, 3) @ R).reshape(-1, 3, 3)


def make_poses(R: Array, p: Array) -> Array:
    """Return the poses of rotations and positions."""
    out = np.zeros((len(p), 4, 4))
    out[:, :3, :3], out[:, :3, 3], out[:, 3, 3] = R, p, 1.0
    return out


def skew_vector(M: Array) -> Array:
    """Return twice the vectors of the skew parts of matrices: 2 sin φ · axis for a rotation by φ."""
    return np.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], axis=1)


def angle_about(axis: Array, R: Array) -> Array:
    """Return the angles about an axis whose rotations are nearest to the given ones.

    tr(exp(−θ n) R) = nᵀRn + cos θ (tr R − nᵀRn) + sin θ n·vec R is greatest there.
    """
    cosine = np.einsum("kii->k", R) - np.einsum("i,kij,j->k", axis, R, axis)
    return np.asarray(np.arctan2(skew_vector(R) @ axis, cosine))


def rotation_derivative_norms(w: Array, w1: Array, w2: Array) -> Array:
    """Return the norms of R', R'', R''' by R' = ω×R and the product rule; R itself has norm 1."""
    A, A1, A2 = (_skew(v) for v in (w, w1, w2))
    second = A1 + A @ A
    third = A2 + 2.0 * A1 @ A + A @ A1 + A @ A @ A
    return np.stack([np.linalg.norm(M, ord=2, axis=(1, 2)) for M in (A, second, third)], axis=1)


def _skew(w: Array) -> Array:
    out = np.zeros((len(w), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = w.T
    return out - np.swapaxes(out, 1, 2)
