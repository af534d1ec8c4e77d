"""`optik view`: a page that plays a motion, written to a file or served."""

from __future__ import annotations

import json
import sys
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from benchmarks.cli.shared import err_console, out_console
from optik.errors import InvalidInput, NoSolution
from optik.registry import load_method

if TYPE_CHECKING:
    from planners import Motion, Plan
    from planners.cell.view.show import Show

LOCAL = "127.0.0.1"
"""Address of this machine only."""

STORED_MOTION = "a motion that `optik plan … --out FILE` wrote: .json, .npz or .csv"
"""Files that `optik drive` reads; `optik view` also reads an execution and a failed plan."""


def view(
    plan: Annotated[
        Path,
        typer.Argument(
            metavar="PLAN",
            help="A file written by `optik plan … --out` or `--out-failed`, or by `optik drive … --out`.",
        ),
    ],
    html: Annotated[
        Path | None, typer.Option(help="Write a self-contained page, FILE.html, instead of serving one.")
    ] = None,
    drive: Annotated[
        str | None, typer.Option(help="Also execute the motion on a simulated drive: ideal or mujoco.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to serve on; the default is reachable from this machine only.")
    ] = LOCAL,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to serve on; 0 for any free port.")] = 8080,
) -> None:
    """Show a motion, an execution or a failed plan in the browser.

    With --html, write a self-contained page. Without it, serve the page until Ctrl-C. This command never moves a real arm.
    """
    from planners.cell.view.page import PAGE_SUFFIXES, write_page

    if drive is not None:
        _check_simulated(drive)
    if html is not None and html.suffix.lower() not in PAGE_SUFFIXES:  # before a drive takes its time
        raise InvalidInput("--html", str(html), f"a name that ends in {' or '.join(PAGE_SUFFIXES)}")
    shown = read_recording(plan, drive)
    if html is None:
        _serve(shown, drive, host, port)
        return
    write_page(_show(shown, drive), html)
    out_console.print(f"written to {html}: open it in a browser", highlight=False, soft_wrap=True)


def _show(shown: Motion | Plan | Show, drive: str | None) -> Show:
    """Return what a page plays; execute a plan first."""
    from planners.cell.drives import make_drive
    from planners.cell.view.show import Show, show_execution, show_motion
    from planners.plan import Plan

    if drive is None or not isinstance(shown, Plan):
        return shown if isinstance(shown, Show) else show_motion(shown)
    execution = make_drive(drive, shown.robot).execute(shown)
    if not execution:
        err_console.print(f"{drive}: {execution.reason}", style="yellow", highlight=False, soft_wrap=True)
    return show_execution(execution)


def _serve(shown: Motion | Plan | Show, drive: str | None, host: str, port: int) -> None:
    """Serve until the process is interrupted; with a drive, execute the plan."""
    from planners.cell.drives import make_drive
    from planners.cell.view.live import Viewer
    from planners.cell.view.show import Show, show_motion
    from planners.plan import Plan

    make = None if drive is None else partial(make_drive, drive, shown.robot, pace=1.0)
    planned = shown if isinstance(shown, Plan) else None
    viewer = Viewer(shown if isinstance(shown, Show) else show_motion(shown), host, port, plan=planned, drive=make)
    if not _is_local(host):
        words = f"warning: everybody who can reach {host} can see this motion" + (
            " and run the simulated drive" if drive else ""
        )
        err_console.print(words, style="yellow", highlight=False, soft_wrap=True)
    out_console.print(f"{viewer.url} shows {shown.robot.name}; press Ctrl-C to stop", highlight=False, soft_wrap=True)
    sys.stdout.flush()  # a program that starts this one reads the address
    try:
        viewer.serve()
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()


def _check_simulated(name: str) -> None:
    """Raise InvalidInput unless a drive is simulated, before it is built."""
    if not getattr(load_method("planners.cell.drives", name, "drive"), "simulated", False):
        raise InvalidInput("--drive", f"{name}, which moves a real arm", "a simulated drive: ideal or mujoco")


def _is_local(host: str) -> bool:
    """Say whether an address is reachable from this machine only."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def read_recording(file: Path, drive: str | None = None) -> Motion | Plan | Show:
    """Read a motion (as a plan, for a drive), an execution or a failed plan; errors as in `read_motion`."""
    from planners.cell.stored import restore_plan
    from planners.cell.view.recorded import EXECUTION, FAILED_PLAN, show_recorded

    data = _json(file)
    if data.get("format") in (EXECUTION, FAILED_PLAN):
        if drive is not None:
            raise InvalidInput("--drive", f"{drive} for {file}, which is not a valid motion", STORED_MOTION)
        return show_recorded(data)
    motion = read_motion(file)
    return motion if drive is None else restore_plan(motion)


def read_motion(file: Path) -> Motion:
    """Read a motion."""
    from planners.cell.view.recorded import EXECUTION, FAILED_PLAN
    from planners.files import load_motion

    if file.is_dir():
        raise InvalidInput("PLAN", f"the folder {file}", STORED_MOTION)
    try:
        return load_motion(file)
    except InvalidInput as error:
        if error.argument == "file":  # its name, or that it cannot be read
            raise InvalidInput("PLAN", error.got, STORED_MOTION) from None
        data = _json(file)
        if data.get("format") == EXECUTION:
            raise InvalidInput(
                "PLAN", f"{file}, an execution", f"{STORED_MOTION}; `optik view` shows this file"
            ) from None
        if data.get("format") not in ("optik-plan/2", FAILED_PLAN):
            raise error
        if data.get("reason"):
            words = f"{file} is a failed plan: {data['reason']}"
            raise NoSolution(words, s=data.get("s"), joint=data.get("joint"), advice=data.get("advice", "")) from None
        raise InvalidInput("PLAN", f"{file}, the output of `optik plan … --json`", STORED_MOTION) from None


def _json(file: Path) -> dict[str, Any]:
    """Return the content of a JSON file; empty for any other file."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}
