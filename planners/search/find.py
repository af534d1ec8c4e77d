"""find_path(): collision-free joint paths from a configuration to a goal, and the goals of a pose."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.check import check_choice, check_count, real_array
from optik.errors import InvalidInput, NoSolution
from optik.ik.problem import check_start
from optik.registry import build_method
from optik.scene import Scene
from optik.scene.contact import advise_contact, find_contact
from optik.types import Array, Flags
from planners.paths.configurations import find_configurations
from planners.paths.goal import WINDINGS, find_continuous
from planners.search.base import JointSpace, Search, SearchLike, SearchResult, SearchStatus, measure_length

# ---------------- goals of a search


FEWEST_GOALS, MOST_GUESSING_ROUNDS, ROUND_GUESSES = 8, 12, 60
"""Collision-free configurations of a pose that are enough for a redundant arm (for others one is), most rounds that search more
of them, and the initial guesses of each round."""
MOST_GOALS = 500
"""Most goals of a search, windings included: those nearest to the start."""
FARTHEST_WINDING = 2.0 * np.pi * (1.0 + 1e-9)
"""Largest motion of a joint from the start to a winding that is a goal [rad]: further turns lead to the same places."""
EQUAL_DECIMALS = 7
"""Decimals within which goals are equal [rad, m]."""


def list_goals(space: JointSpace, start: Array, goal: ArrayLike, winding: str) -> tuple[Array, Array]:
    """Return the collision-free goals (k, n), the nearest first, and all configurations (m, n) of which they are windings.

    A pose has all its configurations and their windings inside the limits as goals; joints have the windings of joints without
    limits, unless `winding` is exact.
    """
    robot = space.robot
    expected = f"{robot.n} joints, several rows of them, or a pose (4, 4)"
    array = real_array(goal, "goal", expected)
    turning = find_continuous(robot) if winding == "nearest" else np.zeros(robot.n, np.bool_)
    if array.shape == (4, 4) and (robot.n != 4 or (array[3] == np.eye(4)[3]).all()):
        goals, turning = _find_configurations(space, start, se3.check_pose(array, "goal")), robot.turning
    elif array.ndim not in (1, 2) or array.shape[-1] != robot.n or not len(array):
        raise InvalidInput("goal", f"shape {array.shape}", expected)
    else:
        goals = np.array([check_start(robot, q, "goal") for q in array.reshape(-1, robot.n)])
    free = goals[[space.is_free(q) for q in np.ascontiguousarray(goals)]]
    return _wind(robot, free, start, turning), goals


def _find_configurations(space: JointSpace, start: Array, pose: Array) -> Array:
    """Return configurations (k, n) of a pose: more if few are collision-free."""
    robot, rng, rounds = space.robot, np.random.default_rng(0), list[Array]()
    fewest, count = FEWEST_GOALS if robot.n > 6 else 1, 0
    for _ in range(MOST_GUESSING_ROUNDS):
        guesses = robot.limits.sample(rng, ROUND_GUESSES) if rounds else np.empty((0, robot.n))
        rounds.append(find_configurations(robot, pose, np.concatenate([start[None], guesses]), "the goal"))
        count += sum(space.is_free(q) for q in np.ascontiguousarray(rounds[-1]))
        if count >= fewest:
            break
    return _drop_equal(np.concatenate(rounds))


def _wind(robot: Robot, q: Array, near: Array, turning: Flags) -> Array:
    """Return configurations (k, n) and their windings inside the limits, at most a turn from another one, the nearest first."""
    turn, lower, upper = 2.0 * np.pi, robot.limits.lower - LIMIT_TOLERANCE, robot.limits.upper + LIMIT_TOLERANCE
    turning = turning & (upper - lower >= turn)
    turns = np.clip(np.round((near - q) / turn), np.ceil((lower - q) / turn), np.floor((upper - q) / turn))
    wound = q + turn * np.where(turning, turns, 0.0)
    for i in np.flatnonzero(turning):
        others = np.concatenate([wound, wound])
        others[:, i] += turn * np.repeat([-1.0, 1.0], len(wound))
        x = others[:, i]
        wound = np.concatenate(
            [wound, others[(x >= lower[i]) & (x <= upper[i]) & (np.abs(x - near[i]) <= FARTHEST_WINDING)]]
        )
        wound = wound[np.argsort(np.linalg.norm(wound - near, axis=1), kind="stable")[:MOST_GOALS]]
    wound = _drop_equal(wound if robot.motors is None else wound[robot.limits.contains(wound)])
    return np.ascontiguousarray(wound[np.argsort(np.linalg.norm(wound - near, axis=1), kind="stable")])


def _drop_equal(q: Array) -> Array:
    """Return the different ones of configurations (k, n)."""
    return q[np.sort(np.unique(q.round(EQUAL_DECIMALS), axis=0, return_index=True)[1])]


# ---------------- find_path()


SAME_PATH = 0.05
"""Two paths are the same if points at equal fractions of their lengths differ by at most this distance [rad, m]."""
COMPARED_POINTS = 33
"""Number of points at which two paths are compared."""
MOST_PATHS, MOST_SHORTCUTS = 1_000, 1_000_000
"""Largest numbers of paths and of shortcuts that can be requested: more would take hours."""


def find_path(
    robot: Robot,
    q_start: ArrayLike,
    goal: ArrayLike,
    *,
    scene: Scene, search: SearchLike = "rrt_connect", seed: int = 0, max_samples: int | None = None,
    shortcuts: int = 100, paths: int = 3, winding: str = "nearest",
) -> SearchResult:  # fmt: skip
    """Find joint paths that are proved to be collision-free, and shorten them.

    Each path consists of straight joint motions, proved by bounds on how far links move. Equal arguments give equal paths.

    Parameters
    ----------
    robot : Robot
        An arm with shapes.
    q_start : (n,) array
        Start [rad, m].
    goal : (n,) array, or (k, n) array, or (4, 4) array
        Configuration [rad, m]; several, of which one is reached; or a pose of the tool, reached in any configuration with any
        winding. For an arm of four joints, (4, 4) is a pose if its last row is 0, 0, 0, 1.
    scene : Scene
        Obstacles, and the margin to them; the arm's own links are checked too. An empty scene checks the links alone.
    search : str, path, type or Search
        Method by name, by the path of a file, or built.
    seed : int
        Key of the random numbers.
    max_samples : int, optional
        Largest number of random configurations of each search; 100,000 by default.
    shortcuts : int
        Number of random shortcuts that are tried on each path; 0 returns the path as found.
    paths : int
        Number of searches; the first without a path ends them. The shortest of three paths is 6 % shorter than one (mean of
        MotionBenchMaker's problems). Equal paths are returned once. A free straight line to the nearest goal ends the searches.
    winding : {"nearest", "exact"}
        For a goal configuration: "nearest" lets joints without limits end whole turns away from it; "exact" does not.

    Returns
    -------
    SearchResult
        The paths, the shortest first; or the reason why there is none.

    Raises
    ------
    InvalidInput, UnknownName
        An invalid argument or unknown method; a start or goal outside the limits; an arm without shapes.
    """
    space, start = JointSpace(robot, scene), np.ascontiguousarray(check_start(robot, q_start, "q_start"))
    check_count(seed, "seed", 0)
    check_count(shortcuts, "shortcuts", 0, MOST_SHORTCUTS)
    check_count(paths, "paths", 1, MOST_PATHS)
    method = _get_search(search, max_samples)
    try:
        goals, every = list_goals(space, start, goal, check_choice(winding, "winding", WINDINGS))
    except NoSolution as error:
        return SearchResult(SearchStatus.GOAL_UNREACHABLE, (), 0, error.reason, error.advice)
    if not (starts := space.is_free(start)) or not len(goals):
        return _refuse(space, every if starts else start[None], start)
    return _search(space, start, goals, method, (seed, shortcuts, paths, winding))


def _search(
    space: JointSpace, start: Array, goals: Array, method: Search, options: tuple[int, int, int, str]
) -> SearchResult:
    """Search paths to the goals (k, n), the nearest of which is the first; shorten them, and return the different ones."""
    seed, shortcuts, paths, winding = options
    routes: list[Array] = []
    samples = 0
    for k in range(paths):
        if routes:  # a goal that is farther than a path is long would make a longer path
            goals = goals[np.linalg.norm(goals - start, axis=1) <= (1.0 + 1e-9) * min(map(measure_length, routes))]
        attempt = method.search(space, start, goals, (seed, k))
        if not isinstance(attempt, tuple) or len(attempt) != 2:
            raise InvalidInput(
                f"result of {type(method).__name__}", repr(attempt)[:60], "a SearchAttempt(vertices, samples)"
            )
        path, used = attempt
        samples += used
        if path is None:
            break  # a search of the full budget is enough
        vertices = np.ascontiguousarray(path, dtype=np.float64)
        _check_path(space, vertices, start, goals, method)
        if shortcuts:
            vertices = space.shorten(vertices, np.random.default_rng((seed, k, 0)).random((shortcuts, 2)))
        if not any(_is_same_path(vertices, other) for other in routes):
            routes.append(vertices)
        if len(vertices) <= 2 and (vertices[-1] == goals[0]).all():
            break
    if routes:
        return SearchResult(SearchStatus.FOUND, tuple(sorted(routes, key=measure_length)), samples)
    reason = f"no path found with {samples} random configurations; that does not prove that there is none"
    advice = "a larger max_samples, another seed, or a smaller scene.margin"
    if winding == "exact" and find_continuous(space.robot).any():
        advice += '; or winding="nearest", if joints without limits may end whole turns away'
    return SearchResult(SearchStatus.NO_PATH_FOUND, (), samples, reason, advice)


def _check_path(space: JointSpace, vertices: Array, start: Array, goals: Array, method: Search) -> None:
    """Raise InvalidInput unless a path joins the start and a goal, and its edges are proved."""
    expected = "a path from the start to a goal"
    if (
        vertices.ndim != 2
        or vertices.shape[1] != space.robot.n
        or not len(vertices)
        or not space.robot.limits.contains(vertices).all()
    ):
        raise InvalidInput(
            f"path of {type(method).__name__}", f"shape {vertices.shape}", f"{expected} inside the limits"
        )
    if (vertices[0] != start).any() or not (vertices[-1] == goals).all(axis=1).any():
        raise InvalidInput(f"path of {type(method).__name__}", "other ends", expected)
    for i, (a, b) in enumerate(pairwise(vertices)):  # an edge of the goals' tree was proved from its other end
        if not space.is_edge_free(a, b) and not (space.is_free(a) and space.is_edge_free(b, a)):
            raise InvalidInput(
                f"path of {type(method).__name__}", f"edge {i} is not proved free", "edges that are proved"
            )


def _get_search(search: SearchLike, max_samples: int | None) -> Search:
    """Return a built search."""
    if isinstance(search, Search):
        if max_samples is not None:
            raise InvalidInput("max_samples", max_samples, "no value here if the search is built: it has its own")
        return search
    options = {} if max_samples is None else {"max_samples": max_samples}
    built: Search = build_method("planners.search", search, "search", **options)
    return built


def _refuse(space: JointSpace, q: Array, start: Array) -> SearchResult:
    """Return the result for configurations (k, n) of a goal that are in contact, or for the start."""
    starts = len(q) == 1 and bool((q[0] == start).all())
    status, words = SearchStatus.GOAL_IN_CONTACT, "the goal is in collision"
    if starts:
        status, words = SearchStatus.START_IN_CONTACT, "the start is in collision"
    if len(q) > 1:
        words = f"all {len(q)} configurations found for the goal are in collision, the nearest one"
    near = find_contact(space.robot, space.scene, q[np.linalg.norm(q - start, axis=1).argmin()])
    margin = f", and the margin is {1e3 * space.scene.margin:.3g} mm" if near.distance > 0.0 else ""
    gap = f"{1e3 * near.distance:.3g} mm" if near.distance > 0.0 else "contact"
    reason = f"{words}: {gap} between {near.pair[0]} and {near.pair[1]}{margin}"
    advice = advise_contact(space.robot, space.scene, near.pair, "another configuration")
    return SearchResult(status, (), 0, reason, advice)


def _is_same_path(a: Array, b: Array) -> bool:
    """Return whether two paths are nearly the same."""
    u = np.linspace(0.0, 1.0, COMPARED_POINTS)
    return bool(np.linalg.norm(_points_along(a, u) - _points_along(b, u), axis=1).max() <= SAME_PATH)


def _points_along(vertices: Array, fractions: Array) -> Array:
    """Return points (k, n) of a path at fractions of its length."""
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(vertices, axis=0), axis=1)))
    return np.stack([np.interp(fractions * s[-1], s, column) for column in vertices.T], axis=1)
