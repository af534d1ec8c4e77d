"""The planner of groups: it plans the motion of a chain through two members."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.group import WORLD, Group
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, get_solver, solve_ik
from optik.ik.problem import check_start
from optik.registry import label
from optik.scene import Scene
from optik.scene.world import chain_in_scene
from optik.types import Array
from planners.certificate.violation import LIMIT_WORDS, check_allow
from planners.choice.choose import ChoiceReport, pick_plan, report
from planners.following.follow import FollowResult, make_follower, read_time_limit
from planners.group.carry import follow_branch_pairs
from planners.group.limits import PATH, join_member_limits, read_member_limits
from planners.group.result import GroupPlan
from planners.group.still import follow_still, list_still
from planners.limits import TOOL_SPEEDS, MotionLimits
from planners.motion import PlanStatus
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.planning.planner import PATH_FRACTION, PathPlanner, PlanOptions, PlanRequest
from planners.planning.result import Plan
from planners.timing import make_law

STILL = ChoiceReport("the frame does not move: motions with a moving frame take longer, or need more joint travel")
PlanChain = Callable[[Robot, Any, Array | None, PlanOptions], Plan]
"""The planner of one arm."""


def plan_group(
    group: Group, path: Any, q_start: Any, names: tuple[str | None, Any], limits: Any,
    options: Mapping[str, Any], plan_chain: PlanChain,
) -> GroupPlan:  # fmt: skip
    """Return the plan of a group.

    path: a path in the tool frame of a member, a path of a carried workpiece in the world, or goals by member. names: (frame,
    tool). For a carried workpiece, tool is the pair of members.
    """
    carriers = names[1] if isinstance(names[1], tuple | list) else ()
    for argument, value in zip(("frame", "tool"), names, strict=True) if isinstance(path, Mapping) else ():
        if value is not None:
            raise InvalidInput(argument, repr(value)[:60], "none: goals by member have no path")
    scene, by_member = options["scene"], read_member_limits(group, limits)
    if isinstance(path, Mapping) and len(group.members) > 2:
        (frame, tool), chain = (WORLD, list(group.members)[-1]), group.as_robot()
        options = {**options, "solver": "dls"}  # for any number of joints; goals of joints need no inverse kinematics
    else:
        frame, tool = find_members(group, check_carriers(group, carriers, names[0]) if carriers else names)
        chain = group.chain(frame, tool) if scene is None else chain_in_scene(group, frame, tool, scene)
    order = np.argsort(group.places(chain))
    start, goal = None if q_start is None else _read_joints(group, q_start), path
    if isinstance(path, Mapping):
        if start is None:
            raise InvalidInput("q_start", "None", "the configuration that the motion starts from")
        goal = _find_goal(group, path, group.split(start))[order]
    if carriers:  # the workpiece moves over ground, as the tools of both
        by_member[tool] = replace(
            by_member[tool],
            **{name: by_member[PATH].value(name) for name in TOOL_SPEEDS if by_member[PATH].value(name) is not None},
        )
    joined = join_member_limits(group, chain, by_member)
    view = PlanOptions(**{**options, "limits": joined, "scene": scene if scene is None or frame == WORLD else Scene()})
    result = partial(GroupPlan, group, frame, tool, by_member, scene)
    if carriers:
        starts = [None if start is None else start[group.columns(name)] for name in (frame, tool)]
        arms = [group.members[name] for name in (frame, tool)]
        return result(_carry(chain, arms, path, starts, view), dict.fromkeys((frame, tool), path))
    plan = plan_chain(chain, goal, None if start is None else start[order], view)
    if isinstance(goal, Path) and goal.asked == "pose" and view.avoid is False:
        members = group.members[frame], group.members[tool]
        parts = None if start is None else (start[group.columns(frame)], start[group.columns(tool)])
        plan = _plan_still(plan, chain, members, parts, view)
    return result(plan, {})


def check_carriers(group: Group, carriers: Sequence[Any], frame: str | None) -> tuple[str, str]:
    """Return the two members that carry a workpiece."""
    if len(carriers) != 2 or len({*carriers}) != 2 or any(name not in group.members for name in carriers):
        raise InvalidInput("tool", repr(carriers)[:60], f"two of {', '.join(group.members)}, to carry a workpiece")
    if frame not in (None, WORLD):
        raise InvalidInput("frame", repr(frame), f"none, or {WORLD!r}: the path of a workpiece is in the world")
    return carriers[0], carriers[1]


def _carry(
    chain: Robot, arms: Sequence[Robot], path: Any, starts: Sequence[Array | None], options: PlanOptions
) -> Plan:
    """Return the plan of the chain through two arms that carry a workpiece.

    It uses the first pair of branches that solves it or, if none does, is the failed plan of the first pair.
    """
    if not isinstance(path, Path) or path.in_joints or path.asked != "pose":
        raise InvalidInput("path", repr(path)[:60], "a path of the workpiece with all six coordinates")
    solvers = [get_solver(arm, options.solver) for arm in arms]
    planner, follow = _make_planner(chain, path, solvers[0], options)
    plans = []
    for joints in follow_branch_pairs(solvers, path, chain, options.scene, follow, starts):
        if isinstance(joints, FollowResult):
            assert joints.failure is not None
            return planner.request.fail(PlanStatus(joints.failure.status), None, joints.failure)
        plans.append(planner.time_joints(joints.path, joints, options.duration)[0])
        if plans[-1]:
            return plans[-1]
    return plans[0]


def _make_planner(
    chain: Robot, path: Path, solver: IKSolver, options: PlanOptions
) -> tuple[PathPlanner, Callable[[IKSolver, Array | None], FollowResult]]:
    """Return a planner that times and certifies joint paths of a chain, and a function that follows the path with one arm."""
    law, seconds = make_law(options.timing), read_time_limit(options.resolve, options.time_limit)
    law.need(options.limits, chain)
    request = PlanRequest(
        chain, path, options.limits, label(solver), law, options.tolerance, options.rate, scene=options.scene,
        allow=check_allow(options.allow, LIMIT_WORDS),
    )  # fmt: skip

    def follow(solver: IKSolver, q: Array | None) -> FollowResult:
        branch, allowed = options.branch or ("best" if q is None else "start"), options.tolerance.scale(PATH_FRACTION)
        return make_follower(solver, path, q, branch, options.samples, allowed, None, seconds).run()

    return PathPlanner(solver, request, options.samples, options.strict, seconds), follow


def _plan_still(
    plan: Plan, chain: Robot, members: tuple[Robot, Robot], start: tuple[Array, Array] | None, options: PlanOptions
) -> Plan:
    """Return the plan, or a plan with a fixed frame if it is faster, or as fast with less joint travel.

    members: those with the frame and with the tool; start: their joints, if they are given.
    """
    path, (frame, arm) = plan.path, members
    if (isinstance(path, FreePath) and (set(path.bounds) != {"elbow"} or not plan.has_motion)) or path.in_joints:
        return plan
    first = start[0] if start else plan.trajectory(0.0)[: frame.n][::-1] if plan.has_motion else None
    still = [] if first is None else [first]
    still += [] if start else list_still(frame)
    options = replace(options, resolve="local")  # a search along the whole path would cost more than it gains
    planner, follow = _make_planner(chain, path, get_solver(chain, options.solver), options)

    def follow_arm(moved: Robot) -> FollowResult:
        return follow(get_solver(moved, options.solver), start[1] if start else None)

    plans = [plan] if plan else []
    for joints in follow_still(chain, frame, arm, still, follow_arm, MotionLimits.of(arm)):
        timed = planner.time_joints(path, joints, options.duration)[0]
        plans += [timed] if timed else []
    best = pick_plan(plans) if plans else plan
    return best if best is plan or plan.freedom is None else replace(best, freedom=report(best, STILL))


def find_members(group: Group, names: tuple[str | None, str | None]) -> tuple[str, str]:
    """Return the members (frame, tool) of the chain.

    A member that is not named is the other one. Without names, the tool is the first member.
    """
    members = list(group.members)
    if len(members) != 2:
        raise InvalidInput("group", f"{len(members)} members", "two members, for a plan")
    frame, tool = names
    if tool is None:
        tool = next(name for name in members[::-1] if name != frame) if frame is not None else members[0]
    if frame is None:
        frame = next((name for name in members if name != tool), WORLD)
    if frame not in members:
        advice = f"a path in the world is one of {tool!r} alone" if frame == WORLD else ""
        raise InvalidInput("frame", repr(frame)[:60], f"a member other than {tool!r}", advice=advice)
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
