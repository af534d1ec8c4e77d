"""A robot as a table: for each joint its range, its limits and the mass of its link."""

from __future__ import annotations

import numpy as np

from optik.arm.model import ArmModel, unit_factors, unit_names
from optik.types import Array

UNKNOWN = "–"
"""Text of a limit or mass that the model does not have."""
COLUMNS = ("joint", "type", "range", "velocity", "acceleration", "jerk", "torque", "mass")
"""Columns of the table of joints."""


def joint_rows(robot: ArmModel) -> list[tuple[str, ...]]:
    """Return a row of texts for each joint, in the order of `COLUMNS`."""
    limits, rows = robot.limits, []
    per, units = unit_factors(robot), [unit.strip() for unit in unit_names(robot)]
    for i, (name, slides) in enumerate(zip(robot.joint_names, robot.prismatic, strict=True)):
        ends = per[i] * limits.lower[i], per[i] * limits.upper[i]
        span = f"{ends[0]:.4g} to {ends[1]:.4g} {units[i]}" if np.isfinite(ends).all() else "continuous"
        rates = zip(
            (limits.velocity, limits.acceleration, limits.jerk),
            (f"{units[i]}/s", f"{units[i]}/s²", f"{units[i]}/s³"),
            strict=True,
        )
        cells = [UNKNOWN if one is None else _limit(per[i] * one[i], unit) for one, unit in rates]
        torque = UNKNOWN if limits.torque is None else _limit(limits.torque[i], "N" if slides else "N·m")
        mass = UNKNOWN if robot.inertia is None else f"{robot.inertia.mass[i]:.3g} kg"
        rows.append((name, "prismatic" if slides else "revolute", span, *cells, torque, mass))
    return rows


def _limit(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if np.isfinite(value) else UNKNOWN


def tool_facts(robot: ArmModel, tool: Array) -> list[tuple[str, str]]:
    """Return the position (3,) of the tool with every joint in mid-range [m], what is known of the arm, and its source."""
    x = 1e3 * tool
    facts = [
        ("Tool, joints in mid-range", f"({', '.join(f'{value + 0.0:.4g}' for value in np.round(x, 2))}) mm"),
        ("Shapes", "none" if robot.shapes is None else f"{robot.shapes.m} capsules"),
    ]
    if robot.shapes is not None and (excess := robot.shapes.describe_excess()):
        facts.append(("Shapes exceed the links by", excess))
    if robot.motors is not None:
        facts.append(
            ("Motors", f"{', '.join(robot.motors.names)} move these axes together, inside ranges of their own")
        )
    if (follow := robot.linkage) is not None:
        of, factors = [robot.joint_names[k] for k in follow.joint], zip(follow.names, follow.factor, strict=True)
        words = [f"{name} follows {k} × {x:.4g}" for (name, x), k in zip(factors, of, strict=True) if name != k]
        facts.append(("Linkage", ", ".join(words)))
    if robot.limits.velocity_by_position is not None:
        facts.append(("Velocity", "falls towards the ends of the ranges"))
    facts += [("Payload", str(robot.payload))] if robot.payload is not None else []
    return [*facts, *([("Source", robot.source)] if robot.source else [])]


def describe_robot(robot: ArmModel, tool: Array) -> str:
    """Return the table of joints and the facts as text."""
    rows = [COLUMNS, *joint_rows(robot)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([repr(robot), *lines, *(f"{name}: {text}" for name, text in tool_facts(robot, tool))])
