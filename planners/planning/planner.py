"""The planner of one motion: it validates a request, follows a path, chooses what is free, times and certifies the motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from optik import newton
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, SolverLike
from optik.ik.base import Tolerance
from optik.ik.problem import check_start
from optik.registry import label
from optik.scene import Scene
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import Allow, required_limits
from planners.choice.choose import CHOSEN, ChoiceReport, pick_plan, report
from planners.choice.first_paths import DEFAULT_SEARCH, advise_elbow
from planners.choice.ways import DENSITIES, FEW_SEGMENTS, choose_on_path, choose_searched
from planners.following.branches import CollisionCheck
from planners.following.failure import PlanFailure
from planners.following.follow import DEFAULT_TOLERANCE, START_TOLERANCE, FollowResult, FollowStatus, make_follower
from planners.following.joint_path import JointPath
from planners.following.resolve.freedoms import FreeWay, Resolver, can_resolve
from planners.following.resolve.graph import Sequence
from planners.limits import SAME_SPEED, MotionLimits
from planners.motion import PlanStatus
from planners.motion.motion import check_statics, find_stretch_factor, stretch_analysed
from planners.paths.base import Path
from planners.paths.free_path import FEWEST_JOINTS, FreePath
from planners.paths.point_to_point import PointToPoint
from planners.planning.result import Plan, PlanSeconds, judge_certificate
from planners.search.base import SearchLike
from planners.timing import LawLike, TimeLaw
from planners.timing.base import StopKind
from planners.timing.optimal import Optimal, Optimum
from planners.trajectory import Trajectory

# ---------------- the validated arguments of a plan, and the plans that can result


@dataclass(frozen=True)
class PlanOptions:
    """The arguments of `planners.plan` besides the arm, the path and the start."""

    limits: MotionLimits
    solver: SolverLike = "lm"
    timing: LawLike = "optimal"
    samples: int = 151
    branch: str | None = None
    rate: float = 1000.0
    duration: float | None = None
    strict: bool = False
    tolerance: Tolerance = DEFAULT_TOLERANCE
    allow: Allow = ()
    scene: Scene | None = None
    avoid: bool | SearchLike = False
    winding: str = "nearest"
    resolve: str = "auto"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.limits, MotionLimits):
            raise InvalidInput("limits", repr(self.limits)[:60], "an object of the class MotionLimits")
        if self.duration is not None:
            check_number(self.duration, "duration", "seconds above 0", above=0.0)
        if not isinstance(self.strict, bool):
            raise InvalidInput("strict", repr(self.strict)[:60], "True or False")


@dataclass(frozen=True)
class PlanRequest:
    """The validated arguments of a plan, and the plans that can result."""

    robot: Robot
    path: Path
    limits: MotionLimits
    solver: str
    law: TimeLaw
    tolerance: Tolerance
    rate: float
    span: tuple[float, float] | None = None
    scene: Scene | None = None
    before: tuple[MotionLimits, float] | None = None
    start_error: tuple[float, float, float] | None = None
    stop_kind: StopKind | None = None
    allow: tuple[str, ...] = ()
    avoid: bool | SearchLike = False
    winding: str = "exact"
    unreachable: NoSolution | None = None

    @property
    def enforced(self) -> tuple[str, ...]:
        """The limits that the motion must respect: those that its law enforces, and given ones that ``allow`` does not name."""
        enforced = self.law.list_enforced(self.limits)
        given = tuple(name for name in self.limits.given_names if name not in enforced)
        return (*enforced, *required_limits(given, self.allow))

    def certify_motion(
        self,
        joints: JointPath,
        trajectory: Trajectory,
        stretch_factor: float = 1.0,
        analysis: MotionAnalysis | None = None,
        limit_factor: float = 1.0,
    ) -> Plan:
        """Certify the law's motion, stretched by a factor, and return its plan, which is solved if the certificate is valid."""
        started = perf_counter()
        proof = certify(
            self.robot, self.path, trajectory, self.limits, law=label(self.law), enforced=self.enforced, rate=self.rate,
            tolerance=self.tolerance, span=self.span, scene=self.scene, before=self.before, analysis=analysis,
        )  # fmt: skip
        seconds = PlanSeconds(certificate=perf_counter() - started)
        status, failure = judge_certificate(proof, self.law.list_enforced(self.limits))
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, label(self.law), joints, failure, trajectory, proof,
            stretch_factor, self.span, self.law.speed, self.scene, seconds, self.before, self.start_error, self.stop_kind,
            limit_factor=limit_factor,
        )  # fmt: skip

    def infeasible(
        self, joints: JointPath | None, error: NoSolution, status: PlanStatus = PlanStatus.TIMING_INFEASIBLE
    ) -> Plan:
        """Return the plan without a motion, for the reason of an error."""
        return self.fail(status, joints, PlanFailure.from_error(status, error))

    def fail(self, status: PlanStatus, joints: JointPath | None, failure: PlanFailure) -> Plan:
        """Return a plan without a motion; its joint path ends where following failed."""
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, label(self.law), joints, failure, None, None,
            scene=self.scene,
        )  # fmt: skip

    def refuse(self, joints: JointPath, proof: Certificate, advice: str) -> Plan:
        """Return the plan of a motion that exceeds a limit, for ``strict=True``."""
        field = max(proof.enforced, key=lambda f: np.nan_to_num(proof.worst(f)[0]))
        ratio, joint, t = proof.worst(field)
        s = proof.s_at(t)
        what = f"the {field.replace('_', ' ')} of {joint} is {ratio:.9g} of its limit at t = {t:.6g} s"
        if not ratio > 1.0:
            what = proof.reasons[0]
        failure = PlanFailure(PlanStatus.LIMITS_EXCEEDED, s, joint, f"{what}, and strict=True", advice)
        return self.fail(PlanStatus.LIMITS_EXCEEDED, joints, failure)


# ---------------- the planner of one motion


PATH_FRACTION = 0.95
"""Fraction of the tolerance that the joint path may use. The law's polynomials in time use the remaining part."""
MAY_CHANGE = tuple(
    FollowStatus[name] for name in ("OUTSIDE_LIMITS", "BRANCH_JUMP", "SINGULAR", "CONTACT", "UNREACHABLE")
)
"""Failures that other configurations, or other values of the freedoms, can change."""
START_STEPS = 4
"""Newton steps that move a computed start onto the path."""
MOST_SECONDS = 1e9
"""Longest duration that can be requested [s], 30 years: powers of much longer ones overflow."""


@dataclass(frozen=True)
class MotionPlanner:
    """Follows, times and certifies paths under one request: follow, choose, time, certify."""

    solver: IKSolver
    request: PlanRequest
    samples: int
    strict: bool
    time_limit: float

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
        around, held = self.request.avoid is not False and path.asked == "pose", q_start is not None
        ways = list[FreeWay]()
        if _is_chosen(path):
            path, followed, ways = self._resolve(path, q_start, branch, held=held and path.hold_start)
        else:
            branch = "best" if held and isinstance(path, FreePath) and not path.hold_start else branch
            followed = self.follow(path, q_start, branch, None if around else self.request.scene)
        if around and followed.status is FollowStatus.CONTACT and followed.joint_path is not None:
            followed = followed._replace(failure=None)  # to be moved out of contact
        ended = perf_counter()
        planner = self._with_optimal(path) if _is_chosen(path) else self
        if not (_is_chosen(path) or isinstance(path, PointToPoint)):
            found = self.time(path, followed, duration, path.density)[0]
        elif around and (followed.joint_path is not None or isinstance(path, PointToPoint)):
            found = planner._avoid(path, followed, ways, held)
        else:
            retime = None if planner is self and self._density(path) == 1.0 else self._retime
            found = choose_on_path(planner, path, followed, self.request.scene, ways, held=held, retime=retime)
        if planner is not self and isinstance(path, FreePath) and (around or not found):
            found = self._time_again(found, path, followed)
        if _is_chosen(path) or isinstance(path, PointToPoint):
            found = replace(self._finish(found, duration), freedom=found.freedom, search=found.search)
        proof = found.seconds.certificate
        seconds = PlanSeconds(ended - started, perf_counter() - ended - proof, proof)
        return replace(found, seconds=seconds, resolution=followed.resolution)

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
            ways, made = resolver.guess(count)
            return path, followed._replace(resolution=made), ways
        for many in (False, True):
            sequences, made = resolver.find(q, held=held, many=many, count=count)
            first = [parts[0] for parts in sequences]
            ways = resolver.relax(first)
            for candidate, way in resolver.candidates(first, ways):
                found = self.follow_from(candidate, way.q[0], scene, way.joints)
                if found:
                    return candidate, found._replace(resolution=made), [other for other in ways if other is not way]
        if robot.n > 6 and (found := self.follow(path, q_start, branch, scene)):  # among all configurations, too
            return path, found, []
        assert followed.failure is not None
        return path, followed._replace(failure=made.explain(followed.failure), resolution=made), []

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

    def follow(
        self, path: Path, q: ArrayLike | None, branch: str | None, scene: Scene | None, way: Sequence | None = None,
        time_limit: float | None = None,
    ) -> FollowResult:  # fmt: skip
        """Return the joint path along a path, by the sequence of its resolution if there is one."""
        allowed = self.request.tolerance.scale(PATH_FRACTION)
        seconds = self.time_limit if time_limit is None else time_limit
        return make_follower(self.solver, path, q, branch, self.samples, allowed, scene, seconds, way).run()

    def follow_from(self, path: Path, q: Array, scene: Scene | None, way: Sequence | None = None) -> FollowResult:
        """Return the joint path from a computed start, which is first corrected onto the path and clipped to the limits."""
        robot, pose, start = self.request.robot, path.pose(np.zeros(1)), np.array(q[None])
        newton.polish_batch(robot.chain, start, pose, START_STEPS)
        start = robot.limits.clip(start)
        if np.abs(robot.pose_errors(start, pose)).max() <= START_TOLERANCE and robot.limits.contains(start).all():
            return self.follow(path, start[0], "start", scene, way)
        why = "the chosen path has no start configuration inside the limits"
        return FollowResult(None, PlanFailure(FollowStatus.OUTSIDE_LIMITS, 0.0, None, why, ""))

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
            factor = find_stretch_factor(raw, request.limits, enforced)
            if factor > 1.0 and self.strict:
                proof = certify(request.robot, path, raw.trajectory, request.limits, enforced=enforced)
                advice = f"strict=False slows the motion by {factor:.9g}; or another law"
                return request.refuse(joints, proof, advice), None
            motion = stretch_analysed(raw, request.limits, enforced) if factor > 1.0 else raw
            trajectory, analysis = motion.trajectory, motion if duration is None else None
            limited = 1.0 if duration is not None else trajectory.duration / raw.trajectory.duration
            if duration is not None:
                trajectory = _scale_to_duration(trajectory, duration, law)
        except NoSolution as error:
            return request.infeasible(joints, error), None
        stretch = trajectory.duration / raw.trajectory.duration
        return request.certify_motion(joints, trajectory, stretch, analysis, limited), optimum

    def _avoid(self, path: FreePath | PointToPoint, followed: FollowResult, ways: list[FreeWay], held: bool) -> Plan:
        """Return the fastest collision-free plan from the initial paths that are searched."""
        request, scene = self.request, self.request.scene
        assert scene is not None
        search = DEFAULT_SEARCH if isinstance(request.avoid, bool) else request.avoid
        optimal = isinstance(request.law, Optimal)
        best, made = choose_searched(
            self, path, followed, scene, search, request.winding, ways, held=held, optimal=optimal
        )
        if isinstance(best, PlanFailure):
            best = request.fail(PlanStatus(best.status), None, best)
        return replace(best, search=made, failure=advise_elbow(best.failure, best.path, request.robot))

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

    def _retime(self, found: Plan) -> Plan:
        """Return the motion of this planner's law along the path of another plan."""
        return self.time(found.path, FollowResult(found.joint_path, None), None, self._density(found.path))[0]

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
            found = self.time(found.path, FollowResult(found.joint_path, None), duration, self._density(found.path))[0]
        if isinstance(found.path, PointToPoint) and (missed := found.path.list_missed()):
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
    if getattr(law, "quiet", None) and abs(duration / trajectory.duration - 1.0) > SAME_SPEED:
        raise InvalidInput("duration", f"{duration:.6g} s with the law {law.name}", "none: it moves the frequency")
    if law.enforced and duration < trajectory.duration:
        least = np.ceil(1e4 * trajectory.duration) / 1e4
        raise NoSolution(
            f"a duration of {duration:.6g} s is too short: the shortest motion of {law.name} takes {least:.4f} s",
            advice="a longer duration, or higher limits",
        )
    return trajectory.stretched(duration / trajectory.duration)
