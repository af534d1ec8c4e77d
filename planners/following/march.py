"""March along a path: predict a configuration, correct it by Newton's method, prove the piece between; compiled."""

from __future__ import annotations

from math import asin, sin

import numpy as np

from optik.compiled import compiled
from optik.kinematics import Chain, Range, axis_of, frames, tool_motion, tool_pose
from optik.linear import copy_vector
from optik.newton import derivatives_at, polish
from optik.types import Array
from planners.trajectory.curve import bell

PathNodes = tuple[Array, Array, Array, Array, Array, Array]
"""Nodes s (k,) [m, or rad] of a path, as kernels take them: poses (k, 4, 4) and twists (k, 3, 6) of the path there [1, m,
rad], rows (k, 4, d, n) and values (k, 4, d) of the guide, as for `derivatives_at` [1, rad, m], and bounds (k, 2) on
the fourth derivatives of position and rotation from each node to the next [1/m³, 1/m⁴]."""
LARGEST_STEP = 0.25
"""Largest joint motion from one node to the next [rad or m]."""
LARGEST_CORRECTION = 0.02
"""Largest correction of a predicted configuration [rad or m]; a larger one may lead to another branch."""
REGULAR = 1e-3
"""Above this smallest singular value nodes are exact: rounding of 1e-15 in the pose is 1e-6 / m² in q''. Below it, a step from
regular nodes on both sides passes a singular configuration that the motion goes through smoothly."""
SMALLEST_SINGULAR_VALUE = 1e-6
"""Below this a tool speed of 1 mm/s needs joint speeds above 1,000 rad/s: no motion follows the path node by node."""
ON_PATH = 1e-12
"""Largest error that the corrector may leave [m and rad] in an arm of a metre; rounding leaves about 1e-15."""
DONE, SINGULAR, NOT_MET, TOO_LONG, LOOSE, LIMIT = range(6)
"""Results of a step from one node to the next: accepted; a singular value too small; Newton's method did not converge near the
prediction; a joint moves too far; the proved deviation is too large; a joint exceeds its limit."""


@compiled
def control_points(h: float, q: Array, dq: Array, q1: Array, dq1: Array, b: Array) -> None:
    """Compute the Bézier points of the quintic through two nodes.

    Shapes and units: h [m, or rad], q, q1 (n,) [rad, m], dq, dq1 (3, n) [rad/m, rad/m², rad/m³], b (n, 6) [rad, m].
    """
    for i in range(q.shape[0]):
        b[i, 0] = q[i]
        b[i, 1] = q[i] + h * dq[0, i] / 5.0
        b[i, 2] = q[i] + 2.0 * h * dq[0, i] / 5.0 + h * h * dq[1, i] / 20.0
        b[i, 3] = q1[i] - 2.0 * h * dq1[0, i] / 5.0 + h * h * dq1[1, i] / 20.0
        b[i, 4] = q1[i] - h * dq1[0, i] / 5.0
        b[i, 5] = q1[i]


@compiled
def piece_bound(chain: Chain, h: float, b: Array, fourth: Array) -> tuple[float, float]:
    """Bound distance and angle between tool and path on a piece whose ends have the path's pose and twist.

    Where pose and twist agree at both ends, the difference e of positions, or of entries of rotations, is that of a
    function and its cubic Hermite interpolant, which is zero: |e| ≤ h⁴/384 · max |e⁗|, singular or not. A joint's
    rotation is a power series in s whose coefficients are bounded by those of exp(Σ mₖ tᵏ/k!), where mₖ bounds the joint's
    k-th derivative; that of a chain by the product; so the tool's fourth derivative is bounded by Bell polynomials.

    Shapes and units: h [m, or rad], b (n, 6) [rad, m], fourth (2,) [1/m³, 1/m⁴]. Returns distance, angle  [m].
    """
    fixed, prismatic, tool = chain[0], chain[1], chain[2]
    n = b.shape[0] if len(chain) == 3 else fixed.shape[0]
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
        of, ratio = axis_of(chain, i)
        for k in range(6):
            d[k] = b[i, k] if len(chain) == 3 else ratio * b[of, k] + chain[3][i, 2]
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
        bell(m, B)
    factor = h * h * h * h / 384.0
    # between rotations by θ, ‖R₁ − R₂‖₂ = 2 sin(θ/2)
    return factor * (p4 + fourth[0]), 2.0 * asin(min(1.0, 0.5 * factor * (B[4] + fourth[1])))


@compiled
def misfit(chain: Chain, q: Array, dq: Array, pose: Array, twist: Array, out: Array) -> None:
    """Compute the deviation of a node from its path: distance, angle as a chord, and the same of the twist.

    Shapes and units: q (n,) [rad, m], dq (3, n) [rad/m, rad/m², rad/m³], pose (4, 4) [m], twist (6,) [1, rad/m], out (4,)
    [m, 1, 1, 1/m].
    """
    frame, T, tool = np.empty((chain[0].shape[0], 4, 4)), np.empty((4, 4)), np.empty((3, 6))
    frames(chain, q, frame)
    tool_pose(chain, frame, T)
    tool_motion(chain, frame, T, q, dq, tool)
    for k in range(4):
        out[k] = 0.0
    for r in range(3):
        out[0] += (T[r, 3] - pose[r, 3]) ** 2
        out[2] += (tool[0, r] - twist[r]) ** 2
        out[3] += (tool[0, 3 + r] - twist[3 + r]) ** 2
        for c in range(3):
            out[1] += 0.5 * (T[r, c] - pose[r, c]) ** 2  # ‖R₁ − R₂‖_F = 2 √2 sin(θ/2)
    turned = 0.0  # Ṙ = [ω]R at both: ‖Ṙ₁ − Ṙ₂‖ ≤ |ω₁ − ω₂| + |ω| ‖R₁ − R₂‖
    for r in range(3):
        turned += twist[3 + r] ** 2
    for k in range(4):
        out[k] = np.sqrt(out[k])
    out[3] += np.sqrt(turned) * out[1]


@compiled
def widen_bound(bound: tuple[float, float], h: float, left: Array, right: Array) -> tuple[float, float]:
    """Widen a `piece_bound` by the deviation of its ends.

    The cubic Hermite interpolant of e is not zero then; it is at most max |e| + 4/27 h (|e'| + |e'|) at the ends.

    Shapes and units: bound [m], h [m, or rad], left, right (4,) [m, 1, 1, 1/m]. Returns distance, angle  [m].
    """
    far = max(left[0], right[0]) + 4.0 / 27.0 * h * (left[2] + right[2])
    turn = max(left[1], right[1]) + 4.0 / 27.0 * h * (left[3] + right[3])
    return bound[0] + far, 2.0 * asin(min(1.0, sin(0.5 * bound[1]) + 0.5 * turn))


@compiled
def pieces_bound(
    chain: Chain, s: Array, q: Array, dq: Array, poses: Array, twists: Array,
    fourth: Array, out: Array,
) -> None:  # fmt: skip
    """Bound distance and angle between tool and path on all pieces between nodes, which may deviate from the path.

    Shapes and units: s (k,) [m, or rad], q (k, n) [rad, m], dq (k, 3, n) [rad/m, rad/m², rad/m³], poses (k, 4, 4) [m], twists
    (k, 6) [1, rad/m], fourth (k, 2) [1/m³, 1/m⁴], out (k - 1, 2) [m, rad].
    """
    b, left, right = np.empty((q.shape[1], 6)), np.empty(4), np.empty(4)
    misfit(chain, q[0], dq[0], poses[0], twists[0], right)
    for i in range(s.shape[0] - 1):
        copy_vector(right, left)
        misfit(chain, q[i + 1], dq[i + 1], poses[i + 1], twists[i + 1], right)
        h = s[i + 1] - s[i]
        control_points(h, q[i], dq[i], q[i + 1], dq[i + 1], b)
        out[i, 0], out[i, 1] = widen_bound(piece_bound(chain, h, b, fourth[i]), h, left, right)


@compiled
def find_exit(points: Array, low: float, high: float) -> float:
    """Return the fraction of a quintic at which it first leaves an interval; 2 if it does not.

    By bisection: a part whose Bézier points are all inside is inside; other parts shorter than 1e-9 count as outside.

    Shapes and units: points (6,) [rad, or m], low, high [rad, or m]. Returns [1].
    """
    lowest, highest = np.inf, -np.inf
    for k in range(6):
        lowest, highest = min(lowest, points[k]), max(highest, points[k])
    if lowest >= low and highest <= high:
        return 2.0
    stack, ends = np.empty((64, 6)), np.empty((64, 2))
    left, right = np.empty(6), np.empty(6)
    copy_vector(points, stack[0])
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
        copy_vector(right, stack[top])
        ends[top, 0], ends[top, 1] = middle, c
        copy_vector(left, stack[top + 1])
        ends[top + 1, 0], ends[top + 1, 1] = a, middle
        top += 2
    return 2.0


@compiled
def _predict(h: float, q: Array, dq: Array, ahead: Array, b: Array) -> float:
    """Write the configuration a step h ahead of q (n,) into ahead (n,) and the first column of b; return the largest motion."""
    largest = 0.0
    for i in range(q.shape[0]):
        step = h * (dq[0, i] + 0.5 * h * (dq[1, i] + h * dq[2, i] / 3.0))
        ahead[i] = q[i] + step
        b[i, 0] = ahead[i]
        largest = max(largest, abs(step), abs(h * dq[0, i]))
    return largest


@compiled
def _find_first_limit(b: Array, limits: Range) -> tuple[float, int]:
    """Return the fraction of a step at which the quintics b (n, 6) first exceed a limit, and the joint; −1 if none does."""
    lower, upper = limits
    first, joint = 2.0, -1
    for i in range(b.shape[0]):
        u = find_exit(b[i], lower[i], upper[i])
        if u < first:
            first, joint = u, i
    return first, joint


@compiled
def _check_correction(q: Array, ahead: Array, worst: float, pose: Array, b: Array) -> tuple[int, int]:
    """Return the code of a correction from the prediction b to ahead (n,), DONE, NOT_MET or TOO_LONG, and the joint."""
    reach, largest = 1.0, 0.0
    for r in range(3):
        reach = max(reach, abs(pose[r, 3]))
    for i in range(q.shape[0]):
        largest = max(largest, abs(ahead[i] - b[i, 0]))
    if not worst <= ON_PATH * reach or not largest <= LARGEST_CORRECTION:
        return NOT_MET, 0
    for i in range(q.shape[0]):
        if not abs(ahead[i] - q[i]) <= LARGEST_STEP:
            return TOO_LONG, i
    return DONE, 0


@compiled
def march(
    chain: Chain, limits: Range, nodes: PathNodes, tolerance: Array, least: float, q: Array, dq: Array, singular: Array
) -> tuple[int, int, float, int]:  # fmt: skip
    """March from q[0], dq[0] at the first node from node to node until a step is rejected.

    A step is accepted if the corrected configuration is on the path, near the predicted one and without a large joint
    motion, its smallest singular value is at least the least, and the quintic between is proved to stay on the path within
    the tolerance and inside the limits.

    Shapes and units: tolerance (2,) [m], q, dq, singular (k, n) [rad, m]. Returns figure  [1].
    """
    s, poses, twists, rows, values, fourth = nodes
    b = np.empty((q.shape[1], 6))
    for k in range(s.shape[0] - 1):
        h, ahead = s[k + 1] - s[k], q[k + 1]
        if not _predict(h, q[k], dq[k], ahead, b) <= LARGEST_STEP:
            return k + 1, TOO_LONG, 0.0, 0
        worst, rank = polish(chain, poses[k + 1], rows[k + 1, 0], values[k + 1, 0], 8, ahead)
        code, joint = _check_correction(q[k], ahead, worst, poses[k + 1], b)
        if code != DONE:
            return k + 1, code, worst if code == NOT_MET else 0.0, joint
        rank, singular[k + 1] = derivatives_at(
            chain, ahead, twists[k + 1], rows[k + 1], values[k + 1], dq[k + 1], least
        )
        if not singular[k + 1] >= least or rank == 0.0:
            return k + 1, SINGULAR, singular[k + 1], 0
        control_points(h, q[k], dq[k], ahead, dq[k + 1], b)
        distance, angle = piece_bound(chain, h, b, fourth[k])
        if not (distance <= tolerance[0] and angle <= tolerance[1]):
            return k + 1, LOOSE, max(distance / tolerance[0], angle / tolerance[1]), 0
        first, joint = _find_first_limit(b, limits)
        if joint >= 0:
            return k + 1, LIMIT, first, joint
    return s.shape[0], DONE, 0.0, 0


@compiled
def largest_motion(q: Array, other: Array) -> float:
    """Return the largest joint motion between two configurations; three NumPy calls take five times as long.

    Shapes and units: q, other (n,) [rad, m]. Returns [rad or m].
    """
    largest = 0.0
    for i in range(len(q)):
        largest = max(largest, abs(q[i] - other[i]))
    return largest


@compiled
def find_limit_exit(s: Array, q: Array, dq: Array, lower: Array, upper: Array, joint: int) -> float:
    """Return s at which a joint of the quintics through nodes first leaves its limits; infinite if it does not.

    Shapes and units: s (k,) [m, or rad], q (k, n) [rad, m], dq (k, 3, n) [rad/m, rad/m², rad/m³], lower, upper (n,) [rad, m].
    Returns [m, or rad].
    """
    b = np.empty((q.shape[1], 6))
    for k in range(s.shape[0] - 1):
        h = s[k + 1] - s[k]
        control_points(h, q[k], dq[k], q[k + 1], dq[k + 1], b)
        u = find_exit(b[joint], lower[joint], upper[joint])
        if u <= 1.0:
            return float(s[k] + u * h)
    return np.inf
