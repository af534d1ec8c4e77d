"""Compiled forward kinematics, Jacobian and their derivatives, of one configuration or a batch.

Every kernel that needs the arm takes it first, as one argument: a `Chain`. Joint frame i is reached from the one before
by fixed_i followed by Rot(z, q_i), or Trans(z, q_i) where the joint slides. Outputs are written into the caller's arrays.

A chain is a plain tuple, in Python (`Robot.chain`) and in kernels alike, and a kernel names the parts that it reads in
its first line. To call a kernel with a plain tuple of arrays takes the same 0.65 µs as with the arrays themselves; a
NamedTuple, whose type Numba finds anew at every call, takes 1.5 µs, and a warm call of `lm` 2.8 µs. So arrays that
belong together go from Python into a kernel as a plain tuple; NamedTuples are made and used inside kernels.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from optik.compiled import compiled
from optik.linear import damped_step, qr_factor, qr_solve, smallest_of_factor, smallest_singular_value
from optik.se3 import pose_error
from optik.types import Array, Flags

Triple = tuple[float, float, float]

Chain = tuple[Array, Flags, Array]
"""An arm as kernels take it: fixed (n, 4, 4), the transforms [1, m] from the joint before (the base, for the first) to
each joint at q = 0; prismatic (n,), which joints slide; tool (4, 4), the transform from the last joint to the tool."""

DAMPED = 1e-4
"""Damping at a singular configuration: directions that move the tool 100 times as far keep 1e-4 of their error a step."""


@compiled
def multiply(A: Array, B: Array, out: Array) -> None:
    """Product of two poses into out, a third array."""
    for i in range(3):
        for j in range(4):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
        out[i, 3] += A[i, 3]
        out[3, i] = 0.0
    out[3, 3] = 1.0


@compiled
def copy_pose(A: Array, out: Array) -> None:
    """Copy a pose; a loop compiles in a tenth of the time that a slice assignment takes."""
    for i in range(4):
        for j in range(4):
            out[i, j] = A[i, j]


@compiled
def copy_vector(a: Array, out: Array) -> None:
    """Copy a vector."""
    for i in range(a.shape[0]):
        out[i] = a[i]


@compiled
def frames(chain: Chain, q: Array, out: Array) -> None:
    """Pose of every joint frame in the base, after its own motion, into out (n, 4, 4)."""
    fixed, prismatic, _tool = chain
    before = np.empty((4, 4))
    for i in range(q.shape[0]):
        if i == 0:
            copy_pose(fixed[0], before)
        else:
            multiply(out[i - 1], fixed[i], before)
        T = out[i]
        copy_pose(before, T)
        if prismatic[i]:
            for r in range(3):
                T[r, 3] += before[r, 2] * q[i]
        else:
            c, s = cos(q[i]), sin(q[i])
            for r in range(3):
                T[r, 0] = c * before[r, 0] + s * before[r, 1]
                T[r, 1] = c * before[r, 1] - s * before[r, 0]


@compiled
def tool_pose(chain: Chain, frame: Array, out: Array) -> None:
    """Tool pose (4, 4) from the joint frames of `frames`."""
    _fixed, _prismatic, tool = chain
    multiply(frame[frame.shape[0] - 1], tool, out)


@compiled
def jacobian_from(chain: Chain, frame: Array, T: Array, J: Array) -> None:
    """Geometric Jacobian (6, n) in the base frame at the tool point, (v, ω), from joint frames and the tool pose T."""
    _fixed, prismatic, _tool = chain
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
def fk_batch(chain: Chain, q: Array, out: Array) -> None:
    """Tool poses (k, 4, 4) of configurations (k, n)."""
    frame = np.empty((q.shape[1], 4, 4))
    for k in range(q.shape[0]):
        frames(chain, q[k], frame)
        tool_pose(chain, frame, out[k])


@compiled
def frames_batch(chain: Chain, q: Array, out: Array) -> None:
    """Joint frames and, last, the tool pose: (k, n + 1, 4, 4) of configurations (k, n)."""
    n = q.shape[1]
    for k in range(q.shape[0]):
        frames(chain, q[k], out[k, :n])
        tool_pose(chain, out[k, :n], out[k, n])


@compiled
def jacobian_batch(chain: Chain, q: Array, out: Array) -> None:
    """Geometric Jacobians (k, 6, n) of configurations (k, n)."""
    frame = np.empty((q.shape[1], 4, 4))
    T = np.empty((4, 4))
    for k in range(q.shape[0]):
        frames(chain, q[k], frame)
        tool_pose(chain, frame, T)
        jacobian_from(chain, frame, T, out[k])


@compiled
def errors_batch(chain: Chain, q: Array, targets: Array, out: Array) -> None:
    """Error twists (k, 6) from the tool at q (k, n) to targets (k, 4, 4): what judges every method."""
    frame = np.empty((q.shape[1], 4, 4))
    T = np.empty((4, 4))
    for k in range(q.shape[0]):
        frames(chain, q[k], frame)
        tool_pose(chain, frame, T)
        pose_error(T, targets[k], out[k])


@compiled
def _cross(a: Triple, b: Triple) -> Triple:
    """Vector product; tuples stay in registers, where small arrays cost an allocation each."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _plus(a: Triple, x: float, b: Triple) -> Triple:
    """Return a + x b."""
    return a[0] + x * b[0], a[1] + x * b[1], a[2] + x * b[2]


@compiled
def _turned(w0: Triple, w1: Triple, w2: Triple, r: Triple) -> tuple[Triple, Triple, Triple]:
    """First three derivatives of a vector r of constant length that turns with ω, given ω, ω̇, ω̈."""
    r1 = _cross(w0, r)
    r2 = _plus(_cross(w1, r), 1.0, _cross(w0, r1))
    r3 = _plus(_plus(_cross(w2, r), 2.0, _cross(w1, r1)), 1.0, _cross(w0, r2))
    return r1, r2, r3


@compiled
def tool_motion(chain: Chain, frame: Array, T: Array, q: Array, dq: Array, out: Array) -> None:
    """Twist of the tool and its first two derivatives, (3, 6) rows (v, ω), (v̇, ω̇), (v̈, ω̈), base frame.

    By the forward recursion of Newton–Euler dynamics carried one order further (Siciliano et al., Robotics, §7.5;
    differentiated once more). dq (3, n) holds q̇, q̈, q⃛ with respect to any parameter.
    """
    fixed, prismatic, _tool = chain
    n = q.shape[0]
    zero = (0.0, 0.0, 0.0)
    w0, w1, w2, p1, p2, p3 = zero, zero, zero, zero, zero, zero
    for i in range(n + 1):
        # the vector fixed in link i − 1 that leads to joint i (or the tool); what leads to the first joint stands still
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
        r1, r2, r3 = _turned(w0, w1, w2, r)
        p1, p2, p3 = _plus(p1, 1.0, r1), _plus(p2, 1.0, r2), _plus(p3, 1.0, r3)
        if i == n:
            break
        z = (frame[i, 0, 2], frame[i, 1, 2], frame[i, 2, 2])
        z1, z2, z3 = _turned(w0, w1, w2, z)  # as they turn with the link before
        a, b, c = dq[0, i], dq[1, i], dq[2, i]
        if prismatic[i]:
            x = q[i]
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
    """`tool_motion` of configurations (k, n) with derivatives dq (k, 3, n), into out (k, 3, 6)."""
    frame = np.empty((q.shape[1], 4, 4))
    T = np.empty((4, 4))
    for k in range(q.shape[0]):
        frames(chain, q[k], frame)
        tool_pose(chain, frame, T)
        tool_motion(chain, frame, T, q[k], dq[k], out[k])


@compiled
def singular_values_batch(chain: Chain, q: Array, out: Array) -> None:
    """Smallest singular value of the Jacobian (of n where n < 6, else of 6) at configurations (k, n), into out (k,)."""
    n = q.shape[1]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    for k in range(q.shape[0]):
        frames(chain, q[k], frame)
        tool_pose(chain, frame, T)
        jacobian_from(chain, frame, T, J)
        out[k] = smallest_singular_value(J)


@compiled
def _stack(J: Array, rows: Array, A: Array) -> None:
    """[J; rows] into A (6 + d, n)."""
    for j in range(A.shape[1]):
        for i in range(6):
            A[i, j] = J[i, j]
        for i in range(rows.shape[0]):
            A[6 + i, j] = rows[i, j]


@compiled
def put_on(chain: Chain, target: Array, rows: Array, values: Array, steps: int, q: Array) -> tuple[float, float]:
    """Undamped Newton, in place, on q (n,) for a target (4, 4) and rows · q = values, until rounding stops it.

    For n ≤ 6 joints there are no rows (0, n), and steps are least squares where n < 6; for n > 6 there are n − 6, which
    say where on its curve of solutions q shall be. Returns the largest error left [m, rad or values] and |r_nn / r_11|
    of the last system, which is 0 where rank is lost.
    """
    n, d = q.shape[0], rows.shape[0]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, beta, order = np.empty((6 + d, n)), np.empty(n), np.empty(n, np.int64)
    e, dq, best = np.empty(6 + d), np.empty(n), q.copy()
    smallest, worst, rank = np.inf, np.inf, 1.0
    for _ in range(steps + 1):
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        pose_error(T, target, e)
        for i in range(d):
            e[6 + i] = values[i]
            for j in range(n):
                e[6 + i] -= rows[i, j] * q[j]
        size, largest = 0.0, 0.0
        for i in range(6 + d):
            size += e[i] * e[i]
            largest = max(largest, abs(e[i]))
        if not size < smallest:
            break
        before, smallest, worst = smallest, size, largest
        copy_vector(q, best)
        # Newton squares the error: from 1e-9 it comes to rounding, and another step would only stir that
        if size < 1e-30 or (before < 1e-18 and size < 1e-26):
            break
        jacobian_from(chain, frame, T, J)
        _stack(J, rows, A)
        rank = qr_factor(A, beta, order)
        if rank == 0.0:
            break
        qr_solve(A, beta, order, e, dq)
        for i in range(n):
            q[i] += dq[i]
    copy_vector(best, q)
    return worst, rank


@compiled
def derivatives_at(
    chain: Chain, q: Array, twists: Array, rows: Array, values: Array, dq: Array,
    floor: float = np.inf,
) -> tuple[float, float]:  # fmt: skip
    """q', q'', q''' into dq (3, n) at q (n,), of a motion with tool twists (3, 6) and rows(s) · q(s) = values(s); exact.

    J q' = V; the higher ones from J q'' = V' − (what q' alone makes of V'), and so on. rows (4, d, n) and values (4, d)
    hold their own derivatives of order 0 to 3; d = 0 for n ≤ 6 joints, n − 6 otherwise, and [J; rows] is square. Returns
    |r_nn / r_11| of the system, and the smallest singular value of J; where that is proved to be above `floor`, a lower
    bound on it above `floor`, which costs less.
    """
    n, d = q.shape[0], rows.shape[1]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, beta, order = np.empty((6 + d, n)), np.empty(n), np.empty(n, np.int64)
    e, made = np.empty(6 + d), np.empty((3, 6))
    frames(chain, q, frame)
    tool_pose(chain, frame, T)
    jacobian_from(chain, frame, T, J)
    _stack(J, rows[0], A)
    rank = qr_factor(A, beta, order)
    singular = 0.0
    if d > 0:
        singular = smallest_singular_value(J, floor)
    elif rank > 0.0:  # A is J
        singular = smallest_of_factor(A, floor)
    for k in range(3):
        for i in range(n):
            dq[k, i] = 0.0
    if rank == 0.0:
        return rank, singular
    for k in range(3):
        if k > 0:
            tool_motion(chain, frame, T, q, dq, made)
        for i in range(6):
            e[i] = twists[k, i] - (made[k, i] if k > 0 else 0.0)
        for i in range(d):  # Leibniz: the derivative of order k + 1 of rows · q, less its term rows · q⁽ᵏ⁺¹⁾
            e[6 + i] = values[k + 1, i]
            for j in range(n):
                part = rows[k + 1, i, j] * q[j]
                if k == 1:
                    part += 2.0 * rows[1, i, j] * dq[0, j]
                elif k == 2:
                    part += 3.0 * (rows[2, i, j] * dq[0, j] + rows[1, i, j] * dq[1, j])
                e[6 + i] -= part
        qr_solve(A, beta, order, e, dq[k])
    return rank, singular


@compiled
def settle(chain: Chain, target: Array, twist: Array, steps: int, q: Array, v: Array) -> float:
    """Bring q (n,) onto a target (4, 4) and v (n,) onto a twist (6,), in place, at or near a singular configuration.

    By damped least squares: what moves the tool is corrected, what does not stays as it was given. Returns the largest
    error left in pose and twist.
    """
    n = q.shape[0]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, y, dq, e = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6)
    worst = 0.0
    for step in range(2 * steps):
        of_pose = step < steps
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        jacobian_from(chain, frame, T, J)
        if of_pose:
            pose_error(T, target, e)
        else:
            for i in range(6):
                e[i] = twist[i]
                for j in range(n):
                    e[i] -= J[i, j] * v[j]
        if step == steps - 1 or step == 2 * steps - 1:
            for i in range(6):
                worst = max(worst, abs(e[i]))
            continue
        if not damped_step(J, e, DAMPED * DAMPED, A, y, dq, 0.0):
            return np.inf
        for j in range(n):
            if of_pose:
                q[j] += dq[j]
            else:
                v[j] += dq[j]
    return worst


@compiled
def polish_batch(chain: Chain, q: Array, targets: Array, steps: int) -> None:
    """Undamped Newton, in place, on q (k, n) that nearly solve targets (k, 4, 4), until rounding stops it.

    Steps are least squares where n < 6, and the shortest where n > 6.
    """
    n = q.shape[1]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, y, dq, e = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6)
    best, no_rows, no_values = np.empty(n), np.empty((0, n)), np.empty(0)
    for k in range(q.shape[0]):
        if n <= 6:
            put_on(chain, targets[k], no_rows, no_values, steps, q[k])
            continue
        smallest = np.inf
        for _ in range(steps + 1):
            frames(chain, q[k], frame)
            tool_pose(chain, frame, T)
            pose_error(T, targets[k], e)
            size = 0.0
            for i in range(6):
                size += e[i] * e[i]
            if not size < smallest:
                break
            smallest = size
            copy_vector(q[k], best)
            if size < 1e-30:
                break
            jacobian_from(chain, frame, T, J)
            if not damped_step(J, e, 0.0, A, y, dq):
                break
            for i in range(n):
                q[k, i] += dq[i]
        copy_vector(best, q[k])
