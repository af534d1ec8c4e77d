"""`optik plan program` and `optik program check`: a motion of many parts from a TOML file, and its parts in words."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli.command import JsonCommand, Start, argument, err_console, option, out_console, print_json
from benchmarks.cli.plan import PlanCommand
from benchmarks.cli.readers import read_configuration
from optik.arm.model import unit_factors
from optik.check import format_count
from optik.errors import InvalidInput

if TYPE_CHECKING:
    import planners
    from planners.program.file import ProgramFile

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

        arm = self.load(self.robot or find_robot(self.file))
        start = read_configuration(arm, self.start_deg) if self.start_deg is not None else None
        return load_program(self.file, arm, start)

    def load_start(self) -> Start:
        """Return the robot and the program's start, unless another one is typed."""
        return Start(self.content.robot, self.content.start, "")

    def make_path(self, start: Start) -> Any:
        """Return the program."""
        return self.content.program

    def choose_branch(self, start: Start, path: Any) -> str | None:
        """Return the typed branch: the parts choose theirs."""
        return self.branch

    def plan(self, start: Start, path: Any, law: Any, words: list[str]) -> planners.Plan:
        """Return the plan with the events of the file."""
        import planners

        found = super().plan(start, path, law, words)
        assert isinstance(found, planners.ProgramPlan)
        try:
            return found.schedule(self.content.events) if found.has_motion else found
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

    def run(self) -> None:
        """Print the parts."""
        import planners
        from planners.program.file import read_program

        content, mistakes = read_program(self.file, self.robot or None)
        if mistakes and mistakes[0].argument == "file":
            raise mistakes[0]
        for mistake in mistakes:
            err_console.print(f"error: {mistake}", soft_wrap=True)
        if content is None:
            raise typer.Exit(2)
        rows = [_describe(item, content.robot) for item in content.program.items]
        if self.as_json:
            print_json({"robot": content.robot.name, "items": rows, "events": len(content.events)})
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


def _describe(item: Any, arm: optik.Robot) -> dict[str, str]:
    """Return an item of a program in words."""
    from planners import Dwell, ToolChange
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
    return {"name": item.name or "", "motion": _motion(item, arm), "end": end, "limits": speeds}


def _motion(part: Any, arm: optik.Robot) -> str:
    """Return the motion of a part in words."""
    from planners import Move, Path

    around = ", around obstacles" if part.avoid is not False else ""
    if isinstance(part.goal, Path):
        size = f"{1e3 * part.goal.end:.4g} mm" if part.goal.unit == "m" else f"{part.goal.end:.4g} rad"
        return f"{part.goal.name.replace('_', ' ')} of {size}{around}"
    if isinstance(part.goal, Move):
        return f"line by {_millimetres(part.goal.vector)} mm in the frame of the {part.goal.frame}"
    if part.goal.ndim == 1:
        return (
            f"joints to {', '.join(f'{x:.4g}' for x in part.goal * unit_factors(arm))} [degrees, prismatic mm]{around}"
        )
    kind = "joints" if part.move == "joint" else "line"
    return f"{kind} to the pose at {_millimetres(part.goal[:3, 3])} mm{around}"


def _millimetres(position: Any) -> str:
    return ", ".join(f"{1e3 * x:.4g}" for x in np.asarray(position))
