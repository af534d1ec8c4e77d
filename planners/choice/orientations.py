"""Guesses of a free turn: the tool keeps its orientation relative to the base, or to the tangent of the path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from optik import newton, se3
from optik.arm.robot import Robot
from optik.types import Array
from planners.following.joint_path import JointPath
from planners.following.resolve.freedoms import FreeWay
from planners.following.smoothing import LARGEST_EDGE, STATION_REACHED
from planners.paths.free_path import FreePath

DENSE, STATIONS = 201, 26
"""Points of the path at which the winding of the given poses is measured, and at which the joints are tracked."""
LEAST_WINDING = 0.5
"""Winding of the given poses against a constant orientation [rad] from which this is a guess of its own."""
OFFSETS, START_STEPS, TRACK_STEPS = 16, 8, 8
"""Orientations inside the range that are compared, steps to the start of each, and most Newton steps to each station."""
ALIKE = 1.02
"""Ratio to the least time up to which the path with the least travel is the only one that is tried."""
ALONG = 0.1
"""Least part of the tool's velocity across the axis of the turn for which the tangent is a direction about it."""


def find_easy(path: FreePath, own: JointPath, ways: Sequence[FreeWay], *, held: bool) -> list[tuple[FreePath, Array]]:
    """Return paths that need little time, or little travel of the joints, by their stations; with their first joints (n,).

    They are compared with the joints along the path itself: the sequences that were found, and constant orientations.
    """
    s = np.linspace(0.0, path.end, STATIONS)
    found = [(path, own(s)), *((path.with_coefficients(way.fit(path), None), way.q) for way in ways)]
    starts = [FreeWay(s[:1], own.q[:1], path.coefficients[:1]), *ways]
    found += _keep_orientations(path, own.robot, starts, s, held=held)
    speed = np.ones(own.robot.n) if own.robot.limits.velocity is None else own.robot.limits.velocity
    times = np.array([(np.abs(np.diff(q, axis=0)) / speed).max(axis=1).sum() for _, q in found])
    travels = np.array([np.abs(np.diff(q, axis=0)).sum() for _, q in found])
    i, j = int(times.argmin()), int(travels.argmin())
    best = (j,) if times[j] <= ALIKE * times[i] else (i, j)
    return [(found[k][0], found[k][1][0]) for k in best if k]


def _keep_orientations(
    path: FreePath, robot: Robot, starts: Sequence[FreeWay], s: Array, *, held: bool
) -> list[tuple[FreePath, Array]]:
    """Return paths of constant orientations with the joints (k, n) at s, continued from the first ones of the starts.

    There is none where no freedom is a turn about an axis through the tool's point, or where the given poses hardly wind.
    """
    single = [kind.screws[0] for kind in path.kinds if len(kind.screws) == 1 and not kind.round]
    turning = [screw for screw in single if not np.any(screw[:3])]
    if not turning:
        return []
    column, dense = int((path.screws == turning[0]).all(axis=1).argmax()), np.linspace(0.0, path.end, DENSE)
    chosen = []
    for f in _list_turns(path, column, dense, held=held):
        p = path.coefficients.copy()
        p[:, column] = path.spline.fit(dense, f[:, None])[:, 0]
        chosen.append(path.with_coefficients(path.control_bounds.clip(p), None))
    if not chosen:
        return []
    poses = np.repeat([one.pose(s) for one in chosen], len(starts), axis=0)
    q = np.tile([way.q[0] for way in starts], (len(chosen), 1))
    away = np.repeat([one.coefficients[0, column] for one in chosen], len(starts))
    away = away - np.tile([way.f[0, column] for way in starts], len(chosen))
    q, good = _track(robot, q, poses, path.screws[column, 3:] * away[:, None], held=held)
    return [(chosen[k // len(starts)], q[k]) for k in np.flatnonzero(good)]


def _list_turns(path: FreePath, column: int, s: Array, *, held: bool) -> Iterator[Array]:
    """Yield turns f (k,) along the path that keep an orientation, as far as the range of the turn allows."""
    axis, begin = path.screws[column, 3:], path.coefficients[0, column]
    low, high = path.control_bounds.lower[0, column], path.control_bounds.upper[0, column]
    twists, R = path.given(s, 1), path.given(s)[:, :3, :3]
    v, w = (np.einsum("kji,kj->ki", R, x) for x in (twists[:, :3], twists[:, 3:]))  # in the tool's frame
    curves = [-scipy.integrate.cumulative_trapezoid(w @ axis, s, initial=0.0)]
    across = scipy.linalg.null_space(axis[None])
    x, y = v @ across[:, 0], v @ np.cross(axis, across[:, 0])
    if (np.hypot(x, y) > ALONG * np.linalg.norm(v, axis=1)).all():
        curves.append(np.unwrap(np.arctan2(y, x)))
    for f in curves:
        width = float(np.ptp(f))
        if width < LEAST_WINDING:
            continue
        f = f * min(1.0, (high - low) / width)
        least, most = low - f.min(), high - f.max()
        if held:
            yield np.clip(f + begin - f[0], low, high)
            continue
        middle = np.clip(begin - f[0], least, most)
        for offset in np.linspace(max(least, middle - np.pi), min(most, middle + np.pi), OFFSETS):
            yield f + offset


def _track(robot: Robot, q: Array, poses: Array, turns: Array, *, held: bool) -> tuple[Array, Array]:
    """Return joints (k, m, n) at poses (k, m, 4, 4), continued from starts (k, n) turned about vectors (k, 3); which are good.

    Good ones arrive inside the limits, without a jump. Windings that are free are nearest to the middle of the ranges.
    """
    q, good, found = np.ascontiguousarray(q), np.ones(len(q), np.bool_), []
    begin, limits = robot.fk(q), robot.limits
    for u in np.linspace(0.0, 1.0, START_STEPS + 1)[1:]:
        at = begin.copy()
        at[:, :3, :3] = begin[:, :3, :3] @ se3.exp_so3(u * turns)
        newton.polish_batch(robot.chain, q, at, TRACK_STEPS)
    for k in range(poses.shape[1]):
        before, at = q.copy(), np.ascontiguousarray(poses[:, k])
        newton.polish_batch(robot.chain, q, at, TRACK_STEPS)
        good &= (np.abs(robot.pose_errors(q, at)).max(axis=1) < STATION_REACHED) & (
            np.abs(q - before).max(axis=1) < LARGEST_EDGE
        )
        found.append(q.copy())
    way = np.stack(found, axis=1)
    if not held:
        off = limits.middle - 0.5 * (way.min(axis=1) + way.max(axis=1))
        way += 2.0 * np.pi * np.round(np.where(limits.bounded & ~robot.prismatic, off, 0.0) / (2.0 * np.pi))[:, None]
    return way, good & limits.contains(way.reshape(-1, robot.n)).reshape(len(way), -1).all(axis=1)
