"""Which of the robots that come with optik a test is run for, and robots made of the oracles' tables."""

from typing import Any

import numpy as np
import pytest

import optik
from optik import DHRow, JointLimits, Robot

USUAL = ("irb910sc", "panda", "paper6r", "ur5e")
"""Robots of the default run: one that slides, one with a joint to spare, a spherical wrist and none; make soak has all."""


BOUNDED = [name for name in optik.robots() if np.isfinite(optik.load(name).limits.half).all()]
"""Robots whose joints all have two limits."""


def marked(arm: str, case: Any) -> Any:
    """A case of an arm, of the default run if the arm is."""
    return case if arm in USUAL else pytest.param(case, marks=pytest.mark.soak)


each_robot = pytest.mark.parametrize("name", [marked(name, name) for name in optik.robots()])
"""All robots, by ``name``."""


def built(arm: Any, **options: Any) -> Robot:
    """The arm of an oracle's table as ours; its joints range over ±3 where the table has no limits."""
    rows = [DHRow(r.a, r.alpha, r.d, r.theta, r.prismatic) for r in arm.rows]
    build = Robot.from_mdh if arm.convention == "mdh" else Robot.from_dh
    limits = JointLimits(
        *((np.full(arm.n, -3.0), np.full(arm.n, 3.0)) if arm.lower is None else (arm.lower, arm.upper))
    )
    return build(rows, limits, base=arm.base, tool=arm.tool, **options)
