"""Cycles of ISO 9283: the five poses, each approached from the one before, and one line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import Part
from benchmarks.blocks.cell.facts import EXECUTION_TYPES, facts_of, failure, why_not
from benchmarks.blocks.cell.isorows import PATH_TEST, POSE_TEST
from benchmarks.blocks.cell.measures import AXES
from benchmarks.blocks.cell.settings import NOISELESS, NOISY, IsoBlock
from benchmarks.blocks.cell.trials import Trial, drive_of, start_configuration, trial_of
from benchmarks.records import slug
from optik import se3
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.iso9283 import Cube, crossings, cube_poses
from planners.paths.line import Line
from planners.plan import Plan, plan

CROSSED_PLANES = 41
"""Points of the line at which its accuracy is computed."""

ORDER = (0, 4, 3, 2, 1, 0)
"""A cycle of the standard: from P1 to P5, P4, P3, P2 and back to P1, so that each pose is reached from the same side."""

ISO_TYPES: dict[str, Any] = {
    "method": pl.String, "noise": pl.Boolean, "test": pl.String, "cycle": pl.Int64, "point": pl.Int64,
    **{a: pl.Float64 for a in AXES}, **{f"reached_{a}": pl.Float64 for a in AXES},
    **{f"turn_{a}": pl.Float64 for a in AXES}, **EXECUTION_TYPES,
}  # fmt: skip
"""Columns of the rows: the commanded point and, in the base frame, the reached one and the rotation between them."""


@dataclass(frozen=True)
class IsoWork:
    """One part: one cycle.

    Attributes
    ----------
    block : IsoBlock
        The block.
    drive : str
        Name of the drive.
    seed : int
        Of the suite.
    test : {"pose", "path"}
        What is cycled.
    cycle : int
        Number of the cycle.
    noise : bool
        Whether anything varies.
    """

    block: IsoBlock
    drive: str
    seed: int
    test: str
    cycle: int
    noise: bool

    def halves(self) -> tuple[IsoWork, ...]:
        """Nothing: a cycle is not divided."""
        return ()

    def crashed(self) -> pl.DataFrame:
        """The row of a cycle in which the process ended or an error was raised."""
        return frame([self.row() | failure(self.drive, "crashed", "the process ended, or an error was raised")])

    def row(self) -> dict[str, Any]:
        """Columns that say which cycle a row is of; all others are None."""
        label = NOISY if self.noise else NOISELESS
        return dict.fromkeys(ISO_TYPES) | {
            "method": label, "noise": self.noise, "test": self.test, "cycle": self.cycle
        }  # fmt: skip


def frame(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Rows as a table."""
    return pl.DataFrame(rows, schema=ISO_TYPES)


def prepare_iso(block: IsoBlock) -> Cube:
    """Choose the five poses, and check that the line can be planned."""
    robot = trial_of(block, 0, 0, POSE_TEST, 0, noise=False).robot
    q = start_configuration(robot, block.start_deg, f"cell {block.id!r}")
    planned = _line(block)
    if not planned:
        came = f"{list(block.move_m)}: {why_not(planned)}"
        raise InvalidInput(f"cell {block.id!r}: move_m", came, "a line that the arm can follow")
    return cube_poses(robot, q)


def _line(block: IsoBlock) -> Plan:
    robot = trial_of(block, 0, 0, PATH_TEST, 0, noise=False).robot
    q = start_configuration(robot, block.start_deg, f"cell {block.id!r}")
    start = robot.fk(q)
    return plan(robot, Line(start, se3.pose(start[:3, :3], start[:3, 3] + block.move_m)), q, timing=block.law)


def iso_parts(block: IsoBlock, prepared: tuple[str, int], top: str) -> Iterator[Part]:
    """Divide the work: a cycle a part."""
    drive, seed = prepared
    for test, cycles in ((POSE_TEST, block.cycles), (PATH_TEST, block.path_cycles)):
        for noise in (True, False):
            for cycle in range(cycles if noise else 1):
                file = f"{top}/{slug(block.id)}--{test}-{'noise' if noise else 'still'}-{cycle:04d}.parquet"
                yield Part(file, block.title, IsoWork(block, drive, seed, test, cycle, noise))


def solve_iso(work: IsoWork) -> pl.DataFrame:
    """Execute one cycle."""
    trial = trial_of(work.block, work.seed, work.cycle, work.test, 0, noise=work.noise)
    rows = _poses(work, trial) if work.test == POSE_TEST else _path(work, trial)
    return frame([work.row() | row for row in rows])


def _poses(work: IsoWork, trial: Trial) -> list[dict[str, Any]]:
    """Rows of one cycle through the poses; it ends at the first motion that fails."""
    cube = prepare_iso(work.block)
    rows: list[dict[str, Any]] = []
    drive = drive_of(work.block, work.drive, trial, cube.q[ORDER[0]], noise=work.noise)
    for before, point in pairwise(ORDER):
        row = {"point": point + 1} | dict(zip(AXES, cube.poses[point, :3, 3].tolist(), strict=True))
        planned = plan(trial.robot, cube.q[point], cube.q[before], timing=work.block.law)
        if not planned:
            return [*rows, row | failure(work.drive, str(planned.status), why_not(planned))]
        execution = drive.execute(planned)
        row |= facts_of(execution)
        if execution:
            T = trial.robot.fk(execution.q[-1])
            row |= _reached(T[:3, 3]) | _turn(se3.error(cube.poses[point], T)[3:])
        rows.append(row)
        if not execution:
            break
    return rows


def _path(work: IsoWork, trial: Trial) -> list[dict[str, Any]]:
    """Rows of one cycle along the line."""
    planned = _line(work.block)
    q = planned.trajectory(0.0)
    execution = drive_of(work.block, work.drive, trial, q, noise=work.noise).execute(planned)
    facts = facts_of(execution)
    command = planned.path.pose(np.linspace(0.0, planned.path.end, CROSSED_PLANES))[:, :3, 3]
    if not execution:
        return [facts]
    along = np.tile(command[-1] - command[0], (CROSSED_PLANES, 1))
    met = crossings(command, along, trial.robot.fk(execution.q)[:, :3, 3])
    points = enumerate(zip(command.tolist(), met, strict=True))
    return [facts | {"point": i} | dict(zip(AXES, at, strict=True)) | _reached(there) for i, (at, there) in points]


def _reached(point: Array) -> dict[str, Any]:
    return {f"reached_{a}": float(x) for a, x in zip(AXES, point, strict=True)}


def _turn(turn: Array) -> dict[str, Any]:
    return {f"turn_{a}": float(x) for a, x in zip(AXES, turn, strict=True)}
