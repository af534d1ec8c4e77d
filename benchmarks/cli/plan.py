"""`optik plan`: timed and certified motions along a line, an arc, a polyline, any path, or in joint space."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import optik
from benchmarks.cli.planning import plan_app, plan_command
from benchmarks.cli.shared import NUMBERS, read_configuration, read_numbers
from optik.errors import InvalidInput
from optik.registry import names

__all__ = ["plan_app"]

PLACE = "x,y,z[,roll,pitch,yaw] in the base frame [m, degrees]; without angles the tool keeps its orientation."
"""Syntax of a pose, for the help of several options."""


@plan_command("line")
def plan_line(
    arm: optik.Robot,
    q: Any,
    move: Annotated[
        str, typer.Option(metavar=NUMBERS, help="Goal minus start, in the base frame [m].")
    ] = "-0.12,0,0.2",
    turn_deg: Annotated[
        str,
        typer.Option(
            metavar=NUMBERS,
            help="Rotation of the tool along the line, as a rotation vector in the base frame [degrees].",
        ),
    ] = "0,0,0",
) -> Any:
    """Plan and certify a motion of the tool along a straight line.

    The exit status is 0 if there is a motion with a valid certificate. Otherwise it is 1, and nothing is written.
    """
    import planners
    from optik import se3

    start = arm.fk(q)
    turn = read_numbers(turn_deg, "--turn-deg", 3)
    if np.linalg.norm(turn) > 180.0:
        raise InvalidInput("--turn-deg", turn_deg, "a rotation vector of at most 180°: a line turns the shortest way")
    goal = se3.pose(se3.exp_so3(np.deg2rad(turn)) @ start[:3, :3], start[:3, 3] + read_numbers(move, "--move", 3))
    return planners.Line(start, goal)


@plan_command("arc")
def plan_arc(
    arm: optik.Robot,
    q: Any,
    via: Annotated[str, typer.Option(metavar=NUMBERS, help="Intermediate point x,y,z [m]; with --to.")] = "",
    to: Annotated[str, typer.Option(metavar=NUMBERS, help=f"End pose: {PLACE}")] = "",
    centre: Annotated[
        str, typer.Option(metavar=NUMBERS, help="Point on the axis, x,y,z [m]; with --axis and --angle-deg.")
    ] = "",
    axis: Annotated[str, typer.Option(metavar=NUMBERS, help="Direction of the axis, x,y,z.")] = "0,0,1",
    angle_deg: Annotated[float, typer.Option(help="Angle about the axis, right-handed [degrees].")] = 90.0,
) -> Any:
    """Plan and certify a motion of the tool along a circular arc: through a point to an end, or about an axis by an angle."""
    import planners

    start = arm.fk(q)
    if bool(centre) == bool(via and to) or bool(via) != bool(to):
        given = [name for name, text in (("--via", via), ("--to", to), ("--centre", centre)) if text]
        raise InvalidInput("arc", " and ".join(given) or "no option", "--via with --to, or --centre")
    if centre:
        angle = float(np.deg2rad(angle_deg))
        return planners.Arc.about(start, read_numbers(centre, "--centre", 3), read_numbers(axis, "--axis", 3), angle)
    return planners.Arc.through(start, read_numbers(via, "--via", 3), read_pose(to, "--to", start))


@plan_command("polyline")
def plan_polyline(
    arm: optik.Robot,
    q: Any,
    via: Annotated[
        list[str] | None,
        typer.Option(metavar=NUMBERS, help=f"Waypoint, repeatable; the last one is the end: {PLACE}"),
    ] = None,
    waypoints: Annotated[
        Path | None,
        typer.Option(
            help="CSV file of all waypoints with a header: x,y,z [m] or x_mm,y_mm,z_mm, and optionally the orientation as "
            "qx,qy,qz,qw; roll,pitch,yaw [rad]; roll_deg,pitch_deg,yaw_deg; or i,j,k."
        ),
    ] = None,
    blend: Annotated[float, typer.Option(help="Largest distance of a blended corner from its waypoint [m].")] = 1e-3,
) -> Any:
    """Plan and certify a motion of the tool along a polyline with blended corners.

    With --via, the path begins at the start configuration. With --waypoints, it begins at the first waypoint of the file, by
    default in the configuration that is best for the whole path.
    """
    import planners

    if bool(via) == (waypoints is not None):
        came = "both" if via else "no option"
        raise InvalidInput("polyline", came, "either --via (repeatable) or --waypoints FILE.csv")
    if waypoints is not None:
        return planners.Polyline.from_csv(waypoints, orientation=arm.fk(q)[:3, :3], blend=blend)
    poses = [arm.fk(q)]
    for text in via or ():
        poses.append(read_pose(text, "--via", poses[-1]))
    return planners.Polyline(np.stack(poses), blend=blend)


@plan_command("joints")
def plan_joints(
    arm: optik.Robot,
    q: Any,
    to_deg: Annotated[str, typer.Option(metavar=NUMBERS, help="Goal configuration [degrees, sliding mm].")],
) -> Any:
    """Plan and certify a motion to another configuration, straight in joint space."""
    import planners

    return planners.JointLine(arm, q, read_configuration(arm, to_deg, "--to-deg"))


@plan_command("path")
def plan_path(
    arm: optik.Robot,
    q: Any,
    path: Annotated[str, typer.Argument(help=f"One of: {', '.join(names('planners.paths'))}; or a file: ./spiral.py.")],
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="KEY=VALUE of the path, repeatable; values as in TOML."),
    ] = None,
) -> Any:
    """Plan and certify a motion of the tool along a path of any kind, also from a file or an installed package.

    --set gives the data of the path, with the keys of its to_dict. By default, start is the tool's pose at the start
    configuration.
    """
    import planners

    return planners.make_path(path, arm, **({"start": arm.fk(q).tolist()} | read_settings(set_ or [])))


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


def read_pose(text: str, option: str, before: Any) -> Any:
    """Return the pose of x,y,z[,roll,pitch,yaw]; without angles it has the orientation of the pose before it."""
    from optik import se3

    values = read_numbers(text, option, 3, 6)
    return se3.from_xyz_rpy(values[:3], values[3:]) if values[3:] else se3.pose(before[:3, :3], values)
