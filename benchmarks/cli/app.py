"""The command line: `optik` and its commands. Exit status 0, 1 (ran, no solution), 2 (misuse)."""

from __future__ import annotations

import io
import os
import sys
import traceback
import warnings
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import optik
from benchmarks.cli import paths
from benchmarks.cli.bench import CheckCommand, ListCommand, NewCommand
from benchmarks.cli.cell import CellCommand
from benchmarks.cli.certify import CertifyCommand
from benchmarks.cli.command import OPTIONS, UsageError, add_command, err_console, name_options, translate
from benchmarks.cli.installation import DoctorCommand, KernelsCommand, PeerCommand
from benchmarks.cli.motion import DriveCommand, StreamCommand, ViewCommand
from benchmarks.cli.robot import FkCommand, IkCommand, RobotsCommand
from benchmarks.cli.runs import CompareCommand, DemoCommand, ReportCommand, RunCommand
from optik.errors import InvalidMotion, NoSolution, OptikError, OutputError
from optik.plugins import files

COMMAND_PANELS = {
    "First steps": ("robots", "ik", "fk", "plan"), "Motions": ("program", "certify", "view", "drive", "stream", "cell"),
    "Comparison of methods": ("demo", "bench"), "Installation": ("doctor", "kernels"),
}  # fmt: skip
"""Panels of the help with their commands: first what a user needs first."""


class OrderedGroup(TyperGroup):
    """A group that lists its commands in the order of `COMMAND_PANELS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, each of which then has its panel."""
        panels = {name: panel for panel, names in COMMAND_PANELS.items() for name in names}
        for name in panels:
            self.commands[name].rich_help_panel = panels[name]  # type: ignore[attr-defined]
        return list(panels)


app = typer.Typer(
    cls=OrderedGroup,
    help="Plan certified trajectories for serial arms, and compare methods of inverse kinematics and time laws.",
    rich_markup_mode="markdown",  # units in [brackets] are no markup
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
plan_app = typer.Typer(help="Plan a motion and certify it.", no_args_is_help=True)
bench_app = typer.Typer(help="Compare methods: run a suite, write its report, list the suites.", no_args_is_help=True)
app.add_typer(plan_app, name="plan")
app.add_typer(bench_app, name="bench")
program_app = typer.Typer(help="Programs of many parts: check a file.", no_args_is_help=True)
app.add_typer(program_app, name="program")

add_command(app, "robots", RobotsCommand, "robots")
add_command(app, "fk", FkCommand, "fk 20,-35,40,25,50,-30")
add_command(app, "ik", IkCommand, "ik --xyz 0.3,0.2,0.3 --rpy-deg -90,10,20")
add_command(plan_app, "line", paths.LineCommand, "plan line --move -0.12,0,0.2 --out line.json")
add_command(plan_app, "arc", paths.ArcCommand, "plan arc --centre 0.1,0.3,0.2 --axis 0,0,1 --angle-deg 20")
add_command(plan_app, "polyline", paths.PolylineCommand, "plan polyline --waypoints seam.csv --timing constant_speed")
add_command(plan_app, "spline", paths.SplineCommand, "plan spline --waypoints scan.csv --timing constant_speed")
add_command(plan_app, "joints", paths.JointsCommand, "plan joints --to-deg 0,0,10,0,30,0 --duration 4")
add_command(plan_app, "ptp", paths.PointToPointCommand, "plan ptp --waypoints cycle.csv")
add_command(plan_app, "path", paths.PathCommand, "plan path ./spiral.py --set radius=0.1")
add_command(plan_app, "program", paths.ProgramCommand, "plan program cycle.toml --out cycle.yaml --rate 125")
add_command(program_app, "check", paths.CheckProgramCommand, "program check cycle.toml")
add_command(app, "certify", CertifyCommand, "certify log.csv --robot ur5e --ignore effort --jerk 100")
add_command(app, "drive", DriveCommand, "drive line.json --on mujoco")
add_command(app, "stream", StreamCommand, "stream chunks.csv --robot panda --jerk 5000 --on mujoco")
add_command(app, "view", ViewCommand, "view line.json --html line.html")
add_command(app, "cell", CellCommand, "cell --miscalibration 3,5 --corrections 2 --readings 10")
add_command(app, "demo", DemoCommand, "demo")
add_command(bench_app, "list", ListCommand, "bench list")
add_command(bench_app, "new", NewCommand, "bench new own.toml --robot arm.urdf")
add_command(bench_app, "check", CheckCommand, "bench check own.toml")
add_command(bench_app, "run", RunCommand, "bench run timing-quick --out RUN --report")
add_command(bench_app, "report", ReportCommand, "bench report RUN --format md")
add_command(bench_app, "compare", CompareCommand, "bench compare BEFORE AFTER --threshold 10")
add_command(bench_app, "peer", PeerCommand, "bench peer placo --install")
add_command(app, "doctor", DoctorCommand, "doctor")
add_command(app, "kernels", KernelsCommand, "kernels --compile")


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"optik {optik.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


# ---------------------------------------------------------------- the process


def main() -> None:
    """Run the command line: an OptikError is one line with exit status 2, or 1 if there is no solution."""
    guard_output()
    warnings.showwarning = _show_warning
    try:
        try:
            status = app(prog_name="optik", standalone_mode=False)
        finally:
            sys.stdout.flush()  # a full disk is reported here
        sys.exit(status or 0)
    except UsageError as error:
        _end_usage(error)
    except typer.Abort:
        sys.exit(130)
    except InvalidMotion as error:
        _end(f"not valid: {translate(str(error))}", 1)
    except NoSolution as error:
        _end(f"no solution: {translate(str(error))}", 1)
    except OptikError as error:
        _end(f"error: {name_options(str(error))}", 2)
    except Exception as error:
        words = _describe_plugin_error(error)
        if not words:
            raise
        _end(f"error: {words}", 2)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning as one line on the error stream."""
    err_console.print(f"warning: {translate(str(message))}", style="yellow", soft_wrap=True)


def _end_usage(error: Any) -> None:
    """End the process with one line on an unknown command or an option of a group; no command at all shows the help."""
    command = error.ctx.command_path if error.ctx is not None else "optik"
    if type(error).__name__ == "NoArgsIsHelpError":
        error.show()
        sys.exit(2)
    words = " ".join(error.format_message().split()).removesuffix(".").replace("'?", "'")
    if (name := getattr(error, "option_name", "")) in OPTIONS.values():
        words = f"{name} comes after the command: {command} {next(iter(error.ctx.command.commands))} {name} …"
    _end(f"error: {words}; for help: {command} --help", 2)


def _end(words: str, status: int) -> None:
    """End the process with one line on the error stream."""
    err_console.print(words, style="yellow" if status == 1 else "red", soft_wrap=True)
    sys.exit(status)


def _describe_plugin_error(error: Exception) -> str:
    """Describe the error that a plug-in's file raised on import, with its line; empty for any other error."""
    frames = traceback.extract_tb(error.__traceback__)
    loads = [k for k, frame in enumerate(frames) if frame.filename == files.__file__ and frame.name == "exec_module"]
    if not loads:
        return ""
    words = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if loads[-1] + 1 < len(frames):  # a file with a syntax error runs no line, and its error names the place
        words += f" ({frames[loads[-1] + 1].filename}, line {frames[loads[-1] + 1].lineno})"
    return f"plug-in: expected a Python file that can be imported; got {words}"


class _Standard(io.FileIO):
    """Raw standard output."""

    def write(self, data: Any) -> int:
        """Write bytes; after a failure, discard all later output, so that the end of the process does not fail again."""
        try:
            return super().write(data) or 0
        except OSError as error:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), self.fileno())
            if isinstance(error, BrokenPipeError):  # a closed pipe: `optik robots | head -1`
                return len(data)
            raise OutputError("standard output", error.strerror or str(error)) from None


def guard_output() -> None:
    """Let standard output end quietly when its pipe is closed, and raise an OutputError when it cannot be written.

    Characters that its encoding lacks, such as ° and table lines in ASCII, become question marks.
    """
    out = sys.stdout
    if type(out) is not io.TextIOWrapper:
        return  # replaced by another program, such as a test
    out.flush()
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="replace")
    raw, buffered = _Standard(out.fileno(), "w", closefd=False), isinstance(out.buffer, io.BufferedWriter)
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(raw) if buffered else raw, encoding=out.encoding, errors="replace",
        line_buffering=out.line_buffering, write_through=not buffered,
    )  # fmt: skip
