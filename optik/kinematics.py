"""Forward kinematics, Jacobian and their derivatives, for one configuration or a batch.

The first argument of a kernel is the arm, a `Chain`. The transform from joint frame i − 1 to joint frame i is fixed_i
followed by Rot(z, q_i), or by Trans(z, q_i) for a prismatic joint. Outputs are written into the caller's arrays.

Arrays that belong together are passed from Python to a kernel as a plain tuple, which costs nothing (a call takes 0.65 µs);
a NamedTuple, whose type Numba determines at every call, costs 0.85 µs. `frames`, `tool_pose` and `jacobian_from` call no
other kernel, because counting references around a call takes 5 to 10 % of an iteration.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np

from optik.compiled import compiled, inlined
from optik.linear import smallest_singular_value
from optik.se3 import pose_error
from optik.types import Array

Triple = tuple[float, float, float]

Chain = tuple[Any, ...]
"""An arm as kernels take it: fixed (n, 4, 4), the transforms [1, m] from the joint before (the base, for the first) to
each joint at q = 0; prismatic (n,), flags of prismatic joints; tool (4, 4), the transform from the last joint to the tool.

That of a linkage has N axes for n joints, and a fourth array (N, 3): joint k, factor and offset of each axis, whose value is
factor · q_k + offset. Its kernels are compiled apart, as ``len(chain)`` is constant in each. Kernels that unpack three arrays
take the chain of `ArmModel.axes`, and values of the axes."""
Range = tuple[Array, Array]
"""Position limits, or bounds of an iteration, as kernels take them: lower (n,) and upper (n,) [rad, m]."""


@inlined
def axis_of(chain: Chain, i: int) -> tuple[int, float]:
    """Return the joint that axis i of a chain follows, and the factor [1]."""
    if len(chain) == 3:
        return i, 1.0
    return int(chain[3][i, 0]), chain[3][i, 1]


@inlined
def turns_whole(chain: Chain, i: int) -> bool:
    """Return whether whole turns of joint i leave all links in place."""
    if len(chain) == 3:
        return not chain[1][i]
    for k in range(chain[0].shape[0]):
        if chain[3][k, 0] == i and (chain[1][k] or chain[3][k, 1] != round(chain[3][k, 1])):
            return False
    return True


@compiled
def frames(chain: Chain, q: Array, out: Array) -> None:
    """Write the pose of every axis frame, after the axis's own motion.

    Shapes and units: q (n,) [rad, m], out (N, 4, 4) [1, m] (overwritten).
    """
    fixed, prismatic = chain[0], chain[1]
    for i in range(q.shape[0] if len(chain) == 3 else fixed.shape[0]):
        value = q[i] if len(chain) == 3 else chain[3][i, 1] * q[int(chain[3][i, 0])] + chain[3][i, 2]
        t, c, s = fixed[i], cos(value), sin(value)
        for r in range(3):
            if i == 0:
                x, y, z, p = t[r, 0], t[r, 1], t[r, 2], t[r, 3]
            else:
                a, b, d = out[i - 1, r, 0], out[i - 1, r, 1], out[i - 1, r, 2]
                x = a * t[0, 0] + b * t[1, 0] + d * t[2, 0]
                y = a * t[0, 1] + b * t[1, 1] + d * t[2, 1]
                z = a * t[0, 2] + b * t[1, 2] + d * t[2, 2]
                p = a * t[0, 3] + b * t[1, 3] + d * t[2, 3] + out[i - 1, r, 3]
            if prismatic[i]:
                out[i, r, 0], out[i, r, 1], out[i, r, 3] = x, y, p + z * value
            else:
                out[i, r, 0], out[i, r, 1], out[i, r, 3] = c * x + s * y, c * y - s * x, p
            out[i, r, 2] = z
            out[i, 3, r] = 0.0
        out[i, 3, 3] = 1.0


@compiled
def tool_pose(chain: Chain, frame: Array, out: Array) -> None:
    """Write the tool pose for given axis frames: frame (N, 4, 4) [1, m], out (4, 4) [1, m] (overwritten)."""
    tool = chain[2]
    last = frame.shape[0] - 1
    for r in range(3):
        for k in range(4):
            out[r, k] = frame[last, r, 0] * tool[0, k] + frame[last, r, 1] * tool[1, k] + frame[last, r, 2] * tool[2, k]
        out[r, 3] += frame[last, r, 3]
        out[3, r] = 0.0
    out[3, 3] = 1.0


@compiled
def jacobian_from(chain: Chain, frame: Array, T: Array, J: Array) -> None:
    """Write the geometric Jacobian in the base frame at the tool point, rows (v, ω).

    Shapes and units: frame (N, 4, 4) [1, m], T (4, 4) [1, m], J (6, n) [m/rad, 1] (overwritten).
    """
    prismatic = chain[1]
    if len(chain) == 4:
        _linkage_jacobian(chain, frame, T, J)
        return
    for i in range(frame.shape[0]):
        zx, zy, zz = frame[i, 0, 2], frame[i, 1, 2], frame[i, 2, 2]
        if prismatic[i]:
            J[0, i], J[1, i], J[2, i] = zx, zy, zz
            J[3, i], J[4, i], J[5, i] = 0.0, 0.0, 0.0
        else:
            rx, ry, rz = T[0, 3] - frame[i, 0, 3], T[1, 3] - frame[i, 1, 3], T[2, 3] - frame[i, 2, 3]
            J[0, i] = zy * rz - zz * ry
            J[1, i] = zz * rx - zx * rz
            J[2, i] = zx * ry - zy * rx
            J[3, i], J[4, i], J[5, i] = zx, zy, zz


@compiled
def _linkage_jacobian(chain: Chain, frame: Array, T: Array, J: Array) -> None:
    """Write the sums of the columns of the axes that follow each joint, times their factors."""
    J[:] = 0.0
    for i in range(frame.shape[0]):
        j, factor = axis_of(chain, i)
        z0, z1, z2 = factor * frame[i, 0, 2], factor * frame[i, 1, 2], factor * frame[i, 2, 2]
        rx, ry, rz = T[0, 3] - frame[i, 0, 3], T[1, 3] - frame[i, 1, 3], T[2, 3] - frame[i, 2, 3]
        if chain[1][i]:
            J[0, j], J[1, j], J[2, j] = J[0, j] + z0, J[1, j] + z1, J[2, j] + z2
        else:
            J[0, j] += z1 * rz - z2 * ry
            J[1, j] += z2 * rx - z0 * rz
            J[2, j] += z0 * ry - z1 * rx
            J[3, j], J[4, j], J[5, j] = J[3, j] + z0, J[4, j] + z1, J[5, j] + z2


@inlined
def workspace(chain: Chain, n: int) -> tuple[Array, Array, Array]:
    """Allocate axis frames, a tool pose and the Jacobian of n joints.

    Returns frame (N, 4, 4) [1, m], T (4, 4) [1, m], J (6, n) [m/rad, 1].
    """
    return np.empty((chain[0].shape[0], 4, 4)), np.empty((4, 4)), np.empty((6, n))


@compiled
def forward(chain: Chain, q: Array, frame: Array, T: Array) -> None:
    """Write the joint frames and the tool pose of one configuration.

    Shapes and units: q (n,) [rad, m], frame (N, 4, 4) [1, m] (overwritten), T (4, 4) [1, m] (overwritten).
    """
    frames(chain, q, frame)
    tool_pose(chain, frame, T)


@compiled
def squares(e: Array) -> tuple[float, float]:
    """Return the squared norms of the position and rotation parts of an error.

    Shapes and units: e (6,) [m, rad]. Returns p2, r2  [m², rad²].
    """
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2], e[3] * e[3] + e[4] * e[4] + e[5] * e[5]


@compiled
def error_of_pose(chain: Chain, target: Array, q: Array, frame: Array, T: Array, e: Array) -> tuple[float, float]:
    """Write the error twist, joint frames and tool pose of one configuration; return the squared errors.

    Shapes and units: target (4, 4) [1, m], q (n,) [rad, m], frame (n, 4, 4) [1, m] (overwritten), T (4, 4) [1, m]
    (overwritten), e (6,) [m, rad] (overwritten). Returns p2, r2  [m², rad²].
    """
    forward(chain, q, frame, T)
    pose_error(T, target, e)
    return squares(e)


@compiled
def fk_batch(chain: Chain, q: Array, out: Array) -> None:
    """Write the tool poses of many configurations: q (k, n) [rad, m], out (k, 4, 4) [1, m] (overwritten)."""
    frame = np.empty((chain[0].shape[0], 4, 4))
    for k in range(q.shape[0]):
        frames(chain, q[k], frame)
        tool_pose(chain, frame, out[k])


@compiled
def frames_batch(chain: Chain, q: Array, out: Array) -> None:
    """Write the axis frames and, last, the tool pose of many configurations.

    Shapes and units: q (k, n) [rad, m], out (k, N + 1, 4, 4) [1, m] (overwritten).
    """
    n = chain[0].shape[0]
    for k in range(q.shape[0]):
        frames(chain, q[k], out[k, :n])
        tool_pose(chain, out[k, :n], out[k, n])


@compiled
def jacobian_batch(chain: Chain, q: Array, out: Array) -> None:
    """Write the geometric Jacobians of many configurations.

    Shapes and units: q (k, n) [rad, m], out (k, 6, n) [m/rad, 1] (overwritten).
    """
    frame, T, _J = workspace(chain, q.shape[1])
    for k in range(q.shape[0]):
        forward(chain, q[k], frame, T)
        jacobian_from(chain, frame, T, out[k])


@compiled
def errors_batch(chain: Chain, q: Array, targets: Array, out: Array) -> None:
    """Write the error twists from the tool to target poses.

    Shapes and units: q (k, n) [rad, m], targets (k, 4, 4) [1, m], out (k, 6) [m, rad] (overwritten).
    """
    frame, T, _J = workspace(chain, q.shape[1])
    for k in range(q.shape[0]):
        error_of_pose(chain, targets[k], q[k], frame, T, out[k])


@compiled
def _cross(a: Triple, b: Triple) -> Triple:
    """Return a vector product; tuples stay in registers, arrays would be allocated."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _plus(a: Triple, x: float, b: Triple) -> Triple:
    """Return a + x b."""
    return a[0] + x * b[0], a[1] + x * b[1], a[2] + x * b[2]


@compiled
def _rotation_derivatives(w0: Triple, w1: Triple, w2: Triple, r: Triple) -> tuple[Triple, Triple, Triple]:
    """Return the first three derivatives of a vector r of constant length that rotates with ω, given ω, ω̇, ω̈."""
    r1 = _cross(w0, r)
    r2 = _plus(_cross(w1, r), 1.0, _cross(w0, r1))
    r3 = _plus(_plus(_cross(w2, r), 2.0, _cross(w1, r1)), 1.0, _cross(w0, r2))
    return r1, r2, r3


@compiled
def tool_motion(chain: Chain, frame: Array, T: Array, q: Array, dq: Array, out: Array) -> None:
    """Write the twist of the tool and its first two derivatives with respect to any parameter.

    It is the forward recursion of Newton–Euler dynamics (Siciliano et al., Robotics, §7.5), differentiated once more.

    Shapes and units: frame (N, 4, 4) [1, m], T (4, 4) [1, m], q (n,) [rad, m], dq (3, n) [rad, m], out (3, 6) [m, rad]
    (overwritten).
    """
    fixed, prismatic = chain[0], chain[1]
    n = q.shape[0] if len(chain) == 3 else fixed.shape[0]
    zero = (0.0, 0.0, 0.0)
    w0, w1, w2, p1, p2, p3 = zero, zero, zero, zero, zero, zero
    for i in range(n + 1):
        # the vector in link i − 1 to joint i (or the tool); 0 for the first joint, whose position is constant
        if i == 0:
            r = zero
        elif i < n:
            F, t = frame[i - 1], fixed[i]
            r = (
                F[0, 0] * t[0, 3] + F[0, 1] * t[1, 3] + F[0, 2] * t[2, 3],
                F[1, 0] * t[0, 3] + F[1, 1] * t[1, 3] + F[1, 2] * t[2, 3],
                F[2, 0] * t[0, 3] + F[2, 1] * t[1, 3] + F[2, 2] * t[2, 3],
            )
        else:
            r = (T[0, 3] - frame[n - 1, 0, 3], T[1, 3] - frame[n - 1, 1, 3], T[2, 3] - frame[n - 1, 2, 3])
        r1, r2, r3 = _rotation_derivatives(w0, w1, w2, r)
        p1, p2, p3 = _plus(p1, 1.0, r1), _plus(p2, 1.0, r2), _plus(p3, 1.0, r3)
        if i == n:
            break
        z = (frame[i, 0, 2], frame[i, 1, 2], frame[i, 2, 2])
        z1, z2, z3 = _rotation_derivatives(w0, w1, w2, z)  # rotation with the previous link
        j, factor = axis_of(chain, i)
        a, b, c = factor * dq[0, j], factor * dq[1, j], factor * dq[2, j]
        if prismatic[i]:
            x = q[i] if len(chain) == 3 else factor * q[j] + chain[3][i, 2]
            p1 = _plus(_plus(p1, a, z), x, z1)
            p2 = _plus(_plus(_plus(p2, b, z), 2.0 * a, z1), x, z2)
            p3 = _plus(_plus(_plus(_plus(p3, c, z), 3.0 * b, z1), 3.0 * a, z2), x, z3)
        else:
            w2 = _plus(_plus(_plus(w2, c, z), 2.0 * b, z1), a, z2)
            w1 = _plus(_plus(w1, b, z), a, z1)
            w0 = _plus(w0, a, z)
    for k in range(3):
        out[0, k], out[1, k], out[2, k] = p1[k], p2[k], p3[k]
        out[0, 3 + k], out[1, 3 + k], out[2, 3 + k] = w0[k], w1[k], w2[k]


@compiled
def tool_motion_batch(chain: Chain, q: Array, dq: Array, out: Array) -> None:
    """Write `tool_motion` of many configurations.

    Shapes and units: q (k, n) [rad, m], dq (k, 3, n) [rad, m], out (k, 3, 6) [m, rad] (overwritten).
    """
    frame, T, _J = workspace(chain, q.shape[1])
    for k in range(q.shape[0]):
        forward(chain, q[k], frame, T)
        tool_motion(chain, frame, T, q[k], dq[k], out[k])


@compiled
def singular_values_batch(chain: Chain, q: Array, out: Array) -> None:
    """Write the smallest singular value of the Jacobian at many configurations.

    Shapes and units: q (k, n) [rad, m], out (k,) [m/rad, 1] (overwritten).
    """
    frame, T, J = workspace(chain, q.shape[1])
    for k in range(q.shape[0]):
        forward(chain, q[k], frame, T)
        jacobian_from(chain, frame, T, J)
        out[k] = smallest_singular_value(J, np.inf)
