"""Motions for the tests of files, and whether two of them are equal to the last bit."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from optik.errors import InvalidInput
from planners import MotionLimits, Plan, Trajectory, load_motion, plan, save
from planners.certificate.violation import ALLOWANCES
from planners.limits import ALL_LIMITS
from planners.motion import Motion
from tests.planners import cases
from tests.planners.cases import START, default_line, paper6r


@cache
def planned(law: str = "ruckig") -> Plan:
    return plan(paper6r(), default_line(), START, timing=law)


@cache
def small() -> Motion:
    """Two pieces near the default start."""
    base = cases.random_trajectory(np.random.default_rng(4), pieces=2, n=6, smooth=2)
    c = 0.02 * base.coefficients
    c[5] += START
    return Motion(paper6r(), default_line(), MotionLimits(2.0, jerk=[9.0] * 6), Trajectory(PPoly(c, base.knots)))


def write(motion: Motion, file: Path, **options: Any) -> None:
    """Write a motion whatever it violates: files are tested with random ones."""
    save(motion, file, allow=ALLOWANCES, **options)


def same_bits(a: Any, b: Any) -> bool:
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def is_same(a: Motion, b: Motion) -> bool:
    """Whether nothing of two motions differs, to the last bit."""
    limits = all(
        (getattr(a.limits, f) is None) == (getattr(b.limits, f) is None)
        and (getattr(a.limits, f) is None or same_bits(getattr(a.limits, f), getattr(b.limits, f)))
        for f in ALL_LIMITS
    )
    return (
        limits
        and a.robot == b.robot
        and a.robot.source == b.robot.source
        and (a.law, a.enforced, a.tolerance) == (b.law, b.enforced, b.tolerance)
        and same_bits(a.trajectory.knots, b.trajectory.knots)
        and same_bits(a.trajectory.coefficients, b.trajectory.coefficients)
        and type(a.path) is type(b.path)
        and a.path.to_dict() == b.path.to_dict()
        and same_bits(a.path.end, b.path.end)
    )


def readable_or_refused(file: Path, content: bytes) -> bool:
    """Whether damaged bytes are refused by name; what is read all the same must be the motion."""
    file.write_bytes(content)
    try:
        back = load_motion(file)
    except InvalidInput as error:
        assert str(file) in str(error)
        return True
    assert is_same(back, small())
    return False
