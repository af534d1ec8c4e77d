"""plan(): follow a path with the joints, time the motion and certify it, in one call."""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.plain import describe_difference
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, get_solver
from optik.ik.base import Tolerance, ToleranceLike
from optik.ik.problem import check_start
from optik.registry import short_name
from optik.scene import Scene
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.certificate.violation import LIMIT_WORDS, Allow, check_allow, required_limits, words_for
from planners.choice.avoid import choose_around, find_guess
from planners.choice.choose import choice_for, choose, report_fixed
from planners.choice.first_paths import (
    DEFAULT_SEARCH,
    DENSITIES,
    ENOUGH_GAIN,
    ENOUGH_NEAR,
    FAST,
    MAY_GAIN,
    MOST_WAYS,
    NOT_FAR,
    SearchReport,
    advise_elbow,
    check_avoid,
    check_avoidable,
    find_first_paths,
)
from planners.following.collision import CollisionCheck
from planners.following.follow import (
    DEFAULT_TOLERANCE,
    START_TOLERANCE,
    FollowResult,
    FollowStatus,
    JointPath,
    PlanFailure,
    follow,
)
from planners.limits import SAME_SPEED, MotionLimits, check_path
from planners.motion import PlanStatus
from planners.motion.fit import check_statics, fit, stretch_factor
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.goal import check_winding, path_to
from planners.paths.point_to_point import PointToPoint
from planners.result import Plan, PlanSeconds
from planners.search.base import Search
from planners.timing import TimeLaw, law_for, make_law
from planners.timing.base import StopKind
from planners.timing.optimal import Optimal, Optimum
from planners.trajectory import Trajectory

__all__ = ["Plan", "PlanRequest", "PlanSeconds", "PlanStatus", "make_law", "path_to", "plan"]

PATH_FRACTION = 0.95
"""Fraction of the tolerance that the joint path may use. The law's polynomials in time use the remaining part."""
MOST_SECONDS = 1e9
"""Longest duration that can be requested [s], 30 years: powers of much longer ones overflow."""


def plan(
    robot: Robot,
    path: Path | ArrayLike,
    q_start: ArrayLike | None = None,
    *,
    solver: str | os.PathLike[str] | IKSolver = "lm", timing: str | os.PathLike[str] | TimeLaw = "optimal",
    limits: MotionLimits | None = None, samples: int = 151, branch: str | None = None, rate: float = 1000.0,
    duration: float | None = None, strict: bool = False, tolerance: ToleranceLike = DEFAULT_TOLERANCE, allow: Allow = (),
    scene: Scene | None = None, avoid: bool | str | os.PathLike[str] | Search = False, winding: str = "nearest",
) -> Plan:  # fmt: skip
    """Plan the joint motion that takes the tool along a path, and certify its limits.

    Parameters
    ----------
    robot : Robot
        The arm.
    path : Path, or (4, 4) array, or (n,) array
        The path of the tool. A pose means the straight line to it; joints [rad, m] mean the line in joint space.
    q_start : (n,) array, optional
        Configuration at the path's start [rad, m]; by default the best one there.
    solver, timing : str, or IKSolver and TimeLaw
        Method and law: a name, a file (``"./jt.py"``), or an object, such as ``make_law("constant_speed", speed=0.1)``.
    limits : MotionLimits, optional
        By default the robot's own. A plan that exceeds a limit given here is invalid, even if its law does not enforce it.
    samples : int
        Samples of the path, equally spaced.
    branch : {"start", "best"}, optional
        Keep the branch of ``q_start``, its default, or choose branch and winding for the whole path (`planners.follow`).
    duration : float, optional
        Duration [s] to which the law's motion is slowed; a tool speed that is set in the law must stay the same.
    strict : bool
        Refuse a motion that exceeds a limit enforced by its law, instead of slowing it uniformly (`Plan.slowed`).
    tolerance : Tolerance, or (2,) tuple of float
        Largest distance [m] and angle [rad] between tool and path with which the certificate is valid.
    rate : float
        The controller's rate [1/s], for `Certificate.sampled_jerk`.
    scene : Scene, optional
        Obstacles for an arm with shapes, and the margin to them; its links are checked too. The motion is proved to be
        collision-free at every instant (`Certificate.clearance`). An empty scene checks the links alone.
    allow : {"limits", "jerk"}, or both
        Permit given limits that the law does not enforce to be exceeded: ``"jerk"``, and ``"limits"`` for all others.
    avoid : bool, or str or Search
        Search a way around obstacles to joints, any configuration of a pose or along a `PointToPoint`, or use the freedoms of
        a `FreePath`. A name, a file or a built search (`planners.find_path`) replaces the default one.
    winding : {"nearest", "exact"}
        For a goal configuration: "nearest" lets joints without limits end whole turns away from it (`Plan.goal`); "exact" not.

    Returns
    -------
    Plan
        On failure with a `Plan.failure`: path parameter, reason and advice.

    Raises
    ------
    InvalidInput, UnknownName
        An invalid argument; a limit that the law needs and that is missing; an unknown method or law; an arm without shapes.
    """
    options = tolerance, rate, scene, allow, avoid, winding
    built = _build_request(robot, path, q_start, solver, timing, limits, options)
    return _Planner(*built, samples, strict).run(q_start, branch, duration)


def _build_request(
    robot: Robot, path: Path | ArrayLike, q_start: ArrayLike | None, solver: str | os.PathLike[str] | IKSolver,
    timing: str | os.PathLike[str] | TimeLaw, limits: MotionLimits | None,
    options: tuple[ToleranceLike, float, Scene | None, Allow, bool | str | os.PathLike[str] | Search, str],
) -> tuple[IKSolver, PlanRequest]:  # fmt: skip
    """Return the solver and the request, with defaults filled in, after checking that the arguments are consistent."""
    solver = get_solver(robot, solver) if isinstance(solver, str | os.PathLike) else solver
    law = law_for(timing)
    limits = MotionLimits.of(robot) if limits is None else limits
    for argument, value, kind in (("solver", solver, IKSolver), ("limits", limits, MotionLimits)):
        if not isinstance(value, kind):
            raise InvalidInput(argument, repr(value)[:60], f"an object of the class {kind.__name__}")
    tolerance, rate, scene, allow, avoid, winding = options
    avoid, winding, unreachable = check_avoid(avoid), check_winding(winding), None
    winding = "exact" if isinstance(path, Path) else winding
    if avoid is not False:
        try:
            path = check_avoidable(robot, path, q_start, scene, winding)
        except NoSolution as error:  # no configuration reaches a pose as goal: only the straight line remains
            assert not isinstance(path, Path)
            path, unreachable = path_to(robot, path, q_start), error
    elif not isinstance(path, Path):
        path = path_to(robot, path, q_start, winding)
    if solver.robot != robot:
        other = f"a solver built for {solver.robot.name}, which differs in {describe_difference(solver.robot, robot)}"
        raise InvalidInput("solver", other, f"one built for this {robot.name}")
    law.need(limits, robot)
    check_path(limits, path)
    return solver, PlanRequest(
        robot, path, limits, solver.name, law, Tolerance.of(tolerance), rate, scene=scene,
        allow=check_allow(allow, LIMIT_WORDS), avoid=avoid, winding=winding,
        unreachable=unreachable,
    )  # fmt: skip


def _check_options(duration: float | None, strict: bool) -> None:
    if duration is not None:
        check_number(duration, "duration", "seconds above 0", above=0.0)
    if not isinstance(strict, bool):
        raise InvalidInput("strict", repr(strict)[:60], "True or False")


def judge_certificate(
    proof: Certificate, enforced: tuple[str, ...] | None = None
) -> tuple[PlanStatus, PlanFailure | None]:
    """Return the status of a plan with this certificate, and its first violation; the law enforces these limits."""
    if proof.is_valid:
        return PlanStatus.SOLVED, None
    status = PlanStatus.NOT_PROVED
    advice = "another law, or a wider tolerance; plan.trajectory and plan.certificate show where"
    if proof.clearance is not None and proof.clearance.touches:
        status = PlanStatus.CONTACT
        advice = "another start, goal or path, or a smaller margin; plan.certificate.clearance shows where"
    elif enforced is not None and replace(proof, enforced=enforced).is_valid:
        status = PlanStatus.LIMITS_EXCEEDED
        advice = f"another law, as {proof.law} does not enforce this limit; or allow={words_for(proof.violations)!r}"
    first = proof.violations[0]
    reason = f"the certificate is not valid: {'; '.join(proof.reasons)}"
    return status, PlanFailure(status, proof.s_at(first.t), first.joint, reason, advice)


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
    avoid: bool | str | os.PathLike[str] | Search = False
    winding: str = "exact"
    unreachable: NoSolution | None = None

    @property
    def enforced(self) -> tuple[str, ...]:
        """The limits that the motion must respect: those that its law enforces, and given ones that ``allow`` does not name."""
        enforced = self.law.list_enforced(self.limits)
        given = tuple(name for name in self.limits.given_names if name not in enforced)
        return (*enforced, *required_limits(given, self.allow))

    def certify_motion(
        self, joints: JointPath, trajectory: Trajectory, slowed: float = 1.0, analysis: MotionAnalysis | None = None
    ) -> Plan:
        """Certify the law's motion, slowed by a factor, and return its plan, which is solved if the certificate is valid."""
        started = perf_counter()
        proof = certify(
            self.robot, self.path, trajectory, self.limits, law=self.law.name, enforced=self.enforced, rate=self.rate,
            tolerance=self.tolerance, span=self.span, scene=self.scene, before=self.before, analysis=analysis,
        )  # fmt: skip
        seconds = PlanSeconds(certificate=perf_counter() - started)
        status, failure = judge_certificate(proof, self.law.list_enforced(self.limits))
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, self.law.name, joints, failure, trajectory, proof, slowed,
            self.span, self.law.speed, self.scene, seconds, self.before, self.start_error, self.stop_kind,
        )  # fmt: skip

    def infeasible(
        self, joints: JointPath | None, error: NoSolution, status: PlanStatus = PlanStatus.TIMING_INFEASIBLE
    ) -> Plan:
        """Return the plan without a motion, for the reason of an error."""
        return self._fail(status, joints, PlanFailure.from_error(status, error))

    def _fail(self, status: PlanStatus, joints: JointPath | None, failure: PlanFailure) -> Plan:
        """Return a plan without a motion; its joint path ends where following failed."""
        return Plan(
            self.robot, self.path, self.limits, status, self.solver, self.law.name, joints, failure, None, None,
            scene=self.scene,
        )  # fmt: skip

    def _refuse(self, joints: JointPath, proof: Certificate, advice: str) -> Plan:
        """Return the plan of a motion that exceeds a limit, for ``strict=True``."""
        field = max(proof.enforced, key=lambda f: np.nan_to_num(proof.worst(f)[0]))
        ratio, joint, t = proof.worst(field)
        s = proof.s_at(t)
        what = f"the {field.replace('_', ' ')} of {joint} is {ratio:.9g} of its limit at t = {t:.6g} s"
        if not ratio > 1.0:
            what = proof.reasons[0]
        failure = PlanFailure(PlanStatus.LIMITS_EXCEEDED, s, joint, f"{what}, and strict=True", advice)
        return self._fail(PlanStatus.LIMITS_EXCEEDED, joints, failure)


@dataclass(frozen=True)
class _Planner:
    """Follows, times and certifies paths under one request."""

    solver: IKSolver
    request: PlanRequest
    samples: int
    strict: bool

    def run(self, q_start: ArrayLike | None, branch: str | None, duration: float | None) -> Plan:
        """Return the plan along the requested path, with the durations of its parts."""
        started, path = perf_counter(), self.request.path
        _check_options(duration, self.strict)
        if self.request.unreachable is not None:
            return self.request.infeasible(None, self.request.unreachable, PlanStatus.UNREACHABLE)
        if isinstance(path, FreePath) and not path.hold_start and q_start is not None and branch != "best":
            q_start = self._reach_start(path, q_start)
        around = self.request.avoid is not False
        chosen = isinstance(path, FreePath) and (q_start is None or branch == "best")  # away from contact, if possible
        followed = self._follow(path, q_start, branch, self.request.scene if chosen or not around else None)
        if around and followed.failure is not None and followed.failure.status is FollowStatus.CONTACT:
            followed = followed._replace(failure=None)
        ended = perf_counter()
        if isinstance(path, FreePath | PointToPoint):
            best_of = self._avoid if around else self._choose
            found = best_of(path, followed, q_start is not None, duration)
        else:
            found = self._time(path, followed, duration)[0]
        proof = found.seconds.certificate
        return replace(found, seconds=PlanSeconds(ended - started, perf_counter() - ended - proof, proof))

    def _reach_start(self, path: FreePath, q_start: ArrayLike) -> Array:
        """Return a configuration at the path's start from a first guess; itself if it is there, or if none is found."""
        pose, q = path.pose(0.0), check_start(self.request.robot, q_start, "q_start")
        if np.abs(self.request.robot.pose_errors(q, pose)).max() <= START_TOLERANCE or not self.solver.task.is_pose:
            return q
        return found.q if (found := self.solver.solve(pose, q)) else q

    def _follow(self, path: Path, q: ArrayLike | None, branch: str | None, scene: Scene | None) -> FollowResult:
        """Return the joint path along a path."""
        allowed = self.request.tolerance.scale(PATH_FRACTION)
        return follow(self.solver, path, q, branch=branch, samples=self.samples, tolerance=allowed, scene=scene)

    def _time(
        self, path: Path, followed: FollowResult, duration: float | None, density: float = 1.0
    ) -> tuple[Plan, Optimum | None]:
        """Return the plan of a joint path that is timed and certified, or its failure; and the optimum if the law has one."""
        request = self.request if path is self.request.path else replace(self.request, path=path)
        if followed.failure is not None:
            return request._fail(PlanStatus(followed.failure.status), followed.joint_path, followed.failure), None
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
                return request._refuse(joints, proof, advice), None
            motion = fit(raw, request.limits, enforced) if factor > 1.0 else raw
            trajectory, analysis = motion.trajectory, motion if duration is None else None
            slowed = trajectory.duration / raw.trajectory.duration
            if duration is not None:
                trajectory = _scale_to_duration(trajectory, duration, law)
        except NoSolution as error:
            return request.infeasible(joints, error), None
        return request.certify_motion(joints, trajectory, slowed, analysis), optimum

    def _choose(
        self, path: FreePath | PointToPoint, followed: FollowResult, starts_there: bool, duration: float | None
    ) -> Plan:
        """Return the fastest plan over the freedoms of a path, of this duration if one is given."""

        def plan_along(chosen: FreePath | PointToPoint, q: Array) -> Plan | None:
            return self._time(chosen, self._follow(chosen, q, "start", self.request.scene), None)[0] or None

        fixed, optimum = self._time(path, followed, None)
        if not fixed:
            return fixed
        found, result = choose(path, fixed.joint_path, optimum, fixed, held=starts_there, plan_along=plan_along)
        return replace(self._finish(found, duration), freedom=result)

    def _avoid(
        self, path: FreePath | PointToPoint, followed: FollowResult, starts_there: bool, duration: float | None
    ) -> Plan:
        """Return the fastest collision-free plan from the initial paths that are searched, of this duration if one is given."""
        request, samples, rounds, tried = self.request, 0, 0, 0
        plans: list[Plan] = []
        scene, search = request.scene, DEFAULT_SEARCH if isinstance(request.avoid, bool) else request.avoid
        assert scene is not None
        if isinstance(path, FreePath) and path.hold_start and starts_there and followed.joint_path is not None:
            blocked = CollisionCheck(request.robot, scene).check_start(followed.joint_path.q[0])
            if blocked is not None:
                return request._fail(PlanStatus.CONTACT, followed.joint_path, blocked)
        given = find_first_paths(path, scene, search, request.winding) if isinstance(path, PointToPoint) else [None]
        for first in itertools.islice(given, MOST_WAYS):
            tried += 1
            if first is not None:
                samples += first.samples
                if isinstance(first.found, PlanFailure):
                    plans = plans or [request._fail(PlanStatus(first.found.status), None, first.found)]
                    break
                followed, path = self._follow(first.found, None, None, None), first.found
            before = min((one.trajectory.duration for one in plans if one), default=np.inf)
            found, spent = self._plan_around(path, scene, followed, starts_there, before)
            plans, rounds = [*plans, found], rounds + spent
            if found and self._is_enough(plans):
                break
        best = min(plans, key=lambda one: (not one, one.trajectory.duration if one else 0.0))
        made = SearchReport(search.name if isinstance(search, Search) else short_name(search), samples, rounds, tried)
        found, freedom = self._finish(best, duration, DENSITIES[-1]), best.freedom
        return replace(found, freedom=freedom, search=made, failure=advise_elbow(found.failure, path, request.robot))

    def _is_enough(self, plans: list[Plan]) -> bool:
        """Return whether no other initial path need be tried: the last motion is nearly the fastest, or one was shortened."""
        if not isinstance(self.request.law, Optimal):
            return True
        over = plans[-1].trajectory.duration / (plans[-1].least_duration or np.inf)
        gained = any(one.freedom is not None and one.freedom.gain > ENOUGH_GAIN for one in plans if one)
        return 0.0 < over <= ENOUGH_NEAR or (gained and (len(plans) > 1 or over <= NOT_FAR))

    def _plan_around(
        self, path: FreePath | PointToPoint, scene: Scene, followed: FollowResult, held: bool, before: float
    ) -> tuple[Plan, int]:
        """Return the fastest plan from one initial path, and the rounds.

        A move of joints is planned on the coarse grid first. The fine one is left out if the motion is nearly the fastest
        possible, or clearly slower than that from another initial path, `before` [s].
        """
        rounds, best = 0, None
        for density in DENSITIES if isinstance(path, PointToPoint) else DENSITIES[1:]:

            def plan_along(chosen: FreePath | PointToPoint, q: Array, density: float = density) -> Plan:
                return self._time(chosen, self._follow(chosen, q, "start", None), None, density)[0]

            fixed, optimum = self._time(path, followed, None, density)
            if optimum is None:
                made = replace(fixed, freedom=report_fixed(path, fixed)) if fixed.has_motion else fixed
                return best or made, rounds
            choice, least = choice_for(path, fixed.joint_path, optimum, held=held), fixed.least_duration or 0.0
            guess = find_guess(best, NOT_FAR * least, optimum.programme.s)
            made, result, spent = choose_around(choice, scene, fixed, plan_along, guess, FAST * least)
            made, rounds = replace(made, freedom=result), rounds + spent
            best = made if made and (best is None or made.trajectory.duration < best.trajectory.duration) else best
            if made and not ENOUGH_NEAR * least < made.trajectory.duration <= MAY_GAIN * before:
                break
        return best or made, rounds

    def _finish(self, found: Plan, duration: float | None, density: float = 1.0) -> Plan:
        """Return a plan along a chosen path with the duration that is asked for, if it meets its via points."""
        if duration is not None and found:
            found = self._time(found.path, FollowResult(found.joint_path, None), duration, density)[0]
        if isinstance(found.path, PointToPoint) and (missed := found.path.list_missed()):
            reason = f"the via point at s = {missed[0].s:.6g} {found.path.unit} is missed by more than its tolerance"
            status, advice = PlanStatus.NOT_PROVED, "a wider tolerance, or via points farther apart"
            found = self.request._fail(status, found.prefix, PlanFailure(status, missed[0].s, None, reason, advice))
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
