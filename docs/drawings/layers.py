"""draw_layers: the four layers of a cell with their contents and their signals."""

from __future__ import annotations

import numpy as np

from docs.drawings.sheet import MARGIN, WIDTH, Sheet, break_lines
from optik.arm.robot import Robot
from optik.ik import solvers
from optik.types import Array
from planners.cell import Cell, PanTiltLaser
from planners.limits import MotionLimits
from planners.timing import laws

LINE_PITCH = 17.0
"""Distance between lines of text [px]."""

BETWEEN = 46.0
"""Distance between two layers, for the arrows and their labels [px]."""

LOOP = 40.0
"""Width beside the layers, for the arrow from the laser back to the main control [px]."""

COMMANDS = ("optik cell", "optik drive", "optik view", "optik bench run cell")
"""Commands of the command line for the cell."""


def draw_layers(cell: Cell) -> str:
    """Return the drawing of the application, main control, drive and laser positioning layers of a cell."""
    ms = 1e3 * cell.drive.period
    layers = [
        ("Application layer", ["library: planners.cell.Cell", "commands: " + ", ".join(COMMANDS)]),
        ("Main control", _control(cell)),
        ("Drive layer", _drive(cell)),
        ("Laser positioning layer", _laser(cell.laser)),
    ]
    carried = [
        ("spot, orientation", "outcome, errors"),
        (f"set-points, every {ms:g} ms", f"encoders, every {ms:g} ms"),
        ("tool position", ""),
    ]
    sheet = Sheet("Layers of the cell: " + ", ".join(title for title, _ in layers))
    y, tops = MARGIN, []
    width = WIDTH - 2 * MARGIN - LOOP
    for i, (title, facts) in enumerate(layers):
        if i:
            _carry(sheet, y, carried[i - 1], width)
            y += BETWEEN
        lines = [line for fact in facts for line in break_lines(fact, width - 20.0)]
        sheet.box(MARGIN, y, width, LINE_PITCH * (len(lines) + 1) + 14.0)
        sheet.words((MARGIN + 10.0, y + 20.0), title, bold=True)
        for k, line in enumerate(lines):
            sheet.words((MARGIN + 10.0, y + 20.0 + LINE_PITCH * (k + 1)), line, "soft")
        tops.append(y)
        y += LINE_PITCH * (len(lines) + 1) + 14.0
    edge, lane = MARGIN + width, MARGIN + width + LOOP / 2
    sheet.arrow(
        [(edge, tops[3] + 20.0), (lane, tops[3] + 20.0), (lane, tops[1] + 20.0), (edge, tops[1] + 20.0)], "beam"
    )
    sheet.words((WIDTH - MARGIN / 2, tops[3] - BETWEEN / 2 + 5.0), "pan, tilt, range", "beam", anchor="end")
    return sheet.svg(y + MARGIN)


def _carry(sheet: Sheet, y: float, words: tuple[str, str], width: float) -> None:
    """Draw the labelled arrows between two layers, down and up; without a label there is no arrow up."""
    down, up = MARGIN + 20.0, MARGIN + width / 2 + 8.0
    sheet.arrow([(down, y + 3.0), (down, y + BETWEEN - 3.0)])
    sheet.words((down + 9.0, y + BETWEEN / 2 + 5.0), words[0])
    if words[1]:
        sheet.arrow([(up, y + BETWEEN - 3.0), (up, y + 3.0)])
        sheet.words((up + 9.0, y + BETWEEN / 2 + 5.0), words[1])


def _control(cell: Cell) -> list[str]:
    """Return the lines of the main control."""
    robot = cell.robot
    facts = [
        f"arm: {robot.name}, {robot.n} joints",
        "IK: " + ", ".join(solvers()),
        "time laws: " + ", ".join(laws()),
        "limits: " + limits_in_words(robot, cell.limits),
        "certificate: limits and path, at every instant",
    ]
    if cell.gripper is not None:
        facts.append(
            f"gripper: opens {1e3 * cell.gripper.opening:g} mm, {cell.gripper.mass:g} kg; the tool is its grasp point"
        )
    return facts


def _drive(cell: Cell) -> list[str]:
    """Return the lines of the drive."""
    kind = "simulated" if cell.drive.simulated else "a real arm"
    rate = f"servo period {1e3 * cell.drive.period:g} ms: {1.0 / cell.drive.period:g} set-points per second"
    return [f"drive: {cell.drive.name}, {kind}", rate, "stops on the path within the limits, and resumes"]


def _laser(laser: PanTiltLaser) -> list[str]:
    """Return the lines of the laser unit: limits, noise and calibration."""
    pan, tilt = np.degrees(laser.pan_limits), np.degrees(laser.tilt_limits)
    low, high = laser.range_limits
    facts = [
        f"pan {_number(pan[0])} … {_number(pan[1])}°, tilt {_number(tilt[0])} … {_number(tilt[1])}°, "
        f"range {_number(low)} … {_number(high)} m",
        f"noise: {1e3 * laser.angle_noise:g} mrad, {1e3 * laser.range_noise:g} mm (1 σ)",
    ]
    if laser.pose_covariance is not None:
        spread = np.sqrt(np.diag(laser.pose_covariance))
        shift, turn = 1e3 * np.linalg.norm(spread[:3]), 1e3 * np.linalg.norm(spread[3:])
        facts.append(f"calibrated to {shift:.2g} mm, {turn:.2g} mrad (1 σ)")
    return facts


def limits_in_words(robot: Robot, limits: MotionLimits) -> str:
    """Return the given limits as text with units."""
    words = []
    sliding = bool(robot.prismatic.any())
    for kind in limits.kinds:
        bounds = limits.bounds(robot.n)[kind.name]
        known = bounds[np.isfinite(bounds)]
        if known.size:
            units = dict.fromkeys(kind.units if sliding and kind.subject is None else kind.units[:1])
            words.append(f"{kind.name.replace('_', ' ')} {_span(known)} {', '.join(units)}")
    return "; ".join(words) or "none"


def _span(values: Array) -> str:
    """Return one number, or the smallest and the largest one, as text."""
    low, high = float(values.min()), float(values.max())
    return _number(low) if low == high else f"{_number(low)} to {_number(high)}"


def _number(value: float) -> str:
    return f"{value:.4g}".replace("-", "−").replace("inf", "∞")
