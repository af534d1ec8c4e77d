"""follow(): a joint path that tracks one branch along a Cartesian path, with exact derivatives and proved deviation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import newton
from optik.arm.motors import ranges_of
from optik.arm.reach import reach_bound
from optik.arm.robot import Robot
from optik.check import check_choice, check_count, check_kind, check_number
from optik.errors import InvalidInput
from optik.ik import IKSolver, IKStatus, Tolerance, make_solver, solve_ik
from optik.ik.base import ToleranceLike
from optik.ik.problem import check_start
from optik.scene import Scene
from optik.task import POSE
from optik.types import Array, Flags
from planners.following import march
from planners.following.branches import CollisionCheck, find_branches
from planners.following.failure import (
    FollowStatus,
    PlanFailure,
    explain_branch_jump,
    explain_end,
    explain_ik_failure,
    find_rank_failure,
    format_position,
    joint_unit,
)
from planners.following.freed import POINT_ADVICE, explain_asked, find_distance, find_immovable, free_arm
from planners.following.joint_path import Course, IKRecord, JointPath, Nodes, make_empty_guide, thin_knots
from planners.following.redundancy import MOST_REFINEMENTS, find_null_space_motions
from planners.following.resolve import Resolution
from planners.following.resolve.graph import Sequence
from planners.following.track import FollowedTrack, TrackEnd, find_exit, singular_value_at, track
from planners.paths.base import Path
from planners.paths.coordinates import CoordinateRange
from planners.paths.free_path import FreePath
from planners.paths.poses import NO_LENGTH
from planners.trajectory.curve import quintic_through

__all__ = ["FollowResult", "FollowStatus", "IKRecord", "JointPath", "PlanFailure", "follow"]


# ---------------- follower


START_TOLERANCE = 1e-4
"""Largest distance of the tool from the path's start [m and rad]: the accuracy of a real arm's encoders and model."""
SAME_BRANCH = 0.02
"""Largest distance of a result from the tracked configuration [rad or m] that is accepted without polishing it."""
RETRY_BELOW = 1e-2
"""Smallest singular value below which a method that jumped to another branch is called again, with the tracked configuration
as its initial guess."""
DRIFT_BELOW = 1e-4
"""Smallest singular value below which a tolerance of 1e-6 lets the joints drift by `SAME_BRANCH` / 2 and more, so that the
next sample starts at the tracked configuration."""
AROUND_ADVICE = "another goal; or avoid=True, which searches a way around"
"""What to try if a path of joints is in collision."""


class FollowResult(NamedTuple):
    """The joint path, or on failure its valid part, and the failure. ``bool(followed)`` is success."""

    joint_path: JointPath | None
    failure: PlanFailure | None
    resolution: Resolution | None = None

    def __bool__(self) -> bool:
        return self.failure is None

    @property
    def status(self) -> FollowStatus:
        """Outcome of following."""
        return FollowStatus.SOLVED if self.failure is None else FollowStatus(self.failure.status)


@dataclass(frozen=True)
class Follower:
    """The validated arguments of `follow`: samples s ``grid`` (k,), start ``q`` (n,), choice of branch, collision check.

    A resolution of the whole path has a time limit [s], or it was made and its sequence is ``way``. Of a freed arm so many
    joints are ``shown``.
    """

    solver: IKSolver
    path: Path
    grid: Array
    q: Array | None
    branch: str
    tolerance: Tolerance
    collision: CollisionCheck | None
    time_limit: float = 0.0
    way: Sequence | None = None
    shown: int | None = None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.solver.robot

    def run(self) -> FollowResult:
        """Return the joint path of the tool's path, collision-free if there is a scene."""
        if not self.path.end > NO_LENGTH:
            reason = "the path has a length of 0: start and goal are equal, so there is nothing to move"
            equal = PlanFailure(FollowStatus.NO_LENGTH, 0.0, None, reason, "a goal away from the start")
            return FollowResult(None, equal)
        known = self.path.configurations(self.robot, self.grid)
        first = known[0] if known is not None else (self.q if self.branch == "start" else None)
        failure = None if self.collision is None or first is None else self.collision.check_start(first)
        if failure is not None:
            return FollowResult(None, failure)
        followed = self._follow_poses() if known is None else self._follow_joints(known)
        failure, pose = followed.failure, known is None and self.path.asked == "pose" and not self.path.turns_only
        if failure is not None and pose and self.robot.n < 6:
            return followed._replace(failure=replace(failure, advice=POINT_ADVICE + failure.advice))
        if self.collision is None or not followed or followed.joint_path is None:
            return followed
        failure = self.collision.check_path(followed.joint_path)
        if failure is None:
            return followed
        advice = AROUND_ADVICE if known is not None else self._find_free_branch()
        failure = failure if followed.resolution is None else followed.resolution.explain(failure)
        return followed._replace(failure=replace(failure, advice=advice))

    def _find_free_branch(self) -> str:
        """Return the advice for a joint path in collision: a collision-free branch, if there is one."""
        if self.branch == "best":
            what = "branch" if self.robot.n <= 6 else "null-space motion that was tried"
            return f"another path, or another pose of the object: no {what} follows the whole path without collision"
        other = replace(self, branch="best").run()
        if not other or other.joint_path is None:
            return "another path: no other branch that was tried follows the whole path without collision"
        start = _format(self.robot, other.joint_path.q[0])
        return f'branch="best", which follows the whole path without collision from the start configuration {start}'

    def _follow_joints(self, q: Array) -> FollowResult:
        """Return the joint path of a path in joint space: only its limits are checked."""
        robot, path = self.robot, self.path
        if self.q is not None and np.abs(self.q - q[0]).max() > START_TOLERANCE:
            i = int(np.abs(self.q - q[0]).argmax())
            got = f"{robot.joint_names[i]} {abs(self.q[i] - q[0, i]):.3g} {joint_unit(robot, i)} from the path's start"
            raise InvalidInput("q_start", got, "the configuration where the path starts, or None")
        knots = path.nodes
        if knots is None:
            knots = np.union1d(self.grid, path.breaks[(path.breaks > 0.0) & (path.breaks < path.end)])
        orders = [path.configurations(robot, knots, order) for order in range(4)]
        q, dq = np.array(orders[0]), np.stack([np.array(d) for d in orders[1:]], axis=1)
        failure = self._find_beyond(knots, q, dq)
        good = len(knots) if failure is None else int(np.searchsorted(knots, failure.s))
        if good < 2:
            return FollowResult(None, failure)
        at = knots[:good]
        record = IKRecord(np.zeros(good), np.zeros(good), np.zeros(good, np.int64), at)
        chosen = np.isin(np.arange(good), thin_knots(at, path.breaks if path.nodes is None else at))
        return FollowResult(JointPath(robot, path, at, q[:good], dq[:good], record, chosen), failure)

    def _find_beyond(self, s: Array, q: Array, dq: Array) -> PlanFailure | None:
        """Return the failure where a joint or a motor of a joint path leaves its range first, or None."""
        robot, (at, i) = self.robot, find_exit(self.robot, s, q, dq)
        if not at <= self.path.end:
            return None
        ranges = ranges_of(robot)
        name, low, high = ranges.names[i], ranges.lower[i], ranges.upper[i]
        span = f"[{low:.6g}, {high:.6g}] {joint_unit(robot, ranges.axis[i])}"
        reason = f"{name} leaves its range {span} at {format_position(self.path, at)}"
        advice = "a path in joint space inside the limits" if self.path.in_joints else "another start or path"
        return PlanFailure(FollowStatus.OUTSIDE_LIMITS, at, name, reason, advice)

    def _follow_poses(self) -> FollowResult:
        """Return the joint path of a Cartesian path, by the number of joints and the choice of branch."""
        robot, path = self.robot, self.path
        if path.asked != "pose" and self.shown is None:
            return self._follow_asked()
        failure = find_rank_failure(robot)
        if failure is not None:
            return FollowResult(None, failure)
        guide = make_empty_guide(robot.n) if robot.n <= 6 else None
        if robot.n > 6 and self.branch == "start" and isinstance(path, FreePath) and path.null_space is not None:
            guide = path.guide  # the null-space motion is chosen
        if guide is None:
            return self._choose_null_space_motion()
        course = Course(path, guide)
        nodes = course.nodes(course.spread(self.grid, self.tolerance))
        if self.branch == "start":
            assert self.q is not None
            return self._finish(course, track(robot, course, nodes, self.q, self.tolerance), self.q)
        return self._choose_branch(course, nodes)

    def _follow_asked(self) -> FollowResult:
        """Return the joint path of a path of which less than the pose is asked: the arm's part of the freed arm's."""
        own, path, n = self.robot, self.path, self.robot.n
        failure = find_immovable(own, path, self.tolerance.position)
        if failure is not None:
            return FollowResult(None, failure)
        arm = free_arm(own, path, self.q, self.tolerance.position)
        solver, allowed = make_solver(arm.robot, type(self.solver)), arm.allow(self.tolerance)
        found = replace(self, solver=solver, path=arm.path, q=arm.q, tolerance=allowed, shown=n)._follow_poses()
        joints, failure = found.joint_path, found.failure
        if joints is not None:
            nodes = np.isin(np.arange(len(joints.knots)), joints._chosen)
            q, dq = np.ascontiguousarray(joints.q[:, :n]), np.ascontiguousarray(joints.derivatives[:, :, :n])
            joints = JointPath(own, path, joints.knots, q, dq, joints.ik, nodes)
            if own.motors is not None and (beyond := self._find_beyond(joints.knots, q, dq)) is not None:
                return found._replace(joint_path=None, failure=beyond)
        return found._replace(joint_path=joints, failure=failure and explain_asked(failure, own, arm, path))

    def _choose_branch(self, course: Course, nodes: Nodes) -> FollowResult:
        """Return the best collision-free branch that reaches the path's end; if none does, the one that goes farthest."""
        best: FollowedTrack | None = None
        rooms = None if self.collision is None else self.collision.find_rooms
        for candidate in find_branches(self.robot, self.path, self.q, rooms):
            if candidate.ended is not None and best is not None:
                break
            way = track(self.robot, course, nodes, candidate.q, self.tolerance)
            if best is None or way.s[-1] > best.s[-1]:
                best = way
            if self._is_free(way):
                best = way
                break
        if best is None:
            return FollowResult(None, self._explain_no_start())
        return self._finish(course, best, best.q[0])

    def _choose_null_space_motion(self) -> FollowResult:
        """Return the first null-space motion that reaches the end without collision, or the one that goes farthest."""
        robot, best, resolutions = self.robot, None, list[Resolution]()
        rooms = None if self.collision is None else self.collision.find_rooms
        for motion in find_null_space_motions(
            robot, self.path, self.q, self.branch, self.collision, self.way, self.time_limit, resolutions
        ):
            for _ in range(MOST_REFINEMENTS):
                course = Course(self.path, motion.guide())
                nodes = course.nodes(course.spread(self.grid, self.tolerance))
                way = track(robot, course, nodes, motion.way[0], self.tolerance)
                rank = float(way.s[-1]), rooms is None or bool(rooms(way.q[:1])[0] > 0.0)
                if best is None or rank > best[0]:
                    best = rank, way, course
                if way.ended is None or not motion.refine(way.ended.s, way.ended.code == march.LIMIT):
                    break
            if self._is_free(way):
                best = rank, way, course
                break
        if best is None:
            return FollowResult(None, self._explain_no_start())
        _, way, course = best
        followed = self._finish(course, way, way.q[0] if self.branch == "best" or self.q is None else self.q)
        if not resolutions or self.time_limit == 0.0:
            return followed
        last = resolutions[-1]
        return followed._replace(failure=followed.failure and last.explain(followed.failure), resolution=last)

    def _is_free(self, way: FollowedTrack) -> bool:
        """Return whether a track reaches the path's end and is collision-free."""
        return way.ended is None and (self.collision is None or self.collision.proves_free(way))

    def _explain_no_start(self) -> PlanFailure:
        """Return the failure of a path without a regular configuration at its start."""
        robot, path = self.robot, self.path
        result = solve_ik(robot, path.pose(0.0), robot.limits.clip(np.zeros(robot.n)) if self.q is None else self.q)
        if result:
            ended = TrackEnd(march.SINGULAR, 0.0, 0.0, -1)
            failure = explain_end(robot, path, reach_bound(robot, POSE), ended, result.q)
            return replace(failure, advice="a path that begins away from the singularity")
        kind = FollowStatus.OUTSIDE_LIMITS if result.status is IKStatus.OUTSIDE_LIMITS else FollowStatus.UNREACHABLE
        said = "; ".join(word for word in (str(result.status), result.message) if word)
        reason = f"no configuration inside the limits was found for the path's start ({said})"
        advice = "a path that begins within reach; optik.solve_ik with closest=True returns the nearest pose"
        return PlanFailure(kind, 0.0, None, reason, advice)

    # ------------------------------------------------------------ samples, the method's record, the joint path

    def _finish(self, course: Course, way: FollowedTrack, q_start: Array) -> FollowResult:
        """Return the joint path through nodes and samples, after the IK method solved these; up to the first failure."""
        robot, path = self.robot, self.path
        samples = self.grid[self.grid <= way.s[-1]]
        (knots, q, dq), node = _insert_samples(robot, course, way, samples)
        at = np.searchsorted(knots, samples)
        record, failure = self._solve_samples(samples, q[at], q_start)
        good = len(record.iterations)
        if failure is None and way.ended is not None:
            failure = explain_end(robot, path, reach_bound(robot, POSE), way.ended, way.q[-1])
        elif failure is not None:
            last = int(at[good - 1]) + 1 if good else 0
            knots, q, dq, node = knots[:last], q[:last], dq[:last], node[:last]
            if last:
                node[-1] = True
        if failure is not None and not failure.advice:
            failure = replace(failure, advice=self._find_advice(failure))
        if len(knots) < 2:
            return FollowResult(None, failure)
        return FollowResult(JointPath(robot, path, knots, q, dq, record, node), failure)

    def _solve_samples(self, samples: Array, tracked: Array, q_start: Array) -> tuple[IKRecord, PlanFailure | None]:
        """Solve the samples with the IK method, each from the result of the previous one, and compare with the track."""
        # Results may drift along self-motion manifolds, of a redundant arm everywhere and of others at singular
        # configurations. There the initial guess is the tracked configuration of the previous sample; or that of the
        # sample itself if the first result is far away, since the track determines the null-space motion.
        robot, solver, failure = self.robot, self.solver, None
        solve, redundant = solver.solve, robot.n > 6
        results: list[Any] = []
        q = q_start
        for i, target in enumerate(self.path.pose(samples)):
            result = solve(target, q)
            away = march.largest_motion(result.q, tracked[i])
            free = redundant
            if away > SAME_BRANCH or not result:
                sigma = 0.0 if redundant else singular_value_at(robot, tracked[i])
                free = sigma < DRIFT_BELOW
                if sigma < RETRY_BELOW and (away > march.LARGEST_STEP or not result):
                    result = solve(target, tracked[i])
                    away = march.largest_motion(result.q, tracked[i])
                if not result:
                    failure = explain_ik_failure(solver, self.path, float(samples[i]), result, q)
                elif (redundant and away > march.LARGEST_STEP) or not (
                    free or _is_same(robot, target, result.q, tracked[i])
                ):
                    step, before = result.q - tracked[i], tracked[max(i - 1, 0)]
                    failure = explain_branch_jump(solver, self.path, float(samples[i]), step, before)
                if failure is not None:
                    break
            results.append(result)
            q = tracked[i] if free else result.q
        position = np.array([result.position_error for result in results])
        rotation = np.array([result.rotation_error for result in results])
        iterations = np.array([result.iterations for result in results], np.int64)
        return IKRecord(position, rotation, iterations, samples[: len(results)]), failure

    def _find_advice(self, failure: PlanFailure) -> str:
        """Return a remedy as advice; each one is tried before it is given."""
        robot, path = self.robot, self.path
        shorter = "another start configuration or path"
        if failure.s > 0.0:
            shorter = f"a path that ends before {format_position(path, failure.s)}"
        if self.branch == "best":
            return f"{shorter}: no other branch that was found goes farther" if robot.n <= 6 else shorter
        if robot.n > 6:
            return f'branch="best", which may find another null-space motion; or {shorter}'
        if not solve_ik(robot, path.pose(path.end), robot.limits.clip(np.zeros(robot.n))):
            return f"{shorter}: its end was not reached"
        ways = find_branches(robot, path)
        if ways and ways[0].ended is None:
            start = _format(robot, ways[0].q[: self.shown])
            best = f'branch="best", which reaches the end of the path from the start configuration {start}'
            return f"{best}; or {shorter}"
        farther = ways and ways[0].s > failure.s + 1e-3 * path.end
        best = f'branch="best", which goes to {format_position(path, ways[0].s)}; or ' if farther else ""
        return f"{best}{shorter}: no branch that was found reaches the end of the path"


def _insert_samples(
    robot: Robot, course: Course, way: FollowedTrack, samples: Array
) -> tuple[tuple[Array, Array, Array], Flags]:
    """Return knots, q, derivatives, and which knots are nodes; other samples are solved from the nodes around them."""
    # At a singular configuration, which the nodes step over, a sample is interpolated between them.
    more = np.setdiff1d(samples, way.s, assume_unique=True) if len(way.s) > 1 else samples[:0]
    tracked = way.s, way.q, way.dq
    node = np.arange(len(way.s) + len(more)) < len(way.s)
    if not more.size:
        return tracked, node
    between, nodes = quintic_through(way.s, way.q, way.dq[:, 0], way.dq[:, 1]), course.nodes(more)
    orders = [between(more)] + [between(more, order) for order in (1, 2, 3)]
    q, dq = orders[0], np.stack(orders[1:], axis=1)
    chain, x, d = robot.chain, np.empty(robot.n), np.empty((3, robot.n))
    for k in range(len(more)):
        at, x[:] = (nodes.twists[k], nodes.rows[k], nodes.values[k]), q[k]
        newton.polish(chain, nodes.poses[k], nodes.rows[k, 0], nodes.values[k, 0], 8, x)
        if newton.derivatives_at(chain, x, *at, d, march.REGULAR)[1] >= march.REGULAR:
            q[k], dq[k] = x, d
    order = np.argsort(np.concatenate([way.s, more]), kind="stable")
    s, qs, dqs = (np.concatenate(pair)[order] for pair in zip(tracked, (more, q, dq), strict=True))
    return (s, qs, dqs), node[order]


def _is_same(robot: Robot, target: Array, q: Array, tracked: Array) -> bool:
    """Return whether a result at some distance from the tracked configuration converges to it when polished."""
    x = q[None].copy()
    newton.polish_batch(robot.chain, x, target[None], 10)
    return bool(np.abs(x[0] - tracked).max() <= 1e-6)


def _format(robot: Robot, q: Array) -> str:
    """Return a configuration as text."""
    return f"[{', '.join(f'{x:.5g}' for x in np.round(q, 9) + 0.0)}] {'(rad, m)' if robot.prismatic.any() else 'rad'}"


# ---------------- follow()


MOST_SAMPLES = 100_000
"""Most samples: 151 hold a line to a nanometre, and each is a call of the IK method."""
RESOLVES = "auto", "local"
"""Values of `resolve`."""
DEFAULT_TOLERANCE = Tolerance(1e-5, 1e-5)
"""Proved bound on the tool's deviation between samples [m, rad]; 151 samples of a regular line stay 1e4 times below."""


def follow(
    solver: IKSolver,
    path: Path,
    q_start: ArrayLike | None = None,
    *,
    branch: str | None = None, samples: int = 151, tolerance: ToleranceLike = DEFAULT_TOLERANCE,
    scene: Scene | None = None, resolve: str = "auto", time_limit: float | None = None,
) -> FollowResult:  # fmt: skip
    """Turn a Cartesian path into a joint path, by tracking one branch of configurations.

    Each step is predicted from exact derivatives and corrected by Newton's method to rounding. It is accepted if the joints
    move little and the quintic between is proved to keep the tool on the path and the joints inside their limits; else it
    is halved. The IK method solves the samples one after another, and its results are compared with the tracked branch.

    Parameters
    ----------
    solver : IKSolver
        Built for the arm, for whole poses.
    path : Path
        The path of the tool. A path in joint space is followed as it is, singular or not.
    q_start : (n,) array, optional
        Configuration at the path's start [rad, m].
    branch : {"start", "best"}, optional
        ``"start"``, the default with a ``q_start``, keeps its branch and winding. ``"best"`` tries all of them at the path's
        start (`planners.following.branches`), and for more than six joints chooses the null-space motion
        (`planners.following.redundancy`); it prefers a start near ``q_start``.
    samples : int
        Equally spaced in s, ends included; 151 for the paper's line.
    tolerance : Tolerance
        Bound on the tool's deviation from the path between samples [m, rad].
    scene : Scene, optional
        Obstacles for an arm with shapes, and the margin to them; its links are checked too. ``"best"`` chooses among
        collision-free branches.
    resolve : {"auto", "local"}
        ``"auto"`` searches among all configurations of a redundant arm where its null-space motion fails; ``"local"`` does not.
    time_limit : float, optional
        Largest computing time of this search [s], in addition to its budget of configurations. With a limit, a loaded machine
        may find less.

    Returns
    -------
    FollowResult
        On failure with the path parameter at which it ended, the reason and advice.

    Raises
    ------
    InvalidInput
        A start off the path, outside the limits or not finite, fewer than 2 samples, an unknown branch,
        an invalid tolerance, a solver for part of the pose, a scene with an arm without shapes.
    """
    seconds = read_time_limit(resolve, time_limit)
    return make_follower(solver, path, q_start, branch, samples, tolerance, scene, seconds).run()


def make_follower(
    solver: IKSolver, path: Path, q_start: ArrayLike | None, branch: str | None, samples: int, tolerance: ToleranceLike,
    scene: Scene | None, time_limit: float, way: Sequence | None = None,
) -> Follower:  # fmt: skip
    """Return the follower with checked arguments of `follow`, and the sequence of a resolution of the whole path."""
    check_kind(solver, "solver", IKSolver, "an IKSolver, such as optik.ik.get_solver(robot)")
    check_kind(path, "path", Path)
    q, branch = _check_start(solver, path, q_start, branch, samples)
    grid = np.linspace(0.0, path.end, samples)
    collision = None if scene is None else CollisionCheck(solver.robot, scene)
    return Follower(solver, path, grid, q, branch, Tolerance.of(tolerance), collision, time_limit, way)


def read_time_limit(resolve: str, time_limit: float | None) -> float:
    """Return the computing time [s] of the search along the whole path: infinite without a limit, 0 without a search."""
    check_choice(resolve, "resolve", RESOLVES)
    seconds = np.inf
    if time_limit is not None:
        seconds = check_number(time_limit, "time_limit", "seconds above 0, or None", above=0.0)
    return seconds if resolve == "auto" else 0.0


def _describe(one: CoordinateRange) -> str:
    """Return the allowed values of a coordinate in words, angles also in degrees."""
    low, high = one.allowed
    degrees = f" ([{np.degrees(low):.3g}, {np.degrees(high):.3g}]°)" if one.unit == "rad" else ""
    return f"{one.name} in [{low:g}, {high:g}] {one.unit}{degrees}"


def _check_start(
    solver: IKSolver, path: Path, q_start: ArrayLike | None, branch: str | None, samples: int
) -> tuple[Array | None, str]:
    """Return the checked start configuration and the choice of branch."""
    robot = solver.robot
    check_count(samples, "samples", 2)
    if samples > MOST_SAMPLES:
        raise InvalidInput("samples", samples, f"at most {MOST_SAMPLES}; 151 hold a line to a nanometre")
    if not solver.task.is_pose:
        raise InvalidInput("solver", f"one for the task {solver.task}", "one for the whole pose")
    if branch is None:
        branch = "best" if q_start is None else "start"
    check_choice(branch, "branch", ("start", "best"))
    if branch == "start" and q_start is None:
        raise InvalidInput("q_start", "None", 'a configuration for branch="start"; without one use branch="best"')
    q = None if q_start is None else check_start(robot, q_start, "q_start")
    if branch == "start" and q is not None and path.configurations(robot, np.zeros(1)) is None:
        distance, angle = find_distance(robot, q, path)
        if max(distance, angle) > START_TOLERANCE:
            got = f"the tool {1e3 * distance:.3g} mm and {np.degrees(angle):.3g}° from the path's start"
            within = f"within {1e3 * START_TOLERANCE:g} mm and {np.degrees(START_TOLERANCE):.2g}°"
            expected = f"a configuration on the path's start ({within})"
            if isinstance(path, FreePath) and len(path.screws) and path.asked == "pose":
                expected += f", or with freedoms inside their ranges: {', '.join(map(_describe, path.ranges))}"
            raise InvalidInput("q_start", got, expected)
    return q, branch
