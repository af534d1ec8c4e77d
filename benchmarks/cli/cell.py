"""`optik cell`: the paper's task from end to end: laser, main control, drive, and the executed tool position."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

import optik
from benchmarks.cli.planning import PlanOptions, read_limits
from benchmarks.cli.shared import (
    NUMBERS,
    AsJson,
    RobotName,
    StartDeg,
    err_console,
    load_arm,
    out_console,
    print_json,
    print_start,
    read_numbers,
    read_start,
)
from optik.check import check_count
from optik.errors import InvalidInput, NoSolution
from optik.registry import names

if TYPE_CHECKING:
    from planners.cell import Outcome, PanTiltLaser

WAY = (-0.12, 0.0, 0.20)
"""Default displacement from the tool to the spot in the base frame [m]: the default line of the paper's arm."""
ASIDE, RAISED = 0.3, 0.3
"""Position of the laser unit [m]: to the left of the arm's base as seen towards the spot, and above base and spot, so that the
beam does not graze the graph paper."""
TYPED_NOISE = "0.2,0.5"
"""Default noise of the readings [mrad, mm]: a unit with 13-bit encoders and a range finder of its class."""
POSE_STREAM = 1
"""Second seed of the miscalibration, which keeps its random numbers independent of the noise of the readings."""


Spot = Annotated[
    str,
    typer.Option(
        metavar=NUMBERS,
        help="True position of the spot: x,y,z in the base frame [m]; by default the end of the paper's line.",
    ),
]
Drive = Annotated[str, typer.Option(help="ideal or mujoco; by default mujoco if it is installed, else ideal.")]
Noise = Annotated[
    str, typer.Option(metavar=NUMBERS, help="Standard deviations of pan and tilt [mrad] and of the range [mm].")
]
Miscalibration = Annotated[
    str,
    typer.Option(
        metavar=NUMBERS,
        help="Distance of the laser's true pose from the calibrated one [mm, mrad]; its direction is random (--seed).",
    ),
]
Timing = Annotated[
    str, typer.Option(help=f"Time law, one of: {', '.join(names('planners.timing'))}; or a file: ./law.py.")
]
Solver = Annotated[str, typer.Option(help=f"IK method, one of: {', '.join(optik.ik.solvers())}; or a file: ./jt.py.")]
Out = Annotated[Path, typer.Option(help="Page to write, FILE.html; the data goes to FILE.json.")]


def cell(
    robot: RobotName = "paper6r",
    spot: Spot = "",
    start_deg: StartDeg = "",
    drive: Drive = "",
    corrections: Annotated[int, typer.Option(help="Number of correction passes, each with new readings.")] = 0,
    readings: Annotated[int, typer.Option(help="Readings of the spot, and of the tool for each correction.")] = 1,
    noise: Noise = TYPED_NOISE,
    miscalibration: Miscalibration = "0,0",
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    velocity: Annotated[
        float | None, typer.Option(help="Velocity limit of every joint [rad/s, sliding m/s]; by default the robot's.")
    ] = None,
    acceleration: Annotated[
        float | None, typer.Option(help="Acceleration limit of every joint [rad/s², sliding m/s²].")
    ] = None,
    jerk: Annotated[float | None, typer.Option(help="Jerk limit of every joint [rad/s³, sliding m/s³].")] = None,
    timing: Timing = "optimal",
    solver: Solver = "lm",
    out: Out = Path("optik-cell.html"),
    as_json: AsJson = False,
) -> None:
    """Move the tool of a simulated arm to a laser spot.

    A simulated pan-tilt laser measures the spot on the graph paper, which lies on a level table. optik plans and certifies
    a straight line to it, a simulated drive executes the line, and the error of the tool is split into laser, inverse
    kinematics, path and servo. The exit status is 0 if the tool arrived, and 1 if a step failed.
    """
    from planners.cell import Cell, Plane
    from planners.timing import make_law

    _check_counts(seed, corrections, readings)
    if out.suffix.lower() != ".html":
        raise InvalidInput("--out", str(out), "a name that ends in .html")
    law, arm = make_law(timing), load_arm(robot)
    (q, words), (chosen, why) = read_start(arm, robot, start_deg), choose_drive(drive)
    point = arm.fk(q)[:3, 3] + WAY if not spot.strip() else np.array(read_numbers(spot, "--spot", 3))
    if not np.isfinite(point).all():
        raise InvalidInput("--spot", spot, "three finite numbers [m]")
    laser = add_pose_covariance(make_laser(arm, point, noise), miscalibration)
    limits = read_limits(arm, PlanOptions(velocity=velocity, acceleration=acceleration, jerk=jerk, timing=timing), law)
    there = Cell(arm, laser, chosen, limits, unit=displace_laser(laser, miscalibration, seed), seed=seed, q=q)
    outcome = there.move_to_spot(
        there.read(point, readings), plane=Plane(point, laser.pose[:3, 2]), corrections=corrections, readings=readings,
        timing=law, solver=solver,
    )  # fmt: skip
    print_start(words)
    report(outcome, chosen, why, out, as_json)


def _check_counts(seed: int, corrections: int, readings: int) -> None:
    """Raise InvalidInput for a count out of range."""
    from planners.cell._parts import MOST_READINGS
    from planners.cell.cell import MOST_ROUNDS

    check_count(seed, "--seed", 0)
    check_count(corrections, "--corrections", 0, MOST_ROUNDS)
    check_count(readings, "--readings", 1, MOST_READINGS)


def report(outcome: Outcome, drive: str, why: str, out: Path, as_json: bool) -> None:
    """Write page and data and print the outcome; exit with status 1 if the tool did not arrive."""
    from optik.file_io import write_atomically

    page = write_task_page(outcome, out)
    data = outcome.to_dict() | {"drive": drive, "page": None if page is None else str(page)}
    file = out.with_suffix(".json")
    write_atomically(file, lambda part: part.write_text(json.dumps(data, allow_nan=False, indent=1), encoding="utf-8"))
    if as_json:
        print_json(data)
    else:
        print_outcome(outcome, why)
        written = f"data: {file}" if page is None else f"page: {page} (open it in a browser), data: {file}"
        out_console.print(written, highlight=False, soft_wrap=True)
    if outcome.failed is not None:
        said = (
            f"not arrived: {outcome.status} at step {outcome.failed.name}: {outcome.reason}; to try: {outcome.advice}"
        )
        err_console.print(said, style="yellow", markup=False, highlight=False, soft_wrap=True)
    if not outcome:
        raise typer.Exit(1)


# ---------------------------------------------------------------- the cell


def make_laser(arm: optik.Robot, point: Any, noise: str) -> PanTiltLaser:
    """Return the laser unit: beside the arm's base, level, facing the spot."""
    from optik import se3
    from planners.cell import PanTiltLaser

    angle, distance = read_numbers(noise, "--noise", 2)
    if not (0.0 <= angle < np.inf and 0.0 <= distance < np.inf):
        raise InvalidInput("--noise", noise, "two numbers of 0 or more: pan and tilt [mrad], range [mm]")
    up = -np.asarray(arm.gravity) / np.linalg.norm(arm.gravity)
    ahead = point - up * (up @ point)
    if np.linalg.norm(ahead) < 1e-6:  # the spot is above the base: any level direction faces it
        ahead = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    ahead = ahead / np.linalg.norm(ahead)
    left = np.cross(up, ahead)
    pose = se3.pose(np.stack([ahead, left, up], axis=1), ASIDE * left + (max(float(up @ point), 0.0) + RAISED) * up)
    return PanTiltLaser(pose, angle_noise=1e-3 * angle, range_noise=1e-3 * distance)


def add_pose_covariance(laser: PanTiltLaser, typed: str) -> PanTiltLaser:
    """Return the calibrated unit, with a covariance of its pose that matches the miscalibration in every direction."""
    away = np.repeat(1e-3 * np.array(_away(typed)), 3)
    return laser.with_pose(laser.pose, np.diag(away**2 / 3.0)) if away.any() else laser


def _away(typed: str) -> tuple[float, float]:
    """Return the distance of the true unit from the calibrated one [mm, mrad]."""
    far, turned = read_numbers(typed, "--miscalibration", 2)
    if not (0.0 <= far < np.inf and 0.0 <= turned < np.inf):
        raise InvalidInput("--miscalibration", typed, "two numbers of 0 or more: distance [mm], angle [mrad]")
    return far, turned


def displace_laser(laser: PanTiltLaser, typed: str, seed: int) -> PanTiltLaser:
    """Return the true unit, displaced from its calibrated pose in a random direction."""
    from optik import se3

    far, turned = _away(typed)
    v, w = (x / np.linalg.norm(x) for x in np.random.default_rng([seed, POSE_STREAM]).normal(size=(2, 3)))
    pose = np.array(laser.pose)
    pose[:3, 3] += 1e-3 * far * v
    pose[:3, :3] = se3.exp_so3(1e-3 * turned * w) @ pose[:3, :3]
    return laser.with_pose(pose)


def choose_drive(typed: str) -> tuple[str, str]:
    """Return the drive's name, and a phrase that describes it."""
    simulated = {
        "ideal": "on the ideal drive, which follows its set-points exactly",
        "mujoco": "on the simulated arm in MuJoCo",
    }
    if typed:
        if typed not in simulated:
            raise InvalidInput("--drive", repr(typed), "ideal or mujoco: this command moves simulated arms only")
        return typed, simulated[typed]
    if find_spec("mujoco") is not None:
        return "mujoco", simulated["mujoco"]
    return "ideal", simulated["ideal"] + "; for MuJoCo: pip install 'optik-toolkit[sim]'"


# ---------------------------------------------------------------- what it says


def write_task_page(outcome: Outcome, file: Path) -> Path | None:
    """Write the page that plays the task."""
    from planners.cell.view.page import write_page
    from planners.cell.view.show import show_outcome

    try:
        show = show_outcome(outcome)
    except NoSolution:
        return None
    write_page(show, file)
    return file


def _took(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.1f} ms"


def print_outcome(outcome: Outcome, why: str) -> None:
    """Print the steps, the errors and the rounds of a task."""
    table = Table("step", "", "time", "result", title=f"{outcome.robot.name} to a laser spot, {why}")
    for step in outcome.steps:
        mark = "ok" if step.ok else "[red]failed[/red]"
        table.add_row(step.name, mark, _took(step.seconds), escape(step.reason))
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
        out_console.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)
