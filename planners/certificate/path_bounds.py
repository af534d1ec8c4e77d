"""Distance and angle between tool and path, and their bounds within intervals of time; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Flags
from planners.certificate.bounds import bezier_bound, joint_bounds, tool_bounds
from planners.paths.base import Path


class ComparedInstants(NamedTuple):
    """Tool and path at instants t (k,).

    ``joints`` (k, 6, n), ``poses`` (k, 4, 4) and ``motion`` (k, 3, 6) are those of `Instants`. ``s`` (k,) are the
    path parameters of the tool, ``speed`` (k,) is ṡ, ``path_poses`` (k, 4, 4) and ``twist`` (k, 6) are those of the path.
    """

    t: Array
    joints: Array
    poses: Array
    motion: Array
    s: Array
    speed: Array
    path_poses: Array
    twist: Array


@compiled
def _turn(A: Array, B: Array, out: Array) -> None:
    """Compute E = R_tool R_pathᵀ of two poses, into out (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]


@compiled
def _angle(norm: float) -> float:
    """Return the angle of a rotation E from ‖E − I‖ (Frobenius), which is 2√2 sin(angle / 2)."""
    return float(2.0 * np.arcsin(min(norm / (2.0 * np.sqrt(2.0)), 1.0)))


@compiled
def _error(tool: Array, motion: Array, pose: Array, twist: Array, speed: float, value: Array, rate: Array) -> None:
    """Compute the errors (12,) of position and of rotation, E − I, and their rates, for a speed along the path."""
    E = np.empty((3, 3))
    _turn(tool, pose, E)
    for i in range(3):
        value[i] = tool[i, 3] - pose[i, 3]
        rate[i] = motion[0, i] - speed * twist[i]
    w = (motion[0, 3], motion[0, 4], motion[0, 5])
    p = (speed * twist[3], speed * twist[4], speed * twist[5])
    for i in range(3):  # Ė = ω × E − E (ω_path ×)
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            value[3 + 3 * i + j] = E[i, j] - (1.0 if i == j else 0.0)
            rate[3 + 3 * i + j] = w[a] * E[b, j] - w[b] * E[a, j] - (E[i, c] * p[d] - E[i, d] * p[c])


class PieceBounds(NamedTuple):
    """Bounds (m, 2, 4) on a path's derivatives, position and rotation, on the m pieces between its breaks (m + 1,)."""

    breaks: Array
    bounds: Array

    @classmethod
    def of(cls, path: Path) -> PieceBounds:
        """Return the bounds of a path."""
        return cls(np.ascontiguousarray(path.breaks), path.known_bounds)


@compiled
def _bounds_on_stretch(limits: PieceBounds, low: float, high: float, out: Array) -> None:
    """Compute bounds (2, 4) on the path's derivatives between two positions: the largest of the pieces between them."""
    last = limits.bounds.shape[0] - 1
    first = min(max(np.searchsorted(limits.breaks, low) - 1, 0), last)
    final = min(max(np.searchsorted(limits.breaks, high, side="right") - 1, 0), last)
    for part in range(2):
        for k in range(4):
            out[part, k] = 0.0
            for i in range(first, final + 1):
                out[part, k] = max(out[part, k], limits.bounds[i, part, k])


@compiled
def path_rates(
    limits: PieceBounds, places: tuple[float, float], speeds: tuple[float, float], h: float, out: Array
) -> None:
    """Compute bounds on the time derivatives of a path's position and rotation for a cubic s(t) over h (Faà di Bruno).

    s(t) is given by its ends; its Bézier points bound its range.

    Shapes and units: places, speeds (2,) [m, or rad], h [s], out (2, 5) [m/s^i].
    """
    (s0, s1), (v0, v1) = places, speeds
    slope = (s1 - s0) / h
    a0, a1 = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, (2.0 * v0 + 4.0 * v1 - 6.0 * slope) / h
    j = abs(a1 - a0) / h
    v = max(abs(v0), abs(v1)) + j * h * h / 8.0
    a = max(abs(a0), abs(a1))
    b = np.empty((2, 4))
    p, q = s0 + v0 * h / 3.0, s1 - v1 * h / 3.0
    _bounds_on_stretch(limits, min(s0, p, q, s1), max(s0, p, q, s1), b)
    for part in range(2):
        b1, b2, b3, b4 = b[part, 0], b[part, 1], b[part, 2], b[part, 3]
        out[part, 0] = 1.0
        out[part, 1] = b1 * v
        out[part, 2] = b1 * a + b2 * v * v
        out[part, 3] = b1 * j + 3.0 * b2 * v * a + b3 * v**3
        out[part, 4] = b2 * (4.0 * v * j + 3.0 * a * a) + 6.0 * b3 * v * v * a + b4 * v**4


@compiled
def _clip_speed(v: float, before: float, after: float, h: float) -> float:
    """Return a rate of s, clipped so that the Bézier points of its cubic stay on the path (lengths before and after)."""
    return min(max(v, -3.0 * before / h), 3.0 * after / h)


@compiled
def intervals(
    links: Array,
    prismatic: Flags,
    limits: PieceBounds,
    end: float,
    left: ComparedInstants,
    right: ComparedInstants,
    out: Array,
    fall: Array,
) -> None:
    """Compute bounds on distance and angle within intervals of time; s(t) is the cubic through their ends.

    Shapes and units: links (n + 1,) [m], prismatic (n,), end [m, or rad], out (k, 2) [m, rad], fall (k, 2) [m, or rad].
    """
    k = left.t.shape[0]
    h = right.t - left.t
    D, moves, turns, spin = np.empty(left.joints.shape), np.empty((k, 6)), np.empty((k, 6)), np.empty(k)
    joint_bounds(left.joints, h, D)
    tool_bounds(links, prismatic, D, moves, turns, spin)
    e0, r0, e1, r1, b = np.empty(12), np.empty(12), np.empty(12), np.empty(12), np.empty((2, 5))
    for i in range(k):
        v0 = _clip_speed(left.speed[i], left.s[i], end - left.s[i], h[i])
        v1 = _clip_speed(right.speed[i], end - right.s[i], right.s[i], h[i])
        _error(left.poses[i], left.motion[i], left.path_poses[i], left.twist[i], v0, e0, r0)
        _error(right.poses[i], right.motion[i], right.path_poses[i], right.twist[i], v1, e1, r1)
        path_rates(limits, (left.s[i], right.s[i]), (v0, v1), h[i], b)
        fall[i, 0], fall[i, 1] = _fall(left.s[i], v0 * h[i], right.s[i], v1 * h[i])
        fourth = moves[i, 4] + b[0, 4]
        out[i, 0] = bezier_bound(e0[:3], r0[:3], e1[:3], r1[:3], h[i], fourth)
        fourth = product_bound(turns[i], b[1])
        out[i, 1] = _angle(bezier_bound(e0[3:], r0[3:], e1[3:], r1[3:], h[i], fourth))


@compiled
def product_bound(a: Array, b: Array) -> float:
    """Return a bound on the Frobenius norm of the fourth derivative of R_tool R_pathᵀ.

    Shapes and units: a, b (5,) [1/s^i]. Returns [1/s⁴].
    """
    fourth = a[0] * b[4] + 4.0 * a[1] * b[3] + 6.0 * a[2] * b[2] + 4.0 * a[3] * b[1] + a[4] * b[0]
    return float(np.sqrt(3.0) * fourth)  # of a 3×3 matrix


@compiled
def _fall(s0: float, v0: float, s1: float, v1: float) -> tuple[float, float]:
    """Return the ends of the longest backward stretch of the cubic with these values and slopes at 0 and 1; equal if none."""
    c3, c2 = 2.0 * (s0 - s1) + v0 + v1, 3.0 * (s1 - s0) - 2.0 * v0 - v1
    root = c2 * c2 - 3.0 * c3 * v0
    turns = (0.0, 1.0)  # turning points in order: the roots of 3 c₃ u² + 2 c₂ u + v₀
    if root > 0.0 and c2 + np.copysign(np.sqrt(root), c2) != 0.0:
        w = -(c2 + np.copysign(np.sqrt(root), c2))
        a, b = v0 / w, (w / (3.0 * c3) if c3 != 0.0 else 2.0)
        turns = (min(a, b), max(a, b))
    top = high = low = s0
    for u in (turns[0], turns[1], 1.0):
        if not 0.0 < u <= 1.0:
            continue
        s = s1 if u == 1.0 else s0 + u * (v0 + u * (c2 + u * c3))
        top = max(top, s)
        if top - s > high - low:
            high, low = top, s
    return high, low
