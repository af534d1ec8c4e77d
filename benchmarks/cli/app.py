"""The command line: `optik` and its commands. Exit status 0, 1 (ran, no solution), 2 (misuse)."""

from __future__ import annotations

import sys
import traceback
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

import optik
from benchmarks.cli.bench import bench_app, demo
from benchmarks.cli.cell import cell
from benchmarks.cli.doctor import doctor
from benchmarks.cli.drive import drive
from benchmarks.cli.kernels import kernels
from benchmarks.cli.output import guard_output
from benchmarks.cli.peer import bench_peer
from benchmarks.cli.plan import plan_app
from benchmarks.cli.shared import (
    NUMBERS,
    Q_DEG,
    AsJson,
    Base,
    RobotName,
    StartDeg,
    Tip,
    command,
    err_console,
    load_arm,
    load_or_error,
    out_console,
    print_json,
    print_start,
    read_numbers,
    read_start,
)
from benchmarks.cli.view import view
from optik.arm.robot import Robot
from optik.arm.units import unit_factors, unit_names
from optik.errors import InvalidInput, InvalidMotion, NoSolution, OptikError
from optik.ik import IKResult
from optik.plugins import files
from optik.registry import short_name

TASKS = ("pose", "position", "rotation", "axis_x", "axis_y", "axis_z")
"""Values of ``optik ik --task``."""

app = typer.Typer(
    help="Plan certified trajectories for serial arms, and compare methods of inverse kinematics and time laws.",
    rich_markup_mode="markdown",  # units in [brackets] are no markup
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(plan_app, name="plan")
app.add_typer(bench_app, name="bench")


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


def main() -> None:
    """Run the command line: an OptikError is one line with exit status 2, or 1 if there is no solution."""
    guard_output()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # a full disk is reported here
    except InvalidMotion as error:
        words = str(error).replace(f"allow={error.allow!r}", f"--allow {','.join(error.allow)}")
        err_console.print(f"not valid: {words}", style="yellow", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except NoSolution as error:
        err_console.print(f"no solution: {error}", style="yellow", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except OptikError as error:
        err_console.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except Exception as error:
        words = _describe_plugin_error(error)
        if not words:
            raise
        err_console.print(f"error: {words}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)


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


# ---------------------------------------------------------------- one robot, one pose


@command(app)
def robots(as_json: AsJson = False) -> None:
    """List the robots of optik and of installed packages, with the error of each that cannot be loaded."""
    found = {name: load_or_error(optik.load, name) for name in optik.robots()}
    if as_json:
        print_json([_robot_row(name, robot) for name, robot in found.items()])
        return
    table = Table("robot", "joints", "joint ranges", "source")
    for name, robot in found.items():
        if isinstance(robot, Robot):
            table.add_row(name, str(robot.n), _ranges(robot), escape(robot.source))
        else:
            table.add_row(name, "", "", escape(f"error: {robot}"))
    out_console.print(table)


def _robot_row(name: str, robot: Robot | Exception) -> dict[str, Any]:
    """Return a robot, or its error, as plain data for ``optik robots --json``."""
    if not isinstance(robot, Robot):
        return {"name": name, "error": str(robot)}
    return {"name": name, "joints": robot.n, "source": robot.source, "fingerprint": robot.fingerprint}


def _ranges(robot: Robot) -> str:
    """Return the joint ranges in degrees and millimetres."""
    lower, upper = robot.limits.lower * unit_factors(robot), robot.limits.upper * unit_factors(robot)
    return ", ".join(f"{lo:.0f}…{hi:.0f}{unit}" for lo, hi, unit in zip(lower, upper, unit_names(robot), strict=True))


@command(app, context_settings={"ignore_unknown_options": True})  # negative numbers are values, not options
def fk(
    q_deg: Annotated[
        str, typer.Argument(metavar=Q_DEG, help='Joint values [degrees, sliding mm]: 20,-35,40 or "20 -35 40".')
    ],
    robot: RobotName = "paper6r",
    tip: Tip = None,
    base: Base = None,
    as_json: AsJson = False,
) -> None:
    """Compute forward kinematics: the tool pose for joint values."""
    from optik import se3
    from optik.arm.urdf import roll_pitch_yaw

    arm = load_arm(robot, tip, base)
    values = read_numbers(q_deg, Q_DEG, arm.n, what=f"joint values of {arm.name} [degrees, sliding mm]")
    q = arm.configuration(values, Q_DEG) / unit_factors(arm)
    T = arm.fk(q)
    smallest = float(arm.singular_values(q)[-1])
    inside = bool(arm.limits.contains(q))
    rpy_deg, quat = np.degrees(roll_pitch_yaw(T[:3, :3])), se3.quaternion(T[:3, :3])
    if as_json:
        print_json(
            {
                "robot": arm.name, "pose": T.tolist(), "xyz": T[:3, 3].tolist(), "rpy_deg": rpy_deg.tolist(),
                "quat": quat.tolist(), "smallest_singular_value": smallest, "inside_limits": inside,
            }
        )  # fmt: skip
        return
    table = Table("", "x", "y", "z", "position, m", title=f"tool of {arm.name} in its base frame")
    for axis, row in zip("xyz", T[:3], strict=True):
        table.add_row(axis, *(f"{v:+.6f}" for v in row))
    out_console.print(table)
    for option, part, unit in (("xyz", T[:3, 3], "m"), ("rpy-deg", rpy_deg, "degrees"), ("quat", quat, "w,x,y,z")):
        out_console.print(
            f"--{option} {','.join(f'{x + 0.0:.6f}' for x in part)}  [{unit}]", markup=False, soft_wrap=True
        )
    note = "inside the joint limits" if inside else "OUTSIDE the joint limits"
    out_console.print(f"smallest singular value of the Jacobian {smallest:.4g}; {note}")


@command(app)
def ik(
    xyz: Annotated[
        str, typer.Option(metavar=NUMBERS, help='Target position in the base frame [m]: 0.1,0.3,0.2 or "0.1 0.3 0.2".')
    ],
    rpy_deg: Annotated[str, typer.Option(metavar=NUMBERS, help="Target roll, pitch, yaw [degrees].")] = "",
    quat: Annotated[
        str, typer.Option(metavar=NUMBERS, help="Target orientation as a quaternion w,x,y,z, in place of --rpy-deg.")
    ] = "",
    start_deg: StartDeg = "",
    robot: RobotName = "paper6r",
    tip: Tip = None,
    base: Base = None,
    solver: Annotated[
        str, typer.Option(help=f"IK method, one of: {', '.join(optik.ik.solvers())}; or a file: ./jt.py.")
    ] = "lm",
    task: Annotated[str, typer.Option(help=f"Constrained part of the pose, one of: {', '.join(TASKS)}.")] = "pose",
    closest: Annotated[bool, typer.Option(help="If there is no solution, return the nearest pose.")] = False,
    restarts: Annotated[int, typer.Option(help="Largest number of restarts.")] = 200,
    as_json: AsJson = False,
) -> None:
    """Solve inverse kinematics: joint values for a tool pose.

    Without --rpy-deg or --quat, the target has the orientation of the tool at the start configuration.
    """
    from optik import se3

    arm = load_arm(robot, tip, base)
    position = read_numbers(xyz, "--xyz", 3)
    if rpy_deg.strip() and quat.strip():
        raise InvalidInput("--quat", f"{quat} together with --rpy-deg {rpy_deg}", "either --quat or --rpy-deg")
    q0, words = read_start(arm, robot, start_deg)
    R = arm.fk(q0)[:3, :3]
    if rpy_deg.strip():
        R = se3.from_xyz_rpy((0, 0, 0), read_numbers(rpy_deg, "--rpy-deg", 3))[:3, :3]
    if quat.strip():
        R = se3.from_quaternion(read_numbers(quat, "--quat", 4), "--quat")
    if task not in TASKS:
        raise InvalidInput("--task", task, f"one of: {', '.join(TASKS)}")
    result = optik.solve_ik(arm, se3.pose(R, position), q0, solver, max_restarts=restarts, task=task, closest=closest)
    print_start(words)
    (_print_ik_json if as_json else _print_ik)(arm, result, short_name(solver))
    if not result:
        if not as_json:
            said = f"{result.message}; " if result.message else ""
            err_console.print(f"not solved: {said}try {result.status.advice}", style="yellow", soft_wrap=True)
        raise typer.Exit(1)


def _print_ik_json(arm: Robot, result: IKResult, solver: str) -> None:
    """Print a result as JSON."""
    print_json(
        {
            "robot": arm.name, "solver": solver, "status": str(result.status), "solved": bool(result),
            "q_deg": (result.q * unit_factors(arm)).tolist(), "q_deg_units": [unit.strip() for unit in unit_names(arm)],
            "q": result.q.tolist(), "iterations": result.iterations,
            "restarts": result.restarts, "position_error": result.position_error,
            "rotation_error": result.rotation_error, "message": result.message, "advice": result.status.advice,
        }
    )  # fmt: skip


def _print_ik(arm: Robot, result: IKResult, solver: str) -> None:
    """Print a result as a table."""
    title = f"{result.status}, {result.iterations} iterations, {result.restarts} restarts"
    table = Table("joint", "value", "range", title=title)
    rows = zip(
        arm.joint_names, result.q, arm.limits.lower, arm.limits.upper, unit_factors(arm), unit_names(arm), strict=True
    )
    for name, value, lo, hi, scale, unit in rows:
        table.add_row(name, f"{value * scale:+.6f}{unit}", f"{lo * scale:.0f} … {hi * scale:.0f}{unit}")
    out_console.print(table)
    out_console.print(
        f"position error {1e3 * result.position_error:.3g} mm, rotation error {np.degrees(result.rotation_error):.3g}°"
    )


command(app)(demo)
command(app)(doctor)
command(app)(drive)
command(app)(kernels)
command(app)(cell)
command(app)(view)
command(bench_app, "peer")(bench_peer)


if __name__ == "__main__":
    main()
