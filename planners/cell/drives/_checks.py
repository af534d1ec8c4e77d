"""Checks of drives: the plan before its start; set-points and encoders of a simulated drive at every tick."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput, InvalidMotion
from optik.types import Array
from planners.cell.drives._run import DriveRun
from planners.cell.drives.base import ExecutionStatus, Fault, FaultKind, Options, StopRequest
from planners.certificate.certificate import Certificate, check_valid
from planners.certificate.violation import Allow
from planners.following.failure import joint_unit
from planners.plan import Plan

GREATEST_STEP = 1.0 + 1e-6
"""Largest step between set-points, over the velocity limit times the period [1]: a motion at its limit is accepted."""

COUNTS = 4.0
"""Encoder counts beyond the tolerance that a set-point must move before an unchanged reading is a fault [1]."""
NOISE_SPREADS = 6.0
"""Noise that no reading exceeds, in standard deviations [1]."""
AT_STANDSTILL = (0.02, 0.002)
"""Largest velocity of a joint at rest [rad/s, m/s]; a servo that follows encoder noise is slower."""
BRAKED = (1e-4, 1e-5)
"""Largest velocity of a joint at rest with its brake applied [rad/s, m/s]."""
ENCODER_ADVICE = "repair the encoder; then resume"
"""Advice for a false reading."""
START_ADVICE = "plan from the arm's present configuration, drive.measure()"
"""Advice for an arm that is not at the start of a plan."""
RESUME_ADVICE = "drive.resume continues to the goal"
"""Advice after a stop on request."""
Refusal = tuple[str, str]
"""The reason why nothing is sent, and advice."""


# ---------------------------------------------------------------- before the start


def check_plan(plan: Plan, robot: Robot) -> None:
    """Raise InvalidInput unless the argument is a plan of this arm."""
    if not isinstance(plan, Plan):
        raise InvalidInput("plan", repr(plan)[:60], "a Plan")
    if plan.robot != robot:
        raise InvalidInput("plan", f"a plan of {plan.robot.name}", f"a plan of this drive's arm, {robot.name}")


def find_violation(plan: Plan, allow: Allow = (), proof: Certificate | None = None) -> Refusal | None:
    """Return why a plan must not be executed: no motion, violations that `allow` does not permit, or a start in motion.

    ``proof`` is the certificate that is judged; by default the plan's own.
    """
    if plan.failure is not None and (not plan.has_motion or (not plan and plan.certificate.is_valid)):
        return f"the plan did not succeed ({plan.status}): {plan.failure.reason}", plan.failure.advice
    proof = plan.certificate if proof is None else proof
    try:
        check_valid(proof, allow)
    except InvalidMotion as error:
        status = "" if plan else f" ({plan.status})"
        return f"the certificate of the plan{status} is not valid: {error.reason}", error.advice
    if not proof.rest[0]:
        return "the plan begins in motion, but the arm is at rest", START_ADVICE
    return None


def find_refusal(plan: Plan, measured: Array, options: Options) -> Refusal | None:
    """Return why a plan must not be sent: the arm is not at its start, or set-points exceed the arm's velocity limits."""
    names, start = plan.robot.joint_names, plan.trajectory(0.0)
    lost = np.flatnonzero(np.isnan(measured))
    if lost.size:
        return f"the encoder of {names[lost[0]]} is lost", "repair the encoder, and measure again"
    off = np.abs(measured - start) / options.start
    i = int(off.argmax())
    if off[i] > 1.0:
        return describe_start(plan.robot, i, measured[i], start[i], options.start[i]), START_ADVICE
    fastest, most = plan.trajectory.extrema(1).worst, _velocity_limits(plan.robot) * GREATEST_STEP
    i = int((fastest / most).argmax())
    if fastest[i] > most[i]:
        unit = f"{joint_unit(plan.robot, i)}/s"
        what = f"{names[i]} moves at {fastest[i]:.6g} {unit}, above the arm's own limit of {most[i]:.6g} {unit}"
        return f"the drive would refuse the set-points: {what}", "plan within the limits of the robot"
    return None


def describe_start(robot: Robot, i: int, q: float, start: float, tolerance: float) -> str:
    """Return the reason for an arm that is not at the start of a plan: joint i is farther from it than the tolerance."""
    unit = joint_unit(robot, i)
    at = f"{robot.joint_names[i]} is at {q:.6g} {unit}, but the plan starts at {start:.6g} {unit}"
    return f"{at}; the tolerance is {tolerance:g} {unit}"


def make_stop_test(stop: StopRequest | None) -> Callable[[float], bool]:
    """Return the function that decides at every tick whether to stop."""
    if stop is None:
        return lambda t: False
    if callable(stop):
        return stop
    when = check_number(stop, "stop", "a time [s] of at least 0, or a function of the time", least=0.0)
    return lambda t: t >= when - 1e-9


# ---------------------------------------------------------------- at every tick


def read_encoders(actual: Array, options: Options, noise: np.random.Generator) -> Array:
    """Return the readings of the encoders."""
    read = actual + options.noise * noise.standard_normal(actual.size) if options.noise else actual.copy()
    counts = np.where(options.resolution > 0.0, options.resolution, 1.0)
    return np.asarray(np.where(options.resolution > 0.0, np.round(read / counts) * counts, read))


def check_encoders(run: DriveRun, k: int, read: Array, options: Options, robot: Robot) -> None:
    """Check the encoders at tick k: none may be lost, and every joint must follow its set-points."""
    if run.fault is not None:
        return
    t, names = k * options.period, robot.joint_names
    lost = np.flatnonzero(np.isnan(read))
    if lost.size:
        joint = names[lost[0]]
        what = f"the encoder of {joint} is lost; the joint went on by its set-points until it was at rest"
        run.fail(Fault(FaultKind.ENCODER, t, joint, what, ENCODER_ADVICE), k + options.ahead)
        return
    behind = np.abs(read - run.stream.q[min(k, run.last)])
    i = int((behind / options.following).argmax())
    if behind[i] > options.following[i]:
        unit = joint_unit(robot, i)
        what = (
            f"{names[i]} reads {behind[i]:.3g} {unit} off its set-point, more than {options.following[i]:g} {unit}: the joint "
            "is blocked or too weak, or its encoder is frozen"
        )
        advice = f"check what blocks {names[i]} and its encoder; then resume, which first returns to the path"
        run.stuck = i
        run.fail(Fault(FaultKind.STALL, t, names[i], what, advice), k + options.ahead)
        return
    moved = run.encoders.update(read, run.stream.q[min(k, run.last)], t) / (
        options.following + COUNTS * options.resolution
    )
    i = int(moved.argmax())
    if moved[i] > 1.0:
        unit = joint_unit(robot, i)
        what = f"{names[i]} reads {read[i]:.6g} {unit} while its set-point moved by more than {options.following[i]:g} {unit}"
        run.stuck = i
        fault = Fault(
            FaultKind.ENCODER, t, names[i], f"{what}: its encoder is frozen, or it is blocked", ENCODER_ADVICE
        )
        run.fail(fault, k + options.ahead)


def judge_rest(run: DriveRun, k: int, read: Array, actual: Array, options: Options, robot: Robot) -> None:
    """Check the final position of the arm at the last tick k by its encoders and by the true state of the simulated arm."""
    if run.fault is not None:
        return
    t, false = k * options.period, find_false_reading(read, actual, options)
    if false is not None:
        joint, unit = robot.joint_names[false], joint_unit(robot, false)
        what = f"{joint} is at {actual[false]:.6g} {unit}, but its encoder reads {read[false]:.6g} {unit}"
        if np.isnan(read[false]):
            what = f"the encoder of {joint} is lost"
        run.fail(Fault(FaultKind.ENCODER, t, joint, what, ENCODER_ADVICE), k)
        return
    off = np.abs(read - run.stream.q[-1])
    i = int((off / options.end).argmax())
    if off[i] > options.end[i]:
        joint, unit = robot.joint_names[i], joint_unit(robot, i)
        what = f"{joint} came to rest {off[i]:.3g} {unit} off its last set-point, more than {options.end[i]:g} {unit}"
        advice = f"find out what blocks {joint}; then resume, which first returns to the path"
        run.fail(Fault(FaultKind.STALL, t, joint, f"{what}: it was blocked or is too weak", advice), k)


def find_false_reading(read: Array, actual: Array, options: Options) -> int | None:
    """Return the index of a joint whose encoder is lost or reads a false position; None if there is no such joint."""
    lost = np.flatnonzero(np.isnan(read))
    if lost.size:
        return int(lost[0])
    off = np.abs(read - actual) / (options.end + COUNTS * options.resolution + NOISE_SPREADS * options.noise)
    return int(off.argmax()) if off.max() > 1.0 else None


def judge_standing(run: DriveRun, k: int, dq: Array, false: int | None, options: Options, robot: Robot) -> bool:
    """Return whether the arm is at rest when the set-points end; if it moves, record a fault.

    After a fault, and with a false encoder, it is at rest only as far as its brakes hold it.
    """
    slowest = AT_STANDSTILL if run.fault is None and false is None else BRAKED
    speed = np.abs(dq) / np.where(robot.prismatic, *reversed(slowest))
    i = int(speed.argmax())
    if speed[i] <= 1.0:
        return True
    if run.fault is None:
        joint = robot.joint_names[i]
        what = f"{joint} moves at {abs(dq[i]):.3g} {joint_unit(robot, i)}/s when its set-points end"
        kind, why, advice = FaultKind.STALL, "it is too weak", f"find out what moves {joint}; then resume"
        if false is not None:
            joint = robot.joint_names[false]
            kind, why, advice = FaultKind.ENCODER, f"the encoder of {joint} reads a false position", ENCODER_ADVICE
        run.fail(Fault(kind, k * options.period, joint, f"{what}: {why}; the brakes were applied", advice), k)
    return False


def judge_end(run: DriveRun) -> tuple[ExecutionStatus, str, str]:
    """Return status, reason and advice of an execution that has come to rest."""
    if run.fault is not None:
        return ExecutionStatus.FAULT, run.fault.reason, run.fault.advice
    if run.requested and run.stop is not None and not run.at_goal:
        begun = run.motion.end - run.stop.trajectory.end
        return ExecutionStatus.STOPPED, f"stopped on request; the stop began at t = {begun:.6g} s", RESUME_ADVICE
    return ExecutionStatus.DONE, "", ""


def _velocity_limits(robot: Robot) -> Array:
    """Return the arm's own velocity limits (n,) [rad/s, m/s]; infinite where unknown."""
    known = robot.limits.velocity
    return np.full(robot.n, np.inf) if known is None else np.broadcast_to(known, (robot.n,))
