"""Time laws on the plant: tracking error, torque, energy and duration of each, on the same lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import polars as pl

from benchmarks.blocks.base import Entry
from benchmarks.blocks.cell.settings import LawsBlock
from benchmarks.blocks.cell.trials import (
    EXECUTION_TYPES,
    CellWork,
    Trial,
    drive_of,
    failure,
    line_of,
    peaks,
    trial_of,
)
from benchmarks.records import RunFolder
from optik.errors import InvalidInput
from planners.limits import MotionLimits
from planners.plan import Plan, make_law, plan

OWN_TIME, SAME_TIME = "own", "same"
"""Durations of a motion: the law's own, and that of the slowest law on the line."""

LAW_TYPES: dict[str, Any] = {
    "problem": pl.Int64, "repeat": pl.Int64, "method": pl.String, "timed": pl.String, "length": pl.Float64,
    **EXECUTION_TYPES, "torque": pl.List(pl.Float64), "torque_bound": pl.List(pl.Float64), "jerk_ratio": pl.Float64,
    "acceleration_ratio": pl.Float64, "velocity_ratio": pl.Float64, "rest_m": pl.Float64,
}  # fmt: skip
"""Columns of the rows."""


@dataclass(frozen=True)
class LawsWork(CellWork):
    """One line under all laws, which are compared with each other: once without noise, where ``repeat`` is 0, or with it."""

    types = LAW_TYPES

    motion: int
    repeat: int

    def row(self, law: Entry, timed: str) -> dict[str, Any]:
        """Return the columns that identify the motion."""
        return dict.fromkeys(LAW_TYPES) | {
            "problem": self.motion, "repeat": self.repeat, "method": law.label, "timed": timed
        }  # fmt: skip

    def lost(self) -> list[dict[str, Any]]:
        """Return the row of each law."""
        return [self.row(law, OWN_TIME) for law in self.entries]

    def solve(self) -> pl.DataFrame:
        """Execute the line under all laws."""
        block: LawsBlock = self.block
        trial = trial_of(block, self.seed, self.motion, "law", self.repeat, noise=self.repeat > 0)
        _, q, path = line_of(block, block.moves_m[self.motion])
        made = {law.label: make_law(law.name, **law.options) for law in self.entries}
        plans = {label: plan(trial.robot, path, q, timing=law) for label, law in made.items()}
        longest = max((p.trajectory.duration for p in plans.values() if p), default=0.0)
        rows = []
        for law in self.entries:
            planned = plans[law.label]
            rows.append(self.row(law, OWN_TIME) | _executed(self, trial, planned))
            if block.same_duration and self.labels:
                why = "another law ended the process, so that no duration is common to all"
                rows.append(self.row(law, SAME_TIME) | failure(self.drive, "crashed", why))
            elif block.same_duration and planned:
                if planned.trajectory.duration < longest * (1.0 - 1e-9):
                    planned = plan(trial.robot, path, q, timing=made[law.label], duration=longest)
                rows.append(self.row(law, SAME_TIME) | _executed(self, trial, planned))
        return self.frame(rows)


def prepare(block: LawsBlock, seed: int) -> None:
    """Check that the arm has the limits and torques that the laws and the lines need."""
    for move_m in block.moves_m:
        robot, _, path = line_of(block, move_m)
        if not path.end:
            raise InvalidInput(f"cell {block.id!r}: moves_m", list(move_m), "a motion")
    for law in block.laws:
        make_law(law.name, **law.options).need(MotionLimits.of(robot), robot)


def parts(block: LawsBlock, prepared: None, drive: str, seed: int, folder: RunFolder) -> Iterator[tuple[str, LawsWork]]:
    """Divide the work."""
    for motion in range(len(block.moves_m)):
        for repeat in range(block.repeats + 1):
            yield f"{motion:02d}--{repeat:03d}", LawsWork(block, drive, seed, motion, repeat)


def _executed(work: LawsWork, trial: Trial, planned: Plan) -> dict[str, Any]:
    """Return the facts on one motion."""
    noise = work.repeat > 0
    facts, execution = work.execute(
        planned, lambda: drive_of(work.block, work.drive, trial, planned.trajectory(0.0), noise=noise)
    )
    if execution is None:
        return facts
    ratios = {name: getattr(planned.certificate, name).ratio for name in ("velocity", "acceleration", "jerk")}
    facts |= {f"{name}_ratio": float(ratio.max()) for name, ratio in ratios.items()}
    facts["length"] = float(planned.path.end)
    if execution.torque is not None:
        peak, bound = peaks(execution)
        facts |= {"torque": peak.tolist(), "torque_bound": None if bound is None else bound.tolist()}
    if execution:
        off = trial.robot.fk(execution.q[-1])[:3, 3] - planned.path.pose(planned.path.end)[:3, 3]
        facts["rest_m"] = float((off @ off) ** 0.5)
    return facts
