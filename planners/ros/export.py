"""Motions for ROS 2's joint_trajectory_controller without ROS, certified after controller interpolation."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.arm.motors import Motors, from_maker, maker_names
from optik.arm.plain import read_list
from optik.arm.robot import Robot
from optik.check import check_kind, check_number
from optik.errors import InvalidInput, NoSolution
from optik.file_io import check_suffix, parse_json, parse_yaml, write_atomically
from optik.scene.files import LONGEST_DURATION, NANOSECONDS, read_floats, read_time
from optik.types import Array
from planners.certificate.analysis import JUMP, MotionAnalysis
from planners.certificate.certificate import Certificate, check_valid
from planners.certificate.certification import conditions_of, cut_between, find_section_times
from planners.certificate.violation import Allow, required_limits
from planners.following.failure import joint_unit
from planners.limits import DERIVATIVES, SAME_SPEED
from planners.motion import HasMotion, Motion, get_motion
from planners.motion.motion import events_to_plain, find_stretch_factor
from planners.paths.program import ProgramPath
from planners.ros.transport import write_time
from planners.trajectory import Trajectory, append_rest, map_joints
from planners.trajectory.trajectory import POINTS, count_derivatives, sample_states, trajectory_through

# ---------------- the message trajectory_msgs/JointTrajectory as plain data, and its motion after controller interpolation


Times = NDArray[np.int64]
POINT_FIELDS = ("positions", "velocities", "accelerations")
"""Fields of a point that controllers interpolate through, by order of derivative."""


class Form(NamedTuple):
    """The form of a message: its interpolation, the index of each written name, its frame, and motors that are written."""

    interpolation: str
    columns: dict[str, int]
    frame_id: str = ""
    motors: Motors | None = None

    @property
    def names(self) -> list[str]:
        """The written names in the order of the robot's joints."""
        return sorted(self.columns, key=lambda name: self.columns[name])


def message_of(trajectory: Trajectory, times: Times, form: Form, stops: Array | tuple[()] = ()) -> dict[str, Any]:
    """Return the message with a trajectory's exact states at some times, at rest at its stops (k,) [s]."""
    t, order = times / NANOSECONDS, list(form.columns.values())
    states = list(sample_states(trajectory, t)[: count_derivatives(form.interpolation)])
    for stop in stops:  # times in whole nanoseconds are next to it, where the acceleration may be discontinuous
        for state in states[1:]:
            state[np.abs(times - stop * NANOSECONDS) <= 1.0] = 0.0
    if form.motors is not None:
        states = [form.motors.of(x, k) for k, x in enumerate(states)]
    values: list[Any] = [x[:, order].tolist() for x in states]
    values += [[[]] * t.size] * (len(POINT_FIELDS) - len(values))
    points = [
        {**dict(zip(POINT_FIELDS, point, strict=True)), "effort": [], "time_from_start": write_time(int(ns))}
        for ns, *point in zip(times, *values, strict=True)
    ]
    header = {"stamp": write_time(0), "frame_id": form.frame_id}  # a stamp of 0 is "now" to the controller
    return {"header": header, "joint_names": list(form.columns), "points": points}


RATES = ("rad", "rad/s", "rad/s2", "m", "m/s", "m/s2")
"""Units of messages."""


class MessagePoints(NamedTuple):
    """Setpoints: times (k,) [s] after the first one, which is at `begin` [s], and values (k, n) by order of derivative.

    `from_start` is True if the clock starts with the motion; `locate` names a row, or a joint's value in it, for errors;
    `notes` lists assumptions, `assumed` the units, such as s and rad, that the file does not state, and `stated` those it does.
    """

    t: Array
    begin: float
    values: list[Array]
    from_start: bool
    locate: Callable[..., str]
    notes: list[str]
    assumed: Collection[str] = RATES
    stated: Collection[str] = ()


def reconstruct(message: Any, names: list[str]) -> Trajectory:
    """Return the motion of a message after interpolation by ROS 2's joint_trajectory_controller.

    Between two points it interpolates by quintics if both have velocities and accelerations, by cubics if both have
    velocities, and linearly otherwise (ros2_controllers, trajectory.cpp, interpolate_between_points).
    """
    found = read_points(message, names)
    return trajectory_through(found.t, *found.values)


def read_points(message: Any, names: list[str], ignore: Collection[str] = ()) -> MessagePoints:
    """Return the setpoints of a message, or of columns: ``times`` or ``time_from_start``, ``positions`` and others."""
    check_kind(message, "content", dict, "a message with joint_names and points")
    order = order_joints(message.get("joint_names"), names, ignore)
    points, clock = message.get("points"), "times" if "times" in message else "time_from_start"
    if (times := message.get(clock)) is not None:
        rows = {field: message[field] for field in POINT_FIELDS if message.get(field)}
        for field, row in rows.items():
            read_list(row, field, f"{len(times)} rows, one for each time", len(read_list(times, clock)))
        points = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
    if not isinstance(points, list) or not points or not all(isinstance(p, dict) for p in points):
        raise InvalidInput("points", repr(points)[:60], "a list of at least one point")
    fields = [f for f in POINT_FIELDS if f == "positions" or any(p.get(f) for p in points)]
    if fields == ["positions", "accelerations"]:
        raise InvalidInput("points", "accelerations without velocities", "velocities, too")
    count, values = len(message["joint_names"]), []
    for field in fields:
        for i in [i for i, p in enumerate(points) if not p.get(field)][:1]:
            raise InvalidInput(f"points[{i}].{field}", "none", f"{count} numbers, in all points or in none")
        read = [read_floats(p.get(field), f"points[{i}].{field}", count) for i, p in enumerate(points)]
        values.append(np.array(read)[:, order])
    since = [p.get(clock, {}) for p in points] if times is None else times
    locate, from_start = (f"points[{{}}].{clock}" if times is None else f"{clock}[{{}}]").format, clock != "times"
    if times is not None and not any(isinstance(x, dict) for x in times):
        t = read_floats(times, clock, len(points))
        return MessagePoints(t - t[0], float(t[0]), values, from_start, locate, [], ("s", *RATES))
    ns = np.array([read_time(x, locate(i)) for i, x in enumerate(since)])
    return MessagePoints((ns - ns[0]) / NANOSECONDS, ns[0] / NANOSECONDS, values, from_start, locate, [], stated=["s"])


def order_joints(found: Any, names: list[str], ignore: Collection[str]) -> list[int]:
    """Return the index of each joint among the joints of a message; others must be ignored."""
    listed = list(map(str, found)) if isinstance(found, list) else []
    others = [name for name in listed if name not in names and name not in ignore]
    if len(set(listed)) != len(listed) or not set(names) <= set(listed) or others:
        got = f"{', '.join(others)} in {', '.join(listed)}" if others else repr(found)
        advice = f"ignore={','.join(others)!r} leaves joints out" if others else ""
        advice = advice if set(names) <= set(listed) else "joint_names= gives the names in the file"
        raise InvalidInput("joint_names", got[:120], f"{', '.join(names)} in any order", advice=advice)
    for name in (name for name in ignore if name not in listed or name in names):
        wanted = f"joints of the file that are not the arm's: {', '.join(listed)}"
        raise InvalidInput("ignore", repr(name)[:60], wanted[:200])
    return [listed.index(name) for name in names]


# ---------------- the message as text


def to_text(message: dict[str, Any], suffix: str, remarks: list[str]) -> str:
    """Return a message as text: JSON, or YAML with remarks as comments."""
    return json.dumps(message, allow_nan=False) + "\n" if suffix == ".json" else _to_yaml(message, remarks)


def from_text(text: str, suffix: str) -> Any:
    """Return the plain data of JSON or YAML."""
    return (parse_json if suffix == ".json" else parse_yaml)(text, "content")


def _to_yaml(message: dict[str, Any], remarks: list[str]) -> str:
    """Return block YAML with one line per list."""
    header = message["header"]
    lines = [f"# {remark}" for remark in remarks]
    lines += ["header:", f"  stamp: {_yaml_time(header['stamp'])}", f"  frame_id: {quote_name(header['frame_id'])}"]
    lines += ["joint_names:", *(f"- {quote_name(name)}" for name in message["joint_names"]), "points:"]
    for point in message["points"]:
        rows = [f"{field}: [{', '.join(map(_yaml_float, point[field]))}]" for field in (*POINT_FIELDS, "effort")]
        lines.append("- " + "\n  ".join([*rows, f"time_from_start: {_yaml_time(point['time_from_start'])}"]))
    return "\n".join(lines) + "\n"


def _yaml_time(time: dict[str, int]) -> str:
    return f"{{sec: {time['sec']}, nanosec: {time['nanosec']}}}"


def _yaml_float(value: float) -> str:
    """Return the shortest digits of a number, exact to the last bit; YAML 1.1, as in ROS, reads 1e-05 as text, not 1.0e-05."""
    digits, e, power = repr(value).partition("e")
    return f"{digits}.0e{power}" if e and "." not in digits else f"{digits}{e}{power}"


def quote_name(name: str) -> str:
    """Return a name in double quotes, as YAML and JSON escape it."""
    return json.dumps(name, ensure_ascii=False)


# ---------------- stretching to the limits after controller interpolation, and instants of points


SLOWINGS = 20
"""Largest number of slowings of a motion; two are usual."""
WHOLE_PERIOD = Fraction(1, 2 * NANOSECONDS)
"""Largest rounding error of a duration of whole periods [s]: 0.9 s is 90 periods of 100 per second, whatever its last bit."""
NEAR_KNOT = 0.1
"""Fraction of a period within which a point at a knot replaces that of the period: in shorter quintics rounding dominates."""
ADVICE = "use a motion within its own limits, points at its knots, or a higher rate"
"""Advice if the controller would exceed limits between the points."""


def fit_pace(motion: Motion, form: Form, rate: float | None, strict: bool) -> tuple[dict[str, Any], MotionAnalysis]:
    """Slow a motion until it respects the judged limits after controller interpolation."""
    source, judged = motion.trajectory, find_judged_limits(motion, form)
    between, stops = np.empty(0), np.empty(0)
    if motion.speed is not None and rate is not None:
        source, between = _hold_to_period(source, rate), source.knots
    if isinstance(motion.path, ProgramPath):  # the arm rests at its stops only if points are there
        section_times = find_section_times(motion.path, source, motion.span)[:-1]
        stops = np.array([t for stop in section_times for t in (stop.rest, stop.end)])
        between = between if rate is None else np.union1d(between, stops)
    factor, margin = 1.0, 1e-12
    for _ in range(SLOWINGS):
        paced, times = _set_pace(source, rate, factor, between)
        rests = stops * (paced.duration / source.duration)
        message = message_of(paced, times, form, rests)
        executed = reconstruct(message, form.names)
        if form.motors is not None:
            executed = map_joints(executed, form.motors.matrix, form.motors.offset)
        analysis = MotionAnalysis(motion.robot, executed, motion.path)
        needed = _find_stretch(motion, analysis, judged, rests)
        if needed <= 1.0:
            return message, analysis
        _check_slowing(motion, executed.duration / source.duration * needed, strict)
        factor, margin = executed.duration / source.duration * needed * (1.0 + margin), 10.0 * margin
    reason = f"after controller interpolation the motion exceeds its limits even at {factor:.3g} times its duration"
    raise NoSolution(reason, advice=ADVICE)


def _find_stretch(motion: Motion, executed: MotionAnalysis, judged: tuple[str, ...], stops: Array) -> float:
    """Return the stretch with which an executed motion respects its limits: for a program, the largest of its sections."""
    path, trajectory = motion.path, executed.trajectory
    if not isinstance(path, ProgramPath):
        return find_stretch_factor(executed, motion.limits, judged)
    which = path.find_sections((0.0, path.end) if motion.span is None else motion.span)
    factors = [0.0]
    for i, begin, end in zip(which, [0.0, *stops[1::2]], [*stops[::2], trajectory.end], strict=True):
        limits, _ = conditions_of(path, i, motion.limits, None)
        own = MotionAnalysis(path.robots[i], cut_between(trajectory, begin, end), path.sections[i])
        factors.append(find_stretch_factor(own, limits, tuple(name for name in judged if name in limits.names)))
    return max(factors)


def find_judged_limits(motion: Motion, form: Form) -> tuple[str, ...]:
    """Return the enforced limits that the interpolation can respect."""
    possible = [kind.name for kind in motion.limits.kinds if kind.order <= count_derivatives(form.interpolation)]
    return tuple(field for field in motion.enforced if field in possible)


def at_rest(trajectory: Trajectory) -> tuple[bool, bool]:
    """Return whether a motion starts at rest, and whether it ends at rest."""
    slow = 1e-9 * float(trajectory.extrema(1).worst.max())
    start, end = (bool((np.abs(trajectory(t, 1)) <= slow).all()) for t in (0.0, trajectory.end))
    return start, end


def _hold_to_period(trajectory: Trajectory, rate: float) -> Trajectory:
    """Append rest to a motion, to the end of its last period."""
    periods = Fraction(trajectory.duration) * Fraction(rate)
    left = math.ceil(periods - WHOLE_PERIOD * Fraction(rate)) - periods
    return append_rest(trajectory, float(left / Fraction(rate))) if left > WHOLE_PERIOD * Fraction(rate) else trajectory


def _check_slowing(motion: Motion, needed: float, strict: bool) -> None:
    exceeds = "after controller interpolation the motion exceeds its limits"
    reason = f"{exceeds}; it would respect them at {needed:.9g} times its duration"
    if strict:
        raise NoSolution(reason, advice=f"pass strict=False, which slows it; or {ADVICE}")
    if motion.speed is not None and needed > 1.0 + SAME_SPEED:
        unit = "rad/s" if motion.path.turns_only else "m/s"
        left = f"with a tool speed of {motion.speed / needed:.6g} {unit} instead of {motion.speed:.6g} {unit}"
        advice = "use quintic interpolation, or pass keep_speed=False, which slows it"
        raise NoSolution(f"{reason}, {left}", advice=advice)
    if not at_rest(motion.trajectory)[0]:
        raise NoSolution(f"{reason}, but it starts in motion and cannot be slowed", advice=ADVICE)


def _set_pace(trajectory: Trajectory, rate: float | None, factor: float, between: Array) -> tuple[Trajectory, Times]:
    """Return the motion slowed by at least a factor to whole periods or whole nanoseconds, and the times of the points [ns]."""
    # Instants `between` the periods (k,) [s] are points too; they replace points at periods that are nearly there.
    duration = Fraction(trajectory.duration) * Fraction(factor)
    if rate is None:
        times = np.rint(trajectory.knots * factor * NANOSECONDS).astype(np.int64)
        times[-1] = math.ceil(duration * NANOSECONDS)
    else:
        periods = max(math.ceil((duration - WHOLE_PERIOD) * Fraction(rate)), 1)
        if periods > POINTS:
            raise InvalidInput("rate", f"{rate:.9g}, {periods} points", f"at most {POINTS} points")
        times = np.rint(np.arange(periods + 1) * NANOSECONDS / rate).astype(np.int64)
        if between.size:
            more = np.rint(between * (times[-1] / trajectory.duration)).astype(np.int64)
            near = np.abs(times[1:-1, None] - more).min(axis=1) < NEAR_KNOT * NANOSECONDS / rate
            times = np.unique(np.concatenate([times[:1], times[1:-1][~near], times[-1:], more]))
    if (np.diff(times) <= 0).any():
        i = int(np.argmax(np.diff(times) <= 0))
        got = f"{rate}, with points {i} and {i + 1} both at {times[i]} ns"
        raise InvalidInput("rate", got, "points at least 1 ns apart" + ("" if rate else ": give a rate"))
    stretched = float(Fraction(int(times[-1]), NANOSECONDS) / Fraction(trajectory.duration))
    return (trajectory if stretched == 1.0 else trajectory.stretched(stretched)), times


# ---------------- motions for ROS 2's joint_trajectory_controller without ROS


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
        Duration of that trajectory over that of the motion [1]. The motion is stretched for whole periods and limits; one
        with a requested tool speed waits at its end instead.
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


Controllers = Mapping[str, str] | None
"""The controllers of the members of a group."""


def to_ros(
    motion: Motion | HasMotion, file: str | os.PathLike[str], *, rate: float | None = None, interpolation: str = "quintic",
    joint_names: JointNames = None, start: ArrayLike | Mapping[str, float] | None = None, tolerance: float = 0.01,
    strict: bool = False, keep_speed: bool = True, frame_id: str = "", allow: Allow = (), controllers: Controllers = None,
) -> RosExport:  # fmt: skip
    """Write a valid motion as a ``trajectory_msgs/JointTrajectory``, stretched until the controller respects its limits.

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
        Whether a motion that would have to be stretched for limits is refused.
    keep_speed : bool
        Whether a motion with a requested tool speed (``constant_speed`` with a speed) is refused instead of stretched.
    frame_id : str
        Of the message's header.
    allow : str or several
        Violations to permit, as for `planners.save`. The motion is not stretched for limits that may be exceeded.
    controllers : mapping of str to str, optional
        For the motion of a group the controller of each member, by default without a name. One file for each is written beside
        `file`, with the member's name before the suffix, its own joint names, and the same times in all of them.

    Returns
    -------
    RosExport
        The motion after controller interpolation, its certificate, and the factor by which it was stretched.

    Raises
    ------
    InvalidInput, NoSolution, OutputError
        An argument or a motion that a controller refuses; a plan that failed, or limits that no stretch meets; a file that
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
    messages: dict[FilePath, tuple[dict[str, Any], list[str]]] = {FilePath(file): (message, [])}
    if controllers is None and motion.world is not None:
        controllers = {name: f"the controller of {name}" for name in motion.world.group.members}
    if controllers is not None:
        messages = {
            FilePath(file).with_suffix(f".{name}{suffix}"): (select_joints(message, name), [f"for {one}"])
            for name, one in controllers.items()
        }
    for target, (one, remarks) in messages.items():
        text = to_text(one, suffix, [*_remarks(motion, rate, sent), *remarks])
        write_atomically(target, partial(FilePath.write_text, data=text, encoding="utf-8"))
    _write_events(FilePath(file).with_suffix(".events.json"), motion, sent)
    return sent


def select_joints(message: dict[str, Any], member: str) -> dict[str, Any]:
    """Return the message for one member of a group, whose joints are named MEMBER/JOINT, under their own names."""
    names = [name.rpartition("/") for name in message["joint_names"]]
    chosen = [i for i, (of, _, _) in enumerate(names) if of == member]
    if not chosen:
        raise InvalidInput("controllers", repr(member)[:60], " and ".join(dict.fromkeys(of for of, _, _ in names)))
    points = [
        {
            key: [value[i] for i in chosen] if isinstance(value, list) and value else value
            for key, value in point.items()
        }
        for point in message["points"]
    ]
    return message | {"joint_names": [names[i][2] for i in chosen], "points": points}


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
        text = json.dumps(events_to_plain([event.stretched(sent.factor) for event in motion.events]), indent=1)
        write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))


# ------------------------- checks


def _form(motion: Motion, interpolation: str, joint_names: JointNames, frame_id: str) -> Form:
    if not isinstance(frame_id, str) or not frame_id.isprintable():
        raise InvalidInput("frame_id", repr(frame_id)[:60], "a name")
    return Form(interpolation, find_columns(motion.robot, joint_names), frame_id, motion.robot.motors)


def _checked_rate(motion: Motion, rate: float | None, strict: bool, keep_speed: bool) -> float | None:
    """Return the rate, checked for this motion."""
    for argument, flag in (("strict", strict), ("keep_speed", keep_speed)):
        check_kind(flag, argument, bool, "True or False")
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
    if rate is not None and rate * min(LONGEST_DURATION, 10.0 * trajectory.duration) < 1.0:
        raise InvalidInput("rate", f"{rate:.9g}", "points per second", advice="is this a period?")
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


# ------------------------- proof and report


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
        f"{quote_name(motion.robot.name)}, law {quote_name(motion.law)}: {sent.points} points {at}",
        f"{sent.trajectory.duration:.9f} s: {sent.factor:.9g} times the {motion.trajectory.duration!r} s of the motion",
        "peak / limit after controller interpolation: " + ", ".join(f"{f} {r:.9g}" for f, r in worst.items()),
    ]
    if sent.jumps:
        jump = f"accelerations jump at {sent.jumps} knots, by up to {sent.largest_jump:.6g} rad/s^2 (m/s^2)"
        remarks.append(f"{jump}; a point has the mean of both sides")
    return remarks
