"""Set-points: the states of a motion at every tick of a servo, and its number of periods."""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import NamedTuple

import numpy as np
import scipy

from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array
from planners.following.follow import PlanFailure
from planners.motion import Motion
from planners.plan import Plan, PlanStatus
from planners.trajectory import Trajectory
from planners.trajectory.controller import SAME_INSTANT, sample_states

PERIOD = 0.004
"""Default servo period [s]: 250 set-points per second, as for many controllers of arms."""

MOST_PERIODS = 500_000
"""Largest number of periods of a motion: half an hour at 4 ms, for which a simulated arm stores half a gigabyte."""


class Setpoints(NamedTuple):
    """The set-points of a motion: row k is its state at k periods, the last row its end.

    Attributes
    ----------
    period : float
        Servo period [s].
    t : (k,) array
        Times of the ticks, from 0 to the first tick that is not before the motion's end [s].
    q, dq, ddq : (k, n) arrays
        Positions [rad, m], velocities [rad/s, m/s] and accelerations [rad/s², m/s²].
    """

    period: float
    t: Array
    q: Array
    dq: Array
    ddq: Array


def fit_periods(plan: Plan, period: float = PERIOD) -> Plan:
    """Slow a plan uniformly to a whole number of the servo's periods, and certify it again.

    Its last set-point is then exactly its end. A plan with constant tool speed or a moving start is not stretched. Its last
    set-point is held to the end of the period.

    Parameters
    ----------
    plan : Plan
        A plan with a motion.
    period : float
        Servo period [s].

    Returns
    -------
    Plan
        The plan with a duration of n · period; the factor is `Plan.slowed`.

    Raises
    ------
    NoSolution
        A plan without a motion.
    InvalidInput
        A period that is not above 0, or longer than the motion.
    """
    motion, proof = plan.trajectory, plan.certificate
    duration = count_periods(motion, period) * period
    if plan.speed is not None or not proof.rest[0] or motion.end == duration:
        return plan
    return slow_to(plan, duration)


def slow_to(plan: Plan, duration: float) -> Plan:
    """Return a plan that begins at rest, slowed uniformly to a duration and certified again."""
    motion, proof = plan.trajectory, plan.certificate
    stretched = motion.slowed(max(duration / motion.duration, 1.0))  # the last piece is shortened by the rounding error
    knots = stretched.knots.copy()
    knots[-1] = duration
    moved = replace(plan.motion, trajectory=Trajectory(scipy.interpolate.PPoly(stretched.coefficients, knots)))
    again = moved.certify(rate=proof.rate)
    slower = replace(
        plan, _trajectory=moved.trajectory, _certificate=again, slowed=plan.slowed * duration / motion.duration
    )
    if not plan or again.is_valid:
        return slower
    why = f"the certificate of the motion slowed to {duration:.9g} s is not valid: {'; '.join(again.reasons)}"
    failure = PlanFailure(PlanStatus.NOT_PROVED, plan.joint_path.end, None, why, "another period")
    return replace(slower, status=PlanStatus.NOT_PROVED, failure=failure)


def make_setpoints(motion: Trajectory | Motion | Plan, period: float = PERIOD) -> Setpoints:
    """Return the set-points of a motion: row k is its state at k periods, or at its end.

    Parameters
    ----------
    motion : Trajectory, Motion or Plan
        The executed motion.
    period : float
        Servo period [s].

    Returns
    -------
    Setpoints
        At t = 0, period, … up to the first tick that is not before the motion's end. At a jump of the acceleration, the
        mean of both sides.

    Raises
    ------
    NoSolution
        A plan without a motion.
    InvalidInput
        A period that is not above 0, or longer than the motion.
    """
    trajectory = motion if isinstance(motion, Trajectory) else motion.trajectory
    t: Array = np.arange(count_periods(trajectory, period) + 1, dtype=np.float64) * period
    return Setpoints(period, t, *sample_states(trajectory, np.minimum(t, trajectory.end)))


def count_periods(motion: Trajectory, period: float) -> int:
    """Return the number of periods of a motion; a nanosecond more than a whole number is rounding."""
    period = check_number(period, "period", "seconds above 0", above=0.0)
    if motion.end < period - SAME_INSTANT:
        raise InvalidInput("period", f"{period:.6g} s", f"at most the duration of the motion, {motion.end:.6g} s")
    if motion.end > MOST_PERIODS * period:
        came = f"{period:.6g} s, for a motion of {motion.end:.6g} s"
        raise InvalidInput("period", came, f"at most {MOST_PERIODS:,} periods: a longer period, or higher limits")
    return max(ceil((motion.end - SAME_INSTANT) / period), 1)
