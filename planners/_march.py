"""March along a path: predict a configuration, correct it by Newton, prove the piece between; compiled."""

from __future__ import annotations

from math import asin

import numpy as np
from numpy.typing import NDArray

from optik._compile import compiled
from optik.kinematics import derivatives_at, put_on

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LARGEST_STEP = 0.25
"""Largest joint motion from one node to the next [rad or m]."""

LARGEST_CORRECTION = 0.02
"""Largest correction of a predicted configuration [rad or m]; more might be another branch."""

SMALLEST_SINGULAR_VALUE = 1e-4
"""Below this the joint speed for a tool speed of 1 m/s passes 10,000 rad/s: no motion follows the path there."""

ON_PATH = 1e-12
"""Error that the corrector must come down to [m and rad] in an arm of a metre; rounding leaves some 1e-15."""

# How a step from one node to the next ended.
DONE, SINGULAR, NOT_MET, TOO_LONG, LOOSE, LIMIT = range(6)


@compiled
def control_points(h: float, q: Array, dq: Array, q1: Array, dq1: Array, b: Array) -> None:
    """Bézier points (n, 6) of the quintic with values q, q1 (n,) and derivatives dq, dq1 (3, n) at its ends, h apart."""
    for i in range(q.shape[0]):
        b[i, 0] = q[i]
        b[i, 1] = q[i] + h * dq[0, i] / 5.0
        b[i, 2] = q[i] + 2.0 * h * dq[0, i] / 5.0 + h * h * dq[1, i] / 20.0
        b[i, 3] = q1[i] - 2.0 * h * dq1[0, i] / 5.0 + h * h * dq1[1, i] / 20.0
        b[i, 4] = q1[i] - h * dq1[0, i] / 5.0
        b[i, 5] = q1[i]


@compiled
def piece_bound(fixed: Array, prismatic: Bools, tool: Array, h: float, b: Array, fourth: Array) -> tuple[float, float]:
    """Proved bounds on distance [m] and angle [rad] between tool and path on a piece with Bézier points b (n, 6).

    Where pose, twist and its derivative agree at both ends, the difference e of positions, or of entries of rotations,
    is that of a function and its Hermite interpolant: |e| ≤ h⁴/384 · max |e⁗|. A joint's rotation is a power series in s
    whose coefficients are bounded by those of exp(Σ mₖ tᵏ/k!), where mₖ bounds the joint's k-th derivative; that of a
    chain by the product; so the tool's fourth derivative is bounded by Bell polynomials. fourth (2,) holds bounds on the
    path's own, of position and rotation.
    """
    n = b.shape[0]
    m = np.zeros(5)  # Σ over the joints so far of the bounds on |θ⁽ᵏ⁾|
    d, x = np.empty(6), np.zeros(5)
    B = np.zeros(5)  # bounds on the derivatives of the chain's rotation so far
    B[0] = 1.0
    p4 = 0.0
    for i in range(n + 1):
        # the vector from frame i − 1 to frame i (or the tool) is fixed in frame i − 1, which B describes
        x0, y0, z0 = (fixed[i, 0, 3], fixed[i, 1, 3], fixed[i, 2, 3]) if i < n else (tool[0, 3], tool[1, 3], tool[2, 3])
        p4 += B[4] * np.sqrt(x0 * x0 + y0 * y0 + z0 * z0)
        if i == n:
            break
        for k in range(6):
            d[k] = b[i, k]
        scale = 1.0
        for k in range(5):  # the derivative's Bézier points are differences: they bound it
            x[k] = 0.0
            for j in range(6 - k):
                x[k] = max(x[k], abs(d[j]))
            x[k] *= scale
            for j in range(5 - k):
                d[j] = d[j + 1] - d[j]
            scale *= (5.0 - k) / h
        if prismatic[i]:
            p4 += x[0] * B[4] + 4.0 * x[1] * B[3] + 6.0 * x[2] * B[2] + 4.0 * x[3] * B[1] + x[4] * B[0]
            continue
        for k in range(1, 5):
            m[k] += x[k]
        B[1] = m[1]
        B[2] = m[1] * m[1] + m[2]
        B[3] = m[1] * m[1] * m[1] + 3.0 * m[1] * m[2] + m[3]
        B[4] = m[1] * m[1] * m[1] * m[1] + 6.0 * m[1] * m[1] * m[2] + 3.0 * m[2] * m[2] + 4.0 * m[1] * m[3] + m[4]
    share = h * h * h * h / 384.0
    # between rotations by θ, ‖R₁ − R₂‖₂ = 2 sin(θ/2)
    return share * (p4 + fourth[0]), 2.0 * asin(min(1.0, 0.5 * share * (B[4] + fourth[1])))


@compiled
def pieces_bound(
    fixed: Array, prismatic: Bools, tool: Array, s: Array, q: Array, dq: Array, fourth: Array, out: Array
) -> None:  # fmt: skip
    """`piece_bound` of all pieces between nodes s (k,), into out (k − 1, 2); fourth (k, 2) counts from each node on."""
    b = np.empty((q.shape[1], 6))
    for i in range(s.shape[0] - 1):
        h = s[i + 1] - s[i]
        control_points(h, q[i], dq[i], q[i + 1], dq[i + 1], b)
        out[i, 0], out[i, 1] = piece_bound(fixed, prismatic, tool, h, b, fourth[i])


@compiled
def first_exit(points: Array, low: float, high: float) -> float:
    """First u in [0, 1] where a quintic with these Bézier points (6,) is outside [low, high]; 2 where it never is.

    By halving: a part whose points are all inside is inside; parts shorter than 1e-9 that are not count as outside.
    """
    stack, ends = np.empty((64, 6)), np.empty((64, 2))
    left, right = np.empty(6), np.empty(6)
    stack[0, :] = points
    ends[0, 0], ends[0, 1] = 0.0, 1.0
    top = 1
    while top > 0:
        top -= 1
        a, c = ends[top, 0], ends[top, 1]
        least, most = np.inf, -np.inf
        for k in range(6):
            right[k] = stack[top, k]
            least, most = min(least, right[k]), max(most, right[k])
        if least >= low and most <= high:
            continue
        if c - a < 1e-9 or not low <= right[0] <= high:
            return float(a)
        for k in range(6):  # de Casteljau
            left[k] = right[0]
            for j in range(5 - k):
                right[j] = 0.5 * (right[j] + right[j + 1])
        middle = 0.5 * (a + c)
        # right now holds, backwards, the points of the second half
        stack[top, :] = right
        ends[top, 0], ends[top, 1] = middle, c
        stack[top + 1, :] = left
        ends[top + 1, 0], ends[top + 1, 1] = a, middle
        top += 2
    return 2.0


@compiled
def march(
    fixed: Array, prismatic: Bools, tool: Array, lower: Array, upper: Array, s: Array, poses: Array, twists: Array,
    rows: Array, values: Array, fourth: Array, tolerance: Array, q: Array, dq: Array, singular: Array,
) -> tuple[int, int, float, int]:  # fmt: skip
    """Go from q[0], dq[0] at s[0] to every next node, as far as each step is good.

    A step is good where the corrected configuration is on the path, near what was predicted and no large joint motion
    away, the Jacobian keeps its rank, the quintic between is proved to be on the path within the tolerance, and inside
    the limits all along.

    Parameters
    ----------
    fixed, prismatic, tool
        The arm.
    lower, upper : (n,) array
        Limits, slack included.
    s, poses, twists : (k,), (k, 4, 4), (k, 3, 6) array
        Nodes and the path there.
    rows, values : (k, 4, d, n), (k, 4, d) array
        As `derivatives_at` takes them, at the nodes.
    fourth : (k, 2) array
        Bounds on the fourth derivatives of the path's position and rotation, from each node to the next.
    tolerance : (2,) array
        Largest bound on distance [m] and angle [rad].
    q, dq, singular : (k, n), (k, 3, n), (k,) array
        Written; the first of each is given.

    Returns
    -------
    tuple
        Number of good nodes; how the step after them ended (DONE where all are good); how many times the bound was too
        large, or where in the step a limit is passed (0 to 1), or the error that Newton left; and which joint.
    """
    n, largest = q.shape[1], 0.0
    b = np.empty((n, 6))
    for k in range(s.shape[0] - 1):
        h = s[k + 1] - s[k]
        largest = 0.0
        for i in range(n):
            step = h * (dq[k, 0, i] + 0.5 * h * (dq[k, 1, i] + h * dq[k, 2, i] / 3.0))
            q[k + 1, i] = q[k, i] + step
            b[i, 0] = q[k + 1, i]
            largest = max(largest, abs(step), abs(h * dq[k, 0, i]))
        if not largest <= LARGEST_STEP:
            return k + 1, TOO_LONG, 0.0, 0
        reach = 1.0
        for r in range(3):
            reach = max(reach, abs(poses[k + 1, r, 3]))
        worst, rank = put_on(fixed, prismatic, tool, poses[k + 1], rows[k + 1, 0], values[k + 1, 0], 8, q[k + 1])
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(q[k + 1, i] - b[i, 0]))
        if not worst <= ON_PATH * reach or not largest <= LARGEST_CORRECTION:
            return k + 1, NOT_MET, worst, 0
        for i in range(n):
            if not abs(q[k + 1, i] - q[k, i]) <= LARGEST_STEP:
                return k + 1, TOO_LONG, 0.0, i
        rank, singular[k + 1] = derivatives_at(
            fixed, prismatic, tool, q[k + 1], twists[k + 1], rows[k + 1], values[k + 1], dq[k + 1]
        )
        if not singular[k + 1] >= SMALLEST_SINGULAR_VALUE or rank == 0.0:
            return k + 1, SINGULAR, singular[k + 1], 0
        control_points(h, q[k], dq[k], q[k + 1], dq[k + 1], b)
        distance, angle = piece_bound(fixed, prismatic, tool, h, b, fourth[k])
        if not (distance <= tolerance[0] and angle <= tolerance[1]):
            return k + 1, LOOSE, max(distance / tolerance[0], angle / tolerance[1]), 0
        first, joint = 2.0, -1
        for i in range(n):
            u = first_exit(b[i], lower[i], upper[i])
            if u < first:
                first, joint = u, i
        if joint >= 0:
            return k + 1, LIMIT, first, joint
    return s.shape[0], DONE, 0.0, 0


@compiled
def leaves(s: Array, q: Array, dq: Array, lower: Array, upper: Array, joint: int) -> float:
    """Where a joint of the quintics through nodes s (k,) first stands outside its limits; infinity where it never does."""
    b = np.empty((q.shape[1], 6))
    for k in range(s.shape[0] - 1):
        h = s[k + 1] - s[k]
        control_points(h, q[k], dq[k], q[k + 1], dq[k + 1], b)
        u = first_exit(b[joint], lower[joint], upper[joint])
        if u <= 1.0:
            return float(s[k] + u * h)
    return np.inf
