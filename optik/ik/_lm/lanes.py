"""Damped Gauss–Newton iterations in lanes, one target each: arrays have the shape (component, lane).

A lane is one column of the work arrays and holds one IK problem. Loops over the lanes become vector (SIMD) instructions, so
several problems are iterated at once. A lane that has finished its target takes the next one. Single calls use one lane:
they have the same operations in the same order as batches, so that results are equal bit for bit.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik.compiled import inlined
from optik.ik._lm.angles import angle_of, sine_cosine
from optik.ik._lm.fma import fma
from optik.ik._lm.packing import (
    AT_COS_A,
    AT_GAIN,
    AT_LEAST_DAMPING,
    AT_MOVES,
    AT_PX,
    AT_PY,
    AT_PZ,
    AT_SIN_A,
    AT_SLIDES,
    AT_TOOL_P,
    AT_ZERO,
)  # fmt: skip
from optik.se3 import log_rotation
from optik.types import Array

# Rows of the work array w (ROWS, L) for at most 12 joints, relative to the frame of the first joint at q = 0: the
# configuration Q, the bounds LOW and HIGH of steps, the BEST iterate, sines and cosines of the joint angles.
Q, LOW, HIGH, BEST, SIN, COS = 0, 12, 24, 36, 48, 60
# Rotation R and position P of the tool; GOAL, the target's rotation by rows (without the tool's) and its position; the
# error twist e, half its square E, and the squares S of its position and rotation parts.
R, P, GOAL, e, E, S = 72, 81, 84, 96, 102, 103
PICKS = 105
"""First row of the seeds nearest to the goal, 16 of each of two kinds."""
# Number of the problem, of the attempt, and of the iteration; iterations of all attempts, least E of the attempt, iterations
# without progress; whether steps are clamped, whether a solution was outside the limits, E at BEST, final status, whether an
# attempt begins, whether the lane moves to NEXT, whether it needs a decision, and the held joints, one bit each.
(PROBLEM, ATTEMPT, ITERATION, TOTAL, LEAST_E, STALL, CLAMPED) = range(137, 144)
(OUTSIDE, BEST_E, ENDING, BEGINS, MOVED, FLAG, HELD_JOINTS) = range(144, 151)
PICKED, NEXT = 151, 153
"""Rows of the flags whether PICKS are known, for each of two kinds, and of the configuration to which a lane moves."""
LEAST_END, SAME = 165, 166
"""Rows of the least E at the end of an attempt, and of the number of attempts that ended there; see `Ends`."""
ROWS = 167
"""Rows of the work array."""
PUSHED = -1.0
"""Value of HELD_JOINTS for a lane that holds, in each step, the joints that its error pushes out of their bounds."""

# Rows of the geometry g (GEOMETRY, L): joint origins and joint axes. The Jacobian J (6 n, L) is stored by columns.
O, Z = 0, 36
GEOMETRY = 72
"""Rows of the geometry, for at most 12 joints."""
NEARLY_HALF_TURN = 9.8695
"""Square of an angle just short of half a turn [rad²]."""


@inlined
def poses(arm: Array, w: Array, g: Array, n: int) -> None:
    """Compute, for the configuration in every lane, the origins and axes of the joints and the frame of the last joint.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
    (overwritten).
    """
    L = w.shape[1]
    for i in range(n):  # all sines first, since they are independent
        zero, turns = arm[AT_ZERO + i], 1.0 - arm[AT_SLIDES + i]
        for l in range(L):
            w[SIN + i, l], w[COS + i, l] = sine_cosine(zero + turns * w[Q + i, l])
    slides = arm[AT_SLIDES]
    for l in range(L):
        s, c = w[SIN, l], w[COS, l]
        w[R, l], w[R + 1, l], w[R + 2, l] = c, -s, 0.0
        w[R + 3, l], w[R + 4, l], w[R + 5, l] = s, c, 0.0
        w[R + 6, l], w[R + 7, l], w[R + 8, l] = 0.0, 0.0, 1.0
        w[P, l], w[P + 1, l], w[P + 2, l] = 0.0, 0.0, slides * w[Q, l]
        g[O, l], g[O + 1, l], g[O + 2, l] = 0.0, 0.0, w[P + 2, l]
        g[Z, l], g[Z + 1, l], g[Z + 2, l] = 0.0, 0.0, 1.0
    for i in range(1, n):
        px, py, pz, ca, sa = arm[AT_PX + i], arm[AT_PY + i], arm[AT_PZ + i], arm[AT_COS_A + i], arm[AT_SIN_A + i]
        slides = arm[AT_SLIDES + i]
        for l in range(L):
            s, c, d = w[SIN + i, l], w[COS + i, l], slides * w[Q + i, l]
            for r in range(3):
                x, y, z = w[R + 3 * r, l], w[R + 3 * r + 1, l], w[R + 3 * r + 2, l]
                up = fma(ca, y, sa * z)
                axis = fma(ca, z, -sa * y)
                p = fma(x, px, fma(y, py, fma(z, pz, fma(axis, d, w[P + r, l]))))
                w[P + r, l], g[O + 3 * i + r, l] = p, p
                w[R + 3 * r, l], w[R + 3 * r + 1, l] = fma(c, x, s * up), fma(c, up, -s * x)
                w[R + 3 * r + 2, l], g[Z + 3 * i + r, l] = axis, axis


@inlined
def twists(arm: Array, w: Array) -> None:
    """Compute the error twist of every lane and its squares from the last joint's frame; P becomes the tool's position.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten).
    """
    L = w.shape[1]
    tx, ty, tz = arm[AT_TOOL_P], arm[AT_TOOL_P + 1], arm[AT_TOOL_P + 2]
    for l in range(L):
        x0, y0, z0, x1, y1, z1 = w[R, l], w[R + 1, l], w[R + 2, l], w[R + 3, l], w[R + 4, l], w[R + 5, l]
        x2, y2, z2 = w[R + 6, l], w[R + 7, l], w[R + 8, l]
        w[P, l] += x0 * tx + y0 * ty + z0 * tz
        w[P + 1, l] += x1 * tx + y1 * ty + z1 * tz
        w[P + 2, l] += x2 * tx + y2 * ty + z2 * tz
        u0, v0, w0 = w[GOAL, l], w[GOAL + 1, l], w[GOAL + 2, l]
        u1, v1, w1 = w[GOAL + 3, l], w[GOAL + 4, l], w[GOAL + 5, l]
        u2, v2, w2 = w[GOAL + 6, l], w[GOAL + 7, l], w[GOAL + 8, l]
        # R_t Rᵀ has the axis Σ (column of R × column of R_t) / 2 of length sin θ, and the trace 1 + 2 cos θ
        sx = 0.5 * (x1 * u2 - x2 * u1 + y1 * v2 - y2 * v1 + z1 * w2 - z2 * w1)
        sy = 0.5 * (x2 * u0 - x0 * u2 + y2 * v0 - y0 * v2 + z2 * w0 - z0 * w2)
        sz = 0.5 * (x0 * u1 - x1 * u0 + y0 * v1 - y1 * v0 + z0 * w1 - z1 * w0)
        c = 0.5 * (x0 * u0 + x1 * u1 + x2 * u2 + y0 * v0 + y1 * v1 + y2 * v2 + z0 * w0 + z1 * w1 + z2 * w2 - 1.0)
        s = sqrt(sx * sx + sy * sy + sz * sz)
        angle, f = angle_of(s, c)
        for r in range(3):
            w[e + r, l] = w[GOAL + 9 + r, l] - w[P + r, l]
        w[e + 3, l], w[e + 4, l], w[e + 5, l] = f * sx, f * sy, f * sz
        p2 = w[e, l] * w[e, l] + w[e + 1, l] * w[e + 1, l] + w[e + 2, l] * w[e + 2, l]
        r2 = angle * angle
        w[S, l], w[S + 1, l] = p2, r2
        w[E, l] = 0.5 * (p2 + r2)


@inlined
def errors(arm: Array, w: Array, g: Array, n: int) -> None:
    """Compute the forward kinematics and the pose error of the configuration in every lane.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
    (overwritten).
    """
    poses(arm, w, g, n)
    twists(arm, w)


@inlined
def correct_half_turn(w: Array, l: int) -> None:
    """Recompute the error near half a turn from the rotation matrix, since sin θ has lost the axis.

    Shapes and units: w (ROWS, L) [as the rows say] (overwritten).
    """
    if w[S + 1, l] < NEARLY_HALF_TURN:
        return
    D, axis = np.empty((3, 3)), np.empty(3)
    for i in range(3):
        for j in range(3):
            D[i, j] = 0.0
            for k in range(3):
                D[i, j] += w[GOAL + 3 * i + k, l] * w[R + 3 * j + k, l]
    log_rotation(D, axis)
    for i in range(3):
        w[e + 3 + i, l] = axis[i]


@inlined
def hold_joints(w: Array, J: Array, n: int) -> None:
    """Set the columns of held joints in the Jacobians J (6 n, L) to 0, so that the other joints alone make the step.

    A lane marked PUSHED holds the joints at a bound that Jᵀ e pushes out of it (Bertsekas 1982).
    """
    for l in range(w.shape[1]):
        if w[HELD_JOINTS, l] == 0.0:
            continue
        pushed, joints = w[HELD_JOINTS, l] == PUSHED, int(w[HELD_JOINTS, l])
        for i in range(n):
            down = J[6 * i, l] * w[e, l] + J[6 * i + 1, l] * w[e + 1, l] + J[6 * i + 2, l] * w[e + 2, l]
            down += J[6 * i + 3, l] * w[e + 3, l] + J[6 * i + 4, l] * w[e + 4, l] + J[6 * i + 5, l] * w[e + 5, l]
            q = w[Q + i, l]
            out = (down < 0.0 and q <= w[LOW + i, l]) or (down > 0.0 and q >= w[HIGH + i, l])
            if out if pushed else joints >> i & 1:
                for r in range(6):
                    J[6 * i + r, l] = 0.0


@inlined
def jacobians(arm: Array, w: Array, g: Array, J: Array, n: int, holding: bool) -> None:
    """Compute the geometric Jacobian of every lane; the columns of locked and held joints are 0.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say], g (GEOMETRY, L) [m, 1], J (6 * n, L)
    [m/rad, 1] (overwritten).
    """
    L = w.shape[1]
    for i in range(n):
        # a joint is revolute, prismatic, or locked
        slides, moves = arm[AT_SLIDES + i], arm[AT_MOVES + i]
        turns = (1.0 - slides) * moves
        slides = slides * moves
        for l in range(L):
            zx, zy, zz = g[Z + 3 * i, l], g[Z + 3 * i + 1, l], g[Z + 3 * i + 2, l]
            rx, ry, rz = w[P, l] - g[O + 3 * i, l], w[P + 1, l] - g[O + 3 * i + 1, l], w[P + 2, l] - g[O + 3 * i + 2, l]
            J[6 * i, l] = turns * (zy * rz - zz * ry) + slides * zx
            J[6 * i + 1, l] = turns * (zz * rx - zx * rz) + slides * zy
            J[6 * i + 2, l] = turns * (zx * ry - zy * rx) + slides * zz
            J[6 * i + 3, l] = turns * zx
            J[6 * i + 4, l] = turns * zy
            J[6 * i + 5, l] = turns * zz
    if n > 6 or holding:
        hold_joints(w, J, n)


@inlined
def normal_matrix(arm: Array, w: Array, A: Array, J: Array, n: int) -> None:
    """Compute the lower triangle of J Jᵀ + λ² I of every lane by rows, with λ² = gain · E + least damping.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say], A (21, L) [m²] (overwritten), J
    (6 * n, L) [m/rad, 1].
    """
    gain, least = arm[AT_GAIN], arm[AT_LEAST_DAMPING]
    for l in range(w.shape[1]):
        t = gain * w[E, l] + least
        a00, a11, a22, a33, a44, a55 = t, t, t, t, t, t
        a10 = a20 = a21 = a30 = a31 = a32 = a40 = a41 = a42 = a43 = a50 = a51 = a52 = a53 = a54 = 0.0
        for i in range(n):
            j0, j1, j2 = J[6 * i, l], J[6 * i + 1, l], J[6 * i + 2, l]
            j3, j4, j5 = J[6 * i + 3, l], J[6 * i + 4, l], J[6 * i + 5, l]
            a00 = fma(j0, j0, a00)
            a10 = fma(j1, j0, a10)
            a11 = fma(j1, j1, a11)
            a20 = fma(j2, j0, a20)
            a21 = fma(j2, j1, a21)
            a22 = fma(j2, j2, a22)
            a30 = fma(j3, j0, a30)
            a31 = fma(j3, j1, a31)
            a32 = fma(j3, j2, a32)
            a33 = fma(j3, j3, a33)
            a40 = fma(j4, j0, a40)
            a41 = fma(j4, j1, a41)
            a42 = fma(j4, j2, a42)
            a43 = fma(j4, j3, a43)
            a44 = fma(j4, j4, a44)
            a50 = fma(j5, j0, a50)
            a51 = fma(j5, j1, a51)
            a52 = fma(j5, j2, a52)
            a53 = fma(j5, j3, a53)
            a54 = fma(j5, j4, a54)
            a55 = fma(j5, j5, a55)
        A[0, l], A[1, l], A[2, l] = a00, a10, a11
        A[3, l], A[4, l], A[5, l] = a20, a21, a22
        A[6, l], A[7, l], A[8, l], A[9, l] = a30, a31, a32, a33
        A[10, l], A[11, l], A[12, l], A[13, l], A[14, l] = a40, a41, a42, a43, a44
        A[15, l], A[16, l], A[17, l], A[18, l], A[19, l], A[20, l] = a50, a51, a52, a53, a54, a55


@inlined
def factorise(A: Array) -> None:
    """Factorise the matrix of every lane as L D Lᵀ: the entries of L below the diagonal, and 1 / D on it.

    Shapes and units: A (21, L) [m²] (overwritten).
    """
    for l in range(A.shape[1]):
        a00, a10, a11 = A[0, l], A[1, l], A[2, l]
        a20, a21, a22 = A[3, l], A[4, l], A[5, l]
        a30, a31, a32, a33 = A[6, l], A[7, l], A[8, l], A[9, l]
        a40, a41, a42, a43, a44 = A[10, l], A[11, l], A[12, l], A[13, l], A[14, l]
        a50, a51, a52, a53, a54, a55 = A[15, l], A[16, l], A[17, l], A[18, l], A[19, l], A[20, l]
        # row by row; the entries of A become those of L
        d0 = 1.0 / a00
        l10, l20, l30, l40, l50 = a10 * d0, a20 * d0, a30 * d0, a40 * d0, a50 * d0
        d1 = 1.0 / fma(-l10, a10, a11)
        b21, b31, b41, b51 = fma(-l20, a10, a21), fma(-l30, a10, a31), fma(-l40, a10, a41), fma(-l50, a10, a51)
        l21, l31, l41, l51 = b21 * d1, b31 * d1, b41 * d1, b51 * d1
        d2 = 1.0 / fma(-l21, b21, fma(-l20, a20, a22))
        b32 = fma(-l31, b21, fma(-l30, a20, a32))
        b42 = fma(-l41, b21, fma(-l40, a20, a42))
        b52 = fma(-l51, b21, fma(-l50, a20, a52))
        l32, l42, l52 = b32 * d2, b42 * d2, b52 * d2
        d3 = 1.0 / fma(-l32, b32, fma(-l31, b31, fma(-l30, a30, a33)))
        b43 = fma(-l42, b32, fma(-l41, b31, fma(-l40, a30, a43)))
        b53 = fma(-l52, b32, fma(-l51, b31, fma(-l50, a30, a53)))
        l43, l53 = b43 * d3, b53 * d3
        d4 = 1.0 / fma(-l43, b43, fma(-l42, b42, fma(-l41, b41, fma(-l40, a40, a44))))
        b54 = fma(-l53, b43, fma(-l52, b42, fma(-l51, b41, fma(-l50, a40, a54))))
        l54 = b54 * d4
        d5 = 1.0 / fma(-l54, b54, fma(-l53, b53, fma(-l52, b52, fma(-l51, b51, fma(-l50, a50, a55)))))
        A[0, l], A[1, l], A[2, l] = d0, l10, d1
        A[3, l], A[4, l], A[5, l] = l20, l21, d2
        A[6, l], A[7, l], A[8, l], A[9, l] = l30, l31, l32, d3
        A[10, l], A[11, l], A[12, l], A[13, l], A[14, l] = l40, l41, l42, l43, d4
        A[15, l], A[16, l], A[17, l], A[18, l], A[19, l], A[20, l] = l50, l51, l52, l53, l54, d5


@inlined
def substitute(w: Array, A: Array, J: Array, n: int) -> None:
    """Apply the step Δq = Jᵀ A⁻¹ e of every lane by the factors of its matrix, clamped to the lane's bounds.

    Shapes and units: w (ROWS, L) [as the rows say] (overwritten), A (21, L) [m², 1], J (6 * n, L) [m/rad, 1].
    """
    for l in range(w.shape[1]):
        d0, l10, d1 = A[0, l], A[1, l], A[2, l]
        l20, l21, d2 = A[3, l], A[4, l], A[5, l]
        l30, l31, l32, d3 = A[6, l], A[7, l], A[8, l], A[9, l]
        l40, l41, l42, l43, d4 = A[10, l], A[11, l], A[12, l], A[13, l], A[14, l]
        l50, l51, l52, l53, l54, d5 = A[15, l], A[16, l], A[17, l], A[18, l], A[19, l], A[20, l]
        y0 = w[e, l]
        y1 = fma(-l10, y0, w[e + 1, l])
        y2 = fma(-l21, y1, fma(-l20, y0, w[e + 2, l]))
        y3 = fma(-l32, y2, fma(-l31, y1, fma(-l30, y0, w[e + 3, l])))
        y4 = fma(-l43, y3, fma(-l42, y2, fma(-l41, y1, fma(-l40, y0, w[e + 4, l]))))
        y5 = d5 * fma(-l54, y4, fma(-l53, y3, fma(-l52, y2, fma(-l51, y1, fma(-l50, y0, w[e + 5, l])))))
        y4 = fma(-l54, y5, y4 * d4)
        y3 = fma(-l53, y5, fma(-l43, y4, y3 * d3))
        y2 = fma(-l52, y5, fma(-l42, y4, fma(-l32, y3, y2 * d2)))
        y1 = fma(-l51, y5, fma(-l41, y4, fma(-l31, y3, fma(-l21, y2, y1 * d1))))
        y0 = fma(-l50, y5, fma(-l40, y4, fma(-l30, y3, fma(-l20, y2, fma(-l10, y1, y0 * d0)))))
        for i in range(n):
            q = fma(J[6 * i, l], y0, w[Q + i, l])
            q = fma(J[6 * i + 1, l], y1, q)
            q = fma(J[6 * i + 2, l], y2, q)
            q = fma(J[6 * i + 3, l], y3, q)
            q = fma(J[6 * i + 4, l], y4, q)
            q = fma(J[6 * i + 5, l], y5, q)
            w[Q + i, l] = min(max(q, w[LOW + i, l]), w[HIGH + i, l])


@inlined
def steps(arm: Array, w: Array, g: Array, J: Array, n: int, holding: bool) -> None:
    """Apply one step of every lane: Δq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, clamped to the lane's bounds.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
    (overwritten), J (6 * n, L) [m/rad, 1] (overwritten).
    """
    jacobians(arm, w, g, J, n, holding)
    # the matrix overwrites the geometry, which is not needed any more
    normal_matrix(arm, w, g, J, n)
    factorise(g)
    substitute(w, g, J, n)
