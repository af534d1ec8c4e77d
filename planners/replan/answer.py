"""replan(): a motion from a moving state to the end of a plan's or a program's path, or to rest on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_kind, check_number
from optik.errors import InvalidInput, NoSolution
from optik.ik.base import Tolerance, ToleranceLike
from optik.scene import Scene
from optik.types import Array
from planners.certificate.certification import SectionTimes, conditions_of, cut_between
from planners.following.branches import CollisionCheck
from planners.following.follow import DEFAULT_TOLERANCE
from planners.following.joint_path import find_nearest_s
from planners.limits import TOOL_SPEEDS, MotionLimits
from planners.paths.free_path import FreePath
from planners.paths.point_to_point import PointToPoint
from planners.paths.program import ProgramPath
from planners.plan import Plan, PlanStatus, plan
from planners.program.events import Scheduled, TimedEvent
from planners.program.planner import ProgramPlan, build_plan
from planners.replan.state import (
    BEFORE_END,
    build_moving_state,
    build_request,
    check_measured,
    find_nearest_time,
    keep_speed,
)
from planners.replan.stop import plan_onward, plan_stop
from planners.timing import LawLike
from planners.timing.base import read_law
from planners.trajectory import Trajectory

# ---------------- replanning of a program


OFF_MOTION = 1e-4
"""Distance of a measured configuration [rad, m] from the motion beyond which its section is the nearest one in space."""
AT_END = 1e-9
"""Fraction of a section's path from its end that counts as its end."""


def replan_program(
    running: ProgramPlan, state: Any, one: Callable[..., Plan], changed: dict[str, Any], stop: bool
) -> Plan:
    """Return the motion of a program from a moving state; `one` replans a section, `changed` are the given arguments."""
    measured, motion, path = isinstance(state, tuple | list), running.trajectory, running.path
    assert isinstance(path, ProgramPath)
    times = running.times
    if measured:
        t = _begin_of_wait(times, find_nearest_time(motion, check_measured(running, state)))
    else:
        t = check_number(state, "state", "a time [s]", least=0.0)
    k = max(int(np.searchsorted([each.begin for each in times], t, side="right")) - 1, 0)
    if measured and np.abs(motion(t) - state[0]).max() > OFF_MOTION:  # at rest, where the motion does not stop
        k, t = _find_nearest_section(running, np.asarray(state[0]))
    i, sections = running.moving_sections[k], list(running.sections)
    waiting = t < times[k].begin  # the first section
    section, left = _as_running(running, i, times[k]), (times[k].begin if waiting else times[k].end) - t
    whole = section.span is None or section.span[1] >= section.path.end * (1.0 - AT_END)
    onward = range(i if waiting else i + 1, len(sections))
    limits = running.limits if changed["limits"] is None else _merge_limits(running, changed["limits"])
    scene = changed["scene"] or running.scene
    conditions = [
        dict(zip(("limits", "scene"), conditions_of(path, j, limits, scene), strict=True)) for j in range(len(sections))
    ]
    if t > times[-1].end or (whole and not onward and t >= times[k].rest):
        _refuse_end(t, times[k])
    if waiting or (whole and onward and t >= times[k].rest - BEFORE_END):
        if stop:
            got = f"a state at rest, at t = {t:.6g} s"
            raise InvalidInput("state", got, "a moving state; this one has already stopped")
        covered = onward
    else:
        current = {key: options for key, options in conditions[i].items() if changed[key] is not None}
        sections[i] = one(section, state if measured else t - times[k].begin, **changed | current)
        if not sections[i]:
            return _name_part(running, i, sections[i])
        covered, left = range(i, i + 1) if stop else range(i, len(sections)), 0.0
    if not stop:
        for j in onward:
            options = changed | conditions[j]
            if changed["timing"] is None and conditions[j] == {key: getattr(sections[j], key) for key in conditions[j]}:
                continue  # after a stop, sections may have older limits
            chosen = isinstance(sections[j].path, FreePath | PointToPoint)  # a plan would choose another shape
            sections[j] = one(sections[j], 0.0, **options) if chosen else _plan_again(sections[j], options)
            if not sections[j]:
                return _name_part(running, j, sections[j])
    span = covered, max(left, 0.0)
    plan = build_plan(sections, running.waits, running.parts, running.corners, limits, scene, span)
    return replace(plan, scheduled=tuple(_list_ahead(running, t)), period=running.period)


def _begin_of_wait(times: Sequence[SectionTimes], t: float) -> float:
    """Return when a wait begins for a time in it: a measured state does not tell how much is over, so that all is kept."""
    waits = [(0.0, times[0].begin), *((each.rest, each.end) for each in times[:-1])]
    inside = [a for a, b in waits if a < b and a - BEFORE_END <= t <= b + BEFORE_END]
    return inside[0] if inside else t


def _name_part(running: ProgramPlan, i: int, failed: Plan) -> Plan:
    """Return the failed plan of a section as one of the part in which it failed."""
    why, path = failed.failure, running.path
    if why is None or not running.parts:
        return failed
    assert isinstance(path, ProgramPath)
    at, own = path.starts[i] + why.s, [k for k, part in enumerate(running.parts) if part.section == i]
    k = next((k for k in own if at <= running.parts[k].end), own[-1])
    part = running.parts[k]
    s = float(np.clip((at - part.begin) / (part.end - part.begin), 0.0, 1.0)) * part.path.end
    reason = f"part {k + 1}{f' {part.name!r}' if part.name else ''}: {why.reason}"
    return replace(failed, path=part.path, failure=replace(why, s=s, reason=reason, part=k))


def _list_ahead(running: ProgramPlan, t: float) -> Iterator[Scheduled]:
    """Yield the events that may still occur after a time [s]; delayed events whose place is passed get a time."""
    for one in running.scheduled:
        timed = isinstance(one, TimedEvent) or getattr(one, "after", 0.0) > 0.0
        events = replace(running, scheduled=(one,), period=None).events if timed else ()
        passed = [e for e in events if e.s is None or e.t + e.before < t]
        yield from (TimedEvent(e.t - t, e.signal, e.value) for e in passed if e.t >= t)
        if not passed:
            yield one


def _find_nearest_section(running: ProgramPlan, q: Array) -> tuple[int, float]:
    """Return the number of the covered section whose joint path is nearest to a configuration, and when it begins."""
    paths = [running.sections[i].joint_path for i in running.moving_sections]
    off = [float(np.abs(path(find_nearest_s(path, q, 0.0)) - q).max()) for path in paths]
    k = int(np.argmin(off))
    return k, running.times[k].begin


def _refuse_end(t: float, last: SectionTimes) -> None:
    """Raise InvalidInput for a time at which nothing but a wait is left."""
    if t > last.end:
        raise InvalidInput("state", f"the time {t:.9g}", f"a time in [0, {last.end:.9g}]")
    end = f"the end of the program, with a wait of {last.end - t:.6g} s left"
    raise InvalidInput("state", end, "a state before it, with some path left")


def _as_running(running: ProgramPlan, i: int, when: SectionTimes) -> Plan:
    """Return the plan of a section as it is running, with what the plan of the program requires of it."""
    section, path = running.sections[i], running.path
    assert isinstance(path, ProgramPath)
    own, motion = section.trajectory, cut_between(running.trajectory, when.begin, when.rest)
    if (
        own.knots.shape != motion.knots.shape or np.abs(own.knots - motion.knots).max() > BEFORE_END
    ):  # slowed, or stopped
        span = None
        if running.span is not None:
            a, b = (float(np.clip(s - path.starts[i], 0.0, section.path.end)) for s in running.span)
            span = a, b
        section = section.with_motion(motion, span=span, before=None)
    limits, scene = conditions_of(path, i, running.limits, running.scene)
    enforced = tuple(name for name in running.certificate.enforced if name in limits.names)
    return replace(section, _certificate=replace(section.certificate, enforced=enforced), scene=scene)


def _merge_limits(running: ProgramPlan, limits: MotionLimits) -> MotionLimits:
    """Return new limits of a program: the tool speeds of its parts stay, where they are the lesser ones."""
    own: dict[str, Any] = {}
    for name in TOOL_SPEEDS:
        given = [x for x in (limits.value(name), running.limits.value(name)) if x is not None]
        own[name] = np.minimum(*given) if len(given) == 2 else given[0] if given else None
    return replace(limits, **own)


def _plan_again(section: Plan, changed: dict[str, Any]) -> Plan:
    """Return a section from rest to rest under changed arguments."""
    timing = changed["timing"] or read_law(section.law)
    assert section.certificate.tolerance is not None
    return plan(
        section.robot, section.path, None if section.path.in_joints else section.joint_path(0.0),
        solver=section.solver, timing=timing, limits=keep_speed(section, changed["limits"] or section.limits),
        tolerance=section.certificate.tolerance, scene=changed["scene"] or section.scene,
    )  # fmt: skip


# ---------------- replan()


STOPPED = "a moving state; this one has already stopped"
"""What `replan` expects for a stop."""

OTHER_MEANS = "other means of stopping the arm, which is already in this state"
"""Advice for a state in contact."""


def replan(
    plan: Plan,
    state: float | tuple[ArrayLike, ArrayLike, ArrayLike],
    *,
    stop: bool = False, timing: LawLike | None = None,
    limits: MotionLimits | None = None, time_limit: float = 0.02,
    tolerance: ToleranceLike = DEFAULT_TOLERANCE, rate: float = 1000.0, scene: Scene | None = None,
) -> Plan:  # fmt: skip
    """Replan from a moving state: to the end of the path, for example within other limits, or to rest on the path.

    The result is the law's motion or the remaining part of the plan's motion, whichever comes to rest first. With the plan's
    limits there is always a result. Until `Plan.within_limits_from`, the motion may exceed lower limits, never the old ones.

    A stop brakes along the path under all limits that the plan's law enforces. For a state given as a time there is always
    a stop: a sweep, the optimum found near it within `time_limit`, or the end of the motion if that comes first.

    Parameters
    ----------
    plan : Plan
        A plan with a motion; the new motion continues along its joint path.
    state : float, or three (n,) arrays
        A time of the plan's motion [s]; or q [rad, m], q̇ [rad/s, m/s] and q̈ [rad/s², m/s²], within 1e-6 of the path. A state
        within 1e-6 of the motion is replaced by the motion's own; `Plan.start_error` states the difference.
    stop : bool
        Come to rest on the path as soon as possible, instead of at its end.
    timing : str or TimeLaw, optional
        A law that can start from a moving state; by default the plan's own, or `optimal` if that law starts from rest only.
    limits, scene : MotionLimits, and Scene, optional
        Limits, and obstacles with the margin to them; by default those of the plan.
    time_limit : float
        Computing time [s] for improving a stop towards the optimum; 0 returns the stop of the sweep.
    tolerance, rate : Tolerance, or (2,) tuple of float, and float
        Distance [m] and angle [rad], and the controller's rate [1/s], as in `plan`.

    Returns
    -------
    Plan
        Its motion begins at t = 0 with exactly that state; `Plan.span` is the part of the path that it covers.
        TIMING_INFEASIBLE with a reason if there is no motion; CONTACT if the state itself is in contact with the scene.

    Raises
    ------
    InvalidInput
        A plan without a motion, a state off its path, outside its motion, or at rest; or a law that starts only at rest.
    """
    running = _check_plan(plan, stop, time_limit)
    if isinstance(plan, ProgramPlan):
        one = partial(replan, stop=stop, time_limit=time_limit, tolerance=tolerance, rate=rate)
        return replan_program(plan, state, one, {"timing": timing, "limits": limits, "scene": scene}, stop)
    plan = replace(plan, limits=keep_speed(plan, plan.limits)) if timing is None else plan
    request = build_request(plan, timing, limits, Tolerance.of(tolerance), rate, scene)
    start = build_moving_state(plan, running, state)
    if stop and start.still:
        raise InvalidInput("state", f"a state at rest, at s = {start.at.s:.6g}", STOPPED)
    request = replace(request, start_error=start.error)
    if scene is not None and (touch := CollisionCheck(request.robot, scene).check_start(start.joints[0])) is not None:
        error = NoSolution(touch.reason, s=start.at.s, advice=OTHER_MEANS)
        return request.infeasible(plan.joint_path, error, PlanStatus.CONTACT)
    return plan_stop(request, start, time_limit) if stop else plan_onward(request, start)


def _check_plan(plan: Plan, stop: bool, time_limit: float) -> Trajectory:
    """Return the motion of a plan; raise InvalidInput for a plan without one, and for invalid options."""
    check_kind(stop, "stop", bool, "True or False")
    check_number(time_limit, "time_limit", "seconds, at least 0", least=0.0)
    check_kind(plan, "plan", Plan, "a plan with a motion")
    try:
        return plan.trajectory
    except NoSolution:
        raise InvalidInput("plan", str(plan.status), "a plan with a motion") from None
