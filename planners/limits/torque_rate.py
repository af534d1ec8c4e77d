"""Greatest rate of the torque of every joint."""

from __future__ import annotations

from typing import ClassVar

from optik.arm.inertia import Load
from optik.types import Array
from planners.limits._motion import PathPoints
from planners.limits._torque import LoadedLimit, torque_rate_rows


class TorqueRate(LoadedLimit):
    """Greatest rate of the torque of every joint, without Coulomb friction, which jumps where a joint reverses."""

    name: ClassVar[str] = "torque_rate"
    units: ClassVar[tuple[str, str]] = ("N·m/s", "N/s")
    order: ClassVar[int] = 3
    rate: ClassVar[bool] = True
    columns: ClassVar[int] = 6

    def _rows_of(self, at: PathPoints, bound: Array, load: Load) -> Array:
        return torque_rate_rows(at, load) / bound[:, None]


METHOD = TorqueRate
