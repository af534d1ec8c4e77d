"""`optik view`: a motion in one page that plays it, or in the browser while this command runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

import planners
from benchmarks.cli.shared import out_console
from optik.errors import InvalidInput, NoSolution

STORED_MOTION = "a motion that `optik plan … --out FILE` wrote: .json, .npz or .csv"
"""What the command takes."""


def view(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="What `optik plan … --out PLAN` wrote.")],
    html: Annotated[
        Path | None, typer.Option(help="Write one page that plays it, whole in itself, and end: FILE.html.")
    ] = None,
) -> None:
    """Show a motion: the arm with its shapes, the scene, the path and the numbers at every time.

    Parameters
    ----------
    plan, html
        As ``--help`` says.

    Raises
    ------
    InvalidInput
        A file that holds no motion, a suffix of no page, a port that is in use.
    NoSolution
        The data of a plan that failed.
    OutputError
        The page cannot be written.
    MissingDependency
        Without ``--html``, where viser is not installed.
    """
    from planners.cell.view.page import write_page
    from planners.cell.view.show import show_of

    motion = stored(plan)
    if html is not None:
        write_page(show_of(motion), html)
        out_console.print(f"written to {html}: open it in a browser", highlight=False, soft_wrap=True)


def stored(file: Path) -> planners.Motion:
    """Read a motion.

    Parameters
    ----------
    file : Path
        What was typed.

    Returns
    -------
    Motion
        The motion.

    Raises
    ------
    InvalidInput
        No such file, a folder, or something else in it; the message says what was expected.
    NoSolution
        The data of a plan that failed, as ``--json`` prints them.
    """
    if file.is_dir():
        raise InvalidInput("PLAN", f"the folder {file}", STORED_MOTION)
    try:
        return planners.load_motion(file)
    except InvalidInput as error:
        data = _printed(file)
        if data.get("reason"):
            words = f"{file} is of a plan that failed: {data['reason']}"
            raise NoSolution(words, s=data.get("s"), joint=data.get("joint"), advice=data.get("advice", "")) from None
        if data:
            raise InvalidInput("PLAN", f"{file}, what `optik plan … --json` prints", STORED_MOTION) from None
        raise error


def _printed(file: Path) -> dict[str, Any]:
    """What ``optik plan … --json`` printed into a file; empty for any other."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) and data.get("format") == "optik-plan/1" else {}
