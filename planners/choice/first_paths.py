"""Initial paths of a choice: from sequences, with constant orientations, and proved polylines around obstacles."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.registry import names
from optik.scene import Scene
from optik.scene.contact import check_scene, find_nearest_pairs, find_pairs
from optik.types import Array, Flags
from planners.choice.choose import measure_time, measure_travel
from planners.choice.rows import pass_through
from planners.following import smoothing
from planners.following.failure import FollowStatus, PlanFailure
from planners.following.joint_path import JointPath
from planners.following.resolve.freedoms import FreeWay
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.goal import path_to, read_goal
from planners.paths.point_to_point import PointToPoint
from planners.search.base import Search, SearchLike, SearchResult, SearchStatus
from planners.search.find import find_path

# ---------------- candidate paths with a short duration or little joint travel


DENSE, STATIONS = 201, 26
"""Points of the path at which the winding of the given poses is measured, and at which the joints are tracked."""
LEAST_WINDING = 0.5
"""Least rotation of the given poses about the tool axis [rad] for which a constant orientation is a separate initial guess."""
OFFSETS, START_STEPS = 16, 8
"""Orientations inside the range that are compared, and steps to the start of each."""
ALIKE = 1.02
"""If the path with the least travel takes at most this multiple of the least time, only that path is tried."""
ALONG = 0.1
"""Least fraction of the tool's velocity perpendicular to the turn axis for which the tangent defines a direction about it."""


def find_easy(path: FreePath, own: JointPath, ways: Sequence[FreeWay], *, held: bool) -> list[FreeWay]:
    """Return the candidates with the least time and with the least joint travel; none that is the given path."""
    s = np.linspace(0.0, path.end, STATIONS)
    found = [FreeWay(s, own(s), path.coordinates(s)[:, 0]), *ways, *_keep_orientations(path, own, ways, s, held=held)]
    times, travels = [measure_time(own.robot, way.q) for way in found], [measure_travel(way.q) for way in found]
    i, j = int(np.argmin(times)), int(np.argmin(travels))
    return [found[k] for k in ((j,) if times[j] <= ALIKE * times[i] else (i, j)) if k]


def _keep_orientations(
    path: FreePath, own: JointPath, ways: Sequence[FreeWay], s: Array, *, held: bool
) -> Iterator[FreeWay]:
    """Yield sequences at s with a constant orientation, continued from the first joints of the path and of other sequences.

    Nothing is yielded if no freedom is a rotation about an axis through the tool point, or if the given poses hardly rotate
    about it.
    """
    robot, dense = own.robot, np.linspace(0.0, path.end, DENSE)
    ranges = robot.limits.middle, np.where(robot.limits.bounded, robot.limits.half, np.inf)
    single = [kind.screws[0] for kind in path.kinds if len(kind.screws) == 1 and not np.any(kind.screws[0][:3])]
    column = int((path.screws == single[0]).all(axis=1).argmax()) if single else 0
    starts = [(own.q[0], path.coefficients[0]), *((way.q[0], way.f[0]) for way in ways)]
    for f in _list_turns(path, column, dense, held=held) if single else ():
        p = path.coefficients.copy()
        p[:, column] = path.spline.fit(dense, f[:, None])[:, 0]
        chosen = path.with_coefficients(path.control_bounds.clip(p), None)
        for q, begin in starts:
            turned = np.tile(robot.fk(q), (START_STEPS, 1, 1))
            away = np.linspace(0.0, f[0] - begin[column], START_STEPS)
            turned[:, :3, :3] = turned[:, :3, :3] @ se3.exp_so3(away[:, None] * path.screws[column, 3:])
            poses, first = np.concatenate([turned, chosen.pose(s)]), np.linalg.svd(robot.jacobian(q))[2][6:].T.copy()
            at, way = np.append(np.zeros(START_STEPS), s / path.end), np.tile(q, (len(poses), 1))
            if smoothing.continue_stations(robot.chain, *ranges, poses, at, first, way) < len(way):
                continue
            way = way[START_STEPS:]
            off = np.where(robot.prismatic | held, 0.0, ranges[0] - 0.5 * (way.min(axis=0) + way.max(axis=0)))
            way += 2.0 * np.pi * np.round(np.where(np.isfinite(off), off, 0.0) / (2.0 * np.pi))
            if robot.limits.contains(way).all():
                yield FreeWay(s, way, chosen.coordinates(s)[:, 0])


def _list_turns(path: FreePath, column: int, s: Array, *, held: bool) -> Iterator[Array]:
    """Yield turns f (k,) along the path that keep an orientation, as far as the range of the turn allows."""
    axis, begin = path.screws[column, 3:], path.coefficients[0, column]
    low, high = path.control_bounds.lower[0, column], path.control_bounds.upper[0, column]
    twists, R = path.given(s, 1), path.given(s)[:, :3, :3]
    v, w = (np.einsum("kji,kj->ki", R, x) for x in (twists[:, :3], twists[:, 3:]))  # in the tool's frame
    curves = [-scipy.integrate.cumulative_trapezoid(w @ axis, s, initial=0.0)]
    across = scipy.linalg.null_space(axis[None])[:, 0]
    x, y = v @ across, v @ np.cross(axis, across)
    if (np.hypot(x, y) > ALONG * np.linalg.norm(v, axis=1)).all():
        curves.append(np.unwrap(np.arctan2(y, x)))
    for f in curves:
        if (width := float(np.ptp(f))) < LEAST_WINDING:
            continue
        f = f * min(1.0, (high - low) / width)
        least, most = low - f.min(), high - f.max()
        middle = np.clip(begin - f[0], least, most)
        offsets = np.linspace(max(least, middle - np.pi), min(most, middle + np.pi), OFFSETS)
        yield from [np.clip(f + begin - f[0], low, high)] if held else f + offsets[:, None]


# ---------------- initial paths around obstacles


SPANS_PER_EDGE, FEWEST_SPANS = 2, 4
"""Spans of the spline on each edge of the polyline at first, and in all."""
SPAN_SAMPLES_FREE = 8
"""Configurations in each span that are examined."""
MOST_ROUNDINGS = 8
"""Most times that spans are halved where the spline is in contact. The polyline is collision-free."""
HALVED_AROUND = 2
"""Spans before and after one in contact that are halved too, since their control points bend it."""


DEFAULT_SEARCH = "rrt_connect"
"""Name of the search of a plan that avoids obstacles."""
SEARCHES = 3
"""Searches of each initial path, of which the shortest is taken."""
MOST_WAYS = 3
"""Most initial paths around the obstacles that a plan tries."""
MOST_AVOIDED_PAIRS = 200_000
"""Most pairs of shapes of a plan around obstacles, each with a clearance at every grid point: half a gigabyte."""
STRAIGHT_DISTANCE = 1e-5
"""Distance of the goal from the start [rad, m] up to which the straight path is taken."""
VIA_ADVICE = "another via point, or a smaller margin"
"""What to try if a via point is in collision."""


MORE_SAMPLES_ADVICE = (
    "more samples, avoid=planners.search.rrt_connect.RRTConnect(max_samples=1_000_000) in Python; or a smaller margin"
)
"""What to try if the searches find no path."""


class FirstPath(NamedTuple):
    """An initial path around obstacles, or the reason for none; and the samples of its searches."""

    found: PointToPoint | PlanFailure
    samples: int


def check_avoid(value: Any) -> bool | SearchLike:
    """Return whether obstacles are avoided, or by which search."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, str | os.PathLike | Search) or (isinstance(value, type) and issubclass(value, Search)):
        return value
    searches = ", ".join(names("planners.search"))
    raise InvalidInput("avoid", repr(value)[:60], f"True, False, or a search: {searches}, a file, or a built one")


def check_avoidable(
    robot: Robot, path: Path | ArrayLike, q_start: ArrayLike | None, scene: Scene | None, winding: str
) -> Path:  # fmt: skip
    """Return a path that can avoid obstacles: a goal (joints or a pose) becomes a `PointToPoint`, unless it is the start."""
    if scene is None:
        raise InvalidInput("scene", "None", "a Scene with the obstacles to avoid", advice="pass scene=")
    check_scene(robot, scene)
    assert robot.shapes is not None
    if len(find_pairs(robot, scene).bodies) > MOST_AVOIDED_PAIRS:
        allowed = f"about {MOST_AVOIDED_PAIRS // robot.shapes.m:,} for {robot.name} with avoid; or one cloud, clouds="
        raise InvalidInput("scene", f"{len(scene.names):,} objects", f"at most {allowed}")
    if isinstance(path, Path):
        if not isinstance(path, PointToPoint | FreePath):
            allowed = (
                "a PointToPoint, a goal (joints or a pose), or a path with freedoms: planners.free(line, turn=True)"
            )
            raise InvalidInput("path", f"a {path.name}, which leaves nothing to choose, with avoid", allowed)
        return path
    start, goal = read_goal(robot, path, q_start, winding)
    away = goal - start if goal.ndim == 1 else robot.pose_errors(start, se3.check_pose(goal, "path"))
    if not np.abs(away).max() > STRAIGHT_DISTANCE:
        return path_to(robot, path, start, winding)
    try:
        return PointToPoint(robot, start, goal)
    except NoSolution as error:
        raise NoSolution(error.reason.replace("point 0", "the goal"), advice=error.advice) from None


def advise_elbow(failure: PlanFailure | None, path: Path, robot: Robot) -> PlanFailure | None:
    """Return the failure of a plan around obstacles; advise `elbow` if a redundant arm is in contact without this freedom."""
    may_move = robot.n > 6 and isinstance(path, FreePath) and all(kind.screws for kind in path.kinds)
    if failure is None or failure.status != FollowStatus.CONTACT or not may_move:
        return failure
    return replace(failure, advice=f"elbow=True in planners.free, which moves the elbow; or {failure.advice}")


def find_first_paths(
    path: PointToPoint, scene: Scene, search: SearchLike, winding: str, paths: int
) -> Iterator[FirstPath]:  # fmt: skip
    """Yield initial paths from the start of a path through its via points to its goal: of one search, then of others.

    A pose is reached in the configuration that the search finds. Paths can be reversed, so another configuration of the pose
    reaches no further goals.
    """
    targets = [*(via.q for via in path.vias), path.coefficients[-1]]
    if path.points:  # unless it is from a file
        targets = [point.target if point.is_pose else q for point, q in zip(path.points, targets, strict=True)]
    at = [0.0, *(via.s for via in path.vias)]
    for seed in itertools.count():
        legs, samples, q = [], 0, path.coefficients[0]
        for i, (s, target) in enumerate(zip(at, targets, strict=True)):
            last = i == len(path.vias)
            turns = winding if last else "exact"
            answer = find_path(path.robot, q, target, scene=scene, search=search, seed=seed, winding=turns, paths=paths)
            samples += answer.samples
            if not answer:
                yield FirstPath(_explain(answer, i, s, last), samples)
                return
            q = answer.vertices[-1]
            legs.append([way for way in answer.paths if last or (way[-1] == q).all()])
        for way in itertools.zip_longest(*legs):
            chosen = [legs[i][-1] if leg is None else leg for i, leg in enumerate(way)]
            yield FirstPath(round_legs(path, chosen, scene), samples)
            samples = 0
        if all(len(leg[0]) == 2 for leg in legs):
            return  # straight, which no other search shortens


def _explain(found: SearchResult, i: int, s: float, last: bool) -> PlanFailure:
    """Return why there is no path to point i."""
    if found.status is SearchStatus.NO_PATH_FOUND:
        return PlanFailure(found.status, s, None, found.reason, MORE_SAMPLES_ADVICE)
    status = FollowStatus.UNREACHABLE if found.status is SearchStatus.GOAL_UNREACHABLE else FollowStatus.CONTACT
    via = not last and found.status is SearchStatus.GOAL_IN_CONTACT
    reason = found.reason if last else found.reason.replace("the goal", f"point {i}", 1)
    return PlanFailure(status, s, None, reason, VIA_ADVICE if via else found.advice)


def round_legs(path: PointToPoint, legs: list[Array], scene: Scene) -> PointToPoint:
    """Return a spline near the polylines of the legs, through the via points and collision-free at samples."""
    corners = np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    parts = max(SPANS_PER_EDGE, -(-FEWEST_SPANS // (len(s) - 1)))
    knots = np.unique(np.concatenate([np.linspace(a, b, parts + 1) for a, b in itertools.pairwise(s)]))
    for _ in range(MOST_ROUNDINGS):
        rounded = path.along(legs, knots[1:-1])
        rounded = rounded.with_coefficients(pass_through(rounded, rounded.coefficients))
        touching = _find_touching(rounded, knots, scene)
        missed = np.searchsorted(knots, [via.s for via in rounded.list_missed()])
        touching[missed - 1] = True
        if not touching.any():
            break
        wide = scipy.ndimage.binary_dilation(touching, iterations=HALVED_AROUND)
        knots = np.sort(np.concatenate([knots, 0.5 * (knots[:-1] + knots[1:])[wide]]))
    return rounded


def _find_touching(path: PointToPoint, knots: Array, scene: Scene) -> Flags:
    """Return which spans are in contact at their samples; the start is not examined."""
    u = np.arange(SPAN_SAMPLES_FREE) / SPAN_SAMPLES_FREE
    s = (knots[:-1, None] + np.diff(knots)[:, None] * u).ravel()
    room = find_nearest_pairs(path.robot, scene, path.configurations(path.robot, s))[0]
    room[0] = np.inf
    return np.asarray((room <= 0.0).reshape(len(knots) - 1, -1).any(axis=1))
