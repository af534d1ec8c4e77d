"""`optik drive`: execute a saved motion on a simulated arm, or on a controller of ROS 2."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer
from rich.table import Table

from benchmarks.cli.shared import Allowed, AsJson, err_console, out_console, print_json, read_allowed
from optik.arm.units import unit_factors, unit_names
from optik.errors import InvalidInput
from optik.file_io import write_atomically
from optik.registry import names

if TYPE_CHECKING:
    from planners.cell.drives.base import Execution
    from planners.plan import Plan

DRIVE_NAMES = names("planners.cell.drives")
"""Names of the drives, for the help."""


Url = Annotated[str | None, typer.Option(help="Address of rosbridge, by default ws://127.0.0.1:9090; with --on ros.")]
Via = Annotated[str, typer.Option(help="rosbridge, or rclpy with ROS 2 sourced; with --on ros.")]
Action = Annotated[str | None, typer.Option(help="Name of the controller's action; with --on ros.")]
States = Annotated[str | None, typer.Option(help="Topic of the joint states; with --on ros.")]
JointNames = Annotated[
    str | None, typer.Option(help="The controller's joint names, comma separated, in the robot's order; with --on ros.")
]


class RosOptions(NamedTuple):
    """Typed options of the connection to a controller of ROS 2; None for defaults."""

    url: str | None = None
    via: str = "rosbridge"
    action: str | None = None
    states: str | None = None
    joint_names: str | None = None


def drive(
    plan: Annotated[Path, typer.Argument(help="A motion that `optik plan --out` wrote: .json, .npz or .csv.")],
    on: Annotated[str, typer.Option(help=f"Drive, one of: {', '.join(DRIVE_NAMES)}; or a file: ./drive.py.")] = "ideal",
    url: Url = None,
    via: Via = "rosbridge",
    action: Action = None,
    states: States = None,
    joint_names: JointNames = None,
    execute: Annotated[bool, typer.Option("--execute", help="Send the motion; with --on ros, THE ARM MOVES.")] = False,
    stop: Annotated[float | None, typer.Option(help="Time at which to stop on the path [s].")] = None,
    allow: Allowed = None,
    solver: Annotated[str, typer.Option(help="IK method with which the motion was planned.")] = "lm",
    out: Annotated[Path | None, typer.Option(help="File for the execution, FILE.json.")] = None,
    as_json: AsJson = False,
) -> None:
    """Execute a saved motion on a simulated arm, or check it and send it to a controller of ROS 2.

    With --on ros, the motion is checked; only --execute sends it. The exit status is 0 if the arm reached the end of the
    motion, or if the check without --execute passed. It is 1 if the arm was stopped, also by a fault, or the motion was
    refused.
    """
    ros = RosOptions(url, via, action, states, joint_names)
    if out is not None and out.suffix.lower() != ".json":
        raise InvalidInput("--out", str(out), "a name that ends in .json")
    if out is not None and out.resolve() == plan.resolve():
        raise InvalidInput("--out", str(out), "a file other than the motion's")
    if on != "ros" and ros != RosOptions():
        raise InvalidInput("--on", on, "--on ros with --url, --via, --action, --states and --joint-names")
    from benchmarks.cli.view import read_motion
    from planners.cell.stored import restore_plan

    if stop is not None and not (np.isfinite(stop) and stop >= 0.0):
        raise InvalidInput("--stop", stop, "a time of at least 0 s")
    options: dict[str, Any] = {"stop": stop, "allow": read_allowed(allow)}
    planned = restore_plan(read_motion(plan), solver=solver, allow=options["allow"])
    run = partial(_through_ros, ros=ros) if on == "ros" else partial(_simulated, on=on)
    executed = run(planned, execute=execute, options=options)
    _report(executed, out, as_json)
    raise typer.Exit(0 if executed.status in ("done", "dry_run") else 1)


def _report(executed: Execution, out: Path | None, as_json: bool) -> None:
    """Write and print an execution."""
    data = execution_data(executed)
    if out is not None:
        from planners.files.base import to_plain

        text = json.dumps(data | {"plan": to_plain(executed.plan.motion)}, allow_nan=False) + "\n"  # for `optik view`
        write_atomically(out, lambda part: part.write_text(text, encoding="utf-8"))
    if as_json:
        print_json(data)
        return
    print_execution(executed)
    if out is not None:
        out_console.print(f"written to {out}", highlight=False)


def _simulated(planned: Plan, *, on: str, execute: bool, options: dict[str, Any]) -> Execution:
    """Execute the motion on a simulated arm."""
    from planners.cell.drives import make_drive

    if execute:
        err_console.print(f"--execute has no effect: {on} is simulated", style="yellow", highlight=False)
    return make_drive(on, planned.robot).execute(planned, **options)


def _through_ros(planned: Plan, *, ros: RosOptions, execute: bool, options: dict[str, Any]) -> Execution:
    """Check the motion against the state of the arm; send it with `execute`."""
    from planners.cell.drives.ros import RosDrive
    from planners.ros.rclpy import RclpyTransport
    from planners.ros.rosbridge import URL, RosbridgeTransport

    topics: dict[str, Any] = {"action": ros.action, "states": ros.states}
    topics = {key: value for key, value in topics.items() if value is not None}
    if ros.via not in ("rosbridge", "rclpy"):
        raise InvalidInput("--via", ros.via, "rosbridge or rclpy")
    if ros.via == "rclpy" and ros.url is not None:
        raise InvalidInput("--url", ros.url, "no --url with --via rclpy, which finds the controller by its name")
    written = None
    if ros.joint_names is not None:
        given = [name.strip() for name in ros.joint_names.split(",")]
        if len(set(given)) != planned.robot.n or len(given) != planned.robot.n:
            raise InvalidInput("--joint-names", ros.joint_names, f"{planned.robot.n} different names, comma separated")
        written = dict(zip(planned.robot.joint_names, given, strict=True))
    transport = RclpyTransport(**topics) if ros.via == "rclpy" else RosbridgeTransport(ros.url or URL, **topics)
    with transport:
        drive = RosDrive(planned.robot, transport, execute=execute, joint_names=written)
        return drive.execute(planned, **options)


# ---------------------------------------------------------------- what is printed


def print_execution(done: Execution) -> None:
    """Print an execution."""
    good = done.status in ("done", "dry_run")
    style = "green" if good else "yellow"
    out_console.print(f"{done.drive}: {done.status}", style=style, highlight=False)
    for words in (done.reason, done.advice and f"to try: {done.advice}"):
        if words:
            out_console.print(words, highlight=False, markup=False, soft_wrap=True)
    if done.motion is not None:
        _print_joints(done)
        distance, angle = compute_tool_error(done)
        out_console.print(
            f"executed {done.t[-1]:.3f} s of a motion of {done.motion.end:.3f} s; {done.late} late ticks; final tool error "
            f"{_small(1e3 * distance)} mm, {_small(np.degrees(angle))}°",
            highlight=False, soft_wrap=True,
        )  # fmt: skip
    for note in done.notes:
        out_console.print(f"note: {note}", highlight=False, markup=False, soft_wrap=True)


def _small(value: float) -> str:
    """Format a number with three digits; below a millionth it is rounding."""
    return f"{value:.3g}" if not value < 1e-6 else "less than 1e-6"


def _print_joints(done: Execution) -> None:
    """Print the tracking error and torque of every joint."""
    robot, bound = done.robot, done.plan.certificate.torque.value
    title = "" if done.torque is None else "peak torque and the certificate's bound for the planned motion"
    table = Table("joint", "largest tracking error", title=title)
    columns = [np.abs(compute_tracking_error(done)).max(axis=0) * unit_factors(robot)]
    if done.torque is not None:
        table.add_column("peak torque")
        table.add_column("certified bound")
    torque_units = np.where(robot.prismatic, "N", "N·m")
    for i, name in enumerate(robot.joint_names):
        row = [name, f"{columns[0][i]:.3g}{unit_names(robot)[i]}"]
        if done.torque is not None:
            row += [
                f"{np.abs(done.torque[:, i]).max():.3g} {torque_units[i]}",
                f"{bound[i]:.3g} {torque_units[i]}" if np.isfinite(bound[i]) else "no limit",
            ]
        table.add_row(*row)
    out_console.print(table)


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
    from planners.cell.view.recorded import EXECUTION

    data: dict[str, Any] = {
        "format": EXECUTION,
        "drive": done.drive,
        "robot": done.robot.name,
        "robot_fingerprint": done.robot.fingerprint,
        "joint_names": list(done.robot.joint_names),
        "status": str(done.status),
        "reason": done.reason,
        "advice": done.advice,
        "late": done.late,
        "fault": None if done.fault is None else {**done.fault._asdict(), "kind": str(done.fault.kind)},
        "notes": list(done.notes),
        "t": done.t.tolist(),
        "q": _plain(done.q),
        "dq": _plain(done.dq),
        "torque": None if done.torque is None else _plain(done.torque),
    }
    if done.motion is not None and done.setpoints is not None:
        distance, angle = compute_tool_error(done)
        data |= {
            "duration": done.motion.end,
            "setpoints": {name: _plain(x) for name, x in done.setpoints._asdict().items() if name != "period"},
            "tracking": _plain(np.abs(compute_tracking_error(done)).max(axis=0)),
            "tool_error": {"distance": _plain(np.array(distance)), "angle": _plain(np.array(angle))},
        }
    return data


def _plain(values: Any) -> Any:
    """Return nested lists, with None for NaN and infinity."""
    if np.isfinite(values).all():
        return values.tolist()
    return _plain_rows(values.tolist())


def _plain_rows(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain_rows(each) for each in value]
    return value if np.isfinite(value) else None
