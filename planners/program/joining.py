"""The parts between two stops as one curve of the joints, with rounded corners and the proof of their deviation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from optik import se3
from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.types import Array
from planners.following.joint_path import LEAST_SPACING, JointPath
from planners.paths.base import Path
from planners.paths.joint_curve import JointCurve
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint

# ---------------- rounded corners between two curves of the joints


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


# ---------------- the parts between two stops as one curve of the joints


LENGTH_CHORDS = 16
"""Chords that measure the length of a part in joint space: only a scale of s."""
STRAIGHT_ON = 0.99
"""Cosine of the largest angle in joint space, 8°, with which a part continues in the direction of the part before."""
BREAK_SPACING = 0.2
"""Longest piece between breaks [rad, m]: a certificate searches a motion among the chords of each piece."""
NEAREST_BREAK = 0.01
"""Least distance of a break from the next one, as a fraction of the usual one."""
SHARE, SHARE_OF_SHORT = 0.999, 2.0 / 3.0
"""Largest fraction of a part that its zones may cover together, and the fraction for parts as short as the node spacing."""
NEAR_NODE = 0.02
"""Least distance of a node of a joint-space part from a zone, as a fraction of what is left of the part."""


class Sharp(NamedTuple):
    """A part as a curve of the joints over its length, with its path's breaks and the least distance of nodes."""

    curve: JointCurve
    breaks: Array
    near: float


@dataclass(frozen=True)
class Corner:
    """A rounded corner of a program.

    Attributes
    ----------
    part : int
        The part before it, from 0.
    zone : (2,) tuple of float
        Largest distance [m] and rotation [rad] from the sharp path that the part allows.
    deviation : (2,) tuple of float
        Proved bounds on distance and rotation between the rounded and the sharp path at the same s.
    begin, end : float
        Path parameters at which the corner begins and ends; equal ones at a stop.
    reduced : str
        Why it is narrower than the zone allows, or a stop; empty if it is as wide as the zone.
    """

    part: int
    zone: tuple[float, float]
    deviation: tuple[float, float]
    begin: float
    end: float
    reduced: str = ""


def sharpen(robot: Robot, path: Path, joints: JointPath | None, before: Sharp | None = None) -> Sharp:
    """Return a part as a curve of the joints: through the nodes of its joint path, or itself if it is a curve of the joints.

    If it continues in the direction of the part before, its length is scaled so that |dq/ds| is continuous there.
    """
    exact = isinstance(path, JointLine | PointToPoint)
    if exact:  # septics between its breaks are the path itself
        s = path.breaks
        values = np.stack([np.asarray(path.configurations(robot, s, order)) for order in range(4)], axis=1)
    else:
        assert joints is not None
        s, values = joints.nodes, joints.at_nodes
    curve = JointCurve(robot, s, values[:, 0], values[:, 1:], breaks=s[[0, -1]])
    along = curve.configurations(robot, np.linspace(0.0, curve.end, LENGTH_CHORDS + 1))
    factor = float(np.linalg.norm(np.diff(along, axis=0), axis=1).sum()) / curve.end
    if before is not None:
        a, b = before.curve.derivatives[-1, 0], values[0, 1]
        sizes = float(np.linalg.norm(a)), float(np.linalg.norm(b))
        factor = sizes[1] / sizes[0] if a @ b > STRAIGHT_ON * sizes[0] * sizes[1] else factor
    scale = factor ** np.arange(1, 4)[:, None]
    curve = JointCurve(robot, s * factor, values[:, 0], values[:, 1:] / scale, breaks=s[[0, -1]] * factor)
    return Sharp(curve, path.breaks * factor, 0.0 if exact else 2.0 * LEAST_SPACING * factor)


def round_corners(
    robot: Robot, parts: Sequence[Sharp], zones: Sequence[Array], tolerance: Tolerance
) -> list[tuple[Zone | None, str]]:
    """Return the corner between any two parts, None for a stop, and why it is narrower than its zone."""
    used = np.array([tolerance.position, tolerance.rotation])  # by the parts and by the motion
    zones = [zone - used for zone in zones]
    curves, half, why = [part.curve for part in parts], list[float](), list[str]()
    for one, two, zone in zip(curves[:-1], curves[1:], zones, strict=True):
        most = min(_share(one), _share(two))
        stop = "the path reverses its direction there" if reverses(one, two) else ""
        stop = "its zone is not larger than the tolerance" if (zone <= 0.0).any() else stop
        half.append(0.0 if stop else find_half_width(robot, one, two, zone, most))
        why.append(stop or ("the shorter of its parts ends" if half[-1] >= most else ""))
    for i, curve in enumerate(curves[1:-1]):
        both = half[i] + half[i + 1]
        if both > _share(curve):
            for k in (i, i + 1):
                half[k] *= _share(curve) / both
                why[k] = why[k] or f"it shares a part with the zone {'after' if k == i else 'before'} it"
    corners: list[tuple[Zone | None, str]] = []
    for one, two, zone, h, reason in zip(curves[:-1], curves[1:], zones, half, why, strict=True):
        built, narrower = build_zone(robot, one, two, zone, h) if h else (None, "")
        corners.append((built, narrower or reason))
    return corners


def _share(curve: JointCurve) -> float:
    """Return the length of a part that its zones may cover together.

    The remaining length keeps rounding errors of third derivatives small.
    """
    return max(min(SHARE * curve.end, curve.end - 2.0 * LEAST_SPACING), SHARE_OF_SHORT * curve.end)


def join_parts(robot: Robot, parts: Sequence[Sharp], zones: Sequence[Zone]) -> tuple[JointCurve, Array]:
    """Return one curve along parts with a rounded corner between any two of them, and the parts' places in s (k + 1,)."""
    places = np.concatenate([[0.0], np.cumsum([part.curve.end for part in parts])])
    nodes, joints = list[Array](), list[Array]()
    breaks, owners = [0.0], list[tuple[int, int]]()

    def add(s: Array, values: Array, marks: Array, owner: tuple[int, int]) -> None:
        first = int(bool(nodes))  # the last node is there
        nodes.append(s[first:])
        joints.append(values[first:])
        breaks.extend(marks)
        owners.extend([owner] * len(marks))

    for i, part in enumerate(parts):
        low = zones[i - 1].half if i else 0.0
        high = part.curve.end - (zones[i].half if i < len(zones) else 0.0)
        near = part.near or NEAR_NODE * (high - low)
        inner = part.curve.s[(part.curve.s > low + near) & (part.curve.s < high - near)]
        s, values = place_nodes(part.curve.coordinates, np.concatenate([[low], inner, [high]]), part.near)
        marks = np.append(_spread_breaks(low, high, part.breaks), high)
        add(places[i] + s, values, places[i] + marks, (i, i))
        if i < len(zones):
            half = zones[i].half
            count = max(1, int(np.ceil(half / BREAK_SPACING)))
            marks = half * (np.arange(count) + 1.0) / count
            add(places[i + 1] + zones[i].s, zones[i].joints, places[i + 1] + np.append(marks - half, marks), (i, i + 1))
            owners[-count:] = [(i + 1, i)] * count  # the speeds of each part hold up to the middle
    s, values, marks = np.concatenate(nodes), np.concatenate(joints), np.array(breaks)
    s[-1] = marks[-1] = places[-1]
    return JointCurve(robot, s, values[:, 0], values[:, 1:], breaks=marks, owners=owners), places


def _spread_breaks(low: float, high: float, own: Array) -> Array:
    """Return the breaks inside a part: those of its path, and more so that no piece is long."""
    count = int(np.ceil((high - low) / BREAK_SPACING))
    least = NEAREST_BREAK * (high - low) / count
    at = np.union1d(np.linspace(low, high, count + 1)[1:-1], own)
    kept, last = [], low
    for s in at[(at > low) & (at < high)]:
        if s - last > least and high - s > least:
            kept.append(s)
            last = s
    return np.array(kept)
