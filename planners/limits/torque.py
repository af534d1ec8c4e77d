"""Greatest torque of every joint."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik.arm.inertia import Load
from optik.types import Array
from planners.limits._motion import PathPoints
from planners.limits._sides import sides
from planners.limits._torque import LoadedLimit, torque_rows

STANDING_SHARE = 1e-9
"""Fraction of the largest |q'| of all joints below which a joint is at rest: it is rounding error of the path."""


class Torque(LoadedLimit):
    """Greatest torque of every joint, friction included.

    Coulomb friction is f sign(q̇). Where a joint rests or reverses, it is the least favourable value in [−f, f].
    """

    name: ClassVar[str] = "torque"
    units: ClassVar[tuple[str, str]] = ("N·m", "N")
    order: ClassVar[int] = 2
    sided: ClassVar[bool] = True
    rate: ClassVar[bool] = False
    columns: ClassVar[int] = 4

    def _rows_of(self, at: PathPoints, bound: Array, load: Load) -> Array:
        lower, upper = sides(bound)
        free = ~np.isfinite(upper - lower)
        lower, upper = np.where(free, -1.0, lower), np.where(free, 1.0, upper)
        sign, still = _senses(at)
        rows = torque_rows(at, load).copy()
        rows[:, :, 3] += load.coulomb * sign - 0.5 * (lower + upper)
        half = 0.5 * (upper - lower) - load.coulomb * still
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # friction alone may exceed the limit: then no motion respects it
            return np.where(free[:, None], 0.0, rows / np.maximum(half, 0.0)[:, :, None])


def _senses(at: PathPoints) -> tuple[Array, Array]:
    """Return the sign (k, n) of each joint's motion along the path, 0 where it rests or reverses; and 1 there, else 0.

    All joints rest at both ends of the path. A joint counts as reversing at both of two adjacent points if its sign changes
    between them.
    """
    q1 = at.q(1)
    sign = np.where(np.abs(q1) > STANDING_SHARE * np.abs(q1).max(initial=0.0), np.sign(q1), 0.0)
    turning = sign[1:] * sign[:-1] < 0.0
    turning &= (np.diff(at.s) > 0.0)[:, None]
    still = sign == 0.0
    still[1:] |= turning
    still[:-1] |= turning
    still |= ((at.s <= 0.0) | (at.s >= at.joint_path.end))[:, None]
    return np.where(still, 0.0, sign), still.astype(np.float64)


METHOD = Torque
