"""Bounds on the distance and the angle between a tool and its path within intervals of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import bezier_bound, joint_bounds, tool_bounds
from planners.paths.base import Path

JOINT_ROUNDING = 2e-15
"""Largest rounding error of a joint's difference from its path, as a fraction of the joint's position."""


Arm = tuple[Array, Flags]
"""Lengths (n + 1,) of the links [m], and which joints are prismatic (n,)."""
Ends = tuple[Indices, Indices]
"""Indices (k,) of the instants at which intervals begin, and of those at which they end."""


class ComparedInstants(NamedTuple):
    """A motion compared with its path at instants t (k,).

    ``joints`` (k, 6, n) are those of `Instants`. ``s`` (k,) are the path parameters of the tool, ``speed`` (k,) is ṡ, and
    ``path_joints`` are those of `planners.certificate.projection.PathPositions`. ``error`` (k, 3, 12) is that of `compare`.
    """

    t: Array
    joints: Array
    s: Array
    speed: Array
    path_joints: Array
    error: Array


@compiled
def _angle(norm: float) -> float:
    """Return the angle of a rotation E from ‖E − I‖ (Frobenius), which is 2√2 sin(angle / 2)."""
    return float(2.0 * np.arcsin(min(norm / (2.0 * np.sqrt(2.0)), 1.0)))


@compiled
def compare(poses: Array, motion: Array, path_poses: Array, twist: Array, error: Array, off: Array) -> None:
    """Compute the errors of tool poses from path poses, and their distances and angles.

    The position error and the rotation error E − I, with E = R_tool R_pathᵀ, are the first row of ``error``. The second row
    is its time derivative for a path at standstill, the third what each unit of ṡ adds to that.

    Shapes and units: poses, path_poses (k, 4, 4), motion (k, 3, 6), twist (k, 6), error (k, 3, 12), off (k, 2) [m, rad].
    """
    for k in range(poses.shape[0]):
        A, B, (value, rate, along) = poses[k], path_poses[k], (error[k, 0], error[k, 1], error[k, 2])
        w, p = motion[k, 0, 3:], twist[k, 3:]
        for i in range(3):
            value[i], rate[i], along[i] = A[i, 3] - B[i, 3], motion[k, 0, i], -twist[k, i]
            for j in range(3):
                value[3 + 3 * i + j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]
        E = value[3:].reshape(3, 3)
        for i in range(3):  # Ė = ω × E − E (ω_path ×)
            a, b = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                c, d = (j + 1) % 3, (j + 2) % 3
                rate[3 + 3 * i + j] = w[a] * E[b, j] - w[b] * E[a, j]
                along[3 + 3 * i + j] = E[i, d] * p[c] - E[i, c] * p[d]
        turned = 0.0
        for i in range(3):
            E[i, i] -= 1.0
            for j in range(3):
                turned += (A[i, j] - B[i, j]) ** 2
        off[k, 0] = np.sqrt(value[0] * value[0] + value[1] * value[1] + value[2] * value[2])
        off[k, 1] = _angle(np.sqrt(turned))


class PieceBounds(NamedTuple):
    """Bounds (m, 2, 4) on a path's derivatives, position and rotation, on the m pieces between its breaks (m + 1,)."""

    breaks: Array
    bounds: Array

    @classmethod
    def of(cls, path: Path) -> PieceBounds:
        """Return the bounds on the derivatives of a path."""
        return cls(np.ascontiguousarray(path.breaks), path.known_bounds)


class CubicRates(NamedTuple):
    """Bounds on the derivatives of a cubic s(t) over an interval, and on its range."""

    speed: float
    acceleration: float
    jerk: float
    low: float
    high: float


@compiled
def _cubic_rates(s0: float, v0: float, s1: float, v1: float, h: float) -> CubicRates:
    """Return bounds on the derivatives and the range of the cubic with values s and slopes v at the ends of an interval h."""
    slope = (s1 - s0) / h
    a0, a1 = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, (2.0 * v0 + 4.0 * v1 - 6.0 * slope) / h
    j = abs(a1 - a0) / h
    p, q = s0 + v0 * h / 3.0, s1 - v1 * h / 3.0  # Bézier points
    return CubicRates(
        max(abs(v0), abs(v1)) + j * h * h / 8.0, max(abs(a0), abs(a1)), j, min(s0, p, q, s1), max(s0, p, q, s1)
    )


@compiled
def _find_pieces(breaks: Array, low: float, high: float) -> tuple[int, int]:
    """Return the first and the last piece between breaks (m + 1,) that contain positions from low to high."""
    last = breaks.shape[0] - 2
    first = min(max(np.searchsorted(breaks, low) - 1, 0), last)
    return first, min(max(np.searchsorted(breaks, high, side="right") - 1, 0), last)


@compiled
def _fourth_rate(b2: float, b3: float, b4: float, rates: CubicRates) -> float:
    """Return a bound on the fourth time derivative of a path from bounds on its derivatives in s (Faà di Bruno)."""
    v, a = rates.speed, rates.acceleration
    return b2 * (4.0 * v * rates.jerk + 3.0 * a * a) + 6.0 * b3 * v * v * a + b4 * v**4


@compiled
def path_rates(
    limits: PieceBounds, places: tuple[float, float], speeds: tuple[float, float], h: float, out: Array
) -> None:
    """Compute bounds on the time derivatives of a path's position and rotation for a cubic s(t) over h (Faà di Bruno).

    s(t) is given by its ends.

    Shapes and units: places, speeds (2,) [m, or rad], h [s], out (2, 5) [m/s^i].
    """
    rates = _cubic_rates(places[0], speeds[0], places[1], speeds[1], h)
    v, a = rates.speed, rates.acceleration
    first, final = _find_pieces(limits.breaks, rates.low, rates.high)
    for part in range(2):
        b1, b2, b3, b4 = 0.0, 0.0, 0.0, 0.0
        for i in range(first, final + 1):
            b1, b2 = max(b1, limits.bounds[i, part, 0]), max(b2, limits.bounds[i, part, 1])
            b3, b4 = max(b3, limits.bounds[i, part, 2]), max(b4, limits.bounds[i, part, 3])
        out[part, 0] = 1.0
        out[part, 1] = b1 * v
        out[part, 2] = b1 * a + b2 * v * v
        out[part, 3] = b1 * rates.jerk + 3.0 * b2 * v * a + b3 * v**3
        out[part, 4] = _fourth_rate(b2, b3, b4, rates)


@compiled
def _clip_speed(v: float, before: float, after: float, h: float) -> float:
    """Return a rate of s, clipped so that the Bézier points of its cubic stay on the path (lengths before and after)."""
    return min(max(v, -3.0 * before / h), 3.0 * after / h)


@compiled
def intervals(
    arm: Arm, limits: PieceBounds, end: float, at: ComparedInstants, ends: Ends, out: Array, fall: Array
) -> None:
    """Compute bounds on distance and angle within intervals between instants of `at`; s(t) is the cubic through their ends.

    Shapes and units: end [m, or rad], ends (2,) of (k,), out (k, 2) [m, rad], fall (k, 4) [s; m, or rad].
    """
    (links, prismatic), (left, right) = arm, ends
    D, work, moves, turns = np.empty(at.joints.shape[1:]), np.empty((2, 6)), np.empty(6), np.empty(6)
    b, r0, r1 = np.empty((2, 5)), np.empty(12), np.empty(12)
    for k in range(left.shape[0]):
        i, j = left[k], right[k]
        h, s0, s1 = at.t[j] - at.t[i], at.s[i], at.s[j]
        joint_bounds(at.joints[i], h, D)
        tool_bounds(links, prismatic, D, work, moves, turns)
        v0 = _clip_speed(at.speed[i], s0, end - s0, h)
        v1 = _clip_speed(at.speed[j], end - s1, s1, h)
        e0, e1 = at.error[i, 0], at.error[j, 0]
        for m in range(12):
            r0[m] = at.error[i, 1, m] + v0 * at.error[i, 2, m]
            r1[m] = at.error[j, 1, m] + v1 * at.error[j, 2, m]
        path_rates(limits, (s0, s1), (v0, v1), h, b)
        fall[k] = _fall(s0, v0 * h, s1, v1 * h)
        fall[k, ::2] = at.t[i] + fall[k, ::2] * h
        fourth = moves[4] + b[0, 4]
        out[k, 0] = bezier_bound(e0[:3], r0[:3], e1[:3], r1[:3], h, fourth)
        fourth = product_bound(turns, b[1])
        out[k, 1] = _angle(bezier_bound(e0[3:], r0[3:], e1[3:], r1[3:], h, fourth))


@compiled
def joint_intervals(
    arm: Arm, limits: tuple[Array, Array], end: float, at: ComparedInstants, ends: Ends, out: Array
) -> None:
    """Lower bounds on distance and angle within intervals to those that follow from the errors of the joints, if less.

    A joint that differs by e moves the tool by at most e times its greatest distance from the axis, and turns it by e. Where
    tool and path turn fast together, this bound needs far longer intervals than that of `intervals`.

    Shapes and units: limits breaks (m + 1,) and bounds (m, 4, n) [rad/s^i, m/s^i], end [m, or rad], ends (2,) of (k,), out
    (k, 2) [m, rad].
    """
    (links, prismatic), (left, right) = arm, ends
    n = prismatic.shape[0]
    D, e = np.empty(at.joints.shape[1:]), np.empty(n)
    breaks, bounds = limits
    for k in range(left.shape[0]):
        a0, a1 = left[k], right[k]
        h, s0, s1 = at.t[a1] - at.t[a0], at.s[a0], at.s[a1]
        joint_bounds(at.joints[a0], h, D)
        v0 = _clip_speed(at.speed[a0], s0, end - s0, h)
        v1 = _clip_speed(at.speed[a1], end - s1, s1, h)
        rates = _cubic_rates(s0, v0, s1, v1, h)
        first, final = _find_pieces(breaks, rates.low, rates.high)
        third = h / 3.0
        for j in range(n):
            path = 0.0
            for m in range(first, final + 1):
                path = max(path, _fourth_rate(bounds[m, 1, j], bounds[m, 2, j], bounds[m, 3, j], rates))
            e0 = at.joints[a0, 0, j] - at.path_joints[a0, 0, j]
            e1 = at.joints[a1, 0, j] - at.path_joints[a1, 0, j]
            a = e0 + third * (at.joints[a0, 1, j] - v0 * at.path_joints[a0, 1, j])
            b = e1 - third * (at.joints[a1, 1, j] - v1 * at.path_joints[a1, 1, j])
            e[j] = max(abs(e0), abs(e1), abs(a), abs(b)) + (D[4, j] + path) * h**4 / 384.0
            e[j] += JOINT_ROUNDING * D[0, j]
        reach, distance, angle = links[n], 0.0, 0.0
        for j in range(n - 1, -1, -1):
            if prismatic[j]:
                distance += e[j]
                reach += D[0, j] + e[j]
            else:
                distance += reach * e[j]
                angle += e[j]
            reach += links[j]
        out[k, 0], out[k, 1] = min(out[k, 0], distance), min(out[k, 1], angle)


@compiled
def product_bound(a: Array, b: Array) -> float:
    """Return a bound on the Frobenius norm of the fourth derivative of R_tool R_pathᵀ.

    Shapes and units: a, b (5,) [1/s^i]. Returns [1/s⁴].
    """
    fourth = a[0] * b[4] + 4.0 * a[1] * b[3] + 6.0 * a[2] * b[2] + 4.0 * a[3] * b[1] + a[4] * b[0]
    return float(np.sqrt(3.0) * fourth)  # of a 3×3 matrix


@compiled
def _fall(s0: float, v0: float, s1: float, v1: float) -> tuple[float, float, float, float]:
    """Return begin and end of the longest backward stretch of the cubic with these values and slopes at 0 and 1.

    Each is an argument of the cubic and its value there; they are equal if there is no such stretch.
    """
    c3, c2 = 2.0 * (s0 - s1) + v0 + v1, 3.0 * (s1 - s0) - 2.0 * v0 - v1
    root = c2 * c2 - 3.0 * c3 * v0
    turns = (0.0, 1.0)  # turning points in order: the roots of 3 c₃ u² + 2 c₂ u + v₀
    if root > 0.0 and c2 + np.copysign(np.sqrt(root), c2) != 0.0:
        w = -(c2 + np.copysign(np.sqrt(root), c2))
        a, b = v0 / w, (w / (3.0 * c3) if c3 != 0.0 else 2.0)
        turns = (min(a, b), max(a, b))
    peak, top = 0.0, s0
    begin, high, end, low = 0.0, s0, 0.0, s0
    for u in (turns[0], turns[1], 1.0):
        if not 0.0 < u <= 1.0:
            continue
        s = s1 if u == 1.0 else s0 + u * (v0 + u * (c2 + u * c3))
        if s > top:
            peak, top = u, s
        if top - s > high - low:
            begin, high, end, low = peak, top, u, s
    return begin, high, end, low


@compiled
def divide(at: ComparedInstants, ends: Ends, parts: Indices, inner: Array, new: Indices) -> None:
    """Divide intervals between instants of `at` into equal parts: their inner instants, with s on the cubics through the ends.

    Shapes and units: ends (2,) of (k,), parts (k,), inner (2, Σ (parts − 1)) [s; m, or rad], new (2, Σ parts): the instants at
    which the parts begin and end, of `at` followed by the inner ones.
    """
    a, b = 0, 0
    left, right = ends
    for k in range(left.shape[0]):
        i, j = left[k], right[k]
        t0, s0, s1 = at.t[i], at.s[i], at.s[j]
        h = at.t[j] - t0
        for part in range(parts[k]):
            new[0, b], new[1, b] = at.t.shape[0] + a - 1 if part else i, at.t.shape[0] + a
            b += 1
            if part + 1 == parts[k]:
                new[1, b - 1] = j
                break
            u = (part + 1) / parts[k]
            w = 1.0 - u
            before = w * w * ((1.0 + 2.0 * u) * s0 + u * h * at.speed[i])
            inner[0, a] = t0 + u * h
            inner[1, a] = before + u * u * ((1.0 + 2.0 * w) * s1 - w * h * at.speed[j])
            a += 1
