"""Cycles of ISO 9283: five poses, each approached from the previous one, and one line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.cell.settings import AXES, NOISELESS, NOISY, PATH_TEST, POSE_TEST, IsoBlock
from benchmarks.blocks.cell.trials import (
    EXECUTION_TYPES,
    CellWork,
    Trial,
    drive_of,
    line_of,
    start_of,
    trial_of,
    why_not,
)
from benchmarks.records import RunFolder
from optik import se3
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.iso9283 import crossings, cube_poses
from planners.plan import Plan, plan

CROSSED_PLANES = 41
"""Points of the line at which its accuracy is computed."""

ORDER = (0, 4, 3, 2, 1, 0)
"""A cycle of the standard: from P1 to P5, P4, P3, P2 and back to P1, so that each pose is reached from the same side."""

ISO_TYPES: dict[str, Any] = {
    "method": pl.String, "noise": pl.Boolean, "test": pl.String, "cycle": pl.Int64, "problem": pl.Int64,
    **{a: pl.Float64 for a in AXES}, **{f"reached_{a}": pl.Float64 for a in AXES},
    **{f"turn_{a}": pl.Float64 for a in AXES}, **EXECUTION_TYPES,
}  # fmt: skip
"""Columns of the rows: the commanded point and, in the base frame, the reached one and the rotation between them."""


@dataclass(frozen=True)
class IsoWork(CellWork):
    """One cycle, of the test ``pose`` or ``path``, with noise or without."""

    types = ISO_TYPES

    test: str
    cycle: int
    noise: bool

    def row(self) -> dict[str, Any]:
        """Return the columns that identify the cycle; all others are None."""
        label = NOISY if self.noise else NOISELESS
        return dict.fromkeys(ISO_TYPES) | {
            "method": label, "noise": self.noise, "test": self.test, "cycle": self.cycle
        }  # fmt: skip

    def lost(self) -> list[dict[str, Any]]:
        """Return the row of the cycle."""
        return [self.row()]

    def solve(self) -> pl.DataFrame:
        """Execute the cycle."""
        trial = trial_of(self.block, self.seed, self.cycle, self.test, 0, noise=self.noise)
        rows = _poses(self, trial) if self.test == POSE_TEST else _path(self, trial)
        return self.frame([self.row() | row for row in rows])


def prepare(block: IsoBlock, seed: int) -> None:
    """Check the five poses, and that the line can be planned."""
    planned = _line(block)
    if not planned:
        came = f"{list(block.move_m)}: {why_not(planned)}"
        raise InvalidInput(f"cell {block.id!r}: move_m", came, "a line that the arm can follow")
    cube_poses(*start_of(block))


def _line(block: IsoBlock) -> Plan:
    robot, q, path = line_of(block, block.move_m)
    return plan(robot, path, q, timing=block.law)


def parts(block: IsoBlock, prepared: None, drive: str, seed: int, folder: RunFolder) -> Iterator[tuple[str, IsoWork]]:
    """Divide the work into one part per cycle."""
    for test, cycles in ((POSE_TEST, block.cycles), (PATH_TEST, block.path_cycles)):
        for noise in (True, False):
            for cycle in range(cycles if noise else 1):
                name = f"{test}-{'noise' if noise else 'still'}-{cycle:04d}"
                yield name, IsoWork(block, drive, seed, test, cycle, noise)


def _poses(work: IsoWork, trial: Trial) -> list[dict[str, Any]]:
    """Return the rows of one cycle through the poses; it ends at the first motion that fails."""
    cube = cube_poses(*start_of(work.block))
    rows: list[dict[str, Any]] = []
    drive = drive_of(work.block, work.drive, trial, cube.q[ORDER[0]], noise=work.noise)
    for before, point in pairwise(ORDER):
        row = {"problem": point + 1} | dict(zip(AXES, cube.poses[point, :3, 3].tolist(), strict=True))
        planned = plan(trial.robot, cube.q[point], cube.q[before], timing=work.block.law)
        facts, execution = work.execute(planned, lambda: drive)
        row |= facts
        if execution:
            T = trial.robot.fk(execution.q[-1])
            row |= _reached(T[:3, 3]) | _turn(se3.error(cube.poses[point], T)[3:])
        rows.append(row)
        if not execution:
            break
    return rows


def _path(work: IsoWork, trial: Trial) -> list[dict[str, Any]]:
    """Return the rows of one cycle along the line."""
    planned = _line(work.block)
    q = planned.trajectory(0.0)
    facts, execution = work.execute(planned, lambda: drive_of(work.block, work.drive, trial, q, noise=work.noise))
    command = planned.path.pose(np.linspace(0.0, planned.path.end, CROSSED_PLANES))[:, :3, 3]
    if execution is None or not execution:
        return [facts]
    along = np.tile(command[-1] - command[0], (CROSSED_PLANES, 1))
    met = crossings(command, along, trial.robot.fk(execution.q)[:, :3, 3])
    points = enumerate(zip(command.tolist(), met, strict=True))
    return [facts | {"problem": i} | dict(zip(AXES, at, strict=True)) | _reached(there) for i, (at, there) in points]


def _reached(point: Array) -> dict[str, Any]:
    return {f"reached_{a}": float(x) for a, x in zip(AXES, point, strict=True)}


def _turn(turn: Array) -> dict[str, Any]:
    return {f"turn_{a}": float(x) for a, x in zip(AXES, turn, strict=True)}
