"""The free motion of an arm with more joints than a pose asks for: chosen along the path, then followed exactly."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optik.robot import Robot
from planners._track import Guide
from planners.paths.base import Path

Array = NDArray[np.float64]


def guides(robot: Robot, path: Path, q: Array | None, branch: str) -> Iterator[tuple[Array, Guide]]:
    """Free motions to try, best first."""
    yield from ()
