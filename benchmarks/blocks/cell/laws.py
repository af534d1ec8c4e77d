"""Time laws on the plant: tracking error, torque, energy and duration of each, on the same lines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import polars as pl

from benchmarks.blocks.base import NUMBER, TEXT, WHOLE, Field, Session, Shard, Trials, fields_of
from benchmarks.blocks.cell.settings import LawsBlock
from benchmarks.blocks.cell.trials import (
    EXECUTION,
    CellKind,
    Trial,
    drive_of,
    execute,
    failure,
    line_of,
    peaks,
    trial_of,
    with_drive,
)
from optik.errors import InvalidInput
from planners.limits import MotionLimits
from planners.plan import Plan, make_law, plan

OWN_TIME, SAME_TIME = "own", "same"
"""Durations of a motion: the law's own, and that of the slowest law on the line."""


FIELDS = {
    "method": TEXT, **fields_of(WHOLE, "problem repeat"), "timed": TEXT, "length": NUMBER, **EXECUTION,
    **fields_of(Field(pl.List(pl.Float64)), "torque torque_bound"),
    **fields_of(NUMBER, "jerk_ratio acceleration_ratio velocity_ratio rest_m"),
}  # fmt: skip
"""Fields of the rows."""


class Laws(CellKind):
    """Lines under all laws, which are compared with each other: once without noise, where ``repeat`` is 0, or with it."""

    fields = FIELDS

    def prepare(self, block: LawsBlock, seed: int) -> None:
        """Check that the arm has the limits and torques that the laws and the lines need."""
        super().prepare(block, seed)
        for move_m in block.moves_m:
            robot, _, path = line_of(block, move_m)
            if not path.end:
                raise InvalidInput(f"cell {block.id!r}: moves_m", list(move_m), "a motion")
        for law in block.laws:
            make_law(law.name, **law.options).need(MotionLimits.of(robot), robot)

    def count(self, block: LawsBlock, session: Session) -> int:
        """Return the number of lines with their repeats."""
        return len(block.moves_m) * (block.repeats + 1)

    def shards(self, block: LawsBlock, session: Session) -> Iterable[Shard]:
        """Yield every line, with the drive that the block has on this machine."""
        return super().shards(with_drive(block), session)

    def keys(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Yield the fields that identify the motion of each law."""
        for number in trials.numbers:
            motion, repeat = divmod(number, trials.block.repeats + 1)
            about = {"problem": motion, "repeat": repeat, "timed": OWN_TIME, "drive": trials.block.drive}
            yield from (about | {"method": label} for label in trials.labels)

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Execute some lines under all laws."""
        for number in trials.numbers:
            yield from _execute_line(trials, *divmod(number, trials.block.repeats + 1))


def _execute_line(trials: Trials, motion: int, repeat: int) -> Iterator[dict[str, Any]]:
    block: LawsBlock = trials.block
    trial = trial_of(block, trials.seed, motion, "law", repeat, noise=repeat > 0)
    _, q, path = line_of(block, block.moves_m[motion])
    made = {law.label: make_law(law.name, **law.options) for law in block.laws if law.label in trials.labels}
    plans = {label: plan(trial.robot, path, q, timing=law) for label, law in made.items()}
    longest = max((p.trajectory.duration for p in plans.values() if p), default=0.0)
    for label, planned in plans.items():
        about = {"problem": motion, "repeat": repeat, "method": label}
        yield about | {"timed": OWN_TIME} | _executed(block, repeat > 0, trial, planned)
        if block.same_duration and len(made) < len(block.laws):
            why = "another law ended the process, so that no duration is common to all"
            yield about | {"timed": SAME_TIME} | failure(block.drive, "crashed", why)
        elif block.same_duration and planned:
            if planned.trajectory.duration < longest * (1.0 - 1e-9):
                planned = plan(trial.robot, path, q, timing=made[label], duration=longest)
            yield about | {"timed": SAME_TIME} | _executed(block, repeat > 0, trial, planned)


def _executed(block: LawsBlock, noise: bool, trial: Trial, planned: Plan) -> dict[str, Any]:
    """Return the facts on one motion."""
    facts, execution = execute(block, planned, lambda: drive_of(block, trial, planned.trajectory(0.0), noise=noise))
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
