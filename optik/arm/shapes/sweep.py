"""Capsules that enclose the links beside a chain at every value of their joints, such as the fingers of a gripper.

A capsule moves with the joints between its link and the link of the arm that carries it. Their values follow drivers within
ranges. The ends of its axis are replaced by points whose convex hull contains the ends for all values: a sliding joint shifts
them to both ends of its range. A turning joint moves them on arcs, and the ends of an arc and the corners of tangents around it
contain the arc. A capsule around these points, wider by the radius, contains the moving one. The ranges are halved while this
enlarges the radius by more than `WELL_SWEPT`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from optik import se3
from optik.arm.shapes.enclosure import Capsule, fit_roughly
from optik.types import Array

WELL_SWEPT = 0.01
"""Increase of the radius [m] below which a range is not halved further."""
MOST_SWEPT = 8
"""Most capsules of one moving link, if it has fewer itself: the time of a certificate grows with their number."""
LONGEST_ARC = 0.5
"""Longest arc between corners [rad]: a corner lies 3 % outside of its arc."""
TURN_ABOUT_AXIS = 1.5 * np.pi
"""Angle [rad] from which a capsule about the axis encloses a turn."""
MOST_SWEPT_POINTS = 100
"""Most points that contain the ends of an axis: more of them are enclosed by a capsule."""


class SweepStep(NamedTuple):
    """A joint between a link and the arm: its pose, its axis, and its value factor · (value of a driver) + offset."""

    T: Array
    slides: bool
    axis: Array
    driver: int
    factor: float
    offset: float


def sweep_capsules(capsules: Sequence[Capsule], steps: Sequence[SweepStep], ranges: Array) -> list[Capsule]:
    """Enclose capsules of a link for all values of the drivers.

    steps: from the link to the arm. ranges (d, 2): lower and upper value of each driver [rad, m].
    """
    parts = [(ranges, _sweep_all(capsules, steps, ranges))]
    while (len(parts) + 1) * len(capsules) <= MOST_SWEPT:
        growth = [_measure_growth(capsules, found) for _, found in parts]
        i = int(np.argmax(growth))
        if growth[i] <= WELL_SWEPT:
            break
        part = parts[i][0]
        halves = [
            [(half, _sweep_all(capsules, steps, half)) for half in _halve(part, driver)]
            for driver, (low, high) in enumerate(part.tolist())
            if np.isfinite(high - low) and high > low
        ]
        if not halves:
            break
        worst = [max(_measure_growth(capsules, found) for _, found in pair) for pair in halves]
        parts[i : i + 1] = halves[int(np.argmin(worst))]
    return [c for _, found in parts for c in found]


def _halve(ranges: Array, driver: int) -> tuple[Array, Array]:
    """Return the ranges with that of one driver halved."""
    lower, upper = ranges.copy(), ranges.copy()
    lower[driver, 1] = upper[driver, 0] = ranges[driver].mean()
    return lower, upper


def _measure_growth(capsules: Sequence[Capsule], found: Sequence[Capsule]) -> float:
    """Return the largest increase of a radius."""
    return max(b.radius - a.radius for a, b in zip(capsules, found, strict=True))


def _sweep_all(capsules: Sequence[Capsule], steps: Sequence[SweepStep], ranges: Array) -> list[Capsule]:
    """Enclose each capsule by one for all values of the drivers."""
    return [_sweep(c, steps, ranges) for c in capsules]


def _sweep(c: Capsule, steps: Sequence[SweepStep], ranges: Array) -> Capsule:
    """Enclose a capsule by one for all values of the drivers."""
    points, radius, excess, fixed = np.array([c.a, c.b]), c.radius, c.excess, c
    for step in steps:
        low, high = (
            sorted(step.factor * ranges[step.driver] + step.offset) if step.factor else (step.offset, step.offset)
        )
        if step.slides:
            shifts = np.array([low, high]) if high > low else np.array([low])
            points = (points + (shifts[:, None] * step.axis)[:, None]).reshape(-1, 3)
        elif high - low >= TURN_ABOUT_AXIS:
            along = points @ step.axis
            radius += float(np.linalg.norm(points - along[:, None] * step.axis, axis=1).max())
            points, excess = np.array([along.min(), along.max()])[:, None] * step.axis, np.nan
        else:
            points = turn_points(points, step.axis, low, high)
        points = points @ step.T[:3, :3].T + step.T[:3, 3]
        if len(points) > MOST_SWEPT_POINTS:
            hull, excess = fit_roughly(points, 0.0), np.nan
            points, radius = np.array([hull.a, hull.b]), radius + hull.radius
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = (np.eye(3), low * step.axis) if step.slides else (se3.exp_so3(low * step.axis), 0.0)
        fixed = fixed.transform(step.T @ turn)
    if len(points) == 2:
        hulls = () if any(step.factor for step in steps) else fixed.hulls
        return Capsule(points[0], points[1], radius, excess, hulls)
    hull = fit_roughly(points, 0.0)
    return Capsule(hull.a, hull.b, hull.radius + radius)


def turn_points(points: Array, axis: Array, low: float, high: float) -> Array:
    """Return points whose convex hull contains points that turn about an axis between two angles."""
    if high == low:
        return points @ se3.exp_so3(low * axis).T
    count = int(np.ceil((high - low) / LONGEST_ARC))
    half = 0.5 * (high - low) / count
    along = (points @ axis)[:, None] * axis
    corners = low + half * (1.0 + 2.0 * np.arange(count))
    turns = [(low, 1.0), *((angle, 1.0 / np.cos(half)) for angle in corners.tolist()), (high, 1.0)]
    return np.concatenate([along + wider * ((points - along) @ se3.exp_so3(angle * axis).T) for angle, wider in turns])
