"""Damped Gauss–Newton iterations in lanes, one target each: arrays have the shape (component, lane).

A lane is one column of the work arrays and holds one IK problem. Loops over the lanes become vector (SIMD) instructions, so
several problems are iterated at once. A lane that has finished its target takes the next one. Single calls use one lane:
they have the same operations in the same order as batches, so that results are equal bit for bit.
"""

from __future__ import annotations

from functools import lru_cache
from math import atan2, cos, sin, sqrt
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

from optik.arm.robot import Robot
from optik.compiled import inlined
from optik.se3 import inverse, log_rotation
from optik.types import Array

# ---------------- arm and options in one flat array for the kernels


# Positions in the flat array. First the options of the search and whether the arm has fewer joints than a pose components,
# then the reach bound (8), rotation (9) and position (3) of the base, rotation (9) and position (3) of the tool, and the
# number of redundant joints.
(AT_TOLERANCE_P, AT_TOLERANCE_R, AT_GAIN, AT_LEAST_DAMPING, AT_ITERATIONS) = range(5)
(AT_FIRST, AT_ATTEMPTS, AT_PATIENCE, AT_PROGRESS, AT_FEW) = range(5, 10)
AT_REACH, AT_BASE_R, AT_BASE_P, AT_TOOL_R, AT_TOOL_P, AT_SPARE = 10, 18, 27, 30, 39, 42

MOST_JOINTS = 14
"""Largest number of joints: the size of the kernels' work arrays."""

# For all joints: p (three values), cos α, sin α, θ, 1 if prismatic, 1 if not locked, lower limit, upper limit.
AT_PX, AT_PY, AT_PZ, AT_COS_A, AT_SIN_A, AT_ZERO, AT_SLIDES, AT_MOVES, AT_LOWER, AT_UPPER = range(
    43, 43 + 10 * MOST_JOINTS, MOST_JOINTS
)

COMPARED_SEEDS, SEEDS = 256, 1024
"""Number of seeds whose poses are compared with the target, and number of all seeds."""
AT_BEST_E, AT_BEST, AT_SEEDS = 43 + 10 * MOST_JOINTS, 44 + 10 * MOST_JOINTS, 44 + 11 * MOST_JOINTS
"""Positions of ½|e|² and of the configuration of the best iterate of earlier attempts, if AT_FIRST is not the first attempt.
Then follow the seeds' poses (13, COMPARED_SEEDS) and configurations (SEEDS, n), first of the seeds anywhere inside the
limits. For arms with redundant joints, those of the seeds with joints at limits follow."""


def pack_arm(robot: Robot, reach: Array, options: Array) -> Array:
    """Return an arm, its reach bound and the options of a solver as one flat array."""
    spare = count_spare_joints(robot)
    joints = np.zeros((10, MOST_JOINTS))
    joints[:, : robot.n] = joint_parameters(robot).T
    first, tool = robot.fixed[0], robot.tool
    frames = (first[:3, :3], first[:3, 3], tool[:3, :3], tool[:3, 3])
    seeds = (*_sample_seeds(robot, 0), *(_sample_seeds(robot, spare) if spare else ()))
    best = np.full(1 + MOST_JOINTS, np.inf)
    parts = (options, reach, *frames, np.array([float(spare)]), joints, best, *seeds)
    return np.concatenate([part.ravel() for part in parts])


def count_spare_joints(robot: Robot) -> int:
    """Return the number of joints that can be held at a limit while six others move."""
    lower, upper = robot.limits.lower, robot.limits.upper
    moves = lower < upper
    limited = moves & (np.isfinite(lower) | np.isfinite(upper))
    return max(min(int(moves.sum()) - 6, int(limited.sum())), 0)


@lru_cache(maxsize=64)
def _sample_seeds(robot: Robot, held: int) -> tuple[Array, Array]:
    """Return poses (13, COMPARED_SEEDS) and configurations (SEEDS, n) of random seeds with `held` joints at a limit.

    A pose is stored so that a scalar product with the target gives half the squared distance up to a constant: rotation
    (9) and position (3), weighted as in the distance, and half the square of the position. A radian counts as 0.3 m
    (measured: values between 0.15 and 0.5 do as well).
    """
    rng = np.random.default_rng(1)
    q = move_to_limits(robot, rng, robot.limits.sample(rng, SEEDS), held)
    T = inverse(robot.fixed[0]) @ robot.fk(q[:COMPARED_SEEDS])
    R, p = T[:, :3, :3] @ robot.tool[:3, :3].T, T[:, :3, 3]
    return np.vstack([0.1 * R.reshape(-1, 9).T, p.T, 0.5 * (p**2).sum(axis=1)]), q


def move_to_limits(robot: Robot, rng: np.random.Generator, q: Array, held: int) -> Array:
    """Move `held` random joints of every configuration to a random finite limit; locked joints stay."""
    lower, upper = robot.limits.lower, robot.limits.upper
    end = np.where(rng.random(q.shape) < 0.5, lower, upper)
    end = np.where(np.isfinite(end), end, np.where(np.isfinite(lower), lower, upper))
    rank = np.where(np.isfinite(end) & (lower < upper), rng.random(q.shape), 2.0).argsort(axis=1).argsort(axis=1)
    return np.where(rank < held, end, q)


def joint_parameters(robot: Robot) -> Array:
    """Return the parameters (n, 10) of an arm's joints.

    Joint frames are rotated about their own z, which only shifts the joint's zero. Joint i then follows joint i − 1 by the
    translation p and Rot(x, α), and Rot(z, q + θ), or Rot(z, θ) Trans(z, q) if prismatic. This describes every serial arm
    with two thirds of the multiplications of full transforms. α and θ are two of the Euler angles z–x–z of the fixed
    rotation; the third is added to θ of the previous joint.
    """
    n, limits = robot.n, robot.limits
    joints = np.zeros((n, 10))
    joints[:, 3] = 1.0  # cos α of the first, whose frame is the base
    joints[:, 6], joints[:, 7] = robot.prismatic, limits.lower < limits.upper
    joints[:, 8], joints[:, 9] = limits.lower, limits.upper
    for i in range(1, n):  # Rot(z, a) Rot(x, α) Rot(z, b): a is added to the previous joint's zero, b to this one's
        R, p = robot.fixed[i, :3, :3], robot.fixed[i, :3, 3]
        across = sqrt(R[0, 2] ** 2 + R[1, 2] ** 2)
        a = atan2(R[0, 2], -R[1, 2]) if across > 1e-12 else 0.0
        ca, sa = cos(a), sin(a)
        ct, st = R[2, 2], sa * R[0, 2] - ca * R[1, 2]
        size = sqrt(ct * ct + st * st)
        ct, st = ct / size, st / size
        back = np.array([[ca, sa, 0.0], [-ct * sa, ct * ca, st], [st * sa, -st * ca, ct]])  # Rot(x, −α) Rot(z, −a)
        rest = back @ R
        joints[i, 0:3] = ca * p[0] + sa * p[1], ca * p[1] - sa * p[0], p[2]
        joints[i, 3:5] = ct, st
        joints[i - 1, 5] += a
        joints[i, 5] = atan2(rest[1, 0], rest[0, 0])
    return joints


# ---------------- explicit fused multiply–add


def _fma(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x y + z for float64: one instruction if the processor has it, else a slow call."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


fma: Any = intrinsic(_fma)


# ---------------- small arrays on the stack of compiled code


def _stack(typingctx: Any, rows: Any, columns: Any) -> Any:
    """Allocate an uninitialised float64 array (rows, columns) on the stack; both sizes are compile-time constants."""
    if not (isinstance(rows, types.IntegerLiteral) and isinstance(columns, types.IntegerLiteral)):
        return None  # Numba reports that no implementation fits
    kind = types.Array(types.float64, 2, "C")
    shape = (rows.literal_value, columns.literal_value)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = cgutils.alloca_once(builder, context.get_value_type(types.float64), size=shape[0] * shape[1])
        data.align = 64  # a cache line: without it the time of a batch varies by 10 %
        array = context.make_array(kind)(context, builder)

        def size(value: int) -> Any:
            return context.get_constant(types.intp, value)

        arrayobj.populate_array(
            array, data=data, shape=[size(s) for s in shape], strides=[size(8 * shape[1]), size(8)],
            itemsize=size(8), meminfo=None,
        )  # fmt: skip
        return array._getvalue()

    return kind(rows, columns), generate


stack: Any = intrinsic(prefer_literal=True)(_stack)


# ---------------- sine


@inlined
def sine_cosine(x: float) -> tuple[float, float]:
    """Return sine and cosine to the last bits for |x| < 1e5, without branches (Cephes: Moshier 1989).

    Shapes and units: x [rad].
    """
    k = np.floor(x * 0.6366197723675814 + 0.5)
    r = fma(-k, 5.39030285815811905e-15, fma(-k, 7.54978941586159635335e-8, fma(-k, 1.57079625129699707031, x)))
    z = r * r
    s = fma(1.58962301576546568060e-10, z, -2.50507477628578072866e-8)
    s = fma(fma(s, z, 2.75573136213857245213e-6), z, -1.98412698295895385996e-4)
    s = fma(fma(s, z, 8.33333333332211858878e-3), z, -1.66666666666666307295e-1)
    s = fma(r * z, s, r)
    c = fma(-1.13585365213876817300e-11, z, 2.08757008419747316778e-9)
    c = fma(fma(c, z, -2.75573141792967388112e-7), z, 2.48015872888517045348e-5)
    c = fma(fma(c, z, -1.38888888888730564116e-3), z, 4.16666666666665929218e-2)
    c = fma(z * z, c, 1.0 - 0.5 * z)
    quadrant = k - 4.0 * np.floor(0.25 * k)
    odd = quadrant == 1.0 or quadrant == 3.0
    sine = c if odd else s
    cosine = s if odd else c
    return (-sine if quadrant >= 2.0 else sine), (-cosine if quadrant == 1.0 or quadrant == 2.0 else cosine)


@inlined
def angle_of(s: float, c: float) -> tuple[float, float]:
    """Return the angle of a sine s ≥ 0 and a cosine, 2 atan(s / (1 + |c|)) by a Chebyshev fit to 1e-13, and angle / s."""
    t = s / (1.0 + abs(c))
    z = t * t
    p = fma(-0.0001124208502549427, z, 0.001018151896826806)
    p = fma(fma(p, z, -0.004344250352224713), z, 0.01174565157426741)
    p = fma(fma(p, z, -0.02299373175968858), z, 0.03563559416944365)
    p = fma(fma(p, z, -0.04713014368368404), z, 0.05688636189885254)
    p = fma(fma(p, z, -0.06615557216560206), z, 0.07682487117587326)
    p = fma(fma(p, z, -0.09089586421532263), z, 0.1111099293745973)
    p = fma(fma(p, z, -0.1428570785015817), z, 0.1999999981481194)
    p = fma(fma(p, z, -0.3333333333121618), z, 0.9999999999999599)
    near = 2.0 * t * p
    angle = near if c >= 0.0 else 3.141592653589793 - near
    return angle, (2.0 * p / (1.0 + c) if c >= 0.0 else angle / max(s, 1e-300))


# ---------------- damped Gauss–Newton iterations in lanes


# Rows of the work array w (ROWS, L) for at most MOST_JOINTS joints, relative to the frame of the first joint at q = 0: the
# configuration Q, the bounds LOW and HIGH of steps, the BEST iterate, sines and cosines of the joint angles.
Q, LOW, HIGH, BEST, SIN, COS = range(0, 6 * MOST_JOINTS, MOST_JOINTS)
AFTER = 6 * MOST_JOINTS
"""First row after those with a value for each joint."""
# Rotation R and position P of the tool; GOAL, the target's rotation by rows (without the tool's) and its position; the
# error twist e, half its square E, and the squares S of its position and rotation parts.
R, P, GOAL, e, E, S = AFTER, AFTER + 9, AFTER + 12, AFTER + 24, AFTER + 30, AFTER + 31
PICKS = AFTER + 33
"""First row of the seeds nearest to the goal, 16 of each of two kinds."""
# Number of the problem, of the attempt, and of the iteration; iterations of all attempts, least E of the attempt, iterations
# without progress; whether steps are clamped, whether a solution was outside the limits, E at BEST, final status, whether an
# attempt begins, whether the lane moves to NEXT, whether it needs a decision, and the held joints, one bit each.
(PROBLEM, ATTEMPT, ITERATION, TOTAL, LEAST_E, STALL, CLAMPED) = range(AFTER + 65, AFTER + 72)
(OUTSIDE, BEST_E, ENDING, BEGINS, MOVED, FLAG, HELD_JOINTS) = range(AFTER + 72, AFTER + 79)
PICKED, NEXT = AFTER + 79, AFTER + 81
"""Rows of the flags whether PICKS are known, for each of two kinds, and of the configuration to which a lane moves."""
LEAST_END, SAME = NEXT + MOST_JOINTS, NEXT + MOST_JOINTS + 1
"""Rows of the least E at the end of an attempt, and of the number of attempts that ended there; see `Ends`."""
ROWS = NEXT + MOST_JOINTS + 2
"""Rows of the work array."""
PUSHED = -1.0
"""Value of HELD_JOINTS for a lane that holds, in each step, the joints that its error pushes out of their bounds."""

# Rows of the geometry g (GEOMETRY, L): joint origins and joint axes. The Jacobian J (6 n, L) is stored by columns.
O, Z, GEOMETRY = 0, 3 * MOST_JOINTS, 6 * MOST_JOINTS
"""First rows of origins and axes, and number of rows, of the geometry."""
NEARLY_HALF_TURN = 9.8695
"""Square of an angle just short of half a turn [rad²]."""


@inlined
def poses(arm: Array, w: Array, g: Array, n: int) -> None:
    """Compute, for the configuration in every lane, the origins and axes of the joints and the frame of the last joint.

    Shapes and units: arm (size,) [as `pack_arm` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
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

    Shapes and units: arm (size,) [as `pack_arm` writes it], w (ROWS, L) [as the rows say] (overwritten).
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
def compute_errors(arm: Array, w: Array, g: Array, n: int) -> None:
    """Compute the forward kinematics and the pose error of the configuration in every lane.

    Shapes and units: arm (size,) [as `pack_arm` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
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
def zero_held_columns(w: Array, J: Array, n: int) -> None:
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

    Shapes and units: arm (size,) [as `pack_arm` writes it], w (ROWS, L) [as the rows say], g (GEOMETRY, L) [m, 1], J (6 * n, L)
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
        zero_held_columns(w, J, n)


@inlined
def normal_matrix(arm: Array, w: Array, A: Array, J: Array, n: int) -> None:
    """Compute the lower triangle of J Jᵀ + λ² I of every lane by rows, with λ² = gain · E + least damping.

    Shapes and units: arm (size,) [as `pack_arm` writes it], w (ROWS, L) [as the rows say], A (21, L) [m²] (overwritten), J
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
def step_lanes(arm: Array, w: Array, g: Array, J: Array, n: int, holding: bool) -> None:
    """Apply one step of every lane: Δq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, clamped to the lane's bounds.

    Shapes and units: arm (size,) [as `pack_arm` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
    (overwritten), J (6 * n, L) [m/rad, 1] (overwritten).
    """
    jacobians(arm, w, g, J, n, holding)
    # the matrix overwrites the geometry, which is not needed any more
    normal_matrix(arm, w, g, J, n)
    factorise(g)
    substitute(w, g, J, n)
