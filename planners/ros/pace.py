"""The slowing of a motion until it respects the limits after controller interpolation, and the instants of its points."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from optik.errors import InvalidInput, NoSolution
from optik.scene.messages import NANOSECONDS
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.sections import conditions_of, cut_between, find_stops
from planners.limits import SAME_SPEED
from planners.motion import Motion
from planners.motion.fit import stretch_factor
from planners.paths.program import ProgramPath
from planners.ros.message import Form, Times, message_of, reconstruct
from planners.trajectory import Trajectory, append_rest, map_joints
from planners.trajectory.controller import POINTS, count_derivatives

SLOWINGS = 20
"""Largest number of slowings of a motion; two are usual."""
WHOLE_PERIOD = Fraction(1, 2 * NANOSECONDS)
"""Largest rounding error of a duration of whole periods [s]: 0.9 s is 90 periods of 100 per second, whatever its last bit."""
NEAR_KNOT = 0.1
"""Fraction of a period within which a point at a knot replaces that of the period: in shorter quintics rounding dominates."""
ADVICE = "use a motion within its own limits, points at its knots, or a higher rate"
"""Advice if the controller would exceed limits between the points."""


def fit_pace(motion: Motion, form: Form, rate: float | None, strict: bool) -> tuple[dict[str, Any], MotionAnalysis]:
    """Slow a motion until it respects the judged limits after controller interpolation."""
    source, judged = motion.trajectory, find_judged_limits(motion, form)
    between, stops = np.empty(0), np.empty(0)
    if motion.speed is not None and rate is not None:
        source, between = _hold_to_period(source, rate), source.knots
    if isinstance(motion.path, ProgramPath):  # the arm rests at its stops only if points are there
        found = find_stops(motion.path, source, motion.span)[:-1]
        stops = np.array([t for stop in found for t in (stop.rest, stop.end)])
        between = between if rate is None else np.union1d(between, stops)
    factor, margin = 1.0, 1e-12
    for _ in range(SLOWINGS):
        paced, times = _set_pace(source, rate, factor, between)
        rests = stops * (paced.duration / source.duration)
        message = message_of(paced, times, form, rests)
        executed = reconstruct(message, form.names)
        if form.motors is not None:
            executed = map_joints(executed, form.motors.matrix, form.motors.offset)
        analysis = MotionAnalysis(motion.robot, executed, motion.path)
        needed = _find_stretch(motion, analysis, judged, rests)
        if needed <= 1.0:
            return message, analysis
        _check_slowing(motion, executed.duration / source.duration * needed, strict)
        factor, margin = executed.duration / source.duration * needed * (1.0 + margin), 10.0 * margin
    reason = f"after controller interpolation the motion exceeds its limits even at {factor:.3g} times its duration"
    raise NoSolution(reason, advice=ADVICE)


def _find_stretch(motion: Motion, executed: MotionAnalysis, judged: tuple[str, ...], stops: Array) -> float:
    """Return the stretch with which an executed motion respects its limits: for a program, the largest of its sections."""
    path, trajectory = motion.path, executed.trajectory
    if not isinstance(path, ProgramPath):
        return stretch_factor(executed, motion.limits, judged)
    which = path.find_sections((0.0, path.end) if motion.span is None else motion.span)
    factors = [0.0]
    for i, begin, end in zip(which, [0.0, *stops[1::2]], [*stops[::2], trajectory.end], strict=True):
        limits, _ = conditions_of(path, i, motion.limits, None)
        own = MotionAnalysis(path.robots[i], cut_between(trajectory, begin, end), path.sections[i])
        factors.append(stretch_factor(own, limits, tuple(name for name in judged if name in limits.names)))
    return max(factors)


def find_judged_limits(motion: Motion, form: Form) -> tuple[str, ...]:
    """Return the enforced limits that the interpolation can respect."""
    possible = [kind.name for kind in motion.limits.kinds if kind.order <= count_derivatives(form.interpolation)]
    return tuple(field for field in motion.enforced if field in possible)


def at_rest(trajectory: Trajectory) -> tuple[bool, bool]:
    """Return whether a motion starts at rest, and whether it ends at rest."""
    slow = 1e-9 * float(trajectory.extrema(1).worst.max())
    start, end = (bool((np.abs(trajectory(t, 1)) <= slow).all()) for t in (0.0, trajectory.end))
    return start, end


def _hold_to_period(trajectory: Trajectory, rate: float) -> Trajectory:
    """Append rest to a motion, to the end of its last period."""
    periods = Fraction(trajectory.duration) * Fraction(rate)
    left = math.ceil(periods - WHOLE_PERIOD * Fraction(rate)) - periods
    return append_rest(trajectory, float(left / Fraction(rate))) if left > WHOLE_PERIOD * Fraction(rate) else trajectory


def _check_slowing(motion: Motion, needed: float, strict: bool) -> None:
    exceeds = "after controller interpolation the motion exceeds its limits"
    reason = f"{exceeds}; it would respect them at {needed:.9g} times its duration"
    if strict:
        raise NoSolution(reason, advice=f"pass strict=False, which slows it; or {ADVICE}")
    if motion.speed is not None and needed > 1.0 + SAME_SPEED:
        unit = "rad/s" if motion.path.turns_only else "m/s"
        left = f"with a tool speed of {motion.speed / needed:.6g} {unit} instead of {motion.speed:.6g} {unit}"
        advice = "use quintic interpolation, or pass keep_speed=False, which slows it"
        raise NoSolution(f"{reason}, {left}", advice=advice)
    if not at_rest(motion.trajectory)[0]:
        raise NoSolution(f"{reason}, but it starts in motion and cannot be slowed", advice=ADVICE)


def _set_pace(trajectory: Trajectory, rate: float | None, factor: float, between: Array) -> tuple[Trajectory, Times]:
    """Return the motion slowed by at least a factor to whole periods or whole nanoseconds, and the times of the points [ns]."""
    # Instants `between` the periods (k,) [s] are points too; they replace points at periods that are nearly there.
    duration = Fraction(trajectory.duration) * Fraction(factor)
    if rate is None:
        times = np.rint(trajectory.knots * factor * NANOSECONDS).astype(np.int64)
        times[-1] = math.ceil(duration * NANOSECONDS)
    else:
        periods = max(math.ceil((duration - WHOLE_PERIOD) * Fraction(rate)), 1)
        if periods > POINTS:
            raise InvalidInput("rate", f"{rate:.9g}, {periods} points", f"at most {POINTS} points")
        times = np.rint(np.arange(periods + 1) * NANOSECONDS / rate).astype(np.int64)
        if between.size:
            more = np.rint(between * (times[-1] / trajectory.duration)).astype(np.int64)
            near = np.abs(times[1:-1, None] - more).min(axis=1) < NEAR_KNOT * NANOSECONDS / rate
            times = np.unique(np.concatenate([times[:1], times[1:-1][~near], times[-1:], more]))
    if (np.diff(times) <= 0).any():
        i = int(np.argmax(np.diff(times) <= 0))
        got = f"{rate}, with points {i} and {i + 1} both at {times[i]} ns"
        raise InvalidInput("rate", got, "points at least 1 ns apart" + ("" if rate else ": give a rate"))
    stretched = float(Fraction(int(times[-1]), NANOSECONDS) / Fraction(trajectory.duration))
    return (trajectory if stretched == 1.0 else trajectory.slowed(stretched)), times
