"""`optik drive`, `optik view`, `optik stream`: execute or show a motion, and execute chunks of joint targets."""

from __future__ import annotations

import json
import webbrowser
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli import command
from benchmarks.cli.command import JsonCommand, Start, argument, err_console, option, out_console, print_json, translate
from benchmarks.cli.group import read_start
from benchmarks.cli.plan import MOTION_SUFFIXES
from benchmarks.cli.readers import ALLOW_HELP, read_allowed, read_configuration
from optik.arm.group import read_group
from optik.arm.model import unit_factors, unit_names
from optik.errors import InvalidInput, NoSolution, RobotModelError
from optik.file_io import read_bytes, write_atomically
from optik.plugins.files import split_links
from optik.registry import load_method, names

if TYPE_CHECKING:
    from optik.view.show import Show
    from planners import Motion, Plan
    from planners.cell.drives.base import Execution
    from planners.streams import Setpoint
    from planners.streams.chunk import Chunk


# ---------------- `optik drive`


STORED_MOTION = f"a motion that `optik plan … --out FILE` wrote: {MOTION_SUFFIXES}"
"""Files that `optik drive` reads; `optik view` also reads an execution and a failed plan."""

DRIVE_HELP = f"Drive, one of: {', '.join(names('planners.cell.drives'))}; or a file, ./lagging.py"
"""Begin of the help of options that name a drive."""

ROS_PANEL = "With --on ros"
"""Panel of the help."""


# ---------------------------------------------------------------- optik drive


@dataclass(frozen=True, kw_only=True)
class DriveCommand(JsonCommand):
    """Execute a saved motion on a simulated arm, or check it and send it to a controller of ROS 2.

    With --on ros, the motion is checked; only --execute sends it. The exit status is 0 if the arm reached the end of the
    motion, or was stopped as --stop requested, or if the check without --execute passed. It is 1 after a fault, or if the
    motion was refused.
    """

    plan: Path = argument("PLAN", f"A{STORED_MOTION[1:]}.")
    on: str = option("Options", f"{DRIVE_HELP}.", "ideal")
    execute: bool = option("Options", "Send the motion; with --on ros, THE ARM MOVES.", False, "--execute")
    stop: float | None = option("Options", "Time at which to stop on the path [s].")
    solver: str = option("Options", "IK method with which the motion was planned.", "lm")
    allow: list[str] | None = option("Options", ALLOW_HELP)
    url: str | None = option(ROS_PANEL, "Address of rosbridge, by default ws://127.0.0.1:9090.")
    via: str = option(ROS_PANEL, "rosbridge, or rclpy with ROS 2 sourced.", "rosbridge")
    action: str | None = option(ROS_PANEL, "Name of the controller's action.")
    states: str | None = option(ROS_PANEL, "Topic of the joint states.")
    joint_names: str | None = option(ROS_PANEL, "The controller's joint names, comma separated, in the robot's order.")
    out: Path | None = option("Output", "File for the execution, FILE.json.")

    def run(self) -> None:
        """Execute, write and print."""
        self._check()
        allowed = read_allowed(self.allow)
        from planners.cell.show import restore_plan

        planned = restore_plan(read_motion(self.plan), solver=self.solver, allow=allowed)
        execute = self._execute_through_ros if self.on == "ros" else self._simulate
        executed = execute(planned, {"stop": self.stop, "allow": allowed})
        data = execution_data(executed)
        if self.out is not None:
            from planners.files.base import to_plain

            stored = data | {"plan": to_plain(executed.plan.motion)}  # for `optik view`
            text = json.dumps(stored, allow_nan=False) + "\n"
            write_atomically(self.out, lambda part: part.write_text(text, encoding="utf-8"))
        if self.as_json:
            print_json(data)
        else:
            _print_execution(executed)
            if self.out is not None:
                out_console.print(f"written to {self.out}")
        raise typer.Exit(0 if executed.status in ("done", "dry_run", "stopped") else 1)

    def _check(self) -> None:
        """Raise InvalidInput for options that do not fit together."""
        if self.out is not None and self.out.suffix.lower() != ".json":
            raise InvalidInput("--out", self.out, "a name that ends in .json")
        if self.out is not None and self.out.resolve() == self.plan.resolve():
            raise InvalidInput("--out", self.out, "a file other than the motion's")
        given = [self.url, self.action, self.states, self.joint_names, None if self.via == "rosbridge" else self.via]
        if self.on != "ros" and any(value is not None for value in given):
            raise InvalidInput("--on", self.on, "--on ros with --url, --via, --action, --states and --joint-names")
        if self.via not in ("rosbridge", "rclpy"):
            raise InvalidInput("--via", self.via, "rosbridge or rclpy")
        if self.via == "rclpy" and self.url is not None:
            advice = "omit --url: rclpy finds the controller by its name"
            raise InvalidInput("--url", self.url, "no address with --via rclpy", advice=advice)
        if self.stop is not None and not (np.isfinite(self.stop) and self.stop >= 0.0):
            raise InvalidInput("--stop", self.stop, "a time of at least 0 s")

    def _simulate(self, planned: Plan, settings: dict[str, Any]) -> Execution:
        """Execute the motion on a simulated arm."""
        from planners.cell.drives import make_drive

        if self.execute:
            err_console.print(f"--execute has no effect: {self.on} is simulated", style="yellow")
        return make_drive(self.on, planned.robot).execute(planned, **settings)

    def _execute_through_ros(self, planned: Plan, settings: dict[str, Any]) -> Execution:
        """Check the motion against the state of the arm; send it with ``--execute``."""
        from planners.cell.drives.ros import RosDrive
        from planners.ros.rclpy import RclpyTransport
        from planners.ros.rosbridge import URL, RosbridgeTransport

        robot, joint_names = planned.robot, None
        if self.joint_names is not None:
            given = [name.strip() for name in self.joint_names.split(",")]
            if len(set(given)) != robot.n or len(given) != robot.n:
                raise InvalidInput("--joint-names", self.joint_names, f"{robot.n} different names, comma separated")
            joint_names = dict(zip(robot.joint_names, given, strict=True))
        topics: dict[str, Any] = {"action": self.action, "states": self.states}
        topics = {key: value for key, value in topics.items() if value is not None}
        transport = RclpyTransport(**topics) if self.via == "rclpy" else RosbridgeTransport(self.url or URL, **topics)
        with transport:
            drive = RosDrive(robot, transport, execute=self.execute, joint_names=joint_names)
            return drive.execute(planned, **settings)


def _print_execution(done: Execution) -> None:
    """Print an execution."""
    good, advice = done.status in ("done", "dry_run", "stopped"), done.advice
    if done.status == "stopped":  # on request; to resume is for Python
        advice = ""
    out_console.print(f"{done.drive}: {done.status}", style="green" if good else "yellow")
    for words in (done.reason, advice and f"to try: {advice}"):
        if words:
            out_console.print(translate(words), soft_wrap=True)
    if done.motion is not None:
        _print_joints(done)
        distance, angle = compute_tool_error(done)
        out_console.print(
            f"executed {done.t[-1]:.3f} s of a motion of {done.motion.end:.3f} s; {done.late} late ticks; final tool error "
            f"{_format_small(1e3 * distance)} mm, {_format_small(np.degrees(angle))}°",
            soft_wrap=True,
        )
    for note in done.notes:
        out_console.print(f"note: {note}", soft_wrap=True)


def _format_small(value: float) -> str:
    """Format a number with three digits; below a millionth it is rounding."""
    return f"{value:.3g}" if not value < 1e-6 else "less than 1e-6"


def _print_joints(done: Execution) -> None:
    """Print the tracking error and torque of every joint."""
    robot, bound = done.robot, done.plan.certificate.torque.value
    columns = ["joint", "largest tracking error"]
    if done.torque is not None:
        columns += ["peak torque", "certified bound"]
    title = "" if done.torque is None else "peak torque and the certificate's bound for the planned motion"
    table = Table(*columns, title=title)
    tracking = np.abs(compute_tracking_error(done)).max(axis=0) * unit_factors(robot)
    for i, name in enumerate(robot.joint_names):
        row = [name, f"{tracking[i]:.3g}{unit_names(robot)[i]}"]
        if done.torque is not None:
            unit = "N" if robot.prismatic[i] else "N·m"
            row += [f"{np.abs(done.torque[:, i]).max():.3g} {unit}"]
            row += [f"{bound[i]:.3g} {unit}" if np.isfinite(bound[i]) else "no limit"]
        table.add_row(*row)
    out_console.print(table)
    if done.torque is not None:
        words = (
            "between setpoints, and while errors are corrected, the torque can exceed the bound of the planned motion"
        )
        out_console.print(words, soft_wrap=True)


def compute_tracking_error(done: Execution) -> Any:
    """Return the joint positions of the arm minus those of the motion that was sent (k, n) [rad, m]."""
    assert done.motion is not None and done.setpoints is not None
    sent = done.t <= done.setpoints.t[-1]
    return done.q[sent] - done.motion(np.minimum(done.t[sent], done.motion.end))


def compute_tool_error(done: Execution) -> tuple[float, float]:
    """Return the distance [m] and angle [rad] of the tool from the end of the motion."""
    from optik import se3

    assert done.motion is not None
    error = se3.error(done.robot.fk(done.q[-1]), done.robot.fk(done.motion(done.motion.end)))
    return float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))


def execution_data(done: Execution) -> dict[str, Any]:
    """Return an execution as plain data for files and programs."""
    from planners.cell.show import EXECUTION

    data: dict[str, Any] = {
        "format": EXECUTION, "drive": done.drive, "robot": done.robot.name,
        "robot_fingerprint": done.robot.fingerprint, "joint_names": list(done.robot.joint_names),
        "status": str(done.status), "reason": done.reason, "advice": done.advice, "late": done.late,
        "fault": None if done.fault is None else {**done.fault._asdict(), "kind": str(done.fault.kind)},
        "notes": list(done.notes), "t": done.t.tolist(), "q": _to_finite(done.q),
        "dq": _to_finite(done.dq), "torque": None if done.torque is None else _to_finite(done.torque),
    }  # fmt: skip
    if done.motion is not None and done.setpoints is not None:
        distance, angle = compute_tool_error(done)
        data |= {
            "duration": done.motion.end,
            "setpoints": {name: _to_finite(x) for name, x in done.setpoints._asdict().items() if name != "period"},
            "tracking": _to_finite(np.abs(compute_tracking_error(done)).max(axis=0)),
            "tool_error": {"distance": _to_finite(distance), "angle": _to_finite(angle)},
        }
    return data


def _to_finite(values: Any) -> Any:
    """Return an array as nested lists, with None for NaN and infinity."""
    return np.where(np.isfinite(values), values, np.array(None)).tolist()


# ---------------------------------------------------------------- optik view


@dataclass(frozen=True, kw_only=True)
class ViewCommand(command.StartCommand):
    """Show a motion, an execution, a failed plan, an arm or a scene in the browser, as one self-contained page.

    The page is written beside the file, or to --html FILE. This command never moves a real arm.
    """

    plan: Path = argument(
        "FILE",
        "A file written by `optik plan … --out` or `--out-failed`, or by `optik drive … --out`; an arm, as --robot "
        "takes it; or with --robot a scene.",
    )
    html: Path | None = option("Options", "Write the page to FILE.html, and do not open it.")
    drive: str | None = option("Options", "Also execute the motion on a simulated drive.")

    def run(self) -> None:
        """Write the page, and open it."""
        from optik.view.page import PAGE_SUFFIXES, write_page

        html, drive = self.html, self.drive
        if drive is not None:
            check_simulated(drive)
        if html is not None and html.suffix.lower() not in PAGE_SUFFIXES:  # before a drive takes its time
            raise InvalidInput("--html", html, f"a name that ends in {' or '.join(PAGE_SUFFIXES)}")
        page = html or Path(split_links(str(self.plan))[0]).with_suffix(".html")
        write_page(self._show_arm() or _make_show(_read_recording(self.plan, drive), drive), page)
        opened = html is None and webbrowser.open(page.absolute().as_uri())
        out_console.print(f"written to {page}{'' if opened else ': open it in a browser'}", soft_wrap=True)

    def _show_arm(self) -> Show | None:
        """Return the content for an arm, or for a scene with the typed arm; None for a file of a motion."""
        from optik.arm.library import PREFIX, URDF
        from optik.view.page import make_arm_show

        name, suffix = str(self.plan), Path(split_links(str(self.plan))[0]).suffix.lower()
        content = read_bytes(self.plan) if suffix == ".toml" and self.plan.is_file() else b"convention"
        typed = self.robot != command.RobotCommand.robot and "format" not in _read_json(self.plan)  # else a motion
        is_scene = typed or suffix in (".yaml", ".yml", ".scene") or b"convention" not in content
        is_name = name.startswith(PREFIX) or not (suffix or self.plan.exists())
        is_scene &= (group := read_group(name)) is None
        if not (group or is_scene or is_name or suffix in (*URDF, ".toml", ".py")):
            return None
        if self.drive is not None:
            raise InvalidInput("--drive", f"{self.drive} for {name}", "a motion")
        robot = self.robot if is_scene else name
        if (group := group or read_group(robot)) is not None:
            q, words = read_start(group, self.start_deg)
            Start(group.as_robot(), q, words).print_default()
            return make_arm_show(group.as_robot(), q, optik.Scene.load(name) if is_scene else None)
        try:
            shaped = f"{robot}{'&' if '#' in robot else '#'}shapes=yes"
            start = replace(self, robot=shaped if split_links(robot)[0].lower().endswith(URDF) else robot).load_start()
        except RobotModelError:  # its meshes are elsewhere: lines between its joints
            start = replace(self, robot=robot).load_start()
        scene = optik.Scene.load(name, robot=start.arm) if is_scene else None
        start.print_default()
        return make_arm_show(start.arm, start.q, scene)


def check_simulated(drive: str) -> str:
    """Return the name of a drive; raise InvalidInput if it moves a real arm."""
    if not getattr(load_method("planners.cell.drives", drive, "drive"), "simulated", False):
        raise InvalidInput("--drive", f"{drive}, which moves a real arm", "a simulated drive")
    return drive


def _make_show(shown: Motion | Plan | Show, drive: str | None = None) -> Show:
    """Return the recording for a page; with a drive, execute a plan first."""
    from optik.view.show import Show
    from planners.cell.drives import make_drive
    from planners.cell.show import show_execution
    from planners.motion.show import show_motion
    from planners.plan import Plan

    if drive is None or not isinstance(shown, Plan):
        return shown if isinstance(shown, Show) else show_motion(shown)
    execution = make_drive(drive, shown.robot).execute(shown)
    if not execution:
        err_console.print(f"{drive}: {execution.reason}", style="yellow", soft_wrap=True)
    return show_execution(execution)


# ---------------------------------------------------------------- files


def _read_recording(file: Path, drive: str | None = None) -> Motion | Plan | Show:
    """Read a motion (as a plan, for a drive), an execution or a failed plan; errors as in `read_motion`."""
    from planners.cell.show import EXECUTION, restore_plan, show_recorded
    from planners.planning.failed import FAILED_PLAN

    data = _read_json(file)
    if data.get("format") in (EXECUTION, FAILED_PLAN):
        if drive is not None:
            came = f"{file}, an execution or a failed plan, with --drive {drive}"
            raise InvalidInput("FILE", came, STORED_MOTION, advice="omit --drive to show this file")
        return show_recorded(data)
    motion = read_motion(file, "FILE")
    return motion if drive is None else restore_plan(motion)


def read_motion(file: Path, name: str = "PLAN") -> Motion:
    """Read a motion; `name` is the option or argument in errors."""
    from planners.cell.show import EXECUTION
    from planners.files import load_motion
    from planners.planning.failed import FAILED_PLAN

    if file.is_dir():
        raise InvalidInput(name, f"the folder {file}", STORED_MOTION)
    try:
        return load_motion(file)
    except InvalidInput as error:
        if error.argument == "file":  # its name, or that it cannot be read
            raise InvalidInput(name, error.got, STORED_MOTION) from None
        if error.argument.endswith("format") and error.got == "None":
            advice = f"`optik certify {file}` judges the motion of another program"
            raise InvalidInput(name, f"{file}, which is none", STORED_MOTION, advice=advice) from None
        data = _read_json(file)
        if data.get("format") == EXECUTION:
            advice = "`optik view` shows this file"
            raise InvalidInput(name, f"{file}, an execution", STORED_MOTION, advice=advice) from None
        if data.get("format") not in ("optik-plan/2", FAILED_PLAN):
            raise error
        if data.get("reason"):
            words = f"{file} is a failed plan: {data['reason']}"
            raise NoSolution(words, s=data.get("s"), joint=data.get("joint"), advice=data.get("advice", "")) from None
        raise InvalidInput(name, f"{file}, the output of `optik plan … --json`", STORED_MOTION) from None


def _read_json(file: Path) -> dict[str, Any]:
    """Return the content of a JSON file; empty for any other file."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


# ---------------- `optik stream`


@dataclass(frozen=True, kw_only=True)
class StreamCommand(command.LimitsCommand, command.TableCommand):
    """Join chunks of joint targets while the arm moves, every time within the limits, and execute them on a simulated arm.

    The file has the columns observed [s], index, and the joints (q1_deg,… or their names). Rows with the same time of
    observation are one chunk. The exit status is 0 if the arm followed to the end at rest.
    """

    file: Path = argument("FILE", "Table of the chunks, FILE.csv.")
    on: str = option("Options", f"{DRIVE_HELP}.", "ideal")
    rate: float = option("Options", "Targets of a chunk per second [1/s].", 20.0)
    latency: float = option("Options", "Time from the observation of a chunk to its arrival [s].", 0.1)
    pace: float = option("Options", "Largest rate of the chunks, over their own; above 1 to be faster.", 1.0)
    tolerance: float = option("Options", "Largest distance of a smoothed target [rad, prismatic m].", 0.005)
    start_deg: str | None = option("Robot", "Start [degrees, prismatic mm]; by default the first target.")
    out: Path | None = option("Output", "File for set-points and measured positions, FILE.csv.")

    def run(self) -> None:
        """Stream, execute, and print."""
        from planners import MotionLimits, stream
        from planners.cell.drives import make_drive
        from planners.streams.chunk import load_chunks

        if self.out is not None and self.out.suffix.lower() != ".csv":
            raise InvalidInput("--out", self.out, "a name that ends in .csv")
        if not 0.0 <= self.latency <= 10.0:
            raise InvalidInput("--latency", self.latency, "seconds, from 0 to 10")
        arm = self.load()
        chunks = load_chunks(self.file, arm, self.rate, columns=self.columns, ignore=self.ignore)
        limits = MotionLimits.of(arm, **self.read_typed_limits(arm))
        first = np.asarray(chunks[0].points)[0]
        start = first if self.start_deg is None else read_configuration(arm, self.start_deg)
        drive = make_drive(self.on, arm)
        source = _Recording(chunks, self.latency)
        options: dict[str, Any] = {"limits": limits, "pace": self.pace, "tolerance": self.tolerance}
        flow = stream(
            arm, source, start, rate=1.0 / drive.period, realtime=False, silence=source.longest_gap, **options
        )
        done = drive.follow(flow)
        if self.out is not None:
            header = ",".join(["t", *arm.joint_names, *(f"measured_{name}" for name in arm.joint_names)])
            np.savetxt(
                self.out, np.column_stack([done.t, done.setpoints, done.q]), "%.9g", ",", header=header, comments=""
            )
        if self.as_json:
            data = {"report": done.report._asdict(), "error": done.error.tolist(), "fault": done.fault}
            print_json(data | {"end": float(done.t[-1])})
        else:
            report = str(done.report).replace("tolerance=", "--tolerance ")
            out_console.print(f"{len(chunks)} chunks on {self.on}, {done.t[-1]:.3g} s\n{report}", highlight=False)
            out_console.print(f"largest distance from the set-points: {1e3 * done.error.max():.3g} mrad (or mm)")
            if done.fault:
                out_console.print(f"stopped: {done.fault}", style="red")
            if self.out is not None:
                out_console.print(f"written to {self.out}")
        raise typer.Exit(0 if done and done.report.joined else 1)


class _Recording:
    """A source that gives each chunk a time after its observation."""

    def __init__(self, chunks: list[Chunk], latency: float) -> None:
        self._waiting = [(chunk.observed + latency, chunk) for chunk in chunks]
        times = np.array([0.0, *(t for t, _ in self._waiting)])
        self.longest_gap = float(np.diff(times).max()) + 0.1

    def __call__(self, now: Setpoint) -> Chunk | None:
        """Return the chunk that has come last, if one has."""
        come = [chunk for t, chunk in self._waiting if t <= now.t]
        self._waiting = self._waiting[len(come) :]
        return come[-1] if come else None
