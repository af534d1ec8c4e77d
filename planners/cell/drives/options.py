"""Options of all simulated drives, checked and by joint."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_count, check_flag, check_number, real_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives.setpoints import PERIOD

ENCODER = 2.0**20
"""Default counts per turn of an encoder: the 20 bits of common absolute encoders behind the gear."""
SCALE = 1e-6
"""Default resolution of a prismatic joint's encoder [m]: that of a linear scale."""
FOLLOWING = (0.05, 0.005)
"""Default of the largest difference of set-point and reading [rad, m]: far above the lag of a working servo, far below the
error of a blocked joint after a quarter of a second."""
START_AWAY = (1e-3, 1e-4)
"""Default tolerance on the start of a plan [rad, m]. A servo without integral action has this error under gravity."""
END_AWAY = (5e-3, 5e-4)
"""Default of the largest difference of set-point and reading at rest [rad, m]: several times the error of a servo without
integral action under gravity."""
HELD_AHEAD = 10
"""Default number of set-points that are sent ahead: 40 ms at 4 ms, more than the usual delays of an operating system without
real-time scheduling."""


class Options(NamedTuple):
    """The options of a simulated drive; arrays (n,) are by joint [rad, m]."""

    period: float  # of the servo [s]
    ahead: int  # number of set-points that the drive has beyond the present one
    hold: bool  # whether set-points are held for a period instead of interpolated
    resolution: Array  # of the encoders; 0 for an exact one
    noise: float  # standard deviation of the readings [rad, m]
    following: Array  # largest difference of set-point and reading during the motion
    start: Array  # largest difference of reading and a plan's start
    end: Array  # largest difference of set-point and reading at rest
    pace: float | None  # seconds of the motion per second of real time [1]; None for as fast as possible


def make_options(
    robot: Robot, *, period: float = PERIOD, ahead: int = HELD_AHEAD, hold: bool = False,
    encoder: float | ArrayLike = ENCODER, encoder_noise: float = 0.0,
    following: ArrayLike | None = None, start_tolerance: ArrayLike | None = None,
    end_tolerance: ArrayLike | None = None, pace: float | None = None,
) -> Options:  # fmt: skip
    """Return the checked options of a simulated drive."""
    period = check_number(period, "period", "seconds above 0", above=0.0)
    check_count(ahead, "ahead", 1)
    noise = check_number(encoder_noise, "encoder_noise", "a standard deviation, at least 0", least=0.0)
    if pace is not None:
        pace = check_number(pace, "pace", "a number above 0, or None", above=0.0)
    return Options(
        period, ahead, check_flag(hold, "hold"), _resolution(robot, encoder), noise,
        _by_joint(robot, following, FOLLOWING, "following"),
        _by_joint(robot, start_tolerance, START_AWAY, "start_tolerance"),
        _by_joint(robot, end_tolerance, END_AWAY, "end_tolerance"),
        pace,
    )  # fmt: skip


def _by_joint(robot: Robot, value: ArrayLike | None, default: tuple[float, float], argument: str) -> Array:
    """Return one number above 0 for each joint [rad, m]."""
    if value is None:
        return np.where(robot.prismatic, default[1], default[0])
    return np.broadcast_to(check_positive(robot, value, argument, "a number above 0"), (robot.n,)).copy()


def check_positive(robot: Robot, value: ArrayLike, argument: str, wanted: str) -> Array:
    """Return a number above 0, or one for each joint, as an array () or (n,)."""
    wanted = f"{wanted}, or {robot.n} of them"
    array = real_array(value, argument, wanted)
    if array.shape not in ((), (robot.n,)) or not (array > 0.0).all():
        raise InvalidInput(argument, repr(value)[:60], wanted)
    return array


def _resolution(robot: Robot, encoder: ArrayLike) -> Array:
    """Return the resolution of each encoder [rad, m]."""
    array = check_positive(robot, encoder, "encoder", "a number of counts per turn above 0")
    turn = 2.0 * pi / array
    if array.shape == ():
        return np.where(robot.prismatic, SCALE if np.isfinite(array) else 0.0, turn)
    return np.where(robot.prismatic, np.where(np.isfinite(array), array, 0.0), turn)
