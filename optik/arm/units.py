"""Units in which joint values are shown and typed: degrees, and millimetres for prismatic joints."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array


def unit_factors(arm: Robot) -> Array:
    """Factors from the joints' units, rad and m, to the units that are shown."""
    return np.where(arm.prismatic, 1000.0, 180.0 / np.pi)


def unit_names(arm: Robot) -> list[str]:
    """Units in which the joints are shown."""
    return [" mm" if slides else "°" for slides in arm.prismatic]
