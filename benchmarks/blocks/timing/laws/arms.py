"""The configurations in which the motors of an arm can hold it at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from optik.arm.robot import Robot
from optik.dynamics import torques_batch
from optik.types import Array, Flags
from planners.limits import sides

if TYPE_CHECKING:
    from benchmarks.blocks.timing.laws.sets import LimitSet

STATIC_SHARE = 0.95
"""Largest share of a torque limit that gravity and Coulomb friction may take at rest: at all of it no motion could start. The
rest also covers what lies between the steps of a track, and the other configurations that a redundant arm may take."""

Stands = Callable[[Array], Flags]
"""From configurations (k, n) to whether the motors can hold the arm there."""


def stands_of(arm: Robot, limits: Sequence[LimitSet]) -> Stands | None:
    """Where an arm can stand still: gravity and Coulomb friction take at most `STATIC_SHARE` of every torque limit."""
    bounds = [sides(part.of(arm).bounds(arm.n)["torque"]) for part in limits if part.counts_torque]
    if not bounds:
        return None
    lower = STATIC_SHARE * np.max([bound[0] for bound in bounds], axis=0)
    upper = STATIC_SHARE * np.min([bound[1] for bound in bounds], axis=0)
    loads = arm.loads

    def stands(q: Array) -> Flags:
        states = np.zeros((len(q), 4, arm.n))
        states[:, 0] = q
        torque, found = np.empty((len(q), 2, arm.n)), np.ones(len(q), dtype=bool)
        for load_ in loads:
            torques_batch(arm.chain, load_.bodies, load_.viscous, states, torque)
            still, friction = torque[:, 0], load_.coulomb
            found &= ((still - friction >= lower) & (still + friction <= upper)).all(axis=1)
        return found

    return stands
