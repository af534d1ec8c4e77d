"""Initial paths around obstacles: proved polylines between the points of a joint path, their corners rounded."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
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
from planners.choice.vias import pass_through
from planners.following.failure import FollowStatus, PlanFailure
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.goal import path_to, read_goal
from planners.paths.point_to_point import PointToPoint
from planners.search.base import Search, SearchLike, SearchResult, SearchStatus
from planners.search.find import find_path

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


class SearchReport(NamedTuple):
    """How a plan found a way around obstacles.

    Attributes
    ----------
    planner : str
        Name of the search.
    samples : int
        Random configurations of all searches.
    rounds : int
        Rounds of the choice of path and timing, each with the pairs of shapes that came too near in those before.
    paths : int
        Initial paths that were tried.
    """

    planner: str
    samples: int
    rounds: int
    paths: int


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
        raise InvalidInput("scene", "None", "a Scene with the obstacles to avoid")
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
    path: PointToPoint, scene: Scene, search: SearchLike, winding: str
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
            found = find_path(path.robot, q, target, scene=scene, search=search, seed=seed, winding=turns)
            samples += found.samples
            if not found:
                yield FirstPath(_explain(found, i, s, last), samples)
                return
            q = found.vertices[-1]
            legs.append([way for way in found.paths if last or (way[-1] == q).all()])
        for way in itertools.zip_longest(*legs):
            chosen = [legs[i][-1] if leg is None else leg for i, leg in enumerate(way)]
            yield FirstPath(round_corners(path, chosen, scene), samples)
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


def round_corners(path: PointToPoint, legs: list[Array], scene: Scene) -> PointToPoint:
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
