"""Limits of the members of a group as limits of a chain through two of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from optik.arm.group import Group
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array, Indices
from planners.limits import DERIVATIVES, TOOL_SPEEDS, MotionLimits, kind_of
from planners.limits.base import sides
from planners.limits.member import MemberValue

PATH = "path"
"""Key of the limits on the speeds of the tool along the path, in the frame of the path."""


def read_member_limits(group: Group, limits: Any) -> dict[str, MotionLimits]:
    """Return the limits of every member, by default its own, and those along the path."""
    if limits is not None and not isinstance(limits, Mapping):
        expected = f"a mapping from {', '.join(group.members)} (and {PATH!r}) to MotionLimits"
        raise InvalidInput("limits", repr(limits)[:60], expected)
    given = dict(limits or {})
    for name, value in given.items():
        if name not in (*group.members, PATH):
            raise InvalidInput("limits", repr(name)[:60], f"keys out of {', '.join((*group.members, PATH))}")
        if not isinstance(value, MotionLimits):
            raise InvalidInput(
                f"limits[{name!r}]", repr(value)[:60], f"MotionLimits of {', '.join(group.members)}, {PATH}"
            )
    along = given.pop(PATH, MotionLimits())
    if unknown := [name for name in along.given_names if name not in TOOL_SPEEDS]:
        raise InvalidInput(f"limits[{PATH!r}]", ", ".join(unknown), " and ".join(TOOL_SPEEDS))
    own = {name: given.get(name) or MotionLimits.of(robot) for name, robot in group.members.items()}
    return own | {PATH: along}


def join_member_limits(group: Group, chain: Robot, limits: Mapping[str, MotionLimits]) -> MotionLimits:
    """Return the limits of members as those of a chain: rates by joint, all others in the member's own base."""
    order, given, extra, own = group.places(chain), dict[str, Any](), dict[str, Any](), dict[str, Any]()
    robots = [(robot, limits[name]) for name, robot in group.members.items()]
    for name in DERIVATIVES:
        given[name] = _join(name, [(robot, one.value(name)) for robot, one in robots], np.argsort(order))
        model = _join(name, [(robot, (one.robot_values or {}).get(name)) for robot, one in robots], np.argsort(order))
        own |= {} if model is None else {name: model}
    for member in group.members:
        one, columns = limits[member], tuple(order[group.columns(member)].tolist())
        for name in one.names:
            if name not in DERIVATIVES and one.value(name) is not None:
                value = MemberValue(group.members[member], columns, one.value(name))
                extra[f"{member}.{name}"] = value
                own |= {} if name in one.given_names else {f"{member}.{name}": value}
    along = {name: limits[PATH].value(name) for name in TOOL_SPEEDS}
    return MotionLimits(**given, **along, extra=extra, robot_values=own)


def _join(name: str, values: Sequence[tuple[Robot, Any]], order: Indices) -> Array | None:
    """Return the velocity, acceleration or jerk limits of all joints in the given order, or None if no joint has one."""
    if all(value is None for _, value in values):
        return None
    pairs = [np.stack(sides(kind_of(name).array(value, robot.n))) for robot, value in values]
    both = np.concatenate(pairs, axis=1)[:, order]
    return both[1] if (both[0] == -both[1]).all() else both
