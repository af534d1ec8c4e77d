"""Plans slowed as a whole until the rms torque of a cycle, or every stop along the motion, is within a limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.inertia import Load
from optik.arm.limits import check_positive
from optik.arm.robot import Robot
from optik.check import check_number
from optik.dynamics import torques_batch
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.planning.result import Plan, Stopping
from planners.program.planner import ProgramPlan
from planners.replan.answer import replan
from planners.replan.state import s_at
from planners.trajectory import Trajectory

P = TypeVar("P", bound=Plan)
"""Type of a plan."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Nodes and weights of Gauss's quadrature on a piece: exact for the square of the torque's polynomials up to degree 11."""
SLOWEST = 1e3
"""Largest factor by which a motion is slowed: its dynamic torques are then a millionth."""
RMS_BISECTIONS = 50
"""Halvings of the interval of the factor."""
STEPS, CHECKED_STEPS = 100, 300
"""Instants of `Stopping`, and of stops that are checked against a limit: the way to the next one is added to each of these."""
FACTORS = np.append(1.01 ** np.arange(140), 2.0 ** np.arange(2, 10))
"""Factors of the duration that are tried in turn, because a stop is not monotone in the speed. Above 4 each one doubles."""


def stretch_to_ends(plan: P, rms_torque: ArrayLike | None, cycle: float | None, *stopping: float | None) -> P:
    """Return the plan slowed until it respects the limits of `Plan.slowed_to`; the last are stopping time and distance."""
    most = _check(plan, rms_torque, cycle, *stopping)
    first = 1.0 if most is None else _rms_factor(plan, most, cycle)
    if stopping == (None, None):
        return plan if first == 1.0 else replace(plan.stretched(first), stop_step=None)
    limits = np.array([np.inf if x is None else x for x in stopping])
    place = 0.5
    factors = first * FACTORS
    if most is not None and cycle is not None:  # the motion must end within the cycle
        factors = factors[factors * plan.duration <= cycle]
    for factor in factors:
        slower = plan.stretched(float(factor))
        step = slower.duration / CHECKED_STEPS
        reached, place = _find_longest_stops(slower, step, limits, place)
        if (reached <= limits).all() and (most is None or _rms_ratio(slower, most, 1.0, cycle) <= 1.0):
            return _store_step(slower, step)
    both = (plan.stretched(float(min(4.0 * first, factors[-1]))), slower)
    longest = [_find_longest_stops(x, x.duration / CHECKED_STEPS, np.full(2, np.inf), place)[0] for x in both]
    least = np.min(longest, axis=0)
    texts = f"a stopping time of {least[0]:.6g} s", f"a stopping distance of {least[1]:.6g} {plan.path.unit}"
    words = [text for text, limit in zip(texts, limits, strict=True) if limit < np.inf]
    longer = f"with durations of {both[0].duration:.6g} and {both[1].duration:.6g} s"
    reason = f"stretched by factors of up to {factors[-1]:.3g}, {longer}, the motion has {' and '.join(words)}"
    raise NoSolution(reason, advice="higher limits on stopping, or higher accelerations and jerks")


def _check(plan: Plan, rms_torque: ArrayLike | None, cycle: float | None, *stopping: float | None) -> Array | None:
    """Check the arguments; return the limits (n,) of the rms torques [N·m, N]."""
    if not plan:
        raise InvalidInput("plan", str(plan.status), "a plan with a valid motion")
    if plan.speed is not None or ", quiet " in plan.law or plan.start_error is not None or plan.span is not None:
        expected = "one from rest to rest whose law fixes no speed and no frequency"
        raise InvalidInput("plan", f"a motion of {plan.law}", expected)
    for name, value in zip(("cycle", "stopping_time", "stopping_distance"), (cycle, *stopping), strict=True):
        if value is not None:
            check_number(value, name, f"a {name.replace('_', ' ')} above 0", above=0.0)
    if rms_torque is None:
        if cycle is not None:
            raise InvalidInput("cycle", f"{cycle:g} s without rms_torque", "none: only the rms torque is of a cycle")
        if stopping == (None, None):
            raise InvalidInput("rms_torque", "None", "limits, or a stopping_time or a stopping_distance")
        return None
    if plan.robot.inertia is None:
        got = f"limits for {plan.robot.name}, whose masses are unknown"
        raise InvalidInput("rms_torque", got, "an arm with masses")
    if cycle is not None and cycle < plan.duration:
        raise InvalidInput("cycle", f"{cycle:.6g} s", f"at least the duration of {plan.duration:.6g} s")
    return check_positive(rms_torque, plan.robot.n, "rms_torque")


def _sections(plan: Plan) -> Sequence[Plan]:
    """Return the plans between two stops."""
    return plan.sections if isinstance(plan, ProgramPlan) else (plan,)


# ---------------------------------------------------------------- rms torque


def _rms_factor(plan: Plan, most: Array, cycle: float | None) -> float:
    """Return the least factor at which the rms torques are at most the limits."""
    if _rms_ratio(plan, most, 1.0, cycle) <= 1.0:
        return 1.0
    slowest = SLOWEST if cycle is None else cycle / plan.duration
    low = high = 1.0
    while _rms_ratio(plan, most, high, cycle) > 1.0:
        if high >= slowest:
            found = np.sqrt(_mean_squares(plan, high, cycle))
            i = int(np.argmax(found / most))
            raise NoSolution(
                f"the rms torque of {plan.robot.joint_names[i]} is {found[i]:.6g} at the slowest motion of the cycle, above "
                f"its limit of {most[i]:.6g}: gravity and friction alone need it",
                joint=plan.robot.joint_names[i], advice="a longer cycle, another path, a lighter payload, or a higher limit",
            )  # fmt: skip
        low, high = high, min(1.1 * high, slowest)
    for _ in range(RMS_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _rms_ratio(plan, most, middle, cycle) > 1.0 else (low, middle)
    return high


def _rms_ratio(plan: Plan, most: Array, factor: float, cycle: float | None) -> float:
    return float((np.sqrt(_mean_squares(plan, factor, cycle)) / most).max())


def _mean_squares(plan: Plan, factor: float, cycle: float | None) -> Array:
    """Return the mean squares (n,) of the torques of a motion slowed by a factor, over a cycle; of the worst load."""
    sections, waits = _sections(plan), plan.waits if isinstance(plan, ProgramPlan) else (0.0, 0.0)
    held = [(sections[0], 0.0, waits[0])]
    held += [(x, x.trajectory.end, wait) for x, wait in zip(sections, waits[1:], strict=True)]
    time = sum(waits) + factor * sum(section.duration for section in sections)
    if cycle is not None:
        held.append((sections[-1], sections[-1].trajectory.end, max(cycle - time, 0.0)))
    totals: dict[Robot, Array] = {}  # an arm has the same load in all its sections
    for section in sections:
        found = [_integrate(section.robot, load, section.trajectory, factor) for load in section.robot.loads]
        totals[section.robot] = totals.get(section.robot, 0.0) + np.array(found)
    for section, at, wait in held:
        still = np.stack([section.trajectory(at), np.zeros(plan.robot.n), np.zeros(plan.robot.n)])[:, None]
        found = [_torques(section.robot, load, *still)[0] ** 2 for load in section.robot.loads]
        totals[section.robot] = totals[section.robot] + wait * np.array(found)
    return np.asarray(sum(total.max(axis=0) for total in totals.values()) / max(time, cycle or 0.0))


def _integrate(robot: Robot, load: Load, motion: Trajectory, factor: float) -> Array:
    """Return the integrals (n,) of the squares of the torques over a motion slowed by a factor."""
    states, t = MotionAnalysis(robot, motion).states(0.5 + 0.5 * NODES)
    q, v, a = (states[:, :, i].reshape(t.size, -1) for i in range(3))
    squares = _torques(robot, load, q, v / factor, a / factor**2).reshape(*t.shape, -1) ** 2
    return np.asarray(0.5 * factor * np.einsum("mkn,k,m->n", squares, WEIGHTS, np.diff(motion.knots)))


def _torques(robot: Robot, load: Load, q: Array, v: Array, a: Array) -> Array:
    """Return the torques (k, n) of states, with friction."""
    out = np.empty((len(q), 2, robot.n))
    torques_batch(robot.chain, load.bodies, load.viscous, np.stack([q, v, a, 0.0 * q], axis=1), out)
    return out[:, 0] + load.coulomb * np.sign(v)


# ---------------------------------------------------------------- stops


def find_stops(plan: Plan, step: float | None = None) -> Stopping:
    """Return the certified stops from instants of a motion."""
    step = plan.duration / STEPS if step is None else step
    t = np.asarray(step * np.arange(1, int(np.ceil(plan.duration / step))), dtype=np.float64)
    stops = [_stop(plan, float(at)) for at in t]
    return Stopping(t, np.array([one[0] for one in stops]), np.array([one[2] - one[1] for one in stops]))


def _stop(plan: Plan, t: float) -> tuple[float, float, float]:
    """Return the duration of the stop from a time, and the path parameters at its begin and end; 0 where the arm rests."""
    try:
        stop = replan(plan, t, stop=True, time_limit=0.0)
    except InvalidInput:
        return 0.0, 0.0, 0.0
    if not stop or stop.span is None:
        return np.inf, 0.0, np.inf
    return stop.times[0].rest if isinstance(stop, ProgramPlan) else stop.duration, *stop.span


def _find_longest_stops(plan: Plan, step: float, limits: Array, place: float) -> tuple[Array, float]:
    """Return the greatest time and way of the stops from instants, each with the way from the instant before, and their place.

    The instants nearest to `place`, a fraction of all, are tried first, and none after one that exceeds a limit.
    """
    sections, worst = _sections(plan), np.zeros(2)
    instants = [(x, step * i) for x in sections for i in range(1, int(np.ceil(x.duration / step)))]
    for k in np.argsort(np.abs(np.arange(len(instants)) / len(instants) - place)):
        section, t = instants[k]
        time, _, end = _stop(section, t)
        if time > 0.0:
            worst = np.maximum(worst, (time + step, end - s_at(section, t - step)))
        if (worst > limits).any():
            return worst, float(k / len(instants))
    return worst, place


def _store_step(plan: P, step: float) -> P:
    """Return the plan with the time between the instants whose stops were checked, which `replan` reads."""
    if isinstance(plan, ProgramPlan):
        return replace(plan, stop_step=step, sections=tuple(replace(x, stop_step=step) for x in plan.sections))
    return replace(plan, stop_step=step)
