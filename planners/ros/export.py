"""Motions for ROS 2's joint_trajectory_controller without ROS, certified after controller interpolation."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.motors import from_maker, maker_names
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.file_io import check_suffix, write_atomically
from optik.scene.messages import LONGEST_DURATION
from planners.certificate.certificate import Certificate, check_valid
from planners.certificate.checks import JUMP
from planners.certificate.violation import Allow, required_limits
from planners.following.failure import joint_unit
from planners.limits import DERIVATIVES
from planners.motion import HasMotion, Motion, get_motion
from planners.motion.event import events_to_plain
from planners.ros.message import Form, quoted, to_text
from planners.ros.pace import ADVICE, WHOLE_PERIOD, at_rest, find_judged_limits, fit_pace
from planners.trajectory import Trajectory

JointNames = Mapping[str, str] | Sequence[str] | None

YAML_SUFFIXES = (".yaml", ".yml")
"""Suffixes that `planners.save` keeps for messages; the tools of ROS write YAML."""
MESSAGE_SUFFIXES = (".json", *YAML_SUFFIXES)
"""Suffixes of message files."""


class RosExport(NamedTuple):
    """The export of `to_ros`: the motion after controller interpolation and its certificate.

    Attributes
    ----------
    trajectory : Trajectory
        The motion after controller interpolation, in the robot's joint order.
    certificate : Certificate
        Certificate of that trajectory.
    factor : float
        Duration of that trajectory over that of the motion [1]. The motion is slowed for whole periods and for the limits; one
        with a requested tool speed is held at its end instead.
    points : int
        Number of written points.
    jumps : int
        Number of inner knots at which an acceleration jumps. A point has one value: the mean of both sides.
    largest_jump : float
        Largest of these jumps [rad/s², m/s²]; 0 if there is none.
    """

    trajectory: Trajectory
    certificate: Certificate
    factor: float
    points: int
    jumps: int
    largest_jump: float


def to_ros(
    motion: Motion | HasMotion, file: str | os.PathLike[str], *, rate: float | None = None, interpolation: str = "quintic",
    joint_names: JointNames = None, start: ArrayLike | Mapping[str, float] | None = None, tolerance: float = 0.01,
    strict: bool = False, keep_speed: bool = True, frame_id: str = "", allow: Allow = (),
) -> RosExport:  # fmt: skip
    """Write a valid motion as a ``trajectory_msgs/JointTrajectory``, slowed until the controller respects its limits.

    The motion is certified before and after controller interpolation, with its own scene and tolerance. Events of a program are
    written beside the file, as ``NAME.events.json``.

    Parameters
    ----------
    motion : Motion or Plan
        It must end at rest.
    file : str or path
        ``.yaml``, ``.yml`` or ``.json``; written whole or not at all.
    rate : float, optional
        Points per second [1/s], for a whole number of periods; by default points at the knots.
    interpolation : {"quintic", "cubic", "linear"}
        What the controller interpolates: q, q̇ and q̈; q and q̇; or q. A jerk limit is not judged with ``"cubic"``, and an
        acceleration limit is not judged with ``"linear"``, because such controllers cannot respect them.
    joint_names : mapping or sequence, optional
        Another order of the robot's joint names, or a mapping from them to the controller's.
    start : (n,) array or mapping, optional
        Current configuration of the arm, in the robot's order or by the written names [rad, m].
    tolerance : float
        Largest difference between ``start`` and the start of the motion [rad, m].
    strict : bool
        Refuse instead of slowing for limits.
    keep_speed : bool
        Refuse to slow a motion with a requested tool speed (``constant_speed`` with a speed).
    frame_id : str
        Of the message's header.
    allow : str or several
        Violations to permit, as for `planners.save`. The motion is not slowed for limits that may be exceeded.

    Returns
    -------
    RosExport
        The motion after controller interpolation, its certificate, and the factor by which it was slowed.

    Raises
    ------
    InvalidInput, NoSolution, OutputError
        An argument or a motion that a controller refuses; a plan that failed, or limits that slowing cannot meet; a file that
        cannot be written.
    InvalidMotion
        The motion, before or after controller interpolation, has a violation that ``allow`` does not permit.
    """
    suffix, motion = check_suffix(file, MESSAGE_SUFFIXES), get_motion(motion)
    options: dict[str, Any] = {"joint_names": joint_names, "frame_id": frame_id, "interpolation": interpolation}
    _form(motion, **options)
    _checked_rate(motion, rate, strict, keep_speed)
    motion.check_valid(allow)
    message, sent = ros_message(motion, rate=rate, strict=strict, keep_speed=keep_speed, allow=allow, **options)
    _check_start(motion, start, tolerance, find_columns(motion.robot, joint_names))
    text = to_text(message, suffix, _remarks(motion, rate, sent))
    write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))
    _write_events(FilePath(file).with_suffix(".events.json"), motion, sent)
    return sent


def ros_message(
    motion: Motion | HasMotion, *, rate: float | None = None, interpolation: str = "quintic", joint_names: JointNames = None,
    strict: bool = False, keep_speed: bool = True, frame_id: str = "", allow: Allow = (),
) -> tuple[dict[str, Any], RosExport]:  # fmt: skip
    """Return the message of a motion as plain data, and the certificate after controller interpolation; see `to_ros`.

    The motion itself is not certified. The message's stamp is 0, which is "now" to the controller.
    """
    motion = get_motion(motion)
    form, rate = _form(motion, interpolation, joint_names, frame_id), _checked_rate(motion, rate, strict, keep_speed)
    required = replace(motion, enforced=required_limits(motion.enforced, allow))
    message, analysis = fit_pace(required if keep_speed else replace(required, speed=None), form, rate, strict)
    executed = analysis.trajectory
    certificate = replace(motion, trajectory=executed).certify(analysis=analysis)
    _check_executed(certificate, find_judged_limits(required, form), form, allow)
    return message, _report(motion, executed, len(message["points"]), certificate)


def _write_events(file: FilePath, motion: Motion, sent: RosExport) -> None:
    """Write the events of a motion, at their times in the motion that was sent, if it has some."""
    if motion.events:
        text = json.dumps(events_to_plain([event.slowed(sent.factor) for event in motion.events]), indent=1)
        write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))


# ---------------------------------------------------------------- checks


def _form(motion: Motion, interpolation: str, joint_names: JointNames, frame_id: str) -> Form:
    if not isinstance(frame_id, str) or not frame_id.isprintable():
        raise InvalidInput("frame_id", repr(frame_id)[:60], "a name")
    return Form(interpolation, find_columns(motion.robot, joint_names), frame_id, motion.robot.motors)


def _checked_rate(motion: Motion, rate: float | None, strict: bool, keep_speed: bool) -> float | None:
    """Return the rate, checked for this motion."""
    for argument, flag in (("strict", strict), ("keep_speed", keep_speed)):
        if not isinstance(flag, bool):
            raise InvalidInput(argument, repr(flag)[:60], "True or False")
    rate = None if rate is None else check_number(rate, "rate", "points per second, above 0", above=0.0)
    _check_ends(motion.trajectory, rate)
    return rate


def find_columns(robot: Robot, joint_names: JointNames) -> dict[str, int]:
    """Return the index of the joint of each written name, in the order of writing."""
    ours = maker_names(robot)
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
    """Raise InvalidInput for a motion that controllers refuse: one that is too long or does not end at rest."""
    if rate is not None and rate * LONGEST_DURATION < 1.0:
        raise InvalidInput("rate", f"{rate:.9g}", f"periods of at most {LONGEST_DURATION} s")
    if trajectory.duration > LONGEST_DURATION:
        raise InvalidInput("motion", f"{trajectory.duration:.3g} s", f"at most {LONGEST_DURATION} s")
    start, end = at_rest(trajectory)
    if not end:
        speed = np.abs(trajectory(trajectory.end, 1)).max()
        raise InvalidInput("motion", f"a speed of {speed:.3g} at its end", "a motion that ends at rest")
    periods = Fraction(trajectory.duration) * Fraction(rate or 1.0)
    if rate is not None and not start and abs(periods - round(periods)) > WHOLE_PERIOD * Fraction(rate):
        wanted = "none, or one that divides the duration: a motion that starts in motion cannot be slowed"
        raise InvalidInput("rate", f"{rate:.9g}", wanted)


def _check_start(motion: Motion, start: Any, tolerance: float, columns: dict[str, int]) -> None:
    check_number(tolerance, "tolerance", "rad or m, at least 0", least=0.0)
    if start is None:
        return
    if isinstance(start, Mapping):
        missing = [name for name in columns if name not in start]
        if missing:
            raise InvalidInput("start", f"none for {', '.join(missing)}", f"positions of {', '.join(columns)}")
        given = [start[name] for name in sorted(columns, key=lambda name: columns[name])]
        start = from_maker(motion.robot, motion.robot.configuration(given, "start"))
    off = np.abs(motion.robot.configuration(start, "start") - motion.trajectory(0.0))
    if (off > tolerance).any():
        i = int(np.argmax(off))
        unit = joint_unit(motion.robot, i)
        got = f"{motion.robot.joint_names[i]} {off[i]:.6g} {unit} from the start of the motion"
        raise InvalidInput("start", got, f"an arm within {tolerance:g} {unit} of the start")


# ---------------------------------------------------------------- proof and report


def _check_executed(certificate: Certificate, required: tuple[str, ...], form: Form, allow: Allow) -> None:
    """Raise InvalidMotion if the controller's motion violates a required limit, its path or its clearance."""
    judged = replace(certificate, enforced=required)
    if form.interpolation == "linear":  # velocities of lines jump, also at the end
        judged = replace(judged, continuous=max(certificate.continuous, 1), rest=(certificate.rest[0], True))
    check_valid(judged, allow, "after controller interpolation, ", ADVICE)


def _report(motion: Motion, executed: Trajectory, points: int, certificate: Certificate) -> RosExport:
    source = motion.trajectory
    jumps = np.abs(source.jumps(2)).max(axis=1, initial=0.0)
    jumps = jumps[jumps > JUMP * max(source.extrema(2).worst.max(), 1e-12)]
    factor = executed.duration / source.duration
    return RosExport(executed, certificate, factor, points, jumps.size, float(jumps.max(initial=0.0)))


def _remarks(motion: Motion, rate: float | None, sent: RosExport) -> list[str]:
    """Return comment lines for readers of the file: the motion, its duration, and its peaks after controller interpolation."""
    at = f"at {rate:.9g} per second" if rate is not None else "at the knots of the motion"
    worst = {f: sent.certificate.worst(f)[0] for f in DERIVATIVES}
    remarks = [
        f"{quoted(motion.robot.name)}, law {quoted(motion.law)}: {sent.points} points {at}",
        f"{sent.trajectory.duration:.9f} s: {sent.factor:.9g} times the {motion.trajectory.duration!r} s of the motion",
        "peak / limit after controller interpolation: " + ", ".join(f"{f} {r:.9g}" for f, r in worst.items()),
    ]
    if sent.jumps:
        jump = f"accelerations jump at {sent.jumps} knots, by up to {sent.largest_jump:.6g} rad/s^2 (m/s^2)"
        remarks.append(f"{jump}; a point has the mean of both sides")
    return remarks
