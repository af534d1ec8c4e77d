"""What a problem set is: targets, starts, and columns that say where each one stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from optik import se3
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.arm.units import per
from optik.errors import InvalidInput
from optik.registry import build_method
from optik.types import Array

SETS = "benchmarks.problems"


@dataclass(frozen=True)
class ProblemSet:
    """IK problems: reach `targets` (k, 4, 4) from `starts` (k, n).

    Attributes
    ----------
    group : (k,) array of str
        What reports group by: a plane, a stratum, a distance.
    known : (k,) array of bool
        Whether a configuration inside the limits is known for the target. Where not, the target may be out of reach: it
        is counted apart, never dropped.
    sigma : (k,) array
        Smallest singular value of the Jacobian at the known configuration, NaN where none is known.
    spread : (k,) array
        Standard deviation of start − solution [rad], NaN where the start is not drawn so.
    """

    targets: Array
    starts: Array
    group: NDArray[np.str_]
    known: NDArray[np.bool_]
    sigma: Array
    spread: Array

    def __len__(self) -> int:
        return len(self.targets)

    def chosen(self, most: int | None) -> NDArray[np.int64]:
        """Indices of at most so many problems, with a known solution first, else at random.

        A smaller choice is part of every larger one, so methods given different numbers share the smallest.
        """
        if most is None or len(self) <= most:
            return np.arange(len(self))
        order = np.random.default_rng((len(self), 3)).permutation(len(self))
        return np.sort(order[np.argsort(~self.known[order], kind="stable")][:most])

    def frame(self, robot: Robot) -> pl.DataFrame:
        """One row a problem: group, target position, distances from the start, what is known."""
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
                "sigma": self.sigma,
                "spread": self.spread,
                "target": self.targets.reshape(-1, 16).tolist(),
                "start": self.starts.tolist(),
            }
        )


class Draws(Protocol):
    """What names a problem set: a block of a suite."""

    @property
    def robot(self) -> str: ...  # noqa: D102

    @property
    def set(self) -> str: ...  # noqa: D102

    @property
    def options(self) -> dict[str, Any]: ...  # noqa: D102


def problem_set(block: Draws, seed: int) -> tuple[Robot, ProblemSet]:
    """Robot and problems of a block.

    Raises
    ------
    InvalidInput
        An option that the set does not have.
    """
    robot = load(block.robot)
    return robot, build_method(SETS, block.set, "problem set", robot, seed, **block.options)


def start_of(robot: Robot, start_deg: ArrayLike) -> Array:
    """The one start configuration (n,) of a set [rad, m], given in degrees, sliding joints in millimetres.

    Raises
    ------
    InvalidInput
        Wrong length or outside the limits.
    """
    q = robot.configuration(start_deg, "start_deg") / per(robot)
    if not robot.limits.contains(q):
        raise InvalidInput("start_deg", start_deg, f"a configuration inside the limits of {robot.name}")
    return q
