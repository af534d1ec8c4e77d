"""Time laws on the plant: what each costs in tracking error, torque, energy and time, on the same lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import polars as pl

from benchmarks.blocks.base import Entry, Part
from benchmarks.blocks.cell.facts import EXECUTION_TYPES, facts_of, failure, peaks, why_not
from benchmarks.blocks.cell.settings import LawsBlock
from benchmarks.blocks.cell.trials import Trial, drive_of, start_configuration, trial_of
from benchmarks.records import slug
from optik import se3
from optik.errors import InvalidInput
from planners.limits import MotionLimits
from planners.paths.line import Line
from planners.plan import Plan, make_law, plan

OWN_TIME, SAME_TIME = "own", "same"
"""Durations of a motion: the law's own, and that of the slowest law on the line."""

LAW_TYPES: dict[str, Any] = {
    "motion": pl.Int64, "repeat": pl.Int64, "method": pl.String, "timed": pl.String, "length": pl.Float64,
    **EXECUTION_TYPES, "torque": pl.List(pl.Float64), "torque_bound": pl.List(pl.Float64), "jerk_ratio": pl.Float64,
    "acceleration_ratio": pl.Float64, "velocity_ratio": pl.Float64, "rest_m": pl.Float64,
}  # fmt: skip
"""Columns of the rows."""


@dataclass(frozen=True)
class LawsWork:
    """One part: one line under all laws, once.

    Attributes
    ----------
    block : LawsBlock
        The block.
    drive : str
        Name of the drive.
    seed : int
        Of the suite.
    motion : int
        Which line.
    repeat : int
        0 without noise; from 1 on with it.
    """

    block: LawsBlock
    drive: str
    seed: int
    motion: int
    repeat: int

    def halves(self) -> tuple[LawsWork, ...]:
        """Nothing: the laws of one line are compared with each other."""
        return ()

    def crashed(self) -> pl.DataFrame:
        """Rows of a line on which the process ended or an error was raised."""
        blank = failure(self.drive, "crashed", "the process ended, or an error was raised")
        return frame([self.row(law, OWN_TIME) | blank for law in self.block.laws])

    def row(self, law: Entry, timed: str) -> dict[str, Any]:
        """Columns that say which motion a row is of."""
        return dict.fromkeys(LAW_TYPES) | {
            "motion": self.motion, "repeat": self.repeat, "method": law.label, "timed": timed
        }  # fmt: skip


def frame(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Rows as a table."""
    return pl.DataFrame(rows, schema=LAW_TYPES)


def prepare_laws(block: LawsBlock) -> None:
    """Check that the arm has what the laws and the lines need."""
    for motion in range(len(block.moves_m)):
        path, _ = _line(block, motion)
        if not path.end:
            raise InvalidInput(f"cell {block.id!r}: moves_m", list(block.moves_m[motion]), "a motion")
    robot = trial_of(block, 0, 0, "law", 0, noise=False).robot
    for law in block.laws:
        make_law(law.name, **law.options).need(MotionLimits.of(robot), robot)


def _line(block: LawsBlock, motion: int) -> tuple[Line, Any]:
    robot = trial_of(block, 0, 0, "law", 0, noise=False).robot
    q = start_configuration(robot, block.start_deg, f"cell {block.id!r}")
    start = robot.fk(q)
    return Line(start, se3.pose(start[:3, :3], start[:3, 3] + block.moves_m[motion])), q


def laws_parts(block: LawsBlock, prepared: tuple[str, int], top: str) -> Iterator[Part]:
    """Divide the work."""
    drive, seed = prepared
    for motion in range(len(block.moves_m)):
        for repeat in range(block.repeats + 1):
            file = f"{top}/{slug(block.id)}--{motion:02d}--{repeat:03d}.parquet"
            yield Part(file, block.title, LawsWork(block, drive, seed, motion, repeat))


def solve_laws(work: LawsWork) -> pl.DataFrame:
    """Execute one line under all laws."""
    block, noise = work.block, work.repeat > 0
    trial = trial_of(block, work.seed, work.motion, "law", work.repeat, noise=noise)
    path, q = _line(block, work.motion)
    plans = {law.label: plan(trial.robot, path, q, timing=make_law(law.name, **law.options)) for law in block.laws}
    longest = max((p.trajectory.duration for p in plans.values() if p), default=0.0)
    rows = []
    for law in block.laws:
        planned = plans[law.label]
        rows.append(work.row(law, OWN_TIME) | _executed(work, trial, planned))
        if block.same_duration and planned:
            if planned.trajectory.duration < longest * (1.0 - 1e-9):
                planned = plan(trial.robot, path, q, timing=make_law(law.name, **law.options), duration=longest)
            rows.append(work.row(law, SAME_TIME) | _executed(work, trial, planned))
    return frame(rows)


def _executed(work: LawsWork, trial: Trial, planned: Plan) -> dict[str, Any]:
    """Facts on one motion."""
    if not planned:
        return failure(work.drive, str(planned.status), why_not(planned))
    proof = planned.certificate
    found: dict[str, Any] = {
        f"{name}_ratio": float(getattr(proof, name).ratio.max()) for name in ("velocity", "acceleration", "jerk")
    } | {"length": float(planned.path.end)}
    execution = drive_of(work.block, work.drive, trial, planned.trajectory(0.0), noise=work.repeat > 0).execute(planned)
    found |= facts_of(execution)
    if execution.torque is not None:
        peak, bound = peaks(execution)
        found |= {"torque": peak.tolist(), "torque_bound": None if bound is None else bound.tolist()}
    if execution:
        off = trial.robot.fk(execution.q[-1])[:3, 3] - planned.path.pose(planned.path.end)[:3, 3]
        found["rest_m"] = float((off @ off) ** 0.5)
    return found
