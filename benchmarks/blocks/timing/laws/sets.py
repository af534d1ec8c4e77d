"""What a block of timed lines is made of: sets of motions on an arm with its payload, and sets of limits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

from benchmarks.blocks._arms import arm_label, arm_with, read_payload
from benchmarks.blocks.base import Entry
from benchmarks.blocks.timing.laws.motions import MOTION_KINDS
from benchmarks.settings import check_keys, check_known, check_table
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file
from planners.limits import ALL_LIMITS, TOOL_SPEEDS, MotionLimits

OF_ROBOT = "robot"
"""Value of a limit in a suite that means the limit of each robot itself."""


@dataclass(frozen=True)
class LineSet:
    """Motions of a kind on a robot: straight lines, arcs, seams, joint moves, or the one in a file.

    Attributes
    ----------
    robot : str
        The arm: a name, or the path of a file.
    kind : str
        ``regular`` or ``near_singular`` straight lines, ``arc``, ``seam`` (a polyline), ``joints`` (a straight move in joint
        space), or ``file``.
    count : int
        How many, drawn at random.
    path : str
        For the kind ``file``: a CSV or NPZ file of waypoints, or a motion that `planners.save` wrote.
    payload : float or pair of floats
        Mass in the tool [kg], or [lightest, heaviest]; without it the payload that the robot's own file states.
    """

    robot: str
    kind: str
    count: int
    path: str = ""
    payload: float | tuple[float, float] | None = None

    @property
    def label(self) -> str:
        """What reports and targets call the kind: that of a file by the file's name."""
        return FilePath(self.path).name if self.path else self.kind

    @property
    def arm(self) -> str:
        """What reports and targets call the arm: its name, with the payload where one is given."""
        return arm_label(self.robot, self.payload)

    def load(self) -> Robot:
        """The arm, with its payload."""
        return arm_with(self.robot, self.payload)


@dataclass(frozen=True)
class LimitSet:
    """Limits of a motion, and what reports call them.

    Attributes
    ----------
    label : str
        What reports call them.
    limits : MotionLimits
        Those that are numbers.
    own : tuple of str
        Names of those that are the robot's own.
    """

    label: str
    limits: MotionLimits
    own: tuple[str, ...] = ()

    def of(self, robot: Robot) -> MotionLimits:
        """Return the limits on a robot."""
        theirs = MotionLimits.of(robot)
        values: dict[str, Any] = {name: theirs.value(name) for name in self.own}
        for name, value in values.items():
            if value is None:
                wanted = "numbers, or a robot whose file states this limit"
                if name in ("torque", "torque_rate"):
                    wanted += " and its masses"
                raise InvalidInput(f"limits {self.label!r}: {name}", f"{OF_ROBOT!r} with {robot.name}", wanted)
        found = replace(self.limits, **values)
        found.bounds(robot.n)
        return found

    @property
    def counts_torque(self) -> bool:
        """Whether the torque is limited."""
        return "torque" in self.own or self.limits.torque is not None


def told(limits: MotionLimits, entry: Entry) -> MotionLimits:
    """Limits that a law is told: all but those that its entry leaves out."""
    return limits.select(tuple(name for name in limits.names if name not in entry.without)) if entry.without else limits


def read_lines(data: Any, where: str) -> LineSet:
    """Check a set of motions."""
    at = f"{where}: lines"
    kind = check_table(data, at).get("kind")
    given = {"path"} if kind == "file" else {"count"}
    check_keys(data, {"robot", "kind", "payload"} | given, at, need={"robot", "kind"} | given)
    robot = check_known(data["robot"], "optik.robots", "robot")
    if kind not in MOTION_KINDS:
        raise InvalidInput(at, f"kind {kind!r}", f"one of {', '.join(MOTION_KINDS)}")
    payload = read_payload(data.get("payload"), f"{at}: payload")
    if kind == "file":
        return LineSet(robot, kind, 1, resolve_data_file(data["path"], f"{at}: path"), payload)
    check_count(data["count"], f"{at}: count", 1)
    return LineSet(robot, str(kind), data["count"], payload=payload)


def read_limits(data: Any, where: str) -> LimitSet:
    """Check a set of limits."""
    at = f"{where}: limits"
    check_keys(data, {"label", *ALL_LIMITS}, at)
    given = {field: data[field] for field in ALL_LIMITS if field in data}
    if not given:
        raise InvalidInput(at, "none", f"some of {', '.join(ALL_LIMITS)}")
    own = tuple(field for field, value in given.items() if value == OF_ROBOT)
    for field in own:
        if field in TOOL_SPEEDS:
            raise InvalidInput(
                f"{at}: {field}", repr(OF_ROBOT), "a number: robots have no limits of their own on the tool"
            )
    numbers = {field: value for field, value in given.items() if field not in own}
    words = ", ".join(f"own {field}" if field in own else str(value) for field, value in given.items())
    return LimitSet(str(data.get("label", words)), MotionLimits(**numbers), own)
