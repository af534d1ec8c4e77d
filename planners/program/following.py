"""The parts of a program, followed one after another; where a configuration can be chosen, with the parts behind in view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import get_solver
from optik.ik.problem import check_start
from optik.types import Array
from planners.certificate.certification import Conditions, conditions_for
from planners.following.branches import CollisionCheck, find_branches
from planners.following.failure import PlanFailure
from planners.following.follow import FollowResult, follow
from planners.following.joint_path import JointPath, cut_joints
from planners.limits import TOOL_SPEEDS, MotionLimits
from planners.motion import PlanStatus
from planners.paths.base import Path
from planners.paths.configurations import choose_configurations
from planners.paths.free_path import FreePath
from planners.paths.goal import unwind
from planners.paths.joint_curve import JointCurve
from planners.paths.joint_line import JointLine
from planners.paths.poses import NO_LENGTH
from planners.paths.program import ProgramPath
from planners.planning.planner import PlanOptions
from planners.planning.result import Plan
from planners.program.parts import Part, Program, ToolChange, make_part_path

MOST_SAMPLES_A_PART = 31
"""Largest number of samples of each part for the IK method."""
GAP = 1e-6
"""Largest distance [m, rad] of the start of a part's path from the end of the part before, which counts as rounding."""
MOST_MOVED = 3.0
"""Largest distance of the tool from a part whose gap fades out along it, over the largest gap."""
SMOOTH = 1e-6
"""Largest difference of the twists and their first two derivatives where two parts meet that counts as smooth."""
NO_GAP = 1e-12
"""Rounding of the joints [rad, m] where the tool's path is solved for again."""
FOLLOWED = 0.95
"""Fraction of its share of the tolerance that following may use."""
ADVICE = "another goal or path of this part, or joints as the goal of a part before it"
"""What to try if a part cannot be followed."""

PlanPath = Callable[[Robot, Any, Array | None, PlanOptions], Plan]
"""Plans one path or goal from a start configuration."""


class Leg(NamedTuple):
    """A part that was followed: its arm, path, joint path if the path is Cartesian, and the configurations at its ends.

    A part of length 0 has no joint path.
    """

    part: int
    robot: Robot
    path: Path
    joint_path: JointPath | None
    ends: tuple[Array, Array]
    plan: Plan | None = None


class FailedPart(NamedTuple):
    """A part that could not be followed, with the joint path up to where it fails."""

    path: Path
    failure: PlanFailure
    prefix: JointPath | None = None


@dataclass(frozen=True)
class PartFollower:
    """Follows the parts of a program; parts with something to choose are planned for themselves."""

    robot: Robot
    program: Program
    plan_path: PlanPath
    options: PlanOptions

    # ------------------------------------------------------------ following the parts

    @cached_property
    def _ahead(self) -> dict[int, JointPath]:
        """Joint paths of parts that were followed together with an earlier part."""
        return {}

    @cached_property
    def robots(self) -> list[Robot]:
        """The arm of each part."""
        robots, robot = list[Robot](), self.robot
        for item in self.program.items:
            if isinstance(item, ToolChange):
                robot = item.apply(robot)
            elif isinstance(item, Part):
                robots.append(robot)
        return robots

    def follow_all(self, q: Array | None) -> tuple[list[Leg], FailedPart | None]:
        """Return the parts, followed one after another; where a part cannot be followed, those before it and the failure."""
        legs: list[Leg] = []
        while len(legs) < len(self.program.parts):
            run, failed = self._follow_run(len(legs), q)
            legs += run
            if failed is not None:
                return legs, failed
            q = run[-1].ends[1]
        if not any(leg.path.end > NO_LENGTH for leg in legs):
            robot, path, q = legs[0].robot, legs[0].path, None if legs[0].path.in_joints else legs[0].ends[0]
            return legs, self.explain(0, path, self._follow_path(robot, path, q, None).failure)
        return legs, None

    def _follow_run(self, k: int, q: Array | None) -> tuple[list[Leg], FailedPart | None]:
        """Return a part, and where its configuration must be chosen, the Cartesian parts behind it, too."""
        goal = self.program.parts[k].goal
        try:
            candidates = self._list_candidates(k, q)
        except NoSolution as error:
            where = JointLine(self.robots[k], q, q) if q is not None else goal
            return [], self.explain(k, where, PlanFailure.from_error(PlanStatus.UNREACHABLE, error))
        if candidates is None:
            leg = self._follow_part(k, q, None)
            return ([leg], None) if isinstance(leg, Leg) else ([], leg)
        best: tuple[tuple[int, float], list[Leg], FailedPart] | None = None
        for chosen in candidates:
            run, failed = self._try(k, q, chosen)
            if failed is None:
                return run, None
            rank = len(run), failed.failure.s
            if best is None or rank > best[0]:
                best = rank, run, failed
        if best is None:  # following says why
            followed = self._follow_path(self.robots[k], goal, None, "best")
            return [], self.explain(k, goal, followed.failure, followed.joint_path)
        _, run, failed = best
        return run, self._say_tried(failed, k, len(run), len(candidates))

    def _try(self, k: int, q: Array | None, chosen: Array) -> tuple[list[Leg], FailedPart | None]:
        """Return the run of parts that follows from a choice: it ends before joints, or before the next choice."""
        run: list[Leg] = []
        for i, part in enumerate(self.program.parts[k:], k):
            if run and not part.is_cartesian:
                break
            leg = self._follow_part(i, q, None if run else chosen)
            if isinstance(leg, FailedPart):
                return run, leg
            run.append(leg)
            q = leg.ends[1]
        return run, None

    def _list_candidates(self, k: int, q: Array | None) -> list[Array] | None:
        """Return the configurations among which a part chooses, of its start or of its goal; None if there is no choice."""
        part, robot = self.program.parts[k], self.robots[k]
        _, scene = self.find_conditions(robot)
        rooms = None if scene is None else CollisionCheck(robot, scene).find_rooms
        if q is None:
            if not isinstance(part.goal, Path):
                raise InvalidInput(
                    "q_start", "None", f"where the arm starts: {self.program.label(k)} is a goal, not a path"
                )
            known = part.goal.configurations(robot, np.zeros(1))
            return [known[0]] if known is not None else self._find_starts(robot, part.goal, None, rooms)
        if part.move != "joint":  # for which a configuration is chosen
            return None
        after = zip(self.program.parts[k + 1 :], self.robots[k + 1 :], strict=True)
        paths = (make_part_path(other, part.goal) for other, arm in after if arm is robot)
        path = next((path for path in paths if path is None or path.end > NO_LENGTH), None)
        starts = [] if path is None else self._find_starts(robot, path, q, rooms)
        if starts:
            return starts
        usable = None if rooms is None else (lambda x: rooms(x) > 0.0)
        try:
            return [choose_configurations(robot, q, [part.goal], usable)[-1]]
        except NoSolution as error:
            raise NoSolution(error.reason.replace("point 0", "the goal"), advice=error.advice) from None

    def _find_starts(self, robot: Robot, path: Path, q: Array | None, rooms: Any) -> list[Array]:
        """Return the configurations at the start of a Cartesian path from which it can be followed farthest, the best first."""
        if robot.n <= 6:
            return [branch.q for branch in find_branches(robot, path, q, rooms) if np.isfinite(branch.cost)]
        followed = self._follow_path(robot, path, q, "best")
        return [] if followed.joint_path is None else [followed.joint_path.q[0]]

    def _follow_path(self, robot: Robot, path: Path, q: Array | None, branch: str | None) -> Any:
        options = self.options
        share = options.tolerance.scale(0.5 * FOLLOWED)
        samples = min(options.samples, MOST_SAMPLES_A_PART)
        solver, (_, scene) = get_solver(robot, options.solver), self.find_conditions(robot)
        return follow(
            solver, path, q, branch=branch, samples=samples, tolerance=share, scene=scene, resolve=options.resolve,
            time_limit=options.time_limit,
        )  # fmt: skip

    def _follow_part(self, k: int, q: Array | None, chosen: Array | None) -> Leg | FailedPart:
        """Return a part followed from a configuration; `chosen` is the one of its goal, or of its start if there is none."""
        part, robot, label = self.program.parts[k], self.robots[k], self.program.label(k)
        goal = part.goal
        if q is None:
            q, chosen = chosen, None
        assert q is not None
        try:
            if chosen is not None:
                path: Path = JointLine(robot, q, chosen)
            elif isinstance(goal, JointCurve):  # one part has one tool speed
                path = JointCurve(goal.robot, goal.s, goal.q, goal.derivatives, breaks=goal.breaks)
            elif isinstance(goal, Path):
                path = goal
            elif (line := make_part_path(part, robot.fk(q))) is not None:
                path = line
            else:
                end = check_start(robot, goal, "goal")
                path = JointLine(robot, q, unwind(robot, end, q) if self.options.winding == "nearest" else end)
            self._check_gap(k, path, q)
            if not path.end > NO_LENGTH:
                return Leg(k, robot, path, None, (q, q))
            if part.avoid is not False or isinstance(path, FreePath):
                return self._plan_part(k, path if chosen is None and isinstance(goal, Path) else None, q, chosen)
            followed = self._follow_on(k, path, q)
        except InvalidInput as error:
            if error.argument.startswith(label):
                raise
            raise InvalidInput(f"{label}: {error.argument}", error.got, error.expected, advice=error.advice) from None
        if followed.failure is not None:
            return self.explain(k, path, followed.failure, followed.joint_path)
        path, joints = self._close_gap(k, path, followed.joint_path, q)
        return Leg(k, robot, path, joints, (q, joints.q[-1]))

    def _follow_on(self, k: int, path: Path, q: Array) -> Any:
        """Follow a part from a configuration; for a redundant arm, together with the parts that continue it smoothly."""
        known, robot, paths = self._ahead.pop(k, None), self.robots[k], [path]
        if known is not None and np.array_equal(known.q[0], q):
            return FollowResult(known, None)
        while robot.n > 6 and (further := self._find_further(k + len(paths) - 1, paths[-1])) is not None:
            paths.append(further)
        if len(paths) > 1:
            whole = ProgramPath(paths, [robot] * len(paths))
            if joints := self._follow_path(robot, whole, q, "start"):
                for i, (part, a) in enumerate(zip(paths, whole.starts, strict=False), k):
                    self._ahead[i] = cut_joints(joints.joint_path, part, a)
                return FollowResult(self._ahead.pop(k), None)
        return self._follow_path(robot, path, None if path.in_joints else q, None)

    def _find_further(self, k: int, path: Path) -> Path | None:
        """Return the path of the part after part k if it continues a path smoothly, without a stop."""
        parts, after = self.program.parts, self.robots[k + 1 : k + 2]
        if path.in_joints or parts[k].blend == 0.0 or after != [self.robots[k]] or parts[k + 1].avoid is not False:
            return None
        further = make_part_path(parts[k + 1], path.pose(path.end))
        if further is None or isinstance(further, FreePath) or further.unit != path.unit or not further.end > 0.0:
            return None
        off = [np.abs(further(0.0, order) - path(path.end, order)).max() for order in range(4)]
        return further if off[0] <= GAP and max(off[1:]) <= SMOOTH else None

    def _close_gap(self, k: int, path: Path, joints: JointPath, q: Array) -> tuple[Path, JointPath]:
        """Return a followed part that begins exactly where the arm is: a gap that counts as rounding fades out along it."""
        off, robot = q - joints.q[0], self.robots[k]
        far = float(np.abs(off).max())
        if far <= (0.0 if path.in_joints else NO_GAP):
            return path, joints
        if isinstance(path, JointLine):
            closed: Path = JointLine(robot, q, path.q_goal)
        else:
            nodes = joints.at_nodes + fade_out(joints.nodes)[:, :, None] * off
            closed = JointCurve(robot, joints.nodes, nodes[:, 0], nodes[:, 1:])
            moved = np.abs(robot.pose_errors(nodes[:, 0], path(joints.nodes))).max(axis=0)
            if not path.in_joints and (moved > MOST_MOVED * GAP).any():
                got = f"one that begins {far:.3g} (rad, m) from the joints at {self._before(k)}: the arm is nearly singular"
                raise InvalidInput(self.program.label(k), got, "a path that begins there")
        followed = self._follow_path(robot, closed, None, None)
        return (path, joints) if followed.failure is not None else (closed, followed.joint_path)

    def _before(self, k: int) -> str:
        """Return words for where a part begins."""
        return f"the end of {self.program.label(k - 1)}" if k else "q_start"

    def _plan_part(self, k: int, path: Path | None, q: Array, chosen: Array | None) -> Leg | FailedPart:
        """Return a part whose path is chosen by its own plan: with freedoms, or around obstacles."""
        part, robot, tolerance = self.program.parts[k], self.robots[k], self.options.tolerance
        goal = path if path is not None else part.goal if chosen is None else chosen
        found = self.plan_alone(robot, goal, q, self.find_limits(part), avoid=part.avoid, tolerance=tolerance)
        if not found:
            assert found.failure is not None
            return self.explain(k, found.path, found.failure, found.prefix)
        return Leg(k, robot, found.path, found.joint_path, (q, found.goal), found)

    def _check_gap(self, k: int, path: Path, q: Array) -> None:
        """Raise InvalidInput if a path does not begin where the arm is."""
        robot = self.robots[k]
        own = path.configurations(robot, np.zeros(1))
        off = robot.pose_errors(q, path.pose(0.0)) if own is None else own[0] - q
        if np.abs(off).max() <= GAP:
            return
        far = f"{1e3 * np.linalg.norm(off[:3]):.3g} mm and {np.degrees(np.linalg.norm(off[3:])):.3g}°"
        far = far if own is None else f"{np.abs(off).max():.3g} (rad, m)"
        got = f"a path that begins {far} from {self._before(k)}"
        raise InvalidInput(self.program.label(k), got, "a path that begins there")

    # ------------------------------------------------------------ words

    def explain(self, k: int, path: Path, failure: PlanFailure, prefix: JointPath | None = None) -> FailedPart:
        """Return the failure of a part, which names it."""
        reason = f"{self.program.label(k)} ({path.name.replace('_', ' ')}): {failure.reason}"
        advice = ADVICE if "branch=" in failure.advice or not failure.advice else failure.advice
        return FailedPart(path, replace(failure, reason=reason, advice=advice, part=k), prefix)

    def _say_tried(self, failed: FailedPart, k: int, followed: int, count: int) -> FailedPart:
        """Return a failure with the number of configurations that were tried."""
        if count == 1:
            return failed
        what = f"parts {k + 1} to {k + followed + 1}" if followed else "it"
        where = (
            "of its start" if followed == 0 and self.program.parts[k].move != "joint" else f"at {self.program.label(k)}"
        )
        words = f"{failed.failure.reason}; none of the {count} configurations {where} follows {what}"
        return failed._replace(failure=replace(failed.failure, reason=words))

    def find_limits(self, part: Part) -> MotionLimits:
        """Return the limits of a part alone."""
        own: dict[str, Any] = {n: value for n in TOOL_SPEEDS if (value := self.find_speed(part, n)) is not None}
        return replace(self.options.limits, **own) if own else self.options.limits

    def plan_alone(self, robot: Robot, path: Any, q: Array | None, limits: MotionLimits, **given: Any) -> Plan:
        """Return the plan of a path for one arm of the program."""
        limits, scene = self.find_conditions(robot, limits)
        return self.plan_path(robot, path, q, replace(self.options, limits=limits, scene=scene, duration=None, **given))

    def find_conditions(self, robot: Robot, limits: MotionLimits | None = None) -> Conditions:
        """Return limits, by default those of the whole program, and the scene for one of its arms."""
        return conditions_for(robot, self.robots, limits or self.options.limits, self.options.scene)

    def find_speed(self, part: Part, name: str) -> float | None:
        """Return the lesser of a part's tool speed and the one of the whole program."""
        given = [x for x in (getattr(part, name), self.options.limits.value(name)) if x is not None]
        return min(given, default=None)


def fade_out(s: Array) -> Array:
    """Return a function (k, 4) of s with its derivatives, from 1 at the first s to 0 at the last, whose ends are at rest."""
    u, v, length = s / s[-1], 1.0 - s / s[-1], s[-1]
    return np.stack([
        1.0 - u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3), -140.0 * (u * v) ** 3 / length,
        -420.0 * (u * v) ** 2 * (1.0 - 2.0 * u) / length**2, -840.0 * u * v * (1.0 - 5.0 * u * v) / length**3,
    ], axis=1)  # fmt: skip
