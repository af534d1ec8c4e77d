"""Chunk: joint targets at a fixed rate, as learned policies emit them."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LARGEST_LIMIT, ask_for_degrees
from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.se3 import check_pose
from optik.tables import Names, read_table
from optik.types import Array, Flags
from planners.certificate.checks import check_rate

FEWEST, MOST = 4, 1000
"""Points of a reference: a chunk with fewer is divided; and the largest number of a chunk."""
OUTSIDE = (0.005, 0.1)
"""Distances beyond the ranges up to which targets are clipped to them: prismatic joints [m], revolute ones [rad]."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Joint targets or tool poses at a fixed rate, the first at the time of the observation.

    Parameters
    ----------
    points : (m, n) or (m, 4, 4) array
        Targets, at least two: joints [rad, m], or poses of the tool in the base frame [1, m], which `retarget` follows on the
        branch of the running motion.
    rate : float
        Targets per second, in [10⁻⁶, 10⁹] [1/s].
    observed : float
        Time of the first target [s], on the clock of the running motion: the instant at which a policy observed the robot.

    Raises
    ------
    InvalidInput
        Points that are not finite or fewer than two, a rate out of range, or a time that is not finite.
    """

    points: ArrayLike
    rate: float
    observed: float = 0.0

    def __post_init__(self) -> None:
        expected = f"an (m, n) array of 2 to {MOST} finite joint targets, or (m, 4, 4) of poses"
        points = real_array(self.points, "points", expected).copy()
        poses = points.shape[1:] == (4, 4)
        if not (poses or points.ndim == 2) or not 2 <= len(points) <= MOST:
            raise InvalidInput("points", f"an array of shape {points.shape}", expected)
        for k, pose in enumerate(points if poses else ()):
            check_pose(pose, f"points[{k}]")
        if not poses and not (finite := np.isfinite(points).all(axis=1)).all():
            got = "NaN" if np.isnan(points[k := int(finite.argmin())]).any() else "an infinite number"
            raise InvalidInput("points", f"{got} in row {k}", "finite numbers")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "rate", check_rate(self.rate))
        object.__setattr__(self, "observed", check_number(self.observed, "observed", "a time [s]"))


def read_targets(chunk: Chunk, robot: Robot, free: Flags, ranges: Array) -> tuple[Array, float, int, int, int]:
    """Return the repaired targets (m, n), their rate [1/s], and the numbers of repaired targets, clipped targets and jumps.

    Joints without limits (`free`) take the shortest way from target to target, from half a turn around 0 on. A target that
    equals the one before in all joints, but not the next one, stands for a missing one. It becomes the mean of its neighbours.
    Targets outside ranges (n, 2) are clipped to them. Joints with limits that jump by more than π are counted.
    """
    P, rate = np.array(chunk.points), chunk.rate
    P[:, free] = np.unwrap(P[:, free] - 2.0 * np.pi * np.round(P[0, free] / (2.0 * np.pi)), axis=0)
    jumps = np.abs(np.diff(P, axis=0)) > np.where(free | robot.prismatic, np.inf, np.pi)
    given, P = P, np.minimum(np.maximum(P, ranges[:, 0]), ranges[:, 1])
    clipped, same = (given != P).any(axis=1), (P[1:] == P[:-1]).all(axis=1)
    changed = clipped.copy()
    for i in np.flatnonzero(same[:-1] & ~same[1:]) + 1:
        P[i], changed[i] = 0.5 * (P[i - 1] + P[i + 1]), True
    while len(P) < FEWEST:
        P, rate = np.insert(P, range(1, len(P)), 0.5 * (P[1:] + P[:-1]), axis=0), 2.0 * rate
    return P, rate, int(changed.sum()), int(clipped.sum()), int(jumps.any(axis=1).sum())


def refuse_targets(P: Array, robot: Robot) -> str:
    """Return why targets (m, n) are too far outside the ranges to be followed, or an empty text."""
    lower, upper = np.maximum(robot.limits.lower, -LARGEST_LIMIT), np.minimum(robot.limits.upper, LARGEST_LIMIT)
    grace, beyond = np.where(robot.prismatic, *OUTSIDE), np.maximum(lower - P, P - upper)
    excess = beyond.max(axis=0)
    if (excess <= grace).all():
        return ""
    i = int((np.minimum(excess, LARGEST_LIMIT) / grace).argmax())
    k = int(beyond[:, i].argmax())
    unit = "m" if robot.prismatic[i] else "rad"
    reach = f"its range [{robot.limits.lower[i]:.6g}, {robot.limits.upper[i]:.6g}] {unit}"
    if np.isinf((robot.limits.lower if P[k, i] < lower[i] else robot.limits.upper)[i]):
        reach = f"±{LARGEST_LIMIT:g} {unit}, the largest position that is computed with"
    words = f"{P[k, i]:.6g} {unit}, {excess[i]:.3g} {unit} outside {reach}"
    asked = ask_for_degrees(robot.limits, ~robot.prismatic, P)
    return f"target {k} of {robot.joint_names[i]} is {words}{': ' if asked else ''}{asked}"


def load_chunks(file: str | os.PathLike[str], robot: Robot, rate: float, *, columns: Names = None) -> list[Chunk]:
    """Read the chunks of a table with the columns observed, index, and the joints in the robot's order.

    Parameters
    ----------
    file : str or path
        A table with a header, such as ``observed,index,q1_deg,q2_deg,…``. Rows with the same time of observation are one
        chunk, in the order of their index.
    robot : Robot
        The arm.
    rate : float
        Targets per second [1/s].
    columns : str or sequence of str, optional
        Names of the columns of a file without a header, or new names.

    Returns
    -------
    list of Chunk
        By time of observation.

    Raises
    ------
    InvalidInput
        Missing or other columns, cells that are not numbers, a chunk with fewer than two targets.
    """
    joints = {f"q{i + 1}": "m" if slides else "rad" for i, slides in enumerate(robot.prismatic)}
    expected = f"columns observed,index,{','.join(joints)} (or q1_deg,… or the names of the joints)"
    table = read_table(file, columns)
    names = dict(zip(robot.joint_names, joints, strict=True))
    table = table._replace(columns={names.get(name, name): column for name, column in table.columns.items()})
    table = table.resolve(joints | {"observed": "s", "index": ""})
    table.refuse_others(["observed", "index", *joints], expected)
    if len(table.columns) != robot.n + 2:
        raise table.make_header_error(expected)
    observed, index = table.read_numbers(["observed"])[:, 0], table.read_numbers(["index"])[:, 0]
    q, chunks = table.read_numbers(list(joints)), []
    for t in np.unique(observed):
        rows = np.flatnonzero(observed == t)
        if rows.size < 2:
            raise InvalidInput(table.locate(int(rows[0])), f"one target observed at {t:g} s", "at least two")
        chunks.append(Chunk(q[rows[np.argsort(index[rows], kind="stable")]], rate, float(t)))
    return chunks
