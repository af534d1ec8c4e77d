"""replan(): a motion from a moving state to the end of a plan's path, or to rest on it as soon as possible."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from numpy.typing import ArrayLike

from optik.check import check_number
from optik.errors import InvalidInput, NoSolution
from optik.ik.base import Tolerance, ToleranceLike
from optik.scene import Scene
from planners.following.collision import CollisionCheck
from planners.following.follow import DEFAULT_TOLERANCE
from planners.limits import MotionLimits
from planners.plan import Plan, PlanStatus
from planners.program.result import ProgramPlan
from planners.replan.onward import plan_onward
from planners.replan.program import replan_program
from planners.replan.request import build_request, keep_speed
from planners.replan.state import build_moving_state
from planners.replan.stop import plan_stop
from planners.timing import LawLike
from planners.trajectory import Trajectory

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
    request = build_request(plan, timing, limits, (Tolerance.of(tolerance), rate, scene))
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
    if not isinstance(stop, bool):
        raise InvalidInput("stop", repr(stop)[:60], "True or False")
    check_number(time_limit, "time_limit", "seconds, at least 0", least=0.0)
    if not isinstance(plan, Plan):
        raise InvalidInput("plan", repr(plan)[:60], "a plan with a motion")
    try:
        return plan.trajectory
    except NoSolution:
        raise InvalidInput("plan", str(plan.status), "a plan with a motion") from None
