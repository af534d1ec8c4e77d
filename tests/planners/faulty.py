"""Simulated drives that go wrong on purpose: blocked joints, and lost or frozen encoders."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from optik.types import Array, Flags
from planners.cell import IdealDrive, MujocoDrive
from planners.cell.drives._simulated import SimulatedDrive


@dataclass(frozen=True)
class Stall:
    """A blocked joint, from one time of the drive's clock to another [s]."""

    joint: str | int
    at: float
    until: float = inf


@dataclass(frozen=True)
class LostEncoder:
    """An encoder that reads NaN, or, if it is frozen, repeats its last reading."""

    joint: str | int
    at: float
    until: float = inf
    frozen: bool = False


class Faulty(SimulatedDrive):
    """A plant with faults; to be named before it in the bases of a class."""

    def __init__(self, *given: Any, faults: tuple[Stall | LostEncoder, ...] = (), **options: Any) -> None:
        self._faults, self._last = faults, dict[int, float]()
        super().__init__(*given, **options)

    def _present(self, kind: type) -> list[tuple[int, Any]]:
        names = self.robot.joint_names
        return [
            (names.index(one.joint) if isinstance(one.joint, str) else one.joint, one)
            for one in self._faults
            if isinstance(one, kind) and one.at <= self.clock < one.until
        ]

    def _find_blocked(self) -> Flags:
        blocked = super()._find_blocked()
        for joint, _ in self._present(Stall):
            blocked[joint] = True
        return blocked

    def _misread(self, read: Array) -> Array:
        read = read.copy()
        for joint, one in self._present(LostEncoder):
            read[joint] = self._last.setdefault(joint, float(read[joint])) if one.frozen else np.nan
        return read


class FaultyIdeal(Faulty, IdealDrive):
    """The ideal drive with faults."""


class FaultyMujoco(Faulty, MujocoDrive):
    """The drive with motors and a simulated arm, with faults."""
