"""Chunk: joint targets at a fixed rate, as learned policies emit them."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.tables import Names, read_table
from optik.types import Array

FEWEST, MOST = 4, 1000
"""Points of a reference: a chunk with fewer is divided; and the largest number of a chunk."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Joint targets at a fixed rate, the first at the time of the observation.

    Parameters
    ----------
    points : (m, n) array
        Targets [rad, m], at least two.
    rate : float
        Targets per second [1/s].
    observed : float
        Time of the first target [s], on the clock of the running motion: the instant at which a policy observed the robot.

    Raises
    ------
    InvalidInput
        Points that are not finite or fewer than two, a rate that is not above 0, or a time that is not finite.
    """

    points: ArrayLike
    rate: float
    observed: float = 0.0

    def __post_init__(self) -> None:
        expected = f"an (m, n) array of 2 to {MOST} finite joint targets"
        points = real_array(self.points, "points", expected).copy()
        if points.ndim != 2 or not 2 <= len(points) <= MOST or not np.isfinite(points).all():
            raise InvalidInput("points", f"an array of shape {points.shape}", expected)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "rate", check_number(self.rate, "rate", "targets per second, above 0", above=0.0))
        object.__setattr__(self, "observed", check_number(self.observed, "observed", "a time [s]"))


def repair(chunk: Chunk, lower: Array, upper: Array) -> tuple[Array, float, int]:
    """Return the targets (m, n) inside the ranges, their rate [1/s], and the number of changed ones.

    A target that equals the one before in all joints, but not the next one, stands for a missing one. It becomes the mean of
    its neighbours.
    """
    given = np.asarray(chunk.points)
    P = np.clip(given, lower, upper)
    for i in np.flatnonzero((P[1:-1] == P[:-2]).all(axis=1) & (P[2:] != P[1:-1]).any(axis=1)):
        P[i + 1] = 0.5 * (P[i] + P[i + 2])
    changed, rate = int((given != P).any(axis=1).sum()), chunk.rate
    while len(P) < FEWEST:
        P, rate = np.insert(P, range(1, len(P)), 0.5 * (P[1:] + P[:-1]), axis=0), 2.0 * rate
    return P, rate, changed


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
