"""Poses: elementary ones from sines and cosines, all that needs a logarithm of a rotation by SciPy."""

from collections.abc import Iterable, Sequence
from math import cos, sin
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = Any


def rot_x(angle: float) -> Array:
    return np.array([[1, 0, 0, 0], [0, cos(angle), -sin(angle), 0], [0, sin(angle), cos(angle), 0], [0, 0, 0, 1.0]])


def rot_z(angle: float) -> Array:
    return np.array([[cos(angle), -sin(angle), 0, 0], [sin(angle), cos(angle), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def trans(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    return np.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def pose(rotvec: Iterable[float], position: Iterable[float]) -> Array:
    """Pose from a rotation vector and a position."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(list(rotvec)).as_matrix()
    T[:3, 3] = list(position)
    return T


def random_pose(rng: np.random.Generator) -> Array:
    """Any rotation, and a position in a cube of two metres."""
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    T[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return T


def moved(T: Array, move: Array, turn: Array | None = None) -> Array:
    """The pose moved and turned in the base frame."""
    out = T.copy()
    out[:3, 3] += move
    if turn is not None:
        out[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ out[:3, :3]
    return out


def vee(W: Array) -> Array:
    """Vectors (..., 3) of the skew parts of W (..., 3, 3)."""
    return 0.5 * np.stack(
        [W[..., 2, 1] - W[..., 1, 2], W[..., 0, 2] - W[..., 2, 0], W[..., 1, 0] - W[..., 0, 1]], axis=-1
    )


def crossing(w: Array) -> Array:
    """Matrices (..., 3, 3) of ω×."""
    out = np.zeros((*w.shape, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = np.moveaxis(w, -1, 0)
    return out - np.swapaxes(out, -1, -2)


def error(T: Array, target: Array) -> Array:
    """(p_t − p, log(R_t Rᵀ)) (..., 6) in the base frame."""
    R = target[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2)
    turn = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])
    return np.concatenate([target[..., :3, 3] - T[..., :3, 3], turn], axis=-1)


def off_by(T: Array, target: Array) -> tuple[Array, Array]:
    """Distances [m] and angles [rad] (...) between poses (..., 4, 4)."""
    e = error(T, target)
    return np.linalg.norm(e[..., :3], axis=-1), np.linalg.norm(e[..., 3:], axis=-1)


def task_off_by(T: Array, target: Array, mask: Sequence[int], frame: str) -> tuple[float, float]:
    """How far T is from what a mask asks of the target: length and angle of the components that count.

    A lone free rotation leaves the angle between the tool's axis and the target's (in the base's frame: between the
    base axis as carried along by R R_tᵀ and itself).
    """
    R, R_t = T[:3, :3], target[:3, :3]
    axes = R_t if frame == "target" else np.eye(3)
    p = axes.T @ (target[:3, 3] - T[:3, 3])
    free = [k for k in range(3) if not mask[3 + k]]
    if len(free) == 1:
        moving, wanted = (R, R_t) if frame == "target" else (R @ R_t.T, np.eye(3))
        a, b = moving[:, free[0]], wanted[:, free[0]]
        angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    else:
        turn = Rotation.from_matrix(R_t.T @ R if frame == "target" else R @ R_t.T).as_rotvec()
        angle = float(np.linalg.norm(turn * np.array(mask[3:])))
    return float(np.linalg.norm(p * np.array(mask[:3]))), angle
