"""Groups on the command line: a file with members as ``--robot``, and the chain that ``--tool`` and ``--frame`` name."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import optik
from benchmarks.cli import readers
from benchmarks.cli.command import LIMIT_EXAMPLES, OPTIONS, MotionCommand, Start, option
from benchmarks.cli.readers import format_numbers, read_bound, read_configuration
from optik.arm.group import read_group
from optik.arm.model import unit_factors
from optik.arm.motors import maker_joints
from optik.check import locate_error
from optik.errors import InvalidInput
from optik.plugins.files import is_path, resolve_file, split_links
from optik.types import Array, Indices

OF_ONE_ARM = (
    "tip", "base", "values", "package_dir", "srdf", "without_shape", "gravity", "limits", "joint_names", "payload", "torque",
    "torque_rate", "rms_torque", "cycle", "stopping_time", "stopping_distance",
)  # fmt: skip
"""Options of one arm, which are refused with a group."""
TOOL_HELP = "Member of a group whose tool follows the path; or two members that carry a workpiece along it: left,right."
FRAME_HELP = "Member of a group in whose tool frame the path is given; by default the other one."
"""Help of the options that name members."""


def read_typed_group(robot: str, tool: str | None, frame: str | None) -> optik.Group | None:
    """Return the group of ``--robot``, or None for one arm, for which no member can be named."""
    group = read_group(robot)
    for name, value in (("--tool", tool), ("--frame", frame)) if group is None else ():
        if value is not None:
            _ = is_path(robot) and resolve_file(split_links(robot)[0], "robot")  # or there is no such file
            raise InvalidInput(name, value, "none for one arm: it names a member of a group's file")
    return group


def find_chain(group: optik.Group, tool: str | None, frame: str | None) -> optik.Robot:
    """Return the chain whose tool follows the path; of two members that carry a workpiece, the first one."""
    from planners.group.planner import check_carriers, find_members

    if tool is None and frame is None:
        expected = f"the member whose tool follows the path: {' or '.join(group.members)}"
        raise InvalidInput("--tool", f"none, with the group of {', '.join(group.members)}", expected)
    if "," in (tool or ""):
        return group.members[check_carriers(group, str(tool).split(","), frame)[0]]
    return group.chain(*find_members(group, (frame, tool)))


def find_order(group: optik.Group, arm: optik.Robot) -> Indices:
    """Return the indices in the group of the joints of a chain, or of a member."""
    same = [name for name, member in group.members.items() if member is arm]
    return group.columns(same[0]) if same else np.argsort(group.places(arm))


def read_start(group: optik.Group, text: str | None) -> tuple[Array, str]:
    """Return the typed start in the order of the group; or a sample, with a sentence on it."""
    if text is not None:
        return read_configuration(group.as_robot(), text), ""
    q = np.concatenate([optik.choose_start(robot) for robot in group.members.values()])
    return q, f"start of the group, a sample: --start-deg {format_joints(group.as_robot(), q)}"


def format_joints(arm: optik.Robot, q: Array) -> str:
    """Return joints as one argument of a command [degrees, prismatic mm]."""
    return format_numbers(maker_joints(arm, q) * unit_factors(arm))


@dataclass(frozen=True, kw_only=True)
class GroupCommand(MotionCommand):
    """A command on an arm or a group; a group's joints are typed and printed in the order of its members."""

    tool: str | None = option("Robot", TOOL_HELP, metavar="NAME")
    frame: str | None = option("Robot", FRAME_HELP, metavar="NAME")

    @cached_property
    def group(self) -> optik.Group | None:
        """The group of ``--robot``, or None for one arm."""
        group = read_typed_group(self.robot, self.tool, self.frame)
        mass = getattr(self, "payload", None) if "," in (self.tool or "") else None
        for name in () if group is None else OF_ONE_ARM:
            if (value := getattr(self, name, None)) is not None and value is not mass:
                expected = "none for a group, whose file and --limit MEMBER.NAME=VALUE state such values"
                raise InvalidInput(OPTIONS[name], value, expected)
        return group if group is None or mass is None else group.with_payload(read_bound(mass, "--payload"))

    def load(self, name: str = "") -> optik.Robot:
        """Load the arm whose tool follows the path: of a group, in the frame of the path."""
        return super().load(name) if self.group is None else find_chain(self.group, self.tool, self.frame)

    def load_start(self) -> Start:
        """Load the robot and its start."""
        if self.group is None:
            return super().load_start()
        arm, (q, words) = self.load(), read_start(self.group, self.start_deg)
        # Two members that carry a workpiece start where their path does.
        return Start(arm, q[find_order(self.group, arm)], words if arm.n == self.group.n else "", bool(words))

    def find_joints(self, start: Start) -> Any:
        """Return the start as the planner takes it; None if there is none."""
        if self.group is None or start.q is None:
            return start.q
        if start.arm.n == self.group.n:
            return start.q[self.group.places(start.arm)]
        return None if self.start_deg is None else read_start(self.group, self.start_deg)[0]

    def read_limits(self, arm: optik.Robot, law: Any) -> Any:
        """Return the typed limits, and the model's own for the others: of a group by member, and along the path."""
        if self.group is None:
            return super().read_limits(arm, law)
        from planners import MotionLimits
        from planners.limits import TOOL_SPEEDS

        every = {name: value for name in LIMIT_EXAMPLES if (value := getattr(self, name)) is not None}
        typed: dict[str, dict[str, Any]] = {name: dict(every) for name in self.group.members}
        for text in self.limit or ():
            (key, equals, value), known = text.partition("="), " or ".join(typed)
            member, _, name = key.partition(".")
            if member not in typed or not name or not equals:
                raise InvalidInput("--limit", repr(key), f"MEMBER.NAME=VALUE with a member: {known}")
            typed[member][name] = readers.read_limit(name, value)
        speeds = {
            name: read_bound(bound, OPTIONS[name]) for name in TOOL_SPEEDS if (bound := getattr(self, name, None))
        }
        limits = {"path": MotionLimits(**speeds)}
        for member, robot in self.group.members.items():
            try:
                limits[member] = self.complete_limits(robot, law, typed[member])
            except InvalidInput as error:
                raise locate_error(member, error) from None
        return limits
