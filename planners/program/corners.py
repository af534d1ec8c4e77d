"""Rounded corners between two curves of the joints: their width, their nodes, and the proof of their deviation."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from optik import se3
from optik.arm.robot import Robot
from optik.types import Array
from planners.following.joint_path import LEAST_SPACING
from planners.paths.joint_curve import JointCurve

MIDDLE = 5.0 / 64.0
"""F(1/2): the fraction of a zone's width that either part is past or before the corner in the middle."""
SEARCH_SAMPLES = 33
"""Samples of a corner in the search of its width."""
NARROW, WIDE, SEARCH_STEPS = 0.96, 0.99, 8
"""The search ends where the largest sample is between these fractions of the zone, or after so many steps."""
PROOF_INTERVALS = 48
"""Intervals of the proof of a corner; even, so that the corner is between two of them."""
PROOF_STEPS, SHRINK, SHRINK_INSIDE = 12, 0.985, 0.65
"""Most narrower corners that are tried; factors of the width where the proof exceeds the zone, and where the corner leaves
the joint limits."""
ZONE_INTERVALS = 8
"""Least number of intervals between the nodes of a corner."""
ON_CURVE = 1e-8
"""Largest distance [rad, m] between the quintic and the curve in the middle of two nodes; else a node is added there."""
MOST_HALVINGS = 8
"""Most times that intervals between nodes are halved."""
LEAST_WIDTH = 1e-4
"""Least width of a zone, as a fraction of the shorter of its parts: a narrower one is a stop."""
REVERSED = 1e-4
"""Norm of the sum of both directions in joint space, each of norm 1, below which the path reverses its direction."""


class Zone(NamedTuple):
    """A rounded corner: half its width in s, nodes (k,) around the corner, joints there (k, 4, n), and its proved deviation."""

    half: float
    s: Array
    joints: Array
    deviation: Array


def reverses(one: JointCurve, two: JointCurve) -> bool:
    """Return whether the second curve goes back where the first one came from."""
    a, b = one.derivatives[-1, 0], two.derivatives[0, 0]
    return bool(np.linalg.norm(a / np.linalg.norm(a) + b / np.linalg.norm(b)) < REVERSED)


def find_half_width(robot: Robot, one: JointCurve, two: JointCurve, zone: Array, most: float) -> float:
    """Return the largest half width, at most a given one, whose samples are inside a zone (2,) [m, rad]."""
    # What remains of two straight motions is 2h F(1/2) (q₂' − q₁') in the middle.
    jump = robot.jacobian(one.q[-1][None])[0] @ (two.derivatives[0, 0] - one.derivatives[-1, 0])
    rate = 2.0 * MIDDLE * np.linalg.norm(jump.reshape(2, 3), axis=1)
    half = min(most, float((zone / np.maximum(rate, 1e-300)).min()))
    u = np.linspace(0.0, 1.0, SEARCH_SAMPLES)
    for _ in range(SEARCH_STEPS):
        ratio = float((_measure_deviation(robot, one, two, half, u).max(axis=0) / zone).max())
        if ratio <= WIDE and (ratio >= NARROW or half >= most):
            break
        half = min(most, half * min(2.0, 0.5 * (NARROW + WIDE) / max(ratio, 1e-9)))
    return half


def build_zone(robot: Robot, one: JointCurve, two: JointCurve, zone: Array, half: float) -> tuple[Zone | None, str]:
    """Return the corner of this half width, or the narrower one that is proved, or None; and why it is narrower."""
    lower, upper, why = robot.limits.lower, robot.limits.upper, ""
    least = LEAST_WIDTH * min(one.end, two.end)
    for _ in range(PROOF_STEPS):
        if half < least:
            break

        def joints(w: Array, h: float = half) -> Array:
            return _round(one, two, h, 0.5 + w / (2.0 * h))

        s, nodes = place_nodes(joints, np.linspace(-half, half, ZONE_INTERVALS + 1), LEAST_SPACING)
        curve = JointCurve(robot, s + half, nodes[:, 0], nodes[:, 1:])
        low, high = curve.hull
        if (low < lower).any() or (high > upper).any():
            half, why = half * SHRINK_INSIDE, "a joint reaches its limit"
            continue
        deviation = _prove_deviation(robot, one, two, curve)
        ratio = float((deviation / zone).max())
        if ratio <= 1.0:
            return Zone(half, s, nodes, deviation), why
        half *= SHRINK / ratio
    return None, why or "no width of it is proved"


def place_nodes(joints: Callable[[Array], Array], s: Array, least: float) -> tuple[Array, Array]:
    """Return nodes and the joints there (k, 4, n) whose quintics, on which the law works, stay on a curve."""
    found = joints(s)
    for _ in range(MOST_HALVINGS):
        h, middle = np.diff(s)[:, None], 0.5 * (s[1:] + s[:-1])
        there = joints(middle)
        a, b = found[:-1], found[1:]
        quintic = 0.5 * (a[:, 0] + b[:, 0]) + 5.0 / 32.0 * h * (a[:, 1] - b[:, 1]) + h * h / 64.0 * (a[:, 2] + b[:, 2])
        far = (np.abs(quintic - there[:, 0]).max(axis=1) > ON_CURVE) & (h[:, 0] > 2.0 * least)
        if not far.any():
            break
        at = np.flatnonzero(far) + 1
        s, found = np.insert(s, at, middle[far]), np.insert(found, at, there[far], axis=0)
    return s, found


def _round(one: JointCurve, two: JointCurve, half: float, u: Array) -> Array:
    """Return the joints (k, 4, n) of the corner of a half width at u in [0, 1].

    q = p(w (u − ½)) + (q₁ − p)(−w F(1 − u)) + (q₂ − p)(w F(u)) − q_c, with w = 2h and F = u⁴ (2.5 − 3u + u²). q₁ and q₂ are the
    curves as functions of the signed distance from the corner q_c, and their motions are superposed. The common bend p is
    counted once. The first motion slows down from 1 to 0 as the second one begins, with f = F' = 10u³ − 15u⁴ + 6u⁵, so that all
    derivatives up to the third are continuous at both ends. p is a cubic. Its second and third derivatives at the corner are
    the smaller ones of both curves, or 0 where signs differ. So a curve that continues smoothly is not changed.
    """
    w = 2.0 * half
    both = np.stack([one.derivatives[-1, 1:], two.derivatives[0, 1:]])
    bend, twist = np.where(both.prod(axis=0) > 0.0, np.sign(both[0]) * np.abs(both).min(axis=0), 0.0)

    def common(x: Array) -> Array:
        y = x[:, None]
        orders = y**2 * (bend / 2.0 + y * twist / 6.0), y * (bend + y * twist / 2.0), bend + y * twist, twist + 0.0 * y
        return np.stack(orders, axis=1)

    out = common(w * (u - 0.5))
    for curve, x, sign in ((one, 1.0 - u, -1.0), (two, u, 1.0)):
        covered = w * x**4 * (2.5 + x * (x - 3.0))
        rate = x**3 * (10.0 + x * (6.0 * x - 15.0))
        second, third = sign * 30.0 * (x * (1.0 - x)) ** 2 / w, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / w**2
        at = covered if sign > 0.0 else curve.end - covered
        q = curve.coordinates(np.clip(at, 0.0, curve.end)) - common(sign * covered)
        r1, r2, r3 = (r[:, None] for r in (rate, second, third))
        out[:, 0] += q[:, 0]
        out[:, 1] += q[:, 1] * r1
        out[:, 2] += q[:, 2] * r1**2 + q[:, 1] * r2
        out[:, 3] += q[:, 3] * r1**3 + 3.0 * q[:, 2] * r1 * r2 + q[:, 1] * r3
    out[:, 0] -= two.q[0]
    return out


def _measure_deviation(robot: Robot, one: JointCurve, two: JointCurve, half: float, u: Array) -> Array:
    """Return distance and angle (k, 2) of the rounded path from the sharp one at the same s."""
    q, w = _round(one, two, half, u)[:, 0], 2.0 * half * (u - 0.5)
    sharp = np.where(
        (w < 0.0)[:, None],
        one.configurations(robot, one.end + np.minimum(w, 0.0)),
        two.configurations(robot, np.maximum(w, 0.0)),
    )
    off = se3.error(robot.fk(np.ascontiguousarray(q)), robot.fk(np.ascontiguousarray(sharp)))
    return np.asarray(np.linalg.norm(off.reshape(-1, 2, 3), axis=2))


def _prove_deviation(robot: Robot, one: JointCurve, two: JointCurve, curve: JointCurve) -> Array:
    """Return proved bounds (2,) on distance and angle between a corner's curve and the sharp path at the same s.

    On both sides, |e| ≤ max |eᵢ| + δ²/8 max |e''| with samples at distances δ, and |e''| ≤ |p''| + |p_sharp''|. For rotations,
    E = R R_sharpᵀ − 1 with ‖E''‖ ≤ ‖R''‖ + 2 ‖R'‖ ‖R_sharp'‖ + ‖R_sharp''‖, and the angle is 2 asin(‖E‖/2).
    """
    step, out = curve.end / PROOF_INTERVALS, np.zeros(2)
    half, middle = PROOF_INTERVALS // 2, 0.5 * curve.end
    for part, begin, offset in ((one, 0.0, one.end - middle), (two, middle, -middle)):
        s = np.clip(begin + step * np.arange(half + 1), 0.0, curve.end)
        at = np.clip(s + offset, 0.0, part.end)
        T, sharp = (robot.fk(x.configurations(robot, y)) for x, y in ((curve, s), (part, at)))
        b, p = (_greatest_between(x, y[0], y[-1]) for x, y in ((curve, s), (part, at)))
        distance = np.linalg.norm(T[:, :3, 3] - sharp[:, :3, 3], axis=1).max()
        E = T[:, :3, :3] @ np.swapaxes(sharp[:, :3, :3], 1, 2) - np.eye(3)
        turn = np.linalg.norm(E, axis=(1, 2)).max() / np.sqrt(2.0)  # of a rotation less 1: its largest singular value
        turn += step**2 / 8.0 * (b[1, 1] + 2.0 * b[1, 0] * p[1, 0] + p[1, 1])
        bounds = distance + step**2 / 8.0 * (b[0, 1] + p[0, 1]), 2.0 * np.arcsin(min(1.0, 0.5 * turn))
        out = np.maximum(out, bounds)
    return out


def _greatest_between(curve: JointCurve, low: float, high: float) -> Array:
    """Return the greatest bounds (2, 4) of the pieces between nodes that touch an interval."""
    first = max(int(np.searchsorted(curve.s, low, side="right")) - 1, 0)
    last = max(int(np.searchsorted(curve.s, high, side="left")), first + 1)
    return np.asarray(curve.node_bounds[first:last].max(axis=0))
