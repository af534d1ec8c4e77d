"""Motions for ROS 2's joint_trajectory_controller, without ROS; certified as that controller will execute them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput, NoSolution
from optik.files import write_whole
from optik.types import Array
from planners.certificate.certificate import Certificate, certify
from planners.certificate.continuity import JUMP
from planners.controller import POINTS, points_of
from planners.files._reading import content_of, suffix_of, text_of
from planners.files._ros_message import LONGEST, SECOND, Form, Times, controlled, from_text, message_of, quoted, to_text
from planners.fit import stretch
from planners.limits import DERIVATIVES, SAME_SPEED
from planners.motion import Motion, motion_of
from planners.splice import held
from planners.trajectory import Trajectory

if TYPE_CHECKING:
    from planners.plan import Plan

JointNames = Mapping[str, str] | Sequence[str] | None

SUFFIXES = (".yaml", ".yml", ".json")
ROUNDS = 20
"""How often a motion is slowed before it is given up."""
ROUNDING = Fraction(1, 2 * SECOND)
"""Durations this near to whole periods [s] are whole: 0.9 s is 90 periods of 100 per second, whatever its last bit."""
NEAR = 0.1
"""Part of a period within which a point at a knot replaces one at the period: shorter quintics drown in rounding."""
ADVICE = "a motion that keeps its own limits, points at its knots, or a higher rate"


class Sent(NamedTuple):
    """What `to_ros` wrote, and what the controller makes of it.

    Attributes
    ----------
    trajectory : Trajectory
        What the controller executes, in the robot's joint order.
    certificate : Certificate
        Of that trajectory.
    factor : float
        How many times as long as the motion it takes: for whole periods (slowed, or held at its end where a tool speed was
        asked), and to keep the limits.
    points : int
        How many were written.
    jumps : int
        Knots inside the motion where an acceleration jumps. A point carries one value: the mean of both sides.
    largest_jump : float
        The largest of them [rad/s² or m/s²]; 0 where there is none.
    """

    trajectory: Trajectory
    certificate: Certificate
    factor: float
    points: int
    jumps: int
    largest_jump: float


def to_ros(
    motion: Motion | Plan,
    file: str | os.PathLike[str],
    *,
    rate: float | None = None,
    interpolation: str = "quintic",
    joint_names: JointNames = None,
    start: ArrayLike | Mapping[str, float] | None = None,
    tolerance: float = 0.01,
    strict: bool = False,
    keep_speed: bool = True,
    frame_id: str = "",
) -> Sent:
    """Write a motion as a ``trajectory_msgs/JointTrajectory``, whole or not at all.

    What ROS 2's joint_trajectory_controller makes of the points is rebuilt and certified: quintics through positions,
    velocities and accelerations, cubics without accelerations, lines without velocities. Where that exceeds limits
    which the law promises, the motion is slowed uniformly; what the chosen interpolation cannot keep (accelerations
    of lines, jerks of cubics) is in the certificate, not repaired.

    Parameters
    ----------
    motion : Motion or Plan
        It must end at rest.
    file : str or path
        ``.yaml``, ``.yml`` or ``.json``.
    rate : float, optional
        Points per second; the motion is slowed to a whole number of periods. Where a tool speed was asked of its law, it is
        held at its end to a whole number of them instead, and its knots are points too, so that the controller makes exactly
        this motion of them. By default points at its knots, and the motion is slowed to a whole number of nanoseconds.
    interpolation : str
        ``"quintic"``, ``"cubic"`` or ``"linear"``: what is written for the controller to interpolate through.
    joint_names : mapping or sequence, optional
        Another order of the robot's joint names; or a mapping from them to the controller's, in the controller's order.
    start : (n,) array or mapping, optional
        Where the arm stands now, in the robot's order, or by the written names [rad or m].
    tolerance : float
        How far from there the motion may start [rad or m].
    strict : bool
        Refuse instead of slowing for limits.
    keep_speed : bool
        Refuse to slow a motion whose tool speed was asked (``constant_speed`` with a speed). ``False`` treats it as any other.
    frame_id : str
        Of the header.

    Returns
    -------
    Sent
        What the controller executes, its certificate, and by how much the motion was slowed.

    Raises
    ------
    InvalidInput
        Arguments that cannot be meant, names that are not the robot's, an arm that stands elsewhere, a motion that does
        not end at rest, times that would not increase.
    NoSolution
        A plan that failed; or the controller would leave the limits, and slowing is refused, would change the tool speed
        that was asked, or does not help.
    OutputError
        The file cannot be written.
    """
    suffix = suffix_of(file, SUFFIXES)
    motion = motion_of(motion)
    if not isinstance(frame_id, str) or not frame_id.isprintable():
        raise InvalidInput("frame_id", repr(frame_id)[:60], "a name")
    form = Form(interpolation, _columns(motion.robot, joint_names), frame_id)
    for argument, flag in (("strict", strict), ("keep_speed", keep_speed)):
        if not isinstance(flag, bool):
            raise InvalidInput(argument, repr(flag)[:60], "True or False")
    rate = None if rate is None else check_number(rate, "rate", "points per second, above 0", above=0.0)
    _check_ends(motion.trajectory, rate)
    _check_start(motion, start, tolerance, form)
    message, executed = _fitted(motion if keep_speed else replace(motion, speed=None), form, rate, strict)
    sent = _report(motion, executed, len(message["points"]), _proved(motion, executed, form))
    text = to_text(message, suffix, _remarks(motion, rate, sent))
    write_whole(file, lambda part: part.write_text(text, encoding="utf-8"))
    return sent


def from_ros(file: str | os.PathLike[str], robot: Robot, *, joint_names: JointNames = None) -> Trajectory:
    """Read a ``trajectory_msgs/JointTrajectory`` as the motion that ROS 2's joint_trajectory_controller makes of it.

    Parameters
    ----------
    file : str or path
        ``.yaml`` or ``.yml`` (needs PyYAML), or ``.json``.
    robot : Robot
        The arm.
    joint_names : mapping, optional
        From the robot's joint names to the file's, as for `to_ros`; the order is the file's.

    Returns
    -------
    Trajectory
        In the robot's joint order.

    Raises
    ------
    InvalidInput
        No such file, or no such message: what is wrong is named.
    MissingDependency
        YAML without PyYAML.
    """
    suffix = suffix_of(file, SUFFIXES)
    if not isinstance(robot, Robot):
        raise InvalidInput("robot", repr(robot)[:60], "a Robot")
    form = Form("quintic", _columns(robot, joint_names))
    try:
        return controlled(from_text(text_of(content_of(FilePath(file))), suffix), form.names)
    except InvalidInput as error:
        raise InvalidInput(f"{file}: {error.argument}", error.got, error.expected) from None


# ---------------------------------------------------------------- checks


def _columns(robot: Robot, joint_names: JointNames) -> dict[str, int]:
    """Which of the robot's joints each written name is, in the order of writing."""
    ours = robot.joint_names
    if joint_names is None:
        chosen: dict[Any, Any] = {name: name for name in ours}
    elif isinstance(joint_names, Mapping):
        chosen = dict(joint_names)
    elif isinstance(joint_names, Sequence) and not isinstance(joint_names, str) and len(joint_names) == robot.n:
        chosen = {name: name for name in joint_names}
    else:
        raise InvalidInput("joint_names", repr(joint_names)[:120], f"the names {', '.join(ours)} in any order")
    if set(chosen) != set(ours):
        raise InvalidInput("joint_names", ", ".join(map(str, chosen))[:120], f"each of {', '.join(ours)} once")
    names = list(chosen.values())
    if not all(isinstance(n, str) and n and n.isprintable() for n in names) or len(set(names)) != len(names):
        raise InvalidInput("joint_names", repr(names)[:120], "different names that can be printed")
    return {name: ours.index(our) for our, name in chosen.items()}


def _check_ends(trajectory: Trajectory, rate: float | None) -> None:
    """A controller refuses a motion that does not end at rest, and one that starts on the move cannot be slowed."""
    if rate is not None and rate * LONGEST < 1.0:
        raise InvalidInput("rate", f"{rate:.9g}", f"periods of at most {LONGEST} s")
    if trajectory.duration > LONGEST:
        raise InvalidInput("motion", f"{trajectory.duration:.3g} s", f"at most {LONGEST} s")
    start, end = _rest(trajectory)
    if not end:
        speed = np.abs(trajectory(trajectory.end, 1)).max()
        raise InvalidInput("motion", f"a speed of {speed:.3g} at its end", "a motion that ends at rest")
    periods = Fraction(trajectory.duration) * Fraction(rate or 1.0)
    if rate is not None and not start and abs(periods - round(periods)) > ROUNDING * Fraction(rate):
        wanted = "none, or one that divides the duration of a motion that starts on the move and cannot be slowed"
        raise InvalidInput("rate", f"{rate:.9g}", wanted)


def _rest(trajectory: Trajectory) -> tuple[bool, bool]:
    slow = 1e-9 * float(trajectory.extrema(1).worst.max())
    start, end = (bool((np.abs(trajectory(t, 1)) <= slow).all()) for t in (0.0, trajectory.end))
    return start, end


def _check_start(motion: Motion, start: Any, tolerance: float, form: Form) -> None:
    check_number(tolerance, "tolerance", "rad or m, at least 0", least=0.0)
    if start is None:
        return
    if isinstance(start, Mapping):
        missing = [name for name in form.columns if name not in start]
        if missing:
            raise InvalidInput("start", f"none for {', '.join(missing)}", f"positions of {', '.join(form.columns)}")
        start = [start[name] for name in form.names]
    off = np.abs(motion.robot.configuration(start, "start") - motion.trajectory(0.0))
    if (off > tolerance).any():
        i = int(np.argmax(off))
        got = f"{motion.robot.joint_names[i]} {off[i]:.6g} from where the motion starts"
        raise InvalidInput("start", got, f"an arm within {tolerance:g} rad or m of it")


# ---------------------------------------------------------------- pace


def _judged(motion: Motion, form: Form) -> tuple[str, ...]:
    """Of the limits that the law promises, those that the interpolation can keep."""
    possible = [kind.name for kind in motion.limits.kinds if kind.order <= points_of(form.interpolation)]
    return tuple(field for field in motion.keeps if field in possible)


def _fitted(motion: Motion, form: Form, rate: float | None, strict: bool) -> tuple[dict[str, Any], Trajectory]:
    """Message, and what the controller makes of it: slowed until that keeps the limits that are judged."""
    source, judged = motion.trajectory, _judged(motion, form)
    between = np.empty(0)
    if motion.speed is not None and rate is not None:
        source, between = _whole(source, rate), source.knots
    factor, margin = 1.0, 1e-12
    for _ in range(ROUNDS):
        message = message_of(*_paced(source, rate, factor, between), form)
        executed = controlled(message, form.names)
        needed = stretch(motion.robot, executed, motion.limits, judged)
        if needed <= 1.0:
            return message, executed
        _check_slowing(motion, executed.duration / source.duration * needed, strict)
        factor, margin = executed.duration / source.duration * needed * (1.0 + margin), 10.0 * margin
    reason = f"{factor:.3g} times as long it would still leave its limits as the controller interpolates"
    raise NoSolution(reason, advice=ADVICE)


def _whole(trajectory: Trajectory, rate: float) -> Trajectory:
    """The motion, held where it ends to the end of the period."""
    periods = Fraction(trajectory.duration) * Fraction(rate)
    left = math.ceil(periods - ROUNDING * Fraction(rate)) - periods
    return held(trajectory, float(left / Fraction(rate))) if left > ROUNDING * Fraction(rate) else trajectory


def _check_slowing(motion: Motion, needed: float, strict: bool) -> None:
    reason = f"as the controller interpolates, the motion leaves its limits; {needed:.9g} times as long it would not"
    if strict:
        raise NoSolution(reason, advice=f"strict=False, which slows it; {ADVICE}")
    if motion.speed is not None and needed > 1.0 + SAME_SPEED:
        raise NoSolution(
            f"{reason}, with a tool speed of {motion.speed / needed:.6g}, and {motion.speed:.6g} was asked",
            advice="quintic interpolation, or keep_speed=False, which slows it",
        )
    if not _rest(motion.trajectory)[0]:
        raise NoSolution(f"{reason}, but it starts on the move and cannot be slowed", advice=ADVICE)


def _paced(trajectory: Trajectory, rate: float | None, factor: float, between: Array) -> tuple[Trajectory, Times]:
    """The motion slowed by at least a factor to whole periods, or nanoseconds; and the times of the points [ns].

    Instants `between` the periods (k,) [s] are points too, instead of those of a period that are nearly there.
    """
    duration = Fraction(trajectory.duration) * Fraction(factor)
    if rate is None:
        times = np.rint(trajectory.knots * factor * SECOND).astype(np.int64)
        times[-1] = math.ceil(duration * SECOND)
    else:
        periods = max(math.ceil((duration - ROUNDING) * Fraction(rate)), 1)
        if periods > POINTS:
            raise InvalidInput("rate", f"{rate:.9g}, {periods} points", f"at most {POINTS} points")
        times = np.rint(np.arange(periods + 1) * SECOND / rate).astype(np.int64)
        if between.size:
            more = np.rint(between * factor * SECOND).astype(np.int64)
            near = np.abs(times[1:-1, None] - more).min(axis=1) < NEAR * SECOND / rate
            times = np.unique(np.concatenate([times[:1], times[1:-1][~near], times[-1:], more]))
    if (np.diff(times) <= 0).any():
        i = int(np.argmax(np.diff(times) <= 0))
        got = f"{rate}, which puts points {i} and {i + 1} at the same {times[i]} ns"
        raise InvalidInput("rate", got, "points at least 1 ns apart" + ("" if rate else ": give a rate"))
    stretched = float(Fraction(int(times[-1]), SECOND) / Fraction(trajectory.duration))
    return (trajectory if stretched == 1.0 else trajectory.slowed(stretched)), times


# ---------------------------------------------------------------- proof and report


def _proved(motion: Motion, executed: Trajectory, form: Form) -> Certificate:
    """Certificate of what the controller makes of the points; nothing is written that breaks what is judged."""
    certificate = certify(
        motion.robot, motion.path, executed, motion.limits, law=motion.law, keeps=motion.keeps, span=motion.span
    )
    judged = replace(certificate, keeps=_judged(motion, form))
    if form.interpolation == "linear":  # its velocity jumps, as asked, and so it does at the end
        judged = replace(judged, continuous=max(certificate.continuous, 1), rest=(certificate.rest[0], True))
    if judged.broken:
        raise NoSolution(f"as the controller interpolates, {'; '.join(judged.broken)}", advice=ADVICE)
    return certificate


def _report(motion: Motion, executed: Trajectory, points: int, certificate: Certificate) -> Sent:
    source = motion.trajectory
    jumps = np.abs(source.jumps(2)).max(axis=1, initial=0.0)
    jumps = jumps[jumps > JUMP * max(source.extrema(2).worst.max(), 1e-12)]
    factor = executed.duration / source.duration
    return Sent(executed, certificate, factor, points, jumps.size, float(jumps.max(initial=0.0)))


def _remarks(motion: Motion, rate: float | None, sent: Sent) -> list[str]:
    """What a reader of the file should know, for its comments."""
    at = f"at {rate:.9g} per second" if rate is not None else "at the knots of the motion"
    worst = {f: sent.certificate.worst(f)[0] for f in DERIVATIVES}
    remarks = [
        f"{quoted(motion.robot.name)}, law {quoted(motion.law)}: {sent.points} points {at}",
        f"{sent.trajectory.duration:.9f} s: {sent.factor:.9g} times the {motion.trajectory.duration!r} s of the motion",
        "worst over limit, as the controller interpolates: " + ", ".join(f"{f} {r:.9g}" for f, r in worst.items()),
    ]
    if sent.jumps:
        jump = f"accelerations jump at {sent.jumps} knots, by up to {sent.largest_jump:.6g} rad/s^2 (m/s^2)"
        remarks.append(f"{jump}; a point carries the mean of both sides")
    return remarks
