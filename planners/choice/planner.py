"""The planner of one motion: it follows a path, chooses what is free, times and certifies."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik.problem import check_start
from optik.types import Array
from planners.choice.choose import CHOSEN, ChoiceReport, pick_plan, report
from planners.choice.first_paths import advise_elbow
from planners.choice.ways import DENSITIES, FEW_SEGMENTS, choose_on_path, choose_searched
from planners.following.branches import CollisionCheck
from planners.following.failure import PlanFailure
from planners.following.follow import START_TOLERANCE, FollowResult, FollowStatus
from planners.following.resolve.freedoms import FreeWay, Resolver, can_resolve
from planners.motion import PlanStatus
from planners.paths.base import Path
from planners.paths.free_path import FEWEST_JOINTS, FreePath
from planners.paths.point_to_point import PointToPoint
from planners.planning.planner import PathPlanner
from planners.planning.result import Plan, PlanSeconds
from planners.timing.optimal import Optimal

MAY_CHANGE = tuple(
    FollowStatus[name] for name in ("OUTSIDE_LIMITS", "BRANCH_JUMP", "SINGULAR", "CONTACT", "UNREACHABLE")
)
"""Failures that other configurations, or other values of the freedoms, can change."""


class MotionPlanner(PathPlanner):
    """Follows, chooses, times and certifies under one request."""

    def run(self, q_start: ArrayLike | None, branch: str | None, duration: float | None) -> Plan:
        """Return the plan along the requested path, with the durations of its parts."""
        path = self.request.path
        asked = path.asking(self.request.robot) if isinstance(path, FreePath) else path
        if asked.asked == "pose":
            return self._run(q_start, branch, duration)
        plans = list[Plan]()
        for one in (asked, *_list_stricter(asked, self.request.robot)):  # more freedom is never less
            planner = replace(self, request=replace(self.request, path=one))
            try:
                plans.append(planner._run(q_start, branch, duration))
            except InvalidInput:
                if one is asked:
                    raise
        valid = [plan for plan in plans if plan]
        return pick_plan(valid) if valid else plans[0]

    def _run(self, q_start: ArrayLike | None, branch: str | None, duration: float | None) -> Plan:
        """Return the plan along a path whose coefficients are chosen, or of which less than the pose is asked."""
        started, path = perf_counter(), self.request.path
        if self.request.unreachable is not None:
            return self.request.infeasible(None, self.request.unreachable, PlanStatus.UNREACHABLE)
        if _is_chosen(path) and q_start is not None and branch != "best":
            path, q_start, chosen = self._begin(path, q_start, duration)
            if chosen is not None:
                return chosen
        around, has_start = self.request.avoid is not False and path.asked == "pose", q_start is not None
        ways = list[FreeWay]()
        if _is_chosen(path):
            path, followed, ways = self._resolve(path, q_start, branch, held=has_start and path.hold_start)
        else:
            branch = "best" if has_start and isinstance(path, FreePath) and not path.hold_start else branch
            followed = self.follow(path, q_start, branch, None if around else self.request.scene)
        if around and followed.status is FollowStatus.CONTACT and followed.joint_path is not None:
            followed = followed._replace(failure=None)  # to be moved out of contact
        ended = perf_counter()
        planner = self._with_optimal(path) if _is_chosen(path) else self
        if not (_is_chosen(path) or isinstance(path, PointToPoint)):
            plan = self.time(path, followed, duration, path.density)[0]
        elif around and (followed.joint_path is not None or isinstance(path, PointToPoint)):
            plan = choose_searched(planner, path, followed, ways, held=has_start)
        else:
            retime = None if planner is self and self._density(path) == 1.0 else self._retime
            plan = choose_on_path(planner, path, followed, ways, held=has_start, retime=retime)
        if planner is not self and isinstance(path, FreePath) and (around or not plan):
            plan = self._time_again(plan, path, followed)
        if _is_chosen(path) or isinstance(path, PointToPoint):
            plan = replace(self._finish(plan, duration), freedom=plan.freedom, search=plan.search)
        proof = plan.seconds.certificate
        seconds = PlanSeconds(ended - started, perf_counter() - ended - proof, proof)
        return replace(plan, seconds=seconds, resolution=followed.resolution)

    def _resolve(
        self, path: FreePath, q_start: ArrayLike | None, branch: str | None, *, held: bool
    ) -> tuple[FreePath, FollowResult, list[FreeWay]]:
        """Return the path, with coefficients if only these can be followed, its joints, and sequences to choose from."""
        robot, scene = self.request.robot, self.request.scene
        resolvable = can_resolve(path) and self.time_limit > 0.0 and not (held and branch == "best")
        followed = self.follow(path, q_start, branch, scene, time_limit=0.0 if resolvable else self.time_limit)
        beyond = followed.status not in MAY_CHANGE or (held and followed.joint_path is None)
        if not resolvable or (held or path.starts == 1 if followed else beyond):
            return path, followed, []
        resolver = Resolver(robot, path, None if scene is None else CollisionCheck(robot, scene), self.time_limit)
        q = None if q_start is None else check_start(robot, q_start, "q_start")
        count = 1 if held or path.segments > FEW_SEGMENTS else max(path.starts - 1, 1)
        if followed:
            ways, resolution = resolver.guess(count)
            return path, followed._replace(resolution=resolution), ways
        for many in (False, True):
            sequences, resolution = resolver.find(q, held=held, many=many, count=count)
            first = [parts[0] for parts in sequences]
            ways = resolver.relax(first)
            for candidate, way in resolver.candidates(first, ways):
                again = self.follow_from(candidate, way.q[0], scene, way.joints)
                if again:
                    others = [other for other in ways if other is not way]
                    return candidate, again._replace(resolution=resolution), others
        if robot.n > 6 and (again := self.follow(path, q_start, branch, scene)):  # among all configurations, too
            return path, again, []
        assert followed.failure is not None
        return path, followed._replace(failure=resolution.explain(followed.failure), resolution=resolution), []

    def _begin(self, path: FreePath, q_start: ArrayLike, duration: float | None) -> tuple[FreePath, Array, Plan | None]:
        """Return the path from a given start, the start, and the plan without a given start if that plan has the same start.

        A held start keeps its own turn and tilt within their ranges; a start that is not held is moved onto the path.
        """
        robot, pose, q = self.request.robot, path.pose(0.0), check_start(self.request.robot, q_start, "q_start")
        given = np.abs(robot.pose_errors(q, pose)).max() <= START_TOLERANCE or not self.solver.task.is_pose
        if not path.hold_start:
            return path, q if given or not (found := self.solver.solve(pose, q)) else found.q, None
        begun = path if given else path.begin_at(robot.fk(q))
        off = np.abs(robot.pose_errors(q, begun.pose(0.0))).max()
        if off > START_TOLERANCE or given:
            return path, q, None
        chosen = self.run(None, None, duration)
        same = chosen.has_motion and np.abs(chosen.trajectory(0.0) - q).max() <= START_TOLERANCE
        return begun, q, chosen if chosen and same else None

    def _with_optimal(self, path: FreePath) -> MotionPlanner:
        """Return the planner that chooses coefficients: that with the law optimal, up to the law's speed if it has one."""
        law, limits = self.request.law, self.request.limits
        if isinstance(law, Optimal):
            return self
        if law.speed is not None:
            name = "rotation_speed" if path.turns_only else "tool_speed"
            given = limits.value(name)
            speed: dict[str, Any] = {name: law.speed if given is None else np.minimum(law.speed, given)}
            limits = replace(limits, **speed)
        return replace(self, request=replace(self.request, law=Optimal(), limits=limits))

    def _density(self, path: Path) -> float:
        """Return the grid density for a chosen path: finer around obstacles and for many segments."""
        return DENSITIES[-1] if self.request.avoid is not False or path.segments > FEW_SEGMENTS else 1.0

    def _retime(self, found: Plan, duration: float | None = None) -> Plan:
        """Return the motion of this planner's law along the path of another plan."""
        return self.time(found.path, FollowResult(found.joint_path, None), duration, self._density(found.path))[0]

    def _time_again(self, chosen: Plan, path: FreePath, followed: FollowResult) -> Plan:
        """Return the shorter motion of this planner's law along the initial path and along the chosen one."""
        first, freedom = self.time(path, followed, None)[0], chosen.freedom
        if not chosen or freedom is None or (freedom.gain == 0.0 and first):
            if first.has_motion:
                freedom = freedom if chosen else report(first)
            failure = advise_elbow(first.failure, path, self.request.robot) if chosen.search else first.failure
            return replace(first, freedom=freedom if first.has_motion else None, search=chosen.search, failure=failure)
        found = self._retime(chosen)
        if first and not (found and pick_plan([first, found]) is found):
            what = "the initial path: with this law it needs less time or motion than the path that optimal chooses"
            return replace(first, freedom=report(first, ChoiceReport(what)), search=chosen.search)
        if not found:
            return found
        made, before = ChoiceReport(f"{CHOSEN} by the law optimal"), (first if first else found).trajectory.duration
        return replace(found, freedom=report(found, made, before), search=chosen.search)

    def _finish(self, found: Plan, duration: float | None) -> Plan:
        """Return a plan along a chosen path with the requested duration, if it meets its via points."""
        if duration is not None and found:
            found = self._retime(found, duration)
        if found and isinstance(found.path, PointToPoint) and (missed := found.path.list_missed()):
            reason = f"the via point at s = {missed[0].s:.6g} {found.path.unit} is missed by more than its tolerance"
            status, advice = PlanStatus.NOT_PROVED, "a wider tolerance, or via points farther apart"
            found = self.request.fail(status, found.prefix, PlanFailure(status, missed[0].s, None, reason, advice))
        return found


def _is_chosen(path: Path) -> TypeGuard[FreePath]:
    """Return whether the coefficients of a path's freedoms are chosen: not where less than the pose is asked."""
    return isinstance(path, FreePath) and path.asked == "pose"


def _list_stricter(path: Path, robot: Robot) -> list[Path]:
    """Return the paths that ask more of an arm than a path of points, or of points and axes."""
    assert isinstance(path, FreePath)
    few, bounds = robot.n < FEWEST_JOINTS, dict(path.bounds)
    stricter: list[Path] = [path.given] if few else []
    if path.asked == "point" and robot.n >= FEWEST_JOINTS - 1:
        bounds = {"turn": bounds["turn"]} if few else bounds | {"tilt": (-np.pi, np.pi)}
        stricter.append(FreePath(path.given, bounds, hold_start=path.hold_start, starts=path.starts).asking(robot))
    return stricter
