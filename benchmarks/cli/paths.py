"""`optik plan line`, arc, polyline, joints, ptp, path and program: paths and programs from options and files."""

from __future__ import annotations

import tomllib
from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli import command
from benchmarks.cli.command import JsonCommand, Start, TableCommand, argument, numbers, option, out_console
from benchmarks.cli.group import FRAME_HELP, TOOL_HELP, find_chain, find_order, read_start, read_typed_group
from benchmarks.cli.plan import PlanCommand, choose_branch
from benchmarks.cli.readers import read_configuration, read_freedoms, read_number_list
from optik.arm.model import unit_factors
from optik.check import format_count
from optik.errors import InvalidInput
from optik.registry import names
from optik.types import Array

if TYPE_CHECKING:
    import planners
    from planners.program.file import ProgramFile


# ---------------- `optik plan line`


FREEDOMS = ", ".join(names("planners.freedom"))
"""Freedoms of a path, for messages."""
FREE_HELP = (
    f"Freedom of the path, repeatable, one of: {FREEDOMS}. A range in degrees: turn=180 (−180 to 180), turn=-90:90, tilt=10 (a "
    "cone), elbow (no bounds). The law optimal chooses it together with the timing. turn,tilt: only the tool's point "
    "follows, of any arm; turn of an arm with five joints: point and axis."
)
"""Help of ``--free``."""
EXACT_WINDING_HELP = (
    "Turn joints without limits to exactly the typed angles. By default they may end whole turns away, by the shortest "
    "collision-free motion."
)
"""Help of ``--exact-winding``."""
UNIT_HELP = "Unit of x,y,z without a unit in the header: m (default), mm, cm or in."
"""Help of ``--unit``."""
DEMONSTRATION = "-0.12,0,0.2"
"""Default of ``--move`` [m]: the line of the paper."""
POSE_SYNTAX = "x,y,z[,roll,pitch,yaw] in the base frame [m, degrees]; without angles the tool keeps its orientation."
"""Syntax of a pose, for the help of several options."""

TABLE_SYNTAX = (
    "with a header: x,y,z [m] or x_mm,y_mm,z_mm, and optionally the orientation as qx,qy,qz,qw; roll,pitch,yaw [rad]; "
    "roll_deg,pitch_deg,yaw_deg; i,j,k; nx,ny,nz; rx,ry,rz; or KUKA's A,B,C."
)
"""Syntax of a table of poses, for the help of several options."""


RESOLVE_HELP = (
    "auto searches sequences of configurations and freedoms along the whole path where following fails; local does not."
)
"""Help of ``--resolve``."""
RECONFIGURATIONS_HELP = "How often the tool may leave the path, so that the arm goes on in another configuration."
"""Help of ``--reconfigurations``."""


@dataclass(frozen=True, kw_only=True)
class ToolPathCommand(PlanCommand):
    """A command that plans along a path of tool poses, which may have freedoms."""

    free: list[str] | None = option("Path", FREE_HELP, metavar="NAME[=RANGE]")
    start_free: bool = option(
        "Path",
        "With --free: the motion may begin with another turn, tilt or elbow than the start's.",
        False,
        "--start-free",
    )
    coefficients: int | None = option(
        "Path", "With --free: coefficients of each coordinate; by default 3 for each segment, but 8 to 32."
    )
    resolve: str = option("Method", RESOLVE_HELP, "auto")
    time_limit: float | None = option("Method", "Largest computing time of --resolve auto [s]; by default unlimited.")
    reconfigurations: int = option("Method", RECONFIGURATIONS_HELP, 0)

    def resolution(self) -> dict[str, Any]:
        """Return the typed options of the resolution of the whole path."""
        return {"resolve": self.resolve, "time_limit": self.time_limit, "reconfigurations": self.reconfigurations}

    @abstractmethod
    def make_given(self, start: Start) -> planners.Path:
        """Return the typed path without freedoms."""

    def make_path(self, start: Start) -> planners.Path:
        """Return the typed path with its freedoms; if it begins elsewhere than the arm, its start is free."""
        import planners

        given, freedoms = self.make_given(start), read_freedoms(start.arm, self.free or [])
        if not freedoms:
            typed = {"--start-free": self.start_free, "--avoid": self.avoid, "--coefficients": self.coefficients}
            for name in (name for name, value in typed.items() if value):
                raise InvalidInput(name, "no --free", "a freedom", advice=f"add --free turn, or another of {FREEDOMS}")
            return given
        held = not self.start_free and choose_branch(start, given) == "start"
        return planners.free(given, coefficients=self.coefficients, hold_start=held, **freedoms)


@dataclass(frozen=True, kw_only=True)
class LineCommand(ToolPathCommand):
    """Plan and certify a motion of the tool along a straight line.

    The exit status is 0 if there is a motion with a valid certificate. Otherwise it is 1, and nothing is written.
    """

    move: str = numbers("Path", f"Goal minus start, in the base frame [m]; by default {DEMONSTRATION}, to try it.", "")
    turn_deg: str = numbers(
        "Path", "Rotation of the tool along the line, as a rotation vector in the base frame [degrees].", "0,0,0"
    )

    def load_start(self) -> Start:
        """Load the robot and its start, with words on the demonstration if no line is typed."""
        start = super().load_start()
        words = f"a demonstration: --move {DEMONSTRATION}; for your own: --robot ROBOT --move X,Y,Z [m]"
        return start if self.move else start._replace(words="\n".join(filter(None, (words, start.words))))

    def make_given(self, start: Start) -> planners.Path:
        """Return the line."""
        import planners
        from optik import se3

        T, turn = start.arm.fk(start.q), read_number_list(self.turn_deg, "--turn-deg", 3)
        if np.linalg.norm(turn) > 180.0:
            advice = "a line turns the shortest way"
            raise InvalidInput("--turn-deg", self.turn_deg, "a rotation vector of at most 180°", advice=advice)
        position = T[:3, 3] + read_number_list(self.move or DEMONSTRATION, "--move", 3)
        return planners.Line(T, se3.pose(se3.exp_so3(np.deg2rad(turn)) @ T[:3, :3], position))


@dataclass(frozen=True, kw_only=True)
class ArcCommand(ToolPathCommand):
    """Plan and certify a motion of the tool along a circular arc: through a point to an end, or about an axis by an angle."""

    via: str = numbers("Path", "Intermediate point x,y,z [m]; with --to.", "")
    to: str = numbers("Path", f"End pose: {POSE_SYNTAX}", "")
    centre: str = numbers("Path", "Point on the axis, x,y,z [m]; with --axis and --angle-deg.", "")
    axis: str = numbers("Path", "Direction of the axis, x,y,z.", "0,0,1")
    angle_deg: float = option("Path", "Angle about the axis, right-handed [degrees].", 90.0)

    def make_given(self, start: Start) -> planners.Path:
        """Return the arc."""
        import planners

        typed = {"--via": self.via, "--to": self.to, "--centre": self.centre}
        given = [name for name, text in typed.items() if text]
        T = start.arm.fk(start.q)
        if given == ["--centre"]:
            centre, axis = read_number_list(self.centre, "--centre", 3), read_number_list(self.axis, "--axis", 3)
            return planners.Arc.about(T, centre, axis, float(np.deg2rad(self.angle_deg)))
        if given == ["--via", "--to"]:
            return planners.Arc.through(T, read_number_list(self.via, "--via", 3), read_pose_text(self.to, "--to", T))
        raise InvalidInput("--via", " and ".join(given) or "no option", "--via with --to, or --centre")


@dataclass(frozen=True, kw_only=True)
class PolylineCommand(ToolPathCommand, TableCommand):
    """Plan and certify a motion of the tool along a polyline with blended corners.

    With --via, the path begins at the start configuration. With --waypoints, it begins at the first waypoint of the file, by
    default in the configuration that is best for the whole path.
    """

    via: list[str] | None = numbers("Path", f"Waypoint, repeatable; the last one is the end: {POSE_SYNTAX}")
    waypoints: Path | None = option("Path", f"Table of all waypoints {TABLE_SYNTAX}")
    unit: str | None = option("Path", UNIT_HELP)
    blend: float = option("Path", "Largest distance of a blended corner from its waypoint [m].", 1e-3)

    def make_given(self, start: Start) -> planners.Path:
        """Return the polyline."""
        import planners

        if bool(self.via) == (self.waypoints is not None):
            came = "both" if self.via else "no option"
            raise InvalidInput("--via", came, "either --via (repeatable) or --waypoints FILE.csv")
        table = {"--unit": self.unit, "--columns": self.columns, "--ignore": self.ignore}
        for name in (name for name, value in table.items() if self.via and value):
            raise InvalidInput(name, f"{table[name]} with --via", "--waypoints, whose table it describes")
        poses = [start.arm.fk(start.q)]
        if self.waypoints is not None:
            return planners.Polyline.from_csv(
                self.waypoints, orientation=poses[0][:3, :3], blend=self.blend, robot=start.arm, unit=self.unit,
                columns=self.columns, ignore=self.ignore,
            )  # fmt: skip
        for text in self.via or ():
            poses.append(read_pose_text(text, "--via", poses[-1]))
        return planners.Polyline(np.stack(poses), blend=self.blend)


@dataclass(frozen=True, kw_only=True)
class SplineCommand(ToolPathCommand, TableCommand):
    """Plan and certify a motion of the tool along a smooth curve near the points of a file, or through them.

    The path begins at the first point, by default in the configuration that is best for the whole path.
    """

    waypoints: Path = option("Path", f"Table of all points {TABLE_SYNTAX}", ...)
    unit: str | None = option("Path", UNIT_HELP)
    tolerance: str = numbers(
        "Path",
        "Largest distance [mm] and angle [degrees] of the points from the curve; 0,0 passes them exactly.",
        "0.1,0.1",
    )

    def make_given(self, start: Start) -> planners.Path:
        """Return the curve."""
        import planners

        position, rotation = np.multiply(read_number_list(self.tolerance, "--tolerance", 2), (1e-3, np.pi / 180.0))
        if min(position, rotation) < 0.0 or (position > 0.0) != (rotation > 0.0):
            expected = "a distance [mm] and an angle [degrees] above 0, or 0,0"
            raise InvalidInput("--tolerance", self.tolerance, expected)
        return planners.Spline.from_csv(
            self.waypoints, orientation=start.arm.fk(start.q)[:3, :3], tolerance=(position, rotation) if position else 0,
            robot=start.arm, unit=self.unit, columns=self.columns, ignore=self.ignore,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class JointsCommand(PlanCommand):
    """Plan and certify a motion to another configuration, straight in joint space."""

    to_deg: str = numbers("Path", "Goal configuration [degrees, prismatic mm].", ...)
    exact_winding: bool = option("Path", EXACT_WINDING_HELP, False, "--exact-winding")

    def load(self, name: str = "") -> optik.Robot:
        """Load the robot; of a group all members as one."""
        return super().load(name) if self.group is None else self.group.as_robot()

    def choose_winding(self) -> str:
        """Return exact with ``--exact-winding``."""
        return "exact" if self.exact_winding else "nearest"

    def make_path(self, start: Start) -> Array:
        """Return the goal."""
        goal: Array = read_configuration(start.arm, self.to_deg, "--to-deg")
        return goal


@dataclass(frozen=True, kw_only=True)
class PointToPointCommand(PlanCommand, TableCommand):
    """Plan and certify a motion through via points without stops; path and timing are chosen together.

    The first row of the file is the start configuration, the last one the goal. A row is a
    configuration or a pose of the tool.
    """

    waypoints: Path = option(
        "Path",
        "CSV file with a header: q1_deg,q2_deg,… [degrees, prismatic q1_mm]; for poses x_mm,y_mm,z_mm and an orientation as "
        "for `optik plan polyline`; tolerance_mm,tolerance_deg for via points that are passed within a tolerance.",
        ...,
    )
    unit: str | None = option("Path", UNIT_HELP)

    def load_start(self) -> Start:
        """Load the robot; the start is that of the file."""
        if self.start_deg is not None:
            raise InvalidInput("--start-deg", self.start_deg, "no start: the first row of --waypoints is the start")
        if self.branch is not None:
            raise InvalidInput("--branch", self.branch, "no branch: configurations are chosen over all points")
        if self.group is not None:
            raise InvalidInput("--robot", f"{self.robot}, a group", "one arm; `optik plan joints` takes a group")
        return Start(self.load(), None, "")

    def make_path(self, start: Start) -> planners.Path:
        """Return the path through the points."""
        import planners

        return planners.PointToPoint.from_csv(
            start.arm, self.waypoints, unit=self.unit, columns=self.columns, ignore=self.ignore
        )


@dataclass(frozen=True, kw_only=True)
class PathCommand(PlanCommand):
    """Plan and certify a motion of the tool along a path of a type from optik, a file or an installed package.

    --set gives the data of the path, with the keys of its to_dict. By default, start is the tool's pose at the start
    configuration.
    """

    path: str = argument("PATH", f"One of: {', '.join(names('planners.paths'))}; or a file: ./spiral.py.")
    set_: list[str] | None = option("Path", "KEY=VALUE of the path, repeatable; values as in TOML.", None, "--set")

    def make_path(self, start: Start) -> planners.Path:
        """Return the path of the typed kind."""
        import planners

        settings = {"start": start.arm.fk(start.q).tolist()} | read_settings(self.set_ or [])
        return planners.paths.make_path(self.path, start.arm, **settings)


def read_settings(texts: list[str]) -> dict[str, Any]:
    """Read KEY=VALUE pairs; a value is TOML (numbers, lists, true), otherwise text."""
    found: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key.strip().isidentifier() and equals):
            raise InvalidInput("--set", repr(text), "KEY=VALUE")
        try:
            found[key.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            found[key.strip()] = value
    return found


def read_pose_text(text: str, name: str, before: Any) -> Any:
    """Return the pose of x,y,z[,roll,pitch,yaw]; without angles it has the orientation of the pose before it."""
    from optik import se3

    values = read_number_list(text, name, 3, 6)
    return se3.from_xyz_rpy(values[:3], values[3:]) if values[3:] else se3.pose(before[:3, :3], values)


# ---------------- `optik plan program` and `optik program check`


FILE_HELP = "Program in TOML; docs/programs.md lists its keys."
"""Help of the argument."""


@dataclass(frozen=True, kw_only=True)
class ProgramCommand(PlanCommand):
    """Plan and certify a program: many parts as one motion, with rounded corners, stops, waits and changes of the tool.

    The file may name the arm, the start and events.
    """

    file: Path = argument("FILE", FILE_HELP)
    robot: str = option(
        "Robot",
        "A name from `optik robots`, or a file, instead of the arm that the program names.",
        "",
        "--robot",
        "-r",
    )

    @cached_property
    def content(self) -> ProgramFile:
        """The content of the file, for the arm with the typed options."""
        from planners.program.file import find_robot, load_program

        arm, text, group = self.load(self.robot or find_robot(self.file)), self.start_deg, self.group
        if group is None:
            return load_program(self.file, arm, None if text is None else read_configuration(arm, text))
        order = find_order(group, arm)
        return load_program(self.file, arm, None if text is None else read_start(group, text)[0][order], order)

    def load_start(self) -> Start:
        """Return the robot and the program's start, unless another one is typed."""
        return Start(self.content.robot, self.content.start, "")

    def make_path(self, start: Start) -> Any:
        """Return the program."""
        return self.content.program

    def choose_branch(self, start: Start, path: Any) -> str | None:
        """Return the typed branch: the parts choose theirs."""
        return self.branch

    def plan(self, start: Start, path: Any, law: Any, words: list[str]) -> Any:
        """Return the plan with the events of the file."""
        import planners

        planned: Any = super().plan(start, path, law, words)
        found = planned if self.group is None else planned.chain_plan
        assert isinstance(found, planners.ProgramPlan)
        try:
            scheduled = found.schedule(self.content.events) if found.has_motion else found
            return scheduled if self.group is None else replace(planned, chain_plan=scheduled)
        except InvalidInput:
            for i, event in enumerate(self.content.events, 1):  # name the one
                try:
                    found.schedule([event])
                except InvalidInput as error:
                    raise InvalidInput(f"{self.file}: [[event]] {i}", error.got, error.expected) from None
            raise


@dataclass(frozen=True, kw_only=True)
class CheckProgramCommand(JsonCommand):
    """Check a program and show its parts, without planning it. Each mistake is one line: part, key, and what is allowed."""

    file: Path = argument("FILE", FILE_HELP)
    robot: str = option("Robot", "The arm, instead of the one that the program names.", "", "--robot", "-r")
    tool: str | None = option("Robot", TOOL_HELP, metavar="NAME")
    frame: str | None = option("Robot", FRAME_HELP, metavar="NAME")

    def run(self) -> None:
        """Print the parts."""
        import planners
        from planners.program.file import read_program

        group = read_typed_group(self.robot, self.tool, self.frame)
        arm = None if group is None else find_chain(group, self.tool, self.frame)
        order = None if group is None or arm is None else find_order(group, arm)
        content, mistakes = read_program(self.file, arm or self.robot or None, order=order)
        if mistakes and mistakes[0].argument == "file":
            raise mistakes[0]
        for mistake in mistakes:
            command.err_console.print(f"error: {mistake}", soft_wrap=True)
        if content is None:
            raise typer.Exit(2)
        places = slice(None) if group is None else group.places(content.robot)
        rows = [_describe(item, content.robot, places) for item in content.program.items]
        if self.as_json:
            command.print_json({"robot": content.robot.name, "items": rows, "events": len(content.events)})
            return
        table = Table("", "name", "motion", "at its end", "limits", title=f"{self.file.name} on {content.robot.name}")
        number = 0
        for row in rows:
            number += "motion" in row
            shown, what = str(number) if "motion" in row else "", row.get("motion") or row.get("change", "")
            table.add_row(shown, row.get("name", ""), what, row.get("end", ""), row.get("limits", ""))
        out_console.print(table)
        parts, events = format_count(len(content.program.parts), "part"), format_count(len(content.events), "event")
        out_console.print(f"{parts}, {events}: no errors")
        if content.start is None and not isinstance(content.program.parts[0].goal, planners.Path):
            out_console.print("no start in the file: `optik plan program` needs --start-deg")
        if any(part.avoid is not False for part in content.program.parts):
            out_console.print("a part avoids obstacles: `optik plan program` needs --scene FILE")


def _describe(item: Any, arm: optik.Robot, places: Any) -> dict[str, str]:
    """Return an item of a program in words; `places` are the indices of typed joints among those of the arm."""
    from planners.program import Dwell, ToolChange
    from planners.program.parts import Keep

    if isinstance(item, Dwell):
        return {"change": f"wait of {item.seconds:g} s"}
    if isinstance(item, ToolChange):
        changed, words = item.apply(arm), []
        words += [f"tool at {_millimetres(changed.tool[:3, 3])} mm"] if not isinstance(item.tool, Keep) else []
        words += [f"payload {changed.payload or 'none'}"] if not isinstance(item.payload, Keep) else []
        return {"change": ", ".join(words)}
    limits = [(item.tool_speed, 1e3, "mm/s"), (item.rotation_speed, 180.0 / np.pi, "°/s")]
    speeds = ", ".join(f"{value * factor:.4g} {unit}" for value, factor, unit in limits if value is not None)
    zone, turn = item.zone
    end = f"rounded within {1e3 * zone:.4g} mm, {np.degrees(turn):.3g}°" if zone else "stop"
    return {"name": item.name or "", "motion": _motion(item, arm, places), "end": end, "limits": speeds}


def _motion(part: Any, arm: optik.Robot, places: Any) -> str:
    """Return the motion of a part in words."""
    from planners import Path
    from planners.program import Move

    around = ", around obstacles" if part.avoid is not False else ""
    if isinstance(part.goal, Path):
        size = f"{1e3 * part.goal.end:.4g} mm" if part.goal.unit == "m" else f"{part.goal.end:.4g} rad"
        return f"{part.goal.name.replace('_', ' ')} of {size}{around}"
    if isinstance(part.goal, Move):
        return f"line by {_millimetres(part.goal.vector)} mm in the frame of the {part.goal.frame}"
    if part.goal.ndim == 1:
        goal = ", ".join(f"{x:.4g}" for x in (part.goal * unit_factors(arm))[places])
        return f"joints to {goal} [degrees, prismatic mm]{around}"
    kind = "joints" if part.move == "joint" else "line"
    return f"{kind} to the pose at {_millimetres(part.goal[:3, 3])} mm{around}"


def _millimetres(position: Any) -> str:
    return ", ".join(f"{1e3 * x:.4g}" for x in np.asarray(position))
