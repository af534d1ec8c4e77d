"""The planner of one motion: it follows a path, chooses what is free, times the motion and certifies it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver
from optik.ik.problem import check_start
from optik.scene import Scene
from optik.types import Array
from planners.certificate.certification import certify
from planners.choice.first_paths import DEFAULT_SEARCH, advise_elbow
from planners.choice.ways import DENSITIES, choose_path, choose_way
from planners.following.collision import CollisionCheck
from planners.following.failure import PlanFailure
from planners.following.follow import START_TOLERANCE, FollowResult, FollowStatus, follow
from planners.limits import SAME_SPEED
from planners.motion import PlanStatus
from planners.motion.fit import check_statics, fit, stretch_factor
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.point_to_point import PointToPoint
from planners.planning.request import PlanRequest
from planners.planning.result import Plan, PlanSeconds
from planners.timing import TimeLaw
from planners.timing.optimal import Optimal, Optimum
from planners.trajectory import Trajectory

PATH_FRACTION = 0.95
"""Fraction of the tolerance that the joint path may use. The law's polynomials in time use the remaining part."""
MOST_SECONDS = 1e9
"""Longest duration that can be requested [s], 30 years: powers of much longer ones overflow."""


@dataclass(frozen=True)
class MotionPlanner:
    """Follows, times and certifies paths under one request: follow, choose, time, certify."""

    solver: IKSolver
    request: PlanRequest
    samples: int
    strict: bool

    def run(self, q_start: ArrayLike | None, branch: str | None, duration: float | None) -> Plan:
        """Return the plan along the requested path, with the durations of its parts."""
        started, path = perf_counter(), self.request.path
        if self.request.unreachable is not None:
            return self.request.infeasible(None, self.request.unreachable, PlanStatus.UNREACHABLE)
        if isinstance(path, FreePath) and not path.hold_start and q_start is not None and branch != "best":
            q_start = self._reach_start(path, q_start)
        around = self.request.avoid is not False
        chosen = isinstance(path, FreePath) and (q_start is None or branch == "best")  # away from contact, if possible
        followed = self.follow(path, q_start, branch, self.request.scene if chosen or not around else None)
        if around and followed.failure is not None and followed.failure.status is FollowStatus.CONTACT:
            followed = followed._replace(failure=None)
        ended = perf_counter()
        held = q_start is not None
        if not isinstance(path, FreePath | PointToPoint):
            found = self.time(path, followed, duration, path.density)[0]
        elif around:
            found = self._avoid(path, followed, held, duration)
        else:
            best = choose_path(self, path, followed, self.request.scene, held=held)
            found = replace(self._finish(best, duration), freedom=best.freedom) if best else best
        proof = found.seconds.certificate
        return replace(found, seconds=PlanSeconds(ended - started, perf_counter() - ended - proof, proof))

    def _reach_start(self, path: FreePath, q_start: ArrayLike) -> Array:
        """Return a configuration at the path's start from a first guess; itself if it is there, or if none is found."""
        pose, q = path.pose(0.0), check_start(self.request.robot, q_start, "q_start")
        if np.abs(self.request.robot.pose_errors(q, pose)).max() <= START_TOLERANCE or not self.solver.task.is_pose:
            return q
        return found.q if (found := self.solver.solve(pose, q)) else q

    def follow(self, path: Path, q: ArrayLike | None, branch: str | None, scene: Scene | None) -> FollowResult:
        """Return the joint path along a path."""
        allowed = self.request.tolerance.scale(PATH_FRACTION)
        return follow(self.solver, path, q, branch=branch, samples=self.samples, tolerance=allowed, scene=scene)

    def time(
        self, path: Path, followed: FollowResult, duration: float | None, density: float = 1.0
    ) -> tuple[Plan, Optimum | None]:
        """Return the plan of a joint path that is timed and certified, or its failure; and the optimum if the law has one."""
        request = self.request if path is self.request.path else replace(self.request, path=path)
        if followed.failure is not None:
            return request.fail(PlanStatus(followed.failure.status), followed.joint_path, followed.failure), None
        assert followed.joint_path is not None
        joints, law, optimum = followed.joint_path, request.law, None
        enforced = law.list_enforced(request.limits)
        try:
            check_statics(joints, request.limits, enforced)
            if isinstance(law, Optimal):
                raw, optimum = law.run_with_optimum(joints, request.limits, density)
            else:
                raw = law.run_with_analysis(joints, request.limits)
            factor = stretch_factor(raw, request.limits, enforced)
            if factor > 1.0 and self.strict:
                proof = certify(request.robot, path, raw.trajectory, request.limits, enforced=enforced)
                advice = f"strict=False slows the motion by {factor:.9g}; or another law"
                return request.refuse(joints, proof, advice), None
            motion = fit(raw, request.limits, enforced) if factor > 1.0 else raw
            trajectory, analysis = motion.trajectory, motion if duration is None else None
            slowed = trajectory.duration / raw.trajectory.duration
            if duration is not None:
                trajectory = _scale_to_duration(trajectory, duration, law)
        except NoSolution as error:
            return request.infeasible(joints, error), None
        return request.certify_motion(joints, trajectory, slowed, analysis), optimum

    def _avoid(self, path: FreePath | PointToPoint, followed: FollowResult, held: bool, duration: float | None) -> Plan:
        """Return the fastest collision-free plan from the initial paths that are searched, of this duration if one is given."""
        request, scene = self.request, self.request.scene
        assert scene is not None
        if isinstance(path, FreePath) and path.hold_start and held and followed.joint_path is not None:
            blocked = CollisionCheck(request.robot, scene).check_start(followed.joint_path.q[0])
            if blocked is not None:
                return request.fail(PlanStatus.CONTACT, followed.joint_path, blocked)
        search = DEFAULT_SEARCH if isinstance(request.avoid, bool) else request.avoid
        optimal = isinstance(request.law, Optimal)
        best, made = choose_way(self, path, followed, scene, search, request.winding, held=held, optimal=optimal)
        if isinstance(best, PlanFailure):
            best = request.fail(PlanStatus(best.status), None, best)
        found = self._finish(best, duration, DENSITIES[-1])
        failure = advise_elbow(found.failure, best.path, request.robot)
        return replace(found, freedom=best.freedom, search=made, failure=failure)

    def _finish(self, found: Plan, duration: float | None, density: float = 1.0) -> Plan:
        """Return a plan along a chosen path with the requested duration, if it meets its via points."""
        if duration is not None and found:
            found = self.time(found.path, FollowResult(found.joint_path, None), duration, density)[0]
        if isinstance(found.path, PointToPoint) and (missed := found.path.list_missed()):
            reason = f"the via point at s = {missed[0].s:.6g} {found.path.unit} is missed by more than its tolerance"
            status, advice = PlanStatus.NOT_PROVED, "a wider tolerance, or via points farther apart"
            found = self.request.fail(status, found.prefix, PlanFailure(status, missed[0].s, None, reason, advice))
        return found


def _scale_to_duration(trajectory: Trajectory, duration: float, law: TimeLaw) -> Trajectory:
    """Return a motion scaled to a duration: not faster if the law enforces limits, and at its tool speed if it has one."""
    if duration > MOST_SECONDS:
        raise InvalidInput("duration", f"{duration:.3g} s", f"at most {MOST_SECONDS:g} s")
    if law.speed is not None and abs(duration / trajectory.duration - 1.0) > SAME_SPEED:
        raise NoSolution(
            f"a duration of {duration:.6g} s makes the tool speed {law.speed * trajectory.duration / duration:.6g}, and "
            f"the law's speed is {law.speed:.6g}, which takes {trajectory.duration:.9g} s",
            advice=f"omit duration, or use {law.name} without a speed, so that the speed follows from the duration",
        )
    if law.enforced and duration < trajectory.duration:
        least = np.ceil(1e4 * trajectory.duration) / 1e4
        raise NoSolution(
            f"a duration of {duration:.6g} s is too short: the shortest motion of {law.name} takes {least:.4f} s",
            advice="a longer duration, or higher limits",
        )
    return trajectory.slowed(duration / trajectory.duration)
