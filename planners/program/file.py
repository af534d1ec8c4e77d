"""Programs in TOML, in millimetres, degrees and seconds, as their keys say.

robot = "ur5e"                            # optional: a name, or a file below this one's folder
start = "home"                            # optional: a configuration

[configurations]
home = [0, -90, 90, -90, -90, 0]          # degrees; millimetres for joints that slide

[frames.fixture]
xyz_mm = [400, 0, 20]
rpy_deg = [0, 0, 90]                      # optional: roll, pitch and yaw
frame = "cell"                            # optional: the frame in which it is given, by default the base

[[part]]
name = "above"                            # optional
pose = { frame = "fixture", xyz_mm = [0, 0, 100], rpy_deg = [180, 0, 0] }
move = "joint"                            # optional: line (default), joint, or arc with via_mm = [x, y, z]
blend_mm = 20                             # optional, as blend_rotation_deg: 0 is a stop

[[part]]
start_of = "bead"                         # where another part with a file begins
offset_mm = [0, 0, -50]                   # optional, in the frame of the tool

[[part]]
vector_mm = [0, 0, 50]                    # in the frame "tool" (default) or "base"
tool_speed_mm_s = 100                     # optional, as rotation_speed_deg_s

[[part]]
name = "bead"
polyline = "bead.csv"                     # or spline; a table below this file's folder
frame = "fixture"                         # optional: of the table
within_mm = 0.5                           # optional: of a polyline's inner corners, or of a spline's points
blend_mm = 2

[[part]]
configuration = "home"                    # or joints = [...]
avoid = true                              # optional: a way around the obstacles of the scene

[[part]]
dwell_s = 0.3

[[part]]
tool = { xyz_mm = [0, 0, 120] }           # a change of the tool, of the payload, or of both
payload_kg = 1.5                          # 0 for none
payload_com_mm = [0, 0, 50]               # optional

[[event]]
part = "bead"
distance_mm = -50                         # or fraction, or spacing_mm, or time_s without a part
signal = "gun"
value = 0                                 # optional
before_s = 0.05                           # optional
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from optik import load, se3
from optik.arm.inertia import Payload
from optik.arm.plain import read_list, read_record, read_vector, read_word
from optik.arm.robot import Robot
from optik.check import check_flag, check_number
from optik.errors import InvalidInput, OptikError
from optik.file_io import decode_text, parse_toml, read_bytes
from optik.plugins.files import is_path
from optik.tables import read_table
from optik.types import Array
from planners.paths.arc import Arc
from planners.paths.base import Path
from planners.paths.polyline import Polyline
from planners.paths.spline import Spline
from planners.paths.waypoints import read_waypoints
from planners.program.events import PathEvent, PeriodicEvent, Scheduled, TimedEvent
from planners.program.parts import KEEP, Dwell, Item, Move, Part, Program, ToolChange, displace

FILE_KEYS = ("robot", "start", "configurations", "frames", "part", "event")
"""Keys of a file."""
POSE_KEYS = ("frame", "xyz_mm", "rpy_deg")
"""Keys of a pose."""
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
EVENT_KEYS = ("part", "distance_mm", "fraction", "spacing_mm", "time_s", "signal", "value", "before_s")
"""Keys of an event."""
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


def load_program(file: str | os.PathLike[str], robot: Robot | str | None = None) -> ProgramFile:
    """Read a program from a TOML file.

    Parameters
    ----------
    file : str or path
        The file; docs/programs.md lists its keys. Files that it names are below its folder.
    robot : Robot or str, optional
        The arm, instead of the one that the file names.

    Returns
    -------
    ProgramFile
        With ``robot``, ``start`` (None if the file has none), ``program`` and ``events``.

    Raises
    ------
    InvalidInput
        A mistake, in one line: the part, the key, and what is allowed. No code is run from the file.
    """
    reader = _Reader(file)
    content = reader.read(reader.find_robot() if robot is None else robot)
    if content is None or reader.mistakes:
        raise reader.mistakes[0]
    return content


def find_robot(file: str | os.PathLike[str]) -> str:
    """Return the name or the path of the arm that a program names."""
    return _Reader(file).find_robot()


def find_mistakes(file: str | os.PathLike[str], robot: Robot | str | None = None) -> list[InvalidInput]:
    """Return the mistakes of a file: the first one of each part and event, in their order."""
    try:
        reader = _Reader(file)
        reader.read(reader.find_robot() if robot is None else robot)
    except InvalidInput as error:
        return [error]
    return reader.mistakes


class _Reader:
    """Reads the parts of a file one after another; `where` names the one that is read, `mistakes` are those found."""

    def __init__(self, file: str | os.PathLike[str]) -> None:
        self.file, self.where, self.mistakes = FilePath(file), "", list[InvalidInput]()
        content = decode_text(read_bytes(self.file, most=MOST_PROGRAM_BYTES), str(file))
        self.data = read_record(parse_toml(content, str(file)), (), f"{file}: keys", optional=FILE_KEYS)

    def read(self, robot: Robot | str) -> ProgramFile | None:
        """Return the content; None without a program."""
        try:
            arm = robot if isinstance(robot, Robot) else load(read_word(robot, "robot"))
            start = self.data.get("start")
            begin = None if start is None else self._read_start(arm, start)
            items = self._read_items(arm, begin)
            events = self._read_events()
            self.where = ""
            return None if self.mistakes else ProgramFile(arm, begin, Program(items), events)
        except OptikError as error:
            self._note(error)
            return None

    def _note(self, error: OptikError) -> None:
        """Add a mistake, with the file and the place in it."""
        place = f"{self.file}{f': {self.where}' if self.where else ''}"
        if isinstance(error, InvalidInput):
            named = InvalidInput(f"{place}: {error.argument}", error.got, error.expected, advice=error.advice)
        else:
            named = InvalidInput(place, str(error), "a program")
        self.mistakes.append(named)

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
            raise InvalidInput(f"{self.file}: {error.argument}", error.got, error.expected) from None

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
        factors = np.where(arm.prismatic, 1e-3, np.pi / 180.0)
        return np.asarray(read_vector(value, key, arm.n) * factors)

    def _read_start(self, arm: Robot, value: Any) -> Array:
        return (
            self._read_configuration(arm, value) if isinstance(value, str) else self._read_joints(arm, value, "start")
        )

    def _read_configuration(self, arm: Robot, name: Any) -> Array:
        known = self.data.get("configurations", {})
        if not isinstance(known, Mapping) or name not in known:
            raise InvalidInput("configuration", repr(name)[:60], f"one of: {', '.join(known) or 'none in the file'}")
        return self._read_joints(arm, known[name], f"configurations.{name}")

    def _read_pose(self, data: Any, key: str, seen: tuple[str, ...] = ()) -> Array:
        """Return a pose in the base, from the frame that it names."""
        read_record(data, (), key, optional=POSE_KEYS)
        xyz = read_vector(data.get("xyz_mm", [0.0, 0.0, 0.0]), f"{key}.xyz_mm") * 1e-3
        pose = se3.from_xyz_rpy(xyz, read_vector(data.get("rpy_deg", [0.0, 0.0, 0.0]), f"{key}.rpy_deg"))
        return np.asarray(self._read_frame(data["frame"], f"{key}.frame", seen) @ pose if "frame" in data else pose)

    def _read_frame(self, name: Any, key: str, seen: tuple[str, ...] = ()) -> Array:
        frames = self.data.get("frames", {})
        if not isinstance(frames, Mapping) or name not in frames or name in seen:
            known = ", ".join(frame for frame in frames if frame not in seen) or "none in the file"
            raise InvalidInput(key, repr(name)[:60], f"one of: {known}")
        return self._read_pose(frames[name], f"frames.{name}", (*seen, name))

    def _number(self, row: Mapping[str, Any], key: str, scale: float) -> float | None:
        return None if key not in row else check_number(row[key], key, "a finite number") * scale

    # ------------------------------------------------------------ parts

    def _read_items(self, arm: Robot, start: Array | None) -> list[Item]:
        """Return the items of the program; the pose of the tool is known from part to part, for arcs and tables."""
        rows, items, robot = self._rows("part"), list[Item](), arm
        pose = None if start is None else robot.fk(start)
        for i, row in enumerate(rows):
            named = isinstance(row, Mapping) and isinstance(row.get("name"), str)
            self.where = f"[[part]] {i + 1}{' ' + repr(row['name']) if named else ''}"
            try:
                item = self._read_item(robot, row, pose, rows)
                changed = item.apply(robot) if isinstance(item, ToolChange) else robot
            except OptikError as error:
                self._note(error)
                continue
            items.append(item)
            if changed is not robot:
                pose = None if pose is None else pose @ se3.inverse(robot.tool) @ changed.tool
                robot = changed
            elif isinstance(item, Part):
                pose = _end_of(item, robot, pose)
        return items

    def _read_item(self, robot: Robot, row: Any, pose: Array | None, rows: list[Any]) -> Item:
        if not isinstance(row, Mapping):
            raise InvalidInput("part", repr(row)[:60], "a table")
        if "dwell_s" in row:
            read_record(row, ("dwell_s",), "keys")
            return Dwell(check_number(row["dwell_s"], "dwell_s", "seconds, at least 0", least=0.0))
        if any(key in row for key in CHANGE_KEYS):
            return self._read_change(row)
        goals = [key for key in GOALS if key in row]
        if len(goals) != 1:
            got = " and ".join(goals) if goals else f"none among the keys {', '.join(row) or 'of an empty table'}"
            raise InvalidInput("goal", got, f"one of: {', '.join(GOALS)}; or dwell_s, or {', '.join(CHANGE_KEYS)}")
        read_record(row, tuple(goals), "keys", optional=(*MOVE_KEYS.get(goals[0], ()), *PART_KEYS))
        goal, move = self._read_goal(robot, goals[0], row, pose, rows), row.get("move")
        return Part(
            goal, None if isinstance(goal, Path) else move, row.get("name"), self._number(row, "blend_mm", 1e-3) or 0.0,
            self._number(row, "blend_rotation_deg", np.pi / 180.0), self._number(row, "tool_speed_mm_s", 1e-3),
            self._number(row, "rotation_speed_deg_s", np.pi / 180.0), check_flag(row.get("avoid", False), "avoid"),
        )  # fmt: skip

    def _read_goal(self, robot: Robot, kind: str, row: Mapping[str, Any], pose: Array | None, rows: list[Any]) -> Any:
        if kind == "joints":
            return self._read_joints(robot, row[kind], kind)
        if kind == "configuration":
            return self._read_configuration(robot, row[kind])
        if kind == "vector_mm":
            return Move(read_vector(row[kind], kind) * 1e-3, row.get("frame", "tool"))
        if kind == "start_of":
            return self._find_start(robot, row, pose, rows)
        if kind != "pose":
            return self._read_table(robot, kind, row, pose)
        goal = self._read_pose(row[kind], kind)
        if row.get("move") != "arc" and "via_mm" in row:
            raise InvalidInput("via_mm", "a point", 'none, or move = "arc"')
        if row.get("move") != "arc":
            return goal
        if pose is None or "via_mm" not in row:
            lacks = "via_mm" if pose is not None else "a start"
            raise InvalidInput("move", f'"arc" without {lacks}', "via_mm, and a start whose pose is known")
        frame = self._read_frame(row["pose"]["frame"], "pose.frame") if "frame" in row["pose"] else np.eye(4)
        via = frame[:3, :3] @ (read_vector(row["via_mm"], "via_mm") * 1e-3) + frame[:3, 3]
        return Arc.through(pose, via, goal)

    def _read_table(self, robot: Robot, kind: str, row: Mapping[str, Any], pose: Array | None) -> Path:
        """Return the path through the rows of a table, which are given in a frame."""
        frame = self._read_frame(row["frame"], "frame") if "frame" in row else np.eye(4)
        turned = None if pose is None else frame[:3, :3].T @ pose[:3, :3]
        poses = frame @ read_waypoints(read_table(self._below(row[kind], kind)), turned, None, None)
        near, turn = WITHIN[kind]
        if (given := self._number(row, "within_mm", 1e-3)) is not None:
            near, turn = given, turn * given / near
        return (
            Polyline(poses, blend=near, blend_rotation=turn)
            if kind == "polyline"
            else Spline(poses, tolerance=(near, turn))
        )

    def _find_start(self, robot: Robot, row: Mapping[str, Any], pose: Array | None, rows: list[Any]) -> Array:
        """Return the pose at which another part begins, moved in the frame of the tool."""
        named = {
            other.get("name"): other
            for other in rows
            if isinstance(other, Mapping) and {"polyline", "spline"} & set(other)
        }
        if row["start_of"] not in named or row["start_of"] is None:
            known = ", ".join(repr(name) for name in named if name) or "none in the file"
            raise InvalidInput("start_of", repr(row["start_of"])[:60], f"the name of a part with a table: {known}")
        other = named[row["start_of"]]
        path = self._read_table(robot, "polyline" if "polyline" in other else "spline", other, pose)
        offset = read_vector(row.get("offset_mm", [0.0, 0.0, 0.0]), "offset_mm") * 1e-3
        return np.asarray(path.pose(0.0) @ se3.pose(p=offset))

    def _read_change(self, row: Mapping[str, Any]) -> ToolChange:
        read_record(row, (), "keys", optional=CHANGE_KEYS)
        payload: Any = KEEP
        if "payload_kg" in row:
            mass = check_number(row["payload_kg"], "payload_kg", "a mass [kg], at least 0", least=0.0)
            com = read_vector(row.get("payload_com_mm", [0.0, 0.0, 0.0]), "payload_com_mm") * 1e-3
            payload = Payload(mass, com) if mass else None
        elif "payload_com_mm" in row:
            raise InvalidInput("payload_com_mm", "a centre of mass without a mass", "payload_kg, too")
        return ToolChange(tool=self._read_pose(row["tool"], "tool") if "tool" in row else KEEP, payload=payload)

    # ------------------------------------------------------------ events

    def _read_events(self) -> tuple[Scheduled, ...]:
        found = []
        for i, row in enumerate(self._rows("event")):
            self.where = f"[[event]] {i + 1}"
            try:
                found.append(self._read_event(row))
            except OptikError as error:
                self._note(error)
        return tuple(found)

    def _read_event(self, row: Any) -> Scheduled:
        read_record(row, (), "keys", optional=EVENT_KEYS)
        places = [key for key in ("distance_mm", "fraction", "spacing_mm", "time_s") if key in row]
        if len(places) != 1 or "signal" not in row or ("part" in row) == (places == ["time_s"]):
            keys = ", ".join(row) or "no keys"
            raise InvalidInput("event", keys, "signal; and time_s, or part with distance_mm, fraction or spacing_mm")
        signal, value, before = row["signal"], row.get("value", 1), row.get("before_s", 0.0)
        part = row["part"] - 1 if type(row.get("part")) is int else row.get("part")
        if places == ["time_s"]:
            return TimedEvent(row["time_s"], signal, value)
        if places == ["spacing_mm"]:
            return PeriodicEvent(part, self._number(row, "spacing_mm", 1e-3) or 0.0, signal, value)
        return PathEvent(part, self._number(row, "distance_mm", 1e-3), signal, value, row.get("fraction"), before)


def _end_of(part: Part, robot: Robot, pose: Array | None) -> Array | None:
    """Return the pose of the tool at the end of a part that begins at a pose; None if it is not known."""
    goal = part.goal
    if isinstance(goal, Path):
        return goal.pose(goal.end)
    if isinstance(goal, Move):
        return None if pose is None else displace(pose, goal)
    return np.asarray(robot.fk(goal)) if goal.ndim == 1 else goal
