"""Accuracy and repeatability of poses and paths in the manner of ISO 9283, from simulated cycles."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.ik import IKSolver, make_solver
from optik.types import Array

SIMULATED = "simulated"
"""Label of every figure of this module: none was measured on an arm."""

POSE_FRACTION = 0.8
"""Position of the outer four poses on the half diagonals of the measuring plane [1]: a tenth of the diagonal from its ends."""

EDGE_STEP = 0.01
"""Step of the search for the edge of the cube [m]."""

POSE_MARGIN = 0.02
"""Least distance of the five configurations from the joint limits [rad, m]: noisy starts of the next motion are inside."""

NO_NOISE = "not applicable: nothing varies from cycle to cycle"
"""Reason for the absence of a repeatability in simulations without noise."""


class PoseFigures(NamedTuple):
    """Accuracy and repeatability of one pose, simulated."""

    cycles: int
    offset: Array  # (3,) mean of the reached positions minus the commanded one, in the base frame [m]
    accuracy: float  # AP, the length of the offset [m]
    turn: Array  # (3,) mean of the rotation vectors from the commanded to the reached orientation, in the base frame [rad]
    repeatability: float | None  # RP = l̄ + 3 S of the distances l from the mean position, S with n − 1 [m]
    turn_repeatability: Array | None  # (3,) 3 S of each component of the rotation vectors [rad]
    reason: str  # why there is no repeatability; empty if there is one


class PathFigures(NamedTuple):
    """Accuracy and repeatability of a path, simulated: the largest of its points."""

    cycles: int
    accuracy: float  # AT, the largest distance between the mean position and the commanded point [m]
    at: int  # index of the point of that distance
    repeatability: float | None  # RT, the largest l̄ + 3 S of all points [m]
    repeatability_at: int | None  # index of the point of that value
    reason: str  # why there is no repeatability; empty if there is one


class Cube(NamedTuple):
    """The five poses of the standard in a diagonal plane of a cube."""

    poses: Array  # (5, 4, 4) the centre P1, then P2 to P5 around it, in the base frame [1, m]
    q: Array  # (5, n) configurations of the poses [rad, m]
    edge: float  # of the cube [m]
    words: str  # a description of the choice


def pose_figures(command: ArrayLike, reached: ArrayLike, *, noise: bool = True) -> PoseFigures:
    """Return AP and RP of a commanded pose (4, 4) from the poses reached (k, 4, 4); without noise there is no RP."""
    T = _check_finite(command, "command", (4, 4), "a pose (4, 4)")
    poses = _check_finite(reached, "reached", (-1, 4, 4), "poses (k, 4, 4), one a cycle")
    at, turns = poses[:, :3, 3], se3.error(np.broadcast_to(T, poses.shape), poses)[:, 3:]
    mean = at.mean(axis=0)
    reason = _why_no_spread(at, noise)
    rp, three = (None, None) if reason else (float(_repeatability(at)), 3.0 * turns.std(axis=0, ddof=1))
    offset = mean - T[:3, 3]
    return PoseFigures(len(at), offset, float(np.linalg.norm(offset)), turns.mean(axis=0), rp, three, reason)


def path_figures(command: ArrayLike, reached: ArrayLike, *, noise: bool = True) -> PathFigures:
    """Return AT and RT of commanded points (m, 3) and the points (k, m, 3) where each cycle met their normal planes."""
    points = _check_finite(command, "command", (-1, 3), "points (m, 3)")
    cycles = _check_finite(reached, "reached", (-1, len(points), 3), f"points (k, {len(points)}, 3), one row a cycle")
    off = np.linalg.norm(cycles.mean(axis=0) - points, axis=1)
    at, reason = int(off.argmax()), _why_no_spread(cycles, noise)
    if reason:
        return PathFigures(len(cycles), float(off[at]), at, None, None, reason)
    spread = _repeatability(cycles)
    worst = int(spread.argmax())
    return PathFigures(len(cycles), float(off[at]), at, float(spread[worst]), worst, "")


def crossings(command: ArrayLike, tangents: ArrayLike, followed: ArrayLike) -> Array:
    """Return where a followed path (k, 3), straight between samples, meets the normal planes of commanded points (m, 3).

    Of several crossings of a plane the nearest to the point counts; where the path ends before a plane, its nearest sample.
    """
    points = _check_finite(command, "command", (-1, 3), "points (m, 3)")
    along = _check_finite(tangents, "tangents", points.shape, "a direction for each point")
    path = _check_finite(followed, "followed", (-1, 3), "positions (k, 3)")
    length = np.linalg.norm(along, axis=1)
    if len(path) < 2 or not length.all():
        raise InvalidInput(
            "followed, tangents", f"{len(path)} samples", "two samples or more, and tangents with a length"
        )
    return np.array([_crossing(p, t, path) for p, t in zip(points, along / length[:, None], strict=True)])


def _crossing(point: Array, tangent: Array, path: Array) -> Array:
    """Return the crossing of a path with one plane that is nearest to the plane's point."""
    height = (path - point) @ tangent
    change = np.diff(height)
    crossed = np.flatnonzero((height[:-1] * height[1:] <= 0.0) & (change != 0.0))
    if not crossed.size:
        return np.asarray(path[np.linalg.norm(path - point, axis=1).argmin()])
    fraction = -height[crossed] / change[crossed]
    found = path[crossed] + fraction[:, None] * np.diff(path, axis=0)[crossed]
    return np.asarray(found[np.linalg.norm(found - point, axis=1).argmin()])


def cube_poses(robot: Robot, q: ArrayLike, *, most_edge: float = 1.0) -> Cube:
    """Choose the five poses: the largest cube around the tool at a configuration (n,) that the arm can serve.

    The cube's edges are parallel to the base axes and its centre is the tool at `q`. Each of the four planes of the standard
    contains two opposite horizontal edges. The edge is the largest one, in steps of 10 mm, for which all five poses of some
    plane are reached from `q` with its orientation and a margin of 0.02 rad (m) from every joint limit. The first such
    plane is used.
    """
    centre = robot.configuration(q, "q")
    check_number(most_edge, "most_edge", "metres above 0", above=0.0)
    solver, T = make_solver(robot, "lm", max_restarts=0), robot.fk(centre)  # without restarts: on the same branch
    up = int(np.abs(robot.gravity).argmax())
    for edge in np.arange(round(most_edge / EDGE_STEP), 0, -1) * EDGE_STEP:
        for plane in _planes(up):
            poses = np.repeat(T[None], 5, axis=0)
            poses[1:, :3, 3] += POSE_FRACTION * 0.5 * edge * plane
            found = _solve_cube(robot, solver, poses, centre)
            if found is not None:
                return Cube(poses, found, float(edge), describe_cube(float(edge)))
    raise InvalidInput(
        "q", np.round(centre, 4).tolist(), "a configuration with room for a cube of 10 mm around its tool"
    )


def _planes(up: int) -> list[Array]:
    """Return the corners (4, 3) of the four inclined planes of the cube, in half edges, in turn around the centre."""
    planes = []
    for side, lean in product([i for i in range(3) if i != up], (1.0, -1.0)):
        other = 3 - up - side
        corners = np.zeros((4, 3))
        corners[:, side] = [1.0, 1.0, -1.0, -1.0]
        corners[:, other] = [1.0, -1.0, -1.0, 1.0]
        corners[:, up] = lean * corners[:, other]
        planes.append(corners)
    return planes


def _solve_cube(robot: Robot, solver: IKSolver, poses: Array, q: Array) -> Array | None:
    """Return configurations that reach all poses with the margin, each solved from the centre; None if one pose has none."""
    lower, upper = robot.limits.lower + POSE_MARGIN, robot.limits.upper - POSE_MARGIN
    found = [q]
    for T in poses[1:]:
        result = solver.solve(T, q)
        if not result:
            return None
        found.append(result.q)
    inside = all((x >= lower).all() and (x <= upper).all() for x in found)
    return np.array(found) if inside else None


def describe_cube(edge: float) -> str:
    """Return a description of how the five poses were chosen."""
    return (
        f"Five poses in a diagonal plane of a cube of {1e3 * edge:.0f} mm around the tool at the start: its centre, and a "
        "tenth of the diagonal from each end of the plane's diagonals; the orientation is that of the start. The cube is "
        "the largest, in steps of 10 mm, at whose poses all joints stay 0.02 rad inside their limits."
    )


def _repeatability(positions: Array) -> Array:
    """Return the repeatability of positions over cycles (first axis): mean + 3 standard deviations of their scatter."""
    distance = np.linalg.norm(positions - positions.mean(axis=0), axis=-1)
    return np.asarray(distance.mean(axis=0) + 3.0 * distance.std(axis=0, ddof=1))


def _why_no_spread(positions: Array, noise: bool) -> str:
    """Return why the cycles have no spread; empty if they have one."""
    if not noise:
        return NO_NOISE
    if len(positions) < 2:
        return "not applicable: there is only one cycle"
    return "" if (positions != positions[0]).any() else NO_NOISE


def _check_finite(values: ArrayLike, name: str, shape: tuple[int, ...], expected: str) -> Array:
    """Return numbers after checking that they are finite and have the given shape; −1 stands for any length."""
    found = real_array(values, name, expected)
    fits = found.ndim == len(shape) and all(
        n == m or (m == -1 and n > 0) for n, m in zip(found.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(found).all():
        raise InvalidInput(name, f"shape {found.shape}" if not fits else "numbers that are not finite", expected)
    return found
