"""The parts between two stops as one curve of the joints, with rounded corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.types import Array
from planners.following.joint_path import LEAST_SPACING, JointPath
from planners.paths.base import Path
from planners.paths.joint_curve import JointCurve
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint
from planners.program.corners import Zone, build_zone, find_half_width, place_nodes, reverses

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
    own = isinstance(path, JointLine | PointToPoint)
    if own:  # septics between its breaks are the path itself
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
    return Sharp(curve, path.breaks * factor, 0.0 if own else 2.0 * LEAST_SPACING * factor)


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
    found: list[tuple[Zone | None, str]] = []
    for one, two, zone, h, reason in zip(curves[:-1], curves[1:], zones, half, why, strict=True):
        built, narrower = build_zone(robot, one, two, zone, h) if h else (None, "")
        found.append((built, narrower or reason))
    return found


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
