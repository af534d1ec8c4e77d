"""The type of a problem set: targets, start configurations, and columns that describe each problem."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from optik import se3
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array

SETS = "benchmarks.problems"
"""Package in which problem sets are found by name."""


@dataclass(frozen=True)
class ProblemSet:
    """IK problems: targets, and the initial guesses `starts`.

    Attributes
    ----------
    targets : (k, 4, 4) array
        Target poses [1, m].
    starts : (k, n) array
        Start configurations [rad, m].
    group : (k,) array of str
        What reports group by: a plane, a stratum, a distance.
    known : (k,) array of bool
        Whether a configuration inside the limits is known to reach the target. A target without one may be unreachable;
        it is counted separately, never dropped.
    sigma : (k,) array
        Smallest singular value of the Jacobian at the known configuration [1], NaN where none is known.
    spread : (k,) array
        Standard deviation of start − solution [rad], NaN where the start is not drawn around a solution.
    unreachable : (k,) array of bool, optional
        Whether it is proved that no configuration reaches the target; by default none is.
    """

    targets: Array
    starts: Array
    group: NDArray[np.str_]
    known: NDArray[np.bool_]
    sigma: Array
    spread: Array
    unreachable: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.targets)

    @property
    def sha256(self) -> str:
        """SHA-256 of targets and starts: two runs with the same hash have solved the same problems."""
        return _digest(self.targets, self.starts)

    def chosen(self, most: int | None) -> NDArray[np.int64]:
        """Choose at most `most` problems: first those with a known solution, otherwise at random.

        A smaller choice is a subset of every larger one, so methods with different numbers of problems share the smallest.

        Parameters
        ----------
        most : int or None
            Largest number of problems; None for all.

        Returns
        -------
        (j,) array of int
            Indices of the problems, ascending.
        """
        if most is None or len(self) <= most:
            return np.arange(len(self))
        order = np.random.default_rng((len(self), 3)).permutation(len(self))
        return np.sort(order[np.argsort(~self.known[order], kind="stable")][:most])

    def frame(self, robot: Robot) -> pl.DataFrame:
        """Return a table with one row per problem: group, target, distance from the start, known solution.

        Parameters
        ----------
        robot : Robot
            The arm.

        Returns
        -------
        DataFrame
            Columns ``problem``, ``group``, ``x``, ``y``, ``z`` [m], ``distance`` [m] and ``turn`` [rad] between start
            and target, ``known``, ``unreachable``, ``sigma``, ``spread``, ``target`` (16 numbers) and ``start`` (n numbers).
        """
        first = robot.fk(self.starts)
        e = se3.error(first, self.targets)
        return pl.DataFrame(
            {
                "problem": np.arange(len(self)),
                "group": self.group.tolist(),
                "x": self.targets[:, 0, 3],
                "y": self.targets[:, 1, 3],
                "z": self.targets[:, 2, 3],
                "distance": np.linalg.norm(e[:, :3], axis=1),
                "turn": np.linalg.norm(e[:, 3:], axis=1),
                "known": self.known,
                "unreachable": np.zeros(len(self), dtype=bool) if self.unreachable is None else self.unreachable,
                "sigma": self.sigma,
                "spread": self.spread,
                "target": self.targets.reshape(-1, 16).tolist(),
                "start": self.starts.tolist(),
            }
        )


def sha256_of(problems: pl.DataFrame) -> str:
    """Return the hash of the problems in a table that `ProblemSet.frame` made, also after it was read from a file."""
    return _digest(*(np.array(problems[column].to_list(), dtype=float) for column in ("target", "start")))


def _digest(targets: Array, starts: Array) -> str:
    """Return the SHA-256 of k and n, targets (k, 16 or 4, 4) and starts (k, n) as little-endian doubles."""
    k, n = starts.shape
    content = hashlib.sha256(f"{k} problems, {n} joints\n".encode())
    for array in (targets, starts):
        content.update(np.ascontiguousarray(array, dtype="<f8").reshape(-1).data)  # no copy: sets may be large
    return content.hexdigest()


def start_of(robot: Robot, start_deg: ArrayLike) -> Array:
    """Return a start configuration in SI units, from the degrees and millimetres of a suite."""
    q = robot.configuration(start_deg, "start_deg") / unit_factors(robot)
    if not robot.limits.contains(q):
        raise InvalidInput("start_deg", start_deg, f"a configuration within the joint limits of {robot.name}")
    return q
