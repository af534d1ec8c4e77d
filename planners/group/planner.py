"""The planner of groups: it plans the motion of a chain through two members."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.group import WORLD, Group
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import solve_ik
from optik.ik.problem import check_start
from optik.scene import Scene
from optik.scene.world import chain_in_scene
from optik.types import Array
from planners.group.limits import join_limits, read_limits
from planners.group.result import GroupPlan
from planners.limits import MotionLimits
from planners.planning.planner import PlanOptions
from planners.planning.result import Plan

PlanChain = Callable[[Robot, Any, Array | None, PlanOptions], Plan]
"""The planner of one arm."""


def plan_group(
    group: Group, path: Any, q_start: Any, names: tuple[str | None, str | None],
    limits: Mapping[str, MotionLimits] | None, options: Mapping[str, Any], plan_chain: PlanChain,
) -> GroupPlan:  # fmt: skip
    """Return the plan of a group: along a path in the frame of one member, or to goals of all members.

    names: the members whose tools are the frame and the tool of the path.
    """
    frame, tool = _find_chain(group, names)
    if isinstance(path, Mapping) and names != (None, None):
        raise InvalidInput("tool", repr(tool), "none: goals by member have no path")
    scene, order, by_member = options["scene"], group.order(frame, tool), read_limits(group, limits)
    chain = group.chain(frame, tool)
    if scene is not None:
        chain = chain_in_scene(group, frame, tool, scene)
    start = None if q_start is None else _read_joints(group, q_start)[order]
    goal = path
    if isinstance(path, Mapping):
        if start is None:
            raise InvalidInput("q_start", "None", "the configuration that the motion starts from")
        goal = _find_goal(group, path, group.split(_read_joints(group, q_start)))[order]
    joined = join_limits(group, frame, tool, by_member)
    view = PlanOptions(**{**options, "limits": joined, "scene": None if scene is None else Scene()})
    return GroupPlan(group, frame, tool, by_member, scene, plan_chain(chain, goal, start, view))


def _find_chain(group: Group, names: tuple[str | None, str | None]) -> tuple[str, str]:
    """Return the two members of the chain; by default those that are left."""
    members = list(group.members)
    if len(members) != 2:
        raise InvalidInput("group", f"{len(members)} members", "two members, for a plan")
    frame, tool = names
    if tool is None:
        tool = next(name for name in members[::-1] if name != frame) if frame is not None else members[0]
    if frame is None:
        frame = next((name for name in members if name != tool), WORLD)
    if frame == WORLD:
        raise InvalidInput("frame", repr(frame), f"a member; in the world plan with group.members[{tool!r}] alone")
    group.chain(frame, tool)
    return frame, tool


def _read_joints(group: Group, q: Any) -> Array:
    """Return joints of the group, given as such or by member."""
    parts = group.split(group.stack(q) if isinstance(q, Mapping) else q)
    return group.stack(
        {name: check_start(group.members[name], part, f"q_start[{name!r}]") for name, part in parts.items()}
    )


def _find_goal(group: Group, goals: Mapping[str, ArrayLike], start: Mapping[str, Array]) -> Array:
    """Return the joints of goals by member: joints, or a pose in the world; a member without a goal stays."""
    if unknown := [name for name in goals if name not in group.members]:
        raise InvalidInput("path", ", ".join(map(str, unknown)), f"goals of {', '.join(group.members)}")
    found = dict[str, Array]()
    for name, robot in group.members.items():
        goal = np.asarray(goals.get(name, start[name]), dtype=np.float64)
        if goal.shape != (4, 4):
            found[name] = check_start(robot, goal, f"path[{name!r}]")
            continue
        result = solve_ik(robot, goal, q0=start[name])
        if not result:
            raise NoSolution(f"no configuration of {name} reaches the goal ({result.status})", advice="another goal")
        found[name] = result.q
    return group.stack(found)
