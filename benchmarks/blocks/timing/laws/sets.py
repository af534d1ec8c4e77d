"""What a block of timed lines is made of: sets of motions on an arm with its payload, and sets of limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath
from typing import Annotated, Any

from pydantic import Field, model_validator

from benchmarks.blocks._arms import Payload, arm_label, arm_with
from benchmarks.blocks.base import Entry
from benchmarks.blocks.timing.laws.motions import MOTION_KINDS
from benchmarks.settings import Count, RobotName, Settings, check_keys, key, one_of
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file
from planners.limits import ALL_LIMITS, TOOL_SPEEDS, MotionLimits

OF_ROBOT = "robot"
"""Value of a limit in a suite that means the limit of each robot itself."""


class LineSet(Settings):
    """Motions of a kind on a robot, drawn at random, or the one in a file."""

    robot: RobotName = key("The arm: a name, or the path of a file.")
    kind: Annotated[str, one_of(*MOTION_KINDS)] = key(
        "Straight lines (`regular`, `near_singular`), `arc`, `seam` (a polyline), `joints` (straight in joint space), `file`."
    )
    count: Count = key("Number of motions; required, but for the kind `file`.", 1)
    path: str = key("For the kind `file`: a table of waypoints, or a motion that `planners.save` wrote.", "")
    payload: Payload = key("Mass in the tool, or [lightest, heaviest]; by default that of the robot file.", None, "kg")

    @model_validator(mode="before")
    @classmethod
    def _count_or_path(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = "path" if data.get("kind") == "file" else "count"
        check_keys(data, {"robot", "kind", "payload", given}, "", {"robot", "kind", given})
        return data | {"path": resolve_data_file(data["path"], "path")} if given == "path" else data

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


class LimitSet(Settings):
    """Limits of a motion: numbers, one for each joint, or ``"robot"`` for the robot's own."""

    velocity: Any = key('Velocity limit: a number, one for each joint, or `"robot"`.', None, "rad/s, m/s")
    acceleration: Any = key("Acceleration limit.", None, "rad/s², m/s²")
    jerk: Any = key("Jerk limit.", None, "rad/s³, m/s³")
    torque: Any = key("Torque limit, for an arm with known masses.", None, "N·m, N")
    torque_rate: Any = key("Torque rate limit.", None, "N·m/s, N/s")
    tool_speed: Any = key("Limit on the speed of the tool point.", None, "m/s")
    rotation_speed: Any = key("Limit on the angular speed of the tool.", None, "rad/s")
    label: str = Field(default_factory=lambda given: _words(given), description="Name of these limits in reports.")

    @model_validator(mode="after")
    def _of_motions(self) -> LimitSet:
        if not self._given:
            raise InvalidInput("", "none", f"some of {', '.join(ALL_LIMITS)}")
        for field in self.own:
            if field in TOOL_SPEEDS:
                raise InvalidInput(field, repr(OF_ROBOT), "a number: robots have no limits of their own on the tool")
        _ = self.limits
        return self

    @property
    def _given(self) -> dict[str, Any]:
        return {field: value for field in ALL_LIMITS if (value := getattr(self, field)) is not None}

    @property
    def own(self) -> tuple[str, ...]:
        """Names of those that are the robot's own."""
        return tuple(field for field, value in self._given.items() if value == OF_ROBOT)

    @property
    def limits(self) -> MotionLimits:
        """Those that are numbers."""
        return MotionLimits(**{field: value for field, value in self._given.items() if value != OF_ROBOT})

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


def _words(given: dict[str, Any]) -> str:
    """Limits in words, in the order of the file."""
    return ", ".join(
        f"own {field}" if value == OF_ROBOT else str(value) for field, value in given.items() if value is not None
    )
