"""Rotation along a path: about a fixed axis at constant rate, the shortest way; half turns are refused."""

from __future__ import annotations

from math import degrees, pi

import numpy as np

from optik import se3
from optik.errors import InvalidInput
from optik.types import Array

NO_MOTION = 1e-12
"""Chords [m] and angles [rad] below this are rounding, not motion."""

HALF_TURN = 1e-6
"""Nearer to 180° than this [rad], the way round hangs on how the poses were rounded or measured."""


def shortest_turn(start: Array, goal: Array, argument: str) -> Array:
    """Rotation vector (3,) [rad] in the base frame that turns one pose (4, 4) into another the shortest way.

    Raises
    ------
    InvalidInput
        A half turn, to which two ways are equally short.
    """
    turn = se3.log_so3(goal[:3, :3] @ start[:3, :3].T)
    angle = float(np.linalg.norm(turn))
    if angle > pi - HALF_TURN:
        raise InvalidInput(
            argument,
            f"a turn of {degrees(angle):.6f}°, which is as short the other way round",
            "a turn of less than 180° from the pose before: say which way round by a pose between the two (Polyline) or "
            "by the axis (Arc.about), or turn 0.001 rad less",
        )
    return turn


def turned(R: Array, w: Array, s: Array) -> Array:
    """Rotations exp(s w) R (k, 3, 3) of a rotation (3, 3) that turns with w (3,) at places s (k,)."""
    if not w.any():
        return np.broadcast_to(R, (s.size, 3, 3))
    return (se3.exp_so3(s[:, None] * w).reshape(-1, 3) @ R).reshape(-1, 3, 3)


def poses(R: Array, p: Array) -> Array:
    """Poses (k, 4, 4) of rotations (k, 3, 3) and positions (k, 3)."""
    out = np.zeros((len(p), 4, 4))
    out[:, :3, :3], out[:, :3, 3], out[:, 3, 3] = R, p, 1.0
    return out


def vector_of(M: Array) -> Array:
    """Vectors (k, 3) of the skew parts of matrices (k, 3, 3): 2 sin φ · axis, of a rotation by φ."""
    return np.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], axis=1)


def angle_about(axis: Array, R: Array) -> Array:
    """Angles (k,) in [−π, π] about a unit axis (3,) whose rotations are nearest to R (k, 3, 3).

    tr(exp(−θ n) R) = nᵀRn + cos θ (tr R − nᵀRn) + sin θ n·vec R is greatest there.
    """
    cosine = np.einsum("kii->k", R) - np.einsum("i,kij,j->k", axis, R, axis)
    return np.asarray(np.arctan2(vector_of(R) @ axis, cosine))


def turning(w: Array, w1: Array, w2: Array) -> Array:
    """Norms (k, 3) of R', R'', R''' where ω, ω', ω'' are (k, 3): R' = ω×R and the product rule; R itself has norm 1."""
    A, A1, A2 = (_crossing(v) for v in (w, w1, w2))
    second = A1 + A @ A
    third = A2 + 2.0 * A1 @ A + A @ A1 + A @ A @ A
    return np.stack([np.linalg.norm(M, ord=2, axis=(1, 2)) for M in (A, second, third)], axis=1)


def _crossing(w: Array) -> Array:
    out = np.zeros((len(w), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = w.T
    return out - np.swapaxes(out, 1, 2)
