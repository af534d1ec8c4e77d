"""follow(): a joint path that tracks one branch along a Cartesian path, with exact derivatives and proved deviation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.ik import IKSolver, Tolerance
from optik.ik.base import ToleranceLike
from optik.ik.problem import check_start
from optik.scene import Scene
from optik.types import Array
from planners.following.collision import CollisionCheck
from planners.following.failure import FollowStatus, PlanFailure
from planners.following.follower import START_TOLERANCE, Follower, FollowResult
from planners.following.freed import find_distance
from planners.following.joint_path import IKRecord, JointPath
from planners.following.resolve.graph import Sequence
from planners.paths.base import Path
from planners.paths.coordinates import CoordinateRange
from planners.paths.free_path import FreePath

__all__ = ["FollowResult", "FollowStatus", "IKRecord", "JointPath", "PlanFailure", "follow"]

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
    if not isinstance(solver, IKSolver):
        raise InvalidInput("solver", repr(solver)[:60], "an IKSolver, such as optik.ik.get_solver(robot)")
    if not isinstance(path, Path):
        raise InvalidInput("path", repr(path)[:60], "a Path")
    q, branch = _check_start(solver, path, q_start, branch, samples)
    grid = np.linspace(0.0, path.end, samples)
    collision = None if scene is None else CollisionCheck(solver.robot, scene)
    return Follower(solver, path, grid, q, branch, Tolerance.of(tolerance), collision, time_limit, way)


def read_time_limit(resolve: str, time_limit: float | None) -> float:
    """Return the computing time [s] of the search along the whole path: infinite without a limit, 0 without a search."""
    if not isinstance(resolve, str) or resolve not in RESOLVES:
        raise InvalidInput("resolve", repr(resolve)[:60], " or ".join(f'"{name}"' for name in RESOLVES))
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
    if not isinstance(branch, str) or branch not in ("start", "best"):
        raise InvalidInput("branch", repr(branch)[:60], '"start" or "best"')
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
