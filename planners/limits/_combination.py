"""Limits on linear combinations of joints, such as those of motors that move several axes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from optik.arm.limits import check_positive
from optik.arm.robot import Robot
from optik.check import check_words, finite_array, real_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits.inputs import Extreme, LimitedMotion, PathPoints
from planners.limits.record import Record, RecordLimit
from planners.trajectory import Trajectory, map_joints
from planners.trajectory.curve import chain_rows

Rows = tuple[tuple[float, ...], ...]
"""Rows of a matrix."""


@dataclass(frozen=True)
class Combination(Record):
    """Bounds on linear combinations of the joints, |matrix @ value| ≤ bound.

    Parameters
    ----------
    matrix : (k, n) tuple of tuples
        One row for each combination [1].
    bound : (k,) tuple of float
        Greatest absolute values [as the limit's units]; infinite where free.
    names : (k,) tuple of str, optional
        Names of the combinations; by default combination1 and so on.
    """

    matrix: Rows = field(metadata={"unit": "1"})
    bound: tuple[float, ...] = field(metadata={"unit": ""})
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        expected = "rows of one finite number for each joint"
        rows = finite_array(self.matrix, "combination.matrix", expected)
        if rows.ndim != 2:
            raise InvalidInput("combination.matrix", repr(self.matrix)[:60], expected)
        bound = real_array(self.bound, "combination.bound", "a number above 0 for each row")
        bound = check_positive(np.atleast_1d(bound), len(rows), "combination.bound")
        names = check_words(self.names, "combination.names") or tuple(f"combination{i + 1}" for i in range(len(rows)))
        if len(names) != len(rows):
            raise InvalidInput("combination.names", ", ".join(names), f"{len(rows)} names")
        object.__setattr__(self, "matrix", tuple(map(tuple, rows.tolist())))
        object.__setattr__(self, "bound", tuple(bound.tolist()))
        object.__setattr__(self, "names", names)


class CombinationLimit(RecordLimit):
    """|E q⁽ᵏ⁾| ≤ b: the rows are those of a derivative, times E, and E q(t) is a polynomial again with exact extrema."""

    subject: ClassVar[str | None] = None
    record: ClassVar[Any] = Combination

    def subjects(self, robot: Robot, limit: Any = None) -> tuple[str, ...]:
        """Return the names of the combinations."""
        return robot.joint_names if limit is None else limit.names

    def check_robot(self, robot: Robot, limit: Combination) -> None:
        """Raise InvalidInput for a matrix of another number of joints."""
        if len(limit.matrix[0]) != robot.n:
            raise InvalidInput(
                self.name, f"rows of {len(limit.matrix[0])} numbers", f"the {robot.n} joints of {robot.name}"
            )

    def rows(self, at: PathPoints, limit: Combination) -> Array:
        """Return the rows at points of a joint path."""
        E = np.array(limit.matrix)
        rows = chain_rows([at.q(order) @ E.T for order in range(1, self.order + 1)])
        return np.asarray(rows / np.array(limit.bound)[:, None])

    @staticmethod
    def _map(motion: LimitedMotion, limit: Combination) -> Trajectory:
        """Return the motion of the combinations."""
        return map_joints(motion.trajectory, np.array(limit.matrix))

    def piece_ratios(self, motion: LimitedMotion, limit: Combination) -> Array:
        """Return the ratios on each piece of a motion."""
        return np.asarray(self._map(motion, limit).piece_worst(self.order) / np.array(limit.bound))

    def judge(self, motion: LimitedMotion, limit: Combination) -> Extreme:
        """Return the exact peak values, their ratios and their times."""
        found, limits = self._map(motion, limit).extrema(self.order), np.array(limit.bound)
        ratio = np.where(np.isfinite(limits), found.worst / limits, np.nan)
        if motion.jumps[: self.order].any():
            ratio = np.where(np.isfinite(limits), np.inf, np.nan)
        return Extreme(found.worst, ratio, found.t_worst)

    def scaled(self, value: Combination, factor: float) -> Combination:
        """Return the record with its limits multiplied by a factor."""
        return replace(value, bound=tuple(factor * x for x in value.bound))
