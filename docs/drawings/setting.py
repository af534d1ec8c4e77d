"""draw_setting: the arm and the laser unit on their platform, the beam and the graph paper."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from docs.drawings.sheet import MARGIN, WIDTH, Sheet, break_lines
from docs.drawings.view import View, fit_view, make_view
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Plane, Sighting

PAPER, SQUARE = 0.4, 0.05
"""Edge of the graph paper and of its squares [m]."""

PICTURE = 340.0
"""Height of the picture above the words [px]."""

SETTING_AZIMUTH = np.radians(62.0)
"""Azimuth of the viewer about the vertical from the base's x axis [rad]: a unit on the side of z is in front of the arm."""

UNIT_AXIS = 0.15
"""Length of the drawn pan axis [m]."""

BEAM_PIECES = 24
"""Number of pieces of the beam; each is in front of a link or behind it."""

PLATFORM_MARGIN = 0.12
"""Distance of the platform's edge from arm and laser unit [m]."""

LEAST_WIDTH = 0.03
"""Thickness of links whose shapes are unknown [m]."""


def draw_setting(robot: Robot, laser: PanTiltLaser, plane: Plane, pan: float, tilt: float, q: ArrayLike) -> str:
    """Return the drawing of the arm at a configuration, the laser unit beside it, its beam and the graph paper."""
    seen = laser.intersect_plane(pan, tilt, plane)
    if seen.point is None or seen.spot is None:
        raise InvalidInput("pan, tilt", f"{seen.status}: {seen.reason}", "a beam that meets the plane")
    frames = np.concatenate([np.eye(4)[None], robot.frames(robot.configuration(q))])
    bodies = _bodies(robot, frames)
    view = make_view(robot.gravity, SETTING_AZIMUTH)
    paper = _paper(view, plane, seen.point)
    corners = np.concatenate([paper[0], paper[len(paper) // 2 - 1][::-1]])
    unit = laser.pose[:3, 3]
    floor = _floor(view, bodies, np.concatenate([np.zeros((1, 3)), unit[None], corners]))
    around = np.concatenate(
        [corners, floor, *(ends for ends, _ in bodies), [unit, unit + UNIT_AXIS * laser.pose[:3, 2]]]
    )
    box = (MARGIN + 10.0, MARGIN + 20.0, WIDTH - 2 * MARGIN - 20.0, PICTURE - 40.0)
    view = fit_view(view, around, box)
    sheet = Sheet(f"{robot.name} and the laser unit beside it, whose beam meets the graph paper")
    sheet.line(view(floor), "edge", width=1.0, closed=True)
    rightmost = view(floor)[np.argmax(view(floor)[:, 0])]
    sheet.words(rightmost, "platform", "soft", by=(-22.0, 5.0), anchor="end")
    _draw_paper(sheet, view, paper, corners)
    _unit(sheet, view, laser, floor, seen.point)
    _arm(sheet, view, bodies, np.linspace(unit, seen.point, BEAM_PIECES + 1))
    tool = frames[-1, :3, 3]
    sheet.line(view(np.stack([tool, seen.point])), "ink", dashed=True, width=1.2)
    sheet.dot(view(tool))
    sheet.words(view(tool), "tool", by=(8.0, -6.0))
    sheet.dot(view(seen.point), "beam", 4.0)
    sheet.words(view(seen.point), "spot", "beam", by=(8.0, 14.0))
    return sheet.svg(_words(sheet, seen))


def _bodies(robot: Robot, frames: Array) -> list[tuple[Array, float]]:
    """Return the segments (2, 3) and radii of the arm: its capsules, or straight links if it has none."""
    if robot.shapes is None:
        pairs = np.stack([frames[:-1, :3, 3], frames[1:, :3, 3]], axis=1)
        return [(pair, LEAST_WIDTH) for pair in pairs if np.ptp(pair, axis=0).max() > 0.0]
    link, a, b, radius = robot.shapes.capsules
    ends = [np.stack([a[i], b[i]]) @ frames[k, :3, :3].T + frames[k, :3, 3] for i, k in enumerate(link)]
    return list(zip(ends, map(float, radius), strict=True))


def _arm(sheet: Sheet, view: View, bodies: list[tuple[Array, float]], beam: Array) -> None:
    """Draw the bodies and the pieces of the beam, the nearest last. The projection of a capsule is a line with round ends."""
    pieces = [(np.stack(ends), 0.0) for ends in pairwise(beam)]
    for ends, radius in sorted([*bodies, *pieces], key=lambda body: float(view.depth(body[0]).mean())):
        flat, width = view(ends), 2.0 * radius * view.scale
        if radius:
            sheet.line(flat, "edge", width=width + 2.0)
        sheet.line(flat, "body" if radius else "beam", width=width or 2.0)


def _paper(view: View, plane: Plane, centre: Array) -> Array:
    """Return the lines (k, 2, 3) of the graph paper around a point, one side horizontal."""
    level = np.cross(plane.normal, view.up)
    if np.linalg.norm(level) < 1e-6:
        level = view.level[0]
    level = level / np.linalg.norm(level)
    other = np.cross(plane.normal, level)
    steps = np.arange(-PAPER / 2, PAPER / 2 + SQUARE / 2, SQUARE)
    lines = [
        [centre + s * u - PAPER / 2 * v, centre + s * u + PAPER / 2 * v]
        for u, v in ((level, other), (other, level))
        for s in steps
    ]
    return np.array(lines)


def _draw_paper(sheet: Sheet, view: View, paper: Array, corners: Array) -> None:
    """Draw the squares of the graph paper and their label."""
    sheet.line(view(corners), "grid", width=1.0, closed=True)
    for line in paper:
        sheet.line(view(line), "grid", width=0.7)
    lowest = view(corners)[np.argmax(view(corners)[:, 1])]
    sheet.words(lowest, f"graph paper, {1e3 * SQUARE:g} mm squares", "soft", by=(0.0, 16.0), anchor="middle")


def _floor(view: View, bodies: list[tuple[Array, float]], above: Array) -> Array:
    """Return the corners (4, 3) of the platform at the height of the lowest point of the arm and of some points (k, 3)."""
    low = min(min(float((ends @ view.up).min()) - radius for ends, radius in bodies), float((above @ view.up).min()))
    feet = above @ view.level.T
    (x0, y0), (x1, y1) = feet.min(axis=0) - PLATFORM_MARGIN, feet.max(axis=0) + PLATFORM_MARGIN
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return np.asarray(corners @ view.level + low * view.up)


def _unit(sheet: Sheet, view: View, laser: PanTiltLaser, floor: Array, spot: Array) -> None:
    """Draw the unit on its mast with its x and z axes."""
    at = laser.pose[:3, 3]
    foot = at - float((at - floor[0]) @ view.up) * view.up
    sheet.line(view(np.stack([foot, at])), "edge", width=4.0)
    reach = 0.35 * float(np.linalg.norm(spot - at))
    for axis, name in ((0, "x"), (2, "z")):
        tip = view(at + (reach if axis == 0 else UNIT_AXIS) * laser.pose[:3, axis])
        sheet.arrow([view(at), tip], name, width=1.5)
        sheet.words(tip, name, name, by=(5.0, -5.0))
    sheet.dot(view(at), "ink", 6.0)
    sheet.words(view(at), "laser unit", by=(-10.0, -10.0), anchor="end")


def _words(sheet: Sheet, seen: Sighting) -> float:
    """Write the reading and the spot below the picture; return the total height [px]."""
    assert seen.spot is not None and seen.point is not None and seen.covariance is not None
    pan, tilt, distance = (float(x) for x in seen.spot)
    read = f"Beam: pan {np.degrees(pan):.1f}°, tilt {np.degrees(tilt):.1f}°, range {distance:.3f} m."
    position = f"Spot in the arm's base frame: ({', '.join(f'{x:.3f}' for x in seen.point)}) m."
    spread = np.sqrt(np.linalg.eigvalsh(seen.covariance)[1:])
    noise = f"Its noise on the paper: {1e3 * spread[0]:.2f} mm by {1e3 * spread[1]:.2f} mm (1 σ)."
    y = PICTURE + 14.0
    for line in (line for text in (read, position, noise) for line in break_lines(text, WIDTH - 2 * MARGIN)):
        sheet.words((MARGIN, y), line.replace("-", "−"), "soft")
        y += 17.0
    return y
