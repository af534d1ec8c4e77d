"""`optik robots`, `fk` and `ik`: one robot, one pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli import command
from benchmarks.cli.command import Q_DEG, FileCommand, err_console, numbers, option, optional, out_console, print_json
from benchmarks.cli.readers import format_numbers, load_or_error, read_joint_values, read_number_list
from optik.arm.group import read_group
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.model import unit_factors, unit_names
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import IKResult
from optik.ik.start import wind_near
from optik.registry import short_name
from optik.task import POSE

TASKS = ("pose", "position", "rotation", "axis_x", "axis_y", "axis_z")
"""Values of ``optik ik --task``."""


@dataclass(frozen=True, kw_only=True)
class RobotsCommand(FileCommand):
    """List the robots of optik and of installed packages, with the error of each that cannot be loaded; or show one."""

    name: str | None = optional(
        "[ROBOT]", "A robot to show: a name, or a file with its options, './arm.urdf#tip=tool0'."
    )

    def run(self) -> None:
        """Print the robots, or one of them."""
        if self.name is not None:
            arm = read_group(self.name) or self.load_file(self.name)
            if self.as_json:
                print_json(arm.to_dict())
            else:
                out_console.print(command.name_options(str(arm)), soft_wrap=True)
            return
        found = {name: load_or_error(optik.load, name) for name in optik.robots()}
        if self.as_json:
            print_json([_robot_row(name, robot) for name, robot in found.items()])
            return
        table = Table("robot", "joints", "joint ranges", "source")
        for name, robot in found.items():
            if isinstance(robot, Robot):
                table.add_row(name, str(robot.n), _describe_ranges(robot), robot.source)
            else:
                table.add_row(name, "", "", f"error: {robot}")
        out_console.print(table)


def _robot_row(name: str, robot: Robot | Exception) -> dict[str, Any]:
    """Return a robot, or its error, as plain data for ``optik robots --json``."""
    if not isinstance(robot, Robot):
        return {"name": name, "error": str(robot)}
    return {"name": name, "joints": robot.n, "source": robot.source, "fingerprint": robot.fingerprint}


def _describe_ranges(robot: Robot) -> str:
    """Return the joint ranges in degrees and millimetres."""
    lower, upper = robot.limits.lower * unit_factors(robot), robot.limits.upper * unit_factors(robot)
    return ", ".join(f"{lo:.0f}…{hi:.0f}{unit}" for lo, hi, unit in zip(lower, upper, unit_names(robot), strict=True))


@dataclass(frozen=True, kw_only=True)
class FkCommand(command.RobotCommand):
    """Compute forward kinematics: the tool pose for joint values."""

    q_deg: str = command.argument(Q_DEG, "Joint values [degrees, prismatic mm]: 20,-35,40 or 20 -35 40.")

    def run(self) -> None:
        """Print the pose."""
        from optik import se3
        from optik.arm.urdf_writer import roll_pitch_yaw

        arm = self.load()
        q = read_joint_values(arm, self.q_deg, Q_DEG) / unit_factors(arm)
        T, smallest, inside = arm.fk(q), float(arm.singular_values(q)[-1]), bool(arm.limits.contains(q))
        rpy_deg, quat = np.degrees(roll_pitch_yaw(T[:3, :3])), se3.quaternion(T[:3, :3])
        if self.as_json:
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
        for name, part, unit in (("xyz", T[:3, 3], "m"), ("rpy-deg", rpy_deg, "degrees"), ("quat", quat, "w,x,y,z")):
            out_console.print(f"--{name} {','.join(f'{x + 0.0:.6f}' for x in part)}  [{unit}]", soft_wrap=True)
        beyond = np.maximum(arm.limits.lower - q, q - arm.limits.upper)
        names = ", ".join(np.array(arm.joint_names)[beyond > LIMIT_TOLERANCE])
        note = "inside the joint limits" if inside else f"OUTSIDE the joint limits: {names}"
        out_console.print(f"smallest singular value of the Jacobian {smallest:.4g}; {note}")


@dataclass(frozen=True, kw_only=True)
class IkCommand(command.StartCommand):
    """Solve inverse kinematics: joint values for a tool pose.

    Without --rpy-deg or --quat, the target has the orientation of the tool at the start configuration. For an arm with
    fewer than six joints it is then a position.
    """

    xyz: str = numbers("Target", "Target position in the base frame [m]: 0.1,0.3,0.2 or 0.1 0.3 0.2.", ...)
    rpy_deg: str = numbers("Target", "Target roll, pitch, yaw [degrees].", "")
    quat: str = numbers("Target", "Target orientation as a quaternion w,x,y,z, in place of --rpy-deg.", "")
    task: str | None = option(
        "Target",
        f"Constrained part of the pose, one of: {', '.join(TASKS)}; by default pose, or position for an arm with fewer than "
        "six joints if no orientation is given.",
    )
    closest: bool = option("Method", "If there is no solution, return the nearest pose.", False)
    max_restarts: int = option("Method", "Largest number of restarts.", 200, "--restarts")

    def run(self) -> None:
        """Solve and print; exit with status 1 without a solution."""
        from optik import se3
        from optik.arm.urdf_writer import roll_pitch_yaw

        position, rpy_deg, quat = read_number_list(self.xyz, "--xyz", 3), self.rpy_deg.strip(), self.quat.strip()
        if rpy_deg and quat:
            raise InvalidInput("--quat", f"{quat} together with --rpy-deg {rpy_deg}", "either --quat or --rpy-deg")
        if self.task not in (None, *TASKS):
            raise InvalidInput("--task", self.task, f"one of: {', '.join(TASKS)}")
        start = self.load_start()
        oriented = start.arm.n >= POSE.size or rpy_deg or quat
        task = self.task or ("pose" if oriented else "position")
        R = start.arm.fk(start.q)[:3, :3]
        if rpy_deg:
            R = se3.from_xyz_rpy((0, 0, 0), read_number_list(rpy_deg, "--rpy-deg", 3))[:3, :3]
        if quat:
            R = se3.from_quaternion(read_number_list(quat, "--quat", 4), "--quat")
        result = optik.solve_ik(
            start.arm, se3.pose(R, position), start.q, self.solver, max_restarts=self.max_restarts, task=task,
            closest=self.closest,
        )  # fmt: skip
        result = result._replace(q=wind_near(start.arm, result.q, start.q))
        start.print_default()
        if self.task is None and not oriented:
            words = f"{start.arm.name} has {start.arm.n} joints and no orientation is given: --task position"
            err_console.print(words, soft_wrap=True)
        (_print_ik_json if self.as_json else _print_ik)(start.arm, result, short_name(self.solver))
        if not (self.as_json or rpy_deg or quat or task == "position"):
            taken = format_numbers(np.degrees(roll_pitch_yaw(R)))
            out_console.print(f"orientation: that of the start, --rpy-deg {taken}", soft_wrap=True)
        if not result:
            if not self.as_json:
                said = f"{result.message}; " if result.message else ""
                advice = result.status.advice.replace("max_restarts", "--restarts")
                err_console.print(f"not solved: {said}try {advice}", style="yellow", soft_wrap=True)
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
        f"position error {1e3 * result.position_error:.4g} mm, rotation error {np.degrees(result.rotation_error):.3g}°"
    )
