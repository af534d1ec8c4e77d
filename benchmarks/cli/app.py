"""The command line, the roof of the house. Exit status 0, 1 (ran, no solution), 2 (misuse)."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli.output import guard_output
from benchmarks.cli.plan import plan_app
from benchmarks.cli.shared import (
    AsJson,
    RobotName,
    arm_of,
    configuration,
    err_console,
    out_console,
    print_json,
)
from optik.arm.units import per, units
from optik.errors import NoSolution, OptikError

app = typer.Typer(
    help="Trajectories for serial arms: inverse kinematics, paths, time laws with a certificate, and a fair comparison.",
    rich_markup_mode="markdown",  # units in [brackets] are no markup
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
bench_app = typer.Typer(help="Compare methods: run a suite, write its report, list the suites.", no_args_is_help=True)
app.add_typer(plan_app, name="plan")
app.add_typer(bench_app, name="bench")

Workers = Annotated[int, typer.Option(help="Processes; more than one disturb each other's times, never the answers.")]


def main() -> None:
    """Run the command line; every error of ours is one line and exit status 2, or 1 where there is no solution."""
    guard_output()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # here, where a full disk still has a name
    except NoSolution as error:
        err_console.print(f"no solution: {error}", style="yellow", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except OptikError as error:
        err_console.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)


# ---------------------------------------------------------------- one robot, one pose


@app.command()
def robots(as_json: AsJson = False) -> None:
    """List the robots that come with optik."""
    found = [optik.load(name) for name in optik.robots()]
    if as_json:
        print_json([{"name": r.name, "joints": r.n, "source": r.source, "fingerprint": r.fingerprint} for r in found])
        return
    table = Table("robot", "joints", "joint ranges", "source")
    for robot in found:
        ranges = ", ".join(
            f"{lo:.0f}…{hi:.0f}{unit}"
            for lo, hi, unit in zip(
                robot.limits.lower * per(robot), robot.limits.upper * per(robot), units(robot), strict=True
            )
        )
        table.add_row(robot.name, str(robot.n), ranges, robot.source)
    out_console.print(table)


@app.command(context_settings={"ignore_unknown_options": True})  # negative numbers are values, not options
def fk(
    q_deg: Annotated[list[float], typer.Argument(help="Joint values in degrees; sliding joints in millimetres.")],
    robot: RobotName = "paper6r",
    as_json: AsJson = False,
) -> None:
    """Forward kinematics: where the tool is."""
    arm = arm_of(robot)
    q = arm.configuration(q_deg, "Q_DEG") / per(arm)
    T = arm.fk(q)
    smallest = float(arm.singular_values(q)[-1])
    inside = bool(arm.limits.contains(q))
    if as_json:
        print_json(
            {"robot": arm.name, "pose": T.tolist(), "smallest_singular_value": smallest, "inside_limits": inside}
        )
        return
    table = Table("", "x", "y", "z", "position, m", title=f"tool of {arm.name} in its base frame")
    for axis, row in zip("xyz", T[:3], strict=True):
        table.add_row(axis, *(f"{v:+.6f}" for v in row))
    out_console.print(table)
    note = "inside the joint limits" if inside else "OUTSIDE the joint limits"
    out_console.print(f"smallest singular value of the Jacobian {smallest:.4g}; {note}")


@app.command()
def ik(
    xyz: Annotated[tuple[float, float, float], typer.Option(help="Target position in the base frame [m].")],
    rpy_deg: Annotated[
        tuple[float, float, float] | None, typer.Option(help="Target roll, pitch, yaw [degrees].")
    ] = None,
    start_deg: Annotated[
        str, typer.Option(help="Start [degrees, mm], comma separated; middle of the ranges if left out.")
    ] = "",
    robot: RobotName = "paper6r",
    solver: Annotated[str, typer.Option(help=f"One of: {', '.join(optik.ik.solvers())}.")] = "lm",
    task: Annotated[str, typer.Option(help="pose, position, rotation, axis_x, axis_y or axis_z.")] = "pose",
    closest: Annotated[bool, typer.Option(help="Where there is no solution, go to the nearest pose.")] = False,
    restarts: Annotated[int, typer.Option(help="Attempts after the first.")] = 200,
    as_json: AsJson = False,
) -> None:
    """Inverse kinematics: joint values for a tool pose. Without --rpy-deg the orientation of the start is kept."""
    from optik import se3

    arm = arm_of(robot)
    q0 = configuration(arm, start_deg)
    R = se3.from_xyz_rpy((0, 0, 0), rpy_deg)[:3, :3] if rpy_deg is not None else arm.fk(q0)[:3, :3]
    result = optik.solve_ik(arm, se3.pose(R, xyz), q0, solver, max_restarts=restarts, task=task, closest=closest)
    if as_json:
        print_json(
            {
                "robot": arm.name, "solver": solver, "status": str(result.status), "solved": bool(result),
                "q_deg": (result.q * per(arm)).tolist(), "q_deg_units": [unit.strip() for unit in units(arm)],
                "q": result.q.tolist(), "iterations": result.iterations,
                "restarts": result.restarts, "position_error": result.position_error,
                "rotation_error": result.rotation_error, "message": result.message, "advice": result.status.advice,
            }
        )  # fmt: skip
    else:
        table = Table(
            "joint",
            "value",
            "range",
            title=f"{result.status}, {result.iterations} iterations, {result.restarts} restarts",
        )
        rows = zip(arm.joint_names, result.q, arm.limits.lower, arm.limits.upper, per(arm), units(arm), strict=True)
        for name, value, lo, hi, scale, unit in rows:
            table.add_row(name, f"{value * scale:+.6f}{unit}", f"{lo * scale:.0f} … {hi * scale:.0f}{unit}")
        out_console.print(table)
        out_console.print(
            f"position error {1e3 * result.position_error:.3g} mm, rotation error {np.degrees(result.rotation_error):.3g}°"
        )
    if not result:
        if not as_json:
            said = f"{result.message}; " if result.message else ""
            err_console.print(f"not solved: {said}try {result.status.advice}", style="yellow", soft_wrap=True)
        raise typer.Exit(1)


# ---------------------------------------------------------------- comparisons


@bench_app.command("list")
def bench_list(as_json: AsJson = False) -> None:
    """List the suites."""
    from benchmarks.suite import SUITES, load_suite
    from optik.registry import names

    suites = [load_suite(name) for name in names(SUITES)]
    if as_json:
        print_json(
            [{"name": s.name, "title": s.title, "fingerprint": s.fingerprint, "settings": s.settings} for s in suites]
        )
        return
    table = Table("suite", "what", "blocks", "timed call by call", "batches", "time laws", "line")
    for suite in suites:
        line = f"{len(suite.line.ik)} IK methods × {len(suite.line.laws)} laws" if suite.line else "none"
        ids = [
            ", ".join(b.id for b in part) or "none" for part in (suite.blocks, suite.speed, suite.batch, suite.timing)
        ]
        table.add_row(suite.name, suite.title, *ids, line)
    out_console.print(table)


@bench_app.command("run")
def bench_run(
    suite: Annotated[str, typer.Argument(help="A name from `optik bench list`, or a TOML file.")],
    out: Annotated[Path, typer.Option(help="Folder of the run: new, empty, or of the same suite and settings.")],
    workers: Workers = 1,
    as_json: AsJson = False,
) -> None:
    """Run a suite into a folder; a run that was stopped is continued.

    What speed is asked of (ik-speed) is timed in one process, whatever the number of workers.
    """
    folder = run_with_progress(suite, out, workers)
    if as_json:
        print_json(folder.manifest())
    else:
        out_console.print(
            f"run in {out}; its report: optik bench report {shlex.quote(str(out))}", highlight=False, soft_wrap=True
        )


@bench_app.command("report")
def bench_report(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    as_json: AsJson = False,
) -> None:
    """Write the report of a run: one HTML file that opens offline."""
    from benchmarks.records import RunFolder
    from benchmarks.report import write_report

    with err_console.status("writing the report"):
        page = write_report(RunFolder(run))
    if as_json:
        print_json({"report": str(page)})
    else:
        out_console.print(f"report: {page}", highlight=False, soft_wrap=True)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the run and its report.")] = Path("optik-demo"),
    workers: Workers = 1,
    as_json: AsJson = False,
) -> None:
    """Compare the methods on the paper's line and workspace: the suite `paper` and its report."""
    from benchmarks.experiments.claims import judge
    from benchmarks.report import write_report

    folder = run_with_progress("paper", out, workers)
    with err_console.status("writing the report"):
        page = write_report(folder)
    findings = judge(folder)
    if as_json:
        print_json({"report": str(page), "claims": [{"claim": f.claim, "verdict": f.verdict} for f in findings]})
        return
    table = Table("", "the paper's claim", "verdict")
    for f in findings:
        table.add_row(f.key, f.claim, f.verdict)
    out_console.print(table)
    out_console.print(f"report: {page}", highlight=False, soft_wrap=True)


def run_with_progress(suite: str, out: Path, workers: int) -> Any:
    """Run a suite with a progress bar on the error stream."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from benchmarks.run import run_suite
    from benchmarks.suite import load_suite

    asked = load_suite(suite)
    command = f"optik bench run {shlex.quote(suite)} --out RUN" + (f" --workers {workers}" if workers != 1 else "")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err_console, transient=True) as bar:
        task = bar.add_task("compiling", total=None)
        try:
            return run_suite(
                asked,
                out,
                workers=workers,
                command=command,
                progress=lambda done, total, what: bar.update(task, completed=done, total=total, description=what),
            )
        except KeyboardInterrupt:
            bar.stop()
            err_console.print("stopped; run the same command again to continue", style="yellow")
            raise typer.Exit(130) from None


if __name__ == "__main__":
    main()
