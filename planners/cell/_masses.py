"""Masses for an arm whose own are unknown: rods along its links, stated in words wherever they stand in for known ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optik.arm.inertia import Inertia
from optik.arm.robot import Robot
from optik.types import Array

ROD_DENSITY = 1500.0
"""Density of the assumed rods [kg/m³]: with `ROD_THICKNESS` an arm of the UR5e's size weighs 14 kg, of the Panda's 20 kg;
the real ones weigh 19 and 16 kg without their bases."""

ROD_THICKNESS = 0.1
"""Diameter of the assumed rods, as a part of the length of all links together [1]: arms are some ten times as long as thick."""


def with_masses(robot: Robot) -> tuple[Robot, str]:
    """Return an arm whose masses are known, and what was assumed for it, in words.

    An arm that has masses is returned as it is. One without gets, for each link, a solid cylinder from its joint to the next
    one (the tool, for the last), `ROD_THICKNESS` of the arm's length thick and at least as long, of `ROD_DENSITY`; motors
    whose inertia is that of all masses behind the joint at a distance of one diameter (those masses themselves, where the
    joint slides); no friction; and no torque limits, as those of a real motor do not belong to assumed masses.
    """
    if robot.inertia is not None:
        return robot, ""
    ends = np.concatenate([robot.fixed[1:, :3, 3], robot.tool[None, :3, 3]])
    lengths = np.linalg.norm(ends, axis=1)
    # An arm without any length has nothing to scale by: one metre then.
    thickness = ROD_THICKNESS * (float(lengths.sum()) or 1.0)
    rods = [_rod(end, float(length), thickness) for end, length in zip(ends, lengths, strict=True)]
    mass, com, tensor = (np.array(part) for part in zip(*rods, strict=True))
    moved = np.cumsum(mass[::-1])[::-1]
    motor = np.where(robot.prismatic, moved, moved * thickness**2)
    source = "assumed: rods along the links, as the masses are unknown"
    inertia = Inertia(mass, com, tensor, motor=motor, source=source)
    limits = robot.limits.replaced(torque=None, torque_rate=None)
    return replace(robot, inertia=inertia, limits=limits), _in_words(robot, thickness, float(mass.sum()))


def _rod(end: Array, length: float, thickness: float) -> tuple[float, Array, Array]:
    """A solid cylinder from a frame's origin to a point: mass, centre of mass, inertia about it."""
    radius, long = 0.5 * thickness, max(length, thickness)
    mass = ROD_DENSITY * np.pi * radius**2 * long
    along = end / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    about, across = 0.5 * mass * radius**2, mass * (3.0 * radius**2 + long**2) / 12.0
    tensor = across * np.eye(3) + (about - across) * np.outer(along, along)
    return mass, 0.5 * end, tensor


def _in_words(robot: Robot, thickness: float, total: float) -> str:
    dropped = " its torque limits are not applied," if robot.limits.torque is not None else ""
    return (
        f"the masses of {robot.name!r} are unknown: its links are assumed to be solid rods of {ROD_DENSITY:.0f} kg/m³, "
        f"{1000.0 * thickness:.0f} mm thick, {total:.1f} kg together, its motors to have the inertia of the moved masses at "
        f"that distance, without friction;{dropped} torques are those of this assumption, not of the arm"
    )
