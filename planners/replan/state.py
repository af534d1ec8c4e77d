"""Moving states on a plan's path, the request of a motion from one, and the reasons why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_kind, check_number, finite_array
from optik.errors import InvalidInput, NoSolution
from optik.ik.base import Tolerance
from optik.scene import Scene
from optik.scene.contact import check_scene
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.violation import word_of_limit
from planners.following.joint_path import JointPath, find_nearest_between, find_nearest_s
from planners.limits import DERIVATIVES, TOOL_SPEEDS, MotionLimits, check_path, ratio_to_limit, tool_limits_at
from planners.motion.motion import check_statics, match_start
from planners.planning.planner import PlanRequest
from planners.planning.result import Plan
from planners.timing import LawLike, TimeLaw, laws, make_law
from planners.timing.base import QUIET, PathState, StopKind, check_motion
from planners.timing.optimal import Optimal
from planners.trajectory import State, Trajectory, cut_before

# ---------------- moving states on a plan's path, and their relation to the running motion


OFF_PATH = 1e-6
"""Largest distance of a measured state from the path [rad or m], and the same relative to the greatest velocity and
acceleration; encoders resolve less."""
ENDED = 1e-9
"""Time before its end at which a motion counts as ended [s]: controllers count in nanoseconds."""
BEFORE_END = 1e-6
"""Latest time of a measured state with a velocity or an acceleration, counted back from the end of the motion [s]."""
SAME = 1e-9
"""Largest distance [rad, m] of the end of a motion from the joint path at the path parameter that its law gave; a sweep's stop
interpolates it."""
STANDING = 1e-6
"""Speed and acceleration along the path [1/s, 1/s²] below which a measured state counts as stopped."""
NEAREST_STARTS = 3
"""Number of instants from which the search for the instant nearest to a state starts."""


@dataclass(frozen=True)
class MovingState:
    """A state on the path, its time in the running motion, and the rate and acceleration of the motion's clock at that time.

    ``error`` has the largest differences between a measured state and the motion's own state, which replaced it.
    """

    plan: Plan
    at: PathState
    t: float
    clock: tuple[float, float]
    still: bool
    error: tuple[float, float, float] | None

    @property
    def time_left(self) -> float | None:
        """The duration of `rest` [s]; None if there is no rest."""
        end, rate = self.plan.trajectory.end, self.clock[0]
        return (end - self.t) / rate if 0.0 < rate <= 1.0 and self.t < end - ENDED else None

    @cached_property
    def rest(self) -> Trajectory | None:
        """The remaining motion at the clock's rate; None at the end of the motion, and unless 0 < rate ≤ 1."""
        if self.time_left is None:
            return None
        rest = cut_before(self.plan.trajectory, self.t, self.at.s)
        return match_start(
            rest if self.clock[0] == 1.0 else rest.stretched(1.0 / self.clock[0]), self.joints, self.plan.limits
        )

    @cached_property
    def rest_analysis(self) -> MotionAnalysis | None:
        """The analysis of `rest`, which several plans share."""
        return None if self.rest is None else MotionAnalysis(self.plan.robot, self.rest, self.plan.path)

    @property
    def plan_limits(self) -> MotionLimits:
        """The limits that the plan's motion respects at the time of the state."""
        before = self.plan.before
        return before[0] if before is not None and self.t < before[1] else self.plan.limits

    @property
    def joints(self) -> State:
        """q, q̇ and q̈ of the state."""
        assert self.at.joints is not None
        return self.at.joints


def build_moving_state(
    plan: Plan, running: Trajectory, state: float | tuple[ArrayLike, ArrayLike, ArrayLike]
) -> MovingState:
    """Return the moving state for a time of the running motion, or for measured values; raise InvalidInput for others."""
    if isinstance(state, tuple | list):
        measured = check_measured(plan, state)
        t = find_nearest_time(running, measured)
        if t > running.end - BEFORE_END and any(x.any() for x in measured[1:]):  # noise hides whether it has ended
            t = max(running.end - BEFORE_END, 0.0)
        planned = _state_at(running, t)
        off = [float(np.abs(x - y).max()) for x, y in zip(measured, planned, strict=True)]
        if not all(each <= most for each, most in zip(off, _find_tolerances(measured), strict=True)):
            return _build_state_off_motion(plan, running, measured, t)
        error: tuple[float, float, float] | None = (off[0], off[1], off[2])
    else:
        t, error = check_number(state, "state", f"a time in [0, {running.end:.9g}]", least=0.0), None
        if t > running.end:
            raise InvalidInput("state", f"the time {t:.9g}", f"a time in [0, {running.end:.9g}]")
        planned = _state_at(running, t)
    left, joints = t < running.end - ENDED, plan.joint_path
    at = path_state(joints, s_at(plan, t), planned)
    standing = at.speed <= STANDING and abs(at.acceleration) <= STANDING
    still = standing if error is not None else not (left and planned[1].any())
    if standing and (error is not None or not left):  # speed and acceleration are rounding and noise
        at = at._replace(speed=0.0, acceleration=0.0)
    if at.s >= joints.end * (1.0 - 1e-9) and not left:
        raise InvalidInput("state", f"the path's end (s = {at.s:.9g})", "a state before it, with some path left")
    return MovingState(plan, at, t, (1.0, 0.0), still, error)


def s_at(plan: Plan, t: float) -> float:
    """Return the path parameter s of the plan's motion at a time [s]; raise InvalidInput if the motion is off its path."""
    running, joints = plan.trajectory, plan.joint_path
    knots, places = _knot_table(plan)
    k = int(np.clip(np.searchsorted(knots, t, side="right") - 1, 0, knots.size - 2))
    if t >= knots[-1]:
        s, q = float(places[-1]), running(running.end)
        return s if np.abs(joints(s) - q).max() <= SAME else find_nearest_s(joints, q, s)
    slack = 0.0 if running.s is not None else 0.1 * float(places[k + 1] - places[k])
    low, high = max(float(places[k]) - slack, 0.0), min(float(places[k + 1]) + slack, joints.end)
    q = running(t)
    s = find_nearest_between(joints, q, min(low, high), max(low, high))
    if np.abs(joints(s) - q).max() <= OFF_PATH:
        return s
    s = find_nearest_s(joints, q, s)
    off = float(np.abs(joints(s) - q).max())
    if off > 1e2 * OFF_PATH:
        raise InvalidInput(
            "plan", f"a motion {off:.3g} rad or m off its joint path at t = {t:.6g} s", "one that follows it"
        )
    return s


def path_state(joints: JointPath, s: float, given: State) -> PathState:
    """Return the state at s, with the speed and acceleration along the path that q̇ and q̈ have."""
    q1, q2 = joints(s, 1), joints(s, 2)
    _, dq, ddq = given
    size = float(q1 @ q1)
    speed = float(q1 @ dq) / size
    return PathState(s, max(speed, 0.0), float(q1 @ (ddq - q2 * speed**2)) / size, given)


def _state_at(running: Trajectory, t: float) -> State:
    return running(t), running(t, 1), running(t, 2)


def check_measured(plan: Plan, state: tuple[ArrayLike, ArrayLike, ArrayLike] | list[ArrayLike]) -> State:
    """Return the measured q, q̇ and q̈; raise InvalidInput for other shapes, NaN or infinity."""
    n = plan.robot.n
    if len(state) != 3:
        raise InvalidInput("state", f"{len(state)} parts", "a time, or position, velocity and acceleration")
    q, dq, ddq = (finite_array(x, "state", f"three arrays of {n} finite numbers", (n,)).copy() for x in state)
    return q, dq, ddq


def _find_tolerances(given: State) -> tuple[float, float, float]:
    """Return the largest differences of position, velocity and acceleration that count as zero."""
    _, dq, ddq = given
    return OFF_PATH, OFF_PATH * max(1.0, float(np.abs(dq).max())), 1e2 * OFF_PATH * max(1.0, float(np.abs(ddq).max()))


def _build_state_off_motion(plan: Plan, running: Trajectory, given: State, t: float) -> MovingState:
    """Return a measured state on the path but off the running motion; raise InvalidInput for one off the path."""
    joints, (q, dq, ddq) = plan.joint_path, given
    s = find_nearest_s(joints, q, s_at(plan, t))
    q1, q2 = joints(s, 1), joints(s, 2)
    size = float(q1 @ q1)
    speed = float(q1 @ dq) / size
    acceleration = float(q1 @ (ddq - q2 * speed**2)) / size
    there = joints(s), q1 * speed, q1 * acceleration + q2 * speed**2
    names = ("position", "velocity", "acceleration")
    for what, x, y, most in zip(names, given, there, _find_tolerances(given), strict=True):
        i = int(np.abs(x - y).argmax())
        if (off := abs(x[i] - y[i])) > most:
            raise InvalidInput(
                "state",
                f"{plan.robot.joint_names[i]} {off:.3g} off the path in {what} near s = {s:.6g}",
                "a state on the plan's path, moving along it",
            )
    if speed < -OFF_PATH:
        raise InvalidInput("state", f"a motion backwards along the path (ds/dt = {speed:.3g})", "one forwards")
    still = speed <= STANDING and abs(acceleration) <= STANDING
    if s >= joints.end * (1.0 - 1e-9):
        raise InvalidInput("state", f"the path's end (s = {s:.9g})", "a state before it, with some path left")
    at = PathState(s, 0.0 if still else max(speed, 0.0), 0.0 if still else acceleration, given)
    t, clock = _find_clock(plan, given, s)
    return MovingState(plan, at, t, clock, still, None)


def _knot_table(plan: Plan) -> tuple[Array, Array]:
    """Return times and path parameters of the plan's motion at its knots, from its law or else from its certificate."""
    running, proof = plan.trajectory, plan.certificate
    return (proof.t, proof.s) if running.s is None else (running.knots, running.s)


def _find_clock(plan: Plan, given: State, s: float) -> tuple[float, tuple[float, float]]:
    """Return the time at which the plan's motion passes s, and the rate and acceleration of a clock that gives the state."""
    running, (knots, places) = plan.trajectory, _knot_table(plan)
    k = int(np.searchsorted(places, s))
    low, high = knots[max(k - 2, 0)], knots[min(k + 1, knots.size - 1)]
    t = find_nearest_between(running, given[0], float(low), float(high))
    v = running(t, 1)
    size = float(v @ v)
    if size == 0.0:
        return t, (0.0, 0.0)
    w = float(v @ given[1]) / size
    return t, (w, float(v @ (given[2] - running(t, 2) * w * w)) / size)


def find_nearest_time(running: Trajectory, given: State) -> float:
    """Return the time [s] at which the running motion is nearest to a state in q, q̇ and q̈, by damped Gauss–Newton."""
    weights = tuple(OFF_PATH / most for most in _find_tolerances(given))
    aim = np.concatenate([w * x for w, x in zip(weights, given, strict=True)])

    def off(t: Array, order: int = 0) -> Array:
        values = np.concatenate([w * running(t, order + i) for i, w in enumerate(weights)], axis=1)
        return values - aim if order == 0 else values

    knots = running.knots
    grid = np.unique(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))
    size = np.linalg.norm(off(grid), axis=1)
    found = [_descend(off, float(grid[k]), running.end) for k in np.argsort(size, kind="stable")[:NEAREST_STARTS]]
    return min(found, key=lambda each: each[1])[0]


def _descend(off: Callable[..., Array], t: float, end: float) -> tuple[float, float]:
    """Return the time of least distance near t, and the distance."""
    here = off(np.array([t]))[0]
    for _ in range(30):
        rate = off(np.array([t]), 1)[0]
        size = float(rate @ rate)
        step = -float(rate @ here) / size if size > 0.0 else 0.0
        for _ in range(20):
            after = min(max(t + step, 0.0), end)
            there = off(np.array([after]))[0]
            if there @ there <= here @ here:
                break
            step *= 0.5
        else:
            break
        done = abs(after - t) <= 1e-15 * end
        t, here = after, there
        if done:
            break
    return t, float(np.linalg.norm(here))


# ---------------- the plan request of a motion from a moving state


SPEED_MARGIN = 1e-6
"""Fraction by which a motion may exceed a requested constant tool speed [1], for rounding of a motion at that speed."""


class RecordedLaw(TimeLaw):
    """A record of the law of a plan, or of `optimal` in its place: its name, its speed, and the limits that it enforces."""

    enforced = ()

    def __init__(self, name: str, speed: float | None, enforced: tuple[str, ...]) -> None:
        self.name, self.speed, self._enforced = name, speed, enforced  # type: ignore[misc]

    def list_enforced(self, limits: MotionLimits) -> tuple[str, ...]:
        """Return the limits that the plan's certificate enforces."""
        return tuple(name for name in self._enforced if name in limits.names)

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        raise NoSolution(f"{self.name} starts from rest only")


def build_request(
    plan: Plan,
    timing: LawLike | None,
    limits: MotionLimits | None,
    tolerance: Tolerance,
    rate: float,
    scene: Scene | None,
) -> PlanRequest:
    """Build the request: construct a law given by name, and check that it can enforce these limits."""
    scene = plan.scene if scene is None else scene
    check_scene(plan.robot, scene)
    law = make_law(timing) if timing is not None else _own_law(plan)
    allow: tuple[str, ...] = ()
    limits, enforced = plan.limits if limits is None else limits, plan.certificate.enforced
    check_kind(limits, "limits", MotionLimits)
    if timing is not None:
        law.need(limits, plan.robot)
    else:  # limits that the plan was allowed to exceed
        limits = keep_speed(plan, limits)
        allow = tuple({word_of_limit(name) for name in plan.limits.given_names if name not in enforced})
    check_path(limits, plan.path)
    return PlanRequest(plan.robot, plan.path, limits, plan.solver, law, tolerance, rate, scene=scene, allow=allow)


def _own_law(plan: Plan) -> TimeLaw:
    """Return the plan's own law if it can start from a moving state; else a record that enforces the same limits."""
    name = plan.law.partition(QUIET)[0]  # from a moving state nothing is averaged
    if name in laws() and plan.speed is None:
        law = make_law(name)
        known = set(law.list_enforced(plan.limits)) <= set(plan.certificate.enforced)
        if known and type(law).run_from is not TimeLaw.run_from:
            return law
    kept = () if plan.speed is None else TOOL_SPEEDS
    return RecordedLaw(plan.law, plan.speed, tuple(dict.fromkeys((*plan.certificate.enforced, *kept))))


def keep_speed(plan: Plan, limits: MotionLimits) -> MotionLimits:
    """Return limits with the constant speed of a plan's law as a limit on the tool's speed, or on its rotation."""
    if plan.speed is None:
        return limits
    name = TOOL_SPEEDS[int(plan.certificate.tool_speed.value <= 0.5 * plan.speed)]
    most = max(plan.speed * (1.0 + SPEED_MARGIN), float(plan.certificate.extreme(name).value))
    bound: Any = {name: most if limits.value(name) is None else np.minimum(limits.value(name), most)}
    return replace(limits, **bound)


def certify_motion(
    request: PlanRequest, start: MovingState, motion: Trajectory, kind: StopKind | None = None, end: float | None = None
) -> Plan:
    """Return the plan of a certified motion, with the part of the path that it covers."""
    plan, analysis = start.plan, start.rest_analysis if motion is start.rest else None
    last = plan.joint_path.end if plan.span is None else plan.span[1]
    end = (last if kind is StopKind.END else plan.joint_path.end) if end is None else end
    if isinstance(request.law, RecordedLaw) and motion is not start.rest:
        request = replace(request, law=RecordedLaw(Optimal.name, None, request.law.list_enforced(request.limits)))
    covering = replace(request, span=(start.at.s, max(start.at.s, end)), stop_kind=kind)
    return covering.certify_motion(plan.joint_path, motion, analysis=analysis)


def run_law(request: PlanRequest, joints: JointPath, limits: MotionLimits, at: PathState) -> Trajectory | None:
    """Return the law's motion from exactly this state; None if the law finds none. `optimal` replaces a recorded law."""
    law = Optimal() if isinstance(request.law, RecordedLaw) else request.law
    if at.s >= joints.end * (1.0 - 1e-9):  # no path left
        return None
    try:
        motion = check_motion(law, law.run_from(joints, limits, at), request.robot)
    except (NoSolution, InvalidInput) as error:
        if isinstance(error, InvalidInput) and law is request.law:
            raise
        return None
    assert at.joints is not None
    return match_start(motion, at.joints, limits)


def explain_infeasible(request: PlanRequest, start: MovingState, stop: bool) -> NoSolution:
    """Return why there is no motion: the state itself exceeds a limit, or the running motion does later."""
    plan, limits, robot = start.plan, request.limits, start.plan.robot
    try:
        check_statics(plan.joint_path, request.limits, request.enforced, start.at.s)
    except NoSolution as error:
        if not stop:
            return error
    goal = "comes to rest" if stop else "ends at rest"
    none = f"no motion from this state {goal} on the path within the limits"
    assert start.at.joints is not None
    _, dq, ddq = start.at.joints
    bound = limits.bounds(robot.n)
    twist = robot.jacobian(start.at.joints[0]) @ dq
    here = [(f, ratio_to_limit(x, bound[f]), robot.joint_names) for f, x in zip(DERIVATIVES, (dq, ddq), strict=False)]
    allowed = tool_limits_at(limits, plan.path, np.array([start.at.s]))[0]
    speeds = (float(np.linalg.norm(part)) / limit for part, limit in zip((twist[:3], twist[3:]), allowed, strict=True))
    here += [(f, np.array([x]), ("tool",)) for f, x in zip(TOOL_SPEEDS, speeds, strict=True)]
    field, ratios, names = max(here, key=lambda each: float(each[1].max()))
    ratio, joint = float(ratios.max()), names[int(ratios.argmax())]
    advice = "higher limits" if stop else "stop=True, or higher limits"
    if ratio > 1.0 + 1e-9:
        what = f"the state itself has {ratio:.6g} times the allowed {field.replace('_', ' ')} of {joint}"
        what += _name_both(start, limits, field, joint)
        return NoSolution(f"{none}: {what}", s=start.at.s, joint=joint, advice=f"limits {ratio:.6g} times as high")
    if start.rest is None:
        return NoSolution(f"{none} was found", s=start.at.s, advice=advice)
    proof = certify_motion(request, start, start.rest, StopKind.END).certificate
    if not proof.enforced:
        return NoSolution(f"{none} was found: {'; '.join(proof.reasons)}", s=start.at.s, advice=advice)
    field = max(proof.enforced, key=lambda f: float(np.nan_to_num(proof.worst(f)[0], posinf=np.inf)))
    ratio, joint, t = proof.worst(field)
    s = proof.s_at(t)
    what = f"the running motion reaches {ratio:.6g} times the {field.replace('_', ' ')} limit of {joint} at s = {s:.6g}"
    what += _name_both(start, limits, field, joint)
    return NoSolution(f"{none} was found; {what}", s=s, joint=joint, advice=advice)


def _name_both(start: MovingState, limits: MotionLimits, field: str, joint: str) -> str:
    """Return a text with the requested limit of a joint and that of the plan, if the limits differ."""
    robot = start.plan.robot
    if field not in DERIVATIVES or start.plan_limits == limits:
        return ""
    i = robot.joint_names.index(joint)
    low, high = (x.arrays(robot.n)[field][i] for x in (limits, start.plan_limits))
    unit = next(kind.units[int(robot.prismatic[i])] for kind in limits.kinds if kind.name == field)
    return f" (limit {low:.6g} {unit}; in the plan {high:.6g} {unit})"
