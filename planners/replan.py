"""replan(): from a moving state on a plan's path, to its end or to rest on it as soon as may be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.check import check_number, real_array
from optik.errors import InvalidInput, NoSolution
from planners.certificate import check_tolerance
from planners.follow import JointPath
from planners.plan import Asked, Plan, make_law
from planners.timing.base import MotionLimits, PathState, TimeLaw

Array = NDArray[np.float64]

OFF_PATH = 1e-6
"""How far a state may be from the path, as a share of a radian or metre, and of the greatest velocity and acceleration."""


def replan(
    plan: Plan,
    state: float | tuple[ArrayLike, ArrayLike, ArrayLike],
    *,
    stop: bool = False,
    timing: str | TimeLaw = "optimal",
    limits: MotionLimits | None = None,
    strict: bool = False,
    tolerance: tuple[float, float] = (1e-5, 1e-5),
    rate: float = 1000.0,
) -> Plan:
    """Plan the rest of a path anew from a moving state: with other limits, to its end, or to rest on it.

    Parameters
    ----------
    plan : Plan
        One that was solved; the motion goes on along its joint path.
    state : float, or three (n,) arrays
        A time of the plan's motion [s], or position, velocity and acceleration of the joints, on the path.
    stop : bool
        Come to rest on the path as soon as may be, instead of at its end.
    timing : str or TimeLaw
        A law that can start from a moving state.
    limits : MotionLimits, optional
        Those of the plan by default.
    strict : bool
        Refuse a motion that passes a limit. By default a state that leaves no motion within the limits (one that is at its
        limits may miss them by rounding) gets one within limits up to 1 % wider, and the certificate says so.
    tolerance : (2,) tuple of float
        As in `plan`.
    rate : float
        As in `plan`.

    Returns
    -------
    Plan
        Its motion begins with exactly that state, at t = 0. TIMING_INFEASIBLE where none is found, LIMITS_EXCEEDED where
        `strict` refuses one.

    Raises
    ------
    InvalidInput
        A plan without a motion, a state that is not on its path, a time outside its motion, a law that starts at rest only.
    """
    if not isinstance(plan, Plan) or not plan:
        raise InvalidInput("plan", repr(getattr(plan, "status", plan))[:60], "a plan that was solved")
    law = make_law(timing) if isinstance(timing, str) else timing
    limits = plan.limits if limits is None else limits
    for argument, value, kind in (("timing", law, TimeLaw), ("limits", limits, MotionLimits)):
        if not isinstance(value, kind):
            raise InvalidInput(argument, repr(value)[:60], f"a {kind.__name__}")
    asked = Asked(plan.robot, plan.path, limits, plan.ik, law, check_tolerance(tolerance), rate)
    joints = plan.joint_path
    at = _state(plan, joints, state)
    if at.s >= joints.end * (1.0 - 1e-9):
        raise InvalidInput("state", f"the path's end (s = {at.s:.9g})", "a state before it, with some path left")
    if stop and at.speed <= OFF_PATH and abs(at.acceleration) <= OFF_PATH:
        raise InvalidInput("state", f"a state at rest, at s = {at.s:.6g}", "a moving one: this one has stopped already")
    try:
        trajectory = law.run_from(joints, limits, at, stop=stop)
    except NoSolution as error:
        return asked.infeasible(joints, error)
    judged = asked.judged(joints, trajectory)
    if strict and not judged:
        return asked.refused(joints, judged.certificate, "strict=False, or higher limits")
    return judged


def _state(plan: Plan, joints: JointPath, state: float | tuple[ArrayLike, ArrayLike, ArrayLike]) -> PathState:
    """Where and how fast on the path; refused where the state is not on it."""
    n = plan.robot.n
    if isinstance(state, tuple | list):
        if len(state) != 3:
            raise InvalidInput("state", f"{len(state)} parts", "a time, or position, velocity and acceleration")
        q, dq, ddq = (real_array(x, "state", f"{n} numbers each") for x in state)
        if any(x.shape != (n,) or not np.isfinite(x).all() for x in (q, dq, ddq)):
            raise InvalidInput("state", "another shape, NaN or infinity", f"three arrays of {n} finite numbers")
    else:
        motion = plan.trajectory
        t = check_number(state, "state", f"a time in [0, {motion.end:.9g}]", least=0.0)
        if t > motion.end:
            raise InvalidInput("state", f"the time {t:.9g}", f"a time in [0, {motion.end:.9g}]")
        q, dq, ddq = (motion(t, order) for order in (0, 1, 2))
    s = _place(joints, q)
    q1, q2 = joints(s, 1), joints(s, 2)
    size = float(q1 @ q1)
    speed = float(q1 @ dq) / size
    acceleration = float(q1 @ (ddq - q2 * speed**2)) / size
    off = (
        (q - joints(s), 1.0, "position"),
        (dq - q1 * speed, max(1.0, float(np.abs(dq).max())), "velocity"),
        (ddq - q1 * acceleration - q2 * speed**2, 1e2 * max(1.0, float(np.abs(ddq).max())), "acceleration"),
    )
    for difference, scale, what in off:
        i = int(np.abs(difference).argmax())
        if abs(difference[i]) > OFF_PATH * scale:
            raise InvalidInput(
                "state",
                f"{plan.robot.joint_names[i]} {abs(difference[i]):.3g} off the path in {what} near s = {s:.6g}",
                "a state on the plan's path, moving along it",
            )
    if speed < -OFF_PATH:
        raise InvalidInput("state", f"a motion backwards along the path (ds/dt = {speed:.3g})", "one forwards")
    return PathState(s, max(speed, 0.0), acceleration)


def _place(joints: JointPath, q: Array) -> float:
    """Place s whose configuration is nearest to q: the nearest of a grid, then by Newton's method."""
    grid = np.linspace(0.0, joints.end, 2 * joints.nodes.size + 1)
    s = float(grid[np.linalg.norm(joints(grid) - q, axis=1).argmin()])
    for _ in range(20):
        q1 = joints(s, 1)
        after = float(np.clip(s + q1 @ (q - joints(s)) / (q1 @ q1), 0.0, joints.end))
        if abs(after - s) <= 1e-15 * joints.end:
            break
        s = after
    return s
