"""Units in which people read and type joints: degrees, and millimetres where a joint slides."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array


def per(arm: Robot) -> Array:
    """How many degrees are a radian, or millimetres a metre, joint by joint (n,)."""
    return np.where(arm.prismatic, 1000.0, 180.0 / np.pi)


def units(arm: Robot) -> list[str]:
    """Unit in which each joint is shown."""
    return [" mm" if slides else "°" for slides in arm.prismatic]
