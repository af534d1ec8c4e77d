"""Programs in TOML, in millimetres, degrees and seconds, as their keys say.

robot = "ur5e"                            # a name, or a file below this one's folder
start = "home"                            # a configuration, or joints
[configurations]
home = [0, -90, 90, -90, -90, 0]          # degrees; millimetres for joints that slide
[frames.fixture]
xyz_mm = [400, 0, 20]
frame = "cell"                            # the frame in which it is given, by default the base
[[part]]
pose = { frame = "fixture", xyz_mm = [0, 0, 100], rpy_deg = [180, 0, 0] }
move = "joint"                            # or line (default), or arc with via_mm
blend_mm = 20
[[part]]
payload_kg = 1.5                          # a change of the tool or of the payload; or dwell_s, a wait
[[event]]
part = 1                                  # its number without waits and changes of the tool, or its name
distance_mm = -50                         # or fraction, or spacing_mm, or time_s without a part
signal = "gun"

docs/programs.md lists all keys, and examples/programs has whole programs.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from optik import load, se3
from optik.arm.inertia import Payload
from optik.arm.model import check_range, unit_factors
from optik.arm.plain import read_list, read_pose, read_record, read_vector, read_word
from optik.arm.robot import Robot
from optik.check import check_flag, check_kind, check_number, locate_error
from optik.errors import InvalidInput, OptikError
from optik.file_io import decode_text, parse_toml, read_bytes
from optik.plugins.files import find_nearest_name, is_path
from optik.tables import read_table
from optik.types import Array, Indices
from planners.paths.arc import Arc
from planners.paths.base import Path
from planners.paths.polyline import Polyline
from planners.paths.spline import Spline
from planners.paths.waypoints import read_waypoints
from planners.program.events import MOST_EVENTS, PASSED, PathEvent, PeriodicEvent, Scheduled, TimedEvent, find_part
from planners.program.parts import KEEP, Dwell, Item, Move, Part, Program, ToolChange, displace, make_part_path

FILE_KEYS = ("robot", "start", "configurations", "frames", "part", "event")
"""Keys of a file."""
GOALS = ("joints", "configuration", "pose", "start_of", "vector_mm", "polyline", "spline")
"""Keys of the goal of a part, of which it has one."""
MOVE_KEYS = {
    "pose": ("move", "via_mm"), "start_of": ("move", "offset_mm"), "vector_mm": ("frame",),
    "polyline": ("frame", "within_mm"), "spline": ("frame", "within_mm"),
}  # fmt: skip
"""Further keys of the parts with a goal."""
PART_KEYS = ("name", "blend_mm", "blend_rotation_deg", "tool_speed_mm_s", "rotation_speed_deg_s", "avoid")
"""Further keys of every part with a goal."""
CHANGE_KEYS = ("tool", "payload_kg", "payload_com_mm")
"""Keys of a change of the tool."""
ALL_KEYS = (*GOALS, "dwell_s", *CHANGE_KEYS, *PART_KEYS, *itertools.chain(*MOVE_KEYS.values()))
"""All keys of parts."""
EVENT_KEYS = ("part", "distance_mm", "fraction", "spacing_mm", "time_s", "signal", "value", "before_s", "after_s")
"""Keys of an event."""
UNITS = {"_mm_s": (1e-3, "mm/s"), "_deg_s": (np.pi / 180.0, "°/s"), "_mm": (1e-3, "mm"), "_deg": (np.pi / 180.0, "°"),
         "_kg": (1.0, "kg"), "_s": (1.0, "s")}  # fmt: skip
"""Factors to SI units, and units, by the ends of keys."""
ABOVE_ZERO = ("blend_rotation_deg", "tool_speed_mm_s", "rotation_speed_deg_s", "within_mm", "spacing_mm")
"""Keys of numbers above 0; all others but the distance of an event are at least 0."""
WITHIN = {"polyline": (1e-3, 1e-2), "spline": (1e-4, 1e-3)}
"""Tolerances of the paths of tables [m, rad], by default."""
ARM_SUFFIXES = (".toml", ".json", ".urdf")
"""Files of arms that a program may name: reading them runs no code."""
MOST_PROGRAM_BYTES = 2**24
"""Largest file that is read [bytes]."""


class ProgramFile(NamedTuple):
    """The content of a program's file: the arm, its start (n,) or None, the program, and its events."""

    robot: Robot
    start: Array | None
    program: Program
    events: tuple[Scheduled, ...]


def load_program(
    file: str | os.PathLike[str], robot: Robot | str | None = None, start: Array | None = None,
    order: Indices | None = None,
) -> ProgramFile:  # fmt: skip
    """Read a program from a TOML file.

    Parameters
    ----------
    file : str or path
        The file; docs/programs.md lists its keys. Files that it names are below its folder.
    robot : Robot or str, optional
        The arm, instead of the one that the file names.
    start : (n,) array, optional
        The start [rad, m], instead of the file's.
    order : (n,) array of int, optional
        For the chain of a group: the indices of its joints in the group, in whose order the file gives joints.

    Returns
    -------
    ProgramFile
        With ``robot``, ``start`` (None if there is none), ``program`` and ``events``.

    Raises
    ------
    InvalidInput
        A mistake, in one line: the part, the key, and what is allowed. No code is run from the file.
    """
    content, mistakes = read_program(file, robot, start, order)
    if content is None:
        raise mistakes[0]
    return content


def find_robot(file: str | os.PathLike[str]) -> str:
    """Return the name or the path of the arm that a program names."""
    return _Reader(file).find_robot()


def read_program(
    file: str | os.PathLike[str], robot: Robot | str | None = None, start: Array | None = None,
    order: Indices | None = None,
) -> tuple[ProgramFile | None, list[InvalidInput]]:  # fmt: skip
    """Return the content of a file, and its mistakes: the first one of each part and event. With mistakes it has none."""
    try:
        reader = _Reader(file, slice(None) if order is None else order)
        return reader.read(reader.find_robot() if robot is None else robot, start), reader.mistakes
    except InvalidInput as error:
        return None, [error]


class _Reader:
    """Reads the parts of a file one after another; `where` names the one that is read, `mistakes` are those found.

    `paths` are the moves that were read, with their paths in space where these are known.
    """

    def __init__(self, file: str | os.PathLike[str], order: Indices | slice = slice(None)) -> None:
        self.file, self.where, self.mistakes, self.order = FilePath(file), "", list[InvalidInput](), order
        self.paths = list[tuple[Part, Path | None]]()
        content = decode_text(read_bytes(self.file, most=MOST_PROGRAM_BYTES), str(file))
        self.data = read_record(parse_toml(content, str(file)), (), f"{file}: keys", optional=FILE_KEYS)

    def read(self, robot: Robot | str, start: Array | None) -> ProgramFile | None:
        """Return the content; None with mistakes."""
        try:
            arm = robot if isinstance(robot, Robot) else load(read_word(robot, "robot"))
            given, begin = self.data.get("start"), None if start is None else arm.configuration(start, "start")
            if begin is None and given is not None:
                read = self._read_configuration if isinstance(given, str) else self._read_joints
                begin = read(arm, given, "start")
            items = self._read_items(arm, begin)
            events = self._read_events()
            self.where = ""
            if not self.paths and not self.mistakes:
                raise InvalidInput("[[part]]", "none", f"at least one with a goal: {', '.join(GOALS)}")
            return None if self.mistakes else ProgramFile(arm, begin, Program(items), events)
        except OptikError as error:
            self._note(error)
            return None

    def _note(self, error: OptikError) -> None:
        """Add a mistake, with the file and the place in it, once."""
        place = f"{self.file}{f': {self.where}' if self.where else ''}"
        other = InvalidInput(place, str(error), "a program")
        named = locate_error(place, error) if isinstance(error, InvalidInput) else other
        if str(named) not in map(str, self.mistakes):  # of a frame or a table that several parts have
            self.mistakes.append(named)

    def _enter(self, kind: str, i: int, row: Any) -> None:
        """Go to a table of the file."""
        name = row.get("name") if isinstance(row, Mapping) else None
        self.where = f"[[{kind}]] {i + 1}{f' {name!r}' if isinstance(name, str) else ''}"

    def find_robot(self) -> str:
        """Return the name or the path of the arm; reading it runs no code."""
        name = self.data.get("robot")
        try:
            if name is None:
                raise InvalidInput("robot", "none in the file, and none given", "the name or the file of an arm")
            word = read_word(name, "robot")
            if not is_path(word) and ":" not in word:
                return word
            if FilePath(word).suffix.lower() not in ARM_SUFFIXES:  # a Python file or a xacro file would run code
                expected = f"a name from optik.robots(), or a file {', '.join(ARM_SUFFIXES)}"
                raise InvalidInput("robot", repr(word)[:80], expected)
            return str(self._below(word, "robot"))
        except InvalidInput as error:
            raise locate_error(self.file, error) from None

    # ------------------------------------------------------------ values

    def _rows(self, key: str) -> list[Any]:
        self.where = ""
        return read_list(self.data.get(key, []), key, f"a list of tables: [[{key}]]")

    def _below(self, name: Any, key: str) -> FilePath:
        """Return a file below the program's folder."""
        given, folder = FilePath(read_word(name, key)), self.file.parent.resolve()
        found = (folder / given).resolve()
        if given.is_absolute() or not found.is_relative_to(folder):
            raise InvalidInput(key, repr(name)[:80], "a file below the folder of the program, relative to it")
        return found

    def _read_joints(self, arm: Robot, value: Any, key: str) -> Array:
        """Return joints inside their ranges."""
        return check_range(arm, read_vector(value, key, arm.n)[self.order] / unit_factors(arm), key)

    def _read_configuration(self, arm: Robot, name: Any, key: str) -> Array:
        found = _look_up(key, name, self.data.get("configurations", {}))
        return self._read_joints(arm, found, f"configurations.{name}")

    def _read_pose(self, data: Any, key: str, seen: tuple[str, ...] = ()) -> Array:
        """Return a pose in the base, from the frame that it names."""
        pose = read_pose(data, key, optional=("frame",))
        return np.asarray(self._read_frame(data["frame"], f"{key}.frame", seen) @ pose if "frame" in data else pose)

    def _read_frame(self, name: Any, key: str, seen: tuple[str, ...] = ()) -> Array:
        found = _look_up(key, name, self.data.get("frames", {}))
        if name in seen:
            raise InvalidInput(key, f"the cycle {' -> '.join((*seen, name))}", "a frame that does not refer to itself")
        here, self.where = self.where, ""  # a mistake in it is the frame's, not the part's
        pose = self._read_pose(found, f"frames.{name}", (*seen, name))
        self.where = here
        return pose

    def _number(self, row: Mapping[str, Any], key: str) -> float | None:
        """Return a number in SI units, or None."""
        if key not in row:
            return None
        factor, unit = next(unit for end, unit in UNITS.items() if key.endswith(end))
        above = 0.0 if key in ABOVE_ZERO else None
        least = 0.0 if above is None and key != "distance_mm" else None
        words = " above 0" if above is not None else " of at least 0" if least is not None else ""
        return factor * check_number(row[key], key, f"a number{words} [{unit}]", above=above, least=least)

    # ------------------------------------------------------------ parts

    def _read_items(self, arm: Robot, start: Array | None) -> list[Item]:
        """Return the items of the program; the pose of the tool is known from part to part, for arcs and tables."""
        rows, items, robot = self._rows("part"), list[Item](), arm
        pose = None if start is None else robot.fk(start)
        for i, row in enumerate(rows):
            self._enter("part", i, row)
            try:
                item = self._read_item(robot, row, pose, rows)
                changed = item.apply(robot) if isinstance(item, ToolChange) else robot
                self._check_zone(row, [after for after in rows[i + 1 : i + 2] if isinstance(after, Mapping)])
            except OptikError as error:
                self._note(error)
                continue
            items.append(item)
            if changed is not robot:
                pose = None if pose is None else pose @ se3.inverse(robot.tool) @ changed.tool
                robot = changed
            elif isinstance(item, Part):
                self.paths.append((item, make_part_path(item, pose)))
                pose = _end_of(item, robot, pose)
        return items

    @staticmethod
    def _check_zone(row: Mapping[str, Any], after: list[Any]) -> None:
        """Raise InvalidInput for a zone at a stop."""
        if row.get("blend_mm") and (not after or {"dwell_s", *CHANGE_KEYS} & set(after[0])):
            where = "before a wait or a change of the tool" if after else "at the last part"
            raise InvalidInput("blend_mm", f"{row['blend_mm']!r} {where}", "0, or none: the arm stops there")
        if "blend_rotation_deg" in row and not row.get("blend_mm"):
            raise InvalidInput("blend_rotation_deg", f"{row['blend_rotation_deg']!r} without blend_mm", "blend_mm, too")

    def _read_item(self, robot: Robot, row: Any, pose: Array | None, rows: list[Any]) -> Item:
        check_kind(row, "part", Mapping, "a table")
        if "dwell_s" in row:
            read_record(row, ("dwell_s",), "keys")
            return Dwell(self._number(row, "dwell_s") or 0.0)
        if any(key in row for key in CHANGE_KEYS):
            return self._read_change(robot, row)
        goals = [key for key in GOALS if key in row]
        if len(goals) != 1:
            got = " and ".join(goals) if goals else f"none among the keys {', '.join(row) or 'of an empty table'}"
            expected = f"one of: {', '.join(GOALS)}; or dwell_s, or {', '.join(CHANGE_KEYS)}"
            near = next((near for key in row if key != (near := find_nearest_name(key, ALL_KEYS)) and near), "")
            raise InvalidInput("goal", got, expected, advice=f"did you mean {near}?" if near else "")
        read_record(row, tuple(goals), "keys", optional=(*MOVE_KEYS.get(goals[0], ()), *PART_KEYS))
        move = row.get("move")
        if move not in (None, "line", "joint", "arc"):
            raise InvalidInput("move", repr(move)[:60], '"line", "joint" or "arc"')
        goal = self._read_goal(robot, goals[0], row, pose, rows)
        return Part(
            goal, None if isinstance(goal, Path) else move, row.get("name"), self._number(row, "blend_mm") or 0.0,
            self._number(row, "blend_rotation_deg") if row.get("blend_mm") else None, self._number(row, "tool_speed_mm_s"),
            self._number(row, "rotation_speed_deg_s"), check_flag(row.get("avoid", False), "avoid"),
        )  # fmt: skip

    def _read_goal(self, robot: Robot, kind: str, row: Mapping[str, Any], pose: Array | None, rows: list[Any]) -> Any:
        if kind == "joints":
            return self._read_joints(robot, row[kind], kind)
        if kind == "configuration":
            return self._read_configuration(robot, row[kind], kind)
        if kind == "vector_mm":
            return Move(read_vector(row[kind], kind) * 1e-3, row.get("frame", "tool"))
        if kind == "start_of":
            return self._find_start(robot, row, pose, rows)
        if kind != "pose":
            return self._read_table(robot, kind, row, pose)
        goal = self._read_pose(row[kind], kind)
        if (row.get("move") == "arc") != ("via_mm" in row):
            got, expected = ("a point", 'none, or move = "arc"') if "via_mm" in row else ("none", "a point of the arc")
            raise InvalidInput("via_mm", got, expected)
        if row.get("move") != "arc":
            return goal
        if pose is None:
            raise InvalidInput("move", '"arc" from an unknown pose', "a start in the file, or another part before it")
        frame = self._read_frame(row["pose"]["frame"], "pose.frame") if "frame" in row["pose"] else np.eye(4)
        via = frame[:3, :3] @ (read_vector(row["via_mm"], "via_mm") * 1e-3) + frame[:3, 3]
        return Arc.through(pose, via, goal)

    def _read_table(self, robot: Robot, kind: str, row: Mapping[str, Any], pose: Array | None) -> Path:
        """Return the path through the rows of a table, which are given in a frame."""
        frame = self._read_frame(row["frame"], "frame") if "frame" in row else np.eye(4)
        turned = None if pose is None else frame[:3, :3].T @ pose[:3, :3]
        near, turn = WITHIN[kind]
        if (given := self._number(row, "within_mm")) is not None:
            near, turn = given, turn * given / near
        try:
            poses = frame @ read_waypoints(read_table(self._below(row[kind], kind)), turned, None, None)
        except InvalidInput as error:
            if error.argument == "orientation":
                self.where, why = "", error.expected.partition("because ")[2].replace("the file", row[kind])
                raise InvalidInput("start", "none", f"joints or a configuration, because {why}") from None
            if error.argument != "file":
                raise
            raise InvalidInput(kind, error.got, error.expected) from None
        if kind == "polyline":
            return Polyline(poses, blend=near, blend_rotation=turn)
        return Spline(poses, tolerance=(near, turn))

    def _find_start(self, robot: Robot, row: Mapping[str, Any], pose: Array | None, rows: list[Any]) -> Array:
        """Return the pose at which another part begins, moved in the frame of the tool."""
        tables = {"polyline", "spline"}
        named = {other["name"]: i for i, other in enumerate(rows)
                 if isinstance(other, Mapping) and isinstance(other.get("name"), str) and tables & set(other)}  # fmt: skip
        i = _look_up("start_of", row["start_of"], named, "the name of a part with a table")
        here, other = self.where, rows[i]
        self._enter("part", i, other)  # a mistake in it is that part's
        path = self._read_table(robot, "polyline" if "polyline" in other else "spline", other, pose)
        self.where = here
        offset = read_vector(row.get("offset_mm", [0.0, 0.0, 0.0]), "offset_mm") * 1e-3
        return np.asarray(path.pose(0.0) @ se3.pose(p=offset))

    def _read_change(self, robot: Robot, row: Mapping[str, Any]) -> ToolChange:
        read_record(row, (), "keys", optional=CHANGE_KEYS)
        payload: Any = KEEP
        if (mass := self._number(row, "payload_kg")) is not None:
            com = read_vector(row.get("payload_com_mm", [0.0, 0.0, 0.0]), "payload_com_mm") * 1e-3
            payload = Payload(mass, com) if mass else None
            if mass and robot.inertia is None:
                expected = "an arm with masses (in its file), or no payload_kg"
                raise InvalidInput("payload_kg", f"{mass:g} on {robot.name}", expected)
        elif "payload_com_mm" in row:
            raise InvalidInput("payload_com_mm", "a centre of mass without a mass", "payload_kg, too")
        tool = read_pose(row["tool"], "tool") if "tool" in row else KEEP
        return ToolChange(tool=tool, payload=payload)

    # ------------------------------------------------------------ events

    def _read_events(self) -> tuple[Scheduled, ...]:
        found, complete = [], not self.mistakes
        for i, row in enumerate(self._rows("event")):
            self._enter("event", i, None)
            try:
                found.append(self._read_event(row, complete))
            except OptikError as error:
                self._note(error)
        return tuple(found)

    def _read_event(self, row: Any, complete: bool) -> Scheduled:
        """Return an event; its place is checked if all parts are known."""
        read_record(row, (), "keys", optional=EVENT_KEYS)
        places = [key for key in ("distance_mm", "fraction", "spacing_mm", "time_s") if key in row]
        if len(places) != 1 or "signal" not in row or ("part" in row) == (places == ["time_s"]):
            keys = ", ".join(row) or "no keys"
            raise InvalidInput("event", keys, "signal; and time_s, or part with distance_mm, fraction or spacing_mm")
        (kind,), signal, value = places, row["signal"], row.get("value", 1)
        number = None if kind == "fraction" else self._number(row, kind)
        shifts: dict[str, Any] = {key[:-2]: self._number(row, key) for key in ("before_s", "after_s") if key in row}
        for key in shifts if kind in ("time_s", "spacing_mm") else ():
            expected = f"no {key}_s, or a place by distance_mm or fraction"
            raise InvalidInput(f"{key}_s", f"{row[f'{key}_s']!r} with {kind}", expected)
        if complete and kind != "time_s":
            self._check_place(row["part"], kind, row[kind])
        part = row["part"] - 1 if type(row.get("part")) is int else row.get("part")
        if kind == "time_s":
            return TimedEvent(number or 0.0, signal, value)
        if kind == "spacing_mm":
            return PeriodicEvent(part, number or 0.0, signal, value)
        return PathEvent(part, number, signal, value, row.get("fraction"), **shifts)

    def _check_place(self, which: Any, key: str, value: float) -> None:
        """Raise InvalidInput for a place that is not on its part, as far as that is known before planning."""
        part, path = self.paths[find_part([part for part, _ in self.paths], which, 1)]
        if key == "fraction":
            return
        in_joints = not part.is_cartesian or part.avoid
        if in_joints or (path is not None and path.unit != "m"):
            what = "is in joint space" if in_joints else "only turns the tool"
            raise InvalidInput(key, f"{value!r} along part {which!r}, which {what}", "fraction, from 0 to 1")
        if path is None:
            return
        length, least = 1e3 * path.end, 1e3 * path.end / MOST_EVENTS
        if key == "distance_mm" and abs(value) > length * (1.0 + PASSED):
            raise InvalidInput(key, f"{value!r}", f"at most the length of part {which!r}, {length:.6g} mm")
        if key == "spacing_mm" and value < least:
            raise InvalidInput(key, f"{value!r}", f"at least {least:.3g} mm along part {which!r}")


def _look_up(key: str, name: Any, known: Any, what: str = "") -> Any:
    """Return the entry with a name; raise InvalidInput with the nearest known name if there is none."""
    names = list(known) if isinstance(known, Mapping) else []
    if isinstance(name, str) and name in names:
        return known[name]
    near = find_nearest_name(str(name), names)
    expected = f"{what or 'one of'}: {', '.join(names) or 'none in the file'}"
    raise InvalidInput(key, repr(name)[:60], expected, advice=f"did you mean {near}?" if near else "")


def _end_of(part: Part, robot: Robot, pose: Array | None) -> Array | None:
    """Return the pose of the tool at the end of a part that begins at a pose; None if it is not known."""
    goal = part.goal
    if isinstance(goal, Path):
        return goal.pose(goal.end)
    if isinstance(goal, Move):
        return None if pose is None else displace(pose, goal)
    return np.asarray(robot.fk(goal)) if goal.ndim == 1 else goal
