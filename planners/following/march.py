"""March along a path: predict a configuration, correct it by Newton, prove the piece between; compiled."""

from __future__ import annotations

from math import asin, sin

import numpy as np

from optik.compiled import compiled
from optik.kinematics import Chain, derivatives_at, frames, put_on, tool_motion, tool_pose
from optik.types import Array

LARGEST_STEP = 0.25
"""Largest joint motion from one node to the next [rad or m]."""

LARGEST_CORRECTION = 0.02
"""Largest correction of a predicted configuration [rad or m]; more might be another branch."""

REGULAR = 1e-3
"""Above this smallest singular value nodes are exact: 1e-15 of rounding in the pose is 1e-6 / m² in q''. Below it a motion
that goes through the singular configuration smoothly is stepped over from the regular nodes on both sides."""

SMALLEST_SINGULAR_VALUE = 1e-6
"""Below this the joint speed for a tool speed of 1 mm/s passes 1,000 rad/s: no motion follows the path node by node."""

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
def piece_bound(chain: Chain, h: float, b: Array, fourth: Array) -> tuple[float, float]:
    """Proved bounds on distance [m] and angle [rad] between tool and path on a piece with Bézier points b (n, 6).

    Where pose and twist agree at both ends, the difference e of positions, or of entries of rotations, is that of a
    function and its cubic Hermite interpolant, which is zero: |e| ≤ h⁴/384 · max |e⁗|, singular or not. A joint's
    rotation is a power series in s whose coefficients are bounded by those of exp(Σ mₖ tᵏ/k!), where mₖ bounds the joint's
    k-th derivative; that of a chain by the product; so the tool's fourth derivative is bounded by Bell polynomials.
    fourth (2,) holds bounds on the path's own, of position and rotation.
    """
    fixed, prismatic, tool = chain
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
def misfit(chain: Chain, q: Array, dq: Array, pose: Array, twist: Array, out: Array) -> None:
    """How far a node is off its path: distance, angle as a chord, and the same of the twist, into out (4,)."""
    n = q.shape[0]
    frame, T, made = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((3, 6))
    frames(chain, q, frame)
    tool_pose(chain, frame, T)
    tool_motion(chain, frame, T, q, dq, made)
    for k in range(4):
        out[k] = 0.0
    for r in range(3):
        out[0] += (T[r, 3] - pose[r, 3]) ** 2
        out[2] += (made[0, r] - twist[r]) ** 2
        out[3] += (made[0, 3 + r] - twist[3 + r]) ** 2
        for c in range(3):
            out[1] += 0.5 * (T[r, c] - pose[r, c]) ** 2  # ‖R₁ − R₂‖_F = 2 √2 sin(θ/2)
    turned = 0.0  # Ṙ = [ω]R at both: ‖Ṙ₁ − Ṙ₂‖ ≤ |ω₁ − ω₂| + |ω| ‖R₁ − R₂‖
    for r in range(3):
        turned += twist[3 + r] ** 2
    for k in range(4):
        out[k] = np.sqrt(out[k])
    out[3] += np.sqrt(turned) * out[1]


@compiled
def widened(bound: tuple[float, float], h: float, left: Array, right: Array) -> tuple[float, float]:
    """`piece_bound` of a piece whose ends are off by what `misfit` says.

    The cubic Hermite interpolant of e is not zero then; it is at most max |e| + 4/27 h (|e'| + |e'|) at the ends.
    """
    far = max(left[0], right[0]) + 4.0 / 27.0 * h * (left[2] + right[2])
    turn = max(left[1], right[1]) + 4.0 / 27.0 * h * (left[3] + right[3])
    return bound[0] + far, 2.0 * asin(min(1.0, sin(0.5 * bound[1]) + 0.5 * turn))


@compiled
def pieces_bound(
    chain: Chain, s: Array, q: Array, dq: Array, poses: Array, twists: Array,
    fourth: Array, out: Array,
) -> None:  # fmt: skip
    """`piece_bound` between any nodes s (k,) on a path with these poses and twists (k, 6), into out (k − 1, 2).

    Whatever q and dq are: what the nodes are off counts. fourth (k, 2) counts from each node on.
    """
    b, left, right = np.empty((q.shape[1], 6)), np.empty(4), np.empty(4)
    misfit(chain, q[0], dq[0], poses[0], twists[0], right)
    for i in range(s.shape[0] - 1):
        left[:] = right
        misfit(chain, q[i + 1], dq[i + 1], poses[i + 1], twists[i + 1], right)
        h = s[i + 1] - s[i]
        control_points(h, q[i], dq[i], q[i + 1], dq[i + 1], b)
        out[i, 0], out[i, 1] = widened(piece_bound(chain, h, b, fourth[i]), h, left, right)


@compiled
def first_exit(points: Array, low: float, high: float) -> float:
    """First u in [0, 1] where a quintic with these Bézier points (6,) is outside [low, high]; 2 where it never is.

    By halving: a part whose points are all inside is inside; parts shorter than 1e-9 that are not count as outside.
    """
    lowest, highest = np.inf, -np.inf
    for k in range(6):
        lowest, highest = min(lowest, points[k]), max(highest, points[k])
    if lowest >= low and highest <= high:
        return 2.0
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
    chain: Chain, lower: Array, upper: Array, s: Array, poses: Array, twists: Array,
    rows: Array, values: Array, fourth: Array, tolerance: Array, least: float, q: Array, dq: Array, singular: Array,
) -> tuple[int, int, float, int]:  # fmt: skip
    """Go from q[0], dq[0] at s[0] to every next node, as far as each step is good.

    A step is good where the corrected configuration is on the path, near what was predicted and no large joint motion
    away, the smallest singular value there is not below the least, the quintic between is proved to be on the path within
    the tolerance, and inside the limits all along.

    Parameters
    ----------
    chain
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
    least : float
        Smallest singular value that a node may have.
    q, dq, singular : (k, n), (k, 3, n), (k,) array
        Written; the first of each is given. Singular values are lower bounds where those are not below the least.

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
        worst, rank = put_on(chain, poses[k + 1], rows[k + 1, 0], values[k + 1, 0], 8, q[k + 1])
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(q[k + 1, i] - b[i, 0]))
        if not worst <= ON_PATH * reach or not largest <= LARGEST_CORRECTION:
            return k + 1, NOT_MET, worst, 0
        for i in range(n):
            if not abs(q[k + 1, i] - q[k, i]) <= LARGEST_STEP:
                return k + 1, TOO_LONG, 0.0, i
        rank, singular[k + 1] = derivatives_at(
            chain, q[k + 1], twists[k + 1], rows[k + 1], values[k + 1], dq[k + 1], least
        )
        if not singular[k + 1] >= least or rank == 0.0:
            return k + 1, SINGULAR, singular[k + 1], 0
        control_points(h, q[k], dq[k], q[k + 1], dq[k + 1], b)
        distance, angle = piece_bound(chain, h, b, fourth[k])
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
def farthest(q: Array, other: Array) -> float:
    """Largest joint motion between two configurations; three NumPy calls take five times as long."""
    largest = 0.0
    for i in range(len(q)):
        largest = max(largest, abs(q[i] - other[i]))
    return largest


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
