"""replan(): from a moving state on a plan's path to its end, or to rest on it as soon as possible."""

from __future__ import annotations

import os
from dataclasses import replace

from numpy.typing import ArrayLike

from optik.check import check_number
from optik.errors import InvalidInput, NoSolution
from optik.scene import Scene
from planners.certificate.certificate import check_tolerance
from planners.following.around import around
from planners.limits import MotionLimits
from planners.plan import Asked, Plan, PlanStatus
from planners.replan.onward import onward_plan
from planners.replan.request import request
from planners.replan.state import MovingState, moving_state
from planners.replan.stop import stopped_plan
from planners.timing import TimeLaw
from planners.trajectory import Trajectory


def replan(
    plan: Plan,
    state: float | tuple[ArrayLike, ArrayLike, ArrayLike],
    *,
    stop: bool = False, timing: str | os.PathLike[str] | TimeLaw | None = None,
    limits: MotionLimits | None = None, time_limit: float = 0.02,
    tolerance: tuple[float, float] = (1e-5, 1e-5), rate: float = 1000.0,
    scene: Scene | None = None, margin: float | None = None,
) -> Plan:  # fmt: skip
    """Plan the rest of a path anew from a moving state: with other limits, to its end, or to rest on it.

    The result is the law's motion or the rest of the plan's own, whichever is sooner at rest: with the plan's limits there is
    always one. The motion may exceed lower limits, never the old ones, until `Plan.within_limits_from`.

    A stop brakes along the path under all limits that the plan's law enforces. For a state given as a time there is always one:
    a sweep, the optimum found near it within `time_limit`, or the end of the motion where that comes first.

    Parameters
    ----------
    plan : Plan
        One with a motion; the new motion continues along its joint path.
    state : float, or three (n,) arrays
        A time of the plan's motion [s]; or q [rad, m], q̇ [rad/s, m/s] and q̈ [rad/s², m/s²], within 1e-6 of the path. A state
        within 1e-6 of the motion is replaced by the motion's own; `Plan.start_error` states the difference.
    stop : bool
        Come to rest on the path as soon as possible, instead of at its end.
    timing : str or TimeLaw, optional
        A law that can start from a moving state; by default the plan's own, or `optimal` where that starts from rest only.
    limits : MotionLimits, optional
        By default those of the plan.
    time_limit : float
        Time [s] in which the optimum may improve a stop; 0 returns the sweep's.
    tolerance, rate : (2,) tuple of float, and float
        Distance [m] and angle [rad], and the controller's rate [1/s], as in `plan`.
    scene, margin : Scene and float, optional
        What the arm must not touch, and what all distances must exceed [m]; by default the plan's.

    Returns
    -------
    Plan
        Its motion begins at t = 0 with exactly that state; `Plan.span` is the part of the path that it covers.
        TIMING_INFEASIBLE with a reason where none is found, CONTACT where the state itself touches the scene.

    Raises
    ------
    InvalidInput
        A plan without a motion, a measured state off its path, a time outside its motion, a state that has ended or
        stopped already, or a law that starts only at rest.
    """
    running = _running(plan, stop, time_limit)
    asked = request(plan, timing, limits, (check_tolerance(tolerance), rate, scene, margin))
    start = moving_state(plan, running, state)
    if stop and start.still:
        raise InvalidInput(
            "state", f"a state at rest, at s = {start.at.s:.6g}", "a moving one: this one has stopped already"
        )
    asked = replace(asked, start_error=start.error)
    if scene is not None and (touch := _contact(asked, start)) is not None:
        return asked.infeasible(plan.joint_path, touch, PlanStatus.CONTACT)
    return stopped_plan(asked, plan, start, time_limit) if stop else onward_plan(asked, plan, start)


def _running(plan: Plan, stop: bool, time_limit: float) -> Trajectory:
    """The plan's motion; raises InvalidInput for a plan without one, and for other options that are invalid."""
    if not isinstance(stop, bool):
        raise InvalidInput("stop", repr(stop)[:60], "True or False")
    check_number(time_limit, "time_limit", "seconds, at least 0", least=0.0)
    if not isinstance(plan, Plan):
        raise InvalidInput("plan", repr(plan)[:60], "a plan with a motion")
    try:
        return plan.trajectory
    except NoSolution:
        raise InvalidInput("plan", str(plan.status), "a plan with a motion") from None


def _contact(asked: Asked, start: MovingState) -> NoSolution | None:
    """The pair that touches where the motion would start."""
    near = around(asked.robot, asked.scene, asked.margin)
    touch = None if near is None else near.start(start.joints[0])
    if touch is None:
        return None
    return NoSolution(touch.reason, s=start.at.s, advice="the arm is there already: stop it by other means")
