"""Units of joint values in text: degrees, and millimetres for prismatic joints."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array


def unit_factors(arm: Robot) -> Array:
    """Return the factors (n,) from rad and m to the units in text."""
    return np.where(arm.prismatic, 1000.0, 180.0 / np.pi)


def unit_names(arm: Robot) -> list[str]:
    """Return the units of the joints in text."""
    return [" mm" if slides else "°" for slides in arm.prismatic]
