"""replan(): from a moving state on a plan's path to its end, or to rest on it as soon as possible."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from optik.arm.shapes.contact import check_scene
from optik.check import check_number, real_array
from optik.errors import InvalidInput, NoSolution
from optik.scene import Scene
from optik.types import Array
from planners.certificate.certificate import check_tolerance
from planners.certificate.statics import check_statics
from planners.fit import fitted
from planners.following.follow import JointPath
from planners.limits import DERIVATIVES, TOOL_SPEEDS, MotionLimits, over
from planners.plan import Asked, Plan
from planners.splice import State, begun, joined, rest_of
from planners.timing import TimeLaw, law_for
from planners.timing.base import PathState, check_motion, refit
from planners.timing.smooth import QUINTIC
from planners.trajectory import Trajectory

OFF_PATH = 1e-6
"""Largest distance of a measured state from the path, as a share of a radian or metre, and of the greatest velocity and
acceleration: encoders resolve less."""
ENDED = 1e-9
"""A motion within this of its end has ended [s]: controllers count in nanoseconds."""
STANDING = 1e-6
"""Speed and acceleration along the path [1/s, 1/s²] below which a measured state has stopped."""
WIDENED = (1.001, 1.003, 1.01)
"""Factors on the limits that are tried where no motion from the state keeps the limits themselves."""
INSTANT = 0.01
"""Time [s] by which velocities are multiplied to compare them with distances, in the search of the instant of a motion that
is nearest to a state."""
SEVERAL = 8
"""Most places that are searched where a path comes near a configuration more than once."""


def replan(
    plan: Plan,
    state: float | tuple[ArrayLike, ArrayLike, ArrayLike],
    *,
    stop: bool = False, timing: str | os.PathLike[str] | TimeLaw = "optimal",
    limits: MotionLimits | None = None, strict: bool = False,
    tolerance: tuple[float, float] = (1e-5, 1e-5), rate: float = 1000.0,
    scene: Scene | None = None, margin: float | None = None,
) -> Plan:  # fmt: skip
    """Plan the rest of a path anew from a moving state: with other limits, to its end, or to rest on it.

    The rest of the plan's own motion is a candidate too: where it keeps the limits, the result is that or the law's motion,
    whichever is sooner at rest. So with the plan's limits there is always one.

    Parameters
    ----------
    plan : Plan
        One with a motion; the new motion continues along its joint path.
    state : float, or three (n,) arrays
        A time of the plan's motion [s]; or q [rad, m], q̇ [rad/s, m/s] and q̈ [rad/s², m/s²], within 1e-6 of the path.
    stop : bool
        Come to rest on the path as soon as possible, instead of at its end.
    timing : str or TimeLaw
        A law that can start from a moving state.
    limits : MotionLimits, optional
        By default those of the plan.
    strict : bool
        Refuse a motion that passes a limit. By default, where none is found that keeps the limits, the result is the one
        that passes them least, by 1 % at most, and its certificate says so.
    tolerance : (2,) tuple of float
        Distance [m] and angle [rad], as in `plan`.
    rate : float
        The controller's rate [1/s], as in `plan`.
    scene, margin : Scene and float, optional
        What must not be touched now, and what all distances must exceed [m]; by default the plan's.

    Returns
    -------
    Plan
        Its motion begins at t = 0 with exactly that state; `Plan.span` is the part of the path that it covers.
        TIMING_INFEASIBLE with a reason where none is found.

    Raises
    ------
    InvalidInput
        A plan without a motion, a measured state off its path, a time outside its motion, a state that has ended or
        stopped already, or a law that starts only at rest.
    """
    running = _running(plan)
    asked = _asked(plan, timing, limits, (check_tolerance(tolerance), rate, scene, margin))
    for argument, flag in (("stop", stop), ("strict", strict)):
        if not isinstance(flag, bool):
            raise InvalidInput(argument, repr(flag)[:60], "True or False")
    start = _start(plan, running, state)
    if stop and start.still:
        came = f"a state at rest, at s = {start.at.s:.6g}"
        raise InvalidInput("state", came, "a moving one: this one has stopped already")
    return _answer(asked, plan, start, stop, strict)


def _asked(
    plan: Plan,
    timing: str | os.PathLike[str] | TimeLaw,
    limits: MotionLimits | None,
    judged: tuple[tuple[float, float], float, Scene | None, float | None],
) -> Asked:
    """Build the law where it was given by name, and check that it can keep these limits."""
    tolerance, rate, scene, margin = judged
    scene, margin = plan.scene if scene is None else scene, plan.margin if margin is None else margin
    check_scene(plan.robot, scene, margin)
    law = law_for(timing)
    limits = plan.limits if limits is None else limits
    if not isinstance(limits, MotionLimits):
        raise InvalidInput("limits", repr(limits)[:60], "a MotionLimits")
    law.need(limits, plan.robot)
    limits.check_path(plan.path)
    return Asked(plan.robot, plan.path, limits, plan.ik, law, tolerance, rate, scene=scene, margin=margin)


class _Start(NamedTuple):
    """A state on the path, the rest of the running motion (None where the state is not part of it), whether it is at rest."""

    at: PathState
    rest: Trajectory | None
    still: bool


def _running(plan: Plan) -> Trajectory:
    """The plan's motion; raises InvalidInput for a plan without one."""
    if not isinstance(plan, Plan):
        raise InvalidInput("plan", repr(plan)[:60], "a plan with a motion")
    try:
        return plan.trajectory
    except NoSolution:
        raise InvalidInput("plan", str(plan.status), "a plan with a motion") from None


# ---------------------------------------------------------------- the answer


def _answer(asked: Asked, plan: Plan, start: _Start, stop: bool, strict: bool) -> Plan:
    """The motion that is first at rest and keeps the limits; else, unless strict, the one that passes them least."""
    found: list[Plan] = []
    for motion in _motions(asked, plan, start, stop):
        solved = _solved(asked, plan.joint_path, start, motion, stop)
        if solved.certificate.holds:
            return solved
        found.append(solved)
    if start.still and not stop:
        slowed = _slowed(asked, plan.joint_path, start)
        if slowed is not None:
            return slowed
    if not strict:
        for share in WIDENED:
            wider = _by_law(asked, plan.joint_path, asked.limits.scaled(share), start.at, stop)
            if wider is not None:
                found.append(_solved(asked, plan.joint_path, start, wider, stop))
                break
        found = [solved for solved in found if _passed(solved) <= WIDENED[-1] * (1.0 + 1e-9)]
        if found:
            return min(found, key=_passed)
    return asked.infeasible(plan.joint_path, _reason(asked, plan, start, stop))


def _motions(asked: Asked, plan: Plan, start: _Start, stop: bool) -> Iterator[Trajectory]:
    """Candidates from the state, the one that is first at rest first: the law's motion and the rest of the running one."""
    joints = plan.joint_path
    found = [_by_law(asked, joints, asked.limits, start.at, stop)]
    rests = joints.end if plan.span is None else plan.span[1]
    on = stop or rests >= joints.end
    found += [start.rest] if on else []
    yield from sorted((motion for motion in found if motion is not None), key=lambda motion: motion.duration)
    if (
        not on and start.rest is not None
    ):  # the running motion stops before the path's end; the law continues from there
        end = start.rest.end
        still = PathState(rests, 0.0, 0.0, (start.rest(end), np.zeros(joints.robot.n), np.zeros(joints.robot.n)))
        second = _by_law(asked, joints, asked.limits, still, False)
        if second is not None:
            yield joined(start.rest, second)


def _slowed(asked: Asked, joints: JointPath, start: _Start) -> Plan | None:
    """A motion from a state at rest, slowed as a whole until it keeps the limits: the law's, or else a quintic in s."""
    assert start.at.joints is not None
    keeps = asked.law.promises(asked.limits)
    for found in _from_rest(asked, joints, start.at):
        try:
            slower = fitted(asked.robot, found, asked.limits, keeps, asked.path)
        except NoSolution:
            continue
        solved = _solved(asked, joints, start, begun(slower, start.at.joints, asked.limits), False)
        if solved.certificate.holds:
            return solved
    return None


def _from_rest(asked: Asked, joints: JointPath, at: PathState) -> Iterator[Trajectory]:
    """Motions to the path's end that may pass the limits: the law's within wider ones, and a quintic in s."""
    for share in WIDENED:
        found = _by_law(asked, joints, asked.limits.scaled(share), at, False)
        if found is not None:
            yield found
            break
    if at.s < joints.end:
        c = (joints.end - at.s) * QUINTIC
        c[-1] = at.s
        yield refit(joints, PPoly(c[:, None], np.array([0.0, 1.0]), extrapolate=True))


def _by_law(asked: Asked, joints: JointPath, limits: MotionLimits, at: PathState, stop: bool) -> Trajectory | None:
    """The law's motion from exactly this state; None where the law finds none."""
    if at.s >= joints.end * (1.0 - 1e-9):  # nothing left to plan in
        return None
    try:
        motion = check_motion(asked.law, asked.law.run_from(joints, limits, at, stop=stop), asked.robot)
    except NoSolution:
        return None
    assert at.joints is not None
    return begun(motion, at.joints, limits)


def _solved(asked: Asked, joints: JointPath, start: _Start, motion: Trajectory, stop: bool) -> Plan:
    """A plan with a motion, certified, and the part of the path that it covers."""
    rests = _place(joints, motion(motion.end), start.at.s) if stop else joints.end
    return replace(asked, span=(start.at.s, max(start.at.s, rests))).judged(joints, motion)


def _passed(solved: Plan) -> float:
    """Largest ratio to a limit that the law promises; infinite where something else does not hold."""
    proof = solved.certificate
    ratios = [float(np.nan_to_num(proof.worst(field)[0], posinf=np.inf)) for field in proof.keeps]
    kept = replace(proof, keeps=())
    return max(ratios, default=0.0) if kept.holds else float("inf")


def _reason(asked: Asked, plan: Plan, start: _Start, stop: bool) -> NoSolution:
    """Why there is no motion: the state itself passes a limit, or where the running motion does."""
    limits, robot = asked.limits, plan.robot
    try:
        check_statics(plan.joint_path, asked.limits, asked.law.promises(asked.limits), start.at.s)
    except NoSolution as error:
        if not stop:
            return error
    goal = "comes to rest" if stop else "ends at rest"
    none = f"no motion from this state {goal} on the path within the limits"
    assert start.at.joints is not None
    _, dq, ddq = start.at.joints
    bound = limits.bounds(robot.n)
    twist = robot.jacobian(start.at.joints[0]) @ dq
    here = [(f, over(x, bound[f]), robot.joint_names) for f, x in zip(DERIVATIVES, (dq, ddq), strict=False)]
    allowed = limits.tool_at(plan.path, np.array([start.at.s]))[0]
    speeds = (float(np.linalg.norm(part)) / limit for part, limit in zip((twist[:3], twist[3:]), allowed, strict=True))
    here += [(f, np.array([x]), ("tool",)) for f, x in zip(TOOL_SPEEDS, speeds, strict=True)]
    field, ratios, names = max(here, key=lambda each: float(each[1].max()))
    ratio, joint = float(ratios.max()), names[int(ratios.argmax())]
    advice = "higher limits" if stop else "stop=True, or higher limits"
    if ratio > 1.0 + 1e-9:
        what = f"the state itself has {ratio:.6g} times the {field.replace('_', ' ')} that is allowed of {joint}"
        return NoSolution(f"{none}: {what}", s=start.at.s, joint=joint, advice=f"limits {ratio:.6g} times as high")
    if start.rest is None:
        return NoSolution(f"{none} was found", s=start.at.s, advice=advice)
    proof = _solved(asked, plan.joint_path, start, start.rest, stop).certificate
    field = max(proof.keeps, key=lambda f: float(np.nan_to_num(proof.worst(f)[0], posinf=np.inf)))
    ratio, joint, t = proof.worst(field)
    s = float(np.interp(t, proof.binding.t, proof.binding.s))
    what = f"the running motion comes to {ratio:.6g} times the {field.replace('_', ' ')} of {joint} at s = {s:.6g}"
    return NoSolution(f"{none} was found; {what}", s=s, joint=joint, advice=advice)


# ---------------------------------------------------------------- the state


def _start(plan: Plan, running: Trajectory, state: float | tuple[ArrayLike, ArrayLike, ArrayLike]) -> _Start:
    """Place, speed and acceleration along the path, and the rest of the running motion."""
    measured = isinstance(state, tuple | list)
    if isinstance(state, tuple | list):
        q, dq, ddq = given = _measured(plan, state)
        t = _when(running, given)
        of_it = _close(running, t, given)
    else:
        t = check_number(state, "state", f"a time in [0, {running.end:.9g}]", least=0.0)
        if t > running.end:
            raise InvalidInput("state", f"the time {t:.9g}", f"a time in [0, {running.end:.9g}]")
        q, dq, ddq = given = running(t), running(t, 1), running(t, 2)
        of_it = True
    left = of_it and t < running.end - ENDED
    joints, binding = plan.joint_path, plan.certificate.binding
    s = _place(joints, q, float(np.interp(t, binding.t, binding.s)))
    if s >= joints.end * (1.0 - 1e-9) and not left:
        raise InvalidInput("state", f"the path's end (s = {s:.9g})", "a state before it, with some path left")
    q1, q2 = joints(s, 1), joints(s, 2)
    size = float(q1 @ q1)
    speed = float(q1 @ dq) / size
    acceleration = float(q1 @ (ddq - q2 * speed**2)) / size
    if not of_it:
        _check_on_path(plan, s, (speed, acceleration), given)
    standing = speed <= STANDING and abs(acceleration) <= STANDING
    still = standing if measured else not (left and dq.any())
    if standing and (measured or not left):  # rounding and noise only
        speed = acceleration = 0.0
    at = PathState(s, max(speed, 0.0), acceleration, given)
    return _Start(at, begun(rest_of(running, t), given, plan.limits) if left else None, still)


def _measured(plan: Plan, state: tuple[ArrayLike, ArrayLike, ArrayLike] | list[ArrayLike]) -> State:
    n = plan.robot.n
    if len(state) != 3:
        raise InvalidInput("state", f"{len(state)} parts", "a time, or position, velocity and acceleration")
    q, dq, ddq = (real_array(x, "state", f"{n} numbers each") for x in state)
    if any(x.shape != (n,) or not np.isfinite(x).all() for x in (q, dq, ddq)):
        raise InvalidInput("state", "another shape, NaN or infinity", f"three arrays of {n} finite numbers")
    return q.copy(), dq.copy(), ddq.copy()


def _off(given: State, there: State) -> list[tuple[str, Array, float]]:
    """Position, velocity and acceleration: the name, the difference (n,) of two states, and its tolerance."""
    _, dq, ddq = given
    scales = (1.0, max(1.0, float(np.abs(dq).max())), 1e2 * max(1.0, float(np.abs(ddq).max())))
    parts = zip(("position", "velocity", "acceleration"), given, there, scales, strict=True)
    return [(what, np.abs(x - y), OFF_PATH * scale) for what, x, y, scale in parts]


def _close(running: Trajectory, t: float, given: State) -> bool:
    """Whether a measured state is that of the running motion at t, within the tolerance of measured states."""
    there = running(t), running(t, 1), running(t, 2)
    return all(float(off.max()) <= most for _, off, most in _off(given, there))


def _check_on_path(plan: Plan, s: float, along: tuple[float, float], given: State) -> None:
    """Raise InvalidInput for a measured state that is off the path, or does not move along it."""
    joints, (speed, acceleration) = plan.joint_path, along
    q1, q2 = joints(s, 1), joints(s, 2)
    for what, off, most in _off(given, (joints(s), q1 * speed, q1 * acceleration + q2 * speed**2)):
        i = int(off.argmax())
        if off[i] > most:
            raise InvalidInput(
                "state",
                f"{plan.robot.joint_names[i]} {off[i]:.3g} off the path in {what} near s = {s:.6g}",
                "a state on the plan's path, moving along it",
            )
    if speed < -OFF_PATH:
        raise InvalidInput("state", f"a motion backwards along the path (ds/dt = {speed:.3g})", "one forwards")


def _when(running: Trajectory, given: State) -> float:
    """Time [s] at which the running motion is nearest to a state, with its velocity and acceleration."""
    weights = (1.0, INSTANT, INSTANT**2)
    aim = np.concatenate([w * x for w, x in zip(weights, given, strict=True)])

    def stacked(t: Array, order: int) -> Array:
        return np.concatenate([w * running(t, order + i) for i, w in enumerate(weights)], axis=1)

    knots = running.knots
    grid = np.unique(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))
    t = float(grid[np.linalg.norm(stacked(grid, 0) - aim, axis=1).argmin()])
    for _ in range(20):
        at = np.array([t])
        rate = stacked(at, 1)[0]
        size = float(rate @ rate)
        if size == 0.0:
            break
        after = float(np.clip(t + rate @ (aim - stacked(at, 0)[0]) / size, 0.0, running.end))
        if abs(after - t) <= 1e-15 * running.end:
            break
        t = after
    return t


def _place(joints: JointPath, q: Array, near: float) -> float:
    """Place s whose configuration is nearest to q; of several, where a path returns to it, the one nearest to `near`."""
    grid = np.linspace(0.0, joints.end, 2 * joints.nodes.size + 1)
    off = np.linalg.norm(joints(grid) - q, axis=1)
    lowest = np.flatnonzero((off <= np.append(off[1:], np.inf)) & (off <= np.append(np.inf, off[:-1])))
    places = [_refined(joints, q, float(grid[i])) for i in lowest[np.argsort(off[lowest])][:SEVERAL]]
    rests = np.array([float(np.linalg.norm(joints(s) - q)) for s in places])
    return min(
        (s for s, off in zip(places, rests, strict=True) if off <= rests.min() + OFF_PATH), key=lambda s: abs(s - near)
    )


def place_on(joints: JointPath, q: ArrayLike, near: float) -> float:
    """Find the place of a joint path that is nearest to a configuration.

    Parameters
    ----------
    joints : JointPath
        The joint path.
    q : (n,) array
        The configuration [rad, m].
    near : float
        Which of several places to return, where the path comes to it more than once: the one nearest to this [m, or rad].

    Returns
    -------
    float
        The place [m, or rad].
    """
    return _place(joints, np.asarray(q, dtype=np.float64), near)


def _refined(joints: JointPath, q: Array, s: float) -> float:
    """Newton's method for the nearest place to q, from one near it."""
    for _ in range(20):
        q1 = joints(s, 1)
        after = float(np.clip(s + q1 @ (q - joints(s)) / (q1 @ q1), 0.0, joints.end))
        if abs(after - s) <= 1e-15 * joints.end:
            break
        s = after
    return s
