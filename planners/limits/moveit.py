"""Limits of the joints from MoveIt's ``joint_limits.yaml``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_kind, check_number
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, parse_yaml, read_bytes
from optik.tables import warn_of_assumptions
from optik.types import Array
from planners.limits.motion_limits import FAR_ABOVE, MotionLimits

NESTED = ("/**", "ros__parameters", "robot_description_planning")
"""Keys of parameter files of ROS around ``joint_limits``."""
DECELERATION = ("max_deceleration", "has_deceleration_limits")
"""Keys of Pilz' deceleration limit, a negative number, and of its switch."""
KINDS = {"velocity": ("max_velocity",), "acceleration": ("max_acceleration",), "jerk": ("max_jerk",)}
"""Limits of a motion, and their keys in the file."""
POSITION = ("min_position", "max_position")
"""Keys of the range of a joint."""
READ = {*DECELERATION, *POSITION, "has_position_limits"}.union(
    *({*keys, f"has_{kind}_limits"} for kind, keys in KINDS.items())
)
"""Keys of a joint that are read."""


def load_limits(
    file: str | os.PathLike[str], robot: Robot, *, joint_names: Mapping[str, str] | None = None
) -> tuple[Robot, MotionLimits]:
    """Read the limits of MoveIt's ``joint_limits.yaml``.

    A limit that the file does not have is the robot's. ``has_velocity_limits: false``, and so for the other limits, removes it.

    Parameters
    ----------
    file : str or path
        ``.yaml`` or ``.yml`` with the key ``joint_limits``, also inside a parameter file of ROS 2.
    robot : Robot
        The arm; at least one of its joints must be in the file.
    joint_names : mapping, optional
        From the robot's joint names to the file's.

    Returns
    -------
    tuple of Robot and MotionLimits
        The arm with the file's joint ranges and decelerations, and the limits on velocity, acceleration and jerk. Other joints
        and keys of the file are named in an `AssumptionWarning`.

    Raises
    ------
    InvalidInput
        No such file, no joint of the arm, or a limit that is no positive number.
    """
    read = read_limits(file, robot, joint_names)
    warn_of_assumptions(file, read.notes)
    limited = read.limit(robot)
    return limited, MotionLimits.of(limited, **read.given)


class FoundLimits(NamedTuple):
    """The ranges (2, n) and decelerations of a file, its other limits by name where they differ from the robot's, and notes."""

    ranges: Array
    deceleration: Array | None
    given: dict[str, Array | None]
    notes: list[str]

    def limit(self, robot: Robot) -> Robot:
        """Return the robot with these joint ranges and decelerations."""
        lower, upper = self.ranges
        return replace(robot, limits=replace(robot.limits, lower=lower, upper=upper, deceleration=self.deceleration))


def read_limits(
    file: str | os.PathLike[str], robot: Robot, joint_names: Mapping[str, str] | None = None
) -> FoundLimits:
    """Return what `load_limits` reads, without a warning."""
    check_suffix(file, (".yaml", ".yml"))
    check_kind(robot, "robot", Robot)
    check_kind(joint_names, "joint_names", Mapping | None, "a mapping from the robot's joint names to the file's")
    data = parse_yaml(decode_text(read_bytes(Path(file))), str(file))
    joints, beside = _find_joints(data, str(file))
    names = [(joint_names or {}).get(name, name) for name in robot.joint_names]
    if not set(names) & set(joints):
        expected = f"limits of some of {', '.join(names)}"
        advice = "joint_names= gives the names in the file"
        raise InvalidInput(str(file), f"limits of {', '.join(map(str, joints))}"[:160], expected, advice=advice)
    robots = MotionLimits.of(robot).bounds(robot.n)
    values, ranges = {kind: robots[kind].copy() for kind in KINDS}, np.stack([robot.limits.lower, robot.limits.upper])
    braking = np.full(robot.n, np.inf) if robot.limits.deceleration is None else robot.limits.deceleration.copy()
    unread = set(beside)
    for i, name in enumerate(names):
        entry, where = joints.get(name, {}), f"{file}, {name}"
        check_kind(entry, where, dict, "a mapping such as max_velocity: 2.0")
        for kind, keys in KINDS.items():
            _read(entry, kind, keys, where, values[kind][i : i + 1])
        _read(entry, "position", POSITION, where, ranges[:, i])
        braking[i] = _read_deceleration(entry, where, float(braking[i]))
        unread |= {str(key) for key in entry} - READ
    others = sorted({*map(str, joints)} - {*names})
    notes = [f"no joints of {robot.name}: {', '.join(others)}"] if others else []
    notes += [f"not read: {', '.join(sorted(unread))}"] if unread else []
    velocity = values["velocity"] / robots["velocity"]
    if (known := np.isfinite(velocity)).any() and velocity[known].min() > FAR_ABOVE:
        notes.append(
            f"velocities of {velocity[known].min():.3g} times those of {robot.name} or more: are these degrees?"
        )
    changed = {kind: x for kind, x in values.items() if not np.array_equal(x, robots[kind])}
    limits = {kind: x if np.isfinite(x).any() else None for kind, x in changed.items()}
    return FoundLimits(ranges, braking if np.isfinite(braking).any() else None, limits, notes)


def _find_joints(data: Any, file: str) -> tuple[dict[Any, Any], list[str]]:
    """Return the mapping under the key ``joint_limits``, and the keys beside it, such as ``cartesian_limits``."""
    while isinstance(data, dict) and "joint_limits" not in data and (inner := [key for key in NESTED if key in data]):
        data = data[inner[0]]
    joints = data.get("joint_limits") if isinstance(data, dict) else None
    if not isinstance(joints, dict) or not joints:
        raise InvalidInput(file, "no joint_limits", "joint_limits with a mapping for each joint, as MoveIt writes them")
    return joints, [str(key) for key in data if key != "joint_limits"]


def _read_deceleration(entry: dict[str, Any], where: str, known: float) -> float:
    """Return the deceleration of one joint, the known one if the file has none, and infinity if it is switched off."""
    key, switch = DECELERATION
    if entry.get(switch) not in (None, True, False):
        raise InvalidInput(f"{where}, {switch}", repr(entry[switch])[:60], "true or false")
    if entry.get(switch) is False:
        return np.inf
    if key not in entry:
        return known
    where, expected = f"{where}, {key}", "a deceleration below 0, as Pilz writes it"
    return check_number(-check_number(entry[key], where, expected), where, expected, above=0.0)


def _read(entry: dict[str, Any], kind: str, keys: tuple[str, ...], where: str, values: Array) -> None:
    """Write the limits of one joint (one, or a pair) into `values`, if the file has them."""
    switch = entry.get(f"has_{kind}_limits")
    if switch not in (None, True, False):
        raise InvalidInput(f"{where}, has_{kind}_limits", repr(switch)[:60], "true or false")
    if switch is False:
        values[:] = np.inf if len(keys) == 1 else (-np.inf, np.inf)
        return
    for k, key in enumerate(keys):
        if key in entry:
            above = {"above": 0.0} if len(keys) == 1 else {}
            values[k] = check_number(entry[key], f"{where}, {key}", "a limit above 0" if above else "a number", **above)
    if not values[0] <= values[-1]:
        raise InvalidInput(where, f"{keys[0]} {values[0]:g} above {keys[-1]} {values[-1]:g}", f"{keys[0]} ≤ {keys[-1]}")
