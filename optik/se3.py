"""Poses as 4×4 arrays: error, logarithm, exponential, interpolation and checks.

Conventions: ``T_ab`` maps coordinates of frame b into frame a; twists are (v, ω), linear first; metres and radians.
"""

from __future__ import annotations

from math import atan2, pi, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_keywords, finite_array, real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.types import Array

ROTATION_TOLERANCE = 1e-6
"""Largest |RᵀR − I| of an accepted rotation matrix [1]: measured poses have 1e-7 of noise."""
FARTHEST = 1e6
"""Largest coordinate of an accepted position [m]: squares of larger ones lose millimetres."""
QUATERNION_ERROR = 1e-2
"""Largest difference of a quaternion's length from 1 [1], for values with three digits."""
LAST_ROW_TOLERANCE = 1e-9
"""Largest difference of a pose's last row from (0, 0, 0, 1) [1]."""


# ---------------------------------------------------------------- compiled, on plain arrays


@compiled
def log_rotation(R: Array, out: Array) -> None:
    """Write the rotation vector of a rotation matrix.

    It is computed from the unit quaternion, by its largest component (Shepperd 1978): exact to rounding near 0 and near
    π, where arccos((trace − 1)/2) loses half the digits.

    Parameters
    ----------
    R : (3, 3) array
        Rotation matrix [1].
    out : (3,) array
        Written: axis times angle [rad], the angle in [0, π].
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > R[0, 0] and trace > R[1, 1] and trace > R[2, 2]:
        w = 1.0 + trace
        x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        x = 1.0 + R[0, 0] - R[1, 1] - R[2, 2]
        w, y, z = R[2, 1] - R[1, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]
    elif R[1, 1] >= R[2, 2]:
        y = 1.0 - R[0, 0] + R[1, 1] - R[2, 2]
        w, x, z = R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], R[1, 2] + R[2, 1]
    else:
        z = 1.0 - R[0, 0] - R[1, 1] + R[2, 2]
        w, x, y = R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    if w < 0.0:  # the quaternion whose angle is at most π
        w, x, y, z = -w, -x, -y, -z
    norm = sqrt(x * x + y * y + z * z)
    # angle / |v|, accurate for small |v|
    scale = 2.0 * atan2(norm, w) / norm if norm > 0.0 else 0.0
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@compiled
def exp_rotation(w: Array, R: Array) -> None:
    """Write the rotation matrix of a rotation vector, by Rodrigues' formula, or its series near 0.

    Parameters
    ----------
    w : (3,) array
        Axis times angle [rad].
    R : (3, 3) array
        Written: the rotation matrix [1].
    """
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    if angle2 < 1e-8:  # the next terms are below 1e-18
        a = 1.0 - angle2 / 6.0
        b = 0.5 - angle2 / 24.0
    else:
        angle = sqrt(angle2)
        a = sin(angle) / angle
        half = sin(0.5 * angle) / angle
        b = 2.0 * half * half
    c = 1.0 - b * angle2
    R[0, 0] = c + b * w[0] * w[0]
    R[1, 1] = c + b * w[1] * w[1]
    R[2, 2] = c + b * w[2] * w[2]
    R[0, 1] = b * w[0] * w[1] - a * w[2]
    R[1, 0] = b * w[0] * w[1] + a * w[2]
    R[0, 2] = b * w[0] * w[2] + a * w[1]
    R[2, 0] = b * w[0] * w[2] - a * w[1]
    R[1, 2] = b * w[1] * w[2] - a * w[0]
    R[2, 1] = b * w[1] * w[2] + a * w[0]


@compiled
def pose_error(T: Array, target: Array, out: Array) -> None:
    """Write the error twist (p_t − p, log(R_t Rᵀ)) in the base frame from a pose to a target; eq. 8–10, eq. 9 corrected.

    Parameters
    ----------
    T : (4, 4) array
        Pose [1, m].
    target : (4, 4) array
        Pose to be reached [1, m].
    out : (6,) array
        Written: position [m], then rotation [rad].
    """
    relative = np.empty((3, 3))
    for i in range(3):
        out[i] = target[i, 3] - T[i, 3]
        for j in range(3):
            relative[i, j] = target[i, 0] * T[j, 0] + target[i, 1] * T[j, 1] + target[i, 2] * T[j, 2]
    log_rotation(relative, out[3:])


@compiled
def is_pose(T: Array) -> bool:
    """Return whether a matrix is a pose, within `FARTHEST`, `LAST_ROW_TOLERANCE` and `ROTATION_TOLERANCE`.

    Parameters
    ----------
    T : (4, 4) array
        The matrix [1, m].

    Returns
    -------
    bool
        False for NaN and for a reflection.
    """
    for j in range(4):
        if not abs(T[3, j] - (1.0 if j == 3 else 0.0)) <= LAST_ROW_TOLERANCE:
            return False
    for i in range(3):
        if not abs(T[i, 3]) <= FARTHEST:
            return False
        for j in range(i + 1):
            dot = T[0, i] * T[0, j] + T[1, i] * T[1, j] + T[2, i] * T[2, j]
            if not abs(dot - (1.0 if i == j else 0.0)) <= ROTATION_TOLERANCE:
                return False
    det = (
        T[0, 0] * (T[1, 1] * T[2, 2] - T[1, 2] * T[2, 1])
        - T[0, 1] * (T[1, 0] * T[2, 2] - T[1, 2] * T[2, 0])
        + T[0, 2] * (T[1, 0] * T[2, 1] - T[1, 1] * T[2, 0])
    )
    return bool(det > 0.0)


@compiled
def _log_many(R: Array, out: Array) -> None:
    for i in range(R.shape[0]):
        log_rotation(R[i], out[i])


@compiled
def _exp_many(w: Array, out: Array) -> None:
    for i in range(w.shape[0]):
        exp_rotation(w[i], out[i])


# ---------------------------------------------------------------- public, any leading shape


def log_so3(R: ArrayLike) -> Array:
    """Return the rotation vectors of rotation matrices.

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices [1].

    Returns
    -------
    (..., 3) array
        Axis times angle [rad], the angle in [0, π]. At exactly π both signs of the axis are correct.
    """
    R = np.ascontiguousarray(R, dtype=np.float64)
    out = np.empty(R.shape[:-1])
    _log_many(R.reshape(-1, 3, 3), out.reshape(-1, 3))
    return out


def exp_so3(w: ArrayLike) -> Array:
    """Return the rotation matrices of rotation vectors.

    Parameters
    ----------
    w : (..., 3) array
        Axis times angle [rad].

    Returns
    -------
    (..., 3, 3) array
        Rotation matrices [1].
    """
    w = real_array(w, "w", "rotation vectors (..., 3)", (..., 3))
    out = np.empty((*w.shape, 3))
    _exp_many(w.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out


@check_keywords
def pose(R: ArrayLike | None = None, p: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return the pose of a rotation and a position.

    Parameters
    ----------
    R : (3, 3) array, optional
        Rotation matrix [1]; the identity by default. From angles: ``from_xyz_rpy(xyz, rpy_deg)``.
    p : (3,) array
        Position [m].

    Returns
    -------
    (4, 4) array
        The pose [1, m].

    Raises
    ------
    InvalidInput
        Another shape, or no numbers.
    """
    T = np.eye(4)
    if R is not None:
        T[:3, :3] = finite_array(R, "R", "finite numbers of shape (3, 3); pose(p=...) for a position", (3, 3))
    T[:3, 3] = finite_array(p, "p", "finite numbers of shape (3,)", (3,))
    return T


def nearest_pose(T: Array) -> Array:
    """Return a pose with the rotation nearest to its 3×3 part, in the Frobenius norm.

    Parameters
    ----------
    T : (4, 4) array
        Pose whose 3×3 part is nearly a rotation [1, m].

    Returns
    -------
    (4, 4) array
        The pose [1, m]; ``T`` itself if its 3×3 part is a rotation to rounding.

    Raises
    ------
    InvalidInput
        Another shape, or no numbers.
    """
    R = real_array(T, "T", "a pose (4, 4)", (4, 4))[:3, :3]
    if np.abs(R.T @ R - np.eye(3)).max() <= 1e-14:
        return T
    u, _, vt = np.linalg.svd(R)
    return pose(u @ vt, T[:3, 3])


def inverse(T: Array) -> Array:
    """Return the inverse of poses.

    Parameters
    ----------
    T : (..., 4, 4) array
        Poses [1, m].

    Returns
    -------
    (..., 4, 4) array
        Poses whose product with ``T`` is the identity [1, m].
    """
    out = np.zeros_like(T)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = Rt
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", Rt, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def error(T: Array, target: Array) -> Array:
    """Return the error twists (p_t − p, log(R_t Rᵀ)) from poses to targets (paper eq. 8–10, sign of eq. 9 corrected).

    Parameters
    ----------
    T : (..., 4, 4) array
        Poses [1, m].
    target : (..., 4, 4) array
        Poses to be reached [1, m].

    Returns
    -------
    (..., 6) array
        Position [m], then rotation vector [rad].
    """
    T, target = (real_array(x, name, "poses (..., 4, 4)", (..., 4, 4)) for x, name in ((T, "T"), (target, "target")))
    R = target[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2)
    return np.concatenate([target[..., :3, 3] - T[..., :3, 3], log_so3(R)], axis=-1)


def interpolate(start: Array, goal: Array, u: ArrayLike) -> Array:
    """Interpolate two poses: the position linearly, the rotation about a fixed axis by the smallest angle.

    Parameters
    ----------
    start : (4, 4) array
        Pose at u = 0 [1, m].
    goal : (4, 4) array
        Pose at u = 1 [1, m].
    u : scalar or (k,) array
        Fraction [1]; not limited to [0, 1].

    Returns
    -------
    (4, 4) or (k, 4, 4) array
        Poses [1, m].
    """
    u = np.asarray(u, dtype=np.float64)
    e = error(start, goal)
    out = np.zeros((*u.shape, 4, 4))
    out[..., :3, :3] = exp_so3(u[..., None] * e[3:]) @ start[:3, :3]
    out[..., :3, 3] = start[:3, 3] + u[..., None] * e[:3]
    out[..., 3, 3] = 1.0
    return out


def check_pose(T: ArrayLike, argument: str) -> Array:
    """Check a pose, and return it as a float64 array.

    Parameters
    ----------
    T : (4, 4) array
        Pose [1, m].
    argument : str
        Name of the argument, for the error.

    Returns
    -------
    (4, 4) array
        The pose [1, m].

    Raises
    ------
    InvalidInput
        Wrong shape, NaN or infinity, last row not (0, 0, 0, 1), |RᵀR − I| above 1e-6, or a reflection.
    """
    T = real_array(T, argument, "a (4, 4) array of numbers")
    if T.shape == (4, 4) and is_pose(T):
        return T
    if T.shape != (4, 4):
        hint = "; for a rotation matrix use optik.se3.pose(R, p)" if T.shape == (3, 3) else ""
        raise InvalidInput(argument, f"shape {T.shape}{hint}", "a pose of shape (4, 4)")
    if not np.isfinite(T).all():
        raise InvalidInput(argument, "NaN or infinity", "a pose of finite numbers")
    if np.abs(T[:3, 3]).max() > FARTHEST:
        raise InvalidInput(argument, f"a position {np.abs(T[:3, 3]).max():.3g} m away", "a position within 1e6 m")
    if np.abs(T[:3, :3]).max() > 2.0:
        raise InvalidInput(argument, f"{np.abs(T[:3, :3]).max():.3g} in its 3×3 part", "a rotation (entries within ±1)")
    if np.abs(T[3] - (0.0, 0.0, 0.0, 1.0)).max() > LAST_ROW_TOLERANCE:
        raise InvalidInput(argument, f"last row {T[3].tolist()}", "the last row (0, 0, 0, 1)")
    R = T[:3, :3]
    off = float(np.abs(R.T @ R - np.eye(3)).max())
    if off > ROTATION_TOLERANCE:
        raise InvalidInput(argument, f"a 3×3 part with |RᵀR − I| = {off:.2g}", "a rotation (|RᵀR − I| ≤ 1e-6)")
    raise InvalidInput(argument, "a reflection (det R = −1)", "a rotation (det R = +1)")


def from_xyz_rpy(xyz: ArrayLike, rpy_deg: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return the pose of a position and roll, pitch and yaw, R = Rz(yaw) Ry(pitch) Rx(roll) as in URDF.

    Parameters
    ----------
    xyz : (3,) array
        Position [m].
    rpy_deg : (3,) array
        Roll, pitch and yaw [°].

    Returns
    -------
    (4, 4) array
        The pose [1, m].
    """
    roll, pitch, yaw = np.asarray(rpy_deg, dtype=np.float64) * (pi / 180.0)
    Rx = exp_so3([roll, 0.0, 0.0])
    Ry = exp_so3([0.0, pitch, 0.0])
    Rz = exp_so3([0.0, 0.0, yaw])
    return pose(Rz @ Ry @ Rx, xyz)


def quaternion(R: Array) -> Array:
    """Return the unit quaternion of a rotation, exact to rounding for every rotation.

    Parameters
    ----------
    R : (3, 3) array
        The rotation [1].

    Returns
    -------
    (4,) array
        w, x, y, z [1].
    """
    # Each row is a multiple of the quaternion; the longest row loses no digits.
    x, y, z = R.T
    trace = x[0] + y[1] + z[2]
    multiples = np.array(
        [
            [1.0 + trace, y[2] - z[1], z[0] - x[2], x[1] - y[0]],
            [y[2] - z[1], 1.0 - trace + 2.0 * x[0], x[1] + y[0], z[0] + x[2]],
            [z[0] - x[2], x[1] + y[0], 1.0 - trace + 2.0 * y[1], y[2] + z[1]],
            [x[1] - y[0], z[0] + x[2], y[2] + z[1], 1.0 - trace + 2.0 * z[2]],
        ]
    )
    longest = multiples[int(np.argmax(np.diag(multiples)))]
    return np.asarray(longest / np.linalg.norm(longest))


def from_quaternion(wxyz: ArrayLike, argument: str = "quaternion") -> Array:
    """Return the rotation of a quaternion, which is normalised.

    Parameters
    ----------
    wxyz : (4,) array
        w, x, y, z [1].
    argument : str
        Name of the argument, for the error.

    Returns
    -------
    (3, 3) array
        The rotation [1].

    Raises
    ------
    InvalidInput
        Not four numbers, or a length that is not 1 within `QUATERNION_ERROR`.
    """
    q = real_array(wxyz, argument, "a unit quaternion w,x,y,z")
    with np.errstate(over="ignore"):
        size = float(np.linalg.norm(q))
    if q.shape != (4,) or not abs(size - 1.0) <= QUATERNION_ERROR:
        raise InvalidInput(argument, f"{q.tolist()} of length {size:.6g}", "a unit quaternion w,x,y,z")
    w, x, y, z = q / size
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
