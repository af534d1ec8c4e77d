"""`optik cell`: the paper's task from end to end: laser, main control, drive, and the executed tool position."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

import optik
from benchmarks.cli.command import MotionCommand, err_console, numbers, option, out_console, print_json, translate
from benchmarks.cli.motion import DRIVE_HELP, check_simulated
from benchmarks.cli.readers import read_number_list
from optik.check import check_count
from optik.errors import InvalidInput, NoSolution
from optik.file_io import check_suffix, write_atomically
from optik.registry import short_name

if TYPE_CHECKING:
    from planners.cell import Outcome, PanTiltLaser

WAY = (-0.12, 0.0, 0.20)
"""Default displacement from the tool to the spot in the base frame [m]: the default line of the paper's arm."""
ASIDE, RAISED = 0.3, 0.3
"""Position of the laser unit [m]: to the left of the arm's base as seen towards the spot, and above base and spot, so that the
beam does not graze the graph paper."""
POSE_STREAM = 1
"""Second seed of the miscalibration, which keeps its random numbers independent of the noise of the readings."""


@dataclass(frozen=True, kw_only=True)
class CellCommand(MotionCommand):
    """Move the tool of a simulated arm to a laser spot.

    A simulated pan-tilt laser measures the spot on the graph paper, which lies on a level table. optik plans and certifies
    a straight line to it, a simulated drive executes the line, and the error of the tool is split into laser, inverse
    kinematics, path and servo. The exit status is 0 if the tool arrived, and 1 if a step failed.
    """

    spot: str = numbers(
        "Task", "True position of the spot: x,y,z in the base frame [m]; by default the end of the paper's line.", ""
    )
    drive: str = option(
        "Task", f"{DRIVE_HELP}, that is simulated; by default mujoco if it is installed, else ideal.", ""
    )
    corrections: int = option("Task", "Number of correction passes, each with new readings.", 0)
    readings: int = option("Task", "Readings of the spot, and of the tool for each correction.", 1)
    # The default is a unit with 13-bit encoders and a range finder of its class.
    noise: str = numbers("Task", "Standard deviations of pan and tilt [mrad] and of the range [mm].", "0.2,0.5")
    miscalibration: str = numbers(
        "Task",
        "Distance of the laser's true pose from the calibrated one [mm, mrad]; its direction is random (--seed).",
        "0,0",
    )
    seed: int = option("Task", "Seed of all random numbers.", 0)
    out: Path = option("Output", "Page to write, FILE.html; the data goes to FILE.json.", Path("optik-cell.html"))

    def run(self) -> None:
        """Run the task, write its page and data, and print the outcome; exit with status 1 if the tool did not arrive."""
        from planners.cell import Cell, Plane
        from planners.timing import make_law

        check_count(self.seed, "--seed", 0)
        check_suffix(self.out, (".html",), "--out")
        law, start, (drive, why) = make_law(self.timing), self.load_start(), choose_drive(self.drive)
        arm = start.arm
        point = np.array(read_number_list(self.spot, "--spot", 3)) if self.spot else arm.fk(start.q)[:3, 3] + WAY
        if not np.isfinite(point).all():
            raise InvalidInput("--spot", self.spot, "three finite numbers [m]")
        away = _read_least_zero(self.miscalibration, "--miscalibration", "distance [mm], angle [mrad]")
        laser = _add_pose_covariance(make_laser(arm, point, self.noise), away)
        unit = displace_laser(laser, away, self.seed)
        there = Cell(arm, laser, drive, self.read_limits(arm, law), unit=unit, seed=self.seed, q=start.q)
        outcome = there.move_to_spot(
            there.read(point, self.readings), plane=Plane(point, laser.pose[:3, 2]), corrections=self.corrections,
            readings=self.readings, timing=law, solver=self.solver,
        )  # fmt: skip
        start.print_default()
        self._report(outcome, drive, why)

    def _report(self, outcome: Outcome, drive: str, why: str) -> None:
        """Write page and data and print the outcome."""
        page, file = _write_page(outcome, self.out), self.out.with_suffix(".json")
        data = outcome.to_dict() | {"drive": drive, "page": None if page is None else str(page)}
        text = json.dumps(data, allow_nan=False, indent=1)
        write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))
        if self.as_json:
            print_json(data)
        else:
            _print_outcome(outcome, why)
            written = f"data: {file}" if page is None else f"page: {page} (open it in a browser), data: {file}"
            out_console.print(written, soft_wrap=True)
        if outcome.failed is not None:
            words = f"{outcome.status} at step {outcome.failed.name}: {outcome.reason}; to try: {outcome.advice}"
            err_console.print(f"not arrived: {translate(words)}", style="yellow", soft_wrap=True)
        if not outcome:
            raise typer.Exit(1)


# ---------------------------------------------------------------- the cell


def make_laser(arm: optik.Robot, point: Any, noise: str) -> PanTiltLaser:
    """Return the laser unit: beside the arm's base, level, facing the spot."""
    from optik import se3
    from planners.cell import PanTiltLaser

    angle, distance = _read_least_zero(noise, "--noise", "pan and tilt [mrad], range [mm]")
    up = -np.asarray(arm.gravity) / np.linalg.norm(arm.gravity)
    ahead = point - up * (up @ point)
    if np.linalg.norm(ahead) < 1e-6:  # the spot is above the base: any level direction faces it
        ahead = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    ahead = ahead / np.linalg.norm(ahead)
    left = np.cross(up, ahead)
    pose = se3.pose(np.stack([ahead, left, up], axis=1), ASIDE * left + (max(float(up @ point), 0.0) + RAISED) * up)
    return PanTiltLaser(pose, angle_noise=1e-3 * angle, range_noise=1e-3 * distance)


def _read_least_zero(text: str, name: str, what: str) -> list[float]:
    """Read two numbers of 0 or more."""
    values = read_number_list(text, name, 2)
    if not all(0.0 <= value < np.inf for value in values):
        raise InvalidInput(name, text, f"two numbers of 0 or more: {what}")
    return values


def _add_pose_covariance(laser: PanTiltLaser, away: list[float]) -> PanTiltLaser:
    """Return the calibrated unit, with the covariance of a displacement [mm, mrad] of its pose in a random direction."""
    spread = np.repeat(1e-3 * np.array(away), 3)
    return laser.with_pose(laser.pose, np.diag(spread**2 / 3.0)) if spread.any() else laser


def displace_laser(laser: PanTiltLaser, away: list[float], seed: int) -> PanTiltLaser:
    """Return the true unit, displaced [mm, mrad] from its calibrated pose in a random direction."""
    from optik import se3

    far, turned = away
    v, w = (x / np.linalg.norm(x) for x in np.random.default_rng([seed, POSE_STREAM]).normal(size=(2, 3)))
    pose = np.array(laser.pose)
    pose[:3, 3] += 1e-3 * far * v
    pose[:3, :3] = se3.exp_so3(1e-3 * turned * w) @ pose[:3, :3]
    return laser.with_pose(pose)


def choose_drive(typed: str) -> tuple[str, str]:
    """Return the drive's name, and a phrase that describes it."""
    drive = typed or ("mujoco" if find_spec("mujoco") else "ideal")
    advice = "" if typed or drive == "mujoco" else "; for MuJoCo: pip install 'optik-toolkit[sim]'"
    return check_simulated(drive), f"on the simulated drive {short_name(drive)}{advice}"


# ---------------------------------------------------------------- what it says


def _write_page(outcome: Outcome, file: Path) -> Path | None:
    """Write the page that plays the task."""
    from optik.view.page import write_page
    from planners.cell.show import show_outcome

    try:
        show = show_outcome(outcome)
    except NoSolution:
        return None
    write_page(show, file)
    return file


def _format_seconds(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.1f} ms"


def _print_outcome(outcome: Outcome, why: str) -> None:
    """Print the steps, the errors and the rounds of a task."""
    table = Table("step", "", "time", "result", title=f"{outcome.robot.name} to a laser spot, {why}")
    for step in outcome.steps:
        mark = Text("ok") if step.ok else Text("failed", style="red")
        table.add_row(step.name, mark, _format_seconds(step.seconds), translate(step.reason))
    out_console.print(table)
    if outcome.error is not None:
        errors = Table("final error", "x, mm", "y, mm", "z, mm", "length, mm")
        for name, part in outcome.error._asdict().items():
            values = (*part, float(np.linalg.norm(part)))
            errors.add_row(name, *(f"{round(1e3 * x, 4) + 0.0:+.4f}" for x in values[:3]), f"{1e3 * values[3]:.4f}")
        out_console.print(errors)
    if len(outcome.rounds) > 1:
        off = ", ".join(f"{1e3 * np.linalg.norm(each.error):.4f}" for each in outcome.rounds)
        floor = 1e3 * (outcome.floor or 0.0)
        out_console.print(f"error after each round: {off} mm; noise floor of the readings: {floor:.3g} mm (RMS)")
        if 1e3 * np.linalg.norm(outcome.rounds[0].error) < floor:
            out_console.print(
                "the first error is below the noise floor, so corrections cannot reduce it; more --readings lower the floor"
            )
    for note in outcome.notes:
        out_console.print(f"note: {note}", soft_wrap=True)
