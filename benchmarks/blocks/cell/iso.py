"""Cycles of ISO 9283: five poses, each approached from the previous one, and one line."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.blocks.base import NUMBER, TEXT, TRUTH, WHOLE, Session, Shard, Trials, fields_of
from benchmarks.blocks.cell.iso9283 import crossings, cube_poses
from benchmarks.blocks.cell.settings import AXES, NOISELESS, NOISY, PATH_TEST, POSE_TEST, IsoBlock
from benchmarks.blocks.cell.trials import (
    EXECUTION,
    CellKind,
    Trial,
    drive_of,
    execute,
    line_of,
    start_of,
    trial_of,
    why_not,
    with_drive,
)
from optik import se3
from optik.errors import InvalidInput
from optik.types import Array
from planners.plan import Plan, plan

CROSSED_PLANES = 41
"""Points of the line at which its accuracy is computed."""

ORDER = (0, 4, 3, 2, 1, 0)
"""A cycle of the standard: from P1 to P5, P4, P3, P2 and back to P1, so that each pose is reached from the same side."""

_reached_fields = fields_of(NUMBER, " ".join(f"{what}{a}" for what in ("reached_", "turn_") for a in AXES))


FIELDS = {
    "method": TEXT, "problem": WHOLE, "noise": TRUTH, "test": TEXT, "cycle": WHOLE, **dict.fromkeys(AXES, NUMBER),
    **_reached_fields, **EXECUTION,
}  # fmt: skip
"""Fields of the rows: the commanded point and, in the base frame, the reached one and the rotation between them."""


class Iso(CellKind):
    """Cycles of a block: each is a problem, of the test ``pose`` or ``path``, with noise or without."""

    fields = FIELDS

    def prepare(self, block: IsoBlock, seed: int) -> None:
        """Check the five poses, and that the line can be planned."""
        super().prepare(block, seed)
        planned = _line(block)
        if not planned:
            came = f"{list(block.move_m)}: {why_not(planned)}"
            raise InvalidInput(f"cell {block.id!r}: move_m", came, "a line that the arm can follow")
        cube_poses(*start_of(block))

    def shards(self, block: IsoBlock, session: Session) -> Iterator[Shard]:
        """Yield every cycle."""
        block = with_drive(block)
        for number, (test, noise, cycle) in enumerate(_cycles(block)):
            work = Trials(self, block, session.seed, (number,), (NOISY if noise else NOISELESS,))
            yield Shard(f"{test}-{'noise' if noise else 'still'}-{cycle:04d}", work, block.title)

    def keys(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Yield the fields that identify each cycle."""
        for number in trials.numbers:
            test, noise, cycle = _cycles(trials.block)[number]
            label = NOISY if noise else NOISELESS
            yield {"method": label, "noise": noise, "test": test, "cycle": cycle, "drive": trials.block.drive}

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Execute some cycles."""
        for about in self.keys(trials):
            trial = trial_of(trials.block, trials.seed, about["cycle"], about["test"], 0, noise=about["noise"])
            rows = (_poses if about["test"] == POSE_TEST else _path)(trials.block, trial, about["noise"])
            yield from (about | row for row in rows)


def _cycles(block: IsoBlock) -> list[tuple[str, bool, int]]:
    """Return test, noise and number of every cycle."""
    tests = ((POSE_TEST, block.cycles), (PATH_TEST, block.path_cycles))
    return [
        (test, noise, cycle)
        for test, cycles in tests
        for noise in (True, False)
        for cycle in range(cycles if noise else 1)
    ]


def _line(block: IsoBlock) -> Plan:
    robot, q, path = line_of(block, block.move_m)
    return plan(robot, path, q, timing=block.law)


def _poses(block: IsoBlock, trial: Trial, noise: bool) -> list[dict[str, Any]]:
    """Return the rows of one cycle through the poses; it ends at the first motion that fails."""
    cube = cube_poses(*start_of(block))
    rows: list[dict[str, Any]] = []
    drive = drive_of(block, trial, cube.q[ORDER[0]], noise=noise)
    for before, point in pairwise(ORDER):
        row = {"problem": point + 1} | dict(zip(AXES, cube.poses[point, :3, 3].tolist(), strict=True))
        planned = plan(trial.robot, cube.q[point], cube.q[before], timing=block.law)
        facts, execution = execute(block, planned, lambda: drive)
        row |= facts
        if execution:
            T = trial.robot.fk(execution.q[-1])
            row |= _reached(T[:3, 3]) | _turn(se3.error(cube.poses[point], T)[3:])
        rows.append(row)
        if not execution:
            break
    return rows


def _path(block: IsoBlock, trial: Trial, noise: bool) -> list[dict[str, Any]]:
    """Return the rows of one cycle along the line."""
    planned = _line(block)
    q = planned.trajectory(0.0)
    facts, execution = execute(block, planned, lambda: drive_of(block, trial, q, noise=noise))
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
