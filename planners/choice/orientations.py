"""Candidate paths with a short duration or little joint travel: from sequences, and with constant orientations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from optik import se3
from optik.types import Array
from planners.choice.choose import measure_time, measure_travel
from planners.following import smoothing
from planners.following.joint_path import JointPath
from planners.following.resolve.freedoms import FreeWay
from planners.paths.free_path import FreePath

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
